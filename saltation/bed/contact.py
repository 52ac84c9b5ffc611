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
    """Impulse J on the grain, zero where the surfaces separate.

    Parameters
    ----------
    nx, ny, nz : float, dimensionless
        Unit normal from the grain to the contact.
    vx, vy, vz : float, V
        Contact slip.
    restitution, friction : float, dimensionless
        e and Coulomb's f.
    mass, tangential_mass : float, dry masses
        m_e and m_t; dimensionless.

    Returns
    -------
    (float, float, float), V × dry mass
        x, y, z.

    References
    ----------
    Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5.

    Examples
    --------
    >>> jx, jy, jz = impulse(0.0, 0.0, -1.0, 4.0, 0.0, -2.0, 0.5, 0.1, 1.0, 2.0 / 7.0)
    >>> round(jx, 12), round(jz, 12)  # slides: (1 + e) m V_n up, a tenth of it back
    (-0.3, 3.0)
    >>> impulse(0.0, 0.0, -1.0, 4.0, 0.0, 2.0, 0.5, 0.1, 1.0, 2.0 / 7.0)  # separates
    (0.0, 0.0, 0.0)
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
    """A grain against the bed: velocity and spin after, and the impulse on the grain.

    Parameters
    ----------
    nx, ny, nz : float, dimensionless
        Unit normal into the water.
    ux, uy, uz : float, V
        Velocity before.
    ox, oy, oz : float, V/d
        Spin before.
    restitution, friction : float, dimensionless
        e and Coulomb's f.
    added : float, dimensionless
        Effective over dry mass: 1, or 1 + C_m/(1 + R) for immersed contact. The impulse is in units of the dry mass.

    Returns
    -------
    nine floats
        Velocity (V), spin (V/d), impulse (V × dry mass), three each.

    References
    ----------
    Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5; thesis appendix 3-B, its signs corrected.

    Examples
    --------
    >>> strike_bed(0.0, 0.0, 1.0, 3.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.5, 0.0, 1.0)[:3]  # smooth: only the normal velocity turns
    (3.0, 0.0, 1.0)
    >>> after = strike_bed(0.0, 0.0, 1.0, 3.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.5, 10.0, 1.0)  # rough: it rolls off
    >>> abs(after[0] - 0.5 * after[4]) < 1e-12
    True
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
    """Two grains in contact: velocities and spins after, and the impulse on the first.

    Parameters
    ----------
    nx, ny, nz : float, dimensionless
        Unit normal from the first to the second grain.
    first, second, spin_first, spin_second : (float, float, float)
        Velocities (V) and spins (V/d) before.
    radii, masses : (float, float)
        In d and in dry masses; the moments of inertia are (2/5) m a².
    restitution, friction : float, dimensionless
        e and Coulomb's f.

    Returns
    -------
    five triples
        Velocities (V) and spins (V/d) of the first and the second grain after; impulse on the first (V × dry mass).

    References
    ----------
    Crowe et al. (2011), Multiphase Flows with Droplets and Particles, ch. 5.

    Examples
    --------
    >>> still, half, one = (0.0, 0.0, 0.0), (0.5, 0.5), (1.0, 1.0)
    >>> after = strike_pair(1.0, 0.0, 0.0, (2.0, 0.0, 0.0), still, still, still, half, one, 1.0, 0.0)  # elastic: they swap velocities
    >>> after[0], after[1]
    ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0))
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
