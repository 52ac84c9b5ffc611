"""The inner loop of graded collocation: written once, run as plain Python for Python callables and compiled for compiled ones.

It comes back to its caller when a table for a new step size is missing, when its record is full, when it cannot go on, and at
the end; between these no Python is involved if `fun` is compiled. `fun` is (t, y) -> rates in plain Python and a C function
of (t, y, rates) in compiled code: the loop is compiled once for all of them and kept on disk.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from basset._compile import compiled, overloads, shared
from basset._stream import dot
from basset.kernels import Floats

END, TABLE, FULL, ACCEPTED, TOO_SMALL, TOO_MANY, NOT_FINITE, AGAIN, SUSPECT = range(9)
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
    """Accepted steps: start, size, kind, state at the start, node values."""

    start: Floats
    size: Floats
    kind: Floats
    y: Floats
    values: Floats


def _make_assemble(digest: str) -> Callable[..., Any]:
    def assemble(problem, nodes, tables, state, h, slot, kind):
        """(inverse, lead, carry, force): Newton's matrix, from the unknowns to y' and to y − y_n, and c·(memory before the step)."""
        digest  # noqa: B018 - part of the cache key
        count, n, m = len(nodes.c), len(state.y), len(problem.where)
        lead, carry = np.zeros((count, count)), np.zeros((count, count))
        for i in range(count):
            if kind == 1:
                carry[i, i] = 1.0
                lead[i] = nodes.slope[i] / h
            else:
                lead[i, i] = 1.0
                carry[i] = h * nodes.integral[i]
        matrix = np.zeros((count * n, count * n))
        for i in range(count):
            for k in range(count):
                for a in range(n):
                    for b in range(n):
                        matrix[i * n + a, k * n + b] = -carry[i, k] * state.jacobian[a, b]
                    matrix[i * n + a, k * n + a] += lead[i, k]
                for a in range(m):
                    place = problem.where[a]
                    matrix[i * n + place, k * n + place] += problem.strength[a] * tables.local[slot, kind, i, k]
        force = np.zeros((count, n))
        for i in range(count):
            for a in range(m):
                memory = dot(tables.past[slot, kind, i], 0, state.past[a], 0, state.past.shape[1])
                if kind == 1:
                    memory += tables.kernel[slot, i] * state.jump[a]
                force[i, problem.where[a]] = problem.strength[a] * memory
        return np.linalg.inv(matrix), lead, carry, force

    return assemble


assemble = compiled(_make_assemble)


def _make_correct(digest: str) -> Callable[..., Any]:
    def correct(problem, local, state, inverse, lead, carry, force, rates, states, unknown):
        """One Newton correction of `unknown` and `states`, in place: (its size, rounding) over the tolerance."""
        digest  # noqa: B018 - part of the cache key
        count, n = states.shape
        residual = force - rates
        for i in range(count):
            for k in range(count):
                for a in range(n):
                    residual[i, a] += lead[i, k] * unknown[k, a]
                for a in range(len(problem.where)):
                    residual[i, problem.where[a]] += problem.strength[a] * local[i, k] * unknown[k, problem.where[a]]
        unknown -= np.dot(inverse, residual.reshape(count * n)).reshape((count, n))
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

    return correct


correct = compiled(_make_correct)


def _make_decay(digest: str) -> Callable[..., Any]:
    def decay_error(problem, nodes, state, h, values):
        """Local error of a regular step over the tolerance, from the decay of its Legendre coefficients."""
        digest  # noqa: B018 - part of the cache key
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

    return decay_error


decay_error = compiled(_make_decay, allocates=False)


def _make_between(digest: str) -> Callable[..., Any]:
    def states_between(nodes, state, values, states):
        """States of a singular step halfway between its nodes in σ, where its defect is largest, into `states` (place, n)."""
        digest  # noqa: B018 - part of the cache key
        y, basis = state.y, nodes.between_values
        for i in range(len(values)):
            for a in range(len(y)):
                states[i, a] = y[a]
                for k in range(len(values)):
                    states[i, a] += basis[i, k] * values[k, a]

    return states_between


states_between = compiled(_make_between, allocates=False)


def _make_defect(digest: str) -> Callable[..., Any]:
    def defect_error(problem, nodes, tables, state, h, slot, values, rates):
        """∫ |y' − fun + c·H| over a singular step, over the tolerance; `rates` are used up."""
        digest  # noqa: B018 - part of the cache key
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

    return defect_error


defect_error = compiled(_make_defect, allocates=False)


def _make_choose(digest: str) -> Callable[..., Any]:
    def choose(problem, tables, state):
        """Fix the size and table slot of the next step: ACCEPTED, or END, TABLE, TOO_SMALL."""
        digest  # noqa: B018 - part of the cache key
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

    return choose


choose = compiled(_make_choose, allocates=False)


def _make_next_step(digest: str) -> Callable[..., Any]:
    def next_step(problem, numbers, h, count):
        """The size to try after an accepted step: by the error, and growing geometrically away from the last jump."""
        digest  # noqa: B018 - part of the cache key
        size = h * min(2.0, max(0.3, 0.9 * max(numbers[ERROR], 1e-10) ** (-1.0 / (count + 1))))
        since = numbers[TIME] - numbers[JUMPED]
        return min(size, 2.0 * (since if since > 0.5 * h else h)) if len(problem.where) > 0 else size  # h: where time rounds it away

    return next_step


next_step = compiled(_make_next_step, allocates=False)


def _make_accept(digest: str) -> Callable[..., Any]:
    def accept(problem, nodes, tables, state, values, record, done):
        """Take the step that was found: record it, move state and memory, choose the next size."""
        digest  # noqa: B018 - part of the cache key
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

    return accept


accept = compiled(_make_accept, allocates=False)


def evaluate(fun, state, times, states, rates):
    """`fun` at every row of `states`; whether all is finite."""
    for i in range(len(times)):
        rates[i] = fun(times[i], states[i])
    return checked(state, times, rates)


@overloads(evaluate)
def _evaluate_compiled(fun, state, times, states, rates):
    def evaluate(fun, state, times, states, rates):
        for i in range(len(times)):
            for a in range(states.shape[1]):
                rates[i, a] = states[i, a]  # fun may write into what it is given
            fun(times[i], rates[i].ctypes, rates[i].ctypes)
        return checked(state, times, rates)

    return evaluate


@shared
def checked(state, times, rates):
    """Count the calls; where they are not finite, note when and in which component."""
    state.numbers[CALLS] += len(times)
    for i in range(len(times)):
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
def newton(fun, problem, nodes, tables, state, values, rates):
    """Solve the stages into `values`: iterations, negative if it failed, 0 if fun was not finite."""
    h, slot, kind = state.numbers[STEP], int(state.numbers[SLOT]), int(state.numbers[SINGULAR])
    inverse, lead, carry, force = assemble(problem, nodes, tables, state, h, slot, kind)
    times = np.minimum(np.maximum(state.numbers[TIME] + nodes.c * h, problem.first), problem.last)
    states = np.zeros_like(values)
    states[:] = state.y
    values[:] = 0.0
    previous = math.inf
    for iteration in range(1, 11):
        if not evaluate(fun, state, times, states, rates):
            return 0
        size, floor = correct(problem, tables.local[slot, kind], state, inverse, lead, carry, force, rates, states, values)
        if not math.isfinite(size):
            return -iteration
        if size <= max(1e-3, floor):
            if iteration == 1 and size > floor and h * steepest(problem, state, force, rates) > 1.0:
                previous = size  # small, though y' is not: is that so, or is the Jacobian of another place?
                continue
            if iteration == 2 and size > max(0.5 * previous, 10.0 * floor):
                return -iteration
            return iteration
        if iteration > 2 and size > 0.9 * previous:
            return iteration if size <= max(0.1, 10.0 * floor) else -iteration  # stalled: rounding, well below the tolerance
        previous = size
    return -10


@shared
def differentiate(fun, problem, state):
    """∂fun/∂y by forward differences at the step's start; whether it is finite."""
    n, t = len(state.y), min(max(state.numbers[TIME], problem.first), problem.last)
    states, rates = np.zeros((n + 1, n)), np.zeros((n + 1, n))
    for j in range(n + 1):
        states[j] = state.y
    for j in range(n):
        states[j + 1, j] += 1.5e-8 * max(abs(state.y[j]), problem.atol + problem.rtol, 1e-8)
    if not evaluate(fun, state, np.full(n + 1, t), states, rates):
        return False
    for j in range(n):
        state.jacobian[:, j] = (rates[j + 1] - rates[0]) / (states[j + 1, j] - state.y[j])
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
def attempt(fun, problem, nodes, tables, state, values):
    """Find the next step that keeps the tolerance: node values into `values`, its size in numbers[STEP]; ACCEPTED or why not."""
    numbers, count = state.numbers, len(nodes.c)
    rates = np.zeros_like(values)
    while True:
        code = choose(problem, tables, state)
        if code != ACCEPTED:
            return code
        iterations = -1
        for trial in range(2):
            if numbers[KNOWN] == 0.0 or trial == 1:
                if not differentiate(fun, problem, state):
                    return NOT_FINITE
                numbers[KNOWN] = 1.0
            iterations = newton(fun, problem, nodes, tables, state, values, rates)
            if abs(iterations) > 4:
                numbers[KNOWN] = 0.0  # of another place by now
            if iterations >= 0:
                break
        if iterations == 0:
            return NOT_FINITE
        h, error, power = numbers[STEP], math.inf, float(count)
        if iterations > 0 and numbers[SINGULAR] == 1.0:
            power = 0.5 * (count + 1)
            states = np.zeros_like(values)
            states_between(nodes, state, values, states)
            times = np.minimum(np.maximum(numbers[TIME] + h * nodes.between**2, problem.first), problem.last)
            if not evaluate(fun, state, times, states, rates):
                return NOT_FINITE
            error = defect_error(problem, nodes, tables, state, h, int(numbers[SLOT]), values, rates)
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


def _make_attempt(digest: str) -> Callable[..., Any]:
    def compiled_attempt(fun, problem, nodes, tables, state, values):
        digest  # noqa: B018 - part of the cache key
        return attempt(fun, problem, nodes, tables, state, values)

    return compiled_attempt


def _make_march(digest: str) -> Callable[..., Any]:
    def march(fun, problem, nodes, tables, state, values, record):
        """Take steps until something needs the caller; (code, steps recorded)."""
        digest  # noqa: B018 - part of the cache key
        done = 0
        while done < len(record.start):
            code = attempt(fun, problem, nodes, tables, state, values)
            if code != ACCEPTED:
                return code, done
            accept(problem, nodes, tables, state, values, record, done)
            done += 1
        return FULL, done

    return march


attempt_compiled = compiled(_make_attempt)
march_compiled = compiled(_make_march, usually="some 10 s")
march = _make_march("")
