"""Fixed steps of compiled functions: what Python ones give, to rounding, and no Python from step to step."""

import math
from functools import lru_cache, partial

import numba
import numpy as np
import pytest
from compilations import Compilations

import basset
from basset.measure import observed_orders
from basset.solvers import _fixed, base
from basset.solvers.fixed_step import LOOKS

RULES = {name: basset.SCHEMES[name]() for name in basset.SCHEMES if name != "windowed"} | {
    "daitche_2": basset.Daitche(2),
    "daitche_5": basset.Daitche(5),
    "windowed": basset.Windowed(basset.Daitche(3), 0.5),
    "windowed, tail": basset.Windowed(basset.Daitche(2), 0.7, tail=basset.ExponentialSum.fit(0.7, 9.0, 1e-8)),
}


def kicked(t, y, a, b, c):
    force = 2.0 if 1.0 < t < 2.0 else 0.0
    return a @ y + b * math.cos(3.0 * t) - 0.2 * y * np.abs(y) + force * c


def level(t, y, a, b, c):
    return y[0] - 0.05


def turned(t, y, a, b, c):
    return -0.7 * y


def lowest(t, y, a, b, c):
    return y[-1] + 0.1


def decay(t, y):
    return -y


def half(t, y):
    return t - 0.5


def turns(t, y):
    return math.sin(20.0 * t)


def raised(t, y):
    return y + 1.0


FLAT = 6.0 * math.gamma(6.0) * math.gamma(0.5) / math.gamma(6.5)


def flat(t, y):
    return 6.0 * t**5 + (t**6 - y) + 0.6 * FLAT * t**5.5


compiled = lru_cache(numba.njit)  # once for all cases


def methods(rule):
    slips = [basset.FixedStep(0.02, rule, input="slip")] if isinstance(rule.whole, basset.Daitche) else []
    return [basset.FixedStep(0.02, rule), basset.RungeKutta4(0.01, rule), *slips]


def solved(made, method, seed, jumps, breaks):
    random = np.random.default_rng(seed)
    n = 3
    a, b, c = random.normal(size=(n, n)) - 2.0 * np.eye(n), random.normal(size=n), random.normal(size=n)
    members = sorted(random.choice(n, size=n - 1, replace=False).tolist())
    hit, low, turn = made(level), made(lowest), made(turned)
    hit.direction, hit.jump, low.terminal = -1.0, turn, 4
    return basset.solve(
        made(kicked), (0.0, 4.0), np.linspace(0.5, 1.0, n), members, random.uniform(0.1, 0.9, n - 1), args=(a, b, c), method=method,
        events=[hit, low] if jumps else None, breaks=(1.0, 2.0) if breaks else (), dense_output=True,
    )  # fmt: skip


@pytest.mark.filterwarnings("ignore::numba.core.errors.NumbaPerformanceWarning")
@pytest.mark.parametrize(("jumps", "breaks"), [(False, False), (True, False), (True, True)], ids=["smooth", "jumps", "jumps and breaks"])
@pytest.mark.parametrize("name", RULES)
def test_as_python_ones(name, jumps, breaks):
    for seed, method in enumerate(methods(RULES[name])):
        one, other = (solved(made, method, seed, jumps, breaks) for made in (partial, compiled))
        assert (one.status, one.message, one.nsteps) == (other.status, other.message, other.nsteps)
        t = np.linspace(0.0, one.t[-1], 101)
        np.testing.assert_allclose(other.y, one.y, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(other.sol(t), one.sol(t), rtol=1e-11, atol=1e-11)
        for k in range(2 * jumps):
            np.testing.assert_array_equal(other.t_events[k], one.t_events[k])
            np.testing.assert_allclose(other.y_events[k], one.y_events[k], rtol=1e-11, atol=1e-11)


@pytest.mark.analytic
@pytest.mark.parametrize("made", [partial, compiled], ids=["plain", "compiled"])
@pytest.mark.parametrize("input", ["rate", "slip"])
@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_orders(made, input, p):
    """y = t⁶, whose history is FLAT t^5.5."""
    fun, counts = made(flat), np.array([20, 40, 80])
    found = []
    for n in counts:
        result = basset.solve(fun, (0.0, 2.0), [0.0], coefficient=0.6, method=basset.FixedStep(2.0 / n, basset.Daitche(p), input=input))
        found.append(np.abs(result.y[0] - result.t**6).max())
    assert (observed_orders(2.0 / counts, np.array(found)) >= p + 0.75).all()


@pytest.mark.parametrize("make", [basset.FixedStep, lambda dt: basset.FixedStep(dt, basset.Daitche(3)), basset.RungeKutta4], ids=["1", "3", "held"])
def test_python_is_entered_as_often_whatever_the_number_of_steps(monkeypatch, make):
    """To check fun and its stability at the start, at a jump, and for explicit steps at some nodes of the path."""
    calls = []
    for owner, name in ((base.Task, "free"), (base.Event, "value"), (base.Event, "after"), (_fixed, "steps")):
        real = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *given, real=real, name=name: calls.append(name) or real(*given))
    event, passed = compiled(half), compiled(turns)
    event.jump = compiled(raised)
    found = []
    for n in (100, 10_000):
        calls.clear()
        result = basset.solve(compiled(decay), (0.0, 1.0), [1.0], coefficient=0.6, method=make(1.0 / n), events=[event, passed])
        assert (result.status, result.nsteps, len(result.t_events[0]), len(result.t_events[1])) == (0, n, 1, 6)
        found.append(sorted(calls))
    assert found[0] == found[1]
    assert found[0].count("steps") == 2
    assert len(found[0]) < 12 + (2 * LOOKS if make is basset.RungeKutta4 else 0)


def test_another_fun_compiles_no_loop():
    def solve(fun, n, method):
        event = numba.njit(lambda t, y: y[0] - 0.5)
        event.jump = numba.njit(lambda t, y: 2.0 * y)
        assert basset.solve(fun, (0.0, 1.0), np.ones(n), list(range(n - 1)), 0.6, method=method, events=event).status == 0

    solve(compiled(decay), 1, basset.FixedStep(0.02))
    with numba.core.event.install_listener("numba:compile", found := Compilations()):
        solve(numba.njit(lambda t, y: -y * np.abs(y)), 3, basset.FixedStep(0.02, basset.Exponential(3)))
        solve(numba.njit(lambda t, y: -2.0 * y), 2, basset.FixedStep(0.02, input="slip"))
        solve(numba.njit(lambda t, y: 0.1 - y), 2, basset.RungeKutta4(0.02))
    assert found.names
    assert not {"steps", "newton", "residual", "diverges", "looked", "peek", "take", "fire", "value"} & set(found.names)


@pytest.mark.parametrize("method", methods(basset.Daitche(2)), ids=["rate", "held", "slip"])
def test_every_evaluation_is_counted(method):
    calls = []
    plain, found = (
        basset.solve(fun, (0.0, 2.0), [1.0, 0.5], [0], 0.6, method=method)
        for fun in (lambda t, y: calls.append(t) or np.array([-y[0] * abs(y[0]), y[0]]), numba.njit(lambda t, y: np.array([-y[0] * abs(y[0]), y[0]])))
    )
    assert plain.nfev == len(calls) == found.nfev


def test_what_is_not_finite_is_a_status():
    def after(t, y):
        return y / 0.0 if t > 0.5 else y

    fun = numba.njit(lambda t, y: -y * math.sqrt(1.0 - t) if t < 1.0 else y * math.nan)
    result = basset.solve(fun, (0.0, 2.0), [1.0], coefficient=0.5, method=basset.FixedStep(0.25))
    assert (result.status, result.message, result.t[-1]) == (-1, "fun was not finite in component 0 at t = 1.", 0.75)
    event = numba.njit(lambda t, y: t - 0.9)
    event.jump = numba.njit(error_model="numpy")(after)
    result = basset.solve(compiled(decay), (0.0, 2.0), [1.0], coefficient=0.5, method=basset.FixedStep(0.25), events=event)
    assert (result.status, result.message, len(result.t_events[0])) == (-1, "jump of event 0 was not finite at t = 1.", 0)


@pytest.mark.parametrize("method", [basset.FixedStep(0.005), basset.RungeKutta4(0.005)], ids=["rate", "held"])
def test_a_body_at_rest_is_drawn_off_by_what_its_memory_is_then(method):
    """Stopped dead, and held by a weight that fades: it is let go a while before that has changed sign, something else moving on."""
    hit = numba.njit(lambda t, y: y[1])
    hit.direction, hit.jump = -1.0, numba.njit(lambda t, y: np.array([0.0, 0.0, y[2]]))
    fun = numba.njit(lambda t, y: np.array([0.4 * (t - 3.0) - y[0], y[0], 1.0]))
    found, exact = (
        basset.solve(fun, (0.0, 6.0), [0.0, 0.5, 0.0], coefficient=1.5, method=one, events=hit, dense_output=True)
        for one in (method, basset.Collocation(rtol=1e-8))
    )
    t = np.linspace(0.0, 6.0, 200)
    assert found.status == exact.status == 0
    assert exact.y[1, -1] > 0.3
    assert np.abs(found.sol(t)[1] - exact.sol(t)[1]).max() < 0.02
