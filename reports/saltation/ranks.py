"""Which beds make a grain jump, and the thesis's runs, ranked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREY, ORANGE, PINK, RED
from bench.suites.saltation import ALIKE, PRINTED, RUN_A, UNIFORM
from reports.saltation.records import QUANTITIES, SIZES, STAGE, share
from reports.site.page import finished, save, table
from reports.words import Record, of, span

PRINTED_OVERLAP = {"A1": 53.98, "A2": 14.52, "A3": 48.72, "A4": 53.31}  # per cent, thesis Table 3-5
CREEP = 0.1  # d


def models(data: Record) -> list[Record]:
    """The campaign's models by mean rank: index, inside and rank for each R_p."""
    found: dict[str, Record] = {}
    for row in data["campaign"]["judged"]:
        found.setdefault(row["model"], {"model": row["model"], "mean_rank": row["mean_rank"]})[int(row["particle_reynolds"])] = row
    return sorted(found.values(), key=lambda model: known(model["mean_rank"]))


def known(score: float | None) -> float:
    """Infinite for what has none."""
    return math.inf if score is None else score


def best_at(data: Record, reynolds: int) -> str:
    """The model with the smallest error index at an R_p."""
    return str(min(models(data), key=lambda model: known(model[reynolds]["error_index"]))["model"])


def rank_table(data: Record, count: int = 10) -> str:
    """The best models."""
    ranked = models(data)
    chosen = ranked[:count] + [r for r in ranked[count:] if r["model"] == "G2"]
    rows = []
    for row in chosen:
        cells = [(f"{row[size]['error_index']:.2f}", share(row[size]["inside"]), f"{row[size]['rank']:.0f}") for size in SIZES]
        rows.append([str(ranked.index(row) + 1), row["model"], *chain(*cells)])
    return table(["", "model", *(f"R_p {reynolds}: {what}" for reynolds in SIZES for what in ("error index", "inside", "rank"))], rows)


def index_in(data: Record, reading: str, model: str, reynolds: int) -> float:
    """The error index of one of Run A's Sets in one of its readings."""
    (found,) = of(data["campaign"]["run_a"][reading]["judged"], model=model, particle_reynolds=reynolds)
    return float(found["error_index"])


def last_of(data: Record, reading: str) -> str:
    """Run A's worst Set at R_p 73."""
    return max(PRINTED_OVERLAP, key=lambda model: index_in(data, reading, model, 73))


def best_of(data: Record, reading: str) -> float:
    """The smallest error index of Run A at R_p 73."""
    return min(index_in(data, reading, model, 73) for model in PRINTED_OVERLAP)


def better_than(data: Record, reading: str) -> int:
    """How many of the models of Runs B to H have a smaller error index at R_p 73 than the best Set of Run A."""
    best = best_of(data, reading)
    return sum(known(row[73]["error_index"]) < best for row in models(data) if not row["model"].startswith("A"))


def run_a_table(data: Record) -> str:
    """Run A in each of its readings."""
    rows = [["overlap with the measurements, Table 3-5 (%)", *(f"{value:.0f}" for value in PRINTED_OVERLAP.values()), ""]]
    for reading, found in data["campaign"]["run_a"].items():
        cells = []
        for number, model in enumerate(PRINTED_OVERLAP, 1):
            (run,) = of(found["runs"], set=number, particle_reynolds=73.0, stage=1.87)
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


def two_of_r1(data: Record) -> dict[str, Any]:
    """Run A by both of the thesis's words for R1: how near it comes to the regressions, and how much Set 1 scatters, over the mean."""
    found: dict[str, Any] = {}
    for reading, name in ((PRINTED, "printed"), (UNIFORM, "uniform")):
        rows = of(data["campaign"]["run_a"][reading]["runs"], set=1, particle_reynolds=73.0)
        found[f"scatter_{name}"] = span([100.0 * r["height_sd"] / r["height"] for r in rows])
        found[f"best_{name}"] = f"{best_of(data, reading):.2f}"
        found[f"behind_{name}"] = better_than(data, reading)
    return found


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
    return finished(figure, axes, 3, f"{lifted}\nplanes uniform within ± 30° make large jumps and extremely small ones")


def draw_ranks(models: Sequence[Record]) -> Any:
    """The best models against the regressions. Thesis fig. 3-10."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.4))
    sets = {1: GREY, 2: BLUE, 3: ORANGE, 4: RED}
    scores = {f"error index, R$_p$ = {size}": {row["model"]: row[size]["error_index"] for row in models} for size in SIZES}
    scores["mean rank"] = {row["model"]: row["mean_rank"] for row in models}
    for axes, (label, found) in zip(panels, scores.items(), strict=True):
        best = sorted((name for name in found if found[name] is not None), key=lambda name, found=found: found[name])[:15]
        axes.barh(range(len(best)), [found[name] for name in best], color=[sets[int(name[1])] for name in best])
        axes.set_yticks(range(len(best)), best)
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
        stages, mean, sd = np.transpose(sorted((row["T"], row["mean"], row["sd"]) for row in of(rows, variable="height")))
        edges.append((mean - sd, mean + sd))
        label = f"Run {name[0]}, Set {name[1]}" + (" (in the place of measurements)" if hatch else "")
        axes.fill_between(stages, mean - sd, mean + sd, facecolor="none" if hatch else colour, edgecolor=colour, hatch=hatch, alpha=0.5, label=label)
        axes.plot(stages, mean, color=colour)
    low, high = np.maximum(edges[0][0], edges[1][0]), np.minimum(edges[0][1], edges[1][1])
    axes.fill_between(stages, low, np.maximum(high, low), color=BLACK, alpha=0.35, label="common area", linewidth=0.0)
    axes.set(xlabel=STAGE, ylabel="rise H (d), mean ± standard deviation", ylim=(0, None))
    return finished(figure, axes, 3, f"An overlap area: {found['areas']['height']:.0f} % of the first band (two of our own models, no measurement)")


def fields(found: Record) -> dict[str, Any]:
    """What the page says of them."""
    overlap = found["campaign"]["overlap"]
    measured, model = overlap["bands"]
    return {
        "figure_heights": save(draw_heights(found["heights"]), "saltation_heights"),
        "runs": len(found["campaign"]["runs"]),
        "unfinished": unfinished(found),
        "figure_ranks": save(draw_ranks(models(found)), "saltation_ranks"),
        "ranks": rank_table(found),
        "run_a": run_a_table(found),
        "own_last": last_of(found, PRINTED),
        "alike_last": last_of(found, ALIKE),
        "measured": measured,
        "model": model,
        "areas": ", ".join(f"{QUANTITIES[name]} {value:.0f} %" for name, value in overlap["areas"].items()),
        "figure_overlap": save(draw_overlap(overlap), "saltation_overlap"),
        **two_of_r1(found),
    }
