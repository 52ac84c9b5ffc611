"""One integration by graded collocation: set-up, tables, breaks and jumps of `fun` around the compiled loop `stepper.march`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from basset._compile import filled, invoke, is_compiled, placed
from basset.exponentials import ExponentialSum, _geometric, _has_geometric
from basset.kernels import BassetKernel, Floats, Kernel, VaryingSlipKernel
from basset.solvers import _sliding, events, stepper
from basset.solvers._tables import DECAYED, QUADRATURE, following, stages_of, tables_of
from basset.solvers.base import Piece, Segment, SolverError, Task, Trace, segments
from basset.spectrum import STAYS

FINEST = 1e-10  # rtol that is kept with a sum fitted to 1e-6 only, by steps so short that the exact part covers the rest
# the shortest lag of the sum and the shortest step, in time spans: as a rule; after jumps; where something relaxes even faster
DEPTHS = ((1e-10, 1e-8), (1e-12, 1e-11), (1e-18, 1e-17), (1e-32, 1e-31))


FOLLOWING = 4.0  # factor on the error estimate of singular steps: with a kernel that follows the slip the solution has powers of √t outside the polynomial
REFUSED = 12.0  # shortest steps: one that is refused by less may be followed by a tenth of it
PATIENCE = 4  # searches for a jump of fun from one place
CHATTER = 20  # jumps with the state within a millionth of the span; or twice as many that follow each other ever faster
SHORT = 0.5  # tolerances between the end of the step that comes to a surface and the surface
CREEP = 24  # steps that do not grow: back and forth over a jump of fun; along a surface within 1e-5 of the span: the jump is not of that kind
SLIDING = (
    "fun switches back and forth at t = {:.6g}: the solution slides along a discontinuity of fun, or crosses it at ever shorter intervals, "
    "and cannot be followed there; make fun continuous, such as tanh(v/ε) for sign(v), or stop there by an event with a jump"
)


def _shortened(piece: Piece, share: float) -> Piece:
    """The first part of a piece."""
    met = None if piece.met is None else piece.met / math.sqrt(share)
    return Piece(piece.start, piece.length * share, lambda theta: piece.values(theta * share), lambda theta: piece.slopes(theta * share), met)


fitted = lru_cache(maxsize=64)(ExponentialSum.fit)


def nodes(record: stepper.Record, first: int, last: int, time: float, y: Floats) -> tuple[Floats, Floats]:
    """Times and states (time, state) at the ends of recorded steps, the last at `time`; where the state jumped, before and after."""
    flown = np.flatnonzero(record.share[first:last] > 0.0)
    leapt = np.flatnonzero(record.leapt[first:last])
    ends = np.append(record.start[first + 1 : last], time)
    reached = np.concatenate([record.y[first + 1 : last], y[None]])
    reached[leapt] = record.before[first:last][leapt]
    order = np.concatenate([2 * flown, 2 * leapt + 1]).argsort(kind="stable")
    return np.concatenate([ends[flown], ends[leapt]])[order], np.concatenate([reached[flown], record.after[first:last][leapt]])[order]


class TooFastError(Exception):
    """The solution relaxes within the shortest step: repeat with shorter ones."""


@dataclass(frozen=True)
class Approach(Segment):
    """Up to nine tenths of the way to a jump of fun."""

    length: float = 0.0


def integrate(method: Any, task: Task, trace: Trace) -> None:
    """March through the time span, with sums for lags as short as it takes; `method` has rtol, atol, stages and max_step."""
    for depth in range(len(DEPTHS)):
        try:
            return Integration(method, task, trace, depth).run()
        except TooFastError:
            trace.times[1:], trace.states[1:], trace.pieces[:], trace.steps = [], [], [], 0
            task.release()


class Integration:
    """One integration: the tables and events around the inner loop. `depth`: for lags and steps how short, see DEPTHS."""

    def __init__(self, method: Any, task: Task, trace: Trace, depth: int = 0) -> None:
        self.task, self.trace = task, trace
        digits = -math.log10(method.rtol)
        self.count = count = method.stages if method.stages is not None else min(12, max(3, round(2.0 + 0.75 * digits)))
        self.stages = stages_of(count)
        self.varying = task.kernel if isinstance(task.kernel, VaryingSlipKernel) else None
        self.active = active = self._active(task)
        self.kernel: Kernel = task.kernel if isinstance(task.kernel, Kernel) else BassetKernel()
        span = task.end - task.start
        limit = min(method.max_step or span, span)
        self.segments = segments(task)  # the current one first
        self.approaching = False  # a jump of fun with the state, whose place is found better from nearby
        self.beyond: Floats | None = None  # y' behind it
        self.looks = (math.nan, 0)  # where, how often
        self.found: list[float] = []  # when a jump with the state was found
        self.surfaces: list[_sliding.Surface] = []  # along which the state slides
        self.thrown = False  # from one side of a jump to the other and back, and not to be held there
        self.contact: Floats | None = None  # the jump of fun on the surface ahead, if it will slide there
        segment = self.segments[0]
        self.problem = stepper.Problem(
            segment.end, span, limit, 0.0, method.rtol, float(method.atol or 0.0), task.max_steps, task.memory[active], task.coefficient[active],
            segment.first, segment.last,
        )  # fmt: skip
        self.remembers = bool(active.any())
        n, m = len(task.y0), int(active.sum())
        control = stepper.start_control(task.start, min(limit, span / 64.0), self.remembers)
        self.state = stepper.State(task.y0.copy(), np.zeros(n), np.empty((m, 0)), task.slip[active].copy(), np.zeros((n, n)), control)
        self.depth = max(depth, self._least_depth(task))
        closest = min(high.end - low.end for low, high in pairwise([Segment(task.start), *self.segments]))
        while self.remembers and 10.0 * DEPTHS[self.depth][0] * span > closest:
            self.depth += 1
            if self.depth == len(DEPTHS) or (self.depth > 1 and not self._deepens):
                raise SolverError(f"breaks {closest:.2g} s apart are too close for a span of {span:.6g} s and {task.kernel!r}")
        near, floor = DEPTHS[self.depth]
        if self.varying is not None:  # the sum reaches ten times as far, and is none of those that reach any lag
            near, floor = max(near, 1.01e-11), max(floor, 1e-10)
        self.problem = self.problem._replace(floor=floor * span)
        self.tail = self._sum(near * span) if self.remembers else None
        self.tables = tables_of(count, self.tail, self.kernel, floor * span, span)
        self.following = STAYS
        if self.varying is not None and self.tail is not None:
            v = self.varying
            self.following = following(count, self.tail, (v.c1, v.c2), v.diameter / v.viscosity, 1.0 / v.viscosity, v.slip_range, span)
            self.problem = self.problem._replace(singular_factor=FOLLOWING)
        self.odd = self.tables.odd()
        self.state = self.state._replace(past=np.zeros((m, len(self.tail) if self.tail else 0)))
        self.events = events.events_of(task.events, n, 2 * count + 2)
        rates = np.array(self.tail.rates) if self.tail is not None else np.empty(0)
        self.truncation = stepper.truncation_of(rates, QUADRATURE, DECAYED, count)
        self.work = stepper.workspace(count, n)
        self.values, self.record = np.zeros((count, n)), self.record_of(64)
        self.bound: tuple[Any, ...] | None = None  # arguments of `march`, None when they have changed
        made = events.bound(task)
        self.calls, self.arguments = made.calls, made.arguments
        self.free = self._motion(made.fun, made.functions, made.jumps)

    @cached_property
    def sliding(self) -> events.Motion:
        """The rate on a surface, without events."""
        return self._motion(self.calls.entry(self._rate, *[len(self.state.y)] * 2), [], [])

    @cached_property
    def plain(self) -> events.Motion:
        """The same, with events, for plain Python."""
        return self._motion(partial(filled, self._rate), *events.plain(self.task.events))

    def _motion(self, fun: Any, functions: list[Any], jumps: list[Any]) -> events.Motion:
        """The functions that the compiled loop calls, with the arrays that events need."""
        task, problem, state = self.task, self.problem, self.state
        weights, rates = (np.array(self.tail.weights), np.array(self.tail.rates)) if self.tail is not None else (np.empty(0), np.empty(0))
        return events.Motion(
            fun, events.entries(functions), events.entries(jumps), np.zeros(1), problem.where, task.coefficient[self.active], problem.strength,
            weights, rates, state.past, state.jump, state.control["time"], state.control["calls"],
            task.held, problem.first, problem.last, problem.span, self.following, np.zeros((9, len(state.y))),
        )  # fmt: skip

    def _active(self, task: Task) -> Any:
        """Which members feel a history; a kernel that follows the slip needs all of them."""
        return task.coefficient > 0.0 if self.varying is None else np.repeat((task.coefficient > 0.0).any(), len(task.memory))

    def _least_depth(self, task: Task) -> int:
        """The least depth for jumps, or for a slip that fades within 1/(πc²)."""
        strongest = float(np.max(task.coefficient, initial=0.0))
        fading = math.pi * strongest * strongest * (task.end - task.start)
        return int(any(event.jump is not None for event in task.events) or fading > 1e5)

    def serves(self, task: Task) -> bool:
        """Whether another task that differs by numbers alone can use the set-up made for this one."""
        return self._least_depth(task) == self.depth and bool((self._active(task) == self.active).all())

    @property
    def _deepens(self) -> bool:
        """Whether there are sums for lags however short."""
        return self.varying is None and _has_geometric(self.kernel)

    def _sum(self, near: float) -> ExponentialSum:
        """The kernel's sum, to a tenth of rtol or the best there is."""
        far = self.problem.span * (1.0 + 1e-9) * (1.0 if self.varying is None else 10.0)  # for weights that follow the slip, see basset.spectrum
        tolerance = 0.1 * self.problem.rtol
        if far > 1e12 * near * 1.001:
            return _geometric(near, far, tolerance, self.kernel)
        while True:
            try:
                found = fitted(near * 1.001, far, tolerance, self.kernel)
                if self.problem.rtol < FINEST and tolerance > 1e3 * self.problem.rtol:
                    sentence = "rtol must be at least {:g} with {!r}: its sum of exponentials is accurate to {:.1g} only, got {:g}"
                    raise SolverError(sentence.format(FINEST, self.kernel, tolerance, self.problem.rtol))
                return found
            except ValueError:
                if tolerance > 1e-3:
                    raise
                tolerance *= 2.0

    def run(self) -> None:
        """March to the end, or to what stops before."""
        if is_compiled(self.task.function):
            self.task.rate(self.task.start, self.task.y0)  # shape and type are checked here: compiled code does not
        try:
            while self._advance():
                pass
        finally:
            if is_compiled(self.task.function):
                self.task.nfev += int(self.state.control[0].calls)

    def _advance(self) -> bool:
        """March on until something has to be done, and do it; False at the end."""
        if self.bound is None:
            self.bound = self.bind()
        if self.surfaces:
            calls_before = int(self.state.control[0].calls)  # the task counts by itself
            try:
                code, done = self._along()
            finally:
                self.state.control[0].calls = calls_before
        else:
            code, done = stepper.march(*self.bound[1])
        self._keep(done)
        if code == stepper.FULL and done:
            if self.surfaces:
                self._fit()
            elif self.state.control[0].refusals > 0.2 and self._creeps():  # one of the last two steps was too long at first
                self._crosses(max(piece.length for piece in self.trace.pieces[-CREEP:]), False)
        if self.calls.raised is not None:
            raise self.calls.raised
        if code == stepper.TABLE:
            self.tables.fill(self.odd, self.state.control[0])
        elif code == stepper.END:
            return self._turn()
        elif code in (stepper.STOPPED, stepper.AT_REST):
            self.trace.status = 1 if code == stepper.STOPPED else 2
            return False
        elif code == stepper.SUSPECT:
            self._look()
        elif code == stepper.TOO_SMALL:
            if not (self._look() or self._crosses(2.0 * self.problem.floor, True)):
                if self._fades():
                    raise TooFastError
                raise SolverError(self._reason(code))
        elif code != stepper.FULL:
            raise SolverError(self._reason(code))
        return True

    def bind(self) -> tuple[Any, ...]:
        """The parts of a step, and the arguments of the march, for the current segment."""
        problem, found, work = self.problem, self.events, self.work
        m = (self.sliding if self.surfaces else self.free)._replace(first=problem.first, last=problem.last)
        equation = stepper.Equation(m.fun, m.own, m.held)
        tables = self.tables
        parts = placed(stepper.Parts(equation, problem, *tables.placed, self.odd, tables.unit, self.state, self.values, self.following, self.truncation, work))
        solve, first = stepper.fully_entry(parts)
        attempt, second = stepper.attempt_entry(stepper.Attempt(parts, solve))
        watch, third = attempt, None
        watching = bool(self.task.events) and not self.surfaces
        if watching:
            watch, third = stepper.watch_entry(stepper.Watch(m, found, parts, self.record))
        self.kept = first, second, third
        most = len(found.log_times) // 2
        return parts, (attempt, watch, watching, parts, found.logged, most, placed(self.record), True)

    def _along(self) -> tuple[int, int]:
        """One step along the surfaces, up to where the state leaves one; as `stepper.march`."""
        assert self.bound is not None
        state, control, found, record = self.state, self.state.control[0], self.events, self.record
        m = self.plain._replace(first=self.problem.first, last=self.problem.last)
        parts, (attempt, *_) = self.bound
        signal = self.work.signal[0]
        invoke(attempt, 0.0, signal, signal, signal)
        code, done = int(signal[0]), 0
        if code == stepper.ACCEPTED:
            code, h, kind, start = stepper.FULL, float(control.step), int(control.singular), float(control.time)
            share, surface = self._leaves(self._piece(start, h, bool(kind), state.y.copy(), self.values.copy()))
            if surface is not None and h * share <= 4.0 * math.ulp(start):
                self._leave(surface)
                return code, 0
            stepper.fit_polynomial(parts.nodes, kind, h, self.values, self.work.polynomial)
            theta, done = events.first_crossing(m, found, events.Step(start, h, kind, state.y, self.work.polynomial), share), 1
            if theta > 1.0 and surface is None:
                stepper.keep(parts, record, 0, 1.0)
                stepper.accept(parts)
            else:
                if theta > 1.0:
                    found.count[0], theta = 0, share
                status = stepper.to_event(m, found, parts, record, 0, theta)
                code = {events.PASSED: stepper.FULL, events.TERMINAL: stepper.STOPPED, events.RESTING: stepper.AT_REST}[status]
                if record.leapt[0]:
                    t = float(control.time)
                    self._set_surfaces([] if state.jump.any() else [surface for surface in self.surfaces if surface.holds(self._one_side, t, state.y)])
                    control.singular = self.remembers and not self.surfaces
                elif surface is not None:
                    self._leave(surface)
        return code, done

    def _set_surfaces(self, surfaces: list[_sliding.Surface]) -> None:
        """The state slides along these from here."""
        self.surfaces, self.bound = surfaces, None

    def _rate(self, t: float, y: Floats) -> Floats:
        """The rate without history, on a surface that the state slides along a mean of both sides."""
        return _sliding.mean(self.surfaces, self._one_side, t, y) if self.surfaces else self._one_side(t, y)

    def _one_side(self, t: float, y: Floats) -> Floats:
        """The rate without history as `fun` gives it, from within the current segment."""
        return self.task.rate(min(max(t, self.problem.first), self.problem.last), y)

    def _pull(self, t: float) -> Floats:
        """The history's part of the rates, had nothing happened since the step's start."""
        result = np.zeros(len(self.state.y))
        events.subtract_memory(self.free, t, self.state.y, self.free.felt, result)
        return result

    def _fades(self) -> bool:
        """Whether what needs steps below the floor has just begun, and a deeper sum can be had."""
        control, deeper = self.state.control[0], self.depth + 1
        if deeper == len(DEPTHS) or control.time - control.last_jump > 1e4 * self.problem.floor:
            return False
        if not self.remembers or self._deepens:
            return True
        if self.varying is not None:
            return deeper == 1
        try:
            ExponentialSum.fit(DEPTHS[deeper][0] * 1.001 * self.problem.span, self.problem.span, 1e-3, self.kernel)
        except ValueError:
            return False
        return True

    def _turn(self) -> bool:
        """Go on beyond the end of the current segment; False at the end of the last."""
        done = self.segments.pop(0)
        if not self.segments:
            return False
        control, segment = self.state.control[0], self.segments[0]
        self.problem, self.bound = self.problem._replace(end=segment.end, first=segment.first, last=segment.last), None
        if self.approaching:
            self.approaching = False
            control.tried = 0.3 * done.length if isinstance(done, Approach) else 0.0
            self._look()
            return True
        contact, self.contact = self.contact, None
        if contact is not None and self._slide(contact):
            self.beyond = None
            return True
        self._begin(0.5 * (segment.end - float(control.time)))
        if self.beyond is not None:  # differences across the jump are no derivatives
            h = float(control.step)
            place = self.state.y + 1e-4 * h * self.beyond
            least = np.maximum(np.where(self.beyond == 0.0, np.abs(place), 0.0), 1e-8)
            self._differentiate(self._one_side, place, 1e-5 * h * np.abs(self.beyond) + 1.5e-8 * least)
            self.beyond = None
        return True

    def _begin(self, most: float) -> None:
        """Start anew here: fun changes, the state does not jump."""
        control = self.state.control[0]
        if self.surfaces:  # else the way to where it stays counts as an error of the step
            t = float(control.time)
            self.state.y[:] = _sliding.balanced(self.surfaces, self._one_side, self._pull(t), t, self.state.y)
        control.smooth, control.jacobian_known, control.refusals, control.previous_step = False, False, 0.0, 0.0
        control.singular = self.remembers and not self.surfaces
        control.last_jump = control.time
        control.step = min(float(control.first_step), most)

    def _near(self, sizes: Floats) -> Floats:
        """How far the state may be from a surface that it was to reach: the error of a step, or what rates of `sizes` move in the shortest one."""
        y = np.abs(self.state.y)
        before = np.abs(self.trace.pieces[-1].values(np.zeros(1))[0]) if self.trace.pieces else y
        return np.asarray(10.0 * (self.problem.atol + self.problem.rtol * np.maximum(y, before)) + REFUSED * self.problem.floor * sizes)

    def _surface(self, jump: Floats) -> _sliding.Surface:
        """The layer around a surface on which fun has that jump, for the tolerance here."""
        y, some = np.abs(self.state.y), jump != 0.0
        least = np.maximum(64.0 * np.spacing(y), 1e-6 * self.problem.floor * np.abs(jump))
        widths = np.maximum(_sliding.WIDTH * (self.problem.atol + self.problem.rtol * y), least)
        return _sliding.Surface(float((widths[some] / np.abs(jump[some])).min()) * jump, jump)

    def _slide(self, jump: Floats) -> bool:
        """Go on along the surface on which fun has that jump; False if it is not near enough or fun does not jump."""
        state, t, surface = self.state, float(self.state.control[0].time), self._surface(jump)
        if state.jump.any():  # a singular step would not see the layer
            return False
        found = surface.located(self._rate, t, state.y)
        if found is None or (np.abs(found[0] * surface.half) > self._near(np.abs(jump))).any():
            return False
        self._chatter(t)
        state.y[:] += found[0] * surface.half
        self._set_surfaces([*self.surfaces, surface])
        self._begin(0.5 * (self.segments[0].end - t))
        return True

    def _creeps(self) -> bool:
        """Whether the last steps do not grow, short of a jump of fun that was found ahead."""
        pieces = self.trace.pieces[-CREEP:]
        if len(pieces) < CREEP or self.approaching or self.beyond is not None:
            return False
        return bool(pieces[0].start >= self.state.control[0].last_jump and pieces[-1].length < 2.0 * pieces[0].length)

    def _crosses(self, step: float, onward: bool) -> bool:
        """Whether fun jumps within some such steps: go on along the surface if it throws the state back, `onward` behind it otherwise."""
        t, y, floor = float(self.state.control[0].time), self.state.y, self.problem.floor
        pull = self._pull(t)
        try:
            velocity = self._rate(t, y) + pull
            start = y if velocity.any() else y + 1e-2 * (self.problem.atol + self.problem.rtol * np.abs(y))  # sign(0): beside it
            places = [found and found[0] for found in (surface.located(self._one_side, t, start) for surface in self.surfaces)]

            def kept(state: Floats) -> Floats:
                for surface, place in zip(self.surfaces, places, strict=True):
                    found = surface.located(self._one_side, t, state)
                    if found is not None and place is not None:
                        state = state + (found[0] - place) * surface.half
                return state

            jump, back = _sliding.swings(lambda time, place: self._rate(time, place) + pull, t, start, step, kept)
            if not back:
                if not (onward and jump.any() and velocity.any()):
                    return False
                found = _sliding.Surface(floor * velocity, jump).located(self._rate, t, y)
                if found is None or found[0] < 0.0:
                    return False
                moved = (found[0] + 1.0) * floor * velocity
                if (np.abs(moved) > self._near(np.abs(velocity))).any():
                    return False
        except SolverError:  # fun is not finite there
            return False
        if back:
            slides = self._slide(jump)
            self.thrown = onward and not slides
            return slides
        self._chatter(t)
        y[:] += moved
        self._begin(0.5 * (self.segments[0].end - t))
        return True

    def _fit(self) -> None:
        """Give the layers widths for the tolerance here, the weights of both sides stay; SolverError where the slide creeps."""
        if not self.surfaces:
            return
        pieces = self.trace.pieces[-CREEP:]
        since = pieces[0].start
        if self._creeps() and pieces[-1].end - since < 1e-5 * self.problem.span:
            raise SolverError(SLIDING.format(since))
        for k, old in enumerate(self.surfaces):
            new = self._surface(old.jump)
            found = old.located(self._one_side, float(self.state.control[0].time), self.state.y)
            if found is not None and not 0.25 < np.abs(new.half).max() / np.abs(old.half).max() < 4.0:
                self.state.y[:] += found[0] * (old.half - new.half)
                self.surfaces[k], self.state.control[0].jacobian_known = new, False

    def _leaves(self, piece: Piece) -> tuple[float, _sliding.Surface | None]:
        """(θ, surface) where the state first leaves one that it slides along; (1, None) if it does not."""

        def places(theta: float) -> Floats:
            t, y = piece.start + theta * piece.length, piece.values(np.array([theta]))[0]
            found = [surface.located(self._one_side, t, y) for surface in self.surfaces]
            return np.array([math.inf if place is None else place[0] for place in found])

        def inside(place: Floats) -> bool:
            return bool((np.abs(place) <= 1.0).all())

        if not self.surfaces:
            return 1.0, None
        nodes, seen = [0.0], [places(0.0)]
        for node in self.stages.c:
            nodes.append(float(node))
            seen.append(places(node))
            if not inside(seen[-1]):
                break
        suspects = np.empty(0)
        if np.isfinite(seen).all():  # one that leaves and comes back between two nodes has left
            grid = np.linspace(0.0, nodes[-1], 8 * len(nodes))
            curves = [np.polynomial.Chebyshev.fit(nodes, place, len(nodes) - 1, [0.0, 1.0])(grid) for place in np.transpose(seen)]
            suspects = grid[(np.abs(curves) > 1.0).any(axis=0)]
        low = 0.0
        for suspect in np.unique([*suspects, nodes[-1]]).tolist():
            high, beyond = suspect, places(suspect)
            if inside(beyond):
                low = high
                continue
            while high - low > 1e-12:
                middle = 0.5 * (low + high)
                found = places(middle)
                low, high, beyond = (middle, high, beyond) if inside(found) else (low, middle, found)
            return high, self.surfaces[int(np.argmax(np.abs(beyond) > 1.0))]
        return 1.0, None

    def _chatter(self, t: float) -> None:
        """Note that a jump with the state was found at t; SolverError if there are too many."""
        self.found.append(t)
        last = np.array(self.found[-2 * CHATTER :])
        narrowing = len(last) == 2 * CHATTER and t - last[0] < 1e-2 * self.problem.span and bool((np.diff(last[2:] - last[:-2]) < 0.0).all())
        if narrowing or (len(last) > CHATTER and t - last[-CHATTER] < 1e-6 * self.problem.span):
            raise SolverError(SLIDING.format(t))

    def _look(self) -> bool:
        """Look for a jump of fun in what was tried last; if there is one, end the segment there: whether it was found."""
        state, control, problem = self.state, self.state.control[0], self.problem
        t, window = float(control.time), float(min(control.tried, problem.end - control.time))
        self.looks = (t, self.looks[1] + 1 if self.looks[0] == t else 1)
        if not control.smooth or not self.trace.pieces or window <= 0.0 or self.looks[1] > PATIENCE:
            return False
        piece, y, slope = self.trace.pieces[-1], state.y.copy(), state.rate.copy()
        scale = np.maximum(problem.atol + problem.rtol * np.abs(y), 1e-300)

        def ahead(time: float) -> Floats:
            share = (time - t) / piece.length
            return np.asarray(piece.values(np.array([1.0 + share]))[0] if share <= 0.25 else y + (time - t) * slope)

        def apart(one: Floats, other: Floats) -> float:
            return float((np.abs(one - other) / scale).max())

        try:
            times = np.minimum(t + window * np.linspace(0.0, 1.0, 13), problem.end)
            found = [self._rate(time, ahead(time)) for time in times]
            gaps = [apart(found[k], found[k + 1]) for k in range(12)]
            k = int(np.argmax(gaps))
            low, high, before, after, earlier = float(times[k]), float(times[k + 1]), found[k], found[k + 1], gaps[k]
            for count in range(1, 1100):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                new = self._rate(middle, ahead(middle))
                if apart(before, new) >= apart(new, after):
                    high, after = middle, new
                else:
                    low, before = middle, new
                if count in (8, 16):  # what is smooth halves each time
                    if count == 16 and apart(before, after) <= 0.25 * earlier:
                        return False
                    earlier = apart(before, after)
            place = ahead(high)
            moved = place != ahead(low)
            if moved.any():  # a state may lie on the surface, and sign(0) is neither side's
                past = high + 4.0 * float((np.spacing(np.abs(place)) / np.maximum(np.abs(slope), 1e-300))[moved].max())
                after = self._rate(past, ahead(past)) if past - high < 1e-2 * (high - t) else after
            jump = apart(before, after)
            if not jump * window > 0.1:  # harmless
                return False
            in_time = apart(self._rate(low, place), self._rate(high, place)) > 0.5 * jump
            behind = slope + after - before
            onward = self._rate(high, place + max(0.01 * (high - t), 64.0 * math.ulp(high)) * behind)
            back = apart(onward, before) < apart(onward, after)
        except SolverError:  # fun is not finite there
            return False
        rest = self.segments[0]
        if in_time:
            self.segments[:1] = [Segment(high, rest.first, low), Segment(rest.end, high, rest.last)]
        elif high - t > 0.25 * piece.length:
            self.approaching = True
            self.segments[:1] = [Approach(t + 0.9 * (high - t), rest.first, rest.last, length=high - t), rest]
        else:
            self._chatter(t)
            self.beyond, self.contact = behind, after - before if back else None
            if back:  # up to where no stage lies beyond the surface: the other side would throw it back
                moved = (after != before) & (slope != 0.0)
                high = max(0.5 * (t + high), high - SHORT * float((scale[moved] / np.abs(slope[moved])).min(initial=math.inf) if moved.any() else 0.0))
            self.segments[:1] = [Segment(high, rest.first, rest.last), Segment(rest.end, rest.first, rest.last)]
        segment = self.segments[0]
        self.problem, self.bound = problem._replace(end=segment.end, last=segment.last), None
        control.step = max(float(control.step), 0.5 * float(control.tried))
        return True

    def _reason(self, code: int) -> str:
        control, t = self.state.control[0], self.state.control[0].time
        if code == stepper.TOO_MANY:
            return f"more than max_steps = {self.task.max_steps} steps at t = {t:.6g}"
        if code == stepper.TROUBLE:
            return events.trouble(self.events)
        if code == stepper.NOT_FINITE:
            return f"fun was not finite in component {int(control.failed_component)} at t = {control.failed_time:.6g}"
        if self.thrown or self.surfaces or (self.found and self.found[-1] > t - 1e-6 * self.problem.span):
            return SLIDING.format(t)
        return f"the step size fell below {self.problem.floor:.2g} at t = {t:.6g}: the tolerance cannot be kept there"

    def record_of(self, steps: int) -> stepper.Record:
        """Room for so many steps."""
        n = len(self.state.y)
        shapes: list[Any] = [steps, steps, steps, steps, (steps, n), (steps, self.count, n), steps, (steps, n), (steps, n)]
        return stepper.Record(*(np.zeros(shape) for shape in shapes))

    def _keep(self, done: int) -> None:
        """Append recorded steps and events to the trace."""
        trace, record, state = self.trace, self.record, self.state
        times, states = nodes(record, 0, done, float(state.control[0].time), state.y)
        trace.times.extend(times.tolist())
        trace.states.extend(states)
        trace.pieces.extend(self.pieces(0, done))
        trace.steps += done
        events.take_log(self.events, self.task.events)

    def pieces(self, first: int, last: int) -> list[Piece]:
        """The solution on recorded steps, but those that are contacts which left no flight."""
        record = self.record
        start, size, y, values = (array[first:last].copy() for array in (record.start, record.size, record.y, record.values))
        found = []
        for k, share in enumerate(record.share[first:last].tolist()):
            if share > 0.0:
                piece = self._piece(float(start[k]), float(size[k]), record.kind[first + k] == 1.0, y[k], values[k])
                found.append(piece if share == 1.0 else _shortened(piece, share))
        return found

    def _piece(self, start: float, h: float, singular: bool, y: Floats, values: Floats) -> Piece:
        stages = self.stages
        if not singular:
            return Piece(start, h, lambda theta: y + h * (stages.regular.integrals(theta) @ values), lambda theta: stages.regular.values(theta) @ values)

        def slopes(theta: Floats) -> Floats:
            root = np.sqrt(theta)
            return np.asarray(stages.singular.slopes(root)[..., 1:] @ values / (2.0 * h * root[:, None]))

        return Piece(start, h, lambda theta: y + stages.singular.values(np.sqrt(theta))[..., 1:] @ values, slopes, np.sqrt(stages.c))

    def _leave(self, surface: _sliding.Surface) -> None:
        """Go on from here beside the surface, with a Jacobian of that side: differences must not reach over."""
        state, t = self.state, float(self.state.control[0].time)
        found = surface.located(self._one_side, t, state.y)
        self._set_surfaces([other for other in self.surfaces if other is not surface])
        self._begin(0.5 * (self.segments[0].end - t))
        if found is None:
            return
        shifts = 1.5e-8 * np.maximum(np.abs(state.y), 1e-8)
        away = -math.copysign(1.0, found[0]) * surface.half
        place = state.y + away * float(16.0 * shifts.max() / np.abs(away).max())
        self._differentiate(self._rate, place, shifts)

    def _differentiate(self, rate: _sliding.Rate, place: Floats, shifts: Floats) -> None:
        """The Jacobian of the rate at a place on one side of a jump, by forward differences."""
        state, t = self.state, float(self.state.control[0].time)
        here = rate(t, place)
        for j, shift in enumerate(shifts):
            shifted = place.copy()
            shifted[j] += shift
            state.jacobian[:, j] = (rate(t, shifted) - here) / (shifted[j] - place[j])
        state.control[0].jacobian_known = True
