"""The rules under pytest-benchmark: `pytest bench`. Each timed call also has to be right."""

import numpy as np
import pytest

import basset
from basset.problems import PROBLEMS
from basset.weights.table import TABLES
from bench.suites.fresnel import RULES

PROBLEM = PROBLEMS["fresnel_generic"]
STEPS = 4096
ALLOWED = {  # absolute error with 4096 steps, about twice what is measured
    "Euler–Maclaurin": 0.2,
    "Brush": 0.02,
    "semi-derivative": 0.04,
    "Hinsberg": 5e-4,
    "Daitche(1)": 5e-4,
    "Daitche(2)": 1e-5,
    "Daitche(3)": 1e-7,
    "Daitche(4)": 3e-9,
    "Daitche(6)": 1e-12,
    "Daitche(8)": 1e-13,
    "Daitche(10)": 2e-13,
}


@pytest.fixture
def samples():
    return PROBLEM.arguments(STEPS)


@pytest.mark.parametrize("name", RULES)
def bench_one_value(benchmark, samples, name):
    exact = float(PROBLEM.exact(PROBLEM.end))

    def call():
        assert abs(basset.integrate(**samples, rule=RULES[name]) - exact) < ALLOWED[name]

    benchmark(call)


@pytest.mark.parametrize("name", RULES)
def bench_weights_built_anew(benchmark, samples, name):
    exact = float(PROBLEM.exact(PROBLEM.end))

    def call():
        TABLES.clear()
        assert abs(basset.integrate(**samples, rule=RULES[name]) - exact) < ALLOWED[name]

    benchmark(call)


@pytest.mark.parametrize("name", RULES)
def bench_every_node(benchmark, samples, name):
    half = STEPS // 2
    exact = PROBLEM.exact(PROBLEM.grid(STEPS)[0][half:])

    def call():
        assert np.abs(basset.cumulate(**samples, rule=RULES[name])[half:] - exact).max() < ALLOWED[name]

    benchmark(call)


def bench_a_million_samples_at_any_times(benchmark):
    """Each node moved by up to 0.4 of a step; to 1e-9 at every node from the third on."""
    steps = 1_000_000
    t = (np.arange(steps + 1) + np.random.default_rng(0).uniform(-0.4, 0.4, steps + 1)) * 1e-3
    t -= t[0]
    g, exact = np.cos(t), PROBLEM.exact(t)

    def call():
        assert np.abs(basset.cumulate(g, t=t, rule=basset.Exponential(3, 1e-10)) - exact)[2:].max() < 1e-9

    benchmark.pedantic(call, rounds=5, warmup_rounds=1)
