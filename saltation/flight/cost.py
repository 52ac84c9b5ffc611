"""Estimated cost of a scene, by which work is divided among workers."""

from __future__ import annotations

from typing import Any

from saltation.scene import Scene

CHUNK = 4000  # jumps that a worker gets at a time, about half a second
FIXED_STEP_COST = 50  # of a jump at fixed steps, in jumps by collocation
FLIGHT = 1.5  # d/u*: typical duration of a jump


def cost_of(scene: Scene) -> float:
    """About how many jumps' worth of time a scene takes."""
    each = 1 if scene.solver.method == "collocation" else FIXED_STEP_COST
    if scene.cloud is not None:
        return float(scene.cloud.number * scene.end / FLIGHT * each)
    if scene.run.jumps is None:
        return CHUNK
    return float(scene.run.jumps * each)


def form_of(scene: Scene) -> Any:
    """What is compiled for a scene: words choose types, numbers are data."""
    words = tuple(tuple(value for _, value in scene.options(name) if isinstance(value, str)) for name in scene.names)
    bed = (scene.bed.rebound, scene.bed.roughness) if scene.bed is not None else None
    return scene.names, words, scene.in_plane, scene.channel is None, scene.cloud is None, bed, scene.solver.method
