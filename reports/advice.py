"""The page reports/advice.md: whether the scheme that is advised is exact enough, and how far it is from the fastest."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from reports import advice_figures as figures
from reports.advice_figures import where
from reports.analysis import Record, Target, short
from reports.page import asked, factor, fill, footer, grouped, save, table

MOST = 1.5  # times the fastest that really meets
STEPS = {"chosen": "dt chosen too", "given": "dt given"}


def missed(rows: Sequence[Record]) -> list[Record]:
    """What is slower than it may be, the worst first."""
    return sorted((row for row in rows if row["ratio"] > MOST), key=lambda row: -row["ratio"])


def targets(rows: Sequence[Record]) -> list[Target]:
    """What was asked, beside what was measured."""
    problems = len({row["case"].split(",")[0] for row in rows})
    worst = max(row["measured"] / row["error"] for row in rows)
    found = [
        Target("problems not used for calibration × accuracies", "≥ 12 × 3", f"{problems} × {len({row['error'] for row in rows})}", problems >= 12),
        Target("true error over the error asked for", "≤ 1, always", f"{worst:.2f} at worst", worst <= 1.0),
    ]
    for step, label in STEPS.items():
        own = where(rows, step=step)
        slowest = max(row["ratio"] for row in own)
        found.append(
            Target(f"time over the fastest that really meets, {label}", f"≤ {MOST:g}, always", f"{slowest:.2f} at worst, {within(own)}", slowest <= MOST)
        )
    return found


def within(rows: Sequence[Record]) -> str:
    """How many are fast enough."""
    return f"{len(rows) - len(missed(rows))} of {len(rows)} within"


def schemes(rows: Sequence[Record], error: float) -> str:
    """One cell: what a stream and a path were advised, the true errors, the times over the fastest."""
    cells = []
    for use in ("stream", "path"):
        row = where(rows, use=use, error=error)[0]
        cells.append(f"{row['scheme'].replace('Exponential', 'Exp')} × {grouped(row['steps'])}, {short(row['measured'], 1)}, {slow(row['ratio'])}")
    return "<br>".join(cells)


def slow(ratio: float) -> str:
    """A ratio; bold where it is too large."""
    return f"{ratio:.2f}" if ratio <= MOST else f"**{ratio:.2f}**"


def advised(data: Record, step: str) -> str:
    """All problems with one kind of step."""
    rows = where(data["rows"], step=step)
    errors = sorted({row["error"] for row in rows}, reverse=True)
    lines = []
    for name in data["descriptions"]:
        own = where(rows, case=name)
        if own:
            lines.append([data["descriptions"][name], own[0]["told"], *(schemes(own, error) for error in errors)])
    return table(["problem", "told", *(f"asked: {short(error)}" for error in errors)], lines)


def groups(rows: Sequence[Record]) -> str:
    """Ratios by use, step and what was told."""
    lines = []
    for told in ("time scale", "samples"):
        for step, label in STEPS.items():
            for use in ("stream", "path"):
                own = where(rows, told=told, step=step, use=use)
                ratios = [row["ratio"] for row in own]
                errors = [row["measured"] / row["error"] for row in own]
                lines.append(
                    [told, label, use, str(len(own)), f"{max(errors):.2f}", f"{statistics.median(ratios):.2f}", f"{max(ratios):.2f}", str(len(missed(own)))]
                )
    head = ["told", "step", "use", "cases", "true error / asked, largest", "time / fastest, median", "largest", f"above {MOST:g}"]
    return table(head, lines)


def misses(rows: Sequence[Record]) -> str:
    """What is too slow, in words."""
    found = missed(rows)
    if not found:
        return f"None is above {MOST:g}."
    lines = [
        f"* {row['case']}, {short(row['error'])}, {row['use']}, {STEPS[row['step']]}: {row['scheme']} × {grouped(row['steps'])}, {row['ratio']:.2f} times "
        f"{row['fastest']} × {grouped(row['fastest_steps'])} ({1e3 * row['seconds']:.2g} ms against {1e3 * row['seconds'] / row['ratio']:.2g} ms)"
        for row in found
    ]
    return f"Above {MOST:g}:\n\n" + "\n".join(lines)


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    rows = data["advice"]["rows"]
    ratios = [row["ratio"] for row in rows]
    found = missed(rows)
    return fill(
        "advice_opening.md",
        problems=len({row["case"].split(",")[0] for row in rows}),
        cases=len(rows),
        met=sum(row["meets"] for row in rows),
        worst=f"{max(row['measured'] / row['error'] for row in rows):.2f}",
        **{step: len(where(rows, step=step)) for step in STEPS},
        **{f"{step}_within": len(where(rows, step=step)) - len(where(found, step=step)) for step in STEPS},
        most=f"{MOST:g}",
        median=f"{statistics.median(ratios):.2f}",
        slowest=f"{max(ratios):.2f}",
        sampled=len(missed(where(rows, told="samples"))),
        scaled=len(missed(where(rows, told="time scale"))),
        longest=f"{1e3 * max((row['seconds'] for row in found), default=0.0):.2g}",
    )


def advice(data: dict[str, Record]) -> str:
    """The page reports/advice.md."""
    own = data["advice"]
    rows = own["rows"]
    wanted = targets(rows)
    predicted = [row["predicted_seconds"] / row["seconds"] for row in rows]
    return fill(
        "advice.md",
        opening=opening(data),
        figure=save(figures.ratios(rows, MOST), "advice_ratios"),
        groups=groups(rows),
        chosen=advised(own, "chosen"),
        given=advised(own, "given"),
        given_steps=factor(1.0 / own["given"]),
        misses=misses(rows),
        low=f"{sorted(predicted)[len(predicted) // 20]:.2f}",
        high=f"{sorted(predicted)[-1 - len(predicted) // 20]:.2f}",
        targets=asked(wanted),
        met=f"{sum(row.met for row in wanted)} of {len(wanted)} are met.",
        footer=footer({"advice": own}),
    )
