"""Graded collocation: high order through every jump, the past in a sum of exponentials.

After a jump the solution is a series in √(t − t_j). The first step after a jump (and the first of all) is *singular*: a
polynomial in σ = √θ, θ = (t − t_n)/h. All others are *regular*: y' is a polynomial in θ through the Radau IIA nodes. Steps
grow geometrically away from a jump, so the singularity is resolved at a geometric rate and the stages buy the digits.
Inside a step the history is integrated exactly; what happened before it is in the exponentials, whose moments over a step
are exact too, and a jump is added to them in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import lu_factor, lu_solve
from scipy.special import roots_jacobi

from basset import _validate
from basset.exponentials import ExponentialSum
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.solvers.base import REST, Event, Method, Piece, SolverError, Task, Trace, fire, first_crossing

LADDER = 8  # steps per octave of step sizes: tables are kept by rung
QUADRATURE = 48
DECAYED = 40.0  # e^(−40) is below rounding


class Nodal:
    """Polynomials on [0, 1] by their values at nodes, kept in Legendre coefficients."""

    def __init__(self, nodes: Floats) -> None:
        self.nodes = nodes
        self.degree = len(nodes) - 1
        self.coefficients = np.linalg.inv(legendre.legvander(2.0 * nodes - 1.0, self.degree))  # (degree+1, nodes)
        self._slopes = 2.0 * legendre.legder(self.coefficients) if self.degree else np.zeros((1, 1))
        self._integrals = 0.5 * legendre.legint(self.coefficients, lbnd=-1.0)

    def values(self, x: Floats) -> Floats:
        """Basis (…, nodes) at x."""
        return np.asarray(legendre.legvander(2.0 * x - 1.0, self.degree) @ self.coefficients)

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the basis (…, nodes) at x."""
        return np.asarray(legendre.legvander(2.0 * x - 1.0, len(self._slopes) - 1) @ self._slopes)

    def integrals(self, x: Floats) -> Floats:
        """Integrals of the basis from 0 to x (…, nodes)."""
        return np.asarray(legendre.legvander(2.0 * x - 1.0, len(self._integrals) - 1) @ self._integrals)


class Stages:
    """Nodes and bases for S stages."""

    def __init__(self, stages: int) -> None:
        inner = roots_jacobi(stages - 1, 1.0, 0.0)[0] if stages > 1 else np.empty(0)
        self.c = np.append((inner + 1.0) / 2.0, 1.0)  # Radau IIA
        self.regular = Nodal(self.c)
        self.singular = Nodal(np.concatenate([[0.0], np.sqrt(self.c)]))
        self.integral = self.regular.integrals(self.c)  # (stage, node)
        root = np.sqrt(self.c)
        self.slope = self.singular.slopes(root)[:, 1:] / (2.0 * root[:, None])  # d/dθ at the nodes, of y − y_n
        ends = np.concatenate([[0.0], root])  # between the nodes, where the defect of a singular step is looked at
        self.between = 0.5 * (ends[1:] + ends[:-1])
        self.width = np.diff(ends)


@lru_cache(maxsize=32)
def stages_of(count: int) -> Stages:
    """The nodes and bases, made once."""
    return Stages(count)


@lru_cache(maxsize=512)
def local_history(count: int, kernel: Kernel) -> tuple[Floats, Floats]:
    """History at the nodes of what happens inside a unit step: (regular, singular), each (stage, node).

    Regular: ∫_0^c K(c − θ) L_j(θ) dθ. Singular: ∫_0^c K(c − θ) dℓ_j(√θ), split at c/8 from the kernel's singularity.
    """
    stages = stages_of(count)
    regular = np.empty((count, count))
    for i, c in enumerate(stages.c):
        nodes, weights = kernel.rule(0.0, c)
        regular[i] = weights @ stages.regular.values(c * (1.0 - nodes))
    return regular, singular_history(stages, kernel, stages.c)


def singular_history(stages: Stages, kernel: Kernel, places: Floats) -> Floats:
    """∫_0^c K(c − θ) dℓ_j(√θ) at c in `places`: (place, node)."""
    result = np.empty((len(places), stages.singular.degree))
    x, w = gauss_legendre(QUADRATURE)
    for i, c in enumerate(places):
        near = c / 8.0
        nodes, weights = kernel.rule(0.0, near)
        sigma = np.sqrt(c - near * nodes)
        result[i] = weights @ (stages.singular.slopes(sigma) / (2.0 * sigma[:, None]))[:, 1:]
        far = math.sqrt(c - near)
        sigma = far * x
        result[i] += (far * w * kernel._values(c - sigma**2)) @ stages.singular.slopes(sigma)[:, 1:]
    return result


@lru_cache(maxsize=512)
def history_between(count: int, kernel: Kernel) -> Floats:
    """`singular_history` halfway between the nodes."""
    stages = stages_of(count)
    return singular_history(stages, kernel, stages.between**2)


class Memory:
    """The past as exponentials: rates and weights of the sum, and the tables of one step size."""

    def __init__(self, stages: Stages, kernel: Kernel, tail: ExponentialSum) -> None:
        self.stages, self.kernel, self.tail = stages, kernel, tail
        self._tables: dict[tuple[float, bool], tuple[Floats, Floats, Floats]] = {}

    def table(self, h: float, singular: bool) -> tuple[Floats, Floats, Floats]:
        """(past at the nodes (stage, term), decay (term,), moments (term, node)) of a step size."""
        key = (h, singular)
        if key not in self._tables:
            if len(self._tables) > 512:
                self._tables.clear()
            past = self.tail.weights * np.exp(-np.outer(self.stages.c * h, self.tail.rates))
            self._tables[key] = past, np.exp(-self.tail.rates * h), self.moments(h, 1.0, singular)
        return self._tables[key]

    def moments(self, h: float, theta: float, singular: bool) -> Floats:
        """∫ e^(−λ(θh − s)) dy(s) over [0, θh] for each term and node: (term, node), node values of y' or of y − y_n.

        Fast terms see only the end of the interval: its last 40 decay times are integrated there.
        """
        x, w = gauss_legendre(QUADRATURE)
        z = self.tail.rates * h * theta
        share = np.minimum(1.0, DECAYED / z)[:, None]  # of θ
        if singular:  # in σ, from where the decay begins to matter
            low = np.sqrt(np.maximum(0.0, 1.0 - share))
            width = share / (1.0 + low)  # 1 − low without cancellation
            position = 1.0 - width * x  # σ/√θ
            factor = width * w * math.sqrt(theta) * np.exp(-z[:, None] * (1.0 - position) * (1.0 + position))
            basis = self.stages.singular.slopes(position * math.sqrt(theta))[..., 1:]
        else:
            position = 1.0 - share * x
            factor = share * w * h * theta * np.exp(-z[:, None] * share * x)
            basis = self.stages.regular.values(position * theta)
        return np.asarray(np.einsum("tq,tqj->tj", factor, basis))


@dataclass(frozen=True)
class Collocation(Method):
    """Graded Radau collocation with an error that is controlled through jumps.

    Parameters
    ----------
    rtol, atol : float
        Tolerances of the local error, per component: atol + rtol·|y|. rtol 1e-12 to 0.1.
    stages : int or None
        Radau nodes per step, 2 to 14; None: chosen from rtol.
    max_step : float or None, seconds
        The largest step; None: the time span.

    Notes
    -----
    The kernel's sum of exponentials is fitted to a tenth of rtol, for lags from 1e-12 (with jumps) or 1e-9 of the time
    span on; where that cannot be had, to the best tabulated accuracy. Memory per component does not grow with time or
    with the number of jumps. Stages are solved by Newton's method: stiff drag is no obstacle.

    Raises
    ------
    ValueError, TypeError
        If a parameter is out of range.

    References: Brunner (2004), Collocation Methods for Volterra Integral and Related Functional Differential Equations
    (graded meshes); Hairer & Wanner (1996), Solving Ordinary Differential Equations II (Radau IIA).
    """

    rtol: float = 1e-6
    atol: float | None = None
    stages: int | None = None
    max_step: float | None = None

    references: ClassVar[tuple[str, ...]] = (
        "Brunner (2004), Collocation Methods for Volterra Integral and Related Functional Differential Equations",
        "Hairer & Wanner (1996), Solving Ordinary Differential Equations II",
    )

    def __post_init__(self) -> None:
        rtol = _validate.positive("rtol", self.rtol)
        if not 1e-12 <= rtol <= 0.1:
            raise ValueError(f"rtol must be from 1e-12 to 0.1, got {rtol:g}")
        object.__setattr__(self, "rtol", rtol)
        object.__setattr__(self, "atol", 1e-3 * rtol if self.atol is None else _validate.non_negative("atol", self.atol))
        if self.stages is not None:
            object.__setattr__(self, "stages", _validate.integer("stages", self.stages, 2, 14))
        if self.max_step is not None:
            object.__setattr__(self, "max_step", _validate.positive("max_step", self.max_step, "seconds"))

    def _integrate(self, task: Task, trace: Trace) -> None:
        _March(self, task, trace).run()


class _March:
    """One integration."""

    def __init__(self, method: Collocation, task: Task, trace: Trace) -> None:
        self.task, self.trace = task, trace
        digits = -math.log10(method.rtol)
        self.count = method.stages if method.stages is not None else min(12, max(3, round(2.0 + 0.75 * digits)))
        self.stages = stages_of(self.count)
        self.rtol, self.atol = method.rtol, float(method.atol or 0.0)
        self.span = task.end - task.start
        self.limit = min(method.max_step or self.span, self.span)
        active = task.coefficient > 0.0
        self.where = task.memory[active]
        self.strength = task.coefficient[active]
        self.remembers = len(self.where) > 0
        self.jump = task.slip[active]
        jumps = any(event.jump is not None for event in task.events)
        self.floor = self.span * (1e-11 if jumps else 1e-8)
        if self.remembers:
            self.memory = Memory(self.stages, task.kernel, self._sum(jumps))
            self.past = np.zeros((len(self.memory.tail), len(self.where)))
        self.t, self.y = task.start, task.y0.copy()
        self.jacobian: Floats | None = None

    def _sum(self, jumps: bool) -> ExponentialSum:
        """The kernel's sum, to a tenth of rtol or the best there is."""
        far = self.span * (1.0 + 1e-9)
        near = far * (1e-12 if jumps else 1e-9) * 1.001
        tolerance = 0.1 * self.rtol
        while True:
            try:
                return ExponentialSum.fit(near, far, tolerance, self.task.kernel)
            except ValueError:
                if tolerance > 1e-3:
                    raise
                tolerance *= 2.0

    def run(self) -> None:
        """March to the end, or to what stops before."""
        first = min(self.limit, self.span / 64.0)
        h, singular = first, self.remembers
        last_jump = self.t
        while self.t < self.task.end:
            left = self.task.end - self.t
            h = left if h >= left * (1.0 - 1e-12) else min(self._rung(min(h, self.limit)), left)
            if left - h < 0.05 * h:  # no sliver at the end
                h = left
            if h < self.floor and left > self.floor:
                raise SolverError(f"the step size fell below {self.floor:.2g} at t = {self.t:.6g}: the accuracy asked for cannot be had there")
            values, error = self._step(h, singular)
            if not error <= 1.0:
                h *= max(0.1, 0.8 * error ** (-1.0 / (0.5 * (self.count + 1) if singular else self.count))) if math.isfinite(error) else 0.25
                continue
            if self.trace.steps >= self.task.max_steps:
                raise SolverError(f"more than max_steps = {self.task.max_steps} steps at t = {self.t:.6g}")
            piece = self._piece(h, singular, values)
            cut, events = first_crossing(self.task.events, piece, self._grid(singular))
            if cut == 0.0:
                self.trace.status, self.trace.message = 2, "At rest: a jump left no flight."
                return
            self.trace.steps += 1
            theta = min(cut, 1.0)
            self._accept(piece, h, theta, singular, values)
            if singular:
                first = h
            if events:
                before = self.y
                after, stop, rest = fire(self.task, self.trace, events, self.t, before)
                if any(event.jump is not None for event in events):
                    self._jump(before, after)
                    flight = self.t - last_jump
                    last_jump = self.t
                    h, singular = min(first, 0.5 * flight), self.remembers
                    for event in events:
                        event.bounced = event.jump is not None and self._speed(event, after) * self._speed(event, before) <= 0.0
                if stop or rest:
                    self.trace.status = 1 if stop else 2
                    return
                continue
            growth = 0.9 * max(error, 1e-10) ** (-1.0 / (self.count + 1))
            h *= min(2.0, max(0.3, growth))
            if self.remembers:
                h = min(h, 2.0 * (self.t - last_jump))
            singular = False

    def _rung(self, h: float) -> float:
        """The largest kept step size not above h: span·2^(−k/LADDER)."""
        return float(self.span * 2.0 ** (-math.ceil(LADDER * math.log2(self.span / h) - 1e-9) / LADDER))

    def _grid(self, singular: bool) -> Floats:
        """Where events are looked for in a step."""
        grid = np.linspace(0.0, 1.0, 2 * self.count + 3)
        return grid**2 if singular else grid

    def _jacobian(self, y: Floats) -> Floats:
        """∂fun/∂y by forward differences at the step's start."""
        base = self.task.rate(self.t, y)
        result = np.empty((len(y), len(y)))
        for j in range(len(y)):
            step = 1.5e-8 * max(abs(y[j]), self.atol + self.rtol, 1e-8)
            shifted = y.copy()
            shifted[j] += step
            result[:, j] = (self.task.rate(self.t, shifted) - base) / (shifted[j] - y[j])
        return result

    def _step(self, h: float, singular: bool) -> tuple[Floats, float]:
        """Node values of y' (regular) or y − y_n (singular), and the error over the tolerance; (…, inf) if Newton fails."""
        for attempt in range(2):
            if self.jacobian is None or attempt:
                self.jacobian = self._jacobian(self.y)
            values, iterations = self._newton(h, singular, self.jacobian)
            if iterations > 4:
                self.jacobian = None  # of another place by now: made anew at the next step
            if values is not None:
                return values, self._error(h, singular, values)
        return np.empty(0), math.inf

    def _newton(self, h: float, singular: bool, jacobian: Floats) -> tuple[Floats | None, int]:
        stages, count, n = self.stages, self.count, len(self.y)
        times = self.t + stages.c * h
        states = np.zeros((count, n))
        lead: Floats = stages.slope / h if singular else np.eye(count)  # from the unknowns to y' at the nodes
        carry: Floats = np.eye(count) if singular else h * stages.integral  # from the unknowns to y − y_n
        matrix = np.einsum("ij,ab->iajb", lead, np.eye(n)) - np.einsum("ij,ab->iajb", carry, jacobian)
        force = np.zeros((count, n))
        if self.remembers:
            scaled = self.task.kernel.scaled(h)
            local = local_history(count, scaled)[singular] * (1.0 / math.sqrt(h) if singular else math.sqrt(h))
            past = self.memory.table(h, singular)[0] @ self.past
            if singular:
                past = past + self.task.kernel._values(stages.c * h)[:, None] * self.jump
            force[:, self.where] = self.strength * past
            coupling = np.zeros((n, n))
            coupling[self.where, self.where] = self.strength
            matrix += np.einsum("ij,ab->iajb", local, coupling)
        factors = lu_factor(matrix.reshape(count * n, count * n), check_finite=False)
        unknown = np.zeros((count, n))
        scale = self.atol + self.rtol * np.abs(self.y)
        previous = math.inf
        for iteration in range(1, 11):
            states = self.y + carry @ unknown
            rates = np.array([self.task.rate(t, state) for t, state in zip(times, states, strict=True)])
            residual = lead @ unknown + force - rates
            if self.remembers:
                residual[:, self.where] += self.strength * (local @ unknown[:, self.where])
            change = lu_solve(factors, residual.ravel(), check_finite=False).reshape(count, n)
            unknown -= change
            moved = carry @ change
            size = float(np.max(np.abs(moved) / (scale + self.rtol * np.abs(states))))
            if not math.isfinite(size):
                return None, iteration
            floor = float(np.max(4e-16 * np.abs(states) / (scale + self.rtol * np.abs(states))))
            if size <= max(1e-3, floor):
                return unknown, iteration
            if iteration > 2 and size > 0.9 * previous:
                return (unknown, iteration) if size <= max(1e-2, 10.0 * floor) else (None, iteration)
            previous = size
        return None, 10

    def _error(self, h: float, singular: bool, values: Floats) -> float:
        """Estimated local error over the tolerance, from the decay of the Legendre coefficients."""
        if singular:
            tolerance = self.atol + self.rtol * np.maximum(np.abs(self.y), np.abs(self.y + values[-1]))
            return float(np.max(self._defect(h, values) / tolerance))
        coefficients = h * np.abs(self.stages.regular.coefficients @ values)
        end = self.y + h * self.stages.integral[-1] @ values
        # parity may hide one coefficient: compare pairs
        newest, older = np.maximum(coefficients[-1], coefficients[-2]), np.max(coefficients[-4:-2], axis=0, initial=1e-300)
        decay = np.sqrt(np.minimum(1.0, newest / older))
        tail = 4.0 * decay * np.maximum(coefficients[-1], decay * coefficients[-2])  # errors add up over steps and flights
        tolerance = self.atol + self.rtol * np.maximum(np.abs(self.y), np.abs(end))
        return float(np.max(tail / tolerance))

    def _defect(self, h: float, values: Floats) -> Floats:
        """∫ |y' − fun + c·H| over a singular step, from its values halfway between the nodes (in σ), where it is largest."""
        stages, sigma = self.stages, self.stages.between
        places = sigma**2
        states = self.y + stages.singular.values(sigma)[:, 1:] @ values
        rates = np.array([self.task.rate(self.t + h * place, state) for place, state in zip(places, states, strict=True)])
        defect = stages.singular.slopes(sigma)[:, 1:] @ values / (2.0 * h * sigma[:, None]) - rates
        if self.remembers:
            local = history_between(self.count, self.task.kernel.scaled(h)) @ values[:, self.where] / math.sqrt(h)
            past = (self.memory.tail.weights * np.exp(-np.outer(places * h, self.memory.tail.rates))) @ self.past
            fresh = self.task.kernel._values(places * h)[:, None] * self.jump
            defect[:, self.where] += self.strength * (local + past + fresh)
        return np.asarray(2.0 * h * (sigma * stages.width) @ np.abs(defect))

    def _piece(self, h: float, singular: bool, values: Floats) -> Piece:
        y, stages = self.y, self.stages
        if singular:
            return Piece(self.t, h, lambda theta: y + stages.singular.values(np.sqrt(theta))[..., 1:] @ values)
        return Piece(self.t, h, lambda theta: y + h * (stages.regular.integrals(theta) @ values))

    def _accept(self, piece: Piece, h: float, theta: float, singular: bool, values: Floats) -> None:
        """Move to θ of the step: memory, state and trace."""
        if self.remembers:
            if singular:
                self.past += self.jump
                self.jump = np.zeros_like(self.jump)
            if theta == 1.0:
                _, decay, moments = self.memory.table(h, singular)
            else:
                decay, moments = np.exp(-self.memory.tail.rates * h * theta), self.memory.moments(h, theta, singular)
            self.past = decay[:, None] * self.past + moments @ values[:, self.where]
        self.y = piece.values(np.array([theta]))[0]
        end = piece.start + piece.length * theta
        if theta == 1.0 and abs(self.task.end - end) <= 1e-12 * self.span:
            end = self.task.end
        if theta < 1.0:
            whole = piece.values
            piece = Piece(piece.start, piece.length * theta, lambda share: whole(share * theta))
        self.t = end
        self.trace.pieces.append(piece)
        self.trace.times.append(self.t)
        self.trace.states.append(self.y.copy())

    def _jump(self, before: Floats, after: Floats) -> None:
        if self.remembers:
            self.jump = after[self.where] - before[self.where]
        self.y = after.copy()
        self.jacobian = None
        self.trace.times.append(self.t)
        self.trace.states.append(self.y.copy())

    def _speed(self, event: Event, y: Floats) -> float:
        """How fast the event function changes at the present time in state y."""
        ahead = 1e-3 * REST * self.span
        return event.value(self.t + ahead, y + ahead * self.task.rate(self.t, y)) - event.value(self.t, y)
