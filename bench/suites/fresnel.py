"""What does one value of the history integral cost at a given error: the thesis's test (figs 5-3 to 5-5), for every rule?"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import basset
from basset import measure
from basset.problems import PROBLEMS, Problem
from basset.weights.table import TABLES
from bench import published

RULES: dict[str, basset.Rule] = {
    "Euler–Maclaurin": basset.EulerMaclaurin(),
    "Brush": basset.Brush(),
    "semi-derivative": basset.SemiDerivative(),
    "Hinsberg": basset.Hinsberg(tail=False),
    **{f"Daitche({p})": basset.Daitche(p) for p in (1, 2, 3, 4, 6, 8, 10)},
}
# As the thesis prescribes them: eq. 5-7 and eq. 5-11 in double precision, the longer formulas in quadruple precision.
PUBLISHED: dict[str, Callable[[int], Any]] = {
    "Euler–Maclaurin": published.euler_maclaurin,
    "Brush": published.brush,
    "semi-derivative": published.semi_derivative,
    "Hinsberg": published.hinsberg,
    "Daitche(1)": lambda n: published.daitche(1, n),
    "Daitche(2)": lambda n: published.daitche(2, n, "quad"),
    "Daitche(3)": lambda n: published.daitche(3, n, "quad"),
}
SMALLEST, LARGEST, SHORT = 5, 20, 17  # exponents of 2, the last one unless in full


def errors(problem: Problem, n: int) -> dict[str, dict[str, float]]:
    """Absolute error of every rule at the end, and its maximum over the second half of the path."""
    arguments = problem.arguments(n)
    t, _ = problem.grid(n)
    truth = float(problem.exact_digits(problem.end, 30))
    exact = problem.exact(t[n // 2 :])
    found = {}
    for name, rule in RULES.items():
        found[name] = {"end": float("nan"), "max": float("nan")}
        with contextlib.suppress(ValueError, TypeError, MemoryError):  # a failure is a row without numbers
            found[name]["end"] = abs(basset.integrate(**arguments, rule=rule) - truth)
            found[name]["max"] = np.abs(basset.cumulate(**arguments, rule=rule)[n // 2 :] - exact).max()
    return found


def _cold(rule: basset.Rule, arguments: dict[str, Any]) -> Any:
    TABLES.clear()
    return basset.integrate(**arguments, rule=rule)


def _as_published(build: Callable[[int], Any], g: Any, dt: float) -> Any:
    return np.sqrt(dt) * np.dot(build(len(g) - 1), g[::-1])


def times(sizes: list[int], full: bool) -> dict[str, dict[tuple[str, int], float]]:
    """Seconds per value: clock -> (rule, n) -> seconds. All rules and all n take turns: a slow moment of the machine hits none alone.

    A published build is left out from the first n on that takes longer than about half of `patience`.
    """
    patience = 1.0 if full else 0.2
    arguments = {n: PROBLEMS["fresnel"].arguments(n) for n in sizes}
    pairs = [(name, n) for n in sizes for name in RULES]
    cached = {(name, n): lambda name=name, n=n: basset.integrate(**arguments[n], rule=RULES[name]) for name, n in pairs}
    cold = {(name, n): lambda name=name, n=n: _cold(RULES[name], arguments[n]) for name, n in pairs}
    built = {}
    for name, build in PUBLISHED.items():
        for n in sizes:
            built[name, n] = lambda build=build, n=n: _as_published(build, arguments[n]["g"], arguments[n]["dt"])
            start = time.perf_counter()
            built[name, n]()
            if time.perf_counter() - start > patience / 2.0:
                break
    return {
        "cached": measure.interleaved(cached, rounds=30 if full else 10, seconds=0.0005),
        "cold": measure.interleaved(cold, rounds=15 if full else 4, seconds=0.0),
        "cold, as published": measure.interleaved(built, rounds=6 if full else 3, seconds=0.0003, patience=patience / 4.0),
    }


def run(full: bool) -> dict[str, Any]:
    """Work–precision records of every rule, at t = 50π and 50π + 1, timed in three ways."""
    problems = [PROBLEMS["fresnel"], PROBLEMS["fresnel_generic"]]
    records: list[dict[str, Any]] = []
    sizes = [2**exponent for exponent in range(SMALLEST, (LARGEST if full else SHORT) + 1)]
    clocks = times(sizes, full)
    for n in sizes:
        for problem in problems:
            found = errors(problem, n)
            arguments = problem.arguments(n)
            truth = float(problem.exact_digits(problem.end, 30))
            for clock, seconds in clocks.items():
                for name, rule in RULES.items():
                    if (name, n) not in seconds:
                        continue
                    end, largest = found[name]["end"], found[name]["max"]
                    if clock == "cold, as published":  # its own rounding counts
                        end = abs(_as_published(PUBLISHED[name], arguments["g"], arguments["dt"]) - truth)
                        largest = max(largest, end)
                    records.append(
                        {
                            "problem": problem.name,
                            "scheme": name,
                            "order": rule.error_order,
                            "n": n,
                            "h": arguments["dt"],
                            "clock": clock,
                            "seconds": seconds.get((name, n)),
                            "error_end": end,
                            "error_max": largest,
                        }
                    )
    return {"records": records, "quad_digits": published.QUAD_DIGITS}
