"""Inputs that jump: breaks that are given, jumps that the solver finds, layers after them, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erfcx

import basset
from basset import reference

pytestmark = pytest.mark.analytic

FACTOR = 10.0  # between the tolerance of a step and the error of the path, as for smooth problems


def stepped(t, steps, rate: float, c: float, y0: float = 0.0):
    """y of y' = Σ size·[t > at] − λy − c·H[y]."""
    lags = [np.maximum(t - at, 0.0) for at, _ in steps]
    return y0 * reference.response(t, rate, c) + sum(size * reference.response(lag, rate, c, 1) for lag, (_, size) in zip(lags, steps, strict=True))


def forced(steps, rate: float):
    return lambda t, y: [sum(size for at, size in steps if t > at) - rate * y[0]]


class TestGiven:
    @pytest.mark.parametrize("width", [0.1, 0.01, 1e-3, 1e-6, 1e-9])
    @pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
    def test_a_pulse_narrower_than_any_step(self, width, rtol):
        """y(2) of y' = −y − ½H + a pulse of area 1 from 1 on, y(0) = 1."""
        steps = [(1.0, 1.0 / width), (1.0 + width, -1.0 / width)]
        result = basset.solve(
            forced(steps, 1.0), (0.0, 2.0), [1.0], coefficient=0.5, breaks=[5.0, 1.0 + width, 1.0, -1.0], method=basset.Collocation(rtol=rtol)
        )
        area = (1.0 + width - 1.0) / width
        later = (
            (reference.response(1.0, 1.0, 0.5, 1) - reference.response(1.0 - width, 1.0, 0.5, 1)) / width if width > 1e-4 else reference.response(1.0, 1.0, 0.5)
        )
        exact = float(reference.response(2.0, 1.0, 0.5)) + area * float(later)
        assert result.status == 0
        assert result.y[0, -1] == pytest.approx(exact, abs=FACTOR * rtol + (width if width <= 1e-4 else 0.0))

    def test_values_of_the_pulse(self):
        for width, exact in ((0.1, 0.346222), (0.01, 0.336787), (0.001, 0.335885)):
            result = basset.solve(forced([(1.0, 1.0 / width), (1.0 + width, -1.0 / width)], 1.0), (0.0, 2.0), [1.0], coefficient=0.5, breaks=(1.0, 1.0 + width))
            assert result.y[0, -1] == pytest.approx(exact, abs=2e-6)

    @pytest.mark.parametrize("side", [lambda t, at: t > at, lambda t, at: t >= at], ids=["left", "right"])
    @pytest.mark.parametrize("at", [1.0, 1.0 / 3.0, 0.7, 1e-5])
    @pytest.mark.parametrize("c", [0.0, 0.5, 5.0])
    def test_each_side_of_a_break_is_seen(self, side, at, c):
        result = basset.solve(lambda t, y: [float(side(t, at)) - y[0]], (0.0, 2.0), [0.0], coefficient=c, breaks=at)
        assert result.y[0, -1] == pytest.approx(float(stepped(2.0, [(at, 1.0)], 1.0, c)), rel=2e-6)
        assert at in result.t
        assert result.nsteps <= 40

    def test_a_break_is_never_asked(self):
        asked = []
        basset.solve(lambda t, y: asked.append(t) or -y, (0.0, 2.0), [1.0], coefficient=0.5, breaks=[0.5, 1.5, 0.0, 2.0])
        assert not {0.5, 1.5, 2.0} & set(asked)

    @pytest.mark.parametrize(
        ("breaks", "kind", "sentence"),
        [([math.nan], ValueError, "breaks must be a list of finite times"), ([[1.0]], ValueError, "breaks must be"), ("now", TypeError, "breaks must be")],
    )
    def test_bad_breaks(self, breaks, kind, sentence):
        with pytest.raises(kind, match=sentence):
            basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], breaks=breaks)

    @pytest.mark.parametrize("method", [basset.FixedStep(0.01), basset.FixedStep(0.01, input="slip"), basset.RungeKutta4(0.001)], ids=["rate", "slip", "held"])
    def test_fixed_steps_turn_at_their_nodes(self, method):
        result = basset.solve(forced([(0.5, 1.0), (0.6, -1.0)], 1.0), (0.0, 2.0), [0.0], coefficient=0.5, breaks=(0.5, 0.6), method=method)
        assert result.y[0, -1] == pytest.approx(float(stepped(2.0, [(0.5, 1.0), (0.6, -1.0)], 1.0, 0.5)), abs=2e-4)
        with pytest.raises(ValueError, match=r"breaks must lie on the nodes of fixed steps, got 0\.5004 "):
            basset.solve(lambda t, y: -y, (0.0, 2.0), [0.0], breaks=0.5004, method=method)


class TestFound:
    @pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9, 1e-12])
    @pytest.mark.parametrize("c", [0.0, 0.5])
    @pytest.mark.parametrize("at", [1.0, 0.77777])
    def test_a_step_of_the_force(self, rtol, c, at):
        """1 gives 0.4240597… for c = ½."""
        result = basset.solve(forced([(at, 1.0)], 1.0), (0.0, 2.0), [0.0], coefficient=c, method=basset.Collocation(rtol=rtol))
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(float(stepped(2.0, [(at, 1.0)], 1.0, c)), abs=FACTOR * rtol)

    @pytest.mark.parametrize("at", [1.0, 2.0, 7.3])
    def test_bagley_and_torvik(self, at):
        """8·[t ≤ 1]: y(5) = −0.455641340538; other times by superposition."""
        result = basset.solve(
            lambda t, y: [y[1], (8.0 if t <= at else 0.0) - y[0]], (0.0, 30.0), [0.0, 0.0], memory=[1], coefficient=1.0 / math.sqrt(math.pi),
            initial_slip=[0.0], dense_output=True,
        )  # fmt: skip
        assert result.status == 0, result.message
        t = np.linspace(0.1, 30.0, 60)

        def whole(times):
            return np.asarray(reference.bagley_torvik(np.maximum(times, 0.0), 1.0, 1.0, 1.0, 8.0, 0.0, 0.0, 0.0))[0]

        assert np.abs(result.sol(t)[0] - whole(t) + np.where(t > at, whole(t - at), 0.0)).max() <= 8e-5
        if at == 1.0:
            assert result.sol(5.0)[0] == pytest.approx(-0.455641340538, abs=1e-6)

    def test_the_nearest_of_samples(self):
        v = np.random.default_rng(0).normal(size=21)
        result = basset.solve(lambda t, y: [v[min(20, int(t / 0.1 + 0.5))] - y[0]], (0.0, 2.0), [0.0], coefficient=0.5)
        steps = [(0.0, v[0]), *((0.1 * k - 0.05, v[k] - v[k - 1]) for k in range(1, 21))]
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(float(stepped(2.0, steps, 1.0, 0.5)), abs=1e-5)

    def test_drag_that_switches_with_the_speed(self):
        """y' = −y above ½, −2y below."""
        result = basset.solve(lambda t, y: [-y[0] if y[0] > 0.5 else -2.0 * y[0]], (0.0, 2.0), [1.0], coefficient=0.0)
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(0.5 * math.exp(-2.0 * (2.0 - math.log(2.0))), rel=1e-5)

    @pytest.mark.parametrize("speed", [0.0, -1e-30])
    def test_friction_that_turns(self, speed):
        """x'' = −x − 0.1 sign(v) from x = 1: −0.1 − 0.7 cos(t − π) after the first half period."""
        result = basset.solve(lambda t, y: [y[1], -y[0] - 0.1 * np.sign(y[1])], (0.0, 6.0), [1.0, speed], memory=[1], coefficient=0.0)
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(-0.1 - 0.7 * math.cos(6.0 - math.pi), abs=1e-5)


class TestLayers:
    @pytest.mark.parametrize("c", [0.0, 0.6])
    @pytest.mark.parametrize("time", [1e-10, 1e-13, 1e-16, 1e-20])
    def test_a_relaxation_within_less_than_any_step(self, time, c):
        """(cos t − y)/τ: y is cos t but for a memory of the layer of c√τ."""
        result = basset.solve(lambda t, y: [(math.cos(t) - y[0]) / time], (0.0, 1.0), [0.0], coefficient=c / math.sqrt(time))
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(math.cos(1.0), abs=2e-6 + math.sqrt(time))

    @pytest.mark.parametrize("rate", [1e3, 1e5, 1e7])
    def test_a_half_derivative(self, rate):
        """D^½ y = −λy: y = erfcx(λ√t)."""
        result = basset.solve(lambda t, y: [0.0], (0.0, 1.0), [1.0], coefficient=rate / math.sqrt(math.pi))
        assert result.status == 0, result.message
        assert result.y[0, -1] == pytest.approx(float(erfcx(rate)), rel=2e-6)

    def test_a_layer_behind_a_break(self):
        rate, c = 1e12, 0.6e6
        for breaks in ((), (1.0,)):
            result = basset.solve(lambda t, y: [rate * (float(t > 1.0) - y[0])], (0.0, 2.0), [0.0], coefficient=c, breaks=breaks)
            assert result.status == 0, result.message
            assert result.y[0, -1] == pytest.approx(float(reference.settling(1.0, rate, c, -rate)), rel=1e-6)


@st.composite
def inputs(draw):
    """Breaks, and after each a new piece a + b·(t − break) + d·sin ωt of the force."""
    count = draw(st.integers(1, 4))
    at = sorted(draw(st.lists(st.floats(0.05, 1.9), min_size=count, max_size=count, unique_by=lambda x: round(x, 2))))
    sizes = draw(st.lists(st.floats(0.2, 2.0).flatmap(lambda x: st.sampled_from([x, -x])), min_size=count, max_size=count))
    slopes = draw(st.lists(st.floats(-2.0, 2.0), min_size=count, max_size=count))
    return at, sizes, slopes, draw(st.floats(0.1, 5.0)), draw(st.sampled_from([0.0, 0.3, 1.0, 3.0])), draw(st.floats(0.0, 1.0)), draw(st.floats(0.5, 10.0))


@pytest.mark.sweep
@settings(max_examples=max(1, settings().max_examples // 2))
@given(inputs(), st.booleans(), st.sampled_from([1e-4, 1e-6, 1e-8]))
def test_random_forces_with_jumps(drawn, named, rtol):
    """Steps, ramps and a sine of the force, by superposition; with breaks named and left to the solver."""
    at, sizes, slopes, rate, c, wave, omega = drawn

    def fun(t, y):
        force = wave * math.cos(omega * t)
        for when, size, slope in zip(at, sizes, slopes, strict=True):
            if t > when:
                force += size + slope * (t - when)
        return [force - rate * y[0]]

    result = basset.solve(fun, (0.0, 2.0), [0.0], coefficient=c, breaks=at if named else (), method=basset.Collocation(rtol=rtol), dense_output=True)
    assert result.status == 0, result.message
    t = np.linspace(0.02, 2.0, 60)
    parts = [wave * reference.oscillating_stream(t, rate, c, 1.0, omega, 0.0)]
    for when, size, slope in zip(at, sizes, slopes, strict=True):
        lag = np.maximum(t - when, 0.0)
        parts += [size * reference.response(lag, rate, c, 1), slope * reference.response(lag, rate, c, 2)]
    largest = sum(np.abs(part).max() for part in parts)
    assert np.abs(result.sol(t)[0] - sum(parts)).max() <= FACTOR * rtol * max(largest, np.abs(sum(parts)).max())


YEAR = 3.15576e7  # s


@pytest.mark.parametrize("end", [1.0, YEAR])
@pytest.mark.parametrize("rate", [1.0, 1e3, 1e5, 1e7, 1e9])
def test_a_half_derivative_all_the_way(rate, end):
    """D^½ y = −λy is erfcx(λ√t) at all times, to 1e-6 and 1e-9 of the start."""
    result = basset.solve(lambda t, y: [0.0], (0.0, end), [1.0], coefficient=rate / math.sqrt(math.pi), dense_output=True)
    t = end * np.geomspace(1e-18, 1.0, 200)
    exact = erfcx(rate * np.sqrt(t))
    assert result.status == 0, result.message
    assert (np.abs(result.sol(t)[0] - exact) / (1e-9 + 1e-6 * exact)).max() <= FACTOR


def test_plastic_of_a_tenth_of_a_millimetre_over_a_year():
    """Density 0.9 of water's: λ = 18ν/(d²(s + ½)), c = 9/(s + ½) √(ν/π)/d, in SI: it rises at (s − 1)g/(s + ½)/λ after a second, all year."""
    s, d, nu = 0.9, 1e-4, 1e-6
    rate, c, pull = 18.0 * nu / (d * d * (s + 0.5)), 9.0 / (s + 0.5) * math.sqrt(nu / math.pi) / d, (1.0 - s) * 9.81 / (s + 0.5)
    result = basset.solve(lambda t, y: [pull - rate * y[0]], (0.0, YEAR), [0.0], coefficient=c, dense_output=True)
    t = YEAR * np.geomspace(1e-12, 1.0, 100)
    exact = reference.settling(t, rate, c, -pull)
    assert result.status == 0, result.message
    assert (np.abs(result.sol(t)[0] - exact) / (1e-9 + 1e-6 * exact)).max() <= FACTOR
