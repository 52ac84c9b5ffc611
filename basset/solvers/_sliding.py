"""Sliding along a surface where `fun` jumps and both sides point into it, as under Coulomb friction that sticks.

The rate there is the mean of both sides that keeps the state on the surface (Filippov 1988, Differential Equations with
Discontinuous Righthand Sides, § 4). Its weight is taken as linear in the distance from the surface, over a layer thinner than
the tolerance: the implicit stages then find it, history included.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

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

    def located(self, rate: Rate, t: float, y: Floats) -> tuple[float, Floats, Floats] | None:
        """(x, rates on either side) where the surface is at y + x·half; None without a jump."""
        reach, widest = 2.0, int(np.argmax(np.abs(self.half)))
        beside = max(1e-3, 4.0 * float(np.spacing(abs(y[widest])) / abs(self.half[widest])))  # not on the surface: sign(0) is neither side's
        while reach < FARTHEST:
            low, high, first = -reach, reach, rate(t, y - reach * self.half)
            size = float((rate(t, y + reach * self.half) - first) @ self.jump)
            if size != 0.0:
                while high - low > 1e-15 * reach:
                    middle = 0.5 * (low + high)
                    if y[widest] + middle * self.half[widest] in (y[widest] + low * self.half[widest], y[widest] + high * self.half[widest]):
                        break
                    if float((rate(t, y + middle * self.half) - first) @ self.jump) / size < 0.5:
                        low = middle
                    else:
                        high = middle
                before, after = rate(t, y + (low - beside) * self.half), rate(t, y + (high + beside) * self.half)
                if abs(float((after - before) @ self.jump)) > 0.5 * abs(size):
                    return 0.5 * (low + high), before, after
            reach *= 16.0
        return None

    def holds(self, rate: Rate, t: float, y: Floats) -> bool:
        """Whether both weights are from 0 to 1."""
        found = self.located(rate, t, y)
        return found is not None and abs(found[0]) <= 1.0


def mean(surfaces: Sequence[Surface], rate: Rate, t: float, y: Floats) -> Floats:
    """The rate in the layers of `surfaces`: along each jump the weighted mean of both sides, beyond the layer extrapolated."""
    here = rate(t, y)
    result = here.copy()
    for surface in surfaces:
        found = surface.located(rate, t, y)
        if found is not None:
            place, before, after = found
            jump = after - before
            result += (before + 0.5 * (1.0 - place) * jump - here) @ jump / (jump @ jump) * jump
    return result


def swings(velocity: Rate, t: float, y: Floats, step: float) -> tuple[Floats, bool]:
    """(largest change of the rate over some explicit steps, whether they lead back from there)."""
    rates = [velocity(t, y)]
    while len(rates) < SWINGS and np.abs(rates[-1]).max() <= 1e3 * np.abs(rates[0]).max():  # beyond, the steps diverge
        y = y + step * rates[-1]
        rates.append(velocity(t, y))
    jump = np.zeros_like(y)
    for first in (rates[1], rates[0]) if len(rates) == SWINGS else ():  # the start may lie on the surface itself
        found = np.array(rates[1:]) - first
        jump = found[int(np.argmax(np.abs(found).max(axis=1)))]
        over = found @ jump > 0.5 * (jump @ jump)
        if jump.any() and not over[int(np.argmax(over)) :].all():
            return jump, True
    return jump, False
