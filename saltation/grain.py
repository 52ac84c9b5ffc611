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
    """Critical Shields parameter τ*c at R_p = √(R g d³)/ν: Parker's fit to Shields' curve as in the thesis (4-13), with R_p, not Re_p."""
    power = particle_reynolds**-0.6
    value = 0.22 * power + 0.06 * math.e ** (-17.77 * power)
    return float(value) if isinstance(value, float) else value


@dataclass(frozen=True)
class Numbers:
    """Dimensionless numbers of one scene."""

    diameter: float  # m, the unit of length
    velocity: float  # m/s, the unit of velocity; time is in diameter/velocity
    density_ratio: float  # ρ_s/ρ
    particle_reynolds: float  # R_p = √(|R| g d³)/ν, R = ρ_s/ρ − 1
    reynolds: float  # Re* = V d/ν
    shields: float  # τ* = V²/(R g d); in still water ±1, the sign of R
    critical_shields: float  # τ*c, thesis (4-13)
    stage: float | None  # T = τ*/τ*c; None in still water
    added_mass: float  # C_m, 0 where added mass is not among the effects
    slope: float  # radians

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
        """A unit such as d/u* as it is called here: still water has no u*, its V takes that place."""
        return name if self.stage is not None else name.replace("u*", "V")

    def stokes(self, speed: float) -> float:
        """Collision Stokes number ρ_s d V_n/(9 μ) of a normal impact speed V_n, V."""
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
    """The dimensionless numbers of a grain in a fluid: densities in kg/m³, viscosity m²/s, diameter m, shear velocity m/s or T, slope in radians, C_m.

    Neither shear velocity nor T: still water. ValueError if there is no velocity scale because grain and fluid weigh the same.

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
