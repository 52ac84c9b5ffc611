"""Kernels whose slip varies: the steady limit, the definition of each reading, order, jumps, range and refusals."""

from __future__ import annotations

import pickle
from functools import cache

import numpy as np
import pytest

import basset
from basset import Daitche, Exponential, MeiAdrianKernel, VaryingSlipKernel, Windowed

DIAMETER, VISCOSITY, RANGE = 1e-3, 1e-6, (0.005, 0.4)
CONSTANTS = {"mei_adrian": (2.0, 0.105), "dorgan_loth": (2.5, 0.2)}


def kernel(slip_at: str = "t", name: str = "mei_adrian") -> VaryingSlipKernel:
    return VaryingSlipKernel(DIAMETER, VISCOSITY, RANGE, slip_at, *CONSTANTS[name])


def signal(n: int, end: float = 6.0) -> tuple[np.ndarray, np.ndarray, float]:
    t = np.linspace(0.0, end, n + 1)
    return t, np.cos(t) + 0.3 * np.sin(3.0 * t), end / n


STEADY = [
    *((Daitche(p), at, 1e-13) for p in (1, 3, 5) for at in ("t", "tau")),
    *((Windowed(Daitche(p), 1.5), at, 1e-13) for p in (1, 2, 6) for at in ("t", "tau")),
    *((rule, at, 1e-13) for rule in (basset.EulerMaclaurin(), basset.Brush(), Windowed(basset.Brush(), 1.5)) for at in ("t", "tau")),
    # the promise is rtol·∫K|g|, at most a few times rtol·max|H| for this signal
    *((Exponential(p, 1e-9), "t", 1e-8) for p in (1, 2, 3, 6, 10)),
]


@pytest.mark.parametrize("name", CONSTANTS)
@pytest.mark.parametrize(("rule", "slip_at", "tolerance"), STEADY)
def test_a_steady_slip_is_the_fixed_kernel(rule: basset.Rule, slip_at: str, tolerance: float, name: str) -> None:
    _, g, dt = signal(400)
    varying = kernel(slip_at, name)
    plan = rule.plan(dt, 6.0, varying)
    history = plan.run(plan.start(), g, np.full(len(g), 0.05))
    whole = Daitche(rule.order) if isinstance(rule, Exponential) else rule
    exact = basset.cumulate(g, dt, whole, kernel=varying.at(0.05))
    assert np.abs(history - exact).max() <= tolerance * np.abs(exact).max()


@pytest.mark.parametrize("slip_at", ["t", "tau"])
@pytest.mark.parametrize("rule", [Daitche(2), Daitche(3), Windowed(Daitche(3), 1.0)])
def test_each_reading_follows_its_definition(rule: basset.Rule, slip_at: str) -> None:
    """H_n = Σ_j w_j(U) g_{n−j} with U = U(t_n) or U(t_{n−j}): from the fixed-slip weights of `rule.weights`."""
    t, g, dt = signal(60, 3.0)
    slip = 0.05 * (1.0 + 0.6 * np.sin(2.0 * t))
    varying = kernel(slip_at)
    plan = rule.plan(dt, 3.0, varying)
    history = plan.run(plan.start(), g, slip)
    for n in (1, 2, 4, 6, 7, 8, 30, 60):
        if slip_at == "t":
            expected = rule.weights(n, dt, varying.at(slip[n])) @ g[n::-1]
        else:
            expected = sum(rule.weights(n, dt, varying.at(slip[n - j]))[j] * g[n - j] for j in range(n + 1))
        assert history[n] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("slip_at", ["t", "tau"])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_direct_sums_keep_their_order_for_a_varying_slip(order: int, slip_at: str) -> None:
    truth = directly(7, 1024, slip_at)
    errors = []
    for n in (256, 512):
        difference = directly(order, n, slip_at) - truth[:: 1024 // n]
        errors.append(np.abs(difference[n // 2 :]).max())
    assert np.log2(errors[0] / errors[1]) >= order + 1.0 - 0.25


@cache
def directly(order: int, n: int, slip_at: str) -> np.ndarray:
    t = np.linspace(0.0, 7.3, n + 1)
    plan = Daitche(order).plan(7.3 / n, 7.3, kernel(slip_at))
    return plan.run(plan.start(), np.cos(t), 0.05 * (1.0 + 0.5 * np.sin(2.0 * t)))


T = np.linspace(0.0, 6.0, 151)
SLIPS = {
    "slow": 0.05 * (1.0 + 0.5 * np.sin(2.0 * T)),
    "fast": 0.05 * (1.0 + 0.98 * np.sin(70.0 * T)),
    "another at every node": np.random.default_rng(3).uniform(0.0, 0.5, len(T)),
    "jumps": np.where(T % 2.0 < 1.0, 0.006, 0.39),
    "stops": np.where((T > 2.0) & (T < 4.0), 0.0, 0.2),
    "outside": 0.8 * T,
}


@cache
def with_a_jump(rule: basset.Rule, slip: str, name: str, size: bool = False) -> np.ndarray:
    """H of rates and of a jump halfway; `size`: of the sizes of the rates."""
    g, slips = np.cos(T) + 0.3 * np.sin(3.0 * T), SLIPS[slip]
    rates = np.abs(g) if size else g
    plan = rule.plan(T[1], 6.0, kernel("t", name))
    state = plan.start()
    first = plan.run(state, rates[:70], slips[:70])
    plan.jump(state, 0.7)
    found = np.concatenate([first, plan.run(state, rates[70:], slips[70:])])
    assert plan.outside(state) == np.count_nonzero((slips < RANGE[0]) | (slips > RANGE[1]))
    return found


@pytest.mark.parametrize("name", CONSTANTS)
@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize(("order", "rtol"), [(1, 1e-3), (3, 1e-6), (4, 1e-8), (10, 1e-11)])
def test_a_sum_keeps_its_promise_against_the_direct_sum(order: int, rtol: float, slip: str, name: str) -> None:
    """|H − direct| ≤ rtol·∫K|g|."""
    found, exact = (with_a_jump(rule, slip, name) for rule in (Exponential(order, rtol), Daitche(order)))
    scale = with_a_jump(Daitche(1), slip, name, size=True)
    assert np.all(np.abs(found - exact) <= rtol * scale * 1.001 + 1e-13 * scale.max())


@pytest.mark.parametrize("slip_range", [(1e-9, 1e-8), (1e-9, 1e3), (50.0, 1e3)])
@pytest.mark.parametrize("dt", [1e-6, 1e-2, 1e2])
def test_kernels_near_basset_s_and_far_from_it(slip_range: tuple[float, float], dt: float) -> None:
    """The whole range of C for the step: from the Basset kernel to one that has faded within a step."""
    wide = VaryingSlipKernel(DIAMETER, VISCOSITY, slip_range)
    slip, g = np.geomspace(*slip_range, 100), np.cos(0.1 * np.arange(100.0))
    found, exact = (plan.run(plan.start(), g, slip) for plan in (rule.plan(dt, 100 * dt, wide) for rule in (Exponential(3, 1e-7), Daitche(3))))
    np.testing.assert_allclose(found, exact, rtol=1e-6, atol=0.0)


@pytest.mark.parametrize(("start", "tolerance"), [(0.0, 5e-7), (0.1, 3e-6)])
def test_a_stream_of_the_solved_rates_has_the_history_of_the_solver(start: float, tolerance: float) -> None:
    """y' = force − c·H: the solver's H is the stream's, within what equal steps make of the start, where y' is not smooth."""
    varying, strength, dt = kernel(), 0.8, 1e-3

    def force(t: float, y: np.ndarray) -> np.ndarray:
        return 0.3 * np.sin(1.5 * t) ** 2 - y

    t = dt * np.arange(2001)
    solved = basset.solve(force, (0.0, 2.01), [start], coefficient=strength, kernel=varying, method=basset.Collocation(rtol=1e-9), dense_output=True)
    y = solved.sol(t)[0]
    rate = np.zeros(len(t))
    rate[1:] = (solved.sol(t[1:] + 1e-5)[0] - solved.sol(t[1:] - 1e-5)[0]) / 2e-5
    plan = Exponential(3, 1e-8).plan(dt, 2.0, varying)
    state = plan.start()
    plan.push(state, rate[0], abs(y[0]))
    plan.jump(state, start)
    found = plan.run(state, rate[1:], np.abs(y[1:]))
    expected = (np.array([force(*pair) for pair in zip(t[1:], y[1:], strict=True)]) - rate[1:]) / strength
    assert y[1000:].min() > RANGE[0]
    assert np.abs(found - expected)[1000:].max() < tolerance * np.abs(expected).max()


def test_the_readings_agree_as_the_modulation_vanishes() -> None:
    """First order in the modulation: a tenth of it gives a tenth of the difference."""
    t, g, dt = signal(300)
    difference = []
    for amplitude in (0.2, 0.02):
        slip = 0.05 * (1.0 + amplitude * np.sin(2.0 * t))
        now, then = (plan.run(plan.start(), g, slip) for plan in (Daitche(3).plan(dt, 6.0, kernel(at)) for at in ("t", "tau")))
        difference.append(np.abs(now - then).max())
    assert 8.0 < difference[0] / difference[1] < 12.0


RULES = [(Daitche(3), "t"), (Daitche(3), "tau"), (Windowed(Daitche(2), 2.0), "tau"), (Windowed(Daitche(2), 2.0), "t"), (Exponential(3, 1e-10), "t")]


@pytest.mark.parametrize(("rule", "slip_at"), RULES)
def test_push_run_and_the_affine_split_agree(rule: basset.Rule, slip_at: str) -> None:
    t, g, dt = signal(40, 2.0)
    slip = 0.05 * (1.0 + 0.5 * np.sin(2.0 * t))
    plan = rule.plan(dt, 2.0, kernel(slip_at))
    block = plan.run(plan.start((2,)), np.stack([g, -2.0 * g], axis=1), slip)
    state = plan.start((2,))
    for k, rate in enumerate(g):
        rates = np.array([rate, -2.0 * rate])
        split = plan.tail(state, slip[k]) + plan.local(state, slip[k]) * rates
        plan.push(state, rates, slip[k])
        np.testing.assert_allclose(plan.value(state), block[k], rtol=0.0, atol=0.0)
        np.testing.assert_allclose(split, block[k], rtol=0.0, atol=1e-13 * np.abs(block).max())
        plan, state = pickle.loads(pickle.dumps((plan, state)))


@pytest.mark.parametrize(("rule", "slip_at"), RULES)
@pytest.mark.parametrize("at", [0, 1, 7])
def test_a_jump_adds_the_kernel(rule: basset.Rule, slip_at: str, at: int) -> None:
    dt, n = 0.01, 150
    plan = rule.plan(dt, n * dt, kernel(slip_at))
    state = plan.start()
    plan.run(state, np.zeros(at + 1), np.full(at + 1, 0.05))
    plan.jump(state, 0.7)
    history = plan.run(state, np.zeros(n - at), np.full(n - at, 0.05))
    exact = 0.7 * kernel().at(0.05)(dt * np.arange(1, n - at + 1))
    assert np.abs(history / exact - 1.0).max() <= 1e-9  # ten times the promise of the fitted sum


def test_per_grain_slips_do_not_mix() -> None:
    t, g, dt = signal(100)
    slips = np.stack([0.05 + 0.02 * np.sin(t), np.full_like(t, 0.1)], axis=1)
    rates = np.stack([np.stack([g, 2.0 * g, -g], axis=1), np.stack([g * g, g, g], axis=1)], axis=1)  # (steps, grain, 3)
    plan = Exponential(3, 1e-8).plan(dt, 6.0, kernel())
    together = plan.run(plan.start((2, 3)), rates, slips)
    for grain in range(2):
        alone = plan.run(plan.start((3,)), rates[:, grain], slips[:, grain])
        np.testing.assert_array_equal(together[:, grain], alone)


def test_slips_outside_the_range_are_taken_at_its_end_and_counted() -> None:
    _, g, dt = signal(50)
    plan = Exponential(3, 1e-8).plan(dt, 6.0, kernel())
    stopping, ended = plan.start(), plan.start()
    slip = np.full(51, 0.05)
    slip[20:30], slip[40] = 0.0, 3.0
    clipped = np.clip(slip, *RANGE)
    np.testing.assert_array_equal(plan.run(stopping, g, slip), plan.run(ended, g, clipped))
    assert plan.outside(stopping) == 11
    assert plan.outside(ended) == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"diameter": -1.0}, "diameter"),
        ({"viscosity": np.nan}, "viscosity"),
        ({"slip_range": (0.0, 1.0)}, r"slip_range\[0\]"),
        ({"slip_range": (2.0, 1.0)}, "slip_range must rise"),
        ({"slip_range": 1.0}, "pair"),
        ({"slip_at": "now"}, "slip_at must be one of 't', 'tau'"),
        ({"c1": 0.1}, "c1"),
    ],
)
def test_bad_kernels_are_refused(change: dict[str, object], words: str) -> None:
    arguments = {"diameter": DIAMETER, "viscosity": VISCOSITY, "slip_range": RANGE} | change
    with pytest.raises((ValueError, TypeError), match=words):
        VaryingSlipKernel(**arguments)


def test_bad_calls_are_refused_and_change_nothing() -> None:
    plan = Exponential(3, 1e-6).plan(0.01, 0.1, kernel())
    state = plan.start((2,))
    with pytest.raises(ValueError, match="jump needs a first sample"):
        plan.jump(state, 1.0)
    plan.push(state, [1.0, 2.0], 0.05)
    before = pickle.dumps(state)
    with pytest.raises(ValueError, match="slip must be 0 or greater"):
        plan.push(state, [1.0, 2.0], -0.1)
    with pytest.raises(ValueError, match="slip must be finite"):
        plan.push(state, [1.0, 2.0], np.inf)
    with pytest.raises(ValueError, match="G must be finite"):
        plan.push(state, [np.nan, 2.0], 0.05)
    with pytest.raises(ValueError, match=r"slip must have the shape"):
        plan.run(state, np.ones((3, 2)), np.ones((3, 5)))
    with pytest.raises(ValueError, match=r"G must have the shape"):
        plan.run(state, np.ones((3, 4)), np.ones(3))
    with pytest.raises(ValueError, match="horizon must cover"):
        plan.run(state, np.ones((11, 2)), np.full(11, 0.05))
    with pytest.raises(ValueError, match="delta must be finite"):
        plan.jump(state, np.nan)
    assert pickle.dumps(state) == before


@pytest.mark.parametrize(
    ("rule", "slip_at", "words"),
    [
        (basset.SemiDerivative(), "t", r"kernel must be BassetKernel\(\) for SemiDerivative"),
        (basset.Hinsberg(0.1), "t", r"kernel must be BassetKernel\(\) for the published tail"),
        (Windowed(Daitche(2), 0.1, basset.ExponentialSum.fit(0.1, 2.0, 1e-3)), "t", "tail must be a sum for the kernel VaryingSlipKernel"),
        (Exponential(3), "tau", "slip_at must be 't'"),
    ],
)
def test_rules_without_such_a_form_say_so(rule: basset.Rule, slip_at: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        rule.plan(0.01, 1.0, kernel(slip_at))


@pytest.mark.parametrize(
    ("rtol", "c1", "words"),
    [(1e-13, 2.0, "rtol must be at least [1-9]e-12 for that step"), (1e-15, 2.0, "rtol must be at least"), (1e-6, 1.2, "c1 must be from 1.5")],
)
def test_promises_that_cannot_be_kept_are_refused(rtol: float, c1: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Exponential(3, rtol).plan(0.01, 5.0, VaryingSlipKernel(DIAMETER, VISCOSITY, RANGE, c1=c1))


def test_evaluation_of_given_samples_refuses_a_varying_slip() -> None:
    with pytest.raises(TypeError, match=r"kernel must be a kernel such as basset.BassetKernel\(\)"):
        basset.integrate(np.ones(5), 0.1, Daitche(1), kernel=kernel())
    assert isinstance(kernel().at(0.1), MeiAdrianKernel)
