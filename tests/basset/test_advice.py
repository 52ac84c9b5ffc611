"""Advice: predicted errors are kept, predictions order schemes as theory does, what is printed makes the rule."""

import json
import math
from dataclasses import astuple

import numpy as np
import pytest

import basset
from basset import MeiAdrianKernel, advice, measure, reference
from basset.quadrature import Daitche, Exponential, Hinsberg, Windowed

MACHINE = advice.Machine(2e-5, 3e-5, 5e-9, 2e-8, 8e-11, 6e-11, 6e-9, 1e-8, 2e-9, 2e-8)  # any will do: times are not asserted
MEI = MeiAdrianKernel(0.1, 1e-3, 1e-6)


def advise(error, **told):
    return basset.advise(error, machine=MACHINE, **told)


def named(found, rule):
    """The candidate with that rule, or of that kind."""
    return next(row for row in found.candidates if row.rule == rule or (isinstance(rule, type) and isinstance(row.rule, rule)))


def waves(*modes):
    """(g, H) of Re Σ a e^(st)."""
    return (
        lambda t: sum(np.real(a * np.exp(s * t)) for s, a in modes),
        lambda t: sum(np.real(a * reference.exponential(t, s)) for s, a in modes),
    )


SIGNALS = {  # rate and H, shortest time scale, length
    "tone": (waves((3j, np.exp(1.0j))), 1 / 3, 20.0),
    "growth": (waves((0.7 + 0j, 1.0)), 1 / 0.7, 12.0),
    "decays": (waves((-0.5 + 0j, 1.0), (-2.0 + 0j, -0.8)), 0.5, 15.0),
    "mixture": (waves((1j, 1.0), (4j, 0.2), (-0.1 + 2j, 0.5)), 0.25, 40.0),
}


def true_error(rule, dt, steps, g, exact, scale):
    t = dt * np.arange(steps + 1)
    wrong = np.abs(basset.cumulate(g(t), dt, rule)[1:] - exact(t[1:]))
    return wrong[math.ceil(scale / dt) - 1 :].max() / np.abs(exact(t[1:])).max()


@pytest.mark.parametrize("told", ["scale", "samples"])
@pytest.mark.parametrize("error", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("name", SIGNALS)
def test_every_candidate_that_should_meet_the_error_does(name, error, told):
    (g, exact), scale, length = SIGNALS[name]
    if told == "scale":
        found = advise(error, time_scale=scale, duration=length)
    else:
        t = np.arange(0.0, length, scale / 8.0)
        found = advise(error, samples=g(t), sample_step=scale / 8.0, duration=length)
    meeting = [row for row in found.candidates if row.meets]
    assert len(meeting) > 8
    for row in meeting:
        if row.steps < 20_000:
            assert true_error(row.rule, row.dt, row.steps, g, exact, found.time_scale) <= row.error <= error


def test_predicted_errors_fall_with_the_step_as_declared():
    coarse, fine = (advise(1e-3, time_scale=1.0, dt=dt, duration=30.0) for dt in (0.05, 0.025))
    for order in (1, 2, 3, 4, 5):
        ratio = named(coarse, Daitche(order)).error / named(fine, Daitche(order)).error
        assert abs(math.log2(ratio) - (order + 1)) < 0.35


def test_higher_degrees_take_longer_steps_down_to_what_the_start_allows():
    found = advise(1e-6, time_scale=1.0, duration=100.0, relaxation=0.0, coefficient=0.0)  # of samples, which no step feeds back
    steps = [named(found, Daitche(order)).dt for order in (1, 2, 3, 4, 5, 6)]
    assert steps == sorted(steps) and steps[0] < 0.02 < 0.1 < steps[-1]


@pytest.mark.parametrize("use", advice.USES)
@pytest.mark.parametrize("length", [1e-12, 0.01, 0.7])
def test_no_step_is_longer_than_the_path(length, use):
    """H of the decay is Dawson's integral: the error of a path shorter than a time scale counts at its end."""
    (g, exact), found = waves((-1.0 + 0j, 1.0)), advise(1e-6, time_scale=1.0, duration=length, use=use)
    assert found.best.meets
    for row in found.candidates:
        assert row.dt <= length and (row.steps - 1) * row.dt < length
        if row.meets and row.steps < 20_000:
            end = row.dt * row.steps
            assert abs(basset.integrate(g(np.linspace(0.0, end, row.steps + 1)), row.dt, row.rule) / exact(np.array([end]))[0] - 1.0) <= 1e-6


def test_meeting_candidates_come_first_and_the_fastest_of_them_is_the_best():
    found = advise(1e-5, time_scale=1.0, dt=0.05, steps=500, memory=5000)
    meets = [row.meets for row in found.candidates]
    assert meets == sorted(meets, reverse=True) and any(meets) and not all(meets)
    times = [row.seconds for row in found.candidates if row.meets]
    assert found.best.seconds == min(times) and times == sorted(times)
    assert all(row.meets == (row.error <= 1e-5 and row.nbytes <= 5000) for row in found.candidates)


def test_a_long_stream_of_many_particles_takes_a_sum_and_a_short_cached_path_the_whole_history():
    assert isinstance(advise(1e-6, time_scale=1.0, dt=0.05, steps=10**6, particles=1000).best.rule, Exponential)
    assert isinstance(advise(1e-6, time_scale=1.0, dt=0.05, steps=255, particles=10, use="path").best.rule, Daitche)


@pytest.mark.parametrize("rule", [Daitche(3), Exponential(1, 1e-3), Exponential(6, 1e-6), Hinsberg, Windowed])
def test_bytes_of_a_stream_are_those_of_its_state(rule):
    found = advise(1e-3 if rule == Exponential(1, 1e-3) else 1e-6, time_scale=1.0, dt=0.05, steps=700, particles=5)
    kind = type(rule) if isinstance(rule, Exponential) else rule
    row = named(found, kind)
    state = row.rule.plan(0.05, 35.0).start((5, 3))
    assert row.nbytes == sum(array.nbytes for array in state) - state.counters.nbytes


def test_memory_decides():
    free = advise(1e-6, time_scale=1.0, dt=0.05, steps=300)
    most = max(row.nbytes for row in free.candidates if row.meets)
    tight = advise(1e-6, time_scale=1.0, dt=0.05, steps=300, memory=most - 1)
    assert sum(row.meets for row in tight.candidates) < sum(row.meets for row in free.candidates)
    with pytest.raises(ValueError, match=r"^memory must be at least \d+ bytes"):
        _ = advise(1e-6, time_scale=1.0, dt=0.05, steps=300, memory=10).best


def test_what_cannot_be_met_says_what_can():
    found = advise(1e-9, time_scale=1.0, dt=0.5, steps=300)
    with pytest.raises(ValueError, match=r"^error must be .*e-\d+ or greater .* got 1e-09: take a smaller dt"):
        _ = found.best
    assert not any(row.meets for row in found.candidates)


def test_kernels_without_a_form_drop_schemes():
    rules = [type(row.rule) for row in advise(1e-4, time_scale=1.0, dt=0.05, steps=300, kernel=MEI).candidates]
    assert Hinsberg not in rules and basset.SemiDerivative not in rules
    assert {Daitche, Exponential, Windowed} <= set(rules)


@pytest.mark.parametrize("kernel", [basset.BassetKernel(), MEI])
def test_the_code_makes_the_rule(kernel):
    for row in advise(1e-5, time_scale=1.0, dt=0.05, steps=3000, kernel=kernel).candidates:
        assert eval(row.code, {"basset": basset}) == row.rule


def test_samples_tell_their_time_scale():
    t = 0.02 * np.arange(2000)
    assert advice.time_scale_of(np.sin(5.0 * t)[:, None], 0.02) == pytest.approx(0.2, rel=0.02)
    assert advice.time_scale_of(np.exp(-t)[:, None], 0.02) == pytest.approx(1.0, rel=0.1)
    assert advice.time_scale_of(np.ones((50, 1)), 0.02) == pytest.approx(0.98)


def test_a_weak_fast_part_costs_less_where_samples_tell_it():
    g, exact = waves((1j, 1.0), (10j, 0.01))
    t = 0.0125 * np.arange(4001)
    by_scale = advise(1e-3, time_scale=0.1, duration=50.0)
    by_samples = advise(1e-3, samples=g(t), sample_step=0.0125, duration=50.0)
    assert by_samples.best.steps < 0.6 * by_scale.best.steps
    best = by_samples.best
    assert true_error(best.rule, best.dt, best.steps, g, exact, by_samples.time_scale) <= 1e-3


def test_rates_are_the_derivative_of_slips():
    t = 0.05 * np.arange(200)
    np.testing.assert_allclose(advice.rates(np.sin(t), 0.05)[:, 0], np.cos(t), atol=1e-8)


@pytest.mark.parametrize("name", ["noise", "kink", "root"])
def test_samples_that_are_not_smooth_are_refused(name):
    t = 0.01 * np.arange(500)
    g = {"noise": np.random.default_rng(0).standard_normal(500), "kink": np.abs(t - 2.003), "root": np.sqrt(t)}[name]
    with pytest.raises(ValueError, match=r"^samples must resolve the rate, which changes within"):
        advise(1e-3, samples=g, sample_step=0.01, duration=10.0)


RIGHT = {"error": 1e-3, "time_scale": 1.0, "dt": 0.1, "steps": 100}


@pytest.mark.parametrize(
    "change, words",
    [
        ({"error": 0.0}, "error must be"),
        ({"time_scale": -1.0}, "time_scale must be"),
        ({"time_scale": None}, "either time_scale .* or samples"),
        ({"samples": np.ones(50), "sample_step": 1.0}, "either time_scale .* or samples"),
        ({"time_scale": None, "samples": np.ones(50)}, "sample_step .* must be given"),
        ({"time_scale": None, "samples": np.ones(5), "sample_step": 1.0}, "samples must be at least 16"),
        ({"time_scale": None, "samples": np.zeros(50), "sample_step": 1.0}, "samples must not all be zero"),
        ({"time_scale": None, "samples": np.full(50, np.nan), "sample_step": 1.0}, "samples must be finite, got nan"),
        ({"dt": -0.1}, "dt must be"),
        ({"dt": None}, "duration .* must be given"),
        ({"steps": None}, "either steps or duration"),
        ({"duration": 10.0}, "either steps or duration"),
        ({"steps": 0}, "steps must be a whole number"),
        ({"steps": None, "duration": 1e-12}, "duration must be at least one step of dt = .* seconds, got 1e-12"),
        ({"time_scale": 1e-320, "dt": None, "steps": None, "duration": 1e-319}, "time_scale must be from 1e-200 to 1e\\+200 seconds, got 9.99989e-321"),
        ({"dt": None, "steps": None, "duration": 1e-310}, "duration must be from 1e-200"),
        ({"particles": 0}, "particles must be a whole number"),
        ({"components": 1.5}, "components must be a whole number"),
        ({"memory": 0.0}, "memory must be greater than 0"),
        ({"use": "streem"}, "use must be one of .*did you mean 'stream'"),
        ({"kernel": "basset"}, "kernel must be a kernel"),
    ],
)
def test_mistakes_are_one_sentence(change, words):
    with pytest.raises((ValueError, TypeError), match=words) as caught:
        advise(**(RIGHT | change))
    assert "\n" not in str(caught.value)


# Calibration


@pytest.fixture
def counted(monkeypatch, tmp_path):
    """Calls of `calibrate`, with a cache of their own."""
    calls = []
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(advice, "calibrate", lambda: calls.append(1) or MACHINE)
    advice._calibrated.cache_clear()
    yield calls
    advice._calibrated.cache_clear()


def test_the_machine_is_measured_once_and_read_again(counted, tmp_path):
    assert advice.calibrated() == MACHINE == advice.calibrated()
    advice._calibrated.cache_clear()
    assert advice.calibrated() == MACHINE
    assert len(counted) == 1 and (tmp_path / "basset" / "machine.json").is_file()


@pytest.mark.parametrize("kept", ["", "[]", "{}", '{"key": "another machine", "machine": {}}', '{"key": KEY, "machine": {"call": 1}}'])
def test_a_cache_of_something_else_is_replaced(counted, tmp_path, kept):
    place = tmp_path / "basset" / "machine.json"
    place.parent.mkdir()
    place.write_text(kept.replace("KEY", json.dumps(f"{basset.__version__} {measure.processor()}")))
    assert advice.calibrated() == MACHINE
    assert len(counted) == 1 and json.loads(place.read_text())["machine"]["stall"] == MACHINE.stall


def test_nowhere_to_keep_is_no_failure(counted, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert advice.calibrated() == MACHINE


def test_constants_are_finite_and_no_less_than_nothing():
    numbers = astuple(advice.calibrate())
    assert np.isfinite(numbers).all() and min(numbers) >= 0.0
