"""The compiled loop of `basset.streaming.uneven`: one sample at a time, of all components."""

from __future__ import annotations

import math

import numpy as np

from basset._compile import compiled, shared
from basset.weights._panels import choose, through

SERIES = 0.5  # decay over a panel below which both functions of it are taken from their series


@shared
def series(z):
    """e^(−z) and ∫_0^1 e^(−zs) s³ ds for 0 ≤ z < 1/2, to rounding."""
    rest = 1 / 479001600 - z * (1 / 6227020800 - z * (1 / 87178291200 - z * (1 / 1307674368000 - z / 20922789888000)))
    rest = 1 / 5040 - z * (1 / 40320 - z * (1 / 362880 - z * (1 / 3628800 - z * (1 / 39916800 - z * rest))))
    kept = 1.0 - z * (1.0 - z * (1 / 2 - z * (1 / 6 - z * (1 / 24 - z * (1 / 120 - z * (1 / 720 - z * rest))))))
    rest = 1 / 7664025600 - z * (1 / 105859353600 - z * (1 / 1569209241600 - z / 24845812992000))
    rest = 1 / 55440 - z * (1 / 483840 - z * (1 / 4717440 - z * (1 / 50803200 - z * (1 / 598752000 - z * rest))))
    cubic = 1 / 4 - z * (1 / 5 - z * (1 / 12 - z * (1 / 42 - z * (1 / 192 - z * (1 / 1080 - z * (1 / 7200 - z * rest))))))
    return kept, cubic


@compiled(reassociate=True, allocates=False)
def decays(weights, rates, step, own, total):
    """Of each term over a step: weight × moments ∫ e^(−λs) (s/step)^m ds, m = 0 … 3, e^(−z) and 1 − e^(−z) into `own`, z = λ·step; sums into `total`.

    The cubic moment is a series, or a closed form where z is large; lower ones follow from it by sums of positive numbers.
    """
    terms = np.uintp(len(rates))
    slow = np.uintp(0)
    while slow < terms and rates[slow] * step < SERIES:
        slow += np.uintp(1)
    for i in range(slow):
        own[4, i], own[3, i] = series(rates[i] * step)
    for i in range(slow, terms):
        z = rates[i] * step
        kept = math.exp(-z)
        if z < 2.0:  # e^(−z) Σ z^k/(4·5 … (4 + k)), all terms positive
            term, cubic = 0.25, 0.25
            for k in range(5, 26):
                term *= z / k
                cubic += term
            cubic *= kept
        else:  # z³ may be beyond all numbers where nothing is kept
            cubic = (6.0 - (kept * (6.0 + z * (6.0 + z * (3.0 + z))) if kept > 0.0 else 0.0)) / (z * z * z * z)
        own[3, i], own[4, i] = cubic, kept
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for i in range(terms):
        z, kept, third = rates[i] * step, own[4, i], own[3, i]
        second = (z * third + kept) / 3.0
        first = (z * second + kept) / 2.0
        zeroth = z * first + kept
        weight = weights[i] * step
        own[5, i] = z * zeroth
        own[0, i], own[1, i], own[2, i], own[3, i] = weight * zeroth, weight * first, weight * second, weight * third
        a += weight * zeroth
        b += weight * first
        c += weight * second
        d += weight * third
    total[0], total[1], total[2], total[3] = a, b, c, d


@compiled(reassociate=True, allocates=False)
def left(terms, kept):
    """What the terms hold after a step."""
    total = 0.0
    for i in range(len(terms)):
        total += terms[i] * kept[i]
    return total


@shared
def enter(terms, own, q):
    """Let the terms forget over a panel and take in its polynomial; the smaller factor of both is used, whose rounding counts less."""
    for i in range(len(terms)):
        gain = q[0] * own[0, i] + q[1] * own[1, i] + q[2] * own[2, i] + q[3] * own[3, i]
        terms[i] = terms[i] + (gain - own[5, i] * terms[i]) if own[5, i] < 0.5 else own[4, i] * terms[i] + gain


@shared
def add(terms, own, q):
    """Add a polynomial over a panel that has been taken in."""
    for i in range(len(terms)):
        terms[i] += q[0] * own[0, i] + q[1] * own[1, i] + q[2] * own[2, i] + q[3] * own[3, i]


@compiled(allocates=False)
def run(t, g, first, begin, order, slip, weights, rates, near, local, impulse, terms, history, own, other, total, places, picked, q, early):
    """Accept samples g[first:] at t[first:]; what stands before them is known already. H into history[first:]; the begin of the segment is returned.

    `terms` (components, terms) hold what is older than the panel before the newest sample; `local` moments of what the sum leaves of K, up to `near`;
    by `impulse` (components,) f jumps at the last sample known.
    """
    components = g.shape[1]
    if first - 1 > begin:
        decays(weights, rates, t[first - 1] - t[first - 2], own, total)
    for n in range(first, len(t)):
        known = n if n > 0 and t[n] > t[n - 1] else n - 1
        if n - 1 > begin:
            if known == n and order == 3 and n - 3 == begin:  # the first panel has got its last sample
                decays(weights, rates, t[n - 2] - t[n - 3], other, total)
                count = choose(t, n - 2, begin, n - 1, order, places, picked)
                for c in range(components):
                    through(t, g, c, n - 2, count, places, picked, slip, early[c])
                count = choose(t, n - 2, begin, n, order, places, picked)
                for c in range(components):
                    through(t, g, c, n - 2, count, places, picked, slip, q)
                    for m in range(4):
                        q[m] -= early[c, m]
                    add(terms[c], other, q)
            count = choose(t, n - 1, begin, min(known, n), order, places, picked)
            for c in range(components):
                through(t, g, c, n - 1, count, places, picked, slip, q)
                enter(terms[c], own, q)
        if n == first:
            for c in range(components):
                for i in range(len(weights)):
                    terms[c, i] += weights[i] * impulse[c]
                impulse[c] = 0.0
        if known < n:
            for c in range(components):
                history[n, c] = history[n - 1, c] if n > 0 else 0.0
                if slip and n > 0:
                    for i in range(len(weights)):
                        terms[c, i] += weights[i] * (g[n, c] - g[n - 1, c])
            begin = n
            continue
        step = t[n] - t[n - 1]
        decays(weights, rates, step, own, total)
        count = choose(t, n, begin, n, order, places, picked)
        share = near / step
        for c in range(components):
            through(t, g, c, n, count, places, picked, slip, q)
            value = left(terms[c], own[4])
            power = 1.0
            for m in range(4):
                value += q[m] * (total[m] + power * local[m])
                power *= share
            history[n, c] = value
    return begin
