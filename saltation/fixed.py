"""Flights at fixed steps, with any scheme of `basset.SCHEMES`: what the thesis does (RK4, history held), and an implicit step.

Here to compare with: an impact snaps to the first node behind it, so everything is first order in dt at best. The loop from
impact to impact is compiled; at an impact the stream of the history takes its jump in Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from basset._compile import call, compiled
from basset._stream import peek, run
from basset.kernels import Floats
from basset.quadrature import Daitche
from basset.solvers import stepper
from basset.solvers.stability import adams_moulton, diverging
from saltation import flight
from saltation._random import uniforms
from saltation.bed.roughness import facing
from saltation.engine import Engine, Grain
from saltation.flow import both
from saltation.result import Result, path_at

IMPACT, UNSOLVED = 30, 31
HELD, IMPLICIT = 0, 1  # the history of a step's beginning all through it; or both at its end


def _make_cruise(digest: str) -> Callable[..., Any]:
    def cruise(
        model: flight.Model,
        bed: flight.Bed,
        problem: stepper.Problem,
        dt: float,
        method: int,
        weights: Floats,
        arrays: tuple[Any, ...],
        stream: tuple[Floats, Floats, Floats, Floats],
        counters: Any,
        state: stepper.State,
        spin: Floats,
        flight_: Floats,
        room: tuple[Floats, Floats, Floats, Floats, Floats],
        limits: flight.Limits,
        memory: flight.Memory,
        jumps: Floats,
        path: Floats,
    ) -> tuple[int, int]:
        """Steps until an impact, a full record or the end: (code, nodes recorded)."""
        digest  # noqa: B018 - part of the cache key
        slots, short, oldest, interior, steady, fixed, loss, gains, entry = arrays
        samples, terms, future, history = stream
        rates, states, tail, sample, value = room
        y, numbers = state.y, state.numbers
        n, m, d = len(y), len(problem.where), model.dimensions
        done = 0
        while done < len(path):
            if numbers[stepper.TIME] >= problem.end * (1.0 - 1e-12):
                return stepper.END, done
            if numbers[stepper.TIME] - flight_[flight.START] > limits.longest:
                return flight.ALOFT, done
            if numbers[stepper.TIME] + dt > memory.horizon:
                return flight.HORIZON, done
            local = 0.0
            if m > 0:
                count, node, pending = int(counters[0]), int(counters[1]), int(counters[2])
                peek(samples, terms, future, count, node, pending, slots, short, oldest, interior, steady, fixed, loss, gains, entry, tail)
                if count >= steady:
                    local = fixed[len(fixed) - 1]
                elif count < len(short):
                    local = short[count, count]
                else:
                    local = interior[len(interior) - 1]
            known = int(numbers[stepper.STEPS])  # rates of this stretch, newest in row 0
            if method == HELD:
                for a in range(n):
                    states[0, a] = y[a]
                for stage in range(4):
                    spin[3] = flight.layer_of(model, states[stage, d - 1], states[stage, 2 * d - 1])
                    call(model.rates, numbers[stepper.TIME], states, stage, states, 5 + stage, spin)
                    for a in range(m):
                        states[5 + stage, d + a] -= problem.strength[a] * history[a]
                    share = (0.5, 0.5, 1.0, 0.0)[stage]
                    if stage < 3:
                        for a in range(n):
                            states[stage + 1, a] = y[a] + share * dt * states[5 + stage, a]
                for a in range(n):
                    states[4, a] = y[a] + dt / 6.0 * (states[5, a] + 2.0 * states[6, a] + 2.0 * states[7, a] + states[8, a])
                spin[3] = flight.layer_of(model, states[4, d - 1], states[4, 2 * d - 1])
                call(model.rates, numbers[stepper.TIME] + dt, states, 4, states, 9, spin)
                for a in range(m):
                    states[9, d + a] = (states[9, d + a] - problem.strength[a] * tail[a]) / (1.0 + problem.strength[a] * local)
            else:
                degree = min(len(weights) - 1, known)
                for a in range(n):
                    states[0, a] = y[a]
                    for k in range(degree):
                        states[0, a] += dt * weights[degree, k + 1] * rates[k, a]
                    states[9, a] = rates[0, a]
                lead, converged = dt * weights[degree, 0], False
                for _ in range(200):
                    change = 0.0
                    for a in range(n):
                        states[4, a] = states[0, a] + lead * states[9, a]
                    spin[3] = flight.layer_of(model, states[4, d - 1], states[4, 2 * d - 1])
                    call(model.rates, numbers[stepper.TIME] + dt, states, 4, states, 10, spin)
                    for a in range(n):
                        new = states[10, a]
                        if d <= a < d + m:
                            new = (new - problem.strength[a - d] * tail[a - d]) / (1.0 + problem.strength[a - d] * local)
                        change = max(change, abs(new - states[9, a]) / (1.0 + abs(new)))
                        states[9, a] = new
                    if not math.isfinite(change):
                        return UNSOLVED, done
                    if change <= 1e-13:
                        converged = True
                        break
                if not converged:
                    return UNSOLVED, done
                for a in range(n):
                    states[4, a] = states[0, a] + lead * states[9, a]
            before_z, before_w = y[d - 1], y[2 * d - 1]
            for a in range(n):
                states[0, a], states[10, a] = y[a], rates[0, a]
            spin_before = 0.0
            if model.spins > 0:
                spin_before = y[4] if model.dimensions == 2 else y[7]
            for a in range(n):
                y[a] = states[4, a]
                for k in range(min(known, len(rates) - 1), 0, -1):
                    rates[k, a] = rates[k - 1, a]
                rates[0, a] = states[9, a]
            if m > 0:
                for a in range(m):
                    sample[0, a] = rates[0, d + a]
                run(samples, terms, future, count, node, pending, sample, value, slots, short, oldest, interior, steady, fixed, loss, gains, entry)
                for a in range(m):
                    history[a] = value[0, a]
                counters[0], counters[1], counters[2] = count + 1, node + 1, max(0, pending - 1)
            begin = numbers[stepper.TIME]
            numbers[stepper.TIME] += dt
            numbers[stepper.STEPS] = min(known + 1, len(rates))
            ends = numbers[stepper.TIME] > problem.end * (1.0 + 1e-12)
            if ends:  # within the step: its cubic, back to there
                x = (problem.end - begin) / dt
                for a in range(n):
                    rise = y[a] - states[0, a]
                    low, high = dt * states[10, a], dt * rates[0, a]
                    square, cube = 3.0 * rise - 2.0 * low - high, low + high - 2.0 * rise
                    y[a] = states[0, a] + x * (low + x * (square + x * cube))
                    rates[0, a] = (low + x * (2.0 * square + 3.0 * x * cube)) / dt
                numbers[stepper.TIME] = problem.end
            w = y[2 * d - 1]
            if before_w > 0.0 >= w:
                share = before_w / (before_w - w)
                flight_[flight.TOP] = max(flight_[flight.TOP], before_z + 0.5 * dt * before_w * share)
            flight_[flight.TOP] = max(flight_[flight.TOP], y[d - 1])
            if model.spins > 0:
                flight_[flight.TURNED] += 0.5 * dt * (spin_before + (y[4] if model.dimensions == 2 else y[7]))
            path[done, 0] = numbers[stepper.TIME]
            for a in range(n):
                path[done, 1 + a], path[done, 1 + n + a] = y[a], rates[0, a]
            done += 1
            if ends:
                return stepper.END, done
            if w <= 0.0 and y[d - 1] < bed.highest:
                draws = uniforms(bed.seed, bed.grain, int(flight_[flight.IMPACTS]))
                u = y[d] + both(model.profile, y[d - 1])[0]
                v = 0.0 if model.dimensions == 2 else y[d + 1]
                if y[d - 1] <= facing(bed.roughness, u, v, w, draws)[1]:
                    return IMPACT, done
        return stepper.FULL, done

    return cruise


cruise = compiled(_make_cruise, usually="some 20 s")


def _make_strike(digest: str) -> Callable[..., Any]:
    def strike(
        model: flight.Model,
        bed: flight.Bed,
        memory: flight.Memory,
        problem: stepper.Problem,
        state: stepper.State,
        spin: Floats,
        flight_: Floats,
        work: flight.Work,
        limits: flight.Limits,
        jumps: Floats,
    ) -> int:
        """`flight.land` on its own."""
        digest  # noqa: B018 - part of the cache key
        return flight.land(model, bed, memory, problem, state, spin, flight_, work, limits, jumps)

    return strike


strike = compiled(_make_strike, allocates=False)


def run_fixed(engine: Engine, progress: Callable[[float], None] | None = None) -> Result:
    """Simulate a scene at fixed steps; as `saltation.run`."""
    from saltation.simulation import ending

    scene = engine.scene
    grain = Grain(engine)
    state, d, m, n = grain.state, engine.dimensions, engine.members, engine.states
    dt = float(scene.solver.dt)
    held = scene.solver.method == "runge_kutta_4"
    rule = scene.history_rule(engine.horizon) if m else Daitche(1)
    base = rule._remembered
    degree = base.order if isinstance(base, Daitche) else 1
    weights = np.zeros((degree + 1, degree + 1))
    for p in range(1, degree + 1):
        weights[p, : p + 1] = adams_moulton(p)
    weights[0, 0] = 1.0
    plan = rule.plan(dt, engine.horizon if m else 2.0 * dt)
    memory = grain.memory._replace(rates=np.zeros(0), horizon=(scene.steps_of(engine.horizon) + 0.5) * dt if m else math.inf)
    state = state._replace(past=np.zeros((m, 0)))
    stream = plan.start((m,))
    short, oldest, interior, fixed, loss, gains, entry = plan._arrays
    arrays = (plan._slots, short, oldest, interior, plan._steady, fixed, loss, gains, entry)
    room = (np.zeros((max(degree, 1), n)), np.zeros((11, n)), np.zeros(m), np.zeros((1, m)), np.zeros((1, m)))

    def rate() -> Floats:
        grain.spin[3] = flight.layer_of(engine.model, state.y[d - 1], state.y[2 * d - 1])
        out = np.zeros(n)
        flight.rates_of(engine.equation, 0.0, state.y, out, grain.spin)
        if m:
            out[d : d + m] -= engine.problem.strength * stream.history
        return out

    first = rate()
    if m:
        plan.push(stream, first[d : d + m])
        plan.jump(stream, state.jump.copy())
    room[0][0] = first
    state.numbers[stepper.STEPS] = 1.0
    wanted = scene.run.jumps
    rows: list[Floats] = []
    kept: list[Floats] = [np.concatenate([[0.0], state.y, np.full(n, np.nan)])[None]]
    path = np.zeros((4096, 1 + 2 * n))
    jumps = np.zeros((1, len(flight.COLUMNS)))
    while True:
        code, done = cruise(
            engine.model,
            grain.bed,
            engine.problem,
            dt,
            HELD if held else IMPLICIT,
            weights,
            arrays,
            (stream.samples, stream.terms, stream.future, stream.history),
            stream.counters,
            state,
            grain.spin,
            grain.flight,
            room,
            engine.limits,
            memory,
            jumps,
            path,
        )
        if diverging(path[:done, 1 + n :]):
            code = UNSOLVED
        if scene.run.trajectory:
            kept.append(path[:done].copy())
        if code == IMPACT:
            grain.flight[flight.DONE] = 0.0
            state.jump[:] = 0.0  # the stream has taken it up
            code = strike(engine.model, grain.bed, memory, engine.problem, state, grain.spin, grain.flight, grain.work, engine.limits, jumps)
            rows.append(jumps.copy())
            after = rate()
            if m:
                if memory.rebound in (flight.RESTART, flight.RESET):
                    stream = plan.start((m,))
                    after = rate()
                    plan.push(stream, after[d : d + m])
                    plan.jump(stream, state.jump.copy())
                else:
                    plan.jump(stream, state.jump.copy(), g=after[d : d + m])
            room[0][0] = after
            state.numbers[stepper.STEPS] = 1.0
            if scene.run.trajectory:
                kept.append(np.concatenate([[state.numbers[stepper.TIME]], state.y, np.full(n, np.nan)])[None])
            if progress is not None and wanted:
                progress(min(1.0, grain.flight[flight.TAKEN] / wanted))
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
