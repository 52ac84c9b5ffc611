"""Which treatment of the history force at an impact, kernel, drag and restitution do measured rebounds and falls of spheres support?

Every choice flies a sphere that falls on a wall in still liquid; one number is fitted per measured motion (the restitution of the first contact), then one for
all of them (k in e = dry·exp(−k/St) at every contact), with intervals, and again with what was measured or assumed changed. A folder with the full digitised
records may be given; without it the key figures of `bench.records` are what is fitted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from basset.kernels import Floats
from basset.solvers._tables import following
from bench import records as facts
from bench.grains import rounded
from bench.records import BOUNCES, Bounce
from saltation.effects.drag import LAWS
from saltation.effects.history import KERNELS
from saltation.flight.setup import Engine
from saltation.grain import GRAVITY
from saltation.scene import scene_of
from saltation.scene.conditions import settling_velocity
from saltation.simulation import fly
from saltation.workers import cores, processes

SEED = 20261130
HIGHEST = 3.0  # m: a fall from here where the measured speed is not reached earlier
SHIFT = 2e-4  # s, of the time of the first contact
DIGITS = 5e-5  # m: standard deviation of a digitised height, five times that of the record's points at rest
BLOCK = 5  # neighbouring points that are drawn together: their misfits are alike
BEYOND = 0.03  # s, that a flight goes on behind the last point
K_SHOWN = [float(k) for k in range(2, 48)]
TARGET, NEAR = 0.06, 0.03  # rms of heights over the first apex; deviation of a speed
FIT_KERNEL, FIT_POWER = "mei_adrian", 2.0  # the kernel of the second law with two free numbers, and its c1


class Choice(NamedTuple):
    """A treatment of the history at impacts and a kernel; neither: no history force."""

    rebound: str | None = None
    kernel: str | None = None

    @property
    def label(self) -> str:
        """In words."""
        return f"{self.rebound}, {self.kernel}" if self.kernel else "no history"


class Closure(NamedTuple):
    """What else a flight depends on: drag law and a factor on it, restitution at large St, and the constants of a kernel in place of its own."""

    law: str = "schiller_naumann"
    drag: float = 1.0
    dry: float = 0.97
    constants: tuple[float, float] | None = None


REBOUNDS = ("impulse", "restart", "reset", "none")
CHOICES = (*(Choice(rebound, kernel) for rebound in REBOUNDS for kernel in ("basset", *KERNELS)), Choice())
PLAIN = Closure()
CLOSURES = {"drag − 10 %": Closure(drag=0.9), "drag + 10 %": Closure(drag=1.1), "Yen's drag": Closure("yen")}


# Flights


def content_of(ratio: float, viscosity: float, diameter: float, choice: Choice, law: str, height: float, duration: float) -> dict[str, Any]:
    """A scene without a bed: a sphere at rest in still liquid, the gap under it `height`."""
    history = {} if choice.kernel is None else {"history": {"kernel": choice.kernel, "rebound": choice.rebound}}
    return {
        "effects": ["weight", "drag", "added_mass", *history],
        "dimensions": 2,
        "fluid": {"density": 1000.0, "viscosity": viscosity},
        "grain": {"density": 1000.0 * ratio, "diameter": diameter},
        "start": {"velocity": [0.0, 0.0, 0.0], "height": height + 0.5 * diameter},
        "drag": {"law": law},
        **history,
        "solver": {"rtol": 1e-6},
        "run": {"duration": duration},
    }


class Course(NamedTuple):
    """A flight: times (s), gaps under the sphere (m), speeds upwards (m/s) at the nodes of its steps, and the times of its contacts."""

    time: Floats
    gap: Floats
    speed: Floats
    contacts: Floats

    def at(self, times: Floats) -> Floats:
        """The gap at any time, by the cubic through places and speeds at both nodes; where it ends the sphere lies."""
        k = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        h = self.time[k + 1] - self.time[k]
        s = np.clip((times - self.time[k]) / h, 0.0, 1.0)
        rise = h * s * (1.0 - s) * (self.speed[k] * (1.0 - s) - self.speed[k + 1] * s)
        found: Floats = self.gap[k] * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + self.gap[k + 1] * s * s * (3.0 - 2.0 * s) + rise
        return found


def flown(content: Mapping[str, Any], closure: Closure = PLAIN) -> Course:
    """The flight of a scene. What no field of a scene says is changed in what was built for it: numbers, not types, so that nothing is compiled anew."""
    scene = scene_of(content)
    engine, numbers = Engine(scene), scene.numbers
    if closure.drag != 1.0:
        forces = tuple(force._replace(rate=closure.drag * force.rate) if hasattr(force, "rate") else force for force in engine.equation.forces)
        engine.equation = engine.equation._replace(forces=forces)
    if scene.bed is not None:
        law = engine.rebound
        engine.rebound = law._replace(restitution=law.restitution._replace(dry=closure.dry)) if law.restitution.damping else law
    if closure.constants is not None:
        tail = engine.tables.tail
        assert tail is not None
        matched = engine.horizon if tail.far > engine.horizon else None
        engine.following = following(engine.tables.count, tail, closure.constants, numbers.reynolds, numbers.reynolds, (0.0, math.inf), matched)
    result = fly(engine, lambda share: None)
    path = result.trajectory
    contacts = (result.all_jumps["start"] + result.all_jumps["duration"]).to_numpy() * numbers.time
    gap = (path["z"].to_numpy() - 0.5) * numbers.diameter
    return Course(path["time"].to_numpy() * numbers.time, gap, path["w"].to_numpy() * numbers.velocity, contacts)


def fall(bounce: Bounce, choice: Choice, closure: Closure = PLAIN) -> tuple[float, float]:
    """From which gap (m) a sphere at rest reaches the measured speed at the wall, HIGHEST if it never does, and how long it falls (s)."""
    content = content_of(bounce.ratio, bounce.viscosity, bounce.diameter, choice, closure.law, HIGHEST, 12.0)
    path = flown(content, closure)
    fast = np.flatnonzero(-path.speed >= bounce.speed)
    end = int(fast[0]) if len(fast) and path.gap[fast[0]] > 0.0 else int(np.flatnonzero(path.gap <= 0.0)[0])
    values, wanted = (-path.speed, bounce.speed) if len(fast) and path.gap[fast[0]] > 0.0 else (-path.gap, 0.0)
    share = (wanted - values[end - 1]) / (values[end] - values[end - 1])
    time = path.time[end - 1] + share * (path.time[end] - path.time[end - 1])
    return HIGHEST - float(path.at(np.array([time]))[0]), float(time)


def bounced(bounce: Bounce, choice: Choice, closure: Closure, drop: tuple[float, float], until: float, **restitution: Any) -> Course:
    """The fall and the bounces, times from the first contact."""
    height, time = drop
    content = content_of(bounce.ratio, bounce.viscosity, bounce.diameter, choice, closure.law, height, time + until + BEYOND)
    bed = {"rebound": "tsuji", "roughness": "flat", "friction": 0.0, **restitution}
    path = flown(content | {"bed": bed}, closure)
    first = path.contacts[0]
    return path._replace(time=path.time - first, contacts=path.contacts - first)


class Sweep(NamedTuple):
    """What a worker flies: one motion with one choice and closure, over values of k, or of the restitution of every contact."""

    bounce: Bounce
    choice: Choice
    closure: Closure
    times: Floats  # s
    values: Floats
    constant: bool  # whether the values are restitutions


def swept(task: Sweep) -> Floats:
    """Gaps (m) at the times SHIFT earlier, at them, and SHIFT later (values, 3, times)."""
    drop, until, found = fall(task.bounce, task.choice, task.closure), float(task.times[-1]), []
    for value in task.values:
        law = {"restitution": float(value)} if task.constant else {"restitution": "stokes", "stokes_decay": float(value)}
        path = bounced(task.bounce, task.choice, task.closure, drop, until, **law)
        found.append([path.at(task.times + shift) for shift in (-SHIFT, 0.0, SHIFT)])
    return np.array(found)


def several(function: Any, tasks: Sequence[Any]) -> list[Any]:
    """Of every task, over all cores."""
    if cores() == 1 or len(tasks) == 1:
        return [function(task) for task in tasks]
    with processes(min(cores(), len(tasks))) as pool:
        return list(pool.map(function, tasks))


# Fits


class Misfit(NamedTuple):
    """Model minus measured heights over the first apex, by the fitted number, of every motion: arrays (values, points)."""

    values: Floats
    apart: Mapping[str, Floats]

    def rms(self, name: str, weights: Floats | None = None) -> Floats:
        """Root mean square over the points of a motion, by the fitted number; `weights`: how often each point counts."""
        square = self.apart[name] ** 2
        return np.asarray(np.sqrt(square.mean(axis=1) if weights is None else square @ weights / weights.sum()))

    def best(self, names: Iterable[str] | None = None, weights: Mapping[str, Floats] | None = None) -> float:
        """The number at which the mean over the motions of the mean squares is least, between the values by a parabola."""
        every = list(self.apart if names is None else names)
        total = sum((self.rms(name, None if weights is None else weights[name]) ** 2 for name in every), np.zeros(len(self.values)))
        return lowest(self.values, total)

    def at(self, name: str, value: float) -> float:
        """The rms of a motion at a value of the fitted number."""
        return float(np.interp(value, self.values, self.rms(name)))

    def total(self, value: float, names: Iterable[str] | None = None) -> float:
        """Root of the mean over the motions of the mean squares there."""
        return math.sqrt(float(np.mean([self.at(name, value) ** 2 for name in (self.apart if names is None else names)])))


def lowest(values: Floats, of: Floats) -> float:
    """Where a function by its values at even places is least: the vertex of the parabola about the smallest."""
    k = int(np.argmin(of))
    if k in (0, len(of) - 1):
        return float(values[k])
    bend = of[k - 1] - 2.0 * of[k] + of[k + 1]
    return float(values[k] + 0.5 * (values[1] - values[0]) * (of[k - 1] - of[k + 1]) / bend) if bend > 0.0 else float(values[k])


def finer(values: Floats, gaps: Floats, steps: int) -> tuple[Floats, Floats]:
    """Values and gaps at `steps` times as many values, by a spline over them."""
    fine = np.linspace(values[0], values[-1], steps * (len(values) - 1) + 1)
    return fine, CubicSpline(values, gaps)(fine)


def draws(count: int, points: int, rng: np.random.Generator) -> Floats:
    """How often each of the points is drawn, in blocks of neighbours, the last beside the first (count, points)."""
    starts = rng.integers(0, points, (count, math.ceil(points / BLOCK)))
    chosen = ((starts[:, :, None] + np.arange(BLOCK)) % points).reshape(count, -1)[:, :points]
    return np.array([np.bincount(row, minlength=points) for row in chosen], dtype=np.float64)


def interval(found: Sequence[float]) -> list[float]:
    """The central 95 %."""
    return [float(value) for value in np.quantile(found, [0.025, 0.975])]


def misfit(values: Floats, gaps: Mapping[str, Floats], measured: Mapping[str, Floats]) -> Misfit:
    """From gaps (values, points) and measured ones, over the first apexes."""
    scales = {bounce.name: bounce.scale for bounce in BOUNCES}
    return Misfit(values, {name: (gaps[name] - measured[name]) / scales[name] for name in gaps})


# What is asked


def first_flights(points: Mapping[str, Floats], count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """One number per motion: the restitution of the first contact, from the points of the first flight; with what the record's full tables have."""
    chosen = {bounce.name: first_points(bounce, points[bounce.name]) for bounce in BOUNCES}
    coarse = np.arange(0.24, 0.961, 0.06)
    tasks = [(bounce, choice) for choice in CHOICES for bounce in BOUNCES]
    looked = several(swept, [Sweep(bounce, choice, PLAIN, chosen[bounce.name][:, 0], coarse, True) for bounce, choice in tasks])
    middles = []
    for (bounce, _), gaps in zip(tasks, looked, strict=True):
        apart = misfit(coarse, {bounce.name: gaps[:, 1]}, {bounce.name: chosen[bounce.name][:, 1]})
        middles.append(round(apart.best(), 3))
    fine: list[Floats] = [np.clip(middle, 0.04, 0.96) + np.arange(-0.04, 0.0401, 0.005) for middle in middles]
    nearby = [Sweep(bounce, choice, PLAIN, chosen[bounce.name][:, 0], values, True) for (bounce, choice), values in zip(tasks, fine, strict=True)]
    close = several(swept, nearby)
    rows = []
    for (bounce, choice), values, gaps in zip(tasks, fine, close, strict=True):
        dense, heights = finer(values, gaps[:, 1], 10)
        apart = misfit(dense, {bounce.name: heights}, {bounce.name: chosen[bounce.name][:, 1]})
        e = apart.best()
        again = [apart.best(weights={bounce.name: weights}) for weights in draws(count, len(chosen[bounce.name]), rng)]
        path = bounced(bounce, choice, PLAIN, fall(bounce, choice), bounce.contacts[0], restitution=e)
        following_contact = float(path.contacts[1]) if len(path.contacts) > 1 else None
        rows.append(
            {
                "motion": bounce.name,
                **choice._asdict(),
                "e": e,
                "interval": interval(again),
                "rms": apart.at(bounce.name, e) * bounce.scale,
                "next": following_contact,
                "speed": -float(path.speed[path.time < 0.0].min()),
            }
        )
    return rows


def first_points(bounce: Bounce, points: Floats) -> Floats:
    """The points of the first flight; of key points its apex and the contact behind it."""
    key = len(points) == len(bounce.key_points())
    return points[points[:, 0] <= bounce.contacts[0]] if key else points[points[:, 0] < bounce.contacts[0] - facts.MARGIN]


def misfits(points: Mapping[str, Floats], closures: Mapping[str, Closure], values: Floats) -> dict[str, dict[Choice, dict[str, Floats]]]:
    """Gaps (values, 3, points) by k, of every closure, choice and motion."""
    tasks = [(name, choice, bounce) for name in closures for choice in CHOICES for bounce in BOUNCES]
    gaps = several(swept, [Sweep(bounce, choice, closures[name], points[bounce.name][:, 0], values, False) for name, choice, bounce in tasks])
    found: dict[str, dict[Choice, dict[str, Floats]]] = {}
    for (name, choice, bounce), array in zip(tasks, gaps, strict=True):
        found.setdefault(name, {}).setdefault(choice, {})[bounce.name] = array
    return found


def by_k(values: Floats, gaps: Mapping[str, Floats], measured: Mapping[str, Floats], shift: int = 1) -> Misfit:
    """Misfit by k at steps of a tenth."""
    dense = np.linspace(values[0], values[-1], round(10.0 * (values[-1] - values[0])) + 1)
    heights = {name: np.array([np.interp(dense, values, column) for column in array[:, shift].T]).T for name, array in gaps.items()}
    return misfit(dense, heights, measured)


def joint(found: Mapping[Choice, Misfit], points: Mapping[str, Floats], count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """One number for all: k of every choice, with intervals over points and over motions."""
    weights = {name: draws(count, len(array), rng) for name, array in points.items()}
    rows = []
    for choice, apart in found.items():
        k = apart.best()
        again = [apart.best(weights={name: weights[name][draw] for name in points}) for draw in range(count)]
        alone = {name: apart.best([name]) for name in points}
        rows.append(
            {
                **choice._asdict(),
                "k": k,
                "by_points": interval(again),
                "by_motions": [min(alone.values()), max(alone.values())],
                "alone": {name: {"k": value, "rms": apart.at(name, value)} for name, value in alone.items()},
                "rms": {name: apart.at(name, k) for name in points},
                "total": apart.total(k),
            }
        )
    return rows


def verdict(totals: Mapping[Choice, float]) -> dict[str, Any]:
    """What a ranking of all choices says: the first three, whether remembering wins with every kernel, whether forgetting loses to both others with each."""
    order = sorted(totals, key=lambda choice: totals[choice])
    wins, loses = {}, {}
    for kernel in ("basset", *KERNELS):
        of = {rebound: totals[Choice(rebound, kernel)] for rebound in REBOUNDS}
        wins[kernel] = min(of, key=of.__getitem__) == "impulse"
        loses[kernel] = max(of["impulse"], of["restart"]) < min(of["reset"], of["none"])
    return {"first": [choice.label for choice in order[:3]], "impulse_wins": wins, "forgetting_loses": loses, "last": order[-1].label}


def stability(
    points: Mapping[str, Floats], gaps: Mapping[str, Mapping[Choice, Mapping[str, Floats]]], values: Mapping[str, Floats], count: int, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """The ranking again: without each motion, with other drag, with the contact earlier or later; and how often it holds over noise of the digits."""
    measured = {name: array[:, 1] for name, array in points.items()}
    names = list(points)
    plain = {choice: by_k(values["as it is"], array, measured) for choice, array in gaps["as it is"].items()}

    def ranked(found: Mapping[Choice, Misfit], which: Sequence[str]) -> dict[Choice, float]:
        return {choice: apart.total(apart.best(which), which) for choice, apart in found.items()}

    def row(change: str, found: Mapping[Choice, Misfit], which: Sequence[str] = names) -> dict[str, Any]:
        return {"change": change, **verdict(ranked(found, which)), "k": {choice.label: apart.best(which) for choice, apart in found.items()}}

    rows = [row("as it is", plain)]
    rows += [row(f"without {left_out}", plain, [name for name in names if name != left_out]) for left_out in names]
    rows += [row(name, {choice: by_k(values[name], array, measured) for choice, array in gaps[name].items()}) for name in gaps if name != "as it is"]
    for shift, word in ((0, "earlier"), (2, "later")):
        found = {choice: by_k(values["as it is"], array, measured, shift) for choice, array in gaps["as it is"].items()}
        rows.append(row(f"points {1e3 * SHIFT:g} ms {word}", found))
    scales = {bounce.name: bounce.scale for bounce in BOUNCES}
    wins, loses = 0, 0
    for _ in range(noises := min(count, 300)):
        noise = {name: rng.normal(0.0, DIGITS, len(array)) / scales[name] for name, array in points.items()}
        noisy = {choice: Misfit(apart.values, {name: apart.apart[name] + noise[name] for name in names}) for choice, apart in plain.items()}
        said = verdict(ranked(noisy, names))
        wins += all(said["impulse_wins"].values())
        loses += all(said["forgetting_loses"].values())
    rows.append({"change": "digits", "draws": noises, "impulse_wins": wins, "forgetting_loses": loses})
    return rows


class Pair(NamedTuple):
    """What a worker flies for a law with two free numbers: a choice, and the closures that stand for the first of them."""

    name: str
    choice: Choice
    closures: tuple[Closure, ...]
    first: Floats
    second: Floats  # k


def pairs(full: bool) -> list[Pair]:
    """Laws with two free numbers: the restitution at large St and k; and a kernel's constant and k, with the dry restitution as it was measured."""
    dry, k = (np.arange(0.76, 1.001, 0.02), np.arange(6.0, 25.1, 1.0)) if full else (np.arange(0.76, 1.001, 0.08), np.arange(4.0, 26.1, 2.0))
    c2, near = (np.arange(0.20, 0.451, 0.025), np.arange(10.0, 20.1, 0.5)) if full else (np.array([0.1, 0.2, 0.3, 0.4]), k)
    chosen = [Choice("impulse", kernel) for kernel in ("basset", *KERNELS)] + [Choice()]
    found = [Pair("dry restitution and k", choice, tuple(Closure(dry=float(value)) for value in dry), dry, k) for choice in chosen]
    made = tuple(Closure(constants=(FIT_POWER, float(value))) for value in c2)
    return [*found, Pair("kernel's c2 and k", Choice("impulse", FIT_KERNEL), made, c2, near)]


def two_numbers(points: Mapping[str, Floats], full: bool, count: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """The least misfit of every law with two free numbers, and the intervals of both over the points."""
    weights = {name: draws(count, len(array), rng) for name, array in points.items()}
    rows = []
    for pair in pairs(full):
        tasks = [Sweep(bounce, pair.choice, closure, points[bounce.name][:, 0], pair.second, False) for bounce in BOUNCES for closure in pair.closures]
        gaps = several(swept, tasks)
        squares, count_of = {}, len(pair.closures)
        for place, bounce in enumerate(BOUNCES):
            array = np.array([gap[:, 1] for gap in gaps[place * count_of : (place + 1) * count_of]])  # (first, k, points)
            squares[bounce.name] = ((array - points[bounce.name][:, 1]) / bounce.scale) ** 2
        first, second = lowest_of(pair, sum(square.mean(axis=2) for square in squares.values()))
        again = [lowest_of(pair, sum(squares[name] @ weights[name][draw] / weights[name][draw].sum() for name in squares)) for draw in range(count)]
        rows.append(
            {
                "law": pair.name,
                **pair.choice._asdict(),
                "first": pair.first[first],
                "k": pair.second[second],
                "rms": {name: float(np.sqrt(square.mean(axis=2)[first, second])) for name, square in squares.items()},
                "first_interval": interval([pair.first[one] for one, _ in again]),
                "k_interval": interval([pair.second[two] for _, two in again]),
            }
        )
    return rows


def lowest_of(pair: Pair, total: Any) -> tuple[int, int]:
    """Places of the two numbers at which a total is least."""
    first, second = np.unravel_index(int(np.argmin(total)), (len(pair.first), len(pair.second)))
    return int(first), int(second)


# Falls without a bed


def fallen(ratio: float, viscosity: float, diameter: float, choice: Choice, closure: Closure, duration: float) -> tuple[Floats, Floats, float]:
    """Times (s), speeds (m/s) of a sphere that sets out from rest, and its speed in the end, by weight and drag alone."""
    content = content_of(ratio, viscosity, diameter, choice, closure.law, 0.0, duration)
    last = settling_velocity(scene_of(content))
    assert last is not None
    path = flown(content, closure)
    return path.time, -path.speed, last


WINDOWS = ((0.0, 3.0), (3.0, 10.0), (10.0, math.inf))  # √(d/g)


def settling(folder: Path | None, c2: float) -> dict[str, Any]:
    """Falls from rest: the times to 95 % of the terminal speed; with the record at Re 41 the deviations of the speed."""
    chosen = {choice.kernel or choice.label: (choice, PLAIN) for choice in (Choice(), *(Choice("impulse", kernel) for kernel in ("basset", *KERNELS)))}
    chosen["fitted c2"] = (Choice("impulse", FIT_KERNEL), Closure(constants=(FIT_POWER, c2)))
    times = []
    for case in facts.FALLS:
        row: dict[str, Any] = {"motion": case.name, "measured": case.time, "last": case.speed}
        for name, (choice, closure) in chosen.items():
            time, speed, last = fallen(case.ratio, case.viscosity, case.diameter, choice, closure, 12.0 * case.time)
            row["model_last"] = last
            row[name] = float(np.interp(0.95 * last, np.maximum.accumulate(speed), time)) if speed.max() >= 0.95 * last else None
        times.append(row)
    tanks = []
    for tank in facts.TANKS:
        row = {"motion": tank.name, "measured": tank.share * tank.endless}
        for name, (choice, closure) in chosen.items():
            content = content_of(
                facts.TANK_DENSITY / tank.density, tank.viscosity / tank.density, facts.TANK_DIAMETER, choice, closure.law, facts.TANK_FALL, 8.0
            )
            path = flown(content, closure)
            row[name] = float(-path.speed[path.gap > 0.0].min())
        tanks.append(row)
    case, courses = facts.FALLS[0], {}
    seen = np.linspace(0.0, 6.0 * case.time, 121)
    for name, (choice, closure) in chosen.items():
        time, speed, _ = fallen(case.ratio, case.viscosity, case.diameter, choice, closure, 6.5 * case.time)
        courses[name] = np.interp(seen, time, speed)
    found = {
        "times": times,
        "tanks": tanks,
        "courses": {"time": seen, **courses},
        "windows": [list(window) for window in WINDOWS[:-1]] + [[WINDOWS[-1][0], None]],
    }
    return found if folder is None else found | {"re41": against_record(facts.read(folder / facts.RE41_FILE), chosen)}


def against_record(points: Floats, chosen: Mapping[str, tuple[Choice, Closure]]) -> list[dict[str, Any]]:
    """Speeds at Re 41 against the record's: as they are, over that of each where the record ends, and with the drag that gives the measured last speed."""
    diameter = 0.5e-3
    unit, time_unit = math.sqrt(GRAVITY * diameter), math.sqrt(diameter / GRAVITY)
    viscosity = math.sqrt(GRAVITY * diameter**3) / facts.RE41_GALILEI
    case = facts.FALLS[0]
    fit = case.speed / unit * (1.0 - np.exp(-3.0 * points[:, 0] * time_unit / case.time))
    rows = [{"choice": "the authors' exponential", "last": "as it is", **deviations(points, fit)}]
    for name, (choice, closure) in chosen.items():
        for how in ("as it is", "speeds over that at the record's end", "drag for the last speed"):
            own = closure
            if how == "drag for the last speed":
                own = closure._replace(drag=drag_for(facts.RE41_LAST * unit, viscosity, diameter))
            time, speed, _ = fallen(facts.RE41_RATIO, viscosity, diameter, choice, own, 1.2 * points[-1, 0] * time_unit)
            seen = np.interp(points[:, 0] * time_unit, time, speed) / unit
            scale = points[-1, 1] / seen[-1] if how == "speeds over that at the record's end" else 1.0
            rows.append({"choice": name, "last": how, **deviations(points, scale * seen)})
    return rows


def drag_for(speed: float, viscosity: float, diameter: float) -> float:
    """The factor on the drag law with which the sphere of Re 41 settles at a speed: its weight over the law's drag there."""
    content = content_of(facts.RE41_RATIO, viscosity, diameter, Choice(), PLAIN.law, 0.0, 1.0)
    numbers = scene_of(content).numbers
    slip = speed / numbers.velocity
    return float(numbers.reynolds / (18.0 * slip * LAWS[PLAIN.law].factor(slip * numbers.reynolds)))


def deviations(points: Floats, speeds: Floats) -> dict[str, Any]:
    """The rms (√(g d)), and the largest deviation over the measured speed, in all and in windows of time."""
    apart = speeds / points[:, 1] - 1.0
    largest = [float(apart[inside][np.argmax(np.abs(apart[inside]))]) for low, high in WINDOWS for inside in [(points[:, 0] >= low) & (points[:, 0] < high)]]
    return {"rms": float(np.sqrt(np.mean((speeds - points[:, 1]) ** 2))), "largest": max(largest, key=abs), "windows": largest}


# Pictures


def curves(rows: Sequence[Mapping[str, Any]], fitted: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Courses (ms, mm) of every choice at its k, and of the law with a fitted constant of the kernel."""
    laws = {(choice := Choice(row["rebound"], row["kernel"])).label: (choice, PLAIN, row["k"]) for row in rows}
    laws["fitted c2"] = (Choice(fitted["rebound"], fitted["kernel"]), Closure(constants=(FIT_POWER, float(fitted["first"]))), float(fitted["k"]))
    found: dict[str, dict[str, Any]] = {}
    for bounce in BOUNCES:
        times = np.linspace(-0.06, 1.06, 281) * bounce.contacts[-1]
        found[bounce.name] = {"time": rounded(1e3 * times, 4)}
        for name, (choice, closure, k) in laws.items():
            course = bounced(bounce, choice, closure, fall(bounce, choice, closure), float(times[-1]), restitution="stokes", stokes_decay=k)
            found[bounce.name][name] = rounded(1e3 * np.maximum(course.at(times), 0.0), 4)
    return found


def run(full: bool, records: Path | None = None) -> dict[str, Any]:
    """All of it; from the records in a folder, or without one from the key figures."""
    rng = np.random.default_rng(SEED)
    count = 1000 if full else 100
    points = {bounce.name: bounce.points(records) for bounce in BOUNCES}
    closures = {"as it is": PLAIN} | (CLOSURES if full else {})
    values = {name: np.arange(1.0, 48.01, 0.5 if full and name == "as it is" else 1.0 if full else 2.0) for name in closures}
    gaps = {name: misfits(points, {name: closure}, values[name])[name] for name, closure in closures.items()}
    plain = {choice: by_k(values["as it is"], array, {name: own[:, 1] for name, own in points.items()}) for choice, array in gaps["as it is"].items()}
    together = joint(plain, points, count, rng)
    pair = two_numbers(points, full, count, rng)
    fitted = next(row for row in pair if row["law"].startswith("kernel"))
    return {
        "from_records": records is not None,
        "motions": [{**motion(bounce), "points": len(points[bounce.name])} for bounce in BOUNCES],
        "first_flights": rounded(first_flights(points, count, rng)),
        "joint": rounded(together),
        "stability": rounded(stability(points, gaps, values, count, rng)),
        "two_numbers": rounded(pair),
        "settling": rounded(settling(records, float(fitted["first"]))),
        "curves": curves(together, fitted),
        "by_k": {choice.label: rounded([apart.total(k) for k in K_SHOWN], 4) for choice, apart in plain.items()} | {"k": K_SHOWN},
        "draws": count,
    }


def motion(bounce: Bounce) -> dict[str, Any]:
    """What the page says of a motion."""
    return {"name": bounce.name, "stokes": bounce.stokes, "reynolds": bounce.reynolds, "scale": bounce.scale, "key": bounce.key_points()}
