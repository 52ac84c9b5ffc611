"""Random linear systems with memory, coupled, forced by steps and kicked, against the response of each of their modes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import basset
from basset import reference

pytestmark = pytest.mark.analytic

FACTOR = 10.0  # between the tolerance of a step and the error of the path

BETWEEN = (  # a step is accepted between any two that the jump at t = 0.3194 refuses, down to the shortest
    np.array([2942.72717621, 2738.41963426]), 0.6, np.array([[-0.04085764, -0.99966669], [-0.99916498, 0.02858849]]), np.array([-0.72719043, -2.12927257]),
    [(1.0, np.array([0.82156262, 0.77572617])), (1.5, np.array([-0.23690254, 0.27700425])), (1.25, np.array([-0.58902516, -0.73107882])),
     (0.31940010155466636, np.array([-0.43551408, -0.55454287]))], [], False,
)  # fmt: skip


@st.composite
def systems(draw):
    """(rates of the modes, c, modes, start, steps (time, size of each component), kicks, named): y' = −A y + force − c·H[y], A = V diag(rates) V⁻¹."""
    n = draw(st.integers(1, 4))
    rates = np.array(draw(st.lists(st.floats(-2.0, 4.0).map(lambda x: 10.0**x), min_size=n, max_size=n)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    modes = np.linalg.qr(rng.normal(size=(n, n)))[0] @ (np.eye(n) + 0.3 * np.triu(rng.uniform(-1.0, 1.0, (n, n)), 1))
    times = draw(st.lists(st.floats(0.05, 1.9), min_size=0, max_size=4, unique_by=lambda x: round(x, 2)))
    split = draw(st.integers(0, len(times)))
    events = [(at, rng.uniform(0.2, 1.0, n) * rng.choice([-1.0, 1.0], n)) for at in times]
    return rates, draw(st.sampled_from([0.0, 0.1, 0.6, 3.0, 30.0])), modes, rng.normal(size=n), events[:split], events[split:], draw(st.booleans())


@pytest.mark.sweep
@settings(max_examples=2 * settings().max_examples)
@given(systems(), st.sampled_from([1e-4, 1e-6, 1e-9]))
@example(BETWEEN, 1e-6)
def test_modes_by_superposition(drawn, rtol):
    """Each mode is the sum of the responses to its start, its steps (scaled by the rate: to order 1) and its kicks."""
    rates, c, modes, start, steps, kicks, named = drawn
    matrix = modes @ np.diag(rates) @ np.linalg.inv(modes)

    def fun(t, y):
        return matrix @ (sum((size for at, size in steps if t > at), np.zeros(len(y))) - y)

    def kick(at, size):
        def clock(t, y):
            return t - at

        clock.jump = lambda t, y: y + size
        return clock

    result = basset.solve(
        fun, (0.0, 2.0), start, list(range(len(start))), c, events=[kick(*each) for each in kicks], breaks=[at for at, _ in steps] if named else (),
        method=basset.Collocation(rtol=rtol), dense_output=True,
    )  # fmt: skip
    assert result.status == 0, result.message
    t = np.linspace(0.013, 2.0, 57)
    exact = np.zeros((len(start), len(t)))
    for k, rate in enumerate(rates):
        row = np.linalg.inv(modes)[k]
        mode = row @ start * reference.response(t, rate, c)
        for at, size in steps:
            mode = mode + row @ size * rate * reference.response(np.maximum(t - at, 0.0), rate, c, 1)
        for at, size in kicks:
            mode = mode + np.where(t >= at, row @ size * reference.response(np.maximum(t - at, 0.0), rate, c), 0.0)
        exact += np.outer(modes[:, k], mode)
    away = np.all([np.abs(t - at) > 1e-6 for at, _ in [*steps, *kicks]] or [np.ones(len(t), bool)], axis=0)
    scale = max(1.0, np.abs(start).max(), np.abs(exact).max())
    worst = np.abs(result.sol(t) - exact)[:, away].max() / scale
    assert worst <= FACTOR * rtol
