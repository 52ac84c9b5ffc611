"""The page reports/memory.md: what the memory of the past costs in time, bytes and digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from reports import memory_figures as figures
from reports.analysis import Record, Target, select, short
from reports.page import asked, factor, fill, footer, grouped, save, table

SUITES = ("exponentials", "stream", "window", "varying")
EVALUATIONS = ("slip at t", "slip at τ", "exponentials", "steady slip")  # of a slip that varies
FULL, HEADLINE = "full history", "Exponential(3, 1e-6)"
PUBLISHED = ("van Hinsberg", "Casas I2t", "Casas I1")
SAVINGS = (0.7, 0.9)  # the thesis's claim
CLOCKS = (("cosine", "seconds"), ("saltation", "seconds_steps"))  # signal, and the time that counts: of the steps, not of Python's jumps


def nanoseconds(value: float) -> str:
    """A time per step as people say it."""
    for unit, size in (("ms", 1e6), ("µs", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.0f} ns"


def kilobytes(value: float) -> str:
    """A size as people say it."""
    for unit, size in (("MB", 1e6), ("kB", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.0f} B"


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
                nanoseconds(last["nanoseconds"]),
                f"{nanoseconds(many[name]['nanoseconds'])} ({grouped(many[name]['grains'])})",
                kilobytes(last["bytes"]),
                "0" if last["error"] is None else short(last["error"], 1),
            ]
        )
    head = ["scheme", "steps n", "terms", "one grain, after n steps", "many grains, after 1 000 steps", "state per grain", "error"]
    return table(head, rows)


def call_table(calls: Record) -> str:
    """What a call from Python costs."""
    return table(["call", "time"], [[f"`{name}`" if " " not in name else name, nanoseconds(1e9 * seconds)] for name, seconds in calls.items()])


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
        low, high = nanoseconds(max(min(each), 0.0)), nanoseconds(max(each))
        parts.append(f"{label} {low}" + (f" to {high}" if len(each) > 1 else ""))
    return ", ".join(parts)


def varying_table(varying: Record) -> str:
    """What following the slip costs."""
    return table(
        ["evaluation", "time per step and component", "state per component"],
        [[r["evaluation"], nanoseconds(r["nanoseconds"]), kilobytes(r["bytes"])] for r in varying["costs"] if r["evaluation"] in EVALUATIONS],
    )


def stopping_table(varying: Record) -> str:
    """What happens where the slip passes through zero."""
    rows = []
    for r in varying["stopping"]:
        rows.append([f"{r['amplitude']:g}", f"{r['low']:g} U0", f"{r['outside']} of {r['n']}", f"{r['differences']['slip at τ']:.0%}"])
    return table(["amplitude a", "least slip admitted", "slips taken at it", "τ – t"], rows)


def targets(data: dict[str, Record]) -> list[Target]:
    """The figures asked of the streams, beside what was measured."""
    sums, stream = data["exponentials"], data["stream"]
    found = [r for r in sums["fitted"] if any(math.isclose(r["rtol"], rtol) for rtol in (1e-3, 1e-6, 1e-9, 1e-12))]
    worst = max(r["error"] / r["rtol"] for r in sums["fitted"])
    above = max(r["n"] - r["law"] for r in found)
    rows = [
        Target("fit: measured error / promised, five ranges, 1e-2 … 1e-12", "≤ 1", f"{worst:.3f} at worst", worst <= 1.0),
        Target("fit: terms above the limit law", "≤ 2", f"{above:.1f} at most", above <= 2.0),
        Target("fit: time after the first call", "≤ 20 ms", nanoseconds(1e9 * sums["times"]["later"]), sums["times"]["later"] <= 0.02),
    ]
    for name, low, high in (("van Hinsberg", 5e-4, 2e-3), ("Casas I2t", 1.6e-4, 1.5e-3)):
        ends = [r["error_max"] for r in sums["floors"] if r["set"] == name and r["window"] in (0.1, 3.0)]
        same = all(1 / 1.5 <= measured / wanted <= 1.5 for measured, wanted in zip(ends, (high, low), strict=True))
        rows.append(Target(f"force error of {name}, window 0.1 and 3 s", f"{short(high, 1)}, {short(low, 1)}", ", ".join(short(e, 1) for e in ends), same))
    for name in PUBLISHED:
        worse = gains(sums["floors"], name)
        window = min(worse, key=lambda w: worse[w])
        rows.append(
            Target(
                f"fitted tail of ten terms against {name}", "≥ 10 × better", f"{factor(worse[window])} × at worst (window {window:g} s)", worse[window] >= 10.0
            )
        )
    apart = max(r["difference"] for r in stream["agreement"])
    steps = stream["agreement"][0]["n"]
    rows.append(Target(f"streams with a sum of 1e-10 against `cumulate`, p = 1 … 6, {grouped(steps)} steps", "≤ 1e-9", short(apart, 1), apart <= 1e-9))
    kept = max(above_full(stream["convergence"]))
    rows.append(Target("order kept to the floor: error of the stream less the full history's, over the promise", "≤ 1.4", f"{kept:.2f}", kept <= 1.4))
    head = stream["headline"]
    uneven, race = head["tenths"][-1] / head["tenths"][0], head["direct"] / head["stream"]
    many = f"{grouped(head['grains'])} grains over {grouped(head['grain_steps'])} steps, per component"
    rows += [
        Target(f"one grain over {grouped(head['steps'])} steps ({head['terms']} terms)", "≤ 50 ns per step", nanoseconds(head["one"]), head["one"] <= 50.0),
        Target(many, "≤ 50 ns per step", nanoseconds(head["many"]), head["many"] <= 50.0),
        Target("last tenth of the steps against the first", "≤ 1.3 ×", f"{uneven:.2f} ×", uneven <= 1.3),
        Target(f"against the compiled direct sum at n = {grouped(head['direct_n'])}", "≥ 60 × faster", f"{factor(race)} ×", race >= 60.0),
        Target("state per grain of three components", "≤ 1 kB", kilobytes(head["bytes"]), head["bytes"] <= 1000),
        Target("second process, from start to end", "< 1.5 s", f"{stream['second']['total']:.2f} s", stream["second"]["total"] < 1.5),
    ]
    return rows


def above_full(records: list[Record]) -> list[float]:
    """By how much every stream's error exceeds that of the full history with the same step, in units of its promise."""
    full = {(r["order"], r["n"]): r["error"] for r in records if r["promise"] == "full"}
    return [(r["error"] - full[r["order"], r["n"]]) / float(r["promise"]) for r in records if r["promise"] != "full"]


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    head, window, stream = data["stream"]["headline"], data["window"], data["stream"]
    own = [r for r in stream["records"] if r["scheme"] == HEADLINE][-1]
    published = [r for r in stream["records"] if r["scheme"] == "Hinsberg, published tail"]
    saved = {saving: bought(window["cosine"], saving, "seconds") for saving in SAVINGS}
    hops = {saving: bought(window["saltation"], saving, "seconds_steps") for saving in SAVINGS}
    errors = [f["error"] for f in (*saved.values(), *hops.values()) if f["error"]]
    tail = quickest(window["cosine"], "seconds")
    better = [gain for name in PUBLISHED for gain in gains(data["exponentials"]["floors"], name).values()]
    return fill(
        "memory_opening.md",
        terms=head["terms"],
        steps=grouped(head["steps"]),
        one=nanoseconds(head["one"]),
        bytes=kilobytes(head["bytes"]),
        error=short(own["error"]),
        race=factor(head["direct"] / head["stream"]),
        direct_n=grouped(head["direct_n"]),
        low=f"{min(errors):.0%}",
        high=f"{max(errors):.0%}",
        tail_saved=f"{tail['saved']:.1%}",
        tail_error=short(tail["error"]),
        better_least=factor(min(better)),
        better_most=factor(max(better)),
        published_short=short(published[0]["error"]),
        published_short_n=grouped(published[0]["n"]),
        published_long=short(published[-1]["error"]),
        published_long_n=grouped(published[-1]["n"]),
    )


def memory(data: dict[str, Record]) -> str:
    """The page reports/memory.md."""
    sums, stream, window, varying = (data[name] for name in SUITES)
    head, second = stream["headline"], stream["second"]
    rows = targets(data)
    base = next(r for r in varying["records"] if (r["amplitude"], r["frequency"]) == (0.5, 2.0))
    refused = next((r["refused"] for r in sums["finite"] if r["refused"]), "rtol must be at least …")
    return fill(
        "memory.md",
        opening=opening(data),
        step=stream["step"],
        window=stream["window"],
        figure_costs=save(figures.costs(stream["records"]), "memory_costs"),
        schemes=scheme_table(stream),
        direct=nanoseconds(head["direct"]),
        dot=nanoseconds(head["dot"]),
        stream_step=nanoseconds(head["stream"]),
        race=factor(head["direct"] / head["stream"]),
        race_dot=factor(head["dot"] / head["stream"]),
        direct_n=grouped(head["direct_n"]),
        calls=call_table(stream["calls"]),
        second=f"{second['total']:.2f} s",
        second_parts=", ".join(f"{name} {second[name]:.2f} s" for name in ("import", "plan", "run")),
        figure_errors=save(figures.errors(stream["records"]), "memory_errors"),
        figure_convergence=save(figures.convergence(stream["convergence"]), "memory_order"),
        kept=f"{max(above_full(stream['convergence'])):.2f}",
        figure_terms=save(figures.terms(sums["fitted"]), "sum_terms"),
        terms=terms_table(sums["fitted"]),
        fit_first=nanoseconds(1e9 * sums["times"]["first"]),
        fit_later=nanoseconds(1e9 * sums["times"]["later"]),
        figure_published=save(figures.published(sums["published"], sums["curves"], sums["used"]), "sum_published"),
        figure_floors=save(figures.floors(sums["floors"]), "sum_floors"),
        floors=floors_table(sums["floors"]),
        end=f"{sums['force']['end']:g}",
        degree=sums["force"]["degree"],
        force_step=f"{sums['force']['step']:g}",
        figure_windows=save(figures.windows(window["cosine"], window["saltation"]), "windows"),
        savings=savings_table(window),
        hops=window["saltation"]["hops"],
        hop_steps=window["saltation"]["steps"],
        relaxation=window["saltation"]["relaxation"],
        jumps=jump_costs(window["saltation"]),
        figure_varying=save(figures.varying(varying), "slip_varying"),
        slip=f"{100 * varying['slip']:g}",
        diameter=f"{1000 * varying['diameter']:g}",
        time_scale=f"{varying['time_scale']:.2g}",
        base_tau=f"{base['differences']['slip at τ']:.0%}",
        base_mean=f"{base['differences']['mean slip']:.0%}",
        base_basset=f"{base['differences']['Basset']:.1f}",
        varying=varying_table(varying),
        stopping=stopping_table(varying),
        finite=finite_table(sums["finite"]),
        refused=refused,
        load="not known" if stream["load"] is None else f"{stream['load']:.1f} on {stream['cores']} cores",
        targets=asked(rows),
        met=f"{sum(row.met for row in rows)} of {len(rows)} are met.",
        footer=footer({name: data[name] for name in SUITES}),
    )
