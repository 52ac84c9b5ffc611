"""The page on choosing: what is chosen is held against every set of effects, and misses are told."""

import copy

import pandas as pd
import pytest

from bench.suites import choosing as suite
from reports import choosing as page
from reports.site.page import HERE, load
from saltation.scene import read, scene_of
from saltation.study import cases


@pytest.fixture
def data():
    return load(HERE / "data")


def test_every_set_that_makes_a_scene_is_flown():
    content = read("sand")
    sets = suite.every_set(scene_of(content))
    assert len(sets) == 32 and next(iter(sets)).split("+") == content["effects"]
    assert all({"weight", "drag"} <= set(made.names) for made in sets.values())
    content["bed"] |= {"rebound": "garcia_nino", "tangential_retention": 0.89}
    del content["bed"]["friction"]
    assert len(suite.every_set(scene_of(content))) == 24  # none with Magnus and nothing that turns the grain


def test_every_set_is_compared_with_all_effects_under_a_seed_of_its_own(monkeypatch):
    def enough(sets, *_):
        assert {made.run.seed for made in sets.values()} == {suite.SEED}
        means = {"status": "finished", "jumps": 400} | {f"{name}{end}": value for name in cases.VARIABLES for end, value in (("", 2.0), ("_se", 0.1))}
        table = pd.DataFrame([means] * len(sets), index=list(sets))
        table.iloc[1, table.columns.get_loc("height")] = 3.0
        return table, 400, 400 * len(sets)

    monkeypatch.setattr(cases, "fly_to_error", enough)
    monkeypatch.setattr(suite.cases, "relative_costs", lambda sets: pd.Series(1.0, index=list(sets)))
    rows = suite.reference_runs(scene_of(read("sand")), 0.01)
    assert len(rows) == 32 and [row["largest"] for row in rows[:3]] == [0.0, 0.5, 0.0]


def test_the_page_is_built_from_the_records(data, monkeypatch):
    monkeypatch.setattr(page, "save", lambda figure, name: name)
    text = page.choosing(data)
    assert "gravel can do without lift and history" in text
    assert "Why gravel keeps Magnus" in text
    assert text.rstrip().splitlines()[-1].startswith("* ")


def test_a_set_with_fewer_effects_within_the_tolerance_is_a_miss(data):
    own = copy.deepcopy(data["choosing"])
    assert all(page.fewest(own, name) for name in own["sets"])
    row = next(row for row in own["sets"]["sand"] if len(row["effects"]) == 3)
    row["largest"] = 0.01
    assert not page.fewest(own, "sand")
