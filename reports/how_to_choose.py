"""The page reports/how_to_choose.md: from what one has to the call, with what it costs."""

from __future__ import annotations

from reports import flights, quadrature, solver
from reports.site.page import Page, fill, footer
from reports.words import Record, of, reaches, select

SUITES = ("fresnel", "stream", "coupled", "flights", "advice")
STREAM = "Exponential(3, 1e-6)"


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
        few=reaches(select(samples, scheme="Daitche(2)"), 1e-3),
        stream=select(data["stream"]["records"], scheme=STREAM)[-1],
        step=sum(calls[name] for name in ("tail", "local", "push")),
        own=solver.cheapest(of(own, problem="relaxing"), 1e-9),
        vortex=solver.cheapest(of(own, problem="vortex, slip 1"), 1e-6),
        race=solver.race(found)["own"],
        jump=flights.cost(flown, "sand"),
        kept=kept,
        met=sum(row["meets"] for row in advised),
        cases=len(advised),
        footer=footer({name: data[name] for name in SUITES}),
    )


PAGE = Page("how_to_choose", how_to_choose, SUITES)
