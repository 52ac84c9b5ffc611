"""The figures of the page on many grains that are drawn from records; those of single runs are `saltation.plots.cloud`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.analysis import Record

LOOKS = {
    "encounters, history": (PURPLE, "o"),
    "encounters, no history": (ORANGE, "s"),
    "no encounters, history": (BLUE, "^"),
    "no encounters, no history": (GREEN, "D"),
}


def scaling(rows: list[Record]) -> Any:
    """Time per grain and unit time against the number of grains."""
    concentrations = sorted({row["concentration"] for row in rows})
    figure, panels = plt.subplots(1, len(concentrations), figsize=(11.0, 4.8), sharey=True)
    for axes, concentration in zip(panels, concentrations, strict=True):
        for form, (colour, marker) in LOOKS.items():
            own = [row for row in rows if row["form"] == form and row["concentration"] == concentration]
            axes.loglog([row["number"] for row in own], [1e6 * row["seconds"] for row in own], color=colour, marker=marker, label=form)
        axes.set(title=f"C_p = {100 * concentration:g} %", xlabel="number of grains")
        axes.grid(True, which="major", alpha=0.3)
    panels[0].set(ylabel="time per grain and d/u*, one core (µs)", ylim=(10.0, 1000.0))
    _legend(figure, panels[0], 4)
    figure.suptitle("The cost of a grain hardly depends on how many there are")
    return figure


def compared(rows: list[Record]) -> Any:
    """H and L with and without encounters against T, one panel per set of runs."""
    sets = list(dict.fromkeys((row["concentration"], row["particle_reynolds"]) for row in rows))
    figure, panels = plt.subplots(2, len(sets), figsize=(12.0, 6.4), sharex=True)
    for column, (concentration, reynolds) in enumerate(sets):
        for line, (name, label) in enumerate((("height", "jump height H (d)"), ("length", "jump length L (d)"))):
            axes = panels[line, column]
            own = [r for r in rows if (r["concentration"], r["particle_reynolds"]) == (concentration, reynolds) and r["quantity"] == name]
            for shift, side, colour, marker in ((-0.02, "without", GREY, "o"), (0.02, "with", RED, "s")):
                stage, mean, sd = ([r[key] for r in own] for key in ("stage", f"mean_{side}", f"sd_{side}"))
                axes.errorbar(
                    np.array(stage) + shift, mean, sd, color=colour, marker=marker, linestyle="-", linewidth=1.0, capsize=3, label=f"{side} encounters"
                )
            axes.set_ylim(bottom=0.0)
            axes.grid(True, alpha=0.3)
            if column == 0:
                axes.set_ylabel(label)
            if line == 0:
                axes.set_title(f"C_p = {100 * concentration:g} %, R_p = {reynolds:g}")
            else:
                axes.set_xlabel("transport stage T")
    panels[0, 0].legend(loc="upper left", fontsize=8)
    figure.suptitle("Encounters shorten jumps at 2.33 % and do nothing at 0.13 % (bars: standard deviation of single jumps)")
    return figure


def moments(runs: list[Record]) -> Any:
    """Second moments along and across from one release, with encounters and without."""
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 4.8))
    for axes, axis, name in zip(panels, "xy", ("along the stream", "across the stream"), strict=True):
        for run in runs:
            colour, label = (RED, "with encounters") if run["encounters"] else (GREY, "without encounters")
            own = run["first"]
            axes.loglog(own["lag"], own[axis], color=colour, marker="o", markersize=3, linewidth=1.0, label=label)
        axes.axvline(runs[0]["duration"], color="#999999", linestyle=":", linewidth=1.0)
        axes.annotate("a jump", (runs[0]["duration"], 0.02), xycoords=("data", "axes fraction"), xytext=(3, 0), textcoords="offset points", fontsize=8)
        axes.set(title=name, xlabel="time since release (d/u*)", ylabel=f"⟨{axis.upper()}'²⟩ (d²)")
        axes.grid(True, which="major", alpha=0.3)
    lag, x, y = (np.array(runs[0]["first"][key]) for key in ("lag", "x", "y"))
    for axes, values in zip(panels, (x, y), strict=True):
        middle = len(lag) // 2
        _slope(axes, lag[middle], 0.2 * values[middle], 6.0 * lag[middle], 1.0, "slope 1\n(γ = ½)", "right")
    panels[1].legend(loc="upper left", fontsize=9)
    figure.suptitle("Encounters alone spread grains across the stream")
    return figure
