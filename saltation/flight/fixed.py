"""Flights at fixed steps, with any scheme of `basset.SCHEMES`: what the thesis does (RK4, history held), and an implicit step.

Here to compare with: an impact snaps to the first node behind it, so everything is first order in dt at best. The loop is that of
`basset.solvers._fixed`: here is what it steps, and what happens at a node and at an impact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, entry, invoke, placed, shared
from basset.kernels import Floats
from basset.quadrature import Daitche
from basset.solvers import _fixed, stepper
from basset.solvers._fixed import DONE, GROWN, KNOWN, MATRIX, SEEN
from basset.solvers.stability import degree_of
from saltation._random import uniforms
from saltation.bed.roughness import facing
from saltation.flight import loop as flight
from saltation.flight.setup import Engine, Grain
from saltation.flow import both
from saltation.results.result import Result, path_at

IMPACT = 32  # why the loop came back, beside its own codes and those of a flight
ROWS = 4096


class Layered(NamedTuple):
    """An equation whose layer between two kinks is that of the state; rows (2, state) are overwritten."""

    model: flight.Model
    spin: Floats
    rows: Floats


def rates_in_layer(parts: Layered, t: float, y: Any, out: Any, own: Any) -> None:
    """`flight.rates_of` in the layer where the grain is."""
    model, rows = parts.model, parts.rows
    for a in range(rows.shape[1]):
        rows[0, a] = y[a]
    parts.spin[3] = flight.layer_of(model, rows[0, model.dimensions - 1], rows[0, 2 * model.dimensions - 1])
    call(model.rates, t, rows, 0, rows, 1, parts.spin)
    for a in range(rows.shape[1]):
        out[a] = rows[1, a]


layered_entry = entry(rates_in_layer)


class Look(NamedTuple):
    """What the end of a step is judged by."""

    model: flight.Model
    bed: flight.Bed
    end: float
    horizon: float
    longest: float
    dt: float
    state: _fixed.State
    flight: Floats
    record: _fixed.Record


@shared
def ahead(t: float, dt: float, end: float, horizon: float, longest: float, start: float) -> int:
    """Why no step may follow at t; ACCEPTED if one may."""
    if t >= end * (1.0 - 1e-12):
        return stepper.END
    if t - start > longest:
        return flight.ALOFT
    return flight.HORIZON if t + dt > horizon else stepper.ACCEPTED


def looked(parts: Look, t: float, y: Any, out: Any, own: Any) -> None:
    """Account of the flight at the newest node, at time t; whether it goes on, into out[0]."""
    model, bed, state, account, record, dt = parts.model, parts.bed, parts.state, parts.flight, parts.record, parts.dt
    s, before, rates, d, row = state.y, state.before, state.recent, model.dimensions, int(state.numbers[DONE]) - 1
    ends = t > parts.end * (1.0 + 1e-12)
    if ends:  # within the step: its cubic, back to there
        x = (parts.end - (t - dt)) / dt
        for a in range(len(s)):
            rise, low, high = s[a] - before[0, a], dt * before[1, a], dt * rates[0, a]
            square, cube = 3.0 * rise - 2.0 * low - high, low + high - 2.0 * rise
            record.states[row, a] = s[a] = before[0, a] + x * (low + x * (square + x * cube))
            record.rates[row, a] = rates[0, a] = (low + x * (2.0 * square + 3.0 * x * cube)) / dt
        record.times[row] = parts.end
    w, before_w = s[2 * d - 1], before[0, 2 * d - 1]
    if before_w > 0.0 >= w:
        account[flight.TOP] = max(account[flight.TOP], before[0, d - 1] + 0.5 * dt * before_w * before_w / (before_w - w))
    account[flight.TOP] = max(account[flight.TOP], s[d - 1])
    if model.spins > 0:
        turns = 4 if d == 2 else 7
        account[flight.TURNED] += 0.5 * dt * (before[0, turns] + s[turns])
    out[0] = stepper.END if ends else ahead(t, dt, parts.end, parts.horizon, parts.longest, account[flight.START])
    if not ends and w <= 0.0 and s[d - 1] < bed.highest:
        draws = uniforms(bed.seed, bed.grain, int(account[flight.IMPACTS]))
        u = s[d] + both(model.profile, s[d - 1])[0]
        v = 0.0 if d == 2 else s[d + 1]
        if s[d - 1] <= facing(bed.roughness, u, v, w, draws)[1]:
            out[0] = IMPACT


look_entry = entry(looked)


def run_fixed(engine: Engine, progress: Callable[[float], None] | None = None) -> Result:
    """Simulate a scene at fixed steps; as `saltation.run`."""
    from saltation.simulation import empty_record, ending

    scene, grain = engine.scene, Grain(engine)
    d, m, n, dt = engine.dimensions, engine.members, engine.states, float(scene.solver.dt)
    kind = _fixed.HELD if scene.solver.method == "runge_kutta_4" else _fixed.RATES
    rule = scene.history_rule(engine.horizon) if m else Daitche(1)
    degree = degree_of(rule)
    plan = rule.plan(dt, engine.horizon if m else 2.0 * dt)
    samples = plan.start((m,))
    memory = grain.memory._replace(horizon=(scene.steps_of(engine.horizon) + 0.5) * dt if m else math.inf)
    state = grain.state._replace(past=np.zeros((m, 0)))
    steps = _fixed.state_of(state.y, m, degree)
    numbers, time, account = steps.numbers, state.numbers, grain.flight
    record = _fixed.Record(np.zeros(ROWS), np.zeros((ROWS, n)), np.zeros((ROWS, n)))
    fun, _layered = layered_entry(Layered(engine.model, grain.spin, np.zeros((2, n))))
    limits = engine.problem.end, memory.horizon, engine.limits.longest
    look, _look = look_entry(Look(engine.model, grain.bed, *limits, dt, steps, account, record))
    problem, nothing, room = engine.problem, np.zeros((0, 0)), _fixed.room(1, n, m)
    equation = _fixed.Equation(fun, grain.spin, problem.where, problem.strength, np.zeros(n, dtype=np.bool_), -math.inf, math.inf)
    grid = _fixed.Grid(0.0, math.inf, dt, -1, kind, _fixed.weights_of(degree), nothing, nothing, 1)
    parts = placed(_fixed.Parts(equation, grid, _fixed.stream_of(plan, samples), steps, room, room, record, look, 1, np.zeros((1, 1))))

    def depart(anew: bool) -> None:
        """Set out from the state with the slip's jump, the memory being empty or not."""
        rate = np.zeros(n)
        grain.spin[3] = flight.layer_of(engine.model, state.y[d - 1], state.y[2 * d - 1])
        flight.rates_of(engine.equation, 0.0, state.y, rate, grain.spin)
        if m and anew:
            for array in samples:
                array[...] = 0.0
            plan.push(samples, rate[d : d + m])
            plan.jump(samples, state.jump.copy())
        elif m:
            rate[d : d + m] -= problem.strength * samples.history
            plan.jump(samples, state.jump.copy(), g=rate[d : d + m])
        steps.recent[0] = rate
        numbers[KNOWN], numbers[SEEN], numbers[GROWN], numbers[MATRIX] = 1.0, 0.0, 0.0, 0.0

    struck, _struck = engine.steps(engine.limits, grain.bed, memory, state, grain.spin, account, grain.values, empty_record(0, 0, n), np.zeros((1, 0)), problem)
    signal = np.zeros(2)
    depart(True)
    wanted = scene.run.jumps
    rows: list[Floats] = []
    kept: list[Floats] = [np.concatenate([[0.0], state.y, np.full(n, np.nan)])[None]]
    jumps = np.zeros((1, len(flight.COLUMNS)))
    while True:
        numbers[DONE] = 0.0
        code = ahead(time[stepper.TIME], dt, *limits, account[flight.START])
        if code == stepper.ACCEPTED:
            code = _fixed.steps(parts, 1 << 62)
        done = int(numbers[DONE])
        if done:
            time[stepper.TIME] = record.times[done - 1]
        if scene.run.trajectory:
            kept.append(np.column_stack([record.times[:done], record.states[:done], record.rates[:done]]))
        if code == IMPACT:
            account[flight.DONE] = 0.0
            state.jump[:] = 0.0  # the stream has taken it up
            invoke(struck.land, float(grain.bed.grain), signal, jumps[0], signal)
            code = int(signal[0])
            rows.append(jumps.copy())
            depart(memory.rebound in (flight.RESTART, flight.RESET))
            if scene.run.trajectory:
                kept.append(np.concatenate([[time[stepper.TIME]], state.y, np.full(n, np.nan)])[None])
            if progress is not None and wanted:
                progress(min(1.0, account[flight.TAKEN] / wanted))
            if code == stepper.ACCEPTED:
                continue
        if code != stepper.FULL:
            break
    status, message = ending(code, grain, ("failed", "the steps diverge: take a smaller solver.dt or a lower history.order"))
    table = np.concatenate(rows) if rows else np.zeros((0, len(flight.COLUMNS)))
    result = Result.of(engine, table, None, status, message, grain.spin[:3])
    if scene.run.trajectory:
        whole = np.concatenate(kept)
        which = np.cumsum(np.isnan(whole[:, -1])) - 1  # flight of each point: rates are unknown at takeoffs alone
        spins = np.vstack([table[:, -3:], grain.spin[:3]])
        result._path = path_at(engine, whole[:, 0], whole[:, 1 : 1 + n], whole[:, 1 + n :], spins[which])
    return result
