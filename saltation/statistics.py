"""Statistics of jumps: means with standard errors for correlated jumps, agreement with measurements, ranks, diffusion.

A table of jumps has one row per jump, in the order in which they happened. Successive jumps of a grain are correlated, so
standard errors come from blocks of jumps. Lengths are in grain diameters d, velocities in u*, times in d/u*.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from basset import _validate
from basset._validate import finite as _reals

Floats = NDArray[np.float64]

QUANTITIES = ("height", "length", "duration", "velocity", "spin", "takeoff_angle", "incidence_angle", "deviation_angle", "stokes")
VARIABLES = ("height", "length", "velocity")  # H, L and ū: what models are judged by
REFERENCE_COLUMNS = ("variable", "T", "mean", "sd", "n", "source")

_DRAWS = 2_000_000  # random numbers held at a time
_FEWEST_BLOCKS = 10  # with fewer, whole resamples of one single block become likely


# Errors of means


def block_length(values: ArrayLike) -> int:
    """Length of the blocks in which the circular block bootstrap best resamples a correlated series (n,).

    b = (2 G²/D)^(1/3) n^(1/3) rounded up, G = Σ λ(k/M) |k| R(k), D = 4/3 (Σ λ(k/M) R(k))², R the autocovariance, λ(s) = min(1, 2 (1 − |s|)),
    M twice the first of max(5, log10 n) lags in a row whose autocorrelations are below 2 √(log10 n/n); at most min(3 √n, n/3).
    Politis and White (2004), Econometric Reviews 23, 53–70, as corrected by Patton, Politis and White (2009), ibid. 28, 372–375.

    >>> rng = np.random.default_rng(1)
    >>> block_length(rng.normal(size=500)) < block_length(np.cumsum(rng.normal(size=500)))
    True
    """
    x = _series("values", values)
    n = x.size
    if n < 2 or np.ptp(x) == 0.0:
        return 1
    x = x - x.mean()
    run = max(5, math.ceil(math.log10(n)))
    most = math.ceil(math.sqrt(n)) + run
    covariance = np.zeros(most + run + 1)  # beyond the series: zero
    for lag in range(min(n, covariance.size)):
        covariance[lag] = x[lag:] @ x[: n - lag] / n
    significant = np.abs(covariance[1:]) >= 2.0 * math.sqrt(math.log10(n) / n) * covariance[0]
    quiet = np.convolve(significant, np.ones(run), mode="valid") < 0.5  # no significant lag among the `run` from here on
    first = 1 + int(np.argmax(quiet)) if quiet.any() else most
    width = min(2 * first, most)
    lags = np.arange(1, width + 1)
    weighted = 2.0 * np.minimum(1.0, 2.0 * (1.0 - lags / width)) * covariance[1 : width + 1]  # both signs of the lag
    slope, spectrum = float(weighted @ lags), float(covariance[0] + weighted.sum())
    longest = min(3.0 * math.sqrt(n), n / 3.0)
    if spectrum != 0.0:
        longest = min(longest, math.cbrt(1.5 * n * (slope / spectrum) ** 2))
    return max(1, math.ceil(longest))


def standard_error(values: ArrayLike, seed: int = 0, resamples: int = 400) -> float:
    """Standard error of the mean of a correlated series (n,), in its unit, by the circular block bootstrap; NaN for fewer than two values.

    Blocks scatter about the mean of the sample instead of the true one, which makes their variance too small by 1 − b/n: undone. What remains is the
    bias of finite blocks (autocorrelations 0.5^k: 7 % too small for 600 values, 20 % for 50) and a scatter of 1/√(2·resamples).
    Politis and Romano (1992), in Exploring the Limits of Bootstrap, 263–270; block length of Politis and White (2004).
    """
    x = _series("values", values)
    seed, resamples = _validate.integer("seed", seed, 0), _validate.integer("resamples", resamples, 2)
    if x.size < 2:
        return math.nan
    if np.ptp(x) == 0.0:
        return 0.0
    block = block_length(x)
    means = _resampled_means(x - x.mean(), block, resamples, np.random.default_rng(seed))
    return math.sqrt(means @ means / resamples * x.size / (x.size - block))


def _resampled_means(x: Floats, block: int, resamples: int, rng: np.random.Generator) -> Floats:
    """Means of draws of x in circular blocks, the last one cut so that each draw has as many values as x."""
    whole, rest = divmod(x.size, block)
    sums = np.concatenate([[0.0], np.cumsum(np.concatenate([x, x[:block]]))])
    lengths = np.array([block] * whole + [rest] * (rest > 0))
    means = np.empty(resamples)
    rows = max(1, _DRAWS // lengths.size)
    for low in range(0, resamples, rows):
        starts = rng.integers(x.size, size=(min(rows, resamples - low), lengths.size))
        means[low : low + rows] = (sums[starts + lengths] - sums[starts]).sum(axis=1) / x.size
    return means


def summary(jumps: pd.DataFrame, columns: Sequence[str] | None = None, seed: int = 0, resamples: int = 400) -> pd.DataFrame:
    """Mean, standard deviation (of single jumps), standard error of the mean and count of columns of a table of jumps, in its units.

    Rows in the order in which the jumps happened; with a column "grain" each grain's jumps are taken one after the other.
    """
    _frame("jumps", jumps)
    if columns is None:
        columns = [name for name in QUANTITIES if name in jumps.columns]
    elif isinstance(columns, str):
        raise TypeError(f"columns must be a sequence of names, got the single name {columns!r}: write [{columns!r}]")
    if "grain" in jumps.columns:
        jumps = jumps.sort_values("grain", kind="stable")
    rows = []
    for name in columns:
        if name not in jumps.columns:
            known = [str(column) for column in jumps.columns]
            raise ValueError(f"columns must name columns of jumps, got {name!r}{_validate.suggestion(str(name), known)}")
        x = _series(str(name), jumps[name])
        rows.append((_mean(x), _deviation(x), standard_error(x, seed, resamples), x.size))
    return pd.DataFrame(rows, index=pd.Index(columns, name="column"), columns=["mean", "standard_deviation", "standard_error", "count"])


class Difference(NamedTuple):
    """Difference of two means, its standard error, and whether that is the error of a series of differences; in the unit of the quantity."""

    mean: float
    standard_error: float
    paired: bool


def paired_difference(first: ArrayLike, second: ArrayLike, seed: int = 0, resamples: int = 400) -> Difference:
    """Mean of `first` (n,) minus mean of `second` (m,), one quantity of two runs of one seed that differ in one thing.

    Runs of one seed draw the same random numbers at the same impact of the same grain. As many jumps in both: the error is that of the series of
    differences, right whether or not the runs are alike. Else the errors of both means are added in squares as if the runs were independent.

    >>> paired_difference([2.0, 3.0, 4.0], [1.0, 2.0, 3.0])
    Difference(mean=1.0, standard_error=0.0, paired=True)
    """
    one, two = _series("first", first), _series("second", second)
    if one.size == two.size:
        return Difference(_mean(one - two), standard_error(one - two, seed, resamples), True)
    errors = (standard_error(one, seed, resamples), standard_error(two, seed, resamples))
    return Difference(_mean(one) - _mean(two), math.hypot(*errors), False)


# Agreement with measurements


def read_reference(path: str | PathLike[str]) -> pd.DataFrame:
    """Measured means to judge runs by, from a CSV file (UTF-8) of one particle Reynolds number, in its units: heights and lengths in d, velocities in u*.

    Columns in any order: variable (height, length or velocity), T (transport stage τ*/τ*c), mean, sd (of single jumps; may be empty, then NaN),
    n (number of jumps; may be empty, then <NA>) and source. Whatever else stands there is refused with its line and column (ValueError).
    """
    name = fspath(path)
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            lines = [(reader.line_num, [field.strip() for field in row]) for row in reader if any(field.strip() for field in row)]
    except UnicodeDecodeError:
        raise ValueError(f"{name} must be text in UTF-8, got other bytes: save it as “CSV UTF-8”") from None
    except csv.Error as error:
        raise ValueError(f"{name} must be a CSV file, got one that cannot be split into fields: {error}") from None
    if not lines:
        raise ValueError(f"{name} must begin with the line {','.join(REFERENCE_COLUMNS)!r}, got no line at all")
    header = lines[0][1]
    _check_header(name, header)
    if len(lines) == 1:
        raise ValueError(f"{name} must hold at least one measured mean, got the line of column names alone")
    rows: list[dict[str, Any]] = []
    seen: dict[tuple[str, float, str], int] = {}
    for line, fields in lines[1:]:
        where = f"{name}, line {line}"
        if len(fields) != len(header):
            raise ValueError(f"{where} must have {len(header)} fields ({', '.join(header)}), got {len(fields)}")
        row = _reference_row(where, dict(zip(header, fields, strict=True)))
        key = (row["variable"], row["T"], row["source"])
        if key in seen:
            raise ValueError(f"{where} must differ from line {seen[key]} in variable, T or source, got {key[0]}, {key[1]:g}, {key[2]!r} again")
        seen[key] = line
        rows.append(row)
    return pd.DataFrame(rows, columns=list(REFERENCE_COLUMNS)).astype({"n": "Int64"})


def _check_header(name: str, header: list[str]) -> None:
    """Every column once, and no other: a forgotten R_p column would mix two sets of measurements."""
    right = f"{name} must have the columns {', '.join(REFERENCE_COLUMNS)}, separated by commas"
    for column in header:
        if column not in REFERENCE_COLUMNS:
            raise ValueError(f"{right}, got the column {_validate.shown(column)}{_validate.suggestion(column, REFERENCE_COLUMNS)}")
        if header.count(column) > 1:
            raise ValueError(f"{right}, got the column {column!r} twice")
    missing = [column for column in REFERENCE_COLUMNS if column not in header]
    if missing:
        raise ValueError(f"{right}, got none called {missing[0]!r}")


def _reference_row(where: str, fields: dict[str, str]) -> dict[str, Any]:
    """One line of measurements, its numbers checked."""

    def number(column: str, right: str, good: Callable[[float], bool], empty: bool = False) -> float:
        text = fields[column]
        if empty and not text:
            return math.nan
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and good(value)):
            raise ValueError(f"{where}: {column} must be {right}, got {_validate.shown(text)}")
        return value

    row: dict[str, Any] = {"variable": fields["variable"], "source": fields["source"]}
    if row["variable"] not in VARIABLES:
        hint = _validate.suggestion(row["variable"], VARIABLES)
        raise ValueError(f"{where}: variable must be height, length or velocity, got {_validate.shown(row['variable'])}{hint}")
    if not row["source"]:
        raise ValueError(f"{where}: source must say where the numbers come from, got an empty field")
    row["T"] = number("T", "a transport stage greater than 0", lambda value: value > 0.0)
    row["mean"] = number("mean", "a number greater than 0", lambda value: value > 0.0)
    row["sd"] = number("sd", "a finite number, 0 or greater, or empty", lambda value: value >= 0.0, empty=True)
    count = number("n", "a whole number, 1 or greater, or empty", lambda value: value >= 1.0 and value.is_integer(), empty=True)
    row["n"] = None if math.isnan(count) else int(count)
    return row


def rmse(predicted: ArrayLike, observed: ArrayLike) -> float:
    """Root mean square error over the mean observation, √(Σ(P − O)²/n)/Ō of pairs in one unit: a fraction (thesis, section 3.4.2)."""
    p, o = _series("predicted", predicted), _series("observed", observed)
    if p.size != o.size or not o.size:
        raise ValueError(f"predicted and observed must be pairs, at least one, got {p.size} and {o.size} values")
    if not o.mean() > 0.0:
        raise ValueError(f"observed must have a mean greater than 0, which the error is divided by, got {o.mean():g}")
    return math.sqrt(np.mean((p - o) ** 2)) / float(o.mean())


def errors(reference: pd.DataFrame, simulated: pd.DataFrame, variables: Sequence[str] = VARIABLES) -> pd.Series:
    """`rmse` of each variable at the transport stages of the reference (thesis, section 3.4.2); between simulated stages the mean is interpolated linearly."""
    result = {}
    for variable in variables:
        stages, observed = _curve("reference", reference, variable, "mean")
        own, means = _curve("simulated", simulated, variable, "mean")
        _check_covered(variable, stages, own)
        result[variable] = rmse(np.interp(stages, own, means), observed)
    return pd.Series(result, name="rmse", dtype=np.float64)


def error_index(reference: pd.DataFrame, simulated: pd.DataFrame) -> float:
    """Mean of the `errors` of height, length and velocity: a fraction (thesis, section 3.4.2 and Table 3-6)."""
    return float(errors(reference, simulated).mean())


def overlap_areas(reference: pd.DataFrame, simulated: pd.DataFrame, variables: Sequence[str] = VARIABLES) -> pd.Series:
    """How much of each measured band is covered by the simulated one, per cent of the measured area (thesis, section 3.4.2 and fig. 3-8).

    A band reaches from mean − sd to mean + sd over T, with straight edges between the stages. A tiny simulated band within the measured one scores
    low, a huge one 100.
    """
    result = {}
    for variable in variables:
        stages, *band = _band("reference", reference, variable)
        own, *own_band = _band("simulated", simulated, variable)
        _check_covered(variable, stages, own)
        area = float(np.trapezoid(band[1] - band[0], stages))
        if not area > 0.0:
            raise ValueError(f"reference must give {variable} a band of some area: two stages or more with sd above 0, got {stages.size} stage(s)")
        result[variable] = 100.0 * _common_area(stages, band, own, own_band) / area
    return pd.Series(result, name="overlap", dtype=np.float64)


def overlap_index(reference: pd.DataFrame, simulated: pd.DataFrame) -> float:
    """Mean of the `overlap_areas` of height, length and velocity, per cent (thesis, section 3.4.2 and Table 3-5)."""
    return float(overlap_areas(reference, simulated).mean())


def _common_area(stages: Floats, band: Sequence[Floats], own: Floats, own_band: Sequence[Floats]) -> float:
    """Area common to two bands (lower, upper) over `stages`: exact, as between all corners and crossings the height is linear."""

    def edges(at: Floats) -> tuple[tuple[Floats, Floats], ...]:
        return tuple((np.interp(at, stages, edge), np.interp(at, own, own_edge)) for edge, own_edge in zip(band, own_band, strict=True))

    at = np.union1d(stages, own[(own > stages[0]) & (own < stages[-1])])
    (low, own_low), (high, own_high) = edges(at)
    crossings = [at]
    for gap in (low - own_low, high - own_high, low - own_high, own_low - high):
        left = np.flatnonzero(gap[:-1] * gap[1:] < 0.0)
        crossings.append(at[left] + (at[left + 1] - at[left]) * gap[left] / (gap[left] - gap[left + 1]))
    at = np.unique(np.concatenate(crossings))
    lower, upper = edges(at)
    return float(np.trapezoid(np.maximum(np.minimum(*upper) - np.maximum(*lower), 0.0), at))


def _band(name: str, table: pd.DataFrame, variable: str) -> tuple[Floats, Floats, Floats]:
    """Stages and lower and upper edge of a variable's band."""
    stages, mean = _curve(name, table, variable, "mean")
    _, sd = _curve(name, table, variable, "sd")
    if np.isnan(sd).any():
        stage = stages[np.isnan(sd)][0]
        raise ValueError(f"{name} must give the sd of {variable} at T = {stage:g} for an overlap area, got none: use error_index, which needs means only")
    if (sd < 0.0).any():
        raise ValueError(f"{name} must give an sd of 0 or greater, got {sd.min():g} for {variable}")
    return stages, mean - sd, mean + sd


def _curve(name: str, table: pd.DataFrame, variable: str, column: str) -> tuple[Floats, Floats]:
    """Stages of one variable in increasing order, and the values of a column there; only an sd may be NaN."""
    _frame(name, table)
    for needed in ("variable", "T", column):
        if needed not in table.columns:
            raise ValueError(f"{name} must have the columns variable, T and {column}, got {_validate.shown([str(own) for own in table.columns])}")
    rows = table[table["variable"] == variable].sort_values("T", kind="stable")
    if rows.empty:
        raise ValueError(f"{name} must have rows for {variable}, got them only for {_validate.shown(sorted(set(map(str, table['variable']))))}")
    stages = _series(f"T of {name}", rows["T"])
    twice = np.flatnonzero(np.diff(stages) == 0.0)
    if twice.size:
        raise ValueError(f"{name} must give one {variable} per stage, got two at T = {stages[twice[0]]:g}: keep one source")
    values = _reals(f"{column} of {name}", rows[column], missing=column == "sd")
    return stages, values


def _check_covered(variable: str, stages: Floats, own: Floats) -> None:
    slack = 1e-6 * stages[-1]
    if stages[0] < own[0] - slack or stages[-1] > own[-1] + slack:
        raise ValueError(f"simulated must reach over the reference's stages of {variable}, T = {stages[0]:g} to {stages[-1]:g}, got {own[0]:g} to {own[-1]:g}")


# Ranks


def rank_models(scores: pd.DataFrame | pd.Series, ascending: bool | Mapping[str, bool]) -> pd.DataFrame:
    """Rank of each model (rows) in each score (columns): 1 for the best, the mean rank for equals, NaN without a score (thesis, fig. 3-10).

    `ascending`, one for all or one per column: True where the lowest score is best (error index), False where the highest is (overlap index).

    >>> rank_models(pd.Series({"A": 0.3, "B": 0.1, "C": 0.3}), ascending=True).iloc[:, 0].tolist()
    [2.5, 1.0, 2.5]
    """
    if isinstance(scores, pd.Series):
        scores = scores.to_frame("score" if scores.name is None else scores.name)
    _frame("scores", scores)
    columns = list(scores.columns)
    directions = dict(ascending) if isinstance(ascending, Mapping) else dict.fromkeys(columns, ascending)
    if set(directions) != set(columns):
        raise ValueError(f"ascending must say True or False for each of {_validate.shown(columns)}, got {_validate.shown(list(directions))}")
    for column in columns:
        if not isinstance(directions[column], (bool, np.bool_)):
            raise TypeError(f"ascending must be True (lowest is best) or False (highest is best), got {_validate.shown(directions[column])}")
        if scores[column].dtype.kind not in "fiu":
            raise TypeError(f"scores must be real numbers, got {scores[column].dtype} in {column!r}")
    return pd.DataFrame({column: scores[column].rank(method="average", ascending=bool(directions[column])) for column in columns})


def mean_rank(scores: pd.DataFrame | pd.Series, ascending: bool | Mapping[str, bool]) -> pd.Series:
    """Mean of the ranks that a model has in several scores, best first; a model that lacks a score has NaN and comes last (thesis, fig. 3-10c)."""
    return rank_models(scores, ascending).mean(axis=1, skipna=False).rename("mean_rank").sort_values(kind="stable")


# Diffusion: ⟨X'²⟩ ∝ t^(2γ), γ = 1 ballistic, 0.5 normal diffusion


def displacements(time: ArrayLike, positions: ArrayLike, starts: ArrayLike, lags: ArrayLike) -> Floats:
    """Displacements of one grain at each lag after each start, (starts, lags, k) in d, by linear interpolation between samples.

    `time` (samples,) in d/u* must not decrease, but may stand still (at a rebound); `positions` (samples, k) in d, not folded back into a periodic box.

    >>> displacements([0.0, 1.0, 2.0], [[0.0], [1.0], [3.0]], starts=[0.0, 1.0], lags=[0.5, 1.0])[:, :, 0]
    array([[0.5, 1. ],
           [1. , 2. ]])
    """
    t, x = _times(time), _reals("positions", positions)
    if x.ndim != 2 or x.shape[0] != t.size:
        raise ValueError(f"positions must have the shape (samples, k) with {t.size} samples as in time, got {x.shape}")
    begin, wait = _series("starts", starts), _series("lags", lags)
    if not begin.size or not wait.size:
        raise ValueError(f"starts and lags must hold at least one time each, got {begin.size} and {wait.size}")
    if wait.min() < 0.0:
        raise ValueError(f"lags must be 0 or greater, got {wait.min():g}")
    slack = 1e-9 * (t[-1] - t[0])
    if begin.min() < t[0] - slack or begin.max() + wait.max() > t[-1] + slack:
        raise ValueError(f"starts and starts + lags must lie within time, {t[0]:g} to {t[-1]:g}, got {begin.min():g} to {begin.max() + wait.max():g}")
    when = begin[:, None] + np.concatenate([[0.0], wait])
    path: Floats = np.stack([np.interp(when, t, column) for column in x.T], axis=-1)
    return path[:, 1:] - path[:, :1]


def second_moments(time: ArrayLike, positions: ArrayLike, starts: ArrayLike, lags: ArrayLike) -> Floats:
    """⟨X'²⟩ of one grain released again and again: the variance of its `displacements` over the starts, (lags, k) in d².

    Nikora et al. (2001), J. Phys. A 34, L743–L749; thesis (3-7), (3-8).
    """
    paths = displacements(time, positions, starts, lags)
    if len(paths) < 2:
        raise ValueError(f"starts must hold at least two times for a variance, got {len(paths)}")
    moments: Floats = np.var(paths, axis=0)
    return moments


def moments_of_grains(time: ArrayLike, positions: ArrayLike) -> Floats:
    """⟨X'²⟩ of many grains shifted to one release point, (samples, k) in d²: the variance of where they are since the first time.

    `time` (samples,) in d/u*, `positions` (samples, grains, k) in d, not folded back. Thesis (4-14), (4-15), figs. 4-17 and 4-18.
    """
    t, x = _times(time), _reals("positions", positions)
    if x.ndim != 3 or x.shape[0] != t.size or x.shape[1] < 2:
        raise ValueError(f"positions must have the shape (samples, grains, k) with {t.size} samples as in time and two grains or more, got {x.shape}")
    moments: Floats = np.var(x - x[0], axis=1)
    return moments


def fit_exponent(lags: ArrayLike, moments: ArrayLike, low: float, high: float) -> tuple[float, float]:
    """γ of ⟨X'²⟩ ∝ t^(2γ) and its standard error, by least squares of the logarithms, from the lags (d/u*) between `low` and `high`.

    All lags weigh the same: space them evenly in their logarithm. The standard error tells how straight the line is (neighbouring lags come from the same
    paths); `exponent_interval` tells how well γ is known. Thesis (3-7), (3-8), (4-14), (4-15).

    >>> t = np.array([1.0, 2.0, 4.0, 8.0])
    >>> round(fit_exponent(t, 3.0 * t**1.4, 1.0, 8.0)[0], 12)
    0.7
    """
    t, m = _series("lags", lags), _series("moments", moments)
    if t.size != m.size:
        raise ValueError(f"lags and moments must have the same length, got {t.size} and {m.size}")
    chosen = _in_range(t, low, high)
    if not (m[chosen] > 0.0).all():
        worst = m[chosen].min()
        raise ValueError(f"moments must be greater than 0 between the lags {low:g} and {high:g}, got {worst:g}: without spreading there is no exponent")
    x, y = np.log(t[chosen]), np.log(m[chosen])
    slope = float(_slopes(x, y))
    rest = y - y.mean() - slope * (x - x.mean())
    error = math.sqrt(rest @ rest / (x.size - 2) / np.sum((x - x.mean()) ** 2))  # from residuals: linregress has it from 1 − r², NaN for a level line
    return slope / 2.0, error / 2.0


def exponent_interval(
    lags: ArrayLike, members: ArrayLike, low: float, high: float, *, block: int = 1, level: float = 0.95, seed: int = 0, resamples: int = 400
) -> tuple[float, float]:
    """Interval of γ from the scatter over the members of the ensemble: percentiles of the bootstrap; `members` (members, lags) are displacements in d.

    Members are drawn with replacement, in circular blocks of `block` neighbours: 1 for independent members, such as grains; for starts whose paths
    overlap, `high` over the distance of starts, rounded up. At least ten blocks. Efron and Tibshirani (1993), An Introduction to the Bootstrap, ch. 13.

    >>> walks = np.cumsum(np.random.default_rng(1).normal(size=(200, 64)), axis=1)  # γ = ½
    >>> low, high = exponent_interval(np.arange(1.0, 65.0), walks, 1.0, 64.0)
    >>> low < 0.5 < high
    True
    """
    t, x = _series("lags", lags), _reals("members", members)
    if x.ndim != 2 or x.shape[1] != t.size:
        raise ValueError(f"members must have the shape (members, {t.size}), one column per lag, got {x.shape}")
    block, resamples = _validate.integer("block", block, 1), _validate.integer("resamples", resamples, 2)
    if not 0.0 < _validate.number("level", level) < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level:g}")
    count = x.shape[0]
    if count < _FEWEST_BLOCKS * block:
        raise ValueError(f"members must be at least {_FEWEST_BLOCKS * block}, ten blocks of {block}, got {count}")
    chosen = _in_range(t, low, high)
    x = x[:, chosen] - x[:, chosen].mean(axis=0)
    rng = np.random.default_rng(_validate.integer("seed", seed, 0))
    moments = np.empty((resamples, x.shape[1]))
    for row in moments:
        first = rng.integers(count, size=-(-count // block))
        drawn = x[(first[:, None] + np.arange(block)).ravel()[:count] % count]
        row[:] = np.var(drawn, axis=0)
    if not (moments > 0.0).all():
        raise ValueError(f"members must scatter at every lag between {low:g} and {high:g} in every draw, got draws in which they do not: too few members move")
    gammas = _slopes(np.log(t[chosen]), np.log(moments)) / 2.0
    ends = np.quantile(gammas, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(ends[0]), float(ends[1])


def _slopes(x: Floats, y: Floats) -> Floats:
    """Slope of the least-squares line of y over x, along the last axis of y."""
    deviation = x - x.mean()
    slopes: Floats = y @ deviation / (deviation @ deviation)
    return slopes


def _in_range(lags: Floats, low: float, high: float) -> NDArray[np.bool_]:
    """Which lags lie in [low, high]; refused when a line through them says nothing."""
    low, high = _validate.positive("low", low, "d/u*"), _validate.positive("high", high, "d/u*")
    chosen: NDArray[np.bool_] = (lags >= low) & (lags <= high)
    if np.unique(lags[chosen]).size < 3:
        raise ValueError(f"lags must hold three or more between low = {low:g} and high = {high:g}, got {np.unique(lags[chosen]).size}")
    return chosen


# Arguments


def _series(name: str, value: Any) -> Floats:
    """`value` as a finite float64 array of one dimension, possibly empty."""
    array = _reals(name, value)
    if array.ndim != 1:
        raise ValueError(f"{name} must have one dimension, got the shape {array.shape}")
    return array


def _times(value: Any) -> Floats:
    t = _series("time", value)
    if not t.size or (np.diff(t) < 0.0).any():
        raise ValueError(f"time must hold samples that do not decrease, got {_validate.shown(value)}")
    return t


def _frame(name: str, value: Any) -> None:
    if not isinstance(value, pd.DataFrame):
        raise TypeError(f"{name} must be a pandas DataFrame, got {_validate.shown(value)}")


def _mean(x: Floats) -> float:
    return float(x.mean()) if x.size else math.nan


def _deviation(x: Floats) -> float:
    return float(x.std(ddof=1)) if x.size > 1 else math.nan
