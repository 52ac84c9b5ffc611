"""The page on choosing: what is chosen is held against every set of effects, and misses are told."""

import copy

import pytest

from bench.suites import choosing as suite
from reports import choosing as page
from reports.site.page import HERE, load
from saltation.scene import read, scene_of


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
