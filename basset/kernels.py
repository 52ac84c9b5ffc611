"""The memory kernels K(s) of the history force, and their moments.

A kernel is a small frozen class. Every kernel here can be written K(s) = dt^(-1/2) K'(s/dt), where K' is a kernel of
the same family with its time scale measured in steps (`Kernel.scaled`). All weights are therefore built for a unit step.
"""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset import _validate

__all__ = ["BassetKernel", "Kernel", "MeiAdrianKernel", "VaryingSlipKernel"]

Floats = NDArray[np.floating[Any]]


@lru_cache(maxsize=64)
def gauss_legendre(points: int) -> tuple[Floats, Floats]:
    """Nodes and weights of the Gauss–Legendre rule on [0, 1], read-only."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


def checked_lags(s: ArrayLike) -> Floats:
    """`s` as float64 lags of 0 or greater; TypeError for what holds no real numbers, ValueError for negative ones and NaN."""
    s = _validate.unmasked("s", s)
    try:
        lags = np.asarray(s)
        if lags.dtype.kind not in "fiu":
            raise TypeError
        lags = lags.astype(np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"s must be an array of real lags in seconds, got {_validate.shown(s)}") from None
    if not np.all(lags >= 0.0):
        raise ValueError(f"s must hold lags of 0 or greater (seconds), got {lags[~(lags >= 0.0)].flat[0]:g}")
    return lags


def checked_interval(near: float, far: float) -> None:
    """ValueError unless far > near (s)."""
    if far <= near:
        raise ValueError("far must be greater than near = {} (seconds), got {}".format(*_validate.apart(near, far)))


def checked_kernel(kernel: Any, *also: type) -> None:
    """TypeError for what is no kernel, nor one of `also`."""
    if not isinstance(kernel, (Kernel, *also)):
        raise TypeError(f"kernel must be a kernel such as basset.BassetKernel(), got {_validate.shown(kernel)}")


class Kernel(abc.ABC):
    """A memory kernel K(s), s > 0 in seconds; K(s) ~ s^(-1/2) as s → 0, or bounded.

    Subclasses are frozen dataclasses: hashable, comparable, picklable. Their parameters are checked on creation.

    Notes
    -----
    Every kernel here is homogeneous or self-similar in time: see `scaled`.

    References
    ----------
    Basset (1888), A Treatise on Hydrodynamics, vol. 2; each kernel names its own.

    Examples
    --------
    >>> from basset import BassetKernel, MeiAdrianKernel
    >>> all(isinstance(kernel, Kernel) for kernel in (BassetKernel(), MeiAdrianKernel(0.01, 1e-3, 1e-6)))
    True
    """

    references: ClassVar[tuple[str, ...]]

    @abc.abstractmethod
    def _values(self, s: Floats) -> Floats:
        """K(s) for a float64 array of positive lags, unchecked."""

    @abc.abstractmethod
    def _derivatives(self, s: Floats) -> Floats:
        """dK/ds for a float64 array of positive lags, unchecked."""

    @abc.abstractmethod
    def scaled(self, dt: float) -> Kernel:
        """The kernel K' with K(s) = dt^(-1/2) K'(s/dt): the same memory with time counted in steps of `dt` seconds.

        Parameters
        ----------
        dt : float, seconds
            Greater than 0.

        Returns
        -------
        Kernel

        Examples
        --------
        >>> K = MeiAdrianKernel(0.01, 1e-3, 1e-6)
        >>> abs(K(0.3) - K.scaled(0.1)(3.0) / math.sqrt(0.1)) < 1e-12
        True
        """

    @property
    def bend(self) -> float:
        """The crossover lag, in seconds, about which K departs from s^(−1/2); infinite if it never does."""
        return math.inf

    def rule(self, near: float, far: float) -> tuple[Floats, Floats]:
        """Nodes x in [0, 1] and weights w with ∫_near^far K(s) q((s−near)/(far−near)) ds = Σ w q(x).

        To rounding for polynomials q up to degree 15, wherever `near` lies, 0 included: Gauss–Legendre on dyadic panels towards
        s = 0, which suits any K that is smooth but there, also one in fractional powers of s.

        Parameters
        ----------
        near, far : float, seconds
            0 ≤ near < far.

        Returns
        -------
        ndarray (points,), dimensionless; ndarray (points,), s^(1/2)
            Nodes and weights.

        Examples
        --------
        >>> x, w = BassetKernel().rule(0.0, 1.0)
        >>> abs(w @ x**3 - 1.0 / 3.5) < 1e-14  # ∫ s^(-1/2) s³ ds
        np.True_
        """
        x, w = gauss_legendre(20)
        # what is left out below the finest panel weighs less than 1e-18 of the whole
        levels = 125 + max(0, math.ceil(math.log2(far / min(1.0, self.bend) + 1.0)))
        edges = np.append(far * 2.0 ** -np.arange(levels, dtype=np.float64), 0.0)
        edges = np.append(edges[edges > near], near)[::-1] if near > 0.0 else edges[::-1]
        low, width = edges[:-1, None], np.diff(edges)[:, None]
        s = low + width * x
        weights = width * w * self._values(s)
        return (((low - near) + width * x) / (far - near)).ravel(), weights.ravel()

    def __call__(self, s: ArrayLike) -> Any:
        """K(s), elementwise.

        Parameters
        ----------
        s : array_like (...), seconds
            Lags t − τ, 0 or greater; converted to float64.

        Returns
        -------
        ndarray of float64 in the shape of `s` (a float for a scalar), s^(-1/2); inf at s = 0.

        Raises
        ------
        ValueError
            If a lag is negative or NaN: there is no memory of the future.
        TypeError
            If `s` does not hold real numbers.

        Examples
        --------
        >>> BassetKernel()(0.0), BassetKernel()(4.0)
        (inf, 0.5)
        """
        lags = checked_lags(s)
        with np.errstate(divide="ignore", over="ignore"):
            result = self._values(lags)
        return result if result.ndim else float(result)

    def moments(self, near: float, far: float, degree: int) -> Floats:
        """Moments ∫_near^far K(s) ((s−near)/(far−near))^m ds for m = 0 … degree.

        Parameters
        ----------
        near, far : float, seconds
            0 ≤ near < far.
        degree : int
            0 to 15.

        Returns
        -------
        ndarray (degree+1,), s^(1/2); relative error a few units in the last place.

        Raises
        ------
        ValueError, TypeError
            If the interval is empty, reversed or negative, or the degree out of range.

        Examples
        --------
        >>> BassetKernel().moments(0.0, 1.0, 1).round(12)  # ∫ s^(-1/2) ds and ∫ s^(1/2) ds
        array([2.        , 0.66666667])
        """
        near, far = _validate.non_negative("near", near, "seconds"), _validate.positive("far", far, "seconds")
        checked_interval(near, far)
        degree = _validate.integer("degree", degree, 0, 15)
        nodes, weights = self.rule(near, far)
        return np.asarray(weights @ nodes[:, None] ** np.arange(degree + 1))


@dataclass(frozen=True)
class BassetKernel(Kernel):
    """The standard kernel of unsteady Stokes flow, K(s) = s^(-1/2).

    It is homogeneous: stretching time only rescales it, so one set of dimensionless weights serves every step size.

    References
    ----------
    Basset (1888), A Treatise on Hydrodynamics, vol. 2; Maxey & Riley (1983), Phys. Fluids 26, 883.

    Examples
    --------
    >>> BassetKernel()([0.25, 1.0, 4.0])
    array([2. , 1. , 0.5])
    """

    references: ClassVar[tuple[str, ...]] = (
        "Basset (1888), A Treatise on Hydrodynamics, vol. 2",
        "Maxey & Riley (1983), Phys. Fluids 26, 883",
    )

    def _values(self, s: Floats) -> Floats:
        return np.asarray(1.0 / np.sqrt(s))

    def _derivatives(self, s: Floats) -> Floats:
        return -0.5 / (s * np.sqrt(s))

    def scaled(self, dt: float) -> BassetKernel:
        """The kernel itself: s^(-1/2) = dt^(-1/2) (s/dt)^(-1/2)."""
        return self

    def rule(self, near: float, far: float) -> tuple[Floats, Floats]:
        """Gauss–Legendre in σ = √s, in which K(s) ds = 2 dσ and a polynomial in s stays a polynomial."""
        x, w = gauss_legendre(16)
        low, high = math.sqrt(near), math.sqrt(far)
        span = (far - near) / (low + high)  # √far − √near without cancellation
        return x * (2.0 * low + x * span) / (low + high), 2.0 * span * w


@dataclass(frozen=True)
class MeiAdrianKernel(Kernel):
    """The finite-Reynolds kernel, K(s) = s^(-1/2) [1 + (C s^(3/2))^(1/c1)]^(-c1), at a fixed slip.

    C = √π U³ / (2 ν^(3/2) f_H³), f_H = 0.75 + c2 Re, Re = U d/ν. It follows s^(-1/2) at short lags and decays as s^(-2)
    at long ones. Zero slip gives the Basset kernel exactly. Valid for small fluctuations about a mean slip; the fast
    decay does not hold for flow reversal or for a sphere that stops (Lawrence & Mei 1995).

    Parameters
    ----------
    slip : float, m/s
        U, the magnitude of the slip velocity; 0 or greater.
    diameter : float, m
        d, greater than 0.
    viscosity : float, m²/s
        ν, the kinematic viscosity; greater than 0.
    c1 : float, dimensionless
        2 (Mei & Adrian) or 2.5 (Dorgan & Loth); 0.5 or greater.
    c2 : float, dimensionless
        0.105 (Mei & Adrian) or 0.2 (Dorgan & Loth); 0 or greater.

    Raises
    ------
    ValueError
        If a parameter is negative, not finite or out of the range above.
    TypeError
        If a parameter is not a real number.

    References
    ----------
    Mei & Adrian (1992), J. Fluid Mech. 237, 323 (thesis eqs. 5-3, 5-4); Dorgan & Loth (2007), Int. J.
    Multiphase Flow 33, 833.

    Examples
    --------
    >>> MeiAdrianKernel(0.0, 1e-3, 1e-6)(4.0)  # no slip: Basset's
    0.5
    >>> K = MeiAdrianKernel(0.01, 1e-3, 1e-6)
    >>> round(K.reynolds, 12), 3.9 < K(1e4) / K(2e4) < 4.1  # s^(-2) at long lags
    (10.0, True)
    """

    slip: float
    diameter: float
    viscosity: float
    c1: float = 2.0
    c2: float = 0.105

    references: ClassVar[tuple[str, ...]] = (
        "Mei & Adrian (1992), J. Fluid Mech. 237, 323",
        "Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833",
    )

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "slip", _validate.non_negative("slip", self.slip, "m/s"))
        set_field(self, "diameter", _validate.positive("diameter", self.diameter, "m"))
        set_field(self, "viscosity", _validate.positive("viscosity", self.viscosity, "m²/s"))
        set_field(self, "c1", _validate.positive("c1", self.c1))
        set_field(self, "c2", _validate.non_negative("c2", self.c2))
        if self.c1 < 0.5:
            raise ValueError(f"c1 must be 0.5 or greater (2 or 2.5 in the literature), got {_validate.apart(self.c1, 0.5)[0]}")
        if not math.isfinite(self.steepness):
            raise ValueError(
                f"slip, diameter and viscosity must give a finite kernel coefficient C, got C = {self.steepness} "
                f"from slip {self.slip:g} m/s, diameter {self.diameter:g} m, viscosity {self.viscosity:g} m²/s"
            )

    @classmethod
    def dorgan_loth(cls, slip: float, diameter: float, viscosity: float) -> MeiAdrianKernel:
        """The kernel with the constants of Dorgan & Loth (2007): c1 = 2.5, c2 = 0.2.

        Parameters
        ----------
        slip : float, m/s
            U, 0 or greater.
        diameter : float, m
            d, greater than 0.
        viscosity : float, m²/s
            ν, greater than 0.

        Returns
        -------
        MeiAdrianKernel

        Raises
        ------
        ValueError, TypeError
            As `MeiAdrianKernel`.

        References
        ----------
        Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833.

        Examples
        --------
        >>> MeiAdrianKernel.dorgan_loth(0.01, 1e-3, 1e-6).c1
        2.5
        """
        return cls(slip, diameter, viscosity, c1=2.5, c2=0.2)

    @property
    def reynolds(self) -> float:
        """Re = U d/ν, dimensionless."""
        return self.slip * self.diameter / self.viscosity

    @property
    def steepness(self) -> float:
        """C = √π U³ / (2 ν^(3/2) f_H³), in s^(-3/2)."""
        with np.errstate(all="ignore"):
            ratio = np.float64(self.slip) / (0.75 + self.c2 * np.float64(self.reynolds))
            return float(0.5 * math.sqrt(math.pi) * (ratio / np.sqrt(self.viscosity)) ** 3)

    @property
    def bend(self) -> float:
        """C^(−2/3), in seconds."""
        return self.steepness ** (-2.0 / 3.0) if self.steepness > 0.0 else math.inf

    def _bent(self, s: Floats) -> Floats:
        """(C s^(3/2))^(1/c1), overflowing to infinity where K underflows to zero."""
        if self.steepness == 0.0:  # also at infinite lag
            return np.zeros_like(s)
        with np.errstate(over="ignore"):
            return np.asarray((self.steepness ** (2.0 / 3.0) * s) ** (1.5 / self.c1))

    def _values(self, s: Floats) -> Floats:
        return np.asarray((1.0 + self._bent(s)) ** -self.c1 / np.sqrt(s))

    def _derivatives(self, s: Floats) -> Floats:
        bend = self._bent(s)
        share = 1.0 / (1.0 + 1.0 / np.maximum(bend, 1e-300))  # bend/(1+bend), finite when bend is infinite
        return -self._values(s) * (0.5 + 1.5 * share) / s

    def scaled(self, dt: float) -> MeiAdrianKernel:
        """Time in units of `dt`, length kept: slip and viscosity are multiplied by `dt`, Re stays."""
        return replace(self, slip=self.slip * dt, viscosity=self.viscosity * dt)


@dataclass(frozen=True)
class VaryingSlipKernel:
    """The Mei–Adrian family with a slip that varies in time; pass it to `rule.plan` and `slip=` to the plan's methods.

    Parameters
    ----------
    diameter : float, m
    viscosity : float, m²/s
    slip_range : (float, float), m/s
        The smallest and largest slip for which the kernel is to be used, 0 < low < high. A slip outside is replaced by the nearer end and counted
        (`plan.outside`).
    slip_at : {"t", "tau"}
        Whether the kernel is that of the slip at the present time t or at the time τ of the rate. Exponential takes "t" only.
    c1, c2 : float, dimensionless
        As in `MeiAdrianKernel`: 2 and 0.105, or 2.5 and 0.2 (Dorgan & Loth).

    Raises
    ------
    ValueError, TypeError
        If a parameter is out of range, or slip_range does not rise.

    References
    ----------
    Mei & Adrian (1992), J. Fluid Mech. 237, 323; Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833.

    Examples
    --------
    >>> kernel = VaryingSlipKernel(diameter=1e-3, viscosity=1e-6, slip_range=(1e-3, 1.0))
    >>> bool(np.isclose(kernel.steepness(np.array([0.1]))[0], kernel.at(0.1).steepness))
    True
    """

    diameter: float
    viscosity: float
    slip_range: tuple[float, float]
    slip_at: str = "t"
    c1: float = 2.0
    c2: float = 0.105

    def __post_init__(self) -> None:
        try:
            low, high = self.slip_range
        except (TypeError, ValueError):
            raise TypeError(f"slip_range must be a pair (low, high) in m/s, got {_validate.shown(self.slip_range)}") from None
        low, high = _validate.positive("slip_range[0]", low, "m/s"), _validate.positive("slip_range[1]", high, "m/s")
        if high <= low:
            raise ValueError("slip_range must rise, got ({}, {}) m/s".format(*_validate.apart(low, high)))
        object.__setattr__(self, "slip_range", (low, high))
        _validate.choice("slip_at", self.slip_at, ("t", "tau"))
        for slip in (low, high):
            self.at(slip)

    def at(self, slip: float) -> MeiAdrianKernel:
        """The kernel of one slip.

        Parameters
        ----------
        slip : float, m/s

        Returns
        -------
        MeiAdrianKernel
        """
        return MeiAdrianKernel(slip, self.diameter, self.viscosity, self.c1, self.c2)

    def steepness(self, slip: Floats) -> Floats:
        """C(U), elementwise, as MeiAdrianKernel.steepness.

        Parameters
        ----------
        slip : ndarray (...), m/s

        Returns
        -------
        ndarray (...), s^(-3/2)
        """
        friction = 0.75 + self.c2 * slip * self.diameter / self.viscosity
        return np.asarray(0.5 * math.sqrt(math.pi) * (slip / friction / math.sqrt(self.viscosity)) ** 3)


AnyKernel = Kernel | VaryingSlipKernel
