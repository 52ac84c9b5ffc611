"""What a force sees, and what every effect file provides.

An effect file in this folder has: `NAME`, the word in a scene's `effects`; `Options`, its table in the scene; `SOURCE` and
`VALID`, for reports and warnings; and `build(options, setting)`, which returns a NamedTuple with `force(self, s)` (units of
the thesis's (3-1): times α it is an acceleration in V²/d), with `torque(self, s)` (spin rate), or None where the effect
works through the scene's numbers alone. `warnings(options, numbers)` is optional. Adding an effect is adding a file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from basset._compile import method, overloads
from saltation.grain import Numbers, Triple

__all__ = ["Force", "NoTorque", "Setting", "Situation", "Torque", "total_force"]


class Situation(NamedTuple):
    """Where the grain is and how it moves.

    Attributes
    ----------
    z : float, d
        Height of its centre above the bed level.
    slip_x, slip_y, slip_z : float, V
        Slip u − u_f.
    stream, shear : float, V and V/d
        u_f and du_f/dz.
    spin_x, spin_y, spin_z : float, V/d
    ahead : float, d
        The profile is continued smoothly from the side of its floor on which z + ahead lies (and z ± ½ + ahead for z ± ½).

    Examples
    --------
    >>> here = Situation(1.0, -2.0, 0.0, 0.5, 6.0, 2.5, 0.0, 3.0, 0.0)
    >>> here.slip_x + here.stream  # the grain's own speed along the stream
    4.0
    """

    z: float
    slip_x: float
    slip_y: float
    slip_z: float
    stream: float
    shear: float
    spin_x: float
    spin_y: float
    spin_z: float
    ahead: float = 0.0


class Setting(NamedTuple):
    """What `build` may use: the scene's numbers and its stream.

    Attributes
    ----------
    numbers : Numbers
        The scene's dimensionless numbers.
    profile : profile of `saltation.flow`
        The stream; in flights its table.

    Examples
    --------
    >>> import saltation
    >>> scene = saltation.load("sand")
    >>> Setting(scene.numbers, scene.profile).numbers.stage
    1.87
    """

    numbers: Numbers
    profile: Any


class Force(Protocol):
    """What an effect that pushes the grain has.

    Examples
    --------
    >>> from saltation.effects.weight import Weight
    >>> push: Force = Weight(0.0, 30.0)
    >>> push.force(Situation(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    (0.0, 0.0, -30.0)
    """

    def force(self, s: Situation) -> Triple:
        """Force on a grain in this situation.

        Parameters
        ----------
        s : Situation

        Returns
        -------
        (float, float, float), dimensionless
            x, y, z, in the unit of thesis (3-1): times α it is an acceleration in V²/d.
        """
        ...


class Torque(Protocol):
    """What an effect that turns the grain has.

    Examples
    --------
    >>> turn: Torque = NoTorque(0.0)
    >>> turn.torque(Situation(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0))
    (0.0, 0.0, 0.0)
    """

    def torque(self, s: Situation) -> Triple:
        """Rate of change of the spin of a grain in this situation.

        Parameters
        ----------
        s : Situation

        Returns
        -------
        (float, float, float), (V/d)²
            About x, y, z.
        """
        ...


class NoTorque(NamedTuple):
    """The spin changes at contacts only.

    Attributes
    ----------
    nothing : float, dimensionless
        0: a tuple that is compiled cannot be empty.

    Examples
    --------
    >>> NoTorque(0.0).torque(Situation(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0))
    (0.0, 0.0, 0.0)
    """

    nothing: float

    def torque(self, s: Situation) -> Triple:
        """Zero."""
        return 0.0, 0.0, 0.0


force = method("force", 1)
torque = method("torque", 1)


def total_force(effects: tuple[Any, ...], s: Situation) -> Triple:
    """Sum of the forces of a tuple of effects.

    Parameters
    ----------
    effects : tuple of Force
    s : Situation

    Returns
    -------
    (float, float, float), dimensionless
        x, y, z, in the unit of thesis (3-1).

    Examples
    --------
    >>> from saltation.effects.weight import Weight
    >>> total_force((Weight(1.0, 30.0), Weight(0.5, 0.0)), Situation(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    (1.5, 0.0, -30.0)
    """
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
