"""A grain under weight and drag in the plane, written by hand: what the general flight of `saltation` is measured against.

The arithmetic is that of `basset.solvers.stepper` and `saltation.flight` for this one case, number by number: the same nodes, ladder of steps, first
guess, Newton iteration, error estimate, contact search and rebound. Everything else is what a general loop cannot do: four
states by name instead of an array, one drag law, one roughness, one rebound, no memory, no spin, nothing recorded.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from basset._compile import compiled, load, shared
from basset.kernels import Floats
from basset.solvers.stepper import invert
from saltation._random import uniforms

SPAN, LADDER, FIRST = 16.0, 8, 0.02  # longest step (d/u*), sizes per octave, first step of a flight
SHORTEST = 0.01  # the tolerance follows the likely length of a flight, down to this share
ACCURATE, MOST = 0.03, 30  # the stages: share of the tolerance, iterations
STEEPEST = math.radians(30.0)
DEPTH = 0.25  # of the bed level below the crests, d
HIGHEST = 0.75 + 1e-9  # contact, d


class Case(NamedTuple):
    """The numbers of one scene: α, weight along and normal to the bed, drag rate 18/Re*, Re*; bed; tolerance."""

    alpha: float
    along: float
    normal: float
    drag: float
    reynolds: float
    restitution: float
    retention: float
    seed: int
    tolerance: float
    floor: float
    profile: int  # address of the stream's polynomials, as in `saltation.flow`
    slope: float  # of the stream at the bed


class Nodes(NamedTuple):
    """Collocation at c: integrals, Legendre coefficients of the rate and of the state, values at the step's start."""

    c: Floats
    integral: Floats
    regular: Floats
    rise: Floats
    at_start: Floats


class Room(NamedTuple):
    """All overwritten: by stage unless said otherwise."""

    matrix: Floats  # (stage, stage)
    inverse: Floats  # (stage, stage)
    right: Floats
    v: Floats  # (4, stage): rates of x, z and the slips, the unknowns
    rate: Floats  # (4, stage): as the flow and the forces give them
    z: Floats
    p: Floats
    q: Floats
    before: Floats  # (4, degree): Legendre coefficients of the rates in the step before
    path: Floats  # (4, degree + 1): of the states in this one
    last: Floats  # (4,): rates at the end of the step before


@shared
def stream(case, z):
    """Velocity and shear."""
    if z <= 0.0:
        return 0.0, 0.0
    mantissa, exponent = math.frexp(z)
    if exponent <= -24:
        return case.slope * z, case.slope
    place = (mantissa - 0.5) * 16
    part = int(place)
    cell = ((exponent + 23) * 8 + part) * 10
    x = 2.0 * (place - part) - 1.0
    velocity, rise = load(case.profile, cell + 9), 0.0
    for k in range(8, -1, -1):
        rise = rise * x + velocity
        velocity = velocity * x + load(case.profile, cell + k)
    return velocity, rise * math.ldexp(32.0, -exponent)


@shared
def rates(case, z, p, q):
    """Rates of x, z and the slips p (along), q (up)."""
    velocity, shear = stream(case, z)
    reynolds = math.sqrt(p * p + q * q) * case.reynolds
    root = math.sqrt(reynolds)
    strength = -case.drag * (1.0 + 0.15 * root + 0.017 * reynolds - 0.208 / 24.0 * reynolds * root / (root + 1.0e4))
    return p + velocity, q, case.alpha * (case.along + strength * p) - shear * q, case.alpha * (-case.normal + strength * q)


@shared
def guess(case, nodes, room, y, h, past):
    """A first guess: the polynomial of the step before carried on, or the rate at the start."""
    c, v, before = nodes.c, room.v, room.before
    count = len(c)
    if past > 0.0:
        ratio = h / past
        for i in range(count):
            x = 1.0 + 2.0 * c[i] * ratio
            v0, v1 = before[0, 0] + before[0, 1] * x, before[1, 0] + before[1, 1] * x
            v2, v3 = before[2, 0] + before[2, 1] * x, before[3, 0] + before[3, 1] * x
            older, newer = 1.0, x
            for d in range(2, count):
                older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
                v0 += newer * before[0, d]
                v1 += newer * before[1, d]
                v2 += newer * before[2, d]
                v3 += newer * before[3, d]
            v[0, i], v[1, i], v[2, i], v[3, i] = v0, v1, v2, v3
        return
    first = rates(case, y[1], y[2], y[3])
    for i in range(count):
        v[0, i], v[1, i], v[2, i], v[3, i] = first


@shared
def stiffness(case, y):
    """One diagonal entry of the Jacobian for both slips, by forward differences."""
    z, p, q = y[1], y[2], y[3]
    here = rates(case, z, p, q)
    other = p + 1.5e-8 * max(abs(p), 1e-3)
    along = min(0.0, (rates(case, z, other, q)[2] - here[2]) / (other - p))
    other = q + 1.5e-8 * max(abs(q), 1e-3)
    up = min(0.0, (rates(case, z, p, other)[3] - here[3]) / (other - q))
    return 0.0 + along / 2 + up / 2


@shared
def relax(room, row, values, start, diagonal):
    """New rates of a slip: what the diagonal takes is solved for."""
    right, count = room.right, len(room.right)
    for i in range(count):
        right[i] = room.rate[row, i] - diagonal * (values[i] - start)
    for i in range(count):
        total = 0.0
        for k in range(count):
            total += room.inverse[i, k] * right[k]
        room.v[row, i] = total


@shared
def larger(size, floor, rtol, value, old, start):
    """The largest change of a state, and of rounding, over the tolerance so far."""
    scale = rtol + rtol * (abs(start) + abs(value))
    change = abs(value - old) / scale
    if not change <= size:
        size = change
    return size, max(floor, 4e-16 * abs(value) / scale)


@shared
def solve(case, nodes, room, y, h, past, diagonal):
    """The stages of one step: iterations, negative if it failed."""
    integral, matrix, inverse, right, v, rate, z, p, q = nodes.integral, room.matrix, room.inverse, room.right, room.v, room.rate, room.z, room.p, room.q
    count, rtol = len(right), case.tolerance
    y1, y2, y3 = y[1], y[2], y[3]
    for i in range(count):
        for k in range(count):
            matrix[i, k] = -h * diagonal * integral[i, k]
        matrix[i, i] += 1.0
    invert(matrix, inverse)
    guess(case, nodes, room, y, h, past)
    previous = math.inf
    for iteration in range(MOST):
        size, floor = 0.0, 0.0
        if iteration > 0:
            relax(room, 2, p, y2, diagonal)
            relax(room, 3, q, y3, diagonal)
        for i in range(count):
            b, c = 0.0, 0.0
            for k in range(count):
                share = integral[i, k]
                b += share * v[2, k]
                c += share * v[3, k]
            b, c = y2 + h * b, y3 + h * c
            if iteration > 0:
                size, floor = larger(size, floor, rtol, b, p[i], y2)
                size, floor = larger(size, floor, rtol, c, q[i], y3)
                rate[0, i] += b - p[i]
                rate[1, i] += c - q[i]
                v[1, i] = rate[1, i]
            p[i], q[i] = b, c
        for i in range(count):
            a = 0.0
            for k in range(count):
                a += integral[i, k] * v[1, k]
            a = y1 + h * a
            if iteration > 0:
                size, floor = larger(size, floor, rtol, a, z[i], y1)
            z[i] = a
        if iteration > 0:
            if not math.isfinite(size):
                return -iteration
            if size <= max(ACCURATE, floor) or (iteration > 4 and 0.9 * previous < size <= max(0.1, 10.0 * floor)):
                for i in range(count):
                    v[0, i] = rate[0, i]
                return iteration
            if iteration > 4 and size > 0.9 * previous:
                return -iteration
            previous = size
        for i in range(count):
            rate[0, i], rate[1, i], rate[2, i], rate[3, i] = rates(case, z[i], p[i], q[i])
    return -MOST


@shared
def error_of(case, nodes, room, y, h, smooth):
    """The local error over the tolerance, from the decay of the Legendre coefficients and the kink to the step before."""
    count, worst, rtol = len(nodes.c), 0.0, case.tolerance
    regular, weights, at_start, v, last = nodes.regular, nodes.integral[count - 1], nodes.at_start, room.v, room.last
    for a in range(4):
        end, oldest, older, before, newest = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(count):
            end += weights[i] * v[a, i]
            coefficient = 0.0
            for k in range(count):
                coefficient += regular[i, k] * v[a, k]
            oldest, older, before, newest = older, before, newest, h * abs(coefficient)
        end = y[a] + h * end
        decay = math.sqrt(min(1.0, max(newest, before) / max(1e-300, older, oldest)))
        tail = 4.0 * decay * max(newest, decay * before)
        if smooth:
            kink = -last[a]
            for k in range(count):
                kink += at_start[k] * v[a, k]
            tail = max(tail, h * nodes.c[0] * abs(kink))
        error = tail / (rtol + rtol * max(abs(y[a]), abs(end)))
        if not error <= worst:
            worst = error
    return worst


@shared
def at(path, y, theta, a):
    """State a at θ of the step."""
    x = 2.0 * theta - 1.0
    older, newer, total = 1.0, x, y[a] + path[a, 0] + path[a, 1] * x
    for d in range(2, path.shape[1]):
        older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
        total += path[a, d] * newer
    return total


@shared
def tilt(u, w, share):
    """θ_b of the contact that a grain of this velocity meets, at most 30°."""
    incidence = math.atan2(max(0.0, -w), abs(u))
    if math.cos(incidence) < 1e-12:
        return 0.0
    return min(STEEPEST, math.acos(min(1.0, share * math.cos(incidence))) - incidence)


@shared
def gap(case, path, y, theta, share):
    """The larger of the height above the contact and the upward velocity."""
    z, w = at(path, y, theta, 1), at(path, y, theta, 3)
    if z >= HIGHEST:
        return max(z - HIGHEST, w) + 1e-300
    return max(z - (math.cos(tilt(at(path, y, theta, 2) + stream(case, z)[0], w, share)) - DEPTH), w)


@shared
def contact(case, path, y, share, fresh):
    """θ of the first contact in the step, 2 if there is none."""
    places = 2 * path.shape[1] + 1
    low, value_low = 0.0, 1.0 if fresh else gap(case, path, y, 0.0, share)
    if value_low <= 0.0:
        return 0.0
    for i in range(1, places + 1):
        high = i / places
        value = gap(case, path, y, high, share)
        if value > 0.0:
            low, value_low = high, value
            continue
        if fresh and i == 1:
            low, value_low = high, value
            while value_low <= 0.0 and low > 1e-15:
                low *= 0.25
                value_low = gap(case, path, y, low, share)
            if value_low <= 0.0:
                return 0.0
        return root(case, path, y, share, low, value_low, high, value)
    return 2.0


@shared
def root(case, path, y, share, low, value_low, high, value_high):
    """The contact between `low` (apart) and `high` (touching): Illinois, every fourth time halves."""
    side = 0
    for i in range(80):
        if high - low <= 4e-16 * high:
            break
        middle = (low * value_high - high * value_low) / (value_high - value_low) if i % 4 != 3 else 0.5 * (low + high)
        if not low < middle < high:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
        value = gap(case, path, y, middle, share)
        if value > 0.0:
            low, value_low = middle, value
            if side == 1:
                value_high *= 0.5
            side = 1
        else:
            high, value_high = middle, value
            if value == 0.0:
                break
            if side == -1:
                value_low *= 0.5
            side = -1
    return high


@shared
def top_of(path, y, theta, top):
    """The highest point up to θ of the step, or `top`."""
    if y[3] > 0.0 >= at(path, y, theta, 3):
        low, high = 0.0, theta
        for _ in range(60):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if at(path, y, middle, 3) > 0.0:
                low = middle
            else:
                high = middle
        top = max(top, at(path, y, high, 1))
    return max(top, at(path, y, theta, 1))


@shared
def for_flight(case, y, likely):
    """The case with the tolerance of a flight from y that is likely to last so long."""
    fall = -rates(case, y[1], y[2], y[3])[3]
    if fall > 0.0:
        likely = min(likely, 2.0 * max(0.0, y[3]) / fall)
    likely = min(1.0, likely)
    c, scale = case, max(SHORTEST, likely * (0.4 + 0.6 * likely))
    bed = c.restitution, c.retention, c.seed
    return Case(c.alpha, c.along, c.normal, c.drag, c.reynolds, bed[0], bed[1], bed[2], scale * c.tolerance, c.floor, c.profile, c.slope)


@compiled(allocates=False)
def fly(case, nodes, room, y, jumps):
    """Fly len(jumps) jumps from y = (x, z, slip along, slip up): the steps taken, 0 if it failed. Rows: duration, length, rise."""
    c, regular, rise, v, before, path, last = nodes.c, nodes.regular, nodes.rise, room.v, room.before, room.path, room.last
    count, weights = len(c), nodes.integral[len(c) - 1]
    time, start, x, bottom, top, step, past, missed, diagonal = 0.0, 0.0, y[0], y[1], y[1], FIRST, 0.0, 0.0, 0.0
    smooth, known, fresh, near = False, False, True, False
    steps, impacts, done = 0, 0, 0
    whole, launched = case, y[3]
    case = for_flight(whole, y, math.inf)
    while done < len(jumps):
        h, error = 0.0, math.inf
        while not error <= 1.0:
            slot = math.ceil(LADDER * math.log2(SPAN / min(step, SPAN)) - 1e-9)
            h = SPAN * 2.0 ** (-slot / LADDER)
            if h < case.floor:
                return 0
            iterations = -1
            for trial in range(2):
                if not known or trial == 1:
                    diagonal, known = stiffness(case, y), True
                iterations = solve(case, nodes, room, y, h, past if smooth else 0.0, diagonal)
                if abs(iterations) > 3:
                    known = False
                if iterations > 0:
                    break
            error = error_of(case, nodes, room, y, h, smooth) if iterations > 0 else math.inf
            if not error <= 1.0:
                step = h * max(0.1, 0.8 * error ** (-1.0 / count)) if math.isfinite(error) else 0.25 * h
        for a in range(4):
            for d in range(count + 1):
                total = 0.0
                for k in range(count):
                    total += rise[d, k] * v[a, k]
                path[a, d] = h * total
        theta, near = 2.0, y[1] < HIGHEST
        for i in range(count):
            near = near or room.z[i] < HIGHEST
        if near:
            theta = contact(case, path, y, uniforms(case.seed, 0, impacts)[0], fresh)
        top = top_of(path, y, min(theta, 1.0), top)
        steps += 1
        fresh = False
        if theta > 1.0:
            for a in range(4):
                gain = 0.0
                for k in range(count):
                    gain += weights[k] * v[a, k]
                    total = 0.0
                    for m in range(count):
                        total += regular[k, m] * v[a, m]
                    before[a, k] = total
                last[a] = v[a, count - 1]
                y[a] += h * gain
            time += h
            growth = max(error, 1e-10) ** (-1.0 / (count + 1))
            if past > 0.0:
                growth *= min(1.0, h / past * (max(missed, 1e-2) / max(error, 1e-10)) ** (1.0 / (count + 1)))
            past, missed, smooth = h, error, True
            step = h * min(2.0, max(0.3, 0.9 * growth))
            continue
        end, height, slip, w = at(path, y, theta, 0), at(path, y, theta, 1), at(path, y, theta, 2), at(path, y, theta, 3)
        time += h * theta
        velocity = stream(case, height)[0]
        u = slip + velocity
        for _ in range(1000):
            angle = tilt(u, w, uniforms(case.seed, 0, impacts)[0])
            impacts += 1
            along, up = -math.sin(angle), math.cos(angle)
            if u < 0.0:
                along = -along
            speed = u * along + w * up
            if speed >= 0.0:
                continue
            gain, loss = -(1.0 + case.restitution) * speed, 1.0 - case.retention
            u, w = u + (gain * along - loss * (u - speed * along)), w + (gain * up - loss * (w - speed * up))
            if w > 0.0:
                break
        jumps[done, 0], jumps[done, 1], jumps[done, 2] = time - start, end - x, top - bottom
        done += 1
        step = max(case.floor, min(FIRST, 0.5 * (time - start)))
        y[0], y[1], y[2], y[3] = end, height, u - velocity, w
        case, launched = for_flight(whole, y, (time - start) * min(1.0, max(0.0, w) / max(launched, 1e-300))), w
        start, x, bottom, top = time, end, height, height
        past, smooth, known, fresh = 0.0, False, False, True
    return steps


def case_of(engine: Any) -> Case:
    """The case of a simulator's engine that was made for such a scene; ValueError for another scene."""
    scene, numbers = engine.scene, engine.numbers
    if engine.states != 4 or engine.members != 0 or engine.force_names != ("weight", "drag") or scene.bed.rebound != "garcia_nino":
        raise ValueError("scene must hold weight and drag in the plane over a bed with rebound = 'garcia_nino'")
    slope, shields = numbers.slope, numbers.shields
    weight, drag = (math.sin(slope) / shields, math.cos(slope) / shields), (18.0 / numbers.reynolds, numbers.reynolds)
    bed = scene.bed.restitution, scene.bed.tangential_retention, scene.run.seed
    return Case(numbers.alpha, *weight, *drag, *bed, engine.problem.rtol, engine.problem.floor, engine.profile.cells, engine.profile.slope)


def nodes_of(engine: Any) -> Nodes:
    """The simulator's nodes."""
    nodes = engine.tables.nodes
    return Nodes(nodes.c, nodes.integral, nodes.regular, nodes.rise, nodes.at_start)


def room_for(stages: int) -> Room:
    """Work space."""
    square, row, four = (stages, stages), (stages,), (4, stages)
    return Room(*(np.zeros(shape) for shape in (square, square, row, four, four, row, row, row, four, (4, stages + 1), (4,))))
