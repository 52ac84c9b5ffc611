"""Many grains in one compiled run: each with its own graded steps, encounters by event time from the step polynomials.

Every grain has one step in hand: found, not yet taken, valid up to its end or to its impact on the bed. The grain whose next
event comes first is served: a step that ends is taken and the next one is found; an impact or an encounter cuts the steps
where it happens. Nobody is advanced beyond what is certain, so nothing is taken back and no snapshots are needed. Without
encounters the grains are served one after the other, and there is no search and no list.

A pair's gap g = |r| − 1 falls no faster than g'(t) allows with what the step says about accelerations, because |r|'' ≥ −|a|:
the time to the next look follows from that bound and no meeting is passed by (conservative advancement).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from basset._compile import compiled, shared
from basset.kernels import Floats
from basset.solvers import _march
from basset.solvers._march import ACCEPTED, NOT_FINITE, SINGULAR, STEP, TABLE, TIME, TOO_SMALL
from saltation import flight
from saltation._random import uniforms
from saltation.bed.contact import strike_pair
from saltation.flow import both

STEP_END, IMPACT, ENCOUNTER, PLAN, SEEK, GONE, AGAIN, ROUGH, KINK = range(9)  # what a grain's next event is
UNTIL, PILE_UP, ENCOUNTERS_FULL, JUMPS_FULL = 40, 41, 42, 43  # why `advance` came back, beside the codes of a flight
BEGIN, END, X, Y, Z, U, V, W, SPREAD, PACE, BEND, ROOT = range(12)  # places in `Crowd.path`
REACH = 2.0  # d: half a step's path is at most this long
UNSEEN, CLOSING = 1e-10, 1e-12  # d, d/(d/V): overlaps and rates of approach that are none
MARGIN = 1.5  # on what the nodes of a step say about what lies between them

# columns of the table of encounters: n from the first grain to the second
COLUMNS = (
    "time", "first", "second", "x", "y", "z", "n_x", "n_y", "n_z", "distance", "restitution",
    "first_u", "first_v", "first_w", "second_u", "second_v", "second_w",
    "first_spin_x", "first_spin_y", "first_spin_z", "second_spin_x", "second_spin_y", "second_spin_z",
    "first_u_after", "first_v_after", "first_w_after", "second_u_after", "second_v_after", "second_w_after",
    "first_spin_x_after", "first_spin_y_after", "first_spin_z_after", "second_spin_x_after", "second_spin_y_after", "second_spin_z_after",
    "impulse_x", "impulse_y", "impulse_z",
)  # fmt: skip


class World(NamedTuple):
    """Periodic lengths (d, infinite where open), cells, the pair law, and how many encounters are a pile-up.

    Grains that would part more slowly than `slowest` (V) part with it: without, grains that are pressed together meet
    infinitely often in a finite time. `cascade`: encounters of one grain within one d/V.
    """

    length: float
    width: float
    cell_x: float
    cell_y: float
    along: int
    across: int
    restitution: float
    friction: float
    slowest: float
    cascade: int


class Crowd(NamedTuple):
    """All grains, one row each: what a single grain has in its own arrays, and its next event."""

    y: Floats
    rate: Floats
    past: Floats
    jump: Floats
    numbers: Floats
    spin: Floats
    flight: Floats
    values: Floats
    before: Floats  # size of the step before, 0 where it was singular or cut: for the next guess
    diagonal: Floats  # of the Jacobian
    share: Floats  # θ at which the step in hand ends
    path: Floats  # of the step in hand: its times, its chord, and bounds on what leaves the chord
    clock: Floats  # time of the next event
    calm: Floats
    sample: Any  # next sample to be written
    kind: Any  # of the next event
    own: Any  # what happens at the end of the step in hand
    partner: Any
    cell: Any
    link: Any  # next grain in the same cell, −1 at the end
    burst: Any  # encounters since `calm`
    heap: Any  # grains in order of events
    place: Any  # of each grain in the heap


class Samples(NamedTuple):
    """Kept positions and velocities: every `interval` (d/V), from number `first` on, (sample, grain, 2·dimensions)."""

    interval: float
    first: Any
    values: Floats


class Logs(NamedTuple):
    """Jumps (as of a flight) and whose they are, encounters; counts of jumps and encounters written, the grain that stopped the run, steps
    that were too short to be resolved.
    """

    jumps: Floats
    owners: Any
    encounters: Floats
    count: Any


class Parts(NamedTuple):
    """What stays the same during a run, as for one grain; `bed.grain` is the number of the first one."""

    model: Any
    bed: Any
    memory: Any
    limits: Any
    problem: Any
    nodes: Any
    cut: Any
    tables: Any
    coarse: Any  # the problem for a step that cannot be small enough: two contacts follow each other too closely


@shared
def index(number: Any) -> Any:
    """One type for all numbers of grains: every function is compiled once."""
    return np.int64(number)


# The order of events


@shared
def less(crowd: Crowd, one: int, other: int) -> bool:
    """Which of two grains comes first; ties by number, so that the order never depends on the past."""
    a, b = crowd.clock[one], crowd.clock[other]
    return a < b or (a == b and one < other)


@shared
def sift(crowd: Crowd, grain: int) -> None:
    """Put a grain whose event has changed into its place of the heap."""
    heap, place = crowd.heap, crowd.place
    k = place[grain]
    while k > 0:
        parent = (k - 1) // 2
        if not less(crowd, grain, heap[parent]):
            break
        heap[k] = heap[parent]
        place[heap[k]] = k
        k = parent
    count = len(heap)
    while True:
        child = 2 * k + 1
        if child >= count:
            break
        if child + 1 < count and less(crowd, heap[child + 1], heap[child]):
            child += 1
        if not less(crowd, heap[child], grain):
            break
        heap[k] = heap[child]
        place[heap[k]] = k
        k = child
    heap[k] = grain
    place[grain] = k


@shared
def set_event(world: World | None, crowd: Crowd, grain: int, time: float, kind: int, partner: int) -> None:
    """Give a grain its next event."""
    crowd.clock[grain], crowd.kind[grain], crowd.partner[grain] = time, kind, partner
    if world is not None:
        sift(crowd, grain)


# Neighbours


@shared
def leave_cell(crowd: Crowd, heads: Any, grain: int) -> None:
    """Take a grain out of its cell."""
    cell, link = crowd.cell[grain], crowd.link
    if cell < 0:
        return
    if heads[cell] == grain:
        heads[cell] = link[grain]
    else:
        other = heads[cell]
        while link[other] != grain:
            other = link[other]
        link[other] = link[grain]
    crowd.cell[grain] = -1


@shared
def enter_cell(world: World, crowd: Crowd, heads: Any, grain: int) -> None:
    """Put a grain into the cell over the middle of its path; open worlds are folded, which only adds candidates."""
    column = math.floor(crowd.path[grain, X] / world.cell_x) % world.along
    row = math.floor(crowd.path[grain, Y] / world.cell_y) % world.across
    cell = column * world.across + row
    if cell != crowd.cell[grain]:
        leave_cell(crowd, heads, grain)
        crowd.cell[grain], crowd.link[grain], heads[cell] = cell, heads[cell], grain


@shared
def nearest(difference: float, period: float) -> float:
    """A difference of positions in a periodic box."""
    if math.isinf(period):
        return difference
    return difference - period * math.floor(difference / period + 0.5)


@shared
def velocity_of(model: flight.Model, states: Floats, velocity: Floats) -> None:
    """Velocity that belongs to some states, three components, into `velocity`."""
    if model.dimensions == 2:
        velocity[0], velocity[1], velocity[2] = states[2] + both(model.profile, states[1])[0], 0.0, states[3]
    else:
        velocity[0], velocity[1], velocity[2] = states[3] + both(model.profile, states[2])[0], states[4], states[5]


@shared
def describe(
    model: flight.Model, nodes: _march.Nodes, h: float, singular: int, share: float, y: Floats, polynomial: Floats, work: flight.Work, path: Floats
) -> float:
    """Chord of the step up to `share` and bounds on what leaves it, into `path`; half the length of the path."""
    d = model.dimensions
    here, before, now = work.here[0], work.out[0], work.out[1]
    velocity_of(model, y, before)
    length = h * share
    x, z = y[0], y[d - 1]
    across = 0.0 if model.dimensions == 2 else y[1]
    u, v, w = before[0], before[1], before[2]
    if share > 1e-6:
        _march.all_at(polynomial, y, singular, share, here)
        u, v, w = (here[0] - x) / length, (0.0 if model.dimensions == 2 else here[1] - across) / length, (here[d - 1] - z) / length
    pace = (before[0] - u) ** 2 + (before[1] - v) ** 2 + (before[2] - w) ** 2
    spread, bend, last = 0.0, 0.0, 0.0
    for k in range(len(nodes.c)):
        velocity_of(model, work.states[k], now)
        pace = max(pace, (now[0] - u) ** 2 + (now[1] - v) ** 2 + (now[2] - w) ** 2)
        where = math.sqrt(nodes.c[k] * h) if singular == 1 else nodes.c[k] * h
        change = math.sqrt((now[0] - before[0]) ** 2 + (now[1] - before[1]) ** 2 + (now[2] - before[2]) ** 2)
        bend = max(bend, change / (where - last))
        last = where
        before[0], before[1], before[2] = now[0], now[1], now[2]
    for quarter in range(1, 4):
        _march.all_at(polynomial, y, singular, 0.25 * quarter * share, here)
        time = 0.25 * quarter * length
        off_x, off_z = here[0] - x - u * time, here[d - 1] - z - w * time
        off_y = 0.0 if model.dimensions == 2 else here[1] - across - v * time
        spread = max(spread, off_x * off_x + off_y * off_y + off_z * off_z)
    spread = MARGIN * math.sqrt(spread) + 1e-9
    path[X], path[Y], path[Z] = x + 0.5 * u * length, across + 0.5 * v * length, z + 0.5 * w * length
    path[U], path[V], path[W], path[SPREAD], path[PACE] = u, v, w, spread, MARGIN * math.sqrt(pace) + 1e-9
    path[BEND], path[ROOT] = (0.0, MARGIN * bend) if singular == 1 else (MARGIN * bend, 0.0)
    return 0.5 * length * math.sqrt(u * u + v * v + w * w) + spread


@shared
def passes(world: World, one: Floats, two: Floats, start: float, end: float) -> bool:
    """Whether two paths may come within one diameter in [start, end]."""
    middle = 0.5 * (start + end)
    at_one, at_two = middle - 0.5 * (one[BEGIN] + one[END]), middle - 0.5 * (two[BEGIN] + two[END])
    near = 1.0 + one[SPREAD] + two[SPREAD]
    half = 0.5 * (end - start)
    u, v, w = two[U] - one[U], two[V] - one[V], two[W] - one[W]
    z = two[Z] - one[Z] + two[W] * at_two - one[W] * at_one
    if abs(z) - abs(w) * half > near:
        return False
    x = nearest(two[X] - one[X] + two[U] * at_two - one[U] * at_one, world.length)
    if abs(x) - abs(u) * half > near:
        return False
    y = nearest(two[Y] - one[Y] + two[V] * at_two - one[V] * at_one, world.width)
    speed = u * u + v * v + w * w
    share = -(x * u + y * v + z * w)
    share = min(half, max(-half, share / speed)) if speed > 0.0 else 0.0
    x, y, z = x + u * share, y + v * share, z + w * share
    met: bool = x * x + y * y + z * z <= near * near
    return met


# Meetings


@shared
def polynomial_of(parts: Parts, crowd: Crowd, grain: int, out: Floats) -> None:
    """The polynomial of the step in hand."""
    numbers = crowd.numbers[grain]
    _march.fit_polynomial(parts.nodes, int(numbers[SINGULAR]), numbers[STEP], crowd.values[grain], out)


@shared
def states_at(crowd: Crowd, grain: int, polynomial: Floats, time: float, row: Floats) -> None:
    """All states of a grain at a time of the step in hand, into `row`."""
    numbers = crowd.numbers[grain]
    theta = min(1.0, max(0.0, (time - numbers[TIME]) / numbers[STEP]))
    _march.all_at(polynomial, crowd.y[grain], int(numbers[SINGULAR]), theta, row)


@shared
def apart(model: flight.Model, world: World, crowd: Crowd, i: int, j: int, one: Floats, two: Floats, time: float, rows: Floats) -> tuple[float, float]:
    """Gap between two surfaces and its rate of change; `rows` is overwritten."""
    d = model.dimensions
    first, second = rows[0], rows[1]
    states_at(crowd, i, one, time, first)
    states_at(crowd, j, two, time, second)
    x, z = nearest(second[0] - first[0], world.length), second[d - 1] - first[d - 1]
    u = second[d] + both(model.profile, second[d - 1])[0] - first[d] - both(model.profile, first[d - 1])[0]
    square, product = x * x + z * z, x * u + z * (second[2 * d - 1] - first[2 * d - 1])
    if model.dimensions == 3:
        y = nearest(second[1] - first[1], world.width)
        square, product = square + y * y, product + y * (second[4] - first[4])
    distance = math.sqrt(square)
    return distance - 1.0, product / distance


@shared
def fall(age: float, time: float) -> float:
    """∫ from 0 to `time` of √(age + t) − √age."""
    value: float = 2.0 / 3.0 * ((age + time) ** 1.5 - age**1.5) - math.sqrt(age) * time
    return value


@shared
def certain(gap: float, rate: float, bend: float, one: float, two: float, age_one: float, age_two: float, left: float) -> float:
    """How long the gap surely stays open, at most `left`: gap + rate·t − bend·t²/2 − one·fall − two·fall ≥ 0."""
    if gap + rate * left - 0.5 * bend * left * left - one * fall(age_one, left) - two * fall(age_two, left) >= 0.0:
        return left
    if one == 0.0 and two == 0.0:
        root = math.sqrt(rate * rate + 2.0 * bend * gap)
        if rate > 0.0:
            return (rate + root) / bend
        return 2.0 * gap / (root - rate) if gap > 0.0 else 0.0
    time = left  # Newton's method comes down to the root from above: the bound is concave
    for _ in range(50):
        value = gap + rate * time - 0.5 * bend * time * time - one * fall(age_one, time) - two * fall(age_two, time)
        slope = rate - bend * time
        slope -= one * (math.sqrt(age_one + time) - math.sqrt(age_one)) + two * (math.sqrt(age_two + time) - math.sqrt(age_two))
        closer = time - value / slope
        if not 0.0 < closer < time:
            break
        done = time - closer <= 1e-3 * closer
        time = closer
        if done:
            break
    for _ in range(60):
        time *= 0.999
        if gap + rate * time - 0.5 * bend * time * time - one * fall(age_one, time) - two * fall(age_two, time) >= 0.0:
            return time
        time *= 0.5
    return 0.0


@shared
def meeting(model: flight.Model, world: World, crowd: Crowd, i: int, j: int, one: Floats, two: Floats, start: float, end: float, rows: Floats) -> float:
    """When two grains meet in [start, end], infinity if they do not, −t if they do not up to t and it takes too long to see beyond."""
    first, second = crowd.path[i], crowd.path[j]
    touch = 1e-12 + 1e-14 * abs(end)  # rounding of positions and times
    speed = math.sqrt((second[U] - first[U]) ** 2 + (second[V] - first[V]) ** 2 + (second[W] - first[W]) ** 2) + first[PACE] + second[PACE]
    bend = first[BEND] + second[BEND]
    # in touch without closing: on, but only so far that the surfaces cannot sink by more than UNSEEN into each other
    blind = min(math.sqrt(UNSEEN / (bend + 1e-9)), (UNSEEN / (first[ROOT] + second[ROOT] + 1e-9)) ** (2.0 / 3.0))
    time, earlier, before = start, start, 0.0
    gap, rate = apart(model, world, crowd, i, j, one, two, time, rows)
    for _ in range(1000):
        if gap > speed * (end - time):
            return math.inf
        if gap <= touch and rate < -CLOSING:
            break
        pause = certain(max(gap, 0.0), rate, bend, first[ROOT], second[ROOT], max(0.0, time - first[BEGIN]), max(0.0, time - second[BEGIN]), end - time)
        pause = max(pause, gap / speed, 4e-16 * (1.0 + abs(time)), blind if rate >= -CLOSING else 0.0)
        if pause >= end - time:
            return math.inf
        earlier, before = time, gap
        time += pause
        gap, rate = apart(model, world, crowd, i, j, one, two, time, rows)
    if gap > touch or rate >= -CLOSING:
        return -time
    if gap < -touch and before > 0.0:  # the nodes did not tell all: back to where the surfaces met
        late = time
        for _ in range(80):
            time = 0.5 * (earlier + late)
            if not earlier < time < late:
                break
            if apart(model, world, crowd, i, j, one, two, time, rows)[0] > 0.0:
                earlier = time
            else:
                late = time
        time = late
    return time


@shared
def seek(parts: Parts, world: World, crowd: Crowd, heads: Any, i: int, now: float, work: flight.Work, other: Floats) -> None:
    """Find the earliest encounter of grain i in the step in hand, and make it the next event of both."""
    path = crowd.path
    mine = path[i]
    start, best, chosen = max(now, mine[BEGIN]), mine[END], index(-1)
    column, row = math.floor(mine[X] / world.cell_x), math.floor(mine[Y] / world.cell_y)
    reach = 1.0 + REACH + 0.5 * (mine[END] - mine[BEGIN]) * math.sqrt(mine[U] ** 2 + mine[V] ** 2 + mine[W] ** 2) + mine[SPREAD]
    long, wide = math.ceil(reach / world.cell_x), math.ceil(reach / world.cell_y)
    fitted = False
    for p in range(min(2 * long + 1, world.along)):
        for q in range(min(2 * wide + 1, world.across)):
            j = index(heads[((column - long + p) % world.along) * world.across + (row - wide + q) % world.across])
            while j >= 0:
                if j != i:
                    begin, end = max(start, path[j, BEGIN]), min(best, crowd.clock[j], path[j, END])
                    if end > begin and passes(world, mine, path[j], begin, end):
                        if not fitted:
                            polynomial_of(parts, crowd, i, work.polynomial)
                            fitted = True
                        polynomial_of(parts, crowd, j, other)
                        time = meeting(parts.model, world, crowd, i, j, work.polynomial, other, begin, end, work.here)
                        if abs(time) < best:
                            best, chosen = abs(time), j if time >= 0.0 else index(-1)
                j = index(crowd.link[j])
    if chosen < 0:
        set_event(world, crowd, i, best, index(crowd.own[i]) if best == mine[END] else SEEK, -1)
        return
    if crowd.kind[chosen] == ENCOUNTER:  # which will not happen: its partner has to seek again
        set_event(world, crowd, index(crowd.partner[chosen]), now, SEEK, -1)
    set_event(world, crowd, i, best, ENCOUNTER, chosen)
    set_event(world, crowd, chosen, best, ENCOUNTER, i)


# Steps


@shared
def view(crowd: Crowd, i: int, jacobian: Floats) -> _march.State:
    """One grain's state as the loops of a single grain know it."""
    return _march.State(crowd.y[i], crowd.rate[i], crowd.past[i], crowd.jump[i], jacobian, crowd.numbers[i])


@shared
def room_of(crowd: Crowd, i: int, work: flight.Work) -> flight.Work:
    """The shared work space with what a grain keeps from step to step."""
    return flight.Work(
        work.rates, work.states, work.inverse, work.matrix, work.force, work.extra, work.residual, crowd.diagonal[i],
        work.rate, crowd.before[i : i + 1], work.polynomial, work.here, work.out, work.halfway, work.contact,
    )  # fmt: skip


@shared
def contact_in(
    bed: flight.Bed, model: flight.Model, nodes: _march.Nodes, state: _march.State, singular: int, account: Floats, i: int, work: flight.Work
) -> float:
    """θ of the first contact with the bed in the step that is in `work`, 2 if there is none."""
    d = model.dimensions
    near = state.y[d - 1] < bed.highest
    for k in range(len(nodes.c)):
        near = near or work.states[k, d - 1] < bed.highest
    if not near:
        return 2.0
    draws = uniforms(bed.seed, bed.grain + i, int(account[flight.IMPACTS]))
    return flight.first_contact(model, bed, work.polynomial, state.y, singular, draws, state.numbers[TIME] == account[flight.START])


@shared
def plan(parts: Parts, world: World | None, crowd: Crowd, heads: Any, logs: Logs, i: int, jacobian: Floats, work: flight.Work) -> int:
    """Find the next step of a grain: ACCEPTED, or why not. Its polynomial is left in `work`.

    A search that a missing table interrupts goes on where it was (AGAIN, ROUGH): the step must not depend on which tables there were.
    """
    model, nodes, problem = parts.model, parts.nodes, parts.problem
    state, numbers, account, room = view(crowd, i, jacobian), crowd.numbers[i], crowd.flight[i], room_of(crowd, i, work)
    if numbers[TIME] - account[flight.START] > parts.limits.longest:
        return flight.ALOFT
    if crowd.before[i] > 0.0 and crowd.kind[i] == PLAN:  # the values of the step before are still in their place
        flight.keep_rate(nodes, 0, crowd.before[i], crowd.values[i], room)
    while True:
        if crowd.kind[i] != ROUGH:
            code = flight.attempt(model, parts.memory.finite, crowd.spin[i], problem, nodes, parts.tables, state, crowd.values[i], room)
            if code == TABLE:
                crowd.kind[i] = AGAIN
            elif world is not None and code in (TOO_SMALL, NOT_FINITE) and numbers[STEP] < 4.0 * problem.floor:
                # what happens between two contacts that follow each other more closely than that cannot be resolved
                numbers[STEP] = 8.0 * problem.floor
                crowd.kind[i] = ROUGH
        if crowd.kind[i] == ROUGH:
            code = flight.attempt(model, parts.memory.finite, crowd.spin[i], parts.coarse, nodes, parts.tables, state, crowd.values[i], room)
            if code == ACCEPTED:
                crowd.kind[i] = PLAN
                logs.count[3] += 1
        if code != ACCEPTED:
            return code
        h, singular = numbers[STEP], int(numbers[SINGULAR])
        _march.fit_polynomial(nodes, singular, h, crowd.values[i], work.polynomial)
        contact = contact_in(parts.bed, model, nodes, state, singular, account, i, work)
        kink = 2.0
        if h > 2.0 * problem.floor:
            kink = flight.leaving(model, work.polynomial, state.y, singular, crowd.spin[i, 3], work.states)
        share = min(contact, kink, 1.0)
        crowd.share[i] = share
        crowd.own[i] = STEP_END if min(contact, kink) > 1.0 else KINK if kink < contact else IMPACT
        path = crowd.path[i]
        path[BEGIN], path[END] = numbers[TIME], numbers[TIME] + h * share
        if world is None:
            return ACCEPTED
        reach = describe(model, nodes, h, singular, share, state.y, work.polynomial, work, path)
        if reach <= REACH:
            enter_cell(world, crowd, heads, i)
            return ACCEPTED
        numbers[STEP] = 0.9 * h * share * REACH / reach


@shared
def write_samples(model: flight.Model, crowd: Crowd, samples: Samples, i: int, polynomial: Floats, until: float, row: Floats) -> None:
    """Samples of the step in hand up to a time: x, [y,] z, u, [v,] w; `row` is overwritten."""
    d = model.dimensions
    while crowd.sample[i] * samples.interval <= until and crowd.sample[i] - samples.first[0] < len(samples.values):
        states_at(crowd, i, polynomial, crowd.sample[i] * samples.interval, row)
        kept = samples.values[crowd.sample[i] - samples.first[0], i]
        for a in range(2 * d):
            kept[a] = row[a]
        kept[d] += both(model.profile, kept[d - 1])[0]
        crowd.sample[i] += 1


@shared
def cut_at(parts: Parts, crowd: Crowd, samples: Samples, i: int, now: float, theta: float, jacobian: Floats, work: flight.Work) -> None:
    """Take the step in hand up to θ, at time `now`; its polynomial is in `work`."""
    state, numbers = view(crowd, i, jacobian), crowd.numbers[i]
    write_samples(parts.model, crowd, samples, i, work.polynomial, now, work.here[0])
    flight.watch(parts.model, work.polynomial, state.y, int(numbers[SINGULAR]), numbers[STEP], theta, crowd.flight[i])
    flight.cut_step(parts.problem, parts.nodes, parts.memory, parts.cut, state, theta, crowd.values[i], work)
    numbers[TIME] = now
    crowd.before[i] = 0.0


@shared
def come_down(bed: flight.Bed, parts: Parts, crowd: Crowd, logs: Logs, i: int, state: _march.State, work: flight.Work) -> int:
    """Strike the bed: ACCEPTED or REST."""
    own, room = flight.Bed(bed.rebound, bed.roughness, bed.highest, bed.seed, bed.grain + i), room_of(crowd, i, work)
    account = crowd.flight[i]
    return flight.land(parts.model, own, parts.memory, parts.problem, state, crowd.spin[i], account, room, parts.limits, logs.jumps)


@shared
def finish(parts: Parts, crowd: Crowd, samples: Samples, logs: Logs, i: int, jacobian: Floats, work: flight.Work, record: _march.Record) -> int:
    """Take the step in hand to its own end: ACCEPTED or REST. Its polynomial is in `work`."""
    now, numbers = crowd.path[i, END], crowd.numbers[i]
    state = view(crowd, i, jacobian)
    if crowd.own[i] == STEP_END:
        singular, h = int(numbers[SINGULAR]), numbers[STEP]
        write_samples(parts.model, crowd, samples, i, work.polynomial, now, work.here[0])
        flight.watch(parts.model, work.polynomial, state.y, singular, h, 1.0, crowd.flight[i])
        crowd.before[i] = 0.0 if singular == 1 else h
        _march.accept(parts.problem, parts.nodes, parts.tables, state, crowd.values[i], record, 0)
        if h <= 2.0 * parts.problem.floor:
            crowd.spin[i, 3] = flight.layer_of(parts.model, state.y[parts.model.dimensions - 1])
        return ACCEPTED
    cut_at(parts, crowd, samples, i, now, crowd.share[i], jacobian, work)
    if crowd.own[i] == KINK:
        flight.cross(parts.model, parts.problem, state, crowd.spin[i], room_of(crowd, i, work))
        return ACCEPTED
    count = logs.count
    crowd.flight[i, flight.DONE] = count[0]
    logs.owners[count[0]] = i
    count[0] += 1
    return come_down(parts.bed, parts, crowd, logs, i, state, work)


@shared
def collide(parts: Parts, world: World, crowd: Crowd, i: int, j: int, time: float, row: Floats, jacobian: Floats) -> None:
    """Two grains in contact: velocities, spins and memories jump, and the encounter is written down."""
    model = parts.model
    d = model.dimensions
    one, two = view(crowd, i, jacobian), view(crowd, j, jacobian)
    first, second = one.y, two.y
    x, z = nearest(second[0] - first[0], world.length), second[d - 1] - first[d - 1]
    y = 0.0 if model.dimensions == 2 else nearest(second[1] - first[1], world.width)
    distance = math.sqrt(x * x + y * y + z * z)
    nx, ny, nz = x / distance, y / distance, z / distance
    stream_one, stream_two = both(model.profile, first[d - 1])[0], both(model.profile, second[d - 1])[0]
    u = (first[d] + stream_one, 0.0 if model.dimensions == 2 else first[d + 1], first[2 * d - 1])
    v = (second[d] + stream_two, 0.0 if model.dimensions == 2 else second[d + 1], second[2 * d - 1])
    spin_one, spin_two = flight.spin_of(model, one, crowd.spin[i]), flight.spin_of(model, two, crowd.spin[j])
    closing = (u[0] - v[0]) * nx + (u[1] - v[1]) * ny + (u[2] - v[2]) * nz
    restitution = world.restitution
    if closing > 0.0 and restitution * closing < world.slowest:
        restitution = world.slowest / closing
    after = strike_pair(nx, ny, nz, u, v, spin_one, spin_two, (0.5, 0.5), (1.0, 1.0), restitution, world.friction)
    row[0], row[1], row[2] = time, i, j
    row[3], row[4], row[5] = first[0], (0.0 if model.dimensions == 2 else first[1]), first[d - 1]
    row[6], row[7], row[8], row[9], row[10] = nx, ny, nz, distance, restitution
    for k in range(3):
        row[11 + k], row[14 + k], row[17 + k], row[20 + k] = u[k], v[k], spin_one[k], spin_two[k]
        row[23 + k], row[26 + k], row[29 + k], row[32 + k] = after[0][k], after[1][k], after[2][k], after[3][k]
        row[35 + k] = after[4][k]
    flight.rebounded(model, parts.memory, parts.problem, one, stream_one, after[0][0], after[0][1], after[0][2])
    flight.rebounded(model, parts.memory, parts.problem, two, stream_two, after[1][0], after[1][1], after[1][2])
    if not parts.limits.prescribed:
        flight.turn(model, one, crowd.spin[i], after[2][0], after[2][1], after[2][2])
        flight.turn(model, two, crowd.spin[j], after[3][0], after[3][1], after[3][2])


@shared
def cascading(world: World, crowd: Crowd, grain: int, now: float) -> bool:
    """Whether a grain has had too many encounters within one d/V."""
    if now - crowd.calm[grain] > 1.0:
        crowd.calm[grain], crowd.burst[grain] = now, 0
    crowd.burst[grain] += 1
    many: bool = crowd.burst[grain] > world.cascade
    return many


@shared
def encounter(parts: Parts, world: World, crowd: Crowd, samples: Samples, logs: Logs, i: int, now: float, jacobian: Floats, work: flight.Work) -> int:
    """Two grains meet: ACCEPTED or PILE_UP."""
    j = index(crowd.partner[i])
    for side in range(2):
        grain = i if side == 0 else j
        if cascading(world, crowd, grain, now):
            logs.count[2] = grain
            return PILE_UP
    for side in range(2):
        grain = i if side == 0 else j
        polynomial_of(parts, crowd, grain, work.polynomial)
        numbers = crowd.numbers[grain]
        cut_at(parts, crowd, samples, grain, now, min(1.0, max(0.0, (now - numbers[TIME]) / numbers[STEP])), jacobian, work)
    collide(parts, world, crowd, i, j, now, logs.encounters[logs.count[1]], jacobian)
    logs.count[1] += 1
    set_event(world, crowd, i, now, PLAN, -1)
    set_event(world, crowd, j, now, PLAN, -1)
    return ACCEPTED


@shared
def depart(world: World | None, crowd: Crowd, heads: Any, i: int) -> None:
    """Take a grain out of the run."""
    set_event(world, crowd, i, math.inf, GONE, -1)
    if world is not None:
        leave_cell(crowd, heads, i)


@shared
def serve(
    parts: Parts,
    world: World | None,
    crowd: Crowd,
    heads: Any,
    samples: Samples,
    logs: Logs,
    i: int,
    jacobian: Floats,
    work: flight.Work,
    other: Floats,
    record: _march.Record,
    fitted: bool,
) -> int:
    """Serve a grain's next event: ACCEPTED, or why the caller is needed. `fitted`: `work` holds its polynomial."""
    now, kind = crowd.clock[i], index(crowd.kind[i])
    if kind in (PLAN, AGAIN, ROUGH):
        code = plan(parts, world, crowd, heads, logs, i, jacobian, work)
        if code != ACCEPTED:
            logs.count[2] = i
            if code == flight.ALOFT:
                depart(world, crowd, heads, i)
            return code
        if world is None:
            set_event(world, crowd, i, crowd.path[i, END], index(crowd.own[i]), -1)
            return ACCEPTED
    if world is not None:
        if kind in (PLAN, AGAIN, ROUGH, SEEK):
            seek(parts, world, crowd, heads, i, now, work, other)
            return ACCEPTED
        if kind == ENCOUNTER:
            if logs.count[1] >= len(logs.encounters):
                return ENCOUNTERS_FULL
            return encounter(parts, world, crowd, samples, logs, i, now, jacobian, work)
    if kind == IMPACT and logs.count[0] >= len(logs.jumps):
        return JUMPS_FULL
    if not fitted:
        polynomial_of(parts, crowd, i, work.polynomial)
    code = finish(parts, crowd, samples, logs, i, jacobian, work, record)
    if code == flight.REST:
        logs.count[2] = i
        depart(world, crowd, heads, i)
        return code
    set_event(world, crowd, i, now, PLAN, -1)
    return ACCEPTED


def _make_advance(digest: str) -> Callable[..., Any]:
    def advance(
        parts: Parts,
        world: World | None,
        crowd: Crowd,
        heads: Any,
        samples: Samples,
        logs: Logs,
        jacobian: Floats,
        work: flight.Work,
        other: Floats,
        record: _march.Record,
        until: float,
    ) -> int:
        """Serve events up to `until`: UNTIL, or why the caller is needed."""
        digest  # noqa: B018 - part of the cache key
        if world is None:
            for i in range(len(crowd.clock)):
                fitted = False
                while crowd.clock[i] <= until:
                    code = serve(parts, world, crowd, heads, samples, logs, i, jacobian, work, other, record, fitted)
                    if code != ACCEPTED:
                        return code
                    fitted = True
            return UNTIL
        while True:
            grain = index(crowd.heap[0])
            if not crowd.clock[grain] <= until or crowd.kind[grain] == GONE:
                return UNTIL
            code = serve(parts, world, crowd, heads, samples, logs, grain, jacobian, work, other, record, False)
            if code != ACCEPTED:
                return code

    return advance


advance = compiled(_make_advance, allocates=False, usually="some 30 s")


def _make_flush(digest: str) -> Callable[..., Any]:
    def flush(parts: Parts, crowd: Crowd, samples: Samples, work: flight.Work, until: float) -> None:
        """Write all samples up to `until`, which every step in hand reaches."""
        digest  # noqa: B018 - part of the cache key
        for i in range(len(crowd.clock)):
            if crowd.kind[i] != GONE and crowd.sample[i] * samples.interval <= until:
                polynomial_of(parts, crowd, i, work.polynomial)
                write_samples(parts.model, crowd, samples, i, work.polynomial, until, work.here[0])

    return flush


flush = compiled(_make_flush, allocates=False)


def empty_crowd(grains: int, states: int, members: int, terms: int, stages: int) -> Crowd:
    """Room for so many grains, all about to plan their first step."""
    shapes: dict[str, tuple[int, ...]] = {
        "y": (states,), "rate": (states,), "past": (members, terms), "jump": (members,), "numbers": (flight.NUMBERS,), "spin": (4,), "flight": (14,),
        "values": (stages, states), "before": (), "diagonal": (states,), "share": (), "path": (12,),
        "clock": (), "calm": (),
    }  # fmt: skip
    whole: dict[str, Any] = dict.fromkeys(("partner", "cell", "link", "burst", "heap", "place"), np.int32) | {
        "sample": np.int64,
        "kind": np.int8,
        "own": np.int8,
    }
    arrays: dict[str, Any] = {name: np.zeros((grains, *shape)) for name, shape in shapes.items()}
    arrays |= {name: np.zeros(grains, dtype=kind) for name, kind in whole.items()}
    for name in ("partner", "cell", "link"):
        arrays[name][:] = -1
    arrays["kind"][:] = PLAN
    arrays["heap"][:] = arrays["place"][:] = np.arange(grains)
    return Crowd(**arrays)
