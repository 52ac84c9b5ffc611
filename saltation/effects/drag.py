"""Steady drag: −¾ C_D |u_r| u_r, thesis (3-1), written as −(18/Re*) φ(Re) u_r with φ = C_D Re/24, finite at Re = 0."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, Protocol

from pydantic import Field

from basset._compile import method
from saltation._tables import Table
from saltation.effects.base import Setting, Situation
from saltation.grain import Numbers, Triple

__all__ = ["Drag", "EngelundHansen", "Law", "Options", "Rubey", "SchillerNaumann", "Stokes", "TurtonLevenspiel", "Yen"]

NAME = "drag"
SOURCE = "thesis (3-1); laws as named"
VALID = "see each law's range of Re = |u_r| d/ν"


class Law(Protocol):
    """What a law of drag has: `factor`, and `largest`, the Reynolds number up to which it is meant."""

    def factor(self, reynolds: float) -> float:
        """How many times Stokes's drag at Re = |u_r| d/ν: φ = C_D Re/24."""
        ...


class Stokes(NamedTuple):
    """φ = 1: creeping flow, Re below about 0.1. Stokes (1851)."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0


class Yen(NamedTuple):
    """C_D = 24/Re (1 + 0.15 √Re + 0.017 Re) − 0.208/(1 + 10⁴ Re^(−1/2)). Yen (1992), thesis (4-4)."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        root = math.sqrt(reynolds)
        return 1.0 + 0.15 * root + 0.017 * reynolds - 0.208 / 24.0 * reynolds * root / (root + 1.0e4)


class SchillerNaumann(NamedTuple):
    """C_D = 24/Re (1 + 0.15 Re^0.687) up to the Re where it has fallen to 0.44, and 0.44 beyond. Schiller & Naumann (1933)."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        value: float = max(1.0 + 0.15 * reynolds**0.687, 0.44 / 24.0 * reynolds)
        return value


class Rubey(NamedTuple):
    """C_D = 24/Re + 2. Rubey (1933)."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0 + reynolds / 12.0


class EngelundHansen(NamedTuple):
    """C_D = 24/Re + 1.5. Engelund & Hansen (1967), natural sand."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        return 1.0 + reynolds / 16.0


class TurtonLevenspiel(NamedTuple):
    """C_D = 24/Re (1 + 0.173 Re^0.657) + 0.413/(1 + 16300 Re^(−1.09)). Turton & Levenspiel (1986)."""

    largest: float

    def factor(self, reynolds: float) -> float:
        """φ."""
        value: float = 1.0 + 0.173 * reynolds**0.657 + 0.413 / 24.0 * reynolds**2.09 / (reynolds**1.09 + 16300.0)
        return value


LAWS: dict[str, Any] = {  # with the largest Re for which each was made
    "stokes": Stokes(0.1),
    "yen": Yen(2e5),
    "schiller_naumann": SchillerNaumann(2e5),
    "rubey": Rubey(2e5),
    "engelund_hansen": EngelundHansen(2e5),
    "turton_levenspiel": TurtonLevenspiel(2e5),
}
factor = method("factor", 1)


class Options(Table):
    """The law of the drag coefficient."""

    law: Literal["stokes", "yen", "schiller_naumann", "rubey", "engelund_hansen", "turton_levenspiel"] = Field("yen", description="drag law")


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


def warnings(options: Options, numbers: Numbers) -> list[str]:
    """Where the law is outside its range: judged by a slip of 2.5 V."""
    law, typical = LAWS[options.law], 2.5 * numbers.reynolds
    if typical <= law.largest:
        return []
    return [f"drag.law = '{options.law}' is meant for Re up to {law.largest:g}; a slip of 2.5 V has Re = {typical:.3g}"]
