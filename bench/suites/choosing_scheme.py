"""Does `saltation scheme` choose a history scheme that keeps the wanted error, and the cheapest that does?

Twelve scenes that were not used in developing the command, two errors each. What is chosen flies again, over other beds and for longer, beside a
tighter reference; everything else that could be cheaper does too.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any

import saltation
from bench.grains import rounded
from saltation.scene import scene_of as scene_from_tables
from saltation.study import schemes, thesis
from saltation.study.schemes import COLLOCATION, Candidate, Entry, Sample, Trial
from saltation.workers import cores, processes

ERRORS = (0.01, 0.001)
OTHER = 1000  # added to the seeds that a choice has seen
TIGHT = (1e-10, *schemes.REFERENCES)
LONGER, BEDS = 200, 6  # jumps of a run, runs
SOME, LOOKS = 60, 3  # jumps of a look at the time, looks
CHEAPER = 1.5  # times within it of the cheapest are as good
PLANE = {"effects": ["weight", "drag", "added_mass", "history"], "dimensions": 2, "magnus": None, "rotation": None}
KEEPING = {"rebound": "garcia_nino", "friction": None, "tangential_retention": 0.8}
SCENES: dict[str, tuple[str, dict[str, Any]]] = {  # name -> shipped scene with the thesis's laws, what is changed
    "fine sand, T 1.4": ("sand", {"grain": {"diameter": 0.35e-3}, "channel": {"transport_stage": 1.4}}),
    "sand 1.1 mm, T 3.4, Mei & Adrian": ("sand", {"grain": {"diameter": 1.1e-3}, "channel": {"transport_stage": 3.4}, "history": {"kernel": "mei_adrian"}}),
    "granules 3 mm, T 2.3, restart": ("sand", {"grain": {"diameter": 3.0e-3}, "channel": {"transport_stage": 2.3}, "history": {"rebound": "restart"}}),
    "sand 0.5 mm, T 2.6, reset, e by Stokes number": (
        "sand",
        {"grain": {"diameter": 0.5e-3}, "channel": {"transport_stage": 2.6}, "history": {"rebound": "reset"}, "bed": {"restitution": "stokes"}},
    ),
    "plastic 2.5 mm, T 2, R1": (
        "sand",
        {"grain": {"diameter": 2.5e-3, "density": 1300.0}, "channel": {"transport_stage": 2.0}, "bed": {"roughness": "R1", "restitution": 0.8}},
    ),
    "heavy mineral 0.8 mm, T 2.8, Dorgan & Loth": (
        "sand",
        {"grain": {"diameter": 0.8e-3, "density": 4700.0}, "channel": {"transport_stage": 2.8}, "history": {"kernel": "dorgan_loth"}},
    ),
    "sand 0.9 mm in oil, T 2": ("sand", {"grain": {"diameter": 0.9e-3}, "fluid": {"viscosity": 6.0e-6, "density": 900.0}, "channel": {"transport_stage": 2.0}}),
    "sand 0.69 mm, T 5, impact ignored": ("sand", {"channel": {"transport_stage": 5.0}, "history": {"rebound": "none"}}),
    "plane, gravel 7 mm, T 1.7, García & Niño": (
        "sand",
        {**PLANE, "grain": {"diameter": 7.0e-3}, "channel": {"transport_stage": 1.7}, "bed": KEEPING},
    ),
    "plane, sand 0.6 mm, T 3, Mei & Adrian": (
        "sand",
        {**PLANE, "grain": {"diameter": 0.6e-3}, "channel": {"transport_stage": 3.0}, "bed": KEEPING, "history": {"kernel": "mei_adrian"}},
    ),
    "plane, sand 1.5 mm, T 2.2, R4, 40 jumps": (
        "sand",
        {
            **PLANE,
            "grain": {"diameter": 1.5e-3},
            "channel": {"transport_stage": 2.2},
            "bed": KEEPING | {"roughness": "R4"},
            "run": {"jumps": 40, "discard": 8},
        },
    ),
    "plane, fine sand 0.25 mm, T 2, reset": (
        "sand",
        {**PLANE, "grain": {"diameter": 0.25e-3}, "channel": {"transport_stage": 2.0}, "bed": KEEPING, "history": {"rebound": "reset"}},
    ),
}


def chosen_in(scene: Any) -> tuple[Candidate, float]:
    """What a scene names, and its step or tolerance."""
    options = scene.options("history")
    words = {word: getattr(options, word) for word in schemes.WORDS}
    size = scene.solver.rtol if scene.solver.method == COLLOCATION else scene.solver.dt
    return Candidate(scene.solver.method, tuple((word, value) for word, value in words.items() if value is not None)), size


def measured(name: str) -> dict[str, Any]:
    """What is chosen for a scene and each error, and what longer runs over other beds say of it and of all that is cheaper."""
    scene = scene_of(SCENES[name])
    choices = []
    for wanted in ERRORS:
        start = time.process_time()
        table = saltation.select_scheme(scene, wanted)
        choices.append((wanted, table, time.process_time() - start))
    trial = Trial(scene.changed(run={"seed": scene.run.seed + OTHER}), None, lambda text: None, LONGER, TIGHT)
    found = [chosen_in(scene_from_tables(json.loads(table.attrs["scene"]))) for _, table, _ in choices]
    flights = {(candidate, size): (Entry(candidate), trial.sample(Entry(candidate), size, BEDS)) for candidate, size in found}
    trial.timed(list(flights.values()))
    rivals, quickest = every_rival(trial, {wanted: flights[key][1].seconds for wanted, key in zip(ERRORS, found, strict=True)})
    every = [*flights.values(), *((entry, sample) for entry, sample in rivals if (entry.candidate, sample.size) not in flights)]
    chosen_too = flights.values()
    trial.timed([pair for pair in every if pair[1].bound <= max(ERRORS) or any(pair[1] is sample for _, sample in chosen_too)])
    rows = []
    for (wanted, table, seconds), key in zip(choices, found, strict=True):
        chosen = flights[key][1]
        keep = sorted(((e, s) for e, s in every if s.bound <= wanted), key=lambda pair: pair[1].seconds)
        fixed = table[(table["solver"] != COLLOCATION) & table["keeps"]].sort_values("seconds")
        rows.append(
            {
                "scene": name,
                "wanted": wanted,
                **told(key[0], chosen),
                "promised": float(table.iloc[0]["error"]),
                "keeps": chosen.bound <= wanted,
                "cheapest": told(keep[0][0].candidate, keep[0][1]) if keep else None,
                "ratio": chosen.seconds / keep[0][1].seconds if keep else None,
                "flown": len(every),
                "quickest_fixed": quickest,
                "fixed": None if fixed.empty else {key: fixed.iloc[0][key] for key in ("scheme", "solver", "dt", "seconds", "order", "runs")},
                "choosing": seconds,
            }
        )
    return {"rows": rounded(rows), "reference": trial.rtol, "particle_reynolds": scene.numbers.particle_reynolds, "history": scene.numbers.history}


def told(candidate: Candidate, sample: Sample) -> dict[str, Any]:
    """A candidate at one step, and what it does."""
    said = {"scheme": candidate.name, "solver": candidate.method, "size": sample.size}
    return said | {"error": sample.largest, "bound": sample.bound, "seconds": sample.seconds}


def every_rival(trial: Trial, chosen: Mapping[float, float]) -> tuple[list[tuple[Entry, Sample]], float]:
    """All that could be cheaper than what was chosen (error -> s per jump), flown; and the quickest jump of all fixed steps, at the longest step accepted.

    Of fixed steps the finest that is quick enough: its error is the smallest.
    """
    sizes = [schemes.rounded(trial.duration / 4.0 * 2.0**-k) for k in range(4)]
    found: list[tuple[Entry, Sample]] = []
    quickest = math.inf
    for candidate, first in schemes.candidates(trial.given, trial.duration, schemes.TAIL_SHARE * max(ERRORS), sizes).items():
        entry = Entry(candidate, candidate.fixed and schemes.grows(trial, candidate, first))
        if not candidate.fixed:
            found += [(entry, trial.sample(entry, rtol, BEDS)) for rtol in schemes.RTOLS[:2]]
            continue
        look = cache(partial(jump_of, trial, entry))
        size = next((step for step in sizes if step <= first and look(step) < math.inf), first)
        quickest = min(quickest, look(size))
        flown: dict[float, Sample] = {}
        for wanted, most in chosen.items():
            if look(size) <= most / CHEAPER:
                step = finest(look, size, most / CHEAPER)
                if step not in flown or not flown[step].tells(wanted):
                    flown[step] = trial.decided(entry, step, wanted, BEDS)
        found += [(entry, sample) for sample in flown.values()]
    return found, quickest


def finest(look: Callable[[float], float], size: float, most: float) -> float:
    """The shortest step, to a factor of the root of two, at which a jump takes at most so many seconds of CPU time by a look."""
    shorter = 0.25
    while shorter < 1.0:
        if look(schemes.rounded(size * shorter)) <= most:
            size = schemes.rounded(size * shorter)
        else:
            shorter **= 0.5
            if shorter > 0.71:
                break
    return size


def jump_of(trial: Trial, entry: Entry, size: float) -> float:
    """CPU seconds of a jump, at a look: the quickest of some runs less the quickest to the first jump, everything compiled; infinite where there is none."""
    if not trial.accepts(entry.candidate, size):
        return math.inf
    short, long = (trial.paired_scene(entry.candidate, size, jumps) for jumps in (1, SOME))
    if trial.fly([long])[0][0] != "finished":  # compiles
        return math.inf
    once, some = (min(seconds for _, _, seconds in trial.fly([scene] * LOOKS)) for scene in (short, long))
    return max(1e-9, some - once) / (SOME - 1)  # above zero, also where both are within the clock's noise


def scene_of(named: tuple[str, dict[str, Any]]) -> Any:
    """One of the twelve."""
    base, changes = named
    return scene_from_tables(thesis.case(base)).changed(**changes)


def run(full: bool) -> dict[str, Any]:
    """All scenes, a worker for each core."""
    names = list(SCENES) if full else list(SCENES)[:2]
    with processes(min(cores(), len(names))) as pool:
        found = dict(zip(names, pool.map(measured, names), strict=True))
    return {"errors": ERRORS, "longer": LONGER, "beds": BEDS, "cheaper": CHEAPER, "note": "", "scenes": found}
