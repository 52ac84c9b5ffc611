"""A memory that follows the slip at fixed steps: every rule, whole or on a window, against its direct sum with exact weights, for both readings."""

import numpy as np
import pytest

import basset
from basset.kernels import VaryingSlipKernel
from basset.quadrature import by_default
from basset.quadrature.rule import slip_recipes
from basset.solvers import stability
from basset.streaming.following import FollowingPlan, accept, look_at, rest
from basset.streaming.forgetting import JumpWindow

DT, STEPS = 0.02, 160
FOUND = [rule for rule in by_default() if not isinstance(rule, basset.SemiDerivative)]
RULES = list(dict.fromkeys(rule.whole for rule in FOUND))
WINDOWED = [basset.Windowed(rule, window) for rule in RULES for window in (1.0, 0.62)]
SHORT = [basset.Windowed(basset.Daitche(3), 0.08), basset.Windowed(basset.Brush(), 0.1)]
JUMPS = (0, 3, 40, 43, 111)  # two of them closer than the newest samples reach

t = np.arange(STEPS + 1) * DT
RATES = np.stack([np.cos(3.0 * t) + 0.3 * np.sin(11.0 * t), np.exp(-t) * np.sin(5.0 * t)], axis=1)
SLIPS = np.stack([0.3 + 1.2 * np.abs(np.sin(2.0 * t)), np.full_like(t, 0.2)], axis=1)
DELTA = np.array([0.7, -0.4])


def kernel(slip_at="t", constants=(2.0, 0.105)):
    return VaryingSlipKernel(1.0, 1.0 / 73.0, (1e-3, 1e3), slip_at, *constants)


def streamed(rule, of, slips=SLIPS, jumps=JUMPS, window=None, rates=RATES):
    """H at every node."""
    plan = FollowingPlan(*slip_recipes(rule, DT, STEPS * DT, of))
    state, tail, found = plan.start(2), np.zeros(2), np.zeros_like(rates)
    jump = plan.jump if window is None else JumpWindow(plan, window).jump
    for k, (rate, slip) in enumerate(zip(rates, slips, strict=True)):
        if k == 0:
            plan.push(state, rate)
            plan.jump(state, DELTA if k in jumps else 0.0 * DELTA, slip)
            continue
        look_at(state, np.arange(2), slip[None], tail)
        accept(state, rate, tail)
        found[k] = state.history
        if k in jumps:
            jump(state, DELTA, slip=slip, g=rate)
    return found


def summed(rule, of):
    """The same by `VaryingPlan`, whose direct sum has exact weights."""
    plan = rule.plan(DT, STEPS * DT, of)
    state, found = plan.start(2), np.zeros_like(RATES)
    for k, (rate, slip) in enumerate(zip(RATES, SLIPS, strict=True)):
        plan.push(state, rate, np.sqrt((slip**2).sum()))
        found[k] = plan.value(state)
        if k in JUMPS:
            plan.jump(state, DELTA, g=rate if k else None)
    return found


def apart(one, other):
    return np.abs(one - other).max() / np.abs(other).max()


@pytest.mark.parametrize("slip_at", ["t", "tau"])
@pytest.mark.parametrize("rule", [*RULES, basset.Daitche(1), basset.Daitche(3), *WINDOWED, *SHORT, basset.Hinsberg(1.0, False)], ids=repr)
def test_it_is_the_direct_sum(rule, slip_at):
    assert apart(streamed(rule, kernel(slip_at)), summed(rule, kernel(slip_at))) < 1e-9


@pytest.mark.parametrize("slip_at", ["t", "tau"])
def test_with_the_constants_of_dorgan_and_loth(slip_at):
    of = kernel(slip_at, (2.5, 0.2))
    assert apart(streamed(basset.Daitche(2), of), summed(basset.Daitche(2), of)) < 1e-9


@pytest.mark.parametrize("slip_at", ["t", "tau"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_a_rule_with_a_promise_keeps_it(rtol, slip_at):
    of = kernel(slip_at)
    assert apart(streamed(basset.Exponential(2, rtol), of), summed(basset.Daitche(2), of)) < rtol


def test_a_fitted_tail_is_the_whole_past():
    tail = basset.ExponentialSum.fit(0.25, 10.0, 1e-6)
    found = streamed(basset.Windowed(basset.Daitche(2), 0.5, tail), kernel())
    assert apart(found, summed(basset.Daitche(2), kernel())) < 1e-9


@pytest.mark.parametrize("rule", [basset.Daitche(2), basset.Brush(), basset.Windowed(basset.Brush(), 0.62)], ids=repr)
def test_both_readings_agree_for_a_steady_slip(rule):
    steady = np.tile([0.4, 0.3], (STEPS + 1, 1))
    assert apart(streamed(rule, kernel("tau"), steady), streamed(rule, kernel("t"), steady)) < 1e-9


@pytest.mark.parametrize("slip_at", ["t", "tau"])
def test_what_came_before_the_jumps_that_count_is_gone(slip_at):
    """A memory of one jump holds nothing of what came before the jump before the last: the same rates from there on, half of the first, and that jump."""
    rule, of = basset.Daitche(2), kernel(slip_at)
    kept = streamed(rule, of, window=1)
    begins = JUMPS[-3]
    later = np.where(np.arange(STEPS + 1)[:, None] < begins, 0.0, RATES)
    later[begins] *= 0.5
    alone = streamed(rule, of, jumps=[k for k in JUMPS if k >= begins], rates=later)
    end = JUMPS[-2]
    assert apart(kept[end + 1 : JUMPS[-1]], alone[end + 1 : JUMPS[-1]]) < 1e-9
    assert np.array_equal(streamed(rule, of, window=9), streamed(rule, of))
    assert apart(kept, streamed(rule, of)) > 0.01


def test_the_published_sums_and_the_half_derivative_are_refused():
    published = basset.ExponentialSum.van_hinsberg(0.5)
    with pytest.raises(ValueError, match="published numbers"):
        FollowingPlan(*slip_recipes(basset.Windowed(basset.Daitche(2), 0.5, published), DT, 1.0, kernel()))
    with pytest.raises(ValueError, match=r"order 1/2"):
        slip_recipes(basset.SemiDerivative(), DT, 1.0, kernel())


def test_nothing_happens_in_a_rest():
    plan = FollowingPlan(*slip_recipes(basset.Daitche(2), DT, STEPS * DT, kernel()))
    state = plan.start(2)
    plan.push(state, RATES[0])
    plan.jump(state, DELTA, SLIPS[0])
    other = type(state)(*(array.copy() for array in state[:-1]), state.tables)
    rest(other, 30)
    tail, none = np.zeros(2), np.zeros(2)
    for _ in range(30):
        look_at(state, np.arange(2), SLIPS[:1], tail)
        accept(state, none, tail)
    assert np.array_equal(other.terms, state.terms) and np.array_equal(other.samples, state.samples)


@pytest.mark.parametrize("rule", [basset.Daitche(2), basset.Daitche(3), basset.Daitche(5), basset.NewtonCotes()], ids=repr)
def test_basset_s_limit_of_stability_is_on_the_safe_side(rule):
    """Steps diverge where c√dt W(−1) falls below −1: a kernel that decays faster has a larger W(−1)."""

    def at_minus_one(dt, of):
        partial = np.cumsum(rule.weights(2048, dt, of)[:1024] / np.sqrt(dt) * (-1.0) ** np.arange(1024))
        return np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0 @ partial[-5:]

    limit = stability.symbols(rule)[1]
    for constants in ((2.0, 0.105), (2.5, 0.2)):
        assert all(at_minus_one(dt, kernel("t", constants).at(slip)) > limit for dt in (1e-3, 0.1) for slip in (0.01, 1.0, 10.0))
