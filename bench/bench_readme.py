"""The ratios that the README quotes, under pytest-benchmark: `pytest bench`. Both sides take turns, and both have to be right."""

import re
from pathlib import Path

import numpy as np
import pytest

import basset
import saltation
from basset import measure, reference
from basset.problems import PROBLEMS
from saltation.scene import read, scene_of
from saltation.study import cases
from saltation.study.thesis import case

README = (Path(__file__).resolve().parent.parent / "README.md").read_text(encoding="utf-8")
QUOTED = {what: float(number.replace(" ", "")) for what, number in re.findall(r"^\| (.+?) \| ([\d. ]+) × \|$", README, re.M)}
APART = 1.6  # a ratio measured elsewhere may differ so much


def many_samples():
    """1e-9 of the Fresnel integral: van Hinsberg's rule needs two thousand times as many samples."""
    problem = PROBLEMS["fresnel_generic"]
    exact = float(problem.exact(np.array([problem.end]))[0])
    sides = []
    for rule, steps in ((basset.Hinsberg(), 2_000_000), (basset.Daitche(order=8), 1024)):
        arguments = problem.arguments(steps)
        assert abs(basset.integrate(**arguments, rule=rule) - exact) < 1e-9
        sides.append(lambda arguments=arguments, rule=rule: basset.integrate(**arguments, rule=rule))
    return sides


def long_memory():
    """32 000 steps of one component, one sample after the other."""
    t = 1e-3 * np.arange(32_001)
    rates, exact = np.cos(t), reference.cosine(t[-1])
    sides = []
    for rule in (basset.Daitche(order=3), basset.Exponential(order=3, rtol=1e-6)):
        plan = rule.plan(t[1], t[-1])
        assert abs(plan.run(plan.start(()), rates)[-1] - exact) < 1e-5
        sides.append(lambda plan=plan: plan.run(plan.start(()), rates))
    return sides


def initial_slip():
    """A sphere that starts with slip: what is left of it after four relaxation times."""
    sides = []
    for method, error in ((basset.FixedStep(1.0 / 1024.0, basset.Daitche(order=1)), 2e-3), (basset.Collocation(rtol=1e-9), 1e-9)):

        def call(method=method):
            return basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method)

        found = call()
        assert np.abs(found.y[0] - reference.relaxing(found.t, 1.0, 0.6))[-1] < error
        sides.append(call)
    return sides


def history(content):
    """100 jumps with the history force, and without."""
    scene = scene_of(content).changed(run={"jumps": 100, "discard": 0, "trajectory": False})
    sides = []
    for made in (scene, cases.without(scene, ["history"])):
        assert saltation.run(made).status == "finished"
        sides.append(lambda made=made: saltation.run(made))
    return sides


CASES = {
    "an integral to 1e-9 by van Hinsberg's rule, over `Daitche(order=8)`": many_samples,
    "32 000 steps by the direct sum over the whole past, over `Exponential(3, 1e-6)`": long_memory,
    "a sphere with initial slip to 2e-3 by fixed steps, over `Collocation` to 1e-9": initial_slip,
    "a jump of sand with Basset's history force, over one without": lambda: history(case("sand")),
    "the same with the finite-Reynolds kernel of the shipped sand scene": lambda: history(read("sand")),
}


def test_every_quoted_ratio_has_a_case():
    assert set(QUOTED) == set(CASES)


@pytest.mark.parametrize("what", CASES)
def bench_ratio(benchmark, what):
    slow, fast = CASES[what]()
    seconds = measure.interleaved({"slow": slow, "fast": fast}, rounds=7, patience=30.0)
    ratio = benchmark.extra_info["ratio"] = seconds["slow"] / seconds["fast"]
    benchmark.pedantic(fast, rounds=5, warmup_rounds=1)
    assert QUOTED[what] / APART < ratio < QUOTED[what] * APART
