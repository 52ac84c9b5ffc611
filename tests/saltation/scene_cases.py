"""Scenes made from the shipped ones, runs without the compiler, and exact motions, shared by the tests of the simulator."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

import numpy as np
import scipy.optimize

import saltation
from basset import _compile, reference
from basset._compile import is_compiled
from basset.solvers import stepper
from basset.solvers._tables import StepTables
from saltation.flight import collisions, contact, equations, fixed, loop
from saltation.scene import scene_of
from saltation.study.thesis import case

BARE = {"effects": ["weight"], "run": {"duration": 1.0}}


def merged(content: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`content` with `changes`, table by table; None takes a field or a table out."""
    result = dict(content)
    for key, value in changes.items():
        if value is None:
            result.pop(key, None)
        elif isinstance(value, dict):
            result[key] = merged(result.get(key, {}), value)
        else:
            result[key] = value
    return result


def scene(name: str, **changes: Any) -> Any:
    """A shipped scene with the thesis's laws and changes; `velocity`, `spin` and `height` of the start in units of V, V/d and d."""
    start = {key: changes.pop(key) for key in ("velocity", "spin", "height") if key in changes}
    content = merged(scene_of(case(name)).model_dump(exclude_none=True), changes)
    n = saltation.Scene.model_validate({key: content[key] for key in ("fluid", "grain", "channel") if key in content} | BARE).numbers
    unit = {"velocity": n.velocity, "spin": 1.0 / n.time, "height": n.diameter}
    content.setdefault("start", {})
    for key, value in start.items():
        content["start"][key] = [x * unit[key] for x in value] if isinstance(value, (list, tuple)) else value * unit[key]
    return saltation.Scene.model_validate(content)


@contextlib.contextmanager
def interpreted() -> Iterator[None]:
    """The flight as plain Python: the same source."""
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(_compile, "jit", lambda: False))
        for module in (equations, contact, loop, fixed, collisions, stepper):
            for name, value in list(vars(module).items()):
                if is_compiled(value):
                    stack.enter_context(mock.patch.object(module, name, value.py_func))
        # tables made here are kept by the process, and in this form would have all compiled anew
        stack.enter_context(mock.patch.object(StepTables, "placed", property(StepTables.placed.func)))
        yield


def flown(made: Any) -> saltation.Result:
    """Run a scene; its path is computed, with the forces on it, where it is asked for: that is another function to compile for each set of effects."""
    result = saltation.run(made)
    assert (result.path is not None) == made.run.trajectory
    return result


def linear(made: Any) -> tuple[float, float, float]:
    """(λ, c, g) of a scene with Stokes drag: w' = −g − λw − c·H[w] in its units."""
    n = made.numbers
    return 18.0 * n.alpha / n.reynolds, n.history if "history" in made.names else 0.0, n.alpha / n.shields


@dataclass
class Bouncer:
    """The exact vertical motion over a flat bed with Stokes drag for every kind of memory at an impact.

    With R the response to a slip that is remembered (`reference.response`) and S(t) = 1 − λ∫R that to one that is not,

        impulse  w(t) = −g∫R(t) + Σ Δ_j R(t − t_j)          restart  w(t_j + s) = y_j R(s) − g∫R(s)
        none     w(t) = −g∫R(t) + Σ Δ_j S(t − t_j)          reset    w(t_j + s) = y_j S(s) − g∫R(s)

    where Δ_j is the jump of the velocity and y_j the velocity after it.
    """

    rate: float
    coefficient: float
    gravity: float
    height: float
    restitution: float
    memory: str
    times: list[float] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    after: list[float] = field(default_factory=list)

    def answer(self, s: Any, integrals: int) -> Any:
        """R or S of the memory, its first or its second integral."""
        s = np.asarray(s, dtype=np.float64)
        if self.memory in ("impulse", "restart"):
            return reference.response(s, self.rate, self.coefficient, integrals)
        polynomial = 1.0 if integrals == 0 else s
        return polynomial - self.rate * reference.response(s, self.rate, self.coefficient, integrals + 1)

    def falling(self, t: Any, integrals: int) -> Any:
        """−g∫R or −g∫∫R."""
        return -self.gravity * reference.response(np.asarray(t, dtype=np.float64), self.rate, self.coefficient, integrals)

    def after_last(self, s: Any, integrals: int) -> Any:
        """Velocity (integrals = 1) or height (2) a time s after the newest impact."""
        if not self.times:
            return self.falling(s, integrals) + (self.height if integrals == 2 else 0.0)
        if self.memory in ("restart", "reset"):
            return self.after[-1] * self.answer(s, integrals - 1) + self.falling(s, integrals)
        now = self.times[-1]
        total = self.falling(now + s, integrals) + (self.height if integrals == 2 else 0.0)
        for time, jump in zip(self.times, self.jumps, strict=True):
            total = total + jump * self.answer(now + s - time, integrals - 1)
        return total

    def bounce(self) -> float:
        """Fly to the next impact; how long that took."""
        s = 1e-6 if self.times else 1e-3
        while self.after_last(s, 2) > 0.0:
            s *= 1.1
        flown = float(scipy.optimize.brentq(lambda x: float(self.after_last(x, 2)), s / 1.1, s, xtol=1e-14, rtol=1e-14))
        down = float(self.after_last(flown, 1))
        self.times.append((self.times[-1] if self.times else 0.0) + flown)
        self.jumps.append(-(1.0 + self.restitution) * down)
        self.after.append(-self.restitution * down)
        return flown

    def highest(self, flown: float) -> float:
        """Rise of the flight after the newest impact, which takes `flown`."""
        top = scipy.optimize.brentq(lambda x: float(self.after_last(x, 1)), 1e-12 * flown, flown, xtol=1e-15)
        return float(self.after_last(top, 2))


def gauss(function: Callable[[np.ndarray], np.ndarray], low: float, high: float, points: int = 60) -> float:
    """∫ of a function that is a series in √(t − low), by Gauss's rule in that root."""
    x, w = np.polynomial.legendre.leggauss(points)
    root = 0.5 * np.sqrt(high - low) * (x + 1.0)
    return float(np.sum(0.5 * np.sqrt(high - low) * w * 2.0 * root * function(low + root**2)))


def sand_cloud(duration: float, **changes: Any) -> Any:
    """The thesis's cloud for so many d/u*; with and without encounters these are the two forms of its loop that tests compile."""
    unit = saltation.load("sand_cloud").numbers.time
    return scene("sand_cloud", **merged(changes, {"run": {"duration": duration * unit, "discard": 0}}))


def cloud_scene(number: int, duration: float, **changes: Any) -> Any:
    """Weight and encounters alone, in still water without a bed: paths are parabolas. Duration in d/V."""
    bare: dict[str, Any] = {"effects": ["weight", "encounters"], "history": None, "cloud": {"number": number, "concentration": 0.003}, "run": {"discard": 0}}
    for name in ("channel", "bed"):
        if name not in changes:
            bare[name] = None
    content = merged(bare, changes)
    unit = scene("sand_cloud", **content).numbers.time
    return scene("sand_cloud", **merged(content, {"run": {"duration": duration * unit}}))


@contextlib.contextmanager
def starting(places: Any, velocities: Any, spins: Any = None) -> Iterator[None]:
    """Clouds set out from here: positions (d), velocities (V) and spins (V/d), (grain, 3)."""
    arrays = [np.array(values, dtype=np.float64) for values in (places, velocities, np.zeros(np.shape(places)) if spins is None else spins)]
    with mock.patch("saltation.flight.cloud.starts", lambda engine: tuple(arrays)):
        yield


def fly_cloud(made: Any, places: Any, velocities: Any, spins: Any = None) -> Any:
    """Run a cloud from given starts."""
    with starting(places, velocities, spins):
        return saltation.run(made)


def separations(result: Any) -> np.ndarray:
    """Distances of all pairs at all stored times, of the nearest images, (time, pair)."""
    path = result.trajectory
    axes = [name for name in "xyz" if name in path]
    one, two = np.triu_indices(path.sizes["grain"], 1)
    square = np.zeros((path.sizes["time"], len(one)))
    for axis, period in zip("xyz", result.scene.box, strict=True):
        if axis in axes:
            place = path[axis].to_numpy()
            apart = place[:, two] - place[:, one]
            if axis != "z" and result.scene.cloud.boundary == "periodic":
                apart -= period * np.round(apart / period)
            square += apart**2
    return np.sqrt(square)


def vectors(table: Any, *names: str) -> list[np.ndarray]:
    """Columns of vectors of the table of encounters: "first" -> first_u, …; "first_spin" -> first_spin_x, …; "_after" stays behind."""
    found = []
    for name in names:
        after = "_after" if name.endswith("_after") else ""
        stem = name.removesuffix("_after")
        axes = "uvw" if stem in ("first", "second") else "xyz"
        found.append(table[[f"{stem}_{axis}{after}" for axis in axes]].to_numpy())
    return found
