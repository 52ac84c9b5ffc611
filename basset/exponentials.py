"""Kernels as sums of decaying exponentials: published sets, and the shortest sum that keeps a promised error.

K(s) ≈ Σ a_i exp(−λ_i s) on [near, far], all a_i and λ_i positive. The fitted sums are minimax sums: no other sum with as
many terms has a smaller maximum relative error. For the homogeneous kernel only far/near matters, so one table, made by
`bench/tables/minimax_sums.py`, serves every window and horizon; its law is error ≈ 2.7 exp(−π² n / ln(4 far/near)). The
finite-Reynolds kernels are self-similar in x = C^(2/3) s and have tables over (x_near, x_far). Other kernels: `basset.positive_sums`.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel, MeiAdrianKernel, checked_interval, checked_kernel, checked_lags
from basset.positive_sums import FLOOR, positive_sum

_SLACK = 1.0 + 1e-9  # rounding of near, far and their ratio


@dataclass(frozen=True, eq=False)
class ExponentialSum:
    """K(s) ≈ Σ weights·exp(−rates·s) on [near, far].

    Attributes
    ----------
    weights : ndarray (terms,), s^(-1/2)
        Positive.
    rates : ndarray (terms,), 1/s
        Positive, ascending.
    near, far : float, seconds
        The lags for which the sum was made; far is infinite for published sets.
    kernel : Kernel
        The kernel that the sum approximates.
    rtol : float, dimensionless, or None
        The promised relative error on [near, far]; None for published sets, which promise none.

    Raises
    ------
    ValueError, TypeError
        If weights and rates are not positive and of one length, the range does not rise, or `kernel` is not a kernel.

    Notes
    -----
    A published set is used as it is; a fitted one is a minimax sum from a table.

    References
    ----------
    van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465; Casas, Ferrer & Oñate (2018), J. Comput.
    Phys. 353, 50; Braess & Hackbusch (2005), IMA J. Numer. Anal. 25, 685.

    Examples
    --------
    >>> s = ExponentialSum.fit(1e-3, 1.0, 1e-6)
    >>> len(s), bool(s.max_relative_error() <= 1e-6)
    (13, True)
    >>> bool(abs(s(0.25) / 2.0 - 1.0) <= 1e-6)
    True
    """

    weights: Floats
    rates: Floats
    near: float
    far: float
    kernel: Kernel
    rtol: float | None = None

    def __post_init__(self) -> None:
        near = _validate.positive("near", self.near, "seconds")
        far = self.far if self.far == math.inf else _validate.positive("far", self.far, "seconds")
        checked_kernel(self.kernel)
        given = (_validate.unmasked("weights", self.weights), _validate.unmasked("rates", self.rates))
        try:
            weights, rates = (np.array(values, dtype=np.float64) for values in given)
        except (TypeError, ValueError):
            raise TypeError(f"weights and rates must be arrays of real numbers, got {_validate.shown((self.weights, self.rates))}") from None
        if weights.ndim != 1 or weights.shape != rates.shape or not len(weights):
            raise ValueError(f"weights and rates must be one-dimensional and equally long, got shapes {weights.shape} and {rates.shape}")
        if not (np.isfinite(weights).all() and np.isfinite(rates).all() and (weights > 0.0).all() and (rates > 0.0).all()):
            raise ValueError("weights and rates must be positive and finite, got values that are not")
        checked_interval(near, far)
        order = np.argsort(rates)
        for name, values in (("weights", weights[order]), ("rates", rates[order])):
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ExponentialSum):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.weights, self.rates, self.near, self.far, self.kernel, self.rtol)  # read-only arrays again

    @property
    def _key(self) -> tuple[Any, ...]:
        return (self.weights.tobytes(), self.rates.tobytes(), self.near, self.far, self.kernel)

    def __len__(self) -> int:
        return len(self.weights)

    def __repr__(self) -> str:
        promise = "" if self.rtol is None else f", rtol={self.rtol:g}"
        return f"ExponentialSum({len(self)} terms on [{self.near:g}, {self.far:g}] s of {self.kernel!r}{promise})"

    def __call__(self, s: ArrayLike) -> Any:
        """The sum, elementwise.

        Parameters
        ----------
        s : array_like (...), seconds
            Lags, 0 or greater.

        Returns
        -------
        ndarray of float64 (...), s^(-1/2); a float for a scalar

        Raises
        ------
        ValueError, TypeError
            As `Kernel.__call__`.
        """
        lags = checked_lags(s)
        result = self._values(lags)
        return result if lags.ndim else float(result)

    def _values(self, s: Floats) -> Floats:
        result = np.zeros_like(s)
        for weight, rate in zip(self.weights, self.rates, strict=True):
            result += weight * np.exp(-rate * s)
        return result

    def max_relative_error(self, near: float | None = None, far: float | None = None) -> float:
        """Largest |sum/K − 1| on [near, far], by default the sum's own range.

        Measured on 4000 log-spaced lags (more for long sums), then around every extremum of the error and at both ends. For kernels without a table
        errors are relative to at least 1e-16 of K at the sum's near end, as in the bound that `fit` keeps.

        Parameters
        ----------
        near, far : float, seconds, or None
            The range; None: the sum's own.

        Returns
        -------
        float, dimensionless

        Raises
        ------
        ValueError, TypeError
            If the range is empty, negative or infinite.
        """
        near = _validate.positive("near", self.near if near is None else near, "seconds")
        far = _validate.positive("far", self.far if far is None else far, "seconds")
        if far < near:
            raise ValueError("far must not be smaller than near = {} (seconds), got {}".format(*_validate.apart(near, far)))
        lags = np.geomspace(near, far, max(4000, 100 * len(self)))
        lags[0], lags[-1] = near, far
        error = np.abs(self._relative_error(lags))
        inner = np.flatnonzero((error[1:-1] >= error[:-2]) & (error[1:-1] >= error[2:])) + 1
        if not len(inner):
            return float(error.max())
        share = np.linspace(0.0, 1.0, 65)
        fine = lags[inner - 1, None] * (lags[inner + 1] / lags[inner - 1])[:, None] ** share
        return float(max(error.max(), np.abs(self._relative_error(fine)).max()))

    def _relative_error(self, s: Floats) -> Floats:
        values, ours = self.kernel._values(s), self._values(s)
        if isinstance(self.kernel, (BassetKernel, MeiAdrianKernel)):
            return np.asarray(ours / values - 1.0)
        return np.asarray((ours - values) / np.maximum(values, FLOOR * self.kernel._values(np.array([self.near]))))

    @classmethod
    def fit(cls, near: float, far: float, rtol: float, kernel: Kernel = BassetKernel()) -> ExponentialSum:
        """The sum with the fewest terms whose relative error stays within `rtol` on [near, far].

        Parameters
        ----------
        near, far : float, seconds
            0 < near < far, far/near ≤ 1e12.
        rtol : float, dimensionless
            1e-14 to below 1. Tabulated in quarter decades, so at most one term more than the least possible.
        kernel : Kernel
            The Basset kernel, or a Mei–Adrian kernel with c1 = 2 or 2.5: from tables. Others, and lags before those of the tables, are fitted here, with
            1.2 to 2 times the least possible terms, if they are completely monotone; rtol is then that of max(K(s), 1e-16 K(near)).

        Returns
        -------
        ExponentialSum

        Raises
        ------
        ValueError, TypeError
            If no sum keeps `rtol` (the message says which accuracy is possible, or that the kernel has no such sum), or a parameter is of the wrong kind.

        References
        ----------
        Braess & Hackbusch (2005), IMA J. Numer. Anal. 25, 685 (existence, uniqueness and decay of the error).
        """
        near, far = _validate.positive("near", near, "seconds"), _validate.positive("far", far, "seconds")
        checked_interval(near, far)
        rtol = _validate.tolerance("rtol", rtol)
        checked_kernel(kernel)
        if isinstance(kernel, MeiAdrianKernel) and kernel.steepness > 0.0:
            stretch, table = kernel.steepness ** (2.0 / 3.0), _finite_reynolds_table(kernel.c1)
            covers = (table.near <= stretch * near * _SLACK) & (table.far * _SLACK >= stretch * far)
        elif isinstance(kernel, (BassetKernel, MeiAdrianKernel)):
            stretch, table = 1.0 / far, _basset_table()
            covers = table.near <= near / far * _SLACK
        else:
            covers = np.zeros(1, dtype=bool)
        if not covers.any():
            if _has_geometric(kernel):
                raise ValueError(f"far/near must be up to {1.0 / table.near.min():.3g} for {kernel!r}, got near = {near:g} and far = {far:g} seconds")
            return cls(*positive_sum(kernel, near, far, rtol), near, far, kernel, rtol)
        kept = covers & (table.error <= rtol)
        if not kept.any():
            best = table.error[covers].min()
            raise ValueError(f"rtol must be at least {1.005 * best:.3g} for near = {near:g} and far = {far:g} seconds, got {rtol:g}")
        candidates = np.flatnonzero(kept & (table.terms == table.terms[kept].min()))
        chosen = candidates[np.argmin(table.error[candidates])]
        part = slice(table.offset[chosen], table.offset[chosen + 1])
        # K(s) = stretch^(1/2) k(stretch·s) for the Basset kernel, C^(1/3) k(C^(2/3) s) otherwise: the same expression
        weights, rates = np.exp(table.log_weights[part]) * math.sqrt(stretch), np.exp(table.log_rates[part]) * stretch
        return cls(weights, rates, near, far, kernel, rtol)

    @classmethod
    def van_hinsberg(cls, window: float) -> ExponentialSum:
        """The ten published terms for lags beyond a window; good to two or three digits.

        Parameters
        ----------
        window : float, seconds, greater than 0

        Returns
        -------
        ExponentialSum, ten terms

        Raises
        ------
        ValueError, TypeError
            If the window is not positive.

        References
        ----------
        van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465; thesis eqs. 5-13 to 5-17.

        Examples
        --------
        >>> published = ExponentialSum.van_hinsberg(0.5)
        >>> len(published), bool(abs(published(1.0) - 1.0) < 0.02)
        (10, True)
        """
        return cls._published("van_hinsberg_2011", 10, window)

    @classmethod
    def casas(cls, window: float, terms: int, norm: str = "I2t") -> ExponentialSum:
        """Sets of 1 to 10 terms of Casas, Ferrer & Oñate (2018), J. Comput. Phys. 353, 50, for lags beyond `window` seconds.

        Parameters
        ----------
        window : float, seconds
        terms : int
            1 to 10.
        norm : {"I2t", "I1"}
            The norm in which the set was fitted.

        Returns
        -------
        ExponentialSum, as published

        Raises
        ------
        ValueError, TypeError
            If the window is not positive, or there is no such set.

        References
        ----------
        Casas, Ferrer & Oñate (2018), J. Comput. Phys. 353, 50.

        Examples
        --------
        >>> len(ExponentialSum.casas(0.5, 4))
        4
        """
        terms = _validate.integer("terms", terms, 1, 10)
        return cls._published(f"casas_2018_{_validate.choice('norm', norm, ('I2t', 'I1'))}", terms, window)

    @classmethod
    def _published(cls, name: str, terms: int, window: float) -> ExponentialSum:
        """K(s) ≈ Σ a √(e/t') exp(−s/2t') with t' = t·window."""
        window = _validate.positive("window", window, "seconds")
        a, t = np.array(_published_sets()[name, terms]).T
        return cls(a * np.sqrt(math.e / (t * window)), 0.5 / (t * window), window, math.inf, BassetKernel())


def _has_geometric(kernel: Kernel) -> bool:
    """Whether `_geometric` knows the kernel: s^(-1/2) at all lags."""
    return isinstance(kernel, BassetKernel) or (isinstance(kernel, MeiAdrianKernel) and kernel.steepness == 0.0)


def _geometric(near: float, far: float, rtol: float, kernel: Kernel) -> ExponentialSum:
    """s^(-1/2) on any range: the trapezoidal rule of (1/√π) ∫ e^(u/2) exp(−s e^u) du, some twice the terms of a minimax sum.

    Its error is 2√2 e^(−π²/step) of the value, and what lies beyond both ends.
    """
    step = math.pi**2 / math.log(6.0 / rtol)
    low = 2.0 * math.log(0.3 * rtol) - math.log(far)
    high = math.log(math.log(10.0 / rtol)) - math.log(near)
    u = low + step * np.arange(math.ceil((high - low) / step) + 1)
    return ExponentialSum(step / math.sqrt(math.pi) * np.exp(0.5 * u), np.exp(u), near, far, kernel, rtol)


@dataclass(frozen=True)
class _Table:
    """Minimax sums: one row each; log rates and weights of row i in [offset[i], offset[i+1])."""

    terms: Floats
    error: Floats
    near: Floats
    far: Floats
    offset: Any
    log_rates: Floats
    log_weights: Floats


def _load(name: str) -> dict[str, Any]:
    with resources.files("basset").joinpath("data", name).open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {key: archive[key] for key in archive.files}


@lru_cache(maxsize=1)
def _basset_table() -> _Table:
    raw = _load("minimax_basset.npz")
    return _Table(raw["terms"], raw["error"], 1.0 / raw["ratio"], np.ones(len(raw["ratio"])), raw["offset"], raw["log_rates"], raw["log_weights"])


@lru_cache(maxsize=2)
def _finite_reynolds_table(c1: float) -> _Table:
    names = {2.0: "minimax_mei_adrian.npz", 2.5: "minimax_dorgan_loth.npz"}
    if c1 not in names:
        raise ValueError(f"c1 must be 2 or 2.5 for a fitted sum (other values have no table), got {c1:g}")
    raw = _load(names[c1])
    return _Table(raw["terms"], raw["error"], raw["near"], raw["far"], raw["offset"], raw["log_rates"], raw["log_weights"])


@lru_cache(maxsize=1)
def _published_sets() -> dict[tuple[str, int], list[tuple[float, float]]]:
    sets: dict[tuple[str, int], list[tuple[float, float]]] = {}
    text = resources.files("basset").joinpath("data", "published_sums.csv").read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        sets.setdefault((row["set"], int(row["terms"])), []).append((float(row["a"]), float(row["t"])))
    return sets
