"""The page reports/memory.md: what the memory of the past costs in time, bytes and digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED, SKY
from basset._look import slope as _slope
from bench.suites.exponentials import law
from reports.site.page import Page, fill, finished, footer, save, table
from reports.words import Record, factor, grouped, seconds, select, short, storage

SUITES = ("exponentials", "stream", "window", "varying")
EVALUATIONS = ("slip at t", "slip at τ", "exponentials", "steady slip")  # of a slip that varies
FULL, HEADLINE = "full history", "Exponential(3, 1e-6)"
PUBLISHED = ("van Hinsberg", "Casas I2t", "Casas I1")
SAVINGS = (0.7, 0.9)  # the thesis's claim
CLOCKS = (("cosine", "seconds"), ("saltation", "seconds_steps"))  # signal, and the time that counts: of the steps, not of Python's jumps


def crossing(points: Sequence[tuple[float, float]], level: float) -> float | None:
    """Where y crosses `level`, between points (x, y) by rising x, on log axes; None if it does not."""
    for (x0, y0), (x1, y1) in pairwise(points):
        if min(y0, y1) <= level <= max(y0, y1) and y0 != y1:
            return math.exp(math.log(x0) + (math.log(x1) - math.log(x0)) * math.log(level / y0) / math.log(y1 / y0))
    return None


def interpolated(points: Sequence[tuple[float, float]], x: float) -> float | None:
    """The y at x, between points (x, y) by rising x, on log axes; None outside them."""
    return crossing([(y, at) for at, y in points], x)


def bought(data: Record, saving: float, clock: str, order: int = 3) -> dict[str, float | None]:
    """Which window saves that share of the full history's time, and the error it makes."""
    rows = [r for r in data["records"] if r["order"] == order]
    full = next(r for r in rows if r["scheme"] == "full")[clock]
    windows = sorted((r for r in rows if r["scheme"] == "window"), key=lambda r: r["share"])
    share = crossing([(r["share"], r[clock] / full) for r in windows], 1.0 - saving)
    return {"share": share, "error": None if share is None else interpolated([(r["share"], r["error"]) for r in windows], share)}


def scheme_table(stream: Record) -> str:
    """Every scheme at the longest run it was measured for."""
    many = {r["scheme"]: r for r in stream["many"]}
    rows = []
    for name in dict.fromkeys(r["scheme"] for r in stream["records"]):
        last = select(stream["records"], scheme=name)[-1]
        rows.append(
            [
                name,
                grouped(last["n"]),
                str(last["terms"] or "–"),
                seconds(1e-9 * last["nanoseconds"]),
                f"{seconds(1e-9 * many[name]['nanoseconds'])} ({grouped(many[name]['grains'])})",
                storage(last["bytes"]),
                "0" if last["error"] is None else short(last["error"], 1),
            ]
        )
    head = ["scheme", "steps n", "terms", "one grain, after n steps", "many grains, after 1 000 steps", "state per grain", "error"]
    return table(head, rows)


def terms_table(fitted: list[Record]) -> str:
    """Terms by range and promise: ours, the law, the trapezoid; the error measured."""
    rows = []
    for ratio in sorted({r["ratio"] for r in fitted}):
        cells = []
        for rtol in (1e-3, 1e-6, 1e-9, 1e-12):
            r = next(r for r in fitted if r["ratio"] == ratio and math.isclose(r["rtol"], rtol))
            cells.append(f"**{r['n']}** / {r['law']:.1f} / {r['trapezoid']} ({short(r['error'], 1)})")
        rows.append([short(ratio), *cells])
    return table(["far/near", *(f"promised {short(rtol)}" for rtol in (1e-3, 1e-6, 1e-9, 1e-12))], rows)


def finite_table(finite: list[Record]) -> str:
    """Terms for the finite-Reynolds kernels."""
    rows = []
    for near, far in dict.fromkeys((r["near"], r["far"]) for r in finite):
        cells = []
        for kernel in dict.fromkeys(r["kernel"] for r in finite):
            found = sorted((r for r in finite if (r["kernel"], r["near"], r["far"]) == (kernel, near, far)), key=lambda r: -r["rtol"])
            cells.append(" / ".join("–" if r["n"] is None else str(r["n"]) for r in found))
        basset = [r for r in finite if (r["near"], r["far"]) == (near, far)][:3]
        cells.append(" / ".join("–" if r["basset"] is None else str(r["basset"]) for r in sorted(basset, key=lambda r: -r["rtol"])))
        rows.append([f"{short(near)} … {short(far)}", *cells])
    return table(["x = C^(2/3) s", *dict.fromkeys(r["kernel"] for r in finite), "Basset"], rows)


def gains(floors: list[Record], name: str) -> dict[float, float]:
    """By window: how many times better the fitted tail is than that set."""
    return {
        r["window"]: r["error_max"] / next(f for f in floors if f["set"] == "fitted" and f["window"] == r["window"])["error_max"]
        for r in floors
        if r["set"] == name
    }


def floors_table(floors: list[Record]) -> str:
    """Force errors by window."""
    rows = []
    for window in sorted({r["window"] for r in floors}):
        found = {r["set"]: r["error_max"] for r in floors if r["window"] == window}
        rows.append(
            [f"{window:g} s", *(f"{short(found[name], 1)} ({factor(found[name] / found['fitted'])} ×)" for name in PUBLISHED), short(found["fitted"], 1)]
        )
    return table(["window", *PUBLISHED, "fitted"], rows)


def _window(data: Record, clock: str, scheme: str, key: str, sign: float) -> dict[str, float]:
    """Share of the run, time saved and error of the window with the least sign·key."""
    rows = [r for r in data["records"] if r["order"] == 3]
    full = next(r for r in rows if r["scheme"] == "full")[clock]
    best = min((r for r in rows if r["scheme"] == scheme), key=lambda r: sign * r[key])
    return {"share": best["share"], "saved": 1.0 - best[clock] / full, "error": best["error"]}


def quickest(data: Record, clock: str) -> dict[str, float]:
    """The cheapest window with a fitted tail."""
    return _window(data, clock, "tail", clock, 1.0)


def longest(data: Record, clock: str) -> dict[str, float]:
    """The longest window without tail."""
    return _window(data, clock, "window", "share", -1.0)


def savings_table(window: Record) -> str:
    """What a window saves and at which error."""
    rows = []
    for saving in SAVINGS:
        found = [bought(window[name], saving, clock) for name, clock in CLOCKS]
        rows.append([f"{saving:.0%} saved, rest dropped", *(f"{f['share']:.0%} of the run: error {f['error']:.0%}" if f["error"] else "–" for f in found)])
    largest = [longest(window[name], clock) for name, clock in CLOCKS]
    rows.append(["longest measured, rest dropped", *(f"{f['share']:.0%} of the run: {f['saved']:.0%} saved, error {f['error']:.0%}" for f in largest)])
    tails = [quickest(window[name], clock) for name, clock in CLOCKS]
    rows.append(["fitted tail", *(f"{f['share']:.1%} of the run: {f['saved']:.1%} saved, error {short(f['error'], 1)}" for f in tails)])
    return table(["window", "g = cos τ", "hopping grain"], rows)


def jump_costs(saltation: Record) -> str:
    """Seconds of one jump from Python, by scheme."""
    parts = []
    for scheme, label in (("exponential", HEADLINE), ("window", "windows without tail"), ("tail", "windows with one"), ("full", FULL)):
        each = [1e9 * (r["seconds"] - r["seconds_steps"]) / saltation["hops"] for r in saltation["records"] if r["scheme"] == scheme and r["order"] == 3]
        low, high = seconds(1e-9 * max(min(each), 0.0)), seconds(1e-9 * max(each))
        parts.append(f"{label} {low}" + (f" to {high}" if len(each) > 1 else ""))
    return ", ".join(parts)


def varying_table(varying: Record) -> str:
    """What following the slip costs."""
    return table(
        ["evaluation", "time per step and component", "state per component"],
        [[r["evaluation"], seconds(1e-9 * r["nanoseconds"]), storage(r["bytes"])] for r in varying["costs"] if r["evaluation"] in EVALUATIONS],
    )


def stopping_table(varying: Record) -> str:
    """What happens where the slip passes through zero."""
    rows = []
    for r in varying["stopping"]:
        rows.append([f"{r['amplitude']:g}", f"{r['low']:g} U0", f"{r['outside']} of {r['n']}", f"{r['differences']['slip at τ']:.0%}"])
    return table(["amplitude a", "smallest slip allowed", "slips replaced by it", "τ – t"], rows)


def above_full(records: list[Record]) -> list[float]:
    """By how much every stream's error exceeds that of the full history with the same step, in units of its promise."""
    full = {(r["order"], r["n"]): r["error"] for r in records if r["promise"] == "full"}
    return [(r["error"] - full[r["order"], r["n"]]) / float(r["promise"]) for r in records if r["promise"] != "full"]


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    head, window, stream = data["stream"]["headline"], data["window"], data["stream"]
    published = [r for r in stream["records"] if r["scheme"] == "Hinsberg, published tail"][-1]
    saved = {saving: bought(window["cosine"], saving, "seconds") for saving in SAVINGS}
    hops = {saving: bought(window["saltation"], saving, "seconds_steps") for saving in SAVINGS}
    errors = [f["error"] for f in (*saved.values(), *hops.values()) if f["error"]]
    tail = quickest(window["cosine"], "seconds")
    better = [gain for name in PUBLISHED for gain in gains(data["exponentials"]["floors"], name).values()]
    return {
        "tail": tail,
        "head": head,
        "one": seconds(1e-9 * head["one"]),
        "race": factor(head["direct"] / head["stream"]),
        "direct_n": grouped(head["direct_n"]),
        "low": f"{min(errors):.0%}",
        "high": f"{max(errors):.0%}",
        "better_least": factor(min(better)),
        "better_most": factor(max(better)),
        "published": published,
    }


def memory(data: dict[str, Record]) -> str:
    """The page reports/memory.md."""
    sums, stream, window, varying = (data[name] for name in SUITES)
    head, second = stream["headline"], stream["second"]
    base = next(r for r in varying["records"] if (r["amplitude"], r["frequency"]) == (0.5, 2.0))
    refused = next((r["refused"] for r in sums["finite"] if r["refused"]), "rtol must be at least …")
    return fill(
        "memory.md",
        sums=sums,
        base=base,
        **opening(data),
        step=stream["step"],
        window=stream["window"],
        figure_costs=save(draw_costs(stream["records"]), "memory_costs"),
        schemes=scheme_table(stream),
        direct=seconds(1e-9 * head["direct"]),
        dot=seconds(1e-9 * head["dot"]),
        stream_step=seconds(1e-9 * head["stream"]),
        race_dot=factor(head["dot"] / head["stream"]),
        calls=table(["call", "time"], [[f"`{name}`" if " " not in name else name, seconds(value)] for name, value in stream["calls"].items()]),
        second=f"{second['total']:.2f} s",
        second_parts=", ".join(f"{name} {second[name]:.2f} s" for name in ("import", "plan", "run")),
        figure_errors=save(draw_errors(stream["records"]), "memory_errors"),
        figure_convergence=save(draw_convergence(stream["convergence"]), "memory_order"),
        kept=f"{max(above_full(stream['convergence'])):.2f}",
        figure_terms=save(draw_terms(sums["fitted"]), "sum_terms"),
        terms=terms_table(sums["fitted"]),
        figure_published=save(draw_published(sums["published"], sums["curves"], sums["used"]), "sum_published"),
        figure_floors=save(draw_floors(sums["floors"]), "sum_floors"),
        floors=floors_table(sums["floors"]),
        figure_windows=save(draw_windows(window["cosine"], window["saltation"]), "windows"),
        savings=savings_table(window),
        hops=window["saltation"]["hops"],
        hop_steps=window["saltation"]["steps"],
        relaxation=window["saltation"]["relaxation"],
        jumps=jump_costs(window["saltation"]),
        figure_varying=save(draw_varying(varying), "slip_varying"),
        slip=f"{100 * varying['slip']:g}",
        diameter=f"{1000 * varying['diameter']:g}",
        time_scale=f"{varying['time_scale']:.2g}",
        base_tau=f"{base['differences']['slip at τ']:.0%}",
        base_mean=f"{base['differences']['mean slip']:.0%}",
        varying=varying_table(varying),
        stopping=stopping_table(varying),
        finite=finite_table(sums["finite"]),
        refused=refused,
        footer=footer({name: data[name] for name in SUITES}),
    )


# Figures, from the records alone

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
COMPARED = {
    "mean slip": (GREY, "x", "kernel of the mean slip"),
    "slip at τ": (ORANGE, "o", "slip at τ"),
}


def _scheme_lines(axes: Any, records: list[Record], value: str, names: list[str]) -> None:
    for name in names:
        colour, marker, label = SCHEMES[name]
        rows = [r for r in select(records, scheme=name) if r[value] is not None]
        axes.loglog([r["n"] for r in rows], [r[value] for r in rows], color=colour, marker=marker, label=label)


def draw_costs(records: list[Record]) -> Any:
    """Time per step and bytes per grain against the steps remembered."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.8))
    names = [name for name in SCHEMES if name not in ("Exponential(3, 1e-3)", "Exponential(3, 1e-9)")]
    _scheme_lines(panels[0], records, "nanoseconds", names)
    _scheme_lines(panels[1], records, "bytes", names)
    panels[0].set(title="time", xlabel="steps remembered n", ylabel="time per step and component, one core (ns)", ylim=(10, 1e5))
    panels[1].set(title="memory", xlabel="steps remembered n", ylabel="state per grain of three components (bytes)", ylim=(2e2, 1e7))
    _slope(panels[0], 2.5e3, 5e3, 1.2e4, 1, "n", "right")
    _slope(panels[1], 2.5e3, 3.5e5, 1.2e4, 1, "n", "right")
    return finished(figure, panels[0], 3, "A sum of exponentials remembers a million steps in a few hundred bytes and tens of nanoseconds per step")


def draw_errors(records: list[Record]) -> Any:
    """Error against the whole history of the same degree, against the steps."""
    figure, axes = plt.subplots(figsize=(8.0, 5.2))
    _scheme_lines(axes, records, "error", [name for name in SCHEMES if name != "full history"])
    axes.set(xlabel="steps remembered n", ylabel="largest difference from the full history / largest |H|", ylim=(1e-11, 3))
    for exponent in (3, 6, 9):
        axes.axhline(10.0**-exponent, color="#bbbbbb", linestyle=":")
        axes.annotate(f"promised 1e-{exponent}", (1e3, 10.0**-exponent), xytext=(0, 3), textcoords="offset points", color="#666666", fontsize=9)
    return finished(figure, axes, 3, "A promised error is kept at any length; a published tail loses digits as the past grows")


def draw_convergence(records: list[Record]) -> Any:
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
    return finished(figure, axes, 3, "A stream converges as the full history does, down to the error it promised (g = cos τ)")


def draw_terms(records: list[Record]) -> Any:
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
    return finished(figure, axes, 5, "The fitted sums lie on the theoretical limit, far below the plain trapezoid")


def _power(ratio: float) -> str:
    mantissa, exponent = f"{ratio:.0e}".split("e")
    return ("" if mantissa == "1" else f"{mantissa}·") + f"10$^{{{int(exponent)}}}$"


def draw_published(records: list[Record], curves: Record, used: float) -> Any:
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
    return finished(figure, panels[0], 4, f"Over three decades of lag the best published set is good to {short(best)}, ten fitted terms to {short(own)}")


def draw_floors(records: list[Record]) -> Any:
    """Force error against the window."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8))
    for name, (colour, marker) in SETS.items():
        rows = sorted((r for r in records if r["set"] == name), key=lambda r: r["window"])
        label = "ten terms fitted to the range used" if name == "fitted" else f"{name}, ten terms"
        axes.loglog([r["window"] for r in rows], [r["error_max"] for r in rows], color=colour, marker=marker, label=label)
    axes.set(xlabel="window (s)", ylabel="largest error of H over the second half (s$^{-1/2}$)", ylim=(3e-8, 1e-2))
    axes.set_xticks([0.1, 0.2, 0.5, 1, 2, 3], ["0.1", "0.2", "0.5", "1", "2", "3"])
    axes.minorticks_off()
    return finished(figure, axes, 2, "What no step size removes: ten terms each, g = cos τ")


def draw_windows(cosine: Record, saltation: Record) -> Any:
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
                    text, shift = f"window {100 * r['share']:g} %", (0, -15 if r["share"] == 0.1 else 6)
                    axes.annotate(text, place, xytext=shift, textcoords="offset points", color=GREY, fontsize=8, ha="center")
        axes.axvspan(10.0, 30.0, color="#eeeeee", zorder=0)
        axes.annotate("the thesis's\n70–90 % saved", (17.3, 3e-4), ha="center", color="#666666", fontsize=9)
        axes.set(title=title, xlabel="time of all steps (% of the full history's)", ylim=(1e-12, 4))
        axes.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axes.minorticks_off()
    _slope(panels[0], 1.0, 1.5e-2, 8.0, -0.5, "window$^{-1/2}$", "right")
    return finished(figure, panels[0], 4, "Dropping what lies beyond a window buys time with the first digit; a fitted tail costs hardly more and keeps six")


def draw_varying(data: Record, base_amplitude: float = 0.5, base_frequency: float = 2.0) -> Any:
    """Differences between the ways to let the kernel follow the slip."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.8), sharey=True)
    for axes, key, other, fixed in ((panels[0], "amplitude", "frequency", base_frequency), (panels[1], "frequency", "amplitude", base_amplitude)):
        rows = sorted((r for r in data["records"] if r[other] == fixed), key=lambda r: r[key])
        x = [r[key] * (data["time_scale"] if key == "frequency" else 1.0) for r in rows]
        for name, (colour, marker, label) in COMPARED.items():
            axes.loglog(x, [r["differences"][name] for r in rows], color=colour, marker=marker, label=f"{label} – slip at t")
    panels[0].set(
        title=f"ω = {base_frequency:g} s$^{{-1}}$", xlabel="amplitude a of U = U$_0$(1 + a sin ωt)", ylabel="largest difference / largest |H|", ylim=(1e-3, 2)
    )
    panels[0].set_xticks([0.1, 0.25, 0.5, 0.9], ["0.1", "0.25", "0.5", "0.9"])
    panels[0].minorticks_off()
    _slope(panels[0], 0.12, 1.8e-3, 0.3, 1, "a", "right")
    panels[1].set(title=f"a = {base_amplitude:g}", xlabel="frequency ω × the kernel's time scale C$^{-2/3}$")
    return finished(figure, panels[0], 4, "Slip at t or at τ: a few per cent of H while the slip varies by half, half of H where it nearly stops")


PAGE = Page("memory", memory, SUITES)
