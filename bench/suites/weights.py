"""How many digits do the weights keep as the lag grows, and what does it cost to build them?"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import basset
from basset import measure, reference
from basset.weights.table import TABLES
from bench import published

ORDERS = (1, 2, 3, 4, 6, 8, 10)
ARITHMETICS = ("double", "extended", "quad")


def _error(computed: Any, exact: list[Any], lags: Any) -> np.ndarray[Any, Any]:
    """Difference from mpmath, relative to max(|w_j|, K(j)): a weight near zero is not asked for relative digits."""
    truth = np.array([float(w) for w in exact])
    difference = np.array([float(c - w) for c, w in zip(computed, exact, strict=True)])
    return np.abs(difference) / np.maximum(np.abs(truth), 1.0 / np.sqrt(np.maximum(lags, 1)))


def accuracy(full: bool) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Errors at log-uniform lags (one record per builder and lag), and the worst of ours by region."""
    largest = 10**7 if full else 10**6
    dense = 200 if full else 32
    n = largest + 100
    lags = np.unique(np.round(np.logspace(1, np.log10(largest), 37 if full else 16)).astype(int))
    records, worst = [], []
    for p in ORDERS:
        exact = reference.product_weights(n, lags, p)
        ours = basset.Daitche(p).weights(n, 1.0)
        builders = {"ours": ours[lags]}
        if p <= 3:
            builders |= {arithmetic: published.daitche_interior(p, lags, arithmetic) for arithmetic in ARITHMETICS}
        for builder, values in builders.items():
            errors = _error(values, exact, lags)
            records += [{"builder": builder, "order": p, "lag": j, "error": e} for j, e in zip(lags, errors, strict=True)]
        near, old = np.arange(dense + 1), np.arange(n - 2 * p - 1, n + 1)
        regions = {
            f"newest {dense + 1}": _error(ours[near], reference.product_weights(n, near, p), near),
            f"log-uniform to {largest:.0e}": _error(ours[lags], exact, lags),
            f"oldest {len(old)}": _error(ours[old], reference.product_weights(n, old, p), old),
        }
        worst += [{"order": p, "region": region, "error": errors.max()} for region, errors in regions.items()]
        TABLES.clear()
    return records, worst


def same_weights(n: int = 4096) -> dict[str, float]:
    """Largest relative difference between thesis eqs. 5-7 and 5-11: as coded in double, and 5-11 from quadruple precision."""
    hinsberg = published.hinsberg(n)
    return {"n": n} | {a: np.abs(published.daitche(1, n, a) / hinsberg - 1.0).max() for a in ("double", "quad")}


def _ours(p: int, n: int) -> None:
    TABLES.clear()
    basset.Daitche(p).weights(n, 1.0)


def building(full: bool) -> list[dict[str, Any]]:
    """Seconds to build n weights, all builders and lengths taking turns; quadruple precision up to about half of `patience`."""
    patience, rounds = (1.0, 6) if full else (0.2, 2)
    builders: dict[str, Callable[[int], Any]] = {
        **{f"ours, p = {p}": lambda n, p=p: _ours(p, n) for p in (1, 3, 8)},
        **{f"published double, p = {p}": lambda n, p=p: published.daitche(p, n) for p in (1, 3)},
        "thesis 5-7": published.hinsberg,
        "published quad, p = 3": lambda n: published.daitche(3, n, "quad"),
    }
    calls: dict[tuple[str, int], Callable[[], Any]] = {}
    for name, build in builders.items():
        for n in 2 ** np.arange(10, 19):
            start = time.perf_counter()
            build(int(n))
            calls[name, int(n)] = lambda build=build, n=n: build(int(n))
            if time.perf_counter() - start > patience / 2.0:
                break
    times = measure.interleaved(calls, rounds=rounds, seconds=0.0, patience=patience / 2.0)
    return [{"builder": name, "n": n, "seconds": seconds} for (name, n), seconds in times.items()]


def run(full: bool) -> dict[str, Any]:
    """Error by lag and time by length."""
    errors, worst = accuracy(full)
    return {"errors": errors, "worst": worst, "building": building(full), "same": same_weights(), "quad_digits": published.QUAD_DIGITS}
