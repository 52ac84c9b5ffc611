"""What a run of many grains leaves: the jumps of each, the encounters, the paths, and how it came about."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from basset import _validate
from basset.kernels import Floats
from saltation import statistics
from saltation._files import DamageError, open_dataset
from saltation._keys import hash_of
from saltation.flight import collisions as encounters
from saltation.flight import loop as flight
from saltation.results.result import UNITS, Kept, path_in, shares, table_in, table_of, that_count, told_of
from saltation.scene import scene_of

__all__ = ["CloudResult"]

WHOLE = ("grain", "first", "second")  # columns that count grains
ENCOUNTER_UNITS = {"time": "d/u*", "first": "1", "second": "1", "restitution": "1", "distance": "d"}  # others by what they are
FATES = {"grain": "number of the grain", "time": "when it left the run", "fate": "at rest, creeping or aloft"}
AXES = {"x": "along the stream", "y": "across the stream", "z": "above the bed level"}


def encounter_unit(name: str) -> str:
    """The unit of a column of the table of encounters."""
    if name in ENCOUNTER_UNITS:
        return ENCOUNTER_UNITS[name]
    if name in AXES:
        return "d"
    if name.startswith("n_"):
        return "1"
    if "spin" in name:
        return "u*/d"
    return "m u*" if name.startswith("impulse") else "u*"


@dataclass(eq=False)
class CloudResult(Kept):
    """A run of many grains. Lengths in d, velocities in u* (in still water in the V of `saltation.grain`), times in d/u*.

    Attributes
    ----------
    scene : Scene
    all_jumps : DataFrame
        One row per jump, `grain` and the columns of `Result.jumps`, units as there, in the order of grains and time.
    encounters : DataFrame
        One row per encounter in the order of time: `first` and `second` grain, place of the first, unit normal from the first
        to the second, distance of the centres, restitution that was applied (greater than e where grains would have parted
        more slowly than encounters.slowest), velocities and spins of both before and after, impulse on the first; units by
        `encounter_unit`.
    fates : DataFrame
        Grains that left the run before its end, in the order of time: grain, time (d/u*), fate (at rest, creeping, aloft).
    status, message : str
        finished, pile-up, failed, or unfinished (a run that was stopped and can go on); and why.
    provenance : dict
        As of `Result`, with the pair law, the box (d), and how many steps were too short to be resolved.
    time : float, d/u*
        How far the run has come.

    Examples
    --------
    >>> import saltation
    >>> from saltation.scene import read, scene_of
    >>> result = saltation.run(scene_of(read("sand_cloud") | {"run": {"duration": 0.1}}))
    >>> result.status, result.jumps["grain"].nunique() <= 45
    ('finished', True)
    >>> frequencies = result.frequencies()
    >>> bool(abs(frequencies["bed"] * result.time - len(result.all_jumps)) < 1e-9)
    True
    >>> list(result.summary().columns)
    ['mean', 'standard_deviation', 'standard_error', 'count']
    >>> len(result.profiles(bins=10))
    10
    >>> again = CloudResult.of_dataset(result.scene, result.dataset())
    >>> again.all_jumps.equals(result.all_jumps)
    True
    """

    scene: Any
    all_jumps: pd.DataFrame
    encounters: pd.DataFrame
    fates: pd.DataFrame
    status: str
    message: str
    provenance: dict[str, Any]
    time: float
    _path: xr.Dataset | None = None
    _parts: list[Path] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Complete the provenance."""
        self.provenance = self.provenance | shares(self.jumps)

    @property
    def jumps(self) -> pd.DataFrame:
        """The jumps that count: without the first `run.discard` of each grain, and without flights that are none; units as of `Result.jumps`."""
        return that_count(self.all_jumps, self.all_jumps.groupby("grain").cumcount(), self.scene.run.discard)

    def summary(self) -> pd.DataFrame:
        """Mean, standard deviation, standard error (block bootstrap over the jumps of a grain in turn) and number.

        Returns
        -------
        DataFrame, one row per column of `jumps`
            mean, standard_deviation, standard_error and count, in the units of the column.
        """
        return statistics.summary(self.jumps.drop(columns="grain"))

    def frequencies(self) -> dict[str, float]:
        """How often grains meet the bed and each other; thesis Table 4-2.

        Returns
        -------
        dict
            Impacts on the bed `bed` (F_pb) and encounters `pairs` (F_pp) of all grains per d/u*, in u*/d; `ratio`, dimensionless.
        """
        time = self.time or np.nan  # a run that stopped at once
        bed, pairs = len(self.all_jumps) / time, len(self.encounters) / time
        return {"bed": bed, "pairs": pairs, "ratio": bed / pairs if pairs else float("inf")}

    @cached_property
    def trajectory(self) -> xr.Dataset:
        """Positions (d) and velocities (u*) (time, grain) every `cloud.interval`, not folded back into a periodic box; NaN once a grain has left.

        Raises
        ------
        ValueError
            If the paths were not kept (run.trajectory = false).
        """
        if self._path is not None:
            return self._path
        if not self._parts or not self.scene.run.trajectory:
            raise ValueError("trajectory was not kept: set run.trajectory = true")
        pieces = []
        for number, part in enumerate(self._parts):
            opened = part_in(part, number, None)
            opened.attrs |= {"diameter": self.scene.numbers.diameter, "velocity": self.scene.numbers.velocity}
            if (piece := path_in(self.scene, opened)) is not None:
                pieces.append(piece)
        whole: xr.Dataset = xr.concat(pieces, "time", data_vars="all")
        return whole

    def profiles(self, bins: int = 30, start: float = 0.0) -> pd.DataFrame:
        """Concentration and mean velocity over the height, from all kept positions of a time on.

        Parameters
        ----------
        bins : int
            How many layers.
        start : float, d/u*
            From when.

        Returns
        -------
        DataFrame
            z (d, centre of a layer), concentration (grain volume over the layer's volume in a periodic box; in an open one relative
            to the mean), velocity and its standard deviation (u*).
        """
        path = self.trajectory
        kept = path["time"].to_numpy() >= start
        z, u = path["z"].to_numpy()[kept].ravel(), path["u"].to_numpy()[kept].ravel()
        present = np.isfinite(z)
        z, u = z[present], u[present]
        edges = np.linspace(0.0, np.nextafter(z.max(), np.inf), bins + 1)
        layer = np.digitize(z, edges) - 1
        count = np.bincount(layer, minlength=bins)[:bins]
        with np.errstate(invalid="ignore"):
            mean = np.bincount(layer, u, minlength=bins)[:bins] / count
            square = np.bincount(layer, u * u, minlength=bins)[:bins] / count
        thickness = edges[1] - edges[0]
        length, width, _ = self.scene.box
        volume = length * width * thickness if self.scene.cloud.boundary == "periodic" else np.pi / 6.0 * self.scene.cloud.number * thickness
        concentration = count / max(1, kept.sum()) * np.pi / 6.0 / volume
        deviation = np.sqrt(np.maximum(0.0, square - mean * mean))
        return pd.DataFrame({"z": 0.5 * (edges[1:] + edges[:-1]), "concentration": concentration, "velocity": mean, "velocity_sd": deviation})

    def dataset(self) -> xr.Dataset:
        """Everything as one dataset: jumps along `jump`, encounters along `encounter`, paths along `time` and `grain`, the rest as attributes.

        Returns
        -------
        Dataset
            Units in the variables' attributes.
        """
        whole = tables_to_dataset(self.scene, self.all_jumps, self.encounters)
        for name, unit in (("grain", "1"), ("time", "d/u*"), ("fate", "1")):
            whole[f"fate_{name}"] = ("fate", self.fates[name].to_numpy(), told_of(self.scene, unit, FATES[name]))
        whole["fate_fate"].attrs.pop("units")  # a word
        if self._path is not None or (self._parts and self.scene.run.trajectory):
            whole = whole.merge(self.trajectory, combine_attrs="override")
        whole.attrs = self._told() | {"end": self.time}
        return whole

    @classmethod
    def of_dataset(cls, scene: Any, whole: xr.Dataset) -> CloudResult:
        """From what `dataset` made.

        Parameters
        ----------
        scene : Scene
        whole : Dataset
            What `dataset` made, units as there.

        Returns
        -------
        CloudResult
        """
        told = whole.attrs
        jumps = table_in(whole, "jump", no_jumps())
        met = table_in(whole, "encounter", no_encounters())
        fates = table_in(whole, "fate", fate_table([]))
        rows = list(map(list, zip(fates["grain"], fates["time"], fates["fate"], strict=True)))
        provenance = json.loads(told["provenance"])
        return cls(scene, jumps, met, fate_table(rows), told["status"], told["message"], provenance, told["end"], path_in(scene, whole))


def tables_to_dataset(scene: Any, jumps: pd.DataFrame, met: pd.DataFrame) -> xr.Dataset:
    """Tables of jumps and encounters as variables."""
    told = UNITS | {"grain": ("1", "number of the grain")}
    data: dict[str, Any] = {f"jump_{name}": ("jump", jumps[name].to_numpy(), told_of(scene, *told[str(name)])) for name in jumps}
    data |= {f"encounter_{name}": ("encounter", met[name].to_numpy(), told_of(scene, encounter_unit(name), name.replace("_", " "))) for name in met}
    return xr.Dataset(data)


def no_jumps() -> pd.DataFrame:
    """A table of jumps without a row."""
    table = table_of(np.zeros((0, len(flight.COLUMNS))), 1.0)
    table.insert(0, "grain", np.zeros(0, dtype=np.int32))
    return table


def no_encounters() -> pd.DataFrame:
    """A table of encounters without a row."""
    return encounter_table(np.zeros((0, len(encounters.COLUMNS))))


def encounter_table(rows: Floats) -> pd.DataFrame:
    """The table of encounters from the rows that a run records."""
    columns: dict[str, Any] = dict(zip(encounters.COLUMNS, rows.T, strict=True))
    return pd.DataFrame({name: values.astype(np.int32) if name in WHOLE else values for name, values in columns.items()})


def path_dataset(scene: Any, times: Floats, values: Floats) -> xr.Dataset:
    """Paths from samples (time, grain, 2·dimensions)."""
    names = "xyz" if values.shape[2] == 6 else "xz"
    speeds = {"x": "u", "y": "v", "z": "w"}
    data = {name: (("time", "grain"), values[:, :, k], told_of(scene, "d", AXES[name])) for k, name in enumerate(names)}
    for k, name in enumerate(names):
        data[speeds[name]] = ("time", "grain"), values[:, :, len(names) + k], told_of(scene, "u*", f"velocity along {name}")
    coordinates = {"time": ("time", times, told_of(scene, "d/u*", "time")), "grain": np.arange(values.shape[1], dtype=np.int32)}
    numbers = scene.numbers
    return xr.Dataset(data, coords=coordinates, attrs={"diameter": numbers.diameter, "velocity": numbers.velocity})


def fate_table(rows: list[list[Any]]) -> pd.DataFrame:
    """The table of fates from what a run notes."""
    rows = sorted(rows, key=lambda row: (row[1], row[0]))
    grains, times, fates = ([row[k] for row in rows] for k in range(3))
    return pd.DataFrame({"grain": np.array(grains, dtype=np.int32), "time": np.array(times, dtype=np.float64), "fate": np.array(fates, dtype=np.str_)})


def ordered(jumps: pd.DataFrame) -> pd.DataFrame:
    """Jumps by grain and time."""
    return jumps.sort_values(["grain", "start"], kind="stable", ignore_index=True)


STOPPED = ("unfinished", "the run was stopped: the same command goes on from there")
WORDS = {"parts", "time", "status", "message", "fates", "provenance", "scene", "key"}  # of run.json


def words_in(folder: Path) -> dict[str, Any]:
    """What run.json says.

    Raises
    ------
    OSError
        If it cannot be read.
    DamageError
        If it is not what was written.
    """
    file = folder / "run.json"
    content = file.read_bytes()
    try:
        told: dict[str, Any] = json.loads(content)
        check = told.pop("check", None)
        whole = set(told) == WORDS and (check is None or check == hash_of(json.dumps(told)))
    except (ValueError, TypeError, AttributeError, RecursionError):
        whole = False
    if not whole:
        raise DamageError(f"{str(file)!r} is damaged: take a copy, or start the run anew with --force")
    return told


def words_of(told: dict[str, Any]) -> str:
    """What run.json holds to say so."""
    return json.dumps(told | {"check": hash_of(json.dumps(told))}, indent=1) + "\n"


def part_in(file: Path, number: int, key: str | None) -> xr.Dataset:
    """A part of a run.

    Raises
    ------
    OSError
        If it cannot be read.
    DamageError
        If it is not what was written, or of another run.
    """
    found = open_dataset(file)
    own = found.attrs.get("part", number) == number and key in (None, found.attrs.get("key", key))
    if not own or ("part" not in found.attrs and "jump_start" not in found):
        raise DamageError(f"{str(file)!r} is no part {number} of this run: take a copy of its own, or start the run anew with --force")
    return found


def open_folder(folder: Path, count: int | None = None) -> CloudResult:
    """The result in the folder of a long run, as far as it has come, or its first so many parts.

    Raises
    ------
    ValueError
        If it is no such folder, or a file of it is not what was written.
    """
    try:
        told = words_in(folder)
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
    return CloudResult(scene, whole, met_all, left, status, message, provenance, time, None, files)
