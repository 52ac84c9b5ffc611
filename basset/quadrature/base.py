"""The contract of a rule, and the table of its weights.

A rule replaces the history integral by a sum over samples, newest first:

    ∫_0^{t_n} K(t_n − τ) g(τ) dτ ≈ Σ_j w[j] g(t_{n−j}),   t_n = n·dt.

Every rule here has the same shape: all weights but the oldest few are the same whatever n is. A rule gives those
(`_interior`), the few that depend on where the history begins (`_oldest`), and whole rows for histories too short to
have an interior (`_short`), all for a unit step; scaling, caching and assembly are done here, once.
"""

from __future__ import annotations

import abc
import math
import threading
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, ClassVar, overload

import numpy as np
from numpy.typing import NDArray

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel
from basset.quadrature.cache import ByteCache

if TYPE_CHECKING:
    from basset.exponentials import ExponentialSum
    from basset.finite_reynolds import VaryingPlan, VaryingSlipKernel
    from basset.streaming import Plan

INPUTS = ("rate", "slip")


class Rule(abc.ABC):
    """A way to compute the history integral from samples on a uniform grid.

    Subclasses are frozen dataclasses that hold the parameters of one published method, checked on creation.

    Attributes
    ----------
    name : str
        The rule's name in `basset.SCHEMES`.
    error_order : float
        The exponent of dt in the error, for a smooth rate.
    references : tuple of str
        Where the method was published.
    inputs : tuple of str
        What the samples may be: "rate" (g = df/dt) and, where the method has such a form, "slip" (f itself).

    References
    ----------
    Each subclass names its own, in its docstring and as `references`; the form that all have in common: this library.

    Examples
    --------
    >>> from basset import Daitche
    >>> rule = Daitche(order=2)
    >>> rule.name, rule.error_order, rule.inputs
    ('daitche', 3.0, ('rate', 'slip'))
    >>> rule.weights(1, 4.0).round(12)  # one panel of 4 s: 2√4 in all
    array([2.66666667, 1.33333333])
    >>> plan = rule.plan(dt=0.1, horizon=1.0)
    >>> plan.run(plan.start(), np.ones(11))[-1].round(12)  # f' = 1: 2√t
    np.float64(2.0)
    """

    name: ClassVar[str]
    references: ClassVar[tuple[str, ...]]

    @property
    @abc.abstractmethod
    def error_order(self) -> float:
        """The exponent of dt in the error for a smooth rate, dimensionless."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """What the samples may be."""
        return ("rate",)

    @property
    @abc.abstractmethod
    def _remembered(self) -> FullRule:
        """The full-history rule that is applied to the remembered steps."""

    @abc.abstractmethod
    def _window_steps(self, dt: float) -> int | None:
        """Whole steps that are remembered, None for all of them."""

    @property
    def _has_tail(self) -> bool:
        """Whether a sum of exponentials stands for the kernel beyond the window."""
        return False

    def _tail(self, dt: float, horizon: float, kernel: Kernel) -> ExponentialSum | None:
        """That sum, valid to `horizon`."""
        return None

    def _accept(self, kernel: Kernel, input: str) -> None:
        """Refuse a kernel or an input that the method has no form for."""
        if not isinstance(kernel, Kernel):
            raise TypeError(f"kernel must be a kernel such as basset.BassetKernel(), got {_validate.shown(kernel)}")
        _validate.choice("input", input, INPUTS)
        if input not in self.inputs:
            raise ValueError(f"input must be 'rate' for {type(self).__name__}, got {input!r}: the method is defined on samples of the rate df/dt only")

    def weights(self, n: int, dt: float, kernel: Kernel = BassetKernel(), input: str = "rate") -> Floats:
        """Weights w of H(t_n) ≈ Σ_j w[j] g(t_{n−j}), newest first.

        Parameters
        ----------
        n : int
            Number of steps, 1 or more.
        dt : float, seconds
            Step size.
        kernel : Kernel
            What is remembered.
        input : {"rate", "slip"}
            For "slip" the weights act on f and give d/dt ∫K f (thesis 5-8): the initial slip f(t_0) is counted.

        Returns
        -------
        ndarray of float64 (n+1,), s^(1/2) for "rate", s^(-1/2) for "slip"; the caller's own copy.

        Raises
        ------
        ValueError, TypeError
            If n < 1, dt ≤ 0 or not finite, or the rule has no form for the kernel or the input.
        """
        n = _validate.integer("n", n, 1)
        dt = _validate.positive("dt", dt, "seconds")
        self._accept(kernel, input)
        if self._has_tail:
            return self.plan(dt, n * dt, kernel).weights(n)
        steps = self._window_steps(dt)
        used = n if steps is None else min(n, steps)
        result = np.zeros(n + 1)
        oldest, body = table(self._remembered, kernel.scaled(dt), input).row(used)
        result[: len(body)] = body[::-1]
        result[len(body) : used + 1] = oldest[::-1]
        result *= step_factor(dt, input)
        if used < n and input == "slip":  # what came before the window is forgotten: it makes no jump at its edge
            result[used] -= float(kernel(used * dt))
        TABLES.trim()
        return result

    @overload
    def plan(self, dt: float, horizon: float, kernel: Kernel = ...) -> Plan: ...

    @overload
    def plan(self, dt: float, horizon: float, kernel: VaryingSlipKernel) -> VaryingPlan: ...

    def plan(self, dt: float, horizon: float, kernel: Kernel | VaryingSlipKernel = BassetKernel()) -> Plan | VaryingPlan:
        """Make the rule ready to stream: all set-up happens here.

        Parameters
        ----------
        dt : float, seconds
            Step size.
        horizon : float, seconds
            The longest time that will be remembered, counted from the first sample. A window without tail, and a published
            tail, run on beyond it.
        kernel : Kernel or VaryingSlipKernel
            What is remembered; with a VaryingSlipKernel the plan's methods take `slip=`.

        Returns
        -------
        basset.streaming.Plan, or basset.finite_reynolds.VaryingPlan

        Raises
        ------
        ValueError, TypeError
            If dt or horizon is not positive, the rule has no form for the kernel, the window is shorter than a step, or
            the tail was made for another kernel or does not reach from the window to the horizon.
        """
        from basset import finite_reynolds, streaming

        if isinstance(kernel, finite_reynolds.VaryingSlipKernel):
            return finite_reynolds.plan(self, dt, horizon, kernel)
        return streaming.Plan(self, dt, horizon, kernel)


class FullRule(Rule):
    """A rule over the whole history: all it has to give, for the unit step.

    `n` counts steps and `kernel` is already scaled to the step.
    """

    @property
    @abc.abstractmethod
    def _reach(self) -> int:
        """How many of the oldest samples have weights that depend on where the history begins."""

    @property
    def _first(self) -> int:
        """The smallest n ≥ 1 whose row splits into interior and oldest; at least _reach − 1."""
        return 1

    @abc.abstractmethod
    def _interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """Interior weights w[start:stop], newest first."""

    @abc.abstractmethod
    def _oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """Weights of the `_reach` oldest samples for each n ≥ _first, shape (len(n), _reach), oldest first."""

    def _short(self, n: int, kernel: Kernel, input: str) -> Floats:
        """The whole row (n+1,), newest first, for 1 ≤ n < _first; to be given where _first is above 1."""
        raise AssertionError(f"{type(self).__name__} splits every row")

    @property
    def _far(self) -> float:
        """From this n on `_oldest_sum` is cheaper than rows of `_oldest`; infinite where there is no such short cut."""
        return math.inf

    def _oldest_sum(self, first: int, last: int, samples: Floats, kernel: Kernel, input: str) -> Floats:
        """Σ_i (oldest weight i of row n)·samples[i] for n = first … last, first ≥ _far; samples (_reach, columns)."""
        raise AssertionError(f"{type(self).__name__} has no short cut for the oldest samples")

    @property
    def _remembered(self) -> FullRule:
        return self

    def _window_steps(self, dt: float) -> int | None:
        return None


def step_factor(dt: float, input: str) -> float:
    """What turns unit-step weights into weights for `dt`: √dt on rates, 1/√dt on slips."""
    return float(np.sqrt(dt)) if input == "rate" else float(1.0 / np.sqrt(dt))


class WeightTable:
    """The unit-step weights of one rule and kernel, built as far as they were asked for; oldest first, as samples lie."""

    remembered_rows = 1024

    def __init__(self, rule: FullRule, kernel: Kernel, input: str) -> None:
        self._rule, self._kernel, self._input = rule, kernel, input
        self._built = np.empty(0)  # interior weights, reversed: the newest is the last
        self._near: Floats = np.empty((0, rule._reach))
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
                grown[: size - have] = self._rule._interior(have, size, self._kernel, self._input)[::-1]
                self._grew(grown, self._built.nbytes)
                self._built = grown
            return self._built[len(self._built) - count :]

    def row(self, n: int) -> tuple[Floats, Floats]:
        """(oldest, body) with H = Σ oldest·g[:len(oldest)] + Σ body·g[len(oldest):]; both oldest first."""
        rule = self._rule
        with self._lock:
            oldest = self._rows.get(n)
            if oldest is None:
                if n < rule._first:
                    oldest = rule._short(n, self._kernel, self._input)[::-1].copy()
                else:
                    oldest = rule._oldest(np.array([n]), self._kernel, self._input)[0]
                self._rows[n] = oldest
                dropped = self._rows.popitem(last=False)[1].nbytes if len(self._rows) > self.remembered_rows else 0
                self._grew(oldest, dropped)
        return oldest, self.interior(n + 1 - len(oldest))

    def trajectory(self, samples: Floats) -> Floats:
        """Σ w g at every node for samples (n+1, columns), unit step; row 0 is zero. O(n log n) by one FFT convolution."""
        rule, n = self._rule, len(samples) - 1
        first, reach = rule._first, rule._reach
        result = np.zeros_like(samples)
        for k in range(1, min(first, n + 1)):
            result[k] = self.row(k)[0] @ samples[: k + 1]
        if n < first:
            return result
        count = n + 1 - reach  # samples with interior weights in the last row
        if count:
            import scipy.fft  # takes longer to import than all of this package

            size = scipy.fft.next_fast_len(2 * count - 1, real=True)
            product = scipy.fft.rfft(samples[reach:], size, axis=0) * self._transformed(count, size)[:, None]
            result[first:] = scipy.fft.irfft(product, size, axis=0)[first - reach : count]
        near = int(min(n, rule._far - 1))
        result[first : near + 1] += self.oldest_rows(near) @ samples[:reach]
        if n > near:
            result[near + 1 :] += rule._oldest_sum(near + 1, n, samples[:reach], self._kernel, self._input)
        return result

    def oldest_rows(self, last: int) -> Floats:
        """Weights of the oldest samples for every row from the first that splits to `last`."""
        count = last + 1 - self._rule._first
        with self._lock:
            if len(self._near) < count:
                near = self._rule._oldest(np.arange(self._rule._first, last + 1), self._kernel, self._input)
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


TABLES: ByteCache[WeightTable] = ByteCache(limit=256 << 20)


def table(rule: FullRule, kernel: Kernel, input: str) -> WeightTable:
    """The cached table of a rule for a kernel scaled to the step."""
    return TABLES.get((rule, kernel, input), lambda: WeightTable(rule, kernel, input))


def resolve(rule: Any) -> Rule:
    """A rule, from a rule or from a name in `basset.SCHEMES` whose parameters all have defaults."""
    if isinstance(rule, Rule):
        return rule
    if isinstance(rule, str):
        from basset.quadrature import SCHEMES

        scheme = SCHEMES[rule]
        try:
            return scheme()
        except TypeError as error:
            raise TypeError(f"rule {rule!r} needs parameters: pass basset.{scheme.__name__}(...) instead ({error})") from None
    hint = f"; write {rule.__name__}(...)" if isinstance(rule, type) and issubclass(rule, Rule) else ""
    raise TypeError(f"rule must be a rule such as basset.Daitche(order=3), got {_validate.shown(rule)}{hint}")
