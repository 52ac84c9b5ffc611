"""Magnus force: C ω_r × u_r with ω_r = ω − ½ ∇×u_f, its sign kept (the bars in the print of thesis (3-2) lose it).

C = ¾ in creeping flow. At finite Reynolds numbers the force is ½ρ(πd²/4) C_L |u_r| (ω_r × u_r)/|ω_r|, that is C = ¾ C_L |u_r|/(|ω_r| d), and creeping
flow has C_L = Re_r/Re_p.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

from pydantic import Field

from basset._compile import method
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting, Situation, coefficient_of, length
from saltation.grain import Triple

__all__ = ["Law", "Linear", "Loth", "OesterleBuiDinh", "Options", "Vector", "Vertical"]

NAME = "magnus"
SOURCE = "thesis (3-2); laws as named"
VALID = "far from walls; see each law's range of Re_p and of the spin"
CREEPING = 0.75
CLOSURES = {
    "rubinow_keller": Closure(
        {"law": "linear", "coefficient": CREEPING}, 1961, "Rubinow & Keller (1961), J. Fluid Mech. 11, 447", {"Re_p": (0.0, 1.0), "Re_r": (0.0, 1.0)}
    ),
    "tsuji": Closure(
        {"law": "linear", "coefficient": 0.15},
        1985,
        "Tsuji, Morikawa & Mizuno (1985), J. Fluids Eng. 107, 484",
        {"Re_p": (550.0, 1600.0), "Re_r/Re_p": (0.0, 1.4)},
    ),
    "oesterle_bui_dinh": Closure(
        {"law": "oesterle_bui_dinh"}, 1998, "Oesterlé & Bui Dinh (1998), Exp. Fluids 25, 16", {"Re_p": (0.0, 140.0), "Re_r/Re_p": (2.0, 12.0)}
    ),
    "loth": Closure({"law": "loth"}, 2002, "Loth (2008), AIAA J. 46, 801", {"Re_p": (0.0, 2000.0), "Re_r/Re_p": (0.0, 20.0)}),
}


class Options(Table):
    """All components or the vertical one, the law, and its coefficient."""

    form: Literal["vertical", "vector"] = Field("vertical", description="the component normal to the bed only (thesis), or the whole vector")
    law: Literal["linear", "oesterle_bui_dinh", "loth"] = Field("linear", description="C is a number, or a function of Re_p and Re_r")
    coefficient: float = Field(
        CREEPING,
        ge=0.0,
        le=1.0,
        description="C of law = 'linear', dimensionless: 0.75 in creeping flow, a fifth of it (0.15) measured at Re 550 to 1600 (Tsuji et al. 1985)",
    )

    _one_law = coefficient_of("linear", CREEPING)


class Law(Protocol):
    """What a law of the Magnus force has."""

    def strength(self, slip: float, spin: float) -> float:
        """C, dimensionless, of a slip |u_r| (V) and a spin |ω_r| (V/d)."""
        ...


class Linear(NamedTuple):
    """C is a number: ¾ in creeping flow. Rubinow & Keller (1961), J. Fluid Mech. 11, 447."""

    coefficient: float

    def strength(self, slip: float, spin: float) -> float:
        """C."""
        return self.coefficient


class OesterleBuiDinh(NamedTuple):
    """C_L = 0.45 + (Re_r/Re_p − 0.45) exp(−0.05684 Re_r^0.4 Re_p^0.3). Oesterlé & Bui Dinh (1998), Exp. Fluids 25, 16.

    Measured at Re_p 10 to 140 and Re_r/Re_p 2 to 12; the force of slower spins falls as Re_r^0.4 only.
    """

    reynolds: float  # Re*

    def strength(self, slip: float, spin: float) -> float:
        """C."""
        if not spin > 0.0:
            return CREEPING
        exponent = 0.05684 * (spin * self.reynolds) ** 0.4 * (slip * self.reynolds) ** 0.3
        return CREEPING * (math.exp(-exponent) - 0.45 * slip * math.expm1(-exponent) / spin)


class Loth(NamedTuple):
    """C = ¾ {1 − (0.675 + 0.15 (1 + tanh[0.28 (Re_r/Re_p − 2)])) tanh(0.18 √Re_p)}. Loth (2008), AIAA J. 46, 801.

    Made for Re_p up to 2000 and Re_r/Re_p up to 20.
    """

    reynolds: float  # Re*

    def strength(self, slip: float, spin: float) -> float:
        """C."""
        if not slip > 0.0:
            return CREEPING
        lost = 0.675 + 0.15 * (1.0 + math.tanh(0.28 * (spin / slip - 2.0)))
        return CREEPING * (1.0 - lost * math.tanh(0.18 * math.sqrt(slip * self.reynolds)))


strength = method("strength", 2)


class Vertical(NamedTuple):
    """C (u_f − u)(ω_y − ½ u_f') upwards, thesis (3-2)."""

    law: Any

    def force(self, s: Situation) -> Triple:
        """Normal to the bed."""
        spin_y = s.spin_y - 0.5 * s.shear
        c = strength(self.law, length(s.slip_x, s.slip_y, s.slip_z), length(s.spin_x, spin_y, s.spin_z))
        return 0.0, 0.0, -c * s.slip_x * spin_y


class Vector(NamedTuple):
    """C ω_r × u_r, thesis (3-2) before it takes one component."""

    law: Any

    def force(self, s: Situation) -> Triple:
        """All three components."""
        spin_y = s.spin_y - 0.5 * s.shear
        c = strength(self.law, length(s.slip_x, s.slip_y, s.slip_z), length(s.spin_x, spin_y, s.spin_z))
        x = spin_y * s.slip_z - s.spin_z * s.slip_y
        y = s.spin_z * s.slip_x - s.spin_x * s.slip_z
        z = s.spin_x * s.slip_y - spin_y * s.slip_x
        return c * x, c * y, c * z


def build(options: Options, setting: Setting) -> Vertical | Vector:
    """The form and the law that are named."""
    reynolds = setting.numbers.reynolds
    laws = {"linear": Linear(options.coefficient), "oesterle_bui_dinh": OesterleBuiDinh(reynolds), "loth": Loth(reynolds)}
    return Vertical(laws[options.law]) if options.form == "vertical" else Vector(laws[options.law])
