"""Events on a step: where their functions change sign, what their jumps do, which bodies come to rest and move again.

Written once, in the part of Python that numba compiles: it runs inside the compiled loops of `stepper` and `_fixed`, and as plain Python.
Event functions and jumps are called by `basset._compile.call`. Zeros by bounds on the derivatives of Chebyshev series: this library.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from basset._compile import Callbacks, Entry, c_function, call, filled, is_compiled, overloads, separate, shared
from basset.kernels import Floats
from basset.solvers.base import Task, returned
from basset.spectrum import Following, log_stretch_of, weight_ratio

CLEAR = 64.0  # roundings: an event function farther from zero than that has a sign
HALVINGS = 6  # of a step, at most, until an interpolant follows an event function
FOLLOWED = 1e-10  # to this share of its size
SUNK, STILL, NEAR = 4.0, 3, 1e4  # roundings by which a flight must be lower than the one before; so many that are not are rest; below so many roundings
REST = 1e-10  # a flight shorter than this share of the time span counts as rest
PASSED, TERMINAL, RESTING = 0, 1, 2  # what becomes of the run at an event
FUN_FAILED, EVENT_FAILED, JUMP_FAILED = 1, 2, 3  # what was not finite


class Events(NamedTuple):
    """One entry per event: SciPy's attributes, and the current state.

    `terminal`: the occurrence that ends the run, 0 for none. `number`, `last`: occurrences, and when the last one was. `side`: sign of the
    function before the last crossing. `fresh`: has just happened, the function is zero there but for `noise`, what rounding of time and
    states is worth in it. `bounced`: its jump did not let the state through; `reach`: how far the function has been on its side since,
    `before` the last jump; `level`: flights in a row that rounding alone decides, as high as the one before.
    `hit` (event, state): what its jump reversed or stopped, as it came, 0 in all other components. `resting`: the body is held, and
    the event is what draws it off. `again`: where on the step it may happen again. `fired` (event,): those that cut the step, in order,
    `count` of them. `found_at`, `found`: crossings on the step. `log_…`: occurrences, `logged` of them.
    `trouble` (what, event or component) and `trouble_at` (time): of the first value that was not finite.
    """

    terminal: Any
    direction: Floats
    leaps: Any
    number: Any
    last: Floats
    side: Floats
    noise: Floats
    reach: Floats
    before: Floats
    level: Any
    fresh: Any
    bounced: Any
    resting: Any
    candidate: Any
    hit: Floats
    again: Floats
    fired: Any
    count: Any
    found_at: Floats
    found: Any
    log_times: Floats
    log_states: Floats
    log_events: Any
    logged: Any
    trouble: Any
    trouble_at: Floats
    points: Floats  # Chebyshev points on [0, 1], rising
    transform: Floats  # from values there to coefficients
    values: Floats
    coefficients: Floats
    slope: Floats
    places: Floats
    signs: Floats
    stack: Floats  # (depth, 3)
    out: Floats  # (1, 1)


class Motion(NamedTuple):
    """What happens around events: fun, event functions, jumps; the members' places, coefficients, and those without bodies at rest; their
    memory as a sum of exponentials from the step's start on; components at rest; the times within which fun is asked; the span.
    """

    fun: Any
    functions: Any
    jumps: Any
    own: Floats
    where: Any
    coefficient: Floats
    felt: Floats
    weights: Floats
    rates: Floats
    past: Floats
    jump: Floats
    start: Floats  # (1,): of the step
    calls: Any  # (1,): of fun
    held: Any
    first: float
    last: float
    span: float
    following: Following
    rows: Floats  # (9, state): overwritten


class Step(NamedTuple):
    """A step that was found: start, size, whether it is a polynomial in √θ, its state at the start and its Legendre coefficients."""

    start: float
    size: float
    kind: int
    y: Floats
    polynomial: Floats


def entry_of(functions: Any, k: int) -> Any:
    """One of several functions to call."""
    return functions[k]


@overloads(entry_of)
def _entry_of(functions, k):
    def entry_of(functions, k):
        return Entry(functions[k, 0], functions[k, 1])

    return entry_of


@shared
def copy(source: Floats, target: Floats) -> None:
    """All of `source` into `target`."""
    for a in range(len(source)):
        target[a] = source[a]


@shared
def all_at(polynomial: Floats, y: Floats, kind: int, theta: float, row: Floats) -> None:
    """All states at θ into `row`; bit for bit as `stepper.at`."""
    x = 2.0 * (math.sqrt(theta) if kind == 1 else theta) - 1.0
    for a in range(len(y)):
        row[a] = y[a] + polynomial[0, a] + polynomial[1, a] * x
    older, newer = 1.0, x
    for d in range(2, len(polynomial)):
        older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
        for a in range(len(y)):
            row[a] += polynomial[d, a] * newer


@shared
def state_at(step: Step, theta: float, row: Floats) -> None:
    """All states at θ of the step, into `row`; at its start those that it started from."""
    if theta == 0.0:
        copy(step.y, row)
        return
    all_at(step.polynomial, step.y, step.kind, theta, row)


@shared
def fail(events: Events, what: int, which: int, t: float) -> None:
    """Note the first value that was not finite."""
    if events.trouble[0] == 0:
        events.trouble[0], events.trouble[1], events.trouble_at[0] = what, which, t


@separate
def free_rate(m: Motion, events: Events, t: float, y: Floats, out: Floats) -> None:
    """fun(t, y) into `out`; uses rows 0 and 1."""
    copy(y, m.rows[0])
    now = min(max(t, m.first), m.last)
    call(m.fun, now, m.rows, 0, m.rows, 1, m.own)
    m.calls[0] += 1
    for a in range(len(y)):
        out[a] = m.rows[1, a]
        if not math.isfinite(out[a]):
            fail(events, FUN_FAILED, a, now)


@separate
def subtract_memory(m: Motion, t: float, y: Floats, strength: Floats, rate: Floats) -> None:
    """Rate − strength·H in place, H at t in the states y if nothing has happened since the step's start; uses row 8."""
    lag, follows = t - m.start[0], len(m.following.values) > 0
    copy(y, m.rows[8])
    log_stretch = log_stretch_of(m.following, m.where, m.rows, 8) if follows else -math.inf
    for a in range(len(m.where)):
        total = 0.0
        for q in range(len(m.rates)):
            weight = m.weights[q] * math.exp(-m.rates[q] * lag)
            if log_stretch > -math.inf:
                weight *= weight_ratio(m.following, q, log_stretch)
            total += (m.past[a, q] + m.jump[a]) * weight
        rate[m.where[a]] -= strength[a] * total


@separate
def pull(m: Motion, events: Events, k: int, t: float, y: Floats) -> float:
    """What draws a body at rest off its surface where positive; uses rows 0 to 2 and 8."""
    rate = m.rows[2]
    free_rate(m, events, t, y, rate)
    subtract_memory(m, t, y, m.coefficient, rate)
    total, largest = 0.0, 0.0
    for a in range(len(y)):
        total -= events.hit[k, a] * rate[a]
        largest = max(largest, abs(events.hit[k, a]))
    found: float = total / largest
    return found


@shared
def value(m: Motion, events: Events, k: int, t: float, y: Floats) -> float:
    """The event function; of a body at rest what draws it off."""
    if events.resting[k]:
        return pull(m, events, k, t, y)
    copy(y, m.rows[0])
    call(entry_of(m.functions, k), t, m.rows, 0, events.out, 0, m.own)
    found: float = events.out[0, 0]
    if not math.isfinite(found):
        fail(events, EVENT_FAILED, k, t)
        return 0.0
    return found


@shared
def value_on(m: Motion, events: Events, k: int, step: Step, theta: float) -> float:
    """The event function at θ of the step."""
    state_at(step, theta, m.rows[3])
    return value(m, events, k, step.start + step.size * theta, m.rows[3])


@shared
def crosses(events: Events, k: int, before: float, after: float) -> bool:
    """Whether the change of sign from `before` to `after` counts."""
    if events.resting[k]:
        return before <= 0.0 < after
    if before == 0.0 or ((before > 0.0) == (after > 0.0) and after != 0.0):
        return False
    counts: bool = events.direction[k] == 0.0 or (events.direction[k] > 0.0) == (before < 0.0)
    return counts


@shared
def cuts(events: Events, k: int, times: int) -> bool:
    """Whether the occurrence of that number ends the step: a jump, the last one wanted, or a body drawn off."""
    ends: bool = events.leaps[k] or events.resting[k] or 0 < events.terminal[k] <= times
    return ends


@separate
def rounding(m: Motion, events: Events, k: int, t: float, y: Floats) -> float:
    """What rounding of time and states is worth in the event function there."""
    here, share, moved = value(m, events, k, t, y), 2.0**-26, m.rows[4]
    total = abs(value(m, events, k, t * (1.0 + share), y) - here)
    copy(y, moved)
    for a in range(len(y)):
        if y[a] != 0.0:
            moved[a] = y[a] * (1.0 + share)
            total += abs(value(m, events, k, t, moved) - here)
            moved[a] = y[a]
    return total * 2.0**-27  # half a unit in the last place of each


@shared
def series(coefficients: Floats, count: int, x: float) -> float:
    """A Chebyshev series at x (Clenshaw)."""
    newer, older = 0.0, 0.0
    for k in range(count - 1, 0, -1):
        newer, older = coefficients[k] + 2.0 * x * newer - older, newer
    total: float = coefficients[0] + x * newer - older
    return total


@separate
def turning_points(events: Events, count: int, low: float, high: float, first: int) -> int:
    """Where the series of `count` coefficients in events.slope changes sign, into events.places from `first` on, as x in [low, high]; how many.

    In φ = arccos x the second derivative is at most Σ k²|c_k|: what the chord leaves no room for is passed over.
    """
    slope, stack = events.slope, events.stack
    bound, whole = 0.0, 0.0
    for k in range(count):
        bound += k * k * abs(slope[k])
        whole += abs(slope[k])
    room = len(events.values) - len(events.points)  # a slope has no more roots than that, but rounding may
    found, depth = 0, 1
    stack[0, 0], stack[0, 1] = 0.0, math.pi
    while depth > 0:
        depth -= 1
        one, two = stack[depth, 0], stack[depth, 1]
        before, after = series(slope, count, math.cos(math.pi - one)), series(slope, count, math.cos(math.pi - two))
        sag = bound * (two - one) ** 2 / 8.0
        alike = (before > 0.0) == (after > 0.0)
        if (alike and min(abs(before), abs(after)) > sag) or max(abs(before), abs(after)) <= 1e-15 * whole or found == room:
            continue
        middle = 0.5 * (one + two)
        if two - one < 1e-6 or depth + 2 > len(stack) // 2:
            if not alike:
                events.places[first + found] = low + (high - low) * 0.5 * (1.0 - math.cos(middle))
                found += 1
            continue
        stack[depth, 0], stack[depth, 1] = middle, two
        stack[depth + 1, 0], stack[depth + 1, 1] = one, middle
        depth += 2
    return found


@shared
def watch_leaf(m: Motion, events: Events, k: int, step: Step, low: float, high: float, halvings: int, done: int) -> int:
    """Places and signs of [low, high] after the first `done`, from an interpolant; −1 if the interval has to be halved."""
    degree, power = len(events.points) - 1, 2 if step.kind == 1 else 1
    points, values, coefficients = events.points, events.values, events.coefficients
    for i in range(degree + 1):
        x = low + (high - low) * points[i]
        values[i] = value_on(m, events, k, step, x**power)
    rest, largest = 0.0, 0.0
    for i in range(degree + 1):
        total = 0.0
        for j in range(degree + 1):
            total += events.transform[i, j] * values[j]
        coefficients[i] = total
        largest = max(largest, abs(total))
        rest += abs(total) if i > 0 else 0.0
    simple = abs(coefficients[0]) > 1.5 * rest  # far from zero
    if not simple:
        tail = max(abs(coefficients[degree]), abs(coefficients[degree - 1]))
        if tail > FOLLOWED * largest:
            state_at(step, 0.0, m.rows[5])
            if tail > CLEAR * rounding(m, events, k, step.start, m.rows[5]):
                if halvings > 0:
                    return -1
                simple = True
    turns = 0
    start = done - 1 if done > 0 else 0  # the end of the one before is the beginning of this one
    if not simple and 0.0 < largest < math.inf:
        count = degree + 1
        while count > 1 and abs(coefficients[count - 1]) <= 1e-13 * largest:
            count -= 1
        # c'_(k−1) = c'_(k+1) + 2k c_k
        slope, others = events.slope, 0.0
        for i in range(count + 1):
            slope[i] = 0.0
        for i in range(count - 1, 0, -1):
            slope[i - 1] = (slope[i + 1] if i + 1 < count else 0.0) + 2.0 * i * coefficients[i]
        slope[0] *= 0.5
        for i in range(1, count - 1):
            others += abs(slope[i])
        if count > 1 and not abs(slope[0]) > others:
            turns = turning_points(events, count - 1, low, high, start + degree + 1)
    # merge the points with the turning points, both rising
    places, signs = events.places, events.signs
    for j in range(turns):
        events.values[degree + 1 + j] = places[start + degree + 1 + j]
    i, j, at = 0, 0, start
    while i <= degree or j < turns:
        x = low + (high - low) * points[i] if i <= degree else math.inf
        turn = events.values[degree + 1 + j] if j < turns else math.inf
        if x <= turn:
            places[at], signs[at] = x**power, values[i]
            i += 1
        else:
            places[at], signs[at] = turn**power, value_on(m, events, k, step, turn**power)
            j += 1
        at += 1
    return at


@shared
def watched(m: Motion, events: Events, k: int, step: Step, most: float) -> int:
    """Places on the step up to θ = `most` between which the event function rises or falls and its values there; how many.

    Where an interpolant in θ, of a singular step in √θ, does not follow it, the step is halved, and at last signs of samples must do.
    """
    stack, base = events.stack, len(events.stack) // 2  # the upper half: turning points use the lower one
    stack[base, 0], stack[base, 1], stack[base, 2] = 0.0, math.sqrt(most) if step.kind == 1 else most, HALVINGS
    depth, done = 1, 0
    while depth > 0:
        depth -= 1
        low, high, halvings = stack[base + depth, 0], stack[base + depth, 1], int(stack[base + depth, 2])
        at = watch_leaf(m, events, k, step, low, high, halvings, done)
        if at >= 0:
            done = at
            continue
        middle = 0.5 * (low + high)
        stack[base + depth, 0], stack[base + depth, 1], stack[base + depth, 2] = middle, high, halvings - 1
        stack[base + depth + 1, 0], stack[base + depth + 1, 1], stack[base + depth + 1, 2] = low, middle, halvings - 1
        depth += 2
    return done


@shared
def between(i: int, low: float, value_low: float, high: float, value_high: float) -> float:
    """The next guess of a zero in a bracket: that of regula falsi, each fourth time and where that leaves it the middle; `low` if it is narrow enough."""
    if high - low <= 4e-16 * high:
        return low
    guess = (low * value_high - high * value_low) / (value_high - value_low) if i % 4 != 3 else 0.5 * (low + high)
    if not low < guess < high:
        guess = 0.5 * (low + high)
    return guess if low < guess < high else low


@shared
def narrowed(low: float, value_low: float, high: float, value_high: float, side: int, guess: float, value: float) -> tuple[float, float, float, float, int]:
    """The bracket with `guess` as one of its ends; the value of an end that stays for the second time is halved (Illinois)."""
    if (value > 0.0) == (value_low > 0.0):
        return guess, value, high, 0.5 * value_high if side == 1 else value_high, 1
    return low, 0.5 * value_low if side == -1 else value_low, guess, value, -1


@separate
def root(m: Motion, events: Events, k: int, step: Step, low: float, high: float, after: float) -> float:
    """θ of the crossing between two places."""
    value_low, value_high = value_on(m, events, k, step, low), value_on(m, events, k, step, high)
    if after == 0.0 or value_high == 0.0:
        return high
    if (value_low > 0.0) == (value_high > 0.0):  # so close to zero that rounding decides
        return low if abs(value_low) < abs(value_high) else high
    side, true_low, true_high = 0, abs(value_low), abs(value_high)
    for i in range(200):
        guess = between(i, low, value_low, high, value_high)
        if guess == low:
            break
        found = value_on(m, events, k, step, guess)
        if found == 0.0:
            return guess
        low, value_low, high, value_high, side = narrowed(low, value_low, high, value_high, side, guess, found)
        true_low, true_high = (abs(found), true_high) if side == 1 else (true_low, abs(found))
    return low if true_low < true_high else high


@shared
def insert(events: Events, found: int, theta: float, k: int) -> None:
    """One more crossing into the `found` ones, in the order of θ."""
    at = found
    while at > 0 and events.found_at[at - 1] > theta:
        events.found_at[at], events.found[at] = events.found_at[at - 1], events.found[at - 1]
        at -= 1
    events.found_at[at], events.found[at] = theta, k


@shared
def search(m: Motion, events: Events, k: int, step: Step, most: float, found: int) -> int:
    """Crossings of one event on the step up to θ = `most`, added to the `found` ones; how many there are. −1: a jump left no flight."""
    done = watched(m, events, k, step, most)
    places, signs = events.places, events.signs
    first = 0
    if events.fresh[k]:
        largest = 0.0
        for i in range(done):
            largest = max(largest, abs(signs[i]))
        noise, side = events.noise[k] + 2.0**-46 * largest, events.side[k]
        if events.bounced[k]:  # from where the flight has begun; without one it rests
            if signs[1] * side <= CLEAR * noise:
                sooner, extra = places[1], 40
                for i in range(done - 1, 0, -1):
                    places[i + extra], signs[i + extra] = places[i], signs[i]
                for i in range(extra):
                    places[1 + i] = sooner * 1e-12 * (0.5e12) ** (i / (extra - 1.0))
                    signs[1 + i] = value_on(m, events, k, step, places[1 + i])
                done += extra
            first = 1
            while first < done and not signs[first] * side > CLEAR * noise:
                first += 1
            if first == done:
                return -1
        else:  # from where it is no longer zero
            first = 1
            while first < done and not abs(signs[first]) > CLEAR * noise:
                first += 1
    events.again[k] = places[first] if first < done else math.inf
    last = done
    for i in range(first, done - 1):
        if crosses(events, k, signs[i], signs[i + 1]):
            before = signs[i]
            theta = root(m, events, k, step, places[i], places[i + 1], signs[i + 1])
            insert(events, found, theta, k)
            found += 1
            if not events.resting[k]:
                events.side[k] = math.copysign(1.0, before)
            if cuts(events, k, 1):
                last = i + 1
                break
    if events.bounced[k]:
        for i in range(first, last):
            events.reach[k] = max(events.reach[k], signs[i] * events.side[k])
    return found


@shared
def record(events: Events, k: int, t: float, y: Floats) -> None:
    """Note that an event has happened."""
    at = events.logged[0]
    events.log_times[at], events.log_events[at] = t, k
    copy(y, events.log_states[at])
    events.logged[0] += 1
    events.number[k] += 1
    events.last[k] = t


@shared
def first_crossing(m: Motion, events: Events, step: Step, most: float) -> float:
    """θ ≤ `most` of the first crossing that cuts the step, by events.fired; 2 if none does, 0 if a jump left no flight.

    Crossings that do not cut are recorded on the way.
    """
    found = 0
    for k in range(len(events.side)):
        done = search(m, events, k, step, most, found)
        if done < 0:
            events.fired[0], events.count[0] = k, 1
            return 0.0
        found = done
    cut, together = 2.0, 0
    for i in range(found):
        theta, k = events.found_at[i], events.found[i]
        if theta > cut * (1.0 + 1e-13):
            break
        times = events.number[k] + 1
        if cuts(events, k, times):
            cut = min(cut, theta)
            events.fired[together] = k
            together += 1
            continue
        state_at(step, theta, m.rows[3])
        record(events, k, step.start + step.size * theta, m.rows[3])
    events.count[0] = together
    for k in range(len(events.side)):
        events.fresh[k] = events.fresh[k] and cut <= events.again[k]
    return cut


@separate
def trend(m: Motion, events: Events, k: int, t: float, y: Floats) -> float:
    """Change of the event function over a short time; 0 where rounding hides it or it is of second order."""
    rate, moved = m.rows[6], m.rows[4]
    free_rate(m, events, t, y, rate)
    for a in range(len(y)):
        if m.held[a]:
            rate[a] = 0.0
    here = value(m, events, k, t, y)
    ahead = max(1e-8 * m.span, 1024.0 * 2.0**-52 * abs(t))
    while ahead <= 1e-2 * m.span:
        for a in range(len(y)):
            moved[a] = y[a] + ahead * rate[a]
        one = value(m, events, k, t + ahead, moved) - here
        for a in range(len(y)):
            moved[a] = y[a] + 2.0 * ahead * rate[a]
        two = value(m, events, k, t + 2.0 * ahead, moved) - here
        for a in range(len(y)):
            moved[a] = y[a] + 4.0 * ahead * rate[a]
        four = value(m, events, k, t + 4.0 * ahead, moved) - here
        if one != 0.0 and abs(two - 2.0 * one) <= 0.25 * abs(two) and abs(four - 2.0 * two) <= 0.25 * abs(four):
            return one
        ahead *= 32.0
    return 0.0


@separate
def jumped(m: Motion, events: Events, k: int, t: float, y: Floats, after: Floats) -> None:
    """The state after the event's jump; uses rows 0 and 1."""
    copy(y, m.rows[0])
    call(entry_of(m.jumps, k), t, m.rows, 0, m.rows, 1, m.own)
    for a in range(len(y)):
        after[a] = m.rows[1, a]
        if not math.isfinite(after[a]):
            fail(events, JUMP_FAILED, k, t)


@separate
def hold(m: Motion, events: Events) -> None:
    """Update which components are at rest."""
    for a in range(len(m.held)):
        still = False
        for k in range(len(events.side)):
            still = still or (events.resting[k] and events.hit[k, a] != 0.0)
        m.held[a] = still
    for a in range(len(m.where)):
        m.felt[a] = 0.0 if m.held[m.where[a]] else m.coefficient[a]


@separate
def settle(m: Motion, events: Events, k: int, t: float, before: Floats, after: Floats) -> None:
    """Update the event after its jump."""
    here = value(m, events, k, t, after)
    events.noise[k], events.reach[k] = rounding(m, events, k, t, after), 0.0
    events.fresh[k] = abs(here) <= CLEAR * events.noise[k] + 2.0 * abs(value(m, events, k, t, before))
    events.bounced[k] = (trend(m, events, k, t, after) if events.fresh[k] else here) * events.side[k] >= 0.0


@separate
def rests(m: Motion, events: Events, k: int, t: float, y: Floats) -> bool:
    """Hold what the event's jump reverses or stops, in place; False if that is not all it does or would not stay."""
    incoming, after = m.rows[5], m.rows[7]
    any_stopped = False
    for a in range(len(y)):
        stopped = events.hit[k, a] != 0.0
        any_stopped = any_stopped or stopped
        incoming[a] = events.hit[k, a] if stopped else y[a]
        if stopped:
            y[a] = 0.0
    jumped(m, events, k, t, incoming, after)
    for a in range(len(y)):
        if events.hit[k, a] == 0.0 and abs(after[a] - incoming[a]) > 1e-14 * abs(y[a]):
            return False  # friction
    if trend(m, events, k, t, y) != 0.0:
        return False  # a surface that moves
    if not any_stopped or pull(m, events, k, t, y) > 0.0:
        return False
    events.resting[k], events.fresh[k] = True, False
    return True


@shared
def fire(m: Motion, events: Events, t: float, y: Floats, after: Floats, still: Floats, moment: float) -> int:
    """Record the fired events at (t, y), apply their jumps in turn, let bodies rest and go: PASSED, TERMINAL or RESTING.

    The state after into `after`; `still` is overwritten. `moment`: the shortest flight there is.
    """
    status, some = PASSED, False
    copy(y, after)
    for j in range(events.count[0]):
        k = events.fired[j]
        events.candidate[k] = False
        if events.resting[k]:  # drawn off
            events.resting[k], events.fresh[k], events.reach[k] = False, True, 0.0
            events.fired[j] = -1 - k
            continue
        since = t - events.last[k]
        record(events, k, t, after)
        if events.leaps[k]:
            copy(after, still)
            jumped(m, events, k, t, still, after)
            if since > 0.0:
                for a in range(len(y)):
                    stopped = after[a] != still[a] and after[a] * still[a] <= 0.0
                    events.hit[k, a] = still[a] if stopped else 0.0
            lower = events.before[k] - events.reach[k] > SUNK * events.noise[k] or events.reach[k] > NEAR * events.noise[k]
            events.before[k], events.level[k] = events.reach[k], 0 if lower else events.level[k] + 1
            resolved = events.reach[k] > CLEAR * events.noise[k] and events.level[k] < STILL
            events.candidate[k] = events.bounced[k] and (since < moment or not resolved)
            some = some or events.candidate[k]
        if 0 < events.terminal[k] <= events.number[k]:
            status = TERMINAL
    for k in range(len(events.side)):
        if events.resting[k]:
            set_going = False
            for a in range(len(y)):
                set_going = set_going or (events.hit[k, a] != 0.0 and after[a] != 0.0)
            if set_going:  # the jump of another one has set it going
                events.resting[k], events.fresh[k], events.reach[k] = False, True, 0.0
    hold(m, events)
    for j in range(events.count[0]):
        k = events.fired[j]
        if k >= 0 and events.leaps[k]:
            settle(m, events, k, t, y, after)
    if not some or status != PASSED:
        return status
    copy(after, still)
    held = True
    for j in range(events.count[0]):
        k = events.fired[j]
        held = held and (k < 0 or not events.candidate[k] or rests(m, events, k, t, still))
    if held:
        hold(m, events)
        moves = False
        for k in range(len(events.side)):
            moves = moves or (events.leaps[k] and not events.resting[k])
        left = m.rows[6]
        free_rate(m, events, t, still, left)
        for a in range(len(y)):
            if m.held[a]:
                left[a] = 0.0
        subtract_memory(m, t, still, m.felt, left)
        for a in range(len(y)):
            moves = moves or left[a] != 0.0
        if moves:
            copy(still, after)
            return PASSED
    return RESTING


@lru_cache(maxsize=32)
def chebyshev(degree: int) -> tuple[Floats, Floats]:
    """Chebyshev's points on [0, 1], and the matrix from values there to coefficients."""
    points = np.sin(np.pi * (np.arange(degree + 1) / degree - 0.5))
    return 0.5 * (points + 1.0), np.linalg.inv(np.polynomial.chebyshev.chebvander(points, degree))


def events_of(specified: Any, states: int, degree: int) -> Events:
    """Room for events, none of which has happened; `specified` have terminal, direction and jump."""
    m = len(specified)
    most = (2**HALVINGS * (2 * degree + 2) + 64) if m else 1
    floats, flags, whole = np.zeros, partial(np.zeros, dtype=np.bool_), partial(np.zeros, dtype=np.int64)
    return Events(
        np.array([event.terminal for event in specified], dtype=np.int64), np.array([event.direction for event in specified], dtype=np.float64),
        np.array([event.jump is not None for event in specified], dtype=np.bool_), whole(m), np.full(m, -math.inf), floats(m), floats(m), floats(m),
        floats(m), whole(m), flags(m), flags(m), flags(m), flags(m), floats((m, states)), floats(m), whole(m), whole(1), floats(m * most), whole(m * most),
        floats(2 * m * most), floats((2 * m * most, states)), whole(2 * m * most), whole(1), whole(2), floats(1), *chebyshev(degree),
        floats(2 * degree + 2), floats(degree + 1), floats(degree + 2), floats(most), floats(most), floats((256, 3)), floats((1, 1)),
    )  # fmt: skip


def entries(functions: list[Any]) -> Any:
    """Functions to call, for `entry_of`: a table of their entries, or plain ones as they are."""
    if all(isinstance(function, Entry) for function in functions):
        return np.array(functions, dtype=np.int64).reshape(len(functions), 2)
    return functions


class Bound(NamedTuple):
    """`fun`, event functions and jumps as something to `call`; what keeps the errors of plain ones; where the arguments of compiled ones lie."""

    fun: Any
    functions: list[Any]
    jumps: list[Any]
    calls: Callbacks
    arguments: Any  # (function, argument + state), in words


def bound(task: Task) -> Bound:
    """What a task calls: C functions of compiled ones.

    Compiled code does not look at what it is given: what compiled events and jumps return is checked here. It counts its own
    evaluations of `fun`.
    """
    n, calls = len(task.y0), Callbacks()
    arguments = np.zeros((1 + 2 * len(task.events), len(task.data or ()) + n), dtype=np.int64)
    tables = iter(arguments)

    def entry_of(function: Any, checked: Any, results: int, number: bool = False) -> Any:
        if is_compiled(function) and task.data is not None:
            try:
                return c_function(function, task.data, next(tables), number)
            except TypeError:  # an argument that is no data: a compiled fun cannot do without, events can
                if function is task.function:
                    raise
        return calls.entry(checked, n, results)

    for event in task.events:
        if is_compiled(event.function):
            event.value(task.start, task.y0)
        if event.jump is not None and is_compiled(event.jump):
            returned(f"jump of event {event.index} must return {n} states", event.jump(task.start, task.y0.copy(), *event.args), n)
    functions = [entry_of(event.function, event.value, 1, True) for event in task.events]
    return Bound(entry_of(task.function, task.free, n), functions, [entry_of(event.jump, event.after, n) for event in task.events], calls, arguments)


def trouble(found: Events) -> str:
    """The message for the first value that was not finite."""
    kind, which, t = found.trouble[0], found.trouble[1], found.trouble_at[0]
    what = {FUN_FAILED: "fun was not finite in component", EVENT_FAILED: "event", JUMP_FAILED: "jump of event"}[int(kind)]
    return f"{what} {which} at t = {t:.6g}" if kind == FUN_FAILED else f"{what} {which} was not finite at t = {t:.6g}"


def plain(specified: Any) -> tuple[list[Any], list[Any]]:
    """Event functions and jumps to call without compiled code."""
    return [partial(filled, event.value) for event in specified], [partial(filled, event.after) for event in specified]


@shared
def forget(events: Events) -> None:
    """Nothing has happened; the log stays."""
    for k in range(len(events.side)):
        events.number[k], events.last[k], events.side[k], events.noise[k], events.reach[k], events.again[k] = 0, -math.inf, 0.0, 0.0, 0.0, 0.0
        events.before[k], events.level[k] = 0.0, 0
        events.fresh[k] = events.bounced[k] = events.resting[k] = events.candidate[k] = False
        for a in range(events.hit.shape[1]):
            events.hit[k, a] = 0.0
    events.count[0] = events.trouble[0] = events.trouble[1] = 0
    events.trouble_at[0] = 0.0


def take_log(found: Events, specified: Any) -> None:
    """Move what has happened into the lists of the events."""
    for i in range(int(found.logged[0])):
        event = specified[found.log_events[i]]
        event.times.append(float(found.log_times[i]))
        event.states.append(found.log_states[i].copy())
    found.logged[0] = 0
