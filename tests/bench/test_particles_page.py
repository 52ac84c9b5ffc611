"""The page on spheres in flows: what it says of records, with marge3d and without; the truth in the stream."""

import numpy as np
import pytest
import scipy.integrate

from basset import reference
from bench.suites import particles as suite
from reports import how_to_choose, particles
from reports.site.page import into


def made(**more):
    """Records of a run: an error of a tenth of rtol, longer by a tenth with every digit."""
    rows = [{"rtol": 10.0**-k, "error": 10.0 ** -(k + 1), "seconds": 1e-3 * 1.1**k} for k in range(3, 10)]
    exact = [{"flow": case["name"], "slip": case["slip"] is not None} | row for case in suite.exact_cases() for row in rows]
    swarm = {
        "particles": 1000, "end": 2.0, "rtol": 1e-4, "error": 3e-8, "seconds": {"1": 0.2, "2": 0.1}, "per_particle_and_second": 1e-4, "gain": 2.0,
        "same_bits_over_threads": True, "same_bits_in_parts": True, "terms": {"no history": 1e-4, "stokes": 2e-4, "all": 3e-4},
    }  # fmt: skip
    ours = [{"solver": particles.OURS, "size": row["rtol"], "each_of_many": 1e-5} | row for row in rows]
    best = {"solver": "marge3d, order 3", "size": 800, "seconds": 3.0, "error": 2e-8}
    race = {"status": "measured", "version": "0", "best": best, "records": [best, *ours], "ratio_one": 1708.0, "ratio_many": 300000.0}
    tracks = [{"n": 10**6, "rtol": rtol, "error": 0.1 * rtol, "seconds": 0.5} for rtol in (1e-6, 1e-10)]
    provenance = dict.fromkeys(("command", "date", "commit", "processor", "versions"), "–")
    jet = [{"slip": slip} | row for slip in (False, True) for row in rows]
    content = {"exact": exact, "jet": jet, "swarm": swarm, "tracks": tracks, "marge3d": race, "provenance": provenance}
    return {"particles": content | {"stream": {"theirs": suite.THEIRS}} | more}


def test_the_page_says_what_was_measured(tmp_path, coarse):
    with into(tmp_path):
        text = particles.particles(made())
    assert (tmp_path / "figures" / "particles_accuracy.svg").exists()
    opening = text.split("\n\n")[1].splitlines()
    assert "3 s for its best accuracy" in opening[0] and "1.95 ms, 1 700 times less" in opening[0]
    assert "0.1 rtol" in opening[1] and "2.00 times as fast, with the same bits" in opening[2]
    assert "make a call 1.8 times as long" in text  # 1.1^6
    assert "| Daitche, third order | none | 1 001 | 5.4e-8 | 7.5 s | 1.95 ms, rtol 1e-7 |" in text


def test_other_bits_are_not_passed_over(tmp_path, coarse):
    data = made()
    data["particles"]["swarm"]["same_bits_in_parts"] = False
    with into(tmp_path):
        assert "with other bits" in particles.particles(data)


def test_the_page_does_without_marge3d(tmp_path, coarse):
    with into(tmp_path):
        text = particles.particles(made(marge3d={"status": "skipped", "reason": "marge3d is not installed"}))
    assert "marge3d was not measured here (marge3d is not installed)" in text and "Not measured here." in text


def test_how_to_choose_has_a_dash_for_what_was_not_measured():
    assert set(how_to_choose.measured(None).values()) == {"–"}
    assert how_to_choose.measured(made()["particles"])["track"] == "500 ns a sample"


@pytest.mark.analytic
@pytest.mark.parametrize("slip", [None, suite.SLIP])
def test_exact_positions_in_the_stream_are_those_of_its_slips(slip):
    rate, coefficient, beta = suite.numbers(**suite.STREAM)
    found, (along, across) = suite.swing(np.linspace(0.0, suite.STREAM_END, 41), slip)[-1], slip or (0.0, 0.0)
    slips = (
        lambda s: 2.0 * s * float(reference.relaxing(s * s, rate, coefficient, along)),
        lambda s: 2.0 * s * float(reference.oscillating_stream(s * s, rate, coefficient, beta - 1.0, 1.0, across)),
    )
    moved = [scipy.integrate.quad(each, 0.0, suite.STREAM_END**0.5, epsabs=1e-13, limit=200)[0] for each in slips]
    assert found == pytest.approx([suite.STREAM_END + moved[0], 1.0 - np.cos(suite.STREAM_END) + moved[1]], abs=1e-12)
    assert rate == pytest.approx(9.0 / 7.0 / 0.1)  # 1/(RS)
