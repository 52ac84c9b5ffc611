"""What a grain of a scene meets before anything is flown: its settling, a typical jump, and the numbers by which closures are judged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from saltation import regressions
from saltation.effects.base import Situation
from saltation.effects.drag import LAWS
from saltation.effects.rotation import prescribed_spin
from saltation.flow import velocity_and_shear
from saltation.scene.tables import SceneError

__all__ = ["Typical", "conditions", "settling_velocity", "situations", "typical"]

PHASES = ((0.0, 0.25), (0.5, 1.0), (1.0, 0.25))  # of a jump: share of its time, share of its height
WEIGHTS = (1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0)  # of them in a mean over time: Simpson's


@dataclass(frozen=True)
class Typical:
    """A typical jump."""

    height: float  # d
    duration: float  # d/V
    rise: float  # V, at takeoff, upwards
    speed: float  # V, mean along the stream
    spin: float  # V/d


def typical(scene: Any) -> Typical:
    """The jump that the means of `saltation.regressions` give at the scene's R_p and T (at least T = 1.2); in still water one diameter high."""
    numbers = scene.numbers
    if not math.isfinite(numbers.shields):
        raise SceneError(f"grain.density must differ from the fluid's for a typical jump, got {scene.grain.density:g} kg/m3 for both")
    height, speed, spin = 1.0, 0.0, 0.0
    if numbers.stage is not None:
        stage = max(numbers.stage, 1.2)
        found = [regression(numbers.particle_reynolds, stage) for regression in regressions.REGRESSIONS.values()]
        height, speed = (float(np.mean([getattr(jump, name) for jump in found])) for name in ("height", "speed"))
        spin = max(1.0, prescribed_spin(stage))
    fall = numbers.alpha / abs(numbers.shields)
    rise = math.sqrt(2.0 * fall * height)
    return Typical(height, 2.0 * rise / fall, rise, speed, spin)


def situations(scene: Any, jump: Typical) -> list[Situation]:
    """The grain early, at the top and late in its typical jump."""
    found = []
    for when, where in PHASES:
        z = 0.75 + where * jump.height
        stream, shear = velocity_and_shear(scene.profile, z)
        found.append(Situation(z, jump.speed - stream, 0.0, jump.rise * (1.0 - 2.0 * when), stream, shear, 0.0, jump.spin, 0.0))
    return found


def settling_velocity(scene: Any) -> float | None:
    """Terminal velocity in still water, m/s: drag balances weight, thesis (3-1); None without weight or drag, or for a grain that does not sink."""
    n = scene.numbers
    if not {"weight", "drag"} <= set(scene.names) or n.density_ratio <= 1.0:
        return None
    factor = LAWS[scene.options("drag").law].factor

    def excess(logarithm: float) -> float:  # of the drag over the weight at a speed in V
        speed = math.exp(logarithm)
        return float(18.0 / n.reynolds * factor(speed * n.reynolds) * speed * n.shields - 1.0)

    low, high = -40.0, 40.0
    while low < (middle := 0.5 * (low + high)) < high:  # to the last bit; scipy.optimize takes a quarter of a second to import
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return float(math.exp(low) * n.velocity)


def conditions(scene: Any) -> dict[str, float]:
    """The numbers of `saltation.closures.NUMBERS` that a scene has: root mean squares over a typical jump, in still water of a grain that settles.

    >>> from saltation.scene import load
    >>> {name: round(value, 1) for name, value in conditions(load("sand")).items() if name in ("Re_p", "T")}
    {'T': 1.9, 'Re_p': 80.0}
    """
    n = scene.numbers
    found = {"R_p": n.particle_reynolds} | ({"T": n.stage} if n.stage is not None else {})
    if not math.isfinite(n.shields):
        return found
    jump = typical(scene)
    slip, spin, shear, impact = jump.rise, 0.0, 0.0, jump.rise
    if n.stage is not None:
        met = situations(scene, jump)
        slip, spin, shear = (
            math.sqrt(sum(w * square for w, square in zip(WEIGHTS, squares, strict=True)))
            for squares in (
                [s.slip_x**2 + s.slip_y**2 + s.slip_z**2 for s in met],
                [s.spin_x**2 + (s.spin_y - 0.5 * s.shear) ** 2 + s.spin_z**2 for s in met],
                [s.shear**2 for s in met],
            )
        )
    else:
        settling = settling_velocity(scene)
        if settling is not None:
            slip = impact = settling / n.velocity
        spin = math.hypot(*(scene.start.spin or (0.0,))) * n.time
    if scene.bed is not None:
        found |= {"St": n.stokes(impact), "gap": 0.5 * jump.height}
    found |= {"Re_p": slip * n.reynolds, "Re_r": spin * n.reynolds, "Re_r/Re_p": spin / slip, "shear": shear / slip}
    return found | {"√Re_G/Re_p": math.sqrt(shear / n.reynolds) / slip}
