"""A run that is accepted ends as asked: memories that follow the flights, long falls, odd lengths, and refusals that `check` knows."""

from __future__ import annotations

import math
import re
import tracemalloc

import numpy as np
import pytest
from scene_cases import Bouncer, flown, linear, merged, scene

import saltation
from saltation.cli import value_of
from saltation.flight import setup as engine
from saltation.front import warm
from saltation.scene import SceneError, read, scene_of
from saltation.scene.model import FINEST_STEPS
from saltation.study import cases, checks
from saltation.study import effects as advice
from saltation.study.thesis import case

FALL = ["weight", "drag", "added_mass"]


def falling(diameter, duration, fluid=(1000.0, 1e-6), density=2650.0, effects=FALL, **more):
    """A grain in still water or air without a bed; duration in s."""
    content = {"effects": effects, "fluid": {"density": fluid[0], "viscosity": fluid[1]}, "grain": {"density": density, "diameter": diameter}}
    return scene_of(content | {"run": {"duration": duration}} | more)


class TestMemory:
    """It widens until the jumps are done."""

    @pytest.mark.parametrize("first", [2.0, 5.0, 30.0])
    @pytest.mark.parametrize("solver", [{}, {"method": "fixed_step", "dt": 0.02}])
    def test_as_many_jumps_as_asked(self, first, solver, monkeypatch):
        """From a memory that is too short, the run is the one whose memory was long enough, to the accuracy of their sums."""
        made = scene("bouncing", run={"jumps": 6}, history={"rebound": "impulse"}, solver={"rtol": 1e-6 if not solver else 1e-5} | solver)
        whole = flown(made)
        monkeypatch.setattr(engine, "first_horizon", lambda scene: first)
        result = flown(made)
        assert result.status == "finished" and len(result.all_jumps) == 6
        np.testing.assert_allclose(result.jumps["height"], whole.jumps["height"], rtol=1e-4)

    def test_one_that_is_given_ends_the_run_and_is_announced(self):
        made = scene("bouncing", history={"horizon": 4.0})
        assert flown(made).status == "horizon"
        assert any("history.horizon = 4" in text for text in checks.warnings(made))

    @pytest.mark.parametrize("far", [1e8, 1e9])
    def test_a_very_long_one_costs_no_accuracy(self, far):
        plain, long = (flown(scene("bouncing", history=history)) for history in ({}, {"horizon": far}))
        np.testing.assert_allclose(long.jumps["height"], plain.jumps["height"], rtol=1e-8)

    @pytest.mark.parametrize("duration", [1e-9, 1e-7, 3e-4])
    def test_very_short_ones(self, duration):
        unit = saltation.load("settling").numbers.time
        made = scene("settling", run={"duration": 1.01 * duration * unit})
        result = flown(made)
        assert result.status == "finished" and float(result.trajectory["time"][-1]) == pytest.approx(1.01 * duration, rel=1e-9)

    @pytest.mark.parametrize("kernel", ["basset", "mei_adrian"])
    @pytest.mark.parametrize("horizon", [5e-324, 1e-9, 1e-3, 0.03])
    def test_one_shorter_than_a_step_is_said_to_be(self, horizon, kernel):
        result = flown(scene("bouncing", history={"horizon": horizon, "kernel": kernel}, solver={"rtol": 1e-5}))
        assert result.status == "horizon" and "history.horizon" in result.message

    def test_a_longer_run_keeps_what_is_given(self):
        made = saltation.load("sand").changed(history={"horizon": 1e5})
        assert cases.with_jumps(made, 2000).horizon == pytest.approx(1e5 / 220 * 2020, rel=1e-14)


class TestWithoutABed:
    """No flight is too long, and none is dear."""

    @pytest.mark.parametrize(("diameter", "fluid", "density", "duration"), [
        (1.5e-3, (1.2, 1.5e-5), 7800.0, 20.0),
        (0.7e-3, (1.2, 1.5e-5), 2500.0, 60.0),
        (1e-3, (1000.0, 1e-6), 2650.0, 3600.0),
        (5e-6, (1000.0, 1e-6), 2650.0, 3600.0),
        (5e-6, (1000.0, 1e-6), 2650.0, 86400.0),
        (2e-5, (1.2, 1.5e-5), 2650.0, 86400.0),
    ])  # fmt: skip
    @pytest.mark.parametrize("law", ["yen", "schiller_naumann"])
    def test_terminal_velocity(self, diameter, fluid, density, duration, law):
        made = falling(diameter, duration, fluid, density, drag={"law": law}, run={"duration": duration, "longest_flight": 10.0})
        warm(made)  # the compiler's memory is not the flight's, and tracing doubles its time
        tracemalloc.start()
        result = flown(made)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert result.status == "finished" and result.trajectory.sizes["time"] < 3000 and peak < 1e8
        assert -float(result.trajectory["w"][-1]) * made.numbers.velocity == pytest.approx(checks.settling_velocity(made), rel=1e-5)
        assert float(result.trajectory["time"][-1]) * made.numbers.time == pytest.approx(duration, rel=1e-12)

    @pytest.mark.parametrize("diameter", [5e-6, 2e-5])
    def test_a_longer_memory_takes_over(self, diameter, monkeypatch):
        """Stokes drag and history from rest: w = −(g/λ) (1 − S), S the response; from where memories changed it is the same."""
        made = falling(diameter, 3600.0, effects=[*FALL, "history"], drag={"law": "stokes"}, start={"velocity": [0.0, 0.0, 0.0]}, solver={"rtol": 1e-7})
        assert made.horizon > 10.0 * engine.BRIEF
        result = flown(made)
        monkeypatch.setattr(engine, "BRIEF", 1e12)
        whole = flown(made)
        w, again = (float(r.trajectory["w"][-1]) for r in (result, whole))
        n = made.numbers
        fall, rate, c = n.alpha / n.shields, 18.0 * n.alpha / n.reynolds, n.history
        t = float(result.trajectory["time"][-1])
        late = fall / rate * (1.0 - c / rate / math.sqrt(t))  # w = −(g/λ)(1 − c/(λ√t) + …) as K = t^(−1/2) and c includes its factor
        assert -w == pytest.approx(late, rel=1e-6)
        assert w == pytest.approx(again, rel=1e-6)


@pytest.mark.parametrize("rtol", [1e-4, 1e-7])
@pytest.mark.parametrize(("diameter", "density"), [(0.03162, 9274.0), (0.01, 5000.0)])
def test_a_fall_reaches_the_wall_at_any_speed(diameter, density, rtol):
    """Through a shear layer of a hundredth of its diameter within 1e-6 d/V, and on at its settling velocity in the still water below."""
    channel = {"profile": "swamee", "transport_stage": 1.0, "slope": 0.02}
    made = falling(diameter, 2e4, density=density, effects=[*FALL, "lift"], channel=channel, drag={"law": "stokes"}, solver={"rtol": rtol})
    result = flown(made)
    assert result.status == "finished"
    speed = math.cos(made.numbers.slope) * checks.settling_velocity(made) / made.numbers.velocity
    assert speed > 500.0 and float(result.trajectory["w"][-1]) == pytest.approx(-speed, rel=1e-6)


@pytest.mark.parametrize(("diameter", "density"), [(2e-4, 950.0), (1e-4, 500.0), (1e-4, 2650.0)])
def test_lighter_than_the_stream_it_rises(diameter, density):
    """At Stokes's speed."""
    channel, start = {"profile": "swamee", "shear_velocity": 0.05}, {"start": {"velocity": [0.0, 0.0, 0.0], "height": 2000.0 if density > 1000.0 else 2.0}}
    made = falling(diameter, 0.5, density=density, channel=channel, drag={"law": "stokes"}, **start)
    result = flown(made)
    assert result.status == "finished"
    speed = (1.0 - density / 1000.0) * 9.81 * diameter**2 / 18e-6 / made.numbers.velocity
    assert float(result.trajectory["w"][-1]) == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize("height", [0.50002, 0.500018, 0.500044, 0.5003])
def test_a_contact_late_in_a_step_is_met_there(height):
    """A drop of some 1e-5 d: a contact that is met at the end of its step only comes 1 to 10 % late. Drops below 1e-3 d err by up to 83 × rtol all the same."""
    made = scene("bouncing", fluid={"viscosity": 1e-5}, grain={"diameter": 2e-3, "density": 7800.0}, start={"height": 2e-3 * height}, run={"jumps": 1})
    times = [float(flown(made.changed(solver={"rtol": rtol})).all_jumps["duration"].iloc[0]) for rtol in (1e-4, 1e-5, 1e-8)]
    assert times[0] == pytest.approx(times[2], rel=1e-2) and times[1] == pytest.approx(times[2], rel=1e-3)


@pytest.mark.parametrize("method", ["fixed_step", "runge_kutta_4"])
@pytest.mark.parametrize("steps", [10.5, 3.25, 100.9, 7.0])
def test_fixed_steps_end_where_they_are_told_to(method, steps):
    dt = 0.01
    made = scene("settling", run={"duration": steps * dt * saltation.load("settling").numbers.time}, solver={"method": method, "dt": dt})
    result = flown(made)
    assert result.status == "finished"
    assert float(result.trajectory["time"][-1]) == pytest.approx(steps * dt, rel=1e-12)
    sharp = flown(scene("settling", run={"duration": steps * dt * made.numbers.time}))
    assert float(result.trajectory["w"][-1]) == pytest.approx(float(sharp.trajectory["w"][-1]), rel=0.1)


FINE = {"solver": {"method": "fixed_step", "dt": 1e-12}, "effects": ["weight"], "history": None}
COARSE = {"solver": {"method": "fixed_step", "dt": 0.1}}
FIXED = {"solver": {"method": "fixed_step", "dt": 1e-3}}


@pytest.mark.parametrize(("changes", "words"), [
    ({"solver": {"method": "fixed_step", "dt": 1e-6}, "history": {"scheme": "daitche"}}, ("1e+08 steps", "solver.dt")),
    (COARSE | {"history": {"scheme": "windowed", "window": 0.03}}, ("history.window", "one step", "d/u*")),
    (COARSE | {"history": {"scheme": "hinsberg", "window": 0.09}}, ("history.window", "one step", "d/u*")),
    (COARSE | {"history": {"scheme": "windowed", "window": 0.1, "order": 3, "tail": "fitted"}}, ("history.window", "2 steps")),
    (FIXED | {"history": {"scheme": "windowed", "window": 3.0, "rtol": 1e-6}}, ("history.rtol", "tail")),
    ({"history": {"order": 3}}, ("history.order", "collocation")),
    ({"history": {"rtol": 1e-8}}, ("history.rtol", "collocation")),
    ({"history": {"kernel": "mei_adrian", "scheme": "daitche"}}, ("scheme = 'exponential'", "solver.method = 'fixed_step'")),
    (FIXED | {"history": {"kernel": "dorgan_loth", "scheme": "semi_derivative"}}, ("kernel = 'basset'", "scheme = 'daitche'")),
    (FIXED | {"history": {"kernel": "mei_adrian", "rtol": 1e-13}}, ("history.rtol", "at least")),
    ({"history": {"kernel": "mei_adrian"}, "solver": {"rtol": 9e-9}}, ("solver.rtol", "1e-08 or greater", "mei_adrian")),
    ({"history": {"kernel": "dorgan_loth"}, "solver": {"rtol": 1e-9}}, ("solver.rtol", "1e-07 or greater", "dorgan_loth")),
    ({"run": {"jumps": None, "discard": 0, "duration": 1e-300}}, ("run.duration", "1e-09")),
    ({"run": {"jumps": None, "discard": 0, "duration": 1e300}}, ("run.duration", "at most")),
    ({"run": {"jumps": 10**30}}, ("run.jumps", "1000000000")),
    ({"run": {"longest_flight": 5e-324}}, ("run.longest_flight", "1e-09")),
    ({"added_mass": {"coefficient": 1e300}}, ("added_mass.coefficient", "1e+06")),
    ({"channel": {"von_karman": 5e-324}}, ("channel.von_karman", "0.001")),
    ({"channel": {"depth": 0.0}}, ("channel.depth", "greater than 0")),
    ({"channel": {"depth": 1e300}}, ("depth over diameter", "units")),
    ({"bed": {"rebound": ["tsuji"]}}, ("bed.rebound", "'tsuji'")),
    ({"history": {"scheme": ["daitche"]}}, ("history.scheme", "'daitche'")),
    (FINE | {"run": {"jumps": None, "discard": 0, "duration": 1.0}}, ("run.duration", "solver.dt")),
])  # fmt: skip
def test_check_refuses_what_a_run_would(changes, words):
    content = merged(case("sand"), changes)
    with pytest.raises(SceneError) as caught:
        scene_of(content)
    text = str(caught.value)
    assert all(word in text for word in words) and "second" not in text and "\n" not in text, text


@pytest.mark.parametrize("kernel", ["mei_adrian", "dorgan_loth"])
def test_the_finest_tolerance_that_a_kernel_takes_is_kept(kernel):
    """Against ten times as much, which its flights keep as well."""
    finest = FINEST_STEPS[kernel]
    run = {"jumps": 5, "discard": 0, "trajectory": False}
    fine, coarse = (flown(scene("sand", history={"kernel": kernel}, solver={"rtol": rtol}, run=run)) for rtol in (finest, 10.0 * finest))
    assert fine.status == coarse.status == "finished"
    heights = fine.all_jumps["height"]
    assert ((coarse.all_jumps["height"] - heights).abs() / heights.mean()).max() <= 11.0 * finest


@pytest.mark.parametrize(("dt", "window"), [(0.03, 1.0), (0.007, 0.5), (0.011, 0.0777)])
@pytest.mark.parametrize("tail", ["fitted", "van_hinsberg"])
def test_what_check_passes_runs(dt, window, tail):
    """Memories that are no whole number of steps."""
    history = {"scheme": "windowed", "window": window, "tail": tail, "rebound": "impulse"}
    made = scene("bouncing", history=history, solver={"method": "fixed_step", "dt": dt, "rtol": 1e-5}, run={"jumps": 2})
    assert flown(made).status == "finished"


@pytest.mark.parametrize("interval", [1e-300, 1e-9, 1e-6])
def test_a_cloud_that_would_keep_too_much(interval):
    content = merged(case("sand_cloud"), {"cloud": {"interval": interval}})
    with pytest.raises(SceneError, match=r"cloud\.interval must give"):
        scene_of(content)


@pytest.mark.parametrize(("fluid", "most"), [((1.2, 1.5e-5), 1e4), ((1000.0, 1e-6), 1000.0), ((5.0, 1e-5), 1000.0)])
def test_flights_in_air_are_given_time(fluid, most):
    """Ballistic flights last 2 w/g' = 2 w τ* ρ_s/ρ: more than 1000 d/u* in air."""
    content = {"fluid": {"density": fluid[0], "viscosity": fluid[1]}, "channel": {"transport_stage": None, "shear_velocity": 0.4}}
    content |= {"grain": {"diameter": 2.5e-4}} if fluid[0] < 10.0 else {"channel": {}}
    made = scene_of(merged({**case("sand")}, content) if content["channel"] else case("sand"))
    assert made.longest_flight >= most
    assert made.longest_flight >= 50.0 * made.numbers.shields / made.numbers.alpha


@pytest.mark.parametrize("text", ["[" * 5000, "{a=" * 3000, "9" * 5000, "0x" + "f" * 9000, "[" * 90 + "]" * 90])
def test_values_that_cannot_be_read(text, tmp_path):
    """In a file or on the command line: one sentence."""
    path = tmp_path / "deep.toml"
    path.write_text(f"effects = ['weight']\ngrain.diameter = {text}\nrun.duration = 1.0\n")
    with pytest.raises(SceneError) as caught:
        saltation.load(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(SceneError):
        scene_of(merged(case("sand"), {"grain": {"diameter": value_of(text)}}))


@pytest.mark.parametrize("name", ["x" * 5000, "a/" + "y" * 300 + ".toml", "nul\0"])
def test_names_that_no_file_can_have(name):
    with pytest.raises(SceneError, match="does not exist"):
        saltation.load(name)


@pytest.mark.parametrize("jumps", [1, 3, 10, 40])
def test_a_grain_that_lies_still_has_not_finished(jumps):
    """Dropped from no height: impacts follow each other without flight, however few are wanted."""
    made = scene(
        "bouncing", effects=["weight"], history=None, height=0.5, velocity=[0.0, 0.0, 0.0], bed={"restitution": 0.0}, run={"jumps": jumps, "trajectory": False}
    )
    assert flown(made).status == "at rest"


def test_units_of_still_water_are_named():
    found = checks.computed(scene("bouncing"))
    assert "√(|R| g d)" in found["units"] and "u*" not in found["memory"] and "u*" not in found["solver"]


@pytest.mark.parametrize("changes", [
    {"solver": {"method": "fixed_step", "dt": 1.0}},
    {"solver": {"method": "fixed_step", "dt": 1e-4}, "history": {"scheme": "windowed", "window": 1e-5}},
    {"solver": {"method": "fixed_step", "dt": 1e-4}, "history": {"scheme": "windowed"}},
    {"history": {"window": -1.0}},
    {"history": {"horizon": 1e30}},
    {"run": {"duration": 1e300}},
])  # fmt: skip
def test_sentences_about_still_water_name_no_shear_velocity(changes):
    with pytest.raises(SceneError) as caught:
        scene_of(merged(read("settling"), changes))
    assert "d/V" in str(caught.value) and "u*" not in str(caught.value)
    with pytest.raises(SceneError, match=r"d/u\*"):
        scene_of(merged(read("settling"), changes | {"channel": {"shear_velocity": 0.05}}))


def test_a_spin_cannot_lose_more_than_all_of_itself():
    made = scene_of(merged(case("sand"), {"effects": ["weight", "drag", "rotation"], "history": None, "grain": {"diameter": 1e-5}, "lift": None}))
    row = next(row for row in advice.advise(made) if row.effect == "rotation")
    assert row.share <= 1.0 and "%" not in row.reason


@pytest.mark.parametrize("diameter", [1e-6, 1e-5, 1e-4, 0.69e-3])
def test_no_share_is_said_in_thousands_of_per_cent(diameter):
    """Drag on a small grain is 760 times its weight, not 76493 % of it."""
    rows = advice.advise(scene_of(merged(case("sand"), {"grain": {"diameter": diameter}})))
    shares = [float(share) for row in rows for share in re.findall(r"([\d.]+)%", row.reason)]
    assert shares and max(shares) <= 1000.0
    assert (" times the submerged weight" in rows[1].reason) == (rows[1].share >= 10.0)


class TestStiff:
    """Grains that the fluid stops at once: steps far below d/V, flights of any length, memories from the one to the other."""

    @pytest.mark.parametrize("kernel", ["basset", "mei_adrian", "dorgan_loth"])
    @pytest.mark.parametrize("changes", [{"fluid": {"viscosity": 2e-3}}, {"fluid": {"viscosity": 2e-2}}, {"grain": {"diameter": 1e-6}}])
    def test_another_tolerance_gives_the_same_flights(self, kernel, changes):
        content = merged(case("sand"), changes | {"history": {"kernel": kernel}, "run": {"jumps": 8, "discard": 0, "trajectory": False}})
        coarse, fine = (flown(scene_of(merged(content, {"solver": {"rtol": rtol}}))) for rtol in (1e-4, 1e-6))
        assert coarse.status == fine.status == "finished" and len(fine.all_jumps) == 8
        np.testing.assert_allclose(coarse.all_jumps["height"], fine.all_jumps["height"], rtol=1e-3)
        np.testing.assert_allclose(coarse.all_jumps["duration"], fine.all_jumps["duration"], rtol=1e-3)

    @pytest.mark.parametrize("kernel", ["basset", "mei_adrian", "dorgan_loth"])
    def test_the_limit_of_creeping_flow(self, kernel):
        """Stokes drag, in a fluid so viscous that every kernel is Basset's: the exact flights, from a first one that takes as long as 1e7 relaxations."""
        made = scene("bouncing", fluid={"viscosity": 3e-2}, history={"kernel": kernel}, solver={"rtol": 1e-6}, run={"jumps": 1})
        result = flown(made)
        exact = Bouncer(*linear(made), height=5.0, restitution=made.bed.restitution, memory="impulse")
        assert result.status == "finished"
        assert result.all_jumps["duration"][0] == pytest.approx(exact.bounce(), rel=1e-4)

    def test_flights_with_long_memories_need_no_other_sum(self):
        """A sum for any range beside the tabulated one that reaches as far."""
        for follows in (False, True):
            near, far = 1e-10, 1e6
            found = engine.tables_for(6, 1e-7, far, near, faint=0.0, follows=follows).tail
            assert found.near < near and found.far == far and len(found) < 200
            lags = np.geomspace(near, far, 2000)
            assert np.abs(found(lags) * np.sqrt(lags) - 1.0).max() < 1e-7

    def test_slow_grains_come_down(self):
        """A micrometre of quartz in water sinks by half its diameter in some thousand d/u*."""
        made = scene_of(merged(case("sand"), {"grain": {"diameter": 1e-6}, "run": {"jumps": 5, "discard": 0}}))
        assert made.longest_flight >= 20.0 * made.numbers.velocity / checks.settling_velocity(made) * 0.999
        assert flown(made).status == "finished"


@pytest.mark.parametrize("changes", [
    {"fluid": {"density": 1000.0, "viscosity": 1e-6}, "grain": {"diameter": 2.759e-4, "density": 2257.0}, "channel": {"transport_stage": 24.67},
     "bed": {"rebound": "garcia_nino", "roughness": "R6", "restitution": "set1", "contact_mass": "immersed", "friction": None, "tangential_retention": 0.1},
     "effects": ["weight", "drag", "added_mass", "history"], "solver": {"rtol": 1e-3}, "run": {"jumps": 21, "discard": 1, "seed": 926}},
    {"fluid": {"density": 1000.0, "viscosity": 1e-6}, "grain": {"diameter": 4.265e-4, "density": 2650.0}, "channel": {"transport_stage": 16.9},
     "bed": {"rebound": "tsuji_printed", "roughness": "R2", "restitution": "stokes", "contact_mass": "immersed"},
     "history": {"kernel": "dorgan_loth"}, "solver": {"rtol": 1e-6}, "run": {"jumps": 28, "discard": 1, "seed": 842}},
])  # fmt: skip
def test_contacts_that_follow_at_once(changes):
    """Behind a contact within 1e-5 d/u* of another one steps are as short as the time between them."""
    result = flown(scene_of(merged(case("sand"), {"bed": {"reading": "literal"}, "lift": None} | changes | {"bed": changes["bed"] | {"reading": "literal"}})))
    assert len(result.all_jumps) == changes["run"]["jumps"] and result.all_jumps["duration"].min() < 2e-5
