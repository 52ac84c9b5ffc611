"""The rules, one small class per published method, and the names they have in scenes and commands; a new file is a new rule."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import MISSING, fields
from typing import Any, cast

from basset import _validate
from basset.quadrature.brush import Brush
from basset.quadrature.daitche import Daitche
from basset.quadrature.euler_maclaurin import EulerMaclaurin
from basset.quadrature.exponential import Exponential
from basset.quadrature.hinsberg import Hinsberg
from basset.quadrature.newton_cotes import NewtonCotes
from basset.quadrature.rule import Rule
from basset.quadrature.semi_derivative import SemiDerivative
from basset.quadrature.windowed import Windowed

__all__ = [
    "SCHEMES", "Brush", "Daitche", "EulerMaclaurin", "Exponential", "Hinsberg", "NewtonCotes", "Rule", "SemiDerivative", "UnknownSchemeError", "Windowed",
]  # fmt: skip


class UnknownSchemeError(KeyError, ValueError):
    """A name that is not in `basset.SCHEMES`; both a KeyError and a ValueError.

    Examples
    --------
    >>> try:
    ...     SCHEMES["daiche"]
    ... except KeyError as error:
    ...     print("did you mean 'daitche'" in str(error))
    True
    """

    def __str__(self) -> str:
        return str(self.args[0])


class _Schemes(dict[str, type[Rule]]):
    """Name -> class; an unknown name says which is the nearest."""

    def __missing__(self, name: object) -> type[Rule]:
        if not isinstance(name, str):
            raise TypeError(f"a scheme is named by a string, got {_validate.shown(name)}")
        near = _validate.suggestion(name, self)
        raise UnknownSchemeError(f"scheme must be one of {', '.join(map(repr, self))}, got {name!r}{near}")


def _found() -> dict[str, type[Rule]]:
    """Every class of this folder that has a name of its own, by that name."""
    modules = [importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
    classes = [thing for module in modules for thing in vars(module).values() if isinstance(thing, type) and thing.__module__ == module.__name__]
    return {thing.name: thing for thing in classes if issubclass(thing, Rule) and "name" in vars(thing)}


SCHEMES: dict[str, type[Rule]] = _Schemes(_found())


def by_default() -> list[Rule]:
    """A rule of every scheme whose parameters all have defaults."""
    return [scheme() for scheme in SCHEMES.values() if all(field.default is not MISSING for field in fields(cast(Any, scheme)))]


def full_history() -> list[str]:
    """The schemes that may be the rule of a window: those without a window or a tail of their own."""
    return [rule.name for rule in by_default() if rule.whole == rule]


def resolve(rule: Any) -> Rule:
    """A rule, from a rule or from a name in `basset.SCHEMES` whose parameters all have defaults."""
    if isinstance(rule, Rule):
        return rule
    if isinstance(rule, str):
        scheme = SCHEMES[rule]
        try:
            return scheme()
        except TypeError as error:
            raise TypeError(f"rule {rule!r} needs parameters: pass basset.{scheme.__name__}(...) instead ({error})") from None
    hint = f"; write {rule.__name__}(...)" if isinstance(rule, type) and issubclass(rule, Rule) else ""
    raise TypeError(f"rule must be a rule such as basset.Daitche(order=3), got {_validate.shown(rule)}{hint}")
