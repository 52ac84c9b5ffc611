"""What all methods share: the problem as they see it, events, the answer, and the entry point `solve`."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel, VaryingSlipKernel

BESIDE = 4.0  # units in the last place between a break and where `fun` is asked: the user's own arithmetic may be off by some

MESSAGES = {
    0: "The solver reached the end of the time span.",
    1: "A terminal event occurred.",
    2: "At rest: a flight between two jumps was too short to be told from rest, and nothing else moves or can be told to go on.",
}


class SolverError(Exception):
    """The integration cannot go on; becomes status −1 and its message."""


@dataclass(frozen=True, eq=False)
class Piece:
    """The solution on [start, start + length] as a function of θ = (t − start)/length."""

    start: float
    length: float
    values: Callable[[Floats], Floats]  # θ (k,) -> (k, states)

    @property
    def end(self) -> float:
        """The last time."""
        return self.start + self.length

    def at(self, t: Floats) -> Floats:
        """States (k, states) at times (k,)."""
        return self.values(np.clip((t - self.start) / self.length, 0.0, 1.0))


class Path:
    """The solution as a function of time; at a jump its value is the one after it.

    Call it with a time or an array of times in the solved span: states (states,) or (states, times).

    Parameters
    ----------
    pieces : sequence of Piece
        One per step, in the order of time.
    final : ndarray (states,), units of the states
        The state at the end.

    Attributes
    ----------
    t_min, t_max : float, seconds
        The solved span.

    Examples
    --------
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
        """States at given times.

        Parameters
        ----------
        t : array_like (...), seconds
            Within the solved span.

        Returns
        -------
        ndarray (states, ...), units of the states

        Raises
        ------
        ValueError, TypeError
            Outside the solved span, or for what holds no numbers.
        """
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
    """What `basset.solve` returns; the fields follow scipy.integrate.solve_ivp.

    Attributes
    ----------
    t : ndarray (n_times,)
        Times, s. Without `t_eval` every step's end; the time of a jump appears twice, before and after.
    y : ndarray (n_states, n_times), units of the states
    sol : Path or None
        The solution as a function of time, with `dense_output=True`.
    t_events, y_events : list of ndarray
        Times (k,), s, and states before any jump (k, n_states), of each event.
    nfev, nsteps : int
        Evaluations of `fun`; accepted steps.
    status : int
        0 end reached, 1 terminal event, 2 at rest, −1 failure.
    message : str
        The status in words.
    success : bool
        Whether status ≥ 0.

    Examples
    --------
    >>> import basset
    >>> r = basset.solve(lambda t, y: [-1.0], (0.0, 2.0), [1.0], coefficient=0.0, t_eval=[0.5, 1.5])
    >>> r.success, r.t, r.y.round(12)
    (True, array([0.5, 1.5]), array([[ 0.5, -0.5]]))
    """

    t: Floats
    y: Floats
    sol: Path | None
    t_events: list[Floats]
    y_events: list[Floats]
    nfev: int
    nsteps: int
    status: int
    message: str

    @property
    def success(self) -> bool:
        """Whether the span was solved, or left by an event; of many systems, of each."""
        return self.status >= 0


def returned(what: str, given: Any, states: int) -> Floats:
    """What a callback gave, checked, in an array that is nobody else's."""
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
class Stretch:
    """From one break of the input to the next: `fun` is asked within [first, last] only, so it sees this side of either break."""

    end: float
    first: float = -math.inf
    last: float = math.inf


def stretches(task: Task) -> list[Stretch]:
    """The time span, cut at its breaks."""
    broken = set(task.breaks.tolist())
    edges = [task.start, *(t for t in task.breaks.tolist() if task.start < t < task.end), task.end]
    found = []
    for low, high in pairwise(edges):
        nearest = 0.25 * (high - low)
        first = low + min(nearest, BESIDE * float(np.spacing(abs(low)))) if low in broken else -math.inf
        last = high - min(nearest, BESIDE * float(np.spacing(abs(high)))) if high in broken else math.inf
        found.append(Stretch(high, first, last))
    return found


@dataclass
class Trace:
    """What a method leaves behind."""

    times: list[float]
    states: list[Floats]
    pieces: list[Piece]
    steps: int = 0
    status: int = 0
    message: str = ""


class Method(abc.ABC):
    """A way to integrate an equation with memory; subclasses are frozen dataclasses of parameters.

    References
    ----------
    Each subclass names its own, in its docstring and as `references`.

    Examples
    --------
    >>> import basset
    >>> all(isinstance(method, Method) for method in (basset.Collocation(), basset.FixedStep(0.1), basset.RungeKutta4(0.1)))
    True
    """

    references: ClassVar[tuple[str, ...]]
    _follows_slip: ClassVar[bool] = False  # whether it takes a VaryingSlipKernel

    @abc.abstractmethod
    def _integrate(self, task: Task, trace: Trace) -> None:
        """Advance from task.start to task.end, appending to `trace`; raise SolverError when it cannot go on."""


def solve(
    fun: Callable[..., Any],
    t_span: tuple[float, float],
    y0: ArrayLike,
    memory: Sequence[int] = (0,),
    coefficient: ArrayLike = 1.0,
    kernel: Kernel | VaryingSlipKernel = BassetKernel(),
    initial_slip: ArrayLike | None = None,
    args: tuple[Any, ...] = (),
    method: Method | None = None,
    t_eval: ArrayLike | None = None,
    events: Callable[..., Any] | Sequence[Callable[..., Any]] | None = None,
    dense_output: bool = False,
    max_steps: int = 1_000_000,
    breaks: ArrayLike = (),
    workers: int = 1,
) -> Solution:
    """Solve y' = fun(t, y) − coefficient·H[y], the history acting on the components in `memory`.

    H[y](t) = Σ_j Δ_j K(t − t_j) + ∫ K(t − τ) y'(τ) dτ, the jumps Δ_j being the initial slip and those of events.

    Parameters
    ----------
    fun : callable
        fun(t, y, *args) -> rates (n_states,) without the history.
    t_span : (float, float), seconds
        Start and end, rising.
    y0 : array_like (n_states,) or (n_states, n_systems), units of the states
        State at the start. The components in `memory` are slips: velocities relative to the fluid. A column for each of many
        independent systems: each goes on its own steps, to the bits of a solution on its own.
    memory : sequence of int, one per member
        Which components remember and feel −coefficient·H of themselves.
    coefficient : float or array_like (members,) or (members, n_systems), s^(-1/2)
        0 or greater.
    kernel : Kernel or VaryingSlipKernel
        What is remembered. With a VaryingSlipKernel all members are one slip, whose size the kernel follows (Collocation only, slip_at="t").
    initial_slip : array_like (members,) or (members, n_systems) or None, units of the states
        The first jump; None: y0[memory] (the sphere was at rest relative to the fluid); zeros: no memory of the start.
    args : tuple
        Further arguments of fun, events and jumps; for a compiled fun numbers, arrays, and lists that become arrays. With many
        systems an array whose last axis has n_systems entries is shared out: each system gets its own.
    method : Method or None
        Collocation(rtol=1e-6) by default; FixedStep(dt, rule); RungeKutta4(dt, rule).
    t_eval : array_like (n_times,) or None, seconds
        Times at which to give the solution; None: the ends of the steps.
    events : callable or list of callables, or None
        event(t, y, *args) -> float, an event where it changes sign. Attributes: `terminal` (bool, or the number of occurrences
        after which to stop, as in SciPy), `direction` (−1, 0, 1) and `jump`, a function (t, y, *args) -> y after: the state
        changes there and the change is remembered. A zero at the very start is no event.
    dense_output : bool
        Whether to return the solution as a function of time.
    max_steps : int
        The integration fails beyond.
    breaks : array_like (n_breaks,), seconds
        Instants where `fun` jumps or has a kink in time, in any order; those outside the time span do not matter. A step ends
        at each, the next one starts anew with the rate after it. `fun` is never asked at a break itself but a few units in the
        last place before it, and after it. A pulse that may be narrower than a step has to be named here. Fixed steps take
        breaks that lie on their nodes.
    workers : int
        Threads for many systems. With compiled functions (numba.njit) they run side by side, otherwise one after the other.

    Returns
    -------
    Solution
        For many systems every field has a last axis more, or is a list where they differ in length: y (n_states, n_times,
        n_systems) with `t_eval`, NaN behind a system's own end; otherwise lists of t and y; t_events[event][system]; status (n_systems,).

    Raises
    ------
    ValueError, TypeError
        One sentence that names the argument. What goes wrong on the way (NaN from fun, steps too small) is a status.

    Notes
    -----
    fun, events and jumps get copies of the state, and what they return is copied: they may write into it and reuse it.

    Collocation follows every event function on every step by an interpolant that is exact for quadratic functions of the
    states, halving the step up to six times where it does not follow; what comes and goes within less is bounded by
    `max_step`. Fixed steps compare the nodes.

    Where fun jumps with the state and both sides push into the jump, as friction that sticks, Collocation slides along it:
    the rate is the mean of both sides that keeps the state there (Filippov), to a tenth of the tolerance. It ends in status −1
    where the jump is not on a surface, or is crossed ever faster.

    Rest belongs to an event: when a flight between two of its jumps is shorter than 1e-10 of the time span, or no higher
    than rounding lets see (with fixed steps: shorter than a step, or not out of the surface again), the components that the
    jump reverses or stops are held at 0, without friction and without history force, until fun draws them off the surface
    or another jump sets them going. The run ends with status 2 when all events with a jump are at rest and nothing else
    moves, and where a body cannot be held: the jump changes more than it reverses (friction), or the surface moves.

    References
    ----------
    Maxey & Riley (1983), Phys. Fluids 26, 883, for the equation of a sphere; thesis eq. 5-1. Sliding: Filippov (1988),
    Differential Equations with Discontinuous Righthand Sides. The jumps: this library. The integration: `method.references`.

    Examples
    --------
    A sphere that starts with slip 1 and relaxes, against the closed form:

    >>> import numpy as np, basset
    >>> r = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=basset.Collocation(rtol=1e-8))
    >>> r.message
    'The solver reached the end of the time span.'
    >>> from basset import reference
    >>> bool(abs(r.y[0, -1] - reference.relaxing(4.0, 1.0, 0.6)) < 1e-8)
    True
    """
    from basset.solvers.collocation import Collocation

    method = Collocation() if method is None else method
    if not isinstance(method, Method):
        raise TypeError(f"method must be a method such as basset.Collocation(rtol=1e-6), got {_validate.shown(method)}")
    if not callable(fun):
        raise TypeError(f"fun must be callable as fun(t, y), got {_validate.shown(fun)}")
    workers, many = _validate.integer("workers", workers, 1), np.ndim(y0) == 2
    given: list[Any] = [y0, initial_slip, coefficient]
    if many:
        given = _columns(*given)
    first = [value[:, 0] if many and np.ndim(value) == 2 else value for value in given]
    task = _task(fun, t_span, first[0], memory, first[2], kernel, first[1], args, events, max_steps, breaks)
    if isinstance(kernel, VaryingSlipKernel):
        if not method._follows_slip:
            raise ValueError(f"a VaryingSlipKernel needs method=Collocation(...), got {method!r}")
        if kernel.slip_at != "t":
            raise ValueError(f'the VaryingSlipKernel of solve must have slip_at="t", got "{kernel.slip_at}"')
    wanted = _wanted(t_eval, task)
    if many:
        from basset.solvers._many import columns_of, solve_many  # loads the compiler

        return solve_many(columns_of(task, *given), method, workers, dense_output, wanted)
    return settled(task, method, dense_output, wanted)


def _columns(y0: ArrayLike, initial_slip: ArrayLike | None, coefficient: ArrayLike) -> list[Any]:
    """What may have a column per system, checked as a whole; a single column, as _task looks at, stands for all."""
    found: list[Any] = []
    for name, value in (("y0", y0), ("initial_slip", initial_slip), ("coefficient", coefficient)):
        array = None if value is None else _validate.real_array(name, value).astype(np.float64)
        found.append(array)
        if array is None or array.ndim < 2:
            continue
        if array.ndim > 2 or array.shape[1] != found[0].shape[1] or not array.size:
            raise ValueError(f"{name} must have a row per component and a column for each of the systems of y0, got shape {array.shape}")
        if not np.isfinite(array).all() or (name == "coefficient" and (array < 0.0).any()):
            raise ValueError(f"{name} must be finite{' and 0 or greater' if name == 'coefficient' else ''} in all columns, got {_validate.shown(value)}")
    return found


def settled(task: Task, method: Method, dense_output: bool, wanted: Floats | None) -> Solution:
    """The solution of one system."""
    trace = Trace([task.start], [task.y0.copy()], [])
    try:
        method._integrate(task, trace)
    except SolverError as error:
        trace.status, trace.message = -1, str(error) + "."
    path = Path(trace.pieces, trace.states[-1]) if trace.pieces and (dense_output or wanted is not None) else None
    times, states = np.array(trace.times), np.array(trace.states).T
    if wanted is not None:
        times = wanted[wanted <= trace.times[-1]]
        states = path(times) if path is not None else np.repeat(task.y0[:, None], len(times), axis=1)
    return Solution(
        times,
        states,
        path if dense_output else None,
        [np.array(event.times) for event in task.events],
        [np.array(event.states).reshape(len(event.states), len(task.y0)) for event in task.events],
        task.nfev,
        trace.steps,
        trace.status,
        trace.message or MESSAGES[trace.status],
    )


def _task(
    fun: Callable[..., Any],
    t_span: tuple[float, float],
    y0: ArrayLike,
    memory: Sequence[int],
    coefficient: ArrayLike,
    kernel: Kernel | VaryingSlipKernel,
    initial_slip: ArrayLike | None,
    args: tuple[Any, ...],
    events: Any,
    max_steps: int,
    breaks: ArrayLike,
) -> Task:
    """The arguments of `solve`, checked."""
    try:
        start, end = t_span
    except (TypeError, ValueError):
        raise TypeError(f"t_span must be a pair (start, end) in seconds, got {_validate.shown(t_span)}") from None
    start, end = _validate.number("t_span[0]", start), _validate.number("t_span[1]", end)
    if end <= start:
        raise ValueError("t_span must rise, got ({}, {})".format(*_validate.apart(start, end)))
    state = np.atleast_1d(_validate.real_array("y0", y0)).astype(np.float64)
    if state.ndim != 1 or not len(state):
        raise ValueError(f"y0 must be one-dimensional with at least one state, or have a column per system, got shape {np.shape(y0)}")
    if not np.isfinite(state).all():
        raise ValueError(f"y0 must be finite, got {_validate.shown(y0)}")
    if isinstance(memory, (int, np.integer)):
        memory = [int(memory)]
    if isinstance(memory, str) or not np.iterable(memory):
        raise TypeError(f"memory must be a list of component numbers, got {_validate.shown(memory)}")
    indices = [_validate.integer("memory", index, 0, len(state) - 1) for index in memory]
    if len(set(indices)) != len(indices):
        raise ValueError(f"memory must name each component once, got {indices}")
    strength = np.asarray(_validate.real_array("coefficient", coefficient))
    if strength.ndim and strength.shape != (len(indices),):
        raise ValueError(f"coefficient must be a number or have one entry per component in memory ({len(indices)}), got shape {strength.shape}")
    if not (np.isfinite(strength).all() and (strength >= 0.0).all()):
        raise ValueError(f"coefficient must be finite and 0 or greater (s^(-1/2)), got {_validate.shown(coefficient)}")
    if not isinstance(kernel, (Kernel, VaryingSlipKernel)):
        raise TypeError(f"kernel must be a kernel such as basset.BassetKernel(), got {_validate.shown(kernel)}")
    slip = state[indices] if initial_slip is None else np.atleast_1d(_validate.real_array("initial_slip", initial_slip))
    if slip.shape != (len(indices),) and slip.size == 1:
        slip = np.repeat(slip, len(indices))
    if slip.shape != (len(indices),) or not np.isfinite(slip).all():
        raise ValueError(f"initial_slip must hold {len(indices)} finite numbers, one per component in memory, got {_validate.shown(initial_slip)}")
    if not isinstance(args, tuple):
        raise TypeError(f"args must be a tuple, got {_validate.shown(args)}")
    if not (events is None or callable(events) or np.iterable(events)):
        raise TypeError(f"events must be a callable event(t, y) or a list of them, got {_validate.shown(events)}")
    functions = [] if events is None else [events] if callable(events) else list(events)
    listed = []
    for index, function in enumerate(functions):
        if not callable(function):
            raise TypeError(f"events must be callables event(t, y), got {_validate.shown(function)}")
        jump = getattr(function, "jump", None)
        if jump is not None and not callable(jump):
            raise TypeError(f"jump of event {index} must be callable as jump(t, y), got {_validate.shown(jump)}")
        direction = _validate.number(f"direction of event {index}", getattr(function, "direction", 0.0))
        listed.append(Event(function, args, index, _terminal(index, getattr(function, "terminal", None)), direction, jump))
    data: tuple[Any, ...] | None = args
    if any(isinstance(value, (list, np.ndarray)) for value in args):
        from basset._compile import is_compiled  # loads the compiler

        try:
            data = tuple(_parameter(index, value) for index, value in enumerate(args))
        except TypeError:
            if is_compiled(fun):
                raise
            data = None
        if is_compiled(fun):
            args = data or ()
    return Task(
        fun, args, start, end, state, np.array(indices, dtype=np.intp), np.broadcast_to(strength, (len(indices),)).astype(np.float64),
        kernel, slip.astype(np.float64), listed, _validate.integer("max_steps", max_steps, 1), _broken(breaks), data,
    )  # fmt: skip


def _broken(breaks: ArrayLike) -> Floats:
    """The breaks, checked, each once and rising."""
    times = np.atleast_1d(_validate.real_array("breaks", breaks))
    if times.ndim != 1 or not np.isfinite(times).all():
        raise ValueError(f"breaks must be a list of finite times in seconds, got {_validate.shown(breaks)}")
    return np.unique(times)


def _terminal(index: int, given: Any) -> int:
    """Which occurrence of an event ends the run, as SciPy counts; 0 for none."""
    if given is None or isinstance(given, (bool, np.bool_)):
        return int(bool(given))
    try:
        return _validate.integer("terminal", given, 0)
    except (TypeError, ValueError):
        wrong = f"terminal of event {index} must be True, False or the number of occurrences after which to stop, got {_validate.shown(given)}"
        raise (ValueError if isinstance(given, (int, float, np.number)) else TypeError)(wrong) from None


def _parameter(index: int, given: Any) -> Any:
    """A list or an array for compiled code: a plain array, in C order; anything else as it is."""
    if not isinstance(given, (list, np.ndarray)):
        return given
    try:
        array = np.asarray(given, order="C")
    except ValueError:
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "fiub" or not array.dtype.isnative or np.ma.isMaskedArray(given):
        raise TypeError(f"args[{index}] of a compiled fun must be a number or an array of numbers with equal rows, got {_validate.shown(given)}")
    return array


def _wanted(t_eval: ArrayLike | None, task: Task) -> Floats | None:
    if t_eval is None:
        return None
    times = _validate.real_array("t_eval", t_eval)
    rising = times.ndim == 1 and bool(np.isfinite(times).all()) and not (np.diff(times) < 0.0).any()
    if not rising:
        raise ValueError(f"t_eval must be rising times within t_span ({task.start:g}, {task.end:g}), got {_validate.shown(t_eval)}")
    slack = rounding(task.start, task.end)
    if len(times) and not (times[0] >= task.start - slack and times[-1] <= task.end + slack):
        low, high, came = outside(times, task.start, task.end)
        raise ValueError(f"t_eval must be rising times within t_span ({low}, {high}), got {came}")
    return np.clip(times, task.start, task.end)
