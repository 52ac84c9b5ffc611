"""Which effects does a scene call for, does effects = "auto" find them, and which open choice matters most?"""

from __future__ import annotations

import itertools
import time
from dataclasses import asdict
from typing import Any

import pandas as pd

import saltation
from bench.grains import rounded
from saltation.scene import SceneError, scene_of
from saltation.study import cases, choices
from saltation.study import effects as advice
from saltation.study.thesis import case

SCENES = ("sand", "sand_coarse", "gravel")
ALWAYS = ("weight", "drag")  # without either no run finishes
SEED = 101  # of the reference: none that a choice has seen
SEEDS = (1, 2, 3, 4, 5)  # of choices
LOOSER = 0.2  # a tolerance at which more scenes can do without some
ERROR = 0.005  # relative standard error of the mean heights of the reference
COMBINED = "sand"
MEASURED = 0.15  # Magnus's coefficient at Re 550 to 1600: Tsuji, Morikawa & Mizuno (1985), J. Fluids Eng. 107, 484


def every_set(scene: Any) -> dict[str, Any]:
    """The scene with every set of effects that makes a scene, all of them first; names joined by +."""
    optional = [name for name in scene.names if name not in ALWAYS]
    found: dict[str, Any] = {}
    for number in range(len(optional) + 1):
        for left_out in itertools.combinations(optional, number):
            try:
                made = cases.without(scene, left_out)
            except SceneError:  # Magnus with nothing that turns the grain
                continue
            found["+".join(made.names)] = made
    return found


def reference_runs(scene: Any, error: float) -> list[dict[str, Any]]:
    """Every set with a seed of its own: changes against all effects, their bounds, the time per jump."""
    sets = every_set(scene.changed(run={"seed": SEED}))
    table = cases.compare(cases.fly_to_error(sets, error, None, None)[0])
    table["time"] = cases.relative_costs(sets)
    return [{"effects": str(name).split("+"), "largest": largest(row), **plain(row)} for name, row in table.iterrows()]


def largest(row: pd.Series) -> float | None:
    """The largest relative change of H, L and ū itself, without its bounds; None where a run did not finish."""
    return max(abs(float(row[f"{name}_change"])) for name in cases.VARIABLES) if row["status"] == "finished" else None


def plain(row: pd.Series) -> dict[str, Any]:
    """A row ready for JSON."""
    return {str(key): (value if isinstance(value, str) else None if pd.isna(value) else rounded(float(value))) for key, value in row.items()}


def chosen(scene: Any, tolerance: float) -> list[dict[str, Any]]:
    """What is chosen with several seeds, and the seconds that takes with everything compiled, beside those of the scene's own run."""
    rows = []
    for seed in SEEDS:
        made = scene.changed(run={"seed": seed})
        start = time.perf_counter()
        evidence = advice.choose(made, tolerance).chosen.model_dump()
        between = time.perf_counter()
        saltation.run(made)
        rows.append({"seed": seed, "seconds": between - start, "run_seconds": time.perf_counter() - between, **evidence})
    return rounded(rows)


def combined(scene: Any) -> dict[str, Any]:
    """Every open choice with every other."""
    table = choices.combinations(scene)
    extent = choices.extent(table)
    return {
        "number": len(table),
        "finished": int((table["status"] == "finished").sum()),
        "extent": {f"{quantile:g}": plain(row) for quantile, row in extent.iterrows()},
        "shares": {str(choice): plain(row) for choice, row in choices.shares(table).iterrows()},
    }


def magnus(scene: Any) -> dict[str, Any]:
    """The scene with the coefficient that was measured at high Reynolds numbers, beside the thesis's and none; and what is then chosen."""
    made = scene.changed(magnus={"coefficient": MEASURED})
    each = {"0.75": scene, f"{MEASURED:g}": made, "none": cases.without(scene, ["magnus"])}
    table = cases.compare(cases.fly_to_error(each, 0.01, None, None)[0])
    return {
        "coefficient": MEASURED,
        "rows": {str(name): plain(row) for name, row in table.iterrows()},
        "chosen": rounded(advice.choose(made).chosen.model_dump()),
    }


def run(full: bool) -> dict[str, Any]:
    """All scenes: effects with the thesis's laws, open choices as shipped."""
    found: dict[str, Any] = {"advised": {}, "ablation": {}, "sets": {}, "chosen": {}, "looser": {}, "uncertainty": {}}
    for name in SCENES:
        scene = scene_of(case(name))
        found["advised"][name] = [rounded(asdict(row)) for row in advice.advise(scene)]
        found["sets"][name] = reference_runs(scene, ERROR)
        found["ablation"][name] = [{"effect": str(effect), **plain(row)} for effect, row in advice.ablate(scene).iterrows()]
        found["chosen"][name] = chosen(scene, advice.TOLERANCE)
        found["looser"][name] = chosen(scene, LOOSER)
        found["uncertainty"][name] = [plain(row) for _, row in choices.uncertainty(saltation.load(name), error=0.01).iterrows()]
    return {
        **found,
        "seed": SEED,
        "error": ERROR,
        "tolerance": advice.TOLERANCE,
        "combined": {"scene": COMBINED, **combined(saltation.load(COMBINED))},
        "magnus": magnus(scene_of(case("gravel"))),
    }
