"""Which history scheme a scene needs: the error is extrapolated as it was measured, the ranking follows error and time, the choice keeps what was asked for."""

import dataclasses
import doctest
import json
import math
import tomllib

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scene_cases import scene

import saltation
from basset import SCHEMES
from saltation import cli
from saltation.plots.schemes import schemes as diagram
from saltation.scene import SceneError, scene_of
from saltation.study import cases
from saltation.study import schemes as study
from saltation.study.schemes import Candidate, Entry, Sample
from saltation.study.thesis import case

WHOLE = Candidate("fixed_step", (("scheme", "exponential"), ("order", 2)))
CUT = Candidate("fixed_step", (("scheme", "windowed"), ("rule", "brush"), ("window", 1.0), ("tail", False)))


def seen(candidate, *sizes, slope, floor, order, scatter=0.0, grows=False):
    """A candidate whose three errors are slope·dtᵖ + floor and whose jumps take 2 µs and 3 µs per step of a jump 1 d/u* long."""
    samples = []
    for size in sizes:
        change = np.array(slope) * size**order + np.array(floor)
        samples.append(Sample(size, change, np.full(3, scatter), 2e-6 + 3e-6 / size, runs=2, timed=True))
    return Entry(candidate, grows, samples)


class TestExtrapolation:
    """Of errors A·dtᵖ + B and times a + b/dt that are known."""

    @pytest.mark.parametrize("order", [0.5, 1.0, 1.5])
    def test_the_order_and_the_error_of_what_drops_nothing(self, order):
        entry = seen(WHOLE, 0.04, 0.01, slope=(0.3, -0.2, 0.1), floor=(0.0, 0.0, 0.0), order=order)
        assert study.measured_order([entry]) == pytest.approx(order, rel=1e-12)
        told = entry.predicted(1e-4, order)
        assert told.change == pytest.approx(np.array([0.3, 0.2, 0.1]) * 1e-4**order, rel=1e-12)
        assert told.seconds == pytest.approx(2e-6 + 3e-2, rel=1e-9)

    def test_an_error_that_is_small_because_step_and_window_cancel_does_not_count_as_small(self):
        entry = seen(CUT, 0.04, 0.01, slope=(0.6, 0.0, 0.0), floor=(-0.06, 0.0, 0.0), order=0.5)
        assert entry.last.bound == pytest.approx(0.0, abs=1e-15)
        assert entry.bound(entry.last, 0.5) == pytest.approx(0.12, rel=1e-12)
        assert entry.predicted(1e-6, 0.5).bound == pytest.approx(0.06 + 0.6e-3, rel=1e-9)

    def test_one_step_of_a_window_tells_nothing(self):
        entry = seen(CUT, 0.04, slope=(0.0, 0.0, 0.0), floor=(0.0, 0.0, 0.0), order=0.5)
        assert entry.bound(entry.last, 0.5) == math.inf

    def test_a_memory_of_some_jumps_has_no_step_to_cancel_with(self):
        entry = seen(Candidate("collocation", (("scheme", "exponential"), ("window_jumps", 2))), 1e-2, slope=(0.0, 0.0, 0.0), floor=(0.03, 0.0, 0.0), order=1.0)
        assert entry.bound(entry.last, math.nan) == pytest.approx(0.03, rel=1e-12)

    def test_what_drops_a_part_says_nothing_about_the_order(self):
        assert study.measured_order([seen(CUT, 0.04, 0.01, slope=(1.0, 0.0, 0.0), floor=(0.1, 0.0, 0.0), order=1.0)], unknown=0.5) == 0.5

    def test_steps_are_rounded_down(self):
        assert [study.rounded(x) for x in (0.0456, 0.01, 1.2e-5, 99.9)] == [0.045, 0.01, 1.2e-5, 99.0]


def made(*rows):
    return pd.DataFrame([dict(zip(("error", "seconds", "keeps", "dt", "status"), row, strict=True)) for row in rows])


class TestRanking:
    """By the time of those that keep the error; the others by their error."""

    TABLE = made(
        (0.009, 3e-3, True, 1e-3, "finished"),
        (0.020, 1e-3, False, 2e-3, "finished"),
        (0.001, 2e-3, True, math.nan, "finished"),
        (math.inf, math.nan, False, 4e-3, "failed"),
        (0.015, 9e-3, False, 1e-3, "finished"),
    )

    def order(self, **asked):
        return study.ranking(self.TABLE, **asked)["error"].tolist()

    def test_at_an_error(self):
        assert self.order() == [0.001, 0.009, 0.015, 0.02, math.inf]

    def test_at_a_step(self):
        assert self.order(dt=1e-3) == [0.009, 0.015, 0.001, 0.02, math.inf]

    def test_within_a_time(self):
        assert self.order(budget=2.5e-3) == [0.001, 0.02, 0.009, 0.015, math.inf]


class Synthetic:
    """A scene that gives every candidate errors A·dt^½ + B and jumps of a + b/dt seconds: in place of `Trial`."""

    count, unit = 60, "d/u*"

    def __init__(self, known):
        self.known, self.flights = known, 0

    def say(self, text):
        """Nobody listens."""

    def accepts(self, candidate, size):
        return True

    def sample(self, entry, size, runs, jumps=None):
        self.flights += 1
        step, floor, once, each = self.known[entry.candidate]
        change = np.array([step * size**0.5 + floor, 0.0, 0.0])
        return Sample(size, change, 0.01 * np.abs(change), once + each / size, runs=runs)

    def decided(self, entry, size, error, most):
        return self.sample(entry, size, 2)

    def timed(self, pairs):
        for _, sample in pairs:
            sample.timed = True


def named(scheme, **words):
    return Candidate("fixed_step", (("scheme", scheme), *words.items()))


@pytest.mark.parametrize(("error", "best"), [(0.05, "daitche"), (0.006, "exponential")])
def test_the_ladder_finds_the_cheapest_of_known_errors_and_times(error, best):
    """What is quick on coarse steps loses on fine ones; a window without a tail has a floor above both errors; what is dearer and less exact goes at once."""
    known = {
        named("daitche"): (0.5, 0.0, 1e-6, 4e-6),
        named("exponential"): (0.4, 0.0, 4e-4, 2e-6),
        named("windowed", rule="brush", window=1.0, tail=False): (0.5, -0.06, 1e-7, 1e-7),
        **{named("brush", order=k): (0.6, 0.0, 1e-3 * k, 9e-6) for k in range(1, 20)},
    }
    exact = {c: once + each / (error / (1.0 + 0.0196) / step) ** 2 for c, (step, floor, once, each) in known.items() if not floor}
    assert min(exact, key=exact.get) == named(best)
    trial = Synthetic(known)
    entries = [Entry(candidate) for candidate in known]
    ladder = study.Ladder(trial, entries, dict.fromkeys(known, 0.04), error, None, math.inf)
    ladder.climb([0.04, 0.01, 0.0025, 0.000625], math.inf)
    ladder.confirm(math.inf)
    winner = ladder.ranked([entry for entry in entries if len(entry.samples) > 1])[0]
    assert winner.candidate == named(best) and ladder.order("fixed_step") == pytest.approx(0.5, rel=1e-6)
    kept = min(sample.seconds for sample in winner.samples if sample.bound <= error)
    assert exact[winner.candidate] <= kept * (1.0 + 1e-9) and kept <= 1.25 * exact[winner.candidate]  # two digits of dt, fourth roots of two
    assert trial.flights < 2.0 * len(known)


class TestCandidates:
    """All that the scene accepts, and nothing else."""

    @pytest.fixture(scope="class")
    def found(self):
        return study.candidates(scene_of(case("sand")), 1.5, 1e-3, [0.04])

    def test_every_scheme_and_solver_takes_part(self, found):
        named = {word for candidate in found for key, word in candidate.history if key in ("scheme", "rule")}
        assert named >= set(SCHEMES)
        assert {candidate.method for candidate in found} == {"collocation", "fixed_step", "runge_kutta_4"}

    def test_the_lines_for_the_scene_file_make_the_scene(self, found):
        sand = scene_of(case("sand"))
        content = sand.model_dump(exclude_none=True)
        for candidate, size in found.items():
            told = tomllib.loads(candidate.toml(size))
            written = scene_of({**content, "solver": told["solver"], "history": {"rebound": "impulse", "kernel": "basset", **told["history"]}})
            assert written.options("history") == sand.changed(**candidate.words(size)).options("history")

    def test_words_of_the_scene_s_own_scheme_do_not_stay(self):
        own = saltation.load("sand").changed(history={"window_jumps": 2})
        assert own.changed(**study.EXACT.words(1e-2)).options("history").window_jumps is None


@pytest.mark.parametrize(("rebound", "order"), [("impulse", 0.5), ("reset", 1.0)])
def test_the_measured_order_of_a_known_scheme(rebound, order):
    """A takeoff that is remembered starts as √t, which no degree removes: order 1/2; one that is forgotten leaves the impact's move to a node, order 1."""
    trial = study.Trial(scene("bouncing", history={"rebound": rebound}), None, lambda text: None)
    sizes = 8e-3 * 2.0 ** -np.arange(0.0, 5.1, 0.5)  # many: where between two nodes an impact falls is a matter of luck
    errors = [trial.sample(Entry(WHOLE), size, 1).largest for size in sizes]
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(order, abs=0.2)


@pytest.fixture(scope="module")
def chosen():
    lines = []
    return saltation.select_scheme(saltation.load("bouncing"), error=0.02, say=lines.append), lines


def test_the_example_holds(chosen, monkeypatch):
    """It is not run as a doctest: it is the choice above."""
    monkeypatch.setattr(saltation, "select_scheme", lambda scene, error: chosen[0] if error == 0.02 and scene == saltation.load("bouncing") else None)
    (found,) = doctest.DocTestFinder(recurse=False).find(study.select_scheme)
    for example in found.examples:
        example.options.clear()
    assert doctest.DocTestRunner().run(found).attempted == 3
    assert doctest.DocTestRunner().run(found).failed == 0


def test_the_choice_keeps_the_error(chosen):
    table, lines = chosen
    assert table.iloc[0]["keeps"] and table.iloc[0]["runs"] > 0 and len(lines) > 3
    tight, found = (saltation.run(made).jumps for made in (saltation.load("bouncing"), scene_of(json.loads(table.attrs["scene"]))))
    assert found["height"].mean() == pytest.approx(tight["height"].mean(), rel=0.02)


def test_the_table_says_what_it_holds(chosen, tmp_path):
    table, _ = chosen
    kept = table[table["keeps"]]
    assert kept["seconds"].is_monotonic_increasing and (kept["error"] <= 0.02).all() and (table["bytes"] > 0).all()
    lines = tomllib.loads(table.attrs["toml"])
    assert {**scene_of(json.loads(table.attrs["scene"])).solver.model_dump(exclude_none=True), **lines["solver"]} == scene_of(
        json.loads(table.attrs["scene"])
    ).solver.model_dump(exclude_none=True)
    diagram(table, "bouncing").savefig(tmp_path / "a.png")


def test_collocation_is_said_to_win(chosen):
    assert study.verdict(chosen[0]).startswith("collocation wins") == (chosen[0].iloc[0]["solver"] == "collocation")


def test_pairs_over_the_same_bed_have_no_scatter_of_the_bed():
    """Differences of 1 % of heights that scatter by half: the mean to rounding, no error."""
    heights = np.random.default_rng(1).uniform(0.5, 1.5, (2, 50, 1))
    found = cases.paired(list(1.01 * np.ones_like(heights)), list(np.ones_like(heights)), np.ones(1))
    assert found.mean == pytest.approx([0.01], rel=1e-12) and found.error == pytest.approx([0.0], abs=1e-15)
    scattered = cases.paired(list(1.01 * heights), list(heights), heights.mean(axis=(0, 1)))
    assert scattered.mean == pytest.approx([0.01], rel=1e-12) and scattered.error[0] < 1e-3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["settling"], "bed is missing"),
        (["sand", "--set", "effects=['weight','drag']"], "effects must include 'history'"),
        (["sand", "--error", "0.9"], "error must lie between 0.0001 and 0.5, got 0.9"),
        (["sand", "--dt", "-1"], "dt must be a finite number greater than 0, got -1"),
        (["sand", "--dt", "0.001", "--seconds", "1"], "either dt or seconds"),
        (["sand", "-o", "a.txt"], "--output must end in"),
    ],
)
def test_bad_input_is_one_sentence(words, said):
    result = CliRunner().invoke(cli.main, ["scheme", *words])
    assert result.exit_code == 2 and said in result.stderr and result.stderr.count("\n") == 1


def test_a_scene_that_does_not_finish_is_refused():
    with pytest.raises(SceneError, match=r"this scene ends '.*' after . of 60 jumps"):
        saltation.select_scheme(scene("bouncing", bed={"restitution": 0.1}, run={"jumps": 60}))


def test_samples_are_rows_as_effects_have_them():
    sample = Sample(0.1, np.array([0.01, -0.02, 0.0]), np.array([0.0, 0.01, 0.0]), 1.0)
    assert sample.largest == 0.02 and sample.bound == pytest.approx(0.02 + 1.96 * 0.01)
    assert dataclasses.replace(sample, status="aloft").bound == math.inf
