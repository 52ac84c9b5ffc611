"""The page reports/blind.md: mean jumps with laws chosen by their ranges alone, against the regressions of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLUE, GREY, ORANGE, RED
from bench.suites.blind import CHOSEN, THESIS, TURBULENT
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, listed, of
from saltation.study.turbulence import DEPTH, ENTRAINMENT

QUANTITIES = {"height": "H (d)", "length": "L (d)", "velocity": "ū (u*)"}
ENVELOPE = {"height": "height", "length": "length", "velocity": "speed"}  # their names among the regressions


def rows_of(data: Record, name: str, seed: int | None = None) -> list[Record]:
    """A variant's runs, by R_p and T; of one seed, or of all."""
    return [row for row in data["rows"] if row["name"] == name and seed in (None, row["seed"])]


def count(rows: Sequence[Record]) -> int:
    """Means inside the envelope."""
    return sum(len(row["inside"]) for row in rows)


def edges(data: Record, row: Record) -> Record:
    """The envelope where a run is."""
    return next(e for e in data["envelopes"] if (e["particle_reynolds"], e["stage"]) == (row["particle_reynolds"], row["stage"]))


def single_changes(data: Record) -> list[tuple[str, int, int]]:
    """(name, means inside, runs that went to their end) of every single change, the most inside first."""
    names = [name for name in dict.fromkeys(row["name"] for row in data["rows"]) if name not in (CHOSEN, THESIS, TURBULENT)]
    found = [(name, count(rows), sum(row["status"] == "finished" for row in rows)) for name in names for rows in [rows_of(data, name)]]
    return sorted(found, key=lambda item: -item[1])


def opening(data: Record) -> Record:
    """What the test has come to."""
    blind, best = rows_of(data, CHOSEN, 1), single_changes(data)
    loads = [row["bed_load"]["rate"] / row["bed_load"]["wong_parker"] for row in blind]
    most = [name for name, inside, _ in best if inside == best[0][1]]
    return {
        "inside": count(blind),
        "thesis": count(rows_of(data, THESIS, 1)),
        "points": len(QUANTITIES) * len(data["envelopes"]),
        "load": f"{factor(min(loads))} to {factor(max(loads))}",
        "best": listed([f"“{name}”" for name in most[:3]]) + (f" and {len(most) - 3} more" if len(most) > 3 else ""),
        "best_inside": best[0][1],
    }


def laws(data: Record) -> str:
    """What the rule chose, by R_p and T; alike stages together."""
    lines: dict[tuple[int, str], list[float]] = {}
    for row in data["laws"]:
        words = "; ".join(f"{family} {name}{'' if holds else ' (none holds: the nearest)'}" for family, (name, holds) in row["laws"].items())
        lines.setdefault((row["particle_reynolds"], words), []).append(row["stage"])
    return table(["R_p", "T", "laws"], [[str(size), listed([f"{stage:g}" for stage in stages]), words] for (size, words), stages in lines.items()])


def means(data: Record) -> str:
    """Blind means beside the thesis's laws and the envelope."""
    lines = []
    for row, other in zip(rows_of(data, CHOSEN, 1), rows_of(data, THESIS, 1), strict=True):
        cells = []
        for name, own in ENVELOPE.items():
            low, high = edges(data, row)[own]
            mark = "**" if name in row["inside"] else ""
            cells.append(f"{mark}{row[name]['mean']:.3g} ± {row[name]['se']:.1g}{mark} ({other[name]['mean']:.3g}); {low:.3g} to {high:.3g}")
        load, before = row["bed_load"], other["bed_load"]
        cells.append(f"{factor(load['rate'] / load['wong_parker'])} ({factor(before['rate'] / before['wong_parker'])})")
        lines.append([f"{row['particle_reynolds']}, {row['stage']:g}", *cells])
    return table(["R_p, T", *(f"{title}: blind (thesis's laws); envelope" for title in QUANTITIES.values()), "q*/Wong–Parker: blind (thesis's laws)"], lines)


def turbulent(data: Record) -> str:
    """The same means in a turbulent stream."""
    lines = []
    for row in rows_of(data, TURBULENT, 1):
        (other,) = of(rows_of(data, CHOSEN, 1), particle_reynolds=row["particle_reynolds"], stage=row["stage"])
        cells = []
        for name in ENVELOPE:
            mark = "**" if name in row["inside"] else ""
            cells.append(f"{mark}{row[name]['mean']:.3g} ± {row[name]['se']:.1g}{mark} ({other[name]['mean']:.3g})")
        lines.append([f"{row['particle_reynolds']}, {row['stage']:g}", *cells, row["status"]])
    return table(["R_p, T", *(f"{title}: with turbulence (without)" for title in QUANTITIES.values()), "ended"], lines)


def draw_means(data: Record) -> Any:
    """H, L and ū against T in the envelopes."""
    figure, axes = plt.subplots(2, 3, figsize=(10.0, 6.2), sharex="row")
    for line, size in zip(axes, dict.fromkeys(row["particle_reynolds"] for row in data["envelopes"]), strict=True):
        bands = [e for e in data["envelopes"] if e["particle_reynolds"] == size]
        for axis, (name, title) in zip(line, QUANTITIES.items(), strict=True):
            low, high = np.transpose([e[ENVELOPE[name]] for e in bands])
            axis.fill_between([e["stage"] for e in bands], low, high, color=GREY, alpha=0.3, lw=0)
            for variant, colour, mark in ((CHOSEN, BLUE, "o"), (TURBULENT, RED, "^"), (THESIS, ORANGE, "s")):
                for seed in range(1, data["seeds"] + 1):
                    runs = [row for row in rows_of(data, variant, seed) if row["particle_reynolds"] == size]
                    label = variant if seed == 1 else None
                    axis.plot([row["stage"] for row in runs], [row[name]["mean"] for row in runs], mark, color=colour, ms=5, mfc="none", label=label)
            axis.set(xlabel="T", ylabel=title, title=f"R_p {size}")
            axis.set_ylim(bottom=0.0)
    axes[0, 0].legend(frameon=False, fontsize=8)
    figure.suptitle("Mean jumps with laws chosen by range, the same in a turbulent stream, and the thesis's laws, in the envelope of three regressions (grey)")
    return figure


def draw_changes(data: Record) -> Any:
    """How many means lie inside after each single change."""
    found = single_changes(data)[::-1]
    figure, axes = plt.subplots(figsize=(8.0, 0.21 * len(found) + 1.4))
    axes.barh(range(len(found)), [inside for _, inside, _ in found], color=[BLUE if ended == len(data["envelopes"]) else GREY for _, _, ended in found])
    axes.grid(False, axis="y")
    axes.set_axisbelow(True)
    blind = count(rows_of(data, CHOSEN, 1))
    axes.axvline(blind, color=ORANGE)
    axes.text(blind, len(found) - 0.4, " chosen by range", color=ORANGE, va="bottom", fontsize=8)
    axes.set_yticks(range(len(found)), [name for name, _, _ in found], fontsize=7)
    axes.set(xlabel=f"means inside, of {len(QUANTITIES) * len(data['envelopes'])} (grey: runs that ended early)")
    figure.suptitle("One change at a time, after the fact: no default follows from it")
    return figure


def build(data: dict[str, Record]) -> str:
    """The page reports/blind.md."""
    own = data["blind"]
    blind = rows_of(own, CHOSEN, 1)
    numbers = range(1, own["seeds"] + 1)
    seeds = [count(rows_of(own, CHOSEN, seed)) for seed in numbers]
    shaken = [count(rows) for seed in numbers if (rows := rows_of(own, TURBULENT, seed))]
    before = [row["bed_load"]["rate"] / row["bed_load"]["wong_parker"] for row in rows_of(own, THESIS, 1)]
    measured = own["provenance"]
    return fill(
        "blind.md",
        own=own,
        **opening(own),
        shaken=shaken[0] if shaken else "none counted yet",
        shaken_seeds=listed([str(inside) for inside in shaken]),
        turbulent=turbulent(own),
        depth=DEPTH,
        entrainment=ENTRAINMENT,
        seeds=listed([str(inside) for inside in seeds]),
        by_quantity=listed([f"{sum(name in row['inside'] for row in blind)} of {title.split()[0]}" for name, title in QUANTITIES.items()]),
        load_before=f"{factor(min(before))} to {factor(max(before))}",
        changes=len(single_changes(own)),
        commit=measured["commit"],
        date=measured["date"][:10],
        laws=laws(own),
        means=means(own),
        figure_means=save(draw_means(own), "blind_means"),
        figure_changes=save(draw_changes(own), "blind_changes"),
        footer=footer({"blind": own}),
    )


PAGE = Page("blind", build, ("blind",))
