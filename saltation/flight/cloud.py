"""Many grains before and during a run: where they start, and the loop around `collisions.advance`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from basset._compile import placed
from basset.kernels import Floats
from basset.solvers import stepper
from saltation.flight import collisions, contact, equations, layout
from saltation.flight.collisions import UNTIL, empty_grains
from saltation.flight.setup import DEFAULT_FIRST, NEVER, Engine, Grain, Start, empty_record
from saltation.scene import SceneError

SMALLEST_CELL = 2.0  # d
ROUNDS = 2000  # of placing grains that would overlap anew
COARSE = 1e3  # tolerance of a step between contacts that follow each other too closely
ROUNDED = 1.0 + 1e-12  # factor of a time, so that rounding leaves out no multiple of the interval
BUFFER = 4096  # rows of jumps and of encounters between two visits of the caller
GOES_ON = (layout.REST, layout.ALOFT, collisions.JUMPS_FULL, collisions.ENCOUNTERS_FULL)  # after which a run does


def starts(engine: Engine) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and spins (grain, 3) of a cloud that sets out: random, without overlap, a function of the seed."""
    scene = engine.scene
    cloud, (length, width, height), first = scene.grains, scene.box, engine.first()
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
    """A cloud during a run: all its grains as plain arrays, advanced as far as asked."""

    def __init__(self, engine: Engine, grains: range | None = None) -> None:
        """All grains, or some neighbouring ones: without encounters each flies as it would among all."""
        self.engine = engine
        engine.tables.fill_all()
        scene, d, members = engine.scene, engine.dimensions, engine.members
        self.grains = range(scene.grains.number) if grains is None else grains
        number, stages = len(self.grains), engine.tables.count
        self.state = empty_grains(number, engine.states, members, len(engine.rates), stages, engine.own)
        state = self.state
        for i, (position, velocity, spin) in enumerate(zip(*(values[self.grains.start : self.grains.stop] for values in starts(engine)), strict=True)):
            state.spin[i] = engine.own_of(spin, self.grains.start + i)
            state.y[i] = engine.state_of(Start(tuple(position), tuple(velocity), tuple(spin)), state.spin[i])
            contact.take_off(state.flight[i], 0.0, *position, *velocity)
        state.jump[:] = state.y[:, d : d + members]
        state.control[:] = stepper.start_control(0.0, max(DEFAULT_FIRST, 2.0 * engine.problem.floor), members > 0)
        state.control["refusals"] = NEVER
        state.spin[:, 3] = [equations.layer_of(engine.model, *up) for up in state.flight[["z", "w"]].tolist()]
        self.domain = self._domain() if "encounters" in scene.names else None
        cells = self.domain.along * self.domain.across if self.domain is not None else 0
        self.first_in_cell = np.full(cells, -1, dtype=np.int32)
        rows = max(BUFFER, number // 4)
        jumps, owners = np.zeros((rows, len(layout.COLUMNS))), np.zeros(rows, dtype=np.int32)
        self.logs = collisions.Logs(jumps, owners, np.zeros(BUFFER if self.domain is not None else 0, layout.ENCOUNTER), np.zeros(1, collisions.COUNT))
        loaded = Grain(engine)  # whose arrays the grains take in turn
        problem = engine.problem._replace(end=math.inf)
        given = (engine.limits, engine.bed_of(self.grains.start), engine.memory(), loaded.state, loaded.spin, loaded.flight, loaded.values)
        self.steps, self.kept = engine.steps(*given, empty_record(0, stages, engine.states), jumps, problem=problem)
        coarse = problem._replace(rtol=COARSE * problem.rtol, atol=COARSE * problem.atol)
        whole = self.steps.flight.parts
        rough, self.kept_too = engine.attempt(whole, coarse)
        self.parts = placed(collisions.Parts(self.steps, rough))
        states, velocities = (whole.work.polynomial, np.zeros_like(whole.work.polynomial)), np.zeros((2, stages, 3))
        self.courses = tuple(placed(collisions.Course(*arrays)) for arrays in zip(states, velocities, strict=True))
        self.given = placed(self.domain) if self.domain is not None else None, placed(state), self.first_in_cell

    def _domain(self) -> collisions.Domain:
        scene = self.engine.scene
        options, (length, width, _) = scene.options("encounters"), scene.box
        cell = max(SMALLEST_CELL, math.sqrt(length * width / scene.grains.number))
        along, across = max(1, int(length / cell)), 1 if scene.in_plane else max(1, int(width / cell))
        periodic = scene.grains.boundary == "periodic"
        ends = (length if periodic else math.inf, width if periodic and not scene.in_plane else math.inf)
        law = (options.restitution, options.friction, options.slowest, options.pile_up)
        return collisions.Domain(*ends, length / along, width / across, along, across, *law)

    def advance(self, until: float, samples: collisions.Samples) -> Iterator[tuple[int, Any]]:
        """Fly up to `until`: yields (code, grain) for every grain that leaves the run and (code, rows) when a log is full.

        The last is UNTIL, or what stopped the run. The logs are the caller's to empty.
        """
        count, domain = self.logs.count[0], self.domain
        log, samples = placed(self.logs), placed(samples)
        while True:
            code = collisions.advance(self.parts, *self.given, samples, log, self.courses, until)
            grain = int(count.grain)
            if code == UNTIL:
                collisions.flush(self.parts, *self.given[:2], samples, until * ROUNDED)
            elif code not in GOES_ON and domain is not None:  # no grain is behind the one that stopped the run
                collisions.flush(self.parts, *self.given[:2], samples, float(self.state.clock[grain]) * ROUNDED)
            yield code, grain
            if code not in GOES_ON:
                return

    def rest(self, grain: int, samples: collisions.Samples) -> None:
        """Let a grain that has left the run rest and come back to it."""
        state, row = self.state, slice(grain, grain + 1)
        own = stepper.State(state.y[grain], state.rate[grain], state.past[grain], state.jump[grain], state.diagonal[grain], state.control[row])
        self.engine.rest(self.grains.start + grain, own, state.spin[grain], state.flight[grain])
        state.clock[grain], state.kind[grain] = state.control[grain].time, collisions.FIND_STEP
        self.lie(grain, samples)

    def resting(self, time: float) -> Any:
        """The grains that lie at rest at a time."""
        return np.flatnonzero((self.state.kind == collisions.FIND_STEP) & (self.state.clock > time))

    def lie(self, grain: int, samples: collisions.Samples) -> None:
        """Samples of a grain at rest, up to when it sets out or as many as there is room for: its place, and no velocity."""
        state, d = self.state, self.engine.dimensions
        first = int(samples.first[0])
        last = min(first + len(samples.values), math.floor(state.clock[grain] / samples.interval) + 1)
        if state.sample[grain] < last:
            kept = samples.values[state.sample[grain] - first : last - first, grain]
            kept[:, :d], kept[:, d:] = state.y[grain, :d], 0.0
            state.sample[grain] = last

    def arrays(self) -> dict[str, Any]:
        """All arrays that change during a run."""
        return self.state._asdict() | {"first_in_cell": self.first_in_cell, "count": self.logs.count}

    def speed_of(self, grain: int) -> float:
        """Speed of a grain along the stream, V."""
        d = self.engine.dimensions
        y = self.state.y[grain]
        return float(y[d] + equations.stream_of(self.engine.model, y, self.state.spin[grain])[0])
