"""A full-history rule on a window of the newest samples; beyond it the kernel is dropped or replaced by a sum of exponentials."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from basset import _validate
from basset.exponentials import ExponentialSum
from basset.kernels import AnyKernel
from basset.quadrature.rule import Rule
from basset.weights.table import Recipe


def whole_steps(window: float, dt: float) -> int:
    """`window` in whole steps; ValueError when it is shorter than one step."""
    if window < dt * (1.0 - 1e-9):
        raise ValueError("window must be at least one step of dt = {} seconds, got {}".format(*_validate.apart(dt, window)))
    return max(round(min(window / dt, 1e18)), 1)


def checked_tail(tail: ExponentialSum, start: float, horizon: float, kernel: AnyKernel) -> ExponentialSum:
    """`tail` if it stands for `kernel` from `start` to `horizon` seconds."""
    if tail.kernel != kernel:
        raise ValueError(f"tail must be a sum for the kernel {kernel!r}, got one for {tail.kernel!r}")
    if tail.near > start * (1.0 + 1e-9):
        raise ValueError("tail must begin at the window's end, {} seconds, or before, got near = {}".format(*_validate.apart(start, tail.near)))
    if tail.far < horizon * (1.0 - 1e-9):
        raise ValueError("tail must reach the horizon, {} seconds, got far = {}".format(*_validate.apart(horizon, tail.far)))
    return tail


@dataclass(frozen=True)
class Windowed(Rule):
    """A rule on the newest `window` seconds; beyond it K is replaced by a sum of exponentials, or by 0.

    The window is rounded to whole steps. Without a tail, samples older than the window are not read and a jump older
    than it (the initial slip) is forgotten: `error_order` is then the rule's own, towards the *windowed* integral, and
    the dropped part is an error that no step size removes. With a tail, polynomials of the rule's degree are integrated
    against the sum: |error| grows by at most rtol·∫K|g| over the tail, and memory and time per step do not grow with the history.

    Parameters
    ----------
    rule : Rule
        A full-history rule, such as Daitche(order=2).
    window : float, seconds
        The memory time, greater than 0; with a tail at least order//2 + 1 steps.
    tail : ExponentialSum or None
        What stands for the kernel beyond the window; None drops it.

    Raises
    ------
    ValueError, TypeError
        If a parameter is of the wrong kind; when used, if the window is too short for the step or the tail is made for
        another kernel or range.

    References
    ----------
    Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513 (T_back); Dorgan & Loth (2007), Int. J.
    Multiphase Flow 33, 833; van Hinsberg et al. (2011), J. Comput. Phys. 230, 1465; thesis eqs. 5-12, 5-13.

    Examples
    --------
    >>> from basset import Daitche
    >>> Windowed(Daitche(order=1), window=1.0).weights(3, 1.0).round(4)
    array([1.3333, 0.6667, 0.    , 0.    ])
    """

    rule: Rule
    window: float
    tail: ExponentialSum | None = None

    name: ClassVar[str] = "windowed"
    references: ClassVar[tuple[str, ...]] = (
        "Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513",
        "Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833",
    )

    def __post_init__(self) -> None:
        if not isinstance(self.rule, Rule) or self.rule.whole != self.rule:
            raise TypeError(f"rule must be a full-history rule such as basset.Daitche(order=2), got {_validate.shown(self.rule)}")
        object.__setattr__(self, "window", _validate.positive("window", self.window, "seconds"))
        if self.tail is not None and not isinstance(self.tail, ExponentialSum):
            raise TypeError(f"tail must be an ExponentialSum or None, got {_validate.shown(self.tail)}")

    @property
    def error_order(self) -> float:
        """That of the rule inside, dimensionless."""
        return self.rule.error_order

    @property
    def inputs(self) -> tuple[str, ...]:
        """Those of the rule inside; rates only with a tail."""
        return self.rule.inputs if self.tail is None else ("rate",)

    @property
    def whole(self) -> Rule:
        """The rule inside."""
        return self.rule

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """That of the rule inside, on the window."""
        inside, steps = self.rule.recipe(dt, horizon, kernel), whole_steps(self.window, dt)
        return replace(inside, window=steps, tail=None if self.tail is None else checked_tail(self.tail, steps * dt, horizon, kernel))
