"""The page on history schemes: what is chosen is held against longer runs, and misses are told."""

import copy
import math

import pytest

from bench.suites import choosing_scheme as suite
from reports import choosing_scheme as page
from reports.site.page import HERE, load
from saltation.study.schemes import Candidate, Entry


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


class Watched:
    """A trial whose first flight compiles, and whose runs take a set-up and as long for every jump; it ends early at long steps."""

    def __init__(self):
        self.flown = []

    def accepts(self, candidate, size):
        return size <= 8.0

    def paired_scene(self, candidate, size, jumps):
        return size, jumps

    def fly(self, scenes):
        compiling = 0.0 if self.flown else 20.0
        self.flown += scenes
        return [("finished" if size < 4.0 else "failed", None, compiling + 3e-3 + 2e-4 * jumps / size) for size, jumps in scenes]


def test_the_time_of_a_jump_holds_neither_what_compiles_nor_what_comes_before_it():
    trial, entry = Watched(), Entry(Candidate("fixed_step", (("scheme", "brush"),)))
    assert suite.jump_of(trial, entry, 1.0) == pytest.approx(2e-4, rel=1e-9)
    assert suite.jump_of(trial, entry, 4.0) == suite.jump_of(trial, entry, 16.0) == math.inf


@pytest.mark.parametrize("most", [1.5e-4, 9e-4, 1e-2])
def test_the_finest_step_that_is_quick_enough_to_a_root_of_two(most):
    size = suite.finest(lambda step: 1e-4 / step, 1.0, most)
    assert 1e-4 / size <= most < 2.0**0.5 * 1.05e-4 / size  # steps have two digits
