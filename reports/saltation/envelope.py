"""Where the thesis's case lies among the regressions."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from reports.saltation.records import AXES, QUANTITIES, SIZES, STAGE, errors, grid, inside, number, points, published, side, stages
from reports.site.page import finished, save, table
from reports.words import Record, of, span

REGRESSIONS = {"lee_hsu_1994": ("Lee–Hsu 1994", "--"), "sklar_dietrich_2004": ("Sklar–Dietrich 2004", "-."), "van_rijn_1984": ("van Rijn 1984", ":")}
READINGS = {  # shown beside the thesis's case: name in the records, label, colour, marker
    "swamee, reject": ("swamee, reject", ORANGE, "s"),
    "yalin, clip": ("yalin, clip", RED, "^"),
    "swamee, clip, k_s = 2 d": ("swamee, clip, k$_s$ = 2 d", GREEN, "v"),
    "Mei–Adrian: restarted": ("Mei–Adrian's kernel, memory restarted", PURPLE, "D"),
}


def near(data: Record, row: Record, quantity: str) -> bool:
    """Whether a mean lies outside of the envelope by less than two standard errors."""
    low, high = published(data, row)["envelope"][quantity]
    reach = 2.0 * (row[quantity]["se"] or 0.0)
    return side(data, row, quantity) != 0 and row[quantity]["mean"] is not None and low - reach <= row[quantity]["mean"] <= high + reach


def reading_cells(data: Record, name: str) -> list[str]:
    """Inside how often, per R_p and quantity; and on which side the others lie."""
    cells = []
    for reynolds in SIZES:
        rows = grid(data, name, reynolds)
        for quantity in QUANTITIES:
            sides = [side(data, row, quantity) for row in rows]
            words = "".join(f", {sides.count(k)} {word}" for k, word in ((-1, "below"), (1, "above")) if k in sides)
            cells.append(f"{sides.count(0)}{words}" if sides.count(0) < len(sides) else "all")
    return cells


def reading_table(data: Record, kind: str) -> str:
    """Every variant of a kind against the envelope."""
    names = dict.fromkeys(r["name"] for r in data["grid"]["records"] if r["kind"] == kind)
    rows = []
    for name in names:
        runs = [row for reynolds in SIZES for row in grid(data, name, reynolds)]
        bad = [row for row in runs if row["status"] != "finished"]
        note = "" if not bad else f"; {len(bad)} of {len(runs)} runs end early: {', '.join(sorted({row['status'] for row in bad}))}"
        shown = f"**{name}** (the thesis's case)" if name == data["grid"]["shipped"] else name
        rows.append([shown, *reading_cells(data, name), f"{inside(data, name)} of {points(data)}{note}"])
    head = [f"R_p {reynolds}: {symbol}" for reynolds in SIZES for symbol in QUANTITIES.values()]
    return table(["profile, contact angles" if kind == "reading" else "history force (swamee, clip)", *head, "inside in all"], rows)


def spread_of(data: Record, reynolds: int, stage: float, quantity: str) -> tuple[float, float]:
    """Smallest and largest mean of the memories and the thesis's case."""
    rows = of(data["records"], particle_reynolds=reynolds, stage=stage)
    values = [row[quantity]["mean"] for row in rows if row["kind"] == "memory" or row["name"] == data["shipped"]]
    return min(values), max(values)


def spreads(data: Record, reynolds: int) -> list[float]:
    """Largest over smallest mean height of the memories, by stage."""
    edges = [spread_of(data["grid"], reynolds, row["stage"], "height") for row in grid(data, data["grid"]["shipped"], reynolds)]
    return [most / least for least, most in edges]


def stage_table(data: Record) -> str:
    """The thesis's case at every stage: ours, the model's spread, the envelope."""
    rows = []
    for reynolds in SIZES:
        for row in grid(data, data["grid"]["shipped"], reynolds):
            cells = []
            for quantity in QUANTITIES:
                low, high = published(data, row)["envelope"][quantity]
                least, most = spread_of(data["grid"], reynolds, row["stage"], quantity)
                word = ("**below**", "inside", "**above**")[side(data, row, quantity) + 1]
                word += " (by less than 2 s.e.)" if near(data, row, quantity) else ""
                cells.append(f"{number(row, quantity)} [{least:.3g} … {most:.3g}], regressions {low:.3g} … {high:.3g}: {word}")
            rows.append([f"{reynolds}, {row['stage']:g}", *cells])
    return table(["R_p, T", "H (d)", "L (d)", "ū (u*)"], rows)


def over_speed(data: Record, name: str, reynolds: int) -> str:
    """By how many per cent the speeds lie above (−: below) the upper edge of the envelope."""
    rows = grid(data, name, reynolds)
    return span([100.0 * (row["velocity"]["mean"] / published(data, row)["envelope"]["velocity"][1] - 1.0) for row in rows])


def draw_envelope(found: Record) -> Any:
    """H, L and ū against T: regressions, the thesis's case, the spread by memories, some readings. Thesis figs 3-7 and 3-9."""
    figure, panels = plt.subplots(3, 2, figsize=(11.0, 10.0), sharex="col")
    for column, reynolds in enumerate(SIZES):
        lines = of(found["published"], particle_reynolds=reynolds)
        T = [row["stage"] for row in lines]
        for place, (quantity, label) in enumerate(AXES.items()):
            axes = panels[place, column]
            edges = np.array([r["envelope"][quantity] for r in lines])
            axes.fill_between(T, edges[:, 0], edges[:, 1], color="#d9d9d9", label="regressions: envelope")
            for name, (text, dash) in REGRESSIONS.items():
                axes.plot(T, [r["regressions"][name][place] for r in lines], dash, color="#666666", linewidth=1.0, label=text)
            least, most = zip(*(spread_of(found, reynolds, stage, quantity) for stage in T), strict=True)
            axes.fill_between(T, least, most, color=SKY, alpha=0.35, label="spread by memories and kernels")
            for name, (text, colour, marker) in READINGS.items():
                own = stages(found["records"], name=name, particle_reynolds=reynolds)
                axes.plot(T, [row[quantity]["mean"] for row in own], color=colour, marker=marker, linewidth=1.0, label=text)
            runs = stages(found["records"], name=found["shipped"], particle_reynolds=reynolds)
            errors(axes, runs, quantity, color=BLUE, marker="o", linewidth=2.0, label="the thesis's case: swamee, clip, rebound remembered (2 s.e.)")
            axes.set_ylabel(label)
            axes.set_yscale("log")
            axes.set_ylim(*axes.get_ylim())  # bars of single jumps reach below zero
            errors(axes, runs, quantity, "sd", color=BLUE, linestyle="none", elinewidth=0.8, capsize=0, label="its single jumps: 2 standard deviations")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.tick_params(axis="y", which="minor", labelsize=7)
        panels[0, column].set_title(f"R$_p$ = {reynolds}")
        panels[2, column].set_xlabel(STAGE)
    return finished(figure, panels[0, 0], 3, "Memories alone spread the model as widely as the regressions differ: only trends and the envelope can be tested")


def fields(found: Record) -> dict[str, Any]:
    """What the page says of it."""
    shipped, rough, bare = found["grid"]["shipped"], "swamee, clip, k_s = 2 d", "swamee, clip, no Magnus"
    ours, coarse = (grid(found, shipped, reynolds) for reynolds in SIZES)
    counts = {row["name"]: inside(found, row["name"]) for row in found["grid"]["records"] if row["kind"] in ("reading", "memory")}
    return {
        "figure_envelope": save(draw_envelope(found["grid"]), "saltation_envelope"),
        "inside": inside(found, shipped),
        "points": points(found),
        "variants": len(counts),
        "most_inside": max(counts.values()),
        "stages": stage_table(found),
        "readings": reading_table(found, "reading"),
        "memories": reading_table(found, "memory"),
        "below": span([100.0 * (1.0 - row["height"]["mean"] / published(found, row)["envelope"]["height"][0]) for row in ours]),
        "faster": over_speed(found, shipped, 250),
        "restarted_inside": inside(found, "Mei–Adrian: restarted", (73,)),
        "size_points": len(QUANTITIES) * len(ours),
        "base_inside": inside(found, shipped, (73,)),
        "bare_fast": over_speed(found, bare, 250),
        "rough_fast": over_speed(found, rough, 250),
        "bare_coarse": inside(found, bare, (250,)),
        "rough_coarse": inside(found, rough, (250,)),
        "coarse_points": len(QUANTITIES) * len(coarse),
        "base_coarse": inside(found, shipped, (250,)),
        "bare_inside": inside(found, bare, (73,)),
        "rough_inside": inside(found, rough, (73,)),
        "clipped": span([100.0 * row["clipped"] for row in (*ours, *coarse)]),
        "spread": span(spreads(found, 73), "{:.1f}"),
        "spread_coarse": span(spreads(found, 250), "{:.1f}"),
    }
