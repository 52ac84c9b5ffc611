"""Rebounds from a bed plane: one small class each, `strike(normal, velocity, spin)` -> velocity and spin after, impulse.

`tsuji` is the hard-sphere law of `contact.py`; `garcia_nino` the 2-D law of thesis appendix 3-A (its f is the tangential
velocity that is *kept*, not Coulomb's friction). `tsuji_printed` is appendix 3-B letter by letter and `sliding_only`
thesis 4-7 to 4-12 without the sticking limit: both can gain energy and are here to show it.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from basset._compile import method
from saltation.bed.contact import Struck, strike_bed
from saltation.closures import Closure
from saltation.grain import Triple

CLOSURES = {  # of the restitution
    "set1": Closure({"restitution": "set1"}, 1994, "Niño, García & Ayala (1994), Water Resour. Res. 30, 1907", {"T": (1.0, 3.0)}),
    "set2": Closure({"restitution": 0.65}, 2001, "Schmeeckle, Nelson, Pitlick & Bennett (2001), Water Resour. Res. 37, 2377", {"St": (105.0, math.inf)}),
    "gondret": Closure({"restitution": "stokes"}, 2002, "Gondret, Lance & Petit (2002), Phys. Fluids 14, 643", {"St": (10.0, 3000.0)}),
}


class Restitution(NamedTuple):
    """e = dry·exp(−damping/St), St = stokes·V_n the collision Stokes number.

    For `stokes` dry = 0.97, and damping = 35 is the fit to Gondret, Lance & Petit (2002), Phys. Fluids 14, 643.
    """

    dry: float  # e at large St
    damping: float  # 0: e is constant
    stokes: float  # St at a normal speed of V

    def at(self, speed: float) -> float:
        """Restitution at a normal impact speed, V; 0 where nothing closes."""
        if not self.damping > 0.0:
            return self.dry
        number = self.stokes * speed
        return self.dry * math.exp(-self.damping / number) if number > 0.0 else 0.0


restitution_at = method("at", 1)


class Rebound(Protocol):
    """What a law of rebounds has."""

    def strike(self, n: Triple, u: Triple, o: Triple) -> Struck:
        """Velocity (V) and spin (V/d) after the contact and the impulse on the grain per dry mass (V), three numbers each.

        n: unit normal of the contact plane, into the water; u, o: velocity and spin before.
        """
        ...


class Tsuji(NamedTuple):
    """Hard sphere with restitution, Coulomb friction and sticking. Tsuji et al. (1985); Crowe et al. (2011)."""

    restitution: Restitution
    friction: float  # Coulomb's f
    added: float  # effective over dry mass, see `strike_bed`

    def strike(self, n: Triple, u: Triple, o: Triple) -> Struck:
        """After the contact."""
        e = restitution_at(self.restitution, -(u[0] * n[0] + u[1] * n[1] + u[2] * n[2]))
        return strike_bed(n[0], n[1], n[2], u[0], u[1], u[2], o[0], o[1], o[2], e, self.friction, self.added)


class GarciaNino(NamedTuple):
    """u_n → −e u_n, u_t → f u_t; the spin is left alone. García & Niño (1992), thesis (3A-1)."""

    restitution: Restitution
    retention: float  # share f of the tangential velocity that is kept

    def strike(self, n: Triple, u: Triple, o: Triple) -> Struck:
        """After the contact."""
        normal = u[0] * n[0] + u[1] * n[1] + u[2] * n[2]
        gain, loss = -(1.0 + restitution_at(self.restitution, -normal)) * normal, 1.0 - self.retention
        x = gain * n[0] - loss * (u[0] - normal * n[0])
        y = gain * n[1] - loss * (u[1] - normal * n[1])
        z = gain * n[2] - loss * (u[2] - normal * n[2])
        return u[0] + x, u[1] + y, u[2] + z, o[0], o[1], o[2], x, y, z


class SlidingOnly(NamedTuple):
    """Coulomb friction without the sticking limit, thesis (4-7) to (4-12) as printed."""

    restitution: Restitution
    friction: float  # Coulomb's f

    def strike(self, n: Triple, u: Triple, o: Triple) -> Struck:
        """After the contact."""
        normal = u[0] * n[0] + u[1] * n[1] + u[2] * n[2]
        e = restitution_at(self.restitution, -normal)
        x, y, z = u[0] - normal * n[0], u[1] - normal * n[1], u[2] - normal * n[2]
        x += 0.5 * (o[2] * n[1] - o[1] * n[2])
        y += 0.5 * (o[0] * n[2] - o[2] * n[0])
        z += 0.5 * (o[1] * n[0] - o[0] * n[1])
        slip = max(math.sqrt(x * x + y * y + z * z), 1e-300)
        push, drag = -(1.0 + e) * normal, self.friction * (1.0 + e) * normal / slip
        x, y, z = push * n[0] + drag * x, push * n[1] + drag * y, push * n[2] + drag * z
        tx, ty, tz = n[2] * y - n[1] * z, n[0] * z - n[2] * x, n[1] * x - n[0] * y
        return u[0] + x, u[1] + y, u[2] + z, o[0] + 5.0 * tx, o[1] + 5.0 * ty, o[2] + 5.0 * tz, x, y, z


class TsujiPrinted(NamedTuple):
    """Thesis (3B-1) to (3B-5) letter by letter, in the frame of the contact plane."""

    restitution: Restitution
    friction: float  # Coulomb's f

    def strike(self, n: Triple, u: Triple, o: Triple) -> Struck:
        """After the contact."""
        # axes of the plane: one along the stream, one across, both tangential
        length = math.sqrt(n[0] * n[0] + n[2] * n[2])
        ax, az = n[2] / length, -n[0] / length
        bx, by, bz = n[1] * az, n[2] * ax - n[0] * az, -n[1] * ax
        along, across = u[0] * ax + u[2] * az, u[0] * bx + u[1] * by + u[2] * bz
        normal = u[0] * n[0] + u[1] * n[1] + u[2] * n[2]
        spin_x, spin_y = o[0] * ax + o[2] * az, o[0] * bx + o[1] * by + o[2] * bz
        spin_z = o[0] * n[0] + o[1] * n[1] + o[2] * n[2]
        e, f, a = restitution_at(self.restitution, -normal), self.friction, 0.5
        speed = math.sqrt(along * along + across * across + normal * normal)
        if 7.0 * f * (e + 1.0) * normal < -2.0 * speed:  # (3B-1) without its division by f
            x, y = 5.0 / 7.0 * (along - 0.4 * a * spin_y), 5.0 / 7.0 * (across - 0.4 * a * spin_x)
            turn_x, turn_y = across / a, -along / a
        else:
            one, two = (along + a * spin_y) / speed, (across + a * spin_x) / speed
            x, y = along + one * f * (e + 1.0) * normal, across + two * f * (e + 1.0) * normal
            turn_x, turn_y = spin_x - 2.5 / a * two * f * (e + 1.0) * normal, spin_y + 2.5 / a * one * f * (e + 1.0) * normal
        z = -e * normal
        px, py, pz = x * ax + y * bx + z * n[0], y * by + z * n[1], x * az + y * bz + z * n[2]
        qx, qy, qz = turn_x * ax + turn_y * bx + spin_z * n[0], turn_y * by + spin_z * n[1], turn_x * az + turn_y * bz + spin_z * n[2]
        return px, py, pz, qx, qy, qz, px - u[0], py - u[1], pz - u[2]


strike = method("strike", 3)

REBOUNDS = {
    "tsuji": "hard sphere with Coulomb friction and sticking",
    "garcia_nino": "restitution and tangential retention; the spin is left alone",
    "tsuji_printed": "thesis appendix 3-B as printed (gains energy)",
    "sliding_only": "thesis 4-7 to 4-12 as printed: no sticking limit (gains energy)",
}
