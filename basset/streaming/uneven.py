"""The history at any times by a sum of exponentials: constant memory and time per sample, whatever the steps.

K is replaced by a sum from the lag `near` on, which is no longer than a step. What is left of K, up to there, lies within the newest panel, where its moments
are numbers of the plan. An exponential takes in a panel by the moments of its decay over it, once the polynomial of the panel is known: with
the next sample. The first panel of a segment has a polynomial of its last degree one sample later, and is corrected then.
Recursion: van Hinsberg et al. (2011), J. Comput. Phys. 230, 1465; at any times: this library.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from basset.exponentials import ExponentialSum
from basset.kernels import Floats, Kernel, MeiAdrianKernel
from basset.streaming._uneven import decays, run
from basset.weights.uneven import pieces, row


def local_moments(kernel: Kernel, tail: ExponentialSum) -> Floats:
    """∫ (K − sum) (s/near)^m ds up to the lag at which the sum begins, m = 0 … 3: (4,), s^(1/2)."""
    x, w = kernel.rule(0.0, tail.near)
    total = np.empty(4)
    decays(np.array(tail.weights), np.array(tail.rates), tail.near, np.empty((6, len(tail))), total)
    return np.asarray(w @ x[:, None] ** np.arange(4) - total)


def least_near(kernel: Kernel, far: float) -> float:
    """The shortest lag from which a sum can be had that reaches `far` seconds, in seconds."""
    shortest = far * 1e-12
    if isinstance(kernel, MeiAdrianKernel) and math.isfinite(kernel.bend):
        return max(shortest, 1e-12 * kernel.bend) * (1.0 + 1e-9)
    return shortest * (1.0 + 1e-9)


@lru_cache(maxsize=64)
def planned(kernel: Kernel, rtol: float, near: float, far: float) -> tuple[ExponentialSum, Floats]:
    """The sum from `near` to `far`, and `local_moments`."""
    tail = ExponentialSum.fit(near, far, rtol, kernel)
    return tail, local_moments(kernel, tail)


def halved(x: float, up: bool) -> float:
    """The next power of √2: paths of about the same steps and length then have one sum."""
    return float(2.0 ** ((math.ceil if up else math.floor)(2.0 * math.log2(x)) / 2.0))


def trajectory(t: Floats, g: Floats, order: int, rtol: float, kernel: Kernel, slip: bool, leaps: Floats) -> Floats:
    """H at all nodes for samples (nodes, components) at rising times from 0 on, without what is infinite at a jump; arguments as `pieces`.

    Parameters
    ----------
    t : ndarray (nodes,), seconds
    g : ndarray (nodes, components), unit of f per second, or of f
    order : int
    rtol : float, dimensionless
    kernel : Kernel
    slip : bool
    leaps : ndarray (nodes, components), unit of f

    Returns
    -------
    ndarray (nodes, components), unit of f × s^(-1/2)
    """
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    history = np.zeros_like(g)
    if not len(steps):
        return history
    far = halved(float(t[-1]), up=True)
    near = max(halved(float(steps.min()), up=False), least_near(kernel, far))
    far = max(far, 2.0 * near)
    tail, local = planned(kernel, rtol, near, far)
    weights, rates = np.array(tail.weights), np.array(tail.rates)
    terms = leaps[0][:, None] * weights
    room = (np.empty((6, len(tail))), np.empty((6, len(tail))), np.empty(4), np.empty(2), np.empty(2, dtype=np.int64), np.empty(4), np.empty((g.shape[1], 4)))
    run(t, g, 1, 0, order, slip, weights, rates, near, local, terms, history, *room)
    shorter = np.flatnonzero((np.diff(t) < near) & (np.diff(t) > 0.0)) + 1
    if len(shorter):  # K beyond the newest panel
        made = pieces(t, g, order, slip, leaps)
        for n in shorter:
            history[n] = row(made, int(n), kernel)
    return history
