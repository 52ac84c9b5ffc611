"""Product integration of any degree: Daitche (2013)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from basset import _validate
from basset.kernels import AnyKernel
from basset.quadrature.rule import Rule
from basset.weights.lagrange import MAXIMUM_ORDER
from basset.weights.polynomials import Product
from basset.weights.table import Recipe


@dataclass(frozen=True)
class Daitche(Rule):
    """Product integration of degree p: the rate through p+1 neighbouring samples, integrated exactly.

    Error h^(p+1) for a smooth rate. With slip samples the interpolant of f is differentiated: error h^(p+1/2). A rate
    or slip with a √t start (the response to a jump) limits every rule on a uniform grid: error h^(3/2) at a fixed time
    for f = √t, whatever p; give jumps through `initial_slip` instead. Histories of n < p steps use degree n.

    Panel [k, k+1] (in lags) uses samples from lag k − ⌊p/2⌋ on, shifted inwards at both ends: for p = 1, 2, 3 these are
    Daitche's published coefficients of second, third and fourth error order, without their cancellation.

    Parameters
    ----------
    order : int
        Degree p, 1 to 10.

    Raises
    ------
    ValueError, TypeError
        If the order is not a whole number from 1 to 10.

    References
    ----------
    Daitche (2013), J. Comput. Phys. 254, 93; thesis eqs. 5-9 to 5-11.

    Examples
    --------
    >>> Daitche(order=1).weights(2, 1.0).round(4)
    array([1.3333, 1.1046, 0.3905])
    """

    order: int = 3

    name: ClassVar[str] = "daitche"
    inputs: ClassVar[tuple[str, ...]] = ("rate", "slip")
    references: ClassVar[tuple[str, ...]] = ("Daitche (2013), J. Comput. Phys. 254, 93",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "order", _validate.integer("order", self.order, 1, MAXIMUM_ORDER))

    @property
    def error_order(self) -> float:
        """One more than the degree, p + 1."""
        return self.order + 1.0

    @property
    def at_any_times(self) -> tuple[int, float]:
        """Polynomials of this degree, K itself."""
        return self.order, 0.0

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The whole history."""
        return Recipe(Product(self.order), degree=self.order)
