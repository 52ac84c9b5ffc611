"""What the thesis found beside what is found here, and what of it contradicts itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.suites.saltation import ALIKE, PRINTED
from reports.saltation.effects import single_of
from reports.saltation.impacts import IGNORING, shortening
from reports.saltation.jumps import GROWING, PRESCRIBED, exponent, forces, magnus_share, peak, spin_offsets
from reports.saltation.ranks import CREEP, best_at, last_of, models, slow_runs
from reports.saltation.records import grid, percent, ratio, share
from reports.site.page import fill
from reports.words import Record, of, signed, span
from saltation.effects.drag import LAWS
from saltation.scene import load
from saltation.scene.conditions import settling_velocity


def predictors() -> dict[str, str]:
    """By how many per cent Rubey's drag coefficient exceeds Yen's at Re 100, and his settling velocity falls short of Yen's at R_p 73."""
    rubey, yen = (LAWS[name].factor(100.0) for name in ("rubey", "yen"))
    sand = load("sand")
    slow, fast = (settling_velocity(sand.changed(drag={"law": name})) for name in ("rubey", "yen"))
    assert slow is not None and fast is not None
    return {"drag_apart": f"{100.0 * (rubey / yen - 1.0):.0f}", "fall_apart": f"{100.0 * (1.0 - slow / fast):.0f}"}


def of_jumps(data: Record) -> dict[str, Any]:
    """History, Magnus and single jumps."""
    return {
        "sand": {name.replace(" ", "_"): path["height"] for name, path in single_of(data, "3-6", 0)["paths"].items()},
        "gravel": {name.replace(" ", "_"): path["height"] for name, path in single_of(data, "3-5", 0)["paths"].items()},
        "without_history": {scene: percent(ratio(data, scene, "history")) for scene in ("sand", "gravel")},
        "ignored": span([-x for x in shortening(data, 73, IGNORING)]),
        "gravel_magnus": 1.0 / ratio(data, "gravel", "Magnus"),
        "reynolds": data["grid"]["gravel"]["reynolds"],
    }


def of_models(data: Record) -> dict[str, Any]:
    """The models, spin and angles."""
    creeping = {run: row["creeping"] for run, row in data["heights"].items()}
    upstream, uniform = ([100.0 * value for run, value in creeping.items() if run.endswith(end)] for end in ("(3-5)", "±30°"))
    shipped, ranked = data["grid"]["shipped"], [row["model"] for row in models(data)]
    runs = grid(data, shipped, 73)
    return {
        "slow": max(slow_runs(data, "BC", 73.0)),
        "sets": ", ".join(map(str, sorted({run["set"] for run in data["campaign"]["runs"]}))),
        "creeping_b": share(creeping["B"]),
        "creeping_c": share(creeping["C"]),
        "creep": CREEP,
        "upstream": span(upstream, "{:.1f}"),
        "uniform": span(uniform),
        "own_last": last_of(data, PRINTED),
        "alike_last": last_of(data, ALIKE),
        "place": ranked.index("G2") + 1,
        "models": len(ranked),
        "best": ranked[0],
        "best_73": best_at(data, 73),
        "best_250": best_at(data, 250),
        "corrected": share(max(map(abs, spin_offsets(data, shipped)))),
        "as_printed": span([-100.0 * x for x in spin_offsets(data, "torque without ρ/ρ_s")]),
        "first": runs[0],
        "last": runs[-1],
    }


def of_forces(data: Record) -> dict[str, Any]:
    """Forces, saturation and spreading."""
    (along, up), phase = forces(data), data["forces"]["phase"]
    history, drag, top = along["history"], up["drag"], int(np.argmax(phase["z"]))
    law, computed = magnus_share(data, "prescribed"), magnus_share(data, "yamamoto")
    names = [name for name in dict.fromkeys(run["name"] for run in data["saturation"]) if name not in GROWING]
    crest, falling = peak(data, PRESCRIBED), [T for name in names if name.startswith("Run A without") and (T := peak(data, name)) is not None]
    return {
        "drag_along": along["drag"].max(),
        "drag_phase": phase["phase"][int(along["drag"].argmax())],
        "top_phase": phase["phase"][top],
        "history": [signed(history.iloc[k]) for k in (0, top, -1)],
        "turns": float(np.interp(0.0, -history.to_numpy(), phase["phase"])),
        "remainder": [signed(along["added_mass"].iloc[k]) for k in (0, -1)],
        "lift": [signed(up["lift"].iloc[k]) for k in (0, -1)],
        "weight": abs(up["weight"].iloc[len(up) // 2]),
        "drag_up": ", ".join(signed(drag.iloc[k]) for k in (0, len(up) // 2, -1)),
        "magnus_up": up["magnus"].max(),
        "low": min(law),
        "high": max(law),
        "law": [law[min(law)], law[max(law)]],
        "computed": [computed[min(law)], computed[max(law)]],
        "end": span([row["share"][-1] for row in of(data["magnus"], law="yamamoto")], "{:.1f}"),
        "crest": (f"H is greatest at T {crest:g} and falls beyond" if crest else "H rises to the last T")
        + (f", without lift, history or added mass at T {span(falling, '{:g}')}" if len(falling) == 3 else ""),
        "rising": "it rises to the last T = 5: agrees" if all(peak(data, name) is None for name in GROWING) else "it has a peak, too",
        "gamma": {f"{axis}_{where}": exponent(data, axis, where) for axis in "xy" for where in ("local", "intermediate")},
    }


def fields(found: Record) -> dict[str, Any]:
    """What the page says of it."""
    return {"claims": fill("saltation.md", "claims", **of_jumps(found), **of_models(found), **of_forces(found)), **predictors()}
