"""History forces along stored tracks of many particles: netCDF, zarr or CSV in, netCDF out, in chunks of tracks."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import os
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from basset import __version__, _validate, samples
from basset._files import is_stream, replacing
from basset.kernels import BassetKernel, Floats, Kernel
from basset.particles._equation import schiller_naumann
from basset.quadrature import Exponential
from basset.streaming.uneven import Planned, planned
from basset.weights._slopes import rates
from basset.weights.uneven import HIGHEST

if TYPE_CHECKING:
    import xarray

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]  # a module or nothing: Windows has no such locks

__all__ = ["history", "write"]

SAMPLES = 1 << 18  # of a chunk, about
TOGETHER = 32  # tracks with the same times: their terms stay in the cache
METRES = {"": 1.0, "um": 1e-6, "µm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1e3}
DEGREE = 1852.0 * 60.0  # m of a degree of latitude, as Parcels has it
UNWRITTEN = 9e36  # netCDF's own fill value is greater
IDS = ("trajectory", "particle", "track", "traj", "id", "trajectory_id", "particle_id", "track_id")
OBSERVATIONS = ("obs", "observation", "observations", "sample", "samples")
COMPONENTS = ("component", "components", "direction", "space", "xyz")  # dimensions of vectors
NAMES = {  # one variable, or one per component
    "slip": ("slip", "slip_{xyz}", "slip_{uvw}", "{uvw}_slip", "{uvw}s"),
    "fluid": ("fluid_velocity", "fluid_velocity_{xyz}", "fluid_{uvw}", "{uvw}_fluid", "{uvw}f", "{uvw}_f", "u{xyz}", "u_{xyz}", "{UVW}"),
    "velocity": ("velocity", "particle_velocity", "velocity_{xyz}", "particle_{uvw}", "{uvw}_particle", "{uvw}p", "{uvw}_p", "v{xyz}", "v_{xyz}", "{uvw}"),
}
STANDARD_NAMES = {  # of the fluid's velocity
    "x": ("sea_water_x_velocity", "eastward_sea_water_velocity", "x_wind", "eastward_wind"),
    "y": ("sea_water_y_velocity", "northward_sea_water_velocity", "y_wind", "northward_wind"),
    "z": ("upward_sea_water_velocity", "upward_air_velocity"),
}
FINE = 1e-9  # of a step: times that are rounded less are taken as they are
REST = "rest"  # in place of the fluid's velocity


# What is computed


@dataclass(frozen=True)
class Particle:
    """A sphere in its fluid, and how its history is computed; see `history`."""

    diameter: float
    viscosity: float
    density: float | None
    density_ratio: float | None
    kernel: Kernel
    order: int
    rtol: float
    drag: str
    before: str
    gaps: str

    def __post_init__(self) -> None:
        for name, unit in (("diameter", "m"), ("viscosity", "m²/s"), ("density", "kg/m³"), ("density_ratio", "")):
            if (value := getattr(self, name)) is not None or name in ("diameter", "viscosity"):
                object.__setattr__(self, name, _validate.positive(name, value, unit))
        if (self.density is None) == (self.density_ratio is None):
            raise ValueError(
                "one of density (of the fluid, kg/m³: the force in N) and density_ratio (the force per mass of the particle, m/s²) must be given, "
                f"got {'none' if self.density is None else 'both'}"
            )
        for name, options in (("drag", ("stokes", "schiller_naumann")), ("before", ("rest", "steady")), ("gaps", ("raise", "bridge", "split"))):
            _validate.choice(name, getattr(self, name), options)
        _validate.integer("order", self.order, 1, HIGHEST)
        Exponential(self.order, self.rtol)  # checks it
        if not isinstance(self.kernel, Kernel):
            raise TypeError(f"kernel must be a kernel such as basset.BassetKernel(), got {_validate.shown(self.kernel)}")

    @property
    def degree(self) -> int:
        """Of the polynomials whose slopes are the rates: even, so that they are centred, and no less exact than the integrals."""
        return 2 * (self.order // 2 + 1)

    def plan(self, shortest: float, longest: float) -> Planned:
        """One sum for all tracks, so that none depends on the others of its chunk; from the shortest step and the longest duration, in seconds."""
        horizon = longest * (1.0 + 1e-9) or 1.0
        found = planned(self.kernel, self.rtol, min(shortest, horizon) * (1.0 - 1e-6), horizon)  # steps differ by rounding
        if shortest < found.tail.near:
            raise ValueError(
                "times must rise by {} s or more for tracks as long as these, got a step of {} s".format(*_validate.apart(found.tail.near, shortest))
            )
        return found

    def forces(self, slip: Floats, rate: Floats, fluid: Floats | None, memory: Floats) -> tuple[Floats, Floats]:
        """The history force (n, components) and its share (n,), from slip, its rate, the fluid's acceleration along the track, and H."""
        with np.errstate(invalid="ignore", over="ignore"):
            found = (-9.0 / self.diameter * math.sqrt(self.viscosity / math.pi)) * memory  # per mass of the displaced fluid
            total = found - 0.5 * rate
            drag: Any = 18.0 * self.viscosity / self.diameter**2
            if self.drag == "schiller_naumann":
                drag = drag * schiller_naumann(np.sqrt((slip * slip).sum(axis=1, keepdims=True)) * (self.diameter / self.viscosity))
            total -= drag * slip
            if fluid is not None:
                total += fluid
            size, whole = np.sqrt((found * found).sum(axis=1)), np.sqrt((total * total).sum(axis=1))
            share = np.where(np.isinf(size), 1.0, np.where(size == 0.0, 0.0, size / whole))
        mass = self.density * math.pi / 6.0 * self.diameter**3 if self.density is not None else 1.0 / (self.density_ratio or 1.0)
        return mass * found, share

    def attributes(self, moving: bool) -> dict[str, Any]:
        """What a result says of itself."""
        given = {name: value for name in ("diameter", "viscosity", "density", "density_ratio") if (value := getattr(self, name)) is not None}
        total = "drag, added mass (0.5 of the displaced fluid's) and history" + (", and pressure gradient with du/dt along the track for Du/Dt" * moving)
        return given | {
            "title": "History force along tracks", "Conventions": "CF-1.11", "kernel": repr(self.kernel), "rule": repr(Exponential(self.order, self.rtol)),
            "drag": self.drag, "before": self.before, "gaps": self.gaps, "basset_version": __version__,
            "total": f"sum of the forces of the fluid that are known here: {total}",
        }  # fmt: skip


@dataclass(frozen=True)
class Samples:
    """Samples (n, components) of a chunk without gaps, their places in the chunk, and where pieces of tracks begin, with the end."""

    places: Any
    times: Floats
    slip: Floats
    fluid: Floats | None
    bounds: Any


def _forces(found: Samples, particle: Particle, plan: Planned, force: Floats, share: Floats) -> None:
    """The history force and its share, put where the samples come from."""
    rate = np.empty_like(found.slip)
    rates(found.times, found.slip, found.bounds, particle.degree, rate)
    fluid = None
    if found.fluid is not None:
        fluid = np.empty_like(found.fluid)
        rates(found.times, found.fluid, found.bounds, particle.degree, fluid)
    memory = np.empty_like(rate)
    first = found.slip[found.bounds[:-1]]
    start = first if particle.before == "rest" else np.zeros_like(first)
    for pieces in _alike(found.times, found.bounds):
        begins, ends = found.bounds[pieces], found.bounds[pieces + 1]
        times = found.times[begins[0] : ends[0]] - found.times[begins[0]]
        together = np.zeros((len(times), len(pieces), rate.shape[1]))
        for k, (low, high) in enumerate(zip(begins, ends, strict=True)):
            together[: high - low, k] = rate[low:high]
        columns = together.reshape(len(times), -1)
        integrals, terms = np.zeros_like(columns), np.zeros((columns.shape[1], len(plan.tail)))
        plan.advance(particle.order, False, times, columns, 1, 0, start[pieces].ravel(), terms, integrals)
        integrals = integrals.reshape(together.shape)
        for k, (low, high) in enumerate(zip(begins, ends, strict=True)):
            memory[low:high] = integrals[: high - low, k]
    with np.errstate(invalid="ignore"):
        memory[found.bounds[:-1]] = np.where(start == 0.0, 0.0, start * particle.kernel(0.0))
    force[found.places], share[found.places] = particle.forces(found.slip, rate, fluid, memory)


def _alike(times: Floats, bounds: Any) -> Iterator[Any]:
    """Pieces in groups of which none is longer than the first, and all begin at its times after the start."""
    groups: dict[float, list[int]] = {}
    for piece in np.argsort(-np.diff(bounds), kind="stable"):
        own = times[bounds[piece] : bounds[piece + 1]] - times[bounds[piece]]
        group = groups.setdefault(float(own[1]) if len(own) > 1 else 0.0, [])
        if group:
            begin = bounds[group[0]]
            if not np.array_equal(own, times[begin : begin + len(own)] - times[begin]):
                yield np.array([piece])
                continue
        group.append(piece)
        if len(group) == TOGETHER:
            yield np.array(group)
            group.clear()
    yield from (np.array(group) for group in groups.values() if group)


# What of a dataset is what


@dataclass(frozen=True)
class Column:
    """A component of a vector: x, y or z, the variable, its unit in SI, and where along a dimension of components."""

    component: str
    name: str
    unit: float
    at: dict[Any, int]


class Tracks:
    """What of a dataset is what, and how to take some of its tracks.

    Tracks are rows, or follow each other along one dimension (contiguous or indexed ragged arrays of CF), or there is one.
    """

    def __init__(self, ds: xarray.Dataset, names: dict[str, Any]) -> None:
        self.time = _time_of(ds, names["time"])
        self.roles = _roles(ds, {role: _listed(role, names[role]) for role in ("slip", "velocity", "fluid", "position")})
        columns = [column for role in self.roles.values() for column in role]
        dims = [dim for dim in ds[columns[0].name].dims if dim not in columns[0].at]
        along = ds[self.time].dims
        self.track, self.sample = _dimensions(ds, along if len(along) > len(dims) else tuple(dims), along)
        for name, at in [(column.name, column.at) for column in columns] + [(self.time, {})]:
            if not {self.sample, *at} <= set(ds[name].dims) <= {self.track, self.sample, *at}:
                wanted = f"({self.sample})" if self.track is None else f"({self.track}, {self.sample})"
                raise ValueError(f"{name!r} must have the dimensions {wanted} of the tracks, got ({', '.join(map(str, ds[name].dims))})")
        self.instance, self.rows = self.track, ""
        self.order: Any = None
        if self.track is not None:
            self.bounds = np.arange(ds.sizes[self.track] + 1)
        else:
            self._follow(ds)
        ids = [name for name in ds.variables if ds[name].dims == (self.instance,) and (name in IDS or ds[name].attrs.get("cf_role") == "trajectory_id")]
        numbers = ds[ids[0]].values if ids else np.empty(0)
        self.id = str(ids[0]) if ids else "trajectory"
        self.ids = numbers if numbers.dtype.kind in "iuf" and len(numbers) == len(self) else np.arange(len(self), dtype=np.int32)
        if self.ids.dtype.kind in "iu" and (np.abs(self.ids) < 2**31).all():  # netCDF 3 knows no longer integers
            self.ids = self.ids.astype(np.int32)

    def _follow(self, ds: xarray.Dataset) -> None:
        """Where the tracks along the one dimension begin, and in which order samples are taken."""
        size = ds.sizes[self.sample]
        counts = [name for name in ds.variables if ds[name].attrs.get("sample_dimension") == self.sample and ds[name].ndim == 1]
        index = [name for name in ds.variables if "instance_dimension" in ds[name].attrs and ds[name].dims == (self.sample,)]
        rows = np.array([size])
        if counts or index:
            numbers = np.asarray(ds[(counts or index)[0]].values)
            if numbers.dtype.kind not in "iuf" or not (numbers >= 0).all() or not (numbers == np.floor(numbers)).all():
                raise ValueError(f"{(counts or index)[0]!r} must hold whole numbers, 0 or greater, got {_validate.shown(numbers)}")
            rows = numbers.astype(np.int64)
        if counts:
            self.instance = ds[counts[0]].dims[0]
            if rows.sum() != size:
                raise ValueError(f"{counts[0]!r} must count the {size} samples along {self.sample!r}, got {rows.sum()} in all")
        elif index:
            self.instance = ds[index[0]].attrs["instance_dimension"]
            self.order = np.argsort(rows, kind="stable")
            rows = np.bincount(rows, minlength=ds.sizes.get(self.instance, 0))
        self.instance = self.instance or "trajectory"
        self.rows = str(counts[0]) if counts else "row_size"
        self.bounds = np.concatenate([[0], np.cumsum(rows)])

    def __len__(self) -> int:
        return len(self.bounds) - 1

    @property
    def along(self) -> tuple[Any, ...]:
        """Dimensions of the samples; the first is that of records."""
        return (self.sample,) if self.track is None else (self.track, self.sample)

    @property
    def columns(self) -> list[Column]:
        """The components."""
        return next(iter(self.roles.values()))

    def part(self, ds: xarray.Dataset, start: int, stop: int) -> xarray.Dataset:
        """Tracks start … stop − 1, still to be read."""
        if self.track is not None:
            return ds.isel({self.track: slice(start, stop)})
        at = slice(int(self.bounds[start]), int(self.bounds[stop]))
        return ds.isel({self.sample: at if self.order is None else self.order[at]})

    def lengths(self, part: xarray.Dataset, start: int, stop: int) -> Any:
        """Samples of each of those tracks."""
        return np.diff(self.bounds[start : stop + 1]) if self.track is None else np.full(stop - start, part.sizes[self.sample])

    def flat(self, part: xarray.Dataset, name: str, at: dict[Any, int]) -> Any:
        """A variable (samples,), one track after the other."""
        array = part[name].isel(at)
        if self.track is None:
            return array.values
        if self.track not in array.dims:
            array = array.expand_dims({self.track: part.sizes[self.track]})
        return array.transpose(self.track, self.sample).values.reshape(-1)

    def times(self, part: xarray.Dataset) -> Floats:
        """Times (samples,) in seconds, NaN where missing; of dates, since the first of them."""
        found = self.flat(part, self.time, {})
        if found.dtype.kind in "mM":
            lost = np.isnat(found)
            passed = found - (found[~lost].min() if not lost.all() else found[:1])
            return np.where(lost, np.nan, passed.astype("timedelta64[ns]").astype(np.int64) * 1e-9)
        if found.dtype.kind not in "fiu":
            raise ValueError(f"{self.time!r} must hold times as numbers or datetime64, got {_validate.shown(found[:1])}")
        return _known(found) * self._second(part)

    def _second(self, part: xarray.Dataset) -> float:
        """Seconds in the unit of times that are numbers."""
        units = part[self.time].attrs.get("units")
        return samples._unit(Path("the dataset"), str(self.time), None if units is None else str(units))

    def values(self, part: xarray.Dataset, role: str) -> Floats:
        """Values (samples, components) in SI units, NaN where missing."""
        made = []
        for column in self.roles[role]:
            found = self.flat(part, column.name, column.at)
            if found.dtype.kind not in "fiu":
                raise ValueError(f"{column.name!r} must hold real numbers, got {_validate.shown(found[:1])}")
            made.append(_known(found) * column.unit)
        return np.stack(made, axis=1)

    def steps(self, part: xarray.Dataset, start: int, stop: int) -> tuple[float, float]:
        """(shortest step, longest duration) in seconds of those tracks; refused unless times rise along each."""
        times, whose = self.times(part), np.repeat(np.arange(start, stop), self.lengths(part, start, stop))
        known = np.flatnonzero(~np.isnan(times))
        times, whose = times[known], whose[known]
        if not len(times):
            return math.inf, 0.0
        step, same = np.diff(times), whose[1:] == whose[:-1]
        if (bad := same & ~(step > 0.0)).any():
            k = int(np.argmax(bad))
            later, former = _validate.apart(times[k + 1], times[k])
            raise ValueError(f"times must rise along every track, got {later} s after {former} s in track {whose[k]}")
        first = np.flatnonzero(np.append(True, ~same))
        last = np.append(first[1:], len(times)) - 1
        return float(step[same].min(initial=math.inf)), float((times[last] - times[first]).max())

    def taken(self, part: xarray.Dataset, start: int, stop: int, particle: Particle) -> Samples:
        """What is known of those tracks; gaps are refused, bridged or split as told."""
        times, whose = self.times(part), np.repeat(np.arange(start, stop), self.lengths(part, start, stop))
        fluid = self.values(part, "fluid") if "fluid" in self.roles else None
        moved = self.values(part, next(iter(self.roles)))
        whole = moved if fluid is None else moved + fluid
        places = np.flatnonzero(np.isfinite(times) & np.isfinite(whole).all(axis=1))
        if len(places) < len(times):
            times, whose, moved, fluid = times[places], whose[places], moved[places], None if fluid is None else fluid[places]
        new = np.append(True, whose[1:] != whose[:-1])[: len(whose)]
        behind = ~new & np.append(False, np.diff(places) > 1)[: len(places)]
        if particle.gaps == "raise" and behind.any():
            k = int(np.argmax(behind))
            before = int(places[k - 1] - places[np.flatnonzero(new[:k])[-1]])
            raise ValueError(
                f"tracks must have no gaps, got one after sample {before} of track {whose[k]} (of {int(behind.sum())} in tracks {start} to {stop - 1}): "
                "interpolate over them with gaps = bridge, or begin anew behind them with gaps = split"
            )
        bounds = np.append(np.flatnonzero(new | behind if particle.gaps == "split" else new), len(places))
        times = _evened(times, bounds, samples._stored(part[self.time]), self._second(part))
        if "position" in self.roles:
            moved = self._velocities(times, moved, bounds, particle.degree)
        return Samples(places, times, moved if fluid is None else moved - fluid, fluid, bounds)

    def _velocities(self, times: Floats, places: Floats, bounds: Any, degree: int) -> Floats:
        """Velocities from positions by differences; longitudes on the sphere, also over the date line."""
        columns = self.roles["position"]
        turning = abs(columns[0].unit) == DEGREE
        if turning:
            turn = 360.0 * DEGREE
            places = places.copy()
            places[1:, 0] -= turn * np.cumsum(np.round(np.diff(places[:, 0]) / turn))
        found = np.empty_like(places)
        rates(times, places, bounds, degree, found)
        if turning and len(columns) > 1:
            found[:, 0] *= np.cos(np.radians(places[:, 1] / DEGREE))
        return found

    def result(self, part: xarray.Dataset, start: int, stop: int, force: Floats, share: Floats, particle: Particle) -> xarray.Dataset:
        """The result for those tracks."""
        import xarray

        along = self.along
        shape = tuple(part.sizes[dim] for dim in along)
        names = [column.component for column in self.columns]
        units = "N" if particle.density is not None else "m s-2"
        what = "history force on the particle" + " per mass of the particle" * (particle.density is None)
        fields: dict[Any, Any] = {
            "history_force": ((*along, "component"), force.reshape(*shape, len(names)), {"units": units, "long_name": what}),
            "history_share": (along, share.reshape(shape), {"units": "1", "long_name": "size of the history force over that of the sum of forces"}),
        }
        ids = xarray.Variable(self.instance, self.ids[start:stop], {"cf_role": "trajectory_id"})
        coordinates: dict[Any, Any] = {self.id: ids, "component": names, str(self.time): part[self.time].variable}
        if self.track is None:
            counts = np.diff(self.bounds[start : stop + 1]).astype(np.int32)
            fields[self.rows] = ((self.instance,), counts, {"sample_dimension": self.sample, "long_name": "number of samples of the track"})
        return xarray.Dataset(fields, coordinates, particle.attributes("fluid" in self.roles))


def _evened(times: Floats, bounds: Any, kind: Any, unit: float) -> Floats:
    """Times of pieces that are uniform up to the rounding of the numbers as stored made so, where that rounding would be seen in rates."""
    kind, lengths = np.dtype(kind), np.diff(bounds)
    if kind.kind != "f" or not len(lengths):
        return times
    first, last = times[bounds[:-1]], times[bounds[1:] - 1]
    step = (last - first) / np.maximum(lengths - 1, 1)
    even = np.repeat(first, lengths) + (np.arange(len(times)) - np.repeat(bounds[:-1], lengths)) * np.repeat(step, lengths)
    rounding = np.spacing((np.maximum(np.abs(first), np.abs(last)) / unit).astype(kind)).astype(np.float64) * unit
    off = np.maximum.reduceat(np.abs(times - even), bounds[:-1])
    return np.where(np.repeat((off <= rounding) & (rounding > FINE * step), lengths), even, times)


def _known(values: Any) -> Floats:
    """As float64, NaN where netCDF says that nothing was written."""
    made: Floats = values.astype(np.float64)
    made[np.abs(made) > UNWRITTEN] = np.nan
    return made


def _time_of(ds: xarray.Dataset, name: Any) -> Any:
    """The variable of times: the one named, or the one most surely so by attributes and name."""
    if name is not None:
        return _validate.choice("time", name, map(str, ds.variables))
    ranks = {key: 0.0 if ds[key].dtype.kind in "mM" else samples._rank(ds, key) for key in ds.variables if ds[key].dtype.kind in "fiumM" and ds[key].ndim}
    best = min(ranks.values(), default=math.inf)
    found = [key for key, rank in ranks.items() if rank == best < math.inf]
    if len(found) > 1:
        found = [key for key in found if samples._is_time(str(key))] or found
    if len(found) != 1:
        raise ValueError(
            f"tracks must have one variable of times, known by its units or the name time, or be told which (time), got {_names(found or ds.variables)}"
        )
    return found[0]


def _dimensions(ds: xarray.Dataset, dims: Sequence[Any], along: Sequence[Any]) -> tuple[Any, Any]:
    """(dimension of tracks or None, dimension of samples)."""
    if len(dims) == 1:
        return None, dims[0]
    if len(dims) != 2:
        raise ValueError(f"tracks must have the dimensions (trajectory, obs), or one of them, got ({', '.join(map(str, dims))})")
    numbered = [ds[name].dims for name in ds.variables if ds[name].attrs.get("cf_role") == "trajectory_id"]
    of_tracks = [k for k, dim in enumerate(dims) if (dim,) in numbered]
    of_samples = [k for k, dim in enumerate(dims) if str(dim).lower() in OBSERVATIONS or samples._is_time(str(dim)) or tuple(along) == (dim,)]
    sample = 1 - of_tracks[0] if of_tracks else of_samples[0] if len(of_samples) == 1 else 1
    return dims[1 - sample], dims[sample]


def _roles(ds: xarray.Dataset, given: dict[str, list[str]]) -> dict[str, list[Column]]:
    """The columns of slip, or of velocity (or position) and fluid, as they are named or as they usually are."""
    told = any(given.values())
    if given["slip"] and (given["velocity"] or given["fluid"] or given["position"]):
        raise ValueError("slip must be given alone, without velocity, position or fluid")
    if given["velocity"] and given["position"]:
        raise ValueError("velocity and position must not both be given")
    if slip := given["slip"] or ([] if told else _usual(ds, "slip")):
        return {"slip": _columns(ds, "slip", slip)}
    moved = "position" if given["position"] else "velocity"
    fluid = given["fluid"] or _of_standard_names(ds) or _usual(ds, "fluid")
    mover = given[moved] or [name for name in _usual(ds, moved) if name not in fluid]
    if not (fluid and mover):
        raise ValueError(
            "tracks must have velocities of particle and fluid, or their difference: name them by velocity (or position, for velocities by differences) "
            f"and fluid (which may be {REST!r}), or by slip (--slip-variable), got {_names(ds.variables)}"
        )
    made = {moved: _columns(ds, moved, mover)}
    if fluid != [REST]:
        made["fluid"] = _columns(ds, "fluid", fluid)
        if len({len(columns) for columns in made.values()}) > 1:
            raise ValueError(f"{moved} and fluid must have the same number of components, got {_names(mover)} and {_names(fluid)}")
    return made


def _listed(role: str, names: Any) -> list[str]:
    """Names from a word, a text with commas or a sequence."""
    listed = [] if names is None else [word.strip() for word in names.split(",")] if isinstance(names, str) else list(names)
    if len(listed) > 3 or (names is not None and not listed):
        raise ValueError(f"{role} must name one to three variables, got {_validate.shown(names)}")
    return listed


def _names(names: Any) -> str:
    return _validate.shown(list(map(str, names)), 200)


def _usual(ds: xarray.Dataset, role: str) -> list[str]:
    """The variables under one of the usual names of a role: one, or one per component."""
    for form in NAMES.get(role, ()):
        letters = re.search(r"\{(...)\}", form)
        listed = [form.replace(letters[0], letter) for letter in letters[1]] if letters else [form]
        if found := [name for name in listed if name in ds.variables and ds[name].ndim]:
            return found
    return []


def _of_standard_names(ds: xarray.Dataset) -> list[str]:
    """The fluid's velocity by its CF standard names."""
    known = [next((str(name) for name in ds.variables if ds[name].attrs.get("standard_name") in wanted), None) for wanted in STANDARD_NAMES.values()]
    return [name for name in known if name is not None]


def _columns(ds: xarray.Dataset, role: str, names: list[str]) -> list[Column]:
    """Variables as components."""
    for name in names:
        _validate.choice(role, name, map(str, ds.variables))
    vector = [dim for dim in ds[names[0]].dims if str(dim).lower() in COMPONENTS] if len(names) == 1 else []
    if vector:
        return [Column("xyz"[k], names[0], _unit(ds, role, names[0]), {vector[0]: k}) for k in range(min(ds.sizes[vector[0]], 3))]
    return [Column(letter, name, _unit(ds, role, name), {}) for letter, name in zip(_letters(names), names, strict=True)]


def _letters(names: list[str]) -> list[str]:
    """x, y, z: in their order, or of a single one by the last letter of its name."""
    if len(names) > 1:
        return list("xyz"[: len(names)])
    return [dict(zip("uvwxyz", "xyzxyz", strict=True)).get(names[0][-1:].lower(), "x")]


def _unit(ds: xarray.Dataset, role: str, name: str) -> float:
    """m/s (for positions: m) in the unit of a variable."""
    words = str(ds[name].attrs.get("units", "")).strip()
    if role == "position" and words.startswith("degree"):
        return DEGREE
    length = words if role == "position" else re.sub(r"\s*(?:/\s*s|[ .*]\s*s\s*(?:\^|\*\*)?-1)$", "", words)
    if words == "1":
        return 1.0
    if length not in METRES or (role != "position" and length == words != ""):
        raise ValueError(f"{name!r} must be in {'m, mm, cm, km or degrees' if role == 'position' else 'm/s, mm/s, cm/s or km/s'}, got the unit {words!r}")
    down = role == "position" and ds[name].attrs.get("positive") == "down"
    return -METRES[length] if down else METRES[length]


# Computing


def history(
    ds: xarray.Dataset,
    *,
    diameter: float,
    viscosity: float,
    density: float | None = None,
    density_ratio: float | None = None,
    slip: str | Sequence[str] | None = None,
    velocity: str | Sequence[str] | None = None,
    fluid: str | Sequence[str] | None = None,
    position: str | Sequence[str] | None = None,
    time: str | None = None,
    kernel: Kernel = BassetKernel(),
    order: int = 3,
    rtol: float = 1e-6,
    drag: str = "stokes",
    before: str = "rest",
    gaps: str = "raise",
) -> xarray.Dataset:
    """The history force along tracks, F = −(9/d) √(ν/π) m H[w] with the slip w = v − u, H its history integral and m the displaced fluid's mass.

    Parameters
    ----------
    ds : xarray.Dataset
        Tracks as rows (trajectory, obs), as Parcels writes them, with NaN behind a track's end; as ragged arrays of CF along one dimension; or one track.
        Times as numbers with units in the attributes (none: seconds), as datetime64 or timedelta64; they need not be uniform.
    diameter : float, m
    viscosity : float, m²/s
        Kinematic.
    density : float, kg/m³
        Of the fluid: the force is then in N.
    density_ratio : float, dimensionless
        Density of the particle over that of the fluid, in place of `density`: the force is then per mass of the particle, in m/s².
    slip : name or names, or None; m/s
        Variables of w: one with a dimension `component`, or one to three. Units in their attributes are heeded.
    velocity, fluid : name or names, or None; m/s
        Variables of v, and of u at the particle, in place of the slip; fluid = "rest" where it does not move. None: known by usual names, the fluid also by
        standard names.
    position : name or names, or None; m or degrees
        Variables of the place, in place of the velocity, which then comes from them by differences; longitude and latitude are known by their unit.
    time : name or None
    kernel : Kernel
    order : int
        Degree of the polynomials through the samples of dw/dt, 1 to 3; dw/dt is that of polynomials of degree 2 or 4 through those of w.
    rtol : float, dimensionless
        Promised error of the sum of exponentials, as in `Exponential`.
    drag : "stokes" or "schiller_naumann"
        Counts for the share only.
    before : "rest" or "steady"
        What was before a track: no slip, so that its first one is a jump that is remembered (and the force infinite there), or its first slip, for ever.
    gaps : "raise", "bridge" or "split"
        What is done where samples are missing (NaN) within a track: refuse, interpolate over them, or begin anew behind them, as a track of its own.

    Returns
    -------
    xarray.Dataset
        `history_force` (trajectory, obs, component), N or m/s², and `history_share` (trajectory, obs): |F| over that of the sum of drag, added mass, history
        and, where the fluid's velocity is known, pressure gradient, with du/dt along the track for Du/Dt. NaN where a sample is missing.

    Raises
    ------
    ValueError, TypeError
        One sentence: no times or velocities found, times that do not rise, gaps, units that are not known, an argument out of range.

    Notes
    -----
    H at a sample is computed from what came before: at the second and third of a track its order is lower. Times that are uniform up to the rounding of
    single precision are taken as uniform. A degree of latitude has 1852·60 m. Drag and added mass are those of a solid sphere, whatever the kernel.

    References
    ----------
    Maxey & Riley (1983), Phys. Fluids 26, 883; Schiller & Naumann (1933), Z. Ver. Dtsch. Ing. 77, 318.

    Examples
    --------
    A slip that grows by 1 m/s² from rest: H = 2√t.

    >>> import numpy as np, xarray
    >>> t = np.linspace(0.0, 4.0, 41)
    >>> ds = xarray.Dataset({"slip": (("obs", "component"), t[:, None])}, {"time": ("obs", t, {"units": "s"})})
    >>> found = history(ds, diameter=1e-3, viscosity=1e-6, density=1000.0)
    >>> expected = -9.0 / 1e-3 * np.sqrt(1e-6 / np.pi) * 1000.0 * np.pi / 6.0 * 1e-9 * 4.0
    >>> bool(abs(found.history_force[-1, 0] / expected - 1.0) < 1e-6)
    True
    """
    particle = Particle(diameter, viscosity, density, density_ratio, kernel, order, rtol, drag, before, gaps)
    tracks = Tracks(ds, {"slip": slip, "velocity": velocity, "fluid": fluid, "position": position, "time": time})
    whole = tracks.part(ds, 0, len(tracks))
    return _chunk(tracks, whole, 0, len(tracks), particle, particle.plan(*tracks.steps(whole, 0, len(tracks))))


def _chunk(tracks: Tracks, part: xarray.Dataset, start: int, stop: int, particle: Particle, plan: Planned) -> xarray.Dataset:
    """The result for some tracks."""
    count = int(tracks.lengths(part, start, stop).sum())
    force = np.full((count, len(tracks.columns)), np.nan)
    share = np.full(count, np.nan)
    found = tracks.taken(part, start, stop, particle)
    if len(found.places):
        _forces(found, particle, plan, force, share)
    return tracks.result(part, start, stop, force, share, particle)


# From file to file


def opened(path: Path, track: str | None = None) -> Callable[[], Any]:
    """What opens the tracks in a .nc, .zarr or .csv file, each time anew, so that no memory is kept; `track`: the column of a .csv that numbers tracks.

    ValueError, with one sentence, for what is no such file or needs a package that is not there.
    """
    import xarray

    suffix = path.suffix.lower()
    if suffix not in (".nc", ".zarr", ".csv"):
        raise ValueError(f"the file of tracks must end in .nc, .zarr or .csv, got {str(path)!r}")
    if track is not None and suffix != ".csv":
        raise ValueError(f"the column that numbers tracks is named for .csv files only, got {track!r} for {str(path)!r}")
    if suffix == ".csv":
        table = _from_csv(path, track)
        return lambda: contextlib.nullcontext(table)
    engines, kind = ["scipy"], "netCDF-3"
    if suffix == ".zarr":
        os.stat(path)
        engines, kind = ["zarr"], "zarr"
    else:
        with path.open("rb") as file:
            if file.read(4) in (b"\x89HDF", b"CDF\x05"):
                engines, kind = ["netcdf4", "h5netcdf"], "netCDF-4"
    packages = {"netcdf4": "netCDF4"}
    there = [engine for engine in engines if importlib.util.find_spec(packages.get(engine, engine))]
    if not there:
        wanted = " or ".join(packages.get(engine, engine) for engine in engines)
        rest = ", or the file be converted with nccopy -k classic" if kind == "netCDF-4" else ""
        raise ValueError(f"{str(path)!r} is {kind}, for which the package {wanted} must be installed{rest}")
    opener = partial(xarray.open_dataset, path, engine=there[0], decode_times=False, decode_timedelta=False, cache=False)
    try:
        opener().close()
    except OSError:
        raise
    except Exception:  # whatever foreign bytes lead to
        raise ValueError(f"{str(path)!r} must be a {kind} file") from None
    return opener


def _from_csv(path: Path, track: str | None) -> xarray.Dataset:
    """Tracks in a table: sorted by the column that numbers them."""
    import xarray

    columns: dict[str, tuple[Floats, str]] = {}
    for name, values in samples.columns(path).items():
        units = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]", name)
        second = samples.seconds(name)
        if second is not None:
            columns["time" if second != 1.0 or units else name] = values * second, "s"
        else:
            columns[units[1] if units else name] = values, units[2] if units else ""
    if track is not None:
        _validate.choice("track", track, columns)
    number = track or next((name for name in columns if name.lower() in IDS), None)
    size = len(next(iter(columns.values()))[0])
    whose = columns.pop(number)[0] if number is not None else np.zeros(size)
    if np.isnan(whose).any():
        raise ValueError(f"{str(path)!r} must number the track of every row in the column {number!r}, got none in row {int(np.argmax(np.isnan(whose))) + 1}")
    order = np.argsort(whose, kind="stable")
    ids, counts = np.unique(whose, return_counts=True)
    ids = ids.astype(np.int64) if (ids == np.rint(ids)).all() and (np.abs(ids) < 2**53).all() else ids
    fields: dict[Any, Any] = {name: ("obs", values[order], {"units": units}) for name, (values, units) in columns.items()}
    fields["row_size"] = ("trajectory", counts, {"sample_dimension": "obs"})
    return xarray.Dataset(fields, {"trajectory": ("trajectory", ids, {"cf_role": "trajectory_id"})})


def write(
    source: Path,
    output: Path,
    names: dict[str, Any],
    *,
    track: str | None = None,
    workers: int = 1,
    chunk: int | None = None,
    force: bool = False,
    command: str = "",
    progress: Callable[[int, int], None] = lambda done, total: None,
    **settings: Any,
) -> None:
    """`history` of a file of tracks, chunk by chunk, into a netCDF-3 file; `names` and `settings` are those of `history`.

    `progress` is told how many tracks are done, and of how many.

    What is done stands in `output` with .partial behind its name, which takes its place at the end: stopped at any time, the same call goes on from there
    and writes the same bits. ValueError, TypeError as `history`; OSError for files that cannot be used.
    """
    workers, particle = _validate.integer("workers", workers, 1), Particle(**settings)
    opener = opened(source, track)
    with opener() as ds:
        tracks = Tracks(ds, names)
        count, mean = len(tracks), ds.sizes[tracks.sample] / (1 if tracks.track is not None else max(len(tracks), 1))
        if not count or not mean:
            raise ValueError(f"{str(source)!r} must hold tracks, got none")
        state = source.stat()
        told = {"source": f"{source} ({state.st_size} bytes, {datetime.fromtimestamp(state.st_mtime, UTC):%Y-%m-%d %H:%M:%S.%f} UTC)", "command": command}
        header, record = _layout(tracks, ds, particle, told)
    size = max(1, int(SAMPLES / mean)) if chunk is None else _validate.integer("chunk", chunk, 1)

    def scanned(start: int) -> tuple[float, float]:
        with opener() as ds:
            stop = min(start + size, count)
            return tracks.steps(tracks.part(ds, start, stop), start, stop)

    def done(start: int) -> Any:
        with opener() as ds:
            stop = min(start + size, count)
            found = _chunk(tracks, tracks.part(ds, start, stop), start, stop, particle, plan)
        rows = np.empty(found.sizes[tracks.along[0]], dtype=record)
        for name in record.names or ():
            rows[name] = found[name].values
        return rows

    with ThreadPoolExecutor(workers) as pool:
        nears, fars = zip(*pool.map(scanned, range(0, count, size)), strict=True)
    plan = particle.plan(min(nears), max(fars))
    with ThreadPoolExecutor(workers) as pool, _growing(output, header, record.itemsize, tracks.bounds, force) as (file, begin):
        starts, waiting, reached = deque(range(begin, count, size)), deque[Future[Any]](), begin
        progress(reached, count)
        try:
            while starts or waiting:
                while starts and len(waiting) <= workers:
                    waiting.append(pool.submit(done, starts.popleft()))
                file.write(waiting.popleft().result())
                file.flush()
                reached = min(reached + size, count)
                progress(reached, count)
        except BaseException:
            for future in waiting:
                future.cancel()
            raise


def _layout(tracks: Tracks, ds: xarray.Dataset, particle: Particle, told: dict[str, str]) -> tuple[bytes, Any]:
    """The head of the netCDF-3 file of the result, and what follows it for each track (for ragged arrays: each sample), a record."""
    from scipy.io import netcdf_file

    one = ds.isel({tracks.along[0]: slice(0, 1)})
    size = math.prod(one.sizes[dim] for dim in tracks.along)
    blank = np.full((size, len(tracks.columns)), np.nan)
    found = tracks.result(one, 0, 1 if tracks.track is not None else len(tracks), blank, blank[:, 0], particle).assign_attrs(told).drop_encoding()
    long = [name for name, variable in found.variables.items() if variable.dtype.kind in "iu" and variable.dtype != np.int32]
    found = found.assign({name: found[name].astype(np.float64) for name in long})  # netCDF 3 knows them not
    content = bytearray(found.to_netcdf(engine="scipy", unlimited_dims=tracks.along[:1]))
    with netcdf_file(io.BytesIO(content), mmap=False) as read:
        fields = [(name, variable.data.dtype, variable.shape[1:]) for name, variable in read.variables.items() if variable.isrec]
    record = np.dtype(fields)
    content[4:8] = ds.sizes[tracks.along[0]].to_bytes(4, "big")
    return bytes(content[: -record.itemsize]), record


@contextlib.contextmanager
def _growing(output: Path, header: bytes, size: int, bounds: Any, force: bool) -> Iterator[tuple[Any, int]]:
    """The file beside `output` to which records of `size` bytes are added, and the tracks that are in it already; it becomes the output when all went well."""
    if is_stream(output):
        raise ValueError(f"the output must be a file, got the stream {str(output)!r}")
    target = Path(os.path.realpath(output))
    growing = target.with_name(f"{target.name}.partial")
    if growing.exists():
        with growing.open("rb") as file:
            own = file.read(len(header)) == header
        if not (own or force):
            raise ValueError(f"{str(growing)!r} holds a part of another result: remove it, or overwrite it (force)")
        if not own:
            growing.unlink()
    if not growing.exists():
        with replacing(growing) as name:
            Path(name).write_bytes(header)
    with growing.open("r+b") as file:
        if fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ValueError(f"{str(growing)!r} is being written by another process: wait until it is done, or give another output") from None
        records = (growing.stat().st_size - len(header)) // size
        begin = int(np.searchsorted(bounds, records, side="right")) - 1
        file.truncate(len(header) + int(bounds[begin]) * size)
        file.seek(0, os.SEEK_END)
        try:
            yield file, begin
        except (ValueError, TypeError):  # the same call would fail again
            growing.unlink()
            raise
        file.flush()
        os.fsync(file.fileno())
        os.replace(growing, target)
