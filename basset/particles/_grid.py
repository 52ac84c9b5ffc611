"""A flow on a grid as the equation reads it."""

from __future__ import annotations

from typing import Any

import numpy as np

from basset._compile import jit
from basset.kernels import Floats
from basset.particles import _equation as eq


def read_grid(flow: Any, words: Any) -> None:
    """Where a flow's tables lie."""
    words[eq.GRIDDED] = 1
    words[eq.AXES], words[eq.KNOTS] = flow.table.ctypes.data, flow.knots.ctypes.data
    words[eq.COEFFICIENTS], words[eq.BOUNDS] = flow.coefficients.ctypes.data, flow.bounds[1:].ctypes.data


def gridded(flow: Any) -> Floats:
    """The work space for a flow alone."""
    work = eq.work_space()
    words = np.asarray(work)[eq.WORDS].view(np.int64)
    words[eq.DIMENSIONS] = flow.dimensions
    read_grid(flow, words)
    return np.asarray(work) if jit() else work


def fields_of(work: Any, times: Floats, places: Floats, fast: bool = True) -> Floats:
    """u, ∇u and Du/Dt at many points, see `_equation.fields`."""
    out = np.zeros((len(places), eq.MATERIAL_AT + 3))
    (eq.fields if fast else eq.fields_with)(times, np.ascontiguousarray(places), work, out)
    return out
