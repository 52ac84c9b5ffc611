"""The suite and the page on advice: problems are what they say, and misses are counted."""

from dataclasses import replace

import numpy as np
import pytest

import basset
from bench.suites import advice as suite
from reports import advice as page

CASES = {case.name: case for case in suite.cases()}


def test_there_are_enough_problems_of_every_kind():
    assert len({name.split(",")[0] for name in CASES}) >= 12
    assert {case.samples for case in CASES.values()} == {True, False}
    assert len({type(case.kernel) for case in CASES.values()} | {case.kernel for case in CASES.values()}) > 3


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.exact is not None])
def test_closed_forms_are_those_of_the_rates(name):
    case = CASES[name]
    dt, steps = case.scale / 16.0, 200
    found = basset.cumulate(case.rate(dt * np.arange(steps + 1)), dt, basset.Daitche(10), initial_slip=case.initial_slip)[1:]
    exact = case.truth(dt, steps)
    assert np.abs(found - exact)[16:].max() <= 1e-9 * np.abs(exact[16:]).max()


def test_finer_runs_agree_with_closed_forms():
    case = CASES["damped"]
    exact = case.truth(0.1, 100)
    np.testing.assert_allclose(replace(case, exact=None).truth(0.1, 100), exact, atol=1e-11 * np.abs(exact).max())


def test_a_case_is_measured():
    """What was advised keeps the error, and some other candidates stand beside it."""
    trial = suite.Trial(CASES["damped"], 1e-3, "stream", None, {})
    found = trial.row(trial.advised(), 1)
    assert found["meets"] and found["measured"] <= 1e-3
    assert found["candidates"] > 1 and found["ratio"] >= 1.0


def row(ratio, measured=1e-4, case="a", step="given"):
    return {"case": case, "error": 1e-3, "measured": measured, "ratio": ratio, "step": step}


def test_what_is_too_slow_or_not_exact_enough_is_a_miss():
    rows = [row(1.2), row(1.6, case="b", step="chosen"), row(2.0, case="c", step="chosen")]
    assert [found["case"] for found in page.missed(rows)] == ["c", "b"]
