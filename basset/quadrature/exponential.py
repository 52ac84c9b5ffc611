"""Exact newest panels and a fitted sum of exponentials for all older ones: the scheme with the least memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from basset import _validate
from basset.kernels import AnyKernel, BassetKernel, Kernel
from basset.quadrature.daitche import Daitche
from basset.quadrature.rule import Rule, accept
from basset.streaming.uneven import UnevenPlan
from basset.weights.lagrange import MAXIMUM_ORDER
from basset.weights.polynomials import Product
from basset.weights.table import Recipe
from basset.weights.uneven import HIGHEST


@dataclass(frozen=True)
class Exponential(Rule):
    """Product integration with the kernel itself on the newest order//2 + 1 panels and a fitted sum beyond.

    The sum is fitted when a plan is made, to the step and the horizon: constant memory, constant time per step, and an error
    that is promised: |H − Daitche(order)| ≤ rtol·∫ K |g| over the older panels, g being the piecewise polynomial.

    Parameters
    ----------
    order : int
        Degree p, 1 to 10.
    rtol : float, dimensionless
        Promised relative error of the kernel, 1e-14 to below 1.

    Raises
    ------
    ValueError, TypeError
        If a parameter is out of range; when used, if no sum keeps the promise up to the horizon.

    References
    ----------
    van Hinsberg et al. (2011), J. Comput. Phys. 230, 1465 (recursion); Daitche (2013), J. Comput. Phys. 254,
    93 (polynomials); Braess & Hackbusch (2005), IMA J. Numer. Anal. 25, 685 (sums).

    Examples
    --------
    >>> import numpy as np
    >>> from basset import Daitche, integrate
    >>> g = np.cos(np.linspace(0.0, 9.0, 1001))
    >>> abs(integrate(g, 0.009, Exponential(3, 1e-9)) / integrate(g, 0.009, Daitche(3)) - 1.0) < 1e-8
    np.True_
    """

    order: int = 3
    rtol: float = 1e-6

    name: ClassVar[str] = "exponential"
    references: ClassVar[tuple[str, ...]] = (
        "van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465",
        "Daitche (2013), J. Comput. Phys. 254, 93",
        "Braess & Hackbusch (2005), IMA J. Numer. Anal. 25, 685",
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", _validate.integer("order", self.order, 1, MAXIMUM_ORDER))
        object.__setattr__(self, "rtol", _validate.tolerance("rtol", self.rtol))

    @property
    def error_order(self) -> float:
        """One more than the degree, p + 1, down to the promised error."""
        return self.order + 1.0

    @property
    def whole(self) -> Rule:
        """Daitche's rule of the same order."""
        return Daitche(self.order)

    @property
    def at_any_times(self) -> tuple[int, float]:
        """Polynomials of this degree, a sum for K."""
        return self.order, self.rtol

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The newest panels, and a sum fitted to step and horizon."""
        return Recipe(Product(self.order), degree=self.order).with_tail(self.order // 2 + 1, self.rtol, dt, horizon, kernel)

    def uneven_plan(self, horizon: float, shortest: float | None = None, kernel: Kernel = BassetKernel()) -> UnevenPlan:
        """Make the rule ready to stream samples at nonuniform times, with the same error bound: all set-up happens here. Order 1, 2 or 3.

        Parameters
        ----------
        horizon : float, seconds
            The longest time that will be remembered, counted from the first sample.
        shortest : float, seconds, or None
            The shortest step between two samples: the longer, the fewer terms. None: 1e-11 of the horizon.
        kernel : Kernel
            The memory kernel K.

        Returns
        -------
        basset.streaming.uneven.UnevenPlan

        Raises
        ------
        ValueError, TypeError
            If a parameter is out of range, or no sum keeps the promise.

        Examples
        --------
        >>> import basset
        >>> plan = basset.Exponential(order=1, rtol=1e-9).uneven_plan(horizon=4.0, shortest=1e-3)
        >>> float(plan.run(plan.start(), [1.0, 1.0, 1.0], [0.0, 0.5, 4.0])[-1].round(6))  # f' = 1: H = 2√t
        4.0
        """
        accept(self, kernel, "rate")
        horizon = _validate.positive("horizon", horizon, "seconds")
        shortest = 1e-11 * horizon if shortest is None else _validate.positive("shortest", shortest, "seconds")
        if self.order > HIGHEST:
            raise ValueError(f"order must be from 1 to {HIGHEST} at nonuniform times, got {self.order}")
        return UnevenPlan(self.order, self.rtol, shortest, horizon, kernel)
