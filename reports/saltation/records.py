"""What the sections of the page on mean jumps read from the records, and how they draw means."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from reports.words import Record, factor, of, signed

SIZES = (73, 250)
QUANTITIES = {"height": "H", "length": "L", "velocity": "ū"}
AXES = {"height": "mean rise H (d)", "length": "mean length L (d)", "velocity": "mean velocity ū (u*)"}
STAGE = "transport stage T"


def places(error: float) -> int:
    """Decimal places that show an error with its first digit, at most three."""
    return 2 if error <= 0.0 else min(3, max(0, math.ceil(-math.log10(error))))


def number(row: Record, key: str) -> str:
    """A mean with its standard error."""
    value = row[key]
    if value["mean"] is None:
        return "–"
    digits = places(value["se"] or 0.0)
    return f"{value['mean']:.{digits}f} ± {value['se'] or 0.0:.{digits}f}"


def share(value: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{100.0 * value:.{digits}f} %"


def percent(ratio: float) -> str:
    """A change as people say it."""
    return f"{signed(100.0 * (ratio - 1.0))} %" if ratio < 3.0 else f"× {factor(ratio)}"


def stages(rows: Iterable[Record], **wanted: Any) -> list[Record]:
    """Those with these values, by stage."""
    return sorted(of(rows, **wanted), key=lambda row: row["stage"])


def grid(data: Record, name: str, reynolds: int) -> list[Record]:
    """The runs of one variant at one R_p, by stage."""
    return stages(data["grid"]["records"], name=name, particle_reynolds=reynolds)


def modification(data: Record, scene: str, name: str) -> Record:
    """One of the paired runs."""
    return of(data["effects"], scene=scene, name=name)[0]


def ratio(data: Record, scene: str, name: str, quantity: str = "height") -> float:
    """A modification's mean over the base's."""
    return float(modification(data, scene, name)[quantity]["mean"] / modification(data, scene, "base")[quantity]["mean"])


def published(data: Record, row: Record) -> Record:
    """What the regressions say where a run is."""
    (found,) = of(data["grid"]["published"], particle_reynolds=row["particle_reynolds"], stage=row["stage"])
    return found


def side(data: Record, row: Record, quantity: str) -> int:
    """−1 below the envelope, 0 inside, 1 above; a run without jumps lies below."""
    low, high = published(data, row)["envelope"][quantity]
    mean = row[quantity]["mean"]
    return -1 if mean is None or mean < low else 1 if mean > high else 0


def inside(data: Record, name: str, sizes: Sequence[int] = SIZES) -> int:
    """How many means of a variant lie inside."""
    return sum(side(data, row, quantity) == 0 for reynolds in sizes for row in grid(data, name, reynolds) for quantity in QUANTITIES)


def points(data: Record) -> int:
    """How many means a variant has."""
    return len(QUANTITIES) * len(data["grid"]["published"])


def ticks(axes: Any, values: Sequence[float]) -> None:
    """A logarithmic axis with labels at these places."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.set_xticks([value for value in values if low <= value <= high], minor=False)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xticks([], minor=True)


def errors(axes: Any, runs: Sequence[Record], quantity: str, error: str = "se", **look: Any) -> None:
    """Means against T with two standard errors, or with two standard deviations of single jumps ("sd"); runs without jumps are left out."""
    rows = [(run["stage"], run[quantity]) for run in runs if run[quantity]["mean"] is not None]
    axes.errorbar([T for T, _ in rows], [row["mean"] for _, row in rows], yerr=[2.0 * (row[error] or 0.0) for _, row in rows], **{"capsize": 2} | look)
