"""The figures of the page on flights, from the records alone."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import PINK, PURPLE
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports import solver_figures
from reports.analysis import Record, short

LOOKS = solver_figures.LOOKS | {"Windowed, fitted tail": (PINK, "X", "-")}  # colour, marker, dash
OURS = "collocation"
DASHES = {"fixed_step": "-", "runge_kutta_4": "--"}
FILLS = {"fixed_step": None, "runge_kutta_4": "none"}


def _line(axes: Any, rows: list[Record], x: str, y: str, scheme: str, method: str) -> None:
    colour, marker, _ = LOOKS[scheme]
    label = scheme if method == "fixed_step" else None
    more = {} if FILLS[method] is None else {"markerfacecolor": FILLS[method]}
    axes.loglog([r[x] for r in rows], [r[y] for r in rows], DASHES[method], color=colour, marker=marker, label=label, linewidth=1.0, **more)


def _keys(axes: Any) -> None:
    """What full and broken lines mean."""
    for method, text in (("fixed_step", "implicit step"), ("runge_kutta_4", "RK4, history held over the step")):
        axes.plot([], [], DASHES[method], color="#666666", label=text)


def accuracy(data: Record) -> Any:
    """Error of a jump against its time, by every scheme."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.4), sharey=True)
    titles = {"remembered": "rebound remembered: every takeoff has slip", "forgotten": "memory wiped at the rebound: no takeoff has slip"}
    for axes, (key, title) in zip(panels, titles.items(), strict=True):
        records = data[key]["records"]
        for scheme in dict.fromkeys(r["scheme"] for r in records if r["method"] != OURS):
            for method in DASHES:
                rows = [r for r in records if r["scheme"] == scheme and r["method"] == method and r["rms"]]
                _line(axes, [dict(r, time=1e6 * r["seconds"]) for r in rows], "time", "rms", scheme, method)
        rows = [r for r in records if r["method"] == OURS]
        axes.loglog(
            [1e6 * r["seconds"] for r in rows], [r["rms"] for r in rows], color=PURPLE, marker="*", markersize=10, linewidth=2.4, label="collocation", zorder=5
        )
        for r in (rows[0], rows[-1]):
            text = f"rtol {short(r['size'])}"
            axes.annotate(text, (1e6 * r["seconds"], r["rms"]), xytext=(-8, -3), textcoords="offset points", ha="right", color=PURPLE, fontsize=9)
        axes.set(title=title, xlabel="time per jump, one core (µs)")
    scheme, method, dt = data["thesis"]
    thesis = next(r for r in data["remembered"]["records"] if r["scheme"] == scheme and r["method"] == method and np.isclose(r["size"], dt))
    panels[0].annotate(
        f"the thesis's way: dt {dt:g}",
        (1e6 * thesis["seconds"], thesis["rms"]),
        xytext=(-10, -45),
        textcoords="offset points",
        ha="center",
        color="#444444",
        fontsize=9,
        arrowprops={"arrowstyle": "-", "color": "#444444", "linewidth": 0.8},
    )
    for axes in panels:
        low, high = axes.get_xlim()
        axes.set_xlim(low / 4.0, high)
    _slope(panels[0], 8e2, 3e-2, 6e3, -0.5, "t$^{-1/2}$", "right")
    _slope(panels[1], 6e2, 1.2e-3, 6e3, -1, "t$^{-1}$", "right")
    panels[0].set_ylabel(f"error of a jump / mean jump, root mean square over {data['flown']} jumps")
    figure.suptitle("A jump by collocation is both quicker and far more exact than at fixed steps, whatever their scheme")
    _keys(panels[0])
    _legend(figure, panels[0], 5)
    return figure


def convergence(found: Record) -> Any:
    """Height of one jump against dt, by every scheme."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.0))
    exact, records = found["exact"]["height"], found["records"]
    for scheme in dict.fromkeys(r["scheme"] for r in records):
        for method in DASHES:
            rows = [dict(r, root=r["dt"] ** 0.5, error=abs(r["height"] / exact - 1.0)) for r in records if r["scheme"] == scheme and r["method"] == method]
            _line(panels[0], rows, "dt", "error", scheme, method)
            _line(panels[1], rows, "root", "height", scheme, method)
    panels[1].set(xscale="linear", yscale="linear")
    panels[1].plot(0.0, exact, "*", color=PURPLE, markersize=13, clip_on=False, zorder=5, label="collocation")
    steps = sorted({r["dt"] for r in records})
    _slope(panels[0], steps[-1], 1.7 * max(abs(r["height"] / exact - 1.0) for r in records), steps[0], 0.5, "dt$^{1/2}$")
    panels[0].set(xlabel="dt (d/u*)", ylabel="error of the height / height by collocation", title="the error", xlim=(steps[0] / 2.0, steps[-1] * 1.5))
    panels[1].set(xlabel="root of dt (d/u*)", ylabel="height of the first jump (d)", title="the height itself")
    panels[1].set_xlim(0.0, None)
    figure.suptitle("Every scheme tends to the collocation's jump, and every one as the root of the step")
    _keys(panels[1])
    _legend(figure, panels[1], 6)
    return figure
