"""What the thesis's chapter 4 asks of runs of many grains: how often they meet, what that changes, how they spread, how many jumps a mean needs."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import mannwhitneyu, t

from basset.kernels import Floats
from saltation import statistics
from saltation.results.result import Result

__all__ = ["analyses", "changes", "compare", "convergence", "ensemble", "exponents", "first_means", "over_seeds", "shares_across", "table_4_2"]

RUN = ["concentration", "particle_reynolds", "stage"]  # labels of a run, besides whether grains meet
PRINTED = {  # Table 4-2 at R_p = 73, by C_p and T: F_pp, F_pb, R_pb/pp
    (0.0013, 2.0): (0.14, 9.91, 72.40),
    (0.0013, 2.5): (0.18, 8.68, 47.14),
    (0.0013, 3.0): (0.19, 7.89, 40.80),
    (0.0233, 2.0): (4.51, 30.42, 6.74),
    (0.0233, 2.5): (4.12, 27.57, 6.69),
    (0.0233, 3.0): (5.31, 23.71, 4.46),
}
COMPARED = ("height", "length", "velocity", "takeoff_angle", "abs_deviation_angle")
PLANES = {"angle_xz": ("u", "w"), "angle_xy": ("u", "v"), "angle_yz": ("v", "w")}  # trajectory angle in each plane, fig. 4-13
RANGES = {"local": (0.0, 0.3), "intermediate": (2.0, 20.0), "global": (40.0, math.inf)}  # lags in mean durations of a jump
EXPONENTS = {  # figs 4-17 and 4-18 at C_p 2.33 %, R_p 73, T 2: γ of the three ranges; NaN: "sub-diffusive", without a number
    ("x", True): (1.0, 0.7, 0.47),
    ("x", False): (1.0, 0.7, 0.47),
    ("y", True): (1.0, 0.6, math.nan),
    ("y", False): (1.0, 0.5, 0.0),
}
LAGS = 60
RELEASES = 5.0  # mean durations between two releases of a grain
COUNTS = (50, 100, 150, 200)  # jumps that a mean is made from; 50 beside the thesis's
FIRST = (100, 150, 200, 517)  # fig. 4-3: of one grain
LEFT_OUT = 10  # of them, at the beginning


# How often


def table_4_2(table: pd.DataFrame) -> pd.DataFrame:
    """Encounters (F_pp) and impacts on the bed (F_pb) per d/u* of a campaign, in u*/d, and their ratio, beside those printed in Table 4-2.

    Labels concentration, particle_reynolds, stage and encounters (bool); `_printed` is NaN where the thesis prints none.
    """
    rows = table.loc[table["encounters"], [*RUN, "pair_frequency", "bed_frequency"]].reset_index(drop=True)
    with np.errstate(divide="ignore"):
        rows["ratio"] = rows["bed_frequency"].to_numpy() / rows["pair_frequency"].to_numpy()
    return beside_printed(rows)


def over_seeds(table: pd.DataFrame) -> pd.DataFrame:
    """Table 4-2 from runs that differ by their seed alone: means, and half-widths of their 95 % intervals (Student's t, `_interval`).

    `table` as for `table_4_2`, with as many rows of a C_p, R_p, T (and scatter, where it is a label) as seeds; every column that ends in "_frequency"
    is averaged, u*/d. The ratio is that of the means, its interval by the delta method; a single seed has no interval.
    """
    table = table[table["encounters"]]
    names = [name for name in table if name.endswith("_frequency")]
    labels = [*RUN, *(["scatter"] if "scatter" in table else [])]
    rows = []
    for label, runs in table.groupby(labels, sort=False):
        count = len(runs)
        width = t.ppf(0.975, count - 1) / math.sqrt(count) if count > 1 else math.nan
        row: dict[str, Any] = {**dict(zip(labels, label, strict=True)), "seeds": count}
        for name in names:
            row |= {name: runs[name].mean(), f"{name}_interval": width * runs[name].std()}
        pairs, bed = row["pair_frequency"], row["bed_frequency"]
        ratio = bed / pairs if pairs else math.inf
        rest = (runs["bed_frequency"] - ratio * runs["pair_frequency"]).std() if pairs else math.nan
        rows.append(row | {"ratio": ratio, "ratio_interval": width * rest / pairs if pairs else math.nan})
    return beside_printed(pd.DataFrame(rows))


def beside_printed(rows: pd.DataFrame) -> pd.DataFrame:
    """With columns of what Table 4-2 prints."""
    at_73 = np.isclose(rows["particle_reynolds"], 73.0)
    keys = zip(rows["concentration"], rows["stage"].round(6), at_73, strict=True)
    printed = [PRINTED.get((concentration, stage), (math.nan,) * 3) if known else (math.nan,) * 3 for concentration, stage, known in keys]
    rows[["pair_frequency_printed", "bed_frequency_printed", "ratio_printed"]] = np.array(printed).reshape(-1, 3)
    return rows


# What it changes


def mean_error(jumps: pd.DataFrame, column: str, seed: int = 0, resamples: int = 400) -> float:
    """Standard error of a mean over the jumps of many grains: blocks of successive jumps are drawn within each grain.

    Grains are independent, jumps of a grain are not: the variances of the grains' own means add up, weighted with the squares of their shares of all
    jumps. A grain of a single jump counts with the scatter of all.
    """
    values = jumps[column].to_numpy()
    if len(values) < 2:
        return math.nan
    variance = 0.0
    for own in np.split(values, np.flatnonzero(np.diff(jumps["grain"].to_numpy())) + 1):
        error = statistics.standard_error(own, seed, resamples) if len(own) > 1 else float(values.std(ddof=1))
        variance += (len(own) / len(values) * error) ** 2
    return math.sqrt(variance)


def compare(meeting: Result, passing: Result) -> pd.DataFrame:
    """Jumps of a run with and of one without encounters: figs 4-10 to 4-12, the thesis's test and one that knows of correlation.

    One row per quantity of `COMPARED` (abs_deviation_angle is |deviation_angle|), in its unit: mean_with, sd_with, jumps_with, the same `_without`; difference
    of the means (with − without) and its standard_error (blocks of successive jumps within grains; runs taken as independent); p_bootstrap, of so great a
    difference by chance, from these two; p_wilcoxon, of the two-sided rank-sum test, which takes jumps for independent. NaN where no jump counts.
    Thesis, section 4.3.2; Mann and Whitney (1947), Ann. Math. Stat. 18, 50–60.
    """
    tables = [result.jumps.assign(abs_deviation_angle=lambda jumps: jumps["deviation_angle"].abs()) for result in (meeting, passing)]
    rows = []
    for name in COMPARED:
        row: dict[str, Any] = {"quantity": name}
        for side, jumps in zip(("with", "without"), tables, strict=True):
            row |= {f"mean_{side}": jumps[name].mean(), f"sd_{side}": jumps[name].std(), f"jumps_{side}": len(jumps)}
        row["difference"] = row["mean_with"] - row["mean_without"]
        row["standard_error"] = math.hypot(*(mean_error(jumps, name) for jumps in tables))
        row["p_bootstrap"] = two_sided(row["difference"], row["standard_error"])
        both = min(len(jumps) for jumps in tables) > 0
        row["p_wilcoxon"] = rank_sum(*(jumps[name] for jumps in tables)) if both else math.nan
        rows.append(row)
    return pd.DataFrame(rows)


def rank_sum(one: pd.Series, other: pd.Series) -> float:
    """Probability of ranks at least as unlike (Mann and Whitney 1947); 1 where all values are one, of which SciPy's answer depends on its version."""
    return 1.0 if len({*one, *other}) == 1 else float(mannwhitneyu(one, other).pvalue)


def two_sided(difference: float, error: float) -> float:
    """Probability of a normal deviation at least as great; 1 for no difference at all."""
    return 1.0 if difference == 0.0 else math.erfc(abs(difference) / error / math.sqrt(2.0)) if error != 0.0 else 0.0


def parted_slowly(result: Result) -> pd.Series:
    """Of each encounter, whether grains parted with `encounters.slowest`, because e left them less: they are pressed together, and meet again at once."""
    return result.encounters["restitution"] > result.scene.options("encounters").restitution * (1.0 + 1e-12)


def changes(result: Result, slow: bool = False) -> pd.DataFrame:
    """What each encounter changes, after minus before, of both grains, two rows per encounter: thesis figs 4-13 to 4-15.

    angle_xz (of the velocity to the bed), angle_xy (its deviation in plan), angle_yz, in degree from −180 to 180; u, v, w in u*; spins in u*/d. Encounters
    in which grains parted with `encounters.slowest` come in series of ever smaller changes: they are left out unless `slow`.
    """
    met = result.encounters if slow else result.encounters[~parted_slowly(result)]
    parts = []
    for side in ("first", "second"):
        own = {"grain": met[side]}
        for name, axes in PLANES.items():
            after, before = (np.degrees(np.arctan2(met[f"{side}_{axes[1]}{when}"], met[f"{side}_{axes[0]}{when}"])) for when in ("_after", ""))
            own[name] = (after - before + 180.0) % 360.0 - 180.0
        for name in ("u", "v", "w", "spin_x", "spin_y", "spin_z"):
            own[name] = met[f"{side}_{name}_after"] - met[f"{side}_{name}"]
        parts.append(pd.DataFrame(own))
    return pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)


def distribution(changed: pd.DataFrame) -> pd.DataFrame:
    """How changes are distributed: mean, sd, mean_size and sd_size (of the absolute value), median_size and count, one row per quantity."""
    rows = []
    for name in [column for column in changed if column != "grain"]:
        values = changed[name]
        size = values.abs()
        rows.append((name, values.mean(), values.std(), size.mean(), size.std(), size.median(), len(values)))
    return pd.DataFrame(rows, columns=["quantity", "mean", "sd", "mean_size", "sd_size", "median_size", "count"])


# How they spread


def ensemble(result: Result, again: bool = False) -> tuple[Floats, Floats, int]:
    """Displacements of all grains that stay to the end, shifted to one release point: lags (m,), d/u*, members (grains · releases, m, k), d, releases of each.

    `again`: each grain is released not once, where it sets out, as the thesis does, but every `RELEASES` mean durations of a jump, after the jumps that are
    discarded: what is then seen does not remember the start; lags reach over a third of that time. Members of a grain are neighbours; k: along and, in
    three dimensions, across the stream. Thesis, section 4.3.2, figs 4-17 and 4-18.
    """
    path = result.trajectory
    time = path["time"].to_numpy()
    positions = np.stack([path[name].to_numpy() for name in "xy" if name in path], axis=2)
    positions = positions[:, np.isfinite(positions).all(axis=(0, 2))]
    duration, begin = float(result.jumps["duration"].mean()), 0.0
    longest = time[-1] - time[0]
    if again:
        begin = result.scene.run.discard * duration
        longest = (time[-1] - begin) / 3.0
    if not longest > time[1] - time[0]:
        raise ValueError(f"ensemble needs a longer run with jumps that count, got one of {time[-1]:g} d/u*")
    lags = np.geomspace(time[1] - time[0], longest, LAGS)
    starts = np.arange(begin, time[-1] - longest, RELEASES * duration) if again else time[:1]
    if not again:
        lags = time[np.unique(np.searchsorted(time, time[0] + lags * (1.0 - 1e-9)))] - time[0]
    members = [statistics.displacements(time, positions[:, grain], starts, lags) for grain in range(positions.shape[1])]
    return lags, np.concatenate(members), len(starts)


def exponents(result: Result, seed: int = 0, resamples: int = 400) -> pd.DataFrame:
    """γ of ⟨X'²⟩ and ⟨Y'²⟩ ∝ t^(2γ) in the three ranges, with 95 % intervals from the scatter over grains (drawn with all their releases).

    One row per ensemble ("first": released where they set out; "all": again and again), axis and range: low, high (lags, d/u*), gamma, lower, upper. NaN where
    grains do not scatter, are fewer than ten, or a range lies beyond the run. Thesis (4-14), (4-15), figs 4-17 and 4-18; ranges of
    Nikora et al. (2001), here in mean durations of a jump, `RANGES`.
    """
    duration = float(result.jumps["duration"].mean())
    rows = []
    for name in ("first", "all"):
        lags, members, releases = ensemble(result, name == "all")
        for k, axis in enumerate("xy"[: members.shape[2]]):
            for which, bounds in RANGES.items():
                low, high = max(bounds[0] * duration, lags[0]), min(bounds[1] * duration, lags[-1])
                gamma, interval = math.nan, (math.nan, math.nan)
                try:
                    gamma = statistics.fit_exponent(lags, members[:, :, k].var(axis=0), low, high)[0]
                    interval = statistics.exponent_interval(lags, members[:, :, k], low, high, block=releases, seed=seed, resamples=resamples)
                except ValueError:  # no exponent, or none whose scatter is known
                    pass
                rows.append((name, axis, which, low, high, gamma, *interval))
    return pd.DataFrame(rows, columns=["ensemble", "axis", "range", "low", "high", "gamma", "lower", "upper"])


def shares_across(members: Mapping[tuple[bool, bool], Floats], seed: int = 0, resamples: int = 400) -> pd.DataFrame:
    """Shares of bed and encounters in the spreading across the stream, ⟨Y'²⟩, at each lag.

    `members`: displacements across (grains, lags), d, of four ensembles, by (whether the bed scatters across, whether grains meet). What a source adds is taken
    as the mean of what it adds alone and beside the other (Shapley 1953), so that the shares add to one. One row per lag: bed, encounters,
    lower and upper (95 % interval of the bed's share; grains are drawn). Thesis, section 4.3.2, after fig. 4-18.
    """
    four = [(bed, meeting) for bed in (False, True) for meeting in (False, True)]
    missing = [key for key in four if key not in members]
    if missing:
        raise ValueError(f"members must hold runs with and without each of bed and encounters, got none for (bed, encounters) = {missing[0]}")

    def share(moments: Sequence[Floats]) -> Floats:
        neither, encounters, bed, both = moments
        if not (both > neither).all():
            raise ValueError("members must spread further with bed and encounters than without: there is nothing to share")
        found: Floats = 0.5 * ((bed - neither) + (both - encounters)) / (both - neither)
        return found

    rng = np.random.default_rng(seed)
    own = share([members[key].var(axis=0) for key in four])
    drawn = [share([x[rng.integers(len(x), size=len(x))].var(axis=0) for x in map(members.__getitem__, four)]) for _ in range(resamples)]
    lower, upper = np.quantile(drawn, [0.025, 0.975], axis=0)
    return pd.DataFrame({"bed": own, "encounters": 1.0 - own, "lower": lower, "upper": upper})


# How many jumps a mean needs


def first_means(jumps: pd.DataFrame, counts: Sequence[int] = FIRST, drop: int = LEFT_OUT) -> pd.DataFrame:
    """Means of height and length, d, over the first n jumps of one grain without the first `drop` of them: thesis fig. 4-3.

    One row per n that the grain reaches; `_sd` is that of single jumps, `_se` the standard error of the mean (blocks of successive jumps).
    """
    rows = []
    for count in [count for count in counts if drop + 1 < count <= len(jumps)]:
        row: dict[str, Any] = {"jumps": count}
        for name in ("height", "length"):
            values = jumps[name].to_numpy()[drop:count]
            row |= {name: values.mean(), f"{name}_sd": values.std(ddof=1), f"{name}_se": statistics.standard_error(values)}
        rows.append(row)
    return pd.DataFrame(rows)


def convergence(result: Result, counts: Sequence[int] = COUNTS) -> pd.DataFrame:
    """Means of height and length, d, over the first n jumps that count of each grain: `first_means` with many grains instead of one.

    `_sd` is that of single jumps, `_scatter` the standard deviation over grains of their means of n jumps: what such a mean is uncertain by.
    """
    jumps = result.jumps
    number, total = jumps.groupby("grain").cumcount(), jumps.groupby("grain")["height"].transform("size")
    rows = []
    for count in counts:
        own = jumps[(number < count) & (total >= count)]
        row: dict[str, Any] = {"jumps": count, "grains": own["grain"].nunique()}
        for name in ("height", "length"):
            row |= {name: own[name].mean(), f"{name}_sd": own[name].std(), f"{name}_scatter": own.groupby("grain")[name].mean().std()}
        rows.append(row)
    return pd.DataFrame(rows)


# All of it


def analyses(table: pd.DataFrame, opened: Callable[[str], Result]) -> dict[str, pd.DataFrame]:
    """All tables of the 24 runs of Table 4-1, or of others with such labels; `opened` gives the result of a run by its label `name`.

    table_4_2; comparison, of each run with and without encounters; changes, per run with encounters (slow: how many were left out);
    exponents; convergence: each with the labels of the runs.
    """
    found: dict[str, list[pd.DataFrame]] = {"comparison": [], "changes": [], "exponents": [], "convergence": []}
    for run, both in table.groupby(RUN, sort=False):
        labels = dict(zip(RUN, run, strict=True))
        results = {bool(row["encounters"]): opened(str(row["name"])) for _, row in both.iterrows()}
        if len(results) == 2:
            found["comparison"].append(compare(results[True], results[False]).assign(**labels))
        if True in results:
            found["changes"].append(distribution(changes(results[True])).assign(**labels, slow=int(parted_slowly(results[True]).sum())))
        for meeting, result in results.items():
            found["convergence"].append(convergence(result).assign(**labels, encounters=meeting))
            with contextlib.suppress(ValueError):  # too short to have any
                own = exponents(result)
                own["printed"] = printed_exponents(labels, own, meeting)
                found["exponents"].append(own.assign(**labels, encounters=meeting))
    tables = {"table_4_2": table_4_2(table)}
    for name, parts in found.items():
        whole = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()
        first = [label for label in (*RUN, "encounters") if label in whole]
        tables[name] = whole[first + [column for column in whole if column not in first]]
    return tables


def printed_exponents(labels: dict[str, Any], rows: pd.DataFrame, meeting: bool) -> list[float]:
    """The thesis's exponents beside ours; NaN for other runs than that of figs 4-17 and 4-18."""
    if not (math.isclose(labels["concentration"], 0.0233) and math.isclose(labels["particle_reynolds"], 73.0) and math.isclose(labels["stage"], 2.0)):
        return [math.nan] * len(rows)
    return [EXPONENTS[axis, meeting][list(RANGES).index(which)] for axis, which in zip(rows["axis"], rows["range"], strict=True)]
