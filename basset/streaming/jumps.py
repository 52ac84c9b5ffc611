"""Jumps of the signal in a stream: their contributions to coming nodes, and the end of a smooth segment."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import Floats, gauss_legendre
from basset.streaming.state import State, sample_of
from basset.weights.polynomials import GAUSS, lagrange, panel_basis

if TYPE_CHECKING:
    from basset.streaming.plan import Plan


def remember(plan: Plan, state: State, delta: ArrayLike, age: float, g: ArrayLike | None) -> None:
    """Does the work of `Plan.jump`."""
    shape = state.history.shape
    delta = sample_of("delta", delta, shape, number=True)
    age = _validate.non_negative("age", age, "seconds")
    node = int(state.counters[1])
    if node == 0:
        raise ValueError("jump needs a first sample: push it before the jump, got an empty state")
    if g is not None:
        g = sample_of("g", g, shape)
        if age > plan.dt * (1.0 + 1e-12):
            raise ValueError("age must not exceed the step dt = {} seconds where g is given, got {}".format(*_validate.apart(plan.dt, age)))
    lag = age / plan.dt
    oldest = oldest_jump(plan, node)
    if lag > oldest * (1.0 + 1e-12):
        most, came = _validate.apart(oldest * plan.dt, age)
        raise ValueError(f"age must be at most {most} seconds here: the memory begins one step before the first sample, got {came}")
    if g is not None and plan.recipe.degree:
        end_segment(plan, state, min(lag, 1.0), g.ravel())
    elif g is not None and lag == 0.0:
        average_newest(plan, state, g.ravel())
    impulse = delta.ravel()[:, None] / math.sqrt(plan.dt)
    if len(plan.rates):
        state.terms[...] += impulse * plan.tail_weights * np.exp(-plan.rates * lag)
    add_future(plan, state, impulse * excess(plan, lag + np.arange(1.0, coming_nodes(plan, state) + 1.0)))
    if lag > 0.0:
        now = float(excess(plan, np.array([lag]))[0])
        state.history[...] += (impulse[:, 0] * (now + float(sum_at(plan, np.array([lag]))[0]))).reshape(state.history.shape)
        state.future[:, (node - 1) % plan.ring] += impulse[:, 0] * now


def oldest_jump(plan: Plan, node: int) -> float:
    """How many steps before the newest node a jump may lie, so that its lag stays within the tail up to the horizon."""
    if plan.tail_sum is None or plan.steps is None:
        return float(node)
    return node - 1.0 + min(1.0, max(0.0, plan.tail_sum.far / plan.dt - plan.steps))


def add_future(plan: Plan, state: State, values: Floats) -> None:
    """Add values (components, count) to the coming nodes."""
    node, count = int(state.counters[1]), values.shape[1]
    slots = (node + np.arange(count)) % plan.ring
    state.future[:, slots] += values
    state.counters[2] = max(state.counters[2], count)


def average_newest(plan: Plan, state: State, g: Floats) -> None:
    """Put the mean of both rates at the newest node."""
    position = (int(state.counters[0]) - 1) % plan.tables.slots
    mean = 0.5 * (state.samples[:, position] + g)
    state.samples[:, position :: plan.tables.slots] = mean[:, None]


def end_segment(plan: Plan, state: State, lag: float, g: Floats) -> None:
    """Turn the current segment into future contributions and start a new one with sample `g` at the newest node.

    `lag` (in steps, 0 to 1) is the distance of the jump from the newest node.
    """
    n, node = int(state.counters[0]) - 1, int(state.counters[1])
    held = min(n + 1, plan.tables.slots)
    lags = np.arange(held)
    newest_first = state.samples[:, (n - lags) % plan.tables.slots]
    root, x_w = math.sqrt(plan.dt), gauss_legendre(GAUSS)
    steady = plan.tail_sum is not None and n >= plan.tables.steady
    if steady:  # from fixed weights and gains back to whole exponentials
        assert plan.recipe.window is not None
        start, degree = plan.recipe.window - plan.recipe.degree // 2, plan.recipe.degree
        state.terms[...] += newest_first[:, start : start + degree] @ plan.fixed_terms.T
    shift = 1 if lag > 0.0 and n > 0 else 0  # the newest sample belongs to what comes after the jump
    old = newest_first[:, shift:]
    last = n - shift  # panels of the finished segment
    panels = min(last, plan.recipe.window - shift) if plan.recipe.window is not None and (steady or plan.tail_sum is None) else last
    degree = min(plan.recipe.degree, last)
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
    ahead = coming_nodes(plan, state)
    future = np.zeros((len(old), ahead))
    for q, x in enumerate(x_w[0]):
        values = excess(plan, shift + x + np.arange(ahead + panels + 1.0))
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
            future += piece[:, q, None] * excess(plan, distance + coming)
    everything = [*pieces, ((shift + np.arange(panels)[:, None] + x_w[0]).ravel(), weighted.reshape(len(old), max(panels, 0) * GAUSS))]
    for s, piece in everything:
        state.terms[...] += root * (piece @ np.exp(-s[:, None] * plan.rates)) * plan.tail_weights
    if lag > 0.0:  # H at the newest node, without a straddling polynomial
        w = plan.unit.rule(0.0, lag)[1]
        s = lag * x_w[0]
        value = rate * (w.sum() - lag * x_w[1] @ sum_at(plan, s))
        if shift and lag < 1.0:  # K may be steep where the finished segment ends
            x, w = plan.unit.rule(lag, 1.0)
            near, piece = pieces[0]
            stencil = lagrange(np.arange(degree + 1.0), lag + (1.0 - lag) * x - 1.0)[0]
            value = value + old[:, : degree + 1] @ (w @ stencil) - piece @ sum_at(plan, near)
        value = value + everything[-1][1] @ excess(plan, everything[-1][0])
        newest = (node - 1) % plan.ring
        state.future[:, newest] += root * value  # kept for a further jump in this step
        value = state.future[:, newest] + state.terms.sum(axis=1)
        state.history[...] = value.reshape(state.history.shape)
    add_future(plan, state, root * future)
    state.samples[:, :] = 0.0
    state.samples[:, 0 :: plan.tables.slots] = g[:, None]
    state.counters[0] = 1.0


def coming_nodes(plan: Plan, state: State) -> int:
    """How many coming nodes can have an entry in the ring."""
    if plan.recipe.window is None:
        return plan.tables.slots - int(state.counters[1])
    return plan.recipe.window


def excess(plan: Plan, lag: Floats) -> Floats:
    """What the ring holds of the unit-step kernel: K beyond the exponentials, up to the window's end."""
    if plan.recipe.window is None:
        return plan.unit._values(lag)
    beyond = plan.recipe.window * (1.0 + 1e-12 if plan.tail_sum is None else 1.0 - 1e-12)
    inside = lag < beyond
    result = np.zeros_like(lag)
    result[inside] = plan.unit._values(lag[inside])
    result[inside] -= sum_at(plan, lag[inside])
    return result


def sum_at(plan: Plan, lag: Floats) -> Floats:
    """The unit-step sum of exponentials."""
    return np.asarray(np.exp(-lag[:, None] * plan.rates) @ plan.tail_weights)
