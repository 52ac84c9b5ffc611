"""What does the history at every node cost, summed directly and by FFT?"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.signal

import basset
from basset import measure
from basset.problems import PROBLEMS
from basset.weights.table import table

ORDERS = (1, 3, 8)


def direct(g: Any, dt: float, rule: Any) -> Any:
    """Every node by its own dot product with the cached weights, O(N²)."""
    weights = table(rule.recipe(1.0, 1.0, basset.BassetKernel()).stencil, basset.BassetKernel(), "rate")
    result = np.zeros(len(g))
    for n in range(1, len(g)):
        oldest, body = weights.row(n)
        split = len(oldest)
        result[n] = np.dot(oldest, g[:split]) + np.dot(body, g[split : n + 1])
    return np.sqrt(dt) * result


def run(full: bool) -> dict[str, Any]:
    """Seconds, and the largest error over the whole path and over its second half, up to 2^16 steps.

    The two differ for high orders: the first p nodes have fewer samples behind them than the stencil wants.
    """
    problem = PROBLEMS["fresnel_generic"]
    records, ratios = [], []
    summed_to, rounds = (2**16, 7) if full else (2**12, 3)
    for n in 2 ** np.arange(8, 17, 1 if full else 2):
        arguments = problem.arguments(n)
        g, dt = arguments["g"], arguments["dt"]
        exact = problem.exact(problem.grid(n)[0])
        for p in ORDERS:
            rule = basset.Daitche(p)
            kept = rule.weights(n, dt)
            contenders = {
                "fft": lambda g=g, dt=dt, rule=rule: basset.cumulate(g, dt, rule),
                "fftconvolve": lambda g=g, kept=kept: scipy.signal.fftconvolve(g, kept),
            }
            found = {"fft": contenders["fft"]()}
            times = measure.interleaved(contenders, rounds=rounds, seconds=0.01)
            ratios.append({"order": p, "n": n, "cumulate": times["fft"], "fftconvolve": times["fftconvolve"]})
            if n <= summed_to:
                found["direct"] = direct(g, dt, rule)
                # each call has n row look-ups of its own: one timing is enough
                times |= measure.interleaved({"direct": lambda g=g, dt=dt, rule=rule: direct(g, dt, rule)}, rounds=1, seconds=0.0, patience=0.2)
            for method, values in found.items():
                records.append(
                    {
                        "problem": problem.name,
                        "scheme": f"Daitche({p})",
                        "method": method,
                        "n": n,
                        "h": dt,
                        "seconds": times[method],
                        "error_path": np.abs(values - exact)[1:].max(),
                        "error_max": np.abs(values - exact)[n // 2 :].max(),
                        "difference": np.abs(values - found["direct"]).max() if "direct" in found else None,
                    }
                )
    return {"records": records, "ratios": ratios}
