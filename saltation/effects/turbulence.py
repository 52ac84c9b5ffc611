"""Turbulence: fluctuations u', v', w' of the stream over its mean profile, each grain's own, as a smooth function of time that it feels through its slip.

Profiles, ζ = z/h, h the depth (Nezu & Nakagawa 1993, measured in smooth open channels, 0.05 < ζ < 0.9): σ_u = 2.30 e^(−ζ), σ_v = 1.63 e^(−ζ), σ_w = 1.27 e^(−ζ)
in u*. Near the bed, s = z⁺ over a smooth one: σ_u Γ + 0.3 s (1 − Γ) with Γ = 1 − e^(−s/10) (the same source), σ_w (1 − e^(−s/26)) (van Driest 1956), and
σ_v (1 − e^(−s/18)), fitted here; −⟨u'w'⟩ = (1 − ζ) l²du/dz of van Driest's mixing length l = κ s (1 − e^(−s/26)). All four within 25 % of channel DNS at
Re_τ = 186 (del Álamo & Jiménez 2003) for 15 < z⁺ and ζ < 0.95. Over a rough bed they fall to 0 at the bed level within a tenth of k_s: there s is
z in units in which 26 are that height, if it is more than 26 ν/u*: an assumption, as computed intensities end between the crests and a fifth of d below
(Chan-Braun, García-Villalba & Uhlmann 2011). At the surface w' vanishes within 0.05 h.

Time scale T_L: the diffusivity σ_w² T_L = (1 − ζ) ν_t, van Driest's ν_t, so that what is suspended follows Rouse's profile; or 0.5 z/σ_w (Hanna 1982);
or 2σ_w²/(C0 ε) with ε = 9.8 u*³ ζ^(−1/2) e^(−3ζ)/h (Nezu & Nakagawa 1993). Never below 10 units of s (the value at smooth walls, Kallio & Reeks 1989).
What falls through eddies sees them for a shorter time: T_L/√(1 + β²(4 v_r² − 3 v_z²)/σ²), Csanady's (1963) T_∥ of a slip v_r upwards and his T_⊥ across.

The realisation: the clock of a grain's eddies runs by dτ/dt = 1/T, and ξ(τ), three for each grain, are sums of B-splines of degree 5 times numbers that are
a function of (seed, grain, index): four times differentiable, with variance 1 and integral scale 1. w' = σ_w W, W = ξ_w + q, and
u' = σ_u (√(1 − r²) ξ_u − r W), so that ⟨u'w'⟩ comes out. q is what keeps tracers well mixed (Thomson 1987): for a Gaussian ξ of autocorrelation R it is
∫R T σ_w' dτ, since a Gaussian that is independent of z stays so if the drift of W's whole past is its covariance with W; R is met by a damped oscillator
of the same integral and first moment. Of the drift of a tracer a grain has the share 1/(1 + τ_p/T_L) (Bocksell & Loth 2006), τ_p its relaxation time.

A grain is pushed by the fluid's own acceleration, (1 + C_m) Du_f/Dt along the path of the fluid: there the clock runs by T_L, and heights change by w'.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from pydantic import Field, model_validator

from basset._compile import compiled, load, separate, shared
from basset.kernels import Floats
from saltation._random import uniforms
from saltation._tables import Table
from saltation.effects.base import Setting
from saltation.flow import monomials
from saltation.grain import Triple

__all__ = ["Eddies", "Options", "Profiles", "profiles_of"]

NAME = "turbulence"
SOURCE = "Nezu & Nakagawa (1993), Turbulence in Open-Channel Flows; van Driest (1956), J. Aeronaut. Sci. 23, 1007; Thomson (1987), J. Fluid Mech. 180, 529"
VALID = "uniform flow in a wide channel; each grain has fluctuations of its own, uncorrelated with those of its neighbours"

INTENSITIES = (2.30, 1.63, 1.27)  # σ/u* along, across, up at the bed without damping
INNER = 0.3  # slope of σ_u at a smooth wall
BUFFER = 10.0  # s, of Γ
ACROSS = 18.0  # s, over which σ_v is damped: fitted to DNS at Re_τ = 186
VAN_DRIEST = 26.0  # s
SLOWEST = 10.0  # s: T_L is no shorter
SURFACE = 0.05  # h over which w' vanishes at the surface
HIGHEST = 1.1  # h: above, all is as there
DISSIPATION = 9.8
STATES = 3  # the clock τ, the drift q and its rate
OWN = 5  # of a grain's own numbers before the eddies': spin, layer, and which grain it is
EDDIES = 1 << 62  # first number of the draws of eddies, far beyond those of impacts
SPLINE = 5  # degree of the B-splines
SLOTS = 4  # intervals between two knots that are kept
SLOT = 1 + 3 * (SPLINE + 1)  # numbers of an interval: which, and coefficients of three components
BEGINS = 1.0  # of the clock


def pieces(degree: int) -> Floats:
    """The cardinal B-spline of a degree in its intervals [k, k + 1]: (power of the place in the interval, k)."""
    found = np.ones((1, 1))
    for p in range(1, degree + 1):  # de Boor (1978), A Practical Guide to Splines, ch. X
        below, above = np.pad(found, ((0, 1), (0, 1))), np.pad(found, ((0, 1), (1, 0)))
        k = np.arange(p + 1.0)
        found = (k * below + np.roll(below, 1, axis=0) + (p + 1.0 - k) * above - np.roll(above, 1, axis=0)) / p
    return found


CORRELATION = pieces(2 * SPLINE + 1)[:, SPLINE + 1 :]  # ∫B(x) B(x + y) dx by the whole part of y from 0 on
VARIANCE = float(CORRELATION[0, 0])  # of ξ without its factor, on the average over the interval
KNOTS = 2.0 * VARIANCE  # between two knots of τ, for an integral scale of 1
PER_KNOT = 1.0 / KNOTS
POWERS, WHOLE = np.arange(2.0 * SPLINE + 2.0)[:, None], np.arange(SPLINE + 1.0)
FIRST = float((CORRELATION * (1.0 / (POWERS + 2.0) + WHOLE / (POWERS + 1.0))).sum()) * KNOTS**2 / VARIANCE  # ∫τR of ξ
DAMPING = 0.5 / (1.0 - FIRST)  # R = e^(−aτ)(cos bτ + a/b sin bτ) has ∫R = 2a/(a² + b²) = 1 and ∫τR = 1 − 1/(2a)

OCTAVES = (-10, 14)  # heights 2^-10 d to 2^14 d
CELLS = 32  # per octave: w' falls to 0 within 0.05 h at the surface
DEGREE = 5
KINDS = 6  # of profiles: r σ_u, √(1 − r²) σ_u, σ_v, σ_w, 1/T_L², (β/(T_L σ))²
LOWEST, HIGHEST_CELL = math.ldexp(1.0, OCTAVES[0]), math.nextafter(math.ldexp(1.0, OCTAVES[1]), 0.0)
CELL = KINDS * (DEGREE + 1)
BASIS = CELLS * (OCTAVES[1] - OCTAVES[0]) * CELL  # where the B-splines lie in the table


class Options(Table):
    """Strength, time scale and damping of the fluctuations."""

    amplitude: float = Field(1.0, ge=0.0, le=10.0, description="factor on all fluctuations, dimensionless; 0: none")
    time_scale: Literal["diffusivity", "hanna", "dissipation"] = Field("diffusivity", description="T_L: (1 − ζ) ν_t/σ_w², 0.5 z/σ_w, or 2σ_w²/(C0 ε)")
    c0: float | None = Field(None, gt=0.0, le=100.0, description="C0 of time_scale = 'dissipation', dimensionless, 2 to 6; default 4")
    crossing: float = Field(1.0, ge=0.0, le=10.0, description="β of the effect of crossing trajectories, dimensionless; 0: none")
    damping: float = Field(VAN_DRIEST, ge=1.0, le=30.0, description="van Driest's height of the damping at the bed, in units of ν/u*")
    rough_damping: float = Field(0.1, ge=0.0, le=10.0, description="least height of the damping, in units of k_s")

    @model_validator(mode="after")
    def _one_law(self) -> Options:
        if self.c0 is not None and self.time_scale != "dissipation":
            raise ValueError(f"c0 belongs to time_scale = 'dissipation', got {self.c0:g} with time_scale = {self.time_scale!r}: leave one of them out")
        return self


class Profiles(NamedTuple):
    """The statistics of the stream at a height: in units of u* and d."""

    along: Any  # σ_u
    across: Any  # σ_v
    up: Any  # σ_w
    correlation: Any  # r = −⟨u'w'⟩/(σ_u σ_w)
    time: Any  # T_L
    eddy: Any  # σ of the eddies that are fallen through


def profiles_of(options: Options, setting: Setting, z: Any) -> Profiles:
    """At heights z > 0 (d) above the bed level."""
    unit = max(1.0 / setting.numbers.reynolds, options.rough_damping * setting.roughness / options.damping)  # d, of s
    z = np.minimum(z, HIGHEST * setting.depth)
    s, height = z / unit, z / setting.depth
    outer = np.exp(-height)
    near = -np.expm1(-s / options.damping)
    length = setting.kappa * s * near
    root = np.sqrt(1.0 + 4.0 * length * length)
    turbulent = (root - 1.0) / (root + 1.0)  # share of the shear stress
    gamma = -np.expm1(-s / BUFFER)
    along = INTENSITIES[0] * outer * gamma + INNER * s * (1.0 - gamma)
    across = INTENSITIES[1] * outer * -np.expm1(-s / ACROSS)
    eddy = INTENSITIES[2] * outer
    correlation = (1.0 - height) * turbulent / (along * eddy * near)  # below 0.97 for all options allowed and any κ < 1
    if options.time_scale == "hanna":
        scale = 0.5 * z / eddy
    elif options.time_scale == "dissipation":
        # √ζ h = z/√ζ also where the depth is infinite
        scale = 2.0 * (eddy * near) ** 2 * np.sqrt(z * min(setting.depth, HIGHEST_CELL)) * np.exp(3.0 * height) / (DISSIPATION * (options.c0 or 4.0))
    else:
        scale = unit * (1.0 - height) * 0.5 * (root - 1.0) / (eddy * near) ** 2  # ν_t = l² du/dz, (√(1 + 4 l²) − 1)/2 in ν
    up = eddy * near * np.tanh((1.0 - height) / SURFACE)
    a = options.amplitude
    return Profiles(a * along, a * across, a * up, correlation, np.hypot(scale, SLOWEST * unit), eddy)


class Eddies(NamedTuple):
    """What moves the fluid around a grain: profiles and B-splines (the address of their table), seed, τ_p (d/V), 1 + C_m."""

    table: int
    seed: int
    lag: float
    inertia: float


KEPT: list[Floats] = []  # the tables that addresses point to


@cache
def tabulated(options: tuple[Any, ...], setting: Setting) -> int:
    """The address of the table of the profiles, made once: (cell, power, kind) in x from −1 to 1 across a cell, and the B-splines."""
    given = Options(**dict(options))
    edges = np.ldexp(1.0 + np.arange(CELLS) / CELLS, np.arange(*OCTAVES)[:, None]).ravel()
    widths = np.repeat(np.ldexp(1.0 / CELLS, np.arange(*OCTAVES)), CELLS)
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    found = profiles_of(given, setting, edges[:, None] + 0.5 * widths[:, None] * (1.0 + nodes))
    rest = np.sqrt(1.0 - found.correlation**2)
    rate = found.time**-2
    kinds = np.stack([found.correlation * found.along, rest * found.along, found.across, found.up, rate, rate * (given.crossing / found.eddy) ** 2])
    series = np.linalg.solve(chebyshev.chebvander(nodes, DEGREE), kinds.reshape(-1, DEGREE + 1).T)
    powers = monomials(series).T.reshape(KINDS, len(edges), DEGREE + 1).transpose(1, 2, 0)
    KEPT.append(np.concatenate([powers.ravel(), pieces(SPLINE)[:, ::-1].ravel() / math.sqrt(VARIANCE)]))
    return KEPT[-1].ctypes.data


def build(options: Options, setting: Setting) -> Eddies | None:
    """The eddies of a scene; None where they are switched off."""
    if options.amplitude == 0.0:
        return None
    numbers = setting.numbers
    plain = setting._replace(numbers=numbers, profile=None, seed=0)
    table = tabulated(tuple(options.model_dump(exclude_none=True).items()), plain)
    # at the settling velocity of a sphere after Ferguson & Church (2004), J. Sediment. Res. 74, 933: R g d²/(18 ν + √(0.3 R g d³))
    lag = numbers.reynolds / (numbers.alpha * (18.0 + math.sqrt(0.3) * numbers.particle_reynolds))
    return Eddies(table, setting.seed, lag, 1.0 + numbers.added_mass)


@shared
def whole(number: Any) -> Any:
    """A number that counts, as compiled code takes it."""
    return np.int64(number)


@separate
def fill(e: Any, index: int, own: Any, base: int) -> None:
    """The interval number `index` between two knots as polynomials into own[base:]."""
    for k in range(SLOT):
        own[base + k] = 0.0
    own[base] = index + 1.0
    for j in range(SPLINE + 1):
        draws = uniforms(e.seed, whole(own[OWN - 1]), EDDIES + index + j)
        size, other = math.sqrt(-2.0 * math.log(draws[0])), math.sqrt(-2.0 * math.log(draws[2]))
        one, two, three = size * math.cos(2.0 * math.pi * draws[1]), size * math.sin(2.0 * math.pi * draws[1]), other * math.cos(2.0 * math.pi * draws[3])
        for power in range(SPLINE + 1):
            share = load(e.table, BASIS + (SPLINE + 1) * power + j)
            own[base + 1 + power] += share * one
            own[base + 1 + (SPLINE + 1) + power] += share * two
            own[base + 1 + 2 * (SPLINE + 1) + power] += share * three


@shared
def horner(own: Any, base: int, x: float) -> tuple[float, float]:
    """A component in an interval, and its derivative by τ."""
    value, slope = own[base + SPLINE], 0.0
    for k in range(SPLINE - 1, -1, -1):
        slope = slope * x + value
        value = value * x + own[base + k]
    return value, slope * PER_KNOT


@separate
def eddy_at(e: Any, clock: float, own: Any) -> tuple[float, float, float, float, float, float]:
    """ξ_u, ξ_v, ξ_w at a reading of the clock, and their derivatives."""
    place = clock * PER_KNOT
    below = math.floor(place)
    index = whole(below)
    base = OWN + SLOT * (index & (SLOTS - 1))
    if own[base] != below + 1.0:
        fill(e, index, own, base)
    x = place - below
    u, du = horner(own, base + 1, x)
    v, dv = horner(own, base + 1 + (SPLINE + 1), x)
    w, dw = horner(own, base + 1 + 2 * (SPLINE + 1), x)
    return u, v, w, du, dv, dw


class Local(NamedTuple):
    """The table at a height: r σ_u, √(1 − r²) σ_u, σ_v, σ_w, their derivatives, 1/T_L² and (β/(T_L σ))²."""

    tied: float
    free: float
    across: float
    up: float
    tied_slope: float
    free_slope: float
    across_slope: float
    up_slope: float
    rate: float
    crossing: float


@shared
def one_of(table: int, cell: int, kind: int, x: float) -> tuple[float, float]:
    """A profile and its derivative by x."""
    place = cell + kind
    value, slope = load(table, place + KINDS * DEGREE), 0.0
    for k in range(DEGREE - 1, -1, -1):
        slope = slope * x + value
        value = value * x + load(table, place + KINDS * k)
    return value, slope


@separate
def local(e: Any, z: float) -> Local:
    """The profiles at a height; below the bed level nothing moves."""
    high = min(max(z, LOWEST), HIGHEST_CELL) if not math.isnan(z) else LOWEST  # NaN must not become an address
    mantissa, exponent = math.frexp(high)
    place = (mantissa - 0.5) * (2 * CELLS)
    part = whole(place)
    cell = ((exponent - 1 - OCTAVES[0]) * CELLS + part) * CELL
    x, scale = 2.0 * (place - part) - 1.0, 4.0 * CELLS * (mantissa / high)
    tied, tied_slope = one_of(e.table, cell, 0, x)
    free, free_slope = one_of(e.table, cell, 1, x)
    across, across_slope = one_of(e.table, cell, 2, x)
    up, up_slope = one_of(e.table, cell, 3, x)
    rate, _ = one_of(e.table, cell, 4, x)
    crossing, _ = one_of(e.table, cell, 5, x)
    if z < LOWEST:  # straight to 0
        share = max(0.0, z / LOWEST)
        slope = 1.0 / LOWEST if z > 0.0 else 0.0
        return Local(share * tied, share * free, share * across, share * up, slope * tied, slope * free, slope * across, slope * up, rate, crossing)
    if z > high:
        scale = 0.0
    return Local(tied, free, across, up, scale * tied_slope, scale * free_slope, scale * across_slope, scale * up_slope, rate, crossing)


class Motion(NamedTuple):
    """The fluctuation, its rate along a grain's path, (1 + C_m) Du_f/Dt (each x, y, z), and the rates of τ, q and q's rate."""

    velocity: Triple
    rate: Triple
    acceleration: Triple
    clock: float
    drift: float
    bend: float


@shared
def fluctuation(e: Any, z: float, clock: float, drift: float, own: Any) -> Triple:
    """u', v', w' in V."""
    if e is None:  # for the compiler: branches by the type of an argument are left out
        return 0.0, 0.0, 0.0
    here = local(e, z)
    u, v, w, _, _, _ = eddy_at(e, clock, own)
    w += drift
    return here.free * u - here.tied * w, here.across * v, here.up * w


@shared
def motion(e: Any, z: float, clock: float, drift: float, bend: float, slip: Triple, shear: float, own: Any) -> Motion:
    """What the eddies do around a grain with a slip; `shear`: of the mean stream."""
    if e is None:
        return Motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    here = local(e, z)
    u, v, w, du, dv, dw = eddy_at(e, clock, own)
    w, dw = w + drift, dw + bend
    sx, sy, sz = slip
    velocity = here.free * u - here.tied * w, here.across * v, here.up * w
    tracer = math.sqrt(here.rate)  # 1/T_L
    seen = math.sqrt(here.rate + here.crossing * (4.0 * (sx * sx + sy * sy) + sz * sz))
    push = here.up_slope / (1.0 + e.lag * tracer)
    gx, gy, gz = here.free_slope * u - here.tied_slope * w, here.across_slope * v, here.up_slope * w
    rise, turn = sz + velocity[2], seen * dw + push
    rate = gx * rise + here.free * seen * du - here.tied * turn, gy * rise + here.across * seen * dv, gz * rise + here.up * turn
    rise, turn = velocity[2], tracer * dw + here.up_slope
    ax, ay, az = (gx + shear) * rise + here.free * tracer * du - here.tied * turn, gy * rise + here.across * tracer * dv, gz * rise + here.up * turn
    acceleration = e.inertia * ax, e.inertia * ay, e.inertia * az
    return Motion(velocity, rate, acceleration, seen, seen * bend + push, -2.0 * DAMPING * seen * (drift + bend))


@compiled(allocates=False)
def tracers(e: Any, states: Floats, until: float, step: float, rows: Floats) -> None:
    """Fluid particles from 0 to `until` (d/V) by steps of `step` time scales (classical Runge–Kutta): heights, clocks, drifts and their rates (tracer, 4).

    rows (6, at least OWN + SLOTS·SLOT) is overwritten.
    """
    for i in range(len(states)):
        y, own = states[i], rows[5]
        own[:] = 0.0
        own[OWN - 1] = i
        time = 0.0
        while time < until:
            h = min(until - time, step / math.sqrt(local(e, y[0]).rate))
            for a in range(4):
                rows[4, a] = y[a]
            for k in range(4):
                m = motion(e, rows[4, 0], rows[4, 1], rows[4, 2], rows[4, 3], (0.0, 0.0, 0.0), 0.0, own)
                rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3] = m.velocity[2], m.clock, m.drift, m.bend
                for a in range(4):
                    rows[4, a] = y[a] + (h if k == 2 else 0.5 * h) * rows[k, a]
            for a in range(4):
                y[a] += h / 6.0 * (rows[0, a] + 2.0 * rows[1, a] + 2.0 * rows[2, a] + rows[3, a])
            time += h
