"""What does one value of the history integral cost at a given error: the thesis's test (figs 5-3 to 5-5), for every rule?"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import basset
from basset import measure
from basset.problems import PROBLEMS, Problem
from basset.quadrature.base import TABLES
from bench import published

NAME = "fresnel"
RULES: dict[str, basset.Rule] = {
    "Euler–Maclaurin": basset.EulerMaclaurin(),
    "Brush": basset.Brush(),
    "semi-derivative": basset.SemiDerivative(),
    "Hinsberg": basset.Hinsberg(tail=False),
    **{f"Daitche({p})": basset.Daitche(p) for p in (1, 2, 3, 4, 6, 8, 10)},
}
# As the thesis prescribes them: eq. 5-7 and eq. 5-11 in double precision, the longer formulas in quadruple precision.
PUBLISHED: dict[str, Callable[[int], Any]] = {
    "Hinsberg": published.hinsberg,
    "Daitche(1)": lambda n: published.daitche(1, n),
    "Daitche(2)": lambda n: published.daitche(2, n, "quad"),
    "Daitche(3)": lambda n: published.daitche(3, n, "quad"),
}
TIMED = (5, 17)  # exponents of 2
LARGEST = 20


def errors(problem: Problem, n: int, path: bool) -> dict[str, dict[str, float]]:
    """Absolute error of every rule at the end and, if asked, its maximum over the second half of the path."""
    arguments = problem.arguments(n)
    t, _ = problem.grid(n)
    truth = float(problem.exact_digits(problem.end, 30))
    exact = problem.exact(t[n // 2 :]) if path else None
    found = {}
    for name, rule in RULES.items():
        found[name] = {"end": abs(basset.integrate(**arguments, rule=rule) - truth), "max": float("nan")}
        if path:
            found[name]["max"] = np.abs(basset.cumulate(**arguments, rule=rule)[n // 2 :] - exact).max()
    return found


def _cold(rule: basset.Rule, arguments: dict[str, Any]) -> Any:
    TABLES.clear()
    return basset.integrate(**arguments, rule=rule)


def _as_published(build: Callable[[int], Any], g: Any, dt: float) -> Any:
    return np.sqrt(dt) * np.dot(build(len(g) - 1), g[::-1])


def times(n: int, patience: float, slow: set[str]) -> dict[str, dict[str, float]]:
    """Seconds per value: clock -> rule -> seconds. `slow` collects the published builds to leave out from now on."""
    arguments = PROBLEMS["fresnel"].arguments(n)
    g, dt = arguments["g"], arguments["dt"]
    builds = {name: build for name, build in PUBLISHED.items() if name not in slow}
    result = {
        "cached": measure.interleaved({k: lambda r=r: basset.integrate(g, dt, r) for k, r in RULES.items()}, rounds=9, seconds=0.002),
        "cold": measure.interleaved({k: lambda r=r: _cold(r, arguments) for k, r in RULES.items()}, rounds=5, seconds=0.002),
        "cold, as published": measure.interleaved(
            {k: lambda b=b: _as_published(b, g, dt) for k, b in builds.items()}, rounds=3, seconds=0.003, patience=patience / 4
        ),
    }
    slow |= {name for name, seconds in result["cold, as published"].items() if seconds > patience / 2}
    return result


def run(full: bool) -> dict[str, Any]:
    """Work–precision records of every rule, at t = 50π and 50π + 1, under three clocks."""
    problems = [PROBLEMS["fresnel"], PROBLEMS["fresnel_generic"]]
    records: list[dict[str, Any]] = []
    slow: set[str] = set()
    timed_to = LARGEST if full else TIMED[1]
    for exponent in range(TIMED[0], LARGEST + 1):
        n = 2**exponent
        timed = exponent <= timed_to
        clocks = times(n, 1.0 if full else 0.3, slow) if timed else {"cached": dict.fromkeys(RULES, float("nan"))}
        for problem in problems:
            found = errors(problem, n, path=timed)
            arguments = problem.arguments(n)
            truth = float(problem.exact_digits(problem.end, 30))
            for clock, seconds in clocks.items():
                for name, cost in seconds.items():
                    end, largest = found[name]["end"], found[name]["max"]
                    if clock == "cold, as published":  # its own rounding counts
                        end = abs(_as_published(PUBLISHED[name], arguments["g"], arguments["dt"]) - truth)
                        largest = max(largest, end)
                    records.append(
                        {
                            "problem": problem.name,
                            "scheme": name,
                            "order": RULES[name].error_order,
                            "n": n,
                            "h": arguments["dt"],
                            "clock": clock,
                            "seconds": cost,
                            "error_end": end,
                            "error_max": largest,
                        }
                    )
    return {"records": records, "quad_digits": published.QUAD_DIGITS}
