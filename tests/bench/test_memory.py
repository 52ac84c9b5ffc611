"""The page on memory: windows, tails and sums, as the analysis reads the records."""

import math

import numpy as np
import pytest

import basset
from bench.suites import exponentials, window
from reports import memory


def test_a_crossing_is_found_between_points_and_nowhere_else():
    points = [(1.0, 1.0), (10.0, 0.01), (100.0, 0.001)]
    assert memory.crossing(points, 0.1) == pytest.approx(math.sqrt(10.0))
    assert memory.crossing(points, 2.0) is None
    assert memory.interpolated(points, math.sqrt(10.0)) == pytest.approx(0.1)


def test_a_window_is_priced_by_the_time_it_saves():
    def record(scheme, share, seconds, error):
        return {"scheme": scheme, "order": 3, "share": share, "seconds": seconds, "error": error}

    records = [record("full", 1.0, 1.0, 1e-9), record("window", 0.1, 0.1, 0.1), record("window", 0.4, 0.4, 0.05), record("tail", 0.01, 0.02, 1e-6)]
    found = memory.bought({"records": records}, 0.8, "seconds")
    assert found["share"] == pytest.approx(0.2) and found["error"] == pytest.approx(math.sqrt(0.1 * 0.05))
    assert memory.bought({"records": records}, 0.3, "seconds")["share"] is None
    assert memory.quickest({"records": records}, "seconds") == {"share": 0.01, "saved": pytest.approx(0.98), "error": 1e-6}


@pytest.mark.parametrize("rtol, terms", [(1e-3, 28), (1e-9, 136)])
def test_the_plain_trapezoid_keeps_its_error_with_the_known_number_of_terms(rtol, terms):
    plain = exponentials.trapezoid(1e6, rtol)
    assert plain.max_relative_error() <= rtol
    assert abs(len(plain) - terms) <= 2


def test_the_hopping_grain_is_exact():
    t = np.array([0.5, 1.7, 2.9])
    dt, steps = 1e-3, 2900
    jump = 0.3 * -math.expm1(-1.0 / 0.3)
    plan = basset.Daitche(4).plan(dt, steps * dt)
    state = plan.start()
    flight = np.exp(-dt * np.arange(1001) / window.RELAXATION)
    plan.push(state, 1.0)
    plan.jump(state, 1.0)
    H = [0.0, *plan.run(state, flight[1:])]
    for last in (1001, 901):
        plan.jump(state, -jump, g=1.0)
        H.extend(plan.run(state, flight[1:last]))
    found = np.array(H)[np.round(t / dt).astype(int)]
    np.testing.assert_allclose(found, window.hops_exact(t, 3), rtol=1e-6)
