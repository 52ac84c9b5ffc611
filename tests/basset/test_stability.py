"""How long fixed steps may be: the limits against runs, and what is made of steps beyond them."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import basset
from basset.solvers import _fixed
from basset.solvers.stability import bounds, longest_step

pytestmark = pytest.mark.analytic

FORMS = ["rate", "slip", "held"]


def grows(p: int, form: str, product: float, history: float) -> bool:
    """Whether alternating samples of y' = −λy − c·H[y] grow at dt = 1: by the recurrence itself, written down anew."""
    from basset.solvers.stability import adams_moulton

    steps = 1500
    w, a = basset.Daitche(p).weights(2 * steps, 1.0)[: steps + 1], adams_moulton(p)
    factor = sum((-product) ** k / math.factorial(k) for k in range(5))
    share = (1.0 - factor) / product
    y, rates, path = 1.0, np.zeros(steps), np.zeros(steps)
    for n in range(steps):
        tail = float(w[1 : n + 1] @ rates[n - 1 :: -1][:n]) if n else 0.0
        if form == "held":
            rates[n] = (-product * y - history * tail) / (1.0 + history * w[0])
            y = factor * y - share * history * (tail + w[0] * rates[n])
        else:
            known = y + sum(a[k] * rates[n - k] for k in range(1, p + 1) if n >= k)
            rates[n] = (-product * known - history * tail) / (1.0 + history * w[0] + product * a[0])
            y = known + a[0] * rates[n]
        path[n] = abs(y)
        if path[n] > 1e100:
            return True
    return bool(path[-200:].max() > path[steps // 2 : steps // 2 + 200].max())


@pytest.mark.parametrize("form", ["implicit", "held"])
@pytest.mark.parametrize("p", range(2, 11))
@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_the_limit_of_every_degree(p, form, ratio):
    """c²/λ = ratio: stable at 0.97 of the limit, not at 1.1; with the history held the limit is on the safe side, within 1.3."""
    limit = longest_step(basset.Daitche(p), 1.0, math.sqrt(ratio), form == "held")
    for share, expected in ((0.97, False), (1.3 if form == "held" else 1.1, True)):
        dt = share * limit
        assert grows(p, form, dt, math.sqrt(ratio * dt)) == expected


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
