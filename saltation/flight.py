"""The one compiled loop: a grain from impact to impact, with graded collocation through every jump of the slip.

States y are x, [y,] z, slip u − u_f in the same directions, and the spin where it is integrated (ω_y in the plane, all
three in space): what a scene does not name is not there. Slips, not velocities, because they are what the history acts on;
at an impact both jump alike. Steps, tables, error estimates and memory are those of `basset.solvers._march`; the stages are
solved by a Newton iteration with a diagonal Jacobian, which handles stiff drag at a fraction of the price of a full one.
Impacts are found on the step's polynomial, the step is cut there and the memory advanced to the cut exactly. So are crossings
of the levels at which the stream, or the lift by it, has a kink: up to there a step sees the stream continued smoothly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from basset._compile import call, compiled, entry, overloads, shared
from basset._stream import dot
from basset.kernels import Floats
from basset.solvers._march import (
    ACCEPTED,
    AGAIN,
    CALLS,
    FIRST,
    FULL,
    JUMPED,
    KNOWN,
    NOT_FINITE,
    SINGULAR,
    SLOT,
    SMOOTH,
    STEP,
    STEPS,
    TIME,
    Cut,
    Nodes,
    Problem,
    State,
    Tables,
    accept,
    all_at,
    at,
    choose,
    cut_memory,
    decay_error,
    defect_error,
    fit_polynomial,
    judge,
    states_between,
)
from basset.spectrum import ratio_at
from saltation._random import Draws, uniforms
from saltation.bed.rebound import strike
from saltation.bed.roughness import facing
from saltation.effects.base import Situation, force, torque, total_force
from saltation.flow import both, continued
from saltation.grain import Triple

# why `fly` came back, beside the codes of basset's march
JUMPS, REST, ALOFT, HORIZON, CROWDED = 20, 21, 22, 23, 24

# places in `flight`
START, X, Y, Z, TOP, TURNED, U, V, W, IMPACTS, SHORT, DONE, TAKEN, CONTACTS = range(14)

# places in `State.numbers`, behind those of the march: factor of the tolerance
SCALE, NUMBERS = 15, 16

# columns of the table of jumps, as recorded: takeoff, flight, impact
COLUMNS = (
    "start", "x", "y", "z", "u", "v", "w", "duration", "length", "drift", "rise", "turned",
    "u_in", "v_in", "w_in", "normal_speed", "tilt", "clipped", "impulse_x", "impulse_y", "impulse_z", "contacts",
    "spin_x", "spin_y", "spin_z",
)  # fmt: skip

IMPULSE, RESTART, RESET, NOTHING = range(4)  # what the memory does at an impact
TOLERANCE = 0.03  # of the step's error, for the stages
CARE = 20.0  # the defect of a singular step is no overestimate as a regular step's is, and what it does to the memory stays
BESIDE = 1e-9  # d: as near to a kink as that is at it
SHORTEST = 0.02  # so small at least is the factor of the tolerance
MOST_CONTACTS = 1000  # at one place before the grain is taken to lie still


class Equation(NamedTuple):
    """What moves the grain: α, the stream, the height where it begins (d), forces, torque; `across` and `turning` are None where there is no such state.

    Its type says which effects there are: a new one compiles `rates_of` and nothing that steps.
    """

    alpha: float
    profile: Any
    begins: float
    forces: Any
    torque: Any
    across: Any
    turning: Any


class Model(NamedTuple):
    """An equation as the loop sees it: its rates, to be called; the stream's table; dimensions (2, 3), states of the spin (0, 1, 3).

    `kinks` (d, rising): heights of the centre at which rates have a kink: the stream begins at the lower lift point, the centre, the
    upper lift point; without lift, three times at the centre.
    """

    rates: Any
    profile: Any
    kinks: tuple[float, float, float]
    dimensions: int
    spins: int


class Bed(NamedTuple):
    """Rebound, to be called; roughness, the highest contact (−∞ where there is no bed), and who draws."""

    rebound: Any
    roughness: Any
    highest: float
    seed: int
    grain: int


class Memory(NamedTuple):
    """What the memory does at an impact, the fitted sum's rates (terms,), how long it holds; for a memory of so many jumps
    what came before each of them (jump, memory, terms) and when that was (jump,), both empty without such a limit; the
    finite-Reynolds kernel, without places for Basset's.
    """

    rebound: int
    rates: Floats
    horizon: float
    before: Floats
    when: Floats
    finite: Finite


class Finite(NamedTuple):
    """A finite-Reynolds kernel K(s; C) of the slip at t: fixed rates, weights that follow C(t), see `basset.spectrum`.

    C = ½√π Re*^(3/2) (U/f)³, f = 0.75 + c2 U Re*. `local` is what the local history of a unit step falls short of Basset's,
    on a uniform grid of ln(C^(2/3) h) from `local_low`: (places, grid, stage, node), places: nodes of a regular and of a
    singular step, halfway between those of a singular one.
    """

    c1: float
    c2: float
    reynolds: float
    log_rates: Floats
    low: float
    inverse_step: float
    values: Floats
    local: Floats
    local_low: float
    local_inverse: float


class Limits(NamedTuple):
    """A flight this long never comes down; flights this short, so many in a row, are rest."""

    longest: float
    shortest: float
    patience: float
    seal: float  # jumps wanted in all
    prescribed: int  # contacts do not turn the grain where 1


@shared
def layer_of(model: Model, z: float, w: float) -> float:
    """How many kinks lie below a grain; of one at a kink where it goes: right behind a jump of the slip no step can be cut there."""
    z += math.copysign(BESIDE, w)
    return (1.0 if z > model.kinks[0] else 0.0) + (1.0 if z > model.kinks[1] else 0.0) + (1.0 if z > model.kinks[2] else 0.0)


def rates_of(equation: Equation, t: float, y: Any, out: Any, own: Any) -> None:
    """Rates without history of the states y, into `out`; `own`: the spin of a grain whose spin is no state, and the layer between two kinks."""
    if equation.across is None:
        z, sx, sy, sz = y[1], y[2], 0.0, y[3]
    else:
        z, sx, sy, sz = y[2], y[3], y[4], y[5]
    if equation.turning is None:
        ox, oy, oz = own[0], own[1], own[2]
    elif equation.across is None:
        ox, oy, oz = 0.0, y[4], 0.0
    else:
        ox, oy, oz = y[6], y[7], y[8]
    ahead = equation.begins + 0.5 * own[3] - 0.75 - z  # to the middle of the layer: kinks are half a diameter apart
    stream, shear = continued(equation.profile, z, ahead)
    s = Situation(z, sx, sy, sz, stream, shear, ox, oy, oz, ahead)
    fx, fy, fz = total_force(equation.forces, s)
    if equation.across is None:
        out[0], out[1] = sx + stream, sz
        out[2], out[3] = equation.alpha * fx - shear * sz, equation.alpha * fz
    else:
        out[0], out[1], out[2] = sx + stream, sy, sz
        out[3], out[4], out[5] = equation.alpha * fx - shear * sz, equation.alpha * fy, equation.alpha * fz
    if equation.turning is not None:
        tx, ty, tz = torque(equation.torque, s)
        if equation.across is None:
            out[4] = ty
        else:
            out[6], out[7], out[8] = tx, ty, tz


rates_entry = entry(rates_of)


def struck(rebound: Any, t: float, y: Any, out: Any, own: Any) -> None:
    """What a contact makes of normal, velocity and spin (9,): velocity, spin and impulse (9,), into `out`."""
    after = strike(rebound, (y[0], y[1], y[2]), (y[3], y[4], y[5]), (y[6], y[7], y[8]))
    out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7], out[8] = after


rebound_entry = entry(struck)


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


class Work(NamedTuple):
    """Room that one flight needs: all overwritten in every step."""

    rates: Floats  # (stage, state)
    states: Floats  # (stage, state)
    inverse: Floats  # (state, stage, stage)
    matrix: Floats  # (stage, stage)
    force: Floats  # (stage, memory)
    extra: Floats  # (stage, memory)
    residual: Floats  # (stage,)
    diagonal: Floats  # (state,)
    rate: Floats  # (degree, state): Legendre coefficients of the rates in the step before
    past: Floats  # (1,): its size, 0 where it was singular
    polynomial: Floats  # (degree + 1, state)
    here: Floats  # (2, state)
    out: Floats  # (2, state)
    halfway: Floats  # (stage,): places halfway between the nodes of a singular step, in θ
    contact: Floats  # (2, 9): what goes into a rebound, and comes out of it


@shared
def memory_before(problem: Problem, tables: Tables, state: State, slot: int, kind: int, force: Floats) -> None:
    """c·(memory of all that came before the step) at the stages, into `force`."""
    before, kernel, past, jump, strength = tables.past, tables.kernel, state.past, state.jump, problem.strength
    for i in range(len(force)):
        row = before[slot, kind, i]
        for a in range(len(strength)):
            total = dot(row, 0, past[a], 0, past.shape[1])
            if kind == 1:
                total += kernel[slot, i] * jump[a]
            force[i, a] = strength[a] * total


@shared
def excess(
    finite: Finite,
    problem: Problem,
    states: Floats,
    i: int,
    places: Floats,
    which: int,
    h: float,
    kind: int,
    past: Floats,
    state: State,
    values: Floats,
    scale: float,
    out: Floats,
) -> None:
    """c·(H − Basset's H) at row i of `states`, times `scale`, added to row i of `out`.

    `past` (terms,) are Basset's weights with their decay up to places[i] of the step.
    """
    first, members, count = problem.where[0], len(problem.where), len(places)
    speed = 0.0
    for a in range(members):
        speed += states[i, first + a] * states[i, first + a]
    if speed == 0.0:
        return  # Basset's kernel
    speed = math.sqrt(speed)
    # ln C^(2/3)
    clock = 2.0 / 3.0 * math.log(0.5 * math.sqrt(math.pi)) + math.log(finite.reynolds)
    clock += 2.0 * math.log(speed / (0.75 + finite.c2 * speed * finite.reynolds))
    rows, terms, memory, jump, strength = finite.values.shape[0], len(finite.log_rates), state.past, state.jump, problem.strength
    log_rates, tables, local = finite.log_rates, finite.values, finite.local
    for q in range(terms):
        share = past[q] * (ratio_at(finite.low, finite.inverse_step, tables, min(q, rows - 1), log_rates[q] - clock) - 1.0)
        for a in range(members):
            out[i, a] += scale * strength[a] * share * memory[a, q]
    if kind == 1:
        lag = places[i] * h
        share = ((1.0 + math.exp(1.5 / finite.c1 * (clock + math.log(lag)))) ** -finite.c1 - 1.0) / math.sqrt(lag)
        for a in range(members):
            out[i, a] += scale * strength[a] * share * jump[a]
    position = (clock + math.log(h) - finite.local_low) * finite.local_inverse
    if position <= 2.0:
        return  # Basset's within 1e-9
    cell = min(int(position), local.shape[1] - 4)
    x = min(position - cell, 1.0)
    unit = 1.0 / math.sqrt(h) if kind == 1 else math.sqrt(h)
    for m in range(-2, 4):  # Lagrange through six points
        weight = scale * unit
        for other in range(-2, 4):
            if other != m:
                weight *= (x - other) / (m - other)
        for k in range(count):
            part = weight * local[which, cell + m, i, k]
            for a in range(members):
                out[i, a] -= strength[a] * part * values[k, first + a]


@shared
def differentiate(model: Model, spin: Floats, state: State, first: int, work: Work) -> None:
    """The diagonal of the Jacobian for slips and spins, by forward differences at the step's start."""
    here, out, y, diagonal = work.here, work.out, state.y, work.diagonal
    for a in range(len(y)):
        here[0, a] = here[1, a] = y[a]
    call(model.rates, state.numbers[TIME], here, 0, out, 0, spin)
    for a in range(first, len(y)):
        here[1, a] = y[a] + 1.5e-8 * max(abs(y[a]), 1e-3)
        call(model.rates, state.numbers[TIME], here, 1, out, 1, spin)
        diagonal[a] = min(0.0, (out[1, a] - out[0, a]) / (here[1, a] - y[a]))
        here[1, a] = y[a]
    members = model.dimensions  # one number for the slips and one for the spins: one inverse each
    for low in range(first, len(y), members):
        high = min(low + members, len(y))
        mean = 0.0
        for a in range(low, high):
            mean += diagonal[a] / (high - low)
        for a in range(low, high):
            diagonal[a] = mean


@shared
def predict(model: Model, spin: Floats, problem: Problem, nodes: Nodes, tables: Tables, state: State, values: Floats, work: Work) -> None:
    """A first guess of the unknowns."""
    numbers, h, c, y, where = state.numbers, state.numbers[STEP], nodes.c, state.y, problem.where
    count, n = values.shape
    if numbers[SMOOTH] == 1.0 and work.past[0] > 0.0:  # the polynomial of the step before, carried on
        ratio, rate = h / work.past[0], work.rate
        for i in range(count):
            x = 1.0 + 2.0 * c[i] * ratio
            for a in range(n):
                values[i, a] = rate[0, a] + rate[1, a] * x
            older, newer = 1.0, x
            for d in range(2, count):
                older, newer = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d
                for a in range(n):
                    values[i, a] += newer * rate[d, a]
        return
    if numbers[SMOOTH] == 1.0:
        rate = state.rate
        for i in range(count):
            for a in range(n):
                values[i, a] = rate[a]
        return
    here, out = work.here, work.out
    for a in range(n):
        here[0, a] = y[a]
    call(model.rates, state.numbers[TIME], here, 0, out, 0, spin)
    singular = numbers[SINGULAR] == 1.0
    for i in range(count):
        for a in range(n):
            values[i, a] = c[i] * h * out[0, a] if singular else out[0, a]
        if singular:
            for a in range(len(where)):
                values[i, where[a]] -= 2.0 * problem.strength[a] * math.sqrt(c[i] * h) * state.jump[a]


@shared
def factorise(problem: Problem, nodes: Nodes, tables: Tables, h: float, slot: int, kind: int, work: Work) -> None:
    """The inverse of each state's own stage matrix; states that nothing damps need none in a regular step."""
    matrix, inverse, diagonal, strength = work.matrix, work.inverse, work.diagonal, problem.strength
    local, slope, integral = tables.local, nodes.slope, nodes.integral
    n, count, members = len(diagonal), len(nodes.c), len(strength)
    first = problem.where[0] if members > 0 else n
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
def solve_stages(model: Model, finite: Finite, spin: Floats, problem: Problem, nodes: Nodes, tables: Tables, state: State, values: Floats, work: Work) -> int:
    """Solve the stages into `values`: iterations, negative if it failed."""
    numbers = state.numbers
    h, slot, kind = numbers[STEP], int(numbers[SLOT]), int(numbers[SINGULAR])
    count, n = values.shape
    members = len(problem.where)
    first = problem.where[0] if members > 0 else n
    memory_before(problem, tables, state, slot, kind, work.force)
    factorise(problem, nodes, tables, h, slot, kind, work)
    predict(model, spin, problem, nodes, tables, state, values, work)
    inverse, diagonal, force, extra, y = work.inverse, work.diagonal, work.force, work.extra, state.y
    states, rates, right, integral = work.states, work.rates, work.residual, nodes.integral
    atol, rtol = numbers[SCALE] * problem.atol, numbers[SCALE] * problem.rtol
    idle = 0  # x and y move nothing: they are integrated at the end
    if kind == 0:
        idle = model.dimensions - 1
    previous = math.inf
    for iteration in range(30):
        size, floor = 0.0, 0.0
        for a in range(idle, n):
            member = first <= a < first + members
            if iteration > 0:
                if kind == 0 and not member and diagonal[a] == 0.0:
                    for i in range(count):
                        values[i, a] = rates[i, a]
                else:  # M v = F − c·past − J (Y − y_n), the part of F that J stands for being implicit
                    for i in range(count):
                        right[i] = rates[i, a] - diagonal[a] * (states[i, a] - y[a])
                    if member:
                        for i in range(count):
                            right[i] -= force[i, a - first]
                            if len(finite.values) > 0:
                                right[i] -= extra[i, a - first]
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
                states[i, a] = value
        if iteration > 0:
            if not math.isfinite(size):
                return -iteration
            if size <= max(TOLERANCE, floor) or (iteration > 4 and 0.9 * previous < size <= max(0.1, 10.0 * floor)):
                for i in range(count):
                    for a in range(idle):
                        values[i, a] = rates[i, a]
                return iteration
            if iteration > 4 and size > 0.9 * previous:
                return -iteration
            previous = size
        for i in range(count):
            call(model.rates, numbers[TIME] + nodes.c[i] * h, states, i, rates, i, spin)
            if len(finite.values) > 0:
                for a in range(members):
                    extra[i, a] = 0.0
                excess(finite, problem, states, i, nodes.c, kind, h, kind, tables.past[slot, kind, i], state, values, 1.0, extra)
        numbers[CALLS] += float(count)
    return -30


@shared
def attempt(model: Model, finite: Finite, spin: Floats, problem: Problem, nodes: Nodes, tables: Tables, state: State, values: Floats, work: Work) -> int:
    """Find the next step that keeps the tolerance: ACCEPTED, or why not."""
    numbers, count = state.numbers, len(nodes.c)
    first = model.dimensions  # the slips, one per dimension; spins follow
    while True:
        code: int = choose(problem, tables, state)
        if code != ACCEPTED:
            return code
        iterations = -1
        for trial in range(2):
            if numbers[KNOWN] == 0.0 or trial == 1:
                differentiate(model, spin, state, first, work)
                numbers[KNOWN] = 1.0
            iterations = solve_stages(model, finite, spin, problem, nodes, tables, state, values, work)
            if abs(iterations) > 8:
                numbers[KNOWN] = 0.0
            if iterations > 0:
                break
        h, error, power = numbers[STEP], math.inf, float(count)
        if iterations > 0 and numbers[SINGULAR] == 1.0:
            power = 0.5 * (count + 1)
            states_between(nodes, state, values, work.states)
            for i in range(count):
                call(model.rates, numbers[TIME] + work.halfway[i] * h, work.states, i, work.rates, i, spin)
                if len(finite.values) > 0:
                    slot = int(numbers[SLOT])
                    for a in range(len(problem.where)):
                        work.extra[i, a] = 0.0
                    excess(finite, problem, work.states, i, work.halfway, 2, h, 1, tables.between_past[slot, i], state, values, -1.0, work.extra)
                    for a in range(len(problem.where)):
                        work.rates[i, problem.where[a]] += work.extra[i, a]
            error = CARE / numbers[SCALE] * defect_error(problem, nodes, tables, state, h, int(numbers[SLOT]), values, work.rates)
            if len(finite.values) > 0:
                error *= 4.0  # after a jump its solution has powers of √t that the step's polynomial has not
        elif iterations > 0:
            error = decay_error(problem, nodes, state, h, values) / numbers[SCALE]
        if error > 1.0 and h <= problem.floor:
            return NOT_FINITE
        code = judge(problem, state, error, power)
        if code != AGAIN:
            return code


@shared
def keep_rate(nodes: Nodes, kind: int, h: float, values: Floats, work: Work) -> None:
    """Keep the polynomial of the rates, for the next step's first guess."""
    count, n = values.shape
    work.past[0] = h if kind == 0 else 0.0
    if kind == 0:
        regular, rate = nodes.regular, work.rate
        for d in range(count):
            for a in range(n):
                total = 0.0
                for k in range(count):
                    total += regular[d, k] * values[k, a]
                rate[d, a] = total


@shared
def gap(model: Model, bed: Bed, polynomial: Floats, y: Floats, kind: int, theta: float, draws: Draws) -> float:
    """How far from contact: the larger of the height above the contact and the upward velocity; contact where it is ≤ 0."""
    d = model.dimensions
    z = at(polynomial, y, kind, theta, d - 1)
    w = at(polynomial, y, kind, theta, 2 * d - 1)
    if z >= bed.highest:
        return max(z - bed.highest, w) + 1e-300
    u = at(polynomial, y, kind, theta, d) + both(model.profile, z)[0]
    v = 0.0 if model.dimensions == 2 else at(polynomial, y, kind, theta, d + 1)
    plane = facing(bed.roughness, u, v, w, draws)
    return max(z - plane[1], w)


@shared
def first_contact(model: Model, bed: Bed, polynomial: Floats, y: Floats, kind: int, draws: Draws, fresh: bool) -> float:
    """θ of the first contact in the step, 2 if there is none. `fresh`: the step starts at a takeoff."""
    places = 2 * len(polynomial) + 1
    low, value_low = 0.0, 1.0 if fresh else gap(model, bed, polynomial, y, kind, 0.0, draws)
    if value_low <= 0.0:
        return 0.0
    for i in range(1, places + 1):
        high = i / places
        if kind == 1:
            high *= high
        value = gap(model, bed, polynomial, y, kind, high, draws)
        if value <= 0.0:
            if fresh and i == 1:  # the flight is shorter than this: go back to where it is above the bed
                low = high
                value_low = value
                while value_low <= 0.0 and low > 1e-15:
                    low *= 0.25
                    value_low = gap(model, bed, polynomial, y, kind, low, draws)
                if value_low <= 0.0:
                    return 0.0
            return root_of_gap(model, bed, polynomial, y, kind, draws, low, value_low, high, value)
        low, value_low = high, value
    return 2.0


@shared
def root_of_gap(
    model: Model, bed: Bed, polynomial: Floats, y: Floats, kind: int, draws: Draws, low: float, value_low: float, high: float, value_high: float
) -> float:
    """The contact between `low` (apart) and `high` (touching): regula falsi with Illinois's halving and bisection."""
    side = 0
    for i in range(80):
        if high - low <= 4e-16 * high:
            break
        middle = (low * value_high - high * value_low) / (value_high - value_low) if i % 4 != 3 else 0.5 * (low + high)
        if not low < middle < high:
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
        value = gap(model, bed, polynomial, y, kind, middle, draws)
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
def leaving(model: Model, polynomial: Floats, y: Floats, kind: int, layer: float, states: Floats) -> float:
    """θ at which the step leaves its layer between two kinks, 2 if it does not; `states` at its stages, the end among them."""
    d = model.dimensions
    k = int(layer)
    low = model.kinks[k - 1] if k > 0 else -math.inf
    high = model.kinks[k] if k < 3 else math.inf
    least = most = y[d - 1]
    for i in range(len(states)):
        least, most = min(least, states[i, d - 1]), max(most, states[i, d - 1])
    reach = most - least  # between stages it goes no farther beyond them
    if least - reach >= low and most + reach <= high:
        return 2.0
    places = 2 * len(polynomial) + 1
    before, earlier = 0.0, y[2 * d - 1]
    for i in range(1, places + 1):
        after = i / places
        if kind == 1:
            after *= after
        later = at(polynomial, y, kind, after, 2 * d - 1)
        for trial in range(2):  # where it turns, and at the end
            place = after
            if trial == 0:
                if earlier * later >= 0.0:
                    continue
                place = root_of(polynomial, y, kind, 2 * d - 1, 0.0, earlier > 0.0, before, after)
            z = at(polynomial, y, kind, place, d - 1)
            if z < low:
                return root_of(polynomial, y, kind, d - 1, low, True, before, place)
            if z > high:
                return root_of(polynomial, y, kind, d - 1, high, False, before, place)
        before, earlier = after, later
    return 2.0


@shared
def root_of(polynomial: Floats, y: Floats, kind: int, a: int, level: float, falls: bool, low: float, high: float) -> float:
    """The first θ found beyond `level` of state a, which crosses it between `low` and `high`, by bisection."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        value = at(polynomial, y, kind, middle, a)
        if value < level if falls else value > level:
            high = middle
        else:
            low = middle
    return high


@shared
def cut_step(problem: Problem, nodes: Nodes, memory: Memory, cut: Cut, state: State, theta: float, values: Floats, work: Work) -> None:
    """Take the step that was found up to θ: state, memory and time."""
    numbers, y = state.numbers, state.y
    h, kind = numbers[STEP], int(numbers[SINGULAR])
    all_at(work.polynomial, y, kind, theta, work.here[0])
    if theta > 0.0:
        cut_memory(problem.where, nodes, memory.rates, cut, state, h, theta, kind, values)
    if kind == 1 and theta > 0.05:
        numbers[FIRST] = h
    for a in range(len(y)):
        y[a] = work.here[0, a]
    numbers[TIME] += h * theta
    numbers[STEPS] += 1.0


@shared
def watch(model: Model, polynomial: Floats, y: Floats, kind: int, h: float, theta: float, flight: Floats) -> None:
    """Keep the highest point and the turning of the flight up to θ of the step."""
    d = model.dimensions
    before, after = y[2 * d - 1], at(polynomial, y, kind, theta, 2 * d - 1)
    if before > 0.0 >= after:
        low, high = 0.0, theta
        for _ in range(60):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            if at(polynomial, y, kind, middle, 2 * d - 1) > 0.0:
                low = middle
            else:
                high = middle
        flight[TOP] = max(flight[TOP], at(polynomial, y, kind, high, d - 1))
    flight[TOP] = max(flight[TOP], at(polynomial, y, kind, theta, d - 1))
    if model.spins > 0:
        a = 4 if model.dimensions == 2 else 7
        root = math.sqrt(0.15)
        ends = h * theta / 18.0
        flight[TURNED] += 8.0 * ends * at(polynomial, y, kind, 0.5 * theta, a)
        flight[TURNED] += 5.0 * ends * (at(polynomial, y, kind, (0.5 - root) * theta, a) + at(polynomial, y, kind, (0.5 + root) * theta, a))


@shared
def take_off(model: Model, state: State, spin: Floats, flight: Floats, x: float, y: float, z: float, u: float, v: float, w: float) -> None:
    """Start the account of a new flight; the tolerance follows its likely length, by the one before, where that is short against d/V."""
    likely = (state.numbers[TIME] - flight[START]) * min(1.0, max(0.0, w) / max(flight[W], 1e-300))
    state.numbers[SCALE] = min(1.0, max(SHORTEST, likely))
    flight[START], flight[X], flight[Y], flight[Z], flight[TOP] = state.numbers[TIME], x, y, z, z
    flight[U], flight[V], flight[W], flight[TURNED] = u, v, w, 0.0


@shared
def forget(kept: Floats, when: Floats, rates: Floats, state: State, done: int) -> None:
    """Take out of the memory what came before the oldest impact that is still to be remembered, and mark this one.

    Exponentials decay alike whatever they hold, so what came before an impact is a copy made there, decayed since.
    """
    if len(when) == 0:
        return
    now, past = state.numbers[TIME], state.past
    slot = done % len(when)
    members, terms = past.shape
    if done >= len(when):
        for j in range(len(when)):
            if j != slot:
                for q in range(terms):
                    decay = math.exp(-rates[q] * (when[j] - when[slot]))
                    for a in range(members):
                        kept[j, a, q] -= decay * kept[slot, a, q]
        for q in range(terms):
            decay = math.exp(-rates[q] * (now - when[slot]))
            for a in range(members):
                past[a, q] -= decay * kept[slot, a, q]
    when[slot] = now
    for a in range(members):
        for q in range(terms):
            kept[slot, a, q] = past[a, q]


@shared
def spin_of(model: Model, state: State, spin: Floats) -> Triple:
    """The spin, three components."""
    s = state.y
    if model.spins == 0:
        return spin[0], spin[1], spin[2]
    if model.dimensions == 2:
        return 0.0, s[4], 0.0
    return s[6], s[7], s[8]


@shared
def turn(model: Model, state: State, spin: Floats, ox: float, oy: float, oz: float) -> None:
    """Give the grain a new spin."""
    s = state.y
    if model.spins == 0:
        spin[0], spin[1], spin[2] = ox, oy, oz
    elif model.dimensions == 2:
        s[4] = oy
    else:
        s[6], s[7], s[8] = ox, oy, oz


@shared
def rebounded(model: Model, memory: Memory, problem: Problem, state: State, stream: float, u: float, v: float, w: float) -> None:
    """Give the grain a new velocity after a contact: the memory makes of the jump what the scene says, and steps start small."""
    d = model.dimensions
    s, numbers = state.y, state.numbers
    if len(problem.where) > 0:
        if memory.rebound in (RESTART, RESET):
            past = state.past
            for a in range(past.shape[0]):
                for q in range(past.shape[1]):
                    past[a, q] = 0.0
            state.jump[0], state.jump[d - 1] = u - stream, w
            if model.dimensions == 3:
                state.jump[1] = v
        else:  # a jump that no step has taken up yet still counts
            state.jump[0] += u - stream - s[d]
            state.jump[d - 1] += w - s[2 * d - 1]
            if model.dimensions == 3:
                state.jump[1] += v - s[d + 1]
        if memory.rebound in (RESET, NOTHING):
            for a in range(len(state.jump)):
                state.jump[a] = 0.0
    s[d], s[2 * d - 1] = u - stream, w
    if model.dimensions == 3:
        s[d + 1] = v
    restart(problem, numbers, numbers[FIRST])


@shared
def restart(problem: Problem, numbers: Floats, size: float) -> None:
    """Steps start small again, `size` at most, at a jump of the slip or of its rate."""
    since = numbers[TIME] - numbers[JUMPED]
    numbers[JUMPED] = numbers[TIME]
    numbers[STEP] = max(2.0 * problem.floor, min(size, 0.5 * since) if since > 0.0 else size)
    numbers[SINGULAR], numbers[SMOOTH], numbers[KNOWN] = 1.0 if len(problem.where) > 0 else 0.0, 0.0, 0.0


@shared
def cross(model: Model, problem: Problem, state: State, own: Floats, work: Work) -> None:
    """Enter the next layer: the slip goes on, its rate jumps. Where no time has passed since the layer before, steps shrink until one passes."""
    d = model.dimensions
    z, numbers = state.y[d - 1], state.numbers
    k = int(own[3])
    if k > 0 and (k == 3 or abs(z - model.kinks[k - 1]) < abs(z - model.kinks[k])):
        own[3] = layer_of(model, model.kinks[k - 1] - 0.25, 0.0)
    else:
        own[3] = layer_of(model, model.kinks[k] + 0.25, 0.0)
    restart(problem, numbers, numbers[STEP] if numbers[TIME] > numbers[JUMPED] else 0.25 * numbers[STEP])
    work.past[0] = 0.0


@shared
def land(
    model: Model,
    bed: Bed,
    memory: Memory,
    problem: Problem,
    state: State,
    spin: Floats,
    flight: Floats,
    work: Work,
    limits: Limits,
    jumps: Floats,
) -> int:
    """Strike the bed until the grain moves up; JUMPS when enough are done, REST when it lies still, else ACCEPTED."""
    d = model.dimensions
    s, numbers = state.y, state.numbers
    x, z = s[0], s[d - 1]
    y = 0.0 if model.dimensions == 2 else s[1]
    stream = both(model.profile, z)[0]
    u, w = s[d] + stream, s[2 * d - 1]
    v = 0.0 if model.dimensions == 2 else s[d + 1]
    ox, oy, oz = spin_of(model, state, spin)
    duration = numbers[TIME] - flight[START]
    u_in, v_in, w_in, before = u, v, w, (ox, oy, oz)
    jx, jy, jz, tilt, clipped, normal_speed, contacts = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(MOST_CONTACTS):
        draws = uniforms(bed.seed, bed.grain, int(flight[IMPACTS]))
        flight[IMPACTS] += 1.0
        n, _level, angle, steep = facing(bed.roughness, u, v, w, draws)
        closing = -(u * n[0] + v * n[1] + w * n[2])
        if not closing > 0.0:
            continue  # that plane falls away faster than the grain: the next one
        work.contact[0, 0], work.contact[0, 1], work.contact[0, 2] = n
        work.contact[0, 3], work.contact[0, 4], work.contact[0, 5] = u, v, w
        work.contact[0, 6], work.contact[0, 7], work.contact[0, 8] = ox, oy, oz
        call(bed.rebound, numbers[TIME], work.contact, 0, work.contact, 1, spin)
        after = work.contact[1]
        if contacts == 0.0:
            tilt, clipped, normal_speed = angle, steep, closing
        u, v, w, ox, oy, oz = after[0], after[1], after[2], after[3], after[4], after[5]
        jx, jy, jz, contacts = jx + after[6], jy + after[7], jz + after[8], contacts + 1.0
        if w > 0.0:
            break
    row = jumps[int(flight[DONE])]
    turned = flight[TURNED] if model.spins > 0 else spin[1] * duration
    row[0], row[1], row[2], row[3] = flight[START], flight[X], flight[Y], flight[Z]
    row[4], row[5], row[6], row[7] = flight[U], flight[V], flight[W], duration
    row[8], row[9], row[10], row[11] = x - flight[X], y - flight[Y], flight[TOP] - flight[Z], turned
    row[12], row[13], row[14], row[15] = u_in, v_in, w_in, normal_speed
    row[16], row[17], row[18], row[19], row[20], row[21] = tilt, clipped, jx, jy, jz, contacts
    row[22], row[23], row[24] = before
    flight[DONE] += 1.0
    flight[TAKEN] += 1.0
    # the state and the memory after the impact
    if len(problem.where) > 0:
        forget(memory.before, memory.when, memory.rates, state, int(flight[TAKEN]) - 1)
    rebounded(model, memory, problem, state, stream, u, v, w)
    if not limits.prescribed:
        turn(model, state, spin, ox, oy, oz)
    spin[3] = layer_of(model, z, w)
    work.past[0] = 0.0
    flight[SHORT] = flight[SHORT] + 1.0 if duration < limits.shortest else 0.0
    take_off(model, state, spin, flight, x, y, z, u, v, w)
    if flight[SHORT] >= limits.patience or w <= 0.0:
        return REST
    if flight[TAKEN] >= limits.seal:
        return JUMPS
    return ACCEPTED


class Record(NamedTuple):
    """Accepted steps: start, size, kind, the share that was flown, whether the bed ended it, state at the start, node values."""

    start: Floats
    size: Floats
    kind: Floats
    share: Floats
    impact: Floats
    y: Floats
    values: Floats


class Parts(NamedTuple):
    """What the flight of a grain is made of."""

    model: Model
    bed: Bed
    memory: Memory
    limits: Limits
    problem: Problem
    nodes: Nodes
    cut: Cut
    tables: Tables
    state: State
    work: Work


def _make_fly(digest: str) -> Callable[..., Any]:
    def fly(parts: Parts, spin: Floats, flight: Floats, values: Floats, record: Record, recording: bool, jumps: Floats) -> tuple[int, int]:
        """Fly until something needs the caller: (code, steps recorded)."""
        digest  # noqa: B018 - part of the cache key
        model, bed, memory, limits, problem = parts.model, parts.bed, parts.memory, parts.limits, parts.problem
        nodes, cut, tables, state, work = parts.nodes, parts.cut, parts.tables, parts.state, parts.work
        numbers, count = state.numbers, len(nodes.c)
        d = model.dimensions
        done = 0
        while True:
            if done >= len(record.start):
                return FULL, done
            if int(flight[DONE]) >= len(jumps) and bed.highest > -math.inf:
                return CROWDED, done
            if numbers[TIME] - flight[START] > limits.longest:
                return ALOFT, done
            if numbers[TIME] > memory.horizon:
                return HORIZON, done
            code = attempt(model, memory.finite, spin, problem, nodes, tables, state, values, work)
            if code != ACCEPTED:
                return code, done
            h, kind = numbers[STEP], int(numbers[SINGULAR])
            record.share[done], record.impact[done] = 1.0, 0.0
            contact, kink = 2.0, 2.0
            fit_polynomial(nodes, kind, h, values, work.polynomial)
            near = state.y[d - 1] < bed.highest
            for i in range(count):
                near = near or work.states[i, d - 1] < bed.highest
            if near:
                draws = uniforms(bed.seed, bed.grain, int(flight[IMPACTS]))
                fresh = numbers[TIME] == flight[START]
                contact = first_contact(model, bed, work.polynomial, state.y, kind, draws, fresh)
            if h > 2.0 * problem.floor:
                kink = leaving(model, work.polynomial, state.y, kind, spin[3], work.states)
            theta = min(contact, kink)
            watch(model, work.polynomial, state.y, kind, h, min(theta, 1.0), flight)
            if theta > 1.0:
                keep_rate(nodes, kind, h, values, work)
                accept(problem, nodes, tables, state, values, record, int(done))
                if h <= 2.0 * problem.floor:
                    spin[3] = layer_of(model, state.y[d - 1], state.y[2 * d - 1])
                if recording:
                    done += 1
                continue
            record.start[done], record.size[done], record.kind[done], record.share[done] = numbers[TIME], h, kind, theta
            record.impact[done] = 1.0 if contact <= kink else 0.0
            for a in range(len(state.y)):
                record.y[done, a] = state.y[a]
                for k in range(count):
                    record.values[done, k, a] = values[k, a]
            cut_step(problem, nodes, memory, cut, state, theta, values, work)
            if recording:
                done += 1
            if kink < contact:
                cross(model, problem, state, spin, work)
                continue
            code = land(model, bed, memory, problem, state, spin, flight, work, limits, jumps)
            if code != ACCEPTED:
                return code, done

    return fly


fly = compiled(_make_fly, allocates=False, usually="some 20 s")


def each_force(effects: tuple[Any, ...], s: Situation, out: Floats, row: int, column: int) -> None:
    """The force of every effect into out[row, column:], three numbers each."""
    for effect in effects:
        out[row, column], out[row, column + 1], out[row, column + 2] = force(effect, s)
        column += 3


@overloads(each_force)
def _each_force(effects: Any, s: Any, out: Any, row: Any, column: Any) -> Callable[..., None]:
    def none(effects: Any, s: Any, out: Any, row: Any, column: Any) -> None:
        pass

    def each(effects: Any, s: Any, out: Any, row: Any, column: Any) -> None:
        out[row, column], out[row, column + 1], out[row, column + 2] = force(effects[0], s)
        each_force(effects[1:], s, out, row, column + 3)

    return each if len(effects) else none


def _make_budget(digest: str) -> Callable[..., Any]:
    def budget(equation: Equation, situations: Floats, out: Floats) -> None:
        """Forces of each effect, times α, at situations (points, 9) into `out` (points, 3·effects)."""
        digest  # noqa: B018 - part of the cache key
        for i in range(len(situations)):
            r = situations[i]
            each_force(equation.forces, Situation(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], 0.0), out, i, 0)
            for k in range(out.shape[1]):
                out[i, k] *= equation.alpha

    return budget


budget = compiled(_make_budget)
