"""The page on history schemes: what is chosen is held against longer runs, and misses are told."""

import copy

import pytest

from reports import choosing_scheme as page
from reports.site.page import HERE, load


@pytest.fixture
def data():
    return load(HERE / "data")


def test_the_page_is_built_from_the_records_and_names_every_miss(data, monkeypatch):
    monkeypatch.setattr(page, "save", lambda figure, name: name)
    own, text = data["choosing_scheme"], page.build(data)
    rows = page.rows_of(own)
    assert len(own["scenes"]) == 12 and len(rows) == 24
    assert f"{len(page.kept(own))} of 24 choices keep the error" in text
    assert all(row["keeps"] == (row["bound"] <= row["wanted"]) for row in rows)
    missed = [row["scene"] for row in rows if not row["keeps"]]
    assert all(name in text[text.index("Not kept:") :] for name in missed)


def test_a_choice_that_is_too_dear_is_a_miss(data):
    own = copy.deepcopy(data["choosing_scheme"])
    before = len(page.cheap(own))
    page.cheap(own)[0]["ratio"] = 1.6
    assert len(page.cheap(own)) == before - 1
