"""Compiled: through which samples the polynomial of a panel goes, and its coefficients; see `basset.weights.uneven`."""

from __future__ import annotations

import numpy as np

from basset._compile import compiled, shared

DEPTH = 8  # older samples that are looked at
LIMIT = 10.0  # of the weight of a sample in a polynomial


@shared
def reach(x, other):
    """Bound of |θ(θ − 1)(θ − other)/(x(x − 1)(x − other))| on [0, 1], `other` being infinite for none."""
    single = 0.25 / abs(x * (x - 1.0))
    return single if np.isinf(other) else single * max(abs(other), abs(1.0 - other)) / abs(x - other)


@shared
def choose(t, j, begin, newest, order, places, picked):
    """Samples through which the polynomial of panel [j − 1, j] goes beside its ends: their indices and θ, and how many.

    `begin` is the first sample of the segment, `newest` the last that is known.
    """
    count, newer, older = 0, j + 1, j - 2
    last = min(newest, j + 2 if order == 3 and j - 1 == begin else j + 1)
    first = max(begin, j - 1 - DEPTH)
    step, other = t[j] - t[j - 1], np.inf
    while count < order - 1:
        if newer <= last:
            k, newer = newer, newer + 1
        elif older >= first:
            k, older = older, older - 1
        else:
            break
        x = (t[j] - t[k]) / step
        if reach(x, other) <= LIMIT and (count == 0 or reach(other, x) <= LIMIT):
            places[count], picked[count], other = x, k, x
            count += 1
    return count


@shared
def through(t, g, c, j, count, places, picked, slip, q):
    """Coefficients q[0 … 3] of component c on panel j, in θ: of the interpolant, or of its rate where samples are slips."""
    d1 = g[j - 1, c] - g[j, c]
    q[0], q[1], q[2], q[3] = g[j, c], d1, 0.0, 0.0
    if count > 0:
        x = places[0]
        d2 = ((g[picked[0], c] - g[j, c]) / x - d1) / (x - 1.0)
        q[1] -= d2
        q[2] = d2
        if count > 1:
            y = places[1]
            d3 = (((g[picked[1], c] - g[j, c]) / y - d1) / (y - 1.0) - d2) / (y - x)
            q[1] += d3 * x
            q[2] -= d3 * (1.0 + x)
            q[3] = d3
    if slip:
        step = t[j] - t[j - 1]
        q[0], q[1], q[2], q[3] = -q[1] / step, -2.0 * q[2] / step, -3.0 * q[3] / step, 0.0


@compiled(allocates=False)
def polynomials(t, g, order, slip, final, newest, early, places, picked):
    """Coefficients (node, component, 4) of the panel that ends there: final, as the newest one, and (first ones of a segment) before the last of theirs."""
    begin, end = 0, 0
    for j in range(1, len(t)):
        if t[j] == t[j - 1]:
            begin = j
            continue
        if end < j:
            end = j
            while end + 1 < len(t) and t[end + 1] > t[end]:
                end += 1
        count = choose(t, j, begin, j, order, places, picked)
        for c in range(g.shape[1]):
            through(t, g, c, j, count, places, picked, slip, newest[j, c])
        count = choose(t, j, begin, min(end, j + 1), order, places, picked)
        for c in range(g.shape[1]):
            through(t, g, c, j, count, places, picked, slip, early[j, c])
        count = choose(t, j, begin, end, order, places, picked)
        for c in range(g.shape[1]):
            through(t, g, c, j, count, places, picked, slip, final[j, c])
