"""The page reports/advice.md: whether the advised scheme is accurate enough, and how far it is from the fastest."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREEN, RED
from basset._look import legend as _legend
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped, short

MOST = 1.5  # times the fastest that really meets
STEPS = {"chosen": "dt chosen too", "given": "dt given"}


def missed(rows: Sequence[Record]) -> list[Record]:
    """What is slower than it may be, the worst first."""
    return sorted((row for row in rows if row["ratio"] > MOST), key=lambda row: -row["ratio"])


def within(rows: Sequence[Record]) -> str:
    """How many are fast enough."""
    return f"{len(rows) - len(missed(rows))} of {len(rows)} within"


def schemes(rows: Sequence[Record], error: float) -> str:
    """One cell: what a stream and a path were advised, the true errors, the times over the fastest."""
    cells = []
    for use in ("stream", "path"):
        found = where(rows, use=use, error=error)
        cells += [
            f"{row['scheme'].replace('Exponential', 'Exp')} × {grouped(row['steps'])}, {short(row['measured'], 1)}, {slow(row['ratio'])}" for row in found
        ]
        cells += [] if found else ["refused"]
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
    return table(["problem", "given", *(f"error {short(error)}" for error in errors)], lines)


def groups(rows: Sequence[Record]) -> str:
    """Ratios by use, step and what was given."""
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
    head = ["given", "step", "use", "cases", "largest true error / asked", "time / fastest, median", "largest", f"above {MOST:g}"]
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


def refusals(refused: Sequence[Record]) -> str:
    """The clause for cases in which nothing is predicted to keep the error at the step given."""
    if not refused:
        return ""
    return f", {len(refused)} were refused"


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    rows = data["advice"]["rows"]
    ratios = [row["ratio"] for row in rows]
    found = missed(rows)
    return dict(
        problems=len({row["case"].split(",")[0] for row in rows}),
        cases=len(rows),
        met=sum(row["meets"] for row in rows),
        refused=refusals(data["advice"].get("refused", [])),
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
    predicted = [row["predicted_seconds"] / row["seconds"] for row in rows]
    return fill(
        "advice.md",
        **opening(data),
        figure=save(draw_ratios(rows, MOST), "advice_ratios"),
        groups=groups(rows),
        chosen_steps=advised(own, "chosen"),
        given_table=advised(own, "given"),
        given_steps=factor(1.0 / own["given"]),
        misses=misses(rows),
        low=f"{sorted(predicted)[len(predicted) // 20]:.2f}",
        high=f"{sorted(predicted)[-1 - len(predicted) // 20]:.2f}",
        footer=footer({"advice": own}),
    )


# Figures, from the records alone

COLOURS = {1e-3: GREEN, 1e-6: BLUE, 1e-9: RED}
MARKERS = {("stream", "chosen"): "o", ("path", "chosen"): "s", ("stream", "given"): "x", ("path", "given"): "+"}


def where(rows: Sequence[Record], **fields: Any) -> list[Record]:
    """The rows with these values."""
    return [row for row in rows if all(row[name] == value for name, value in fields.items())]


def draw_ratios(rows: Sequence[Record], most: float) -> Any:
    """Time of the advised scheme over the fastest that really meets, per problem and accuracy."""
    figure, axes = plt.subplots(figsize=(10.0, 5.4))
    names = list(dict.fromkeys(row["case"] for row in rows))
    for i, (error, colour) in enumerate(COLOURS.items()):
        for (use, step), marker in MARKERS.items():
            own = [row for row in where(rows, use=use, step=step) if abs(row["error"] / error - 1.0) < 1e-6]
            places = [names.index(row["case"]) + 0.22 * (i - 1) for row in own]
            axes.semilogy(places, [row["ratio"] for row in own], marker, color=colour, label=f"{short(error)}, {use}, dt {step}")
    axes.axhline(most, color="#999999", linestyle=":")
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right")
    ticks = (1.0, 1.2, 1.5, 2.0, 3.0)
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set(ylabel="time / time of the fastest that meets the error", title="The advised scheme against the fastest that meets the error asked for")
    _legend(figure, axes, 3)
    return figure


PAGE = Page("advice", advice, ("advice",))
