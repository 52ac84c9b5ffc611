"""Tables of minimax exponential sums for the history kernels.

A sum ``sum_i a_i exp(-lambda_i t)`` with ``n`` positive weights and rates is fitted to a completely monotone kernel ``K(t)`` on
``[near, far]`` so that the largest *relative* error is as small as it can be.  Three kernels are tabulated:

``basset``        ``K(t) = t**(-1/2)``; homogeneous, hence only ``far / near`` matters and ``far = 1`` throughout
``mei_adrian``    ``K(x) = x**(-1/2) * (1 + x**(3 / (2 c)))**(-c)`` with ``c = 2``
``dorgan_loth``   the same with ``c = 2.5``

For every number of terms and every relative tolerance (and, for the last two, every ``far``) the table holds the sum that reaches
the *smallest* ``near``, that is the widest range which ``n`` terms can serve at this tolerance.

Method
------
The relative error of the best sum has ``2 n + 1`` extrema of equal size and alternating sign, the two ends of the range among them
(D. Braess and W. Hackbusch, "Approximation of 1/x by exponential sums in [1, infinity)", IMA J. Numer. Anal. 25 (2005) 685-697;
for the computation W. Hackbusch, "Computation of best L-infinity exponential sums for 1/x by Remez' algorithm", Comput. Vis. Sci.
20 (2019) 1-11).  It is found by the exchange algorithm of Remez with Newton's method inside: the unknowns are the
logarithms of rates and weights together with either ``log(near)`` for a prescribed error, which gives the widest range at once, or
the error for a prescribed range (used where the table is cut at ``far / near = 1e12``).  The extrema are located anew
after each solve.  First guesses are extrapolated from sums with fewer terms (rates counted from the slow end stay where they
are, those counted from the fast end move along with ``near``), from looser tolerances, or, where these fail, by continuation.

Precision: the Newton matrix is about as ill-conditioned as the error is small, so everything is done in extended precision
(``numpy.longdouble`` with a 64-bit mantissa as on x86, where no further library is needed).  What is stored is rounded to double
and then checked in plain double arithmetic on a dense grid: the stored ``error`` is the largest relative error so measured, and
never exceeds the stored ``rtol``.

File layout (``numpy.savez_compressed``, no pickles)
----------------------------------------------------
``terms``, ``rtol``, ``error``         one entry per sum: number of terms, tolerance promised, largest relative error measured
``ratio``                              (``basset``) ``far / near``, with ``far = 1``
``far``, ``near``                      (the other two) range in ``x``
``offset``                             sum ``k`` occupies ``offset[k]:offset[k + 1]`` of the next two
``log_rates``, ``log_weights``         natural logarithms, rates ascending within each sum

Where ``n`` terms reach the widest range tabulated (``far / near = 1e12`` or ``near = 1e-12``) with an error smaller than a tolerance,
one sum for that range stands for all looser tolerances: its ``rtol`` is the tightest of these, its ``error`` may be well below it.  So
pick the fewest terms among the sums with ``error <= wanted`` and range wide enough.

Usage, from the root of the repository::

    python bench/tables/minimax_sums.py --kernel basset --output basset/data/minimax_basset.npz
    python bench/tables/minimax_sums.py --kernel mei_adrian --output basset/data/minimax_mei_adrian.npz
    python bench/tables/minimax_sums.py --kernel dorgan_loth --output basset/data/minimax_dorgan_loth.npz

Finished parts are kept in ``<output>.partial.jsonl`` next to the output, from which an interrupted run resumes; the table itself is
written to a temporary file and then renamed.  Run time on one core: half a minute for ``basset``, two minutes for each of the others.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402  (after the number of threads is set)

Extended = np.longdouble
Array = np.ndarray

LARGEST_RATIO = 1e12
SMALLEST_RATIO = 2.0
SMALLEST_NEAR = 1e-12
SMALLEST_SPAN = 0.1
LEVELLING = 2e-3
"""Extrema of an accepted sum agree within this fraction."""
QUARTER_DECADES = tuple(float(f"{leading}e-{k}") for k in range(1, 15) for leading in ("5.62", "3.16", "1.78", "1"))
"""Tolerances at which sums are computed; a table may hold fewer."""


# ---------------------------------------------------------------------------------------------------------------- kernels


@dataclass(frozen=True)
class Kernel:
    """A kernel given by its logarithm as a function of ``x = log t``, with the grid of its table."""

    name: str
    log_value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    far: tuple[float, ...]
    largest_terms: int
    tolerances: tuple[float, ...]
    """Tolerances of the table, loosest first."""


def basset_kernel() -> Kernel:
    """``t**(-1/2)``."""
    half = Extended(0.5)
    return Kernel("basset", lambda x: -half * x, lambda x: np.full_like(x, -half), (1.0,), 72, QUARTER_DECADES[3:])


def finite_reynolds_kernel(name: str, exponent: float) -> Kernel:
    """``x**(-1/2) * (1 + x**(3 / (2 c)))**(-c)``."""
    c = Extended(exponent)
    power = Extended(3) / (2 * c)

    def log_value(x: Array) -> Array:
        return -x / 2 - c * np.logaddexp(np.zeros_like(x), power * x)

    def slope(x: Array) -> Array:
        return -Extended(0.5) - c * power / (1 + np.exp(-power * x))

    far = tuple(float(f"1e{k}") for k in range(-4, 7))
    return Kernel(name, log_value, slope, far, 48, tuple(float(f"1e-{k}") for k in range(2, 13)))


KERNELS: dict[str, Callable[[], Kernel]] = {
    "basset": basset_kernel,
    "mei_adrian": lambda: finite_reynolds_kernel("mei_adrian", 2.0),
    "dorgan_loth": lambda: finite_reynolds_kernel("dorgan_loth", 2.5),
}


def aim(rtol: float) -> float:
    """Error to solve for, so that the tolerance is still kept after rounding to double precision."""
    return 0.99 * rtol - 2e-15


# ------------------------------------------------------------------------------------------------ sums and their residuals


@dataclass
class Sum:
    """An exponential sum with the extrema of its relative error; all logarithms, in extended precision."""

    rates: Array
    weights: Array
    extrema: Array
    error: float

    @property
    def terms(self) -> int:
        """Number of terms."""
        return self.rates.size

    @property
    def span(self) -> float:
        """``log(far / near)``."""
        return float(self.extrema[-1] - self.extrema[0])


Row = dict[float, Sum]
"""Sums of equal length by their error."""


def contributions(kernel: Kernel, rates: Array, weights: Array, x: Array) -> tuple[Array, Array]:
    """``lambda_i t`` and ``a_i exp(-lambda_i t) / K(t)`` at ``x = log t`` (rows)."""
    decay = np.exp(rates[None, :] + x[:, None])
    return decay, np.exp(weights[None, :] - decay - kernel.log_value(x)[:, None])


def residual(kernel: Kernel, rates: Array, weights: Array, x: Array) -> Array:
    """Relative error of the sum at ``x = log t``."""
    return contributions(kernel, rates, weights, x)[1].sum(axis=1) - 1


def signs(terms: int) -> Array:
    """Signs of the error at its extrema; the sum is too small at (and beyond) either end."""
    sign = np.ones(2 * terms + 1, dtype=Extended)
    sign[::2] = -1
    return sign


def solve(matrix: Array, right: Array) -> Array | None:
    """Gaussian elimination with equilibration and row pivoting in the precision of the arguments."""
    column_scale = np.abs(matrix).max(axis=0)
    if not np.all(np.isfinite(column_scale)) or np.any(column_scale == 0):
        return None
    work = np.concatenate([matrix / column_scale, right[:, None]], axis=1)
    row_scale = np.abs(work[:, :-1]).max(axis=1)
    if np.any(row_scale == 0):
        return None
    work /= row_scale[:, None]
    size = right.size
    for k in range(size):
        pivot = k + int(np.argmax(np.abs(work[k:, k])))
        if work[pivot, k] == 0:
            return None
        if pivot != k:
            work[[k, pivot], k:] = work[[pivot, k], k:]
        factor = work[k + 1 :, k] / work[k, k]
        work[k + 1 :, k + 1 :] -= factor[:, None] * work[k, k + 1 :]
    solution = np.empty(size, dtype=work.dtype)
    for k in range(size - 1, -1, -1):
        solution[k] = (work[k, size] - work[k, k + 1 : size] @ solution[k + 1 :]) / work[k, k]
    return solution / column_scale


# ---------------------------------------------------------------------------------------------------------- Newton and Remez


def noise(error: float) -> float:
    """How well extrema can be levelled at this error in extended precision, as a fraction of it."""
    return LEVELLING + 1e-15 / error


def level(kernel: Kernel, guess: Sum, free_near: bool, iterations: int = 20) -> Sum | None:
    """Newton's method for equal errors at the given extrema, where ``near`` or the error is the last unknown.

    Near the limit of the precision the iterates jitter about the solution in the directions that hardly change the sum; shorter
    steps then still help, and in the end the best iterate is good enough.
    """
    n = guess.terms
    sign = signs(n)
    current, best, least = guess, None, math.inf
    step, damping = np.zeros(2 * n + 1, dtype=Extended), 1.0
    for iteration in range(iterations):
        decay, part = contributions(kernel, current.rates, current.weights, current.extrema)
        deviation = part.sum(axis=1) - 1 - sign * current.error
        distance = float(np.max(np.abs(deviation))) / current.error
        if iteration > 0 and distance < 1e-3:
            return current
        if best is None or distance < least or least > 1.0:
            best, least = current, distance
            last = np.zeros(2 * n + 1, dtype=Extended)
            if free_near:
                last[0] = -(part[0] * (decay[0] + kernel.slope(current.extrema[:1]))).sum()
            else:
                last[:] = -sign
            solution = solve(np.concatenate([-decay * part, part, last[:, None]], axis=1), -deviation)
            if solution is None or not np.all(np.isfinite(solution)):
                return None
            step = solution
            size = float(np.max(np.abs(step[: 2 * n])))
            if iteration > 5 and size > 1.0:
                return None
            damping = min(1.0, 0.7 / max(size, 1e-30))
            if free_near:
                damping = min(damping, 0.5 * float(best.extrema[1] - best.extrema[0]) / max(abs(float(step[-1])), 1e-30))
        elif least < noise(best.error):
            return best
        else:
            damping /= 2
        extrema, error = best.extrema.copy(), best.error
        if free_near:
            extrema[0] += damping * step[-1]
        else:
            error = max(error + damping * float(step[-1]), 0.1 * error)
        current = Sum(best.rates + damping * step[:n], best.weights + damping * step[n : 2 * n], extrema, error)
        if np.any(np.diff(current.rates) <= 0):
            return None
    return best if best is not None and least < noise(best.error) else None


def locate_extrema(kernel: Kernel, rates: Array, weights: Array, near_extrema: Array, density: int = 12) -> tuple[Array, Array] | None:
    """Extrema of the error between its zeros and their values, searched on a grid made from a first guess; None unless there are 2n+1."""
    fraction = np.arange(density, dtype=Extended) / density
    start, width = near_extrema[:-1], np.diff(near_extrema)
    x = np.append((start[:, None] + width[:, None] * fraction).ravel(), near_extrema[-1])
    value = residual(kernel, rates, weights, x)
    first = np.append(0, np.nonzero(np.diff(np.signbit(value)))[0] + 1)
    if first.size != near_extrema.size:
        return None
    place = np.array([a + int(np.argmax(np.abs(value[a:b]))) for a, b in zip(first, np.append(first[1:], x.size), strict=True)])
    if place[0] != 0 or place[-1] != x.size - 1:
        return None
    found = x[place]
    i = place[1:-1]
    left, centre, right = x[i - 1], x[i], x[i + 1]
    slope_left = (value[i] - value[i - 1]) / (centre - left)
    slope_right = (value[i + 1] - value[i]) / (right - centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = (left + centre) / 2 - slope_left * (right - left) / (2 * (slope_right - slope_left))
    found[1:-1] = np.where((vertex > left) & (vertex < right), vertex, centre)
    return found, residual(kernel, rates, weights, found)


def exchange(kernel: Kernel, guess: Sum, free_near: bool, rounds: int = 12) -> Sum | None:
    """Remez exchange from a guess; None if it does not settle."""
    if np.any(np.diff(guess.extrema) <= 0) or np.any(np.diff(guess.rates) <= 0):
        return None
    current = guess
    for _ in range(rounds):
        solved = level(kernel, current, free_near)
        if solved is None:
            return None
        located = locate_extrema(kernel, solved.rates, solved.weights, solved.extrema)
        if located is None:
            return None
        extrema, value = located
        size = np.abs(value)
        current = Sum(solved.rates, solved.weights, extrema, solved.error)
        ripple = noise(solved.error)
        if size.max() < solved.error * (1 + ripple) and size.min() > solved.error * (1 - ripple):
            return current
    return None


# ------------------------------------------------------------------------------------------------------------ first guesses


def polynomial_extrapolation(nodes: list[float], values: list[Array], target: float) -> Array:
    """Lagrange's formula for arrays."""
    total = np.zeros_like(values[0])
    for i, node in enumerate(nodes):
        factor = 1.0
        for j, other in enumerate(nodes):
            if i != j:
                factor *= (target - other) / (node - other)
        total = total + Extended(factor) * values[i]
    return total


def along_parameter(parameters: list[float], sums: list[Sum], target: float, error: float) -> Sum:
    """Extrapolate sums of equal length in a parameter."""
    return Sum(
        polynomial_extrapolation(parameters, [s.rates for s in sums], target),
        polynomial_extrapolation(parameters, [s.weights for s in sums], target),
        polynomial_extrapolation(parameters, [s.extrema for s in sums], target),
        error,
    )


def along_terms(shorter: list[Sum], split: float, error: float) -> Sum | None:
    """Guess ``n`` terms from ``n - 1`` and fewer (``shorter[0]`` the longest): extrapolate counting from either end."""
    n = shorter[0].terms + 1
    degree = len(shorter) - 1
    if shorter[-1].terms < 1:
        return None
    coefficients = [Extended((-1) ** k * math.comb(degree + 1, k + 1)) for k in range(degree + 1)]

    def blend(size: int, from_end: int, pieces: list[Array]) -> Array | None:
        result = np.zeros(size, dtype=Extended)
        smallest = pieces[-1].size
        if from_end > smallest or size - from_end > smallest:
            return None
        for coefficient, piece in zip(coefficients, pieces, strict=True):
            result[: size - from_end] += coefficient * piece[: size - from_end]
            result[size - from_end :] += coefficient * piece[piece.size - from_end :]
        return result

    fast = min(max(round(split * n), 1), n - 1)
    rates = blend(n, fast, [s.rates for s in shorter])
    weights = blend(n, fast, [s.weights for s in shorter])
    extrema = blend(2 * n + 1, 2 * n + 1 - (2 * fast), [s.extrema for s in shorter])
    if rates is None or weights is None or extrema is None:
        return None
    return Sum(rates, weights, extrema, error)


def by_insertion(kernel: Kernel, shorter: Sum, split: float, error: float) -> Sum:
    """Guess ``n`` terms from ``n - 1``: open a gap and move the fast part away."""
    m = shorter.terms
    k = min(max(round((1 - split) * m), 0), m)
    shift = float(np.median(np.diff(shorter.rates))) if m > 1 else shorter.span + 1.0
    rates = np.insert(shorter.rates, k, 0)
    rates[k + 1 :] += shift
    if 0 < k < m:
        rates[k] = (rates[k - 1] + rates[k + 1]) / 2
    else:
        rates[k] = rates[k - 1] + shift if k == m else rates[k + 1] - shift
    weights = np.insert(shorter.weights, k, shorter.weights[min(k, m - 1)])
    old = np.insert(shorter.rates, k, shorter.rates[min(k, m - 1)])
    weights = weights + kernel.log_value(-rates) - kernel.log_value(-old)
    x = shorter.extrema
    cut = 2 * (m - k)
    extrema = np.concatenate([x[: cut + 1] - shift, x[cut : cut + 1] - shift / 2, x[cut:]])
    return Sum(rates, weights, extrema, error)


def misfit(kernel: Kernel, guess: Sum) -> float:
    """How far the guess is from levelled, in units of the error; infinite if it is not a sum."""
    if np.any(np.diff(guess.extrema) <= 0) or np.any(np.diff(guess.rates) <= 0):
        return math.inf
    value = residual(kernel, guess.rates, guess.weights, guess.extrema)
    return float(np.max(np.abs(value - signs(guess.terms) * guess.error))) / guess.error


def best_of(kernel: Kernel, guesses: Iterable[Sum | None], free_near: bool, attempts: int = 3) -> Sum | None:
    """Try the guesses, the most level one first."""
    rated = [(misfit(kernel, guess), k, guess) for k, guess in enumerate(guesses) if guess is not None]
    for value, _, guess in sorted(rated, key=lambda item: item[:2])[:attempts]:
        if math.isfinite(value):
            found = exchange(kernel, guess, free_near)
            if found is not None:
                return found
    return None


def moved(kernel: Kernel, origin: Sum, log_far: float) -> Sum:
    """The sum carried along to another ``far`` by the local scaling of the kernel (exact for a homogeneous one)."""
    shift = Extended(log_far) - origin.extrema[-1]
    rates = origin.rates - shift
    weights = origin.weights + kernel.log_value(-rates) - kernel.log_value(-origin.rates)
    return Sum(rates, weights, origin.extrema + shift, origin.error)


def stretched(kernel: Kernel, origin: Sum, error: float) -> Sum:
    """The sum stretched to the range expected at another error."""
    factor = Extended(math.log(2.7 / origin.error) / math.log(2.7 / error))
    end = origin.extrema[-1]
    rates = (origin.rates + end) * factor - end
    weights = origin.weights + kernel.log_value(-rates) - kernel.log_value(-origin.rates) + np.log(factor)
    return Sum(rates, weights, (origin.extrema - end) * factor + end, error)


def continued(kernel: Kernel, origin: Sum, error: float, log_far: float, smallest_step: float = 1 / 256) -> Sum | None:
    """Follow the sum from one error and ``far`` to another in adaptive steps, ``near`` being free."""
    begin = np.array([math.log(origin.error), float(origin.extrema[-1])])
    change = np.array([math.log(error), log_far]) - begin
    done, step = 0.0, 1.0
    history: list[tuple[float, Sum]] = [(0.0, origin)]
    while done < 1.0:
        target = min(1.0, done + step)
        log_error, end = begin + target * change
        latest = history[-1][1]
        guesses = [moved(kernel, stretched(kernel, latest, math.exp(log_error)), end)]
        for count in (2, 3, 4):
            if len(history) >= count:
                guesses.append(along_parameter([h[0] for h in history[-count:]], [h[1] for h in history[-count:]], target, math.exp(log_error)))
        for guess in guesses:
            guess.extrema = guess.extrema.copy()
            guess.extrema[-1] = Extended(end)
        found = best_of(kernel, guesses, True, attempts=2)
        if found is None:
            step /= 2
            if step < smallest_step:
                return None
            continue
        history.append((target, found))
        done = target
        step *= 1.6
    return history[-1][1]


# ----------------------------------------------------------------------------------------------------------------- the table


@dataclass
class Entry:
    """One sum of the table, in double precision, with the promise it keeps."""

    terms: int
    rtol: float
    error: float
    far: float
    near: float
    log_rates: list[float]
    log_weights: list[float]


def measured_error(kernel: Kernel, log_rates: Array, log_weights: Array, extrema: Array, near: float, far: float) -> float:
    """Largest relative error in plain double arithmetic on a dense grid that contains the extrema and both ends."""
    x = np.asarray(extrema, dtype=float)
    fine = (x[:-1, None] + np.diff(x)[:, None] * (np.arange(40) / 40)).ravel()
    t = np.clip(np.exp(np.concatenate([fine, x])), near, far)
    t = np.concatenate([t, [near, far]])
    rates, weights = np.exp(log_rates), np.exp(log_weights)
    value = np.sum(weights * np.exp(-np.outer(t, rates)), axis=1)
    exact = np.exp(kernel.log_value(np.log(t.astype(Extended))))
    return float(np.max(np.abs(value / exact - 1)))


def rounded(values: Array, error: float) -> Array:
    """In double precision without the binary digits that do not matter at this error, which makes the file smaller."""
    quantum = 2.0 ** math.floor(math.log2(4e-3 * error))
    return np.round(values / Extended(quantum)).astype(float) * quantum if quantum > 1e-14 else values.astype(float)


def tabulated(kernel: Kernel, found: Sum, rtol: float, far: float) -> Entry | None:
    """Round a sum to double precision; None if it then misses its tolerance."""
    log_rates, log_weights = rounded(found.rates, found.error), rounded(found.weights, found.error)
    near = min(far, far * math.exp(-found.span * (1 - 1e-15)) * (1 + 1e-12))
    error = measured_error(kernel, log_rates, log_weights, found.extrema, near, far)
    if error > rtol:
        return None
    return Entry(found.terms, rtol, error, far, near, log_rates.tolist(), log_weights.tolist())


@dataclass
class Store:
    """Finished sums and entries, line by line in a file from which a later run resumes."""

    path: Path
    rows: dict[tuple[float, int], dict] = field(default_factory=dict)

    def load(self) -> None:
        """Read what an interrupted run has left; an unfinished last line is ignored."""
        if self.path.exists():
            for line in self.path.read_text().splitlines():
                try:
                    row = json.loads(line)
                except json.JSONDecodeError:
                    continue
                self.rows[row["far"], row["terms"]] = row

    def sums(self, far: float, terms: int) -> Row:
        """The sums by their error."""
        stored = self.rows.get((far, terms), {"sums": []})
        return {float(error): unpack(data) for error, data in stored["sums"]}

    def add(self, row: dict) -> None:
        """Keep one finished row."""
        self.rows[row["far"], row["terms"]] = row
        with self.path.open("a") as stream:
            stream.write(json.dumps(row) + "\n")


def pack(found: Sum) -> list:
    """A sum as nested lists (rounded to double, which the next exchange repairs)."""
    return [found.rates.astype(float).tolist(), found.weights.astype(float).tolist(), found.extrema.astype(float).tolist(), found.error]


def unpack(data: list) -> Sum:
    """The sum that was packed."""
    return Sum(*(np.array(part, dtype=Extended) for part in data[:3]), error=data[3])


def first_sum(kernel: Kernel, far: float, error: float) -> Sum:
    """One term: for the homogeneous kernel, which all kernels approach at small times, then followed to the place wanted."""
    # log of a exp(-u) sqrt(u) has its top at u = 1/2; both ends lie log((1 + error) / (1 - error)) below it
    depth = math.log((1 + error) / (1 - error))
    top = 0.5 * math.log(0.5) - 0.5

    def root(lower: float, upper: float) -> float:
        def above(u: float) -> bool:
            return 0.5 * math.log(u) - u > top - depth

        rising = above(upper)
        for _ in range(200):
            middle = 0.5 * (lower + upper)
            if above(middle) == rising:
                upper = middle
            else:
                lower = middle
        return 0.5 * (lower + upper)

    small, large = root(1e-12, 0.5), root(0.5, 50.0)
    weight = math.log1p(error) - top + 0.5 * math.log(large)
    start = Sum(
        np.array([math.log(large)], dtype=Extended),
        np.array([weight], dtype=Extended),
        np.array([math.log(small / large), math.log(0.5 / large), 0.0], dtype=Extended),
        error,
    )
    begin = exchange(kernel, moved(kernel, start, math.log(1e-9)), True)
    found = None if begin is None else continued(kernel, begin, error, math.log(far))
    if found is None:
        raise RuntimeError(f"no one-term sum at error {error}, far {far}")
    return found


def widest(kernel: Kernel, far: float, error: float, columns: list[Row], row: Row, other: Row) -> Sum | None:
    """The sum of prescribed error and widest range.

    ``columns`` holds the sums with one, two ... terms less, ``row`` those with as many terms and another error, ``other`` those with
    as many terms and a smaller ``far``.
    """
    log_far = math.log(far)
    guesses: list[Sum | None] = []
    shorter: list[Sum] = []
    for column in columns:
        if error not in column:
            break
        shorter.append(column[error])
    if shorter:
        for degree in (1, 2, 3):
            if len(shorter) > degree:
                guesses += [along_terms(shorter[: degree + 1], split, error) for split in (0.25, 0.5, 0.75)]
        guesses += [by_insertion(kernel, shorter[0], split, error) for split in (0.25, 0.5, 0.75)]
    closest = sorted(row.items(), key=lambda item: abs(math.log(item[0] / error)))[:5]
    variable = [1 / math.log(2.7 / key) for key, _ in closest]
    for count in range(2, len(closest) + 1):
        guesses.append(along_parameter(variable[:count], [s for _, s in closest[:count]], 1 / math.log(2.7 / error), error))
    for guess in guesses:
        if guess is not None:
            guess.extrema = guess.extrema.copy()
            guess.extrema[-1] = Extended(log_far)
    found = best_of(kernel, guesses, True)
    if found is None and error in other:
        found = continued(kernel, other[error], error, log_far)
    if found is None and closest:
        found = continued(kernel, closest[0][1], error, log_far)
    return found


def at_range(kernel: Kernel, span: float, row: Row, wider: Sum | None) -> Sum | None:
    """The n-term sum of least error over a prescribed range, from the sums on either side of it."""
    members = sorted(row.values(), key=lambda s: -s.span)[:4]
    if wider is not None:
        members = [wider, *members]
    guesses: list[Sum | None] = []
    for count in range(1, len(members) + 1):
        part = members[:count]
        log_error = polynomial_extrapolation([s.span for s in part], [np.array([1 / math.log(2.7 / s.error)], dtype=Extended) for s in part], span)
        error = 2.7 * math.exp(-1 / float(log_error[0])) if log_error[0] > 0 else part[0].error
        if count == 1:
            guess = Sum(part[0].rates.copy(), part[0].weights.copy(), part[0].extrema.copy(), error)
        else:
            guess = along_parameter([s.span for s in part], part, span, error)
        guess.extrema = guess.extrema.copy()
        guess.extrema[0] = guess.extrema[-1] - Extended(span)
        guesses.append(guess)
    return best_of(kernel, guesses, False, attempts=4)


def rows_for(kernel: Kernel, far: float, smaller_far: float | None, store: Store, report: Callable[[str], None]) -> Iterator[dict]:
    """All sums for one ``far``, number of terms by number of terms."""
    largest_span = min(math.log(LARGEST_RATIO), math.log(far / SMALLEST_NEAR))
    columns: list[Row] = []
    served: set[float] = set()  # tolerances at which fewer terms reach the widest range of the table
    for n in range(1, kernel.largest_terms + 1):
        if (far, n) in store.rows:
            stored = store.rows[far, n]
            columns = [store.sums(far, n), *columns][:4]
            served |= set(stored["served"])
            yield stored
            continue
        began = time.perf_counter()
        other = {} if smaller_far is None else store.sums(smaller_far, n)
        row: Row = {}
        entries: list[Entry] = []
        wider: Sum | None = None
        waiting = [rtol for rtol in QUARTER_DECADES if rtol >= min(kernel.tolerances) and rtol not in served]
        if n == 1:
            row[aim(waiting[0])] = first_sum(kernel, far, aim(waiting[0]))
        missed: list[float] = []
        for attempt in range(2):
            for rtol in waiting:
                error = aim(rtol)
                found = widest(kernel, far, error, columns, row, other) if error not in row else row[error]
                if found is None:
                    missed.append(rtol)
                elif found.span > largest_span:
                    served.add(rtol)
                    wider = found
                elif found.span < SMALLEST_SPAN:
                    break
                else:
                    row[error] = found
            if not missed or attempt:
                break
            waiting, missed = missed[::-1], []
        for rtol in kernel.tolerances:
            if aim(rtol) in row and row[aim(rtol)].span > math.log(SMALLEST_RATIO):
                entry = tabulated(kernel, row[aim(rtol)], rtol, far)
                if entry is None:
                    missed.append(rtol)
                else:
                    entries.append(entry)
        cut = [rtol for rtol in kernel.tolerances if rtol in served]
        if cut and row:
            capped = at_range(kernel, largest_span, row, wider)
            entry = None if capped is None else tabulated(kernel, capped, cut[-1], far)
            if entry is None:
                missed.append(cut[-1])
            else:
                entries.append(entry)
        columns = [row, *columns][:4]
        result = {
            "far": far,
            "terms": n,
            "sums": [[error, pack(found)] for error, found in row.items()],
            "entries": [vars(entry) for entry in entries],
            "served": sorted(served),
        }
        note = f"  missed {', '.join(f'{rtol:g}' for rtol in missed)}" if missed else ""
        report(f"{kernel.name} far {far:g} terms {n}: {len(entries)} sums, {time.perf_counter() - began:.1f} s{note}")
        store.add(result)
        yield result


def save(kernel: Kernel, entries: list[dict], output: Path) -> None:
    """Write the table atomically."""
    entries = sorted(entries, key=lambda e: (e["far"], e["terms"], -e["rtol"]))
    lengths = [e["terms"] for e in entries]
    arrays = {
        "terms": np.array(lengths, dtype=np.int64),
        "rtol": np.array([e["rtol"] for e in entries]),
        "error": np.array([e["error"] for e in entries]),
        "offset": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        "log_rates": np.concatenate([e["log_rates"] for e in entries]),
        "log_weights": np.concatenate([e["log_weights"] for e in entries]),
    }
    if kernel.name == "basset":
        arrays["ratio"] = np.array([e["far"] / e["near"] for e in entries])
    else:
        arrays["far"] = np.array([e["far"] for e in entries])
        arrays["near"] = np.array([e["near"] for e in entries])
    output.parent.mkdir(parents=True, exist_ok=True)
    temporary = output.with_name(output.name + ".tmp")
    with temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    os.replace(temporary, output)


def main(arguments: list[str] | None = None) -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description="Tabulate minimax exponential sums.")
    parser.add_argument("--kernel", choices=sorted(KERNELS), default="basset")
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--largest-terms", type=int, default=None, help="stop at this number of terms")
    parser.add_argument("--keep-partial", action="store_true", help="do not remove the partial results when done")
    options = parser.parse_args(arguments)
    if np.finfo(Extended).eps > 2e-19:
        parser.error("needs a numpy.longdouble with at least 64 bits of mantissa")
    kernel = KERNELS[options.kernel]()
    if options.largest_terms is not None:
        kernel = Kernel(kernel.name, kernel.log_value, kernel.slope, kernel.far, options.largest_terms, kernel.tolerances)
    store = Store(options.output.with_name(options.output.name + ".partial.jsonl"))
    store.path.parent.mkdir(parents=True, exist_ok=True)
    store.load()
    began = time.perf_counter()

    def report(text: str) -> None:
        print(f"[{time.perf_counter() - began:7.1f} s] {text}", file=sys.stderr, flush=True)

    entries: list[dict] = []
    for k, far in enumerate(kernel.far):
        for result in rows_for(kernel, far, kernel.far[k - 1] if k else None, store, report):
            entries += result["entries"]
        save(kernel, entries, options.output)
    report(f"{len(entries)} sums, {options.output.stat().st_size / 1e3:.0f} kB in {options.output}")
    if not options.keep_partial:
        store.path.unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
