"""The page reports/choosing.md: which effects a scene calls for, whether effects = "auto" finds them, and which open choice matters."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd

from basset._look import BLUE, GREY, RED
from reports import words
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped
from saltation.plots import choices as advice_plots
from saltation.study.choices import spreads

TITLES = {"sand": "sand, R_p 73", "sand_coarse": "coarse sand, R_p 250", "gravel": "gravel, 30 mm"}
QUANTITIES = {"height": "H", "length": "L", "velocity": "ū"}
SHORT = {"added_mass": "added mass"}
CHOICES = ("chosen", "looser")  # kinds of choices in the records: the default tolerance, and another


def word(effect: str) -> str:
    """An effect as people write it."""
    return SHORT.get(effect, effect)


def listed(effects: Sequence[str]) -> str:
    """Some effects in a sentence."""
    return words.listed([word(name) for name in effects])


def percent(value: float) -> str:
    """A change with its sign."""
    return f"{100.0 * value:+.1f}" if abs(value) < 0.1 else f"{100.0 * value:+.0f}"


def change(row: Record) -> str:
    """The changes of H, L and ū in one cell, or why there are none."""
    if row["status"] != "finished":
        return str(row["status"])
    return " / ".join(percent(row[f"{name}_change"]) for name in QUANTITIES)


def frame(rows: Sequence[Record]) -> pd.DataFrame:
    """Rows of the JSON as `saltation.study.effects` gave them."""
    return pd.DataFrame(list(rows))


def missing(rows: Sequence[Record], row: Record) -> list[str]:
    """What a set has not of the first, the full one."""
    return [name for name in rows[0]["effects"] if name not in row["effects"]]


def within(own: Sequence[Record], tolerance: float) -> list[Record]:
    """Sets, other than the full one, whose means are within the tolerance of its."""
    return [row for row in own[1:] if row["largest"] is not None and row["largest"] <= tolerance]


def dropped(data: Record, name: str, which: str = "chosen") -> list[str]:
    """What effects = "auto" leaves out with the scene's own seed."""
    found: list[str] = data[which][name][0]["left_out"]
    return found


def tolerance_of(data: Record, which: str) -> float:
    """The tolerance of a kind of choice."""
    return float(next(iter(data[which].values()))[0]["tolerance"])


def reference_row(data: Record, name: str, which: str = "chosen") -> Record:
    """The reference run with the set that is chosen."""
    rows = data["sets"][name]
    return next(row for row in rows if set(missing(rows, row)) == set(dropped(data, name, which)))


def advised(data: Record) -> str:
    """What the numbers say, beside what leaving out shows."""
    names = list(data["advised"])
    effects = [row["effect"] for row in data["advised"][names[0]] if row["effect"] != "encounters"]
    lines = []
    for effect in effects:
        cells = []
        for name in names:
            told = next(row for row in data["advised"][name] if row["effect"] == effect)
            found = next((row for row in data["ablation"][name] if row["effect"] == effect), None)
            cells.append(f"{told['share']:.2g}: {told['verdict']}<br>{change(found) if found else '–'}")
        source = next(row["source"] for row in data["advised"][names[0]] if row["effect"] == effect)
        lines.append([word(effect), *cells, source])
    return table(["effect", *(TITLES[name] for name in names), "source"], lines)


def choices(data: Record) -> str:
    """What is chosen, beside the reference."""
    lines = []
    for which in CHOICES:
        tolerance = tolerance_of(data, which)
        for name, rows in data["sets"].items():
            fine, truth, runs = within(rows, tolerance), reference_row(data, name, which), data[which][name]
            few = sorted(fine, key=lambda row: len(row["effects"]))[:3]
            more = f" and {len(fine) - len(few)} more" if len(fine) > len(few) else ""
            lines.append(
                [
                    f"{100 * tolerance:g} %",
                    TITLES[name],
                    ("; ".join(listed(missing(rows, row)) for row in few) or "none") + more,
                    listed(dropped(data, name, which)),
                    f"{100 * truth['largest']:.1f} %" if dropped(data, name, which) else "–",
                    "yes" if fewest(data, name, which) else "**no**",
                    f"{sum(set(run['left_out']) == set(dropped(data, name, which)) for run in runs)} of {len(runs)}",
                    f"{truth['time']:.2f} ×" if dropped(data, name, which) else "–",
                ]
            )
    head = [
        "tolerance",
        "scene",
        "within it, by the reference, without …",
        "auto leaves out",
        "largest change in the reference",
        "no set with fewer effects",
        "the same with other seeds",
        "time per jump",
    ]
    return table(head, lines)


def costs(data: Record) -> str:
    """What choosing takes."""
    lines = []
    for name, runs in data["chosen"].items():
        jumps = [run["jumps"] for run in runs]
        seconds = [run["seconds"] for run in runs]
        own = statistics.median(run["run_seconds"] for run in runs)
        lines.append([TITLES[name], f"{grouped(min(jumps))} to {grouped(max(jumps))}", f"{min(seconds):.1f} to {max(seconds):.1f} s", f"{own:.2f} s"])
    return table(["scene", "jumps flown to choose", "wall time, everything compiled", "the scene's own run, 220 jumps"], lines)


def uncertain(data: Record, name: str) -> str:
    """Every value of every choice."""
    rows = data["uncertainty"][name]
    lines = [
        [row["choice"], row["value"], row["status"], *(f"{percent(row[f'{key}_change'])} ± {100 * row[f'{key}_error']:.1g}" for key in QUANTITIES)]
        for row in rows[1:]
        if row[f"{next(iter(QUANTITIES))}_change"] != 0.0 or row["status"] != "finished"
    ]
    return table(["choice", "value", "run", *(f"{symbol} (%)" for symbol in QUANTITIES.values())], lines)


def extremes(data: Record, name: str) -> dict[str, Any]:
    """The choices by how far they spread the height, widest first."""
    found = spreads(frame(data["uncertainty"][name]))
    found["factor"] = found["height_high"] / found["height_low"]
    return {str(row["choice"]): float(row["factor"]) for _, row in found.sort_values("factor", ascending=False).iterrows()}


def shares(data: Record) -> str:
    """What each choice makes of the spread over all combinations."""
    own = data["combined"]
    lines = [[f"{100 * float(quantile):.0f} % lie below", *(f"{row[key]:.3g}" for key in QUANTITIES)] for quantile, row in own["extent"].items()]
    lines += [[f"share of {choice}", *(f"{100 * row[key]:.0f} %" for key in QUANTITIES)] for choice, row in own["shares"].items()]
    return table(["", "H (d)", "L (d)", "ū (u*)"], lines)


def fewest(data: Record, name: str, which: str = "chosen") -> bool:
    """Whether no set within the tolerance has fewer effects than the one chosen."""
    rows = data["sets"][name]
    return len(reference_row(data, name, which)["effects"]) == min(len(row["effects"]) for row in [rows[0], *within(rows, tolerance_of(data, which))])


def spoken(left_out: Sequence[str]) -> str:
    """What a scene can do without, in a sentence."""
    return f"can do without {listed(left_out)}" if left_out else "needs all of them"


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    own = data["choosing"]
    gravel = own["sets"]["gravel"]
    magnus = next(row for row in own["ablation"]["gravel"] if row["effect"] == "magnus")
    history = {name: next(row for row in own["ablation"][name] if row["effect"] == "history") for name in own["sets"]}
    spread = extremes(own, "sand")
    (first, most), (second, next_) = list(spread.items())[:2]
    last, least = list(spread.items())[-1]
    return {
        "sand": percent(history["sand"]["height_change"]),
        "gravel_change": percent(history["gravel"]["height_change"]),
        "tolerance": f"{100 * own['tolerance']:g}",
        "sets": len(gravel),
        "without": "; ".join(f"{TITLES[name].split(',')[0]} {spoken(dropped(own, name))}" for name in own["sets"]),
        "magnus_gravel": factor(1.0 / (1.0 + magnus["height_change"])),
        "magnus_measured": factor(own["magnus"]["rows"][f"{own['magnus']['coefficient']:g}"]["height"] / own["magnus"]["rows"]["none"]["height"]),
        "first": first,
        "most": f"{most:.1f}",
        "second": second,
        "next": f"{next_:.1f}",
        "last": last,
        "least": f"{least:.1f}",
    }


def choosing(data: dict[str, Record]) -> str:
    """The page reports/choosing.md."""
    own = data["choosing"]
    coefficient = f"{own['magnus']['coefficient']:g}"
    heights = {name: row["height"] for name, row in own["magnus"]["rows"].items()}
    return fill(
        "choosing.md",
        own=own,
        heights=heights,
        **opening(data),
        figure_sets=save(draw_sets(own, TITLES), "choosing_sets"),
        figure_ablation=save(advice_plots.ablation(frame(own["ablation"]["sand"]).set_index("effect"), "Sand"), "choosing_ablation"),
        figure_spread=save(advice_plots.spread(frame(own["uncertainty"]["sand"]), "Sand"), "choosing_spread"),
        figure_gravel=save(advice_plots.spread(frame(own["uncertainty"]["gravel"]), "Gravel"), "choosing_spread_gravel"),
        advised=advised(own),
        choices=choices(own),
        costs=costs(own),
        uncertain=uncertain(own, "sand"),
        shares=shares(own),
        error=f"{100 * own['error']:g}",
        thesis=f"{heights['0.75']:.2g}",
        measured=f"{heights[coefficient]:.2g}",
        fifth=factor(heights[coefficient] / heights["none"]),
        coefficient=coefficient,
        then=listed(own["magnus"]["chosen"]["left_out"]),
        footer=footer({"choosing": own}),
    )


# Figures, from the records alone


def draw_sets(data: Record, titles: Mapping[str, str]) -> Any:
    """The largest change of H, L or ū in the reference with every set of effects, against the number of effects; what is chosen is marked."""
    figure, panels = plt.subplots(1, len(data["sets"]), figsize=(11.0, 4.2), sharey=True)
    for axes, (name, rows) in zip(panels, data["sets"].items(), strict=True):
        full = len(rows[0]["effects"])
        for row in rows[1:]:
            if row["largest"] is None:  # its run did not finish
                continue
            axes.semilogy(len(row["effects"]), 100.0 * row["largest"], "o", color=GREY, alpha=0.7)
        axes.axhline(100.0 * data["tolerance"], color=RED, linestyle=":")
        left_out = data["chosen"][name][0]["left_out"]
        chosen = next(row for row in rows if set(rows[0]["effects"]) - set(row["effects"]) == set(left_out))
        if left_out:
            place = (len(chosen["effects"]), 100.0 * chosen["largest"])
            axes.semilogy(*place, "o", color=BLUE, markersize=9)
            text = "auto: without\n" + " and ".join(word.replace("_", " ") for word in left_out)
            axes.annotate(text, place, xytext=(-8, -4), textcoords="offset points", ha="right", va="top", color=BLUE)
        else:
            axes.annotate(
                f"auto: keeps all {full}", (full, 100.0 * data["tolerance"]), xytext=(0, -8), textcoords="offset points", ha="right", va="top", color=BLUE
            )
        axes.set(xlabel="number of effects", title=titles[name], xlim=(1.5, full + 0.5), ylim=(0.2, 2000.0))
    panels[0].annotate(f"tolerance {100.0 * data['tolerance']:g} %", (1.6, 100.0 * data["tolerance"]), xytext=(0, 3), textcoords="offset points", color=RED)
    panels[0].set(ylabel="largest change of mean H, L or ū (%)")
    ticks = (1.0, 10.0, 100.0, 1000.0)
    panels[0].set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    less = [titles[name].split(",")[0] for name in data["sets"] if data["chosen"][name][0]["left_out"]]
    can = f"{' and '.join(less) or 'no scene'} can do without some"
    figure.suptitle(f"Every set of effects, flown with another seed: within {100.0 * data['tolerance']:g} % {can}")
    return figure


PAGE = Page("choosing", choosing, ("choosing",))
