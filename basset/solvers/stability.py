"""The longest stable fixed step: with a longer one the samples of a relaxing equation alternate in sign and grow.

For y' = −λy − c·H[y] a step is a recurrence with the characteristic function (1 − ζ)(1 + c√dt W(ζ)) + λ dt A(ζ), W and A the generating
functions of the rule's weights for a unit step and of the Adams–Moulton weights; the first root that enters the unit disk as dt
grows does so at ζ = −1, for every rule here. Steps with the history held have (1 − Rζ)(1 + c√dt W) − (1 − R)ζ c√dt W, R the
polynomial of Runge and Kutta, and a second bound R(λ dt) = 1. This library.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from basset import _validate
from basset.kernels import BassetKernel, Floats, gauss_legendre
from basset.quadrature import Rule, resolve
from basset.weights.lagrange import lagrange
from basset.weights.table import Recipe

LAGS = 1024  # the alternating sum of the weights, its last partial sums averaged, is good to 1e-9 by then
# these four are constants of compiled code, which this line marks for basset._compile
ALTERNATING = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 16.0  # of five rates: what alternates, and little of what is smooth
IN_A_ROW = 16  # growing and alternating: no smooth solution and no rounding does that
GEOMETRIC = 0.999  # of a swing's square, what the two beside it are when it grows by a factor; by equal amounts it is less for 30 steps
SHARE = 1e-6  # of the rates themselves
HARMLESS = 1e4  # growth over a run: what alternates is at the rounding of a smooth solution in the beginning
HELD_RATE = 2.785293563405282  # R = 1


@lru_cache(maxsize=16)
def adams_moulton(degree: int) -> Floats:
    """Weights of the newest degree+1 rates, newest first, in the integral over the newest step."""
    x, w = gauss_legendre(16)
    return np.asarray(w @ lagrange(np.arange(degree + 1.0), x)[0])


def whole_recipe(rule: Rule) -> Recipe:
    """What the rule does with the whole history of a unit step."""
    return rule.whole.recipe(1.0, 2.0 * LAGS, BassetKernel())


def degree_of(rule: Rule) -> int:
    """Degree with which the rates of all states are interpolated."""
    return max(1, whole_recipe(rule).degree)


@lru_cache(maxsize=256)
def symbols(rule: Rule, share: float = 1.0) -> tuple[float, float]:
    """(A, W) at ζ = −share: what both sets of weights make of samples that alternate and grow by 1/share from step to step."""
    plain, history = adams_moulton(degree_of(rule)), rule.whole.weights(2 * LAGS, 1.0)[:LAGS]
    partial = np.cumsum(history * (-share) ** np.arange(float(LAGS)))
    return float(np.polyval(plain[::-1], -share)), float(np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0 @ partial[-5:])


def bounds(rule: Rule) -> tuple[float, float]:
    """(largest λ·dt without memory, largest c·√dt without drag) of implicit steps; infinite where there is none.

    Between them (λ dt)/first + (c√dt)/second < 1 is stable.
    """
    drag, history = symbols(rule)
    return -2.0 / drag if drag < -1e-6 else math.inf, -1.0 / history if history < -1e-6 else math.inf


def held_factor(product: Any) -> Floats:
    """R of a Runge–Kutta step at λ·dt."""
    return np.asarray(1.0 - product * (1.0 - product / 2.0 * (1.0 - product / 3.0 * (1.0 - product / 4.0))))


def longest_step(rule: Rule | str, rate: float, coefficient: float, held: bool = False) -> float:
    """The longest stable fixed step (s) for y' = −λy − c·H[y], λ = `rate` in 1/s, c = `coefficient` in s^(-1/2); infinite where every step is.

    The history is `held` over the step, as `RungeKutta4` does, or implicit, as in `FixedStep`. Hairer, Nørsett & Wanner (1993), Solving Ordinary
    Differential Equations I, section III.1; with memory: this library.

    >>> import basset
    >>> longest_step(basset.Daitche(1), 1e6, 10.0)
    inf
    >>> round(longest_step(basset.Daitche(3), 1.0, 0.0), 12), round(longest_step(basset.Daitche(10), 1.0, 0.6), 5)
    (3.0, 0.00313)
    """
    rule = resolve(rule)
    rate, coefficient = _validate.non_negative("rate", rate, "1/s"), _validate.non_negative("coefficient", coefficient, "s^(-1/2)")
    drag, memory = bounds(rule)
    if not held:
        linear, square = coefficient / memory, rate / drag  # of √dt
        whole = linear + math.sqrt(linear * linear + 4.0 * square)  # a power would raise where the product is infinite
        root = 2.0 / whole if whole > 0.0 else math.inf
        return root * root
    if rate == 0.0:
        root = memory / coefficient if coefficient > 0.0 else math.inf
        return root * root
    steps = HELD_RATE / rate * np.linspace(0.0, 1.0, 4097)

    def beyond(dt: Any) -> Any:
        return coefficient * np.sqrt(dt) / memory >= 0.5 * (1.0 + held_factor(rate * dt))

    wrong = np.flatnonzero(beyond(steps))
    if not len(wrong):
        return float(steps[-1])
    low, high = float(steps[wrong[0] - 1]), float(steps[wrong[0]])  # no step of zero is beyond
    for _ in range(200):  # down to the last bit, also from zero
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return low


def stable(rule: Rule, dt: float, steps: int, jacobian: Floats, coefficient: Floats, held: bool) -> bool:
    """Whether alternating samples of y' = jacobian·y − coefficient·H[y], (n, n) and (n,), grow less than HARMLESS in so many steps."""
    share = HARMLESS ** (-1.0 / steps)
    plain, memory = symbols(rule, share)
    decay, history = -dt * jacobian, np.diag(math.sqrt(dt) * coefficient * memory)
    whole = np.eye(len(coefficient))
    if not held:
        return bool(np.linalg.eigvals((1.0 + share) * (whole + history) + plain * decay).real.min() > 0.0)
    own = np.linalg.eigvals(decay)
    if (np.abs(held_factor(own)[own.real > 0.0]) * share > 1.0).any():
        return False
    kept = whole - decay @ (whole - decay / 2.0 @ (whole - decay / 3.0 @ (whole - decay / 4.0)))
    return bool(np.linalg.eigvals(whole + share * kept + (1.0 + share) * history).real.min() > 0.0)
