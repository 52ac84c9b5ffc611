"""Encounters: collisions between grains of a [cloud], with the hard-sphere contact law of the bed."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from saltation._tables import Table
from saltation.effects.base import Setting

__all__ = ["Options"]

NAME = "encounters"
SOURCE = "Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5; thesis section 4.2"
VALID = "binary collisions, without lubrication between the grains"


class Options(Table):
    """Restitution, friction and limits of encounters."""

    restitution: float = Field(0.65, ge=0.0, le=1.0, description="e, dimensionless")
    friction: float = Field(0.1, ge=0.0, description="Coulomb's f, dimensionless")
    slowest: float = Field(0.01, ge=0.0, description="minimum speed of separation after an encounter, in units of u*: prevents inelastic collapse")
    pile_up: int = Field(20000, ge=1, description="the run stops when a grain has more encounters than this within one d/u*")


def build(options: Options, setting: Setting) -> Any:
    """Nothing: encounters are events, not a force."""
    return None
