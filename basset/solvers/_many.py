"""Many independent systems at once: compiled code goes from one to the next, each on its own steps and to the bits of a solution on its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from basset._compile import compiled, is_compiled, placed, tabulate
from basset.kernels import Floats
from basset.solvers import events, stepper
from basset.solvers._graded import Integration, nodes
from basset.solvers.base import MESSAGES, Event, Path, Solution, SolverError, Task, Trace, off_surfaces, solution_of

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


def _make_march_many(digest: str) -> Callable[..., Any]:
    def march_many(attempt, watch, watching, p, motion, found, start, most, record, columns, first):
        """Solve systems from number `first` on, each from `start`, until the record is full: the number of the first one that is not done.

        Where a system needs more than steps and events its code says so: nothing of it is recorded.
        """
        digest  # noqa: B018 - part of the cache key
        state, control, problem = p.state, p.state.control[0], p.problem
        done, j = 0, first
        while j < len(columns.codes):
            begun, logged = done, found.logged[0]
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
            code = stepper.FULL
            while code in (stepper.FULL, stepper.ACCEPTED):
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

    return march_many


march_many = compiled(_make_march_many, allocates=False, usually="some 5 s")
STATUS = {stepper.END: 0, stepper.STOPPED: 1, stepper.AT_REST: 2}


class Block:
    """Some of the systems, solved by one thread."""

    def __init__(self, tasks: list[Task], method: Any, dense: bool, wanted: Floats | None) -> None:
        self.tasks, self.method, self.dense, self.wanted = tasks, method, dense, wanted

    def solutions(self) -> list[Solution]:
        """One of each system."""
        first = self.tasks[0]
        fast = is_compiled(first.function) and all(is_compiled(event.function) and (event.jump is None or is_compiled(event.jump)) for event in first.events)
        if not fast or len(first.breaks) or first.data is None or not hasattr(self.method, "stages"):
            return [self._alone(task) for task in self.tasks]
        try:
            starts = np.array([off_surfaces(task).y0 for task in self.tasks])
            one = Integration(self.method, first, Trace([first.start], [first.y0.copy()], []))
        except SolverError:
            return [self._alone(task) for task in self.tasks]
        if not len(one.tables.unit.local):  # the tables of the last step would have to come from Python
            return [self._alone(task) for task in self.tasks]
        return self._marched(one, starts)

    def _alone(self, task: Task) -> Solution:
        task.nfev = 0
        task.release()
        return solution_of(task, self.method, self.dense, self.wanted)

    def _marched(self, one: Integration, starts: Floats) -> list[Solution]:
        first, count = self.tasks[0], len(self.tasks)
        one.record = one.record_of(RECORDED)
        one.tables.fill_all()
        _, (attempt, watch, watching, parts, _, most, record, _) = one.bind()
        first.rate(first.start, first.y0)  # shape and type are checked here: compiled code does not
        arguments = np.zeros((count, one.arguments.shape[1] - len(first.y0)), dtype=np.int64)
        for row, task in zip(arguments, self.tasks, strict=True):
            tabulate(row, task.data or ())
        alike = np.array([one.serves(task) for task in self.tasks])
        codes = np.where(alike, UNDONE, BEGUN)
        whole = partial(np.zeros, count, dtype=np.int64)
        columns = Columns(
            starts,
            np.array([task.slip[one.active] for task in self.tasks]).reshape(count, -1),
            np.array([task.coefficient[one.active] for task in self.tasks]).reshape(count, -1),
            arguments, one.arguments, codes, whole(), whole(), whole(), np.zeros(count), np.zeros((count, len(first.y0))),
        )  # fmt: skip
        found, motion = placed(one.events), placed(one.free)
        start = one.state.control.copy()
        results: list[Solution] = []
        while len(results) < count:
            begun = len(results)
            one.events.logged[0] = 0
            end = march_many(attempt, watch, watching, parts, motion, found, start, most, record, placed(columns), begun)
            step_from = log_from = 0
            for j in range(begun, end):
                step_to, log_to = int(columns.steps[j]), int(columns.logged[j])
                if alike[j] and columns.codes[j] in STATUS:
                    results.append(self._solution(one, columns, j, (step_from, step_to), (log_from, log_to)))
                else:
                    results.append(self._alone(self.tasks[j]))
                step_from, log_from = step_to, log_to
        return results

    def _solution(self, one: Integration, columns: Columns, j: int, steps: tuple[int, int], log: tuple[int, int]) -> Solution:
        task, status = self.tasks[j], STATUS[int(columns.codes[j])]
        times, states = nodes(one.record, *steps, float(columns.time[j]), columns.y[j])
        times, states = np.append(task.start, times), np.concatenate([task.y0[None], states]).T
        path = None
        if self.dense or self.wanted is not None:
            path = Path(one.pieces(*steps), states[:, -1])
        if self.wanted is not None:
            times = self.wanted[self.wanted <= times[-1]]
            states = path(times) if path is not None and steps[1] > steps[0] else np.repeat(task.y0[:, None], len(times), axis=1)
        happened = slice(*log)
        which, at, where = one.events.log_events[happened], one.events.log_times[happened], one.events.log_states[happened]
        chosen = [which == k for k in range(len(task.events))]
        return Solution(
            times, states, path if self.dense else None, [at[some] for some in chosen], [where[some] for some in chosen],
            int(columns.calls[j]) + 1, steps[1] - steps[0], status, MESSAGES[status],
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
