"""Many scenes over any executor: one row per scene, the same bits on any number of workers."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from pathlib import Path
from typing import Any

import pandas as pd

from basset import _validate
from saltation import statistics
from saltation._files import replacing, write
from saltation._keys import hash_of, key_of, text_of
from saltation.flight.cost import CHUNK, cost_of, form_of
from saltation.results.files import key_in, packed
from saltation.results.result import Result
from saltation.scene import Scene, scene_of
from saltation.simulation import run
from saltation.workers import cores, processes

__all__ = ["Store"]

QUANTITIES = ("height", "length", "velocity", "spin", "takeoff_angle", "abs_deviation_angle")  # of the jumps that count; the last is |deviation_angle|
MEANS = tuple(f"{name}{suffix}" for name in QUANTITIES for suffix in ("", "_sd", "_se"))
Progress = Callable[[float], None]
Folder = str | os.PathLike[str]
COLUMNS = (*MEANS, "jumps", "status", "message", "clipped", "creeping", "bed_frequency", "pair_frequency", "bed_load", "bed_load_before")


def campaign(
    scenes: Iterable[Any], executor: Executor | None = None, *, progress: Progress | None = None, store: Folder | None = None, results: Folder | None = None
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


def outcome(result: Result) -> dict[str, Any]:
    """What a campaign keeps of one run: the row of its table, without labels."""
    jumps = result.jumps.assign(abs_deviation_angle=lambda table: table["deviation_angle"].abs())
    row: dict[str, Any] = {}
    for name, values in statistics.summary(jumps, QUANTITIES).iterrows():
        row[f"{name}"], row[f"{name}_sd"], row[f"{name}_se"] = (float(values[key]) for key in ("mean", "standard_deviation", "standard_error"))
    shares = {name: float(result.provenance[name]) for name in ("clipped", "creeping")}
    often = result.frequencies() if result.scene.cloud is not None else {"bed": math.nan, "pairs": math.nan}
    frequencies = {"bed_frequency": often["bed"], "pair_frequency": often["pairs"]}
    made = result.scene.coupling.settled if result.scene.coupling is not None else None
    load = {"bed_load": made.rate if made else math.nan, "bed_load_before": made.rate_uncoupled if made else math.nan}
    return {**row, "jumps": len(jumps), "status": result.status, "message": result.message, **shares, **frequencies, **load}


# Workers


def fly(texts: Mapping[str, str], whole: bool) -> dict[str, tuple[dict[str, Any], bytes]]:
    """Rows, and all that the runs left if `whole`, of some scenes in JSON by their keys: what a worker is given."""
    results = ((key, run(scene_of(json.loads(text)))) for key, text in texts.items())
    return {key: (outcome(result), packed(result, key) if whole else b"") for key, result in results}


def chunks(scenes: Mapping[str, Scene]) -> list[list[str]]:
    """Keys of scenes in batches of about half a second.

    A batch shares one compiled form, and the first of every form come first: workers then compile different things at a
    time, and share what is compiled on disk.
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
    return [batches[k] for k in range(longest) for batches in forms.values() if k < len(batches)]


def _fly_all(
    batches: list[list[str]], scenes: Mapping[str, Scene], executor: Executor | None, whole: bool
) -> Iterator[dict[str, tuple[dict[str, Any], bytes]]]:
    """What `fly` makes of every batch, as it comes."""
    tasks = [{key: text_of(scenes[key]) for key in batch} for batch in batches]
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
    """A folder, made if missing, with one JSON file per finished scene; floats come back bit for bit."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.path.mkdir(parents=True, exist_ok=True)

    def get(self, key: str) -> dict[str, Any] | None:
        """The row kept under a key; None if there is none that is whole."""
        try:
            content = json.loads((self.path / f"{key}.json").read_text(encoding="utf-8"))
            row: dict[str, Any] = content["row"]
            whole = content["check"] == hash_of(key, json.dumps(row)) and set(row) == set(COLUMNS)
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return row if whole else None

    def choice(self, key: str) -> Scene | None:
        """The scene that was chosen for one that says "auto", by the key of that one; None if there is none that is whole."""
        try:
            found = scene_of(json.loads((self.path / f"{key}.chosen.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None
        return found if found.chosen is not None and found.chosen.of == key else None

    def put_choice(self, key: str, scene: Scene) -> None:
        """Keep what was chosen for a scene that says "auto", by the key of that one."""
        write(self.path / f"{key}.chosen.json", text_of(scene) + "\n")

    def put(self, key: str, scene: Scene, row: dict[str, Any]) -> None:
        """Keep a row, units as in the table of `campaign`."""
        content = {"scene": json.loads(text_of(scene)), "row": row, "check": hash_of(key, json.dumps(row))}
        write(self.path / f"{key}.json", json.dumps(content, indent=1) + "\n")
