"""Compiled `fun`, event functions and jumps: what Python ones give, to rounding, and no Python between start and end."""

import math
from functools import cache, partial

import numba
import numpy as np
import pytest

import basset
from basset.solvers import base


def falling(t, y):
    return np.array([y[1], -9.8 - 0.5 * y[1], y[3], -3.0])


def kicked(t, y):
    return np.array([y[1], -9.8 + 40.0 * math.exp(-8.0 * (t - 2.5) ** 2) - 0.5 * y[1], y[3], math.cos(t)])


def floor(t, y):
    return y[0] + 0.25


def bounce(t, y):
    return np.array([y[0], -0.6 * y[1], y[2], y[3]])


def stop(t, y):
    return np.array([y[0], 0.0, y[2], y[3]])


def wall(t, y):
    return y[2] - 2.0


def instant(t, y):
    return t - 0.75


def push(t, y):
    return np.array([y[0], y[1] + 1.0, y[2], y[3]])


def passed(t, y):
    return y[0] - 0.1


def decay(t, y):
    return -y


def later(t, y):
    return t - 1.0


def fades(t, y, power):
    return -y


def zero(t, y, power):
    return (t - 0.5) ** power


CASES = {
    "bounces to rest": (falling, [(floor, -1.0, bounce, 0)]),
    "rests and is torn off": (kicked, [(floor, -1.0, bounce, 0)]),
    "stops dead": (falling, [(floor, -1.0, stop, 0)]),
    "three events": (falling, [(floor, -1.0, bounce, 0), (instant, 0.0, push, 0), (passed, 0.0, None, 0)]),
    "the third crossing ends": (falling, [(floor, -1.0, bounce, 0), (passed, 1.0, None, 3)]),
    "a wall that is not met": (falling, [(wall, 0.0, None, 1)]),
}


njit = cache(numba.njit)  # compiled once for all cases


def solved(fun, events, c, made):
    listed = []
    for function, direction, jump, terminal in events:
        event = made(function)
        event.direction, event.terminal = direction, terminal
        if jump is not None:
            event.jump = made(jump)
        listed.append(event)
    method = basset.Collocation(rtol=1e-9)
    return basset.solve(made(fun), (0.0, 4.0), [1.0, 0.0, 0.0, 1.0], memory=[1, 3], coefficient=c, initial_slip=[0.0, 0.0], events=listed, method=method)


@pytest.mark.parametrize("c", [0.0, [0.3, 0.1]], ids=["without history", "with history"])
@pytest.mark.parametrize("name", CASES)
def test_as_python_ones(name, c):
    fun, events = CASES[name]
    one, other = (solved(fun, events, c, made) for made in (partial, njit))
    assert (one.status, one.message, one.nsteps) == (other.status, other.message, other.nsteps)
    np.testing.assert_allclose(other.y, one.y, rtol=1e-12, atol=1e-12)
    for k in range(len(events)):
        np.testing.assert_allclose(other.t_events[k], one.t_events[k], rtol=1e-12)
        np.testing.assert_allclose(other.y_events[k], one.y_events[k], rtol=1e-12, atol=1e-12)


def test_no_python_between_start_and_end(monkeypatch):
    """Event functions are called from Python twice, to see what they give and on which side the start lies."""
    calls = []
    for name in ("value", "after"):
        monkeypatch.setattr(base.Event, name, lambda self, t, y, name=name, real=getattr(base.Event, name): calls.append(name) or real(self, t, y))
    found = solved(*CASES["bounces to rest"], 0.3, njit)
    assert found.nfev > 1000
    assert len(found.t_events[0]) > 20
    assert calls == ["value", "value"]


@pytest.mark.parametrize(("part", "sentence"), [("event", "event 0 was not finite"), ("jump", "jump of event 0 was not finite")])
def test_what_is_not_finite_is_a_status(part, sentence):
    event = numba.njit(lambda t, y: math.sqrt(1.0 - t) if t <= 1.0 else math.nan) if part == "event" else numba.njit(later)
    if part == "jump":
        event.jump = numba.njit(lambda t, y: y / 0.0 if t > 0.5 else y)
    found = basset.solve(njit(decay), (0.0, 2.0), [1.0], coefficient=0.5, events=event)
    assert found.status == -1
    assert found.message.startswith(sentence)


def test_a_jump_of_the_wrong_shape_is_an_error():
    event = numba.njit(later)
    event.jump = numba.njit(lambda t, y: np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match=r"jump of event 0 must return 1 states, got shape \(2,\)"):
        basset.solve(njit(decay), (0.0, 2.0), [1.0], coefficient=0.5, events=event)


def test_an_error_in_a_callback_comes_through():
    """Also from the midst of the compiled march, whatever else is compiled."""

    def event(t, y):
        if t > 1.0:
            raise LookupError("no such place")
        return 1.0

    with pytest.raises(LookupError, match="no such place"):
        basset.solve(njit(decay), (0.0, 2.0), [1.0], coefficient=0.5, events=event)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_error_in_a_compiled_function_is_no_success():
    """Compiled code cannot raise through the march: what raised gave nothing."""

    def event(t, y):
        if t > 0.3:
            raise ValueError("bad")
        return y[0] - 0.5

    found = basset.solve(lambda t, y: [-1.0], (0.0, 1.0), [1.0], coefficient=0.0, events=numba.njit(event))
    assert found.status == -1
    assert found.message.startswith("event 0 was not finite")


@pytest.mark.parametrize("power", [3, 5, 7, 9])
def test_a_zero_of_high_order(power):
    """Where rounding decides the sign of the slope there are no more turning points than a polynomial has."""
    for made in (partial, njit):
        found = basset.solve(made(fades), (0.0, 1.0), [1.0], coefficient=0.5, events=made(zero), args=(power,))
        assert found.status == 0
        assert len(found.t_events[0]) % 2 == 1  # on the other side in the end
        assert np.abs(found.t_events[0] - 0.5).max() < 1e-15 ** (1.0 / power) * 10.0


@pytest.mark.parametrize("compiled", [numba.njit, partial])
def test_arguments_of_compiled_events_are_read_as_they_lie(compiled):
    parameters = np.array([0.5, 9.0, 0.2, 9.0])[::2]
    found = basset.solve(lambda t, y, p: [-1.0], (0.0, 1.0), [1.0], coefficient=0.0, events=compiled(lambda t, y, p: y[0] - p[1]), args=(parameters,))
    np.testing.assert_allclose(found.t_events[0], [0.8], rtol=1e-14)
