"""What does a digit of a coupled solution cost, and what does a jump do to each scheme's order?"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from typing import Any

import numpy as np
import scipy.integrate

import basset
from basset import ExponentialSum, measure, reference
from basset._compile import compiled
from basset.kernels import Floats
from basset.solvers.base import Method, Solution

RATE, COEFFICIENT, GRAVITY = 1.0, 0.6, 1.0  # λ (1/s), c (s^(-1/2)), g (m/s²) of the linear problems
RESTITUTION, IMPACTS = 0.8, 10
FIRST = 3  # impacts by which orders are measured: coarse grids do not see ten
BETA, OMEGA = 0.5, 1.0  # of the vortex
RTOLS = tuple(10.0**-k for k in range(3, 12))
TAIL = 1e-9  # promised error of the fitted tails
TARGET = 1e-6  # of the race on the bouncing sphere


@dataclass(frozen=True)
class Case:
    """One equation with its exact solution."""

    name: str
    start: str  # of the memory: smooth, flat, rest (√t terms), slip (a jump at t = 0), impacts
    fun: Callable[[float, Floats], Any]  # rate without history
    end: float  # s
    y0: tuple[float, ...]
    exact: Callable[[Floats], Floats]  # times (k,) -> states (n_states, k); for the bouncing sphere heights and velocities
    memory: tuple[int, ...] = (0,)
    initial_slip: float | None = None
    coefficient: float = COEFFICIENT  # s^(-1/2)
    impacts: Floats | None = None  # exact times, s
    restitution: float = RESTITUTION

    def solve(self, method: Method, dense: bool = False) -> Solution:
        """One run."""
        events = bed(self.restitution) if self.impacts is not None else None
        return basset.solve(
            self.fun,
            (0.0, self.end),
            self.y0,
            memory=self.memory,
            coefficient=self.coefficient,
            initial_slip=self.initial_slip,
            method=method,
            events=events,
            dense_output=dense,
        )


def bed(restitution: float) -> Callable[[float, Floats], float]:
    """The event of touching the bed, with the rebound as its jump."""

    def touch(t: float, y: Floats) -> float:
        return float(y[0])

    touch.direction = -1  # type: ignore[attr-defined]
    touch.jump = lambda t, y: np.array([0.0, -restitution * y[1]])  # type: ignore[attr-defined]
    return touch


def bouncing_case(impacts: int, restitution: float, rate: float, coefficient: float) -> Case:
    """A sphere dropped from height 1, until half-way through the flight after the last impact."""
    exact = reference.bouncing(rate, coefficient, GRAVITY, 1.0, restitution, impacts)
    last = exact.times[-1] if impacts else 0.0
    return Case(
        "bouncing",
        "impacts",
        lambda t, y: np.array([y[1], -GRAVITY - rate * y[1]]),
        float(0.5 * (last + exact.end)),
        (1.0, 0.0),
        lambda t: np.array([exact.height(t), exact.velocity(t)]),
        memory=(1,),
        coefficient=coefficient,
        impacts=np.asarray(exact.times, dtype=np.float64),
        restitution=restitution,
    )


def _manufactured(name: str, terms: tuple[tuple[float, float], ...], start: str) -> Case:
    """The slip y = Σ a (1 − cos ωt)/ω, y' = Σ a sin ωt for (a, ω) in `terms`: its history is known, fun makes it the solution."""

    def slip(t: Any) -> Any:
        return sum(a * (1.0 - np.cos(w * t)) / w for a, w in terms)

    @lru_cache(maxsize=1 << 20)  # the solver is measured, not Fresnel's integrals
    def force(t: float) -> float:
        rate = sum(a * math.sin(w * t) for a, w in terms)
        return float(rate + RATE * slip(t) + COEFFICIENT * sum(a * reference.sine(t, w) for a, w in terms))

    return Case(name, start, lambda t, y: force(t) - RATE * y, 4.0, (0.0,), lambda t: slip(t)[None])


def _stream(name: str, slip: float) -> Case:
    start = "slip" if slip else "rest"
    exact = lambda t: reference.oscillating_stream(t, RATE, COEFFICIENT, 1.0, 1.0, slip)[None]  # noqa: E731
    return Case(name, start, lambda t, y: math.cos(t) - RATE * y, 10.0, (slip,), exact)


def _vortex(name: str, slip: float, rate: float = RATE, coefficient: float = COEFFICIENT, beta: float = BETA, end: float = 6.0) -> Case:
    def fun(t: float, y: Floats) -> Any:
        x1, x2, w1, w2 = y
        lift = (1.0 - beta) * OMEGA**2
        return np.array([w1 - OMEGA * x2, w2 + OMEGA * x1, -rate * w1 + OMEGA * w2 + lift * x1, -rate * w2 - OMEGA * w1 + lift * x2])

    def exact(t: Floats) -> Floats:
        z, w = reference.solid_body_vortex(t, rate, coefficient, beta, OMEGA, 1.0, slip)
        return np.array([z.real, z.imag, w.real, w.imag])

    return Case(name, "slip" if slip else "rest", fun, end, (1.0, 0.0, slip, 0.0), exact, memory=(2, 3), coefficient=coefficient)


def cases() -> list[Case]:
    """Every reference problem."""
    return [
        _manufactured("smooth", ((1.0, 1.0),), "smooth"),
        _manufactured("flat", ((2.0, 1.0), (-1.0, 2.0)), "flat"),
        Case("settling", "rest", lambda t, y: -GRAVITY - RATE * y, 4.0, (0.0,), lambda t: reference.settling(t, RATE, COEFFICIENT, GRAVITY)[None]),
        Case("relaxing", "slip", lambda t, y: -RATE * y, 4.0, (1.0,), lambda t: reference.relaxing(t, RATE, COEFFICIENT)[None]),
        _stream("stream, slip 0", 0.0),
        _stream("stream, slip 1", 1.0),
        _vortex("vortex, slip 0", 0.0),
        _vortex("vortex, slip 1", 1.0),
        Case(
            "Bagley–Torvik",
            "rest",
            lambda t, y: np.array([y[1], 1.0 - y[0]]),
            10.0,
            (0.0, 0.0),
            lambda t: np.array(reference.bagley_torvik(t, force=1.0)),
            memory=(1,),
            initial_slip=0.0,
            coefficient=1.0 / math.sqrt(math.pi),
        ),
        bouncing_case(IMPACTS, RESTITUTION, RATE, COEFFICIENT),
    ]


def fixed(n: int, end: float) -> dict[str, Method]:
    """Every fixed-step scheme with n steps."""
    dt, window = end / n, end / 16.0
    near = max(window - dt, dt)
    rules: dict[str, tuple[basset.Rule, str]] = {
        "semi-derivative": (basset.SemiDerivative(), "rate"),
        "Euler–Maclaurin": (basset.EulerMaclaurin(), "rate"),
        "Brush": (basset.Brush(), "rate"),
        "Hinsberg, published tail": (basset.Hinsberg(window=window), "rate"),
    }
    rules |= {f"Daitche({p})": (basset.Daitche(p), "rate") for p in (1, 2, 3)}
    rules |= {f"Daitche({p}), slips": (basset.Daitche(p), "slip") for p in (1, 2, 3)}
    rules["Windowed, fitted tail"] = (basset.Windowed(basset.Daitche(3), window, ExponentialSum.fit(near, end, TAIL)), "rate")
    rules["Exponential(3)"] = (basset.Exponential(3, TAIL), "rate")
    methods: dict[str, Method] = {name: basset.FixedStep(dt, rule, kind) for name, (rule, kind) in rules.items()}
    return methods | {"RK4, history held": basset.RungeKutta4(dt, basset.SemiDerivative())}


EXACT: dict[tuple[str, bytes], Floats] = {}  # the schemes share their grids
DECLARED = {
    "semi-derivative": 1.0,
    "Euler–Maclaurin": 0.5,
    "Brush": 0.5,
    "Hinsberg, published tail": 2.0,
    "Daitche(1)": 2.0,
    "Daitche(2)": 3.0,
    "Daitche(3)": 4.0,
    "Daitche(1), slips": 2.0,
    "Daitche(2), slips": 3.0,
    "Daitche(3), slips": 4.0,
    "Windowed, fitted tail": 4.0,
    "Exponential(3)": 4.0,
    "RK4, history held": 1.0,
}


def errors(case: Case, result: Solution, between: bool) -> dict[str, Any]:
    """Largest error over the path and the error at the end, over the largest |y|; impact times absolutely, in seconds.

    Of every memory component and position together; at the method's own nodes or, if `between`, between them too.
    """
    if result.status < 0:
        return {"error_max": None, "error_end": None, "reason": result.message}
    if case.impacts is not None:
        found = result.t_events[0]
        apart = np.abs(found[: len(case.impacts)] - case.impacts[: len(found)])
        seen = len(found)
        whole = float(apart.max()) if seen >= len(case.impacts) else None
        first = float(apart[:FIRST].max()) if seen >= FIRST else None
        heights = result.y[0] if result.sol is None else result.sol(np.linspace(0.0, case.end, 20_001))[0]
        last = float(apart[-1]) if whole is not None else None
        return {"error_max": whole, "error_end": last, "error_first": first, "impacts": seen, "lowest": float(heights.min())}
    if between and result.sol is not None:
        t = np.concatenate([case.end * np.geomspace(1e-7, 0.1, 60), np.linspace(0.1 * case.end, case.end, 351)])
        y = result.sol(t)
    else:
        t, y = result.t, result.y
    key = case.name, t.tobytes()
    if key not in EXACT:
        EXACT[key] = case.exact(t)
    exact = EXACT[key]
    scale = np.abs(exact).max()
    apart = np.abs(y - exact).max(axis=0) / scale
    return {"error_max": float(apart.max()), "error_end": float(apart[-1])}


def measured(case: Case, methods: dict[Any, Method], rounds: int, patience: float = 0.3) -> list[dict[str, Any]]:
    """Seconds, steps, evaluations and errors of each method on one problem; the first call of a long one is its time."""
    results: dict[Any, Solution] = {}
    reasons: dict[Any, str] = {}

    def play(key: Any, method: Method) -> Callable[[], None]:
        def run() -> None:
            try:
                results[key] = case.solve(method, dense=isinstance(method, basset.Collocation))
            except Exception as problem:  # a scheme that cannot run this is a row
                reasons[key] = f"{type(problem).__name__}: {problem}"[:200]
                raise

        return run

    times = measure.interleaved({key: play(key, method) for key, method in methods.items()}, rounds=rounds, seconds=0.0, patience=patience)
    records = []
    for key, method in methods.items():
        row: dict[str, Any] = {"problem": case.name, "start": case.start, "scheme": key[0], "n": key[1], "rtol": getattr(method, "rtol", None)}
        if key in results:
            found = results[key]
            row |= {"seconds": times[key], "steps": found.nsteps, "nfev": found.nfev, "status": found.status}
            row |= errors(case, found, isinstance(method, basset.Collocation))
        else:
            row |= {"seconds": None, "steps": None, "nfev": None, "status": None, "error_max": None, "error_end": None, "reason": reasons.get(key, "")}
        records.append(row)
    return records


def work_precision(full: bool) -> list[dict[str, Any]]:
    """Every scheme and collocation on every problem."""
    records = []
    for case in cases():
        bounces = case.impacts is not None
        ladder = ((512, 1024, 2048, 4096, 8192) if bounces else (32, 64, 128, 256, 512, 1024)) if full else ((512, 1024) if bounces else (64, 128, 256))
        methods: dict[Any, Method] = {}
        for n in ladder:
            methods |= {(name, n): method for name, method in fixed(n, case.end).items()}
        methods |= {("Collocation", k): basset.Collocation(rtol=rtol) for k, rtol in enumerate(RTOLS)}
        rounds, patience = (5, 0.4 if bounces else 0.1) if full else (0, 0.0)
        records += measured(case, methods, rounds, patience)
    return records


def race(records: list[dict[str, Any]], full: bool) -> dict[str, Any]:
    """The bouncing sphere: collocation that reaches TARGET, and the fixed steps with more and more of them until a second."""
    case = bouncing_case(IMPACTS, RESTITUTION, RATE, COEFFICIENT)
    own = next(r for r in records if r["problem"] == "bouncing" and r["scheme"] == "Collocation" and r["error_max"] <= TARGET)
    method = basset.Collocation(rtol=own["rtol"])
    contenders: dict[Any, Method] = {("Collocation", 0): method}
    for n in (1024, 2048, 4096, 8192, 16384, 32768) if full else (1024, 2048, 4096):
        rules = fixed(n, case.end)
        contenders |= {(name, n): rules[name] for name in ("Daitche(1), slips", "Daitche(3), slips", "Exponential(3)")}
    return {"target": TARGET, "rtol": own["rtol"], "records": measured(case, contenders, 7 if full else 1, 0.2)}


def to_rest() -> dict[str, Any]:
    """A sphere of restitution 0.5 until it rests."""
    case = replace(bouncing_case(3, 0.5, RATE, COEFFICIENT), end=6.0)
    found = case.solve(basset.Collocation(rtol=1e-9))
    return {"restitution": 0.5, "impacts": len(found.t_events[0]), "t": float(found.t[-1]), "status": found.status, "message": found.message}


def by_impacts(full: bool) -> list[dict[str, Any]]:
    """Cost against the number of impacts: a sphere of higher restitution, so that many are far from rest."""
    method, records = basset.Collocation(rtol=1e-6), []
    livelier = {impacts: bouncing_case(impacts, 0.95, 0.05, 0.05) for impacts in ((1, 2, 5, 10, 20, 30, 40) if full else (2, 5, 10, 20))}
    times = measure.interleaved({n: lambda case=case: case.solve(method) for n, case in livelier.items()}, rounds=7 if full else 1, seconds=0.0)
    for impacts, case in livelier.items():
        records += measured(case, {("Collocation", impacts): method}, 0, 0.0)
        records[-1]["seconds"] = times[impacts]
    return records


def slip_costs(full: bool) -> list[dict[str, Any]]:
    """The same stream with and without initial slip, interleaved."""
    pair = {slip: _stream(f"stream, slip {slip}", float(slip)) for slip in (0, 1)}
    records = []
    for rtol in RTOLS if full else RTOLS[::3]:
        method = basset.Collocation(rtol=rtol)
        found = {slip: case.solve(method) for slip, case in pair.items()}
        times = measure.interleaved({slip: lambda c=case, m=method: c.solve(m) for slip, case in pair.items()}, rounds=7 if full else 2, seconds=0.0)
        records += [{"rtol": rtol, "slip": slip, "seconds": times[slip], "nfev": found[slip].nfev, "steps": found[slip].nsteps} for slip in pair]
    return records


def without_history(full: bool) -> list[dict[str, Any]]:
    """Without history (c = 0): quadratic drag in a stream; error against a fine solve_ivp, time against its solvers at the same rtol."""

    def fun(t: float, y: Floats) -> Any:
        return np.array([math.cos(t) - y[0] * abs(y[0]) - 0.5 * y[0]])

    span, start = (0.0, 10.0), [1.0]
    truth = scipy.integrate.solve_ivp(fun, span, start, method="DOP853", rtol=1e-13, atol=1e-15, max_step=0.02).y[0, -1]
    records = []
    for rtol in (1e-4, 1e-6, 1e-8, 1e-10):
        ours = basset.Collocation(rtol=rtol)
        calls: dict[str, Callable[[], Any]] = {"Collocation": lambda m=ours: basset.solve(fun, span, start, coefficient=0.0, method=m)}
        for name in ("RK45", "DOP853", "Radau"):
            calls[f"solve_ivp {name}"] = lambda name=name, rtol=rtol: scipy.integrate.solve_ivp(fun, span, start, method=name, rtol=rtol, atol=1e-3 * rtol)
        found = {name: call() for name, call in calls.items()}
        times = measure.interleaved(calls, rounds=5 if full else 1, seconds=0.0)
        for name, result in found.items():
            records.append({"rtol": rtol, "solver": name, "seconds": times[name], "nfev": result.nfev, "error": float(abs(result.y[0, -1] - truth))})
    return records


# parameters and initial state of marge3d's own convergence script and tests
MARGE3D = {"particle_density": 500, "fluid_density": 972, "particle_radius": 0.00018**0.5, "kinematic_viscosity": 2e-4, "time_scale": 0.1, "char_vel": 0.4}
MARGE3D_END = 1.0


def marge3d(full: bool) -> dict[str, Any]:
    """marge3d 's vortex problem: light particle at (1, 0, 0) in u = (−y, x, 0) with the fluid's velocity, gravity along z, to t = 1.

    In its numbers R = 3/(1 + 2ρp/ρf), S = a²/(3νT), g = 9.8 T/U: our β = R, λ = R/S, c = R√(3/(πS)); its third component settles
    with (1 − R)g. Errors are of the position, the Euclidean norm, against the exact solution: at the end, and the largest over the path.
    """
    if importlib.util.find_spec("marge3d") is None:
        return {"status": "skipped", "reason": "marge3d is not installed"}
    from marge3d.fields import VelocityField3D
    from marge3d.numeric import NumericalSolver
    from marge3d.params import DaitcheParameters

    numbers = DaitcheParameters(**MARGE3D)
    r, s, g = numbers.R, numbers.S, numbers.g
    rate, coefficient, weight = r / s, r * math.sqrt(3.0 / (math.pi * s)), (1.0 - r) * g

    def exact(t: Floats) -> Floats:
        z = reference.solid_body_vortex(t, rate, coefficient, r, 1.0, 1.0, 0.0).position
        return np.array([z.real, z.imag, reference.settling_height(t, rate, coefficient, weight)])

    @compiled()  # as marge3d's own loops are
    def fun(t: float, y: Floats) -> Any:
        x1, x2, _, w1, w2, w3 = y
        return np.array([w1 - x2, w2 + x1, w3, -rate * w1 + w2 + (1.0 - r) * x1, -rate * w2 - w1 + (1.0 - r) * x2, -rate * w3 - weight])

    def row(name: str, size: float, seconds: float, building: float, t: Floats, path: Floats) -> dict[str, Any]:
        apart = np.linalg.norm(path - exact(t), axis=0)
        return {"solver": name, "size": size, "seconds": seconds, "building": building, "error_end": float(apart[-1]), "error_max": float(apart.max())}

    records = []
    position, slip = np.array([1, 0, 0]), np.zeros(3)
    for order in (2, 3):
        done = start = 0.0
        for n in (100, 200, 400, 800, 1600):
            if done - start > (2.0 if order == 2 else 20.0):
                break
            t = np.linspace(0.0, MARGE3D_END, n + 1)
            start = time.perf_counter()
            solver = NumericalSolver(position, slip, VelocityField3D(1), n + 2, order, **MARGE3D)
            built = time.perf_counter()
            x, y, z, _ = solver.solve(t)
            done = time.perf_counter()
            records.append(row(f"marge3d, order {order}", n, done - start, built - start, t, np.array([x, y, z])))
    best = min(r["error_max"] for r in records)
    start_state = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    calls = {
        rtol: lambda rtol=rtol: basset.solve(
            fun, (0.0, MARGE3D_END), start_state, memory=[3, 4, 5], coefficient=coefficient, method=basset.Collocation(rtol=rtol), dense_output=True
        )
        for rtol in RTOLS
    }
    next(iter(calls.values()))()  # compiles
    times = measure.interleaved(calls, rounds=7, seconds=0.05)
    for rtol, call in calls.items():
        found = call()
        t = np.linspace(0.0, MARGE3D_END, 801)
        records.append(row("Collocation", rtol, times[rtol], 0.0, t, found.sol(t)[:3]))
    return {"status": "measured", "reason": "", "version": version("marge3d"), "R": r, "S": s, "g": g, "end": MARGE3D_END, "best": best, "records": records}


def warm_up() -> None:
    """Every compiled piece once, so that compiling stays apart."""
    case = cases()[3]
    for method in fixed(32, case.end).values():
        case.solve(method)
    case.solve(basset.Collocation())


def run(full: bool) -> dict[str, Any]:
    """Error against time for every scheme on every problem; the price of impacts, of slip, of no history; marge3d."""
    warm_up()
    records = work_precision(full)
    return {
        "rate": RATE,
        "coefficient": COEFFICIENT,
        "restitution": RESTITUTION,
        "impacts": IMPACTS,
        "first": FIRST,
        "tail": TAIL,
        "declared": DECLARED,
        "records": records,
        "race": race(records, full),
        "rest": to_rest(),
        "by_impacts": by_impacts(full),
        "slip_costs": slip_costs(full),
        "without_history": without_history(full),
        "marge3d": marge3d(full) if full else {"status": "skipped", "reason": "only with --full"},
    }
