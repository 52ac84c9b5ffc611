"""The figures of the memory page, from the records alone."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY
from basset._look import legend as _legend
from basset._look import slope as _slope
from bench.suites.exponentials import law
from reports.analysis import Record, select, short

SCHEMES = {  # name: colour, marker, short name
    "full history": (BLACK, "o", "full history"),
    "window, no tail": (GREY, "x", "window, no tail"),
    "Hinsberg, published tail": (RED, "s", "window, published tail"),
    "window, tail 1e-6": (ORANGE, "^", "window, fitted tail 1e-6"),
    "Exponential(3, 1e-3)": (SKY, "v", "Exponential(3, 1e-3)"),
    "Exponential(3, 1e-6)": (BLUE, "D", "Exponential(3, 1e-6)"),
    "Exponential(3, 1e-9)": (GREEN, "P", "Exponential(3, 1e-9)"),
}
RATIO_COLOURS = (ORANGE, RED, GREEN, BLUE, BLACK)
SETS = {"van Hinsberg": (RED, "s"), "Casas I2t": (ORANGE, "o"), "Casas I1": (PINK, "v"), "fitted": (BLUE, "D")}
EVALUATIONS = {
    "mean slip": (GREY, "x", "kernel of the mean slip"),
    "slip at τ": (ORANGE, "o", "slip at τ"),
}


def _scheme_lines(axes: Any, records: list[Record], value: str, names: list[str]) -> None:
    for name in names:
        colour, marker, label = SCHEMES[name]
        rows = [r for r in select(records, scheme=name) if r[value] is not None]
        axes.loglog([r["n"] for r in rows], [r[value] for r in rows], color=colour, marker=marker, label=label)


def costs(records: list[Record]) -> Any:
    """Time per step and bytes per grain against the steps remembered."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.8))
    names = [name for name in SCHEMES if name not in ("Exponential(3, 1e-3)", "Exponential(3, 1e-9)")]
    _scheme_lines(panels[0], records, "nanoseconds", names)
    _scheme_lines(panels[1], records, "bytes", names)
    panels[0].set(title="time", xlabel="steps remembered n", ylabel="time per step and component, one core (ns)", ylim=(10, 1e5))
    panels[1].set(title="memory", xlabel="steps remembered n", ylabel="state per grain of three components (bytes)", ylim=(2e2, 1e7))
    _slope(panels[0], 2.5e3, 5e3, 1.2e4, 1, "n", "right")
    _slope(panels[1], 2.5e3, 3.5e5, 1.2e4, 1, "n", "right")
    figure.suptitle("A sum of exponentials remembers a million steps for the price of a few hundred bytes and tens of nanoseconds")
    _legend(figure, panels[0], 3)
    return figure


def errors(records: list[Record]) -> Any:
    """Error against the whole history of the same degree, against the steps."""
    figure, axes = plt.subplots(figsize=(8.0, 5.2))
    _scheme_lines(axes, records, "error", [name for name in SCHEMES if name != "full history"])
    axes.set(xlabel="steps remembered n", ylabel="largest difference from the full history / largest |H|", ylim=(1e-11, 3))
    for exponent in (3, 6, 9):
        axes.axhline(10.0**-exponent, color="#bbbbbb", linestyle=":")
        axes.annotate(f"promised 1e-{exponent}", (1e3, 10.0**-exponent), xytext=(0, 3), textcoords="offset points", color="#666666", fontsize=9)
    axes.set_title("A promised error is kept at any length; a published tail loses digits as the past grows")
    _legend(figure, axes, 3)
    return figure


def convergence(records: list[Record]) -> Any:
    """Order kept down to the promised floor."""
    figure, axes = plt.subplots(figsize=(8.0, 5.6))
    dashes = {"full": ("-", None), "1e-3": (":", "v"), "1e-6": ("--", "D"), "1e-9": ("-.", "P")}
    for order, colour in ((1, ORANGE), (3, BLUE), (6, PINK)):
        for promise, (dash, marker) in dashes.items():
            rows = select(records, order=order, promise=promise)
            label = f"p = {order}, {'full history' if promise == 'full' else 'promised ' + promise}"
            width = 2.4 if promise == "full" else 1.1
            axes.loglog([r["h"] for r in rows], [r["error"] for r in rows], dash, color=colour, marker=marker, markersize=4, linewidth=width, label=label)
    _slope(axes, 4e-2, 4e-5, 1e-2, 2, "h$^2$")
    _slope(axes, 1.2e-2, 5e-10, 4.5e-3, 4, "h$^4$")
    _slope(axes, 2.2e-1, 2e-8, 4.5e-1, 7, "h$^7$", "right")
    axes.set(xlabel="step h (s)", ylabel="largest error over the second half of the path / largest |H|", ylim=(1e-15, 1))
    axes.set_title("A stream converges as the full history does, down to the error it promised (g = cos τ)")
    _legend(figure, axes, 3)
    return figure


def terms(records: list[Record]) -> Any:
    """Terms against the promised error."""
    figure, axes = plt.subplots(figsize=(8.0, 5.4))
    ratios = sorted({r["ratio"] for r in records})
    reach = np.geomspace(1e-12, 1e-2, 50)
    for ratio, colour in zip(ratios, RATIO_COLOURS, strict=True):
        rows = select(records, ratio=ratio)
        axes.loglog([r["n"] for r in rows], [r["error"] for r in rows], "o", color=colour, label=f"far/near = {_power(ratio)}")
        axes.loglog([law(error, ratio) for error in reach], reach, color=colour, linewidth=1.0)
        plain = sorted(rows, key=lambda r: r["trapezoid"])
        axes.loglog([r["trapezoid"] for r in plain], [r["trapezoid_error"] for r in plain], "--", color=colour, linewidth=1.0)
    axes.annotate("fitted (points) and the law\n2.7 exp(−π² n / ln 4R) (lines)", (3.15, 2e-11), color="#444444", fontsize=9)
    axes.annotate("plain trapezoid\n(dashed)", (160, 1e-6), color="#444444", fontsize=9)
    axes.set(xlabel="terms n", ylabel="largest relative error of the sum", xlim=(3, 400), xticks=[3, 5, 10, 20, 50, 100, 200])
    axes.get_xaxis().set_major_formatter(lambda value, _: f"{value:g}")
    axes.minorticks_off()
    axes.set_title("The fitted sums lie on the theoretical limit, far below the plain trapezoid")
    _legend(figure, axes, 5)
    return figure


def _power(ratio: float) -> str:
    mantissa, exponent = f"{ratio:.0e}".split("e")
    return ("" if mantissa == "1" else f"{mantissa}·") + f"10$^{{{int(exponent)}}}$"


def published(records: list[Record], curves: Record, used: float) -> Any:
    """The published sets beside the fitted sums."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.8))
    for name, (colour, marker) in SETS.items():
        rows = [r for r in select(records, set=name) if r["n"] <= 14]
        label = "fitted" if name == "fitted" else name
        panels[0].semilogy([r["n"] for r in rows], [r["error"] for r in rows], color=colour, marker=marker, label=label)
        values = np.maximum(np.array(curves["values"][name]), 1e-8)
        shown = np.array(curves["lags"]) <= (used * 30.0 if name == "fitted" else np.inf)
        panels[1].loglog(np.array(curves["lags"])[shown], values[shown], color=colour, linewidth=1.1)
    reach = np.geomspace(1e-8, 1e-1, 20)
    panels[0].semilogy([law(error, used) for error in reach], reach, color="#999999", linestyle=":")
    panels[0].annotate("limit law", (9.5, 1.2e-5), color="#666666", fontsize=9, ha="right", va="top")
    panels[0].set(title="largest error on window … 1000 × window", xlabel="terms", ylabel="relative error of the sum", ylim=(1e-7, 3), xlim=(0.5, 14.5))
    panels[1].axvline(used, color="#999999", linestyle=":")
    panels[1].annotate("fitted up to here", (used, 2e-7), xytext=(4, 0), textcoords="offset points", color="#666666", fontsize=9)
    panels[1].set(title="ten terms", xlabel="lag / window", ylabel="relative error of the sum", ylim=(1e-7, 3))
    best = min(r["error"] for r in records if r["set"] != "fitted")
    own = next(r["error"] for r in records if r["set"] == "fitted" and r["n"] == 10)
    figure.suptitle(f"Over three decades of lag the best published set is good to {short(best)}, ten fitted terms to {short(own)}")
    _legend(figure, panels[0], 4)
    return figure


def floors(records: list[Record]) -> Any:
    """Force error against the window."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8))
    for name, (colour, marker) in SETS.items():
        rows = sorted((r for r in records if r["set"] == name), key=lambda r: r["window"])
        label = "ten terms fitted to the range used" if name == "fitted" else f"{name}, ten terms"
        axes.loglog([r["window"] for r in rows], [r["error_max"] for r in rows], color=colour, marker=marker, label=label)
    axes.set(xlabel="window (s)", ylabel="largest error of H over the second half (s$^{-1/2}$)", ylim=(3e-8, 1e-2))
    axes.set_xticks([0.1, 0.2, 0.5, 1, 2, 3], ["0.1", "0.2", "0.5", "1", "2", "3"])
    axes.minorticks_off()
    axes.set_title("What no step size removes: ten terms each, g = cos τ")
    _legend(figure, axes, 2)
    return figure


def windows(cosine: Record, saltation: Record) -> Any:
    """Error against the share of the full history's time."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 5.0), sharey=True)
    panels[0].set_ylabel("largest error over the second half / largest |H|")
    groups = ((cosine, "seconds", "g = cos τ, no jumps"), (saltation, "seconds_steps", "hopping grain (time without the jumps)"))
    for axes, (data, clock, title) in zip(panels, groups, strict=True):
        rows = [r for r in data["records"] if r["order"] == 3]
        full = next(r for r in rows if r["scheme"] == "full")
        for scheme, colour, marker, label in (
            ("window", GREY, "x", "window, rest dropped"),
            ("tail", ORANGE, "^", "window, fitted tail 1e-6"),
            ("exponential", BLUE, "D", "Exponential(3, 1e-6)"),
            ("full", BLACK, "o", "full history"),
        ):
            found = sorted((r for r in rows if r["scheme"] == scheme), key=lambda r: r["share"])
            axes.loglog([100.0 * r[clock] / full[clock] for r in found], [r["error"] for r in found], color=colour, marker=marker, label=label)
            for r in found if scheme == "window" else ():
                if r["share"] in (0.01, 0.1, 0.5):
                    place = (100.0 * r[clock] / full[clock], r["error"])
                    axes.annotate(
                        f"window {100 * r['share']:g} %",
                        place,
                        xytext=(0, -15 if r["share"] == 0.1 else 6),
                        textcoords="offset points",
                        color=GREY,
                        fontsize=8,
                        ha="center",
                    )
        axes.axvspan(10.0, 30.0, color="#eeeeee", zorder=0)
        axes.annotate("the thesis's\n70–90 % saved", (17.3, 3e-4), ha="center", color="#666666", fontsize=9)
        axes.set(title=title, xlabel="time of all steps (% of the full history's)", ylim=(1e-12, 4))
        axes.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axes.minorticks_off()
    _slope(panels[0], 1.0, 1.5e-2, 8.0, -0.5, "window$^{-1/2}$", "right")
    figure.suptitle("Dropping what lies beyond a window buys time with the first digit; a fitted tail costs hardly more and keeps six")
    _legend(figure, panels[0], 4)
    return figure


def varying(data: Record, base_amplitude: float = 0.5, base_frequency: float = 2.0) -> Any:
    """Differences between the ways to let the kernel follow the slip."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.8), sharey=True)
    for axes, key, other, fixed in ((panels[0], "amplitude", "frequency", base_frequency), (panels[1], "frequency", "amplitude", base_amplitude)):
        rows = sorted((r for r in data["records"] if r[other] == fixed), key=lambda r: r[key])
        x = [r[key] * (data["time_scale"] if key == "frequency" else 1.0) for r in rows]
        for name, (colour, marker, label) in EVALUATIONS.items():
            axes.loglog(x, [r["differences"][name] for r in rows], color=colour, marker=marker, label=f"{label} – slip at t")
    panels[0].set(
        title=f"ω = {base_frequency:g} s$^{{-1}}$", xlabel="amplitude a of U = U$_0$(1 + a sin ωt)", ylabel="largest difference / largest |H|", ylim=(1e-3, 2)
    )
    panels[0].set_xticks([0.1, 0.25, 0.5, 0.9], ["0.1", "0.25", "0.5", "0.9"])
    panels[0].minorticks_off()
    _slope(panels[0], 0.12, 1.8e-3, 0.3, 1, "a", "right")
    panels[1].set(title=f"a = {base_amplitude:g}", xlabel="frequency ω × the kernel's time scale C$^{-2/3}$")
    figure.suptitle("Whose slip the kernel takes: percents of H while the slip varies by half, half of H where it nearly stops")
    _legend(figure, panels[0], 4)
    return figure
