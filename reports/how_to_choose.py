"""The page reports/how_to_choose.md: from what one has to the call, with what it costs."""

from __future__ import annotations

import math

import numpy as np

import basset
from reports import flights, quadrature, solver
from reports.site.page import Page, fill, footer
from reports.words import Record, grouped, of, reaches, seconds, select, short

SUITES = ("fresnel", "stream", "coupled", "flights", "advice", "particles")
STREAM = "Exponential(3, 1e-6)"


def measured(found: Record | None) -> dict[str, str]:
    """What is said of samples at nonuniform times and of spheres in a flow; a dash where they were not measured."""
    names = ("track_error", "track", "sphere_error", "sphere")
    if found is None:
        return dict.fromkeys(names, "–")
    track = of(found["tracks"], rtol=1e-6)[-1]
    sphere = min((r for r in of(found["exact"], flow="vortex", slip=True) if r["error"] <= 1e-6), key=lambda r: float(r["seconds"]))
    swarm = found["swarm"]
    each = swarm["seconds"]["1"] / swarm["particles"]
    said = (
        f"{short(track['error'])} from {grouped(track['n'])} samples",
        f"{seconds(track['seconds'] / track['n'])} a sample",
        f"{short(sphere['error'])} in a vortex",
        f"{seconds(sphere['seconds'])} alone, {seconds(each)} each of {grouped(swarm['particles'])}",
    )
    return dict(zip(names, said, strict=True))


def fewest(samples: list[Record]) -> float:
    """Samples per oscillation from which on `Daitche(order=8)` errs no more than order 2."""
    high, low = (select(samples, scheme=f"Daitche({order})") for order in (8, 2))
    last = max(k for k, (one, other) in enumerate(zip(high, low, strict=True)) if one["error_max"] > other["error_max"])
    return 2.0 * math.pi / float(high[last + 1]["h"])


def noise(order: int) -> float:
    """Standard deviation of H over that of independent errors of the samples, for a step of 1."""
    return float(np.linalg.norm(basset.Daitche(order=order).weights(400, 1.0)))


def how_to_choose(data: dict[str, Record]) -> str:
    """The page reports/how_to_choose.md."""
    samples = select(data["fresnel"]["records"], problem="fresnel_generic", clock=quadrature.CACHED)
    found, flown = data["coupled"], data["flights"]
    own = of(found["records"], scheme=solver.OURS)
    kept = of(flown["kept"], scene="sand", rtol=flown["rtol"])[0]
    calls = data["stream"]["calls"]
    advised = data["advice"]["rows"]
    return fill(
        "how_to_choose.md",
        many=reaches(select(samples, scheme="Daitche(8)"), 1e-9),
        fewest=fewest(samples),
        noise=noise(8) / noise(2),
        stream=select(data["stream"]["records"], scheme=STREAM)[-1],
        step=sum(calls[name] for name in ("tail", "local", "push")),
        own=solver.cheapest(of(own, problem="relaxing"), 1e-9),
        race=solver.race(found)["own"],
        jump=flights.cost(flown, "sand"),
        kept=kept,
        met=sum(row["meets"] for row in advised),
        cases=len(advised),
        **measured(data.get("particles")),
        footer=footer({name: data[name] for name in SUITES if name in data}),
    )


PAGE = Page("how_to_choose", how_to_choose, SUITES)
