"""What does each effect, each correction and each modelling choice do to a jump?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

import saltation
from bench import grains
from bench.grains import QUANTITIES, Task, base, changed, rounded
from saltation import regressions, statistics
from saltation.scene import Scene, scene_of
from saltation.study import thesis

COUNTED, COUNTED_SHORT = 600, 200  # jumps per run
SCENES = {73: "sand", 250: "sand_coarse"}
STAGES = {73: (1.79, 1.87, 2.43, 2.50, 2.67), 250: (2.31, 3.08, 3.85)}
PROFILES, READINGS = ("swamee", "yalin", "constant_b"), ("clip", "reject", "literal", "spheres")
FAR = 1e5  # d/u*: the memory of a run in which nothing is forgotten
SHIPPED = "swamee, clip"

Content = dict[str, Any]
Tasks = dict[Any, Task]
Found = dict[Any, dict[str, Any]]


def treatments() -> dict[str, Content]:
    """Treatments of the history force at an impact, as changes of a scene."""
    rebounds = {"remembered": "impulse", "restarted": "restart", "wiped": "reset", "jump ignored, 1 jump": "none"}
    found: dict[str, Content] = {"no history": {"without": ("history",)}}
    for label, kernel in (("", "basset"), ("Mei–Adrian: ", "mei_adrian"), ("Dorgan–Loth: ", "dorgan_loth")):
        for name, rebound in rebounds.items():
            limit = {"window_jumps": 1} if rebound == "none" else {}
            found[label + name] = {"history": {"rebound": rebound, "kernel": kernel, **limit}}
        if kernel == "basset":
            for count in (10, 20, 50):
                found[f"jump ignored, {count} jumps"] = {"history": {"rebound": "none", "window_jumps": count, "horizon": FAR}}
        found[f"{label}jump ignored, all jumps"] = {"history": {"rebound": "none", "kernel": kernel, "horizon": FAR}}
    found["remembered, e = 0.97 exp(−35/St)"] = {"bed": {"restitution": "stokes", "stokes_decay": 35.0}}
    found["remembered, immersed contact mass"] = {"bed": {"contact_mass": "immersed"}}
    return found


CASES = (  # of the table of memories: R_p, T, reading, profile
    (73, 1.87, "reject", "yalin"),
    (73, 1.87, "clip", "swamee"),
    (250, 3.08, "reject", "swamee"),
)
PROTOTYPE: dict[str, tuple[float | None, ...]] = {  # mean H/d of a separate program, over as many jumps; errors in PROTOTYPE_ERROR
    "no history": (1.93, 2.21, 5.62),
    "remembered": (0.86, 0.84, 3.44),
    "restarted": (1.10, 1.17, 3.86),
    "wiped": (2.23, None, None),
    "jump ignored, 1 jump": (2.85, 2.92, 6.90),
    "Mei–Adrian: remembered": (1.20, 1.23, 4.17),
    "Mei–Adrian: restarted": (1.46, 1.57, 4.75),
    "Mei–Adrian: jump ignored, 1 jump": (2.22, 2.43, 6.15),
    "remembered, e = 0.97 exp(−35/St)": (0.31, 0.22, None),
    "remembered, immersed contact mass": (0.92, 0.91, None),
}
PROTOTYPE_ERROR = {73: 0.04, 250: 0.14}  # at most; and about 2 % of a mean


def memory_tasks(jumps: int) -> Tasks:
    """Every treatment in every case, and the growth where nothing is forgotten."""
    tasks: Tasks = {}
    for case, (reynolds, stage, reading, profile) in enumerate(CASES):
        content = changed(base(SCENES[reynolds], jumps), channel={"transport_stage": stage, "profile": profile}, bed={"reading": reading})
        for name, changes in treatments().items():
            tasks["memory", case, name] = Task(changed(content, **changes))
        for count in (jumps // 4, jumps // 2, jumps):
            longer = changed(content, history={"rebound": "none", "horizon": FAR}, run={"jumps": count + 20})
            tasks["growth", case, count] = Task(longer)
    return tasks


def memory(found: Found) -> dict[str, Any]:
    """The table of memories and the growth with the run's length."""
    records, growth = [], []
    for key, row in found.items():
        if key[0] == "memory":
            _, case, name = key
            prototype = PROTOTYPE.get(name, (None,) * len(CASES))[case]
            bound = None if prototype is None else min(PROTOTYPE_ERROR[CASES[case][0]], 0.02 * prototype)
            records.append({"case": case, "name": name, "prototype": prototype, "prototype_error": bound, **kept(row, ("stokes",))})
        elif key[0] == "growth":
            growth.append({"case": key[1], "counted": key[2], **{name: row[name] for name in ("jumps", "status", "height", "length")}})
    cases = [dict(zip(("particle_reynolds", "stage", "reading", "profile"), case, strict=True)) for case in CASES]
    return {"cases": cases, "records": records, "growth": growth}


def kept(row: dict[str, Any], more: tuple[str, ...] = ()) -> dict[str, Any]:
    """How a run ended, its mean jump, and what else is wanted of it."""
    ending = ("status", "jumps") if row["status"] == "finished" else ("status", "message", "jumps")
    return {key: row[key] for key in (*ending, *QUANTITIES, *more)}


# Where the numbers lie among the regressions


def variants() -> dict[tuple[str, str], Content]:
    """(kind, name) of every profile and range of contact angles, and of the treatments of the history force that make the model's spread."""
    found: dict[tuple[str, str], Content] = {}
    for profile in PROFILES:
        for reading in READINGS:
            found["reading", f"{profile}, {reading}"] = {"channel": {"profile": profile}, "bed": {"reading": reading}}
    found["reading", "reichardt, clip"] = {"channel": {"profile": "reichardt"}}
    for reading in ("clip", "reject"):
        found["reading", f"swamee, {reading}, k_s = 2 d"] = {"bed": {"reading": reading}}
    found["reading", "swamee, clip, Magnus as a vector"] = {"magnus": {"form": "vector"}}
    found["reading", "swamee, clip, no Magnus"] = {"without": ("magnus",)}
    chosen = ("no history", "restarted", "wiped", "jump ignored, 1 jump", "Mei–Adrian: remembered", "Mei–Adrian: restarted", "Mei–Adrian: jump ignored, 1 jump")
    found |= {("memory", name): changes for name, changes in treatments().items() if name in chosen}
    found["printed", "torque without ρ/ρ_s"] = {"rotation": {"density_ratio": False}}
    return found


def grid_tasks(jumps: int) -> Tasks:
    """Every variant at every transport stage."""
    tasks: Tasks = {}
    for reynolds, stages in STAGES.items():
        content = base(SCENES[reynolds], jumps)
        for stage in stages:
            at = changed(content, channel={"transport_stage": stage})
            for (kind, name), changes in variants().items():
                scene = changed(at, **changes)
                if "k_s" in name:
                    scene["channel"]["roughness_height"] = 2.0 * scene["grain"]["diameter"]
                tasks["grid", reynolds, stage, kind, name] = Task(scene, "heights" if name == SHIPPED else "means")
    return tasks


def grid(found: Found) -> dict[str, Any]:
    """Means of every variant at every stage, and what the regressions say there."""
    records = []
    for key, row in found.items():
        if key[0] == "grid":
            more = ("spin",) if key[3] == "printed" else ()
            if key[4] == SHIPPED:
                more = ("spin", "takeoff_angle", "deviation", "stokes_range", "clipped", "creeping", "bed_load")
                more += ("deviations",) if key[1:3] == (73, 1.87) else ()
            records.append({"particle_reynolds": key[1], "stage": key[2], "kind": key[3], "name": key[4], **kept(row, more)})
    published = []
    for reynolds, stages in STAGES.items():
        numbers = scene_of(base(SCENES[reynolds], 1)).numbers
        for stage in stages:
            row = {
                name: rounded([float(value) for value in regression(numbers.particle_reynolds, stage)]) for name, regression in regressions.REGRESSIONS.items()
            }
            bounds = {name: rounded([float(edge) for edge in edges]) for name, edges in regressions.envelope(numbers.particle_reynolds, stage).items()}
            bounds["velocity"] = bounds.pop("speed")
            published.append({"particle_reynolds": reynolds, "stage": stage, "regressions": row, "envelope": bounds})
    numbers = scene_of(base("gravel", 1)).numbers
    coarse = {
        name: rounded([float(value) for value in regression(numbers.particle_reynolds, numbers.stage)]) for name, regression in regressions.REGRESSIONS.items()
    }
    gravel = rounded({"particle_reynolds": numbers.particle_reynolds, "stage": numbers.stage, "reynolds": numbers.reynolds}) | {"regressions": coarse}
    return {"records": records, "published": published, "gravel": gravel, "shipped": SHIPPED}


# Effects, corrections and choices, in pairs


def modifications() -> dict[tuple[str, str], Content]:
    """(group, name) of everything that is switched, one at a time."""
    return {
        ("off", "history"): {"without": ("history",)},
        ("off", "Magnus"): {"without": ("magnus",)},
        ("off", "fluid torque on the spin"): {"without": ("rotation",)},
        ("off", "lift"): {"without": ("lift",)},
        ("off", "added mass"): {"without": ("added_mass",)},
        ("off", "all but weight and drag"): {"without": ("history", "magnus", "rotation", "lift", "added_mass")},
        ("printed", "torque without ρ/ρ_s"): {"rotation": {"density_ratio": False}},
        ("printed", "rebound 3-B letter by letter"): {"bed": {"rebound": "tsuji_printed"}},
        ("printed", "contact without sticking limit"): {"bed": {"rebound": "sliding_only"}},
        ("printed", "angles beyond 30° (literal)"): {"bed": {"reading": "literal"}},
        ("printed", "e and f exchanged (e 0.1, f 0.65)"): {"bed": {"restitution": 0.1, "friction": 0.65}},
        ("choice", "added mass without remainder (Auton)"): {"added_mass": {"form": "auton"}},
        ("choice", "Magnus as a vector"): {"magnus": {"form": "vector"}},
        ("choice", "drag of Schiller–Naumann"): {"drag": {"law": "schiller_naumann"}},
        ("choice", "reading reject"): {"bed": {"reading": "reject"}},
        ("choice", "reading spheres"): {"bed": {"reading": "spheres"}},
        ("choice", "bed angles of Run D (R4)"): {"bed": {"roughness": "R4"}},
        ("choice", "profile of Yalin"): {"channel": {"profile": "yalin"}},
        ("choice", "roughness height 2 d"): {"channel": {"roughness_height": 2.0}},
        ("choice", "e = 0.97 exp(−35/St)"): {"bed": {"restitution": "stokes", "stokes_decay": 35.0}},
        ("choice", "immersed contact mass"): {"bed": {"contact_mass": "immersed"}},
        ("choice", "Set 3 (e 0.8, f 0.4)"): {"bed": {"restitution": 0.8, "friction": 0.4}},
        ("choice", "Set 4 (e 0.95, f 0.3)"): {"bed": {"restitution": 0.95, "friction": 0.3}},
        ("choice", "memory restarted"): {"history": {"rebound": "restart"}},
        ("choice", "kernel of Mei and Adrian"): {"history": {"kernel": "mei_adrian"}},
    }


def modification_tasks(jumps: int) -> Tasks:
    """Every modification in every scene."""
    tasks: Tasks = {}
    for name in ("sand", "sand_coarse", "gravel"):
        content = base(name, jumps)
        tasks["modification", name, "base", "base"] = Task(content)
        for (group, modification), changes in modifications().items():
            scene = changed(content, **changes)
            if "roughness_height" in scene["channel"]:
                scene["channel"]["roughness_height"] *= scene["grain"]["diameter"]
            tasks["modification", name, group, modification] = Task(scene)
    return tasks


def effects(found: Found) -> list[dict[str, Any]]:
    """Means, and changes against the base with standard errors from pairs of jumps."""
    records = []
    for key, row in found.items():
        if key[0] != "modification":
            continue
        _, name, group, modification = key
        against = found["modification", name, "base", "base"]["series"]
        change = {}
        for quantity in QUANTITIES:
            difference = statistics.paired_difference(row["series"][quantity], against[quantity])
            change[quantity] = rounded({"mean": difference.mean, "se": difference.standard_error})
        records.append({"scene": name, "group": group, "name": modification, **kept(row), "change": change})
    return records


# Single jumps


JUMPS = (  # figure of the thesis, grain, profile, end of the flight in d/u*
    ("3-6", "sand", {"grain": {"diameter": 0.56e-3}, "channel": {"shear_velocity": 0.025}}, 12.0),
    ("3-5", "gravel", {}, 60.0),
)
SINGLE: dict[str, Content] = {
    "all effects": {},
    "no history": {"without": ("history",)},
    "no Magnus": {"without": ("magnus",)},
    "no lift": {"without": ("lift",)},
    "no added mass": {"without": ("added_mass",)},
    "weight and drag alone": {"without": ("history", "magnus", "rotation", "lift", "added_mass")},
}


def jump_base(name: str, changes: Content, jumps: int) -> Content:
    """The run whose grain makes the single jump."""
    content = base(name, jumps)
    if "shear_velocity" in changes.get("channel", {}):
        content["channel"].pop("transport_stage")
    return changed(content, **changes)


def single_tasks(scene: Content, takeoff: dict[str, float], end: float) -> Tasks:
    """One flight from a given takeoff, effects off one by one; and the flight with its takeoff slip forgotten.

    `Grain` remembers its first slip. So for the forgotten one the grain meets a nearly flat, frictionless and fully elastic bed
    at once, from which it takes off as wanted, and its memory is wiped there.
    """
    numbers = scene_of(scene).numbers
    d, velocity, time = numbers.diameter, numbers.velocity, numbers.time
    start = {
        "velocity": [takeoff["u"] * velocity, 0.0, takeoff["w"] * velocity],
        "spin": [0.0, takeoff["spin"] / time, 0.0],
        "height": 0.75 * d,
    }
    free = changed(scene, dimensions=2, start=start, run={"trajectory": True})
    free["run"] = {"duration": end * time, "seed": 1}
    free.pop("bed")
    tasks = {name: Task(changed(free, **changes), "first path") for name, changes in SINGLE.items()}
    elastic = {"roughness": "R2", "restitution": 1.0, "friction": 0.0}
    bed = changed(scene, dimensions=2, bed=elastic, run={"jumps": 2, "discard": 0, "trajectory": True}, start={**start, "velocity": [0.0, 0.0, -velocity]})
    tilt = math.radians(float(saltation.run(scene_of(changed(bed, run={"jumps": 1}))).all_jumps["tilt"].iloc[0]))
    n = np.array([-math.sin(tilt), math.cos(tilt)])
    out = np.array([takeoff["u"], takeoff["w"]])
    before = (out - 2.0 * (out @ n) * n) * velocity  # an elastic contact is its own inverse
    start = {**start, "velocity": [float(before[0]), 0.0, float(before[1])], "height": (math.cos(tilt) - 0.25 + 3e-4) * d}
    for name, rebound in (("takeoff slip forgotten", "reset"), ("takeoff slip remembered, second flight", "impulse")):
        tasks[name] = Task(changed(bed, start=start, history={"rebound": rebound}), "second path")
    return tasks


def single(found: Found) -> list[dict[str, Any]]:
    """Figs 3-5 and 3-6: the jump from the thesis's start and from the mean takeoff of the run."""
    records: list[dict[str, Any]] = []
    tasks: Tasks = {}
    for figure, name, changes, end in JUMPS:
        mean = found["single", figure]
        starts = {
            "start of the thesis's runs": {"u": 2.0, "w": 2.0, "spin": 2.0},
            "mean takeoff of the run": {"u": mean["takeoff_x"]["mean"], "w": mean["takeoff_z"]["mean"], "spin": mean["spin"]["mean"]},
        }
        numbers = scene_of(jump_base(name, changes, 20)).numbers
        about = rounded({"diameter": numbers.diameter, "shear_velocity": numbers.velocity, "stage": numbers.stage})
        for start, takeoff in starts.items():
            records.append({"figure": figure, "start": start, "takeoff": rounded(takeoff), **about, "run_height": mean["height"]})
            tasks |= {(figure, start, path): task for path, task in single_tasks(jump_base(name, changes, 20), takeoff, end).items()}
    flown = grains.run_all(tasks)
    for record in records:
        record["paths"] = {path: row for (figure, start, path), row in flown.items() if (figure, start) == (record["figure"], record["start"])}
    return records


# Distributions, forces, spin that is prescribed, spreading


RUN_A: dict[str, tuple[float | None, str]] = {  # how Run A may be read: share kept, None for each Set's own, and the roughness of R1
    "own f, R1 by (3-5)": (None, "R1"),
    "f = 0.89, R1 by (3-5)": (0.89, "R1"),
    "own f, R1 uniform ±30°": (None, "R1_uniform"),
    "f = 0.89, R1 uniform ±30°": (0.89, "R1_uniform"),
}
PRINTED, ALIKE, UNIFORM = list(RUN_A)[:3]  # as Tables 3-3 and 3-4 have it; one f for all Sets; R1 as section 3.4.2 has it


def run_a(reading: str) -> list[tuple[dict[str, Any], Scene]]:
    """The 32 runs of Run A in one of its readings."""
    retention, roughness = RUN_A[reading]
    return [(labels, scene.changed(bed={"roughness": roughness})) for labels, scene in thesis.thesis(retention) if labels["run"] == "A"]


def thesis_runs() -> dict[str, Content]:
    """Run A in every reading and Runs B, C and G with Set 2 at R_p 73, T 1.87, from the campaign."""
    pairs = [(reading, pair) for reading in RUN_A for pair in run_a(reading)]
    pairs += [(pair[0]["run"], pair) for pair in thesis.thesis() if pair[0]["run"] in "BCG"]
    wanted = {"set": 2, "particle_reynolds": 73.0, "stage": 1.87}
    return {name: scene.model_dump(mode="json", exclude_none=True) for name, (labels, scene) in pairs if wanted.items() <= labels.items()}


def other_tasks(jumps: int, long: int) -> Tasks:
    """What single figures need."""
    tasks: Tasks = {}
    runs = thesis_runs()
    for name, content in runs.items():
        tasks["heights", name] = Task(changed(content, run={"jumps": jumps + 20, "discard": 20, "trajectory": False}), "heights")
    sand = base("sand", jumps)
    paths = changed(sand, run={"trajectory": True})
    tasks["forces", "sand"] = Task(paths, "forces")
    for stage in (1.5, 2.0, 2.5, 3.0, 4.0):
        for law in ("prescribed", "yamamoto"):
            shorter = {"jumps": jumps // 2 + 20, "discard": 20}
            tasks["magnus", stage, law] = Task(changed(paths, channel={"transport_stage": stage}, rotation={"law": law}, run=shorter), "forces")
    for stage in (1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.5, 4.0, 4.5, 5.0):
        at = {"run": {"jumps": jumps + 20, "discard": 20, "trajectory": False}, "channel": {"transport_stage": stage}}
        prescribed = changed(runs[PRINTED], **at)
        tasks["saturation", stage, "Run A: spin prescribed (3-6)"] = Task(prescribed)
        tasks["saturation", stage, "Run A with f = 0.89"] = Task(changed(runs[ALIKE], **at))
        for name, effect in (("Magnus", "magnus"), ("lift", "lift"), ("history", "history"), ("added mass", "added_mass")):
            tasks["saturation", stage, f"Run A without {name}"] = Task(changed(prescribed, without=(effect,)))
        tasks["saturation", stage, "Run G: spin computed (3-4)"] = Task(changed(sand, channel={"transport_stage": stage}))
    tasks["diffusion", "sand"] = Task(changed(paths, run={"jumps": long + 20}), "spread")
    for figure, name, changes, _ in JUMPS:
        tasks["single", figure] = Task(jump_base(name, changes, jumps))
    return tasks


def magnus(found: Found) -> list[dict[str, Any]]:
    """The Magnus force's share up over the phase of the mean jump, thesis fig. 3-16."""
    records = []
    for key, row in found.items():
        if key[0] == "magnus":
            frame = pd.DataFrame(row["phase"])
            share = grains.plots.shares(frame, "z")["magnus"]
            records.append(
                {
                    "stage": key[1],
                    "law": key[2],
                    "phase": row["phase"]["phase"],
                    "share": rounded(share.to_numpy(), 4),
                    "mean": rounded(float(share.abs().mean())),
                }
            )
    return records


def overlap(table: pd.DataFrame, measured: tuple[str, int], model: tuple[str, int]) -> dict[str, Any]:
    """The areas of thesis fig. 3-8 between two models of ours, the first in the place of measurements, which are not at hand."""
    bands = {}
    for letter, number in (measured, model):
        rows = table[(table["run"] == letter) & (table["set"] == number) & (table["particle_reynolds"] == 73.0)]
        parts = [pd.DataFrame({"variable": name, "T": rows["stage"], "mean": rows[name], "sd": rows[f"{name}_sd"]}) for name in QUANTITIES]
        bands[f"{letter}{number}"] = pd.concat(parts, ignore_index=True)
    first, second = bands.values()
    areas = statistics.overlap_areas(first, second)
    return {"areas": rounded(areas.to_dict()), "bands": {name: rounded(band.to_dict("records")) for name, band in bands.items()}}


def thesis_campaign(full: bool) -> dict[str, Any]:
    """Runs A–H × Sets 1–4 over both grain sizes, and Run A in all its readings, judged by the regressions; without --full at two stages per size."""
    pairs = [({**labels, "reading": "all"}, scene) for labels, scene in thesis.thesis()]
    pairs += [({**labels, "reading": reading}, scene) for reading in RUN_A for labels, scene in run_a(reading)]
    if not full:
        pairs = [(labels, scene) for labels, scene in pairs if labels["stage"] in (1.87, 2.67, 3.08, 3.85)]
    found = saltation.campaign(pairs)
    table = found[found["reading"] == "all"]
    columns = ["run", "set", "particle_reynolds", "stage", "restitution", "f", "f_is", "status", "jumps", "clipped", "creeping"]
    columns += [f"{name}{suffix}" for name in QUANTITIES for suffix in ("", "_sd", "_se")]
    readings = {reading: found[found["reading"] == reading] for reading in RUN_A}
    return {
        "runs": rounded(table[columns].to_dict("records")),
        "judged": rounded(thesis.judge(table).to_dict("records")),
        "run_a": {
            reading: {"runs": rounded(own[columns].to_dict("records")), "judged": rounded(thesis.judge(own).to_dict("records"))}
            for reading, own in readings.items()
        },
        "overlap": overlap(table, ("E", 2), ("G", 2)),
    }


def run(full: bool) -> dict[str, Any]:
    """Everything the page on saltation needs."""
    jumps = COUNTED if full else COUNTED_SHORT
    tasks = memory_tasks(jumps) | grid_tasks(jumps) | modification_tasks(jumps) | other_tasks(jumps, 2000 if full else 600)
    found = grains.run_all(tasks)
    saturation = [{"stage": key[1], "name": key[2], **kept(row, ("spin",))} for key, row in found.items() if key[0] == "saturation"]
    return {
        "counted": jumps,
        "memory": memory(found),
        "grid": grid(found),
        "effects": effects(found),
        "single": single(found),
        "heights": {key[1]: kept(row, ("creeping", "clipped", "heights")) for key, row in found.items() if key[0] == "heights"},
        "forces": found["forces", "sand"],
        "magnus": magnus(found),
        "saturation": saturation,
        "diffusion": found["diffusion", "sand"],
        "campaign": thesis_campaign(full),
    }
