"""A state that does not belong to a plan is refused before compiled code sees it; plans and long windows."""

from __future__ import annotations

import numpy as np
import pytest

import basset
from basset import Daitche, Exponential, ExponentialSum, VaryingSlipKernel, Windowed
from basset.evaluate import PLANS

PLANS_OF_ALL_KINDS = {
    "exponential": Exponential(1).plan(0.01, 1.0),
    "another horizon": Exponential(1, 1e-9).plan(0.01, 10.0),
    "full": Daitche(3).plan(0.01, 5.0),
    "window": Windowed(Daitche(3), 0.5).plan(0.01, 1.0),
}


@pytest.mark.parametrize("maker", PLANS_OF_ALL_KINDS)
@pytest.mark.parametrize("user", PLANS_OF_ALL_KINDS)
def test_states_of_other_plans(maker, user):
    if maker == user:
        return
    state = PLANS_OF_ALL_KINDS[maker].start(3)
    plan = PLANS_OF_ALL_KINDS[user]
    for call in (
        lambda: plan.run(state, np.ones((2, 3))),
        lambda: plan.push(state, np.ones(3)),
        lambda: plan.tail(state),
        lambda: plan.local(state),
        lambda: plan.jump(state, 1.0),
    ):
        with pytest.raises(ValueError, match="state must belong to this plan"):
            call()


@pytest.mark.parametrize("state", [None, (1, 2), np.zeros(3), "state"])
def test_what_is_no_state(state):
    with pytest.raises(TypeError, match=r"state must be what plan.start\(shape\) returns"):
        PLANS_OF_ALL_KINDS["full"].push(state, 1.0)


def test_read_only_big_endian_and_single_precision_states():
    plan = PLANS_OF_ALL_KINDS["exponential"]
    state = plan.start(2)
    frozen = state._replace(terms=state.terms.copy())
    frozen.terms.flags.writeable = False
    with pytest.raises(ValueError, match=r"state.terms must be contiguous and writeable"):
        plan.push(frozen, [1.0, 2.0])
    for dtype in (np.float32, ">f8"):
        with pytest.raises(TypeError, match=r"state.samples must be a float64 array"):
            plan.push(state._replace(samples=state.samples.astype(dtype)), [1.0, 2.0])


def test_streams_with_varying_slip_guard_theirs():
    kernel = VaryingSlipKernel(1e-3, 1e-6, (0.01, 0.1))
    following, direct = Exponential(3).plan(0.01, 1.0, kernel), Daitche(3).plan(0.01, 1.0, kernel)
    with pytest.raises(ValueError, match="state must belong to this plan"):
        following.push(direct.start(2), [1.0, 2.0], 0.05)
    with pytest.raises(TypeError, match="state must be what"):
        following.push(PLANS_OF_ALL_KINDS["exponential"].start(2), [1.0, 2.0], 0.05)
    with pytest.raises(ValueError, match="age must be 0 for a kernel whose slip varies"):
        state = following.start()
        following.push(state, 1.0, 0.05)
        following.jump(state, 1.0, 0.005)


@pytest.mark.parametrize("order", [1, 2, 3, 6, 10])
@pytest.mark.parametrize("window", [2.55, 2.56, 2.57, 2.6, 5.0])  # around the window from which a path is convolved by FFT
def test_a_whole_path_under_a_long_window_is_the_stream(order, window):
    dt, n = 0.01, 900
    rule = Windowed(Daitche(order), window, ExponentialSum.fit(0.9 * window, 10.0, 1e-9))
    g = np.stack([np.cos(dt * np.arange(n + 1)), np.sin(3.0 * dt * np.arange(n + 1))], axis=1)
    path = basset.cumulate(g, dt, rule, initial_slip=[0.5, -1.0])
    plan = rule.plan(dt, n * dt)
    state = plan.start((2,))
    plan.push(state, g[0])
    plan.jump(state, [0.5, -1.0])
    stream = plan.run(state, g[1:])
    assert np.abs(path[1:] - stream).max() <= 1e-13 * np.abs(stream).max()
    full = basset.cumulate(g, dt, Daitche(order), initial_slip=[0.5, -1.0])[1:]
    assert np.abs(stream - full).max() <= 1e-8 * np.abs(full).max()


def test_plans_that_are_kept_are_bounded_in_bytes():
    kept = PLANS.limit
    PLANS.limit = 200_000
    try:
        for k in range(30):
            basset.cumulate(np.ones(400), 0.01 * (k + 1), Windowed(Daitche(1), 2.0 * (k + 1), ExponentialSum.fit(1.0 * (k + 1), 100.0 * (k + 1), 1e-6)))
            assert PLANS.nbytes <= PLANS.limit
    finally:
        PLANS.limit = kept
        PLANS.clear()


def test_overflow_in_a_stream_is_named():
    for call in (basset.integrate, basset.cumulate):
        with pytest.raises(ValueError, match="g must be small enough for its integral"):
            call(np.full(50, 1e308), 1e4, Exponential(1))
