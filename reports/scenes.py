"""The page reports/scenes.md: which scheme, window, solver and step give mean jumps to a wanted error in the least time."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

import basset
from reports import analysis
from reports import scenes_figures as figures
from reports.analysis import NEAR, Record, Target, seconds, short
from reports.flights import of, percent
from reports.page import asked, factor, fill, footer, save, table

SUITES = ("scenes",)
COLLOCATION, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
STEPPED = {IMPLICIT: "implicit", HELD: "RK4"}
WHOLE, DROPPED, PUBLISHED, FITTED, SUMS = "whole past", "window, no tail", "window, published tail", "window, fitted tail", "exponentials"
QUANTITIES = ("height", "length")
SHIPPED = 1e-5  # rtol of the scene as it is
COMMON = 1e-3  # dt of comparisons, d/u*
BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)
MEMORIES = {"impulse": "rebounds remembered", "reset": "memory wiped at rebounds"}


# Errors of one record


def flown(records: Sequence[Record]) -> list[Record]:
    """Records that arrived."""
    return [r for r in records if r["height"] is not None]


def upper(record: Record, quantity: str) -> float:
    """The error of a mean that can be excluded no longer: the difference and two of its standard errors."""
    return float(abs(record[quantity]["bias"]) + 2.0 * record[quantity]["se"])


def scatters(record: Record, quantity: str) -> bool:
    """Whether the error cannot be told from scatter: no larger than its standard error."""
    return bool(abs(record[quantity]["bias"]) <= record[quantity]["se"])


def counted(record: Record, quantity: str) -> float:
    """The error that decides: the upper bound, but no less than what the step and the truncation do each alone, which may cancel by chance."""
    if record["truncation"] is None:
        return upper(record, quantity)
    cut = record["truncation"][quantity]["bias"]
    return float(max(upper(record, quantity), abs(cut), abs(record[quantity]["bias"] - cut)))


# Time at equal error


def named(record: Record) -> str:
    """A scheme and its solver."""
    return record["scheme"] if record["method"] == COLLOCATION else f"{record['scheme']}, {STEPPED[record['method']]}"


def sized(record: Record) -> str:
    """The same, with step or tolerance."""
    return f"{named(record)}, {'rtol' if record['method'] == COLLOCATION else 'dt'} {figures.step(record['size'])}"


def ladders(records: Sequence[Record], quantity: str) -> dict[str, list[Record]]:
    """Records by scheme and solver, from coarse to fine, with the error that decides."""
    found: dict[str, list[Record]] = {}
    for r in sorted(flown(records), key=lambda r: -r["size"]):
        found.setdefault(named(r), []).append(r | {"error": counted(r, quantity)})
    return found


def fastest(records: Sequence[Record], bound: float, quantity: str) -> tuple[Record | None, list[Record]]:
    """The quickest record within an error that is kept by all finer steps too, and others as quick to a factor that timing cannot tell apart."""
    reached = [analysis.reaches(rows, bound, "error") for rows in ladders(records, quantity).values()]
    ranked = sorted((r for r in reached if r is not None), key=lambda r: r["seconds"])
    return (ranked[0], [r for r in ranked[1:] if r["seconds"] <= NEAR * ranked[0]["seconds"]]) if ranked else (None, [])


def collocated(records: Sequence[Record]) -> list[Record]:
    """Collocation with all of its memory."""
    return of(list(records), scheme=COLLOCATION)


def stepped(records: Sequence[Record]) -> list[Record]:
    """Fixed steps."""
    return [r for r in flown(records) if r["method"] != COLLOCATION]


def least(records: Sequence[Record], quantity: str) -> Record:
    """The most exact of some records."""
    return min(flown(records), key=lambda r: counted(r, quantity))


def extrapolated(records: Sequence[Record], bound: float, quantity: str) -> tuple[float, str] | None:
    """(seconds, scheme) of what would be the quickest within an error that none has reached, were its error to go on as the root of dt."""
    found = []
    for name, rows in ladders(records, quantity).items():
        last = rows[-1]
        if last["family"] == SUMS and last["truncation"] is None:
            found.append((last["seconds"] * (last["error"] / bound) ** 2, name))
    return min(found) if found else None


def choice(records: Sequence[Record], bound: float, quantity: str, ours: Record | None) -> list[str]:
    """The quickest fixed steps and their time over collocation's, as table cells."""
    best, others = fastest(stepped(records), bound, quantity)
    if best is None:
        further = extrapolated(stepped(records), bound, quantity)
        if further is None or ours is None:
            return ["none", "–"]
        time, name = float(f"{further[0]:.1g}"), further[1]
        ratio = float(f"{further[0] / ours['seconds']:.1g}")
        return [f"none; extrapolated, about {seconds(time)}: {name}", f"≈ {factor(ratio)} ×"]
    also = f" (as quick: {sized(others[0])}{f' and {len(others) - 1} more' if len(others) > 1 else ''})" if others else ""
    return [f"{seconds(best['seconds'])}: {sized(best)}{also}", f"{factor(best['seconds'] / ours['seconds'])} ×" if ours else "–"]


def cheapest_table(records: Sequence[Record], quantity: str) -> str:
    """The quickest way to each error: of all, and at fixed steps."""
    rows = []
    for bound in BOUNDS:
        ours = fastest(collocated(records), bound, quantity)[0]
        rows.append(
            [percent(bound), f"**{seconds(ours['seconds'])}**: rtol {short(ours['size'])}" if ours else "none", *choice(records, bound, quantity, ours)]
        )
    return table([f"error of the mean {quantity}", "collocation, per jump", "quickest fixed steps, per jump", "ratio"], rows)


def toml(record: Record) -> str:
    """The lines of a scene that select a record."""
    step = f"rtol = {short(record['size'])}" if record["method"] == COLLOCATION else f"dt = {figures.step(record['size'])}            # d/u*"
    lines = ["[solver]", f'method = "{record["method"]}"', step]
    if record["history"]:
        lines += ["[history]"]
        lines += [
            f"{key} = {str(value).lower() if isinstance(value, bool) else repr(value).replace(chr(39), chr(34))}" for key, value in record["history"].items()
        ]
    return "\n".join(lines)


# Tables


def small(value: float) -> str:
    """A share in per cent, one digit."""
    return f"{100.0 * value:.1g}" if value >= 1e-6 else short(100.0 * value)


def signed(value: float) -> str:
    """A share in per cent with its sign, two digits."""
    text = f"{100.0 * value:+.2g}"
    return text if "e" not in text else ("+" if value > 0.0 else "-") + short(100.0 * abs(value))


def error_cell(record: Record, quantity: str) -> str:
    """An error, or its upper bound where it cannot be told from scatter."""
    if scatters(record, quantity):
        return f"≤ {small(upper(record, quantity))}"
    return signed(record[quantity]["bias"])


def every_table(records: Sequence[Record]) -> str:
    """Every contender: errors of height and length in per cent, and time, by step."""
    own = [r for r in records if r["method"] != COLLOCATION]
    steps = sorted({r["size"] for r in own}, reverse=True)
    rows = []
    for name in dict.fromkeys((r["scheme"], r["method"]) for r in own):
        found = {r["size"]: r for r in own if (r["scheme"], r["method"]) == name}
        rows.append([f"{name[0]}, {STEPPED[name[1]]}", *(every_cell(found.get(step)) for step in steps)])
    return table(["% of height / of length, time, dt =", *(figures.step(step) for step in steps)], rows)


def every_cell(record: Record | None) -> str:
    """One run."""
    if record is None:
        return ""
    if record["height"] is None:
        return str(record["reason"])
    return f"{error_cell(record, 'height')} / {error_cell(record, 'length')}, {seconds(record['seconds'])}{'†' if record['jumps'] < 100 else ''}"


def collocation_table(data: Record) -> str:
    """Collocation by tolerance, in both scenes."""
    rows = []
    for r in collocated(data["impulse"]["records"]):
        cells = []
        for key in MEMORIES:
            other = of(collocated(data[key]["records"]), size=r["size"])[0]
            cells += [f"{error_cell(other, 'height')} / {error_cell(other, 'length')}", small(other["height"]["rms"]), seconds(other["seconds"])]
        rows.append([short(r["size"]), *cells])
    head = [f"{what}{text}" for text in MEMORIES.values() for what in ("% of height / of length, ", "% of a single height, ", "time, ")]
    return table(["rtol", *head], rows)


def truncated(records: Sequence[Record], method: str = IMPLICIT) -> list[Record]:
    """Records whose memory is cut and whose twin remembers all."""
    return [r for r in flown(records) if r["truncation"] is not None and r["method"] == method and r["family"] != WHOLE]


def share(found: Record) -> str:
    """A paired difference in per cent with its standard error."""
    if abs(found["bias"]) < 1e-6:
        return "< 1e-4"
    return f"{signed(found['bias'])} ± {100.0 * found['se']:.1g}"


def window_table(records: Sequence[Record]) -> str:
    """What a cut memory does by itself, by step; beside it what the step does."""
    found = truncated(records)
    steps = [step for step in sorted({r["size"] for r in found}, reverse=True) if step < 9e-3]
    rows = []
    for scheme in dict.fromkeys(r["scheme"] for r in found):
        own = {r["size"]: r for r in found if r["scheme"] == scheme}
        finest = own[min(own)]
        heights = [share(own[step]["truncation"]["height"]) if step in own else "" for step in steps]
        rows.append([scheme, *heights, share(finest["truncation"]["length"]), signed(finest["height"]["bias"] - finest["truncation"]["height"]["bias"])])
    for r in kept_jumps(records):
        rows.append([r["scheme"], *[""] * (len(steps) - 1), share(r["height"]), share(r["length"]), "none"])
    head = [*(f"height, dt = {figures.step(step)}" for step in steps), "length, its finest dt", "height: what the step errs there"]
    return table(["truncation alone, %", *head], rows)


def kept_jumps(records: Sequence[Record]) -> list[Record]:
    """Collocation whose memory holds some jumps."""
    return [r for r in flown(records) if "window_jumps" in r["history"]]


def at(records: Sequence[Record], scheme: str, size: float | None = None, method: str = IMPLICIT) -> Record:
    """The record of a scheme at a step, or at its finest."""
    found = of(flown(records), scheme=scheme, method=method)
    return min(found, key=lambda r: r["size"] if size is None else abs(r["size"] - size))


def floor(records: Sequence[Record], scheme: str, quantity: str = "height") -> float:
    """What the cut memory does alone; an upper bound where it cannot be told from scatter."""
    found = at(records, scheme, COMMON)["truncation"][quantity]
    return float(abs(found["bias"]) + (2.0 * found["se"] if abs(found["bias"]) <= found["se"] else 0.0))


def solvers_apart(records: Sequence[Record]) -> tuple[float, float, float]:
    """RK4 over the implicit step, whole memory or a good tail: (median of errors of the height, the largest, median of times)."""
    held = {(r["scheme"], r["size"]): r for r in stepped(records) if r["method"] == HELD and r["family"] != DROPPED}
    pairs = [(held[r["scheme"], r["size"]], r) for r in stepped(records) if r["method"] == IMPLICIT and (r["scheme"], r["size"]) in held]
    errors = [abs(one["height"]["bias"] / two["height"]["bias"]) for one, two in pairs]
    return statistics.median(errors), max(errors), statistics.median(one["seconds"] / two["seconds"] for one, two in pairs)


def luckiest(records: Sequence[Record]) -> Record:
    """Where step and window cancel most."""
    cut = [r for r in stepped(records) if r["truncation"] is not None and r["family"] == DROPPED]
    return min(cut, key=lambda r: abs(r["height"]["bias"]) / abs(r["truncation"]["height"]["bias"]))


# The page


def thesis_record(data: Record) -> Record:
    """The thesis's own way: its scheme, RK4, its dt."""
    scheme, method, dt = data["thesis"]
    return at(data["impulse"]["records"], scheme, dt, method)


def whole_at(data: Record, dt: float) -> list[Record]:
    """All schemes that remember the whole past, at one step."""
    whole = [r for r in stepped(data["impulse"]["records"]) if r["family"] == WHOLE or r["scheme"] in ("Exponential(1)", "Exponential(2)", "Exponential(3)")]
    return [r for r in whole if abs(r["size"] / dt - 1.0) < 1e-9]


def shared_step(data: Record) -> float:
    """The finest step that every scheme with the whole past has flown."""
    whole = [r for r in stepped(data["impulse"]["records"]) if r["family"] == WHOLE]
    by_scheme: dict[str, set[float]] = {}
    for r in whole:
        by_scheme.setdefault(named(r), set()).add(r["size"])
    return min(set.intersection(*by_scheme.values()))


def loosest(data: Record) -> Record:
    """Collocation at its loosest tolerance, rebounds remembered."""
    return max(collocated(data["impulse"]["records"]), key=lambda r: r["size"])


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    found = data["scenes"]
    records = found["impulse"]["records"]
    ours, best = loosest(found), least(stepped(records), "height")
    coarse = fastest(stepped(records), BOUNDS[0], "height")[0] or best
    dt = shared_step(found)
    whole = whole_at(found, dt)
    errors = [abs(r["height"]["bias"]) for r in whole]
    times = [r["seconds"] for r in whole]
    reset = least(stepped(found["reset"]["records"]), "height")
    return fill(
        "scenes_opening.md",
        rtol=short(ours["size"]),
        error=percent(max(upper(ours, name) for name in QUANTITIES)),
        time=seconds(ours["seconds"]),
        coarse=sized(coarse),
        coarse_error=percent(max(BOUNDS[0], counted(coarse, "height"))),
        coarse_ratio=factor(coarse["seconds"] / ours["seconds"]),
        best_error=percent(counted(best, "height")),
        best=sized(best),
        best_ratio=factor(best["seconds"] / ours["seconds"]),
        dt=figures.step(dt),
        low=percent(min(errors)),
        high=percent(max(errors)),
        dearest=factor(max(times) / min(times)),
        reset_error=percent(counted(reset, "height")),
        reset_ratio=factor(reset["seconds"] / fastest(collocated(found["reset"]["records"]), counted(reset, "height"), "height")[0]["seconds"]),
        one=percent(floor(records, "Daitche(2), window 1")),
        ten=percent(floor(records, "Daitche(2), window 10")),
        published=percent(floor(records, "Hinsberg, window 0.5")),
        fitted=percent(floor(records, "Daitche(2), window 0.1, fitted tail")),
        common=figures.step(COMMON),
        window_time=factor(at(records, "Daitche(2), window 1", COMMON)["seconds"] / at(records, "Exponential(2)", COMMON)["seconds"]),
    )


def ratios(data: Record) -> list[float]:
    """Time of the quickest fixed steps over collocation's for every error that both reach."""
    found = []
    for memory in MEMORIES:
        records = data[memory]["records"]
        for quantity in QUANTITIES:
            for bound in BOUNDS:
                ours, theirs = fastest(collocated(records), bound, quantity)[0], fastest(stepped(records), bound, quantity)[0]
                if ours and theirs:
                    found.append(theirs["seconds"] / ours["seconds"])
    return found


def reached(data: Record, memory: str, quantity: str, own: bool) -> int:
    """How many of the wanted errors are reached."""
    records = data[memory]["records"]
    group = collocated(records) if own else stepped(records)
    return sum(fastest(group, bound, quantity)[0] is not None for bound in BOUNDS)


def targets(data: Record) -> list[Target]:
    """What was asked of this comparison, beside what was measured."""
    records = data["impulse"]["records"]
    schemes = {r["history"].get("scheme", "exponential") for r in flown(records)}
    rows = [Target("history schemes of `basset.SCHEMES` that fly", f"all {len(basset.SCHEMES)}", str(len(schemes)), schemes == set(basset.SCHEMES))]
    solvers = {r["method"] for r in flown(records)}
    rows.append(Target("solvers", "all 3", str(len(solvers)), len(solvers) == 3))
    lost = sum(r["height"] is None for key in MEMORIES for r in data[key]["records"])
    rows.append(Target("runs that did not arrive", "0", str(lost), lost == 0))
    apart = max(data[key]["reference_apart"] for key in MEMORIES)
    rows.append(
        Target(f"truth at rtol {short(data['reference'])} against ten times that, the jump that changes most", "≤ 1e-8", short(apart, 1), apart <= 1e-8)
    )
    got = sum(reached(data, key, name, True) for key in MEMORIES for name in QUANTITIES)
    total = len(MEMORIES) * len(QUANTITIES) * len(BOUNDS)
    rows.append(Target("wanted errors (two memories, two means, five sizes) that collocation reaches", f"all {total}", str(got), got == total))
    smallest = min(ratios(data))
    what = "quickest fixed steps over collocation, where both reach the error"
    rows.append(Target(what, "≥ 1 ×, always", f"{factor(smallest)} × at least, {factor(max(ratios(data)))} × at most", smallest >= 1.0))
    told = [not scatters(r, name) for key in MEMORIES for r in stepped(data[key]["records"]) for name in QUANTITIES]
    rows.append(Target("errors at fixed steps that stand out of their scatter", "nearly all", f"{sum(told)} of {len(told)}", sum(told) >= 0.9 * len(told)))
    return rows


def scenes(data: dict[str, Record]) -> str:
    """The page reports/scenes.md."""
    found = data["scenes"]
    records, reset = found["impulse"]["records"], found["reset"]["records"]
    rows, ours, thesis = targets(found), loosest(found), thesis_record(found)
    fixed_best = fastest(stepped(records), BOUNDS[0], "height")[0] or least(stepped(records), "height")
    tightest = fastest(collocated(records), BOUNDS[-1], "height")[0] or ours
    lucky, apart = luckiest(records), solvers_apart(records)
    shipped = of(collocated(records), size=SHIPPED)[0]
    return fill(
        "scenes.md",
        opening=opening(data),
        jumps=found["jumps"],
        discard=found["discard"],
        seeds=found["seeds"],
        short=found["short"],
        reference=short(found["reference"]),
        truth=short(max(found[key]["reference_apart"] for key in MEMORIES), 1),
        unpaired=percent(found["impulse"]["unpaired_se"]["height"] / math.sqrt(found["seeds"])),
        paired=percent(at(records, "Exponential(2)", COMMON)["height"]["se"]),
        paired_at=sized(at(records, "Exponential(2)", COMMON)),
        figure_accuracy=save(figures.accuracy(found, "impulse"), "scenes_accuracy"),
        figure_reset=save(figures.accuracy(found, "reset"), "scenes_reset"),
        figure_windows=save(figures.windows(found), "scenes_windows"),
        cheapest_height=cheapest_table(records, "height"),
        cheapest_length=cheapest_table(records, "length"),
        reset_height=cheapest_table(reset, "height"),
        reset_length=cheapest_table(reset, "length"),
        toml_winner=toml(tightest),
        winner_bound=percent(BOUNDS[-1]),
        toml_fixed=toml(fixed_best),
        fixed_bound=percent(max(BOUNDS[0], counted(fixed_best, "height"))),
        thesis=sized(thesis),
        thesis_height=percent(abs(thesis["height"]["bias"])),
        thesis_length=percent(abs(thesis["length"]["bias"])),
        thesis_time=seconds(thesis["seconds"]),
        thesis_ratio=factor(thesis["seconds"] / ours["seconds"]),
        windows=window_table(records),
        windows_reset=window_table(reset),
        lucky=sized(lucky),
        lucky_bias=percent(abs(lucky["height"]["bias"])),
        lucky_cut=signed(lucky["truncation"]["height"]["bias"]),
        lucky_step=signed(lucky["height"]["bias"] - lucky["truncation"]["height"]["bias"]),
        solvers_error=f"{apart[0]:.2f}",
        solvers_worst=f"{apart[1]:.2f}",
        solvers_time=f"{apart[2]:.2f}",
        shipped=short(shipped["size"]),
        shipped_ratio=factor(shipped["seconds"] / ours["seconds"]),
        shipped_single=f"{small(shipped['height']['rms'])} %",
        single=f"{small(ours['height']['rms'])} %",
        every=every_table(records),
        every_reset=every_table(reset),
        collocation=collocation_table(found),
        near=NEAR,
        targets=asked(rows),
        met=f"{sum(row.met for row in rows)} of {len(rows)} are met.",
        footer=footer({name: data[name] for name in SUITES}),
    )
