"""What do encounters change, how do grains spread, and how many jumps does a mean need (thesis chapter 4)?"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import saltation
from bench.grains import Task, changed, mean_of, rounded, run_all
from saltation import regressions, statistics
from saltation.results.result import Result
from saltation.scene import scene_of
from saltation.study import campaigns, grains, thesis
from saltation.workers import cores

DENSE = max(thesis.CONCENTRATIONS)
STAGE = 2.0  # T of figs 4-3, 4-17 and 4-18
SHOWN = 40.0  # d/u*: a short run whose pictures are drawn
SPREAD = "C2.33_R73_T2"  # the run of figs 4-17 and 4-18
SEEDS = tuple(range(1, 9))
SANDS = (73.0, 250.0)  # R_p of figs 4-4 and 4-5
ACROSS = (2.0, 20.0, 40.0)  # mean durations of a jump, at which the spreading across is shared out


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table, NumPy's numbers made Python's own."""
    return [rounded({key: value.item() if isinstance(value, np.generic) else value for key, value in row.items()}) for row in table.to_dict("records")]


def study(seeds: Sequence[int]) -> dict[str, Any]:
    """The 24 runs of Table 4-1 as anyone would run them, and all that is asked of them."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        table = campaigns.campaign(thesis.grains(), results=folder)
        seconds = time.perf_counter() - begin

        def opened(name: str) -> Result:
            result: Result = saltation.open(Path(folder) / f"{name}.nc")
            return result

        found = {name: records(frame) for name, frame in grains.analyses(table, opened).items()}
        found |= {"runs": records(table), "slow": records(slow(table, opened)), "moments": [moments(opened, meeting) for meeting in (True, False)]}
    found |= by_seeds(seeds)  # in place of the changes of one seed
    return {"seconds": seconds, "workers": cores(), **found, "clipped": [clipped(scatter) for scatter in (False, True)]}


def by_seeds(seeds: Sequence[int], workers: int | None = None) -> dict[str, Any]:
    """Table 4-2, what encounters change, and the shares in the spreading across, at R_p 73, with scatter across by the bed and without, from many seeds."""
    tasks, labels = {}, {}
    for scatter in (False, True):
        for own, scene in thesis.grains(seeds, scatter):
            spread = own["concentration"] == DENSE and own["stage"] == STAGE
            if own["particle_reynolds"] == 73.0 and (own["encounters"] or spread):
                tasks[own["name"]] = Task(scene.changed(run={"trajectory": spread}).model_dump(exclude_none=True), "met")
                labels[own["name"]] = own
        if scatter:  # the same with planes by the contact relation
            name = f"{SPREAD}_without_scatter_S{seeds[0]}"
            tasks["relation"] = Task(changed(tasks[name].scene, bed={"roughness": "R5"}), "met")
    rows = run_all(tasks, workers)
    relation = rows.pop("relation")["across"][:, -1].var()
    table = pd.DataFrame([labels[name] | row for name, row in rows.items()])
    parts = []
    for key, runs in table[table["encounters"]].groupby(["scatter", *grains.RUN], sort=False):
        own = dict(zip(["scatter", *grains.RUN], key, strict=True))
        left_out = round(float(runs["slow_frequency"].sum() * thesis.LASTING))
        parts.append(grains.distribution(pd.concat(list(runs["changes"]))).assign(**own, slow=left_out))
    of_seeds = table.drop(columns=["changes", "duration", "lag", "across", "name"])
    spread = across(table) | {"relation": rounded(relation)}
    return {"seeds": list(seeds), "by_seeds": records(grains.over_seeds(of_seeds)), "changes": records(pd.concat(parts)), "across": spread}


def across(table: pd.DataFrame) -> dict[str, Any]:
    """Second moments across the stream of the four ensembles, with bed and encounters or without, all seeds together, and the share of each source."""
    table = table[table["across"].notna()]
    members = {key: np.concatenate(list(runs["across"])) for key, runs in table.groupby(["scatter", "encounters"])}
    lag, duration = table["lag"].iloc[0], float(table.loc[~table["scatter"] & table["encounters"], "duration"].mean())
    places = [int(np.argmin(np.abs(lag - jumps * duration))) for jumps in ACROSS]
    shares = grains.shares_across({key: values[:, places] for key, values in members.items()}).assign(jumps=ACROSS, lag=lag[places])
    gammas, curves = [], []
    for (scatter, meeting), values in members.items():
        curves.append({"scatter": scatter, "encounters": meeting, "moment": rounded(values.var(axis=0))})
        low, high = (edge * duration for edge in grains.RANGES["intermediate"])
        gamma, interval = statistics.fit_exponent(lag, values.var(axis=0), low, high)[0], statistics.exponent_interval(lag, values, low, high)
        gammas.append({"scatter": scatter, "encounters": meeting, "gamma": gamma, "lower": interval[0], "upper": interval[1]})
    return {"duration": duration, "lag": rounded(lag), "curves": curves, "gammas": rounded(gammas), "shares": records(shares)}


def alone() -> dict[str, Any]:
    """A single grain on the bed of chapter 4: means of its first jumps (fig. 4-3), and its mean jumps beside the regressions (figs 4-4 and 4-5)."""
    first = grains.first_means(saltation.run(thesis.single_grain(73.0, STAGE)).jumps)
    rows = []
    for reynolds in SANDS:
        for stage in thesis.STAGES_OF_GRAINS:
            jumps = saltation.run(thesis.single_grain(reynolds, stage, 210, 10)).jumps
            published = {name: regression(reynolds, stage)._asdict() for name, regression in regressions.REGRESSIONS.items()}
            own = {name: mean_of(jumps[name].to_numpy()) for name in ("height", "length")}
            rows.append({"particle_reynolds": reynolds, "stage": stage, "jumps": len(jumps), **own, "regressions": rounded(published)})
    return {"first": records(first), "validation": rows}


def clipped(scatter: bool) -> dict[str, Any]:
    """How often the grains of the thesis's cloud meet when contact angles are clipped at 30°, with and without scatter across by the bed."""
    content = changed(thesis.case("sand_cloud"), bed={"roughness": "R7", "reading": "clip", "span_scatter": scatter}, run={"trajectory": False})
    return {"scatter": scatter, **saltation.run(scene_of(content)).frequencies()}


def slow(table: pd.DataFrame, opened: Any) -> pd.DataFrame:
    """Encounters per d/u* in which grains parted with the slowest speed, and steps that were not resolved."""
    rows = []
    for name in table.loc[table["encounters"], "name"]:
        result = opened(name)
        rows.append((name, float(grains.parted_slowly(result).sum() / result.time), result.provenance["unresolved_steps"]))
    return pd.DataFrame(rows, columns=["name", "slow", "unresolved"])


def moments(opened: Any, meeting: bool) -> dict[str, Any]:
    """Second moments from the first release and from all, of the run of figs 4-17 and 4-18."""
    result = opened(f"{SPREAD}_{'with' if meeting else 'without'}")
    row: dict[str, Any] = {"encounters": meeting, "duration": float(result.jumps["duration"].mean())}
    for name in ("first", "all"):
        lags, members, _ = grains.ensemble(result, name == "all")
        row[name] = {"lag": rounded(lags), **{axis: rounded(members[:, :, k].var(axis=0)) for k, axis in enumerate("xy")}}
    return row


def shown() -> dict[str, Any]:
    """A short run of the thesis's cloud, whole: for pictures."""
    content = changed(thesis.case("sand_cloud"), run={"discard": 5})
    content["run"]["duration"] = SHOWN * scene_of(content).numbers.time
    result = saltation.run(scene_of(content))
    path = result.trajectory
    tables = {"jumps": result.all_jumps, "encounters": result.encounters}
    kept = {name: {column: rounded(values.to_numpy(), 7) for column, values in frame.items()} for name, frame in tables.items()}
    axes = {name: [rounded(row, 7) for row in path[name].to_numpy()] for name in path.data_vars}
    return {"scene": content, **kept, "time": rounded(path["time"].to_numpy(), 9), "path": axes, "provenance": result.provenance, "end": result.time}


def run(full: bool) -> dict[str, Any]:
    """Measure."""
    return {"study": study(SEEDS if full else SEEDS[:4]), "single": alone(), "shown": shown()}
