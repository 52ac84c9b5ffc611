"""What does a jump cost, and how accurate is it?"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import saltation
from basset import measure
from basset.kernels import Floats
from bench import hand_written
from bench.grains import at_fixed_steps, base, changed
from saltation.flight import layout
from saltation.flight.setup import Engine, Grain, empty_record
from saltation.scene import scene_of
from saltation.study import thesis

RTOL = 1e-5  # of what a jump may cost
JUMPS = 400  # timed
SIDE_BY_SIDE = 200  # timed beside the loop written by hand: short enough that some round is not disturbed
FLOWN, REFERENCE = 60, 1e-10  # jumps whose errors are taken, rtol of their reference
COUNTED = 200  # jumps of a mean height
HORIZONS = {"impulse": 110.0, "reset": 240.0}  # d/u* that fixed steps are ready to remember: FLOWN jumps and some more
QUANTITIES = ("duration", "length", "height")
PLACES = [layout.COLUMNS.index(name) for name in ("duration", "length", "rise")]
RTOLS = tuple(10.0**-k for k in range(2, 9))
HALVED = {"sand": (1e-3, 1e-4, 1e-5, 1e-6, 1e-7), "sand_coarse": (1e-3, 1e-4, 1e-5, 1e-6), "gravel": (1e-3, 1e-4, 1e-5, 1e-6)}
OURS, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
SCHEMES: dict[str, dict[str, Any]] = {
    "semi-derivative": {"scheme": "semi_derivative"},
    "Euler–Maclaurin": {"scheme": "euler_maclaurin"},
    "Brush": {"scheme": "brush"},
    "Hinsberg, published tail": {"scheme": "hinsberg", "window": 0.5},
    "Daitche(1)": {"scheme": "daitche", "order": 1},
    "Daitche(2)": {"scheme": "daitche", "order": 2},
    "Daitche(3)": {"scheme": "daitche", "order": 3},
    "Windowed, fitted tail": {"scheme": "windowed", "rule": "daitche", "order": 2, "window": 0.1, "tail": "fitted"},
    "Exponential(3)": {"scheme": "exponential"},
}
THESIS = ("semi-derivative", HELD, 1e-3)  # what the thesis flies with
LADDER = tuple(8e-3 / 2**k for k in range(6))  # dt in d/u*
STEEP = tuple(8e-3 / 4**k for k in range(5))
FORGETFUL = ("semi-derivative", "Windowed, fitted tail", "Exponential(3)")  # flown also without slip at takeoff
ROOT = Path(__file__).resolve().parents[2]

Content = dict[str, Any]


def engine_of(content: Content, rtol: float = RTOL) -> Engine:
    """A scene made ready for collocation at this tolerance."""
    return Engine(scene_of(changed(content, solver={"rtol": rtol})))


def fly(engine: Engine, jumps: int) -> tuple[Grain, Floats]:
    """The grain after so many jumps, and their table as recorded; nothing of the path. RuntimeError if it does not get that far."""
    grain, table = Grain(engine), np.zeros((jumps, len(layout.COLUMNS)))
    code, _ = grain.fly(empty_record(1, engine.tables.count, engine.states), False, table)
    if code not in (layout.JUMPS, layout.CROWDED):
        raise RuntimeError(f"the flight ended with {code} after {grain.flight[0].taken} jumps")
    return grain, table


# What a jump costs


def weight_and_drag() -> Content:
    """Sand in the plane under weight and drag alone, with the rebound of García and Niño: the least that jumps."""
    content = changed(base("sand", JUMPS, 0), without=("added_mass", "lift", "history", "magnus", "rotation"), dimensions=2)
    bed = {name: value for name, value in content["bed"].items() if name != "friction"}
    return content | {"bed": {**bed, "rebound": "garcia_nino", "roughness": "R1", "tangential_retention": 0.89}}


def costs(rounds: int) -> dict[str, Any]:
    """Seconds, steps and rate evaluations per jump of the sand scene and its variants, taking turns."""
    sand = base("sand", JUMPS, 0)
    bare = changed(sand, without=("history",))
    scenes = {
        "sand": (sand, RTOL),
        "without history": (bare, RTOL),
        "Mei–Adrian kernel": (changed(sand, history={"kernel": "mei_adrian"}), RTOL),
        "weight and drag": (weight_and_drag(), RTOL),
        "sand, rtol 1e-3": (sand, 1e-3),
        "sand, rtol 1e-7": (sand, 1e-7),
    }
    engines = {name: engine_of(content, rtol) for name, (content, rtol) in scenes.items()}
    whole = scene_of(changed(sand, solver={"rtol": RTOL}))
    kept = whole.model_copy(update={"run": whole.run.model_copy(update={"trajectory": True})})
    calls: dict[str, Callable[[], Any]] = {name: partial(fly, engine, JUMPS) for name, engine in engines.items()}
    calls |= {"saltation.run": partial(saltation.run, whole), "saltation.run, path kept": partial(saltation.run, kept)}
    for call in calls.values():
        call()  # compiles, and fills the tables
    times = measure.interleaved(calls, rounds=rounds, seconds=0.0)
    rows = []
    for name, engine in engines.items():
        grain, table = fly(engine, JUMPS)
        control = grain.state.control[0]
        rows.append(
            {
                "scene": name,
                "rtol": scenes[name][1],
                "seconds": times[name] / JUMPS,
                "steps": int(control.steps) / JUMPS,
                "calls": int(control.calls) / JUMPS,
                "stages": engine.tables.count,
                "terms": len(engine.rates),
                "states": engine.states,
                "members": engine.members,
                **dict(zip(QUANTITIES, table[:, PLACES].mean(axis=0), strict=True)),
            }
        )
    return {"records": rows, "run": times["saltation.run"] / JUMPS, "run_path": times["saltation.run, path kept"] / JUMPS}


def by_hand() -> dict[str, Any]:
    """The scene of weight and drag beside the same arithmetic written by hand; RuntimeError if jumps differ by 1e-12, or for more than four states."""
    rows = []
    for rtol in (1e-3, RTOL, 1e-7):
        engine = engine_of(weight_and_drag(), rtol)
        case, nodes, room = hand_written.case_of(engine), hand_written.nodes_of(engine), hand_written.room_for(engine.tables.count)
        start, jumps = Grain(engine).state, np.zeros((SIDE_BY_SIDE, 3))
        if engine.states != 4 or engine.members != 0 or start.y.size != 4 or start.past.size or start.jump.size:
            raise RuntimeError(f"weight and drag in the plane must hold four states and no memory, got {engine.states} and {engine.members}")

        def hand(case: Any = case, nodes: Any = nodes, room: Any = room, y: Floats = start.y, jumps: Floats = jumps) -> None:
            hand_written.fly(case, nodes, room, y.copy(), jumps)

        _, table = fly(engine, SIDE_BY_SIDE)
        hand()
        apart = float(np.abs(jumps - table[:, PLACES]).max())
        if not apart <= 1e-12:
            raise RuntimeError(f"both must fly the same jumps to 1e-12, at rtol {rtol:g} they differ by {apart:g}")
        times = measure.interleaved({"simulator": partial(fly, engine, SIDE_BY_SIDE), "hand": hand}, rounds=60, seconds=0.0)
        rows.append({"rtol": rtol, "apart": apart, **{name: seconds / SIDE_BY_SIDE for name, seconds in times.items()}})
    return {"records": rows, "states": engine.states, "members": engine.members}


# How exact it is


def flown(rebound: str) -> Content:
    """The sand scene for errors: what its memory does at a rebound, no path."""
    return changed(base("sand", FLOWN, 0), history={"rebound": rebound, "horizon": HORIZONS[rebound]})


def fixed(content: Content, scheme: str, method: str, dt: float, jumps: int) -> Any:
    """The scene at fixed steps."""
    return scene_of(at_fixed_steps(content, method, dt, jumps, SCHEMES[scheme]))


def errors(table: Floats, reference: Floats) -> dict[str, Any]:
    """Largest and root-mean-square error of the jumps over the mean jump, of each quantity and of all."""
    if len(table) < len(reference):
        return {"max": None, "rms": None, "reason": f"ended after {len(table)} of {len(reference)} jumps"}
    apart = np.abs(table - reference) / reference.mean(axis=0)
    found = {f"{name}_max": value for name, value in zip(QUANTITIES, apart.max(axis=0), strict=True)}
    return {"max": apart.max(), "rms": np.sqrt((apart**2).mean()), **found}


def accuracy(rebound: str, schemes: Mapping[str, Any], ladder: tuple[float, ...], patience: float, rounds: int) -> dict[str, Any]:
    """Error and time of a jump: collocation at several tolerances, every scheme at several steps.

    One seed, one grain. Where the memory forgets the rebound (`reset`) the first jump, which starts with slip, is left out.
    Times of fixed steps are of 60 jumps less one jump, so without set-up; a ladder ends with the run that outlasts `patience`.
    """
    content, skip = flown(rebound), 1 if rebound == "reset" else 0
    exact = fly(engine_of(content, REFERENCE), FLOWN)[1][skip:, PLACES]
    other = fly(engine_of(content, 10.0 * REFERENCE), FLOWN)[1][skip:, PLACES]
    records, calls = [], {}
    for rtol in RTOLS:
        engine = engine_of(content, rtol)
        found = errors(fly(engine, FLOWN)[1][skip:, PLACES], exact)
        records.append({"scheme": OURS, "method": OURS, "size": rtol, **found})
        calls[OURS, OURS, rtol, FLOWN] = partial(fly, engine, FLOWN)
    once: dict[Any, float] = {}
    for scheme in schemes:
        for method in (IMPLICIT, HELD):
            for dt in ladder if (scheme, method) != THESIS[:2] else sorted({*ladder, THESIS[2]}, reverse=True):
                for jumps in (1, FLOWN):
                    call = partial(saltation.run, fixed(content, scheme, method, dt, jumps))
                    start = time.perf_counter()
                    result = call()
                    once[scheme, method, dt, jumps] = seconds = time.perf_counter() - start
                    calls[scheme, method, dt, jumps] = call
                found = errors(result.all_jumps[list(QUANTITIES)].to_numpy()[skip:], exact)
                records.append({"scheme": scheme, "method": method, "size": dt, **found})
                if seconds > patience and not ((scheme, method) == THESIS[:2] and dt > 1.001 * THESIS[2]):
                    break
    quick = {key: call for key, call in calls.items() if once.get((*key[:3], FLOWN), 0.0) < 0.15}
    times = once | measure.interleaved(quick, rounds=rounds, seconds=0.0)
    for row in records:
        key = row["scheme"], row["method"], row["size"]
        row["seconds"] = times[*key, FLOWN] / FLOWN if row["method"] == OURS else (times[*key, FLOWN] - times[*key, 1]) / (FLOWN - 1)
    mean = dict(zip(QUANTITIES, exact.mean(axis=0), strict=True))
    return {"rebound": rebound, "skipped": skip, "mean": mean, "reference_apart": errors(other, exact)["max"], "records": records}


def kept() -> list[dict[str, Any]]:
    """Errors of jumps at every tolerance, three scenes."""
    rows = []
    for name in HALVED:
        content = base(name, FLOWN, 0)
        exact = fly(engine_of(content, REFERENCE), FLOWN)[1][:, PLACES]
        for rtol in RTOLS:
            rows.append({"scene": name, "rtol": rtol, **errors(fly(engine_of(content, rtol), FLOWN)[1][:, PLACES], exact)})
    return rows


def halving(full: bool) -> list[dict[str, Any]]:
    """Mean height at a tolerance and at half of it, one sequence of bed angles."""
    rows = []
    for name, rtols in HALVED.items():
        content = base(name, COUNTED, 0)
        for rtol in rtols if full else rtols[:3]:
            whole, half = (fly(engine_of(content, size), COUNTED)[1][:, PLACES[2]] for size in (rtol, 0.5 * rtol))
            changed_by = abs(whole.mean() - half.mean()) / half.mean()
            rows.append(
                {"scene": name, "rtol": rtol, "height": whole.mean(), "ratio": changed_by / rtol, "worst": np.abs(whole - half).max() / half.mean() / rtol}
            )
    return rows


def one_jump(ladder: tuple[float, ...]) -> dict[str, Any]:
    """The first jump with every scheme at falling dt, and by collocation."""
    content = flown("impulse")
    exact = fly(engine_of(content, REFERENCE), 1)[1][0, PLACES]
    records = []
    for scheme in SCHEMES:
        for method in (IMPLICIT, HELD):
            for dt in ladder:
                jump = saltation.run(fixed(content, scheme, method, dt, 1)).all_jumps.iloc[0]
                records.append({"scheme": scheme, "method": method, "dt": dt, **{name: float(jump[name]) for name in QUANTITIES}})
    return {"exact": dict(zip(QUANTITIES, exact, strict=True)), "records": records}


# What starting costs

FIRST_JUMP = """
import saltation
scene = saltation.load("sand")
saltation.run(scene.model_copy(update={"run": scene.run.model_copy(update={"jumps": 1, "discard": 0})}))
print("landed", flush=True)
"""


def to_first_jump(cache: Path | None) -> float:
    """Seconds from the start of Python to the end of the first jump of the sand scene; RuntimeError if it does not land."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache is not None else {})
    start = time.perf_counter()
    with subprocess.Popen([sys.executable, "-c", FIRST_JUMP], cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        seconds = time.perf_counter() - start
    if said.strip() != "landed":
        raise RuntimeError("the first jump of a fresh process did not land")
    return seconds


def starting(full: bool) -> dict[str, Any]:
    """First start (nothing compiled yet) and next starts."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder) if full else None
        first = to_first_jump(cache)  # without a folder of its own: what is compiled already counts
        following = [to_first_jump(cache) for _ in range(4 if full else 2)]
    return {"first": first if full else None, "next": min(following), "numba": version("numba")}


def campaign(full: bool) -> dict[str, Any]:
    """The thesis's runs on two cores by the command, start-up included, everything compiled before."""
    if not full:
        return {"status": "skipped", "reason": "only with --full"}
    runs = len(thesis.thesis())
    times = []
    for _ in range(2):  # the first may have to compile
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "saltation", "campaign", "thesis", "--output", str(Path(folder) / "thesis"), "--workers", "2"]
            start = time.perf_counter()
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
            times.append(time.perf_counter() - start)
        if done.returncode:
            return {"status": "failed", "reason": (done.stderr.strip().splitlines() or ["no message"])[-1][:200]}
    return {"status": "measured", "reason": "", "seconds": times[-1], "first": times[0], "runs": runs, "workers": 2}


def run(full: bool) -> dict[str, Any]:
    """Time and error of jumps, by collocation and at fixed steps; what starting and the campaign cost."""
    ladder, patience, rounds = (LADDER, 1.0, 3) if full else (LADDER[:3], 0.25, 3)
    return {
        "rtol": RTOL,
        "jumps": JUMPS,
        "flown": FLOWN,
        "counted": COUNTED,
        "reference": REFERENCE,
        "thesis": THESIS,
        "costs": costs(30 if full else 10),
        "by_hand": by_hand(),
        "remembered": accuracy("impulse", SCHEMES, ladder, patience, rounds),
        "forgotten": accuracy("reset", {name: SCHEMES[name] for name in FORGETFUL}, ladder, patience, rounds),
        "kept": kept(),
        "halving": halving(full),
        "one_jump": one_jump(STEEP if full else STEEP[:3]),
        "starting": starting(full),
        "campaign": campaign(full),
    }
