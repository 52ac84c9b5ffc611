"""Stream and grains: what grains take the stream lacks, nothing changes without grains, and rests slow the spreading."""

import itertools
import math
import re
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
    """∫ of the forces along the stream on a grain above each height, with what picks it up, per time; history has a singularity 1/√t at a takeoff."""
    path, jumps = result.trajectory, result.jumps
    time, z = path["time"].to_numpy(), path["z"].to_numpy()
    along = sum(path[name].to_numpy() for name in path.data_vars if str(name).endswith("_x") and not str(name).startswith(("spin", "eddy")))
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
    rested = result.all_jumps["start"] - (result.all_jumps["start"] + result.all_jumps["duration"]).shift() > 1e-6
    for _, row in result.all_jumps[rested & (result.all_jumps["start"] >= jumps["start"].iloc[0])].iterrows():
        total += row["takeoff_x"] * (row["height_above_bed"] - row["height"] > heights)
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
    jumps, pieces = settled.jumps, coupling.pieces_of(settled)  # at the bed they leave it: impulses of the contacts, but for the first and the last velocity
    left = -jumps["impulse_x"].sum() / jumps["duration"].sum() - coupling.sums_of(settled, pieces, heights[:1])[0] / pieces.lasting.sum()
    assert abs(left) * jumps["duration"].sum() < 2.0 * jumps["impact_x"].max()


@pytest.fixture(scope="module")
def among_eddies():
    """A scene whose runs chance moves, what it settles to, and the runs on the way."""
    effects = [*scene("sand").effects, "turbulence"]
    changes = {"effects": effects, "channel": {"depth": 0.1, "transport_stage": 2.0}, "rests": {"entrainment": 5.0}, "run": {"trajectory": False}}
    made = coupled(jumps=110, coupling={"tolerance": 1e-2, "runs": 150}, **changes)
    runs = []

    def fly(scene, report):
        runs.append(simulation.run_uncoupled(scene, report))
        return runs[-1]

    return coupling.settle(made, fly, None), runs


def test_chance_among_eddies_is_averaged_to_what_a_far_longer_run_comes_to(among_eddies):
    result, runs = among_eddies
    made = result.scene.coupling.settled
    assert result.status == "finished" and made.change <= 1e-2
    assert 8 <= made.averaged < made.runs == len(runs) < 150
    seeds = [run.scene.run.seed for run in runs]
    assert len(set(seeds[-1 - made.averaged :])) == made.averaged + 1 and seeds[-1] == result.scene.run.seed
    long = simulation.run_uncoupled(result.scene.changed(run={"jumps": 12010, "seed": 99, "trajectory": True}, coupling={"settled": made.model_dump()}), None)
    stress, _, rate = coupling.carried(long.scene, coupling.sums_of(long, coupling.pieces_of(long), np.array(made.heights)))
    error = 0.5 * made.change * math.sqrt(1.0 + made.averaged * 100.0 / 12000.0)  # of the difference to the long run, which has its own
    assert np.abs(stress - made.stress).max() < 3.0 * error
    assert np.isclose(rate, made.rate, rtol=0.1)


def test_momentum_closes_at_every_height_among_eddies(among_eddies):
    """What the stream's profile lacks is what the sums of all averaged runs say, and these are what the forces on the grains take: of some runs."""
    result, runs = among_eddies
    made, numbers = result.scene.coupling.settled, result.scene.numbers
    heights = np.array(made.heights)
    clear = np.array([result.scene.clear.extended(z)[1] for z in heights])
    ratio = np.array([result.scene.profile.extended(z)[1] for z in heights]) / clear
    viscous, total = np.minimum(1.0, clear / result.scene.clear.reynolds), 1.0 - heights * numbers.diameter / 0.1
    stream = (viscous * ratio + (1.0 - viscous) * ratio * np.abs(ratio)) * total
    averaged = runs[-1 - made.averaged : -1]
    sums = np.array([coupling.sums_of(run, coupling.pieces_of(run), heights) for run in averaged])
    assert np.abs(stream + coupling.carried(result.scene, sums.sum(axis=0))[0] - total).max() < 1e-3
    some, few = averaged[:5], slice(None, None, 5)
    forces = np.average([taken_by_forces(run, heights[few]) for run in some], axis=0, weights=[run.jumps["duration"].sum() for run in some])
    taken = sums[:5].sum(axis=0)
    grains = numbers.density_ratio * math.pi / 6.0 * made.grains * numbers.diameter**2
    assert np.abs(grains * (forces - taken[:-4][few] / taken[-4])).max() < 1e-3


def test_a_run_that_chance_moves_too_much_says_how_many_would_do(among_eddies):
    short = among_eddies[0].scene.changed(coupling={"runs": 30, "tolerance": 1e-3})
    result = saltation.run(short)
    made = result.scene.coupling.settled
    assert result.status == "unsettled" and made.runs == 31
    found = re.search(r"two standard errors of the mean over (\d+): take more jumps, coupling.runs = (\d+), or", result.message)
    averaged, needed = map(int, found.groups())
    assert averaged == made.averaged and np.isclose((needed - made.runs + averaged) / averaged, (made.change / 1e-3) ** 2, rtol=0.01)


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
    out = CliRunner().invoke(cli.main, ["run", "sand", *(f"--set={word}" for word in ("coupling.runs=2", "run.jumps=30", "run.discard=0"))])
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
        deep, shallow = (Laden(clear, tuple(heights), tuple(stress), depth).extended(0.5)[1] for depth in (1e9, 101.0))
        assert shallow < deep


def test_the_share_that_grains_carry_is_exact_up_to_the_surface():
    """τ_p = ½ (1 − z/h)(1 − z/top) leaves ½ (1 + z/top) of the stress to the stream, whose mixing length makes the square root of that of its shear."""
    clear, depth = scene("sand", channel={"profile": "constant_b"}).clear, 20.0
    top = 0.9995 * depth
    heights = np.geomspace(0.05, top, 200)
    stress = 0.5 * (1.0 - heights / depth) * (1.0 - heights / top)
    made = Laden(clear, tuple(heights), tuple(stress), depth)
    z = depth * np.array([0.5, 0.9, 0.99, 0.998])
    assert np.allclose(made.left(z), 0.5 * (1.0 + z / top), rtol=1e-5)
    assert np.allclose([made.extended(height)[1] / clear.extended(height)[1] for height in z], np.sqrt(0.5 * (1.0 + z / top)), rtol=1e-4)
    assert (made.left(np.array([0.9995, 1.0, 2.0]) * depth) == 1.0).all()
    with pytest.raises(ValueError, match=r"heights must end below the surface, 19 d, got 19.99 d"):
        Laden(clear, tuple(heights), tuple(stress), 19.0)
    result = saltation.run(coupled(jumps=30, channel={"transport_stage": 2.5, "depth": 1e-3}))
    assert result.status == "unsettled" and "and the stream ends at its depth, 1.449 d: give a greater channel.depth" in result.message


def test_on_a_slope_the_fluid_around_a_grain_takes_momentum_from_its_weight():
    """Without drag the fluid feels the added mass alone: −(C_m/s) du/dt of a grain that its weight accelerates."""
    made = scene("sand", effects=["weight", "added_mass"], channel={"profile": "none", "slope": 0.2}, run={"jumps": 12, "discard": 2})
    result, numbers = saltation.run(made), made.numbers
    pieces = coupling.pieces_of(result)
    taken = coupling.sums_of(result, pieces, pieces.low.min(keepdims=True))[0] / pieces.lasting.sum()
    assert np.isclose(taken, -numbers.added_mass / numbers.density_ratio * numbers.alpha * math.sin(math.atan(0.2)) / numbers.shields, rtol=1e-6)


def test_a_grain_that_is_picked_up_has_its_first_velocity_from_the_stream():
    flown = saltation.run(scene("sand", run={"jumps": 200, "discard": 10}, rests={"entrainment": 5.0, "rise": 0.5}))
    jumps = flown.jumps
    picked_up = (flown.rests["start"] > jumps["start"].iloc[0]).sum()
    assert picked_up > 10
    gained = (jumps["impact_x"] - jumps["takeoff_x"]).sum() + 2.0 * picked_up  # all take off at 2 u*, and end at rest or in an impact of the bed
    assert np.isclose(coupling.pieces_of(flown).gained.sum(), gained, rtol=1e-9)


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
        ({"coupling": "roughness", "channel": {"profile": "reichardt"}}, "a profile with a roughness length, one of swamee, yalin, constant_b"),
        ({"coupling": {"form": "roughness", "excess": 0.1}}, "coupling.excess belongs to form = 'two_way'"),
        ({"coupling": {"grains": 1e5, "excess": 0.1}}, "excess and grains exclude each other"),
        ({"coupling": {"grains": 1e12}}, "coupling.grains must be 2.1e+06 1/m2 or less, one for each d² of the bed, got 1e+12"),
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
