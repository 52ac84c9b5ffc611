"""What does a window save, and at which error: the thesis's 70 to 90 % of the simulation time, re-measured?"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.special

import basset
from basset import ExponentialSum, measure
from basset.kernels import Floats
from basset.problems import PROBLEMS

Contenders = dict[tuple[str, int, float], tuple[basset.Rule, Callable[[], Floats]]]  # (scheme, order, share) -> (rule, H at every node)
SHARES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.163, 0.3, 0.5, 0.8)  # window over the length of the run
HOPPING = (0.01, 0.05, 0.1, 0.3, 0.5)  # the same where there are jumps
ORDERS = (1, 2, 3)
PROMISE = 1e-6  # of the fitted tails
HOPS, STEPS, RELAXATION = 40, 200, 0.3  # hops of length 1, steps in each, time in which the slip's rate fades


def tailed(order: int, window: float, end: float) -> basset.Windowed:
    """The window with a fitted tail behind it."""
    return basset.Windowed(basset.Daitche(order), window, ExponentialSum.fit(window, end, PROMISE))


def measured(truth: Floats, contenders: Contenders, rounds: int) -> list[dict[str, Any]]:
    """Seconds and largest error over the second half of the path, relative to the largest |H| there."""
    seconds = measure.interleaved({key: call for key, (_, call) in contenders.items()}, rounds=rounds, seconds=0.0)
    half, records = len(truth) // 2, []
    for (scheme, order, share), (_, call) in contenders.items():
        error = np.abs(call() - truth)[half:].max() / np.abs(truth[half:]).max()
        records.append({"scheme": scheme, "order": order, "share": share, "seconds": seconds[scheme, order, share], "error": float(error)})
    return records


def contenders(n: int, dt: float, play: Callable[[basset.Rule], Callable[[], Floats]], shares: tuple[float, ...], orders: tuple[int, ...]) -> Contenders:
    """Whole history, windows without and with a tail, the leanest stream; by (scheme, order, share)."""
    found: Contenders = {}
    end = n * dt
    for p in orders:
        windows = {share: max(round(share * n), p // 2 + 1) * dt for share in shares}
        rules: dict[Any, basset.Rule] = {("full", p, 1.0): basset.Daitche(p)}
        rules |= {("window", p, share): basset.Windowed(basset.Daitche(p), window) for share, window in windows.items()}
        rules |= {("tail", p, share): tailed(p, window, end) for share, window in windows.items()}
        rules[("exponential", p, 0.0)] = basset.Exponential(p, PROMISE)
        found |= {key: (rule, play(rule)) for key, rule in rules.items()}
    return found


def cosine(full: bool) -> dict[str, Any]:
    """Smooth: g = cos τ."""
    problem = PROBLEMS["fresnel_generic"]
    n = 2**15 if full else 2**13
    arguments = problem.arguments(n)
    g, dt = arguments["g"], arguments["dt"]
    truth = np.zeros(n + 1)
    truth[1:] = problem.exact(problem.grid(n)[0][1:])

    def play(rule: basset.Rule) -> Callable[[], Floats]:
        plan = rule.plan(dt, problem.end)
        return lambda: plan.run(plan.start(), g)

    return {"end": problem.end, "n": n, "records": measured(truth, contenders(n, dt, play, SHARES, ORDERS), 7)}


def hops_exact(t: Floats, hops: int) -> Floats:
    """H of the hopping grain at times t that are no impacts (or, at one, just before it).

    In each hop of length 1 the slip starts at 1 with the rate e^(−s/θ), s the time since take-off, and at the impact it jumps
    back to 1. With u = t − τ, ∫ u^(−1/2) e^(u/θ) du = 2√θ e^(u/θ) D(√(u/θ)), D being Dawson's integral.
    """
    theta, result = RELAXATION, np.zeros_like(t)
    jump = -theta * -math.expm1(-1.0 / theta)
    for k in range(hops):
        since = t - k
        flying = since > 0.0
        result[flying] += (1.0 if k == 0 else jump) / np.sqrt(since[flying])
        old, new = np.sqrt(np.maximum(since, 0.0) / theta), np.sqrt(np.maximum(since - 1.0, 0.0) / theta)
        result += 2.0 * math.sqrt(theta) * (scipy.special.dawsn(old) - math.exp(-1.0 / theta) * scipy.special.dawsn(new))
    return result


def saltation(full: bool) -> dict[str, Any]:
    """A grain that hops: the slip relaxes in flight and jumps at every impact; jumps through `plan.jump`."""
    hops, dt = HOPS, 1.0 / STEPS
    s = dt * np.arange(STEPS + 1.0)
    flight = np.exp(-s / RELAXATION)
    jump = -RELAXATION * -math.expm1(-1.0 / RELAXATION)
    truth = hops_exact(dt * np.arange(hops * STEPS + 1.0), hops)
    truth[0] = 0.0

    def play(rule: basset.Rule, jumps: bool = True) -> Callable[[], Floats]:
        plan = rule.plan(dt, float(hops))

        def hop() -> Floats:
            state, parts = plan.start(), []
            plan.push(state, 1.0)
            for k in range(hops):
                if jumps:
                    plan.jump(state, jump if k else 1.0, g=1.0 if k else None)
                parts.append(plan.run(state, flight[1:]))
            return np.concatenate([[0.0], *parts])

        return hop

    chosen, rounds = contenders(hops * STEPS, dt, play, HOPPING if full else HOPPING[::2], ORDERS if full else ORDERS[-1:]), 3 if full else 1
    records = measured(truth, chosen, rounds)
    without = measure.interleaved({key: play(rule, jumps=False) for key, (rule, _) in chosen.items()}, rounds=rounds, seconds=0.0)
    for record, seconds in zip(records, without.values(), strict=True):
        record["seconds_steps"] = seconds
    return {"hops": hops, "steps": STEPS, "relaxation": RELAXATION, "n": hops * STEPS, "records": records}


def run(full: bool) -> dict[str, Any]:
    """Error and time against the window, without and with a fitted tail, on a smooth signal and on one with jumps."""
    return {"promise": PROMISE, "cosine": cosine(full), "saltation": saltation(full)}
