"""Rotation: the fluid's torque on a turning grain (thesis 3-4), or a prescribed spin (thesis 3-6).

dω/dt = −(15/16π) C_t |ω_r| ω_r/(ρ_s/ρ): the print misses ρ/ρ_s (torque ½ρ C_t a⁵|ω_r|ω_r, I = 8/15 π ρ_s a⁵).
C_t = C1/√Re_r + C2/Re_r + C3 Re_r with Re_r = |ω_r| Re*/4, so C_t |ω_r| = (4/Re*)(C1 √Re_r + C2 + C3 Re_r²): finite at rest.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from pydantic import Field

from basset._compile import shared
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting, Situation, joined
from saltation.grain import Numbers, Triple

__all__ = ["Options", "Yamamoto", "friction_of", "prescribed_spin"]

NAME = "rotation"
SOURCE = "Yamamoto et al. (2001), J. Fluid Mech. 442, 303; Niño & García (1994) for the prescribed spin, thesis (3-6)"
VALID = "the prescribed spin: R_p 60 to 90, T below about 3"
CLOSURES = {
    "yamamoto": Closure({"law": "yamamoto"}, 1980, "Yamamoto et al. (2001), J. Fluid Mech. 442, 303", {"Re_r": (0.0, 4000.0)}),  # Dennis et al. (1980)
}


class Options(Table):
    """The law, and whether ρ/ρ_s is in it."""

    law: Literal["yamamoto", "prescribed"] = Field("yamamoto", description="the torque of thesis (3-4), or ω_y = 5.11 − 1.13 T (3-6)")
    density_ratio: bool = Field(True, description="divide the torque by ρ_s/ρ; false: as printed in the thesis")


@shared
def friction_of(number: float) -> float:
    """C1 √Re_r + C2 + C3 Re_r² at Re_r = |ω_r| Re*/4, the pieces of the table of Yamamoto et al. (2001), J. Fluid Mech. 442, 303, blended.

    The pieces meet with jumps of up to 0.8 %, which no integrator of high order passes cheaply: within a quarter of each meeting point they are
    joined smoothly (by less than half the jump).
    """
    root = math.sqrt(number)
    value = 16.0 * math.pi
    value = joined(value, 16.0 * math.pi + 0.0418 * number * number, number)
    value = joined(value, 5.32 * root + 37.2, 0.1 * number)
    value = joined(value, 6.44 * root + 32.2, 0.05 * number)
    return joined(value, 6.45 * root + 32.1, 0.02 * number)


class Yamamoto(NamedTuple):
    """Viscous torque on a sphere. Yamamoto et al. (2001), J. Fluid Mech. 442, 303; thesis (3-4)."""

    rate: float  # (15/16π)(4/Re*), over ρ_s/ρ
    quarter: float  # Re*/4

    def torque(self, s: Situation) -> Triple:
        """Rate of spin (x, y, z)."""
        x, y, z = s.spin_x, s.spin_y - 0.5 * s.shear, s.spin_z
        number = self.quarter * math.sqrt(x * x + y * y + z * z)
        friction = friction_of(number)
        return -self.rate * friction * x, -self.rate * friction * y, -self.rate * friction * z


def build(options: Options, setting: Setting) -> Yamamoto | None:
    """The torque; None where the spin is prescribed."""
    if options.law == "prescribed":
        return None
    numbers = setting.numbers
    rate = 15.0 / (16.0 * math.pi) * 4.0 / numbers.reynolds
    return Yamamoto(rate / numbers.density_ratio if options.density_ratio else rate, 0.25 * numbers.reynolds)


def prescribed_spin(stage: float) -> float:
    """ω_y d/u* = 5.11 − 1.13 T. Niño & García (1994); thesis (3-6)."""
    return 5.11 - 1.13 * stage


def warnings(options: Options, numbers: Numbers) -> list[str]:
    """Where the regression of the spin is left."""
    if options.law == "prescribed" and numbers.stage is not None and not (60.0 <= numbers.particle_reynolds <= 90.0 and numbers.stage < 3.0):
        return [
            f"rotation.law = 'prescribed' was measured for R_p 60 to 90 and T below 3, here R_p = {numbers.particle_reynolds:.3g} and T = {numbers.stage:.3g}"
        ]
    return []
