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
FARTHEST = 1e6  # half widths from the state to where the surface is looked for
SWINGS = 16  # explicit steps that show whether the state is thrown back and forth


@dataclass(frozen=True)
class Surface:
    """Where `fun` jumps, sought from the state along `half`: half the width of the layer, in the direction of the jump."""

    half: Floats

    def located(self, rate: Rate, t: float, y: Floats) -> tuple[float, Floats, Floats] | None:
        """(x, rates on either side) where the surface is at y + x·half; None without a jump."""
        reach = 2.0
        while reach < FARTHEST:
            low, high, first = -reach, reach, rate(t, y - reach * self.half)
            size = float((rate(t, y + reach * self.half) - first) @ self.half)
            if size != 0.0:
                while high - low > 1e-9 * reach:
                    middle = 0.5 * (low + high)
                    if float((rate(t, y + middle * self.half) - first) @ self.half) / size < 0.5:
                        low = middle
                    else:
                        high = middle
                before, after = rate(t, y + (low - 0.25) * self.half), rate(t, y + (high + 0.25) * self.half)
                if abs(float((after - before) @ self.half)) > 0.5 * abs(size):
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


def swings(velocity: Rate, t: float, y: Floats, step: float) -> Floats | None:
    """The jump of the rate if explicit steps lead from one side to the other and back, else None."""
    rates = []
    for _ in range(SWINGS):
        rates.append(velocity(t, y))
        y = y + step * rates[-1]
    found = np.array(rates[1:]) - rates[1]
    jump = found[int(np.argmax((found**2).sum(axis=1)))]
    over = found @ jump > 0.5 * (jump @ jump)
    return jump if jump.any() and not over[int(np.argmax(over)) :].all() else None
