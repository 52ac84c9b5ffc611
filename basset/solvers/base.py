"""What all methods share: the checked problem, events, and the solution."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import Floats, Kernel, VaryingSlipKernel

BESIDE = 4.0  # units in the last place between a break and where `fun` is evaluated: the user's arithmetic may round

MESSAGES = {
    0: "The solver reached the end of the time span.",
    1: "A terminal event occurred.",
    2: "At rest: a flight between two jumps was too short to be distinguished from rest; either nothing else moves, or the body cannot be held at rest.",
}


class SolverError(Exception):
    """The integration cannot go on; becomes status −1 and its message."""


@dataclass(frozen=True, eq=False)
class Piece:
    """The solution on [start, start + length] as a function of θ = (t − start)/length."""

    start: float
    length: float
    values: Callable[[Floats], Floats]  # θ (k,) -> (k, states)
    slopes: Callable[[Floats], Floats]  # θ (k,) -> (k, states): rates, per time; of a step in √θ for θ > 0
    met: Floats | None = None  # √θ at which a step in √θ meets the equation

    @property
    def end(self) -> float:
        """The last time."""
        return self.start + self.length

    def at(self, t: Floats) -> Floats:
        """States (k, states) at times (k,)."""
        return self.values(np.clip((t - self.start) / self.length, 0.0, 1.0))


class Path:
    """The solution as a function of time, from `t_min` to `t_max` (s); at a jump its value is the one after it.

    `pieces` are one per step, in the order of time, `final` is the state at the end.

    >>> import basset
    >>> r = basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], coefficient=0.0, dense_output=True)
    >>> r.sol(np.array([0.0, 1.0])).round(4)
    array([[1.    , 0.3679]])
    """

    def __init__(self, pieces: Sequence[Piece], final: Floats) -> None:
        self._pieces, self._final = list(pieces), final
        self._starts = np.array([piece.start for piece in pieces])
        self.t_min = pieces[0].start if pieces else math.nan
        self.t_max = pieces[-1].end if pieces else math.nan

    def __call__(self, t: ArrayLike) -> Floats:
        """States (states, ...) at times (...) in s; ValueError outside the solved span."""
        times = _validate.real_array("t", t)
        flat = times.ravel()
        slack = rounding(self.t_min, self.t_max)
        if flat.size and not (flat.min() >= self.t_min - slack and flat.max() <= self.t_max + slack):
            low, high, came = outside(flat, self.t_min, self.t_max)
            raise ValueError(f"t must lie in the solved span [{low}, {high}], got {came}")
        result = np.empty((flat.size, len(self._final)))
        index = np.clip(np.searchsorted(self._starts, flat, side="right") - 1, 0, len(self._pieces) - 1)
        for k in np.unique(index):
            chosen = index == k
            result[chosen] = self._pieces[k].at(flat[chosen])
        result[flat >= self.t_max] = self._final
        return result.T.reshape((len(self._final), *times.shape))


def rounding(start: float, end: float) -> float:
    """How far beyond a span a time may lie that was meant to be its end: np.arange and np.linspace round."""
    return max(1e-12 * (end - start), 4.0 * float(np.spacing(max(abs(start), abs(end)))))


def outside(times: Floats, start: float, end: float) -> tuple[str, str, str]:
    """The ends of a span and the time farthest beyond them, for a sentence."""
    worst = float(times[int(np.argmax(np.maximum(start - times, times - end)))])
    low, below = _validate.apart(start, worst)
    high, above = _validate.apart(end, worst)
    return low, high, below if worst < start else above


@dataclass
class Solution:
    """What `basset.solve` returns; the fields follow scipy.integrate.solve_ivp."""

    t: Floats  # (n_times,), s; without `t_eval` every step's end, the time of a jump twice, before and after
    y: Floats  # (n_states, n_times)
    sol: Path | None  # the solution as a function of time, with `dense_output=True`
    t_events: list[Floats]  # of each event, times (k,), s
    y_events: list[Floats]  # and states before any jump (k, n_states)
    nfev: int  # evaluations of `fun`
    nsteps: int  # accepted steps
    status: int  # 0 end reached, 1 terminal event, 2 at rest, −1 failure
    message: str  # the status in words

    @property
    def success(self) -> bool:
        """Whether the span was solved, or left by an event; of many systems, of each."""
        return self.status >= 0


def returned(what: str, given: Any, states: int) -> Floats:
    """What a callback returned, checked, in an array of its own."""
    result = np.asarray(given) if type(given) is np.ndarray or not np.ma.is_masked(given) else None
    if result is None or result.dtype.kind not in "fiub":
        try:
            if result is None or result.dtype.kind != "O":
                raise TypeError
            result = result.astype(np.float64)
        except (TypeError, ValueError):
            hint = "; " + COMPLEX if result is not None and result.dtype.kind == "c" else ""
            raise TypeError(f"{what}, got {_validate.shown(given)}{hint}") from None
    if result.shape != (states,):
        raise ValueError(f"{what}, got shape {result.shape}")
    return np.array(result, dtype=np.float64)


COMPLEX = "a complex state is two real ones"


@dataclass
class Event:
    """One event function with SciPy's attributes and `jump`; when it happened, and the states before its jumps."""

    function: Callable[..., Any]
    args: tuple[Any, ...]
    index: int
    terminal: int = 0  # the occurrence that ends the run, 0 for none
    direction: float = 0.0
    jump: Callable[..., Any] | None = None
    times: list[float] = field(default_factory=list)
    states: list[Floats] = field(default_factory=list)

    def value(self, t: float, y: Floats) -> float:
        """The event function, checked."""
        given = self.function(t, y.copy(), *self.args)
        try:
            if isinstance(given, np.complexfloating):
                raise TypeError
            result = float(given)
        except (TypeError, ValueError):
            hint = "; " + COMPLEX if np.iscomplexobj(given) else ""
            raise TypeError(f"event {self.index} must return a number, got {_validate.shown(given)}{hint}") from None
        if not math.isfinite(result):
            raise SolverError(f"event {self.index} gave {result} at t = {t:.6g}")
        return result

    def after(self, t: float, y: Floats) -> Floats:
        """The state after the jump, checked."""
        assert self.jump is not None
        after = returned(f"jump of event {self.index} must return {len(y)} states", self.jump(t, y.copy(), *self.args), len(y))
        if not np.isfinite(after).all():
            worst = int(np.flatnonzero(~np.isfinite(after))[0])
            raise SolverError(f"jump of event {self.index} gave {after[worst]} in component {worst} at t = {t:.6g}")
        return after


@dataclass
class Task:
    """The problem as a method sees it: y' = fun(t, y) − coefficient·H[y] on the components in `memory`."""

    function: Callable[..., Any]
    args: tuple[Any, ...]
    start: float
    end: float
    y0: Floats
    memory: Any
    coefficient: Floats
    kernel: Kernel | VaryingSlipKernel
    slip: Floats
    events: list[Event]
    max_steps: int
    breaks: Floats = field(default_factory=lambda: np.empty(0))  # rising
    data: tuple[Any, ...] | None = ()  # args as compiled code reads them; None where it cannot
    nfev: int = 0
    held: Any = field(init=False)  # components of bodies at rest: they stay as they are

    def __post_init__(self) -> None:
        self.release()

    def release(self) -> None:
        """Nothing is at rest, nothing has happened."""
        self.held = np.zeros(len(self.y0), dtype=np.bool_)
        for event in self.events:
            event.times, event.states = [], []

    def free(self, t: float, y: Floats) -> Floats:
        """fun(t, y), float64 (states,), checked for shape and finiteness."""
        self.nfev += 1
        result = returned(f"fun must return {len(self.y0)} rates, one per state", self.function(t, y.copy(), *self.args), len(self.y0))
        if not np.isfinite(result).all():
            worst = int(np.flatnonzero(~np.isfinite(result))[0])
            raise SolverError(f"fun gave {result[worst]} in component {worst} at t = {t:.6g}")
        return result

    def rate(self, t: float, y: Floats) -> Floats:
        """`free`, and nothing for what is at rest."""
        result = self.free(t, y)
        result[self.held] = 0.0
        return result


@dataclass(frozen=True)
class Segment:
    """From one break of the input to the next: `fun` is evaluated within [first, last] only, on this side of either break."""

    end: float
    first: float = -math.inf
    last: float = math.inf


def segments(task: Task) -> list[Segment]:
    """The time span, cut at its breaks."""
    broken = set(task.breaks.tolist())
    edges = [task.start, *(t for t in task.breaks.tolist() if task.start < t < task.end), task.end]
    found = []
    for low, high in pairwise(edges):
        nearest = 0.25 * (high - low)
        first = low + min(nearest, BESIDE * float(np.spacing(abs(low)))) if low in broken else -math.inf
        last = high - min(nearest, BESIDE * float(np.spacing(abs(high)))) if high in broken else math.inf
        found.append(Segment(high, first, last))
    return found


@dataclass
class Trace:
    """What a method produces: times, states and pieces of the dense output."""

    times: list[float]
    states: list[Floats]
    pieces: list[Piece]
    steps: int = 0
    status: int = 0
    message: str = ""


class Method(abc.ABC):
    """A way to integrate an equation with memory; subclasses are frozen dataclasses of parameters, with the source in their docstring and as `references`."""

    references: ClassVar[tuple[str, ...]]
    _follows_slip: ClassVar[bool] = False  # whether it takes a VaryingSlipKernel

    @abc.abstractmethod
    def _integrate(self, task: Task, trace: Trace) -> None:
        """Advance from task.start to task.end, appending to `trace`; raise SolverError when it cannot go on."""


def off_surfaces(task: Task) -> Task:
    """The task; if a body starts on a surface (or beyond it by rounding) and heads through it, from a state before it: only changes of sign are seen."""
    start, y0, short = task.start, task.y0, 1e-6 * (task.end - task.start)

    def before(event: Event, shifts: Floats, far: float) -> Floats | None:
        """y0 moved that far against the event's direction, if that comes before its surface."""
        values = np.array([event.value(start, y0 + shift) for shift in np.diag(shifts)]) - event.value(start, y0)
        slope = values / np.where(shifts > 0.0, shifts, 1.0)
        if not slope.any():
            return None
        moved = np.asarray(y0 - event.direction * far * slope / (slope @ slope))
        return moved if event.value(start, moved) * event.direction < 0.0 else None

    for event in task.events:
        if event.jump is None or event.direction == 0.0 or not (beyond := event.value(start, y0) * event.direction) >= 0.0:
            continue
        near, rounding = np.abs(y0).max(), 256.0 * float(np.spacing(np.abs(y0).max()))
        if beyond > 0.0 and before(event, np.full(len(y0), 1e-8 * near), rounding) is None:
            continue
        ahead = y0 + short * task.free(start, y0)
        ahead = ahead + short * task.free(start + short, ahead)  # from rest the first one does not move it
        if event.value(start + 2.0 * short, ahead) * event.direction <= beyond:
            continue
        moved = before(event, 1e-8 * np.maximum(np.abs(y0), np.abs(ahead - y0).max()), max(rounding, 1e-12 * float(np.abs(ahead - y0).max())))
        y0 = y0 if moved is None else moved
    return task if y0 is task.y0 else replace(task, y0=y0)


def traced(task: Task, method: Method) -> tuple[Task, Trace]:
    """The task as it was solved, and what the method produced, up to where it is finite; what goes wrong is a status."""
    trace = Trace([task.start], [task.y0.copy()], [])
    try:
        task = off_surfaces(task)
        method._integrate(task, trace)
    except SolverError as error:
        trace.status, trace.message = -1, str(error) + "."
    whole = np.isfinite(trace.states).all(axis=1)
    if not whole.all():
        last = max(1, int(whole.argmin()))
        if trace.status >= 0:
            trace.status, trace.message = -1, f"The solution overflows double precision after t = {trace.times[last - 1]:.6g}."
        trace.times, trace.states = trace.times[:last], trace.states[:last]
        trace.pieces = [piece for piece in trace.pieces if piece.end <= trace.times[-1]]
    return task, trace


def solution_of(task: Task, method: Method, dense_output: bool, wanted: Floats | None) -> Solution:
    """The solution of one system."""
    task, trace = traced(task, method)
    return finished(
        task, np.array(trace.times), np.array(trace.states), trace.pieces, [np.array(event.times) for event in task.events],
        [np.array(event.states).reshape(len(event.states), len(task.y0)) for event in task.events],
        (task.nfev, trace.steps), trace.status, trace.message or MESSAGES[trace.status], dense_output, wanted,
    )  # fmt: skip


def finished(
    task: Task, times: Floats, states: Floats, pieces: list[Piece], t_events: list[Floats], y_events: list[Floats],
    counts: tuple[int, int], status: int, message: str, dense_output: bool, wanted: Floats | None,
) -> Solution:  # fmt: skip
    """The solution from times (k,) and states (k, n) at the ends of steps, at the wanted ones; `counts`: of calls and steps."""
    path = Path(pieces, states[-1]) if pieces and (dense_output or wanted is not None) else None
    y = states.T
    if wanted is not None:
        times = wanted[wanted <= times[-1]]
        y = path(times) if path is not None else np.repeat(task.y0[:, None], len(times), axis=1)
    return Solution(times, y, path if dense_output else None, t_events, y_events, *counts, status, message)
