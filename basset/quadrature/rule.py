"""The contract of a rule.

A rule replaces the history integral by a sum over samples, newest first:

    ∫_0^{t_n} K(t_n − τ) g(τ) dτ ≈ Σ_j w[j] g(t_{n−j}),   t_n = n·dt,

and says how by a recipe: the weights of the remembered steps, how many these are, and what stands for older ones.
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar, overload

import numpy as np

from basset import _validate
from basset.kernels import AnyKernel, BassetKernel, Floats, Kernel, VaryingSlipKernel, checked_kernel
from basset.streaming import LONGEST, Plan, VaryingPlan, slip
from basset.streaming.state import steps_to
from basset.weights.table import INPUTS, TABLES, Recipe, step_factor, table


class Rule(abc.ABC):
    """A way to compute the history integral from samples on a uniform grid.

    Subclasses are frozen dataclasses that hold the parameters of one published method, checked on creation.

    Attributes
    ----------
    name : str
        The rule's name in `basset.SCHEMES`.
    error_order : float
        The exponent of dt in the error, for a smooth rate.
    references : tuple of str
        Where the method was published.
    inputs : tuple of str
        What the samples may be: "rate" (g = df/dt) and, where the method has such a form, "slip" (f itself).

    References
    ----------
    Each subclass names its own, in its docstring and as `references`; the form that all have in common: this library.

    Examples
    --------
    >>> from basset import Daitche
    >>> rule = Daitche(order=2)
    >>> rule.name, rule.error_order, rule.inputs
    ('daitche', 3.0, ('rate', 'slip'))
    >>> rule.weights(1, 4.0).round(12)  # one panel of 4 s: 2√4 in all
    array([2.66666667, 1.33333333])
    >>> plan = rule.plan(dt=0.1, horizon=1.0)
    >>> plan.run(plan.start(), np.ones(11))[-1].round(12)  # f' = 1: 2√t
    np.float64(2.0)
    """

    name: ClassVar[str]
    references: ClassVar[tuple[str, ...]]

    @property
    @abc.abstractmethod
    def error_order(self) -> float:
        """The exponent of dt in the error for a smooth rate, dimensionless."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """What the samples may be."""
        return ("rate",)

    @property
    def whole(self) -> Rule:
        """The same method over the whole history; itself where it has no window."""
        return self

    @property
    def at_any_times(self) -> tuple[int, float]:
        """(degree of the polynomials, relative error of a sum that replaces K) for samples at nonuniform times; degree 0: none, error 0: K itself."""
        return 0, 0.0

    @abc.abstractmethod
    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """What the method does at one step size: the one method that a rule must define.

        Parameters
        ----------
        dt : float, seconds
            Step size.
        horizon : float, seconds
            The longest time that will be remembered.
        kernel : Kernel or VaryingSlipKernel
            The memory kernel K.

        Returns
        -------
        basset.weights.Recipe
            Weights for a unit step, window in steps, and what stands for the kernel beyond it.

        Raises
        ------
        ValueError, TypeError
            If the rule does not support the kernel, the window is shorter than a step, or the tail was made for another kernel or does not reach from
            the window to the horizon.

        Examples
        --------
        >>> import basset
        >>> basset.Windowed(basset.Daitche(order=2), window=1.0).recipe(0.1, 10.0, basset.BassetKernel()).window
        10
        """

    def weights(self, n: int, dt: float, kernel: Kernel = BassetKernel(), input: str = "rate") -> Floats:
        """Weights w of H(t_n) ≈ Σ_j w[j] g(t_{n−j}), newest first.

        Parameters
        ----------
        n : int
            Number of steps, 1 or more.
        dt : float, seconds
            Step size.
        kernel : Kernel
            The memory kernel K.
        input : {"rate", "slip"}
            For "slip" the weights act on f and give d/dt ∫K f (thesis 5-8), with the initial slip f(t_0) included.

        Returns
        -------
        ndarray of float64 (n+1,), s^(1/2) for "rate", s^(-1/2) for "slip"; the caller's own copy.

        Raises
        ------
        ValueError, TypeError
            If n < 1, dt ≤ 0 or not finite, or the rule does not support the kernel or the input.
        """
        n = _validate.integer("n", n, 1)
        dt = _validate.positive("dt", dt, "seconds")
        accept(self, kernel, input)
        recipe = self.recipe(dt, n * dt, kernel)
        if recipe.tail is not None:
            return Plan(recipe.within(n), dt, n, kernel).weights(n)
        used = recipe.used(n)
        result = np.zeros(n + 1)
        oldest, body = table(recipe.stencil, kernel.scaled(dt), input).row(used)
        result[: len(body)] = body[::-1]
        result[len(body) : used + 1] = oldest[::-1]
        result *= step_factor(dt, input)
        if used < n and input == "slip":  # the slip before the window is dropped, without a jump at the window's edge
            result[used] -= float(kernel(used * dt))
        TABLES.trim()
        return result

    @overload
    def plan(self, dt: float, horizon: float, kernel: Kernel = ...) -> Plan: ...

    @overload
    def plan(self, dt: float, horizon: float, kernel: VaryingSlipKernel) -> VaryingPlan: ...

    def plan(self, dt: float, horizon: float, kernel: AnyKernel = BassetKernel()) -> Plan | VaryingPlan:
        """Make the rule ready to stream: all set-up happens here.

        Parameters
        ----------
        dt : float, seconds
            Step size.
        horizon : float, seconds
            The longest time that will be remembered, counted from the first sample. A window without tail, and a published
            tail, run on beyond it.
        kernel : Kernel or VaryingSlipKernel
            The memory kernel K; with a VaryingSlipKernel the plan's methods take `slip=`.

        Returns
        -------
        basset.streaming.Plan, or basset.streaming.VaryingPlan

        Raises
        ------
        ValueError, TypeError
            If dt or horizon is not positive, the rule does not support the kernel, the window is shorter than a step, or
            the tail was made for another kernel or does not reach from the window to the horizon.
        """
        steps, recipe = reach(self, dt, horizon, kernel)
        if isinstance(kernel, VaryingSlipKernel):
            return slip.plan(recipe, dt, steps, kernel)
        return Plan(recipe, dt, steps, kernel)


def accept(rule: Rule, kernel: Any, input: str) -> None:
    """Raise unless `kernel` is a kernel and the method has a form for `input`."""
    checked_kernel(kernel)
    _validate.choice("input", input, INPUTS)
    if input not in rule.inputs:
        raise ValueError(f"input must be 'rate' for {type(rule).__name__}, got {input!r}: the method is defined on samples of the rate df/dt only")


def reach(rule: Rule, dt: float, horizon: float, kernel: AnyKernel) -> tuple[int, Recipe]:
    """Steps of the horizon and what a stream does in them, before anything is computed for it; errors as `Rule.plan`."""
    dt, horizon = _validate.positive("dt", dt, "seconds"), _validate.positive("horizon", horizon, "seconds")
    if not isinstance(kernel, VaryingSlipKernel):
        accept(rule, kernel, "rate")
    steps = steps_to(horizon, dt)
    recipe = rule.recipe(dt, steps * dt, kernel).within(steps)
    if recipe.window is None and steps > LONGEST:
        raise ValueError(f"horizon must be at most {LONGEST:g} steps where the whole history is kept, got {steps:g} steps: take a window or basset.Exponential")
    if recipe.window is not None and recipe.window > LONGEST:
        raise ValueError(f"window must be at most {LONGEST:g} steps of dt = {dt:g} seconds in a stream, got {recipe.window:g} steps")
    return steps, recipe


def slip_recipes(rule: Rule, dt: float, horizon: float, kernel: VaryingSlipKernel) -> tuple[Recipe, Recipe, float, int, VaryingSlipKernel]:
    """What `basset.streaming.following.FollowingPlan` is made of; errors as `Rule.plan`."""
    return rule.recipe(dt, horizon, BassetKernel()), rule.whole.recipe(dt, horizon, kernel), dt, steps_to(horizon, dt), kernel
