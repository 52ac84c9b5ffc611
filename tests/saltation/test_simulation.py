"""Runs as a whole: how they end and what is kept, that nothing but the scene decides, symmetry, and freedom from units."""

from __future__ import annotations

import numpy as np
import pytest
from scene_cases import flown, scene

import saltation
from saltation import simulation
from saltation.flight.setup import Engine

HORIZON = {"history": {"horizon": 2000.0}}
SHARP = {"solver": {"rtol": 1e-9}}


def sand(jumps=30, **changes):
    return scene("sand", **(HORIZON | {"run": {"jumps": jumps, "discard": 0}} | changes))


@pytest.fixture(scope="module")
def usual():
    """100 jumps of sand."""
    return saltation.run(sand(100))


class TestEndings:
    """Every run ends with a status, a sentence, and what it has."""

    def test_all_jumps(self, usual):
        assert usual.status == "finished" and usual.message == "all jumps are done"
        assert len(usual.all_jumps) == 100
        last = usual.jumps.iloc[-1]
        assert usual.trajectory["time"][-1] == pytest.approx(last["start"] + last["duration"], rel=1e-14)

    def test_the_time_is_over(self, usual):
        """In the middle of a flight; the jumps before are those of a run without that end."""
        end = 0.5 * (usual.jumps["start"][19] + usual.jumps["start"][20])
        n = usual.scene.numbers
        result = saltation.run(sand(run={"jumps": None, "duration": end * n.time, "discard": 0}))
        assert result.status == "finished" and result.message == "run.duration is reached"
        assert result.all_jumps.equals(usual.all_jumps.iloc[:19])
        path = result.trajectory
        assert float(path["time"][-1]) == pytest.approx(end, rel=1e-14)
        k = int(np.searchsorted(usual.trajectory["time"], end))
        low, high = usual.trajectory["x"][k - 1 : k + 1]
        assert low <= path["x"][-1] <= high

    def test_no_jump_at_all(self):
        result = saltation.run(sand(run={"jumps": None, "duration": 1e-3, "discard": 0}))
        assert result.status == "finished" and len(result.jumps) == 0 and result.trajectory.sizes["time"] > 1

    def test_a_flight_that_never_comes_down(self):
        """A bubble leaves the bed for good."""
        made = scene("bouncing", grain={"density": 100.0}, run={"jumps": 10, "longest_flight": 30.0})
        result = flown(made)
        assert result.status == "aloft" and "longest_flight" in result.message
        assert len(result.jumps) == 0
        path = result.trajectory
        assert 30.0 < path["time"][-1] < 47.0 and np.all(np.diff(path["z"]) >= 0.0)

    def test_a_strong_stream_and_little_patience(self, usual):
        """What flew before is kept, bit by bit."""
        longest = float(usual.jumps["duration"][:40].max()) - 1e-3
        first = int(np.argmax(usual.jumps["duration"] > longest))
        result = saltation.run(sand(100, run={"jumps": 100, "discard": 0, "longest_flight": longest - 1.0}))
        assert result.status == "aloft" and len(result.jumps) <= first
        assert result.all_jumps.equals(usual.all_jumps.iloc[: len(result.jumps)])
        assert len(result.jumps) == 0 or result.jumps["duration"].max() <= longest

    def test_beyond_the_horizon(self, usual):
        result = saltation.run(sand(100, history={"horizon": 20.0}))
        ends = result.all_jumps["start"] + result.all_jumps["duration"]
        assert result.status == "horizon" and "history.horizon" in result.message
        assert 5 <= len(result.jumps) < 100 and ends.iloc[-1] <= 20.0 < result.trajectory["time"][-1]
        np.testing.assert_allclose(result.jumps["height"], usual.jumps["height"][: len(ends)], rtol=1e-4)

    def test_too_many_steps(self, usual, monkeypatch):
        """A run that cannot go on says why and keeps what it has."""
        made = Engine.__init__

        def limited(self, given):
            made(self, given)
            self.problem = self.problem._replace(max_steps=200)

        monkeypatch.setattr(Engine, "__init__", limited)
        result = saltation.run(sand(100))
        assert result.status == "failed" and result.message == "too many steps"
        assert 0 < len(result.jumps) < 30
        assert result.all_jumps.equals(usual.all_jumps.iloc[: len(result.jumps)])

    def test_a_grain_that_slides_is_not_at_rest(self):
        for speed, status in ((1.0, "creeping"), (0.0, "at rest")):
            made = scene("bouncing", effects=["weight"], velocity=[speed, 0.0, 0.0], bed={"restitution": 0.0}, run={"jumps": 5})
            assert flown(made).status == status

    def test_progress(self, monkeypatch):
        """The share that is done, never less than before, up to all: of jumps, or of the time."""
        monkeypatch.setattr(simulation, "ROWS", 20)
        for run in ({"jumps": 40}, {"jumps": None, "duration": 1.0}):
            seen = []
            saltation.run(sand(run=run | {"discard": 0}), progress=seen.append)
            assert len(seen) > 10 and seen == sorted(seen) and seen[0] >= 0.0 and seen[-1] == 1.0


class TestNothingElseDecides:
    """The scene decides, to the last bit."""

    def test_the_same_again(self, usual):
        again = saltation.run(sand(100))
        assert again.all_jumps.equals(usual.all_jumps) and again.trajectory.identical(usual.trajectory)

    def test_another_seed(self, usual):
        for seed in (0, 2, 2**63 - 1):
            other = saltation.run(sand(20, run={"jumps": 20, "discard": 0, "seed": seed})).jumps
            assert other["height"][0] == usual.jumps["height"][0]  # the first takeoff is given
            assert not other["height"][5:].isin(usual.jumps["height"]).any()

    @pytest.mark.parametrize("jumps", [1, 50])
    def test_a_longer_run_begins_like_a_shorter_one(self, jumps, usual):
        assert saltation.run(sand(jumps)).all_jumps.equals(usual.all_jumps.iloc[:jumps])

    def test_without_its_path(self, usual):
        result = saltation.run(sand(100, run={"jumps": 100, "discard": 0, "trajectory": False}))
        assert result.all_jumps.equals(usual.all_jumps)
        with pytest.raises(ValueError, match=r"run\.trajectory = true"):
            _ = result.trajectory

    @pytest.mark.parametrize("chunk", [1, 7, 64])
    def test_in_chunks(self, chunk, usual, monkeypatch):
        monkeypatch.setattr(simulation, "ROWS", chunk)
        made = saltation.run(sand(40))
        assert made.all_jumps.equals(usual.all_jumps.iloc[:40])
        assert made.trajectory.identical(usual.trajectory.isel(time=slice(made.trajectory.sizes["time"])))

    def test_discarding_leaves_out_and_changes_nothing(self, usual):
        result = saltation.run(sand(100, run={"jumps": 100, "discard": 30}))
        assert result.all_jumps.equals(usual.all_jumps)
        assert result.jumps.equals(usual.all_jumps.iloc[30:].reset_index(drop=True))

    def test_the_order_of_effects_is_of_no_account(self, usual):
        """Sums in another order: rounding alone."""
        turned = list(reversed(usual.scene.names))
        result = flown(sand(5, effects=turned))
        np.testing.assert_allclose(result.all_jumps, usual.all_jumps.iloc[:5], rtol=1e-9, atol=1e-9)


class TestUnits:
    """Only dimensionless numbers count."""

    def same(self, usual, **changes):
        result = saltation.run(sand(30, **changes))
        assert result.all_jumps.equals(usual.all_jumps.iloc[:30])  # powers of two: to the last bit

    def test_a_larger_grain_in_a_thicker_fluid(self, usual):
        """d × 4 and ν × 8 leave R_p alone."""
        self.same(usual, grain={"diameter": 4.0 * 0.69e-3}, fluid={"viscosity": 8.0e-6})

    def test_heavier_grain_and_fluid(self, usual):
        self.same(usual, grain={"density": 2.0 * 2650.0}, fluid={"density": 2000.0})

    def test_the_shear_velocity_in_place_of_the_stage(self, usual):
        self.same(usual, channel={"transport_stage": None, "shear_velocity": usual.scene.numbers.velocity})

    def test_the_roughness_height_in_place_of_its_default(self, usual):
        self.same(usual, channel={"roughness_height": 0.69e-3})

    def test_any_scale(self, usual):
        result = saltation.run(sand(30, grain={"diameter": 3.0 * 0.69e-3}, fluid={"viscosity": 3.0**1.5 * 1e-6}))
        np.testing.assert_allclose(result.jumps, usual.all_jumps.iloc[:30], rtol=1e-8, atol=1e-8)

    def test_the_start_written_out(self, usual):
        """The default start is 2 u* along and up with 2 u*/d of spin at a crest."""
        result = saltation.run(sand(30, velocity=[2.0, 0.0, 2.0], spin=[0.0, 2.0, 0.0], height=0.75))
        np.testing.assert_allclose(result.jumps, usual.all_jumps.iloc[:30], rtol=1e-8, atol=1e-8)

    def test_other_numbers_are_other_jumps(self, usual):
        for changes in ({"fluid": {"viscosity": 2e-6}}, {"grain": {"density": 2700.0}}, {"channel": {"transport_stage": 1.9}}, {"channel": {"slope": 0.01}}):
            assert not saltation.run(sand(3, **changes)).jumps["height"].equals(usual.jumps["height"][:3])


class TestSymmetry:
    """Left and right are alike, and a plane of symmetry is never left."""

    def test_mirrored_across_the_stream(self):
        """y → −y: velocities across, and the spins about x and z, change sign; nothing else."""
        one, other = (saltation.run(sand(40, velocity=[2.0, side * 0.3, 2.0], spin=[side * 0.5, 2.0, side * -0.7], **SHARP)) for side in (1.0, -1.0))
        across = [name for name in one.all_jumps if name in ("drift", "deviation_angle") or name.endswith("_y")]
        assert len(across) == 5 and one.jumps["drift"].abs().min() > 0.0
        for name in one.all_jumps:
            sign = -1.0 if name in across else 1.0
            np.testing.assert_allclose(one.all_jumps[name], sign * other.all_jumps[name], rtol=1e-7, atol=1e-7, err_msg=name)
        ends = [made.trajectory.isel(time=-1) for made in (one, other)]
        for name in ("spin_x", "spin_z", "y", "v"):
            assert float(ends[0][name]) == pytest.approx(-float(ends[1][name]), abs=1e-6)

    def test_three_dimensions_without_anything_across_are_two(self):
        """Jump for jump, with all effects."""
        space = saltation.run(sand(8, bed={"span_scatter": False}, **SHARP)).jumps
        plane = flown(sand(8, dimensions=2, **SHARP)).jumps
        assert not space[["drift", "takeoff_y", "impact_y", "impulse_y"]].to_numpy().any()
        np.testing.assert_allclose(space, plane, rtol=1e-7, atol=1e-7)

    def test_scatter_across_is_even_handed(self, usual):
        """Half of the kicks go left: within five standard errors."""
        kicks = usual.jumps["impulse_y"]
        assert abs(kicks.mean()) < 5.0 * kicks.std() / np.sqrt(len(kicks))
        assert 25 < (kicks > 0.0).sum() < 75

    def test_still_water_knows_no_upstream(self):
        one, other = (flown(scene("bouncing", velocity=[side * 1.3, 0.0, 0.0], spin=[0.0, side, 0.0], bed={"friction": 0.2})).jumps for side in (1.0, -1.0))
        assert one["length"].min() > 0.0
        for name in ("height", "duration", "impact_z", "impulse_z"):
            np.testing.assert_allclose(one[name], other[name], rtol=1e-8, atol=1e-9)
        for name in ("length", "impulse_x", "spin", "takeoff_x"):
            np.testing.assert_allclose(one[name], -other[name], rtol=1e-8, atol=1e-9)


class TestTwoDimensions:
    """What does not exist in the plane is refused or stays out."""

    def test_no_velocity_across(self):
        with pytest.raises(ValueError, match=r"start\.velocity"):
            scene("bouncing", velocity=[1.0, 0.1, 0.0])

    def test_no_spin_out_of_the_plane(self):
        with pytest.raises(ValueError, match=r"start\.spin"):
            scene("bouncing", spin=[1.0, 0.0, 0.0], bed={"friction": 0.2})
