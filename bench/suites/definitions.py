"""How far apart are the published drag predictors (thesis section 3.2.1)?"""

from __future__ import annotations

from typing import Any

import numpy as np

from saltation.effects.drag import LAWS

COMPARED = tuple(name for name in LAWS if name != "stokes")
SIZES = (73.0, 250.0)  # R_p of the two sands
POINTS = (10.0, 30.0, 100.0, 1000.0)  # Re of the table


def coefficient(law: str, reynolds: float) -> float:
    """C_D of a sphere or grain at Re."""
    return float(24.0 / reynolds * LAWS[law].factor(reynolds))


def crossing(law: str, value: float) -> float:
    """The Re at which C_D Re², which grows with Re, reaches a value."""
    low, high = -20.0, 20.0
    while low < (middle := 0.5 * (low + high)) < high:
        reynolds = float(np.exp(middle))
        low, high = (middle, high) if coefficient(law, reynolds) * reynolds**2 < value else (low, middle)
    return float(np.exp(low))


def run(full: bool) -> dict[str, Any]:
    """C_D over Re of every law but Stokes's, and the settling velocity of the two sands by each: C_D Re_p² = 4R_p²/3."""
    reynolds = np.logspace(-1, 5, 61)
    return {
        "reynolds": reynolds,
        "laws": {name: [coefficient(name, value) for value in reynolds] for name in COMPARED},
        "points": [{"reynolds": value, **{name: coefficient(name, value) for name in COMPARED}} for value in POINTS],
        "settling": [{"particle_reynolds": size, **{name: crossing(name, 4.0 / 3.0 * size**2) for name in COMPARED}} for size in SIZES],
    }
