"""Added mass: α = 1/(1 + R + C_m); in the thesis also a shear term C_m w du_f/dz along the stream.

Auton's form and Maxey & Riley's (5-1) have no such term in a steady parallel stream u_f(z). Without
it jumps of sand and gravel are some 10 % higher (reports/saltation.md).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from pydantic import Field

from saltation._tables import Table
from saltation.effects.base import Setting, Situation
from saltation.grain import Triple

__all__ = ["Options", "Remainder"]

NAME = "added_mass"
SOURCE = "thesis (3-1); Auton, Hunt & Prud'homme (1988), J. Fluid Mech. 197, 241"
VALID = "far from the wall"


class Options(Table):
    """The coefficient, and the form."""

    coefficient: float = Field(0.5, ge=0.0, le=1e6, description="C_m, dimensionless")
    form: Literal["thesis", "auton"] = Field("thesis", description="with the shear term C_m w du_f/dz along the stream ('thesis'), or without ('auton')")


class Remainder(NamedTuple):
    """C_m w u_f'."""

    coefficient: float  # C_m

    def force(self, s: Situation) -> Triple:
        """Along the stream."""
        return self.coefficient * s.slip_z * s.shear, 0.0, 0.0


def build(options: Options, setting: Setting) -> Remainder | None:
    """The shear term of the thesis's form; nothing for Auton's."""
    return Remainder(options.coefficient) if options.form == "thesis" else None
