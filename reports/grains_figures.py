"""The figures of the page on many grains that are drawn from records; those of single runs are `saltation.cloud_plots`."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREEN, ORANGE, PURPLE
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
            axes.loglog([row["number"] for row in own], [1e6 * row["seconds"] for row in own], color=colour, marker=marker)
            axes.annotate(form, (own[-1]["number"], 1e6 * own[-1]["seconds"]), xytext=(0, 7), textcoords="offset points", ha="right", color=colour, fontsize=9)
        axes.set(title=f"C_p = {100 * concentration:g} %", xlabel="number of grains")
        axes.grid(True, which="major", alpha=0.3)
    panels[0].set(ylabel="time per grain and d/u*, one core (µs)", ylim=(10.0, 1000.0))
    figure.suptitle("The cost of a grain hardly depends on how many there are")
    figure.tight_layout()
    return figure
