"""What happens on a step of a flight: it ends at the bed, at a kink of the stream, or goes on.

Steps, tables, error estimates and memory are those of `basset.solvers.stepper`, with the diagonal of the Jacobian. Impacts are found on the
step's polynomial, the step is truncated there and the memory advanced to that point exactly. Crossings of kinks likewise.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from basset._compile import call, entry, shared
from basset.kernels import Floats
from basset.solvers import stepper
from basset.solvers.stepper import ACCEPTED, FULL, at, fit_polynomial, keep
from saltation._random import uniforms
from saltation.bed.roughness import contact_plane
from saltation.flight.contact import apply_rebound, drop_oldest_impact, first_contact, record_top_and_turning, set_spin, spin_of, take_off
from saltation.flight.equations import cross_kink, layer_of, leaving, motion_of, rise_at, rise_of, stream_of, velocity_of
from saltation.flight.layout import ALOFT, CROWDED, HORIZON, JUMPS, REST, Bed, Limits, Memory, Model

SHORTEST = 0.01  # smallest factor of the tolerance
UNMOVED = 4.0 * 2.0**-52  # of a height
MOST_CONTACTS = 1000  # at one place before the grain is taken to lie still


class Flight(NamedTuple):
    """One grain's flight: the parts of its steps, model, bed, memory and limits, its record (`account`), and work space for a contact (2, 9)."""

    parts: stepper.Parts
    model: Model
    bed: Bed
    memory: Memory
    limits: Limits
    account: Any
    contact: Floats


@shared
def set_tolerance(g: Flight, likely: float) -> None:
    """The tolerance follows the duration of the flight that begins, where that is short against d/V, as estimated from the flight before or from the
    downward acceleration at takeoff.
    """
    p, d = g.parts, g.model.dimensions
    y, work = p.state.y, p.work
    for a in range(len(y)):
        work.here[0, a] = y[a]
    work.here[0, d - 1] += g.limits.above
    call(p.equation.fun, p.state.control[0].time, work.here, 0, work.out, 0, p.equation.own)
    fall = -work.out[0, 2 * d - 1]
    if g.model.eddies is not None:
        fall -= motion_of(g.model, y, p.equation.own).rate[2]
    if fall > 0.0:
        likely = min(likely, 2.0 * max(0.0, rise_of(g.model, y, p.equation.own)) / fall)
    likely = min(1.0, likely)
    p.state.control[0].tolerance_factor = max(SHORTEST, likely * (0.4 + 0.6 * likely))  # smaller where short: errors of so few steps do not average out


def landed(g: Flight, t: float, y: Any, out: Any, own: Any) -> None:
    """Strike the bed, as grain number t, until the grain moves up; the jump that ended into the row `out`.

    Into y[0]: JUMPS when enough are done, REST when it lies still, else ACCEPTED.
    """
    model, bed, memory, limits, flight, contact = g.model, g.bed, g.memory, g.limits, g.account[0], g.contact
    problem, state, spin, row, grain = g.parts.problem, g.parts.state, g.parts.equation.own, out, int(t)
    d = model.dimensions
    s, control = state.y, state.control[0]
    x, z = s[0], s[d - 1]
    across = 0.0 if model.dimensions == 2 else s[1]
    stream = stream_of(model, s, spin)
    u, v, w = velocity_of(model, s, spin)
    ox, oy, oz = spin_of(model, s, spin)
    duration = control.time - flight.start
    u_in, v_in, w_in, before = u, v, w, (ox, oy, oz)
    jx, jy, jz, tilt, clipped, normal_speed, contacts = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(MOST_CONTACTS):
        draws = uniforms(bed.seed, grain, flight.impacts)
        flight.impacts += 1
        n, _level, angle, steep = contact_plane(bed.roughness, u, v, w, draws)
        closing = -(u * n[0] + v * n[1] + w * n[2])
        if not closing > 0.0:
            continue  # the grain moves away from that plane: draw another
        contact[0, 0], contact[0, 1], contact[0, 2] = n
        contact[0, 3], contact[0, 4], contact[0, 5] = u, v, w
        contact[0, 6], contact[0, 7], contact[0, 8] = ox, oy, oz
        call(bed.rebound, control.time, contact, 0, contact, 1, spin)
        after = contact[1]
        if contacts == 0.0:
            tilt, clipped, normal_speed = angle, steep, closing
        u, v, w, ox, oy, oz = after[0], after[1], after[2], after[3], after[4], after[5]
        jx, jy, jz, contacts = jx + after[6], jy + after[7], jz + after[8], contacts + 1.0
        if w > 0.0:
            break
    turned = flight.turned if model.spins > 0 else spin[1] * duration
    row[0], row[1], row[2], row[3] = flight.start, flight.x, flight.y, flight.z
    row[4], row[5], row[6], row[7] = flight.u, flight.v, flight.w, duration
    row[8], row[9], row[10], row[11] = x - flight.x, across - flight.y, flight.top - flight.z, turned
    row[12], row[13], row[14], row[15] = u_in, v_in, w_in, normal_speed
    row[16], row[17], row[18], row[19], row[20], row[21] = tilt, clipped, jx, jy, jz, contacts
    row[22], row[23], row[24] = before
    flight.done += 1
    flight.taken += 1
    # the state and the memory after the impact
    if len(problem.where) > 0:
        drop_oldest_impact(memory.before, memory.when, g.parts.truncation.rates, state, flight.taken - 1)
    apply_rebound(model, memory, problem, state, stream, u, v, w)
    if not limits.prescribed:
        set_spin(model, s, spin, ox, oy, oz)
    spin[3] = layer_of(model, z, w)
    flight.short = flight.short + 1 if duration < limits.shortest else 0
    # a contact that follows at once tells nothing about the flight after it
    set_tolerance(g, duration * min(1.0, max(0.0, w) / max(flight.w, 1e-300)) if duration >= limits.shortest else math.inf)
    take_off(flight, control.time, x, across, z, u, v, w)
    y[0] = REST if flight.short >= limits.patience or w <= 0.0 else JUMPS if flight.taken >= limits.max_jumps else ACCEPTED


land_entry = entry(landed, "some 3 s")


def looked(g: Flight, t: float, y: Any, out: Any, own: Any) -> None:
    """θ at which the step that was found meets the bed, as grain number t, into out[0], and at which it leaves its layer into out[1]; 2 if it does not.

    Its polynomial is in the work space.
    """
    model, bed, p, account = g.model, g.bed, g.parts, g.account[0]
    state, work, d = p.state, p.work, g.model.dimensions
    kind = int(state.control[0].singular)
    near = state.y[d - 1] < bed.highest or at(work.polynomial, state.y, kind, 1.0, d - 1) < bed.highest  # the stages are of the last but one iteration
    for i in range(len(p.nodes.c)):
        near = near or work.states[i, d - 1] < bed.highest
    out[0] = out[1] = 2.0
    if near:
        draws = uniforms(bed.seed, int(t), account.impacts)
        fresh = state.control[0].time == account.start
        out[0] = first_contact(model, bed, work.polynomial, state.y, kind, draws, fresh, p.equation.own)
        if fresh and out[0] * state.control[0].step * abs(rise_of(model, state.y, p.equation.own)) <= UNMOVED * abs(state.y[d - 1]):
            out[0] = 0.0  # what moves the grain by no more than rounding is no flight
    if state.control[0].step > 2.0 * p.problem.floor:
        out[1] = leaving(model, work.polynomial, state.y, kind, p.equation.own, work.states)


look_entry = entry(looked, "some 3 s")


class Steps(NamedTuple):
    """How a grain flies: what to call, each bound to the flight or its parts; the record of steps and the table of jumps."""

    flight: Flight
    attempt: Any
    accept: Any
    truncate: Any
    look: Any
    land: Any
    record: stepper.Record
    jumps: Floats


@shared
def ended(g: Flight) -> int:
    """Why the flight is over before its next step, ACCEPTED if it is not."""
    time = g.parts.state.control[0].time
    if time - g.account[0].start > g.limits.longest:
        return ALOFT
    return HORIZON if time > g.memory.horizon else ACCEPTED


def flown(given: Steps, t: float, y: Any, out: Any, own: Any) -> None:
    """What happens on a step that was found, number t of the record: into out[0] ACCEPTED if nothing does, else FULL or why to stop; out[1]: whether it
    was taken, up to the bed or to a kink.
    """
    g, p = given.flight, given.flight.parts
    control, signal, model = p.state.control[0], p.work.signal, g.model
    h, kind = control.step, int(control.singular)
    code = ended(g)
    out[0], out[1] = code, 0.0
    if code != ACCEPTED:
        return
    fit_polynomial(p.nodes, kind, h, p.values, p.work.polynomial)
    call(given.look, float(g.bed.grain), signal, 0, signal, 0, p.equation.own)
    contact, kink = signal[0, 0], signal[0, 1]
    theta = min(contact, kink)
    record_top_and_turning(model, p.work.polynomial, p.state.y, kind, h, min(theta, 1.0), g.account[0], p.equation.own)
    out[0], out[1] = ACCEPTED, 0.0
    if theta > 1.0:
        if h <= 2.0 * p.problem.floor:
            d = model.dimensions
            z, w = at(p.work.polynomial, p.state.y, kind, 1.0, d - 1), rise_at(model, p.work.polynomial, p.state.y, kind, 1.0, p.equation.own)
            p.equation.own[3] = layer_of(model, z, w)
        return
    keep(p, given.record, int(t), theta)
    given.record.leapt[int(t)] = 1.0 if contact <= kink else 0.0
    call(given.truncate, theta, signal, 0, signal, 0, signal)
    out[0], out[1] = FULL, 1.0
    if kink < contact:
        cross_kink(model, p)
        return
    call(given.land, float(g.bed.grain), signal, 0, given.jumps, g.account[0].done, signal)
    code = int(signal[0, 0])
    out[0], out[1] = FULL, 1.0
    if code != ACCEPTED:
        out[0] = code
    elif g.account[0].done >= len(given.jumps):
        out[0] = CROWDED


fly_entry = entry(flown, "some 3 s")
