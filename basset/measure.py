"""Timing that can be compared, and work–precision records.

On a shared machine only ratios within one run mean something: contenders are interleaved, each is warmed up (so that
compile and cache misses stay apart) and its minimum over the rounds is kept.
"""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def interleaved(contenders: Mapping[str, Callable[[], Any]], rounds: int = 7, seconds: float = 0.02, limit: float = 30.0) -> dict[str, float]:
    """Seconds per call of each contender: the minimum over rounds that visit all of them in turn.

    Parameters
    ----------
    contenders : mapping of name to callable without arguments
    rounds : int
        How often each is visited.
    seconds : float
        Time spent on a contender per visit: short calls are repeated and averaged.
    limit : float, seconds
        No further round is begun after this much time.

    Returns
    -------
    dict of name to seconds per call
    """
    calls: dict[str, int] = {}
    best: dict[str, float] = {}
    for name, call in contenders.items():
        call()  # warm-up: compilation, caches
        start = time.perf_counter()
        call()
        once = time.perf_counter() - start
        calls[name], best[name] = max(1, min(10_000, round(seconds / max(once, 1e-7)))), once
    begun = time.perf_counter()
    for _ in range(rounds):
        for name, call in contenders.items():
            start = time.perf_counter()
            for _ in range(calls[name]):
                call()
            best[name] = min(best[name], (time.perf_counter() - start) / calls[name])
        if time.perf_counter() - begun > limit:
            break
    return best


def observed_orders(steps: ArrayLike, errors: ArrayLike) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Slopes d ln(error)/d ln(step) between neighbouring entries; one fewer than entries."""
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
    """Who measured: command, date, processor, Python and package versions."""
    found = {"python": platform.python_version()}
    for package in ("basset", *packages):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    versions = ", ".join(f"{name} {number}" for name, number in found.items())
    return {"command": command, "date": datetime.now(UTC).strftime("%Y-%m-%d"), "processor": processor(), "versions": versions}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write atomically: a temporary file beside it, then a rename."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=True) + "\n", encoding="utf-8")
    partial.replace(path)
