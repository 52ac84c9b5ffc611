"""The history at nonuniform times by a sum of exponentials: constant memory and time per sample, whatever the steps.

K is replaced by a sum from the lag `near` on, which is no longer than a step. What is left of K, up to there, lies within the newest panel, where its moments
are numbers of the plan. An exponential takes in a panel by the moments of its decay over it, once the polynomial of the panel is known: with
the next sample. The first panel of a segment has a polynomial of its last degree one sample later, and is corrected then.
Recursion: van Hinsberg et al. (2011), J. Comput. Phys. 230, 1465; at nonuniform times: this library.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset import _validate
from basset.exponentials import ExponentialSum, _geometric, _has_geometric
from basset.kernels import Floats, Kernel, MeiAdrianKernel
from basset.positive_sums import positive_sum
from basset.streaming._uneven import decays, run
from basset.streaming.state import Array, AtNewest, block_of, owned, sample_of, shaped
from basset.weights._panels import DEPTH
from basset.weights.uneven import at_node, pieces

KEPT = DEPTH + 2
ROUNDED = 1.0 - 1e-6  # steps that differ by rounding are equal
SHORTEST = 1.000000001e-12  # of the time to be remembered
FINEST = 1e-14  # promise that double precision keeps


class Planned(NamedTuple):
    """A sum of exponentials, and the moments ∫ (K − sum) (s/near)^m ds, m = 0 … 3, up to the lag at which it begins."""

    tail: ExponentialSum
    weights: Floats
    rates: Floats
    local: Floats

    def advance(self, order: int, slip: bool, t: Floats, g: Floats, first: int, begin: int, impulse: Floats, terms: Floats, history: Floats) -> int:
        """`_uneven.run`, with room to work in."""
        own, other = np.empty((2, 6, len(self.rates)))
        room = (own, other, np.empty(4), np.empty(2), np.empty(2, dtype=np.int64), np.empty(4), np.empty((g.shape[1], 4)))
        return int(run(t, g, first, begin, order, slip, self.weights, self.rates, self.tail.near, self.local, impulse, terms, history, *room))


@lru_cache(maxsize=64)
def planned(kernel: Kernel, rtol: float, near: float, far: float) -> Planned:
    """A sum for K from `near` to `far`; it begins later where that is more than twelve decades. What no table holds is fitted here."""
    if rtol < FINEST:
        raise ValueError(f"rtol must be {FINEST:g} or greater at nonuniform times, got {rtol:g}")
    endless = _has_geometric(kernel)
    near = near if endless else max(near, far * SHORTEST)
    far = max(far, 2.0 * near)
    try:
        tail = ExponentialSum.fit(near, far, rtol, kernel)
    except ValueError:
        if endless:
            tail = _geometric(near, far, rtol, kernel)
        elif isinstance(kernel, MeiAdrianKernel):
            tail = ExponentialSum(*positive_sum(kernel, near, far, rtol), near, far, kernel, rtol)
        else:
            raise
    weights, rates, total = np.array(tail.weights), np.array(tail.rates), np.empty(4)
    decays(weights, rates, near, np.empty((6, len(tail))), total)
    x, w = kernel.rule(0.0, near)
    return Planned(tail, weights, rates, w @ x[:, None] ** np.arange(4) - total)


def check_times(t: Floats, rows: NDArray[np.integer[Any]], shortest: float = 0.0) -> None:
    """Refuse times (s) that fall or stand more than twice, and steps below `shortest` (s); `rows` are their numbers, for messages."""
    steps = np.diff(t)
    if (steps < 0.0).any():
        k = int(np.argmax(steps < 0.0))
        raise ValueError("t must not fall, got {} after {} seconds in row {}".format(*_validate.apart(t[k + 1], t[k]), rows[k + 1]))
    thrice = (steps[1:] == 0.0) & (steps[:-1] == 0.0)
    if thrice.any():
        k = int(np.argmax(thrice)) + 2
        raise ValueError(f"t must hold an instant at most twice, before and after a jump, got {t[k]:g} seconds for the third time in row {rows[k]}")
    short = (steps > 0.0) & (steps < shortest * ROUNDED)
    if short.any():
        k = int(np.argmax(short))
        raise ValueError(
            "t must rise by {} seconds or more, the shortest step planned, got {} before row {}".format(*_validate.apart(shortest, steps[k]), rows[k + 1])
        )


def halved(x: float, up: bool) -> float:
    """The next power of √2: paths of about the same steps and length then have one sum."""
    return float(2.0 ** ((math.ceil if up else math.floor)(2.0 * math.log2(x)) / 2.0))


class UnevenState(NamedTuple):
    """The state of a stream at nonuniform times: float64 arrays only, as `basset.streaming.state.State`."""

    samples: Array  # (components, KEPT), unit of f per second: the newest ones, the newest last
    terms: Array  # (components, terms), unit of H: the exponentials, without the newest panel
    impulse: Array  # (components, 1), unit of f: by how much f jumps at the newest sample
    history: Array  # shape of one sample: H at the newest one
    times: Array  # (KEPT,), seconds: of the samples
    counters: Array  # (3,): samples so far, where the segment begins among those that are kept, time of the first sample


class UnevenPlan(AtNewest):
    """`Exponential` made ready to stream at nonuniform times, by `Exponential.uneven_plan`: the methods of `basset.streaming.Plan`, with times of samples.

    `shortest` (s) is the shortest step that may be taken, longer than asked for where no sum for the kernel is so long; `tail_sum` stands for the kernel
    from that lag on.

    >>> import basset
    >>> plan = basset.Exponential(order=3, rtol=1e-10).uneven_plan(horizon=10.0)
    >>> state = plan.start()
    >>> for t in (0.0, 0.1, 0.3, 1.0, 1.44):
    ...     plan.push(state, 1.0, t)  # f' = 1: H = 2√t
    >>> round(plan.value(state), 8)
    2.4
    """

    def __init__(self, order: int, rtol: float, shortest: float, horizon: float, kernel: Kernel) -> None:
        self.order, self.kernel, self.horizon = order, kernel, horizon
        self._planned = planned(kernel, rtol, shortest * ROUNDED, horizon)
        self.tail_sum = self._planned.tail
        self.shortest = self.tail_sum.near / ROUNDED

    def start(self, shape: tuple[int, ...] | int = ()) -> UnevenState:
        """An empty state for samples of that shape."""
        shape, components = shaped(shape)
        samples, terms, impulse = (np.zeros((components, width)) for width in self._widths.values())
        return UnevenState(samples, terms, impulse, np.zeros(shape), np.zeros(KEPT), np.zeros(3))

    def push(self, state: UnevenState, g: ArrayLike, t: float) -> None:
        """Accept the next rate, in place, at the time t (s): after the last one by the shortest step or more, or the same again where the rate jumps.

        ValueError, TypeError if the sample has another shape, a number is not finite, the time falls, the step is too short or the horizon exceeded; the state
        is then unchanged.
        """
        self._own(state)
        self.run(state, sample_of("g", g, state.history.shape)[None], [_validate.number("t", t)])

    def run(self, state: UnevenState, G: ArrayLike, t: ArrayLike) -> Array:
        """Accept a block of rates (steps, *shape) at the times t (steps,), s, in place; H (steps, *shape) at each. Errors as `push`."""
        self._own(state)
        shape, count, begin = state.history.shape, int(state.counters[0]), int(state.counters[1])
        rates, times = block_of(G, shape), _validate.real_array("t", t)
        if times.shape != rates.shape[:1]:
            raise ValueError(f"t must have the shape {rates.shape[:1]}, one time for each sample, got {times.shape}")
        for name, values in (("G", rates), ("t", times)):
            if not np.isfinite(values).all():
                raise _validate.not_finite(values, 0, name)
        if not len(rates):
            return np.empty_like(rates)
        kept = min(count, KEPT)
        times = np.concatenate([state.times[KEPT - kept :], times])
        rates = np.ascontiguousarray(np.concatenate([state.samples[:, KEPT - kept :].T, rates.reshape(len(rates), math.prod(shape))]))
        check_times(times, np.arange(len(times)) - kept, self.shortest)
        start = state.counters[2] if count else times[0]
        if times[-1] - start > self.tail_sum.far:
            raise ValueError(
                "horizon must cover the stream, {} seconds from its first sample on, got {}".format(*_validate.apart(times[-1] - start, self.horizon))
            )
        history = np.zeros_like(rates)
        history[kept - 1 : kept] = state.history.ravel()
        begin = self._planned.advance(self.order, False, times, rates, kept, begin, state.impulse.reshape(-1), state.terms, history)
        held = min(len(times), KEPT)
        state.samples[:, KEPT - held :], state.times[KEPT - held :] = rates[-held:].T, times[-held:]
        state.history[...] = history[-1].reshape(shape)
        state.counters[:] = count + len(rates) - kept, begin - (len(times) - held), start
        return history[kept:].reshape(len(history) - kept, *shape)

    def tail(self, state: UnevenState, t: float) -> Any:
        """The part of H at the next time t (s) that does not depend on the sample there, shape of one sample: H = tail + local·g. Errors as `push`."""
        self._own(state)
        return self.run(UnevenState(*(array.copy() for array in state)), np.zeros((1, *state.history.shape)), [_validate.number("t", t)])[0]

    def local(self, state: UnevenState, t: float) -> float:
        """The factor, s^(1/2), of the sample at the next time t (s) in H there. Errors as `push`."""
        self._own(state)
        alone = self.start()._replace(times=state.times.copy(), counters=state.counters.copy())
        return float(self.run(alone, [1.0], [_validate.number("t", t)])[0])

    def jump(self, state: UnevenState, delta: ArrayLike) -> None:
        """Remember a jump of f at the newest sample, in place: it adds delta·K from the next one on.

        Where the rate jumps too, push its new value next, at the same time: no polynomial straddles the jump then. ValueError, TypeError if there is no sample
        yet, a shape is wrong or a number is not finite.
        """
        self._own(state)
        if not state.counters[0]:
            raise ValueError("jump needs a first sample: push it before the jump, got an empty state")
        state.impulse[:, 0] += sample_of("delta", delta, state.history.shape, number=True).ravel()

    @property
    def _widths(self) -> dict[str, int]:
        return {"samples": KEPT, "terms": len(self.tail_sum), "impulse": 1}

    def _own(self, state: UnevenState) -> None:
        owned(state, UnevenState, self._widths)
        if state.times.shape != (KEPT,) or state.counters.shape != (3,):
            raise ValueError(f"state must belong to this plan: state.times and state.counters must have the shapes {(KEPT,)} and (3,)")


def trajectory(t: Floats, g: Floats, order: int, rtol: float, kernel: Kernel, slip: bool, leaps: Floats) -> Floats:
    """H at all nodes for samples (nodes, components) at rising times from 0 on, without what is infinite at a jump; arguments as `pieces`."""
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    history = np.zeros_like(g)
    if not len(steps):
        return history
    far = halved(float(t[-1]), up=True)
    found = planned(kernel, rtol, halved(float(steps.min()), up=False), far)
    found.advance(order, slip, t, g, 1, 0, leaps[0].copy(), np.zeros((g.shape[1], len(found.tail))), history)
    shorter = np.flatnonzero((np.diff(t) < found.tail.near) & (np.diff(t) > 0.0)) + 1
    if len(shorter):  # K beyond the newest panel
        made = pieces(t, g, order, slip, leaps)
        for n in shorter:
            history[n] = at_node(made, int(n), kernel)
            if n + 1 < len(t) and t[n + 1] == t[n]:
                history[n + 1] = history[n]
    return history
