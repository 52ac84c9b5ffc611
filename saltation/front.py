"""The public functions `run` and `campaign`: effects = "auto" is resolved before anything runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from typing import Any

import pandas as pd

from saltation import simulation
from saltation._keys import key_of
from saltation.results.folder import begun
from saltation.results.result import Result
from saltation.scene import AUTO, Scene
from saltation.study import campaigns
from saltation.study.effects import choose
from saltation.workers import SerialExecutor

__all__ = ["campaign", "run"]


def resolved(
    scene: Scene,
    executor: Executor | None = None,
    output: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Scene:
    """The scene itself, or with effects = "auto" what was chosen when the run in the folder `output` began, or else what is chosen now."""
    if scene.effects != AUTO:
        return scene
    return begun(scene, output) or choose(scene, None, executor, progress=progress)


def run(
    scene: Scene, progress: Callable[[float], None] | None = None, output: str | os.PathLike[str] | None = None, executor: Executor | None = None
) -> Result:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
        From `saltation.load` or `saltation.Scene.model_validate`. With effects = "auto" the effects are first chosen by
        `saltation.study.effects.choose`, for a [cloud] over the executor, else here; `result.scene.chosen` records the choice.
    progress : callable or None
        Called with the share that is done, 0 to 1 (dimensionless).
    output : path, optional
        For a [cloud] only: a folder, made if missing, to which the run writes numbered parts while it proceeds, so that memory use does
        not grow. If it is stopped, the same call goes on from the last part, and the result is bit-identical.
    executor : concurrent.futures.Executor, optional
        For a [cloud] only, and without output: without encounters, blocks of grains run in its workers; with encounters, all grains
        as one task; the result is bit-identical.

    Returns
    -------
    Result
        With a status (finished, at rest, creeping, aloft, horizon, failed or unsettled; see `Result`) and all that was computed until the end.

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
        raise ValueError("give either an output or an executor: blocks of grains cannot be written as parts of one run")
    if scene.cloud is None and executor is not None:
        raise ValueError("executor needs a multi-grain scene; use saltation.campaign(scenes, executor) for several scenes")
    if scene.cloud is None and output is not None:
        raise ValueError("output is for scenes with a [cloud]: save the result of a single grain with result.save(path)")
    return simulation.run(resolved(scene, executor or SerialExecutor(), output), progress, output, executor)


def campaign(
    scenes: Iterable[Any],
    executor: Executor | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    store: str | os.PathLike[str] | None = None,
    results: str | os.PathLike[str] | None = None,
) -> pd.DataFrame:
    """Run many scenes, of one grain or of many each.

    A row depends on its scene alone: neither the kind and number of workers nor the order changes a bit of it.

    Parameters
    ----------
    scenes : iterable of Scene or of (dict, Scene)
        A dictionary holds labels, which become columns. For scenes with effects = "auto" the effects are first chosen, scene by scene,
        over the same executor.
    executor : concurrent.futures.Executor, optional
        Any executor, also a dask client's `get_executor()`, or threads. Default: spawned processes on all cores, so that a script
        that calls this needs its `if __name__ == "__main__":`; processes that are killed are replaced.
    progress : callable or None
        Called with the share that is done, 0 to 1 (dimensionless).
    store : path, optional
        A folder, made if missing. Each finished scene is kept there as a file of its own, written whole or not at all; the
        a call with the same scenes and store goes on where the last one stopped. Files that cannot be read are ignored.
    results : path, optional
        A folder, made if missing, to which this process writes the full result of each run as `<name>.nc`, for `saltation.open`;
        `name` is a label that must differ from run to run. Paths are stored only here, if run.trajectory is true.

    Returns
    -------
    DataFrame, one row per scene in the order given
        The labels; mean, standard deviation (`_sd`) and standard error of the mean (`_se`) of height (d), length (d),
        velocity (u*), spin (u*/d), takeoff_angle (degree) and abs_deviation_angle (the absolute value, degree); jumps (how many
        count); status and message as of `Result`; clipped and creeping, shares of those jumps. NaN where no jump counts. For
        many grains all this over the jumps of all, and bed_frequency and pair_frequency: impacts on the bed and encounters of
        all grains per d/u*; NaN for a single grain. With two-way coupling bed_load and bed_load_before (dimensionless), with the
        stream as the grains make it and without them; else NaN.

    Raises
    ------
    TypeError, ValueError
        For what is no scene, for a label called like a result, and with `results` for a name that is missing, no file name,
        or given twice.
    BrokenExecutor
        If workers are killed again and again; what is finished is in the store.
    OSError
        If the store or the results cannot be written.

    Examples
    --------
    >>> import saltation
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scene = saltation.load("bouncing")
    >>> table = saltation.campaign([({"name": "a"}, scene), ({"name": "b"}, scene)], ThreadPoolExecutor(1))
    >>> table[["name", "jumps", "status"]].values.tolist()
    [['a', 5, 'finished'], ['b', 5, 'finished']]
    """
    labels, given = campaigns.labelled(scenes, results is not None)
    kept = campaigns.Store(store) if store is not None else None
    choices: dict[str, Scene] = {}
    wanted = []
    for scene in given:  # here, as workers cannot share out work again; each choice once, and kept in the store
        key = key_of(scene)
        if scene.effects == AUTO and key not in choices:
            choices[key] = (kept.choice(key) if kept is not None else None) or choose(scene, None, executor)
            if kept is not None:
                kept.put_choice(key, choices[key])
        wanted.append(choices.get(key, scene))
    return campaigns.campaign(zip(labels, wanted, strict=True), executor, progress=progress, store=store, results=results)


def warm(scene: Scene) -> None:
    """Run a scene as shortly as possible, for what that compiles: the types are those of the whole run."""
    scene, run = resolved(scene, SerialExecutor()), scene.run
    length: dict[str, Any] = {"jumps": 1, "discard": 0} if run.duration is None else {"duration": min(run.duration, scene.numbers.time)}
    simulation.run(scene.changed(run=length))
