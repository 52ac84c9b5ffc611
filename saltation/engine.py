"""From numbers to flights: the tables of the collocation, shared by all grains of a kind, and the loop around `flight.fly`."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from basset.exponentials import ExponentialSum
from basset.kernels import BassetKernel, Floats, gauss_legendre
from basset.solvers import _march
from basset.solvers._graded import stages_of, step_tables
from saltation import flight

SPAN = 16.0  # d/V: the longest step
FLOOR = 1e-6  # d/V: the shortest
DEFAULT_FIRST = 0.02


class Tables:
    """Nodes and step tables of one number of stages and one sum of exponentials, filled as they are asked for."""

    def __init__(self, stages: int, tail: ExponentialSum | None) -> None:
        self.count, self.tail = stages, tail
        found = stages_of(stages)
        regular, singular = found.regular.coefficients, found.singular.coefficients[:, 1:]
        between = found.between
        constants = (found.singular.values(between)[:, 1:], found.singular.slopes(between)[:, 1:], found.regular.values(np.zeros(1))[0])
        arrays = (found.c, found.slope, found.integral, regular, singular, between, found.width, *constants)
        self.nodes = _march.Nodes(*(np.ascontiguousarray(array) for array in arrays))
        self.rise = np.ascontiguousarray(found.regular._integrals)
        terms = len(tail) if tail else 0
        rungs = math.ceil(_march.LADDER * math.log2(SPAN / FLOOR)) + 2
        shapes: list[tuple[int, ...]] = [(2,), (2, stages, terms), (terms,), (2, stages, terms), (2, stages, stages), (stages,)]
        shapes += [(stages, terms), (stages, stages), (stages,)]
        self.tables = _march.Tables(*(np.zeros((rungs, *shape)) for shape in shapes))

    def fill(self, h: float, slot: int, kind: int) -> None:
        """Make the tables of one step size."""
        tables = self.tables
        if self.tail is not None:
            past, decay, gained, local, *singular = step_tables(self.count, self.tail, BassetKernel(), h, bool(kind))
            tables.past[slot, kind], tables.decay[slot], tables.moments[slot, kind], tables.local[slot, kind] = past, decay, gained, local
            if kind:
                tables.kernel[slot], tables.between_kernel[slot], tables.between_past[slot], tables.between_local[slot] = singular
        tables.sizes[slot] = np.where(np.arange(2) == kind, h, np.where(tables.sizes[slot] == h, h, 0.0))


@lru_cache(maxsize=16)
def tables_of(stages: int, rtol: float, horizon: float | None) -> Tables:
    """Shared tables; horizon None: no memory."""
    if horizon is None:
        return Tables(stages, None)
    return Tables(stages, ExponentialSum.fit(FLOOR * 0.05, horizon, rtol))


def room(stages: int, states: int, members: int) -> flight.Work:
    """Work space of one flight."""
    shapes: list[tuple[int, ...]] = [(stages, states), (stages, states), (states, stages, stages), (stages, stages), (stages, members), (stages,), (states,)]
    shapes += [(stages, states), (1,), (stages + 1, states), (2, states), (2, states)]
    return flight.Work(*(np.zeros(shape) for shape in shapes))
