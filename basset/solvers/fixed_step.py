"""Fixed steps with any rule: the history split into tail + local·(newest sample), implicit in the newest sample (this library)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from basset import _validate
from basset._compile import Callbacks, is_compiled, placed
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.quadrature import Daitche, Rule, SemiDerivative, resolve
from basset.solvers import _fixed, events
from basset.solvers.base import Method, Piece, Segment, SolverError, Task, Trace, segments
from basset.solvers.stability import IN_A_ROW, bounds, degree_of, longest_step, stable, whole_recipe
from basset.solvers.stepper import AT_REST, END, FULL, NOT_FINITE, STOPPED, TROUBLE
from basset.spectrum import STAYS
from basset.streaming import Plan, State
from basset.weights.lagrange import lagrange


@lru_cache(maxsize=64)
def start_tables(degree: int, kernel: Kernel) -> tuple[Floats, Floats]:
    """For nodes 1 … degree of a new segment, unit step: (∫_0^i L_j, ∫_0^i K(i−s) L_j(s) ds), each (degree, degree+1)."""
    x, w = gauss_legendre(16)
    nodes = np.arange(degree + 1.0)
    plain, history = np.zeros((degree, degree + 1)), np.zeros((degree, degree + 1))
    for i in range(1, degree + 1):
        plain[i - 1] = (i * w) @ lagrange(nodes, i * x)[0]
        share, weights = kernel.rule(0.0, float(i))
        history[i - 1] = weights @ lagrange(nodes, i * (1.0 - share))[0]
    return plain, history


def on_nodes(task: Task, dt: float, count: int) -> list[tuple[int, Segment]]:
    """(node at its end, segment) from break to break; ValueError where a break is not a node."""
    found: list[tuple[int, Segment]] = []
    for segment in segments(task):
        place = (segment.end - task.start) / dt
        node = round(place)
        if abs(place - node) > 1e-9 * max(1.0, place):
            raise ValueError(
                f"breaks must lie on the nodes of fixed steps, got {segment.end!r} between two of {dt:.6g} s: take a dt that divides "
                "its distance from the start, or Collocation"
            )
        if node > (found[-1][0] if found else 0):
            found.append((min(node, count), segment))
    return found


LOOKS = 17  # nodes of a path, its ends among them
SHORTER = "take a smaller dt, a lower degree, or Collocation"


class _Grid(Method):
    """What methods on a uniform grid share."""

    dt: float
    rule: Rule

    @property
    def _kind(self) -> int:
        return _fixed.HELD

    def _integrate(self, task: Task, trace: Trace) -> None:
        span = task.end - task.start
        count = max(1, round(min(span / self.dt, 1e18)))
        if count > task.max_steps:
            raise SolverError(f"more than max_steps = {task.max_steps} steps of {self.dt:g} s are needed")
        made = events.bound(task)
        integration = _Integration(self.rule, self._kind, task, trace, count, made.fun)
        try:
            integration.run(made.functions, made.jumps, made.calls)
        finally:
            if is_compiled(task.function):  # others are counted by the task
                task.nfev += int(integration.state.numbers[_fixed.CALLS])


def hermite(start: float, length: float, states: Floats, rates: Floats) -> Piece:
    """Cubics through the states and rates at equidistant nodes (node, state)."""
    count = len(states) - 1
    h = length / count

    def placed(theta: Floats) -> tuple[Any, Floats]:
        place = theta * count
        k = np.minimum(place.astype(np.intp), count - 1)
        return k, (place - k)[:, None]

    def values(theta: Floats) -> Floats:
        k, x = placed(theta)
        bent = h * x * (1.0 - x) * ((1.0 - x) * rates[k] - x * rates[k + 1])
        return np.asarray((1.0 + 2.0 * x) * (1.0 - x) ** 2 * states[k] + x**2 * (3.0 - 2.0 * x) * states[k + 1] + bent)

    def slopes(theta: Floats) -> Floats:
        k, x = placed(theta)
        return np.asarray(6.0 * x * (1.0 - x) / h * (states[k + 1] - states[k]) + (1.0 - x) * (1.0 - 3.0 * x) * rates[k] + x * (3.0 * x - 2.0) * rates[k + 1])

    return Piece(start, length, values, slopes)


class _Integration:
    """One integration on a uniform grid: around the compiled loop of `_fixed`, breaks and jumps of the state by events."""

    def __init__(self, rule: Rule, kind: int, task: Task, trace: Trace, count: int, fun: Any) -> None:
        n, members, span = len(task.y0), len(task.memory), task.end - task.start
        self.rule, self.kind, self.task, self.trace, self.count, self.dt = rule, kind, task, trace, count, span / count
        self.degree = degree_of(rule)
        self.limited = kind == _fixed.HELD or min(bounds(rule)) < math.inf
        assert isinstance(task.kernel, Kernel)  # others are refused
        self.kernel = task.kernel
        start = self.kernel(0.0)
        self.at_jumps = start if start < 2.0 * self.kernel(self.dt) else 0.0  # what a jump adds to H at its node, where steps see it
        self.plan: Plan = rule.plan(self.dt, span, self.kernel)
        self.samples: State = self.plan.start((members,))
        self.state = _fixed.state_of(task.y0.copy(), members, self.degree)
        self.felt = task.coefficient.copy()  # 0 for bodies at rest
        self.equation = _fixed.Equation(fun, np.zeros(1), task.memory, self.felt, task.held, -math.inf, math.inf)
        self.alone, self.signal = _fixed.room(1, n, members), np.zeros((1, 1))
        self.placed: dict[tuple[int, float, float], Any] = {}  # by how many nodes are solved together at first, and the segment
        self.record = _fixed.Record(np.empty(count), np.empty((count, n)), np.empty((count, n)))

    def run(self, functions: list[Any], jumps: list[Any], calls: Callbacks) -> None:
        """March to the end, or to what stops before."""
        task, trace, numbers, y = self.task, self.trace, self.state.numbers, self.state.y
        called, leapt = (numbers[place : place + 1] for place in (_fixed.CALLS, _fixed.LEAPT))
        ahead = on_nodes(task, self.dt, self.count)
        stop = self._turn(*ahead.pop(0))
        self._begin()
        self._check(task.start)
        values = np.array([[event.value(task.start, y) for event in task.events]] * 2)
        found, after = events.events_of(task.events, len(y), 1), np.empty_like(y)
        m = events.Motion(
            self.equation.fun, events.entries(functions), events.entries(jumps), np.zeros(1), task.memory, task.coefficient, self.felt, np.ones(1),
            np.zeros(1), np.zeros((len(self.felt), 1)), np.zeros(len(self.felt)), np.zeros(1), called, task.held, -math.inf, math.inf, task.end - task.start,
            STAYS, np.zeros((9, len(y))),
        )  # fmt: skip
        self.look, _kept = self.equation.fun, None
        if task.events:
            earlier = np.zeros(len(self.felt) if self.kind == _fixed.SLIPS else 0)
            self.look, _kept = _fixed.look_entry(_fixed.Look(m, found, self.samples.history, earlier, y, values, after, np.empty_like(y), self.dt, leapt))
        while numbers[_fixed.NODE] < self.count:
            first, before, rate = int(numbers[_fixed.NODE]), y.copy(), self.rate
            code = _fixed.steps(self._parts(stop), stop)
            self._keep(first, before, rate)
            events.take_log(found, task.events)
            if calls.raised is not None:
                raise calls.raised
            node, end = int(numbers[_fixed.NODE]), trace.times[-1]
            if code not in (END, FULL, STOPPED, AT_REST):
                raise SolverError(self._reason(code, found, end))
            broken = node == stop and bool(ahead)
            if broken:
                stop = self._turn(*ahead.pop(0))
            leapt, numbers[_fixed.LEAPT] = numbers[_fixed.LEAPT] == 1.0, 0.0
            if leapt:
                delta = after[task.memory] - y[task.memory]
                y[:] = after
                self._jump(end, delta)
                trace.times.append(end)
                trace.states.append(y.copy())
            if code in (STOPPED, AT_REST):
                trace.status = 1 if code == STOPPED else 2
                break
            if broken and not leapt:
                self._jump(end, np.zeros(len(task.memory)))
                self._check(end)
        if self.kind == _fixed.HELD:
            self._look_back()

    def _look_back(self) -> None:
        """SolverError if explicit steps stood still where fun moves, or were too long at three of some nodes: what they add need not alternate."""
        trace, wrong, done = self.trace, 0, int(self.state.numbers[_fixed.NODE])
        states, rates = self.record.states[:done], self.record.rates[:done]
        due = 0.5 * self.dt * (rates[1:] + rates[:-1])
        unmoved = (np.abs(np.diff(states, axis=0)) < 0.1 * np.abs(due)) & (np.abs(due) > 0.05 * np.ptp(states, axis=0))
        if done > 8 * IN_A_ROW and unmoved[-(done // 8) :].mean(axis=0).max() > 0.5:
            raise SolverError(f"steps of {self.dt:.3g} s settle at a state where fun is not 0 with {self.rule!r}: they are too long; {SHORTER}")
        for k in np.unique(np.linspace(0, len(trace.times) - 1, LOOKS, dtype=int))[1:]:
            try:
                self._check(trace.times[k], trace.states[k])
            except SolverError:
                wrong += 1
                if wrong == 3:
                    raise

    def _turn(self, stop: int, segment: Segment) -> int:
        """Go on in the next segment between two breaks; the node at its end."""
        self.equation = self.equation._replace(first=segment.first, last=segment.last)
        return stop

    def _parts(self, stop: int) -> Any:
        """What the loop takes steps with up to that node."""
        task, equation = self.task, self.equation
        together = max(1, min(self.degree, stop - int(self.state.numbers[_fixed.NODE]))) if self.kind != _fixed.HELD else 1
        key = together, equation.first, equation.last
        if key not in self.placed:
            plain, history = start_tables(together, self.kernel.scaled(self.dt))
            several = _fixed.room(together, len(task.y0), len(task.memory))
            weights, limited, looking = _fixed.weights_of(self.degree), int(self.limited), int(bool(task.events))
            grid = _fixed.Grid(task.start, task.end, self.dt, self.count, self.kind, weights, plain, history, limited)
            stream = _fixed.stream_of(self.plan, self.samples)
            self.placed[key] = placed(_fixed.Parts(equation, grid, stream, self.state, self.alone, several, self.record, self.look, looking, self.signal))
        return self.placed[key]

    def _keep(self, first: int, y: Floats, rate: Floats) -> None:
        """Append what was recorded from node `first` on, with states y and rates there."""
        trace, record, node = self.trace, self.record, int(self.state.numbers[_fixed.NODE])
        if node > first:
            start, states = trace.times[-1], np.concatenate([y[None], record.states[first:node]])
            trace.times.extend(record.times[first:node].tolist())
            trace.states.extend(states[1:])
            trace.pieces.append(hermite(start, trace.times[-1] - start, states, np.concatenate([rate[None], record.rates[first:node]])))
            trace.steps, self.rate = node, record.rates[node - 1]

    def _reason(self, code: int, found: events.Events, t: float) -> str:
        """Why the loop could not go on after t."""
        numbers = self.state.numbers
        if code == TROUBLE:
            return events.trouble(found)
        if code == NOT_FINITE:
            return f"fun was not finite in component {int(numbers[_fixed.WHAT])} at t = {numbers[_fixed.WHERE]:.6g}"
        if code == _fixed.DIVERGED:
            return f"steps of {self.dt:.3g} s diverge with {self.rule!r} at t = {t:.6g}: {SHORTER}"
        return f"Newton's method did not converge after t = {t:.6g}: try a smaller dt"

    def _free(self, t: float, y: Floats) -> Floats:
        """fun(t, y), from within the segment between two breaks."""
        return self.task.rate(min(max(t, self.equation.first), self.equation.last), y)

    def _check(self, t: float, y: Floats | None = None) -> None:
        """SolverError if steps are too long to be stable for what `fun` is now, or was in states y."""
        if not self.limited:
            return
        y = self.state.y if y is None else y
        held, strength = self.kind == _fixed.HELD, np.zeros(len(self.state.y))
        strength[self.task.memory] = self.felt
        here = self._free(t, y)
        for share in (1.5e-8, 1e-5):  # where fun is not smooth, the two differ
            jacobian = np.empty((len(y), len(y)))
            for j in range(len(y)):
                shifted = y.copy()
                shifted[j] += share * max(1.0, abs(y[j]))
                jacobian[:, j] = (self._free(t, shifted) - here) / (shifted[j] - y[j])
            if not np.isfinite(jacobian).all() or stable(self.rule, self.dt, self.count, jacobian, strength, held):
                return
        fastest, most = max(0.0, float(-np.linalg.eigvals(jacobian).real.min())), float(strength.max())
        longest = longest_step(self.rule, fastest, most, held)
        what = f"for rates up to {fastest:.3g} 1/s and coefficients up to {most:.3g} s^(-1/2), as at t = {t:.6g}"
        raise SolverError(f"steps of {self.dt:.3g} s diverge with {self.rule!r}: {longest:.3g} s is the longest stable one {what}; {SHORTER}")

    def _begin(self) -> None:
        """Take the first state."""
        task, state = self.task, self.state
        rate = self._free(task.start, state.y)
        rate[task.memory] -= self.felt * self.at_jumps * task.slip
        self._anew(rate)
        if self.kind == _fixed.SLIPS:
            state.offset[:] = state.y[task.memory] - task.slip
            self.plan.push(self.samples, task.slip)
        else:
            self.plan.push(self.samples, self.rate[task.memory])
            self.plan.jump(self.samples, task.slip)

    def _jump(self, t: float, delta: Floats) -> None:
        """Take the state after a jump of the memory's components at the newest node."""
        memory, state = self.task.memory, self.state
        history = self.plan.value(self.samples)
        rate = self._free(t, state.y)
        if self.kind == _fixed.SLIPS:
            state.stored[:] = history
            self.plan.jump(self.samples, np.zeros_like(delta), g=state.y[memory] - state.offset)
        else:
            rate[memory] -= self.felt * (history + self.at_jumps * delta)
            self.plan.jump(self.samples, delta, g=rate[memory])
        self._anew(rate)

    def _anew(self, rate: Floats) -> None:
        """A new segment, with that rate."""
        numbers = self.state.numbers
        self.rate = self.state.recent[0] = rate
        numbers[_fixed.KNOWN], numbers[_fixed.SEEN], numbers[_fixed.GROWN], numbers[_fixed.MATRIX] = 1.0, 0.0, 0.0, 0.0


@dataclass(frozen=True)
class FixedStep(_Grid):
    """Implicit fixed steps with any rule of `basset.SCHEMES`.

    The rates of all states are interpolated with the degree of the rule (1 for rules of first order or less) and
    integrated exactly: an Adams–Moulton step, the history entering as tail + local·(newest rate). From degree 2 on the
    first nodes of every segment are solved together with the full degree. On smooth problems the order is the rule's.

    With `input="slip"` the equation is integrated once as Daitche (2013) does, y + c∫K y = …, the rule acting on slips;
    fun itself is then interpolated, so the order is the rule's only where fun along the solution is smooth too (2.4 where it contains a term
    t^(3/2)).

    Degree 1 and the rules of lower order are stable for any drag and any history, but for `NewtonCotes`, whose newest sample has no
    weight (c√dt < 0.905); from degree 2 on rate·dt/A + c√dt/B must stay below 1: A = 6, 3, 1.8, 1.2, 0.77, 0.49, 0.31, 0.19, 0.11
    and B = 17, 2.2, 1.1, 0.54, 0.29, 0.17, 0.10, 0.060, 0.034 for
    degrees 2 to 10. A step that is unstable for `fun` at the start, and rates that alternate in sign and grow on the way, end in status −1: take
    Collocation for stiff drag. Breaks must lie on nodes. Events snap to the first node after the crossing: first order in dt at best. After a jump,
    and after an initial slip, the solution goes as √t: whatever the degree, the largest error over the path then falls as h^(1/2) with rates and as h
    with slips; from rest as h^(3/2) and h², with rates and a bounded kernel that steps resolve, K(0) < 2 K(dt), as h^(3/2).

    Parameters
    ----------
    dt : float, seconds
        Step; the nearest step that divides the time span is taken.
    rule : Rule or str
        Any rule; for "slip" a product rule.
    input : {"rate", "slip"}
        What the history samples are.

    Raises
    ------
    ValueError, TypeError
        If a parameter is out of range.

    References
    ----------
    Daitche (2013), J. Comput. Phys. 254, 93; van Hinsberg et al. (2011), J. Comput. Phys. 230, 1465.

    Examples
    --------
    >>> import basset
    >>> from basset import reference
    >>> r = basset.solve(lambda t, y: 1.0 - y, (0.0, 1.0), [0.0], coefficient=0.6, method=FixedStep(0.01, basset.Daitche(2)))
    >>> bool(abs(r.y[0, -1] - reference.settling(1.0, 1.0, 0.6, gravity=-1.0)) < 1e-3)
    True
    """

    dt: float
    rule: Rule = field(default_factory=Daitche)
    input: str = "rate"

    references: ClassVar[tuple[str, ...]] = (
        "Daitche (2013), J. Comput. Phys. 254, 93",
        "van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465",
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", _validate.positive("dt", self.dt, "seconds"))
        object.__setattr__(self, "rule", resolve(self.rule))
        _validate.choice("input", self.input, ("rate", "slip"))
        if self.input == "slip" and not whole_recipe(self.rule).degree:
            raise ValueError(f"rule must be a product rule (Daitche, Hinsberg, Windowed, Exponential) for input='slip', got {_validate.shown(self.rule)}")

    @property
    def _kind(self) -> int:
        return _fixed.RATES if self.input == "rate" else _fixed.SLIPS


@dataclass(frozen=True)
class RungeKutta4(_Grid):
    """Classical Runge–Kutta with the history held over the step, as the thesis integrates: first order in dt.

    The rate at the new node is then made consistent with the history there. Events snap to the first node after the
    crossing. A jump adds its kernel from the next node on; in the step that follows it the jump itself has no effect. Stable for
    rate·dt < 2.78, and for c√dt < B/2·(1 + R) with degrees from 2 on, R the Runge–Kutta factor (B: see FixedStep); longer
    steps, noticed at the start or on the way, end in status −1. Breaks must lie on nodes.

    Parameters
    ----------
    dt : float, seconds
        Step; the nearest step that divides the time span is taken.
    rule : Rule or str
        Any rule of `basset.SCHEMES`.

    Raises
    ------
    ValueError, TypeError
        If dt is not positive, or `rule` is not a rule.

    References
    ----------
    Moreno-Casas (2014, the thesis), section 3.3; Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513.

    Examples
    --------
    >>> import basset
    >>> from basset import reference
    >>> r = basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], coefficient=0.6, method=RungeKutta4(0.01))
    >>> bool(abs(r.y[0, -1] - reference.relaxing(1.0, 1.0, 0.6)) < 0.02)
    True
    """

    dt: float
    rule: Rule = field(default_factory=SemiDerivative)

    references: ClassVar[tuple[str, ...]] = ("Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", _validate.positive("dt", self.dt, "seconds"))
        object.__setattr__(self, "rule", resolve(self.rule))
