"""The figure of the page on advice, from the records alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREEN, RED
from basset._look import legend as _legend
from reports.analysis import Record, short

COLOURS = {1e-3: GREEN, 1e-6: BLUE, 1e-9: RED}
MARKERS = {("stream", "chosen"): "o", ("path", "chosen"): "s", ("stream", "given"): "x", ("path", "given"): "+"}


def where(rows: Sequence[Record], **fields: Any) -> list[Record]:
    """The rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in fields.items())]


def ratios(rows: Sequence[Record], most: float) -> Any:
    """Time of the advised scheme over the fastest that really meets, per problem and accuracy."""
    figure, axes = plt.subplots(figsize=(10.0, 5.4))
    names = list(dict.fromkeys(row["case"] for row in rows))
    for i, (error, colour) in enumerate(COLOURS.items()):
        for (use, step), marker in MARKERS.items():
            own = [row for row in where(rows, use=use, step=step) if abs(row["error"] / error - 1.0) < 1e-6]
            places = [names.index(row["case"]) + 0.22 * (i - 1) for row in own]
            axes.semilogy(places, [row["ratio"] for row in own], marker, color=colour, label=f"{short(error)}, {use}, dt {step}")
    axes.axhline(most, color="#999999", linestyle=":")
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
    ticks = (1.0, 1.2, 1.5, 2.0, 3.0)
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set(ylabel="time / time of the fastest that really meets", title="The advised scheme against the fastest that is as exact as asked")
    _legend(figure, axes, 3)
    return figure
