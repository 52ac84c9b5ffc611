"""Equations with memory whose solutions are known, shared by the tests of solvers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

import basset
from basset import reference

RTOLS = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)


def _kept(function: Callable[[float], Any]) -> Callable[[float], float]:
    """A force that solvers ask for again and again at the same times: stages that converge, the same steps in another run."""
    return lru_cache(maxsize=100_000)(lambda t: float(function(t)))


SINE, COSINE, POWER = _kept(reference.sine), _kept(reference.cosine), _kept(lambda t: reference.power(t, 5.0))


@dataclass(frozen=True)
class Case:
    """An equation on [0, end] and its exact solution (states, times)."""

    fun: Callable[..., Any]
    end: float
    y0: list[float]
    exact: Callable[[np.ndarray], np.ndarray]
    options: dict[str, Any] = field(default_factory=dict)

    def solve(self, method: basset.solvers.Method, **more: Any) -> basset.solvers.Solution:
        return basset.solve(self.fun, (0.0, self.end), self.y0, method=method, **(self.options | more))

    @cached_property
    def path(self) -> tuple[np.ndarray, np.ndarray]:
        """Times, denser towards the start, where the solution is a series in √t, and the exact states there."""
        t = self.end * np.union1d(np.linspace(0.0, 1.0, 201), np.geomspace(1e-9, 1.0, 91))
        return t, self.exact(t)

    def error(self, method: basset.solvers.Method) -> float:
        """The largest error on the path over the size of its component."""
        solution = self.solve(method, dense_output=True)
        assert solution.status == 0, solution.message
        t, exact = self.path
        return float((np.abs(solution.sol(t) - exact).max(axis=1) / np.abs(exact).max(axis=1)).max())


def relaxing(rate: float, c: float, end: float) -> Case:
    return Case(lambda t, y: -rate * y, end, [1.0], lambda t: reference.relaxing(t, rate, c)[None], {"coefficient": c})


def settling(rate: float, c: float, end: float, gravity: float = 1.0) -> Case:
    return Case(lambda t, y: -gravity - rate * y, end, [0.0], lambda t: reference.settling(t, rate, c, gravity)[None], {"coefficient": c})


def stream(rate: float, c: float, end: float, slip: float, omega: float = 1.0) -> Case:
    def exact(t: np.ndarray) -> np.ndarray:
        return reference.oscillating_stream(t, rate, c, 1.0, omega, slip)[None]

    return Case(lambda t, y: math.cos(omega * t) - rate * y, end, [slip], exact, {"coefficient": c})


def vortex(rate: float, c: float, beta: float, end: float, slip: complex = 0.0) -> Case:
    """States x, y and the two components of the slip."""

    def fun(t, y):
        z, w = complex(y[0], y[1]), complex(y[2], y[3])
        moved, changed = w + 1j * z, -(rate + 1j) * w + (1.0 - beta) * z
        return [moved.real, moved.imag, changed.real, changed.imag]

    def exact(t: np.ndarray) -> np.ndarray:
        motion = reference.solid_body_vortex(t, rate, c, beta, 1.0, 1.0, slip)
        return np.array([motion.position.real, motion.position.imag, motion.slip.real, motion.slip.imag])

    slip = complex(slip)
    return Case(fun, end, [1.0, 0.0, slip.real, slip.imag], exact, {"coefficient": c, "memory": [2, 3]})


def bagley_torvik(inertia: float, damping: float, stiffness: float, force: float, end: float, position: float = 0.0, velocity: float = 0.0) -> Case:
    def fun(t, y):
        return [y[1], (force - stiffness * y[0]) / inertia]

    def exact(t: np.ndarray) -> np.ndarray:
        return np.array(reference.bagley_torvik(t, inertia, damping, stiffness, force, 0.0, position, velocity))

    c = damping / inertia / math.sqrt(math.pi)
    return Case(fun, end, [position, velocity], exact, {"coefficient": c, "memory": [1], "initial_slip": [0.0]})


def smooth(rate: float, c: float, end: float) -> Case:
    """y = cos t without memory of the start."""

    def fun(t, y):
        return -math.sin(t) + rate * (math.cos(t) - y) - c * SINE(t)

    return Case(fun, end, [1.0], lambda t: np.cos(t)[None], {"coefficient": c, "initial_slip": [0.0]})


def flat(rate: float, c: float, end: float) -> Case:
    """y = t⁶: the history is smooth at the start as well, to t^5.5."""

    def fun(t, y):
        return 6.0 * t**5 + rate * (t**6 - y) + 6.0 * c * POWER(t)

    return Case(fun, end, [0.0], lambda t: (t**6)[None], {"coefficient": c})


def coupled(end: float) -> Case:
    """Two slips with coefficients of their own, nonlinear in each other, between them a position: y = (cos t, 1 + sin t, sin t)."""
    c = np.array([0.6, 2.0])

    def fun(t, y):
        pull = y[0] * y[2] - math.cos(t) * math.sin(t) + (y[1] - 1.0 - math.sin(t)) ** 2
        first = -math.sin(t) - pull - c[0] * SINE(t)
        return [first, y[0], math.cos(t) - pull - (y[2] - math.sin(t)) + c[1] * COSINE(t)]

    def exact(t: np.ndarray) -> np.ndarray:
        return np.array([np.cos(t), 1.0 + np.sin(t), np.sin(t)])

    return Case(fun, end, [1.0, 1.0, 0.0], exact, {"coefficient": c, "memory": [0, 2], "initial_slip": [0.0, 0.0]})


CASES: dict[str, Case] = {
    "relaxing": relaxing(1.0, 0.6, 4.0),
    "relaxing, fast drag": relaxing(30.0, 0.6, 4.0),
    "relaxing, mostly history": relaxing(0.1, 5.0, 4.0),
    "relaxing, no drag": relaxing(0.0, 1.0, 10.0),
    "relaxing, long": relaxing(1.0, 0.6, 1000.0),
    "settling": settling(1.0, 0.6, 4.0),
    "settling, mostly history": settling(1.0, 4.0, 10.0),
    "settling, equal roots": settling(1.0, 2.0 / math.sqrt(math.pi), 10.0),
    "stream": stream(1.0, 0.6, 20.0, 0.0),
    "stream with slip": stream(1.0, 0.6, 20.0, 1.0),
    "fast stream with slip": stream(5.0, 2.0, 5.0, 0.5, 10.0),
    "long stream with slip": stream(1.0, 0.6, 100.0, 1.0),
    "vortex, heavy": vortex(2.0, 0.7, 0.5, 6.0),
    "vortex, heavy, with slip": vortex(2.0, 0.7, 0.5, 6.0, 0.3 - 0.2j),
    "vortex, light": vortex(2.0, 2.0, 2.5, 6.0),
    "bagley_torvik, forced": bagley_torvik(1.0, 1.0, 1.0, 1.0, 20.0),
    "bagley_torvik, released": bagley_torvik(1.0, 0.5, 0.5, 0.0, 10.0, 1.0, -1.0),
    "bagley_torvik, weak damping": bagley_torvik(1.0, 0.1, 4.0, 1.0, 20.0, 0.0, 1.0),
    "smooth": smooth(1.0, 0.6, 6.0),
    "smooth, mostly history": smooth(10.0, 5.0, 6.0),
    "flat": flat(1.0, 0.6, 2.0),
    "coupled": coupled(6.0),
}


def drop(rate: float, c: float, restitution: float, end: float, method: basset.solvers.Method, lift: bool = False, **more: Any) -> basset.solvers.Solution:
    """A sphere dropped from rest at height 1 on a plane; states velocity and height. `lift`: contacts put it back on the plane."""

    def contact(t, y):
        return y[1]

    contact.direction = -1.0
    contact.jump = lambda t, y: np.array([-restitution * y[0], 0.0 if lift else y[1]])
    return basset.solve(lambda t, y: [-1.0 - rate * y[0], y[0]], (0.0, end), [0.0, 1.0], coefficient=c, method=method, events=contact, **more)
