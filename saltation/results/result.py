"""What a run leaves: the jumps, the path, the forces along it, and how it came about; saved as netCDF."""

from __future__ import annotations

import json
import math
import os
import platform
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.polynomial import legendre

from basset import __version__
from basset.kernels import Floats
from basset.solvers import stepper
from saltation import regressions, statistics
from saltation._files import DamageError, content_of, open_dataset, store
from saltation.effects import EFFECTS
from saltation.flight import loop as flight
from saltation.flight.setup import REST, Engine
from saltation.scene import scene_of

__all__ = ["Result", "open_result"]

UNITS = {  # of the table of jumps
    "start": ("d/u*", "time of takeoff"),
    "duration": ("d/u*", "from impact to impact"),
    "length": ("d", "along the stream"),
    "drift": ("d", "across the stream"),
    "height": ("d", "rise above the previous impact"),
    "height_above_bed": ("d", "highest point of the centre above the bed level"),
    "velocity": ("u*", "length over duration"),
    "spin": ("u*/d", "mean ω_y of the flight"),
    "takeoff_angle": ("degree", "above the stream's direction, just after the impact"),
    "incidence_angle": ("degree", "below the stream's direction, just before the impact"),
    "deviation_angle": ("degree", "of the jump from the stream's direction, in plan"),
    "takeoff_x": ("u*", "velocity just after the impact, along the stream"),
    "takeoff_y": ("u*", "across"),
    "takeoff_z": ("u*", "up"),
    "impact_x": ("u*", "velocity just before the impact that ends the jump, along the stream"),
    "impact_y": ("u*", "across"),
    "impact_z": ("u*", "up"),
    "stokes": ("1", "collision Stokes number of the impact"),
    "tilt": ("degree", "θ_b of the contact"),
    "clipped": ("1", "whether θ_b was cut at 30°"),
    "impulse_x": ("m u*", "impulse of the bed on the grain, along the stream, per grain mass"),
    "impulse_y": ("m u*", "across"),
    "impulse_z": ("m u*", "up"),
    "contacts": ("1", "contacts at the impact before the grain moved up"),
}
SI = {  # of a unit of length d and of velocity V: the SI unit, and how often d and V go into it
    "d": ("m", 1, 0),
    "d/u*": ("s", 1, -1),
    "u*": ("m s-1", 0, 1),
    "u*/d": ("rad s-1", -1, 1),
    "u*2/d": ("m s-2", -1, 2),
    "m u*": ("m s-1", 0, 1),
}
CREEP = 0.1  # d: lower jumps are counted as creeping


def told_of(scene: Any, unit: str, text: str) -> dict[str, Any]:
    """Attributes of a variable by the conventions CF: what is measured in d and u* is dimensionless, and says what it is a multiple of."""
    if unit not in SI:
        return {"units": unit, "long_name": text}
    numbers = scene.numbers
    name, lengths, velocities = SI[unit]
    factor = float(numbers.diameter**lengths * numbers.velocity**velocities)
    return {"units": "1", "long_name": text, "scale": numbers.unit(unit), "si_units": name, "si_factor": factor}


def table_of(rows: Floats, stokes: float) -> pd.DataFrame:
    """The table of jumps from the rows that a flight records; `stokes` is the collision Stokes number of unit speed."""
    c = dict(zip(flight.COLUMNS, rows.T, strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity, spin = c["length"] / c["duration"], c["turned"] / c["duration"]
    columns = {
        "start": c["start"],
        "duration": c["duration"],
        "length": c["length"],
        "drift": c["drift"],
        "height": c["rise"],
        "height_above_bed": c["z"] + c["rise"],
        "velocity": velocity,
        "spin": spin,
        "takeoff_angle": np.degrees(np.arctan2(c["w"], c["u"])),
        "incidence_angle": np.degrees(np.arctan2(-c["w_in"], c["u_in"])),
        "deviation_angle": np.degrees(np.arctan2(c["drift"], c["length"])),
        "takeoff_x": c["u"],
        "takeoff_y": c["v"],
        "takeoff_z": c["w"],
        "impact_x": c["u_in"],
        "impact_y": c["v_in"],
        "impact_z": c["w_in"],
        "stokes": stokes * c["normal_speed"],
        "tilt": np.degrees(c["tilt"]),
        "clipped": c["clipped"],
        "impulse_x": c["impulse_x"],
        "impulse_y": c["impulse_y"],
        "impulse_z": c["impulse_z"],
        "contacts": c["contacts"],
    }
    return pd.DataFrame(columns)


def that_count(jumps: pd.DataFrame, number: Any, discard: int) -> pd.DataFrame:
    """The jumps from number `discard` on that are flights.

    A grain that comes to rest, or has just touched the bed and is hit from above, touches it again at once: two impacts with
    no flight between (shorter than `engine.REST`), which have neither a velocity nor a spin.
    """
    return jumps[(number >= discard) & (jumps["duration"] > REST)].reset_index(drop=True)


class Kept:
    """What all results have in common: the attributes of their dataset, and how it becomes a file."""

    scene: Any
    status: str
    message: str
    provenance: dict[str, Any]

    def dataset(self) -> xr.Dataset:
        """Everything as one dataset.

        Returns
        -------
        Dataset
            Units in the variables' attributes.

        Examples
        --------
        >>> import saltation
        >>> result = saltation.run(saltation.load("bouncing"))
        >>> result_of(result.dataset()).jumps.equals(result.jumps)
        True
        """
        raise NotImplementedError  # one grain and many have each their own

    def _told(self) -> dict[str, Any]:
        numbers = self.scene.numbers
        return {
            "scene": self.scene.model_dump_json(exclude_none=True),
            "status": self.status,
            "message": self.message,
            "provenance": json.dumps(self.provenance),
            "diameter": numbers.diameter,
            "velocity": numbers.velocity,
            "velocity_scale": numbers.scale,
        }

    def to_si(self) -> xr.Dataset:
        """Everything as one dataset in SI units; angles stay in degrees.

        Returns
        -------
        Dataset
            As `dataset`, in m, s, m s-1, rad s-1 and m s-2; impulses per mass of the grain. Units in the variables' attributes.

        Examples
        --------
        >>> import saltation
        >>> result = saltation.run(saltation.load("bouncing"))
        >>> height = result.to_si()["jump_height"]
        >>> height.attrs["units"], bool(abs(height[0] / result.scene.grain.diameter - result.jumps["height"][0]) < 1e-12)
        ('m', True)
        """
        whole = self.dataset()
        changed = {}
        for name, variable in whole.variables.items():
            attrs = dict(variable.attrs)
            if "si_factor" in attrs:
                attrs["units"], factor = attrs.pop("si_units"), attrs.pop("si_factor")
                del attrs["scale"]
                changed[name] = (variable.dims, variable.to_numpy() * factor, attrs)
        return whole.assign({name: value for name, value in changed.items() if name in whole.data_vars}).assign_coords(
            {name: value for name, value in changed.items() if name in whole.coords}
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write netCDF, atomically: to a temporary file beside `path` that is then renamed.

        Parameters
        ----------
        path : path
            The file; one that is there is replaced.

        Raises
        ------
        OSError
            If the folder does not exist or cannot be written; nothing is left behind.

        Examples
        --------
        >>> import tempfile
        >>> import saltation
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     saltation.run(saltation.load("bouncing")).save(Path(folder) / "out.nc")
        ...     saltation.open(Path(folder) / "out.nc").status
        'finished'
        """
        store(self.dataset(), path)


@dataclass(eq=False)
class Result(Kept):
    """A run of one grain. Lengths in d, velocities in u* (in still water in the V of `saltation.grain`), times in d/u*.

    Attributes
    ----------
    scene : Scene
    all_jumps : DataFrame
        One row per jump from the first on; columns and units in `saltation.results.result.UNITS`.
    status, message : str
        finished, at rest, creeping, aloft, horizon or failed; and why.
    provenance : dict
        Profile, roughness, reading, rebound memory, source of e, range of St, shares of impacts that were clipped, creep or
        lie outside a closure's range, versions, seed.

    Examples
    --------
    >>> import saltation
    >>> result = saltation.run(saltation.load("bouncing"))
    >>> len(result.jumps), int(result.summary().loc["height", "count"])
    (5, 5)
    >>> bool(result.trajectory["z"].min() > 0.49)  # of the centre: the grain never sinks into the bed
    True
    """

    scene: Any
    all_jumps: pd.DataFrame
    status: str
    message: str
    provenance: dict[str, Any]
    _path: xr.Dataset | None = None
    _engine: Engine | None = None
    _record: stepper.Record | None = None
    _spins: Floats | None = None

    @classmethod
    def of(cls, engine: Engine, rows: Floats, record: stepper.Record | None, status: str, message: str, spin: Floats) -> Result:
        """From what the flights recorded.

        Parameters
        ----------
        engine : Engine
            Of the run.
        rows : ndarray (jumps, columns)
            Columns and their order as in `saltation.flight.loop.COLUMNS`: lengths in d, velocities in V, times in d/V.
        record : Record or None
            The accepted steps; None where the path is not kept.
        status, message : str
            As of `Result`.
        spin : ndarray (3,), V/d
            Of a last flight without impact.

        Returns
        -------
        Result

        Examples
        --------
        >>> import saltation
        >>> from saltation.flight.setup import Engine
        >>> from saltation.flight.loop import COLUMNS
        >>> scene = saltation.load("bouncing")
        >>> len(Result.of(Engine(scene), np.zeros((0, len(COLUMNS))), None, "aloft", "it never came down", np.zeros(3)).jumps)
        0
        """
        spins = np.vstack([rows[:, -3:], spin])  # at the end of every flight
        jumps = table_of(rows, engine.numbers.stokes(1.0))
        counted = that_count(jumps, jumps.index, engine.scene.run.discard)
        return cls(engine.scene, jumps, status, message, provenance(engine, counted), None, engine, record, spins)

    @property
    def jumps(self) -> pd.DataFrame:
        """The jumps that count: without the first `run.discard`, and without flights that are none (shorter than `engine.REST`, d/u*).

        Units are in `saltation.results.result.UNITS`.
        """
        return that_count(self.all_jumps, self.all_jumps.index, self.scene.run.discard)

    def summary(self) -> pd.DataFrame:
        """Mean, standard deviation, standard error (block bootstrap) and number, one row per column of `jumps`.

        Returns
        -------
        DataFrame, one row per column of `jumps`
            mean, standard_deviation, standard_error and count, in the units of the column.
        """
        return statistics.summary(self.jumps)

    @cached_property
    def trajectory(self) -> xr.Dataset:
        """The path at the nodes of every step: x, y, z, u, v, w, spin and the forces on the grain, against time.

        Units are in the variables' attributes; the dataset's give diameter (m) and velocity (m/s) to convert them.

        Raises
        ------
        ValueError
            If the scene keeps no path (run.trajectory = false).
        """
        if self._path is not None:
            return self._path
        if self._engine is None or self._spins is None or not self.scene.run.trajectory:
            raise ValueError("trajectory was not kept: set run.trajectory = true")
        return path_of(self._engine, self._record, self._spins)

    def budget(self, phases: int = 40) -> pd.DataFrame:
        """Mean forces over the phase of the jump, thesis figs 3-14 to 3-16.

        Parameters
        ----------
        phases : int
            How many.

        Returns
        -------
        DataFrame, one row per phase (0 takeoff, 1 impact)
            phase; x, z (d from takeoff, z from the bed level); every force along the stream (`drag_x` …) and up (`drag_z` …) as
            accelerations in u*²/d; means over all jumps that count.

        Raises
        ------
        ValueError
            If the path was not kept or no jump counts.

        Examples
        --------
        >>> import saltation
        >>> frame = saltation.run(saltation.load("bouncing")).budget(phases=10)
        >>> len(frame), bool((frame["weight_z"] < 0.0).all())
        (10, True)
        """
        return budget_of(self, phases)

    def diffusion(self, lags: Floats | None = None) -> pd.DataFrame:
        """Second moments of the displacement along and across the stream, thesis fig. 3-17.

        The ensemble is all takeoffs that count and lie long enough before the end.

        Parameters
        ----------
        lags : ndarray (m,), d/u*, or None
            Times after a takeoff; None: 40, evenly spaced in their logarithm.

        Returns
        -------
        DataFrame, one row per lag
            lag (d/u*), x, y (d²).

        Raises
        ------
        ValueError
            If the path was not kept or fewer than two takeoffs count.

        References
        ----------
        Nikora et al. (2001), J. Phys. A 34, L743–L749; thesis (3-7), (3-8).

        Examples
        --------
        >>> import saltation
        >>> frame = saltation.run(saltation.load("bouncing")).diffusion(np.array([0.5, 1.0]))
        >>> frame["y"].tolist()  # nothing moves it across
        [0.0, 0.0]
        """
        path, jumps = self.trajectory, self.jumps
        if len(jumps) < 2:
            raise ValueError(f"diffusion needs at least two jumps that count, got {len(jumps)}")
        end = float(path["time"][-1])
        if lags is None:
            longest = 0.1 * (end - float(jumps["start"].iloc[0]))
            lags = np.geomspace(0.02 * float(jumps["duration"].mean()), longest, 40)
        starts = jumps["start"].to_numpy()
        starts = starts[starts + lags[-1] <= end]
        positions = np.stack([path["x"].to_numpy(), path["y"].to_numpy() if "y" in path else np.zeros(path.sizes["time"])], axis=1)
        moments = statistics.second_moments(path["time"].to_numpy(), positions, starts, lags)
        return pd.DataFrame({"lag": lags, "x": moments[:, 0], "y": moments[:, 1]})

    def bed_load(self) -> dict[str, float]:
        """Dynamic friction μ_d = −ΣJ_x/ΣJ_z of the impacts and the bed-load rate q* that it implies, beside two formulas.

        Returns
        -------
        dict, dimensionless
            dynamic_friction (μ_d), rate (q*), and q* by the formulas meyer_peter_mueller and wong_parker.

        Raises
        ------
        ValueError
            In still water, and if no jump counts.

        References
        ----------
        `saltation.regressions.bed_load`: Bagnold (1956); Meyer-Peter and Müller (1948); Wong and Parker (2006).

        Examples
        --------
        >>> import saltation
        >>> from saltation.scene import read, scene_of
        >>> load = saltation.run(scene_of(read("sand") | {"run": {"jumps": 40}})).bed_load()
        >>> 0.0 < load["dynamic_friction"] < 1.0, load["rate"] > 0.0
        (True, True)
        """
        numbers = self.scene.numbers
        if numbers.stage is None:
            raise ValueError("bed load needs a stream: the scene has no [channel]")
        jumps = self.jumps
        if not len(jumps):
            raise ValueError("bed load needs a jump that counts: there is none")
        friction = -float(jumps["impulse_x"].sum() / jumps["impulse_z"].sum())
        speed = float(jumps["length"].sum() / jumps["duration"].sum())
        rate = float(regressions.bed_load(numbers.shields, numbers.critical_shields, speed, friction))
        return {
            "dynamic_friction": friction,
            "rate": rate,
            "meyer_peter_mueller": float(regressions.meyer_peter_mueller(numbers.shields)),
            "wong_parker": float(regressions.wong_parker(numbers.shields)),
        }

    def dataset(self) -> xr.Dataset:
        """Everything as one dataset: the jumps along `jump`, the path along `time` if it was kept, the rest as attributes.

        Returns
        -------
        Dataset
            Units in the variables' attributes.

        Examples
        --------
        >>> import saltation
        >>> saltation.run(saltation.load("bouncing")).dataset()["jump_height"].attrs["scale"]
        'd'
        """
        table = self.all_jumps
        whole = xr.Dataset({f"jump_{name}": ("jump", table[name].to_numpy(), told_of(self.scene, *UNITS[str(name)])) for name in table})
        if self._path is not None or (self._engine is not None and self.scene.run.trajectory):
            whole = whole.merge(self.trajectory, combine_attrs="override")
        whole.attrs = self._told()
        return whole


def open_result(path: str | os.PathLike[str], parts: int | None = None) -> Any:
    """A result from a file that `Result.save` or `CloudResult.save` wrote, or from the folder of a long run, finished or not.

    Parameters
    ----------
    path : path
        A file, or the folder of a long run.
    parts : int, optional
        Of a folder, how many parts to read, from the first on: those before one that is damaged. Default all.

    Returns
    -------
    Result or CloudResult

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
    from saltation.results.cloud import open_folder

    place = Path(path)
    if place.is_dir():
        return open_folder(place, parts)
    if parts is not None:
        raise ValueError(f"parts is for the folder of a long run, got the file {str(place)!r}")
    return result_in(open_dataset(place), repr(str(place)))


def result_in(whole: xr.Dataset, name: str) -> Any:
    """The result in a dataset from a file of that name."""
    if "scene" not in whole.attrs:
        raise DamageError(f"{name} is no saltation result: it has no scene")
    try:
        return result_of(whole)
    except Exception as error:  # only where no checksum was kept does it come to this
        raise DamageError(f"{name} is no saltation result that can be read: {' '.join(str(error).split())}") from None


def packed(result: Any, key: str) -> bytes:
    """A result as the content of a file that can be opened, with the name of its scene for `key_in`."""
    return content_of(result.dataset().assign_attrs(key=key))


def unpacked(content: bytes) -> Any:
    """The result that was packed."""
    return result_of(open_dataset(content))


def key_in(path: Path) -> Any:
    """The key that a packed result in a file has; None if there is none, or the file is not whole."""
    try:
        return open_dataset(path).attrs.get("key")
    except (OSError, ValueError):
        return None


def result_of(whole: xr.Dataset) -> Any:
    """The result whose `dataset` it is."""
    from saltation.results.cloud import CloudResult

    scene = scene_of(json.loads(whole.attrs["scene"]))
    if scene.cloud is not None:
        return CloudResult.of_dataset(scene, whole)
    jumps = table_in(whole, "jump", table_of(np.zeros((0, len(flight.COLUMNS))), 1.0))
    told = whole.attrs
    return Result(scene, jumps, told["status"], told["message"], json.loads(told["provenance"]), path_in(scene, whole))


def path_in(scene: Any, whole: xr.Dataset) -> xr.Dataset | None:
    """The path of a dataset; None if none was kept."""
    names = [name for name in whole.data_vars if "time" in whole[name].dims]
    if not names:
        return None
    path = whole[names]
    path.attrs = {key: whole.attrs[key] for key in ("diameter", "velocity")}
    for name in (*names, "time"):
        attrs = path[name].attrs
        if attrs["units"] in SI:  # of a file that was written with units of our own
            path[name].attrs = told_of(scene, attrs["units"], attrs["long_name"])
    return path


def table_in(whole: xr.Dataset, name: str, empty: pd.DataFrame) -> pd.DataFrame:
    """The table whose columns are kept as variables with a prefix; the empty one if none are."""
    found = {str(key).removeprefix(f"{name}_"): whole[key].to_numpy() for key in whole.data_vars if str(key).startswith(f"{name}_")}
    if found and set(found) != set(empty):
        raise ValueError(f"the table of {name}s has other columns")
    return pd.DataFrame({column: found[column] for column in empty}) if found else empty


def path_of(engine: Engine, record: stepper.Record | None, spins: Floats) -> xr.Dataset:
    """The path from the recorded steps: at every takeoff and at the nodes of every step up to where it was cut; the start alone where none was flown."""
    tables = engine.tables
    count = tables.count
    if record is not None:
        which = np.cumsum(np.append(0, record.leapt[:-1] > 0.0))  # flight of each step
        length = np.bincount(which, record.share * record.size)
        flown = (record.share > 0.0) & ((length > REST)[which] | (which == which[-1]))  # a rebound may leave no flight at all, but for rounding
    if record is None or not flown.any():
        start = engine.first()
        state = engine.state_of(start)[None]
        return path_at(engine, np.zeros(1), state, np.full_like(state, np.nan), np.array([start.spin]))
    which = which[flown]
    record = stepper.Record(*(array[flown] for array in record))
    singular = record.kind == 1.0
    takeoff = np.zeros(len(record.start), dtype=bool)
    takeoff[0] = True
    takeoff[1:] = record.leapt[:-1] > 0.0
    theta = record.share[:, None] * np.concatenate([[0.0], tables.nodes.c])  # (step, place)
    x = 2.0 * np.where(singular[:, None], np.sqrt(theta), theta) - 1.0
    basis = legendre.legvander(x, count)  # (step, place, degree)
    rises = np.where(singular[:, None, None], tables.nodes.singular, record.size[:, None, None] * tables.nodes.rise)
    states = record.y[:, None, :] + np.einsum("spd,sdk,ska->spa", basis, rises, record.values, optimize=True)
    states[:, 0] = record.y
    slopes = np.zeros((len(theta), count, count))  # of the node values, at the places behind the first
    regular = ~singular
    slopes[regular] = np.einsum("spd,dk->spk", basis[regular, 1:, :count], tables.nodes.regular)
    inner = legendre.legvander(x[singular, 1:], count - 1)
    derivative = 2.0 * legendre.legder(tables.nodes.singular)  # of the basis in σ
    slopes[singular] = np.einsum("spd,dk->spk", inner, derivative) / (2.0 * np.sqrt(theta[singular, 1:]) * record.size[singular, None])[..., None]
    rates = np.full_like(states, np.nan)
    rates[:, 1:] = np.einsum("spk,ska->spa", slopes, record.values, optimize=True)
    times = record.start[:, None] + record.size[:, None] * theta
    wanted = np.ones(theta.shape, dtype=bool)
    wanted[:, 0] = takeoff
    return path_at(engine, times[wanted], states[wanted], rates[wanted], spins[np.broadcast_to(which[:, None], wanted.shape)[wanted]])


def path_at(engine: Engine, times: Floats, states: Floats, rates: Floats, spins: Floats) -> xr.Dataset:
    """The path from times (points,), states and their rates (points, states), rates NaN where unknown; `spins` (points, 3) where they are no states."""
    d = engine.dimensions
    if engine.rotation is not None:
        spins = np.zeros((len(times), 3))
        spins[:, [1] if d == 2 else [0, 1, 2]] = states[:, 2 * d :]
    stream = np.array([engine.scene.profile.both(z)[0] for z in states[:, d - 1]])
    shear = np.array([engine.scene.profile.both(z)[1] for z in states[:, d - 1]])
    slip = np.zeros((len(times), 3))
    slip[:, [0, 2] if d == 2 else [0, 1, 2]] = states[:, d : 2 * d]
    situations = np.column_stack([states[:, d - 1], slip, stream, shear, spins])
    forces = np.zeros((len(times), 3 * len(engine.force_names)))
    flight.budget(engine.equation, situations, forces)
    columns: dict[str, Any] = {"x": (states[:, 0], "d", "along the stream")}
    if d == 3:
        columns["y"] = states[:, 1], "d", "across the stream"
    columns["z"] = states[:, d - 1], "d", "above the bed level"
    columns["u"] = slip[:, 0] + stream, "u*", "velocity along the stream"
    if d == 3:
        columns["v"] = slip[:, 1], "u*", "velocity across the stream"
    columns["w"] = slip[:, 2], "u*", "velocity up"
    if engine.scene.turns:
        for k, axis in enumerate("xyz"):
            if d == 3 or axis == "y":
                columns[f"spin_{axis}"] = spins[:, k], "u*/d", f"angular velocity about {axis}"
    axes = {"x": 0, "y": 1, "z": 2} if d == 3 else {"x": 0, "z": 2}
    for k, name in enumerate(engine.force_names):
        for axis, place in axes.items():
            columns[f"{name}_{axis}"] = forces[:, 3 * k + place], "u*2/d", f"acceleration by {name}"
    if engine.members:
        acceleration = rates[:, d : 2 * d].copy()
        acceleration[:, 0] += shear * slip[:, 2]
        told = "acceleration by the history force (NaN at takeoff: infinite)"
        for k, (axis, place) in enumerate(axes.items()):
            columns[f"history_{axis}"] = acceleration[:, k] - forces[:, place::3].sum(axis=1), "u*2/d", told
    data = {name: ("time", values, told_of(engine.scene, unit, text)) for name, (values, unit, text) in columns.items()}
    numbers = engine.numbers
    coordinate = ("time", times, told_of(engine.scene, "d/u*", "time"))
    return xr.Dataset(data, coords={"time": coordinate}, attrs={"diameter": numbers.diameter, "velocity": numbers.velocity})


def budget_of(result: Result, phases: int) -> pd.DataFrame:
    """See `Result.budget`."""
    path, jumps = result.trajectory, result.jumps
    if not len(jumps):
        raise ValueError("budget needs a jump that counts: there is none")
    time = path["time"].to_numpy()
    names = [str(name) for name in path.data_vars if str(name).endswith(("_x", "_z")) and not str(name).startswith("spin")]
    values = np.stack([path[name].to_numpy() for name in ["x", "z", *names]], axis=1)
    phase = (np.arange(phases) + 0.5) / phases
    total = np.zeros((phases, values.shape[1]))
    ends = (jumps["start"] + jumps["duration"]).to_numpy()
    first = np.searchsorted(time, jumps["start"].to_numpy() * (1.0 + 1e-14), side="right")
    last = np.searchsorted(time, ends * (1.0 - 1e-14), side="left")
    used = 0
    for low, high, start, duration in zip(first, last, jumps["start"], jumps["duration"], strict=True):
        if high - low < 2:
            continue
        used += 1
        here, x0 = (time[low : high + 1] - start) / duration, float(path["x"][low - 1]) if low else 0.0
        for k in range(values.shape[1]):
            column = values[low : high + 1, k]
            total[:, k] += np.interp(phase, here, column - x0 if k == 0 else column)
    frame = pd.DataFrame(total / max(used, 1), columns=["x", "z", *names])
    frame.insert(0, "phase", phase)
    return frame


def provenance(engine: Engine, counted: pd.DataFrame) -> dict[str, Any]:
    """How a result came about; `counted`: the jumps that count."""
    return origin(engine) | shares(counted)


def shares(counted: pd.DataFrame) -> dict[str, Any]:
    """Range of St, and shares of the impacts that were clipped or creep."""
    if not len(counted):
        return {"stokes": None, "clipped": math.nan, "creeping": math.nan}
    stokes = counted["stokes"]
    clipped, creeping = float((counted["clipped"] > 0.0).mean()), float((counted["height"] < CREEP).mean())
    return {"stokes": [float(stokes.min()), float(stokes.max())], "clipped": clipped, "creeping": creeping}


def origin(engine: Engine) -> dict[str, Any]:
    """What a result says about its scene before anything has moved."""
    scene, numbers = engine.scene, engine.numbers
    bed = scene.bed
    history = scene.options("history") if "history" in scene.names else None
    return {
        "profile": scene.channel.profile if scene.channel else "none",
        "roughness_height": (scene.channel.roughness_height or scene.grain.diameter) if scene.channel else None,
        "bed_level": "a quarter of a diameter below the crests" if bed is not None and bed.roughness != "flat" else "the plane",
        "roughness": bed.roughness if bed else None,
        "reading": bed.reading if bed else None,
        "rebound": bed.rebound if bed else None,
        "contact_mass": bed.contact_mass if bed else None,
        "restitution": bed.restitution if bed else None,
        "rebound_memory": history.rebound if history else None,
        "kernel": history.kernel if history else None,
        "scheme": history.scheme if history else None,
        "solver": scene.solver.model_dump(exclude_none=True),
        "outside_validity": [text for name in scene.names for text in _warnings(name, scene, numbers)],
        "seed": scene.run.seed,
        "versions": {"basset": __version__} | {name: version(name) for name in ("numpy", "numba", "xarray")} | {"python": platform.python_version()},
    }


def _warnings(name: str, scene: Any, numbers: Any) -> list[str]:
    """What an effect has to say about its range in this scene."""
    found = getattr(EFFECTS[name], "warnings", None)
    return found(scene.options(name), numbers) if found is not None else []
