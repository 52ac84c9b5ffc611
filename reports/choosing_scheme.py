"""The page reports/choosing_scheme.md: does `saltation scheme` choose a history scheme that keeps the wanted error, and the cheapest that does?"""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLUE, ORANGE
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, listed, seconds


def rows_of(data: Record) -> list[Record]:
    """Every choice, the scenes in their order."""
    return [row for scene in data["scenes"].values() for row in scene["rows"]]


def kept(data: Record) -> list[Record]:
    """Choices that keep the wanted error in the longer runs."""
    return [row for row in rows_of(data) if row["keeps"]]


def cheap(data: Record) -> list[Record]:
    """Choices that cost no more than they may over the cheapest that keeps the error."""
    return [row for row in rows_of(data) if row["ratio"] is not None and row["ratio"] <= data["cheaper"]]


def percent(share: float) -> str:
    """An error in per cent."""
    return f"{100.0 * share:.2g}"


def size_of(row: Record) -> str:
    """A step or a tolerance."""
    return f"rtol {row['size']:g}" if row["solver"] == "collocation" else f"dt {row['size']:g}"


def choices(data: Record) -> str:
    """One line per scene and error."""
    lines = []
    for row in rows_of(data):
        fixed, best = row["fixed"], row["cheapest"]
        other = f"{fixed['scheme']}, {fixed['solver'].replace('_', ' ')}, dt {fixed['dt']:g}" if fixed else ""
        lines.append(
            [
                row["scene"],
                f"{100.0 * row['wanted']:g} %",
                f"{row['solver'].replace('_', ' ')}, {row['scheme']}, {size_of(row)}",
                f"{percent(row['error'])} (≤ {percent(row['bound'])})",
                "yes" if row["keeps"] else "**no**",
                seconds(row["seconds"]),
                f"{row['ratio']:.2f} × ({best['scheme']}, {size_of(best)})" if best else "none keeps it",
                f"{factor(fixed['seconds'] / row['seconds'])} × ({other})" if fixed else "none seen",
            ]
        )
    head = ["scene", "wanted", "chosen", "error found, %", "kept", "time per jump", "over the cheapest that keeps it", "fixed steps"]
    return table(head, lines)


def draw(data: Record) -> Any:
    """Time per jump of what is chosen and of the best fixed steps that keep the error."""
    figure, axes = plt.subplots(figsize=(9.0, 5.6))
    names = list(data["scenes"])
    for place, name in enumerate(reversed(names)):
        for row in data["scenes"][name]["rows"]:
            wide = row["wanted"] == max(data["errors"])
            axes.plot(row["seconds"], place, "o" if wide else "x", color=BLUE)
            if row["fixed"]:
                axes.plot(row["fixed"]["seconds"], place, "s" if wide else "x", color=ORANGE)
    axes.plot([], [], "o", color=BLUE, label="chosen (cross: for the smaller error)")
    axes.plot([], [], "s", color=ORANGE, label="fixed steps at that error, extrapolated (cross: the smaller)")
    axes.set(xscale="log", xlabel="CPU time per jump (s)")
    axes.set_yticks(range(len(names)), list(reversed(names)))
    axes.legend(loc="upper center", bbox_to_anchor=(0.35, -0.12), frameon=False, fontsize=8)
    figure.suptitle("What is chosen for twelve scenes, and what fixed steps would take")
    return figure


def build(data: dict[str, Record]) -> str:
    """The page reports/choosing_scheme.md."""
    own = data["choosing_scheme"]
    rows = rows_of(own)
    times = [row["fixed"]["seconds"] / row["seconds"] for row in rows if row["fixed"] and row["solver"] == "collocation"]
    orders = [row["fixed"]["order"] for row in rows if row["fixed"]]
    return fill(
        "choosing_scheme.md",
        own=own,
        number=len(rows),
        kept=len(kept(own)),
        cheap=len(cheap(own)),
        worst=f"{max((row['ratio'] for row in rows if row['ratio'] is not None), default=float('nan')):.2f}",
        collocation=sum(row["solver"] == "collocation" for row in rows),
        least=factor(min(times)),
        most=factor(max(times)),
        missed=listed([f"{row['scene']} at {100.0 * row['wanted']:g} %" for row in rows if row not in kept(own)]),
        promised=listed([percent(row["promised"]) for row in rows if row not in kept(own)]),
        longer=listed([percent(row["error"]) for row in rows if row not in kept(own)]),
        dear=listed([f"{row['scene']} at {100.0 * row['wanted']:g} %" for row in rows if row not in cheap(own) and row in kept(own)]),
        low=f"{min(orders):.2f}",
        high=f"{max(orders):.2f}",
        choosing=f"{min(row['choosing'] for row in rows):.0f} to {max(row['choosing'] for row in rows):.0f}",
        errors=listed([f"{100.0 * error:g} %" for error in own["errors"]]),
        figure=save(draw(own), "choosing_scheme"),
        choices=choices(own),
        footer=footer({"choosing_scheme": own}),
    )


PAGE = Page("choosing_scheme", build, ("choosing_scheme",))
