"""Sums of decaying exponentials for kernels without a table, fitted on request, and proofs that none exists.

K(s) = ∫ e^(−λs) dμ(λ) with μ ≥ 0 where K is completely monotone, and only there (Bernstein 1929). The sum's rates are taken from a fine grid in
ln λ, its weights by non-negative least squares of relative errors, which keeps few of them; where that is not enough the grid
is refined, and rates are moved, and added where the residual r says so. If r·e^(−λs) ≤ 0 for all λ, nothing can be added, and r itself
proves that no positive sum, however long, comes nearer to K on the samples than it does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from basset.kernels import Floats, Kernel

FLOOR = 1e-16  # of K(near): errors are relative to K down to here
DENSE = 5  # lags at which a promise is checked, for one of the fit
MARGIN = 0.99  # of the promise: what may lie between those lags
ROUNDS = 12
FEW, MOVES = 30, 20  # so many rates are moved so often
DAMPED = (1e-14, 1e-10, 1e-7, 1e-4, 1e-2)  # of the largest singular value
REFINED = (1.0, 0.75, 0.55)  # spacings of the first rounds
BELOW = 14.0  # how far in ln λ the grid reaches beyond 1/far


class NoSumError(ValueError):
    """No sum keeps the promise."""


class Samples:
    """K on a geometric row of lags, as what errors are divided by, and exponentials on them."""

    def __init__(self, kernel: Kernel, near: float, far: float, count: int) -> None:
        self.lags = np.geomspace(near, far, count)
        self.lags[0], self.lags[-1] = near, far
        with np.errstate(under="ignore"):
            self.values = kernel._values(self.lags)
        self.scale = np.maximum(self.values, FLOOR * self.values[0])

    def atoms(self, u: Floats) -> Floats:
        """e^(−λs) over K's scale for λ = e^u: (lag, rate)."""
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(-np.outer(self.lags, np.exp(u))) / self.scale[:, None])

    def slowest(self) -> float:
        """λ_0 of K ~ s^(−p) e^(−λ_0 s) at long lags, about which rates then have to be dense; from three of them."""
        last = int(np.flatnonzero(self.values >= self.scale)[-1])
        three = np.searchsorted(self.lags, self.lags[last] * np.array([0.5, 0.75])).tolist()
        if not three[0] < three[1] < last:
            return 0.0
        s, values = self.lags[[*three, last]], self.values[[*three, last]]
        return float(np.linalg.solve(np.stack([np.ones(3), -np.log(s), -s], axis=1), np.log(values))[2])

    def error(self, weights: Floats, u: Floats) -> float:
        """The largest relative error of a sum."""
        return float(np.abs(self.atoms(u) @ weights - self.values / self.scale).max())


@dataclass
class Found:
    """The best sum of a search, and a lower bound of the error of any positive sum."""

    error: float = math.inf
    weights: Floats = field(default_factory=lambda: np.empty(0))
    u: Floats = field(default_factory=lambda: np.empty(0))  # ln λ
    least: float = 0.0
    asked: float = math.inf  # rtol


@lru_cache(maxsize=64)
def failed(kernel: Kernel, near: float, far: float) -> Found:
    """The last unsuccessful search, cached: solvers ask again and again with larger tolerances."""
    return Found()


@lru_cache(maxsize=64)
def positive_sum(kernel: Kernel, near: float, far: float, rtol: float) -> tuple[Floats, Floats]:
    """Positive weights (s^(-1/2)) and rates (1/s) of a sum of exponentials with |sum − K| ≤ rtol·max(K, 1e-16 K(near)) on [near, far], far/near ≤ 1e12.

    It has 1.2 to 2 times the terms of the shortest. NoSumError if none can keep the promise, because K is not completely monotone, or none was found.
    Bernstein (1929), Acta Math. 52, 1; Lawson & Hanson (1974), Solving Least Squares Problems, ch. 23; Boyd, Schiebinger & Recht (2017), SIAM J.
    Optim. 27, 616 (moving and adding rates).
    """
    if far > 1e12 * near * (1.0 + 1e-9):
        raise NoSumError(f"far/near must be at most 1e12 for {kernel!r}, got {far / near:.3g}")
    before = failed(kernel, near, far)
    if before.least <= rtol and (rtol < before.asked or MARGIN * before.error <= rtol):
        found = search(kernel, near, far, rtol)
        if found.error <= MARGIN * rtol:
            return found.weights, np.exp(found.u)
        before.asked, before.error, before.least = rtol, found.error, max(before.least, found.least)
    if before.least > rtol:
        raise NoSumError(refusal(kernel, near, far, f"no sum of positive exponentials comes nearer to it than {before.least:.2g} of its value"))
    raise NoSumError(f"rtol must be at least {1.05 * before.error:.3g} for near = {near:g} and far = {far:g} seconds with {kernel!r}, got {rtol:g}")


def search(kernel: Kernel, near: float, far: float, rtol: float) -> Found:
    """Look for a sum that keeps the promise, until it is found or proved impossible."""
    best = Found()
    spacing = math.pi**2 / math.log(6.0 / rtol)  # what the trapezoidal rule of s^(−1/2) takes
    count = int(max(200.0, 10.0 / spacing * math.log(far / near)))
    fit, dense = Samples(kernel, near, far, count), Samples(kernel, near, far, DENSE * count)
    check_shape(kernel, dense, rtol)
    slowest, low = fit.slowest(), -math.log(far)
    high = math.log(math.log(3.0 / rtol)) - math.log(near)  # what decays faster counts before near only, where its weight would be any size
    u: Floats = np.empty(0)
    for k in range(ROUNDS):
        if k < len(REFINED) or k % 2 == 0:
            grid = np.arange(low - BELOW, high, REFINED[min(k, len(REFINED) - 1)] * spacing)
            about = np.log(slowest + np.exp(grid)) if slowest * far > 1.0 else np.empty(0)
            u = np.unique(np.concatenate([u, [low - 3.0 * BELOW], grid, about]))  # the first rate is a constant
        u, weights = non_negative(fit, u)
        error = dense.error(weights, u)
        for apart in (spacing, 0.1 * spacing) if error > MARGIN * rtol and len(u) <= FEW else ():
            other_u, other = moved(fit, *merged(u, weights, apart))
            if (other_error := dense.error(other, other_u)) < error:
                error, weights, u = other_error, other, other_u
        if error < best.error:
            best.error, best.weights, best.u = error, weights, u
        if error <= MARGIN * rtol:
            break
        peaks, least = uncovered(fit, u, weights, spacing, high)
        best.least = max(best.least, least)
        if best.least > rtol:
            break
        u = np.union1d(u, peaks) if k + 1 >= len(REFINED) else np.empty(0)
    return best


def refusal(kernel: Kernel, near: float, far: float, reason: str) -> str:
    """Why there is no sum, and what to do."""
    return (
        f"kernel must be completely monotone for a sum of exponentials, but {kernel!r} is not between {near:g} and {far:g} seconds: {reason}; "
        "rules over the whole past, windows without tail and FixedStep with these need no sum"
    )


def check_shape(kernel: Kernel, samples: Samples, rtol: float) -> None:
    """Refuse what is not finite, negative, or rises by more than a falling sum within the promise can follow."""
    lags, values = samples.lags, samples.values
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise NoSumError(f"kernel must be finite at all lags, got K({lags[bad[0]]:.6g}) = {values[bad[0]]} from {kernel!r}")
    low = np.flatnonzero(values < -FLOOR * np.abs(values).max()) if values[0] > 0.0 else [0]
    if len(low):
        raise NoSumError(refusal(kernel, lags[0], lags[-1], f"K({lags[low[0]]:.6g}) = {values[low[0]]:.3g}"))
    up = np.flatnonzero((1.0 - rtol) * values > (1.0 + rtol) * np.minimum.accumulate(values) + rtol * samples.scale + 1e-13 * values)
    if len(up):
        raise NoSumError(refusal(kernel, lags[0], lags[-1], f"it rises before s = {lags[up[0]]:.6g}"))


def non_negative(samples: Samples, u: Floats) -> tuple[Floats, Floats]:
    """(ln λ, weights): those of the rates e^u that non-negative least squares keeps."""
    from scipy.optimize import nnls  # takes longer to import than all of this package

    atoms = samples.atoms(u)
    norms = np.linalg.norm(atoms, axis=0)
    norms[norms == 0.0] = 1.0
    found, _ = nnls(atoms / norms, samples.values / samples.scale, maxiter=50 * len(u))
    kept = found > 0.0
    return u[kept], found[kept] / norms[kept]


def moved(samples: Samples, u: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Rates and weights after damped steps of Gauss and Newton in their logarithms: K that is a few exponentials is found exactly."""
    target = samples.values / samples.scale
    atoms = samples.atoms(u)
    residual = atoms @ weights - target
    for _ in range(MOVES):
        parts = atoms * weights
        slopes = np.concatenate([parts * (-np.outer(samples.lags, np.exp(u))), parts], axis=1)
        norms = np.linalg.norm(slopes, axis=0)
        norms[norms == 0.0] = 1.0
        left, sizes, right = np.linalg.svd(slopes / norms, full_matrices=False)
        for damping in DAMPED:
            step = right.T @ (sizes / (sizes**2 + (damping * sizes[0]) ** 2) * (left.T @ -residual)) / norms
            step /= max(1.0, float(np.abs(step).max()))
            new_u, new_weights = u + step[: len(u)], weights * np.exp(step[len(u) :])
            new_atoms = samples.atoms(new_u)
            new = new_atoms @ new_weights - target
            if np.linalg.norm(new) < 0.95 * np.linalg.norm(residual):
                break
        else:
            break
        u, weights, atoms, residual = new_u, new_weights, new_atoms, new
    order = np.argsort(u)
    return u[order], weights[order]


def merged(u: Floats, weights: Floats, apart: float) -> tuple[Floats, Floats]:
    """One rate for those nearer to each other than `apart`."""
    groups = np.split(np.arange(len(u)), np.flatnonzero(np.diff(u) > apart) + 1)
    return np.array([u[g] @ weights[g] / weights[g].sum() for g in groups]), np.array([weights[g].sum() for g in groups])


def uncovered(samples: Samples, u: Floats, weights: Floats, spacing: float, high: float) -> tuple[Floats, float]:
    """Where a further rate up to e^high would help, as ln λ, and a lower bound of the error of any positive sum.

    With the residual r = K − sum and p any positive sum, r·(K − p) ≥ r·K − max(r·atom)·Σ weights, atoms of unit norm; and Σ weights is at most √m times
    the norm of p on m lags, that is at most 2m if p errs by less than K itself: all values are in units of K.
    """
    target = samples.values / samples.scale
    residual = target - samples.atoms(u) @ weights

    def gain(at: Floats) -> Floats:
        atoms = samples.atoms(at)
        norms = np.linalg.norm(atoms, axis=0)
        return np.asarray((residual @ atoms) / np.where(norms > 0.0, norms, 1.0))

    lags = samples.lags
    places = np.arange(-math.log(lags[-1]) - 3.0 * BELOW, high + 6.0, spacing / 8.0)
    places = np.unique(np.concatenate([places, u]))
    places = np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])]))
    gains = gain(places)
    i = np.flatnonzero((gains[1:-1] >= gains[:-2]) & (gains[1:-1] >= gains[2:]) & (gains[1:-1] > 0.0)) + 1
    peaks, left, right = places[i], places[i - 1], places[i + 1]
    most = max(float(gains.max()), 0.0)
    row = np.arange(len(i))
    for _ in range(3 if len(i) else 0):
        fine = left[:, None] + (right - left)[:, None] * np.linspace(0.0, 1.0, 13)
        found = gain(fine.ravel()).reshape(fine.shape)
        j = np.clip(found.argmax(axis=1), 1, 11)
        most = max(most, float(found.max()))
        peaks, left, right = fine[row, j], fine[row, j - 1], fine[row, j + 1]
    count, norm = len(lags), float(np.linalg.norm(residual))
    least = (float(residual @ target) - 2.0 * most * count) / (norm * math.sqrt(count))
    return peaks[peaks < high], least
