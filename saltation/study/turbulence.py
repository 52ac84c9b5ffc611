"""What a turbulent stream, and one that feels its grains, do to jumps, bed load and spreading: sand and coarse sand, with and without each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t

from basset.kernels import Floats
from saltation import regressions, statistics
from saltation.results.result import Result
from saltation.scene import Scene, read, scene_of, shipped
from saltation.study.thesis import STAGES as SHIPPED
from saltation.study.thesis import case

__all__ = ["analyses", "changes", "content", "outcome", "places", "rates", "spreading", "turbulence"]

VARIANTS = {"plain": (), "turbulence": ("turbulence",), "coupling": ("coupling",), "both": ("turbulence", "coupling")}
LAWS = ("valid", "thesis")
SCENES = {size: name for size, (name, _) in SHIPPED.items()}  # R_p: shipped scene
STAGES = (1.5, 2.0, 2.5, 3.0, 4.0)
SEEDS = (1, 2, 3)
JUMPS, DISCARD = 200, 20  # that count, and before them
DEPTH = 0.1  # m
ENTRAINMENT = 5.0  # 1/s
TOLERANCE = 0.03  # of a coupling among eddies, ρu*²: two standard errors of the mean over some ten runs of 200 jumps; without them 0.001, the scene's own
RUN = ["laws", "particle_reynolds", "stage"]  # labels of runs that differ in their variant and seed alone
QUANTITIES = ("height", "length", "velocity", "spin", "takeoff_angle", "incidence_angle", "abs_deviation_angle")
RANGES = {"within a jump": (0.02, 0.3), "between": (2.0, 20.0), "long": (40.0, 400.0)}  # lags in mean durations of a jump
LAGS = 40


def content(laws: str, size: float, stage: float, variant: str, jumps: int = JUMPS, seed: int = 1) -> dict[str, Any]:
    """A scene of the study, not yet validated; every variant has the depth and the rests, so that they differ in their names alone.

    >>> scene_of(content("valid", 73.0, 2.5, "both")).coupling.form
    'two_way'
    """
    found = case(SCENES[size]) if laws == "thesis" else read(shipped()[SCENES[size]])
    found["channel"] |= {"transport_stage": stage, "depth": DEPTH}
    found["rests"] = {"entrainment": ENTRAINMENT}
    found["run"] = {"jumps": jumps + DISCARD, "discard": DISCARD, "seed": seed, "trajectory": False}
    parts = VARIANTS[variant]
    if "turbulence" in parts:
        found["effects"] = [*found["effects"], "turbulence"]
    if "coupling" in parts:
        found["coupling"] = {"tolerance": TOLERANCE} if "turbulence" in parts else "two_way"
    return found


def turbulence(seeds: Sequence[int] = SEEDS) -> list[tuple[dict[str, Any], Scene]]:
    """Both sets of laws × R_p × T × plain, turbulence, coupling or both × seeds, 200 jumps each after 20 that are left out.

    Runs of one seed meet the same angles of the bed at the same impact. Depth 0.1 m; a grain at rest is picked up 5 times per second.
    Labels: name, laws ("valid": those of the shipped scene; "thesis"), particle_reynolds, stage (T), variant, seed.

    >>> len(turbulence())
    240
    """
    result = []
    for laws, size, stage, variant, seed in itertools.product(LAWS, SCENES, STAGES, VARIANTS, seeds):
        labels = {"laws": laws, "particle_reynolds": size, "stage": stage, "variant": variant, "seed": seed}
        result.append(({"name": f"{laws}_R{size:g}_T{stage:g}_{variant}_S{seed}"} | labels, scene_of(content(laws, size, stage, variant, seed=seed))))
    return result


# One run


def outcome(result: Result) -> dict[str, Any]:
    """What the study keeps of a run: means of its jumps, `rates` of its bed load, exponents of its spreading.

    status, jumps, means of `QUANTITIES` in the units of the jumps, resting (grains at rest per moving one), the rates, carried (share of the stress at the bed
    that grains carry), and along and across, γ of lags of 2 to 20 jumps; NaN for what a run does not have.
    """
    jumps = result.jumps.assign(abs_deviation_angle=lambda table: table["deviation_angle"].abs())
    row: dict[str, Any] = {"status": result.status, "message": result.message, "jumps": len(jumps)}
    row |= {name: float(jumps[name].mean()) if len(jumps) else math.nan for name in QUANTITIES}
    row["resting"] = result.resting() if len(jumps) else math.nan
    row |= rates(result)
    made = result.scene.coupling.settled if result.scene.coupling is not None else None
    row["carried"] = made.seen[0] if made is not None else math.nan
    found = {(each["axis"], each["range"]): each["gamma"] for each in spreading(result)["exponents"]} if len(jumps) > 60 else {}
    return row | {name: found.get((axis, "between"), math.nan) for name, axis in (("along", "x"), ("across", "y"))}


def rates(result: Result) -> dict[str, float]:
    """Bed load q* = q/√((s − 1) g d³) of a run, dimensionless, beside two formulas.

    bagnold: what the impulses of the impacts imply, without coupling; before and after: from the number of grains that Owen's condition at the bed
    sets, in the stream without grains and in the one that feels them (NaN for what a run does not have). wong_parker and meyer_peter_mueller, whose
    threshold is one number; own_threshold: their 3.97 (τ* − τ*c)^(3/2) from the τ*c of the scene's T on. Wong & Parker (2006), J. Hydraul. Eng. 132, 1159.
    """
    numbers, jumps = result.scene.numbers, result.jumps
    shields = abs(numbers.shields)
    made = result.scene.coupling.settled if result.scene.coupling is not None else None
    row = dict.fromkeys(("bagnold", "before", "after"), math.nan)
    if made is not None:
        row |= {"before": made.rate_uncoupled, "after": made.rate}
    elif len(jumps) and jumps["impulse_z"].sum() != 0.0:
        row["bagnold"] = result.bed_load()["rate"]
    formulas = {"wong_parker": regressions.wong_parker(shields), "meyer_peter_mueller": regressions.meyer_peter_mueller(shields)}
    formulas["own_threshold"] = 3.97 * max(shields - numbers.critical_shields, 0.0) ** 1.5
    return row | {name: float(value) for name, value in formulas.items()}


def places(result: Result) -> tuple[Floats, Floats]:
    """Times (n,) in d/u* and places along and across (n, 2) in d of one grain at its takeoffs and impacts; it needs no kept path."""
    jumps = result.all_jumps
    start, duration = jumps["start"].to_numpy(), jumps["duration"].to_numpy()
    steps = jumps[["length", "drift"]].to_numpy()
    ends = np.cumsum(steps, axis=0)
    time = np.maximum.accumulate(np.column_stack([start, start + duration]).ravel())
    return time, np.stack([ends - steps, ends], axis=1).reshape(-1, 2)


def spreading(result: Result) -> dict[str, Any]:
    """Second moments of the displacement after a takeoff, and γ in `RANGES`, with intervals where there are ten blocks of takeoffs.

    A grain is taken to move straight in each jump. lag (d/u*), x and y (d²); exponents: axis, range, low and high (d/u*), gamma, interval.
    """
    time, where = places(result)
    jumps = result.jumps
    duration = float(jumps["duration"].mean())
    room = float(time[-1] - jumps["start"].iloc[0])
    lags = np.geomspace(RANGES["within a jump"][0] * duration, min(RANGES["long"][1] * duration, 0.1 * room), LAGS)
    starts = jumps["start"].to_numpy()
    starts = starts[starts + lags[-1] <= time[-1]]
    members = statistics.displacements(time, where, starts, lags)
    moments = members.var(axis=0)
    exponents = []
    for k, axis in enumerate("xy"):
        for name, ends in RANGES.items():
            low, high = ends[0] * duration, min(ends[1] * duration, float(lags[-1]))
            if high < 3.0 * low or not (moments[:, k] > 0.0).all():
                continue
            gamma = statistics.fit_exponent(lags, moments[:, k], low, high)[0]
            block = max(1, math.ceil(high / room * len(jumps)))
            interval = statistics.exponent_interval(lags, members[:, :, k], low, high, block=block) if len(starts) >= 10 * block else None
            exponents.append({"axis": axis, "range": name, "low": low, "high": high, "gamma": gamma, "interval": interval})
    return {"duration": duration, "lag": lags, "x": moments[:, 0], "y": moments[:, 1], "exponents": exponents}


# Many runs


def interval(values: Floats) -> float:
    """Half-width of the 95 % interval of a mean by Student's t; NaN for fewer than two values."""
    return float(t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))) if len(values) > 1 else math.nan


def changes(rows: pd.DataFrame) -> pd.DataFrame:
    """What each variant changes: of rows of `outcome` with the labels of `turbulence`, means over seeds and differences from the plain run of the same seed.

    One row per laws, R_p, T, variant and quantity: seeds (that both runs finished), mean, change (the mean of the differences, in the quantity's unit),
    interval (half-width of its 95 % interval, Student's t over seeds), status (the worst of the runs).
    """
    quantities = [*QUANTITIES, "resting", "along", "across", "bagnold", "before", "after", "carried"]
    found = []
    for labels, runs in rows.groupby([*RUN, "variant"], sort=False):
        plain = rows[(rows[RUN] == list(labels[:-1])).all(axis=1) & (rows["variant"] == "plain")].set_index("seed")
        own = runs.set_index("seed")
        said = next((status for status in own["status"] if status != "finished"), "finished")
        for name in quantities:
            values = own[name].dropna()
            difference = (own[name] - plain[name].reindex(own.index)).dropna().to_numpy()
            row = dict(zip([*RUN, "variant"], labels, strict=True)) | {"quantity": name, "seeds": len(values), "mean": values.mean(), "status": said}
            found.append(row | {"change": difference.mean() if len(difference) else math.nan, "interval": interval(difference)})
    return pd.DataFrame(found)


def analyses(table: pd.DataFrame, opened: Callable[[str], Result]) -> dict[str, pd.DataFrame]:
    """The tables of a campaign: outcomes, one row per run, and `changes`; `opened` gives the result of a run by its label `name`."""
    labels = ["name", *RUN, "variant", "seed"]
    rows = pd.DataFrame([{name: row[name] for name in labels} | outcome(opened(row["name"])) for row in table.to_dict("records")])
    return {"outcomes": rows, "changes": changes(rows)}
