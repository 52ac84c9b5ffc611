"""The scheme of van Hinsberg et al. (2011): product trapezoid on a window, exponentials beyond it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from basset import _validate
from basset.exponentials import ExponentialSum
from basset.kernels import AnyKernel, BassetKernel
from basset.quadrature.daitche import Daitche
from basset.quadrature.rule import Rule
from basset.quadrature.windowed import checked_tail, whole_steps
from basset.weights.polynomials import Product
from basset.weights.table import Recipe


@dataclass(frozen=True)
class Hinsberg(Rule):
    """Product trapezoid, over the whole history or on a window with an exponential tail; its weights are Daitche(order=1)'s.

    Thesis eqs. 5-7 (van Hinsberg) and 5-11 (Daitche, second error order) are two ways to write the same numbers. The
    published tail is good to two or three digits whatever the step; a fitted one keeps its promise.

    Parameters
    ----------
    window : float, seconds, or None
        The memory time; None for the whole history.
    tail : ExponentialSum, False or None
        What stands for the kernel beyond the window: a sum, nothing (False), or the published ten terms (None; Basset
        kernel only).

    Raises
    ------
    ValueError, TypeError
        If a parameter is of the wrong kind; when used, if the window is shorter than a step or the tail is made for
        another kernel or range.

    References
    ----------
    van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465; thesis eqs. 5-7, 5-13 to 5-17.

    Examples
    --------
    >>> Hinsberg(tail=False).weights(2, 1.0).round(4)
    array([1.3333, 1.1046, 0.3905])
    """

    window: float | None = None
    tail: ExponentialSum | bool | None = None

    name: ClassVar[str] = "hinsberg"
    error_order: ClassVar[float] = 2.0
    references: ClassVar[tuple[str, ...]] = ("van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465",)

    def __post_init__(self) -> None:
        if self.window is not None:
            object.__setattr__(self, "window", _validate.positive("window", self.window, "seconds"))
        if self.tail is not None and self.tail is not False and not isinstance(self.tail, ExponentialSum):
            raise TypeError(f"tail must be an ExponentialSum, False or None, got {_validate.shown(self.tail)}")
        if self.window is None and isinstance(self.tail, ExponentialSum):
            raise ValueError(f"window must be given where there is a tail, got window=None with {self.tail!r}")

    @property
    def inputs(self) -> tuple[str, ...]:
        """Both, as Daitche(order=1); rates only with a tail."""
        return ("rate", "slip") if self.window is None or self.tail is False else ("rate",)

    @property
    def whole(self) -> Rule:
        """The product trapezoid."""
        return Daitche(1)

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The product trapezoid on the window, with the published sum or a given one beyond."""
        trapezoid = Recipe(Product(1), degree=1)
        if self.window is None:
            return trapezoid
        steps, tail = whole_steps(self.window, dt), None
        if isinstance(self.tail, ExponentialSum):
            tail = checked_tail(self.tail, steps * dt, horizon, kernel)
        elif self.tail is None:
            if not isinstance(kernel, BassetKernel):
                raise ValueError(f"kernel must be BassetKernel() for the published tail, got {kernel!r}: pass a fitted sum as tail")
            tail = ExponentialSum.van_hinsberg(steps * dt)
        return replace(trapezoid, window=steps, tail=tail)
