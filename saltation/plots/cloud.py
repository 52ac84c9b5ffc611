"""Figures of a run of many grains, for `saltation plot`: paths and encounters in space, one pair, one grain, profiles, spreading.

Every function of `CLOUD_PLOTS` takes a `Result` and gives a Figure that belongs to no window and no backend. What a run cannot
show (no encounters, no paths) is a ValueError with one sentence.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY
from basset.kernels import Floats
from saltation import statistics
from saltation.plots import run as plots
from saltation.plots.highlights import Group, busiest, contact_points, encounters_of, group_of, jump_time, members, settled, undisturbed_pair, within
from saltation.plots.run import SPREAD, draw_moments, styled
from saltation.plots.tracks import BED, KEPT, MET, SPEEDS, Track, image, track
from saltation.results.result import Result
from saltation.study.grains import RANGES, changes

__all__ = ["encounters", "grain_history", "pair", "plan", "profiles", "second_moments", "snapshots", "three_dimensional"]

GRAINS = (BLUE, ORANGE, GREEN, PINK, SKY, BLACK)
SPAN = 4.0  # mean durations of a jump that a picture in space shows
EDGE = "#444444"


def mark(axes: Any, points: Floats, among: NDArray[np.bool_]) -> None:
    """Rings at encounters (n, 2 or 3), small ones where the other grain is not drawn."""
    for chosen, size, width, label in ((among, 8, 1.8, "encounter"), (~among, 4, 1.0, "encounter with a grain that is not drawn")):
        if chosen.any():
            axes.plot(*points[chosen].T, "o", color=RED, markersize=size, markerfacecolor="none", markeredgewidth=width, label=label, zorder=5, clip_on=False)


def paths_of(result: Result, group: Group) -> tuple[dict[int, Floats], float]:
    """Lines (m, 3) of a group's grains in one periodic image, d, and the least x of them at the beginning."""
    lines: dict[int, Floats] = {grain: track(result, grain).line(group.low, group.high)[1] + offset for grain, offset in group.offsets.items()}
    return lines, float(min(line[0, 0] for line in lines.values()))


# Many grains in space


def needs_width(result: Result, what: str) -> None:
    """Refuse a scene in the plane."""
    if result.scene.in_plane:
        raise ValueError(f"{what} needs three dimensions: the scene has dimensions = 2")


def drawn_group(result: Result, what: str) -> Group:
    """The group of grains that a picture in space shows; refused for a scene in the plane and for a run without encounters."""
    needs_width(result, what)
    encounters_of(result, what)
    return group_of(result, SPAN * jump_time(result))


@styled
def three_dimensional(result: Result) -> Figure:
    """Paths of up to six grains in space, the bed below, encounters marked; thesis fig. 4-8. Not for scenes in the plane."""
    group = drawn_group(result, "three_dimensional")
    figure = Figure(figsize=(9.0, 5.2))
    unit = result.scene.numbers.unit("u*")
    figure.set_layout_engine("none")
    axes: Any = figure.add_axes((-0.02, 0.14, 1.0, 0.8), projection="3d", computed_zorder=False)
    (points, among), (lines, origin) = contact_points(result, group), paths_of(result, group)
    for colour, (grain, line) in zip(GRAINS, lines.items(), strict=False):
        axes.plot(line[:, 0] - origin, line[:, 1], np.zeros(len(line)), color=colour, alpha=0.4, linewidth=0.8, clip_on=False)
        axes.plot(line[:, 0] - origin, line[:, 1], line[:, 2], color=colour, linewidth=1.6, label=f"grain {grain}", clip_on=False)
    mark(axes, points - [origin, 0.0, 0.0], among)
    whole = np.concatenate(list(lines.values()))
    size = np.array([np.ptp(whole[:, 0]), max(np.ptp(whole[:, 1]), 2.0), whole[:, 2].max()])
    stretch = np.maximum(1.0, np.round([1.0, 0.4 * size[0] / size[1], 0.3 * size[0] / size[2]]))
    axes.set_box_aspect(size * stretch, zoom=1.5)
    axes.set(xlabel="along x (d)", ylabel="across y (d)", zlabel="height z (d)", zlim=(0.0, size[2]))
    axes.set_zticks(range(int(size[2]) + 1))
    axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
    axes.xaxis.labelpad = 12.0
    axes.view_init(elev=26.0, azim=-66.0)
    figure.legend(loc="lower center", ncols=4)
    figure.suptitle(
        f"{len(lines)} grains meet {among.sum()} times in {group.high - group.low:.2g} d/{unit}, and others {(~among).sum()} times\n"
        f"(y stretched {stretch[1]:.0f} times, z {stretch[2]:.0f} times; shadows on the bed below)"
    )
    return figure


@styled
def plan(result: Result) -> Figure:
    """Up to six grains from above, true to scale, and below it all grains over the whole run from one release point; thesis fig. 4-9. Not in the plane."""
    group = drawn_group(result, "plan")
    figure = Figure(figsize=(9.0, 6.6))
    unit = result.scene.numbers.unit("u*")
    near, far = figure.subplots(2, 1, height_ratios=(1.15, 1.0))
    (points, among), (lines, origin) = contact_points(result, group), paths_of(result, group)
    ends = spread_out(np.array([line[-1, 1] for line in lines.values()]), 0.8)
    for colour, end, (grain, line) in zip(GRAINS, ends, lines.items(), strict=False):
        near.plot(line[:, 0] - origin, line[:, 1], color=colour, linewidth=1.6)
        near.annotate(f"grain {grain}", (max(values[-1, 0] for values in lines.values()) - origin + 0.5, end), va="center", color=colour, fontsize=9)
    mark(near, points[:, :2] - [origin, 0.0], among)
    near.set_aspect("equal", adjustable="datalim")
    near.legend(loc="lower left", ncols=2)
    near.set(xlabel="along x (d)", ylabel="across y (d)", title=f"{len(lines)} grains during {group.high - group.low:.2g} d/{unit}, equal scales")
    path = result.trajectory
    x, y = path["x"].to_numpy(), path["y"].to_numpy()
    x, y = x - x[0], y - y[0]
    far.plot(x, y, color=BLUE, alpha=0.35, linewidth=0.7)
    last = np.array([column[np.isfinite(column)][-1] for column in y.T])
    far.set(xlabel="along x (d), from the release", ylabel="across y (d)")
    far.set_title(f"all {y.shape[1]} grains from one release point: {last.std():.2g} d apart (standard deviation) at the end; y stretched")
    scatters = result.scene.bed is not None and result.scene.bed.span_scatter
    figure.suptitle(f"Seen from above: {'bed and encounters' if scatters else 'encounters alone'} deflect grains across the stream")
    return figure


def spread_out(values: Floats, least: float) -> Floats:
    """Places of labels: as `values`, but `least` or more apart, in the same order."""
    order = np.argsort(values)
    placed = values[order].astype(float)
    for _ in range(100):
        short = np.maximum(0.0, least - np.diff(placed))
        if not short.any():
            break
        placed[1:] += 0.5 * short
        placed[:-1] -= 0.5 * short
    found = np.empty_like(placed)
    found[order] = placed
    return found


# One pair


@styled
def pair(result: Result) -> Figure:
    """Two grains that meet in mid-flight, from the side and over time, contacts marked by arrows; thesis fig. 4-6."""
    found = undisturbed_pair(result, "pair")
    unit = result.scene.numbers.unit("u*")
    moment, tau = float(found.row["time"]), jump_time(result)
    low, high = max(0.0, moment - 1.3 * tau), moment + 1.3 * tau
    figure = Figure(figsize=(9.0, 5.6))
    side, over = figure.subplots(2, 1)
    origin = found.row["x"]
    for who, colour, path in zip(("first", "second"), (BLUE, ORANGE), found.tracks, strict=True):
        times, line = path.line(low, high)
        for axes, across in ((side, line[:, 0] - origin), (over, times - moment)):
            axes.plot(across, line[:, 2], color=colour, label=f"grain {int(found.row[who])}")
        shown = (path.time > low) & (path.time < high)
        for kind in (BED, MET):
            chosen = shown & (path.kind == kind)
            for time, place in zip(path.time[chosen], path.place[chosen], strict=True):
                for axes, across in ((side, place[0] - origin), (over, time - moment)):
                    arrow(axes, across, place[2], colour, kind == MET)
    for axes in (side, over):
        axes.set(ylabel="height of the centre z (d)", ylim=(0.0, 1.4 * axes.dataLim.y1))
    side.set_xlabel("along x (d), from the encounter")
    over.set_xlabel(f"time (d/{unit}), from the encounter")
    side.legend(loc="upper right", ncols=2)
    figure.suptitle(
        f"Grains {int(found.row['first'])} and {int(found.row['second'])} meet in mid-flight, closing at "
        f"{-found.relative() @ found.normal():.2g} {unit}\n(open arrows: encounters, filled arrows: contacts with the bed)"
    )
    return figure


def arrow(axes: Any, x: float, z: float, colour: str, hollow: bool) -> None:
    """An arrow at a contact: from above and hollow for an encounter, from below and filled for the bed."""
    look = {"arrowstyle": "simple,head_width=0.7,head_length=0.6,tail_width=0.25", "shrinkB": 2.0, "shrinkA": 0.0}
    look |= {"facecolor": "white" if hollow else colour, "edgecolor": colour}
    axes.annotate("", (x, z), xytext=(0, 24 if hollow else -20), textcoords="offset points", arrowprops=look, annotation_clip=True)


@styled
def snapshots(result: Result) -> Figure:
    """One encounter before, at and after contact: circles true to scale and velocities, seen so that the line of centres lies in the picture.

    The picture moves with the centre of mass of the pair at contact, whose velocity the contact does not change; it shows the vertical and the horizontal
    direction of the line of centres. Thesis fig. 4-7.
    """
    found = undisturbed_pair(result, "snapshots")
    unit = result.scene.numbers.unit("u*")
    row, normal, moment = found.row, found.normal(), float(found.row["time"])
    level = math.hypot(normal[0], normal[1])
    along = np.array([1.0, 0.0]) if level < 1e-6 else normal[:2] / level * (1.0 if normal[0] >= 0.0 else -1.0)
    closing = max(1e-6, float(-found.relative() @ normal))
    step: float = min(0.35 / closing, 0.49 * found.undisturbed)
    while found.apart(moment - 2.0 * step) > 1.8:
        step *= 0.9
    drift = 0.5 * np.array([row[f"first_{name}"] + row[f"second_{name}"] for name in SPEEDS])
    centre = np.array([row[name] for name in ("x", "y", "z")]) + 0.5 * row["distance"] * normal
    figure = Figure(figsize=(11.0, 3.4))
    panels = figure.subplots(1, 5, sharex=True, sharey=True)
    for axes, count in zip(panels, range(-2, 3), strict=True):
        time = moment + count * step
        for who, colour, path in zip(("first", "second"), (BLUE, ORANGE), found.tracks, strict=True):
            place, velocity = (values[0] for values in path.at([time]))
            middle = flat(place - drift * (time - moment), along) - [centre[:2] @ along, 0.0]
            axes.add_collection(
                EllipseCollection(
                    [1.0], [1.0], [0.0], units="xy", offsets=[middle], offset_transform=axes.transData, facecolor=colour, edgecolor=EDGE, alpha=0.55
                )
            )
            before = np.array([row[f"{who}_{name}"] for name in SPEEDS])
            for speed, look in ((before, GREY), (velocity, BLACK)) if count == 0 else ((velocity, BLACK),):
                quiver = axes.quiver(*middle, *flat(speed - drift, along), color=look, angles="xy", scale_units="xy", scale=2.5, width=0.014, zorder=3)
        axes.set_axisbelow(True)
        axes.set_title("contact" if count == 0 else f"{count * step:+.2g} d/{unit}")
        axes.set_aspect("equal")
    panels[0].set(xlim=(-1.8, 1.8), ylim=(centre[2] - 1.35, centre[2] + 1.2), ylabel="height z (d)")
    panels[4].quiverkey(quiver, 0.93, 0.06, 1.0, f"1 {unit}", labelpos="E", coordinates="figure")
    figure.supxlabel(f"along the line of centres in plan (d), {math.degrees(math.atan2(along[1], along[0])):+.0f}° from the stream", fontsize=10)
    parting = np.array([row[f"second_{name}_after"] - row[f"first_{name}_after"] for name in SPEEDS]) @ normal
    figure.suptitle(
        f"Grains {int(row['first'])} (blue) and {int(row['second'])} close at {closing:.2g} {unit} and part at {parting:.2g} {unit}\n"
        "(seen from their centre of mass; at contact grey: before, black: after)"
    )
    return figure


def flat(vector: Floats, along: Floats) -> Floats:
    """(3,) as (along, up)."""
    return np.array([vector[:2] @ along, vector[2]])


# One grain


@styled
def grain_history(result: Result, grain: int | None = None, start: float | None = None) -> Figure:
    """One grain (default: the one that shows most) over ten jumps: height, place, velocity and acceleration across the stream; thesis fig. 4-16.

    A contact takes no time, so a velocity has no acceleration there: the thesis divides the change by the time step, and what it draws depends on that step.
    Here the acceleration is shown between contacts alone, as the mean over each piece of the path between two kept positions or contacts (the change of
    velocity over the time, exact, whatever the history force does right after a contact), and encounters are arrows of the length of their jump of
    velocity (impulse per mass of the grain), on a scale of their own.
    """
    needs_width(result, "grain_history")
    unit = result.scene.numbers.unit("u*")
    span = 10.0 * jump_time(result)
    chosen, begin = busiest(result, span)
    if grain is not None and grain != chosen:
        chosen, begin = grain, 0.0
    low = begin if start is None else start
    high, path = low + span, track(result, chosen)
    met = members(within(result.encounters, low, high), [chosen])
    figure = Figure(figsize=(9.0, 8.0))
    panels = figure.subplots(4, 1, sharex=True)
    times, line = path.line(low, high)
    for axes, column in ((panels[0], 2), (panels[1], 1)):
        draw_partners(axes, result, path, chosen, met, column)
        axes.plot(times, line[:, column], color=BLUE, linewidth=1.6)
    shown = (path.time >= low) & (path.time <= high)
    knots = np.repeat(path.time[shown], 2)
    velocity = np.stack([path.before[shown, 1], path.after[shown, 1]], axis=1).ravel()
    panels[2].plot(knots, velocity, color=BLUE)
    ends, rates = path.mean_accelerations()
    inside = (ends[:, 0] >= low) & (ends[:, 1] <= high)
    panels[3].plot(ends[inside].ravel(), np.repeat(rates[inside, 1], 2), color=BLUE, linewidth=1.0)
    draw_velocity_jumps(panels[3], path, low, high, unit)
    for axes in panels:
        for time in met["time"]:
            axes.axvline(time, color=RED, linestyle=":", linewidth=1.0)
    panels[0].set(ylabel="height of the\ncentre z (d)", ylim=(0.0, None), xlim=(low, high))
    x = np.maximum.accumulate(line[:, 0]) + 1e-9 * np.arange(len(line))
    along = panels[0].secondary_xaxis("top", functions=(lambda t: np.interp(t, times, x), lambda place: np.interp(place, x, times)))
    ticks = MaxNLocator(8).tick_values(x[0], x[-1])
    along.set_xticks(ticks[(ticks >= x[0]) & (ticks <= x[-1])])
    along.set_xlabel("along x (d)")
    panels[1].set(ylabel="across y (d)")
    panels[2].set(ylabel=f"velocity\nacross v ({unit})")
    panels[3].set(ylabel=f"acceleration between\ncontacts ({unit}²/d)", xlabel=f"time (d/{unit})")
    figure.suptitle(f"Grain {chosen} is deflected across the stream by {len(met)} encounters (dotted); grey: the grains it meets")
    return figure


def draw_partners(axes: Any, result: Result, path: Track, grain: int, met: pd.DataFrame, column: int) -> None:
    """Paths of those whom a grain meets, around the encounters, in its periodic image."""
    reach = 0.5 * jump_time(result)
    for time, first, second in zip(met["time"], met["first"], met["second"], strict=True):
        other = track(result, int(second if first == grain else first))
        times, line = other.line(time - reach, time + reach)
        offset = image(result, path.at([time])[0][0], other.at([time])[0][0])
        axes.plot(times, line[:, column] + offset[column], color="#aaaaaa", linewidth=1.0)


def draw_velocity_jumps(axes: Any, path: Track, low: float, high: float, unit: str) -> None:
    """Jumps of the velocity across the stream at contacts, as arrows on a scale of their own at the right."""
    right = axes.twinx()
    right.grid(False)
    right.spines["right"].set_visible(True)
    jumps = path.after[:, 1] - path.before[:, 1]
    shown = (path.kind != KEPT) & (path.time >= low) & (path.time <= high)
    for kind, colour in ((BED, GREY), (MET, RED)):
        some_kind = shown & (path.kind == kind) & (np.abs(jumps) > 0.02 * np.abs(jumps[shown]).max(initial=0.0))
        for time, jump in zip(path.time[some_kind], jumps[some_kind], strict=True):
            right.annotate(
                "", (time, jump), xytext=(time, 0.0), arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0.0, "shrinkB": 0.0, "linewidth": 1.6}
            )
    top = 1.2 * max(0.1, float(np.abs(jumps[shown]).max(initial=0.0)))
    bound = 1.05 * max(abs(limit) for limit in axes.get_ylim())
    axes.set_ylim(-bound, bound)
    right.set_ylim(-top, top)
    bed = (shown & (path.kind == BED) & (np.abs(jumps) > 0.02 * top)).any()
    right.set_ylabel(f"arrows: jump of v ({unit})\nat encounters{' (grey: bed)' if bed else ''}", color=RED)


# Statistics


@styled
def profiles(result: Result) -> Figure:
    """Concentration and mean velocity of the grains over the height, after the first half of them has done `run.discard` jumps."""
    start = settled(result)
    table = result.profiles(start=start)
    unit = result.scene.numbers.unit("u*")
    z, filled = table["z"].to_numpy(), table["concentration"].to_numpy() > 0.0
    figure = Figure(figsize=(9.0, 4.6))
    left, right = figure.subplots(1, 2, sharey=True)
    share = "% by volume" if result.scene.grains.boundary == "periodic" else "% of its mean over the height"
    left.plot(100.0 * table["concentration"], z, color=BLUE, marker="o", markersize=4)
    left.set(xlabel=f"concentration ({share})", ylabel="height of the centre z (d)", xlim=(0, None))
    mean, spread = table["velocity"].to_numpy(), table["velocity_sd"].to_numpy()
    right.fill_betweenx(z[filled], (mean - spread)[filled], (mean + spread)[filled], color=BLUE, alpha=0.2, linewidth=0.0)
    right.plot(mean[filled], z[filled], color=BLUE, marker="o", markersize=4)
    top = float(z[filled][-1])
    at = 0.55 * top
    labelled(right, float(np.interp(at, z[filled], mean[filled])), at, "grains\n± standard deviation", BLUE, -1)
    lag = ""
    if result.scene.channel is not None:
        heights = np.linspace(0.0, z[-1], 200)
        stream = np.array([result.scene.profile.velocity_and_shear(height)[0] for height in heights])
        right.plot(stream, heights, color=BLACK, linestyle="--")
        labelled(right, float(np.interp(0.25 * top, heights, stream)), 0.25 * top, "stream", BLACK, 1)
        weights = table["concentration"].to_numpy()[filled]
        slip = np.interp(z[filled], heights, stream) - mean[filled]
        lag = f"; on average grains lag the stream by {np.average(slip, weights=weights):.2g} {unit}"
    right.set_xlabel(f"velocity along the stream ({unit})")
    densest = float(z[np.argmax(table["concentration"])])
    figure.suptitle(f"Concentration is highest at z = {densest:.2g} d{lag} (from {start:.3g} d/{unit} on)")
    return figure


def labelled(axes: Any, x: float, y: float, text: str, colour: str, side: int) -> None:
    """A line's name beside it."""
    axes.annotate(text, (x, y), xytext=(10 * side, 0), textcoords="offset points", ha="left" if side > 0 else "right", va="center", color=colour, fontsize=9)


@styled
def encounters(result: Result) -> Figure:
    """Distributions of what an encounter changes, by size: direction, velocity and spin; thesis figs 4-13 to 4-15. Slow ones are left out.

    With their signs the changes of both grains' velocities sum to zero.
    """
    encounters_of(result, "encounters")
    found = changes(result).drop(columns="grain").abs()
    if found.empty:
        raise ValueError("encounters needs grains that separate faster than encounters.slowest: the run has none")
    slow = len(result.encounters) - len(found) // 2
    left_out = f" ({slow} slow ones excluded)" if slow else ""
    unit = result.scene.numbers.unit("u*")
    figure = Figure(figsize=(10.0, 7.6))
    panels = figure.subplots(3, 3)
    names = {"u": f"along |Δu| ({unit})", "v": f"across |Δv| ({unit})", "w": f"up |Δw| ({unit})"}
    names |= {f"angle_{plane}": f"|Δ angle| in the {'–'.join(plane)} plane (degrees)" for plane in ("xz", "xy", "yz")}
    names |= {f"spin_{c}": f"|Δω_{c}| ({unit}/d)" for c in "xyz"}
    rows = list(found)
    for k, (axes, name) in enumerate(zip(panels.ravel(), rows, strict=True)):
        values = found[name].to_numpy()
        alike = [name] if k < 3 else rows[k - k % 3 : k - k % 3 + 3]
        top = max(1e-9, float(np.quantile(found[alike].max(axis=1), 0.99)))
        axes.set_axisbelow(True)
        axes.hist(values, bins=np.linspace(0.0, top, 26), color=(BLUE, GREEN, PINK)[k // 3], alpha=0.7, weights=np.full(len(values), 100.0 / len(values)))
        axes.axvline(values.mean(), color=RED)
        axes.set_title(f"mean {values.mean():.3g}, s.d. {values.std():.2g}", color=RED, fontsize=10)
        axes.set(xlabel=names[name], xlim=(0.0, top))
        if k % 3 == 0:
            axes.set_ylabel("share of the grains\nthat meet (%)")
    means = found.mean()
    figure.suptitle(
        f"{len(found) // 2} encounters{left_out} change a velocity on average by {means['u']:.2g}, {means['v']:.2g} and {means['w']:.2g} {unit} "
        f"along, across and up,\nand turn a grain by {means['angle_xy']:.0f}° in plan (sizes of the changes, up to their 99th percentile)"
    )
    return figure


def moments_of(result: Result) -> tuple[Floats, Floats]:
    """Lags (m,) in d/u*, evenly spaced in their logarithm, and ⟨X'²⟩, ⟨Y'²⟩ (m, 2) in d² from one release point; grains that stay to the end."""
    path = result.trajectory
    time = path["time"].to_numpy()
    names = ("x",) if result.scene.in_plane else ("x", "y")
    positions = np.stack([path[name].to_numpy() for name in names], axis=2)
    stays = np.isfinite(positions).all(axis=(0, 2))
    if stays.sum() < 3:
        raise ValueError(f"second_moments needs three grains that stay to the end, got {stays.sum()}")
    moments = statistics.moments_of_grains(time, positions[:, stays])
    chosen = np.unique(np.geomspace(1, len(time) - 1, 60).astype(int))
    return time[chosen] - time[0], moments[chosen]


def ranges_for(lags: Floats, tau: float) -> list[tuple[float, float]]:
    """Within a jump, some jumps, many: as far as four lags lie in them (d/u*)."""
    bounded = [(max(low * tau, float(lags[0])), min(high * tau, float(lags[-1]))) for low, high in RANGES.values()]
    return [(low, high) for low, high in bounded if ((lags >= low) & (lags <= high)).sum() >= 4]


@styled
def second_moments(result: Result, without: Result | None = None) -> Figure:
    """⟨X'²⟩ and ⟨Y'²⟩ of all grains from one release point against time, with their exponents; thesis figs 4-17 and 4-18, (4-14), (4-15).

    `without`: the same scene without encounters, drawn grey.
    """
    tau = jump_time(result)
    figure = Figure(figsize=(10.0, 4.8))
    unit = result.scene.numbers.unit("u*")
    both = [("with encounters", moments_of(result))] + ([] if without is None else [("without", moments_of(without))])
    panels = figure.subplots(1, both[0][1][1].shape[1], squeeze=False)[0]
    parts = []
    for k, (axes, name) in enumerate(zip(panels, "xy", strict=False)):
        label, colour, marker = SPREAD[name]
        for own, (lags, moments) in both:
            if not (moments[:, k] > 0.0).all():
                continue
            first = own == "with encounters"
            found = draw_moments(axes, lags, moments[:, k], own, colour if first else GREY, marker, ranges_for(lags, tau), first)
            if first:
                parts.append(f"{label} γ = " + ", ".join(f"{gamma:.2f}" for gamma in found))
        axes.set_xlim(left=0.2 * both[0][1][0][0])
        axes.axvline(tau, color="#999999", linestyle=":")
        axes.annotate("a jump", (tau, 0.0), xycoords=("data", "axes fraction"), xytext=(4, 6), textcoords="offset points", color="#666666", fontsize=9)
        axes.set(xlabel=f"time since the release (d/{unit})", ylabel=f"⟨{name.upper()}'²⟩ {label} (d²)")
        if len(both) > 1:
            axes.legend(loc="upper left")
    if not parts:
        raise ValueError("second_moments needs grains that spread: here they all move alike")
    title = f"{result.scene.grains.number} grains spread from one release point: {'; '.join(parts)}"
    figure.suptitle(f"{title}\n(fitted within a jump, from 2 to 20 and beyond 40 jumps)")
    return figure


CLOUD_PLOTS: dict[str, Callable[[Result], Figure]] = {
    plot.__name__: plot for plot in (three_dimensional, plan, pair, snapshots, grain_history, profiles, encounters, second_moments, plots.jumps, plots.stream)
}
