"""The figures of the page on scenes, from the records alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.analysis import Record, short

COLLOCATION, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
DROPPED = "window, no tail"
LOOKS: dict[str, tuple[str, str, str]] = {  # colour, marker, label
    "semi-derivative": (YELLOW, "v", "semi-derivative, whole past"),
    "Euler–Maclaurin": (BLACK, "x", "Euler–Maclaurin, whole past"),
    "Brush": (GREY, "+", "Brush, whole past"),
    "Daitche(1)": (ORANGE, "o", "Daitche(1), whole past"),
    "Daitche(2)": (GREEN, "^", "Daitche(2), whole past"),
    "Daitche(3)": (BLUE, "D", "Daitche(3), whole past"),
    "Hinsberg, window 0.5": (RED, "s", "Hinsberg, published tail"),
    "Daitche(2), window 0.1, fitted tail": (PINK, "X", "window 0.1, fitted tail"),
    "Exponential(3)": (SKY, "P", "Exponential(3)"),
}
WINDOWED = "Daitche(2), window {}"
THEIRS = BROWN  # windows without a tail
TITLES = {"height": "mean height", "length": "mean length"}


def step(size: float) -> str:
    """A step or tolerance, short: 0.004, 2.5e-4."""
    if size >= 1e-3 and abs(size * 1e3 - round(size * 1e3)) < 1e-9 and size < 1.0:
        return f"{size:g}"
    digits = next(k for k in range(4) if abs(float(f"{size:.{k}e}") / size - 1.0) < 1e-9)
    return short(size, digits)


def _known(records: list[Record], quantity: str) -> list[tuple[float, float, bool]]:
    """(time in µs, error in per cent, whether it stands out of its scatter) by falling step; an upper bound where it does not."""
    found = []
    for r in sorted(records, key=lambda r: -r["size"]):
        bias, se = abs(r[quantity]["bias"]), r[quantity]["se"]
        found.append((1e6 * r["seconds"], 100.0 * (bias if bias > se else bias + 2.0 * se), bias > se))
    return found


def _line(axes: Any, points: list[tuple[float, float, bool]], colour: str, marker: str, dash: str = "-", **more: Any) -> None:
    """A line with hollow markers where the error is no more than an upper bound."""
    if not points:
        return
    label = more.pop("label", None)
    axes.loglog([x for x, _, _ in points], [y for _, y, _ in points], dash, color=colour, label=label, marker=marker, **more)
    bounds = [(x, y) for x, y, known in points if not known]
    more = {"markersize": more.get("markersize", 5), "zorder": 6}
    axes.loglog([x for x, _ in bounds], [y for _, y in bounds], marker, color=colour, markerfacecolor="white", **more)


def accuracy(data: Record, memory: str) -> Any:
    """Error of the mean jump against time per jump."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.8), sharey=True)
    records = [r for r in data[memory]["records"] if r["height"] is not None]
    windows = sorted({r["history"]["window"] for r in records if r["family"] == DROPPED and r["scheme"].startswith("Daitche")})
    for axes, quantity in zip(panels, TITLES, strict=True):
        for w in windows:
            own = [r for r in records if r["scheme"] == WINDOWED.format(f"{w:g}") and r["method"] == IMPLICIT]
            points = _known(own, quantity)
            _line(axes, points, THEIRS, ".", linewidth=1.0, label="window without a tail (its length in d/u*)" if w == windows[0] else None)
            axes.annotate(f"{w:g}", points[-1][:2], xytext=(5, 0), textcoords="offset points", color=THEIRS, fontsize=9, va="center")
        for scheme, (colour, marker, label) in LOOKS.items():
            for method, dash in ((IMPLICIT, "-"), (HELD, ":")):
                own = [r for r in records if r["scheme"] == scheme and r["method"] == method]
                _line(axes, _known(own, quantity), colour, marker, dash, label=label if method == IMPLICIT else None, linewidth=1.2)
        own = [r for r in records if r["scheme"] == COLLOCATION]
        points = _known(own, quantity)
        _line(axes, points, PURPLE, "*", markersize=10, linewidth=2.4, label="collocation", zorder=5)
        for r, (x, y, _) in zip(sorted(own, key=lambda r: -r["size"]), points, strict=True):
            text = ("rtol " if r["size"] > 9e-3 else "") + short(r["size"])
            axes.annotate(text, (x, y), xytext=(-9, -2), textcoords="offset points", ha="right", va="center", color=PURPLE, fontsize=9)
        axes.set(title=TITLES[quantity], xlabel="CPU time per jump, one core (µs)")
    low, high = panels[0].get_xlim()
    for axes in panels:
        axes.set_xlim(low / 3.0, 1.6 * high)
        if memory == "impulse":
            _slope(axes, 3e2, 6.5, 1.1e4, -0.5, "t$^{-1/2}$", "left")
        else:
            _slope(axes, 4e2, 0.3, 1.2e4, -1.0, "t$^{-1}$", "left")
    panels[0].set_ylabel("error of the mean (%)")
    titles = {
        "impulse": "Rebounds remembered: the whole past leaves the step's error, a window without a tail adds a floor; collocation has neither",
        "reset": "Memory wiped at rebounds: fixed steps are of first order, windows shorter than a flight keep their floor, collocation stays far below",
    }
    figure.suptitle(titles[memory])
    panels[0].plot([], [], ":", color="#666666", label="the same with RK4, history held")
    panels[0].plot([], [], "o", color="#666666", markerfacecolor="white", label="no more than an upper bound")
    _legend(figure, panels[0], 4)
    return figure


def windows(data: Record) -> Any:
    """What a cut memory does by itself, against the window: dropped, published tail, fitted tail."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 5.6), sharey=True)
    records = [r for r in data["impulse"]["records"] if r["height"] is not None]
    steps = {4e-3: ":", 1e-3: "-"}
    groups: tuple[tuple[str, str, str, Callable[[Record], bool]], ...] = (
        ("no tail", THEIRS, "o", lambda r: r["family"] == DROPPED and r["scheme"].startswith("Daitche")),
        ("published tail (Hinsberg)", RED, "s", lambda r: r["family"] == "window, published tail" and r["scheme"].startswith("Hinsberg")),
        ("fitted tail, rtol 1e-6", PINK, "X", lambda r: r["family"] == "window, fitted tail"),
    )
    for axes, quantity in zip(panels, TITLES, strict=True):
        for name, colour, marker, chosen in groups:
            for dt, dash in steps.items():
                own = [r for r in records if chosen(r) and r["method"] == IMPLICIT and np.isclose(r["size"], dt) and r["truncation"] is not None]
                points = [(r["history"]["window"], 100.0 * abs(r["truncation"][quantity]["bias"]), 200.0 * r["truncation"][quantity]["se"]) for r in own]
                label = name if dt == 1e-3 else None
                hollow = {"markerfacecolor": "white"} if dash == ":" else {}
                axes.loglog([x for x, _, _ in points], [max(y, 1e-6) for _, y, _ in points], dash, color=colour, marker=marker, label=label, **hollow)
        kept = [r for r in records if "window_jumps" in r["history"]]
        duration = data["impulse"]["duration"]
        x, y = [duration * r["history"]["window_jumps"] for r in kept], [100.0 * abs(r[quantity]["bias"]) for r in kept]
        axes.loglog(x, y, "-", color=PURPLE, marker="*", markersize=9, label="no tail, window in whole jumps (collocation: no error of the step)")
        twin = {dt: next(r for r in records if r["scheme"] == "Exponential(2)" and r["method"] == IMPLICIT and np.isclose(r["size"], dt)) for dt in steps}
        for dt, r in twin.items():
            level = 100.0 * abs(r[quantity]["bias"])
            axes.axhline(level, color="#999999", linewidth=0.8, linestyle=steps[dt])
            axes.annotate(f"the step's own error at dt {step(dt)}", (0.1, level), xytext=(0, 2), textcoords="offset points", color="#666666", fontsize=8)
        axes.set(title=TITLES[quantity], xlabel=f"window (d/u*); a jump lasts {duration:.1f}")
    panels[0].set_ylabel("error by the cut memory alone (%)")
    panels[0].plot([], [], ":", color="#666666", marker="o", markerfacecolor="white", label="the same at dt 0.004: no step size removes it")
    figure.suptitle("What a window drops no step brings back; a tail brings it back, a fitted one to what it promised")
    _legend(figure, panels[0], 3)
    return figure
