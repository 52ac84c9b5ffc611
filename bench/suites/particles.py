"""Does `maxey_riley` keep its tolerance in published flows, and what do a particle, alone or among a hundred thousand, and a track cost?"""

from __future__ import annotations

import hashlib
import importlib.util
import math
import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

import basset
from basset import measure, reference
from basset._compile import compiler
from basset.kernels import Floats, gauss_legendre
from basset.particles import maxey_riley

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
SPHERE = {"diameter": 0.02, "density_ratio": 2.0, "viscosity": 1e-3}  # in a vortex of 1 m and 1 rad/s
# Urizarna-Carasa, Schlegel & Ruprecht (2024), arXiv:2403.13515: R = (1 + 2ρp/ρf)/3 = 7/9 and S = d²/(12ν) = 1/10 in a stream (1, sin t), to t = 5
STREAM = {"diameter": 0.02, "density_ratio": 2.0 / 3.0, "viscosity": 0.02**2 / 1.2}
STREAM_END = 5.0
# what their own code (Python) gave when it was run once, on another machine: times are orders of magnitude, and there are none with slip 0.1
THEIRS = (
    {"solver": "Daitche, third order", "slip": False, "n": 1001, "error": 5.4e-8, "seconds": 7.5},
    {"solver": "FD4 + IMEX4", "slip": False, "n": 1001, "error": 1.2e-9, "seconds": 10.6},
    {"solver": "Daitche, third order", "slip": True, "n": 501, "error": 2.2e-5, "seconds": None},
    {"solver": "FD4 + IMEX4", "slip": True, "n": 501, "error": 1.7e-3, "seconds": None},
)
GRAIN = {"diameter": 50e-6, "density_ratio": 2.65, "viscosity": 1e-6}
SLIP = (0.1, -0.2)  # m/s, where there is one at the start
# del-Castillo-Negrete & Morrison (1993), Phys. Fluids A 5, 948: waves on the jet u = sech² y, lengths and speeds over the jet's
WAVES = ((0.0075, 0.5557, 0.1446), (0.15, 1.1113, 0.205), (0.3, 1.667, 0.461))  # amplitude, wave number, speed
JET_END = 10.0
# parameters and initial state of marge3d's own convergence script and tests
MARGE3D = {"particle_density": 500, "fluid_density": 972, "particle_radius": 0.00018**0.5, "kinematic_viscosity": 2e-4, "time_scale": 0.1, "char_vel": 0.4}


def still(t: float, x: Any) -> Any:
    """No flow."""
    return 0.0, 0.0, 0.0


def vortex(t: float, x: Any) -> Any:
    """Solid rotation."""
    return -x[1], x[0]


def vortex_in_space(t: float, x: Any) -> Any:
    """The same, around the vertical."""
    return -x[1], x[0], 0.0


def stream(t: float, x: Any) -> Any:
    """A stream that oscillates across."""
    return 1.0, math.sin(t)


def jet(t: float, x: Any) -> Any:
    """Bickley's jet with three waves."""
    level = math.tanh(x[1])
    hill = 1.0 - level * level
    u, v = hill, 0.0
    for amplitude, number, speed in WAVES:
        phase = number * (x[0] - speed * t)
        u += 2.0 * amplitude * hill * level * math.cos(phase)
        v -= amplitude * number * hill * math.sin(phase)
    return u, v


def jet_gradient(t: float, x: Any) -> Any:
    """Its velocity's gradient."""
    level = math.tanh(x[1])
    hill = 1.0 - level * level
    found = np.zeros((2, 2))
    found[0, 1] = -2.0 * hill * level
    for amplitude, number, speed in WAVES:
        phase = number * (x[0] - speed * t)
        found[0, 0] -= 2.0 * amplitude * number * hill * level * math.sin(phase)
        found[0, 1] += 2.0 * amplitude * hill * (1.0 - 3.0 * level * level) * math.cos(phase)
        found[1, 0] -= amplitude * number * number * hill * math.cos(phase)
    found[1, 1] = -found[0, 0]
    return found


def jet_acceleration(t: float, x: Any) -> Any:
    """Du/Dt of the jet."""
    level = math.tanh(x[1])
    hill = 1.0 - level * level
    u, v, ux, uy, vx, ut, vt = hill, 0.0, 0.0, -2.0 * hill * level, 0.0, 0.0, 0.0
    for amplitude, number, speed in WAVES:
        phase = number * (x[0] - speed * t)
        wave, slope = amplitude * hill * math.cos(phase), amplitude * number * hill * math.sin(phase)
        u, v = u + 2.0 * level * wave, v - slope
        ux, uy, vx = ux - 2.0 * level * slope, uy + 2.0 * (1.0 - 3.0 * level * level) * wave, vx - number * number * wave
        ut, vt = ut + 2.0 * level * speed * slope, vt + number * number * speed * wave
    return ut + u * ux + v * uy, vt + u * vx - v * ux


@cache
def njit(function: Any) -> Any:
    """A function, compiled."""
    return compiler().njit(function)


def numbers(diameter: float, density_ratio: float, viscosity: float) -> tuple[float, float, float]:
    """λ, c and β of a sphere whose added mass is one half."""
    inertia = density_ratio + 0.5
    return 18.0 * viscosity / diameter**2 / inertia, 9.0 / diameter * math.sqrt(viscosity / math.pi) / inertia, 1.5 / inertia


def settling(t: Floats, slip: tuple[float, ...] | None) -> Floats:
    """Exact positions of the grain that settles."""
    rate, coefficient, _ = numbers(**GRAIN)
    height = reference.settling_height(t, rate, coefficient, 1.65 * 9.81 / 3.15)
    return np.stack([0.0 * t, 0.0 * t, height], axis=-1)


def spiral(t: Floats, slip: tuple[float, ...] | None) -> Floats:
    """Exact positions in the vortex."""
    z = reference.solid_body_vortex(t, *numbers(**SPHERE), position=1.0, initial_slip=complex(*(slip or (0.0, 0.0)))).position
    return np.stack([z.real, z.imag], axis=-1)


def swing(t: Floats, slip: tuple[float, ...] | None) -> Floats:
    """Exact positions in the stream: the closed form of the slip, integrated over √t, in which it is smooth."""
    rate, coefficient, beta = numbers(**STREAM)
    along, across = slip or (0.0, 0.0)
    x, weights = gauss_legendre(16)
    roots = np.sqrt(t)
    s = roots[:-1, None] + np.diff(roots)[:, None] * x
    slips = np.stack([reference.relaxing(s**2, rate, coefficient, along), reference.oscillating_stream(s**2, rate, coefficient, beta - 1.0, 1.0, across)])
    gained = (slips * 2.0 * s * weights).sum(axis=2) * np.diff(roots)
    return np.stack([t, 1.0 - np.cos(t)], axis=-1) + np.concatenate([np.zeros((1, 2)), np.cumsum(gained, axis=1).T])


def exact_cases() -> list[dict[str, Any]]:
    """Flows with closed forms: what to call, and what it should give."""
    cases: list[dict[str, Any]] = [
        {"name": "settling from rest", "flow": still, "end": 0.1, "place": [0.0] * 3, "exact": settling, "sphere": GRAIN, "slip": None}
    ]
    for slip in (None, SLIP):
        cases += [
            {"name": "vortex", "flow": vortex, "end": 2.0 * math.pi, "place": [1.0, 0.0], "exact": spiral, "sphere": SPHERE, "slip": slip},
            {"name": "stream", "flow": stream, "end": STREAM_END, "place": [0.0, 0.0], "exact": swing, "sphere": STREAM, "slip": slip},
        ]
    return cases


def against_exact(full: bool) -> list[dict[str, Any]]:
    """Largest errors of the position, over the largest there is, and the time of a call."""
    records = []
    for case in exact_cases():
        t = np.linspace(0.0, case["end"], 41)
        truth = case["exact"](t, case["slip"])

        def call(rtol: float, case: dict[str, Any] = case, t: Floats = t) -> Any:
            method = basset.Collocation(rtol=rtol)
            return maxey_riley(njit(case["flow"]), (0.0, case["end"]), [case["place"]], initial_slip=case["slip"], t_eval=t, method=method, **case["sphere"])

        rtols = RTOLS if full else RTOLS[::3]
        call(rtols[0])  # compiles
        calls = {rtol: lambda rtol=rtol, call=call: call(rtol) for rtol in rtols}
        times = measure.interleaved(calls, rounds=9 if full else 3, seconds=0.0, clock=time.process_time)
        for rtol in rtols:
            error = np.abs(call(rtol).position[0].values - truth).max() / np.abs(truth).max()
            records.append({"flow": case["name"], "slip": case["slip"] is not None, "rtol": rtol, "error": float(error), "seconds": times[rtol]})
    return records


def jets(full: bool) -> list[dict[str, Any]]:
    """Particles in the jet, with and without slip at the start, differences for derivatives; against 1e-12 and exact ones."""
    places = np.stack([np.linspace(0.0, 10.0, 8), np.linspace(-1.5, 1.5, 8)], axis=1)
    t, records = np.linspace(0.0, JET_END, 21), []
    for slip in (None, SLIP):
        options: dict[str, Any] = {"initial_slip": slip, "t_eval": t, **SPHERE}
        given = {"gradient": njit(jet_gradient), "material_derivative": njit(jet_acceleration), "method": basset.Collocation(rtol=1e-12)}
        truth = maxey_riley(njit(jet), (0.0, JET_END), places, **given, **options).position.values

        def call(rtol: float, options: dict[str, Any] = options) -> Any:
            return maxey_riley(njit(jet), (0.0, JET_END), places, method=basset.Collocation(rtol=rtol), **options)

        calls = {rtol: lambda rtol=rtol, call=call: call(rtol) for rtol in (RTOLS if full else RTOLS[::3])}
        times = measure.interleaved(calls, rounds=3 if full else 1, seconds=0.0, clock=time.process_time)
        for rtol, seconds in times.items():
            error = np.abs(call(rtol).position.values - truth).max()
            records.append({"slip": slip is not None, "rtol": rtol, "error": float(error), "seconds": seconds / len(places)})
    return records


def digest(ds: Any) -> str:
    """Of the bits of positions and slips."""
    return hashlib.sha256(ds.position.values.tobytes() + ds.slip.values.tobytes()).hexdigest()


def swarm(full: bool) -> dict[str, Any]:
    """Many particles in the vortex, one turn: the largest error, over a radius of one; times with one and two threads, in turns; whether the bits agree."""
    count, end = (100_000 if full else 2_000), 2.0 * math.pi
    rng = np.random.default_rng(1)
    radius, angle = np.sqrt(rng.uniform(0.0, 1.0, count)), rng.uniform(0.0, end, count)
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    kept: dict[int, Any] = {}

    def fly(some: Floats, workers: int, **options: Any) -> Any:
        method = basset.Collocation(rtol=1e-4)
        return maxey_riley(njit(vortex), (0.0, end), some, t_eval=[end], workers=workers, method=method, **options, **SPHERE)

    def play(workers: int) -> Callable[[], None]:
        def run() -> None:
            kept[workers] = fly(places, workers)

        return run

    fly(places[:50], 1)  # compiles
    times = measure.interleaved({workers: play(workers) for workers in (1, 2)}, rounds=3 if full else 1, seconds=0.0, patience=600.0)
    z = places @ np.array([1.0, 1.0j])
    error = np.abs(kept[1].position.values[:, 0] @ np.array([1.0, 1.0j]) - z * complex(*spiral(np.array(end), None))).max()
    some = slice(count // 3, count // 3 + 500)
    part = fly(places[some], 2)
    few = places[: min(count, 5000)]
    variants: dict[str, dict[str, Any]] = {"all": {"lift": "saffman", "drag": "schiller_naumann"}, "stokes": {}, "no history": {"history": False}}
    for options in variants.values():
        fly(few[:50], 1, **options)  # compiles
    by_terms = measure.interleaved({name: lambda o=o: fly(few, 1, **o) for name, o in variants.items()}, rounds=3, seconds=0.0, patience=60.0)
    return {
        "particles": count,
        "end": end,
        "rtol": 1e-4,
        "error": float(error),
        "seconds": {str(workers): times[workers] for workers in times},
        "per_particle_and_second": times[1] / count / end,
        "gain": times[1] / times[2],
        "same_bits_over_threads": digest(kept[1]) == digest(kept[2]),
        "same_bits_in_parts": digest(part) == digest(kept[1].isel(particle=some)),
        "terms": {name: seconds / len(few) for name, seconds in by_terms.items()},
    }


def marge3d(full: bool) -> dict[str, Any]:
    """The vortex problem of marge3d at its authors' numbers, to t = 1, beside marge3d itself: largest distance from the exact path.

    With the length and time of its own units R = 3/(1 + 2ρp/ρf) is our β and S = d²/(12ν): density ratio and viscosity follow.
    """
    if importlib.util.find_spec("marge3d") is None:
        return {"status": "skipped", "reason": "marge3d is not installed"}
    from marge3d.fields import VelocityField3D
    from marge3d.numeric import NumericalSolver
    from marge3d.params import DaitcheParameters

    given = DaitcheParameters(**MARGE3D)
    r, s, g = given.R, given.S, given.g
    rate, coefficient, weight = r / s, r * math.sqrt(3.0 / (math.pi * s)), (1.0 - r) * g
    size = 2.0 * MARGE3D["particle_radius"] / (MARGE3D["char_vel"] * MARGE3D["time_scale"])
    sphere = {"diameter": size, "density_ratio": 500.0 / 972.0, "viscosity": size**2 / (12.0 * s), "gravity": (0.0, 0.0, -g)}

    def error(t: Floats, path: Floats) -> float:
        z = reference.solid_body_vortex(t, rate, coefficient, r, 1.0, 1.0, 0.0).position
        truth = np.array([z.real, z.imag, reference.settling_height(t, rate, coefficient, weight)])
        return float(np.linalg.norm(path - truth, axis=0).max())

    records = []
    for order in (2, 3):
        for n in (100, 200, 400, 800, 1600) if full else (100, 200, 400):
            t, start = np.linspace(0.0, 1.0, n + 1), time.process_time()
            x, y, z, _ = NumericalSolver(np.array([1, 0, 0]), np.zeros(3), VelocityField3D(1), n + 2, order, **MARGE3D).solve(t)
            records.append({"solver": f"marge3d, order {order}", "size": n, "seconds": time.process_time() - start, "error": error(t, np.array([x, y, z]))})
    best = min(records, key=lambda record: float(record["error"]))
    flow, t = njit(vortex_in_space), np.linspace(0.0, 1.0, 801)
    for rtol in RTOLS:
        options: dict[str, Any] = {"method": basset.Collocation(rtol=rtol), **sphere}
        many = np.tile([1.0, 0.0, 0.0], (200, 1))
        calls = {
            "one": lambda o=options: maxey_riley(flow, (0.0, 1.0), [1.0, 0.0, 0.0], **o),
            "many": lambda o=options, m=many: maxey_riley(flow, (0.0, 1.0), m, t_eval=[1.0], **o),
        }
        if rtol == RTOLS[0]:
            measure.interleaved(calls, rounds=0)  # compiles
        times = measure.interleaved(calls, rounds=9, seconds=0.0, clock=time.process_time)
        path = maxey_riley(flow, (0.0, 1.0), [1.0, 0.0, 0.0], t_eval=t, **options).position[0].values.T
        found = {"solver": "maxey_riley", "size": rtol, "seconds": times["one"], "each_of_many": times["many"] / len(many), "error": error(t, path)}
        records.append(found)
    ours = [record for record in records if record["solver"] == "maxey_riley" and record["error"] <= best["error"]]
    ratios = {"ratio_one": best["seconds"] / min(r["seconds"] for r in ours), "ratio_many": best["seconds"] / min(r["each_of_many"] for r in ours)}
    return {"status": "measured", "version": version("marge3d"), "best": best, "records": records} | ratios


def tracks(full: bool) -> list[dict[str, Any]]:
    """The history of cos t over twenty seconds from samples at times moved by up to 0.4 of a step, by sums to 1e-6 and 1e-10.

    The largest error over the second half, over the largest |H| there, and the time of a call.
    """
    records = []
    basset.cumulate(np.ones(9), t=np.arange(9.0), rule=basset.Exponential(3, 1e-6))  # compiles
    for n in (10**3, 10**4, 10**5, 10**6) if full else (10**3, 10**4):
        moved = np.random.default_rng(n).uniform(-0.4, 0.4, n - 1)
        t = (np.arange(n + 1) + np.concatenate([[0.0], moved, [0.0]])) * (20.0 / n)
        g, exact = np.cos(t), reference.cosine(t)
        rules = {rtol: basset.Exponential(3, rtol) for rtol in (1e-6, 1e-10)}
        times = measure.interleaved({rtol: lambda rule=rule, t=t, g=g: basset.cumulate(g, t=t, rule=rule) for rtol, rule in rules.items()}, rounds=5)
        for rtol, rule in rules.items():
            error = np.abs(basset.cumulate(g, t=t, rule=rule) - exact)[n // 2 :].max() / np.abs(exact[n // 2 :]).max()
            records.append({"n": n, "rtol": rtol, "error": float(error), "seconds": times[rtol]})
    return records


def run(full: bool) -> dict[str, Any]:
    """Errors against closed forms and against the solution to 1e-12; times."""
    found = {"exact": against_exact(full), "jet": jets(full), "swarm": swarm(full), "tracks": tracks(full), "marge3d": marge3d(full)}
    return found | {"stream": {"R": 7.0 / 9.0, "S": 0.1, "end": STREAM_END, "theirs": THEIRS}}
