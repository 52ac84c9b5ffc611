"""The figures of the page on equations with memory, from the records alone."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.analysis import Record, select, short

LOOKS = {  # colour, marker, dash
    "semi-derivative": (YELLOW, "v", "-"),
    "Euler–Maclaurin": (BLACK, "x", "-"),
    "Brush": (GREY, "+", "-"),
    "Hinsberg, published tail": (RED, "s", "-"),
    "Daitche(1)": (ORANGE, "o", "-"),
    "Daitche(2)": (GREEN, "^", "-"),
    "Daitche(3)": (BLUE, "D", "-"),
    "Daitche(1), slips": (ORANGE, "o", "--"),
    "Daitche(2), slips": (GREEN, "^", "--"),
    "Daitche(3), slips": (BLUE, "D", "--"),
    "Windowed, fitted tail": (SKY, "P", ":"),
    "Exponential(3)": (SKY, "P", "-"),
    "RK4, history held": (PINK, "X", "-"),
    "Collocation": (PURPLE, "*", "-"),
}
SAME = ("Windowed, fitted tail", "Daitche(2)", "Daitche(2), slips")  # on top of others, or between them: left out of crowded figures
PANELS = (("smooth", "smooth, slip 0"), ("settling", "from rest: starts as √t"), ("relaxing", "initial slip 1"))
KINDS = {"smooth": (GREEN, "o"), "from rest": (ORANGE, "^"), "with slip": (RED, "s"), "with impacts": (BLACK, "X")}


def _line(axes: Any, rows: list[Record], x: str, y: str, scheme: str, scale: float = 1.0, **more: Any) -> None:
    colour, marker, dash = LOOKS[scheme]
    shown = [r for r in rows if r.get(x) is not None and r.get(y)]
    emphasis = {"linewidth": 2.4, "markersize": 10, "zorder": 5} if scheme == "Collocation" else {}
    axes.loglog([scale * r[x] for r in shown], [r[y] for r in shown], dash, **({"color": colour, "marker": marker, "label": scheme} | emphasis | more))


def accuracy(records: list[Record]) -> Any:
    """Error against time on three starts."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 6.0), sharey=True, sharex=True)
    for axes, (problem, title) in zip(panels, PANELS, strict=True):
        for name in LOOKS:
            if name not in SAME:
                _line(axes, select(records, problem=problem, scheme=name), "seconds", "error_max", name)
        axes.set(title=title, xlabel="time of the whole solution, one core (s)", ylim=(1e-15, 3))
    panels[0].set_ylabel("largest error over the path / largest |y|")
    _slope(panels[0], 6e-2, 3e-8, 2.6e-1, -4, "t$^{-4}$", "right")
    _slope(panels[1], 4e-2, 5e-6, 2e-1, -2, "t$^{-2}$", "right")
    _slope(panels[2], 2e-2, 5e-1, 2e-1, -0.5, "t$^{-1/2}$", "right")
    _slope(panels[2], 2e-2, 5e-4, 2e-1, -1, "t$^{-1}$", "right")
    figure.suptitle("A digit costs a fixed-step scheme a multiple of its time, and after a jump far more; collocation pays a few steps, jump or not")
    _legend(figure, panels[0], 6)
    return figure


def convergence(records: list[Record]) -> Any:
    """Error against the step of the fixed-step schemes."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 6.0), sharey=True)
    for axes, (problem, title) in zip(panels, PANELS, strict=True):
        for name in LOOKS:
            if name not in (*SAME[:1], "Collocation", "Exponential(3)"):
                rows = [dict(r, h=4.0 / r["n"]) for r in select(records, problem=problem, scheme=name)]
                _line(axes, rows, "h", "error_max", name)
        axes.set(title=title, xlabel="step h (s)", ylim=(1e-12, 3))
    panels[0].set_ylabel("largest error over the nodes / largest |y|")
    for x0, y0, order, label in ((8e-3, 1.3e-1, 0.5, "h$^{1/2}$"), (8e-3, 2.5e-5, 2, "h$^2$"), (8e-3, 6e-12, 4, "h$^4$")):
        _slope(panels[0], 4.0 * x0, y0 * 4.0**order, x0, order, label)
    for x0, y0, order, label in ((8e-3, 1.5e-5, 1.5, "h$^{3/2}$"), (8e-3, 1.5e-7, 2, "h$^2$")):
        _slope(panels[1], 4.0 * x0, y0 * 4.0**order, x0, order, label)
    for x0, y0, order, label in ((8e-3, 2.5e-1, 0.5, "h$^{1/2}$"), (8e-3, 1.5e-4, 1, "h")):
        _slope(panels[2], 4.0 * x0, y0 * 4.0**order, x0, order, label)
    figure.suptitle("The same schemes, the same steps: after a jump the degree of a scheme no longer counts")
    _legend(figure, panels[0], 6)
    return figure


def orders(found: dict[str, dict[str, float]], declared: dict[str, float]) -> Any:
    """Measured order of every scheme before and after a jump."""
    names = [name for name in found if name != "Windowed, fitted tail"]
    figure, axes = plt.subplots(figsize=(9.0, 6.0))
    for row, name in enumerate(reversed(names)):
        values = found[name]
        known = [v for v in values.values() if v is not None]
        axes.plot([min(known), max(known)], [row, row], color="#cccccc", linewidth=2.0, zorder=1)
        axes.plot([declared[name]] * 2, [row - 0.3, row + 0.3], color=BLUE, linewidth=2.0, label="declared" if row == 0 else None)
        for kind, (colour, marker) in KINDS.items():
            if values.get(kind) is not None:
                axes.plot(values[kind], row, marker, color=colour, markersize=8, linestyle="none", label=kind if row == 0 else None)
    axes.set_yticks(range(len(names)), list(reversed(names)))
    axes.set(xlabel="measured exponent of the step h in the largest error over the path", xlim=(-0.1, 4.5))
    axes.set_title("What a jump does to the order: green before, red and black after")
    _legend(figure, axes, 5)
    return figure


def impacts(records: list[Record], fits: dict[str, dict[str, float]], target: float) -> Any:
    """Impact-time error against time on the bouncing sphere."""
    figure, axes = plt.subplots(figsize=(9.0, 5.8))
    _line(axes, select(records, scheme="Collocation"), "seconds", "error_max", "Collocation", label="Collocation (all ten impacts)")
    for name in LOOKS:
        if name not in (*SAME, "Collocation"):
            _line(axes, select(records, scheme=name), "seconds", "error_first", name, label=name)
    best = min(fits, key=lambda name: fits[name]["seconds"])
    fit = fits[best]
    start = fit["seconds"] * fit["n"] / fit["steps"]
    at = np.geomspace(start, fit["seconds"], 30)
    axes.loglog(at, target * (at / fit["seconds"]) ** -max(fit["order"], 1.0), ":", color=LOOKS[best][0], linewidth=1.6)
    middle = np.sqrt(start * fit["seconds"])
    height = target * (middle / fit["seconds"]) ** -max(fit["order"], 1.0)
    text = f"extrapolated, slope −{max(fit['order'], 1.0):.3g}"
    axes.annotate(text, (middle, height), xytext=(6, 6), textcoords="offset points", color="#666666", fontsize=9)
    axes.axhline(target, color="#999999", linestyle=":")
    axes.annotate(short(target), (axes.get_xlim()[0], target), xytext=(2, 3), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel="time of the whole solution, one core (s)", ylabel="largest error of the impact times (s)", ylim=(1e-13, 3))
    axes.set_title("Bouncing sphere: collocation finds all ten impacts, fixed steps snap the first three to the grid")
    _legend(figure, axes, 3)
    return figure


def tolerance(records: list[Record]) -> Any:
    """Error against the tolerance asked for."""
    figure, axes = plt.subplots(figsize=(8.0, 6.0))
    looks = zip((BLACK, GREY, ORANGE, RED, SKY, BLUE, GREEN, YELLOW, PINK, PURPLE), "ox^sPDv<X*", strict=True)
    rows = select(records, scheme="Collocation")
    for name, (colour, marker) in zip(dict.fromkeys(r["problem"] for r in rows), looks, strict=False):
        found = [r for r in rows if r["problem"] == name and r["error_max"]]
        axes.loglog([r["rtol"] for r in found], [r["error_max"] for r in found], color=colour, marker=marker, label=name, linewidth=1.0)
    asked = np.array([1e-11, 1e-3])
    for factor, label in ((1.0, "error = rtol"), (10.0, "10 rtol")):
        axes.loglog(asked, factor * asked, color="#666666", linestyle="-" if factor == 1.0 else ":", linewidth=1.4)
        axes.annotate(label, (8.5e-12, factor * 1e-11), color="#666666", fontsize=9, va="center")
    axes.set(xlabel="rtol asked for", ylabel="largest error / largest |y| (bouncing: of the impact times, s)", xlim=(1.5e-12, 2e-3), ylim=(1e-16, 1e-1))
    axes.invert_xaxis()
    axes.set_title("Largest error of the whole path: collocation keeps its tolerance, through jumps and impacts")
    _legend(figure, axes, 5)
    return figure


def by_impacts(records: list[Record], slope: float, level: float) -> Any:
    """Time against the number of impacts."""
    figure, axes = plt.subplots(figsize=(7.0, 4.4))
    count = [r["n"] for r in records]
    axes.plot(count, [1e3 * r["seconds"] for r in records], "*", color=PURPLE, markersize=11, linestyle="none", label="measured")
    ends = np.array([0, max(count)])
    axes.plot(ends, 1e3 * (level + slope * ends), ":", color="#666666", label=f"line: {1e3 * slope:.2f} ms per impact")
    axes.set(xlabel="impacts", ylabel="time of the whole solution, one core (ms)", xlim=(0, None), ylim=(0, None))
    axes.set_title("Collocation, rtol 1e-6: every impact costs the same")
    axes.legend(loc="upper left")
    return figure


def marge3d(found: Record) -> Any:
    """The vortex problem of marge3d."""
    figure, axes = plt.subplots(figsize=(8.0, 5.0))
    looks = {"marge3d, order 2": (GREEN, "^"), "marge3d, order 3": (BLUE, "D"), "Collocation": (PURPLE, "*")}
    for name, (colour, marker) in looks.items():
        rows = [r for r in found["records"] if r["solver"] == name]
        axes.loglog([r["seconds"] for r in rows], [r["error_max"] for r in rows], color=colour, marker=marker, markersize=9, label=name)
        for r in rows:
            text = f"{r['size']:g}" if name != "Collocation" else f"rtol {short(r['size'])}"
            if name != "Collocation" or r is rows[0] or r is rows[-1]:
                axes.annotate(text, (r["seconds"], r["error_max"]), xytext=(7, 3), textcoords="offset points", color=colour, fontsize=8)
    axes.axhline(found["best"], color="#999999", linestyle=":")
    axes.set(xlabel="time, set-up included, one core (s)", ylabel="largest error of the position over the path (–)")
    axes.set_title("marge3d's own vortex problem (numbers at its points: steps)")
    _legend(figure, axes, 3)
    return figure
