"""What does a step cost, part by part; what do compiled functions, many systems at once and threads save; and what does compiling cost?"""

from __future__ import annotations

import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any
from unittest import mock

import numpy as np

import basset
import saltation
from basset import measure
from basset._compile import compiler, shared
from bench.grains import base, changed
from bench.suites.flights import RTOL, engine_of, fly
from saltation.flight import equations
from saltation.flight.setup import Engine
from saltation.scene import scene_of
from saltation.study import thesis

ROOT = Path(__file__).resolve().parents[2]
JUMPS = 100  # of the scene that is taken apart: short enough that some round is not disturbed
Case = tuple[Callable[[], Any], Callable[[], Any]]  # what is dear and what is cheap; both have been seen to give the same


def fresh(script: str, folder: str | None = None) -> dict[str, Any]:
    """What a script prints as JSON in a process of its own, its compiled code in that folder, empty at first or shared; RuntimeError with its last line."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": folder} if folder is not None else {})
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no message"])[-1][:300])
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


# A step taken apart: functions read the processor's clock when they are entered and left, and tell their part what passed in themselves

PARTS: dict[str, tuple[str, ...]] = {
    "rates": ("rates_of",),
    "stages": ("iterate", "differentiate_diagonally", "remember_rates"),
    "memory": ("memory_before", "accept", "truncate_step", "truncate_memory", "make_odd"),
    "error": ("decay_error", "defect_error"),
    "record": ("keep", "fit_polynomial"),
    "contact": ("flown", "looked", "landed"),
    "rest": ("advance",),
}
CLOCKED = [name for names in PARTS.values() for name in names]
SETTINGS: dict[str, tuple[str, ...]] = {"sand": (), "without history": ("history",)}


def clocked_function(name: str) -> FunctionType:
    """The function of that name that the steps of a flight are compiled from; LookupError if there is none."""
    for package in ("saltation.flight", "basset.solvers.stepper", "basset.solvers"):
        for key, module in sorted(sys.modules.items()):
            found = getattr(module, name, None) if key.startswith(package) else None
            if isinstance(found, FunctionType) and found.__module__ == key:
                return found
    raise LookupError(f"no function of the stepper or of the flight is called {name!r}: mend PARTS in {Path(__file__).name}")


def clock_in(account: Any) -> None:
    """Have the functions of CLOCKED write into `account` (function + 1, 2): ticks that passed in itself, calls. Before anything is compiled.

    The last row holds the ticks of those that were called meanwhile. A function is given other code, which calls what it was.
    """
    numba = compiler()
    from llvmlite import ir

    word, whole = ir.IntType(64), numba.types.int64

    @numba.extending.intrinsic
    def ticks(typingctx):
        def generate(context, builder, signature, arguments):
            return builder.call(builder.module.declare_intrinsic("llvm.readcyclecounter", (), ir.FunctionType(word, ())), ())

        return whole(), generate

    @numba.extending.intrinsic
    def cell(typingctx, address):
        def generate(context, builder, signature, arguments):
            return builder.load(builder.inttoptr(arguments[0], word.as_pointer()))

        return whole(whole), generate

    @numba.extending.intrinsic
    def put(typingctx, address, value):
        def generate(context, builder, signature, arguments):
            builder.store(arguments[1], builder.inttoptr(arguments[0], word.as_pointer()))
            return context.get_dummy_value()

        return numba.types.void(whole, whole), generate

    first: int = account.ctypes.data
    below = first + 16 * len(CLOCKED)

    def enter():
        outside = cell(below)
        put(below, 0)
        return outside, ticks()

    def leave(begun, place):
        outside, begin = begun
        passed = ticks() - begin
        own = first + 16 * place
        put(own, cell(own) + passed - cell(below))
        put(own + 8, cell(own + 8) + 1)
        put(below, outside + passed)

    enter, leave = shared(enter), shared(leave)
    for place, name in enumerate(CLOCKED):
        function = clocked_function(name)
        inner = FunctionType(function.__code__, function.__globals__, f"{name}_itself", function.__defaults__)
        names = ", ".join(function.__code__.co_varnames[: function.__code__.co_argcount])
        code = f"def {name}({names}):\n begun = clock_enter()\n found = {name}_itself({names})\n clock_leave(begun, {place})\n return found\n"
        function.__globals__.update({"clock_enter": enter, "clock_leave": leave, f"{name}_itself": shared(inner)})
        made: dict[str, Any] = {}
        exec(code, function.__globals__, made)  # a closure over *arguments would not be compiled
        function.__code__ = made[name].__code__


def engine_apart(without: tuple[str, ...]) -> Engine:
    """The sand scene without these effects, made ready to fly."""
    return engine_of(changed(base("sand", JUMPS, 0), without=without))


def clocked() -> dict[str, Any]:
    """By scene: seconds of a run with clocks in it, ticks in and calls of each of CLOCKED. In a process in which nothing was compiled yet."""
    account = np.zeros((len(CLOCKED) + 1, 2), dtype=np.int64)
    clock_in(account)
    found = {}
    for name, without in SETTINGS.items():
        engine = engine_apart(without)
        fly(engine, JUMPS)  # compiles, and fills the tables
        best: dict[str, Any] = {"seconds": math.inf}
        for _ in range(30):
            account[:] = 0
            begin = time.perf_counter()
            fly(engine, JUMPS)
            seconds = time.perf_counter() - begin
            if seconds < best["seconds"]:
                best = {"seconds": seconds, "ticks": account[:-1, 0].tolist(), "calls": account[:-1, 1].tolist()}
        found[name] = best
    return found


class Counted(float):
    """A number that counts what is done with it: every operation and every function of `math` as one."""

    done = 0


def _counting(name: str) -> Callable[..., Any]:
    plain = getattr(float, name)

    def operation(*numbers: Any) -> Any:
        found = plain(*map(float, numbers))
        Counted.done += 1
        return Counted(found)

    return operation


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "pow", "rpow"):
    setattr(Counted, f"__{_name}__", _counting(f"__{_name}__"))


class CountingMath:
    """`math`, with functions that count."""

    def __getattr__(self, name: str) -> Any:
        """A function or a constant."""
        plain = getattr(math, name)
        if not callable(plain):
            return plain

        def function(*numbers: Any) -> Any:
            found = plain(*numbers)
            Counted.done += 1
            return tuple(map(Counted, found)) if isinstance(found, tuple) else Counted(found)

        return function


def operations_of_rates(engine: Engine) -> int:
    """Floating-point operations of one evaluation of the rates, at the state after a takeoff."""
    own = engine.own_of((0.0, 0.0, 0.0), 0)
    y, out = [Counted(value) for value in engine.state_of(engine.first(), own)], [0.0] * engine.states
    modules = [module for name, module in sys.modules.items() if name.startswith("saltation") and getattr(module, "math", None) is math]
    Counted.done = 0
    with contextlib.ExitStack() as stack:
        for module in modules:
            stack.enter_context(mock.patch.object(module, "math", CountingMath()))
        equations.rates_of(engine.equation, 0.0, y, out, own)
    return Counted.done


def arithmetic(engine: Engine, per_step: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Floating-point operations of a step by part, and bytes of the tables that it reads; `per_step`: calls of each function.

    A product and its sum are two; what is done once per state or stage, without a sum over stages or exponentials, is not counted.
    """
    s, n, m, q = engine.tables.count, engine.states, engine.members, len(engine.rates)
    rates, attempts, taken = per_step["rates_of"], per_step["iterate"], per_step["accept"]
    iterations = rates / s  # of all stages at once, the few rates for first guesses and Jacobians among them
    inverses = 3 if m else 2  # moving, slipping, turning: their stage matrices are inverted once for each kind
    found = {
        "rates": (rates * operations_of_rates(engine), 0.0),
        "stages": (iterations * 4.0 * s * s * n + attempts * (inverses * 4.0 * s**3 + 2.0 * s * s * n), 0.0),
        "memory": (attempts * 2.0 * s * m * q + taken * m * q * (2.0 + 2.0 * s), 8.0 * q * (attempts * s + taken * (s + 1 + m))),
        "error": (attempts * 2.0 * s * (s + 2) * n, 0.0),
        "record": (per_step["fit_polynomial"] * 2.0 * s * (s + 1) * n, 8.0 * n * (s + 1) * per_step["keep"]),
    }
    return {name: {"operations": operations, "bytes": bytes_read} for name, (operations, bytes_read) in found.items()}


def peak() -> float:
    """Floating-point operations per second of the best loop: y += a x of 256 numbers, over and over, compiled as everything else is."""

    def loop(x, y, times):
        for k in range(times):
            a = 1e-9 * k
            for i in range(256):
                y[i] += a * x[i]

    made, x, y, times = compiler().njit(loop, fastmath=True), np.ones(256), np.ones(256), 20_000
    made(x, y, 1)
    seconds: float = measure.interleaved({"loop": lambda: made(x, y, times)}, rounds=9, seconds=0.0)["loop"]
    return 2.0 * 256 * times / seconds


def taken_apart(rounds: int) -> dict[str, Any]:
    """Seconds of a step of the sand scene, of its parts, and what their arithmetic would take by itself."""
    engines = {name: engine_apart(without) for name, without in SETTINGS.items()}
    for engine in engines.values():
        fly(engine, JUMPS)  # compiles, and fills the tables
    times = measure.interleaved({name: partial(fly, engine, JUMPS) for name, engine in engines.items()}, rounds=rounds, seconds=0.0)
    with tempfile.TemporaryDirectory() as folder:
        inside = fresh("import json; from bench.suites import stepper; print(json.dumps(stepper.clocked()))", folder)
    rows = []
    for name, engine in engines.items():
        calls = dict(zip(CLOCKED, inside[name]["calls"], strict=True))
        ticks = dict(zip(CLOCKED, inside[name]["ticks"], strict=True))
        steps, whole = calls["accept"] + calls["truncate_step"], sum(ticks.values())
        sizes = {"stages": engine.tables.count, "states": engine.states, "members": engine.members, "terms": len(engine.rates)}
        per_step = {key: count / steps for key, count in calls.items()}
        seconds = times[name] / steps
        counted = arithmetic(engine, per_step)
        parts = [
            {"part": part, "seconds": seconds * sum(ticks[function] for function in functions) / whole, **counted.get(part, {})}
            for part, functions in PARTS.items()
        ]
        row = {"scene": name, "seconds": seconds, "clocks": inside[name]["seconds"] / times[name], "steps": steps / JUMPS}
        rows.append({**row, **sizes, "calls": per_step, "parts": parts})
    return {"records": rows, "peak": peak()}


# What is saved in `solve`: pairs of what is dear and what is cheap


def falls(t, y):
    """A fall with drag."""
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -1.0 - 0.1 * y[1]
    return rates


def floor(t, y):
    """Height above the floor."""
    return y[0]


def bounce(t, y):
    """The state after an impact."""
    after = np.empty(2)
    after[0], after[1] = 0.0, -0.9 * y[1]
    return after


def swings(t, y, stiffness):
    """A damped spring."""
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -stiffness * y[0] - 0.3 * y[1]
    return rates


def driven(t, y, stiffness):
    """A damped spring that is pushed to and fro: it never comes to rest, so its steps stay as long as they are."""
    rates = np.empty(2)
    rates[0], rates[1] = y[1], math.cos(t) - stiffness * y[0] - 0.3 * y[1]
    return rates


@cache
def njit(function: Any) -> Any:
    """The compiled function."""
    return compiler().njit(function)


class Floor:
    """An event in Python with its attributes."""

    direction, terminal = -1, 10

    def __call__(self, t, y):
        """`floor`."""
        return floor(t, y)

    def jump(self, t, y):
        """`bounce`."""
        return bounce(t, y)


def impacts() -> Case:
    """Ten impacts of a bouncing sphere at rtol 1e-9: event and jump in Python, then all compiled."""
    event = njit(floor)
    event.jump, event.direction, event.terminal = njit(bounce), -1, 10
    sides = []
    for fun, watched in ((falls, Floor()), (njit(falls), event)):
        arguments = {"memory": [1], "coefficient": 0.3, "events": watched, "method": basset.Collocation(rtol=1e-9)}
        found = basset.solve(fun, (0.0, 60.0), [1.0, 0.0], **arguments)
        if len(found.t_events[0]) != 10:
            raise RuntimeError(f"ten impacts are wanted, got {len(found.t_events[0])}")
        sides.append(lambda fun=fun, arguments=arguments: basset.solve(fun, (0.0, 60.0), [1.0, 0.0], **arguments))
    return sides[0], sides[1]


def same(one: Any, other: Any) -> None:
    """Have both the same bits; RuntimeError if they have not."""
    if not all(np.array_equal(mine, theirs) for mine, theirs in zip(one, other, strict=True)):
        raise RuntimeError("both sides must give the same bits")


def many(number: int) -> tuple[Any, Any]:
    """Initial states and stiffnesses of so many systems."""
    rng = np.random.default_rng(1)
    return rng.normal(size=(2, number)), rng.uniform(1.0, 3.0, number)


def systems(number: int = 1000) -> Case:
    """So many systems: one after the other, over all at once."""
    states, stiffness = many(number)
    options = {"memory": [1], "coefficient": 0.4}
    fun = njit(swings)

    def one_by_one() -> Any:
        return [basset.solve(fun, (0.0, 20.0), states[:, j], args=(float(stiffness[j]),), **options) for j in range(number)]

    def at_once() -> Any:
        return basset.solve(fun, (0.0, 20.0), states, args=(stiffness,), **options)

    same([one.y for one in one_by_one()], at_once().y)
    return one_by_one, at_once


def threads(number: int = 4000) -> Case:
    """So many systems on one thread, over two."""
    states, stiffness = many(number)

    def on(workers: int) -> Any:
        return basset.solve(njit(swings), (0.0, 20.0), states, memory=[1], coefficient=0.4, args=(stiffness,), workers=workers)

    same(on(1).y, on(2).y)
    return lambda: on(1), lambda: on(2)


def fixed_steps() -> Case:
    """A thousand fixed steps with a Python function, over a compiled one."""
    sides = []
    for fun in (swings, njit(swings)):
        method = basset.FixedStep(0.02, basset.Exponential(order=2, rtol=1e-6))
        sides.append(lambda fun=fun, method=method: basset.solve(fun, (0.0, 20.0), [1.0, 0.0], memory=[1], coefficient=0.4, args=(2.0,), method=method))
    return sides[0], sides[1]


SAVED: dict[str, Callable[[], Case]] = {"impacts": impacts, "systems": systems, "threads": threads, "fixed_steps": fixed_steps}


def saved(rounds: int) -> list[dict[str, Any]]:
    """Seconds of both sides of every case, taking turns."""
    rows = []
    for name, case in SAVED.items():
        dear, cheap = case()
        rows.append({"case": name, **measure.interleaved({"dear": dear, "cheap": cheap}, rounds=rounds, patience=30.0)})
    return rows


def one_long(full: bool, rounds: int) -> dict[str, Any]:
    """Many driven systems at once beside a single one that takes about as many steps, both per step; one and two threads."""
    number, span = (10_000, 20.0) if full else (500, 20.0)
    states, stiffness = many(number)
    fun, options = njit(driven), {"memory": [1], "coefficient": 0.4}
    length = 0.1 * span * number

    def at_once(workers: int = 1) -> Any:
        return basset.solve(fun, (0.0, span), states, args=(stiffness,), t_eval=[span], workers=workers, **options)

    def alone() -> Any:
        return basset.solve(fun, (0.0, length), states[:, 0], args=(2.0,), t_eval=[length], **options)

    together, single = at_once(), alone()
    for j in range(0, number, number // 20):
        own = basset.solve(fun, (0.0, span), states[:, j], args=(float(stiffness[j]),), t_eval=[span], **options)
        same([own.y], [together.y[:, :, j]])
    same([together.y], [at_once(2).y])
    steps = {"many": int(np.sum(together.nsteps)), "two threads": int(np.sum(together.nsteps)), "one long": int(single.nsteps)}
    times = measure.interleaved({"many": at_once, "two threads": lambda: at_once(2), "one long": alone}, rounds=rounds, seconds=0.0, patience=60.0)
    return {"number": number, "span": span, "length": length, "records": [{"case": k, "seconds": v, "steps": steps[k]} for k, v in times.items()]}


# Many grains


def grains_of(number: int, duration: float) -> Any:
    """The thesis's cloud with so many grains that never meet, flown so long (d/u*), nothing of the paths kept."""
    content = changed(thesis.case("sand_cloud"), without=("encounters",), cloud={"number": number}, run={"trajectory": False, "discard": 0})
    content["run"]["duration"] = duration * scene_of(content).numbers.time
    return scene_of(content)


def independent(full: bool, rounds: int) -> dict[str, Any]:
    """Grains that never meet, flown by one and by two threads of this process; their jumps have to be the same bits."""
    number, duration = (10_000, 10.0) if full else (500, 4.0)
    scene = grains_of(number, duration)

    def on(workers: int) -> Any:
        with ThreadPoolExecutor(workers) as executor:
            return saltation.run(scene, executor=executor).all_jumps

    here = saltation.run(scene).all_jumps
    for workers in (1, 2):
        same([here.to_numpy()], [on(workers).to_numpy()])
    times = measure.interleaved({"1": lambda: on(1), "2": lambda: on(2)}, rounds=rounds, seconds=0.0, patience=60.0)
    return {"number": number, "duration": duration, "jumps": len(here), "one": times["1"], "two": times["2"]}


CROWD = """
import json, re, time
import saltation
from bench.suites import stepper
scene = stepper.grains_of({number}, 1.0)
begin = time.perf_counter()
result = saltation.run(scene)
seconds = time.perf_counter() - begin
size = 1024 * int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])  # ru_maxrss would be the parent's, where that has more
print(json.dumps({{"number": {number}, "seconds": seconds, "bytes": size, "jumps": len(result.all_jumps)}}))
"""


# What compiling costs: CPU seconds beyond imports, by the process's own clock

CLOCK = """
import json, time
spent = []
def lap(): spent.append(time.process_time())
"""
SAND = """
import numba, numpy, pandas, xarray, saltation
from saltation import simulation
from saltation.scene import scene_of
from bench.grains import base, changed
from bench.suites.flights import RTOL, engine_of, fly
from bench.suites import stepper
sand = base("sand", 1, 0)
lap()
saltation.run(scene_of(sand))
lap()
"""
FURTHER_SET = """
saltation.run(scene_of(changed(sand, without=("history", "magnus", "rotation"), bed={"rebound": "sliding_only"})))
lap()
"""
CLOUD = """
import numba, numpy, pandas, xarray, saltation
from saltation.scene import scene_of
from saltation.study.thesis import case
from bench.grains import changed
content = changed(case("sand_cloud"), run={"discard": 0})
content["run"]["duration"] = 1.0 * scene_of(content).numbers.time
scene = scene_of(content)
lap()
saltation.run(scene)
lap()
"""
SOLVE = """
import numba, numpy, scipy.integrate, basset
from bench.suites import stepper
lap()
options = {"memory": [1], "coefficient": 0.4, "args": (2.0,)}
basset.solve(numba.njit(stepper.swings), (0.0, 1.0), [1.0, 0.0], **options)
lap()
basset.solve(numba.njit(stepper.driven), (0.0, 1.0), [1.0, 0.0], **options)
lap()
"""
TOLD = "print(json.dumps(spent))"


def compiling() -> list[dict[str, Any]]:
    """CPU seconds of first runs: nothing compiled before; then a further one of its kind; then in a second process."""
    rows = []
    for first, script, further in (
        ("sand", SAND + FURTHER_SET, "a further set of effects and rebound"),
        ("a cloud whose grains meet", CLOUD, None),
        ("solve with a compiled fun", SOLVE, "a further fun"),
    ):
        with tempfile.TemporaryDirectory() as folder:
            laps = [np.diff(fresh(CLOCK + script + TOLD, folder)).tolist() for _ in range(2)]
        for place, what in enumerate([first, *([further] if further is not None else [])]):
            rows.append({"what": what, "cold": laps[0][place], "second": laps[1][place]})
    return rows


def run(full: bool) -> dict[str, Any]:
    """Measure."""
    rounds = 9 if full else 3
    return {
        "rtol": RTOL,
        "jumps": JUMPS,
        "apart": taken_apart(100 if full else 30),
        "saved": saved(rounds),
        "one_long": one_long(full, rounds),
        "independent": independent(full, rounds),
        "crowd": [fresh(CROWD.format(number=number)) for number in (100, 1_000_000 if full else 2_000)][-1],  # the first compiles, which takes memory too
        "compiling": compiling(),
    }
