"""integrate and cumulate: equal to each other, to the definition, and indifferent to layout, order and history of use."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from all_cases import each
from rule_cases import (
    EPS,
    KERNELS,
    RULES,
    accepts,
    any_rule,
    any_rule_and_input,
    every_rule,
    every_rule_and_input,
    full_rules_and_inputs,
    samples,
    windowed_rules_and_inputs,
)

import basset
from basset.problems import PROBLEMS
from basset.weights.polynomials import FAR
from basset.weights.table import TABLES, WeightTable, table

BASSET = basset.BassetKernel()
every_kernel = each("kernel", KERNELS.values())


def largest(H: np.ndarray) -> float:
    """max|H| over the nodes after the first, which an initial slip makes infinite."""
    return float(np.abs(H[1:]).max())


def degree(rule: basset.Rule) -> int:
    return getattr(rule.whole, "order", 2)


class TestCumulateIsIntegrateRowByRow:
    @every_rule_and_input
    @every_kernel
    def test_rows_across_all_regimes(self, make, input, kernel):
        """Start-up, interior, on both sides of the window's edge and of the switch far out."""
        dt, n = 1e-4, FAR + 60
        g = samples(n)
        for window in (37.4 * dt, (FAR + 20) * dt):
            rule = make(window)
            if not accepts(rule, kernel):
                continue
            H = basset.cumulate(g, dt, rule, kernel, input=input)
            for k in [*range(1, 45), 100, FAR - 2, FAR - 1, FAR, FAR + 1, FAR + 19, FAR + 20, FAR + 21, FAR + 22, n]:
                assert abs(H[k] - basset.integrate(g[: k + 1], dt, rule, kernel, input=input)) <= 1e-12 * largest(H), k

    @every_rule_and_input
    def test_short_histories(self, make, input):
        rule = make(0.7)
        for n in range(1, 2 * degree(rule) + 4):
            g = samples(n, seed=n)
            H = basset.cumulate(g, 0.1, rule, input=input)
            assert H.shape == g.shape
            for k in range(1, n + 1):
                assert abs(H[k] - basset.integrate(g[: k + 1], 0.1, rule, input=input)) <= 1e-12 * largest(H), (n, k)

    @every_rule
    def test_with_initial_slip(self, make):
        rule, g = make(0.9), samples(40, 3)
        slip = np.array([1.5, 0.0, -2.0])
        H = basset.cumulate(g, 0.1, rule, initial_slip=slip)
        for k in range(1, 41):
            expected = basset.integrate(g[: k + 1], 0.1, rule, initial_slip=slip)
            np.testing.assert_allclose(H[k], expected, rtol=0.0, atol=1e-12 * largest(H))

    @any_rule_and_input
    @each("shape", [(3,), (2, 3), (1, 1, 4), (0,), (2, 0)])
    def test_trailing_shapes(self, make, input, shape):
        rule, g = make(1.5), samples(60, *shape)
        H, last = basset.cumulate(g, 0.1, rule, input=input), basset.integrate(g, 0.1, rule, input=input)
        assert H.shape == g.shape
        assert last.shape == shape
        for index in np.ndindex(*shape):
            column = basset.cumulate(g[(slice(None), *index)], 0.1, rule, input=input)
            # the same products in another order of summation
            np.testing.assert_allclose(H[(slice(1, None), *index)], column[1:], rtol=0.0, atol=1e-12 * largest(column))
            assert abs(last[index] - column[-1]) <= 1e-12 * largest(column)

    @pytest.mark.parametrize("order", [1, 4, 8])
    def test_equal_to_the_direct_sum_at_65536(self, order):
        n = 2**16
        g = samples(n)
        rule = basset.Daitche(order)
        H = basset.cumulate(g, 1.0, rule)
        for k in [n, n - 1, n // 2, *np.random.default_rng(order).integers(1, n, 20)]:
            direct = rule.weights(int(k), 1.0) @ g[k::-1]
            assert abs(H[k] - direct) <= 1e-12 * largest(H)


class TestRowZero:
    @any_rule
    def test_is_zero_without_initial_slip(self, make):
        assert basset.cumulate(np.ones(30), 0.1, make(1.0))[0] == 0.0

    @any_rule
    def test_has_the_sign_of_the_initial_slip(self, make):
        H = basset.cumulate(samples(30, 4), 0.1, make(1.0), initial_slip=[1e-300, -1e-300, 0.0, -0.0])
        assert H[0].tolist() == [np.inf, -np.inf, 0.0, 0.0]
        assert np.isfinite(H[1:]).all()

    @every_rule_and_input
    def test_has_the_sign_of_the_first_slip_sample(self, make, input):
        if input == "rate":
            return
        g = samples(30, 3)
        g[0] = [2.0, -2.0, 0.0]
        H = basset.cumulate(g, 0.1, make(1.0), input="slip")
        assert H[0].tolist() == [np.inf, -np.inf, 0.0]
        assert np.isfinite(H[1:]).all()

    @any_rule
    def test_one_sample(self, make):
        assert basset.cumulate([3.0], 0.1, make(1.0)).tolist() == [0.0]
        assert basset.cumulate([3.0], 0.1, make(1.0), initial_slip=-1.0).tolist() == [-np.inf]


class TestNoWrapAround:
    @full_rules_and_inputs
    @each("n", [100, 511, 512, 1023, 1024, 1025, 4099])
    def test_impulse_in_the_last_sample(self, make, input, n):
        """Nothing may reach back: all rows before it are zero up to the rounding of the transform."""
        g = np.zeros(n + 1)
        g[n] = 1.0
        rule = make(0.0)
        weights = rule.weights(n, 1.0, input=input)
        H = basset.cumulate(g, 1.0, rule, input=input)
        rounding = EPS * np.log2(n) * np.linalg.norm(weights)
        assert np.abs(H[:n]).max() <= rounding
        assert abs(H[n] - weights[0]) <= rounding

    @full_rules_and_inputs
    def test_impulses_in_the_oldest_samples(self, make, input):
        """Row k is the weight of an oldest sample, however small: those are not computed by the transform."""
        rule, n = make(0.0), FAR + 188
        reach = rule.recipe(1.0, 1.0, BASSET).stencil.reach
        H = basset.cumulate(np.eye(n + 1)[:, :reach], 1.0, rule, input=input)
        promised = 2e-14 if rule.error_order <= 5.0 else 1e-13
        for k in [*range(1, 60), FAR - 1, *range(FAR, n, 17), n]:
            weights = rule.weights(k, 1.0, input=input)[k - min(k, reach - 1) :][::-1]
            lags = k - np.arange(len(weights), dtype=float)
            kernel = np.abs((BASSET._values if input == "rate" else BASSET._derivatives)(np.maximum(lags, 1.0)))
            # two ways to the same weight, each as good as promised
            assert np.all(np.abs(H[k, : len(weights)] - weights) <= 2 * promised * np.maximum(np.abs(weights), kernel)), k

    @windowed_rules_and_inputs
    def test_impulse_leaves_the_window(self, make, input):
        rule, n, at = make(2.0), 400, 100  # 20 steps
        g = np.zeros(n + 1)
        g[at] = 1.0
        H = basset.cumulate(g, 0.1, rule, input=input)
        weights = rule.weights(n, 0.1, input=input)
        rounding = 4 * EPS * np.log2(n) * np.linalg.norm(weights)
        assert np.abs(H[1:at]).max() <= rounding
        assert np.abs(H[at : at + 21] - weights[:21]).max() <= rounding
        assert np.abs(H[at + 21 :]).max() <= rounding


class TestLongTime:
    @pytest.mark.parametrize("name", ["euler_maclaurin", "brush", "semi_derivative", "hinsberg", "daitche_3", "daitche_8"])
    def test_the_error_does_not_grow_with_time(self, name):
        """t = 1e4π with 2^20 steps: the error of the same step at 50π + 1, plus rounding of nodes at 3e4."""
        long, short = PROBLEMS["fresnel_long"], PROBLEMS["fresnel_generic"]
        rule, n = RULES[name](0.0), 2**20
        m = round(short.end / (long.end / n))
        errors = []
        for problem, steps in ((long, n), (short, m)):
            t, _ = problem.grid(steps)
            H = basset.cumulate(rule=rule, **problem.arguments(steps))
            errors.append(np.abs(H[steps // 2 :] - problem.exact(t[steps // 2 :])).max())
        assert errors[0] <= 1.1 * errors[1] + EPS * long.end


class TestInvariants:
    @any_rule_and_input
    def test_scaling_the_samples_by_powers_of_two_is_exact(self, make, input):
        rule, g = make(2.0), samples(300)
        H = basset.cumulate(g, 0.1, rule, input=input)
        for factor in (-1.0, 2.0**-40, 2.0**60):
            assert np.array_equal(basset.cumulate(factor * g, 0.1, rule, input=input)[1:], factor * H[1:])

    @every_rule_and_input
    def test_stretching_time_by_four(self, make, input):
        """K is homogeneous: H on rates doubles, H on slips halves, bit for bit."""
        g = samples(300)
        H, stretched = (basset.cumulate(g, dt, make(20 * dt), input=input) for dt in (0.1, 0.4))
        assert np.array_equal(stretched[1:], H[1:] * (2.0 if input == "rate" else 0.5))

    @full_rules_and_inputs
    def test_rest_before_the_start_changes_nothing(self, make, input):
        """Samples that begin smoothly from rest: zeros in front are the same motion."""
        rule, dt, quiet = make(0.0), 0.05, 30
        g = np.zeros(260)
        x = np.linspace(0.0, 1.0, 201)[1:-1]
        g[quiet : quiet + 199] = np.exp(4.0 - 1.0 / (x * (1.0 - x)))
        norm = np.linalg.norm(rule.weights(len(g) - 1, dt, input=input)) * np.linalg.norm(g)
        H = basset.cumulate(g, dt, rule, input=input)
        for zeros in (1, 2, 57, 700):
            shifted = basset.cumulate(np.concatenate([np.zeros(zeros), g]), dt, rule, input=input)
            # interior weights do not know where the history began: only the transform's rounding differs
            tolerance = 2 * EPS * np.log2(len(shifted)) * norm
            np.testing.assert_allclose(shifted[zeros + 1 :], H[1:], rtol=0.0, atol=tolerance)

    @pytest.mark.parametrize("name", ["euler_maclaurin", "semi_derivative", "hinsberg"])
    @every_kernel
    def test_more_rate_more_force(self, name, kernel):
        """Where all weights are positive, H is monotone in the samples; a faster forgetting gives less."""
        rule = RULES[name](0.0)
        if not accepts(rule, kernel):
            return
        g = np.abs(samples(300))
        H = basset.cumulate(g, 1e-4, rule, kernel)
        assert np.all(H[1:] >= 0.0)
        assert np.all(basset.cumulate(g + 0.5, 1e-4, rule, kernel)[1:] >= H[1:])
        assert np.all(H[1:] <= basset.cumulate(g, 1e-4, rule)[1:] * (1.0 + 1e-12))


class TestSamples:
    g = np.round(samples(80, 2) * 4.0)  # small whole numbers: the same in every dtype

    def variants(self) -> dict[str, object]:
        g = self.g
        strided = np.zeros((162, 6))
        strided[::2, ::3] = g
        reversed_ = np.ascontiguousarray(g[::-1, ::-1])
        locked = g.copy()
        locked.flags.writeable = False
        return {
            "float32": g.astype(np.float32),
            "float16": g.astype(np.float16),
            "longdouble": g.astype(np.longdouble),
            "int8": g.astype(np.int8),
            "int64": g.astype(np.int64),
            "list": g.astype(int).tolist(),
            "tuple": tuple(map(tuple, g.tolist())),
            "strided": strided[::2, ::3],
            "negative strides": reversed_[::-1, ::-1],
            "fortran": np.asfortranarray(g),
            "read-only": locked,
            "big-endian": g.astype(">f8"),
            "big-endian int": g.astype(">i4"),
            "object": g.astype(object),
            "broadcast": np.broadcast_to(g[:, :1], (81, 2)) if np.array_equal(g[:, 0], g[:, 1]) else g,
        }

    @any_rule_and_input
    def test_any_layout_gives_the_float64_answer(self, make, input):
        rule = make(2.0)
        H, last = basset.cumulate(self.g, 0.1, rule, input=input), basset.integrate(self.g, 0.1, rule, input=input)
        for name, variant in self.variants().items():
            before = np.array(variant, copy=True)
            ours, end = basset.cumulate(variant, 0.1, rule, input=input), basset.integrate(variant, 0.1, rule, input=input)
            assert ours.dtype == end.dtype == np.float64
            # another layout may take another summation order
            np.testing.assert_allclose(ours[1:], H[1:], rtol=0.0, atol=1e-13 * largest(H), err_msg=name)
            np.testing.assert_allclose(end, last, rtol=0.0, atol=1e-13 * largest(H), err_msg=name)
            assert np.array_equal(np.array(variant), before), name

    @any_rule_and_input
    def test_the_callers_array_is_not_modified_nor_shared(self, make, input):
        g = self.g.copy()
        H, last = basset.cumulate(g, 0.1, make(2.0), input=input), basset.integrate(g, 0.1, make(2.0), input=input)
        assert np.array_equal(g, self.g)
        assert not np.shares_memory(H, g)
        kept = last.copy()
        H[:] = np.nan
        assert np.array_equal(basset.integrate(g, 0.1, make(2.0), input=input), kept)

    def test_float32_samples_are_summed_in_float64(self):
        n = 10**5
        g = np.full(n + 1, np.float32(0.1))
        exact = 2.0 * np.sqrt(n) * float(np.float32(0.1))
        assert basset.integrate(g, 1.0, basset.Daitche(1)) == pytest.approx(exact, rel=1e-13)

    def test_initial_slip_of_any_layout(self):
        g, rule = samples(30, 2), basset.Daitche(2)
        expected = basset.cumulate(g, 0.1, rule, initial_slip=np.array([1.0, -2.0]))
        for slip in ([1, -2], (1.0, -2.0), np.array([1, -2], dtype=np.int8), np.array([1.0, 9.0, -2.0])[::2]):
            assert np.array_equal(basset.cumulate(g, 0.1, rule, initial_slip=slip), expected)

    def test_scalar_result_for_scalar_samples(self):
        assert np.ndim(basset.integrate([1.0, 2.0], 0.1, basset.Daitche(1))) == 0
        assert isinstance(basset.integrate([1.0, 2.0], 0.1, basset.Daitche(1)), np.float64)


class TestRuleByName:
    @pytest.mark.parametrize("name", ["semi_derivative", "euler_maclaurin", "brush", "daitche"])
    def test_a_name_is_the_scheme_with_its_defaults(self, name):
        g = samples(50)
        assert basset.integrate(g, 0.1, name) == basset.integrate(g, 0.1, basset.SCHEMES[name]())


@pytest.fixture
def empty_cache():
    """An empty cache of weights, with its limit restored afterwards."""
    limit = TABLES.limit
    TABLES.clear()
    yield TABLES
    TABLES.limit = limit
    TABLES.clear()


class TestCache:
    @every_rule_and_input
    @every_kernel
    def test_a_cold_cache_gives_the_same_bits(self, make, input, kernel, empty_cache):
        rule, g = make(0.002), samples(700)
        if not accepts(rule, kernel):
            return
        basset.cumulate(samples(3000), 1e-5, rule, kernel, input=input)  # a longer table than needed
        warm = basset.cumulate(g, 1e-5, rule, kernel, input=input), basset.integrate(g, 1e-5, rule, kernel, input=input)
        empty_cache.clear()
        cold = basset.cumulate(g, 1e-5, rule, kernel, input=input), basset.integrate(g, 1e-5, rule, kernel, input=input)
        assert np.array_equal(warm[0], cold[0])
        assert warm[1] == cold[1]

    @every_rule_and_input
    @every_kernel
    def test_a_grown_prefix_has_the_bits_of_a_cold_build(self, make, input, kernel, empty_cache):
        rule = make(1e9)
        if not accepts(rule, kernel):
            return
        sizes = (1, 3, 21, 100, FAR - 1, FAR, FAR + 1, FAR + 9, 777, 5000, 70_001)
        grown = [rule.weights(n, 1e-5, kernel, input) for n in sizes]
        for n, weights in zip(sizes, grown, strict=True):
            empty_cache.clear()
            assert np.array_equal(rule.weights(n, 1e-5, kernel, input), weights), n

    def test_the_standard_kernel_shares_one_table_between_steps(self, empty_cache):
        built = []
        rule = basset.Daitche(3)
        for dt in (1e-3, 0.5, 7.0):
            rule.weights(5000, dt)
            built.append(empty_cache.nbytes)
        assert built[0] == built[1] == built[2]

    @each("use", ["integrate", "cumulate", "weights"])
    def test_keeps_its_limit(self, use, empty_cache):
        """Many kernels, one after the other: each use leaves at most `limit` bytes behind."""
        empty_cache.limit = 200_000
        g = samples(1000)
        calls = {
            "integrate": lambda kernel: basset.integrate(g, 1e-3, basset.Daitche(2), kernel),
            "cumulate": lambda kernel: basset.cumulate(g, 1e-3, basset.Daitche(2), kernel),
            "weights": lambda kernel: basset.Daitche(2).weights(1000, 1e-3, kernel),
        }
        for slip in np.linspace(0.01, 0.5, 60):
            calls[use](basset.MeiAdrianKernel(float(slip), 1e-3, 1e-6))
            assert empty_cache.nbytes <= empty_cache.limit

    def test_an_entry_above_the_limit_is_used_and_dropped(self, empty_cache):
        expected = basset.Daitche(2).weights(5000, 0.1)
        empty_cache.clear()
        empty_cache.limit = 1000
        assert np.array_equal(basset.Daitche(2).weights(5000, 0.1), expected)
        assert empty_cache.nbytes <= 1000

    def test_the_least_recently_used_goes_first(self, empty_cache):
        rules = [basset.Daitche(p) for p in (1, 2, 3)]
        stencils = [rule.recipe(1.0, 1.0, BASSET).stencil for rule in rules]
        for rule in rules:
            rule.weights(1000, 1.0)
        one = table(stencils[0], BASSET, "rate").nbytes  # and 1 is the newest now
        empty_cache.limit = int(2.5 * one)
        empty_cache.trim()
        kept = [table(stencils[i], BASSET, "rate").nbytes > 0 for i in (0, 2, 1)]
        assert kept == [True, True, False]

    def test_many_lengths_do_not_pile_up(self, empty_cache):
        """One row of oldest weights per length is remembered, but not for ever."""
        g, rule = samples(3 * WeightTable.remembered_rows), basset.Daitche(1)
        for n in range(1, len(g)):
            basset.integrate(g[: n + 1], 1.0, rule)
        rows = 8 * (rule.order + 1) * WeightTable.remembered_rows
        assert empty_cache.nbytes <= 8 * 2 * len(g) + rows

    def test_threads_get_the_same_answer(self, empty_cache):
        g = samples(3000)
        expected = {p: (basset.integrate(g, 0.1, basset.Daitche(p)), basset.cumulate(g, 0.1, basset.Daitche(p))) for p in (1, 4, 8)}
        empty_cache.clear()
        wrong: list[int] = []
        barrier = threading.Barrier(8)

        def work(seed: int) -> None:
            barrier.wait()
            for n in np.random.default_rng(seed).integers(500, 3000, 10):  # grow the table in many orders
                for p in (1, 4, 8):
                    basset.integrate(g[: n + 1], 0.1, basset.Daitche(p))
            for p, (last, path) in expected.items():
                if basset.integrate(g, 0.1, basset.Daitche(p)) != last or not np.array_equal(basset.cumulate(g, 0.1, basset.Daitche(p)), path):
                    wrong.append(p)

        threads = [threading.Thread(target=work, args=(seed,)) for seed in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert not wrong
