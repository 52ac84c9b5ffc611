"""The blind test of laws that are chosen by their ranges, and how far what is open reaches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREY, ORANGE, legend
from bench.grains import base
from bench.grains import changed as scene_with
from bench.suites.blind import CHOSEN, THESIS
from bench.suites.saltation import SCENES as SCENE_OF
from reports import blind
from reports.saltation.records import QUANTITIES, SIZES, ticks
from reports.site.page import save, table
from reports.words import Record, factor, of, span
from saltation.closures import outside
from saltation.scene import Scene, load, scene_of
from saltation.scene.conditions import conditions
from saltation.scene.valid import chosen, families

OPEN = {  # choices without a range: single changes of the blind test
    "velocity profile": ("channel.profile: yalin", "channel.profile: constant_b"),
    "roughness height 2 d": ("channel.roughness_height: 2 d",),
    "contact angles beyond 30°": ("bed.reading: reject", "bed.reading: spheres"),
    "e and f of a rough bed": ("bed: e = 0.8, f = 0.4", "bed: e = 0.95, f = 0.3"),
    "history restarted at an impact": ("history.rebound: restart",),
    "contact with the added mass": ("bed.contact_mass: immersed",),
    "Magnus as a vector": ("magnus.form: vector",),
    "added mass by Auton": ("added_mass.form: auton",),
}
LAWS_OF = {  # the same of a family of laws, by its table
    "drag": "law of drag",
    "lift": "law of lift",
    "history": "kernel of the history force",
    "magnus": "law of the Magnus force",
    "bed": "e and f of a rough bed",
}
SETTLED = {  # by measured rebounds
    "history wiped at an impact": ("history.rebound: reset",),
    "history that ignores an impact": ("history.rebound: none",),
    "e of a model that forgets": ("bed.restitution: 0.97 exp(−35/St)",),
}


def blind_sides(own: Record, name: str, reynolds: int, quantity: str) -> list[float]:
    """A mean over the nearest edge of the envelope, by stage; 1 inside."""
    found = []
    for row in blind.rows_of(own, name, 1):
        if row["particle_reynolds"] == reynolds:
            low, high = blind.edges(own, row)[blind.ENVELOPE[quantity]]
            mean = row[quantity]["mean"]
            found.append(mean / low if mean < low else mean / high if mean > high else 1.0)
    return found


def blind_table(own: Record) -> str:
    """How many stages lie inside, and how far out the others, with laws chosen by range and with the thesis's."""
    lines = []
    for reynolds in SIZES:
        for name in (CHOSEN, THESIS):
            cells = []
            for quantity in QUANTITIES:
                sides = blind_sides(own, name, reynolds, quantity)
                beyond = [value for value in sides if value != 1.0]
                words = f" ({span(beyond, '{:.2f}')} of the edge)" if beyond else ""
                cells.append(f"{len(sides) - len(beyond)} of {len(sides)}{words}")
            rows = [row["bed_load"] for row in blind.rows_of(own, name, 1) if row["particle_reynolds"] == reynolds]
            lines.append([str(reynolds), name, *cells, span([load["rate"] / load["wong_parker"] for load in rows], "{:.2g}")])
    return table(["R_p", "laws", *(f"{symbol} inside" for symbol in QUANTITIES.values()), "q* over Wong–Parker's"], lines)


def place(row: Record) -> tuple[int, float]:
    """Where a run is."""
    return row["particle_reynolds"], row["stage"]


def scene_at(row: Record) -> Scene:
    """The thesis's case where a run is."""
    return scene_of(scene_with(base(SCENE_OF[row["particle_reynolds"]], 1), channel={"transport_stage": row["stage"]}))


def choices_of(own: Record) -> dict[str, list[Record]]:
    """What is open -> runs with one change: choices without a range, and laws that hold as well as the one taken, or all where none holds."""
    found = changed_once(own, OPEN)
    for at in own["envelopes"]:
        scene = scene_at(at)
        met, taken = conditions(scene), chosen(scene)
        for family, closures in families(scene).items():
            own_law, any_holds = taken[family]
            table_name = family.partition(".")[0]
            for name, closure in closures.items():
                if name == own_law or (any_holds and outside(closure, met)):
                    continue
                rows = [row for row in blind.rows_of(own, f"{table_name}: {name}") if place(row) == place(at)]
                found.setdefault(LAWS_OF[table_name], []).extend(rows)
    return {title: rows for title, rows in found.items() if rows}


def changed_once(own: Record, choices: Mapping[str, Sequence[str]]) -> dict[str, list[Record]]:
    """Titles -> runs with one of the changes."""
    return {title: [row for name in names for row in blind.rows_of(own, name)] for title, names in choices.items()}


def reaches(own: Record, rows: Sequence[Record], reynolds: int, quantity: str = "height") -> list[float]:
    """Means over those of the blind test at the same stage; of runs that went to their end."""
    before = {place(row): row[quantity]["mean"] for row in blind.rows_of(own, CHOSEN, 1)}
    return [row[quantity]["mean"] / before[place(row)] for row in rows if row["particle_reynolds"] == reynolds and row["status"] == "finished"]


def farthest(own: Record, rows: Sequence[Record]) -> float:
    """The largest factor, up or down, by which a choice changes a mean height."""
    return max(max(value, 1.0 / value) for reynolds in SIZES for value in reaches(own, rows, reynolds))


def by_reach(own: Record) -> dict[str, list[Record]]:
    """What is open, what reaches farthest first."""
    return dict(sorted(choices_of(own).items(), key=lambda item: -farthest(own, item[1])))


def open_table(own: Record) -> str:
    """Values of each choice, and how far they reach."""
    lines = []
    for title, rows in by_reach(own).items():
        cells = [
            span(found, "{:.2f}") if (found := reaches(own, rows, reynolds, quantity)) else "–" for quantity in ("height", "velocity") for reynolds in SIZES
        ]
        values = list(dict.fromkeys(row["name"].partition(": ")[2] for row in rows))
        lines.append([title, "; ".join(values), *cells])
    head = [f"{QUANTITIES[quantity]} ×, R_p {reynolds}" for quantity in ("height", "velocity") for reynolds in SIZES]
    return table(["open", "instead", *head], lines)


def draw_open(own: Record) -> Any:
    """How far each open choice reaches, and what is settled would."""
    shown = list(by_reach(own).items())[::-1]
    rows = [*changed_once(own, SETTLED).items(), *shown]
    figure, axes = plt.subplots(figsize=(9.0, 0.42 * len(rows) + 1.6))
    for reynolds, colour, shift in ((73, BLUE, 0.17), (250, ORANGE, -0.17)):
        for place, (title, runs) in enumerate(rows):
            values = [1.0, *reaches(own, runs, reynolds)]
            look = {"color": GREY if title in SETTLED else colour, "linewidth": 6.0, "solid_capstyle": "butt"}
            axes.plot([min(values), max(values)], [place + shift] * 2, label=f"R$_p$ = {reynolds}" if place == len(rows) - 1 else None, **look)
    axes.axvline(1.0, color="#999999", linewidth=0.8)
    ticks(axes, (0.1, 0.2, 0.5, 1, 2, 5))
    axes.set_yticks(range(len(rows)), [title for title, _ in rows])
    axes.set(xlabel="H / H with the laws chosen by range, over all stages")
    axes.grid(visible=False, axis="y")
    figure.suptitle("How far the open choices reach, one at a time; what measured rebounds have settled (grey) is off the list")
    legend(figure, axes, 2)
    return figure


def fields(own: Record) -> dict[str, Any]:
    """What the page says of it; k, and e at the Stokes numbers of typical jumps at R_p 73."""
    (first, most), (second, next_) = list(by_reach(own).items())[:2]
    decay = load("sand").stokes_decay
    numbers = [conditions(scene_at(row))["St"] for row in of(own["envelopes"], particle_reynolds=73)]
    return {
        "blind": blind.opening(own),
        "first": first,
        "most": factor(farthest(own, most)),
        "second": second,
        "next": factor(farthest(own, next_)),
        "blind_table": blind_table(own),
        "too_low": span([1.0 / value for value in blind_sides(own, CHOSEN, 73, "height")], "{:.1f}"),
        "too_fast": f"{100.0 * (max(blind_sides(own, CHOSEN, 250, 'velocity')) - 1.0):.0f}",
        "decay": f"{decay:g}",
        "low_e": span([0.97 * math.exp(-decay / number) for number in numbers], "{:.2f}"),
        "figure_open": save(draw_open(own), "saltation_open"),
        "open_table": open_table(own),
        "stages_flown": len(own["envelopes"]),
    }
