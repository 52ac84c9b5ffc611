"""Encounters of grains with each other: the hard-sphere contact of the bed, between two moving grains of a [cloud]."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from saltation._tables import Table
from saltation.effects.base import Setting

__all__ = ["Options"]

NAME = "encounters"
SOURCE = "Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5; thesis section 4.2"
VALID = "contacts of two at a time, without the liquid that is squeezed out between them"


class Options(Table):
    """The contact of two grains."""

    restitution: float = Field(0.65, ge=0.0, le=1.0, description="e, dimensionless")
    friction: float = Field(0.1, ge=0.0, description="Coulomb's f, dimensionless")
    slowest: float = Field(0.01, ge=0.0, description="grains never part more slowly, in units of u*: ends endless series of ever smaller rebounds")
    pile_up: int = Field(20000, ge=1, description="a run stops when one grain has more encounters than this within one d/u*")


def build(options: Options, setting: Setting) -> Any:
    """Nothing: encounters are events, not a force."""
    return None
