"""Do starting, a value with cached weights, building weights and a long history cost what they should?"""

from __future__ import annotations

import resource
import subprocess
import sys
from typing import Any

import numpy as np

import basset
from basset import measure
from basset.problems import PROBLEMS
from basset.weights.table import TABLES
from bench.suites.fresnel import RULES

CACHED, BUILT, HELD = 2**16, 2**18, 10**7
MEMORY = """
import resource, sys, basset
basset.Daitche(int(sys.argv[1])).weights(int(sys.argv[2]), 1.0)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
"""
STARTS = {
    "python": ("-c", "pass"),
    "import numpy": ("-c", "import numpy"),
    "import basset": ("-c", "import basset"),
    "import saltation": ("-c", "import saltation"),
    "basset --help": ("-m", "basset", "--help"),
    "saltation --help": ("-m", "saltation", "--help"),
    "saltation check sand": ("-m", "saltation", "check", "sand"),
    "saltation schema": ("-m", "saltation", "schema"),
    "saltation scenes": ("-m", "saltation", "scenes"),
    "basset weights daitche": ("-m", "basset", "weights", "daitche", "--steps", "9"),
}


def starts(rounds: int = 5) -> list[dict[str, Any]]:
    """CPU seconds (user and system) of fresh processes, the first round left out: it reads the disk."""
    seconds: dict[str, list[float]] = {name: [] for name in STARTS}
    for number in range(rounds + 1):
        for name, words in STARTS.items():
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, *words], capture_output=True, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if number:
                seconds[name].append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return [{"start": name, "seconds": min(found), "all": found} for name, found in seconds.items()]


def cached(full: bool) -> list[dict[str, Any]]:
    """Seconds of `integrate` with weights in the cache, against numpy.dot of the same length."""
    g, weights = np.cos(np.linspace(0.0, 50.0, CACHED + 1)), np.ones(CACHED + 1)
    contenders: dict[str, Any] = {name: lambda rule=rule: basset.integrate(g, 1e-3, rule) for name, rule in RULES.items()}
    times = measure.interleaved({"numpy.dot": lambda: np.dot(weights, g), **contenders}, rounds=100 if full else 25, seconds=0.002)
    return [{"scheme": name, "n": CACHED, "seconds": seconds} for name, seconds in times.items()]


def building(full: bool) -> list[dict[str, Any]]:
    """Seconds to build the weights of every rule from nothing."""

    def build(rule: basset.Rule) -> None:
        TABLES.clear()
        rule.weights(BUILT, 1.0)

    times = measure.interleaved({name: lambda rule=rule: build(rule) for name, rule in RULES.items()}, rounds=3 if full else 1, seconds=0.0)
    return [{"scheme": name, "n": BUILT, "seconds": seconds} for name, seconds in times.items()]


def memory(full: bool) -> list[dict[str, Any]]:
    """Peak bytes of a fresh process that builds many weights, imports included."""
    records = []
    for p in (1, 8, 10) if full else (8,):
        run = subprocess.run([sys.executable, "-c", MEMORY, str(p), str(HELD)], capture_output=True, text=True, check=False)
        records.append({"order": p, "n": HELD, "bytes": int(run.stdout) if run.returncode == 0 else None})
    return records


def long_time(full: bool) -> list[dict[str, Any]]:
    """Error at t = 1e4π with 2^20 steps, weights built and used once; unless in full, of the rules of high order alone."""
    problem = PROBLEMS["fresnel_long"]
    arguments = problem.arguments(2**20)
    truth = float(problem.exact_digits(problem.end, 30))
    rules = {name: rule for name, rule in RULES.items() if full or rule.error_order > 4}
    return [
        {"scheme": name, "n": 2**20, "h": arguments["dt"], "error_end": abs(basset.integrate(**arguments, rule=rule) - truth)} for name, rule in rules.items()
    ]


def run(full: bool) -> dict[str, Any]:
    """Overheads, build times, memory and a long history."""
    TABLES.clear()
    return {"starts": starts(), "cached": cached(full), "building": building(full), "memory": memory(full), "long": long_time(full)}
