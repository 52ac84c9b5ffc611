"""Product integration of any degree, without cancellation: Daitche (2013) and, at degree one, van Hinsberg et al. (2011).

On each panel the rate is replaced by the polynomial of degree p through p+1 neighbouring samples and integrated against
the kernel exactly. The published closed forms are differences of powers (j±k)^(m+1/2) and lose all digits as j grows;
here nothing is subtracted:

* near the newest sample, each panel is integrated by Gauss–Legendre against the Lagrange basis (on the singular panel
  with the kernel's own rule);
* far from it, the kernel is a polynomial over the few panels that a weight spans, so a weight is a short filter over
  kernel values at whole lags: exact to rounding, one kernel value per weight.

Weights on slip samples integrate f' of the same interpolant (thesis 5-8); far out they are the same filters applied to dK/ds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from basset.kernels import Floats, Kernel, gauss_legendre
from basset.weights.lagrange import GAUSS, first_panels, lagrange, panel_basis, panel_integrals, row_by_panels
from basset.weights.table import Stencil, table

FAR = 512  # beyond this lag a weight is a filter over kernel values: with TAPS values the error is below 1e-16
TAPS = 9
CHUNK = 1 << 16


def filtered(values: Floats, coefficients: Floats) -> Floats:
    """Σ_q coefficients[q]·values[k + q] for every k with all values there; in blocks that NumPy convolves fast."""
    block, count = 11, len(values) - len(coefficients) + 1
    result = np.zeros(count)
    for low in range(0, len(coefficients), block):
        part = coefficients[low : low + block]
        result += np.convolve(values[low : low + count + len(part) - 1], part[::-1], mode="valid")
    return result


@lru_cache(maxsize=32)
def interior_filter(degree: int) -> Floats:
    """Filter c with w[j] = Σ_q c[q] K(j + q − TAPS//2).

    The kernel's polynomial through whole lags, integrated against the piecewise basis function of one sample.
    """
    x, w = gauss_legendre(GAUSS)
    centre = degree // 2
    taps = np.arange(TAPS) - float(TAPS // 2)
    basis = panel_basis(degree)[0][centre]
    result = np.zeros(TAPS)
    for local in range(degree + 1):  # the sample's place in the stencil of panel [centre − local, centre − local + 1]
        result += (w * basis[:, local]) @ lagrange(taps, centre - local + x)[0]
    return result


@lru_cache(maxsize=32)
def oldest_basis(degree: int) -> tuple[Floats, Floats]:
    """Lags relative to n of the Gauss nodes of the panels that reach the degree+1 oldest samples, and the weighted basis.

    Returns (lags (panels·GAUSS,), basis (panels·GAUSS, degree+1)), samples oldest first. Valid from n = 2·degree + 1 on,
    where no such panel is shifted at its new end too.
    """
    x, w = gauss_legendre(GAUSS)
    centre, basis = degree // 2, panel_basis(degree)[0]
    first = centre - 2 * degree
    lags, values = [], []
    for panel in range(first, 0):  # lag of the panel relative to n
        start = min(panel - centre, -degree)
        block = np.zeros((GAUSS, degree + 1))
        for local in range(degree + 1):
            sample = -(start + local)  # 0 is the oldest
            if sample <= degree:
                block[:, sample] += w * basis[panel - start, :, local]
        lags.append(panel + x)
        values.append(block)
    return np.concatenate(lags), np.concatenate(values)


@lru_cache(maxsize=32)
def oldest_filter(degree: int) -> tuple[Floats, Floats]:
    """The oldest samples' weights as filters over kernel values at whole lags: (taps relative to n, coefficients).

    Each panel has its own TAPS values around it: one set for all would extrapolate at high degree.
    """
    lags, basis = oldest_basis(degree)
    first, panels = int(np.floor(lags[0])), len(lags) // GAUSS
    half = TAPS // 2
    taps = np.arange(first - half, first + panels + half, dtype=np.float64)
    coefficients = np.zeros((len(taps), degree + 1))
    for panel in range(panels):
        part = slice(panel * GAUSS, (panel + 1) * GAUSS)
        local = taps[panel : panel + TAPS]
        coefficients[panel : panel + TAPS] += lagrange(local, lags[part])[0].T @ basis[part]
    return taps, coefficients


@dataclass(frozen=True)
class Product(Stencil):
    """Product integration of one degree: the rate through degree + 1 neighbouring samples, integrated exactly."""

    degree: int

    @property
    def reach(self) -> int:
        """Degree + 1."""
        return self.degree + 1

    def short(self, n: int, kernel: Kernel, input: str) -> Floats:
        """Panel by panel."""
        return row_by_panels(n, self.degree, kernel, input)

    def interior(self, start: int, stop: int, kernel: Kernel, input: str) -> Floats:
        """Panel integrals near the newest sample, a filter over kernel values beyond."""
        result = np.empty(stop - start)
        if start < FAR:
            near = self._near(kernel, input)[start : min(stop, FAR)]
            result[: len(near)] = near
        sampled = kernel._values if input == "rate" else kernel._derivatives
        coefficients = interior_filter(self.degree)
        half = TAPS // 2
        for low in range(max(start, FAR), stop, CHUNK):
            high = min(low + CHUNK, stop)
            lags = np.arange(low - half, high + half, dtype=np.float64)
            result[low - start : high - start] = filtered(sampled(lags), coefficients)
        return result

    def _near(self, kernel: Kernel, input: str) -> Floats:
        """Interior weights 0 … FAR−1 from panel integrals."""
        degree, centre = self.degree, self.degree // 2
        panels = FAR + centre
        x, w = gauss_legendre(GAUSS)
        basis = panel_basis(degree)[0][centre]
        first = first_panels(degree, kernel, input)
        sampled = kernel._values if input == "rate" else kernel._derivatives
        regular = np.empty((panels - centre, degree + 1))  # from panel `centre` on, no stencil is shifted
        near = len(first)
        regular[: near - centre] = first[centre:, centre]
        regular[near - centre :] = (sampled(np.arange(float(near), panels)[:, None] + x) * w) @ basis
        result = np.zeros(panels + degree + 1)
        for k in range(centre):  # stencils shifted inwards at the newest sample
            result[: degree + 1] += first[k, k]
        for local in range(degree + 1):
            result[local : local + panels - centre] += regular[:, local]
        if input == "slip":
            result[1] += kernel._values(np.array([1.0]))[0]
        return result[:FAR]

    def oldest(self, n: NDArray[np.int64], kernel: Kernel, input: str) -> Floats:
        """From the panels that reach those samples."""
        lags, basis = oldest_basis(self.degree)
        sampled = kernel._values if input == "rate" else kernel._derivatives
        return np.asarray(sampled(n[:, None] + lags) @ basis)

    @property
    def far(self) -> float:
        """As for the interior."""
        return FAR

    def oldest_sum(self, first: int, last: int, samples: Floats, kernel: Kernel, input: str) -> Floats:
        """By a filter over kernel values."""
        taps, coefficients = oldest_filter(self.degree)
        sampled = kernel._values if input == "rate" else kernel._derivatives
        values = sampled(np.arange(first + taps[0], last + taps[-1] + 1))
        return np.stack([filtered(values, column) for column in (coefficients @ samples).T], axis=1)

    def inside(self, window: int, lags: int, kernel: Kernel) -> Floats:
        """Of the panels inside the window, none shifted at its old end."""
        degree, centre = self.degree, self.degree // 2
        local = np.zeros(max(lags, degree) + 1)
        first = 0
        if window > 4 * degree + 4:  # samples whose panels all lie inside have the whole-history weights
            whole = window - centre
            local[:whole] = table(self, kernel, "rate").interior(whole)[::-1]
            first = whole - degree
        integrals = panel_integrals(first, window, degree, kernel)
        edge = np.zeros_like(local)
        for k in range(first, window):
            start = max(k - centre, 0)
            edge[start : start + degree + 1] += integrals[k - first, k - start]
        if first:
            local[whole:] = edge[whole:]
            return local
        return edge
