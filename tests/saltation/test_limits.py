"""Flights whose motion is known exactly: settling, bouncing, parabolas, circles, decay; and what no flight may do to its energy."""

from __future__ import annotations

import numpy as np
import pytest
from scene_cases import flown, linear, scene

from basset import reference

pytestmark = pytest.mark.analytic

WEIGHT = {"effects": ["weight"], "drag": None, "added_mass": None, "history": None}


def largest(values, exact):
    """The largest error in the scene's units, or relative where what is exact exceeds one of them."""
    exact = np.asarray(exact)
    return np.abs(np.asarray(values) - exact).max() / max(1.0, np.abs(exact).max())


class TestSettling:
    """w' = −g − λw − c·H[w] from rest, against Laplace transforms."""

    @pytest.mark.parametrize("viscosity", [1e-4, 1e-6])
    @pytest.mark.parametrize("density", [7800.0, 2650.0, 1010.0, 990.0, 625.0, 100.0])
    def test_velocity_and_height_along_the_whole_path(self, density, viscosity):
        made = scene("settling", grain={"density": density}, fluid={"viscosity": viscosity}, solver={"rtol": 1e-10 if density < 2650.0 else 1e-9})
        result = flown(made)
        rate, coefficient, gravity = linear(made)
        path = result.trajectory
        t = path["time"].to_numpy()
        assert result.status == "finished" and t[0] == 0.0
        assert t[-1] == pytest.approx(0.1 / made.numbers.time, rel=1e-14)
        velocity, height = reference.settling(t, rate, coefficient, gravity), reference.settling_height(t, rate, coefficient, gravity)
        assert np.sign(velocity[-1]) == (-1.0 if density > 1000.0 else 1.0)
        assert largest(path["w"], velocity) < 1e-8
        assert largest(path["z"] - path["z"][0], height) < 1e-8
        assert not path["x"].any() and not path["u"].any()

    def test_the_roots_coincide_at_five_eighths_and_nothing_happens(self):
        """λ = πc²/4 there, where the formula with two roots is 0/0."""
        rate, coefficient, _ = linear(scene("settling", grain={"density": 625.0}))
        assert rate == pytest.approx(np.pi * coefficient**2 / 4.0, rel=1e-14)

    def test_the_forces_on_the_way(self):
        """Weight −g, drag −λw, history −c·H = g(1 − R) + λw: each alone, not their sum."""
        made = scene("settling")
        path = flown(made).trajectory
        rate, coefficient, gravity = linear(made)
        t = path["time"].to_numpy()[1:]
        velocity = reference.settling(t, rate, coefficient, gravity)
        history = gravity * (1.0 - reference.response(t, rate, coefficient)) + rate * velocity
        assert largest(path["weight_z"], np.full(path.sizes["time"], -gravity)) < 1e-14
        assert largest(path["drag_z"][1:], -rate * velocity) < 1e-8
        assert largest(path["history_z"][1:], history) < 1e-7 and history.max() > 0.1
        assert not path["weight_x"].any() and not path["history_x"][1:].any()

    def test_a_slip_along_the_way_decays_beside(self):
        """Linear: the two directions do not know of each other, and the initial slip is remembered."""
        made = scene("settling", velocity=[0.7, 0.0, 0.3])
        path = flown(made).trajectory
        rate, coefficient, gravity = linear(made)
        t = path["time"].to_numpy()
        assert largest(path["u"], reference.relaxing(t, rate, coefficient, 0.7)) < 1e-8
        assert largest(path["x"], 0.7 * reference.response(t, rate, coefficient, 1)) < 1e-8
        assert largest(path["w"], reference.relaxing(t, rate, coefficient, 0.3) + reference.settling(t, rate, coefficient, gravity)) < 1e-8

    @pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
    def test_a_coarser_tolerance_is_kept_as_well(self, rtol):
        made = scene("settling", solver={"rtol": rtol})
        path = flown(made).trajectory
        rate, coefficient, gravity = linear(made)
        t = path["time"].to_numpy()
        assert largest(path["w"], reference.settling(t, rate, coefficient, gravity)) < rtol
        assert largest(path["z"] - path["z"][0], reference.settling_height(t, rate, coefficient, gravity)) < rtol


class TestBouncing:
    """Every jump of the velocity is remembered: sums of responses, exact through every impact."""

    @pytest.mark.parametrize(
        ("density", "viscosity", "restitution", "impacts"), [(2650.0, 1e-5, 0.8, 5), (2650.0, 1e-6, 0.9, 9), (7800.0, 1e-5, 0.95, 9), (1500.0, 1e-6, 0.6, 5)]
    )
    def test_times_heights_and_the_whole_path(self, density, viscosity, restitution, impacts):
        made = scene(
            "bouncing", grain={"density": density}, fluid={"viscosity": viscosity}, bed={"restitution": restitution}, run={"jumps": impacts}, height=5.5
        )
        result = flown(made)
        exact = reference.bouncing(*linear(made), height=5.0, restitution=restitution, impacts=impacts)
        jumps, path = result.jumps, result.trajectory
        assert result.status == "finished" and len(jumps) == impacts
        assert np.abs(jumps["start"] + jumps["duration"] - exact.times).max() < 1e-8
        assert np.abs(jumps["duration"] - np.diff(exact.times, prepend=0.0)).max() < 1e-8
        assert np.abs((1.0 + restitution) * jumps["impact_z"] + exact.jumps).max() < 1e-8
        assert np.abs(jumps["impulse_z"] - exact.jumps).max() < 1e-8
        t = path["time"].to_numpy()
        assert np.abs(path["z"] - 0.5 - exact.height(t)).max() < 1e-8
        first = np.append(True, np.diff(t) > 0.0)  # at an impact the exact velocity is that after it
        inner = first & ~np.append(np.diff(t) == 0.0, True)
        assert np.abs(path["w"].to_numpy()[inner] - exact.velocity(t[inner])).max() < 1e-8
        for k, row in jumps.iloc[1:].iterrows():
            fine = exact.times[k - 1] + (exact.times[k] - exact.times[k - 1]) * np.linspace(0.0, 1.0, 4001)
            assert row["height"] == pytest.approx(exact.height(fine).max(), rel=1e-6)

    def test_a_smooth_plane_takes_nothing_along(self):
        """Without friction the motion along is a slip that decays through all impacts."""
        made = scene("bouncing", velocity=[1.5, 0.0, 0.0])
        result = flown(made)
        rate, coefficient, _ = linear(made)
        path = result.trajectory
        t = path["time"].to_numpy()
        assert largest(path["x"], 1.5 * reference.response(t, rate, coefficient, 1)) < 1e-8
        assert largest(path["u"], reference.relaxing(t, rate, coefficient, 1.5)) < 1e-8

    def test_it_comes_to_rest(self):
        """Ever shorter jumps: all there are, as exact as the first, and then the grain lies still."""
        made = scene("bouncing", bed={"restitution": 0.5}, run={"jumps": 10000})
        result = flown(made)
        exact = reference.bouncing(*linear(made), height=5.0, restitution=0.5, impacts=45)
        jumps = result.all_jumps
        assert result.status == "at rest" and "lies still" in result.message
        count = min(len(exact.times), 12)
        ends = (jumps["start"] + jumps["duration"]).to_numpy()
        assert np.abs(ends[:count] - exact.times[:count]).max() < 1e-8
        assert ends[-1] == pytest.approx(exact.end, abs=1e-6)  # the last jumps are lower than the height's rounding
        assert np.all(np.diff(ends) >= 0.0) and result.trajectory["z"].min() >= 0.5 - 1e-9


class TestParabola:
    """Weight alone: every flight a parabola, every bounce the same shrunk, to rounding."""

    E, G = 0.8, 1.0 / 2.65  # without added mass α/τ* = ρ/ρ_s in units of R g

    def bounces(self, count, w, height):
        """(duration, rise above the start, impact speed) of flights that start upwards with w, the first from `height` above contact."""
        result = []
        for _ in range(count):
            down = np.sqrt(w * w + 2.0 * self.G * height)
            result.append(((w + down) / self.G, max(w, 0.0) ** 2 / (2.0 * self.G), down))
            w, height = self.E * down, 0.0
        return np.array(result)

    @pytest.mark.parametrize("dimensions", [2, 3])
    @pytest.mark.parametrize("upwards", [0.9, -0.4])
    def test_over_a_bed(self, dimensions, upwards):
        across = 0.3 if dimensions == 3 else 0.0
        made = scene("bouncing", **WEIGHT, dimensions=dimensions, velocity=[1.25, across, upwards], height=3.5, run={"jumps": 12}, solver={"rtol": 1e-6})
        result = flown(made)
        jumps, path = result.jumps, result.trajectory
        duration, rise, down = self.bounces(12, upwards, 3.0).T
        np.testing.assert_allclose(jumps["duration"], duration, rtol=1e-12)
        np.testing.assert_allclose(jumps["height"], rise, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(jumps["length"], 1.25 * duration, rtol=1e-12)
        np.testing.assert_allclose(jumps["drift"], across * duration, rtol=1e-12)
        np.testing.assert_allclose(jumps["impact_z"], -down, rtol=1e-12)
        np.testing.assert_allclose(jumps["takeoff_z"][1:], self.E * down[:-1], rtol=1e-12)
        np.testing.assert_allclose(jumps["velocity"], 1.25, rtol=1e-12)
        np.testing.assert_allclose(jumps["incidence_angle"], np.degrees(np.arctan(down / 1.25)), rtol=1e-12)
        np.testing.assert_allclose(jumps["deviation_angle"], np.degrees(np.arctan(across / 1.25)), rtol=1e-12, atol=1e-12)
        assert largest(path["x"], 1.25 * path["time"]) < 1e-12
        assert ("y" in path) == (dimensions == 3)

    @pytest.mark.parametrize("dimensions", [2, 3])
    def test_without_a_bed(self, dimensions):
        across = -0.7 if dimensions == 3 else 0.0
        made = scene("settling", **WEIGHT, dimensions=dimensions, velocity=[0.4, across, 2.0], solver={"rtol": 1e-6}, run={"duration": 0.2})
        path = flown(made).trajectory
        t = path["time"].to_numpy()
        assert t[-1] == pytest.approx(0.2 / made.numbers.time, rel=1e-14)
        assert largest(path["z"], 0.75 + 2.0 * t - 0.5 * self.G * t**2) < 1e-12
        assert largest(path["w"], 2.0 - self.G * t) < 1e-12
        assert largest(path["x"], 0.4 * t) < 1e-12
        if dimensions == 3:
            assert largest(path["y"], across * t) < 1e-12

    def test_down_a_slope(self):
        """The weight turns with the bed; the stream does nothing to a grain that only weighs."""
        made = scene(
            "bouncing",
            **WEIGHT,
            channel={"shear_velocity": 0.05, "slope": 0.1},
            run={"jumps": 6},
            velocity=[0.5, 0.0, 1.0],
            height=0.5 + 1e-9,
            solver={"rtol": 1e-10},
        )
        n = made.numbers
        along, normal = np.sin(np.arctan(0.1)) / n.density_ratio / n.shields, np.cos(np.arctan(0.1)) / n.density_ratio / n.shields
        jumps = flown(made).jumps
        w = self.E ** np.arange(6.0)
        np.testing.assert_allclose(jumps["duration"], 2.0 * w / normal, rtol=1e-8)
        np.testing.assert_allclose(jumps["height"], w**2 / (2.0 * normal), rtol=1e-8)
        start = jumps["start"].to_numpy()
        np.testing.assert_allclose(jumps["takeoff_x"], 0.5 + along * start, rtol=1e-9)
        np.testing.assert_allclose(jumps["length"], jumps["duration"] * (0.5 + along * (start + 0.5 * jumps["duration"])), rtol=1e-9)

    def test_friction_at_every_impact(self):
        """Sliding until the contact rolls: û = u − f(1+e)|w| ε, ω̂_y = ω_y + 5 f(1+e)|w| ε; then nothing more."""
        friction = 0.2
        made = scene("bouncing", **WEIGHT, velocity=[2.0, 0.0, 1.0], spin=[0.0, -1.0, 0.0], height=0.5 + 1e-12, bed={"friction": friction}, run={"jumps": 14})
        jumps = flown(made).jumps
        u, spin, w, slid = 2.0, -1.0, 1.0, []
        for _, row in jumps.iterrows():
            assert row["takeoff_x"] == pytest.approx(u, abs=1e-9) and row["spin"] == pytest.approx(spin, abs=1e-9)
            assert row["takeoff_z"] == pytest.approx(w, abs=1e-9)
            slip, push = u - 0.5 * spin, friction * (1.0 + self.E) * w
            slid.append(push < 2.0 / 7.0 * abs(slip))
            loss = np.sign(slip) * min(push, 2.0 / 7.0 * abs(slip))
            u, spin, w = u - loss, spin + 5.0 * loss, self.E * w
        assert slid[0] and not slid[-1] and u == pytest.approx(0.5 * spin)

    def test_it_comes_to_rest_at_the_sum_of_a_geometric_series(self):
        made = scene("bouncing", **WEIGHT, bed={"restitution": 0.5}, run={"jumps": 10000}, height=5.5)
        result = flown(made)
        fall = np.sqrt(10.0 / self.G)
        last = result.all_jumps.iloc[-1]
        assert result.status == "at rest"
        assert last["start"] + last["duration"] == pytest.approx(3.0 * fall, abs=2e-6)
        assert last["height"] < 1e-12 and len(result.all_jumps) > 60
        np.testing.assert_allclose(result.all_jumps["duration"][1:12], 2.0 * fall * 0.5 ** np.arange(1, 12), rtol=1e-9)

    def test_without_restitution_it_rests_at_once(self):
        made = scene("bouncing", **WEIGHT, bed={"restitution": 0.0}, run={"jumps": 10})
        result = flown(made)
        assert result.status == "at rest" and len(result.all_jumps) == 1
        assert result.all_jumps["duration"][0] == pytest.approx(np.sqrt(10.0 / self.G), rel=1e-11)


class TestStokesDrag:
    """Weight and Stokes drag without history: exponentials."""

    @pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
    @pytest.mark.parametrize("density", [2650.0, 100.0])
    def test_the_closed_form(self, rtol, density):
        made = scene(
            "settling", effects=["weight", "drag", "added_mass"], dimensions=3, grain={"density": density}, velocity=[1.0, -0.5, 2.0], solver={"rtol": rtol}
        )
        path = flown(made).trajectory
        rate, coefficient, gravity = linear(made)
        t = path["time"].to_numpy()
        fade = np.exp(-rate * t)
        assert coefficient == 0.0
        for velocity, place, start in (("u", "x", 1.0), ("v", "y", -0.5)):
            assert largest(path[velocity], start * fade) < rtol
            assert largest(path[place], start * (1.0 - fade) / rate) < rtol
        assert largest(path["w"], 2.0 * fade - gravity / rate * (1.0 - fade)) < rtol
        assert largest(path["z"] - path["z"][0], (2.0 + gravity / rate) * (1.0 - fade) / rate - gravity / rate * t) < rtol

    def test_bounces(self):
        """Times from Lambert's function would do; a root of the exponential form does."""
        made = scene("bouncing", effects=["weight", "drag", "added_mass"], run={"jumps": 6})
        jumps = flown(made).jumps
        rate, coefficient, gravity = linear(made)
        exact = reference.bouncing(rate, 0.0, gravity, height=5.0, restitution=0.8, impacts=6)
        assert coefficient == 0.0
        assert np.abs(jumps["start"] + jumps["duration"] - exact.times).max() < 1e-8
        assert np.abs(jumps["impulse_z"] - exact.jumps).max() < 1e-8

    @pytest.mark.parametrize("law", ["yen", "schiller_naumann", "rubey", "engelund_hansen", "turton_levenspiel"])
    def test_at_last_drag_carries_the_weight(self, law):
        """The terminal velocity of every law, from the law of its C_D alone."""
        made = scene("settling", effects=["weight", "drag", "added_mass"], drag={"law": law}, fluid={"viscosity": 1e-6}, run={"duration": 1.0})
        path = flown(made).trajectory
        n = made.numbers
        speed = -float(path["w"][-1])
        number = speed * n.reynolds
        drag = {
            "yen": 24.0 / number * (1.0 + 0.15 * number**0.5 + 0.017 * number) - 0.208 / (1.0 + 1e4 / number**0.5),
            "schiller_naumann": 24.0 / number * (1.0 + 0.15 * number**0.687),
            "rubey": 24.0 / number + 2.0,
            "engelund_hansen": 24.0 / number + 1.5,
            "turton_levenspiel": 24.0 / number * (1.0 + 0.173 * number**0.657) + 0.413 / (1.0 + 16300.0 * number**-1.09),
        }[law]
        assert 0.75 * drag * speed**2 == pytest.approx(1.0, rel=1e-8)


class TestTurning:
    """Spin and Magnus force in still water."""

    def test_the_velocity_circles_about_the_spin(self):
        """w' = ¾α ω × w: Rodrigues's rotation; spin without torque stays."""
        spin, velocity = np.array([0.3, -1.1, 0.7]), np.array([1.0, 0.2, -0.5])
        made = scene("settling", **(WEIGHT | {"effects": ["magnus"]}), magnus={"form": "vector"}, dimensions=3, velocity=list(velocity), spin=list(spin))
        path = flown(made).trajectory
        t = path["time"].to_numpy()
        turn = 0.75 * made.numbers.alpha * spin
        angle, axis = np.linalg.norm(turn) * t[:, None], turn / np.linalg.norm(turn)
        exact = velocity * np.cos(angle) + np.cross(axis, velocity) * np.sin(angle) + axis * (axis @ velocity) * (1.0 - np.cos(angle))
        found = np.column_stack([path[name] for name in "uvw"])
        assert angle[-1] > np.pi / 2.0
        assert largest(found, exact) < 1e-8

    def test_weight_and_magnus_make_a_cycloid(self):
        """As a charge in crossed fields: the mean drift is g/Ω across the weight."""
        made = scene("settling", **(WEIGHT | {"effects": ["weight", "magnus"]}), magnus={"form": "vector"}, spin=[0.0, 8.0, 0.0], run={"duration": 0.05})
        path = flown(made).trajectory
        t, turn, gravity = path["time"].to_numpy(), 0.75 * made.numbers.alpha * 8.0, made.numbers.alpha / made.numbers.shields
        drift = -gravity / turn  # u' = Ω w, w' = −g − Ω u
        assert turn * t[-1] > 2.0 * np.pi
        assert largest(path["u"], drift * (1.0 - np.cos(turn * t))) < 1e-8
        assert largest(path["w"], drift * np.sin(turn * t)) < 1e-8
        assert largest(path["x"], drift * (t - np.sin(turn * t) / turn)) < 1e-8

    def test_the_vertical_form_lifts_only(self):
        made = scene("settling", **(WEIGHT | {"effects": ["magnus"]}), velocity=[2.0, 0.0, 0.0], spin=[0.0, -3.0, 0.0])
        path = flown(made).trajectory
        t = path["time"].to_numpy()
        assert largest(path["u"], np.full(len(t), 2.0)) < 1e-14
        assert largest(path["w"], 0.75 * made.numbers.alpha * 6.0 * t) < 1e-12  # backspin lifts

    @pytest.mark.parametrize("dimensions", [2, 3])
    def test_a_slow_spin_fades_exponentially(self, dimensions):
        """Re_r < ¾: C_t = 16π/Re_r, dω/dt = −60 ω/(Re* ρ_s/ρ)."""
        spin = np.array([0.0, 0.5, 0.0]) if dimensions == 2 else np.array([-0.3, 0.5, 0.2])
        made = scene("settling", **(WEIGHT | {"effects": ["weight", "rotation"]}), dimensions=dimensions, spin=list(spin))
        n = made.numbers
        path = flown(made).trajectory
        assert np.linalg.norm(spin) * n.reynolds / 4.0 < 0.75
        fade = np.exp(-60.0 / (n.reynolds * n.density_ratio) * path["time"].to_numpy())
        for k, axis in enumerate("xyz"):
            if f"spin_{axis}" in path:
                assert largest(path[f"spin_{axis}"], spin[k] * fade) < 1e-8
        assert (set("xyz") if dimensions == 3 else {"y"}) == {name[-1] for name in path.data_vars if name.startswith("spin")}


class TestEnergy:
    """½v² + ½Iω² + gz in still water: contacts and Stokes drag take, and so does the history over any time from the start."""

    @pytest.mark.parametrize("history", [True, False])
    @pytest.mark.parametrize("contact", [(0.95, 0.0), (0.8, 0.3), (1.0, 0.1)])
    def test_it_never_exceeds_that_at_the_start(self, history, contact):
        effects = ["weight", "drag", "added_mass", "history"] if history else ["weight", "drag", "added_mass"]
        made = scene(
            "bouncing",
            effects=effects,
            history={"rebound": "impulse"} if history else None,
            bed={"restitution": contact[0], "friction": contact[1]},
            fluid={"viscosity": 1e-6},
            run={"jumps": 12},
            velocity=[1.0, 0.0, 0.0],
            spin=[0.0, -4.0, 0.0],
            solver={"rtol": 1e-7},
        )
        result = flown(made)
        path, jumps = result.trajectory, result.jumps
        gravity = made.numbers.alpha / made.numbers.shields
        spin = path["spin_y"].to_numpy()
        moving = 0.5 * (path["u"] ** 2 + path["w"] ** 2).to_numpy()
        energy = moving + 0.05 * spin**2 + gravity * path["z"].to_numpy()
        assert energy[1:].max() < energy[0]
        if not history:
            times = path["time"].to_numpy()
            assert np.all(np.diff(energy)[np.diff(times) > 0.0] <= 1e-9)
        before = 0.5 * (jumps["impact_x"] ** 2 + jumps["impact_z"] ** 2) + 0.05 * jumps["spin"] ** 2
        after = 0.5 * (jumps["takeoff_x"] ** 2 + jumps["takeoff_z"] ** 2) + 0.05 * jumps["spin"] ** 2
        losses = before.to_numpy()[:-1] - after.to_numpy()[1:]
        assert np.all(losses >= -1e-12)
        if contact == (0.95, 0.0):
            np.testing.assert_allclose(losses, 0.5 * (1.0 - 0.95**2) * jumps["impact_z"].to_numpy()[:-1] ** 2, rtol=1e-9)
