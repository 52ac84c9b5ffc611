"""Many particles, one after the other in compiled code, and what is wanted of each: states and what the history adds, at given times."""

from __future__ import annotations

import math
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from basset._compile import call, compiled, shared, tabulate
from basset.kernels import Floats, Kernel
from basset.particles._sources import Sources
from basset.solvers import stepper
from basset.solvers._graded import Integration
from basset.solvers._many import STATUS, UNDONE, Rows, prepared, set_arguments
from basset.solvers.base import MESSAGES, Event, Task, Trace, off_surfaces, traced

TINY = 1e-30  # θ, as good as 0
SOON = 1e-36  # s, behind which a kernel is s^(-1/2) times its factor
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
def leap_into(record: Any, columns: Any, j: int, begun: int, at: int, a: int) -> float:
    """By how much slip a of system j, whose first step is `begun`, jumps where step `at` begins."""
    b = columns.y0.shape[1] - columns.slip.shape[1] + a
    total: float = 0.0
    while at > begun and record.leapt[at - 1] != 0.0:
        at -= 1
        total += record.after[at, b] - record.before[at, b]
        if record.share[at] > 0.0:
            return total
    if at == begun:
        total += columns.slip[j, a]
    return total


@compiled(allocates=False, usually="some 2 s")
def sample(fun, p, record, columns, wanted, at_once, root, states, histories, row, first, last):
    """States and histories of systems from number `first` up to `last`, whose steps are the record, at the wanted times up to their ends.

    `at_once`, `root`: `Swarm.begins`.
    """
    n, members, polynomial, stop = columns.y0.shape[1], histories.shape[2], p.work.polynomial, 0
    for j in range(first, last):
        begun, stop, end = stop, columns.steps[j], columns.time[j]
        if columns.codes[j] not in (stepper.END, stepper.STOPPED, stepper.AT_REST):
            continue
        set_arguments(columns, j)
        k, fitted = begun - 1, -1
        for i in range(len(wanted)):
            t = wanted[i]
            if t > end:
                break
            while k + 1 < stop and record.start[k + 1] <= t and not (t >= end and record.share[k + 1] == 0.0):
                k += 1
            while k > begun and record.share[k] == 0.0:
                k -= 1
            at, theta = k, 0.0
            if k >= begun:
                theta = min(max((t - record.start[k]) / record.size[k], 0.0), record.share[k])
                if theta == 0.0 and k > begun and record.leapt[k - 1] == 0.0:  # the end of the step before
                    at, theta = k - 1, record.share[k - 1]
            if at >= begun and fitted != at:
                stepper.fit_polynomial(p.nodes, int(record.kind[at]), record.size[at], record.values[at], polynomial)
                fitted = at
            for a in range(n):
                if at < begun:
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
            if at_once == 0.0 or at < begun:
                continue
            behind, into = theta == 0.0, at  # a jump: what there was before, and what it adds
            if behind and at > begun:
                at -= 1
                while at > begun and record.share[at] == 0.0:
                    at -= 1
                theta = record.share[at]
                stepper.fit_polynomial(p.nodes, int(record.kind[at]), record.size[at], record.values[at], polynomial)
                fitted = at
                for a in range(n):
                    row[0, a] = record.before[at, a]
            if theta > 0.0:
                call(fun, t, row, 0, row, 1, row)
            kind, h, left = int(record.kind[at]), record.size[at], 1.0
            for stage in range(len(p.nodes.c)):
                left *= 1.0 - math.sqrt(theta / p.nodes.c[stage])
            for a in range(members):
                b = n - members + a
                if theta > 0.0:
                    histories[j, i, a] = slope_at(polynomial, kind, h, theta, b) - row[1, b]
                    if kind == 1:  # dy/d√θ at the start is known, and would be divided by √θ
                        known = -root * leap_into(record, columns, j, begun, at, a) / math.sqrt(h * theta)
                        histories[j, i, a] += left * (known - slope_at(polynomial, 1, h, TINY, b) * math.sqrt(TINY / theta))
                leap = leap_into(record, columns, j, begun, into, a) if behind else 0.0
                if leap != 0.0:
                    histories[j, i, a] -= at_once * leap


@dataclass
class Swarm:
    """Particles that differ only in their start and their scales."""

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

    def begins(self) -> tuple[float, float]:
        """What the history takes from the rate of a slip after a jump, per jump: at once (0 without history), and its factor of s^(-1/2)."""
        coefficient, kernel = float(self.task.coefficient.max()), self.task.kernel
        if not coefficient:
            return 0.0, 0.0
        if not isinstance(kernel, Kernel):
            return math.inf, coefficient
        start = kernel(0.0)
        return coefficient * start, coefficient * kernel(SOON) * math.sqrt(SOON) if math.isinf(start) else 0.0

    def ended(self, status: int, events_seen: Any) -> int:
        """The status, LEFT where the last event was the end of the grid."""
        return LEFT if status == 1 and len(events_seen) and events_seen[-1] == self.leaves else status

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
        trace = traced(task, self.method)[1]
        starts = np.array([piece.start for piece in trace.pieces])
        leaps = {event.times[k]: event.states[k] for event in task.events if event.jump is not None for k in range(len(event.times))}
        assert self.wanted is not None
        for i, t in enumerate(self.wanted):
            if t > trace.times[-1]:
                break
            found.states[j, i], found.histories[j, i] = self._at(task, trace, starts, leaps, float(t))
        found.status[j], found.ends[j] = self.ended(trace.status, self._log(j, task, seen)), trace.times[-1]
        if trace.status < 0:
            found.messages[j] = trace.message

    def _at(self, task: Task, trace: Trace, starts: Floats, leaps: dict[float, Floats], t: float) -> tuple[Floats, Floats]:
        """State and history at a time; at a jump those after it."""
        d, history = len(task.memory), np.zeros(len(task.memory))
        if t >= trace.times[-1]:
            state, k = trace.states[-1], len(starts) - 1
        else:
            k = int(np.searchsorted(starts, t, side="right")) - 1
            state = trace.pieces[k].at(np.array([t]))[0]
        if not self.begins()[0] or not trace.pieces:
            return state, history
        if t == task.start:
            return state, self._behind(history, task.slip)
        if t in leaps and t < trace.times[-1]:
            before = leaps[t]
            return state, self._behind(self._history(task, trace, k - 1, t, before), state[-d:] - before[-d:])
        if t <= trace.pieces[k].start:
            k -= 1
        return state, self._history(task, trace, k, t, state)

    def _behind(self, history: Floats, leap: Floats) -> Floats:
        """What the history adds right after a jump, from its value before."""
        with np.errstate(invalid="ignore"):
            return np.asarray(history - np.where(leap == 0.0, 0.0, self.begins()[0] * leap))

    def _history(self, task: Task, trace: Trace, k: int, t: float, state: Floats) -> Floats:
        """What the history adds to the rates of the slip at a time in a piece, as `sample`."""
        d, piece = len(task.memory), trace.pieces[k]
        theta = min((t - piece.start) / piece.length, 1.0)
        slopes, rates = piece.slopes(np.array([theta, TINY]))[:, -d:], np.asarray(task.function(t, state.copy(), *task.args))
        found = slopes[0] - rates[-d:]
        if piece.met is not None:
            leap = task.slip if k == 0 else piece.values(np.zeros(1))[0, -d:] - trace.pieces[k - 1].values(np.ones(1))[0, -d:]
            known = -self.begins()[1] * leap / math.sqrt(theta * piece.length)
            found += np.prod(1.0 - math.sqrt(theta) / piece.met) * (known - slopes[1] * math.sqrt(TINY / theta))
        return np.asarray(found)

    def _stepwise(self) -> Paths:
        """One particle at the ends of its steps; the time of a jump twice, before and after."""
        task, seen = self.task_of(0, self.sources.own[0]), Occurrences()
        trace = traced(task, self.method)[1]
        times, states = np.array(trace.times), np.array(trace.states)
        histories, d = np.zeros((len(times), states.shape[1] // 2)), states.shape[1] // 2
        if self.begins()[0]:
            ends = np.array([piece.end for piece in trace.pieces])
            for i, t in enumerate(times):
                first = int(np.searchsorted(times, t))  # before all jumps at this time
                if first < i or i == 0:
                    leap = states[i, -d:] - states[first, -d:]
                    histories[i] = self._behind(histories[first], leap) if first else self._behind(np.zeros(d), self.slips[0] + leap)
                elif len(ends):
                    k = int(np.argmin(np.abs(ends - t)))
                    histories[i] = self._history(task, trace, k, t, states[i])
        status = self.ended(trace.status, self._log(0, task, seen))
        messages = {0: trace.message} if trace.status < 0 else {}
        return Paths(times, states[None], histories[None], np.array([status], dtype=np.int32), times[-1:].copy(), messages, seen)


class Block:
    """Some of the particles, for one thread; made in the main one, where all is compiled."""

    def __init__(self, swarm: Swarm, first: int, last: int, found: Paths) -> None:
        self.swarm, self.first, self.last, self.found, self.seen = swarm, first, last, found, Occurrences()
        self.work, self.kept = swarm.sources.bound()
        self.one = prepared(swarm.method, swarm.task_of(first, self.work))
        if self.one is not None:
            self._bind(self.one)

    def alone(self, which: Iterable[int]) -> None:
        """Some of them by the general solver."""
        for j in which:
            self.swarm.alone(j, self.swarm.task_of(j, self.work), self.found, self.seen)

    def _bind(self, one: Integration) -> None:
        """Arguments of the compiled loops, which are compiled by calling them for no particle."""
        task, some, swarm = one.task, slice(self.first, self.last), self.swarm
        count, n = self.last - self.first, len(task.y0)
        tabulate(row := np.zeros(one.arguments.shape[1] - n, dtype=np.int64), task.data or ())
        arguments, starts = np.tile(row, (count, 1)), swarm.starts[some].copy()
        arguments[:, 1:] = swarm.scales[some].view(np.int64)
        if any(event.jump is not None and event.direction for event in task.events):
            starts = np.array([off_surfaces(swarm.task_of(j, self.work)).y0 for j in range(self.first, self.last)])
        rows = self.rows = Rows(one, starts, swarm.slips[some], np.tile(task.coefficient, (count, 1)), arguments, np.full(count, UNDONE), suspects=True)
        self._sample = partial(
            sample, one.free.fun, rows.parts, rows.record, rows.table, swarm.wanted, *swarm.begins(),
            self.found.states[some], self.found.histories[some], np.zeros((2, n)),
        )  # fmt: skip
        self._sample(count, count)

    def march(self) -> None:
        """All of them: how they ended, and what happened to them; the general solver for those that compiled code gives back."""
        found, columns, log = self.found, self.rows.columns, self.rows.events
        for marched in self.rows.marched():
            self._sample(marched[0][0], marched[-1][0] + 1)
            for j, _, happened in marched:
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
