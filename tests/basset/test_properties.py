"""Properties that any history has, on random streams: linear, causal, indifferent to when it starts, to scale and to the order of grains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import DT, HORIZON, STREAMS, Stream, chosen, every_stream

pytestmark = pytest.mark.sweep
few = settings(max_examples=max(1, settings().max_examples // 4))  # for each of forty streams
lengths = st.integers(2, HORIZON)
seeds = st.integers(0, 2**32 - 1)
sizes = st.floats(-1e3, 1e3)
any_stream = st.sampled_from(sorted(STREAMS)).map(STREAMS.__getitem__)


def random_rates(n: int, seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n + 1, *shape))


def streamed(stream: Stream, g: np.ndarray, jumps=(), dt: float = DT) -> np.ndarray:
    """H at every node; `jumps` holds (node, size, age in steps, new rate or None), in order."""
    plan = stream.plan(dt)
    state = plan.start(g.shape[1:])
    blocks, done = [], 0
    for node, size, age, rate in jumps:
        blocks.append(plan.run(state, g[done : node + 1]))
        plan.jump(state, size, age * dt, rate)
        blocks[-1][-1] = plan.value(state)
        done = node + 1
    return np.concatenate([*blocks, plan.run(state, g[done:])])


def close(H: np.ndarray, expected: np.ndarray, scale: float) -> None:
    """To rounding: 1e-13 of the size of what is summed."""
    np.testing.assert_allclose(H, expected, rtol=0.0, atol=1e-13 * scale)


def size_of(*histories: np.ndarray) -> float:
    return sum(float(np.abs(H).max()) for H in histories) + 1e-300


class TestLinear:
    @every_stream
    @few
    @given(seed=seeds, a=sizes, node=st.integers(0, 60), age=st.floats(0.0, 1.0), kink=st.booleans())
    def test_in_jumps_and_rates_together(self, stream, seed, a, node, age, kink):
        age = min(age, float(node))
        f, g = random_rates(90, seed), random_rates(90, seed + 1)
        u, v = (rates[node] + 1.0 if kink else None for rates in (f, g))
        F, G = streamed(stream, f, [(node, 0.7, age, u)]), streamed(stream, g, [(node, -0.2, age, v)])
        both = streamed(stream, a * f + g, [(node, a * 0.7 - 0.2, age, a * u + v if kink else None)])
        # age close to 0 makes K(age) large at one node: there to rounding of that value
        scale = abs(a) * np.abs(F).max() + np.abs(G).max()
        close(both, a * F + G, 10.0 * scale + 1e-300)

    @every_stream
    @few
    @given(n=lengths, seed=seeds, power=st.integers(-200, 200))
    def test_powers_of_two_exactly(self, stream, n, seed, power):
        g = random_rates(n, seed)
        np.testing.assert_array_equal(streamed(stream, g * 2.0**power), streamed(stream, g) * 2.0**power)


class TestInTime:
    # Simpson's pairs and the first panels of an open formula depend on where the history begins
    @chosen(name for name in STREAMS if "brush" not in name and "newton_cotes" not in name)
    @few
    @given(seed=seeds, shift=st.integers(1, 60), n=st.integers(10, 90), size=sizes)
    def test_a_later_start_after_a_jump_is_a_shifted_history(self, stream, seed, shift, n, size):
        """Rest, then a jump with a new rate at node `shift`, is the history that starts there."""
        g = random_rates(n, seed)
        if stream.averages:
            g[0] = 0.0  # baselines average the two rates at the node
        rested = np.concatenate([np.zeros(shift), g])
        rested[shift] = 0.0
        H = streamed(stream, rested, [(shift, size, 0.0, g[0])])[shift + 1 :]
        expected = streamed(stream, g, [(0, size, 0.0, None)])[1:]
        close(H, expected, size_of(H) * 10.0 + abs(size) / np.sqrt(DT))

    @every_stream
    @few
    @given(n=lengths, seed=seeds, exponent=st.integers(-15, 15))
    def test_scaling_of_time_scales_by_the_root(self, stream, n, seed, exponent):
        """dt·4^k at the same samples: H·2^k; with an exponential tail to rounding of the scaled sum."""
        g = random_rates(n, seed)
        H, stretched = streamed(stream, g), streamed(stream, g, dt=DT * 4.0**exponent)
        close(stretched, H * 2.0**exponent, 2.0**exponent * size_of(H))


class TestBatches:
    @every_stream
    @few
    @given(n=lengths, seed=seeds, cuts=st.lists(st.integers(0, HORIZON), max_size=6))
    def test_any_blocks_equal_one_by_one(self, stream, n, seed, cuts):
        plan, g = stream.plan(), random_rates(n, seed, 2)
        single, blocks = plan.start((2,)), plan.start((2,))
        one_by_one = []
        for sample in g:
            plan.push(single, sample)
            one_by_one.append(plan.value(single))
        batch = [plan.run(blocks, block) for block in np.split(g, sorted(min(cut, n + 1) for cut in cuts))]
        np.testing.assert_array_equal(np.concatenate(batch), one_by_one)


class TestNothingHappens:
    @every_stream
    @few
    @given(n=lengths, kinks=st.lists(st.integers(0, 40), max_size=4, unique=True), age=st.sampled_from([0.0, 0.5, 1.0]))
    def test_a_constant_has_no_history(self, stream, n, kinks, age):
        """f constant: g = 0, no jumps: exactly 0, also through stretches that end in no jump."""
        jumps = [(node, 0.0, min(age, float(node)), 0.0) for node in sorted(kinks) if node < n]
        assert not streamed(stream, np.zeros(n + 1), jumps).any()

    @few
    @given(stream=any_stream, n=lengths, sign=st.sampled_from([-1.0, 1.0]))
    def test_a_steady_acceleration_has_a_growing_one(self, stream, n, sign):
        """f = ±t: H has the sign of f, and within a window it grows with time."""
        H = sign * streamed(stream, np.full(n + 1, sign))
        assert (H[1:] > 0.0).all()
        if not stream.forgets:
            assert (np.diff(H) > 0.0).all() or stream.degree < 1

    def test_the_check_sees_a_difference(self):
        with pytest.raises(AssertionError):
            close(np.ones(3), np.ones(3) * (1.0 + 1e-12), 1.0)
