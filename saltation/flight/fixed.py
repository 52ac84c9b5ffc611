"""Flights at fixed steps, with any scheme of `basset.SCHEMES`: what the thesis does (RK4, history held), and an implicit step.

For comparison only: an impact is moved to the first node behind it, so everything is first order in dt at best. The loop is that of
`basset.solvers._fixed`; here are the equation, and what happens at a node and at an impact.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from basset._compile import call, entry, invoke, placed, shared
from basset.kernels import Floats, VaryingSlipKernel
from basset.quadrature.rule import slip_recipes
from basset.solvers import _fixed, stepper
from basset.solvers._fixed import DONE, GROWN, KNOWN, MATRIX, SEEN
from basset.solvers.stability import degree_of, symbols
from basset.streaming.following import FollowingPlan
from basset.streaming.forgetting import JumpWindow
from saltation._random import uniforms
from saltation.bed.roughness import contact_plane
from saltation.effects.history import kernel_of
from saltation.flight import equations, layout
from saltation.flight.setup import Engine, Grain, Start, empty_record
from saltation.flow import velocity_and_shear

IMPACT = 32  # why the loop returns, beside its own codes and those of a flight
ROWS = 4096
ALTERNATES = 5.0  # W(−1) of a rule whose own weights alternate, as Simpson's: what alternates with them is no sign of divergence


class Layered(NamedTuple):
    """An equation whose layer between two kinks is that of the state; rows (2, state) are overwritten."""

    model: layout.Model
    spin: Floats
    rows: Floats


def rates_in_layer(parts: Layered, t: float, y: Any, out: Any, own: Any) -> None:
    """`equations.rates_of` in the layer where the grain is."""
    model, rows = parts.model, parts.rows
    for a in range(rows.shape[1]):
        rows[0, a] = y[a]
    parts.spin[3] = equations.layer_of(model, rows[0, model.dimensions - 1], rows[0, 2 * model.dimensions - 1])
    call(model.rates, t, rows, 0, rows, 1, parts.spin)
    for a in range(rows.shape[1]):
        out[a] = rows[1, a]


layered_entry = entry(rates_in_layer)


class NodeCheck(NamedTuple):
    """What the check at every node needs."""

    model: layout.Model
    bed: layout.Bed
    end: float
    horizon: float
    longest: float
    dt: float
    state: _fixed.State
    flight: Any
    record: _fixed.Record


@shared
def reason_to_stop(t: float, dt: float, end: float, horizon: float, longest: float, start: float) -> int:
    """Why no step may follow at t; ACCEPTED if one may."""
    if t >= end * (1.0 - 1e-12):
        return stepper.END
    if t - start > longest:
        return layout.ALOFT
    return layout.HORIZON if t + dt > horizon else stepper.ACCEPTED


def checked(parts: NodeCheck, t: float, y: Any, out: Any, own: Any) -> None:
    """Update the record of the flight at the newest node, at time t; into out[0] whether it goes on."""
    model, bed, state, account, record, dt = parts.model, parts.bed, parts.state, parts.flight[0], parts.record, parts.dt
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
        account.top = max(account.top, before[0, d - 1] + 0.5 * dt * before_w * before_w / (before_w - w))
    account.top = max(account.top, s[d - 1])
    if model.spins > 0:
        turns = 4 if d == 2 else 7
        account.turned += 0.5 * dt * (before[0, turns] + s[turns])
    out[0] = stepper.END if ends else reason_to_stop(t, dt, parts.end, parts.horizon, parts.longest, account.start)
    if not ends and w <= 0.0 and s[d - 1] < bed.highest:
        draws = uniforms(bed.seed, bed.grain, account.impacts)
        u = s[d] + velocity_and_shear(model.profile, s[d - 1])[0]
        v = 0.0 if d == 2 else s[d + 1]
        if s[d - 1] <= contact_plane(bed.roughness, u, v, w, draws)[1]:
            out[0] = IMPACT


check_entry = entry(checked)


class FixedGrain(Grain):
    """One grain during a run at fixed steps."""

    def __init__(self, engine: Engine, grain: int = 0, start: Start | None = None) -> None:
        super().__init__(engine, grain, start)
        scene, m, n, dt = engine.scene, engine.members, engine.states, engine.scene.solver.dt or 0.0
        rule = scene.history_rule(engine.horizon)
        degree = degree_of(rule)
        options, horizon = scene.options("history"), engine.horizon if m else 2.0 * dt
        kernel = kernel_of(options, engine.numbers)
        self.plan: Any = FollowingPlan(*slip_recipes(rule, dt, horizon, kernel)) if m and isinstance(kernel, VaryingSlipKernel) else rule.plan(dt, horizon)
        self.samples: Any = self.plan.start(m)
        self.window = JumpWindow(self.plan, options.window_jumps) if m and options.window_jumps is not None else None
        self.memory = self.memory._replace(horizon=(scene.steps_of(engine.horizon) + 0.5) * dt if m else math.inf)
        self.state = self.state._replace(past=np.zeros((m, 0)))
        self.record = _fixed.Record(np.zeros(ROWS), np.zeros((ROWS, n)), np.zeros((ROWS, n)))
        self._steps = _fixed.state_of(self.state.y, m, degree)
        fun, layered = layered_entry(Layered(engine.model, self.spin, np.zeros((2, n))))
        self._limits = dt, engine.problem.end, self.memory.horizon, engine.limits.longest
        check, checked = check_entry(NodeCheck(engine.model, self.bed, *self._limits[1:], dt, self._steps, self.flight, self.record))
        problem, nothing, room = engine.problem, np.zeros((0, 0)), _fixed.room(1, n, m)
        equation = _fixed.Equation(fun, self.spin, problem.where, problem.strength, np.zeros(n, dtype=np.bool_), -math.inf, math.inf)
        kind = _fixed.HELD if scene.solver.method == "runge_kutta_4" else _fixed.RATES
        grid = _fixed.Grid(0.0, math.inf, dt, -1, kind, _fixed.weights_of(degree), nothing, nothing, int(symbols(rule)[1] < ALTERNATES))
        stream = _fixed.stream_of(self.plan, self.samples)
        self._parts = placed(_fixed.Parts(equation, grid, stream, self._steps, room, room, self.record, check, 1, np.zeros((1, 1))))
        given = engine.limits, self.bed, self.memory, self.state, self.spin, self.flight, self.values
        self._struck, struck = engine.steps(*given, empty_record(0, 0, n), np.zeros((1, 0)), problem)
        self._kept = layered, checked, struck  # what addresses point to
        self._depart(True)

    def _depart(self, anew: bool) -> None:
        """Start from the state with its jump of the slip; `anew`: with an empty memory."""
        engine, state, samples, numbers = self.engine, self.state, self.samples, self._steps.numbers
        d, m, rate = engine.dimensions, engine.members, np.zeros(engine.states)
        self.spin[3] = equations.layer_of(engine.model, state.y[d - 1], state.y[2 * d - 1])
        equations.rates_of(engine.equation, 0.0, state.y, rate, self.spin)
        slip = {"slip": state.y[d : d + m]} if isinstance(self.plan, FollowingPlan) else {}
        if m and anew:
            for array in samples if not slip else ():  # the other plan's first sample does so
                array[...] = 0.0
            self.plan.push(samples, rate[d : d + m])
            self.plan.jump(samples, state.jump.copy(), **slip)
        elif m:
            rate[d : d + m] -= engine.problem.strength * samples.history
            jump = self.plan.jump if self.window is None else self.window.jump
            jump(samples, state.jump.copy(), g=rate[d : d + m].copy(), **slip)
        if self.window is not None and anew:
            self.window.begin(samples, state.jump)
        self._steps.recent[0] = rate
        numbers[KNOWN], numbers[SEEN], numbers[GROWN], numbers[MATRIX] = 1.0, 0.0, 0.0, 0.0

    def fly(self, record: Any, recording: bool, jumps: Floats) -> tuple[int, int]:
        """Fly to the next impact, or until the record, which is its own, is full. (code, steps recorded)."""
        numbers, progress = self._steps.numbers, self.state.control[0]
        numbers[DONE] = 0.0
        code = reason_to_stop(progress.time, *self._limits, self.flight[0].start)
        if code == stepper.ACCEPTED:
            code = _fixed.steps(self._parts, 1 << 62)
        done = int(numbers[DONE])
        if done:
            progress.time = self.record.times[done - 1]
        if code == IMPACT:
            signal = np.zeros(2)
            self.state.jump[:] = 0.0  # already in the memory
            invoke(self._struck.land, float(self.bed.grain), signal, jumps[0], signal)
            code = int(signal[0])
            self._depart(self.memory.rebound in (layout.RESTART, layout.RESET))
            if code == stepper.ACCEPTED:
                code = stepper.FULL
        return code, done
