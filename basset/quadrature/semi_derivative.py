"""The history as a semi-derivative: the Grünwald–Letnikov series of Tatom (1988) and Bombardelli et al. (2008)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from basset.kernels import AnyKernel, BassetKernel, Floats, Kernel
from basset.quadrature.rule import Rule
from basset.weights.table import Recipe, Stencil

NEAR = 128


@lru_cache(maxsize=1)
def near_ratios() -> Floats:
    """Γ(j+1/2)/Γ(j+1) = √π (2j choose j)/4^j for j < NEAR, from exact integers."""
    return np.array([math.sqrt(math.pi) * (math.comb(2 * j, j) / 4**j) for j in range(NEAR)])


def gamma_ratios(start: int, stop: int) -> Floats:
    """Γ(j+1/2)/Γ(j+1) for j = start … stop−1, to rounding: exact integers, then the series in 1/(j+1/4)."""
    far = np.arange(max(start, NEAR), max(stop, NEAR)) + 0.25
    square = 1.0 / far**2
    series = (1.0 + square * (-1.0 / 64.0 + square * (21.0 / 8192.0 - square * (671.0 / 524288.0)))) / np.sqrt(far)
    return np.concatenate([near_ratios()[start:stop], series])


class GrunwaldLetnikov(Stencil):
    """The binomial coefficients of a derivative of order ∓1/2, over √π."""

    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """Γ(j+1/2)/Γ(j+1), over 1 − 2j on slips."""
        ratios = gamma_ratios(start, stop)
        if input == "slip":
            ratios /= 1.0 - 2.0 * np.arange(start, stop)
        return ratios

    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """None: the series ends one sample before."""
        return np.zeros((len(n), 1))


@dataclass(frozen=True)
class SemiDerivative(Rule):
    """The history as a fractional derivative, by the Grünwald–Letnikov series: first order, standard kernel only.

    On rates it is a semi-integral of g (q = −1/2 in thesis eqs. 5-5 and 5-6), on slips the semi-derivative of f
    (q = +1/2). As published the series ends one sample before the oldest.

    References
    ----------
    Tatom (1988), Appl. Sci. Res. 45, 283; Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513;
    Oldham & Spanier (1974), The Fractional Calculus.

    Examples
    --------
    >>> SemiDerivative().weights(2, 1.0).round(4)
    array([1.7725, 0.8862, 0.    ])
    """

    name: ClassVar[str] = "semi_derivative"
    error_order: ClassVar[float] = 1.0
    inputs: ClassVar[tuple[str, ...]] = ("rate", "slip")
    references: ClassVar[tuple[str, ...]] = (
        "Tatom (1988), Appl. Sci. Res. 45, 283",
        "Bombardelli, González & Niño (2008), J. Hydraul. Eng. 134, 1513",
    )

    def recipe(self, dt: float, horizon: float, kernel: AnyKernel) -> Recipe:
        """The whole history, of the Basset kernel only."""
        if not isinstance(kernel, BassetKernel):
            raise ValueError(
                f"kernel must be BassetKernel() for SemiDerivative, got {type(kernel).__name__}: "
                "a derivative of order 1/2 is an integral against s^(-1/2) and no other kernel"
            )
        return Recipe(GrunwaldLetnikov())
