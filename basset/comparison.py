"""Schemes compared, on given samples or on a named problem: errors, times, the work–precision diagram."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from basset import measure
from basset.evaluate import cumulate
from basset.kernels import BassetKernel, Floats, Kernel
from basset.problems import Problem
from basset.quadrature import Daitche, Exponential, Hinsberg, Rule, by_default

COARSEST = 16  # steps of the coarsest grid, at least; errors are taken at its nodes
FINEST = 2**13  # steps of the finest grid of a problem
REFERENCE, CHECK = Daitche(10), Daitche(8)
RULES: tuple[Rule, ...] = (
    *(rule for rule in by_default() if not isinstance(rule, (Daitche, Exponential, Hinsberg))),  # these with other parameters, and the last is Daitche(1)
    *(Daitche(order) for order in (1, 2, 3, 6, 8)),
    *(Exponential(order, rtol) for order, rtol in ((1, 1e-3), (3, 1e-6), (6, 1e-9))),
)


@dataclass(frozen=True)
class Measured:
    """One rule with one step."""

    rule: Rule
    steps: int
    dt: float  # s
    error: float  # largest at the nodes of the coarsest grid, relative to the largest |H| there
    seconds: float  # for H at every node, the scheme being ready


@dataclass(frozen=True)
class Subject:
    """The samples or problem on which schemes are compared."""

    levels: tuple[int, ...]  # numbers of steps, each twice the one before
    arguments: Callable[[int], dict[str, Any]]  # steps -> g, dt, input and initial_slip of `cumulate`
    kernel: Kernel
    exact: Floats  # (levels[0], ...): H at the nodes of the coarsest grid but the first
    uncertainty: float  # how far `exact` may be off, relative to the largest |H|; 0 for a closed form


def of_problem(problem: Problem) -> Subject:
    """A named problem, on grids up to `FINEST` steps; on its slip where its rate is infinite at the start."""
    levels = tuple(2**k for k in range(5, FINEST.bit_length()))
    kind = "slip" if problem.rate is None else "rate"
    return Subject(levels, lambda steps: problem.arguments(steps, kind), BassetKernel(), problem.exact(problem.grid(levels[0])[0][1:]), 0.0)


def of_samples(g: Floats, dt: float, kind: str = "rate", initial_slip: float = 0.0, kernel: Kernel = BassetKernel()) -> Subject:
    """Given samples (n+1, ...), rates or slips, and every second, fourth, … of them; the reference is the highest order on all of them.

    ValueError for fewer than twice `COARSEST` steps, or as `cumulate`.

    >>> of_samples(np.cos(np.linspace(0.0, 6.0, 129)), 6.0 / 128.0).levels
    (16, 32, 64, 128)
    """
    stride = 1
    while (len(g) - 1) // (2 * stride) >= COARSEST:
        stride *= 2
    if stride == 1:
        raise ValueError(f"samples must be at least {2 * COARSEST + 1}, got {len(g)}")
    coarsest = (len(g) - 1) // stride
    steps = coarsest * stride
    levels = tuple(coarsest * 2**k for k in range(stride.bit_length()))

    def arguments(count: int) -> dict[str, Any]:
        every = steps // count
        return {"g": np.ascontiguousarray(g[: steps + 1 : every]), "dt": dt * every, "input": kind, "initial_slip": initial_slip}

    exact, other = (cumulate(rule=rule, kernel=kernel, **arguments(steps))[stride::stride] for rule in (REFERENCE, CHECK))
    largest = np.abs(exact).max()
    if largest == 0.0:
        raise ValueError("samples must not all be zero")
    return Subject(levels, arguments, kernel, exact, float(np.abs(exact - other).max() / largest))


def measured(subject: Subject, rounds: int = 5) -> Iterator[list[Measured]]:
    """All rules that have a form for the subject, level by level, each timed in that many rounds."""
    for steps in subject.levels:
        arguments = subject.arguments(steps)
        errors: dict[Rule, float] = {}
        for rule in RULES:
            try:
                found = cumulate(rule=rule, kernel=subject.kernel, **arguments)[steps // subject.levels[0] :: steps // subject.levels[0]]
            except ValueError:  # no form for the kernel or the input
                continue
            errors[rule] = float(np.abs(found - subject.exact).max() / np.abs(subject.exact).max())
        calls = {rule: partial(cumulate, rule=rule, kernel=subject.kernel, **arguments) for rule in errors}
        taken = measure.interleaved(calls, rounds=rounds, seconds=0.002)
        yield [Measured(rule, steps, float(arguments["dt"]), error, taken[rule]) for rule, error in errors.items()]


def cheapest(records: list[Measured], error: float, uncertainty: float = 0.0) -> Measured | None:
    """The fastest that is accurate enough, errors being known to `uncertainty` only (both relative to the largest |H|); None if there is none."""
    enough = [record for record in records if record.error + uncertainty <= error]
    return min(enough, key=lambda record: record.seconds, default=None)


def drawn(records: list[Measured], uncertainty: float, title: str) -> Any:
    """The work–precision diagram: milliseconds, and errors relative to the largest |H|; `uncertainty` as in `Subject`."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    from basset import _look

    colours = (_look.BLACK, _look.GREY, _look.YELLOW, _look.ORANGE, _look.GREEN, _look.BLUE, _look.SKY, _look.PINK, _look.PURPLE, _look.RED, _look.BROWN)
    with mpl.rc_context(_look.LOOK):
        figure, axes = plt.subplots(figsize=(8.0, 6.0))
        for i, rule in enumerate(dict.fromkeys(record.rule for record in records)):
            rows = [record for record in records if record.rule == rule]
            style = {"color": colours[i % len(colours)], "marker": "osD^vPXh*x+d"[i % 12], "label": repr(rule)}
            axes.loglog([1e3 * row.seconds for row in rows], [max(row.error, 1e-17) for row in rows], **style)
        if uncertainty > 0.0:
            axes.axhspan(axes.get_ylim()[0], uncertainty, color="#eeeeee", label="below the uncertainty of the reference")
        axes.set(title=title, xlabel="time for H at every node (ms)", ylabel="largest error / largest |H|")
        _look.legend(figure, axes, 3)
    plt.close(figure)
    return figure
