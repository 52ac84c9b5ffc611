"""The rules: declared orders, exactness, floors, the thesis's benchmark, hard starts, finite windows."""

from __future__ import annotations

import math
from functools import cache

import mpmath
import numpy as np
import pytest
from rule_cases import (
    EPS,
    FITTED,
    KERNELS,
    ORDERS,
    accepts,
    any_rule,
    full_rules,
    full_rules_and_inputs,
    tailed_rules,
    windowed_rules,
    windowed_rules_and_inputs,
)

import basset
from basset import reference
from basset.measure import observed_orders
from basset.problems import PROBLEMS, Problem, tagged

pytestmark = pytest.mark.analytic

FRESNEL = PROBLEMS["fresnel"]
THESIS = 1.25306020134666323776267517398  # I at the double next to 50π


def declared(rule: basset.Rule, input: str) -> float:
    """The exponent of the step: p+1 on rates, half an order less where the interpolant is differentiated."""
    differentiates = input == "slip" and isinstance(rule.whole, basset.Daitche)
    return rule.error_order - (0.5 if differentiates else 0.0)


def path_errors(rule: basset.Rule, problem: Problem, input: str, levels: range) -> tuple[np.ndarray, np.ndarray, float]:
    """(steps, errors, floor): the maximum over the second half of the path for 2^level steps.

    The floor is what rounding leaves: nodes near t are known to EPS·t, and so are the samples; differentiating weights
    amplify the latter by their norm ~ h^(-1/2).
    """
    steps, errors = [], []
    for level in levels:
        n = 2**level
        t, dt = problem.grid(n)
        late = slice(n // 2, None)
        H = basset.cumulate(rule=rule, **problem.arguments(n, input))
        steps.append(dt)
        errors.append(np.abs(H[late] - problem.exact(t[late])).max())
    floor = EPS * problem.end * max(1.0, float(np.linalg.norm(rule.weights(n, dt, input=input))))
    return np.array(steps), np.array(errors), floor


def last_slope(steps: np.ndarray, errors: np.ndarray, floor: float) -> float:
    """The slope between the two finest steps whose errors are above 100 × the floor."""
    above = np.flatnonzero(errors > 100.0 * floor)
    assert len(above) >= 2, "the errors are at the floor from the start: take coarser steps"
    fine = above[-1]
    return float(observed_orders(steps[fine - 1 : fine + 1], errors[fine - 1 : fine + 1])[0])


class TestDeclaredOrder:
    @full_rules_and_inputs
    @pytest.mark.parametrize("name", ["fresnel_generic", "sine_with_slip"])
    def test_every_rule_has_its_order(self, make, input, name):
        rule = make(0.0)
        order = declared(rule, input)
        steps, errors, floor = path_errors(rule, PROBLEMS[name], input, range(5, 17))
        slope = last_slope(steps, errors, floor)
        assert slope >= order - 0.25
        if rule.error_order <= 4.0 and not isinstance(rule, basset.Brush):  # the low orders are not understated either
            assert slope <= order + 0.25

    @full_rules_and_inputs
    def test_rules_that_reach_their_floor_stay_there(self, make, input):
        rule = make(0.0)
        if rule.error_order < 7.0:
            return  # not at the floor at this step
        _, errors, floor = path_errors(rule, PROBLEMS["sine_with_slip"], input, range(13, 16))
        assert errors.max() <= floor

    @pytest.mark.parametrize(
        ("rule", "order"), [(basset.EulerMaclaurin(), 0.5), (basset.Brush(), 0.5), (basset.NewtonCotes(), 0.5), (basset.SemiDerivative(), 1.0)]
    )
    def test_baselines(self, rule, order):
        assert rule.error_order == order
        steps, errors, _ = path_errors(rule, PROBLEMS["sine_with_slip"], "rate", range(15, 19))
        # the next term is half an order up: below 0.02 at these steps
        np.testing.assert_allclose(observed_orders(steps, errors), order, atol=0.02)

    @pytest.mark.parametrize(
        ("rule", "constant"), [(basset.EulerMaclaurin(), float(mpmath.zeta(0.5, 0.5))), (basset.NewtonCotes(), float(mpmath.zeta(0.5)) + 0.5)]
    )
    def test_the_error_of_open_rules_is_that_of_the_zeta_function(self, rule, constant):
        """Error → constant·√h g(t): what a sum over k^(−1/2) is off from its integral."""
        t, errors = 50.0 * np.pi + 1.0, []
        for n in (2**16, 2**18):
            g = np.cos(np.linspace(0.0, t, n + 1))
            errors.append((basset.integrate(g, t / n, rule) - float(reference.cosine(t))) / (math.sqrt(t / n) * g[-1]))
        assert abs(2.0 * errors[1] - errors[0] - constant) < 1e-3  # the next term is half an order up

    @pytest.mark.parametrize("name", ["decay", "growth", "high_frequency"])
    @full_rules
    def test_other_smooth_problems(self, make, name):
        rule, problem = make(0.0), PROBLEMS[name]
        coarsest = 12 if rule.error_order < 2.0 else 7 if "oscillating" in problem.tags else 4
        steps, errors, floor = path_errors(rule, problem, "rate", range(coarsest, coarsest + 8))
        size = float(np.abs(problem.exact(problem.grid(64)[0][32:])).max())
        # where a high degree meets its floor at steps of 0.3 the next term of the error is still worth that much
        assert last_slope(steps, errors / size, floor) >= rule.error_order - 0.25 - (steps[1] if coarsest == 4 else 0.0)

    def test_hidden_curvature_flatters_linear_slips_at_50_pi_only(self):
        """f'' = 0 at the thesis's time hides the h^(3/2) term there: the path sees an error ten times as large."""
        rule = basset.Daitche(1)
        at_end = abs(basset.integrate(rule=rule, **FRESNEL.arguments(4096, "slip")) - FRESNEL.exact(FRESNEL.end))
        _, path, _ = path_errors(rule, FRESNEL, "slip", range(12, 13))
        assert path[0] > 10.0 * at_end


@cache
def late_errors(order: int) -> tuple[float, ...]:
    """Error at t = 50π for N = 2^8 … 2^20."""
    errors = []
    for level in range(8, 21):
        errors.append(abs(float(basset.integrate(rule=basset.Daitche(order), **FRESNEL.arguments(2**level))) - THESIS))
    return tuple(errors)


class TestFresnel:
    def test_the_number(self):
        assert abs(float(FRESNEL.exact(FRESNEL.end)) - THESIS) <= 32 * EPS  # a dozen roundings of terms up to √(2π)

    @pytest.mark.parametrize(("order", "n", "bound"), [(8, 1024, 2e-10), (8, 4096, 5e-15), (4, 65536, 1e-14)])
    def test_promised_errors(self, order, n, bound):
        H = basset.integrate(rule=basset.Daitche(order), **FRESNEL.arguments(n))
        assert abs(H - THESIS) <= bound

    @pytest.mark.parametrize("order", [p for p in ORDERS if p >= 3])
    def test_never_rises_again(self, order):
        errors = np.array(late_errors(order))
        reached = np.flatnonzero(errors <= 1e-12)
        assert len(reached), "2^20 steps are enough for degree 3 and up"
        assert np.all(errors[reached[0] :] <= 1e-12)

    @pytest.mark.parametrize(("order", "n", "measured"), [(1, 4096, 1.4e-4), (3, 1024, 6.0e-6), (3, 4096, 8.9e-9), (4, 4096, 7.1e-10)])
    def test_known_errors(self, order, n, measured):
        """The table these weights were first measured with."""
        H = basset.integrate(rule=basset.Daitche(order), **FRESNEL.arguments(n))
        assert abs(H - THESIS) == pytest.approx(measured, rel=0.1)


class TestExactness:
    @pytest.mark.parametrize("order", ORDERS)
    def test_powers_up_to_the_degree(self, order):
        for n in sorted({*range(1, order), order, 2 * order, 2 * order + 1, 40, 700}):
            for problem in tagged("polynomial"):
                k = int(problem.name.removeprefix("power_"))
                if k > min(n, order):
                    continue
                exact = float(problem.exact(problem.end))
                assert abs(basset.integrate(rule=basset.Daitche(order), **problem.arguments(n)) / exact - 1.0) <= 1e-13, (n, k)

    @pytest.mark.parametrize("order", ORDERS)
    def test_powers_at_every_node(self, order):
        problem = PROBLEMS[f"power_{order}"]
        t, _ = problem.grid(700)
        H = basset.cumulate(rule=basset.Daitche(order), **problem.arguments(700))
        start = order  # before that the degree is the number of steps
        np.testing.assert_allclose(H[start:], problem.exact(t[start:]), rtol=0.0, atol=1e-13 * problem.exact(problem.end))

    @pytest.mark.parametrize("order", ORDERS)
    def test_the_degree_is_not_understated(self, order):
        """τ^(p+1) is not integrated exactly: the rule is no other rule in disguise."""
        n = 2 * order
        t = np.linspace(0.0, 1.0, n + 1)
        error = basset.integrate(t ** (order + 1), 1.0 / n, basset.Daitche(order)) / reference.power(1.0, order + 1) - 1.0
        assert abs(error) > 1e-12

    @pytest.mark.parametrize("name", KERNELS)
    @pytest.mark.parametrize("order", ORDERS)
    def test_powers_with_any_kernel(self, order, name):
        """In the lag s: ∫_0^T K(s) (s/T)^k ds is a moment of the kernel."""
        kernel, n, dt = KERNELS[name], 50, 1e-4
        moments = kernel.moments(0.0, n * dt, order)
        for k in range(order + 1):
            g = (np.arange(n, -1.0, -1.0) / n) ** k
            assert abs(basset.integrate(g, dt, basset.Daitche(order), kernel) / moments[k] - 1.0) <= 1e-13, k

    @pytest.mark.parametrize("order", ORDERS)
    def test_slip_powers_up_to_the_degree(self, order):
        """With slip samples f = τ^k, k ≤ p: d/dt ∫K f = k B(1/2, k) t^(k−1/2)."""
        for n in sorted({*range(1, order), order, 2 * order, 2 * order + 1, 40, 700}):
            t = np.linspace(0.0, 1.0, n + 1)
            rule = basset.Daitche(order)
            # differentiating weights: rounding of samples of size 1 through weights of norm ~ √n
            amplification = np.abs(rule.weights(n, 1.0 / n, input="slip")).sum()
            for k in range(1, min(n, order) + 1):
                exact = float(reference.power_slip(1.0, k))
                H = basset.integrate(t**k, 1.0 / n, rule, input="slip")
                assert abs(H - exact) <= 1e-14 * (amplification + exact) + 1e-13 * exact, (n, k)


class TestStarts:
    @full_rules
    @pytest.mark.parametrize("name", KERNELS)
    def test_step_is_the_kernel(self, make, name):
        rule, kernel = make(0.0), KERNELS[name]
        if not accepts(rule, kernel):
            return
        H = basset.cumulate(np.zeros((41, 2)), 1e-4, rule, kernel, initial_slip=[2.0, -3.0])
        t = 1e-4 * np.arange(1, 41)
        np.testing.assert_allclose(H[1:], kernel(t)[:, None] * [2.0, -3.0], rtol=2 * EPS)

    @full_rules_and_inputs
    def test_root_of_time(self, make, input):
        """f = √τ on slip samples: π/2 at a fixed time, to order 3/2 for every rule, the documented limit."""
        if input == "rate":
            with pytest.raises(ValueError, match=r"problem root has no finite rate at t = 0: use input='slip'"):
                PROBLEMS["root"].arguments(8, input)
            return
        problem, rule = PROBLEMS["root"], make(0.0)
        levels = range(8, 15)
        errors = [abs(float(basset.integrate(rule=rule, **problem.arguments(2**level, "slip"))) - np.pi / 2) for level in levels]
        slopes = observed_orders([problem.end / 2**level for level in levels], errors)
        np.testing.assert_allclose(slopes, 1.5, atol=0.1)
        assert errors[-1] < 1e-6

    @pytest.mark.parametrize("order", ORDERS)
    def test_split_off_the_jump_and_the_order_is_kept(self, order):
        """f = cos has f(0) = 1: left out, H is wrong by 1/√t; given, the order is the rule's."""
        problem = PROBLEMS["sine_with_slip"]
        arguments = problem.arguments(1024)
        with_jump = basset.integrate(rule=basset.Daitche(order), **arguments)
        without = basset.integrate(rule=basset.Daitche(order), **{**arguments, "initial_slip": 0.0})
        assert with_jump - without == pytest.approx(problem.end**-0.5, rel=1e-13)

    @pytest.mark.parametrize("order", ORDERS)
    def test_slips_and_rates_meet(self, order):
        """The two inputs of the same smooth motion, initial slip counted by both."""
        problem, rule = PROBLEMS["sine_with_slip"], basset.Daitche(order)
        n = 2**13
        rate, slip = (basset.integrate(rule=rule, **problem.arguments(n, input)) for input in ("rate", "slip"))
        _, errors, floor = path_errors(rule, problem, "slip", range(13, 14))
        assert abs(rate - slip) <= 2.0 * errors[0] + floor


class TestSemiDerivative:
    @pytest.mark.parametrize("input", ["rate", "slip"])
    @pytest.mark.parametrize("name", ["mei_adrian", "dorgan_loth"])
    def test_refuses_other_kernels_and_says_why(self, input, name):
        with pytest.raises(ValueError, match=r"kernel must be BassetKernel\(\) for SemiDerivative, got MeiAdrianKernel: .*order 1/2.* no other kernel"):
            basset.integrate(np.ones(4), 0.1, basset.SemiDerivative(), KERNELS[name], input=input)
        with pytest.raises(ValueError, match="no other kernel"):
            basset.cumulate(np.ones(4), 0.1, basset.SemiDerivative(), KERNELS[name], input=input)
        with pytest.raises(ValueError, match="no other kernel"):
            basset.SemiDerivative().weights(4, 0.1, KERNELS[name], input)

    def test_twice_is_the_derivative(self):
        """D^(1/2) D^(1/2) f = f': H[H] = π (f(t) − f(0)) on rates applied twice; exact for the series itself."""
        g = np.random.default_rng(3).standard_normal(300)
        g[0] = 0.0  # the series as published leaves the oldest sample out
        rule, dt = basset.SemiDerivative(), 0.01
        twice = basset.cumulate(basset.cumulate(g, dt, rule), dt, rule)
        integral = np.pi * dt * np.cumsum(g)
        np.testing.assert_allclose(twice, integral, atol=300 * EPS * np.abs(integral).max())

    def test_dissipates(self):
        """∫H g dt ≥ 0 for any motion: the generating function has a positive real part."""
        for seed in range(20):
            g = np.random.default_rng(seed).standard_normal(200)
            g[0] = 0.0
            assert basset.cumulate(g, 0.1, basset.SemiDerivative()) @ g > 0.0


def windowed_cosine(t: np.ndarray, window: float) -> np.ndarray:
    """∫_0^W s^(-1/2) cos(t−s) ds, from the full integrals of cos and sin at t = W."""
    cosine, sine = reference.cosine(window), reference.sine(window)
    a = np.cos(window) * cosine + np.sin(window) * sine
    b = np.sin(window) * cosine - np.cos(window) * sine
    return np.cos(t) * a + np.sin(t) * b


class TestWindowed:
    @windowed_rules_and_inputs
    def test_has_its_order_towards_the_windowed_integral(self, make, input):
        problem = PROBLEMS["fresnel_generic"]
        window = problem.end / 16.0
        rule = make(window)
        steps, errors = [], []
        for level in range(7, 17):
            n = 2**level
            t, dt = problem.grid(n)
            late = slice(n // 2, None)
            H = basset.cumulate(rule=rule, **problem.arguments(n, input))
            steps.append(dt)
            errors.append(np.abs(H[late] - windowed_cosine(t[late], window)).max())
        floor = EPS * problem.end * max(1.0, float(np.linalg.norm(rule.weights(n, dt, input=input))))
        assert last_slope(np.array(steps), np.array(errors), floor) >= declared(rule, input) - 0.25

    @windowed_rules_and_inputs
    def test_is_the_full_rule_while_the_window_is_not_full(self, make, input):
        g = np.random.default_rng(5).standard_normal((61, 2))
        rule = make(6.0)  # 60 steps
        H, full = (basset.cumulate(g, 0.1, r, input=input) for r in (rule, rule.whole))
        assert np.array_equal(H, full)
        assert np.array_equal(rule.weights(60, 0.1, input=input), rule.whole.weights(60, 0.1, input=input))

    @windowed_rules_and_inputs
    def test_does_not_read_what_is_older(self, make, input):
        g = np.random.default_rng(6).standard_normal(200)
        rule = make(2.0)  # 20 steps
        expected = basset.integrate(g, 0.1, rule, input=input)
        poisoned = g.copy()
        poisoned[: 199 - 20] = np.nan
        assert basset.integrate(poisoned, 0.1, rule, input=input) == expected
        poisoned[199 - 20] = np.nan
        if rule.weights(199, 0.1, input=input)[20] != 0.0:
            with pytest.raises(ValueError, match=r"g must be finite, got nan in sample 179"):
                basset.integrate(poisoned, 0.1, rule, input=input)
        assert np.all(rule.weights(199, 0.1, input=input)[21:] == 0.0)

    @windowed_rules
    def test_forgets_the_initial_slip(self, make):
        rule = make(1.0)  # 10 steps
        H = basset.cumulate(np.zeros(30), 0.1, rule, initial_slip=-2.0)
        assert H[0] == -np.inf
        assert np.all(H[1:11] < 0.0)
        assert np.all(H[11:] == 0.0)
        assert basset.integrate(np.zeros(11), 0.1, rule, initial_slip=-2.0) == H[10]
        assert basset.integrate(np.zeros(12), 0.1, rule, initial_slip=-2.0) == 0.0

    @windowed_rules_and_inputs
    def test_a_constant_slip_is_forgotten(self, make, input):
        """f = 1 since long before the window: nothing is left of its jump, to each rule's own error."""
        if input == "rate":
            return
        rule = make(2.0)
        H = basset.cumulate(np.ones(300), 0.1, rule, input=input)
        first_order = isinstance(rule.whole, basset.SemiDerivative)
        size = np.abs(rule.weights(299, 0.1, input=input)).sum()
        # Grünwald's series misses K(W) by a share of 1/(steps of the window)
        assert np.abs(H[21:]).max() <= (2.0**-0.5 / 20.0 if first_order else 1e-14 * size)

    @pytest.mark.parametrize("order", ORDERS)
    @pytest.mark.parametrize("name", KERNELS)
    def test_exact_on_windowed_polynomials(self, order, name):
        kernel, dt, steps = KERNELS[name], 1e-4, 30
        rule = basset.Windowed(basset.Daitche(order), steps * dt)
        moments = kernel.moments(0.0, steps * dt, order)
        for k in range(order + 1):
            g = (np.arange(99, -1.0, -1.0) / steps) ** k  # (s/W)^k, growing far beyond the window
            assert abs(basset.integrate(g, dt, rule, kernel) / moments[k] - 1.0) <= 1e-13, k

    def test_the_dropped_part_does_not_shrink_with_the_step(self):
        problem = PROBLEMS["fresnel_generic"]
        rule = basset.Windowed(basset.Daitche(4), 10.0)
        errors = [abs(basset.integrate(rule=rule, **problem.arguments(n)) - problem.exact(problem.end)) for n in (4096, 16384)]
        assert errors[0] == pytest.approx(errors[1], rel=0.05)
        assert errors[1] > 1e-3

    @windowed_rules
    def test_window_is_rounded_to_whole_steps(self, make):
        g = np.random.default_rng(7).standard_normal(60)
        expected = basset.integrate(g, 0.1, make(2.0))
        for window in (2.0 - 0.04, 2.0 + 0.04, 2.0 * (1.0 + EPS)):
            assert basset.integrate(g, 0.1, make(window)) == expected
        assert basset.integrate(g, 0.1, make(2.1)) != expected

    @windowed_rules
    def test_one_step_is_the_shortest_window(self, make):
        g = np.random.default_rng(8).standard_normal(9)
        weights = make(0.1).weights(8, 0.1)
        assert np.all(weights[2:] == 0.0)
        assert basset.integrate(g, 0.1, make(0.1)) == pytest.approx(weights[0] * g[-1] + weights[1] * g[-2], rel=1e-14)


@any_rule
def test_declares_what_it_is(make):
    rule = make(1.0)
    assert rule.error_order > 0.0
    assert rule.references
    assert all(any(character.isdigit() for character in reference) for reference in rule.references)  # each has a year
    assert basset.SCHEMES[rule.name] is type(rule)
    assert make(1.0) == rule
    assert hash(make(1.0)) == hash(rule)


@pytest.mark.parametrize("order", ORDERS)
def test_declared_order_is_degree_plus_one(order):
    assert basset.Daitche(order=order).error_order == order + 1
    assert basset.Windowed(basset.Daitche(order=order), 1.0).error_order == order + 1


class TestTail:
    """Exact newest panels and a sum of exponentials beyond: as good as the polynomials, up to what was promised."""

    @pytest.mark.parametrize("name", [name for name, kernel in KERNELS.items() if isinstance(kernel, FITTED)])
    @pytest.mark.parametrize("rtol", [1e-2, 1e-6, 1e-10])
    @pytest.mark.parametrize("order", [1, 3, 6])
    def test_keeps_its_promise_at_every_node(self, order, rtol, name):
        """|H − Daitche(p)| ≤ rtol ∫K|g|, with a few units for rough samples; g jumps about, so nothing averages out."""
        kernel, dt = KERNELS[name], 1e-4
        g = np.random.default_rng(order).standard_normal(1001)
        H, exact = (basset.cumulate(g, dt, rule, kernel) for rule in (basset.Exponential(order, rtol), basset.Daitche(order)))
        # ∫K|g| of the interpolant is at most the Lebesgue constant (2^p/p and less) times that of |g|
        size = 2.0 * basset.cumulate(np.abs(g), dt, basset.Daitche(1), kernel)
        assert np.all(np.abs(H - exact)[1:] <= rtol * size[1:] + 1e-13 * np.abs(exact[1:]).max())

    @pytest.mark.parametrize("order", [1, 2, 3, 5])
    def test_keeps_the_order_down_to_its_promise(self, order):
        rule, problem = basset.Exponential(order, 1e-12), PROBLEMS["fresnel_generic"]
        steps, errors, _ = path_errors(rule, problem, "rate", range(7, 15))
        floor = 1e-12 * 2.0 * np.sqrt(problem.end)  # rtol ∫K|g|
        assert last_slope(steps, errors, floor) >= rule.error_order - 0.25

    def test_the_published_tail_is_good_to_two_digits(self):
        problem = PROBLEMS["fresnel_generic"]
        rule = basset.Hinsberg(window=2.0)
        errors = path_errors(rule, problem, "rate", range(13, 16))[1]
        assert np.all(errors <= 1e-2)
        assert errors[-1] >= 1e-5  # and no step size makes it better

    @tailed_rules
    def test_refuses_slip_samples(self, make):
        with pytest.raises(ValueError, match=r"input must be 'rate' for \w+, got 'slip'"):
            basset.integrate(np.ones(5), 0.1, make(0.3), input="slip")
