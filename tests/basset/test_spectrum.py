"""Finite-Reynolds kernels as spectra: the ratio against extended precision, the sums against the kernel for every slip."""

from __future__ import annotations

import math
import re

import mpmath
import numpy as np
import pytest

import basset
from basset import ExponentialSum, spectrum
from basset._compile import compiled

FAMILIES = (2.0, 2.5)


def exact(rate: float, c1: float) -> mpmath.mpf:
    """ρ: below 30 the power series of the inverse Laplace transform, above the integral over the cut."""
    bend = mpmath.mpf(3) / (2 * mpmath.mpf(c1))
    if rate > 30.0:
        with mpmath.workdps(22):
            turn = mpmath.expjpi(bend)
            return 2 / mpmath.sqrt(mpmath.pi) * mpmath.quad(lambda v: mpmath.exp(-v * v) * mpmath.re((1 + (v * v / rate) ** bend * turn) ** -c1), [0, 1, 3, 8])
    with mpmath.workdps(45):
        x = mpmath.mpf(rate)
        total, factor, n = mpmath.mpf(0), mpmath.mpf(1), 0
        while True:
            term = factor * x ** (bend * n) / mpmath.gamma(2 + bend * n)
            total += term
            if n > 10 and abs(term) < mpmath.mpf(10) ** -40 * abs(total):
                return mpmath.sqrt(mpmath.pi) * x**1.5 * total
            factor *= -(c1 + n) / mpmath.mpf(n + 1)
            n += 1


def share(s, stretch, c1):
    """K(s; C) of the Basset kernel, stretch = C^(2/3)."""
    return (1.0 + (stretch * s) ** (1.5 / c1)) ** -c1


def values(weights, rates, s):
    return np.exp(-np.outer(s, rates)) @ weights


@compiled()
def tabulated(weights, log_rates, low, inverse_step, ratios, log_stretch, result):
    last = ratios.shape[0] - 1
    for q in range(len(weights)):
        result[q] = weights[q] * spectrum.ratio_at(low, inverse_step, ratios, min(q, last), log_rates[q] - log_stretch)


class TestSpectralRatio:
    @pytest.mark.parametrize("c1", [1.75, *FAMILIES, 10.0])
    def test_against_extended_precision(self, c1):
        rates = np.geomspace(1e-12, 1e12, 41)
        ratios = spectrum.spectral_ratio(rates, c1)
        error = max(abs(float(mpmath.mpf(ratio) / exact(rate, c1) - 1)) for rate, ratio in zip(rates, ratios, strict=True))
        assert error < (6e-14 if c1 in FAMILIES else 1.5e-13)

    def test_where_the_kernel_is_singular_on_the_cut(self):
        """c1 = 3/2, the end of the range: a branch point at x = −1."""
        rates = np.geomspace(1e-12, 29.0, 31)
        ratios = spectrum.spectral_ratio(rates, 1.5)
        assert max(abs(float(mpmath.mpf(ratio) / exact(rate, 1.5) - 1)) for rate, ratio in zip(rates, ratios, strict=True)) < 6e-14

    @pytest.mark.parametrize("c1", FAMILIES)
    def test_its_laplace_transform_is_the_kernel(self, c1):
        """∫ ρ/√(πλ) e^(−λx) dλ by the trapezoid rule in ln λ, which is spectrally accurate there."""
        log_rates = np.arange(-40.0, 20.0, 0.05)
        rates = np.exp(log_rates)
        density = spectrum.spectral_ratio(rates, c1) * np.sqrt(rates / math.pi) * 0.05
        for x in (1e-6, 1e-2, 1.0, 1e2, 1e6):
            assert density @ np.exp(-rates * x) == pytest.approx(x**-0.5 * float(share(x, 1.0, c1)), rel=1e-12)

    @pytest.mark.parametrize("c1", FAMILIES)
    def test_positive_and_bounded(self, c1):
        ratios = spectrum.spectral_ratio(np.geomspace(1e-14, 1e14, 2001), c1)
        assert np.all(ratios > 0.0)
        assert ratios.max() == pytest.approx({2.0: 1.1105, 2.5: 1.0204}[c1], abs=1e-4)

    def test_ends_and_shapes(self):
        ratios = spectrum.spectral_ratio([[0.0, 5e-324, 1e-180], [1e-20, 1e300, np.inf]])
        assert ratios.shape == (2, 3)
        assert ratios[0, 0] == ratios[0, 1] == 0.0
        np.testing.assert_allclose(ratios[0, 2], math.sqrt(math.pi) * 1e-270, rtol=1e-13)
        np.testing.assert_allclose(ratios[1, 0], math.sqrt(math.pi) * 1e-30, rtol=1e-13)
        np.testing.assert_allclose(ratios[1, 1:], 1.0, rtol=3e-14)
        assert spectrum.spectral_ratio(1.0).shape == ()

    @pytest.mark.parametrize(
        ("arguments", "error", "says"),
        [
            (([1.0, -2.0],), ValueError, "rate must be 0 or greater, got -2"),
            ((np.nan,), ValueError, "rate must be 0 or greater, got nan"),
            (("fast",), TypeError, "rate must be an array of real numbers, got 'fast'"),
            ((1.0, 1.4), ValueError, "c1 must be from 1.5 (below, complete monotonicity is not known) to 10 (the tables' reach), got 1.4"),
            ((1.0, 11.0), ValueError, "c1 must be from 1.5"),
            ((1.0, None), TypeError, "c1 must be a finite number greater than 0, got None"),
        ],
    )
    def test_refuses(self, arguments, error, says):
        with pytest.raises(error, match="^" + re.escape(says)):
            spectrum.spectral_ratio(*arguments)


class TestTable:
    @pytest.mark.parametrize(("c1", "rtol"), [(1.5, 6e-9), (2.0, 2e-10), (2.5, 2e-10), (10.0, 2e-10)])
    def test_error_inside_and_outside(self, c1, rtol):
        """Compiled, from far below the grid to far above; the points are no nodes of it."""
        table = spectrum.spectral_table(c1)
        log_rates = np.linspace(1.3 * table.low, -1.3 * table.low, 20011)
        ratios = np.empty_like(log_rates)
        tabulated(np.ones_like(log_rates), log_rates, *table, 0.0, ratios)
        np.testing.assert_allclose(ratios, spectrum.spectral_ratio(np.exp(log_rates), c1), rtol=rtol)

    def test_plain_and_compiled_agree(self):
        table = spectrum.spectral_table()
        log_rates = np.array([-np.inf, -50.0, table.low, -3.3, 0.0, 12.7, -table.low, 60.0, np.inf, np.nan])
        ratios = np.empty_like(log_rates)
        tabulated(np.ones_like(log_rates), log_rates, *table, 0.0, ratios)
        plain = [spectrum.ratio_at(*table, 0, float(y)) for y in log_rates]
        np.testing.assert_allclose(ratios, plain, rtol=1e-14)
        assert ratios[0] == 0.0
        assert ratios[-4] == ratios[-3] == ratios[-2] == 1.0
        assert np.isnan(ratios[-1])

    def test_made_once(self):
        basset_sum = ExponentialSum.fit(1e-3, 10.0, 1e-6)
        assert spectrum.slip_table(basset_sum, 2.0, 1.0) is spectrum.slip_table(ExponentialSum.fit(1e-3, 10.0, 1e-6), 2.0, 1.0)
        for table in (spectrum.spectral_table(), spectrum.slip_table(basset_sum, 2.0, 1.0)):
            assert not table.values.flags.writeable

    @pytest.mark.parametrize("c1", FAMILIES)
    @pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-10])
    @pytest.mark.parametrize("horizon", [None, 1.0])
    def test_stands_for_slip_weights(self, c1, rtol, horizon):
        """As sums: single weights of near-dependent terms may differ by more."""
        basset_sum = ExponentialSum.fit(1e-6, 10.0, rtol)
        table = spectrum.slip_table(basset_sum, c1, horizon)
        s, weights = np.geomspace(1e-6, 1.0, 60), np.empty(len(basset_sum))
        for exponent in np.arange(-20.0, 20.0, 0.77):
            tabulated(*table, exponent * math.log(10.0), weights)
            difference = weights - spectrum.slip_weights(basset_sum, 10.0 ** (1.5 * exponent), c1, horizon)
            assert np.abs(values(difference, basset_sum.rates, s) * np.sqrt(s)).max() < 2e-10
        tabulated(*table, -np.inf, weights)
        np.testing.assert_array_equal(weights, basset_sum.weights)


class TestSlipWeights:
    """Largest errors over lags from near to the horizon, in units of rtol: they are what the docstring states."""

    @staticmethod
    def errors(near, rtol, c1, margin, horizon, exponents):
        """Relative to the Basset kernel, and to K(s; C) from 30 near on, for every C^(2/3) = 10^exponent at a longest lag of 1 s."""
        basset_sum = ExponentialSum.fit(near, margin, rtol)
        s = np.geomspace(near, 1.0, 700)
        exponentials, result = np.exp(-np.outer(s, basset_sum.rates)), []
        for stretch in 10.0**exponents:
            kept = share(s, stretch, c1)
            error = np.abs(exponentials @ spectrum.slip_weights(basset_sum, stretch**1.5, c1, horizon) * np.sqrt(s) - kept)
            result.append((error.max(), (error / kept)[s > 30.0 * near].max()))
        return np.array(result).T / rtol

    @pytest.mark.parametrize("c1", FAMILIES)
    @pytest.mark.parametrize(("near", "rtol", "of_itself"), [(1e-10, 1e-3, 25.0), (1e-10, 1e-6, 100.0), (1e-4, 1e-8, 130.0), (1e-6, 1e-12, 260.0)])
    def test_every_slip_with_a_matched_horizon(self, c1, near, rtol, of_itself):
        of_basset, of_kernel = self.errors(near, rtol, c1, 10.0, 1.0, np.arange(-12.0, 20.0, 0.5))
        assert of_basset.max() < 2.7
        assert of_kernel.max() < of_itself

    @pytest.mark.parametrize("c1", FAMILIES)
    def test_the_horizon_needs_a_margin(self, c1):
        exponents = np.arange(-6.0, 4.0, 0.5)
        assert 90.0 < self.errors(1e-8, 1e-6, c1, 3.0, 1.0, exponents)[0].max() < 140.0
        assert 5e3 < self.errors(1e-8, 1e-6, c1, 1.0, 1.0, exponents)[0].max() < 1.1e4

    @pytest.mark.parametrize("c1", FAMILIES)
    def test_without_a_horizon(self, c1):
        """What slow terms cost that stand for all slower rates: nothing where the kernel has bent long before."""
        assert 0.18 < 1e-6 * self.errors(1e-8, 1e-6, c1, 1.0, None, np.arange(-2.0, 0.0, 0.25))[0].max() < 0.28
        assert 0.06 < 1e-6 * self.errors(1e-8, 1e-6, c1, 10.0, None, np.arange(-3.0, 0.0, 0.25))[0].max() < 0.09
        assert self.errors(1e-8, 1e-6, c1, 1.0, None, np.arange(3.5, 12.0, 0.5))[0].max() < 2.0

    @pytest.mark.parametrize("horizon", [None, 2.0])
    def test_no_slip_is_the_basset_sum(self, horizon):
        basset_sum = ExponentialSum.fit(1e-3, 20.0, 1e-6)
        weights = spectrum.slip_weights(basset_sum, 0.0, horizon=horizon)
        np.testing.assert_array_equal(weights, basset_sum.weights)
        np.testing.assert_allclose(spectrum.slip_weights(basset_sum, 1e-40, horizon=horizon), weights, rtol=1e-9)

    def test_a_kernel_of_the_library(self):
        """Units: a grain in water, slip in m/s."""
        for kernel in (basset.MeiAdrianKernel(0.05, 1e-3, 1e-6), basset.MeiAdrianKernel.dorgan_loth(0.05, 1e-3, 1e-6)):
            basset_sum = ExponentialSum.fit(1e-5, 10.0, 1e-6)
            weights, s = spectrum.slip_weights(basset_sum, kernel.steepness, kernel.c1, 1.0), np.geomspace(1e-5, 1.0, 300)
            assert np.abs((values(weights, basset_sum.rates, s) - kernel(s)) * np.sqrt(s)).max() < 2.7e-6

    def test_another_unit_of_time(self):
        seconds = spectrum.slip_weights(ExponentialSum.fit(1e-3, 10.0, 1e-6), 3.0, horizon=1.0)
        minutes = spectrum.slip_weights(ExponentialSum.fit(1e-3 / 60.0, 10.0 / 60.0, 1e-6), 3.0 * 60.0**1.5, horizon=1.0 / 60.0)
        np.testing.assert_allclose(minutes, seconds * math.sqrt(60.0), rtol=1e-8)

    @pytest.mark.parametrize("horizon", [None, 1e12])
    @pytest.mark.parametrize("steepness", [5e-324, 1e-200, 1e200, 1e308])
    def test_extreme_slips_stay_finite(self, steepness, horizon):
        basset_sum = ExponentialSum.fit(1e9, 1e13, 1e-6)
        weights = spectrum.slip_weights(basset_sum, steepness, horizon=horizon)
        assert np.all(np.isfinite(weights))
        assert (np.abs(weights).max() < 1e-100) == (steepness > 1.0)

    def test_slow_weights_stay_small(self):
        """Matched weights may be negative, never large: they do not cancel."""
        basset_sum = ExponentialSum.fit(1e-4, 10.0, 1e-3)
        weights = np.array([spectrum.slip_weights(basset_sum, 10.0**exponent, horizon=1.0) for exponent in np.arange(-20.0, 20.0, 0.5)])
        assert -0.04 < weights.min() < 0.0
        assert np.all(np.abs(weights) < 1.5 * basset_sum.weights)

    @pytest.mark.parametrize(
        ("arguments", "error", "says"),
        [
            ((ExponentialSum.fit(1e-3, 1.0, 1e-3), -1.0), ValueError, "steepness must be a finite number, 0 or greater (s^(-3/2)), got -1"),
            ((ExponentialSum.fit(1e-3, 1.0, 1e-3), np.inf), ValueError, "steepness must be a finite number, 0 or greater (s^(-3/2)), got inf"),
            ((ExponentialSum.fit(1e-3, 1.0, 1e-3), 1.0, 1.0), ValueError, "c1 must be from 1.5"),
            ((ExponentialSum.fit(1e-3, 1.0, 1e-3), 1.0, 2.0, 2.0), ValueError, "horizon must lie within the sum's range, 0.001 to 1 seconds, got 2"),
            ((ExponentialSum.fit(1e-3, 1.0, 1e-3), 1.0, 2.0, 0.0), ValueError, "horizon must be a finite number greater than 0 (seconds), got 0"),
            ((None, 1.0), TypeError, "basset_sum must be an ExponentialSum for the Basset kernel, got None"),
            (
                (ExponentialSum.fit(1e-3, 1.0, 1e-3, basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)), 1.0),
                TypeError,
                "basset_sum must be an ExponentialSum for the Basset kernel, got ExponentialSum(",
            ),
        ],
    )
    def test_refuses(self, arguments, error, says):
        with pytest.raises(error, match="^" + re.escape(says)):
            spectrum.slip_weights(*arguments)
