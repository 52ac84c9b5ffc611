"""The equation of motion of a grain, and what happens on a step of its flight: contact with the bed, and kinks of the stream.

States y are x, [y,] z, slip u − u_f in the same directions, and the spin where it is integrated (ω_y in the plane, all
three in space): what a scene does not name is not there. Slips, not velocities, because they are what the history acts on;
at an impact both jump alike. Steps, tables, error estimates and memory are those of `basset.solvers.stepper`, with the diagonal of
the Jacobian. Impacts are found on the step's polynomial, the step is cut there and the memory advanced to the cut exactly. So are
crossings of the levels at which the stream, or the lift by it, has a kink: up to there a step sees the stream continued smoothly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from basset._compile import call, compiled, entry, overloads, shared
from basset.kernels import Floats
from basset.solvers import stepper
from basset.solvers.stepper import (
    ACCEPTED,
    FIRST,
    FULL,
    JUMPED,
    SCALE,
    SINGULAR,
    STEP,
    TIME,
    Problem,
    State,
    at,
    fit_polynomial,
    keep,
    restart,
)
from saltation._random import Draws, uniforms
from saltation.bed.rebound import strike
from saltation.bed.roughness import facing
from saltation.effects.base import Situation, force, torque, total_force
from saltation.flight.layout import (
    ALOFT,
    CROWDED,
    DONE,
    HORIZON,
    IMPACTS,
    JUMPS,
    NOTHING,
    RESET,
    REST,
    RESTART,
    SHORT,
    START,
    TAKEN,
    TOP,
    TURNED,
    Bed,
    Limits,
    Memory,
    Model,
    U,
    V,
    W,
    X,
    Y,
    Z,
)
from saltation.flow import both, continued
from saltation.grain import Triple

BESIDE = 1e-9  # d: as near to a kink as that is at it
SHORTEST = 0.01  # so small at least is the factor of the tolerance
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
def take_off(flight: Floats, time: float, x: float, y: float, z: float, u: float, v: float, w: float) -> None:
    """Start the account of a new flight."""
    flight[START], flight[X], flight[Y], flight[Z], flight[TOP] = time, x, y, z, z
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
def spin_of(model: Model, s: Floats, spin: Floats) -> Triple:
    """The spin of a grain in the states s, three components."""
    if model.spins == 0:
        return spin[0], spin[1], spin[2]
    if model.dimensions == 2:
        return 0.0, s[4], 0.0
    return s[6], s[7], s[8]


@shared
def turn(model: Model, s: Floats, spin: Floats, ox: float, oy: float, oz: float) -> None:
    """Give a grain in the states s a new spin."""
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
def cross(model: Model, p: stepper.Parts) -> None:
    """Enter the next layer: the slip goes on, its rate jumps. Where no time has passed since the layer before, steps shrink until one passes."""
    numbers, own, z = p.state.numbers, p.equation.own, p.state.y[model.dimensions - 1]
    k = int(own[3])
    if k > 0 and (k == 3 or abs(z - model.kinks[k - 1]) < abs(z - model.kinks[k])):
        own[3] = layer_of(model, model.kinks[k - 1] - 0.25, 0.0)
    else:
        own[3] = layer_of(model, model.kinks[k] + 0.25, 0.0)
    restart(p.problem, numbers, numbers[STEP] if numbers[TIME] > numbers[JUMPED] else 0.25 * numbers[STEP])


class Flight(NamedTuple):
    """All that a grain flies by: the parts of its steps, what there is beside them, its account, and room for a contact (2, 9)."""

    parts: stepper.Parts
    model: Model
    bed: Bed
    memory: Memory
    limits: Limits
    account: Floats
    contact: Floats


@shared
def set_tolerance(g: Flight, likely: float) -> None:
    """The tolerance follows the length of the flight that begins, where that is short against d/V: what is likely by the one before, or by what draws
    the grain down at takeoff.
    """
    p, d = g.parts, g.model.dimensions
    y, room = p.state.y, p.room
    for a in range(len(y)):
        room.here[0, a] = y[a]
    call(p.equation.fun, p.state.numbers[TIME], room.here, 0, room.out, 0, p.equation.own)
    fall = -room.out[0, 2 * d - 1]
    if fall > 0.0:
        likely = min(likely, 2.0 * max(0.0, y[2 * d - 1]) / fall)
    likely = min(1.0, likely)
    p.state.numbers[SCALE] = max(SHORTEST, likely * (0.4 + 0.6 * likely))  # less where short: with so few steps none makes up for another


def landed(g: Flight, t: float, y: Any, out: Any, own: Any) -> None:
    """Strike the bed, as grain number t, until the grain moves up; the jump that ended into the row `out`.

    Into y[0]: JUMPS when enough are done, REST when it lies still, else ACCEPTED.
    """
    model, bed, memory, limits, flight, contact = g.model, g.bed, g.memory, g.limits, g.account, g.contact
    problem, state, spin, row, grain = g.parts.problem, g.parts.state, g.parts.equation.own, out, int(t)
    d = model.dimensions
    s, numbers = state.y, state.numbers
    x, z = s[0], s[d - 1]
    across = 0.0 if model.dimensions == 2 else s[1]
    stream = both(model.profile, z)[0]
    u, w = s[d] + stream, s[2 * d - 1]
    v = 0.0 if model.dimensions == 2 else s[d + 1]
    ox, oy, oz = spin_of(model, s, spin)
    duration = numbers[TIME] - flight[START]
    u_in, v_in, w_in, before = u, v, w, (ox, oy, oz)
    jx, jy, jz, tilt, clipped, normal_speed, contacts = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(MOST_CONTACTS):
        draws = uniforms(bed.seed, grain, int(flight[IMPACTS]))
        flight[IMPACTS] += 1.0
        n, _level, angle, steep = facing(bed.roughness, u, v, w, draws)
        closing = -(u * n[0] + v * n[1] + w * n[2])
        if not closing > 0.0:
            continue  # that plane falls away faster than the grain: the next one
        contact[0, 0], contact[0, 1], contact[0, 2] = n
        contact[0, 3], contact[0, 4], contact[0, 5] = u, v, w
        contact[0, 6], contact[0, 7], contact[0, 8] = ox, oy, oz
        call(bed.rebound, numbers[TIME], contact, 0, contact, 1, spin)
        after = contact[1]
        if contacts == 0.0:
            tilt, clipped, normal_speed = angle, steep, closing
        u, v, w, ox, oy, oz = after[0], after[1], after[2], after[3], after[4], after[5]
        jx, jy, jz, contacts = jx + after[6], jy + after[7], jz + after[8], contacts + 1.0
        if w > 0.0:
            break
    turned = flight[TURNED] if model.spins > 0 else spin[1] * duration
    row[0], row[1], row[2], row[3] = flight[START], flight[X], flight[Y], flight[Z]
    row[4], row[5], row[6], row[7] = flight[U], flight[V], flight[W], duration
    row[8], row[9], row[10], row[11] = x - flight[X], across - flight[Y], flight[TOP] - flight[Z], turned
    row[12], row[13], row[14], row[15] = u_in, v_in, w_in, normal_speed
    row[16], row[17], row[18], row[19], row[20], row[21] = tilt, clipped, jx, jy, jz, contacts
    row[22], row[23], row[24] = before
    flight[DONE] += 1.0
    flight[TAKEN] += 1.0
    # the state and the memory after the impact
    if len(problem.where) > 0:
        forget(memory.before, memory.when, g.parts.cut.rates, state, int(flight[TAKEN]) - 1)
    rebounded(model, memory, problem, state, stream, u, v, w)
    if not limits.prescribed:
        turn(model, s, spin, ox, oy, oz)
    spin[3] = layer_of(model, z, w)
    flight[SHORT] = flight[SHORT] + 1.0 if duration < limits.shortest else 0.0
    # a contact that follows at once says nothing of the flight after it
    set_tolerance(g, duration * min(1.0, max(0.0, w) / max(flight[W], 1e-300)) if duration >= limits.shortest else math.inf)
    take_off(flight, numbers[TIME], x, across, z, u, v, w)
    y[0] = REST if flight[SHORT] >= limits.patience or w <= 0.0 else JUMPS if flight[TAKEN] >= limits.seal else ACCEPTED


land_entry = entry(landed, "some 3 s")


def looked(g: Flight, t: float, y: Any, out: Any, own: Any) -> None:
    """θ at which the step that was found meets the bed, as grain number t, into out[0], and at which it leaves its layer into out[1]; 2 if it does not.

    Its polynomial is in the room.
    """
    model, bed, p, account = g.model, g.bed, g.parts, g.account
    state, room, d = p.state, p.room, g.model.dimensions
    kind = int(state.numbers[SINGULAR])
    near = state.y[d - 1] < bed.highest
    for i in range(len(p.nodes.c)):
        near = near or room.states[i, d - 1] < bed.highest
    out[0] = out[1] = 2.0
    if near:
        draws = uniforms(bed.seed, int(t), int(account[IMPACTS]))
        out[0] = first_contact(model, bed, room.polynomial, state.y, kind, draws, state.numbers[TIME] == account[START])
    if state.numbers[STEP] > 2.0 * p.problem.floor:
        out[1] = leaving(model, room.polynomial, state.y, kind, p.equation.own[3], room.states)


look_entry = entry(looked, "some 3 s")


class Steps(NamedTuple):
    """How a grain flies: what to call, each bound to the flight or its parts; the record of steps and the table of jumps."""

    flight: Flight
    attempt: Any
    accept: Any
    cut: Any
    look: Any
    land: Any
    record: stepper.Record
    jumps: Floats


@shared
def ended(g: Flight) -> int:
    """Why the flight is over before its next step, ACCEPTED if it is not."""
    time = g.parts.state.numbers[TIME]
    if time - g.account[START] > g.limits.longest:
        return ALOFT
    return HORIZON if time > g.memory.horizon else ACCEPTED


def flown(given: Steps, t: float, y: Any, out: Any, own: Any) -> None:
    """What happens on a step that was found, number t of the record: into out[0] ACCEPTED if nothing does, else FULL or why to stop; out[1]: whether it
    was taken, up to the bed or to a kink.
    """
    g, p = given.flight, given.flight.parts
    numbers, signal, model = p.state.numbers, p.room.signal, g.model
    h, kind = numbers[STEP], int(numbers[SINGULAR])
    code = ended(g)
    out[0], out[1] = code, 0.0
    if code != ACCEPTED:
        return
    fit_polynomial(p.nodes, kind, h, p.values, p.room.polynomial)
    call(given.look, float(g.bed.grain), signal, 0, signal, 0, p.equation.own)
    contact, kink = signal[0, 0], signal[0, 1]
    theta = min(contact, kink)
    watch(model, p.room.polynomial, p.state.y, kind, h, min(theta, 1.0), g.account)
    out[0], out[1] = ACCEPTED, 0.0
    if theta > 1.0:
        if h <= 2.0 * p.problem.floor:
            d = model.dimensions
            z, w = at(p.room.polynomial, p.state.y, kind, 1.0, d - 1), at(p.room.polynomial, p.state.y, kind, 1.0, 2 * d - 1)
            p.equation.own[3] = layer_of(model, z, w)
        return
    keep(p, given.record, int(t), theta)
    given.record.leapt[int(t)] = 1.0 if contact <= kink else 0.0
    call(given.cut, theta, signal, 0, signal, 0, signal)
    out[0], out[1] = FULL, 1.0
    if kink < contact:
        cross(model, p)
        return
    call(given.land, float(g.bed.grain), signal, 0, given.jumps, int(g.account[DONE]), signal)
    code = int(signal[0, 0])
    out[0], out[1] = FULL, 1.0
    if code != ACCEPTED:
        out[0] = code
    elif g.account[DONE] >= len(given.jumps):
        out[0] = CROWDED


fly_entry = entry(flown, "some 3 s")


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
