"""Named, tagged test problems with exact answers, shared by tests and benchmarks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from basset import reference
from basset.kernels import Floats


@dataclass(frozen=True)
class Problem:
    """A slip f(t) (dimensionless) from t = 0 on, its rate, and its exact history integral.

    Tags: smooth (rate analytic on [0, end]), oscillating, polynomial, growth, decay, jump (f(0) ≠ 0), root (f ~ √t at the start), long,
    high_frequency, thesis.

    >>> import basset
    >>> problem = PROBLEMS["decay"]
    >>> H = basset.integrate(**problem.arguments(1000), rule="exponential")
    >>> bool(abs(H / problem.exact(problem.end) - 1.0) < 1e-5)
    True
    """

    name: str
    description: str
    tags: frozenset[str]
    end: float  # s, the time of the last node
    slip: Callable[[Floats], Floats]  # f(t), s (k,) to (k,)
    rate: Callable[[Floats], Floats] | None  # df/dt, s (k,) to 1/s (k,); None where it is not finite at t = 0
    exact: Callable[[Floats], Floats]  # H(t) in float64, s (k,), t > 0, to s^(-1/2) (k,)
    exact_digits: Callable[[Any, int], Any]  # (t, digits) -> mpmath number

    @property
    def initial_slip(self) -> float:
        """f(0), dimensionless."""
        return float(self.slip(np.zeros(1))[0])

    def grid(self, n: int) -> tuple[Floats, float]:
        """n+1 nodes on [0, end] and their distance, both in seconds."""
        return np.linspace(0.0, self.end, n + 1), self.end / n

    def arguments(self, n: int, input: str = "rate") -> dict[str, Any]:
        """The arguments g, dt, initial_slip, input for `basset.integrate` and `basset.cumulate` with n steps; `input` "rate" or "slip".

        ValueError if rates are asked for and the rate is not finite at t = 0.
        """
        t, dt = self.grid(n)
        if input == "slip":
            return {"g": self.slip(t), "dt": dt, "input": "slip"}
        if self.rate is None:
            raise ValueError(f"problem {self.name} has no finite rate at t = 0: use input='slip'")
        return {"g": self.rate(t), "dt": dt, "initial_slip": self.initial_slip, "input": "rate"}


def _cosine(name: str, description: str, end: float, omega: float = 1.0, *tags: str) -> Problem:
    return Problem(
        name,
        description,
        frozenset({"smooth", "oscillating", *tags}),
        end,
        lambda t: np.sin(omega * t) / omega,
        lambda t: np.cos(omega * t),
        lambda t: reference.cosine(t, omega),
        lambda t, digits: reference.cosine(t, omega, digits),
    )


def _exponential(name: str, description: str, rate: float, tag: str) -> Problem:
    return Problem(
        name,
        description,
        frozenset({"smooth", tag}),
        10.0,
        lambda t: np.expm1(rate * t) / rate,
        lambda t: np.exp(rate * t),
        lambda t: reference.exponential(t, rate),
        lambda t, digits: reference.exponential(t, rate, digits),
    )


def _power(k: int) -> Problem:
    return Problem(
        f"power_{k}",
        f"f' = τ^{k}",
        frozenset({"smooth", "polynomial"}),
        1.0,
        lambda t: t ** (k + 1) / (k + 1),
        lambda t: t**k,
        lambda t: reference.power(t, k),
        lambda t, digits: reference.power(t, k, digits),
    )


def _sine_with_slip(t: Floats) -> Floats:
    return np.asarray(reference.step(t) - reference.sine(t))


def _sine_with_slip_digits(t: Any, digits: int) -> Any:
    with mpmath.workdps(digits + 10):
        return reference.step(t, 1.0, digits) - reference.sine(t, 1.0, digits)


_ALL = (
    _cosine("fresnel", "f' = cos τ to t = 50π, the thesis's test, where f'' = 0 flatters odd expansions", 50.0 * np.pi, 1.0, "thesis"),
    _cosine("fresnel_generic", "f' = cos τ to t = 50π + 1, a time like any other", 50.0 * np.pi + 1.0),
    _cosine("fresnel_long", "f' = cos τ to t = 1e4π", 1e4 * np.pi, 1.0, "long"),
    _cosine("high_frequency", "f' = cos 40τ to t = 10", 10.0, 40.0, "high_frequency"),
    Problem(
        "sine_with_slip",
        "f = cos τ: f' = −sin τ and an initial slip of 1",
        frozenset({"smooth", "oscillating", "jump"}),
        20.0,
        np.cos,
        lambda t: -np.sin(t),
        _sine_with_slip,
        _sine_with_slip_digits,
    ),
    _exponential("growth", "f' = e^τ", 1.0, "growth"),
    _exponential("decay", "f' = e^(−τ)", -1.0, "decay"),
    *(_power(k) for k in range(11)),
    Problem(
        "step",
        "f jumps to 1 at t = 0 and stays",
        frozenset({"jump"}),
        10.0,
        np.ones_like,
        np.zeros_like,
        reference.step,
        lambda t, digits: reference.step(t, 1.0, digits),
    ),
    Problem(
        "root",
        "f = √τ: H = π/2 at all times",
        frozenset({"root"}),
        10.0,
        np.sqrt,
        None,
        lambda t: reference.power_slip(t, 0.5),
        lambda t, digits: reference.power_slip(t, mpmath.mpf("0.5"), digits),
    ),
)

PROBLEMS: dict[str, Problem] = {problem.name: problem for problem in _ALL}


def tagged(*tags: str) -> list[Problem]:
    """The problems that carry every one of `tags`."""
    return [problem for problem in PROBLEMS.values() if problem.tags.issuperset(tags)]
