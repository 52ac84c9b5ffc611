"""Magnus force: C ω_r × u_r, C = ¾ in creeping flow, with ω_r = ω − ½ ∇×u_f, its sign kept (the bars in the print of thesis (3-2) lose it)."""

from __future__ import annotations

from typing import Literal, NamedTuple

from pydantic import Field

from saltation._tables import Table
from saltation.effects.base import Setting, Situation
from saltation.grain import Triple

__all__ = ["Options", "Vector", "Vertical"]

NAME = "magnus"
SOURCE = "Rubinow & Keller (1961), J. Fluid Mech. 11, 447; thesis (3-2); Tsuji, Morikawa & Mizuno (1985), J. Fluids Eng. 107, 484"
VALID = "derived for small Re; used beyond"


class Options(Table):
    """All components or the thesis's choice, and how strong."""

    form: Literal["vertical", "vector"] = Field("vertical", description="the component normal to the bed only (thesis), or the whole vector")
    coefficient: float = Field(
        0.75,
        ge=0.0,
        le=1.0,
        description="C, dimensionless: 0.75 in creeping flow (Rubinow & Keller 1961), a fifth of it (0.15) measured at Re 550 to 1600 (Tsuji et al. 1985)",
    )


class Vertical(NamedTuple):
    """C (u_f − u)(ω_y − ½ u_f') upwards. Rubinow & Keller (1961), J. Fluid Mech. 11, 447; thesis (3-2)."""

    strength: float  # C

    def force(self, s: Situation) -> Triple:
        """Normal to the bed."""
        return 0.0, 0.0, -self.strength * s.slip_x * (s.spin_y - 0.5 * s.shear)


class Vector(NamedTuple):
    """C ω_r × u_r. Rubinow & Keller (1961), J. Fluid Mech. 11, 447."""

    strength: float  # C

    def force(self, s: Situation) -> Triple:
        """All three components."""
        spin_y = s.spin_y - 0.5 * s.shear
        x = spin_y * s.slip_z - s.spin_z * s.slip_y
        y = s.spin_z * s.slip_x - s.spin_x * s.slip_z
        z = s.spin_x * s.slip_y - spin_y * s.slip_x
        return self.strength * x, self.strength * y, self.strength * z


def build(options: Options, setting: Setting) -> Vertical | Vector:
    """The form that is named."""
    return Vertical(options.coefficient) if options.form == "vertical" else Vector(options.coefficient)
