"""Which effects a scene calls for: told by its numbers, measured by leaving out, chosen within a tolerance; what other choices do."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scene_cases import merged

import saltation
from saltation import cli, front
from saltation._keys import key_of, text_of
from saltation.effects import EFFECTS
from saltation.effects.drag import LAWS
from saltation.plots import choices as advice_plots
from saltation.results.files import RUN_FIELDS, run_json_of
from saltation.results.folder import begun
from saltation.scene import SceneError, scene_of, shipped
from saltation.study import cases, choices
from saltation.study import effects as advice
from saltation.study.thesis import case
from saltation.workers import SerialExecutor

PLAIN = {  # three numbers of state and no memory: quick to compile
    "effects": ["weight", "drag", "lift"],
    "dimensions": 2,
    "history": None,
    "bed": {"rebound": "garcia_nino", "roughness": "R7", "friction": None, "tangential_retention": 0.89},
    "run": {"jumps": 10, "discard": 2, "trajectory": False, "longest_flight": 20.0},
}


def plain(**changes):
    return scene_of(merged(merged(case("sand"), PLAIN), changes))


def share(scene, effect):
    return next(row for row in advice.advise(scene) if row.effect == effect).share


class TestAdvise:
    """The estimates scale as the forces do."""

    def test_every_effect_has_a_verdict_a_reason_and_its_source(self):
        for name in shipped():
            rows = advice.advise(saltation.load(name))
            assert [row.effect for row in rows] == list(EFFECTS)
            assert all(row.reason and row.source == EFFECTS[row.effect].SOURCE for row in rows)
            assert all(row.share >= 0.0 for row in rows)

    def test_sand_calls_for_history_and_magnus_and_gravel_less_for_history(self):
        told = {name: {row.effect: row for row in advice.advise(scene_of(case(name)))} for name in ("sand", "gravel")}
        assert told["sand"]["history"].verdict == told["sand"]["magnus"].verdict == "keep"
        assert told["gravel"]["history"].verdict != "keep"
        assert told["sand"]["weight"].verdict == told["gravel"]["weight"].verdict == "needed"

    @pytest.mark.parametrize(
        ("name", "values", "calls"),
        [
            ("sand", (72.92, 79.88, 39.94), (True, True, False)),
            ("sand_coarse", (250.3, 353.9, 177.0), (False, True, False)),
            ("gravel", (20905.0, 37098.0, 18549.0), (False, False, False)),
        ],
    )
    def test_published_thresholds_of_the_history_force(self, name, values, calls):
        """R_p, w_s d/ν and w_s a/ν, by hand: drag balances weight at that w_s, C_D Re² = 4R_p²/3."""
        scene = scene_of(case(name))
        found = advice.thresholds(scene)
        assert [row.value for row in found] == pytest.approx(values, rel=1e-3)
        assert tuple(row.calls for row in found) == calls
        reynolds = found[1].value
        assert LAWS["yen"].factor(reynolds) * 24.0 * reynolds == pytest.approx(4.0 / 3.0 * found[0].value ** 2, rel=1e-9)
        told = next(row.reason for row in advice.advise(scene) if row.effect == "history")
        assert f"{sum(calls)} of 3 published thresholds call for it" in told

    def test_what_does_not_settle_has_no_thresholds(self):
        assert advice.thresholds(plain(effects=["weight"])) == []

    def test_history_grows_as_the_root_of_the_viscosity(self):
        """In still water the typical jump does not depend on it."""
        thin, thick = (scene_of(merged(saltation.load("settling").model_dump(exclude_none=True), {"fluid": {"viscosity": nu}})) for nu in (1e-6, 9e-6))
        assert share(thick, "history") == pytest.approx(3.0 * share(thin, "history"), rel=1e-12)

    def test_added_mass_is_its_share_of_the_inertia(self):
        heavy = plain(effects=["weight", "drag", "added_mass"], grain={"density": 4500.0})
        assert share(heavy, "added_mass") == pytest.approx(0.5 / (4.5 + 0.5), rel=1e-12)

    def test_a_fall_through_the_typical_height_takes_half_the_typical_time(self):
        scene = saltation.load("sand")
        jump, numbers = advice.typical(scene), scene.numbers
        fall = numbers.alpha / numbers.shields
        assert jump.rise == pytest.approx(fall * jump.duration / 2.0, rel=1e-12)
        assert jump.height == pytest.approx(jump.rise**2 / (2.0 * fall), rel=1e-12)

    def test_more_grains_meet_more_often(self):
        content = saltation.load("sand_cloud").model_dump(exclude_none=True)
        thin, dense = (share(scene_of(merged(content, {"cloud": {"concentration": c, "number": 400}})), "encounters") for c in (0.001, 0.01))
        assert dense == pytest.approx(10.0 * thin, rel=1e-12)
        assert share(saltation.load("sand"), "encounters") == 0.0


def table_of(**rows):
    """A table as of a campaign: H, L, ū (of each its relative standard error 0.1 %) and a status."""
    lines = {}
    for name, (status, *means) in rows.items():
        line = {"status": status, "jumps": 1000}
        for quantity, mean in zip(cases.VARIABLES, means, strict=True):
            line |= {quantity: mean, f"{quantity}_se": 0.001 * mean}
        lines[name] = line
    return pd.DataFrame(lines).T.infer_objects()


class TestCompare:
    """Changes and their errors."""

    def test_changes_are_relative_and_errors_add_in_squares(self):
        found = cases.compare(table_of(full=("finished", 2.0, 10.0, 5.0), lift=("finished", 1.5, 10.0, 6.0)))
        assert found.loc["lift", "height_change"] == pytest.approx(-0.25)
        assert found.loc["lift", "velocity_change"] == pytest.approx(0.2)
        assert found.loc["lift", "height_error"] == pytest.approx(0.75 * math.sqrt(2.0) * 0.001)  # of a ratio: relative errors add in squares
        assert advice.change_bound(found.loc["lift"]) == pytest.approx(0.25 + 1.96 * 0.75 * math.sqrt(2.0) * 0.001)
        assert found.loc["full", "height_error"] == pytest.approx(0.001) and found.loc["full", "height_change"] == 0.0

    def test_the_error_is_that_of_a_ratio_of_means(self):
        """Against many repetitions with known errors."""
        random = np.random.default_rng(1)
        ratios = random.normal(1.5, 0.015, 20_000) / random.normal(0.5, 0.02, 20_000)
        rows = table_of(full=("finished", 0.5, 1.0, 1.0), lift=("finished", 1.5, 1.0, 1.0))
        rows.loc["full", "height_se"], rows.loc["lift", "height_se"] = 0.02, 0.015
        assert cases.compare(rows).loc["lift", "height_error"] == pytest.approx(ratios.std(), rel=0.05)

    def test_a_run_that_does_not_finish_bounds_nothing(self):
        found = cases.compare(table_of(full=("finished", 2.0, 10.0, 5.0), drag=("at rest", 2.0, 10.0, 5.0)))
        assert advice.change_bound(found.loc["drag"]) == math.inf
        assert advice.bound_or_reason(found.loc["drag"]) == "at rest"


class TestChoose:
    """The rule, on made-up means: each effect adds what it says, jointly they add up."""

    DOES: ClassVar = {"added_mass": 0.03, "lift": 0.01, "history": 0.2, "magnus": -0.5, "rotation": 0.3}

    @pytest.fixture
    def flown(self, monkeypatch):
        """A campaign that knows the answer; returns the sets that were flown."""
        tried = []

        def campaign(scenes, executor=None, *, progress=None):
            rows = []
            for labels, scene in scenes:
                tried.append(scene.names)
                missing = [name for name in saltation.load("sand").names if name not in scene.names]
                mean = 1.0 + sum(self.DOES.get(name, 0.0) for name in missing)
                row = {"case": labels["case"], "jumps": scene.run.jumps - scene.run.discard, "status": "at rest" if "drag" in missing else "finished"}
                rows.append(row | dict.fromkeys(cases.VARIABLES, mean) | {f"{name}_se": 1e-4 for name in cases.VARIABLES})
            return pd.DataFrame(rows)

        monkeypatch.setattr(cases, "campaign", campaign)
        return tried

    def test_what_changes_less_than_the_tolerance_is_left_out_together(self, flown):
        made = advice.choose(saltation.load("sand"), 0.05)
        assert set(made.chosen.left_out) == {"lift", "added_mass"}
        assert made.names == ("weight", "drag", "history", "magnus", "rotation") == tuple(made.chosen.kept)
        assert made.chosen.bounds["drag"] == "at rest"
        assert made.chosen.tried[-1]["bound"] == pytest.approx(0.04, abs=1e-3)

    def test_what_is_too_much_together_puts_the_largest_back(self, flown):
        made = advice.choose(saltation.load("sand"), 0.035)
        assert made.chosen.left_out == ["lift"]
        assert [set(step["left_out"]) for step in made.chosen.tried] == [{"lift", "added_mass"}]  # of lift alone the ablation has told
        assert made.chosen.chosen["height"] == pytest.approx(1.01)

    def test_a_tight_tolerance_keeps_everything(self, flown):
        made = advice.choose(saltation.load("sand"), 0.005)
        assert made.chosen.left_out == [] and set(made.names) == set(saltation.load("sand").names)
        assert made.chosen.full == made.chosen.chosen

    def test_what_nothing_needs_any_more_goes_too(self, flown, monkeypatch):
        """Where Magnus alone reads the spin, rotation can only be left out after it."""
        monkeypatch.setitem(self.DOES, "magnus", 0.001)
        monkeypatch.setitem(self.DOES, "rotation", 0.0)
        bed = {"rebound": "garcia_nino", "friction": None, "tangential_retention": 0.89}
        made = advice.choose(scene_of(merged(saltation.load("sand").model_dump(exclude_none=True), {"bed": bed})), 0.005)
        assert "rotation" not in made.chosen.bounds
        assert set(made.chosen.left_out) == {"magnus", "rotation"}

    def test_what_is_undecided_is_flown_on(self, flown, monkeypatch):
        """With 4 % of the tolerance to spare and a standard error of as much, only more jumps can tell."""
        known, asked = cases.campaign, []

        def rough(scenes, *given, **more):
            asked.append({labels["case"]: scene.run.jumps for labels, scene in scenes})
            found = known(scenes, *given, **more)
            return found.assign(**{f"{name}_se": 0.02 / np.sqrt(found["jumps"] / cases.PILOT) for name in cases.VARIABLES})

        monkeypatch.setattr(cases, "campaign", rough)
        monkeypatch.setitem(self.DOES, "lift", 0.17)
        monkeypatch.setitem(self.DOES, "added_mass", 0.0)
        monkeypatch.setitem(self.DOES, "history", 0.5)
        made = advice.choose(saltation.load("sand"), 0.2)
        assert set(made.chosen.left_out) == {"lift", "added_mass"}
        assert asked[1] == {"full": 1620, "lift": 1620}
        assert made.chosen.jumps == sum(sum(jumps.values()) for jumps in asked)

    def test_what_lies_at_the_tolerance_seldom_goes(self, flown, monkeypatch):
        """2.5 % at each look, and it is looked at three times at most."""
        known, random = cases.campaign, np.random.default_rng(7)

        def noisy(scenes, *given, **more):
            found = known(scenes, *given, **more)
            errors = 0.03 / np.sqrt(found["jumps"] / cases.PILOT)
            means = found["height"] + errors * random.standard_normal(len(found))
            return found.assign(**dict.fromkeys(cases.VARIABLES, means), **{f"{name}_se": errors for name in cases.VARIABLES})

        monkeypatch.setattr(cases, "campaign", noisy)
        for name in self.DOES:
            monkeypatch.setitem(self.DOES, name, 0.2 if name == "lift" else 0.6)
        scene = saltation.load("sand")
        gone = sum("lift" in advice.choose(scene, 0.2).chosen.left_out for _ in range(100))
        assert gone <= 15  # 7.5 of 100 at most are meant; 16 or more then happen once in 300

    def test_every_jump_flown_is_counted(self, flown):
        made = advice.choose(saltation.load("sand"), 0.05)
        assert made.chosen.jumps == 9 * 420  # all, seven with one left out, one with two

    def test_a_scene_that_does_not_finish_keeps_its_effects(self, flown, monkeypatch):
        without = cases.campaign
        monkeypatch.setattr(cases, "campaign", lambda *given, **more: without(*given, **more).assign(status="at rest"))
        made = advice.choose(saltation.load("sand"), 0.05)
        assert made.chosen.status == "at rest" and made.chosen.left_out == [] and len(made.names) == 7

    @pytest.mark.parametrize("tolerance", [0.0, -1.0, 0.6, math.nan])
    def test_a_tolerance_out_of_range_is_refused(self, tolerance):
        with pytest.raises(ValueError, match="tolerance must be above 0"):
            advice.choose(saltation.load("sand"), tolerance)

    def test_the_scene_s_own_tolerance_is_taken(self, flown):
        made = advice.choose(scene_of(saltation.load("sand").model_dump(exclude_none=True) | {"effects": "auto", "tolerance": 0.035}))
        assert made.chosen.tolerance == 0.035 and made.chosen.left_out == ["lift"]
        assert set(made.chosen.bounds) == set(saltation.load("sand").names)

    def test_weight_is_never_left_out(self, flown):
        assert "weight" in advice.choose(saltation.load("sand"), 0.5).names

    def test_jumps_are_enough_for_the_error(self, monkeypatch, flown):
        monkeypatch.setattr(cases, "PILOT", 400)
        seen = []
        monkeypatch.setattr(cases, "with_jumps", lambda scene, jumps: seen.append(jumps) or scene)
        cases.fly_to_error({"full": saltation.load("sand")}, 0.5e-5, None, None)  # a standard error of 1e-4 after 400 jumps
        assert seen == [400, cases.MOST]
        cases.fly_to_error({"full": saltation.load("sand")}, 5e-5, None, None)
        assert seen[2:] == [400, 1600]


EVIDENCE = {
    "of": "x", "tolerance": 0.05, "status": "finished", "kept": ["weight"], "left_out": ["drag"],
    "full": {}, "chosen": {}, "bounds": {"drag": 0.01}, "tried": [], "jumps": 1,
}  # fmt: skip


class TestAuto:
    """effects = "auto": measured, recorded, the same everywhere."""

    @pytest.fixture(autouse=True)
    def quick(self, monkeypatch):
        monkeypatch.setattr(cases, "PILOT", 8)
        monkeypatch.setattr(cases, "MOST", 8)
        yield

    @pytest.fixture
    def three(self, monkeypatch):
        """All effects there are: three."""
        from saltation.scene import model as module

        monkeypatch.setattr(module, "ALL", ("weight", "drag", "lift"))
        return plain(effects="auto", tolerance=0.5)

    def test_a_run_is_that_of_the_chosen_effects_and_keeps_the_evidence(self, three, tmp_path):
        result = saltation.run(three)
        assert result.scene.chosen.tolerance == 0.5
        assert result.scene.names == tuple(result.scene.chosen.kept)
        named = saltation.run(plain(effects=list(result.scene.names)))
        pd.testing.assert_frame_equal(result.jumps, named.jumps, check_exact=True)
        result.save(tmp_path / "auto.nc")
        assert saltation.open(tmp_path / "auto.nc").scene.chosen == result.scene.chosen

    def test_an_explicit_tolerance_is_no_hindrance(self, three):
        made = advice.choose(three, executor=SerialExecutor())
        assert set(made.chosen.bounds) == {"weight", "drag", "lift"}
        assert made.chosen.left_out == ["lift"]

    def test_a_campaign_chooses_once_and_goes_on_with_it(self, three, tmp_path, monkeypatch):
        chosen = []
        monkeypatch.setattr(front, "choose", lambda scene, *rest: chosen.append(scene) or advice.choose(scene, *rest))
        scenes = [({"name": name}, three) for name in "ab"]
        first = saltation.campaign(scenes, SerialExecutor(), store=tmp_path)
        again = saltation.campaign(scenes, SerialExecutor(), store=tmp_path)
        assert len(chosen) == 1
        pd.testing.assert_frame_equal(first, again, check_exact=True)

    def test_a_run_in_a_folder_goes_on_with_its_choice(self, tmp_path, monkeypatch):
        auto = scene_of(merged(saltation.load("sand_cloud").model_dump(exclude_none=True), {"effects": "auto"}))
        assert begun(auto, tmp_path) is None
        made = auto.changed(effects=["weight"], chosen=EVIDENCE | {"of": key_of(auto)}, encounters=None)
        (tmp_path / "run.json").write_text(run_json_of(dict.fromkeys(RUN_FIELDS) | {"scene": json.loads(text_of(made))}))
        assert begun(auto, tmp_path) == made
        assert begun(auto.changed(run={"seed": 2}), tmp_path) is None

    def test_evidence_belongs_to_its_effects(self):
        scene = saltation.load("sand")
        made = scene.changed(chosen=EVIDENCE | {"kept": list(scene.names)})
        assert cases.without(made, ["lift"]).chosen is None
        with pytest.raises(SceneError, match="chosen records how effects"):
            scene.changed(chosen=EVIDENCE)

    def test_arguments_are_looked_at_first(self, three, monkeypatch):
        monkeypatch.setattr(front, "choose", lambda *_, **__: pytest.fail("chosen before"))
        with pytest.raises(ValueError, match="executor needs a multi-grain scene"):
            saltation.run(three, executor=SerialExecutor())
        with pytest.raises(ValueError, match="results need a label 'name'"):
            saltation.campaign([three], SerialExecutor(), results="nowhere")

    def test_the_same_choice_and_row_on_any_workers(self, three):
        here = saltation.campaign([({"name": "auto"}, three)], SerialExecutor())
        assert saltation.run(three).summary().loc["height", "mean"] == here["height"].iloc[0]
        with ThreadPoolExecutor(2) as executor:
            evidence = advice.choose(plain(), 0.5, executor).chosen
        assert evidence == advice.choose(plain(), 0.5, SerialExecutor()).chosen

    def test_a_tolerance_needs_auto_and_auto_a_bed(self):
        with pytest.raises(SceneError, match="tolerance belongs to effects = 'auto'"):
            scene_of(saltation.load("sand").model_dump(exclude_none=True) | {"tolerance": 0.1})
        with pytest.raises(SceneError, match=r"effects = 'auto' needs a \[bed\]"):
            scene_of(saltation.load("settling").model_dump(exclude_none=True) | {"effects": "auto"})
        for function in (advice.ablate, advice.choose, choices.uncertainty, choices.combinations):
            with pytest.raises(SceneError, match="bed is missing"):
                function(saltation.load("settling"))


class TestOtherChoices:
    """What measurement has not settled."""

    def test_a_preset_is_written_out(self):
        made = cases.with_listed_effects(
            scene_of(merged(saltation.load("sand").model_dump(exclude_none=True), {"effects": "nino_garcia_1994", "rotation": None}))
        )
        assert made.in_plane and made.options("rotation").law == "prescribed"
        assert list(made.names) == made.effects
        assert all(case.in_plane and case.options("rotation").law == "prescribed" for case in advice.reduced(made).values())

    def test_a_longer_run_has_a_memory_as_long(self):
        made = saltation.load("sand").changed(history={"horizon": 500.0})
        assert cases.with_jumps(made, 2000).horizon == saltation.load("sand").horizon / 220 * 2020

    def test_a_grain_as_heavy_as_its_fluid_has_no_typical_jump(self):
        made = plain(grain={"density": 1000.0}, channel={"transport_stage": None, "shear_velocity": 0.03})
        with pytest.raises(SceneError, match=r"grain\.density must differ"):
            advice.advise(made)

    def test_each_variant_differs_in_one_choice_and_holds_the_scene_s_own(self):
        scene = saltation.load("sand")
        found = choices.variants(scene)
        assert list(found) == ["profile", "reading", "restitution", "kernel", "rebound memory"]
        for values in found.values():
            assert sum(made == scene for made in values.values()) == 1
        assert "reichardt" not in found["profile"]  # k_s+ = 18: not smooth
        assert "reichardt" in choices.variants(scene_of(merged(scene.model_dump(exclude_none=True), {"fluid": {"viscosity": 1e-5}})))["profile"]

    def test_what_measured_bounces_reject_is_no_open_choice_but_where_the_scene_has_it(self):
        scene = saltation.load("sand")
        assert list(choices.variants(scene)["rebound memory"]) == ["impulse", "restart"]
        assert list(choices.variants(scene.changed(history={"rebound": "reset"}))["rebound memory"]) == ["impulse", "restart", "reset"]

    def test_without_history_there_is_no_memory_to_choose(self):
        assert list(choices.variants(plain())) == ["profile", "reading", "restitution"]

    def test_spreads_are_over_what_finishes(self):
        table = table_of(a=("finished", 2.0, 10.0, 5.0), b=("finished", 1.0, 10.0, 5.0), c=("finished", 3.0, 10.0, 6.0), d=("at rest", 0.1, 0.1, 0.1))
        table.insert(0, "choice", ["scene", "reading", "reading", "reading"])
        (row,) = choices.spreads(table).to_dict("records")
        assert (row["height_low"], row["height_high"], row["velocity_high"]) == (0.5, 1.5, 1.2)

    def test_shares_of_a_product_add_up_to_one(self):
        """H = a(profile) b(reading): logarithms add, so there is no interplay."""
        rows = [
            {"profile": p, "reading": r, "status": "finished", "height": a * b, "length": a, "velocity": b**2}
            for p, a in (("x", 1.0), ("y", 2.0), ("z", 5.0))
            for r, b in (("k", 1.0), ("l", 3.0))
        ]
        found = choices.shares(pd.DataFrame(rows))
        assert np.allclose(found["height"].sum(), 1.0, rtol=1e-12)
        assert found.loc["profile", "length"] == pytest.approx(1.0) and found.loc["reading", "length"] == pytest.approx(0.0, abs=1e-15)
        a, b = np.log([1.0, 2.0, 5.0]).var(), np.log([1.0, 3.0]).var()
        assert found.loc["profile", "height"] == pytest.approx(a / (a + b))

    def test_all_combinations_are_flown(self, monkeypatch):
        seen = []

        def campaign(scenes, executor=None, *, progress=None):
            seen.extend(scenes)
            return pd.DataFrame([{**labels, "status": "finished"} | dict.fromkeys(cases.VARIABLES, 1.0) for labels, _ in scenes])

        monkeypatch.setattr(choices, "campaign", campaign)
        table = choices.combinations(saltation.load("sand"))
        found = choices.variants(saltation.load("sand"))
        assert len(table) == math.prod(map(len, found.values())) == len({scene.model_dump_json() for _, scene in seen})
        labels, made = seen[-1]
        assert (made.channel.profile, made.bed.reading) == (labels["profile"], labels["reading"])
        assert (made.options("history").kernel, made.options("history").rebound) == (labels["kernel"], labels["rebound memory"])
        assert str(made.bed.restitution) == labels["restitution"]


def test_advise_prints_every_effect_with_its_source():
    out = CliRunner().invoke(cli.main, ["advise", "sand"])
    assert out.exit_code == 0
    assert all(name in out.stdout for name in EFFECTS)
    assert "Yamamoto" in out.stdout


MISTAKES = {
    "an error of nothing": (["ablate", "sand", "--error", "0"], ["--error", "between"]),
    "an output that is no table": (["ablate", "sand", "--output", "x.txt"], ["--output", ".csv"]),
    "no bed": (["ablate", "settling"], ["bed is missing"]),
    "no bed either": (["uncertainty", "settling"], ["bed is missing"]),
    "no scene": (["advise", "sant"], ["did you mean 'sand'"]),
    "a tolerance alone": (["run", "sand", "--set", "tolerance=0.1"], ["tolerance", "'auto'"]),
    "a tolerance of three": (["run", "sand", "--set", "effects=auto", "--set", "tolerance=3"], ["tolerance", "0.5"]),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_mistakes_are_one_sentence(case):
    arguments, words = MISTAKES[case]
    out = CliRunner().invoke(cli.main, arguments)
    assert out.exit_code == 2
    assert len(out.stderr.strip().splitlines()) == 1
    assert all(word in out.stderr for word in words)


def test_ablate_prints_draws_and_writes(tmp_path, monkeypatch):
    for module, name in ((cases, "PILOT"), (cases, "MOST"), (cases, "TIMED")):
        monkeypatch.setattr(module, name, 5)
    monkeypatch.setattr(cases, "campaign", lambda scenes, executor, progress=None: saltation.campaign(scenes, SerialExecutor(), progress=progress))
    file, arguments = tmp_path / "table.csv", []
    for name, value in (
        ("effects", "['weight', 'drag', 'lift']"),
        ("dimensions", "2"),
        ("bed.rebound", "garcia_nino"),
        ("bed.friction", ""),
        ("bed.roughness", "R7"),
        ("run.discard", "2"),
    ):
        arguments += ["--set", f"{name}={value}"]
    arguments += ["--set", "bed.tangential_retention=0.89", "--set", "history="]
    out = CliRunner().invoke(cli.main, ["ablate", "sand", *arguments, "--output", str(file)])
    assert out.exit_code == 0, out.output
    table = pd.read_csv(file, index_col=0)
    assert list(table.index) == ["full", "weight", "drag", "lift"]
    assert table.loc["full", "height_change"] == 0.0 and table.loc["full", "time"] == 1.0
    assert "without lift" in " ".join(label.get_text() for axes in advice_plots.ablation(table).axes for label in axes.get_yticklabels())
    again = CliRunner().invoke(cli.main, ["ablate", "sand", *arguments, "--output", str(file)])
    assert again.exit_code == 2 and "--force" in again.stderr


def test_force_takes_nothing_away_before_the_choice_is_made(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "run.json").write_text("{}")
    monkeypatch.setattr(front, "resolved", interrupted)
    out = CliRunner().invoke(cli.main, ["run", "sand_cloud", "--set", "effects=auto", "--output", str(tmp_path), "--force"])
    assert out.exit_code == 130 and "stopped" in out.stderr
    assert (tmp_path / "run.json").exists()
