"""Spin and angles, forces over the mean jump, spreading and bed load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, RED, YELLOW, legend
from reports.saltation.records import AXES, SIZES, STAGE, errors, grid, number, share, stages
from reports.site.page import finished, save, table
from reports.words import Record, of, span
from saltation.plots import run as plots

PRESCRIBED = "Run A: spin prescribed (3-6)"
LOOKS = {73: (BLUE, "o"), 250: (ORANGE, "s")}
GROWING = ("Run A without Magnus", "Run G: spin computed (3-4)")  # whose Magnus force is none or follows the computed spin


def prescribed(stage: Any) -> Any:
    """Thesis (3-6)."""
    return 5.11 - 1.13 * stage


def spin_offsets(data: Record, name: str) -> list[float]:
    """Mean spin over (3-6), minus one, at R_p 73."""
    return [row["spin"]["mean"] / prescribed(row["stage"]) - 1.0 for row in grid(data, name, 73)]


def spin_table(data: Record) -> str:
    """Spin, takeoff angle, deviation, impacts by stage."""
    rows = []
    for reynolds in SIZES:
        printed = grid(data, "torque without ρ/ρ_s", reynolds)
        for row, other in zip(grid(data, data["grid"]["shipped"], reynolds), printed, strict=True):
            law = f"{prescribed(row['stage']):.2f}" if reynolds == 73 else "–"
            cells = [number(row, "spin"), number(other, "spin"), law, number(row, "takeoff_angle"), number(row, "deviation")]
            low, high = row["stokes_range"]
            rows.append([f"{reynolds}, {row['stage']:g}", *cells, f"{low:.0f} … {high:.0f}", share(row["clipped"]), share(row["creeping"], 1)])
    head = ("spin ω_y (u*/d)", "as printed", "(3-6)", "takeoff angle (°)", "deviation (°, absolute)", "St of impacts", "clipped at 30°", "creeping (H < 0.1 d)")
    return table(["R_p, T", *head], rows)


def forces(data: Record) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Shares of the forces over the phase, along and up."""
    frame = pd.DataFrame(data["forces"]["phase"])
    return plots.shares(frame, "x"), plots.shares(frame, "z")


def magnus_share(data: Record, law: str) -> dict[float, float]:
    """Mean absolute share of the Magnus force up, by stage."""
    return {row["stage"]: row["mean"] for row in of(data["magnus"], law=law)}


def peak(data: Record, name: str) -> float | None:
    """The stage of the greatest mean height of one of the runs of the saturation, None if that is the last one."""
    runs = of(data["saturation"], name=name)
    stage = max(runs, key=lambda run: run["height"]["mean"])["stage"]
    return None if stage == max(run["stage"] for run in runs) else float(stage)


def exponent(data: Record, axis: str, where: str) -> str:
    """γ with its interval."""
    (found,) = of(data["diffusion"]["exponents"], axis=axis, range=where)
    low, high = found["interval"]
    return f"{found['gamma']:.2f}" if low is None else f"{found['gamma']:.2f} [{low:.2f}, {high:.2f}]"


def draw_path(found: Record) -> Any:
    """Side view and plan of the first jumps of the thesis's case."""
    figure = plt.figure(figsize=(9.0, 5.2))
    arrays = {name: np.array(found[name]) for name in "xyz"}
    hits = [np.array(found["impacts"][name]) for name in "xzy"]
    plots.draw_path(figure, arrays["x"], arrays["z"], arrays["y"], hits, "x (d)")
    figure.suptitle("The first eight jumps of sand, the thesis's case: side view and plan (mind the stretched heights)")
    return figure


def draw_angles(found: Record) -> Any:
    """Spin, takeoff angle and deviation against T, and the distribution of the deviation. Thesis figs 3-11 to 3-13."""
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 7.6))
    panels = axes.ravel()
    for reynolds, (colour, marker) in LOOKS.items():
        rows = stages(found["records"], name=found["shipped"], particle_reynolds=reynolds)
        printed = stages(found["records"], kind="printed", particle_reynolds=reynolds)
        for panel, key in zip(panels, ("spin", "takeoff_angle", "deviation"), strict=False):
            errors(panel, rows, key, color=colour, marker=marker, label=f"R$_p$ = {reynolds}")
        errors(panels[0], printed, "spin", color=colour, marker="x", linestyle=":", label=f"R$_p$ = {reynolds}, torque as printed")
        mean, sd = (np.array([row["takeoff_angle"][key] for row in rows]) for key in ("mean", "sd"))
        panels[1].fill_between([row["stage"] for row in rows], mean - sd, mean + sd, color=colour, alpha=0.15, linewidth=0.0)
    measured = np.linspace(1.5, 2.9, 2)
    panels[0].plot(measured, prescribed(measured), "--", color=BLACK, label="(3-6), measured at R$_p$ 60 to 90")
    panels[0].set(title="Spin falls with T as in the measured regression\nif the torque is divided by ρ$_s$/ρ", xlabel=STAGE, ylabel="mean spin ω$_y$ (u*/d)")
    panels[0].legend(loc="upper right")
    panels[1].set(
        title="Takeoff angles hardly change with T\n(band: standard deviation of single jumps)", xlabel=STAGE, ylabel="takeoff angle (degrees)", ylim=(0, 90)
    )
    panels[1].legend(loc="lower right")
    panels[2].set(title="The deviation in plan falls with T", xlabel=STAGE, ylabel="mean absolute deviation (degrees)", ylim=(0, None))
    panels[2].legend(loc="lower left")
    values = next(r["deviations"] for r in found["records"] if "deviations" in r)
    panels[3].plot(values, (np.arange(len(values)) + 0.5) / len(values), color=BLUE)
    panels[3].set(
        title="Its distribution at R$_p$ 73, T 1.87", xlabel="absolute deviation (degrees)", ylabel="share of jumps below", ylim=(0, 1), xlim=(0, None)
    )
    return figure


def draw_forces(data: Record) -> Any:
    """The mean jump and the shares of the forces over its phase. Thesis fig. 3-14."""
    along, up = forces(data)
    figure = plt.figure(figsize=(8.0, 7.4))
    first, last = along["history"].iloc[0], abs(along["history"].iloc[-1])
    title = (
        f"Drag drives the jump along (up to {along['drag'].max():.0f} %), weight rules it up (up to {up['weight'].abs().max():.0f} %);\n"
        f"history counts at both ends (along {first:.0f} % after takeoff, {last:.0f} % against the motion before impact)"
    )
    plots.draw_budget(figure, pd.DataFrame(data["forces"]["phase"]), title)
    return figure


def draw_quartiles(found: Record) -> Any:
    """Quartiles of each force's share over all jumps and phases. Thesis fig. 3-15."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.2), sharey=True)
    for axes, axis, where in ((panels[0], "x", "along the stream"), (panels[1], "z", "normal to the bed")):
        shown = {name: row for name, row in found[f"quartiles_{axis}"].items() if row[-1] > 0.0}
        stats = [
            {"whislo": r[0], "q1": r[1], "med": r[2], "q3": r[3], "whishi": r[4], "label": plots.WORDS[name].replace(" ", "\n")} for name, r in shown.items()
        ]
        drawn = axes.bxp(stats, showfliers=False, patch_artist=True, medianprops={"color": BLACK})
        for box, name in zip(drawn["boxes"], shown, strict=True):
            box.set(facecolor=plots.FORCES[name][0], alpha=0.5)
        axes.set_title(where)
    panels[0].set_ylabel("share of the forces, absolute (%)")
    figure.suptitle("Drag leads along, weight up; history comes second in both\n(over all jumps and phases; boxes: quartiles, whiskers: extremes)")
    return figure


def draw_magnus(records: Sequence[Record]) -> Any:
    """Share of the Magnus force up over the phase, for prescribed and computed spin. Thesis fig. 3-16."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.4), sharey=True)
    colours = (BLUE, GREEN, YELLOW, ORANGE, RED)
    for axes, law, title in (
        (panels[0], "prescribed", "spin prescribed by (3-6): fades, then turns over"),
        (panels[1], "yamamoto", "spin computed by (3-4): much the same at every T"),
    ):
        for row, colour in zip(stages(records, law=law), colours, strict=True):
            axes.plot(row["phase"], row["share"], color=colour, label=f"T = {row['stage']:g}")
        axes.axhline(0.0, color="#999999", linewidth=0.8)
        axes.set(title=title, xlabel="phase of the jump (0 takeoff, 1 impact)", xlim=(0, 1))
    panels[0].set_ylabel("Magnus force's share up (%)")
    legend(figure, panels[0], 5)
    return figure


def draw_saturation(records: Sequence[Record]) -> Any:
    """Run A's saturation with T, effects off one by one. Thesis section 3.4.4."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 4.8))
    looks = {
        PRESCRIBED: {"color": ORANGE, "marker": "o", "linewidth": 2.0},
        "Run A with f = 0.89": {"color": BROWN, "marker": "s"},
        "Run A without Magnus": {"color": BLACK, "marker": "x"},
        "Run A without lift": {"color": GREY, "marker": "^", "linewidth": 0.8},
        "Run A without history": {"color": GREY, "marker": "v", "linewidth": 0.8},
        "Run A without added mass": {"color": GREY, "marker": "P", "linewidth": 0.8},
        "Run G: spin computed (3-4)": {"color": BLUE, "marker": "D"},
    }
    for axes, (quantity, label) in zip(panels, AXES.items(), strict=True):
        for name, look in looks.items():
            errors(axes, stages(records, name=name), quantity, label=name, markersize=5, **look)
        axes.set(xlabel=STAGE, ylabel=label)
        if quantity != "velocity":
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
    return finished(figure, panels[0], 4, "Run A stops growing with T because the prescribed spin turns Magnus over; with computed spin nothing saturates")


def draw_diffusion(found: Record) -> Any:
    """Second moments against the lag. Thesis fig. 3-17."""
    figure, axes = plt.subplots(figsize=(8.0, 5.0))
    lags = np.array(found["lag"])
    higher = max("xy", key=lambda name: float(np.log(found[name]).mean()))
    for name, (label, colour, marker) in plots.SPREAD.items():
        ranges = [(r["low"], r["high"]) for r in found["exponents"] if r["axis"] == name]
        plots.draw_moments(axes, lags, np.array(found[name]), label, colour, marker, ranges, name == higher)
    axes.axvline(found["duration"], color="#999999", linestyle=":")
    axes.annotate("mean duration of a jump", (found["duration"], axes.get_ylim()[0]), xytext=(4, 6), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel="time after a takeoff (d/u*)", ylabel="second moment of the displacement (d²)")
    axes.set_title("Nearly ballistic within a jump, about normal along the stream and faster across after many")
    axes.legend(loc="upper left")
    return figure


def draw_bed_load(found: Record) -> Any:
    """The bed-load rate that the impacts imply."""
    figure, axes = plt.subplots(figsize=(7.0, 4.6))
    for reynolds, (colour, marker) in LOOKS.items():
        rows = stages(found["records"], name=found["shipped"], particle_reynolds=reynolds)
        for key, title, dash, mark in (
            ("rate", "this model", "-", marker),
            ("meyer_peter_mueller", "Meyer-Peter–Müller", "--", ""),
            ("wong_parker", "Wong–Parker", ":", ""),
        ):
            load = [row["bed_load"][key] for row in rows]
            axes.plot([row["stage"] for row in rows], load, dash, color=colour, marker=mark, label=f"{title}, R$_p$ = {reynolds}")
    axes.set(yscale="log", xlabel=STAGE, ylabel="bed load q* = q/√(R g d³)")
    return finished(figure, axes, 2, "Bagnold's balance with these impacts carries several times too much")


def fields(found: Record) -> dict[str, Any]:
    """What the page says of them."""
    loads = [row["bed_load"] for row in grid(found, found["grid"]["shipped"], 73)]
    return {
        "figure_path": save(draw_path(found["forces"]["path"]), "saltation_path"),
        "figure_angles": save(draw_angles(found["grid"]), "saltation_angles"),
        "spin": spin_table(found),
        "figure_forces": save(draw_forces(found), "saltation_forces"),
        "figure_shares": save(draw_quartiles(found["forces"]), "saltation_shares"),
        "figure_magnus": save(draw_magnus(found["magnus"]), "saltation_magnus"),
        "figure_saturation": save(draw_saturation(found["saturation"]), "saltation_saturation"),
        "figure_diffusion": save(draw_diffusion(found["diffusion"]), "saltation_diffusion"),
        "figure_load": save(draw_bed_load(found["grid"]), "saltation_bed_load"),
        "over": span([load["rate"] / load["meyer_peter_mueller"] for load in loads], "{:.1f}"),
        "over_wong": span([load["rate"] / load["wong_parker"] for load in loads], "{:.1f}"),
        "friction": span([load["dynamic_friction"] for load in loads], "{:.2f}"),
    }
