"""The history force at an impact."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLACK, BLUE, GREY, RED
from reports.saltation.records import number, ticks
from reports.site.page import save, table
from reports.words import Record, grouped, of, signed, span

BARE = "no history"
REMEMBERING = ("remembered", "restarted", "Mei–Adrian: remembered", "Mei–Adrian: restarted", "Dorgan–Loth: remembered", "Dorgan–Loth: restarted")
IGNORING = ("jump ignored, 1 jump", "Mei–Adrian: jump ignored, 1 jump", "Dorgan–Loth: jump ignored, 1 jump")
SLIP_FORGOTTEN = ("wiped", *IGNORING)
KEPT_BY = 3.0  # standard errors within which the prototype's numbers have to lie


def heights(data: Record, case: int) -> dict[str, float]:
    """Mean heights of one case by memory."""
    return {row["name"]: row["height"]["mean"] for row in of(data["memory"]["records"], case=case)}


def shortening(data: Record, reynolds: int, names: Sequence[str]) -> list[float]:
    """By how many per cent these memories shorten the jumps (negative: lengthen), in every case of an R_p."""
    found = []
    for case, about in enumerate(data["memory"]["cases"]):
        if about["particle_reynolds"] == reynolds:
            here = heights(data, case)
            found += [100.0 * (1.0 - here[name] / here[BARE]) for name in names]
    return found


def deviation(row: Record) -> float | None:
    """Difference from the prototype in standard errors of both."""
    if row["prototype"] is None:
        return None
    return float((row["height"]["mean"] - row["prototype"]) / math.hypot(row["height"]["se"], row["prototype_error"]))


def case_title(about: Record) -> str:
    """A case in words."""
    return f"R_p {about['particle_reynolds']}, T {about['stage']:g}, {about['reading']} + {about['profile'].capitalize()}"


def memory_table(data: Record) -> str:
    """Mean heights by memory, the prototype's beside them."""
    cases = data["memory"]["cases"]
    rows: dict[str, list[str]] = {}
    for row in sorted(data["memory"]["records"], key=lambda row: row["case"]):
        apart = deviation(row)
        beside = "" if apart is None else f" ({row['prototype']:.2f}, {signed(apart, 1)})"
        ended = "" if row["status"] == "finished" else f" ({row['status']} after {row['jumps']} jumps)"
        rows.setdefault(row["name"], [row["name"]]).append(f"{number(row, 'height')}{beside}{ended}")
    return table(["treatment of the history force at an impact", *(case_title(about) for about in cases)], list(rows.values()))


def growth(data: Record) -> dict[str, str]:
    """By which factor lengths grow, from the shortest to the longest run, where nothing is forgotten."""
    counts = sorted({r["counted"] for r in data["memory"]["growth"]})
    length = {(r["case"], r["counted"]): r["length"]["mean"] for r in data["memory"]["growth"]}
    drift = [length[case, counts[-1]] / length[case, counts[0]] for case in range(len(data["memory"]["cases"]))]
    return {"few_jumps": grouped(counts[0]), "many_jumps": grouped(counts[-1]), "drift": span(drift, "{:.1f}")}


def draw_memory(found: Record) -> Any:
    """Mean height by memory, the prototype's beside it."""
    names = [name for name in dict.fromkeys(r["name"] for r in found["records"]) if "Dorgan" not in name and "50" not in name and "20" not in name]
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.8), sharey=True)
    for case, (axes, about) in enumerate(zip(panels, found["cases"], strict=True)):
        rows = {row["name"]: row for row in of(found["records"], case=case)}
        for place, name in enumerate(reversed(names)):
            row = rows[name]
            colour = GREY if name == "no history" else RED if "ignored" in name or "wiped" in name else BLUE
            label = {GREY: "no history", RED: "the slip's jump is ignored", BLUE: "remembered or restarted"}[colour]
            axes.errorbar(row["height"]["mean"], place, xerr=2.0 * row["height"]["se"], fmt="o", color=colour, capsize=2, label=label)
            if row["prototype"] is not None:
                axes.plot(row["prototype"], place, "D", markersize=9, markerfacecolor="none", color=BLACK, label="prototype")
        axes.axvline(rows["no history"]["height"]["mean"], color="#999999", linestyle=":")
        axes.set(title=case_title(about).replace("R_p", "R$_p$"), xlabel="mean rise H (d), two standard errors")
        ticks(axes, (0.2, 0.3, 0.5, 1, 2, 3, 5, 10, 20))
    panels[0].set_yticks(range(len(names)), list(reversed(names)))
    figure.suptitle("Remembering the rebound shortens the jumps, ignoring it lengthens them: measured rebounds reject that")
    handles, labels = panels[0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=4)
    return figure


def fields(found: Record) -> dict[str, Any]:
    """What the page says of it."""
    apart = [z for row in found["memory"]["records"] if (z := deviation(row)) is not None]
    return {
        "shorter": span(shortening(found, 73, REMEMBERING)),
        "shorter_coarse": span(shortening(found, 250, REMEMBERING)),
        "figure_memory": save(draw_memory(found["memory"]), "saltation_memory"),
        "memory": memory_table(found),
        "agreed": f"{sum(abs(z) <= KEPT_BY for z in apart)} of {len(apart)}" if apart else "none",
        **growth(found),
        "longer": span([-x for x in shortening(found, 73, SLIP_FORGOTTEN)]),
        "longer_finite": span([-x for x in shortening(found, 73, IGNORING[1:])]),
    }
