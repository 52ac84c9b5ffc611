"""The page on flights: the loop written by hand is the simulator's, errors and ratios are read rightly, every scheme has its place."""

import numpy as np
import pytest

from bench import hand_written
from bench.suites import flights as suite
from reports import build, flights
from reports.site import page
from saltation.flight.setup import Grain

JUMPS = 40


@pytest.mark.parametrize("rtol", [1e-3, 1e-6])
def test_the_loop_written_by_hand_flies_the_simulators_jumps(rtol):
    engine = suite.engine_of(suite.weight_and_drag(), rtol)
    state = Grain(engine).state
    assert (engine.states, engine.members, state.y.size, state.past.size, state.jump.size) == (4, 0, 4, 0, 0)
    jumps = np.zeros((JUMPS, 3))
    room = hand_written.room_for(engine.tables.count)
    steps = hand_written.fly(hand_written.case_of(engine), hand_written.nodes_of(engine), room, state.y, jumps)
    grain, table = suite.fly(engine, JUMPS)
    np.testing.assert_allclose(jumps, table[:, suite.PLACES], rtol=0.0, atol=1e-12)
    assert steps == grain.state.control[0].steps


def test_the_loop_written_by_hand_refuses_other_scenes():
    with pytest.raises(ValueError, match="weight and drag"):
        hand_written.case_of(suite.engine_of(suite.base("sand", JUMPS, 0)))


def test_errors_are_relative_to_the_mean_jump():
    reference = np.array([[1.0, 10.0, 2.0], [3.0, 30.0, 2.0]])
    found = suite.errors(reference + np.array([[0.0, 0.0, 0.0], [0.2, 1.0, 0.0]]), reference)
    assert (found["max"], found["duration_max"], found["length_max"], found["height_max"]) == pytest.approx((0.1, 0.1, 0.05, 0.0))
    assert found["rms"] == pytest.approx(np.sqrt((0.1**2 + 0.05**2) / 6.0))
    short = suite.errors(reference[:1], reference)
    assert short["max"] is None and "1 of 2" in short["reason"]


def test_equal_error_is_no_larger_in_either_norm():
    def row(method, size, error, seconds):
        return {"scheme": "x", "method": method, "size": size, "max": error, "rms": 0.5 * error, "seconds": seconds}

    mine = [row(flights.OURS, rtol, rtol, seconds) for rtol, seconds in ((1e-1, 1.0), (1e-2, 2.0), (1e-3, 3.0))]
    found = {"records": [*mine, row(flights.HELD, 1e-3, 0.05, 40.0), row(flights.IMPLICIT, 5e-4, 0.04, 100.0), row(flights.HELD, 5e-4, 0.0404, 60.0)]}
    best = flights.best_fixed(found)
    assert best["seconds"] == 60.0  # as exact as any to 2 %
    assert flights.equal(found, best)[1] == 30.0
    assert flights.as_good(flights.stepped(found), 0.05)["seconds"] == 40.0
    assert flights.as_good(flights.stepped(found), 0.01) is None


def test_a_limit_is_taken_as_the_root_of_the_step():
    rows = [{"dt": dt, "height": 0.3 + 0.2 * dt**0.5} for dt in (4e-3, 1e-3, 2.5e-4)]
    assert flights.order(rows, {"height": 0.3}, "height") == pytest.approx(0.5)
    assert flights.extrapolated(rows, "height") == pytest.approx(0.3)


def test_every_scheme_tends_to_the_collocations_jump():
    found = suite.one_jump((2e-3, 5e-4))
    assert {r["scheme"] for r in found["records"]} == set(suite.SCHEMES)
    data = {"one_jump": found}
    assert all(0.47 < order < 0.53 for order in flights.orders(data, "height"))
    assert flights.limit_error(data, "height") < 2e-3


def test_half_the_tolerance_changes_means_by_less_than_it_claims():
    rows = suite.halving(full=False)
    assert {r["scene"] for r in rows} == set(suite.HALVED)
    assert all(r["ratio"] < 1.0 for r in rows)


def test_the_page_is_made_from_data_alone(tmp_path, coarse):
    data = build.load(page.HERE / "data")
    found = data["flights"]
    found["campaign"] = {"status": "skipped", "reason": "only with --full"}
    found["starting"]["first"] = None
    with page.into(tmp_path):
        text = flights.flights(data)
    assert "skipped: only with --full" in text
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == {"flights_accuracy", "flights_convergence"}
