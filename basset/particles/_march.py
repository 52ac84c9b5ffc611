"""Many particles, one after the other in compiled code, and what is wanted of each: states and what the history adds, at given times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from basset._compile import call, compiled, is_compiled, placed, shared, tabulate
from basset.kernels import Floats
from basset.particles._sources import Sources
from basset.solvers import events, stepper
from basset.solvers._graded import Integration
from basset.solvers._many import BEGUN, RECORDED, STATUS, UNDONE, Columns
from basset.solvers.base import MESSAGES, Event, Piece, SolverError, Task, Trace, off_surfaces

LEFT = 3  # status of a particle that left the grid
STATUSES = {**MESSAGES, LEFT: "The particle left the grid of its flow."}


@dataclass
class Occurrences:
    """What happened: lists of equal length."""

    particle: list[int] = field(default_factory=list)
    event: list[int] = field(default_factory=list)
    time: list[float] = field(default_factory=list)
    state: list[Floats] = field(default_factory=list)


@dataclass
class Paths:
    """States (particle, time, state), what the history adds to the rate of the slip there (particle, time, component), both scaled; the ends."""

    times: Floats
    states: Floats
    histories: Floats
    status: Any
    ends: Floats
    messages: dict[int, str]
    occurrences: Occurrences


@shared
def slope_at(polynomial: Floats, kind: int, h: float, theta: float, a: int) -> float:
    """Rate of state a at θ of a step, from its Legendre coefficients."""
    q = math.sqrt(theta) if kind == 1 else theta
    x = 2.0 * q - 1.0
    older, newer = 1.0, x  # P_0, P_1
    slope_older, slope_newer = 0.0, 1.0
    total: float = polynomial[1, a]
    for d in range(2, len(polynomial)):
        older, newer, slope = newer, ((2 * d - 1) * x * newer - (d - 1) * older) / d, slope_older + (2 * d - 1) * newer
        slope_older, slope_newer = slope_newer, slope
        total += polynomial[d, a] * slope
    return 2.0 * total / h / (2.0 * q if kind == 1 else 1.0)


@shared
def sample(fun: Any, p: Any, record: Any, steps: int, columns: Any, j: int, wanted: Floats, felt: bool, states: Floats, histories: Floats, row: Floats) -> None:
    """States and histories of system j, whose `steps` steps are recorded, at the wanted times up to its end; `felt`: whether the history acts."""
    end, n, members, polynomial = columns.time[j], columns.y0.shape[1], histories.shape[2], p.work.polynomial
    k, fitted = -1, -1
    for i in range(len(wanted)):
        t = wanted[i]
        if t > end:
            break
        while k + 1 < steps and record.start[k + 1] <= t and not (t >= end and record.share[k + 1] == 0.0):
            k += 1
        while k > 0 and record.share[k] == 0.0:
            k -= 1
        at, theta = k, 0.0
        if k >= 0:
            theta = min(max((t - record.start[k]) / record.size[k], 0.0), record.share[k])
            if theta == 0.0 and k > 0 and record.leapt[k - 1] == 0.0:  # the end of the step before
                at, theta = k - 1, record.share[k - 1]
        if at >= 0 and fitted != at:
            stepper.fit_polynomial(p.nodes, int(record.kind[at]), record.size[at], record.values[at], polynomial)
            fitted = at
        for a in range(n):
            if at < 0:
                row[0, a] = columns.y0[j, a]
            elif t >= end:
                row[0, a] = columns.y[j, a]
            elif theta == 0.0:
                row[0, a] = record.y[at, a]
            else:
                row[0, a] = stepper.at(polynomial, record.y[at], int(record.kind[at]), theta, a)
            states[j, i, a] = row[0, a]
        for a in range(members):
            histories[j, i, a] = 0.0
        if not felt or at < 0:
            continue
        if theta > 0.0:
            call(fun, t, row, 0, row, 1, row)
        for a in range(members):
            b = n - members + a
            if theta > 0.0:
                histories[j, i, a] = slope_at(polynomial, int(record.kind[at]), record.size[at], theta, b) - row[1, b]
            else:  # right behind a jump
                leap = columns.slip[j, a] if at == 0 else record.after[at - 1, b] - record.before[at - 1, b]
                if leap != 0.0:
                    histories[j, i, a] = -math.copysign(math.inf, leap)


def _make_fly(digest: str) -> Callable[..., Any]:
    def fly(fun, attempt, watch, watching, p, motion, found, start, most, record, columns, first, wanted, felt, states, histories, row):
        """Particles from number `first` on, each from `start`, sampled, until too much has happened for the log: the number of the first that is not done.

        As `_many.march_many`, but that a suspicion that the flow jumps is no reason to stop: the error is controlled without it. What has more
        steps and events than there is room for, or fails, has a code that says so.
        """
        digest  # noqa: B018 - part of the cache key
        state, control, problem = p.state, p.state.control[0], p.problem
        for j in range(first, len(columns.codes)):
            logged = found.logged[0]
            for k in range(columns.tables.shape[0]):
                for a in range(columns.arguments.shape[1]):
                    columns.tables[k, a] = columns.arguments[j, a]
            state.control[0] = start[0]
            for a in range(len(state.y)):
                state.y[a], state.rate[a] = columns.y0[j, a], 0.0
            for a in range(len(motion.held)):
                motion.held[a] = False
            for a in range(len(problem.where)):
                state.jump[a] = columns.slip[j, a]
                problem.strength[a] = motion.coefficient[a] = columns.coefficient[j, a]
                for q in range(state.past.shape[1]):
                    state.past[a, q] = 0.0
            events.forget(found)
            code, done = stepper.FULL, 0
            while code in (stepper.FULL, stepper.ACCEPTED, stepper.SUSPECT):
                if done >= len(record.start) or found.logged[0] > most:
                    if logged > 0:
                        found.logged[0] = logged
                        return j
                    code = BEGUN
                    break
                code, taken = stepper.advance(attempt, watch, watching, p, record, done)
                if taken:
                    done += 1
            columns.codes[j] = code
            if code in (stepper.END, stepper.STOPPED, stepper.AT_REST):
                columns.time[j] = control.time
                for a in range(len(state.y)):
                    columns.y[j, a] = state.y[a]
                sample(fun, p, record, done, columns, j, wanted, felt, states, histories, row)
            else:
                found.logged[0] = logged
            columns.logged[j] = found.logged[0]
        return len(columns.codes)

    return fly


fly = compiled(_make_fly, usually="some 8 s")


DEGREE = 28  # of a step in √θ, at most


@lru_cache(maxsize=1)
def _chebyshev() -> tuple[Floats, Floats]:
    """Points θ, and the matrix from values there to the Chebyshev coefficients of the slope with respect to √θ."""
    points = -np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(points, DEGREE))
    return (0.5 * (1.0 + points)) ** 2, np.asarray(2.0 * np.polynomial.chebyshev.chebder(inverse))


def slopes(piece: Piece, theta: float) -> Floats:
    """Rates at θ > 0 of a piece, which is a polynomial in √θ."""
    points, _ = _chebyshev()
    root, values = math.sqrt(theta), piece.values(points)
    return np.asarray(_row(root) @ (values - values[0]) / (2.0 * root * piece.length))


@lru_cache(maxsize=64)  # most are at the ends of steps
def _row(root: float) -> Floats:
    """Weights of the values at those points for the slope at √θ."""
    return np.asarray((np.polynomial.chebyshev.chebvander(2.0 * root - 1.0, DEGREE - 1) @ _chebyshev()[1])[0])


@dataclass
class Swarm:
    """Particles alike but for their start and their scales."""

    sources: Sources
    task: Task  # of the first one, checked
    method: Any
    starts: Floats  # (particle, state), scaled
    slips: Floats  # (particle, component), scaled: what is remembered of the start
    scales: Floats  # (particle, 2): length, speed
    wanted: Floats | None
    leaves: int  # number of the event that is the end of the grid; −1 without

    def paths(self, workers: int) -> Paths:
        """All of them, over threads."""
        count, n = self.starts.shape
        if self.wanted is None:
            return self._stepwise()
        d, times = n // 2, len(self.wanted)
        found = Paths(
            self.wanted,
            np.full((count, times, n), np.nan),
            np.full((count, times, d), np.nan),
            np.zeros(count, dtype=np.int32),
            np.zeros(count),
            {},
            Occurrences(),
        )
        share = -(-count // workers)
        blocks = [Block(self, first, min(first + share, count), found) for first in range(0, count, share)]
        if any(block.one is None for block in blocks):
            for block in blocks:
                block.alone(range(block.first, block.last))
        elif len(blocks) == 1:
            blocks[0].march()
        else:
            with ThreadPoolExecutor(len(blocks)) as pool:
                list(pool.map(Block.march, blocks))
        for block in blocks:
            for name in ("particle", "event", "time", "state"):
                getattr(found.occurrences, name).extend(getattr(block.seen, name))
        return found

    def task_of(self, j: int, work: Any) -> Task:
        """The task of one particle."""
        args = (work, float(self.scales[j, 0]), float(self.scales[j, 1]))
        listed = [Event(event.function, args, event.index, event.terminal, event.direction, event.jump) for event in self.task.events]
        return replace(self.task, y0=self.starts[j].copy(), slip=self.slips[j].copy(), args=args, data=args, events=listed)

    def felt(self) -> bool:
        return bool((self.task.coefficient > 0.0).any())

    def ended(self, status: int, events_seen: Any) -> int:
        """The status, LEFT where the last event was the end of the grid."""
        return LEFT if status == 1 and len(events_seen) and events_seen[-1] == self.leaves else status

    def _solved(self, task: Task) -> Trace:
        """One particle by itself; what goes wrong is a status."""
        trace = Trace([task.start], [task.y0.copy()], [])
        try:
            task = off_surfaces(task)
            self.method._integrate(task, trace)
        except SolverError as error:
            trace.status, trace.message = -1, str(error) + "."
        whole = np.isfinite(trace.states).all(axis=1)
        if not whole.all():
            last = max(1, int(whole.argmin()))
            if trace.status >= 0:
                trace.status, trace.message = -1, f"The solution is beyond double precision behind t = {trace.times[last - 1]:.6g}."
            trace.times, trace.states = trace.times[:last], trace.states[:last]
            trace.pieces = [piece for piece in trace.pieces if piece.end <= trace.times[-1]]
        return trace

    def _log(self, j: int, task: Task, seen: Occurrences) -> list[int]:
        """Note what happened to a particle, in the order of time; the events."""
        order = sorted((time, event.index, k) for event in task.events for k, time in enumerate(event.times))
        for time, index, k in order:
            seen.particle.append(j)
            seen.event.append(index)
            seen.time.append(time)
            seen.state.append(task.events[index].states[k])
        return [index for _, index, _ in order]

    def alone(self, j: int, task: Task, found: Paths, seen: Occurrences) -> None:
        """One particle at the wanted times."""
        trace = self._solved(task)
        starts = np.array([piece.start for piece in trace.pieces])
        leaps = {event.times[k] for event in task.events if event.jump is not None for k in range(len(event.times))}
        assert self.wanted is not None
        for i, t in enumerate(self.wanted):
            if t > trace.times[-1]:
                break
            found.states[j, i], found.histories[j, i] = self._at(task, trace, starts, leaps, float(t))
        found.status[j], found.ends[j] = self.ended(trace.status, self._log(j, task, seen)), trace.times[-1]
        if trace.status < 0:
            found.messages[j] = trace.message

    def _at(self, task: Task, trace: Trace, starts: Floats, leaps: set[float], t: float) -> tuple[Floats, Floats]:
        """State and history at a time; at a jump those after it."""
        d, history = len(task.memory), np.zeros(len(task.memory))
        if t >= trace.times[-1]:
            state, k = trace.states[-1], len(starts) - 1
        else:
            k = int(np.searchsorted(starts, t, side="right")) - 1
            state = trace.pieces[k].at(np.array([t]))[0]
        if not self.felt() or not trace.pieces:
            return state, history
        if t == task.start or (t in leaps and t < trace.times[-1]):
            leap = task.slip
            if t > task.start:
                leap = state[-d:] - trace.pieces[k - 1].values(np.ones(1))[0][-d:]
            return state, np.where(leap != 0.0, -np.copysign(np.inf, leap), 0.0)
        if t <= trace.pieces[k].start:
            k -= 1
        return state, self._history(task, trace.pieces[k], t, state)

    def _history(self, task: Task, piece: Piece, t: float, state: Floats) -> Floats:
        d, theta = len(task.memory), min((t - piece.start) / piece.length, 1.0)
        rates = np.asarray(task.function(t, state.copy(), *task.args))
        return np.asarray(slopes(piece, theta)[-d:] - rates[-d:])

    def _stepwise(self) -> Paths:
        """One particle at the ends of its steps; the time of a jump twice, before and after."""
        work, kept = self.sources.bound()
        task, seen = self.task_of(0, work), Occurrences()
        trace = self._solved(task)
        times, states = np.array(trace.times), np.array(trace.states)
        histories, d = np.zeros((len(times), states.shape[1] // 2)), states.shape[1] // 2
        if self.felt():
            ends = np.array([piece.end for piece in trace.pieces])
            for i, t in enumerate(times):
                twice = i > 0 and t == times[i - 1]
                leap = self.slips[0] if i == 0 else states[i, -d:] - states[i - 1, -d:] if twice else np.zeros(d)
                if i == 0 or twice:
                    histories[i] = np.where(leap != 0.0, -np.copysign(np.inf, leap), 0.0)
                elif len(ends):
                    k = int(np.argmin(np.abs(ends - t)))
                    histories[i] = self._history(task, trace.pieces[k], t, states[i])
        status = self.ended(trace.status, self._log(0, task, seen))
        del kept
        messages = {0: trace.message} if trace.status < 0 else {}
        return Paths(times, states[None], histories[None], np.array([status], dtype=np.int32), times[-1:].copy(), messages, seen)


class Block:
    """Some of the particles, for one thread; made in the main one, where all is compiled."""

    def __init__(self, swarm: Swarm, first: int, last: int, found: Paths) -> None:
        self.swarm, self.first, self.last, self.found, self.seen = swarm, first, last, found, Occurrences()
        self.work, self.kept = swarm.sources.bound()
        self.one = self._prepared(swarm.task_of(first, self.work))
        if self.one is not None:
            self._bind(self.one)

    def alone(self, which: Iterable[int]) -> None:
        """Some of them by the general solver."""
        for j in which:
            self.swarm.alone(j, self.swarm.task_of(j, self.work), self.found, self.seen)

    def _prepared(self, task: Task) -> Integration | None:
        """The set-up of compiled code for all of them; None where they have to be solved one by one."""
        fast = is_compiled(task.function) and all(is_compiled(event.function) and (event.jump is None or is_compiled(event.jump)) for event in task.events)
        if not fast or not hasattr(self.swarm.method, "stages"):
            return None
        try:
            one = Integration(self.swarm.method, task, Trace([task.start], [task.y0.copy()], []))
        except SolverError:
            return None
        return one if len(one.tables.unit.local) else None

    def _bind(self, one: Integration) -> None:
        """Arguments of the compiled loops, which are compiled by calling them for no particle."""
        task, count, swarm = one.task, self.last - self.first, self.swarm
        n = len(task.y0)
        one.record = one.record_of(RECORDED)
        one.tables.fill_all()
        _, (attempt, watch, watching, parts, _, most, record, _) = one.bind()
        tabulate(row := np.zeros(one.arguments.shape[1] - n, dtype=np.int64), task.data or ())
        arguments, starts = np.tile(row, (count, 1)), swarm.starts[self.first : self.last].copy()
        arguments[:, 1:] = swarm.scales[self.first : self.last].view(np.int64)
        if any(event.jump is not None and event.direction for event in task.events):
            starts = np.array([off_surfaces(swarm.task_of(j, self.work)).y0 for j in range(self.first, self.last)])
        active, whole = one.active, partial(np.zeros, count, dtype=np.int64)
        self.columns = columns = Columns(
            starts, swarm.slips[self.first : self.last][:, active].copy(), np.tile(task.coefficient[active], (count, 1)), arguments, one.arguments,
            np.full(count, UNDONE), whole(), whole(), whole(), np.zeros(count), np.zeros((count, n)),
        )  # fmt: skip
        motion, log, start, table = placed(one.free), placed(one.events), one.state.control.copy(), placed(columns)
        states, histories = self.found.states[self.first : self.last], self.found.histories[self.first : self.last]
        self._march = lambda begun: fly(
            one.free.fun, attempt, watch, watching, parts, motion, log, start, most, record, table, begun, swarm.wanted, swarm.felt(), states, histories,
            np.zeros((2, n)),
        )  # fmt: skip
        self._march(count)

    def march(self) -> None:
        """All of them."""
        assert self.one is not None
        log, columns, done = self.one.events, self.columns, 0
        while done < self.last - self.first:
            log.logged[0] = 0
            end = self._march(done)
            self._note(log, columns, done, end)
            done = end

    def _note(self, log: Any, columns: Columns, begun: int, end: int) -> None:
        """How those that were marched ended, and what happened to them; the general solver for those that compiled code gave back."""
        found, logged = self.found, 0
        for j in range(begun, end):
            happened = slice(logged, int(columns.logged[j]))
            logged = int(columns.logged[j])
            if columns.codes[j] not in STATUS:
                self.alone([self.first + j])
                continue
            which = log.log_events[happened]
            found.status[self.first + j] = self.swarm.ended(STATUS[int(columns.codes[j])], which)
            found.ends[self.first + j] = columns.time[j]
            if len(which):
                self.seen.particle += [self.first + j] * len(which)
                self.seen.event += which.tolist()
                self.seen.time += log.log_times[happened].tolist()
                self.seen.state += list(log.log_states[happened].copy())
