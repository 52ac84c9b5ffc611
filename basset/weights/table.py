"""The base of every rule: stencils (weights for a unit step), the recipe that a rule returns, and the cached table of weights.

All weights but the oldest few are independent of n. A `Stencil` gives those (`interior`), the few that depend on where
the history begins (`oldest`), and whole rows for histories too short to have an interior (`short`), all for a unit step;
scaling, caching and assembly are done here, once. The split into weights and starting corrections: Lubich (1986),
SIAM J. Math. Anal. 17, 704, for convolution quadratures; this library for the others.
"""

from __future__ import annotations

import abc
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from basset.exponentials import ExponentialSum
from basset.kernels import AnyKernel, Floats, Kernel, VaryingSlipKernel
from basset.spectrum import following_sum
from basset.weights.lagrange import MAXIMUM_ORDER, row_by_panels

INPUTS = ("rate", "slip")


@dataclass(frozen=True)
class Stencil(abc.ABC):
    """Weights over the whole history for a unit step; `n` counts steps, `kernel` is already scaled to the step.

    A subclass with parameters is a frozen dataclass: tables of weights are kept by its value.
    """

    @property
    def reach(self) -> int:
        """How many of the oldest samples have weights that depend on where the history begins."""
        return 1

    @property
    def first(self) -> int:
        """The smallest n ≥ 1 whose row splits into interior and oldest, at least reach − 1; by default 2·reach − 1."""
        return 2 * self.reach - 1

    @abc.abstractmethod
    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """Interior weights w[start:stop], newest first; each has the same bits in whatever blocks they are asked for."""

    @abc.abstractmethod
    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """Weights of the `reach` oldest samples, oldest first, for each n ≥ first: (len(n), reach)."""

    def short(self, n: int, kernel: Kernel, input: str) -> Floats:
        """The whole row (n+1,), newest first, for 1 ≤ n < first ≤ 21; here product integration of the degree that n + 1 samples allow, 10 at most."""
        return row_by_panels(n, MAXIMUM_ORDER, kernel, input)

    @property
    def far(self) -> float:
        """From this n on `oldest_sum` is cheaper than rows of `oldest`, dimensionless; infinite where there is no such short cut."""
        return math.inf

    def oldest_sum(self, first: int, last: int, samples: Floats, kernel: Kernel, input: str) -> Floats:
        """Σ_i (oldest weight i of row n)·samples[i] for n = first … last, first ≥ far; samples (reach, columns)."""
        raise AssertionError(f"{type(self).__name__} has no short cut for the oldest samples")

    def inside(self, window: int, lags: int, kernel: Kernel) -> Floats:
        """Weights (lags+1,) on rates, newest first, of the newest `window` steps where a sum stands for what is older.

        Here those of a history that begins at the window's end; polynomials that reach beyond it may do better.
        """
        result = np.zeros(lags + 1)
        result[: window + 1] = np.concatenate(table(self, kernel, "rate").row(window))[::-1]
        return result


@dataclass(frozen=True)
class Recipe:
    """What a rule does at one step size: all that evaluation, streams and solvers need.

    Parameters
    ----------
    stencil : Stencil
        The weights of the remembered steps.
    window : int or None
        Whole steps that are remembered; None for all of them.
    tail : ExponentialSum or None
        What stands for the kernel beyond the window; None drops it.
    degree : int
        Of the polynomials through the samples that are used where the stencil does not reach: beyond the window, and at a
        jump. 0: a jump of the rate is averaged (first order), and straight lines go beyond the window.

    Examples
    --------
    >>> import basset
    >>> recipe = basset.Exponential(order=3).recipe(0.1, 10.0, basset.BassetKernel())
    >>> recipe.window, recipe.degree, recipe.used(1), recipe.used(100), recipe.lags
    (2, 3, 1, 2, 4)
    >>> recipe.within(4).window is None
    True
    """

    stencil: Stencil
    window: int | None = None
    tail: ExponentialSum | None = None
    degree: int = 0

    def __post_init__(self) -> None:
        least = max(1, self.degree) // 2 + 1
        if self.tail is not None and (self.window or 0) < least:
            raise ValueError(f"window must be at least {least} steps under a tail with polynomials of degree {self.degree}, got {self.window}")

    def with_tail(self, steps: int, rtol: float | None, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The recipe on so many steps, with a sum fitted to older ones whose weights follow the slip where the kernel does; itself for rtol None."""
        if rtol is None:
            return self
        near = steps * dt
        if isinstance(kernel, VaryingSlipKernel):
            tail = following_sum(near, max(horizon, 2.0 * near), rtol, kernel)
        else:
            tail = ExponentialSum.fit(near, max(horizon + dt, 2.0 * near), rtol, kernel)  # a jump may lie before the first sample
        return replace(self, window=steps, tail=tail)

    def used(self, n: int) -> int:
        """How many of n steps are remembered with the kernel itself."""
        return n if self.window is None else min(n, self.window)

    @property
    def lags(self) -> int:
        """Largest lag that a panel leaving the window touches."""
        return (self.window or 0) + (max(1, self.degree) + 1) // 2

    def within(self, steps: int) -> Recipe:
        """The recipe for so many steps: the whole history where the tail would have nothing to stand for."""
        return Recipe(self.stencil, degree=self.degree) if self.tail is not None and steps <= self.lags else self


def step_factor(dt: float, input: str) -> float:
    """What turns unit-step weights into weights for `dt`: √dt on rates, 1/√dt on slips."""
    return float(np.sqrt(dt)) if input == "rate" else float(1.0 / np.sqrt(dt))


class WeightTable:
    """The unit-step weights of one stencil and kernel, built as far as they were asked for; oldest first, as samples lie."""

    remembered_rows = 1024

    def __init__(self, stencil: Stencil, kernel: Kernel, input: str) -> None:
        self._stencil, self._kernel, self._input = stencil, kernel, input
        self._built = np.empty(0)  # interior weights, reversed: the newest is the last
        self._near: Floats = np.empty((0, stencil.reach))
        self._rows: OrderedDict[int, Floats] = OrderedDict()
        self._spectrum: tuple[int, int, NDArray[np.complex128]] | None = None
        self._lock = threading.RLock()
        self.nbytes = 0
        self.grown = False  # since the cache was last trimmed

    def _grew(self, array: NDArray[Any], instead_of: int = 0) -> None:
        self.nbytes += array.nbytes - instead_of
        self.grown = True

    def interior(self, count: int) -> Floats:
        """The `count` newest interior weights, the newest last: a view, a prefix of what is kept."""
        with self._lock:
            have = len(self._built)
            if count > have:
                size = max(count, min(2 * have, have + (1 << 20)))
                grown = np.empty(size)
                grown[size - have :] = self._built
                grown[: size - have] = self._stencil.interior(have, size, self._kernel, self._input)[::-1]
                self._grew(grown, self._built.nbytes)
                self._built = grown
            return self._built[len(self._built) - count :]

    def row(self, n: int) -> tuple[Floats, Floats]:
        """(oldest, body) with H = Σ oldest·g[:len(oldest)] + Σ body·g[len(oldest):]; both oldest first."""
        stencil = self._stencil
        with self._lock:
            oldest = self._rows.get(n)
            if oldest is None:
                if n < stencil.first:
                    oldest = stencil.short(n, self._kernel, self._input)[::-1].copy()
                else:
                    oldest = stencil.oldest(np.array([n]), self._kernel, self._input)[0]
                self._rows[n] = oldest
                dropped = self._rows.popitem(last=False)[1].nbytes if len(self._rows) > self.remembered_rows else 0
                self._grew(oldest, dropped)
        return oldest, self.interior(n + 1 - len(oldest))

    def trajectory(self, samples: Floats) -> Floats:
        """Σ w g at every node for samples (n+1, columns), unit step; row 0 is zero. O(n log n) by one FFT convolution."""
        stencil, n = self._stencil, len(samples) - 1
        first, reach = stencil.first, stencil.reach
        result = np.zeros_like(samples)
        for k in range(1, min(first, n + 1)):
            result[k] = self.row(k)[0] @ samples[: k + 1]
        if n < first:
            return result
        count = n + 1 - reach  # samples with interior weights in the last row
        if count:
            import scipy.fft  # its import takes longer than that of this whole package

            size = scipy.fft.next_fast_len(2 * count - 1, real=True)
            product = scipy.fft.rfft(samples[reach:], size, axis=0) * self._transformed(count, size)[:, None]
            result[first:] = scipy.fft.irfft(product, size, axis=0)[first - reach : count]
        near = int(min(n, stencil.far - 1))
        result[first : near + 1] += self.oldest_rows(near) @ samples[:reach]
        if n > near:
            result[near + 1 :] += stencil.oldest_sum(near + 1, n, samples[:reach], self._kernel, self._input)
        return result

    def oldest_rows(self, last: int) -> Floats:
        """Weights of the oldest samples for every row from the first that splits to `last`."""
        count = last + 1 - self._stencil.first
        with self._lock:
            if len(self._near) < count:
                near = self._stencil.oldest(np.arange(self._stencil.first, last + 1), self._kernel, self._input)
                self._grew(near, self._near.nbytes)
                self._near = near
            return self._near[:count]

    def _transformed(self, count: int, size: int) -> NDArray[np.complex128]:
        with self._lock:
            if self._spectrum is None or self._spectrum[:2] != (count, size):
                import scipy.fft

                spectrum = scipy.fft.rfft(self.interior(count)[::-1], size)
                self._grew(spectrum, self._spectrum[2].nbytes if self._spectrum else 0)
                self._spectrum = (count, size, spectrum)
            return self._spectrum[2]


def filtered_by(row: Floats, columns: Floats) -> Floats:
    """Σ row·columns over every full window of columns (nodes, k), by FFT; `row` oldest first, as the nodes."""
    from scipy.signal import oaconvolve  # takes half a second to import

    return np.asarray(oaconvolve(columns, row[::-1, None], mode="valid", axes=0))


class Sized(Protocol):
    """Anything with its size in bytes."""

    @property
    def nbytes(self) -> int:
        """Bytes held now; may grow between uses."""
        ...


Entry = TypeVar("Entry", bound=Sized)


class ByteCache(Generic[Entry]):
    """Entries by key, the least recently used dropped first once they hold more than `limit` bytes together.

    An entry that alone exceeds the limit is used and dropped. Safe to share between threads.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._entries: OrderedDict[Hashable, Entry] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def nbytes(self) -> int:
        """Bytes held by all entries."""
        return sum(entry.nbytes for entry in self._entries.values())

    def get(self, key: Hashable, make: Callable[[], Entry]) -> Entry:
        """The entry for `key`, made if it is not there."""
        with self._lock:
            entry = self._entries.get(key)
            if entry is None:
                entry = self._entries[key] = make()
            else:
                self._entries.move_to_end(key)
            return entry

    def trim(self) -> None:
        """Drop the least recently used entries until the limit is kept; called after an entry has grown."""
        with self._lock:
            while self._entries and self.nbytes > self.limit:
                self._entries.popitem(last=False)

    def clear(self) -> None:
        """Drop all entries: the next use builds its weights anew."""
        with self._lock:
            self._entries.clear()


TABLES: ByteCache[WeightTable] = ByteCache(limit=256 << 20)


def table(stencil: Stencil, kernel: Kernel, input: str) -> WeightTable:
    """The cached table of a stencil for a kernel scaled to the step."""
    return TABLES.get((stencil, kernel, input), lambda: WeightTable(stencil, kernel, input))
