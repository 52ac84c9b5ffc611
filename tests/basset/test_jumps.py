"""Jumps of the slip, wherever they lie: at, between and exactly on nodes, many in one step, with and without a kink in the rate."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from all_cases import each
from rule_cases import FULL, KERNELS, RULES
from stream_cases import BASSET, DT, HORIZON, STREAMS, WINDOW, Stream, baselines, chosen, copied, every_stream, history, polynomial_streams, same, with_kernels

import basset

POLYNOMIALS = np.random.default_rng(11).uniform(0.5, 1.5, (80, 11)) * np.random.default_rng(12).choice([-1.0, 1.0], (80, 11))


def polynomial(degree: int, which: int) -> np.ndarray:
    """Coefficients in τ, lowest first, of a rate of size 1 over the whole horizon."""
    return POLYNOMIALS[which, : degree + 1] / (HORIZON * DT) ** np.arange(degree + 1)


def rate(coefficients: np.ndarray, t: float) -> float:
    return float(np.polynomial.polynomial.polyval(t, coefficients))


def window_of(stream: Stream) -> float:
    return WINDOW * DT if stream.forgets else np.inf


class PiecewisePolynomials:
    """A rate that is another polynomial after every break, with jumps of the slip there; streamed, and exact."""

    def __init__(self, breaks: list[int], degrees: list[int], jumps: list[float]) -> None:
        assert len(degrees) == len(breaks) + 1 == len(jumps) + 1
        self.breaks, self.degrees, self.jumps = breaks, degrees, jumps
        self.parts = [polynomial(degree, which) for which, degree in enumerate(degrees)]
        self.times = [0.0, *(n * DT for n in breaks), np.inf]

    def stream(self, stream: Stream, steps: int = HORIZON) -> np.ndarray:
        plan = stream.plan()
        state = plan.start()
        H, part = [], 0
        for n in range(steps + 1):
            plan.push(state, rate(self.parts[part], n * DT))
            H.append(plan.value(state))
            if part < len(self.breaks) and n == self.breaks[part]:
                part += 1
                plan.jump(state, self.jumps[part - 1], 0.0, rate(self.parts[part], n * DT))
                assert plan.value(state) == H[-1]  # H at the node itself is the limit from the left
        return np.array(H)

    def pieces(self):
        return list(zip(self.times[:-1], self.times[1:], self.parts, strict=True))

    def exact(self, stream: Stream, n: np.ndarray) -> np.ndarray:
        return history(n * DT, self.pieces(), list(zip(self.times[1:-1], self.jumps, strict=True)), window_of(stream))

    def size(self, n: np.ndarray) -> np.ndarray:
        """∫K|g| and all jumps, from above."""
        return 2.0 * np.sqrt(n * DT) * 4.0 + sum(abs(jump) for jump in self.jumps) / np.sqrt(DT)


# --------------------------------------------------------------------------------------------------------- impulses only


class TestImpulsesAreTheKernel:
    """With a constant slip in between, H is Σ Δ K exactly: to rounding where the kernel is exact, to rtol·|Δ|K beyond a window."""

    AGES = (0.0, 0.37, 1e-3, 1.0, 2.0, float(WINDOW), WINDOW + 0.5)  # in steps: at, on and between nodes, long ago

    @with_kernels(STREAMS)
    @each("age", AGES)
    def test_one_jump_at_any_age(self, stream, kernel, age):
        plan = stream.plan(kernel=kernel)
        state = plan.start()
        plan.run(state, np.zeros(30))
        plan.jump(state, 1.7, age * DT)
        H = [plan.value(state), *plan.run(state, np.zeros(HORIZON - 29))]
        lags = age + np.arange(len(H))
        if age == 0.0:
            assert H[0] == 0.0  # seen from the next node on
            H, lags = H[1:], lags[1:]
        expected = 1.7 * kernel(lags * DT)
        if stream.forgets:
            expected[lags > WINDOW * (1.0 + 1e-9)] = 0.0
        np.testing.assert_allclose(H, expected, rtol=stream.rtol + 1e-13, atol=0.0)

    @every_stream
    def test_seen_from_the_next_node_on_through_tail(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.push(state, 0.0)
        plan.jump(state, -0.6)
        assert plan.tail(state) == pytest.approx(-0.6 / np.sqrt(DT), rel=stream.rtol + 1e-13)

    @every_stream
    def test_an_initial_jump_is_the_initial_slip(self, stream):
        g, slip = np.random.default_rng(1).standard_normal((HORIZON + 1, 3)), np.array([1.5, 0.0, -2.0])
        plan = stream.plan()
        state = plan.start((3,))
        plan.push(state, g[0])
        plan.jump(state, slip)
        H = plan.run(state, g[1:])
        rule = stream.make(DT, HORIZON * DT, BASSET)
        expected = basset.cumulate(g, DT, rule, initial_slip=slip)[1:]
        np.testing.assert_allclose(H, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())

    @every_stream
    @each("node", [0, 1, 2, 9, WINDOW, WINDOW + 9])
    def test_several_jumps_at_one_node_add_up(self, stream, node):
        plan = stream.plan()
        one, many = plan.start(), plan.start()
        for state, parts in ((one, [0.75]), (many, [1.0, -0.5, 0.25])):
            plan.run(state, np.ones(node + 1))
            for part in parts:
                plan.jump(state, part)
        rest = np.ones(HORIZON - node)
        np.testing.assert_allclose(plan.run(many, rest), plan.run(one, rest), rtol=0.0, atol=1e-13 * 0.75 / np.sqrt(DT) * 4.0)

    @every_stream
    def test_two_jumps_closer_than_any_step(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.zeros(5))
        first, second = 0.4 * DT, 0.4 * DT - 1e-9 * DT
        plan.jump(state, 1.0, first)
        plan.jump(state, -1.0 + 1e-6, second)
        lags = DT * np.arange(HORIZON - 3)
        H = np.array([plan.value(state), *plan.run(state, np.zeros(HORIZON - 4))])
        expected = 1.0 / np.sqrt(lags + first) - (1.0 - 1e-6) / np.sqrt(lags + second)
        old = lags + first > WINDOW * DT
        if stream.forgets:
            expected[old] = 0.0
        # the two nearly cancel: absolute to the size of one; the oldest entry lies at the window's edge
        np.testing.assert_allclose(H, expected, rtol=0.0, atol=(stream.rtol * 0.3 + 1e-13) / np.sqrt(first))

    @every_stream
    def test_a_jump_into_a_moving_stream_adds_its_kernel_and_nothing_else(self, stream):
        plan, g = stream.plan(), np.random.default_rng(4).standard_normal(HORIZON + 1)
        without, with_jump = plan.start(), plan.start()
        plan.run(without, g[:50])
        plan.run(with_jump, g[:50])
        plan.jump(with_jump, 0.9, 0.3 * DT)
        difference = plan.run(with_jump, g[50:]) - plan.run(without, g[50:])
        lags = 0.3 + np.arange(1, HORIZON - 48)
        expected = 0.9 / np.sqrt(lags * DT)
        if stream.forgets:
            expected[lags > WINDOW] = 0.0
        np.testing.assert_allclose(difference, expected, rtol=stream.rtol, atol=2e-13 / np.sqrt(DT))

    @every_stream
    def test_sixty_halving_bounces_within_one_step(self, stream):
        """A Zeno cascade: jumps at t_n − dt·2^(−k), sizes halving too."""
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.zeros(4))
        ages, sizes = DT * 2.0 ** -np.arange(60.0), 2.0 ** -np.arange(60.0)
        for age, size in zip(ages, sizes, strict=True):
            plan.jump(state, size, age)
        H = np.array([plan.value(state), *plan.run(state, np.zeros(WINDOW - 2))])
        expected = [np.sum(sizes / np.sqrt(ages + k * DT)) for k in range(WINDOW - 1)]
        np.testing.assert_allclose(H, expected, rtol=stream.rtol + 1e-13)

    @every_stream
    def test_jumps_of_many_grains(self, stream):
        plan = stream.plan()
        state, single = plan.start((3, 2)), plan.start()
        g = np.random.default_rng(7).standard_normal((60, 3, 2))
        delta = np.arange(6.0).reshape(3, 2)
        plan.run(state, g[:20])
        plan.jump(state, delta, 0.2 * DT)
        plan.run(single, g[:20, 1, 1])
        plan.jump(single, 3.0, 0.2 * DT)
        np.testing.assert_array_equal(plan.run(state, g[20:])[:, 1, 1], plan.run(single, g[20:, 1, 1]))


# ------------------------------------------------------------------------------------------------- kinks at a node


class TestAKinkAtANode:
    """g= at age 0: exact for polynomials up to the degree on either side, from the node where the new stretch holds enough samples."""

    def check(self, stream: Stream, case: PiecewisePolynomials) -> None:
        H = case.stream(stream)
        ends = [*case.breaks, HORIZON]
        starts = [0, *case.breaks]
        checked = np.concatenate([np.arange(start + max(degree, 1), end + 1) for start, end, degree in zip(starts, ends, case.degrees, strict=True)])
        right = np.abs(H[checked] - case.exact(stream, checked)) <= (1e-13 + stream.rtol) * case.size(checked)
        assert right.all(), checked[~right]
        assert len(checked) > HORIZON // 4

    @polynomial_streams
    @each("node", [12, WINDOW - 1, WINDOW, WINDOW + 1, WINDOW + 6, 90])
    def test_full_degree_on_both_sides(self, stream, node):
        self.check(stream, PiecewisePolynomials([node], [stream.degree, stream.degree], [0.8]))

    @polynomial_streams
    @each("node", [0, 1, 2, 3])
    def test_during_start_up(self, stream, node):
        """A stretch of n steps is integrated with degree n: exact for a left-hand rate of that degree."""
        self.check(stream, PiecewisePolynomials([node], [min(node, stream.degree), stream.degree], [-1.1]))

    @polynomial_streams
    @each("every", [1, 2, 3, 7])
    def test_every_few_steps(self, stream, every):
        """Stretches never longer than `every` steps, on and on: each adds an exact piece."""
        breaks = list(range(every, 70, every))
        degree = min(every, stream.degree)
        self.check(stream, PiecewisePolynomials(breaks, [degree] * len(breaks) + [stream.degree], [0.1 * (-1.0) ** n for n in range(len(breaks))]))

    @polynomial_streams
    def test_two_far_apart(self, stream):
        self.check(stream, PiecewisePolynomials([40, 110], [stream.degree] * 3, [0.5, -2.0]))

    @polynomial_streams
    def test_no_kink_after_all(self, stream):
        """g equal to the rate before and no jump: on polynomials nothing has happened."""
        coefficients = polynomial(stream.degree, 0)
        plan = stream.plan()
        state = plan.start()
        g = [rate(coefficients, n * DT) for n in range(HORIZON + 1)]
        plan.run(state, g[:60])
        plan.jump(state, 0.0, 0.0, g[59])
        H = plan.run(state, g[60:])
        exact = history(DT * np.arange(60, HORIZON + 1), [(0.0, np.inf, coefficients)], window=window_of(stream))
        enough = max(stream.degree, 1) - 1  # samples of the new stretch that its polynomials need
        tolerance = (1e-13 + stream.rtol) * 8.0 * np.sqrt(HORIZON * DT)
        np.testing.assert_allclose(H[enough:], exact[enough:], rtol=0.0, atol=tolerance)

    @every_stream
    def test_repeated_at_one_node_the_last_rate_holds(self, stream):
        plan = stream.plan()
        once, twice = plan.start(), plan.start()
        for state in (once, twice):
            plan.run(state, np.ones(30))
        plan.jump(once, 0.5, 0.0, 3.0)
        plan.jump(twice, 0.2, 0.0, -7.0)
        plan.jump(twice, 0.3, 0.0, 11.5 if stream.averages else 3.0)  # baselines average: (1 − 7)/2 = −3, (−3 + 7)/2 = 2 = (1 + 3)/2
        if stream.averages:
            plan, once, twice = self.averaged(stream)
        rest = np.full(50, 3.0)
        np.testing.assert_allclose(plan.run(twice, rest), plan.run(once, rest), rtol=0.0, atol=1e-12 / np.sqrt(DT))

    @staticmethod
    def averaged(stream: Stream):
        """Baselines take the mean of the rates on both sides as the sample at the node."""
        plan = stream.plan()
        once, twice = plan.start(), plan.start()
        plan.run(once, [*np.ones(29), 2.0])
        plan.run(twice, np.ones(30))
        plan.jump(once, 0.5)
        plan.jump(twice, 0.5, 0.0, 3.0)
        return plan, once, twice

    @each("name", ["mei_adrian", "dorgan_loth"])
    @chosen(["daitche_3", "windowed_daitche_2", "tailed_daitche_3", "exponential_2"])
    def test_with_a_finite_reynolds_kernel(self, stream, name):
        """Linear rates on both sides: the whole history of their difference from the kink on is added."""
        kernel = KERNELS[name]
        plan = stream.plan(kernel=kernel)
        tau = DT * np.arange(HORIZON + 1)
        left, right = 1.0 + 0.1 * tau, -0.5 + 0.3 * tau
        node = 40
        state = plan.start()
        plan.run(state, left[: node + 1])
        plan.jump(state, 0.0, 0.0, right[node])
        H = plan.run(state, right[node + 1 :])
        # the same by linearity: left to the end, and (right − left) as a stream of its own that starts at the kink
        whole = plan.run(plan.start(), left)[node + 1 :]
        other = stream.plan(kernel=kernel)
        added = other.run(other.start(), (right - left)[node:])[1:]
        np.testing.assert_allclose(H, whole + added, rtol=0.0, atol=(stream.rtol * 4.0 + 1e-12) * np.abs(whole).max())


class TestBaselinesAverageAtTheNode:
    @baselines
    def test_the_sample_becomes_the_mean(self, stream):
        plan, once, twice = TestAKinkAtANode.averaged(stream)
        rest = np.random.default_rng(1).standard_normal(HORIZON - 29)
        np.testing.assert_array_equal(plan.run(twice, rest), plan.run(once, rest))


# ------------------------------------------------------------------------------------------- kinks between nodes


class TestAKinkBetweenNodes:
    """g= at 0 < age ≤ dt: older samples keep their polynomial up to it, the rate after it is constant up to the node."""

    @polynomial_streams
    @each("share", [1e-6, 0.25, 0.6, 1.0 - 1e-9, 1.0])
    @each("node", [1, 2, 13, WINDOW, WINDOW + 5, 77])
    def test_exact_for_a_polynomial_before_and_a_constant_after(self, stream, share, node):
        degree = min(stream.degree, node - 1)
        left, right, delta = polynomial(degree, 3), np.array([-0.8]), 0.4
        kink = (node - share) * DT
        plan = stream.plan()
        state = plan.start()
        for n in range(node):
            plan.push(state, rate(left, n * DT))
        plan.push(state, right[0])  # the newest sample belongs to what comes after the kink
        plan.jump(state, delta, share * DT, right[0])
        H = [plan.value(state), *plan.run(state, np.full(HORIZON - node, right[0]))]
        # time counted from the kink: close to the node it would lose digits otherwise
        pieces = [(-kink, 0.0, lambda s: np.polynomial.polynomial.polyval(s + kink, left)), (0.0, np.inf, right)]
        scale = 8.0 * np.sqrt(HORIZON * DT) + abs(delta) / np.sqrt(share * DT)
        exact = history((np.arange(HORIZON + 1 - node) + share) * DT, pieces, [(0.0, delta)], window_of(stream))
        np.testing.assert_allclose(H, exact, rtol=0.0, atol=(1e-13 + stream.rtol) * scale)

    @polynomial_streams
    def test_several_kinks_within_one_step(self, stream):
        """In the order of time: each rate lasts up to the next kink."""
        node, shares, rates, jumps = 40, [0.8, 0.5, 0.5, 0.1], [2.0, -1.0, 0.5, -0.3], [0.1, -0.2, 0.3, 0.05]
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(node + 1))
        for share, after, delta in zip(shares, rates, jumps, strict=True):
            plan.jump(state, delta, share * DT, after)
        H = [plan.value(state), *plan.run(state, np.full(HORIZON - node, rates[-1]))]
        times = [(node - share) * DT for share in shares]
        pieces = [(0.0, times[0], np.ones(1))]
        pieces += [(a, b, np.array([after])) for (a, b), after in zip(pairwise([*times, np.inf]), rates, strict=True)]
        exact = history(np.arange(node, HORIZON + 1) * DT, pieces, list(zip(times, jumps, strict=True)), window_of(stream))
        np.testing.assert_allclose(H, exact, rtol=0.0, atol=(1e-12 + stream.rtol) * 20.0)

    @polynomial_streams
    def test_sixty_halving_bounces_with_kinks_within_one_step(self, stream):
        node, count = 30, 60
        shares = 0.9 * 2.0 ** -np.arange(float(count))
        rates = [(-1.0) ** k for k in range(count)]
        jumps = 0.3 * 2.0 ** -np.arange(float(count))
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(node + 1))
        for share, after, delta in zip(shares, rates, jumps, strict=True):
            plan.jump(state, delta, share * DT, after)
        H = [plan.value(state), *plan.run(state, np.full(WINDOW - 2, rates[-1]))]
        expected = history((node + np.arange(WINDOW - 1)) * DT, [(0.0, (node - shares[0]) * DT, np.ones(1))], window=window_of(stream))
        for k, before in enumerate(expected):  # in lags: times of bounces close to the node would lose their digits
            lags = (k + shares) * DT
            edges = np.sqrt(np.append(lags, 0.0))
            exact = before + np.sum(2.0 * (edges[:-1] - edges[1:]) * rates) + np.sum(jumps / np.sqrt(lags))
            # bounces with a fresh tail state each: their rounding may add up
            assert abs(H[k] - exact) <= (1e-12 + stream.rtol) * 20.0, k

    @polynomial_streams
    def test_a_bounce_in_every_step(self, stream):
        """Forty steps with one kink each, at wandering places, in constant rates."""
        rng = np.random.default_rng(9)
        count = 40
        shares, rates, jumps = rng.uniform(0.05, 1.0, count), rng.uniform(-1.0, 1.0, count + 1), rng.uniform(-0.1, 0.1, count)
        plan = stream.plan()
        state = plan.start()
        plan.push(state, rates[0])
        times = (np.arange(1, count + 1) - shares) * DT
        pieces = [(a, b, np.array([value])) for (a, b), value in zip(pairwise([0.0, *times, np.inf]), rates, strict=True)]
        for n in range(1, count + 1):
            plan.push(state, rates[n])
            plan.jump(state, jumps[n - 1], shares[n - 1] * DT, rates[n])
            exact = history(n * DT, pieces, list(zip(times, jumps, strict=True))[:n], window_of(stream))
            assert abs(plan.value(state) - exact) <= (1e-12 + stream.rtol) * 10.0, n
        H = plan.run(state, np.full(HORIZON - count, rates[-1]))
        exact = history(np.arange(count + 1, HORIZON + 1) * DT, pieces, list(zip(times, jumps, strict=True)), window_of(stream))
        np.testing.assert_allclose(H, exact, rtol=0.0, atol=(1e-12 + stream.rtol) * 10.0)


# ------------------------------------------------------------------------------------------- order of convergence

END, KINK = 6.0, 2.0


def kinked_error(stream_of, n: int, age: float = 0.0) -> float:
    """f' = cos before, f' = −sin(3τ) after a jump of 0.7 at τ = 2 (a node): largest error in the last third."""
    t = np.linspace(0.0, END, n + 1)
    node = round(n * KINK / END)
    plan = stream_of(END / n).plan(END / n, END)
    state = plan.start()
    plan.run(state, np.cos(t[: node + 1]))
    after = -np.sin(3.0 * t[node:])
    plan.jump(state, 0.7, age, after[0])
    H = plan.run(state, after[1:])
    late = slice(2 * n // 3 - node, None)
    x, w = np.polynomial.legendre.leggauss(60)

    def integral(g, a, b, time):
        near, far = np.sqrt(np.maximum(time - b, 0.0)), np.sqrt(time - a)
        sigma = 0.5 * (near + far)[:, None] + 0.5 * (far - near)[:, None] * x
        return (far - near) * (g(time[:, None] - sigma**2) @ w)

    time = t[node + 1 :][late]
    exact = integral(np.cos, 0.0, KINK, time) + integral(lambda s: -np.sin(3.0 * s), KINK, time, time) + 0.7 / np.sqrt(time - KINK)
    return float(np.abs(H[late] - exact).max())


class TestTheOrderIsKeptAfterAJump:
    TAIL = basset.ExponentialSum.fit(0.2, 10.0, 1e-13)
    MAKE = (
        ("full", basset.Daitche),
        ("tailed", lambda p: basset.Windowed(basset.Daitche(p), 0.5, TestTheOrderIsKeptAfterAJump.TAIL)),
        ("exponential", lambda p: basset.Exponential(p, 1e-13)),
    )

    @pytest.mark.parametrize("make", [make for _, make in MAKE], ids=[name for name, _ in MAKE])
    @pytest.mark.parametrize("order", range(1, 7))
    def test_of_every_polynomial_rule(self, make, order):
        errors = [kinked_error(lambda dt: make(order), n) for n in (120, 240, 480)]
        slopes = [np.log2(coarse / fine) for coarse, fine in pairwise(errors) if fine > 2e-12]
        assert slopes or errors[-1] <= 2e-12
        assert all(slope > order + 0.65 for slope in slopes), slopes
        # start-up after the jump uses the degree that the samples allow, so it is not better than the order by much either
        assert errors[0] > 1e-10

    @pytest.mark.parametrize("tailed", [False, True])
    @pytest.mark.parametrize("name", [name for name in FULL if RULES[name](0.0).error_order <= 2.0])
    def test_of_every_low_rule(self, name, tailed):
        """Whether it knows of windows, sums and jumps or not: any rule may have them."""
        rule = RULES[name](0.0)
        made = basset.Windowed(rule.whole, 0.5, self.TAIL) if tailed else rule
        errors = [kinked_error(lambda dt: made, n) for n in (300, 1200, 4800)]
        slopes = [np.log2(coarse / fine) / 2.0 for coarse, fine in pairwise(errors)]
        assert min(slopes) > rule.error_order - 0.1, slopes

    def test_without_the_new_rate_it_is_lost(self):
        """Why g is asked for: a stencil across the kink costs Daitche(5) all orders beyond the first and a half."""

        def careless(n: int) -> float:
            t = np.linspace(0.0, END, n + 1)
            g = np.where(t <= KINK, np.cos(t), -np.sin(3.0 * t))
            exact = basset.Daitche(5).plan(END / n, END)
            state = exact.start()
            node = n // 3
            exact.run(state, np.cos(t[: node + 1]))
            exact.jump(state, 0.0, 0.0, -np.sin(3.0 * KINK))
            good = exact.run(state, g[node + 1 :])
            return float(np.abs(basset.cumulate(g, END / n, basset.Daitche(5))[node + 1 :] - good)[n // 3 :].max())

        slope = np.log2(careless(240) / careless(960)) / 2.0
        assert 0.8 < slope < 1.7


# --------------------------------------------------------------------------------------------------------- refusals


class TestRefusals:
    @every_stream
    def test_before_there_is_a_sample(self, stream):
        plan = stream.plan()
        state = plan.start()
        before = copied(state)
        for g in (None, 1.0):
            with pytest.raises(ValueError, match="jump needs a first sample"):
                plan.jump(state, 1.0, 0.0, g)
        assert same(state, before)

    @every_stream
    @each(
        "age, kink, sentence",
        [
            *((age, None, r"age must be a finite number, 0 or greater \(seconds\), got") for age in (-0.1, np.nan, np.inf)),
            (1.5 * DT, 1.0, rf"age must not exceed the step dt = {DT:g} seconds where g is given, got"),
        ],
    )
    def test_ages_are_not_negative_and_a_kink_lies_in_the_newest_step(self, stream, age, kink, sentence):
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(5))
        before = copied(state)
        with pytest.raises(ValueError, match=sentence):
            plan.jump(state, 1.0, age, kink)
        assert same(state, before)

    @every_stream
    def test_older_than_the_first_sample(self, stream):
        """Its lags reach beyond the horizon: refused, or the promise is kept even there."""
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.zeros(8))
        before = copied(state)
        try:
            plan.jump(state, 1.0, 30.5 * DT)
        except ValueError as refusal:
            assert "age must" in str(refusal)
            assert same(state, before)
            return
        H, lags = plan.run(state, np.zeros(HORIZON - 7)), 30.5 + np.arange(1, HORIZON - 6)
        np.testing.assert_allclose(H, 0.0 if stream.forgets else 1.0 / np.sqrt(lags * DT), rtol=stream.rtol + 1e-13)

    @every_stream
    def test_at_the_last_node_of_the_horizon(self, stream):
        """Nothing can follow: the jump is accepted, the value is right."""
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.zeros(HORIZON + 1))
        plan.jump(state, 1.0, 0.25 * DT)
        assert plan.value(state) == pytest.approx(1.0 / np.sqrt(0.25 * DT), rel=stream.rtol + 1e-13)
