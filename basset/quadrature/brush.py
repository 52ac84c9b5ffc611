"""The second baseline of the thesis: the split of Brush, Ho & Yen (1964), with Simpson's rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from basset.kernels import AnyKernel, Floats, Kernel
from basset.quadrature.rule import Rule
from basset.weights.table import Recipe, Stencil


class Simpson(Stencil):
    """g_n ∫K on the last step, Simpson's rule on all older pairs of panels."""

    reach: ClassVar[int] = 2  # the trapezoid's and Simpson's last

    def short(self, n: int, kernel: Kernel, input: str) -> Floats:
        """The last step alone, or with a trapezoid."""
        first = kernel.moments(0.0, 1.0, 0)[0]
        trapezoid = 0.5 * kernel._values(np.array([1.0, 2.0]))
        return np.array([first, 0.0]) if n == 1 else np.array([first, *trapezoid])

    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """The integral over the last step, then Simpson's 4/3 and 2/3."""
        lag = np.arange(start, stop)
        simpson = np.where(lag % 2 == 0, 4.0, 2.0) / 3.0
        result = np.empty(stop - start)
        result[lag > 0] = (simpson * kernel._values(np.maximum(lag, 1).astype(np.float64)))[lag > 0]
        result[lag == 1] *= 0.5
        result[lag == 0] = kernel.moments(0.0, 1.0, 0)[0]
        return result

    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """The end of Simpson's rule, or of the trapezoid after it."""
        even = (n % 2 == 1)[:, None]  # an even number of panels between lag 1 and lag n
        whole, trapezoid = np.array([1.0 / 3.0, 4.0 / 3.0]), np.array([0.5, 0.5 + 1.0 / 3.0])
        factors = np.where(even, whole, trapezoid)
        return factors * kernel._values(n[:, None] - np.array([0.0, 1.0]))


@dataclass(frozen=True)
class Brush(Rule):
    """Split of Brush, Ho & Yen (1964): Simpson up to t − h, and g_n ∫K (2√h g_n for the Basset kernel) on the last step.

    With an odd number of panels before the last step, the oldest one is a trapezoid. Error h^(1/2): Simpson's rule next
    to the singularity is off by a fixed share of √h.

    References
    ----------
    Brush, Ho & Yen (1964), J. Hydraul. Div. 90, 149; thesis section 5.2.2.

    Examples
    --------
    >>> Brush().weights(3, 1.0).round(4)
    array([2.    , 0.3333, 0.9428, 0.1925])
    """

    name: ClassVar[str] = "brush"
    error_order: ClassVar[float] = 0.5
    references: ClassVar[tuple[str, ...]] = ("Brush, Ho & Yen (1964), J. Hydraul. Div. 90, 149",)

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The whole history."""
        return Recipe(Simpson())
