"""Kernels: values and moments against mpmath at both ends of the number range, limits, identity."""

from __future__ import annotations

import pickle
from functools import lru_cache

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_cases import EPS, EXACT_VALUES, GRAIN, KERNELS, exact_steepness

import basset

TINY = np.finfo(float).tiny
every_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)


def kernel_of(steepness: float, c1: float) -> basset.MeiAdrianKernel:
    """A kernel with about that C: with c2 = 0 and unit viscosity C = √π/2 (slip/0.75)³."""
    slip = 0.75 * (2.0 * steepness / np.sqrt(np.pi)) ** (1.0 / 3.0)
    return basset.MeiAdrianKernel(slip, 1.0, 1.0, c1=c1, c2=0.0)


def exact_value(kernel: basset.Kernel, s: float) -> mpmath.mpf:
    return EXACT_VALUES[type(kernel)](kernel, mpmath.mpf(s))


def antiderivative(kernel: basset.Kernel, x: mpmath.mpf, m: int) -> mpmath.mpf:
    """∫_0^x K(s) s^m ds; for Mei–Adrian as a Gauss hypergeometric function (substitute u = s^(3/(2 c1)))."""
    a = m + mpmath.mpf(1) / 2
    if x == 0 or isinstance(kernel, basset.BassetKernel) or kernel.slip == 0:
        return x**a / a
    c1 = mpmath.mpf(kernel.c1)
    q = mpmath.mpf("1.5") / c1
    return x**a / a * mpmath.hyp2f1(c1, a / q, 1 + a / q, -(exact_steepness(kernel) ** (1 / c1)) * x**q)


def quadrature_moments(kernel: basset.Kernel, near: float, far: float, degree: int) -> list[mpmath.mpf]:
    """The same for a kernel without antiderivatives at hand, in u = √s, in which K ds has no singularity."""
    with mpmath.workdps(40):
        near, far = mpmath.mpf(near), mpmath.mpf(far)
        between = [kernel.bend * mpmath.mpf(10) ** k for k in range(-4, 5, 2)]
        points = [mpmath.sqrt(s) for s in (near, *(s for s in between if near < s < far), far)]
        share = lru_cache(maxsize=None)(lambda u: 2 * u * exact_value(kernel, u * u))  # every moment asks for it at the same places
        return [mpmath.quad(lambda u, m=m: share(u) * ((u * u - near) / (far - near)) ** m, points) for m in range(degree + 1)]


def exact_moments(kernel: basset.Kernel, near: float, far: float, degree: int, digits: int) -> list[mpmath.mpf]:
    """∫ K ((s−near)/(far−near))^m from differences of antiderivatives: `digits` must cover their cancellation."""
    if not isinstance(kernel, (basset.BassetKernel, basset.MeiAdrianKernel)):
        return quadrature_moments(kernel, near, far, degree)
    with mpmath.workdps(digits):
        near, far = mpmath.mpf(near), mpmath.mpf(far)
        raw = [antiderivative(kernel, far, m) - antiderivative(kernel, near, m) for m in range(degree + 1)]
        return [sum(mpmath.binomial(m, i) * (-near) ** (m - i) * raw[i] for i in range(m + 1)) / (far - near) ** m for m in range(degree + 1)]


def relative_error(computed, exact) -> float:
    return max(float(abs((mpmath.mpf(float(c)) - e) / e)) for c, e in zip(np.atleast_1d(computed), exact, strict=True))


LAGS = [1e-300, 1e-100, 1e-16, 1e-3, 0.7, 1.0, 3.0, 1e4, 1e16, 1e100, 1e300]


@pytest.mark.parametrize("c1", [2.0, 2.5])
@pytest.mark.parametrize("steepness", [1e-300, 1e-30, 1e-6, 1.0, 1e6, 1e15, 1e30])
def test_values_against_mpmath_at_both_ends(steepness, c1):
    # C carries about ten roundings and K at most its first power: 32 units in the last place. The exponent 1.5/c1 is
    # rounded too, which the c1-th power turns into at most |ln C^(2/3)s| units
    kernel = kernel_of(steepness, c1)
    values = kernel(np.array(LAGS))
    with mpmath.workdps(40):
        for s, value in zip(LAGS, values, strict=True):
            exact = exact_value(kernel, s)
            units = 32 + abs(np.log(steepness) / 1.5 + np.log(s))
            assert abs(value - exact) <= max(units * EPS * exact, TINY), (s, value, exact)


@pytest.mark.parametrize("s", LAGS)
def test_standard_kernel_is_one_over_root(s):
    with mpmath.workdps(40):
        assert relative_error(basset.BassetKernel()(s), [1 / mpmath.sqrt(mpmath.mpf(s))]) <= EPS  # a root and a division, both rounded once


def test_steepness_of_the_literature():
    kernel = basset.MeiAdrianKernel(**GRAIN)
    assert kernel.reynolds == pytest.approx(100.0, rel=4 * EPS)
    by_hand = np.sqrt(np.pi) * 0.1**3 / (2.0 * 1e-9 * (0.75 + 0.105 * 100.0) ** 3)
    assert kernel.steepness == pytest.approx(by_hand, rel=32 * EPS)


def test_dorgan_loth_constants():
    kernel = basset.MeiAdrianKernel.dorgan_loth(**GRAIN)
    assert (kernel.c1, kernel.c2) == (2.5, 0.2)
    assert kernel == basset.MeiAdrianKernel(**GRAIN, c1=2.5, c2=0.2)


@every_kernel
def test_infinite_at_zero_and_gone_at_infinity(kernel):
    assert kernel(0.0) == np.inf
    assert kernel(np.inf) == 0.0


@pytest.mark.parametrize("c1", [2.0, 2.5])
def test_zero_slip_is_the_standard_kernel(c1):
    kernel, standard = basset.MeiAdrianKernel(0.0, 1e-3, 1e-6, c1=c1), basset.BassetKernel()
    assert np.array_equal(kernel(LAGS), standard(LAGS))
    assert kernel(np.inf) == standard(np.inf)
    assert relative_error(kernel.moments(0.0, 3.0, 15), exact_moments(standard, 0.0, 3.0, 15, 40)) <= 64 * EPS


@pytest.mark.parametrize("name", ["mei_adrian", "dorgan_loth"])
def test_short_and_long_lag_limits(name):
    kernel = KERNELS[name]
    scale = kernel.steepness ** (-2.0 / 3.0)  # the lag of the bend
    # K = s^(-1/2)(1+b)^(-c1) with b = (s/scale)^(1.5/c1): the next term is c1·b of the short-lag and c1/b of the long-lag limit
    for x in (1e-20, 1e-16, 1e-12):
        assert kernel(x * scale) == pytest.approx((x * scale) ** -0.5, rel=1.01 * kernel.c1 * x ** (1.5 / kernel.c1) + 32 * EPS)
    for x in (1e12, 1e16, 1e20):
        assert kernel(x * scale) == pytest.approx((x * scale) ** -2.0 / kernel.steepness, rel=1.01 * kernel.c1 * x ** (-1.5 / kernel.c1) + 32 * EPS)


@every_kernel
def test_decreasing_and_convex(kernel):
    s = np.geomspace(1e-8, 1e8, 400)
    values = kernel(s)
    assert np.all(values > 0.0)
    assert np.all(np.diff(values) < 0.0)
    assert np.all(np.diff(np.diff(values) / np.diff(s)) > 0.0)


@given(a=st.floats(0.0, 10.0), b=st.floats(0.0, 10.0))
@settings(deadline=None, derandomize=True)
def test_more_steepness_forgets_faster(a, b):
    low, high = (basset.MeiAdrianKernel(slip, 1e-3, 1e-6) for slip in sorted((a, b)))
    s = np.geomspace(1e-6, 1e2, 9)
    assert np.all(high(s) <= low(s) * (1.0 + 64 * EPS))
    assert np.all(low(s) <= basset.BassetKernel()(s))


@every_kernel
@pytest.mark.parametrize("dt", [1e-9, 0.37, 1.0, 1e6])
def test_scaled_kernel_counts_in_steps(kernel, dt):
    s = np.geomspace(1e-3, 1e3, 13)
    # both sides carry the ~32 units of a value
    np.testing.assert_allclose(kernel.scaled(dt)(s) / np.sqrt(dt), kernel(s * dt), rtol=64 * EPS)


@every_kernel
def test_derivative_against_mpmath(kernel):
    s = np.array([1e-9, 1e-3, 0.5, 1.0, 40.0, 1e6])
    with mpmath.workdps(40):
        exact = [mpmath.diff(lambda x: exact_value(kernel, x), mpmath.mpf(x), h=mpmath.mpf(x) * mpmath.mpf(10) ** -15) for x in s]
        assert relative_error(kernel._derivatives(s), exact) <= 64 * EPS


INTERVALS = [(0.0, 1e-9), (0.0, 1.0), (0.0, 1e6), (1e-12, 1.0), (1e-3, 5.0), (1.0, 2.0), (100.0, 101.0), (1e6, 1e6 + 1.0), (1e8, 1e8 + 1.0)]


@every_kernel
@pytest.mark.parametrize(("near", "far"), INTERVALS)
def test_moments_against_closed_forms(kernel, near, far):
    # 20 positive terms, a node known to a unit raised to the 15th power: 64 units
    digits = 60 + int(16 * np.log10(max(near, 10.0)))
    assert relative_error(kernel.moments(near, far, 15), exact_moments(kernel, near, far, 15, digits)) <= 64 * EPS


@pytest.mark.parametrize(("near", "far"), [(0.0, 1e-300), (0.0, 1e300), (1e15, 1e15 + 1.0)])
def test_standard_moments_at_the_ends_of_the_range(near, far):
    kernel = basset.BassetKernel()
    assert relative_error(kernel.moments(near, far, 15), exact_moments(kernel, near, far, 15, 400)) <= 64 * EPS


@pytest.mark.parametrize("c1", [2.0, 2.5])
@pytest.mark.parametrize("steepness", [1e-6, 1.0, 1e6, 1e12, 1e30])
def test_moments_of_the_singular_panel_at_any_steepness(steepness, c1):
    kernel = kernel_of(steepness, c1)
    assert relative_error(kernel.moments(0.0, 1.0, 10), exact_moments(kernel, 0.0, 1.0, 10, 60)) <= 64 * EPS


@every_kernel
def test_moments_add_up(kernel):
    whole = kernel.moments(0.2, 5.0, 0)[0]
    assert kernel.moments(0.2, 1.7, 0)[0] + kernel.moments(1.7, 5.0, 0)[0] == pytest.approx(whole, rel=16 * EPS)


@every_kernel
def test_identity(kernel):
    again = pickle.loads(pickle.dumps(kernel))
    assert again == kernel
    assert hash(again) == hash(kernel)
    assert len({kernel, again}) == 1
    assert all(other != kernel for other in KERNELS.values() if other is not kernel)
    with pytest.raises(AttributeError):
        kernel.slip = 3.0


def test_scalar_and_array_and_integer_lags():
    kernel = basset.BassetKernel()
    assert isinstance(kernel(4), float)
    assert kernel(4) == 0.5
    assert kernel([[1, 4], [16, 25]]).tolist() == [[1.0, 0.5], [0.25, 0.2]]
    assert kernel([]).shape == (0,)
