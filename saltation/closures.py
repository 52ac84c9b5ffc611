"""Closures with a range: what a family of laws offers, where each of them holds, and the rule that chooses among them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

__all__ = ["NUMBERS", "Closure", "Conditions", "choose", "outside"]

NUMBERS = {
    "Re_p": "|u_r| d/ν, of the slip",
    "Re_r": "|ω_r| d²/ν, of the spin against the fluid's",
    "Re_r/Re_p": "|ω_r| d/|u_r|",
    "shear": "|du_f/dz| d/|u_r|",
    "√Re_G/Re_p": "√(|du_f/dz| ν)/|u_r|",
    "gap": "between grain and bed, d",
    "St": "ρ_s d V_n/(9μ), of an impact at the normal speed V_n",
    "R_p": "√(|R| g d³)/ν",
    "T": "τ*/τ*c",
}
Conditions = Mapping[str, float]  # of NUMBERS; what a scene has not, such as T in still water, is missing


class Closure(NamedTuple):
    """One law of a family: what a scene says to take it, and where it holds. The first field of `take` names the family."""

    take: dict[str, Any]  # field of the effect's table -> value
    year: int  # of the newest measurement or computation behind it
    source: str
    holds: dict[str, tuple[float, float]]  # of NUMBERS -> lowest and highest


def outside(closure: Closure, conditions: Conditions) -> dict[str, float]:
    """The numbers that lie outside of a closure's range; NaN for one that the conditions do not have.

    >>> outside(Closure({}, 1961, "creeping flow", {"Re_p": (0.0, 1.0)}), {"Re_p": 40.0})
    {'Re_p': 40.0}
    """
    found = {name: conditions.get(name, math.nan) for name in closure.holds}
    return {name: value for name, value in found.items() if not closure.holds[name][0] <= value <= closure.holds[name][1]}


def choose(family: Mapping[str, Closure], conditions: Conditions) -> tuple[str, bool]:
    """(its key, whether it holds) of the closure whose range holds the conditions, of these the one with the most recent measurement behind it.

    Where none holds: the one whose range is nearest, by the ratio to its bound of the number that is farthest out.

    >>> laws = {"creeping": Closure({}, 1961, "theory", {"Re_p": (0.0, 1.0)}), "fit": Closure({}, 1998, "experiment", {"Re_p": (0.0, 140.0)})}
    >>> choose(laws, {"Re_p": 0.5}), choose(laws, {"Re_p": 1e4})
    (('fit', True), ('fit', False))
    """
    holding = [name for name, closure in family.items() if not outside(closure, conditions)]
    if holding:
        return max(holding, key=lambda name: family[name].year), True
    return min(family, key=lambda name: _distance(family[name], conditions)), False


def _distance(closure: Closure, conditions: Conditions) -> float:
    """|ln| of the largest ratio of a number to the bound that it is beyond; infinite for a number that is missing."""
    farthest = 0.0
    for name, value in outside(closure, conditions).items():
        low, high = closure.holds[name]
        bound = low if value < low else high
        farthest = max(farthest, abs(math.log(value / bound)) if value > 0.0 < bound else math.inf)
    return farthest
