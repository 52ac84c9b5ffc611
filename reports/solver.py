"""The page reports/solver.md: what a digit of a coupled solution costs, and what a jump does to each scheme's order."""

from __future__ import annotations

import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import slope as _slope
from basset.solvers.stability import HELD_RATE, held_factor
from reports.site.page import Page, fill, finished, footer, save, table
from reports.words import Record, factor, grouped, of, seconds, select, short

SUITES = ("coupled", "stability")
OURS = "Collocation"
DIGITS = (1e-3, 1e-6, 1e-9)
TAILED = ("Windowed, fitted tail", "Exponential(3)", "Hinsberg, published tail")


def slope(rows: list[Record], key: str, floor: float) -> float | None:
    """Exponent of the step by least squares over the last three errors above the floor; all of them where events snap."""
    points = [(1.0 / r["n"], r[key]) for r in rows if r.get(key) and r[key] > floor]
    points = points if key == "error_first" else points[-3:]
    if len(points) < 2:
        return None
    h, error = np.log(np.array(points)).T
    return float(np.polyfit(h, error, 1)[0])


def order(data: Record, problem: str, scheme: str, key: str = "error_max") -> float | None:
    """Measured order of one scheme on one problem."""
    floor = 30.0 * data["tail"] if scheme in TAILED else 1e-12
    return slope(select(data["records"], problem=problem, scheme=scheme), key, floor)


def all_orders(data: Record) -> dict[str, dict[str, float | None]]:
    """By scheme: order before and after jumps, of the largest error."""
    kinds = {"smooth": ("smooth", "error_max"), "from rest": ("settling", "error_max"), "with slip": ("relaxing", "error_max")}
    kinds["with impacts"] = ("bouncing", "error_first")
    return {name: {kind: order(data, problem, name, key) for kind, (problem, key) in kinds.items()} for name in data["declared"]}


def two(*values: float | None) -> str:
    """Orders side by side."""
    return " / ".join("–" if value is None else f"{round(value, 2) + 0.0:.2f}" for value in values)


def span(values: list[float | None]) -> str:
    """The smallest and the largest of orders, once if they are the same."""
    known = [value for value in values if value is not None]
    return " to ".join(dict.fromkeys((two(min(known)), two(max(known)))))


def order_table(data: Record) -> str:
    """What a jump does to each scheme's order."""
    rows = []
    for name, declared in data["declared"].items():
        pairs = [two(*(order(data, problem, name, key) for key in ("error_max", "error_end"))) for problem in ("settling", "relaxing", "stream, slip 1")]
        cells = [two(order(data, problem, name)) for problem in ("smooth", "flat")]
        rows.append([name, f"{declared:g}", *cells, *pairs, two(order(data, "bouncing", name, "error_first"))])
    head = ["scheme", "declared", "smooth", "smooth, flat start", "from rest", "slip 1, relaxing", "slip 1, stream", "impacts"]
    return table(head, rows)


def cheapest(rows: list[Record], bound: float) -> Record | None:
    """The quickest record within the bound."""
    found = [r for r in rows if r["error_max"] is not None and r["error_max"] <= bound]
    return min(found, key=lambda r: r["seconds"]) if found else None


def fixed_rows(data: Record, problem: str) -> list[Record]:
    """Every fixed-step record of a problem."""
    return [r for r in data["records"] if r["problem"] == problem and r["scheme"] != OURS and r["seconds"] is not None]


def problems(data: Record) -> list[str]:
    """Every problem, in the order in which they were measured."""
    return list(dict.fromkeys(r["problem"] for r in data["records"]))


def digits_table(data: Record) -> str:
    """What a digit costs: collocation beside the cheapest fixed-step scheme."""
    rows = []
    for problem in problems(data):
        own = select(data["records"], problem=problem, scheme=OURS)
        others = fixed_rows(data, problem)
        errors = [r["error_max"] for r in others if r["error_max"] is not None]
        for bound in DIGITS:
            mine, theirs = cheapest(own, bound), cheapest(others, bound)
            cells = [f"{seconds(mine['seconds'])}, {mine['steps']} steps, {grouped(mine['nfev'])} calls" if mine else "not reached"]
            if theirs:
                cells += [f"{seconds(theirs['seconds'])}, {theirs['scheme']}, {grouped(theirs['n'])} steps"]
                cells += [f"{factor(theirs['seconds'] / mine['seconds'])} ×" if mine else "–"]
            else:
                most = grouped(max(r["n"] for r in others))
                cells += [f"not reached with {most} steps (best {short(min(errors), 1)})" if errors else f"{most} steps do not see every impact", "–"]
            rows.append([problem, short(bound), *cells])
    return table(["problem", "error", OURS, "cheapest fixed step", "ratio"], rows)


def kept(data: Record) -> dict[str, dict[float, float]]:
    """Error over rtol by problem and rtol."""
    found: dict[str, dict[float, float]] = {}
    for r in select(data["records"], scheme=OURS):
        found.setdefault(r["problem"], {})[r["rtol"]] = math.inf if r["error_max"] is None else r["error_max"] / r["rtol"]
    return {problem: found[problem] for problem in problems(data)}


def kept_table(data: Record) -> str:
    """Error over rtol."""
    found = kept(data)
    rtols = sorted(next(iter(found.values())), reverse=True)
    return table(["problem", *(short(rtol) for rtol in rtols)], [[name, *(f"{row[rtol]:.2g}" for rtol in rtols)] for name, row in found.items()])


def worst_kept(data: Record) -> tuple[float, str, float]:
    """The largest error over rtol, on which problem, at which rtol."""
    return max((ratio, name, rtol) for name, row in kept(data).items() for rtol, ratio in row.items())


def race(data: Record) -> dict[str, Any]:
    """The bouncing sphere: seconds of collocation, of the best fixed step as measured and extrapolated."""
    rows = data["race"]["records"]
    own = next(r for r in rows if r["scheme"] == OURS)
    fits: dict[str, dict[str, float]] = {}
    for name in dict.fromkeys(r["scheme"] for r in rows if r["scheme"] != OURS):
        found = select(rows, scheme=name)
        p = slope(found, "error_first", 0.0)
        last = found[-1]
        if p is None or p <= 0.0:
            continue
        kind = max(p, 1.0)  # events that snap are of first order at best: kinder to the fixed step than a lower measured order
        steps = last["n"] * max(last["error_first"] / data["race"]["target"], 1.0) ** (1.0 / kind)
        fits[name] = {"order": p, "steps": steps, "seconds": steps * min(r["seconds"] / r["n"] for r in found), "error": last["error_first"], "n": last["n"]}
        fits[name] |= {"measured": last["seconds"]}
    best = min(fits, key=lambda name: fits[name]["seconds"])
    second = [r for name in fits for r in select(rows, scheme=name) if r["seconds"] <= 1.5 and r.get("error_first")]
    least = min(second, key=lambda r: r["error_first"], default=None)
    longest = max(rows, key=lambda r: r["seconds"])
    return {"own": own, "fits": fits, "best": best, "ratio": fits[best]["seconds"] / own["seconds"], "second": least, "longest": longest}


def race_table(data: Record) -> str:
    """Measured and extrapolated cost of the bouncing sphere at the target."""
    found = race(data)
    own = found["own"]
    rows = [[OURS, f"{own['steps']} (rtol {short(own['rtol'])})", f"{short(own['error_max'], 1)} (all ten)", seconds(own["seconds"]), "–", "reached"]]
    for name, fit in found["fits"].items():
        cells = [name, grouped(fit["n"]), f"{short(fit['error'], 1)} (first {data['first']})", seconds(fit["measured"]), f"{fit['order']:.2f}"]
        rows.append([*cells, f"{short(fit['steps'], 1)} steps, {seconds(fit['seconds'])}"])
    return table(["scheme", "steps measured", "error of impact times (s)", "time", "order", f"extrapolated to {short(data['race']['target'])}"], rows)


def linear(data: Record, key: str = "seconds") -> tuple[float, float, float]:
    """(cost per impact, cost without, largest deviation from the line over the largest cost); seconds or calls of fun."""
    rows = data["by_impacts"]
    x, y = np.array([r["n"] for r in rows], dtype=float), np.array([r[key] for r in rows], dtype=float)
    rise, level = np.polyfit(x, y, 1)
    return float(rise), float(level), float(np.abs(y - level - rise * x).max() / y.max())


def impacts_table(data: Record) -> str:
    """Cost by number of impacts."""
    rows = [[str(r["n"]), str(r["steps"]), grouped(r["nfev"]), seconds(r["seconds"]), short(r["error_max"], 1)] for r in data["by_impacts"]]
    return table(["impacts", "steps", "calls of fun", "time", "largest error of impact times (s)"], rows)


def slip_ratios(data: Record) -> dict[float, tuple[float, float]]:
    """By rtol: (time, calls of fun) with slip over without."""
    found: dict[float, dict[int, Record]] = {}
    for r in data["slip_costs"]:
        found.setdefault(r["rtol"], {})[r["slip"]] = r
    return {rtol: (pair[1]["seconds"] / pair[0]["seconds"], pair[1]["nfev"] / pair[0]["nfev"]) for rtol, pair in found.items()}


def slip_table(data: Record) -> str:
    """What initial slip costs."""
    rows = []
    for rtol, (times, calls) in slip_ratios(data).items():
        pair = {r["slip"]: r for r in data["slip_costs"] if r["rtol"] == rtol}
        cells = [f"{seconds(pair[s]['seconds'])}, {pair[s]['steps']} steps" for s in (0, 1)]
        rows.append([short(rtol), *cells, f"{times:.2f}", f"{calls:.2f}"])
    return table(["rtol", "slip 0", "slip 1", "ratio of times", "ratio of calls"], rows)


def plain_table(data: Record) -> str:
    """Without history: beside solve_ivp."""
    rows = []
    for rtol in sorted({r["rtol"] for r in data["without_history"]}, reverse=True):
        found = {r["solver"]: r for r in data["without_history"] if r["rtol"] == rtol}
        rows.append([short(rtol), *(f"{short(r['error'])}, {seconds(r['seconds'])}" for r in found.values())])
    return table(["rtol", *dict.fromkeys(r["solver"] for r in data["without_history"])], rows)


def as_good(records: list[Record], other: Record) -> Record | None:
    """Our quickest record with no larger error than another, at the end and over the path."""
    ours = [r for r in records if r["solver"] == OURS and r["error_max"] <= other["error_max"] and r["error_end"] <= other["error_end"]]
    return min(ours, key=lambda r: r["seconds"]) if ours else None


def marge3d_race(data: Record) -> dict[str, Any] | None:
    """Its best accuracy, its time, and ours for the same; None if it was not measured."""
    found = data["marge3d"]
    if found["status"] != "measured":
        return None
    theirs = min((r for r in found["records"] if r["solver"] != OURS), key=lambda r: r["error_max"])
    own = as_good(found["records"], theirs)
    if own is None:
        return None
    return {"theirs": theirs, "own": own, "ratio": theirs["seconds"] / own["seconds"]}


def marge3d(data: Record) -> str:
    """The section on marge3d."""
    found, head = data["marge3d"], "## marge3d's own vortex problem\n\n"
    result = marge3d_race(data)
    if result is None:
        return f"{head}Not measured here ({found['reason']}): `make report-full` installs and measures it."
    rows = []
    for r in found["records"]:
        size = f"rtol {short(r['size'])}" if r["solver"] == OURS else f"{r['size']:g}"
        equal = None if r["solver"] == OURS else as_good(found["records"], r)
        ours = f"{seconds(equal['seconds'])} ({factor(r['seconds'] / equal['seconds'])} × less)" if equal else "–"
        rows.append([r["solver"], size, seconds(r["seconds"]), short(r["error_end"], 1), short(r["error_max"], 1), ours])
    theirs, own = result["theirs"], result["own"]
    return fill(
        "solver.md",
        "marge3d",
        version=found["version"],
        R=f"{found['R']:.4g}",
        S=f"{found['S']:.4g}",
        g=f"{found['g']:.4g}",
        end=f"{found['end']:g}",
        ratio=factor(result["ratio"]),
        best=short(theirs["error_max"], 1),
        best_steps=theirs["size"],
        best_time=seconds(theirs["seconds"]),
        building=seconds(theirs["building"]),
        own_time=seconds(own["seconds"]),
        own_rtol=short(own["size"]),
        ratio_solving=factor((theirs["seconds"] - theirs["building"]) / own["seconds"]),
        figure=save(draw_marge3d(found), "solver_marge3d"),
        table=table(["solver", "steps", "time", f"error at t = {found['end']:g}", "largest over the path", f"{OURS}, no larger error"], rows),
    )


def scan_table(found: Record) -> str:
    """How many runs of the scan are a success, by form and distance."""
    forms = {"rate": "implicit, on rates", "slip": "implicit, on slips", "held": "history held"}
    distances = list(dict.fromkeys(r["distance"] for r in found["rows"]))
    lines = []
    for form, name in forms.items():
        for key, drag in (("status", "constant"), ("status_rising", "rising")):
            rows = [of(found["rows"], form=form, distance=distance) for distance in distances]
            lines.append([name, drag, *(f"{sum(r[key] == 0 for r in each)} of {len(each)}" for each in rows)])
    return table(["form", "drag", *(f"{distance:g} × limit" for distance in distances)], lines)


def scan(found: Record) -> dict[str, Any]:
    """The numbers of the scan."""
    within, beyond = ([r for r in found["rows"] if (r["distance"] > 1.0) == side] for side in (False, True))
    kinds = ("", "_rising")
    return {
        "scan": found,
        "bounds": table(["degree", *found["limits"]], [[name, *(f"{each[k]:.4g}" for each in found["limits"].values())] for k, name in enumerate("AB")]),
        "scanned": scan_table(found),
        "wrong": sum(r[f"status{kind}"] == 0 for r in beyond for kind in kinds) or "none",
        "beyond": len(kinds) * len(beyond),
        "outside": len(beyond),
        "inside": len(within),
        "grow": sum(r["grows"] for r in beyond),
        "grow_within": sum(r["grows"] for r in within) or "none",
        "largest": f"{max(r[f'largest{kind}'] for r in found['rows'] for kind in kinds if r[f'status{kind}'] == 0):.4g}",
        "dips": sum(r["status"] == 0 and r["status_rising"] != 0 for r in within),
        "figure_stability": save(draw_stability(found), "solver_stability"),
    }


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    found = data["coupled"]
    own = cheapest(select(found["records"], problem="relaxing", scheme=OURS), 1e-9)
    assert own
    others = fixed_rows(found, "relaxing")
    best = min(others, key=lambda r: r["error_max"])
    after = [order(found, "relaxing", name) for name in ("Daitche(1)", "Daitche(2)", "Daitche(3)")]
    slips = [order(found, "relaxing", f"{name}, slips") for name in ("Daitche(1)", "Daitche(2)", "Daitche(3)")]
    hits = [p for name in found["declared"] if (p := order(found, "bouncing", name, "error_first")) is not None]
    race(found)
    peer = marge3d_race(found)
    return {
        "own": own,
        "best": best["scheme"],
        "best_n": grouped(best["n"]),
        "best_error": short(best["error_max"]),
        "best_time": seconds(best["seconds"]),
        "smooth": two(order(found, "smooth", "Daitche(3)")),
        "rates": span(after),
        "on_slips": span(slips),
        "hits": two(max(hits)),
        "peer": "" if peer is None else f" and marge3d, on its own vortex problem, {factor(peer['ratio'])} times as long for its best accuracy",
    }


def solver(data: dict[str, Record]) -> str:
    """The page reports/solver.md."""
    found = data["coupled"]
    contest = race(found)
    rise, level, off = linear(found)
    second, longest = contest["second"], found["by_impacts"][-1]
    longer = [r for r in found["race"]["records"] if r["scheme"] != OURS]
    bounces = [r for r in select(found["records"], problem="bouncing") if r["scheme"] not in contest["fits"]] + longer
    return fill(
        "solver.md",
        found=found,
        contest=contest,
        **opening(data),
        figure_accuracy=save(draw_accuracy(found["records"]), "solver_accuracy"),
        digits=digits_table(found),
        figure_orders=save(draw_orders(all_orders(found), found["declared"]), "solver_orders"),
        orders=order_table(found),
        figure_convergence=save(draw_convergence(found["records"]), "solver_convergence"),
        figure_impacts=save(draw_impacts(bounces, contest["fits"], found["race"]["target"]), "solver_impacts"),
        race=race_table(found),
        second=f"{second['scheme']}, {grouped(second['n'])} steps, {seconds(second['seconds'])}: {short(second['error_first'], 1)}" if second else "none",
        figure_tolerance=save(draw_tolerance(found["records"]), "solver_tolerance"),
        kept=kept_table(found),
        worst=f"{worst_kept(found)[0]:.2g}",
        figure_by_impacts=save(draw_by_impacts(found["by_impacts"], rise, level), "solver_by_impacts"),
        per_impact=seconds(rise),
        off=f"{off:.0%}",
        calls_off=f"{linear(found, 'nfev')[2]:.0%}",
        by_impacts=impacts_table(found),
        many=longest["n"],
        many_error=f"{longest['error_max'] / longest['rtol']:.1f}",
        slips=slip_table(found),
        plain=plain_table(found),
        marge3d=marge3d(found),
        **scan(data["stability"]),
        footer=footer({name: data[name] for name in SUITES}),
    )


# Figures, from the records alone

DAITCHE = ((ORANGE, "o"), (GREEN, "^"), (BLUE, "D"))
LOOKS = {  # colour, marker, dash
    "semi-derivative": (YELLOW, "v", "-"),
    "Euler–Maclaurin": (BLACK, "x", "-"),
    "Brush": (GREY, "+", "-"),
    "Hinsberg, published tail": (RED, "s", "-"),
    **{f"Daitche({p}){what}": (*look, dash) for what, dash in (("", "-"), (", slips", "--")) for p, look in enumerate(DAITCHE, 1)},
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


def draw_accuracy(records: list[Record]) -> Any:
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
    return finished(
        figure, panels[0], 6, "A digit costs a fixed-step scheme a multiple of its time, and after a jump far more; collocation pays a few steps, jump or not"
    )


def draw_convergence(records: list[Record]) -> Any:
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
    return finished(figure, panels[0], 6, "The same schemes, the same steps: after a jump the degree of a scheme no longer counts")


def draw_orders(found: dict[str, dict[str, float]], declared: dict[str, float]) -> Any:
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
    return finished(figure, axes, 5, "What a jump does to the order: green before, red and black after")


def draw_impacts(records: list[Record], fits: dict[str, dict[str, float]], target: float) -> Any:
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
    return finished(figure, axes, 3, "Bouncing sphere: collocation finds all ten impacts, fixed steps snap the first three to the grid")


def draw_tolerance(records: list[Record]) -> Any:
    """Error against the tolerance asked for."""
    figure, axes = plt.subplots(figsize=(8.0, 6.0))
    looks = zip((BLACK, GREY, ORANGE, RED, SKY, BLUE, GREEN, YELLOW, PINK, PURPLE), "ox^sPDv<X*", strict=True)
    rows = select(records, scheme="Collocation")
    for name, (colour, marker) in zip(dict.fromkeys(r["problem"] for r in rows), looks, strict=False):
        found = [r for r in rows if r["problem"] == name and r["error_max"]]
        axes.loglog([r["rtol"] for r in found], [r["error_max"] for r in found], color=colour, marker=marker, label=name, linewidth=1.0)
    asked = np.array([1e-11, 1e-3])
    for times, label in ((1.0, "error = rtol"), (10.0, "10 rtol")):
        axes.loglog(asked, times * asked, color="#666666", linestyle="-" if times == 1.0 else ":", linewidth=1.4)
        axes.annotate(label, (8.5e-12, times * 1e-11), color="#666666", fontsize=9, va="center")
    axes.set(xlabel="rtol asked for", ylabel="largest error / largest |y| (bouncing: of the impact times, s)", xlim=(1.5e-12, 2e-3), ylim=(1e-16, 1e-1))
    axes.invert_xaxis()
    return finished(figure, axes, 5, "Largest error of the whole path: collocation keeps its tolerance, through jumps and impacts")


def draw_by_impacts(records: list[Record], slope: float, level: float) -> Any:
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


def draw_marge3d(found: Record) -> Any:
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
    return finished(figure, axes, 3, "marge3d's own vortex problem (numbers at its points: steps)")


def draw_stability(found: Record) -> Any:
    """Computed limits, and runs on both sides of them."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 5.6), sharex=True, sharey=True)
    least, looks = (3e-3, 1e-3), (BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, RED, PINK, PURPLE)
    shown = (0.9, 1.1)
    for axes, forms, title in zip(panels, (("rate", "slip"), ("held",)), ("implicit, on rates and on slips", "history held over the step"), strict=True):
        for (degree, (drag, memory)), colour in zip(found["limits"].items(), looks, strict=False):
            if forms == ("held",):
                x = np.append(np.geomspace(least[0], HELD_RATE, 400), HELD_RATE)
                y = np.append(0.5 * memory * (1.0 + held_factor(x[:-1])), least[1])
            else:
                x = drag * (1.0 - np.geomspace(least[1] / memory, 1.0 - least[0] / drag, 400))
                y = memory * (1.0 - x / drag)
            axes.loglog(x, y, color=colour, linewidth=1.0)
            axes.annotate(degree, (2.0 * least[0], memory), xytext=(0, 1), textcoords="offset points", color=colour, fontsize=9, va="bottom")
            for r in found["rows"]:
                if r["degree"] == int(degree) and r["form"] == forms[0] and r["distance"] in shown:
                    same = [s for form in forms for s in of(found["rows"], degree=r["degree"], form=form, share=r["share"], distance=r["distance"])]
                    succeeded = {s["status"] == 0 for s in same}
                    marker = "D" if len(succeeded) > 1 else "o" if True in succeeded else "x"
                    at = max(r["drag"], least[0]), max(r["history"], least[1])
                    axes.plot(*at, marker, color=colour, markerfacecolor="none", clip_on=False, zorder=3)
        axes.set(title=title, xlabel="λ·dt (at the left edge: none)", xlim=(least[0], 12.0), ylim=(least[1], 40.0))
    panels[0].set_ylabel("c·√dt (at the lower edge: none)")
    panels[0].plot([], [], "o", color=GREY, markerfacecolor="none", label="0.9 × limit: a success")
    panels[0].plot([], [], "x", color=GREY, label="1.1 × limit: status −1")
    panels[0].plot([], [], color=GREY, label="computed limit, degrees 2 to 10")
    return finished(figure, panels[0], 3, "No run beyond the computed limit ends as a success, and those within it do")


PAGE = Page("solver", solver, SUITES)
