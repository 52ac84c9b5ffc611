"""What the thesis's chapter 4 asks: against data made so that the answer is known, and against small runs."""

import math

import numpy as np
import pandas as pd
import pytest

import saltation
from saltation.flight.layout import ENCOUNTER_COLUMNS as COLUMNS
from saltation.results.result import Result
from saltation.results.tables import encounter_table, path_dataset
from saltation.scene import scene_of
from saltation.study import grains, thesis

LABELS = {"concentration": 0.0233, "particle_reynolds": 73.0, "stage": 2.0}


def cloud(meeting: bool = True, **tables):
    """The thesis's cloud, shorter and smaller."""
    content = thesis.case("sand_cloud")
    content["cloud"]["number"] = 14
    content["run"] |= {"duration": 0.25, "discard": 1}
    for name, values in tables.items():
        content[name] |= values
    if not meeting:
        content["effects"].remove("encounters")
        del content["encounters"]
    return scene_of(content)


def made(jumps=None, met=None, path=None, meeting=True, discard=0):
    """A result that holds what is given."""
    if jumps is None:
        jumps = pd.DataFrame({"grain": [0, 1], "height": 1.0, "duration": 1.0})
    jumps = pd.DataFrame(
        dict.fromkeys(("height", "length", "velocity", "takeoff_angle", "deviation_angle", "stokes", "clipped"), 0.0) | {"duration": 1.0} | dict(jumps)
    )
    met = encounter_table(np.zeros((0, len(COLUMNS)))) if met is None else met
    return Result(cloud(meeting, run={"discard": discard}), jumps, "finished", "", {}, 100.0, met, path=path)


def paths(times, x, y):
    """Paths from positions (time, grain)."""
    values = np.zeros((*x.shape, 6))
    values[:, :, 0], values[:, :, 1] = x, y
    return path_dataset(cloud(True), times, values)


def series(rng, grains, jumps, rho):
    """Correlated numbers of unit variance: autocorrelations ρ^k within each grain, none between grains."""
    noise = rng.standard_normal((grains, jumps))
    for k in range(1, jumps):
        noise[:, k] = rho * noise[:, k - 1] + math.sqrt(1.0 - rho**2) * noise[:, k]
    return pd.DataFrame({"grain": np.repeat(np.arange(grains), jumps), "height": noise.ravel()})


# How often


def test_frequencies_beside_the_printed_ones():
    rows = [(0.0233, 73.0, 3.0, True, 24.0, 6.0), (0.0233, 73.0, 3.0, False, 25.0, 0.0), (0.0013, 250.0, 2.0, True, 8.0, 0.0)]
    table = pd.DataFrame(rows, columns=[*grains.RUN, "encounters", "bed_frequency", "pair_frequency"])
    found = grains.table_4_2(table)
    assert found["ratio"].tolist() == [4.0, math.inf]
    printed = found[[name for name in found if name.endswith("_printed")]].to_numpy()
    assert printed[0].tolist() == [5.31, 23.71, 4.46]
    assert np.isnan(printed[1]).all()


def test_the_printed_ratios_are_those_of_the_printed_frequencies():
    """To the digits that are printed: F_pp has two or three."""
    for pairs, bed, ratio in grains.PRINTED.values():
        assert bed / (pairs + 0.005) - 0.05 <= ratio <= bed / (pairs - 0.005) + 0.05


def seeds(pairs, bed, **labels):
    """Rows of a campaign that differ by their seed."""
    return pd.DataFrame({"pair_frequency": pairs, "bed_frequency": bed, "encounters": True}).assign(**(LABELS | labels))


def test_intervals_over_seeds_are_those_of_student():
    """Eight values of standard deviation 1: t(0.975, 7) = 2.3646 over √8."""
    values = np.array([-1.0, 1.0] * 4) * math.sqrt(7.0 / 8.0)
    found = grains.over_seeds(pd.concat([seeds(5.0 + values, 30.0), seeds(7.0, 21.0 + values, stage=3.0)])).set_index("stage")
    assert found["seeds"].tolist() == [8, 8]
    assert found.loc[2.0, ["pair_frequency", "pair_frequency_interval"]].tolist() == pytest.approx([5.0, 2.3646 / math.sqrt(8.0)], rel=1e-4)
    assert found.loc[2.0, "bed_frequency_interval"] == 0.0
    assert found.loc[2.0, ["ratio", "ratio_interval"]].tolist() == pytest.approx([6.0, 6.0 * 0.83602 / 5.0], rel=1e-4)  # δ(B/P) = −B δP/P²
    assert found.loc[3.0, ["ratio", "ratio_interval"]].tolist() == pytest.approx([3.0, 0.83602 / 7.0], rel=1e-4)
    assert found["ratio_printed"].tolist() == [6.74, 4.46]


def test_the_ratio_of_frequencies_in_proportion_is_known_exactly():
    pairs = np.random.default_rng(9).uniform(1.0, 2.0, 8)
    found = grains.over_seeds(seeds(pairs, 4.0 * pairs)).iloc[0]
    assert found["ratio"] == pytest.approx(4.0) and found["ratio_interval"] == pytest.approx(0.0, abs=1e-12) and found["pair_frequency_interval"] > 0.0


def test_a_single_seed_has_no_interval_and_runs_with_scatter_are_others():
    table = pd.concat([seeds([0.0], [3.0], scatter=False), seeds([1.0], [3.0], scatter=True), seeds([9.0], [9.0]).assign(encounters=False)])
    found = grains.over_seeds(table)
    assert found["scatter"].tolist() == [False, True]
    assert found["ratio"].tolist() == [math.inf, 3.0]
    assert found[[name for name in found if name.endswith("_interval")]].isna().all(axis=None)


# Errors and tests


@pytest.mark.parametrize("rho", [0.0, 0.5])
def test_the_error_of_a_mean_knows_of_correlation_within_grains(rho):
    errors = [grains.mean_error(series(np.random.default_rng(seed), 20, 400, rho), "height") for seed in range(5)]
    exact = math.sqrt((1.0 + rho) / (1.0 - rho) / (20 * 400))
    assert np.mean(errors) == pytest.approx(exact, rel=0.1)  # finite blocks make it some per cent too small


def test_the_error_of_a_mean_does_not_see_what_sets_grains_apart_in_order():
    """A jump of the mean from grain to grain is no scatter within grains."""
    jumps = series(np.random.default_rng(1), 20, 100, 0.0)
    stepped = jumps.assign(height=jumps["height"] + 100.0 * jumps["grain"])
    assert grains.mean_error(stepped, "height") == pytest.approx(grains.mean_error(jumps, "height"), rel=1e-9)


def test_grains_of_a_single_jump():
    jumps = pd.DataFrame({"grain": range(50), "height": np.arange(50.0)})
    assert grains.mean_error(jumps, "height") == pytest.approx(jumps["height"].std() / math.sqrt(50), rel=1e-12)
    assert math.isnan(grains.mean_error(jumps[:1], "height"))


def test_two_sided():
    assert grains.two_sided(-1.959963984540054, 1.0) == pytest.approx(0.05, rel=1e-12)
    assert grains.two_sided(0.0, 0.0) == 1.0
    assert grains.two_sided(1.0, 0.0) == 0.0
    assert math.isnan(grains.two_sided(math.nan, math.nan))


def test_a_run_does_not_differ_from_itself():
    result = made(series(np.random.default_rng(2), 15, 50, 0.3))
    found = grains.compare(result, result)
    assert found["difference"].eq(0.0).all()
    assert found["p_bootstrap"].eq(1.0).all()
    assert found["p_wilcoxon"].to_numpy() == pytest.approx(1.0)


def test_ranks_that_are_all_one_are_no_difference():
    """Whatever the version of SciPy makes of them."""
    for sizes in ((1, 1), (3, 5), (40, 60)):
        assert grains.rank_sum(*(pd.Series(np.full(size, 0.5)) for size in sizes)) == 1.0
    assert grains.rank_sum(pd.Series([1.0, 2.0, 3.0]), pd.Series([4.0, 5.0, 6.0])) == pytest.approx(0.1)  # 2 of the 20 orders


def test_a_true_difference_is_found_with_its_size():
    jumps, others = (series(np.random.default_rng(seed), 15, 100, 0.3) for seed in (3, 4))
    found = grains.compare(made(jumps.assign(height=jumps["height"] + 0.5)), made(others)).set_index("quantity").loc["height"]
    assert found["difference"] == pytest.approx(0.5, abs=4 * found["standard_error"])
    assert found["standard_error"] == pytest.approx(math.sqrt(2.0 * 1.3 / 0.7 / 1500), rel=0.15)
    assert (found["mean_with"], found["sd_with"], found["jumps_with"]) == (jumps["height"].mean() + 0.5, pytest.approx(jumps["height"].std()), 1500)
    assert found["p_bootstrap"] < 1e-6
    assert found["p_wilcoxon"] < 1e-6


def test_the_rank_sum_test_sees_differences_in_correlated_jumps_where_there_are_none():
    """Of pairs of runs alike, the share that each test calls different at 5 %."""
    small = {"bootstrap": 0, "wilcoxon": 0}
    for seed in range(40):
        one, two = (made(series(np.random.default_rng((seed, side)), 4, 150, 0.9)) for side in (0, 1))
        found = grains.compare(one, two).set_index("quantity").loc["height"]
        small = {name: count + (found[f"p_{name}"] < 0.05) for name, count in small.items()}
    assert small["wilcoxon"] >= 15  # sd of the mean is √19 times what it takes it for: 65 %
    assert small["bootstrap"] <= 9


def test_without_jumps_that_count_there_is_no_comparison():
    found = grains.compare(made(discard=5), made(discard=5))
    assert found[["difference", "standard_error", "p_bootstrap", "p_wilcoxon"]].isna().all(axis=None)


def test_two_impacts_without_a_flight_between_them_are_no_jump():
    """As of a grain that is hit from above while it leaves the bed: an impact, with neither velocity nor spin."""
    jumps = pd.DataFrame({"grain": [0, 0, 0], "duration": [1.0, 0.0, 2.0], "velocity": [3.0, np.inf, 5.0]})
    result = made(jumps)
    assert result.jumps["velocity"].tolist() == [3.0, 5.0]
    assert result.frequencies()["bed"] == 3 / result.time


# Encounters


def test_changes_of_angles_velocities_and_spins():
    rows = np.zeros((1, len(COLUMNS)))
    given = {"first": 3, "second": 7, "first_u": 1.0, "first_u_after": 1.0, "first_w_after": 1.0, "first_spin_y": 1.0, "first_spin_y_after": -1.0}
    turned = np.radians(170.0)
    given |= {"second_u": np.cos(turned), "second_v": np.sin(turned), "second_u_after": np.cos(turned), "second_v_after": -np.sin(turned)}
    for name, value in given.items():
        rows[0, COLUMNS.index(name)] = value
    found = grains.changes(made(met=encounter_table(rows)))
    assert found["grain"].tolist() == [3, 7]
    assert found["angle_xz"].to_numpy() == pytest.approx([45.0, 0.0])
    assert found["angle_xy"].to_numpy() == pytest.approx([0.0, 20.0])  # from 170° to 190°, not by −340°
    assert found["w"].tolist() == [1.0, 0.0]
    assert found["v"].to_numpy() == pytest.approx([0.0, -2.0 * np.sin(turned)])
    assert found["spin_y"].tolist() == [-2.0, 0.0]


def test_encounters_that_parted_slowly_are_left_out():
    """They part faster than e lets them: the restitution that was applied is above e."""
    rows = np.zeros((2, len(COLUMNS)))
    e = cloud().options("encounters").restitution
    for row, applied, grain in zip(rows, (e, 1.7), (0, 2), strict=True):
        row[[COLUMNS.index(name) for name in ("first", "second", "restitution", "first_u_after")]] = grain, grain + 1, applied, 1.0
    result = made(met=encounter_table(rows))
    assert grains.changes(result)["grain"].tolist() == [0, 1]
    assert grains.changes(result, slow=True)["grain"].tolist() == [0, 1, 2, 3]


def test_a_distribution():
    found = grains.distribution(pd.DataFrame({"grain": [1, 2, 3], "u": [-1.0, 0.0, 4.0]})).iloc[0]
    assert found.tolist() == ["u", 1.0, pytest.approx(math.sqrt(7.0)), pytest.approx(5.0 / 3.0), pytest.approx(math.sqrt(13.0 / 3.0)), 1.0, 3]


@pytest.fixture(scope="module")
def meeting():
    result = saltation.run(cloud(run={"duration": 1.0}))
    assert len(result.encounters) > 2
    return result


def test_two_grains_exchange_momentum_and_turn_alike(meeting):
    """The impulse on one is the opposite of that on the other; it acts at the same point of contact, which turns both the same way."""
    found = grains.changes(meeting, slow=True)
    first, second = found.iloc[::2].reset_index(drop=True), found.iloc[1::2].reset_index(drop=True)
    assert first["grain"].tolist() == meeting.encounters["first"].tolist()
    for name in ("u", "v", "w"):
        assert (first[name] + second[name]).abs().max() < 1e-13
    for name in ("spin_x", "spin_y", "spin_z"):
        assert (first[name] - second[name]).abs().max() < 1e-12


# Spreading

TIMES = np.arange(0.0, 500.0, 0.25)


@pytest.fixture(scope="module")
def known():
    """40 grains of constant speeds along the stream that walk at random across it, and one that leaves."""
    rng = np.random.default_rng(5)
    x = 6.0 * TIMES[:, None] + rng.standard_normal(41) * TIMES[:, None]
    y = 7.0 * np.arange(41) + np.cumsum(rng.standard_normal((len(TIMES), 41)), axis=0)
    x[1000:, 40] = y[1000:, 40] = np.nan
    return made(path=paths(TIMES, x, y))


def test_constant_speeds_are_ballistic_and_random_walks_diffuse(known):
    found = grains.exponents(known).set_index(["ensemble", "axis", "range"])
    along = found.xs("x", level="axis")[["gamma", "lower", "upper"]].dropna()
    assert len(along) >= 4  # the local range holds no three samples
    assert along.to_numpy() == pytest.approx(1.0, abs=1e-9)
    across = found.xs("y", level="axis").dropna()
    assert ((across["lower"] <= 0.5) & (across["upper"] >= 0.5)).all()
    assert found.loc[("all", "y", "intermediate"), "gamma"] == pytest.approx(0.5, abs=0.05)
    assert (found.loc["first"]["low"] >= 0.25).all()
    assert found.loc[("first", "x", "intermediate"), ["low", "high"]].tolist() == [2.0, 20.0]  # jumps of unit duration


def test_the_ensemble_holds_the_grains_that_stay(known):
    lags, members, releases = grains.ensemble(known)
    assert (members.shape, releases) == ((40, len(lags), 2), 1)
    assert (lags[0], lags[-1]) == (0.25, TIMES[-1])
    assert np.allclose(members[:, :, 0], members[:, :1, 0] * lags / lags[0])
    lags, members, releases = grains.ensemble(known, again=True)
    assert members.shape == (40 * releases, len(lags), 2)
    assert releases > 50
    assert lags[-1] == pytest.approx(TIMES[-1] / 3.0)


def test_what_does_not_spread_has_no_exponent_and_what_stops_has_zero():
    speed = np.random.default_rng(6).standard_normal(20)
    moving = np.minimum(TIMES, 1.0)[:, None] * speed
    found = grains.exponents(made(path=paths(TIMES, np.zeros((len(TIMES), 20)), moving))).set_index(["ensemble", "axis", "range"])
    assert found.xs("x", level="axis")["gamma"].isna().all()
    assert found.loc[("first", "y", "intermediate"), ["gamma", "lower", "upper"]].tolist() == pytest.approx([0.0] * 3, abs=1e-12)
    assert found.loc[("first", "y", "global"), "gamma"] == pytest.approx(0.0, abs=1e-12)


def test_a_run_too_short_to_spread():
    with pytest.raises(ValueError, match="ensemble needs a longer run with jumps that count"):
        grains.ensemble(made(path=paths(TIMES[:2], np.zeros((2, 3)), np.zeros((2, 3))), discard=1), again=True)


def test_without_encounters_and_scatter_of_the_bed_nothing_drives_grains_across():
    """Drag and friction only slow what the start gave: no grain is ever faster across than it set out."""
    path = saltation.run(cloud(False, bed={"span_scatter": False}, run={"duration": 1.0})).trajectory
    speed = np.abs(path["v"].to_numpy())
    assert (speed <= speed[0] * (1.0 + 1e-9)).all()
    assert (speed[-1] < 0.1 * speed[0]).all()


def shares(neither, encounters, bed, both, count=2000):
    """Of four ensembles of normal displacements of these variances, two lags alike."""
    variances = {(False, False): neither, (False, True): encounters, (True, False): bed, (True, True): both}
    rng = np.random.default_rng(8)
    return grains.shares_across({key: math.sqrt(value) * rng.standard_normal((count, 2)) for key, value in variances.items()})


def test_sources_that_act_independently_are_told_apart():
    """Variances 3 by the bed and 1 by encounters, on 0.1 of the start: three quarters are the bed's."""
    found = shares(0.1, 1.1, 3.1, 4.1)
    assert (found["bed"] + found["encounters"]).to_numpy() == pytest.approx(1.0, abs=1e-15)
    assert ((found["lower"] < 0.75) & (found["upper"] > 0.75)).all()
    assert (found["upper"] - found["lower"]).max() < 0.1


def test_what_only_both_do_is_shared_equally():
    found = shares(1e-6, 1e-6, 1e-6, 1.0)
    assert found["bed"].to_numpy() == pytest.approx(0.5, abs=1e-4)


def test_shares_of_nothing_are_refused():
    with pytest.raises(ValueError, match=r"members must hold runs with and without each .* got none for \(bed, encounters\) = \(True, False\)"):
        grains.shares_across({(False, False): np.ones((3, 1)), (False, True): np.ones((3, 1))})
    with pytest.raises(ValueError, match="there is nothing to share"):
        shares(2.0, 1.0, 1.0, 1.0)


def test_planes_tilted_to_either_side_spread_grains_across_and_those_that_follow_the_grain_do_not():
    """R7's from rest across; by the contact relation a grain without speed across is never given any."""
    spread = {}
    for roughness in ("R5", "R7"):
        bed = {"roughness": roughness, "span_scatter": True}
        path = saltation.run(cloud(False, bed=bed, cloud={"spread": 0.0}, run={"duration": 2.0})).trajectory
        spread[roughness] = float((path["y"] - path["y"][0]).to_numpy()[-1].std())
    assert spread["R5"] == 0.0 and spread["R7"] > 1.0


# How many jumps


def test_means_of_the_first_jumps_of_one_grain():
    """Heights 0, 1, …: without the first ten the mean of a hundred is 54.5, with the deviation of 90 whole numbers."""
    found = grains.first_means(pd.DataFrame({"height": np.arange(517.0), "length": 1.0}), (100, 517, 600)).set_index("jumps")
    assert found.index.tolist() == [100, 517]
    assert found["height"].tolist() == [54.5, 263.0]
    assert found.loc[100, "height_sd"] == pytest.approx(math.sqrt((90**2 - 1) / 12.0 * 90 / 89), rel=1e-12)
    assert found["length_sd"].tolist() == found["length_se"].tolist() == [0.0, 0.0]


def test_fig_4_3_a_hundred_jumps_tell_the_mean_of_517():
    scene = thesis.single_grain(73.0, 2.0)
    assert "encounters" not in scene.names and scene.cloud is None and scene.bed.span_scatter
    found = grains.first_means(saltation.run(scene).jumps).set_index("jumps")
    assert found.index.tolist() == [100, 150, 200, 517]
    for name in ("height", "length"):
        assert abs(found.loc[100, name] - found.loc[517, name]) < 3.0 * found.loc[100, f"{name}_se"]
        assert found.loc[100, f"{name}_sd"] == pytest.approx(found.loc[517, f"{name}_sd"], rel=0.15)


def test_means_of_the_first_jumps():
    rng = np.random.default_rng(7)
    jumps = pd.concat([pd.DataFrame({"grain": grain, "height": rng.standard_normal(count)}) for grain, count in enumerate([210] * 60 + [20])])
    found = grains.convergence(made(jumps.reset_index(drop=True), discard=10), (10, 50, 200, 201)).set_index("jumps")
    assert found["grains"].tolist() == [61, 60, 60, 0]
    first = jumps.groupby("grain").nth(range(10, 60))
    assert found.loc[50, "height"] == pytest.approx(first[first["grain"] < 60]["height"].mean(), rel=1e-12)
    for count in (10, 50, 200):
        assert found.loc[count, "height_scatter"] == pytest.approx(count**-0.5, rel=0.3)
        assert found.loc[count, "height_sd"] == pytest.approx(1.0, rel=0.1)
    assert math.isnan(found.loc[201, "height"])


# All of it


def test_all_tables_carry_the_labels_of_their_runs(known):
    table = pd.DataFrame([LABELS | {"name": name, "encounters": name == "a", "bed_frequency": 1.0, "pair_frequency": 0.5} for name in ("a", "b")])
    opened = []

    def open_one(name):
        opened.append(name)
        return known

    found = grains.analyses(table, open_one)
    assert opened == ["a", "b"]
    assert set(found) == {"table_4_2", "comparison", "changes", "exponents", "convergence"}
    for rows in found.values():
        assert rows[grains.RUN].drop_duplicates().to_numpy().tolist() == [[0.0233, 73.0, 2.0]]
    exponents = found["exponents"]
    assert len(exponents) == 2 * 2 * 2 * 3
    printed = exponents[exponents["ensemble"] == "first"].set_index(["axis", "encounters", "range"])["printed"]
    assert printed["y", True, "intermediate"] == 0.6
    assert printed["y", False, "global"] == 0.0
    elsewhere = grains.analyses(table.assign(stage=2.5), open_one)["exponents"]
    assert elsewhere["printed"].isna().all()
