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
    """Nothing to choose; the slope is the channel's."""


class Weight(NamedTuple):
    """Constant force along and normal to the bed, thesis (3-1), (3-2)."""

    along: float  # sin θ/τ*
    normal: float  # cos θ/τ*

    def force(self, s: Situation) -> Triple:
        """(along, 0, −normal)."""
        return self.along, 0.0, -self.normal


def build(options: Options, setting: Setting) -> Weight:
    """The weight on the channel's slope."""
    slope, shields = setting.numbers.slope, setting.numbers.shields
    return Weight(math.sin(slope) / shields, math.cos(slope) / shields)
