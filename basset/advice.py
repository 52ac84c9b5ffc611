"""Which scheme for this accuracy, length and number of particles: predicted error, time and bytes of every candidate.

Errors come from the schemes themselves, run on a signal of the given time scale (or on the user's own samples) with the
step and the kernel asked for; times from a few constants of this machine, measured once in about a second and cached.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import __version__, _validate, measure
from basset.evaluate import cumulate
from basset.exponentials import ExponentialSum
from basset.kernels import BassetKernel, Floats, Kernel, checked_kernel
from basset.quadrature import Daitche, Exponential, Hinsberg, Rule, Windowed, by_default
from basset.solvers.stability import longest_step
from basset.streaming import LONGEST
from basset.weights import Recipe

__all__ = ["Advice", "Candidate", "Machine", "advise", "calibrated"]

USES = ("stream", "path")
MARGINS = {"model": 3.0, "samples": 2.0}  # on predicted errors: a signal differs from the model, a path from its samples
TAIL_SHARE = 0.2  # of the error allowed, for what a sum of exponentials loses
STEPS = 4096  # of a signal on which schemes are tried, at most; errors of shorter steps go by the declared order
SCALES = 30.0  # length of the model in time scales, at most
HIGHEST = 8  # degree of a product rule that is considered
BLOCK = 64  # steps of a window before a tail
SIZES = 2.0 ** (-np.arange(-4, 49) / 4.0)  # steps that are considered, in time scales
REFERENCE = Daitche(10)  # at less than 1/32 of a time scale
ROUNDING = 1e-14  # of the largest |H|, that no scheme gets below: sums over a path by FFT
SPLINE = 7  # degree between given samples
MOST = 10**15  # of whatever is counted: beyond, a float no longer does
COARSEST = 1e3  # time scales in a step
EXTREMES = 1e-200, 1e200  # s: of time scales and durations, whose roots and quotients must be numbers
RESOLVED = 2.0  # samples per time scale, at least


@dataclass(frozen=True)
class Machine:
    """Measured times of this machine, in seconds."""

    call: float  # a short call of a stream
    path: float  # a short call of a path by FFT
    step: float  # a stream, per step
    column: float  # a stream, per step and column
    node: float  # a stream, per step, column and remembered node
    term: float  # a stream, per step, column and exponential
    stall: float  # a stream, per step and column, where a window's nodes fill whole vectors: the newest one is read before it is written
    whole: float  # a stream, per step and column, while the whole history is kept
    transform: float  # a path by FFT, per step and column: times log2 of the steps
    spill: float  # a path by FFT, per step and column, on top where it does not fit into a fast cache


@dataclass(frozen=True)
class Candidate:
    """One scheme with its predictions.

    Attributes
    ----------
    rule : Rule
    dt : float, seconds
    steps : int
    error : float, dimensionless
        Predicted error in the measure of `advise`, with a safety margin.
    seconds : float
        Predicted time of all steps and particles, without the scheme's set-up (milliseconds, once).
    nbytes : int
        Memory for all particles in bytes, apart from the samples and H.
    meets : bool
        Whether error and memory stay within what was asked for.

    Examples
    --------
    >>> candidate = Candidate(Exponential(3, 1e-6), 0.1, 100, 1e-4, 1e-3, 10_000, True)
    >>> candidate.code
    'basset.Exponential(order=3, rtol=1e-06)'
    """

    rule: Rule
    dt: float
    steps: int
    error: float
    seconds: float
    nbytes: int
    meets: bool

    @property
    def code(self) -> str:
        """The Python expression of the rule."""
        return code(self.rule)


def code(rule: Rule) -> str:
    """The Python expression of a rule."""
    if not isinstance(rule, Windowed) or rule.tail is None:
        return f"basset.{rule!r}".replace("rule=", "rule=basset.")
    tail = rule.tail
    kernel = "" if isinstance(tail.kernel, BassetKernel) else f", basset.{tail.kernel!r}"
    return f"basset.Windowed({code(rule.rule)}, {rule.window!r}, basset.ExponentialSum.fit({tail.near!r}, {tail.far!r}, {tail.rtol!r}{kernel}))"


@dataclass(frozen=True)
class Advice:
    """All candidates: first those within the error and memory asked for, the fastest first.

    Attributes
    ----------
    candidates : tuple of Candidate
    error : float, dimensionless
        The error that was asked for, relative to the largest |H|.
    time_scale : float, seconds
        As given, or as found in the samples.

    Examples
    --------
    >>> poor, good = (Candidate(Daitche(p), 0.1, 100, error, 1e-3, 10_000, error < 1e-4) for p, error in ((1, 1e-3), (3, 1e-5)))
    >>> Advice((good, poor), 1e-4, 1.0).best is good
    True
    """

    candidates: tuple[Candidate, ...]
    error: float
    time_scale: float

    @property
    def best(self) -> Candidate:
        """The fastest candidate within the error and memory asked for.

        Raises
        ------
        ValueError
            If there is none.
        """
        if not self.candidates:
            raise ValueError(f"time_scale must be long enough for some scheme to resolve it, got {self.time_scale:g} s: take a smaller dt")
        first = self.candidates[0]
        if first.meets:
            return first
        if first.error <= self.error:
            least = min(candidate.nbytes for candidate in self.candidates if candidate.error <= self.error)
            raise ValueError(f"memory must be at least {least} bytes for this error")
        raise ValueError(f"error must be {first.error:.1e} or greater for this step and kernel, got {self.error:g}: take a smaller dt")


def advise(
    error: float,
    *,
    time_scale: float | None = None,
    samples: ArrayLike | None = None,
    sample_step: float | None = None,
    dt: float | None = None,
    steps: int | None = None,
    duration: float | None = None,
    particles: int = 1,
    components: int = 3,
    kernel: Kernel = BassetKernel(),
    memory: float = math.inf,
    use: str = "stream",
    machine: Machine | None = None,
    relaxation: float | None = None,
    coefficient: float | None = None,
) -> Advice:
    """Rank every scheme by predicted error, time and bytes, and say which one to take.

    The prediction is for rates that are smooth from the start on. An initial slip costs no accuracy where it is given as such
    (`initial_slip`, `plan.jump`); a rate that starts like √t or 1/√t, as in an equation with memory after a jump, or that
    has kinks leaves every scheme here with an error of h^(3/2) at best, which no degree removes: take
    `basset.Collocation` there, or `basset compare` on the samples.

    Parameters
    ----------
    error : float, dimensionless
        The largest error that is allowed on the path, relative to the largest |H|, from one time scale after its start on (no
        scheme is more accurate in the first steps than their few samples allow).
    time_scale : float, seconds, optional
        How fast the rate g = df/dt changes: the T with |k-th derivative of g| ≤ |g|/T^k. 1/ω for cos ωt, 1/λ for e^(−λt),
        the shortest where there are several.
    samples, sample_step : array_like (n+1, ...) and float (seconds), optional
        A finely sampled stretch of the rate itself, in place of the time scale: errors are then predicted for it, and a fast component that is weak
        counts less than a strong one. It should contain the largest |H| of the whole path.
    dt : float, seconds, optional
        The step; None: each candidate takes the longest one that keeps the error.
    steps : int, optional
        Number of steps, with dt.
    duration : float, seconds, optional
        Length of the path: with dt an alternative to `steps`, without dt required.
    particles, components : int
        Paths that are computed together, and components of each.
    kernel : Kernel
        The memory kernel K.
    memory : float, bytes
        The most memory that may be used, for all particles.
    use : {"stream", "path"}
        "stream": one sample after the other, as in a solver; "path": all samples are there (`basset.cumulate`).
    machine : Machine, optional
        Default: measured here, once (see `calibrated`).
    relaxation, coefficient : float (1/s) and float (s^(-1/2)), optional
        λ and c of the equation y' = −λy − c·H[y] that a stream is used in: steps at which an implicit solver diverges with a scheme
        (see `basset.FixedStep`) are left out. None: 1/T and 1/√T of the time scale T; 0 and 0 where H is not fed back.

    Returns
    -------
    Advice

    Raises
    ------
    ValueError, TypeError
        For what is out of range, where neither or both of time_scale and samples, or of steps and duration, are given, and
        where the samples do not resolve the rate.

    Notes
    -----
    The error of a step that was not tried is extrapolated with the scheme's declared order.

    References
    ----------
    The schemes' own `references`; the choice: this library.

    Examples
    --------
    >>> import basset
    >>> advice = basset.advise(1e-6, time_scale=1.0, dt=0.05, steps=10_000, particles=1000)
    >>> advice.best.error <= 1e-6
    True
    """
    error = _validate.positive("error", error)
    _validate.choice("use", use, USES)
    columns = _validate.integer("particles", particles, 1, MOST) * _validate.integer("components", components, 1, MOST)
    checked_kernel(kernel)
    if not memory > 0.0:
        raise ValueError(f"memory must be greater than 0 (bytes), got {memory}")
    length = _length(dt, steps, duration)
    if (time_scale is None) == (samples is None):
        raise ValueError("either time_scale (seconds) or samples must be given, and not both")
    if samples is None:
        signal = model(_validate.positive("time_scale", time_scale, "seconds"), length)
    elif sample_step is None:
        raise ValueError("sample_step (seconds) must be given with samples")
    else:
        signal = sampled(samples, sample_step)
    if dt is not None and not dt <= COARSEST * signal.scale:
        raise ValueError(f"dt must be {COARSEST:g} time scales of {signal.scale:g} seconds or less, got {dt:g}: longer steps see nothing of the rate")
    if not length / (signal.scale if dt is None else dt) <= MOST:
        what = f"time scales of {signal.scale:g}" if dt is None else f"steps of {dt:g}"
        raise ValueError(f"duration must be {MOST:g} {what} seconds or less, got {length:g} seconds")
    for name, value in (("time_scale", signal.scale), ("duration", length)):
        if not EXTREMES[0] <= value <= EXTREMES[1]:
            raise ValueError(f"{name} must be from {EXTREMES[0]:g} to {EXTREMES[1]:g} seconds, got {value:g}")
    drag = 1.0 / signal.scale if relaxation is None else _validate.non_negative("relaxation", relaxation, "1/s")
    strength = signal.scale**-0.5 if coefficient is None else _validate.non_negative("coefficient", coefficient, "s^(-1/2)")
    job = Job(error, length, columns, kernel, memory, use, signal, calibrated() if machine is None else machine, drag, strength)
    found = [best for family in families(job) if (best := job.longest(family) if dt is None else job.predicted(family, dt)) is not None]
    found.sort(key=lambda candidate: (not candidate.meets, candidate.seconds if candidate.meets else candidate.error))
    return Advice(tuple(found), error, signal.scale)


def _length(dt: float | None, steps: int | None, duration: float | None) -> float:
    """Length of the path, seconds."""
    if dt is None:
        if steps is not None or duration is None:
            raise ValueError("duration (seconds), and not steps, must be given where no dt is given")
        return _validate.positive("duration", duration, "seconds")
    dt = _validate.positive("dt", dt, "seconds")
    if (steps is None) == (duration is None):
        raise ValueError("either steps or duration (seconds) must be given with dt, and not both")
    if steps is not None:
        return _validate.integer("steps", steps, 1, MOST) * dt
    length = _validate.positive("duration", duration, "seconds")
    if length < dt * (1.0 - 1e-9):
        raise ValueError("duration must be at least one step of dt = {} seconds, got {}".format(*_validate.apart(dt, length)))
    return length


# Errors


@dataclass(frozen=True)
class Signal:
    """A rate on which schemes are tried."""

    rate: Callable[[Floats], Floats]  # g(t), seconds to (nodes, columns)
    scale: float  # s
    length: float  # s
    margin: float  # by which predicted errors are to be multiplied
    _references: dict[Any, Floats] = field(default_factory=dict)

    def error(self, rule: Rule, dt: float, kernel: Kernel) -> float:
        """Largest error of the whole-history rule from one time scale on, relative to the largest |H|."""
        shortest = min(self.length / STEPS, self.scale / 32.0)
        if dt < shortest:
            return float(self.error(rule, shortest, kernel) * (dt / shortest) ** rule.error_order + ROUNDING)
        steps = max(1, math.floor(self.length / dt * (1.0 + 1e-9)))
        settled = min(steps, math.ceil(self.scale / dt))
        exact = self._reference_solution(dt, steps, kernel)
        wrong = np.abs(cumulate(self.rate(dt * np.arange(steps + 1)), dt, rule, kernel) - exact)[settled:]
        whole = min(self.scale / 8.0, 0.5 * self.length)
        largest = np.abs(self._reference_solution(whole, math.floor(self.length / whole), kernel)).max()
        return float(wrong.max() / max(largest, 1e-300)) + ROUNDING

    def _reference_solution(self, dt: float, steps: int, kernel: Kernel) -> Floats:
        """H at every node (steps+1, columns)."""
        key = dt, steps, kernel
        if key not in self._references:
            parts = max(4, math.ceil(32.0 * dt / self.scale))
            fine = self.rate(dt / parts * np.arange(parts * steps + 1))
            self._references[key] = cumulate(fine, dt / parts, REFERENCE, kernel)[::parts]
        return self._references[key]


def model(scale: float, length: float) -> Signal:
    """A model signal of that time scale: an oscillation in a generic phase, and a decay with an H of about the same size."""

    def rate(t: Floats) -> Floats:
        return np.stack([np.cos(t / scale + 0.7), 1.6 * np.exp(-t / scale)], axis=1)

    return Signal(rate, scale, min(length, SCALES * scale), MARGINS["model"])


def spline(samples: ArrayLike, step: float) -> tuple[Any, Floats]:
    """(spline in seconds, samples (n+1, columns)) through given samples (n+1, ...), `step` seconds apart; ValueError for too few of them."""
    from scipy.interpolate import make_interp_spline

    g = _validate.real_array("samples", samples)
    if g.ndim == 0 or len(g) < 2 * SPLINE + 2:
        raise ValueError(f"samples must be at least {2 * SPLINE + 2} along their first axis, got {len(g) if g.ndim else 1}")
    if not np.isfinite(g).all():
        raise _validate.not_finite(g, 0, "samples")
    g = g.reshape(len(g), -1)
    return make_interp_spline(_validate.positive("sample_step", step, "seconds") * np.arange(len(g)), g, k=SPLINE), g


def rates(slips: ArrayLike, step: float) -> Floats:
    """The rate (n+1, columns) at samples of the slip, by a spline; errors as `spline`."""
    through, f = spline(slips, step)
    return np.asarray(through.derivative()(step * np.arange(len(f))))


def sampled(samples: ArrayLike, step: float) -> Signal:
    """A spline through samples of the rate (n+1, ...), `step` seconds apart; ValueError for samples that are zero or do not resolve the rate."""
    through, g = spline(samples, step)
    if not g.any():
        raise ValueError("samples must not all be zero")
    scale = time_scale_of(g, step)
    if scale < RESOLVED * step:
        what = f"which changes within {scale / step:.2g} steps here, fewer than {RESOLVED:g}: noise, a kink or too long a step"
        raise ValueError(f"samples must resolve the rate, {what}")
    return Signal(through, scale, step * (len(g) - 1), MARGINS["samples"])


def time_scale_of(g: Floats, step: float) -> float:
    """The shortest T = (max|g| / max|k-th derivative|)^(1/k) over k, seconds, for samples (nodes, columns); at most their length."""
    scale, differences = step * (len(g) - 1), g
    for k in range(1, SPLINE + 1):
        differences = np.diff(differences, axis=0)
        largest = np.abs(differences).max()
        if largest > 1e-14 * 2.0**k * np.abs(g).max():  # else rounding
            scale = min(scale, step * (np.abs(g).max() / largest) ** (1.0 / k))
    return float(scale)


# Candidates

Family = Callable[[float], Rule]  # of the step


@dataclass(frozen=True)
class Job:
    """The arguments of `advise`, checked."""

    error: float
    length: float
    columns: int
    kernel: Kernel
    memory: float
    use: str
    signal: Signal
    machine: Machine
    relaxation: float
    coefficient: float

    def steps(self, dt: float) -> int:
        """Steps to the end of the path."""
        return max(1, math.ceil(self.length / dt * (1.0 - 1e-9)))

    def longest(self, family: Family) -> Candidate | None:
        """The candidate with the longest step that keeps the error, or with the shortest one."""
        best, nearest, low, high = None, None, 0, len(SIZES) - 1
        while low <= high:  # the error falls with the step
            middle = (low + high) // 2
            candidate = self.predicted(family, float(min(self.signal.scale * SIZES[0], self.length) / SIZES[0] * SIZES[middle]))
            if candidate is not None and candidate.error <= self.error:
                best, high = candidate, middle - 1
            else:
                nearest, low = candidate or nearest, middle + 1
        return best or nearest

    def predicted(self, family: Family, dt: float) -> Candidate | None:
        """A candidate at one step; None where the scheme cannot be had."""
        steps = self.steps(dt)
        try:
            rule = family(dt)
            recipe = rule.recipe(dt, steps * dt, self.kernel)
            if recipe.used(steps) == steps and (recipe.tail is not None or (self.use == "stream" and steps > LONGEST)):
                return None  # another name for the whole history, or no room
            if self.use == "stream" and dt > longest_step(rule, self.relaxation, self.coefficient):
                return None  # diverges
            wrong = self.signal.error(rule.whole, dt, self.kernel)
        except ValueError:  # no form for the kernel, or no fitted sum for that range
            return None
        if (tail := recipe.tail) is not None:
            wrong += tail.rtol or tail.max_relative_error(tail.near, max(steps * dt, tail.near))
        seconds, nbytes = expense(recipe, steps, self.columns, self.use, self.machine)
        wrong *= self.signal.margin
        return Candidate(rule, dt, steps, wrong, seconds, nbytes, wrong <= self.error and nbytes <= self.memory)


def families(job: Job) -> Iterator[Family]:
    """Every scheme that is considered; a window without tail is not, as it keeps no error."""
    for rule in by_default():
        if not isinstance(rule, (Daitche, Exponential, Hinsberg)):  # these with other parameters
            yield partial(_at_any_step, rule)
    yield lambda dt: Hinsberg(BLOCK * dt)
    digits = max(1e-14, min(0.1, TAIL_SHARE * job.error / job.signal.margin))
    decade = math.floor(math.log10(digits))
    rtol = float(f"{math.floor(digits * 10.0**-decade)}e{decade}")
    for order in range(1, HIGHEST + 1):
        yield partial(_at_any_step, Daitche(order))
        yield partial(_at_any_step, Exponential(order, rtol))
        yield partial(_windowed, order, rtol, job)


def _at_any_step(rule: Rule, dt: float) -> Rule:
    return rule


def _windowed(order: int, rtol: float, job: Job, dt: float) -> Rule:
    near = BLOCK * dt
    return Windowed(Daitche(order), near, ExponentialSum.fit(near, max(job.length, near) + 2.0 * dt, rtol, job.kernel))


# Times and bytes

SHORT = 512  # steps of a path whose call is measured; it fits into a fast cache beside any number of others
VECTOR = 4  # samples that are read at once
CACHED = 2**17  # samples whose transforms fit into a fast cache


def expense(recipe: Recipe, steps: int, columns: int, use: str, machine: Machine) -> tuple[float, int]:
    """(seconds, bytes) for a whole path."""
    if use == "path" and recipe.tail is None:
        beyond = min(1.0, max(0.0, 0.5 * math.log2(steps * columns / CACHED))) * min(1.0, max(0.0, math.log2(steps / SHORT) / 3.0))
        each = machine.transform * math.log2(steps + 1) + machine.spill * beyond
        return machine.path + each * steps * columns, 48 * steps * columns
    terms, window = len(recipe.tail or ()), recipe.window
    each = machine.column + machine.term * terms
    if window is None:
        each += machine.whole + machine.node * 0.5 * steps
    else:
        nodes = recipe.lags + 1
        each += machine.whole * min(1.0, max(recipe.degree + 1, nodes - 2) / steps)  # until the window is full
        each += machine.node * nodes + (machine.stall if nodes % VECTOR == 0 else 0.0)
    return machine.call + steps * (machine.step + columns * each), bytes_of(recipe, steps, columns)


def bytes_of(recipe: Recipe, steps: int, columns: int) -> int:
    """Memory of a stream."""
    slots = 2 * (steps + 1) if recipe.window is None else 2 * (recipe.lags + 1) + recipe.window + 1
    return 8 * columns * (slots + len(recipe.tail or ()) + 1)


def calibrated() -> Machine:
    """The constants of this machine: from the user's cache if they are there, else measured in a second and kept."""
    place = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "basset" / "machine.json"
    return _calibrated(place)


@lru_cache(maxsize=4)
def _calibrated(place: Path) -> Machine:
    key = f"{__version__} {measure.processor()}"
    try:
        kept = json.loads(place.read_text(encoding="utf-8"))
        if kept["key"] == key:
            return Machine(**kept["machine"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    machine = calibrate()
    with contextlib.suppress(OSError):  # nowhere to write: measured again next time
        measure.write_json(place, {"key": key, "machine": asdict(machine)})
    return machine


def calibrate() -> Machine:
    """Measure this machine's constants, in about a second."""
    random = np.random.default_rng(0).random
    wide, steps = 64, {1: 8192, 64: 256}  # by columns
    work: dict[str, tuple[Rule, int]] = {"narrow": (Exponential(3, 1e-2), 1), "low": (Exponential(3, 1e-2), wide), "high": (Exponential(3, 1e-10), wide)}
    work |= {"stalled": (Exponential(2, 1e-2), wide), "few": (Windowed(Daitche(1), 32.0), wide), "many": (Windowed(Daitche(1), 1024.0), wide)}
    terms, small = {}, random((BLOCK, wide))
    contenders: dict[str, Callable[[], Any]] = {}
    for name, (rule, columns) in work.items():
        plan = rule.plan(1.0, 1e5)
        terms[name] = len(plan.tail_sum or ())
        contenders[name] = partial(_run_steady, plan, plan.start((columns,)), random((steps[columns], columns)))
    contenders |= {name: partial(cumulate, random(shape), 1.0, Daitche(1)) for name, shape in (("small", (2**8, 32)), ("large", (2**12, 128)), ("path", SHORT))}
    brief = Daitche(3).plan(1.0, float(BLOCK))
    contenders["whole"] = lambda: brief.run(brief.start((wide,)), small)
    contenders["stream"] = partial(cumulate, random(SHORT), 1.0, Exponential(3, 1e-2))
    taken = measure.interleaved(contenders, rounds=10, seconds=0.002)
    narrow, low, high, stalled, few, many = (taken[name] / steps[columns] for name, (_, columns) in work.items())
    node = max((many - few) / (wide * (1024 - 32)), 1e-12)
    term = max((high - low) / (wide * (terms["high"] - terms["low"])), 1e-12)
    column = max((low - narrow) / (wide - 1) - term * terms["low"], 1e-12)
    stall = max((stalled - low) / wide - term * (terms["stalled"] - terms["low"]), 0.0)
    step = max(narrow - column - term * terms["low"], 0.0)
    whole = max(taken["whole"] / small.size - column - 0.5 * node * BLOCK, 0.0)
    transform = taken["small"] / (2**13 * 8)
    spill = max(taken["large"] / 2**19 - transform * 12, 0.0)
    call = max(taken["stream"] - SHORT * (step + column + term * terms["low"]), 0.0)
    path = max(taken["path"] - SHORT * transform * math.log2(SHORT), 0.0)
    return Machine(call, path, step, column, node, term, stall, whole, transform, spill)


def _run_steady(plan: Any, state: Any, G: Floats) -> None:
    """Run a stream beyond its start-up; the cost does not depend on the values."""
    state.counters[:] = (5000.0, 5000.0, 0.0)
    plan.run(state, G)
