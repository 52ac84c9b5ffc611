"""The grain in its fluid: the dimensionless numbers that decide what it does.

Lengths are in grain diameters d, velocities in V, times in d/V: V is the shear velocity u* where there is a stream, and
√(|R| g d) in still water.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

GRAVITY = 9.81  # m/s²
Triple = tuple[float, float, float]  # x, y, z


def critical_shields(particle_reynolds: float) -> float:
    """Critical Shields parameter τ*c at the explicit particle Reynolds number R_p = √(R g d³)/ν.

    Parameters
    ----------
    particle_reynolds : float or ndarray (...), dimensionless

    Returns
    -------
    float or ndarray (...), dimensionless

    References
    ----------
    Parker's fit to Shields' curve as in the thesis (4-13), with R_p, not Re_p.

    Examples
    --------
    >>> round(critical_shields(73.0), 4), round(critical_shields(250.0), 4)
    (0.0323, 0.0394)
    """
    power = particle_reynolds**-0.6
    return float(0.22 * power + 0.06 * math.e ** (-17.77 * power)) if isinstance(power, float) else 0.22 * power + 0.06 * math.e ** (-17.77 * power)


@dataclass(frozen=True)
class Numbers:
    """Dimensionless numbers of one scene.

    Attributes
    ----------
    diameter, velocity : float, m and m/s
        The units of length and velocity; time is in diameter/velocity.
    density_ratio : float, dimensionless
        ρ_s/ρ.
    particle_reynolds : float, dimensionless
        R_p = √(|R| g d³)/ν, R = ρ_s/ρ − 1.
    reynolds : float, dimensionless
        Re* = V d/ν.
    shields : float, dimensionless
        τ* = V²/(R g d); in still water ±1, the sign of R.
    critical_shields : float, dimensionless
        τ*c, thesis (4-13).
    stage : float, dimensionless, or None
        T = τ*/τ*c; None in still water.
    added_mass : float, dimensionless
        C_m, 0 where added mass is not among the effects.
    slope : float, radians
        Angle of the bed.

    Examples
    --------
    >>> n = numbers_of(1000.0, 1e-6, 2000.0, 1e-3, shear_velocity=0.1, added_mass=0.5)
    >>> round(n.reynolds, 9), n.time, n.alpha
    (100.0, 0.01, 0.4)
    >>> round(n.stokes(9.0), 9)
    200.0
    """

    diameter: float
    velocity: float
    density_ratio: float
    particle_reynolds: float
    reynolds: float
    shields: float
    critical_shields: float
    stage: float | None
    added_mass: float
    slope: float

    @property
    def time(self) -> float:
        """d/V in seconds."""
        return self.diameter / self.velocity

    @property
    def alpha(self) -> float:
        """α = 1/(1 + R + C_m), dimensionless, thesis (3-1)."""
        return 1.0 / (self.density_ratio + self.added_mass)

    @property
    def history(self) -> float:
        """Coefficient c = 9α/√(π Re*) of the history integral in (d/V)^(-1/2), thesis (3-1)."""
        return 9.0 * self.alpha / math.sqrt(math.pi * self.reynolds)

    @property
    def scale(self) -> str:
        """What V is."""
        return "u*, the shear velocity" if self.stage is not None else "V = √(|R| g d)"

    def unit(self, name: str) -> str:
        """A unit as it is called here: still water has no u*.

        Parameters
        ----------
        name : str
            The unit where there is a stream, such as d/u*.

        Returns
        -------
        str
            The same, or with V in place of u*.

        Examples
        --------
        >>> numbers_of(1000.0, 1e-6, 2650.0, 1e-3).unit("d/u*")
        'd/V'
        """
        return name if self.stage is not None else name.replace("u*", "V")

    def stokes(self, speed: float) -> float:
        """Collision Stokes number ρ_s d V_n/(9 μ).

        Parameters
        ----------
        speed : float, V
            V_n, the normal impact speed.

        Returns
        -------
        float, dimensionless
        """
        return self.density_ratio * self.reynolds * speed / 9.0


def numbers_of(
    fluid_density: float,
    viscosity: float,
    density: float,
    diameter: float,
    *,
    shear_velocity: float | None = None,
    transport_stage: float | None = None,
    slope: float = 0.0,
    added_mass: float = 0.5,
) -> Numbers:
    """The dimensionless numbers of a grain in a fluid.

    Parameters
    ----------
    fluid_density, density : float, kg/m³
    viscosity : float, m²/s
        Kinematic.
    diameter : float, m
    shear_velocity : float, m/s, or None
        u*.
    transport_stage : float, dimensionless, or None
        T = τ*/τ*c, in place of u*; neither: still water.
    slope : float, radians
    added_mass : float, dimensionless
        C_m.

    Returns
    -------
    Numbers

    Raises
    ------
    ValueError
        If a stream or still water has no velocity scale because grain and fluid weigh the same.

    Examples
    --------
    >>> round(numbers_of(1000.0, 1e-6, 2650.0, 0.69e-3, transport_stage=1.87).particle_reynolds, 1)
    72.9
    """
    excess = density / fluid_density - 1.0
    unit = math.sqrt(abs(excess) * GRAVITY * diameter)
    particle = unit * diameter / viscosity
    if excess == 0.0 and (shear_velocity is None):
        raise ValueError(f"density of the grain must differ from the fluid's unless shear_velocity is given, got {density:g} kg/m3 for both")
    critical = critical_shields(particle) if particle > 0.0 else math.inf
    velocity = unit if shear_velocity is None else shear_velocity
    if transport_stage is not None:
        velocity = unit * math.sqrt(transport_stage * critical)
    shields = velocity**2 / (excess * GRAVITY * diameter) if excess else math.inf
    streams = shear_velocity is not None or transport_stage is not None
    stage = abs(shields) / critical if streams else None
    reynolds = velocity * diameter / viscosity
    return Numbers(diameter, velocity, density / fluid_density, particle, reynolds, shields, critical, stage, added_mass, slope)
