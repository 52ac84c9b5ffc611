"""Callbacks of `solve` and its events: buffers, close crossings, surfaces away from zero, bodies at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import basset
from basset import reference

METHODS = {
    "collocation": basset.Collocation(rtol=1e-8),
    "daitche_1": basset.FixedStep(0.05),
    "daitche_3": basset.FixedStep(0.05, basset.Daitche(order=3)),
    "slips": basset.FixedStep(0.05, basset.Daitche(order=2), input="slip"),
    "runge_kutta_4": basset.RungeKutta4(0.05),
}
every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


def marked(function, **attributes):
    for name, value in attributes.items():
        setattr(function, name, value)
    return function


def pulled(t, y):
    return np.array([-(y[0] + abs(y[0]) * y[0]) + np.sin(t), y[0] - 0.1 * y[1]])


def careless(function, states: int, reuses: bool, writes: bool):
    """The same callback, one that gives the same buffer every time or writes into what it is given."""
    buffer = np.empty(states)

    def call(t, y):
        given = function(t, y)
        if writes:
            y[:] = 1e3
        if not reuses:
            return given
        buffer[:] = given
        return buffer if states > 1 else buffer[0]

    return call


@every_method
@pytest.mark.sweep
@settings(max_examples=max(4, settings().max_examples // 5))
@given(reuses=st.tuples(*[st.booleans()] * 3), writes=st.tuples(*[st.booleans()] * 3), start=st.floats(-2.0, 2.0), c=st.floats(0.0, 3.0))
def test_callbacks_that_reuse_or_write_buffers_give_the_bits_of_clean_ones(method, reuses, writes, start, c):
    found = []
    for dirty in (False, True):
        fun, event, jump = (
            careless(function, states, dirty and reuses[k], dirty and writes[k])
            for k, (function, states) in enumerate([(pulled, 2), (lambda t, y: y[0] - 0.2, 1), (lambda t, y: np.array([-0.5 * y[0], y[1] + 1.0]), 2)])
        )
        event.jump = jump
        found.append(basset.solve(fun, (0.0, 3.0), [start, 0.0], coefficient=c, events=event, method=method))
    np.testing.assert_array_equal(found[0].t, found[1].t)
    np.testing.assert_array_equal(found[0].y, found[1].y)
    np.testing.assert_array_equal(found[0].t_events[0], found[1].t_events[0])


@every_method
@pytest.mark.parametrize("bad", [1.0j, np.complex64(1.0), np.complex128(2.0)], ids=str)
def test_complex_callbacks_are_refused(method, bad):
    for value in ([bad], np.array([bad])):
        with pytest.raises(TypeError, match=r"fun must return 1 rates.*complex"):
            basset.solve(lambda t, y: value, (0.0, 1.0), [1.0], method=method)
        with pytest.raises(TypeError, match=r"jump of event 0 must return 1 states.*complex"):
            basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], method=method, events=marked(lambda t, y: t - 0.5, jump=lambda t, y: value))
    with pytest.raises(TypeError, match=r"event 0 must return a number.*complex"):
        basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], method=method, events=lambda t, y: bad)


def test_rates_under_a_mask_are_refused():
    with pytest.raises(TypeError, match="fun must return 1 rates"):
        basset.solve(lambda t, y: np.ma.masked_array(-y, [True]), (0.0, 1.0), [1.0])


@every_method
@pytest.mark.parametrize("count", [True, 1, 2, np.int64(3), 5])
def test_terminal_counts_as_in_scipy(method, count):
    """Zeros of cos t."""
    result = basset.solve(lambda t, y: [-math.sin(t)], (0.0, 20.0), [1.0], coefficient=0.0, method=method, events=marked(lambda t, y: y[0], terminal=count))
    assert result.status == 1
    assert result.t_events[0] == pytest.approx(math.pi * (np.arange(int(count)) + 0.5), abs=0.06)
    assert result.t[-1] == result.t_events[0][-1]


@pytest.mark.parametrize("none", [False, 0, None, np.False_, 99])
def test_terminal_that_is_not_reached(none):
    result = basset.solve(lambda t, y: [-math.sin(t)], (0.0, 20.0), [1.0], coefficient=0.0, events=marked(lambda t, y: y[0], terminal=none))
    assert (result.status, len(result.t_events[0])) == (0, 6)


@pytest.mark.parametrize("bad", [-1, 2.0, 1.5, math.nan, "yes", [1]])
def test_terminal_that_is_no_count(bad):
    with pytest.raises((TypeError, ValueError), match="terminal of event 0 must be True, False or the number of occurrences"):
        basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], events=marked(lambda t, y: t, terminal=bad))


def test_terminal_counts_bounces():
    hit = marked(lambda t, y: y[1], direction=-1, terminal=3, jump=lambda t, y: [-0.5 * y[0], y[1]])
    result = basset.solve(lambda t, y: [-1.0, y[0]], (0.0, 9.0), [0.0, 0.5], coefficient=0.0, events=hit)
    np.testing.assert_allclose(result.t_events[0], [1.0, 2.0, 2.5], atol=1e-6)
    assert result.status == 1


class TestCloseCrossings:
    @pytest.mark.parametrize("gap", [0.1, 0.03, 0.01, 1e-3])
    @pytest.mark.parametrize("start", [0.0, 1e4])
    def test_two_in_one_step(self, gap, start):
        level, middle = math.cos(gap / 2.0), start + 5.0
        result = basset.solve(
            lambda t, y: [-math.sin(t - middle)], (start, start + 11.0), [math.cos(5.0)], coefficient=0.0, events=lambda t, y: y[0] - level,
            method=basset.Collocation(rtol=1e-11),
        )  # fmt: skip
        assert np.diff(result.t).max() > 3.0 * gap
        np.testing.assert_allclose(result.t_events[0] - middle, [-gap / 2.0, gap / 2.0], atol=1e-3 * gap)

    @pytest.mark.parametrize("omega", [3.0, 30.0, 100.0])
    def test_a_function_of_time_that_turns_many_times_in_a_step(self, omega):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.0, events=lambda t, y: math.sin(omega * t + 1.0))
        exact = (np.pi * np.arange(1.0, 1 + (omega * 4.0 + 1.0) // math.pi) - 1.0) / omega
        np.testing.assert_allclose(result.t_events[0], exact, atol=1e-12)

    @pytest.mark.parametrize(("omega", "size", "e"), [(60.0, 0.01, 0.7), (100.0, 0.01, 0.8), (30.0, 0.03, 0.6)])
    def test_a_ball_on_a_vibrating_table_stays_above_it(self, omega, size, e):
        table = marked(
            lambda t, y: y[1] - size * math.sin(omega * t),
            direction=-1,
            jump=lambda t, y: [-e * y[0] + (1.0 + e) * size * omega * math.cos(omega * t), y[1]],
        )
        result = basset.solve(
            lambda t, y: [-9.8, y[0]], (0.0, 4.0), [0.0, 0.3], coefficient=0.0, events=table, method=basset.Collocation(rtol=1e-9), dense_output=True
        )
        assert result.success
        t = np.linspace(0.0, result.t[-1], 20001)
        assert (result.sol(t)[1] - size * np.sin(omega * t)).min() >= -1e-12
        if omega == 60.0:
            assert np.abs(result.t_events[0] - 1.797517).min() <= 2e-6


def ball(floor, e, end, method, height=0.05, g=9.8, c=0.0, start=0.0, lift=False):
    hit = marked(lambda t, y: y[1] - floor, direction=-1, jump=lambda t, y: [-e * y[0], floor if lift else y[1]])
    return basset.solve(lambda t, y: [-g - c * y[0], y[0]], (start, start + end), [0.0, floor + height], coefficient=c, events=hit, method=method)


class TestSurfacesAwayFromZero:
    @pytest.mark.parametrize("floor", [0.0, 1.0, -1.0, -10.0, 0.01, 1e4])
    @pytest.mark.parametrize("e", [0.5, 0.95])
    def test_a_ball_comes_to_rest(self, floor, e):
        result = ball(floor, e, 10.0, basset.Collocation())
        assert result.status == 2
        assert result.t[-1] == pytest.approx(math.sqrt(0.1 / 9.8) * (1.0 + e) / (1.0 - e), abs=1e-5 * max(1.0, math.sqrt(abs(floor))))
        assert abs(result.y[1, -1] - floor) <= 1e-14 * max(1.0, abs(floor))

    @pytest.mark.parametrize("floor", [0.0, 1.0, -10.0])
    @pytest.mark.parametrize("lift", [False, True])
    @pytest.mark.parametrize("e", [0.3, 0.99])
    @every_method
    def test_no_ball_falls_through(self, method, floor, e, lift):
        result = ball(floor, e, 4.0, method, 0.3, lift=lift, c=0.3)
        assert result.success and result.nsteps < 20_000  # no endless flights from one rounding to another
        assert (result.y[1] - floor).min() >= -0.05 * 2.5  # a step of the fall

    @pytest.mark.parametrize("start", [0.0, 3e3, -1e5, 1e7])
    @every_method
    def test_a_jump_at_an_instant_happens_once(self, method, start):
        clock = marked(lambda t, y: t - (start + 0.5), jump=lambda t, y: y + 1.0)
        result = basset.solve(lambda t, y: -y, (start, start + 1.0), [1.0], coefficient=0.6, events=clock, method=method)
        assert (result.status, len(result.t_events[0])) == (0, 1)
        exact = reference.relaxing(1.0, 1.0, 0.6) + reference.relaxing(0.5, 1.0, 0.6)
        assert result.y[0, -1] == pytest.approx(float(exact), abs=1e-7 if method is METHODS["collocation"] else 0.12)

    @pytest.mark.parametrize("level", [0.0, 1e4, -1e6, 1e8])
    def test_an_interface_lets_the_body_through(self, level):
        surface = marked(lambda t, y: y[1] - level, direction=-1, jump=lambda t, y: [0.5 * y[0], y[1]])
        result = basset.solve(
            lambda t, y: [-1.0 - y[0], y[0]], (0.0, 6.0), [0.0, level + 1.0], coefficient=0.6, events=surface, method=basset.Collocation(rtol=1e-9)
        )
        bounces = reference.bouncing(1.0, 0.6, restitution=0.5, impacts=1)
        exact = reference.settling(6.0, 1.0, 0.6) - 0.5 * bounces.jumps[0] / -1.5 * reference.response(6.0 - bounces.times[0], 1.0, 0.6)
        assert (result.status, len(result.t_events[0])) == (0, 1)
        assert result.y[0, -1] == pytest.approx(float(exact), abs=1e-8)

    @pytest.mark.sweep
    @settings(max_examples=max(4, settings().max_examples // 4))
    @given(floor=st.floats(-100.0, 100.0), start=st.floats(-1e4, 1e4), e=st.floats(0.1, 0.8), height=st.floats(0.05, 2.0))
    def test_random_floors_and_starts(self, floor, start, e, height):
        """Without history: t_k = √(2h) (1 + 2e (1 − e^k)/(1 − e)), at rest at √(2h) (1 + e)/(1 − e)."""
        first = math.sqrt(2.0 * height)
        end = first * (1.0 + e) / (1.0 - e)
        result = ball(floor, e, 1.5 * end, basset.Collocation(rtol=1e-9), height, 1.0, 0.0, start)
        k = np.arange(8)
        exact = first * (1.0 + 2.0 * e * (1.0 - e**k) / (1.0 - e))
        assert result.status == 2
        big = e**k > 1e-4
        np.testing.assert_allclose(result.t_events[0][: big.sum()] - start, exact[big], atol=1e-7 * end)
        assert result.t[-1] - start == pytest.approx(end, abs=1e-4 * end)

    @pytest.mark.sweep
    @settings(max_examples=max(4, settings().max_examples // 4))
    @given(floor=st.floats(-100.0, 100.0), start=st.floats(-1e3, 1e3), e=st.floats(0.2, 0.7), c=st.floats(0.05, 1.0))
    def test_with_history_as_on_a_floor_at_zero(self, floor, start, e, c):
        method = basset.Collocation(rtol=1e-9)
        moved, still = (ball(*where[:1], e, 4.0, method, 0.5, 1.0, c, where[1]) for where in ((floor, start), (0.0, 0.0)))
        large = np.flatnonzero(np.diff(still.t_events[0]) > 1e-2)[:6]
        np.testing.assert_allclose(moved.t_events[0][large] - start, still.t_events[0][large], atol=1e-6)


class TestRestOfOneOfSeveral:
    @staticmethod
    def balls(es, heights, method, floors=(0.0, 0.0), end=12.0, more=(), fun=None):
        def hit(k):
            def jump(t, y):
                y[2 * k] *= -es[k]
                return y

            return marked(lambda t, y: y[2 * k + 1] - floors[k], direction=-1, jump=jump)

        start = [number for height, floor in zip(heights, floors, strict=True) for number in (0.0, floor + height)]
        fun = fun or (lambda t, y: [-1.0, y[0], -1.0, y[2]])
        return basset.solve(fun, (0.0, end), start, [0, 2], 0.0, events=[hit(0), hit(1), *more], method=method, dense_output=True)

    @pytest.mark.parametrize("floors", [(0.0, 0.0), (1.0, -10.0)])
    @pytest.mark.parametrize(("es", "heights"), [((0.3, 0.6), (1.0, 0.5)), ((0.7, 0.0), (0.3, 1.0)), ((0.5, 0.5), (1.0, 0.2))])
    def test_the_other_one_goes_on_until_both_rest(self, es, heights, floors):
        result = self.balls(es, heights, basset.Collocation(rtol=1e-9), floors)
        exact = [math.sqrt(2.0 * h) * (1.0 + e) / (1.0 - e) for e, h in zip(es, heights, strict=True)]
        assert result.status == 2
        for times, end in zip(result.t_events, exact, strict=True):
            assert times[-1] == pytest.approx(end, abs=1e-5)
        t = np.linspace(min(exact) + 1e-4, max(exact), 50)
        first = int(np.argmin(exact))
        still = result.sol(t[t <= result.t[-1]])
        assert (still[2 * first] == 0.0).all()
        assert np.abs(still[2 * first + 1] - floors[first]).max() <= 1e-14

    @pytest.mark.parametrize("name", ["daitche_1", "daitche_3", "slips", "runge_kutta_4"])
    def test_at_fixed_steps(self, name):
        result = self.balls((0.3, 0.6), (1.0, 0.5), METHODS[name])
        assert result.status == 2
        assert result.t_events[0][-1] < result.t_events[1][-1] - 0.5

    def test_with_history_each_as_alone(self):
        c, exact = 0.6, reference.bouncing(0.6, 0.6, 1.0, 0.5, 0.6, 6).times

        def hit(k, e):
            def jump(t, y):
                y[2 * k] *= -e
                return y

            return marked(lambda t, y: y[2 * k + 1], direction=-1, jump=jump)

        result = basset.solve(
            lambda t, y: [-1.0 - c * y[0], y[0], -1.0 - c * y[2], y[2]], (0.0, 6.0), [0.0, 0.1, 0.0, 0.5], [0, 2], c,
            events=[hit(0, 0.2), hit(1, 0.6)], method=basset.Collocation(rtol=1e-9),
        )  # fmt: skip
        assert result.t_events[0][-1] < exact[-1]
        np.testing.assert_allclose(result.t_events[1][:6], exact, atol=1e-8)

    @pytest.mark.parametrize("method", [METHODS["collocation"], METHODS["daitche_1"], METHODS["slips"]], ids=["collocation", "rates", "slips"])
    def test_a_kick_sets_it_going_again(self, method):
        """At rest, kicked at t = 9 with speed 1: at 0.5 above the floor at t = 10."""
        kick = marked(lambda t, y: t - 9.0, jump=lambda t, y: [1.0, *y[1:]])
        result = self.balls((0.5, 0.5), (0.5, 0.5), method, (1.0, 1.0), 10.0, [kick])
        assert result.status == 0
        assert result.y[1, -1] == pytest.approx(1.5, abs=1e-6 if method is METHODS["collocation"] else 0.06)
        assert result.y[3, -1] == pytest.approx(1.0, abs=1e-12 if method is METHODS["collocation"] else 0.02)

    @pytest.mark.parametrize("method", [METHODS["collocation"], METHODS["daitche_1"], METHODS["slips"]], ids=["collocation", "rates", "slips"])
    def test_it_is_drawn_off_when_the_pull_turns(self, method):
        """The pull on the first is t − 6: it rests from about 1 on, leaves at 6 and is (t − 6)³/6 high."""
        clock = marked(lambda t, y: t - 20.0, jump=lambda t, y: y)
        result = self.balls((0.2, 0.2), (0.5, 0.5), method, (1.0, 0.0), 8.0, [clock], lambda t, y: [t - 6.0, y[0], -1.0, y[2]])
        assert result.status == 0
        assert result.y[1, -1] - 1.0 == pytest.approx(8.0 / 6.0, abs=1e-6 if method is METHODS["collocation"] else 0.15)

    @pytest.mark.parametrize("floor", [0.0, 5.0, -1e4])
    @pytest.mark.parametrize("speed", [1.0, 0.0])
    @pytest.mark.parametrize("name", ["collocation", "daitche_1", "slips", "runge_kutta_4"])
    def test_a_body_that_starts_on_its_floor_does_not_fall_through(self, name, speed, floor):
        """Thrown down with speed 1 it rests after 2e/(1 − e) = 2; what else moves goes on."""
        hit = marked(lambda t, y: y[1] - floor, direction=-1, jump=lambda t, y: [-0.5 * y[0], *y[1:]])
        start = [-speed, floor, 0.0]
        result = basset.solve(lambda t, y: [-1.0, y[0], 1.0], (0.0, 3.0), start, [0], 0.0, events=hit, method=METHODS[name])
        exact = name == "collocation"
        assert result.t_events[0][-1] == pytest.approx(2.0 * speed, abs=1e-3 if exact else 0.6)
        assert result.y[1].min() - floor > (-1e-7 if exact else -0.06)
        assert result.y[:, 0].tolist() == start
        if speed:
            assert result.status == 0
            assert result.y[:, -1] == pytest.approx([0.0, floor, 3.0], abs=1e-7 if exact else 0.02)

    @pytest.mark.parametrize("floor", [1.0, 5.0, -1e4])
    def test_a_start_below_its_floor_by_rounding_is_on_it(self, floor):
        hit = marked(lambda t, y: y[1] - floor, direction=-1, jump=lambda t, y: [-0.5 * y[0], y[1]])
        result = basset.solve(lambda t, y: [-1.0, y[0]], (0.0, 3.0), [-1.0, np.nextafter(floor, -np.inf)], [0], 0.0, events=hit)
        assert result.t_events[0][-1] == pytest.approx(2.0, abs=1e-3) and result.y[1].min() - floor > -1e-7

    def test_a_start_beyond_a_surface_is_none_on_it(self):
        """A body passes through an interface from below or goes on below it; a counter beyond its limit counts on; fun is not asked where no path leads."""
        slower = marked(lambda t, y: y[1], direction=-1, jump=lambda t, y: [0.5 * y[0], y[1]])
        below = basset.solve(lambda t, y: [0.0, y[0]], (0.0, 2.0), [-1.0, -0.1], [0], 0.0, events=slower)
        assert below.status == 0 and below.y[:, -1] == pytest.approx([-1.0, -2.1], abs=1e-12)
        hit = marked(lambda t, y: y[1], direction=-1, jump=lambda t, y: [-0.5 * y[0], y[1]])
        thrown = basset.solve(lambda t, y: [-1.0, y[0]], (0.0, 3.5), [2.0, -1.5], [0], 0.0, events=hit)  # through at 1, back with −1 at 3
        assert thrown.status == 0 and thrown.t_events[0] == pytest.approx([3.0], abs=1e-9)
        assert thrown.y[:, -1] == pytest.approx([0.0, 0.125], abs=1e-9)
        reset = marked(lambda t, y: y[1] - 1.0, direction=1, jump=lambda t, y: [y[0], 0.0])
        counted = basset.solve(lambda t, y: [0.0, 1.0], (0.0, 2.0), [0.0, 2.0], [0], 0.0, events=reset)
        assert counted.status == 0 and counted.y[1, -1] == pytest.approx(4.0, abs=1e-12)
        stiff = basset.solve(lambda t, y: [-1e8 * (y[0] - 1.0), math.sqrt(y[0])], (0.0, 1.0), [1.1, -2.0], [0], 0.0, events=hit)
        assert stiff.status == 0 and stiff.y[1, -1] == pytest.approx(-1.0, abs=1e-6)

    def test_a_body_with_friction_cannot_be_held(self):
        hit = marked(lambda t, y: y[1], direction=-1, jump=lambda t, y: [-0.5 * y[0], y[1], y[2] - 0.1 * abs(y[0])])
        result = basset.solve(lambda t, y: [-1.0, y[0], 0.0], (0.0, 9.0), [0.0, 0.5, 3.0], [0], 0.0, events=hit)
        assert result.status == 2
        assert result.t[-1] == pytest.approx(3.0, abs=1e-5)
