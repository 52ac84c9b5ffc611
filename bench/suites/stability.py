"""Do fixed steps beyond the computed limit of stability ever end as a success, and those within it ever fail?

y' = −λ (y − cos ωt) − c·H[y], y(0) = 1: its solution stays within ±1, so what exceeds 1 is the step's. From drag alone to memory alone; with drag that is
there at the start, where too long a step is refused, and with drag that rises from nothing, where it is to be noticed on the way. Beside them whether the
recurrence of the steps, written down anew, grows.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

import basset
from basset._compile import compiler
from basset.kernels import Floats
from basset.solvers.stability import HELD_RATE, adams_moulton, bounds, held_factor

FORMS = ("rate", "slip", "held")
DISTANCES = (0.5, 0.9, 0.97, 1.03, 1.1, 2.0, 5.0)  # λ dt and c√dt over those at the computed limit
STEPS, SHORT, PERIOD = 3000, 1000, 300  # of a run, of a short one; of the cosine, in the first of which drag that rises does so


def following(t: float, y: Any, rate: float, rises: bool) -> Any:
    """−λ(t) (y − cos ωt), λ there from the start or rising to its value."""
    return -rate * (min(1.0, t / PERIOD) if rises else 1.0) * (y - math.cos(2.0 * math.pi * t / PERIOD))


@lru_cache(maxsize=1)
def compiled() -> Any:
    """It, compiled."""
    return compiler().njit(following)


@lru_cache(maxsize=16)
def weights(degree: int, steps: int) -> Floats:
    """Of Daitche's rule, unit step; as many as `steps` need."""
    return basset.Daitche(degree).weights(2 * steps, 1.0)[: steps + 1]


def grows(degree: int, form: str, drag: float, history: float, steps: int = 1500) -> bool:
    """Whether alternating samples of y' = −λy − c·H[y] grow in the end, λ dt = drag and c√dt = history."""
    w, a = weights(degree, steps), adams_moulton(degree)
    share = sum((-drag) ** k / math.factorial(k + 1) for k in range(4))
    factor = 1.0 - drag * share  # of Runge and Kutta
    y, rates, path = 1.0, np.zeros(steps), np.zeros(steps)
    for n in range(steps):
        tail = float(w[1 : n + 1] @ rates[n - 1 :: -1][:n]) if n else 1.0  # a push, that memory alone has something to carry on
        if form == "held":
            rates[n] = (-drag * y - history * tail) / (1.0 + history * w[0])
            y = factor * y - share * history * (tail + w[0] * rates[n])
        else:
            known = y + sum(a[k] * rates[n - k] for k in range(1, degree + 1) if n >= k)
            rates[n] = (-drag * known - history * tail) / (1.0 + history * w[0] + drag * a[0])
            y = known + a[0] * rates[n]
        path[n] = y
        if abs(y) > 1e100:
            return True
    swing = np.abs(np.diff(path, 4))  # what alternates, and little of what is smooth
    return bool(swing[-200:].max() > max(1e-9, swing[steps // 2 : steps // 2 + 200].max()))


def at_limit(degree: int, form: str, share: float) -> tuple[float, float]:
    """(λ dt, c√dt) at the computed limit, the first with that share of what it may be alone."""
    drag, memory = bounds(basset.Daitche(degree))
    if form != "held":
        return share * drag, (1.0 - share) * memory
    product = share * HELD_RATE
    return product, 0.5 * memory * (1.0 + float(held_factor(product))) if share < 1.0 else 0.0


def row(degree: int, form: str, share: float, distance: float, steps: int) -> dict[str, Any]:
    """Steps of 1 s, λ and c `distance` times those at the limit: whether they grow; status and largest |y| of both runs."""
    rule, (drag, history) = basset.Daitche(degree), (distance * value for value in at_limit(degree, form, share))
    method = basset.RungeKutta4(1.0, rule) if form == "held" else basset.FixedStep(1.0, rule, input=form)
    found: dict[str, Any] = {"degree": degree, "form": form, "share": share, "distance": distance, "drag": drag, "history": history}
    found["grows"] = grows(degree, form, drag, history)
    for name, rises in (("", False), ("_rising", True)):
        with np.errstate(over="ignore", invalid="ignore"):
            result = basset.solve(compiled(), (0.0, float(steps)), [1.0], coefficient=history, args=(drag, rises), method=method)
        found |= {f"status{name}": result.status, f"largest{name}": float(np.abs(result.y).max())}
    return found


def run(full: bool) -> dict[str, Any]:
    """Scan."""
    degrees, shares = (range(2, 11), (1.0, 0.75, 0.55, 0.25, 0.0)) if full else ((2, 4, 7, 10), (1.0, 0.55, 0.0))
    steps = STEPS if full else SHORT
    rows = [row(degree, form, share, distance, steps) for degree in degrees for form in FORMS for share in shares for distance in DISTANCES]
    limits = {str(degree): bounds(basset.Daitche(degree)) for degree in degrees}
    return {"steps": steps, "period": PERIOD, "limits": limits, "rows": rows}
