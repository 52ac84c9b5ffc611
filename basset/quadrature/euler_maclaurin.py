"""The first baseline of the thesis: open midpoints (second Euler–Maclaurin summation)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from basset.kernels import AnyKernel, Floats, Kernel
from basset.quadrature.rule import Rule
from basset.weights.table import Recipe, Stencil


class Midpoints(Stencil):
    """h K((k+1/2)h) (g_k + g_{k+1})/2 on every panel."""

    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """Half the kernel at the midpoints on both sides."""
        values = kernel._values(np.arange(start, stop) + 0.5)
        older = kernel._values(np.arange(max(start, 1), stop) - 0.5)
        values[len(values) - len(older) :] += older
        return 0.5 * values

    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """Half the kernel at the oldest midpoint."""
        return 0.5 * kernel._values(n[:, None] - 0.5)


@dataclass(frozen=True)
class EulerMaclaurin(Rule):
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
    error_order: ClassVar[float] = 0.5
    references: ClassVar[tuple[str, ...]] = ("Press et al. (1992), Numerical Recipes, section 4.4",)

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The whole history."""
        return Recipe(Midpoints())
