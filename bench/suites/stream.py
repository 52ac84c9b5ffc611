"""What does the history cost as a stream: nanoseconds per step, bytes per grain and digits, for every scheme?"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import basset
from basset import ExponentialSum, measure
from basset.kernels import Floats
from basset.problems import PROBLEMS
from basset.weights.table import TABLES

STEP = 0.01  # seconds; the rate is cos τ + 1/10, so that H holds an oscillation and a growing mean
WINDOW = 1.0  # seconds: 100 steps
FULL, BARE, PUBLISHED, TAIL = "full history", "window, no tail", "Hinsberg, published tail", "window, tail 1e-6"
HEADLINE = "Exponential(3, 1e-6)"
LONGEST = 10**6
SUMMED_TO = 2**15  # longest full history, whose cost per step grows with the steps
AGAIN = 2000  # further steps that are timed
DIRECT = 32000  # steps behind the newest at which the direct sum is raced
GRAINS, COMPONENTS = 10**4, 3
STARTUP = """
import time
begin = time.perf_counter()
import numpy, basset
imported = time.perf_counter()
plan = basset.Exponential(3, 1e-6).plan(1e-3, 1e3)
state = plan.start(3)
planned = time.perf_counter()
plan.run(state, numpy.ones((10, 3)))
print(imported - begin, planned - imported, time.perf_counter() - planned)
"""


def rates(steps: int) -> Floats:
    """The rate at that many nodes."""
    return np.cos(STEP * np.arange(steps)) + 0.1


def schemes(horizon: float) -> dict[str, basset.Rule]:
    """Every scheme that can be streamed; sums of exponentials are fitted to the horizon (seconds)."""
    exponential = {f"Exponential({p}, 1e-{k})": basset.Exponential(p, 10.0**-k) for p in (1, 3, 6) for k in (3, 6, 9)}
    return {
        FULL: basset.Daitche(3),
        BARE: basset.Windowed(basset.Daitche(3), WINDOW),
        PUBLISHED: basset.Hinsberg(WINDOW),
        TAIL: basset.Windowed(basset.Daitche(3), WINDOW, ExponentialSum.fit(WINDOW, max(horizon, 2.0 * WINDOW), 1e-6)),
        **exponential,
    }


def nbytes(state: Any) -> int:
    """Bytes of a state."""
    return sum(array.nbytes for array in state)


def marching(plan: Any, shape: tuple[int, ...], node: int, steps: int, passes: int = 1) -> Callable[[], None]:
    """A call that takes `passes` × `steps` steps from that node on, and goes back to it.

    The state is one that has seen `node` samples, filled with some numbers: what a step costs does not depend on them.
    """
    generator = np.random.default_rng(1)
    state, block = plan.start(shape), generator.standard_normal((steps, *shape))
    state.samples[...] = generator.standard_normal(state.samples.shape[1])
    before = np.array([node, node, 0.0])

    def march() -> None:
        state.counters[:] = before
        for _ in range(passes):
            plan.run(state, block)

    return march


def against_steps(full: bool) -> list[dict[str, Any]]:
    """Nanoseconds of a step after n steps, bytes per grain of three components, and the error over n steps, for every scheme and n.

    The time is that of further steps in one call, less that of a call for a single step; all schemes and all n take turns.
    """
    plans: dict[tuple[str, int], Any] = {}
    for n in (10**3, 4096, 10**4, SUMMED_TO, 10**5, LONGEST):
        horizon = (n + AGAIN) * STEP
        for name, rule in schemes(horizon).items():
            if n <= SUMMED_TO if name == FULL else full or n not in (4096, SUMMED_TO):
                plans[name, n] = rule.plan(STEP, horizon)
    block = {key: 50 if key[0] == FULL else AGAIN for key in plans}
    calls = {(key, steps): marching(plan, (), key[1], steps) for key, plan in plans.items() for steps in (1, block[key])}
    seconds = measure.interleaved(calls, rounds=30 if full else 7, seconds=0.0005)
    records = []
    for n in sorted({n for _, n in plans}):
        g, truth, needed = rates(n + 1), {}, schemes(n * STEP)
        for name, plan in ((name, plan) for (name, length), plan in plans.items() if length == n):
            p = plan.recipe.degree
            if p not in truth:
                truth[p] = basset.cumulate(g, STEP, basset.Daitche(p))
            error = None if name == FULL else float(np.abs(plan.run(plan.start(), g) - truth[p]).max() / np.abs(truth[p]).max())
            several, one = seconds[(name, n), block[name, n]], seconds[(name, n), 1]
            records.append(
                {
                    "scheme": name,
                    "n": n,
                    "order": p,
                    "terms": len(plan.tail_sum) if plan.tail_sum is not None else 0,
                    "nanoseconds": 1e9 * (several - one) / (block[name, n] - 1),
                    "bytes": nbytes(needed[name].plan(STEP, n * STEP).start(COMPONENTS)),
                    "error": error,
                }
            )
        TABLES.clear()
    return records


def many_grains(full: bool) -> list[dict[str, Any]]:
    """Nanoseconds per step, grain and component of many grains after a thousand steps, for every scheme."""
    node, steps = 1000, 1000 if full else 20
    plans = {name: rule.plan(STEP, 2.0 * node * STEP) for name, rule in schemes(2.0 * node * STEP).items()}
    records = []
    for name, plan in plans.items():  # one after the other: a state of the full history weighs hundreds of megabytes
        grains = GRAINS if name != FULL else GRAINS // 10
        block = min(steps, 50)
        call = marching(plan, (grains, COMPONENTS), node, block, steps // block)
        seconds = measure.interleaved({name: call}, rounds=2, seconds=0.0, patience=4.0)[name]
        records.append({"scheme": name, "n": node, "grains": grains, "nanoseconds": 1e9 * seconds / (steps * grains * COMPONENTS)})
    return records


def headline(full: bool) -> dict[str, Any]:
    """The asked figures in one run: order 3, rtol 1e-6, planned for a million steps."""
    plan = basset.Exponential(3, 1e-6).plan(STEP, LONGEST * STEP)
    g = rates(LONGEST).reshape(10, -1)
    plan.run(plan.start(), g[0])
    tenths = np.full(10, np.inf)
    for _ in range(30 if full else 10):
        state = plan.start()
        for i, part in enumerate(g):
            start = time.perf_counter()
            plan.run(state, part)
            tenths[i] = min(tenths[i], time.perf_counter() - start)
    # 1e4 grains over 1e3 steps, from their start, in blocks of 100 steps
    shape, blocks = (GRAINS, COMPONENTS), 10
    block = np.random.default_rng(1).standard_normal((LONGEST // GRAINS, *shape))
    many, steps = [], blocks * len(block)
    for _ in range(5 if full else 2):
        state, start = plan.start(shape), time.perf_counter()
        for _ in range(blocks):
            plan.run(state, block)
        many.append(time.perf_counter() - start)
    # the direct sum at n = 32000: the full-history plan's own step, one BLAS dot product, and ours, in turn
    history = basset.Daitche(3).plan(STEP, (DIRECT + 100) * STEP)
    weights, samples = np.ones(DIRECT), np.ones(DIRECT)
    race = measure.interleaved(
        {"direct": marching(history, (), DIRECT, 50), "stream": marching(plan, (), DIRECT, 10_000), "dot": lambda: np.dot(weights, samples)},
        rounds=15,
        seconds=0.005,
    )
    return {
        "terms": len(plan.tail_sum) if plan.tail_sum is not None else 0,
        "steps": LONGEST,
        "tenths": 1e9 * tenths / (LONGEST / 10),
        "one": 1e9 * float(tenths.sum()) / LONGEST,
        "grains": GRAINS,
        "grain_steps": steps,
        "many": 1e9 * min(many) / (steps * GRAINS * COMPONENTS),
        "direct_n": DIRECT,
        "direct": 1e9 * race["direct"] / 50,
        "stream": 1e9 * race["stream"] / 10_000,
        "dot": 1e9 * race["dot"],
        "bytes": nbytes(plan.start(COMPONENTS)),
    }


def calls() -> dict[str, float]:
    """Seconds of the calls from Python, one grain of three components."""
    plan = basset.Exponential(3, 1e-6).plan(STEP, LONGEST * STEP)
    state, sample, block = plan.start(COMPONENTS), np.ones(COMPONENTS), np.ones((100, COMPONENTS))
    plan.run(state, block)
    node = state.counters.copy()

    def back(call: Callable[[], Any]) -> Callable[[], Any]:
        def once() -> None:
            state.counters[:] = node
            call()

        return once

    return measure.interleaved(
        {
            "push": back(lambda: plan.push(state, sample)),
            "tail": back(lambda: plan.tail(state)),
            "local": back(lambda: plan.local(state)),
            "run of 100": back(lambda: plan.run(state, block)),
            "jump": back(lambda: plan.jump(state, 1.0)),
            "jump of f and g": back(lambda: plan.jump(state, 1.0, g=sample)),
        },
        rounds=7,
        seconds=0.01,
    )


def agreement(full: bool) -> list[dict[str, Any]]:
    """Streams with a sum of rtol 1e-10 against `cumulate`, a million steps (a tenth of that unless in full), degrees 1 to 6."""
    steps = LONGEST if full else LONGEST // 10
    g, records = rates(steps + 1), []
    for p in range(1, 7):
        plan = basset.Exponential(p, 1e-10).plan(STEP, steps * STEP)
        windowed = basset.Windowed(basset.Daitche(p), WINDOW, ExponentialSum.fit(WINDOW, steps * STEP, 1e-10)).plan(STEP, steps * STEP)
        truth = basset.cumulate(g, STEP, basset.Daitche(p))
        scale = np.abs(truth).max()
        for name, found in (("Exponential", plan), ("Windowed", windowed)):
            difference = np.abs(found.run(found.start(), g) - truth).max() / scale
            records.append({"scheme": name, "order": p, "n": steps, "terms": len(found.tail_sum), "difference": float(difference)})
    TABLES.clear()
    return records


def convergence() -> list[dict[str, Any]]:
    """Error against the exact H(t) for g = cos τ as the step falls: whole history, and streams that promise 1e-3, 1e-6 and 1e-9."""
    problem, records = PROBLEMS["fresnel_generic"], []
    for n in 2 ** np.arange(7, 18):
        arguments = problem.arguments(int(n))
        g, dt = arguments["g"], arguments["dt"]
        exact = problem.exact(problem.grid(int(n))[0][n // 2 :])
        for p in (1, 3, 6):
            found = {"full": basset.cumulate(g, dt, basset.Daitche(p))}
            for k in (3, 6, 9):
                plan = basset.Exponential(p, 10.0**-k).plan(dt, problem.end)
                found[f"1e-{k}"] = plan.run(plan.start(), g)
            for name, values in found.items():
                error = np.abs(values[n // 2 :] - exact).max() / np.abs(exact).max()
                records.append({"order": p, "promise": name, "n": int(n), "h": dt, "error": float(error)})
    return records


def second_process(full: bool) -> dict[str, float]:
    """Seconds of a fresh process that runs a compiled stream, the compiled code being on disk: in all, and its parts."""
    best = {"total": float("inf")}
    for _ in range(10 if full else 3):
        start = time.perf_counter()
        root = Path(basset.__file__).resolve().parent.parent
        done = subprocess.run([sys.executable, "-c", STARTUP], capture_output=True, text=True, check=True, cwd=root)
        total = time.perf_counter() - start
        if total < best["total"]:
            imports, plan, run = (float(part) for part in done.stdout.split())
            best = {"total": total, "import": imports, "plan": plan, "run": run}
    return best


def run(full: bool) -> dict[str, Any]:
    """Times, bytes and errors of every scheme against the number of steps, and the figures that were asked."""
    basset.Exponential(1).plan(1.0, 10.0).run(basset.Exponential(1).plan(1.0, 10.0).start(), np.ones(3))  # compiled, or read from disk
    results: dict[str, Any] = {
        "step": STEP,
        "window": WINDOW,
        "components": COMPONENTS,
        "headline": headline(full),
        "records": against_steps(full),
        "many": many_grains(full),
        "calls": calls(),
        "agreement": agreement(full),
        "convergence": convergence(),
        "second": second_process(full),
    }
    results["load"] = os.getloadavg()[0] if hasattr(os, "getloadavg") else None  # of the last minute: what else ran on the machine
    return {**results, "cores": os.cpu_count()}
