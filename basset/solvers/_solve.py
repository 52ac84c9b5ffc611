"""The entry point `solve`, and the checks of its arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel, VaryingSlipKernel, checked_kernel
from basset.solvers.base import Event, Method, Solution, Task, outside, rounding, solution_of
from basset.solvers.collocation import Collocation

SHORTEST = 1e-280  # s, of a span: the shortest lags are 1e-12 of it, and their exponentials have to be numbers


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
        State at the start. The components in `memory` are slips: velocities relative to the fluid. A column for each of many independent systems:
        each takes its own steps, and its solution is bitwise that of solving it alone.
    memory : sequence of int, one per member
        Components on which −coefficient·H of themselves acts.
    coefficient : float or array_like (members,) or (members, n_systems), s^(-1/2)
        0 or greater.
    kernel : Kernel or VaryingSlipKernel
        The memory kernel K. With a VaryingSlipKernel all components in `memory` form one slip vector, at whose magnitude the kernel is evaluated
        (Collocation only, slip_at="t").
    initial_slip : array_like (members,) or (members, n_systems) or None, units of the states
        The first jump; None: y0[memory] (the sphere was at rest relative to the fluid); zeros: no memory of the start.
    args : tuple
        Further arguments of fun, events and jumps; for a compiled fun numbers, arrays, and lists that become arrays. With many
        systems an array whose last axis has n_systems entries is split: each system gets its own entry.
    method : Method or None
        Collocation(rtol=1e-6) by default; FixedStep(dt, rule); RungeKutta4(dt, rule).
    t_eval : array_like (n_times,) or None, seconds
        Times at which to give the solution; None: the ends of the steps.
    events : callable or list of callables, or None
        event(t, y, *args) -> float, an event where it changes sign. Attributes: `terminal` (bool, or the number of occurrences
        after which to stop, as in SciPy), `direction` (−1, 0, 1) and `jump`, a function (t, y, *args) -> y after: the state
        changes there and the change is remembered. A zero at the very start is no event, but for a jump with a direction in which
        the function then goes: a body that starts on its floor does not fall through it. One that starts
        beyond it is not sent back.
    dense_output : bool
        Whether to return the solution as a function of time.
    max_steps : int
        The largest number of steps; the integration fails beyond it.
    breaks : array_like (n_breaks,), seconds
        Times at which `fun` is discontinuous or has a kink, in any order; those outside the time span are ignored. A step ends at each, and the next
        one starts afresh with the rate after it. `fun` is never evaluated at a break itself but a few units in the last place before it, and after
        it. Both ends of a pulse that may be narrower than a step must be given here. Fixed steps take breaks that lie on their nodes.
    workers : int
        Threads for many systems. With compiled functions (numba.njit) they run side by side, otherwise one after the other.

    Returns
    -------
    Solution
        For many systems every field has one more, last axis, or is a list where lengths differ: y (n_states, n_times,
        n_systems) with `t_eval`, NaN after a system's own end; otherwise lists of t and y; t_events[event][system]; status (n_systems,).

    Raises
    ------
    ValueError, TypeError
        One sentence that names the argument. A failure on the way (NaN from fun, steps too small) is a status.

    Notes
    -----
    fun, events and jumps get copies of the state, and what they return is copied: they may write into it and reuse it.

    Collocation follows every event function on every step by an interpolant that is exact for quadratic functions of the
    states, halving the step up to six times where it does not fit; shorter excursions may be missed unless `max_step` limits the steps. Fixed steps
    compare the values at the nodes.

    Where fun is discontinuous in the state and both sides drive the state into the discontinuity, as under sticking friction, Collocation slides
    along it: the rate is the mean of both sides that keeps the state there (Filippov), to a tenth of the tolerance. It ends in status −1 where the
    discontinuity is not a surface, or is crossed at ever shorter intervals.

    A body comes to rest at an event with a jump: when a flight between two jumps is shorter than 1e-10 of the time span, or too low to be told from
    rounding (with fixed steps: shorter than a step, or not out of the surface again), the components that the jump reverses or stops are held at 0,
    without friction and without history force, until fun pulls them off the surface or another jump sets them going. The run ends with status 2 when
    all events with a jump are at rest and nothing else moves, or when a body cannot be held: the jump also changes other components (friction), or
    the surface moves.

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
    return solution_of(task, method, dense_output, wanted)


def _columns(y0: ArrayLike, initial_slip: ArrayLike | None, coefficient: ArrayLike) -> list[Any]:
    """Arguments that may have a column per system, checked as a whole; `_task` checks the first column alone."""
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
    if not SHORTEST <= end - start < np.inf:
        raise ValueError(f"t_span must be {SHORTEST:g} s or longer and end - start a finite number, got ({start:g}, {end:g})")
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
    checked_kernel(kernel, VaryingSlipKernel)
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
    if any(not _is_plain(value) for value in args):
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


def _is_plain(given: Any) -> bool:
    """Whether an argument can go to compiled code as it is: a number that fits, or what numba knows and can tell apart."""
    return given.__hash__ is not None and not (type(given) is int and given.bit_length() > 63)


def _parameter(index: int, given: Any) -> Any:
    """A list, an array or a table of numbers for compiled code: a plain array, in C order; anything else as it is."""
    if _is_plain(given):
        return given
    try:
        array = np.asarray(given, order="C")
    except ValueError:
        array = np.empty(0, dtype=object)
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype.kind not in "fiub" or isinstance(given, int) or np.ma.isMaskedArray(given):
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
