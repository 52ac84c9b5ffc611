"""Graded collocation at work: bases, tables of one step size, and the integration around the inner loop of `_march`."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import legendre

from basset._compile import Callbacks, c_function, filled, invoke, is_compiled
from basset.exponentials import ExponentialSum, _geometric, _has_geometric
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.solvers import _march, _sliding, events
from basset.solvers.base import Event, Piece, SolverError, Stretch, Task, Trace, returned, stretches

if TYPE_CHECKING:
    from basset.solvers.collocation import Collocation

QUADRATURE = 48
FINEST = 1e-10  # rtol that is kept with a sum fitted to 1e-6 only, by steps so short that the exact part covers the rest
DECAYED = 40.0  # e^(−40) is below rounding


def legendre_values(x: Floats, degree: int) -> Floats:
    """Legendre polynomials (…, degree+1) at x; at a single place without what NumPy takes to begin."""
    if x.size != 1:
        return np.asarray(legendre.legvander(x, degree))
    place = float(x.item())
    found = [1.0, place]
    for k in range(2, degree + 1):
        found.append((found[k - 1] * place * (2 * k - 1) - found[k - 2] * (k - 1)) / k)
    return np.array(found[: degree + 1]).reshape(*x.shape, degree + 1)


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
        return np.asarray(legendre_values(2.0 * x - 1.0, self.degree) @ self.coefficients)

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the basis (…, nodes) at x."""
        return np.asarray(legendre_values(2.0 * x - 1.0, len(self._slopes) - 1) @ self._slopes)

    def integrals(self, x: Floats) -> Floats:
        """Integrals of the basis from 0 to x (…, nodes)."""
        return np.asarray(legendre_values(2.0 * x - 1.0, len(self._integrals) - 1) @ self._integrals)


class Stages:
    """Nodes and bases for S stages."""

    def __init__(self, stages: int) -> None:
        from scipy.special import roots_jacobi

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


def moments(stages: Stages, rates: Floats, h: float, theta: float, singular: bool) -> Floats:
    """∫ e^(−λ(θh − s)) dy(s) over [0, θh] for each term and node: (term, node), node values of y' or of y − y_n.

    Fast terms see only the end of the interval: its last 40 decay times are integrated there.
    """
    x, w = gauss_legendre(QUADRATURE)
    z = rates * h * theta
    share = np.minimum(1.0, DECAYED / z)[:, None]  # of θ
    if singular:  # in σ, from where the decay begins to matter
        low = np.sqrt(np.maximum(0.0, 1.0 - share))
        width = share / (1.0 + low)  # 1 − low without cancellation
        position = 1.0 - width * x  # σ/√θ
        factor = width * w * math.sqrt(theta) * np.exp(-z[:, None] * (1.0 - position) * (1.0 + position))
        basis = stages.singular.slopes(position * math.sqrt(theta))[..., 1:]
    else:
        position = 1.0 - share * x
        factor = share * w * h * theta * np.exp(-z[:, None] * share * x)
        basis = stages.regular.values(position * theta)
    return np.asarray(np.einsum("tq,tqj->tj", factor, basis))


@lru_cache(maxsize=512)
def step_tables(count: int, tail: ExponentialSum, kernel: Kernel, h: float, singular: bool) -> tuple[Floats, ...]:
    """What the loop needs for one step size: past, decay, moments, local; for a singular step also kernel, between_…."""
    stages, scaled, root = stages_of(count), kernel.scaled(h), math.sqrt(h)
    past = tail.weights * np.exp(-np.outer(stages.c * h, tail.rates))
    decay, gained = np.exp(-tail.rates * h), moments(stages, tail.rates, h, 1.0, singular)
    if not singular:
        return past, decay, gained.T, root * local_history(count, scaled)[0]
    places = stages.between**2
    between = tail.weights * np.exp(-np.outer(places * h, tail.rates))
    values = kernel._values(stages.c * h), kernel._values(places * h)
    return past, decay, gained.T, local_history(count, scaled)[1] / root, *values, between, history_between(count, scaled) / root


# the shortest lag of the sum and the shortest step, in time spans: as a rule; after jumps; where something relaxes even faster
DEPTHS = ((1e-10, 1e-8), (1e-12, 1e-11), (1e-18, 1e-17), (1e-32, 1e-31))


PATIENCE = 4  # looks for a jump of fun from one place
CHATTER = 20  # jumps with the state within a millionth of the span; or twice as many that follow each other ever faster
CREEP = 24  # steps along a surface within 1e-5 of the span that do not grow: the jump is not of that kind
SLIDING = (
    "fun jumps back and forth at t = {:.6g}: the solution slides along a jump of fun, or crosses it ever faster, and cannot be followed there; "
    "make the jump continuous, such as tanh(v/ε) for sign(v), or end it by an event with a jump"
)


def _shortened(piece: Piece, share: float) -> Piece:
    """The first part of a piece."""
    return Piece(piece.start, piece.length * share, lambda theta: piece.values(theta * share))


class TooFastError(Exception):
    """What has just begun relaxes within the shortest step: to be done again with shorter ones."""


@dataclass(frozen=True)
class Approach(Stretch):
    """Up to nine tenths of the way to a jump of fun."""

    length: float = 0.0


def integrate(method: Collocation, task: Task, trace: Trace) -> None:
    """March through the time span, with sums for lags as short as it takes."""
    for depth in range(len(DEPTHS)):
        try:
            return Integration(method, task, trace, depth).run()
        except TooFastError:
            trace.times[1:], trace.states[1:], trace.pieces[:], trace.steps = [], [], [], 0
            task.release()


class Integration:
    """One integration: the tables and events around the inner loop. `depth`: for lags and steps how short, see DEPTHS."""

    def __init__(self, method: Collocation, task: Task, trace: Trace, depth: int = 0) -> None:
        self.task, self.trace = task, trace
        digits = -math.log10(method.rtol)
        self.count = count = method.stages if method.stages is not None else min(12, max(3, round(2.0 + 0.75 * digits)))
        self.stages = stages = stages_of(count)
        self.active = active = task.coefficient > 0.0
        span = task.end - task.start
        limit = min(method.max_step or span, span)
        self.stretches = stretches(task)  # the running one first
        self.approaching = False  # a jump of fun with the state, whose place is found better from nearby
        self.beyond: Floats | None = None  # y' behind it
        self.looks = (math.nan, 0)  # where, how often
        self.found: list[float] = []  # when a jump with the state was found
        self.surfaces: list[_sliding.Surface] = []  # along which the state slides
        self.thrown = False  # from one side of a jump to the other and back, and not to be held there
        self.contact: Floats | None = None  # the jump of fun on the surface ahead, if it will slide there
        stretch = self.stretches[0]
        self.problem = _march.Problem(
            stretch.end, span, limit, 0.0, method.rtol, float(method.atol or 0.0), task.max_steps, task.memory[active], task.coefficient[active],
            stretch.first, stretch.last,
        )  # fmt: skip
        self.remembers = bool(active.any())
        between = stages.between
        regular, singular = stages.regular.coefficients, stages.singular.coefficients[:, 1:]
        constants = (stages.singular.values(between)[:, 1:], stages.singular.slopes(between)[:, 1:], stages.regular.values(np.zeros(1))[0])
        arrays = (stages.c, stages.slope, stages.integral, regular, singular, between, stages.width, *constants, stages.regular._integrals)
        self.nodes = _march.Nodes(*(np.ascontiguousarray(array) for array in arrays))
        n, m = len(task.y0), int(active.sum())
        numbers = np.zeros(15)
        numbers[_march.TIME] = numbers[_march.JUMPED] = task.start
        numbers[_march.STEP] = numbers[_march.FIRST] = min(limit, span / 64.0)
        numbers[_march.SINGULAR] = float(self.remembers)
        self.state = _march.State(task.y0.copy(), np.zeros(n), np.empty((m, 0)), task.slip[active].copy(), np.zeros((n, n)), numbers)
        fading = math.pi * float(np.max(task.coefficient, initial=0.0)) ** 2 * span  # a slip fades within 1/(πc²)
        self.depth = max(depth, int(any(event.jump is not None for event in task.events) or fading > 1e5))
        closest = min(high.end - low.end for low, high in pairwise([Stretch(task.start), *self.stretches]))
        while self.remembers and 10.0 * DEPTHS[self.depth][0] * span > closest:
            self.depth += 1
            if self.depth == len(DEPTHS) or (self.depth > 1 and not _has_geometric(task.kernel)):
                raise SolverError(f"breaks {closest:.2g} s apart are too close for a span of {span:.6g} s and {task.kernel!r}")
        near, floor = DEPTHS[self.depth]
        self.problem = self.problem._replace(floor=floor * span)
        self.tail = self._sum(near * span) if self.remembers else None
        terms = len(self.tail) if self.tail else 0
        rungs = math.ceil(_march.LADDER * math.log2(1.0 / floor)) + 2
        shapes: list[tuple[int, ...]] = [(2,), (2, count, terms), (terms,), (2, count, terms), (2, count, count), (count,)]
        shapes += [(count, terms), (count, count), (count,)]
        self.tables = _march.Tables(*(np.zeros((rungs, *shape)) for shape in shapes))
        self.state = self.state._replace(past=np.zeros((m, terms)))
        self.events = events.events_of(task.events, n, 2 * count + 2)
        self.cut = _march.Cut(*gauss_legendre(QUADRATURE), DECAYED, np.zeros(count + 1))
        self.room = _march.room(count, n)
        self.values, self.record, self.signal = np.zeros((count, n)), self._record(64), np.zeros((1, 1))
        self.bound: tuple[Any, ...] | None = None  # what the march is called with, until some of it changes

    def _motion(self, fun: Any, functions: list[Any], jumps: list[Any]) -> events.Motion:
        """What the march calls, beside what it is about."""
        task, problem, state = self.task, self.problem, self.state
        weights, rates = (np.array(self.tail.weights), np.array(self.tail.rates)) if self.tail is not None else (np.empty(0), np.empty(0))
        return events.Motion(
            fun, events.entries(functions), events.entries(jumps), np.zeros(1), problem.where, task.coefficient[self.active], problem.strength,
            weights, rates, state.past, state.jump, state.numbers, task.held, problem.first, problem.last, problem.span, np.zeros((8, len(state.y))),
        )  # fmt: skip

    def _sum(self, near: float) -> ExponentialSum:
        """The kernel's sum, to a tenth of rtol or the best there is."""
        far = self.problem.span * (1.0 + 1e-9)
        tolerance = 0.1 * self.problem.rtol
        if far > 1e12 * near * 1.001:
            return _geometric(near, far, tolerance, self.task.kernel)
        while True:
            try:
                found = ExponentialSum.fit(near * 1.001, far, tolerance, self.task.kernel)
                if self.problem.rtol < FINEST and tolerance > 1e3 * self.problem.rtol:
                    sentence = "rtol must be at least {:g} with {!r}: its sum of exponentials is good to {:.1g} only, got {:g}"
                    raise SolverError(sentence.format(FINEST, self.task.kernel, tolerance, self.problem.rtol))
                return found
            except ValueError:
                if tolerance > 1e-3:
                    raise
                tolerance *= 2.0

    def _fill(self) -> None:
        """Make the tables for the step size that the loop asks for."""
        numbers, tables, kernel = self.state.numbers, self.tables, self.task.kernel
        h, slot, kind = float(numbers[_march.STEP]), int(numbers[_march.SLOT]), int(numbers[_march.SINGULAR])
        tables.sizes[slot] = np.where(np.arange(2) == kind, h, np.where(tables.sizes[slot] == h, h, 0.0))
        if self.tail is None:
            return
        past, decay, gained, local, *singular = step_tables(self.count, self.tail, kernel, h, bool(kind))
        tables.past[slot, kind], tables.decay[slot], tables.moments[slot, kind], tables.local[slot, kind] = past, decay, gained, local
        if kind:
            tables.kernel[slot], tables.between_kernel[slot], tables.between_past[slot], tables.between_local[slot] = singular

    def run(self) -> None:
        """March to the end, or to what stops before."""
        task = self.task
        n, calls = len(task.y0), Callbacks()
        with ExitStack() as stack:

            def entry(function: Any, checked: Any, results: int, number: bool = False) -> Any:
                if is_compiled(function) and task.data is not None:
                    try:
                        return stack.enter_context(c_function(function, task.data, n, number))
                    except TypeError:  # an argument that is no data: a compiled fun cannot do without, events can
                        if function is task.function:
                            raise
                return calls.entry(checked, n, results)

            if is_compiled(task.function):
                task.rate(task.start, task.y0)  # shape and type are checked here: compiled code does not
                stack.callback(self._count)
            functions = [self._checked(event, entry(event.function, event.value, 1, True)) for event in task.events]
            jumps = [entry(event.jump, event.after, n) for event in task.events]
            self.free = self._motion(entry(task.function, task.free, n), functions, jumps)
            self.sliding = self._motion(calls.entry(self._rate, n, n), [], [])
            self.plain = self._motion(partial(filled, self._rate), *events.plain(task.events))
            while self._advance(calls):
                pass

    def _advance(self, calls: Callbacks) -> bool:
        """March on until something has to be done, and do it; False at the end."""
        if self.bound is None:
            self.bound = self._bind()
        if self.surfaces:
            calls_before = float(self.state.numbers[_march.CALLS])  # the task counts by itself
            try:
                code, done = self._along()
            finally:
                self.state.numbers[_march.CALLS] = calls_before
        else:
            code, done = _march.march(*self.bound)
        self._keep(done)
        if self.surfaces and code == _march.FULL and done:
            self._fit()
        if calls.raised is not None:
            raise calls.raised
        if code == _march.TABLE:
            self._fill()
        elif code == _march.END:
            return self._turn()
        elif code in (_march.STOPPED, _march.LYING):
            self.trace.status = 1 if code == _march.STOPPED else 2
            return False
        elif code == _march.SUSPECT:
            self._look()
        elif code == _march.TOO_SMALL:
            if not (self._look() or self._crosses()):
                if self._fades():
                    raise TooFastError
                raise SolverError(self._reason(code))
        elif code != _march.FULL:
            raise SolverError(self._reason(code))
        return True

    def _bind(self) -> tuple[Any, ...]:
        """The arguments of the march for the running stretch."""
        problem, found = self.problem, self.events
        m = (self.sliding if self.surfaces else self.free)._replace(first=problem.first, last=problem.last)
        common = problem, self.nodes
        attempt, first = _march.attempt_entry(_march.Attempt(m, *common, self.tables, self.state, self.values, self.room))
        watch, second = attempt, None
        watching = bool(self.task.events) and not self.surfaces
        if watching:
            watch, second = _march.watch_entry(_march.Watch(m, found, *common, self.cut, self.state, self.values, self.room, self.record))
        self.kept = first, second
        most = len(found.log_times) // 2
        return attempt, watch, watching, *common, self.tables, self.state, self.values, found.logged, most, self.record, self.signal

    def _along(self) -> tuple[int, int]:
        """One step along the surfaces, up to where the state leaves one; as `_march.march`."""
        assert self.bound is not None
        state, numbers, found, record = self.state, self.state.numbers, self.events, self.record
        m = self.plain._replace(first=self.problem.first, last=self.problem.last)
        invoke(self.bound[0], 0.0, self.signal[0], self.signal[0], self.signal[0])
        code, done = int(self.signal[0, 0]), 0
        if code == _march.ACCEPTED:
            code, h, kind, start = _march.FULL, float(numbers[_march.STEP]), int(numbers[_march.SINGULAR]), float(numbers[_march.TIME])
            share, surface = self._leaves(self._piece(start, h, bool(kind), state.y.copy(), self.values.copy()))
            if surface is not None and h * share <= 4.0 * math.ulp(start):
                self._leave(surface)
                return code, 0
            _march.fit_polynomial(self.nodes, kind, h, self.values, self.room.polynomial)
            theta, done = events.first_crossing(m, found, events.Step(start, h, kind, state.y, self.room.polynomial), share), 1
            if theta > 1.0 and surface is None:
                _march.accept(self.problem, self.nodes, self.tables, state, self.values, record, 0)
                record.share[0], record.leapt[0] = 1.0, 0.0
            else:
                if theta > 1.0:
                    found.count[0], theta = 0, share
                status = _march.to_event(m, found, self.problem, self.nodes, self.cut, state, self.values, self.room, record, 0, theta)
                code = {events.PASSED: _march.FULL, events.TERMINAL: _march.STOPPED, events.RESTING: _march.LYING}[status]
                if record.leapt[0]:
                    t = float(numbers[_march.TIME])
                    self._set_surfaces([] if state.jump.any() else [surface for surface in self.surfaces if surface.holds(self.task.rate, t, state.y)])
                    numbers[_march.SINGULAR] = float(self.remembers and not self.surfaces)
                elif surface is not None:
                    self._leave(surface)
        return code, done

    def _count(self) -> None:
        """Add what compiled code has evaluated."""
        self.task.nfev += int(self.state.numbers[_march.CALLS])

    def _set_surfaces(self, surfaces: list[_sliding.Surface]) -> None:
        """The state slides along these from here."""
        self.surfaces, self.bound = surfaces, None

    def _checked(self, event: Event, entry: Any) -> Any:
        """The entry of an event function, which with its jump gives what it should: compiled code does not look."""
        task = self.task
        if is_compiled(event.function):
            event.value(task.start, task.y0)
        if event.jump is not None and is_compiled(event.jump):
            n = len(task.y0)
            returned(f"jump of event {event.index} must return {n} states", event.jump(task.start, task.y0.copy(), *event.args), n)
        return entry

    def _rate(self, t: float, y: Floats) -> Floats:
        """The rate without history, on a surface that the state slides along a mean of both sides."""
        return _sliding.mean(self.surfaces, self.task.rate, t, y) if self.surfaces else self.task.rate(t, y)

    def _fades(self) -> bool:
        """Whether what needs steps below the floor has just begun, and a deeper sum can be had."""
        numbers, deeper = self.state.numbers, self.depth + 1
        if deeper == len(DEPTHS) or numbers[_march.TIME] - numbers[_march.JUMPED] > 1e4 * self.problem.floor:
            return False
        if not self.remembers or _has_geometric(self.task.kernel):
            return True
        try:
            ExponentialSum.fit(DEPTHS[deeper][0] * 1.001 * self.problem.span, self.problem.span, 1e-3, self.task.kernel)
        except ValueError:
            return False
        return True

    def _turn(self) -> bool:
        """Go on beyond the end of the running stretch; False at the end of the last."""
        done = self.stretches.pop(0)
        if not self.stretches:
            return False
        numbers, stretch = self.state.numbers, self.stretches[0]
        self.problem, self.bound = self.problem._replace(end=stretch.end, first=stretch.first, last=stretch.last), None
        if self.approaching:
            self.approaching = False
            numbers[_march.TRIED] = 0.3 * done.length if isinstance(done, Approach) else 0.0
            self._look()
            return True
        contact, self.contact = self.contact, None
        if contact is not None and self._slide(contact):
            self.beyond = None
            return True
        self._begin(0.5 * (stretch.end - float(numbers[_march.TIME])))
        if self.beyond is not None:  # differences across the jump are no derivatives
            h = float(numbers[_march.STEP])
            place = self.state.y + 1e-4 * h * self.beyond
            here, t = self.task.rate(float(numbers[_march.TIME]), place), float(numbers[_march.TIME])
            for j in range(len(place)):
                shifted = place.copy()
                shifted[j] += 1e-5 * h * abs(self.beyond[j]) + 1.5e-8 * max(abs(place[j]) if self.beyond[j] == 0.0 else 0.0, 1e-8)
                self.state.jacobian[:, j] = (self.task.rate(t, shifted) - here) / (shifted[j] - place[j])
            numbers[_march.KNOWN], self.beyond = 1.0, None
        return True

    def _begin(self, most: float) -> None:
        """Start anew here: fun goes on otherwise, the state does not jump."""
        numbers = self.state.numbers
        numbers[_march.SMOOTH] = numbers[_march.KNOWN] = numbers[_march.REFUSED] = 0.0
        numbers[_march.SINGULAR] = float(self.remembers and not self.surfaces)
        numbers[_march.JUMPED] = numbers[_march.TIME]
        numbers[_march.STEP] = min(float(numbers[_march.FIRST]), most)

    def _near(self, sizes: Floats) -> Floats:
        """How far the state may be from a surface that it was to reach: the error of a step, or what rates of `sizes` move in the shortest one."""
        y = np.abs(self.state.y)
        before = np.abs(self.trace.pieces[-1].values(np.zeros(1))[0]) if self.trace.pieces else y
        return np.asarray(10.0 * (self.problem.atol + self.problem.rtol * np.maximum(y, before)) + 4.0 * self.problem.floor * sizes)

    def _surface(self, jump: Floats) -> _sliding.Surface:
        """The layer around a surface on which fun has that jump, for the tolerance here."""
        y, some = np.abs(self.state.y), jump != 0.0
        least = np.maximum(64.0 * np.spacing(y), 1e-6 * self.problem.floor * np.abs(jump))
        widths = np.maximum(_sliding.WIDTH * (self.problem.atol + self.problem.rtol * y), least)
        return _sliding.Surface(float((widths[some] / np.abs(jump[some])).min()) * jump, jump)

    def _slide(self, jump: Floats) -> bool:
        """Go on along the surface on which fun has that jump; False if it is not near enough or fun does not jump."""
        state, t, surface = self.state, float(self.state.numbers[_march.TIME]), self._surface(jump)
        if state.jump.any():  # a singular step would not see the layer
            return False
        found = surface.located(self._rate, t, state.y)
        if found is None or (np.abs(found[0] * surface.half) > self._near(np.abs(jump))).any():
            return False
        self._chatter(t)
        state.y[:] += found[0] * surface.half
        self._set_surfaces([*self.surfaces, surface])
        self._begin(0.5 * (self.stretches[0].end - t))
        return True

    def _crosses(self) -> bool:
        """Whether fun jumps right ahead: go on along the surface if it throws the state back, behind it otherwise."""
        t, y, memory, floor = float(self.state.numbers[_march.TIME]), self.state.y, np.zeros(len(self.state.y)), self.problem.floor
        memory[self.task.memory] = np.where(self.task.held[self.task.memory], 0.0, self.task.coefficient) * self._memory(t)
        try:
            velocity = self._rate(t, y) - memory
            start = y if velocity.any() else y + 1e-2 * (self.problem.atol + self.problem.rtol * np.abs(y))  # sign(0): beside it
            jump, back = _sliding.swings(lambda time, place: self._rate(time, place) - memory, t, start, 2.0 * floor)
            if back or not (jump.any() and velocity.any()):
                self.thrown = back and not self._slide(jump)
                return back and not self.thrown
            found = _sliding.Surface(floor * velocity, jump).located(self._rate, t, y)
            if found is None or found[0] < 0.0 or ((found[0] + 1.0) * floor * np.abs(velocity) > self._near(np.abs(velocity))).any():
                return False
        except SolverError:  # fun is not finite there
            return False
        self._chatter(t)
        y[:] += (found[0] + 1.0) * floor * velocity
        self._begin(0.5 * (self.stretches[0].end - t))
        return True

    def _fit(self) -> None:
        """Give the layers widths for the tolerance here, the weights of both sides stay; SolverError where the slide creeps."""
        if not self.surfaces:
            return
        pieces = self.trace.pieces[-CREEP:]
        since, newest = pieces[0].start, pieces[-1]
        short = newest.end - since < 1e-5 * self.problem.span and newest.length < 2.0 * pieces[0].length
        if len(pieces) == CREEP and short and since >= self.state.numbers[_march.JUMPED]:
            raise SolverError(SLIDING.format(since))
        for k, old in enumerate(self.surfaces):
            new = self._surface(old.jump)
            found = old.located(self.task.rate, float(self.state.numbers[_march.TIME]), self.state.y)
            if found is not None and not 0.25 < np.abs(new.half).max() / np.abs(old.half).max() < 4.0:
                self.state.y[:] += found[0] * (old.half - new.half)
                self.surfaces[k], self.state.numbers[_march.KNOWN] = new, 0.0

    def _leaves(self, piece: Piece) -> tuple[float, _sliding.Surface | None]:
        """(θ, surface) where the state first leaves one that it slides along; (1, None) if it does not."""

        def left(theta: float) -> _sliding.Surface | None:
            t, y = piece.start + theta * piece.length, piece.values(np.array([theta]))[0]
            return next((surface for surface in self.surfaces if not surface.holds(self.task.rate, t, y)), None)

        low = 0.0
        for node in self.stages.c if self.surfaces else ():
            high, surface = float(node), left(float(node))
            if surface is None:
                low = high
                continue
            while high - low > 1e-12:
                middle = 0.5 * (low + high)
                found = left(middle)
                low, high, surface = (middle, high, surface) if found is None else (low, middle, found)
            return high, surface
        return 1.0, None

    def _chatter(self, t: float) -> None:
        """Note that a jump with the state was found at t; SolverError if there are too many."""
        self.found.append(t)
        last = np.array(self.found[-2 * CHATTER :])
        narrowing = len(last) == 2 * CHATTER and t - last[0] < 1e-2 * self.problem.span and bool((np.diff(last[2:] - last[:-2]) < 0.0).all())
        if narrowing or (len(last) > CHATTER and t - last[-CHATTER] < 1e-6 * self.problem.span):
            raise SolverError(SLIDING.format(t))

    def _look(self) -> bool:
        """Look for a jump of fun in what was tried last; if there is one, end the stretch there: whether it was found."""
        state, numbers, problem = self.state, self.state.numbers, self.problem
        t, window = float(numbers[_march.TIME]), float(min(numbers[_march.TRIED], problem.end - numbers[_march.TIME]))
        self.looks = (t, self.looks[1] + 1 if self.looks[0] == t else 1)
        if numbers[_march.SMOOTH] == 0.0 or not self.trace.pieces or window <= 0.0 or self.looks[1] > PATIENCE:
            return False
        piece, y, slope = self.trace.pieces[-1], state.y.copy(), state.rate.copy()
        scale = np.maximum(problem.atol + problem.rtol * np.abs(y), 1e-300)

        def ahead(time: float) -> Floats:
            share = (time - t) / piece.length
            return np.asarray(piece.values(np.array([1.0 + share]))[0] if share <= 0.25 else y + (time - t) * slope)

        def rates(time: float, place: Floats) -> Floats:
            return self._rate(min(max(time, problem.first), problem.last), place)

        def apart(one: Floats, other: Floats) -> float:
            return float((np.abs(one - other) / scale).max())

        try:
            times = np.minimum(t + window * np.linspace(0.0, 1.0, 13), problem.end)
            found = [rates(time, ahead(time)) for time in times]
            gaps = [apart(found[k], found[k + 1]) for k in range(12)]
            k = int(np.argmax(gaps))
            low, high, before, after, earlier = float(times[k]), float(times[k + 1]), found[k], found[k + 1], gaps[k]
            for count in range(1, 1100):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                new = rates(middle, ahead(middle))
                if apart(before, new) >= apart(new, after):
                    high, after = middle, new
                else:
                    low, before = middle, new
                if count in (8, 16):  # what is smooth halves each time
                    if count == 16 and apart(before, after) <= 0.25 * earlier:
                        return False
                    earlier = apart(before, after)
            jump = apart(before, after)
            if not jump * window > 0.1:  # harmless
                return False
            place = ahead(high)
            in_time = apart(rates(low, place), rates(high, place)) > 0.5 * jump
            behind = slope + after - before
            onward = rates(high, place + max(0.01 * (high - t), 64.0 * math.ulp(high)) * behind)
            back = apart(onward, before) < apart(onward, after)
        except SolverError:  # fun is not finite there
            return False
        rest = self.stretches[0]
        if in_time:
            self.stretches[:1] = [Stretch(high, rest.first, low), Stretch(rest.end, high, rest.last)]
        elif high - t > 0.25 * piece.length:
            self.approaching = True
            self.stretches[:1] = [Approach(t + 0.9 * (high - t), rest.first, rest.last, length=high - t), rest]
        else:
            self._chatter(t)
            self.beyond, self.contact = behind, after - before if back else None
            self.stretches[:1] = [Stretch(high, rest.first, rest.last), Stretch(rest.end, rest.first, rest.last)]
        stretch = self.stretches[0]
        self.problem, self.bound = problem._replace(end=stretch.end, last=stretch.last), None
        numbers[_march.STEP] = max(float(numbers[_march.STEP]), 0.5 * float(numbers[_march.TRIED]))
        return True

    def _reason(self, code: int) -> str:
        numbers, t = self.state.numbers, self.state.numbers[_march.TIME]
        if code == _march.TOO_MANY:
            return f"more than max_steps = {self.task.max_steps} steps at t = {t:.6g}"
        if code == _march.TROUBLE and self.events.trouble[0] != events.FUN_FAILED:
            what = "event" if self.events.trouble[0] == events.EVENT_FAILED else "jump of event"
            return f"{what} {self.events.trouble[1]} was not finite at t = {self.events.trouble_at[0]:.6g}"
        if code == _march.TROUBLE:
            return f"fun was not finite in component {self.events.trouble[1]} at t = {self.events.trouble_at[0]:.6g}"
        if code == _march.NOT_FINITE:
            return f"fun was not finite in component {int(numbers[_march.WHAT])} at t = {numbers[_march.WHERE]:.6g}"
        if self.thrown or self.surfaces or (self.found and self.found[-1] > t - 1e-6 * self.problem.span):
            return SLIDING.format(t)
        return f"the step size fell below {self.problem.floor:.2g} at t = {t:.6g}: the accuracy asked for cannot be had there"

    def _record(self, steps: int) -> _march.Record:
        n = len(self.state.y)
        shapes: list[Any] = [steps, steps, steps, steps, (steps, n), (steps, self.count, n), steps, (steps, n), (steps, n)]
        return _march.Record(*(np.zeros(shape) for shape in shapes))

    def _keep(self, done: int) -> None:
        """Append recorded steps and events to the trace."""
        trace, record = self.trace, self.record
        ends = [*record.start[1:done].tolist(), float(self.state.numbers[_march.TIME])]
        after = [*record.y[1:done].copy(), self.state.y.copy()]
        for k in range(done):
            share, leapt = float(record.share[k]), bool(record.leapt[k])
            if share > 0.0:  # else a contact that left no flight
                piece = self._piece(float(record.start[k]), float(record.size[k]), bool(record.kind[k]), record.y[k].copy(), record.values[k].copy())
                trace.pieces.append(piece if share == 1.0 else _shortened(piece, share))
                trace.times.append(ends[k])
                trace.states.append(record.before[k].copy() if leapt else after[k])
            if leapt:
                trace.times.append(ends[k])
                trace.states.append(record.after[k].copy())
        trace.steps += done
        events.take_log(self.events, self.task.events)

    def _piece(self, start: float, h: float, singular: bool, y: Floats, values: Floats) -> Piece:
        stages = self.stages
        if singular:
            return Piece(start, h, lambda theta: y + stages.singular.values(np.sqrt(theta))[..., 1:] @ values)
        return Piece(start, h, lambda theta: y + h * (stages.regular.integrals(theta) @ values))

    def _leave(self, surface: _sliding.Surface) -> None:
        """Go on from here beside the surface, with a Jacobian of that side: differences must not reach over."""
        state, t = self.state, float(self.state.numbers[_march.TIME])
        found = surface.located(self.task.rate, t, state.y)
        self._set_surfaces([other for other in self.surfaces if other is not surface])
        self._begin(0.5 * (self.stretches[0].end - t))
        if found is None:
            return
        shifts = 1.5e-8 * np.maximum(np.abs(state.y), 1e-8)
        away = -math.copysign(1.0, found[0]) * surface.half
        place = state.y + away * float(16.0 * shifts.max() / np.abs(away).max())
        here = self._rate(t, place)
        for j, shift in enumerate(shifts):
            shifted = place.copy()
            shifted[j] += shift
            state.jacobian[:, j] = (self._rate(t, shifted) - here) / (shifted[j] - place[j])
        state.numbers[_march.KNOWN] = 1.0

    def _memory(self, t: float) -> Floats:
        """H of the components in memory at t, had nothing happened since the step's start."""
        result = np.zeros(len(self.task.memory))
        if self.tail is not None:
            lag = t - float(self.state.numbers[_march.TIME])
            result[self.active] = (self.state.past + self.state.jump[:, None]) @ (self.tail.weights * np.exp(-self.tail.rates * lag))
        return result
