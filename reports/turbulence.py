"""The page reports/turbulence.md: what a turbulent stream, and one that feels its grains, do to jumps, bed load and spreading."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, listed, of, signed, span
from saltation.study.turbulence import LAWS, RANGES, VARIANTS

LOOKS = {"plain": (GREY, "o"), "turbulence": (BLUE, "^"), "coupling": (ORANGE, "s"), "both": (RED, "D")}
JUMPS = {"height": "H (d)", "length": "L (d)", "velocity": "ū (u*)"}
MORE = {"spin": "spin (u*/d)", "takeoff_angle": "takeoff (°)", "incidence_angle": "incidence (°)", "abs_deviation_angle": "across (°)"}
LAW_NAMES = {"valid": "laws by range", "thesis": "thesis's laws"}
THESIS_GAMMA = {"x": 0.7, "y": 0.6}  # along and across, with encounters
POINTS = 400  # of a path that are drawn
NEAR = 2.0  # a rate within this factor is as Wong and Parker have it


def stages_of(data: Record, laws: str) -> list[float]:
    """All T of a set of laws."""
    return list(dict.fromkeys(row["stage"] for row in of(data["changes"], laws=laws)))


def cells(data: Record, laws: str, size: float, variant: str, quantity: str) -> list[Record]:
    """One quantity over T."""
    return of(data["changes"], laws=laws, particle_reynolds=size, variant=variant, quantity=quantity)


def labels(data: Record) -> list[tuple[str, float]]:
    """Laws and R_p of all runs."""
    found = {(row["laws"], row["particle_reynolds"]) for row in data["rows"]}
    return sorted(found, key=lambda item: (LAWS.index(item[0]), item[1]))


def shares(data: Record, variant: str, quantity: str = "height") -> list[float]:
    """Relative changes of means, all laws, R_p and T."""
    rows = of(data["changes"], variant=variant, quantity=quantity)
    return [row["change"] / (row["mean"] - row["change"]) for row in rows if row["change"] is not None]


def changed(row: Record) -> str:
    """A mean with its change from the plain run and the interval of that; without seeds no interval."""
    if row["mean"] is None:
        return "–"
    if row["variant"] == "plain" or row["change"] is None:
        return f"{row['mean']:.3g}"
    around = f" ± {row['interval']:.1g}" if row["interval"] is not None else ""
    size = abs(row["change"])
    digits = max(0, 1 - math.floor(math.log10(size))) if size else 0
    return f"{row['mean']:.3g} ({signed(row['change'], digits)}{around})"


def table_of(data: Record, laws: str, names: dict[str, str]) -> str:
    """Means and changes of some quantities."""
    lines = []
    for size in dict.fromkeys(size for own, size in labels(data) if own == laws):
        for stage in stages_of(data, laws):
            for variant in VARIANTS:
                own = {row["quantity"]: row for row in of(data["changes"], laws=laws, particle_reynolds=size, stage=stage, variant=variant)}
                status = own["height"]["status"]
                lines.append([f"{size:g}, {stage:g}", variant, *(changed(own[name]) for name in names), "" if status == "finished" else status])
    return table(["R_p, T", "stream", *names.values(), ""], lines)


# Bed load


def rates(data: Record) -> list[Record]:
    """Factors of the bed load to Wong and Parker's by laws, R_p and T: bagnold, before, after, both; None where that has none."""
    found = []
    for laws, size in labels(data):
        for stage in stages_of(data, laws):
            own = {row["variant"]: row for row in of(data["rows"], laws=laws, particle_reynolds=size, stage=stage)}
            reference = own["plain"]["wong_parker"]
            means = {(row["variant"], row["quantity"]): row["mean"] for row in of(data["changes"], laws=laws, particle_reynolds=size, stage=stage)}
            named = {
                "bagnold": ("plain", "bagnold"), "before": ("coupling", "before"), "after": ("coupling", "after"), "both": ("both", "after"),
            }  # fmt: skip
            row = {name: means[key] / reference if reference and means[key] is not None else None for name, key in named.items()}
            row["threshold"] = own["plain"]["own_threshold"] / reference if reference else None
            carried = means["coupling", "carried"]
            found.append({"laws": laws, "particle_reynolds": size, "stage": stage, "carried": carried, **row})
    return found


def within(rows: Iterable[Record], name: str, by: str = "") -> tuple[int, int]:
    """(within the factor, of so many) of the rates that have a reference; `by`: over this factor."""
    values = [row[name] / (row[by] if by else 1.0) for row in rows if row[name] is not None]
    return sum(1.0 / NEAR <= value <= NEAR for value in values), len(values)


def table_of_rates(data: Record) -> str:
    """All factors."""
    lines = []
    for row in rates(data):
        numbers = [factor(row[name]) if row[name] is not None else "–" for name in ("bagnold", "before", "after", "both", "threshold")]
        lines.append([LAW_NAMES[row["laws"]], f"{row['particle_reynolds']:g}, {row['stage']:g}", *numbers])
    return table(["laws", "R_p, T", "Bagnold", "before", "coupling", "both", "due to the threshold"], lines)


def draw_rates(data: Record) -> Any:
    """Bed load against T."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.4), sharey=True)
    laws = LAWS[0]
    for axis, size in zip(axes, dict.fromkeys(size for _, size in labels(data)), strict=True):
        rows = of(data["rows"], laws=laws, particle_reynolds=size, variant="plain", seed=1)
        stages = [row["stage"] for row in rows]
        for name, style, title in (
            ("wong_parker", "-", "Wong & Parker"),
            ("meyer_peter_mueller", "--", "Meyer-Peter & Müller"),
            ("own_threshold", ":", "Wong & Parker from τ*c on"),
        ):
            axis.plot(stages, [row[name] or np.nan for row in rows], style, color=BLACK, label=title)
        for variant, name, colour, mark, title in (
            ("coupling", "before", GREY, "o", "number of grains by Owen, before"), ("coupling", "after", ORANGE, "s", "after coupling"),
            ("both", "after", RED, "D", "after coupling, turbulent"), ("plain", "bagnold", BLUE, "x", "Bagnold's balance, plain"),
        ):  # fmt: skip
            own = cells(data, laws, size, variant, name)
            axis.plot([row["stage"] for row in own], [row["mean"] for row in own], mark, color=colour, mfc="none", label=title)
        axis.set(xlabel="T", title=f"R_p {size:g}", yscale="log")
        axis.locator_params(axis="x", nbins=4)
        axis.minorticks_off()
    axes[0].set_ylabel("q*")
    axes[1].legend(fontsize=8, loc="lower right")
    figure.suptitle("Bed load against T, before the stream feels its grains and after (laws by range)")
    return figure


# Jumps


def draw_jumps(data: Record) -> Any:
    """H, L and ū against T in all streams."""
    found = [(laws, size) for laws, size in labels(data) if laws == LAWS[0]]
    figure, axes = plt.subplots(len(found), 3, figsize=(10.0, 2.6 * len(found) + 0.8), squeeze=False)
    for line, (laws, size) in zip(axes, found, strict=True):
        for axis, (name, title) in zip(line, JUMPS.items(), strict=True):
            for variant, (colour, mark) in LOOKS.items():
                rows = cells(data, laws, size, variant, name)
                axis.errorbar([row["stage"] for row in rows], [row["mean"] for row in rows], [row["interval"] or 0.0 for row in rows],
                              fmt=mark, ls="-", color=colour, mfc="none", label=variant)  # fmt: skip
            axis.set(xlabel="T", ylabel=title, title=f"R_p {size:g}")
            axis.set_ylim(bottom=0.0)
            axis.locator_params(nbins=4)
    axes[0, 0].legend(fontsize=8)
    figure.suptitle("Mean jumps in four streams, laws by range (bars: 95 % intervals of the change from the plain one)")
    return figure


# Eddies


def draw_path(data: Record) -> Any:
    """Some jumps, and the stream that the grain sees."""
    whole = data["path"]["path"]
    path = {name: np.array(values[:: max(1, len(whole["time"]) // POINTS)]) for name, values in whole.items()}
    figure, axes = plt.subplots(3, 1, figsize=(10.0, 7.0), height_ratios=(1.2, 1.0, 1.0))
    axes[0].plot(path["x"], path["z"], color=BLACK, lw=1.0)
    few = slice(None, None, max(1, len(path["x"]) // 40))
    axes[0].quiver(path["x"][few], path["z"][few], path["eddy_x"][few], path["eddy_z"][few], color=BLUE, width=0.0015, scale=60.0)
    axes[0].set(xlabel="x (d)", ylabel="z (d)", title="the grain's path, and the fluctuation of the stream at the grain (arrows)")
    axes[1].plot(path["time"], path["mean"] + path["eddy_x"], color=BLUE, label="stream at the grain")
    axes[1].plot(path["time"], path["mean"], color=GREY, ls="--", label="its mean at that height")
    axes[1].plot(path["time"], path["u"], color=BLACK, label="grain")
    axes[2].plot(path["time"], path["eddy_z"], color=BLUE, label="stream at the grain")
    axes[2].plot(path["time"], path["w"], color=BLACK, label="grain")
    for axis in axes:
        axis.locator_params(nbins=5)
    for axis, title in zip(axes[1:], ("along (u*)", "up (u*)"), strict=True):
        axis.set(xlabel="time (d/u*)", ylabel=title)
        axis.legend(fontsize=8, ncols=3, loc="upper right")
    figure.suptitle("A grain of sand among its eddies")
    return figure


def draw_profiles(data: Record) -> Any:
    """Intensities by formula and as grains see them; the mean stream before and after."""
    figure, axes = plt.subplots(1, 3, figsize=(11.0, 4.6))
    formulas = data["formulas"]
    sand, highest = data["path"]["seen"]["rows"], min(data["fine"], key=lambda row: row["ratio"])
    for name, axis, colour in (("along", "x", BLUE), ("across", "y", GREEN), ("up", "z", RED)):
        axes[0].plot(formulas[name], formulas["z"], color=colour, label=name)
        axes[0].plot([row[axis] for row in sand], [row["height"] for row in sand], "o", color=colour, mfc="none")
        axes[1].plot(formulas[name], np.array(formulas["z"]) / formulas["depth"], color=colour)
        axes[1].plot([row[axis] for row in highest["rows"]], [row["height"] / highest["depth"] for row in highest["rows"]], "^", color=colour, mfc="none")
    axes[0].set(xlabel="rms (u*)", ylabel="z (d)", yscale="log", title="sand, near the bed")
    axes[0].set_ylim(0.4, 20.0)
    axes[0].minorticks_off()
    axes[1].set(xlabel="rms (u*)", ylabel="z/h", title=f"a lifted grain, w_s/u* {highest['ratio']:.2g}", ylim=(0.0, 1.0))
    axes[0].legend(fontsize=8)
    for variant, colour in (("coupling", ORANGE), ("both", RED)):
        stream = data["coupled"][variant]
        if variant == "coupling":
            axes[2].plot(stream["velocity_before"], stream["height"], color=GREY, ls="--", label="without grains")
        axes[2].plot(stream["velocity"], stream["height"], color=colour, label=variant)
    axes[2].set(xlabel="mean velocity (u*)", ylabel="z (d)", title="the mean stream", ylim=(0.0, 4.0))
    axes[2].legend(fontsize=8)
    for axis in axes[1:]:
        axis.locator_params(nbins=4)
    figure.suptitle("Intensities by formula (lines) and at the grain (marks); the mean stream before and after")
    return figure


# Spreading


def gamma(run: Record, axis: str, name: str) -> Record | None:
    """An exponent; None where a run is too short for it."""
    return next(iter(of(run["exponents"], axis=axis, range=name)), None)


def table_of_spreading(data: Record) -> str:
    """γ of three ranges."""
    lines = []
    for run in data["spread"]:
        for axis, title in (("x", "along"), ("y", "across")):
            texts = []
            for name in RANGES:
                found = gamma(run, axis, name)
                ends = f" ({found['interval'][0]:.2f} to {found['interval'][1]:.2f})" if found and found["interval"] else ""
                texts.append(f"{found['gamma']:.2f}{ends}" if found else "–")
            lines.append([run["name"], title, *texts, f"{run['resting']:.2g}"])
    heads = [f"{name}: {low:g} to {high:g} jumps" for name, (low, high) in RANGES.items()]
    return table(["stream", "", *heads, "at rest per moving grain"], lines)


def draw_spreading(data: Record) -> Any:
    """Second moments against the lag."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.6), sharex=True)
    for axis, name, title in zip(axes, "xy", ("along", "across"), strict=True):
        for run, colour in zip(data["spread"], (GREY, BLUE, GREEN), strict=True):
            lag = np.array(run["lag"]) / run["duration"]
            axis.loglog(lag, run[name], color=colour, label=run["name"])
        low, high = axis.get_ylim()
        for low_lag, high_lag in RANGES.values():
            axis.axvspan(low_lag, high_lag, color=GREY, alpha=0.08, lw=0)
        first = data["spread"][1]
        begin, moment = np.array(first["lag"])[[0, -1]] / first["duration"], first[name][0]
        axis.plot(begin, moment * (begin / begin[0]) ** 2, ":", color=BLACK, lw=0.8, label="γ = 1")
        last = first[name][-1]
        axis.plot(begin, last * (begin / begin[1]), "--", color=BLACK, lw=0.8, label="γ = ½")
        axis.set(xlabel="lag (mean jumps)", ylabel="second moment (d²)", title=title, ylim=(low, high))
        axis.minorticks_off()
    axes[0].legend(fontsize=8)
    figure.suptitle("Spreading of a grain of sand in three ranges of time (shaded)")
    return figure


# Suspension


def table_of_fine(data: Record) -> str:
    """Grains from coarse to fine."""
    lines = []
    for row in data["fine"]:
        high = f"{row['mean_above']:.3g} ({row['rouse_above']:.3g})" if row["mean_above"] is not None else f"– ({row['rouse_above']:.3g})"
        numbers = [
            f"{1e3 * row['diameter']:g}",
            f"{row['stage']:.3g}",
            f"{row['wall_units']:.3g}",
            f"{row['ratio']:.2g}",
            f"{row['rouse']:.2g}",
            f"{row['depth']:.3g}",
            f"{row['mean']:.3g}",
            f"{100.0 * row['above']:.2g} %",
        ]
        lines.append([*numbers, high, row["status"] if row["status"] != "finished" else ""])
    return table(["d (mm)", "T", "u* d/ν", "w_s/u*", "Rouse's P", "h (d)", "mean height (d)", "time above 10 d", "mean height there (Rouse's)", ""], lines)


def lifted(data: Record) -> tuple[list[Record], list[Record]]:
    """Of the grain in ever faster streams: (runs with more than one per cent of the time above 10 d, the others)."""
    runs = of(data["fine"], diameter=data["fine"][0]["diameter"])
    return [row for row in runs if row["above"] > 0.01], [row for row in runs if row["above"] <= 0.01]


def build(data: dict[str, Record]) -> str:
    """The page reports/turbulence.md."""
    own = data["turbulence"]
    found = rates(own)
    shaken = own["spread"][1]
    between = {axis: gamma(shaken, axis, "between") for axis in "xy"}
    resting = own["spread"][2]
    late = gamma(resting, "y", "long") or gamma(resting, "y", "between")
    high, low = lifted(own)
    unsettled = sum(row["status"] == "unsettled" for row in own["rows"])
    halves = {name: within(found, name) for name in ("before", "after", "both")}
    nowhere = [f"{row['particle_reynolds']:g} at T {row['stage']:g}" for row in found if row["after"] is None and row["laws"] == LAWS[0]]
    stages = {row["stage"] for row in own["rows"]}
    laws = listed([LAW_NAMES[name] for name in dict.fromkeys(name for name, _ in labels(own))])
    return fill(
        "turbulence.md",
        own=own,
        scope=f"sand and coarse sand, T {span(stages, '{:g}')}, {laws}",
        seeds=f"{own['seeds']} seed{'s' if own['seeds'] > 1 else ''}",
        shaken=percents(shares(own, "turbulence")),
        felt=percents(shares(own, "coupling")),
        both=percents(shares(own, "both")),
        before=spread_of(found, "before"),
        after=spread_of(found, "after"),
        together=spread_of(found, "both"),
        near=NEAR,
        near_before="{} of {}".format(*halves["before"]),
        near_after="{} of {}".format(*halves["after"]),
        near_both="{} of {}".format(*halves["both"]),
        near_threshold="{} of {}".format(*within(found, "after", "threshold")),
        thresholds=spread_of(found, "threshold"),
        nowhere=listed([f"R_p {each}" for each in nowhere], "nowhere here"),
        carried=span((100.0 * row["carried"] for row in found if row["carried"] is not None), "{:.0f}"),
        along=f"{between['x']['gamma']:.2f}" if between["x"] else "–",
        across=f"{between['y']['gamma']:.2f}" if between["y"] else "–",
        late=f"{late['gamma']:.2f}" if late else "–",
        thesis_along=THESIS_GAMMA["x"],
        thesis_across=THESIS_GAMMA["y"],
        lifts=f"{max(row['ratio'] for row in high):.2g}" if high else "none of these",
        stays=f"{min(row['ratio'] for row in low):.2g}" if low else "none of these",
        unsettled=unsettled,
        runs=len(own["rows"]),
        ended=sum(row["status"] not in ("finished", "unsettled") for row in own["rows"]),
        figures={
            "path": save(draw_path(own), "turbulence_path"),
            "profiles": save(draw_profiles(own), "turbulence_profiles"),
            "jumps": save(draw_jumps(own), "turbulence_jumps"),
            "rates": save(draw_rates(own), "turbulence_rates"),
            "spreading": save(draw_spreading(own), "turbulence_spreading"),
        },
        means="\n\n".join(f"{LAW_NAMES[laws].capitalize()}:\n\n{table_of(own, laws, JUMPS)}" for laws in dict.fromkeys(laws for laws, _ in labels(own))),
        more=table_of(own, LAWS[0], MORE),
        rates=table_of_rates(own),
        spreading=table_of_spreading(own),
        fine=table_of_fine(own),
        footer=footer({"turbulence": own}),
    )


def percents(values: Sequence[float]) -> str:
    """The range of relative changes."""
    return f"{signed(100.0 * min(values))} to {signed(100.0 * max(values))} %"


def spread_of(rows: Sequence[Record], name: str) -> str:
    """The range of a factor."""
    values = [row[name] for row in rows if row[name] is not None]
    return f"{factor(min(values))} to {factor(max(values))}" if values else "–"


PAGE = Page("turbulence", build, ("turbulence",))
