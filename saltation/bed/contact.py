"""One hard-sphere law for bed and pairs: restitution along the normal, Coulomb friction or sticking along the tangent.

With n from the grain to the contact, V = u_i − u_j + (a_i ω_i + a_j ω_j) × n the contact slip, m_e = m_i m_j/(m_i + m_j):
J_n = (1 + e) m_e V·n, |J_t| = min(f J_n, m_t |V_t|), J = −J_n n − |J_t| V_t/|V_t| on the grain, −J on the other;
u_i += J/m_i, ω_i += (a_i/I_i) n × J for both. For solid spheres of any size 1/m_t = 1/m_e + (5/2)/m_dry, that is
m_t = (2/7) m_e; immersed contact adds the added mass to m_e, not to the moment of inertia.

Source: Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5, with the sticking limit that thesis 4-7 to
4-12 leave out; thesis appendix 3-B is the case of a bed, its signs corrected.
"""

from __future__ import annotations

import math

from basset._compile import shared
from saltation.grain import Triple

__all__ = ["impulse", "strike_bed", "strike_pair"]

Struck = tuple[float, float, float, float, float, float, float, float, float]  # velocity and spin after, impulse


@shared
def impulse(
    nx: float, ny: float, nz: float, vx: float, vy: float, vz: float, restitution: float, friction: float, mass: float, tangential_mass: float
) -> Triple:
    """Impulse J (V × dry mass) on the grain, zero where the surfaces separate; n: unit normal from the grain to the contact, v: contact slip (V).

    e and Coulomb's f; m_e and m_t in dry masses. Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5.
    """
    normal = vx * nx + vy * ny + vz * nz
    if not normal > 0.0:
        return 0.0, 0.0, 0.0
    strength = (1.0 + restitution) * mass * normal
    tx, ty, tz = vx - normal * nx, vy - normal * ny, vz - normal * nz
    slip = math.sqrt(tx * tx + ty * ty + tz * tz)
    share = tangential_mass  # sticking: the whole tangential slip is taken out
    if friction * strength < tangential_mass * slip:
        share = friction * strength / slip
    return -strength * nx - share * tx, -strength * ny - share * ty, -strength * nz - share * tz


@shared
def cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Triple:
    """Vector product a × b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@shared
def strike_bed(
    nx: float, ny: float, nz: float, ux: float, uy: float, uz: float, ox: float, oy: float, oz: float, restitution: float, friction: float, added: float
) -> Struck:
    """A grain against the bed: velocity (V) and spin (V/d) after, and the impulse on the grain (V × dry mass), three numbers each.

    n: unit normal into the water; `added`: effective over dry mass, 1, or 1 + C_m/(1 + R) for immersed contact.
    Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5; thesis appendix 3-B, its signs corrected.
    """
    wx, wy, wz = cross(0.5 * ox, 0.5 * oy, 0.5 * oz, -nx, -ny, -nz)
    jx, jy, jz = impulse(-nx, -ny, -nz, ux + wx, uy + wy, uz + wz, restitution, friction, added, added / (1.0 + 2.5 * added))
    tx, ty, tz = cross(-nx, -ny, -nz, jx, jy, jz)
    return ux + jx / added, uy + jy / added, uz + jz / added, ox + 5.0 * tx, oy + 5.0 * ty, oz + 5.0 * tz, jx, jy, jz


@shared
def strike_pair(
    nx: float,
    ny: float,
    nz: float,
    first: Triple,
    second: Triple,
    spin_first: Triple,
    spin_second: Triple,
    radii: tuple[float, float],
    masses: tuple[float, float],
    restitution: float,
    friction: float,
) -> tuple[Triple, Triple, Triple, Triple, Triple]:
    """Two grains in contact: velocities (V) and spins (V/d) of both after, and the impulse on the first (V × dry mass).

    n: unit normal from the first to the second; radii in d, masses in dry masses; the moments of inertia are (2/5) m a².
    Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5.
    """
    mass = masses[0] * masses[1] / (masses[0] + masses[1])
    sx = radii[0] * spin_first[0] + radii[1] * spin_second[0]
    sy = radii[0] * spin_first[1] + radii[1] * spin_second[1]
    sz = radii[0] * spin_first[2] + radii[1] * spin_second[2]
    wx, wy, wz = cross(sx, sy, sz, nx, ny, nz)
    vx, vy, vz = first[0] - second[0] + wx, first[1] - second[1] + wy, first[2] - second[2] + wz
    jx, jy, jz = impulse(nx, ny, nz, vx, vy, vz, restitution, friction, mass, 2.0 / 7.0 * mass)
    tx, ty, tz = cross(nx, ny, nz, jx, jy, jz)
    one, two = 2.5 / (masses[0] * radii[0]), 2.5 / (masses[1] * radii[1])  # a/I
    return (
        (first[0] + jx / masses[0], first[1] + jy / masses[0], first[2] + jz / masses[0]),
        (second[0] - jx / masses[1], second[1] - jy / masses[1], second[2] - jz / masses[1]),
        (spin_first[0] + one * tx, spin_first[1] + one * ty, spin_first[2] + one * tz),
        (spin_second[0] + two * tx, spin_second[1] + two * ty, spin_second[2] + two * tz),
        (jx, jy, jz),
    )
