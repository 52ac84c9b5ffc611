"""The figure of `saltation.select_scheme`: error against time per jump."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from basset._look import BLUE, GREY, ORANGE, PURPLE, RED
from saltation.plots.run import styled

LOOKS = {"collocation": (BLUE, "o"), "fixed_step": (ORANGE, "s"), "runge_kutta_4": (PURPLE, "^")}


@styled
def schemes(table: pd.DataFrame, scene: str = "") -> Figure:
    """Largest error of mean H, L and ū against CPU time per jump, a line per scheme and solver; extrapolated ones are hollow, the chosen one is ringed."""
    figure = Figure(figsize=(8.0, 5.4))
    axes: Any = figure.subplots()
    wanted, shown = table.attrs["wanted"], table[(table["error"] > 0.0) & (table["error"] < math.inf)]
    for solver, (colour, marker) in LOOKS.items():
        label = solver.replace("_", " ")
        for _, own in shown[shown["solver"] == solver].groupby("scheme", sort=False):
            rows = own.sort_values("error", ascending=False)
            axes.plot(rows["seconds"], 100.0 * rows["error"], color=colour, alpha=0.35, linewidth=1.0)
            for flown, part in sorted(rows.groupby(rows["runs"] > 0), reverse=True, key=lambda pair: pair[0]):
                face = colour if flown else "none"
                axes.plot(part["seconds"], 100.0 * part["error"], color=colour, marker=marker, markerfacecolor=face, linestyle="none", label=label)
                label = "_"
    best = table.iloc[0]
    axes.plot(best["seconds"], 100.0 * best["error"], "o", markersize=15, markerfacecolor="none", color=RED)
    step = f"rtol {best['rtol']:g}" if best["solver"] == "collocation" else f"dt {best['dt']:g} {table.attrs['units']['dt']}"
    text = f"{best['solver'].replace('_', ' ')}, {best['scheme']}, {step}"
    axes.annotate(text, (best["seconds"], 100.0 * best["error"]), xytext=(12, 8), textcoords="offset points", color=RED, fontsize=8)
    axes.axhline(100.0 * wanted, color=GREY, linestyle=":")
    axes.annotate(f"wanted: {100.0 * wanted:g} %", (1.0, 100.0 * wanted), (-4, 3), ("axes fraction", "data"), "offset points", ha="right", color=GREY)
    axes.set(xscale="log", yscale="log", xlabel="CPU time per jump (s)", ylabel="largest error of mean H, L and ū, 95 % bound (%)")
    axes.legend(loc="best", frameon=False)
    figure.suptitle(f"{scene}{': e' if scene else 'E'}rror against time (hollow: extrapolated by the measured order)")
    return figure
