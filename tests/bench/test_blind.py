"""The blind test: laws are those of the rule, single changes are single, and means are counted in the envelope."""

import pytest

from bench.grains import base, changed
from bench.suites import blind as suite
from reports import blind as page
from saltation.scene import scene_of
from saltation.scene.valid import chosen, families, taken

CONTENT = changed(base("sand", 20), channel={"transport_stage": 2.5})
OWN = suite.valid(CONTENT)


def test_the_scene_takes_what_the_rule_chooses():
    """Whatever the shipped scene says of its own laws."""
    scene = scene_of(OWN)
    assert {family: taken(scene, family.partition(".")[0], closures) for family, closures in families(scene).items()} == {
        family: name for family, (name, _) in chosen(scene_of(CONTENT)).items()
    }


def test_single_changes_change_one_table():
    before = scene_of(OWN).model_dump()
    for name, content in suite.single_changes(OWN).items():
        after = scene_of(content).model_dump()
        tables = {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
        assert len(tables - {"effects"}) == 1, name


def row(height, length, velocity, status="finished"):
    return {"height": {"mean": height}, "length": {"mean": length}, "velocity": {"mean": velocity}, "status": status}


def test_means_are_counted_in_the_envelope():
    """R_p 73, T 2.5: H 1.76 to 2.72, L 11.4 to 24, ū 6.74 to 6.89 by the three regressions."""
    assert suite.inside(row(2.0, 15.0, 6.8), 73, 2.5) == ["height", "length", "velocity"]
    assert suite.inside(row(1.0, 30.0, 6.8), 73, 2.5) == ["velocity"]


@pytest.mark.parametrize(("inside", "ended"), [(3, 1), (1, 0)])
def test_the_page_counts_what_ended_early_apart(inside, ended):
    rows = [{"name": "x", "inside": list("abc")[:inside], "status": "finished" if ended else "at rest", "seed": 1}]
    assert page.single_changes({"rows": rows}) == [("x", inside, ended)]
