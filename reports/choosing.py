"""The page reports/choosing.md: which effects a scene calls for, whether effects = "auto" finds them, and which open choice matters."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import pandas as pd

from reports import choosing_figures as figures
from reports.analysis import Record, Target, short
from reports.page import asked, factor, fill, footer, grouped, save, table
from saltation import advice, advice_plots

TITLES = {"sand": "sand, R_p 73", "sand_coarse": "coarse sand, R_p 250", "gravel": "gravel, 30 mm"}
QUANTITIES = {"height": "H", "length": "L", "velocity": "ū"}
SHORT = {"added_mass": "added mass"}


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
    """Rows of the JSON as `saltation.advice` gave them."""
    return pd.DataFrame(list(rows))


def missing(rows: Sequence[Record], row: Record) -> list[str]:
    """What a set has not of the first, the full one."""
    return [name for name in rows[0]["effects"] if name not in row["effects"]]


def within(own: Sequence[Record], tolerance: float) -> list[Record]:
    """Sets, other than the full one, whose means are within the tolerance of its."""
    return [row for row in own[1:] if row["largest"] is not None and row["largest"] <= tolerance]


def dropped(data: Record, name: str) -> list[str]:
    """What effects = "auto" leaves out with the scene's own seed."""
    found: list[str] = data["chosen"][name][0]["left_out"]
    return found


def true_row(data: Record, name: str) -> Record:
    """What the truth says of the set that is chosen."""
    rows = data["sets"][name]
    return next(row for row in rows if set(missing(rows, row)) == set(dropped(data, name)))


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
    for name, rows in data["sets"].items():
        fine = within(rows, data["tolerance"])
        truth = true_row(data, name)
        runs = data["chosen"][name]
        lines.append(
            [
                TITLES[name],
                str(len(rows)),
                "; ".join(listed(missing(rows, row)) for row in fine) or "none",
                listed(dropped(data, name)),
                f"{100 * truth['largest']:.1f} %",
                "yes" if fewest(data, name) else "**no**",
                f"{sum(set(run['left_out']) == set(dropped(data, name)) for run in runs)} of {len(runs)}",
                f"{truth['time']:.2f} ×",
            ]
        )
    head = [
        "scene",
        "sets",
        "within the tolerance without …",
        "auto leaves out",
        "true largest change",
        "fewest effects",
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
    found = advice.spreads(frame(data["uncertainty"][name]))
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
    agreed = {name: fewest(data, name) for name in data["sets"]}
    worst = max(true_row(data, name)["largest"] for name in data["sets"])
    steady = all(set(run["left_out"]) == set(dropped(data, name)) for name, runs in data["chosen"].items() for run in runs)
    every = sum(len(rows) for rows in data["sets"].values())
    found = f"{sum(agreed.values())} of {len(agreed)} take the fewest of {every} sets flown; true change at most {100 * worst:.1f} %"
    right = all(agreed.values()) and worst <= data["tolerance"]
    return [
        Target('`effects = "auto"` agrees with a full ablation', "sand, coarse sand, gravel", found, right),
        Target("the same choice with five seeds", "–", "always" if steady else "not always", steady),
        Target("sand keeps history and Magnus", "both", listed(kept["sand"]), len(kept["sand"]) == 2),
        Target("gravel drops history", "yes", "no" if "history" in kept["gravel"] else "yes", "history" not in kept["gravel"]),
        Target("gravel drops Magnus, or why not", "yes", "no, see there" if "magnus" in kept["gravel"] else "yes", "magnus" not in kept["gravel"]),
    ]


def fewest(data: Record, name: str) -> bool:
    """Whether no set within the tolerance has fewer effects than the one chosen."""
    rows = data["sets"][name]
    return len(true_row(data, name)["effects"]) == min(len(row["effects"]) for row in [rows[0], *within(rows, data["tolerance"])])


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
        dropped=listed(dropped(own, "gravel")),
        kept=listed(dropped(own, "sand"), "none"),
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
        error=short(own["uncertainty"]["sand"][0]["height_error"] / 2.0**0.5),
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
        figure_ablation=save(advice_plots.ablation(frame(own["ablation"]["sand"]).set_index("effect")), "choosing_ablation"),
        figure_spread=save(advice_plots.spread(frame(own["uncertainty"]["sand"])), "choosing_spread"),
        figure_gravel=save(advice_plots.spread(frame(own["uncertainty"]["gravel"])), "choosing_spread_gravel"),
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
