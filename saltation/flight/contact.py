"""Contact with the bed: when a step meets it, the record of a flight, and what a rebound does to the state and its memory."""

from __future__ import annotations

import math
from typing import Any

from basset._compile import entry, shared
from basset.kernels import Floats
from basset.solvers.events import between, narrowed
from basset.solvers.stepper import Problem, State, at, restart
from saltation._random import Draws
from saltation.bed.rebound import strike
from saltation.bed.roughness import contact_plane
from saltation.flight.equations import crossed, rise_at, rise_of, stream_at
from saltation.flight.layout import NOTHING, RESET, RESTART, Bed, Memory, Model
from saltation.grain import Triple


def rebound_into(rebound: Any, t: float, y: Any, out: Any, own: Any) -> None:
    """Velocity, spin and impulse (9,) after a contact, into `out`, from normal, velocity and spin before it (9,)."""
    after = strike(rebound, (y[0], y[1], y[2]), (y[3], y[4], y[5]), (y[6], y[7], y[8]))
    out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7], out[8] = after


rebound_entry = entry(rebound_into)


@shared
def gap(model: Model, bed: Bed, polynomial: Floats, y: Floats, kind: int, theta: float, draws: Draws, own: Any) -> float:
    """How far from contact: the larger of the height above the contact and the upward velocity; contact where it is ≤ 0."""
    d = model.dimensions
    z = at(polynomial, y, kind, theta, d - 1)
    clock, drift, w = 0.0, 0.0, at(polynomial, y, kind, theta, 2 * d - 1)
    if z >= bed.highest:
        return max(z - bed.highest, w if model.eddies is None else 0.0) + 1e-300
    if model.eddies is not None:
        first = 2 * d + model.spins
        clock, drift = at(polynomial, y, kind, theta, first), at(polynomial, y, kind, theta, first + 1)
    stream = stream_at(model, z, clock, drift, own)
    if model.eddies is not None:
        w += stream[2]
    u = at(polynomial, y, kind, theta, d) + stream[0]
    v = 0.0 if model.dimensions == 2 else at(polynomial, y, kind, theta, d + 1) + stream[1]
    plane = contact_plane(bed.roughness, u, v, w, draws)
    return max(z - plane[1], w)


@shared
def first_contact(model: Model, bed: Bed, polynomial: Floats, y: Floats, kind: int, draws: Draws, fresh: bool, own: Any) -> float:
    """θ of the first contact in the step, 2 if there is none. `fresh`: the step starts at a takeoff."""
    places = 2 * len(polynomial) + 1
    low, value_low = 0.0, 1.0 if fresh else gap(model, bed, polynomial, y, kind, 0.0, draws, own)
    if value_low <= 0.0:
        return 0.0
    for i in range(1, places + 1):
        high = i / places
        if kind == 1:
            high *= high
        value = gap(model, bed, polynomial, y, kind, high, draws, own)
        if value <= 0.0:
            if fresh and i == 1:  # the flight is shorter than this: go back to where it is above the bed
                low = high
                value_low = value
                while value_low <= 0.0 and low > 1e-15:
                    low *= 0.25
                    value_low = gap(model, bed, polynomial, y, kind, low, draws, own)
                if value_low <= 0.0:
                    return 0.0
            return root_of_gap(model, bed, polynomial, y, kind, draws, own, low, value_low, high, value)
        low, value_low = high, value
    return 2.0


@shared
def root_of_gap(
    model: Model,
    bed: Bed,
    polynomial: Floats,
    y: Floats,
    kind: int,
    draws: Draws,
    own: Any,
    low: float,
    value_low: float,
    high: float,
    value_high: float,
) -> float:
    """The contact between `low` (apart) and `high` (touching)."""
    side = 0
    for i in range(80):
        guess = between(i, low, value_low, high, value_high)
        if guess == low:
            break
        value = gap(model, bed, polynomial, y, kind, guess, draws, own)
        low, value_low, high, value_high, side = narrowed(low, value_low, high, value_high, side, guess, value)
        if value == 0.0:
            break
    return high


@shared
def record_top_and_turning(model: Model, polynomial: Floats, y: Floats, kind: int, h: float, theta: float, flight: Any, own: Any) -> None:
    """Keep the highest point and the turning of the flight up to θ of the step."""
    d = model.dimensions
    before, after = rise_of(model, y, own), rise_at(model, polynomial, y, kind, theta, own)
    if before > 0.0 >= after:
        high = crossed(model, polynomial, y, kind, own, True, 0.0, True, 0.0, theta)
        flight.top = max(flight.top, at(polynomial, y, kind, high, d - 1))
    flight.top = max(flight.top, at(polynomial, y, kind, theta, d - 1))
    if model.spins > 0:
        a = 4 if model.dimensions == 2 else 7
        root = math.sqrt(0.15)
        ends = h * theta / 18.0
        flight.turned += 8.0 * ends * at(polynomial, y, kind, 0.5 * theta, a)
        flight.turned += 5.0 * ends * (at(polynomial, y, kind, (0.5 - root) * theta, a) + at(polynomial, y, kind, (0.5 + root) * theta, a))


@shared
def take_off(flight: Any, time: float, x: float, y: float, z: float, u: float, v: float, w: float) -> None:
    """Start the record of a new flight."""
    flight.start, flight.x, flight.y, flight.z, flight.top = time, x, y, z, z
    flight.u, flight.v, flight.w, flight.turned = u, v, w, 0.0


@shared
def drop_oldest_impact(kept: Floats, when: Floats, rates: Floats, state: State, done: int) -> None:
    """Take out of the memory what came before the oldest impact that is still to be remembered, and mark this one.

    Exponentials decay alike whatever they hold, so what came before an impact is a copy made there, decayed since.
    """
    if len(when) == 0:
        return
    now, past = state.control[0].time, state.past
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
def set_spin(model: Model, s: Floats, spin: Floats, ox: float, oy: float, oz: float) -> None:
    """Set the spin of a grain in the states s."""
    if model.spins == 0:
        spin[0], spin[1], spin[2] = ox, oy, oz
    elif model.dimensions == 2:
        s[4] = oy
    else:
        s[6], s[7], s[8] = ox, oy, oz


@shared
def apply_rebound(model: Model, memory: Memory, problem: Problem, state: State, stream: Triple, u: float, v: float, w: float) -> None:
    """Set the velocity after a contact, with the scene's treatment of the history force; steps start small."""
    d = model.dimensions
    s, control = state.y, state.control[0]
    u -= stream[0]
    if model.eddies is not None:
        v, w = v - stream[1], w - stream[2]
    if len(problem.where) > 0:
        if memory.rebound in (RESTART, RESET):
            past = state.past
            for a in range(past.shape[0]):
                for q in range(past.shape[1]):
                    past[a, q] = 0.0
            state.jump[0], state.jump[d - 1] = u, w
            if model.dimensions == 3:
                state.jump[1] = v
        else:  # added to a jump that no step has used yet
            state.jump[0] += u - s[d]
            state.jump[d - 1] += w - s[2 * d - 1]
            if model.dimensions == 3:
                state.jump[1] += v - s[d + 1]
        if memory.rebound in (RESET, NOTHING):
            for a in range(len(state.jump)):
                state.jump[a] = 0.0
    s[d], s[2 * d - 1] = u, w
    if model.dimensions == 3:
        s[d + 1] = v
    restart(problem, control, control.first_step)
