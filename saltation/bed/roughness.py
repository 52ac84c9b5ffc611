"""Roughness of the bed: tilts θ_b (in the plane of motion) and α_b (across) of the contact plane.

Contact normal into the water (−sin θ_b cos α_b, −sin α_b, cos θ_b cos α_b), mirrored for a grain that moves upstream. The
grain's centre stands at cos θ_b cos α_b − depth above the bed level, depth = ¼: the bed level lies that far below the crests.

The touching-sphere relation r/d = ½ (cos θ_b − tan θ_in sin θ_b), thesis (3-5), is cos(θ_b + θ_in) = (2r/d) cos θ_in, and
the same across with α_in. r/d ∈ U(0, ½) gives θ_b from 0 to 90° − θ_in, not up to the 30° of the text; hence four ranges of
contact angles: `clip` (at 30°), `reject` (drawn again beyond 30°), `literal` (as it comes), `spheres` (what a path can really touch, lee
side included: grains slide).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

from basset._compile import shared
from saltation._random import Draws
from saltation.grain import Triple

__all__ = ["Roughness", "angles", "contact_plane"]

STEEPEST = math.radians(30.0)
TILT = math.radians(4.0)
READINGS = ("clip", "reject", "literal", "spheres")
CLIP, REJECT, LITERAL, SPHERES = range(4)


@shared
def offset(angle: float, incidence: float) -> float:
    """2r/d of the contact at `angle` for an incidence angle, thesis (3-5)."""
    return math.cos(angle) - math.tan(incidence) * math.sin(angle)


@shared
def touching(share: float, incidence: float, reading: int, least: float) -> tuple[float, float]:
    """(angle, whether clipped) from a uniform share of the offsets; `least` is the smallest 2r/d of the draw."""
    if math.cos(incidence) < 1e-12:
        return 0.0, 0.0
    if reading == SPHERES:
        # paths are spread evenly over one sphere, d sin θ_in across: from -30° on the lee side, or from where they graze
        # it, to the steepest place that the sphere before does not hide
        grazing = math.cos(max(0.0, incidence - STEEPEST))
        return math.acos(grazing - (1.0 - share) * math.sin(incidence)) - incidence, 0.0
    low = least
    if reading == REJECT:
        low = min(1.0, max(least, offset(STEEPEST, incidence)))
    angle = angle_of(low + (1.0 - low) * share, incidence)
    if reading == CLIP and angle > STEEPEST:
        return STEEPEST, 1.0
    return angle, 0.0


@shared
def bounded(share: float, incidence: float, reading: int, least: float) -> tuple[float, float]:
    """As `touching` with the range bounded by 30° (R6, R8): the upstream face, or as printed (steeper than 30° always)."""
    steep = min(1.0, max(least, offset(STEEPEST, incidence)))
    if reading == LITERAL:
        return touching(share, incidence, reading, least) if steep <= least else (angle_of(least + (steep - least) * share, incidence), 0.0)
    return touching(share, incidence, SPHERES if reading == SPHERES else REJECT, least)


@shared
def angle_of(twice: float, incidence: float) -> float:
    """The angle of the contact at 2r/d = `twice`."""
    return math.acos(min(1.0, twice * math.cos(incidence))) - incidence


@shared
def sided(angle: float, share: float, reading: int) -> float:
    """The angle across with the sign of r₂; of touching spheres both sides are drawn already."""
    return angle if share < 0.5 or reading == SPHERES else -angle


@shared
def truncated_normal(share: float, width: float, deviation: float) -> float:
    """The normal deviate within ±width that a uniform share stands for, by Newton's method on the distribution."""
    root = deviation * math.sqrt(2.0)
    whole = math.erf(width / root)
    target = (2.0 * share - 1.0) * whole
    x = 0.0  # the distribution bends away from its tangent here: every step stays short of the goal
    for _ in range(60):
        step = (math.erf(x) - target) * 0.5 * math.sqrt(math.pi) * math.exp(x * x)
        x -= step
        if abs(step) < 1e-14:
            break
    return x * root


LEVEL, TILTED, NORMAL, UNIFORM, SYMMETRIC, TOUCHING, BOUNDED = range(7)  # how an angle is drawn


class Roughness(NamedTuple):
    """How θ_b and α_b are drawn: numbers, not types, so that another sub-model compiles nothing anew.

    Thesis section 3.2.3; R1 García & Niño (1992), R2 Tsuji et al. (1987), R3 Sommerfeld (1992).
    """

    along: int  # how θ_b is drawn: LEVEL, TILTED, NORMAL, UNIFORM, SYMMETRIC, TOUCHING or BOUNDED
    side: int  # how α_b is
    reading: int  # range of contact angles, place in `READINGS`
    least: float  # smallest 2r/d of a draw
    scatter: float  # factor of α_b: 1, or 0 for none across the stream
    depth: float  # d, of the bed level below a centre in contact with an untilted bed, plus ½


def faces_downstream(roughness: Roughness) -> bool:
    """Whether contact planes may lean with the motion: a grain then meets them a second time close after the first."""
    return roughness.along in (TILTED, NORMAL, SYMMETRIC) or (roughness.reading == SPHERES and roughness.along in (TOUCHING, BOUNDED))


@shared
def drawn(how: int, share: float, incidence: float, reading: int, least: float) -> tuple[float, float]:
    """(angle, whether clipped) of one plane; uniform angles from 0 to 30°, symmetric ones within ±30°."""
    if how == LEVEL:
        return 0.0, 0.0
    if how == TILTED:
        return TILT * (2.0 * share - 1.0), 0.0
    if how == NORMAL:
        return truncated_normal(share, TILT, 0.5 * TILT), 0.0
    if how == UNIFORM:
        return STEEPEST * share, 0.0
    if how == SYMMETRIC:
        return STEEPEST * (2.0 * share - 1.0), 0.0
    if how == TOUCHING:
        return touching(share, incidence, reading, least)
    return bounded(share, incidence, reading, least)


@shared
def angles(roughness: Roughness, incidence: float, across: float, draws: Draws) -> Triple:
    """Tilts θ_b and α_b (radians) of the contact plane that a grain meets, and 1 where θ_b was clipped, else 0; thesis (3-5), section 3.2.3."""
    theta, clipped = drawn(roughness.along, draws[0], incidence, roughness.reading, roughness.least)
    alpha = drawn(roughness.side, draws[1], across, roughness.reading, roughness.least)[0]
    if roughness.side in (TOUCHING, BOUNDED):
        alpha = sided(alpha, draws[2], roughness.reading)
    return theta, roughness.scatter * alpha, clipped


ROUGHNESS: dict[str, Any] = {
    "flat": partial(Roughness, LEVEL, LEVEL),  # a smooth plane at the bed level
    "R1": partial(Roughness, TOUCHING, LEVEL),  # García & Niño (1992)
    "R1_uniform": partial(Roughness, SYMMETRIC, LEVEL),  # θ_b within ±30° whatever the incidence, as thesis section 3.4.2 says of R1
    "R2": partial(Roughness, TILTED, TILTED),  # Tsuji et al. (1987): uniform within ±4°; the thesis's chapter 2 swaps R2 and R3
    "R3": partial(Roughness, NORMAL, NORMAL),  # Sommerfeld (1992): normal within ±4° (standard deviation 2°, truncated)
    "R4": partial(Roughness, UNIFORM, SYMMETRIC),  # θ_b from 0 to 30°, α_b within ±30°; this and the rest: thesis section 3.2.3
    "R5": partial(Roughness, TOUCHING, TOUCHING),  # r₁ ∈ U(0, ½), r₂ ∈ U(−½, ½)
    "R6": partial(Roughness, BOUNDED, BOUNDED),  # the same, both ranges bounded by 30°
    "R7": partial(Roughness, TOUCHING, SYMMETRIC),
    "R8": partial(Roughness, BOUNDED, SYMMETRIC),
}
"""Sub-models by name: reading, least, scatter, depth -> Roughness."""


@shared
def contact_plane(roughness: Roughness, ux: float, uy: float, uz: float, draws: Draws) -> tuple[Triple, float, float, float]:
    """The contact plane that a grain meets: unit normal into the water, height of the centre in contact (d), θ_b (radians), 1 where it was clipped.

    Thesis (3-5), section 3.2.3.
    """
    incidence = math.atan2(max(0.0, -uz), abs(ux))
    across = math.atan2(max(0.0, -uz), abs(uy)) if uy != 0.0 else 0.5 * math.pi
    theta, alpha, clipped = angles(roughness, incidence, across, draws)
    x, y = -math.sin(theta) * math.cos(alpha), -math.sin(alpha)
    if ux < 0.0:
        x = -x
    if uy < 0.0:
        y = -y
    return (x, y, math.cos(theta) * math.cos(alpha)), math.cos(theta) * math.cos(alpha) - roughness.depth, theta, clipped
