"""Sums and weights for other programs: C, Fortran, JSON, CSV or a table, with the recursion that uses them and a worked test value.

The numbers are those of a stream of this package (`basset.streaming.Plan`), so that compiled code repeats it to rounding.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np

from basset import __version__, _validate
from basset.exponentials import ExponentialSum
from basset.kernels import Floats, Kernel
from basset.quadrature import Daitche, Rule, Windowed
from basset.quadrature.rule import accept
from basset.streaming import Plan

FORMATS = ("table", "csv", "json", "c", "fortran")
TESTED = 100  # nodes of the worked example, if there are as many
BLOCK = 1000  # numbers in one Fortran statement: 255 continued lines are the most
MOST = 2**31 - 2  # steps: they are counted by integers of 32 bits


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Rows as CSV, numbers with all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([[repr(float(cell)) if isinstance(cell, float) else cell for cell in row] for row in rows])
    return text.getvalue()


def sum_text(tail: ExponentialSum, order: int, form: str) -> str:
    """A file of a fitted sum, its promise, and the stream that it makes with exact newest panels and polynomials of that order, 1 to 10.

    The step is tail.near/(order//2 + 1). ValueError, TypeError if order or form (of `FORMATS`) is out of range, or far lies within the steps that are
    integrated exactly.
    """
    _validate.choice("format", form, FORMATS)
    rule = Windowed(Daitche(order), tail.near, tail)
    dt, last = tail.near / (order // 2 + 1), order + 1
    steps = min(MOST, math.floor(tail.far / dt * (1.0 + 1e-12)))  # but for rounding
    if steps <= last:
        raise ValueError("far must be greater than {} seconds for steps of near/{}, got {:g}".format(f"{(last + 1) * dt:g}", order // 2 + 1, tail.far))
    plan = rule.plan(dt, steps * dt, tail.kernel)
    nodes = min(steps, TESTED)
    facts: dict[str, Any] = {"kernel": repr(tail.kernel), "near": tail.near, "far": tail.far, "rtol": tail.rtol, "measured": tail.max_relative_error()}
    facts |= {"dt": dt, "order": order, "terms": len(tail), "last": last, "window": order // 2 + 1, "steps": steps}
    arrays = coefficients(plan, tail)
    worked = test_value(plan, nodes)
    title = f"K(s) as a sum of {len(tail)} exponentials for {tail.near:g} <= s <= {tail.far:g} seconds, K: {tail.kernel!r}"
    promise = f"|sum/K - 1| <= {tail.rtol:g} there; {facts['measured']:.3g} measured on the digits below."
    recursion = f"polynomials of degree {order} through the samples, integrated against K on the newest {order // 2 + 1} steps, against the sum beyond."
    if form == "json":
        facts |= {"promise": promise, "recursion": RECURSION, **{name: array.tolist() for name, array in arrays.items()}}
        return json.dumps(facts | {"test": {"rates": "g[k] = 1/(1 + k)", "initial_slip": 1.0, "node": nodes, "value": worked}}, indent=1) + "\n"
    said = [title, promise, f"Step {dt!r} s: {recursion}"]
    if form in ("table", "csv"):
        columns = {"rate": tail.rates, "weight": tail.weights, "loss": arrays["loss"], "gain": arrays["gain"]}
        rows = list(zip(*columns.values(), strict=True))
        example = f"For g[k] = 1/(1 + k) and an initial slip of 1, H at node {nodes} is {worked!r}."
        if form == "csv":
            return "".join(f"# {line}\n" for line in [*said, example]) + csv_text(tuple(columns), rows)
        units = {"rate (1/s)": "rate", "weight (s^-1/2)": "weight", "loss": "loss", "gain (s^1/2)": "gain"}
        shown = aligned({head: columns[name] for head, name in units.items()})
        return "\n\n".join(("\n".join(said), shown, stepwise(arrays, last), example)) + "\n"
    words = {name: facts[name] for name in ("terms", "last", "window", "steps", "near", "far", "rtol", "dt")} | {"test_steps": nodes, "test_value": worked}
    told = {"title": title, "promise": promise, "recursion": recursion, "command": f"basset {__version__}, basset sum"}
    names = {"weights": "weight", "rates": "rate"}
    return written("sum", form, told, words, {names.get(name, name): array for name, array in arrays.items()}, BOUNDS)


def weights_text(rule: Rule, steps: int, dt: float, kernel: Kernel, input: str, form: str) -> str:
    """A file of the weights of a rule at one number of steps, newest first; errors as `Rule.weights`, or if form is none of `FORMATS`."""
    _validate.choice("format", form, FORMATS)
    accept(rule, kernel, input)
    found = rule.weights(steps, dt, kernel, input)
    if form == "csv":
        return csv_text(("j", "weight"), enumerate(found))
    worked = float(found @ (1.0 / (1.0 + np.arange(steps, -1, -1))))
    unit = "df/dt" if input == "rate" else "f"
    title = f"Weights of {rule!r} on samples g of {unit}, {steps} steps of {dt!r} s, K: {kernel!r}"
    if form == "json":
        facts = {"rule": repr(rule), "kernel": repr(kernel), "input": input, "dt": dt, "steps": steps, "weights": found.tolist()}
        return json.dumps(facts | {"test": {"samples": "g[k] = 1/(1 + k) at node k", "value": worked}}, indent=1) + "\n"
    if form == "table":
        sentence = "H at the newest node = sum of weight j times g, j steps before it."
        example = f"For g = 1/(1 + k) at node k, H at node {steps} is {worked!r}."
        return f"{title}\n{sentence}\n\n{aligned({'lag (s)': dt * np.arange(steps + 1), 'weight': found})}\n\n{example}\n"
    told = {"title": title, "command": f"basset {__version__}, basset weights"}
    return written("weights", form, told, {"steps": steps, "dt": dt, "test_value": worked}, {"weight": found}, {"weight": "0:steps"})


BOUNDS = {"weight": "terms", "rate": "terms", "start": "0:last, 0:last - 1", "newest": "0:last", "loss": "terms", "gain": "terms"}
BOUNDS |= {"entry": "0:last, terms", "excess": "window"}
RECURSION = (
    "push(g), the first node having n = 0: sample[j] = sample[j-1], sample[0] = g; "
    "H = coming[0] + sum_j (start[n][j] if n < last else newest[j])*sample[j]; for every term i: "
    "gained = entry[i] . sample if n == last, gain[i]*sample[last] if n > last, else 0; term[i] += gained - loss[i]*term[i]; H += term[i]; "
    "coming[k] = coming[k+1], the last 0. jump(delta) at the newest node: term[i] += delta*weights[i], coming[k] += delta*excess[k]. All zero at the start."
)


def coefficients(plan: Plan, tail: ExponentialSum) -> dict[str, Floats]:
    """What the recursion multiplies with, newest samples first: a stream's tables and what a jump adds."""
    tables, last, window = plan.tables, plan.recipe.lags, int(plan.recipe.window or 0)
    start = np.zeros((last, last + 1))
    entry = np.zeros((len(tail), last + 1))
    for n in range(last):
        start[n, : n + 1] = tables.short[n, n::-1]
    oldest = tables.entry.shape[1]  # how many samples enter at node `last`, oldest first
    entry[:, last + 1 - oldest :] = tables.entry[:, ::-1]
    lags = plan.dt * np.arange(1.0, window)
    excess = np.append(tail.kernel._values(lags) - tail._values(lags), 0.0)
    return {
        "weights": tail.weights, "rates": tail.rates, "start": start, "newest": tables.fixed[::-1].copy(),
        "loss": tables.loss, "gain": tables.gains, "entry": entry, "excess": excess,
    }  # fmt: skip


def test_value(plan: Plan, nodes: int) -> float:
    """H at node `nodes` for g = 1/(1 + k) and an initial slip of 1."""
    state = plan.start()
    plan.push(state, 1.0)
    plan.jump(state, 1.0)
    return float(plan.run(state, 1.0 / (1.0 + np.arange(1.0, nodes + 1.0)))[-1])


def stepwise(arrays: Mapping[str, Floats], last: int) -> str:
    """The recursion in words, with the numbers that are not in the columns; for tables."""
    newest = ", ".join(map(repr, arrays["newest"].tolist()))
    return (
        f"Per step, from node {last + 1} on: M[i] = M[i] - loss[i]*M[i] + gain[i]*(g of {last} steps ago) for every exponential,\n"
        f"H = sum of all M + sum of newest[j]*(g of j steps ago), newest = {newest}.\n"
        "A jump of f at the newest node adds its size times weight[i] to every M[i].\n"
        "The first steps, and what a jump adds within the newest ones: --format json, c or fortran."
    )


def aligned(columns: Mapping[str, Floats]) -> str:
    """Columns of numbers, all digits."""
    texts = [[name, *map(repr, values.tolist())] for name, values in columns.items()]
    widths = [max(map(len, column)) for column in texts]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in zip(*texts, strict=True))


def written(name: str, form: str, told: Mapping[str, str], words: Mapping[str, Any], arrays: Mapping[str, Floats], bounds: Mapping[str, str]) -> str:
    """The template of a language with its words, numbers and arrays; `bounds` are those of the arrays in Fortran."""
    template = resources.files("basset").joinpath("data", f"{name}.{'h' if form == 'c' else 'f90'}").read_text(encoding="utf-8")
    number = repr if form == "c" else fortran_number
    prefix = " * " if form == "c" else "! "
    filled = {key: f"\n{prefix}".join(textwrap.wrap(text.replace("*/", "* /"), 120)) for key, text in told.items()}
    filled |= {key: str(value) if isinstance(value, int) else number(float(value)) for key, value in words.items()}
    filled["arrays"] = "\n".join(c_array(key, values) if form == "c" else fortran_array(key, bounds[key], values) for key, values in arrays.items())
    return re.sub("@([a-z_]+)@", lambda found: filled[found[1]], template)


def c_array(name: str, values: Floats) -> str:
    """A constant array in C."""
    sizes = "".join(f"[{size}]" for size in values.shape)
    return f"static const double basset_{name}{sizes} = {c_braces(values)};"


def c_braces(values: Floats) -> str:
    """Numbers in braces, rows in braces of their own."""
    if values.ndim == 1:
        return f"{{\n    {in_lines(list(map(repr, values.tolist())), ',')}}}"
    return "{\n  " + ",\n  ".join(map(c_braces, values)) + "}"


def fortran_number(value: float) -> str:
    """All digits, in double precision."""
    mantissa, _, exponent = repr(value).partition("e")
    return f"{mantissa}d{int(exponent or 0):+03d}"


def fortran_array(name: str, bounds: str, values: Floats) -> str:
    """A constant array in Fortran, rows of C as columns; a long one is filled in blocks."""
    numbers = list(map(fortran_number, values.ravel().tolist()))
    if len(numbers) > BLOCK:
        blocks = [(low, in_lines(numbers[low : low + BLOCK], ", &")) for low in range(0, len(numbers), BLOCK)]
        data = [f"  data {name}({low}:{min(low + BLOCK, len(numbers)) - 1}) / &\n    {lines} /" for low, lines in blocks]
        return "\n".join((f"  real(real64), save, protected, public :: {name}({bounds})", *data))
    made = f"[ &\n    {in_lines(numbers, ', &')}]"
    if values.ndim > 1:
        made = f"reshape({made}, [{values.shape[1]}, {values.shape[0]}])"
    return f"  real(real64), parameter, public :: {name}({bounds}) = {made}"


def in_lines(numbers: Sequence[str], between: str) -> str:
    """Four numbers in a line."""
    return f"{between}\n    ".join(", ".join(numbers[low : low + 4]) for low in range(0, len(numbers), 4))
