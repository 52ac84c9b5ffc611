"""Stream and grains: what grains take the stream lacks, nothing changes without grains, and rests slow the spreading."""

import itertools
import math
from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import numpy as np
import pytest
from click.testing import CliRunner
from scene_cases import sand_cloud, scene
from scipy.interpolate import CubicSpline

import saltation
from saltation import cli, coupling, regressions, simulation, statistics
from saltation.flow import Laden, saltation_layer
from saltation.scene import SceneError


def coupled(name="sand", jumps=60, **changes):
    return scene(name, run={"jumps": jumps, "discard": 10}, coupling="two_way").changed(**changes)


@pytest.fixture(scope="module")
def settled():
    return saltation.run(coupled(channel={"transport_stage": 2.5}, solver={"rtol": 1e-6}, coupling={"tolerance": 1e-4}))


def taken_by_forces(result, heights):
    """∫ of the forces along the stream on a grain above each height, per time; history has a singularity 1/√t at a takeoff."""
    path, jumps = result.trajectory, result.jumps
    time, z = path["time"].to_numpy(), path["z"].to_numpy()
    along = sum(path[name].to_numpy() for name in path.data_vars if str(name).endswith("_x") and not str(name).startswith("spin"))
    total = np.zeros(len(heights))
    for start, duration in zip(jumps["start"], jumps["duration"], strict=True):
        first, last = np.searchsorted(time, [start, (start + duration) * (1.0 + 1e-14)], side="right") - 1
        root, kept = np.unique(np.sqrt(time[first : last + 1] - start), return_index=True)
        force = 2.0 * root * along[first : last + 1][kept]
        force[0] = force[1]
        height, done = CubicSpline(root, z[first : last + 1][kept]), CubicSpline(root, force).antiderivative()
        for k, level in enumerate(heights):
            ends = np.unique(np.clip(np.concatenate([[root[0]], height.solve(level, extrapolate=False), [root[-1]]]), root[0], root[-1]))
            total[k] += sum(done(b) - done(a) for a, b in itertools.pairwise(ends) if height(0.5 * (a + b)) > level)
    return total / jumps["duration"].sum()


def test_what_the_forces_on_grains_take_is_what_the_stream_lacks_at_every_height(settled):
    made, numbers = settled.scene.coupling.settled, settled.scene.numbers
    heights = np.array(made.heights)[::5]
    grains = numbers.density_ratio * math.pi / 6.0 * made.grains * numbers.diameter**2 * taken_by_forces(settled, heights)
    clear = np.array([settled.scene.clear.extended(z)[1] for z in heights])
    ratio = np.array([settled.scene.profile.extended(z)[1] for z in heights]) / clear
    viscous = clear / settled.scene.clear.reynolds
    stream = viscous * ratio + (1.0 - viscous) * ratio * np.abs(ratio)
    assert np.abs(stream + grains - 1.0).max() < 1e-3
    assert np.isclose(stream[0], 1.0 / numbers.stage, atol=1e-3)  # Owen's condition
    jumps = settled.jumps  # at the bed they leave it: impulses of the contacts, but for the first and the last velocity
    left = -jumps["impulse_x"].sum() / jumps["duration"].sum() - coupling.momentum(settled, heights[:1])[0]
    assert abs(left) * jumps["duration"].sum() < 2.0 * jumps["impact_x"].max()


def test_the_result_says_what_the_stream_has_become(settled, tmp_path):
    settled.save(tmp_path / "out.nc")
    again = saltation.open(tmp_path / "out.nc")
    assert again.status == "finished" and again.coupled().equals(settled.coupled())
    kept = again.dataset()
    for name in settled.coupled().variables:
        assert "units" in kept[f"coupling_{name}"].attrs
    table, stream = again.summary(), again.coupled()
    speed = again.jumps["length"].sum() / again.jumps["duration"].sum()
    numbers = again.scene.numbers
    flux = float(stream["moving_grains"]) * math.pi / 6.0 * numbers.diameter**3 * speed * numbers.velocity
    assert np.isclose(table.loc["bed_load_flux", "mean"], flux, rtol=1e-12)
    assert np.isclose(table.loc["bed_load", "mean"], flux / math.sqrt(1.65 * 9.81 * numbers.diameter**3), rtol=1e-12)
    assert float(stream["bed_load"]) < 0.5 * float(stream["bed_load_before"])


def test_without_grains_the_bits_are_those_of_a_stream_that_feels_none():
    flown = saltation.run(scene("sand", run={"jumps": 20, "discard": 0}))
    none = saltation.run(coupled(jumps=20, run={"discard": 0}, coupling={"grains": 0.0}))
    assert none.jumps.equals(flown.jumps) and none.scene.coupling.settled.rate == 0.0
    assert scene("sand", coupling="none") == scene("sand")
    few = [saltation.run(coupled(jumps=20, run={"discard": 0}, coupling={"grains": n, "tolerance": 1e-6})) for n in (200.0, 100.0)]
    twice, once = (float(np.abs(one.jumps["length"] - flown.jumps["length"]).sum()) for one in few)
    assert 1.9 < twice / once < 2.1


def test_heights_and_runs_do_not_matter_once_they_are_enough():
    def rate(tolerance=1e-5):
        return saltation.run(coupled(jumps=40, coupling={"tolerance": tolerance})).scene.coupling.settled.rate

    rates = {}
    for levels in (16, 32, 64):
        with mock.patch.object(coupling, "LEVELS", levels):
            rates[levels] = rate()
    assert abs(rates[32] - rates[64]) < abs(rates[16] - rates[64])
    assert abs(rates[32] - rates[64]) < 0.01 * rates[64]
    with mock.patch.object(coupling, "DAMPING", 0.4):
        assert np.isclose(rate(), rates[64], rtol=1e-3)
    assert np.isclose(rate(1e-3), rates[64], rtol=2e-2)


def test_stream_and_grains_that_do_not_agree_are_told():
    with mock.patch.object(coupling, "MOST", 2):
        out = CliRunner().invoke(cli.main, ["run", "sand", "--set", "coupling=two_way", "--set", "run.jumps=30", "--set", "run.discard=0"])
    assert out.exit_code == 1
    assert out.stdout.startswith("unsettled: coupling: after 2 runs") and "take more jumps" in out.stdout


def test_the_stress_at_the_bed_sets_the_number_of_grains():
    for excess in (0.25, 1.0):
        made = saltation.run(coupled(jumps=30, coupling={"excess": excess, "tolerance": 1e-2})).scene
        assert np.isclose(made.coupling.settled.seen[0], (1.0 - excess) * (1.0 - 1.0 / made.numbers.stage), atol=1e-12)
    assert saltation.run(coupled(jumps=12, channel={"transport_stage": 0.9})).scene.coupling.settled.grains == 0.0


def test_profiles_of_a_stream_whose_grains_carry_the_same_at_all_heights():
    heights = np.geomspace(0.01, 100.0, 9)
    for name in ("constant_b", "yalin", "swamee", "reichardt"):
        clear = scene("sand", channel={"profile": name}).clear
        stress = np.full(9, 0.75)
        made, back, none = (Laden(clear, tuple(heights), tuple(values)) for values in (stress, 2.0 + 0.0 * stress, 0.0 * stress))
        for z in (0.04, 0.7, 3.0):
            velocity, shear = clear.extended(z)
            assert none.extended(z) == (velocity, shear)
            if name in ("constant_b", "yalin"):  # √(1 − τ_p) of the logarithm; where the stress is against the stream, so is the velocity
                assert np.allclose(made.extended(z), [0.5 * velocity, 0.5 * shear], rtol=1e-6)
                assert np.allclose(back.extended(z), [-velocity, -shear], rtol=1e-6)
            else:
                ratio, viscous = made.extended(z)[1] / shear, min(1.0, shear / clear.reynolds)
                assert np.isclose(viscous * ratio + (1.0 - viscous) * ratio**2, 0.25, rtol=1e-5)
                h = 1e-5 * z
                assert np.isclose((made.extended(z + h)[0] - made.extended(z - h)[0]) / (2.0 * h), made.extended(z)[1], rtol=1e-5)
        deep, shallow = (Laden(clear, tuple(heights), tuple(stress), depth).extended(0.5)[1] for depth in (1e9, 10.0))
        assert shallow < deep


def test_a_layer_of_grains_makes_the_bed_rougher():
    for name in ("constant_b", "yalin"):
        before, made = (scene("sand", channel={"profile": name}, coupling=word).profile for word in ("none", "roughness"))
        layer = saltation_layer(1.87, 0.69e-3)
        size = math.log(0.069)
        assert np.isclose(layer, 0.68 * 1.87 / (1.0 + 1.87 * (0.0204 * size**2 + 0.022 * size + 0.0709)), rtol=1e-12)
        assert np.isclose(made.floor, before.floor + 0.056 * layer, rtol=1e-12)
    before, made = (scene("sand", coupling=word).profile for word in ("none", "roughness"))  # Swamee: far above, the same shift of the logarithm
    z0 = 1.0 / (before.scale * before.reynolds)
    shift = math.log1p(0.056 * layer / z0) / before.kappa
    assert np.isclose(before.extended(1e4)[0] - made.extended(1e4)[0], shift, rtol=1e-3)
    assert saltation_layer(1.0, 0.69e-3) == 0.0
    rough = scene("sand", coupling="roughness")
    assert saltation.Scene.model_validate(rough.model_dump(exclude_none=True)) == rough
    out = CliRunner().invoke(cli.main, ["check", "sand", "--set", "coupling=roughness"]).stdout
    assert "0.055 d to the roughness length" in " ".join(out.split())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"coupling": "two-way"}, "coupling must be one of 'none', 'roughness', 'two_way' or a table, got 'two-way'; did you mean 'two_way'?"),
        ({"coupling": "roughness", "channel": {"profile": "reichardt"}}, "can be rougher, one of swamee, yalin, constant_b"),
        ({"coupling": {"form": "roughness", "excess": 0.1}}, "coupling.excess belongs to form = 'two_way'"),
        ({"coupling": {"grains": 1e5, "excess": 0.1}}, "excess and grains exclude each other"),
        ({"coupling": {"excess": 2.0}}, "coupling.excess must be 1 or less"),
        ({"coupling": "two_way", "channel": None}, "needs a [channel]"),
        ({"coupling": "two_way", "bed": None, "run": {"jumps": None, "discard": 0, "duration": 1.0}}, "needs a [bed]"),
        ({"rests": {}}, "rests.entrainment is missing"),
        ({"rests": {"entrainment": 0.0}}, "rests.entrainment must be greater than 0"),
        ({"rests": {"entrainment": 1.0}, "channel": None}, "rests needs a [channel]"),
        ({"rests": {"entrainment": 1.0}, "solver": {"method": "fixed_step", "dt": 1e-3}}, "rests needs solver.method = 'collocation'"),
    ],
)
def test_what_makes_no_scene_is_one_sentence(changes, words):
    with pytest.raises(SceneError) as error:
        scene("sand").changed(**changes)
    assert words in str(error.value)


def test_many_grains_are_as_many_as_the_scene_says(tmp_path):
    made = sand_cloud(5.0, encounters=None, effects=[name for name in scene("sand_cloud").effects if name != "encounters"], coupling={"tolerance": 0.05})
    result = saltation.run(made)
    found = result.scene.coupling.settled
    length, width, _ = made.box
    assert np.isclose(found.grains * made.grain.diameter**2, 45.0 / (length * width), rtol=1e-12)
    pieces, jumps = coupling.pieces_of(result), result.jumps
    gained = (jumps["impact_x"] - jumps["takeoff_x"]).groupby(jumps["grain"]).sum()
    last = jumps.groupby("grain").tail(1)  # the height of a grain's last impact is not known
    assert np.isclose(pieces.gained.sum(), gained.sum() - (last["impact_x"] - last["takeoff_x"]).sum(), rtol=1e-9)
    assert np.isclose(pieces.lasting.sum(), jumps["duration"].sum() - last["duration"].sum(), rtol=1e-9)
    with ThreadPoolExecutor(2) as pool:
        assert saltation.run(made, executor=pool).jumps.equals(result.jumps)
    whole = saltation.run(made, output=tmp_path / "cloud")
    assert whole.jumps.equals(result.jumps) and saltation.run(made, output=tmp_path / "cloud").scene == whole.scene


def test_bed_load_of_sand_comes_down_to_the_measured_order():
    found = saltation.run(coupled(jumps=100, channel={"transport_stage": 4.0})).scene
    measured = float(regressions.wong_parker(found.numbers.shields))
    assert found.coupling.settled.rate_uncoupled > 5.0 * measured
    assert 0.5 * measured < found.coupling.settled.rate < 2.0 * measured


def resting_cloud(duration, **changes):
    bed = {"roughness": "R7", "span_scatter": True}
    effects = [name for name in scene("sand_cloud").effects if name != "encounters"]
    return sand_cloud(duration, encounters=None, effects=effects, bed=bed, **changes)


def test_rests_are_exponential_and_the_balance_at_the_bed_holds():
    made = scene("sand", run={"jumps": 600, "discard": 0}, rests={"entrainment": 5.0, "rise": 0.5})
    result = saltation.run(made)
    rests, mean = result.rests["duration"], 1.0 / (5.0 * made.numbers.time)
    assert len(rests) > 50 and abs(rests.mean() - mean) < 4.0 * mean / math.sqrt(len(rests))
    assert abs((rests > mean * math.log(2.0)).mean() - 0.5) < 4.0 * 0.5 / math.sqrt(len(rests))
    # as many set out as come to rest, in the time of both: at rest per moving one = mean rest over mean time between rests
    flying = result.jumps["duration"].sum() / len(rests)
    assert np.isclose(result.resting(), rests.mean() / flying, rtol=1e-12)
    start, end = result.all_jumps["start"].to_numpy(), (result.all_jumps["start"] + result.all_jumps["duration"]).to_numpy()
    after = result.all_jumps[1:][start[1:] - end[:-1] > 1e-6]
    assert len(after) == len(rests)
    assert np.allclose(after[["takeoff_x", "takeoff_y", "takeoff_z"]], [2.0, 0.0, 2.0])
    assert result.jumps.equals(saltation.run(made.changed(run={"trajectory": False})).jumps)
    assert np.isfinite(result.trajectory["x"]).all() and (np.diff(result.trajectory["time"]) >= 0.0).all()
    timed = saltation.run(made.changed(run={"jumps": None, "duration": 20.0 * made.numbers.time}))
    assert timed.status == "finished" and timed.time == timed.scene.end


def test_grains_at_rest_stay_where_they_are_in_any_parts_and_blocks(tmp_path):
    unit = scene("sand_cloud").numbers.time
    made = resting_cloud(60.0, rests={"entrainment": 0.1 / unit, "rise": 0.25}, cloud={"number": 12})
    whole = saltation.run(made)
    lying = whole.trajectory["u"].to_numpy() == 0.0
    assert len(whole.rests) > 12 and 0.2 < lying.mean() < 0.8 and not len(whole.fates)
    moved = np.abs(np.diff(whole.trajectory["x"].to_numpy(), axis=0))[lying[1:] & lying[:-1]]
    assert (moved == 0.0).all()
    for grain, start, duration in whole.rests.to_numpy():
        time = whole.trajectory["time"].to_numpy()
        assert lying[(time > start) & (time < start + duration), int(grain)].all()
    with mock.patch.object(simulation, "PART", 12 * 50):  # more parts, with rests across their ends
        assert saltation.run(made, output=tmp_path / "cloud").trajectory.equals(whole.trajectory)
    with ThreadPoolExecutor(2) as pool, mock.patch.object(simulation, "CHUNK", 1e-3):
        assert saltation.run(made, executor=pool).trajectory.equals(whole.trajectory)


def test_rests_slow_the_spreading():
    unit = scene("sand_cloud").numbers.time
    made = resting_cloud(400.0, rests={"entrainment": 1e-4 / unit, "rise": 0.3}, cloud={"number": 60, "interval": 1.0})
    path = saltation.run(made).trajectory
    time, moments = path["time"].to_numpy(), statistics.moments_of_grains(path["time"], np.stack([path["x"], path["y"]], axis=-1))
    for k in range(2):
        late = [statistics.fit_exponent(time[1:], moments[1:, k], *ends)[0] for ends in ((2.0, 10.0), (150.0, 400.0))]
        assert late[0] > 0.5 > late[1]
