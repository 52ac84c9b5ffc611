"""The compiled inner loop of a stream whose kernel follows the slip by an inner clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from basset._compile import compiled


def _make_decayed_moments(digest: str) -> Callable[..., Any]:
    def decayed_moments(z, result):
        """∫_0^1 u^q e^(−zu) du, q = 0 … len(result)−1: the last by a positive series (or upwards for large z), the rest downwards."""
        digest  # noqa: B018 - part of the cache key
        last = len(result) - 1
        tail = math.exp(-z)
        if z < last + 2.0:
            term = tail / (last + 1.0)
            total = term
            k = 1
            while term > 1e-17 * total:
                term *= z / (last + 1.0 + k)
                total += term
                k += 1
            result[last] = total
            for q in range(last, 0, -1):
                result[q - 1] = (z * result[q] + tail) / q
        else:
            result[0] = -math.expm1(-z) / z
            for q in range(1, last + 1):
                result[q] = (q * result[q - 1] - tail) / z

    return decayed_moments


decayed_moments = compiled(_make_decayed_moments)


def _make_series(digest: str) -> Callable[..., Any]:
    def series(coefficients, x):
        """Chebyshev series at x in [−1, 1], by Clenshaw."""
        digest  # noqa: B018 - part of the cache key
        b1 = 0.0
        b2 = 0.0
        for k in range(len(coefficients) - 1, 0, -1):
            b1, b2 = coefficients[k] + 2.0 * x * b1 - b2, b1
        return coefficients[0] + x * b1 - b2

    return series


series = compiled(_make_series)


def _make_clock_run(digest: str) -> Callable[..., Any]:
    def clock_run(
        samples,
        terms,
        clocks,
        impulses,
        steepness,
        count,
        rates,
        slips,
        history,
        window,
        steady,
        degree,
        monomials,
        rows,
        first_row,
        weights,
        decay,
        span,
        root,
        exponent,
    ):
        """Advance every component by all rows of `rates`; `slips` holds the unit-step steepness C' at each of them.

        samples, impulses (components, lags+1) and clocks (components, lags): newest first. `rows` (rows, lags+1, series)
        are the local weights as Chebyshev series in ln C' over `span`; row n belongs to start-up node first_row + n, the last to
        the steady form. `monomials` (degree, degree+1, degree+1) turns a stencil into powers of u on its panel.
        """
        digest  # noqa: B018 - part of the cache key
        steps, components = rates.shape
        lags = samples.shape[1] - 1
        moments = [0.0] * (degree + 1)
        powers = [0.0] * (degree + 1)
        for c in range(components):
            for step in range(steps):
                n = count + step
                bend = slips[step, c]
                for j in range(lags, 0, -1):
                    samples[c, j] = samples[c, j - 1]
                    impulses[c, j] = impulses[c, j - 1]
                for j in range(lags - 1, 0, -1):
                    clocks[c, j] = clocks[c, j - 1]
                samples[c, 0] = rates[step, c]
                impulses[c, 0] = 0.0
                before = steepness[c] if n > 0 else bend
                clocks[c, 0] = 0.5 * (before ** (2.0 / 3.0) + bend ** (2.0 / 3.0))
                steepness[c] = bend
                if n == 0:
                    history[step, c] = 0.0
                    continue
                # panels that leave the window join the exponentials; all older ones decay by the newest clock interval
                first_panel, last_panel = window, window
                if n < steady:
                    last_panel = window - 1
                elif n == steady:
                    last_panel = steady - 1
                for i in range(terms.shape[1]):
                    terms[c, i] *= math.exp(-decay[i] * clocks[c, 0])
                for k in range(first_panel, last_panel + 1):
                    start = max(k - degree // 2, 0)
                    if n == steady:
                        start = min(start, n - degree)
                    for q in range(degree + 1):
                        powers[q] = 0.0
                        for j in range(degree + 1):
                            powers[q] += monomials[k - start, q, j] * samples[c, start + j]
                    age = 0.0
                    for j in range(k):
                        age += clocks[c, j]
                    for i in range(terms.shape[1]):
                        decayed_moments(decay[i] * clocks[c, k], moments)
                        total = 0.0
                        for q in range(degree + 1):
                            total += powers[q] * moments[q]
                        terms[c, i] += total * math.exp(-decay[i] * age)
                if impulses[c, window] != 0.0:
                    age = 0.0
                    for j in range(window):
                        age += clocks[c, j]
                    for i in range(terms.shape[1]):
                        terms[c, i] += impulses[c, window] * math.exp(-decay[i] * age)
                x = (2.0 * math.log(bend) - span[0] - span[1]) / (span[1] - span[0])
                row = min(n, steady) - first_row
                value = 0.0
                for j in range(min(n, lags) + 1):
                    value += series(rows[row, j], x) * samples[c, j]
                total = 0.0
                for i in range(terms.shape[1]):
                    total += weights[i] * terms[c, i]
                value += bend ** (1.0 / 3.0) * total
                for j in range(1, window):
                    if impulses[c, j] != 0.0:
                        value += impulses[c, j] / math.sqrt(j) * (1.0 + (bend * j**1.5) ** (1.0 / exponent)) ** -exponent
                history[step, c] = root * value

    return clock_run


clock_run = compiled(_make_clock_run)
