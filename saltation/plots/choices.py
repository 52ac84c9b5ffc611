"""Figures of how effects and other modelling choices change a scene."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from basset._look import BLUE, GREY, ORANGE, PURPLE
from saltation import statistics
from saltation.plots.run import styled

WIDE, NARROW = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0), (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6)  # ticks
LOOKS = {"height": (BLUE, "o", "height H"), "length": (ORANGE, "s", "length L"), "velocity": (PURPLE, "^", "velocity ū")}


@styled
def ablation(table: pd.DataFrame, scene: str = "") -> Figure:
    """Relative change of H, L and ū when one effect is left out (`ablate`), bars two standard errors."""
    rows = table.iloc[1:]
    figure, panels = _panels(len(rows), 0.34)
    places = range(len(rows), 0, -1)
    for axes, quantity in zip(panels, statistics.VARIABLES, strict=True):
        colour, marker, label = LOOKS[quantity]
        for place, (_, row) in zip(places, rows.iterrows(), strict=True):
            if row["status"] == "finished":
                axes.errorbar(100.0 * row[f"{quantity}_change"], place, xerr=200.0 * row[f"{quantity}_error"], color=colour, marker=marker, capsize=3)
            else:
                _note(axes, place, row["status"])
        axes.set(xlabel=f"change of the mean {label} (%)", ylim=(0.4, len(rows) + 0.6))
        axes.set_yticks(places, [f"without {name.replace('_', ' ')}" for name in rows.index])
    figure.suptitle(f"{scene}{': c' if scene else 'C'}hange of the mean jump when an effect is left out (bars: two standard errors)")
    return figure


@styled
def spread(table: pd.DataFrame, scene: str = "") -> Figure:
    """Mean H, L and ū for every value of every choice (`uncertainty`), over those of the scene, beside its standard error."""
    base, rows = table.iloc[0], table.iloc[1:]
    choices = list(dict.fromkeys(rows["choice"]))
    figure, panels = _panels(len(choices), 0.6)
    for axes, quantity in zip(panels, statistics.VARIABLES, strict=True):
        colour, marker, label = LOOKS[quantity]
        error = 2.0 * base[f"{quantity}_error"]
        axes.axvspan(1.0 / (1.0 + error), 1.0 + error, color=GREY, alpha=0.35, linewidth=0.0)
        for place, choice in zip(range(len(choices), 0, -1), choices, strict=True):
            own = rows[rows["choice"] == choice]
            done = own[own["status"] == "finished"].sort_values(quantity)
            ratios = done[quantity] / base[quantity]
            axes.plot([ratios.min(), ratios.max()], [place, place], color=colour, alpha=0.3, linewidth=7.0, solid_capstyle="round")
            axes.plot(ratios, [place] * len(done), color=colour, marker=marker, linestyle="none")
            for ratio, value, side in ((ratios.min(), done["value"].iloc[0], -1), (ratios.max(), done["value"].iloc[-1], 1)):
                if abs(math.log(ratio)) > error:  # the scene's own needs no name
                    aligned = "right" if side < 0 else "left"
                    axes.annotate(value, (ratio, place), xytext=(9 * side, 0), textcoords="offset points", ha=aligned, va="center", fontsize=8)
            stopped = ", ".join(f"{value}: {status}" for value, status in own.loc[own["status"] != "finished", ["value", "status"]].to_numpy())
            if stopped:
                axes.annotate(f"({stopped})", (1.0, place), xytext=(0, 13), textcoords="offset points", ha="center", va="center", fontsize=8, color=GREY)
        axes.set(xscale="log", xlabel=f"mean {label} over that of the scene", ylim=(0.4, len(choices) + 0.6))
        low, high = axes.get_xlim()
        margin = max(high / low, 1.3) ** 0.25  # room for the names
        low, high = min(low, 0.9) / margin, max(high, 1.1) * margin
        ticks = [ratio for ratio in (WIDE if high > 3.0 * low else NARROW) if low < ratio < high]
        axes.set_xlim(low, high)
        axes.set_xticks(ticks, [f"{ratio:g}" for ratio in ticks])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_yticks(range(len(choices), 0, -1), choices)
    figure.suptitle(f"{scene}{': m' if scene else 'M'}ean jump for every open modelling choice (grey: two standard errors of the mean)")
    return figure


def _panels(rows: int, each: float) -> tuple[Figure, Any]:
    """Three panels side by side for some rows."""
    figure = Figure(figsize=(12.0, 1.5 + each * rows))
    panels = figure.subplots(1, 3, sharey=True)
    for axes in panels:
        axes.axvline(1.0 if each > 0.5 else 0.0, color=GREY, linewidth=1.0)
    return figure, panels


def _note(axes: Any, place: int, text: str) -> None:
    """Why there is no value."""
    axes.annotate(text, (0.0, place), xytext=(4, 0), textcoords="offset points", va="center", color=GREY, fontsize=8)
