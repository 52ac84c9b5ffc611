"""Finite-Reynolds kernels as spectra of decaying exponentials: fixed rates, weights that follow the slip.

k(x) = x^(-1/2) (1 + x^(3/(2 c1)))^(-c1) is completely monotone for c1 ≥ 3/2, since x^(3/(2 c1)) then is a Bernstein
function: k(x) = ∫_0^∞ μ(λ) e^(−λx) dλ with μ ≥ 0. The Basset kernel has μ_B = 1/√(πλ); their ratio is ρ = μ/μ_B. As
K(s; C) = C^(1/3) k(C^(2/3) s) has the density ρ(λ C^(-2/3))/√(πλ), a sum Σ a exp(−λs) for the Basset kernel becomes one for
K(s; C) when each weight is multiplied by ρ(λ C^(-2/3)). The rates are the same for every C, so a memory of exponentials
stays valid while the slip, and with it C, varies; C = 0 is the Basset kernel.

ρ rises from 0 as √π λ^(3/2), exceeds 1 a little (1.111 at λ = 7.2 for c1 = 2, 1.020 at λ = 52 for c1 = 2.5) and tends to 1
as λ^(-3/(2 c1)).

The slowest terms of a fitted sum stand for all slower rates at once, for which ρ at their own rate is no fair sample: up to
28 % of the Basset kernel at the last lag. Where a horizon is given, these terms get the weights that match the kernel up to
the horizon instead. The sum should then reach ten times as far as the horizon: one to six more terms, and an error below 3 rtol.

References: Mei & Adrian (1992), J. Fluid Mech. 237, 323 (the kernel); Schilling, Song & Vondraček (2012), Bernstein
Functions, de Gruyter, theorems 1.4 (Bernstein) and 3.7 (composition); Trefethen, Weideman & Schmelzer (2006), BIT 46, 653
(the contour).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset._compile import shared
from basset.exponentials import ExponentialSum
from basset.kernels import BassetKernel, Floats, VaryingSlipKernel

__all__ = ["slip_weights", "spectral_ratio"]

_DEGREE = 7  # eight coefficients: one cache line
_POINTS = 18  # of half the contour, whose error is 2.85^(-2·_POINTS) = 4e-17; more only add rounding
_SLOWEST = 1e-150  # below, ρ is its power law before the parts of the sum overflow
_FARTHEST = 1e100  # of C^(2/3)·horizon, beyond which K(s; C) has vanished beside the Basset kernel


class SpectralTable(NamedTuple):
    """Ratios as polynomials on a uniform grid in ln λ, for `ratio_at`."""

    low: float  # ln λ at the lower end of the grid
    inverse_step: float  # cells per unit of ln λ
    values: Floats  # (rows, cells, 8), read-only: coefficients of each cell, lowest first, in u from −1 to 1


class Following(NamedTuple):
    """A finite-Reynolds kernel K(s; C) of the slip at t: fixed rates, weights that follow C(t), see `basset.spectrum`; no values: it is constant.

    C = ½√π (U/f)³ scale^(3/2), f = 0.75 + c2 U reynolds, U being the slip between `least` and `most`. `local` is what the local history of a unit
    step falls short of Basset's, on a uniform grid of ln(C^(2/3) h) from `local_low`: (places, grid, stage, node), places: nodes of a regular
    and of a singular step, halfway between those of a singular one.
    """

    c1: float
    c2: float
    reynolds: float
    scale: float
    least: float
    most: float
    log_rates: Floats
    low: float
    inverse_step: float
    values: Floats
    local: Floats
    local_low: float
    local_inverse: float


STAYS = Following(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(0), 0.0, 0.0, np.zeros((0, 0, 8)), np.zeros((3, 0, 0, 0)), 0.0, 0.0)  # follows no slip


class SlipTable(NamedTuple):
    """All that compiled code needs for the weights of a sum at any C > 0; infinity stands for −ln C at C = 0.

    The weight of term q is weights[q]·ratio_at(low, inverse_step, values, min(q, rows − 1), log_rates[q] − (2/3) ln C).
    """

    weights: Floats  # of the Basset sum (terms,), s^(-1/2), read-only
    log_rates: Floats  # (terms,), read-only: −ln horizon for the slow terms, which share their C; ln λ (1/s) for the others
    low: float  # as in `SpectralTable`
    inverse_step: float
    values: Floats  # a row for each slow term, the slowest first, then that of ρ for all others


def _checked_c1(c1: Any) -> float:
    result = _validate.positive("c1", c1)
    if not 1.5 <= result <= 10.0:
        raise ValueError(f"c1 must be from 1.5 (below, complete monotonicity is not known) to 10 (the tables' reach), got {result:g}")
    return result


@lru_cache(maxsize=1)
def _contour() -> tuple[Any, Any]:
    """Points z and weights w on the upper half of a parabola around the negative axis: μ(λ) √(πλ) ≈ Im Σ w (1 + (z/λ)^a)^(-c1)."""
    count = 2 * _POINTS
    angle = (np.arange(_POINTS) + 0.5) * 2.0 * math.pi / count
    z = count * (0.1309 - 0.1194 * angle**2 + 0.25j * angle)
    slope = -0.2388 * angle + 0.25j
    return z, 2.0 * math.sqrt(math.pi) * np.exp(z) * slope / np.sqrt(z)


def spectral_ratio(rate: ArrayLike, c1: float = 2.0) -> Floats:
    """ρ(λ) = μ(λ)/μ_B(λ), elementwise, λ ≥ 0 (infinity included) in units of C^(2/3): the inverse Laplace transform of k.

    On a contour that stays in proportion to λ: no cancellation at either end, so the error is relative throughout, below 1e-13 for c1 from 1.5
    to 10 (3e-14 for 2, Mei & Adrian, and 2.5, Dorgan & Loth).

    >>> spectral_ratio([0.0, 1e-4, 1.0, np.inf]).round(8)
    array([0.0000000e+00, 1.7700000e-06, 5.8032344e-01, 1.0000000e+00])
    """
    c1 = _checked_c1(c1)
    try:
        rates = np.asarray(rate, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"rate must be an array of real numbers, got {_validate.shown(rate)}") from None
    if not np.all(rates >= 0.0):
        raise ValueError(f"rate must be 0 or greater, got {rates[~(rates >= 0.0)].flat[0]:g}")
    z, weights = _contour()
    bend = 1.5 / c1
    inside = np.maximum(rates, _SLOWEST)
    ratios = (((1.0 + z**bend * inside[..., None] ** -bend) ** -c1) @ weights).imag
    return np.asarray(ratios * (np.minimum(rates, _SLOWEST) / _SLOWEST) ** 1.5)


def _matched(basset_sum: ExponentialSum, stretch: Floats, c1: float, horizon: float, slow: int) -> Floats:
    """What the slowest weights are multiplied by to match K(s; C) up to the horizon, (…, slow), for each C^(2/3) in `stretch` (…)."""
    stretch = np.minimum(stretch, _FARTHEST / horizon)
    lags = np.geomspace(max(basset_sum.near, 0.01 * horizon), horizon, 40)
    felt = slice(int(np.count_nonzero(basset_sum.rates * lags[0] < 40.0)))
    rates = basset_sum.rates[felt]
    terms = np.exp(-np.outer(lags, rates)) * basset_sum.weights[felt] * np.sqrt(lags)[:, None]
    ratios = spectral_ratio(rates / stretch[..., None], c1)
    # least squares for Σ ratio·term = K(s; C)/K(s; 0)·Σ term, relative to K(s; C): as C → 0 ratios of 1, whatever the sum's error
    share = (1.0 + (stretch[..., None] * lags) ** (1.5 / c1)) ** -c1
    missing = terms.sum(axis=1) - (ratios @ terms.T) / share
    orthogonal, triangle = np.linalg.qr(terms[:, :slow] / share[..., None])
    step = np.linalg.solve(triangle, np.swapaxes(orthogonal, -1, -2) @ missing[..., None])
    return np.asarray(ratios[..., :slow] + step[..., 0])


def _slow(basset_sum: ExponentialSum, horizon: float) -> int:
    """How many terms have matched weights: those that have not faded at the horizon."""
    return int(np.count_nonzero(basset_sum.rates * horizon < 5.0))


def _checked(basset_sum: Any, horizon: Any) -> float | None:
    if not isinstance(basset_sum, ExponentialSum) or not isinstance(basset_sum.kernel, BassetKernel):
        raise TypeError(f"basset_sum must be an ExponentialSum for the Basset kernel, got {_validate.shown(basset_sum)}")
    if horizon is None:
        return None
    result = _validate.positive("horizon", horizon, "seconds")
    if not basset_sum.near < result <= basset_sum.far:
        raise ValueError(f"horizon must lie within the sum's range, {basset_sum.near:g} to {basset_sum.far:g} seconds, got {result:g}")
    return result


def slip_weights(basset_sum: ExponentialSum, steepness: float, c1: float = 2.0, horizon: float | None = None) -> Floats:
    """Weights (terms,), s^(-1/2), with which the rates of a Basset sum stand for K(s; C), at one C = `steepness`, s^(-3/2); C = 0: its own weights.

    `horizon` is the longest lag that matters, at most the sum's far, which is best ten times it: ExponentialSum.fit(near, 10·horizon, rtol).
    The terms with rate·horizon < 5 get the weights that match K(s; C) up to there; some may be slightly negative (above −0.04/√horizon for
    far = 10 horizon). None: every weight is a_q ρ(λ_q C^(-2/3)).

    Errors of a sum with rtol ε, largest over all C ≥ 0 and lags from near to the horizon, for c1 = 2 and 2.5 and horizon/near
    from 1e2 to 3e10. Of the Basset kernel at the same lag:

    * horizon = far/10: 2.7 ε (ε from 1e-3 to 1e-12).
    * horizon = far/3: 5 ε down to ε = 1e-4, 1.4e-4 for ε = 1e-6; horizon = far: 1.1e-2.
    * no horizon: 0.28 at far, where C^(2/3) far is about 0.05, and falling as √s towards short lags; 2 ε from C^(2/3) far = 1000 on.
      With far ten times the longest lag 0.09.

    Of K(s; C) itself, for horizon = far/10: 25 ε (ε = 1e-3), 100 ε (1e-6), 250 ε (1e-12), for a sum of exponentials follows its
    s^(-2) tail less closely than s^(-1/2). Within 30 near of lags where K(s; C) is below a thousandth of the Basset kernel, which
    a sum for that one need not resolve, up to six times as much.
    """
    c1, horizon = _checked_c1(c1), _checked(basset_sum, horizon)
    steepness = _validate.non_negative("steepness", steepness, "s^(-3/2)")
    if steepness == 0.0:
        return basset_sum.weights.copy()
    return weights_at(basset_sum, np.array(steepness ** (2.0 / 3.0)), c1, horizon)


def weights_at(basset_sum: ExponentialSum, stretch: Floats, c1: float, horizon: float | None) -> Floats:
    """`slip_weights` (…, terms) for each C^(2/3) > 0 in `stretch` (…)."""
    ratios = spectral_ratio(basset_sum.rates / stretch[..., None], c1)
    if horizon is not None:
        slow = _slow(basset_sum, horizon)
        ratios[..., :slow] = _matched(basset_sum, stretch, c1, horizon, slow)
    return np.asarray(basset_sum.weights * ratios)


def following_sum(near: float, horizon: float, rtol: float, kernel: VaryingSlipKernel) -> ExponentialSum:
    """A short Basset sum whose weights, following the slip, keep `rtol` of the kernel from `near` to `horizon`; that is its rtol."""
    low, high = 2.0 / 3.0 * np.log(kernel.steepness(np.array(kernel.slip_range)))
    lags, stretches = np.geomspace(near, horizon, 300), np.exp(np.linspace(low, high, 30))
    exact = (1.0 + (stretches[:, None] * lags) ** (1.5 / kernel.c1)) ** -kernel.c1 / np.sqrt(lags)
    error = math.inf
    for share in 10.0 ** np.arange(-0.5, -5.0, -0.5):  # of rtol that it keeps for the Basset kernel
        try:
            found = ExponentialSum.fit(near, 10.0 * horizon, rtol * share)
        except ValueError:
            if error == math.inf:
                raise
            break
        error = np.abs(weights_at(found, stretches, kernel.c1, horizon) @ np.exp(-np.outer(found.rates, lags)) / exact - 1.0).max()
        if error <= 0.9 * rtol:
            return replace(found, rtol=rtol)
    raise ValueError(f"rtol must be at least {1.2 * error:.1g} for that step, horizon and slip_range, got {rtol:g}")


def grid_of(c1: float, fine: bool) -> tuple[float, float]:
    """Step of tables in ln λ, and |ln λ| beyond which ρ is a power law or 1 (−ln C^(2/3)s: K(s; C) is Basset's), for errors of 2e-10 or of 1e-12."""
    step, precision = (0.25, 1e13) if fine else (0.5, 1e10)
    return step, math.log(precision * c1) / (1.5 / c1)


def pieces(low: float, cells: int, step: float) -> tuple[Floats, Floats]:
    """Points (cells, 8) of a grid from `low` on, and the matrix from values there to the coefficients that `ratio_at` takes."""
    u = np.cos(math.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    return low + step * (np.arange(cells)[:, None] + 0.5 * (1.0 + u)), np.linalg.inv(np.vander(u, increasing=True)).T


def pieces_between(low: float, high: float, step: float, reach: float) -> tuple[float, Floats, Floats]:
    """`pieces` over −ln C^(2/3), for ln C^(2/3) from `low` to `high`, behind where they begin; beyond `reach` K(s; C) is Basset's."""
    begin = -high - 0.005 * step
    return begin, *pieces(begin, max(1, math.ceil((high - max(low, -reach)) / step + 0.01)), step)


@lru_cache(maxsize=8)
def spectral_table(c1: float = 2.0, fine: bool = False) -> SpectralTable:
    """The table of ρ, one row, for `ratio_at`. Errors as `spectral_ratio`; made once per c1, in some three milliseconds."""
    c1 = _checked_c1(c1)
    step, reach = grid_of(c1, fine)
    half = math.ceil(reach / step)
    points, coefficients = pieces(-half * step, 2 * half, step)
    values = np.ascontiguousarray((spectral_ratio(np.exp(points), c1) @ coefficients)[None])
    values.flags.writeable = False
    return SpectralTable(-half * step, 1.0 / step, values)


@lru_cache(maxsize=32)
def slip_table(basset_sum: ExponentialSum, c1: float = 2.0, horizon: float | None = None, fine: bool = False) -> SlipTable:
    """The weights of `slip_weights` as a table. Parameters and errors as there; made once per sum, in some twenty milliseconds."""
    c1, horizon = _checked_c1(c1), _checked(basset_sum, horizon)
    low, inverse_step, values = spectral_table(c1, fine)
    log_rates = np.log(basset_sum.rates)
    if horizon is not None:
        points, coefficients = pieces(low, values.shape[1], 1.0 / inverse_step)
        slow = _slow(basset_sum, horizon)
        # at the same C for all: near-dependent terms scatter together, and only together is that harmless
        matched = _matched(basset_sum, np.exp(-points) / horizon, c1, horizon, slow)
        values = np.concatenate([np.moveaxis(matched, -1, 0) @ coefficients, values])
        log_rates[:slow] = -math.log(horizon)
    values.flags.writeable = log_rates.flags.writeable = False
    return SlipTable(basset_sum.weights, log_rates, low, inverse_step, values)


@shared
def ratio_at(low: float, inverse_step: float, values: Floats, row: int, log_rate: float) -> float:
    """A tabulated ratio at ln(λ C^(-2/3)), for compiled code, in some 4 ns: relative error below 2e-10 (6e-9 for c1 = 1.5), of a fine table 1e-12.

    1 above the grid (so also for C = 0, where the argument is infinite), the power 3/2 of the rate below it; NaN for NaN.
    """
    position = (log_rate - low) * inverse_step
    if position >= values.shape[1]:
        return 1.0
    power = 1.0
    if not position >= 0.0:  # NaN comes here too, and stays NaN without reaching an index
        power, position = math.exp(1.5 * (log_rate - low)), 0.0
    cell = int(position)
    u = 2.0 * (position - cell) - 1.0
    square = u * u
    even = values[row, cell, 0] + square * (values[row, cell, 2] + square * (values[row, cell, 4] + square * values[row, cell, 6]))
    odd = values[row, cell, 1] + square * (values[row, cell, 3] + square * (values[row, cell, 5] + square * values[row, cell, 7]))
    result: float = power * (even + u * odd)
    return result


@shared
def log_stretch_of(following: Following, where: Any, states: Floats, i: int) -> float:
    """Ln C^(2/3) at row i of `states`: K(s; C) is a function of C^(2/3) s; −∞ for C = 0."""
    speed = 0.0
    for a in range(len(where)):
        speed += states[i, where[a]] ** 2
    speed = min(max(math.sqrt(speed), following.least), following.most)
    if speed == 0.0:
        return -math.inf
    log_stretch = 2.0 / 3.0 * math.log(0.5 * math.sqrt(math.pi)) + math.log(following.scale)
    return log_stretch + 2.0 * math.log(speed / (0.75 + following.c2 * speed * following.reynolds))


@shared
def weight_ratio(following: Following, q: int, log_stretch: float) -> float:
    """The factor on the weight of term q at ln C^(2/3) = `log_stretch`."""
    rows = following.values.shape[0]
    found: float = ratio_at(following.low, following.inverse_step, following.values, min(q, rows - 1), following.log_rates[q] - log_stretch)
    return found
