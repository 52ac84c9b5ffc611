"""How do other packages do on the same history integral?"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import scipy.integrate

import basset
from basset import measure
from basset.problems import PROBLEMS
from basset.weights.table import TABLES

PROBLEM = PROBLEMS["fresnel_generic"]
END = PROBLEM.end
ROOT_PI = math.sqrt(math.pi)  # Γ(1/2): the Caputo derivative of order 1/2 times this is the smooth part of H
NODES = 256  # a trajectory has at least so many steps
TARGET = 1e-9
OURS = "basset Daitche(10)"
ANEW = f"{OURS}, weights built anew"
EARLY, EARLY_STEPS = 24, 48

Compute = Callable[[int], Any]


@dataclass(frozen=True)
class Peer:
    """One way to the answer."""

    name: str
    package: str
    make: Callable[[], Compute]  # imports what it needs and returns n -> H, at nodes 1 … n or at the last one alone
    tolerance: float  # agreement asked before it is timed, absolute, with `steps` steps: what its order allows
    steps: int
    single: bool = False  # whether H is one value


def _scipy(single: bool) -> Compute:
    def value(t: float) -> float:
        return float(scipy.integrate.quad(math.cos, 0.0, t, weight="alg", wvar=(0.0, -0.5), limit=200, epsabs=TARGET, epsrel=TARGET)[0])

    return (lambda n: value(END)) if single else (lambda n: [value(t) for t in PROBLEM.grid(n)[0][1:]])


def _pycaputo_derivative() -> Compute:
    from pycaputo.differentiation import diff
    from pycaputo.differentiation.caputo import L1
    from pycaputo.grid import make_uniform_points

    return lambda n: ROOT_PI * diff(L1(0.5), np.sin, make_uniform_points(n + 1, 0.0, END))[1:]


def _pycaputo_integral(method: str, *parameters: int) -> Compute:
    from pycaputo.grid import make_uniform_points
    from pycaputo.quadrature import quad, riemann_liouville

    rule = getattr(riemann_liouville, method)(-0.5, *parameters)
    return lambda n: ROOT_PI * quad(rule, np.cos, make_uniform_points(n + 1, 0.0, END))[1:]


def _differint(function: str, order: float, samples: Callable[[Any], Any]) -> Compute:
    from differint import differint

    def compute(n: int) -> Any:
        found = np.asarray(getattr(differint, function)(order, samples, 0.0, END, n + 1))
        if found.ndim and len(found) == n:  # the last node is missing when n is even
            found = np.append(found, np.nan)
        return ROOT_PI * (found[1:] if found.ndim else found)

    return compute


def _marge3d(name: str, single: bool) -> Compute:
    from marge3d.numeric import NumericalSolver

    # the package has no function for the integral alone: its coefficients, summed as its time loop does
    coefficient = getattr(object.__new__(NumericalSolver), name)

    def row(n: int, g: Any, h: float) -> float:
        return math.sqrt(h) * float(np.dot([coefficient(j, n) for j in range(n + 1)], g[n::-1]))

    def compute(n: int) -> Any:
        t, h = PROBLEM.grid(n)
        g = np.cos(t)
        return row(n, g, h) if single else [row(k, g, h) for k in range(1, n + 1)]

    return compute


PEERS = (
    Peer("scipy quad, weight='alg', every node", "scipy", lambda: _scipy(False), 1e-9, 256),
    Peer("pycaputo L1", "pycaputo", _pycaputo_derivative, 0.05, 1024),
    Peer("pycaputo Simpson", "pycaputo", lambda: _pycaputo_integral("Simpson"), 1e-4, 1024),
    Peer("pycaputo SplineLagrange(8)", "pycaputo", lambda: _pycaputo_integral("SplineLagrange", 8), 1e-9, 256),
    Peer("differint GL", "differint", lambda: _differint("GL", -0.5, np.cos), 0.05, 1024),
    Peer("differint RL", "differint", lambda: _differint("RL", -0.5, np.cos), 0.01, 1024),
    Peer("marge3d, third error order", "marge3d", lambda: _marge3d("beta_jn", False), 0.01, 512),
    Peer("marge3d, fourth error order", "marge3d", lambda: _marge3d("gamma_jn", False), 0.01, 512),
    Peer("scipy quad, weight='alg'", "scipy", lambda: _scipy(True), 1e-9, 256, True),
    Peer("differint CaputoL1point", "differint", lambda: _differint("CaputoL1point", 0.5, np.sin), 0.05, 1024, True),
    Peer("marge3d, fourth error order, one value", "marge3d", lambda: _marge3d("gamma_jn", True), 1e-3, 1024, True),
)


def ours(n: int, order: int = 10) -> Any:
    """H at nodes 1 … n from the callable: one `cumulate`, and the first nodes again from finer samples of their own.

    The first nodes have too few samples before them for a high order. The kernel is homogeneous, so their integrals,
    each over EARLY_STEPS steps of its own size, are the columns of one evaluation with unit step.
    """
    rule = basset.Daitche(order)
    t, h = PROBLEM.grid(n)
    result = basset.cumulate(np.cos(t), h, rule)
    fine = np.linspace(0.0, 1.0, EARLY_STEPS + 1)[:, None] * t[1 : EARLY + 1]
    result[1 : EARLY + 1] = basset.integrate(np.cos(fine), 1.0, rule) * np.sqrt(t[1 : EARLY + 1] / EARLY_STEPS)
    return result[1:]


def our_value(n: int, order: int = 10) -> Any:
    """H at the last node from the callable."""
    t, h = PROBLEM.grid(n)
    return basset.integrate(np.cos(t), h, basset.Daitche(order))


def _cold(compute: Compute, n: int) -> Any:
    TABLES.clear()
    return compute(n)


def error(found: Any, n: int) -> float:
    """The largest error over the nodes that were asked for; NaN for a wrong number of them, and where one is NaN."""
    exact = PROBLEM.exact(PROBLEM.grid(n)[0][1:])
    values = np.asarray(found, dtype=np.float64)
    if values.ndim == 0:
        return float(abs(values - exact[-1]))
    return float(np.abs(values - exact).max()) if values.shape == exact.shape else float("nan")


def _disagreement(compute: Compute, peer: Peer) -> float:
    """The largest error with the steps named for the check; a node that the peer leaves out is no disagreement."""
    exact = PROBLEM.exact(PROBLEM.grid(peer.steps)[0][1:])
    values = np.asarray(compute(peer.steps), dtype=np.float64)
    return float(np.nanmax(np.abs(values - (exact[-1] if values.ndim == 0 else exact))))


def ladder(peer: Peer, compute: Compute, limit: float) -> list[dict[str, Any]]:
    """Error and seconds as the number of steps doubles, until a call takes `limit` seconds.

    SciPy refines by itself: the number of steps only says at how many nodes it is asked.
    """
    records = []
    for n in 2 ** np.arange(8, 17):
        start = time.perf_counter()
        found = compute(int(n))
        seconds = time.perf_counter() - start
        if seconds < 0.2:
            seconds = measure.interleaved({"": lambda n=n: compute(int(n))}, rounds=3, seconds=0.0)[""]
        records.append({"peer": peer.name, "single": peer.single, "n": n, "seconds": seconds, "error": error(found, int(n))})
        if seconds > limit or peer.package == "scipy":
            break
    return records


def race(contenders: dict[str, Compute], own: Compute) -> list[dict[str, Any]]:
    """Seconds to the target of whoever reaches it, interleaved; n is the first of a list that does."""
    reached: dict[str, int] = {}
    for name, compute in {OURS: own, **contenders}.items():
        for n in (256, 384, 512, 768, 1024, 1536, 2048):
            start = time.perf_counter()
            if error(compute(n), n) <= TARGET:
                reached[name] = n
                break
            if time.perf_counter() - start > 2.0:
                break
    calls = {name: lambda c=contenders.get(name, own), n=n: c(n) for name, n in reached.items()}
    if OURS in reached:
        n = reached[OURS]
        calls[ANEW] = lambda: _cold(own, n)
        reached[ANEW] = n
    times = measure.interleaved(calls, rounds=7, seconds=0.01)
    return [{"contender": k, "n": reached[k], "seconds": v, "error": error(calls[k](), reached[k])} for k, v in times.items()]


def run(full: bool) -> dict[str, Any]:
    """Who agrees, what that costs, and a race to 1e-9."""
    status, records = [], []
    agreed: dict[bool, dict[str, Compute]] = {False: {}, True: {}}
    versions = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # peers warn about powers of zero and deprecated calls
        for peer in PEERS:
            row: dict[str, Any] = {"peer": peer.name, "steps": peer.steps, "tolerance": peer.tolerance, "error": None}
            status.append(row)
            if importlib.util.find_spec(peer.package) is None:
                row |= {"status": "skipped", "reason": f"{peer.package} is not installed"}
                continue
            with contextlib.suppress(Exception):
                versions[peer.package] = version(peer.package)
            try:
                compute = peer.make()
                row["error"] = _disagreement(compute, peer)
                if not row["error"] <= peer.tolerance:
                    row |= {"status": "disagrees", "reason": "not within the tolerance its order allows; not timed"}
                    continue
                records += ladder(peer, compute, 2.0 if full else 0.5)
                agreed[peer.single][peer.name] = compute
                row |= {"status": "agrees", "reason": ""}
            except Exception as problem:  # another package's failure is a row, not ours
                row |= {"status": "failed", "reason": f"{type(problem).__name__}: {problem}"[:200]}
        for single, name, compute in ((False, OURS, ours), (True, OURS, our_value)):
            records += ladder(Peer(name, "basset", lambda: ours, TARGET, NODES, single), compute, 2.0)
        races = {"trajectory": race(agreed[False], ours), "value": race(agreed[True], our_value)}
    return {"status": status, "records": records, "races": races, "target": TARGET, "nodes": NODES, "peer_versions": versions}
