"""The truth checked against itself: double against mpmath, mpmath against the defining integral, weights by hand."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from all_cases import each
from rule_cases import EPS, GRAIN, KERNELS

import basset
from basset import reference
from basset.reference import integrals

pytestmark = pytest.mark.analytic

TIMES = [1e-12, 1e-6, 1e-3, 0.1, 0.9, 1.0, 1.1, 3.0, 10.0, 50.0, 157.0, 1e3, 12345.678, 1e5]


def by_quadrature(rate, t, digits: int = 30) -> mpmath.mpf:
    """∫_0^t (t−τ)^(-1/2) g(τ) dτ by its definition, with τ = t − σ²."""
    with mpmath.workdps(digits):
        t = mpmath.mpf(t)
        root = mpmath.sqrt(t)
        points = [root * k / 8 for k in range(9)]
        return 2 * mpmath.quad(lambda sigma: rate(t - sigma**2), points)


FUNCTIONS = {
    "cosine": (lambda t, d=None: reference.cosine(t, 1.0, d), mpmath.cos),
    "cosine 40": (lambda t, d=None: reference.cosine(t, 40.0, d), lambda x: mpmath.cos(40 * x)),
    "sine": (lambda t, d=None: reference.sine(t, 1.0, d), mpmath.sin),
    "sine 40": (lambda t, d=None: reference.sine(t, 40.0, d), lambda x: mpmath.sin(40 * x)),
    "growth": (lambda t, d=None: reference.exponential(t, 1.0, d), mpmath.exp),
    "decay": (lambda t, d=None: reference.exponential(t, -1.0, d), lambda x: mpmath.exp(-x)),
    "slow decay": (lambda t, d=None: reference.exponential(t, -0.01, d), lambda x: mpmath.exp(-x / mpmath.mpf("100.0"))),
    "constant": (lambda t, d=None: reference.exponential(t, 0.0, d), lambda x: mpmath.mpf(1)),
    "power 0": (lambda t, d=None: reference.power(t, 0, d), lambda x: mpmath.mpf(1)),
    "power 7": (lambda t, d=None: reference.power(t, 7, d), lambda x: x**7),
    "power 2.5": (lambda t, d=None: reference.power(t, 2.5, d), lambda x: x ** mpmath.mpf(2.5)),
}
every_function = pytest.mark.parametrize("name", FUNCTIONS)


@every_function
@each("t", [0.3, 2.0, 7.5])
def test_mpmath_against_the_defining_integral(name, t):
    function, rate = FUNCTIONS[name]
    value = function(t, 25)
    if name == "slow decay":  # the rate -0.01 is the double nearest to it
        rate = lambda x: mpmath.exp(mpmath.mpf(-0.01) * x)  # noqa: E731
    with mpmath.workdps(25):
        assert abs(value / by_quadrature(rate, t) - 1) < mpmath.mpf(10) ** -20


@each("t", TIMES)
@pytest.mark.parametrize("omega", [1.0, 40.0])
@pytest.mark.parametrize("function", [reference.cosine, reference.sine])
def test_oscillations_in_double(function, omega, t):
    exact = float(function(t, omega, 30))
    size = min(2.0 * np.sqrt(t), np.sqrt(2.0 * np.pi / omega))
    # ωt is rounded once (exact for ω = 1) and the phase carries that; a few roundings of the rest, relative to the amplitude
    phase = EPS * omega * t if omega != 1.0 else 0.0
    assert abs(function(t, omega) - exact) <= (32 * EPS + phase) * size


@each("t", [t for t in TIMES if t <= 1e-3])
def test_oscillations_keep_relative_accuracy_at_short_times(t):
    # cos: H → 2√t; sin: H → (4/3) t^(3/2), small against its parts
    for function in (reference.cosine, reference.sine):
        exact = float(function(t, 1.0, 30))
        assert abs(function(t, 1.0) / exact - 1.0) <= 16 * EPS


@each("t", TIMES)
@pytest.mark.parametrize("rate", [-1.0, -1e-3, 0.0, 1e-3, 1.0])
def test_exponentials_in_double(rate, t):
    if abs(rate * t) > 700.0 and rate > 0.0:  # beyond the range of e^(at)
        with np.errstate(over="ignore"):
            assert reference.exponential(t, rate) == np.inf
        return
    if rate * t < -2000.0:  # f' = e^(−τ) is long over: H → 1/(|a|√t) (1 + 1/(2|a|t)), whose next term is 3/(4(at)²)
        z = abs(rate * t)
        exact, tolerance = (1.0 + 0.5 / z + 0.75 / z**2 + 1.875 / z**3) / (abs(rate) * np.sqrt(t)), 16 * EPS + 7.0 / z**4
    else:
        # Dawson's function is good to 21 units near zero; e^(at) carries the rounding of at
        exact, tolerance = float(reference.exponential(t, rate, 30)), (32 + abs(rate * t) * (rate > 0.0)) * EPS
    assert abs(reference.exponential(t, rate) / exact - 1.0) <= tolerance


@each("t", TIMES)
@pytest.mark.parametrize("exponent", [0, 1, 2, 10, 0.5, -0.5])
def test_powers_in_double(exponent, t):
    exact = float(reference.power(t, exponent, 30))
    # beta is good to ~10 units, the power to half a unit of each ln
    assert abs(reference.power(t, exponent) / exact - 1.0) <= (32 + abs((exponent + 0.5) * np.log(t))) * EPS


@each("t", TIMES)
def test_slip_powers(t):
    assert reference.power_slip(t, 0.5) == pytest.approx(np.pi / 2.0, rel=16 * EPS)  # the root: the same at all times
    for exponent in (1, 2, 3.5):
        exact = float(reference.power_slip(t, exponent, 30))
        assert reference.power_slip(t, exponent) == pytest.approx(exact, rel=(32 + abs(exponent * np.log(t))) * EPS)
        with mpmath.workdps(30):  # f = τ^k has f' = k τ^(k−1)
            assert abs(reference.power_slip(t, exponent, 30) / (exponent * reference.power(t, exponent - 1, 30)) - 1) < mpmath.mpf(10) ** -25


def test_step():
    assert reference.step(0.0) == np.inf
    assert reference.step(0.0, -2.0) == -np.inf
    assert reference.step(np.array([0.25, 4.0]), 3.0).tolist() == [6.0, 1.5]
    assert reference.step(4, 3, 30) == 1.5


def test_the_thesis_number():
    """The customary digits of I(50π) belong to the double next to 50π; at 50π itself it is 1.2e-15 less."""
    with mpmath.workdps(40):
        customary = mpmath.mpf("1.25306020134666323776267517398")
        assert abs(reference.cosine(mpmath.mpf(50 * np.pi), 1.0, 35) - customary) < mpmath.mpf(10) ** -28
        at_50_pi = mpmath.sqrt(2 * mpmath.pi) * mpmath.fresnelc(10)
        assert abs(reference.cosine(50 * mpmath.pi, 1.0, 35) - at_50_pi) < mpmath.mpf(10) ** -33
        assert 1e-15 < customary - at_50_pi < 1.5e-15


def test_cosine_and_sine_are_the_parts_of_the_complex_exponential():
    t = np.geomspace(1e-6, 1e4, 60)
    H = reference.exponential(t, 1j * 2.5)
    assert np.array_equal(H.real, reference.cosine(t, 2.5))
    assert np.array_equal(H.imag, reference.sine(t, 2.5))


def test_damped_oscillation_against_mpmath():
    for t in (1e-6, 0.2, 1.0, 5.0, 30.0):
        exact = complex(reference.exponential(t, -0.2 + 3.0j, 30))
        assert abs(reference.exponential(t, -0.2 + 3.0j) - exact) <= 64 * EPS * max(abs(exact), t**0.5 / (1.0 + t))


def test_arrays_and_numbers_agree():
    t = np.array([[1e-3, 0.5], [2.0, 80.0]])
    for name, (function, _) in FUNCTIONS.items():
        if name == "growth":
            continue
        values = function(t)
        assert values.shape == t.shape
        assert [function(x) for x in t.ravel()] == pytest.approx(values.ravel().tolist(), rel=4 * EPS, abs=4 * EPS)


class TestProductWeights:
    @pytest.mark.parametrize("degree", [1, 2, 5, 10])
    @pytest.mark.parametrize("n", [1, 3, 7, 25])
    def test_exact_on_polynomials(self, degree, n):
        """The definition's own promise, to all digits: Σ w_j j^k = n^(k+1/2)/(k+1/2) in the lag."""
        weights = reference.product_weights(n, range(n + 1), degree, digits=40)
        with mpmath.workdps(40):
            for k in range(min(degree, n) + 1):
                half = mpmath.mpf(1) / 2
                exact = mpmath.mpf(n) ** (k + half) / (k + half)
                assert abs(sum(w * mpmath.mpf(j) ** k for j, w in enumerate(weights)) / exact - 1) < mpmath.mpf(10) ** -30

    @pytest.mark.parametrize("degree", [1, 3, 6])
    def test_slip_weights_are_the_derivative(self, degree):
        """f = (lag)^k: d/dt ∫K f = −∫K d/ds s^k + the jump f(t_0)K(n)."""
        n = 20
        weights = reference.product_weights(n, range(n + 1), degree, input="slip", digits=40)
        with mpmath.workdps(40):
            for k in range(degree + 1):
                smooth = -k * mpmath.mpf(n) ** (k - mpmath.mpf(1) / 2) / (k - mpmath.mpf(1) / 2)
                exact = smooth + mpmath.mpf(n) ** (k - mpmath.mpf(1) / 2)
                assert abs(sum(w * mpmath.mpf(j) ** k for j, w in enumerate(weights)) - exact) < mpmath.mpf(10) ** -28 * n**k

    def test_trapezoid_by_hand(self):
        first, second, third = reference.product_weights(2, range(3), 1, digits=30)
        with mpmath.workdps(30):
            r2 = mpmath.sqrt(2)
            tiny = mpmath.mpf(10) ** -28
            assert abs(first - mpmath.mpf(4) / 3) < tiny
            assert abs(second - 4 * (2 * r2 - 2) / 3) < tiny
            assert abs(third - (2 * r2 - mpmath.mpf(4) / 3 * (2 * r2 - 1))) < tiny

    @pytest.mark.parametrize("name", ["mei_adrian", "dorgan_loth"])
    def test_finite_reynolds_against_the_hypergeometric_closed_form(self, name):
        """∫_0^n K = √n · 2 · 2F1(c1, c1/3; 1 + c1/3; −(C n^(3/2))^(1/c1)): another formula than the quadrature inside."""
        kernel = KERNELS[name].scaled(1e-3)
        n = 3
        weights = reference.product_weights(n, range(n + 1), 2, kernel, digits=25)
        with mpmath.workdps(25):
            c1 = mpmath.mpf(kernel.c1)
            bend = (integrals._steepness(kernel) * mpmath.mpf(n) ** mpmath.mpf("1.5")) ** (1 / c1)
            exact = 2 * mpmath.sqrt(n) * mpmath.hyp2f1(c1, c1 / 3, 1 + c1 / 3, -bend)
            assert abs(sum(weights) / exact - 1) < mpmath.mpf(10) ** -18

    def test_zero_slip_is_the_standard_kernel(self):
        kernel = basset.MeiAdrianKernel(**{**GRAIN, "slip": 0.0})
        standard = reference.product_weights(4, range(5), 3, digits=25)
        for ours, exact in zip(reference.product_weights(4, range(5), 3, kernel, digits=25), standard, strict=True):
            assert abs(ours - exact) < 1e-20
