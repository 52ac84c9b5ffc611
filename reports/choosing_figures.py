"""The figure of the page on choosing, from the records alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREY, RED
from reports.analysis import Record


def sets(data: Record, titles: Mapping[str, str]) -> Any:
    """The largest true change of H, L or ū with every set of effects, against the number of effects; what is chosen is marked."""
    figure, panels = plt.subplots(1, len(data["sets"]), figsize=(11.0, 4.2), sharey=True)
    for axes, (name, rows) in zip(panels, data["sets"].items(), strict=True):
        full = len(rows[0]["effects"])
        for row in rows[1:]:
            if row["largest"] is None:  # its run did not finish
                continue
            axes.semilogy(len(row["effects"]), 100.0 * row["largest"], "o", color=GREY, alpha=0.7)
        axes.axhline(100.0 * data["tolerance"], color=RED, linestyle=":")
        left_out = data["chosen"][name][0]["left_out"]
        chosen = next(row for row in rows if set(rows[0]["effects"]) - set(row["effects"]) == set(left_out))
        if left_out:
            place = (len(chosen["effects"]), 100.0 * chosen["largest"])
            axes.semilogy(*place, "o", color=BLUE, markersize=9)
            text = "auto: without\n" + " and ".join(word.replace("_", " ") for word in left_out)
            axes.annotate(text, place, xytext=(-8, -4), textcoords="offset points", ha="right", va="top", color=BLUE)
        else:
            axes.annotate(
                f"auto: keeps all {full}", (full, 100.0 * data["tolerance"]), xytext=(0, -8), textcoords="offset points", ha="right", va="top", color=BLUE
            )
        axes.set(xlabel="number of effects", title=titles[name], xlim=(1.5, full + 0.5), ylim=(0.2, 2000.0))
    panels[0].annotate(f"tolerance {100.0 * data['tolerance']:g} %", (1.6, 100.0 * data["tolerance"]), xytext=(0, 3), textcoords="offset points", color=RED)
    panels[0].set(ylabel="largest change of mean H, L or ū (%)")
    ticks = (1.0, 10.0, 100.0, 1000.0)
    panels[0].set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    less = [titles[name].split(",")[0] for name in data["sets"] if data["chosen"][name][0]["left_out"]]
    can = f"{' and '.join(less) or 'no scene'} can do without some"
    figure.suptitle(f"Every set of effects, flown with another seed: within {100.0 * data['tolerance']:g} % {can}")
    return figure
