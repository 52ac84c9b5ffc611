"""The history force along pieces of tracks, and its share of the forces of the fluid."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from basset import __version__, _validate
from basset.kernels import Floats, Kernel, checked_kernel
from basset.particles._equation import schiller_naumann
from basset.quadrature import Exponential
from basset.streaming.uneven import Planned, planned
from basset.weights._slopes import rates
from basset.weights.uneven import HIGHEST

ABRUPT = 2000.0  # ratio of steps beside each other: slopes magnify errors of samples by as much
TOGETHER = 32  # tracks with the same times: their terms stay in the cache


@dataclass(frozen=True)
class Particle:
    """A sphere in its fluid, and how its history is computed; see `history`."""

    diameter: float
    viscosity: float
    density: float | None
    density_ratio: float | None
    kernel: Kernel
    order: int
    rtol: float
    drag: str
    before: str
    gaps: str

    def __post_init__(self) -> None:
        for name, unit in (("diameter", "m"), ("viscosity", "m²/s"), ("density", "kg/m³"), ("density_ratio", "")):
            if (value := getattr(self, name)) is not None or name in ("diameter", "viscosity"):
                object.__setattr__(self, name, _validate.positive(name, value, unit))
        if (self.density is None) == (self.density_ratio is None):
            raise ValueError(
                "one of density (of the fluid, kg/m³: the force in N) and density_ratio (the force per mass of the particle, m/s²) must be given, "
                f"got {'none' if self.density is None else 'both'}"
            )
        for name, options in (("drag", ("stokes", "schiller_naumann")), ("before", ("rest", "steady")), ("gaps", ("raise", "bridge", "split"))):
            _validate.choice(name, getattr(self, name), options)
        _validate.integer("order", self.order, 1, HIGHEST)
        Exponential(self.order, self.rtol)  # checks it
        checked_kernel(self.kernel)

    @property
    def degree(self) -> int:
        """Of the polynomials whose slopes are the rates: even, so that they are centred, and no less exact than the integrals."""
        return 2 * (self.order // 2 + 1)

    def plan(self, shortest: float, longest: float) -> Planned:
        """One sum for all tracks, so that none depends on the others of its chunk; from the shortest step and the longest duration, in seconds."""
        horizon = longest * (1.0 + 1e-9) or 1.0
        found = planned(self.kernel, self.rtol, min(shortest, horizon) * (1.0 - 1e-6), horizon)  # steps differ by rounding
        if shortest < found.tail.near:
            raise ValueError(
                "times must rise by {} s or more for tracks as long as these, got a step of {} s".format(*_validate.apart(found.tail.near, shortest))
            )
        return found

    def forces(self, slip: Floats, rate: Floats, fluid: Floats | None, memory: Floats) -> tuple[Floats, Floats]:
        """The history force (n, components) and its share (n,), from slip, its rate, the fluid's acceleration along the track, and H."""
        with np.errstate(invalid="ignore", over="ignore"):
            found = (-9.0 / self.diameter * math.sqrt(self.viscosity / math.pi)) * memory  # per mass of the displaced fluid
            total = found - 0.5 * rate
            drag: Any = 18.0 * self.viscosity / self.diameter**2
            if self.drag == "schiller_naumann":
                drag = drag * schiller_naumann(np.sqrt((slip * slip).sum(axis=1, keepdims=True)) * (self.diameter / self.viscosity))
            total -= drag * slip
            if fluid is not None:
                total += fluid
            size, whole = np.sqrt((found * found).sum(axis=1)), np.sqrt((total * total).sum(axis=1))
            share = np.where(np.isinf(size), 1.0, np.where(size == 0.0, 0.0, size / whole))
        mass = self.density * math.pi / 6.0 * self.diameter**3 if self.density is not None else 1.0 / (self.density_ratio or 1.0)
        return mass * found, share

    def attributes(self, moving: bool) -> dict[str, Any]:
        """What a result says of itself."""
        given = {name: value for name in ("diameter", "viscosity", "density", "density_ratio") if (value := getattr(self, name)) is not None}
        total = "drag, added mass (0.5 of the displaced fluid's) and history" + (", and pressure gradient with du/dt along the track for Du/Dt" * moving)
        return given | {
            "title": "History force along tracks", "Conventions": "CF-1.11", "kernel": repr(self.kernel), "rule": repr(Exponential(self.order, self.rtol)),
            "drag": self.drag, "before": self.before, "gaps": self.gaps, "basset_version": __version__,
            "total": f"sum of the forces of the fluid that are known here: {total}",
        }  # fmt: skip


@dataclass(frozen=True)
class Samples:
    """Samples (n, components) of a chunk without gaps, their places in the chunk, and where pieces of tracks begin, with the end."""

    places: Any
    times: Floats
    slip: Floats
    fluid: Floats | None
    bounds: Any


def slopes(times: Floats, values: Floats, bounds: Any, degree: int) -> Floats:
    """Rates of values (n, components) along each piece."""
    found = np.empty_like(values)
    rates(times, values, bounds, degree, found)
    return found


def forces(found: Samples, particle: Particle, plan: Planned) -> tuple[Floats, Floats]:
    """The history force (n, components) and its share (n,)."""
    rate = slopes(found.times, found.slip, found.bounds, particle.degree)
    fluid = None if found.fluid is None else slopes(found.times, found.fluid, found.bounds, particle.degree)
    memory = np.empty_like(rate)
    first = found.slip[found.bounds[:-1]]
    start = first if particle.before == "rest" else np.zeros_like(first)
    for pieces in _alike(found.times, found.bounds):
        begins, ends = found.bounds[pieces], found.bounds[pieces + 1]
        times = found.times[begins[0] : ends[0]] - found.times[begins[0]]
        by_slips = _abrupt(times)
        samples, together = found.slip if by_slips else rate, np.zeros((len(times), len(pieces), rate.shape[1]))
        for k, (low, high) in enumerate(zip(begins, ends, strict=True)):
            together[: high - low, k] = samples[low:high]
        columns = together.reshape(len(times), -1)
        integrals, terms = np.zeros_like(columns), np.zeros((columns.shape[1], len(plan.tail)))
        plan.advance(particle.order, by_slips, times, columns, 1, 0, start[pieces].ravel(), terms, integrals)
        integrals = integrals.reshape(together.shape)
        for k, (low, high) in enumerate(zip(begins, ends, strict=True)):
            memory[low:high] = integrals[: high - low, k]
    with np.errstate(invalid="ignore"):
        memory[found.bounds[:-1]] = np.where(start == 0.0, 0.0, start * particle.kernel(0.0))
    return particle.forces(found.slip, rate, fluid, memory)


def _abrupt(times: Floats) -> bool:
    """Whether slopes would magnify errors of samples: H then comes from the slips themselves."""
    steps = np.diff(times)
    return bool((np.maximum(steps[1:], steps[:-1]) > ABRUPT * np.minimum(steps[1:], steps[:-1])).any())


def _alike(times: Floats, bounds: Any) -> Iterator[Any]:
    """Pieces in groups of which none is longer than the first, and all begin at its times after the start."""
    groups: dict[float, list[int]] = {}
    for piece in np.argsort(-np.diff(bounds), kind="stable"):
        own = times[bounds[piece] : bounds[piece + 1]] - times[bounds[piece]]
        group = groups.setdefault(float(own[1]) if len(own) > 1 else 0.0, [])
        if group:
            begin = bounds[group[0]]
            if not np.array_equal(own, times[begin : begin + len(own)] - times[begin]):
                yield np.array([piece])
                continue
        group.append(piece)
        if len(group) == TOGETHER:
            yield np.array(group)
            group.clear()
    yield from (np.array(group) for group in groups.values() if group)
