"""What does a grain among many cost?"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from bench.grains import changed, rounded
from saltation.flight import layout
from saltation.flight.cloud import Cloud, starts
from saltation.flight.collisions import UNTIL, Samples
from saltation.flight.setup import Engine, Grain, Start, empty_record
from saltation.scene import scene_of
from saltation.study.thesis import case

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

Content = dict[str, Any]


def cloud_of(number: int, concentration: float, without: tuple[str, ...] = ()) -> Content:
    """The thesis's cloud with so many grains."""
    return changed(case("sand_cloud"), without=without, cloud={"number": number, "concentration": concentration}, run={"trajectory": False})


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
        """One piece; the logs are thrown away. RuntimeError if the run stops."""
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


def run(full: bool) -> dict[str, Any]:
    """Measure."""
    rounds = 5 if full else 3
    return {"rounds": rounds, "scaling": scaling(full, rounds), "independent": rounded(independent(rounds))}
