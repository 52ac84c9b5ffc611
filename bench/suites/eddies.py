"""Does the turbulent stream have its statistics, are tracers mixed in it, do flights converge, and what does a jump cost?"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

import saltation
from basset import measure
from basset._compile import placed
from basset.solvers import stepper
from saltation.effects import turbulence
from saltation.effects.base import Setting
from saltation.effects.turbulence import BEGINS, OWN, SLOT, SLOTS, Options
from saltation.flight import layout
from saltation.flight.setup import Engine, Grain, empty_record
from saltation.grain import numbers_of
from saltation.scene import scene_of
from saltation.scene.conditions import settling_velocity
from saltation.study.thesis import case

EFFECT = {"effects": [*case("sand")["effects"], "turbulence"]}
DEPTH = 100.0  # d
EDGES = (0.0, 0.005, 0.01, 0.02, 0.03, *np.linspace(0.05, 1.0, 20).tolist())  # of z/h
TIMES = 50.0  # of T_L at half the depth
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
EXACT = 1e-9
FINE = {"diameter": 1e-4}  # m
RATIOS = (4.0, 2.0, 1.0, 0.5, 0.25)  # w_s/u*
LONGEST = 20.0


def sand(*, turbulent: bool = True, **tables: Any) -> saltation.Scene:
    """Sand with the thesis's laws in a channel 100 d deep."""
    content = case("sand")
    content |= EFFECT if turbulent else {}
    content["channel"]["depth"] = DEPTH * content["grain"]["diameter"]
    return scene_of({name: {**table, **tables[name]} if name in tables and isinstance(table, dict) else table for name, table in content.items()})


def mixed(friction: float, tracers: int) -> dict[str, Any]:
    """χ² of tracers that began uniform, Re_τ being `friction`, after so many time scales of half the depth; counts over those expected."""
    depth = 10.0
    numbers = numbers_of(1000.0, 1e-6, 2650.0, 1e-3, shear_velocity=1e-3 * friction / depth)
    setting = Setting(numbers, None, depth=depth, roughness=1e-2, seed=1)
    options = Options()
    built = turbulence.build(options, setting)
    assert built is not None
    until = TIMES * float(turbulence.profiles_of(options, setting, np.array([0.5 * depth])).time[0])
    states = np.zeros((tracers, 4))
    states[:, 0], states[:, 1] = depth * np.random.default_rng(1).random(tracers), BEGINS
    turbulence.tracers(placed(built._replace(lag=0.0)), states, until, 0.1, np.zeros((6, OWN + SLOTS * SLOT)))
    found, expected = np.histogram(states[:, 0] / depth, EDGES)[0], tracers * np.diff(EDGES)
    square = float(((found - expected) ** 2 / expected).sum())
    return {"friction": friction, "tracers": tracers, "until": until, "chi_square": square, "freedom": len(expected) - 1, "counts": found / expected}


def first_jumps(rtol: float, grains: int, turbulent: bool = True) -> tuple[np.ndarray[Any, Any], float]:
    """Rise, length and duration of the first jump of each grain, and the mean number of evaluations of the rates."""
    engine = Engine(sand(turbulent=turbulent, solver={"rtol": rtol}))
    record, rows, calls = empty_record(4096, engine.tables.count, engine.states), [], 0
    for i in range(grains):
        grain, table = Grain(engine, i), np.zeros((1, len(layout.COLUMNS)))
        while grain.flight[0].done == 0:
            code, _ = grain.fly(record, False, table)
            if code != stepper.FULL:
                break
        rows.append(table[0, [layout.COLUMNS.index(name) for name in ("rise", "length", "duration")]])
        calls += int(grain.state.control[0].calls)
    return np.array(rows), calls / grains


def convergence(grains: int) -> list[dict[str, Any]]:
    """Errors of the first jump by rtol, over the larger of it and the mean jump: median, root mean square, largest."""
    exact, _ = first_jumps(EXACT, grains)
    found = []
    for rtol in TOLERANCES:
        jumps, calls = first_jumps(rtol, grains)
        error = np.abs(jumps - exact) / np.maximum(np.abs(exact), np.abs(exact).mean(axis=0))
        found.append({"rtol": rtol, "calls": calls, "median": float(np.median(error)), "rms": float(np.sqrt((error**2).mean())), "largest": float(error.max())})
    return found


def workers() -> dict[str, Any]:
    """Whether blocks over workers have the bits of one piece."""
    content = case("sand") | EFFECT | {"cloud": {"number": 40, "concentration": 0.001, "interval": 1.0}, "run": {"duration": 0.5, "seed": 5}}
    content["channel"]["depth"] = DEPTH * content["grain"]["diameter"]
    made = scene_of(content)
    whole = saltation.run(made).jumps
    with ThreadPoolExecutor(2) as executor:
        return {"jumps": len(whole), "same": bool(saltation.run(made, executor=executor).jumps.equals(whole))}


def price(rounds: int) -> dict[str, float]:
    """CPU seconds per jump without turbulence and with it, interleaved."""
    taken: dict[str, int] = {}

    def fly(name: str, made: saltation.Scene) -> None:
        taken[name] = len(saltation.run(made).jumps)

    # seeds whose grain is not left lying
    run = {"jumps": 400, "discard": 0, "trajectory": False}
    made = {name: sand(turbulent=name == "turbulent", run=run) for name in ("plain", "turbulent")}
    seconds = measure.interleaved({name: lambda name=name: fly(name, made[name]) for name in made}, rounds=rounds, patience=1e3, clock=time.process_time)
    return {name: value / taken[name] for name, value in seconds.items()}


def suspension(grains: int) -> list[dict[str, float]]:
    """How long fine grains stay aloft from a quarter of the depth, over the time in which they sink from there in still water, without turbulence and with it.

    By w_s/u*; a flight is followed for `LONGEST` of those times.
    """
    content = case("sand") | {"grain": FINE, "run": {"jumps": 1, "trajectory": False}}
    speed = settling_velocity(scene_of(content))
    assert speed is not None
    height, found = 0.25 * DEPTH * FINE["diameter"], []
    for ratio in RATIOS:
        shear = speed / ratio
        channel = {"shear_velocity": shear, "depth": DEPTH * FINE["diameter"]}
        start = {"height": height, "velocity": [10.0 * shear, 0.0, 0.0]}
        row = {"ratio": ratio}
        for name, effects in (("plain", content["effects"]), ("turbulent", EFFECT["effects"])):
            sinks = height / speed / (FINE["diameter"] / shear)  # d/u*
            run = {**content["run"], "longest_flight": LONGEST * sinks}
            engine, times = Engine(scene_of(content | {"effects": effects, "channel": channel, "start": start, "run": run})), []
            record = empty_record(4096, engine.tables.count, engine.states)
            for i in range(grains if name == "turbulent" else 1):
                grain, table = Grain(engine, i), np.zeros((1, len(layout.COLUMNS)))
                code = stepper.FULL
                while grain.flight[0].done == 0 and code == stepper.FULL:
                    code, _ = grain.fly(record, False, table)
                times.append(float(grain.state.control[0].time) / sinks)
            row[name] = float(np.mean(times))
        found.append(row)
    return found


def run(full: bool) -> dict[str, Any]:
    """Tracers, first jumps by tolerance, bits over workers, price and suspension."""
    tracers = 100_000 if full else 3000
    return {
        "mixed": [mixed(friction, tracers) for friction in (186.0, 1000.0)],
        "convergence": convergence(200 if full else 20),
        "workers": workers(),
        "price": price(15 if full else 3),
        "suspension": suspension(200 if full else 20),
    }
