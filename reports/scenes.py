"""The page reports/scenes.md: which scheme, window, solver and step give mean jumps to a wanted error in the least time."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import BLACK, BLUE, BROWN, GREEN, GREY, ORANGE, PINK, PURPLE, RED, SKY, YELLOW
from basset._look import slope as _slope
from reports.site.page import Page, fill, finished, footer, save, table
from reports.words import NEAR, Record, factor, of, percent, reaches, seconds, short
from saltation.scene.memory import REASONS

SUITES = ("scenes",)
COLLOCATION, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
STEPPED = {IMPLICIT: "implicit", HELD: "RK4"}
WHOLE, DROPPED, PUBLISHED, FITTED, SUMS = "whole past", "window, no tail", "window, published tail", "window, fitted tail", "exponentials"
QUANTITIES = ("height", "length")
SHIPPED = 1e-5  # rtol of the scene as it is
COMMON = 1e-3  # dt of comparisons, d/u*
BOUNDS = (0.1, 0.03, 0.01, 0.003, 0.001)
MEMORIES = {"impulse": "rebounds remembered", "reset": "history wiped at impacts"}
KERNELS = {"mei_adrian": "Mei & Adrian's kernel", "dorgan_loth": "Dorgan & Loth's kernel"}


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
    return f"{named(record)}, {'rtol' if record['method'] == COLLOCATION else 'dt'} {step_of(record['size'])}"


def ladders(records: Sequence[Record], quantity: str) -> dict[str, list[Record]]:
    """Records by scheme and solver, from coarse to fine, with the error that decides."""
    found: dict[str, list[Record]] = {}
    for r in sorted(flown(records), key=lambda r: -r["size"]):
        found.setdefault(named(r), []).append(r | {"error": counted(r, quantity)})
    return found


def fastest(records: Sequence[Record], bound: float, quantity: str) -> tuple[Record | None, list[Record]]:
    """The quickest record within an error that is kept by all finer steps too, and others as quick to a factor that timing cannot tell apart."""
    reached = [reaches(rows, bound, "error") for rows in ladders(records, quantity).values()]
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
    step = f"rtol = {short(record['size'])}" if record["method"] == COLLOCATION else f"dt = {step_of(record['size'])}            # d/u*"
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
    return table(["% of height / of length, time, dt =", *(step_of(step) for step in steps)], rows)


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
    head = [*(f"height, dt = {step_of(step)}" for step in steps), "length, its finest dt", "height: error of the step there"]
    return table(["truncation alone, %", *head], rows)


def kept_jumps(records: Sequence[Record]) -> list[Record]:
    """Collocation whose memory holds some jumps."""
    return [r for r in flown(records) if "window_jumps" in r["history"] and r["method"] == COLLOCATION]


def thesis_table(records: Sequence[Record]) -> str:
    """The semi-derivative with RK4 and a memory of some jumps, beside collocation with the same."""
    own = [r for r in flown(records) if r["history"].keys() == {"scheme", "window_jumps"} and r["method"] == HELD]
    sizes, rows = sorted({r["size"] for r in own}, reverse=True), []
    for r in kept_jumps(records):
        found = {x["size"]: x for x in own if x["history"]["window_jumps"] == r["history"]["window_jumps"]}
        if len(found) > 1:
            coarse, fine = (found[size] for size in sorted(found, reverse=True)[-2:])
            root = math.sqrt(coarse["size"] / fine["size"])
            limit = (root * fine["height"]["bias"] - coarse["height"]["bias"]) / (root - 1.0)
            cells = [error_cell(found[size], "height") if size in found else "" for size in sizes]
            rows.append([str(r["history"]["window_jumps"]), *cells, signed(limit), error_cell(r, "height")])
    if not rows:
        return "not measured yet"
    return table(["jumps remembered", *(f"dt {step_of(size)}" for size in sizes), "dt → 0, as √dt", "collocation"], rows)


def combination_table(rows: Sequence[Record]) -> str:
    """Forms of the history against kernels and solvers: what a scene accepts, and by which reason it refuses."""
    letters = {reason: key for key, reason in zip("gwshp", REASONS.values(), strict=True)}
    columns = [key for key in rows[0] if key != "form"]

    def cell(refusal: str) -> str:
        return next(letter for reason, letter in letters.items() if reason in refusal) if refusal else "yes"

    text = table(["", *columns], [[row["form"], *(cell(row[key]) for key in columns)] for row in rows])
    return text + "\n\n" + "\n".join(f"* {letter}: {reason}." for reason, letter in letters.items())


def counted_combinations(rows: Sequence[Record]) -> tuple[int, int]:
    """How many there are, and how many are accepted."""
    said = [row[key] for row in rows for key in row if key != "form"]
    return len(said), said.count("")


def kernel_section(data: Record, kernel: str) -> str:
    """Figure and tables of one kernel that follows the slip."""
    found = data[kernel]
    records = found["records"]
    ours, best = fastest(collocated(records), BOUNDS[-1], "height")[0] or collocated(records)[-1], fastest(stepped(records), BOUNDS[1], "height")[0]
    kept = f"Collocation, rtol {short(ours['size'])}, keeps {percent(BOUNDS[-1])} of it for {seconds(ours['seconds'])} per jump"
    steps = "no fixed steps that were flown keep it"
    if best is not None:
        steps = f"the quickest fixed steps ({sized(best)}) take {seconds(best['seconds'])} for {percent(BOUNDS[1])}"
    text = f"Mean height {found['mean']['height']:.3f} d ({found['flown']} seed{'s' if found['flown'] > 1 else ''}). {kept}; {steps}."
    parts = [f"### {KERNELS[kernel]}", text, save(draw_accuracy(data, kernel), f"scenes_{kernel}"), cheapest_table(records, "height"), every_table(records)]
    return "\n\n".join(parts)


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


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    found = data["scenes"]
    records = found["impulse"]["records"]
    ours, best = loosest(found), least(stepped(records), "height")
    coarse = fastest(stepped(records), BOUNDS[0], "height")[0] or best
    dt = shared_step(found)
    whole = whole_at(found, dt)
    errors = [abs(r["height"]["bias"]) for r in whole]
    times = [r["seconds"] for r in whole]
    return {
        "ours": ours,
        "error": percent(max(upper(ours, name) for name in QUANTITIES)),
        "coarse_error": percent(max(BOUNDS[0], counted(coarse, "height"))),
        "coarse_ratio": factor(coarse["seconds"] / ours["seconds"]),
        "dt": step_of(dt),
        "low": percent(min(errors)),
        "high": percent(max(errors)),
        "dearest": factor(max(times) / min(times)),
        "one": percent(floor(records, "Daitche(2), window 1")),
        "published": percent(floor(records, "Hinsberg, window 0.5")),
        "fitted": percent(floor(records, "Daitche(2), window 0.1, fitted tail")),
    }


def scenes(data: dict[str, Record]) -> str:
    """The page reports/scenes.md."""
    found = data["scenes"]
    records, reset = found["impulse"]["records"], found["reset"]["records"]
    ours, thesis = loosest(found), thesis_record(found)
    fixed_best = fastest(stepped(records), BOUNDS[0], "height")[0] or least(stepped(records), "height")
    tightest = fastest(collocated(records), BOUNDS[-1], "height")[0] or ours
    lucky, apart = luckiest(records), solvers_apart(records)
    shipped = of(collocated(records), size=SHIPPED)[0]
    return fill(
        "scenes.md",
        found=found,
        **opening(data),
        truth=short(max(found[key]["reference_apart"] for key in MEMORIES), 1),
        unpaired=percent(found["impulse"]["unpaired_se"]["height"] / math.sqrt(found["seeds"])),
        paired=percent(at(records, "Exponential(2)", COMMON)["height"]["se"]),
        paired_at=sized(at(records, "Exponential(2)", COMMON)),
        figure_accuracy=save(draw_accuracy(found, "impulse"), "scenes_accuracy"),
        figure_reset=save(draw_accuracy(found, "reset"), "scenes_reset"),
        figure_windows=save(draw_windows(found), "scenes_windows"),
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
        thesis_jumps=thesis_table(records),
        **dict(zip(("combined", "accepted"), counted_combinations(found["combinations"]), strict=True)),
        **dict(zip(("listed", "kept"), counted_combinations([r for r in found["combinations"] if "newton" not in r["form"]]), strict=True)),
        combinations=combination_table(found["combinations"]),
        kernels="\n\n".join(kernel_section(found, kernel) for kernel in KERNELS if kernel in found) or "not measured yet",
        every=every_table(records),
        every_reset=every_table(reset),
        collocation=collocation_table(found),
        near=NEAR,
        footer=footer({name: data[name] for name in SUITES}),
    )


# Figures, from the records alone

LOOKS: dict[str, tuple[str, str, str]] = {  # colour, marker, label
    "semi-derivative": (YELLOW, "v", "semi-derivative, whole past"),
    "Euler–Maclaurin": (BLACK, "x", "Euler–Maclaurin, whole past"),
    "Brush": (GREY, "+", "Brush, whole past"),
    "Daitche(1)": (ORANGE, "o", "Daitche(1), whole past"),
    "Daitche(2)": (GREEN, "^", "Daitche(2), whole past"),
    "Daitche(3)": (BLUE, "D", "Daitche(3), whole past"),
    "Hinsberg, window 0.5": (RED, "s", "Hinsberg, published tail"),
    "Daitche(2), window 0.1, fitted tail": (PINK, "X", "window 0.1, fitted tail"),
    "Exponential(3)": (SKY, "P", "Exponential(3)"),
}
WINDOWED = "Daitche(2), window {:g}"
THEIRS = BROWN  # windows without a tail
FLOORS = (0.1, 0.3, 1.0, 10.0)  # those that are shown
BOTTOM = 1e-4  # per cent: collocation goes on below
CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}  # behind labels that lines would cross
TITLES = {"height": "mean height", "length": "mean length"}


def step_of(size: float) -> str:
    """A step or tolerance, short: 0.004, 2.5e-4."""
    if size >= 1e-3 and abs(size * 1e3 - round(size * 1e3)) < 1e-9 and size < 1.0:
        return f"{size:g}"
    digits = next(k for k in range(4) if abs(float(f"{size:.{k}e}") / size - 1.0) < 1e-9)
    return short(size, digits)


def _known(found: Record) -> tuple[float, bool]:
    """(error in per cent, whether it stands out of its scatter); an upper bound where it does not."""
    bias, se = abs(found["bias"]), found["se"]
    return 100.0 * (bias if bias > se else bias + 2.0 * se), bias > se


def _points(records: list[Record], quantity: str) -> list[tuple[float, float, bool]]:
    """(time in µs, error in per cent, whether it stands out) by falling step."""
    return [(1e6 * r["seconds"], *_known(r[quantity])) for r in sorted(records, key=lambda r: -r["size"])]


def _line(axes: Any, points: list[tuple[float, float, bool]], colour: str, marker: str, dash: str = "-", **more: Any) -> None:
    """A line, with hollow markers where the error is no more than an upper bound."""
    axes.loglog([x for x, _, _ in points], [y for _, y, _ in points], dash, color=colour, marker=marker, **more)
    bounds = [(x, y) for x, y, known in points if not known]
    axes.plot([x for x, _ in bounds], [y for _, y in bounds], marker, color=colour, markerfacecolor="white", zorder=6)


def _floors(axes: Any, records: list[Record], quantity: str) -> None:
    """Windows without a tail, each labelled by its length."""
    for w in FLOORS:
        own = [r for r in records if r["scheme"] == WINDOWED.format(w) and r["method"] == IMPLICIT]
        if not own:
            continue
        points = _points(own, quantity)
        _line(axes, points, THEIRS, ".", linewidth=1.0, label="window without a tail, length in d/u*" if w == 1.0 else None)
        axes.annotate(f"{w:g}", points[-1][:2], xytext=(5, 0), textcoords="offset points", color=THEIRS, fontsize=9, va="center", bbox=CLEAR)
        lucky = min(own, key=lambda r: abs(r[quantity]["bias"]))
        if lucky["truncation"] is not None and abs(lucky[quantity]["bias"]) < 0.25 * abs(lucky["truncation"][quantity]["bias"]):
            where = (1e6 * lucky["seconds"], _known(lucky[quantity])[0])
            axes.annotate(
                "step and window\ncancel by chance", where, xytext=(0, -8), textcoords="offset points", color=THEIRS, fontsize=8, ha="center", va="top"
            )


def _collocation(axes: Any, records: list[Record], quantity: str) -> None:
    """The collocation, down to the end of the axis; how far it goes beyond in words."""
    own = sorted((r for r in records if r["scheme"] == COLLOCATION), key=lambda r: -r["size"])
    points = _points(own, quantity)
    _line(axes, points, PURPLE, "*", markersize=10, linewidth=2.4, label="collocation", zorder=5)
    for k, (r, (x, y, _)) in enumerate(zip(own, points, strict=True)):
        if y > BOTTOM:
            near = k > 0 and abs(np.log10(y / points[k - 1][1])) < 0.2  # the next label above or below would be covered
            text = ("rtol " if k == 0 else "") + short(r["size"])
            left = {"xytext": (9, 4), "ha": "left"} if near else {"xytext": (-9, 0), "ha": "right"}
            axes.annotate(text, (x, y), textcoords="offset points", va="center", color=PURPLE, fontsize=9, **left)
    text = f"on to {points[-1][1]:.0e} %\n(rtol {short(own[-1]['size'])}, {points[-1][0]:.0f} µs)".replace("e-0", "e-")
    shown = max(x for x, y, _ in points if y > BOTTOM)
    axes.annotate(text, (2.0 * shown, BOTTOM), xytext=(0, 16), textcoords="offset points", color=PURPLE, fontsize=9)


def draw_accuracy(data: Record, memory: str) -> Any:
    """Error of the mean jump against time per jump, implicit steps."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 7.6), sharey=True)
    records = [r for r in data[memory]["records"] if r["height"] is not None]
    scheme, method, dt = data["thesis"]
    thesis = [r for r in records if (r["scheme"], r["method"]) == (scheme, method) and np.isclose(r["size"], dt)]
    for axes, quantity in zip(panels, TITLES, strict=True):
        _floors(axes, records, quantity)
        for name, (colour, marker, label) in LOOKS.items():
            own = [r for r in records if r["scheme"] == name and r["method"] == IMPLICIT]
            if own:
                _line(axes, _points(own, quantity), colour, marker, label=label, linewidth=1.2)
        _collocation(axes, records, quantity)
        for r in thesis:
            where, up = (1e6 * r["seconds"], _known(r[quantity])[0]), (0, 26)
            arrow = {"arrowstyle": "-", "color": "#444444", "linewidth": 0.8}
            text = f"the thesis's way\n(RK4, dt {dt:g})"
            axes.annotate(text, where, xytext=up, textcoords="offset points", ha="center", color="#444444", fontsize=9, arrowprops=arrow)
        axes.set(title=TITLES[quantity], xlabel="CPU time per jump, one core (µs)", ylim=(BOTTOM, 1.5e2))
    low, high = panels[0].get_xlim()
    for axes in panels:
        axes.set_xlim(low / 2.5, 1.5 * high)
        _slope(axes, *((7e2, 2.2, 3e4, -0.5, "t$^{-1/2}$") if memory != "reset" else (3e2, 0.35, 1.6e4, -1.0, "t$^{-1}$")), "right")
    panels[0].set_ylabel("error of the mean (%)")
    titles = {
        "impulse": "Rebounds remembered: fixed steps err as √dt whatever the scheme, a window without a tail adds a floor; collocation does neither",
        "reset": "Memory wiped at rebounds: fixed steps are of first order, windows shorter than a flight keep a floor, collocation stays far below",
        **{kernel: f"{name}, of the current slip: fixed steps err as √dt, collocation stays far below" for kernel, name in KERNELS.items()},
    }
    return finished(figure, panels[0], 4, titles[memory])


def _pieces(points: list[tuple[float, Record]]) -> list[list[tuple[float, float, bool]]]:
    """Truncation against the window, cut where its sign changes: the logarithm of its size would join what passes through zero."""
    pieces: list[list[tuple[float, float, bool]]] = []
    sign = 0.0
    for x, found in points:
        value, known = _known(found)
        if not pieces or (known and sign and np.sign(found["bias"]) != sign):
            pieces.append([])
        pieces[-1].append((x, value, known))
        sign = np.sign(found["bias"]) if known else sign
    return pieces


def draw_windows(data: Record) -> Any:
    """What a cut memory does by itself, against the window: dropped, published tail, fitted tail."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.0), sharey=True)
    records = [r for r in data["impulse"]["records"] if r["height"] is not None]
    duration, steps = data["impulse"]["duration"], {4e-3: ":", 1e-3: "-"}
    groups = (
        ("no tail", THEIRS, "o", DROPPED, "Daitche"),
        ("published tail (Hinsberg)", RED, "s", "window, published tail", "Hinsberg"),
        ("fitted tail, rtol 1e-6", PINK, "X", "window, fitted tail", "Daitche"),
    )
    for axes, quantity in zip(panels, TITLES, strict=True):
        for name, colour, marker, family, rule in groups:
            for dt, dash in steps.items():
                own = [r for r in records if r["family"] == family and r["scheme"].startswith(rule) and r["method"] == IMPLICIT and np.isclose(r["size"], dt)]
                points = sorted(((r["history"]["window"], r["truncation"][quantity]) for r in own if r["truncation"] is not None), key=lambda pair: pair[0])
                for k, piece in enumerate(_pieces(points)):
                    _line(axes, piece, colour, marker, dash, label=name if dash == "-" and k == 0 else None)
        kept = kept_jumps(records)
        for piece in _pieces([(duration * r["history"]["window_jumps"], r[quantity]) for r in kept]):
            _line(axes, piece, PURPLE, "*", label="no tail, memory of 1 to 50 whole jumps (collocation: the step does not err)", markersize=9)
        for dt, dash in steps.items():
            level = _known(next(r for r in records if (r["scheme"], r["method"]) == ("Exponential(2)", IMPLICIT) and np.isclose(r["size"], dt))[quantity])[0]
            axes.axhline(level, color="#999999", linewidth=0.9, linestyle=dash, zorder=1)
            text = f"error of the step at dt {step_of(dt)}"
            axes.annotate(
                text, (1.0, level), xycoords=("axes fraction", "data"), xytext=(-2, 2), textcoords="offset points", ha="right", color="#666666", fontsize=8
            )
        for r in records:
            if r["scheme"] in (WINDOWED.format(0.1), WINDOWED.format(30.0)) and r["method"] == IMPLICIT and np.isclose(r["size"], 1e-3):
                found = r["truncation"][quantity]
                where = (r["history"]["window"], 100.0 * abs(found["bias"]))
                text = "too high" if quantity == "height" else "too long"
                text = text if found["bias"] > 0.0 else {"height": "too low", "length": "too short"}[quantity]
                axes.annotate(text, where, xytext=(8, 2 if found["bias"] > 0.0 else -14), textcoords="offset points", color=THEIRS, fontsize=9)
        axes.set(title=TITLES[quantity], xlabel=f"window (d/u*); a jump lasts {duration:.1f}")
    panels[0].set_ylabel("error by the cut memory alone (%)")
    panels[0].plot([], [], ":", color="#666666", marker="o", label="the same at dt 0.004")
    panels[0].plot([], [], "o", color="#666666", markerfacecolor="white", linestyle="", label="within its scatter: upper bound")
    return finished(figure, panels[0], 3, "What a window drops no step brings back; a tail does")


PAGE = Page("scenes", scenes, SUITES)
