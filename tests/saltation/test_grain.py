"""The dimensionless numbers against each other and against units."""

from __future__ import annotations

import math

import numpy as np
import pytest

from saltation.grain import GRAVITY, Numbers, critical_shields, numbers_of

WATER, NU, QUARTZ = 1000.0, 1e-6, 2650.0
CASES = [(d, stage) for d in (0.35e-3, 0.69e-3, 1.57e-3, 8e-3) for stage in (1.0, 1.87, 3.08)]


def size_of(particle_reynolds):
    """Diameter of a quartz grain of that R_p in water."""
    return (particle_reynolds * NU) ** (2.0 / 3.0) / (1.65 * GRAVITY) ** (1.0 / 3.0)


class TestCriticalShields:
    def test_the_two_sands(self):
        assert round(critical_shields(73.0), 4) == 0.0323
        assert round(critical_shields(250.0), 4) == 0.0394

    def test_its_limits(self):
        """0.06 for gravel, a power law for silt, the lowest between R_p 40 and 70."""
        assert critical_shields(1e9) == pytest.approx(0.06, rel=1e-4)
        assert critical_shields(0.01) == pytest.approx(0.22 * 0.01**-0.6, rel=1e-9)
        rp = np.geomspace(1.0, 1e5, 2000)
        lowest = rp[np.argmin(critical_shields(rp))]
        assert 40.0 < lowest < 70.0
        assert 0.0315 < critical_shields(float(lowest)) < 0.032

    def test_arrays_and_numbers(self):
        rp = np.array([[1.0, 73.0], [250.0, 1e4]])
        assert np.allclose(critical_shields(rp), [[critical_shields(float(x)) for x in row] for row in rp], rtol=1e-14)
        assert type(critical_shields(73)) is float
        assert type(critical_shields(np.float64(73.0))) is float


class TestNumbers:
    def test_the_two_sands(self):
        """R_p 73 is quartz of 0.69 mm in water and 250 is 1.57 mm."""
        assert round(numbers_of(WATER, NU, QUARTZ, 0.69e-3, transport_stage=2.0).particle_reynolds) == 73
        assert round(numbers_of(WATER, NU, QUARTZ, 1.57e-3, transport_stage=2.0).particle_reynolds) == 250
        assert round(size_of(73.0) * 1e3, 2) == 0.69
        assert round(size_of(250.0) * 1e3, 2) == 1.57

    @pytest.mark.parametrize(("d", "stage"), CASES)
    def test_they_hang_together(self, d, stage):
        n = numbers_of(WATER, NU, QUARTZ, d, transport_stage=stage)
        assert n.density_ratio == 2.65
        assert n.particle_reynolds == pytest.approx(math.sqrt(1.65 * 9.81 * d**3) / NU, rel=1e-14)
        assert n.shields == pytest.approx(stage * critical_shields(n.particle_reynolds), rel=1e-13)
        assert n.shields == pytest.approx(n.velocity**2 / (1.65 * 9.81 * d), rel=1e-13)
        assert n.stage == pytest.approx(stage, rel=1e-13)
        assert n.reynolds == pytest.approx(n.velocity * d / NU, rel=1e-14)
        assert n.reynolds == pytest.approx(math.sqrt(n.shields) * n.particle_reynolds, rel=1e-13)
        assert n.time == pytest.approx(d / n.velocity, rel=1e-15)
        assert n.alpha == pytest.approx(1.0 / (1.0 + 1.65 + 0.5), rel=1e-15)

    @pytest.mark.parametrize(("d", "stage"), CASES)
    def test_the_coefficient_of_the_history_in_both_spellings(self, d, stage):
        """c = 9α/√(π Re*) = 9α/(√(π R_p) τ*^¼)."""
        n = numbers_of(WATER, NU, QUARTZ, d, transport_stage=stage)
        assert n.history == pytest.approx(9.0 * n.alpha / (math.sqrt(math.pi * n.particle_reynolds) * n.shields**0.25), rel=1e-13)

    def test_the_coefficient_of_the_history_in_newtons(self):
        """6 a² √(πρμ) ∫ u̇/√(t − τ) dτ over the mass and added mass, in units of d and V."""
        n = numbers_of(WATER, NU, QUARTZ, 1e-3, shear_velocity=0.05)
        a, mass = 0.5e-3, 4.0 / 3.0 * math.pi * 0.5e-3**3 * (QUARTZ + 0.5 * WATER)
        per_mass = 6.0 * a**2 * math.sqrt(math.pi * WATER * WATER * NU) / mass  # of slip per √time
        assert n.history == pytest.approx(per_mass * math.sqrt(n.time), rel=1e-13)

    def test_shear_velocity_and_stage_say_the_same(self):
        by_stage = numbers_of(WATER, NU, QUARTZ, 0.69e-3, transport_stage=2.5)
        by_speed = numbers_of(WATER, NU, QUARTZ, 0.69e-3, shear_velocity=by_stage.velocity)
        for name in ("velocity", "reynolds", "shields", "stage", "particle_reynolds"):
            assert getattr(by_speed, name) == pytest.approx(getattr(by_stage, name), rel=1e-13)

    def test_collision_stokes(self):
        """ρ_s d V_n/(9μ); 22 to 30 for impacts of sand at R_p 73."""
        n = numbers_of(WATER, NU, QUARTZ, 0.69e-3, transport_stage=1.87)
        speed = 3.0
        assert n.stokes(speed) == pytest.approx(QUARTZ * 0.69e-3 * speed * n.velocity / (9.0 * WATER * NU), rel=1e-13)
        assert n.stokes(2.0 * speed) == pytest.approx(2.0 * n.stokes(speed), rel=1e-15)
        assert 22.0 < n.stokes(5.0) < 30.0

    def test_slope_and_added_mass_are_kept(self):
        n = numbers_of(WATER, NU, QUARTZ, 0.69e-3, transport_stage=2.0, slope=0.1, added_mass=0.0)
        assert (n.slope, n.added_mass) == (0.1, 0.0)
        assert n.alpha == pytest.approx(1.0 / 2.65, rel=1e-15)

    def test_frozen(self):
        with pytest.raises(AttributeError):
            numbers_of(WATER, NU, QUARTZ, 1e-3).shields = 1.0


class TestStillWater:
    def test_units(self):
        """V = √(R g d): Re* is R_p and τ* is 1; there is no stage."""
        n = numbers_of(WATER, NU, QUARTZ, 1e-3)
        assert n.velocity == pytest.approx(math.sqrt(1.65 * 9.81 * 1e-3), rel=1e-14)
        assert n.reynolds == pytest.approx(n.particle_reynolds, rel=1e-14)
        assert n.shields == pytest.approx(1.0, rel=1e-14)
        assert n.stage is None

    def test_a_light_grain_rises(self):
        n = numbers_of(WATER, NU, 500.0, 1e-3)
        assert n.shields == pytest.approx(-1.0, rel=1e-14)
        assert n.velocity == pytest.approx(math.sqrt(0.5 * 9.81 * 1e-3), rel=1e-14)
        assert n.alpha == 1.0

    def test_a_light_grain_in_a_stream(self):
        n = numbers_of(WATER, NU, 500.0, 1e-3, shear_velocity=0.03)
        assert n.shields == pytest.approx(-(0.03**2) / (0.5 * 9.81 * 1e-3), rel=1e-13)
        assert n.stage == pytest.approx(-n.shields / n.critical_shields, rel=1e-13)


class TestNeutral:
    @pytest.mark.parametrize("stage", [None, 2.0])
    def test_without_weight_there_is_no_scale(self, stage):
        with pytest.raises(ValueError, match=r"density of the grain must differ from the fluid's unless shear_velocity is given, got 1000 kg/m3 for both"):
            numbers_of(WATER, NU, 1000.0, 1e-3, transport_stage=stage)

    def test_in_a_stream_it_weighs_nothing(self):
        n = numbers_of(WATER, NU, 1000.0, 1e-3, shear_velocity=0.03)
        assert isinstance(n, Numbers)
        assert 1.0 / n.shields == 0.0
        assert n.reynolds == pytest.approx(30.0, rel=1e-14)
        assert n.alpha == pytest.approx(1.0 / 1.5, rel=1e-15)
