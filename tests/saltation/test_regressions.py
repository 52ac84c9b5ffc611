"""Published regressions against their table of values, and bed-load formulas against their closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from all_cases import each

from saltation.grain import critical_shields
from saltation.regressions import REGRESSIONS, bed_load, envelope, meyer_peter_mueller, wong_parker

NAMES = ("lee_hsu_1994", "sklar_dietrich_2004", "van_rijn_1984")
TABLE = {  # (R_p, T): H/d, L/d, ū/u* of each, evaluated apart from this code
    (73, 1.79): ("1.73/10.9/6.09", "1.28/6.5/5.69", "1.97/13.5/5.42"),
    (73, 1.87): ("1.83/11.7/6.19", "1.34/7.1/5.88", "2.07/14.7/5.62"),
    (73, 2.43): ("2.44/17.4/6.75", "1.72/11.0/6.81", "2.66/23.0/6.64"),
    (73, 2.50): ("2.51/18.0/6.81", "1.76/11.4/6.89", "2.72/24.0/6.74"),
    (73, 2.67): ("2.67/19.6/6.94", "1.86/12.6/7.08", "2.87/26.5/6.95"),
    (250, 2.31): ("2.60/19.0/6.88", "1.65/10.1/6.01", "4.52/34.8/5.84"),
    (250, 3.08): ("3.39/27.4/7.46", "2.08/15.2/6.75", "5.69/52.8/6.68"),
    (250, 3.85): ("4.07/35.1/7.88", "2.43/20.1/7.20", "6.66/70.1/7.22"),
}
CASES = [(name, rp, stage, row[i]) for (rp, stage), row in TABLE.items() for i, name in enumerate(NAMES)]


class TestRegressions:
    @each("name, rp, stage, printed", CASES)
    def test_the_table_to_its_last_digit(self, name, rp, stage, printed):
        height, length, speed = REGRESSIONS[name](rp, stage)
        assert f"{height:.2f}/{length:.1f}/{speed:.2f}" == printed

    def test_the_registry_names_its_sources(self):
        assert tuple(REGRESSIONS) == NAMES
        for name, regression in REGRESSIONS.items():
            assert regression.name == name
            assert name[-4:] in regression.source
            with pytest.raises(dataclasses.FrozenInstanceError):
                regression.name = "other"

    @each("regression", REGRESSIONS.values())
    def test_arrays_elementwise(self, regression):
        rp, stage = np.array([[73.0], [250.0], [1000.0]]), np.array([0.0, 0.5, 1.0, 1.5, 4.0])
        whole = regression(rp, stage)
        assert [quantity.shape for quantity in whole] == [(3, 5)] * 3
        for i, j in np.ndindex(3, 5):
            assert np.allclose([quantity[i, j] for quantity in whole], regression(float(rp[i, 0]), float(stage[j])), rtol=1e-14)

    @each("regression", REGRESSIONS.values())
    def test_nothing_jumps_at_and_below_the_threshold(self, regression):
        assert np.array_equal(regression(73.0, [0.0, 0.3, 1.0]), np.zeros((3, 3)))
        assert all(quantity > 0.0 for quantity in regression(73.0, 1.001))

    @each(
        "name, powers",
        [("lee_hsu_1994", (0.575, 0.788, 0.174)), ("sklar_dietrich_2004", (0.5, 0.88, 0.56)), ("van_rijn_1984", (0.5, 0.9, 0.6))],
    )
    def test_powers_of_the_excess(self, name, powers):
        """Eight times the excess T − 1; two of the speeds are in √(R g d), and u*/√(R g d) = √τ*."""
        one, eight = (np.array(REGRESSIONS[name](120.0, stage)) for stage in (1.5, 5.0))
        expected = 8.0 ** np.array(powers)
        if name != "lee_hsu_1994":
            expected[2] *= math.sqrt(1.5 / 5.0)
        assert np.allclose(eight / one, expected, rtol=1e-13)

    def test_lee_and_hsu_see_the_excess_stress_alone(self):
        excess = 0.05
        jumps = [REGRESSIONS["lee_hsu_1994"](rp, 1.0 + excess / critical_shields(rp)) for rp in (60.0, 250.0)]
        assert np.allclose(jumps[0], jumps[1], rtol=1e-13)

    def test_envelope(self):
        rp, stage = np.array([[73.0], [250.0]]), np.array([0.9, 1.87, 3.08])
        bounds = envelope(rp, stage)
        assert list(bounds) == ["height", "length", "speed"]
        for i, (low, high) in enumerate(bounds.values()):
            three = np.stack([regression(rp, stage)[i] for regression in REGRESSIONS.values()])
            assert np.array_equal(low, three.min(axis=0))
            assert np.array_equal(high, three.max(axis=0))

    def test_the_threshold_used(self):
        assert round(critical_shields(73.0), 4) == 0.0323
        assert round(critical_shields(250.0), 4) == 0.0394

    @each(
        "rp, stage, error, sentence",
        [
            ("73", 2.0, TypeError, r"particle_reynolds must be an array of real numbers, got '73'"),
            (True, 2.0, TypeError, r"particle_reynolds must be an array of real numbers, got True"),
            (73.0, None, TypeError, r"transport_stage must be an array of real numbers, got None"),
            (73.0, [[1.0], [1.0, 2.0]], TypeError, r"transport_stage must be .* equal rows"),
            (0.0, 2.0, ValueError, r"particle_reynolds must be greater than 0, got 0"),
            (73.0, -1.0, ValueError, r"transport_stage must be 0 or greater, got -1"),
            (math.nan, 2.0, ValueError, r"particle_reynolds must be finite, got nan"),
            (73.0, [2.0, math.inf], ValueError, r"transport_stage must be finite, got inf at position 1"),
            ([1.0, 2.0], [1.0, 2.0, 3.0], ValueError, r"must have shapes that broadcast, got \(2,\) and \(3,\)"),
        ],
    )
    def test_refused(self, rp, stage, error, sentence):
        for function in (*REGRESSIONS.values(), envelope):
            with pytest.raises(error, match=sentence):
                function(rp, stage)


class TestBedLoad:
    def test_closed_forms(self):
        assert meyer_peter_mueller(0.047 + 0.01) == pytest.approx(8e-3, rel=1e-12)
        assert wong_parker(0.0495 + 0.01) == pytest.approx(3.97e-3, rel=1e-12)
        assert np.array_equal(meyer_peter_mueller([0.0, 0.047]), [0.0, 0.0])
        assert np.array_equal(wong_parker([0.0, 0.0495]), [0.0, 0.0])
        assert round(float(meyer_peter_mueller(1.87 * critical_shields(73.0))), 3) == 0.012

    def test_the_balance_of_stresses_in_units(self):
        """q = G ū with the weight G of grains per area whose drag μ_d (ρ_s − ρ) g G on the bed is τ − τ_c."""
        water, quartz, gravity, diameter = 1000.0, 2650.0, 9.81, 0.69e-3
        weight = (quartz - water) * gravity
        stress, critical, shear_velocity, speed, friction = 0.8, 0.35, math.sqrt(0.8 / water), 5.5, 0.65
        rate = (stress - critical) / (friction * weight) * speed * shear_velocity  # m²/s
        einstein = rate / math.sqrt(weight / water * diameter**3)
        unit = weight * diameter
        assert bed_load(stress / unit, critical / unit, speed, friction) == pytest.approx(einstein, rel=1e-12)

    def test_elementwise_and_zero_below_the_threshold(self):
        tau = np.array([[0.01], [0.04], [0.08]])
        rate = bed_load(tau, 0.04, [5.0, 6.0], 0.65)
        assert rate.shape == (3, 2)
        assert np.array_equal(rate[:2], np.zeros((2, 2)))
        assert rate[2, 1] == bed_load(0.08, 0.04, 6.0, 0.65) > 0.0

    def test_refused(self):
        with pytest.raises(ValueError, match="friction must be greater than 0, got 0"):
            bed_load(0.06, 0.03, 5.0, 0.0)
        with pytest.raises(ValueError, match=r"critical must be greater than 0, got -0.1"):
            bed_load(0.06, [0.03, -0.1], 5.0, 0.65)
        with pytest.raises(ValueError, match="speed must be finite, got nan"):
            bed_load(0.06, 0.03, math.nan, 0.65)
        with pytest.raises(ValueError, match=r"broadcast, got \(2,\), \(3,\), \(\), \(\)"):
            bed_load([0.1, 0.2], [0.1, 0.2, 0.3], 5.0, 0.65)
        for formula in (meyer_peter_mueller, wong_parker):
            with pytest.raises(ValueError, match=r"shields must be 0 or greater, got -0.06"):
                formula(-0.06)
            with pytest.raises(TypeError, match="shields must be an array of real numbers, got 'sand'"):
                formula("sand")
