"""The page reports/quadrature.md: every published way to compute the history integral, its error and its cost."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import slope as _slope
from reports.site.page import Page, fill, finished, footer, save, table
from reports.words import NEAR, Record, factor, grouped, reaches, seconds, select, short

SUITES = ("costs", "fresnel", "kernels", "peers", "trajectory", "weights")
TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-9, 1e-12)
CACHED, COLD, PUBLISHED = "cached", "cold", "cold, as published"
BASELINES = ("Euler–Maclaurin", "Brush", "semi-derivative")


def schemes(records: Iterable[Record]) -> list[str]:
    """Every scheme, in the order in which they were measured."""
    return list(dict.fromkeys(record["scheme"] for record in records))


def as_cheap(records: Sequence[Record], tolerance: float) -> list[Record]:
    """First records within the tolerance of the schemes that are as cheap as any; those that need fewest samples first."""
    found = [record for name in schemes(records) if (record := reaches(select(records, scheme=name), tolerance))]
    least = min((record["seconds"] for record in found), default=0.0)
    return sorted((record for record in found if record["seconds"] <= NEAR * least), key=lambda record: (record["n"], record["seconds"]))


@dataclass(frozen=True)
class Convergence:
    """How one rule converged: slopes are exponents of h."""

    scheme: str
    declared: float
    slope: float  # of the largest error over the second half of the path, the last doubling above 100 × the floor
    slope_end: float  # of the error at t = 50π, likewise
    floor: float | None  # the smallest error reached; None where the error still falls at the finest step
    best: float  # the smallest error reached


def _last_slope(points: list[tuple[float, float]], declared: float) -> tuple[float, float | None]:
    """(slope, floor) of (h, error) by falling h."""
    slopes = [math.log(a[1] / b[1]) / math.log(a[0] / b[0]) if a[1] > 0.0 and b[1] > 0.0 else 0.0 for a, b in pairwise(points)]
    floor = min(error for _, error in points) if slopes[-1] < declared / 2.0 else None
    usable = [i for i, (_, error) in enumerate(points[1:]) if floor is None or error > 100.0 * max(floor, 1e-16)]
    return slopes[usable[-1]], floor


def convergence(records: Sequence[Record]) -> list[Convergence]:
    """One row per rule, from the generic problem's path and the thesis's end time."""
    rows = []
    for name in schemes(records):
        path = [r for r in select(records, scheme=name, clock=CACHED, problem="fresnel_generic") if r["error_max"] is not None]
        end = [r for r in select(records, scheme=name, clock=CACHED, problem="fresnel") if r["error_end"] is not None]
        declared = path[0]["order"]
        slope, floor = _last_slope([(r["h"], r["error_max"]) for r in path], declared)
        slope_end, _ = _last_slope([(r["h"], r["error_end"]) for r in end], declared)
        rows.append(Convergence(name, declared, slope, slope_end, floor, min(r["error_max"] for r in path)))
    return rows


def cheapest(records: Sequence[Record], tolerance: float) -> str:
    """The cheapest rules for a tolerance, as a table cell."""
    found = as_cheap(records, tolerance)
    if not found:
        return f"none up to N = {grouped(max(r['n'] for r in records if r['seconds'] is not None))} in the time allowed"
    first, *others = found
    also = f"; as good: {', '.join(r['scheme'] for r in others)}" if others else ""
    return f"**{first['scheme']}**, N = {grouped(first['n'])}, {seconds(first['seconds'])}{also}"


def summary(generic: Sequence[Record]) -> str:
    """Which rule is cheapest for which error, timed in three ways."""
    groups: dict[str, Sequence[Record]] = {
        "weights cached": select(generic, clock=CACHED),
        "cold: weights built by basset": select(generic, clock=COLD),
        "cold: weights built as published": select(generic, clock=PUBLISHED),
    }
    rows = [[short(tolerance), *(cheapest(group, tolerance) for group in groups.values())] for tolerance in TOLERANCES]
    return table(["largest error", *groups], rows)


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    generic = select(data["fresnel"]["records"], problem="fresnel_generic")
    cached = select(generic, clock=CACHED)
    best = as_cheap(cached, 1e-9)[0]
    built = next(r for r in data["costs"]["building"] if r["scheme"] == "Daitche(8)")
    return {
        "best": best["scheme"],
        "best_n": grouped(best["n"]),
        "best_time": seconds(best["seconds"]),
        "same": short(data["weights"]["same"]["quad"]),
        "worst": short(max(r["error"] for r in data["weights"]["worst"])),
        "built_n": grouped(built["n"]),
        "built": seconds(built["seconds"]),
    }


def ratio_over(records: Sequence[Record], clock: str, above: str, below: str, smallest: int = 512) -> float:
    """Median over N of the ratio of two schemes' times."""
    pairs: list[float] = []
    for record in select(records, scheme=above, clock=clock):
        other = select(records, scheme=below, clock=clock, n=record["n"])
        if record["n"] >= smallest and other and record["seconds"] and other[0]["seconds"]:
            pairs.append(record["seconds"] / other[0]["seconds"])
    return statistics.median(pairs)


def build_shares(records: Sequence[Record]) -> str:
    """The share of building in the thesis's times, for each published rule at the largest N that was timed."""
    parts = []
    for name in ("Hinsberg", "Daitche(1)", "Daitche(2)", "Daitche(3)"):
        record = select(records, scheme=name, clock=PUBLISHED)[-1]
        cached = select(records, scheme=name, clock=CACHED, n=record["n"])[0]["seconds"]
        parts.append(f"{name} {1.0 - cached / record['seconds']:.1%} (N = {grouped(record['n'])})")
    return ", ".join(parts)


def published_winners(records: Sequence[Record]) -> str:
    """Which rule is the cheapest by the thesis's timing, for which error."""
    winners: dict[str, list[str]] = {}
    for tolerance in TOLERANCES:
        ranked = as_cheap(select(records, clock=PUBLISHED), tolerance)
        if ranked:
            winners.setdefault(ranked[0]["scheme"], []).append(short(tolerance))
    return "; ".join(f"{name} for {', '.join(found)}" for name, found in winners.items())


def lost_digits(errors: Sequence[Record]) -> str:
    """From which lag on the published formulas have no digit left."""
    parts = []
    for order in (2, 3):
        lags = [r["lag"] for r in errors if r["builder"] == "double" and r["order"] == order and r["error"] >= 1.0]
        if lags:
            parts.append(f"the formula for error h^{order + 1} has no digit left from j ≈ {grouped(float(f'{min(lags):.0e}'))} on")
    return ", ".join(parts)


def semi_derivative(generic: Sequence[Record]) -> dict[str, str]:
    """The thesis's 20 % re-measured, at equal N and at equal accuracy."""
    rivals = BASELINES[:2]
    largest = max(r["n"] for r in generic if r["seconds"] is not None)

    def shares(clock: str) -> str:
        return " and ".join(f"{ratio_over(generic, clock, 'semi-derivative', name):.2f} × the time of {name}" for name in rivals)

    def cell(name: str, tolerance: float) -> str:
        warm, cold = (reaches(select(generic, scheme=name, clock=clock), tolerance) for clock in (CACHED, PUBLISHED))
        return f"{grouped(warm['n'])}: {seconds(warm['seconds'])}, {seconds(cold['seconds'])}" if warm and cold else f"more than {grouped(largest)}"

    winners = []
    for tolerance in (1e-1, 1e-2, 1e-3):
        found = {name: reaches(select(generic, scheme=name, clock=CACHED), tolerance) for name in BASELINES}
        needed = {name: record["n"] for name, record in found.items() if record}
        least = [name for name in needed if needed[name] == min(needed.values())]
        winners.append(f"{' and '.join(least)} for {short(tolerance)}")
    rows = [[short(tolerance), *(cell(name, tolerance) for name in BASELINES)] for tolerance in (1e-1, 3e-2, 1e-2, 3e-3, 1e-3)]
    return {
        "semi_cached": shares(CACHED),
        "semi_cold": shares(PUBLISHED),
        "semi_winners": ", ".join(winners),
        "semi_table": table(["largest error", *BASELINES], rows, "  "),
    }


def differences(data: dict[str, Record], generic: Sequence[Record]) -> dict[str, str]:
    """The numbers of the section on the thesis."""
    same, weights = data["weights"]["same"], data["weights"]
    quad = select(generic, scheme="Daitche(3)", clock=PUBLISHED)[-1]
    ours = select(generic, scheme="Daitche(3)", clock=COLD, n=quad["n"])[0]
    worst = {f"worst_{p}": short(max(r["error"] for r in weights["worst"] if r["order"] == p)) for p in (1, 2, 3)}
    return worst | {
        "same_n": grouped(same["n"]),
        "same_quad": short(same["quad"]),
        "same_double": short(same["double"]),
        "same_cached": f"{ratio_over(generic, CACHED, 'Daitche(1)', 'Hinsberg'):.2f}",
        "same_cold": f"{ratio_over(generic, PUBLISHED, 'Daitche(1)', 'Hinsberg'):.2f}",
        "build_shares": build_shares(generic),
        "published_winners": published_winners(generic),
        "lost": lost_digits(weights["errors"]),
        "largest_lag": grouped(max(r["lag"] for r in weights["errors"])),
        "quad_n": grouped(quad["n"]),
        "quad_ours": seconds(ours["seconds"]),
        "quad_published": seconds(quad["seconds"]),
        "quad_digits": str(weights["quad_digits"]),
        "quad_limit": f"N = {grouped(quad['n'])}",
    }


def orders(records: Sequence[Record]) -> str:
    """Declared and measured orders, floors."""
    rows = []
    for row in convergence(records):
        floor = short(row.floor) if row.floor else f"not reached ({short(row.best)})"
        rows.append([row.scheme, f"{row.declared:g}", f"{row.slope:.2f}", f"{row.slope_end:.2f}", floor])
    return table(["rule", "declared", "largest error of the second half to 50π + 1", "t = 50π alone", "floor"], rows)


def weights_worst(worst: Sequence[Record]) -> str:
    """The worst weight by degree and region."""
    regions = list(dict.fromkeys(r["region"] for r in worst if not r["region"].startswith("oldest")))
    rows = []
    for order in sorted({r["order"] for r in worst}):
        found = {r["region"]: r["error"] for r in worst if r["order"] == order}
        oldest = next(error for region, error in found.items() if region.startswith("oldest"))
        rows.append([str(order), *(short(found[region], 1) for region in regions), short(oldest, 1)])
    return table(["degree p", *regions, "oldest 2p + 2"], rows)


def path_numbers(trajectory: Record) -> dict[str, str]:
    """The numbers of the section on paths."""
    lengths = sorted({r["n"] for r in trajectory["ratios"]})
    slowest = {n: max(r["cumulate"] / r["fftconvolve"] for r in trajectory["ratios"] if r["n"] == n) for n in lengths}
    early = select(trajectory["records"], scheme="Daitche(8)", method="fft", n=4096)[0]
    return {
        "ratios": ", ".join(f"{ratio:.1f} × at 2^{n.bit_length() - 1}" for n, ratio in slowest.items()),
        "early_n": grouped(early["n"]),
        "early_max": short(early["error_max"]),
        "early_path": short(early["error_path"]),
    }


def remarks(found: Record) -> str:
    """What the peers' own rows show beyond time."""
    parts = []
    single = [r for r in found["records"] if r["peer"].startswith("marge3d") and r["single"]]
    if single:
        best, last = min(single, key=lambda r: r["error"]), single[-1]
        parts.append(
            f"The cancellation of the published formulas is real: marge3d forms its coefficients of fourth error order in double precision, is good to "
            f"{short(best['error'])} at N = {grouped(best['n'])} and wrong by {last['error']:.2g} at N = {grouped(last['n'])}."
        )
    if any(r["peer"] == "differint GL" and r["status"] == "disagrees" for r in found["status"]):
        parts.append("differint's GL multiplies transforms that are not padded: the end of the path leaks into its start, on this problem by more than |H|/2.")
    return " ".join(parts)


def peers(data: dict[str, Record]) -> str:
    """Other packages, if they were measured."""
    if "peers" not in data:
        return "## Other packages\n\nNot measured here: `make report-full` installs and measures them."
    found = data["peers"]
    race = {r["contender"]: r["seconds"] for r in found["races"]["trajectory"]}
    own = {name: value for name, value in race.items() if name.startswith("basset")}
    fastest = min((value for name, value in race.items() if name not in own), default=float("nan"))
    status = [
        [
            r["peer"],
            str(r["steps"]),
            "–" if r["error"] is None else short(r["error"], 1),
            short(r["tolerance"]),
            f"{r['status']}: {r['reason']}" if r["reason"] else r["status"],
        ]
        for r in found["status"]
    ]
    races = [
        [title, r["contender"], grouped(r["n"]), seconds(r["seconds"]), short(r["error"])]
        for title, key in (("every node", "trajectory"), ("one value", "value"))
        for r in sorted(found["races"][key], key=lambda r: r["seconds"])
    ]
    target, ratio = short(found["target"]), factor(fastest / min(own.values()))
    return fill(
        "quadrature.md",
        "peers",
        nodes=found["nodes"],
        target=target,
        ratio=ratio,
        ratio_anew=factor(fastest / max(own.values())),
        figure=save(draw_peers(found["records"], found["target"], f"{ratio} times"), "peers"),
        races=table(["problem", "contender", "N", f"time to {target}", "error reached"], races),
        status=table(["peer", "steps", "error there", "asked", "outcome"], status),
        remarks=remarks(found),
        versions=", ".join(f"{name} {number}" for name, number in found["peer_versions"].items()),
    )


def quadrature(data: dict[str, Record]) -> str:
    """The page reports/quadrature.md."""
    records, weights, trajectory, kernel = data["fresnel"]["records"], data["weights"], data["trajectory"], data["kernels"]
    generic = select(records, problem="fresnel_generic")
    return fill(
        "quadrature.md",
        kernel=kernel,
        **opening(data),
        near=NEAR,
        cheapest=summary(generic),
        **differences(data, generic),
        **semi_derivative(generic),
        **path_numbers(trajectory),
        figure_accuracy=save(draw_accuracy(records), "accuracy_time"),
        figure_clocks=save(draw_clocks(records), "time_step"),
        figure_convergence=save(draw_convergence(records), "error_step"),
        orders=orders(records),
        figure_weight_errors=save(draw_weight_errors(weights["errors"]), "weights_error"),
        weights_worst=weights_worst(weights["worst"]),
        figure_weight_times=save(draw_weight_times(weights["building"]), "weights_time"),
        figure_trajectory=save(draw_trajectory(trajectory["records"], trajectory["ratios"]), "trajectory"),
        figure_kernels=save(draw_kernels(kernel), "kernels"),
        slip=f"{100 * kernel['slip']:g}",
        diameter=f"{1000 * kernel['diameter']:g}",
        figure_window=save(draw_window(kernel), "window"),
        peers=peers(data),
        footer=footer({name: data[name] for name in SUITES if name in data}),
    )


# Figures, from the records alone

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


def _line(axes: Any, records: list[Record], x: str, y: str, scheme: str, **more: Any) -> None:
    colour, marker = STYLE[scheme]
    shown = [r for r in records if r[x] is not None and r[y] is not None and r[y] > 0.0]
    # Hinsberg and Daitche(1) lie on top of each other where they are the same: the one is drawn hollow around the other
    hollow = {"markersize": 9, "markerfacecolor": "none"} if scheme == "Hinsberg" else {}
    axes.loglog([r[x] for r in shown], [r[y] for r in shown], color=colour, marker=marker, **({"label": scheme} | hollow | more))


def draw_convergence(records: list[Record]) -> Any:
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
    return finished(figure, axes, 4, "Every rule keeps its order; rounding, not cancellation, sets the floor")


def draw_clocks(records: list[Record]) -> Any:
    """Fig. 5-3 again: with the building of weights timed too, and without."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 5.2), sharey=True)
    thesis = select(records, problem="fresnel")
    for name in schemes(records):
        _line(panels[0], select(thesis, scheme=name, clock=PUBLISHED), "h", "seconds", name)
        _line(panels[1], select(thesis, scheme=name, clock=CACHED), "h", "seconds", name)
    panels[0].set(title="weights built as published, timed too", xlabel="step h (s)", ylabel="time per value, one core (s)")
    panels[1].set(title="weights cached", xlabel="step h (s)")
    _slope(panels[0], 0.08, 1.5e-4, 0.002, -1, "h$^{-1}$")
    return finished(figure, panels[1], 4, "The thesis timed the building of the weights; the sum itself costs the same for every rule")


def draw_accuracy(records: list[Record]) -> Any:
    """Fig. 5-5 again: error against time, timed in three ways."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.6), sharey=True)
    generic = select(records, problem="fresnel_generic")
    groups = (
        ("weights built as published,\ntimed too (the thesis)", PUBLISHED),
        ("weights built by basset,\ntimed too", COLD),
        ("weights cached\n(mind the scale)", CACHED),
    )
    for axes, (title, clock) in zip(panels, groups, strict=True):
        for name in schemes(generic):
            _line(axes, select(generic, scheme=name, clock=clock), "seconds", "error_max", name)
        axes.set(title=title, xlabel="time per value, one core (s)", ylim=(5e-15, 60))
    low, high = panels[2].get_xlim()
    panels[2].set_xlim(low / 1.5, max(high, 20.0 * low))
    panels[0].set_ylabel("largest error over the second half of the path (s$^{-1/2}$)")
    return finished(figure, panels[1], 6, "Error against time: with the weights cached, digits are almost free, and the high orders give the most")


def draw_weight_errors(errors: list[Record]) -> Any:
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
    return finished(figure, axes, 3, "The published formulas lose all digits in double precision; nothing cancels in basset's")


def draw_weight_times(building: list[Record]) -> Any:
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
    return finished(figure, axes, 3, "Exact weights are built in about a millisecond; quadruple precision is not needed")


def draw_trajectory(records: list[Record], ratios: list[Record]) -> Any:
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
    return finished(figure, axes, 3, "A long path costs about one FFT convolution, whatever the order")


def draw_kernels(data: Record) -> Any:
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


def draw_window(data: Record) -> Any:
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


def draw_peers(records: list[Record], target: float, ratio: str) -> Any:
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
    return finished(figure, axes, 2, f"Every node to {short(target)}: basset, weights cached, is {ratio} faster than the fastest peer")


PAGE = Page("quadrature", quadrature, SUITES)
