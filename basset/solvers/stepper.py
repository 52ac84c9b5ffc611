"""One step of graded collocation: choosing its size, solving it, its error estimate, accepting it or truncating it at an event; and the loop
over steps (`march`). Compiled once for all equations.

`basset.solve` and the flights of the simulator are built on it. What differs between them comes as C functions
(`basset._compile.entry`): `fun`; how the stages are solved, by Newton's full matrix or by a diagonal Jacobian, which handles stiff
drag at a fraction of the price; and events or impacts on a step, which truncate it. `march` returns to its caller
when a table for a new step size is missing, when its record is full, when it cannot go on, and at the end.

Collocation at Radau points: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.5; in √t after a jump: this library.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, compiled, entry, record_type, separate, shared
from basset.kernels import Floats, gauss_legendre
from basset.solvers import events
from basset.solvers.events import all_at
from basset.spectrum import Following, log_stretch_of, weight_ratio
from basset.streaming._loops import dot

END, TABLE, FULL, ACCEPTED, TOO_SMALL, TOO_MANY, NOT_FINITE, AGAIN, SUSPECT, TROUBLE, STOPPED, AT_REST = range(12)
LADDER = 8  # step sizes per octave: tables are kept by rung

# of one integration: its steps and their control
CONTROL = record_type(
    "time", "step",  # its end so far, and the size of the next step
    "first_step", "last_jump",  # size of the first step after the last jump, and when that was
    "previous_step",  # size of a regular step before this one, else 0
    "error", "previous_error",  # of the step that was accepted last, and of the one before, over the tolerance
    "tolerance_factor",
    "refusals", "tried",  # fading count of regular steps that were too long, size of the last one
    "failed_time", ("failed_component", "i8"),  # where fun was not finite
    ("steps", "i8"), ("calls", "i8"),  # so far; of fun
    ("rung", "i8"),  # of the step size, −1 if it is on none
    ("singular", "?"),  # whether the next step is
    ("smooth", "?"),  # whether the rates go on from the step before
    ("jacobian_known", "?"), ("guess_known", "?"),
)  # fmt: skip
FULLY, DIAGONALLY = 10, 30  # iterations at most
SETTLED = 0.03  # of the step's error: the last change of stages solved with a diagonal Jacobian, unless the problem asks for less


class Equation(NamedTuple):
    """y' = fun(t, y) without history, `own` being passed to `fun` as work space; components at rest.

    For a diagonal Jacobian: the first `moved` components are places, the next as many their velocities against a stream; they and the last `driven`
    damp nothing, on the first `idle` nothing depends, the others are alike by so many; those that remember lie side by side.
    """

    fun: Any
    own: Floats
    held: Any
    moved: int = 0
    idle: int = 0
    alike: int = 1
    driven: int = 0


class Problem(NamedTuple):
    """What does not change up to `end`: times in s, steps in s, tolerances, memory components and their coefficients.

    `fun` is evaluated at times within [first, last] only: between two breaks of the input.
    """

    end: float
    span: float
    limit: float
    floor: float
    rtol: float
    atol: float
    max_steps: int
    where: Any
    strength: Floats
    first: float = -math.inf
    last: float = math.inf
    singular_factor: float = 1.0  # on the error estimate of singular steps
    settled: float = SETTLED


class Nodes(NamedTuple):
    """Matrices of the stages, (stage, node), see `_tables.Stages`."""

    c: Floats
    slope: Floats
    integral: Floats
    regular: Floats
    singular: Floats
    between: Floats
    width: Floats
    between_values: Floats
    between_slopes: Floats
    at_start: Floats
    rise: Floats  # integrals of the regular basis, in Legendre coefficients


class Tables(NamedTuple):
    """By rung of the ladder and kind (0 regular, 1 singular)."""

    sizes: Floats  # (rung, kind): the step size it was made for, 0 for none
    past: Floats  # (rung, kind, stage, term)
    decay: Floats  # (rung, term)
    moments: Floats  # (rung, kind, node, term)
    local: Floats  # (rung, kind, stage, node)
    kernel: Floats  # (rung, stage)
    between_past: Floats  # (rung, place, term)
    between_local: Floats  # (rung, place, node)
    between_kernel: Floats  # (rung, place)


class Unit(NamedTuple):
    """What the tables of a step size on no rung are made of, for a kernel s^(-1/2): weights of the sum, histories within a unit step as in `Tables`,
    by kind; nothing for other kernels, whose caller makes the tables.
    """

    weights: Floats
    local: Floats  # (kind, stage, node)
    between: Floats  # (place, node)


class State(NamedTuple):
    """What changes: states and their rates at the end of the step before (n,), exponentials (memory, terms), newest jump
    (memory,), Jacobian (n, n) or its diagonal (1, n); steps and their control (1,), see CONTROL.
    """

    y: Floats
    rate: Floats
    past: Floats
    jump: Floats
    jacobian: Floats
    control: Any


class Truncation(NamedTuple):
    """Rates of the exponentials, Gauss points and weights on [0, 1] and how many decay times count, for the moments of a truncated step."""

    rates: Floats
    x: Floats
    w: Floats
    decayed: float
    factors: Floats  # (point,), overwritten
    polynomials: Floats  # (2, stages + 1, point), overwritten: Legendre polynomials and their slopes
    sums: Floats  # (stages + 1,), overwritten


class Workspace(NamedTuple):
    """Work space of a march: all overwritten, but what the next step is guessed from."""

    signal: Floats  # (1, 2)
    times: Floats  # (stage,)
    states: Floats  # (stage, state)
    rates: Floats  # (stage, state)
    force: Floats  # (stage, state)
    lead: Floats  # (stage, stage)
    carry: Floats  # (stage, stage)
    matrix: Floats  # (stage·state, stage·state); of one state where the Jacobian is diagonal
    order: Any  # (stage·state,)
    residual: Floats  # (stage·state,)
    inverse: Floats  # (state, stage, stage) where the Jacobian is diagonal
    here_times: Floats  # (state + 1,)
    here: Floats  # (state + 1, state)
    out: Floats  # (state + 1, state)
    polynomial: Floats  # (degree + 1, state)
    guess: Floats  # (degree, state): Legendre coefficients of the rates in the step before
    before: Floats  # (state,)
    after: Floats
    still: Floats


class Parts(NamedTuple):
    """All that finding and accepting a step reads and writes."""

    equation: Equation
    problem: Problem
    nodes: Nodes
    tables: Tables
    odd: Tables  # of the size that is on no rung, without moments and decay
    unit: Unit
    state: State
    values: Floats  # (stage, state): node values of the step that was found
    following: Following
    truncation: Truncation
    work: Workspace


class Record(NamedTuple):
    """Accepted steps: start, size, kind, the share that was taken, state at the start, node values; whether a jump followed, and
    the states before and after it.
    """

    start: Floats
    size: Floats
    kind: Floats
    share: Floats
    y: Floats
    values: Floats
    leapt: Floats
    before: Floats
    after: Floats


@separate
def factor(matrix, order):
    """LU factors of a square matrix with row exchanges, in place (Golub & Van Loan 2013, algorithm 3.4.1)."""
    size = len(order)
    for i in range(size):
        best = i
        for k in range(i + 1, size):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        order[i] = best
        if best != i:
            for k in range(size):
                matrix[i, k], matrix[best, k] = matrix[best, k], matrix[i, k]
        scale = 1.0 / matrix[i, i]
        for row in range(i + 1, size):
            share = matrix[row, i] * scale
            matrix[row, i] = share
            if share != 0.0:
                for k in range(i + 1, size):
                    matrix[row, k] -= share * matrix[i, k]


@separate
def substitute(matrix, order, vector):
    """The solution for a right-hand side, in place, from the factors."""
    size = len(order)
    for i in range(size):
        vector[i], vector[order[i]] = vector[order[i]], vector[i]
    for i in range(size):
        total = vector[i]
        for k in range(i):
            total -= matrix[i, k] * vector[k]
        vector[i] = total
    for i in range(size - 1, -1, -1):
        total = vector[i]
        for k in range(i + 1, size):
            total -= matrix[i, k] * vector[k]
        vector[i] = total / matrix[i, i]


@separate
def assemble(p: Parts, h: float, slot: int, kind: int) -> None:
    """Newton's matrix, factored, the maps from the unknowns to y' and to y − y_n, and c·(memory before the step), into the work space."""
    problem, nodes, local, state, work = p.problem, p.nodes, chosen(p).local, p.state, p.work
    count, n, m = len(nodes.c), len(state.y), len(problem.where)
    lead, carry, matrix, jacobian = work.lead, work.carry, work.matrix, state.jacobian
    for i in range(count):
        for k in range(count):
            if kind == 1:
                carry[i, k] = 1.0 if i == k else 0.0
                lead[i, k] = nodes.slope[i, k] / h
            else:
                lead[i, k] = 1.0 if i == k else 0.0
                carry[i, k] = h * nodes.integral[i, k]
    for i in range(count):
        for k in range(count):
            for a in range(n):
                for b in range(n):
                    matrix[i * n + a, k * n + b] = -carry[i, k] * jacobian[a, b]
                matrix[i * n + a, k * n + a] += lead[i, k]
            for a in range(m):
                place = problem.where[a]
                matrix[i * n + place, k * n + place] += problem.strength[a] * local[slot, kind, i, k]
    factor(matrix, work.order)
    memory_before(p, slot, kind)


@separate
def memory_before(p: Parts, slot: int, kind: int) -> None:
    """c·(memory of all that came before the step) at the stages, into the work space's force."""
    problem, tables, state, force = p.problem, chosen(p), p.state, p.work.force
    past, jump, before, kernel = state.past, state.jump, tables.past, tables.kernel
    for i in range(len(force)):
        for a in range(len(state.y)):
            force[i, a] = 0.0
        for a in range(len(problem.where)):
            memory = dot(before[slot, kind, i], 0, past[a], 0, past.shape[1])
            if kind == 1:
                memory += kernel[slot, i] * jump[a]
            force[i, problem.where[a]] = problem.strength[a] * memory


@shared
def correct(p: Parts, local: Floats, unknown: Floats) -> tuple[float, float, float]:
    """One Newton correction of `unknown` and the states, in place: (its size, rounding, what the step missed before) over the tolerance."""
    problem, state, work = p.problem, p.state, p.work
    states, rates, residual, lead, carry, force = work.states, work.rates, work.residual, work.lead, work.carry, work.force
    count, n = states.shape
    missed = 0.0
    for i in range(count):
        for a in range(n):
            total = force[i, a] - rates[i, a]
            for k in range(count):
                total += lead[i, k] * unknown[k, a]
            residual[i * n + a] = total
        for a in range(len(problem.where)):
            place, total = problem.where[a], 0.0
            for k in range(count):
                total += local[i, k] * unknown[k, place]
            residual[i * n + place] += problem.strength[a] * total
        for a in range(n):
            scale = problem.atol + problem.rtol * (abs(state.y[a]) + abs(states[i, a])) + 1e-300
            missed = max(missed, state.control[0].step * abs(residual[i * n + a]) / scale)
    substitute(work.matrix, work.order, residual)
    for i in range(count):
        for a in range(n):
            unknown[i, a] -= residual[i * n + a]
    size, floor = 0.0, 0.0
    for i in range(count):
        for a in range(n):
            value = state.y[a]
            for k in range(count):
                value += carry[i, k] * unknown[k, a]
            scale = problem.atol + problem.rtol * (abs(state.y[a]) + abs(value))
            change = abs(value - states[i, a]) / scale
            if not change <= size:  # also for NaN
                size = change
            floor = max(floor, 4e-16 * abs(value) / scale)
            states[i, a] = value
    return size, floor, missed


@separate
def decay_error(p: Parts) -> float:
    """Local error of a regular step over the tolerance, from the decay of its Legendre coefficients."""
    problem, nodes, state, values, h = p.problem, p.nodes, p.state, p.values, p.state.control[0].step
    count, n = values.shape
    worst, atol, rtol = 0.0, problem.atol, problem.rtol
    y, rate, regular, weights, at_start = state.y, state.rate, nodes.regular, nodes.integral[count - 1], nodes.at_start
    smooth, first = state.control[0].smooth, nodes.c[0]
    for a in range(n):
        end, oldest, older, before, last = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            end += weights[i] * values[i, a]
            coefficient = 0.0
            for k in range(count):
                coefficient += regular[i, k] * values[k, a]
            oldest, older, before, last = older, before, last, h * abs(coefficient)
        end = y[a] + h * end
        # parity may hide one coefficient: from three stages on compare pairs
        decay = min(1.0, max(last, before) / max(1e-300, older, oldest)) ** 0.5 if count > 2 else min(1.0, last / max(before, 1e-300))
        tail = 4.0 * decay * max(last, decay * before)  # errors add up over steps and flights
        if smooth:  # nothing else checks between the step's start and its first node: y' must be continuous there
            kink = -rate[a]
            for k in range(count):
                kink += at_start[k] * values[k, a]
            tail = max(tail, h * first * abs(kink))
        error = tail / (atol + rtol * max(abs(y[a]), abs(end)))
        if not error <= worst:
            worst = error
    return worst


@separate
def defect_error(p: Parts) -> float:
    """∫ |y' − fun + c·H| over a singular step, over the tolerance, at places halfway between its nodes in σ, where it is largest; negative where
    fun is not finite.
    """
    problem, nodes, tables, state, values, work, control = p.problem, p.nodes, chosen(p), p.state, p.values, p.work, p.state.control[0]
    count, n = values.shape
    h, slot = control.step, max(0, control.rung)
    where, strength, past, jump, places, width = problem.where, problem.strength, state.past, state.jump, nodes.between, nodes.width
    kernel, local, before, slopes, y = tables.between_kernel[slot], tables.between_local[slot], tables.between_past[slot], nodes.between_slopes, state.y
    basis, states, rates = nodes.between_values, work.states, work.rates
    for i in range(count):
        work.times[i] = control.time + h * places[i] ** 2
        for a in range(n):
            states[i, a] = y[a]
            for k in range(count):
                states[i, a] += basis[i, k] * values[k, a]
    if not evaluate(p, work.times, states, rates, count):
        return -1.0
    if len(p.following.values) > 0:
        for i in range(count):
            exceed(p, states, i, places[i] ** 2, 2, h, 1, before[i], rates)
    for i in range(count):
        for a in range(n):
            slope = 0.0
            for k in range(count):
                slope += slopes[i, k] * values[k, a]
            rates[i, a] = slope / (2.0 * h * places[i]) - rates[i, a]
        for a in range(len(where)):
            memory = kernel[i] * jump[a] + dot(before[i], 0, past[a], 0, past.shape[1])
            for k in range(count):
                memory += local[i, k] * values[k, where[a]]
            rates[i, where[a]] += strength[a] * memory
    worst = 0.0
    for a in range(n):
        total = 0.0
        for i in range(count):
            total += 2.0 * h * places[i] * width[i] * abs(rates[i, a])
        error = total / (problem.atol + problem.rtol * max(abs(y[a]), abs(y[a] + values[count - 1, a])))
        if not error <= worst:
            worst = error
    result: float = worst * problem.singular_factor
    return result


@shared
def chosen(p: Parts) -> Tables:
    """The tables of the step's size, at place max(0, slot)."""
    return p.tables if p.state.control[0].rung >= 0 else p.odd


@shared
def choose(p: Parts) -> int:
    """Fix the size and table slot of the next step, −1 where it is on no rung: ACCEPTED, or END, TABLE, TOO_SMALL."""
    control, problem, rungs, kind = p.state.control[0], p.problem, len(p.tables.sizes), int(p.state.control[0].singular)
    left, h = problem.end - control.time, min(control.step, problem.limit)
    if left <= 0.0:
        return END
    slot = -1
    if h >= left * (1.0 - 1e-12):
        h = left
    else:
        slot = max(0, math.ceil(LADDER * math.log2(problem.span / h) - 1e-9))
        h = problem.span * 2.0 ** (-slot / LADDER)
        if slot < rungs and p.tables.sizes[slot, kind] > 0.0:
            h = p.tables.sizes[slot, kind]  # bit for bit, however the power is computed
        if h > left:
            h, slot = left, -1
        if 0.0 < left - h < 0.05 * h:  # no sliver at the end
            h, slot = (left if left <= problem.limit else 0.5 * left), -1
    if (h < problem.floor and left > problem.floor) or slot >= rungs:
        return TOO_SMALL
    control.step, control.rung = h, slot
    if slot < 0 and len(p.unit.local) > 0 and p.odd.sizes[0, kind] != h:
        make_odd(p, h, kind)
    return ACCEPTED if chosen(p).sizes[max(0, slot), kind] == h else TABLE


@separate
def make_odd(p: Parts, h: float, kind: int) -> None:
    """The tables of a step size on no rung."""
    tables, unit, rates, nodes, root = p.odd, p.unit, p.truncation.rates, p.nodes, math.sqrt(h)
    weights, between, count = unit.weights, nodes.between, len(nodes.c)
    for i in range(count):
        tables.kernel[0, i], tables.between_kernel[0, i] = 1.0 / math.sqrt(nodes.c[i] * h), 1.0 / (between[i] * root)
        for q in range(len(weights)):
            tables.past[0, kind, i, q] = weights[q] * math.exp(-rates[q] * nodes.c[i] * h)
            if kind == 1:
                tables.between_past[0, i, q] = weights[q] * math.exp(-rates[q] * between[i] * between[i] * h)
        for k in range(count):
            tables.local[0, kind, i, k] = unit.local[kind, i, k] * (1.0 / root if kind == 1 else root)
            tables.between_local[0, i, k] = unit.between[i, k] / root
    tables.sizes[0, 0] = tables.sizes[0, 1] = 0.0
    tables.sizes[0, kind] = h


@shared
def next_step(problem: Problem, control: Any, h: float, count: int) -> float:
    """The size to try after an accepted step: by the error and, where it grows, by its trend; growing geometrically away from the last jump.

    The trend: Gustafsson (1994), ACM Trans. Math. Softw. 20, 496.
    """
    growth = max(control.error, 1e-10) ** (-1.0 / (count + 1))
    if control.previous_step > 0.0:
        growth *= min(1.0, h / control.previous_step * (max(control.previous_error, 1e-2) / max(control.error, 1e-10)) ** (1.0 / (count + 1)))
    size: float = h * min(2.0, max(0.3, 0.9 * growth))
    since = control.time - control.last_jump
    return min(size, 2.0 * (since if since > 0.5 * h else h)) if len(problem.where) > 0 else size  # h: where time rounds it away


@shared
def keep(p: Parts, record: Record, done: int, share: float) -> None:
    """Record the step that was found, of which that share is taken; before it is taken."""
    control, values, y = p.state.control[0], p.values, p.state.y
    record.start[done], record.size[done], record.kind[done], record.share[done] = control.time, control.step, int(control.singular), share
    record.leapt[done] = 0.0
    start, nodal = record.y, record.values  # element by element: array assignment allocates
    for a in range(len(y)):
        start[done, a] = y[a]
        for k in range(len(values)):
            nodal[done, k, a] = values[k, a]


@separate
def accept(p: Parts) -> None:
    """Take the step that was found: move state and memory, choose the next size."""
    problem, nodes, tables, state, values, control = p.problem, p.nodes, chosen(p), p.state, p.values, p.state.control[0]
    count, n = len(values), len(state.y)
    h, slot, kind = control.step, max(0, control.rung), int(control.singular)
    where, memory, jumps, moments, decays = problem.where, state.past, state.jump, tables.moments, tables.decay
    if control.rung < 0:
        truncate_memory(where, nodes, p.truncation, state, h, 1.0, kind, values)
    for a in range(len(where) if control.rung >= 0 else 0):
        past, jump, place, decay = memory[a], 0.0, where[a], decays[slot]
        if kind == 1:
            jump, jumps[a] = jumps[a], 0.0
        for q in range(len(past)):
            past[q] = decay[q] * (past[q] + jump)
        for k in range(count):
            gained, value = moments[slot, kind, k], values[k, place]
            for q in range(len(past)):
                past[q] += gained[q] * value
    y, rate, weights, slope = state.y, state.rate, nodes.integral[count - 1], nodes.slope[count - 1]
    for a in range(n):
        rate[a] = values[count - 1, a]
        if kind == 1:
            y[a] += values[count - 1, a]
            rate[a] = 0.0
            for k in range(count):
                rate[a] += slope[k] * values[k, a] / h
        else:
            gain = 0.0
            for k in range(count):
                gain += weights[k] * values[k, a]
            y[a] += h * gain
    if kind == 1:
        control.first_step = h
    control.time += h
    if abs(problem.end - control.time) <= 1e-12 * h + 1e-15 * abs(control.time):  # an end may be infinite
        control.time = problem.end
    control.steps += 1
    control.step = next_step(problem, control, h, count)
    control.previous_step, control.guess_known = (0.0 if kind == 1 else h), False
    control.singular, control.smooth = False, True


@shared
def evaluate(p: Parts, times: Floats, states: Floats, rates: Floats, count: int) -> bool:
    """`fun` at every row of `states`, nothing for what is at rest; whether all is finite: if not, when and in which component is noted."""
    equation, problem, control = p.equation, p.problem, p.state.control[0]
    control.calls += count
    for i in range(count):
        time = min(max(times[i], problem.first), problem.last)
        call(equation.fun, time, states, i, rates, i, equation.own)
        for a in range(len(equation.held)):
            if equation.held[a]:
                rates[i, a] = 0.0
        for a in range(len(p.state.y)):
            if not math.isfinite(rates[i, a]):
                control.failed_time, control.failed_component = time, a
                return False
    return True


@shared
def evaluate_stages(p: Parts, h: float, slot: int, kind: int) -> bool:
    """The rates of all stages, including the difference of the memory to Basset's where the kernel follows the slip; whether all is finite."""
    work, nodes = p.work, p.nodes
    count = len(nodes.c)
    finite = evaluate(p, work.times, work.states, work.rates, count)
    if finite and len(p.following.values) > 0:
        for i in range(count):
            exceed(p, work.states, i, nodes.c[i], kind, h, kind, chosen(p).past[slot, kind, i], work.rates)
    return finite


@separate
def exceed(p: Parts, states: Floats, i: int, place: float, which: int, h: float, kind: int, past: Floats, rates: Floats) -> None:
    """Take c·(H − Basset's H) at row i of `states` from row i of the rates, for a kernel that follows the slip.

    `past` (terms,) are Basset's weights with their decay up to `place` of the step, `which` of three sets of places.
    """
    following, problem, state, values = p.following, p.problem, p.state, p.values
    where, memory, jump, strength = problem.where, state.past, state.jump, problem.strength
    members, count = len(where), len(values)
    log_stretch = log_stretch_of(following, where, states, i)
    if log_stretch == -math.inf:
        return  # Basset's kernel
    local = following.local
    for q in range(len(following.log_rates)):
        share = past[q] * (weight_ratio(following, q, log_stretch) - 1.0)
        for a in range(members):
            rates[i, where[a]] -= strength[a] * share * memory[a, q]
    if kind == 1:
        lag = place * h
        share = ((1.0 + math.exp(1.5 / following.c1 * (log_stretch + math.log(lag)))) ** -following.c1 - 1.0) / math.sqrt(lag)
        for a in range(members):
            rates[i, where[a]] -= strength[a] * share * jump[a]
    position = (log_stretch + math.log(h) - following.local_low) * following.local_inverse
    if position <= 2.0:
        return  # Basset's within 1e-9
    cell = min(int(position), local.shape[1] - 4)
    x = min(position - cell, 1.0)
    unit = 1.0 / math.sqrt(h) if kind == 1 else math.sqrt(h)
    for m in range(-2, 4):  # Lagrange through six points
        weight = unit
        for other in range(-2, 4):
            if other != m:
                weight *= (x - other) / (m - other)
        for k in range(count):
            part = weight * local[which, cell + m, i, k]
            for a in range(members):
                rates[i, where[a]] += strength[a] * part * values[k, where[a]]


@shared
def newton(p: Parts) -> int:
    """Solve the stages: iterations, negative if it failed, 0 if fun was not finite."""
    control, values, work, y = p.state.control[0], p.values, p.work, p.state.y
    h, slot, kind = control.step, max(0, control.rung), int(control.singular)
    count, n = values.shape
    assemble(p, h, slot, kind)
    for i in range(count):
        work.times[i] = control.time + p.nodes.c[i] * h
        for a in range(n):
            work.states[i, a], values[i, a] = y[a], 0.0
    previous, before = math.inf, 0.0
    follows = len(p.following.values) > 0  # which the matrix does not know
    for iteration in range(1, DIAGONALLY + 1 if follows else FULLY + 1):
        if not evaluate_stages(p, h, slot, kind):
            return 0
        size, floor, missed = correct(p, chosen(p).local[slot, kind], values)
        if not math.isfinite(size):
            return -iteration
        # small corrections alone may be due to the Jacobian of another place, or to differences across a jump of fun
        lingers = iteration > 1 and missed > max(SETTLED, 0.5 * before)  # corrections far too small: a Jacobian from across a jump of fun
        solved = (missed <= 1.0 and not lingers) or size <= (floor if iteration == 1 else 10.0 * floor) or missed <= 1e-2 * before
        if solved and size <= max(1e-3, floor):
            return iteration
        if iteration > 1 and not solved and max(0.5 * previous, 10.0 * floor) < size <= 1e-3:
            return -iteration
        if iteration > 2 and size > 0.9 * previous:
            return iteration if solved and size <= max(0.1, 10.0 * floor) else -iteration  # stalled: rounding, well below the tolerance
        previous, before = size, missed
    return -FULLY


@separate
def differentiate(p: Parts) -> bool:
    """∂fun/∂y by forward differences at the step's start; whether it is finite."""
    problem, state, work = p.problem, p.state, p.work
    n, times, states, rates, jacobian = len(state.y), work.here_times, work.here, work.out, state.jacobian
    for j in range(n + 1):
        times[j] = state.control[0].time
        for a in range(n):
            states[j, a] = state.y[a]
    for j in range(n):
        states[j + 1, j] += 1.5e-8 * max(abs(state.y[j]), problem.atol + problem.rtol, 1e-8)
    if not evaluate(p, times, states, rates, n + 1):
        return False
    for j in range(n):
        for a in range(n):
            jacobian[a, j] = (rates[j + 1, a] - rates[0, a]) / (states[j + 1, j] - state.y[j])
    return True


def solved_fully(p: Parts, t: float, y: Any, out: Any, own: Any) -> None:
    """Into out[0]: iterations in which Newton's full matrix solved the stages, negative if it failed, 0 if fun was not finite; t = 1: with a new Jacobian."""
    if t == 1.0 and not differentiate(p):
        out[0] = 0.0
        return
    iterations = newton(p)
    if abs(iterations) > 4:
        p.state.control[0].jacobian_known = False  # of another place by now
    out[0] = iterations


fully_entry = entry(solved_fully, "some 3 s")


@shared
def invert(matrix: Floats, result: Floats) -> None:
    """The inverse of a small matrix into `result`, by Gauss–Jordan with row exchanges; `matrix` is used up."""
    n = len(matrix)
    for i in range(n):
        for k in range(n):
            result[i, k] = 1.0 if i == k else 0.0
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if best != i:
            for k in range(n):
                matrix[i, k], matrix[best, k] = matrix[best, k], matrix[i, k]
                result[i, k], result[best, k] = result[best, k], result[i, k]
        scale = 1.0 / matrix[i, i]
        for k in range(n):
            matrix[i, k] *= scale
            result[i, k] *= scale
        for row in range(n):
            if row != i:
                share = matrix[row, i]
                for k in range(n):
                    matrix[row, k] -= share * matrix[i, k]
                    result[row, k] -= share * result[i, k]


@shared
def differentiate_diagonally(p: Parts) -> None:
    """The diagonal of the Jacobian by forward differences at the step's start, the same for those that are alike: one inverse for each kind."""
    work, state, equation = p.work, p.state, p.equation
    here, out, y, diagonal, time = work.here, work.out, state.y, state.jacobian[0], state.control[0].time
    for a in range(len(y)):
        here[0, a] = here[1, a] = y[a]
    damped = len(y) - equation.driven
    call(equation.fun, time, here, 0, out, 0, equation.own)
    for a in range(equation.moved, damped):
        here[1, a] = y[a] + 1.5e-8 * max(abs(y[a]), 1e-3)
        call(equation.fun, time, here, 1, out, 1, equation.own)
        diagonal[a] = min(0.0, (out[1, a] - out[0, a]) / (here[1, a] - y[a]))
        here[1, a] = y[a]
    for low in range(equation.moved, damped, equation.alike):
        high = min(low + equation.alike, damped)
        mean = 0.0
        for a in range(low, high):
            mean += diagonal[a] / (high - low)
        for a in range(low, high):
            diagonal[a] = mean


@shared
def predict(p: Parts, h: float, kind: int) -> None:
    """A first guess of the unknowns."""
    control, c, y, values, work, state, equation = p.state.control[0], p.nodes.c, p.state.y, p.values, p.work, p.state, p.equation
    problem, guess = p.problem, work.guess
    count, n = values.shape
    if control.smooth and control.previous_step > 0.0:  # the polynomial of the step before, carried on
        ratio = h / control.previous_step
        for i in range(count):
            x = 1.0 + 2.0 * c[i] * ratio
            for a in range(n):
                values[i, a] = guess[0, a] + guess[1, a] * x
            older, newer = 1.0, x
            for d in range(2, count):
                older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
                for a in range(n):
                    values[i, a] += newer * guess[d, a]
        return
    if control.smooth:
        for i in range(count):
            for a in range(n):
                values[i, a] = state.rate[a]
        return
    here, out = work.here, work.out
    for a in range(n):
        here[0, a] = y[a]
    call(equation.fun, control.time, here, 0, out, 0, equation.own)
    for i in range(count):
        for a in range(n):
            values[i, a] = c[i] * h * out[0, a] if kind == 1 else out[0, a]
        if kind == 1:
            for a in range(len(problem.where)):
                values[i, problem.where[a]] -= 2.0 * problem.strength[a] * math.sqrt(c[i] * h) * state.jump[a]


@shared
def remember_rates(p: Parts) -> None:
    """Keep the polynomial of the rates in the step before, whose node values are still in their place, for the next first guess."""
    control, values, guess, regular = p.state.control[0], p.values, p.work.guess, p.nodes.regular
    count, n = values.shape
    if control.previous_step > 0.0 and not control.guess_known:
        for d in range(count):
            for a in range(n):
                total = 0.0
                for k in range(count):
                    total += regular[d, k] * values[k, a]
                guess[d, a] = total
    control.guess_known = True


@shared
def factorise(p: Parts, h: float, slot: int, kind: int, first: int) -> None:
    """The inverse of each state's own stage matrix; states that nothing damps need none in a regular step."""
    matrix, inverse, diagonal, strength = p.work.matrix, p.work.inverse, p.state.jacobian[0], p.problem.strength
    local, slope, integral = chosen(p).local, p.nodes.slope, p.nodes.integral
    n, count, members = len(diagonal), len(p.nodes.c), len(strength)
    for a in range(n):
        member = first <= a < first + members
        if kind == 0 and not member and diagonal[a] == 0.0:
            continue
        if a > 0 and diagonal[a] == diagonal[a - 1] and a != first and a != first + members:  # as for the one before
            for i in range(count):
                for k in range(count):
                    inverse[a, i, k] = inverse[a - 1, i, k]
            continue
        for i in range(count):
            for k in range(count):
                value = slope[i, k] / h if kind == 1 else -h * diagonal[a] * integral[i, k]
                if member:
                    value += strength[a - first] * local[slot, kind, i, k]
                matrix[i, k] = value
            matrix[i, i] += -diagonal[a] if kind == 1 else 1.0
        invert(matrix, inverse[a])


@shared
def iterate(p: Parts) -> int:
    """Solve the stages with the diagonal of the Jacobian: iterations, negative if it failed, 0 if fun was not finite."""
    control, values, work, problem, equation = p.state.control[0], p.values, p.work, p.problem, p.equation
    h, slot, kind = control.step, max(0, control.rung), int(control.singular)
    count, n = values.shape
    members = len(problem.where)
    first = problem.where[0] if members > 0 else n
    memory_before(p, slot, kind)
    factorise(p, h, slot, kind, first)
    predict(p, h, kind)
    inverse, diagonal, force, y = work.inverse, p.state.jacobian[0], work.force, p.state.y
    states, rates, right, integral = work.states, work.rates, work.residual, p.nodes.integral
    atol, rtol = control.tolerance_factor * problem.atol, control.tolerance_factor * problem.rtol
    idle = equation.idle if kind == 0 else 0  # they move nothing: they are integrated at the end
    for i in range(count):
        work.times[i] = control.time + p.nodes.c[i] * h
    previous = math.inf
    for iteration in range(DIAGONALLY):
        size, floor = 0.0, 0.0
        for a in range(n - 1, idle - 1, -1):  # velocities before places, which follow at once
            member = first <= a < first + members
            if iteration > 0:
                if kind == 0 and not member and diagonal[a] == 0.0:
                    for i in range(count):
                        values[i, a] = rates[i, a]
                else:  # M v = F − c·past − J (Y − y_n), the part of F that J stands for being implicit
                    for i in range(count):
                        right[i] = rates[i, a] - diagonal[a] * (states[i, a] - y[a])
                        if member:
                            right[i] -= force[i, a]
                    for i in range(count):
                        total = 0.0
                        for k in range(count):
                            total += inverse[a, i, k] * right[k]
                        values[i, a] = total
            for i in range(count):
                value = y[a]
                if kind == 1:
                    value += values[i, a]
                else:
                    total = 0.0
                    for k in range(count):
                        total += integral[i, k] * values[k, a]
                    value += h * total
                if iteration > 0:
                    scale = atol + rtol * (abs(y[a]) + abs(value))
                    change = abs(value - states[i, a]) / scale
                    if not change <= size:  # also for NaN
                        size = change
                    floor = max(floor, 4e-16 * abs(value) / scale)
                    if equation.moved <= a < 2 * equation.moved:
                        rates[i, a - equation.moved] += value - states[i, a]
                states[i, a] = value
        if iteration > 0:
            if not math.isfinite(size):
                return -iteration
            if size <= max(problem.settled, floor) or (iteration > 4 and 0.9 * previous < size <= max(0.1, 10.0 * floor)):
                for i in range(count):
                    for a in range(idle):
                        values[i, a] = rates[i, a]
                return iteration
            if iteration > 4 and size > 0.9 * previous:
                return -iteration
            previous = size
        if not evaluate_stages(p, h, slot, kind):
            return -max(1, iteration)
    return -DIAGONALLY


def solved_diagonally(p: Parts, t: float, y: Any, out: Any, own: Any) -> None:
    """As `solved_fully`, with the diagonal of the Jacobian; fun that is not finite is a failure of the iteration."""
    if t == 1.0:
        differentiate_diagonally(p)
    remember_rates(p)
    iterations = iterate(p)
    if abs(iterations) > 3:
        p.state.control[0].jacobian_known = False  # evaluated anew: costs less than the iterations that an old one needs
    out[0] = iterations


diagonally_entry = entry(solved_diagonally, "some 3 s")


@shared
def judge(problem: Problem, state: State, error: float, power: float) -> int:
    """ACCEPTED or TOO_MANY; AGAIN after setting the next step to try, for an error that falls as step^power."""
    control = state.control[0]
    if error <= 1.0:
        if control.steps >= problem.max_steps:
            return TOO_MANY
        control.previous_error, control.error = control.error, error
        return ACCEPTED
    h = control.step
    control.step = h * max(0.1, 0.8 * error ** (-1.0 / power)) if math.isfinite(error) else 0.25 * h
    return AGAIN


@shared
def attempt(p: Parts, solve: Any) -> int:
    """Find the next step that keeps the tolerance, its stages solved by `solve`: node values into p.values, its size in control.step; ACCEPTED or
    why not.
    """
    control, count, signal = p.state.control[0], len(p.nodes.c), p.work.signal
    while True:
        code = choose(p)
        if code != ACCEPTED:
            return code
        iterations = -1
        for trial in range(2):
            fresh = 1.0 if not control.jacobian_known or trial == 1 else 0.0
            control.jacobian_known = True
            call(solve, fresh, signal, 0, signal, 0, signal)
            iterations = int(signal[0, 0])
            if iterations >= 0:
                break
        if iterations == 0:
            return NOT_FINITE
        h, error, power = control.step, math.inf, float(count)
        if iterations > 0 and control.singular:
            power = 0.5 * (count + 1)
            error = defect_error(p) / control.tolerance_factor
            if error < 0.0:
                return NOT_FINITE
        elif iterations > 0:
            error = decay_error(p) / control.tolerance_factor
        code = judge(p.problem, p.state, error, power)
        if code != AGAIN:
            control.refusals *= 0.5
            return code
        if not control.singular:
            control.refusals += 1.0
            control.tried = h
            if control.refusals > 1.7:  # the size from the error estimate failed twice: is fun smooth?
                control.refusals = 0.0
                return SUSPECT


class Attempt(NamedTuple):
    """What a step is found from."""

    parts: Parts
    solve: Any


def attempted(given: Attempt, t: float, y: Any, out: Any, own: Any) -> None:
    """`attempt`, its code into out[0]."""
    out[0] = attempt(given.parts, given.solve)


attempt_entry = entry(attempted, "some 5 s")


@shared
def fit_polynomial(nodes: Nodes, kind: int, h: float, values: Floats, polynomial: Floats) -> None:
    """Legendre coefficients of y(θ) − y_n, in θ for a regular step and in √θ for a singular one."""
    count, n = values.shape
    basis, scale = (nodes.singular, 1.0) if kind == 1 else (nodes.rise, h)
    for d in range(count + 1):
        for a in range(n):
            total = 0.0
            for k in range(count):
                total += basis[d, k] * values[k, a]
            polynomial[d, a] = scale * total


@shared
def at(polynomial: Floats, y: Floats, kind: int, theta: float, a: int) -> float:
    """State a at θ."""
    x = 2.0 * (math.sqrt(theta) if kind == 1 else theta) - 1.0
    total: float = y[a] + polynomial[0, a] + polynomial[1, a] * x
    older, newer = 1.0, x
    for d in range(2, len(polynomial)):
        older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
        total += polynomial[d, a] * newer
    return total


@separate
def legendre_at(places: Floats, width: float, root: float, degrees: int, legendre: Floats) -> None:
    """Legendre polynomials and their slopes at 2 root (1 − width·places) − 1; the places are innermost: divisions side by side cost a fourth."""
    for p in range(len(places)):
        legendre[0, 0, p], legendre[0, 1, p] = 1.0, 2.0 * (1.0 - width * places[p]) * root - 1.0
        legendre[1, 0, p], legendre[1, 1, p] = 0.0, 1.0
    for d in range(2, degrees):
        for p in range(len(places)):
            legendre[0, d, p] = ((2 * d - 1) * legendre[0, 1, p] * legendre[0, d - 1, p] - (d - 1) * legendre[0, d - 2, p]) / d
        for p in range(len(places)):
            legendre[1, d, p] = legendre[1, d - 2, p] + (2 * d - 1) * legendre[0, d - 1, p]


@separate
def truncate_memory(where: Any, nodes: Nodes, truncation: Truncation, state: State, h: float, theta: float, kind: int, values: Floats) -> None:
    """Advance the exponentials to θ of the step, their moments by Gauss's rule over the last decay times."""
    count, members = len(nodes.c), len(where)
    basis = nodes.singular if kind == 1 else nodes.regular
    degrees = len(basis)
    root = math.sqrt(theta) if kind == 1 else theta
    factors, legendre, sums, tabulated = truncation.factors, truncation.polynomials, truncation.sums, 0.0
    rates, past, jump, nodes_x, nodes_w = truncation.rates, state.past, state.jump, truncation.x, truncation.w
    for q in range(len(rates)):
        z = rates[q] * h * theta
        share = min(1.0, truncation.decayed / z) if z > 0.0 else 1.0
        low = math.sqrt(max(0.0, 1.0 - share))
        width = share / (1.0 + low) if kind == 1 else share
        if width != tabulated:  # slow terms see the same places
            legendre_at(nodes_x, width, root, degrees, legendre)
            tabulated = width
        for p in range(len(nodes_x)):
            position = 1.0 - width * nodes_x[p]
            if kind == 1:
                factors[p] = 2.0 * width * nodes_w[p] * root * math.exp(-z * (1.0 - position) * (1.0 + position))
            else:
                factors[p] = width * nodes_w[p] * h * theta * math.exp(-z * width * nodes_x[p])
        for d in range(degrees):
            total = 0.0
            for p in range(len(nodes_x)):
                total += factors[p] * legendre[kind, d, p]
            sums[d] = total
        decay = math.exp(-z)
        for a in range(members):
            past[a, q] = decay * (past[a, q] + (jump[a] if kind == 1 else 0.0))
        for k in range(count):
            gained = 0.0
            for d in range(degrees):
                gained += sums[d] * basis[d, k]
            for a in range(members):
                past[a, q] += gained * values[k, where[a]]
    if kind == 1:
        for a in range(members):
            state.jump[a] = 0.0


@separate
def truncate_step(p: Parts, theta: float) -> None:
    """Take the step that was found up to θ, its polynomial being in the work space: state, memory and time."""
    control, y, work, problem = p.state.control[0], p.state.y, p.work, p.problem
    h, kind = control.step, int(control.singular)
    all_at(work.polynomial, y, kind, theta, work.before)
    if theta > 0.0:
        truncate_memory(problem.where, p.nodes, p.truncation, p.state, h, theta, kind, p.values)
    if kind == 1 and theta > 0.05:
        control.first_step = h
    for a in range(len(y)):
        y[a] = work.before[a]
    end = control.time + h * theta
    if theta == 1.0 and abs(problem.end - end) <= 1e-12 * h + 1e-15 * abs(problem.end):
        end = problem.end
    control.time = end
    control.steps += 1
    control.smooth, control.previous_step = False, 0.0


@shared
def restart(problem: Problem, control: Any, size: float) -> None:
    """Restart with small steps, `size` at most, at a jump of the slip or of its rate."""
    since = control.time - control.last_jump
    control.last_jump = control.time
    control.step = max(2.0 * problem.floor, min(size, 0.5 * since) if since > 0.0 else size)
    control.singular, control.smooth, control.jacobian_known, control.previous_step = len(problem.where) > 0, False, False, 0.0


def truncated(p: Parts, t: float, y: Any, out: Any, own: Any) -> None:
    """`truncate_step` at θ = t."""
    truncate_step(p, t)


def accepted(p: Parts, t: float, y: Any, out: Any, own: Any) -> None:
    """`accept`."""
    accept(p)


truncate_entry, accept_entry = entry(truncated), entry(accepted)


@shared
def to_event(m: Any, found: Any, p: Parts, record: Record, done: int, theta: float) -> int:
    """Take the step up to θ, where events happen, and start afresh after their jumps: PASSED, or why to stop."""
    control, y, problem, state, work = p.state.control[0], p.state.y, p.problem, p.state, p.work
    keep(p, record, done, theta)
    truncate_step(p, theta)
    end = control.time
    events.copy(work.before, record.before[done])
    leaps = False
    for j in range(found.count[0]):
        leaps = leaps or found.leaps[found.fired[j]]
    status = events.fire(m, found, end, work.before, work.after, work.still, events.REST * problem.span)
    record.leapt[done] = 1.0 if leaps else 0.0
    if leaps:
        for a in range(len(problem.where)):  # to what has not been felt yet, without a flight
            state.jump[a] += work.after[problem.where[a]] - work.before[problem.where[a]]
        for a in range(len(y)):
            y[a] = record.after[done, a] = work.after[a]
        restart(problem, control, control.first_step)
    return status


class Watch(NamedTuple):
    """What events on a step are found from."""

    motion: Any
    found: Any
    parts: Parts
    record: Record


def watched(given: Watch, t: float, y: Any, out: Any, own: Any) -> None:
    """Into out[0]: ACCEPTED for a step without an event that cuts it; else the step is taken up to there, as number t of the record: FULL, or why to
    stop; out[1]: whether it was taken.
    """
    m, found, p = given.motion, given.found, given.parts
    h, kind = p.state.control[0].step, int(p.state.control[0].singular)
    fit_polynomial(p.nodes, kind, h, p.values, p.work.polynomial)
    theta = events.first_crossing(m, found, events.Step(p.state.control[0].time, h, kind, p.state.y, p.work.polynomial), 1.0)
    status = events.PASSED
    out[0], out[1] = ACCEPTED, 0.0
    if theta <= 1.0:
        out[0], out[1] = FULL, 1.0
        status = to_event(m, found, p, given.record, int(t), theta)
    if found.trouble[0] != 0:
        out[0], out[1] = TROUBLE, 0.0
    elif status != events.PASSED:
        out[0] = STOPPED if status == events.TERMINAL else AT_REST


watch_entry = entry(watched, "some 10 s")


@shared
def advance(attempt: Any, watch: Any, watching: bool, p: Parts, record: Record, done: int) -> tuple[int, bool]:
    """Find the next step, number `done` of the record, and take it up to where something cuts it: (ACCEPTED, FULL at a cut, or why not; whether taken)."""
    signal = p.work.signal
    call(attempt, 0.0, signal, 0, signal, 0, signal)
    code, taken = int(signal[0, 0]), False
    if code == ACCEPTED and watching:
        call(watch, float(done), signal, 0, signal, 0, signal)
        code, taken = int(signal[0, 0]), signal[0, 1] == 1.0
    if code == ACCEPTED:
        keep(p, record, done, 1.0)
        accept(p)
        taken = True
    return code, taken


@compiled(allocates=False, usually="some 5 s")
def march(attempt, watch, watching, p, logged, most, record, recording):
    """Take steps until something needs the caller; (code, steps recorded).

    `watching`: something may cut them, by events of which no more than `most` may be logged before a step. Without `recording` the
    record's first place is overwritten.
    """
    done = 0
    while done < len(record.start) and logged[0] <= most:
        code, taken = advance(attempt, watch, watching, p, record, done)
        if taken and recording:
            done += 1
        if code not in (ACCEPTED, FULL):
            return code, done
    return FULL, done


def truncation_of(rates: Floats, points: int, decayed: float, stages: int) -> Truncation:
    """Gauss points for the moments of truncated steps, and room."""
    return Truncation(rates, *gauss_legendre(points), decayed, np.zeros(points), np.zeros((2, stages + 1, points)), np.zeros(stages + 1))


def workspace(stages: int, states: int, diagonal: bool = False) -> Workspace:
    """Work space of one march."""
    n = states
    whole = stages if diagonal else stages * n
    shapes: dict[str, tuple[int, ...]] = {
        "signal": (1, 2), "times": (stages,), "states": (stages, n), "rates": (stages, n), "force": (stages, n), "lead": (stages, stages),
        "carry": (stages, stages), "matrix": (whole, whole), "order": (whole,), "residual": (whole,), "inverse": (n if diagonal else 0, stages, stages),
        "here_times": (n + 1,), "here": (n + 1, n), "out": (n + 1, n), "polynomial": (stages + 1, n), "guess": (stages, n), "before": (n,), "after": (n,),
        "still": (n,),
    }  # fmt: skip
    arrays: dict[str, Any] = {name: np.zeros(shape, dtype=np.int64 if name == "order" else np.float64) for name, shape in shapes.items()}
    return Workspace(**arrays)


def start_control(start: float, step: float, singular: bool) -> Any:
    """The steps' record (1,) at the start."""
    control = np.zeros(1, dtype=CONTROL)
    first = control[0]
    first.time = first.last_jump = start
    first.step = first.first_step = step
    first.singular, first.tolerance_factor = singular, 1.0
    return control
