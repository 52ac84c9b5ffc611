"""What the equation reads: velocity, derivatives and drag law as something to call, numbers and grids, for one thread at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from basset._compile import c_function, compiler, is_compiled, jit
from basset.kernels import Floats
from basset.particles import _equation as eq
from basset.particles._grid import fields_of, read_grid
from basset.particles.flow import Flow
from basset.solvers.base import returned


@dataclass(frozen=True)
class Sources:
    """The flow and the drag law as given, the numbers of the equation."""

    dimensions: int
    velocity: Any  # callable or Flow
    gradient: Any
    material_derivative: Any
    drag: Any  # a name or a callable
    lift: Any
    numbers: Floats

    @cached_property
    def fast(self) -> bool:
        """Whether everything is compiled."""
        given = [one for one in (self.gradient, self.material_derivative, self.drag) if callable(one)]
        flow = isinstance(self.velocity, Flow) and jit()
        return all(map(is_compiled, given if flow else [self.velocity, *given]))

    def bound(self) -> tuple[Floats, Any]:
        """The work space for a thread, and what it has to keep alive."""
        d, work = self.dimensions, eq.work_space()
        words = np.asarray(work)[eq.WORDS].view(np.int64)
        work[eq.NUMBERS, : len(self.numbers)] = self.numbers
        words[eq.DIMENSIONS] = d
        words[eq.DRAG] = {"stokes": eq.STOKES, "schiller_naumann": eq.SCHILLER_NAUMANN}.get(self.drag if isinstance(self.drag, str) else "", eq.OWN)
        words[eq.LIFTS] = self.lift is not None
        velocity, gradient, material = self.velocity, self.gradient, self.material_derivative
        if isinstance(velocity, Flow):
            if self.fast:
                read_grid(velocity, words)
            else:
                gradient, material = velocity.gradient, velocity.material_derivative
        words[eq.HAS_GRADIENT], words[eq.HAS_MATERIAL] = gradient is not None, material is not None
        laws = (velocity, d), (gradient, d * d), (material, d), (self.drag, 1)
        kept: list[Any] = []
        if self.fast:
            functions = np.asarray(work)[eq.FUNCTIONS].view(np.int64).reshape(-1, 2)
            for k, (law, size) in enumerate(laws):
                if callable(law) and not isinstance(law, Flow):
                    kept.append(np.zeros(size, dtype=np.int64))
                    made = _flattened(law) if k == eq.OF_GRADIENT else _of_number(law) if k == eq.OF_DRAG else law
                    functions[k] = c_function(made, (), kept[-1], k == eq.OF_DRAG)
        else:
            work.functions = [None] * len(laws)
            what = f"{d} components", f"{d} x {d} entries", f"{d} components", "a number"
            names = "velocity", "gradient", "material_derivative", "drag"
            for k, (law, _) in enumerate(laws):
                if callable(law):
                    shape = ((d,), (d, d), (d,), ())[k]
                    work.functions[k] = partial(_filled, law, f"{names[k]} must return {what[k]}", shape)
        return np.asarray(work) if self.fast else work, kept

    @cached_property
    def own(self) -> tuple[Floats, Any]:
        """The work space of the main thread."""
        return self.bound()

    @property
    def motion(self) -> Callable[..., Any]:
        """The right-hand side without history."""
        return eq.compiled_motion if self.fast else eq.motion_with

    @property
    def leaves(self) -> Callable[..., Any] | None:
        """The event function of a bounded grid."""
        flow = self.velocity
        if not isinstance(flow, Flow) or not np.isfinite(flow.bounds[1:]).any():
            return None
        return eq.compiled_within if self.fast else partial(_within, flow)

    def watched(self, event: Any, jump: Any) -> tuple[Any, Any]:
        """A user's event function and jump of (t, position, velocity) as functions of the state."""
        if self.fast and is_compiled(event) and (jump is None or is_compiled(jump)):
            return _watching(event), None if jump is None else _leaping(jump)
        located = eq.compiled_located if self.fast else eq.located_with
        return partial(_seen, located, event), None if jump is None else partial(_leapt, located, jump)


def checked(what: str, given: Any, shape: tuple[int, ...]) -> Floats:
    """What a callable of the user's gave: an array of that shape."""
    flat = np.asarray(given)
    if flat.shape != shape:
        raise ValueError(f"{what}, got shape {flat.shape}")
    return returned(what, flat.reshape(-1), flat.size)


def _filled(law: Any, what: str, shape: tuple[int, ...], t: float, y: Any, out: Any, own: Any) -> None:
    """A callable of the user's as something that `call` can call."""
    size = len(shape) and shape[0]
    found = checked(what, law(t, y[:size].copy()) if size else law(float(y[0])), shape)
    out[: len(found)] = found


@lru_cache(maxsize=64)
def _flattened(gradient: Any) -> Any:
    """Compiled: the entries of a compiled gradient in a row."""

    def flattened(t, x):
        return gradient(t, x).ravel()

    return compiler().njit(flattened)


@lru_cache(maxsize=64)
def _of_number(law: Any) -> Any:
    """Compiled: a compiled drag law of the one number in x."""

    def of_number(t, x):
        return law(x[0])

    return compiler().njit(of_number)


@lru_cache(maxsize=64)
def _watching(event: Any) -> Any:
    located, place, at = eq.compiled_located, eq.PLACE, eq.VELOCITY

    def watching(t, y, work, length, speed):
        located(t, y, work, length, speed)
        d = len(y) // 2
        return event(t, work[place, :d].copy(), work[at, :d].copy())

    return compiler().njit(watching)


@lru_cache(maxsize=64)
def _leaping(jump: Any) -> Any:
    located, place, at, fluid, out = eq.compiled_located, eq.PLACE, eq.VELOCITY, eq.FIELD, eq.RATES

    def leaping(t, y, work, length, speed):
        located(t, y, work, length, speed)
        d = len(y) // 2
        after = jump(t, work[place, :d].copy(), work[at, :d].copy())
        for a in range(d):
            work[out, a] = y[a]
            work[out, d + a] = y[d + a] if after[a] == work[at, a] else (after[a] - work[fluid, a]) / speed
        return work[out, : 2 * d]

    return compiler().njit(leaping)


def _seen(located: Any, event: Any, t: float, y: Floats, work: Any, length: float, speed: float) -> Any:
    located(t, y, work, length, speed)
    d = len(y) // 2
    return event(t, np.array(work[eq.PLACE, :d]), np.array(work[eq.VELOCITY, :d]))


def _leapt(located: Any, jump: Any, t: float, y: Floats, work: Any, length: float, speed: float) -> Floats:
    located(t, y, work, length, speed)
    d = len(y) // 2
    after = jump(t, np.array(work[eq.PLACE, :d]), np.array(work[eq.VELOCITY, :d]))
    after = checked(f"jump must return {d} components of the velocity after it", after, (d,))
    slips = np.where(after == work[eq.VELOCITY, :d], y[d:], (after - work[eq.FIELD, :d]) / speed)  # to the last digit: what does not jump has no infinite force
    return np.concatenate([y[:d], slips])


def _within(flow: Flow, t: float, y: Floats, work: Any, length: float, speed: float) -> float:
    x, (low, high) = length * y[: flow.dimensions], flow.bounds[1 : 1 + flow.dimensions].T
    return float(np.minimum(x - low, high - x).min()) / length


def fields_at(sources: Sources, t: float, places: Floats) -> Floats:
    """u, ∇u and Du/Dt at many places at one time."""
    found = fields_of(sources.own[0], np.full(len(places), t), places, sources.fast)
    d = sources.dimensions
    for name, part in (("velocity", found[:, :d]), ("material_derivative", found[:, eq.MATERIAL_AT : eq.MATERIAL_AT + d]), ("gradient", found)):
        if not np.isfinite(part).all():
            j = int(np.flatnonzero(~np.isfinite(part).all(axis=1))[0])
            raise ValueError(f"{name} must be finite around the position of every particle, got {found[j, :d]} m/s at {places[j]} at t = {t:g}")
    return found


def tried(sources: Sources, t: float, x: Floats) -> None:
    """Call what compiled code will call once from Python, where errors are told."""
    d = sources.dimensions
    if not isinstance(sources.velocity, Flow):
        checked(f"velocity must return {d} components", sources.velocity(t, x.copy()), (d,))
    for name, law, shape in (("gradient", sources.gradient, (d, d)), ("material_derivative", sources.material_derivative, (d,))):
        if law is not None:
            checked(f"{name} must return an array of shape {shape}", law(t, x.copy()), shape)
    if callable(sources.drag):
        found = checked("drag must return a number, by which Stokes's drag is multiplied", sources.drag(0.0), ())
        if not np.isfinite(found).all():
            raise ValueError(f"drag must be finite at Re = 0, got {found[0]}; it is what Stokes's drag is multiplied by, C_D Re/24")
