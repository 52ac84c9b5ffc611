"""Checks of arguments: one sentence that names the argument, what was given and what would be right."""

from __future__ import annotations

import difflib
import math
import operator
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def shown(value: Any, limit: int = 60) -> str:
    """Repr of `value` for a message: short, on one line."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # integers of thousands of digits, lists too deep in each other
        text = f"{type(value).__name__} too long to be shown"
    return text if len(text) <= limit else text[: limit - 1] + "…"


class MissingError(ValueError):
    """Some of the values are missing."""


FILL = "fill the gaps, by interpolation for instance, or take an interval without any"


def unmasked(name: str, value: Any) -> Any:
    """`value` without its mask; refused if it has masked entries or pandas' NA, for which NumPy would take arbitrary numbers."""
    if isinstance(value, np.ma.MaskedArray):
        if count := int(np.sum(value.mask)):
            where = f"{count} of {value.size} masked, the first in row {np.argwhere(value.mask)[0][0]}" if value.ndim else "a masked one"
            raise MissingError(f"{name} must have no missing values, got {where}: {FILL}")
        return value.data
    entries = value.ravel().tolist() if isinstance(value, np.ndarray) and value.dtype == object else value if isinstance(value, (list, tuple)) else ()
    for kind in set(map(type, entries)):  # of a million floats: one look
        if kind.__name__ == "NAType":
            raise MissingError(f"{name} must have no missing values, got <NA>: {FILL}")
        if issubclass(kind, (list, tuple, np.ndarray)):
            for entry in entries:
                unmasked(name, entry)
    return value


def apart(first: float, second: float) -> tuple[str, str]:
    """Two numbers for one message, with enough digits to differ."""
    digits = 6 if first == second else next((count for count in range(6, 17) if f"{first:.{count}g}" != f"{second:.{count}g}"), 17)
    return f"{first:.{digits}g}", f"{second:.{digits}g}"


def number(name: str, value: Any, right: str = "a finite number") -> float:
    """`value` as a finite float; TypeError for what is no real number, ValueError for NaN and infinity."""
    value = unmasked(name, value) if isinstance(value, np.ma.MaskedArray) else value
    if isinstance(value, (bool, np.bool_, str, bytes)) or value is None:
        raise TypeError(f"{name} must be {right}, got {shown(value)}")
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be {right}, got {shown(value)}") from None
    if not math.isfinite(result):
        raise ValueError(f"{name} must be {right}, got {result}")
    return result


def positive(name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float above zero."""
    right = "a finite number greater than 0" + (f" ({unit})" if unit else "")
    result = number(name, value, right)
    if result <= 0.0:
        raise ValueError(f"{name} must be {right}, got {result:g}")
    return result


def non_negative(name: str, value: Any, unit: str = "") -> float:
    """`value` as a finite float, zero allowed."""
    right = "a finite number, 0 or greater" + (f" ({unit})" if unit else "")
    result = number(name, value, right)
    if result < 0.0:
        raise ValueError(f"{name} must be {right}, got {result:g}")
    return result


def tolerance(name: str, value: Any) -> float:
    """`value` as a relative error above 0 and below 1."""
    result = positive(name, value)
    if result >= 1.0:
        raise ValueError(f"{name} must be below 1, got {apart(result, 1.0)[0]}")
    return result


def integer(name: str, value: Any, low: int, high: int | None = None) -> int:
    """`value` as an int in [low, high]; floats are refused even when they are whole."""
    right = f"a whole number from {low} to {high}" if high is not None else f"a whole number, {low} or greater"
    value = unmasked(name, value) if isinstance(value, np.ma.MaskedArray) else value
    if isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be {right}, got {shown(value)}")
    try:
        result = operator.index(value)
    except TypeError:
        kind = ValueError if isinstance(value, (float, np.floating)) else TypeError
        raise kind(f"{name} must be {right}, got {shown(value)}") from None
    if result < low or (high is not None and result > high):
        raise ValueError(f"{name} must be {right}, got {shown(result)}")
    return result


def choice(name: str, value: Any, options: Iterable[str]) -> str:
    """`value` if it is one of the strings in `options`; otherwise the nearest one is suggested."""
    known = list(options)
    if not isinstance(value, str):
        raise TypeError(f"{name} must be one of {', '.join(map(repr, known))}, got {shown(value)}")
    if value not in known:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, known))}, got {value!r}{suggestion(value, known)}")
    return value


def suggestion(word: str, known: Iterable[str]) -> str:
    """The nearest of `known` as a question to end a sentence with, or an empty string."""
    near = difflib.get_close_matches(word.lower(), list(known), n=1, cutoff=0.4)
    return f"; did you mean {near[0]!r}?" if near else ""


def real_array(name: str, value: Any) -> NDArray[np.float64]:
    """`value` as a float64 array; what does not hold real numbers, or misses some, is refused."""
    try:
        array = np.asarray(unmasked(name, value))
        if array.dtype == object and not any(isinstance(entry, (str, bytes, bool, np.bool_)) or entry is None for entry in array.flat):
            array = unmasked(name, array).astype(np.float64)
    except MissingError:
        raise
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be an array of real numbers with equal rows, got {shown(value)}") from None
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{name} must be an array of real numbers, got {shown(value)} (dtype {array.dtype})")
    return array.astype(np.float64)


def finite(name: str, value: Any, missing: bool = False) -> NDArray[np.float64]:
    """`value` as finite (with `missing`, possibly NaN) float64; what does not hold real numbers is refused."""
    array = real_array(name, value)
    bad = np.argwhere(np.isinf(array) if missing else ~np.isfinite(array))
    if len(bad):
        where = tuple(int(index) for index in bad[0])
        place = f" at position {', '.join(map(str, where))}" if where else ""
        others = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
        raise ValueError(f"{name} must be finite, got {array[where]}{place}{others}")
    return array


def not_finite(samples: NDArray[np.floating[Any]], offset: int, name: str = "g") -> ValueError:
    """Why the result for these samples is not finite."""
    flat = samples.reshape(len(samples), -1)
    rows = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if not len(rows):
        return ValueError(f"{name} must be small enough for its integral to fit into double precision, got samples up to {np.abs(samples).max():.3g}")
    first = flat[rows[0]][~np.isfinite(flat[rows[0]])][0]
    hint = f": {FILL}" if np.isnan(first) else ""
    return ValueError(f"{name} must be finite, got {first} in sample {rows[0] + offset} (and {len(rows) - 1} other samples){hint}")
