"""The equation of motion of a sphere in a flow, written once: compiled, and as plain Python.

(s + C) dv/dt = (1 + C) Du/Dt + (s − 1) g − (18 ν/d²) f(Re) w + lift − (9/d) √(ν/π) H[w],   w = v − u(t, x): per mass of the displaced fluid,
s the ratio of densities, C the added mass. Maxey & Riley (1983), with Du/Dt (along the fluid's path) in the added mass as in Auton, Hunt & Prud'homme (1988).
Along the particle's own path du/dt = Du/Dt + (w·∇)u, so that

    dw/dt = (1 − s)/(s + C) (Du/Dt − g) − [drag − lift]/(s + C) − (w·∇)u − c H[w].

What is given by users is called by its address: nothing here is compiled anew for another flow, drag law or number of dimensions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from basset._compile import call, compiled, load, overloads, shared
from basset.solvers.events import entry_of

ROWS, WIDTH = 16, 16  # of the work space of a thread: a row holds what a function takes or gives; the last three what is read
NUMBERS, WORDS, FUNCTIONS = 13, 14, 15
PLACE, FIELD, SHIFTED, ONE, OTHER, BASIS, SUMS, RATES, VELOCITY, FORCE = 0, 1, 2, 3, 4, 5, 9, 10, 11, 12
GRADIENT_AT, MATERIAL_AT = 3, 12  # in the row FIELD, behind u: ∂u_i/∂x_j in 3 i + j, and Du/Dt
# words
DIMENSIONS, GRIDDED, HAS_GRADIENT, HAS_MATERIAL, DRAG, AXES, KNOTS, COEFFICIENTS, BOUNDS, LIFTS = range(10)
STOKES, SCHILLER_NAUMANN, OWN = range(3)
# functions
OF_VELOCITY, OF_GRADIENT, OF_MATERIAL, OF_DRAG = range(4)
# numbers
DENSITY_RATIO, ADDED_MASS, GRAVITY, RATE, LIFT, REYNOLDS, STEP, TIME_STEP = 0, 1, 2, 5, 6, 7, 8, 9
KINDS = ("weight", "drag", "added_mass", "pressure_gradient", "lift", "history")


class Work(np.ndarray[Any, Any]):
    """The work space of one thread where users' functions are plain: it carries them."""

    functions: Any = None


def work_space() -> Work:
    """Zeros."""
    return np.zeros((ROWS, WIDTH)).view(Work)


def opened(work: Any) -> tuple[Any, Any, Any]:
    """Words, functions and numbers."""
    return work[WORDS].view(np.ndarray).view(np.int64), work.functions, work[NUMBERS].view(np.ndarray)


@overloads(opened)
def _opened(work):
    def opened(work):
        return work[WORDS].view(np.int64), work[FUNCTIONS].view(np.int64).reshape(8, 2), work[NUMBERS]

    return opened


@shared
def differences(t: float, words: Any, functions: Any, numbers: Any, scratch: Any) -> None:
    """u, ∇u and Du/Dt at scratch[PLACE]: as given, or by central differences of fourth order."""
    d = words[DIMENSIONS]
    call(entry_of(functions, OF_VELOCITY), t, scratch, PLACE, scratch, FIELD, scratch)
    if words[HAS_GRADIENT] != 0:
        call(entry_of(functions, OF_GRADIENT), t, scratch, PLACE, scratch, ONE, scratch)
        for i in range(d):
            for j in range(d):
                scratch[FIELD, GRADIENT_AT + 3 * i + j] = scratch[ONE, d * i + j]
    else:
        h = numbers[STEP]
        for i in range(d):
            scratch[SHIFTED, i] = scratch[PLACE, i]
        for j in range(d):
            for i in range(d):
                scratch[FIELD, GRADIENT_AT + 3 * i + j] = 0.0
            for far in range(1, 3):
                factor = 8.0 / (12.0 * h) if far == 1 else -1.0 / (12.0 * h)
                scratch[SHIFTED, j] = scratch[PLACE, j] + far * h
                call(entry_of(functions, OF_VELOCITY), t, scratch, SHIFTED, scratch, ONE, scratch)
                scratch[SHIFTED, j] = scratch[PLACE, j] - far * h
                call(entry_of(functions, OF_VELOCITY), t, scratch, SHIFTED, scratch, OTHER, scratch)
                for i in range(d):
                    scratch[FIELD, GRADIENT_AT + 3 * i + j] += factor * (scratch[ONE, i] - scratch[OTHER, i])
            scratch[SHIFTED, j] = scratch[PLACE, j]
    if words[HAS_MATERIAL] != 0:
        call(entry_of(functions, OF_MATERIAL), t, scratch, PLACE, scratch, ONE, scratch)
        for i in range(d):
            scratch[FIELD, MATERIAL_AT + i] = scratch[ONE, i]
        return
    h = numbers[TIME_STEP]
    for i in range(d):
        scratch[FIELD, MATERIAL_AT + i] = 0.0
    for far in range(1, 3):
        factor = 8.0 / (12.0 * h) if far == 1 else -1.0 / (12.0 * h)
        call(entry_of(functions, OF_VELOCITY), t + far * h, scratch, PLACE, scratch, ONE, scratch)
        call(entry_of(functions, OF_VELOCITY), t - far * h, scratch, PLACE, scratch, OTHER, scratch)
        for i in range(d):
            scratch[FIELD, MATERIAL_AT + i] += factor * (scratch[ONE, i] - scratch[OTHER, i])
    convect(words, scratch)


@shared
def convect(words: Any, scratch: Any) -> None:
    """Add (u·∇)u to ∂u/∂t."""
    d = words[DIMENSIONS]
    for i in range(d):
        total = 0.0
        for j in range(d):
            total += scratch[FIELD, j] * scratch[FIELD, GRADIENT_AT + 3 * i + j]
        scratch[FIELD, MATERIAL_AT + i] += total


@shared
def basis(words: Any, axis: int, place: float, scratch: Any) -> int:
    """The four cubic B-splines that are not zero at `place` and their slopes, into a row; the number of the first one (de Boor 1978)."""
    axes, row = words[AXES], BASIS + axis
    count, offset = int(load(axes, 8 * axis)), int(load(axes, 8 * axis + 1))
    low, high, period = load(axes, 8 * axis + 2), load(axes, 8 * axis + 3), load(axes, 8 * axis + 4)
    if count == 1:
        scratch[row, 0], scratch[row, 4] = 1.0, 0.0
        return 0
    if period > 0.0:
        place -= period * math.floor((place - low) / period)
        place = min(max(place, low), high)
    knots = words[KNOTS]
    first, last = 3, count  # the interval [knot j, knot j+1) with j from 3 to count − 1; beyond the ends the outer ones are continued
    while last - first > 1:
        middle = (first + last) // 2
        if load(knots, offset + middle) <= place:
            first = middle
        else:
            last = middle
    # degree 0 to 3 in place; entries 8 … 11 and 12 … 15 are distances to the knots on either side
    scratch[row, 0] = 1.0
    for degree in range(1, 4):
        scratch[row, 8 + degree] = place - load(knots, offset + first + 1 - degree)
        scratch[row, 12 + degree] = load(knots, offset + first + degree) - place
        if degree == 3:  # slopes from the three of degree 2
            before = 0.0
            for r in range(3):
                share = scratch[row, r] / (scratch[row, 12 + r + 1] + scratch[row, 8 + degree - r])
                scratch[row, 4 + r] = 3.0 * (before - share)
                before = share
            scratch[row, 7] = 3.0 * before
        saved = 0.0
        for r in range(degree):
            share = scratch[row, r] / (scratch[row, 12 + r + 1] + scratch[row, 8 + degree - r])
            scratch[row, r] = saved + scratch[row, 12 + r + 1] * share
            saved = scratch[row, 8 + degree - r] * share
        scratch[row, degree] = saved
    return first - 3


@shared
def interpolate(t: float, words: Any, scratch: Any) -> None:
    """u, ∇u and Du/Dt of the tensor product of cubic B-splines at scratch[PLACE], all of one interpolant."""
    d, axes, table = words[DIMENSIONS], words[AXES], words[COEFFICIENTS]
    start_t, start_x, start_y = basis(words, 0, t, scratch), basis(words, 1, scratch[PLACE, 0], scratch), basis(words, 2, scratch[PLACE, 1], scratch)
    start_z = basis(words, 3, scratch[PLACE, 2] if d == 3 else 0.0, scratch)
    count_x, count_y, count_z = int(load(axes, 8)), int(load(axes, 16)), int(load(axes, 24))
    wide_t, wide_z = 4 if load(axes, 0) > 1.0 else 1, 4 if count_z > 1 else 1
    for i in range(MATERIAL_AT + 3):
        scratch[FIELD, i] = 0.0
    for k in range(wide_t):
        bt, st = scratch[BASIS, k], scratch[BASIS, 4 + k]
        for i_x in range(4):
            bx, sx = scratch[BASIS + 1, i_x], scratch[BASIS + 1, 4 + i_x]
            for m in range(4):
                by, sy = scratch[BASIS + 2, m], scratch[BASIS + 2, 4 + m]
                at = (((start_t + k) * count_x + start_x + i_x) * count_y + start_y + m) * count_z + start_z
                for i in range(d):
                    value, slope = 0.0, 0.0
                    for n in range(wide_z):
                        c = load(table, (at + n) * d + i)
                        value += scratch[BASIS + 3, n] * c
                        slope += scratch[BASIS + 3, 4 + n] * c
                    scratch[FIELD, i] += bt * bx * by * value
                    scratch[FIELD, GRADIENT_AT + 3 * i] += bt * sx * by * value
                    scratch[FIELD, GRADIENT_AT + 3 * i + 1] += bt * bx * sy * value
                    scratch[FIELD, GRADIENT_AT + 3 * i + 2] += bt * bx * by * slope
                    scratch[FIELD, MATERIAL_AT + i] += st * bx * by * value
    convect(words, scratch)


@shared
def field(t: float, words: Any, functions: Any, numbers: Any, scratch: Any) -> None:
    """u, ∇u and Du/Dt at scratch[PLACE] into scratch[FIELD]."""
    if words[GRIDDED] != 0:
        interpolate(t, words, scratch)
    else:
        differences(t, words, functions, numbers, scratch)


@shared
def schiller_naumann(reynolds: Any) -> Any:
    """What Stokes's drag is multiplied by; Schiller & Naumann (1933)."""
    return 1.0 + 0.15 * reynolds**0.687


@shared
def drag_rate(t: float, square: float, words: Any, functions: Any, numbers: Any, scratch: Any) -> float:
    """Drag over slip, 1/s, of fluid mass; `square`: |w|²."""
    rate: float = numbers[RATE]
    kind = words[DRAG]
    if kind == SCHILLER_NAUMANN:
        rate *= schiller_naumann(math.sqrt(square) * numbers[REYNOLDS])
    elif kind == OWN:
        scratch[ONE, 0] = math.sqrt(square) * numbers[REYNOLDS]
        call(entry_of(functions, OF_DRAG), t, scratch, ONE, scratch, OTHER, scratch)
        rate *= scratch[OTHER, 0]
    return rate


@shared
def lift(d: int, w: Any, numbers: Any, scratch: Any) -> None:
    """Lift k |ω|^(−1/2) ω × w into scratch[FORCE], per fluid mass; Saffman (1965) in the form of Crowe, Sommerfeld & Tsuji (1998)."""
    g = GRADIENT_AT
    z = scratch[FIELD, g + 3] - scratch[FIELD, g + 1]
    x = scratch[FIELD, g + 7] - scratch[FIELD, g + 5] if d == 3 else 0.0
    y = scratch[FIELD, g + 2] - scratch[FIELD, g + 6] if d == 3 else 0.0
    size = math.sqrt(math.sqrt(x * x + y * y + z * z))
    factor = numbers[LIFT] / size if size > 0.0 else 0.0
    third = w[2] if d == 3 else 0.0
    scratch[FORCE, 0] = factor * (y * third - z * w[1])
    scratch[FORCE, 1] = factor * (z * w[0] - x * third)
    scratch[FORCE, 2] = factor * (x * w[1] - y * w[0])


@shared
def forced(t: float, words: Any, functions: Any, numbers: Any, scratch: Any) -> float:
    """The field at scratch[PLACE] and the lift into scratch[FORCE] for the slip in scratch[VELOCITY]; drag over slip, 1/s, both per fluid mass."""
    d = words[DIMENSIONS]
    field(t, words, functions, numbers, scratch)
    square = 0.0
    for a in range(d):
        square += scratch[VELOCITY, a] ** 2
        scratch[FORCE, a] = 0.0
    if words[LIFTS] != 0:
        lift(d, scratch[VELOCITY], numbers, scratch)
    return drag_rate(t, square, words, functions, numbers, scratch)


@shared
def motion(t: float, y: Any, words: Any, functions: Any, numbers: Any, scratch: Any, length: float, speed: float) -> Any:
    """Rates of y = (x/length, w/speed) without history."""
    d = words[DIMENSIONS]
    for a in range(d):
        scratch[PLACE, a], scratch[VELOCITY, a] = length * y[a], speed * y[d + a]
    rate = forced(t, words, functions, numbers, scratch)
    ratio = numbers[DENSITY_RATIO]
    share = 1.0 / (ratio + numbers[ADDED_MASS])
    for a in range(d):
        bent = 0.0
        for j in range(d):
            bent += scratch[FIELD, GRADIENT_AT + 3 * a + j] * scratch[VELOCITY, j]
        driven = (1.0 - ratio) * (scratch[FIELD, MATERIAL_AT + a] - numbers[GRAVITY + a])
        scratch[RATES, a] = (scratch[FIELD, a] + scratch[VELOCITY, a]) / length
        scratch[RATES, d + a] = (share * (driven - rate * scratch[VELOCITY, a] + scratch[FORCE, a]) - bent) / speed
    return scratch[RATES, : 2 * d]


def motion_with(t, y, work, length, speed):
    """`motion` as the solver takes it."""
    words, functions, numbers = opened(work)
    return motion(t, y, words, functions, numbers, work, length, speed)


@shared
def located(t: float, y: Any, words: Any, functions: Any, numbers: Any, scratch: Any, length: float, speed: float) -> None:
    """Position (m) into scratch[PLACE], velocity (m/s) into scratch[VELOCITY], the fluid's into scratch[FIELD]."""
    d = words[DIMENSIONS]
    for a in range(d):
        scratch[PLACE, a] = length * y[a]
    if words[GRIDDED] != 0:
        interpolate(t, words, scratch)
    else:
        call(entry_of(functions, OF_VELOCITY), t, scratch, PLACE, scratch, FIELD, scratch)
    for a in range(d):
        scratch[VELOCITY, a] = scratch[FIELD, a] + speed * y[d + a]


def located_with(t, y, work, length, speed):
    """`located` for events that are not compiled."""
    words, functions, numbers = opened(work)
    located(t, y, words, functions, numbers, work, length, speed)


@shared
def within(t: float, y: Any, words: Any, length: float) -> float:
    """How far the particle is from the nearest end of a bounded grid, in lengths: negative outside."""
    nearest = math.inf
    for a in range(words[DIMENSIONS]):
        nearest = min(nearest, y[a] - load(words[BOUNDS], 2 * a) / length, load(words[BOUNDS], 2 * a + 1) / length - y[a])
    return nearest


@compiled()
def compiled_within(t, y, work, length, speed):
    """`within` as the solver takes it."""
    words, _, _ = opened(work)
    return within(t, y, words, length)


def fields_with(times: Any, places: Any, work: Any, out: Any) -> None:
    """u, ∇u and Du/Dt at many points: rows of `out`, laid out as scratch[FIELD]."""
    words, functions, numbers = opened(work)
    for k in range(len(places)):
        for a in range(places.shape[1]):
            work[PLACE, a] = places[k, a]
        field(times[k], words, functions, numbers, work)
        for i in range(MATERIAL_AT + 3):
            out[k, i] = work[FIELD, i]


def forces_with(times: Any, places: Any, slips: Any, histories: Any, work: Any, mass: float, velocities: Any, out: Any) -> None:
    """Velocities (particle, time, component) and forces (kind, particle, time, component), N, from `histories`, what H adds to dv/dt; `mass` of fluid."""
    words, functions, numbers = opened(work)
    scratch, d = work, words[DIMENSIONS]
    ratio, added = numbers[DENSITY_RATIO], numbers[ADDED_MASS]
    for p in range(places.shape[0]):
        for k in range(places.shape[1]):
            if math.isnan(places[p, k, 0]):
                continue
            for a in range(d):
                scratch[PLACE, a], scratch[VELOCITY, a] = places[p, k, a], slips[p, k, a]
            rate = forced(times[k], words, functions, numbers, scratch)
            for a in range(d):
                w, fluid = slips[p, k, a], scratch[FIELD, MATERIAL_AT + a]
                weight, drag, side = (ratio - 1.0) * numbers[GRAVITY + a], -rate * w, scratch[FORCE, a]
                acceleration = ((1.0 + added) * fluid + weight + drag + side) / (ratio + added) + histories[p, k, a]
                velocities[p, k, a] = scratch[FIELD, a] + w
                out[0, p, k, a], out[1, p, k, a] = mass * weight, mass * drag
                out[2, p, k, a], out[3, p, k, a] = mass * added * (fluid - acceleration), mass * fluid
                out[4, p, k, a], out[5, p, k, a] = mass * side, mass * (ratio + added) * histories[p, k, a]


compiled_motion, fields, forces = (
    compiled(usually="some 5 s")(plain) for plain in (motion_with, fields_with, forces_with)
)  # these are used as they stand, too
compiled_located = compiled()(located_with)
