"""The figures, from the records alone: Okabe–Ito colours, a marker of its own for every rule, one message each."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.analysis import CACHED, COLD, PUBLISHED, Record, schemes, select, short

STYLE: dict[str, tuple[str, str]] = {  # colour, marker
    "Euler–Maclaurin": (BLACK, "x"),
    "Brush": (GREY, "+"),
    "semi-derivative": (YELLOW, "v"),
    "Hinsberg": (RED, "s"),
    "Daitche(1)": (ORANGE, "o"),
    "Daitche(2)": (GREEN, "^"),
    "Daitche(3)": (BLUE, "D"),
    "Daitche(4)": (SKY, "P"),
    "Daitche(6)": (PINK, "X"),
    "Daitche(8)": (PURPLE, "h"),
    "Daitche(10)": (BROWN, "*"),
}


def _alternative(figure: Any) -> str:
    """A figure's title, or those of its panels, as plain text."""
    titles = [figure.get_suptitle()] if figure.get_suptitle() else [axes.get_title() for axes in figure.axes]
    text = "; ".join(dict.fromkeys(" ".join(title.split()) for title in titles if title))
    return re.sub(r"\\\w+|[$\\{}\[\]]", "", text)


def save(figure: Any, folder: Path, name: str) -> str:
    """Write NAME.svg and NAME.png, without dates; the Markdown that shows the figure, its title as the text for those who do not see it."""
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    figure.savefig(folder / f"{name}.png", dpi=150, metadata={"Software": None})
    plt.close(figure)
    return f"![{_alternative(figure) or name.replace('_', ' ')}](figures/{name}.png)\n\n([SVG](figures/{name}.svg))"


def _line(axes: Any, records: list[Record], x: str, y: str, scheme: str, **more: Any) -> None:
    colour, marker = STYLE[scheme]
    shown = [r for r in records if r[x] is not None and r[y] is not None and r[y] > 0.0]
    # Hinsberg and Daitche(1) lie on top of each other where they are the same: the one is drawn hollow around the other
    hollow = {"markersize": 9, "markerfacecolor": "none"} if scheme == "Hinsberg" else {}
    axes.loglog([r[x] for r in shown], [r[y] for r in shown], color=colour, marker=marker, **({"label": scheme} | hollow | more))


def convergence(records: list[Record]) -> Any:
    """Fig. 5-4 again, by the largest error over the second half of the path."""
    figure, axes = plt.subplots(figsize=(8.0, 6.0))
    for name in schemes(records):
        _line(axes, select(records, scheme=name, clock=CACHED, problem="fresnel_generic"), "h", "error_max", name)
    for x0, y0, x1, order, label in (
        (0.02, 3.5e-1, 1.3e-3, 0.5, "h$^{1/2}$"),
        (0.02, 3e-2, 1.3e-3, 1, "h"),
        (0.02, 2.5e-4, 1.3e-3, 2, "h$^2$"),
        (0.02, 1e-6, 1.3e-3, 3, "h$^3$"),
        (0.06, 6e-8, 8e-3, 4, "h$^4$"),
    ):
        _slope(axes, x0, y0, x1, order, label)
    _slope(axes, 0.15, 3e-13, 0.45, 9, "h$^9$", "right")
    axes.set(xlabel="step h (s)", ylabel="largest error over the second half of the path (s$^{-1/2}$)", ylim=(5e-15, 60))
    axes.set_title("Every rule keeps its order; rounding, not cancellation, sets the floor")
    _legend(figure, axes, 4)
    return figure


def clocks(records: list[Record]) -> Any:
    """Fig. 5-3 again: with the build inside the clock, and without."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 5.2), sharey=True)
    thesis = select(records, problem="fresnel")
    for name in schemes(records):
        _line(panels[0], select(thesis, scheme=name, clock=PUBLISHED), "h", "seconds", name)
        _line(panels[1], select(thesis, scheme=name, clock=CACHED), "h", "seconds", name)
    panels[0].set(title="weights built as published, inside the clock", xlabel="step h (s)", ylabel="time per value, one core (s)")
    panels[1].set(title="weights cached", xlabel="step h (s)")
    _slope(panels[0], 0.08, 1.5e-4, 0.002, -1, "h$^{-1}$")
    figure.suptitle("The thesis timed the building of the weights; the sum itself costs the same for every rule")
    _legend(figure, panels[1], 4)
    return figure


def accuracy(records: list[Record]) -> Any:
    """Fig. 5-5 again: error against time under three clocks."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.6), sharey=True)
    generic = select(records, problem="fresnel_generic")
    groups = (
        ("weights built as published,\ninside the clock (the thesis)", PUBLISHED),
        ("weights built by basset,\ninside the clock", COLD),
        ("weights cached\n(mind the scale)", CACHED),
    )
    for axes, (title, clock) in zip(panels, groups, strict=True):
        for name in schemes(generic):
            _line(axes, select(generic, scheme=name, clock=clock), "seconds", "error_max", name)
        axes.set(title=title, xlabel="time per value, one core (s)", ylim=(5e-15, 60))
    low, high = panels[2].get_xlim()
    panels[2].set_xlim(low / 1.5, max(high, 20.0 * low))
    panels[0].set_ylabel("largest error over the second half of the path (s$^{-1/2}$)")
    figure.suptitle("Error against time: with the weights at hand, digits are almost free, and the high orders give the most")
    _legend(figure, panels[1], 6)
    return figure


def weight_errors(errors: list[Record]) -> Any:
    """Digits of the weights against the lag."""
    figure, axes = plt.subplots(figsize=(8.0, 5.2))
    colours = {1: ORANGE, 2: GREEN, 3: BLUE}
    for order, colour in colours.items():
        for builder, dash, marker in (("double", "-", "o"), ("extended", "--", "s")):
            rows = [r for r in errors if r["builder"] == builder and r["order"] == order and r["error"] > 0.0]
            label = f"published, error h$^{order + 1}$, {'double' if builder == 'double' else '80 bit'}"
            axes.loglog([r["lag"] for r in rows], [r["error"] for r in rows], dash, color=colour, marker=marker, markersize=4, label=label)
    worst: dict[int, float] = {}
    for r in errors:
        if r["builder"] == "ours":
            worst[r["lag"]] = max(worst.get(r["lag"], 0.0), r["error"])
    axes.loglog(list(worst), [max(e, 1e-18) for e in worst.values()], color=BLACK, marker="*", label="basset, double, worst of degrees 1 to 10")
    _slope(axes, 3e1, 1e-8, 4e2, 4, "j$^4$", "right")
    _slope(axes, 1e3, 2e-15, 1e5, 2, "j$^2$", "right")
    axes.axhline(1.0, color="#999999", linewidth=0.8)
    axes.annotate("no digit left", (11, 1.0), xytext=(0, 3), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel="lag j (steps)", ylabel="relative error of the weight", ylim=(1e-18, 1e12))
    axes.set_title("The published formulas lose all digits in double precision; nothing cancels in basset's")
    _legend(figure, axes, 3)
    return figure


def weight_times(building: list[Record]) -> Any:
    """Seconds to build n weights."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8))
    look = {
        "ours, p = 1": (ORANGE, "o", "-"),
        "ours, p = 3": (BLUE, "D", "-"),
        "ours, p = 8": ("#7A4FA3", "h", "-"),
        "thesis 5-7": (RED, "s", "--"),
        "published double, p = 1": (ORANGE, "x", ":"),
        "published double, p = 3": (BLUE, "+", ":"),
        "published quad, p = 3": (BLACK, "^", "--"),
    }
    for name, (colour, marker, dash) in look.items():
        rows = sorted((r for r in building if r["builder"] == name), key=lambda r: r["n"])
        label = name.replace("ours", "basset").replace("quad", "quad (mpmath, 34 digits)")
        axes.loglog([r["n"] for r in rows], [r["seconds"] for r in rows], dash, color=colour, marker=marker, label=label)
    _slope(axes, 2e4, 2e-5, 2e5, 1, "n", "right")
    axes.set(xlabel="number of weights", ylabel="time to build, one core (s)")
    axes.set_title("Exact weights are built in about a millisecond; quadruple precision is not needed")
    _legend(figure, axes, 3)
    return figure


def trajectory(records: list[Record], ratios: list[Record]) -> Any:
    """Every node: direct against FFT."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8))
    for scheme, colour, marker in (("Daitche(1)", ORANGE, "o"), ("Daitche(3)", BLUE, "D"), ("Daitche(8)", "#7A4FA3", "h")):
        for method, dash in (("direct", "--"), ("fft", "-")):
            rows = select(records, scheme=scheme, method=method)
            label = f"{scheme}, {'sum by sum' if method == 'direct' else 'basset.cumulate'}"
            axes.loglog([r["n"] for r in rows], [r["seconds"] for r in rows], dash, color=colour, marker=marker, label=label)
    rows = select(ratios, order=1)
    axes.loglog([r["n"] for r in rows], [r["fftconvolve"] for r in rows], ":", color=BLACK, marker="x", label="scipy.signal.fftconvolve")
    _slope(axes, 3e3, 1e-1, 1.5e4, 2, "N$^2$", "right")
    _slope(axes, 8e3, 1.5e-4, 4e4, 1.08, "N log N", "right")
    axes.set(xlabel="steps N", ylabel="time for all nodes, weights cached, one core (s)")
    axes.set_title("A long path costs about one FFT convolution, whatever the order")
    _legend(figure, axes, 3)
    return figure


def kernels(data: Record) -> Any:
    """Fig. 5-1 again."""
    figure, axes = plt.subplots(figsize=(7.0, 4.6))
    ends = {"Basset": (BLACK, "-", 0), "Mei–Adrian": (BLUE, "--", -7), "Dorgan–Loth": (RED, "-.", 7)}
    for name, (colour, dash, lift) in ends.items():
        axes.loglog(data["lags"], data["values"][name], dash, color=colour, linewidth=2)
        axes.annotate(name, (data["lags"][-1], data["values"][name][-1]), xytext=(4, lift), textcoords="offset points", color=colour, va="center")
    _slope(axes, 1e-4, 2e1, 2e-3, -0.5, "s$^{-1/2}$", "right")
    _slope(axes, 4, 1e-2, 40, -2, "s$^{-2}$", "right")
    axes.set(xlabel="lag s = t − τ (s); recent times on the left", ylabel="K(s) (s$^{-1/2}$)", xlim=(1e-4, 1.2e3))
    axes.set_title(f"At Re = {data['reynolds']:g} the memory fades as s$^{{-2}}$, not as s$^{{-1/2}}$")
    return figure


def window(data: Record) -> Any:
    """Fig. 5-2 again: the kernel split at the window."""
    figure, axes = plt.subplots(figsize=(7.0, 4.2))
    lags, values, edge = np.array(data["lags"]), np.array(data["values"]["Basset"]), data["window"]
    axes.loglog(lags, values, color=BLACK, linewidth=1.2)
    inside = lags <= edge
    axes.loglog(lags[inside][::4], values[inside][::4], "o", color=ORANGE, markersize=7)
    axes.loglog(lags[~inside], values[~inside], "--", color=BLUE, linewidth=4, alpha=0.7)
    axes.axvline(edge, color="#999999", linestyle=":")
    axes.annotate(f"window {edge:g} s", (edge, 1.3e2), xytext=(4, 0), textcoords="offset points", color="#666666")
    axes.annotate("K$_{win}$: summed sample by sample", (1.3e-4, 2.0), color="#9A6A00")
    axes.annotate("K$_{tail}$: approximated cheaply\nor dropped", (1.0, 2.5), color=BLUE)
    axes.set(xlabel="lag s = t − τ (s); recent times on the left", ylabel="K(s) (s$^{-1/2}$)", ylim=(5e-2, 2e2))
    axes.set_title("A window sums the recent past and approximates or drops the rest")
    return figure


def peers(records: list[Record], target: float, ratio: str) -> Any:
    """Error against time on the trajectory, every package."""
    figure, axes = plt.subplots(figsize=(8.0, 5.4))
    look = ((ORANGE, "o"), (GREEN, "^"), (BLUE, "D"), (RED, "s"), (SKY, "P"), (PINK, "X"), (YELLOW, "v"), ("#777777", "+"))
    paths = [r for r in records if not r["single"]]
    names = sorted(dict.fromkeys(r["peer"] for r in paths), key=lambda name: not name.startswith("basset"))
    for name, (colour, marker) in zip(names, ((BLACK, "*"), *look), strict=False):
        rows = [r for r in paths if r["peer"] == name and r["seconds"] is not None and r["error"]]
        width = 2.2 if name.startswith("basset") else 1.3
        axes.loglog([r["seconds"] for r in rows], [r["error"] for r in rows], color=colour, marker=marker, markersize=8, linewidth=width, label=name)
    axes.axhline(target, color="#999999", linestyle=":")
    axes.annotate(f"{short(target)}", (axes.get_xlim()[1], target), xytext=(-2, 3), textcoords="offset points", ha="right", color="#666666", fontsize=9)
    axes.set(xlabel="time for every node, callables included, one core (s)", ylabel="largest error over the whole path (s$^{-1/2}$)")
    axes.set_title(f"Every node to {short(target)}: basset, weights cached, is {ratio} faster than the fastest peer")
    _legend(figure, axes, 2)
    return figure
