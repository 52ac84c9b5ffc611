"""How long fixed steps may be: the limits against runs, and what is made of steps beyond them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import basset
from basset.solvers import _fixed
from basset.solvers.stability import HELD_RATE, bounds, held_factor, longest_step
from bench.suites.stability import FORMS, SHORT, grows, row

pytestmark = pytest.mark.analytic


@pytest.mark.parametrize("form", ["implicit", "held"])
@pytest.mark.parametrize("p", range(2, 11))
@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_the_limit_of_every_degree(p, form, ratio):
    """c²/λ = ratio: stable at 0.97 of the limit, not at 1.1; with the history held the limit is on the safe side, within 1.3."""
    limit = longest_step(basset.Daitche(p), 1.0, math.sqrt(ratio), form == "held")
    for share, expected in ((0.97, False), (1.3 if form == "held" else 1.1, True)):
        dt = share * limit
        assert grows(p, form, dt, math.sqrt(ratio * dt)) == expected


@pytest.mark.parametrize("held", [False, True])
def test_coefficients_whose_squares_are_no_numbers(held):
    rule = basset.Daitche(10)
    assert longest_step(rule, 0.0, 1e-200, held) == math.inf and longest_step(rule, 0.0, 1e200, held) == 0.0
    assert longest_step(rule, 2.0, 1e-200, held) == pytest.approx(longest_step(rule, 2.0, 0.0, held), rel=1e-14)


@pytest.mark.parametrize("coefficient", [10.0, 1e3, 1e6])
def test_the_limit_with_little_drag_is_that_of_memory_alone(coefficient):
    """With the history held, too: c√dt = B."""
    rule = basset.Daitche(10)
    assert longest_step(rule, 1.0, coefficient, held=True) == pytest.approx((bounds(rule)[1] / coefficient) ** 2, rel=1e-4)


def over_limit(degree, form, drag, history, rises=False):
    """How many times what is stable, at the worst of what the drag passes on its way."""
    most_drag, most = bounds(basset.Daitche(degree))
    if form != "held":
        return drag / most_drag + history / most
    passed = np.linspace(0.0, drag, 1001) if rises else np.array([drag])
    room = 0.5 * most * (1.0 + held_factor(np.minimum(passed, HELD_RATE)))
    return max(drag / HELD_RATE, float((history / room).max()))


def check(found):
    """No success beyond the limit, nothing but a success within it: the solution keeps within ±1, and so do the steps.

    Simpson's on slips, with λ·dt above 4.5, exceed it by 5 % in their first 20 nodes: what the start stirs up alternates, and decays.
    """
    most = 1.1 if (found["degree"], found["form"]) == (2, "slip") else 1.0 + 1e-9
    for name in ("", "_rising"):
        over = over_limit(*(found[key] for key in ("degree", "form", "drag", "history")), rises=bool(name))
        if over >= (1.3 if found["form"] == "held" else 1.1):
            assert found[f"status{name}"] == -1, found
        if over <= 0.97:
            assert found[f"status{name}"] == 0, found
        if found[f"status{name}"] == 0:
            assert found[f"largest{name}"] <= most, found


@pytest.mark.sweep
@given(st.integers(2, 10), st.sampled_from(FORMS), st.floats(0.0, 1.0), st.one_of(st.floats(0.1, 0.97), st.floats(1.1, 10.0)))
def test_no_run_beyond_the_limit_is_a_success(degree, form, share, distance):
    found = row(degree, form, share, distance, SHORT)
    check(found)
    if form != "held":
        assert longest_step(basset.Daitche(degree), found["drag"] / distance, found["history"] / distance) == pytest.approx(1.0)


def test_the_scan_on_the_page():
    """Every degree, form and direction; beside it the recurrence, which grows beyond the limit and not within it."""
    page = Path(__file__).resolve().parents[2] / "reports" / "data" / "stability.json"
    rows = json.loads(page.read_text(encoding="utf-8"))["rows"]
    assert {(found["degree"], found["form"]) for found in rows} == {(degree, form) for degree in range(2, 11) for form in FORMS}
    for found in rows:
        check(found)
        assert found["grows"] == (found["distance"] > 1.0), found


def test_rules_without_a_limit():
    for rule in (basset.Daitche(1), basset.EulerMaclaurin(), basset.SemiDerivative(), basset.Brush(), basset.Hinsberg(tail=False)):
        assert bounds(rule) == (math.inf, math.inf)
        assert longest_step(rule, 1e9, 1e9) == math.inf


def test_a_rule_without_weight_for_the_newest_sample():
    """1 + c√dt W(−1) = 0 with W(−1) = −3/2 + 1 − η(1/2), η Dirichlet's: c√dt = 0.90506; the drag alone is implicit."""
    eta = float(mpmath.altzeta(0.5))
    drag, history = bounds(basset.NewtonCotes())
    assert drag == math.inf and math.isclose(history, 1.0 / (0.5 + eta), rel_tol=1e-6)


def test_the_bounds_of_adams_and_moulton():
    assert [round(bounds(basset.Daitche(p))[0], 6) for p in (2, 3, 4, 5)] == [6.0, 3.0, round(90 / 49, 6), round(45 / 38, 6)]


@pytest.mark.parametrize("p", [5, 6, 8, 10])
@pytest.mark.parametrize("form", FORMS)
def test_steps_that_diverge_are_no_success(p, form):
    """y' = −y + sin t, c = 0.6 at five times the limit; at half of it the sine comes out."""
    rule = basset.Daitche(p)
    limit = longest_step(rule, 1.0, 0.6, form == "held")
    result = basset.solve(
        lambda t, y: -y + np.sin(t), (0.0, max(20.0, 2000 * limit)), [0.0], coefficient=0.6,
        method=basset.RungeKutta4(5 * limit, rule) if form == "held" else basset.FixedStep(5 * limit, rule, input=form),
    )  # fmt: skip
    assert result.status == -1
    assert "diverge" in result.message


def test_drag_that_grows_on_the_way_is_noticed():
    """Stable at the start, not later: quadratic drag, and drag that grows with time."""
    for fun, p, form in ((lambda t, y: -y - 50.0 * abs(y) * y + 30.0 * t, 5, "rate"), (lambda t, y: -0.5 * y * (1.0 + t) ** 2 + 1.0, 4, "slip")):
        result = basset.solve(fun, (0.0, 30.0), [0.0], coefficient=0.6, method=basset.FixedStep(0.02, basset.Daitche(p), input=form))
        assert result.status == -1
        assert "diverge" in result.message
        assert np.abs(result.y).max() < 1e3


def test_what_diverges_is_told_from_what_oscillates():
    def diverging(rates):
        state = _fixed.state_of(rates[0], 0, 1)
        return any(_fixed.diverges(state, row) for row in rates)

    n = np.arange(200.0)[:, None]
    assert diverging(np.sin(0.1 * n) + 1e-5 * (-1.05) ** n)
    assert not diverging(np.sin(0.1 * n) + 1e-3 * (-0.95) ** n)
    assert not diverging(np.random.default_rng(1).normal(size=(200, 3)))
    assert not diverging(np.exp(0.1 * n) * np.sin(n))


@pytest.mark.parametrize("dt", [0.08, 0.3, 0.02])
def test_advice_for_a_solver_is_stable_there(dt):
    found = basset.advise(1e-8, time_scale=1.0, dt=dt, steps=1000)
    assert all(longest_step(candidate.rule, 1.0, 1.0) >= dt for candidate in found.candidates)
    free = basset.advise(1e-8, time_scale=1.0, dt=dt, steps=1000, relaxation=0.0, coefficient=0.0)
    assert len(free.candidates) > len(found.candidates)


@pytest.mark.parametrize("bad", [-1.0, math.nan])
def test_bad_numbers(bad):
    with pytest.raises(ValueError, match="rate must be"):
        longest_step("daitche", bad, 1.0)
    with pytest.raises(ValueError, match="coefficient must be"):
        basset.advise(1e-3, time_scale=1.0, duration=1.0, coefficient=bad)


@pytest.mark.parametrize("dt", [0.01, 0.02, 0.05])
@pytest.mark.parametrize(
    ("fun", "y0"),
    [
        (lambda t, y: [-300.0 * t * y[0] + np.sin(t)], [0.0]),
        (lambda t, y: [-500.0 * abs(y[0]) * y[0] + 500.0 * np.sin(2.0 * t)], [0.0]),
    ],
    ids=["with time", "with the state"],
)
def test_drag_that_stiffens_on_the_way_is_no_success_of_explicit_steps(fun, y0, dt):
    """Runge–Kutta's growing solution does not alternate: 1e80 as a success."""
    with np.errstate(over="ignore", invalid="ignore"):
        result = basset.solve(fun, (0.0, 3.0), y0, coefficient=0.6, method=basset.RungeKutta4(dt))
    assert result.status == -1
    fine = basset.solve(fun, (0.0, 3.0), y0, coefficient=0.6, method=basset.RungeKutta4(dt / 64.0))
    exact = basset.solve(fun, (0.0, 3.0), y0, coefficient=0.6, method=basset.Collocation(1e-8))
    assert fine.status == 0 and fine.y[:, -1] == pytest.approx(exact.y[:, -1], abs=0.01)


@pytest.mark.parametrize(("c", "dt"), [(0.0, 0.005), (0.5, 0.01)])
def test_explicit_steps_that_settle_at_no_solution_are_no_success(c, dt):
    """y' = −40 y³ + 50 t: explicit steps stand still at 1.40, a fixed point of theirs alone, where y is 2.32."""
    fun = lambda t, y: -40.0 * y**3 + 50.0 * t  # noqa: E731
    result = basset.solve(fun, (0.0, 10.0), [0.0], coefficient=c, method=basset.RungeKutta4(dt))
    assert result.status == -1
    fine = basset.solve(fun, (0.0, 10.0), [0.0], coefficient=c, method=basset.RungeKutta4(dt / 4.0))
    exact = basset.solve(fun, (0.0, 10.0), [0.0], coefficient=c, method=basset.Collocation(1e-8))
    assert fine.status == 0 and fine.y[:, -1] == pytest.approx(exact.y[:, -1], rel=0.01)
