"""What a force sees, and what every effect file provides.

An effect file in this folder has: `NAME`, the word in a scene's `effects`; `Options`, its table in the scene; `SOURCE` and
`VALID`, for reports and warnings; and `build(options, setting)`, which returns a NamedTuple with `force(self, s)` (units of
the thesis's (3-1): times α it is an acceleration in V²/d), with `torque(self, s)` (spin rate), or None where the effect
works through the scene's numbers alone; turbulence, which moves the stream itself, returns what `flight/equations.py` asks for it.
`warnings(options, numbers)` is optional. Adding an effect is adding a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from pydantic import model_validator

from basset._compile import method, overloads, shared
from saltation.grain import Numbers, Triple

__all__ = ["Force", "NoTorque", "Setting", "Situation", "Torque", "coefficient_of", "joined", "length", "total_force"]


class Situation(NamedTuple):
    """Where the grain is and how it moves."""

    z: float  # d, height of its centre above the bed level
    slip_x: float  # V, slip u − u_f
    slip_y: float
    slip_z: float
    stream: float  # V, u_f
    shear: float  # V/d, du_f/dz
    spin_x: float  # V/d
    spin_y: float
    spin_z: float
    ahead: float = 0.0  # d, the profile is continued smoothly from the side of its floor on which z + ahead lies (and z ± ½ + ahead for z ± ½)


class Setting(NamedTuple):
    """What `build` may use: the scene's numbers and its stream (in flights its table), depth of the water and roughness (d), κ, and the seed of its draws."""

    numbers: Numbers
    profile: Any
    depth: float = math.inf
    roughness: float = 1.0
    kappa: float = 0.41
    seed: int = 0


class Force(Protocol):
    """What an effect that pushes the grain has."""

    def force(self, s: Situation) -> Triple:
        """Force (x, y, z) in the unit of thesis (3-1): times α it is an acceleration in V²/d."""
        ...


class Torque(Protocol):
    """What an effect that turns the grain has."""

    def torque(self, s: Situation) -> Triple:
        """Rate of change of the spin about x, y, z, (V/d)²."""
        ...


class NoTorque(NamedTuple):
    """The spin changes at contacts only."""

    nothing: float  # a tuple that is compiled cannot be empty

    def torque(self, s: Situation) -> Triple:
        """Zero."""
        return 0.0, 0.0, 0.0


def coefficient_of(law: str, usual: float) -> Any:
    """A validator of options: `coefficient` is that of one law, and of no other."""

    def check(self: Any) -> Any:
        if self.law != law and self.coefficient != usual:
            raise ValueError(f"coefficient belongs to law = {law!r}, got {self.coefficient:g} with law = {self.law!r}: leave one of them out")
        return self

    return model_validator(mode="after")(check)


@shared
def length(x: float, y: float, z: float) -> float:
    """Of a vector, in its unit."""
    return math.sqrt(x * x + y * y + z * z)


@shared
def joined(below: float, above: float, place: float) -> float:
    """`below` for place < 0.75, `above` for place > 1.25, with continuous first and second derivatives between."""
    if place <= 0.75:
        return below
    if place >= 1.25:
        return above
    x = 2.0 * (place - 0.75)
    return below + (above - below) * x * x * x * (10.0 + x * (6.0 * x - 15.0))


force = method("force", 1)
torque = method("torque", 1)


def total_force(effects: tuple[Any, ...], s: Situation) -> Triple:
    """Sum of the forces of a tuple of effects, (x, y, z) in the unit of thesis (3-1)."""
    x, y, z = 0.0, 0.0, 0.0
    for effect in reversed(effects):  # the order of the compiled form: the same bits
        fx, fy, fz = force(effect, s)
        x, y, z = fx + x, fy + y, fz + z
    return x, y, z


@overloads(total_force)
def _total_force(effects: Any, s: Any) -> Callable[..., Triple]:
    def none(effects: Any, s: Any) -> Triple:
        return 0.0, 0.0, 0.0

    def total(effects: Any, s: Any) -> Triple:
        x, y, z = force(effects[0], s)
        a, b, c = total_force(effects[1:], s)
        return x + a, y + b, z + c

    return total if len(effects) else none
