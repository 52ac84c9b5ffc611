"""Uniform numbers as a function of (seed, grain, impact): the counter-based Philox-4x32-10.

Restarts, re-computation and the number of workers cannot change them. Source: Salmon et al. (2011), SC11, 16.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from basset._compile import shared

MASK = np.uint64(0xFFFFFFFF)
HALF = np.uint64(32)
MULTIPLIER_0, MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
WEYL_0, WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)

Draws = tuple[float, float, float, float]


@shared
def philox(counter: tuple[Any, Any, Any, Any], key: tuple[Any, Any]) -> tuple[Any, Any, Any, Any]:
    """Ten rounds on four 32-bit words (uint64 each) with a key of two."""
    a, b, c, d = counter
    k, m = key
    for _ in range(10):
        one, two = MULTIPLIER_0 * a, MULTIPLIER_1 * c
        a, b, c, d = (two >> HALF) ^ b ^ k, two & MASK, (one >> HALF) ^ d ^ m, one & MASK
        k, m = (k + WEYL_0) & MASK, (m + WEYL_1) & MASK
    return a, b, c, d


@shared
def uniforms(seed: int, grain: int, impact: int) -> Draws:
    """Four uniform numbers in (0, 1), 32 bits each, of one impact of one grain."""
    place = np.uint64(impact)
    words = philox((place & MASK, place >> HALF, np.uint64(grain) & MASK, np.uint64(grain) >> HALF), (np.uint64(seed) & MASK, np.uint64(seed) >> HALF))
    scale = 1.0 / 4294967296.0
    return (
        (np.float64(words[0]) + 0.5) * scale,
        (np.float64(words[1]) + 0.5) * scale,
        (np.float64(words[2]) + 0.5) * scale,
        (np.float64(words[3]) + 0.5) * scale,
    )
