"""Figures of one run, for `saltation plot`: path, jumps, forces, spreading and spin, each with its message as its title.

Every function of `PLOTS` takes a `Result` and gives a Figure that belongs to no window and no backend. What a run cannot
show (no jumps, no path, no spin) is a ValueError with one sentence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.figure import Figure

from basset._look import BLACK, BLUE, GREEN, GREY, LOOK, ORANGE, PINK, RED
from basset.kernels import Floats
from saltation import statistics
from saltation.effects.rotation import prescribed_spin
from saltation.results.result import Result

__all__ = ["budget", "diffusion", "jumps", "spin", "stream", "trajectory"]

FORCES = {"weight": (BLACK, "s"), "drag": (BLUE, "D"), "history": (RED, "o"), "added_mass": (PINK, "v"), "lift": (GREEN, "^"), "magnus": (ORANGE, "P")}
WORDS = {name: name for name in FORCES} | {"added_mass": "added mass (shear term)", "magnus": "Magnus"}
SPREAD = {"x": ("along the stream", BLUE, "D"), "y": ("across the stream", ORANGE, "o")}
SHOWN = 8  # jumps of a path
LOCAL, INTERMEDIATE = (0.02, 0.25), (5.0, 50.0)  # ranges of lags in mean durations: within a jump; many jumps


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """The project's look, for this figure alone."""

    @wraps(draw)
    def drawn(*arguments: Any, **options: Any) -> Figure:
        with rc_context(LOOK):
            return draw(*arguments, **options)

    return drawn


def unit_of(result: Result) -> str:
    """The unit of velocity: u*, or V = √(|R| g d) in still water."""
    return str(result.scene.numbers.unit("u*"))


def jumps_of(result: Result, what: str) -> pd.DataFrame:
    """The jumps that count; refused where there is none."""
    jumps = result.jumps
    if not len(jumps):
        raise ValueError(f"{what} needs a jump that counts, got none: the run is {result.status} ({result.message})")
    return jumps


def draw_path(figure: Figure, along: Floats, up: Floats, across: Floats | None, impacts: Sequence[Floats], label: str) -> None:
    """Side view and, with `across`, plan of a path; `impacts`: where along, up and across it met the bed."""
    panels = figure.subplots(1 if across is None else 2, 1, sharex=True, squeeze=False)[:, 0]
    panels[0].plot(along, up, color=BLUE)
    panels[0].set_ylabel("height of the centre z (d)")
    if len(impacts[0]):
        panels[0].plot(impacts[0], impacts[1], "o", color=RED, label="impacts")
        panels[0].legend(loc="upper right")
    if across is not None:
        panels[1].plot(along, across, color=BLUE)
        panels[1].plot(impacts[0], impacts[2], "o", color=RED)
        panels[1].set_ylabel("across y (d)")
    panels[-1].set_xlabel(label)


@styled
def trajectory(result: Result) -> Figure:
    """Side view and plan of the first jumps that count; without a bed the whole path."""
    path, jumps = result.trajectory, result.jumps
    time, x, z = (path[name].to_numpy() for name in ("time", "x", "z"))
    chosen, ends = np.ones(len(time), dtype=bool), np.empty(0)
    if len(jumps):
        first = jumps.iloc[:SHOWN]
        low, high = float(first["start"].iloc[0]), float((first["start"] + first["duration"]).iloc[-1])
        chosen = (time >= low * (1.0 - 1e-12)) & (time <= high * (1.0 + 1e-12))
        ends = np.append(first["start"].to_numpy(), high)
    time, x, z = time[chosen], x[chosen], z[chosen]
    moves = np.ptp(x) > 1e-9 * max(1.0, float(np.ptp(z)))
    across = path["y"].to_numpy()[chosen] if "y" in path else np.zeros(len(time))
    plan = moves and np.ptp(across) > 0.0
    figure = Figure(figsize=(9.0, 5.2 if plan else 3.6))
    along, label = (x - x[0], "x (d)") if moves else (time - time[0], f"time (d/{unit_of(result)})")
    hits = [np.interp(ends, time, values) for values in (along, z, across)]
    draw_path(figure, along, z, across if plan else None, hits, label)
    if len(jumps):
        height, length = (float(jumps[name].mean()) for name in ("height", "length"))
        figure.suptitle(f"{min(SHOWN, len(jumps))} of {len(jumps)} jumps; mean height {height:.3g} d, mean length {length:.3g} d")
    else:
        figure.suptitle(f"The whole path: {result.message}")
    return figure


@styled
def jumps(result: Result) -> Figure:
    """Distributions of height, length, speed, takeoff angle and deviation."""
    table, numbers = jumps_of(result, "jumps"), result.summary()
    columns = {
        "height": "height H (d)",
        "length": "length L (d)",
        "velocity": f"mean velocity ū ({unit_of(result)})",
        "takeoff_angle": "takeoff angle (degrees)",
        "deviation_angle": "deviation in plan (degrees)",
    }
    shown = {name: label for name, label in columns.items() if np.isfinite(table[name]).all() and np.ptp(table[name]) > 0.0}
    if not shown:
        raise ValueError(f"jumps needs jumps that differ, got {len(table)} equal ones")
    figure = Figure(figsize=(10.0, 5.6))
    grid = figure.subplots(2, 3, squeeze=False).ravel()
    for axes, (name, label) in zip(grid, shown.items(), strict=False):
        values, row = table[name].to_numpy(), numbers.loc[name]
        axes.hist(values, bins=max(8, round(math.sqrt(len(values)))), color=BLUE, alpha=0.65)
        axes.axvline(row["mean"], color=RED)
        error = "" if math.isnan(row["standard_error"]) else f" ± {row['standard_error']:.1g}"
        axes.set_title(f"mean {row['mean']:.3g}{error}", color=RED, fontsize=10)
        axes.set(xlabel=label, ylabel="jumps")
    for axes in grid[len(shown) :]:
        axes.set_axis_off()
    where = result.provenance
    keys = ("profile", "roughness", "reading", "restitution", "rebound_memory", "kernel")
    notes = [f"{len(table)} jumps, {result.status}", *(f"{key.replace('_', ' ')}: {where[key]}" for key in keys if where.get(key) is not None)]
    if len(shown) < len(grid):
        grid[-1].text(0.0, 1.0, "\n".join([*notes, "± standard error (blocks of jumps)"]), va="top", color="#444444", transform=grid[-1].transAxes)
    row = numbers.loc["height"]
    figure.suptitle(f"Single jumps scatter by {row['standard_deviation'] / row['mean']:.0%} in height about a mean of {row['mean']:.3g} d")
    return figure


def shares(frame: pd.DataFrame, axis: str) -> pd.DataFrame:
    """Every force in per cent of the sum of their absolute values, thesis fig. 3-14; along "x" or up "z"."""
    names = [name for name in FORCES if f"{name}_{axis}" in frame]
    values = frame[[f"{name}_{axis}" for name in names]].set_axis(names, axis=1)
    return 100.0 * values.div(values.abs().sum(axis=1).replace(0.0, np.nan), axis=0)


def draw_budget(figure: Figure, frame: pd.DataFrame, title: str) -> None:
    """The mean jump, and the shares of the forces over its phase along and up."""
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(0.7, 1.0, 1.0))
    panels[0].plot(frame["phase"], frame["z"], color=GREY, linewidth=2.0)
    panels[0].set(ylabel="height of the\ncentre z (d)")
    for axes, axis, where in ((panels[1], "x", "along"), (panels[2], "z", "up")):
        found = shares(frame, axis)
        for name in found:
            if not found[name].abs().max() > 0.0:
                continue
            (colour, marker), label = FORCES[str(name)], WORDS[str(name)]
            axes.plot(frame["phase"], found[name], color=colour, marker=marker, markevery=max(1, len(frame) // 8), label=label)
        axes.axhline(0.0, color="#999999", linewidth=0.8)
        axes.set(ylabel=f"share of the forces\n{where} (%)", ylim=(-100.0, 100.0))
    panels[2].set(xlabel="phase of the jump (0 takeoff, 1 impact)", xlim=(0.0, 1.0))
    figure.suptitle(title)
    entries = {label: handle for axes in panels[1:] for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=6)


@styled
def budget(result: Result) -> Figure:
    """The mean jump and the forces over its phase, thesis fig. 3-14."""
    frame = result.budget()
    figure = Figure(figsize=(8.0, 7.4))
    up = shares(frame, "z").abs().mean().sort_values(ascending=False)
    ranked = ", ".join(f"{WORDS[str(name)]} {value:.0f} %" for name, value in up.items() if value >= 0.5)
    draw_budget(figure, frame, f"Forces normal to the bed, share averaged over the jump:\n{ranked}")
    return figure


def draw_moments(
    axes: Any, lags: Floats, moments: Floats, label: str, colour: str, marker: str, ranges: Iterable[tuple[float, float]], above: bool = True
) -> list[float]:
    """⟨X'²⟩ against the lag with the lines fitted in each range, labelled above or below; their exponents γ."""
    axes.loglog(lags, moments, marker, color=colour, markersize=4, linestyle="none", label=label)
    found = []
    for low, high in ranges:
        inside = (lags >= low) & (lags <= high)
        gamma = statistics.fit_exponent(lags, moments, low, high)[0]
        found.append(gamma)
        level = math.exp(float(np.mean(np.log(moments[inside]) - 2.0 * gamma * np.log(lags[inside]))))
        ends = np.array([lags[inside][0], lags[inside][-1]])
        axes.loglog(ends, level * ends ** (2.0 * gamma), color=colour, linewidth=2.0)
        middle = math.sqrt(ends[0] * ends[1])
        side = {"xytext": (-6, 8), "ha": "right"} if above else {"xytext": (6, -12), "ha": "left"}
        axes.annotate(f"γ = {gamma:.2f}", (middle, level * middle ** (2.0 * gamma)), textcoords="offset points", color=colour, **side)
    return found


def ranges_of(lags: Floats, duration: float) -> list[tuple[float, float]]:
    """The local and the intermediate range, as far as three lags lie in them."""
    wanted = [(LOCAL[0] * duration, LOCAL[1] * duration), (INTERMEDIATE[0] * duration, INTERMEDIATE[1] * duration)]
    return [(low, high) for low, high in wanted if ((lags >= low) & (lags <= high)).sum() >= 3]


@styled
def diffusion(result: Result) -> Figure:
    """Second moments of the displacement against the lag with their exponents, thesis fig. 3-17; at least 20 jumps have to count.

    Nikora et al. (2001), J. Phys. A 34, L743–L749; thesis (3-7), (3-8).
    """
    jumps = jumps_of(result, "diffusion")
    if len(jumps) < 20:
        raise ValueError(f"diffusion needs 20 jumps or more to average over, got {len(jumps)}: let run.jumps be larger")
    frame, duration = result.diffusion(), float(jumps["duration"].mean())
    lags = frame["lag"].to_numpy()
    figure = Figure(figsize=(8.0, 5.0))
    axes = figure.subplots()
    parts = []
    moving = [name for name in SPREAD if (frame[name] > 0.0).all()]
    higher = max(moving, key=lambda name: float(np.log(frame[name]).mean()), default=None)
    for name in moving:
        label, colour, marker = SPREAD[name]
        found = draw_moments(axes, lags, frame[name].to_numpy(), label, colour, marker, ranges_of(lags, duration), name == higher)
        parts.append(f"{label} γ = " + " then ".join(f"{gamma:.2f}" for gamma in found))
    if not parts:
        raise ValueError("diffusion needs jumps that differ: here all displacements are equal")
    axes.axvline(duration, color="#999999", linestyle=":")
    axes.annotate("mean duration of a jump", (duration, axes.get_ylim()[0]), xytext=(4, 6), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel=f"time after a takeoff (d/{unit_of(result)})", ylabel="second moment of the displacement (d²)")
    axes.legend(loc="upper left")
    figure.suptitle("Spreading of grains: " + "; ".join(parts))
    return figure


def over_phase(result: Result, names: Sequence[str], phases: int = 40) -> Floats:
    """Variables of the path over the phase of each jump that counts: (jump, phase, name), phases in the middle of equal parts.

    Jumps with fewer than two recorded places are left out.
    """
    path, jumps = result.trajectory, result.jumps
    time = path["time"].to_numpy()
    values = [path[name].to_numpy() for name in names]
    phase = (np.arange(phases) + 0.5) / phases
    found = []
    for start, duration in zip(jumps["start"], jumps["duration"], strict=True):
        low = int(np.searchsorted(time, start * (1.0 + 1e-14), side="right"))
        high = int(np.searchsorted(time, (start + duration) * (1.0 - 1e-14), side="left"))
        if high - low >= 2:
            here = (time[low : high + 1] - start) / duration
            found.append(np.stack([np.interp(phase, here, column[low : high + 1]) for column in values], axis=1))
    return np.array(found) if found else np.empty((0, phases, len(names)))


@styled
def spin(result: Result) -> Figure:
    """Spin about the axis across the stream: over the phase of the jumps, and the distribution of their means."""
    jumps = jumps_of(result, "spin")
    unit = f"{unit_of(result)}/d"
    if "spin_y" not in result.trajectory or not np.isfinite(jumps["spin"]).all() or not jumps["spin"].any():
        raise ValueError("spin needs a scene in which something turns the grain: effects 'rotation' or a rebound with friction")
    paths = over_phase(result, ["spin_y"])[:, :, 0]
    figure = Figure(figsize=(10.0, 4.4))
    left, right = figure.subplots(1, 2)
    phase = (np.arange(paths.shape[1]) + 0.5) / paths.shape[1]
    low, middle, high = np.quantile(paths, (0.1, 0.5, 0.9), axis=0)
    left.fill_between(phase, low, high, color=BLUE, alpha=0.25, label="10 to 90 % of the jumps", linewidth=0.0)
    left.plot(phase, middle, color=BLUE, label="median")
    left.set(xlabel="phase of the jump (0 takeoff, 1 impact)", ylabel=f"spin ω_y ({unit})", xlim=(0.0, 1.0))
    left.legend(loc="best")
    values = jumps["spin"].to_numpy()
    alike = np.ptp(values) <= 1e-9 * abs(values[0])
    right.hist(values, bins=1 if alike else max(8, round(math.sqrt(len(values)))), color=BLUE, alpha=0.65)
    right.axvline(values.mean(), color=RED, label=f"mean {values.mean():.3g}")
    stage = result.scene.numbers.stage
    if stage is not None and prescribed_spin(stage) > 0.0:
        right.axvline(prescribed_spin(stage), color=BLACK, linestyle="--", label=f"thesis (3-6): {prescribed_spin(stage):.3g}")
    right.set(xlabel=f"mean spin of a jump ({unit})", ylabel="jumps")
    right.legend(loc="best")
    figure.suptitle(f"Mean spin {values.mean():.3g} {unit}, from {middle[0]:.3g} at takeoff to {middle[-1]:.3g} at impact (medians)")
    return figure


@styled
def stream(result: Result) -> Figure:
    """The stream with the grains and without, and the stress that each carries."""
    found = result.coupled()
    heights = found["height"]
    figure = Figure(figsize=(10.0, 4.6))
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(found["velocity_before"], heights, color=GREY, linestyle="--", label="without grains")
    left.plot(found["velocity"], heights, color=BLUE, label="with the grains")
    right.plot(found["fluid_stress"], heights, color=BLUE, label="stream")
    right.plot(found["grain_stress"], heights, color=RED, label="grains")
    right.plot(found["fluid_stress"] + found["grain_stress"], heights, color=BLACK, linestyle=":", label="sum")
    left.set(xlabel=f"velocity ({unit_of(result)})", ylabel="height above the bed level (d)", ylim=(0.0, float(heights[-1])))
    right.set(xlabel="shear stress (ρu*²)")
    for axes in (left, right):
        axes.legend()
    figure.suptitle(f"Grains carry {float(found['bed_stress']):.0%} of the stress at the bed; bed load q* = {float(found['bed_load']):.3g}")
    return figure


PLOTS: dict[str, Callable[[Result], Figure]] = {plot.__name__: plot for plot in (trajectory, jumps, budget, diffusion, spin, stream)}
