"""The figures of the page on scenes, from the records alone."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.analysis import Record, short

COLLOCATION, IMPLICIT = "collocation", "fixed_step"
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
WINDOWED = "Daitche(2), window {:g}"
THEIRS = BROWN  # windows without a tail
FLOORS = (0.1, 0.3, 1.0, 10.0)  # those that are shown
BOTTOM = 1e-4  # per cent: collocation goes on below
CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}  # behind labels that lines would cross
TITLES = {"height": "mean height", "length": "mean length"}


def step(size: float) -> str:
    """A step or tolerance, short: 0.004, 2.5e-4."""
    if size >= 1e-3 and abs(size * 1e3 - round(size * 1e3)) < 1e-9 and size < 1.0:
        return f"{size:g}"
    digits = next(k for k in range(4) if abs(float(f"{size:.{k}e}") / size - 1.0) < 1e-9)
    return short(size, digits)


def _known(found: Record) -> tuple[float, bool]:
    """(error in per cent, whether it stands out of its scatter); an upper bound where it does not."""
    bias, se = abs(found["bias"]), found["se"]
    return 100.0 * (bias if bias > se else bias + 2.0 * se), bias > se


def _points(records: list[Record], quantity: str) -> list[tuple[float, float, bool]]:
    """(time in µs, error in per cent, whether it stands out) by falling step."""
    return [(1e6 * r["seconds"], *_known(r[quantity])) for r in sorted(records, key=lambda r: -r["size"])]


def _line(axes: Any, points: list[tuple[float, float, bool]], colour: str, marker: str, dash: str = "-", **more: Any) -> None:
    """A line, with hollow markers where the error is no more than an upper bound."""
    axes.loglog([x for x, _, _ in points], [y for _, y, _ in points], dash, color=colour, marker=marker, **more)
    bounds = [(x, y) for x, y, known in points if not known]
    axes.plot([x for x, _ in bounds], [y for _, y in bounds], marker, color=colour, markerfacecolor="white", zorder=6)


def _floors(axes: Any, records: list[Record], quantity: str) -> None:
    """Windows without a tail, each labelled by its length."""
    for w in FLOORS:
        own = [r for r in records if r["scheme"] == WINDOWED.format(w) and r["method"] == IMPLICIT]
        if not own:
            continue
        points = _points(own, quantity)
        _line(axes, points, THEIRS, ".", linewidth=1.0, label="window without a tail, length in d/u*" if w == 1.0 else None)
        axes.annotate(f"{w:g}", points[-1][:2], xytext=(5, 0), textcoords="offset points", color=THEIRS, fontsize=9, va="center", bbox=CLEAR)
        lucky = min(own, key=lambda r: abs(r[quantity]["bias"]))
        if lucky["truncation"] is not None and abs(lucky[quantity]["bias"]) < 0.25 * abs(lucky["truncation"][quantity]["bias"]):
            where = (1e6 * lucky["seconds"], _known(lucky[quantity])[0])
            axes.annotate(
                "step and window\ncancel by chance", where, xytext=(0, -8), textcoords="offset points", color=THEIRS, fontsize=8, ha="center", va="top"
            )


def _collocation(axes: Any, records: list[Record], quantity: str) -> None:
    """The collocation, down to the end of the axis; how far it goes beyond in words."""
    own = sorted((r for r in records if r["scheme"] == COLLOCATION), key=lambda r: -r["size"])
    points = _points(own, quantity)
    _line(axes, points, PURPLE, "*", markersize=10, linewidth=2.4, label="collocation", zorder=5)
    for k, (r, (x, y, _)) in enumerate(zip(own, points, strict=True)):
        if y > BOTTOM:
            near = k > 0 and abs(np.log10(y / points[k - 1][1])) < 0.2  # the next label above or below would be covered
            text = ("rtol " if k == 0 else "") + short(r["size"])
            left = {"xytext": (9, 4), "ha": "left"} if near else {"xytext": (-9, 0), "ha": "right"}
            axes.annotate(text, (x, y), textcoords="offset points", va="center", color=PURPLE, fontsize=9, **left)
    text = f"on to {points[-1][1]:.0e} %\n(rtol {short(own[-1]['size'])}, {points[-1][0]:.0f} µs)".replace("e-0", "e-")
    shown = max(x for x, y, _ in points if y > BOTTOM)
    axes.annotate(text, (2.0 * shown, BOTTOM), xytext=(0, 16), textcoords="offset points", color=PURPLE, fontsize=9)


def accuracy(data: Record, memory: str) -> Any:
    """Error of the mean jump against time per jump, implicit steps."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 7.6), sharey=True)
    records = [r for r in data[memory]["records"] if r["height"] is not None]
    scheme, method, dt = data["thesis"]
    thesis = [r for r in records if (r["scheme"], r["method"]) == (scheme, method) and np.isclose(r["size"], dt)]
    for axes, quantity in zip(panels, TITLES, strict=True):
        _floors(axes, records, quantity)
        for name, (colour, marker, label) in LOOKS.items():
            own = [r for r in records if r["scheme"] == name and r["method"] == IMPLICIT]
            if own:
                _line(axes, _points(own, quantity), colour, marker, label=label, linewidth=1.2)
        _collocation(axes, records, quantity)
        for r in thesis:
            where, up = (1e6 * r["seconds"], _known(r[quantity])[0]), (0, 26)
            arrow = {"arrowstyle": "-", "color": "#444444", "linewidth": 0.8}
            text = f"the thesis's way\n(RK4, dt {dt:g})"
            axes.annotate(text, where, xytext=up, textcoords="offset points", ha="center", color="#444444", fontsize=9, arrowprops=arrow)
        axes.set(title=TITLES[quantity], xlabel="CPU time per jump, one core (µs)", ylim=(BOTTOM, 1.5e2))
    low, high = panels[0].get_xlim()
    for axes in panels:
        axes.set_xlim(low / 2.5, 1.5 * high)
        _slope(axes, *((7e2, 2.2, 3e4, -0.5, "t$^{-1/2}$") if memory == "impulse" else (3e2, 0.35, 1.6e4, -1.0, "t$^{-1}$")), "right")
    panels[0].set_ylabel("error of the mean (%)")
    titles = {
        "impulse": "Rebounds remembered: fixed steps err as √dt whatever the scheme, a window without a tail adds a floor; collocation does neither",
        "reset": "Memory wiped at rebounds: fixed steps are of first order, windows shorter than a flight keep a floor, collocation stays far below",
    }
    figure.suptitle(titles[memory])
    _legend(figure, panels[0], 4)
    return figure


def _pieces(points: list[tuple[float, Record]]) -> list[list[tuple[float, float, bool]]]:
    """Truncation against the window, cut where its sign changes: the logarithm of its size would join what passes through zero."""
    pieces: list[list[tuple[float, float, bool]]] = []
    sign = 0.0
    for x, found in points:
        value, known = _known(found)
        if not pieces or (known and sign and np.sign(found["bias"]) != sign):
            pieces.append([])
        pieces[-1].append((x, value, known))
        sign = np.sign(found["bias"]) if known else sign
    return pieces


def windows(data: Record) -> Any:
    """What a cut memory does by itself, against the window: dropped, published tail, fitted tail."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.0), sharey=True)
    records = [r for r in data["impulse"]["records"] if r["height"] is not None]
    duration, steps = data["impulse"]["duration"], {4e-3: ":", 1e-3: "-"}
    groups = (
        ("no tail", THEIRS, "o", DROPPED, "Daitche"),
        ("published tail (Hinsberg)", RED, "s", "window, published tail", "Hinsberg"),
        ("fitted tail, rtol 1e-6", PINK, "X", "window, fitted tail", "Daitche"),
    )
    for axes, quantity in zip(panels, TITLES, strict=True):
        for name, colour, marker, family, rule in groups:
            for dt, dash in steps.items():
                own = [r for r in records if r["family"] == family and r["scheme"].startswith(rule) and r["method"] == IMPLICIT and np.isclose(r["size"], dt)]
                points = sorted(((r["history"]["window"], r["truncation"][quantity]) for r in own if r["truncation"] is not None), key=lambda pair: pair[0])
                for k, piece in enumerate(_pieces(points)):
                    _line(axes, piece, colour, marker, dash, label=name if dash == "-" and k == 0 else None)
        kept = [r for r in records if "window_jumps" in r["history"]]
        for piece in _pieces([(duration * r["history"]["window_jumps"], r[quantity]) for r in kept]):
            _line(axes, piece, PURPLE, "*", label="no tail, memory of 1 to 50 whole jumps (collocation: the step does not err)", markersize=9)
        for dt, dash in steps.items():
            level = _known(next(r for r in records if (r["scheme"], r["method"]) == ("Exponential(2)", IMPLICIT) and np.isclose(r["size"], dt))[quantity])[0]
            axes.axhline(level, color="#999999", linewidth=0.9, linestyle=dash, zorder=1)
            text = f"what the step errs at dt {step(dt)}"
            axes.annotate(
                text, (1.0, level), xycoords=("axes fraction", "data"), xytext=(-2, 2), textcoords="offset points", ha="right", color="#666666", fontsize=8
            )
        for r in records:
            if r["scheme"] in (WINDOWED.format(0.1), WINDOWED.format(30.0)) and r["method"] == IMPLICIT and np.isclose(r["size"], 1e-3):
                found = r["truncation"][quantity]
                where = (r["history"]["window"], 100.0 * abs(found["bias"]))
                text = "too high" if quantity == "height" else "too long"
                text = text if found["bias"] > 0.0 else {"height": "too low", "length": "too short"}[quantity]
                axes.annotate(text, where, xytext=(8, 2 if found["bias"] > 0.0 else -14), textcoords="offset points", color=THEIRS, fontsize=9)
        axes.set(title=TITLES[quantity], xlabel=f"window (d/u*); a jump lasts {duration:.1f}")
    panels[0].set_ylabel("error by the cut memory alone (%)")
    panels[0].plot([], [], ":", color="#666666", marker="o", label="the same at dt 0.004")
    panels[0].plot([], [], "o", color="#666666", markerfacecolor="white", linestyle="", label="within its scatter: upper bound")
    figure.suptitle("What a window drops no step brings back; a tail does")
    _legend(figure, panels[0], 3)
    return figure
