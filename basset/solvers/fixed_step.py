"""Fixed steps with any rule: the history split into tail + local·(newest sample), implicit in the newest sample."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np

from basset import _validate
from basset._compile import filled
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.quadrature import Daitche, Rule, SemiDerivative
from basset.quadrature.base import resolve
from basset.quadrature.product import lagrange
from basset.solvers import events
from basset.solvers.base import Method, Piece, SolverError, Stretch, Task, Trace, stretches
from basset.solvers.stability import ALTERNATING, IN_A_ROW, SHARE, adams_moulton, bounds, degree_of, longest_step, stable
from basset.spectrum import STAYS
from basset.streaming import Plan, State


@lru_cache(maxsize=64)
def start_tables(degree: int, kernel: Kernel) -> tuple[Floats, Floats]:
    """For nodes 1 … degree of a fresh stretch, unit step: (∫_0^i L_j, ∫_0^i K(i−s) L_j(s) ds), each (degree, degree+1)."""
    x, w = gauss_legendre(16)
    nodes = np.arange(degree + 1.0)
    plain, history = np.zeros((degree, degree + 1)), np.zeros((degree, degree + 1))
    for i in range(1, degree + 1):
        plain[i - 1] = (i * w) @ lagrange(nodes, i * x)[0]
        share, weights = kernel.rule(0.0, float(i))
        history[i - 1] = weights @ lagrange(nodes, i * (1.0 - share))[0]
    return plain, history


def newton(residual: Callable[[Floats], Floats], guess: Floats, where: str) -> Floats:
    """Root of `residual` by Newton's method with a finite-difference Jacobian, kept while it converges."""
    x = guess.copy()
    value = residual(x)
    jacobian = None
    for _ in range(50):
        if jacobian is None:
            jacobian = np.empty((len(x), len(x)))
            for j in range(len(x)):
                step = 1.5e-8 * max(1.0, abs(x[j]))
                shifted = x.copy()
                shifted[j] += step
                jacobian[:, j] = (residual(shifted) - value) / (shifted[j] - x[j])
        change = np.linalg.solve(jacobian, value)
        x -= change
        before, value = np.abs(value).max(), residual(x)
        if np.abs(change).max() <= 1e-14 * max(1.0, np.abs(x).max()) or not value.any():
            return x
        if np.abs(value).max() > 0.1 * before:
            if np.abs(change).max() <= 1e-12 * max(1.0, np.abs(x).max()):
                return x
            jacobian = None
    raise SolverError(f"the step's equation did not converge {where}: try a smaller dt")


def on_nodes(task: Task, dt: float, count: int) -> list[tuple[int, Stretch]]:
    """(node at its end, stretch) from break to break; ValueError where a break is not a node."""
    found: list[tuple[int, Stretch]] = []
    for stretch in stretches(task):
        place = (stretch.end - task.start) / dt
        node = round(place)
        if abs(place - node) > 1e-9 * max(1.0, place):
            raise ValueError(
                f"breaks must lie on the nodes of fixed steps, got {stretch.end!r} between two of {dt:.6g} s: take a dt that divides "
                "its distance from the start, or Collocation"
            )
        if node > (found[-1][0] if found else 0):
            found.append((min(node, count), stretch))
    return found


class Watch:
    """Looks at the newest rates: an unstable step makes them alternate in sign and grow."""

    def __init__(self) -> None:
        self.rates: list[Floats] = []
        self.last: Floats = np.empty(0)
        self.grown = 0

    def see(self, rate: Floats, t: float, run: _March) -> None:
        """Take the rate of the newest node; SolverError if steps diverge."""
        if not run.limited:
            return
        self.rates = [*self.rates[-4:], rate]
        if len(self.rates) < 5:
            return
        now = ALTERNATING @ self.rates
        if len(self.last):
            largest = int(np.abs(now).argmax())
            grows = now[largest] * self.last[largest] < 0.0 and abs(now[largest]) >= abs(self.last[largest])
            self.grown = self.grown + 1 if grows else 0
            if self.grown >= IN_A_ROW and abs(now[largest]) > SHARE * max(abs(rates[largest]) for rates in self.rates):
                raise SolverError(f"steps of {run.dt:.3g} s diverge with {run.rule!r} at t = {t:.6g}: {SHORTER}")
        self.last = now


SHORTER = "take a smaller dt, a lower degree, or Collocation"


class _Grid(Method):
    """What methods on a uniform grid share: the march from node to node, events at nodes, the dense output."""

    dt: float

    def _integrate(self, task: Task, trace: Trace) -> None:
        span = task.end - task.start
        count = max(1, round(span / self.dt))
        if count > task.max_steps:
            raise SolverError(f"more than max_steps = {task.max_steps} steps of {self.dt:g} s are needed")
        run = self._march(task, span / count)
        ahead = on_nodes(task, run.dt, count)
        stop, run.stretch = ahead.pop(0)
        node, watch = 0, Watch()
        y, rate = task.y0.copy(), run.begin(task.start, task.y0.copy(), task.slip)
        run.check(task.start, y)
        m, found = self._events(task)
        values = [events.value(m, found, k, task.start, y) for k in range(len(task.events))]
        after_jump, still = np.empty_like(y), np.empty_like(y)
        while node < count:
            states, rates = run.advance(task.start + node * run.dt, y, stop - node)
            for state, after in zip(states, rates, strict=True):
                t, end = task.start + node * run.dt, task.start + (node + 1) * run.dt if node + 1 < count else task.end
                trace.pieces.append(hermite(t, end - t, y, state, rate, after))
                before, values = values, [events.value(m, found, k, end, state) for k in range(len(task.events))]
                fired = [k for k, (old, new) in enumerate(zip(before, values, strict=True)) if happens(found, k, old, new)]
                y, rate, node = state, after, node + 1
                trace.steps += 1
                trace.times.append(end)
                trace.states.append(y.copy())
                watch.see(after, end, run)
                broken = node == stop and bool(ahead)
                if broken:
                    stop, run.stretch = ahead.pop(0)
                if fired:
                    found.fired[: len(fired)], found.count[0] = fired, len(fired)
                    leaps = bool(found.leaps[fired].any())
                    m.past[:, 0] = run.memory()
                    status = events.fire(m, found, end, y, after_jump, still, 1.5 * run.dt)
                    events.take_log(found, task.events)
                    if leaps:
                        run.retract(node + 1 - run.nodes)
                        rate = run.jump(end, after_jump.copy(), after_jump[task.memory] - y[task.memory])
                        y, watch, broken = after_jump.copy(), Watch(), False
                        trace.times.append(end)
                        trace.states.append(y.copy())
                        values = [events.value(m, found, k, end, y) for k in range(len(task.events))]
                    if status != events.PASSED:
                        trace.status = 1 if status == events.TERMINAL else 2
                        return
                    if leaps:
                        break
                if broken:
                    rate, watch = run.jump(end, y, np.zeros(len(task.memory))), Watch()
                    run.check(end, y)

    @staticmethod
    def _events(task: Task) -> tuple[events.Motion, events.Events]:
        """Events as they stand at the start; the memory of the newest node goes into the single term of `past`."""
        n, members = len(task.y0), len(task.memory)
        felt, one, past = task.coefficient.copy(), np.ones(1), np.zeros((members, 1))
        m = events.Motion(
            partial(filled, task.free), *events.plain(task.events), np.zeros(1), task.memory, task.coefficient, felt, one, np.zeros(1), past, np.zeros(members),
            np.zeros(15), task.held, -math.inf, math.inf, task.end - task.start, STAYS, np.zeros((9, n)),
        )  # fmt: skip
        return m, events.events_of(task.events, n, 1)

    @abc.abstractmethod
    def _march(self, task: Task, dt: float) -> _March:
        """The method at work on one task."""


def happens(found: events.Events, k: int, before: float, after: float) -> bool:
    """Whether an event happens on a step between these values; after a jump from when the body is back on its side, or sinks."""
    side = found.side[k]
    if found.bounced[k] and not found.resting[k]:
        found.reach[k] = max(found.reach[k], after * side)
        if found.fresh[k]:
            found.fresh[k] = after * side <= 0.0
            return bool(found.fresh[k] and (after - before) * side < 0.0)
    found.fresh[k] = False
    if not events.crosses(found, k, before, after):
        return False
    if not found.resting[k]:
        found.side[k] = math.copysign(1.0, before)
    return True


def hermite(start: float, length: float, y0: Floats, y1: Floats, r0: Floats, r1: Floats) -> Piece:
    """Cubic through the states and rates at both ends of a step."""

    def values(theta: Floats) -> Floats:
        x = theta[:, None]
        return np.asarray((1.0 + 2.0 * x) * (1.0 - x) ** 2 * y0 + x**2 * (3.0 - 2.0 * x) * y1 + length * x * (1.0 - x) * ((1.0 - x) * r0 - x * r1))

    return Piece(start, length, values)


class _March(abc.ABC):
    """A method on a uniform grid at work: the stream of the memory components and the newest samples."""

    held = False  # whether the history of a step's beginning acts all through it

    def __init__(self, task: Task, dt: float, rule: Rule) -> None:
        self.task, self.dt, self.rule = task, dt, rule
        self.degree, self.steps = degree_of(rule), max(1, round((task.end - task.start) / dt))
        self.strength = np.zeros(len(task.y0))
        self.strength[task.memory] = task.coefficient
        self.limited = self.held or min(bounds(rule)) < math.inf
        self.stretch = Stretch(task.end)
        self.plan: Plan = rule.plan(dt, task.end - task.start, task.kernel)
        self.state: State = self.plan.start((len(task.memory),))
        self.nodes = 0
        self._kept: list[State] = []

    @property
    def felt(self) -> Floats:
        """The coefficient, 0 for bodies at rest."""
        task = self.task
        return np.where(task.held[task.memory], 0.0, task.coefficient) if task.held.any() else task.coefficient

    def rate(self, t: float, y: Floats) -> Floats:
        """fun(t, y), from within the stretch between two breaks."""
        return self.task.rate(min(max(t, self.stretch.first), self.stretch.last), y)

    def check(self, t: float, y: Floats) -> None:
        """SolverError if steps are too long to be stable for what `fun` is at (t, y)."""
        if not self.limited:
            return
        here = self.rate(t, y)
        for share in (1.5e-8, 1e-5):  # where fun is not smooth, the two differ
            jacobian = np.empty((len(y), len(y)))
            for j in range(len(y)):
                shifted = y.copy()
                shifted[j] += share * max(1.0, abs(y[j]))
                jacobian[:, j] = (self.rate(t, shifted) - here) / (shifted[j] - y[j])
            if not np.isfinite(jacobian).all() or stable(self.rule, self.dt, self.steps, jacobian, self.strength, self.held):
                return
        fastest, most = max(0.0, float(-np.linalg.eigvals(jacobian).real.min())), float(self.strength.max())
        longest = longest_step(self.rule, fastest, most, self.held)
        what = f"for rates up to {fastest:.3g} 1/s and coefficients up to {most:.3g} s^(-1/2), as at t = {t:.6g}"
        raise SolverError(f"steps of {self.dt:.3g} s diverge with {self.rule!r}: {longest:.3g} s is the longest stable one {what}; {SHORTER}")

    @abc.abstractmethod
    def begin(self, t: float, y: Floats, slip: Floats) -> Floats:
        """Take the first state; the rate there."""

    @abc.abstractmethod
    def advance(self, t: float, y: Floats, left: int) -> tuple[list[Floats], list[Floats]]:
        """States and rates at the next node, or at the next few when they are solved together."""

    @abc.abstractmethod
    def jump(self, t: float, y: Floats, delta: Floats) -> Floats:
        """Take the state after a jump at the newest node; the rate there."""

    def memory(self) -> Floats:
        """H of the components in memory at the newest node."""
        return np.asarray(self.plan.value(self.state))

    def retract(self, excess: int) -> None:
        """Take back nodes that were solved together but lie beyond an event (excess < 0)."""
        if excess < 0:
            self.state = self._kept[len(self._kept) + excess - 1]
            self.nodes += excess

    def push(self, samples: Floats) -> None:
        """Stream samples (count, memory), keeping the states for `retract`."""
        self._kept = []
        for sample in samples:
            self.plan.push(self.state, sample)
            self.nodes += 1
            if len(samples) > 1:
                self._kept.append(State(*(array.copy() for array in self.state)))

    def past(self, count: int) -> Floats:
        """H at the next `count` nodes of what came before the running stretch (count, memory)."""
        probe = State(*(array.copy() for array in self.state))
        probe.samples[...] = 0.0
        return np.asarray(self.plan.run(probe, np.zeros((count, len(self.task.memory)))))


@dataclass(frozen=True)
class FixedStep(_Grid):
    """Implicit fixed steps with any rule of `basset.SCHEMES`.

    The rates of all states are interpolated with the degree of the rule (1 for rules of first order or less) and
    integrated exactly: an Adams–Moulton step, the history entering as tail + local·(newest rate). From degree 2 on the
    first nodes of every stretch are solved together with the full degree. On smooth problems the order is the rule's.

    With `input="slip"` the equation is integrated once as Daitche (2013) does, y + c∫K y = …, the rule acting on slips;
    fun itself is then interpolated, so the order is the rule's only where fun along the solution is smooth too (2.4 where
    it holds a t^(3/2)).

    Degree 1 and the rules of lower order are stable for any drag and any history; from degree 2 on rate·dt/A + c√dt/B must stay
    below 1: A = 6, 3, 1.8, 1.2, 0.77, 0.49, 0.31, 0.19, 0.11 and B = 17, 2.2, 1.1, 0.54, 0.29, 0.17, 0.10, 0.060, 0.034 for
    degrees 2 to 10. A step that is too long for what `fun` is at the start, and rates that alternate and grow on the way, end
    in status −1: take Collocation for stiff drag. Breaks must lie on nodes. Events snap to the first node after the crossing:
    first order in dt at best. After a jump, and after an initial slip, the solution goes as √t: whatever the degree, the
    largest error over the path then falls as h^(1/2) with rates and as h with slips; from rest as h^(3/2) and h².

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
        if self.input == "slip" and not isinstance(self.rule._remembered, Daitche):
            raise ValueError(f"rule must be a product rule (Daitche, Hinsberg, Windowed, Exponential) for input='slip', got {_validate.shown(self.rule)}")

    def _march(self, task: Task, dt: float) -> _March:
        return (_OnRates if self.input == "rate" else _OnSlips)(task, dt, self.rule)


class _OnRates(_March):
    """Samples are rates: g = fun − c·H."""

    def __init__(self, task: Task, dt: float, rule: Rule) -> None:
        super().__init__(task, dt, rule)
        self.recent: list[Floats] = []  # rates of all states, newest first

    def begin(self, t: float, y: Floats, slip: Floats) -> Floats:
        rate = self.rate(t, y)
        self.push(rate[None, self.task.memory])
        self.plan.jump(self.state, slip)
        self.recent = [rate]
        return rate

    def jump(self, t: float, y: Floats, delta: Floats) -> Floats:
        self.strength[self.task.memory] = self.felt
        rate = self.rate(t, y)
        rate[self.task.memory] -= self.felt * self.plan.value(self.state)
        self.plan.jump(self.state, delta, g=rate[self.task.memory])
        self.recent = [rate]
        return rate

    def advance(self, t: float, y: Floats, left: int) -> tuple[list[Floats], list[Floats]]:
        if len(self.recent) == 1 and self.degree > 1 and left > 1:
            return self._together(t, y, min(self.degree, left))
        task, end = self.task, t + self.dt
        tail, local = self.plan.tail(self.state), self.plan.local(self.state)
        weights = adams_moulton(min(self.degree, len(self.recent)))
        known = y + self.dt * sum((w * r for w, r in zip(weights[1:], self.recent, strict=False)), np.zeros(len(y)))
        fixed = np.zeros(len(y))
        fixed[task.memory] = self.felt * tail
        rate = newton(
            lambda g: g * (1.0 + self.strength * local) + fixed - self.rate(end, known + self.dt * weights[0] * g), self.recent[0], f"at t = {end:.6g}"
        )
        self.push(rate[None, task.memory])
        self.recent = [rate, *self.recent[: self.degree - 1]]
        return [known + self.dt * weights[0] * rate], [rate]

    def _together(self, t: float, y: Floats, degree: int) -> tuple[list[Floats], list[Floats]]:
        task, n = self.task, len(y)
        plain, history = start_tables(degree, task.kernel.scaled(self.dt))
        first, past = self.recent[0], self.past(degree)
        times = t + self.dt * np.arange(1, degree + 1)
        root = math.sqrt(self.dt)

        def states(rates: Floats) -> Floats:
            return np.asarray(y + self.dt * (plain @ np.vstack([first, rates])))

        def residual(flat: Floats) -> Floats:
            rates = flat.reshape(degree, n)
            result = rates - np.array([self.rate(time, state) for time, state in zip(times, states(rates), strict=True)])
            memory = past + root * (history @ np.vstack([first, rates])[:, task.memory])
            result[:, task.memory] += self.felt * memory
            return np.asarray(result.ravel())

        rates = newton(residual, np.tile(first, degree), f"from t = {t:.6g}").reshape(degree, n)
        self.push(rates[:, task.memory])
        self.recent = [*rates[::-1], first][: self.degree]
        return list(states(rates)), list(rates)


class _OnSlips(_March):
    """Samples are slips: y(t) + c∫K y = y(0) + c·0 + ∫fun, the history integral itself being streamed."""

    def __init__(self, task: Task, dt: float, rule: Rule) -> None:
        super().__init__(task, dt, rule)
        self.recent: list[Floats] = []  # fun of all states, newest first
        self.offset = np.zeros(len(task.memory))
        self.stored = np.zeros(len(task.memory))  # c∫K y at the newest node

    def begin(self, t: float, y: Floats, slip: Floats) -> Floats:
        self.offset = y[self.task.memory] - slip
        self.push(slip[None])
        self.recent = [self.rate(t, y)]
        return self.recent[0]

    def jump(self, t: float, y: Floats, delta: Floats) -> Floats:
        self.stored = self.felt * self.plan.value(self.state)
        self.plan.jump(self.state, np.zeros_like(delta), g=y[self.task.memory] - self.offset)
        self.recent = [self.rate(t, y)]
        return self.recent[0]

    def advance(self, t: float, y: Floats, left: int) -> tuple[list[Floats], list[Floats]]:
        task, n = self.task, len(y)
        together = len(self.recent) == 1 and self.degree > 1 and left > 1
        count = min(self.degree, left) if together else 1
        times = t + self.dt * np.arange(1, count + 1)
        if together:
            plain, history = start_tables(count, task.kernel.scaled(self.dt))
            past = self.past(count) + math.sqrt(self.dt) * np.outer(history[:, 0], y[task.memory] - self.offset)
            inner = math.sqrt(self.dt) * history[:, 1:]
            known = y + self.dt * np.outer(plain[:, 0], self.recent[0])
            ahead = self.dt * plain[:, 1:]
        else:
            weights = adams_moulton(min(self.degree, len(self.recent)))
            past, inner = np.atleast_2d(self.plan.tail(self.state)), np.array([[self.plan.local(self.state)]])
            known = (y + self.dt * sum((w * r for w, r in zip(weights[1:], self.recent, strict=False)), np.zeros(n)))[None]
            ahead = np.array([[self.dt * weights[0]]])
        functions = np.zeros((count, n))

        def residual(flat: Floats) -> Floats:
            states = flat.reshape(count, n)
            functions[:] = [self.rate(time, state) for time, state in zip(times, states, strict=True)]
            result = states - known - ahead @ functions
            result[:, task.memory] += self.felt * (past + inner @ (states[:, task.memory] - self.offset)) - self.stored
            return np.asarray(result.ravel())

        states = newton(residual, np.tile(y, count), f"from t = {t:.6g}").reshape(count, n)
        residual(states.ravel())
        self.push(states[:, task.memory] - self.offset)
        self.stored = self.felt * self.plan.value(self.state)
        self.recent = [*(row.copy() for row in functions[::-1]), *self.recent][: self.degree]
        return list(states), list(np.diff(np.vstack([y, states]), axis=0) / self.dt)  # for the dense output: fun lacks the history

    def retract(self, excess: int) -> None:
        super().retract(excess)
        self.stored = self.felt * self.plan.value(self.state)


@dataclass(frozen=True)
class RungeKutta4(_Grid):
    """Classical Runge–Kutta with the history held over the step, as the thesis integrates: first order in dt.

    The rate at the new node is then made consistent with the history there. Events snap to the first node after the
    crossing. A jump adds its kernel from the next node on; in the step that follows it the jump itself is not felt. Stable for
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
        If a parameter is out of range.

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

    def _march(self, task: Task, dt: float) -> _March:
        return _Held(task, dt, self.rule)


class _Held(_OnRates):
    """Explicit: the history of the step's beginning acts all through it."""

    held = True

    def advance(self, t: float, y: Floats, left: int) -> tuple[list[Floats], list[Floats]]:
        task, h = self.task, self.dt
        held = np.zeros(len(y))
        held[task.memory] = self.felt * self.plan.value(self.state)

        def rate(time: float, state: Floats) -> Floats:
            return self.rate(time, state) - held

        k1 = rate(t, y)
        k2 = rate(t + 0.5 * h, y + 0.5 * h * k1)
        k3 = rate(t + 0.5 * h, y + 0.5 * h * k2)
        k4 = rate(t + h, y + h * k3)
        after = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        fixed = np.zeros(len(y))
        fixed[task.memory] = self.felt * self.plan.tail(self.state)
        new = (self.rate(t + h, after) - fixed) / (1.0 + self.strength * self.plan.local(self.state))
        self.push(new[None, task.memory])
        return [after], [new]
