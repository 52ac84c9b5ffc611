"""Scene -> Result: fly one grain, keep its jumps and its path, and say how the result came about."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from basset.kernels import BassetKernel, Floats
from basset.solvers import stepper
from basset.solvers._tables import step_tables
from saltation._keys import key_of
from saltation.flight import loop as flight
from saltation.flight.setup import Engine, Grain
from saltation.results.result import Result
from saltation.scene import AUTO, LONGEST, scene_of
from saltation.workers import Here

__all__ = ["run"]

CHUNK = 4096  # steps between two visits of the caller
STILL = 5.0  # jumps without flight in a row at the end of a run, or all of them: the grain lies still
RENEWED = 16  # the same without a bed
MOST_KEPT = 2**16  # steps of a path without jumps; of a longer one every second, every fourth, … is kept
WIDER = 1e3  # so much farther reaches the memory that takes over, where nothing jumps any more
GROWTH = 64.0  # of a memory that was too short, at most
SLIDING = 1e-3  # u*: a grain at the bed that is faster creeps, a slower one lies still
STATUS = {
    flight.JUMPS: ("finished", "all jumps are done"),
    stepper.END: ("finished", "the time is over"),
    flight.REST: ("at rest", "the grain lies still: impacts follow each other without flight"),
    flight.ALOFT: ("aloft", "a flight exceeded run.longest_flight: the grain does not come down in that time"),
    flight.HORIZON: ("horizon", "the run outlasted history.horizon: leave it out, and the memory follows the flights, or set it longer"),
    stepper.TOO_SMALL: ("failed", "the step size fell below its floor: the accuracy asked for cannot be had"),
    stepper.NOT_FINITE: ("failed", "a rate was not finite, or the stages did not converge"),
    stepper.TOO_MANY: ("failed", "too many steps"),
}


def run(scene: Any, progress: Callable[[float], None] | None = None, output: str | os.PathLike[str] | None = None, executor: Executor | None = None) -> Any:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
        From `saltation.load` or `saltation.Scene.model_validate`. With effects = "auto" they are first chosen by
        `saltation.study.effects.choose`, for a [cloud] over the executor, else here; `result.scene.chosen` holds the evidence.
    progress : callable or None
        Called with the share that is done, 0 to 1 (dimensionless).
    output : path, optional
        For a [cloud] only: a folder, made if missing, to which the run writes numbered parts as it goes, so that its memory does
        not grow. Stopped in any way, the same call goes on from the last part and comes to the same bits.
    executor : concurrent.futures.Executor, optional
        For a [cloud] only, and without output: grains that do not meet fly in blocks over its workers, grains that do as one
        task; the same bits as here.

    Returns
    -------
    Result, or CloudResult for a scene with a [cloud]
        With a status: finished, at rest, creeping, aloft, horizon or failed, and all that was done up to there.

    Raises
    ------
    ValueError
        For an output or an executor without a [cloud], and for both; SceneError for an output that holds something else.

    Examples
    --------
    >>> import saltation
    >>> result = saltation.run(saltation.load("bouncing"))
    >>> result.status, len(result.jumps)
    ('finished', 5)
    """
    if scene.cloud is not None and executor is not None and output is not None:
        raise ValueError("give either an output or an executor: blocks of grains have no parts in common")
    if scene.cloud is None and executor is not None:
        raise ValueError("executor is for scenes with a [cloud]: many scenes of a single grain are a campaign")
    if scene.cloud is None and output is not None:
        raise ValueError("output is for scenes with a [cloud]: save the result of a single grain with result.save(path)")
    if scene.effects == AUTO:
        from saltation.study.effects import resolved

        scene = begun(scene, output) or resolved(scene, executor or Here())
    if scene.cloud is not None:
        from saltation.cloud import run_blocks, run_cloud

        return run_cloud(scene, progress, output) if executor is None else run_blocks(scene, executor, progress)
    seen = 0.0

    def report(share: float) -> None:  # never less than before, also where a run begins anew
        nonlocal seen
        seen = max(seen, share)
        if progress is not None:
            progress(seen)

    engine = Engine(scene)
    while True:
        result = fly(engine, report)
        horizon = wider(engine, result) if result.status == "horizon" else None
        if horizon is None:
            return result
        engine = Engine(scene, horizon)


def warm(scene: Any) -> None:
    """Run a scene as shortly as possible, for what that compiles: the types are those of the whole run."""
    if scene.effects == AUTO:
        from saltation.study.effects import resolved

        scene = resolved(scene, Here())
    length = {"jumps": 1, "discard": 0} if scene.run.jumps is not None else {"duration": min(scene.run.duration, scene.numbers.time)}
    run(scene.model_copy(update={"run": scene.run.model_copy(update=length)}))


def wider(engine: Engine, result: Result) -> float | None:
    """The memory (d/V) with which a run that outlasted it can do its jumps, by the flights seen; None if there is none."""
    scene, before = engine.scene, engine.horizon
    given = scene.options("history").horizon
    most = LONGEST if given is None else given
    if not before < most:
        return None
    jumps = len(result.all_jumps)
    wanted = 1.25 * before * (scene.run.jumps or 1) / jumps if jumps else math.inf
    horizon = float(min(most, max(2.0 * before, min(wanted, GROWTH * before))))
    if scene.solver.method != "collocation":
        try:
            scene.steps_of(horizon)
        except ValueError:
            return None
    return horizon


def fly(engine: Engine, report: Callable[[float], None]) -> Result:
    """One grain from its start to the end of the run or of the memory."""
    scene = engine.scene
    if scene.solver.method != "collocation":
        from saltation.flight.fixed import run_fixed

        return run_fixed(engine, report)
    grain = Grain(engine)
    wanted = scene.run.jumps
    rows: list[Floats] = []
    trail = Trail(None if scene.bed is not None else MOST_KEPT)
    heirs = [Heir(engine, grain)] if engine.problem.end < engine.end else []
    while heirs and heirs[-1].engine.problem.end < engine.end:
        heirs.append(Heir(heirs[-1].engine, grain))
    recording = scene.run.trajectory or scene.bed is None
    aloft = scene.bed is None  # steps grow: noise of the velocities counts for the positions, so the Jacobian is renewed often
    table = np.zeros((min(wanted or CHUNK, CHUNK), len(flight.COLUMNS)))
    record = empty_record(RENEWED if aloft else CHUNK if recording else 1, engine.tables.count, engine.states)
    while True:
        if aloft:
            grain.state.numbers[stepper.KNOWN] = 0.0
        grain.flight[flight.DONE] = 0.0
        code, done = grain.fly(record, recording, table)
        rows.append(table[: int(grain.flight[flight.DONE])].copy())
        if scene.run.trajectory and done:
            trail.add(record, done)
        for heir in heirs:
            heir.follow(record, done)
        report(min(1.0, float(grain.flight[flight.TAKEN] / wanted if wanted else grain.state.numbers[stepper.TIME] / engine.end)))
        if code == stepper.END and heirs:
            grain = heirs.pop(0).take_over(grain)
        elif code not in (stepper.FULL, flight.CROWDED):
            break
    return Result.of(grain.engine, np.concatenate(rows), trail.whole(), *ending(code, grain), grain.spin[:3])


def ending(code: int, grain: Grain, otherwise: tuple[str, str] = ("failed", "the flight stopped")) -> tuple[str, str]:
    """Status and why, from what a flight came back with."""
    short = grain.flight[flight.SHORT]
    if code == flight.JUMPS and short >= min(STILL, grain.flight[flight.TAKEN]):
        code = flight.REST
    if code == flight.REST and abs(grain.flight[flight.U]) > SLIDING:
        return "creeping", "the grain slides along the bed: impacts follow each other without flight"
    return STATUS.get(code, otherwise)


class Heir:
    """A memory that reaches farther than another and follows what that one remembers, to take over where it ends."""

    def __init__(self, before: Engine, grain: Grain) -> None:
        self.engine = Engine(before.scene, min(before.scene.horizon, WIDER * before.horizon))
        self.past = np.repeat(grain.state.jump[:, None], len(self.engine.rates), axis=1)
        self.known: dict[tuple[float, float], tuple[Floats, Floats]] = {}

    def follow(self, record: stepper.Record, done: int) -> None:
        """What the recorded steps leave in it."""
        engine, tables, where = self.engine, self.engine.tables, self.engine.problem.where
        for h, kind, share, values in zip(record.size[:done], record.kind[:done], record.share[:done], record.values[:done], strict=True):
            if share < 1.0:
                none = np.zeros(0)
                state = stepper.State(none, none, self.past, np.zeros(len(where)), none, none)
                stepper.cut_memory(where, tables.nodes, engine.cut, state, h, share, int(kind), values)
                continue
            if (h, kind) not in self.known:
                found = step_tables(tables.count, tables.tail, BassetKernel(), h, bool(kind))
                self.known[h, kind] = found[1], found[2]
            decay, gained = self.known[h, kind]
            self.past = decay * self.past + values[:, where].T @ gained

    def take_over(self, grain: Grain) -> Grain:
        """The grain with this memory."""
        heir, state = Grain(self.engine), grain.state
        state.jump[:] = 0.0
        heir.state = state._replace(past=np.ascontiguousarray(self.past))
        heir.spin, heir.flight, heir.values = grain.spin, grain.flight, grain.values
        return heir


class Trail:
    """The recorded steps, thinned where there are more than `most`."""

    def __init__(self, most: int | None) -> None:
        self.most, self.every, self.seen = most, 1, 0
        self.parts: list[stepper.Record] = []
        self.last: stepper.Record | None = None

    def add(self, record: stepper.Record, done: int) -> None:
        """Keep what was recorded."""
        first = -self.seen % self.every
        self.parts.append(stepper.Record(*(array[first : done : self.every].copy() for array in record)))
        self.last = stepper.Record(*(array[done - 1 : done].copy() for array in record))
        self.seen += done
        if self.most is not None and self.seen > self.most * self.every:
            self.parts = [stepper.Record(*(array[::2].copy() for array in joined(self.parts)))]
            self.every *= 2

    def whole(self) -> stepper.Record | None:
        """All that is kept, the last step too; None if there is nothing."""
        if self.last is None:
            return None
        left_out = (self.seen - 1) % self.every != 0
        return joined([*self.parts, self.last] if left_out else self.parts)


def joined(parts: list[stepper.Record]) -> stepper.Record:
    """Records one after the other."""
    return stepper.Record(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def begun(scene: Any, output: str | os.PathLike[str] | None) -> Any:
    """What was chosen for a scene that says "auto" when the run in this folder began; None if there is none."""
    if output is None:
        return None
    from saltation.results.cloud import words_in

    try:
        found = scene_of(words_in(Path(output))["scene"])
    except (OSError, ValueError):
        return None
    return found if found.chosen is not None and found.chosen.of == key_of(scene) else None


def empty_record(steps: int, stages: int, states: int) -> stepper.Record:
    """Room for so many steps."""
    shapes: tuple[Any, ...] = (steps, steps, steps, steps, (steps, states), (steps, stages, states), steps, (steps, 0), (steps, 0))
    return stepper.Record(*(np.zeros(shape) for shape in shapes))
