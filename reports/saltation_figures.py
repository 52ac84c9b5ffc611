"""The figures of the page on saltation, from the records alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import legend as _legend
from reports.analysis import Record
from saltation.plots import run as plots

QUANTITIES = {"height": "mean rise H (d)", "length": "mean length L (d)", "velocity": "mean velocity ū (u*)"}
SYMBOLS = {"height": "H", "length": "L", "velocity": "ū"}
SIZES = (73, 250)
REGRESSIONS = {"lee_hsu_1994": ("Lee–Hsu 1994", "--"), "sklar_dietrich_2004": ("Sklar–Dietrich 2004", "-."), "van_rijn_1984": ("van Rijn 1984", ":")}
READINGS = {  # shown beside the shipped scene: name in the records, label, colour, marker
    "swamee, reject": ("swamee, reject", ORANGE, "s"),
    "yalin, clip": ("yalin, clip", RED, "^"),
    "swamee, clip, k_s = 2 d": ("swamee, clip, k$_s$ = 2 d", GREEN, "v"),
    "Mei–Adrian: restarted": ("Mei–Adrian's kernel, memory restarted", PURPLE, "D"),
}
STAGE = "transport stage T"


def _ticks(axes: Any, values: Sequence[float]) -> None:
    """A logarithmic axis with labels at these places."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xticks([value for value in values if low <= value <= high], minor=False)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xticks([], minor=True)


def _errors(axes: Any, x: Sequence[float], rows: Sequence[Record], **look: Any) -> None:
    """Means with two standard errors; runs without jumps are left out."""
    shown = [(at, row) for at, row in zip(x, rows, strict=True) if row["mean"] is not None]
    axes.errorbar([at for at, _ in shown], [row["mean"] for _, row in shown], yerr=[2.0 * (row["se"] or 0.0) for _, row in shown], capsize=2, **look)


def path(found: Record) -> Any:
    """Side view and plan of the first jumps of the shipped scene."""
    figure = plt.figure(figsize=(9.0, 5.2))
    arrays = {name: np.array(found[name]) for name in "xyz"}
    hits = [np.array(found["impacts"][name]) for name in "xzy"]
    plots.draw_path(figure, arrays["x"], arrays["z"], arrays["y"], hits, "x (d)")
    figure.suptitle("The first eight jumps of the shipped sand: side view and plan (mind the stretched heights)")
    return figure


def memory(found: Record, title: Callable[[Record], str]) -> Any:
    """Mean height by memory, the prototype's beside it."""
    names = [name for name in dict.fromkeys(r["name"] for r in found["records"]) if "Dorgan" not in name and "50" not in name and "20" not in name]
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.8), sharey=True)
    for case, (axes, about) in enumerate(zip(panels, found["cases"], strict=True)):
        rows = {r["name"]: r for r in found["records"] if r["case"] == case}
        for place, name in enumerate(reversed(names)):
            row = rows[name]
            colour = GREY if name == "no history" else RED if "ignored" in name or "wiped" in name else BLUE
            label = {GREY: "no history", RED: "the slip's jump is ignored", BLUE: "remembered or restarted"}[colour]
            axes.errorbar(row["height"]["mean"], place, xerr=2.0 * row["height"]["se"], fmt="o", color=colour, capsize=2, label=label)
            if row["prototype"] is not None:
                axes.plot(row["prototype"], place, "D", markersize=9, markerfacecolor="none", color=BLACK, label="prototype")
        axes.axvline(rows["no history"]["height"]["mean"], color="#999999", linestyle=":")
        axes.set(title=title(about).replace("R_p", "R$_p$"), xlabel="mean rise H (d), two standard errors")
        _ticks(axes, (0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20))
    panels[0].set_yticks(range(len(names)), list(reversed(names)))
    figure.suptitle("Remembering the rebound shortens the jumps, ignoring it lengthens them; no measured rebound decides yet")
    handles, labels = panels[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=4)
    return figure


def envelope(found: Record) -> Any:
    """H, L and ū against T: regressions, the shipped scene, the spread by memories, some readings. Thesis figs 3-7 and 3-9."""
    figure, panels = plt.subplots(3, 2, figsize=(11.0, 10.0), sharex="col")
    for column, reynolds in enumerate(SIZES):
        lines = [r for r in found["published"] if r["particle_reynolds"] == reynolds]
        stages = [r["stage"] for r in lines]
        rows = [r for r in found["records"] if r["particle_reynolds"] == reynolds]
        shipped = sorted((r for r in rows if r["name"] == found["shipped"]), key=lambda r: r["stage"])
        for place, (quantity, label) in enumerate(QUANTITIES.items()):
            axes = panels[place, column]
            edges = np.array([r["envelope"][quantity] for r in lines])
            axes.fill_between(stages, edges[:, 0], edges[:, 1], color="#d9d9d9", label="regressions: envelope")
            for name, (text, dash) in REGRESSIONS.items():
                axes.plot(stages, [r["regressions"][name][place] for r in lines], dash, color="#666666", linewidth=1.0, label=text)
            model = [
                [r[quantity]["mean"] for r in rows if r["stage"] == stage and (r["kind"] == "memory" or r["name"] == found["shipped"])] for stage in stages
            ]
            axes.fill_between(stages, [min(v) for v in model], [max(v) for v in model], color=SKY, alpha=0.35, label="spread by memories and kernels")
            for name, (text, colour, marker) in READINGS.items():
                own = sorted((r for r in rows if r["name"] == name), key=lambda r: r["stage"])
                axes.plot(stages, [r[quantity]["mean"] for r in own], color=colour, marker=marker, linewidth=1.0, label=text)
            _errors(
                axes, stages, [r[quantity] for r in shipped], color=BLUE, marker="o", linewidth=2.0, label="shipped: swamee, clip, rebound remembered (2 s.e.)"
            )
            axes.set_ylabel(label)
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.tick_params(axis="y", which="minor", labelsize=7)
        panels[0, column].set_title(f"R$_p$ = {reynolds}")
        panels[2, column].set_xlabel(STAGE)
    figure.suptitle("Memories alone spread the model as widely as the regressions differ: only trends and the envelope can be tested")
    _legend(figure, panels[0, 0], 3)
    return figure


def effects(records: Sequence[Record], scenes: Mapping[str, str]) -> Any:
    """Every lever as a ratio to the base, H, L and ū."""
    levers = list(dict.fromkeys((r["group"], r["name"]) for r in records if r["group"] != "base"))
    titles = {"off": "switched off", "printed": "as printed", "choice": "chosen otherwise"}
    looks = dict(zip(scenes, ((BLUE, "o"), (ORANGE, "s"), (GREY, "^")), strict=True))
    figure, panels = plt.subplots(1, 3, figsize=(13.0, 8.6), sharey=True)
    rows: list[tuple[str, str] | None] = []
    for group in titles:
        rows += [None, *(pair for pair in levers if pair[0] == group)]
    rows = rows[::-1]
    for axes, (quantity, symbol) in zip(panels, SYMBOLS.items(), strict=True):
        for scene, (colour, marker) in looks.items():
            found = {r["name"]: r for r in records if r["scene"] == scene}
            points = [(place, found[pair[1]]) for place, pair in enumerate(rows) if pair is not None and found[pair[1]]["status"] == "finished"]
            base = found["base"][quantity]["mean"]
            ratio = [row[quantity]["mean"] / base for _, row in points]
            shift = 0.2 * (1 - list(looks).index(scene))
            axes.plot(
                ratio, [place + shift for place, _ in points], marker, color=colour, linestyle="none", markersize=6, label=scenes[scene].replace("R_p", "R$_p$")
            )
        axes.axvline(1.0, color="#999999", linewidth=0.8)
        axes.set(xlabel=f"{symbol} / {symbol} of the shipped scene")
        axes.set_ylim(-0.7, len(rows) - 0.3)
        _ticks(axes, (0.05, 0.1, 0.2, 0.5, 1, 2, 5) if quantity != "velocity" else (0.3, 0.5, 0.7, 1, 1.5))
    names = [f"— {titles[group]} —" for group in titles][::-1]
    labels = [names.pop(0) if pair is None else pair[1] for pair in rows]
    panels[0].set_yticks(range(len(rows)), labels)
    figure.suptitle("Magnus and what spins the grain, history and contact decide a jump; the form of drag and of added mass hardly matter to sand")
    _legend(figure, panels[0], 3)
    return figure


SINGLE = {
    "all effects": (BLACK, "-"),
    "no history": (RED, "-"),
    "takeoff slip forgotten": (RED, "--"),
    "no Magnus": (ORANGE, "-"),
    "no lift": (GREEN, "-"),
    "no added mass": (PINK, "-"),
    "weight and drag alone": (BLUE, "-"),
}


def single(records: Sequence[Record]) -> Any:
    """Single jumps of thesis figs 3-5 and 3-6, effects off one by one."""
    figure, panels = plt.subplots(2, 2, figsize=(11.0, 7.6))
    for axes, found in zip(panels.ravel(), records, strict=True):
        for name, (colour, dash) in SINGLE.items():
            row = found["paths"][name]
            axes.plot(row["x"], row["z"], dash, color=colour, linewidth=2.2 if name == "all effects" else 1.3, label=name)
        takeoff, grain = found["takeoff"], "sand" if found["figure"] == "3-6" else "gravel"
        text = f"u = {takeoff['u']:.3g}, w = {takeoff['w']:.3g} u*, ω = {takeoff['spin']:.3g} u*/d"
        axes.set_title(
            f"{grain}, d = {1e3 * found['diameter']:.3g} mm, u* = {found['shear_velocity']:.3g} m/s (fig. {found['figure']})\ntakeoff {text}", fontsize=10
        )
        axes.set(xlabel="x (d)", ylabel="rise (d)", xlim=(0.0, None), ylim=(0.0, None))
    figure.suptitle("A single jump: what sand does depends on whether its takeoff is remembered; gravel's on the spin it starts with")
    _legend(figure, panels[0, 0], 4)
    return figure


def angles(found: Record) -> Any:
    """Spin, takeoff angle and deviation against T, and the distribution of the deviation. Thesis figs 3-11 to 3-13."""
    figure, grid = plt.subplots(2, 2, figsize=(11.0, 7.6))
    panels = grid.ravel()
    looks = {73: (BLUE, "o"), 250: (ORANGE, "s")}
    for reynolds, (colour, marker) in looks.items():
        rows = sorted((r for r in found["records"] if r["name"] == found["shipped"] and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        printed = sorted((r for r in found["records"] if r["kind"] == "printed" and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        stages = [r["stage"] for r in rows]
        for axes, key in ((panels[0], "spin"), (panels[1], "takeoff_angle"), (panels[2], "deviation")):
            _errors(axes, stages, [r[key] for r in rows], color=colour, marker=marker, label=f"R$_p$ = {reynolds}")
        _errors(panels[0], stages, [r["spin"] for r in printed], color=colour, marker="x", linestyle=":", label=f"R$_p$ = {reynolds}, torque as printed")
        low, high = np.array([[r["takeoff_angle"]["mean"] - r["takeoff_angle"]["sd"], r["takeoff_angle"]["mean"] + r["takeoff_angle"]["sd"]] for r in rows]).T
        panels[1].fill_between(stages, low, high, color=colour, alpha=0.15, linewidth=0.0)
    stages = np.linspace(1.5, 2.9, 2)
    panels[0].plot(stages, 5.11 - 1.13 * stages, "--", color=BLACK, label="(3-6), measured at R$_p$ 60 to 90")
    panels[0].set(title="Spin falls with T as in the measured regression\nif the torque is divided by ρ$_s$/ρ", xlabel=STAGE, ylabel="mean spin ω$_y$ (u*/d)")
    panels[0].legend(loc="upper right")
    panels[1].set(
        title="Takeoff angles hardly change with T\n(band: standard deviation of single jumps)", xlabel=STAGE, ylabel="takeoff angle (degrees)", ylim=(0, 90)
    )
    panels[1].legend(loc="lower right")
    panels[2].set(title="The deviation in plan falls with T", xlabel=STAGE, ylabel="mean absolute deviation (degrees)", ylim=(0, None))
    panels[2].legend(loc="lower left")
    values = next(r["deviations"] for r in found["records"] if "deviations" in r)
    panels[3].plot(values, (np.arange(len(values)) + 0.5) / len(values), color=BLUE)
    panels[3].set(
        title="Its distribution at R$_p$ 73, T 1.87", xlabel="absolute deviation (degrees)", ylabel="share of jumps below", ylim=(0, 1), xlim=(0, None)
    )
    return figure


def heights(found: Mapping[str, Record]) -> Any:
    """Distributions of H for Runs A, B, C and G."""
    figure, axes = plt.subplots(figsize=(8.0, 4.8))
    names = {"A": "A: R1, prescribed spin, 2-D", "B": "B: R2, plane ± 4° uniform", "C": "C: R3, plane ± 4° normal", "G": "G: R7, touching spheres"}
    for (run, label), (colour, dash) in zip(names.items(), ((ORANGE, "-"), (RED, "-"), (PINK, "--"), (BLUE, "-")), strict=True):
        values = np.maximum(found[run]["heights"], 1e-6)
        axes.plot(values, (np.arange(len(values)) + 0.5) / len(values), dash, color=colour, label=label, linewidth=1.8)
    axes.axvline(0.1, color="#999999", linestyle=":")
    axes.annotate("H < 0.1 d: creeping", (0.1, 0.03), xytext=(-4, 0), textcoords="offset points", ha="right", color="#666666", fontsize=9)
    axes.set(xscale="log", xlabel="rise of a jump H (d)", ylabel="share of jumps below", xlim=(1e-4, 3.0), ylim=(0, 1))
    axes.set_title("Set 2, R$_p$ 73, T 1.87: planes tilted by ± 4° (B, C) do not lift the grain; touching spheres do")
    axes.legend(loc="center left")
    return figure


def forces(phase: Mapping[str, Sequence[float]], along: pd.DataFrame, up: pd.DataFrame) -> Any:
    """The mean jump and the shares of the forces over its phase. Thesis fig. 3-14."""
    figure = plt.figure(figsize=(8.0, 7.4))
    first, last = along["history"].iloc[0], abs(along["history"].iloc[-1])
    title = (
        f"Drag drives the jump along (up to {along['drag'].max():.0f} %), weight rules it up (up to {up['weight'].abs().max():.0f} %);\n"
        f"history counts at both ends (along {first:.0f} % after takeoff, {last:.0f} % against the motion before impact)"
    )
    plots.draw_budget(figure, pd.DataFrame(phase), title)
    return figure


def quartiles(found: Record) -> Any:
    """Quartiles of each force's share over all jumps and phases. Thesis fig. 3-15."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.2), sharey=True)
    for axes, axis, where in ((panels[0], "x", "along the stream"), (panels[1], "z", "normal to the bed")):
        shown = {name: row for name, row in found[f"quartiles_{axis}"].items() if row[-1] > 0.0}
        stats = [
            {"whislo": r[0], "q1": r[1], "med": r[2], "q3": r[3], "whishi": r[4], "label": plots.FORCES[name][2].replace(" ", "\n")}
            for name, r in shown.items()
        ]
        drawn = axes.bxp(stats, showfliers=False, patch_artist=True, medianprops={"color": BLACK})
        for box, name in zip(drawn["boxes"], shown, strict=True):
            box.set(facecolor=plots.FORCES[name][0], alpha=0.5)
        axes.set_title(where)
    panels[0].set_ylabel("share of the forces, absolute (%)")
    figure.suptitle("Drag leads along, weight up; history comes second in both\n(over all jumps and phases; boxes: quartiles, whiskers: extremes)")
    return figure


def magnus(records: Sequence[Record]) -> Any:
    """Share of the Magnus force up over the phase, for prescribed and computed spin. Thesis fig. 3-16."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.4), sharey=True)
    colours = (BLUE, GREEN, YELLOW, ORANGE, RED)
    for axes, law, title in (
        (panels[0], "prescribed", "spin prescribed by (3-6): fades, then turns over"),
        (panels[1], "yamamoto", "spin computed by (3-4): much the same at every T"),
    ):
        rows = sorted((r for r in records if r["law"] == law), key=lambda r: r["stage"])
        for row, colour in zip(rows, colours, strict=True):
            axes.plot(row["phase"], row["share"], color=colour, label=f"T = {row['stage']:g}")
        axes.axhline(0.0, color="#999999", linewidth=0.8)
        axes.set(title=title, xlabel="phase of the jump (0 takeoff, 1 impact)", xlim=(0, 1))
    panels[0].set_ylabel("Magnus force's share up (%)")
    _legend(figure, panels[0], 5)
    return figure


def saturation(records: Sequence[Record]) -> Any:
    """Run A's saturation with T."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 4.4))
    looks = ((ORANGE, "o"), (GREY, "x"), (BLUE, "D"))
    for axes, (quantity, label) in zip(panels, QUANTITIES.items(), strict=True):
        for name, (colour, marker) in zip(dict.fromkeys(r["name"] for r in records), looks, strict=True):
            rows = sorted((r for r in records if r["name"] == name), key=lambda r: r["stage"])
            _errors(axes, [r["stage"] for r in rows], [r[quantity] for r in rows], color=colour, marker=marker, label=name)
        axes.set(xlabel=STAGE, ylabel=label)
    figure.suptitle("Run A stops growing with T because the prescribed spin turns Magnus over; with computed spin nothing saturates")
    _legend(figure, panels[0], 3)
    return figure


def diffusion(found: Record) -> Any:
    """Second moments against the lag. Thesis fig. 3-17."""
    figure, axes = plt.subplots(figsize=(8.0, 5.0))
    lags = np.array(found["lag"])
    higher = max("xy", key=lambda name: float(np.log(found[name]).mean()))
    for name, (label, colour, marker) in plots.SPREAD.items():
        ranges = [(r["low"], r["high"]) for r in found["exponents"] if r["axis"] == name]
        plots.draw_moments(axes, lags, np.array(found[name]), label, colour, marker, ranges, name == higher)
    axes.axvline(found["duration"], color="#999999", linestyle=":")
    axes.annotate("mean duration of a jump", (found["duration"], axes.get_ylim()[0]), xytext=(4, 6), textcoords="offset points", color="#666666", fontsize=9)
    axes.set(xlabel="time after a takeoff (d/u*)", ylabel="second moment of the displacement (d²)")
    axes.set_title("Nearly ballistic within a jump, about normal along the stream and faster across after many")
    axes.legend(loc="upper left")
    return figure


def bed_load(found: Record) -> Any:
    """The bed-load rate that the impacts imply."""
    figure, axes = plt.subplots(figsize=(7.0, 4.6))
    for reynolds, colour, marker in ((73, BLUE, "o"), (250, ORANGE, "s")):
        rows = sorted((r for r in found["records"] if r["name"] == found["shipped"] and r["particle_reynolds"] == reynolds), key=lambda r: r["stage"])
        stages = [r["stage"] for r in rows]
        axes.plot(stages, [r["bed_load"]["rate"] for r in rows], color=colour, marker=marker, label=f"this model, R$_p$ = {reynolds}")
        axes.plot(stages, [r["bed_load"]["meyer_peter_mueller"] for r in rows], "--", color=colour, label=f"Meyer-Peter–Müller, R$_p$ = {reynolds}")
        axes.plot(stages, [r["bed_load"]["wong_parker"] for r in rows], ":", color=colour, label=f"Wong–Parker, R$_p$ = {reynolds}")
    axes.set(yscale="log", xlabel=STAGE, ylabel="bed load q* = q/√(R g d³)")
    axes.set_title("Bagnold's balance with these impacts carries several times too much")
    _legend(figure, axes, 2)
    return figure


def ranks(models: Sequence[Record]) -> Any:
    """The best models against the regressions. Thesis fig. 3-10."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.4))
    sets = {1: GREY, 2: BLUE, 3: ORANGE, 4: RED}
    scores: list[tuple[str, Callable[[Record], Any]]] = [
        (f"error index, R$_p$ = {reynolds}", lambda r, key=reynolds: r[key]["error_index"]) for reynolds in SIZES
    ]
    scores.append(("mean rank", lambda r: r["mean_rank"]))
    for axes, (label, score) in zip(panels, scores, strict=True):
        best = sorted((r for r in models if score(r) is not None), key=score)[:15]
        axes.barh(range(len(best)), [score(r) for r in best], color=[sets[int(r["model"][1])] for r in best])
        axes.set_yticks(range(len(best)), [r["model"] for r in best])
        axes.invert_yaxis()
        axes.set_axisbelow(True)
        axes.set(xlabel=label)
        axes.grid(visible=False, axis="y")
    handles = [plt.Rectangle((0, 0), 1, 1, color=colour) for colour in sets.values()]
    figure.legend(handles, [f"Set {number}" for number in sets], loc="outside lower center", ncols=4)
    figure.suptitle("The best 15 of 32 models against the mean of the regressions: other models win at each grain size")
    return figure


def overlap(found: Record) -> Any:
    """How an overlap area is made, on two models of ours. Thesis fig. 3-8."""
    figure, axes = plt.subplots(figsize=(7.0, 4.4))
    edges = []
    for (name, rows), colour, hatch in zip(found["bands"].items(), (BROWN, BLUE), ("//", None), strict=True):
        band = sorted((r for r in rows if r["variable"] == "height"), key=lambda r: r["T"])
        stages = np.array([r["T"] for r in band])
        mean, sd = np.array([r["mean"] for r in band]), np.array([r["sd"] for r in band])
        edges.append((mean - sd, mean + sd))
        label = f"Run {name[0]}, Set {name[1]}" + (" (in the place of measurements)" if hatch else "")
        axes.fill_between(stages, mean - sd, mean + sd, facecolor="none" if hatch else colour, edgecolor=colour, hatch=hatch, alpha=0.5, label=label)
        axes.plot(stages, mean, color=colour)
    low, high = np.maximum(edges[0][0], edges[1][0]), np.minimum(edges[0][1], edges[1][1])
    axes.fill_between(stages, low, np.maximum(high, low), color=BLACK, alpha=0.35, label="common area", linewidth=0.0)
    axes.set(xlabel=STAGE, ylabel="rise H (d), mean ± standard deviation", ylim=(0, None))
    axes.set_title(f"An overlap area: {found['areas']['height']:.0f} % of the first band (two of our own models, no measurement)")
    _legend(figure, axes, 3)
    return figure
