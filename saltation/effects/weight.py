"""Submerged weight: (sin θ, 0, −cos θ)/τ*, thesis (3-1), (3-2)."""

from __future__ import annotations

import math
from typing import NamedTuple

from saltation._tables import Table
from saltation.effects.base import Setting, Situation
from saltation.grain import Triple

__all__ = ["Options", "Weight"]

NAME = "weight"
SOURCE = "thesis (3-1), (3-2)"
VALID = "always"


class Options(Table):
    """Nothing to choose; the slope is the channel's.

    Examples
    --------
    >>> Options().model_dump()
    {}
    """


class Weight(NamedTuple):
    """Constant force along and normal to the bed.

    Attributes
    ----------
    along, normal : float, dimensionless
        sin θ/τ* and cos θ/τ*.

    References
    ----------
    Thesis (3-1), (3-2).

    Examples
    --------
    >>> Weight(0.5, 30.0).force(Situation(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    (0.5, 0.0, -30.0)
    """

    along: float
    normal: float

    def force(self, s: Situation) -> Triple:
        """(along, 0, −normal)."""
        return self.along, 0.0, -self.normal


def build(options: Options, setting: Setting) -> Weight:
    """The weight on the channel's slope."""
    slope, shields = setting.numbers.slope, setting.numbers.shields
    return Weight(math.sin(slope) / shields, math.cos(slope) / shields)
