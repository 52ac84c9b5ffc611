"""The figure of `saltation.compare`: a record, the model's curve, and the residuals."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from basset._look import BLUE, GREY, RED
from saltation.plots.run import styled
from saltation.study.comparison import Comparison
from saltation.study.records import QUANTITIES

LABELS = {
    "x": "along the stream x",
    "y": "across the stream y",
    "z": "height of the centre z",
    "gap": "gap under the grain",
    "u": "velocity along u",
    "v": "velocity across v",
    "w": "velocity up w",
    "speed": "speed",
}


@styled
def comparison(found: Comparison, title: str = "") -> Figure:
    """A column per quantity: the record's points on the model's curve, and the residuals with a band of two standard deviations of the noise."""
    names = list(found.misfit.index)
    figure = Figure(figsize=(max(7.0, 4.6 * len(names)), 5.6))
    panels = figure.subplots(2, len(names), sharex=True, squeeze=False, height_ratios=[3.0, 1.0])
    time, fine = found.points["time"], found.curve["time"]
    clock, second = (1e3, "ms") if time.iloc[-1] - time.iloc[0] < 1.0 else (1.0, "s")
    for (above, below), name in zip(panels.T, names, strict=True):
        values, row = found.points[name], found.misfit.loc[name]
        scale, unit = scaled(values.abs().max(), QUANTITIES[name][0])
        above.plot(clock * fine, scale * found.curve[name], color=BLUE, label="model")
        above.plot(clock * time, scale * values, "o", color=RED, markersize=3.5, label="record")
        above.set_ylabel(f"{LABELS[name]} ({unit})")
        above.legend(loc="best")
        off = found.points[f"{name}_residual"]
        scale, unit = scaled(off.abs().max(), QUANTITIES[name][0])
        counts = found.points[f"{name}_counts"]
        if np.isfinite(row["noise"]):
            below.axhspan(-2.0 * scale * row["noise"], 2.0 * scale * row["noise"], color=GREY, alpha=0.25, linewidth=0.0, label="± 2 s.d. of the noise")
        below.axhline(0.0, color=GREY, linewidth=1.0)
        below.plot(clock * time[counts], scale * off[counts], "o", color=RED, markersize=3.0)
        if (~counts & off.notna()).any():
            below.plot(clock * time[~counts], scale * off[~counts], "o", markerfacecolor="none", color=GREY, markersize=3.0, label="not compared")
        below.set(xlabel=f"time ({second})", ylabel=f"model − record\n({unit})")
        if below.get_legend_handles_labels()[1]:
            below.legend(loc="best", ncols=2)
    figure.suptitle("\n".join(filter(None, (title, *map(said, found.fitted.index, found.fitted.to_dict("records"))))))
    return figure


def said(name: Any, row: dict[Any, Any]) -> str:
    """A fitted field and its interval, the wider one."""
    low, high = min(row["low"], row["blocks_low"]), max(row["high"], row["blocks_high"])
    return f"{name} = {row['value']:.4g}, 95 % interval {low:.4g} to {high:.4g}"


def scaled(most: float, unit: str) -> tuple[float, str]:
    """(factor, unit) that make numbers up to `most`, in m or m/s, readable."""
    factor, prefix = (1.0, "") if most >= 1.0 else (1e3, "m") if most >= 1e-3 else (1e6, "µ")
    return factor, prefix + unit
