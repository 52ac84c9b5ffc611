"""Sums of exponentials: the promised error is kept, by the fewest terms; the published sets are what was published."""

from __future__ import annotations

import math
import pickle
import re

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rule_cases import EPS, GRAIN
from scipy.optimize import minimize_scalar

import basset
from basset import ExponentialSum, reference
from basset.reference import integrals

BASSET = basset.BassetKernel()
ROUNDING = 16 * EPS  # of a sum of positive terms in double precision, and of its tabulated numbers
RATIOS = (1e2, 1e3, 3e4, 1e6, 1e9)
PROMISES = (1e-3, 1e-6, 1e-9, 1e-12)

# best possible maximum relative error: (far/near, terms) -> error, from an independent Remez computation in extended precision
LIMITS = {
    1e3: {6: 2.023e-3, 7: 6.167e-4, 12: 1.611e-6, 13: 4.912e-7, 18: 1.273e-9, 19: 3.880e-10, 24: 1.010e-12, 26: 9.350e-14},
    1e6: {12: 1.106e-3, 13: 5.802e-4, 22: 1.677e-6, 23: 8.762e-7, 33: 1.329e-9, 36: 1.896e-10, 43: 2.016e-12, 48: 7.854e-14},
    1e9: {17: 1.378e-3, 18: 8.829e-4, 23: 9.499e-5, 26: 2.480e-5, 33: 1.089e-6, 36: 2.862e-7, 48: 1.348e-9, 54: 9.265e-11, 59: 9.924e-12, 64: 1.065e-12},
}


def law(ratio: float, rtol: float) -> int:
    """Fewest terms by E ≈ 2.7 exp(−π² n / ln 4R)."""
    return math.ceil(math.log(2.7 / rtol) * math.log(4.0 * ratio) / math.pi**2)


def errors(s: ExponentialSum, lags: np.ndarray) -> np.ndarray:
    """sum/K − 1, from weights and rates alone."""
    return np.exp(-np.multiply.outer(lags, s.rates)) @ s.weights / s.kernel(lags) - 1.0


def measured(s: ExponentialSum, near: float, far: float, points: int = 2500) -> tuple[float, list[float]]:
    """Largest relative error on log-spaced lags and at every extremum, found by bounded minimisation; and where the extrema lie."""
    x = np.linspace(math.log(near), math.log(far), points)
    error = errors(s, np.exp(x))
    inner = np.flatnonzero((np.abs(error[1:-1]) >= np.abs(error[:-2])) & (np.abs(error[1:-1]) >= np.abs(error[2:]))) + 1
    worst, places = float(np.abs(error).max()), [near, far]
    for i in inner:
        top = minimize_scalar(lambda y: -abs(errors(s, np.array([math.exp(y)]))[0]), bounds=(x[i - 1], x[i + 1]), method="bounded", options={"xatol": 1e-6})
        worst = max(worst, -top.fun)
        places.append(math.exp(top.x))
    return worst, places


def error_digits(s: ExponentialSum, lag: float) -> float:
    """sum/K − 1 at one lag, evaluated in 40 digits from the numbers as they are stored."""
    with mpmath.workdps(40):
        time = mpmath.mpf(lag)
        total = mpmath.fsum(mpmath.mpf(float(a)) * mpmath.exp(-mpmath.mpf(float(r)) * time) for a, r in zip(s.weights, s.rates, strict=True))
        return float(total / integrals._value(time, s.kernel) - 1)


def fewest(terms: int, near: float, far: float) -> ExponentialSum:
    """The most accurate fitted sum with at most so many terms."""
    sums = (ExponentialSum.fit(near, far, 10.0 ** (-step / 4)) for step in range(2, 50))
    return [s for s in sums if len(s) <= terms][-1]


every_ratio = pytest.mark.parametrize("ratio", RATIOS, ids="R{:.0e}".format)
every_promise = pytest.mark.parametrize("rtol", PROMISES, ids="{:.0e}".format)


class TestTheFitKeepsItsPromise:
    @every_ratio
    @every_promise
    def test_everywhere(self, ratio, rtol):
        near = 0.37
        s = ExponentialSum.fit(near, near * ratio, rtol)
        worst, extrema = measured(s, near, near * ratio)
        assert worst <= rtol + ROUNDING
        # a minimax error has 2n+1 extrema of equal height: none was overlooked, and 40 digits agree at some of them
        assert len(extrema) > len(s)
        for lag in extrema[:: max(1, len(extrema) // 6)]:
            assert abs(error_digits(s, lag)) <= rtol + ROUNDING

    @every_ratio
    @every_promise
    def test_with_at_most_two_terms_more_than_the_law(self, ratio, rtol):
        assert len(ExponentialSum.fit(1.0, ratio, rtol)) <= law(ratio, rtol) + 2

    @pytest.mark.parametrize("ratio", LIMITS, ids="R{:.0e}".format)
    @every_promise
    def test_within_two_terms_of_the_limit_and_never_below(self, ratio, rtol):
        """No sum can do with fewer terms; the limits at R = 1e9 are tabulated to 64 terms."""
        enough = min((n for n, error in LIMITS[ratio].items() if error <= rtol * 1.07), default=None)
        assert enough is not None
        s = ExponentialSum.fit(1.0, ratio, rtol)
        too_few = max(n for n, error in LIMITS[ratio].items() if error > rtol * 1.07)
        assert too_few < len(s) <= enough + 2

    @pytest.mark.parametrize("ratio", LIMITS, ids="R{:.0e}".format)
    def test_measured_errors_meet_the_limits(self, ratio):
        """The measured error of the sums with that many terms is never better than the best possible one."""
        seen = 0
        for rtol in 10.0 ** -np.arange(2.5, 13.0, 0.5):
            s = ExponentialSum.fit(1.0, ratio, rtol)
            if len(s) in LIMITS[ratio]:
                seen += 1
                assert s.max_relative_error() >= LIMITS[ratio][len(s)] * 0.999 - ROUNDING  # limits are given to four digits
        assert seen >= 4

    @every_ratio
    @every_promise
    def test_max_relative_error_finds_the_maximum(self, ratio, rtol):
        s = ExponentialSum.fit(1.0, ratio, rtol)
        worst, _ = measured(s, 1.0, ratio)
        # both find each extremum to better than 1e-3 of its height, both see the same rounding
        assert abs(s.max_relative_error() - worst) <= 1e-3 * worst + ROUNDING
        assert s.max_relative_error(2.0, ratio / 3.0) <= s.max_relative_error() * (1.0 + 1e-3) + ROUNDING

    def test_max_relative_error_outside_is_large(self):
        s = ExponentialSum.fit(1.0, 100.0, 1e-6)
        assert s.max_relative_error(0.01, 1.0) > 0.1
        assert s.max_relative_error(100.0, 1e4) > 0.1
        assert s.max_relative_error(5.0, 5.0) == pytest.approx(abs(errors(s, np.array([5.0]))[0]), rel=1e-3, abs=ROUNDING)

    @every_ratio
    @every_promise
    def test_weights_and_rates_are_positive(self, ratio, rtol):
        s = ExponentialSum.fit(1.0, ratio, rtol)
        assert (s.weights > 0.0).all()
        assert (s.rates > 0.0).all()
        assert (np.diff(s.rates) > 0.0).all()
        assert s.weights.shape == s.rates.shape == (len(s),)

    @settings(deadline=None, derandomize=True, max_examples=150)
    @given(near=st.floats(-12.0, 12.0), decades=st.floats(1e-3, 12.0), digits=st.floats(0.05, 14.0))
    def test_or_says_which_accuracy_can_be_had(self, near, decades, digits):
        near, far, rtol = 10.0**near, 10.0 ** (near + decades), 10.0**-digits
        try:
            s = ExponentialSum.fit(near, far, rtol)
        except ValueError as refusal:
            stated = float(re.search(r"at least ([\d.e+-]+) for", str(refusal)).group(1))
            assert rtol < stated < 1.0
            # what cannot be had would need more than the 72 terms that are tabulated, or more digits than doubles have
            assert law(far / near, rtol) > 68 or rtol < 1e-13
            rtol, s = stated, ExponentialSum.fit(near, far, stated)
        assert s.rtol == rtol
        assert np.abs(errors(s, np.geomspace(near, far, 700)[1:-1])).max() <= rtol + ROUNDING

    @settings(deadline=None, derandomize=True, max_examples=60)
    @given(decades=st.floats(10.0, 12.0), digits=st.floats(10.0, 14.0))
    def test_what_it_says_can_be_had(self, decades, digits):
        """Where the table ends: the stated accuracy must not be rounded down."""
        far = 10.0**decades
        try:
            ExponentialSum.fit(1.0, far, 10.0**-digits)
        except ValueError as refusal:
            stated = float(re.search(r"at least ([\d.e+-]+) for", str(refusal)).group(1))
            assert ExponentialSum.fit(1.0, far, stated).max_relative_error() <= stated + ROUNDING

    @pytest.mark.parametrize("stretch", [2.0**-40, 1e-9, 0.3, 7.0, 1e6, 2.0**30])
    @pytest.mark.parametrize(("ratio", "rtol"), [(33.0, 1e-4), (1e5, 1e-9), (1e12, 1e-8)])
    def test_only_the_ratio_matters(self, stretch, ratio, rtol):
        s, stretched = ExponentialSum.fit(1.0, ratio, rtol), ExponentialSum.fit(stretch, ratio * stretch, rtol)
        np.testing.assert_allclose(stretched.rates, s.rates / stretch, rtol=ROUNDING)
        np.testing.assert_allclose(stretched.weights, s.weights / math.sqrt(stretch), rtol=ROUNDING)

    def test_more_digits_more_terms(self):
        lengths = [len(ExponentialSum.fit(1.0, 1e5, rtol)) for rtol in 10.0 ** -np.arange(1.0, 13.0)]
        assert lengths == sorted(set(lengths))

    def test_calls(self):
        s = ExponentialSum.fit(0.1, 10.0, 1e-8)
        lags = np.array([[0.1, 1.0, 10.0], [0.5, 2.0, 3.0]])
        assert s(lags).shape == lags.shape
        np.testing.assert_allclose(s(lags), lags**-0.5, rtol=1.01e-8)
        assert isinstance(s(1.0), float)
        assert s(1) == s(np.float32(1.0)) == s(lags)[0, 1]


FINITE = {
    "mei_adrian": lambda slip: basset.MeiAdrianKernel(**(GRAIN | {"slip": slip})),
    "dorgan_loth": lambda slip: basset.MeiAdrianKernel.dorgan_loth(**(GRAIN | {"slip": slip})),
}


class TestFiniteReynolds:
    every_kernel = pytest.mark.parametrize("make", FINITE.values(), ids=FINITE)

    @every_kernel
    @pytest.mark.parametrize(("x_near", "x_far"), [(1e-6, 1e-2), (1e-4, 1.0), (1e-3, 1e3), (0.1, 10.0), (1.0, 1e4)])
    @pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
    def test_the_promise(self, make, x_near, x_far, rtol):
        """Over both sides of the bend of the kernel at x = C^(2/3) s = 1."""
        kernel = make(0.1)
        stretch = kernel.steepness ** (2.0 / 3.0)
        near, far = x_near / stretch, x_far / stretch
        s = ExponentialSum.fit(near, far, rtol, kernel)
        worst, extrema = measured(s, near, far)
        assert worst <= rtol + ROUNDING
        assert (s.weights > 0.0).all()
        assert (s.rates > 0.0).all()
        for lag in extrema[:: max(1, len(extrema) // 3)]:
            assert abs(error_digits(s, lag)) <= rtol + ROUNDING

    @every_kernel
    @pytest.mark.parametrize("slip", [1e-3, 0.02, 1.0])
    def test_at_any_slip(self, make, slip):
        kernel = make(slip)
        s = ExponentialSum.fit(1e-4, 0.5, 1e-6, kernel)
        assert s.kernel == kernel
        assert measured(s, 1e-4, 0.5)[0] <= 1e-6 + ROUNDING

    @every_kernel
    def test_no_slip_is_the_standard_kernel(self, make):
        s, standard = ExponentialSum.fit(1e-3, 10.0, 1e-7, make(0.0)), ExponentialSum.fit(1e-3, 10.0, 1e-7)
        np.testing.assert_array_equal(s.weights, standard.weights)
        np.testing.assert_array_equal(s.rates, standard.rates)
        assert s.kernel == make(0.0)

    @pytest.mark.parametrize("c1", [1.0, 1.9, 3.0])
    def test_other_exponents_have_no_table(self, c1):
        kernel = basset.MeiAdrianKernel(**GRAIN, c1=c1)
        with pytest.raises(ValueError, match=rf"c1 must be 2 or 2.5 .*got {c1:g}"):
            ExponentialSum.fit(1e-3, 1.0, 1e-6, kernel)

    def test_a_range_beyond_the_table(self):
        kernel = FINITE["mei_adrian"](0.1)
        with pytest.raises(ValueError, match=r"far/near.*MeiAdrianKernel"):
            ExponentialSum.fit(1e-30, 1e30, 1e-3, kernel)

    @every_kernel
    @pytest.mark.parametrize("slip", [1e-15, 1e-9, 1e-7])
    def test_hardly_any_slip_is_fitted(self, make, slip):
        """Tables begin at a lag of 1e-12 C^(-2/3)."""
        tail = ExponentialSum.fit(5e-12, 0.05, 1e-8, make(slip))
        lags = np.geomspace(5e-12, 0.05, 4000)
        assert np.abs(tail(lags) / make(slip)(lags) - 1.0).max() <= 1.001e-8


class TestBadRequests:
    @pytest.mark.parametrize(("near", "far"), [(1.0, 1.0), (2.0, 1.0), (0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (1.0, math.inf)])
    def test_empty_or_endless_ranges(self, near, far):
        with pytest.raises(ValueError, match=r"^(near|far) must be .*got"):
            ExponentialSum.fit(near, far, 1e-6)

    @pytest.mark.parametrize("rtol", [0.0, -1e-3, 1.0, 2.0, math.nan])
    def test_impossible_promises(self, rtol):
        with pytest.raises(ValueError, match=r"^rtol must be .*got"):
            ExponentialSum.fit(1.0, 10.0, rtol)

    def test_too_long_a_range(self):
        with pytest.raises(ValueError, match=r"far.*1e\+?12"):
            ExponentialSum.fit(1.0, 1e13, 1e-3)

    def test_what_is_no_kernel(self):
        with pytest.raises(TypeError, match=r"kernel must be a kernel such as basset\.BassetKernel"):
            ExponentialSum.fit(1.0, 10.0, 1e-3, kernel="basset")

    @pytest.mark.parametrize(("weights", "rates"), [([1.0, -1.0], [1.0, 2.0]), ([1.0], [0.0]), ([math.nan], [1.0]), ([1.0], [math.inf])])
    def test_only_positive_terms(self, weights, rates):
        with pytest.raises(ValueError, match="weights and rates must be positive and finite"):
            ExponentialSum(np.array(weights), np.array(rates), 1.0, 2.0, BASSET)

    @pytest.mark.parametrize(("weights", "rates"), [([1.0], [1.0, 2.0]), ([], []), ([[1.0]], [[1.0]])])
    def test_as_many_weights_as_rates(self, weights, rates):
        with pytest.raises(ValueError, match="weights and rates must be one-dimensional and equally long"):
            ExponentialSum(np.array(weights), np.array(rates), 1.0, 2.0, BASSET)


class TestAsAValue:
    def test_equal_and_hashable(self):
        s, again, other = ExponentialSum.fit(1.0, 50.0, 1e-5), ExponentialSum.fit(1.0, 50.0, 1e-5), ExponentialSum.fit(1.0, 50.0, 1e-7)
        assert s == again
        assert hash(s) == hash(again)
        assert s != other
        assert s != ExponentialSum(s.weights, s.rates, s.near, 51.0, s.kernel)
        assert s != ExponentialSum(s.weights, s.rates, s.near, s.far, basset.MeiAdrianKernel(**GRAIN))
        assert s != "sum"
        assert {s: 1}[again] == 1
        assert basset.Windowed(basset.Daitche(2), 1.0, s) == basset.Windowed(basset.Daitche(2), 1.0, again)

    def test_pickled(self):
        s = ExponentialSum.fit(1e-3, 1.0, 1e-6, basset.MeiAdrianKernel(**GRAIN))
        again = pickle.loads(pickle.dumps(s))
        assert again == s
        assert again.rtol == s.rtol
        assert again(0.01) == s(0.01)

    def test_unpickled_arrays_are_read_only(self):
        assert not pickle.loads(pickle.dumps(ExponentialSum.fit(1.0, 9.0, 1e-3))).weights.flags.writeable

    @pytest.mark.parametrize("name", ["weights", "rates"])
    def test_arrays_are_read_only(self, name):
        with pytest.raises(ValueError, match="read-only"):
            getattr(ExponentialSum.fit(1.0, 50.0, 1e-5), name)[0] = 1.0

    def test_a_frozen_copy_of_what_is_given_in_ascending_order(self):
        weights, rates = np.array([1.0, 2.0, 3.0]), np.array([30.0, 10.0, 20.0])
        s = ExponentialSum(weights, rates, 1.0, 2.0, BASSET)
        weights[0] = rates[0] = 99.0
        assert s.rates.tolist() == [10.0, 20.0, 30.0]
        assert s.weights.tolist() == [2.0, 3.0, 1.0]
        with pytest.raises(AttributeError):
            s.near = 3.0


# first and last (a_i, t_i) of the sets as printed in the papers
VAN_HINSBERG = {0: (0.23477481312586, 0.1), 4: (0.32056200511938, 10.0), 9: (0.63661146557001, 50000.0)}
CASAS = {
    ("I2t", 1): {0: (0.938472443357, 1.430034055143)},
    ("I2t", 2): {0: (0.547059755163, 0.666683527541), 1: (0.844976749056, 8.342487240727)},
    ("I2t", 10): {0: (0.246702083145, 0.171137410203), 1: (0.246474944419, 0.469538455725)},
    ("I1", 1): {0: (1.046347992, 1.581186674)},
    ("I1", 3): {0: (0.440072204, 0.482318894), 1: (0.538287204, 3.324763126)},
}


def published(name: str, window: float) -> ExponentialSum:
    return ExponentialSum.van_hinsberg(window) if name == "van_hinsberg" else ExponentialSum.casas(window, 10, name)


class TestPublishedSets:
    @pytest.mark.parametrize("window", [1.0, 0.07, 40.0])
    @pytest.mark.parametrize(("norm", "terms", "printed"), [(*key, value) for key, value in CASAS.items()] + [(None, 10, VAN_HINSBERG)])
    def test_the_printed_numbers_in_the_printed_formula(self, norm, terms, printed, window):
        """K(s) ≈ Σ a √(e/t') exp(−s/2t'), t' = t·window; rates ascend as t descends."""
        s = ExponentialSum.van_hinsberg(window) if norm is None else ExponentialSum.casas(window, terms, norm)
        assert len(s) == terms
        for place, (a, t) in printed.items():
            scaled = t * window
            assert s.rates[terms - 1 - place] == pytest.approx(0.5 / scaled, rel=1e-14)
            assert s.weights[terms - 1 - place] == pytest.approx(a * math.sqrt(math.e / scaled), rel=1e-14)

    @pytest.mark.parametrize("norm", ["I2t", "I1"])
    def test_every_casas_set_is_there_and_longer_ones_are_better(self, norm):
        """In the mean over the first decades of lags."""
        lags = np.geomspace(1.0, 30.0, 400)
        means = []
        for terms in range(1, 11):
            s = ExponentialSum.casas(1.0, terms, norm)
            assert len(s) == terms
            assert s.near == 1.0
            assert s.far == math.inf
            assert s.rtol is None
            assert (s.weights > 0.0).all()
            means.append(np.abs(errors(s, lags)).mean())
        assert means == sorted(means, reverse=True)
        assert 0.4 < means[0] < 0.6  # one exponential cannot follow a power
        assert means[9] < 1e-3

    @pytest.mark.parametrize("name", ["van_hinsberg", "I2t", "I1"])
    def test_two_to_three_digits_whatever_the_window(self, name):
        for window in (0.1, 1.0, 3.0):
            s = published(name, window)
            assert 1e-3 < s.max_relative_error(window, 30.0 * window) < 3e-3
            assert 5e-3 < s.max_relative_error(window, 300.0 * window) < 1.5e-2

    def test_terms_and_norm_are_checked(self):
        for terms in (0, 11):
            with pytest.raises(ValueError, match="terms must be a whole number from 1 to 10"):
                ExponentialSum.casas(1.0, terms)
        with pytest.raises(ValueError, match="norm must be one of 'I2t', 'I1'"):
            ExponentialSum.casas(1.0, 3, "I2")
        for window in (0.0, -1.0, math.inf):
            with pytest.raises(ValueError, match="window must be"):
                ExponentialSum.van_hinsberg(window)


class TestForceOnTheCosine:
    """g = cos to T = 200 by Daitche(4), whose own error is below 1e-7 here: what is left is the tail's."""

    T, N = 200.0, 20000

    def error(self, window: float, tail: ExponentialSum) -> float:
        t = np.linspace(0.0, self.T, self.N + 1)
        H = basset.cumulate(np.cos(t), self.T / self.N, basset.Windowed(basset.Daitche(4), window, tail))
        return float(np.abs(H - reference.cosine(t)).max())

    @pytest.mark.parametrize(
        ("name", "window", "floor"),  # maxima over the path; the sets spread over 2e-3…5e-4 and 1.5e-3…1.6e-4
        [
            ("van_hinsberg", 0.1, 2.5e-3),
            ("van_hinsberg", 1.0, 1.9e-3),
            ("van_hinsberg", 3.0, 6.4e-4),
            ("I2t", 0.1, 1.6e-3),
            ("I2t", 1.0, 3.6e-4),
            ("I2t", 3.0, 1.7e-4),
        ],
    )
    def test_the_known_floors(self, name, window, floor):
        assert self.error(window, published(name, window)) == pytest.approx(floor, rel=0.05)  # two digits

    @pytest.mark.parametrize("window", [0.1, 0.3, 1.0, 3.0])
    def test_as_many_fitted_terms_are_ten_times_better(self, window):
        tail = fewest(10, window, self.T)
        assert len(tail) <= 10
        fitted = self.error(window, tail)
        for name in ("van_hinsberg", "I2t", "I1"):
            assert self.error(window, published(name, window)) >= 10.0 * fitted, name
        assert fitted <= tail.rtol * 2.0 * math.sqrt(self.T)  # rtol·∫K|g|

    @pytest.mark.parametrize("name", ["van_hinsberg", "I2t"])
    def test_a_published_floor_does_not_move_with_the_step(self, name):
        errors = []
        for n in (4000, 40000):
            t = np.linspace(0.0, self.T, n + 1)
            H = basset.cumulate(np.cos(t), self.T / n, basset.Windowed(basset.Daitche(4), 1.0, published(name, 1.0)))
            errors.append(np.abs(H - reference.cosine(t))[n // 2 :].max())
        assert errors[1] == pytest.approx(errors[0], rel=0.02)


WITH_TAIL = {
    "windowed": lambda tail: basset.Windowed(basset.Daitche(3), 1.0, tail),
    "hinsberg": lambda tail: basset.Hinsberg(1.0, tail),
}


class TestATailMustFit:
    each_rule = pytest.mark.parametrize("make", WITH_TAIL.values(), ids=WITH_TAIL)

    @each_rule
    def test_the_same_kernel(self, make):
        finite = basset.MeiAdrianKernel(**GRAIN)
        other = basset.MeiAdrianKernel(**(GRAIN | {"slip": 0.2}))
        stretch = finite.steepness ** (2.0 / 3.0)
        assert 1e-6 < stretch < 1e6
        for tail, kernel in (
            (ExponentialSum.fit(1.0, 100.0, 1e-6), finite),
            (ExponentialSum.fit(1.0, 100.0, 1e-3, finite), BASSET),
            (ExponentialSum.fit(1.0, 100.0, 1e-3, finite), other),
        ):
            with pytest.raises(ValueError, match=r"tail must be a sum for the kernel .*, got one for"):
                make(tail).plan(0.1, 50.0, kernel)

    @each_rule
    def test_from_the_window_on(self, make):
        with pytest.raises(ValueError, match=r"tail must begin at the window's end, 1 seconds, or before, got near = 1.2"):
            make(ExponentialSum.fit(1.2, 100.0, 1e-6)).plan(0.1, 50.0)

    @each_rule
    def test_to_the_horizon(self, make):
        tail = ExponentialSum.fit(1.0, 49.0, 1e-6)
        with pytest.raises(ValueError, match=r"tail must reach the horizon, 50 seconds, got far = 49"):
            make(tail).plan(0.1, 50.0)
        assert make(tail).plan(0.1, 49.0).steps == 490

    def test_weights_and_integrals_are_refused_too(self):
        rule = basset.Windowed(basset.Daitche(3), 1.0, ExponentialSum.fit(1.0, 4.0, 1e-6))
        g = np.ones(101)
        for use in (lambda: rule.weights(100, 0.1), lambda: basset.integrate(g, 0.1, rule), lambda: basset.cumulate(g, 0.1, rule)):
            with pytest.raises(ValueError, match="tail must reach the horizon, 10 seconds"):
                use()

    def test_a_published_tail_is_for_the_standard_kernel(self):
        with pytest.raises(ValueError, match=r"kernel must be BassetKernel\(\) for the published tail"):
            basset.Hinsberg(1.0).plan(0.1, 50.0, basset.MeiAdrianKernel(**GRAIN))

    def test_a_tail_is_a_sum(self):
        for tail in ("fitted", 3.0, True):
            with pytest.raises(TypeError, match="tail must be an ExponentialSum"):
                basset.Windowed(basset.Daitche(2), 1.0, tail)

    def test_the_window_holds_the_newest_stencil(self):
        rule = basset.Windowed(basset.Daitche(6), 0.3, ExponentialSum.fit(0.1, 100.0, 1e-6))
        with pytest.raises(ValueError, match="window must be at least 4 steps"):
            rule.plan(0.1, 50.0)
