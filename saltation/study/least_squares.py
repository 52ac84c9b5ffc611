"""Least squares: the values of some fields at which what a model is off a record is least, and how well they are known.

As a function of a restitution the sum of squares has several minima, and kinks where contacts pass samples: it is scanned over the whole range first, the best
minima are refined (Levenberg and Marquardt's method, derivatives by differences that are wide against the kinks). The interval is where the sum of squares,
least over the other fields, has risen by no more than Student's t allows: Bates & Watts (1988), Nonlinear Regression Analysis, section 6.1. It holds if the
residuals are noise. Where neighbouring ones hang together, the interval from resampled blocks of them is the wider one: Künsch (1989), Ann. Stat. 17, 1217.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from basset.kernels import Floats
from saltation.scene import SceneError

__all__ = ["Fitted", "LeastSquares", "Residuals"]

ALONE, TOGETHER = 41, 64  # flights of the scan, for one field and for two; for each further one twice as many
SHIFTS = 41  # of the clock, of each flight of the scan
REFINED = 2  # minima of the scan
ITERATIONS = 25
CLOSE, NEAR = 1e-4, 0.03  # of a standard error: where the refinement stops, and where it does for a profile
STEPS = (1e-4, 2e-3)  # of a range: differences, at least and at most; flights are good to 1e-5
CONFIDENCE = 0.95
SAMPLES = 2000  # of the bootstrap
TRIES = 3  # until a contact passes no further sample


class FlatError(ValueError):
    """A field that changes nothing in the record, at the values where it is looked for."""


class Fitted(NamedTuple):
    """Where the fit ended: standard errors, intervals (field, 2) of the profile and from blocks, which samples count."""

    errors: Floats
    profile: Floats
    blocks: Floats
    counts: dict[str, Any]


class Residuals(Protocol):
    """What is fitted: residuals as a function of the values of some fields."""

    names: tuple[str, ...]  # of the fields
    low: Floats  # (fields,): the range that is searched
    high: Floats
    flown: list[int]  # the fields whose values need a flight of their own
    late: int | None  # the one that is the clock, if it is fitted
    given: bool  # whether the noise, over which residuals are, is known
    floating: list[str]  # quantities that are compared but for a constant
    values: dict[str, Floats]  # quantity -> samples
    title: str  # of the record

    def counting(self, theta: Floats) -> dict[str, Any]:
        """Quantity -> which samples count; SceneError where there is no such flight."""
        ...

    def residuals(self, theta: Floats, counts: Mapping[str, Any]) -> Floats:
        """What the model is off, over the noise, where it counts, one quantity after the other; SceneError where there is no such flight."""
        ...


class LeastSquares:
    """The fit of a problem: `fit()`. Within, a field is its share of its range, 0 to 1."""

    def __init__(self, problem: Residuals) -> None:
        self.problem = problem

    def fit(self) -> tuple[Floats, Fitted]:
        """Values of the fields, and how well they are known."""
        found, flat_one = [], None
        for u in self.scan():
            try:
                found.append(self.refined(u))
            except FlatError as error:
                flat_one = error
        if not found:
            raise flat_one or AssertionError
        u, _, counts = min(found, key=lambda each: each[1])
        for _ in range(TRIES):  # until a contact passes no further sample
            again = self.problem.counting(self.at(u))
            if all((again[name] == counts[name]).all() for name in counts):
                break
            counts = again
            u = self.solve(u, counts, range(len(u)))[0]
        u, slopes, off = self.solve(u, counts, range(len(u)))
        return self.at(u), self.intervals(u, counts, slopes, off)

    def at(self, u: Floats) -> Floats:
        """Values of the fields from their shares of the ranges."""
        return np.asarray(self.problem.low + u * (self.problem.high - self.problem.low))

    def squares(self, u: Floats, counts: Mapping[str, Any] | None = None) -> float:
        """The sum of squares, per sample that counts; infinite where there is no such flight."""
        theta = self.at(u)
        try:
            counts = self.problem.counting(theta) if counts is None else counts
            off = self.problem.residuals(theta, counts)
        except SceneError:
            return math.inf
        return float(off @ off) / len(off) if len(off) else math.inf

    def grid(self) -> Floats:
        """Shares (flights, fields) of what is flown at which the scan looks."""
        from scipy.stats import qmc

        count = len(self.problem.flown)
        if count < 2:
            return np.linspace(0.0, 1.0, ALONE)[:, None] if count else np.zeros((1, 0))
        return np.asarray(qmc.Halton(count, scramble=False).random(TOGETHER * 2 ** (count - 2) + 1)[1:])  # but the corner

    def scan(self) -> list[Floats]:
        """The best minima on a grid over the ranges of what is flown, of the clock too."""
        count, size, grid = len(self.problem.flown), len(self.problem.names), self.grid()
        shifts = np.linspace(0.0, 1.0, SHIFTS) if self.problem.late is not None else np.array([0.5])
        found, at = np.full((len(grid), len(shifts)), math.inf), np.full((len(grid), len(shifts), size), 0.5)
        for (i, values), (j, shift) in itertools.product(enumerate(grid), enumerate(shifts)):
            at[i, j, self.problem.flown] = values
            if self.problem.late is not None:
                at[i, j, self.problem.late] = shift
            found[i, j] = self.squares(at[i, j])
        if not np.isfinite(found).any():
            self.problem.counting(self.at(at[0, 0]))  # says why
            raise ValueError("no sample of the record counts: all velocities lie beside contacts")
        best = found.min(axis=1)
        if count == 1:
            inner = np.concatenate(([math.inf], best, [math.inf]))
            minima = np.flatnonzero((inner[1:-1] <= inner[:-2]) & (inner[1:-1] <= inner[2:]) & np.isfinite(best))
        else:
            minima = np.arange(len(best))
        order = minima[np.argsort(best[minima], kind="stable")][:REFINED]
        return [at[i, int(found[i].argmin())] for i in order]

    def refined(self, u: Floats) -> tuple[Floats, float, dict[str, Any]]:
        """From a point of the scan to the minimum by it: (shares, mean square, what counts)."""
        counts = self.problem.counting(self.at(u))
        u = self.solve(u, counts, range(len(u)))[0]
        counts = self.problem.counting(self.at(u))
        u = self.solve(u, counts, range(len(u)))[0]
        return u, self.squares(u, counts), counts

    def slopes(self, u: Floats, counts: Mapping[str, Any], free: Sequence[int], steps: Floats) -> Floats:
        """Derivatives (samples, free) of the residuals by the shares, by central differences within the ranges."""
        columns = []
        for k in free:
            ends = []
            for side in (-1.0, 1.0):
                other = u.copy()
                other[k] = min(1.0, max(0.0, u[k] + side * steps[k]))
                ends.append((other[k], self.problem.residuals(self.at(other), counts)))
            columns.append((ends[1][1] - ends[0][1]) / (ends[1][0] - ends[0][0]))
        return np.column_stack(columns)

    def solve(self, u: Floats, counts: Mapping[str, Any], free: Sequence[int], close: float = CLOSE) -> tuple[Floats, Floats, Floats]:
        """The minimum over the free shares, the others held, to so many standard errors: (shares, slopes up to the last step, residuals) there."""
        u, steps, damping = u.copy(), np.full(len(u), STEPS[1]), 1e-4
        off = self.problem.residuals(self.at(u), counts)
        for turn in range(ITERATIONS):
            slopes = self.slopes(u, counts, free, steps)
            normal, downhill = slopes.T @ slopes, -slopes.T @ off
            size = np.sqrt(np.diag(normal))
            if not size.all():
                name = self.problem.names[next(k for k, one in zip(free, size, strict=True) if one == 0.0)]
                raise FlatError(f"{name} cannot be fitted: the record holds nothing that it changes")
            scale = math.sqrt(max(float(off @ off), 1e-30) / max(1, len(off) - len(free)))
            scale = max(1.0, scale) if self.problem.given else scale
            steps[list(free)] = np.clip(0.5 * scale / size, *STEPS)
            moved = np.zeros(len(free))
            while damping < 1e12:
                step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), downhill, rcond=None)[0]
                other = u.copy()
                other[list(free)] = np.clip(u[list(free)] + step, 0.0, 1.0)
                try:
                    after = self.problem.residuals(self.at(other), counts)
                except SceneError:
                    damping *= 10.0
                    continue
                if after @ after < off @ off:
                    moved = np.abs(other - u)[list(free)] * size / scale
                    u, off, damping = other, after, max(0.1 * damping, 1e-8)
                    break
                if (np.abs(other - u)[list(free)] * size < close * scale).all():
                    break
                damping *= 10.0
            if turn and (moved < close).all():  # the first differences are wide
                break
            damping = min(damping, 1e3)
        return u, slopes, off

    def intervals(self, u: Floats, counts: dict[str, Any], slopes: Floats, off: Floats) -> Fitted:
        """How well the fields are known at the minimum."""
        from scipy.stats import t as student

        sizes, unit = len(off) - len(u) - sum(name in self.problem.floating for name in self.problem.values), self.problem.high - self.problem.low
        if sizes < 1:
            raise ValueError(f"{self.problem.title} has {len(off)} samples that count, too few to fit {len(u)} fields")
        square = float(off @ off) / sizes
        square = max(1.0, square) if self.problem.given else square
        cover = np.linalg.pinv(slopes.T @ slopes)
        errors = np.sqrt(square * np.diag(cover))
        if len(u) > 1 and not (errors < 1.0).all():
            raise ValueError(f"{' and '.join(self.problem.names)} cannot be fitted together in these ranges: what the one changes another undoes")
        factor = float(student.ppf(0.5 + 0.5 * CONFIDENCE, sizes))
        profile = np.array([[self.end(u, k, side, cover, factor, square, counts, off) for side in (-1.0, 1.0)] for k in range(len(u))])
        blocks = u + self.resampled(slopes, off, counts)
        return Fitted(errors * unit, self.problem.low[:, None] + profile * unit[:, None], self.problem.low[:, None] + blocks.T * unit[:, None], counts)

    def end(self, u: Floats, k: int, side: float, cover: Floats, factor: float, square: float, counts: Mapping[str, Any], off: Floats) -> float:
        """An end of the interval of one share: where the least sum of squares with it held has risen by what the confidence allows, or the range ends."""
        least, others = float(off @ off), [i for i in range(len(u)) if i != k]
        inside, outside, reach = 0.0, math.inf, factor * math.sqrt(square * cover[k, k])
        edge = u[k] if side < 0.0 else 1.0 - u[k]
        for _ in range(8):
            reach = min(reach, edge)
            at = np.clip(u + side * reach * cover[k] / cover[k, k], 0.0, 1.0)  # where the others follow
            try:
                rest = self.solve(at, counts, others, NEAR)[2] if others else self.problem.residuals(self.at(at), counts)
                risen = math.sqrt(max(0.0, float(rest @ rest) - least) / square) / factor
            except SceneError:
                risen = math.inf
            if risen < 1.0:
                inside = reach
                if reach >= edge:
                    break
            else:
                outside = reach
            if abs(risen - 1.0) < 0.02:
                break
            guess = reach / risen if risen > 0.0 else math.inf
            if not inside < guess < outside:
                guess = 0.5 * (inside + outside) if outside < math.inf else 2.0 * reach
            reach = guess
        return float(u[k] + side * min(reach, edge))

    def resampled(self, slopes: Floats, off: Floats, counts: Mapping[str, Any]) -> Floats:
        """The 95 % interval (2, fields) of the shift of the shares when blocks of neighbouring samples are drawn anew, by the model's slopes."""
        rng, parts, first = np.random.default_rng(1), [], 0
        for name in self.problem.values:
            size = int(counts[name].sum())
            if size == 0:
                continue
            length = min(max(1, round(2.0 * tied(off[first : first + size]))), max(1, size // 4))
            starts = rng.integers(0, size, (SAMPLES, math.ceil(size / length)))
            parts.append(first + ((starts[:, :, None] + np.arange(length)) % size).reshape(SAMPLES, -1)[:, :size])
            first += size
        drawn = np.concatenate(parts, axis=1)
        normal = np.einsum("nsk,nsm->nkm", slopes[drawn], slopes[drawn])
        normal += 1e-12 * np.trace(slopes.T @ slopes) * np.eye(slopes.shape[1])
        shifts = np.linalg.solve(normal, -np.einsum("nsk,ns->nk", slopes[drawn], off[drawn])[..., None])[..., 0]
        return np.asarray(np.quantile(shifts, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE], axis=0))


def tied(off: Floats) -> float:
    """Over how many samples residuals hang together: the sum of their correlations up to the first that is not positive."""
    centred = off - off.mean()
    power = float(centred @ centred)
    total = 1.0
    for lag in range(1, len(off)):
        correlation = float(centred[lag:] @ centred[:-lag]) / power if power > 0.0 else 0.0
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return total
