"""The stream: mean velocity and shear by laws of the wall, one small class per profile, all in units of u* and d.

A profile has `velocity_and_shear(z)`: velocity and its derivative at height z (diameters) above the bed level; at and below the bed 0.
Flights evaluate its table (`tabulated`).
The choice of profile changes the mean velocity of a grain by 4 to 64 % (reports/saltation.md).
"""

from __future__ import annotations

import bisect
import dataclasses
import itertools
import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from basset._compile import load, method
from basset.kernels import Floats
from saltation.grain import Numbers

__all__ = ["Laden", "LogLaw", "Profile", "Reichardt", "Still", "Swamee", "profile_of", "rougher", "saltation_layer", "yalin_shift"]

VON_KARMAN = 0.41
FINE = 0.03  # of ln z, between two points of a profile that grains change


class Still(NamedTuple):
    """No stream."""

    nothing: float  # a tuple that is compiled cannot be empty

    def velocity_and_shear(self, z: float) -> tuple[float, float]:
        """(0, 0)."""
        return 0.0, 0.0

    def continued(self, z: float, ahead: float) -> tuple[float, float]:
        """(0, 0)."""
        return 0.0, 0.0


class Profile:
    """A velocity profile: `extended(z)` gives velocity (u*) and shear (u*/d) for z > 0 (d, above the bed level), smoothly; both are 0 at `floor` and below.

    >>> class Couette(Profile):
    ...     def extended(self, z):
    ...         return 2.0 * z, 2.0
    >>> Couette().extended(3.0), Couette().velocity_and_shear(3.0), Couette().velocity_and_shear(-1.0)
    ((6.0, 2.0), (6.0, 2.0), (0.0, 0.0))
    """

    floor = 0.0

    def extended(self, z: float) -> tuple[float, float]:
        """Velocity and shear above the floor."""
        raise NotImplementedError

    def velocity_and_shear(self, z: float) -> tuple[float, float]:
        """Velocity and shear, 0 at and below the floor."""
        return (0.0, 0.0) if z <= self.floor else self.extended(z)

    def continued(self, z: float, ahead: float) -> tuple[float, float]:
        """Velocity and shear at z, smoothly continued from the side of the floor on which z + ahead lies."""
        return (0.0, 0.0) if z + ahead <= self.floor else self.extended(z)


@dataclass(frozen=True)
class Reichardt(Profile):
    """Smooth wall: u⁺ = ln(1 + κz⁺)/κ + 7.8 (1 − e^(−z⁺/11) − (z⁺/11) e^(−0.33 z⁺)). Reichardt (1951), Z. Angew. Math. Mech. 31, 208."""

    reynolds: float  # u* d/ν
    kappa: float  # κ

    def extended(self, z: float) -> tuple[float, float]:
        """Velocity and shear."""
        wall = z * self.reynolds
        slow, fast = math.exp(-wall / 11.0), math.exp(-0.33 * wall)
        velocity = math.log1p(self.kappa * wall) / self.kappa + 7.8 * (-math.expm1(-wall / 11.0) - wall / 11.0 * fast)
        slope = 1.0 / (1.0 + self.kappa * wall) + 7.8 / 11.0 * (slow - fast * (1.0 - 0.33 * wall))
        return velocity, slope * self.reynolds


@dataclass(frozen=True)
class Swamee(Profile):
    """Smooth to rough in one: u⁺ = {(z⁺)^(−10/3) + [κ⁻¹ ln(1 + 9 z⁺/(1 + 0.3 k_s⁺))]^(−10/3)}^(−0.3).

    No singularity at the bed. Source: Swamee (1993), J. Irrig. Drain. Eng. 119, 656 (constants as in the project's notes).
    """

    reynolds: float  # u* d/ν
    kappa: float  # κ
    scale: float  # 9/(1 + 0.3 k_s⁺)

    def extended(self, z: float) -> tuple[float, float]:
        """Velocity and shear."""
        wall = z * self.reynolds
        turbulent = math.log1p(self.scale * wall) / self.kappa
        ratio = wall / turbulent  # of the viscous to the turbulent branch, at least κ/scale
        power = ratio * ratio * ratio * ratio ** (1.0 / 3.0)
        velocity = wall * (1.0 + power) ** -0.3
        slope = self.scale / (self.kappa * (1.0 + self.scale * wall))
        return velocity, self.reynolds * (1.0 + power * ratio * slope) * velocity / (wall * (1.0 + power))


@dataclass(frozen=True)
class LogLaw(Profile):
    """u⁺ = ln(z/k_s)/κ + B above the height where it vanishes, 0 below. Yalin (1992), River Mechanics; B = 8.5 over rough beds."""

    roughness: float  # k_s/d
    kappa: float  # κ
    shift: float  # B

    @property
    def floor(self) -> float:  # type: ignore[override]
        """z₀ = k_s e^(−κB), in d: where the velocity vanishes."""
        return self.roughness * math.exp(-self.kappa * self.shift)

    def extended(self, z: float) -> tuple[float, float]:
        """Velocity and shear."""
        return math.log(z / self.roughness) / self.kappa + self.shift, 1.0 / (self.kappa * z)


@dataclass(frozen=True)
class Laden(Profile):
    """A profile that grains have taken the stress τ_p(z) from: at each height its shear times r, s r + (1 − s) r|r| = 1 − τ_p/(1 − z/h).

    s is the share of the stress that viscosity carries, the rest keeps its mixing length: √|τ_f|/(κz) for the logarithm. Without τ_p the profile itself.
    ValueError for heights above the surface, where no stress is left to share.
    Prandtl (1925), Z. Angew. Math. Mech. 5, 136; Owen (1964), J. Fluid Mech. 20, 225 (as in the project's notes).
    """

    base: Profile
    heights: tuple[float, ...]  # d, rising
    stress: tuple[float, ...]  # τ_p there, ρu*²; below the first the same share of 1 − z/h, above the last none
    depth: float = math.inf  # h, d

    def __post_init__(self) -> None:
        """Grains take no stress from where there is no water."""
        if self.heights[-1] >= self.depth:
            raise ValueError(f"heights must end below the surface, {self.depth:g} d, got {self.heights[-1]:g} d")

    @property
    def floor(self) -> float:  # type: ignore[override]
        """The base's."""
        return self.base.floor

    def left(self, z: Floats) -> Floats:
        """The fluid's share of the stress at heights, (1 − z/h − τ_p)/(1 − z/h)."""
        from scipy.interpolate import PchipInterpolator

        shares = np.array(self.stress) / (1.0 - np.array(self.heights) / self.depth)
        taken = PchipInterpolator(np.log(self.heights), shares)(np.log(np.clip(z, self.heights[0], self.heights[-1])))
        found: Floats = 1.0 - np.where(z < self.heights[-1], taken, 0.0)
        return found

    @cached_property
    def change(self) -> tuple[list[float], list[list[float]]]:
        """Points in ln z, and for each the polynomial of the change of velocity from there on; the last is the change above all grains."""
        from scipy.interpolate import CubicSpline

        start, own = math.log(max(self.floor, LOWEST)), np.log(self.heights)
        ends = np.concatenate([[start], own[own > start]])  # where what is interpolated has kinks
        pieces = [np.linspace(a, b, max(4, math.ceil((b - a) / FINE)), endpoint=False) for a, b in itertools.pairwise(ends)]
        x = np.concatenate([*pieces, own[-1:]])
        z = np.exp(x)
        shear = np.array([self.base.extended(height)[1] for height in z])
        viscous = np.minimum(1.0, shear / getattr(self.base, "reynolds", math.inf))
        left = self.left(z)
        ratio = 2.0 * left / (viscous + np.sqrt(viscous**2 + 4.0 * (1.0 - viscous) * np.abs(left)) + 1e-300)
        spline = CubicSpline(x, (ratio - 1.0) * shear * z).antiderivative()
        lowest = 0.0 if self.floor > 0.0 else (ratio[0] - 1.0) * self.base.extended(z[0])[0]
        change = spline.c.T + np.array([0.0, 0.0, 0.0, 0.0, lowest])
        return x.tolist(), [*change.tolist(), [0.0, 0.0, 0.0, 0.0, float(spline(x[-1])) + lowest]]

    def extended(self, z: float) -> tuple[float, float]:
        """Velocity and shear."""
        points, pieces = self.change
        velocity, shear = self.base.extended(z)
        x = math.log(z)
        k = max(0, bisect.bisect(points, x) - 1)
        t, (a, b, c, d, e) = x - points[k], pieces[k]
        if t < 0.0:  # next to the bed: viscous, or below the floor
            ratio = 1.0 + d / (shear * z)
            return velocity * ratio, shear * ratio
        rise = ((4.0 * a * t + 3.0 * b) * t + 2.0 * c) * t + d
        return velocity + (((a * t + b) * t + c) * t + d) * t + e, shear + rise / z


def saltation_layer(stage: float, diameter: float) -> float:
    """Thickness of the layer in which grains of that diameter (m) jump, in d: 0.68 T/(1 + A₂T), A₂ = 0.0204 ln²D + 0.0220 ln D + 0.0709, D in cm.

    Nothing up to T = 1, where nothing moves. Wiberg & Rubin (1989), J. Geophys. Res. 94(C4), 5011 (constants as in the project's notes).

    >>> round(saltation_layer(2.0, 0.69e-3), 3)
    1.034
    """
    size = math.log(100.0 * diameter)
    return 0.68 * stage / (1.0 + (0.0204 * size**2 + 0.0220 * size + 0.0709) * stage) if stage > 1.0 else 0.0


def rougher(profile: Any, by: float) -> Any:
    """The profile with a roughness length z₀ that is greater by so much (d); ValueError for one that has none."""
    if isinstance(profile, LogLaw):
        return dataclasses.replace(profile, roughness=profile.roughness * (1.0 + by / profile.floor))
    if isinstance(profile, Swamee):
        return dataclasses.replace(profile, scale=1.0 / (1.0 / profile.scale + by * profile.reynolds))
    raise ValueError("it has no roughness length")


OCTAVES = (-24, 14)  # heights 2^-24 d to 2^14 d
CELLS = 8  # per octave
DEGREE = 9
LOWEST, HIGHEST = math.ldexp(1.0, OCTAVES[0]), math.ldexp(1.0, OCTAVES[1])
BELOW = math.nextafter(HIGHEST, 0.0)
LAST = CELLS * (OCTAVES[1] - OCTAVES[0])  # the cell above the floor
SMOOTH = 1e-13  # the last Chebyshev coefficient of that cell over the largest


class Tabulated(NamedTuple):
    """Any profile as polynomials on eighths of octaves of z, good to 1e-12: what flights evaluate, in a third of the time.

    One type for all profiles, so that another profile compiles nothing anew.
    """

    floor: float  # the stream vanishes here and below
    slope: float  # below the table: shear at the bed
    width: float  # of the cell above the floor, d: its polynomial continues the profile as far below
    cells: int  # address of (cell, power): velocity in x from −1 to 1 across the cell; the last is the one above the floor

    def velocity_and_shear(self, z: float) -> tuple[float, float]:
        """Velocity and shear."""
        if z <= self.floor:
            return 0.0, 0.0
        beyond = 0.0
        if not z < HIGHEST:  # above the table every profile is a logarithm; NaN must not become an address
            beyond, z = math.log(z / HIGHEST), BELOW
        mantissa, exponent = math.frexp(z)
        if exponent <= OCTAVES[0]:
            return self.slope * z, self.slope
        place = (mantissa - 0.5) * (2 * CELLS)
        part = int(place)
        cell = ((exponent - 1 - OCTAVES[0]) * CELLS + part) * (DEGREE + 1)
        x = 2.0 * (place - part) - 1.0
        velocity, rise = load(self.cells, cell + DEGREE), 0.0
        for k in range(DEGREE - 1, -1, -1):
            rise = rise * x + velocity
            velocity = velocity * x + load(self.cells, cell + k)
        rise *= math.ldexp(4.0 * CELLS, -exponent)
        if beyond != 0.0:
            return velocity + beyond * rise * z, rise * math.exp(-beyond)
        return velocity, rise

    def continued(self, z: float, ahead: float) -> tuple[float, float]:
        """As `velocity_and_shear`, but smooth across the floor: from the side on which z + ahead lies."""
        if z + ahead <= self.floor:
            return 0.0, 0.0
        if z > self.floor + LOWEST:
            found: tuple[float, float] = velocity_and_shear(self, z)
            return found
        x = 2.0 * (z - self.floor) / self.width - 1.0
        rest = min(0.0, x + 3.0)  # from there on straight
        x -= rest
        cell = LAST * (DEGREE + 1)
        velocity, rise = load(self.cells, cell + DEGREE), 0.0
        for k in range(DEGREE - 1, -1, -1):
            rise = rise * x + velocity
            velocity = velocity * x + load(self.cells, cell + k)
        return velocity + rest * rise, rise * 2.0 / self.width


KEPT: list[Floats] = []  # the tables that addresses point to


def monomials(series: Floats) -> Floats:
    """`numpy.polynomial.chebyshev.cheb2poly` for all columns at once."""
    last = np.zeros_like(series)
    first, last[0] = last.copy(), series[-1]
    first[0] = series[-2]
    for row in series[-3::-1]:
        doubled = 2.0 * np.roll(last, 1, axis=0)  # its last row is zero
        first, last = -last, first + doubled
        first[0] += row
    return np.asarray(first + np.roll(last, 1, axis=0))


@cache
def tabulated(profile: Profile | Still) -> Tabulated:
    """The table of a profile, made once; of still water, where the stream vanishes up to any height."""
    if isinstance(profile, Still):
        cells = np.zeros((LAST + 1, DEGREE + 1))
        KEPT.append(cells)
        return Tabulated(math.inf, 0.0, 1.0, cells.ctypes.data)
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    edges = np.ldexp(1.0 + np.arange(CELLS) / CELLS, np.arange(*OCTAVES)[:, None]).ravel()
    widths = np.repeat(np.ldexp(1.0 / CELLS, np.arange(*OCTAVES)), CELLS)
    above = np.ldexp(1.0, np.arange(OCTAVES[0], -1))  # widths of cells above the floor: the widest that is exact
    edges, widths = np.append(edges, np.full(len(above), profile.floor)), np.append(widths, above)
    heights = edges[:, None] + 0.5 * widths[:, None] * (1.0 + nodes)
    velocity = np.array([[profile.extended(z)[0] for z in row] for row in heights])
    values = chebyshev.chebvander(nodes, DEGREE)
    coefficients = np.linalg.solve(values, velocity.T)
    exact = np.abs(coefficients[-1, LAST:]) <= SMOOTH * np.abs(coefficients[:, LAST:]).max(axis=0)
    widest = int(np.argmax(exact * above))
    coefficients = coefficients[:, [*range(LAST), LAST + widest]]
    cells = np.ascontiguousarray(monomials(coefficients).T)
    KEPT.append(cells)
    return Tabulated(profile.floor, profile.extended(heights[0, -1])[1], float(above[widest]), cells.ctypes.data)


velocity_and_shear = method("velocity_and_shear", 1)
"""`velocity_and_shear(profile, z)`: velocity and shear, also in compiled code."""
continued = method("continued", 2)
"""`continued(profile, z, ahead)`: the same, smooth across the floor, from the side on which z + ahead lies."""


def yalin_shift(roughness_reynolds: float) -> float:
    """B(Re_k) of the law of the wall: 5.5 for smooth, 8.5 for rough beds; ValueError for Re_k = u* k_s/ν below 1.

    Yalin (1992), River Mechanics (constants as in the project's notes).
    """
    if roughness_reynolds < 1.0:
        raise ValueError(f"profile 'yalin' needs a roughness Reynolds number u* k_s/ν of at least 1, got {roughness_reynolds:g}; take 'reichardt' or 'swamee'")
    log = math.log(roughness_reynolds)
    return 8.5 + (2.5 * log - 3.0) * math.exp(-0.121 * log**2.42)


PROFILES = {
    "none": "still water",
    "swamee": "smooth to rough (Swamee 1993)",
    "yalin": "law of the wall with Yalin's B(Re_k): smooth to rough",
    "constant_b": "law of the wall with B = 8.5: rough",
    "reichardt": "smooth (Reichardt 1951)",
}
REGIMES = {"smooth": "reichardt", "transitional": "yalin", "rough": "constant_b"}


def profile_of(name: str, numbers: Numbers, roughness: float = 1.0, kappa: float = VON_KARMAN) -> Any:
    """The profile of a name in PROFILES or REGIMES, roughness k_s/d; ValueError if there is none, or it does not hold for the scene's Re_k."""
    if name not in PROFILES and name not in REGIMES:
        raise ValueError(f"profile must be one of {', '.join([*PROFILES, *REGIMES])}, got {name!r}")
    name, wall = REGIMES.get(name, name), numbers.reynolds * roughness
    if name == "none":
        return Still(0.0)
    if name == "reichardt":
        return Reichardt(numbers.reynolds, kappa)
    if name == "swamee":
        return Swamee(numbers.reynolds, kappa, 9.0 / (1.0 + 0.3 * wall))
    return LogLaw(roughness, kappa, 8.5 if name == "constant_b" else yalin_shift(wall))
