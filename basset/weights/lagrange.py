"""The polynomials through neighbouring samples, and their integrals against the kernel on each panel: Daitche (2013), J. Comput. Phys. 254, 93."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from basset.kernels import Floats, Kernel, gauss_legendre

GAUSS = 16
MAXIMUM_ORDER = 10


def lagrange(nodes: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Lagrange basis on `nodes` and its derivative at `x`: two arrays (len(x), len(nodes)), by products only."""
    count = len(nodes)
    values, slopes = np.ones((len(x), count)), np.zeros((len(x), count))
    for i in range(count):
        others = [m for m in range(count) if m != i]
        for m in others:
            factor = (x - nodes[m]) / (nodes[i] - nodes[m])
            slopes[:, i] = slopes[:, i] * factor + values[:, i] / (nodes[i] - nodes[m])
            values[:, i] *= factor
    return values, slopes


@lru_cache(maxsize=64)
def panel_basis(degree: int) -> tuple[Floats, Floats]:
    """Basis and slopes at the Gauss nodes of a panel that lies `o` panels inside its stencil: (o, Gauss node, sample)."""
    x, _ = gauss_legendre(GAUSS)
    nodes = np.arange(degree + 1.0)
    pairs = [lagrange(nodes, o + x) for o in range(degree)]
    return np.stack([values for values, _ in pairs]), np.stack([slopes for _, slopes in pairs])


def panel_integrals(first: int, last: int, degree: int, kernel: Kernel, input: str = "rate") -> Floats:
    """∫ K L_i over panels [k, k+1], first ≤ k < last, for every position o of a panel in its stencil: (k, o, i), unit step.

    For slips −∫ K dL_i/ds: lag runs against time. Panel 0 is singular and always first in its stencil; its other
    positions are left at zero.
    """
    x, w = gauss_legendre(GAUSS)
    basis = panel_basis(degree)[0 if input == "rate" else 1]
    sign = 1.0 if input == "rate" else -1.0
    result = np.zeros((last - first, degree, degree + 1))
    regular = np.arange(max(first, 1), last)
    result[regular - first] = sign * np.einsum("kq,oqi->koi", kernel._values(regular[:, None] + x) * w, basis, optimize=True)
    if first == 0:
        x, w = kernel.rule(0.0, 1.0)
        result[0, 0] = sign * (w @ lagrange(np.arange(degree + 1.0), x)[0 if input == "rate" else 1])
    return result


@lru_cache(maxsize=64)
def first_panels(degree: int, kernel: Kernel, input: str) -> Floats:
    """Integrals over the first 2·degree + 1 panels, (k, o, i), read-only; for slips by parts away from the singular panel.

    ∫ dK/ds L_i then stands for −∫ K dL_i/ds: what is left over is K(1) at the end of the singular panel.
    """
    panels = 2 * degree + 1
    integrals = panel_integrals(0, panels if input == "rate" else 1, degree, kernel, input)
    if input == "slip":
        x, w = gauss_legendre(GAUSS)
        slopes = kernel._derivatives(np.arange(1.0, panels)[:, None] + x) * w
        integrals = np.concatenate([integrals, np.einsum("kq,oqi->koi", slopes, panel_basis(degree)[0], optimize=True)])
    integrals.flags.writeable = False
    return integrals


def row_by_panels(n: int, degree: int, kernel: Kernel, input: str) -> Floats:
    """The whole row (n+1,), newest first, 1 ≤ n ≤ 2·degree, panel by panel; of the degree the samples allow."""
    degree = min(degree, n)
    integrals = first_panels(degree, kernel, input)
    row = np.zeros(n + 1)
    for k in range(n):
        start = min(max(k - degree // 2, 0), n - degree)
        row[start : start + degree + 1] += integrals[k, k - start]
    if input == "slip":  # the end of the singular panel; for n = 1 the jump from rest to the first sample
        row[1] += kernel._values(np.array([1.0]))[0]
    return row
