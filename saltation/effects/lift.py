"""Shear lift normal to the bed, by one of several laws.

`squares` is the thesis's (3-2), ¾ C_L (|u_r|² at the top − |u_r|² at the bottom). The others are ¾ C_L |u_r|² for a slip along the stream, with
Re_p = |u_r| d/ν, Sr = |u_f'| d/|u_r| and ε = √(Sr/Re_p); a grain that lags behind the stream is pushed up.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

from pydantic import Field

from basset._compile import method, shared
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting, Situation, coefficient_of, joined, length
from saltation.flow import continued
from saltation.grain import Triple

__all__ = ["Law", "Lift", "Loth", "McLaughlin", "Mei", "Options", "Saffman", "Sheared"]

NAME = "lift"
SOURCE = "thesis (3-2); laws as named"
VALID = "squares: near the bed; the stream vanishes at and below the bed level, which the bottom point can reach; the others: far from walls"
SQUARES = 0.2
CLOSURES = {
    "wiberg_smith": Closure({"law": "squares", "coefficient": SQUARES}, 1985, "Wiberg & Smith (1985), J. Geophys. Res. 90, 7341", {"gap": (0.0, 0.5)}),
    "saffman": Closure({"law": "saffman"}, 1965, "Saffman (1965), J. Fluid Mech. 22, 385", {"Re_p": (0.0, 1.0), "√Re_G/Re_p": (5.0, math.inf)}),
    "mclaughlin": Closure({"law": "mclaughlin"}, 1991, "McLaughlin (1991), J. Fluid Mech. 224, 261", {"Re_p": (0.0, 1.0), "√Re_G/Re_p": (0.1, math.inf)}),
    "mei": Closure({"law": "mei"}, 1990, "Mei (1992), Int. J. Multiphase Flow 18, 145", {"Re_p": (0.1, 100.0), "shear": (0.01, 0.8)}),
    "loth": Closure({"law": "loth"}, 2002, "Loth (2008), AIAA J. 46, 801", {"Re_p": (0.0, 500.0), "shear": (0.0, 0.8)}),
}


class Options(Table):
    """The law, and the coefficient of 'squares'."""

    law: Literal["squares", "saffman", "mclaughlin", "mei", "loth"] = Field(
        "squares", description="'squares': the thesis's difference of squares; or a law of shear lift"
    )
    coefficient: float = Field(SQUARES, ge=0.0, le=1.0, description="C_L of law = 'squares', dimensionless")

    _one_law = coefficient_of("squares", SQUARES)


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


@shared
def saffman(shear: float, reynolds: float) -> float:
    """¾ C_L |u_r| in V with C_L = 1.615 (8/π) ε: a force 1.615 ρ √(ν |u_f'|) |u_r| d². Saffman (1965), J. Fluid Mech. 22, 385.

    shear: |u_f'| in V/d; reynolds: V d/ν.
    """
    return 1.615 * 6.0 / math.pi * math.sqrt(shear / reynolds)


@shared
def outer(slip: float, shear: float, reynolds: float) -> float:
    """J(ε)/J(∞) = ½ (1 + tanh[2.5 (log10 ε + 0.191)]) (0.667 + tanh[6 (ε − 0.32)])/1.667.

    Of the tables of McLaughlin (1991), J. Fluid Mech. 224, 261, as fitted by Mei (1992), Int. J. Multiphase Flow 18, 145, for ε from 0.1 to 20.
    """
    if not slip > 0.0:
        return 1.0
    epsilon = math.sqrt(shear / reynolds) / slip
    if not epsilon > 0.0:
        return 0.0
    return 0.5 * (1.0 + math.tanh(2.5 * (math.log10(epsilon) + 0.191))) * (0.667 + math.tanh(6.0 * (epsilon - 0.32))) / 1.667


class Law(Protocol):
    """What a law of the lift by shear has."""

    def strength(self, slip: float, shear: float) -> float:
        """¾ C_L |u_r| in V, of a slip |u_r| (V) and a shear |u_f'| > 0 (V/d)."""
        ...


class Saffman(NamedTuple):
    """C_L = 1.615 (8/π) ε: creeping flow, ε ≫ 1. Saffman (1965), J. Fluid Mech. 22, 385."""

    reynolds: float  # Re*

    def strength(self, slip: float, shear: float) -> float:
        """¾ C_L |u_r|."""
        return saffman(shear, self.reynolds)


class McLaughlin(NamedTuple):
    """Saffman's lift times J(ε)/2.255: Re_p ≪ 1, any ε. McLaughlin (1991), J. Fluid Mech. 224, 261."""

    reynolds: float  # Re*

    def strength(self, slip: float, shear: float) -> float:
        """¾ C_L |u_r|."""
        return saffman(shear, self.reynolds) * outer(slip, shear, self.reynolds)


class Mei(NamedTuple):
    """Saffman's lift times (1 − 0.3314 √α) exp(−Re_p/10) + 0.3314 √α up to Re_p = 40, 0.0524 √(α Re_p) beyond; α = Sr/2.

    Mei (1992), Int. J. Multiphase Flow 18, 145, from computations of Dandy & Dwyer (1990) at Re_p 0.1 to 100 and α 0.005 to 0.4. The pieces
    are 2 to 10 % of Saffman's lift apart: within a quarter of Re_p = 40 they are joined smoothly.
    """

    reynolds: float  # Re*

    def strength(self, slip: float, shear: float) -> float:
        """¾ C_L |u_r|."""
        if not slip > 0.0:
            return saffman(shear, self.reynolds)
        number = slip * self.reynolds
        low = math.exp(-0.1 * number) - 0.3314 * math.sqrt(0.5 * shear * slip) * math.expm1(-0.1 * number) / slip
        high = 0.0524 * math.sqrt(0.5 * shear * self.reynolds)
        return saffman(shear, self.reynolds) * joined(low, high, number / 40.0)


class Loth(NamedTuple):
    """McLaughlin's lift up to Re_p = 50, beyond C_L = −Sr^(1/3) (0.0525 + 0.0575 tanh[5 log10(Re_p/120)]). Loth (2008), AIAA J. 46, 801.

    Within a quarter of Re_p = 50 joined smoothly.
    """

    reynolds: float  # Re*

    def strength(self, slip: float, shear: float) -> float:
        """¾ C_L |u_r|."""
        low = saffman(shear, self.reynolds) * outer(slip, shear, self.reynolds)
        number = slip * self.reynolds
        if number <= 37.5:
            return low
        high = -0.75 * slip * (shear / slip) ** (1.0 / 3.0) * (0.0525 + 0.0575 * math.tanh(5.0 * math.log10(number / 120.0)))
        return joined(low, high, number / 50.0)


strength = method("strength", 2)


class Sheared(NamedTuple):
    """¾ C_L |u_r|² (u_f − u)/|u_r| upwards, for a stream that grows with height; each law names its source. Saffman (1965), J. Fluid Mech. 22, 385."""

    law: Any

    def force(self, s: Situation) -> Triple:
        """Normal to the bed."""
        shear = abs(s.shear)
        if not shear > 0.0:
            return 0.0, 0.0, 0.0
        return 0.0, 0.0, -strength(self.law, length(s.slip_x, s.slip_y, s.slip_z), shear) * s.slip_x * math.copysign(1.0, s.shear)


def build(options: Options, setting: Setting) -> Lift | Sheared:
    """The lift by the law that is named, in the scene's stream."""
    reynolds = setting.numbers.reynolds
    if options.law == "squares":
        return Lift(0.75 * options.coefficient, setting.profile)
    return Sheared({"saffman": Saffman(reynolds), "mclaughlin": McLaughlin(reynolds), "mei": Mei(reynolds), "loth": Loth(reynolds)}[options.law])
