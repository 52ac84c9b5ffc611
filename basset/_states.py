"""Checks that streams share: that a state belongs to a plan, and how many steps a horizon holds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from basset import _validate

MOST_STEPS = 1e15  # beyond, a float no longer counts steps


def owned(state: Any, kind: type[Any], widths: dict[str, int]) -> None:
    """Refuse a state that another plan made: compiled code would read and write beyond its arrays.

    `widths` are the expected second dimensions by name.
    """
    if not isinstance(state, kind):
        raise TypeError(f"state must be what plan.start(shape) returns, got {_validate.shown(state)}")
    for name, array in zip(state._fields, state, strict=True):
        if type(array) is not np.ndarray or array.dtype != np.float64 or not array.dtype.isnative:
            raise TypeError(f"state.{name} must be a float64 array as plan.start(shape) makes it, got {_validate.shown(array)}")
        if not (array.flags.c_contiguous and array.flags.writeable):
            raise ValueError(f"state.{name} must be contiguous and writeable, got a read-only or strided array: copy it")
    components = state.history.size
    for name, width in widths.items():
        shape = getattr(state, name).shape
        if shape != (components, width):
            raise ValueError(f"state must belong to this plan: state.{name} must have the shape {(components, width)}, got {shape}")


def steps_to(horizon: float, dt: float) -> int:
    """Whole steps that reach `horizon`; ValueError when they cannot be counted."""
    ratio = horizon / dt if horizon < math.inf else math.inf
    if not ratio <= MOST_STEPS:
        raise ValueError(f"horizon must be at most {MOST_STEPS:g} steps of dt = {dt:g} seconds, got {horizon:g}")
    return max(1, math.ceil(ratio * (1.0 - 1e-12)))
