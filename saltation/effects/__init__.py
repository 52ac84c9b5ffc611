"""Effects: one file per force or torque. `EFFECTS` finds them; a new file is a new effect."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any


def _found() -> dict[str, ModuleType]:
    """Every module of this folder that has a NAME, by that name."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    return {module.NAME: module for module in modules if hasattr(module, "NAME")}


EFFECTS: dict[str, ModuleType] = _found()


def warnings_of(name: str, options: Any, numbers: Any) -> list[str]:
    """What an effect has to say about its range with these options and numbers of a scene."""
    return list(getattr(EFFECTS[name], "warnings", lambda options, numbers: ())(options, numbers))
