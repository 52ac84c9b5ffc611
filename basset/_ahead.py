"""What `basset warmup` compiles: every compiled function of this package, called once with the types that it always gets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray

from basset._compile import compiled
from basset.evaluate import cumulate
from basset.exponentials import ExponentialSum
from basset.kernels import VaryingSlipKernel
from basset.particles import Flow, maxey_riley
from basset.quadrature import Daitche, Exponential, Windowed
from basset.solvers import Collocation, FixedStep, solve
from basset.streaming import LONG_WINDOW
from basset.tracks import history


@compiled()
def decay(t: float, y: Any) -> Any:
    """A compiled fun."""
    return -y


def streams() -> None:
    """Rows, blocks and the next sample, with exponentials and without."""
    for rule in (Daitche(2), Exponential(2, 1e-3), Windowed(Daitche(2), 0.4, ExponentialSum.fit(0.2, 10.0, 1e-3))):
        plan = rule.plan(0.1, 4.0)
        state = plan.start((2,))
        plan.run(state, np.ones((20, 2)))
        plan.tail(state)
    long = Windowed(Daitche(1), 0.1 * (LONG_WINDOW + 1), ExponentialSum.fit(0.05 * LONG_WINDOW, 0.3 * LONG_WINDOW, 1e-2))
    long.plan(0.1, 0.2 * LONG_WINDOW).trajectory(np.ones((2 * LONG_WINDOW, 2)))


def slips() -> None:
    """A stream whose kernel depends on a slip that varies."""
    plan = Exponential(1, 1e-3).plan(0.1, 2.0, VaryingSlipKernel(1e-3, 1e-6, (1e-2, 1e-1)))
    plan.run(plan.start(), np.ones(9), slip=np.full(9, 0.05))


def times() -> None:
    """Samples at nonuniform times, by exponentials and by direct summation."""
    for rule in (Exponential(3, 1e-3), Daitche(3)):
        cumulate(np.ones(5), t=[0.0, 1.0, 1.5, 3.0, 4.0], rule=rule)


def python_functions() -> None:
    """Solvers of a fun in Python, with an event."""
    for method in (Collocation(rtol=1e-4), FixedStep(0.1, Daitche(1))):
        solve(lambda t, y: -y, (0.0, 1.0), [1.0], memory=[0], coefficient=1.0, method=method, dense_output=True, events=lambda t, y: y[0] - 0.5)


def compiled_functions() -> None:
    """The collocation of a compiled fun."""
    solve(decay, (0.0, 1.0), [1.0], memory=[0], coefficient=1.0, method=Collocation(rtol=1e-4))


def spheres() -> None:
    """Particles in a flow on a grid, at given times."""
    nodes = {name: [0.0, 1.0, 2.0, 3.0] for name in ("x", "y")}
    flow = Flow.from_dataset(xarray.Dataset({name: (("x", "y"), np.zeros((4, 4))) for name in ("u", "v")}, nodes))
    sphere: dict[str, Any] = {"diameter": 1e-2, "density_ratio": 2.0, "viscosity": 1e-3}
    maxey_riley(flow, (0.0, 1.0), [[1.0, 1.0], [2.0, 1.0]], gravity=(0.0, -1.0), t_eval=[0.0, 1.0], method=Collocation(rtol=1e-4), **sphere)


def tracks() -> None:
    """Stored tracks, with the velocity of the fluid and without."""
    track = xarray.Dataset({"slip": (("obs", "component"), np.ones((9, 2)))}, {"time": ("obs", np.arange(9.0))})
    history(track, diameter=1e-3, viscosity=1e-6, density=1e3, rtol=1e-3)


TASKS: dict[str, Callable[[], None]] = {
    "streams of samples": streams,
    "streams with a slip-dependent kernel": slips,
    "samples at nonuniform times": times,
    "stored tracks": tracks,
    "particles in a flow": spheres,
    "solvers of a Python function": python_functions,
    "solvers of a compiled function": compiled_functions,
}
