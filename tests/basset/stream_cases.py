"""The streams that the tests run over: a new scheme is found, with a window and with a fitted tail too; and exact histories to compare with."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import ArrayLike
from rule_cases import FITTED, FURTHER, KERNELS

import basset
from basset.streaming import Plan, State

BASSET = basset.BassetKernel()
DT = 0.03
WINDOW = 24  # steps, where a scheme has a window
HORIZON = 160  # steps, longer than any window

Make = Callable[[float, float, basset.Kernel], basset.Rule]


@dataclass(frozen=True)
class Stream:
    """A scheme: its rule for (dt, horizon, kernel), the degree it integrates exactly, and how it treats what is old."""

    make: Make
    degree: int
    rtol: float = 0.0  # error of the kernel beyond the window: 0 where it is exact
    forgets: bool = False  # beyond the window nothing is left
    kernels: tuple[type, ...] = (basset.Kernel,)

    @property
    def averages(self) -> bool:
        """Whether a jump of the rate is averaged at its node."""
        return self.make(DT, HORIZON * DT, BASSET).recipe(DT, HORIZON * DT, BASSET).degree == 0

    def plan(self, dt: float = DT, steps: int = HORIZON, kernel: basset.Kernel = BASSET) -> Plan:
        return self.make(dt, steps * dt, kernel).plan(dt, steps * dt, kernel)


def full(rule: basset.Rule, degree: int, rtol: float = 0.0, **kind) -> Stream:
    return Stream(lambda dt, horizon, kernel: rule, degree, rtol, **({"kernels": FITTED} if rtol else kind))


def windowed(rule: basset.Rule, degree: int, **kind) -> Stream:
    return Stream(lambda dt, horizon, kernel: basset.Windowed(rule, WINDOW * dt), degree, forgets=True, **kind)


def tailed(rule: basset.Rule, degree: int, rtol: float) -> Stream:
    def make(dt, horizon, kernel):
        return basset.Windowed(rule, WINDOW * dt, basset.ExponentialSum.fit(WINDOW * dt, horizon, rtol, kernel))

    return Stream(make, degree, rtol, kernels=FITTED)


ONLY_BASSET = {"kernels": (basset.BassetKernel,)}
STREAMS: dict[str, Stream] = {
    "euler_maclaurin": full(basset.EulerMaclaurin(), -1),
    "brush": full(basset.Brush(), -1),
    "semi_derivative": full(basset.SemiDerivative(), -1, **ONLY_BASSET),
    "hinsberg": full(basset.Hinsberg(tail=False), 1),
    **{f"daitche_{p}": full(basset.Daitche(p), p) for p in (1, 2, 3, 4, 5, 6, 10)},
    "windowed_euler_maclaurin": windowed(basset.EulerMaclaurin(), -1),
    "windowed_brush": windowed(basset.Brush(), -1),
    "windowed_semi_derivative": windowed(basset.SemiDerivative(), -1, **ONLY_BASSET),
    "windowed_hinsberg": windowed(basset.Hinsberg(tail=False).whole, 1),
    **{f"windowed_daitche_{p}": windowed(basset.Daitche(p), p) for p in (1, 2, 3, 4, 5, 6, 10)},
    "hinsberg_published": Stream(lambda dt, horizon, kernel: basset.Hinsberg(WINDOW * dt), 1, 2e-2, **ONLY_BASSET),
    "hinsberg_fitted": Stream(
        lambda dt, horizon, kernel: basset.Hinsberg(WINDOW * dt, basset.ExponentialSum.fit(WINDOW * dt, horizon, 1e-9, kernel)), 1, 1e-9, kernels=FITTED
    ),
    **{f"tailed_daitche_{p}": tailed(basset.Daitche(p), p, 1e-12) for p in (1, 2, 3, 4, 5, 6, 10)},
    "tailed_euler_maclaurin": tailed(basset.EulerMaclaurin(), -1, 1e-12),
    "tailed_brush": tailed(basset.Brush(), -1, 1e-12),
    "tailed_daitche_3_rough": tailed(basset.Daitche(3), 3, 1e-3),
    **{f"exponential_{p}": full(basset.Exponential(p, 1e-12), p, rtol=1e-12) for p in (1, 2, 3, 4, 5, 6, 10)},
    "exponential_3_rough": full(basset.Exponential(3, 1e-3), 3, rtol=1e-3),
}
for name, rule in FURTHER.items():
    tail = rule.recipe(DT, HORIZON * DT, BASSET).tail
    STREAMS[name] = full(rule, -1, rtol=0.0 if tail is None else tail.rtol)
    STREAMS |= {f"windowed_{name}": windowed(rule.whole, -1), f"tailed_{name}": tailed(rule.whole, -1, 1e-12)}


def chosen(names: Iterable[str]) -> pytest.MarkDecorator:
    names = list(names)
    return pytest.mark.parametrize("stream", [STREAMS[name] for name in names], ids=names)


def with_kernels(names: Iterable[str], accepted: bool = True) -> pytest.MarkDecorator:
    """(stream, kernel) for every kernel that the scheme has a form for; or, not accepted, has none for."""
    pairs = [(name, kernel) for name in names for kernel in KERNELS if isinstance(KERNELS[kernel], STREAMS[name].kernels) == accepted]
    return pytest.mark.parametrize(("stream", "kernel"), [(STREAMS[a], KERNELS[b]) for a, b in pairs], ids=["-".join(pair) for pair in pairs])


ENDLESS = [name for name, stream in STREAMS.items() if stream.forgets or name == "hinsberg_published"]
BOUNDED = [name for name in STREAMS if name not in ENDLESS]

every_stream = chosen(STREAMS)
polynomial_streams = chosen(name for name, stream in STREAMS.items() if stream.degree >= 1)
baselines = chosen(name for name, stream in STREAMS.items() if stream.averages)
Rate = np.ndarray | Callable[[np.ndarray], np.ndarray]
NODES, SHARES = np.polynomial.legendre.leggauss(24)


def history(t: ArrayLike, pieces: Iterable[tuple[float, float, Rate]], jumps: Iterable[tuple[float, float]] = (), window: float = np.inf) -> np.ndarray:
    """Exact H(t) for the standard kernel: polynomial rates on [a, b], jumps (time, size). What is older than the window is left out.

    In σ = √(t − τ) everything is a polynomial, which Gauss–Legendre integrates to rounding. Rates are coefficients in τ, lowest
    first, or functions of τ.
    """
    t = np.asarray(t, dtype=np.float64)
    total = np.zeros(t.shape)
    for a, b, rate in pieces:
        low, high = np.minimum(b, t), np.maximum(a, t - window)
        on = low > high
        near, far = np.sqrt(t[on] - low[on])[:, None], np.sqrt(t[on] - high[on])[:, None]
        times = t[on][:, None] - (0.5 * (near + far) + 0.5 * (far - near) * NODES) ** 2
        total[on] += (far - near)[:, 0] * ((rate(times) if callable(rate) else np.polynomial.polynomial.polyval(times, rate)) @ SHARES)
    for time, size in jumps:
        on = (t > time) & (t - time <= window * (1.0 + 1e-9))
        total[on] += size / np.sqrt(t[on] - time)
    return total[()]


def same(first: State, second: State) -> bool:
    """Bit for bit."""
    return all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


def copied(state: State) -> State:
    return State(*(array.copy() for array in state))
