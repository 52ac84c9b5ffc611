"""The page reports/choosing.md: which effects a scene calls for, whether effects = "auto" finds them, and which open choice matters."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import pandas as pd

from reports import choosing_figures as figures
from reports.analysis import Record, Target, short
from reports.page import asked, factor, fill, footer, grouped, save, table
from saltation.plots import choices as advice_plots
from saltation.study.choices import spreads

TITLES = {"sand": "sand, R_p 73", "sand_coarse": "coarse sand, R_p 250", "gravel": "gravel, 30 mm"}
QUANTITIES = {"height": "H", "length": "L", "velocity": "ū"}
SHORT = {"added_mass": "added mass"}
CHOICES = ("chosen", "looser")  # kinds of choices in the records: the default tolerance, and another


def word(effect: str) -> str:
    """An effect as people write it."""
    return SHORT.get(effect, effect)


def listed(effects: Sequence[str], none: str = "nothing") -> str:
    """Some effects in a sentence."""
    words = [word(name) for name in effects]
    return none if not words else words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


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


def true_row(data: Record, name: str, which: str = "chosen") -> Record:
    """What the truth says of the set that is chosen."""
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
    """What is chosen, beside the truth."""
    lines = []
    for which in CHOICES:
        tolerance = tolerance_of(data, which)
        for name, rows in data["sets"].items():
            fine, truth, runs = within(rows, tolerance), true_row(data, name, which), data[which][name]
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
        "truly within it without …",
        "auto leaves out",
        "true largest change",
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


def targets(data: Record) -> list[Target]:
    """What was asked, beside what was measured."""
    kept = {name: [effect for effect in ("history", "magnus") if effect not in dropped(data, name)] for name in data["sets"]}
    pairs = [(name, which) for which in CHOICES for name in data["sets"]]
    few = sum(fewest(data, name, which) for name, which in pairs)
    kept_to = [true_row(data, name, which)["largest"] <= tolerance_of(data, which) for name, which in pairs]
    every = sum(len(rows) for rows in data["sets"].values())
    found = f"true change within it in {sum(kept_to)} of {len(kept_to)} choices; no set with fewer effects among {every} in {few}"
    runs = [(name, which, run) for name, which in pairs for run in data[which][name]]
    steady = sum(set(run["left_out"]) == set(dropped(data, name, which)) for name, which, run in runs)
    tolerances = " and ".join(f"{100 * tolerance_of(data, which):g}" for which in CHOICES)
    return [
        Target('`effects = "auto"` agrees with a full ablation', f"sand, coarse sand, gravel, at {tolerances} %", found, all(kept_to) and few == len(pairs)),
        Target("the same choice with five seeds", "–", f"{steady} of {len(runs)}", steady == len(runs)),
        Target("sand keeps history and Magnus", "both", listed(kept["sand"]), len(kept["sand"]) == 2),
        Target("gravel drops history", "yes", "no" if "history" in kept["gravel"] else "yes", "history" not in kept["gravel"]),
        Target("gravel drops Magnus, or the report says why not", "either", "kept, the reason given" if "magnus" in kept["gravel"] else "dropped", True),
    ]


def fewest(data: Record, name: str, which: str = "chosen") -> bool:
    """Whether no set within the tolerance has fewer effects than the one chosen."""
    rows = data["sets"][name]
    return len(true_row(data, name, which)["effects"]) == min(len(row["effects"]) for row in [rows[0], *within(rows, tolerance_of(data, which))])


def spoken(left_out: Sequence[str]) -> str:
    """What a scene can do without, in a sentence."""
    return f"can do without {listed(left_out)}" if left_out else "needs all of them"


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    own = data["choosing"]
    gravel = own["sets"]["gravel"]
    magnus = next(row for row in own["ablation"]["gravel"] if row["effect"] == "magnus")
    history = {name: next(row for row in own["ablation"][name] if row["effect"] == "history") for name in own["sets"]}
    spread = extremes(own, "sand")
    (first, most), (second, next_) = list(spread.items())[:2]
    last, least = list(spread.items())[-1]
    return fill(
        "choosing_opening.md",
        tolerance=f"{100 * own['tolerance']:g}",
        sets=len(gravel),
        without="; ".join(f"{TITLES[name].split(',')[0]} {spoken(dropped(own, name))}" for name in own["sets"]),
        looser=f"{100 * tolerance_of(own, 'looser'):g}",
        then="; ".join(f"{TITLES[name].split(',')[0]} {spoken(dropped(own, name, 'looser'))}" for name in own["sets"]),
        sand=percent(history["sand"]["height_change"]),
        gravel=percent(history["gravel"]["height_change"]),
        magnus=factor(1.0 / (1.0 + magnus["height_change"])),
        measured=factor(own["magnus"]["rows"][f"{own['magnus']['coefficient']:g}"]["height"] / own["magnus"]["rows"]["none"]["height"]),
        jumps=grouped(max(run["jumps"] for runs in own["chosen"].values() for run in runs)),
        first=first,
        most=f"{most:.1f}",
        second=second,
        next=f"{next_:.1f}",
        last=last,
        least=f"{least:.1f}",
        error=short(own["uncertainty"]["sand"][0]["height_error"]),
    )


def choosing(data: dict[str, Record]) -> str:
    """The page reports/choosing.md."""
    own = data["choosing"]
    wanted = targets(own)
    coefficient = f"{own['magnus']['coefficient']:g}"
    heights = {name: row["height"] for name, row in own["magnus"]["rows"].items()}
    return fill(
        "choosing.md",
        opening=opening(data),
        figure_sets=save(figures.sets(own, TITLES), "choosing_sets"),
        figure_ablation=save(advice_plots.ablation(frame(own["ablation"]["sand"]).set_index("effect"), "Sand"), "choosing_ablation"),
        figure_spread=save(advice_plots.spread(frame(own["uncertainty"]["sand"]), "Sand"), "choosing_spread"),
        figure_gravel=save(advice_plots.spread(frame(own["uncertainty"]["gravel"]), "Gravel"), "choosing_spread_gravel"),
        advised=advised(own),
        choices=choices(own),
        costs=costs(own),
        uncertain=uncertain(own, "sand"),
        shares=shares(own),
        combined=own["combined"]["number"],
        finished=own["combined"]["finished"],
        tolerance=f"{100 * own['tolerance']:g}",
        error=f"{100 * own['error']:g}",
        seed=own["seed"],
        magnus=factor(heights["0.75"] / heights["none"]),
        thesis=f"{heights['0.75']:.2g}",
        measured=f"{heights[coefficient]:.2g}",
        none=f"{heights['none']:.2g}",
        fifth=factor(heights[coefficient] / heights["none"]),
        coefficient=coefficient,
        then=listed(own["magnus"]["chosen"]["left_out"]),
        targets=asked(wanted),
        met=f"{sum(row.met for row in wanted)} of {len(wanted)} are met.",
        footer=footer({"choosing": own}),
    )
