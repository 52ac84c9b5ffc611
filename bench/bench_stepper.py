"""What compiled functions, many systems and threads save in `solve`, under pytest-benchmark: `pytest bench`. Both sides take turns."""

import pytest

from basset import measure
from bench.suites.stepper import fixed_steps, impacts, systems, threads


@pytest.mark.parametrize(
    ("case", "least"), [(impacts, 4.0), (systems, 2.0), (threads, 1.2), (fixed_steps, 2.0)], ids=lambda value: getattr(value, "__name__", "")
)
def bench_saved(benchmark, case, least):
    slow, fast = case()
    seconds = measure.interleaved({"slow": slow, "fast": fast}, rounds=5, patience=30.0)
    ratio = benchmark.extra_info["ratio"] = seconds["slow"] / seconds["fast"]
    benchmark.pedantic(fast, rounds=3, warmup_rounds=1)
    assert ratio > least
