"""The page on turbulence and coupling: rates are told against the formulas, and it builds from the little that a short measurement has."""

import itertools
import json
import math

import numpy as np
import pandas as pd
import pytest

from basset import measure
from bench.suites import turbulence as suite
from reports import turbulence as page
from reports.site.page import into
from saltation.scene import scene_of
from saltation.scene.conditions import settling_velocity
from saltation.study import turbulence as study


def test_rouse_s_mean_height_in_closed_form():
    """P = 1 from a to h: the integral of (h − z)/z is h ln(h/a) − (h − a), that of h − z is (h − a)²/2."""
    a, h = 10.0, 100.0
    assert suite.rouse(1.0, a, h) == pytest.approx(0.5 * (h - a) ** 2 / (h * math.log(h / a) - (h - a)), rel=1e-5)
    assert suite.rouse(0.0, a, h) == pytest.approx(0.5 * (a + h), rel=1e-12)


def test_fine_grains_have_the_settling_velocities_they_are_called_by():
    for ratio in suite.RATIOS:
        scene = scene_of(suite.fine(suite.LIFTED, 10.0, ratio))
        assert settling_velocity(scene) / scene.numbers.velocity == pytest.approx(ratio, rel=1e-9) and scene.numbers.stage > 1.0
    assert scene_of(suite.fine(suite.FINE, 10.0)).numbers.stage == pytest.approx(suite.STAGE)


def measured(folder):
    """What a measurement writes, of two T, one seed and one set of laws; at R_p 73, T 1.5 the formula has no rate."""
    rows = []
    for size, stage, variant in itertools.product((73.0, 250.0), (1.5, 3.0), study.VARIANTS):
        coupled, reference = "coupling" in study.VARIANTS[variant], 0.0 if (size, stage) == (73.0, 1.5) else 0.01
        row = dict.fromkeys((*study.QUANTITIES, "along", "across", "resting"), 1.0 + len(variant))
        row |= {"laws": "valid", "particle_reynolds": size, "stage": stage, "variant": variant, "seed": 1, "status": "finished"}
        row |= {"bagnold": math.nan if coupled else 0.05, "before": 0.04 if coupled else math.nan, "after": 0.015 if coupled else math.nan}
        row |= {"carried": 0.5 if coupled else math.nan, "wong_parker": reference, "meyer_peter_mueller": 0.02, "own_threshold": 0.012}
        rows.append(row)
    lag = np.geomspace(0.02, 40.0, 30)
    exponents = [{"axis": axis, "range": name, "gamma": 0.5, "interval": None} for axis in "xy" for name in ("within a jump", "between")]
    spread = {"duration": 1.0, "lag": lag, "x": lag, "y": 0.1 * lag, "exponents": exponents, "resting": 0.1, "status": "finished"}
    seen = {"status": "finished", "rows": [{"height": 1.0, "z": 1.0, "x": 2.0, "y": 1.0, "share": 1.0, "mean_up": 0.0}]}
    fine = {"stage": 2.5, "wall_units": 9.0, "rouse": 1.0, "depth": 100.0, "mean": 3.0, "mean_above": None, "rouse_above": 30.0}
    stream = {name: [1.0, 2.0] for name in ("height", "velocity_before", "velocity", "fluid_stress", "grain_stress")}
    content = {
        "depth": 0.1, "entrainment": 5.0, "tolerance": 0.05, "counted": 200, "high": 10.0, "fine_depth": 0.05, "size": 73.0, "stage": 2.5, "seeds": 1,
        "rows": rows, "changes": study.changes(pd.DataFrame(rows)).to_dict("records"), "formulas": suite.formulas(),
        "path": {"path": {name: [0.0, 1.0] for name in ("time", "x", "z", "u", "w", "eddy_x", "eddy_z", "mean")}, "seen": seen},
        "coupled": dict.fromkeys(("coupling", "both"), stream), "spread": [{"name": name, **spread} for name in suite.SPREAD],
        "fine": [{"diameter": d, "ratio": ratio, "above": above, **fine, **seen} for d, ratio, above in ((4e-4, 3.0, 0.0), (4e-4, 0.3, 0.4))],
        "provenance": {"command": "c", "date": "2026-11-30", "commit": "0", "processor": "p", "versions": "v"},
    }  # fmt: skip
    measure.write_json(folder / "turbulence.json", content)
    return json.loads((folder / "turbulence.json").read_text(encoding="utf-8"))


def test_the_page_tells_rates_and_misses(tmp_path):
    data = measured(tmp_path)
    rates = page.rates(data)
    assert [row["after"] for row in rates] == [None, 1.5, 1.5, 1.5] and page.within(rates, "before") == (0, 3) and page.within(rates, "after") == (3, 3)
    with into(tmp_path):
        text = page.build({"turbulence": data})
    assert "4 to 4 times Wong and Parker's before" in text and "3 of 3 within a factor of 2" in text and "(R_p 73 at T 1.5)" in text
    assert "0.4 mm where w_s/u* is 0.3 or less and leave it at the bed where it is 3 or more" in text
    assert len(list((tmp_path / "figures").glob("*.png"))) == 5
