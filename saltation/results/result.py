"""The result of a run of one or many grains: jumps, encounters, paths and provenance; saved as netCDF."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from basset import __version__
from basset.kernels import Floats
from saltation import regressions, statistics
from saltation._files import store
from saltation.effects import warnings_of
from saltation.grain import GRAVITY
from saltation.results.tables import COUPLED, FATES, STREAM, attributes_of, counted_jumps, fate_table, no_encounters, shares, tables_to_dataset
from saltation.scene import Scene
from saltation.scene.valid import left

__all__ = ["Result"]


@dataclass(eq=False)
class Result:
    """Result of a run of one or many grains. Lengths in d, velocities in u* (in still water in the V of `saltation.grain`), times in d/u*.

    Attributes
    ----------
    scene : Scene
    all_jumps : DataFrame
        One row per jump from the first on, in the order of grains and time; columns and units in `saltation.results.tables.UNITS`.
    status, message : str
        finished, at rest, creeping, aloft, horizon or failed, with two-way coupling unsettled (stream and grains do not agree), of many
        grains also pile-up, or unfinished (a run that was stopped and can go on); and why.
    provenance : dict
        Profile, roughness, reading (range of contact angles), rebound_memory (treatment of the history force at impacts), restitution,
        range of St, shares of impacts clipped and of jumps that creep (below 0.1 d), laws used outside their ranges, versions, seed; with
        encounters also their law, the box (d), and how many steps were too short to be resolved.
    time : float, d/u*
        How far the run has come.
    encounters : DataFrame
        One row per encounter in the order of time: `first` and `second` grain, place of the first, unit normal from the first
        to the second, distance of the centres, restitution that was applied (greater than e where grains would have separated
        more slowly than encounters.slowest), velocities and spins of both before and after, impulse on the first; units by
        `saltation.results.tables.encounter_unit`.
    fates : DataFrame
        Of many grains, those that left the run before its end, in the order of time: grain, time (d/u*), fate (at rest, creeping, aloft).
    path : Dataset, or callable that gives it, or None
        What `trajectory` gives, with units as there; None if it was not stored.

    Examples
    --------
    >>> import saltation
    >>> result = saltation.run(saltation.load("bouncing"))
    >>> len(result.jumps), int(result.summary().loc["height", "count"])
    (5, 5)
    >>> bool(result.trajectory["z"].min() > 0.49)  # of the centre: the grain never sinks into the bed
    True
    >>> from saltation.scene import read, scene_of
    >>> many = saltation.run(scene_of(read("sand_cloud") | {"run": {"duration": 0.1}}))
    >>> many.status, many.jumps["grain"].nunique() <= 45
    ('finished', True)
    >>> frequencies = many.frequencies()
    >>> bool(abs(frequencies["bed"] * many.time - len(many.all_jumps)) < 1e-9)
    True
    >>> len(many.profiles(bins=10))
    10
    """

    scene: Scene
    all_jumps: pd.DataFrame
    status: str
    message: str
    provenance: dict[str, Any]
    time: float
    encounters: pd.DataFrame = field(default_factory=no_encounters)
    fates: pd.DataFrame = field(default_factory=lambda: fate_table([]))
    path: xr.Dataset | Callable[[], xr.Dataset] | None = None

    def __post_init__(self) -> None:
        """Complete the provenance; a run is not finished where stream and grains do not agree."""
        self.provenance = self.provenance | shares(self.jumps)
        coupling = self.scene.coupling
        if coupling is not None and (made := coupling.settled) is not None and self.status == "finished" and made.change > coupling.tolerance:
            self.status = "unsettled"
            told = f"after {made.runs} runs the stresses of stream and grains miss their sum by {made.change:.2g} ρu*², more than {coupling.tolerance:g}"
            remedy = "more jumps"
            if made.averaged:
                told += f", two standard errors of the mean over {made.averaged}"
                remedy += f", coupling.runs = {made.runs + math.ceil(made.averaged * ((made.change / coupling.tolerance) ** 2 - 1.0))}"
            self.message = f"coupling: {told}: take {remedy}, or a greater coupling.tolerance"

    @property
    def jumps(self) -> pd.DataFrame:
        """The jumps that count: without the first `run.discard` of each grain, and without flights that are none (shorter than 1e-5 d/u*).

        Units are in `saltation.results.tables.UNITS`.
        """
        return counted_jumps(self.all_jumps, self.all_jumps.groupby("grain").cumcount(), self.scene.run.discard)

    @property
    def rested(self) -> NDArray[np.bool_]:
        """Which of `all_jumps` set out from a rest, dimensionless."""
        grain, start = self.all_jumps["grain"].to_numpy(), self.all_jumps["start"].to_numpy()
        ends = start + self.all_jumps["duration"].to_numpy()
        lay = (grain[1:] == grain[:-1]) & (start[1:] - ends[:-1] > 1e-9 * (1.0 + ends[:-1]))
        return np.append(False, lay)[: len(start)]

    @property
    def rests(self) -> pd.DataFrame:
        """The rests of a scene with [rests] that ended within the run, one row each: grain, start and duration (d/u*)."""
        jumps = self.all_jumps
        after = np.flatnonzero(self.rested)
        ends = (jumps["start"] + jumps["duration"]).to_numpy()[after - 1]
        return pd.DataFrame({"grain": jumps["grain"].to_numpy()[after], "start": ends, "duration": jumps["start"].to_numpy()[after] - ends})

    def resting(self) -> float:
        """Number of grains at rest per moving grain: the time of rests over that of jumps; for many grains from the stored positions.

        Returns
        -------
        float, dimensionless

        Raises
        ------
        ValueError
            For many grains whose path was not stored.

        Examples
        --------
        >>> import saltation
        >>> saltation.run(saltation.load("bouncing")).resting()
        0.0
        """
        if self.scene.cloud is None:
            return float(self.rests["duration"].sum() / self.all_jumps["duration"].sum())
        speed = self.trajectory["u"].to_numpy()
        return float((speed == 0.0).sum() / np.isfinite(speed[speed != 0.0]).sum())

    def summary(self) -> pd.DataFrame:
        """Mean, standard deviation, standard error (block bootstrap over the jumps of a grain in turn) and number.

        Returns
        -------
        DataFrame, one row per column of `jumps` but the grain
            mean, standard_deviation, standard_error and count, in the units of the column; with two-way coupling also what `coupled`
            says of the whole stream, without deviation and error.
        """
        found = statistics.summary(self.jumps.drop(columns="grain"))
        made = self.scene.coupling and self.scene.coupling.settled
        if not made:
            return found
        whole = self.coupled()
        rows = {name: (float(whole[name]), np.nan, np.nan, len(self.jumps)) for name in STREAM}
        return pd.concat([found, pd.DataFrame.from_dict(rows, orient="index", columns=found.columns)]).rename_axis(found.index.name)

    def coupled(self) -> xr.Dataset:
        """The stream and the grains that it carries, of a scene with two-way coupling.

        Returns
        -------
        Dataset, along `height` (d, of the centre above the bed level)
            velocity_before, velocity (u*, without the grains and with them), fluid_stress, grain_stress (ρu*²), and without a dimension
            moving_grains (1/m²), bed_stress (what grains carry at the bed, ρu*²), bed_load and bed_load_before (q/√((s − 1) g d³), with the
            stream as the grains make it and without), bed_load_flux (m²/s). Units in the variables' attributes.

        Raises
        ------
        ValueError
            For a scene without two-way coupling.

        References
        ----------
        `saltation.coupling`: Owen (1964); Wiberg & Smith (1985).

        Examples
        --------
        >>> import saltation
        >>> scene = saltation.load("sand").changed(coupling="two_way", run={"jumps": 60})
        >>> stream = saltation.run(scene).coupled()
        >>> bool((stream["velocity"] < stream["velocity_before"]).all()), bool(stream["bed_load"] < stream["bed_load_before"])
        (True, True)
        """
        scene, numbers = self.scene, self.scene.numbers
        made = scene.coupling and scene.coupling.settled
        if not made:
            raise ValueError("the stream is not coupled to the grains: set coupling = 'two_way'")
        assert scene.channel is not None
        heights, stress = np.array(made.heights), np.array(made.stress)
        total = 1.0 - heights * numbers.diameter / scene.channel.depth if scene.channel.depth else np.ones(len(heights))
        columns = {
            "velocity_before": (np.array([scene.clear.velocity_and_shear(z)[0] for z in heights]), "u*"),
            "velocity": (np.array([scene.profile.velocity_and_shear(z)[0] for z in heights]), "u*"),
            "fluid_stress": (total - stress, "1"),
            "grain_stress": (np.array(made.seen), "1"),
        }
        data: dict[str, Any] = {name: ("height", values, attributes_of(scene, unit, COUPLED[name])) for name, (values, unit) in columns.items()}
        flux = made.rate * math.sqrt(abs(numbers.density_ratio - 1.0) * GRAVITY * numbers.diameter**3)
        load = {"bed_load": made.rate, "bed_load_before": made.rate_uncoupled, "bed_load_flux": flux}
        for name, value in ({"moving_grains": made.grains, "bed_stress": made.seen[0]} | load).items():
            data[name] = (), value, attributes_of(scene, STREAM.get(name, "1"), COUPLED[name])
        return xr.Dataset(data, coords={"height": ("height", heights, attributes_of(scene, "d", "of the centre above the bed level"))})

    @cached_property
    def trajectory(self) -> xr.Dataset:
        """The path of one grain at the nodes of every step: x, y, z, u, v, w, spin and the forces on it, against time.

        Of many: positions (d) and velocities (u*) (time, grain) every `cloud.interval`, not folded back into a periodic box; NaN once a
        grain has left. Units are in the variables' attributes; the dataset's give diameter (m) and velocity (m/s) to convert them.

        Raises
        ------
        ValueError
            If the path was not stored (run.trajectory = false).
        """
        if self.path is None:
            raise ValueError("trajectory was not stored: set run.trajectory = true")
        return self.path() if callable(self.path) else self.path

    def _alone(self, what: str) -> xr.Dataset:
        """The path of the only grain."""
        if self.scene.cloud is not None:
            raise ValueError(f"{what} needs the path of a run of one grain: of many grains only positions and velocities are stored")
        return self.trajectory

    def budget(self, phases: int = 40) -> pd.DataFrame:
        """Mean forces over the phase of the jump, thesis figs 3-14 to 3-16.

        Parameters
        ----------
        phases : int
            Number of phases.

        Returns
        -------
        DataFrame, one row per phase (0 takeoff, 1 impact)
            phase; x, z (d from takeoff, z from the bed level); every force along the stream (`drag_x` …) and up (`drag_z` …) as
            accelerations in u*²/d; means over all jumps that count.

        Raises
        ------
        ValueError
            For many grains, and if the path was not stored or no jump counts.

        Examples
        --------
        >>> import saltation
        >>> frame = saltation.run(saltation.load("bouncing")).budget(phases=10)
        >>> len(frame), bool((frame["weight_z"] < 0.0).all())
        (10, True)
        """
        path, jumps = self._alone("budget"), self.jumps
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
            For many grains, and if the path was not stored or fewer than two takeoffs count.

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
        path, jumps = self._alone("diffusion"), self.jumps
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

    def profiles(self, bins: int = 30, start: float = 0.0) -> pd.DataFrame:
        """Profiles of concentration and mean velocity over the height, from all stored positions after a start time.

        Parameters
        ----------
        bins : int
            Number of layers.
        start : float, d/u*
            Earlier positions are left out.

        Returns
        -------
        DataFrame
            z (d, centre of a layer), concentration (grain volume over the layer's volume in a periodic box; in an open one relative
            to the mean), velocity and its standard deviation (u*).

        Raises
        ------
        ValueError
            For a single grain, and if the paths were not stored.
        """
        if self.scene.cloud is None:
            raise ValueError("profiles needs a run of many grains: the scene has no [cloud]")
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
        volume = length * width * thickness if self.scene.grains.boundary == "periodic" else np.pi / 6.0 * self.scene.grains.number * thickness
        concentration = count / max(1, kept.sum()) * np.pi / 6.0 / volume
        deviation = np.sqrt(np.maximum(0.0, square - mean * mean))
        return pd.DataFrame({"z": 0.5 * (edges[1:] + edges[:-1]), "concentration": concentration, "velocity": mean, "velocity_sd": deviation})

    def dataset(self) -> xr.Dataset:
        """The whole result as one dataset: jumps along `jump`, encounters along `encounter`, paths along `time` (and `grain`), the rest as attributes.

        With two-way coupling also what `coupled` gives, with names that begin with `coupling_`.

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
        scene, numbers = self.scene, self.scene.numbers
        whole = tables_to_dataset(scene, self.all_jumps, self.encounters)
        for name, unit in (("grain", "1"), ("time", "d/u*"), ("fate", "1")):
            whole[f"fate_{name}"] = ("fate", self.fates[name].to_numpy(), attributes_of(scene, unit, FATES[name]))
        whole["fate_fate"].attrs.pop("units")  # a word
        if self.path is not None:
            whole = whole.merge(self.trajectory, combine_attrs="override")
        if scene.coupling is not None and scene.coupling.settled is not None:
            stream = self.coupled().rename(height="coupling_height")
            whole = whole.merge(stream.rename({str(name): f"coupling_{name}" for name in stream.data_vars}), combine_attrs="override")
        whole.attrs = {
            "scene": scene.model_dump_json(exclude_none=True),
            "status": self.status,
            "message": self.message,
            "provenance": json.dumps(self.provenance),
            "diameter": numbers.diameter,
            "velocity": numbers.velocity,
            "velocity_scale": numbers.scale,
            "end": self.time,
        }
        return whole

    def to_si(self) -> xr.Dataset:
        """The whole result as one dataset in SI units; angles stay in degrees.

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
        >>> from pathlib import Path
        >>> import saltation
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     saltation.run(saltation.load("bouncing")).save(Path(folder) / "out.nc")
        ...     saltation.open(Path(folder) / "out.nc").status
        'finished'
        """
        store(self.dataset(), path)


@cache
def installed(package: str) -> str:
    """Its version, read from its files once: that takes as long as a short run."""
    return version(package)


def origin(scene: Scene) -> dict[str, Any]:
    """What a result says about its scene before anything has moved."""
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
        "outside_validity": [text for name in scene.names for text in warnings_of(name, scene.options(name), scene.numbers)] + left(scene),
        "seed": scene.run.seed,
        "versions": {"basset": __version__} | {name: installed(name) for name in ("numpy", "numba", "xarray")} | {"python": platform.python_version()},
    }
