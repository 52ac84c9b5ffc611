"""The page reports/saltation.md: where mean jumps lie, and what each law, effect and choice does to them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from bench.grains import base
from bench.grains import changed as scene_with
from bench.suites.blind import CHOSEN, THESIS
from bench.suites.saltation import ALIKE, PRINTED, RUN_A, UNIFORM
from bench.suites.saltation import SCENES as SCENE_OF
from reports import blind
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped, listed, signed, span
from saltation.closures import outside
from saltation.effects.drag import LAWS
from saltation.plots import run as plots
from saltation.scene import Scene, load, scene_of
from saltation.scene.conditions import conditions, settling_velocity
from saltation.scene.valid import chosen, families

SUITES = ("blind", "saltation")
QUANTITIES = {"height": "H", "length": "L", "velocity": "ū"}
SIZES = (73, 250)
SCENES = {"sand": "sand, R_p 73, T 1.87", "sand_coarse": "coarse sand, R_p 250, T 3.08", "gravel": "gravel, 30 mm, T 1.72"}
BARE = "no history"
REMEMBERING = ("remembered", "restarted", "Mei–Adrian: remembered", "Mei–Adrian: restarted", "Dorgan–Loth: remembered", "Dorgan–Loth: restarted")
IGNORING = ("jump ignored, 1 jump", "Mei–Adrian: jump ignored, 1 jump", "Dorgan–Loth: jump ignored, 1 jump")
SLIP_FORGOTTEN = ("wiped", *IGNORING)
PRESCRIBED = "Run A: spin prescribed (3-6)"
GROWING = ("Run A without Magnus", "Run G: spin computed (3-4)")  # whose Magnus force is none or follows the computed spin
PRINTED_OVERLAP = {"A1": 53.98, "A2": 14.52, "A3": 48.72, "A4": 53.31}  # per cent, thesis Table 3-5
CREEP = 0.1  # d
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
SAME = 1e-6  # differences in H, L and ū by rounding alone
KEPT_BY = 3.0  # standard errors within which the prototype's numbers have to lie


# Reading the records


def places(error: float) -> int:
    """Decimal places that show an error with its first digit, at most three."""
    return 2 if error <= 0.0 else min(3, max(0, math.ceil(-math.log10(error))))


def number(row: Record, key: str) -> str:
    """A mean with its standard error."""
    value = row[key]
    if value["mean"] is None:
        return "–"
    digits = places(value["se"] or 0.0)
    return f"{value['mean']:.{digits}f} ± {value['se'] or 0.0:.{digits}f}"


def share(value: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{100.0 * value:.{digits}f} %"


def ended(row: Record) -> str:
    """Empty for a run that went to its end, else how it ended."""
    return "" if row["status"] == "finished" else f" ({row['status']} after {row['jumps']} jumps)"


def percent(ratio: float) -> str:
    """A change as people say it."""
    return f"{signed(100.0 * (ratio - 1.0))} %" if ratio < 3.0 else f"× {factor(ratio)}"


def grid(data: Record, name: str, reynolds: int) -> list[Record]:
    """The runs of one variant at one R_p, by stage."""
    rows = [r for r in data["grid"]["records"] if r["name"] == name and r["particle_reynolds"] == reynolds]
    return sorted(rows, key=lambda r: r["stage"])


def published(data: Record, row: Record) -> Record:
    """What the regressions say where a run is."""
    return next(r for r in data["grid"]["published"] if r["particle_reynolds"] == row["particle_reynolds"] and r["stage"] == row["stage"])


def side(data: Record, row: Record, quantity: str) -> int:
    """−1 below the envelope, 0 inside, 1 above; a run without jumps lies below."""
    low, high = published(data, row)["envelope"][quantity]
    mean = row[quantity]["mean"]
    return -1 if mean is None or mean < low else 1 if mean > high else 0


def near(data: Record, row: Record, quantity: str) -> bool:
    """Whether a mean lies outside of the envelope by less than two standard errors."""
    low, high = published(data, row)["envelope"][quantity]
    reach = 2.0 * (row[quantity]["se"] or 0.0)
    return side(data, row, quantity) != 0 and row[quantity]["mean"] is not None and low - reach <= row[quantity]["mean"] <= high + reach


def inside(data: Record, name: str, sizes: Sequence[int] = SIZES) -> int:
    """How many means of a variant lie inside."""
    return sum(side(data, row, quantity) == 0 for reynolds in sizes for row in grid(data, name, reynolds) for quantity in QUANTITIES)


def points(data: Record) -> int:
    """How many means a variant has."""
    return len(QUANTITIES) * len(data["grid"]["published"])


def modification(data: Record, scene: str, name: str) -> Record:
    """One of the paired runs."""
    return next(r for r in data["effects"] if r["scene"] == scene and r["name"] == name)


def ratio(data: Record, scene: str, name: str, quantity: str = "height") -> float:
    """A modification's mean over the base's."""
    return float(modification(data, scene, name)[quantity]["mean"] / modification(data, scene, "base")[quantity]["mean"])


# The blind test, and what is open


def blind_opening(own: Record) -> dict[str, Any]:
    """What the blind test has come to."""
    rows, best = blind.rows_of(own, CHOSEN, 1), blind.single_changes(own)
    loads = [row["bed_load"]["rate"] / row["bed_load"]["wong_parker"] for row in rows]
    return {
        "inside": blind.count(rows),
        "thesis": blind.count(blind.rows_of(own, THESIS, 1)),
        "points": len(QUANTITIES) * len(rows),
        "load": f"{factor(min(loads))} to {factor(max(loads))}",
        "best": listed([f"“{name}”" for name, inside, _ in best if inside == best[0][1]]),
        "best_inside": best[0][1],
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


def stage_scene(reynolds: int, stage: float) -> Scene:
    """The thesis's case at a stage."""
    return scene_of(scene_with(base(SCENE_OF[reynolds], 1), channel={"transport_stage": stage}))


def blind_words(own: Record) -> dict[str, str]:
    """How far out the blind means lie; k, and e at the Stokes numbers of typical jumps at R_p 73."""
    decay = load("sand").stokes_decay
    numbers = [conditions(stage_scene(*_at(at)))["St"] for at in own["envelopes"] if at["particle_reynolds"] == 73]
    return {
        "too_low": span([1.0 / value for value in blind_sides(own, CHOSEN, 73, "height")], "{:.1f}"),
        "too_fast": f"{100.0 * (max(blind_sides(own, CHOSEN, 250, 'velocity')) - 1.0):.0f}",
        "decay": f"{decay:g}",
        "low_e": span([0.97 * math.exp(-decay / number) for number in numbers], "{:.2f}"),
    }


def choices_of(own: Record) -> dict[str, list[Record]]:
    """What is open -> runs with one change: choices without a range, and laws that hold as well as the one taken, or all where none holds."""
    found = {title: [row for name in names for row in blind.rows_of(own, name)] for title, names in OPEN.items()}
    for at in own["envelopes"]:
        scene = stage_scene(*_at(at))
        met, taken = conditions(scene), chosen(scene)
        for family, closures in families(scene).items():
            own_law, any_holds = taken[family]
            table_name = family.partition(".")[0]
            for name, closure in closures.items():
                if name == own_law or (any_holds and outside(closure, met)):
                    continue
                rows = [row for row in blind.rows_of(own, f"{table_name}: {name}") if (row["particle_reynolds"], row["stage"]) == _at(at)]
                found.setdefault(LAWS_OF[table_name], []).extend(rows)
    return {title: rows for title, rows in found.items() if rows}


def _at(row: Record) -> tuple[int, float]:
    return row["particle_reynolds"], row["stage"]


def settled(own: Record) -> dict[str, list[Record]]:
    """What measured rebounds have settled -> runs with it."""
    return {title: [row for name in names for row in blind.rows_of(own, name)] for title, names in SETTLED.items()}


def reaches(own: Record, rows: Sequence[Record], reynolds: int, quantity: str = "height") -> list[float]:
    """Means over those of the blind test at the same stage; of runs that went to their end."""
    before = {_at(row): row[quantity]["mean"] for row in blind.rows_of(own, CHOSEN, 1)}
    return [row[quantity]["mean"] / before[_at(row)] for row in rows if row["particle_reynolds"] == reynolds and row["status"] == "finished"]


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


def open_opening(own: Record) -> dict[str, str]:
    """The two choices that reach farthest."""
    (first, most), (second, next_) = list(by_reach(own).items())[:2]
    return {"first": first, "most": factor(farthest(own, most)), "second": second, "next": factor(farthest(own, next_))}


# Memories


def heights(data: Record, case: int) -> dict[str, float]:
    """Mean heights of one case by memory."""
    return {r["name"]: r["height"]["mean"] for r in data["memory"]["records"] if r["case"] == case}


def shortening(data: Record, reynolds: int, names: Sequence[str]) -> list[float]:
    """By how many per cent these memories shorten the jumps (negative: lengthen), in every case of an R_p."""
    found = []
    for case, about in enumerate(data["memory"]["cases"]):
        if about["particle_reynolds"] == reynolds:
            here = heights(data, case)
            found += [100.0 * (1.0 - here[name] / here[BARE]) for name in names]
    return found


def deviation(row: Record) -> float | None:
    """Difference from the prototype in standard errors of both."""
    if row["prototype"] is None:
        return None
    return float((row["height"]["mean"] - row["prototype"]) / math.hypot(row["height"]["se"], row["prototype_error"]))


def case_title(about: Record) -> str:
    """A case in words."""
    return f"R_p {about['particle_reynolds']}, T {about['stage']:g}, {about['reading']} + {about['profile'].capitalize()}"


def memory_table(data: Record) -> str:
    """Mean heights by memory, the prototype's beside them."""
    cases = data["memory"]["cases"]
    rows = []
    for name in dict.fromkeys(r["name"] for r in data["memory"]["records"]):
        cells = []
        for case in range(len(cases)):
            row = next(r for r in data["memory"]["records"] if r["case"] == case and r["name"] == name)
            apart = deviation(row)
            beside = "" if apart is None else f" ({row['prototype']:.2f}, {signed(apart, 1)})"
            cells.append(f"{number(row, 'height')}{beside}{ended(row)}")
        rows.append([name, *cells])
    return table(["treatment of the history force at an impact", *(case_title(about) for about in cases)], rows)


def growth(data: Record) -> dict[str, str]:
    """By which factor lengths grow, from the shortest to the longest run, where nothing is forgotten."""
    counts = sorted({r["counted"] for r in data["memory"]["growth"]})
    length = {(r["case"], r["counted"]): r["length"]["mean"] for r in data["memory"]["growth"]}
    drift = [length[case, counts[-1]] / length[case, counts[0]] for case in range(len(data["memory"]["cases"]))]
    return {"few_jumps": grouped(counts[0]), "many_jumps": grouped(counts[-1]), "drift": span(drift, "{:.1f}")}


# The envelope


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
    rows = [r for r in data["grid"]["records"] if r["particle_reynolds"] == reynolds and r["stage"] == stage]
    values = [r[quantity]["mean"] for r in rows if r["kind"] == "memory" or r["name"] == data["grid"]["shipped"]]
    return min(values), max(values)


def spreads(data: Record, reynolds: int) -> list[float]:
    """Largest over smallest mean height of the memories, by stage."""
    edges = [spread_of(data, reynolds, row["stage"], "height") for row in grid(data, data["grid"]["shipped"], reynolds)]
    return [most / least for least, most in edges]


def stage_table(data: Record) -> str:
    """The thesis's case at every stage: ours, the model's spread, the envelope."""
    rows = []
    for reynolds in SIZES:
        for row in grid(data, data["grid"]["shipped"], reynolds):
            cells = []
            for quantity in QUANTITIES:
                low, high = published(data, row)["envelope"][quantity]
                least, most = spread_of(data, reynolds, row["stage"], quantity)
                word = ("**below**", "inside", "**above**")[side(data, row, quantity) + 1]
                word += " (by less than 2 s.e.)" if near(data, row, quantity) else ""
                cells.append(f"{number(row, quantity)} [{least:.3g} … {most:.3g}], regressions {low:.3g} … {high:.3g}: {word}")
            rows.append([f"{reynolds}, {row['stage']:g}", *cells])
    return table(["R_p, T", "H (d)", "L (d)", "ū (u*)"], rows)


def over_speed(data: Record, name: str, reynolds: int) -> str:
    """By how many per cent the speeds lie above (−: below) the upper edge of the envelope."""
    rows = grid(data, name, reynolds)
    return span([100.0 * (row["velocity"]["mean"] / published(data, row)["envelope"]["velocity"][1] - 1.0) for row in rows])


def rises(data: Record, name: str, reynolds: int, quantity: str) -> bool:
    """Whether each stage's mean lies above that of the stage before."""
    means = [row[quantity]["mean"] for row in grid(data, name, reynolds)]
    return all(a is not None and b is not None and b > a for a, b in pairwise(means))


# Effects


def changed(data: Record, row: Record, quantity: str) -> str:
    """The change of one quantity by a modification."""
    change = row["change"][quantity]
    digits = places(change["se"])
    return f"{QUANTITIES[quantity]} {signed(change['mean'], digits)} ± {change['se']:.{digits}f} ({percent(ratio(data, row['scene'], row['name'], quantity))})"


def effect_table(data: Record, group: str) -> str:
    """Changes of H, L and ū of one group of modifications."""
    names = dict.fromkeys(r["name"] for r in data["effects"] if r["group"] == group)
    rows = []
    for name in names:
        cells = []
        for scene in SCENES:
            row = modification(data, scene, name)
            if row["status"] != "finished":
                cells.append(f"{row['status']} after {row['jumps']} jumps")
                continue
            cells.append(
                "; ".join(changed(data, row, quantity) for quantity in QUANTITIES)
                if any(abs(row["change"][q]["mean"]) > SAME for q in QUANTITIES)
                else "unchanged"
            )
        rows.append([name, *cells])
    bases = [", ".join(f"{symbol} {number(modification(data, scene, 'base'), quantity)}" for quantity, symbol in QUANTITIES.items()) for scene in SCENES]
    return table(["", *(f"{title}<br>({base})" for title, base in zip(SCENES.values(), bases, strict=True))], rows)


# Single jumps, spin, forces


def single_of(data: Record, figure: str, start: int) -> Record:
    """The single jumps of one figure of the thesis: start 0 the thesis's, 1 the mean takeoff."""
    return [r for r in data["single"] if r["figure"] == figure][start]


def prescribed(stage: float) -> float:
    """Thesis (3-6)."""
    return 5.11 - 1.13 * stage


def spin_offsets(data: Record, name: str) -> list[float]:
    """Mean spin over (3-6), minus one, at R_p 73."""
    return [row["spin"]["mean"] / prescribed(row["stage"]) - 1.0 for row in grid(data, name, 73)]


def spin_table(data: Record) -> str:
    """Spin, takeoff angle, deviation, impacts by stage."""
    rows = []
    for reynolds in SIZES:
        printed = grid(data, "torque without ρ/ρ_s", reynolds)
        for row, other in zip(grid(data, data["grid"]["shipped"], reynolds), printed, strict=True):
            law = f"{prescribed(row['stage']):.2f}" if reynolds == 73 else "–"
            cells = [number(row, "spin"), number(other, "spin"), law, number(row, "takeoff_angle"), number(row, "deviation")]
            low, high = row["stokes_range"]
            rows.append([f"{reynolds}, {row['stage']:g}", *cells, f"{low:.0f} … {high:.0f}", share(row["clipped"]), share(row["creeping"], 1)])
    head = [
        "R_p, T",
        "spin ω_y (u*/d)",
        "as printed",
        "(3-6)",
        "takeoff angle (°)",
        "deviation (°, absolute)",
        "St of impacts",
        "clipped at 30°",
        "creeping (H < 0.1 d)",
    ]
    return table(head, rows)


def forces(data: Record) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Shares of the forces over the phase, along and up."""
    frame = pd.DataFrame(data["forces"]["phase"])
    return plots.shares(frame, "x"), plots.shares(frame, "z")


def magnus_share(data: Record, law: str) -> dict[float, float]:
    """Mean absolute share of the Magnus force up, by stage."""
    return {r["stage"]: r["mean"] for r in data["magnus"] if r["law"] == law}


def saturation(data: Record, name: str) -> dict[float, float]:
    """Mean heights by stage of one of the runs of the saturation."""
    return {r["stage"]: r["height"]["mean"] for r in data["saturation"] if r["name"] == name}


def peak(data: Record, name: str) -> float | None:
    """The stage of the greatest height, None if that is the last one."""
    found = saturation(data, name)
    stage = max(found, key=lambda T: found[T])
    return None if stage == max(found) else stage


def exponent(data: Record, axis: str, where: str) -> str:
    """γ with its interval."""
    found = next(r for r in data["diffusion"]["exponents"] if r["axis"] == axis and r["range"] == where)
    low, high = found["interval"]
    return f"{found['gamma']:.2f}" if low is None else f"{found['gamma']:.2f} [{low:.2f}, {high:.2f}]"


# Bed load, campaign


def models(data: Record) -> list[Record]:
    """The campaign's models by mean rank: index, inside and rank for each R_p."""
    found: dict[str, Record] = {}
    for row in data["campaign"]["judged"]:
        found.setdefault(row["model"], {"model": row["model"], "mean_rank": row["mean_rank"]})[int(row["particle_reynolds"])] = row
    return sorted(found.values(), key=lambda r: math.inf if r["mean_rank"] is None else r["mean_rank"])


def place_of(data: Record, model: str) -> int:
    """Place of a model in the mean ranks, 1 the best."""
    return [r["model"] for r in models(data)].index(model) + 1


def best_at(data: Record, reynolds: int) -> str:
    """The model with the smallest error index at an R_p."""
    return str(min(models(data), key=lambda r: math.inf if r[reynolds]["error_index"] is None else r[reynolds]["error_index"])["model"])


def rank_table(data: Record, count: int = 10) -> str:
    """The best models."""
    ranked = models(data)
    chosen = ranked[:count] + [r for r in ranked[count:] if r["model"] == "G2"]
    rows = []
    for row in chosen:
        cells = []
        for reynolds in SIZES:
            found = row[reynolds]
            cells += [f"{found['error_index']:.2f}", share(found["inside"]), f"{found['rank']:.0f}"]
        rows.append([str(ranked.index(row) + 1), row["model"], *cells])
    return table(["", "model", *(f"R_p {reynolds}: {what}" for reynolds in SIZES for what in ("error index", "inside", "rank"))], rows)


def index_in(data: Record, reading: str, model: str, reynolds: int) -> float:
    """The error index of one of Run A's Sets in one of its readings."""
    return float(next(r["error_index"] for r in data["campaign"]["run_a"][reading]["judged"] if (r["model"], r["particle_reynolds"]) == (model, reynolds)))


def last_of(data: Record, reading: str) -> str:
    """Run A's worst Set at R_p 73."""
    return max(PRINTED_OVERLAP, key=lambda model: index_in(data, reading, model, 73))


def best_of(data: Record, reading: str) -> float:
    """The smallest error index of Run A at R_p 73."""
    return min(index_in(data, reading, model, 73) for model in PRINTED_OVERLAP)


def better_than(data: Record, reading: str) -> int:
    """How many of the models of Runs B to H have a smaller error index at R_p 73 than the best Set of Run A."""
    best = best_of(data, reading)
    return sum(row[73]["error_index"] < best for row in models(data) if not row["model"].startswith("A") and row[73]["error_index"] is not None)


def run_a_table(data: Record) -> str:
    """Run A in each of its readings."""
    rows = [["overlap with the measurements, Table 3-5 (%)", *(f"{value:.0f}" for value in PRINTED_OVERLAP.values()), ""]]
    for reading, found in data["campaign"]["run_a"].items():
        cells = []
        for number, model in enumerate(PRINTED_OVERLAP, 1):
            run = next(r for r in found["runs"] if (r["set"], r["particle_reynolds"], r["stage"]) == (number, 73.0, 1.87))
            cells.append(f"{index_in(data, reading, model, 73):.2f}; H {run['height']:.2f} ± {run['height_sd']:.2f}, {share(run['creeping'])} below {CREEP} d")
        rows.append([reading, *cells, f"{better_than(data, reading)} of 28"])
    return table(["R_p 73", *PRINTED_OVERLAP, "models of other Runs that are nearer than its best"], rows)


def slow_runs(data: Record, letters: str, reynolds: float, sets: Sequence[int] = (1, 2, 3, 4)) -> list[float]:
    """Mean heights of some runs of the campaign."""
    rows = [r for r in data["campaign"]["runs"] if r["run"] in letters and r["particle_reynolds"] == reynolds and r["set"] in sets]
    return [r["height"] for r in rows if r["height"] is not None]


def unfinished(data: Record) -> str:
    """Runs of the campaign that did not go to their end."""
    bad = [r for r in data["campaign"]["runs"] if r["status"] != "finished"]
    if not bad:
        return "All finished"
    words = ", ".join(f"{r['run']}{r['set']} at R_p {r['particle_reynolds']:g}, T {r['stage']:g}: {r['status']}" for r in bad)
    return f"{len(bad)} did not go to their end ({words})"


# Contradictions


def two_of_r1(data: Record) -> dict[str, Any]:
    """Run A by both of the thesis's words for R1: how near it comes to the regressions, and how much Set 1 scatters, over the mean."""
    found: dict[str, Any] = {}
    for reading, name in ((PRINTED, "printed"), (UNIFORM, "uniform")):
        rows = [r for r in data["campaign"]["run_a"][reading]["runs"] if r["set"] == 1 and r["particle_reynolds"] == 73.0]
        found[f"scatter_{name}"] = span([100.0 * r["height_sd"] / r["height"] for r in rows])
        found[f"best_{name}"] = f"{best_of(data, reading):.2f}"
        found[f"behind_{name}"] = better_than(data, reading)
    return found


def predictors() -> dict[str, str]:
    """By how many per cent Rubey's drag coefficient exceeds Yen's at Re 100, and his settling velocity falls short of Yen's at R_p 73."""
    rubey, yen = (LAWS[name].factor(100.0) for name in ("rubey", "yen"))
    sand = load("sand")
    slow, fast = (settling_velocity(sand.changed(drag={"law": name})) for name in ("rubey", "yen"))
    assert slow is not None and fast is not None
    return {"drag_apart": f"{100.0 * (rubey / yen - 1.0):.0f}", "fall_apart": f"{100.0 * (1.0 - slow / fast):.0f}"}


# The page


def claims(data: Record) -> str:
    """What the thesis found, and what is found here."""
    return table(["thesis", "here"], [*jump_claims(data), *campaign_claims(data), *force_claims(data)])


def jump_claims(data: Record) -> list[list[str]]:
    """On history, Magnus and single jumps."""
    sand, gravel = single_of(data, "3-6", 0)["paths"], single_of(data, "3-5", 0)["paths"]
    bare, forgotten = sand["no history"]["height"], sand["takeoff slip forgotten"]["height"]
    ignored = span([-x for x in shortening(data, 73, IGNORING)])
    remembered, reynolds = sand["all effects"]["height"], grouped(data["grid"]["gravel"]["reynolds"])
    return [
        [
            "Sand needs the Basset force, without it jumps are too short; gravel does not (figs 3-5, 3-6)",
            f"Sand: H {percent(ratio(data, 'sand', 'history'))} without history: it *shortens* jumps if rebounds are remembered and "
            f"lengthens them, by {ignored} % with a memory of one jump, only if the slip's jump at the rebound is ignored. "
            f"Gravel: H {percent(ratio(data, 'gravel', 'history'))}: agrees",
        ],
        [
            "(the same, one jump of sand)",
            f"H {bare:.2f} without history, {remembered:.2f} with the takeoff slip remembered, {forgotten:.2f} with it forgotten",
        ],
        [
            "Magnus does nothing visible to a gravel grain (fig. 3-5)",
            f"One jump: H {gravel['no Magnus']['height']:.2f} without, {gravel['all effects']['height']:.2f} with; in a run, where rebounds spin "
            f"the grain up, H × {1.0 / ratio(data, 'gravel', 'Magnus'):.0f}. The coefficient ¾ is that of creeping flow; here Re* = {reynolds}",
        ],
    ]


def campaign_claims(data: Record) -> list[list[str]]:
    """On the models, spin and angles."""
    sets = ", ".join(map(str, sorted({r["set"] for r in data["campaign"]["runs"]})))
    creeping = {run: row["creeping"] for run, row in data["heights"].items()}
    upstream, uniform = ([100.0 * value for run, value in creeping.items() if run.endswith(end)] for end in ("(3-5)", "±30°"))
    shipped = data["grid"]["shipped"]
    first, last = (grid(data, shipped, 73)[k] for k in (0, -1))
    takeoff, corrected = first["takeoff_angle"], max(map(abs, spin_offsets(data, shipped)))
    printed = span([-100.0 * x for x in spin_offsets(data, "torque without ρ/ρ_s")])
    winners = f"best for both {models(data)[0]['model']}, at R_p 73 {best_at(data, 73)}, at R_p 250 {best_at(data, 250)}"
    return [
        ["Runs B and C do not saltate", f"H at most {max(slow_runs(data, 'BC', 73.0)):.3f} d at R_p 73, Sets {sets}: agrees"],
        [
            "Runs A to C make either very large or extremely small jumps",
            f"B and C creep ({share(creeping['B'])} and {share(creeping['C'])} of the jumps below {CREEP} d). A by (3-5) does not "
            f"({span(upstream, '{:.1f}')} %); with planes uniform within ±30°, which the text ascribes to it, it does ({span(uniform)} %)",
        ],
        [
            "A2 comes last of Run A at R_p 73 (Table 3-5)",
            f"By the error index against the regressions {last_of(data, PRINTED)} does with each Set's own f, {last_of(data, ALIKE)} with 0.89 for all",
        ],
        [
            "G2 is the best model for both grains, D3 at R_p 73, D2 at R_p 250",
            f"Against the regressions, which are not what the thesis ranked by, G2 is number {place_of(data, 'G2')} of {len(models(data))}; {winners}",
        ],
        [
            "The computed spin agrees with Niño and García",
            f"Within {share(corrected)} of their regression (3-6) with ρ/ρ_s in the torque, {printed} % below it as printed",
        ],
        [
            "Takeoff angles are over-predicted",
            f"{takeoff['mean']:.0f}°, single jumps ± {takeoff['sd']:.0f}°, at T {first['stage']:g}; the measured points are not at hand",
        ],
        [
            "The deviation angle does not depend strongly on the flow",
            f"It falls from {first['deviation']['mean']:.1f}° at T {first['stage']:g} to {last['deviation']['mean']:.1f}° at T {last['stage']:g}, as ū grows",
        ],
    ]


def force_claims(data: Record) -> list[list[str]]:
    """On forces, saturation and spreading."""
    along, up = forces(data)
    top = len(up) // 2
    history, drag = along["history"], up["drag"]
    phase = pd.DataFrame(data["forces"]["phase"])
    peaks = {"drag": int(along["drag"].to_numpy().argmax()), "top": int(phase["z"].to_numpy().argmax())}
    place = {name: phase["phase"][at] for name, at in peaks.items()}
    turns = float(np.interp(0.0, -history.to_numpy(), phase["phase"]))
    remainder, lift = along["added_mass"], up["lift"]
    law, computed = magnus_share(data, "prescribed"), magnus_share(data, "yamamoto")
    low, high = min(law), max(law)
    last = [r["share"][-1] for r in data["magnus"] if r["law"] == "yamamoto"]
    crests = {name: peak(data, name) for name in dict.fromkeys(r["name"] for r in data["saturation"]) if name not in GROWING}
    falling = [T for name, T in crests.items() if T is not None and name.startswith("Run A without")]
    crest_words = f"H is greatest at T {crests[PRESCRIBED]:g} and falls beyond" if crests[PRESCRIBED] else "H rises to the last T"
    crest_words += f", without lift, history or added mass at T {span(falling, '{:g}')}" if len(falling) == 3 else ""
    rising = "it rises to the last T = 5: agrees" if all(peak(data, name) is None for name in GROWING) else "it has a peak, too"
    gamma = {(axis, where): exponent(data, axis, where) for axis in "xy" for where in ("local", "intermediate")}
    return [
        [
            "Along the stream drag leads, over 90 % at the top; history has over 50 % at both ends",
            f"Drag {along['drag'].max():.0f} % at most, at phase {place['drag']:.2f} where the top is at {place['top']:.2f}; "
            f"history {signed(history.iloc[0])} % first and {signed(history.iloc[-1])} % last: agrees in size, drag leads before the top",
        ],
        [
            "History along passes 0 at the top; the remainder of added mass has 10 % at takeoff and 40 % at the impact; lift is positive throughout",
            f"History passes 0 at phase {turns:.2f} and has {signed(history.iloc[peaks['top']])} % at the top; the remainder {signed(remainder.iloc[0])} % "
            f"first and {signed(remainder.iloc[-1])} % last; lift {signed(lift.iloc[0])} % first and {signed(lift.iloc[-1])} % last: differs in phase",
        ],
        [
            "Up, weight leads; drag 20, 0, 20 %; Magnus about 20 % on the way up",
            f"Weight {abs(up['weight'].iloc[top]):.0f} % at mid-jump; drag {', '.join(signed(drag.iloc[k]) for k in (0, top, -1))} %; "
            f"Magnus {up['magnus'].max():.0f} % at most: agrees",
        ],
        [
            "With (3-6) Magnus loses weight as T grows, with (3-4) it does not",
            f"{law[low]:.0f} % at T {low:g} and {law[high]:.0f} % at T {high:g}; {computed[low]:.0f} % and {computed[high]:.0f} %: agrees",
        ],
        [
            "With (3-4) Magnus turns negative near the bed before the impact",
            f"Its share in the last part of the flight is {span(last, '{:.1f}')} %, negative at the smaller T alone: at the larger the grain by then outruns "
            "the water, both factors turn over, and the force is positive again (the print's bars keep one sign)",
        ],
        [
            "Run A saturates with T, because of (3-6), with lift, history or added mass off, too",
            f"{crest_words}; without Magnus, or with computed spin, {rising}",
        ],
        [
            "Spreading is ballistic (γ ≈ 1) within a jump; then normal (0.5) along and faster across",
            f"Along {gamma['x', 'local']}, then {gamma['x', 'intermediate']}; across {gamma['y', 'local']}, then {gamma['y', 'intermediate']}: agrees",
        ],
    ]


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the sentences to take away."""
    found = data["saltation"]
    shipped = found["grid"]["shipped"]
    ours = grid(found, shipped, 73)
    below = [100.0 * (1.0 - row["height"]["mean"] / published(found, row)["envelope"]["height"][0]) for row in ours]
    counts = {r["name"]: inside(found, r["name"]) for r in found["grid"]["records"] if r["kind"] in ("reading", "memory")}
    return {
        "shorter": span(shortening(found, 73, REMEMBERING)),
        "shorter_coarse": span(shortening(found, 250, REMEMBERING)),
        "inside": inside(found, shipped),
        "points": points(found),
        "variants": len(counts),
        "most_inside": max(counts.values()),
        "below": span(below),
        "faster": over_speed(found, shipped, 250),
        "spread": span(spreads(found, 73), "{:.1f}"),
        "signs": f"{1.0 / ratio(found, 'sand', 'rebound 3-B letter by letter'):.1f}",
        "magnus": f"{1.0 / ratio(found, 'sand', 'Magnus'):.1f}",
        "magnus_gravel": f"{1.0 / ratio(found, 'gravel', 'Magnus'):.0f}",
    }


def saltation(data: dict[str, Record]) -> str:
    """The page reports/saltation.md."""
    found, own = data["saltation"], data["blind"]
    shipped = found["grid"]["shipped"]
    along, up = forces(found)
    clipped = [row["clipped"] for reynolds in SIZES for row in grid(found, shipped, reynolds)]
    loads = [row["bed_load"] for row in grid(found, shipped, 73)]
    rough, bare, restarted = "swamee, clip, k_s = 2 d", "swamee, clip, no Magnus", "Mei–Adrian: restarted"
    gravel = found["grid"]["gravel"]
    overlap = found["campaign"]["overlap"]
    measured, model = overlap["bands"]
    return fill(
        "saltation.md",
        found=found,
        gravel=gravel,
        **opening(data),
        blind=blind_opening(own),
        **open_opening(own),
        **blind_words(own),
        blind_table=blind_table(own),
        figure_open=save(draw_open(own), "saltation_open"),
        open_table=open_table(own),
        stages_flown=len(own["envelopes"]),
        claims=claims(found),
        figure_path=save(draw_path(found["forces"]["path"]), "saltation_path"),
        figure_memory=save(draw_memory(found["memory"], case_title), "saltation_memory"),
        memory=memory_table(found),
        agreed=f"{sum(abs(z) <= KEPT_BY for z in zs)} of {len(zs)}"
        if (zs := [z for r in found["memory"]["records"] if (z := deviation(r)) is not None])
        else "none",
        **growth(found),
        longer=span([-x for x in shortening(found, 73, SLIP_FORGOTTEN)]),
        longer_finite=span([-x for x in shortening(found, 73, IGNORING[1:])]),
        figure_envelope=save(draw_envelope(found["grid"]), "saltation_envelope"),
        stages=stage_table(found),
        readings=reading_table(found, "reading"),
        memories=reading_table(found, "memory"),
        figure_effects=save(draw_effects(found["effects"], SCENES), "saltation_effects"),
        off=effect_table(found, "off"),
        printed=effect_table(found, "printed"),
        choices=effect_table(found, "choice"),
        figure_single=save(draw_single(found["single"]), "saltation_single"),
        figure_angles=save(draw_angles(found["grid"]), "saltation_angles"),
        spin=spin_table(found),
        figure_heights=save(draw_heights(found["heights"]), "saltation_heights"),
        figure_forces=save(draw_forces(found["forces"]["phase"], along, up), "saltation_forces"),
        figure_shares=save(draw_quartiles(found["forces"]), "saltation_shares"),
        figure_magnus=save(draw_magnus(found["magnus"]), "saltation_magnus"),
        figure_saturation=save(draw_saturation(found["saturation"]), "saltation_saturation"),
        figure_diffusion=save(draw_diffusion(found["diffusion"]), "saltation_diffusion"),
        figure_load=save(draw_bed_load(found["grid"]), "saltation_bed_load"),
        over=span([load["rate"] / load["meyer_peter_mueller"] for load in loads], "{:.1f}"),
        over_wong=span([load["rate"] / load["wong_parker"] for load in loads], "{:.1f}"),
        friction=span([load["dynamic_friction"] for load in loads], "{:.2f}"),
        runs=len(found["campaign"]["runs"]),
        unfinished=unfinished(found),
        figure_ranks=save(draw_ranks(models(found)), "saltation_ranks"),
        ranks=rank_table(found),
        figure_overlap=save(draw_overlap(overlap), "saltation_overlap"),
        run_a=run_a_table(found),
        own_last=last_of(found, PRINTED),
        alike_last=last_of(found, ALIKE),
        **two_of_r1(found),
        **predictors(),
        measured=measured,
        model=model,
        areas=", ".join(f"{QUANTITIES[name]} {value:.0f} %" for name, value in overlap["areas"].items()),
        clipped=span([100.0 * share for share in clipped]),
        size_points=len(QUANTITIES) * len(grid(found, shipped, 73)),
        coarse_points=len(QUANTITIES) * len(grid(found, shipped, 250)),
        base_inside=inside(found, shipped, (73,)),
        base_coarse=inside(found, shipped, (250,)),
        restarted_inside=inside(found, restarted, (73,)),
        rough_coarse=inside(found, rough, (250,)),
        rough_inside=inside(found, rough, (73,)),
        bare_coarse=inside(found, bare, (250,)),
        bare_inside=inside(found, bare, (73,)),
        rough_fast=over_speed(found, rough, 250),
        bare_fast=over_speed(found, bare, 250),
        spread_coarse=span(spreads(found, 250), "{:.1f}"),
        gravel_height=f"{modification(found, 'gravel', 'base')['height']['mean']:.0f}",
        gravel_bare=f"{modification(found, 'gravel', 'Magnus')['height']['mean']:.1f}",
        gravel_regression=f"{gravel['regressions']['sklar_dietrich_2004'][0]:.1f}",
        footer=footer({name: data[name] for name in SUITES}),
    )


# Figures, from the records alone

AXES = {"height": "mean rise H (d)", "length": "mean length L (d)", "velocity": "mean velocity ū (u*)"}
REGRESSIONS = {"lee_hsu_1994": ("Lee–Hsu 1994", "--"), "sklar_dietrich_2004": ("Sklar–Dietrich 2004", "-."), "van_rijn_1984": ("van Rijn 1984", ":")}
READINGS = {  # shown beside the thesis's case: name in the records, label, colour, marker
    "swamee, reject": ("swamee, reject", ORANGE, "s"),
    "yalin, clip": ("yalin, clip", RED, "^"),
    "swamee, clip, k_s = 2 d": ("swamee, clip, k$_s$ = 2 d", GREEN, "v"),
    "Mei–Adrian: restarted": ("Mei–Adrian's kernel, memory restarted", PURPLE, "D"),
}
STAGE = "transport stage T"


def _ticks(axes: Any, values: Sequence[float]) -> None:
    """A logarithmic axis with labels at these places."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xticks([value for value in values if low <= value <= high], minor=False)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xticks([], minor=True)


def _errors(axes: Any, x: Sequence[float], rows: Sequence[Record], error: str = "se", **look: Any) -> None:
    """Means with two standard errors, or with two standard deviations of single jumps ("sd"); runs without jumps are left out."""
    shown = [(at, row) for at, row in zip(x, rows, strict=True) if row["mean"] is not None]
    axes.errorbar([at for at, _ in shown], [row["mean"] for _, row in shown], yerr=[2.0 * (row[error] or 0.0) for _, row in shown], **{"capsize": 2} | look)


def draw_open(own: Record) -> Any:
    """How far each open choice reaches, and what is settled would."""
    shown = list(by_reach(own).items())[::-1]
    rows = [*settled(own).items(), *shown]
    figure, axes = plt.subplots(figsize=(9.0, 0.42 * len(rows) + 1.6))
    for reynolds, colour, shift in ((73, BLUE, 0.17), (250, ORANGE, -0.17)):
        for place, (title, runs) in enumerate(rows):
            values = [1.0, *reaches(own, runs, reynolds)]
            look = {"color": GREY if title in SETTLED else colour, "linewidth": 6.0, "solid_capstyle": "butt"}
            axes.plot([min(values), max(values)], [place + shift] * 2, label=f"R$_p$ = {reynolds}" if place == len(rows) - 1 else None, **look)
    axes.axvline(1.0, color="#999999", linewidth=0.8)
    _ticks(axes, (0.1, 0.2, 0.5, 1, 2, 5))
    axes.set_yticks(range(len(rows)), [title for title, _ in rows])
    axes.set(xlabel="H / H with the laws chosen by range, over all stages")
    axes.grid(visible=False, axis="y")
    figure.suptitle("How far the open choices reach, one at a time; what measured rebounds have settled (grey) is off the list")
    _legend(figure, axes, 2)
    return figure


def draw_path(found: Record) -> Any:
    """Side view and plan of the first jumps of the thesis's case."""
    figure = plt.figure(figsize=(9.0, 5.2))
    arrays = {name: np.array(found[name]) for name in "xyz"}
    hits = [np.array(found["impacts"][name]) for name in "xzy"]
    plots.draw_path(figure, arrays["x"], arrays["z"], arrays["y"], hits, "x (d)")
    figure.suptitle("The first eight jumps of sand, the thesis's case: side view and plan (mind the stretched heights)")
    return figure


def draw_memory(found: Record, title: Callable[[Record], str]) -> Any:
    """Mean height by memory, the prototype's beside it."""
    names = [name for name in dict.fromkeys(r["name"] for r in found["records"]) if "Dorgan" not in name and "50" not in name and "20" not in name]
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.8), sharey=True)
    for case, (axes, about) in enumerate(zip(panels, found["cases"], strict=True)):
        rows = {r["name"]: r for r in found["records"] if r["case"] == case}
        for place, name in enumerate(reversed(names)):
            row = rows[name]
            colour = GREY if name == "no history" else RED if "ignored" in name or "wiped" in name else BLUE
            label = {GREY: "no history", RED: "the slip's jump is ignored", BLUE: "remembered or restarted"}[colour]
            axes.errorbar(row["height"]["mean"], place, xerr=2.0 * row["height"]["se"], fmt="o", color=colour, capsize=2, label=label)
            if row["prototype"] is not None:
                axes.plot(row["prototype"], place, "D", markersize=9, markerfacecolor="none", color=BLACK, label="prototype")
        axes.axvline(rows["no history"]["height"]["mean"], color="#999999", linestyle=":")
        axes.set(title=title(about).replace("R_p", "R$_p$"), xlabel="mean rise H (d), two standard errors")
        _ticks(axes, (0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20))
    panels[0].set_yticks(range(len(names)), list(reversed(names)))
    figure.suptitle("Remembering the rebound shortens the jumps, ignoring it lengthens them: measured rebounds reject that")
    handles, labels = panels[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=4)
    return figure


def draw_envelope(found: Record) -> Any:
    """H, L and ū against T: regressions, the thesis's case, the spread by memories, some readings. Thesis figs 3-7 and 3-9."""
    figure, panels = plt.subplots(3, 2, figsize=(11.0, 10.0), sharex="col")
    for column, reynolds in enumerate(SIZES):
        lines = [r for r in found["published"] if r["particle_reynolds"] == reynolds]
        stages = [r["stage"] for r in lines]
        rows = [r for r in found["records"] if r["particle_reynolds"] == reynolds]
        shipped = sorted((r for r in rows if r["name"] == found["shipped"]), key=lambda r: r["stage"])
        for place, (quantity, label) in enumerate(AXES.items()):
            axes = panels[place, column]
            edges = np.array([r["envelope"][quantity] for r in lines])
            axes.fill_between(stages, edges[:, 0], edges[:, 1], color="#d9d9d9", label="regressions: envelope")
            for name, (text, dash) in REGRESSIONS.items():
                axes.plot(stages, [r["regressions"][name][place] for r in lines], dash, color="#666666", linewidth=1.0, label=text)
            model = [
                [r[quantity]["mean"] for r in rows if r["stage"] == stage and (r["kind"] == "memory" or r["name"] == found["shipped"])] for stage in stages
            ]
            axes.fill_between(stages, [min(v) for v in model], [max(v) for v in model], color=SKY, alpha=0.35, label="spread by memories and kernels")
            for name, (text, colour, marker) in READINGS.items():
                own = sorted((r for r in rows if r["name"] == name), key=lambda r: r["stage"])
                axes.plot(stages, [r[quantity]["mean"] for r in own], color=colour, marker=marker, linewidth=1.0, label=text)
            means = [r[quantity] for r in shipped]
            _errors(axes, stages, means, color=BLUE, marker="o", linewidth=2.0, label="the thesis's case: swamee, clip, rebound remembered (2 s.e.)")
            axes.set_ylabel(label)
            axes.set_yscale("log")
            axes.set_ylim(*axes.get_ylim())  # bars of single jumps reach below zero
            _errors(axes, stages, means, "sd", color=BLUE, linestyle="none", elinewidth=0.8, capsize=0, label="its single jumps: 2 standard deviations")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.tick_params(axis="y", which="minor", labelsize=7)
        panels[0, column].set_title(f"R$_p$ = {reynolds}")
        panels[2, column].set_xlabel(STAGE)
    figure.suptitle("Memories alone spread the model as widely as the regressions differ: only trends and the envelope can be tested")
    _legend(figure, panels[0, 0], 3)
    return figure


def draw_effects(records: Sequence[Record], scenes: Mapping[str, str]) -> Any:
    """Every modification as a ratio to the base, H, L and ū."""
    modifications = list(dict.fromkeys((r["group"], r["name"]) for r in records if r["group"] != "base"))
    titles = {"off": "switched off", "printed": "as printed", "choice": "chosen otherwise"}
    looks = dict(zip(scenes, ((BLUE, "o"), (ORANGE, "s"), (GREY, "^")), strict=True))
    figure, panels = plt.subplots(1, 3, figsize=(13.0, 8.6), sharey=True)
    rows: list[tuple[str, str] | None] = []
    for group in titles:
        rows += [None, *(pair for pair in modifications if pair[0] == group)]
    rows = rows[::-1]
    for axes, (quantity, symbol) in zip(panels, QUANTITIES.items(), strict=True):
        for scene, (colour, marker) in looks.items():
            found = {r["name"]: r for r in records if r["scene"] == scene}
            points = [(place, found[pair[1]]) for place, pair in enumerate(rows) if pair is not None and found[pair[1]]["status"] == "finished"]
            base = found["base"][quantity]["mean"]
            ratio = [row[quantity]["mean"] / base for _, row in points]
            shift = 0.2 * (1 - list(looks).index(scene))
            axes.plot(
                ratio, [place + shift for place, _ in points], marker, color=colour, linestyle="none", markersize=6, label=scenes[scene].replace("R_p", "R$_p$")
            )
        axes.axvline(1.0, color="#999999", linewidth=0.8)
        axes.set(xlabel=f"{symbol} / {symbol} of the thesis's case")
        axes.set_ylim(-0.7, len(rows) - 0.3)
        _ticks(axes, (0.05, 0.1, 0.2, 0.5, 1, 2, 5) if quantity != "velocity" else (0.3, 0.5, 0.7, 1, 1.5))
    names = [f"— {titles[group]} —" for group in titles][::-1]
    labels = [names.pop(0) if pair is None else pair[1] for pair in rows]
    panels[0].set_yticks(range(len(rows)), labels)
    figure.suptitle("Magnus and what spins the grain, history and contact decide a jump; the form of drag and of added mass hardly matter to sand")
    _legend(figure, panels[0], 3)
    return figure


SINGLE = {
    "all effects": (BLACK, "-"),
    "no history": (RED, "-"),
    "takeoff slip forgotten": (RED, "--"),
    "no Magnus": (ORANGE, "-"),
    "no lift": (GREEN, "-"),
    "no added mass": (PINK, "-"),
    "weight and drag alone": (BLUE, "-"),
}


def draw_single(records: Sequence[Record]) -> Any:
    """Single jumps of thesis figs 3-5 and 3-6, effects off one by one."""
    figure, panels = plt.subplots(2, 2, figsize=(11.0, 7.6))
    for axes, found in zip(panels.ravel(), records, strict=True):
        for name, (colour, dash) in SINGLE.items():
            row = found["paths"][name]
            axes.plot(row["x"], row["z"], dash, color=colour, linewidth=2.2 if name == "all effects" else 1.3, label=name)
        takeoff, grain = found["takeoff"], "sand" if found["figure"] == "3-6" else "gravel"
        text = f"u = {takeoff['u']:.3g}, w = {takeoff['w']:.3g} u*, ω = {takeoff['spin']:.3g} u*/d"
        axes.set_title(
            f"{grain}, d = {1e3 * found['diameter']:.3g} mm, u* = {found['shear_velocity']:.3g} m/s (fig. {found['figure']})\ntakeoff {text}", fontsize=10
        )
        axes.set(xlabel="x (d)", ylabel="rise (d)", xlim=(0.0, None), ylim=(0.0, None))
    figure.suptitle("A single jump: what sand does depends on whether its takeoff is remembered; gravel's on the spin it starts with")
    _legend(figure, panels[0, 0], 4)
    return figure


def draw_angles(found: Record) -> Any:
    """Spin, takeoff angle and deviation against T, and the distribution of the deviation. Thesis figs 3-11 to 3-13."""
    figure, grid = plt.subplots(2, 2, figsize=(11.0, 7.6))
    panels = grid.ravel()
    looks = {73: (BLUE, "o"), 250: (ORANGE, "s")}
    for reynolds, (colour, marker) in looks.items():
        rows = sorted((r for r in found["records"] if r["name"] == found["shipped"] and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        printed = sorted((r for r in found["records"] if r["kind"] == "printed" and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        stages = [r["stage"] for r in rows]
        for axes, key in ((panels[0], "spin"), (panels[1], "takeoff_angle"), (panels[2], "deviation")):
            _errors(axes, stages, [r[key] for r in rows], color=colour, marker=marker, label=f"R$_p$ = {reynolds}")
        _errors(panels[0], stages, [r["spin"] for r in printed], color=colour, marker="x", linestyle=":", label=f"R$_p$ = {reynolds}, torque as printed")
        low, high = np.array([[r["takeoff_angle"]["mean"] - r["takeoff_angle"]["sd"], r["takeoff_angle"]["mean"] + r["takeoff_angle"]["sd"]] for r in rows]).T
        panels[1].fill_between(stages, low, high, color=colour, alpha=0.15, linewidth=0.0)
    stages = np.linspace(1.5, 2.9, 2)
    panels[0].plot(stages, 5.11 - 1.13 * stages, "--", color=BLACK, label="(3-6), measured at R$_p$ 60 to 90")
    panels[0].set(title="Spin falls with T as in the measured regression\nif the torque is divided by ρ$_s$/ρ", xlabel=STAGE, ylabel="mean spin ω$_y$ (u*/d)")
    panels[0].legend(loc="upper right")
    panels[1].set(
        title="Takeoff angles hardly change with T\n(band: standard deviation of single jumps)", xlabel=STAGE, ylabel="takeoff angle (degrees)", ylim=(0, 90)
    )
    panels[1].legend(loc="lower right")
    panels[2].set(title="The deviation in plan falls with T", xlabel=STAGE, ylabel="mean absolute deviation (degrees)", ylim=(0, None))
    panels[2].legend(loc="lower left")
    values = next(r["deviations"] for r in found["records"] if "deviations" in r)
    panels[3].plot(values, (np.arange(len(values)) + 0.5) / len(values), color=BLUE)
    panels[3].set(
        title="Its distribution at R$_p$ 73, T 1.87", xlabel="absolute deviation (degrees)", ylabel="share of jumps below", ylim=(0, 1), xlim=(0, None)
    )
    return figure


def draw_heights(found: Mapping[str, Record]) -> Any:
    """Distributions of H for Runs A, B, C and G."""
    figure, axes = plt.subplots(figsize=(8.0, 5.4))
    names = {name: f"A, {name}" for name in RUN_A} | {"B": "B: R2, plane ± 4° uniform", "C": "C: R3, plane ± 4° normal", "G": "G: R7, touching spheres"}
    looks = ((ORANGE, "-"), (BROWN, "-"), (ORANGE, "--"), (BROWN, "--"), (RED, "-"), (PINK, "--"), (BLUE, "-"))
    for (run, label), (colour, dash) in zip(names.items(), looks, strict=True):
        values = np.maximum(found[run]["heights"], 1e-6)
        axes.plot(values, (np.arange(len(values)) + 0.5) / len(values), dash, color=colour, label=label, linewidth=1.8)
    axes.axvline(0.1, color="#999999", linestyle=":")
    axes.annotate("H < 0.1 d: creeping", (0.1, 0.03), xytext=(-4, 0), textcoords="offset points", ha="right", color="#666666", fontsize=9)
    axes.set(xscale="log", xlabel="rise of a jump H (d)", ylabel="share of jumps below", xlim=(1e-4, 3.0), ylim=(0, 1))
    lifted = "Set 2, R$_p$ 73, T 1.87: touching spheres lift the grain, planes tilted by ± 4° do not;"
    axes.set_title(f"{lifted}\nplanes uniform within ± 30° make large jumps and extremely small ones")
    _legend(figure, axes, 3)
    return figure


def draw_forces(phase: Mapping[str, Sequence[float]], along: pd.DataFrame, up: pd.DataFrame) -> Any:
    """The mean jump and the shares of the forces over its phase. Thesis fig. 3-14."""
    figure = plt.figure(figsize=(8.0, 7.4))
    first, last = along["history"].iloc[0], abs(along["history"].iloc[-1])
    title = (
        f"Drag drives the jump along (up to {along['drag'].max():.0f} %), weight rules it up (up to {up['weight'].abs().max():.0f} %);\n"
        f"history counts at both ends (along {first:.0f} % after takeoff, {last:.0f} % against the motion before impact)"
    )
    plots.draw_budget(figure, pd.DataFrame(phase), title)
    return figure


def draw_quartiles(found: Record) -> Any:
    """Quartiles of each force's share over all jumps and phases. Thesis fig. 3-15."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.2), sharey=True)
    for axes, axis, where in ((panels[0], "x", "along the stream"), (panels[1], "z", "normal to the bed")):
        shown = {name: row for name, row in found[f"quartiles_{axis}"].items() if row[-1] > 0.0}
        stats = [
            {"whislo": r[0], "q1": r[1], "med": r[2], "q3": r[3], "whishi": r[4], "label": plots.FORCES[name][2].replace(" ", "\n")}
            for name, r in shown.items()
        ]
        drawn = axes.bxp(stats, showfliers=False, patch_artist=True, medianprops={"color": BLACK})
        for box, name in zip(drawn["boxes"], shown, strict=True):
            box.set(facecolor=plots.FORCES[name][0], alpha=0.5)
        axes.set_title(where)
    panels[0].set_ylabel("share of the forces, absolute (%)")
    figure.suptitle("Drag leads along, weight up; history comes second in both\n(over all jumps and phases; boxes: quartiles, whiskers: extremes)")
    return figure


def draw_magnus(records: Sequence[Record]) -> Any:
    """Share of the Magnus force up over the phase, for prescribed and computed spin. Thesis fig. 3-16."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.4), sharey=True)
    colours = (BLUE, GREEN, YELLOW, ORANGE, RED)
    for axes, law, title in (
        (panels[0], "prescribed", "spin prescribed by (3-6): fades, then turns over"),
        (panels[1], "yamamoto", "spin computed by (3-4): much the same at every T"),
    ):
        rows = sorted((r for r in records if r["law"] == law), key=lambda r: r["stage"])
        for row, colour in zip(rows, colours, strict=True):
            axes.plot(row["phase"], row["share"], color=colour, label=f"T = {row['stage']:g}")
        axes.axhline(0.0, color="#999999", linewidth=0.8)
        axes.set(title=title, xlabel="phase of the jump (0 takeoff, 1 impact)", xlim=(0, 1))
    panels[0].set_ylabel("Magnus force's share up (%)")
    _legend(figure, panels[0], 5)
    return figure


def draw_saturation(records: Sequence[Record]) -> Any:
    """Run A's saturation with T, effects off one by one. Thesis section 3.4.4."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 4.8))
    looks = {
        PRESCRIBED: {"color": ORANGE, "marker": "o", "linewidth": 2.0},
        "Run A with f = 0.89": {"color": BROWN, "marker": "s"},
        "Run A without Magnus": {"color": BLACK, "marker": "x"},
        "Run A without lift": {"color": GREY, "marker": "^", "linewidth": 0.8},
        "Run A without history": {"color": GREY, "marker": "v", "linewidth": 0.8},
        "Run A without added mass": {"color": GREY, "marker": "P", "linewidth": 0.8},
        "Run G: spin computed (3-4)": {"color": BLUE, "marker": "D"},
    }
    for axes, (quantity, label) in zip(panels, AXES.items(), strict=True):
        for name, look in looks.items():
            rows = sorted((r for r in records if r["name"] == name), key=lambda r: r["stage"])
            _errors(axes, [r["stage"] for r in rows], [r[quantity] for r in rows], label=name, markersize=5, **look)
        axes.set(xlabel=STAGE, ylabel=label)
        if quantity != "velocity":
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
    figure.suptitle("Run A stops growing with T because the prescribed spin turns Magnus over; with computed spin nothing saturates")
    _legend(figure, panels[0], 4)
    return figure


def draw_diffusion(found: Record) -> Any:
    """Second moments against the lag. Thesis fig. 3-17."""
    figure, axes = plt.subplots(figsize=(8.0, 5.0))
    lags = np.array(found["lag"])
    higher = max("xy", key=lambda name: float(np.log(found[name]).mean()))
    for name, (label, colour, marker) in plots.SPREAD.items():
        ranges = [(r["low"], r["high"]) for r in found["exponents"] if r["axis"] == name]
        plots.draw_moments(axes, lags, np.array(found[name]), label, colour, marker, ranges, name == higher)
    axes.axvline(found["duration"], color="#999999", linestyle=":")
    axes.annotate("mean duration of a jump", (found["duration"], axes.get_ylim()[0]), xytext=(4, 6), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel="time after a takeoff (d/u*)", ylabel="second moment of the displacement (d²)")
    axes.set_title("Nearly ballistic within a jump, about normal along the stream and faster across after many")
    axes.legend(loc="upper left")
    return figure


def draw_bed_load(found: Record) -> Any:
    """The bed-load rate that the impacts imply."""
    figure, axes = plt.subplots(figsize=(7.0, 4.6))
    for reynolds, colour, marker in ((73, BLUE, "o"), (250, ORANGE, "s")):
        rows = sorted((r for r in found["records"] if r["name"] == found["shipped"] and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        stages = [r["stage"] for r in rows]
        axes.plot(stages, [r["bed_load"]["rate"] for r in rows], color=colour, marker=marker, label=f"this model, R$_p$ = {reynolds}")
        axes.plot(stages, [r["bed_load"]["meyer_peter_mueller"] for r in rows], "--", color=colour, label=f"Meyer-Peter–Müller, R$_p$ = {reynolds}")
        axes.plot(stages, [r["bed_load"]["wong_parker"] for r in rows], ":", color=colour, label=f"Wong–Parker, R$_p$ = {reynolds}")
    axes.set(yscale="log", xlabel=STAGE, ylabel="bed load q* = q/√(R g d³)")
    axes.set_title("Bagnold's balance with these impacts carries several times too much")
    _legend(figure, axes, 2)
    return figure


def draw_ranks(models: Sequence[Record]) -> Any:
    """The best models against the regressions. Thesis fig. 3-10."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.4))
    sets = {1: GREY, 2: BLUE, 3: ORANGE, 4: RED}
    scores: list[tuple[str, Callable[[Record], Any]]] = [
        (f"error index, R$_p$ = {reynolds}", lambda r, key=reynolds: r[key]["error_index"]) for reynolds in SIZES
    ]
    scores.append(("mean rank", lambda r: r["mean_rank"]))
    for axes, (label, score) in zip(panels, scores, strict=True):
        best = sorted((r for r in models if score(r) is not None), key=score)[:15]
        axes.barh(range(len(best)), [score(r) for r in best], color=[sets[int(r["model"][1])] for r in best])
        axes.set_yticks(range(len(best)), [r["model"] for r in best])
        axes.invert_yaxis()
        axes.set_axisbelow(True)
        axes.set(xlabel=label)
        axes.grid(visible=False, axis="y")
    handles = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in sets.values()]
    figure.legend(handles, [f"Set {number}" for number in sets], loc="outside lower center", ncols=4)
    figure.suptitle("The best 15 of 32 models against the mean of the regressions: other models win at each grain size")
    return figure


def draw_overlap(found: Record) -> Any:
    """How an overlap area is made, on two models of ours. Thesis fig. 3-8."""
    figure, axes = plt.subplots(figsize=(7.0, 4.4))
    edges = []
    for (name, rows), colour, hatch in zip(found["bands"].items(), (BROWN, BLUE), ("//", None), strict=True):
        band = sorted((r for r in rows if r["variable"] == "height"), key=lambda r: r["T"])
        stages = np.array([r["T"] for r in band])
        mean, sd = np.array([r["mean"] for r in band]), np.array([r["sd"] for r in band])
        edges.append((mean - sd, mean + sd))
        label = f"Run {name[0]}, Set {name[1]}" + (" (in the place of measurements)" if hatch else "")
        axes.fill_between(stages, mean - sd, mean + sd, facecolor="none" if hatch else colour, edgecolor=colour, hatch=hatch, alpha=0.5, label=label)
        axes.plot(stages, mean, color=colour)
    low, high = np.maximum(edges[0][0], edges[1][0]), np.minimum(edges[0][1], edges[1][1])
    axes.fill_between(stages, low, np.maximum(high, low), color=BLACK, alpha=0.35, label="common area", linewidth=0.0)
    axes.set(xlabel=STAGE, ylabel="rise H (d), mean ± standard deviation", ylim=(0, None))
    axes.set_title(f"An overlap area: {found['areas']['height']:.0f} % of the first band (two of our own models, no measurement)")
    _legend(figure, axes, 3)
    return figure


PAGE = Page("saltation", saltation, SUITES)
