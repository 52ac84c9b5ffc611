"""The inner loop of graded collocation, with events and jumps inside: compiled once for all equations.

It comes back to its caller when a table for a new step size is missing, when its record is full, when it cannot go on, and at
the end. `fun`, event functions and jumps are called by `basset._compile.call`: C functions of compiled ones, which need no
Python from start to end, or callbacks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, compiled, entry, separate, shared
from basset._stream import dot
from basset.kernels import Floats
from basset.solvers import events
from basset.solvers.events import all_at

END, TABLE, FULL, ACCEPTED, TOO_SMALL, TOO_MANY, NOT_FINITE, AGAIN, SUSPECT, TROUBLE, STOPPED, LYING = range(12)
LADDER = 8  # step sizes per octave: tables are kept by rung

# places in State.numbers
TIME, STEP, FIRST, JUMPED, SINGULAR, KNOWN, STEPS, CALLS, SLOT, ERROR, WHERE, WHAT, SMOOTH, REFUSED, TRIED = range(15)


class Problem(NamedTuple):
    """What does not change up to `end`: times in s, steps in s, tolerances, memory components and their coefficients.

    `fun` is asked at times within [first, last] only: on this side of what breaks it.
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


class Nodes(NamedTuple):
    """Matrices of the stages, (stage, node), see `collocation.Stages`."""

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
    """By rung of the ladder (the last for odd sizes) and kind (0 regular, 1 singular)."""

    sizes: Floats  # (rung, kind): the step size it was made for, 0 for none
    past: Floats  # (rung, kind, stage, term)
    decay: Floats  # (rung, term)
    moments: Floats  # (rung, kind, node, term)
    local: Floats  # (rung, kind, stage, node)
    kernel: Floats  # (rung, stage)
    between_past: Floats  # (rung, place, term)
    between_local: Floats  # (rung, place, node)
    between_kernel: Floats  # (rung, place)


class State(NamedTuple):
    """What changes: states and their rates at the end of the step before (n,), exponentials (memory, terms), newest jump
    (memory,), Jacobian (n, n), and numbers.
    """

    y: Floats
    rate: Floats
    past: Floats
    jump: Floats
    jacobian: Floats
    numbers: Floats


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
def assemble(problem, nodes, tables, state, h, slot, kind, work):
    """Newton's matrix, factored, the maps from the unknowns to y' and to y − y_n, and c·(memory before the step), into `work`."""
    count, n, m = len(nodes.c), len(state.y), len(problem.where)
    lead, carry, matrix, force = work.lead, work.carry, work.matrix, work.force
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
                    matrix[i * n + a, k * n + b] = -carry[i, k] * state.jacobian[a, b]
                matrix[i * n + a, k * n + a] += lead[i, k]
            for a in range(m):
                place = problem.where[a]
                matrix[i * n + place, k * n + place] += problem.strength[a] * tables.local[slot, kind, i, k]
    factor(matrix, work.order)
    for i in range(count):
        for a in range(n):
            force[i, a] = 0.0
        for a in range(m):
            memory = dot(tables.past[slot, kind, i], 0, state.past[a], 0, state.past.shape[1])
            if kind == 1:
                memory += tables.kernel[slot, i] * state.jump[a]
            force[i, problem.where[a]] = problem.strength[a] * memory


@shared
def correct(problem, local, state, work, unknown):
    """One Newton correction of `unknown` and the states, in place: (its size, rounding) over the tolerance."""
    states, rates, residual, lead, carry, force = work.states, work.rates, work.residual, work.lead, work.carry, work.force
    count, n = states.shape
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
    return size, floor


@separate
def decay_error(problem: Problem, nodes: Nodes, state: State, h: float, values: Floats) -> float:
    """Local error of a regular step over the tolerance, from the decay of its Legendre coefficients."""
    count, n = values.shape
    worst, atol, rtol = 0.0, problem.atol, problem.rtol
    # arrays out of the tuples once: each look costs two reference counts
    y, rate, regular, weights, at_start = state.y, state.rate, nodes.regular, nodes.integral[count - 1], nodes.at_start
    smooth, first = state.numbers[SMOOTH] == 1.0, nodes.c[0]
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
        if smooth:  # nobody looks between the step's start and its first node: y' must go on from before
            kink = -rate[a]
            for k in range(count):
                kink += at_start[k] * values[k, a]
            tail = max(tail, h * first * abs(kink))
        error = tail / (atol + rtol * max(abs(y[a]), abs(end)))
        if not error <= worst:
            worst = error
    return worst


@shared
def states_between(nodes: Nodes, state: State, values: Floats, states: Floats) -> None:
    """States of a singular step halfway between its nodes in σ, where its defect is largest, into `states` (place, n)."""
    y, basis = state.y, nodes.between_values
    for i in range(len(values)):
        for a in range(len(y)):
            states[i, a] = y[a]
            for k in range(len(values)):
                states[i, a] += basis[i, k] * values[k, a]


@separate
def defect_error(problem: Problem, nodes: Nodes, tables: Tables, state: State, h: float, slot: int, values: Floats, rates: Floats) -> float:
    """∫ |y' − fun + c·H| over a singular step, over the tolerance; `rates` are used up."""
    count, n = values.shape
    where, strength, past, jump, places, width = problem.where, problem.strength, state.past, state.jump, nodes.between, nodes.width
    kernel, local, before, slopes, y = tables.between_kernel[slot], tables.between_local[slot], tables.between_past[slot], nodes.between_slopes, state.y
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
    return worst


@shared
def choose(problem: Problem, tables: Tables, state: State) -> int:
    """Fix the size and table slot of the next step: ACCEPTED, or END, TABLE, TOO_SMALL."""
    numbers, odd = state.numbers, len(tables.sizes) - 1
    left, h = problem.end - numbers[TIME], min(numbers[STEP], problem.limit)
    if left <= 0.0:
        return END
    slot = odd
    if h >= left * (1.0 - 1e-12):
        h = left
    else:
        slot = math.ceil(LADDER * math.log2(problem.span / h) - 1e-9)
        h = min(problem.span * 2.0 ** (-slot / LADDER), left)
        if 0.0 < left - h < 0.05 * h:  # no sliver at the end
            h, slot = (left if left <= problem.limit else 0.5 * left), odd
    if (h < problem.floor and left > problem.floor) or slot > odd:
        return TOO_SMALL
    numbers[STEP], numbers[SLOT] = h, slot
    return ACCEPTED if tables.sizes[slot, int(numbers[SINGULAR])] == h else TABLE


@shared
def next_step(problem, numbers, h, count):
    """The size to try after an accepted step: by the error, and growing geometrically away from the last jump."""
    size = h * min(2.0, max(0.3, 0.9 * max(numbers[ERROR], 1e-10) ** (-1.0 / (count + 1))))
    since = numbers[TIME] - numbers[JUMPED]
    return min(size, 2.0 * (since if since > 0.5 * h else h)) if len(problem.where) > 0 else size  # h: where time rounds it away


@separate
def accept(problem: Problem, nodes: Nodes, tables: Tables, state: State, values: Floats, record: Any, done: int) -> None:
    """Take the step that was found: record it, move state and memory, choose the next size."""
    numbers, count, n = state.numbers, len(values), len(state.y)
    h, slot, kind = numbers[STEP], int(numbers[SLOT]), int(numbers[SINGULAR])
    record.start[done], record.size[done], record.kind[done] = numbers[TIME], h, kind
    start, nodal = record.y, record.values  # copied by hand: array assignment allocates
    for a in range(n):
        start[done, a] = state.y[a]
        for k in range(count):
            nodal[done, k, a] = values[k, a]
    where, memory, jumps, moments, decay = problem.where, state.past, state.jump, tables.moments, tables.decay[slot]
    for a in range(len(where)):
        past, jump, place = memory[a], 0.0, where[a]
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
        numbers[FIRST] = h
    numbers[TIME] += h
    if abs(problem.end - numbers[TIME]) <= 1e-12 * h + 1e-15 * abs(numbers[TIME]):  # an end may be infinite
        numbers[TIME] = problem.end
    numbers[STEPS] += 1.0
    numbers[STEP] = next_step(problem, numbers, h, count)
    numbers[SINGULAR], numbers[SMOOTH] = 0.0, 1.0


@shared
def evaluate(m, state, times, states, rates, count):
    """`fun` at every row of `states`, nothing for what is at rest; whether all is finite."""
    for i in range(count):
        call(m.fun, times[i], states, i, rates, i, m.own)
        for a in range(len(m.held)):
            if m.held[a]:
                rates[i, a] = 0.0
    return checked(state, times, rates, count)


@shared
def checked(state, times, rates, count):
    """Count the calls; where they are not finite, note when and in which component."""
    state.numbers[CALLS] += count
    for i in range(count):
        for a in range(len(state.y)):
            if not math.isfinite(rates[i, a]):
                state.numbers[WHERE], state.numbers[WHAT] = times[i], a
                return False
    return True


@shared
def steepest(problem, state, force, rates):
    """The largest |rates − force| over the tolerance."""
    worst = 0.0
    for i in range(len(rates)):
        for a in range(len(state.y)):
            worst = max(worst, abs(rates[i, a] - force[i, a]) / (problem.atol + problem.rtol * abs(state.y[a]) + 1e-300))
    return worst


@shared
def newton(m, problem, nodes, tables, state, values, work):
    """Solve the stages into `values`: iterations, negative if it failed, 0 if fun was not finite."""
    h, slot, kind = state.numbers[STEP], int(state.numbers[SLOT]), int(state.numbers[SINGULAR])
    count, n = values.shape
    assemble(problem, nodes, tables, state, h, slot, kind, work)
    for i in range(count):
        work.times[i] = min(max(state.numbers[TIME] + nodes.c[i] * h, problem.first), problem.last)
        for a in range(n):
            work.states[i, a], values[i, a] = state.y[a], 0.0
    previous = math.inf
    for iteration in range(1, 11):
        if not evaluate(m, state, work.times, work.states, work.rates, count):
            return 0
        size, floor = correct(problem, tables.local[slot, kind], state, work, values)
        if not math.isfinite(size):
            return -iteration
        if size <= max(1e-3, floor):
            if iteration == 1 and size > floor and h * steepest(problem, state, work.force, work.rates) > 1.0:
                previous = size  # small, though y' is not: is that so, or is the Jacobian of another place?
                continue
            if iteration == 2 and size > max(0.5 * previous, 10.0 * floor):
                return -iteration
            return iteration
        if iteration > 2 and size > 0.9 * previous:
            return iteration if size <= max(0.1, 10.0 * floor) else -iteration  # stalled: rounding, well below the tolerance
        previous = size
    return -10


@separate
def differentiate(m, problem, state, work):
    """∂fun/∂y by forward differences at the step's start; whether it is finite."""
    n, times = len(state.y), work.here_times
    states, rates = work.here, work.out
    for j in range(n + 1):
        times[j] = min(max(state.numbers[TIME], problem.first), problem.last)
        for a in range(n):
            states[j, a] = state.y[a]
    for j in range(n):
        states[j + 1, j] += 1.5e-8 * max(abs(state.y[j]), problem.atol + problem.rtol, 1e-8)
    if not evaluate(m, state, times, states, rates, n + 1):
        return False
    for j in range(n):
        for a in range(n):
            state.jacobian[a, j] = (rates[j + 1, a] - rates[0, a]) / (states[j + 1, j] - state.y[j])
    return True


@shared
def judge(problem: Problem, state: State, error: float, power: float) -> int:
    """ACCEPTED or TOO_MANY; AGAIN after setting the next step to try, for an error that falls as step^power."""
    numbers = state.numbers
    if error <= 1.0:
        if numbers[STEPS] >= problem.max_steps:
            return TOO_MANY
        numbers[ERROR] = error
        return ACCEPTED
    h = numbers[STEP]
    numbers[STEP] = h * max(0.1, 0.8 * error ** (-1.0 / power)) if math.isfinite(error) else 0.25 * h
    return AGAIN


@shared
def attempt(m, problem, nodes, tables, state, values, work):
    """Find the next step that keeps the tolerance: node values into `values`, its size in numbers[STEP]; ACCEPTED or why not."""
    numbers, count = state.numbers, len(nodes.c)
    while True:
        code = choose(problem, tables, state)
        if code != ACCEPTED:
            return code
        iterations = -1
        for trial in range(2):
            if numbers[KNOWN] == 0.0 or trial == 1:
                if not differentiate(m, problem, state, work):
                    return NOT_FINITE
                numbers[KNOWN] = 1.0
            iterations = newton(m, problem, nodes, tables, state, values, work)
            if abs(iterations) > 4:
                numbers[KNOWN] = 0.0  # of another place by now
            if iterations >= 0:
                break
        if iterations == 0:
            return NOT_FINITE
        h, error, power = numbers[STEP], math.inf, float(count)
        if iterations > 0 and numbers[SINGULAR] == 1.0:
            power = 0.5 * (count + 1)
            states_between(nodes, state, values, work.states)
            for i in range(count):
                work.times[i] = min(max(numbers[TIME] + h * nodes.between[i] ** 2, problem.first), problem.last)
            if not evaluate(m, state, work.times, work.states, work.rates, count):
                return NOT_FINITE
            error = defect_error(problem, nodes, tables, state, h, int(numbers[SLOT]), values, work.rates)
        elif iterations > 0:
            error = decay_error(problem, nodes, state, h, values)
        code = judge(problem, state, error, power)
        if code != AGAIN:
            numbers[REFUSED] *= 0.5
            return code
        if numbers[SINGULAR] == 0.0:
            numbers[REFUSED] += 1.0
            if numbers[REFUSED] > 1.7:  # the size that the error asked for did not do: is fun smooth?
                numbers[REFUSED], numbers[TRIED] = 0.0, h
                return SUSPECT


class Attempt(NamedTuple):
    """What a step is found from."""

    m: Any
    problem: Any
    nodes: Any
    tables: Any
    state: Any
    values: Floats
    room: Any


def attempted(parts: Attempt, t: float, y: Any, out: Any, own: Any) -> None:
    """`attempt`, its code into out[0]."""
    out[0] = attempt(parts.m, parts.problem, parts.nodes, parts.tables, parts.state, parts.values, parts.room)


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


class Cut(NamedTuple):
    """Gauss points and weights on [0, 1] and how many decay times count, for the moments of a cut step."""

    x: Floats
    w: Floats
    decayed: float
    sums: Floats  # (stages + 1,), overwritten


@separate
def cut_memory(where: Any, nodes: Nodes, rates: Floats, cut: Cut, state: State, h: float, theta: float, kind: int, values: Floats) -> None:
    """Advance the exponentials to θ of the step, their moments by Gauss's rule over the last decay times."""
    count, members = len(nodes.c), len(where)
    basis = nodes.singular if kind == 1 else nodes.regular
    degrees = len(basis)
    sums = cut.sums
    past, jump, nodes_x, nodes_w = state.past, state.jump, cut.x, cut.w
    for q in range(len(rates)):
        z = rates[q] * h * theta
        share = min(1.0, cut.decayed / z) if z > 0.0 else 1.0
        low = math.sqrt(max(0.0, 1.0 - share))
        width = share / (1.0 + low) if kind == 1 else share
        for d in range(degrees):
            sums[d] = 0.0
        for p in range(len(nodes_x)):
            position = 1.0 - width * nodes_x[p]
            if kind == 1:
                factor = 2.0 * width * nodes_w[p] * math.sqrt(theta) * math.exp(-z * (1.0 - position) * (1.0 + position))
                x = 2.0 * position * math.sqrt(theta) - 1.0
                older, newer, slope = 1.0, x, 1.0  # P_0, P_1, P_1'
                before = 0.0
                sums[1] += factor
                for d in range(2, degrees):
                    older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
                    before, slope = slope, before + (2 * d - 1) * older  # P_d' = P_(d−2)' + (2d − 1) P_(d−1)
                    sums[d] += factor * slope
            else:
                factor = width * nodes_w[p] * h * theta * math.exp(-z * width * nodes_x[p])
                x = 2.0 * position * theta - 1.0
                older, newer = 1.0, x
                sums[0] += factor
                if degrees > 1:
                    sums[1] += factor * x
                for d in range(2, degrees):
                    older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
                    sums[d] += factor * newer
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


class Room(NamedTuple):
    """Work space of a march: all overwritten."""

    times: Floats  # (stage,)
    states: Floats  # (stage, state)
    rates: Floats  # (stage, state)
    force: Floats  # (stage, state)
    lead: Floats  # (stage, stage)
    carry: Floats  # (stage, stage)
    matrix: Floats  # (stage·state, stage·state)
    order: Any  # (stage·state,)
    residual: Floats  # (stage·state,)
    here_times: Floats  # (state + 1,)
    here: Floats  # (state + 1, state)
    out: Floats  # (state + 1, state)
    polynomial: Floats  # (degree + 1, state)
    before: Floats  # (state,)
    after: Floats
    still: Floats


@shared
def to_event(m, found, problem, nodes, cut, state, values, room, record, done, theta):
    """Take the step up to θ, where events happen, and start anew behind their jumps: PASSED, or why to stop."""
    numbers, y, count = state.numbers, state.y, len(nodes.c)
    h, kind = numbers[STEP], int(numbers[SINGULAR])
    record.start[done], record.size[done], record.kind[done], record.share[done] = numbers[TIME], h, kind, theta
    for a in range(len(y)):
        record.y[done, a] = y[a]
        for k in range(count):
            record.values[done, k, a] = values[k, a]
    all_at(room.polynomial, y, kind, theta, room.before)
    if theta > 0.0:
        cut_memory(problem.where, nodes, m.rates, cut, state, h, theta, kind, values)
    end = numbers[TIME] + h * theta
    if theta == 1.0 and abs(problem.end - end) <= 1e-12 * h + 1e-15 * abs(problem.end):
        end = problem.end
    numbers[TIME] = end
    numbers[STEPS] += 1.0
    numbers[SMOOTH] = 0.0
    if kind == 1:
        numbers[FIRST] = h
    events.copy(room.before, y)
    events.copy(room.before, record.before[done])
    leaps = False
    for j in range(found.count[0]):
        leaps = leaps or found.leaps[found.fired[j]]
    status = events.fire(m, found, end, room.before, room.after, room.still, events.REST * problem.span)
    record.leapt[done] = 1.0 if leaps else 0.0
    if leaps:
        for a in range(len(problem.where)):  # to what has not been felt yet, without a flight
            state.jump[a] += room.after[problem.where[a]] - room.before[problem.where[a]]
        for a in range(len(y)):
            y[a] = record.after[done, a] = room.after[a]
        flight = end - numbers[JUMPED]
        numbers[KNOWN], numbers[JUMPED] = 0.0, end
        numbers[STEP] = min(numbers[FIRST], 0.5 * flight) if flight > 0.0 else numbers[FIRST]
        numbers[SINGULAR] = 1.0 if len(problem.where) > 0 else 0.0
    return status


class Watch(NamedTuple):
    """What events on a step are found from."""

    m: Any
    found: Any
    problem: Any
    nodes: Any
    cut: Any
    state: Any
    values: Floats
    room: Any
    record: Any


def watched(parts: Watch, t: float, y: Any, out: Any, own: Any) -> None:
    """Into out[0]: ACCEPTED for a step without an event that cuts it; else the step is taken up to there, as number t of the record: FULL, or why to stop."""
    m, found, state = parts.m, parts.found, parts.state
    h, kind = state.numbers[STEP], int(state.numbers[SINGULAR])
    fit_polynomial(parts.nodes, kind, h, parts.values, parts.room.polynomial)
    theta = events.first_crossing(m, found, events.Step(state.numbers[TIME], h, kind, state.y, parts.room.polynomial), 1.0)
    status = events.PASSED
    out[0] = ACCEPTED
    if theta <= 1.0:
        out[0] = FULL
        status = to_event(m, found, parts.problem, parts.nodes, parts.cut, state, parts.values, parts.room, parts.record, int(t), theta)
    if found.trouble[0] != 0:
        out[0] = TROUBLE
    elif status != events.PASSED:
        out[0] = STOPPED if status == events.TERMINAL else LYING


watch_entry = entry(watched, "some 10 s")


def _make_march(digest: str) -> Callable[..., Any]:
    def march(attempt, watch, watching, problem, nodes, tables, state, values, logged, most, record, signal):
        """Take steps until something needs the caller; (code, steps recorded). `signal` (1, 1) is overwritten.

        `watching`: there are events, of which no more than `most` may be logged before a step.
        """
        digest  # noqa: B018 - part of the cache key
        done = 0
        while done < len(record.start) and logged[0] <= most:
            call(attempt, 0.0, signal, 0, signal, 0, signal)
            code = int(signal[0, 0])
            if code == ACCEPTED and watching:
                call(watch, float(done), signal, 0, signal, 0, signal)
                code = int(signal[0, 0])
            if code == ACCEPTED:
                accept(problem, nodes, tables, state, values, record, done)
                record.share[done], record.leapt[done] = 1.0, 0.0
            elif code != FULL:
                return code, done + (1 if code in (STOPPED, LYING) else 0)
            done += 1
        return FULL, done

    return march


march = compiled(_make_march, allocates=False, usually="some 5 s")


def room(stages: int, states: int) -> Room:
    """Work space of one march."""
    whole, n = stages * states, states
    shapes: list[Any] = [stages, (stages, n), (stages, n), (stages, n), (stages, stages), (stages, stages), (whole, whole), whole, whole, n + 1]
    shapes += [(n + 1, n), (n + 1, n), (stages + 1, n), n, n, n]
    arrays = [np.zeros(shape) for shape in shapes]
    arrays[7] = np.zeros(whole, dtype=np.int64)
    return Room(*arrays)
