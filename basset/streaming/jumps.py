"""Jumps of the signal in a stream: their contributions to coming nodes, and the end of a smooth segment."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.exponentials import ExponentialSum
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.streaming.state import State, Tables, sample_of
from basset.weights import Recipe
from basset.weights.lagrange import GAUSS, lagrange, panel_basis


class WithJumps:
    """What a jump needs of a plan, and does to a state of it."""

    dt: float
    recipe: Recipe
    unit: Kernel  # in steps
    tail_sum: ExponentialSum | None
    steps: int | None
    ring: int
    rates: Floats  # per step
    tail_weights: Floats  # of the unit-step kernel
    fixed_terms: Floats  # what the fixed weights already hold of each exponential
    tables: Tables

    def _take_jump(self, state: State, delta: ArrayLike, age: float, g: ArrayLike | None) -> None:
        """Do what `jump` does, after its checks of the state."""
        shape = state.history.shape
        delta = sample_of("delta", delta, shape, number=True)
        age = _validate.non_negative("age", age, "seconds")
        node = int(state.counters[1])
        if node == 0:
            raise ValueError("jump needs a first sample: push it before the jump, got an empty state")
        if g is not None:
            g = sample_of("g", g, shape)
            if age > self.dt * (1.0 + 1e-12):
                raise ValueError("age must not exceed the step dt = {} seconds where g is given, got {}".format(*_validate.apart(self.dt, age)))
        lag = age / self.dt
        oldest = self._oldest_jump(node)
        if lag > oldest * (1.0 + 1e-12):
            most, came = _validate.apart(oldest * self.dt, age)
            raise ValueError(f"age must be at most {most} seconds here: the memory begins one step before the first sample, got {came}")
        if g is not None and self.recipe.degree:
            self._end_segment(state, min(lag, 1.0), g.ravel())
        elif g is not None and lag == 0.0:
            self._average_newest(state, g.ravel())
        impulse = delta.ravel()[:, None] / math.sqrt(self.dt)
        if len(self.rates):
            state.terms[...] += impulse * self.tail_weights * np.exp(-self.rates * lag)
        self._add_future(state, impulse * self._excess(lag + np.arange(1.0, self._coming_nodes(state) + 1.0)))
        if lag > 0.0:
            now = float(self._excess(np.array([lag]))[0])
            state.history[...] += (impulse[:, 0] * (now + float(self._sum_at(np.array([lag]))[0]))).reshape(state.history.shape)
            state.future[:, (node - 1) % self.ring] += impulse[:, 0] * now

    def _oldest_jump(self, node: int) -> float:
        """How many steps before the newest node a jump may lie, so that its lag stays within the tail up to the horizon."""
        if self.tail_sum is None or self.steps is None:
            return float(node)
        return node - 1.0 + min(1.0, max(0.0, self.tail_sum.far / self.dt - self.steps))

    def _add_future(self, state: State, values: Floats) -> None:
        """Add values (components, count) to the coming nodes."""
        node, count = int(state.counters[1]), values.shape[1]
        slots = (node + np.arange(count)) % self.ring
        state.future[:, slots] += values
        state.counters[2] = max(state.counters[2], count)

    def _average_newest(self, state: State, g: Floats) -> None:
        """Put the mean of both rates at the newest node."""
        position = (int(state.counters[0]) - 1) % self.tables.slots
        mean = 0.5 * (state.samples[:, position] + g)
        state.samples[:, position :: self.tables.slots] = mean[:, None]

    def _end_segment(self, state: State, lag: float, g: Floats) -> None:
        """Turn the current segment into future contributions and start a new one with sample `g` at the newest node.

        `lag` (in steps, 0 to 1) is the distance of the jump from the newest node.
        """
        n, node = int(state.counters[0]) - 1, int(state.counters[1])
        held = min(n + 1, self.tables.slots)
        lags = np.arange(held)
        newest_first = state.samples[:, (n - lags) % self.tables.slots]
        root, x_w = math.sqrt(self.dt), gauss_legendre(GAUSS)
        steady = self.tail_sum is not None and n >= self.tables.steady
        if steady:  # from fixed weights and gains back to whole exponentials
            assert self.recipe.window is not None
            start, degree = self.recipe.window - self.recipe.degree // 2, self.recipe.degree
            state.terms[...] += newest_first[:, start : start + degree] @ self.fixed_terms.T
        shift = 1 if lag > 0.0 and n > 0 else 0  # the newest sample belongs to what comes after the jump
        old = newest_first[:, shift:]
        last = n - shift  # panels of the finished segment
        panels = min(last, self.recipe.window - shift) if self.recipe.window is not None and (steady or self.tail_sum is None) else last
        degree = min(self.recipe.degree, last)
        pieces: list[tuple[Floats, Floats]] = []  # lags (q,), weighted rate (components, q)
        if shift and lag < 1.0:
            s = lag + (1.0 - lag) * x_w[0]
            stencil = lagrange(np.arange(degree + 1.0), s - 1.0)[0]
            pieces.append((s, (1.0 - lag) * x_w[1] * (old[:, : degree + 1] @ stencil.T)))
        again = n == 0 and node > 1  # a second jump in this step: so far the first one's rate was taken to last up to the node
        rate = g - state.samples[:, 0] if again else g
        if lag > 0.0:
            pieces.append((lag * x_w[0], lag * x_w[1] * rate[:, None]))
        if panels > 0:
            k = np.arange(panels)
            first = np.clip(k - degree // 2, 0, min(last, old.shape[1] - 1) - degree)
            rates = old[:, first[:, None] + np.arange(degree + 1)]
            weighted = np.einsum("ckj,kqj->ckq", rates, panel_basis(degree)[0][k - first], optimize=True) * x_w[1]
        else:
            weighted = np.zeros((len(old), 0, GAUSS))
        ahead = self._coming_nodes(state)
        future = np.zeros((len(old), ahead))
        for q, x in enumerate(x_w[0]):
            values = self._excess(shift + x + np.arange(ahead + panels + 1.0))
            if panels <= 64 or panels * ahead <= 1 << 12:
                for m in range(panels):
                    future += weighted[:, m, q, None] * values[m + 1 : m + 1 + ahead]
            elif ahead and panels:
                from scipy.signal import fftconvolve  # takes half a second to import

                convolved = fftconvolve(values[None, 1 : panels + ahead], weighted[:, ::-1, q], axes=1)
                future += convolved[:, panels - 1 : panels - 1 + ahead]
        coming = np.arange(1.0, ahead + 1.0)
        for s, piece in pieces:
            for q, distance in enumerate(s):
                future += piece[:, q, None] * self._excess(distance + coming)
        everything = [*pieces, ((shift + np.arange(panels)[:, None] + x_w[0]).ravel(), weighted.reshape(len(old), max(panels, 0) * GAUSS))]
        for s, piece in everything:
            state.terms[...] += root * (piece @ np.exp(-s[:, None] * self.rates)) * self.tail_weights
        if lag > 0.0:  # H at the newest node, without a straddling polynomial
            w = self.unit.rule(0.0, lag)[1]
            s = lag * x_w[0]
            value = rate * (w.sum() - lag * x_w[1] @ self._sum_at(s))
            if shift and lag < 1.0:  # K may be steep where the finished segment ends
                x, w = self.unit.rule(lag, 1.0)
                near, piece = pieces[0]
                stencil = lagrange(np.arange(degree + 1.0), lag + (1.0 - lag) * x - 1.0)[0]
                value = value + old[:, : degree + 1] @ (w @ stencil) - piece @ self._sum_at(near)
            value = value + everything[-1][1] @ self._excess(everything[-1][0])
            newest = (node - 1) % self.ring
            state.future[:, newest] += root * value  # kept for a further jump in this step
            value = state.future[:, newest] + state.terms.sum(axis=1)
            state.history[...] = value.reshape(state.history.shape)
        self._add_future(state, root * future)
        state.samples[:, :] = 0.0
        state.samples[:, 0 :: self.tables.slots] = g[:, None]
        state.counters[0] = 1.0

    def _coming_nodes(self, state: State) -> int:
        """How many coming nodes can have an entry in the ring."""
        if self.recipe.window is None:
            return self.tables.slots - int(state.counters[1])
        return self.recipe.window

    def _excess(self, lag: Floats) -> Floats:
        """What the ring holds of the unit-step kernel: K beyond the exponentials, up to the window's end."""
        if self.recipe.window is None:
            return self.unit._values(lag)
        beyond = self.recipe.window * (1.0 + 1e-12 if self.tail_sum is None else 1.0 - 1e-12)
        inside = lag < beyond
        result = np.zeros_like(lag)
        result[inside] = self.unit._values(lag[inside])
        result[inside] -= self._sum_at(lag[inside])
        return result

    def _sum_at(self, lag: Floats) -> Floats:
        """The unit-step sum of exponentials."""
        return np.asarray(np.exp(-lag[:, None] * self.rates) @ self.tail_weights)
