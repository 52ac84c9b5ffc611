"""The state of a stream, and the checks that streams share."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset import _validate
from basset.kernels import Floats

Array = NDArray[np.float64]

LONGEST = 100_000_000  # steps of whole history: some gigabytes
MOST_STEPS = 1e15  # beyond, a float no longer counts steps


class State(NamedTuple):
    """The state of a stream: float64 arrays only. Pickle it, copy it, save it with numpy.savez(**state._asdict()).

    >>> import pickle
    >>> import basset
    >>> plan = basset.Exponential().plan(dt=0.1, horizon=10.0)
    >>> state = plan.start()
    >>> _ = plan.run(state, np.ones(50))
    >>> plan.tail(State(*pickle.loads(pickle.dumps(state)))) == plan.tail(state)
    True
    """

    samples: Array  # (components, S), unit of f per second: the newest of the current segment, a ring written twice, so that it reads contiguously
    terms: Array  # (components, T), unit of H: the exponentials
    future: Array  # (components, R), unit of H: contributions of finished segments and recent jumps to the coming nodes, a ring
    history: Array  # shape of one sample: H at the newest node
    counters: Array  # (3,): samples in the current segment, nodes so far, coming nodes with an entry in `future`


class AtNewest:
    """What any plan reads from one of its states."""

    def value(self, state: Any) -> Any:
        """H at the newest node, shape of one sample, unit of f × s^(-1/2); 0 after the first push (an initial jump counts from the next node on)."""
        return state.history.copy() if state.history.ndim else float(state.history)


class Tables(NamedTuple):
    """What the compiled loops of `_loops` read, in the order in which they take it; in units of H per unit of sample.

    `steady` is the first node at which fixed weights take the place of rows of the whole history: `short` rows, then `oldest`
    beside `interior`. An exponential loses `loss` of itself in a step and gains `gains` of the sample that enters; `entry`
    is what the oldest samples give it at node `steady`.
    """

    slots: int  # of the ring of samples
    short: Array  # (n, n)
    oldest: Array  # (n, reach)
    interior: Array  # (steady,), the newest last
    steady: int
    fixed: Array  # (slots,), the newest last
    loss: Array  # (terms,)
    gains: Array  # (terms,)
    entry: Array  # (terms, samples), the oldest first


def owned(state: Any, kind: type[Any], widths: dict[str, int]) -> None:
    """Raise for a state of another plan: compiled code would read and write beyond its arrays.

    `widths` are the expected second dimensions by name.
    """
    if not isinstance(state, kind):
        raise TypeError(f"state must be what plan.start(shape) returns, got {_validate.shown(state)}")
    for name, array in zip(state._fields, state, strict=True):
        if type(array) is not np.ndarray or array.dtype != np.float64 or not array.dtype.isnative:
            raise TypeError(f"state.{name} must be a float64 array as plan.start(shape) makes it, got {_validate.shown(array)}")
        if not (array.flags.c_contiguous and array.flags.writeable):
            raise ValueError(f"state.{name} must be contiguous and writeable, got a read-only or strided array: copy it")
    components = state.history.size
    for name, width in widths.items():
        shape = getattr(state, name).shape
        if shape != (components, width):
            raise ValueError(f"state must belong to this plan: state.{name} must have the shape {(components, width)}, got {shape}")


def shaped(shape: tuple[int, ...] | int) -> tuple[tuple[int, ...], int]:
    """The shape of one sample, and how many components it has; ValueError, TypeError if it is not made of whole numbers of 0 or more."""
    shape = shape if isinstance(shape, tuple) else (shape,)
    return shape, math.prod(_validate.integer("shape", size, 0) for size in shape)


def block_of(G: ArrayLike, shape: tuple[int, ...]) -> Array:
    """`G` as samples (steps, *shape), which need not be finite."""
    rates = G if type(G) is np.ndarray and G.dtype == np.float64 else _validate.real_array("G", G)
    if rates.ndim == 0 or rates.shape[1:] != shape:
        raise ValueError(f"G must have the shape (steps, *{shape}), got {rates.shape}")
    return rates


def steps_to(horizon: float, dt: float) -> int:
    """Whole steps that reach `horizon`; ValueError when they cannot be counted."""
    ratio = horizon / dt if horizon < math.inf else math.inf
    if not ratio <= MOST_STEPS:
        raise ValueError(f"horizon must be at most {MOST_STEPS:g} steps of dt = {dt:g} seconds, got {horizon:g}")
    return max(1, math.ceil(ratio * (1.0 - 1e-12)))


def sample_of(name: str, value: ArrayLike, shape: tuple[int, ...], number: bool = False) -> Floats:
    """`value` as one finite sample of that shape; a `number` may stand for all components."""
    sample = _validate.real_array(name, value)
    if number and sample.ndim == 0:
        sample = np.broadcast_to(sample, shape)
    if sample.shape != shape:
        raise ValueError(f"{name} must have the shape {shape} of one sample, got {sample.shape}")
    if not np.isfinite(sample).all():
        raise ValueError(f"{name} must be finite, got {sample[~np.isfinite(sample)][0]}")
    return sample


def beyond(steps: int, dt: float, node: int) -> ValueError:
    """The horizon of a plan is exceeded at that node."""
    return ValueError(f"horizon must cover the stream: it was planned for {steps} steps of {dt:g} s after the first sample, got step {node}")
