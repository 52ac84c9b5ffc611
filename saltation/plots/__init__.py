"""Figures of results: a file here names its own for `saltation plot`, in `PLOTS` for one grain and in `CLOUD_PLOTS` for many."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import Any


def plots_of(cloud: bool) -> dict[str, Callable[[Any], Any]]:
    """Every plot of a single grain's result, or of a cloud's, by name: from a result to a Figure."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    tables = (getattr(module, "CLOUD_PLOTS" if cloud else "PLOTS", {}) for module in modules)
    return {name: draw for table in tables for name, draw in table.items()}
