"""Scenes that differ in one thing, flown with as many jumps as their difference needs, and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from typing import Any

import numpy as np
import pandas as pd

from saltation import statistics
from saltation.scene import LONGEST, Scene, SceneError
from saltation.study.campaigns import campaign

VARIABLES = statistics.VARIABLES
PILOT, MOST = 400, 20000  # jumps: of a first look, of any run
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
        raise SceneError("bed is missing: it is jumps that are compared, and without a bed there are none")
