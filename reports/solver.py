"""The page reports/solver.md: what a digit of a coupled solution costs, and what a jump does to each scheme's order."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from reports import solver_figures as figures
from reports.analysis import Record, Target, seconds, select, short
from reports.page import asked, factor, fill, footer, grouped, save, table

SUITES = ("coupled",)
OURS = "Collocation"
KEPT = 10.0  # error over rtol that is asked for
DIGITS = (1e-3, 1e-6, 1e-9)
ON_RATES = ("Daitche(1)", "Daitche(2)", "Daitche(3)")
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
        "solver_marge3d.md",
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
        figure=save(figures.marge3d(found), "solver_marge3d"),
        table=table(["solver", "steps", "time", f"error at t = {found['end']:g}", "largest over the path", f"{OURS} as good"], rows),
    )


def targets(data: Record) -> list[Target]:
    """The figures asked of the solver, beside what was measured."""
    rows: list[Target] = []
    found = select(data["records"], problem="relaxing", scheme=OURS)
    good = [r for r in found if r["error_max"] is not None and r["error_max"] <= 1e-9]
    least = min(good, key=lambda r: r["steps"]) if good else found[-1]
    measured = f"{short(least['error_max'], 1)} in {least['steps']} steps (rtol {short(least['rtol'])})"
    rows.append(Target("relaxing sphere, slip 1, t to 4, largest error", "≤ 1e-9 in ≤ 25 steps", measured, bool(good) and least["steps"] <= 25))
    ratio, problem, rtol = worst_kept(data)
    rows.append(Target("error / rtol, every problem, rtol 1e-3 … 1e-11", f"≤ {KEPT:g}", f"{ratio:.2g} at worst ({problem}, {short(rtol)})", ratio <= KEPT))
    slips = slip_ratios(data)
    worst = max(slips, key=lambda r: slips[r][0])
    rows.append(
        Target("non-zero slip against zero slip, same stream", "≤ 2 ×", f"{slips[worst][0]:.2f} × at worst (rtol {short(worst)})", slips[worst][0] <= 2.0)
    )
    bounced = next(r for r in select(data["records"], problem="bouncing", scheme=OURS) if math.isclose(r["rtol"], 1e-9))
    error = bounced["error_max"]
    met = error is not None and error <= 1e-8
    rows.append(Target("bouncing sphere, ten impact times at rtol 1e-9", "≤ 1e-8 s", short(math.inf if error is None else error, 1), met))
    lowest = min(r["lowest"] for r in select(data["records"], problem="bouncing", scheme=OURS) if r.get("lowest") is not None)
    rows.append(Target("bouncing sphere, deepest below the bed, any rtol", "≤ 1e-10", f"{short(max(0.0, -lowest), 1)}", lowest >= -1e-10))
    rest = data["rest"]
    measured = f"status {rest['status']} after {rest['impacts']} impacts"
    rows.append(Target(f"e = {rest['restitution']:g} until it rests, and says so", "status 2", measured, rest["status"] == 2))
    for name in ON_RATES:
        p = order(data, "smooth", name)
        declared = data["declared"][name]
        rows.append(
            Target(f"FixedStep with {name}, manufactured smooth solution", f"order ≥ {declared - 0.25:g}", two(p), p is not None and p >= declared - 0.25)
        )
    contest = race(data)
    measured = f"{factor(contest['ratio'])} × ({contest['best']}, extrapolated)"
    rows.append(Target("bouncing sphere at 1e-6, against our own best FixedStep", "≥ 100 × less time", measured, contest["ratio"] >= 100.0))
    peer = marge3d_race(data)
    if peer:
        rows.append(Target("marge3d's best accuracy on its own problem", "≥ 1000 × less time", f"{factor(peer['ratio'])} ×", peer["ratio"] >= 1000.0))
    calls, _, off = linear(data, "nfev")
    measured = f"calls of fun: {calls:.0f} per impact, off by {off:.0%} of the most; time: off by {linear(data)[2]:.0%}"
    rows.append(Target("cost against impacts: deviation from a line (judged by calls, which no load disturbs)", "linear", measured, off <= 0.1))
    plain = max(r["error"] / r["rtol"] for r in data["without_history"] if r["solver"] == OURS)
    rows.append(Target("c = 0 against solve_ivp (DOP853 at 1e-13): error / rtol", "≤ 1", f"{plain:.1g} at worst", plain <= 1.0))
    return rows


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    found = data["coupled"]
    own = cheapest(select(found["records"], problem="relaxing", scheme=OURS), 1e-9)
    third = cheapest(select(found["records"], problem="relaxing", scheme=OURS), 1e-3)
    assert own and third
    others = fixed_rows(found, "relaxing")
    best = min(others, key=lambda r: r["error_max"])
    after = [order(found, "relaxing", name) for name in ("Daitche(1)", "Daitche(2)", "Daitche(3)")]
    slips = [order(found, "relaxing", f"{name}, slips") for name in ("Daitche(1)", "Daitche(2)", "Daitche(3)")]
    hits = [p for name in found["declared"] if (p := order(found, "bouncing", name, "error_first")) is not None]
    contest = race(found)
    peer = marge3d_race(found)
    return fill(
        "solver_opening.md",
        steps=own["steps"],
        time=seconds(own["seconds"]),
        extra=f"{own['seconds'] / third['seconds']:.1f}",
        best=best["scheme"],
        best_n=grouped(best["n"]),
        best_error=short(best["error_max"]),
        best_time=seconds(best["seconds"]),
        smooth=two(order(found, "smooth", "Daitche(3)")),
        rates=span(after),
        slips=span(slips),
        hits=two(max(hits)),
        impacts=found["impacts"],
        race_time=seconds(contest["own"]["seconds"]),
        race_ratio=factor(contest["ratio"]),
        peer="" if peer is None else f" and marge3d, on its own vortex problem, {factor(peer['ratio'])} times as long for its best accuracy",
    )


def solver(data: dict[str, Record]) -> str:
    """The page reports/solver.md."""
    found = data["coupled"]
    rows = targets(found)
    contest = race(found)
    rise, level, off = linear(found)
    second, longest = contest["second"], found["by_impacts"][-1]
    longer = [r for r in found["race"]["records"] if r["scheme"] != OURS]
    bounces = [r for r in select(found["records"], problem="bouncing") if r["scheme"] not in contest["fits"]] + longer
    return fill(
        "solver.md",
        opening=opening(data),
        rate=f"{found['rate']:g}",
        coefficient=f"{found['coefficient']:g}",
        restitution=f"{found['restitution']:g}",
        impacts=found["impacts"],
        tail=short(found["tail"]),
        first=found["first"],
        figure_accuracy=save(figures.accuracy(found["records"]), "solver_accuracy"),
        digits=digits_table(found),
        figure_orders=save(figures.orders(all_orders(found), found["declared"]), "solver_orders"),
        orders=order_table(found),
        figure_convergence=save(figures.convergence(found["records"]), "solver_convergence"),
        figure_impacts=save(figures.impacts(bounces, contest["fits"], found["race"]["target"]), "solver_impacts"),
        race=race_table(found),
        target=short(found["race"]["target"]),
        ratio=factor(contest["ratio"]),
        second=f"{second['scheme']}, {grouped(second['n'])} steps, {seconds(second['seconds'])}: {short(second['error_first'], 1)}" if second else "none",
        longest=seconds(contest["longest"]["seconds"]),
        figure_tolerance=save(figures.tolerance(found["records"]), "solver_tolerance"),
        kept=kept_table(found),
        worst=f"{worst_kept(found)[0]:.2g}",
        figure_by_impacts=save(figures.by_impacts(found["by_impacts"], rise, level), "solver_by_impacts"),
        per_impact=seconds(rise),
        off=f"{off:.0%}",
        calls_off=f"{linear(found, 'nfev')[2]:.0%}",
        by_impacts=impacts_table(found),
        many=longest["n"],
        many_error=f"{longest['error_max'] / longest['rtol']:.1f}",
        slips=slip_table(found),
        plain=plain_table(found),
        marge3d=marge3d(found),
        targets=asked(rows),
        met=f"{sum(row.met for row in rows)} of {len(rows)} are met.",
        footer=footer({name: data[name] for name in SUITES}),
    )
