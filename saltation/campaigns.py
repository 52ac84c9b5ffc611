"""Many scenes over any executor: one row per scene, the same bits on any number of workers; the thesis's 256 runs, judged."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from basset import __version__, _validate
from basset._compile import digest_of
from saltation import regressions, statistics
from saltation._files import write
from saltation.grain import GRAVITY
from saltation.scene import Scene, read, scene_of, shipped
from saltation.simulation import run

QUANTITIES = ("height", "length", "velocity", "spin", "takeoff_angle", "abs_deviation_angle")  # of the jumps that count; the last is |deviation_angle|
COLUMNS = (*(f"{name}{suffix}" for name in QUANTITIES for suffix in ("", "_sd", "_se")), "jumps", "status", "message", "clipped", "creeping")
CHUNK = 4000  # jumps that a worker gets at a time, about half a second
DEAR = 50  # a jump at fixed steps costs about as many of the collocation's


def campaign(
    scenes: Iterable[Any],
    executor: Executor | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    store: str | os.PathLike[str] | None = None,
) -> pd.DataFrame:
    """Run many scenes, one grain each.

    A row depends on its scene alone: neither the kind and number of workers nor the order changes a bit of it. Paths are not
    kept.

    Parameters
    ----------
    scenes : iterable of Scene or of (dict, Scene)
        A dictionary holds labels, which become columns.
    executor : concurrent.futures.Executor, optional
        Also a dask client's `get_executor()`; threads of one process take turns. Default: processes on all cores, started
        afresh, so that a script that calls this needs its `if __name__ == "__main__":`.
    progress : callable or None
        Called with the share that is done, 0 to 1.
    store : path, optional
        A folder, made if missing. Each finished scene is kept there as a file of its own, written whole or not at all; the
        same scenes with the same store go on where they were stopped, however that was. Files that cannot be read are ignored.

    Returns
    -------
    DataFrame, one row per scene in the order given
        The labels; mean, standard deviation (`_sd`) and standard error of the mean (`_se`) of height (d), length (d),
        velocity (u*), spin (u*/d), takeoff_angle (degree) and abs_deviation_angle (the absolute value, degree); jumps (how many
        count); status and message as of `Result`; clipped and creeping, shares of those jumps. NaN where no jump counts.

    Raises
    ------
    TypeError, ValueError
        For what is no scene, and for a label called like a result.
    OSError
        If the store cannot be written.

    Examples
    --------
    >>> import saltation
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> scene = saltation.load("bouncing")
    >>> table = saltation.campaign([({"name": "a"}, scene), ({"name": "b"}, scene)], ThreadPoolExecutor(1))
    >>> table[["name", "jumps", "status"]].values.tolist()
    [['a', 5, 'finished'], ['b', 5, 'finished']]
    """
    labels, wanted = zip(*pairs, strict=True) if (pairs := [_labelled(item) for item in scenes]) else ((), ())
    keys = [key_of(scene) for scene in wanted]
    pending = dict(zip(keys, wanted, strict=True))  # equal scenes run once
    kept = Store(store) if store is not None else None
    rows = {key: row for key in pending if kept is not None and (row := kept.get(key)) is not None}
    for key in rows:
        del pending[key]

    def report() -> None:
        if progress is not None:
            progress(len(rows) / max(1, len(rows) + len(pending)))

    report()
    for chunk, found in _fly_all(chunks(pending), pending, executor):
        for key, row in zip(chunk, found, strict=True):
            rows[key] = row
            scene = pending.pop(key)
            if kept is not None:
                kept.put(key, scene, row)
        report()
    columns = [*dict.fromkeys(name for given in labels for name in given), *COLUMNS]
    return pd.DataFrame([{**given, **rows[key]} for given, key in zip(labels, keys, strict=True)], columns=columns)


def _labelled(item: Any) -> tuple[dict[str, Any], Any]:
    """(labels, scene without its path) of one entry of a campaign."""
    labels, scene = item if isinstance(item, tuple) and len(item) == 2 else ({}, item)
    if not isinstance(scene, Scene) or not isinstance(labels, Mapping):
        raise TypeError(f"scenes must hold scenes or pairs (labels, scene), got {_validate.shown(item)}")
    for name in labels:
        if name in COLUMNS:
            raise ValueError(f"labels must not be called like a result, got {name!r}")
    return dict(labels), scene.model_copy(update={"run": scene.run.model_copy(update={"trajectory": False})})


def outcome(scene: Any) -> dict[str, Any]:
    """What a campaign keeps of one scene: the row of its table, without labels."""
    result = run(scene)
    jumps = result.jumps.assign(abs_deviation_angle=lambda table: table["deviation_angle"].abs())
    row: dict[str, Any] = {}
    for name, values in statistics.summary(jumps, QUANTITIES).iterrows():
        row[f"{name}"], row[f"{name}_sd"], row[f"{name}_se"] = (float(values[key]) for key in ("mean", "standard_deviation", "standard_error"))
    shares = {name: float(result.provenance[name]) for name in ("clipped", "creeping")}
    return {**row, "jumps": len(jumps), "status": result.status, "message": result.message, **shares}


# Workers


def fly(texts: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of some scenes in JSON: what a worker is given."""
    with TURN:
        return [outcome(scene_of(json.loads(text))) for text in texts]


TURN = threading.Lock()  # grains of a process share tables that are filled as they fly: threads take turns


def chunks(scenes: Mapping[str, Any]) -> list[list[str]]:
    """Keys of scenes in handfuls of about half a second.

    A handful shares one compiled form, and the first of every form come first: workers then compile different things at a
    time, and find each other's on disk.
    """
    forms: dict[Any, list[list[str]]] = {}
    room: dict[Any, float] = {}
    for key, scene in scenes.items():
        form, cost = form_of(scene), CHUNK if scene.run.jumps is None else scene.run.jumps * (1 if scene.solver.method == "collocation" else DEAR)
        if room.get(form, 0.0) < cost:
            forms.setdefault(form, []).append([])
            room[form] = CHUNK
        forms[form][-1].append(key)
        room[form] -= cost
    longest = max(map(len, forms.values()), default=0)
    return [handfuls[k] for k in range(longest) for handfuls in forms.values() if k < len(handfuls)]


def form_of(scene: Any) -> Any:
    """What is compiled for a scene: words choose types, numbers are data."""
    words = tuple(tuple(value for _, value in scene.options(name) if isinstance(value, str)) for name in scene.names)
    bed = (scene.bed.rebound, scene.bed.roughness) if scene.bed is not None else None
    return scene.names, words, scene.in_plane, scene.channel is None, bed, scene.solver.method


def _fly_all(handfuls: list[list[str]], scenes: Mapping[str, Any], executor: Executor | None) -> Iterator[tuple[list[str], list[dict[str, Any]]]]:
    """(keys, rows) as they come."""
    texts = {key: text_of(scene) for key, scene in scenes.items()}
    workers = min(len(handfuls), cores())
    if executor is None and workers < 2:  # not worth a process
        for handful in handfuls:
            yield handful, fly([texts[key] for key in handful])
        return
    with processes(workers) if executor is None else contextlib.nullcontext(executor) as pool:
        futures: dict[Future[Any], list[str]] = {}
        try:
            for handful in handfuls:
                futures[pool.submit(fly, [texts[key] for key in handful])] = handful
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            raise


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def processes(workers: int | None = None) -> Iterator[Executor]:
    """Processes for a campaign that end with it: at an error, an interrupt, or when this process is killed.

    Parameters
    ----------
    workers : int, optional
        How many; default all cores.
    """
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    count = workers or cores()
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_obey, initargs=(reader,))
    try:
        with _deaf():  # what starts deaf to interrupts stays so, from its first line on
            for _ in range(count):
                pool.submit(os.getpid)
        yield pool
    except BaseException:
        writer.close()
        raise
    finally:
        with _deaf():  # impatience would leave workers that are just starting without their queues
            pool.shutdown(cancel_futures=True)
        writer.close()
        reader.close()


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Interrupts are ignored; where signals cannot be set (not the main thread) nothing happens."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _obey(leash: Connection) -> None:
    """In a worker: leave interrupts to the parent, and end when the parent lets go of the other end of `leash`, or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait() -> None:
        with contextlib.suppress(EOFError, OSError):
            leash.recv()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


# The store


def text_of(scene: Any) -> str:
    """A scene as JSON; floats come back bit for bit."""
    text: str = scene.model_dump_json(exclude_none=True)
    return text


def key_of(scene: Any) -> str:
    """The name of a scene's row: another scene, version or state of the code is another name."""
    return _hash(__version__, digest_of("saltation"), text_of(scene))


def _hash(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


class Store:
    """A folder with one JSON file per finished scene.

    Parameters
    ----------
    path : path
        Made if missing.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.path.mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> dict[str, Any] | None:
        """The row kept under a key; None if there is none that is whole."""
        try:
            content = json.loads((self.path / f"{key}.json").read_text(encoding="utf-8"))
            row: dict[str, Any] = content["row"]
            whole = content["check"] == _hash(key, json.dumps(row)) and set(row) == set(COLUMNS)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return row if whole else None

    def put(self, key: str, scene: Any, row: dict[str, Any]) -> None:
        """Keep a row; floats are written so that they come back bit for bit."""
        content = {"scene": json.loads(text_of(scene)), "row": row, "check": _hash(key, json.dumps(row))}
        write(self.path / f"{key}.json", json.dumps(content, indent=1) + "\n")


# The thesis


RUNS = {"A": "R1", "B": "R2", "C": "R3", "D": "R4", "E": "R5", "F": "R6", "G": "R7", "H": "R8"}  # Table 3-4: the roughness of each Run
SETS: dict[int, tuple[float | str, float]] = {1: ("set1", 0.89), 2: (0.65, 0.1), 3: (0.8, 0.4), 4: (0.95, 0.3)}  # Table 3-3: e and f
STAGES = {73.0: ("sand", (1.79, 1.87, 2.43, 2.50, 2.67)), 250.0: ("sand_coarse", (2.31, 3.08, 3.85))}  # R_p: shipped scene, T
MODEL = ("run", "set")


def thesis() -> list[tuple[dict[str, Any], Any]]:
    """The 256 runs of the thesis's section 3.3.2: Runs A–H × Sets 1–4 × T, 220 jumps each, the first 20 left out.

    Run A is the two-dimensional flight with prescribed spin (3-6) and the rebound of García & Niño, whose f is the share of
    tangential velocity that is *kept*: 0.89, Set 1's f, for all Sets, which then differ by e alone. All others are
    three-dimensional with the hard-sphere contact, whose f is Coulomb's. All have one seed: they meet the same random numbers
    at the same impact.

    Returns
    -------
    list of (labels, Scene)
        Labels: run, set, particle_reynolds, stage (T), restitution (e), f, f_is ("retention" or "Coulomb").
    """
    result = []
    for reynolds, (name, stages) in STAGES.items():
        base = read(shipped()[name])
        base["grain"]["diameter"] = diameter_of(reynolds, scene_of(base))
        base["run"] |= {"jumps": 220, "discard": 20}
        for letter, roughness in RUNS.items():
            for number, (restitution, friction) in SETS.items():
                bed = {**base["bed"], "roughness": roughness, "restitution": restitution}
                model: dict[str, Any] = {"bed": {**bed, "friction": friction}}
                if letter == "A":
                    del bed["friction"]
                    friction = SETS[1][1]  # noqa: PLW2901 - as the docstring says
                    model = {"bed": {**bed, "rebound": "garcia_nino", "tangential_retention": friction}, "dimensions": 2, "rotation": {"law": "prescribed"}}
                for stage in stages:
                    scene = scene_of({**base, **model, "channel": {**base["channel"], "transport_stage": stage}})
                    labels = {"run": letter, "set": number, "particle_reynolds": reynolds, "stage": stage, "restitution": restitution, "f": friction}
                    result.append(({**labels, "f_is": "retention" if letter == "A" else "Coulomb"}, scene))
    return result


def diameter_of(particle_reynolds: float, scene: Any) -> float:
    """Diameter in m that gives a scene's material and fluid this R_p = √(R g d³)/ν."""
    excess = abs(scene.grain.density / scene.fluid.density - 1.0)
    return math.cbrt((particle_reynolds * scene.fluid.viscosity) ** 2 / (excess * GRAVITY))


# Judgement


def judge(table: pd.DataFrame, reference: pd.DataFrame | None = None, *, particle_reynolds: float = 73.0, models: Sequence[str] = MODEL) -> pd.DataFrame:
    """Rank the models of a campaign by their mean jumps H, L and ū.

    Each is compared with the mean of the published regressions, or, at the one R_p that `reference` is for, with the
    measurements of each of its sources. The regressions differ by 1.5–3 in height and 2–5 in length: close to their mean
    is no proof, and far outside their envelope is the stronger statement.

    Parameters
    ----------
    table : DataFrame
        From `campaign`, with the labels particle_reynolds, stage and those of `models`.
    reference : DataFrame, optional
        From `statistics.read_reference`; stages that the campaign does not reach are left out.
    particle_reynolds : float
        Which R_p it is for, to 2 %.
    models : sequence of str
        The labels that make a model.

    Returns
    -------
    DataFrame, one row per model, R_p and source, the best mean rank first
        model, particle_reynolds and source; error_index (RMSE over the mean, averaged over H, L and ū) and overlap_index
        (per cent; where the source gives standard deviations), see `statistics`; against the regressions also inside (share of
        the means within their envelope) and height_place, length_place and velocity_place (0 at the envelope's lower
        and 1 at its upper edge, mean over T); rank among the models by the overlap index, or else by the error index;
        mean_rank of the model over all R_p and sources. NaN where a model has no mean.

    Raises
    ------
    ValueError
        For a table without these labels or with two runs of a model at one stage, and for a reference that no run reaches.

    Source: thesis, section 3.4.2 and fig. 3-10.
    """
    for name in (*models, "particle_reynolds", "stage"):
        if name not in table:
            raise ValueError(f"table must have the label {name!r}, got {_validate.shown(list(table))}")
    names = ["".join(map(str, values)) if tuple(models) == MODEL else ", ".join(map(str, values)) for values in table[list(models)].itertuples(index=False)]
    table = table.assign(model=names)
    parts = []
    for reynolds, runs in table.groupby("particle_reynolds"):
        measured = reference if reference is not None and math.isclose(reynolds, particle_reynolds, rel_tol=0.02) else None
        for source, observed in _sources(reynolds, runs, measured).items():
            rows = [_scores(model, reynolds, source, observed, own, measured is None) for model, own in runs.groupby("model", sort=False)]
            parts.append(pd.DataFrame(rows))
    if reference is not None and not any(set(part["source"]) & set(reference["source"]) for part in parts):
        raise ValueError(
            f"reference must reach a stage of the campaign at R_p = {particle_reynolds:g}, got stages {_validate.shown(sorted(set(reference['T'])))}"
        )
    for part in parts:
        score = "overlap_index" if part["overlap_index"].notna().any() else "error_index"
        part["rank"] = statistics.rank_models(part[score], score == "error_index").to_numpy()[:, 0]
    result = pd.concat(parts, ignore_index=True)
    result["mean_rank"] = result.groupby("model")["rank"].transform(lambda ranks: ranks.mean(skipna=False))
    return result.sort_values(["mean_rank", "model", "particle_reynolds"], kind="stable", ignore_index=True)


def _sources(reynolds: float, runs: pd.DataFrame, measured: pd.DataFrame | None) -> dict[str, pd.DataFrame]:
    """What runs of one R_p are compared with, by source."""
    stages = np.unique(runs["stage"].to_numpy(dtype=np.float64))
    if measured is not None:
        within = measured[(measured["T"] >= stages[0] * (1.0 - 1e-6)) & (measured["T"] <= stages[-1] * (1.0 + 1e-6))]
        return {str(source): rows for source, rows in within.groupby("source", sort=False)}
    means = np.mean([regression(reynolds, stages) for regression in regressions.REGRESSIONS.values()], axis=0)
    rows = [(variable, stage, mean) for variable, row in zip(statistics.VARIABLES, means, strict=True) for stage, mean in zip(stages, row, strict=True)]
    return {"regressions": pd.DataFrame(rows, columns=["variable", "T", "mean"])}


def _scores(model: Any, reynolds: Any, source: str, observed: pd.DataFrame, runs: pd.DataFrame, published: bool) -> dict[str, Any]:
    """One model against one source."""
    if runs["stage"].duplicated().any():
        raise ValueError(f"table must have one run per model and stage, got two of {model!r} at R_p = {reynolds:g}")
    own = [pd.DataFrame({"variable": name, "T": runs["stage"].astype(float), "mean": runs[name], "sd": runs[f"{name}_sd"]}) for name in statistics.VARIABLES]
    scores: dict[str, Any] = {"model": model, "particle_reynolds": reynolds, "source": source, "error_index": math.nan, "overlap_index": math.nan}
    simulated = pd.concat(own, ignore_index=True)
    if simulated["mean"].notna().all() and (observed["mean"] > 0.0).any():
        variables = [name for name in statistics.VARIABLES if name in set(observed["variable"])]
        scores["error_index"] = float(statistics.errors(observed, simulated, variables).mean())
        banded = "sd" in observed and all(rows["sd"].notna().all() and len(rows) > 1 for _, rows in observed.groupby("variable"))
        if banded and simulated["sd"].notna().all():
            scores["overlap_index"] = float(statistics.overlap_areas(observed, simulated, variables).mean())
    places = dict.fromkeys(statistics.VARIABLES, np.full(1, math.nan))
    for name, edge in zip(statistics.VARIABLES, regressions.Jump._fields, strict=True) if published else ():
        low, high = regressions.envelope(reynolds, runs["stage"].to_numpy(dtype=np.float64))[edge]
        width = np.where(high > low, high - low, np.nan)  # nothing jumps at and below the threshold
        places[name] = (runs[name].to_numpy() - low) / width
    every = np.concatenate(list(places.values()))
    scores["inside"] = float(((every >= 0.0) & (every <= 1.0)).mean()) if np.isfinite(every).all() else math.nan
    return scores | {f"{name}_place": float(place.mean()) for name, place in places.items()}
