"""How do the readings of a finite-Reynolds kernel differ if the slip varies?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import basset
from basset import measure
from basset.kernels import Floats, VaryingSlipKernel
from bench.suites.kernels import DIAMETER, SLIP, VISCOSITY

AMPLITUDES, FREQUENCIES = (0.1, 0.25, 0.5, 0.75, 0.9), (0.2, 2.0, 20.0, 200.0)  # of U = U0 (1 + a sin ωt); 1/s
AMPLITUDE, FREQUENCY = 0.5, 2.0  # where the other one varies
PERIOD_STEPS, PERIODS, PROMISE = 100, 2, 1e-6
FLOORS = (0.1, 0.03, 0.01, 0.003)  # smallest slip admitted, in U0, where the slip passes through zero


def evaluations(kernel: dict[str, Any], dt: float, horizon: float) -> dict[str, Any]:
    """The three ways to let the kernel follow the slip, planned."""
    rules = {"slip at t": basset.Daitche(3), "slip at τ": basset.Daitche(3), "exponentials": basset.Exponential(3, PROMISE)}
    return {name: rule.plan(dt, horizon, VaryingSlipKernel(**kernel, slip_at="tau" if name == "slip at τ" else "t")) for name, rule in rules.items()}


def compared(amplitude: float, frequency: float, low: float) -> dict[str, Any]:
    """Differences relative to the largest |H| of "slip at t", for U = U0 |1 + a sin ωt| and the rate of 1 + a sin ωt; `low` in U0."""
    dt, steps = 2.0 * math.pi / frequency / PERIOD_STEPS, PERIODS * PERIOD_STEPS
    phase = frequency * dt * np.arange(steps + 1.0)
    slip = SLIP * np.abs(1.0 + amplitude * np.sin(phase))
    rate = SLIP * amplitude * frequency * np.cos(phase)
    kernel = {"diameter": DIAMETER, "viscosity": VISCOSITY, "slip_range": (SLIP * low, SLIP * (1.01 + amplitude))}
    found: dict[str, Floats] = {}
    outside = 0
    for name, plan in evaluations(kernel, dt, steps * dt).items():
        state = plan.start()
        found[name] = plan.run(state, rate, slip=slip)
        outside = plan.outside(state)
    scale = np.abs(found["slip at t"]).max()
    steady = basset.MeiAdrianKernel(SLIP, DIAMETER, VISCOSITY)
    values = {"mean slip": basset.cumulate(rate, dt, basset.Daitche(3), kernel=steady), "Basset": basset.cumulate(rate, dt, basset.Daitche(3)), **found}
    return {
        "amplitude": amplitude,
        "frequency": frequency,
        "low": low,
        "outside": outside,
        "n": steps + 1,
        "differences": {name: float(np.abs(other - found["slip at t"]).max() / scale) for name, other in values.items() if name != "slip at t"},
    }


def costs() -> list[dict[str, Any]]:
    """Nanoseconds per step and bytes of state of one component; every slip is a new one."""
    dt, steps = 1e-3, PERIODS * PERIOD_STEPS
    kernel = {"diameter": DIAMETER, "viscosity": VISCOSITY, "slip_range": (SLIP * 0.5, SLIP * 2.0)}
    plans = evaluations(kernel, dt, 2 * steps * dt)
    steady_plan = basset.Exponential(3, PROMISE).plan(dt, 2 * steps * dt, kernel=basset.MeiAdrianKernel(SLIP, DIAMETER, VISCOSITY))
    generator = np.random.default_rng(1)
    rate = generator.standard_normal(steps)

    def march(plan: Any) -> None:
        plan.run(plan.start(), rate, slip=SLIP * generator.uniform(0.5, 2.0, steps))

    steady_plan.run(steady_plan.start(), rate)  # compiled, or read from disk
    times = measure.interleaved(
        {
            **{name: (lambda plan=plan: march(plan)) for name, plan in plans.items()},
            "steady slip": lambda: steady_plan.run(steady_plan.start(), rate),
        },
        rounds=3,
        seconds=0.0,
    )
    states = {name: plan.start() for name, plan in {**plans, "steady slip": steady_plan}.items()}
    return [
        {"evaluation": name, "n": steps, "nanoseconds": 1e9 * seconds / steps, "bytes": sum(array.nbytes for array in states[name])}
        for name, seconds in times.items()
    ]


def run(full: bool) -> dict[str, Any]:
    """A slip that varies in time: slip at t, slip at τ, and the slip at t by exponentials whose weights follow it."""
    amplitudes, frequencies = (AMPLITUDES, FREQUENCIES) if full else (AMPLITUDES[::2], FREQUENCIES[:3])
    cases = [(a, FREQUENCY) for a in amplitudes] + [(AMPLITUDE, w) for w in frequencies if w != FREQUENCY]
    reversing = [(1.0, low) for low in (FLOORS if full else FLOORS[::2])] + ([(1.5, low) for low in FLOORS] if full else [])
    return {
        "slip": SLIP,
        "diameter": DIAMETER,
        "period_steps": PERIOD_STEPS,
        "periods": PERIODS,
        "promise": PROMISE,
        "time_scale": basset.MeiAdrianKernel(SLIP, DIAMETER, VISCOSITY).steepness ** (-2.0 / 3.0),
        "records": [compared(a, w, 0.9 * (1.0 - a)) for a, w in cases],
        "stopping": [compared(a, FREQUENCY, low) for a, low in reversing],
        "costs": costs(),
    }
