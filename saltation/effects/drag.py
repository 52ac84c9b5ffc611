"""Steady drag: −¾ C_D |u_r| u_r, thesis (3-1), written as −(18/Re*) φ(Re) u_r with φ = C_D Re/24, finite at Re = 0."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

from pydantic import Field

from basset._compile import method
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting, Situation
from saltation.grain import Triple

__all__ = ["BrownLawler", "Drag", "EngelundHansen", "Law", "Options", "Rubey", "SchillerNaumann", "Stokes", "TurtonLevenspiel", "Yen"]

NAME = "drag"
SOURCE = "thesis (3-1); laws as named"
VALID = "see each law's range of Re_p = |u_r| d/ν"


class Law(Protocol):
    """What a law of drag has."""

    def factor(self, reynolds: float) -> float:
        """How many times Stokes's drag at Re = |u_r| d/ν: φ = C_D Re/24."""
        ...


class Stokes(NamedTuple):
    """φ = 1: creeping flow, Re below about 0.1. Stokes (1851)."""

    nothing: float  # a tuple that is compiled cannot be empty

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0


class Yen(NamedTuple):
    """C_D = 24/Re (1 + 0.15 √Re + 0.017 Re) − 0.208/(1 + 10⁴ Re^(−1/2)). Yen (1992), thesis (4-4)."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        root = math.sqrt(reynolds)
        return 1.0 + 0.15 * root + 0.017 * reynolds - 0.208 / 24.0 * reynolds * root / (root + 1.0e4)


class SchillerNaumann(NamedTuple):
    """C_D = 24/Re (1 + 0.15 Re^0.687) up to the Re where it has fallen to 0.44, and 0.44 beyond. Schiller & Naumann (1933)."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        value: float = max(1.0 + 0.15 * reynolds**0.687, 0.44 / 24.0 * reynolds)
        return value


class Rubey(NamedTuple):
    """C_D = 24/Re + 2. Rubey (1933)."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0 + reynolds / 12.0


class EngelundHansen(NamedTuple):
    """C_D = 24/Re + 1.5. Engelund & Hansen (1967), natural sand."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0 + reynolds / 16.0


class TurtonLevenspiel(NamedTuple):
    """C_D = 24/Re (1 + 0.173 Re^0.657) + 0.413/(1 + 16300 Re^(−1.09)). Turton & Levenspiel (1986)."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        value: float = 1.0 + 0.173 * reynolds**0.657 + 0.413 / 24.0 * reynolds**2.09 / (reynolds**1.09 + 16300.0)
        return value


class BrownLawler(NamedTuple):
    """C_D = 24/Re (1 + 0.150 Re^0.681) + 0.407/(1 + 8710/Re): all measured spheres, corrected for walls. Brown & Lawler (2003)."""

    nothing: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        value: float = 1.0 + 0.150 * reynolds**0.681 + 0.407 / 24.0 * reynolds * reynolds / (reynolds + 8710.0)
        return value


LAWS: dict[str, Any] = {
    "stokes": Stokes(0.0),
    "yen": Yen(0.0),
    "schiller_naumann": SchillerNaumann(0.0),
    "rubey": Rubey(0.0),
    "engelund_hansen": EngelundHansen(0.0),
    "turton_levenspiel": TurtonLevenspiel(0.0),
    "brown_lawler": BrownLawler(0.0),
}
TO_THE_CRISIS = {"Re_p": (0.0, 2e5)}  # beyond, the boundary layer is turbulent
CLOSURES = {
    "stokes": Closure({"law": "stokes"}, 1851, "Stokes (1851)", {"Re_p": (0.0, 0.1)}),
    "yen": Closure({"law": "yen"}, 1992, "Yen (1992)", TO_THE_CRISIS),
    "schiller_naumann": Closure({"law": "schiller_naumann"}, 1933, "Schiller & Naumann (1933)", TO_THE_CRISIS),
    "rubey": Closure({"law": "rubey"}, 1933, "Rubey (1933)", TO_THE_CRISIS),
    "engelund_hansen": Closure({"law": "engelund_hansen"}, 1967, "Engelund & Hansen (1967)", TO_THE_CRISIS),
    "turton_levenspiel": Closure({"law": "turton_levenspiel"}, 1986, "Turton & Levenspiel (1986), Powder Technol. 47, 83", TO_THE_CRISIS),
    "brown_lawler": Closure({"law": "brown_lawler"}, 2003, "Brown & Lawler (2003), J. Environ. Eng. 129, 222", TO_THE_CRISIS),
}
factor = method("factor", 1)


class Options(Table):
    """The law of the drag coefficient."""

    law: Literal["stokes", "yen", "schiller_naumann", "rubey", "engelund_hansen", "turton_levenspiel", "brown_lawler"] = Field("yen", description="drag law")


class Drag(NamedTuple):
    """−(18/Re*) φ(|u_r| Re*) u_r, thesis (3-1); each law names its own source."""

    law: Any
    rate: float  # 18/Re*
    reynolds: float  # Re*

    def force(self, s: Situation) -> Triple:
        """Against the slip."""
        speed = math.sqrt(s.slip_x * s.slip_x + s.slip_y * s.slip_y + s.slip_z * s.slip_z)
        strength = -self.rate * factor(self.law, speed * self.reynolds)
        return strength * s.slip_x, strength * s.slip_y, strength * s.slip_z


def build(options: Options, setting: Setting) -> Drag:
    """The drag by the law that is named."""
    reynolds = setting.numbers.reynolds
    return Drag(LAWS[options.law], 18.0 / reynolds, reynolds)
