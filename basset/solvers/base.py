"""What all methods share: the problem as they see it, events, the answer, and the entry point `solve`."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.evaluate import _converted
from basset.kernels import BassetKernel, Floats, Kernel

BESIDE = 4.0  # units in the last place between a break and where `fun` is asked: the user's own arithmetic may be off by some
REST = 1e-10  # a flight shorter than this share of the time span counts as rest

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
        ValueError
            Outside the solved span.
        """
        times = _converted("t", t)
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
        """Whether the span was solved, or left by an event."""
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
    """One event function with SciPy's attributes and `jump`."""

    function: Callable[..., Any]
    args: tuple[Any, ...]
    index: int
    terminal: int = 0  # the occurrence that ends the run, 0 for none
    direction: float = 0.0
    jump: Callable[..., Any] | None = None
    times: list[float] = field(default_factory=list)
    states: list[Floats] = field(default_factory=list)
    side: float = 0.0  # sign of the function before the last crossing
    fresh: bool = False  # has just happened: the function is zero there, but for `noise`
    bounced: bool = False  # its jump did not let the state through
    noise: float = 0.0  # what rounding of time and states is worth in the function at the last jump
    reach: float = 0.0  # how far the function has been on its side since
    hit: Floats | None = None  # what its jump reversed or stopped, as it came; 0 in all other components
    pull: Callable[[float, Floats], float] | None = None  # of a body at rest: what draws it off the surface where positive

    def value(self, t: float, y: Floats) -> float:
        """The event function, checked; of a body at rest what draws it off."""
        if self.pull is not None:
            return self.pull(t, y)
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

    def crosses(self, before: float, after: float) -> bool:
        """Whether the change of sign from `before` to `after` counts."""
        if self.pull is not None:
            return before <= 0.0 < after
        if before == 0.0 or ((before > 0.0) == (after > 0.0) and after != 0.0):
            return False
        return self.direction == 0.0 or (self.direction > 0.0) == (before < 0.0)

    def cuts(self, times: int) -> bool:
        """Whether the occurrence of that number ends the step: a jump, the last one wanted, or a body drawn off."""
        return self.jump is not None or self.pull is not None or 0 < self.terminal <= times

    def settle(self, t: float, before: Floats, after: Floats, slope: Callable[[], float]) -> None:
        """Note what the jump has done."""
        here = self.value(t, after)
        self.noise, self.reach = self.rounding(t, after), 0.0
        self.fresh = abs(here) <= CLEAR * self.noise + 2.0 * abs(self.value(t, before))
        self.bounced = (slope() if self.fresh else here) * self.side >= 0.0

    def rounding(self, t: float, y: Floats) -> float:
        """What rounding of time and states is worth in the function there."""
        here, share = self.value(t, y), 2.0**-26
        total = abs(self.value(t * (1.0 + share), y) - here)
        for i in np.flatnonzero(y):
            moved = y.copy()
            moved[i] *= 1.0 + share
            total += abs(self.value(t, moved) - here)
        return total * 2.0**-27  # half a unit in the last place of each


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
    kernel: Kernel
    slip: Floats
    events: list[Event]
    max_steps: int
    breaks: Floats = field(default_factory=lambda: np.empty(0))  # rising
    nfev: int = 0
    held: list[int] = field(default_factory=list)  # components of bodies at rest: they stay as they are
    felt: Floats = field(init=False)  # the coefficient without those

    def __post_init__(self) -> None:
        self.felt = self.coefficient.copy()

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
        if self.held:
            result[self.held] = 0.0
        return result

    def hold(self) -> None:
        """Bring up to date what is at rest."""
        self.held = sorted({int(i) for event in self.events if event.pull is not None and event.hit is not None for i in np.flatnonzero(event.hit)})
        self.felt[:] = np.where(np.isin(self.memory, self.held), 0.0, self.coefficient)


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

    @abc.abstractmethod
    def _integrate(self, task: Task, trace: Trace) -> None:
        """Advance from task.start to task.end, appending to `trace`; raise SolverError when it cannot go on."""


def jumped(task: Task, event: Event, t: float, y: Floats) -> Floats:
    """The state after the event's jump, checked."""
    assert event.jump is not None
    after = returned(f"jump of event {event.index} must return {len(y)} states", event.jump(t, y.copy(), *event.args), len(y))
    if not np.isfinite(after).all():
        worst = int(np.flatnonzero(~np.isfinite(after))[0])
        raise SolverError(f"jump of event {event.index} gave {after[worst]} in component {worst} at t = {t:.6g}")
    return after


CLEAR = 64.0  # so many times its rounding an event function must be from zero to be on one side
HALVINGS = 6  # of a step, at most, until an interpolant follows an event function
FOLLOWED = 1e-10  # to this share of its size


@lru_cache(maxsize=16)
def chebyshev(degree: int) -> tuple[Floats, Floats]:
    """(points on [0, 1], rising; from values there to Chebyshev coefficients)."""
    x = np.sin(np.pi * (np.arange(degree + 1) / degree - 0.5))
    return 0.5 * (x + 1.0), np.linalg.inv(np.polynomial.chebyshev.chebvander(x, degree))


def watched(event: Event, piece: Piece, degree: int, power: int) -> tuple[Floats, Floats]:
    """(θ, values of the event function) between which it rises or falls, as far as an interpolant in θ^(1/power) can tell.

    Where one of that degree does not follow it, the step is halved, and at last signs of samples must do.
    """
    nodes, transform = chebyshev(degree)
    noise = -1.0

    def values(theta: Floats) -> Floats:
        return np.array([event.value(piece.start + piece.length * share, y) for share, y in zip(theta, piece.values(theta), strict=True)])

    def look(low: float, high: float, halvings: int) -> tuple[Floats, Floats]:
        nonlocal noise
        x = low + (high - low) * nodes
        found = values(x**power)
        size = np.abs(coefficients := transform @ found)
        if size[0] > 1.5 * size[1:].sum():  # far from zero
            return x, found
        tail = size[-2:].max()
        if tail > FOLLOWED * size.max():
            if noise < 0.0:
                noise = event.rounding(piece.start, piece.values(np.zeros(1))[0])
            if tail > CLEAR * noise:
                if not halvings:
                    return x, found
                middle = 0.5 * (low + high)
                left, right = look(low, middle, halvings - 1), look(middle, high, halvings - 1)
                return np.append(left[0], right[0][1:]), np.append(left[1], right[1][1:])
        slope = np.polynomial.chebyshev.chebder(coefficients[: np.flatnonzero(size > 1e-13 * size.max())[-1] + 1]) if size.any() else coefficients[:1]
        if abs(slope[0]) > np.abs(slope[1:]).sum():
            return x, found
        roots = np.polynomial.chebyshev.chebroots(slope)
        turns = np.sort(roots.real[(np.abs(roots.imag) < 1e-3) & (np.abs(roots.real) < 1.0)])
        turns = low + (high - low) * 0.5 * (turns + 1.0)
        places = np.append(x, turns)
        order = np.argsort(places)
        return places[order], np.append(found, values(turns**power))[order]

    x, found = look(0.0, 1.0, HALVINGS)
    return x**power, found


def first_crossing(events: Sequence[Event], piece: Piece, degree: int, power: int) -> tuple[float, list[Event]]:
    """(θ, events) of the first crossing on a piece that cuts it; (inf, []) if none does, θ = 0 if a jump left no flight.

    Crossings that do not cut are recorded on the way. `degree`, `power`: see `watched`.
    """
    found: list[tuple[float, Event]] = []
    begun: dict[int, float] = {}  # where an event that has just happened may happen again
    for event in events:
        places, signs = watched(event, piece, degree, power)
        first, last = 0, len(places)
        noise = event.noise + 2.0**-46 * np.abs(signs).max() if event.fresh else 0.0
        if event.fresh and event.bounced:  # from where the flight has begun; without one it rests
            if signs[1] * event.side <= CLEAR * noise:
                sooner = places[1] * np.geomspace(1e-12, 0.5, 40)
                values = [event.value(piece.start + piece.length * theta, y) for theta, y in zip(sooner, piece.values(sooner), strict=True)]
                places, signs = np.insert(places, 1, sooner), np.insert(signs, 1, values)
            first = next((k for k in range(1, len(places)) if signs[k] * event.side > CLEAR * noise), 0)
            if not first:
                return 0.0, [event]
        elif event.fresh:  # from where it is no longer zero
            first = next((k for k in range(1, len(places)) if abs(signs[k]) > CLEAR * noise), len(places))
        begun[event.index] = places[first] if first < len(places) else math.inf
        for k in range(first, len(places) - 1):
            if event.crosses(signs[k], signs[k + 1]):
                found.append((_root(event, piece, places[k], places[k + 1], signs[k + 1]), event))
                if event.pull is None:
                    event.side = math.copysign(1.0, signs[k])
                if event.cuts(1):
                    last = k + 1
                    break
        if event.bounced:
            event.reach = max(event.reach, float((signs[first:last] * event.side).max(initial=0.0)))
    found.sort(key=lambda entry: entry[0])
    times = {event.index: len(event.times) for event in events}
    cut, together = math.inf, []
    for theta, event in found:
        if theta > cut * (1.0 + 1e-13):
            break
        times[event.index] += 1
        if event.cuts(times[event.index]):
            cut = min(cut, theta)
            together.append(event)
            continue
        t, y = piece.start + piece.length * theta, piece.values(np.array([theta]))[0]
        event.times.append(t)
        event.states.append(y)
    for event in events:
        event.fresh = event.fresh and bool(cut <= begun[event.index])
    return cut, together


def _root(event: Event, piece: Piece, low: float, high: float, after: float) -> float:
    from scipy.optimize import brentq  # takes a quarter of a second to import

    def value(theta: float) -> float:
        return event.value(piece.start + piece.length * theta, piece.values(np.array([theta]))[0])

    ends = value(low), value(high)
    if after == 0.0 or ends[1] == 0.0:
        return high
    if (ends[0] > 0.0) == (ends[1] > 0.0):  # so close to zero that rounding decides
        return low if abs(ends[0]) < abs(ends[1]) else high
    return float(brentq(value, low, high, xtol=1e-16, rtol=1e-15))


def slope(task: Task, event: Event, t: float, y: Floats) -> float:
    """How much the event function changes within a moment; 0 where it cannot be told from rounding or is of second order."""
    rate, here, span = task.rate(t, y), event.value(t, y), task.end - task.start
    ahead = max(1e-8 * span, 1024.0 * math.ulp(t))
    while ahead <= 1e-2 * span:
        one, two, four = (event.value(t + share * ahead, y + share * ahead * rate) - here for share in (1.0, 2.0, 4.0))
        if one != 0.0 and abs(two - 2.0 * one) <= 0.25 * abs(two) and abs(four - 2.0 * two) <= 0.25 * abs(four):
            return one
        ahead *= 32.0
    return 0.0


def fire(task: Task, trace: Trace, events: Sequence[Event], t: float, y: Floats, moment: float, memory: Callable[[float], Floats]) -> tuple[Floats, bool]:
    """Record events at (t, y), apply their jumps in turn, let bodies rest and go: (state after, whether to stop).

    `moment`: the shortest flight there is; `memory`: H of the components in memory, from t on, if nothing at rest moves.
    """
    resting, after = [], y
    for event in events:
        if event.pull is not None:  # drawn off
            event.pull, event.fresh, event.reach = None, True, 0.0
            continue
        since = t - event.times[-1] if event.times else math.inf
        event.times.append(t)
        event.states.append(after.copy())
        if event.jump is not None:
            before, after = after, jumped(task, event, t, after)
            if since > 0.0:
                stopped = (after != before) & (after * before <= 0.0)
                event.hit = np.where(stopped, before, 0.0)
            if event.bounced and (since < moment or event.reach <= CLEAR * event.noise):
                resting.append(event)
        if 0 < event.terminal <= len(event.times):
            trace.status = 1
    for event in task.events:
        if event.pull is not None and event.hit is not None and after[event.hit != 0.0].any():  # the jump of another one has set it going
            event.pull, event.fresh, event.reach = None, True, 0.0
    task.hold()
    for event in events:
        if event.jump is not None:
            event.settle(t, y, after, partial(slope, task, event, t, after))
    if resting and trace.status == 0:
        still = after.copy()
        if all(_rests(task, event, t, still, memory) for event in resting):
            task.hold()
            bouncing = [event for event in task.events if event.jump is not None and event.pull is None]
            left = task.rate(t, still)
            left[task.memory] -= task.felt * memory(t)
            if bouncing or left.any():
                return still, False
        trace.status = 2
    return after, trace.status != 0


def _rests(task: Task, event: Event, t: float, y: Floats, memory: Callable[[float], Floats]) -> bool:
    """Hold what the event's jump reverses or stops, in place; False if that is not all it does or would not stay."""
    assert event.hit is not None
    hit, stopped = event.hit, event.hit != 0.0
    incoming = np.where(stopped, hit, y)
    y[stopped] = 0.0
    other = np.abs(jumped(task, event, t, incoming) - incoming)[~stopped]
    if (other > 1e-14 * np.abs(y[~stopped])).any() or slope(task, event, t, y) != 0.0:
        return False  # friction, or a surface that moves

    def pull(time: float, state: Floats) -> float:
        rate = task.free(time, state)
        rate[task.memory] -= task.coefficient * memory(time)
        return float(-hit @ rate) / float(np.abs(hit).max())

    if not stopped.any() or pull(t, y) > 0.0:
        return False
    event.pull, event.fresh = pull, False
    return True


def solve(
    fun: Callable[..., Any],
    t_span: tuple[float, float],
    y0: ArrayLike,
    memory: Sequence[int] = (0,),
    coefficient: ArrayLike = 1.0,
    kernel: Kernel = BassetKernel(),
    initial_slip: ArrayLike | None = None,
    args: tuple[Any, ...] = (),
    method: Method | None = None,
    t_eval: ArrayLike | None = None,
    events: Callable[..., Any] | Sequence[Callable[..., Any]] | None = None,
    dense_output: bool = False,
    max_steps: int = 1_000_000,
    breaks: ArrayLike = (),
) -> Solution:
    """Solve y' = fun(t, y) − coefficient·H[y], the history acting on the components in `memory`.

    H[y](t) = Σ_j Δ_j K(t − t_j) + ∫ K(t − τ) y'(τ) dτ, the jumps Δ_j being the initial slip and those of events.

    Parameters
    ----------
    fun : callable
        fun(t, y, *args) -> rates (n_states,) without the history.
    t_span : (float, float), seconds
        Start and end, rising.
    y0 : array_like (n_states,), units of the states
        State at the start. The components in `memory` are slips: velocities relative to the fluid.
    memory : sequence of int, one per member
        Which components remember and feel −coefficient·H of themselves.
    coefficient : float or array_like (members,), s^(-1/2)
        0 or greater.
    kernel : Kernel
        What is remembered.
    initial_slip : array_like (members,) or None, units of the states
        The first jump; None: y0[memory] (the sphere was at rest relative to the fluid); zeros: no memory of the start.
    args : tuple
        Further arguments of fun, events and jumps; for a compiled fun numbers, arrays, and lists that become arrays.
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

    Returns
    -------
    Solution

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
    task = _task(fun, t_span, y0, memory, coefficient, kernel, initial_slip, args, events, max_steps, breaks)
    wanted = _wanted(t_eval, task)
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
    kernel: Kernel,
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
    state = np.atleast_1d(_converted("y0", y0)).astype(np.float64)
    if state.ndim != 1 or not len(state):
        raise ValueError(f"y0 must be one-dimensional with at least one state, got shape {np.shape(y0)}")
    if not np.isfinite(state).all():
        raise ValueError(f"y0 must be finite, got {_validate.shown(y0)}")
    if isinstance(memory, (int, np.integer)):
        memory = [int(memory)]
    if isinstance(memory, str) or not np.iterable(memory):
        raise TypeError(f"memory must be a list of component numbers, got {_validate.shown(memory)}")
    indices = [_validate.integer("memory", index, 0, len(state) - 1) for index in memory]
    if len(set(indices)) != len(indices):
        raise ValueError(f"memory must name each component once, got {indices}")
    strength = np.asarray(_converted("coefficient", coefficient))
    if strength.ndim and strength.shape != (len(indices),):
        raise ValueError(f"coefficient must be a number or have one entry per component in memory ({len(indices)}), got shape {strength.shape}")
    if not (np.isfinite(strength).all() and (strength >= 0.0).all()):
        raise ValueError(f"coefficient must be finite and 0 or greater (s^(-1/2)), got {_validate.shown(coefficient)}")
    if not isinstance(kernel, Kernel):
        raise TypeError(f"kernel must be a kernel such as basset.BassetKernel(), got {_validate.shown(kernel)}")
    slip = state[indices] if initial_slip is None else np.atleast_1d(_converted("initial_slip", initial_slip))
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
    if any(isinstance(value, (list, np.ndarray)) for value in args):
        from basset._compile import is_compiled  # loads the compiler

        if is_compiled(fun):
            args = tuple(_parameter(index, value) for index, value in enumerate(args))
    return Task(
        fun, args, start, end, state, np.array(indices, dtype=np.intp), np.broadcast_to(strength, (len(indices),)).astype(np.float64),
        kernel, slip.astype(np.float64), listed, _validate.integer("max_steps", max_steps, 1), _broken(breaks),
    )  # fmt: skip


def _broken(breaks: ArrayLike) -> Floats:
    """The breaks, checked, each once and rising."""
    times = np.atleast_1d(_converted("breaks", breaks))
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
    times = _converted("t_eval", t_eval)
    rising = times.ndim == 1 and bool(np.isfinite(times).all()) and not (np.diff(times) < 0.0).any()
    if not rising:
        raise ValueError(f"t_eval must be rising times within t_span ({task.start:g}, {task.end:g}), got {_validate.shown(t_eval)}")
    slack = rounding(task.start, task.end)
    if len(times) and not (times[0] >= task.start - slack and times[-1] <= task.end + slack):
        low, high, came = outside(times, task.start, task.end)
        raise ValueError(f"t_eval must be rising times within t_span ({low}, {high}), got {came}")
    return np.clip(times, task.start, task.end)
