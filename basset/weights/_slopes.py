"""Rates of samples at nonuniform times: compiled."""

from __future__ import annotations

from typing import Any

from basset._compile import compiled


@compiled()
def rates(times: Any, values: Any, bounds: Any, degree: int, out: Any) -> None:
    """Slopes at every sample of the polynomial through the degree + 1 samples around it, within each piece; Lagrange's form."""
    for piece in range(len(bounds) - 1):
        first, last = bounds[piece], bounds[piece + 1]
        width = min(degree + 1, last - first)
        for k in range(first, last):
            start = min(max(k - width // 2, first), last - width)
            for c in range(values.shape[1]):
                out[k, c] = 0.0
            for j in range(start, start + width):
                if j != k:
                    above, below = 1.0, times[j] - times[k]
                    for m in range(start, start + width):
                        if m not in (j, k):
                            above *= times[k] - times[m]
                            below *= times[j] - times[m]
                    for c in range(values.shape[1]):
                        out[k, c] += above / below * (values[j, c] - values[k, c])
