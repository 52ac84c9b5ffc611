"""The study of turbulence and coupling: variants differ in their names alone, and are paired by seed."""

import numpy as np
import pandas as pd
import pytest

import saltation
from saltation.study import turbulence as study


def test_variants_of_a_run_differ_in_what_they_are_called_after():
    runs = study.turbulence(seeds=(7,))
    assert len({labels["name"] for labels, _ in runs}) == len(runs) == 80
    for (labels, scene), (_, plain) in zip(runs, (run for run in runs[::4] for _ in range(4)), strict=True):
        parts = study.VARIANTS[labels["variant"]]
        assert ("turbulence" in scene.names, scene.coupling is not None) == ("turbulence" in parts, "coupling" in parts)
        own, other = (each.model_dump(exclude={"effects", "coupling", "turbulence"}) for each in (scene, plain))
        assert own == other and scene.run.seed == 7 and scene.channel.depth == study.DEPTH


def test_changes_are_differences_from_the_plain_run_of_the_same_seed():
    """Means over seeds scatter by 10, differences are 1, 2 and 3."""
    labels = {"laws": "valid", "particle_reynolds": 73.0, "stage": 2.0}
    every = dict.fromkeys([*study.QUANTITIES, "resting", "along", "across", "bagnold", "before", "after", "carried"], np.nan)
    rows = [
        labels | every | {"variant": variant, "seed": seed, "status": "finished", "height": 10.0 * seed + (variant == "both") * seed}
        for variant in ("plain", "both")
        for seed in (1, 2, 3)
    ]
    found = study.changes(pd.DataFrame(rows)).set_index(["variant", "quantity"]).loc[("both", "height")]
    assert found["mean"] == 22.0 and found["change"] == 2.0
    assert found["interval"] == pytest.approx(4.302653 / np.sqrt(3.0), rel=1e-6)  # Student's t for two degrees of freedom


def test_places_are_those_of_the_path():
    result = saltation.run(saltation.load("sand").changed(run={"jumps": 10, "discard": 0}))
    time, where = study.places(result)
    path, started = result.trajectory, result.all_jumps["start"].iloc[0]
    for k, axis in enumerate("xy"):
        origin = np.interp(started, path["time"], path[axis])
        assert np.interp(time, path["time"], path[axis]) - origin == pytest.approx(where[:, k], abs=1e-6)
