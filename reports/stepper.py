"""The page reports/stepper.md: what a step costs, part by part, what is saved by compiling, and what compiling costs."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, GREY
from basset._look import legend as _legend
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped, of, percent, seconds, storage

SUITES = ("stepper",)
CASES = {
    "impacts": "ten impacts of a bouncing sphere, rtol 1e-9: Python functions / compiled ones",
    "systems": "a thousand systems, one after the other / all at once",
    "threads": "four thousand systems, one thread / two",
    "fixed_steps": "a thousand fixed steps, a Python `fun` / a compiled one",
}


def alone(part: Record, peak: float) -> float | None:
    """Seconds that the arithmetic of a part would take by itself."""
    return part["operations"] / peak if part.get("operations") else None


def apart_table(data: Record) -> str:
    """Seconds of every part of a step, in both scenes, and its arithmetic."""
    peak, (sand, bare) = data["peak"], data["records"]
    rows = []
    for part, other in zip(sand["parts"], bare["parts"], strict=True):
        counted = (
            [grouped(part["operations"]), storage(part["bytes"]) if part["bytes"] else "–", seconds(alone(part, peak))] if alone(part, peak) else ["–"] * 3
        )
        rows.append([part["part"], seconds(part["seconds"]), percent(part["seconds"] / sand["seconds"]), *counted, seconds(other["seconds"])])
    counts = [part for part in sand["parts"] if alone(part, peak)]
    total = [grouped(sum(p["operations"] for p in counts)), storage(sum(p["bytes"] for p in counts)), seconds(sum(alone(p, peak) or 0.0 for p in counts))]
    rows.append(["**a step**", f"**{seconds(sand['seconds'])}**", "100 %", *total, seconds(bare["seconds"])])
    return table(["part", "time per step", "share", "operations", "bytes of tables", "alone", "without history"], rows)


def per_step(row: Record) -> float:
    """Seconds of an accepted step."""
    return float(row["seconds"] / row["steps"])


def stepper(data: dict[str, Record]) -> str:
    """The page reports/stepper.md."""
    found = data["stepper"]
    sand = found["apart"]["records"][0]
    shares = {part["part"]: part["seconds"] / sand["seconds"] for part in sand["parts"]}
    many, _, long = found["one_long"]["records"]
    impacts, threads = of(found["saved"], case="impacts")[0], found["independent"]
    saved = [[CASES[r["case"]], seconds(r["dear"]), seconds(r["cheap"]), f"{factor(r['dear'] / r['cheap'])} ×"] for r in found["saved"]]
    cold = {row["what"]: row for row in found["compiling"]}
    numbers: dict[str, Any] = {name: found[name] for name in ("one_long", "independent", "crowd")}
    return fill(
        "stepper.md",
        **numbers,
        **{name: shares[name] for name in ("rates", "stages", "memory", "error", "record")},
        data=found,
        sand=sand,
        peak=1e-9 * found["apart"]["peak"],
        impacts=impacts["dear"] / impacts["cheap"],
        per_step=per_step(many) / per_step(long),
        cold=cold["sand"]["cold"],
        second=cold["sand"]["second"],
        further=found["compiling"][1]["cold"],
        figure=save(draw_apart(found["apart"]), "stepper_parts"),
        apart=apart_table(found["apart"]),
        saved=table(["", "first", "second", "ratio"], saved),
        many=table(["", "time", "steps", "per step"], [[r["case"], seconds(r["seconds"]), grouped(r["steps"]), seconds(per_step(r))] for r in (many, _, long)]),
        threads=table(
            ["threads", "time", "per jump", "speed-up"],
            [[str(k + 1), seconds(t), seconds(t / threads["jumps"]), f"{threads['one'] / t:.2f} ×"] for k, t in enumerate((threads["one"], threads["two"]))],
        ),
        compiling=table(
            ["", "nothing compiled", "in a second process"], [[r["what"], f"{r['cold']:.1f} s", f"{r['second']:.2f} s"] for r in found["compiling"]]
        ),
        footer=footer({"stepper": found}),
    )


# Figures, from the records alone


def draw_apart(data: Record) -> Any:
    """Time of the parts of a step, and of their arithmetic alone."""
    figure, axes = plt.subplots(figsize=(8.0, 4.2))
    parts = data["records"][0]["parts"]
    places = range(len(parts))
    axes.barh([-k + 0.2 for k in places], [1e6 * part["seconds"] for part in parts], 0.38, color=BLUE, label="as it is")
    axes.barh([-k - 0.2 for k in places], [1e6 * (alone(part, data["peak"]) or 0.0) for part in parts], 0.38, color=GREY, label="its arithmetic alone")
    axes.set_yticks([-k for k in places], [part["part"] for part in parts])
    axes.set(xlabel="time per step (µs)", title="Where the time of a step goes (sand, rtol 1e-5)")
    _legend(figure, axes, 2)
    return figure


PAGE = Page("stepper", stepper, SUITES)
