"""The functions that solve y' = f − c·H[y] where f is linear: inverse Laplace transforms of rational functions of √s.

With z = r√t every pole r of 1/∏(√s − r) brings φ_m(z) = Σ z^k/Γ((k + m)/2 + 1), the Mittag-Leffler function
E_{1/2, 1+m/2}: φ_0(z) = e^(z²) erfc(−z), z φ_{m+1} = φ_m − 1/Γ(m/2 + 1), and two poles the divided difference
φ_m[z1, z2]. Double precision where that is safe; where its terms cancel, mpmath with digits to spare.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import mpmath
import numpy as np
import scipy.special
from numpy.polynomial.polynomial import polyval

# numerator and denominator in √s, highest power first, and the roots of the latter if known; in the current mpmath precision
Rational = Callable[[], tuple[list[Any], list[Any], list[Any] | None]]

_SERIES = 64  # terms of every power series: 1/Γ(33) = 4e-36
_FAR = 6.5  # beyond this |z| the asymptotic series has a smallest term e^(−|z|²) below 1e-18
_GAUSS = np.polynomial.legendre.leggauss(16)
_CANCELLED = 200.0  # terms so much larger than their sum are summed in mpmath instead


def entire(m: int, z: Any) -> Any:
    """φ_m(z), complex, m ≥ −3; relative error of a few 1e-15 for Re z ≤ 0, |z|² ε more where e^(z²) grows."""
    z = np.asarray(z, dtype=np.complex128)
    size = np.abs(z)
    near, far = size < 1.0, size > _FAR
    result = np.empty_like(z)
    if np.any(near):
        result[near] = polyval(z[near], scipy.special.rgamma((np.arange(_SERIES) + m) / 2.0 + 1.0))
    if np.any(far):
        inverse = 1.0 / z[far]
        result[far] = -inverse * polyval(inverse, scipy.special.rgamma(1.0 + (m - np.arange(1, 61)) / 2.0))
        growing = far & (z.real > 0.0)
        if np.any(growing):
            result[growing] += 2.0 * z[growing] ** -m * np.exp(z[growing] ** 2)
    between = ~(near | far)
    if np.any(between):
        point = z[between]
        value = scipy.special.wofz(-1j * point)
        for k in range(0, m):
            value = (value - scipy.special.rgamma(k / 2.0 + 1.0)) / point
        for k in range(-1, m - 1, -1):
            value = scipy.special.rgamma(k / 2.0 + 1.0) + point * value
        result[between] = value
    return result


def poles(rate: float, coefficient: float) -> tuple[complex, complex]:
    """The roots of r² + c√π r + λ, the one with the larger modulus second; no cancellation and no overflow."""
    if coefficient < 0.0:
        raise ValueError(f"coefficient must be 0 or greater, got {coefficient}")
    b = np.sqrt(np.pi) * coefficient
    if rate < 0.0:
        second = -(b + np.hypot(b, 2.0 * np.sqrt(-rate))) / 2.0
        return complex(rate / second), complex(second)
    turn = 2.0 * np.sqrt(rate)
    if b < turn:
        root = complex(-b / 2.0, np.sqrt(turn - b) * np.sqrt(turn + b) / 2.0)
        return root, root.conjugate()
    second = -(b + np.sqrt(b - turn) * np.sqrt(b + turn)) / 2.0
    return complex(rate / second if second else 0.0), complex(second)


def response(t: Any, rate: float, coefficient: float, integrals: int) -> Any:
    """The n-fold integral of R(t) as t^n φ_{2n−1}[r1√t, r2√t], n = `integrals`."""
    times = np.asarray(t, dtype=np.float64)
    first, second = poles(float(rate), float(coefficient))
    root = np.sqrt(np.atleast_1d(times))
    z1, z2, m = first * root, second * root, 2 * integrals - 1
    size, gap = np.maximum(np.abs(z1), np.abs(z2)), np.abs(z1 - z2)
    value = np.empty_like(root)
    near = size < 1.0
    close = ~near & (gap < 0.5 * size)
    apart = ~(near | close)
    if np.any(near):  # Σ h_k/Γ((k + m + 1)/2 + 1), h_k the complete symmetric polynomials
        total, product = (z1[near] + z2[near]).real, (z1[near] * z2[near]).real
        older, newer, series = np.zeros_like(total), np.ones_like(total), np.zeros_like(total)
        for coefficient_k in scipy.special.rgamma((np.arange(_SERIES) + m + 1) / 2.0 + 1.0):
            series = series + coefficient_k * newer
            older, newer = newer, total * newer - product * older
        value[near] = series
    if np.any(apart):
        value[apart] = ((entire(m, z1[apart]) - entire(m, z2[apart])) / (z1[apart] - z2[apart])).real
    if np.any(close):  # the mean of φ' over the segment between the points; z φ_m' = 2 φ_{m−2} − m φ_m
        points = (z1[close] + z2[close])[:, None] / 2.0 + (z1[close] - z2[close])[:, None] / 2.0 * _GAUSS[0]
        value[close] = (((2.0 * entire(m - 2, points) - m * entire(m, points)) / points) @ _GAUSS[1]).real / 2.0
    return (value * np.atleast_1d(times) ** integrals).reshape(times.shape)[()]


def response_digits(t: Any, rate: Any, coefficient: Any, integrals: int) -> Any:
    """The same by the same formula in the current mpmath precision; half of its digits hold where the roots coincide."""
    time, c, decay = mpmath.mpmathify(t), mpmath.mpmathify(coefficient), mpmath.mpmathify(rate)
    b = c * mpmath.sqrt(mpmath.pi)
    z2 = -(b + mpmath.sqrt(b * b - 4 * decay)) / 2 * mpmath.sqrt(time)
    z1 = decay * time / z2 if z2 else z2
    m = 2 * integrals - 1
    if max(abs(z1), abs(z2)) < 1:
        total, product, older, newer, value, k = z1 + z2, z1 * z2, mpmath.mpf(0), mpmath.mpf(1), mpmath.mpf(0), 0
        while k < 8 or mpmath.rgamma(mpmath.mpf(k) / 2) * (k + 1) > mpmath.eps:
            value += newer * mpmath.rgamma(mpmath.mpf(k + m + 1) / 2 + 1)
            older, newer, k = newer, total * newer - product * older, k + 1
    else:
        if abs(z1 - z2) <= abs(z2) * mpmath.mpf(10) ** (-mpmath.mp.dps // 2):
            shift = mpmath.mpf(10) ** (-mpmath.mp.dps // 4)
            z1, z2 = z1 * (1 + shift), z2 * (1 - shift)
        value = (_entire_digits(m, z1) - _entire_digits(m, z2)) / (z1 - z2)
    return mpmath.re(value) * time**integrals


def _entire_digits(m: int, z: Any) -> Any:
    if abs(z) < 1:
        value, power, k = mpmath.mpf(0), mpmath.mpf(1), 0
        while k < 8 or mpmath.rgamma(mpmath.mpf(k + m) / 2 + 1) > mpmath.eps:
            value, power, k = value + power * mpmath.rgamma(mpmath.mpf(k + m) / 2 + 1), power * z, k + 1
        return value
    value = exponential_erfc(z)
    for k in range(0, m):
        value = (value - mpmath.rgamma(mpmath.mpf(k) / 2 + 1)) / z
    return mpmath.rgamma(mpmath.mpf(1) / 2) + z * value if m == -1 else value


def exponential_erfc(z: Any) -> Any:
    """e^(z²) erfc(−z) in the current mpmath precision, by its asymptotic series where that is exact enough."""
    if abs(z) ** 2 <= 2.5 * mpmath.mp.dps + 10:
        return mpmath.exp(z * z) * mpmath.erfc(-z)
    term, value, k = -1 / (mpmath.sqrt(mpmath.pi) * z), mpmath.mpf(0), 0
    while abs(term) > abs(value) * mpmath.eps:
        value, term, k = value + term, -term * (2 * k + 1) / (2 * z * z), k + 1
    return value + 2 * mpmath.exp(z * z) if mpmath.re(z) > 0 else value


def converged(compute: Callable[[], Any], digits: int) -> Any:
    """`compute()` with more and more working digits until two answers agree to `digits`."""
    working = digits + 15
    with mpmath.workdps(working):
        value = compute()
    for _ in range(6):
        working *= 2
        with mpmath.workdps(working):
            last, value = value, compute()
            if abs(value - last) <= abs(value) * mpmath.mpf(10) ** -(digits + 2):
                break
    with mpmath.workdps(digits + 10):
        return +value


def _fractions(rational: Rational) -> tuple[list[Any], list[Any]]:
    """Poles r and weights w of Σ w e^(r²t) erfc(−r√t) in the current mpmath precision; coinciding poles are moved apart."""
    above, below, roots = rational()
    tiny = mpmath.mpf(10) ** (-mpmath.mp.dps // 2)
    found = roots or mpmath.polyroots(below, maxsteps=100 + 4 * mpmath.mp.prec, extraprec=3 * mpmath.mp.prec)
    scale = max(abs(r) for r in found)
    if min([abs(r - q) for i, r in enumerate(found) for q in found[:i]], default=scale) <= scale * tiny:
        found = [r + scale * k * mpmath.mpf(10) ** (-mpmath.mp.dps // 5) for k, r in enumerate(found)]
    weights = []
    for i, r in enumerate(found):
        slope = below[0]
        for k, q in enumerate(found):
            slope = slope if k == i else slope * (r - q)
        weights.append(mpmath.polyval(above, r) * r / slope)
    return found, weights


def inverse_digits(rational: Rational, t: Any) -> Any:
    """The inverse Laplace transform at one time, complex, in the current mpmath precision."""
    root = mpmath.sqrt(mpmath.mpmathify(t))
    return mpmath.fsum(w * exponential_erfc(r * root) for r, w in zip(*_fractions(rational), strict=True) if w)


def inverse(rational: Rational, t: Any) -> Any:
    """The same for an array of times in double precision, degree of the denominator at least 2 above the numerator's.

    Power series in √t while all |r√t| < 1, partial fractions beyond; where their terms cancel by more than
    two digits (nearly coinciding poles), mpmath. Relative error ~1e-13, and ε|r²t| once e^(r²t) has grown.
    """
    times = np.asarray(t, dtype=np.float64)
    flat = np.atleast_1d(times).ravel()
    root = np.sqrt(flat)
    with mpmath.workdps(40):
        found, weights = _fractions(rational)
        above, below, _ = rational()
        scale = max(abs(r) for r in found)
        drop = len(below) - len(above)
        monic = [b / below[0] / scale**k for k, b in enumerate(below)]
        rest = [a / below[0] / scale**k for k, a in enumerate(above)]
        expansion: list[Any] = []
        for k in range(_SERIES):  # numerator/denominator in powers of 1/√s
            known = rest[k] if k < len(rest) else mpmath.mpf(0)
            expansion.append(known - sum(monic[i] * expansion[k - i] for i in range(1, min(k, len(monic) - 1) + 1)))
        series = np.array([complex(a * mpmath.rgamma(mpmath.mpf(k + drop) / 2)) for k, a in enumerate(expansion)])
        size, pole, weight = float(scale), np.array([complex(r) for r in found]), np.array([complex(w) for w in weights])
    near = size * root < 1.0
    value = np.empty(flat.shape, dtype=np.complex128)
    value[near] = root[near] ** (drop - 2) * polyval((size * root[near]).astype(np.complex128), series)
    terms = weight * entire(0, pole * root[~near][:, None])
    value[~near] = terms.sum(axis=1)
    bad = np.flatnonzero(~near)[np.abs(terms).max(axis=1, initial=0.0) > _CANCELLED * np.abs(value[~near])]
    for i in bad:
        value[i] = complex(converged(partial(inverse_digits, rational, float(flat[i])), 17))
    return value.reshape(times.shape)[()]


def oscillation(rate: Any, coefficient: Any, omega: Any) -> Rational:
    """1/((s − iω)(s + c√π √s + λ)): e^(iωt) drives a sphere from rest."""

    def rational() -> tuple[list[Any], list[Any], list[Any] | None]:
        decay, b = mpmath.mpmathify(rate), mpmath.mpmathify(coefficient) * mpmath.sqrt(mpmath.pi)
        turn = mpmath.mpc(0, mpmath.mpmathify(omega))
        second = -(b + mpmath.sqrt(b * b - 4 * decay)) / 2
        roots = [decay / second if second else second, second, mpmath.sqrt(turn), -mpmath.sqrt(turn)]
        return [mpmath.mpf(1)], [mpmath.mpf(1), b, decay - turn, -turn * b, -turn * decay], roots

    return rational


def oscillating(t: Any, rate: float, coefficient: float, omega: float) -> Any:
    """∫R(t−τ) e^(iωτ) dτ: e^(iωt)/P(√(iω)) and what R and e^(iωt) erfc(√(iωt)) leave, P(q) = q² + c√π q + λ."""
    times = np.asarray(t, dtype=np.float64)
    flat = np.atleast_1d(times).ravel()
    first, second = poles(float(rate), float(coefficient))
    corner, b = np.sqrt(1j * omega), np.sqrt(np.pi) * coefficient
    root = np.sqrt(flat)
    slow, fast = first**2 - 1j * omega, second**2 - 1j * omega
    with np.errstate(all="ignore"):  # slow or fast may vanish: those times are computed again
        terms = np.stack(
            [
                _rotation(omega, flat) / (1j * omega + b * corner + rate),
                b / slow / fast * corner * entire(0, -corner * root),
                b / slow / fast * second * entire(0, second * root),
                response(flat, rate, coefficient, 0) / slow,
            ]
        )
        value = np.atleast_1d(terms.sum(axis=0))
        trusted = np.abs(terms).max(axis=0) <= _CANCELLED * np.abs(value)
    if not np.all(trusted):
        value[~trusted] = inverse(oscillation(rate, coefficient, omega), flat[~trusted])
    return value.reshape(times.shape)[()]


def _rotation(omega: float, t: Any) -> Any:
    """e^(iωt) with the rounding error of the product ωt put back (Dekker's two-product): no phase is lost at long times."""
    product = omega * t

    def halves(x: Any) -> tuple[Any, Any]:
        top = x * 134217729.0 - (x * 134217729.0 - x)
        return top, x - top

    (a, b), (c, d) = halves(np.float64(omega)), halves(t)
    return np.exp(1j * product) * (1.0 + 1j * (((a * c - product) + a * d + b * c) + b * d))
