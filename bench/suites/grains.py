"""What does a grain among many cost, and what do encounters change?"""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import saltation
from bench.grains import changed, rounded
from saltation.flight import layout
from saltation.flight.cloud import Cloud, starts
from saltation.flight.collisions import UNTIL, Samples
from saltation.flight.setup import Engine, Grain, Start, empty_record
from saltation.results.result import Result
from saltation.scene import read, scene_of, shipped
from saltation.study import campaigns, grains, thesis
from saltation.workers import cores

NUMBERS = (1, 10, 100, 1000, 10000)
MANY = 100000
CONCENTRATIONS = (0.0013, 0.0233)
LARGE = ("encounters, history", "no encounters, history")  # forms that are flown with so many
SETTLED = 4.0  # d/u* before anything is timed
STRETCH = 2000.0  # grains × d/u* in one timed piece
FORMS: dict[str, tuple[str, ...]] = {
    "encounters, history": (),
    "encounters, no history": ("history",),
    "no encounters, history": ("encounters",),
    "no encounters, no history": ("encounters", "history"),
}

SHOWN = 40.0  # d/u*: a short run whose pictures are drawn
SPREAD = "C2.33_R73_T2"  # the run of figs 4-17 and 4-18

Content = dict[str, Any]


def cloud_of(number: int, concentration: float, without: tuple[str, ...] = ()) -> Content:
    """The shipped cloud with so many grains."""
    return changed(read(shipped()["sand_cloud"]), without=without, cloud={"number": number, "concentration": concentration}, run={"trajectory": False})


class Timed:
    """A cloud that flies piece by piece, timed."""

    def __init__(self, content: Content) -> None:
        self.scene = scene_of(content)
        self.engine = Engine(self.scene)
        self.cloud = Cloud(self.engine)
        self.number = self.scene.cloud.number
        self.clock, self.best = 0.0, math.inf
        none = np.zeros((0, self.number, 2 * self.engine.dimensions))
        self.samples = Samples(self.scene.cloud.interval, np.zeros(1, dtype=np.int64), none)

    def fly(self, grain_time: float) -> None:
        """One piece; the logs are thrown away.

        Raises
        ------
        RuntimeError
            If the run stops.
        """
        span = grain_time / self.number
        begin = time.perf_counter()
        code = UNTIL
        for code, _ in self.cloud.advance(self.clock + span, self.samples):  # noqa: B007 - the last one counts
            self.cloud.logs.count[0].jumps = self.cloud.logs.count[0].encounters = 0
        taken = time.perf_counter() - begin
        if code != UNTIL:
            raise RuntimeError(f"the run ended with {code}")
        self.clock += span
        self.best = min(self.best, taken / (span * self.number))

    @property
    def bytes(self) -> float:
        """Memory per grain."""
        return float(sum(array.nbytes for array in (*self.cloud.state, self.cloud.first_in_cell)) / self.number)


def scaling(full: bool, rounds: int) -> list[dict[str, Any]]:
    """Seconds per grain and unit time against the number of grains; the numbers of one form take turns."""
    rows = []
    for concentration in CONCENTRATIONS:
        for form, without in FORMS.items():
            many = full and form in LARGE
            numbers = [n for n in (*NUMBERS, *((MANY,) if many else ())) if n >= smallest(concentration, without)]
            timed = {n: Timed(cloud_of(n, concentration, without)) for n in numbers}
            Timed(cloud_of(1000, concentration, without)).fly(10.0 * STRETCH)  # compiles, and fills the tables that all share
            for own in timed.values():
                own.fly(SETTLED * own.number)  # past the first jumps, which all do at once
                own.best = math.inf
            for _ in range(rounds):
                for own in timed.values():
                    own.fly(max(STRETCH, 0.25 * own.number))
            for number, own in timed.items():
                steps = float(own.cloud.state.control["steps"].sum() / (own.clock * number))
                rows.append({"form": form, "concentration": concentration, "number": number, "seconds": own.best, "bytes": own.bytes, "steps": steps})
    return rows


def smallest(concentration: float, without: tuple[str, ...]) -> int:
    """The fewest grains that fill a box that is wide enough for encounters."""
    if "encounters" in without:
        return 1
    return next(n for n in NUMBERS if math.sqrt(n * math.pi / 6.0 / (2.0 * concentration)) >= 12.0)


def independent(rounds: int, number: int = 300, until: float = 10.0) -> dict[str, Any]:
    """A cloud without encounters beside the same grains flown one by one, taking turns; whether their jumps are the same bits."""
    engine = Engine(scene_of(cloud_of(number, CONCENTRATIONS[0], ("encounters",))))
    best = {"cloud": math.inf, "one by one": math.inf}
    for _ in range(rounds + 1):  # the first compiles
        cloud = Cloud(engine)
        rows: list[Any] = []
        begin = time.perf_counter()
        none = Samples(engine.scene.cloud.interval, np.zeros(1, dtype=np.int64), np.zeros((0, number, 6)))
        for _ in cloud.advance(until, none):
            jumps = int(cloud.logs.count[0].jumps)
            rows.append(np.column_stack([cloud.logs.owners[:jumps], cloud.logs.jumps[:jumps]]))
            cloud.logs.count[0].jumps = cloud.logs.count[0].encounters = 0
        best["cloud"] = min(best["cloud"], time.perf_counter() - begin)
        together = np.concatenate(rows)
        single_grains = [Grain(engine, i, Start(*map(tuple, start))) for i, start in enumerate(zip(*starts(engine), strict=True))]
        record, table = empty_record(1, engine.tables.count, engine.states), np.zeros((1000, len(layout.COLUMNS)))
        alone = []
        taken = 0.0
        for i, grain in enumerate(single_grains):
            grain.memory = grain.memory._replace(horizon=until)  # comes back after the step that passes it
            grain.flight[0].done = 0
            begin = time.perf_counter()
            grain.fly(record, False, table)
            taken += time.perf_counter() - begin
            jumps = grain.flight[0].done
            alone.append(np.column_stack([np.full(jumps, i), table[:jumps]]))
        best["one by one"] = min(best["one by one"], taken)
    single = np.concatenate(alone)
    done = [rows[rows[:, 1] + rows[:, 8] < until - 1.0] for rows in (together, single)]
    return {"number": number, "ratio": best["cloud"] / best["one by one"], "same": bool(np.array_equal(*done)), "jumps": len(done[0])}


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table, NumPy's numbers made Python's own."""
    return [rounded({key: value.item() if isinstance(value, np.generic) else value for key, value in row.items()}) for row in table.to_dict("records")]


def study() -> dict[str, Any]:
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
    return {"seconds": seconds, "workers": cores(), **found, "clipped": [clipped(scatter) for scatter in (False, True)]}


def clipped(scatter: bool) -> dict[str, Any]:
    """How often the grains of the shipped cloud meet when contact angles are clipped at 30°, with and without scatter across by the bed."""
    content = changed(read(shipped()["sand_cloud"]), bed={"roughness": "R7", "reading": "clip", "span_scatter": scatter}, run={"trajectory": False})
    return {"scatter": scatter, **saltation.run(scene_of(content)).frequencies()}


def slow(table: pd.DataFrame, opened: Any) -> pd.DataFrame:
    """Encounters per d/u* in which grains parted with the slowest speed, and steps that were not resolved."""
    rows = []
    for name in table.loc[table["encounters"], "name"]:
        result = opened(name)
        e = result.scene.options("encounters").restitution
        rows.append((name, float((result.encounters["restitution"] > e).sum() / result.time), result.provenance["unresolved_steps"]))
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
    """A short run of the shipped cloud, whole: for pictures."""
    content = changed(read(shipped()["sand_cloud"]), run={"discard": 5})
    content["run"]["duration"] = SHOWN * scene_of(content).numbers.time
    result = saltation.run(scene_of(content))
    path = result.trajectory
    tables = {"jumps": result.all_jumps, "encounters": result.encounters}
    kept = {name: {column: rounded(values.to_numpy(), 7) for column, values in frame.items()} for name, frame in tables.items()}
    axes = {name: [rounded(row, 7) for row in path[name].to_numpy()] for name in path.data_vars}
    return {"scene": content, **kept, "time": rounded(path["time"].to_numpy(), 9), "path": axes, "provenance": result.provenance, "end": result.time}


def run(full: bool) -> dict[str, Any]:
    """Measure."""
    rounds = 5 if full else 3
    return {"rounds": rounds, "scaling": scaling(full, rounds), "independent": rounded(independent(rounds)), "study": study(), "shown": shown()}
