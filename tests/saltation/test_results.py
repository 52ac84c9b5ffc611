"""What a run leaves: its path, the forces on it, momentum, what is derived from jumps, and files."""

from __future__ import annotations

import itertools
import json
import os
import stat

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scene_cases import flown, linear, scene
from scipy.interpolate import CubicSpline

import basset
import saltation
from basset import reference
from saltation.results.tables import UNITS

AXES = "xyz"
WITHOUT = ["weight", "drag", "added_mass", "lift", "magnus", "rotation"]


@pytest.fixture(scope="module")
def sand():
    """Sand with its history, finely."""
    return saltation.run(scene("sand", run={"jumps": 40, "discard": 5}, solver={"rtol": 1e-8}))


@pytest.fixture(scope="module")
def without():
    """Sand without history, finely."""
    return saltation.run(scene("sand", effects=WITHOUT, history=None, run={"jumps": 40, "discard": 5}, solver={"rtol": 1e-9}))


def flights(result):
    """Slices of the path, one per jump: from the point of takeoff to that of impact."""
    time = result.trajectory["time"].to_numpy()
    starts = np.append(0, np.flatnonzero(np.diff(time) == 0.0) + 1)
    ends = np.append(starts[1:], len(time))
    assert len(starts) == len(result.all_jumps)
    return [slice(int(low), int(high)) for low, high in zip(starts, ends, strict=True)]


def accelerations(path, axis):
    """The sum of all forces along an axis."""
    names = [str(name) for name in path.data_vars if str(name).endswith(f"_{axis}") and not str(name).startswith("spin")]
    assert f"weight_{axis}" in names
    return sum(path[name].to_numpy() for name in names)


class TestPath:
    def test_places_go_on_and_velocities_jump_at_an_impact(self, sand):
        path, jumps = sand.trajectory, sand.all_jumps
        pieces = flights(sand)
        for before, after in itertools.pairwise(pieces):
            here, there = path.isel(time=before.stop - 1), path.isel(time=after.start)
            for name in AXES:
                assert float(here[name]) == pytest.approx(float(there[name]), abs=1e-12)
            assert float(there["w"]) > 0.0 > float(here["w"])
        for k, piece in enumerate(pieces):
            first, last = path.isel(time=piece.start), path.isel(time=piece.stop - 1)
            for velocity, axis in zip("uvw", AXES, strict=True):
                assert float(first[velocity]) == pytest.approx(jumps[f"takeoff_{axis}"][k], abs=1e-12)
                assert float(last[velocity]) == pytest.approx(jumps[f"impact_{axis}"][k], abs=1e-12)
            assert float(first["time"]) == pytest.approx(jumps["start"][k], rel=1e-14)
            assert float(last["time"] - first["time"]) == pytest.approx(jumps["duration"][k], rel=1e-11)
            assert float(last["x"] - first["x"]) == pytest.approx(jumps["length"][k], abs=1e-11)
            assert float(last["y"] - first["y"]) == pytest.approx(jumps["drift"][k], abs=1e-11)
            assert 0.0 <= jumps["height"][k] - float(path["z"][piece].max() - first["z"]) < 0.02
            assert jumps["height_above_bed"][k] == pytest.approx(float(first["z"]) + jumps["height"][k], abs=1e-12)

    def test_velocities_are_the_rates_of_places(self, sand):
        """Also of the slip's frame: u = slip + stream."""
        path = sand.trajectory
        for piece in flights(sand)[:10]:
            time = path["time"].to_numpy()[piece]
            root = np.sqrt(time - time[0])
            for place, velocity in zip(AXES, "uvw", strict=True):
                gained = CubicSpline(root, 2.0 * root * path[velocity].to_numpy()[piece]).integrate(0.0, root[-1])
                assert gained == pytest.approx(float(path[place][piece][-1] - path[place][piece][0]), abs=2e-6)

    def test_time_never_goes_back(self, sand):
        steps = np.diff(sand.trajectory["time"])
        assert np.all(steps >= 0.0) and np.sum(steps == 0.0) == len(sand.all_jumps) - 1

    def test_the_mean_spin(self, sand):
        """The column `spin` is the mean of ω_y over the flight."""
        path = sand.trajectory
        for piece, spin in zip(flights(sand)[:10], sand.all_jumps["spin"], strict=False):
            time = path["time"].to_numpy()[piece]
            mean = CubicSpline(time, path["spin_y"].to_numpy()[piece]).integrate(time[0], time[-1]) / (time[-1] - time[0])
            assert mean == pytest.approx(spin, abs=1e-6)

    def test_every_variable_has_its_unit(self, sand):
        path = sand.trajectory
        assert all(path[name].attrs["units"] and path[name].attrs["long_name"] for name in [*path.data_vars, "time"])
        assert path.attrs == {"diameter": 0.69e-3, "velocity": sand.scene.numbers.velocity}
        assert set(sand.jumps) == set(UNITS)

    def test_a_spin_that_nothing_changes_is_on_the_path(self):
        """Without a bed and without rotation it is that of the start, and so is the Magnus force."""
        made = scene("settling", effects=["weight", "magnus"], drag=None, added_mass=None, history=None, spin=[0.0, 8.0, 0.0], velocity=[1.0, 0.0, 0.0])
        path = flown(made).trajectory
        assert np.all(path["spin_y"] == 8.0)
        np.testing.assert_allclose(path["magnus_z"], -0.75 * made.numbers.alpha * 8.0 * path["u"], rtol=1e-12)


class TestForces:
    def test_without_history_they_are_the_acceleration(self, without):
        """Differences of the velocity over smooth stretches against the sum of the effects' own formulas."""
        path = without.trajectory
        for piece in flights(without)[:15]:
            time = path["time"].to_numpy()[piece]
            for velocity, axis in zip("uvw", AXES, strict=True):
                slope = CubicSpline(time, path[velocity].to_numpy()[piece]).derivative()(time)
                force = accelerations(path, axis)[piece]
                inner = slice(3, -3)
                assert np.abs(slope - force)[inner].max() < 1e-4 * np.abs(force).max() + 1e-5

    def test_no_history_force_without_history(self, without):
        assert not [name for name in without.trajectory.data_vars if str(name).startswith("history")]
        assert not np.isnan(accelerations(without.trajectory, "z")).any()

    def test_the_history_force_is_infinite_at_takeoff_alone(self, sand):
        missing = np.flatnonzero(np.isnan(sand.trajectory["history_z"]))
        assert list(missing) == [piece.start for piece in flights(sand)]

    def test_the_history_force_through_impacts(self):
        """w' + g + λw of the exact motion, its jumps remembered."""
        made = scene("bouncing", height=5.5)
        result = flown(made)
        path = result.trajectory
        rate, coefficient, gravity = linear(made)
        exact = reference.bouncing(rate, coefficient, gravity, height=5.0, restitution=0.8, impacts=5)
        for k, piece in enumerate(flights(result)):
            time, force = path["time"].to_numpy()[piece], path["history_z"].to_numpy()[piece]
            since = time - (exact.times[k - 1] if k else 0.0)
            far = (since > 0.02 * since[-1]) & (since < 0.99 * since[-1])
            step = 1e-4 * since[far]
            slope = (exact.velocity(time[far] + step) - exact.velocity(time[far] - step)) / (2.0 * step)
            history = slope + gravity + rate * exact.velocity(time[far])
            np.testing.assert_allclose(force[far], history, atol=2e-6 * np.abs(history).max())

    def test_the_history_force_by_quadrature(self, sand):
        """−c·H of the slip of the first flight, sampled finely, by a rule of `basset`."""
        path, piece = sand.trajectory, flights(sand)[0]
        made = sand.scene
        time, z = path["time"].to_numpy()[piece], path["z"].to_numpy()[piece]
        stream = np.array([made.profile.velocity_and_shear(height)[0] for height in z])
        slips = np.stack([path["u"].to_numpy()[piece] - stream, path["v"].to_numpy()[piece], path["w"].to_numpy()[piece]], axis=1)
        even = np.linspace(0.0, time[-1], 8001)
        samples = CubicSpline(np.sqrt(time), slips)(np.sqrt(even))
        history = basset.integrate(samples, even[1], basset.Daitche(order=3), input="slip")
        found = np.array([float(path[f"history_{axis}"][piece][-1]) for axis in AXES])
        assert np.abs(found + made.numbers.history * history).max() < 1e-3 * np.abs(found).max()
        assert np.abs(found).max() > 0.1

    def test_each_effect_by_its_formula(self, without):
        """Drag against the slip, weight constant: not only their sum."""
        path, n = without.trajectory, without.scene.numbers
        np.testing.assert_allclose(path["weight_z"], -n.alpha / n.shields, rtol=1e-14)
        stream = np.array([without.scene.profile.velocity_and_shear(z)[0] for z in path["z"].to_numpy()])
        slip = np.stack([path["u"].to_numpy() - stream, path["v"].to_numpy(), path["w"].to_numpy()], axis=1)
        drag = np.stack([path[f"drag_{axis}"] for axis in AXES], axis=1)
        power = (slip * drag).sum(axis=1)
        assert np.all(power <= 0.0)
        np.testing.assert_allclose(-power, np.linalg.norm(slip, axis=1) * np.linalg.norm(drag, axis=1), rtol=1e-9)
        number = np.linalg.norm(slip, axis=1) * n.reynolds
        yen = 24.0 / number * (1.0 + 0.15 * np.sqrt(number) + 0.017 * number) - 0.208 / (1.0 + 1e4 / np.sqrt(number))
        np.testing.assert_allclose(np.linalg.norm(drag, axis=1), 0.75 * n.alpha * yen * (number / n.reynolds) ** 2, rtol=1e-10)


class TestMomentum:
    """Impulses of the bed and forces of the fluid and the weight are all that changes the velocity."""

    @pytest.mark.parametrize("history", [True, False])
    @pytest.mark.parametrize("axis", AXES)
    def test_over_the_whole_run(self, axis, history, sand, without):
        result = sand if history else without
        path, jumps = result.trajectory, result.all_jumps
        force, time = accelerations(path, axis), path["time"].to_numpy()
        given = 0.0
        for piece in flights(result):
            root = np.sqrt(time[piece] - time[piece.start])[1:]  # a force as t^(−1/2) is finite in the root
            given += CubicSpline(root, 2.0 * root * force[piece][1:]).integrate(0.0, root[-1])
        impulses = jumps[f"impulse_{axis}"][:-1].sum()
        change = jumps[f"impact_{axis}"].iloc[-1] - jumps[f"takeoff_{axis}"][0]
        size = np.abs(jumps[f"impulse_{axis}"]).sum()
        assert given + impulses == pytest.approx(change, abs=1e-4 * size)

    def test_the_bed_carries_what_the_fluid_does_not(self, without):
        """Mean impulse over mean duration: the weight less the mean fluid force, up to the change of momentum between the ends."""
        path, jumps = without.trajectory, without.all_jumps
        time = path["time"].to_numpy()
        names = [str(name) for name in path.data_vars if str(name).endswith("_z") and not str(name).startswith(("spin", "weight"))]
        fluid = sum(path[name].to_numpy() for name in names)
        total = jumps["duration"].sum()
        lifted = sum(CubicSpline(time[piece], fluid[piece]).integrate(time[piece.start], time[piece.stop - 1]) for piece in flights(without)) / total
        n = without.scene.numbers
        ends = (jumps["takeoff_z"][0] - jumps["impact_z"].iloc[-1]) / total
        assert jumps["impulse_z"][:-1].sum() / total == pytest.approx(n.alpha / n.shields - lifted - ends, rel=1e-4)


class TestTable:
    def test_what_is_derived(self, sand):
        jumps = sand.jumps
        np.testing.assert_allclose(jumps["velocity"], jumps["length"] / jumps["duration"], rtol=1e-14)
        np.testing.assert_allclose(np.tan(np.radians(jumps["takeoff_angle"])), jumps["takeoff_z"] / jumps["takeoff_x"], rtol=1e-12)
        np.testing.assert_allclose(np.tan(np.radians(jumps["incidence_angle"])), -jumps["impact_z"] / jumps["impact_x"], rtol=1e-12)
        np.testing.assert_allclose(np.tan(np.radians(jumps["deviation_angle"])), jumps["drift"] / jumps["length"], rtol=1e-12)
        np.testing.assert_allclose(jumps["start"][1:], (jumps["start"] + jumps["duration"])[:-1], rtol=1e-13)
        assert np.all(jumps["clipped"] == (jumps["tilt"] > 30.0 - 1e-9)) and jumps["tilt"].max() <= 30.0 + 1e-12
        assert np.all(jumps["contacts"] >= 1.0)

    def test_the_first_are_left_out(self, sand):
        assert len(sand.all_jumps) == 40 and len(sand.jumps) == 35
        assert sand.jumps["start"][0] == sand.all_jumps["start"][5]

    def test_the_summary(self, sand):
        summary, jumps = sand.summary(), sand.jumps
        assert list(summary.columns) == ["mean", "standard_deviation", "standard_error", "count"]
        for name in ("height", "length", "duration", "velocity", "spin", "takeoff_angle", "stokes"):
            row = summary.loc[name]
            assert row["count"] == 35
            assert row["mean"] == pytest.approx(jumps[name].mean(), rel=1e-12)
            assert row["standard_deviation"] == pytest.approx(jumps[name].std(), rel=1e-12)
            plain = jumps[name].std() / np.sqrt(35.0)
            assert 0.3 * plain < row["standard_error"] < 3.0 * plain
        assert sand.summary().equals(summary)


class TestBudget:
    def test_of_parabolas(self):
        """Elastic bounces, all alike: a parabola over the phase, the weight at every phase."""
        made = scene("bouncing", effects=["weight"], velocity=[0.5, 0.0, 1.0], height=0.5 + 1e-12, bed={"restitution": 1.0}, solver={"rtol": 1e-10})
        result = flown(made)
        budget = result.budget(20)
        phase, duration, gravity = budget["phase"].to_numpy(), 2.0 * 2.65, 1.0 / 2.65
        np.testing.assert_allclose(phase, (np.arange(20) + 0.5) / 20)
        np.testing.assert_allclose(budget["x"], 0.5 * duration * phase, rtol=1e-9)
        exact = 0.5 + duration * phase - 0.5 * gravity * (duration * phase) ** 2
        assert np.abs(budget["z"] - exact).max() < 0.15  # straight between the points of the path
        np.testing.assert_allclose(budget["weight_z"], -gravity, rtol=1e-12)
        assert not budget["weight_x"].any() and list(budget) == ["phase", "x", "z", "weight_x", "weight_z"]

    def test_of_sand(self, sand):
        """Every force is there; drag lifts no falling grain down; the means are those of the path."""
        budget = sand.budget()
        assert len(budget) == 40 and not budget.isna().any().any()
        names = {str(name) for name in budget if str(name).endswith("_z")}
        assert names == {f"{effect}_z" for effect in ("weight", "drag", "added_mass", "lift", "history", "magnus")}
        assert budget["drag_z"].iloc[0] < 0.0 < budget["drag_z"].iloc[-1]
        assert np.all(np.diff(budget["x"]) > 0.0) and budget["x"].iloc[-1] == pytest.approx(sand.jumps["length"].mean(), rel=0.05)
        assert budget["z"].max() == pytest.approx(sand.jumps["height_above_bed"].mean(), rel=0.1)

    def test_nothing_to_tell(self):
        result = flown(scene("settling"))
        for method in (result.budget, result.diffusion):
            with pytest.raises(ValueError, match="jump"):
                method()


class TestDiffusion:
    def made(self, x):
        """A result with a path of its own: x of time, takeoffs every unit of time."""
        time = np.linspace(0.0, 100.0, 20001)
        starts = np.arange(0.0, 100.0)
        jumps = pd.DataFrame({"grain": 0, "start": starts, "duration": 1.0} | dict.fromkeys(("stokes", "clipped", "height"), 0.0))
        path = xr.Dataset({"x": ("time", x(time))}, coords={"time": time})
        return saltation.Result(scene("settling", run={"duration": 1.0}), jumps, "finished", "", {}, 100.0, path=path)

    def test_ballistic(self):
        """x = ½at²: a takeoff at s moves on with as, so the second moment is a²·var(s)·τ²."""
        found = self.made(lambda t: 0.05 * t**2).diffusion(np.array([0.5, 1.0, 2.0, 4.0]))
        variance = np.var(np.arange(0.0, 97.0))  # takeoffs at least the longest lag before the end
        np.testing.assert_allclose(found["x"], 0.01 * variance * found["lag"] ** 2, rtol=1e-6)
        assert not found["y"].any()

    def test_a_steady_grain_does_not_spread(self):
        assert np.abs(self.made(lambda t: 3.0 * t).diffusion()["x"]).max() < 1e-18

    def test_of_sand(self, sand):
        """Ballistic within a jump."""
        found = sand.diffusion()
        assert len(found) == 40 and np.all(found[["x", "y"]] > 0.0)
        short = sand.diffusion(np.array([5e-4, 1e-3]))
        for axis in "xy":
            assert np.log2(short[axis][1] / short[axis][0]) == pytest.approx(2.0, abs=0.1)
        np.testing.assert_allclose(short["y"], np.var(sand.jumps["takeoff_y"]) * short["lag"] ** 2, rtol=0.1)


class TestBedLoad:
    def test_from_the_impulses(self, sand):
        found, jumps, n = sand.bed_load(), sand.jumps, sand.scene.numbers
        friction = -jumps["impulse_x"].sum() / jumps["impulse_z"].sum()
        assert 0.1 < friction < 1.5 and found["dynamic_friction"] == pytest.approx(friction)
        speed = jumps["length"].sum() / jumps["duration"].sum()
        assert found["rate"] == pytest.approx((n.shields - n.critical_shields) * speed * np.sqrt(n.shields) / friction)
        assert found["meyer_peter_mueller"] == pytest.approx(8.0 * max(0.0, n.shields - 0.047) ** 1.5)
        assert found["wong_parker"] == pytest.approx(3.97 * max(0.0, n.shields - 0.0495) ** 1.5)

    def test_refusals(self):
        with pytest.raises(ValueError, match="channel"):
            flown(scene("bouncing")).bed_load()
        with pytest.raises(ValueError, match="jump"):
            flown(scene("sand", run={"jumps": None, "duration": 1e-3, "discard": 0})).bed_load()


class TestProvenance:
    def test_what_it_tells(self, sand):
        told, jumps = sand.provenance, sand.jumps
        assert told["profile"] == "swamee" and told["roughness"] == "R7" and told["reading"] == "clip" and told["rebound_memory"] == "impulse"
        assert told["roughness_height"] == 0.69e-3 and told["restitution"] == 0.65 and told["seed"] == 1 and told["kernel"] == "basset"
        assert told["stokes"] == [jumps["stokes"].min(), jumps["stokes"].max()]
        assert told["clipped"] == pytest.approx(jumps["clipped"].mean()) and told["creeping"] == pytest.approx((jumps["height"] < 0.1).mean())
        assert told["solver"] == {"method": "collocation", "rtol": 1e-8}
        assert any("history.kernel = 'basset'" in text for text in told["outside_validity"])
        assert json.loads(json.dumps(told)) == told

    def test_what_is_not_there_is_not_told(self, without):
        assert without.provenance["rebound_memory"] is None and without.provenance["kernel"] is None
        still = flown(scene("settling")).provenance
        assert still["profile"] == "none" and still["roughness"] is None and still["stokes"] is None


class TestFiles:
    def test_there_and_back(self, sand, tmp_path):
        """To the last bit, and everything can still be asked."""
        sand.save(tmp_path / "out.nc")
        found = saltation.open(tmp_path / "out.nc")
        assert found.all_jumps.equals(sand.all_jumps) and found.jumps.equals(sand.jumps)
        assert found.trajectory.identical(sand.trajectory)
        assert found.scene == sand.scene and found.provenance == sand.provenance
        assert (found.status, found.message) == (sand.status, sand.message)
        assert found.summary().equals(sand.summary()) and found.budget().equals(sand.budget()) and found.bed_load() == sand.bed_load()
        found.save(tmp_path / "again.nc")
        assert saltation.open(tmp_path / "again.nc").dataset().identical(sand.dataset())

    def test_units_are_in_the_file(self, sand, tmp_path):
        sand.save(tmp_path / "out.nc")
        with xr.open_dataset(tmp_path / "out.nc", engine="scipy") as opened:
            assert opened["jump_height"].attrs["scale"] == "d" and opened["time"].attrs["scale"] == "d/u*"
            assert opened.attrs["diameter"] == 0.69e-3 and opened.attrs["status"] == "finished"
            assert opened.sizes["jump"] == 40

    def test_without_a_path_and_without_jumps(self, tmp_path):
        for made in (scene("bouncing", run={"trajectory": False}), scene("settling")):
            result = flown(made)
            result.save(tmp_path / "out.nc")
            found = saltation.open(tmp_path / "out.nc")
            assert found.all_jumps.equals(result.all_jumps) and list(found.all_jumps) == list(result.all_jumps)
            assert found.scene == made
            if made.run.trajectory:
                assert found.trajectory.identical(result.trajectory) and len(found.jumps) == 0
            else:
                with pytest.raises(ValueError, match="not stored"):
                    _ = found.trajectory

    def test_a_failure_leaves_the_old_file(self, sand, tmp_path, monkeypatch):
        target = tmp_path / "out.nc"
        flown(scene("bouncing", run={"jumps": 2})).save(target)
        before = target.read_bytes()

        def refuse(*_, **__):
            raise OSError("no")

        monkeypatch.setattr(os, "replace", refuse)
        with pytest.raises(OSError, match="no"):
            sand.save(target)
        assert target.read_bytes() == before and os.listdir(tmp_path) == ["out.nc"]
        monkeypatch.undo()
        monkeypatch.setattr(xr.Dataset, "to_netcdf", refuse)
        with pytest.raises(OSError, match="no"):
            sand.save(target)
        assert target.read_bytes() == before and os.listdir(tmp_path) == ["out.nc"]
        monkeypatch.undo()
        sand.save(target)
        assert len(saltation.open(target).all_jumps) == 40 and os.listdir(tmp_path) == ["out.nc"]

    def test_others_may_read_it(self, sand, tmp_path):
        sand.save(tmp_path / "out.nc")
        assert stat.S_IMODE((tmp_path / "out.nc").stat().st_mode) == 0o644

    def test_nowhere_to_write(self, sand, tmp_path):
        with pytest.raises(OSError):
            sand.save(tmp_path / "missing" / "out.nc")
        assert os.listdir(tmp_path) == []

    def test_what_is_no_result(self, tmp_path):
        xr.Dataset({"a": ("b", np.zeros(3))}).to_netcdf(tmp_path / "other.nc", engine="scipy")
        (tmp_path / "text.nc").write_text("no")
        for name in ("other.nc", "text.nc"):
            with pytest.raises(ValueError, match="saltation result"):
                saltation.open(tmp_path / name)
        with pytest.raises(FileNotFoundError):
            saltation.open(tmp_path / "missing.nc")

    def test_a_file_in_the_current_folder(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        flown(scene("bouncing", run={"jumps": 1})).save("out.nc")
        assert len(saltation.open("out.nc").jumps) == 1


@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0])
def test_a_flight_of_no_length_is_no_point_of_the_path(speed):
    """Impacts without a flight between them, as of a grain that comes to rest: neither a jump that counts nor on the path."""
    result = flown(scene("bouncing", velocity=[0.0, 0.0, -speed], height=0.5, run={"jumps": 3}))
    path = result.trajectory
    assert result.all_jumps["duration"][0] == 0.0 and len(result.all_jumps) == 3
    assert len(result.jumps) == 2 and np.isfinite(result.jumps["velocity"]).all()
    assert np.isnan(path["history_z"]).sum() == 2 and float(path["w"][0]) == pytest.approx(0.8 * speed)


def test_the_path_is_computed_once_and_kept(sand):
    assert sand.trajectory is sand.trajectory


class TestSpinsWithoutRotation:
    """Contacts alone turn the grain: what it turns with is on the path, and the forces on it are those that were felt."""

    @pytest.fixture
    def turned(self):
        made = scene(
            "sand",
            effects=["weight", "drag", "added_mass", "magnus"],
            magnus={"form": "vector"},
            history=None,
            run={"jumps": None, "duration": 0.35, "discard": 0},
            solver={"rtol": 1e-9},
        )
        return flown(made)

    def test_forces_are_the_acceleration_in_every_flight(self, turned):
        path = turned.trajectory
        time = path["time"].to_numpy()
        starts = np.append(0, np.flatnonzero(np.diff(time) == 0.0) + 1)
        assert len(starts) == len(turned.jumps) + 1 > 3  # the last flight is cut by the end
        for low, high in itertools.pairwise(np.append(starts, len(time))):
            for velocity, axis in zip("uvw", AXES, strict=True):
                slope = CubicSpline(time[low:high], path[velocity].to_numpy()[low:high]).derivative()(time[low:high])
                assert np.abs(slope - accelerations(path, axis)[low:high])[2:-2].max() < 1e-3

    def test_the_spin_is_that_of_the_flight_up_to_its_impact(self, turned):
        path = turned.trajectory
        time = path["time"].to_numpy()
        starts = np.append(0, np.flatnonzero(np.diff(time) == 0.0) + 1)
        for low, high in itertools.pairwise(np.append(starts, len(time))):
            for axis in AXES:
                assert np.ptp(path[f"spin_{axis}"].to_numpy()[low:high]) == 0.0
        assert np.abs(path["spin_x"]).max() > 0.1 and np.abs(path["spin_z"]).max() > 0.1
        np.testing.assert_allclose(path["spin_y"].to_numpy()[starts[:-1]], turned.jumps["spin"], rtol=1e-14)
