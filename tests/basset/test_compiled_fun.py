"""A compiled `fun`: the same solution as the Python callable it was made of, and no Python from step to step."""

from __future__ import annotations

import functools

import numpy as np
import pandas as pd
import pytest
import xarray

import basset
from basset import _compile, reference
from basset.solvers import base


def stream_with_drag(t, y, rate):
    return np.array([np.cos(t) - rate * y[0] * abs(y[0]), y[0], -1e3 * y[2]])


def relax(t, y, rate):
    return -rate * y


@functools.cache  # compiled once for all tests
def made(function):
    plain = _compile.shared(function)

    @_compile.compiled()
    def fun(t, y, *args):
        return plain(t, y, *args)

    return fun


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize(
    ("function", "y0", "memory"),
    [(stream_with_drag, [1.0, 0.0, 1.0], [0]), (stream_with_drag, [0.0, 0.0, 1.0], [0, 2]), (relax, [1.0, -2.0], [0, 1]), (relax, [1.0], [])],
)
def test_compiled_and_python_agree(function, y0, memory, rtol):
    """The same loop and the same arithmetic: only rounding may differ."""
    options = {"memory": memory, "coefficient": 0.6, "args": (1.3,), "method": basset.Collocation(rtol=rtol)}
    fun = made(function)
    plain = basset.solve(function, (0.0, 6.0), y0, **options)
    compiled = basset.solve(fun, (0.0, 6.0), y0, **options)
    assert plain.status == compiled.status == 0
    t = np.linspace(0.0, 6.0, 50)
    for solution in (plain, compiled):
        assert solution.t[-1] == 6.0
    ends = np.abs(plain.y[:, -1] - compiled.y[:, -1])
    assert ends.max() <= rtol * np.abs(plain.y).max()
    again = basset.solve(fun, (0.0, 6.0), y0, t_eval=t, **options)
    assert np.abs(again.y[:, -1] - compiled.y[:, -1]).max() == 0.0


def test_it_keeps_the_tolerance_against_the_closed_form():
    r = basset.solve(made(relax), (0.0, 4.0), [1.0], coefficient=0.6, args=(1.0,), method=basset.Collocation(rtol=1e-9), dense_output=True)
    t = np.linspace(1e-9, 4.0, 2001)
    assert np.abs(r.sol(t)[0] - reference.relaxing(t, 1.0, 0.6)).max() <= 1e-8


def test_no_python_from_step_to_step(monkeypatch):
    """The Python wrapper of `fun` is entered once, to check shape and type, whatever the number of steps."""
    calls = []
    rate = base.Task.rate

    def watched(self, t, y):
        calls.append(t)
        return rate(self, t, y)

    monkeypatch.setattr(base.Task, "rate", watched)
    fun = made(relax)
    if not _compile.is_compiled(fun):  # with NUMBA_DISABLE_JIT=1 there is nothing to enter
        return
    r = basset.solve(fun, (0.0, 4.0), [1.0], coefficient=0.6, args=(1.0,), method=basset.Collocation(rtol=1e-8))
    assert len(calls) == 1
    assert r.nsteps > 10
    assert r.nfev > 100


def test_events_and_jumps_work_with_it():
    def hit(t, y, rate):
        return y[1]

    hit.direction = -1.0
    hit.jump = lambda t, y, rate: np.array([-0.8 * y[0], 0.0])

    def fall(t, y, rate):
        return np.array([-rate * y[0] - 1.0, y[0]])

    options = {"memory": [0], "coefficient": 0.6, "args": (1.0,), "events": hit, "method": basset.Collocation(rtol=1e-9)}
    exact = reference.bouncing(1.0, 0.6, 1.0, 1.0, 0.8, 4)
    r = basset.solve(made(fall), (0.0, exact.times[-1] * 1.01), [0.0, 1.0], **options)
    assert np.abs(r.t_events[0][:4] - exact.times[:4]).max() <= 1e-8


def test_nan_is_a_status_and_a_wrong_shape_an_error():
    def breaks(t, y):
        return y * np.log(1.0 - t)

    def short(t, y):
        return y[:1]

    r = basset.solve(made(breaks), (0.0, 2.0), [1.0, 2.0], memory=[])
    assert r.status == -1
    assert "component 0" in r.message
    with pytest.raises(ValueError, match="fun must return 2 rates"):
        basset.solve(made(short), (0.0, 2.0), [1.0, 2.0])


def drag_from_a_table(t, y, rate, table, matrix, out):
    out[0] = -rate * y[0] * table[1] + matrix[1, 0]
    y[0] = 1e3
    return out


@pytest.mark.parametrize("method", [basset.Collocation(rtol=1e-8), basset.FixedStep(0.02)], ids=["collocation", "fixed_step"])
def test_arrays_and_lists_among_the_arguments_are_read_at_the_call(method):
    fun, table = made(drag_from_a_table), np.array([0.0, 1.0])
    for pull, speed, rate in [(0.0, 1.0, 1.0), (0.0, 2.0, 1.0), (0.5, 2.0, 1.0), (0.5, 2.0, 0.5)]:
        table[1] = speed
        args = (rate, table, [[0, 0], [pull, 0]], np.empty(1))
        plain, found = (
            basset.solve(
                f, (0.0, 2.0), [1.0], coefficient=0.6, args=(rate, table, np.array(args[2]), args[3]) if f is drag_from_a_table else args, method=method
            )
            for f in (drag_from_a_table, fun)
        )
        assert found.y[0, -1] == pytest.approx(plain.y[0, -1], abs=1e-7)
        exact = reference.relaxing(2.0, rate * speed, 0.6) + pull * reference.response(2.0, rate * speed, 0.6, 1)
        assert found.y[0, -1] == pytest.approx(float(exact), abs=1e-7 if isinstance(method, basset.Collocation) else 0.05)


def relaxes(t, y, a):
    return -a[0] * y


@pytest.mark.parametrize("given", [pd.Series([0.7, 2.0]), np.array([0.7], ">f8"), xarray.DataArray([0.7]), np.array([3.0, 0.7])[::-1]], ids=range(4))
def test_what_can_be_an_array_is_one(given):
    found = basset.solve(made(relaxes), (0.0, 1.0), [1.0], coefficient=0.6, args=(given,))
    assert found.y[0, -1] == pytest.approx(float(reference.relaxing(1.0, 0.7, 0.6)), abs=1e-6)


@pytest.mark.parametrize("bad", [["a", 1.0], [[1.0], [1.0, 2.0]], np.array([None, 1.0]), {0: 1.0}, {1.0}, 2**63], ids=str)
def test_arguments_that_are_no_data_are_refused(bad):
    fun = made(relax)
    if _compile.is_compiled(fun):
        with pytest.raises(TypeError, match=r"args\[0\] of a compiled fun must be a number or an array"):
            basset.solve(fun, (0.0, 1.0), [1.0], args=(bad,))
