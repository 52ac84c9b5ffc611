"""Product integration on times that are not uniform: piecewise polynomials through neighbouring samples, integrated exactly.

A panel [t_{j−1}, t_j] has the polynomial through its two ends and, for degrees 2 and 3, the samples that the uniform rule takes: the next newer one,
then older ones; at the beginning of a segment newer ones, at the newest panel older ones. On uniform times the weights are those of `Product`.

A sample that lies so close to the panel, or to another one, that a sample would enter the polynomial with a weight above 10 is skipped for the next
older one, among 8; where none is left the degree is lower. Errors of samples are then not magnified, whatever the steps. Two samples at one instant
are a jump: one segment ends, another begins.

Polynomials are in θ = (t_j − τ)/(t_j − t_{j−1}), from the panel's newer end on, so that moments need the lag of that end and θ only: nothing cancels far out.
Product integration: Young (1954), Proc. R. Soc. A 224, 552; its polynomials on uniform times: Daitche (2013); at nonuniform times: this library.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from basset.kernels import Floats, Kernel, gauss_legendre
from basset.weights._panels import polynomials
from basset.weights.lagrange import GAUSS

HIGHEST = 3  # degree
CHUNK = 1 << 14


class Pieces(NamedTuple):
    """The polynomials of a path, coefficients (node, component, 4) for the panel that ends at each node, and its jumps."""

    t: Floats
    final: Floats
    newest: Floats  # where no later sample is known yet
    early: Floats  # where one is: the first panel of a segment is not final then
    begins: NDArray[np.bool_]  # whether a segment begins at the node
    leaps: Floats


def pieces(t: Floats, g: Floats, order: int, slip: bool, leaps: Floats) -> Pieces:
    """Polynomials of degree `order` (1 to 3) through samples (nodes, components), rates or slips, at rising times (s); f jumps by `leaps` at the nodes."""
    final, newest, early = (np.zeros((*g.shape, 4)) for _ in range(3))
    polynomials(t, g, order, slip, final, newest, early, np.empty(2), np.empty(2, dtype=np.int64))
    return Pieces(t, final, newest, early, np.diff(t, prepend=t[0]) == 0.0, leaps)


def panel_moments(kernel: Kernel, near: Floats, sizes: Floats) -> Floats:
    """∫ K(s) θ^m ds, θ = (s − near)/size, m = 0 … 3, over panels [near, near + size]: (panels, 4); 0 where a size is 0.

    Gauss–Legendre where K is smooth over the panel, as for uniform steps; the kernel's own rule where the panel is longer than its lag.

    >>> import basset
    >>> panel_moments(basset.BassetKernel(), np.array([0.0, 3.0]), np.array([1.0, 1.0]))[:, 0].round(12)  # 2, and 2·√4 − 2·√3
    array([2.        , 0.53589838])
    """
    result = np.zeros((len(near), 4))
    for points, part in ((GAUSS, (sizes <= near) & (8.0 * sizes > near)), (GAUSS // 2, 8.0 * sizes <= near)):
        x, w = gauss_legendre(points)
        powers = w[:, None] * x[:, None] ** np.arange(4)
        found = np.flatnonzero(part & (sizes > 0.0))
        for low in range(0, len(found), CHUNK):
            k = found[low : low + CHUNK]
            result[k] = sizes[k, None] * (kernel._values(near[k, None] + sizes[k, None] * x) @ powers)
    for panel in np.flatnonzero(sizes > near):
        x, w = kernel.rule(float(near[panel]), float(near[panel] + sizes[panel]))
        result[panel] = w @ x[:, None] ** np.arange(4)
    return result


def at_node(made: Pieces, n: int, kernel: Kernel) -> Floats:
    """H at node n by its definition: (components,)."""
    t = made.t[: n + 1]
    result = np.zeros(made.final.shape[1])
    if n:
        moments = panel_moments(kernel, t[n] - t[1:], np.diff(t))
        result += np.einsum("jcm,jm->c", made.final[1:n], moments[:-1]) + made.newest[n] @ moments[-1]
    if n > 1 and made.begins[n - 2]:
        result += (made.early[n - 1] - made.final[n - 1]) @ moments[-2]
    jumps = np.flatnonzero(made.leaps[:n].any(axis=1) & (t[:n] < t[n]))
    return np.asarray(result + kernel._values(t[n] - t[jumps]) @ made.leaps[jumps])
