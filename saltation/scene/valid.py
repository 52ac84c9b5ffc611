"""The closures of a scene against their ranges: which it takes, which hold, and what to take instead."""

from __future__ import annotations

import math
from typing import Any

from saltation.bed import rebound
from saltation.closures import Closure, Conditions, choose, outside
from saltation.effects import EFFECTS
from saltation.scene.conditions import conditions

__all__ = ["chosen", "families", "left"]

Family = dict[str, Closure]


def families(scene: Any) -> dict[str, Family]:
    """The families of closures of what the scene computes: "table.field" that names the law -> closures by name; of an effect with one only, "table"."""
    tables = {name: getattr(EFFECTS[name], "CLOSURES", {}) for name in scene.names}
    if scene.bed is not None and not lubricated(scene):  # else the restitution is the dry one
        tables["bed"] = rebound.CLOSURES
    found: dict[str, Family] = {}
    for table, closures in tables.items():
        for name, closure in closures.items():
            found.setdefault(".".join([table, *list(closure.take)[:1]]), {})[name] = closure
    return found


def lubricated(scene: Any) -> bool:
    """Whether the liquid that is squeezed out of the gap before a contact is computed."""
    return "wall" in scene.names and scene.options("wall").normal != "none"


def chosen(scene: Any, given: Conditions | None = None) -> dict[str, tuple[str, bool]]:
    """Family -> (closure, True): the one whose range holds the scene, of these the one with the most recent measurement behind it.

    (the nearest, False) if none holds.
    `given`: the conditions, if not those of `conditions`, such as those of a run.

    >>> from saltation.scene import load
    >>> chosen(load("sand"))["magnus.law"]
    ('loth', True)
    """
    met = conditions(scene) if given is None else given
    return {family: choose(closures, met) for family, closures in families(scene).items()}


def taken(scene: Any, table: str, closures: Family) -> str | None:
    """The closure of a family that the scene takes; None for a number of its own."""
    options = scene.bed if table == "bed" else scene.options(table)
    return next((name for name, closure in closures.items() if all(getattr(options, field) == value for field, value in closure.take.items())), None)


def left(scene: Any, given: Conditions | None = None) -> list[str]:
    """A sentence for each closure of the scene whose range it leaves: which, by what number, and what to take instead."""
    met = conditions(scene) if given is None else given
    found = []
    for family, closures in families(scene).items():
        table = family.partition(".")[0]
        name = taken(scene, table, closures)
        beyond = outside(closures[name], met) if name is not None else {}
        beyond = {number: value for number, value in beyond.items() if not math.isnan(value)}
        if name is None or not beyond:
            continue
        own = closures[name]
        best, holds = choose(closures, met)
        ranges = " and ".join(f"{number} {_span(*own.holds[number])}" for number in beyond)
        here = ", ".join(f"{number} = {value:.3g}" for number, value in beyond.items())
        text = f"{_words(table, own)}: {own.source} holds for {ranges}, and here {here}"
        instead = f"take {_words(table, closures[best])}, {closures[best].source}"
        if holds:
            found.append(f"{text}: {instead}")
        else:
            found.append(f"{text}; no other law known here holds" + ("" if best == name else f", the nearest: {instead}"))
    return found


def _words(table: str, closure: Closure) -> str:
    """What a scene says to take a closure."""
    return " and ".join(f"{table}.{field} = {value!r}" for field, value in closure.take.items()) or table


def _span(low: float, high: float) -> str:
    """A range in words."""
    if low == 0.0:
        return f"up to {high:g}"
    return f"from {low:g} on" if math.isinf(high) else f"{low:g} to {high:g}"
