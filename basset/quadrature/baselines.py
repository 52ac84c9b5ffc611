"""The two baselines of the thesis: open midpoint (second Euler–Maclaurin) and the split of Brush et al. with Simpson."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from basset.kernels import Floats, Kernel
from basset.quadrature.base import FullRule


@dataclass(frozen=True)
class EulerMaclaurin(FullRule):
    """Second Euler–Maclaurin summation: midpoints, which never touch the singularity. Error h^(1/2).

    Every panel contributes h K((k+1/2)h) (g_k + g_{k+1})/2.

    References
    ----------
    Press et al. (1992), Numerical Recipes, section 4.4; thesis section 5.2.2.1.

    Examples
    --------
    >>> EulerMaclaurin().weights(1, 4.0).round(4)
    array([1.4142, 1.4142])
    """

    name: ClassVar[str] = "euler_maclaurin"
    references: ClassVar[tuple[str, ...]] = ("Press et al. (1992), Numerical Recipes, section 4.4",)

    @property
    def error_order(self) -> float:
        """1/2, dimensionless."""
        return 0.5

    @property
    def _reach(self) -> int:
        return 1

    def _interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        values = kernel._values(np.arange(start, stop) + 0.5)
        older = kernel._values(np.arange(max(start, 1), stop) - 0.5)
        values[len(values) - len(older) :] += older
        return 0.5 * values

    def _oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        return 0.5 * kernel._values(n[:, None] - 0.5)


@dataclass(frozen=True)
class Brush(FullRule):
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
    references: ClassVar[tuple[str, ...]] = ("Brush, Ho & Yen (1964), J. Hydraul. Div. 90, 149",)

    @property
    def error_order(self) -> float:
        """1/2, dimensionless."""
        return 0.5

    @property
    def _reach(self) -> int:
        return 2

    @property
    def _first(self) -> int:
        return 3

    def _short(self, n: int, kernel: Kernel, input: str) -> Floats:
        first = kernel.moments(0.0, 1.0, 0)[0]
        trapezoid = 0.5 * kernel._values(np.array([1.0, 2.0]))
        return np.array([first, 0.0]) if n == 1 else np.array([first, *trapezoid])

    def _interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        lag = np.arange(start, stop)
        simpson = np.where(lag % 2 == 0, 4.0, 2.0) / 3.0
        result = np.empty(stop - start)
        result[lag > 0] = (simpson * kernel._values(np.maximum(lag, 1).astype(np.float64)))[lag > 0]
        result[lag == 1] *= 0.5
        result[lag == 0] = kernel.moments(0.0, 1.0, 0)[0]
        return result

    def _oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        even = (n % 2 == 1)[:, None]  # an even number of panels between lag 1 and lag n
        whole, trapezoid = np.array([1.0 / 3.0, 4.0 / 3.0]), np.array([0.5, 0.5 + 1.0 / 3.0])
        factors = np.where(even, whole, trapezoid)
        return factors * kernel._values(n[:, None] - np.array([0.0, 1.0]))
