"""Which history scheme keeps a wanted error of a scene's mean jumps in the least time: measured on the scene itself.

Every scheme, window, tail and solver that the scene accepts flies the same beds as a tight collocation. Takeoffs start as √t, and an
impact at fixed steps moves to a node: no scheme's declared order tells what a mean jump errs by. The order is measured, the error goes on with it
to steps that are not flown, and the time with its own growth.
"""

from __future__ import annotations

import contextlib
import inspect
import itertools
import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, get_args

import numpy as np
import pandas as pd

from basset import BassetKernel, _validate, measure
from basset.advice import bytes_of
from basset.kernels import Floats
from basset.quadrature import SCHEMES, Rule, full_history
from saltation._keys import text_of
from saltation.flight.setup import Engine
from saltation.scene import AUTO, LONGEST, Scene, SceneError, scene_of
from saltation.scene.tables import Solver
from saltation.simulation import run
from saltation.study import cases
from saltation.study.cases import VARIABLES
from saltation.study.effects import choose

__all__ = ["Candidate", "select_scheme"]

COLLOCATION = "collocation"
METHODS = (COLLOCATION, *(name for name in get_args(Solver.model_fields["method"].annotation) if name != COLLOCATION))
WORDS = ("scheme", "order", "rtol", "rule", "window", "window_jumps", "tail")  # of [history]: they approximate; kernel and rebound are physics
REFERENCES = (1e-9, 1e-8, 1e-7)  # rtol of the reference: the first that the scene accepts
RTOLS = tuple(10.0**-k for k in range(2, 9))
ORDERS = (1, 2, 3)
WINDOWS = (0.2, 1.0, 4.0)  # mean jumps
JUMPS = (1, 2, 5)
TAILS = (False, "fitted", "van_hinsberg", "casas")
TAIL_SHARE = 0.1  # of the wanted error, for what a fitted sum loses
COARSEST, FINER = 1.0 / 32.0, 4.0  # the first step over a mean jump; over the next one
RUNGS = 4  # steps of a ladder, at most
FIRST, CHAIN, START = 12, 60, 10  # jumps of the first look, of other runs; those left out at their start, at most
LOOKS, SURE, MOST = 2, 8, 96  # runs of a candidate with other beds: at first, of collocation, which is quick; at most
KEPT = 2  # candidates that go on to the next step, of those that drop nothing of the past and of the others
HOPELESS = 8.0  # predicted time over the best so far: not worth a closer look
CLOSE = 1.6  # those within it of the best are timed against each other
TIMED = 300  # jumps of such a run
STEPS = 2e5  # of it, at most
PATIENCE, ONCE = 4.0, 0.5  # s of CPU time for one candidate at one step, at most; what takes longer is timed once

NOTHING = 1e-9  # d or V: a mean that is none, such as a length where nothing moves along; errors are then in these units

Say = Callable[[str], None]


@dataclass(frozen=True)
class Candidate:
    """A solver and the words of [history] that choose a scheme.

    Examples
    --------
    >>> Candidate("fixed_step", (("scheme", "exponential"), ("order", 2))).name
    'exponential, order 2'
    """

    method: str
    history: tuple[tuple[str, Any], ...]

    @property
    def name(self) -> str:
        """The scheme with its options."""
        words = dict(self.history)
        first = words.pop("scheme")
        if self.fixed or words:
            return ", ".join([first, *(f"{name.replace('_', ' ')} {json.dumps(value)}".replace('"', "") for name, value in words.items())])
        return "its own sum"

    @property
    def fixed(self) -> bool:
        """Whether it has fixed steps."""
        return self.method != COLLOCATION

    @property
    def whole(self) -> bool:
        """Whether nothing of the past is dropped, at most approximated."""
        words = dict(self.history)
        return words.get("window_jumps") is None and ("window" not in words or words.get("tail", True) is not False)

    def words(self, size: float) -> dict[str, dict[str, Any]]:
        """Tables of a scene: at a step of `size` d/u*, for collocation at rtol = `size` (dimensionless); None takes a word out."""
        solver = {"method": self.method, "dt": size if self.fixed else None, "rtol": None if self.fixed else size}
        return {"solver": solver, "history": dict.fromkeys(WORDS) | dict(self.history)}

    def toml(self, size: float) -> str:
        """The lines that choose it in a scene file, `size` in d/u* (collocation: dimensionless)."""
        lines = []
        for table, words in self.words(size).items():
            lines += [f"[{table}]", *(f"{name} = {json.dumps(value)}" for name, value in words.items() if value is not None)]
        return "\n".join(lines)


EXACT = Candidate(COLLOCATION, (("scheme", "exponential"),))


@dataclass
class Sample:
    """One candidate at one step: relative changes of H, L and ū and their standard errors, CPU seconds per jump of the scene's run."""

    size: float  # dt in d/u*, or rtol
    change: Floats
    error: Floats
    seconds: float
    status: str = "finished"
    runs: int = 0  # with other beds; none: extrapolated
    timed: bool = False  # without what comes before the first jump

    @property
    def row(self) -> dict[str, Any]:
        """As `cases.compare` has it."""
        pairs = {f"{name}_change": float(self.change[k]) for k, name in enumerate(VARIABLES)}
        return {"status": self.status, **pairs, **{f"{name}_error": float(self.error[k]) for k, name in enumerate(VARIABLES)}}

    @property
    def bound(self) -> float:
        """Largest change that is not ruled out."""
        return cases.change_bound(self.row)

    @property
    def largest(self) -> float:
        """Largest change as found."""
        return cases.largest_change(self.row)

    def tells(self, error: float) -> bool:
        """Whether it decides if an error is kept."""
        return self.status != "finished" or self.bound <= error or max(np.abs(self.change) - cases.BOUND * self.error, default=0.0) > error


@dataclass
class Entry:
    """A candidate with all that was seen of it, the largest step first."""

    candidate: Candidate
    grows: bool = False  # whether it sums all of the past: a jump is dearer than the one before
    samples: list[Sample] = field(default_factory=list)

    @property
    def last(self) -> Sample:
        """At the finest step."""
        return self.samples[-1]

    @property
    def alive(self) -> bool:
        """Whether its last run did what the scene asks for."""
        return bool(self.samples) and self.last.status == "finished"

    def bound(self, sample: Sample, order: float) -> float:
        """Largest change that is not ruled out, even if those by the step and by what is dropped did not cancel; infinite where they cannot be told apart."""
        if self.candidate.whole or not self.candidate.fixed or sample.status != "finished":
            return sample.bound
        return max(sample.bound, self.predicted(sample.size, order).bound) if len(self.samples) > 1 else math.inf

    def predicted(self, size: float, order: float) -> Sample:
        """Errors A·dtᵖ + B and the time at another step; B is what no step removes, of those that drop a part of the past. Both count with their size: no
        error is small because they cancel.
        """
        last = self.last
        step, floor = np.abs(last.change), np.zeros(len(VARIABLES))
        if not self.candidate.whole and len(self.samples) > 1:
            before = self.samples[-2]
            slope = (before.change - last.change) / (before.size**order - last.size**order)
            step, floor = np.abs(slope) * last.size**order, np.abs(last.change - slope * last.size**order)
        ratio = (size / last.size) ** order
        scatter = last.error * (ratio if self.candidate.whole else max(1.0, ratio))  # differences of single jumps fall as their mean does
        return Sample(size, step * ratio + floor, scatter, self.time_at(size))

    def time_at(self, size: float) -> float:
        """CPU seconds per jump at another step: what an impact takes, and as much for each step; if a step sums all of the past, a power of their number."""
        last = self.last
        if len(self.samples) < 2 or not self.samples[-2].timed:
            return last.seconds * last.size / size
        before = self.samples[-2]
        if self.grows:
            power = math.log(last.seconds / before.seconds) / math.log(before.size / last.size)
            return float(last.seconds * (last.size / size) ** min(2.0, max(1.0, power)))
        each = max(0.0, (last.seconds - before.seconds) / (1.0 / last.size - 1.0 / before.size))
        return last.seconds + max(each * (1.0 / size - 1.0 / last.size), -0.9 * last.seconds)

    @property
    def sizes(self) -> list[float]:
        """Steps (d/u*) that are considered, the longest first."""
        return [rounded(self.last.size * 2.0 ** (-k / 4.0)) for k in range(-16, 81)]


def alike(one: Entry, other: Entry) -> bool:
    """Whether two are variants of one scheme with one solver."""
    words, others = (dict(entry.candidate.history) for entry in (one, other))
    return (one.candidate.method, words["scheme"], words.get("rule")) == (other.candidate.method, others["scheme"], others.get("rule"))


def rounded(size: float) -> float:
    """Two digits, not more than given."""
    decade = 10.0 ** (math.floor(math.log10(size)) - 1)
    return float(f"{math.floor(size / decade * (1.0 + 1e-9)) * decade:.6g}")


def measured_order(entries: Iterable[Entry], unknown: float = 1.0) -> float:
    """The exponent of the step in the error: median over those that drop nothing, from their two finest steps."""
    found = [entry.samples[-2:] for entry in entries if entry.candidate.whole and len(entry.samples) > 1]
    orders = [float(measure.observed_orders([s.size for s in pair], [s.largest for s in pair])[0]) for pair in found if all(s.largest > 0.0 for s in pair)]
    return min(4.0, max(0.25, float(np.median(orders)))) if orders else unknown


# What the scene accepts


def parameters(scheme: type[Rule]) -> set[str]:
    """Names of a scheme's parameters."""
    return set(inspect.signature(scheme).parameters)


def histories(duration: float, rtol: float) -> Iterator[tuple[tuple[str, Any], ...]]:
    """The words of [history] for every scheme with every window, tail and degree; durations in d/u*. Not all of them make a scene."""
    windows = [rounded(share * duration) for share in WINDOWS]
    for name, scheme in SCHEMES.items():
        known = parameters(scheme)
        rules = full_history() if "rule" in known else [None]
        for rule in rules:
            fields = known | (parameters(SCHEMES[rule]) if rule else set())
            axes = {
                "order": ORDERS if "order" in fields else (None,),
                "window": windows if "window" in fields else (None,),
                "tail": (*TAILS, *(() if rule else (None,))) if "tail" in fields else (None,),
                "window_jumps": (None, *JUMPS) if "window" not in fields else (None,),
            }
            for values in itertools.product(*axes.values()):
                words = {"scheme": name, "rule": rule, **dict(zip(axes, values, strict=True))}
                fitted = "rtol" in fields or words["tail"] == "fitted"
                yield tuple((word, value) for word, value in (words | {"rtol": rtol if fitted else None}).items() if value is not None)


def candidates(scene: Scene, duration: float, rtol: float, sizes: Sequence[float]) -> dict[Candidate, float]:
    """All that the scene accepts, by trying, with the first of the steps (d/u*) that it accepts; collocation remembers by a sum of its own accuracy."""
    found: dict[Candidate, float] = {}
    for method in METHODS:
        for history in histories(duration, rtol):
            words = tuple(pair for pair in history if method != COLLOCATION or pair[0] not in ("order", "rtol"))
            candidate = Candidate(method, words)
            if candidate in found:
                continue
            for size in sizes if candidate.fixed else (RTOLS[0],):
                with contextlib.suppress(SceneError):
                    scene.changed(**candidate.words(size))
                    found[candidate] = size
                    break
    return found


# Runs


def flown(text: str) -> tuple[str, Floats, float]:
    """(status, H, L, ū and duration of every jump, CPU seconds) of a scene in JSON: what a worker is given."""
    scene = scene_of(json.loads(text))
    start = time.process_time()
    result = run(scene)
    return result.status, result.all_jumps[[*VARIABLES, "duration"]].to_numpy(), time.process_time() - start


class Trial:
    """One scene, its reference runs, and what candidates do beside them."""

    def __init__(self, scene: Scene, executor: Executor | None, say: Say, chain: int = CHAIN, tight: Sequence[float] = REFERENCES) -> None:
        self.given, self.executor, self.say, self.chain = scene, executor, say, chain
        names = [name for name in scene.names if name != "encounters"]
        alone = {"effects": names, "cloud": None, "encounters": None} if scene.cloud is not None else {}
        self.scene = scene.changed(**alone, run={"jumps": scene.run.jumps or chain, "duration": None, "discard": 0, "trajectory": False})
        self.unit = scene.numbers.unit("d/u*")
        self.rtol = next((rtol for rtol in tight if self.accepts(EXACT, rtol)), tight[-1])
        self.tables: list[Floats] = []
        self.jumps = self.scene.run.jumps or chain
        self.duration = 1.0
        self.reference(LOOKS)
        self.duration = float(np.mean([table[:, -1].mean() for table in self.tables]))
        if scene.run.duration is not None:
            self.jumps = max(1, round(scene.end / self.duration))
        means = np.mean([table[self.discard :, :-1].mean(axis=0) for table in self.tables], axis=0)
        self.means = np.where(np.abs(means) > NOTHING, means, 1.0)

    def accepts(self, candidate: Candidate, size: float) -> bool:
        """Whether it makes a scene, of one grain and of all."""
        with contextlib.suppress(SceneError):
            self.given.changed(**candidate.words(size))
            return True
        return False

    @property
    def count(self) -> int:
        """Jumps of a run beside the reference."""
        return min(self.jumps, self.chain) if self.given.run.jumps is not None else self.chain

    @property
    def discard(self) -> int:
        """Jumps left out of it."""
        return self.discarded(self.count)

    def discarded(self, jumps: int) -> int:
        """Jumps left out of so many."""
        own = self.given.run.discard
        return own if jumps == self.given.run.jumps else min(own, START, jumps // 4)

    def paired_scene(self, candidate: Candidate, size: float, jumps: int, place: int = 0) -> Scene:
        """The scene at one step, over the beds of one run, with a memory as long as its share of the jumps."""
        tables = candidate.words(size)
        if candidate.fixed or self.given.options("history").horizon is not None:
            share = max(self.given.horizon * jumps / self.jumps, 2.0 * self.duration * jumps)
            tables["history"]["horizon"] = min(LONGEST, share)
        seed = (self.scene.run.seed + place) % 2**63
        return self.scene.changed(**tables, run={"jumps": jumps, "discard": 0, "seed": seed})

    def fly(self, scenes: Sequence[Scene]) -> list[tuple[str, Floats, float]]:
        """Status, jumps and CPU seconds of scenes, over the executor or here."""
        texts = [text_of(scene) for scene in scenes]
        return list(self.executor.map(flown, texts)) if self.executor is not None else [flown(text) for text in texts]

    def reference(self, runs: int) -> None:
        """So many runs of the reference."""
        missing = range(len(self.tables), runs)
        for status, table, _ in self.fly([self.paired_scene(EXACT, self.rtol, self.count, place) for place in missing]):
            if status != "finished":
                raise SceneError(f"run: mean jumps are compared, and this scene ends {status!r} after {len(table)} of {self.count} jumps")
            self.tables.append(table)

    def sample(self, entry: Entry, size: float, runs: int, jumps: int | None = None) -> Sample:
        """A candidate beside the reference, over so many beds."""
        jumps = self.count if jumps is None else min(jumps, self.count)
        self.reference(runs)
        try:
            flights = self.fly([self.paired_scene(entry.candidate, size, jumps, place) for place in range(runs)])
            failed = next((status for status, _, _ in flights if status != "finished"), "finished")
        except SceneError:
            failed = "refused"
        if failed != "finished":
            nothing = np.full(len(VARIABLES), math.nan)
            return Sample(size, nothing, nothing, math.nan, failed, runs)
        discard = self.discarded(jumps)
        mine, others = ([table[discard:jumps, :-1] for table in tables] for tables in ([table for _, table, _ in flights], self.tables[:runs]))
        found = cases.paired(mine, others, self.means)
        once = self.fly([self.paired_scene(entry.candidate, size, 1)])[0][2] if jumps < self.count else 0.0
        seconds = max(1e-9, min(taken for _, _, taken in flights) - once) / jumps
        return Sample(size, found.mean, found.error, seconds * (self.jumps / jumps if entry.grows else 1.0), runs=runs)

    def decided(self, entry: Entry, size: float, error: float, most: int = MOST, least: int = LOOKS) -> Sample:
        """With as many beds as it takes to tell whether an error is kept."""
        runs = least
        while True:
            found = self.sample(entry, size, runs)
            if found.tells(error) or runs >= most:
                return found
            runs = min(most, 4 * runs)

    def timed(self, samples: Sequence[tuple[Entry, Sample]]) -> None:
        """Time some against each other, without what comes before the first jump; the whole past by the growth from one half to the other."""
        scenes = {}
        for k, (entry, sample) in enumerate(samples):
            steps = self.duration / sample.size if entry.candidate.fixed else 0.0
            most = CHAIN // 2 if entry.grows else CHAIN if entry.candidate.fixed else TIMED
            jumps = int(min(most, self.jumps, max(8.0, STEPS / max(steps, 1.0))))
            for count in {1, jumps // 2 if entry.grows and jumps > 3 else 1, jumps}:
                scenes[k, count] = self.paired_scene(entry.candidate, sample.size, count)
        taken = cases.seconds_of(scenes, rounds=3, patience=ONCE)
        for k, (_, sample) in enumerate(samples):
            counts = sorted(count for place, count in scenes if place == k)
            times = [taken[k, count] for count in counts]
            each = np.diff(times) / np.diff(counts) if len(counts) > 1 else np.array(times)
            rise = max(0.0, float(each[-1] - each[0]))
            sample.seconds, sample.timed = max(float(each[0] + rise * (self.jumps / counts[-1] - 0.5)), 1e-9), True


def collocations(trial: Trial, entries: Sequence[Entry], error: float, finest: bool) -> None:
    """Collocation at every tolerance down to the first that keeps the error and the next one, or at all of them; a shorter memory where the whole one keeps."""
    whole = entries[0]
    for rtol in (rtol for rtol in RTOLS if rtol >= 10.0 * trial.rtol * (1.0 - 1e-9) and trial.accepts(whole.candidate, rtol)):
        whole.samples.append(trial.decided(whole, rtol, error, least=SURE))
        if not finest and len(whole.samples) > 1 and whole.samples[-2].bound <= error:
            break
    kept = next((sample for sample in whole.samples if sample.bound <= error), whole.last)
    for entry in entries[1:]:
        entry.samples.append(trial.decided(entry, kept.size, error, least=SURE))


class Ladder:
    """Fixed steps, from long to short; what others beat is dropped on the way."""

    def __init__(self, trial: Trial, entries: Sequence[Entry], starts: Mapping[Candidate, float], error: float, dt: float | None, budget: float) -> None:
        self.trial, self.entries, self.starts = trial, list(entries), starts
        self.error, self.dt, self.budget = error, dt, budget  # budget: s per jump

    def order(self, method: str) -> float:
        """The measured order of one solver's schemes."""
        return measured_order(entry for entry in self.entries if entry.alive and entry.candidate.method == method)

    def goal(self, entry: Entry) -> Sample | None:
        """Where it is to be used: at the given step, at the shortest within the budget, or at the longest that keeps the error."""
        order = self.order(entry.candidate.method)
        if self.dt is not None:
            return entry.predicted(self.dt, order)
        every = (entry.predicted(size, order) for size in entry.sizes)
        if self.budget < math.inf:
            return next((found for found in reversed(list(every)) if found.seconds <= self.budget), None)
        return next((found for found in every if found.bound <= self.error), None)

    def climb(self, sizes: Sequence[float], rival: float) -> None:
        """One step after the other; `rival`: the time of a jump (s) by other means, below which there is nothing to find."""
        going: list[Entry] = []
        for rung, size in enumerate(sizes):
            jumps = FIRST if rung == 0 and len(sizes) > 1 else None
            going += [entry for entry in self.entries if not entry.samples and size <= self.starts[entry.candidate]]
            if not going:
                continue
            self.trial.say(f"fixed steps of {size:.3g} {self.trial.unit}: {len(going)} candidates")
            for entry in going:
                entry.samples.append(self.trial.sample(entry, size, LOOKS if jumps is None else 1, jumps))
            timed = [(entry, entry.last) for entry in going if entry.alive]
            if jumps is None:
                self.trial.timed(timed)
            ranked = self.ranked([entry for entry, _ in timed])
            if not ranked or rung + 1 == len(sizes):
                return
            best = self.goal(ranked[0])
            assert best is not None
            if rung and self.dt is None and self.budget == math.inf and (best.size >= size or (rung > 1 and best.seconds > HOPELESS * rival)):
                return
            going = self.survivors(ranked, rival, sizes[rung + 1], rung == 0)

    def ranked(self, entries: Iterable[Entry]) -> list[Entry]:
        """The quickest at the error first; those that do not come to it are left out, unless none does."""
        goals = [(entry, goal) for entry in entries if (goal := self.goal(entry)) is not None]
        if self.budget < math.inf:
            return [entry for entry, _ in sorted(goals, key=lambda pair: pair[1].bound)]
        least = max(self.error, 1.3 * min((goal.largest for _, goal in goals), default=0.0))
        return [entry for entry, _ in sorted(((e, g) for e, g in goals if g.largest <= least or self.dt is None), key=lambda pair: pair[1].seconds)]

    def survivors(self, ranked: Sequence[Entry], rival: float, size: float, each: bool) -> list[Entry]:
        """The best of those that drop nothing and of the others, as far as they can be afforded; `each`: also the best of each scheme and solver.

        What neither keeps the error nor is quicker than what does is beaten at every step: of those only the best goes on, to tell by how much.
        """
        kept = [entry for entry in ranked if entry.time_at(size) * self.trial.count * LOOKS < PATIENCE]
        open_ = [entry for entry in kept if entry.last.seconds <= 2.0 * rival or entry.last.bound <= self.error]
        found = [entry for whole in (True, False) for entry in [e for e in open_ if e.candidate.whole is whole][:KEPT]]
        for entry in open_ if each else ():
            if not any(alike(entry, other) for other in found):
                found.append(entry)
        return found or kept[:1]

    def confirm(self, rival: float, tries: int = 3) -> None:
        """Fly the best at its step, if its predicted time is of interest; a step that does not keep the error is shortened."""
        for _ in range(tries):
            ranked = self.ranked([entry for entry in self.entries if len(entry.samples) > 1 and entry.alive])[:2]
            goals = [(entry, goal) for entry in ranked if (goal := self.goal(entry)) is not None]
            new = [(e, g) for e, g in goals if g.seconds < CLOSE * rival and all(g.size != s.size for s in e.samples)]
            new = [(e, g) for e, g in new if g.seconds * self.trial.count * LOOKS < PATIENCE and self.trial.accepts(e.candidate, g.size)]
            if not new:
                return
            for entry, goal in new:
                self.trial.say(f"{entry.candidate.name}, {entry.candidate.method}: dt = {goal.size:g} {self.trial.unit}")
                entry.samples.append(self.trial.decided(entry, goal.size, self.error, 4 * LOOKS))
                entry.samples.sort(key=lambda sample: -sample.size)
            self.trial.timed([(entry, sample) for entry, goal in new for sample in entry.samples if sample.size == goal.size and sample.status == "finished"])


# The choice


def select_scheme(
    scene: Scene,
    error: float = 0.01,
    dt: float | None = None,
    executor: Executor | None = None,
    *,
    seconds: float | None = None,
    say: Say | None = None,
) -> pd.DataFrame:
    """Rank the history schemes for a scene by the computing time they take to keep a given error of its mean jump.

    Every scheme of `basset.SCHEMES`, window, tail and solver that the scene accepts is run over the same beds as collocation with a tight rtol: the error is
    the largest of those of mean height, length and velocity. Steps that are not run are judged by the measured order
    of the error and growth of the time; an error does not count as small where those of step and truncation cancel. Of a [cloud] one grain is run alone.

    Parameters
    ----------
    scene : Scene
        With a bed and with history among its effects; history.kernel and history.rebound stay, its scheme is replaced.
    error : float, dimensionless
        Relative error of the means to keep, 1e-4 to 0.5.
    dt : float, d/u*, optional
        Step to use: only solvers with fixed steps are ranked.
    executor : concurrent.futures.Executor, optional
        For the runs that are compared with the reference; times are measured in this process.
    seconds : float, s, optional
        CPU time that the scene's run may take: the most accurate candidate within it comes first.
    say : callable or None
        Called with a line of text for each part of the work.

    Returns
    -------
    DataFrame, one row per candidate and step, the chosen one first
        Columns scheme, kernel, solver, dt (d/u*), rtol (dimensionless, collocation), error (largest change of mean H, L or ū that is not ruled out, 95 %,
        dimensionless), height_change, length_change, velocity_change (dimensionless), seconds (CPU time per jump over the scene's own run), bytes (of memory),
        runs (with other beds; 0: extrapolated), order (measured, of the error in dt), keeps (the error), status.
        `attrs`: toml, the lines of the chosen one; scene, the scene with it (JSON); wanted, dt, seconds, reference (rtol), jumps, units.

    Raises
    ------
    SceneError, ValueError, TypeError
        For a scene that has no history or no bed or that does not finish its jumps, and for what is out of range.

    References
    ----------
    Thesis, fig. 5-5, sets error against time for one integral; the choice: this library.

    Examples
    --------
    >>> import saltation
    >>> table = saltation.select_scheme(saltation.load("bouncing"), error=0.02)  # doctest: +SKIP
    >>> table.iloc[0]["solver"], bool(table.iloc[0]["error"] <= 0.02)  # doctest: +SKIP
    ('collocation', True)
    """
    if not 1e-4 <= error <= 0.5:
        raise ValueError(f"error must lie between 0.0001 and 0.5, got {error:g}")
    for name, value in (("dt", dt), ("seconds", seconds)):
        if value is not None:
            _validate.positive(name, value)
    if dt is not None and seconds is not None:
        raise ValueError("give either dt or seconds: dt decides the time")
    if "history" not in scene.names:
        raise SceneError("effects must include 'history': without it there is no history scheme to choose")
    cases.require_bed(scene)
    tell = say or (lambda text: None)
    if scene.effects == AUTO:
        tell("choosing the effects")
        scene = choose(scene, None, executor)
    trial = Trial(cases.with_listed_effects(scene), executor, tell)
    tell(f"reference: collocation, rtol {trial.rtol:g}; a mean jump takes {trial.duration:.3g} {trial.unit}")
    return table_of(trial, *measured(trial, error, dt, seconds), error, dt, seconds)


def measured(trial: Trial, error: float, dt: float | None, seconds: float | None) -> tuple[list[Entry], Ladder]:
    """All candidates, flown as far as it takes to rank them."""
    sizes = [rounded(COARSEST * trial.duration * FINER**-k) for k in range(RUNGS)]
    if dt is not None:
        sizes = [*(size for size in (dt * FINER**k for k in range(RUNGS - 1, 0, -1)) if size <= 4.0 * sizes[0]), dt]
    decade = 10.0 ** math.floor(math.log10(TAIL_SHARE * error))
    accepted = candidates(trial.given, trial.duration, float(f"{max(1e-12, decade):.3g}"), sizes if dt is None else [dt])
    if dt is not None:  # longer steps than the given one only show the order
        accepted = {candidate: next(size for size in sizes if trial.accepts(candidate, size)) for candidate in accepted if candidate.fixed}
    own = [Entry(candidate) for candidate in sorted(accepted, key=lambda candidate: len(candidate.history)) if not candidate.fixed]
    own = own or [Entry(EXACT)]  # at a given step only to compare with
    trial.say(f"{len(accepted)} schemes with their windows, tails and solvers")
    collocations(trial, own, error, seconds is not None)
    trial.timed([(entry, sample) for entry in own for sample in entry.samples if sample.status == "finished"])
    kept = [sample.seconds for entry in own for sample in entry.samples if sample.bound <= error]
    rival = min(kept, default=math.inf) if dt is None else math.inf
    fixed = [Entry(candidate, grows(trial, candidate, size)) for candidate, size in accepted.items() if candidate.fixed]
    ladder = Ladder(trial, fixed, accepted, error, dt, math.inf if seconds is None else seconds / trial.jumps)
    ladder.climb(sizes, rival)
    ladder.confirm(rival)
    trial.say("timing the best against each other")
    entries = [*own, *fixed]
    close = [(entry, sample) for entry in entries for sample in entry.samples if entry.bound(sample, 1.0) <= error and (entry.candidate.fixed or dt is None)]
    least = min((sample.seconds for _, sample in close), default=math.inf)
    trial.timed([(entry, sample) for entry, sample in close if sample.seconds <= CLOSE * least])
    return entries, ladder


def grows(trial: Trial, candidate: Candidate, size: float) -> bool:
    """Whether a scheme sums all of the past, so that every jump is dearer than the one before."""
    if "window" in dict(candidate.history):
        return False
    scene = trial.scene.changed(**candidate.words(size))
    rule = scene.history_rule()
    return rule.recipe(size, scene.horizon, BassetKernel()).window is None and scene.options("history").rebound not in ("restart", "reset")


def memory_of(trial: Trial, candidate: Candidate, size: float) -> int:
    """Bytes that the memory of one grain takes."""
    scene = trial.scene.changed(**candidate.words(size))
    columns = 2 if scene.in_plane else 3
    if not candidate.fixed:
        return 8 * columns * len(Engine(scene).rates) * (1 + (scene.options("history").window_jumps or 0))
    horizon = trial.given.horizon
    return bytes_of(scene.history_rule(horizon).recipe(size, horizon, BassetKernel()), math.ceil(horizon / size), columns)


def table_of(trial: Trial, entries: Sequence[Entry], ladder: Ladder, error: float, dt: float | None, seconds: float | None) -> pd.DataFrame:
    """The ranking."""
    rows = []
    for entry in entries:
        order = ladder.order(entry.candidate.method) if entry.candidate.fixed else math.nan
        samples = list(entry.samples)
        if entry.candidate.fixed and entry.alive and len(samples) > 1:
            goal = ladder.goal(entry)
            if goal is not None and all(goal.size != sample.size for sample in samples) and trial.accepts(entry.candidate, goal.size):
                samples.append(goal)
        for sample in samples:
            fixed, bound = entry.candidate.fixed, entry.bound(sample, order) if sample.runs else sample.bound
            rows.append(
                {
                    "scheme": entry.candidate.name,
                    "kernel": trial.scene.options("history").kernel,
                    "solver": entry.candidate.method,
                    "dt": sample.size if fixed else math.nan,
                    "rtol": math.nan if fixed else sample.size,
                    "error": bound,
                    **{f"{name}_change": float(sample.change[k]) for k, name in enumerate(VARIABLES)},
                    "seconds": sample.seconds,
                    "bytes": memory_of(trial, entry.candidate, sample.size),
                    "runs": sample.runs,
                    "order": order,
                    "keeps": bound <= error,
                    "status": sample.status,
                    "candidate": (entry.candidate, sample.size),
                }
            )
    table = ranking(pd.DataFrame(rows), dt, ladder.budget)
    candidate, size = table.iloc[0]["candidate"]
    found = table.drop(columns="candidate")
    found.attrs = {
        "toml": candidate.toml(size),
        "scene": text_of(trial.given.changed(**candidate.words(size))),
        "wanted": error,
        "dt": dt,
        "seconds": seconds,
        "reference": trial.rtol,
        "jumps": trial.jumps,
        "units": {"dt": trial.unit, "rtol": "1", "error": "1", "seconds": "s per jump", "bytes": "bytes"},
    }
    return found


def ranking(table: pd.DataFrame, dt: float | None = None, budget: float = math.inf) -> pd.DataFrame:
    """Rows in the order of choice: what keeps the error by its time, what does not by its error. Within a budget (s per jump) the most exact comes first; at a
    given step (d/u*) all others are only to compare with.
    """
    short = table["seconds"] <= budget if budget < math.inf else pd.Series(True, index=table.index)
    wanted = short & (table["status"] == "finished") & (True if dt is None else table["dt"] == dt)
    first = wanted & table["keeps"] if budget == math.inf else wanted
    key = table["seconds"].where(first & (budget == math.inf), table["error"])
    order = pd.DataFrame({"wanted": ~wanted, "keeps": ~first, "key": key, "seconds": table["seconds"]}).sort_values(["wanted", "keeps", "key", "seconds"])
    return table.loc[order.index].reset_index(drop=True)


def verdict(table: pd.DataFrame) -> str:
    """In a sentence or two: who wins, by how much, and whether the error is kept."""
    best, wanted, unit = table.iloc[0], table.attrs["wanted"], table.attrs["units"]["dt"]
    collocation, fixed = (table[(table["solver"] == COLLOCATION) == own] for own in (True, False))
    step = f"rtol = {best['rtol']:g}" if best["solver"] == COLLOCATION else f"dt = {best['dt']:g} {unit}"
    kept = f"within {wanted:.3g}" if best["keeps"] else f"and do not keep {wanted:.3g}"
    flown = "" if best["runs"] else ", extrapolated"
    text = f"{best['solver']} with {best['scheme']} at {step}: means {kept}, found {best['error']:.2g} (95 % bound{flown}), {best['seconds']:.2g} s per jump"
    rivals = (collocation if best["solver"] != COLLOCATION else fixed).query("keeps").sort_values("seconds")
    if rivals.empty:
        return f"{text}; no {'fixed-step candidate' if best['solver'] == COLLOCATION else 'collocation'} keeps it"
    rival = rivals.iloc[0]
    fixed_one = f"{rival['scheme']} ({rival['solver']}, dt = {rival['dt']:g} {unit})"
    what = f"collocation at rtol = {rival['rtol']:g}" if rival["solver"] == COLLOCATION else fixed_one
    wins = "collocation wins: " if best["solver"] == COLLOCATION else ""
    ratio = rival["seconds"] / best["seconds"]
    if ratio < 1.0:
        return f"{text}; {what} would be {1.0 / ratio:.3g} times as quick"
    return f"{wins}{text}; the best of the others, {what}, takes {ratio:.3g} times as long"
