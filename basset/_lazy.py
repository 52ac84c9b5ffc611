"""Lazy loading: public names of a package import their module on first use (SPEC 1, by PEP 562)."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def face(package: str, names: dict[str, Any], places: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """(__getattr__, __dir__) of a package: `places` gives the module of each public name, "module" or "module:name there".

    `names` are the package's globals. A module of the package is found by its own name too, as if the package had imported it.
    """

    def get(name: str) -> Any:
        if name in places:
            module, _, there = places[name].partition(":")
            value = getattr(importlib.import_module(f"{package}.{module}"), there or name)
        elif name.startswith("__"):
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        else:
            try:
                value = importlib.import_module(f"{package}.{name}")
            except ModuleNotFoundError as error:
                if error.name != f"{package}.{name}":
                    raise
                raise AttributeError(f"module {package!r} has no attribute {name!r}") from None
        names[name] = value
        return value

    return get, lambda: sorted({*names, *places})


class Later:
    """A module, or something of it, that is imported when it is first used: command lines then start fast."""

    def __init__(self, module: str, name: str = "") -> None:
        self._place = module, name

    def _found(self) -> Any:
        module, name = self._place
        found = importlib.import_module(module)
        return getattr(found, name) if name else found

    def __getattr__(self, name: str) -> Any:
        return getattr(self._found(), name)

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """Call it."""
        return self._found()(*arguments, **options)
