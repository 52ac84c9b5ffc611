"""A measured motion: times with positions or velocities of one grain, in SI, and the noise that is on them."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from basset import _validate, samples
from basset.kernels import Floats

__all__ = ["QUANTITIES", "Record", "noise_of", "read_record"]

QUANTITIES = {  # what can be compared: unit, words for it, and words for what counts the other way
    "x": ("m", "x, x position, along, streamwise", ""),
    "y": ("m", "y, y position, across", ""),
    "z": ("m", "z, z position, height, height of centre, centre height, center height, elevation", "depth, fall distance, distance fallen"),
    "gap": ("m", "gap, clearance, gap under sphere", ""),
    "u": ("m/s", "u, vx, ux, v x, u x, velocity x, x velocity", ""),
    "v": ("m/s", "vy, uy, v, v y, u y, velocity y, y velocity", ""),
    "w": ("m/s", "w, vz, uz, v z, u z, velocity z, z velocity, vertical velocity", "fall velocity, fall speed, settling velocity, settling speed"),
    "speed": ("m/s", "speed, velocity magnitude", ""),
}
WORDS = {
    word: (name, sign) for name, (_, *both) in QUANTITIES.items() for words, sign in zip(both, (1.0, -1.0), strict=True) for word in words.split(", ") if word
}
LENGTHS = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "dm": 0.1, "m": 1.0, "km": 1e3}
KNOWN = {"m": "m, cm, mm or µm", "m/s": "m/s, cm/s, mm/s or the like"}
FEWEST = 7  # samples of which a noise can be told
NORMAL = 1.4826  # standard deviation over median of the absolute value


class Record(NamedTuple):
    """Times (n,), s, from first to last, and values (n,) by quantity, NaN where there is none; `depths`: which came as depths, whose zero is unknown."""

    name: str
    times: Floats
    values: dict[str, Floats]
    depths: frozenset[str]
    left_out: tuple[str, ...]  # names of columns that are no such quantity


def read_record(record: str | os.PathLike[str] | Mapping[str, Any], names: Sequence[str] = ()) -> Record:
    """The record in a file (see `basset.samples.columns`), a DataFrame or a mapping of columns; `names` replace those of a file.

    Columns are known by their names, with units behind them or SI: "t", "z (mm)", "vz [cm/s]", "gap/mm", "time_ms". Others are left out.
    ValueError, with one sentence, for what is no record.
    """
    if isinstance(record, Mapping) or hasattr(record, "columns"):
        called, table = "the record", cast(Any, record)  # a DataFrame is read as a mapping is
        if getattr(getattr(table, "index", None), "name", None) is not None:
            table = table.reset_index()
        columns: dict[str, Floats] = {str(name): _validate.real_array(f"{called}[{name!r}]", table[name]).ravel() for name in table}
        if len({len(values) for values in columns.values()}) > 1:
            raise ValueError(f"{called} must have columns of one length, got {[len(values) for values in columns.values()]}")
    else:
        path = Path(record)
        called = repr(str(path))
        columns = samples.columns(path, names)
    clocks = {name: unit for name in columns if (unit := samples.seconds(name)) is not None}
    if len(clocks) != 1:
        raise ValueError(
            f"{called} must have one column of times, called t or time, if need be with a unit as in 'time (ms)', got {_listed(clocks or columns)}"
        )
    ((clock, unit),) = clocks.items()
    times = columns[clock] * unit
    if not np.isfinite(times).all() or not (np.diff(times) > 0.0).all():
        wrong = int(np.argmin(np.append(True, np.diff(times) > 0.0) & np.isfinite(times)))
        raise ValueError(f"{called} must have times that rise from row to row, as one trajectory does, got {columns[clock][wrong]:.9g} as time {wrong + 1}")
    values, depths, left_out = dict[str, Floats](), set[str](), []
    for name, column in columns.items():
        if name == clock:
            continue
        meaning = quantity_of(name)
        if meaning is None:
            left_out.append(name)
            continue
        quantity, factor = meaning
        if quantity in values:
            raise ValueError(f"{called} must hold each quantity once, got {quantity!r} again as {name!r}")
        if not np.isfinite(column).any() or np.isinf(column).any():
            raise ValueError(f"{called} must hold finite numbers, got {'infinity' if np.isinf(column).any() else 'none'} in the column {name!r}")
        values[quantity] = column * factor
        if factor < 0.0 and QUANTITIES[quantity][0] == "m":
            depths.add(quantity)
    if not values:
        known = "x, y, z (of the centre), gap (under the grain), u, v, w (along, across, up), speed, depth or fall velocity"
        raise ValueError(f"{called} must have a column called {known}, got {_listed(left_out)}: name the columns, such as t,z or 't (ms),gap (mm)'")
    return Record(called, times, values, frozenset(depths), tuple(left_out))


def _listed(names: Any) -> str:
    return ", ".join(repr(str(name)) for name in names) or "no other"


def quantity_of(heading: str) -> tuple[str, float] | None:
    """(quantity, what its numbers are to be multiplied by to be in SI) of a column's heading; None if it is none.

    ValueError, with one sentence, for a quantity in a unit that is not understood.

    >>> quantity_of("z (mm)"), quantity_of("fall velocity [cm/s]"), quantity_of("vz_m_s"), quantity_of("frame")
    (('z', 0.001), ('w', -0.01), ('w', 1.0), None)
    """
    text = heading.strip()
    found = re.fullmatch(r"(.*?)[\s/,]*[\[(]([^\])]*)[\])]", text) or re.fullmatch(r"([^/,]*?)\s*[/,]\s*(.+)", text)
    name, unit = found.groups() if found else (text, "")
    words = re.sub(r"[\s_]+", " ", name.strip().lower())
    if not found and words not in WORDS:  # z_mm, vz_m_s
        parts = text.split("_")
        for k in range(len(parts) - 1, 0, -1):
            before = " ".join(parts[:k]).lower()
            if before in WORDS and _factor("_".join(parts[k:]), QUANTITIES[WORDS[before][0]][0]) is not None:
                words, unit = before, "_".join(parts[k:])
    if words not in WORDS:
        return None
    quantity, sign = WORDS[words]
    factor = _factor(unit.strip(), QUANTITIES[quantity][0]) if unit.strip() else 1.0
    if factor is None:
        raise ValueError(f"the column {heading!r} must be in {KNOWN[QUANTITIES[quantity][0]]}, got the unit {unit.strip()!r}")
    return quantity, sign * factor


def _factor(unit: str, si: str) -> float | None:
    """What a number in this unit is multiplied by to be in m or m/s; None if it is none of these."""
    if si == "m":
        return LENGTHS.get(unit)
    unit = unit.replace("⁻¹", "-1").replace("−", "-")
    found = re.fullmatch(r"(\w+?)\s*(?:/|_|\sper\s)\s*(\w+)", unit) or re.fullmatch(r"(\w+?)[\s*·.]+(\w+?)\s*(?:\^|\*\*)?[({]?-1[)}]?", unit)
    length, time = found.groups() if found else ("m", "s") if unit in ("ms-1", "ms^-1") else ("", "")
    return LENGTHS[length] / samples.UNITS[time] if length in LENGTHS and time in samples.UNITS else None


def noise_of(times: Floats, values: Floats) -> float | None:
    """The standard deviation of what is not smooth: of each sample off the cubic through its four neighbours, by the median, so that bounces count little.

    As Gasser, Sroka & Jennen-Steinmetz (1986), Biometrika 73, 625, with cubics. None for fewer than seven samples.
    """
    there = np.isfinite(values)
    t, y = times[there], values[there]
    if len(t) < FEWEST:
        return None
    window = np.lib.stride_tricks.sliding_window_view
    nodes, around = window(t, 5), window(y, 5)
    others = [0, 1, 3, 4]
    weights = np.ones((len(nodes), 4))
    for i, k in enumerate(others):  # Lagrange's
        for m in others:
            if m != k:
                weights[:, i] *= (nodes[:, 2] - nodes[:, m]) / (nodes[:, k] - nodes[:, m])
    off = (around[:, 2] - (weights * around[:, others]).sum(axis=1)) / np.sqrt(1.0 + (weights**2).sum(axis=1))
    return float(NORMAL * np.median(np.abs(off)))
