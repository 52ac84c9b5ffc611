"""The scheme of van Hinsberg et al. (2011): product trapezoid on a window."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from basset import _validate
from basset.quadrature.base import FullRule, Rule
from basset.quadrature.product import Daitche
from basset.quadrature.windowed import whole_steps


@dataclass(frozen=True)
class Hinsberg(Rule):
    """Product trapezoid, over the whole history or on a window: the weights are those of Daitche(order=1).

    Thesis eqs. 5-7 (van Hinsberg) and 5-11 (Daitche, second error order) are two ways to write the same numbers.

    Parameters
    ----------
    window : float, seconds, or None
        The memory time; None for the whole history.
    tail : False
        What stands for the kernel beyond the window; False drops it.

    Raises
    ------
    ValueError, TypeError
        If the window is not positive; when used, if it is shorter than a step.

    References: van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465; thesis eqs. 5-7, 5-13.

    Examples
    --------
    >>> Hinsberg(tail=False).weights(2, 1.0).round(4)
    array([1.3333, 1.1046, 0.3905])
    """

    window: float | None = None
    tail: bool | None = None

    name: ClassVar[str] = "hinsberg"
    references: ClassVar[tuple[str, ...]] = ("van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465",)

    def __post_init__(self) -> None:
        if self.window is not None:
            object.__setattr__(self, "window", _validate.positive("window", self.window, "seconds"))
            if self.tail is not False:
                raise ValueError(f"tail must be False for a window without a tail, got {_validate.shown(self.tail)}")

    @property
    def error_order(self) -> float:
        """2."""
        return 2.0

    @property
    def inputs(self) -> tuple[str, ...]:
        """Both, as Daitche(order=1)."""
        return self._remembered.inputs

    @property
    def _remembered(self) -> FullRule:
        return Daitche(1)

    def _window_steps(self, dt: float) -> int | None:
        return None if self.window is None else whole_steps(self.window, dt)
