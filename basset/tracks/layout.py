"""Which variables of a dataset are times, velocities and positions of tracks, in any layout, and the result in the same one."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from basset import _validate, samples
from basset.kernels import Floats
from basset.particles.flow import UNWRITTEN
from basset.streaming.uneven import Planned
from basset.tracks.forces import Particle, Samples, forces, slopes

if TYPE_CHECKING:
    import xarray

DEGREE = 1852.0 * 60.0  # m of a degree of latitude, as Parcels has it
ANGLES = (r"lat(itude)?s?([_ ].*)?|degrees?_?n.*", r"lon(gitude)?s?([_ ].*)?|degrees?_?e.*")  # what is no longitude, and no latitude, by its name or unit
IDS = ("trajectory", "particle", "track", "traj", "id", "trajectory_id", "particle_id", "track_id")
OBSERVATIONS = ("obs", "observation", "observations", "sample", "samples")
COMPONENTS = ("component", "components", "direction", "space", "xyz")  # dimensions of vectors
NAMES = {  # one variable, or one per component
    "slip": ("slip", "slip_{xyz}", "slip_{uvw}", "{uvw}_slip", "{uvw}s"),
    "fluid": ("fluid_velocity", "fluid_velocity_{xyz}", "fluid_{uvw}", "{uvw}_fluid", "{uvw}f", "{uvw}_f", "u{xyz}", "u_{xyz}", "{UVW}"),
    "velocity": ("velocity", "particle_velocity", "velocity_{xyz}", "particle_{uvw}", "{uvw}_particle", "{uvw}p", "{uvw}_p", "v{xyz}", "v_{xyz}", "{uvw}"),
}
STANDARD_NAMES = (  # of the fluid's velocity along x, y, z
    ("sea_water_x_velocity", "eastward_sea_water_velocity", "x_wind", "eastward_wind"),
    ("sea_water_y_velocity", "northward_sea_water_velocity", "y_wind", "northward_wind"),
    ("upward_sea_water_velocity", "upward_air_velocity"),
)
FINE = 1e-9  # of a step: times that are rounded less are taken as they are
REST = "rest"  # in place of the fluid's velocity


@dataclass(frozen=True)
class Column:
    """A component of a vector: x, y or z, the variable, its unit in SI, and where along a dimension of components."""

    component: str
    name: str
    unit: float
    at: dict[Any, int]


class Tracks:
    """Which variables of a dataset are times, velocities and positions, and how to take some of its tracks.

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
        self.along = (self.sample,) if self.track is None else (self.track, self.sample)  # the first is that of records
        self.columns = next(iter(self.roles.values()))
        self.instance, self.rows = self.track or "trajectory", "row_size"
        self.order: Any = None
        self.bounds = self._followed(ds) if self.track is None else np.arange(ds.sizes[self.track] + 1)
        ids = [name for name in ds.variables if ds[name].dims == (self.instance,) and (name in IDS or ds[name].attrs.get("cf_role") == "trajectory_id")]
        numbers = ds[ids[0]].values if ids else np.empty(0)
        self.id = str(ids[0]) if ids else "trajectory"
        self.ids = numbers if numbers.dtype.kind in "iuf" and len(numbers) == len(self) else np.arange(len(self), dtype=np.int32)
        if self.ids.dtype.kind in "iu" and (np.abs(self.ids) < 2**31).all():  # netCDF 3 knows no longer integers
            self.ids = self.ids.astype(np.int32)

    def _followed(self, ds: xarray.Dataset) -> Any:
        """Where the tracks along the one dimension begin, with the end; and in which order samples are taken."""
        size = ds.sizes[self.sample]
        counts = [name for name in ds.variables if ds[name].attrs.get("sample_dimension") == self.sample and ds[name].ndim == 1]
        index = [name for name in ds.variables if "instance_dimension" in ds[name].attrs and ds[name].dims == (self.sample,)]
        rows = np.array([size])
        for name in (counts or index)[:1]:
            numbers = np.asarray(ds[name].values)
            if numbers.dtype.kind not in "iuf" or not (numbers >= 0).all() or not (numbers == np.floor(numbers)).all():
                raise ValueError(f"{name!r} must hold whole numbers, 0 or greater, got {_validate.shown(numbers)}")
            rows = numbers.astype(np.int64)
        if counts:
            self.instance, self.rows = ds[counts[0]].dims[0], str(counts[0])
            if rows.sum() != size:
                raise ValueError(f"{counts[0]!r} must count the {size} samples along {self.sample!r}, got {rows.sum()} in all")
        elif index:
            self.instance = ds[index[0]].attrs["instance_dimension"]
            if self.instance not in ds.sizes:
                rows = np.unique(rows, return_inverse=True)[1]
            elif len(rows) and rows.max() >= (most := ds.sizes[self.instance]):
                raise ValueError(f"{index[0]!r} must number tracks along {self.instance!r} from 0 to {most - 1}, got {rows.max()}")
            self.order = np.argsort(rows, kind="stable")
            rows = np.bincount(rows, minlength=ds.sizes.get(self.instance, 0))
        return np.concatenate([[0], np.cumsum(rows)])

    def __len__(self) -> int:
        return len(self.bounds) - 1

    def part(self, ds: xarray.Dataset, start: int, stop: int) -> xarray.Dataset:
        """Tracks start … stop − 1, still to be read."""
        if self.track is not None:
            return ds.isel({self.track: slice(start, stop)})
        at = slice(int(self.bounds[start]), int(self.bounds[stop]))
        return ds.isel({self.sample: at if self.order is None else self.order[at]})

    def owners(self, part: xarray.Dataset, start: int, stop: int) -> Any:
        """The track of each sample (samples,) of those tracks."""
        return np.repeat(np.arange(start, stop), np.diff(self.bounds[start : stop + 1]) if self.track is None else part.sizes[self.sample])

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

    def steps(self, ds: xarray.Dataset, start: int, stop: int) -> tuple[float, float]:
        """(shortest step, longest duration) in seconds of tracks start … stop − 1; refused unless times rise along each."""
        part = self.part(ds, start, stop)
        times, whose = self.times(part), self.owners(part, start, stop)
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
        """The samples of those tracks; gaps are refused, bridged or split as `particle.gaps` says."""
        times, whose = self.times(part), self.owners(part, start, stop)
        fluid = self.values(part, "fluid") if "fluid" in self.roles else None
        moved = self.values(part, next(iter(self.roles)))
        whole = moved if fluid is None else moved + fluid
        if (endless := np.isinf(whole).any(axis=1)).any():
            raise ValueError(f"velocities must be finite, or NaN where they are missing, got an infinite one in track {whose[int(np.argmax(endless))]}")
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
                "interpolate over them with gaps = bridge, or start a new track after them with gaps = split"
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
        found = slopes(times, places, bounds, degree)
        if turning and len(columns) > 1:
            found[:, 0] *= np.cos(np.radians(places[:, 1] / DEGREE))
        return found

    def history(self, ds: xarray.Dataset, start: int, stop: int, particle: Particle, plan: Planned) -> xarray.Dataset:
        """The result for tracks start … stop − 1."""
        part = self.part(ds, start, stop)
        size = len(self.owners(part, start, stop))
        force, share = np.full((size, len(self.columns)), np.nan), np.full(size, np.nan)
        found = self.taken(part, start, stop, particle)
        if len(found.places):
            force[found.places], share[found.places] = forces(found, particle, plan)
        return self.result(part, start, stop, force, share, particle)

    def result(self, part: xarray.Dataset, start: int, stop: int, force: Floats, share: Floats, particle: Particle) -> xarray.Dataset:
        """The result for those tracks."""
        import xarray

        shape = tuple(part.sizes[dim] for dim in self.along)
        names = [column.component for column in self.columns]
        units = "N" if particle.density is not None else "m s-2"
        what = "history force on the particle" + " per mass of the particle" * (particle.density is None)
        fields: dict[Any, Any] = {
            "history_force": ((*self.along, "component"), force.reshape(*shape, len(names)), {"units": units, "long_name": what}),
            "history_share": (self.along, share.reshape(shape), {"units": "1", "long_name": "size of the history force over that of the sum of forces"}),
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
    made[(np.abs(made) > UNWRITTEN) & np.isfinite(made)] = np.nan
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
            f"tracks must have one time variable, recognised by its units or the name time; name it by `time`, got {_names(found or ds.variables)}"
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
    if moved == "position":
        _check_sphere(ds, made[moved])
    if fluid != [REST]:
        made["fluid"] = _columns(ds, "fluid", fluid)
        if len({len(columns) for columns in made.values()}) > 1:
            raise ValueError(f"{moved} and fluid must have the same number of components, got {_names(mover)} and {_names(fluid)}")
    return made


def _listed(role: str, names: Any) -> list[str]:
    """Names from a word, a text with commas or a sequence."""
    if not (names is None or isinstance(names, str) or np.iterable(names)):
        raise TypeError(f"{role} must name one to three variables, got {_validate.shown(names)}")
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
    known = [next((str(name) for name in ds.variables if ds[name].attrs.get("standard_name") in wanted), None) for wanted in STANDARD_NAMES]
    return [name for name in known if name is not None]


def _columns(ds: xarray.Dataset, role: str, names: list[str]) -> list[Column]:
    """Variables as components."""
    for name in names:
        _validate.choice(role, name, map(str, ds.variables))
    vector = [dim for dim in ds[names[0]].dims if str(dim).lower() in COMPONENTS] if len(names) == 1 else []
    if vector:
        return [Column("xyz"[k], names[0], _unit(ds, role, names[0]), {vector[0]: k}) for k in range(min(ds.sizes[vector[0]], 3))]
    alone = {"v": "y", "w": "z", "y": "y", "z": "z"}.get(names[0][-1:].lower(), "x")  # by the last letter of its name
    letters = "xyz" if len(names) > 1 else alone
    return [Column(letter, name, _unit(ds, role, name), {}) for letter, name in zip(letters, names, strict=False)]


def _check_sphere(ds: xarray.Dataset, columns: list[Column]) -> None:
    """Refuse places in degrees that are not longitude, latitude and perhaps a height: what a degree of longitude measures follows from the latitude."""
    turning = [abs(column.unit) == DEGREE for column in columns]
    words = [(column.name, *(str(ds[column.name].attrs.get(key, "")) for key in ("units", "standard_name"))) for column in columns]
    swapped = [any(re.fullmatch(other, word, re.IGNORECASE) for word in found) for found, other in zip(words, ANGLES, strict=False)]
    if any(turning) and (turning[:2] != [True, True] or any(turning[2:]) or any(swapped)):
        names = _names([column.name for column in columns])
        raise ValueError(f"position in degrees must name longitude, then latitude, and then perhaps a height or depth, got {names}")


def _unit(ds: xarray.Dataset, role: str, name: str) -> float:
    """m/s (for positions: m) in the unit of a variable."""
    words = str(ds[name].attrs.get("units", "")).strip()
    if role == "position" and words.startswith("degree"):
        return DEGREE
    found = samples.metres(words, per_second=role != "position")
    if found is None or (role == "position" and not words and any(re.fullmatch(angle, name, re.IGNORECASE) for angle in ANGLES)):
        raise ValueError(f"{name!r} must be in {'m, mm, cm, km or degrees' if role == 'position' else 'm/s, mm/s, cm/s or km/s'}, got the unit {words!r}")
    down = role == "position" and ds[name].attrs.get("positive") == "down"
    return -found if down else found
