"""Wall: what a plane wall at z = 0 adds to the drag of a sphere near it, along the wall and normal to it, up to contact.

−(18/Re*) (λ − 1) u_r, λ the drag over Stokes's: added to any law of drag, as the liquid in a narrow gap creeps at any Reynolds number. Normal to the wall
λ grows as radius over gap (lubrication), and no smooth sphere would ever touch: the asperities of the surfaces meet when the gap is as wide as they are high.
What lubrication takes, a restitution by the Stokes number takes too: with this effect e is the dry one. The bounces of Gondret, Lance & Petit (2002) at St 27
and 152 are met within 6 % rms with e = 0.97, asperities of 8e-4 d, Basset's kernel, the rebound remembered (`impulse`) and Yen's drag, which has their speed
of approach within 1 %; no other treatment of the history at the rebound comes below 20 %.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

from pydantic import Field

from basset._compile import method
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting, Situation, length
from saltation.grain import Triple

__all__ = ["Brenner", "Faxen", "Free", "Law", "Lubrication", "Options", "Wall", "Zeng"]

NAME = "wall"
SOURCE = "Brenner (1961), Chem. Eng. Sci. 16, 242; Goldman, Cox & Brenner (1967), Chem. Eng. Sci. 22, 637; laws as named"
VALID = "a smooth plane wall; over a bed of grains the plane is the bed level, and grains touch before their gap to it closes"
CLOSURES = {
    "brenner": Closure({"normal": "brenner"}, 1961, "Brenner (1961), Chem. Eng. Sci. 16, 242", {"Re_p": (0.0, 1.0)}),
    "lubrication": Closure(  # flown against the bounces of Gondret, Lance & Petit (2002) at St 27 and 152
        {"normal": "lubrication"}, 2002, "Nguyen & Ladd (2002), Phys. Rev. E 66, 046708", {"St": (20.0, 200.0)}
    ),
    "faxen": Closure({"parallel": "faxen"}, 1922, "Faxén (1922), Ann. Phys. 373, 89", {"Re_p": (0.0, 1.0)}),
    "zeng": Closure({"parallel": "zeng"}, 2009, "Zeng, Najjar, Balachandar & Fischer (2009), Phys. Fluids 21, 033302", {"Re_p": (0.0, 250.0)}),
}


class Options(Table):
    """A law for each direction, and the roughness."""

    normal: Literal["lubrication", "brenner", "none"] = Field("lubrication", description="drag of motion normal to the wall")
    parallel: Literal["zeng", "faxen", "none"] = Field("zeng", description="drag of motion along the wall")
    roughness: float = Field(8e-4, ge=1e-7, le=0.1, description="height of the asperities, in units of d: the gap at contact")


class Law(Protocol):
    """What a law of the drag near a wall has."""

    def excess(self, gap: float, reynolds: float) -> float:
        """λ − 1 at a gap (d) and Re_p of the motion in that direction."""
        ...


class Free(NamedTuple):
    """No wall."""

    nothing: float  # a tuple that is compiled cannot be empty

    def excess(self, gap: float, reynolds: float) -> float:
        """Zero."""
        return 0.0


class Brenner(NamedTuple):
    """λ − 1 = (7ε + 2)/(6ε² + 2ε), ε = gap over radius. Bevan & Prieve (2000), J. Chem. Phys. 113, 1228, fit to Brenner (1961)."""

    nothing: float

    def excess(self, gap: float, reynolds: float) -> float:
        """λ − 1."""
        e = 2.0 * gap
        return (7.0 * e + 2.0) / (e * (6.0 * e + 2.0))


class Lubrication(NamedTuple):
    """λ − 1 = 1/ε − 1 in a narrow gap, closed smoothly: e^(−ε)/ε. Nguyen & Ladd (2002), Phys. Rev. E 66, 046708, who cut it off at a gap of one radius.

    Beyond that, flow at finite Reynolds numbers feels less of the wall than Brenner's. A cut is a kink, which no step of high order passes cheaply.
    """

    nothing: float

    def excess(self, gap: float, reynolds: float) -> float:
        """λ − 1."""
        e = 2.0 * gap
        return math.exp(-e) / e


class Faxen(NamedTuple):
    """1/λ = 1 − 9/16 l + 1/8 l³ − 45/256 l⁴ − 1/16 l⁵, l = radius over height of the centre. Faxén (1922), Ann. Phys. 373, 89."""

    nothing: float

    def excess(self, gap: float, reynolds: float) -> float:
        """λ − 1."""
        x = 0.5 / (0.5 + gap)
        lost = x * (9.0 / 16.0 - x * x * (0.125 - x * (45.0 / 256.0 + x / 16.0)))
        return lost / (1.0 - lost)


class Zeng(NamedTuple):
    """λ = [1.028 − 0.07/(1 + 4δ²) − 8/15 ln(270δ/(135 + 256δ))] (1 + 0.15 (1 − e^(−√δ)) Re_p^(0.687 + 0.313 e^(−2√δ))), less 0.15 Re_p^0.687; δ = gap in d.

    Zeng, Najjar, Balachandar & Fischer (2009), Phys. Fluids 21, 033302: far from the wall Schiller & Naumann's. Beyond its range of Re_p, what it adds at 250.
    """

    nothing: float

    def excess(self, gap: float, reynolds: float) -> float:
        """λ − 1."""
        root, reynolds = math.sqrt(gap), min(reynolds, 250.0)
        creeping = 1.028 - 0.07 / (1.0 + 4.0 * gap * gap) - 8.0 / 15.0 * math.log(270.0 * gap / (135.0 + 256.0 * gap))
        grown = -0.15 * math.expm1(-root) * reynolds ** (0.687 + 0.313 * math.exp(-2.0 * root))
        value: float = creeping * (1.0 + grown) - 1.0 - 0.15 * reynolds**0.687
        return value


excess = method("excess", 2)
NORMAL = {"brenner": Brenner(0.0), "lubrication": Lubrication(0.0), "none": Free(0.0)}
PARALLEL = {"zeng": Zeng(0.0), "faxen": Faxen(0.0), "none": Free(0.0)}


class Wall(NamedTuple):
    """−(18/Re*) (λ − 1) u_r in each direction; each law names its source. Brenner (1961)."""

    normal: Any
    parallel: Any
    rate: float  # 18/Re*
    reynolds: float  # Re*
    roughness: float  # d

    def force(self, s: Situation) -> Triple:
        """Against the slip."""
        gap = max(s.z - 0.5 + self.roughness, 0.5 * self.roughness)  # smooth beyond contact, for the step that finds it
        along = -self.rate * excess(self.parallel, gap, length(s.slip_x, s.slip_y, 0.0) * self.reynolds)
        return along * s.slip_x, along * s.slip_y, -self.rate * excess(self.normal, gap, abs(s.slip_z) * self.reynolds) * s.slip_z


def build(options: Options, setting: Setting) -> Wall:
    """The laws that are named."""
    reynolds = setting.numbers.reynolds
    return Wall(NORMAL[options.normal], PARALLEL[options.parallel], 18.0 / reynolds, reynolds, options.roughness)
