"""Sliding along a surface where `fun` is discontinuous and both sides point into it, as under sticking Coulomb friction.

The rate there is the mean of both sides that keeps the state on the surface (Filippov 1988, Differential Equations with
Discontinuous Righthand Sides, § 4). Its weight is taken as linear in the distance from the surface, over a layer thinner than
the tolerance: the implicit stages then find it, history included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from basset.kernels import Floats

Rate = Callable[[float, Floats], Floats]

WIDTH = 0.1  # of the layer on either side, in tolerances
FARTHEST = 1e8  # half widths from the state to where the surface is looked for
SWINGS = 16  # explicit steps that show whether the state is thrown back and forth


@dataclass(frozen=True)
class Surface:
    """Where `fun` jumps by about `jump`, sought from the state along `half`: on a layer half its width, in the direction of the jump."""

    half: Floats
    jump: Floats
    last: list[float] = field(default_factory=lambda: [math.nan])  # where it was found, in the state that moves most along `half`

    def located(self, rate: Rate, t: float, y: Floats) -> tuple[float, Floats, Floats] | None:
        """(x, rates on either side) where the surface is at y + x·half; None without a jump."""
        widest = int(np.argmax(np.abs(self.half)))
        fine = float(np.spacing(abs(y[widest])) / abs(self.half[widest]))
        beside = max(1e-3, 4.0 * fine)  # not on the surface: sign(0) is neither side's

        def along(x: float) -> float:
            return float(rate(t, y + x * self.half) @ self.jump)

        def between(low: float, high: float, first: float, size: float) -> tuple[float, Floats, Floats] | None:
            """The jump within [low, high], at whose ends the rates along it are `first` and by `size` more."""
            least = 1e-15 * max(2.0, abs(low), abs(high))
            while high - low > least:
                middle = 0.5 * (low + high)
                if y[widest] + middle * self.half[widest] in (y[widest] + low * self.half[widest], y[widest] + high * self.half[widest]):
                    break
                if (along(middle) - first) / size < 0.5:
                    low = middle
                else:
                    high = middle
            before, after = rate(t, y + (low - beside) * self.half), rate(t, y + (high + beside) * self.half)
            if not abs(float((after - before) @ self.jump)) > 0.5 * abs(size):
                return None
            self.last[0] = float(y[widest] + 0.5 * (low + high) * self.half[widest])
            return 0.5 * (low + high), before, after

        guess = (self.last[0] - float(y[widest])) / float(self.half[widest])
        if abs(guess) < FARTHEST:  # most often it is where it was
            for width in (8.0 * max(1e-15 * max(2.0, abs(guess)), fine), 1e-6, 1e-2):
                first = along(guess - width)
                size = along(guess + width) - first
                if abs(size) > 0.5 * float(self.jump @ self.jump):
                    found = between(guess - width, guess + width, first, size)
                    if found is not None:
                        return found
        reach = 2.0
        while reach < FARTHEST:
            first = along(-reach)
            size = along(reach) - first
            if size != 0.0:
                found = between(-reach, reach, first, size)
                if found is not None:
                    return found
            reach *= 16.0
        return None

    def holds(self, rate: Rate, t: float, y: Floats) -> bool:
        """Whether both weights are from 0 to 1."""
        found = self.located(rate, t, y)
        return found is not None and abs(found[0]) <= 1.0


def combined(here: Floats, sides: Sequence[tuple[Floats, Floats]], places: Sequence[float]) -> Floats:
    """The rate `here` with, along each jump, the mean of both sides for a surface at that place: beyond the layer extrapolated."""
    result = here.copy()
    for (before, after), place in zip(sides, places, strict=True):
        jump = after - before
        result += (before + 0.5 * (1.0 - place) * jump - here) @ jump / (jump @ jump) * jump
    return result


def mean(surfaces: Sequence[Surface], rate: Rate, t: float, y: Floats) -> Floats:
    """The rate in the layers of `surfaces`."""
    found = [place for place in (surface.located(rate, t, y) for surface in surfaces) if place is not None]
    return combined(rate(t, y), [(before, after) for _, before, after in found], [place for place, *_ in found])


def balanced(surfaces: Sequence[Surface], rate: Rate, pull: Floats, t: float, y: Floats) -> Floats:
    """The state moved within the layers to where it stays, under `pull` beside the rate; unchanged where that cannot be determined.

    How fast it moves through each layer is linear in its places in all of them.
    """
    found = [surface.located(rate, t, y) for surface in surfaces]
    step = 1e2 * max(float(np.abs(surface.half).max() / np.abs(surface.jump).max()) for surface in surfaces)
    here, places = rate(t, y), np.array([0.0 if place is None else place[0] for place in found])
    sides = [(place[1], place[2]) for place in found if place is not None]
    drifts = np.empty((len(surfaces) + 1, len(surfaces)))
    for row, tried in zip(drifts, np.eye(len(surfaces) + 1, len(surfaces), -1), strict=True):
        moved = y + step * (combined(here, sides, tried.tolist()) + pull) if len(sides) == len(surfaces) else y
        ahead = [surface.located(rate, t + step, moved) for surface in surfaces]
        row[:] = [math.nan if place is None else place[0] for place in ahead] - places
    if not np.isfinite(drifts).all() or np.linalg.matrix_rank(drifts[1:] - drifts[0]) < len(surfaces):
        return y
    wanted = np.clip(np.linalg.solve((drifts[1:] - drifts[0]).T, -drifts[0]), -1.0, 1.0)
    return np.asarray(y + (places - wanted) @ np.array([surface.half for surface in surfaces]))


def swings(velocity: Rate, t: float, y: Floats, step: float, kept: Callable[[Floats], Floats]) -> tuple[Floats, bool]:
    """(largest change of the rate over some explicit steps, whether they lead back from there).

    `kept` moves a state back to where it was in the layers of surfaces it slides along: explicit steps would be too long for those.
    """
    rates = [velocity(t, y)]
    while len(rates) < SWINGS and np.abs(rates[-1]).max() <= 1e3 * np.abs(rates[0]).max():  # beyond, the steps diverge
        y = kept(y + step * rates[-1])
        rates.append(velocity(t, y))
    jump = np.zeros_like(y)
    for first in (rates[1], rates[0]) if len(rates) == SWINGS else ():  # the start may lie on the surface itself
        found = np.array(rates[1:]) - first
        jump = found[int(np.argmax(np.abs(found).max(axis=1)))]
        over = found @ jump > 0.5 * (jump @ jump)
        if jump.any() and not over[int(np.argmax(over)) :].all():
            return jump, True
    return jump, False
