"""Many grains in one compiled run: each with its own graded steps, encounters by event time from the step polynomials.

Every grain has one step that is found but not yet taken (its current step), valid up to its end or to its impact on the bed. The
grain with the earliest event comes next: a step that ends is taken and the next one is found; an impact or an encounter truncates
the steps where it happens. No grain is advanced beyond what is certain, so no step is undone and no state has to be saved. Without
encounters the grains are advanced one after the other, without heap and cells.

A pair's gap g = |r| − 1 falls no faster than g'(t) allows with what the step says about accelerations, because |r|'' ≥ −|a|:
the time to the next check follows from that bound and no encounter is missed (conservative advancement, Mirtich 1996).

A step's positions and slips are two polynomials that agree at the nodes only. Here a grain moves along one path per step: its
position is the integral of its velocity, which begins with that of the state. A gap that closes does so at a rate below 0,
and a pair that separates after an encounter stays apart: no pair overlaps, however coarse the steps are.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, compiled, record_type, shared
from basset.kernels import Floats
from basset.solvers import stepper
from basset.solvers.events import all_at, copy
from basset.solvers.stepper import ACCEPTED, NOT_FINITE, TOO_SMALL
from saltation.bed.contact import strike_pair
from saltation.flight import contact, equations, layout, loop
from saltation.grain import Triple

STEP_END, IMPACT, ENCOUNTER, FIND_STEP, FIND_ENCOUNTER, GONE, KINK = range(7)  # kinds of a grain's next event
UNTIL, PILE_UP, ENCOUNTERS_FULL, JUMPS_FULL = 40, 41, 42, 43  # why `advance` returns, beside the codes of a flight
# of a step's path: times; middle and velocity of the chord; bounds: distance from the chord, velocity against its, and of the acceleration
# bend + root/(2√t), t since the step's start
PATH = record_type("begin", "end", "x", "y", "z", "u", "v", "w", "spread", "pace", "bend", "root")
# rows written; the grain that stopped the run; steps that were too short to be resolved
COUNT = record_type(("jumps", "i8"), ("encounters", "i8"), ("grain", "i8"), ("unresolved", "i8"))
REACH = 2.0  # d: half a step's path is at most this long
DEEPEST_OVERLAP = 1e-10  # d
MARGIN = math.sqrt(2.0)  # |p| on [−1, 1] over the largest at the zeros of T_2n, for degrees up to n: Ehlich & Zeller (1964), Math. Z. 86, 41
# what corrects the velocity at the start of a path, in Legendre polynomials on [0, 1]: θ(1 − θ)², s(1 − s)²(1 + 2s), s²(1 − s)²/2
RISE = (1.0 / 12.0, -1.0 / 20.0, -1.0 / 12.0, 1.0 / 20.0)
SLOPE = (3.0 / 20.0, -1.0 / 20.0, -5.0 / 28.0, 1.0 / 20.0, 1.0 / 35.0)
CURVE = (1.0 / 60.0, 0.0, -1.0 / 42.0, 0.0, 1.0 / 140.0)


class Domain(NamedTuple):
    """Periodic lengths (d, infinite where open), cells, the pair law, and how many encounters are a pile-up.

    Grains that would part more slowly than `minimum_separation_speed` (V) part with it: without, grains that are pressed together meet
    infinitely often in a finite time. `collapse_limit`: encounters of one grain within one d/V.
    """

    length: float
    width: float
    cell_x: float
    cell_y: float
    along: int
    across: int
    restitution: float
    friction: float
    minimum_separation_speed: float
    collapse_limit: int


class Grains(NamedTuple):
    """All grains, one row each: what a single grain has in its own arrays, and its next event."""

    y: Floats
    rate: Floats
    past: Floats
    jump: Floats
    control: Any
    spin: Floats
    flight: Any
    values: Floats
    diagonal: Floats  # of the Jacobian, (1, states)
    share: Floats  # θ at which the current step ends
    path: Any  # of the current step: its times, its chord, and bounds on what leaves the chord
    clock: Floats  # time of the next event
    counting_since: Floats  # when the count of encounters began
    sample: Any  # next sample to be written
    kind: Any  # of the next event
    own: Any  # what happens at the end of the current step
    partner: Any
    cell: Any
    next_in_cell: Any  # next grain in the same cell, −1 at the end
    encounter_count: Any  # encounters since then
    heap: Any  # grains in order of events
    place: Any  # of each grain in the heap


class Samples(NamedTuple):
    """Kept positions and velocities: every `interval` (d/V), from number `first` on, (sample, grain, 2·dimensions)."""

    interval: float
    first: Any
    values: Floats


class Logs(NamedTuple):
    """Jumps (as of a flight) and whose they are, encounters (see `layout.ENCOUNTER`), how many of them are written (see COUNT)."""

    jumps: Floats
    owners: Any
    encounters: Any
    count: Any  # (1,)


class Course(NamedTuple):
    """A step's path in Legendre polynomials of s = θ, in a singular step √θ: all states less those at its start, and the velocity."""

    states: Floats  # (stages + 1, states)
    velocity: Floats  # (stages, 3)


Courses = tuple[Course, Course]  # room for those of two grains: the first one's states are the polynomial of the work space


class Parts(NamedTuple):
    """What stays the same during a run: how the grain that is loaded flies, whichever it is; `rough`: the attempt at a step that cannot
    be small enough, since two contacts follow each other too closely.
    """

    steps: loop.Steps
    rough: Any


@shared
def index(number: Any) -> Any:
    """One type for all numbers of grains: every function is compiled once."""
    return np.int64(number)


# The order of events


@shared
def less(grains: Grains, one: int, other: int) -> bool:
    """Which of two grains comes first; ties by number, so that the order never depends on the past."""
    a, b = grains.clock[one], grains.clock[other]
    return a < b or (a == b and one < other)


@shared
def sift(grains: Grains, grain: int) -> None:
    """Put a grain whose event has changed into its place of the heap."""
    heap, place = grains.heap, grains.place
    k = place[grain]
    while k > 0:
        parent = (k - 1) // 2
        if not less(grains, grain, heap[parent]):
            break
        heap[k] = heap[parent]
        place[heap[k]] = k
        k = parent
    count = len(heap)
    while True:
        child = 2 * k + 1
        if child >= count:
            break
        if child + 1 < count and less(grains, heap[child + 1], heap[child]):
            child += 1
        if not less(grains, heap[child], grain):
            break
        heap[k] = heap[child]
        place[heap[k]] = k
        k = child
    heap[k] = grain
    place[grain] = k


@shared
def set_event(domain: Domain | None, grains: Grains, grain: int, time: float, kind: int, partner: int) -> None:
    """Give a grain its next event."""
    grains.clock[grain], grains.kind[grain], grains.partner[grain] = time, kind, partner
    if domain is not None:
        sift(grains, grain)


# Neighbours


@shared
def leave_cell(grains: Grains, first_in_cell: Any, grain: int) -> None:
    """Take a grain out of its cell."""
    cell, next_in_cell = grains.cell[grain], grains.next_in_cell
    if cell < 0:
        return
    if first_in_cell[cell] == grain:
        first_in_cell[cell] = next_in_cell[grain]
    else:
        other = first_in_cell[cell]
        while next_in_cell[other] != grain:
            other = next_in_cell[other]
        next_in_cell[other] = next_in_cell[grain]
    grains.cell[grain] = -1


@shared
def enter_cell(domain: Domain, grains: Grains, first_in_cell: Any, grain: int) -> None:
    """Put a grain into the cell over the middle of its path; open domains are folded, which only adds candidates."""
    column = math.floor(grains.path[grain].x / domain.cell_x) % domain.along
    row = math.floor(grains.path[grain].y / domain.cell_y) % domain.across
    cell = column * domain.across + row
    if cell != grains.cell[grain]:
        leave_cell(grains, first_in_cell, grain)
        grains.cell[grain], grains.next_in_cell[grain], first_in_cell[cell] = cell, first_in_cell[cell], grain


@shared
def nearest(difference: float, period: float) -> float:
    """A difference of positions in a periodic box."""
    if math.isinf(period):
        return difference
    return difference - period * math.floor(difference / period + 0.5)


@shared
def begin_with(model: layout.Model, singular: int, h: float, y: Floats, states: Floats, own: Any) -> None:
    """Let the positions of a step begin with the velocity of its states, their ends staying as they are.

    A singular step's positions are c₁√θ + …, c₁ of the size of its error: a pair would start at an infinite velocity.
    """
    d = model.dimensions
    start = equations.velocity_of(model, y, own)
    for a in range(d):
        speed = start[0] if a == 0 else start[2] if a == d - 1 else start[1]
        slope, curve, sign = 0.0, 0.0, 1.0
        for n in range(1, len(states)):  # P_n'(−1) and P_n''(−1), P_n of 2s − 1
            first = sign * n * (n + 1) * states[n, a]
            slope += first
            curve -= 0.5 * (n - 1) * (n + 2) * first
            sign = -sign
        if singular == 1:
            for n in range(5):
                states[n, a] += (2.0 * h * speed - curve) * CURVE[n] - slope * SLOPE[n]
        else:
            for n in range(4):
                states[n, a] += (h * speed - slope) * RISE[n]


@shared
def polynomial_of(parts: Parts, domain: Domain | None, grains: Grains, grain: int, states: Floats) -> None:
    """The polynomial of the current step; among grains that meet its positions are the integral of a velocity."""
    control = grains.control[grain]
    singular, h = int(control.singular), control.step
    stepper.fit_polynomial(parts.steps.flight.parts.nodes, singular, h, grains.values[grain], states)
    if domain is not None:
        begin_with(parts.steps.flight.model, singular, h, grains.y[grain], states, grains.spin[grain])


@shared
def differentiate(model: layout.Model, singular: int, h: float, course: Course) -> None:
    """The velocity of a path, dx/dθ/h, in a singular step dx/ds/(2sh)."""
    d = model.dimensions
    states, velocity = course.states, course.velocity
    top = len(velocity) - 1
    for n in range(top + 1):
        velocity[n, 1] = 0.0
    for a in range(d):
        axis = 2 if a == d - 1 else a
        for n in range(top + 1):
            total = 0.0
            for k in range(n + 1, top + 2, 2):
                total += states[k, a]
            velocity[n, axis] = 2.0 * (2 * n + 1) * total / h
        if singular == 1:  # 2s P_n = P_n + ((n + 1) P_(n+1) + n P_(n−1))/(2n + 1), from the highest term down
            newer, newest = 0.0, 0.0
            for n in range(top, 0, -1):
                here = (velocity[n, axis] - newer - (n + 1) / (2 * n + 3) * newest) * (2 * n - 1) / n
                velocity[n, axis] = newer
                newer, newest = here, newer
            velocity[0, axis] = newer


@shared
def course_of(parts: Parts, domain: Domain, grains: Grains, grain: int, course: Course) -> None:
    """The path of the current step."""
    polynomial_of(parts, domain, grains, grain, course.states)
    differentiate(parts.steps.flight.model, int(grains.control[grain].singular), grains.control[grain].step, course)


@shared
def place_and_velocity(model: layout.Model, course: Course, s: float) -> tuple[Triple, Triple]:
    """How far a grain has come at s of its step, and its velocity."""
    states, velocity = course.states, course.velocity
    high = model.dimensions - 1
    px, py, pz, u, v, w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x, older, newer = 2.0 * s - 1.0, 0.0, 1.0
    for n in range(len(states)):
        px, pz = px + newer * states[n, 0], pz + newer * states[n, high]
        if high == 2:
            py += newer * states[n, 1]
        if n < len(velocity):
            u, v, w = u + newer * velocity[n, 0], v + newer * velocity[n, 1], w + newer * velocity[n, 2]
        older, newer = newer, ((2 * n + 1) * x * newer - n * older) / (n + 1)
    return (px, py, pz), (u, v, w)


@shared
def velocity_slope(course: Course, s: float) -> float:
    """|dv/ds| at s of a step, V."""
    velocity = course.velocity
    u, v, w = 0.0, 0.0, 0.0
    x, older, newer, before, slope = 2.0 * s - 1.0, 1.0, 2.0 * s - 1.0, 0.0, 1.0  # P_(n−1), P_n, P_(n−1)', P_n'
    for n in range(1, len(velocity)):
        u, v, w = u + slope * velocity[n, 0], v + slope * velocity[n, 1], w + slope * velocity[n, 2]
        before, slope = slope, before + (2 * n + 1) * newer
        older, newer = newer, ((2 * n + 1) * x * newer - n * older) / (n + 1)
    return 2.0 * math.sqrt(u * u + v * v + w * w)


@shared
def describe_path(model: layout.Model, singular: int, h: float, share: float, y: Floats, course: Course, path: Any) -> float:
    """Chord of the step up to `share` and bounds on what leaves it, into `path`; half the length of the path."""
    length, end = h * share, math.sqrt(share) if singular == 1 else share
    (u, v, w) = place_and_velocity(model, course, 0.0)[1]
    if share > 1e-6:
        (u, v, w) = place_and_velocity(model, course, end)[0]
        u, v, w = u / length, v / length, w / length
    spread, pace, bend, places = 0.0, 0.0, 0.0, 2 * len(course.velocity)
    for k in range(places):
        s = 0.5 * end * (1.0 + math.cos(math.pi * (k + 0.5) / places))
        time = h * s * s if singular == 1 else h * s
        place, velocity = place_and_velocity(model, course, s)
        spread = max(spread, (place[0] - u * time) ** 2 + (place[1] - v * time) ** 2 + (place[2] - w * time) ** 2)
        pace = max(pace, (velocity[0] - u) ** 2 + (velocity[1] - v) ** 2 + (velocity[2] - w) ** 2)
        bend = max(bend, velocity_slope(course, s))
    spread, pace, bend = MARGIN * math.sqrt(spread) + 1e-9, MARGIN * math.sqrt(pace) + 1e-9, MARGIN * bend
    across = 0.0 if model.dimensions == 2 else y[1]
    high = model.dimensions - 1
    path.x, path.y, path.z = y[0] + 0.5 * u * length, across + 0.5 * v * length, y[high] + 0.5 * w * length
    path.u, path.v, path.w, path.spread, path.pace = u, v, w, spread, pace
    path.bend, path.root = (0.0, bend / math.sqrt(h)) if singular == 1 else (bend / h, 0.0)
    return 0.5 * length * math.sqrt(u * u + v * v + w * w) + spread


@shared
def may_touch(domain: Domain, one: Any, two: Any, start: float, end: float) -> bool:
    """Whether two paths may come within one diameter in [start, end]."""
    middle = 0.5 * (start + end)
    at_one, at_two = middle - 0.5 * (one.begin + one.end), middle - 0.5 * (two.begin + two.end)
    near = 1.0 + one.spread + two.spread
    half = 0.5 * (end - start)
    u, v, w = two.u - one.u, two.v - one.v, two.w - one.w
    z = two.z - one.z + two.w * at_two - one.w * at_one
    if abs(z) - abs(w) * half > near:
        return False
    x = nearest(two.x - one.x + two.u * at_two - one.u * at_one, domain.length)
    if abs(x) - abs(u) * half > near:
        return False
    y = nearest(two.y - one.y + two.v * at_two - one.v * at_one, domain.width)
    speed = u * u + v * v + w * w
    share = -(x * u + y * v + z * w)
    share = min(half, max(-half, share / speed)) if speed > 0.0 else 0.0
    x, y, z = x + u * share, y + v * share, z + w * share
    met: bool = x * x + y * y + z * z <= near * near
    return met


# When two grains meet


@shared
def share_at(grains: Grains, grain: int, time: float) -> float:
    """θ of the current step at a time."""
    control = grains.control[grain]
    theta: float = min(1.0, max(0.0, (time - control.time) / control.step))
    return theta


@shared
def at_time(model: layout.Model, grains: Grains, grain: int, course: Course, time: float) -> tuple[Triple, Triple]:
    """How far a grain has come at a time of its current step, and its velocity."""
    theta = share_at(grains, grain, time)
    return place_and_velocity(model, course, math.sqrt(theta) if grains.control[grain].singular else theta)


@shared
def image(domain: Domain, one: Any, two: Any, start: float, end: float) -> tuple[float, float]:
    """What to add to the second grain's x and y for its image that is the nearest midway through [start, end].

    The others stay away all the time: paths are 2 `REACH` long at most, boxes three times as long at least.
    """
    middle = 0.5 * (start + end)
    at_one, at_two = middle - 0.5 * (one.begin + one.end), middle - 0.5 * (two.begin + two.end)
    x = two.x - one.x + two.u * at_two - one.u * at_one
    y = two.y - one.y + two.v * at_two - one.v * at_one
    return nearest(x, domain.length) - x, nearest(y, domain.width) - y


@shared
def gap_and_rate(model: layout.Model, grains: Grains, i: int, j: int, one: Course, two: Course, shift: tuple[float, float], time: float) -> tuple[float, float]:
    """Gap between two surfaces and its rate of change."""
    high = model.dimensions - 1
    first, second = grains.y[i], grains.y[j]
    (a, b, c), (u, v, w) = at_time(model, grains, i, one, time)
    (e, f, g), (p, q, r) = at_time(model, grains, j, two, time)
    x, y, z = second[0] - first[0] + shift[0] + e - a, f - b, second[high] - first[high] + g - c
    if model.dimensions == 3:
        y += second[1] - first[1] + shift[1]
    distance = math.sqrt(x * x + y * y + z * z)
    return distance - 1.0, (x * (p - u) + y * (q - v) + z * (r - w)) / distance


@shared
def root_integral(age: float, time: float) -> float:
    """∫ from 0 to `time` of √(age + t) − √age."""
    value: float = 2.0 / 3.0 * ((age + time) ** 1.5 - age**1.5) - math.sqrt(age) * time
    return value


@shared
def surely_open_for(gap: float, rate: float, bend: float, one: float, two: float, age_one: float, age_two: float, left: float) -> float:
    """How long the gap surely stays open, at most `left`: gap + rate·t − bend·t²/2 − one·I₁ − two·I₂ ≥ 0, I_k = root_integral(age_k, t)."""
    if gap + rate * left - 0.5 * bend * left * left - one * root_integral(age_one, left) - two * root_integral(age_two, left) >= 0.0:
        return left
    if one == 0.0 and two == 0.0:
        root = math.sqrt(rate * rate + 2.0 * bend * gap)
        if rate > 0.0:
            return (rate + root) / bend
        return 2.0 * gap / (root - rate) if gap > 0.0 else 0.0
    time = left  # Newton's method comes down to the root from above: the bound is concave
    for _ in range(50):
        value = gap + rate * time - 0.5 * bend * time * time - one * root_integral(age_one, time) - two * root_integral(age_two, time)
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
        if gap + rate * time - 0.5 * bend * time * time - one * root_integral(age_one, time) - two * root_integral(age_two, time) >= 0.0:
            return time
        time *= 0.5
    return 0.0


@shared
def touch_and_close(gap: float, rate: float, rounding: float) -> bool:
    """Whether surfaces touch and approach; where they overlap by nearly `DEEPEST_OVERLAP`, at any negative rate."""
    return gap <= rounding and rate < (0.0 if gap < -0.99 * DEEPEST_OVERLAP else -rounding)


@shared
def meeting_time(model: layout.Model, domain: Domain, grains: Grains, i: int, j: int, one: Course, two: Course, start: float, end: float) -> float:
    """When two grains meet in [start, end], infinity if they do not, −t if they do not up to t and it takes too long to see beyond.

    Where they touch without approaching, the next check is when they may overlap by half of what is left to `DEEPEST_OVERLAP`.
    """
    first, second = grains.path[i], grains.path[j]
    shift = image(domain, first, second, start, end)
    rounding = 1e-12 + 1e-14 * abs(end)  # of positions, times and velocities
    speed = math.sqrt((second.u - first.u) ** 2 + (second.v - first.v) ** 2 + (second.w - first.w) ** 2) + first.pace + second.pace
    bend = first.bend + second.bend
    time, earlier = start, start
    gap, rate = gap_and_rate(model, grains, i, j, one, two, shift, time)
    for _ in range(1000):
        if touch_and_close(gap, rate, rounding):
            break
        if gap > speed * (end - time):
            return math.inf
        left, age_one, age_two = end - time, max(0.0, time - first.begin), max(0.0, time - second.begin)
        pause = surely_open_for(max(gap, 0.0), rate, bend, first.root, second.root, age_one, age_two, left)
        if gap < DEEPEST_OVERLAP and rate >= -rounding:
            spare = max(0.5 * (DEEPEST_OVERLAP + min(gap, 0.0)), 1e-16)
            pause = max(pause, surely_open_for(spare, min(rate, 0.0), bend, first.root, second.root, age_one, age_two, left))
        pause = max(pause, gap / speed, 4e-16 * (1.0 + abs(time)))
        if pause >= left:
            return math.inf
        earlier = time
        time += pause
        gap, rate = gap_and_rate(model, grains, i, j, one, two, shift, time)
    if not touch_and_close(gap, rate, rounding):
        return -time
    if gap < 0.0:  # back to where they began to meet
        late = time
        for _ in range(80):
            time = 0.5 * (earlier + late)
            if not earlier < time < late:
                break
            gap, rate = gap_and_rate(model, grains, i, j, one, two, shift, time)
            if touch_and_close(gap, rate, rounding):
                late = time
            else:
                earlier = time
        time = late
    return time


@shared
def find_encounter(parts: Parts, domain: Domain, grains: Grains, first_in_cell: Any, i: int, now: float, courses: Courses) -> None:
    """Find the earliest encounter of grain i in the current step, and make it the next event of both."""
    path = grains.path
    mine = path[i]
    start, best, chosen = max(now, mine.begin), mine.end, index(-1)
    column, row = math.floor(mine.x / domain.cell_x), math.floor(mine.y / domain.cell_y)
    reach = 1.0 + REACH + 0.5 * (mine.end - mine.begin) * math.sqrt(mine.u**2 + mine.v**2 + mine.w**2) + mine.spread
    long, wide = math.ceil(reach / domain.cell_x), math.ceil(reach / domain.cell_y)
    fitted = False
    for p in range(min(2 * long + 1, domain.along)):
        for q in range(min(2 * wide + 1, domain.across)):
            j = index(first_in_cell[((column - long + p) % domain.along) * domain.across + (row - wide + q) % domain.across])
            while j >= 0:
                if j != i:
                    begin, end = max(start, path[j].begin), min(best, grains.clock[j], path[j].end)
                    if end > begin and may_touch(domain, mine, path[j], begin, end):
                        if not fitted:
                            course_of(parts, domain, grains, i, courses[0])
                            fitted = True
                        course_of(parts, domain, grains, j, courses[1])
                        time = meeting_time(parts.steps.flight.model, domain, grains, i, j, courses[0], courses[1], begin, end)
                        if abs(time) < best:
                            best, chosen = abs(time), j if time >= 0.0 else index(-1)
                j = index(grains.next_in_cell[j])
    if chosen < 0:
        set_event(domain, grains, i, best, index(grains.own[i]) if best == mine.end else FIND_ENCOUNTER, -1)
        return
    if grains.kind[chosen] == ENCOUNTER:  # which will not happen: its partner has to search again
        set_event(domain, grains, index(grains.partner[chosen]), now, FIND_ENCOUNTER, -1)
    set_event(domain, grains, i, best, ENCOUNTER, chosen)
    set_event(domain, grains, chosen, best, ENCOUNTER, i)


# Steps


@shared
def copy_rows(source: Floats, target: Floats) -> None:
    """A matrix into another."""
    for a in range(len(source)):
        copy(source[a], target[a])


@shared
def load_grain(grains: Grains, i: int, g: loop.Flight) -> None:
    """Load a grain into the arrays that steps work on."""
    p, state = g.parts, g.parts.state
    copy(grains.y[i], state.y)
    copy(grains.rate[i], state.rate)
    copy_rows(grains.past[i], state.past)
    copy(grains.jump[i], state.jump)
    copy_rows(grains.diagonal[i], state.jacobian)
    state.control[0] = grains.control[i]
    copy(grains.spin[i], p.equation.own)
    g.account[0] = grains.flight[i]
    copy_rows(grains.values[i], p.values)


@shared
def store_grain(grains: Grains, i: int, g: loop.Flight) -> None:
    """Put a grain back, with what taking a step has changed."""
    p, state = g.parts, g.parts.state
    copy(state.y, grains.y[i])
    copy(state.rate, grains.rate[i])
    copy_rows(state.past, grains.past[i])
    copy(state.jump, grains.jump[i])
    grains.control[i] = state.control[0]
    copy(p.equation.own, grains.spin[i])
    grains.flight[i] = g.account[0]


@shared
def store_step(grains: Grains, i: int, g: loop.Flight) -> None:
    """Put a grain back, with what finding a step has changed."""
    p = g.parts
    copy_rows(p.state.jacobian, grains.diagonal[i])
    grains.control[i] = p.state.control[0]
    copy_rows(p.values, grains.values[i])


@shared
def find_step(parts: Parts, domain: Domain | None, grains: Grains, first_in_cell: Any, logs: Logs, i: int, courses: Courses) -> int:
    """Find the next step of the loaded grain: ACCEPTED, or why not. Its polynomial is left in the work space."""
    steps = parts.steps
    g, p = steps.flight, steps.flight.parts
    model, problem, state, control, signal, polynomial = g.model, p.problem, p.state, p.state.control[0], p.work.signal, p.work.polynomial
    if control.time - g.account[0].start > g.limits.longest:
        return layout.ALOFT
    if control.steps == 0 and g.bed.highest > -math.inf:
        loop.set_tolerance(g, math.inf)
    while True:
        call(steps.attempt, 0.0, signal, 0, signal, 0, signal)
        code = int(signal[0, 0])
        if domain is not None and code in (TOO_SMALL, NOT_FINITE) and control.step < 4.0 * problem.floor:
            # what happens between two contacts that follow each other more closely than that cannot be resolved
            control.step = 8.0 * problem.floor
            call(parts.rough, 0.0, signal, 0, signal, 0, signal)
            code = int(signal[0, 0])
            logs.count[0].unresolved += 1
        store_step(grains, i, g)
        if code != ACCEPTED:
            return code
        h, singular = control.step, int(control.singular)
        polynomial_of(parts, domain, grains, i, polynomial)
        call(steps.look, float(g.bed.grain + i), signal, 0, signal, 0, signal)
        contact, kink = signal[0, 0], signal[0, 1]
        share = min(contact, kink, 1.0)
        grains.share[i] = share
        grains.own[i] = STEP_END if min(contact, kink) > 1.0 else KINK if kink < contact else IMPACT
        path = grains.path[i]
        path.begin, path.end = control.time, control.time + h * share
        if domain is None:
            return ACCEPTED
        differentiate(model, singular, h, courses[0])
        reach = describe_path(model, singular, h, share, state.y, courses[0], path)
        if reach <= REACH:
            enter_cell(domain, grains, first_in_cell, i)
            return ACCEPTED
        control.step = 0.9 * h * share * REACH / reach


@shared
def write_samples(model: layout.Model, grains: Grains, samples: Samples, i: int, polynomial: Floats, until: float, row: Floats) -> None:
    """Samples of the current step up to a time: x, [y,] z, u, [v,] w; `row` is overwritten."""
    d = model.dimensions
    while grains.sample[i] * samples.interval <= until and 0 <= grains.sample[i] - samples.first[0] < len(samples.values):
        theta = share_at(grains, i, grains.sample[i] * samples.interval)
        all_at(polynomial, grains.y[i], int(grains.control[i].singular), theta, row)
        kept = samples.values[grains.sample[i] - samples.first[0], i]
        for a in range(2 * d):
            kept[a] = row[a]
        u, v, w = equations.velocity_of(model, row, grains.spin[i])
        kept[d], kept[2 * d - 1] = u, w
        if model.dimensions == 3:
            kept[d + 1] = v
        grains.sample[i] += 1


@shared
def truncate_at(parts: Parts, grains: Grains, samples: Samples, i: int, now: float, theta: float) -> None:
    """Take the step of the loaded grain up to θ, at time `now`; its polynomial is in the work space."""
    g, p = parts.steps.flight, parts.steps.flight.parts
    control, signal, polynomial = p.state.control[0], p.work.signal, p.work.polynomial
    write_samples(g.model, grains, samples, i, polynomial, now, p.work.before)
    contact.record_top_and_turning(g.model, polynomial, p.state.y, int(control.singular), control.step, theta, g.account[0], p.equation.own)
    call(parts.steps.truncate, theta, signal, 0, signal, 0, signal)
    control.time = now


@shared
def take_step(parts: Parts, grains: Grains, samples: Samples, logs: Logs, i: int) -> int:
    """Take the step of the loaded grain to its own end: ACCEPTED or REST. Its polynomial is in the work space."""
    now = grains.path[i].end
    g, p = parts.steps.flight, parts.steps.flight.parts
    state, control, signal, model = p.state, p.state.control[0], p.work.signal, g.model
    if grains.own[i] == STEP_END:
        singular, h = int(control.singular), control.step
        write_samples(model, grains, samples, i, p.work.polynomial, now, p.work.before)
        contact.record_top_and_turning(model, p.work.polynomial, state.y, singular, h, 1.0, g.account[0], p.equation.own)
        call(parts.steps.accept, 0.0, signal, 0, signal, 0, signal)
        if h <= 2.0 * p.problem.floor:
            p.equation.own[3] = equations.layer_of(model, state.y[model.dimensions - 1], equations.rise_of(model, state.y, p.equation.own))
        return ACCEPTED
    truncate_at(parts, grains, samples, i, now, grains.share[i])
    if grains.own[i] == KINK:
        equations.cross_kink(model, p)
        return ACCEPTED
    row = index(logs.count[0].jumps)
    logs.owners[row] = i
    logs.count[0].jumps += 1
    call(parts.steps.land, float(g.bed.grain + i), signal, 0, logs.jumps, row, signal)
    return int(signal[0, 0])


@shared
def collide(parts: Parts, domain: Domain, grains: Grains, i: int, j: int, time: float, row: Any) -> None:
    """Two grains in contact, their velocities being in `row`: these, spins and memories jump, and the encounter is written down."""
    g, p = parts.steps.flight, parts.steps.flight.parts
    model = g.model
    d = model.dimensions
    first, second = grains.y[i], grains.y[j]
    x, z = nearest(second[0] - first[0], domain.length), second[d - 1] - first[d - 1]
    y = 0.0 if model.dimensions == 2 else nearest(second[1] - first[1], domain.width)
    distance = math.sqrt(x * x + y * y + z * z)
    nx, ny, nz = x / distance, y / distance, z / distance
    stream_one, stream_two = equations.stream_of(model, first, grains.spin[i]), equations.stream_of(model, second, grains.spin[j])
    velocity = row.velocity
    u, v = (velocity[0, 0], velocity[0, 1], velocity[0, 2]), (velocity[1, 0], velocity[1, 1], velocity[1, 2])
    spin_one, spin_two = contact.spin_of(model, first, grains.spin[i]), contact.spin_of(model, second, grains.spin[j])
    closing = (u[0] - v[0]) * nx + (u[1] - v[1]) * ny + (u[2] - v[2]) * nz
    restitution = domain.restitution
    if closing > 0.0 and restitution * closing < domain.minimum_separation_speed:
        restitution = domain.minimum_separation_speed / closing
    after = strike_pair(nx, ny, nz, u, v, spin_one, spin_two, (0.5, 0.5), (1.0, 1.0), restitution, domain.friction)
    row.time, row.first, row.second = time, i, j
    row.x, row.y, row.z = first[0], (0.0 if model.dimensions == 2 else first[1]), first[d - 1]
    row.n_x, row.n_y, row.n_z, row.distance, row.restitution = nx, ny, nz, distance, restitution
    spin, velocity_after, spin_after, impulse = row.spin, row.velocity_after, row.spin_after, row.impulse
    for k in range(3):
        spin[0, k], spin[1, k], impulse[k] = spin_one[k], spin_two[k], after[4][k]
        velocity_after[0, k], velocity_after[1, k], spin_after[0, k], spin_after[1, k] = after[0][k], after[1][k], after[2][k], after[3][k]
    for side in range(2):
        grain = i if side == 0 else j
        load_grain(grains, grain, g)
        u, v, w = velocity_after[side, 0], velocity_after[side, 1], velocity_after[side, 2]
        contact.apply_rebound(model, g.memory, p.problem, p.state, stream_two if side == 1 else stream_one, u, v, w)
        if not g.limits.prescribed:
            contact.set_spin(model, p.state.y, p.equation.own, spin_after[side, 0], spin_after[side, 1], spin_after[side, 2])
        store_grain(grains, grain, g)


@shared
def collapsing(domain: Domain, grains: Grains, grain: int, now: float) -> bool:
    """Whether a grain has had too many encounters within one d/V."""
    if now - grains.counting_since[grain] > 1.0:
        grains.counting_since[grain], grains.encounter_count[grain] = now, 0
    grains.encounter_count[grain] += 1
    many: bool = grains.encounter_count[grain] > domain.collapse_limit
    return many


@shared
def encounter(parts: Parts, domain: Domain, grains: Grains, samples: Samples, logs: Logs, i: int, now: float, courses: Courses) -> int:
    """Two grains meet: ACCEPTED or PILE_UP."""
    j, model = index(grains.partner[i]), parts.steps.flight.model
    for side in range(2):
        grain = i if side == 0 else j
        if collapsing(domain, grains, grain, now):
            logs.count[0].grain = grain
            return PILE_UP
    row = logs.encounters[logs.count[0].encounters]
    for side in range(2):
        grain = i if side == 0 else j
        course_of(parts, domain, grains, grain, courses[0])
        velocity = row.velocity
        velocity[side, 0], velocity[side, 1], velocity[side, 2] = at_time(model, grains, grain, courses[0], now)[1]
        load_grain(grains, grain, parts.steps.flight)
        truncate_at(parts, grains, samples, grain, now, share_at(grains, grain, now))
        store_grain(grains, grain, parts.steps.flight)
    collide(parts, domain, grains, i, j, now, row)
    logs.count[0].encounters += 1
    set_event(domain, grains, i, now, FIND_STEP, -1)
    set_event(domain, grains, j, now, FIND_STEP, -1)
    return ACCEPTED


@shared
def leave_run(domain: Domain | None, grains: Grains, first_in_cell: Any, i: int) -> None:
    """Remove a grain from the run."""
    set_event(domain, grains, i, math.inf, GONE, -1)
    if domain is not None:
        leave_cell(grains, first_in_cell, i)


@shared
def handle_event(
    parts: Parts, domain: Domain | None, grains: Grains, first_in_cell: Any, samples: Samples, logs: Logs, i: int, courses: Courses, loaded: bool
) -> int:
    """Handle a grain's next event: ACCEPTED, or why the caller is needed. `loaded`: it was the last one, its polynomial is in the work space."""
    now, kind, g = grains.clock[i], index(grains.kind[i]), parts.steps.flight
    if kind == FIND_STEP:
        if not loaded:
            load_grain(grains, i, g)
        code = find_step(parts, domain, grains, first_in_cell, logs, i, courses)
        if code != ACCEPTED:
            logs.count[0].grain = i
            if code == layout.ALOFT:
                leave_run(domain, grains, first_in_cell, i)
            return code
        if domain is None:
            set_event(domain, grains, i, grains.path[i].end, index(grains.own[i]), -1)
            return ACCEPTED
    if domain is not None:
        if kind in (FIND_STEP, FIND_ENCOUNTER):
            find_encounter(parts, domain, grains, first_in_cell, i, now, courses)
            return ACCEPTED
        if kind == ENCOUNTER:
            if logs.count[0].encounters >= len(logs.encounters):
                return ENCOUNTERS_FULL
            return encounter(parts, domain, grains, samples, logs, i, now, courses)
    if kind == IMPACT and logs.count[0].jumps >= len(logs.jumps):
        return JUMPS_FULL
    if not loaded:
        load_grain(grains, i, g)
        polynomial_of(parts, domain, grains, i, g.parts.work.polynomial)
    code = take_step(parts, grains, samples, logs, i)
    store_grain(grains, i, g)
    if code == layout.REST:
        logs.count[0].grain = i
        leave_run(domain, grains, first_in_cell, i)
        return code
    set_event(domain, grains, i, now, FIND_STEP, -1)
    return ACCEPTED


@compiled(allocates=False, usually="some 20 s")
def advance(parts: Parts, domain: Domain | None, grains: Grains, first_in_cell: Any, samples: Samples, logs: Logs, courses: Courses, until: float) -> int:
    """Handle events up to `until`: UNTIL, or why the caller is needed."""
    if domain is None:
        for i in range(len(grains.clock)):
            loaded = False
            while grains.clock[i] <= until:
                code = handle_event(parts, domain, grains, first_in_cell, samples, logs, i, courses, loaded)
                if code != ACCEPTED:
                    return code
                loaded = True
        return UNTIL
    while True:
        grain = index(grains.heap[0])
        if not grains.clock[grain] <= until or grains.kind[grain] == GONE:
            return UNTIL
        code = handle_event(parts, domain, grains, first_in_cell, samples, logs, grain, courses, False)
        if code != ACCEPTED:
            return code


@compiled(allocates=False)
def flush(parts: Parts, domain: Domain | None, grains: Grains, samples: Samples, until: float) -> None:
    """Write all samples up to `until`, which every current step reaches."""
    g, work = parts.steps.flight, parts.steps.flight.parts.work
    for i in range(len(grains.clock)):
        if grains.kind[i] != GONE and grains.sample[i] * samples.interval <= until:
            polynomial_of(parts, domain, grains, i, work.polynomial)
            write_samples(g.model, grains, samples, i, work.polynomial, until, work.before)


def empty_grains(number: int, states: int, members: int, terms: int, stages: int, own: int) -> Grains:
    """Room for so many grains, without a step yet."""
    shapes: dict[str, tuple[int, ...]] = {
        "y": (states,), "rate": (states,), "past": (members, terms), "jump": (members,), "spin": (own,),
        "values": (stages, states), "diagonal": (1, states), "share": (),
        "clock": (), "counting_since": (),
    }  # fmt: skip
    whole: dict[str, Any] = dict.fromkeys(("partner", "cell", "next_in_cell", "encounter_count", "heap", "place"), np.int32) | {
        "sample": np.int64,
        "kind": np.int8,
        "own": np.int8,
        "control": stepper.CONTROL,
        "flight": layout.FLIGHT,
        "path": PATH,
    }
    arrays: dict[str, Any] = {name: np.zeros((number, *shape)) for name, shape in shapes.items()}
    arrays |= {name: np.zeros(number, dtype=kind) for name, kind in whole.items()}
    for name in ("partner", "cell", "next_in_cell"):
        arrays[name][:] = -1
    arrays["kind"][:] = FIND_STEP
    arrays["heap"][:] = arrays["place"][:] = np.arange(number)
    return Grains(**arrays)
