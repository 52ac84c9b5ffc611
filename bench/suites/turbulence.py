"""What do turbulence and two-way coupling do to jumps, bed load and spreading?

The runs of `saltation.study.turbulence` (`saltation campaign turbulence`), a path through eddies, what grains see of the fluctuations, the stream before and
after coupling, spreading in three ranges of time, and grains so fine that the stream lifts them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from bench.grains import Task, changed, rounded, run_all
from saltation.effects.turbulence import profiles_of
from saltation.results.result import Result
from saltation.scene import scene_of
from saltation.scene.conditions import settling_velocity
from saltation.study import turbulence as study

STAGES_SHORT = (2.0, 3.0)
SIZE, STAGE = 73.0, 2.5  # of the path and the profiles
LIFTED = 0.4e-3  # m: in ever faster streams, w_s/u* from 3 down to 0.3
FINE = 0.15e-3  # m: at the stage T 2.5, where its w_s/u* is 0.8 but the bed is smooth
RATIOS = (3.0, 2.0, 1.0, 0.6, 0.4, 0.3)
FINE_DEPTH = 0.05  # m
LASTING, LASTING_SHORT = 100.0, 10.0  # h/u*
HIGH = 10.0  # d: above, a grain counts as lifted
SPREAD = {"plain": ("plain", 1e3), "turbulence": ("turbulence", 1e3), "turbulence and rests": ("turbulence", 0.5)}  # variant, entrainment 1/s
COUNTED, COUNTED_SHORT = 4000, 300  # jumps of a run that spreads
BINS = 12
LONG = 1e7  # d/u*: no flight is too long

Content = dict[str, Any]


def fine(diameter: float, lasting: float, ratio: float | None = None) -> Content:
    """A scene of one grain in a turbulent stream, of so many h/u*, with w_s/u* given, or at T 2.5; its path is kept."""
    content = study.content("valid", SIZE, STAGE, "turbulence")
    content["grain"]["diameter"] = diameter
    content["channel"]["depth"] = FINE_DEPTH
    if ratio is not None:
        speed = settling_velocity(scene_of(content))
        assert speed is not None
        del content["channel"]["transport_stage"]
        content["channel"]["shear_velocity"] = speed / ratio
    content["run"] = {"jumps": 1, "seed": 1}
    numbers = scene_of(content).numbers
    content["run"] = {"duration": lasting * FINE_DEPTH / numbers.velocity, "seed": 1, "longest_flight": LONG}
    return content


def spreads(variant: str, entrainment: float, jumps: int) -> Content:
    """A long run of sand."""
    return changed(study.content("valid", SIZE, STAGE, variant, jumps), rests={"entrainment": entrainment})


# What is kept of a run


def seen(result: Result) -> dict[str, Any]:
    """Fluctuations at the grain, rms by height, weighted with time; and where it was."""
    path = result.trajectory
    time, z = path["time"].to_numpy(), path["z"].to_numpy()
    weight = np.diff(time, append=time[-1])
    edges = np.geomspace(max(0.5, z.min()), z.max() * 1.0001, BINS + 1)
    which = np.digitize(z, edges) - 1
    rows = []
    for k in range(BINS):
        here = (which == k) & (weight > 0.0)
        if here.sum() < 50:
            continue
        share = weight[here] / weight[here].sum()
        rms = {axis: math.sqrt(share @ path[f"eddy_{axis}"].to_numpy()[here] ** 2) for axis in "xyz"}
        mean = float(share @ path["eddy_z"].to_numpy()[here])
        rows.append({"height": float(share @ z[here]), "share": float(weight[here].sum() / weight.sum()), "mean_up": mean, **rms})
    return {"status": result.status, "message": result.message, "jumps": len(result.jumps), "rows": rounded(rows)}


def rouse(power: float, low: float, depth: float) -> float:
    """Mean height above `low` of Rouse's profile [(h − z)/z]^P."""
    z = low + (depth - low) * (np.arange(4000) + 0.5) / 4000
    share = ((depth - z) / z) ** power
    return float(share @ z / share.sum())


def suspended(result: Result) -> dict[str, Any]:
    """How high a grain is: mean height, share of time above `HIGH`, mean height of what is above beside that of Rouse's profile; and what it sees."""
    scene, numbers = result.scene, result.scene.numbers
    assert scene.channel is not None and scene.channel.depth is not None
    path = result.trajectory
    time, z = path["time"].to_numpy(), path["z"].to_numpy()
    step, middle = np.diff(time), 0.5 * (z[1:] + z[:-1])
    high, depth = middle > HIGH, scene.channel.depth / numbers.diameter
    speed = settling_velocity(scene)
    assert speed is not None
    ratio = speed / numbers.velocity
    power = ratio / scene.channel.von_karman
    row = {
        "diameter": numbers.diameter,
        "stage": numbers.stage,
        "wall_units": numbers.reynolds,
        "ratio": ratio,
        "rouse": power,
        "depth": depth,
        "lasting": float(time[-1]),
    }
    row |= {"mean": float(step @ middle / step.sum()), "above": float(step[high].sum() / step.sum())}
    row["mean_above"] = float(step[high] @ middle[high] / step[high].sum()) if high.any() else None
    row["rouse_above"] = rouse(power, HIGH, depth)
    return rounded(row) | seen(result)


def path(result: Result) -> dict[str, Any]:
    """Some jumps through eddies: places and the velocity of the fluid there."""
    path, jumps = result.trajectory, result.jumps.iloc[10:18]
    begin, end = float(jumps["start"].iloc[0]), float((jumps["start"] + jumps["duration"]).iloc[-1])
    time = path["time"].to_numpy()
    here = (time >= begin) & (time <= end)
    columns = {"time": time[here] - begin} | {name: path[name].to_numpy()[here] for name in ("x", "z", "u", "w", "eddy_x", "eddy_z")}
    columns["x"] = columns["x"] - columns["x"][0]
    columns["mean"] = np.array([result.scene.profile.velocity_and_shear(height)[0] for height in columns["z"]])
    return {"path": rounded(columns, 4), "seen": seen(result)}


def coupled(result: Result) -> dict[str, Any]:
    """The stream before and after."""
    stream = result.coupled()
    names = ("velocity_before", "velocity", "fluid_stress", "grain_stress")
    columns = {"height": stream["height"].to_numpy()} | {name: stream[name].to_numpy() for name in names}
    return {"status": result.status, "bed_stress": float(stream["bed_stress"]), **rounded(columns)}


def spread(result: Result) -> dict[str, Any]:
    """Second moments and exponents."""
    return {"status": result.status, "jumps": len(result.jumps), **rounded(study.spreading(result)), "resting": rounded(result.resting())}


# The suite


def tasks(full: bool) -> dict[Any, Task]:
    """All runs by what they are for."""
    found: dict[Any, Task] = {}
    for laws in study.LAWS if full else study.LAWS[:1]:
        stages, seeds = (study.STAGES if laws == "valid" else STAGES_SHORT, study.SEEDS) if full else (STAGES_SHORT, study.SEEDS[:1])
        for size in study.SCENES:
            for stage in stages:
                for variant in study.VARIANTS:
                    for seed in seeds:
                        found["study", laws, size, stage, variant, seed] = Task(study.content(laws, size, stage, variant, seed=seed), study.outcome)
    content = study.content("valid", SIZE, STAGE, "turbulence")
    found["path",] = Task(changed(content, run={"trajectory": True}), path)
    for variant in ("coupling", "both"):
        found["coupled", variant] = Task(study.content("valid", SIZE, STAGE, variant), coupled)
    for name, (variant, entrainment) in SPREAD.items():
        found["spread", name] = Task(spreads(variant, entrainment, COUNTED if full else COUNTED_SHORT), spread)
    lasting = LASTING if full else LASTING_SHORT
    for ratio in RATIOS if full else RATIOS[:: len(RATIOS) - 1]:
        found["fine", ratio] = Task(fine(LIFTED, lasting, ratio), suspended)
    found["fine",] = Task(fine(FINE, lasting), suspended)
    return found


def formulas() -> dict[str, Any]:
    """The profiles of the effect in the scene of the path, against z in d and z⁺; in u*."""
    scene = scene_of(study.content("valid", SIZE, STAGE, "turbulence"))
    setting = scene._setting(scene.profile)
    z = np.geomspace(0.05, 0.98 * setting.depth, 50)
    found = profiles_of(scene.options("turbulence"), setting, z)
    stress = found.correlation * found.along * found.up
    columns = {"z": z, "along": found.along, "across": found.across, "up": found.up, "stress": stress, "time": found.time}
    return {"depth": setting.depth, "wall_unit": 1.0 / scene.numbers.reynolds, **rounded(columns, 4)}


def run(full: bool) -> dict[str, Any]:
    """Rows of the study with their changes, and the other parts."""
    flown = run_all(tasks(full))
    labels = (*study.RUN, "variant", "seed")
    rows = [dict(zip(labels, key[1:], strict=True)) | row for key, row in flown.items() if key[0] == "study"]
    changes = study.changes(pd.DataFrame(rows)).to_dict("records")
    return {
        "depth": study.DEPTH, "entrainment": study.ENTRAINMENT, "tolerance": study.TOLERANCE, "counted": study.JUMPS, "high": HIGH, "fine_depth": FINE_DEPTH,
        "size": SIZE, "stage": STAGE, "seeds": len({row["seed"] for row in rows}),
        "rows": rounded(rows), "changes": rounded(changes), "path": flown["path",], "formulas": formulas(),
        "coupled": {key[1]: row for key, row in flown.items() if key[0] == "coupled"},
        "spread": [{"name": key[1], "entrainment": SPREAD[key[1]][1], **row} for key, row in flown.items() if key[0] == "spread"],
        "fine": [row for key, row in flown.items() if key[0] == "fine"],
    }  # fmt: skip
