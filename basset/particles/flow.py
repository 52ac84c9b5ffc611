"""A flow that is given on a grid: one smooth interpolant, whose derivatives are those of the interpolant itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate, samples
from basset.kernels import Floats

AXES = ("time", "x", "y", "z")
MARGIN = 1e-10  # of the width: what starts on the edge is inside, and times may round
UNWRITTEN = 9e36  # netCDF's own fill value is greater
ROUND = 0.1  # how much shorter or longer the last spacing of a period may be: otherwise the period is a rounded or a wrong one
FEWEST = 4  # points of an axis, for cubic pieces


class Flow:
    """Velocities on a rectilinear grid in space and time, as tensor products of cubic B-splines; made by `Flow.from_dataset`.

    Value, gradient and material derivative are those of one interpolant, with continuous second derivatives. Its error falls with the fourth power of the
    spacing, that of its derivatives with the third. A particle that leaves a bounded grid stops there: nothing is extrapolated.

    Parameters
    ----------
    axes : list of (ndarray (n,), float); s for the first, m
        Points and period (0: bounded) along time, x, y and z; one point where nothing depends on it. A period ends with the values it began with.
    values : ndarray (n_t, n_x, n_y, n_z, d), m/s

    References
    ----------
    de Boor (1978), A Practical Guide to Splines.

    Examples
    --------
    >>> import numpy as np, xarray
    >>> x = np.linspace(-1.0, 1.0, 9)
    >>> grid = {"x": x, "y": x}
    >>> flow = Flow.from_dataset(xarray.Dataset({"u": (("x", "y"), -np.add.outer(0 * x, x)), "v": (("x", "y"), np.add.outer(x, 0 * x))}, grid))
    >>> flow(0.0, [0.3, 0.4]).round(9), flow.gradient(0.0, [0.3, 0.4]).round(9) + 0.0  # u = (−y, x)
    (array([-0.4,  0.3]), array([[ 0., -1.],
           [ 1.,  0.]]))
    >>> flow.material_derivative(0.0, [0.3, 0.4]).round(9)
    array([-0.3, -0.4])
    """

    def __init__(self, axes: list[tuple[Floats, float]], values: Floats) -> None:
        self.dimensions = values.shape[-1]
        knots: list[Floats] = []
        self.table = np.zeros((4, 8))  # count of coefficients, place of the knots, ends, period
        for axis, (points, period) in enumerate(axes):
            self.table[axis, :5] = 1, sum(map(len, knots)), -np.inf, np.inf, 0.0
            if len(points) == 1:
                continue
            place, values = _spline(points, values, axis, period)
            self.table[axis, :5] = len(place) - 4, sum(map(len, knots)), points[0], points[-1], period
            knots.append(place)
        self.knots, self.coefficients = np.concatenate(knots), np.ascontiguousarray(values)
        self.bounds = np.tile([-np.inf, np.inf], (4, 1))
        for axis, (points, period) in enumerate(axes):
            if len(points) > 1 and not period:
                margin = MARGIN * (points[-1] - points[0])
                self.bounds[axis] = points[0] - margin, points[-1] + margin

    @classmethod
    def from_dataset(cls, ds: Any, components: Sequence[str] = ("u", "v", "w"), periodic: Mapping[str, float] | None = None) -> Flow:
        """The flow of a dataset.

        Parameters
        ----------
        ds : xarray.Dataset
            Velocities in m/s over the dimensions x, y (and z) in m and, if the flow changes, time in s (datetimes: seconds since the first), in any
            order, four points or more along each, rising. Other units are converted if their attributes name them.
        components : sequence of str, one per dimension of space
            Names of the variables along x, y (and z). For a grid without z the third name is not used.
        periodic : mapping of str to float, or None; m (time: s)
            Period along the dimensions that have one. The grid spans it, with or without its last point, which equals the first.

        Returns
        -------
        Flow

        Raises
        ------
        ValueError, TypeError
            If the dataset does not have this form, or has missing values.

        Examples
        --------
        >>> import numpy as np, xarray
        >>> x, y = np.arange(16) * 2.0 * np.pi / 16, np.linspace(0.0, 1.0, 4)
        >>> waves = xarray.Dataset({"u": (("x", "y"), np.outer(np.sin(x), y)), "v": (("x", "y"), 0.0 * np.outer(x, y))}, {"x": x, "y": y})
        >>> flow = Flow.from_dataset(waves, periodic={"x": 2.0 * np.pi})
        >>> bool(abs(flow(0.0, [9.0, 1.0])[0] - np.sin(9.0)) < 1e-3)
        True
        """
        if not hasattr(ds, "data_vars"):
            raise TypeError(f"ds must be an xarray.Dataset, got {_validate.shown(ds)}")
        if not np.iterable(components):
            raise TypeError(f"components must be names of variables, got {_validate.shown(components)}")
        names = [components] if isinstance(components, str) else list(components)
        space = [name for name in AXES[1:] if name in ds.dims]
        if space not in (["x", "y"], ["x", "y", "z"]):
            raise ValueError(f"ds must have the dimensions x and y (and z); rename its dimensions, got {', '.join(map(str, ds.dims)) or 'none'}")
        if names == ["u", "v", "w"] and space == ["x", "y"]:
            names = names[:2]
        missing = [name for name in names if name not in ds.data_vars]
        if missing:
            raise ValueError(f"components must be variables of the dataset ({', '.join(map(str, ds.data_vars))}), got {missing[0]!r}")
        if len(names) != len(space):
            raise ValueError(f"components must be one for each of the dimensions x, y (and z) of the dataset, got {names} over {space}")
        if not isinstance(periodic or {}, Mapping):
            raise TypeError(f"periodic must be a mapping of dimensions to periods, got {_validate.shown(periodic)}")
        spans = dict(periodic or {})
        for name in spans:
            _validate.choice("periodic", name, [axis for axis in AXES if axis in ds.dims])
        used = [name for name in AXES if any(name in ds[variable].dims for variable in names)]
        for variable in names:
            odd = [name for name in ds[variable].dims if name not in AXES]
            if odd:
                raise ValueError(f"{variable} must have the dimensions time, x, y, z alone, got {odd[0]!r}; rename it, or select one of its entries")
        for variable in names:
            missed = int((~(np.abs(_validate.real_array(variable, ds[variable].values)) < UNWRITTEN)).sum())
            if missed:
                raise ValueError(f"{variable} must have no missing values, got {missed} that are not finite: {_validate.FILL}")
        import xarray

        values: Floats = np.stack([one.transpose(*used).values.astype(np.float64) for one in xarray.broadcast(*(ds[variable] for variable in names))], axis=-1)
        values *= [_unit(ds, variable, per_second=True) for variable in names]
        axes: list[tuple[Floats, float]] = []
        for number, name in enumerate(AXES):
            if name not in used:
                if name in space:
                    raise ValueError(f"the components must depend on {name}, which none of them has as a dimension")
                values = np.expand_dims(values, number)
                axes.append((np.zeros(1), 0.0))
                continue
            points, period = _points(ds, name), 0.0
            if name in spans:
                points, values, period = _closed(name, points, values, number, spans[name])
            if len(points) < FEWEST:
                raise ValueError(f"{name} must have {FEWEST} points or more, got {len(points)}")
            axes.append((points, period))
        return cls(axes, values)

    def _check(self, start: float, end: float, places: Floats) -> None:
        """Refuse a time span (s) or positions (n, d) (m) that the grid does not hold."""
        low, high = self.bounds[0]
        if start < low or end > high:
            raise ValueError(f"t_span must lie within the times of the flow, {low:g} s to {high:g} s, got ({start:g}, {end:g})")
        space = self.bounds[1 : 1 + self.dimensions]
        out = np.flatnonzero(((places < space[:, 0]) | (places > space[:, 1])).any(axis=1))
        if len(out):
            raise ValueError(f"position must lie within the grid of the flow, got {places[out[0]]} (particle {out[0]})")

    def __call__(self, t: float, x: ArrayLike) -> Floats:
        """Velocity, m/s.

        Parameters
        ----------
        t : float, seconds
        x : array_like (d,) or (n, d), m

        Returns
        -------
        ndarray (d,) or (n, d), m/s
            Outside a bounded grid the outermost cubics are extrapolated; `maxey_riley` stops at the edge.
        """
        return self._at(t, x)[..., : self.dimensions]

    def gradient(self, t: float, x: ArrayLike) -> Floats:
        """∂u_i/∂x_j.

        Parameters
        ----------
        t : float, seconds
        x : array_like (d,) or (n, d), m
            Where the derivatives are taken.

        Returns
        -------
        ndarray (d, d) or (n, d, d), 1/s
        """
        found, d = self._at(t, x), self.dimensions
        return found[..., 3:12].reshape(*found.shape[:-1], 3, 3)[..., :d, :d]

    def material_derivative(self, t: float, x: ArrayLike) -> Floats:
        """Du/Dt = ∂u/∂t + (u·∇)u, the acceleration of the fluid.

        Parameters
        ----------
        t : float, seconds
        x : array_like (d,) or (n, d), m
            Where the fluid is accelerated.

        Returns
        -------
        ndarray (d,) or (n, d), m/s²

        References
        ----------
        Auton, Hunt & Prud'homme (1988), J. Fluid Mech. 197, 241.
        """
        return self._at(t, x)[..., 12 : 12 + self.dimensions]

    def _at(self, t: float, x: ArrayLike) -> Floats:
        """All of it, as rows of `_equation.fields`."""
        from basset.particles import _grid  # loads the compiler

        time, places = _validate.number("t", t, "a time in seconds"), _validate.real_array("x", x)
        if places.ndim not in (1, 2) or places.shape[-1] != self.dimensions:
            raise ValueError(f"x must have {self.dimensions} components, got shape {places.shape}")
        flat = places.reshape(-1, self.dimensions)
        found = _grid.fields_of(_grid.gridded(self), np.full(len(flat), time), flat)
        return found.reshape(*places.shape[:-1], found.shape[1])


def _spline(points: Floats, values: Floats, axis: int, period: float) -> tuple[Floats, Floats]:
    """Knots and coefficients of the cubic spline along an axis: not-a-knot, or periodic; on equal spacings by Fourier's transform (de Boor 1978)."""
    from scipy.interpolate import make_interp_spline

    count, along = len(points) - 1, np.moveaxis(values, axis, 0)
    spacing = (points[-1] - points[0]) / count
    if not period or np.abs(np.diff(points) - spacing).max() > 1e-9 * spacing:
        spline = make_interp_spline(points, along, k=3, bc_type="periodic" if period else None)
        return spline.t, np.moveaxis(spline.c, 0, axis)
    # at a point the three splines around it are 1/6, 4/6 and 1/6
    symbol = (4.0 + 2.0 * np.cos(2.0 * np.pi * np.arange(count // 2 + 1) / count)) / 6.0
    shape = (-1, *(1,) * (along.ndim - 1))
    centred = np.fft.irfft(np.fft.rfft(along[:-1], axis=0) / symbol.reshape(shape), count, axis=0)
    return points[0] + spacing * np.arange(-3, count + 4), np.moveaxis(centred[np.arange(-1, count + 2) % count], 0, axis)


def _unit(ds: Any, name: str, per_second: bool) -> float:
    """m, or m/s, in the unit of a variable."""
    words = str(ds[name].attrs.get("units", "")).strip()
    found = samples.metres(words, per_second)
    if found is None:
        raise ValueError(f"{name} must be in {'m/s, mm/s, cm/s or km/s' if per_second else 'm, mm, cm or km'}, got the unit {words!r}")
    return found


def _points(ds: Any, name: str) -> Floats:
    """The places along a dimension, checked."""
    if name not in ds.coords:
        raise ValueError(f"the dataset must have coordinates along {name}, got none")
    given = ds[name].values
    points = _validate.real_array(name, (given - given[0]) / np.timedelta64(1, "s") if given.dtype.kind in "mM" else given)
    if given.dtype.kind not in "mM":
        points *= samples._unit(Path("the dataset"), name, ds[name].attrs.get("units")) if name == "time" else _unit(ds, name, per_second=False)
    if not (np.isfinite(points).all() and (np.diff(points) > 0.0).all()):
        raise ValueError(f"{name} must be finite and rise from point to point, got {_validate.shown(points)}")
    return points


def _closed(name: str, points: Floats, values: Floats, axis: int, given: float) -> tuple[Floats, Floats, float]:
    """Points and values of a periodic dimension with the first one repeated at the end."""
    period = _validate.positive(f"periodic[{name!r}]", given)
    span = float(points[-1] - points[0])
    first = np.take(values, [0], axis)
    if abs(span - period) <= 1e-6 * period / len(points):
        apart = np.abs(np.take(values, [-1], axis) - first).max()
        if apart > 1e-6 * np.abs(values).max():
            raise ValueError(f"values a period apart along {name} must be equal, got a difference of {apart:.3g} m/s")
        points, values = points[:-1], np.delete(values, -1, axis)
    elif not ROUND * np.diff(points).min() <= period - span <= np.diff(points).max() / ROUND:
        raise ValueError(f"periodic[{name!r}] must be the length of the grid, {span:.9g}, or longer by one spacing like the others, got {period:.9g}")
    return np.append(points, points[0] + period), np.concatenate([values, first], axis), period
