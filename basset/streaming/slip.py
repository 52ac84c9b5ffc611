"""Finite-Reynolds kernels with a slip that varies: the history is no convolution then; two ways to evaluate it.

H(t) = Σ_j Δ_j K(t − t_j; U) + ∫ K(t − τ; U) g(τ) dτ with the Mei–Adrian family's K(s; U). The literature is ambiguous
whether U is the slip at t or at τ; both are offered.

* A recipe without a sum of exponentials: the direct sum, with the weights of the kernel of each slip. The reference: exact
  weights, a fraction of a millisecond per sample and distinct slip.
* A recipe with one, such as Exponential's: the newest panels in the same way, all older ones by exponentials with fixed decay
  rates and weights that follow the slip at t (`basset.spectrum`; `basset.solve` does the same): constant memory, and the promised
  error against the direct sum, down to some 1e-11.

Outside their validity (flow reversal, a sphere that nearly stops) the kernels' s^(-2) tail is too fast (Lawrence & Mei 1995):
slips below the kernel's range are taken at its end, and counted.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset._compile import placed
from basset.exponentials import ExponentialSum
from basset.kernels import Floats, MeiAdrianKernel, VaryingSlipKernel, gauss_legendre
from basset.spectrum import SlipTable, grid_of, pieces_between, slip_table
from basset.streaming.state import beyond, block_of, owned, sample_of, shaped
from basset.weights.lagrange import lagrange
from basset.weights.table import Recipe, Stencil, WeightTable


class VaryingState(NamedTuple):
    """What a stream with varying slip remembers: float64 arrays only, newest first along the second axis."""

    samples: Floats  # (components, lags), rates at the newest nodes, unit of f per second
    impulses: Floats  # (components, lags), jumps of f there, over dt
    memory: Floats  # (components, …), unit of H: exponentials without their weights, or contributions of earlier samples to coming nodes (slip at τ)
    steepness: Floats  # (components,), C at the newest node, in units of dt^(-3/2)
    history: Floats  # shape of one sample: H at the newest node
    counters: Floats  # (2,): nodes so far; slips outside the kernel's range


class VaryingPlan:
    """Base of the two evaluations: the methods of `basset.streaming.Plan`, with the slip beside every sample.

    `slip` (m/s, 0 or greater) is the magnitude of the slip velocity: a number, one per grain (shape of a sample without its last axis),
    or the shape of a sample; in `run` with the steps as first axis. Jumps are at nodes; a jump of the rate (`g`) is averaged there (first order).
    Errors as of `Plan`: the state is then unchanged.

    >>> import basset
    >>> kernel = VaryingSlipKernel(1e-3, 1e-6, (1e-3, 1.0))
    >>> plan = basset.Daitche(1).plan(0.1, 1.0, kernel)
    >>> H = plan.run(plan.start(), [1.0, 1.0, 1.0], slip=[0.01, 0.01, 0.01])  # a steady slip: as with its own kernel
    >>> bool(np.isclose(H[-1], basset.integrate(np.ones(3), 0.1, basset.Daitche(1), kernel=kernel.at(0.01))))
    True
    """

    _widths: tuple[int, int]  # lags and memory kept per component

    def __init__(self, recipe: Recipe, dt: float, steps: int, kernel: VaryingSlipKernel) -> None:
        self.recipe, self.dt, self.steps, self.kernel = recipe, dt, steps, kernel

    def __reduce__(self) -> tuple[Any, ...]:
        return plan, (self.recipe, self.dt, self.steps, self.kernel)  # a copy has its own addresses for compiled code

    def _advance(self, state: VaryingState, rates: Floats, steepnesses: Floats) -> Floats:
        """H at every row of rates (steps, components); `steepnesses` are C in units of dt^(-3/2)."""
        raise NotImplementedError

    def start(self, shape: tuple[int, ...] | int = ()) -> VaryingState:
        """An empty state for samples of that shape."""
        shape, n = shaped(shape)
        lags, memory = self._widths
        return VaryingState(np.zeros((n, lags)), np.zeros((n, lags)), np.zeros((n, memory)), np.zeros(n), np.zeros(shape), np.zeros(2))

    def run(self, state: VaryingState, G: ArrayLike, slip: ArrayLike) -> Floats:
        """Accept a block of rates (steps, *shape) with the slips at the same nodes, in place; H (steps, *shape) at each."""
        shape = state.history.shape
        rates = block_of(G, shape)
        lags, memory = self._widths
        owned(state, VaryingState, {"samples": lags, "impulses": lags, "memory": memory})
        node, steps = int(state.counters[0]), len(rates)
        if node + steps > self.steps + 1:
            raise beyond(self.steps, self.dt, node + steps - 1)
        slips = _validate.real_array("slip", slip)
        if slips.ndim == 0 or len(slips) != steps or slips.shape[1:] not in ((), shape[:-1], shape):
            raise ValueError(f"slip must have the shape ({steps},), {(steps, *shape[:-1])} or {(steps, *shape)}, got {slips.shape}")
        for name, values in (("G", rates), ("slip", slips)):
            if not np.isfinite(values).all():
                raise ValueError(f"{name} must be finite, got {values[~np.isfinite(values)][0]}")
        if steps and slips.min() < 0.0:
            raise ValueError(f"slip must be 0 or greater (m/s), got {slips.min():g}")
        slips = slips.reshape(slips.shape + (1,) * (1 + len(shape) - slips.ndim))
        low, high = self.kernel.slip_range
        slips = np.broadcast_to(slips, rates.shape)
        inside = np.clip(slips, low, high)
        steepnesses = (self.kernel.steepness(inside) * self.dt**1.5).reshape(steps, -1)
        history = self._advance(state, np.ascontiguousarray(rates.reshape(steps, -1)), np.ascontiguousarray(steepnesses)).reshape(steps, *shape)
        if steps:
            state.history[...], state.steepness[:] = history[-1], steepnesses[-1]
        state.counters[:] += np.array([steps, np.count_nonzero(inside != slips)])
        return history

    def push(self, state: VaryingState, g: ArrayLike, slip: ArrayLike) -> None:
        """Accept the next rate and the slip there, in place."""
        self.run(state, _validate.real_array("g", g)[None], _validate.real_array("slip", slip)[None])

    def value(self, state: VaryingState, slip: ArrayLike | None = None) -> Any:
        """H at the newest node, of the slip that was given with its sample (`slip` need not be repeated); 0 after the first push."""
        return state.history.copy() if state.history.ndim else float(state.history)

    def tail(self, state: VaryingState, slip: ArrayLike) -> Any:
        """H at the next node for a next rate of zero and that slip; the state is not changed."""
        return self._next(state, 0.0, slip)

    def _next(self, state: VaryingState, rate: float, slip: ArrayLike) -> Any:
        """H at the next node if every rate there is `rate`."""
        probe = VaryingState(*(array.copy() for array in state))
        self.push(probe, np.full(state.history.shape, rate), slip)
        return self.value(probe)

    def local(self, state: VaryingState, slip: ArrayLike) -> Any:
        """The factor of the next rate in H at the next node, for that slip, in s^(1/2): H = tail + local·g, shape of one sample."""
        return self._next(state, 1.0, slip) - self._next(state, 0.0, slip)

    def jump(self, state: VaryingState, delta: ArrayLike, age: float = 0.0, g: ArrayLike | None = None) -> None:
        """Remember a jump of f at the newest node, in place: it adds delta·K from the next node on; g as in `Plan.jump`, age 0 only."""
        if _validate.non_negative("age", age, "seconds") > 0.0:
            raise ValueError(f"age must be 0 for a kernel whose slip varies (jumps are at nodes), got {age:g}")
        if not state.counters[0]:
            raise ValueError("jump needs a first sample: push it before the jump, got an empty state")
        for name, value in (("delta", delta), ("g", g)):
            if value is None:
                continue
            column = sample_of(name, value, state.history.shape, number=True).ravel()
            if name == "delta":
                self._impulse(state, column)
            else:
                self._replace_newest(state, 0.5 * (state.samples[:, 0] + column))

    def _impulse(self, state: VaryingState, delta: Floats) -> None:
        state.impulses[:, 0] += delta / self.dt  # in units of rate × step

    def _replace_newest(self, state: VaryingState, rate: Floats) -> None:
        state.samples[:, 0] = rate

    def outside(self, state: VaryingState) -> int:
        """How many slips so far lay outside the kernel's range."""
        return int(state.counters[1])


class DirectPlan(VaryingPlan):
    """The direct sum over the window (or the whole history) with exact weights for every slip."""

    def __init__(self, recipe: Recipe, dt: float, steps: int, kernel: VaryingSlipKernel) -> None:
        super().__init__(recipe, dt, steps, kernel)
        self._window = recipe.used(steps)
        self._widths = self._window + 1, self._window + 1 if kernel.slip_at == "tau" else 0

    def _table(self, steepness: float) -> WeightTable:
        return _slip_table(self.recipe.stencil, steepness, self.kernel.c1)

    def _advance(self, state: VaryingState, rates: Floats, steepnesses: Floats) -> Floats:
        history = np.zeros_like(rates)
        root, node = math.sqrt(self.dt), int(state.counters[0])
        for step, (row, steepness) in enumerate(zip(rates, steepnesses, strict=True)):
            n = node + step
            state.samples[:, 1:] = state.samples[:, :-1].copy()
            state.impulses[:, 1:] = state.impulses[:, :-1].copy()
            state.samples[:, 0], state.impulses[:, 0] = row, 0.0
            used = min(n, self._window)
            if self.kernel.slip_at == "tau":
                history[step] = self._scattered(state, n, row, steepness)
            elif used:
                for c in range(len(row)):
                    weights = np.concatenate(self._table(float(steepness[c])).row(used))[::-1]
                    history[step, c] = weights @ state.samples[c, : used + 1] + self._jumps(state.impulses[c, 1 : used + 1], float(steepness[c]))
            history[step] *= root
        return history

    def _jumps(self, impulses: Floats, steepness: float) -> float:
        lags = np.flatnonzero(impulses) + 1.0
        return float(_unit_kernel(steepness, self.kernel.c1)._values(lags) @ impulses[impulses != 0.0]) if len(lags) else 0.0

    def _scattered(self, state: VaryingState, n: int, row: Floats, steepness: Floats) -> Floats:
        """Add this sample's contribution to every future node (slip at τ: its weights no longer change)."""
        width = self._window + 1
        slots = (n + np.arange(width)) % width
        state.memory[:, (n - 1) % width] = 0.0
        for c, rate in enumerate(row):
            state.memory[c, slots] += rate * self._column(n, float(steepness[c]))
        return np.asarray(state.memory[:, n % width]) if n else np.zeros(len(row))

    def _column(self, i: int, steepness: float) -> Floats:
        """Weights of sample i at nodes i … i + window."""
        stencil, table, window = self.recipe.stencil, self._table(steepness), self._window
        result = table.interior(window + 1)[::-1].copy()
        nodes = i + np.arange(window + 1)
        early = nodes[nodes < min(stencil.first, window + 1)]
        for n in early:
            result[n - i] = table.row(n)[0][i] if n else 0.0
        if i < stencil.reach:
            rows = nodes[(nodes >= stencil.first) & (nodes <= window)]
            if len(rows):
                result[rows - i] = stencil.oldest(rows, table._kernel, "rate")[:, i]
        edge = np.concatenate(table.row(window))[::-1]
        full = nodes >= max(window, 1)
        result[full] = edge[full]
        return result

    def _impulse(self, state: VaryingState, delta: Floats) -> None:
        super()._impulse(state, delta)
        if self.kernel.slip_at == "tau":
            width, n = self._window + 1, int(state.counters[0]) - 1
            lags = np.arange(1, width)
            for c, steepness in enumerate(state.steepness):
                state.memory[c, (n + lags) % width] += delta[c] / self.dt * _unit_kernel(float(steepness), self.kernel.c1)._values(lags.astype(float))

    def _replace_newest(self, state: VaryingState, rate: Floats) -> None:
        if self.kernel.slip_at == "tau":
            n, width = int(state.counters[0]) - 1, self._window + 1
            slots = (n + np.arange(width)) % width
            for c, change in enumerate(rate - state.samples[:, 0]):
                state.memory[c, slots] += change * self._column(n, float(state.steepness[c]))
        super()._replace_newest(state, rate)


class Memory(NamedTuple):
    """What `_loops.follow_slip` reads, for a unit step; samples newest first.

    `entering` (2, terms, degree+1) is what samples 1 … degree+1 add to the exponentials: once all start-up panels leave the window, and at every
    later node. `local` has a row for sample j at start-up node n, (n−1)·(degree+1) + j; the last is for all later nodes.
    """

    c1: float  # of the kernel
    root: float  # √dt
    loss: Floats  # (terms,), 1 − exp(−λ)
    reached: Floats  # (terms,), exp(−λ·window), of a jump that leaves the window
    entering: Floats
    tail: SlipTable  # weights of the exponentials
    local: SlipTable  # weights of the window


class SumPlan(VaryingPlan):
    """A sum of exponentials (`tail_sum`, for the Basset kernel) whose weights follow the slip, beyond a window with the kernel of the slip at t."""

    def __init__(self, recipe: Recipe, tail: ExponentialSum, dt: float, steps: int, kernel: VaryingSlipKernel) -> None:
        super().__init__(recipe, dt, steps, kernel)
        if kernel.slip_at != "t":
            raise ValueError(f"slip_at must be 't' for a sum of exponentials, got {kernel.slip_at!r}: take a rule without one, such as basset.Daitche")
        degree, window, fine = recipe.degree, recipe.window, (tail.rtol or 0.0) < 1e-8
        if not degree or window != degree // 2 + 1:
            raise ValueError(f"window must be {degree // 2 + 1} steps beside a sum of exponentials and a slip that varies, got {window}")
        reach, log_step = max(self.steps, 2 * window) * self.dt, math.log(self.dt)
        low, high = (float(log_stretch) for log_stretch in _log_stretches(kernel.steepness(np.array(kernel.slip_range)) * self.dt**1.5))
        self.tail_sum = tail
        table, rates = slip_table(tail, kernel.c1, reach, fine), tail.rates * self.dt
        following = table._replace(weights=table.weights * math.sqrt(self.dt), log_rates=table.log_rates + log_step, values=table.values.copy())
        x, w = gauss_legendre(64)
        decayed = np.exp(-rates[:, None] * x) * w
        panels = [np.exp(-rates[:, None] * k) * (decayed @ lagrange(np.arange(1.0, degree + 2.0), k + x)[0]) for k in range(window, degree + 1)]
        entering = np.stack([np.sum(panels, axis=0), panels[0]])
        local = _local(degree, kernel.c1, low, high, fine)
        self._memory = placed(Memory(kernel.c1, math.sqrt(self.dt), -np.expm1(-rates), np.exp(-rates * window), entering, following, local))
        self._widths = degree + 2, len(tail)

    def _advance(self, state: VaryingState, rates: Floats, steepnesses: Floats) -> Floats:
        from basset.streaming import _loops

        history, room = np.empty_like(rates), np.empty((2, max(self._widths)))
        _loops.follow_slip(self._memory, state.samples, state.impulses, state.memory, int(state.counters[0]), rates, _log_stretches(steepnesses), history, room)
        return history


def _log_stretches(steepnesses: Floats) -> Floats:
    """Ln C^(2/3)."""
    return np.asarray(2.0 / 3.0 * np.log(np.maximum(steepnesses, 1e-300)))


@lru_cache(maxsize=32)
def _local(degree: int, c1: float, low: float, high: float, fine: bool) -> SlipTable:
    """Weights of the newest samples for ln C^(2/3) between `low` and `high`, see `Memory`; as ratios to Basset's, with which the grid ends.

    Any slip in the range lies on the grid or has Basset's weights.
    """
    # panels that shrink towards s = 0, down to 1e-18 of the whole, and one for each later step
    levels = 125 + max(0, math.ceil(high / math.log(2.0)))
    edges = np.concatenate([[0.0], 2.0 ** -np.arange(float(levels))[::-1], np.arange(2.0, degree + 2.0)])
    x, w = gauss_legendre(20)
    s = (edges[:-1, None] + np.diff(edges)[:, None] * x).ravel()
    weighted = (np.diff(edges)[:, None] * w).ravel() / np.sqrt(s)
    rows = np.zeros((degree + 1, degree + 1, len(s)))
    for n in range(1, degree + 2):
        count, end = min(n, degree) + 1, n if n <= degree else degree // 2 + 1
        rows[n - 1, :count] = np.where(s < end, weighted, 0.0) * lagrange(np.arange(float(count)), s)[0].T
    sums, (step, reach) = rows.reshape(-1, len(s)), grid_of(c1, fine)
    basset, (begin, points, coefficients) = np.asarray(sums.sum(axis=1)), pieces_between(low, high, step, reach)
    ratios = (1.0 + np.exp(-1.5 / c1 * (points[..., None] - np.log(s)))) ** -c1 @ sums.T / np.where(basset == 0.0, 1.0, basset)
    return SlipTable(basset, np.zeros(0), begin, 1.0 / step, np.ascontiguousarray(np.moveaxis(ratios, -1, 0) @ coefficients))


def _unit_kernel(steepness: float, c1: float) -> MeiAdrianKernel:
    """A kernel with steepness `steepness` (c2 = 0: then C = √π/2 (U/0.75)³ at unit viscosity)."""
    return MeiAdrianKernel(0.75 * (2.0 * steepness / math.sqrt(math.pi)) ** (1.0 / 3.0), 1.0, 1.0, c1, 0.0)


@lru_cache(maxsize=64)
def _slip_table(stencil: Stencil, steepness: float, c1: float) -> WeightTable:
    """Weights for C = `steepness` in units of dt^(-3/2), which is all that matters of slip, diameter and viscosity."""
    return WeightTable(stencil, _unit_kernel(steepness, c1), "rate")


def plan(recipe: Recipe, dt: float, steps: int, kernel: VaryingSlipKernel) -> VaryingPlan:
    """The stream of a recipe for a slip that varies."""
    if recipe.tail is None:
        return DirectPlan(recipe, dt, steps, kernel)
    return SumPlan(recipe, recipe.tail, dt, steps, kernel)
