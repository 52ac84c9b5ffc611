"""Every case that is known to break history integrals, each by name: weights, rules, sums and streams must stay stable."""

from __future__ import annotations

from itertools import pairwise

import mpmath
import numpy as np
import pytest
from rule_cases import EPS, GRAIN
from stream_cases import DT, HORIZON, STREAMS, WINDOW, chosen, copied, every_stream, history, same

import basset
from basset import reference
from basset.problems import PROBLEMS

pytestmark = pytest.mark.analytic

orders = pytest.mark.parametrize("order", [1, 2, 3, 4, 6, 10])
LEAN = ["daitche_3", "windowed_daitche_3", "tailed_daitche_3", "exponential_1", "exponential_3", "exponential_6"]


def streamed(rule: basset.Rule, g: np.ndarray, dt: float, slip: float = 0.0, kernel: basset.Kernel = basset.BassetKernel()) -> np.ndarray:
    plan = rule.plan(dt, (len(g) - 1) * dt, kernel)
    state = plan.start()
    first = plan.run(state, g[:1])
    plan.jump(state, slip)
    return np.concatenate([first, plan.run(state, g[1:])])


# --------------------------------------------------------------------------------------------------------------- weights


@pytest.mark.parametrize("order", [1, 3, 6])
def test_weights_to_ten_million(order):
    """The published differences of powers have no digit left here; these are good to rounding."""
    n = 10**7
    weights = basset.Daitche(order).weights(n, 1.0)
    assert np.isfinite(weights).all()
    # a step of the rate: all weights together are ∫K = 2√n, summed pairwise
    assert weights.sum() == pytest.approx(2.0 * np.sqrt(n), rel=1e-14)
    indices = [10**4, 10**6, n // 2, n - 2 * order - 2, n - 1, n]
    for j, exact in zip(indices, reference.product_weights(n, indices, order), strict=True):
        assert abs(mpmath.mpf(float(weights[j])) / exact - 1) < 16 * EPS, j


def test_two_to_the_twenty_steps():
    """f' = cos to 50π by the whole history in one FFT, and streamed: both at the rounding of 1e6 terms."""
    n, end = 2**20, 50.0 * np.pi
    g = np.cos(np.linspace(0.0, end, n + 1))
    exact = reference.cosine(end)
    assert abs(basset.integrate(g, end / n, basset.Daitche(4)) - exact) < 1e-14 * 10
    assert abs(basset.cumulate(g, end / n, basset.Daitche(4))[-1] - exact) < 1e-13 * 10
    assert abs(streamed(basset.Exponential(4, 1e-12), g, end / n)[-1] - exact) < 1e-12 * 2.0 * np.sqrt(end)


def test_a_time_of_ten_thousand_pi():
    """Five thousand periods: the error at the end is that at the beginning."""
    problem, n = PROBLEMS["fresnel_long"], 2**20
    t, dt = problem.grid(n)
    H = streamed(basset.Exponential(6, 1e-10), problem.rate(t), dt)
    error = np.abs(H[1:] - problem.exact(t[1:]))
    promise = 1e-10 * 2.0 * np.sqrt(problem.end)
    assert error[n // 2 :].max() < promise + 1e-9  # and Daitche(6)'s own error at 200 steps per period
    assert error[-n // 10 :].max() <= 2.0 * error[n // 10 : n // 5].max()


# ------------------------------------------------------------------------------------------------------------ the start


@orders
def test_a_slip_that_does_not_start_from_rest(order):
    """f(0) ≠ 0: f = cos."""
    problem = PROBLEMS["sine_with_slip"]
    t, dt = problem.grid(4000)
    H = streamed(basset.Exponential(order, 1e-9), problem.rate(t), dt, problem.initial_slip)
    error = np.abs(H[1:] - problem.exact(t[1:])) / (1.0 + 1.0 / np.sqrt(t[1:]))
    # start-up in the first `order` steps uses lower degrees: dt^2.5 there, whatever the order
    assert error.max() < 4.0 * dt ** min(order + 1.0, 2.5) + 1e-8
    assert error[200:].max() < 1.0 * dt ** min(order + 1.0, 3.5) + 1e-8


@every_stream
def test_the_root_of_time_as_a_stream(stream):
    """A stream takes rates: an infinite one is refused, one infinite only before the first sample keeps everything finite."""
    plan = stream.plan()
    state = plan.start()
    before = copied(state)
    with pytest.raises(ValueError, match="g must be finite, got inf"):
        plan.push(state, np.inf)
    assert same(state, before)
    t = DT * np.arange(1, HORIZON + 1)
    H = plan.run(state, 0.5 / np.sqrt(t))
    assert np.isfinite(H).all()
    assert np.abs(H).max() < np.pi


# --------------------------------------------------------------------------------------------------------------- jumps


@chosen(name for name, stream in STREAMS.items() if stream.degree >= 1)
def test_a_zeno_cascade(stream):
    """45 bounces, ever closer, each with half the jump and the other acceleration; then rest. Exact at every node."""
    span, count = 20 * DT, 45
    times = np.append(3.3 * DT + span * (1.0 - 0.5 ** np.arange(1.0, count + 1.0)), 3.3 * DT + span)
    sizes, rates = np.append(0.5 ** np.arange(float(count)), 0.0), np.append((-1.0) ** np.arange(count), 0.0)
    edges = [0.0, *times, np.inf]
    pieces = [(a, b, np.array([rate])) for (a, b), rate in zip(pairwise(edges), [1.0, *rates], strict=True)]
    plan = stream.plan()
    state = plan.start()
    plan.push(state, 1.0)
    done, values = 0, []
    for n in range(1, 90):
        passed = int(np.searchsorted(times, n * DT))
        plan.push(state, rates[passed - 1] if passed else 1.0)
        for k in range(done, passed):
            plan.jump(state, sizes[k], n * DT - times[k], rates[k])
        done = passed
        values.append(plan.value(state))
    exact = history(np.arange(1, 90) * DT, pieces, list(zip(times, sizes, strict=True)), WINDOW * DT if stream.forgets else np.inf)
    np.testing.assert_allclose(values, exact, rtol=0.0, atol=(1e-12 + stream.rtol) * 20.0)
    assert done == count + 1


# --------------------------------------------------------------------------------------------------------------- kernels


@chosen(name for name, stream in STREAMS.items() if issubclass(basset.MeiAdrianKernel, stream.kernels))
def test_no_slip_in_the_finite_reynolds_kernel(stream):
    """U = 0: the standard kernel, bit for bit where the same sums are used; U → 0 goes there smoothly."""
    g = np.cos(np.arange(HORIZON + 1.0))
    standard = stream.plan().run(stream.plan().start(), g)
    plan = stream.plan(kernel=basset.MeiAdrianKernel(**(GRAIN | {"slip": 0.0})))
    np.testing.assert_allclose(plan.run(plan.start(), g), standard, rtol=0.0, atol=1e-13 * np.abs(standard).max())


@orders
def test_almost_no_slip(order):
    """Re → 0: K differs from s^(-1/2) by c1 (C s^(3/2))^(1/c1): H follows, without a jump in between."""
    g = np.cos(np.arange(101.0) * 0.1)
    standard = basset.cumulate(g, 0.1, basset.Daitche(order))
    for slip in (1e-8, 1e-12, 1e-100, 1e-300):
        kernel = basset.MeiAdrianKernel(**(GRAIN | {"slip": slip}))
        change = 2.0 * np.sqrt(kernel.steepness * 10.0**1.5) * 2.0 * np.sqrt(10.0)
        assert np.abs(basset.cumulate(g, 0.1, basset.Daitche(order), kernel) - standard).max() <= change + 1e-13


# --------------------------------------------------------------------------------------------------------------- limits


@chosen(LEAN)
def test_read_only_input_and_the_callers_arrays_stay_as_they_are(stream):
    g = np.random.default_rng(1).standard_normal((HORIZON + 1, 2))
    delta = np.array([0.5, -0.5])
    kept, kept_delta = g.copy(), delta.copy()
    g.flags.writeable = delta.flags.writeable = False
    plan = stream.plan()
    state = plan.start((2,))
    plan.push(state, g[0])
    plan.jump(state, delta, 0.0, g[0])
    plan.run(state, g[1:])
    np.testing.assert_array_equal(g, kept)
    np.testing.assert_array_equal(delta, kept_delta)
    assert not any(np.shares_memory(array, g) for array in state)
