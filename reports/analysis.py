"""What the records say: the cheapest rule for an error, measured orders, floors, and whether the targets are met."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

Record = dict[str, Any]

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-9, 1e-12)
NEAR = 1.3  # times within this factor are not told apart: timings on shared machines scatter
CACHED, COLD, PUBLISHED = "cached", "cold", "cold, as published"
BASELINES = ("Euler–Maclaurin", "Brush", "semi-derivative")


def select(records: Iterable[Record], **wanted: Any) -> list[Record]:
    """Records with these values, by number of steps."""
    found = [record for record in records if all(record[key] == value for key, value in wanted.items())]
    return sorted(found, key=lambda record: record["n"])


def schemes(records: Iterable[Record]) -> list[str]:
    """Every scheme, in the order in which they were measured."""
    return list(dict.fromkeys(record["scheme"] for record in records))


def short(value: float, digits: int = 0) -> str:
    """A small number in powers of ten, without the exponent's leading zero."""
    if not math.isfinite(value):
        return "–"
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def reaches(records: Sequence[Record], tolerance: float, error: str = "error_max") -> Record | None:
    """The first timed record (one scheme, by n) from which on no error exceeds the tolerance."""
    timed = [record for record in records if record["seconds"] is not None and record[error] is not None]
    first = None
    for record in reversed(timed):
        if record[error] > tolerance:
            break
        first = record
    return first


def cheapest(records: Sequence[Record], tolerance: float) -> list[Record]:
    """First records within the tolerance of the schemes that are as cheap as any; those that need fewest samples first."""
    found = [record for name in schemes(records) if (record := reaches(select(records, scheme=name), tolerance))]
    least = min((record["seconds"] for record in found), default=0.0)
    return sorted((record for record in found if record["seconds"] <= NEAR * least), key=lambda record: (record["n"], record["seconds"]))


@dataclass(frozen=True)
class Convergence:
    """How one rule converged: slopes are exponents of h.

    Attributes
    ----------
    slope : float
        Of the largest error over the second half of the path, the last doubling above 100 × the floor.
    slope_end : float
        Of the error at t = 50π, likewise.
    floor : float or None
        The smallest error reached; None where the error still falls at the finest step.
    best : float
        The smallest error reached.
    """

    scheme: str
    declared: float
    slope: float
    slope_end: float
    floor: float | None
    best: float


def _last_slope(points: list[tuple[float, float]], declared: float) -> tuple[float, float | None]:
    """(slope, floor) of (h, error) by falling h."""
    slopes = [math.log(a[1] / b[1]) / math.log(a[0] / b[0]) if a[1] > 0.0 and b[1] > 0.0 else 0.0 for a, b in pairwise(points)]
    floor = min(error for _, error in points) if slopes[-1] < declared / 2.0 else None
    usable = [i for i, (_, error) in enumerate(points[1:]) if floor is None or error > 100.0 * max(floor, 1e-16)]
    return slopes[usable[-1]], floor


def convergence(records: Sequence[Record]) -> list[Convergence]:
    """One row per rule, from the generic problem's path and the thesis's end time."""
    rows = []
    for name in schemes(records):
        path = [r for r in select(records, scheme=name, clock=CACHED, problem="fresnel_generic") if r["error_max"] is not None]
        end = [r for r in select(records, scheme=name, clock=CACHED, problem="fresnel") if r["error_end"] is not None]
        declared = path[0]["order"]
        slope, floor = _last_slope([(r["h"], r["error_max"]) for r in path], declared)
        slope_end, _ = _last_slope([(r["h"], r["error_end"]) for r in end], declared)
        rows.append(Convergence(name, declared, slope, slope_end, floor, min(r["error_max"] for r in path)))
    return rows


@dataclass(frozen=True)
class Target:
    """One figure that was asked for: what, how much, what was measured, and whether that is enough."""

    what: str
    asked: str
    measured: str
    met: bool


def seconds(value: float | None) -> str:
    """A time as people say it."""
    if value is None:
        return "–"
    for factor, unit in ((1.0, "s"), (1e3, "ms")):
        if value * factor >= 1.0:
            return f"{value * factor:.3g} {unit}"
    return f"{value * 1e6:.3g} µs"


def targets(data: dict[str, Record]) -> list[Target]:
    """The figures asked of this version that the measurements can show."""
    rows: list[Target] = []
    fresnel, costs = data["fresnel"]["records"], data["costs"]
    table = convergence(fresnel)
    worst = min(table, key=lambda row: row.slope - row.declared)
    rows.append(
        Target(
            "order of every rule: last slope above 100 × floor, largest error over the second half of the path",
            "declared − 0.25",
            f"{worst.slope - worst.declared:+.2f} at worst ({worst.scheme})",
            worst.slope - worst.declared >= -0.25,
        )
    )
    for low, high, limit in ((1, 4, 2e-14), (6, 10, 1e-13)):
        error = max(r["error"] for r in data["weights"]["worst"] if low <= r["order"] <= high)
        rows.append(Target(f"weights against mpmath, degree {low} to {high}", f"≤ {short(limit)}", f"{short(error, 1)}", error <= limit))
    for scheme, n, limit in (("Daitche(8)", 1024, 2e-10), ("Daitche(8)", 4096, 5e-15), ("Daitche(4)", 65536, 1e-14)):
        error = select(fresnel, scheme=scheme, clock=CACHED, problem="fresnel", n=n)[0]["error_end"]
        error = math.inf if error is None else error
        rows.append(Target(f"t = 50π, {scheme}, {n + 1} samples", f"≤ {short(limit)}", f"{short(error, 1)}", error <= limit))
    risen = 0.0
    for name in schemes(fresnel):
        errors = [r["error_end"] for r in select(fresnel, scheme=name, clock=CACHED, problem="fresnel") if r["error_end"] is not None]
        below = [i for i, e in enumerate(errors) if e < 1e-12]
        risen = max([risen, *errors[below[0] :]]) if below else risen
    rows.append(
        Target(
            f"t = 50π, after an error below 1e-12, up to 2^{max(r['n'] for r in fresnel).bit_length() - 1} steps",
            "≤ 1e-12",
            f"{short(risen, 1)}",
            risen <= 1e-12,
        )
    )
    cached = {r["scheme"]: r["seconds"] for r in costs["cached"]}
    dot = cached.pop("numpy.dot")
    slowest = max(cached, key=lambda name: cached[name])
    rows.append(
        Target(
            "a value from 65 536 cached weights, slowest rule",
            f"numpy.dot ({seconds(dot)}) + 15 µs",
            f"numpy.dot + {seconds(cached[slowest] - dot)} ({slowest})",
            cached[slowest] <= dot + 15e-6,
        )
    )
    built = next(r["seconds"] for r in costs["building"] if r["scheme"] == "Daitche(8)")
    rows.append(Target("2^18 weights of Daitche(8)", "≤ 0.3 s", seconds(built), built <= 0.3))
    held = max((r["bytes"] or math.inf) for r in costs["memory"])
    rows.append(Target("peak memory of a process with 10^7 weights", "< 1 GB", f"{held / 1e9:.2f} GB", held < 1e9))
    largest = max(r["n"] for r in data["trajectory"]["ratios"])
    ratio = max(r["cumulate"] / r["fftconvolve"] for r in data["trajectory"]["ratios"] if r["n"] == largest)
    rows.append(Target(f"every node of 2^{largest.bit_length() - 1} steps, against scipy.signal.fftconvolve", "≤ 1.5 ×", f"{ratio:.2f} ×", ratio <= 1.5))
    apart = max(r["difference"] or 0.0 for r in data["trajectory"]["records"])
    rows.append(Target("every node by FFT against direct sums", "≤ 1e-12", f"{short(apart, 1)}", apart <= 1e-12))
    best = min(costs["long"], key=lambda r: r["error_end"])
    rows.append(Target("t = 10^4 π with 2^20 steps", "works", f"{short(best['error_end'], 1)} ({best['scheme']})", best["error_end"] < 1e-10))
    if "peers" in data:
        race = {r["contender"]: r["seconds"] for r in data["peers"]["races"]["trajectory"]}
        own = {name: value for name, value in race.items() if name.startswith("basset")}
        others = {name: value for name, value in race.items() if name not in own}
        if others:
            fastest = min(others, key=lambda name: others[name])
            times = others[fastest] / min(own.values())
            rows.append(Target("1e-9 at every node, against the fastest peer", "≥ 20 ×", f"{times:.0f} × ({fastest})", times >= 20.0))
    return rows
