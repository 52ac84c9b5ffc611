"""Schemes measured against each other, on given samples or on a named problem: errors, times, the work–precision diagram."""

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
from basset.quadrature import Brush, Daitche, EulerMaclaurin, Exponential, Rule, SemiDerivative

COARSEST = 16  # steps of the coarsest grid, at least; errors are taken at its nodes
FINEST = 2**13  # steps of the finest grid of a problem
REFERENCE, CHECK = Daitche(10), Daitche(8)
RULES: tuple[Rule, ...] = (
    EulerMaclaurin(),
    Brush(),
    SemiDerivative(),
    *(Daitche(order) for order in (1, 2, 3, 6, 8)),
    *(Exponential(order, rtol) for order, rtol in ((1, 1e-3), (3, 1e-6), (6, 1e-9))),
)


@dataclass(frozen=True)
class Measured:
    """One rule with one step.

    Attributes
    ----------
    rule : Rule
    steps : int
    dt : float, seconds
    error : float, dimensionless
        Largest error at the nodes of the coarsest grid, relative to the largest |H| there.
    seconds : float
        For H at every node, the scheme being ready.

    Examples
    --------
    >>> Measured(Daitche(3), 100, 0.01, 1e-7, 2e-5).rule.error_order
    4.0
    """

    rule: Rule
    steps: int
    dt: float
    error: float
    seconds: float


@dataclass(frozen=True)
class Subject:
    """What is integrated.

    Attributes
    ----------
    levels : tuple of int
        Numbers of steps, each twice the one before.
    arguments : callable
        steps -> the arguments g, dt, input and initial_slip of `cumulate`.
    kernel : Kernel
        What is remembered.
    exact : ndarray (levels[0], ...), unit of f × s^(-1/2)
        H at the nodes of the coarsest grid but the first.
    uncertainty : float, dimensionless
        How far `exact` may be off, relative to the largest |H|; 0 for a closed form.

    Examples
    --------
    >>> from basset.problems import PROBLEMS
    >>> subject = of_problem(PROBLEMS["decay"])
    >>> subject.levels[0], subject.exact.shape, subject.uncertainty
    (32, (32,), 0.0)
    """

    levels: tuple[int, ...]
    arguments: Callable[[int], dict[str, Any]]
    kernel: Kernel
    exact: Floats
    uncertainty: float


def of_problem(problem: Problem) -> Subject:
    """A named problem, on grids up to `FINEST` steps.

    Parameters
    ----------
    problem : Problem

    Returns
    -------
    Subject

    Examples
    --------
    >>> from basset.problems import PROBLEMS
    >>> of_problem(PROBLEMS["root"]).arguments(32)["input"]  # its rate is infinite at the start
    'slip'
    """
    levels = tuple(2**k for k in range(5, FINEST.bit_length()))
    kind = "slip" if problem.rate is None else "rate"
    return Subject(levels, lambda steps: problem.arguments(steps, kind), BassetKernel(), problem.exact(problem.grid(levels[0])[0][1:]), 0.0)


def of_samples(g: Floats, dt: float, kind: str = "rate", initial_slip: float = 0.0, kernel: Kernel = BassetKernel()) -> Subject:
    """Given samples (n+1, ...) and every second, fourth, … of them; the reference is the highest order on all of them.

    Parameters
    ----------
    g : ndarray (n+1, ...)
        The rate (unit of f per second) or the slip (unit of f).
    dt : float, seconds
    kind : {"rate", "slip"}
        What the samples are.
    initial_slip : float, unit of f
    kernel : Kernel
        What is remembered.

    Returns
    -------
    Subject

    Raises
    ------
    ValueError
        If there are fewer than twice `COARSEST` steps, or as `cumulate`.

    Examples
    --------
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
    """All rules that have a form for the subject, level by level.

    Parameters
    ----------
    subject : Subject
    rounds : int
        How often each rule is timed.

    Yields
    ------
    list of Measured
        One level.

    Examples
    --------
    >>> from basset.problems import PROBLEMS
    >>> records = next(measured(of_problem(PROBLEMS["decay"]), rounds=1))
    >>> len(records) == len(RULES), max(records, key=lambda record: record.error).rule
    (True, EulerMaclaurin())
    """
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
    """The fastest that is good enough, errors being known to `uncertainty` only; None if there is none.

    Parameters
    ----------
    records : list of Measured
    error, uncertainty : float, dimensionless
        Relative to the largest |H|.

    Returns
    -------
    Measured or None

    Examples
    --------
    >>> slow, fast = Measured(Daitche(3), 64, 0.1, 1e-6, 2e-3), Measured(Daitche(1), 512, 0.0125, 5e-6, 1e-3)
    >>> cheapest([slow, fast], 1e-5) is fast, cheapest([slow, fast], 2e-6) is slow, cheapest([slow, fast], 1e-9)
    (True, True, None)
    """
    enough = [record for record in records if record.error + uncertainty <= error]
    return min(enough, key=lambda record: record.seconds, default=None)


def drawn(records: list[Measured], uncertainty: float, title: str) -> Any:
    """The work–precision diagram.

    Parameters
    ----------
    records : list of Measured
    uncertainty : float, dimensionless
        How far the reference may be off, relative to the largest |H|.
    title : str

    Returns
    -------
    matplotlib.figure.Figure
        Its axes in milliseconds and dimensionless.

    Examples
    --------
    >>> figure = drawn([Measured(Daitche(3), 64, 0.1, 1e-6, 2e-3)], 0.0, "one point")
    >>> figure.axes[0].get_title()
    'one point'
    """
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
            axes.axhspan(axes.get_ylim()[0], uncertainty, color="#eeeeee", label="below what the reference is known to")
        axes.set(title=title, xlabel="time for H at every node (ms)", ylabel="largest error / largest |H|")
        _look.legend(figure, axes, 3)
    plt.close(figure)
    return figure
