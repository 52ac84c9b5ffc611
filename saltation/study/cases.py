"""Scenes that differ in one thing, flown with as many jumps as their difference needs, timed in turn, and compared."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from basset import measure
from basset.kernels import Floats
from saltation import statistics
from saltation.scene import LONGEST, Scene, SceneError
from saltation.simulation import run
from saltation.study.campaigns import campaign

VARIABLES = statistics.VARIABLES
PILOT, MOST = 400, 20000  # jumps: of a first look, of any run
TIMED = 100  # jumps of a timed run
BOUND = 1.96  # standard errors
Progress = Callable[[float], None]


def without(scene: Scene, left_out: Iterable[str]) -> Scene:
    """The scene without some effects."""
    gone = set(left_out)
    return scene.changed(effects=[name for name in scene.names if name not in gone])


def with_listed_effects(scene: Scene) -> Scene:
    """The scene with its effects by name: what a preset or "auto" stands for is written out, options and dimensions too."""
    if not isinstance(scene.effects, str):
        return scene
    options = {name: scene.options(name).model_dump(exclude_none=True) for name in scene.preset.options}
    return scene.changed(effects=list(scene.names), tolerance=None, dimensions=2 if scene.in_plane else 3, **options)


def with_jumps(scene: Scene, jumps: int) -> Scene:
    """The scene with so many jumps that count; a run for a time stays as long as it is.

    A horizon that is given holds for the scene's own number of jumps: it grows with them. One that is shorter than the default
    is left out, so that the memory follows the flights.
    """
    if scene.run.jumps is None:
        return scene
    wanted = jumps + scene.run.discard
    tables: dict[str, Any] = {"run": {"jumps": wanted}}
    given = scene.options("history").horizon
    if given is not None:
        usual = scene.changed(**tables, history={"horizon": None})
        horizon = min(LONGEST, given * max(1.0, wanted / scene.run.jumps))
        tables["history"] = {"horizon": horizon if horizon > usual.horizon else None}
    return scene.changed(**tables)


def fly(scenes: dict[str, Scene], jumps: int, executor: Executor | None, progress: Progress | None) -> pd.DataFrame:
    """The campaign over scenes with so many jumps; index: their names."""
    return campaign([({"case": name}, with_jumps(scene, jumps)) for name, scene in scenes.items()], executor, progress=progress).set_index("case")


def jumps_flown(table: pd.DataFrame, scene: Scene) -> int:
    """How many jumps were flown for a table, those that are discarded too."""
    return int(table["jumps"].sum()) + len(table) * int(scene.run.discard)


def fly_to_error(scenes: dict[str, Scene], error: float, executor: Executor | None, progress: Progress | None) -> tuple[pd.DataFrame, int, int]:
    """The campaign with as many jumps as the mean height of the first scene needs for a relative standard error; (table, their number, all jumps flown)."""
    report = progress or (lambda done: None)
    table = fly(scenes, PILOT, executor, lambda done: report(0.5 * done))
    first, scene = table.iloc[0], next(iter(scenes.values()))
    count, total = PILOT, jumps_flown(table, scene)
    wanted = PILOT * (first["height_se"] / (error * first["height"])) ** 2 if first["height"] > 0.0 else 0.0
    if wanted > PILOT and scene.run.jumps is not None:
        count = min(MOST, math.ceil(wanted / 100.0) * 100)
        table = fly(scenes, count, executor, lambda done: report(0.5 + 0.5 * done))
        total += jumps_flown(table, scene)
    report(1.0)
    return table, count, total


def compare(table: pd.DataFrame) -> pd.DataFrame:
    """Relative changes of H, L and ū of every row against the first, with their standard errors; the first row's error is its own."""
    full, found = table.iloc[0], table[["status", "jumps"]].copy()
    for name in VARIABLES:
        ratio = table[name] / full[name]
        error = np.hypot(table[f"{name}_se"], ratio * full[f"{name}_se"]) / abs(full[name])
        error.iloc[0] = full[f"{name}_se"] / abs(full[name])
        found[name], found[f"{name}_change"], found[f"{name}_error"] = table[name], ratio - 1.0, error
    return found


def require_bed(scene: Scene) -> None:
    """Only jumps can be compared."""
    if scene.bed is None:
        raise SceneError("bed is missing: jumps are compared, and without a bed there are none")


def largest_change(row: Any) -> float:
    """Largest relative change of H, L or ū as found; infinite where it jumps no more."""
    changes = [abs(row[f"{name}_change"]) for name in VARIABLES]
    return float(max(changes)) if row["status"] == "finished" and np.isfinite(changes).all() else math.inf


def change_bound(row: Any) -> float:
    """Largest relative change of H, L or ū that a row does not rule out (95 %); infinite where it jumps no more."""
    bounds = [abs(row[f"{name}_change"]) + BOUND * row[f"{name}_error"] for name in VARIABLES]
    return float(max(bounds)) if row["status"] == "finished" and np.isfinite(bounds).all() else math.inf


class Paired(NamedTuple):
    """Differences of jumps flown over the same bed, in units of the mean jump: their mean, its standard error, and all of them, (jumps, quantities)."""

    mean: Floats
    error: Floats
    single: Floats


def paired(tables: Sequence[Floats], others: Sequence[Floats], means: Floats) -> Paired:
    """Tables of jumps (jumps, quantities), one per seed, less others over the same beds; of the longer of two the first jumps are taken.

    Neighbouring jumps depend on each other: the standard error of each seed's mean is by blocks, and seeds are independent.
    """
    apart = []
    for table, other in zip(tables, others, strict=True):
        count = min(len(table), len(other))
        apart.append((table[:count] - other[:count]) / means)
    errors = np.array([[statistics.standard_error(column) for column in values.T] for values in apart])
    mean = np.mean([values.mean(axis=0) for values in apart], axis=0)
    return Paired(mean, np.sqrt((errors**2).sum(axis=0)) / len(errors), np.concatenate(apart))


def seconds_of(scenes: Mapping[Any, Scene], rounds: int = 5, patience: float = 60.0) -> pd.Series:
    """CPU seconds of a run of each scene, taking turns, everything compiled; one longer than `patience` (s) is timed once."""
    taken = measure.interleaved({name: partial(run, scene) for name, scene in scenes.items()}, rounds, patience=patience, clock=time.process_time)
    return pd.Series(list(taken.values()), index=list(taken), dtype=float)


def relative_costs(scenes: dict[str, Scene]) -> pd.Series:
    """Seconds per jump of each scene over those of the first, taking turns; NaN for runs for a time and for those that do not finish."""
    found = pd.Series(math.nan, index=list(scenes))
    if all(scene.run.jumps is not None for scene in scenes.values()):
        timed = {name: scene.changed(run={"jumps": TIMED, "discard": 0, "trajectory": False}) for name, scene in scenes.items()}
        found.update(seconds_of({name: scene for name, scene in timed.items() if run(scene).status == "finished"}))
    return found / found.iloc[0]
