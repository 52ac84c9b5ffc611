"""The loop from impact to impact: what is compiled, what the memory keeps at an impact, how an impact is found, against exact motions and `basset.solve`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scene_cases import Bouncer, flown, gauss, interpreted, linear, scene

import basset
import saltation
from basset import reference
from basset.solvers import stepper
from saltation.flight import equations, layout
from saltation.flight.setup import Engine, Grain, empty_record
from saltation.flow import tabulated

MEMORIES = ("impulse", "restart", "reset", "none")


def exact_bounces(made, memory, count):
    """(duration, rise, impact speed, takeoff speed) of every flight, and the bouncer."""
    bouncer = Bouncer(*linear(made), height=5.0, restitution=made.bed.restitution, memory=memory)
    rows = []
    for k in range(count):
        up = bouncer.after[-1] if k else 0.0
        before = Bouncer(**{**vars(bouncer), "times": list(bouncer.times), "jumps": list(bouncer.jumps), "after": list(bouncer.after)})
        flown = bouncer.bounce()
        rows.append((flown, before.highest(flown) if k else 0.0, -bouncer.after[-1] / made.bed.restitution, up))
    return np.array(rows), bouncer


class TestMemoryAtAnImpact:
    """Linear: each choice of history.rebound has a closed form, and they differ by far more than the tolerance."""

    @pytest.mark.parametrize("memory", MEMORIES)
    @pytest.mark.parametrize("viscosity", [1e-5, 1e-6])
    def test_every_choice_against_its_closed_form(self, memory, viscosity):
        made = scene("bouncing", history={"rebound": memory}, fluid={"viscosity": viscosity}, run={"jumps": 6}, height=5.5)
        jumps = flown(made).jumps
        exact, _ = exact_bounces(made, memory, 6)
        found = jumps[["duration", "height", "impact_z", "takeoff_z"]].to_numpy()
        assert np.abs(found - exact).max() < 1e-8

    def test_the_choices_differ(self):
        second = {memory: exact_bounces(scene("bouncing"), memory, 2)[0][1, 1] for memory in MEMORIES}
        assert second["impulse"] < second["restart"] < second["reset"] < second["none"]
        assert second["none"] > 1.5 * second["impulse"]

    @pytest.mark.parametrize("memory", ["restart", "reset"])
    def test_a_flight_is_that_of_a_grain_without_past(self, memory):
        """`restart`: of one that starts so. `reset`: of one whose first slip is not remembered, which `basset.solve` knows."""
        made = scene("bouncing", history={"rebound": memory}, run={"jumps": 3}, velocity=[1.0, 0.0, 0.0])
        third = flown(made).jumps.iloc[2]
        if memory == "restart":
            fresh = scene("bouncing", run={"jumps": 1}, velocity=[third["takeoff_x"], 0.0, third["takeoff_z"]], height=0.5 + 1e-15)
            first = flown(fresh).jumps.iloc[0]
            for name in ("duration", "height", "length", "impact_x", "impact_z"):
                assert first[name] == pytest.approx(third[name], abs=1e-9)
            return
        rate, coefficient, gravity = linear(made)
        start = [0.0, 0.0, third["takeoff_x"], third["takeoff_z"]]
        solved = basset.solve(
            lambda t, y: np.array([y[2], y[3], -rate * y[2], -gravity - rate * y[3]]),
            (0.0, third["duration"]),
            start,
            memory=[2, 3],
            coefficient=coefficient,
            initial_slip=[0.0, 0.0],
            method=basset.Collocation(rtol=1e-10),
        )
        assert solved.y[:, -1] == pytest.approx([third["length"], 0.0, third["impact_x"], third["impact_z"]], abs=1e-8)

    def test_a_restart_in_the_stream(self):
        """All effects: the rise of a later jump is that of a grain that starts with its velocity, spin and place."""
        sand = {"history": {"rebound": "restart", "horizon": 100.0}, "solver": {"rtol": 1e-8}}
        result = saltation.run(scene("sand", **sand, run={"jumps": 6, "discard": 0}))
        path, jumps = result.trajectory, result.jumps
        time = path["time"].to_numpy()
        for k in range(1, 6):
            here = path.isel(time=int(np.searchsorted(time, jumps["start"][k], side="right")) - 1)
            spin = [float(here[f"spin_{axis}"]) for axis in "xyz"]
            velocity = [float(jumps[f"takeoff_{axis}"][k]) for axis in "xyz"]
            fresh = scene("sand", **sand, velocity=velocity, spin=spin, height=float(here["z"]), run={"jumps": 1, "discard": 0, "seed": 7})
            assert saltation.run(fresh).jumps["height"][0] == pytest.approx(jumps["height"][k], rel=1e-7)


class TestWindowOfJumps:
    """history.window_jumps: what came before so many impacts is forgotten."""

    def bounces(self, window, impacts=6):
        return flown(scene("bouncing", history={"window_jumps": window}, run={"jumps": impacts}, height=5.5))

    def test_more_than_there_are_changes_nothing(self):
        unlimited = self.bounces(None).all_jumps
        for window in (6, 7, 50):
            assert self.bounces(window).all_jumps.equals(unlimited)
        assert self.bounces(5).all_jumps.iloc[:5].equals(unlimited.iloc[:5])
        assert not self.bounces(1).all_jumps.iloc[2:].equals(unlimited.iloc[2:])

    def test_one_jump(self):
        """From the second impact on the fall before the first is gone: the unlimited motion and c ∫R(t − σ)Q(σ)dσ, Q what the fall left behind."""
        made = scene("bouncing", history={"window_jumps": 1}, run={"jumps": 3}, height=5.5)
        rate, coefficient, gravity = linear(made)
        jumps = flown(made).jumps
        exact, bouncer = exact_bounces(made, "impulse", 3)
        first, second = bouncer.times[0], bouncer.times[1]
        np.testing.assert_allclose(jumps["duration"][:2], exact[:2, 0], atol=1e-9)

        def left(t):  # ∫_0^{t_1} K(t − τ) w'(τ) dτ, w' = −g R in the fall
            return np.array(
                [gauss(lambda s, at=at: -gravity * reference.response(s, rate, coefficient) / np.sqrt(at - s), 0.0, first) for at in np.atleast_1d(t)]
            )

        def gained(t, integrals):  # R or ∫R over what was forgotten, from the second impact on
            return coefficient * gauss(lambda lag: reference.response(lag, rate, coefficient, integrals) * left(t - lag), 0.0, t - second, 30)

        end = second + float(jumps["duration"][2])
        bouncer.times.pop(), bouncer.jumps.pop(), bouncer.after.pop()
        height = bouncer.after_last(end - second, 2) + gained(end, 1)
        velocity = bouncer.after_last(end - second, 1) + gained(end, 0)
        assert height == pytest.approx(0.0, abs=1e-9)
        assert velocity == pytest.approx(jumps["impact_z"][2], abs=1e-8)
        assert abs(gained(end, 1)) > 1e-3  # forgetting is seen


class TestAgainstTheSolverOfBasset:
    """The same equations with another integrator: full Jacobian, events, its own tables."""

    def equations(self, engine):
        """The rates of a scene in two dimensions, from its effects, without the flight."""

        def rates(t, y):
            out = np.zeros(len(y))
            equations.rates_of(engine.equation, t, y, out, np.array([0.0, 0.0, 0.0, equations.layer_of(engine.model, y[1], y[3])]))
            return out

        return rates

    @pytest.mark.parametrize("history", [True, False])
    def test_all_effects_through_three_impacts(self, history):
        """A flat bed: every impact by the event of `basset.solve`, contact by the law's own function."""
        effects = ["weight", "drag", "added_mass", "lift", "magnus", "rotation"] + ["history"] * history
        made = scene("sand", effects=effects, history=None, dimensions=2, bed={"roughness": "flat"}, run={"jumps": 4, "discard": 0}, solver={"rtol": 1e-9})
        jumps = flown(made).jumps
        engine = Engine(made)
        profile, strike = engine.profile, engine.rebound.strike

        def bed(t, y):
            return y[1] - 0.5

        def rebound(t, y):
            stream = profile.velocity_and_shear(y[1])[0]
            after = strike((0.0, 0.0, 1.0), (y[2] + stream, 0.0, y[3]), (0.0, y[4], 0.0))
            return np.array([y[0], y[1], after[0] - stream, after[2], after[4]])

        bed.direction, bed.jump = -1.0, rebound
        stream = profile.velocity_and_shear(0.5)[0]
        end = float(jumps["start"][3] + jumps["duration"][3]) + 1e-6
        solved = basset.solve(
            self.equations(engine),
            (0.0, end),
            [0.0, 0.5, 2.0 - stream, 2.0, 2.0],
            memory=[2, 3] if history else [],
            coefficient=made.numbers.history,
            method=basset.Collocation(rtol=1e-8),
            events=bed,
        )
        times, states = solved.t_events[0], solved.y_events[0]
        assert len(times) == 4
        assert np.abs(times - (jumps["start"] + jumps["duration"])).max() < 1e-6
        assert np.abs(states[:, 0] - jumps["length"].cumsum()).max() < 1e-5
        assert np.abs(states[:, 3] - jumps["impact_z"]).max() < 1e-6


class TestWhatIsNotNamed:
    """What a scene does not name is not there."""

    @pytest.mark.parametrize(("dimensions", "rotation", "states"), [(2, False, 4), (3, False, 6), (2, True, 5), (3, True, 9)])
    def test_states(self, dimensions, rotation, states):
        effects = ["weight", "drag"] + ["rotation"] * rotation
        engine = Engine(scene("sand", effects=effects, history=None, dimensions=dimensions))
        grain = Grain(engine)
        assert engine.states == states == len(grain.state.y)
        assert engine.force_names == ("weight", "drag") and len(engine.equation.forces) == 2
        assert (engine.equation.across is None) == (dimensions == 2)
        assert (engine.equation.turning is None) == (not rotation)

    def test_no_memory_without_history(self):
        effects = ["weight", "drag", "added_mass"]
        engine = Engine(scene("bouncing", effects=effects))
        grain = Grain(engine)
        assert engine.members == 0 and len(engine.rates) == 0 and engine.tables.tail is None and math.isinf(engine.horizon)
        assert grain.state.past.size == 0 and grain.state.jump.size == 0 and len(engine.problem.where) == 0
        assert engine.tables.tables.moments.size == 0

    @pytest.mark.parametrize("dimensions", [2, 3])
    def test_memory_with_history(self, dimensions):
        engine = Engine(scene("bouncing", dimensions=dimensions))
        grain = Grain(engine)
        assert engine.members == dimensions
        assert grain.state.past.shape == (dimensions, len(engine.rates)) and len(engine.rates) > 10
        assert list(engine.problem.where) == list(range(dimensions, 2 * dimensions))
        assert engine.problem.strength == pytest.approx(engine.numbers.history)
        assert grain.memory.before.size == 0 and grain.memory.when.size == 0

    def test_added_mass_by_name_alone(self):
        """Without it α = 1/(ρ_s/ρ); Auton's form adds to α and no force."""
        none = Engine(scene("bouncing", effects=["weight"]))
        thesis = Engine(scene("bouncing", effects=["weight", "added_mass"]))
        auton = Engine(scene("bouncing", effects=["weight", "added_mass"], added_mass={"form": "auton"}))
        assert none.equation.alpha == pytest.approx(1.0 / 2.65) and thesis.equation.alpha == auton.equation.alpha == pytest.approx(1.0 / 3.15)
        assert none.force_names == auton.force_names == ("weight",) and thesis.force_names == ("weight", "added_mass")

    def test_the_spin_keeps_in_flight_without_rotation(self):
        """Contacts alone change it: 5 n × … of the impulse; flights none."""
        made = scene("sand", effects=["weight", "drag", "magnus"], history=None, dimensions=2, run={"jumps": 5, "discard": 0})
        result = flown(made)
        path, jumps = result.trajectory, result.jumps
        assert jumps["spin"].nunique() == 5 and jumps["spin"][0] == 2.0
        for start, duration, spin in zip(jumps["start"], jumps["duration"], jumps["spin"], strict=True):
            inside = (path["time"] > start) & (path["time"] < start + 0.999 * duration)
            np.testing.assert_allclose(path["spin_y"][inside], spin, rtol=1e-14)

    def test_a_prescribed_spin_is_one_number(self):
        made = scene("sand", rotation={"law": "prescribed"}, dimensions=2, run={"jumps": 3, "discard": 0})
        result = flown(made)
        assert Engine(made).states == 4
        np.testing.assert_allclose(result.jumps["spin"], 5.11 - 1.13 * 1.87, rtol=1e-14)
        np.testing.assert_allclose(result.trajectory["spin_y"], 5.11 - 1.13 * 1.87, rtol=1e-14)


class TestTwoExecutions:
    """One source, compiled and interpreted."""

    @pytest.mark.parametrize("name", ["sand", "gravel"])
    def test_the_same_jumps(self, name):
        made = scene(name, run={"jumps": 2, "discard": 0}, history={"horizon": 100.0})
        with interpreted():
            plain = saltation.run(made)
        np.testing.assert_allclose(plain.jumps, saltation.run(made).jumps, rtol=1e-11, atol=1e-12)

    def test_nothing_stays_replaced(self):
        before = stepper.march
        with interpreted():
            assert stepper.march is not before
        assert stepper.march is before


@pytest.fixture(scope="module")
def sand():
    return saltation.run(scene("sand", run={"jumps": 60, "discard": 0}, solver={"rtol": 1e-7}))


class TestImpacts:
    """An impact is on the contact plane, on the way down, and nothing is lost where a step is cut."""

    def test_the_centre_lies_on_the_contact(self, sand):
        """z = cos θ_b cos α_b − ¼; α_b from the impulse: J·n = −(1+e) v·n and the friction is along the tangent, so only the range is sure."""
        path, jumps = sand.trajectory, sand.jumps
        ends = np.searchsorted(path["time"], jumps["start"].to_numpy()[1:], side="left")
        z, tilt = path["z"].to_numpy()[ends], np.radians(jumps["tilt"].to_numpy()[:-1])
        assert np.all(z <= np.cos(tilt) - 0.25 + 1e-9)
        assert np.all(z >= np.cos(tilt) * np.cos(np.pi / 6.0) - 0.25 - 1e-9)
        assert np.all(jumps["impact_z"] < 0.0) and np.all(jumps["takeoff_z"][1:] > 0.0)

    def test_in_the_plane_the_height_is_exact(self):
        made = scene("sand", dimensions=2, run={"jumps": 6, "discard": 0})
        result = flown(made)
        path, jumps = result.trajectory, result.jumps
        ends = np.searchsorted(path["time"], jumps["start"].to_numpy()[1:], side="left")
        np.testing.assert_allclose(path["z"].to_numpy()[ends], np.cos(np.radians(jumps["tilt"].to_numpy()[:-1])) - 0.25, atol=1e-12)

    def test_the_normal_speed_and_the_impulse(self, sand):
        """St is that of the normal speed at impact, which the impulse reverses by 1 + e."""
        jumps = sand.jumps
        single = jumps["contacts"] == 1.0
        speed = jumps["stokes"] / sand.scene.numbers.stokes(1.0)
        impulse = np.sqrt((jumps[["impulse_x", "impulse_y", "impulse_z"]] ** 2).sum(axis=1))
        ratio = (impulse / (1.65 * speed))[single]
        assert np.all(ratio > 1.0 - 1e-9) and np.all(ratio < np.sqrt(1.0 + 0.1**2) + 1e-9)  # friction 0.1 adds at most that

    @pytest.mark.parametrize("mass", ["dry", "immersed"])
    def test_the_impulse_is_the_change_of_momentum(self, mass):
        """Of the dry mass, or with C_m of the fluid's."""
        jumps = saltation.run(scene("sand", run={"jumps": 40, "discard": 0}, bed={"contact_mass": mass})).jumps
        effective = 1.0 if mass == "dry" else 1.0 + 0.5 / 2.65
        for axis in "xyz":
            change = jumps[f"takeoff_{axis}"].to_numpy()[1:] - jumps[f"impact_{axis}"].to_numpy()[:-1]
            np.testing.assert_allclose(effective * change, jumps[f"impulse_{axis}"].to_numpy()[:-1], atol=1e-12)

    @pytest.mark.parametrize("first", [0.1, 1e-3])
    def test_where_the_step_is_cut_does_not_matter(self, first, monkeypatch):
        """Another first step, another cut: the same jumps within the tolerance."""
        made = scene("bouncing", run={"jumps": 5})
        usual = flown(made).jumps["duration"]
        monkeypatch.setattr("saltation.flight.setup.DEFAULT_FIRST", first)
        other = flown(made).jumps["duration"]
        assert not other.equals(usual)
        assert np.abs(other - usual).max() < 1e-8

    def test_a_start_below_the_crests_goes_on(self):
        """A grain that starts at a contact's height upwards takes off, downwards it strikes at once."""
        for upwards, first in ((1.0, None), (-1.0, 0.0)):
            made = scene("bouncing", effects=["weight"], velocity=[0.0, 0.0, upwards], height=0.5, run={"jumps": 2})
            duration = flown(made).all_jumps["duration"][0]
            assert duration > 1.0 if first is None else duration < 1e-12

    def test_the_table_of_the_stream_is_the_scenes(self):
        made = scene("sand")
        assert Engine(made).profile is tabulated(made.profile)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("effects", [["magnus", "rotation"], []], ids=str)
def test_stiff_drag_takes_no_more_steps_with_spins_among_the_states(dimensions, effects):
    """Where the slips lie among the four, five, six or nine states does not depend on what else is a state, nor on whether there is a history."""
    made = scene(
        "sand",
        dimensions=dimensions,
        effects=["weight", "drag", "added_mass", "lift", *effects],
        channel={"shear_velocity": 0.05, "transport_stage": None},
        grain={"diameter": 1e-5},
        fluid={"viscosity": 2e-4},
        run={"jumps": 1, "discard": 0, "longest_flight": 30.0},
        history=None,
        magnus=None if "magnus" not in effects else {},
    )
    engine = Engine(made)
    grain = Grain(engine)
    grain.fly(empty_record(1, engine.tables.count, engine.states), False, np.zeros((1, len(layout.COLUMNS))))
    assert 10 < grain.state.control[0].steps < 500  # 150 000 with a wrong diagonal
