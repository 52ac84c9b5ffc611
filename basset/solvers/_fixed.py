"""The loop of fixed steps: implicit on rates or on slips, or with the history held over the step; compiled once for all equations.

It returns to its caller at the node where it was to stop, when its record is full, when it cannot go on, and when `look`, which
is called after every step, asks for it. `fun` and `look` are called by `basset._compile.call`. Jumps of the memory are its caller's.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, compiled, entry, overloads, separate, shared
from basset.kernels import Floats
from basset.solvers import events
from basset.solvers.events import copy
from basset.solvers.stability import ALTERNATING, GEOMETRIC, IN_A_ROW, SHARE, adams_moulton
from basset.solvers.stepper import ACCEPTED, AT_REST, END, FULL, NOT_FINITE, STOPPED, TROUBLE, factor, substitute
from basset.streaming import Plan
from basset.streaming import State as Samples
from basset.streaming._loops import peek, take
from basset.streaming.following import FollowingPlan, SlipStream, accept, look_at

HELD, RATES, SLIPS = range(3)  # the history held constant over the step; or implicit, with samples of rates or of slips
UNRESOLVED = 1e-12  # of a state: Newton's method leaves 1e-14, and what it leaves may alternate
UNSOLVED, DIVERGED = 30, 31  # why the loop returned, beside the codes of `stepper`

# places in State.numbers: nodes so far, rows of the record that are filled, rates of the current segment (up to
# as many as are kept), rates that alternated and grew in a row, rates looked at for that, for how many steps Newton's matrix has served
# (0: none is known), whether the caller has a jump to take; calls of fun, when and in which component it was not finite
NODE, DONE, KNOWN, GROWN, SEEN, MATRIX, LEAPT, CALLS, WHERE, WHAT = range(10)


class Equation(NamedTuple):
    """`fun` and its work space, the components in memory and their coefficients, components at rest, the times within which `fun` is evaluated."""

    fun: Any
    own: Floats
    where: Any
    strength: Floats
    held: Any
    first: float
    last: float


class Grid(NamedTuple):
    """The nodes, start + k dt up to `end` as number `nodes`; the method.

    Weights of Adams and Moulton by degree, newest first; for the nodes of a new segment that are solved together, in units of
    dt and √dt: ∫_0^i L_j and ∫_0^i K(i−s) L_j(s) ds, (node, sample), without rows if each step is taken alone. `limited`: too
    long a step diverges.
    """

    start: float
    end: float
    dt: float
    nodes: int
    kind: int
    weights: Floats
    plain: Floats
    history: Floats
    limited: int


class Stream(NamedTuple):
    """A plan of the history and its state, as arrays."""

    samples: Floats
    terms: Floats
    future: Floats
    history: Floats
    counters: Floats
    slots: int
    steady: int
    short: Floats
    oldest: Floats
    interior: Floats
    fixed: Floats
    loss: Floats
    gains: Floats
    entry: Floats


class State(NamedTuple):
    """What changes: states; rates of the current segment, newest first, (rate, state); for samples of slips their offset from the states
    and ∫K y at the newest node; the newest five rates of the path and what of them alternated before; state and rate before the newest
    step; numbers.
    """

    y: Floats
    recent: Floats
    offset: Floats
    stored: Floats
    seen: Floats
    swing: Floats
    before: Floats
    numbers: Floats


class Room(NamedTuple):
    """Unknowns of `nodes` at once and what their equation is made of; all overwritten."""

    unknown: Floats  # (node·state,)
    left: Floats
    shifted: Floats
    other: Floats
    matrix: Floats  # (node·state, node·state)
    order: Any
    known: Floats  # (node, state)
    states: Floats
    rates: Floats
    ahead: Floats  # (node, node)
    inner: Floats
    past: Floats  # (node, member)
    stages: Floats  # (5, state)
    tail: Floats  # (member,)
    sample: Floats


class Record(NamedTuple):
    """Nodes: time, states and rates."""

    times: Floats
    states: Floats
    rates: Floats


class Parts(NamedTuple):
    """All that a step reads and writes; `look` is called where `looking`."""

    equation: Equation
    grid: Grid
    stream: Stream | SlipStream
    state: State
    alone: Room
    together: Room
    record: Record
    look: Any
    looking: int
    signal: Floats  # (1, 1)


@shared
def evaluate(e, numbers, t, states, i, rates, k):
    """`fun` at row i of `states` into row k of `rates`, nothing for what is at rest; whether it is finite."""
    now = min(max(t, e.first), e.last)
    call(e.fun, now, states, i, rates, k, e.own)
    numbers[CALLS] += 1.0
    held = e.held
    for a in range(len(held)):
        if not math.isfinite(rates[k, a]):
            numbers[WHERE], numbers[WHAT] = now, a
            return False
        if held[a]:
            rates[k, a] = 0.0
    return True


@shared
def set_states(kind, room, unknown):
    """The states at the coming nodes."""
    known, states, ahead = room.known, room.states, room.ahead
    count, n = states.shape
    for i in range(count):
        for a in range(n):
            total = unknown[i * n + a]
            if kind == RATES:
                total = known[i, a]
                for j in range(count):
                    total += ahead[i, j] * unknown[j * n + a]
            states[i, a] = total


@separate
def residual(parts, room, unknown, left):
    """What the equations of the coming nodes leave at `unknown`, into `left`; whether `fun` was finite."""
    e, grid, state = parts.equation, parts.grid, parts.state
    known, states, rates, ahead, inner, past = room.known, room.states, room.rates, room.ahead, room.inner, room.past
    kind, where, strength, offset, stored = grid.kind, e.where, e.strength, state.offset, state.stored
    count, n = states.shape
    set_states(kind, room, unknown)
    follow(parts.stream, where, room)
    for i in range(count):
        if not evaluate(e, state.numbers, grid.start + grid.dt * (state.numbers[NODE] + 1.0 + i), states, i, rates, i):
            return False
    for i in range(count):
        for a in range(n):
            total = unknown[i * n + a]
            if kind == RATES:
                total -= rates[i, a]
            else:
                total -= known[i, a]
                for j in range(count):
                    total -= ahead[i, j] * rates[j, a]
            left[i * n + a] = total
        for b in range(len(where)):
            total, place = past[i, b], where[b]
            for j in range(count):
                total += inner[i, j] * (unknown[j * n + place] - offset[b])
            left[i * n + place] += strength[b] * (total - stored[b])
    return True


@shared
def largest(values):
    """The largest magnitude; NaN where there is one."""
    found = 0.0
    for i in range(len(values)):
        if not abs(values[i]) <= found and not math.isnan(found):
            found = abs(values[i])
    return found


@separate
def newton(parts, room):
    """Find room.unknown, whose values are a guess, by Newton's method: ACCEPTED or why not.

    Its matrix is a difference quotient, kept from step to step while it serves. Corrections that shrink by a share q leave q/(1 − q) of
    the last one (Hairer & Wanner 1996, Solving Ordinary Differential Equations II, section IV.8).
    """
    numbers, kind, x, left, shifted, other, matrix = parts.state.numbers, parts.grid.kind, room.unknown, room.left, room.shifted, room.other, room.matrix
    size, several, last = len(x), len(room.known) > 1, math.inf
    if several:
        numbers[MATRIX] = 0.0
    if not residual(parts, room, x, left):
        return NOT_FINITE
    for correction in range(50):
        if numbers[MATRIX] == 0.0:
            for j in range(size):
                copy(x, shifted)
                shifted[j] += 1.5e-8 * max(1.0, abs(x[j]))
                if not residual(parts, room, shifted, other):
                    return NOT_FINITE
                for i in range(size):
                    matrix[i, j] = (other[i] - left[i]) / (shifted[j] - x[j])
            factor(matrix, room.order)
            numbers[MATRIX], last = 1.0, math.inf
        before = largest(left)
        substitute(matrix, room.order, left)
        for i in range(size):
            x[i] -= left[i]
        change, whole = largest(left), max(1.0, largest(x))
        share = change / last if last < math.inf else 1.0
        found = change <= 1e-14 * whole or (share < 1.0 and share * change <= 1e-16 * (1.0 - share) * whole)
        if found and kind == RATES:
            set_states(kind, room, x)
        elif not residual(parts, room, x, left):
            return NOT_FINITE
        now = largest(left)
        if found or now <= 2.3e-16 * whole or (not now <= 0.1 * before and change <= 1e-12 * whole):
            numbers[MATRIX] += 1.0
            if several or (correction > 1 and numbers[MATRIX] > size):  # of another equation than the next one's; old enough to be worth a new one
                numbers[MATRIX] = 0.0
            return ACCEPTED
        if not now <= 0.1 * before:
            numbers[MATRIX] = 0.0
        last = change
    return UNSOLVED


def local_of(stream):
    """The weight of the next sample in H at the next node."""
    return stream.coming[1] if isinstance(stream, SlipStream) else steady_local(stream)


def look_ahead(stream, into):
    """H at the next node for a next sample of zero; nothing yet where it follows the slip there."""
    if not isinstance(stream, SlipStream):
        steady_look(stream, into)


def follow(stream, where, room):
    """The same into the equation of the next node, where its slip is known and counts."""
    if isinstance(stream, SlipStream):
        slip_follow(stream, where, room)


def accept_sample(stream, sample, tail):
    """Take the next sample into the stream."""
    (slip_accept if isinstance(stream, SlipStream) else steady_accept)(stream, sample, tail)


def add_earlier(stream, into):
    """Add what came before the segment at its first nodes; one that follows the slip has no segments."""
    if not isinstance(stream, SlipStream):
        steady_earlier(stream, into)


@shared
def steady_local(stream):
    """Of a plan."""
    count = int(stream.counters[0])
    if count >= stream.steady:
        return stream.fixed[len(stream.fixed) - 1]
    return stream.short[count, count] if count < len(stream.short) else stream.interior[len(stream.interior) - 1]


@shared
def steady_look(stream, into):
    """Of a plan."""
    s = stream
    count, node, pending = int(s.counters[0]), int(s.counters[1]), int(s.counters[2])
    peek(
        s.samples, s.terms, s.future, count, node, pending, s.slots, s.short, s.oldest, s.interior, s.steady, s.fixed, s.loss, s.gains, s.entry, into
    )  # fmt: skip


@shared
def steady_accept(stream, sample, tail):
    """Of a plan."""
    s, counters = stream, stream.counters
    count, node = int(counters[0]), int(counters[1])
    take(s.samples, s.terms, s.future, count, node, sample, tail, steady_local(s), s.history, s.slots, s.steady, s.loss, s.gains, s.entry)
    counters[0], counters[1], counters[2] = count + 1, node + 1, max(0.0, counters[2] - 1.0)


@shared
def steady_earlier(stream, into):
    """Of a plan."""
    count, node, pending = len(into), int(stream.counters[1]), int(stream.counters[2])
    for b in range(into.shape[1]):
        for i in range(min(count, pending)):
            into[i, b] += stream.future[b, (node + i) % stream.future.shape[1]]
        for q in range(len(stream.loss)):
            term = stream.terms[b, q]
            for i in range(count):
                term -= stream.loss[q] * term
                into[i, b] += term


@shared
def slip_local(stream):
    """Of a memory that follows the slip."""
    return stream.coming[1]


@shared
def slip_accept(stream, sample, tail):
    """Of a memory that follows the slip."""
    accept(stream, sample, tail)


@shared
def slip_follow(stream, where, room):
    """Of a memory that follows the slip."""
    look_at(stream, where, room.states, room.tail)
    room.inner[0, 0] = stream.coming[1]
    copy(room.tail, room.past[0])


@overloads(local_of)
def _local_of(stream):
    return slip_local if stream.kind.instance_class is SlipStream else steady_local


@shared
def nothing(stream, into):
    """Of a memory that follows the slip."""


@overloads(look_ahead)
def _look_ahead(stream, into):
    return nothing if stream.kind.instance_class is SlipStream else steady_look


@overloads(follow)
def _follow(stream, where, room):
    def none(stream, where, room):
        pass

    return slip_follow if stream.kind.instance_class is SlipStream else none


@overloads(accept_sample)
def _accept_sample(stream, sample, tail):
    return slip_accept if stream.kind.instance_class is SlipStream else steady_accept


@overloads(add_earlier)
def _add_earlier(stream, into):
    return nothing if stream.kind.instance_class is SlipStream else steady_earlier


@shared
def one_node(parts, room):
    """The equation of the next node."""
    grid, state, stream = parts.grid, parts.state, parts.stream
    recent, y, known, unknown, dt, kind = state.recent, state.y, room.known, room.unknown, grid.dt, grid.kind
    kept = int(state.numbers[KNOWN])
    degree = min(len(grid.weights) - 1, kept)
    weights = grid.weights[degree]
    for a in range(len(y)):
        total, guess, binomial = 0.0, 0.0, float(kept)
        for k in range(degree):
            total += weights[k + 1] * recent[k, a]
        for k in range(kept):  # the polynomial through all that are kept, one step on
            guess += binomial * recent[k, a]
            binomial *= -(kept - k - 1.0) / (k + 2.0)
        known[0, a] = y[a] + dt * total
        unknown[a] = guess if kind == RATES else y[a]
    room.ahead[0, 0] = grid.dt * weights[0]
    if len(room.tail) > 0:
        room.inner[0, 0] = local_of(stream)
        copy(room.tail, room.past[0])


@shared
def several_nodes(parts, room):
    """The equations of the first nodes of a segment, which share one polynomial."""
    e, grid, state, stream = parts.equation, parts.grid, parts.state, parts.stream
    first, y, count, root = state.recent[0], state.y, len(room.known), math.sqrt(grid.dt)
    for i in range(count):
        for a in range(len(y)):
            room.known[i, a] = y[a] + grid.dt * grid.plain[i, 0] * first[a]
            room.unknown[i * len(y) + a] = first[a] if grid.kind == RATES else y[a]
        for j in range(count):
            room.ahead[i, j], room.inner[i, j] = grid.dt * grid.plain[i, j + 1], root * grid.history[i, j + 1]
    for b in range(len(e.where)):
        newest = first[e.where[b]] if grid.kind == RATES else y[e.where[b]] - state.offset[b]
        for i in range(count):
            room.past[i, b] = root * grid.history[i, 0] * newest
    add_earlier(stream, room.past)


@shared
def hold(parts, room):
    """A Runge–Kutta step with the history as it is; then the rate consistent with the history at its end: whether `fun` was finite."""
    e, grid, state, stages, rates = parts.equation, parts.grid, parts.state, room.stages, room.rates
    y, h, where, history, numbers = state.y, grid.dt, e.where, parts.stream.history, state.numbers
    t = grid.start + h * numbers[NODE]
    copy(y, room.states[0])
    for stage in range(4):
        share = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        if not evaluate(e, numbers, t + share * h, room.states, 0, stages, stage):
            return False
        for b in range(len(where)):
            stages[stage, where[b]] -= e.strength[b] * history[b]
        if stage < 3:
            share = 1.0 if stage == 2 else 0.5
            for a in range(len(y)):
                room.states[0, a] = y[a] + share * h * stages[stage, a]
    for a in range(len(y)):
        room.states[0, a] = y[a] + h / 6.0 * (stages[0, a] + 2.0 * stages[1, a] + 2.0 * stages[2, a] + stages[3, a])
    if not evaluate(e, numbers, t + h, room.states, 0, rates, 0):
        return False
    follow(parts.stream, where, room)
    copy(rates[0], room.unknown)
    for b in range(len(where)):
        place, local = where[b], local_of(parts.stream)
        room.unknown[place] = (rates[0, place] - e.strength[b] * room.tail[b]) / (1.0 + e.strength[b] * local)
    return True


@shared
def advance(parts, room, j):
    """Go to node j of those that were solved: record, stream, the rates that are kept."""
    e, grid, state, record = parts.equation, parts.grid, parts.state, parts.record
    y, recent, numbers, n, kind, before = state.y, state.recent, state.numbers, len(state.y), grid.kind, state.before
    states, unknown, functions, where, sample, dt = room.states, room.unknown, room.rates, e.where, room.sample, grid.dt
    row, node, known = int(numbers[DONE]), int(numbers[NODE]) + 1, int(numbers[KNOWN])
    for a in range(n):
        before[0, a], before[1, a] = y[a], recent[0, a]
        new, found = states[j, a], unknown[j * n + a]
        for k in range(min(known, len(recent) - 1), 0, -1):
            recent[k, a] = recent[k - 1, a]
        recent[0, a] = functions[j, a] if kind == SLIPS else found
        record.rates[row, a] = (new - y[a]) / dt if kind == SLIPS else found  # for the dense output: fun lacks the history
        record.states[row, a] = y[a] = new
    for b in range(len(where)):
        sample[b] = y[where[b]] - state.offset[b] if kind == SLIPS else recent[0, where[b]]
    if len(where) > 0:
        accept_sample(parts.stream, sample, room.tail)
    if kind == SLIPS:
        for b in range(len(where)):
            state.stored[b] = parts.stream.history[b]
    record.times[row] = grid.end if node == grid.nodes else grid.start + dt * node
    numbers[NODE], numbers[DONE], numbers[KNOWN] = node, row + 1, min(known + 1, len(recent))


@separate
def diverges(state, rates):
    """Whether the newest rates of the path alternate in sign and grow as an unstable step makes them do: by a factor from step to step.

    What alternates with Simpson's weights grows by equal amounts, when a kink leaves a window.
    """
    seen, swing, numbers = state.seen, state.swing, state.numbers
    worst, largest_before, grows = 0, 0.0, False
    for a in range(len(rates)):
        for k in range(4, 0, -1):
            seen[k, a] = seen[k - 1, a]
        seen[0, a] = rates[a]
        swing[2, a], swing[1, a], swing[0, a] = swing[1, a], swing[0, a], 0.0
        for k in range(5):
            swing[0, a] += ALTERNATING[k] * seen[k, a]
        if abs(swing[0, a]) > abs(swing[0, worst]):
            worst = a
    numbers[SEEN] += 1.0
    if numbers[SEEN] < 7.0:
        return False
    now, last = swing[0, worst], swing[1, worst]
    grows = now * last < 0.0 and abs(now) >= abs(last) and now * swing[2, worst] >= GEOMETRIC * last**2
    numbers[GROWN] = numbers[GROWN] + 1.0 if grows else 0.0
    for k in range(5):
        largest_before = max(largest_before, abs(seen[k, worst]))
    return numbers[GROWN] >= IN_A_ROW and abs(swing[0, worst]) > SHARE * largest_before


@compiled(allocates=False, usually="some 10 s")
def steps(parts: Parts, stop: int) -> int:
    """Steps up to node `stop`, or until something needs the caller: END, or why."""
    grid, state, record, signal, remembers = parts.grid, parts.state, parts.record, parts.signal, len(parts.equation.where) > 0
    numbers = state.numbers
    while numbers[NODE] < stop:
        begins = numbers[KNOWN] == 1.0 and len(grid.plain) > 1
        room = parts.together if begins else parts.alone
        count = len(room.known)
        if int(numbers[DONE]) + count > len(record.times):
            return FULL
        if remembers and not begins:
            look_ahead(parts.stream, room.tail)
        if grid.kind == HELD:
            code = ACCEPTED if hold(parts, room) else NOT_FINITE
        else:
            if begins:
                several_nodes(parts, room)
            else:
                one_node(parts, room)
            code = newton(parts, room)
        if code != ACCEPTED:
            return code
        for j in range(count):
            if remembers and begins:
                look_ahead(parts.stream, room.tail)
            advance(parts, room, j)
            row = int(numbers[DONE]) - 1
            if grid.limited == 1 and diverges(state, record.rates[row]) and grid.dt * largest(state.swing[0]) > UNRESOLVED * max(1.0, largest(state.y)):
                return DIVERGED
            if parts.looking == 1:
                call(parts.look, record.times[row], signal, 0, signal, 0, signal)
                if int(signal[0, 0]) != ACCEPTED:
                    return int(signal[0, 0])
    return END


class Look(NamedTuple):
    """What events at nodes are found from."""

    m: events.Motion
    found: events.Events
    history: Floats
    earlier: Floats  # ∫K y at the node before where samples are slips, else nothing
    y: Floats
    values: Floats  # of the event functions at the newest node, and the one before: (2, event)
    after: Floats  # (state,)
    still: Floats
    dt: float
    leapt: Floats  # (1,): whether the caller has a jump to take


@shared
def happens(found, k, before, after):
    """Whether an event happens on a step between these values; after a jump from when the body is back on its side, or sinks."""
    side = found.side[k]
    if found.bounced[k] and not found.resting[k]:
        found.reach[k] = max(found.reach[k], after * side)
        if found.fresh[k]:
            found.fresh[k] = after * side <= 0.0
            return found.fresh[k] and (after - before) * side < 0.0
    found.fresh[k] = False
    if not events.crosses(found, k, before, after):
        return False
    if not found.resting[k]:
        found.side[k] = math.copysign(1.0, before)
    return True


def looked(parts: Look, t: float, y: Any, out: Any, own: Any) -> None:
    """Events at the newest node, at time t: into out[0] whether to go on, or why not; a jump of the memory is left to the caller."""
    m, found, values = parts.m, parts.found, parts.values
    count, logged, leaps = 0, found.logged[0], False
    for b in range(len(parts.history)):
        m.past[b, 0] = parts.history[b]
        if len(parts.earlier) > 0:
            m.past[b, 0] = (parts.history[b] - parts.earlier[b]) / parts.dt
            parts.earlier[b] = parts.history[b]
    for k in range(len(found.side)):
        values[1, k] = values[0, k]
        values[0, k] = events.value(m, found, k, t, parts.y)
    out[0] = ACCEPTED
    if found.trouble[0] == 0:
        for k in range(len(found.side)):
            if happens(found, k, values[1, k], values[0, k]):
                found.fired[count] = k
                count += 1
                leaps = leaps or found.leaps[k]
        if count > 0:
            found.count[0] = count
            status = events.fire(m, found, t, parts.y, parts.after, parts.still, 1.5 * parts.dt)
            if status != events.PASSED:
                out[0] = STOPPED if status == events.TERMINAL else AT_REST
            elif leaps or 2 * found.logged[0] > len(found.log_times):
                out[0] = FULL
            if leaps and found.trouble[0] == 0:
                parts.leapt[0] = 1.0
                for k in range(len(found.side)):
                    values[0, k] = events.value(m, found, k, t, parts.after)
    if found.trouble[0] != 0:
        out[0], found.logged[0] = TROUBLE, logged


look_entry = entry(looked, "some 5 s")


def stream_of(plan: Plan | FollowingPlan, samples: Samples | SlipStream) -> Stream | SlipStream:
    """A plan and its state for the loop."""
    if isinstance(samples, SlipStream):
        return samples
    assert isinstance(plan, Plan)
    slots, short, oldest, interior, steady, *rest = plan.tables
    return Stream(*samples, slots, steady, short, oldest, interior, *rest)


def weights_of(degree: int) -> Floats:
    """Weights of Adams and Moulton for degrees up to this one."""
    found = np.zeros((degree + 1, degree + 1))
    for p in range(1, degree + 1):
        found[p, : p + 1] = adams_moulton(p)
    return found


def state_of(y: Floats, members: int, degree: int) -> State:
    """The start from `y`, of which it makes no copy."""
    n = len(y)
    return State(y, np.zeros((degree + 1, n)), np.zeros(members), np.zeros(members), np.zeros((5, n)), np.zeros((3, n)), np.zeros((2, n)), np.zeros(10))


def room(nodes: int, n: int, members: int) -> Room:
    """Work space."""
    size = nodes * n
    shapes: list[Any] = [size, size, size, size, (size, size), size, (nodes, n), (nodes, n), (nodes, n), (nodes, nodes), (nodes, nodes)]
    arrays = [np.zeros(shape) for shape in [*shapes, (nodes, members), (5, n), members, members]]
    arrays[5] = np.zeros(size, dtype=np.int64)
    return Room(*arrays)
