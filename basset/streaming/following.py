"""A memory whose kernel follows the slip, for any rule over the whole history or a window: what a compiled loop of fixed steps reads.

H(t) = Σ_j w_j(U) g_j with the weights of the rule for the kernel of the slip at t, or w_j(U_j) with the slip at τ. Weights of the newest
samples, and whole rows while there are few, are tabulated over ln C^(2/3). All older samples are in exponentials with fixed rates, whose
weights follow the slip (`basset.spectrum`): a rule is linear in its kernel, so its weights on e^(−λs) are v d^j with d = e^(−λ), apart
from the oldest few. Simpson's alternate: they are two geometric sequences, in d and in −d. A window takes out what leaves it.
This library.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from basset._compile import compiled, shared
from basset.exponentials import ExponentialSum
from basset.kernels import BassetKernel, Floats, Kernel, VaryingSlipKernel
from basset.spectrum import Following, following_sum, grid_of, log_stretch_of, pieces_between, ratio_at, slip_table, weight_ratio
from basset.streaming.slip import _unit_kernel
from basset.weights.table import Recipe, Stencil, WeightTable

EXACT = 1e-9  # relative error of the sum where the rule has none of its own
VANISHED = 1e-280
NOTHING = np.zeros((3, 0, 0, 0))


class Tables(NamedTuple):
    """Weights, for the step. Row n of `weights` and `values` is that of node n, the last one of all later nodes; `widths`: of each.

    A term loses `loss` of itself in a step, gains `gains` of the sample of lag `lag`, `arrives` of an impulse, and where there is a window
    `leaving` of the samples that leave it and `leaves` of an impulse; `begin`: of the samples of lag `lag` and older at node `first`, the
    first with terms.
    """

    following: Following
    at_tau: int
    log_step: float
    step: float
    widths: Floats
    weights: Floats  # (row, lag), of Basset's kernel
    low: float  # of ratios to them over −ln(C^(2/3) dt), as in `SlipTable`
    inverse_step: float
    values: Floats  # (row·lag, cell, 8)
    lag: int
    first: int
    window: int  # 0: none that the terms know of
    loss: Floats  # (term,)
    gains: Floats
    begin: Floats  # (term, sample), the oldest first
    leaving: Floats  # (term, sample), the newest first, the last just left
    arrives: Floats
    leaves: Floats


class SlipStream(NamedTuple):
    """The state and its tables; rings by node."""

    samples: Floats  # (components, ring), unit of f per second
    impulses: Floats  # (components, ring), jumps of f there
    stretches: Floats  # (ring,), ln C^(2/3), after the jump
    terms: Floats  # (components, terms), for the coming node
    history: Floats  # (components,), H at the newest node
    counters: Floats  # (1,), nodes so far
    coming: Floats  # (2,): ln C^(2/3) at the coming node, and the weight of its sample
    tables: Tables


@dataclass(frozen=True)
class Decay(Kernel):
    """e^(−λs): what a rule makes of one exponential."""

    rate: float

    references: ClassVar[tuple[str, ...]] = ()

    def _values(self, s: Floats) -> Floats:
        return np.asarray(np.exp(-self.rate * s))

    def _derivatives(self, s: Floats) -> Floats:
        return -self.rate * self._values(s)

    def scaled(self, dt: float) -> Decay:
        """With time in steps, but for the factor √dt."""
        return Decay(self.rate * dt)


@shared
def look_at(s: SlipStream, where: Any, states: Floats, tail: Floats) -> None:
    """H at the coming node for a next sample of zero and the slip of states[0], into `tail`; the weight of that sample into s.coming[1]."""
    tables, node, ring = s.tables, int(s.counters[0]), s.samples.shape[1]
    following = tables.following
    stretch = own = log_stretch_of(following, where, states, 0)
    row, most = min(node, len(tables.widths) - 1), tables.weights.shape[1]
    s.coming[0] = stretch
    for c in range(len(tail)):
        tail[c] = 0.0
    for j in range(int(tables.widths[row])):
        place = (node - j) % ring
        if tables.at_tau == 1 and j > 0:
            own = s.stretches[place]
        weight = tables.weights[row, j] * ratio_at(tables.low, tables.inverse_step, tables.values, row * most + j, -own - tables.log_step)
        if j == 0:
            s.coming[1] = weight
            continue
        for c in range(len(tail)):
            tail[c] += weight * s.samples[c, place]
            if s.impulses[c, place] != 0.0:
                lag = j * tables.step
                tail[c] += s.impulses[c, place] / math.sqrt(lag) * (1.0 + math.exp(1.5 / following.c1 * (own + math.log(lag)))) ** -following.c1
    count = len(following.log_rates)
    for q in range(len(tables.loss)):
        share = 1.0 if tables.at_tau == 1 else weight_ratio(following, q % count, stretch)
        for c in range(len(tail)):
            tail[c] += share * s.terms[c, q]


@shared
def enter(s: SlipStream, q: int, place: int, gain: float, arrives: float) -> None:
    """Let the sample and the impulse at a place into term q."""
    tables = s.tables
    if tables.at_tau == 1:
        share = weight_ratio(tables.following, q % len(tables.following.log_rates), s.stretches[place])
        gain, arrives = gain * share, arrives * share
    for c in range(len(s.samples)):
        s.terms[c, q] += gain * s.samples[c, place] + arrives * s.impulses[c, place]


@shared
def accept(s: SlipStream, sample: Floats, tail: Floats) -> None:
    """Take the next sample, after `look_at`; then the terms as they are at the node after it."""
    tables, node, ring = s.tables, int(s.counters[0]), s.samples.shape[1]
    place = node % ring
    for c in range(len(sample)):
        s.history[c] = tail[c] + s.coming[1] * sample[c]
        s.samples[c, place], s.impulses[c, place] = sample[c], 0.0
    s.stretches[place] = s.coming[0]
    node += 1
    s.counters[0] = node
    for q in range(len(tables.loss)):
        if node < tables.first:
            continue
        for c in range(len(sample)):
            s.terms[c, q] -= tables.loss[q] * s.terms[c, q]
        if node > tables.first:
            enter(s, q, (node - tables.lag) % ring, tables.gains[q], tables.arrives[q])
        else:
            decayed = tables.arrives[q]
            for i in range(tables.begin.shape[1] - 1, -1, -1):
                enter(s, q, i, tables.begin[q, i], decayed)
                decayed *= 1.0 - tables.loss[q]
        if 0 < tables.window < node:
            count = tables.leaving.shape[1]
            for i in range(count):
                enter(s, q, (node - (tables.window + 2 - count + i)) % ring, tables.leaving[q, i], tables.leaves[q] if i == count - 1 else 0.0)


@compiled()
def rest(s: SlipStream, steps: int) -> None:
    """Nothing happens in so many steps; H is not kept up."""
    none = np.zeros(len(s.samples))
    for _ in range(steps):
        accept(s, none, none)


class FollowingPlan:
    """A rule made ready to stream at fixed steps with a kernel that follows the slip; its arguments: `basset.quadrature.rule.slip_recipes`.

    A window before a fitted sum is part of that sum here: both follow the slip, to the smaller of `EXACT` and its error. ValueError if the sum is a
    published one, or none is exact enough.
    """

    def __init__(self, recipe: Recipe, whole: Recipe, dt: float, steps: int, kernel: VaryingSlipKernel) -> None:
        self.tables, self.ring = tables_of(*remembered(recipe, whole, dt, steps, kernel))

    def start(self, components: int) -> SlipStream:
        """An empty state."""
        rings = np.zeros((components, self.ring)), np.zeros((components, self.ring)), np.zeros(self.ring)
        return SlipStream(*rings, np.zeros((components, len(self.tables.loss))), np.zeros(components), np.zeros(1), np.zeros(2), self.tables)

    def push(self, state: SlipStream, g: Floats) -> None:
        """The first sample; H is 0 there."""
        for array in state[:-1]:
            array[...] = 0.0
        state.samples[:, 0], state.counters[0] = g, 1.0

    def jump(self, state: SlipStream, delta: Floats, slip: Floats, g: Floats | None = None) -> None:
        """Remember a jump of f at the newest node, where the slip then is `slip` (components,); rates there are averaged with `g`."""
        place = int(state.counters[0] - 1) % self.ring
        if g is not None:
            state.samples[:, place] = 0.5 * (state.samples[:, place] + g)
        state.impulses[:, place] += delta
        state.stretches[place] = log_stretch_of(self.tables.following, np.arange(len(slip)), slip[None], 0)


def remembered(
    recipe: Recipe, whole: Recipe, dt: float, steps: int, kernel: VaryingSlipKernel
) -> tuple[Stencil, int, int | None, float, float, int, VaryingSlipKernel]:
    """What the tables are made for; errors as `FollowingPlan`, nothing expensive is computed."""
    window, rtol = recipe.window, EXACT
    if recipe.tail is not None:
        if recipe.tail.rtol is None:
            raise ValueError("tail must be a fitted sum for a kernel that follows the slip: the published numbers are those of s^(-1/2)")
        window, rtol = None, recipe.tail.rtol
        if recipe.window != whole.degree // 2 + 1:
            rtol = min(rtol, EXACT)  # a window counts as exact
    exact_sum(dt, ((steps if window is None else window) + 2.0) * dt, rtol, kernel)
    return whole.stencil, max(1, whole.degree), window, rtol, dt, steps, kernel


@lru_cache(maxsize=64)
def exact_sum(near: float, horizon: float, rtol: float, kernel: VaryingSlipKernel) -> ExponentialSum:
    """`following_sum`, of a rule without one as exact as there is."""
    while True:
        try:
            return following_sum(near, horizon, rtol, kernel)
        except ValueError:
            if not EXACT <= rtol < 1e-5:
                raise
            rtol *= 10.0


@lru_cache(maxsize=32)
def tables_of(stencil: Stencil, degree: int, window: int | None, rtol: float, dt: float, steps: int, kernel: VaryingSlipKernel) -> tuple[Tables, int]:
    """The tables of a stencil, and how many nodes a state must keep."""
    lag = degree + 2  # from here on no panel of a sample touches the newest step
    first = max(stencil.first, lag + stencil.reach)
    limit = steps if window is None else window
    direct = limit < first + stencil.reach  # too short for exponentials
    last = limit if direct else first
    farthest, fine = (limit + 2.0) * dt, rtol < 1e-8
    tail = exact_sum(dt, farthest, rtol, kernel)
    table = slip_table(tail, kernel.c1, farthest, fine)
    slips = kernel.diameter / kernel.viscosity, 1.0 / kernel.viscosity, *kernel.slip_range  # C = ½√π (U/f)³ ν^(−3/2)
    following = Following(kernel.c1, kernel.c2, *slips, table.log_rates, table.low, table.inverse_step, table.values, NOTHING, 0.0, 0.0)
    low, high = 2.0 / 3.0 * np.log(kernel.steepness(np.array(kernel.slip_range))) + math.log(dt)
    near = rows_of(stencil, None if direct else lag, last, kernel.c1, float(low), float(high))
    count = 0 if direct else len(tail)
    rates, weights = tail.rates[:count] * dt, tail.weights[:count]
    loss, gains, begin, leaving = _terms(stencil, rates, lag, first, window, weights * dt)
    arrives, leaves = np.zeros((2, len(loss)))
    arrives[:count] = weights * np.exp(-rates * lag)
    if window is not None:
        leaves[:count] = -weights * np.exp(-rates * (window + 1.0))
    kept = 0 if direct or window is None else window
    made = Tables(
        following, int(kernel.slip_at == "tau"), math.log(dt), dt, near[0], near[1] * math.sqrt(dt), near[2], near[3], near[4],
        lag, first, kept, loss, gains, begin, leaving, arrives, leaves,
    )  # fmt: skip
    return made, max(last + 2, kept + 2)


@lru_cache(maxsize=64)
def rows_of(stencil: Stencil, lag: int | None, last: int, c1: float, low: float, high: float) -> tuple[Floats, Floats, float, float, Floats]:
    """(widths, Basset's weights, begin, inverse step, ratios) of the rows 0 … last for ln C^(2/3) between `low` and `high`, a unit step.

    The last is that of the newest `lag` samples where all are remembered otherwise; None: a whole row.
    """
    widths = np.array([0, *range(2, last + 1), last + 1 if lag is None else lag], dtype=np.float64)
    most, step, reach = int(widths.max()), 1.0, grid_of(c1, False)[1]  # K is analytic to π·2c1/3 off the real axis: 1.4e-10

    def rows(kernel: Kernel) -> Floats:
        weights, result = WeightTable(stencil, kernel, "rate"), np.zeros((last + 1, most))
        for n in range(1, last + (lag is None)):
            result[n, : n + 1] = np.concatenate(weights.row(n))[::-1]
        if lag is not None:
            result[last, :lag] = weights.interior(lag)[::-1]
        return result

    basset, (begin, points, coefficients) = rows(BassetKernel()), pieces_between(low, high, step, reach)
    found = np.stack([rows(_unit_kernel(math.exp(-1.5 * point), c1)) for point in points.ravel()]) / np.where(basset == 0.0, 1.0, basset)
    ratios = np.moveaxis(found.reshape(*points.shape, -1), -1, 0)  # (row·lag, cell, point)
    return widths, basset, begin, 1.0 / step, np.ascontiguousarray(ratios @ coefficients)


def _terms(stencil: Stencil, rates: Floats, lag: int, first: int, window: int | None, amplitude: Floats) -> tuple[Floats, ...]:
    """(loss, gains, begin, leaving) of the exponentials, times `amplitude`."""
    reach, edge = stencil.reach, np.zeros((len(rates), 0))
    if not len(rates):
        return np.zeros(0), np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    inner = np.array([stencil.interior(lag, lag + 2, Decay(rate), "rate") for rate in rates])
    outer = np.array([stencil.oldest(np.array([first, first + 1]), Decay(rate), "rate") for rate in rates])  # (term, node, sample)
    parts = []
    (plus, minus), (old_plus, old_minus) = _split(inner, rates, lag), _split(outer, rates, first)
    for sign, interior, oldest in ((1.0, plus, old_plus), (-1.0, minus, old_minus)):
        if sign < 0.0 and np.abs(interior).max() < 1e-10 * np.abs(plus).max():
            continue
        decay = sign * np.exp(-rates)

        def power(k: Any, decay: Floats = decay, sign: float = sign) -> Floats:
            return np.asarray(sign**k * np.exp(-rates * k))

        ages = np.arange(first, lag - 1, -1)  # of the samples 0 … first − lag at node `first`
        begin = np.stack([oldest[:, i] * power(first) if i < reach else interior * power(age) for i, age in enumerate(ages)], axis=1)
        if window is not None:
            row = [interior * power(window - reach), *(oldest[:, reach - 1 - i] * power(window) for i in range(reach)), 0.0 * rates]
            edge = np.stack([row[i + 1] - decay * row[i] for i in range(reach + 1)], axis=1)
        parts.append((1.0 - decay, interior * power(lag), begin, edge))
    losses, gains, begins, edges = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    losses[: len(rates)] = -np.expm1(-rates)
    every = np.tile(amplitude, len(parts))
    return losses, every * gains, np.ascontiguousarray(every[:, None] * begins), np.ascontiguousarray(every[:, None] * edges)


def _split(values: Floats, rates: Floats, node: int) -> tuple[Floats, Floats]:
    """Both parts x, y of values (term, 2, …) = x d^n + y (−d)^n at n = node, node + 1."""
    powers = np.exp(-np.outer(rates, [node, node + 1.0])).reshape(len(rates), 2, *(1,) * (values.ndim - 2))
    scaled = np.where(powers > VANISHED, values / np.maximum(powers, VANISHED), 0.0)
    return 0.5 * (scaled[:, 0] + scaled[:, 1]), (-1.0) ** node * 0.5 * (scaled[:, 0] - scaled[:, 1])
