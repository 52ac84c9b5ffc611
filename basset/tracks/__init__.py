"""History forces along stored tracks of many particles: netCDF, zarr or CSV in, netCDF out, in chunks of tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from basset import _validate
from basset.kernels import BassetKernel, Kernel
from basset.tracks.files import write
from basset.tracks.forces import Particle
from basset.tracks.layout import Tracks

if TYPE_CHECKING:
    import xarray

__all__ = ["history", "write"]


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
        Tracks as rows (trajectory, obs), as Parcels writes them, with NaN after a track's end; as ragged arrays of CF along one dimension; or one track.
        Times as numbers with units in the attributes (none: seconds), as datetime64 or timedelta64; they need not be uniform.
    diameter : float, m
    viscosity : float, m²/s
        Kinematic.
    density : float, kg/m³
        Density of the fluid: the force is then in N.
    density_ratio : float, dimensionless
        Density of the particle over that of the fluid, in place of `density`: the force is then per mass of the particle, in m/s².
    slip : name or names, or None; m/s
        Variables of w: one with a dimension `component`, or one to three. Units in their attributes are converted.
    velocity, fluid : name or names, or None; m/s
        Variables of v, and of u at the particle, in place of the slip; fluid = "rest" for still fluid. None: recognised by usual names, the fluid also by
        standard names.
    position : name or names, or None; m or degrees
        Variables of the position, instead of the velocity, which is then differentiated from them; longitude and latitude are recognised by their unit.
    time : name or None
    kernel : Kernel
    order : int
        Degree of the polynomials through the samples of dw/dt, 1 to 3; dw/dt is that of polynomials of degree 2 or 4 through those of w.
    rtol : float, dimensionless
        Promised error of the sum of exponentials, as in `Exponential`.
    drag : "stokes" or "schiller_naumann"
        The drag law in the total force; affects `history_share` only.
    before : "rest" or "steady"
        The state before a track: no slip, so that the first slip is a jump that enters the history (and the force is infinite there), or a constant
        slip equal to the first one.
    gaps : "raise", "bridge" or "split"
        What to do where samples are missing (NaN) within a track: raise an error, interpolate over them, or start a new track after them.

    Returns
    -------
    xarray.Dataset
        `history_force` (trajectory, obs, component), N or m/s², and `history_share` (trajectory, obs): |F| over that of the sum of drag, added mass, history
        and, where the fluid's velocity is known, pressure gradient, with du/dt along the track for Du/Dt. NaN where a sample is missing.

    Raises
    ------
    ValueError, TypeError
        One sentence: no times or velocities found, times that do not rise, gaps, unknown units, an argument out of range.

    Notes
    -----
    H at a sample is computed from what came before: at the second and third of a track its order is lower. Where a step is more than 2000 times as
    long as one beside it, H is that of polynomials through w instead of dw/dt, so that errors of samples are not magnified. Times that are uniform up
    to the rounding of single precision are taken as uniform. A degree of latitude has 1852·60 m. Drag and added mass are those of a solid sphere,
    whatever the kernel.

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
    if not hasattr(ds, "data_vars"):
        raise TypeError(f"ds must be an xarray.Dataset, got {_validate.shown(ds)}")
    particle = Particle(diameter, viscosity, density, density_ratio, kernel, order, rtol, drag, before, gaps)
    tracks = Tracks(ds, {"slip": slip, "velocity": velocity, "fluid": fluid, "position": position, "time": time})
    return tracks.history(ds, 0, len(tracks), particle, particle.plan(*tracks.steps(ds, 0, len(tracks))))
