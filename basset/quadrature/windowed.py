"""A finite memory: a full-history rule on the newest stretch of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from basset import _validate
from basset.quadrature.base import FullRule, Rule


def whole_steps(window: float, dt: float) -> int:
    """`window` in whole steps; ValueError when it is shorter than one step."""
    if window < dt * (1.0 - 1e-9):
        raise ValueError(f"window must be at least one step of dt = {dt:g} seconds, got {window:g}")
    return max(round(window / dt), 1)


@dataclass(frozen=True)
class Windowed(Rule):
    """A rule on the newest `window` seconds; what is older is dropped (K = 0 beyond the window).

    The window is rounded to whole steps. Samples older than it are not read, and a jump older than it (the initial slip)
    is forgotten. `error_order` is the rule's own, towards the *windowed* integral; the dropped part is an error that no
    step size removes.

    Parameters
    ----------
    rule : Rule
        A full-history rule, such as Daitche(order=2).
    window : float, seconds
        The memory time, greater than 0.

    Raises
    ------
    ValueError, TypeError
        If the window is not positive or `rule` is no full-history rule; when used, if the window is shorter than a step.

    References: Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513 (T_back); Dorgan & Loth (2007), Int. J.
    Multiphase Flow 33, 833; thesis eq. 5-12.

    Examples
    --------
    >>> from basset import Daitche
    >>> Windowed(Daitche(order=1), window=1.0).weights(3, 1.0).round(4)
    array([1.3333, 0.6667, 0.    , 0.    ])
    """

    rule: FullRule
    window: float

    name: ClassVar[str] = "windowed"
    references: ClassVar[tuple[str, ...]] = (
        "Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513",
        "Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833",
    )

    def __post_init__(self) -> None:
        if not isinstance(self.rule, FullRule):
            raise TypeError(f"rule must be a full-history rule such as basset.Daitche(order=2), got {_validate.shown(self.rule)}")
        object.__setattr__(self, "window", _validate.positive("window", self.window, "seconds"))

    @property
    def error_order(self) -> float:
        """That of the rule inside."""
        return self.rule.error_order

    @property
    def inputs(self) -> tuple[str, ...]:
        """Those of the rule inside."""
        return self.rule.inputs

    @property
    def _remembered(self) -> FullRule:
        return self.rule

    def _window_steps(self, dt: float) -> int | None:
        return whole_steps(self.window, dt)
