"""Weights: against mpmath, published values, definitions, identities; scaling; the cost in memory."""

from __future__ import annotations

import tracemalloc
from functools import cache

import mpmath
import numpy as np
import pytest
from all_cases import each
from rule_cases import ANY, EPS, KERNELS, ORDERS, accepts, any_rule_and_input, every_rule, every_rule_and_input, window_steps

import basset
from basset import reference
from basset.weights.polynomials import FAR
from basset.weights.table import TABLES

INPUTS = ("rate", "slip")
BASSET = basset.BassetKernel()


def limit(order: int) -> float:
    """The promised error of a weight, relative to max(|w_j|, K(jh)h)."""
    return 2e-14 if order <= 4 else 1e-13


@cache
def exact_weights(n: int, indices: tuple[int, ...], order: int, kernel: basset.Kernel, input: str, digits: int) -> list[mpmath.mpf]:
    return reference.product_weights(n, indices, order, kernel, input, digits)


def error(n: int, indices, order: int, kernel: basset.Kernel = BASSET, input: str = "rate", digits: int = 30) -> float:
    """Worst error of the weights at `indices`, relative to max(|w_j|, K(j)) for rates and max(|v_j|, |K'(j)|) for slips."""
    indices = tuple(int(j) for j in indices)
    weights = basset.Daitche(order).weights(n, 1.0, kernel, input)
    sampled = kernel._values if input == "rate" else kernel._derivatives
    worst = 0.0
    for j, exact in zip(indices, exact_weights(n, indices, order, kernel, input, digits), strict=True):
        scale = max(abs(float(exact)), abs(float(sampled(np.array([float(j)]))[0])) if j else 0.0)
        worst = max(worst, float(abs(weights[j] - exact)) / scale)
    return worst


@pytest.mark.parametrize("input", INPUTS)
@pytest.mark.parametrize("order", ORDERS)
class TestAgainstMpmath:
    def test_small_lags_every_one(self, order, input):
        assert error(4000, range(201), order, input=input) <= limit(order)

    def test_around_the_switch_every_one(self, order, input):
        assert error(4000, range(FAR - 2 * order - 2, FAR + 2 * order + 3), order, input=input) <= limit(order)

    @each("n", [41, FAR + 5, 10**6])
    def test_oldest_every_one(self, order, input, n):
        assert error(n, range(n - 2 * order - 2, n + 1), order, input=input) <= limit(order)

    def test_start_up_rows_every_one(self, order, input):
        for n in range(1, 2 * order + 3):
            assert error(n, range(n + 1), order, input=input) <= limit(order), n

    def test_far_out(self, order, input):
        lags = 10.0 ** np.random.default_rng(order).uniform(np.log10(200.0), 6.0, 12)
        assert error(10**6 + 100, np.unique(lags.astype(int)), order, input=input) <= limit(order)


@pytest.mark.parametrize("order", [4, 10])
def test_ten_million_weights_in_less_than_a_gigabyte(order):
    TABLES.clear()
    n = 10**7
    tracemalloc.start()
    weights = basset.Daitche(order).weights(n, 1.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e9
    lags = np.unique((10.0 ** np.random.default_rng(order).uniform(3.0, 7.0, 12)).astype(int))
    indices = tuple(int(j) for j in [*lags[lags < n - 30], *range(n - 2 * order - 2, n + 1)])
    for j, exact in zip(indices, exact_weights(n, indices, order, BASSET, "rate", 30), strict=True):
        assert float(abs(weights[j] - exact)) <= limit(order) * max(abs(float(exact)), j**-0.5)
    TABLES.clear()


def steep(steepness: float, make) -> basset.MeiAdrianKernel:
    """A kernel with about that C = C h^(3/2) for the unit step; d/ν = 1e-3 keeps Re small."""
    return make(0.75 * (2.0 * steepness / np.sqrt(np.pi)) ** (1.0 / 3.0), 1e-3, 1.0)


@pytest.mark.parametrize("steepness", [1e-6, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("make", [basset.MeiAdrianKernel, basset.MeiAdrianKernel.dorgan_loth], ids=["mei_adrian", "dorgan_loth"])
class TestFiniteReynolds:
    @pytest.mark.parametrize("input", INPUTS)
    def test_newest(self, make, steepness, input):
        assert error(40, [0, 1, 2], 2, steep(steepness, make), input, digits=18) <= limit(2)

    def test_oldest_and_middle(self, make, steepness):
        assert error(60, [30, 59, 60], 3, steep(steepness, make), "rate", digits=18) <= limit(3)

    def test_start_up_row(self, make, steepness):
        assert error(3, range(4), 5, steep(steepness, make), "rate", digits=18) <= limit(5)


@each("name", ["mei_adrian", "dorgan_loth"])
@pytest.mark.parametrize("input", INPUTS)
def test_finite_reynolds_around_the_switch(name, input):
    kernel = KERNELS[name].scaled(1e-3)
    assert error(2000, [FAR - 1, FAR, FAR + 1], 4, kernel, input, digits=18) <= limit(4)


@each("name", ["mei_adrian", "dorgan_loth"])
def test_finite_reynolds_high_order(name):
    assert error(17, [0, 17], 8, KERNELS[name].scaled(1e-2), "rate", digits=18) <= limit(8)


@pytest.mark.parametrize("input", INPUTS)
@pytest.mark.parametrize("order", [1, 4, 10])
@pytest.mark.parametrize("c1", [2.0, 2.5])
def test_zero_slip_gives_the_standard_weights(order, input, c1):
    kernel = basset.MeiAdrianKernel(0.0, 1e-3, 1e-6, c1=c1)
    rule = basset.Daitche(order)
    for n in (1, order, 2 * order + 1, 700):
        ours, standard = rule.weights(n, 0.37, kernel, input), rule.weights(n, 0.37, BASSET, input)
        # the singular panel is integrated by another formula: the weights' promised error, twice
        floor = np.abs((BASSET._values if input == "rate" else BASSET._derivatives)(0.37 * np.arange(1.0, n + 1.0))) * 0.37
        scale = np.maximum(np.abs(standard), np.append(0.0, floor))
        assert np.all(np.abs(ours - standard) <= 2 * limit(order) * scale), n


def test_published_newest_values():
    r2, r3 = np.sqrt(2.0), np.sqrt(3.0)
    published = {  # Daitche (2013), eqs. 23, 27 and 31: dimensionless coefficients of the newest samples
        1: [4 / 3],
        2: [4 / 5 * r2, 14 / 5 * r3 - 12 / 5 * r2, 176 / 15 - 42 / 5 * r3 + 12 / 5 * r2],
        3: [244 / 315 * r2, 362 / 105 * r3 - 976 / 315 * r2, 5584 / 315 - 1448 / 105 * r3 + 488 / 105 * r2],
    }
    for order, values in published.items():
        weights = basset.Daitche(order).weights(40, 1.0)
        # the printed forms cancel up to a fiftyfold
        np.testing.assert_allclose(weights[: len(values)], values, rtol=0.0, atol=50 * EPS)


def published_interior(order: int, j: int) -> mpmath.mpf:
    """Daitche (2013), interior coefficients: differences of powers, evaluated with digits to spare."""
    with mpmath.workdps(60):

        def p(k: int, m: int) -> mpmath.mpf:
            return mpmath.mpf(j + k) ** (mpmath.mpf(m) / 2)

        if order == 1:
            return mpmath.mpf(4) / 3 * (p(-1, 3) + p(1, 3) - 2 * p(0, 3))
        if order == 2:
            fifth = p(2, 5) - 3 * p(1, 5) + 3 * p(0, 5) - p(-1, 5)
            third = -p(2, 3) + 3 * p(1, 3) - 3 * p(0, 3) + p(-1, 3)
            return mpmath.mpf(8) / 15 * fifth + mpmath.mpf(2) / 3 * third
        seventh = p(2, 7) + p(-2, 7) - 4 * p(1, 7) - 4 * p(-1, 7) + 6 * p(0, 7)
        third = 4 * p(1, 3) + 4 * p(-1, 3) - p(2, 3) - p(-2, 3) - 6 * p(0, 3)
        return mpmath.mpf(16) / 105 * seventh + mpmath.mpf(2) / 9 * third


@pytest.mark.parametrize("order", [1, 2, 3])
def test_published_interior_formulas(order):
    lags = [*range(order + 1, 200), 511, 512, 513, 10**4, 10**6]
    weights = basset.Daitche(order).weights(10**6 + 50, 1.0)
    for j in lags:
        exact = published_interior(order, j)
        assert float(abs(weights[j] - exact)) <= limit(order) * j**-0.5, j


def test_published_oldest_of_the_trapezoid():
    with mpmath.workdps(60):
        for n in (1, 2, 3, 10, 100, 511, 512, 513, 10**5):
            x = mpmath.mpf(n)
            exact = mpmath.mpf(4) / 3 * ((x - 1) ** mpmath.mpf("1.5") - x ** mpmath.mpf("1.5") + mpmath.mpf("1.5") * mpmath.sqrt(x))
            assert float(abs(basset.Daitche(1).weights(n, 1.0)[n] / exact - 1)) <= limit(1)


@each("name", KERNELS)
@pytest.mark.parametrize("input", INPUTS)
def test_hinsberg_and_daitche_1_are_the_same_weights(name, input):
    for n in (1, 2, 3, 40, 700):
        ours = basset.Hinsberg(tail=False).weights(n, 0.02, KERNELS[name], input)
        assert np.array_equal(ours, basset.Daitche(1).weights(n, 0.02, KERNELS[name], input))


@each("name", KERNELS)
@each("n", [1, 2, 3, 4, 5, 40, 513, 700])
def test_baselines_by_their_definition(n, name):
    kernel = KERNELS[name].scaled(0.01)
    midpoint = np.zeros(n + 1)
    for k in range(n):
        midpoint[k : k + 2] += 0.5 * kernel(k + 0.5)
    # sums of two values, each good to 32 units
    np.testing.assert_allclose(basset.EulerMaclaurin().weights(n, 1.0, kernel), midpoint, rtol=64 * EPS)

    inner = np.zeros(n + 1)  # the open midpoint on two panels; one panel has no inner point
    inner[1:n] = kernel(np.arange(1.0, n))
    inner[1:2] += 0.5 * inner[1:2]
    inner[n - 1 : n] += 0.5 * kernel(np.arange(n - 1.0, n)) if n > 1 else 0.0
    np.testing.assert_allclose(basset.NewtonCotes().weights(n, 1.0, kernel), inner if n > 1 else midpoint, rtol=64 * EPS)

    brush = np.zeros(n + 1)
    brush[0] = float(kernel.moments(0.0, 1.0, 0)[0])  # 2√h for the standard kernel
    whole = n - 1 - (n - 1) % 2
    for k in range(1, whole, 2):
        brush[k : k + 3] += np.array([1.0, 4.0, 1.0]) / 3.0 * kernel(np.arange(k, k + 3))
    if (n - 1) % 2:
        brush[n - 1 :] += 0.5 * kernel(np.array([n - 1, n]))
    np.testing.assert_allclose(basset.Brush().weights(n, 1.0, kernel), brush, rtol=64 * EPS)


def test_semi_derivative_series_against_mpmath():
    n = 10**6
    rate, slip = basset.SemiDerivative().weights(n, 1.0), basset.SemiDerivative().weights(n, 1.0, input="slip")
    with mpmath.workdps(40):
        for j in [*range(200), 1000, 54321, n - 1]:
            exact = mpmath.gammaprod([j + mpmath.mpf(1) / 2], [j + 1])
            # the ratio is rounded a few times, the slip's division once more
            assert float(abs(rate[j] / exact - 1)) <= 4 * EPS, j
            assert float(abs(slip[j] / (exact / (1 - 2 * j)) - 1)) <= 4 * EPS, j
    assert rate[n] == slip[n] == 0.0  # as published the series ends before the oldest sample


def test_semi_integral_twice_is_the_integral():
    n = 400
    rate, slip = (basset.SemiDerivative().weights(n, 1.0, input=input)[:n] for input in INPUTS)
    # generating functions √π(1−x)^(-1/2) and √π(1−x)^(1/2): squares and product are π/(1−x), π(1−x) and π
    ones, unit = np.ones(n), np.eye(n)[0]
    np.testing.assert_allclose(np.convolve(rate, rate)[:n], np.pi * ones, atol=n * EPS * np.pi)
    np.testing.assert_allclose(np.convolve(rate, slip)[:n], np.pi * unit, atol=n * EPS * np.pi)


@every_rule_and_input
@each("dt", [1e-300, 1e-6, 0.37, 1e8])
def test_step_size_scales_the_standard_weights(make, input, dt):
    for n in (1, 2, 7, 30):
        unit = make(12.0).weights(n, 1.0, input=input)
        scaled = make(12.0 * dt).weights(n, dt, input=input)
        factor = np.sqrt(dt) if input == "rate" else 1.0 / np.sqrt(dt)
        # one multiplication; the edge of a window takes one subtraction more, relative to the largest weight
        np.testing.assert_allclose(scaled, factor * unit, rtol=4 * EPS, atol=4 * EPS * factor * np.abs(unit).max())


@every_rule
@each("name", KERNELS)
def test_rate_weights_sum_to_the_integral_of_the_kernel(make, name):
    """g = 1: exact for product integration; for the others to their order."""
    kernel, n, dt = KERNELS[name], 300, 1e-5
    rule = make(100.0 * dt)
    if not accepts(rule, kernel):
        return
    span = min(n, window_steps(rule, dt) or n) * dt
    exact = kernel.moments(0.0, span, 0)[0]
    exactly = isinstance(rule.whole, basset.Daitche)
    # otherwise a fixed share of √dt, of at most a first panel's size 2√dt
    assert abs(rule.weights(n, dt, kernel).sum() - exact) <= (300 * EPS * exact if exactly else 2.0 * np.sqrt(dt))


@every_rule_and_input
def test_constant_slip_is_a_jump(make, input):
    if input == "rate":
        assert basset.integrate(np.zeros(50), 0.1, make(100.0)) == 0.0
        return
    rule = make(100.0)
    for n in (1, 2, 10, 40, 700):
        H = basset.integrate(np.ones(n + 1), 0.1, rule, input="slip")
        first_order = isinstance(rule.whole, basset.SemiDerivative)
        # Σ v = K(t): summation error of weights of size 1/√h; Grünwald's series is off by O(1/n)
        tolerance = 1.0 / n if first_order else 1e-13 * np.abs(rule.weights(n, 0.1, input="slip")).sum() * np.sqrt(0.1 * n)
        assert abs(H * np.sqrt(0.1 * n) - 1.0) <= tolerance


@any_rule_and_input
def test_weights_are_the_callers_own(make, input):
    rule = make(3.0)
    first = rule.weights(50, 0.1, input=input)
    kept = first.copy()
    first[:] = np.nan
    assert np.array_equal(rule.weights(50, 0.1, input=input), kept)


@any_rule_and_input
def test_integrate_is_the_dot_product_with_the_weights(make, input):
    rule, dt = make(2.0), 0.1
    for n in (1, 2, 3, 15, 20, 21, 40, 600):
        g = np.random.default_rng(n).standard_normal(n + 1)
        weights = rule.weights(n, dt, input=input)
        # two summation orders of n+1 products
        tolerance = 4 * EPS * np.sqrt(n + 1.0) * (np.abs(weights) @ np.abs(g[::-1]))
        assert abs(basset.integrate(g, dt, rule, input=input) - weights @ g[::-1]) <= tolerance


def test_every_scheme_is_among_the_cases():
    """A scheme that is not in `rule_cases` would go untested: add one line there."""
    tested = {make(1.0).name for make in ANY.values()}
    assert tested == set(basset.SCHEMES)
