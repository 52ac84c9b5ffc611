"""The rules, one small class per published method, and the names they have in scenes and commands."""

from __future__ import annotations

from basset import _validate
from basset.quadrature.base import Rule
from basset.quadrature.baselines import Brush, EulerMaclaurin
from basset.quadrature.exponential import Exponential
from basset.quadrature.hinsberg import Hinsberg
from basset.quadrature.product import Daitche
from basset.quadrature.semi_derivative import SemiDerivative
from basset.quadrature.windowed import Windowed

__all__ = ["SCHEMES", "Brush", "Daitche", "EulerMaclaurin", "Exponential", "Hinsberg", "Rule", "SemiDerivative", "UnknownSchemeError", "Windowed"]


class UnknownSchemeError(KeyError, ValueError):
    """A name that is not in `basset.SCHEMES`; both a KeyError and a ValueError."""

    def __str__(self) -> str:
        return str(self.args[0])


class _Schemes(dict[str, type[Rule]]):
    """Name -> class; an unknown name says which is the nearest."""

    def __missing__(self, name: object) -> type[Rule]:
        if not isinstance(name, str):
            raise TypeError(f"a scheme is named by a string, got {_validate.shown(name)}")
        near = _validate.suggestion(name, self)
        raise UnknownSchemeError(f"scheme must be one of {', '.join(map(repr, self))}, got {name!r}{near}")


SCHEMES: dict[str, type[Rule]] = _Schemes({rule.name: rule for rule in (SemiDerivative, EulerMaclaurin, Brush, Daitche, Hinsberg, Windowed, Exponential)})
