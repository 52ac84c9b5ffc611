"""The table of problems: each slip, rate and exact answer belong together, and the tags tell the truth."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from rule_cases import EPS

from basset.problems import PROBLEMS, Problem, tagged

pytestmark = pytest.mark.analytic

KNOWN = {
    "smooth", "oscillating", "polynomial", "growth", "decay", "jump", "root", "long", "high_frequency", "thesis",
}  # fmt: skip
every_problem = pytest.mark.parametrize("problem", PROBLEMS.values(), ids=PROBLEMS)
with_rate = pytest.mark.parametrize("problem", [p for p in PROBLEMS.values() if p.rate is not None], ids=lambda p: p.name)


def times(problem: Problem) -> np.ndarray:
    return problem.end * np.array([1e-6, 0.01, 0.1, 0.37, 0.5, 0.8, 1.0])


def test_names_are_keys_and_descriptions_are_there():
    for name, problem in PROBLEMS.items():
        assert problem.name == name
        assert problem.description
        assert problem.end > 0.0


@every_problem
def test_tags_are_known(problem):
    assert problem.tags
    assert problem.tags <= KNOWN


def test_every_tag_of_the_hard_cases_is_present():
    assert set().union(*(problem.tags for problem in PROBLEMS.values())) == KNOWN
    assert {problem.name for problem in tagged("polynomial")} == {f"power_{k}" for k in range(11)}
    assert [problem.name for problem in tagged("smooth", "jump")] == ["sine_with_slip"]
    assert tagged("root", "smooth") == []


@every_problem
def test_tags_tell_the_truth(problem):
    assert ("jump" in problem.tags) == (problem.initial_slip != 0.0)
    assert ("root" in problem.tags) == (problem.rate is None)
    if "long" in problem.tags:
        assert problem.end >= 1e4 * np.pi
    if "growth" in problem.tags or "decay" in problem.tags:
        g = problem.rate(np.array([0.0, problem.end]))
        assert (g[1] > g[0]) == ("growth" in problem.tags)
    if "polynomial" in problem.tags:
        k = int(problem.name.removeprefix("power_"))
        t = np.linspace(0.0, problem.end, 30)
        assert np.abs(np.diff(problem.rate(t), k + 1)).max() <= 2.0**k * 4 * EPS  # differences of degree k+1 vanish


@with_rate
def test_rate_is_the_derivative_of_the_slip(problem):
    """A complex step has no cancellation: Im f(t + iε)/ε."""
    t = times(problem)
    derivative = np.imag(problem.slip(t + 1e-30j * np.maximum(t, 1.0))) / (1e-30 * np.maximum(t, 1.0))
    np.testing.assert_allclose(derivative, problem.rate(t), rtol=64 * EPS, atol=64 * EPS)


@every_problem
def test_double_and_mpmath_answers_agree(problem):
    for t in times(problem):
        exact = float(problem.exact_digits(t, 30))
        # the reference's roundings, relative to the larger of H and its amplitude; the phase carries ωt ≤ 400
        omega = 40.0 if "high_frequency" in problem.tags else 1.0
        amplitude = min(2.0 * np.sqrt(t), np.sqrt(2.0 * np.pi)) if "oscillating" in problem.tags else 0.0
        units = 48.0 + (omega * t if omega != 1.0 or "growth" in problem.tags else 0.0) + 11.0 * abs(np.log(t)) * ("polynomial" in problem.tags)
        assert abs(problem.exact(np.array([t]))[0] - exact) <= units * EPS * max(abs(exact), amplitude)


MP_RATES = {
    "fresnel": mpmath.cos,
    "fresnel_generic": mpmath.cos,
    "fresnel_long": mpmath.cos,
    "high_frequency": lambda x: mpmath.cos(40 * x),
    "sine_with_slip": lambda x: -mpmath.sin(x),
    "growth": mpmath.exp,
    "decay": lambda x: mpmath.exp(-x),
    **{f"power_{k}": lambda x, k=k: x**k for k in range(11)},
    "step": lambda x: mpmath.mpf(0),
    "root": lambda x: 1 / (2 * mpmath.sqrt(x)),
}


@every_problem
def test_exact_answer_is_the_defining_integral(problem):
    """f(0)/√t + ∫(t−τ)^(-1/2) f'(τ) dτ with τ = t sin²φ, which removes both end points' singularities."""
    for t in (0.2, 0.9, min(3.7, problem.end)):
        with mpmath.workdps(25):
            x, rate = mpmath.mpf(t), MP_RATES[problem.name]
            points = [mpmath.pi / 2 * k / 12 for k in range(13)]
            integral = mpmath.quad(lambda phi: 2 * mpmath.sqrt(x) * mpmath.sin(phi) * rate(x * mpmath.sin(phi) ** 2), points)
            exact = integral + problem.initial_slip / mpmath.sqrt(x)
            assert abs(problem.exact_digits(t, 20) - exact) < mpmath.mpf(10) ** -17 * max(1, abs(exact))


@with_rate
def test_the_rate_used_by_the_integral_is_the_rate_of_the_problem(problem):
    t = np.array([0.2, 0.7, min(3.0, problem.end)])
    np.testing.assert_allclose(problem.rate(t), [float(MP_RATES[problem.name](mpmath.mpf(x))) for x in t], rtol=64 * EPS)


@every_problem
def test_grid_and_arguments(problem):
    t, dt = problem.grid(8)
    assert t.shape == (9,)
    assert (t[0], t[-1]) == (0.0, problem.end)
    np.testing.assert_allclose(np.diff(t), dt, rtol=8 * EPS * 8)
    slip = problem.arguments(8, "slip")
    assert set(slip) == {"g", "dt", "input"}
    assert slip["g"][0] == problem.initial_slip
    if problem.rate is None:
        with pytest.raises(ValueError, match=f"problem {problem.name} has no finite rate at t = 0: use input='slip'"):
            problem.arguments(8)
    else:
        rate = problem.arguments(8)
        assert rate["initial_slip"] == problem.initial_slip
        assert np.isfinite(rate["g"]).all()
