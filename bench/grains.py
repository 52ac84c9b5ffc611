"""Scenes of the saltation suite, run on all cores, and what is kept of each run for JSON."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

import saltation
from basset.kernels import Floats
from saltation import statistics
from saltation.flight.cost import form_of
from saltation.plots import run as plots
from saltation.results.result import Result
from saltation.scene import scene_of
from saltation.study import grains as many
from saltation.study.thesis import case
from saltation.workers import processes

QUANTITIES = ("height", "length", "velocity")
MORE = ("duration", "spin", "takeoff_angle", "takeoff_x", "takeoff_z", "stokes")
QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


def base(name: str, jumps: int, discard: int = 20) -> dict[str, Any]:
    """A shipped scene as the thesis has it, `jumps` of them counted, its path not kept."""
    content = case(name)
    content["run"] |= {"jumps": jumps + discard, "discard": discard, "trajectory": False}
    return content


def changed(content: Mapping[str, Any], without: tuple[str, ...] = (), **tables: Any) -> dict[str, Any]:
    """The scene with other fields; `without` these effects and their tables. Tables are merged, the rest is replaced."""
    result = copy.deepcopy(dict(content))
    for name, value in tables.items():
        result[name] = {**result.get(name, {}), **value} if isinstance(value, Mapping) else value
    result["effects"] = [name for name in result["effects"] if name not in without]
    for name in without:
        result.pop(name, None)
    return result


def at_fixed_steps(content: Mapping[str, Any], method: str, dt: float, jumps: int, history: Mapping[str, Any]) -> dict[str, Any]:
    """The scene at steps of `dt` d/u*, so many jumps long, with these fields of its history."""
    own, run = {**content["history"], **history}, {**content["run"], "jumps": jumps}
    return {**content, "solver": {"method": method, "dt": dt}, "history": own, "run": run}


@dataclass(frozen=True)
class Task:
    """One run and what is kept of it: a key of `KEPT`, or a function of a module."""

    scene: dict[str, Any]
    keep: str | Callable[[Result], dict[str, Any]] = "means"


def run_all(tasks: Mapping[Any, Task], workers: int | None = None) -> dict[Any, dict[str, Any]]:
    """What is kept of every run, by its key; over all cores, or with `workers` = 0 here, one after the other."""
    if workers == 0:
        return {key: measured(task.scene, task.keep) for key, task in tasks.items()}
    forms: dict[Any, list[Any]] = {}
    for key, task in tasks.items():
        forms.setdefault(form_of(scene_of(task.scene)), []).append(key)
    # the first of every compiled form first: workers compile different things, and share them on disk
    order = sorted(((place, key) for keys in forms.values() for place, key in enumerate(keys)), key=lambda pair: pair[0])
    keys = [key for _, key in order]
    with processes(workers) as pool:
        rows = pool.map(measured, [tasks[key].scene for key in keys], [tasks[key].keep for key in keys])
        found = dict(zip(keys, rows, strict=True))
    return {key: found[key] for key in tasks}


def measured(scene: dict[str, Any], keep: str | Callable[[Result], dict[str, Any]]) -> dict[str, Any]:
    """Run a scene; keep what is asked for."""
    result = saltation.run(scene_of(scene))
    return keep(result) if callable(keep) else KEPT[keep](result)


def rounded(values: Any, digits: int = 5) -> Any:
    """Numbers with so many digits, for readable JSON."""
    if isinstance(values, Mapping):
        return {key: rounded(value, digits) for key, value in values.items()}
    if isinstance(values, (list, tuple, np.ndarray)):
        return [rounded(value, digits) for value in values]
    return float(f"{float(values):.{digits}g}") if isinstance(values, (float, np.floating)) else values


def mean_of(values: Floats) -> dict[str, float]:
    """Mean, standard deviation of single jumps, standard error of the mean (block bootstrap)."""
    finite = values[np.isfinite(values)]
    spread = float(finite.std(ddof=1)) if len(finite) > 1 else float("nan")
    return rounded({"mean": float(finite.mean()) if len(finite) else float("nan"), "sd": spread, "se": statistics.standard_error(finite)})


def means(result: Result) -> dict[str, Any]:
    """Means of the jumps that count, and the series that pairs need."""
    jumps = result.jumps
    row: dict[str, Any] = {"status": result.status, "message": result.message, "jumps": len(jumps)}
    row |= {name: mean_of(jumps[name].to_numpy()) for name in (*QUANTITIES, *MORE)}
    row["deviation"] = mean_of(jumps["deviation_angle"].abs().to_numpy())
    row |= rounded({name: result.provenance[name] for name in ("clipped", "creeping")})
    row["stokes_range"] = rounded(result.provenance["stokes"])
    if result.scene.channel is not None and jumps["impulse_z"].sum() != 0.0:
        row["bed_load"] = rounded(result.bed_load())
    row["series"] = {name: jumps[name].to_numpy() for name in QUANTITIES}
    return row


def heights(result: Result) -> dict[str, Any]:
    """The means, and every height and deviation in increasing order."""
    jumps = result.jumps
    row = means(result)
    row["heights"] = rounded(np.sort(jumps["height"].to_numpy()), 3)
    row["deviations"] = rounded(np.sort(jumps["deviation_angle"].abs().to_numpy()), 3)
    return row


def forces(result: Result) -> dict[str, Any]:
    """The mean jump, the mean forces over its phase, and quartiles of each force's share over all jumps and phases."""
    frame = result.budget()
    row: dict[str, Any] = {"jumps": len(result.jumps), "phase": {str(name): rounded(frame[name].to_numpy(), 4) for name in frame}}
    row["path"] = first_jumps(result)
    for axis in "xz":
        names = [name for name in plots.FORCES if f"{name}_{axis}" in frame]
        values = np.abs(plots.over_phase(result, [f"{name}_{axis}" for name in names]))
        shares = 100.0 * values / values.sum(axis=2, keepdims=True)
        row[f"quartiles_{axis}"] = {name: rounded(np.quantile(shares[:, :, k], QUARTERS), 4) for k, name in enumerate(names)}
    return row


def first_jumps(result: Result, count: int = 8) -> dict[str, Any]:
    """The path of the first jumps that count, and where they met the bed; x and y from the first takeoff."""
    path, jumps = result.trajectory, result.jumps.iloc[:count]
    time, ends = path["time"].to_numpy(), np.append(jumps["start"], jumps["start"].iloc[-1] + jumps["duration"].iloc[-1])
    wanted = np.unique(np.concatenate([np.linspace(start, start + duration, 31) for start, duration in zip(jumps["start"], jumps["duration"], strict=True)]))
    origin = {name: float(np.interp(ends[0], time, path[name])) if name != "z" else 0.0 for name in "xyz"}
    curves = {name: rounded(np.interp(wanted, time, path[name]) - origin[name], 4) for name in "xyz"}
    return curves | {"impacts": {name: rounded(np.interp(ends, time, path[name]) - origin[name], 4) for name in "xyz"}}


def spread(result: Result) -> dict[str, Any]:
    """Second moments of the displacement against the lag, and exponents with intervals from the scatter over takeoffs."""
    path, jumps = result.trajectory, result.jumps
    duration, end = float(jumps["duration"].mean()), float(path["time"][-1])
    lags = np.geomspace(0.02 * duration, min(50.0 * duration, 0.1 * (end - float(jumps["start"].iloc[0]))), 40)
    starts = jumps["start"].to_numpy()
    starts = starts[starts + lags[-1] <= end]
    positions = np.stack([path["x"].to_numpy(), path["y"].to_numpy()], axis=1)
    members = statistics.displacements(path["time"].to_numpy(), positions, starts, lags)
    moments = members.var(axis=0)
    exponents = []
    for k, axis in enumerate("xy"):
        for name, (low, high) in zip(("local", "intermediate"), plots.ranges_of(lags, duration), strict=False):
            gamma = statistics.fit_exponent(lags, moments[:, k], low, high)[0]
            block = max(1, int(np.ceil(min(high, lags[-1]) / duration)))
            interval = statistics.exponent_interval(lags, members[:, :, k], low, high, block=block) if len(starts) >= 10 * block else (None, None)
            exponents.append({"axis": axis, "range": name, "low": low, "high": high, "gamma": gamma, "interval": interval})
    row = {"jumps": len(jumps), "duration": duration, "lag": lags, "x": moments[:, 0], "y": moments[:, 1]}
    return {**rounded(row), "exponents": rounded(exponents)}


def first_path(result: Result) -> dict[str, Any]:
    """A single jump without a bed: its path from the start until the centre is as low again, height and length."""
    path = result.trajectory
    return cut_path(path["time"].to_numpy(), path["x"].to_numpy(), path["z"].to_numpy(), float(result.scene.start.height / result.scene.numbers.diameter))


def second_path(result: Result) -> dict[str, Any]:
    """The flight after the first impact, from there until the centre is as low again."""
    path, impact = result.trajectory, result.all_jumps.iloc[0]
    time = path["time"].to_numpy()
    low = int(np.searchsorted(time, (impact["start"] + impact["duration"]) * (1.0 - 1e-12)))
    arrays = [path[name].to_numpy()[low:] for name in ("x", "z")]
    jump = result.all_jumps.iloc[1]
    row = cut_path(time[low:], arrays[0], arrays[1], float(jump["height_above_bed"] - jump["height"]))
    return row | {"takeoff": rounded([float(jump["takeoff_x"]), float(jump["takeoff_z"])])}


def cut_path(time: Floats, x: Floats, z: Floats, level: float) -> dict[str, Any]:
    """The path from where it starts until it comes down to `level`; x from the start, heights above `level`."""
    top = int(np.argmax(z))
    below = np.flatnonzero(z[top:] <= level)
    if len(below):
        last = top + int(below[0])
        share = (z[last - 1] - level) / (z[last - 1] - z[last])
        end = time[last - 1] + share * (time[last] - time[last - 1])
    else:
        end = time[-1]
    wanted, places = np.linspace(time[0], end, 41), np.unique(time, return_index=True)[1]
    along, up = (PchipInterpolator(time[places], values[places])(wanted) - origin for values, origin in ((x, x[0]), (z, level)))
    return rounded({"height": float(z.max() - level), "length": float(along[-1]), "x": along, "z": up, "landed": bool(len(below))})


def met(result: Result) -> dict[str, Any]:
    """How often grains met each other and the bed, what that changed, and how far they came across the stream, if paths were kept."""
    often, slow = result.frequencies(), many.parted_slowly(result).sum() / result.time
    row: dict[str, Any] = {"pair_frequency": often["pairs"], "bed_frequency": often["bed"], "slow_frequency": float(slow)}
    row |= {"changes": many.changes(result), "duration": float(result.jumps["duration"].mean())}
    if result.scene.run.trajectory:
        lags, members, _ = many.ensemble(result)
        row |= {"lag": lags, "across": members[:, :, 1]}
    return row


KEPT: dict[str, Callable[[Result], dict[str, Any]]] = {
    "means": means,
    "heights": heights,
    "forces": forces,
    "spread": spread,
    "first path": first_path,
    "second path": second_path,
    "met": met,
}
