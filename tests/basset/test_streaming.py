"""Streams: the same numbers as the whole history, one sample at a time, in constant memory, from any saved state."""

from __future__ import annotations

import copy
import io
import pickle

import numpy as np
import pytest
from all_cases import each
from rule_cases import EPS, samples
from stream_cases import BOUNDED, DT, ENDLESS, HORIZON, STREAMS, WINDOW, chosen, copied, every_stream, same, with_kernels

import basset
from basset.kernels import gauss_legendre
from basset.problems import PROBLEMS
from basset.quadrature.newton_cotes import OpenTrapezoid
from basset.streaming import State
from basset.weights.lagrange import lagrange

SHAPES = [(), (3,), (2, 3), (1, 1, 4)]


def largest(H: np.ndarray) -> float:
    return float(np.abs(H).max())


def direct_weights(n: int, degree: int, kernel: basset.Kernel, dt: float, window: int | None, tail) -> np.ndarray:
    """Weights by definition: on every panel the polynomial through its samples, against the kernel or, beyond the window, the sum."""
    degree = min(degree, n)
    x, w = gauss_legendre(64)
    result = np.zeros(n + 1)
    polynomials: dict[int, np.ndarray] = {}  # of samples that lie alike around a panel
    for k in range(n):
        near, share = (x**10, 10.0 * x**9 * w) if k == 0 else (x, w)  # x^10: smooth for every kernel here at zero lag
        lag = (k + near) * dt
        values = kernel(lag) if window is None or k < window else tail(lag)
        start = min(max(k - degree // 2, 0), n - degree)
        place = k - start if k else -1  # the first panel has nodes of its own
        if place not in polynomials:
            polynomials[place] = lagrange(np.arange(degree + 1.0), k + near - start)[0]
        result[start : start + degree + 1] += dt * (share * values) @ polynomials[place]
    return result


class TestOneHistoryManyWays:
    """run ≡ push one by one ≡ weights ≡ cumulate, to 1e-13 of the largest |H|."""

    @with_kernels(STREAMS)
    def test_run_and_push_and_tail_and_weights_and_cumulate(self, stream, kernel):
        g = samples(HORIZON)
        plan = stream.plan(kernel=kernel)
        H = plan.run(plan.start(), g)
        scale = largest(H)
        state, one_by_one, split = plan.start(), [], []
        for sample in g:
            split.append(plan.tail(state) + plan.local(state) * sample)
            plan.push(state, sample)
            one_by_one.append(plan.value(state))
        np.testing.assert_array_equal(one_by_one, H)  # the same code on the same numbers
        np.testing.assert_allclose(split, H, rtol=0.0, atol=1e-13 * scale)
        by_weights = [0.0] + [plan.weights(n) @ g[n::-1] for n in range(1, HORIZON + 1)]
        np.testing.assert_allclose(by_weights, H, rtol=0.0, atol=1e-13 * scale)
        rule = stream.make(DT, HORIZON * DT, kernel)
        np.testing.assert_allclose(basset.cumulate(g, DT, rule, kernel), H, rtol=0.0, atol=1e-13 * scale)
        np.testing.assert_allclose(rule.weights(HORIZON, DT, kernel), plan.weights(HORIZON), rtol=0.0, atol=1e-14 * scale)

    @with_kernels(STREAMS, accepted=False)
    def test_a_kernel_that_the_method_has_no_form_for(self, stream, kernel):
        with pytest.raises((ValueError, TypeError), match=r"kernel must be .*Basset"):
            stream.plan(kernel=kernel)

    @with_kernels(name for name, stream in STREAMS.items() if stream.degree >= 1 and not stream.forgets)
    def test_weights_are_their_definition(self, stream, kernel):
        """Panel by panel, with the sum in place of the kernel beyond the window; every weight to 1e-13 of the largest."""
        plan = stream.plan(kernel=kernel)
        degree, window = stream.degree, plan.recipe.window
        for n in (1, 2, degree, degree + 1, 2 * degree, 2 * degree + 1, WINDOW - 1, WINDOW, WINDOW + degree + 2, WINDOW + 3 * degree, 100, HORIZON):
            # before the first panel has left the window for good, rows are those of the whole history
            edge = None if window is None or n < plan.tables.steady else window
            expected = direct_weights(n, degree, kernel, DT, edge, plan.tail_sum)
            np.testing.assert_allclose(plan.weights(n), expected, rtol=0.0, atol=1e-13 * largest(expected), err_msg=str(n))

    @chosen(name for name, stream in STREAMS.items() if stream.forgets)
    def test_what_is_older_than_the_window_adds_nothing(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(WINDOW))
        H = plan.run(state, np.zeros(HORIZON - WINDOW))
        assert np.abs(H[: WINDOW - 1]).min() > 0.0
        assert not H[WINDOW + 1 :].any()

    @chosen(name for name, stream in STREAMS.items() if not stream.forgets)
    def test_or_something_for_ever(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(WINDOW))
        assert (plan.run(state, np.zeros(HORIZON - WINDOW)) > 0.0).all()

    @pytest.mark.parametrize("order", [1, 3, 6])
    def test_a_horizon_within_the_window_is_the_whole_history(self, order):
        g = samples(WINDOW - 4)
        tail = basset.ExponentialSum.fit(WINDOW * DT, 100.0, 1e-3)
        for rule in (basset.Windowed(basset.Daitche(order), WINDOW * DT, tail), basset.Windowed(basset.Daitche(order), WINDOW * DT)):
            plan = rule.plan(DT, (WINDOW - 4) * DT)
            H = plan.run(plan.start(), g)
            np.testing.assert_allclose(H, basset.cumulate(g, DT, basset.Daitche(order)), rtol=0.0, atol=1e-13 * largest(H))


class TestSplitTailAndLocal:
    @every_stream
    def test_affine_in_the_next_sample(self, stream):
        """At every phase of the stream, and without a trace in the state."""
        plan, g = stream.plan(), samples(HORIZON, 2)
        state = plan.start((2,))
        scale = largest(plan.run(plan.start((2,)), g))
        for n, sample in enumerate(g[: WINDOW + 40]):
            before = copied(state)
            tail, local = plan.tail(state), plan.local(state)
            assert same(before, state)
            for newest in (np.array([5.0, -3.0]), np.zeros(2)):
                other = copied(state)
                plan.push(other, newest)
                np.testing.assert_allclose(plan.value(other), tail + local * newest, rtol=0.0, atol=1e-13 * scale, err_msg=str(n))
            plan.push(state, sample)

    @every_stream
    def test_local_is_the_newest_weight(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.push(state, 1.0)
        for n in range(1, WINDOW + 40):
            assert plan.local(state) == pytest.approx(plan.weights(n)[0], rel=1e-14)
            open_formula = isinstance(plan.recipe.stencil, OpenTrapezoid)
            assert (plan.local(state) > 0.0) == (not open_formula or n == 1)
            plan.push(state, 1.0)


class TestBlocks:
    @every_stream
    @each("cuts", [[1], [1, 2, 3], [WINDOW, WINDOW + 1], [7, 7, 90], [0, 50, HORIZON + 1]])
    def test_chunked_runs_equal_one_run_bit_for_bit(self, stream, cuts):
        plan, g = stream.plan(), samples(HORIZON, 3)
        whole, state = plan.start((3,)), plan.start((3,))
        expected = plan.run(whole, g)
        blocks = [plan.run(state, block) for block in np.split(g, cuts)]
        np.testing.assert_array_equal(np.concatenate(blocks), expected)
        assert same(state, whole)

    @every_stream
    @each("shape", SHAPES)
    def test_any_shape_of_a_sample(self, stream, shape):
        plan, g = stream.plan(), samples(HORIZON, *shape)
        state = plan.start(shape)
        H = plan.run(state, g)
        assert H.shape == g.shape
        assert np.shape(plan.value(state)) == np.shape(H[-1]) == shape
        columns = g.reshape(HORIZON + 1, -1)
        for c in range(columns.shape[1]):
            np.testing.assert_array_equal(plan.run(plan.start(), columns[:, c]), H.reshape(columns.shape)[:, c])

    @every_stream
    def test_no_component_or_sample_at_all(self, stream):
        plan = stream.plan()
        for shape in ((2, 0), (0, 3)):
            state = plan.start(shape)
            plan.push(state, np.empty(shape))
            plan.jump(state, 1.0, 0.0, np.empty(shape))
            assert plan.run(state, np.empty((9, *shape))).shape == (9, *shape)
        state = plan.start((3,))
        before = copied(state)
        assert plan.run(state, np.empty((0, 3))).shape == (0, 3)
        assert same(state, before)

    @every_stream
    def test_permuting_grains_permutes_results_bit_for_bit(self, stream):
        plan, g = stream.plan(), samples(HORIZON, 21, 3)  # more grains than are advanced together
        order = np.random.default_rng(5).permutation(21)
        state, permuted = plan.start((21, 3)), plan.start((21, 3))
        np.testing.assert_array_equal(plan.run(permuted, g[:, order]), plan.run(state, g)[:, order])
        np.testing.assert_array_equal(plan.value(permuted), plan.value(state)[order])

    @every_stream
    def test_any_layout_and_type_of_samples(self, stream):
        plan = stream.plan()
        whole = np.random.default_rng(2).integers(-9, 9, (HORIZON + 1, 3))
        expected = plan.run(plan.start((3,)), whole.astype(float))
        frozen = whole.astype(float)
        frozen.flags.writeable = False
        strided = np.zeros((2 * HORIZON + 2, 6))
        strided[::2, ::2] = whole
        for g in (whole, whole.astype(np.float32), whole.astype(np.int8), np.asfortranarray(whole.astype(float)), frozen, strided[::2, ::2], whole.tolist()):
            np.testing.assert_allclose(plan.run(plan.start((3,)), g), expected, rtol=0.0, atol=1e-13)  # sums are ordered by where arrays lie

    def test_the_callers_array_is_neither_modified_nor_kept(self):
        plan, g = STREAMS["exponential_3"].plan(), samples(HORIZON, 3)
        kept = g.copy()
        state = plan.start((3,))
        first = plan.run(state, g[:80])
        np.testing.assert_array_equal(g, kept)
        value = plan.value(state)
        g[:80] = np.nan
        first[:] = np.nan
        value[:] = np.nan
        assert np.isfinite(plan.run(state, g[80:])).all()


def through_a_file(state: State) -> State:
    file = io.BytesIO()
    np.savez(file, **state._asdict())
    file.seek(0)
    with np.load(file, allow_pickle=False) as archive:
        return State(**archive)


WAYS = {"pickle": lambda state: pickle.loads(pickle.dumps(state)), "deepcopy": copy.deepcopy, "savez": through_a_file}


class TestRestart:
    @every_stream
    @each("way", WAYS.values())
    def test_a_saved_state_continues_bit_for_bit(self, stream, way):
        plan, g = stream.plan(), samples(HORIZON, 2)
        for stop in (0, 1, 3, WINDOW - 1, WINDOW + 2, 120):
            state = plan.start((2,))
            plan.run(state, g[:stop])
            if stop:
                plan.jump(state, np.array([0.3, -1.0]), age=min(0.4, stop - 1.0) * DT)
            loaded = way(state)
            assert same(loaded, state)
            # another plan, as another process would make it
            other = stream.plan()
            np.testing.assert_array_equal(other.run(loaded, g[stop:]), plan.run(state, g[stop:]))
            assert same(loaded, state)

    @every_stream
    def test_states_are_plain_float64_arrays(self, stream):
        state = stream.plan().start((2, 3))
        assert all(type(array) is np.ndarray and array.dtype == np.float64 for array in state)

    @every_stream
    def test_two_states_of_one_plan_do_not_mix(self, stream):
        plan, a, b = stream.plan(), samples(HORIZON, seed=1), samples(HORIZON, seed=2)
        first, second = plan.start(), plan.start()
        mixed = []
        for x, y in zip(a, b, strict=True):
            plan.push(first, x)
            plan.push(second, y)
            mixed.append((plan.value(first), plan.value(second)))
        np.testing.assert_array_equal(np.array(mixed), np.stack([plan.run(plan.start(), a), plan.run(plan.start(), b)], axis=1))


class TestRefusalsLeaveTheStateAlone:
    @every_stream
    @each("bad", [np.nan, np.inf, -np.inf])
    def test_a_sample_that_is_not_finite(self, stream, bad):
        plan, g = stream.plan(), samples(50, 2)
        state = plan.start((2,))
        plan.run(state, g)
        before = copied(state)
        g[30, 1] = bad
        with pytest.raises(ValueError, match=r"G must be finite, got -?(nan|inf) in sample 30"):
            plan.run(state, g)
        with pytest.raises(ValueError, match=r"g must be finite, got -?(nan|inf)"):
            plan.push(state, g[30])
        with pytest.raises(ValueError, match=r"delta must be finite, got -?(nan|inf)"):
            plan.jump(state, g[30])
        with pytest.raises(ValueError, match=r"g must be finite, got -?(nan|inf)"):
            plan.jump(state, 1.0, 0.0, g[30])
        assert same(state, before)

    @chosen(BOUNDED)
    def test_the_horizon_exceeded(self, stream):
        plan = stream.plan()
        state = plan.start()
        plan.run(state, np.ones(HORIZON))
        assert plan.steps == HORIZON
        before = copied(state)
        with pytest.raises(ValueError, match=rf"horizon must cover the stream: it was planned for {HORIZON} steps .*got step {HORIZON + 1}"):
            plan.run(state, np.ones(2))
        assert same(state, before)
        plan.push(state, 1.0)  # the last one that is covered
        last = copied(state)
        for beyond in (lambda: plan.push(state, 1.0), lambda: plan.tail(state), lambda: plan.local(state)):
            with pytest.raises(ValueError, match="horizon must cover the stream"):
                beyond()
        assert same(state, last)
        assert plan.value(state) == last.history

    @chosen(ENDLESS)
    def test_a_window_or_a_published_tail_runs_on_beyond_it(self, stream):
        """The same weights for ever: a longer horizon gives the same bits."""
        plan, g = stream.plan(), samples(6 * HORIZON)
        assert plan.steps is None
        longer = stream.plan(steps=7 * HORIZON)
        np.testing.assert_array_equal(plan.run(plan.start(), g), longer.run(longer.start(), g))

    @each("shape", SHAPES)
    def test_wrong_shapes(self, shape):
        plan = STREAMS["exponential_2"].plan()
        state = plan.start(shape)
        plan.push(state, np.ones(shape))
        before = copied(state)
        for wrong in ((7,), (*shape, 2), (2, *shape)):
            with pytest.raises(ValueError, match=r"g must have the shape .* of one sample, got"):
                plan.push(state, np.ones(wrong))
            with pytest.raises(ValueError, match=r"delta must have the shape .* of one sample, got"):
                plan.jump(state, np.ones(wrong))
            with pytest.raises(ValueError, match=r"g must have the shape .* of one sample, got"):
                plan.jump(state, 1.0, g=np.ones(wrong))
        for wrong in ((4, *shape, 5), (4, 9, 9, 9, 9), ()):
            with pytest.raises(ValueError, match=r"G must have the shape \(steps, .*got"):
                plan.run(state, np.ones(wrong))
        assert same(state, before)

    @each("value", ["fast", None, [1.0, "x"], 1j])
    def test_what_holds_no_real_numbers(self, value):
        plan = STREAMS["exponential_2"].plan()
        state = plan.start()
        with pytest.raises(TypeError, match="g must be an array of real numbers"):
            plan.push(state, value)

    @each("shape", [-1, (2, -3), 1.5, "3", (2.0,)])
    def test_a_shape_is_made_of_whole_numbers(self, shape):
        with pytest.raises((ValueError, TypeError), match="shape must be a whole number, 0 or greater"):
            STREAMS["exponential_2"].plan().start(shape)

    @each("dt, horizon", [(0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (0.1, 0.0), (0.1, -1.0), (0.1, np.inf)])
    def test_steps_and_horizons_are_positive(self, dt, horizon):
        for rule in (basset.Daitche(2), basset.Exponential(2), basset.Windowed(basset.Daitche(2), 1.0)):
            with pytest.raises(ValueError, match=r"(dt|horizon) must be a finite number greater than 0 \(seconds\), got"):
                rule.plan(dt, horizon)

    def test_an_exponential_that_no_sum_can_keep(self):
        with pytest.raises(ValueError, match=r"rtol must be at least"):
            basset.Exponential(3, 1e-14).plan(1.0, 1e11)

    @each("order, rtol", [(0, 1e-6), (11, 1e-6), (3, 0.0), (3, 1.0), (3, -1.0)])
    def test_exponential_parameters(self, order, rtol):
        with pytest.raises(ValueError, match=r"^(order|rtol) must be"):
            basset.Exponential(order, rtol)


class TestTheHorizonIsCountedInSteps:
    @each("dt, horizon, steps", [(0.1, 1.0, 10), (0.1, 0.95, 10), (0.1, 1.01, 11), (1.0 / 3.0, 10.0, 30), (0.5, 0.1, 1), (1e-3, 1e3, 10**6)])
    def test_rounded_up(self, dt, horizon, steps):
        assert basset.Exponential(2, 1e-6).plan(dt, horizon).steps == steps


class TestAMillionSteps:
    N, STEP = 10**6, 0.02

    @pytest.mark.parametrize("order", range(1, 7))
    def test_daitche_with_a_fitted_tail_agrees_with_the_whole_history(self, order):
        """1e-9 of max|H| for a tail of 1e-10, and no growth: the difference is within rtol·∫K|g| = 1e-10·2√t at every node."""
        t = self.STEP * np.arange(self.N + 1)
        g = np.cos(t)
        plan = basset.Windowed(basset.Daitche(order), 40 * self.STEP, basset.ExponentialSum.fit(40 * self.STEP, self.N * self.STEP, 1e-10)).plan(
            self.STEP, t[-1]
        )
        H, whole = plan.run(plan.start(), g), basset.cumulate(g, self.STEP, basset.Daitche(order))
        difference = np.abs(H - whole)
        assert difference.max() <= 1e-9 * largest(whole)
        tenth = self.N // 10
        assert difference[-tenth:].max() <= 2.0 * difference[tenth : 2 * tenth].max() + 1e-13 * largest(whole)

    @each("name", ["tailed_daitche_3", "exponential_1", "exponential_3", "exponential_6", "hinsberg_published"])
    def test_a_bounded_rate_gives_no_growth_and_forgets_its_start(self, name):
        """Random rates for 1e6 steps: |H| stays within ∫K|g| and rounding does not pile up: what two starts differ in decays as K."""
        stream = STREAMS[name]
        plan, rng = stream.plan(self.STEP, self.N), np.random.default_rng(3)
        a, b = plan.start(), plan.start()
        early = rng.uniform(-1.0, 1.0, 1000)
        plan.run(a, early)
        plan.run(b, -early)
        for _ in range(10):
            block = rng.uniform(-1.0, 1.0, (self.N - 1000) // 10)
            H, other = plan.run(a, block), plan.run(b, block)
            assert largest(H) < 20.0 * np.sqrt(self.STEP) * 4.0  # a random walk against K: √(dt ln n) times a few
        lag = self.STEP * self.N
        # 2·|∫ early| / √lag at most
        assert abs(H[-1] - other[-1]) <= 2.0 * self.STEP * np.abs(early).sum() / np.sqrt(lag) * 1.05

    @each("name", ["tailed_daitche_3", "exponential_3", "hinsberg_published", "windowed_daitche_3"])
    def test_constant_memory(self, name):
        stream = STREAMS[name]
        plan = stream.plan(self.STEP, self.N)
        state = plan.start((3,))
        held = sum(array.nbytes for array in state)
        arrays = [id(array) for array in state]
        plan.run(state, np.ones((1000, 3)))
        plan.jump(state, 1.0)
        plan.run(state, np.ones((2000, 3)))
        assert arrays == [id(array) for array in state]
        assert held == sum(array.nbytes for array in state)

    def test_memory_of_the_leanest_stream(self):
        """Order 3, rtol 1e-6, 1e6 steps: a grain of three components fits into 1 kB."""
        plan = basset.Exponential(3, 1e-6).plan(1e-3, 1e3)
        assert len(plan.tail_sum) <= 24
        assert sum(array.nbytes for array in plan.start((1000, 3))) <= 1000 * 1000 + 100

    def test_memory_does_not_depend_on_the_horizon(self):
        sizes = [sum(array.nbytes for array in basset.Exponential(3, 1e-6).plan(1.0, steps).start((3,))) for steps in (1e2, 1e4, 1e6)]
        terms = [len(basset.Exponential(3, 1e-6).plan(1.0, steps).tail_sum) for steps in (1e2, 1e4, 1e6)]
        assert np.diff(sizes).tolist() == (3 * 8 * np.diff(terms)).tolist()


class TestExponentialKeepsItsBound:
    """|H − Daitche(order)| ≤ rtol·∫ K |g| over the older panels, at every node."""

    @pytest.mark.parametrize("order", [1, 2, 3, 4, 6, 10])
    @each("rtol", [1e-2, 1e-5, 1e-9, 1e-13])
    @each("name", ["fresnel_generic", "decay", "power_0", "sine_with_slip"])
    def test_on_smooth_problems(self, order, rtol, name):
        problem = PROBLEMS[name]
        n = 3000
        t, dt = problem.grid(n)
        g = problem.rate(t)
        H = basset.cumulate(g, dt, basset.Exponential(order, rtol)) - basset.cumulate(g, dt, basset.Daitche(order))
        # ∫K|g| by the trapezoid on |g|, exact for the straight line; 1.01 covers polynomials that differ from it
        bound = rtol * basset.cumulate(np.abs(g), dt, basset.Daitche(1)) * 1.01
        rounding = 64 * EPS * largest(basset.cumulate(np.abs(g), dt, basset.Daitche(1)))
        assert (np.abs(H) <= bound + rounding).all()
        assert np.abs(H).max() > 0.0

    @chosen(name for name, stream in STREAMS.items() if stream.degree == 1 and stream.rtol)
    def test_on_every_single_weight(self, stream):
        """Degree one has basis functions ≥ 0, so the bound holds weight by weight."""
        for n in (WINDOW + 5, 100, HORIZON):
            weights, whole = stream.plan().weights(n), basset.Daitche(1).weights(n, DT)
            assert (np.abs(weights - whole) <= (stream.rtol + 64 * EPS) * whole).all()
