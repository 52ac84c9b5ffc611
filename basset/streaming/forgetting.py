"""A memory of so many jumps only: the window T_back of Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513, which they count in jumps.

The history is linear: what came before a jump, copied there and continued without samples, is what has to be subtracted later.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from basset.kernels import Floats
from basset.streaming.following import FollowingPlan, SlipStream, rest
from basset.streaming.plan import Plan
from basset.streaming.state import State


class JumpWindow:
    """The last `count` jumps of a stream at its nodes; each forgets what came before the oldest of those before it.

    A rule of first order or less has no segments: its samples before that jump are dropped, and it begins anew there. Over the whole past
    with segments, or with exponentials, a copy of the memory is kept for every jump; a window of time besides is not allowed for.

    >>> import basset
    >>> plan = basset.SemiDerivative().plan(0.1, 1.0)
    >>> state, window = plan.start(1), JumpWindow(plan, 1)
    >>> plan.push(state, [1.0])
    >>> window.begin(state, np.zeros(1))
    >>> for _ in range(2):
    ...     _ = plan.run(state, np.ones((4, 1)))
    ...     window.jump(state, np.zeros(1), np.ones(1))
    >>> bool(np.isclose(plan.tail(state)[0], basset.SemiDerivative().weights(5, 0.1)[1:].sum()))
    True
    """

    def __init__(self, plan: Any, count: int) -> None:
        self.plan, self.count = plan, count
        self.kept: list[Any] = []

    def begin(self, state: Any, delta: Floats) -> None:
        """Nothing came before the first sample, where f jumps by `delta`, which is passed to the plan."""
        self.kept.clear()
        if not isinstance(state, SlipStream) and not self.plan.recipe.degree:
            self.kept.append((int(state.counters[1]), delta.copy(), delta))

    def jump(self, state: Any, delta: Floats, g: Floats, slip: Floats | None = None) -> None:
        """As the plan's own, with rate `g` and slip `slip` after the jump."""
        if isinstance(state, SlipStream):
            self._slip(state, delta, g, slip)
        elif self.plan.recipe.degree:
            self._segments(state, delta, g)
        else:
            self._samples(state, delta, g)

    def _samples(self, state: State, delta: Floats, g: Floats) -> None:
        plan, node = self.plan, int(state.counters[1])
        plan.jump(state, delta, g=g)
        self.kept.append((node, delta.copy(), g.copy()))
        if len(self.kept) > self.count + 1:
            first, gone, _ = self.kept.pop(0)
            plan.jump(state, -gone, age=(node - first) * plan.dt)
            first, _, rate = self.kept[0]
            count = node - first + 1
            begin = int(state.counters[0]) - count
            state.samples[:, :count] = state.samples[:, begin : begin + count].copy()
            state.samples[:, count:] = 0.0
            state.samples[:, 0], state.counters[0] = rate, count

    def _segments(self, state: State, delta: Floats, g: Floats) -> None:
        plan = self.plan
        plan.jump(state, np.zeros_like(delta), g=g)
        oldest = self.kept.pop(0) if len(self.kept) == self.count else None
        self._take_out(oldest, state, _led_on_segments)
        self.kept.append(State(*(array.copy() for array in state)))
        plan.jump(state, delta)

    def _slip(self, state: SlipStream, delta: Floats, g: Floats, slip: Floats | None) -> None:
        plan: FollowingPlan = self.plan
        oldest = self.kept.pop(0) if len(self.kept) == self.count else None
        self._take_out(oldest, state, _led_on_slip)
        copies: Any = {name: array.copy() for name, array in zip(state._fields[:-1], state[:-1], strict=True)}
        before = state._replace(**copies)
        before.samples[:, int(state.counters[0] - 1) % plan.ring] *= 0.5  # of the mean of both rates there
        self.kept.append(before)
        assert slip is not None
        plan.jump(state, delta, slip, g)

    def _take_out(self, oldest: Any, state: Any, led_on: Any) -> None:
        """Take what came before the oldest jump out of all that came after it."""
        if oldest is None:
            return
        for later in (*self.kept, state):
            for array, gone in led_on(self.plan, oldest, later):
                np.subtract(array, gone, out=array)


def _led_on_segments(plan: Plan, oldest: State, later: State) -> list[tuple[Floats, Floats]]:
    now, node = int(oldest.counters[1]), int(later.counters[1])
    oldest.terms[...] *= np.exp(-plan.rates * (node - now))
    if node - now >= plan.ring:
        oldest.future[...] = 0.0
    else:
        oldest.future[:, np.arange(now, node) % plan.ring] = 0.0
    oldest.counters[1] = node
    return [(later.terms, oldest.terms), (later.future, oldest.future)]


def _led_on_slip(plan: FollowingPlan, oldest: SlipStream, later: SlipStream) -> list[tuple[Floats, Floats]]:
    rest(oldest, int(later.counters[0] - oldest.counters[0]))
    return [(later.samples, oldest.samples), (later.impulses, oldest.impulses), (later.terms, oldest.terms)]
