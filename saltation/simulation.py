"""Scene -> Result: fly one grain, keep its jumps and its path, and say how the result came about."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from basset.kernels import Floats
from basset.solvers import _march
from saltation import flight
from saltation._keys import key_of
from saltation.engine import Engine, Grain
from saltation.result import Result
from saltation.scene import AUTO, scene_of
from saltation.workers import Here

__all__ = ["run"]

CHUNK = 4096  # steps between two visits of the caller
SLIDING = 1e-3  # u*: a grain at the bed that is faster creeps, a slower one lies still
STATUS = {
    flight.JUMPS: ("finished", "all jumps are done"),
    _march.END: ("finished", "the time is over"),
    flight.REST: ("at rest", "the grain lies still: impacts follow each other without flight"),
    flight.ALOFT: ("aloft", "a flight exceeded run.longest_flight: the grain never comes down"),
    flight.HORIZON: ("horizon", "the run outlasted history.horizon: set it longer"),
    _march.TOO_SMALL: ("failed", "the step size fell below its floor: the accuracy asked for cannot be had"),
    _march.NOT_FINITE: ("failed", "a rate was not finite, or the stages did not converge"),
    _march.TOO_MANY: ("failed", "too many steps"),
}


def run(scene: Any, progress: Callable[[float], None] | None = None, output: str | os.PathLike[str] | None = None, executor: Executor | None = None) -> Any:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
        From `saltation.load` or `saltation.Scene.model_validate`. With effects = "auto" they are first chosen by
        `saltation.advice.choose`, for a [cloud] over the executor, else here; `result.scene.chosen` holds the evidence.
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
        from saltation.advice import resolved

        scene = begun(scene, output) or resolved(scene, executor or Here())
    if scene.cloud is not None:
        from saltation.cloud import run_blocks, run_cloud

        return run_cloud(scene, progress, output) if executor is None else run_blocks(scene, executor, progress)
    if scene.solver.method != "collocation":
        from saltation.fixed import run_fixed

        return run_fixed(scene, progress)
    engine = Engine(scene)
    grain = Grain(engine)
    wanted = scene.run.jumps
    rows: list[Floats] = []
    kept: list[flight.Record] = []
    recording = scene.run.trajectory
    record = empty_record(CHUNK if recording else 1, engine.tables.count, engine.states)
    while True:
        table = np.zeros((min(wanted or CHUNK, CHUNK), len(flight.COLUMNS)))
        grain.flight[flight.DONE] = 0.0
        code, done = grain.fly(record, recording, table)
        rows.append(table[: int(grain.flight[flight.DONE])])
        if recording and done:
            kept.append(flight.Record(*(array[:done].copy() for array in record)))
        if progress is not None:
            share = grain.flight[flight.TAKEN] / wanted if wanted else grain.state.numbers[_march.TIME] / engine.problem.end
            progress(min(1.0, float(share)))
        if code not in (_march.FULL, flight.CROWDED):
            break
    status, message = STATUS[code]
    if code == flight.REST and abs(grain.flight[flight.U]) > SLIDING:
        status, message = "creeping", "the grain slides along the bed: impacts follow each other without flight"
    path = flight.Record(*(np.concatenate(parts) for parts in zip(*kept, strict=True))) if kept else None
    return Result.of(engine, np.concatenate(rows), path, status, message, grain.spin)


def begun(scene: Any, output: str | os.PathLike[str] | None) -> Any:
    """What was chosen for a scene that says "auto" when the run in this folder began; None if there is none."""
    if output is None:
        return None
    from saltation.cloud_result import words_in

    try:
        found = scene_of(words_in(Path(output))["scene"])
    except (OSError, ValueError):
        return None
    return found if found.chosen is not None and found.chosen.of == key_of(scene) else None


def empty_record(steps: int, stages: int, states: int) -> flight.Record:
    """Room for so many steps."""
    shapes: tuple[Any, ...] = (steps, steps, steps, steps, (steps, states), (steps, stages, states))
    return flight.Record(*(np.zeros(shape) for shape in shapes))
