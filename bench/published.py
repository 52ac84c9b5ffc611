"""The coefficients as published, transcribed literally: for measurement, not for use.

Daitche (2013), J. Comput. Phys. 254, 93, second, third and fourth error order; van Hinsberg et al. (2011), thesis
eq. 5-7; and the three oldest rules of the thesis. Rows are dimensionless, n+1 weights, newest first:
∫ K g ≈ √h Σ_j w[j] g(t_{n−j}).

NumPy has no quadruple precision. "quad" stands for it with mpmath numbers of 34 digits, which a machine with quadruple
arithmetic in its compiler beats in time, not in digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np

QUAD_DIGITS = 34
SMALLEST = {1: 2, 2: 4, 3: 7}  # steps from which Daitche's general rows hold, by degree

Array = np.ndarray[Any, Any]
Power = Callable[[Any, int], Any]
Fraction = Callable[[int, int], Any]


def _numbers(values: Any, arithmetic: str) -> Array:
    """Whole numbers in that arithmetic: "double", "extended" (80 bit where the machine has it) or "quad"."""
    if arithmetic == "quad":
        return np.array([mpmath.mpf(int(value)) for value in values], dtype=object)
    return np.asarray(values, dtype={"double": np.float64, "extended": np.longdouble}[arithmetic])


def _root(values: Array) -> Array:
    return np.frompyfunc(mpmath.sqrt, 1, 1)(values) if values.dtype == object else np.sqrt(values)


def _fraction(arithmetic: str) -> Fraction:
    """p/q in the arithmetic in which the coefficients are built."""

    def fraction(numerator: int, denominator: int) -> Any:
        top, bottom = _numbers([numerator, denominator], arithmetic)
        return top / bottom

    return fraction


def _powers(largest: int, arithmetic: str) -> Power:
    """(k, m) -> k^(m/2) for k = 0 … largest and m = 1, 3, 5, 7, each computed once."""
    k = _numbers(range(largest + 1) if arithmetic == "quad" else np.arange(largest + 1), arithmetic)
    table = {1: _root(k)}

    def power(index: Any, m: int) -> Any:
        if m not in table:
            table[m] = k * table[1] if m == 3 else k ** ((m - 3) // 2) * power(slice(None), 3)
        return table[m][index]

    return power


def _power_of(arithmetic: str) -> Power:
    """The same without a table, for a few k far out."""

    def power(index: Any, m: int) -> Any:
        k = _numbers(np.atleast_1d(index), arithmetic)
        return k ** ((m - 1) // 2) * _root(k)

    return power


def _middle(degree: int, j: Any, p: Power, q: Fraction) -> Any:
    """Interior coefficients at the lags j, an array of whole numbers."""
    if degree == 1:
        return q(4, 3) * (p(j - 1, 3) + p(j + 1, 3) - 2 * p(j, 3))
    if degree == 2:
        return q(8, 15) * (p(j + 2, 5) - 3 * p(j + 1, 5) + 3 * p(j, 5) - p(j - 1, 5)) + q(2, 3) * (-p(j + 2, 3) + 3 * p(j + 1, 3) - 3 * p(j, 3) + p(j - 1, 3))
    return q(16, 105) * (p(j + 2, 7) + p(j - 2, 7) - 4 * p(j + 1, 7) - 4 * p(j - 1, 7) + 6 * p(j, 7)) + q(2, 9) * (
        4 * p(j + 1, 3) + 4 * p(j - 1, 3) - p(j + 2, 3) - p(j - 2, 3) - 6 * p(j, 3)
    )


def _newest(degree: int, p: Power, q: Fraction) -> list[Any]:
    """Coefficients of the newest samples, where the formula differs from the interior."""
    r2, r3, r5 = p(2, 1), p(3, 1), p(5, 1)
    if degree == 1:
        return [q(4, 3)]
    if degree == 2:
        return [q(4, 5) * r2, q(14, 5) * r3 - q(12, 5) * r2, q(176, 15) - q(42, 5) * r3 + q(12, 5) * r2]
    return [
        q(244, 315) * r2,
        q(362, 105) * r3 - q(976, 315) * r2,
        q(5584, 315) - q(1448, 105) * r3 + q(488, 105) * r2,
        q(1130, 63) * r5 - q(22336, 315) + q(724, 35) * r3 - q(976, 315) * r2,
    ]


def _oldest(degree: int, n: int, p: Power, q: Fraction) -> list[Any]:
    """Coefficients of the oldest samples, the oldest last."""
    if degree == 1:
        return [q(4, 3) * (p(n - 1, 3) - p(n, 3) + q(3, 2) * p(n, 1))]
    if degree == 2:
        return [
            q(8, 15) * (-2 * p(n, 5) + 3 * p(n - 1, 5) - p(n - 2, 5)) + q(2, 3) * (4 * p(n, 3) - 3 * p(n - 1, 3) + p(n - 2, 3)),
            q(8, 15) * (p(n, 5) - p(n - 1, 5)) + q(2, 3) * (-3 * p(n, 3) + p(n - 1, 3)) + 2 * p(n, 1),
        ]
    return [
        q(16, 105) * (p(n, 7) - 4 * p(n - 2, 7) + 6 * p(n - 3, 7) - 4 * p(n - 4, 7) + p(n - 5, 7))
        - q(8, 15) * p(n, 5)
        + q(4, 9) * p(n, 3)
        + q(8, 9) * p(n - 2, 3)
        - q(4, 3) * p(n - 3, 3)
        + q(8, 9) * p(n - 4, 3)
        - q(2, 9) * p(n - 5, 3),
        q(16, 105) * (p(n - 4, 7) - 4 * p(n - 3, 7) + 6 * p(n - 2, 7) - 3 * p(n, 7))
        + q(32, 15) * p(n, 5)
        - 2 * p(n, 3)
        - q(4, 3) * p(n - 2, 3)
        + q(8, 9) * p(n - 3, 3)
        - q(2, 9) * p(n - 4, 3),
        q(16, 105) * (3 * p(n, 7) - 4 * p(n - 2, 7) + p(n - 3, 7)) - q(8, 3) * p(n, 5) + 4 * p(n, 3) + q(8, 9) * p(n - 2, 3) - q(2, 9) * p(n - 3, 3),
        q(16, 105) * (p(n - 2, 7) - p(n, 7)) + q(16, 15) * p(n, 5) - q(22, 9) * p(n, 3) - q(2, 9) * p(n - 2, 3) + 2 * p(n, 1),
    ]


def daitche(degree: int, n: int, arithmetic: str = "double") -> Array:
    """Daitche's row (n+1,) for degree 1, 2 or 3 (α, β or γ of the paper, error h², h³, h⁴) and n steps, at least SMALLEST[degree].

    Differences of powers are formed in `arithmetic`, "double", "extended" or "quad"; the row is stored in double, as the thesis prescribes.
    """
    if n < SMALLEST[degree]:
        raise ValueError(f"n must be at least {SMALLEST[degree]} for the general rows of degree {degree}, got {n}")
    with mpmath.workdps(QUAD_DIGITS):
        q, p = _fraction(arithmetic), _powers(max(n + 2, 5), arithmetic)
        newest, oldest = _newest(degree, p, q), _oldest(degree, n, p, q)
        middle = _middle(degree, np.arange(len(newest), n + 1 - len(oldest)), p, q)
        row = np.empty(n + 1)
        row[: len(newest)] = newest
        row[len(newest) : n + 1 - len(oldest)] = middle
        row[n + 1 - len(oldest) :] = oldest
    return row


def daitche_interior(degree: int, j: Any, arithmetic: str = "double") -> Array:
    """Interior coefficients at a few lags j alone (j above the special newest ones), float64 (len(j),)."""
    with mpmath.workdps(QUAD_DIGITS):
        lags = [int(lag) for lag in j]
        if arithmetic == "quad":
            return np.array(_middle(degree, np.array(lags, dtype=object), _power_of(arithmetic), _fraction(arithmetic)), dtype=np.float64)
        return np.asarray(_middle(degree, np.array(lags), _power_of(arithmetic), _fraction(arithmetic)), dtype=np.float64)


def hinsberg(n: int) -> Array:
    """Thesis eq. 5-7: the product trapezoid as quotients, in which nothing cancels. float64 (n+1,), dimensionless; n ≥ 2."""
    k = np.arange(n + 1.0)
    root = np.sqrt(k)
    cube = k * root
    half = (k[1:] - 4.0 / 3.0) / (cube[:-1] + (k[1:] - 1.5) * root[1:])  # the second quotient of eq. 5-7, k = 1 … n
    row = np.empty(n + 1)
    row[0] = 4.0 / 3.0
    row[1:n] = (k[1:n] + 4.0 / 3.0) / (cube[2:] + (k[1:n] + 1.5) * root[1:n]) + half[:-1]
    row[n] = half[-1]
    return row


def euler_maclaurin(n: int) -> Array:
    """Second Euler–Maclaurin summation (thesis section 5.2.2.1). float64 (n+1,), dimensionless."""
    panel = 0.5 / np.sqrt(np.arange(n) + 0.5)
    row = np.empty(n + 1)
    row[:-1] = panel
    row[-1] = 0.0
    row[1:] += panel
    return row


def brush(n: int) -> Array:
    """Brush et al. (1964): 2√h on the newest step, Simpson before it, the oldest panel by trapezoid if n is even. float64 (n+1,); n ≥ 3."""
    row = np.empty(n + 1)
    row[0] = 2.0
    row[1:] = 1.0 / (3.0 * np.sqrt(np.arange(1.0, n + 1.0)))
    row[2:-1:2] *= 4.0
    row[3:-1:2] *= 2.0
    if n % 2 == 0:
        row[-2:] *= np.array([2.5 / 2.0, 1.5])  # 1/3 + 1/2 where Simpson meets the trapezoid, 1/2 at its end
    return row


def semi_derivative(n: int) -> Array:
    """Thesis eq. 5-6 with q = −1/2: Γ(k+1/2)/Γ(k+1) by its recurrence, for k < n. float64 (n+1,), dimensionless."""
    row = np.empty(n + 1)
    row[0] = np.sqrt(np.pi)
    k = np.arange(1.0, n)
    row[1:n] = np.sqrt(np.pi) * np.cumprod((k - 0.5) / k)
    row[n] = 0.0
    return row
