"""The sketches show what is computed: what is drawn is read back and held against the functions that flights call."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

from bench.suites import definitions as suite
from reports import definitions as page
from saltation.bed.contact import strike_bed
from saltation.bed.roughness import angle_of, offset


@pytest.fixture
def drawn():
    """A sketch by its name, its artists by theirs."""

    def draw(name, panel=0):
        axes = page.SKETCHES[name]().axes[panel]
        return {artist.get_gid(): artist for artist in axes.get_children() if artist.get_gid()}

    yield draw
    plt.close("all")


def centre(artist):
    return np.array(artist.get_center())


def arrow(artist):
    """From tail to tip."""
    return np.subtract(artist.xy, artist.xyann)


def ends(artist):
    return np.asarray(artist.get_xydata())


@pytest.mark.parametrize(("name", "panel"), [("contact_along", 0), ("contact_across", 1)])
def test_a_contact_obeys_the_relation(drawn, name, panel):
    """Grains touch, the plane is normal to the line of centres, and the path through the contact cuts off r = offset/2."""
    found = drawn(name, panel)
    line, plane, path, rise = (np.diff(ends(found[part]), axis=0)[0] for part in ("line of centres", "contact plane", "path through the contact", "offset"))
    assert np.linalg.norm(centre(found["grain"]) - centre(found["bed 0"])) == pytest.approx(1.0, abs=1e-12)
    assert line @ plane == pytest.approx(0.0, abs=1e-12)
    tilt, incidence = math.atan2(plane[1], plane[0]), math.atan2(-path[1], path[0])
    assert rise == pytest.approx([0.0, 0.5 * offset(tilt, incidence)], abs=1e-12)
    assert tilt == pytest.approx(angle_of(2.0 * rise[1], incidence), abs=1e-12)
    on_path = ends(found["path through the contact"])[1] - ends(found["offset"])[1]
    assert np.abs(on_path).max() == 0.0
    contact = 0.5 * (centre(found["grain"]) + centre(found["bed 0"]))
    assert np.cross(np.append(contact - ends(found["offset"])[1], 0.0), np.append(path, 0.0))[2] == pytest.approx(0.0, abs=1e-12)
    assert math.degrees(tilt) < 30.0 or name == "contact_across"
    assert all(np.linalg.norm(centre(found["grain"]) - centre(found[f"bed {k}"])) > 1.0 for k in (-1, 1))


def test_the_normal_in_plan_points_against_the_flight(drawn):
    found = drawn("contact_across")
    normal, before = arrow(found["normal"]), arrow(found["before"])
    assert normal @ before < 0.0 and np.linalg.norm(normal) < 1.4


def test_slip_is_grain_less_stream(drawn):
    found = drawn("particle")
    assert arrow(found["u_r"]) == pytest.approx(arrow(found["u_p"]) - arrow(found["u_f"]), abs=1e-12)


def test_a_rebound_keeps_e_of_the_normal_speed(drawn):
    found = drawn("wall")
    normal = arrow(found["normal"]) / np.linalg.norm(arrow(found["normal"]))
    before, after = arrow(found["before"]), arrow(found["after"])
    assert after @ normal == pytest.approx(-page.E * (before @ normal), rel=1e-12)
    struck = strike_bed(normal[0], 0.0, normal[1], before[0], 0.0, before[1], 0.0, 0.6, 0.0, page.E, page.F, 1.0)
    assert after == pytest.approx([struck[0], struck[2]], abs=1e-12)


def test_two_grains_keep_their_momentum_and_part_with_e(drawn):
    before, contact, after = (drawn("pair", panel) for panel in range(3))
    assert np.linalg.norm(centre(before["grain i"]) - centre(before["grain j"])) == pytest.approx(1.0, abs=1e-12)
    u, v = ([arrow(found[f"{name} {grain}"]) for grain in "ij"] for found, name in ((before, "before"), (after, "after")))
    assert sum(u) == pytest.approx(sum(v), abs=1e-12)
    assert arrow(contact["impulse"]) == pytest.approx(v[0] - u[0], abs=1e-12)
    assert arrow(contact["closing"]) == pytest.approx(u[1] - u[0], abs=1e-12)
    normal = arrow(contact["normal"]) / np.linalg.norm(arrow(contact["normal"]))
    assert (v[1] - v[0]) @ normal == pytest.approx(-page.E * ((u[1] - u[0]) @ normal), rel=1e-12)
    assert (u[1] - u[0]) @ normal < 0.0 and arrow(contact["impulse"]) @ normal < 0.0
    assert arrow(contact["slip"]) @ normal == pytest.approx(0.0, abs=1e-12)


def test_drag_predictors_worked_by_hand():
    """Rubey's C_D = 24/Re + 2 over Yen's: 122 % at Re 100, where the thesis states 30 % at most; that is passed at Re 18.65."""
    over = {re: suite.coefficient("rubey", re) / suite.coefficient("yen", re) - 1.0 for re in (10.0, 18.64, 18.66, 100.0, 1000.0)}
    assert suite.coefficient("rubey", 100.0) == pytest.approx(2.24, rel=1e-15)
    assert [round(100.0 * over[re]) for re in (10.0, 100.0, 1000.0)] == [11, 122, 271]
    assert over[18.64] < 0.3 < over[18.66]


def test_the_settling_velocity_balances_weight_and_drag():
    """Of Rubey's law in closed form: 2 Re² + 24 Re = 4R_p²/3."""
    for row in suite.run(False)["settling"]:
        weight = 4.0 / 3.0 * row["particle_reynolds"] ** 2
        assert row["rubey"] == pytest.approx(-6.0 + math.sqrt(36.0 + 0.5 * weight), rel=1e-12)
        assert suite.coefficient("yen", row["yen"]) * row["yen"] ** 2 == pytest.approx(weight, rel=1e-12)
