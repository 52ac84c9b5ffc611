"""Samples at any times: the uniform rules on uniform times, exact polynomials, declared orders, promises, jumps, gaps, and what is refused."""

from __future__ import annotations

import pickle

import mpmath
import numpy as np
from all_cases import each
from rule_cases import EXACT_VALUES, KERNELS, refused
from scipy.special import fresnel
from stream_cases import history

import basset
from basset import Daitche, Exponential, cumulate, integrate
from basset.streaming._uneven import decays
from basset.streaming.uneven import planned
from basset.weights.uneven import panel_moments

BASSET = basset.BassetKernel()
FORMULA = {"formula": basset.FormulaKernel(lambda s: np.exp(-s) / np.sqrt(s)), "bubble": basset.BubbleKernel(1e-3, 1e-6)}
every_order = each("order", (1, 2, 3))
every_input = each("input", ["rate", "slip"])
both = each("function", [integrate, cumulate])


def jittered(n: int, end: float, seed: int = 0) -> np.ndarray:
    """n steps up to `end`, each node moved by up to 0.4 of a step."""
    return (np.arange(n + 1) + np.concatenate([[0.0], np.random.default_rng(seed).uniform(-0.4, 0.4, n - 1), [0.0]])) * (end / n)


def scattered(n: int, end: float, seed: int = 0) -> np.ndarray:
    """n + 1 nodes at random: steps of any ratio."""
    return np.sort(np.concatenate([[0.0, end], np.random.default_rng(seed).uniform(0.0, end, n - 1)]))


def cosine(t: np.ndarray) -> np.ndarray:
    """∫_0^t cos τ / √(t − τ) dτ by Fresnel integrals."""
    s, c = fresnel(np.sqrt(2.0 * t / np.pi))
    return np.sqrt(2.0 * np.pi) * (np.cos(t) * c + np.sin(t) * s)


class TestWeights:
    @every_order
    @every_input
    @each("kernel", [*KERNELS.values(), *FORMULA.values()])
    def test_are_the_uniform_ones_on_uniform_times(self, order, input, kernel):
        g, t = np.random.default_rng(order).standard_normal((30, 2)), 0.1 * np.arange(30)
        expected = cumulate(g, 0.1, Daitche(order), kernel, input=input)[1:]
        found = cumulate(g, t=t, rule=Daitche(order), kernel=kernel, input=input)[1:]
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()

    @every_order
    @each("rule", [Daitche, lambda order: Exponential(order, 1e-13)])
    def test_polynomials_of_the_degree_are_exact(self, order, rule):
        """At every node from that number on, on times at random, whatever their steps; and in one value."""
        t = np.sort(np.concatenate([[0.05, 0.11, 0.16], scattered(60, 3.0, seed=order)]))
        coefficients = np.array([0.3, -1.0, 0.7, 0.4])[: order + 1]
        g, exact = np.polynomial.polynomial.polyval(t, coefficients), history(t, [(0.0, 3.0, coefficients)])
        allowed = 1e-13 if rule is Daitche else 2e-12
        assert np.abs(cumulate(g, t=t, rule=rule(order)) - exact)[order:].max() < allowed
        assert abs(integrate(g, t=t, rule=rule(order)) - exact[-1]) < allowed

    @every_order
    def test_slips_that_are_polynomials_are_exact(self, order):
        t = jittered(50, 2.0)
        f = np.array([0.3, -1.0, 0.7, 0.4])[: order + 1]
        exact = history(t[1:], [(0.0, 2.0, np.polynomial.polynomial.polyder(f))], [(0.0, f[0])])
        for rule in (Daitche(order), Exponential(order, 1e-13)):
            H = cumulate(np.polynomial.polynomial.polyval(t, f), t=t, rule=rule, input="slip")
            assert np.isposinf(H[0])
            assert np.abs(H[1:] - exact)[order:].max() < 5e-12

    @each("kernel", [KERNELS["basset"], KERNELS["mei_adrian"]])
    def test_moments_far_out_and_near_against_mpmath(self, kernel):
        """Panels that are 1e-8 of their lag, and the other way round: nothing cancels."""
        near, sizes = np.array([0.0, 1e-9, 1.0, 1.0, 7.0, 1e3, 1e-3]), np.array([1e-5, 1.0, 1e-8, 1.0, 1.0, 1e-5, 1e-4])
        found = panel_moments(kernel, near, sizes)
        with mpmath.workdps(30):
            for k, (a, h) in enumerate(zip(near.tolist(), sizes.tolist(), strict=True)):
                edges = [mpmath.sqrt(a + h * mpmath.mpf(share)) for share in (0, 1e-5, 1e-2, 1)]
                for m in (0, 3):
                    exact = mpmath.quad(lambda x, a=a, h=h, m=m: 2 * x * EXACT_VALUES[type(kernel)](kernel, x * x) * ((x * x - a) / h) ** m, edges)
                    assert abs(found[k, m] / exact - 1) < 2e-14, (k, m)


class TestOrders:
    """Root mean squares of errors over the second half: the first nodes of a path have lower degrees, as on uniform times."""

    @every_order
    @every_input
    @each("times", [jittered, lambda n, end: end * np.linspace(0.0, 1.0, n + 1) ** 4])
    def test_are_as_declared(self, order, input, times):
        errors = []
        for n in (1600, 6400):
            t = times(n, 10.0)
            H = cumulate(np.cos(t) if input == "rate" else np.sin(t), t=t, rule=Exponential(order, 1e-14), input=input)
            errors.append(np.sqrt(np.mean((H - cosine(t))[n // 2 :] ** 2)))
        declared = Daitche(order).error_order - (0.5 if input == "slip" else 0.0)
        assert np.log2(errors[0] / errors[1]) / 2.0 > declared - 0.2

    @every_order
    def test_times_at_random(self, order):
        """Whose longest step is some ten means: median errors over the path, over six draws."""
        errors = []
        for n in (200, 1600):
            paths = [scattered(n, 10.0, seed) for seed in range(6)]
            errors.append(np.mean([np.median(np.abs(cumulate(np.cos(t), t=t, rule=Exponential(order, 1e-12)) - cosine(t))) for t in paths]))
        assert np.log2(errors[0] / errors[1]) / 3.0 > order + 1.0 - 0.3

    @each("rule", [Daitche(3), Exponential(3, 1e-12)])
    def test_steps_that_grow_a_millionfold(self, rule):
        """From 1e-24 on, and to a step of 0.01: to rounding, or as good as straight lines over the first long panel; then of fourth order."""
        t = np.concatenate([[0.0], 1e-24 * 1e6 ** np.arange(4.0), np.linspace(0.01, 5.0, 500)])
        H, exact = cumulate(np.cos(t), t=t, rule=rule), cosine(t)
        assert (np.abs(H - exact)[1:5] <= 1e-12 * exact[1:5]).all()
        assert abs(H[5] - exact[5]) < 0.14 * 0.01**2.5
        assert np.abs(H - exact)[6:].max() < 0.1 * 0.01**4

    @each("rule", [Daitche(3), Exponential(3, 1e-12)])
    def test_errors_of_samples_are_not_magnified(self, rule):
        """By samples 1e-8 and 1e-12 of a step apart, though a polynomial through them would by as much."""
        t = np.linspace(0.0, 5.0, 200)
        t = np.sort(np.concatenate([t, t[20:180:10] * (1.0 + 1e-14), t[25:180:10] + 1e-8 * t[1]]))
        noise = np.random.default_rng(0).uniform(-1.0, 1.0, len(t))
        assert np.abs(cumulate(noise, t=t, rule=rule)).max() < 3.0 * 2.0 * np.sqrt(5.0)
        assert np.abs(cumulate(np.cos(t), t=t, rule=rule) - cosine(t))[5:].max() < 1e-7


class TestExponential:
    @every_input
    @each("kernel", [*KERNELS.values(), *FORMULA.values()])
    def test_keeps_its_promise(self, input, kernel):
        """|H − Daitche| ≤ rtol ∫ K |g|, at every node."""
        t, rtol, order = scattered(100, 4.0), 1e-7, 3
        g = 2.0 + np.cos(5.0 * t)
        f = 2.0 * t + np.sin(5.0 * t) / 5.0 + 0.3
        samples = g if input == "rate" else f
        direct, found = (cumulate(samples, t=t, rule=rule, kernel=kernel, input=input)[1:] for rule in (Daitche(order), Exponential(order, rtol)))
        assert (np.abs(found - direct) <= 1.001 * rtol * np.abs(direct) + 1e-14).all()

    @each("span", [1e-3, 1e-12, 1e-30])
    def test_the_sum_is_as_good_as_promised_on_any_range(self, span):
        for rtol in (1e-4, 1e-13):
            tail = planned(BASSET, rtol, span, 1.0).tail
            assert tail.near == span
            lags = np.geomspace(span, 1.0, 4000)
            assert np.abs(tail(lags) * np.sqrt(lags) - 1.0).max() <= 1.001 * rtol + 5e-15

    def test_what_no_table_holds_is_fitted(self):
        kernel = basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)
        refused(ValueError, "rtol must be at least", basset.ExponentialSum.fit, 1e-9, 1.0, 1e-10, kernel)
        tail, lags = planned(kernel, 1e-10, 1e-9, 1.0).tail, np.geomspace(1e-9, 1.0, 4000)
        assert np.abs(tail(lags) / kernel(lags) - 1.0).max() <= 1.001e-10

    @every_input
    def test_two_samples_at_an_instant_behind_a_step_shorter_than_the_sum_s(self, input):
        """Sums of other kernels than Basset's begin at 1e-12 of the path: H there is taken from the definition, at both samples of the instant."""
        t = np.array([0.0, 1.0, 1.0 + 2.0**-48, 1.0 + 2.0**-48, 3.0])
        kernel, g = FORMULA["bubble"], np.array([1.0, -2.0, 1.0, 5.0, 2.0])
        direct, found = (cumulate(g, t=t, rule=rule, kernel=kernel, input=input) for rule in (Daitche(1), Exponential(1, 1e-9)))
        assert np.allclose(found, direct, rtol=1e-8, atol=0.0)

    @each("order", [1, 2, 3])
    def test_a_jump_is_remembered_to_rounding_over_steps_of_any_ratio(self, order):
        """f' = 0 and a jump of 1 at the start: K, at a step of 3e-14 of the path too."""
        t = np.array([0.0, 17.0, 17.0 + 2.0**-41, 18.0])
        assert np.allclose(cumulate(np.zeros(4), t=t, rule=Exponential(order, 1e-13), initial_slip=1.0)[1:] * np.sqrt(t[1:]), 1.0, rtol=0.0, atol=4e-13)

    def test_decays_over_a_panel_against_mpmath(self):
        z = np.concatenate([np.geomspace(1e-20, 1e3, 200), [0.5, 0.5 - 1e-15, 2.0, 2.0 - 1e-15]])
        z.sort()
        own, total = np.empty((6, len(z))), np.empty(4)
        decays(np.ones_like(z), z, 1.0, own, total)
        assert np.allclose(total, own[:4].sum(axis=1), rtol=1e-14)
        with mpmath.workdps(60):
            for k, x in enumerate(map(mpmath.mpf, z.tolist())):
                exact = [mpmath.gammainc(m + 1, 0, x) / x ** (m + 1) for m in range(4)] + [mpmath.exp(-x), -mpmath.expm1(-x)]
                for m in range(6):
                    assert abs(own[m, k] / exact[m] - 1) < 4e-15 if exact[m] > 1e-300 else own[m, k] < 1e-300, (m, x)


class TestPaths:
    @every_input
    @each("rule", [Daitche(3), Exponential(3, 1e-9)])
    def test_a_row_is_one_value_of_the_path_so_far(self, input, rule):
        t = scattered(40, 3.0)
        t[20] = t[19]
        g = np.random.default_rng(1).standard_normal((41, 2))
        H = cumulate(g, t=t, rule=rule, input=input)
        allowed = 1e-12 if isinstance(rule, Daitche) else 1e-6
        for k in (1, 2, 3, 4, 18, 19, 21, 22, 23, 24, 40):
            assert np.allclose(
                integrate(g[: k + 1], t=t[: k + 1], rule=rule, input=input), H[k], rtol=0.0, atol=allowed * np.abs(H[1:][np.isfinite(H[1:])]).max()
            )

    @each("rule", [Daitche(2), Exponential(2, 1e-9)])
    def test_components_are_independent(self, rule):
        t, g = scattered(50, 3.0), np.random.default_rng(2).standard_normal((51, 2, 3))
        slip = np.array([[1.0, 0.0, 2.0], [0.0, 3.0, 4.0]])
        H = cumulate(g, t=t, rule=rule, initial_slip=slip)
        assert (cumulate(g.transpose(0, 2, 1), t=t, rule=rule, initial_slip=slip.T) == H.transpose(0, 2, 1)).all()
        assert np.abs(cumulate(g[:, 1, 2], t=t, rule=rule, initial_slip=4.0)[1:] - H[1:, 1, 2]).max() < 1e-13
        assert (cumulate(g, t=t + 64.0, rule=rule, initial_slip=slip)[1:] - H[1:]).max() < 1e-10  # whenever it begins
        assert cumulate(np.ones((1, 2)), t=[3.0], rule=rule).tolist() == [[0.0, 0.0]]
        assert cumulate(np.ones((4, 0)), t=[0.0, 1.0, 2.0, 4.0], rule=rule).shape == (4, 0)

    @each("rule", [Daitche(3), Exponential(3, 1e-12)])
    def test_an_instant_that_stands_twice_is_a_jump(self, rule):
        """Cubic slips with a jump between: exact on both sides, infinite at the jump; rates alike without the slip's jump."""
        t = np.sort(np.concatenate([jittered(20, 1.0), 1.0 + jittered(30, 1.5, seed=1)]))
        first, second = np.array([0.5, 1.0, -2.0, 0.7]), np.array([3.0, -1.0, 0.4, 0.2])
        before = np.arange(len(t)) <= 20
        f, g = (
            np.where(before, *(np.polynomial.polynomial.polyval(t, der(c)) for c in (first, second))) for der in (lambda c: c, np.polynomial.polynomial.polyder)
        )
        leap = np.polynomial.polynomial.polyval(1.0, second - first)
        pieces = [(a, b, np.polynomial.polynomial.polyder(c)) for a, b, c in ((0.0, 1.0, first), (1.0, 2.5, second))]
        H = cumulate(f, t=t, rule=rule, input="slip")
        assert H[21] == np.sign(leap) * np.inf
        settled = np.r_[3:21, 24 : len(t)]
        assert np.abs(H - history(t, pieces, [(0.0, first[0]), (1.0, leap)]))[settled].max() < 5e-11
        H = cumulate(g, t=t, rule=rule, initial_slip=first[0])
        assert abs(H[21] - H[20]) < 1e-14
        assert np.abs(H - history(t, pieces, [(0.0, first[0])]))[settled].max() < 5e-11

    def test_a_bounded_kernel_is_finite_at_a_jump(self):
        kernel, t = FORMULA["bubble"], np.array([0.0, 0.1, 0.1, 0.3])
        for rule in (Daitche(1), Exponential(1, 1e-10)):
            H = cumulate([2.0, 2.0, 5.0, 5.0], t=t, rule=rule, kernel=kernel, input="slip")
            assert np.allclose(
                H, [2.0 * kernel(0.0), 2.0 * kernel(0.1), 2.0 * kernel(0.1) + 3.0 * kernel(0.0), 2.0 * kernel(0.3) + 3.0 * kernel(0.2)], rtol=1e-9
            )


class TestGaps:
    @each("rule", [Daitche(3), Exponential(3, 1e-10)])
    def test_are_bridged_as_if_the_samples_had_never_been(self, rule):
        t, g = 0.1 * np.arange(40), np.cos(0.1 * np.arange(40))[:, None] * [1.0, 2.0]
        missing = np.isin(np.arange(40), [0, 1, 7, 20, 21, 22, 23])
        expected = cumulate(g[~missing], t=t[~missing], rule=rule)
        holes = g.copy()
        holes[missing, 1] = np.nan
        masked = np.ma.masked_array(g, np.isnan(holes))
        for samples, times in (
            (holes, {"t": t}),
            (holes, {"t": np.where(missing, np.nan, t)}),
            (holes, {"t": np.ma.masked_array(t, missing)}),
            (masked, {"t": t}),
            (holes, {"dt": 0.1}),
        ):
            H = cumulate(samples, rule=rule, gaps="bridge", **times)
            assert np.isnan(H[missing]).all()
            assert np.allclose(H[~missing], expected, rtol=1e-12, atol=1e-12)
            assert np.allclose(integrate(samples, rule=rule, gaps="bridge", **times), expected[-1], rtol=1e-12)
        assert (cumulate(g, 0.1, rule, gaps="bridge") == cumulate(g, 0.1, rule)).all()  # nothing to bridge


class TestStream:
    def test_is_the_path_in_blocks_of_any_size(self):
        t, g = scattered(60, 5.0), np.random.default_rng(3).standard_normal((61, 2, 2))
        t[30] = t[29]
        rule = Exponential(3, 1e-10)
        plan = rule.uneven_plan(horizon=5.0, shortest=np.diff(t)[np.diff(t) > 0.0].min())
        expected = cumulate(g, t=t, rule=Daitche(3))
        for blocks in ([61], [1, 1, 2, 3, 20, 3, 1, 30], [1] * 61):
            state, k, found = plan.start((2, 2)), 0, []
            for size in blocks:
                found.append(plan.run(state, g[k : k + size], t[k : k + size]))
                state, k = type(state)(*pickle.loads(pickle.dumps(state))), k + size
            assert np.abs(np.concatenate(found) - expected).max() < 1e-10 * 2.0 * np.abs(g).max() * 2.0 * np.sqrt(5.0)
            assert (plan.value(state) == found[-1][-1]).all()
        assert {array.dtype for array in state} == {np.dtype(np.float64)}

    def test_is_affine_in_the_next_sample(self):
        plan = Exponential(3, 1e-10).uneven_plan(horizon=5.0)
        t, g = scattered(20, 5.0), np.random.default_rng(4).standard_normal((21, 2))
        state = plan.start(2)
        for now, sample in zip(t.tolist(), g, strict=True):
            expected, before = plan.tail(state, now) + plan.local(state, now) * sample, pickle.dumps(state)
            assert pickle.dumps(state) == before
            plan.push(state, sample, now)
            assert np.allclose(plan.value(state), expected, rtol=0.0, atol=1e-13)

    def test_remembers_jumps(self):
        """f = 0 but for two jumps, the first of them at the start: K of each."""
        plan = Exponential(2, 1e-9).uneven_plan(horizon=10.0)
        state = plan.start(2)
        plan.push(state, np.zeros(2), 1.0)
        plan.jump(state, [1.0, 0.0])
        plan.push(state, np.zeros(2), 1.5)
        assert np.allclose(plan.value(state), [0.5**-0.5, 0.0], rtol=1e-9)
        plan.jump(state, 3.0)
        assert np.allclose(plan.value(state), [0.5**-0.5, 0.0], rtol=1e-9)
        plan.push(state, np.zeros(2), 4.0)
        assert np.allclose(plan.value(state), [3.0**-0.5 + 3.0 * 2.5**-0.5, 3.0 * 2.5**-0.5], rtol=1e-9)

    def test_refused_and_left_as_it_was(self):
        plan = Exponential(3, 1e-6).uneven_plan(horizon=2.0, shortest=0.01)
        state = plan.start()
        refused(ValueError, "jump needs a first sample", plan.jump, state, 1.0)
        plan.run(state, np.ones(3), [0.0, 0.1, 0.2])
        before = pickle.dumps(state)
        for sentence, t in (
            (r"t must not fall, got 0\.1 after 0\.2 seconds in row 0", 0.1),
            (r"t must rise by 0\.01 seconds or more, the shortest step planned, got 0\.005", 0.205),
            (r"horizon must cover the stream, 2\.5 seconds from its first sample on, got 2", 2.5),
            ("t must be a finite number, got nan", np.nan),
        ):
            refused(ValueError, sentence, plan.push, state, 1.0, t)
        refused(ValueError, "g must be finite, got nan", plan.push, state, np.nan, 0.3)
        refused(ValueError, r"t must have the shape \(2,\), one time for each sample, got \(1,\)", plan.run, state, np.ones(2), [0.3])
        refused(TypeError, "state must be what plan.start", plan.push, 3, 1.0, 0.3)
        assert pickle.dumps(state) == before
        refused(ValueError, "order must be from 1 to 3 at nonuniform times, got 4", Exponential(4).uneven_plan, 1.0)
        refused(ValueError, "rtol must be 1e-14 or greater at nonuniform times, got 1e-15", Exponential(3, 1e-15).uneven_plan, 1.0)

    def test_steps_of_any_ratio(self):
        """f' = 1: H = 2√t, with a sum from 1e-300 of the horizon on."""
        plan = Exponential(3, 1e-9).uneven_plan(horizon=1.0, shortest=1e-300)
        t = np.array([0.0, 1e-290, 1e-9, 1.0])
        assert np.allclose(plan.run(plan.start(), np.ones(4), t), 2.0 * np.sqrt(t), rtol=1e-9, atol=0.0)

    def test_of_no_components(self):
        plan = Exponential(3, 1e-6).uneven_plan(horizon=2.0)
        assert plan.run(plan.start((2, 0)), np.zeros((3, 2, 0)), [0.0, 1.0, 2.0]).shape == (3, 2, 0)


class TestRefused:
    @both
    def test_in_a_sentence(self, function):
        g, t = np.ones(5), np.array([0.0, 1.0, 2.0, 2.5, 4.0])
        holes = np.array([1.0, np.nan, 1.0, 1.0, 1.0])
        allowed = r"rule must be Daitche\(order\) or Exponential\(order, rtol\) of order 1, 2 or 3 for {}, got {}"
        for error, sentence, samples, given in (
            (TypeError, r"dt must be .*\(seconds\), got None; or t must be given", g, {}),
            (TypeError, "dt must be left out where t is given, got 0.1", g, {"dt": 0.1, "t": t}),
            (ValueError, allowed.format("samples at nonuniform times", "Brush"), g, {"t": t, "rule": "brush"}),
            (ValueError, allowed.format("samples at nonuniform times", r"Daitche\(order=4\)"), g, {"t": t, "rule": Daitche(4)}),
            (ValueError, allowed.format("bridged gaps", "SemiDerivative"), holes, {"dt": 0.1, "rule": "semi_derivative", "gaps": "bridge"}),
            (ValueError, r"t must have the shape \(5,\), one time for each sample of g, got \(4,\)", g, {"t": t[:4]}),
            (ValueError, "t must not fall, got 1 after 2 seconds in row 3", g, {"t": [0.0, 1.0, 2.0, 1.0, 4.0]}),
            (ValueError, "t must hold an instant at most twice, .* got 1 seconds for the third time in row 3", g, {"t": [0.0, 1.0, 1.0, 1.0, 4.0]}),
            (ValueError, "t must be finite, got inf in sample 4", g, {"t": [0.0, 1.0, 2.0, 3.0, np.inf]}),
            (TypeError, "t must be an array of real numbers", g, {"t": t.astype("M8[s]")}),
            (ValueError, "g must be finite, got nan in sample 1.*gaps='bridge'", holes, {"t": t}),
            (ValueError, "g must be finite, got nan in sample 1.*gaps='bridge'", holes, {"dt": 0.1}),
            (ValueError, "g must have no missing values, .*gaps='bridge'", np.ma.masked_invalid(holes), {"t": t}),
            (ValueError, "g must be finite, got inf in sample 2", [1.0, np.nan, np.inf, 1.0, 1.0], {"t": t, "gaps": "bridge"}),
            (ValueError, "gaps must be one of 'raise', 'bridge', got 'fill'", g, {"t": t, "gaps": "fill"}),
            (ValueError, "g must hold at least", np.full(5, np.nan), {"t": t, "gaps": "bridge"}),
            (ValueError, "g must hold at least", [], {"t": []}),
            (ValueError, "g must hold at least", np.zeros((0, 3)), {"dt": 0.1, "gaps": "bridge"}),
            (ValueError, "initial_slip must be left at 0", g, {"t": t, "input": "slip", "initial_slip": 1.0}),
            (TypeError, "kernel must be a kernel", g, {"t": t, "kernel": 3}),
            (ValueError, "g must be small enough", np.full(5, 1e308), {"t": t * 1e5}),
        ):  # fmt: skip
            refused(error, sentence, function, samples, **given)

    def test_one_value_needs_its_sample(self):
        refused(
            ValueError,
            "the last sample of g must not be missing, the integral is taken there; got a missing one in row 2",
            integrate,
            [1.0, 1.0, np.nan],
            0.1,
            gaps="bridge",
        )
        refused(ValueError, r"g must hold at least two samples \(one step\)", integrate, [1.0], t=[0.0])
