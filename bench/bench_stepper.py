"""What compiled functions, many systems and threads save in `solve`, under pytest-benchmark: `pytest bench`. Both sides take turns."""

import numpy as np
import pytest

import basset
from basset import measure
from basset._compile import compiler

SYSTEMS = 1000


def falls(t, y):
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -1.0 - 0.1 * y[1]
    return rates


def floor(t, y):
    return y[0]


def bounce(t, y):
    after = np.empty(2)
    after[0], after[1] = 0.0, -0.9 * y[1]
    return after


def swings(t, y, stiffness):
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -stiffness * y[0] - 0.3 * y[1]
    return rates


COMPILED = {function.__name__: compiler().njit(function) for function in (falls, floor, bounce, swings)}


class Floor:
    """An event in Python with its attributes."""

    direction, terminal = -1, 10

    def __call__(self, t, y):
        return floor(t, y)

    def jump(self, t, y):
        return bounce(t, y)


def impacts():
    """Ten impacts of a bouncing sphere at rtol 1e-9: Python functions over compiled ones."""
    event = COMPILED["floor"]
    event.jump, event.direction, event.terminal = COMPILED["bounce"], -1, 10
    sides = []
    for fun, watched in ((falls, Floor()), (COMPILED["falls"], event)):
        arguments = {"memory": [1], "coefficient": 0.3, "events": watched, "method": basset.Collocation(rtol=1e-9)}
        found = basset.solve(fun, (0.0, 60.0), [1.0, 0.0], **arguments)
        assert len(found.t_events[0]) == 10
        sides.append(lambda fun=fun, arguments=arguments: basset.solve(fun, (0.0, 60.0), [1.0, 0.0], **arguments))
    return sides


def systems():
    """A thousand systems: one after the other, over all at once."""
    rng = np.random.default_rng(1)
    states, stiffness = rng.normal(size=(2, SYSTEMS)), rng.uniform(1.0, 3.0, SYSTEMS)
    options = {"memory": [1], "coefficient": 0.4}
    fun = COMPILED["swings"]

    def one_by_one():
        return [basset.solve(fun, (0.0, 20.0), states[:, j], args=(float(stiffness[j]),), **options) for j in range(SYSTEMS)]

    def at_once():
        return basset.solve(fun, (0.0, 20.0), states, args=(stiffness,), **options)

    assert all(np.array_equal(one.y, other) for one, other in zip(one_by_one(), at_once().y, strict=True))
    return one_by_one, at_once


def threads():
    """Four thousand systems on one thread, over two."""
    rng = np.random.default_rng(2)
    states, stiffness = rng.normal(size=(2, 4 * SYSTEMS)), rng.uniform(1.0, 3.0, 4 * SYSTEMS)

    def on(workers):
        return basset.solve(COMPILED["swings"], (0.0, 20.0), states, memory=[1], coefficient=0.4, args=(stiffness,), workers=workers)

    assert all(np.array_equal(one, other) for one, other in zip(on(1).y, on(2).y, strict=True))
    return lambda: on(1), lambda: on(2)


def fixed_steps():
    """A thousand fixed steps with a Python function, over a compiled one."""
    sides = []
    for fun in (swings, COMPILED["swings"]):
        method = basset.FixedStep(0.02, basset.Exponential(order=2, rtol=1e-6))
        sides.append(lambda fun=fun, method=method: basset.solve(fun, (0.0, 20.0), [1.0, 0.0], memory=[1], coefficient=0.4, args=(2.0,), method=method))
    return sides


@pytest.mark.parametrize(
    ("case", "least"), [(impacts, 4.0), (systems, 2.0), (threads, 1.2), (fixed_steps, 2.0)], ids=lambda value: getattr(value, "__name__", "")
)
def bench_saved(benchmark, case, least):
    dear, cheap = case()
    seconds = measure.interleaved({"dear": dear, "cheap": cheap}, rounds=5, patience=30.0)
    ratio = benchmark.extra_info["ratio"] = seconds["dear"] / seconds["cheap"]
    benchmark.pedantic(cheap, rounds=3, warmup_rounds=1)
    assert ratio > least
