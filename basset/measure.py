"""Timing that can be compared, and work–precision records.

On a shared machine only ratios within one run are meaningful: contenders are interleaved, each is warmed up (so that
compile and cache misses stay apart) and its minimum over the rounds is kept.
"""

from __future__ import annotations

import gc
import json
import os
import platform
import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from basset import __version__
from basset._files import write

Name = TypeVar("Name", bound=Hashable)


def interleaved(
    contenders: Mapping[Name, Callable[[], Any]],
    rounds: int = 7,
    seconds: float = 0.02,
    patience: float = 1.0,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[Name, float]:
    """Seconds per call of each contender (NaN for one that raises): the minimum over rounds that visit all of them in turn.

    On each visit short calls are repeated for `seconds` and averaged. A contender whose warm-up takes longer than `patience` (s) is not called
    again: that one time is its result. `clock` (s): `time.process_time` for what runs in one thread and shares its machine.

    >>> times = interleaved({"quick": lambda: None, "broken": lambda: 1 / 0}, rounds=1, seconds=1e-4)
    >>> times["quick"] > 0.0, times["broken"]
    (True, nan)
    """
    calls: dict[Name, int] = {}
    best: dict[Name, float] = {}
    for name, call in contenders.items():
        try:
            best[name] = once = _timed(call, 1, clock)  # warm-up: compilation, caches
        except Exception:  # a failure is a row without a time; it must not cost the others theirs
            best[name] = once = float("nan")
        if once <= patience:
            best[name] = once = _timed(call, 1, clock)
            calls[name] = max(1, min(10_000, round(seconds / max(once, 1e-7))))
    for _ in range(rounds):
        for name, count in calls.items():
            best[name] = min(best[name], _timed(contenders[name], count, clock))
    return best


def _timed(call: Callable[[], Any], count: int, clock: Callable[[], float]) -> float:
    """Seconds per call, the mean of `count` calls; the garbage collector waits meanwhile."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        start = clock()
        for _ in range(count):
            call()
        return (clock() - start) / count
    finally:
        if collecting:
            gc.enable()


def observed_orders(steps: ArrayLike, errors: ArrayLike) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Slopes d ln(error)/d ln(step) between neighbouring entries (k,): (k−1,)."""
    return np.asarray(np.diff(np.log(np.asarray(errors, dtype=np.float64))) / np.diff(np.log(np.asarray(steps, dtype=np.float64))))


def processor() -> str:
    """The CPU's model name and the number of cores available."""
    model = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return f"{model}, {os.cpu_count()} cores"


def provenance(command: str, packages: Iterable[str] = ("numpy", "scipy", "mpmath")) -> dict[str, str]:
    """Provenance of a measurement: command, date (UTC, YYYY-MM-DD), processor, and versions of Python, basset and `packages`."""
    found = {"python": platform.python_version(), "basset": __version__}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    versions = ", ".join(f"{name} {number}" for name, number in found.items())
    return {"command": command, "date": datetime.now(UTC).strftime("%Y-%m-%d"), "processor": processor(), "versions": versions}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write atomically, making the folder: a temporary file beside it, then a rename. NumPy numbers and arrays too; what is not finite becomes null."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write(path, json.dumps(_plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """`value` with NumPy numbers and arrays made Python's own, and NaN and infinities made None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
