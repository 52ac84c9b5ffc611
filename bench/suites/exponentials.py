"""How many decaying exponentials does a promised error cost, and what are the published sets worth?"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import basset
from basset import ExponentialSum, exponentials, measure, reference
from basset.kernels import Floats

RATIOS = (1e2, 1e3, 3e4, 1e6, 1e9)  # far/near
PROMISES = tuple(10.0**-k for k in range(2, 13))
USED = 1e3  # the published sets are judged on window … USED × window
WINDOWS = (0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 3.0)  # seconds, of the force error on g = cos
END, STEP, DEGREE = 200.0, 0.01, 4  # of the same: seconds, seconds, degree of the polynomials
FINITE = {  # the kernels with unit steepness: lags are then x = C^(2/3) s
    "Mei–Adrian": basset.MeiAdrianKernel(0.75 * (2.0 / math.sqrt(math.pi)) ** (1.0 / 3.0), 1.0, 1.0, 2.0, 0.0),
    "Dorgan–Loth": basset.MeiAdrianKernel(0.75 * (2.0 / math.sqrt(math.pi)) ** (1.0 / 3.0), 1.0, 1.0, 2.5, 0.0),
}
PUBLISHED: dict[str, Callable[[float, int], ExponentialSum]] = {
    "van Hinsberg": lambda window, terms: ExponentialSum.van_hinsberg(window),
    "Casas I2t": lambda window, terms: ExponentialSum.casas(window, terms, "I2t"),
    "Casas I1": lambda window, terms: ExponentialSum.casas(window, terms, "I1"),
}


def law(error: float, ratio: float) -> float:
    """Terms at which the limit law E = 2.7 exp(−π² n / ln 4R) gives that error."""
    return math.log(2.7 / error) * math.log(4.0 * ratio) / math.pi**2


def trapezoid(ratio: float, rtol: float) -> ExponentialSum:
    """1/√s = π^(−1/2) ∫ exp(−s e^x + x/2) dx by the plain trapezoidal rule: the widest step and the fewest nodes for that error on [1, ratio].

    The step x_{k+1} − x_k = h alone makes an error of 2√2 exp(−π²/h), relative and independent of s; what is left of the
    promise goes to the nodes dropped at either end.
    """
    best: ExponentialSum | None = None
    for h in math.pi**2 / (math.log(2.0 * math.sqrt(2.0) / (0.99 * rtol)) + np.geomspace(0.01, 6.0, 40)):
        left = 0.99 * rtol - 2.0 * math.sqrt(2.0) * math.exp(-(math.pi**2) / h)
        x = h * np.arange(math.floor((2.0 * math.log(rtol) - math.log(ratio) - 9.0) / h), math.ceil((math.log(-math.log(rtol)) + 2.0) / h))
        weights, rates = h / math.sqrt(math.pi) * np.exp(0.5 * x), np.exp(x)
        slow = np.cumsum(weights * np.exp(-rates * ratio)) * math.sqrt(ratio)  # relative to 1/√s at the far end
        fast = np.cumsum((weights * np.exp(-rates))[::-1])
        kept = slice(int(np.searchsorted(slow, left)), len(x) - int(np.searchsorted(fast, left)))
        if best is None or len(x[kept]) < len(best):
            best = ExponentialSum(weights[kept], rates[kept], 1.0, ratio, basset.BassetKernel())
    assert best is not None
    return best


def longest(near: float, far: float, terms: int, kernel: basset.Kernel = basset.BassetKernel()) -> ExponentialSum:
    """The fitted sum with the smallest promised error that has no more than that many terms."""
    best: ExponentialSum | None = None
    for quarters in range(1, 57):
        try:
            found = ExponentialSum.fit(near, far, 10.0 ** (-quarters / 4.0), kernel)
        except ValueError:
            break
        if len(found) > terms:
            break
        best = found
    assert best is not None, f"{terms} terms are too few for far/near = {far / near:g}"
    return best


def fitted() -> list[dict[str, Any]]:
    """Terms, promised and measured errors of the fitted sums, and of the plain trapezoid."""
    records = []
    for ratio in RATIOS:
        for rtol in PROMISES:
            found, plain = ExponentialSum.fit(1.0, ratio, rtol), trapezoid(ratio, rtol)
            records.append(
                {
                    "ratio": ratio,
                    "rtol": rtol,
                    "n": len(found),
                    "error": found.max_relative_error(),
                    "law": law(rtol, ratio),
                    "trapezoid": len(plain),
                    "trapezoid_error": plain.max_relative_error(),
                }
            )
    return records


def finite() -> list[dict[str, Any]]:
    """The same for the finite-Reynolds kernels, over ranges of x = C^(2/3) s, beside the Basset kernel's terms on the same range."""
    records = []
    for name, kernel in FINITE.items():
        for near, far in ((1e-6, 1.0), (1e-3, 1e3), (1.0, 1e6), (1e-6, 1e6)):
            for rtol in (1e-3, 1e-6, 1e-9):
                try:
                    found = ExponentialSum.fit(near, far, rtol, kernel)
                except ValueError as error:
                    records.append({"kernel": name, "near": near, "far": far, "rtol": rtol, "n": None, "error": None, "basset": None, "refused": str(error)})
                    continue
                basset_terms = len(ExponentialSum.fit(near, far, rtol))
                error = found.max_relative_error()
                records.append(
                    {"kernel": name, "near": near, "far": far, "rtol": rtol, "n": len(found), "error": error, "basset": basset_terms, "refused": None}
                )
    return records


def times() -> dict[str, float]:
    """Seconds of a fit: the first one (which reads the table) and the slowest of later ones."""

    def first() -> None:
        exponentials._basset_table.cache_clear()
        ExponentialSum.fit(1e-3, 1e3, 1e-6)

    calls: dict[Any, Callable[[], Any]] = {(ratio, rtol): lambda a=ratio, b=rtol: ExponentialSum.fit(1.0, a, b) for ratio in RATIOS for rtol in PROMISES}
    later = measure.interleaved(calls, rounds=5, seconds=0.001)
    return {"first": measure.interleaved({"first": first}, rounds=5, seconds=0.0)["first"], "later": max(later.values())}


def published() -> list[dict[str, Any]]:
    """Largest relative error of every published set on window … USED × window, and of the fitted sum with as many terms."""
    records = []
    for name, make in PUBLISHED.items():
        for terms in (10,) if name == "van Hinsberg" else range(1, 11):
            records.append({"set": name, "n": terms, "error": make(1.0, terms).max_relative_error(1.0, USED)})
    for terms in range(5, 26):
        records.append({"set": "fitted", "n": terms, "error": longest(1.0, USED, terms).max_relative_error()})
    return records


def curves() -> dict[str, Any]:
    """|sum/K − 1| against the lag in windows, ten terms each."""
    lags = np.geomspace(1.0, 1e6, 481)
    sums = {name: make(1.0, 10) for name, make in PUBLISHED.items()}
    sums["fitted"] = longest(1.0, USED, 10)
    values = {name: np.abs(found(lags) * np.sqrt(lags) - 1.0) for name, found in sums.items()}
    return {"lags": lags, "values": values}


def force(window: float, tail: ExponentialSum, g: Floats, exact: Floats) -> dict[str, float]:
    """Largest error of H over the whole path and over its second half."""
    plan = basset.Windowed(basset.Daitche(DEGREE), window, tail).plan(STEP, END)
    error = np.abs(plan.run(plan.start(), g) - exact)
    return {"error_path": float(error.max()), "error_max": float(error[len(error) // 2 :].max())}


def floors() -> list[dict[str, Any]]:
    """The force error on g = cos τ that no step removes, against the window: published sets, and ten fitted terms on the range really used."""
    steps = round(END / STEP)
    t = STEP * np.arange(steps + 1.0)
    g, exact = np.cos(t), np.zeros(steps + 1)
    exact[1:] = reference.cosine(t[1:])
    records = []
    for window in WINDOWS:
        tails = {name: make(window, 10) for name, make in PUBLISHED.items()}
        tails["fitted"] = longest(window, END, 10)
        records += [{"set": name, "window": window, "n": len(tail), **force(window, tail, g, exact)} for name, tail in tails.items()]
    return records


def run(full: bool) -> dict[str, Any]:
    """Terms against promised error for fitted sums, the plain trapezoid and the published sets; force errors on g = cos."""
    return {
        "fitted": fitted(),
        "finite": finite(),
        "times": times(),
        "published": published(),
        "used": USED,
        "curves": curves(),
        "floors": floors(),
        "force": {"end": END, "step": STEP, "degree": DEGREE},
    }
