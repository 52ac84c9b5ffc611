"""Many scenes over any executor: one row per scene, the same bits on any number of workers; the thesis's runs, judged."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from basset import _validate
from saltation import regressions, statistics
from saltation._files import replacing, write
from saltation._keys import hash_of, key_of, text_of
from saltation.flight.cost import CHUNK, cost_of, form_of
from saltation.grain import GRAVITY
from saltation.results.files import key_in, packed
from saltation.scene import Scene, read, scene_of, shipped
from saltation.simulation import run
from saltation.workers import TURN, cores, processes

__all__ = ["Store", "diameter_of", "grains", "judge", "thesis"]

QUANTITIES = ("height", "length", "velocity", "spin", "takeoff_angle", "abs_deviation_angle")  # of the jumps that count; the last is |deviation_angle|
MEANS = tuple(f"{name}{suffix}" for name in QUANTITIES for suffix in ("", "_sd", "_se"))
COLUMNS = (*MEANS, "jumps", "status", "message", "clipped", "creeping", "bed_frequency", "pair_frequency")


def campaign(
    scenes: Iterable[Any],
    executor: Executor | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    store: str | os.PathLike[str] | None = None,
    results: str | os.PathLike[str] | None = None,
) -> pd.DataFrame:
    """Run many scenes whose effects are given; as `saltation.campaign`."""
    labels, wanted = labelled(scenes, results is not None)
    kept = Store(store) if store is not None else None
    if results is None:
        wanted = [scene.changed(run={"trajectory": False}) for scene in wanted]
    keys = [key_of(scene) for scene in wanted]
    pending = dict(zip(keys, wanted, strict=True))  # equal scenes run once
    files = files_of(keys, labels, Path(results)) if results is not None else {key: [] for key in keys}
    rows = {key: row for key in pending if kept is not None and (row := kept.get(key)) is not None and all(key_in(file) == key for file in files[key])}
    for key in rows:
        del pending[key]

    def report() -> None:
        if progress is not None:
            progress(len(rows) / max(1, len(rows) + len(pending)))

    report()
    for found in _fly_all(chunks(pending), pending, executor, results is not None):
        for key, (row, whole) in found.items():
            for file in files[key]:
                with replacing(file) as name:
                    Path(name).write_bytes(whole)
            rows[key] = row
            scene = pending.pop(key)
            if kept is not None:  # last: a row says that its results are there
                kept.put(key, scene, row)
        report()
    columns = [*dict.fromkeys(name for given in labels for name in given), *COLUMNS]
    return pd.DataFrame([{**given, **rows[key]} for given, key in zip(labels, keys, strict=True)], columns=columns)


def labelled(scenes: Iterable[Any], named: bool = False) -> tuple[list[dict[str, Any]], list[Scene]]:
    """Labels and scenes of a campaign; `named`: each needs a file of its own."""
    labels: list[dict[str, Any]] = []
    wanted: list[Scene] = []
    for item in scenes:
        own, scene = item if isinstance(item, tuple) and len(item) == 2 else ({}, item)
        if not isinstance(scene, Scene) or not isinstance(own, Mapping):
            raise TypeError(f"scenes must hold scenes or pairs (labels, scene), got {_validate.shown(item)}")
        for name in own:
            if name in COLUMNS:
                raise ValueError(f"labels must not be called like a result, got {name!r}")
        labels.append(dict(own))
        wanted.append(scene)
    names = [str(own.get("name", "")) for own in labels] if named else []
    for name in names:
        if not name or name != Path(name).name or names.count(name) > 1:
            raise ValueError(f"results need a label 'name' for each run, a file name that no other has, got {name!r}")
    return labels, wanted


def files_of(keys: Sequence[str], labels: Sequence[Mapping[str, Any]], folder: Path) -> dict[str, list[Path]]:
    """Where the results of each scene go."""
    folder.mkdir(parents=True, exist_ok=True)
    files: dict[str, list[Path]] = {key: [] for key in keys}
    for key, given in zip(keys, labels, strict=True):
        files[key].append(folder / f"{given['name']}.nc")
    return files


def outcome(result: Any) -> dict[str, Any]:
    """What a campaign keeps of one run: the row of its table, without labels."""
    jumps = result.jumps.assign(abs_deviation_angle=lambda table: table["deviation_angle"].abs())
    row: dict[str, Any] = {}
    for name, values in statistics.summary(jumps, QUANTITIES).iterrows():
        row[f"{name}"], row[f"{name}_sd"], row[f"{name}_se"] = (float(values[key]) for key in ("mean", "standard_deviation", "standard_error"))
    shares = {name: float(result.provenance[name]) for name in ("clipped", "creeping")}
    often = result.frequencies() if result.scene.cloud is not None else {"bed": math.nan, "pairs": math.nan}
    frequencies = {"bed_frequency": often["bed"], "pair_frequency": often["pairs"]}
    return {**row, "jumps": len(jumps), "status": result.status, "message": result.message, **shares, **frequencies}


# Workers


def fly(texts: Mapping[str, str], whole: bool) -> dict[str, tuple[dict[str, Any], bytes]]:
    """Rows, and all that the runs left if `whole`, of some scenes in JSON by their keys: what a worker is given."""
    with TURN:
        return {key: _flown(key, run(scene_of(json.loads(text))), whole) for key, text in texts.items()}


def _flown(key: str, result: Any, whole: bool) -> tuple[dict[str, Any], bytes]:
    """What goes back to the campaign."""
    return outcome(result), packed(result, key) if whole else b""


def chunks(scenes: Mapping[str, Scene]) -> list[list[str]]:
    """Keys of scenes in handfuls of about half a second.

    A handful shares one compiled form, and the first of every form come first: workers then compile different things at a
    time, and find each other's on disk.
    """
    forms: dict[Any, list[list[str]]] = {}
    room: dict[Any, float] = {}
    for key, scene in scenes.items():
        form, cost = form_of(scene), cost_of(scene)
        if room.get(form, 0.0) < cost:
            forms.setdefault(form, []).append([])
            room[form] = CHUNK
        forms[form][-1].append(key)
        room[form] -= cost
    longest = max(map(len, forms.values()), default=0)
    return [handfuls[k] for k in range(longest) for handfuls in forms.values() if k < len(handfuls)]


def _fly_all(
    handfuls: list[list[str]], scenes: Mapping[str, Scene], executor: Executor | None, whole: bool
) -> Iterator[dict[str, tuple[dict[str, Any], bytes]]]:
    """What `fly` makes of every handful, as it comes."""
    tasks = [{key: text_of(scenes[key]) for key in handful} for handful in handfuls]
    workers = min(len(tasks), cores())
    if executor is None and workers < 2:  # not worth a process
        for task in tasks:
            yield fly(task, whole)
        return
    with processes(workers) if executor is None else contextlib.nullcontext(executor) as pool:
        futures: set[Future[Any]] = set()
        try:
            for task in tasks:
                futures.add(pool.submit(fly, task, whole))
            for future in as_completed(futures):
                futures.remove(future)  # and with it what it holds
                yield future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            raise


# The store


class Store:
    """A folder with one JSON file per finished scene.

    Parameters
    ----------
    path : path
        Made if missing.

    Examples
    --------
    >>> import tempfile
    >>> import saltation
    >>> scene, row = saltation.load("bouncing"), dict.fromkeys(COLUMNS, 0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = Store(folder)
    ...     store.put("a", scene, row)
    ...     store.get("a") == row, store.get("b")
    (True, None)
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.path.mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> dict[str, Any] | None:
        """The row kept under a key; None if there is none that is whole.

        Parameters
        ----------
        key : str

        Returns
        -------
        dict or None
        """
        try:
            content = json.loads((self.path / f"{key}.json").read_text(encoding="utf-8"))
            row: dict[str, Any] = content["row"]
            whole = content["check"] == hash_of(key, json.dumps(row)) and set(row) == set(COLUMNS)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return row if whole else None

    def choice(self, key: str) -> Scene | None:
        """The scene that was chosen for one that says "auto".

        Parameters
        ----------
        key : str
            Of that one.

        Returns
        -------
        Scene or None
            None if there is none that is whole.

        Examples
        --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     Store(folder).choice("none") is None
        True
        """
        try:
            found = scene_of(json.loads((self.path / f"{key}.chosen.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None
        return found if found.chosen is not None and found.chosen.of == key else None

    def put_choice(self, key: str, scene: Scene) -> None:
        """Keep a choice.

        Parameters
        ----------
        key : str
            Of the scene that says "auto".
        scene : Scene
            What was chosen for it.

        Raises
        ------
        OSError
            If it cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> from saltation import load
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     Store(folder).put_choice("key", load("bouncing"))
        ...     Store(folder).choice("key") is None  # it was chosen for no such scene
        True
        """
        write(self.path / f"{key}.chosen.json", text_of(scene) + "\n")

    def put(self, key: str, scene: Scene, row: dict[str, Any]) -> None:
        """Keep a row; floats are written so that they come back bit for bit.

        Parameters
        ----------
        key : str
        scene : Scene
        row : dict
            Units as in the table of `campaign`.
        """
        content = {"scene": json.loads(text_of(scene)), "row": row, "check": hash_of(key, json.dumps(row))}
        write(self.path / f"{key}.json", json.dumps(content, indent=1) + "\n")


# The thesis


RUNS = {"A": "R1", "B": "R2", "C": "R3", "D": "R4", "E": "R5", "F": "R6", "G": "R7", "H": "R8"}  # Table 3-4: the roughness of each Run
SETS: dict[int, tuple[float | str, float]] = {1: ("set1", 0.89), 2: (0.65, 0.1), 3: (0.8, 0.4), 4: (0.95, 0.3)}  # Table 3-3: e and f
STAGES = {73.0: ("sand", (1.79, 1.87, 2.43, 2.50, 2.67)), 250.0: ("sand_coarse", (2.31, 3.08, 3.85))}  # R_p: shipped scene, T
MODEL = ("run", "set")


def thesis() -> list[tuple[dict[str, Any], Scene]]:
    """The 256 runs of the thesis's section 3.3.2: Runs A–H × Sets 1–4 × T, 220 jumps each, the first 20 left out.

    Run A is the two-dimensional flight with prescribed spin (3-6) and the rebound of García & Niño, whose f is the share of
    tangential velocity that is *kept*: 0.89, Set 1's f, for all Sets, which then differ by e alone. All others are
    three-dimensional with the hard-sphere contact, whose f is Coulomb's. All have one seed: they meet the same random numbers
    at the same impact.

    Returns
    -------
    list of (labels, Scene)
        Labels: run, set, particle_reynolds, stage (T), restitution (e), f, f_is ("retention" or "Coulomb").

    Examples
    --------
    >>> runs = thesis()
    >>> len(runs), runs[0][0]["run"], runs[0][1].in_plane
    (256, 'A', True)
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


CONCENTRATIONS = {0.0013: 15, 0.0233: 45}  # Table 4-1: C_p; the number of grains is not printed and is that of the scene
REYNOLDS = (73.0, 250.0)
STAGES_OF_GRAINS = (2.0, 2.5, 3.0)
LASTING = 500.0  # d/u*


def grains() -> list[tuple[dict[str, Any], Scene]]:
    """The 24 runs of the thesis's Table 4-1: C_p × R_p × T, with and without encounters, 500 d/u* each.

    The bed of the shipped scene does not scatter across the stream, so that encounters alone do. All have one seed: they set out from the same
    places and meet the same random numbers at the same impact of the same grain, in units of their box.

    Returns
    -------
    list of (labels, Scene)
        Labels: name, concentration (C_p), particle_reynolds, stage (T), encounters (bool).

    Examples
    --------
    >>> runs = grains()
    >>> len(runs), sum(labels["encounters"] for labels, scene in runs)
    (24, 12)
    """
    result = []
    for concentration, number in CONCENTRATIONS.items():
        for reynolds in REYNOLDS:
            base = read(shipped()["sand_cloud"])
            base["grain"]["diameter"] = diameter_of(reynolds, scene_of(base))
            base["cloud"] |= {"number": number, "concentration": concentration}
            for stage in STAGES_OF_GRAINS:
                base["channel"]["transport_stage"] = stage
                base["run"]["duration"] = LASTING * scene_of(base).numbers.time
                for meeting in (True, False):
                    content = {key: value for key, value in base.items() if meeting or key != "encounters"}
                    content["effects"] = [name for name in base["effects"] if meeting or name != "encounters"]
                    labels = {"concentration": concentration, "particle_reynolds": reynolds, "stage": stage, "encounters": meeting}
                    name = f"C{100.0 * concentration:g}_R{reynolds:g}_T{stage:g}_{'with' if meeting else 'without'}"
                    result.append(({"name": name} | labels, scene_of(content)))
    return result


def diameter_of(particle_reynolds: float, scene: Scene) -> float:
    """Diameter that gives a scene's material and fluid a particle Reynolds number R_p = √(R g d³)/ν.

    Parameters
    ----------
    particle_reynolds : float, dimensionless
        R_p.
    scene : Scene
        Whose densities and viscosity count.

    Returns
    -------
    float, m

    References
    ----------
    R_p as in thesis (4-13).

    Examples
    --------
    >>> import saltation
    >>> abs(diameter_of(73.0, saltation.load("sand")) / 0.69e-3 - 1.0) < 0.01
    True
    """
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
        From `campaign`, units as there, with the labels particle_reynolds, stage and those of `models`.
    reference : DataFrame, optional
        From `statistics.read_reference`, units as there; stages that the campaign does not reach are left out.
    particle_reynolds : float, dimensionless
        Which R_p it is for, to 2 %.
    models : sequence of str
        The labels that make a model.

    Returns
    -------
    DataFrame, one row per model, R_p and source, the best mean rank first; dimensionless
        model, particle_reynolds and source; error_index (RMSE over the mean, averaged over H, L and ū) and overlap_index
        (per cent; where the source gives standard deviations), see `statistics`; against the regressions also inside (share of
        the means within their envelope) and height_place, length_place and velocity_place (0 at the envelope's lower
        and 1 at its upper edge, mean over T); rank among the models by the overlap index, or else by the error index;
        mean_rank of the model over all R_p and sources. NaN where a model has no mean.

    Raises
    ------
    ValueError
        For a table without these labels or with two runs of a model at one stage, and for a reference that no run reaches.

    References
    ----------
    thesis, section 3.4.2 and fig. 3-10.

    Examples
    --------
    >>> import pandas as pd
    >>> rows = [{"run": "A", "height": 2.0, "length": 12.0, "velocity": 6.0}, {"run": "B", "height": 9.0, "length": 90.0, "velocity": 20.0}]
    >>> table = pd.DataFrame(rows).assign(particle_reynolds=73.0, stage=2.0, height_sd=1.0, length_sd=1.0, velocity_sd=1.0)
    >>> judge(table, models=["run"])["rank"].tolist()  # A jumps as the regressions say
    [1.0, 2.0]
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
