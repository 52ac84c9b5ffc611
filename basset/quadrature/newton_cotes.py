"""The third baseline of the thesis: an open Newton–Cotes formula, which leaves out both end points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from basset.kernels import AnyKernel, Floats, Kernel
from basset.quadrature.rule import Rule
from basset.weights.table import Recipe, Stencil


class OpenTrapezoid(Stencil):
    """The trapezoid on all panels but the first and the last, whose samples at the ends are extrapolated: 3/2 at both inner neighbours."""

    reach: ClassVar[int] = 2  # the end point and its neighbour
    first: ClassVar[int] = 4  # both neighbours apart

    def short(self, n: int, kernel: Kernel, input: str) -> Floats:
        """A panel without an inner point is a midpoint; two panels have one point for both ends."""
        if n == 1:
            return np.full(2, 0.5 * float(kernel._values(np.array([0.5]))[0]))
        inner = kernel._values(np.arange(1.0, n)) * (2.0 if n == 2 else 1.5)
        return np.concatenate([[0.0], inner, [0.0]])

    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """The kernel at the nodes, nothing at the newest, half as much again beside it."""
        lag = np.arange(start, stop)
        weights: Floats = np.where(lag > 0, kernel._values(np.maximum(lag, 1).astype(np.float64)), 0.0)
        weights[lag == 1] *= 1.5
        return weights

    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """Nothing at the oldest node, half as much again beside it."""
        return np.array([0.0, 1.5]) * kernel._values(n[:, None] - np.array([0.0, 1.0]))


@dataclass(frozen=True)
class NewtonCotes(Rule):
    """Open Newton–Cotes formula of second order, h [3/2 F_1 + F_2 + … + F_{n−2} + 3/2 F_{n−1}] for F = K g. Error h^(1/2).

    The error tends to (ζ(1/2) + 1/2) √h g(t) = −0.960 √h g(t), 1.59 times that of `EulerMaclaurin`. The newest sample has no weight: at
    fixed steps the history is explicit, and c √dt must stay below 0.905.

    References
    ----------
    Press et al. (1992), Numerical Recipes, (4.1.15); thesis section 5.2.2.1.

    Examples
    --------
    >>> NewtonCotes().weights(4, 1.0).round(4)
    array([0.    , 1.5   , 0.7071, 0.866 , 0.    ])
    """

    name: ClassVar[str] = "newton_cotes"
    error_order: ClassVar[float] = 0.5
    references: ClassVar[tuple[str, ...]] = ("Press et al. (1992), Numerical Recipes, (4.1.15)",)

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The whole history."""
        return Recipe(OpenTrapezoid())
