"""Paths as a dataset: positions, velocities and forces by kind, with units; netCDF through SciPy, which knows no int64."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from basset.particles import _equation as eq
from basset.particles._grid import fields_of
from basset.particles._march import LEFT, STATUSES, Paths, Swarm

if TYPE_CHECKING:
    import xarray

MEANINGS = {-1: "failure", 0: "end_reached", 1: "terminal_event", 2: "at_rest", LEFT: "left_the_grid"}


def coordinate(name: str, values: Any, attributes: dict[str, str] | None = None) -> tuple[Any, Any]:
    """A coordinate with its index."""
    import xarray

    made = xarray.IndexVariable(name, values, attributes)  # type: ignore[no-untyped-call]  # xarray leaves it so
    return made, xarray.indexes.PandasIndex(made, name)


@lru_cache(maxsize=32)
def labels(name: str, values: tuple[str, ...] | range) -> tuple[Any, Any]:
    """A coordinate of words or of numbers from 0: to index them took a third of a dataset's time."""
    return coordinate(name, np.array(values) if isinstance(values, tuple) else np.arange(len(values), dtype=np.int32))


def dataset(paths: Paths, swarm: Swarm, history: bool, mass: float, attributes: dict[str, Any]) -> xarray.Dataset:
    """The result; `mass` of the displaced fluid, kg."""
    import xarray

    d, sources = swarm.sources.dimensions, swarm.sources
    length, speed = swarm.scales[:, 0, None, None], swarm.scales[:, 1, None, None]
    places, slips = paths.states[..., :d] * length, paths.states[..., d:] * speed
    work = sources.own[0]
    velocities = np.full_like(places, np.nan)
    forces = np.full((len(eq.KINDS), *places.shape), np.nan)
    (eq.forces if sources.fast else eq.forces_with)(paths.times, places, slips, paths.histories * speed, work, mass, velocities, forces)
    acting = [k for k, kind in enumerate(eq.KINDS) if not ((kind == "lift" and sources.lift is None) or (kind == "history" and not history))]
    path = ("particle", "time", "component")

    def variable(dims: tuple[str, ...], values: Any, units: str, name: str) -> xarray.Variable:
        return xarray.Variable(dims, values, {"units": units, "long_name": name})

    fields: dict[str, Any] = {
        "position": variable(path, places, "m", "position"),
        "velocity": variable(path, velocities, "m s-1", "velocity of the particle"),
        "slip": variable(path, slips, "m s-1", "velocity of the particle less the fluid's"),
        "force": variable(("kind", *path), forces[acting], "N", "force on the particle"),
        "end_time": variable(("particle",), paths.ends, "s", "time at which the particle's path ends"),
        "status": (("particle",), paths.status, {
            "long_name": "how the path ended", "flag_values": np.array(list(MEANINGS), dtype=np.int32), "flag_meanings": " ".join(MEANINGS.values()),
        }),
    }  # fmt: skip
    if swarm.task.events:
        seen = paths.occurrences
        kept_ones = [k for k, number in enumerate(seen.event) if number != swarm.leaves]
        states = np.array([seen.state[k] for k in kept_ones]).reshape(len(kept_ones), 2 * d)
        whose = np.array([seen.particle[k] for k in kept_ones], dtype=np.int32)
        times = np.array([seen.time[k] for k in kept_ones])
        where, slip = states[:, :d] * swarm.scales[whose, :1], states[:, d:] * swarm.scales[whose, 1:]
        found = fields_of(work, times, where, sources.fast)
        one = ("occurrence",)
        fields |= {
            "event_time": variable(one, times, "s", "when it happened"),
            "event_number": (one, np.array([seen.event[k] for k in kept_ones], dtype=np.int32), {"long_name": "which of the events"}),
            "event_particle": (one, whose, {"long_name": "to which particle"}),
            "event_position": variable((*one, "component"), where, "m", "where it happened"),
            "event_velocity": variable((*one, "component"), found[:, :d] + slip, "m s-1", "velocity of the particle before any jump"),
        }
    made = (
        coordinate("time", paths.times, {"units": "s", "long_name": "time"}), labels("particle", range(len(places))),
        labels("component", tuple("xyz"[:d])), labels("kind", tuple(eq.KINDS[k] for k in acting)),
    )  # fmt: skip
    coordinates = xarray.Coordinates({one.name: one for one, _ in made}, {one.name: index for one, index in made})
    failures = "; ".join(f"particle {j}: {message}" for j, message in list(paths.messages.items())[:10])
    about = {"title": "Motion of spheres in a flow (Maxey & Riley 1983)", "comment": "SI units", "statuses": " ".join(STATUSES.values())}
    return xarray.Dataset(fields, coordinates, about | attributes | ({"failures": failures} if failures else {}))
