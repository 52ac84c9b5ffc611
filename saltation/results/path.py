"""The path of one grain with the forces on it, from the recorded steps of its flights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.polynomial import legendre

from basset._compile import placed
from basset.kernels import Floats
from basset.solvers import stepper
from saltation.flight import equations
from saltation.flight.layout import SHORTEST_FLIGHT
from saltation.results.tables import attributes_of

if TYPE_CHECKING:
    from saltation.flight.setup import Engine


def path_of(engine: Engine, record: stepper.Record | None, spins: Floats) -> xr.Dataset:
    """The path from the recorded steps: at every takeoff and at the nodes of every step up to where it was cut; the start alone where none was flown."""
    tables = engine.tables
    count = tables.count
    if record is not None:
        which = np.cumsum(np.append(0, record.leapt[:-1] > 0.0))  # flight of each step
        length = np.bincount(which, record.share * record.size)
        flown = (record.share > 0.0) & ((length > SHORTEST_FLIGHT)[which] | (which == which[-1]))  # a rebound may leave no flight at all, but for rounding
    if record is None or not flown.any():
        start = engine.first()
        state = engine.state_of(start, engine.own_of(start.spin, 0))[None]
        return path_at(engine, np.zeros(1), state, np.full_like(state, np.nan), np.array([start.spin]))
    which = which[flown]
    record = stepper.Record(*(array[flown] for array in record))
    singular = record.kind == 1.0
    takeoff = np.zeros(len(record.start), dtype=bool)
    takeoff[0] = True
    takeoff[1:] = record.leapt[:-1] > 0.0
    theta = record.share[:, None] * np.concatenate([[0.0], tables.nodes.c])  # (step, place)
    x = 2.0 * np.where(singular[:, None], np.sqrt(theta), theta) - 1.0
    basis = legendre.legvander(x, count)  # (step, place, degree)
    rises = np.where(singular[:, None, None], tables.nodes.singular, record.size[:, None, None] * tables.nodes.rise)
    states = record.y[:, None, :] + np.einsum("spd,sdk,ska->spa", basis, rises, record.values, optimize=True)
    states[:, 0] = record.y
    slopes = np.zeros((len(theta), count, count))  # of the node values, at the places behind the first
    regular = ~singular
    slopes[regular] = np.einsum("spd,dk->spk", basis[regular, 1:, :count], tables.nodes.regular)
    inner = legendre.legvander(x[singular, 1:], count - 1)
    derivative = 2.0 * legendre.legder(tables.nodes.singular)  # of the basis in σ
    slopes[singular] = np.einsum("spd,dk->spk", inner, derivative) / (2.0 * np.sqrt(theta[singular, 1:]) * record.size[singular, None])[..., None]
    rates = np.full_like(states, np.nan)
    rates[:, 1:] = np.einsum("spk,ska->spa", slopes, record.values, optimize=True)
    times = record.start[:, None] + record.size[:, None] * theta
    wanted = np.ones(theta.shape, dtype=bool)
    wanted[:, 0] = takeoff
    return path_at(engine, times[wanted], states[wanted], rates[wanted], spins[np.broadcast_to(which[:, None], wanted.shape)[wanted]])


def path_at(engine: Engine, times: Floats, states: Floats, rates: Floats, spins: Floats) -> xr.Dataset:
    """The path from times (points,), states and their rates (points, states), rates NaN where unknown; `spins` (points, 3) where they are no states."""
    d = engine.dimensions
    if engine.rotation is not None:
        spins = np.zeros((len(times), 3))
        spins[:, [1] if d == 2 else [0, 1, 2]] = states[:, 2 * d : 2 * d + engine.spins]
    stream, shear = np.array([engine.scene.profile.velocity_and_shear(z) for z in states[:, d - 1]]).T
    slip = np.zeros((len(times), 3))
    slip[:, [0, 2] if d == 2 else [0, 1, 2]] = states[:, d : 2 * d]
    situations = np.column_stack([states[:, d - 1], slip, stream, shear, spins])
    forces = np.zeros((len(times), 3 * len(engine.force_names)))
    equations.budget(engine.equation, situations, forces)
    velocity, beside = slip.copy(), np.zeros((len(times), 9))  # the fluctuation, its rate along the path, and the fluid's acceleration
    velocity[:, 0] += stream
    if engine.eddies is not None:
        equations.beside(placed(engine.model), np.ascontiguousarray(states), engine.own_of((0.0, 0.0, 0.0), 0), beside)
        velocity += beside[:, :3]
    columns: dict[str, Any] = {"x": (states[:, 0], "d", "along the stream")}
    if d == 3:
        columns["y"] = states[:, 1], "d", "across the stream"
    columns["z"] = states[:, d - 1], "d", "above the bed level"
    columns["u"] = velocity[:, 0], "u*", "velocity along the stream"
    if d == 3:
        columns["v"] = velocity[:, 1], "u*", "velocity across the stream"
    columns["w"] = velocity[:, 2], "u*", "velocity up"
    if engine.scene.turns:
        for k, axis in enumerate("xyz"):
            if d == 3 or axis == "y":
                columns[f"spin_{axis}"] = spins[:, k], "u*/d", f"angular velocity about {axis}"
    axes = {"x": 0, "y": 1, "z": 2} if d == 3 else {"x": 0, "z": 2}
    for axis, place in axes.items() if engine.eddies is not None else ():
        columns[f"eddy_{axis}"] = beside[:, place], "u*", f"fluctuation of the stream, {axis}"
    for k, name in enumerate(engine.force_names):
        for axis, place in axes.items():
            columns[f"{name}_{axis}"] = forces[:, 3 * k + place], "u*2/d", f"acceleration by {name}"
    pressure = np.zeros((len(times), 3))
    if engine.eddies is not None:
        pressure = engine.numbers.alpha * beside[:, 6:]
        for axis, place in axes.items():
            columns[f"turbulence_{axis}"] = pressure[:, place], "u*2/d", "acceleration by that of the fluid"
    if engine.members:
        acceleration = rates[:, d : 2 * d].copy()
        acceleration[:, 0] += shear * (slip[:, 2] + beside[:, 2])
        if engine.eddies is not None:
            acceleration += (beside[:, 3:6] - pressure)[:, list(axes.values())]
        told = "acceleration by the history force (NaN at takeoff: infinite)"
        for k, (axis, place) in enumerate(axes.items()):
            columns[f"history_{axis}"] = acceleration[:, k] - forces[:, place::3].sum(axis=1), "u*2/d", told
    data = {name: ("time", values, attributes_of(engine.scene, unit, text)) for name, (values, unit, text) in columns.items()}
    numbers = engine.numbers
    coordinate = ("time", times, attributes_of(engine.scene, "d/u*", "time"))
    return xr.Dataset(data, coords={"time": coordinate}, attrs={"diameter": numbers.diameter, "velocity": numbers.velocity})
