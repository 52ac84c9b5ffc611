"""Many independent systems at once: compiled code goes from one to the next, each with its own steps and bitwise as if solved alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from basset._compile import compiled, is_compiled, placed, shared, tabulate
from basset.kernels import Floats
from basset.solvers import events, stepper
from basset.solvers._graded import Integration, nodes
from basset.solvers.base import MESSAGES, Event, Solution, SolverError, Task, Trace, finished, off_surfaces, solution_of

if TYPE_CHECKING:
    from basset.solvers.base import Method

RECORDED = 4096  # steps between two visits of the caller
UNDONE, BEGUN = -1, -2  # codes of systems that were not tried yet, or that have to be solved on their own


class Columns(NamedTuple):
    """One row per system: state, slip, coefficients; where the arguments lie; the tables from which fun, events and jumps read them; the results."""

    y0: Floats  # (system, state)
    slip: Floats  # (system, member)
    coefficient: Floats  # (system, member)
    arguments: Any  # (system, argument), in words
    tables: Any  # (function, argument + state), in words
    codes: Any  # (system,)
    calls: Any  # (system,): of fun
    steps: Any  # (system,): how many are recorded behind its last one
    logged: Any  # (system,)
    time: Floats  # (system,): of the end
    y: Floats  # (system, state): at the end


@shared
def set_arguments(columns: Columns, j: int) -> None:
    """Let fun, events and jumps read the arguments of system j."""
    for k in range(columns.tables.shape[0]):
        for a in range(columns.arguments.shape[1]):
            columns.tables[k, a] = columns.arguments[j, a]


@compiled(allocates=False, usually="some 5 s")
def march_many(attempt, watch, watching, p, motion, found, start, most, record, columns, suspects, first):
    """Solve systems from number `first` on, each from `start`, until the record is full: the number of the first one that is not done.

    Where a system needs more than steps and events its code says so: nothing of it is recorded. With `suspects` a suspicion that
    fun jumps is no reason to stop: the error is controlled without it.
    """
    state, control, problem = p.state, p.state.control[0], p.problem
    done, j = 0, first
    while j < len(columns.codes):
        begun, logged = done, found.logged[0]
        set_arguments(columns, j)
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
        code = stepper.FULL
        while code in (stepper.FULL, stepper.ACCEPTED) or (suspects and code == stepper.SUSPECT):
            if done >= len(record.start) or found.logged[0] > most:
                if begun == 0:  # too long for the record
                    code = BEGUN
                    break
                found.logged[0] = logged
                return j
            code, taken = stepper.advance(attempt, watch, watching, p, record, done)
            if taken:
                done += 1
        columns.codes[j], columns.calls[j] = code, control.calls
        if code not in (stepper.END, stepper.STOPPED, stepper.AT_REST):
            done, found.logged[0] = begun, logged
        columns.steps[j], columns.logged[j], columns.time[j] = done, found.logged[0], control.time
        for a in range(len(state.y)):
            columns.y[j, a] = state.y[a]
        j += 1
    return j


STATUS = {stepper.END: 0, stepper.STOPPED: 1, stepper.AT_REST: 2}


def prepared(method: Any, task: Task) -> Integration | None:
    """The set-up of compiled code for a task and others that differ by numbers alone; None where they have to be solved one by one."""
    fast = is_compiled(task.function) and all(is_compiled(event.function) and (event.jump is None or is_compiled(event.jump)) for event in task.events)
    if not fast or len(task.breaks) or task.data is None or not hasattr(method, "stages"):
        return None
    try:
        one = Integration(method, task, Trace([task.start], [task.y0.copy()], []))
    except SolverError:
        return None
    return one if len(one.tables.unit.local) else None  # else the tables of the last step would have to come from Python


class Rows:
    """Systems in compiled code, a row each: starts, slips and coefficients (of all members), arguments (in words), codes."""

    def __init__(self, one: Integration, starts: Floats, slips: Floats, coefficients: Floats, arguments: Any, codes: Any, suspects: bool = False) -> None:
        one.record, whole = one.record_of(RECORDED), partial(np.zeros, len(starts), dtype=np.int64)
        one.tables.fill_all()
        self.events, self.columns = one.events, Columns(
            starts, slips[:, one.active].copy(), coefficients[:, one.active].copy(), arguments, one.arguments, codes,
            whole(), whole(), whole(), np.zeros(len(starts)), np.zeros_like(starts),
        )  # fmt: skip
        self.table = placed(self.columns)
        _, (attempt, watch, watching, self.parts, _, most, self.record, _) = one.bind()
        motion, found, start = placed(one.free), placed(one.events), one.state.control.copy()
        self._march = partial(march_many, attempt, watch, watching, self.parts, motion, found, start, most, self.record, self.table, suspects)
        self._march(len(starts))  # compiles it

    def marched(self) -> Iterator[list[tuple[int, slice, slice]]]:
        """System, its steps in the record and its events in the log, for as many as there is room for at once, until all are done."""
        columns, end = self.columns, 0
        while end < len(columns.codes):
            begun, self.events.logged[0] = end, 0
            end = self._march(begun)
            steps, logged = ([0, *ends[begun:end].tolist()] for ends in (columns.steps, columns.logged))
            yield [(begun + k, slice(*steps[k : k + 2]), slice(*logged[k : k + 2])) for k in range(end - begun)]


class Block:
    """Some of the systems, solved by one thread."""

    def __init__(self, tasks: list[Task], method: Any, dense: bool, wanted: Floats | None) -> None:
        self.tasks, self.method, self.dense, self.wanted = tasks, method, dense, wanted

    def solutions(self) -> list[Solution]:
        """One of each system."""
        try:
            one = prepared(self.method, self.tasks[0])
            if one is not None:
                return self._marched(one, np.array([off_surfaces(task).y0 for task in self.tasks]))
        except SolverError:
            pass
        return [self._alone(task) for task in self.tasks]

    def _alone(self, task: Task) -> Solution:
        task.nfev = 0
        task.release()
        return solution_of(task, self.method, self.dense, self.wanted)

    def _marched(self, one: Integration, starts: Floats) -> list[Solution]:
        tasks = self.tasks
        tasks[0].rate(tasks[0].start, tasks[0].y0)  # shape and type are checked here: compiled code does not
        arguments = np.zeros((len(tasks), one.arguments.shape[1] - starts.shape[1]), dtype=np.int64)
        for row, task in zip(arguments, tasks, strict=True):
            tabulate(row, task.data or ())
        alike = np.array([one.serves(task) for task in tasks])
        slips, coefficients = np.array([task.slip for task in tasks]), np.array([task.coefficient for task in tasks])
        rows = Rows(one, starts, slips, coefficients, arguments, np.where(alike, UNDONE, BEGUN))
        results: list[Solution] = []
        for found in rows.marched():
            for j, steps, log in found:
                marched = alike[j] and rows.columns.codes[j] in STATUS
                results.append(self._solution(one, rows.columns, j, steps, log) if marched else self._alone(tasks[j]))
        return results

    def _solution(self, one: Integration, columns: Columns, j: int, steps: slice, log: slice) -> Solution:
        task, status = self.tasks[j], STATUS[int(columns.codes[j])]
        times, states = nodes(one.record, steps.start, steps.stop, float(columns.time[j]), columns.y[j])
        times, states = np.append(task.start, times), np.concatenate([task.y0[None], states])
        pieces = one.pieces(steps.start, steps.stop) if self.dense or self.wanted is not None else []
        which, at, where = one.events.log_events[log], one.events.log_times[log], one.events.log_states[log]
        chosen = [which == k for k in range(len(task.events))]
        return finished(
            task, times, states, pieces, [at[some] for some in chosen], [where[some] for some in chosen],
            (int(columns.calls[j]) + 1, steps.stop - steps.start), status, MESSAGES[status], self.dense, self.wanted,
        )  # fmt: skip


def solve_many(tasks: list[Task], method: Method, workers: int, dense: bool, wanted: Floats | None) -> Solution:
    """All systems, over threads: SciPy's fields with a trailing axis, those of different lengths as lists."""
    size = math.ceil(len(tasks) / workers)
    blocks = [Block(tasks[k : k + size], method, dense, wanted) for k in range(0, len(tasks), size)]
    if len(blocks) == 1:
        found = blocks[0].solutions()
    else:
        with ThreadPoolExecutor(len(blocks)) as pool:
            found = [solution for solutions in pool.map(Block.solutions, blocks) for solution in solutions]
    times: Any = [solution.t for solution in found]
    states: Any = [solution.y for solution in found]
    if wanted is not None:
        whole = np.full((len(tasks[0].y0), len(wanted), len(found)), np.nan)  # NaN behind a system's own end
        for j, solution in enumerate(found):
            whole[:, : solution.y.shape[1], j] = solution.y
        times, states = wanted, whole
    fields: list[Any] = [times, states, [solution.sol for solution in found] if dense else None]
    fields += [[[getattr(solution, name)[k] for solution in found] for k in range(len(tasks[0].events))] for name in ("t_events", "y_events")]
    fields += [np.array([getattr(solution, name) for solution in found]) for name in ("nfev", "nsteps", "status")]
    fields.append([solution.message for solution in found])
    return Solution(*fields)


def columns_of(task: Task, y0: Floats, slip: Floats | None, coefficient: Floats) -> list[Task]:
    """A task for each column: arrays among the arguments whose last axis has as many entries as there are systems belong to them one by one."""
    count = y0.shape[1]

    def shared_out(values: tuple[Any, ...] | None) -> list[tuple[Any, ...] | None]:
        if values is None:
            return [None] * count
        parts = []
        for value in values:
            mine = isinstance(value, np.ndarray) and value.ndim > 0 and value.shape[-1] == count
            rows = np.ascontiguousarray(np.moveaxis(value, -1, 0)) if mine else None
            if rows is not None and rows.ndim == 1:
                parts.append([float(x) for x in rows])
            else:
                parts.append(list(rows) if rows is not None else [value] * count)
        return list(zip(*parts, strict=True)) if parts else [()] * count

    given, read = shared_out(task.args), shared_out(task.data)
    found = []
    for j in range(count):
        mine = given[j] or ()
        listed = [Event(event.function, mine, event.index, event.terminal, event.direction, event.jump) for event in task.events]
        state = np.ascontiguousarray(y0[:, j])
        own = state[task.memory] if slip is None else task.slip if slip.ndim < 2 else np.ascontiguousarray(slip[:, j])
        strength = task.coefficient if coefficient.ndim < 2 else np.ascontiguousarray(coefficient[:, j])
        found.append(replace(task, y0=state, slip=own, coefficient=strength, args=mine, data=read[j], events=listed))
    return found
