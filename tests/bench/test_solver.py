"""The page on equations with memory: how orders and costs are read from the records, and that the suite's problems are what they say."""

import numpy as np
import pytest

import basset
from bench.suites import coupled
from reports import solver


def test_an_order_is_the_slope_of_the_last_three_errors_above_the_floor():
    rows = [{"n": n, "error_max": 7.0 / n**2 if n < 256 else 1e-13} for n in (8, 16, 32, 64, 128, 256)]
    rows[0]["error_max"] = 1e3
    assert solver.slope(rows, "error_max", 1e-12) == pytest.approx(2.0)
    assert solver.slope(rows[:1], "error_max", 1e-12) is None
    assert solver.slope([{"n": 8, "error_max": None}], "error_max", 0.0) is None


def test_an_extrapolation_is_never_slower_than_first_order():
    def row(scheme, n, seconds, error):
        return {"scheme": scheme, "n": n, "seconds": seconds, "error_first": error}

    records = [row("Collocation", 0, 0.1, 1e-7), row("Daitche(1)", 100, 1.0, 2e-2), row("Daitche(1)", 200, 2.0, 1.5e-2)]
    found = solver.race({"race": {"target": 1e-6, "records": records}})
    assert found["fits"]["Daitche(1)"]["order"] < 1.0
    assert found["ratio"] == pytest.approx(2.0 * 1.5e4 / 0.1)
    assert found["second"]["n"] == 100
    slow = [r | {"seconds": 10.0 * r["seconds"]} for r in records]
    assert solver.race({"race": {"target": 1e-6, "records": slow}})["second"] is None  # none within 1.5 s


@pytest.mark.parametrize("case", coupled.cases(), ids=lambda case: case.name)
def test_collocation_solves_every_problem_of_the_suite(case):
    result = case.solve(basset.Collocation(rtol=1e-7), dense=True)
    found = coupled.errors(case, result, between=True)
    assert found["error_max"] <= 1e-6


def test_fixed_steps_of_every_kind_run():
    case = coupled.cases()[0]
    methods = coupled.fixed(32, case.end)
    assert set(methods) == set(coupled.DECLARED)
    for name, method in methods.items():
        assert np.isfinite(coupled.errors(case, case.solve(method), between=False)["error_max"]), name
