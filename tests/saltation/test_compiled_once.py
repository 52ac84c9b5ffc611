"""What steps is compiled once: another scene compiles its rates and its rebound, counted in events of the compiler."""

import numba
import pytest
from compilations import Compilations
from scene_cases import scene

import saltation
from saltation.flight.setup import Engine
from saltation.front import warm

SETS = (
    {"effects": ["weight", "drag"], "history": None, "dimensions": 2},
    {"effects": ["weight", "drag", "lift", "magnus"], "history": None},
    {"effects": ["weight", "drag", "added_mass", "lift", "history", "magnus", "rotation"]},
    {"effects": ["weight", "drag", "history"], "bed": {"rebound": "sliding_only", "roughness": "R2"}},
    {"effects": ["weight", "lift", "magnus", "wall"], "history": None, "lift": {"law": "loth"}, "magnus": {"law": "oesterle_bui_dinh"}},
)


@pytest.mark.parametrize("solver", [{}, {"method": "fixed_step", "dt": 0.01}], ids=["graded", "fixed"])
@pytest.mark.parametrize("changes", SETS, ids=lambda changes: "-".join(changes["effects"][2:]) or "drag")
def test_another_set_of_effects_compiles_no_step(changes, solver):
    short = {"solver": solver, "run": {"jumps": 1, "discard": 0}}
    saltation.run(scene("sand", **short))
    made = scene("sand", **short, **changes)
    with numba.core.event.install_listener("numba:compile", found := Compilations()):
        warm(made)
    steps = {"march", "attempted", "solved_diagonally", "accepted", "truncated", "landed", "looked", "checked", "flown", "truncate_memory", "steps", "newton"}
    assert not steps & set(found.names)


def test_all_scenes_have_one_type_of_loop():
    kinds = {
        tuple(numba.typeof(getattr(engine, name)) for name in ("model", "bed", "limits", "problem", "following", "truncation"))
        for engine in (Engine(scene("sand", **changes)) for changes in SETS)
    }
    assert len(kinds) == 1
