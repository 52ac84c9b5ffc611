"""Shear lift: ¾ C_L (|u_r|² at the top − |u_r|² at the bottom) upwards, thesis (3-2)."""

from __future__ import annotations

from typing import Any, NamedTuple

from pydantic import Field

from saltation._tables import Table
from saltation.effects.base import Setting, Situation
from saltation.flow import continued
from saltation.grain import Triple

__all__ = ["Lift", "Options"]

NAME = "lift"
SOURCE = "Wiberg & Smith (1985), J. Geophys. Res. 90, 7341; thesis (3-2)"
VALID = "near the bed; the stream vanishes at and below the bed level, which the bottom point can reach"


class Options(Table):
    """The lift coefficient."""

    coefficient: float = Field(0.2, ge=0.0, le=1.0, description="C_L, dimensionless")


class Lift(NamedTuple):
    """¾ C_L (u_b − u_t)(2u − u_t − u_b), u_t and u_b the stream half a diameter above and below: no cancellation.

    Wiberg & Smith (1985), J. Geophys. Res. 90, 7341; thesis (3-2).
    """

    strength: float  # ¾ C_L
    profile: Any

    def force(self, s: Situation) -> Triple:
        """Normal to the bed."""
        top = continued(self.profile, s.z + 0.5, s.ahead)[0]
        bottom = continued(self.profile, s.z - 0.5, s.ahead)[0]
        return 0.0, 0.0, self.strength * (bottom - top) * (2.0 * (s.slip_x + s.stream) - top - bottom)


def build(options: Options, setting: Setting) -> Lift:
    """The lift in the scene's stream."""
    return Lift(0.75 * options.coefficient, setting.profile)
