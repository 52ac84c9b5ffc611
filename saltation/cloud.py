"""Many grains: where they set out, the loop around `encounters.advance`, and long runs in part files that go on after any stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from basset.kernels import Floats
from basset.solvers import _march
from saltation import encounters, flight
from saltation.encounters import PILE_UP, UNTIL, empty_crowd
from saltation.engine import DEFAULT_FIRST, Engine, Start, room
from saltation.flow import both
from saltation.scene import SceneError

SMALLEST_CELL = 2.0  # d
ROUNDS = 2000  # of placing grains that would overlap anew
COARSE = 1e3  # tolerance of a step between contacts that follow each other too closely
BUFFER = 4096  # rows of jumps and of encounters between two visits of the caller


def starts(engine: Engine) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and spins (grain, 3) of a cloud that sets out: random, without overlap, a function of the seed."""
    scene = engine.scene
    cloud, (length, width, height), first = scene.cloud, scene.box, engine.first()
    number = cloud.number
    rng = np.random.Generator(np.random.Philox(scene.run.seed))
    scale = np.array([length, 0.0 if scene.in_plane else width, height])
    lowest = np.array([0.0, 0.0, first.position[2]])
    places = lowest + scale * rng.random((number, 3))
    fold = np.array([length, width, 0.0]) if cloud.boundary == "periodic" and not scene.in_plane else np.array([length, 0.0, 0.0])
    if cloud.boundary == "open":
        fold[:] = 0.0
    for _ in range(ROUNDS):
        pairs = cKDTree(places, boxsize=fold).query_pairs(1.0 + 1e-9, output_type="ndarray")
        if not len(pairs):
            break
        again = np.unique(pairs.max(axis=1))
        places[again] = lowest + scale * rng.random((len(again), 3))
    else:
        raise SceneError(f"cloud.concentration = {cloud.concentration:g} is too high: no room for {number} grains that do not touch")
    velocities = np.array(first.velocity) + cloud.spread * rng.standard_normal((number, 3))
    if scene.in_plane:
        velocities[:, 1] = 0.0
    return places, velocities, np.tile(first.spin, (number, 1))


class Cloud:
    """A cloud under way: all its grains as plain arrays, advanced as far as asked."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        scene, d, members = engine.scene, engine.dimensions, engine.members
        number, stages = scene.cloud.number, engine.tables.count
        self.crowd = empty_crowd(number, engine.states, members, len(engine.rates), stages)
        crowd = self.crowd
        for i, (position, velocity, spin) in enumerate(zip(*starts(engine), strict=True)):
            crowd.y[i] = engine.state_of(Start(tuple(position), tuple(velocity), tuple(spin)))
            crowd.spin[i] = spin
            crowd.flight[i, [flight.X, flight.Y, flight.Z]] = position
            crowd.flight[i, flight.TOP] = position[2]
            crowd.flight[i, [flight.U, flight.V, flight.W]] = velocity
        crowd.jump[:] = crowd.y[:, d : d + members]
        crowd.numbers[:, [_march.STEP, _march.FIRST]] = DEFAULT_FIRST
        crowd.numbers[:, _march.SINGULAR] = float(members > 0)
        self.world = self._world() if "encounters" in scene.names else None
        cells = self.world.along * self.world.across if self.world is not None else 0
        self.heads = np.full(cells, -1, dtype=np.int32)
        self.parts = encounters.Parts(
            engine.model,
            engine.bed,
            engine.memory(),
            engine.limits,
            engine.problem._replace(end=math.inf),
            engine.tables.nodes,
            engine.tables.rise,
            engine.cut,
            engine.tables.tables,
            engine.prescribed,
            engine.problem._replace(end=math.inf, rtol=COARSE * engine.problem.rtol, atol=COARSE * engine.problem.atol),
        )
        self.jacobian, self.work, self.other = np.zeros((1, 1)), room(stages, engine.states, members), np.zeros((stages + 1, engine.states))
        shapes: tuple[Any, ...] = (1, 1, 1, 1, (1, engine.states), (1, stages, engine.states))
        self.record = flight.Record(*(np.zeros(shape) for shape in shapes))
        rows = max(BUFFER, number // 4)
        jumps, owners = np.zeros((rows, len(flight.COLUMNS))), np.zeros(rows, dtype=np.int32)
        self.logs = encounters.Logs(jumps, owners, np.zeros((BUFFER if self.world is not None else 0, len(encounters.COLUMNS))), np.zeros(4, dtype=np.int64))

    def _world(self) -> encounters.World:
        scene = self.engine.scene
        options, (length, width, _) = scene.options("encounters"), scene.box
        cell = max(SMALLEST_CELL, math.sqrt(length * width / scene.cloud.number))
        along, across = max(1, int(length / cell)), 1 if scene.in_plane else max(1, int(width / cell))
        periodic = scene.cloud.boundary == "periodic"
        ends = (length if periodic else math.inf, width if periodic and not scene.in_plane else math.inf)
        law = (options.restitution, options.friction, options.slowest, options.pile_up)
        return encounters.World(*ends, length / along, width / across, along, across, *law)

    def advance(self, until: float, samples: encounters.Samples) -> Iterator[tuple[int, Any]]:
        """Fly up to `until`: yields (code, grain) for every grain that leaves the run and (code, rows) when a log is full.

        The last is UNTIL, or what stopped the run. The logs are the caller's to empty.
        """
        tables, numbers, count = self.engine.tables, self.crowd.numbers, self.logs.count
        while True:
            code = encounters.advance(
                self.parts, self.world, self.crowd, self.heads, samples, self.logs, self.jacobian, self.work, self.other, self.record, until
            )  # fmt: skip
            grain = int(count[2])
            if code == _march.TABLE:
                tables.fill(float(numbers[grain, _march.STEP]), int(numbers[grain, _march.SLOT]), int(numbers[grain, _march.SINGULAR]))
                continue
            if code == UNTIL:
                encounters.flush(self.parts, self.crowd, samples, self.other, until)
            yield code, grain
            if code not in (flight.REST, flight.ALOFT, encounters.JUMPS_FULL, encounters.ENCOUNTERS_FULL):
                return

    def speed_of(self, grain: int) -> float:
        """Speed of a grain along the stream, V."""
        d = self.engine.dimensions
        y = self.crowd.y[grain]
        return float(y[d] + both(self.engine.profile, y[d - 1])[0])


