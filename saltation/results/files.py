"""Results in files and in the folders of long runs."""

from __future__ import annotations

import json
import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from basset import _validate
from saltation._files import DamageError, content_of, open_dataset
from saltation._keys import hash_of
from saltation.results.result import Result
from saltation.results.tables import fate_table, no_encounters, no_jumps, ordered, path_in, table_in
from saltation.scene import Scene, scene_of

__all__ = ["open_result"]


def open_result(path: str | os.PathLike[str], parts: int | None = None) -> Result:
    """A result from a file that `Result.save` wrote, or from the folder of a long run, finished or not.

    Parameters
    ----------
    path : path
        A file, or the folder of a long run.
    parts : int, optional
        Of a folder, how many parts to read, from the first on: those before one that is damaged. Default all.

    Returns
    -------
    Result

    Raises
    ------
    ValueError
        If it is not one, or a file of it is no longer what was written: with one sentence that names the file.

    Examples
    --------
    >>> import tempfile
    >>> import saltation
    >>> result = saltation.run(saltation.load("bouncing"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result.save(Path(folder) / "out.nc")
    ...     again = saltation.open(Path(folder) / "out.nc")
    >>> again.jumps.equals(result.jumps)
    True
    """
    place = Path(path)
    if place.is_dir():
        return open_folder(place, parts)
    if parts is not None:
        raise ValueError(f"parts is for the folder of a long run, got the file {str(place)!r}")
    return result_in(open_dataset(place), repr(str(place)))


def result_in(whole: xr.Dataset, name: str) -> Result:
    """The result in a dataset from a file of that name."""
    if "scene" not in whole.attrs:
        raise DamageError(f"{name} is no saltation result: it has no scene")
    try:
        return result_of(whole)
    except Exception as error:  # only where no checksum was kept does it come to this
        raise DamageError(f"{name} is no saltation result that can be read: {' '.join(str(error).split())}") from None


def result_of(whole: xr.Dataset) -> Result:
    """The result in a dataset that `Result.dataset` made."""
    told = whole.attrs
    scene = scene_of(json.loads(told["scene"]))
    jumps, met = table_in(whole, "jump", no_jumps()), table_in(whole, "encounter", no_encounters())
    left = table_in(whole, "fate", fate_table([]))
    fates = fate_table(list(map(list, zip(left["grain"], left["time"], left["fate"], strict=True))))
    path = path_in(scene, whole)
    end = told.get("end")
    if end is None:  # a file of one grain from before it was kept
        end = float(path["time"][-1]) if path is not None else float((jumps["start"] + jumps["duration"]).max()) if len(jumps) else 0.0
    return Result(scene, jumps, told["status"], told["message"], json.loads(told["provenance"]), end, met, fates, path)


def packed(result: Result, key: str) -> bytes:
    """A result as the content of a file that can be opened, with the name of its scene for `key_in`."""
    return content_of(result.dataset().assign_attrs(key=key))


def unpacked(content: bytes) -> Result:
    """The result that was packed."""
    return result_of(open_dataset(content))


def key_in(path: Path) -> Any:
    """The key that a packed result in a file has; None if there is none, or the file is not whole."""
    try:
        return open_dataset(path).attrs.get("key")
    except (OSError, ValueError):
        return None


STOPPED = ("unfinished", "the run was stopped: the same command goes on from there")
RUN_FIELDS = {"parts", "time", "status", "message", "fates", "provenance", "scene", "key"}  # of run.json


def read_run_json(folder: Path) -> dict[str, Any]:
    """The fields of run.json; OSError if it cannot be read, DamageError if it is not what was written."""
    file = folder / "run.json"
    content = file.read_bytes()
    try:
        told: dict[str, Any] = json.loads(content)
        check = told.pop("check", None)
        whole = set(told) == RUN_FIELDS and (check is None or check == hash_of(json.dumps(told)))
    except (ValueError, TypeError, AttributeError, RecursionError):
        whole = False
    if not whole:
        raise DamageError(f"{str(file)!r} is damaged: take a copy, or start the run anew with --force")
    return told


def run_json_of(told: dict[str, Any]) -> str:
    """The text of run.json with these fields."""
    return json.dumps(told | {"check": hash_of(json.dumps(told))}, indent=1) + "\n"


def part_in(file: Path, number: int, key: str | None) -> xr.Dataset:
    """A part of a run; OSError if it cannot be read, DamageError if it is not what was written, or of another run."""
    found = open_dataset(file)
    own = found.attrs.get("part", number) == number and key in (None, found.attrs.get("key", key))
    if not own or ("part" not in found.attrs and "jump_start" not in found):
        raise DamageError(f"{str(file)!r} is no part {number} of this run: take a copy of its own, or start the run anew with --force")
    return found


def open_folder(folder: Path, count: int | None = None) -> Result:
    """The result in the folder of a long run, as far as it has come, or its first so many parts; DamageError for a file that is not what was written."""
    try:
        told = read_run_json(folder)
    except OSError:
        raise DamageError(f"{str(folder)!r} is no saltation result: it has no run.json that can be read") from None
    try:
        scene = scene_of(told["scene"])
        status, message, provenance = told["status"], told["message"], told["provenance"] | {}
        fates, time, parts = fate_table(told["fates"]), float(told["time"]), range(told["parts"])
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise DamageError(f"{str(folder / 'run.json')!r} is no saltation result that can be read: {' '.join(str(error).split())}") from None
    if count is not None and _validate.integer("parts", count, 0, len(parts)) < len(parts):
        parts, status, message, time = parts[:count], STOPPED[0], f"the first {count} of {len(parts)} parts", 0.0
    files = [folder / f"part-{k:05d}.nc" for k in parts]
    jumps, met = [no_jumps()], [no_encounters()]
    for number, file in enumerate(files):
        try:
            opened = part_in(file, number, told["key"])
            jumps.append(table_in(opened, "jump", jumps[0]))
            met.append(table_in(opened, "encounter", met[0]))
            time = float(opened.attrs.get("reached", np.nan)) if len(parts) < told["parts"] else time
        except (OSError, ValueError) as error:
            text = str(error) if isinstance(error, ValueError) else f"{str(file)!r} cannot be read: {error.strerror}"
            before = f"; what lies before is whole: saltation.open({str(folder)!r}, parts={number})" if number else ""
            raise DamageError(text + before) from None
    whole = ordered(pd.concat(jumps[1:] or jumps, ignore_index=True))
    met_all = pd.concat(met[1:] or met, ignore_index=True)
    left = fates[~(fates["time"] > time)].reset_index(drop=True)
    path = partial(path_of_parts, scene, files) if scene.run.trajectory and files else None
    return Result(scene, whole, status, message, provenance, time, met_all, left, path)


def path_of_parts(scene: Scene, files: list[Path]) -> xr.Dataset:
    """Kept positions of all parts of a run."""
    pieces = []
    for number, part in enumerate(files):
        opened = part_in(part, number, None)
        opened.attrs |= {"diameter": scene.numbers.diameter, "velocity": scene.numbers.velocity}
        if (piece := path_in(scene, opened)) is not None:
            pieces.append(piece)
    whole: xr.Dataset = xr.concat(pieces, "time", data_vars="all")
    return whole
