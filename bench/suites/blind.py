"""With laws chosen by their ranges alone, how many mean jumps lie where the regressions of measurements have them?

The blind part flies the closures that `saltation.scene.valid.chosen` names, and nothing else, then the same in a turbulent stream. What follows changes them
one at a time, after the fact: no default follows from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench import grains
from bench.grains import QUANTITIES, Task, base, changed, rounded
from bench.suites.saltation import COUNTED, COUNTED_SHORT, SCENES, STAGES, kept
from saltation import regressions
from saltation.scene import scene_of
from saltation.scene.valid import chosen, families, taken
from saltation.study.turbulence import DEPTH, ENTRAINMENT

CHOSEN, THESIS, TURBULENT = "chosen by range", "the thesis's", "with turbulence"
SEEDS = (1, 2, 3)

Content = dict[str, Any]


def valid(content: Content) -> Content:
    """A scene with the laws that its ranges choose, written out: what it says of them itself is left out first."""
    bare = changed(content, defaults="valid")
    for family, closures in families(scene_of(content)).items():
        table = bare.get(family.partition(".")[0], {})
        for field in {field for closure in closures.values() for field in closure.take}:
            table.pop(field, None)
    return {**scene_of(bare).model_dump(mode="json", exclude_none=True), "defaults": "thesis"}


def turbulent(content: Content) -> Content:
    """The scene in a turbulent stream of the study's depth; grains that it brings to rest are picked up again."""
    own = changed(content, channel={"depth": DEPTH}, rests={"entrainment": ENTRAINMENT})
    return own | {"effects": [*own["effects"], "turbulence"]}


def single_changes(content: Content) -> dict[str, Content]:
    """Every other law of each family, every treatment of the history force, and the other open choices, one at a time."""
    scene, found = scene_of(content), dict[str, Content]()
    for family, closures in families(scene).items():
        table = family.partition(".")[0]
        own = taken(scene, table, closures)
        fields = {field for closure in closures.values() for field in closure.take}
        for name, closure in closures.items():
            if name != own:
                bare = {**content, table: {field: value for field, value in content.get(table, {}).items() if field not in fields and field != "stokes_decay"}}
                found[f"{table}: {name}"] = changed(bare, **{table: closure.take})
    for rebound, more in (("restart", {}), ("reset", {}), ("none", {"window_jumps": 1})):
        found[f"history.rebound: {rebound}"] = changed(content, history={"rebound": rebound, **more})
    found["bed.restitution: 0.97 exp(−35/St)"] = changed(content, bed={"restitution": "stokes", "stokes_decay": 35.0})
    for restitution, friction in ((0.8, 0.4), (0.95, 0.3)):  # the thesis's Sets 3 and 4
        bare = {**content, "bed": {name: value for name, value in content["bed"].items() if name != "stokes_decay"}}
        found[f"bed: e = {restitution}, f = {friction}"] = changed(bare, bed={"restitution": restitution, "friction": friction})
    found |= {f"channel.profile: {name}": changed(content, channel={"profile": name}) for name in ("yalin", "constant_b")}
    found["channel.roughness_height: 2 d"] = changed(content, channel={"roughness_height": 2.0 * content["grain"]["diameter"]})
    found |= {f"bed.reading: {name}": changed(content, bed={"reading": name}) for name in ("reject", "spheres")}
    found["bed.contact_mass: immersed"] = changed(content, bed={"contact_mass": "immersed"})
    found["magnus.form: vector"] = changed(content, magnus={"form": "vector"})
    found["added_mass.form: auton"] = changed(content, added_mass={"form": "auton"})
    found |= {f"without {name}": changed(content, without=(name,)) for name in ("magnus", "lift", "history", "rotation")}
    return found


def tasks(jumps: int, full: bool) -> dict[Any, Task]:
    """The scene as its ranges choose it, with turbulence, as the thesis has it, and with single changes, at every stage."""
    found: dict[Any, Task] = {}
    for size, stages in STAGES.items():
        for stage in stages:
            content = changed(base(SCENES[size], jumps), channel={"transport_stage": stage})
            own = valid(content)
            for seed in SEEDS if full else SEEDS[:1]:
                found[CHOSEN, size, stage, seed] = Task(changed(own, run={"seed": seed}))
                found[TURBULENT, size, stage, seed] = Task(changed(turbulent(own), run={"seed": seed}))
                found[THESIS, size, stage, seed] = Task(changed(content, run={"seed": seed}))
            found |= {(name, size, stage, SEEDS[0]): Task(scene) for name, scene in single_changes(own).items()}
    return found


def inside(row: Mapping[str, Any], size: int, stage: float) -> list[str]:
    """The quantities whose means lie within the envelope of the regressions."""
    envelope = regressions.envelope(scene_of(base(SCENES[size], 1)).numbers.particle_reynolds, stage)
    edges = {"height": envelope["height"], "length": envelope["length"], "velocity": envelope["speed"]}
    return [name for name in QUANTITIES if row[name]["mean"] is not None and edges[name][0] <= row[name]["mean"] <= edges[name][1]]


def run(full: bool) -> dict[str, Any]:
    """Means at every stage, blind and after the fact."""
    jumps = COUNTED if full else COUNTED_SHORT
    flown = grains.run_all(tasks(jumps, full))
    rows = [
        {
            "name": name, "particle_reynolds": size, "stage": stage, "seed": seed, "inside": inside(row, size, stage),
            **kept(row, ("spin", "bed_load") if "bed_load" in row else ("spin",)),
        }
        for (name, size, stage, seed), row in flown.items()
    ]  # fmt: skip
    laws, envelopes = [], []
    for size, stages in STAGES.items():
        for stage in stages:
            scene = scene_of(changed(base(SCENES[size], 1), channel={"transport_stage": stage}))
            laws.append({"particle_reynolds": size, "stage": stage, "laws": chosen(scene)})
            edges = regressions.envelope(scene.numbers.particle_reynolds, stage)
            envelopes.append({"particle_reynolds": size, "stage": stage, **rounded({name: [float(edge) for edge in pair] for name, pair in edges.items()})})
    return {"counted": jumps, "seeds": len(SEEDS if full else SEEDS[:1]), "laws": laws, "envelopes": envelopes, "rows": rows}
