"""The stream: profiles against their formulas in many digits, tables against profiles, limits at the bed and far above it."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from basset._compile import compiled, digest_of
from saltation.flow import CELLS, OCTAVES, PROFILES, REGIMES, VON_KARMAN, profile_of, tabulated, velocity_and_shear, yalin_shift
from saltation.grain import GRAVITY, numbers_of

NAMES = ("reichardt", "swamee", "yalin", "constant_b")
SIZES = (30.0, 73.0, 250.0, 2e3, 2e4)  # R_p
TOP = 2.0 ** OCTAVES[1]


def numbers(particle_reynolds, stage=2.0):
    diameter = (particle_reynolds * 1e-6) ** (2.0 / 3.0) / (1.65 * GRAVITY) ** (1.0 / 3.0)
    return numbers_of(1000.0, 1e-6, 2650.0, diameter, transport_stage=stage)


def formula(name, reynolds, roughness=1.0, kappa=VON_KARMAN):
    """u⁺(z) as published, in mpmath's numbers."""
    k, wall = mpmath.mpf(kappa), mpmath.mpf(reynolds) * mpmath.mpf(roughness)
    shift = mpmath.mpf("8.5")
    if name == "yalin":
        log = mpmath.log(wall)
        shift += (mpmath.mpf("2.5") * log - 3) * mpmath.exp(-mpmath.mpf("0.121") * log ** mpmath.mpf("2.42"))

    def reichardt(z):
        plus = z * reynolds
        return mpmath.log(1 + k * plus) / k + mpmath.mpf("7.8") * (1 - mpmath.exp(-plus / 11) - plus / 11 * mpmath.exp(-mpmath.mpf("0.33") * plus))

    def swamee(z):
        plus, power = z * reynolds, -mpmath.mpf(10) / 3
        turbulent = mpmath.log(1 + 9 * plus / (1 + mpmath.mpf("0.3") * wall)) / k
        return (plus**power + turbulent**power) ** -mpmath.mpf("0.3")

    def law(z):
        return mpmath.log(z / mpmath.mpf(roughness)) / k + shift

    return {"reichardt": reichardt, "swamee": swamee}.get(name, law)


@pytest.mark.parametrize("rp", SIZES)
@pytest.mark.parametrize("name", NAMES)
class TestAgainstTheFormula:
    def test_profile_and_slope(self, name, rp):
        n = numbers(rp)
        profile, u = profile_of(name, n), formula(name, n.reynolds)
        with mpmath.workdps(30):
            for z in np.geomspace(1e-6, 1e4, 15):
                if z <= profile.floor:
                    assert profile.velocity_and_shear(z) == (0.0, 0.0)
                    continue
                velocity, shear = profile.velocity_and_shear(z)
                assert velocity == pytest.approx(float(u(mpmath.mpf(z))), rel=1e-13, abs=1e-14)
                assert shear == pytest.approx(float(mpmath.diff(u, mpmath.mpf(z), h=mpmath.mpf(z) * mpmath.mpf("1e-10"))), rel=2e-13)

    def test_table(self, name, rp):
        """Velocity and shear of the table over ten decades."""
        profile = profile_of(name, numbers(rp))
        table = tabulated(profile)
        heights = np.geomspace(1e-6, 1e4, 1500)
        found, exact = (np.array([p.velocity_and_shear(z) for z in heights]) for p in (table, profile))
        above = heights > profile.floor
        assert not found[~above].any()
        assert np.abs(found[above, 0] / exact[above, 0] - 1.0).max() < 1e-11
        assert np.abs(found[above, 1] / exact[above, 1] - 1.0).max() < 1e-11

    def test_table_between_its_cells(self, name, rp):
        """No step where polynomials meet, nor below the lowest."""
        profile = profile_of(name, numbers(rp))
        table = tabulated(profile)
        for octave in range(*OCTAVES):
            for part in range(CELLS):
                edge = math.ldexp(1.0 + part / CELLS, octave)
                if profile.floor < 0.9 * edge:
                    under, over = table.velocity_and_shear(math.nextafter(edge, 0.0)), table.velocity_and_shear(edge)
                    lowest = octave == OCTAVES[0] and part == 0
                    assert under == pytest.approx(over, rel=1e-3 if lowest else 2e-11)

    def test_faster_with_height_and_bent_forward(self, name, rp):
        table = tabulated(profile_of(name, numbers(rp)))
        heights = np.geomspace(1.01 * max(table.floor, 1e-6), 1e4, 300)
        values = np.array([table.velocity_and_shear(z) for z in heights])
        assert np.all(np.diff(values[:, 0]) > 0.0)
        assert np.all(values[:, 1] > 0.0)

    def test_nothing_flows_at_and_below_the_bed(self, name, rp):
        profile = profile_of(name, numbers(rp))
        for p in (profile, tabulated(profile)):
            for z in (profile.floor, 0.0, -0.0, -1e-9, -0.25, -7.0):
                assert velocity_and_shear(p, z) == (0.0, 0.0)
            assert 0.0 < velocity_and_shear(p, profile.floor + 1e-9)[0] < 1e-4

    def test_beyond_the_table(self, name, rp):
        """A logarithm; and no height that is not a number reads memory that is not the table's."""
        profile = profile_of(name, numbers(rp))
        table = tabulated(profile)
        for z in (math.nextafter(TOP, 0.0), TOP, 2.0 * TOP, 1e3 * TOP):
            assert table.velocity_and_shear(z) == pytest.approx(profile.velocity_and_shear(z), rel=3e-5)
        assert table.velocity_and_shear(math.inf)[0] == math.inf
        assert all(map(math.isnan, table.velocity_and_shear(math.nan)))


class TestLimits:
    @pytest.mark.parametrize("name", ["reichardt", "swamee"])
    def test_viscous_sublayer(self, name):
        """u⁺ = z⁺ over a smooth bed, slope 1 in wall units."""
        n = numbers(73.0)
        profile = profile_of(name, n, roughness=1e-9)
        for plus in (1e-6, 1e-3, 0.1, 1.0):
            velocity, shear = profile.velocity_and_shear(plus / n.reynolds)
            assert velocity == pytest.approx(plus, rel=1e-2 if plus == 1.0 else 1e-3)
            assert shear / n.reynolds == pytest.approx(1.0, rel=2e-2 if plus == 1.0 else 1e-3)

    def test_reichardt_far_up_is_the_smooth_law_of_the_wall(self):
        """ln(z⁺)/κ + 7.8 + ln(κ)/κ: 5.6 with κ = 0.41."""
        n = numbers(73.0)
        z = 1e5 / n.reynolds
        shift = profile_of("reichardt", n).velocity_and_shear(z)[0] - math.log(1e5) / VON_KARMAN
        assert shift == pytest.approx(7.8 + math.log(VON_KARMAN) / VON_KARMAN, abs=1e-3)
        assert shift == pytest.approx(5.5, abs=0.2)

    def test_swamee_far_up_is_smooth_or_rough(self):
        """ln(9 z⁺)/κ over a smooth bed (5.4), ln(30 z/k_s)/κ over a rough one (8.3)."""
        smooth = profile_of("swamee", numbers(73.0), roughness=1e-9)
        assert smooth.velocity_and_shear(1e4)[0] == pytest.approx(math.log(9.0 * 1e4 * numbers(73.0).reynolds) / VON_KARMAN, rel=1e-6)
        rough = profile_of("swamee", numbers(2e6))
        shift = rough.velocity_and_shear(1e3)[0] - math.log(1e3) / VON_KARMAN
        assert shift == pytest.approx(math.log(30.0) / VON_KARMAN, abs=1e-3)
        assert shift == pytest.approx(8.5, abs=0.25)

    def test_swamee_has_a_finite_slope_at_a_rough_bed(self):
        n = numbers(250.0)
        profile = profile_of("swamee", n)
        slope = profile.velocity_and_shear(1e-12)[1]
        ratio = VON_KARMAN / (9.0 / (1.0 + 0.3 * n.reynolds))
        assert slope == pytest.approx(n.reynolds * (1.0 + ratio ** (10.0 / 3.0)) ** -0.3, rel=1e-6)
        assert tabulated(profile).velocity_and_shear(1e-9) == pytest.approx((1e-9 * slope, slope), rel=1e-5)

    def test_yalin_from_smooth_to_rough(self):
        """B = 5.5 + 2.5 ln Re_k over smooth beds, 8.5 over rough ones, a hump of 9.6 between, as Nikuradse measured."""
        assert yalin_shift(1.0) == 5.5
        for wall in (1.001, 1.1, 1.3):
            assert yalin_shift(wall) == pytest.approx(5.5 + 2.5 * math.log(wall), abs=0.02)
        assert yalin_shift(1e4) == pytest.approx(8.5, abs=1e-8)
        assert yalin_shift(70.0) == pytest.approx(8.5, abs=0.2)
        walls = np.geomspace(1.0, 1e4, 500)
        shifts = [yalin_shift(wall) for wall in walls]
        assert max(shifts) == pytest.approx(9.6, abs=0.1)
        assert 6.0 < walls[np.argmax(shifts)] < 15.0

    def test_fully_rough_is_one_law(self):
        n = numbers(2e6)
        for z in (0.1, 1.0, 50.0):
            assert profile_of("yalin", n).velocity_and_shear(z) == pytest.approx(profile_of("constant_b", n).velocity_and_shear(z), rel=1e-12)

    def test_rough_law(self):
        """8.5 at the height of the roughness; nothing below k_s e^(−8.5 κ) = k_s/33."""
        for size in (0.5, 1.0, 2.0):
            profile = profile_of("constant_b", numbers(250.0), roughness=size)
            assert profile.velocity_and_shear(size)[0] == 8.5
            assert profile.floor == pytest.approx(size * math.exp(-8.5 * VON_KARMAN), rel=1e-14)
            assert size / profile.floor == pytest.approx(33.0, abs=0.5)
            assert profile.velocity_and_shear(1.0001 * profile.floor)[0] > 0.0

    def test_kappa(self):
        n = numbers(250.0)
        for name in NAMES:
            slopes = [profile_of(name, n, kappa=kappa).velocity_and_shear(1e4)[1] * 1e4 for kappa in (0.3, 0.41)]
            assert slopes == pytest.approx([1.0 / 0.3, 1.0 / 0.41], rel=1e-3)

    def test_the_choice_moves_the_stream_by_a_fifth(self):
        """At R_p 73 and a height of 1 d the profiles differ by 20 % and more: it has to be named."""
        speeds = [profile_of(name, numbers(73.0)).velocity_and_shear(1.0)[0] for name in ("swamee", "yalin")]
        assert 1.15 < max(speeds) / min(speeds) < 1.5


class TestChoosing:
    def test_regimes(self):
        n = numbers(250.0)
        assert {REGIMES[name] for name in REGIMES} <= set(PROFILES)
        for regime, name in REGIMES.items():
            assert profile_of(regime, n) == profile_of(name, n)
        assert (REGIMES["smooth"], REGIMES["transitional"], REGIMES["rough"]) == ("reichardt", "yalin", "constant_b")

    def test_still_water(self):
        still = profile_of("none", numbers_of(1000.0, 1e-6, 2650.0, 1e-3))
        assert [velocity_and_shear(still, z) for z in (-1.0, 0.0, 3.0)] == [(0.0, 0.0)] * 3

    def test_yalin_is_refused_below_its_range(self):
        with pytest.raises(ValueError, match=r"profile 'yalin' needs a roughness Reynolds number .* of at least 1, got 0.05"):
            yalin_shift(0.05)
        with pytest.raises(ValueError, match="take 'reichardt' or 'swamee'"):
            profile_of("transitional", numbers(30.0), roughness=0.01)

    def test_no_such_profile(self):
        with pytest.raises(ValueError, match=r"profile must be one of none, swamee, .*, got 'yallin'"):
            profile_of("yallin", numbers(73.0))

    def test_one_table_each(self):
        n = numbers(73.0)
        assert tabulated(profile_of("swamee", n)) is tabulated(profile_of("swamee", n))
        assert tabulated(profile_of("swamee", n)).cells != tabulated(profile_of("reichardt", n)).cells


def test_compiled_and_plain_tables_agree():
    sources = digest_of("saltation")

    @compiled()
    def along(profile, heights, out):
        sources  # part of the cache key
        for i in range(len(heights)):
            out[i, 0], out[i, 1] = velocity_and_shear(profile, heights[i])

    heights = np.concatenate([np.geomspace(1e-9, 1e6, 400), [0.0, -1.0, TOP, math.nan]])
    found = np.empty((len(heights), 2))
    for name in NAMES:
        table = tabulated(profile_of(name, numbers(73.0)))
        along(table, heights, found)
        assert np.allclose(found, [table.velocity_and_shear(z) for z in heights.tolist()], rtol=1e-14, atol=1e-15, equal_nan=True)


class TestContinued:
    @pytest.mark.parametrize("name", ["swamee", "reichardt", "constant_b"])
    def test_is_smooth_across_the_floor(self, name):
        """Third differences of the shear across the floor are those just above it; from below there is no stream on either side."""
        table = tabulated(profile_of(name, numbers(73.0)))
        around, above = (np.array([table.continued(table.floor + 1e-3 * (k + first), 1.0)[1] for k in range(5)]) for first in (-2, 1))
        assert np.abs(np.diff(around, 3)).max() <= 4.0 * np.abs(np.diff(above, 3)).max() + 1e-9 * around[2]
        assert table.continued(table.floor + 0.1, -0.2) == table.continued(table.floor - 0.1, 0.0) == (0.0, 0.0)
        assert table.continued(table.floor + 0.1, 0.0) == table.velocity_and_shear(table.floor + 0.1)
