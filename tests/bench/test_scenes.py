"""The page on scenes: all schemes compete in valid scenes, errors are paired, scatter is told from error, cancellation counts for nothing."""

import tomllib

import numpy as np
import pytest

import basset
from bench.suites import scenes as suite
from reports import build, scenes
from reports.site import page
from saltation.scene import scene_of

ALL = [contender.scheme for contender in suite.CONTENDERS]


def record(scheme="A", method="fixed_step", size=1e-3, bias=0.01, se=1e-4, seconds=1e-3, truncation=None, **more):
    errors = {"bias": bias, "se": se, "rms": abs(bias), "max": abs(bias)}
    cut = None if truncation is None else {name: errors | {"bias": truncation} for name in scenes.QUANTITIES}
    row = {"scheme": scheme, "method": method, "size": size, "seconds": seconds, "family": "whole past", "history": {}, "jumps": 220}
    return row | dict.fromkeys(scenes.QUANTITIES, errors) | {"truncation": cut} | more


def test_every_scheme_and_solver_competes():
    assert {contender.history["scheme"] for contender in suite.CONTENDERS} == set(basset.SCHEMES)
    assert len(set(ALL)) == len(ALL) and set(suite.FEWER) <= set(ALL)
    flown = {method for contender in suite.CONTENDERS for method in (suite.IMPLICIT, suite.HELD) if suite.planned(contender, method, "impulse", [1e-2], 1e9)}
    assert flown == {suite.IMPLICIT, suite.HELD}
    assert {flight.method for flight in suite.collocations("impulse")} == {suite.COLLOCATION}


@pytest.mark.parametrize("rebound", ["impulse", "reset"])
def test_every_contender_is_a_valid_scene_at_every_step(rebound):
    for contender in suite.CONTENDERS:
        for dt in suite.LADDER:
            scene = scene_of(suite.Flight(contender, suite.IMPLICIT, dt).scene(rebound, 1))
            rule = scene.history_rule()
            assert type(rule) is basset.SCHEMES[contender.history["scheme"]]
            assert np.isinf(contender.window) or abs(contender.window / dt - round(contender.window / dt)) < 1e-6  # published tails begin at the window's end
    for flight in suite.collocations(rebound):
        assert scene_of(flight.scene(rebound, 1)).solver.method == "collocation"


def test_contenders_with_other_kernels_are_valid_scenes_with_their_own_references():
    for kernel in scenes.KERNELS:
        assert scene_of(suite.exact(kernel=kernel).scene("impulse", 1)).options("history").kernel == kernel
        for contender in suite.CONTENDERS:
            if contender.scheme in suite.FOLLOWING:
                for flight in suite.planned(contender, suite.HELD, "impulse", suite.LADDER, 3.0, kernel):
                    assert scene_of(flight.scene("impulse", 1)).options("history").kernel == kernel
    assert set(suite.FOLLOWING) <= set(ALL)


def test_the_pair_of_the_thesis_is_extrapolated_as_the_root_of_the_step():
    history = {"scheme": "semi_derivative", "window_jumps": 2}
    rows = [record("P", "runge_kutta_4", size=dt, bias=-0.02 + dt**0.5, se=1e-5, history=history) for dt in (4e-3, 1e-3)]
    text = scenes.thesis_table([*rows, record("C", "collocation", bias=-0.02, se=1e-5, history={"window_jumps": 2})])
    assert text.splitlines()[-1] == "| 2 | +4.3 | +1.2 | -2 | -2 |"
    assert scenes.counted_combinations([{"form": "a", "x": "", "y": "no"}, {"form": "b", "x": "", "y": ""}]) == (4, 3)


def test_what_a_toml_says_is_the_scene():
    contender = next(c for c in suite.CONTENDERS if c.family == suite.FITTED)
    text = scenes.toml(record(size=1e-3, history=dict(contender.history)))
    read = tomllib.loads(text)
    assert read["history"] == contender.history and read["solver"] == {"method": "fixed_step", "dt": 1e-3}


def test_dear_runs_are_cut_short_or_left_out():
    whole = next(c for c in suite.CONTENDERS if c.scheme == "semi-derivative")
    tail = next(c for c in suite.CONTENDERS if c.family == suite.FITTED and c.window == 1.0)
    for contender, lengths in ((whole, {suite.SHORT}), (tail, {suite.JUMPS, suite.SHORT})):
        flights = suite.planned(contender, suite.IMPLICIT, "impulse", suite.LADDER, 3.0)
        assert {flight.jumps for flight in flights} == lengths and len(flights) < len(suite.LADDER)
    nothing = [flight.size for flight in suite.planned(whole, suite.HELD, "impulse", suite.LADDER, 0.0)]
    assert nothing == [suite.THESIS[2]]  # the thesis's way is always flown
    cheap = next(c for c in suite.CONTENDERS if c.family == suite.SUMS)
    assert suite.predicted(cheap, 1e-3, 220, "impulse") < suite.predicted(whole, 1e-3, 220, "impulse")


def test_errors_are_means_of_paired_differences():
    rng = np.random.default_rng(0)
    truths = [rng.uniform(1.0, 9.0, (200, 2)) for _ in range(2)]
    noise = [rng.normal(0.0, 0.1, (200, 2)) for _ in range(2)]
    found = suite.paired([t + 0.5 + n for t, n in zip(truths, noise, strict=True)], truths, np.array([5.0, 10.0]))
    assert found["height"]["bias"] == pytest.approx(0.1, abs=4e-3) and found["length"]["bias"] == pytest.approx(0.05, abs=2e-3)
    assert found["height"]["se"] == pytest.approx(0.02 / np.sqrt(400), rel=0.3)  # far below 1/√n of the jumps' own spread
    short = suite.paired([truths[0][:60]], [truths[0]], np.ones(2))
    assert short["height"] == {"bias": 0.0, "se": 0.0, "rms": 0.0, "max": 0.0}


def test_twins_differ_in_what_they_remember_alone():
    by_name = {contender.scheme: contender for contender in suite.CONTENDERS}
    window = suite.Flight(by_name["Daitche(2), window 1"], suite.IMPLICIT, 1e-3)
    assert suite.is_twin(suite.Flight(by_name["Exponential(2)"], suite.IMPLICIT, 1e-3, 60), window)
    assert not suite.is_twin(suite.Flight(by_name["Exponential(2)"], suite.HELD, 1e-3), window)
    assert not suite.is_twin(suite.Flight(by_name["Exponential(2)"], suite.IMPLICIT, 4e-3), window)
    assert not suite.is_twin(suite.Flight(by_name["Exponential(3)"], suite.IMPLICIT, 1e-3), window)
    assert not suite.is_twin(suite.Flight(by_name["Exponential(2)"], suite.IMPLICIT, 1e-3), suite.Flight(by_name["Brush"], suite.IMPLICIT, 1e-3))


def test_what_flies_is_near_the_truth_and_a_dropped_past_is_told_from_the_step():
    names = ("Exponential(2)", "Daitche(2), window 1", "Daitche(2), window 0.1, fitted tail")
    flights = [suite.Flight(c, suite.IMPLICIT, 1e-2, 25) for c in suite.CONTENDERS if c.scheme in names]
    truth = suite.exact(25)
    table = truth.fly("impulse", 1)[1][suite.DISCARD :]
    logs = suite.take_turns(flights, "impulse", [1], 1e9)
    rows = {f.contender.scheme: suite.record_of(f, log, logs, {1: table}, table.mean(axis=0)) for f, log in logs.items()}
    assert all(row["seconds"] is not None and row["reason"] == "" for row in rows.values())
    assert 0.01 < abs(rows["Exponential(2)"]["height"]["bias"]) < 0.5 and rows["Exponential(2)"]["truncation"] is None
    fitted, dropped = (rows[name]["truncation"]["height"] for name in names[:0:-1])
    assert 10.0 * abs(fitted["bias"]) < abs(dropped["bias"])  # an impact on the neighbouring step is all that is left of the one


def test_an_error_within_its_scatter_is_an_upper_bound():
    told, untold = record(bias=-0.01, se=1e-3), record(bias=1e-4, se=1e-3)
    assert not scenes.scatters(told, "height") and scenes.scatters(untold, "height")
    assert scenes.upper(told, "height") == pytest.approx(0.012) and scenes.upper(untold, "height") == pytest.approx(2.1e-3)
    assert scenes.error_cell(told, "height") == "-1" and scenes.error_cell(untold, "height") == "≤ 0.2"
    assert scenes._points([untold], "length") == [(1e3, pytest.approx(0.21), False)]


def test_an_error_that_is_small_by_cancellation_counts_in_full():
    assert scenes.counted(record(bias=1e-3, se=0.0, truncation=-0.05), "height") == pytest.approx(0.051)
    assert scenes.counted(record(bias=1e-3, se=0.0, truncation=0.05), "height") == pytest.approx(0.05)


def test_the_cheapest_keeps_its_error_at_all_finer_steps():
    crossing = [
        record(size=1e-2, bias=1e-4, se=0.0, seconds=1.0),
        record(size=1e-3, bias=0.05, se=0.0, seconds=2.0),
        record(size=1e-4, bias=1e-3, se=0.0, seconds=9.0),
    ]
    steady = [record("B", size=1e-2, bias=0.02, se=0.0, seconds=3.0), record("B", size=1e-3, bias=0.002, se=0.0, seconds=9.5)]
    best, others = scenes.fastest([*crossing, *steady], 0.01, "height")
    assert (best["scheme"], best["seconds"]) == ("A", 9.0) and [r["scheme"] for r in others] == ["B"]
    assert scenes.fastest(steady, 0.03, "length")[0]["seconds"] == 3.0
    assert scenes.fastest(steady, 1e-5, "length") == (None, [])


def test_steps_are_short():
    assert [scenes.step_of(x) for x in (1e-2, 4e-3, 1e-3, 2.5e-4, 6.25e-5, 1e-5)] == ["0.01", "0.004", "0.001", "2.5e-4", "6.25e-5", "1e-5"]


def test_the_page_is_made_from_data_alone(tmp_path, coarse):
    data = build.load(page.HERE / "data")
    with page.into(tmp_path):
        text = scenes.scenes(data)
    assert all(row["scheme"] in text for row in data["scenes"]["impulse"]["records"])
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == {f"scenes_{name}" for name in ("accuracy", "reset", "windows", *scenes.KERNELS)}
    assert text.startswith("# Accuracy against time")


def test_what_is_out_of_reach_is_extrapolated_as_the_root_of_the_step():
    rows = [record("S", size=dt, bias=0.1 * dt**0.5, se=0.0, seconds=1.0 / dt, family=scenes.SUMS) for dt in (1e-2, 1e-4)]
    time, name = scenes.extrapolated([*rows, record("W", size=1e-4, bias=1e-9, se=0.0)], 1e-4, "height")
    assert time == pytest.approx(1e6) and name == "S, implicit"
    assert scenes.choice(rows, 1e-4, "height", record(seconds=1.0))[1] == "≈ 1 000 000 ×"


def test_solvers_and_luck_are_told():
    pairs = [record("A", bias=0.02, seconds=2.0), record("A", "runge_kutta_4", bias=-0.03, seconds=3.0)]
    assert scenes.solvers_apart(pairs) == pytest.approx((1.5, 1.5, 1.5))
    lucky = record("D", bias=0.001, truncation=-0.05, family=scenes.DROPPED)
    assert scenes.luckiest([*pairs, record("D", bias=0.04, truncation=-0.05, family=scenes.DROPPED), lucky]) is lucky
