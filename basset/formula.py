"""Kernels given by a formula: user-defined ones, and those of Gatignol (2007) for a solid sphere with slip at its surface and for a clean bubble.

What a table holds for other kernels is computed here when asked for: moments by quadrature in √s, in which a kernel that starts as s^(−1/2)
is smooth, and sums of exponentials by `basset.positive_sums`.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from basset import _validate
from basset.kernels import Floats, Kernel, gauss_legendre

__all__ = ["BubbleKernel", "FormulaKernel", "SlipSphereKernel"]

NEAR = ("inverse_sqrt", "bounded")
TINY = (1e-36, 1e-32)  # lags at which a kernel has begun
POINTS = 24  # per panel
HALVED = 57  # of √far: what is left out below is less than rounding
TIMES = (1e-200, 1e200)  # s: τ^(−3/2) is a number
DEEPEST = 12  # how often a panel is halved where K is not smooth
CENTRAL = (5.0 / 6.0, -5.0 / 21.0, 5.0 / 84.0, -5.0 / 504.0, 1.0 / 1260.0)  # differences over twice 1 … 5 steps, exact to degree 10
SERIES = 8.0  # from this √(s/τ) on the slope of exp(x²) erfc(x) is taken from its series
TERMS = 20


def graded_rule(values: Callable[[Floats], Floats], near: float, far: float, finest: float) -> tuple[Floats, Floats]:
    """`Kernel.rule` for any K, `values`: Gauss–Legendre in σ = √s, in which s^(−1/2) ds = 2 dσ has no singularity.

    Panels are halved towards σ = 0 down to the length `finest` (√s), and where the integral of K over one says so.
    """
    x, w = gauss_legendre(POINTS)
    low, high = math.sqrt(near), math.sqrt(far)
    span = (far - near) / (low + high)  # √far − √near without cancellation
    edges = high * 2.0 ** -np.arange(max(1.0, math.ceil(math.log2(high / finest)) + 1.0))
    starts = np.append(edges[edges > low][1:] - low, 0.0)[::-1]  # offsets from √near
    sizes = np.diff(np.append(starts, span))
    offsets, weights = np.empty(0), np.empty(0)
    total = 0.0

    def parts(starts: Floats, sizes: Floats) -> tuple[Floats, Floats]:
        offset = starts[:, None] + sizes[:, None] * x
        sigma = low + offset
        return offset, 2.0 * sizes[:, None] * w * sigma * values(sigma**2)

    for depth in range(DEEPEST + 1):
        offset, weight = parts(starts, sizes)
        total = max(total, float(np.abs(weight).sum()))
        whole = weight.sum(axis=1)
        halves = np.stack([starts, starts + 0.5 * sizes], axis=1).ravel(), np.repeat(0.5 * sizes, 2)
        rough = np.abs(parts(*halves)[1].sum(axis=1).reshape(-1, 2).sum(axis=1) - whole) > 1e-14 * total
        if depth == DEEPEST:
            rough[:] = False
        offsets, weights = np.append(offsets, offset[~rough]), np.append(weights, weight[~rough])
        if not rough.any():
            break
        starts, sizes = (array.reshape(-1, 2)[rough].ravel() for array in halves)
    return (offsets / span) * ((offsets + 2.0 * low) / (low + high)), weights


@dataclass(frozen=True, repr=False)
class FormulaKernel(Kernel):
    """A user-defined kernel, K(s) = τ^(−1/2) function(s/τ).

    Every rule, stream and solver takes it. Sums of exponentials (`Exponential`, tails, `Collocation`) are fitted when asked for, with a promised error,
    if K is completely monotone: positive, falling, convex, and so on for all derivatives. If it is not, the fit raises an error; rules over the full
    history, windows without tail and `FixedStep` with these need no sum.

    Parameters
    ----------
    function : callable
        function(x), elementwise for a float64 array of x = s/τ > 0, dimensionless or, with τ = 1 s, s in seconds and K in s^(−1/2). Finite, and smooth on the
        scale of x itself. Kernels with the same function are equal; to be pickled it must be defined at the top level of a module.
    near : {"inverse_sqrt", "bounded"}
        How K begins: √s K(s), or K(s), has a finite limit as s → 0.
    derivative : callable or None
        d function/dx in the same form. None: by differences, good to about 1e-13 for a smooth function, or an error where differences over two step
        widths disagree. Needed for slip samples only.
    time_scale : float, seconds
        τ, greater than 0.

    Raises
    ------
    ValueError
        If the function does not begin as `near` says, or is not finite; a fit raises it if there is no sum.
    TypeError
        If the function is not callable, or does not return an array of numbers of the shape of x.

    Notes
    -----
    Moments are integrals in σ = √s, where s^(−1/2) ds = 2 dσ: the singularity is split off exactly, and they are good to rounding if the function is.
    A fitted sum errs by at most rtol·max(K(s), 1e-16 K(near)).

    References
    ----------
    Product integration: Young (1954), Proc. R. Soc. A 224, 552; sums for completely monotone functions: Bernstein (1929), Acta Math. 52, 1.

    Examples
    --------
    >>> import numpy as np
    >>> from basset import Daitche, integrate
    >>> faded = FormulaKernel(lambda s: np.exp(-s) / np.sqrt(s))  # forgets within a second
    >>> H = integrate(np.ones(101), 0.1, Daitche(3), kernel=faded)  # f' = 1: √π erf(√10)
    >>> bool(abs(H - math.sqrt(math.pi) * math.erf(math.sqrt(10.0))) < 1e-13)
    True
    """

    function: Callable[[Any], Any]
    near: str = "inverse_sqrt"
    derivative: Callable[[Any], Any] | None = None
    time_scale: float = 1.0

    references: ClassVar[tuple[str, ...]] = ("Young (1954), Proc. R. Soc. A 224, 552", "Bernstein (1929), Acta Math. 52, 1")

    def __post_init__(self) -> None:
        for name in ("function", "derivative"):
            given = getattr(self, name)
            if not callable(given) and (given is not None or name == "function"):
                raise TypeError(f"{name} must be callable as {name}(x) with an array of lags, got {_validate.shown(given)}")
        _validate.choice("near", self.near, NEAR)
        object.__setattr__(self, "time_scale", _validate.positive("time_scale", self.time_scale, "seconds"))
        x = np.array([*TINY, 1.0])
        first, second, one = self._called("function", x.copy()).tolist()
        power, factor = ("√s·K", np.sqrt(x)) if self.near == "inverse_sqrt" else ("K", np.ones(3))
        first, second, one = first * factor[0], second * factor[1], one * factor[2]
        if abs(first - second) > 1e-3 * max(abs(second), abs(one) if self.near == "bounded" else 0.0) or (self.near == "inverse_sqrt" and not first):
            raise ValueError(
                f"function must begin as near={self.near!r} says, with a finite limit of {power} as s → 0{' that is not 0' * (self.near != 'bounded')}, "
                f"got {first:.4g} at s = {TINY[0]:g} and {second:.4g} at {TINY[1]:g}"
            )

    def __repr__(self) -> str:
        scale = "" if self.time_scale == 1.0 else f", time_scale={self.time_scale:g}"
        return f"FormulaKernel({getattr(self.function, '__qualname__', repr(self.function))}, near={self.near!r}{scale})"

    def _called(self, name: str, x: Floats) -> Floats:
        """`function` or `derivative` at x > 0, checked."""
        if not x.size:
            return x
        with np.errstate(all="ignore"):
            returned = getattr(self, name)(x)
        try:
            found = np.asarray(returned, dtype=None if np.iscomplexobj(returned) else np.float64).astype(np.float64, casting="same_kind")
        except (TypeError, ValueError):
            raise TypeError(f"{name} must return real numbers, got {_validate.shown(returned)}") from None
        if found.shape != x.shape:
            raise TypeError(f"{name} must return an array of the shape of its argument, {x.shape}, got shape {found.shape}")
        if not np.isfinite(found).all():
            bad = ~np.isfinite(found)
            raise ValueError(f"{name} must be finite for all lags greater than 0, got {found[bad].flat[0]} at {x[bad].flat[0]:g}")
        return found

    def _values(self, s: Floats) -> Floats:
        s = np.asarray(s)
        start = s == 0.0
        if not start.any():
            return self._called("function", s / self.time_scale) / math.sqrt(self.time_scale)
        found = self._called("function", np.where(start, TINY[0], s / self.time_scale)) / math.sqrt(self.time_scale)
        return np.where(start, math.inf, found) if self.near == "inverse_sqrt" else found

    def _derivatives(self, s: Floats) -> Floats:
        if self.derivative is not None:
            return np.asarray(self._called("derivative", s / self.time_scale) / self.time_scale**1.5)
        coarse, fine = self._difference(s, s / 64.0), self._difference(s, s / 256.0)
        values = self._values(np.append(s.ravel(), 1.0))
        doubt = np.abs(coarse - fine) * s > 1e-6 * np.abs(values[:-1]).reshape(s.shape) + 1e-10 * abs(values[-1])
        if doubt.any():
            raise ValueError(f"derivative must be given with {self!r}: the function changes too fast for differences at lag {s[doubt].flat[0]:g}")
        return coarse

    def _difference(self, s: Floats, step: Floats) -> Floats:
        pairs = [c * (self._values(s + k * step) - self._values(s - k * step)) for k, c in enumerate(CENTRAL, 1)]
        return np.asarray(np.sum(pairs, axis=0) / step)

    def scaled(self, dt: float) -> FormulaKernel:
        """Time in units of `dt`: τ is divided by it."""
        other = object.__new__(type(self))  # checked already
        for name in ("function", "near", "derivative"):
            object.__setattr__(other, name, getattr(self, name))
        object.__setattr__(other, "time_scale", self.time_scale / dt)
        return other

    def rule(self, near: float, far: float) -> tuple[Floats, Floats]:
        """Gauss–Legendre in √s on panels that are halved towards 0, and where the function is not smooth enough for them."""
        return graded_rule(self._values, near, far, math.sqrt(far) * 2.0**-HALVED)


def slope(x: Floats) -> Floats:
    """d/dy of exp(y) erfc(√y) at √y = x: exp(x²) erfc(x) − 1/(√π x), at large x by its asymptotic series (Abramowitz & Stegun 1964, 7.1.23)."""
    from scipy.special import erfcx

    far = np.maximum(x, SERIES)
    term, total = np.ones_like(far), np.zeros_like(far)
    for k in range(1, TERMS):
        term = term * (-(2.0 * k - 1.0) / (2.0 * far**2))
        total += term
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(x > SERIES, total / (math.sqrt(math.pi) * far), erfcx(x) - 1.0 / (math.sqrt(math.pi) * x)))


def _time(length: float, viscosity: float) -> float:
    """length²/viscosity, which may be 0 or infinite."""
    return length / viscosity * length


class GatignolKernel(Kernel):
    """K(s) = strength·√(π/τ) exp(s/τ) erfc(√(s/τ)): bounded at short lags, strength·s^(−1/2) at long ones."""

    references: ClassVar[tuple[str, ...]] = (
        "Gatignol (2007), C. R. Mécanique 335, 606",
        "Yang & Leal (1991), Phys. Fluids A 3, 1822",
    )

    def __post_init__(self) -> None:
        names = [name for name in ("slip_length", "diameter", "viscosity") if hasattr(self, name)]
        for name in names:
            object.__setattr__(self, name, _validate.positive(name, getattr(self, name), "m²/s" if name == "viscosity" else "m"))
        if not TIMES[0] < self.time < TIMES[1]:
            raise ValueError(
                f"{', '.join(names)} must give a time τ between {TIMES[0]:g} s and {TIMES[1]:g} s (below: take BassetKernel()), got τ = {self.time:g} s"
            )

    @property
    @abc.abstractmethod
    def strength(self) -> float:
        """K(s) √s at long lags, dimensionless."""

    @property
    @abc.abstractmethod
    def time(self) -> float:
        """τ, in seconds."""

    def _values(self, s: Floats) -> Floats:
        from scipy.special import erfcx

        return np.asarray(self.strength * math.sqrt(math.pi / self.time) * erfcx(np.sqrt(s / self.time)))

    def _derivatives(self, s: Floats) -> Floats:
        return np.asarray(self.strength * math.sqrt(math.pi) * self.time**-1.5 * slope(np.sqrt(s / self.time)))

    def rule(self, near: float, far: float) -> tuple[Floats, Floats]:
        """Gauss–Legendre in √s, in which K is entire, on panels that are halved down to √τ."""
        return graded_rule(self._values, near, far, 0.5 * math.sqrt(self.time))


@dataclass(frozen=True)
class SlipSphereKernel(GatignolKernel):
    """The history of a solid sphere on which the fluid slips: its tangential velocity there is b/μ times the tangential stress (Navier's condition).

    K(s) = α √(π/τ) exp(s/τ) erfc(√(s/τ)), α = ((1 + 2λ)/(1 + 3λ))², τ = (λ/(1 + 3λ))² a²/ν, λ = b/a, a the radius. It takes the place of s^(−1/2)
    beside the usual coefficient: the force is 6 a² √(πμρ) ∫ K(t − τ) d(slip). Without slip (λ → 0) that is the Basset kernel, with λ → ∞ the
    bubble's. The quasi-steady drag is then 6πμa (1 + 2λ)/(1 + 3λ), the added mass stays 1/2.

    Parameters
    ----------
    slip_length : float, m
        b, greater than 0.
    diameter : float, m
        2a, greater than 0.
    viscosity : float, m²/s
        ν, the kinematic viscosity; greater than 0.

    Raises
    ------
    ValueError, TypeError
        If a parameter is not a number greater than 0, or τ too small or large to be computed with.

    References
    ----------
    Gatignol (2007), C. R. Mécanique 335, 606; Michaelides & Feng (1995), Int. J. Multiphase Flow 21, 315; Albano, Bedeaux & Mazur (1975), Physica A 80, 89.

    Examples
    --------
    >>> K = SlipSphereKernel(slip_length=1e-6, diameter=1e-3, viscosity=1e-6)
    >>> round(K(1.0), 3), K(0.0) < math.inf  # hardly slips: s^(-1/2) at long lags, bounded at short ones
    (0.996, True)
    """

    slip_length: float
    diameter: float
    viscosity: float

    @property
    def strength(self) -> float:
        """((1 + 2λ)/(1 + 3λ))², dimensionless."""
        share = 2.0 * self.slip_length / self.diameter
        return ((1.0 + 2.0 * share) / (1.0 + 3.0 * share)) ** 2

    @property
    def time(self) -> float:
        """τ = (λ/(1 + 3λ))² a²/ν, in seconds."""
        share = 2.0 * self.slip_length / self.diameter
        return _time(share / (1.0 + 3.0 * share) * 0.5 * self.diameter, self.viscosity)

    def scaled(self, dt: float) -> SlipSphereKernel:
        """Time in units of `dt`, lengths kept: the viscosity is multiplied by it."""
        return replace(self, viscosity=self.viscosity * dt)


@dataclass(frozen=True)
class BubbleKernel(GatignolKernel):
    """The history of a clean spherical bubble: no mass, no viscosity and no shear stress inside.

    K(s) = (4/9) √(π/τ) exp(s/τ) erfc(√(s/τ)), τ = a²/(9ν), a the radius. It takes the place of s^(−1/2) beside the coefficient of a solid sphere: the force is
    6 a² √(πμρ) ∫ K(t − τ) d(slip) = 8πμa ∫ exp(s/τ) erfc(√(s/τ)) d(slip). The quasi-steady drag is then 4πμa, the added mass stays 1/2.

    Parameters
    ----------
    diameter : float, m
        2a, greater than 0.
    viscosity : float, m²/s
        ν, the kinematic viscosity of the liquid; greater than 0.

    Raises
    ------
    ValueError, TypeError
        If a parameter is not a positive number, or τ too small or large to be computed with.

    References
    ----------
    Yang & Leal (1991), Phys. Fluids A 3, 1822; Galindo & Gerbeth (1993), Phys. Fluids A 5, 3290; Gatignol (2007), C. R. Mécanique 335, 606.

    Examples
    --------
    >>> K = BubbleKernel(diameter=1e-3, viscosity=1e-6)
    >>> round(K(1e4) * 100.0, 4), round(K(0.0), 2)  # 4/9 of Basset's at long lags, 8πμa over 6 a² √(πμρ) at the start
    (0.4444, 4.73)
    """

    diameter: float
    viscosity: float

    @property
    def strength(self) -> float:
        """4/9, dimensionless."""
        return 4.0 / 9.0

    @property
    def time(self) -> float:
        """τ = a²/(9ν), in seconds."""
        return _time(self.diameter / 6.0, self.viscosity)

    def scaled(self, dt: float) -> BubbleKernel:
        """Time in units of `dt`, lengths kept: the viscosity is multiplied by it."""
        return replace(self, viscosity=self.viscosity * dt)
