"""Pictures of what effects and other choices do to a scene."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from basset._look import BLUE, GREY, ORANGE, PURPLE
from saltation import statistics
from saltation.plots import styled

LOOKS = {"height": (BLUE, "o", "height H"), "length": (ORANGE, "s", "length L"), "velocity": (PURPLE, "^", "velocity ū")}


@styled
def ablation(table: pd.DataFrame) -> Figure:
    """Relative change of H, L and ū when one effect is left out; `table` from `advice.ablate`."""
    rows = table.iloc[1:]
    return changes_of(rows, [str(name) for name in rows.index], "What changes when an effect is left out")


@styled
def spread(table: pd.DataFrame) -> Figure:
    """Relative change of H, L and ū when one choice is made otherwise; `table` from `advice.uncertainty`."""
    rows = table.iloc[1:]
    labels = [f"{choice}: {value}" for choice, value in zip(rows["choice"], rows["value"], strict=True)]
    return changes_of(rows, labels, "What other choices do (bars: two standard errors)")


def changes_of(rows: pd.DataFrame, labels: list[str], title: str) -> Figure:
    """One line per row, one panel per quantity; what does not finish its run is crossed out."""
    figure = Figure(figsize=(11.0, 1.4 + 0.32 * len(rows)))
    panels = figure.subplots(1, 3, sharey=True)
    places = list(range(len(rows), 0, -1))
    for axes, name in zip(panels, statistics.VARIABLES, strict=True):
        colour, marker, label = LOOKS[name]
        for place, (_, row) in zip(places, rows.iterrows(), strict=True):
            if row["status"] == "finished":
                axes.errorbar(100.0 * row[f"{name}_change"], place, xerr=200.0 * row[f"{name}_error"], color=colour, marker=marker, capsize=3)
            else:
                axes.annotate(row["status"], (0.0, place), xytext=(4, 0), textcoords="offset points", va="center", color=GREY, fontsize=8)
        axes.axvline(0.0, color=GREY, linewidth=1.0)
        axes.set(xlabel=f"change of the mean {label} (%)")
        axes.set_yticks(places, labels)
    figure.suptitle(title)
    return figure
