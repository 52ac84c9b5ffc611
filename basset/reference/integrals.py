"""Closed forms of the history integral, and exact weights of product integration. All for K(s) = s^(-1/2) unless stated otherwise.

They follow from integrals of Euler and Fresnel and from the error function (Abramowitz & Stegun 6.2, 7.1, 7.3). H has the unit of f × s^(-1/2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import mpmath
import numpy as np
import scipy.special
from numpy.typing import ArrayLike

from basset.kernels import BassetKernel, Kernel, MeiAdrianKernel


def exponential(t: ArrayLike, rate: complex, digits: int | None = None) -> Any:
    """H(t) for f' = e^(aτ), f(0) = 0: √(π/a) e^(at) erf(√(at)), a = `rate` in 1/s, complex allowed; real for a real rate.

    Laplace transform of s^(-1/2); Abramowitz & Stegun 7.1.

    >>> abs(float(exponential(2.0, -1.0)) - float(exponential(2.0, -1.0, digits=20))) < 1e-15
    True
    """
    if digits is not None:
        with mpmath.workdps(digits + 10):
            a, time = mpmath.mpmathify(rate), mpmath.mpmathify(t)
            if a == 0:
                return 2 * mpmath.sqrt(time)
            with mpmath.workdps(digits + 10 + int(abs(a * time) * 0.45)):  # erf cancels against e^(at) for Re a < 0
                value = mpmath.sqrt(mpmath.pi) / mpmath.sqrt(a) * mpmath.exp(a * time) * mpmath.erf(mpmath.sqrt(a * time))
            return +value if isinstance(rate, complex) else +mpmath.re(value)
    times = np.asarray(t, dtype=np.float64)
    root = np.sqrt(times)
    if not isinstance(rate, complex):
        if rate == 0.0:
            return 2.0 * root
        scale = np.sqrt(abs(rate))
        if rate < 0.0:
            return 2.0 / scale * scipy.special.dawsn(scale * root)
        return np.sqrt(np.pi) / scale * np.exp(rate * times) * scipy.special.erf(scale * root)
    z = rate * times
    small = np.abs(z) <= 1.0
    near = np.where(small, z, 0.0)
    term = series = np.ones_like(z)
    for k in range(1, 26):  # Kummer's M(1, 3/2, z)
        term = term * near / (k + 0.5)
        series = series + term
    far = np.where(small, 1.0, z)
    faddeeva = scipy.special.wofz(1j * np.sqrt(far))  # erfc(x) = e^(−x²) w(ix)
    return np.where(small, 2.0 * root * series, np.sqrt(np.pi / rate) * (np.exp(far) - faddeeva))


def cosine(t: ArrayLike, omega: float = 1.0, digits: int | None = None) -> Any:
    """H(t) for f' = cos ωτ, f(0) = 0: √(2π/ω) [cos ωt C(z) + sin ωt S(z)], z = √(2ωt/π), ω > 0 in 1/s (thesis, section 5.2.2.2).

    With ω = 1 and t = 50π the thesis's test integral:

    >>> abs(float(cosine(50.0 * np.pi)) - 1.25306020134666) < 1e-13
    True
    """
    if digits is not None:
        with mpmath.workdps(digits + 10):
            time, w = mpmath.mpmathify(t), mpmath.mpmathify(omega)
            z = mpmath.sqrt(2 * w * time / mpmath.pi)
            value = mpmath.cos(w * time) * mpmath.fresnelc(z) + mpmath.sin(w * time) * mpmath.fresnels(z)
            return mpmath.sqrt(2 * mpmath.pi / w) * value
    return exponential(t, 1j * omega).real


def sine(t: ArrayLike, omega: float = 1.0, digits: int | None = None) -> Any:
    """H(t) for f' = sin ωτ, f(0) = 0: √(2π/ω) [sin ωt C(z) − cos ωt S(z)], z = √(2ωt/π): `cosine` a quarter of a period on."""
    if digits is not None:
        with mpmath.workdps(digits + 10):
            time, w = mpmath.mpmathify(t), mpmath.mpmathify(omega)
            z = mpmath.sqrt(2 * w * time / mpmath.pi)
            value = mpmath.sin(w * time) * mpmath.fresnelc(z) - mpmath.cos(w * time) * mpmath.fresnels(z)
            return mpmath.sqrt(2 * mpmath.pi / w) * value
    return exponential(t, 1j * omega).imag


def power(t: ArrayLike, exponent: float, digits: int | None = None) -> Any:
    """H(t) for f' = τ^k, k = `exponent` > −1, f(0) = 0: B(1/2, k+1) t^(k+1/2), Euler's beta integral."""
    if digits is not None:
        with mpmath.workdps(digits + 10):
            k = mpmath.mpmathify(exponent)
            return mpmath.beta(mpmath.mpf(1) / 2, k + 1) * mpmath.mpmathify(t) ** (k + mpmath.mpf(1) / 2)
    return scipy.special.beta(0.5, exponent + 1.0) * np.asarray(t, dtype=np.float64) ** (exponent + 0.5)


def power_slip(t: ArrayLike, exponent: float, digits: int | None = None) -> Any:
    """H(t) for the slip f = τ^k, k = `exponent` > 0: k B(1/2, k) t^(k−1/2); π/2 at all times for f = √τ."""
    scale = exponent if digits is None else mpmath.mpmathify(exponent)
    return scale * power(t, exponent - 1.0, digits)


def step(t: ArrayLike, jump: float = 1.0, digits: int | None = None) -> Any:
    """H(t) for a slip that jumps by `jump` (unit of f) at t = 0 and stays: jump·t^(-1/2), the kernel itself; infinite at t = 0."""
    if digits is not None:
        with mpmath.workdps(digits + 10):
            return mpmath.mpmathify(jump) / mpmath.sqrt(mpmath.mpmathify(t))
    with np.errstate(divide="ignore"):
        return jump / np.sqrt(np.asarray(t, dtype=np.float64))


def _value(s: Any, kernel: Kernel) -> Any:
    """K(s) in the current mpmath precision."""
    if isinstance(kernel, BassetKernel):
        return 1 / mpmath.sqrt(s)
    assert isinstance(kernel, MeiAdrianKernel)
    return (1 + (_steepness(kernel) * s ** mpmath.mpf("1.5")) ** (1 / mpmath.mpf(kernel.c1))) ** -kernel.c1 / mpmath.sqrt(s)


def _steepness(kernel: MeiAdrianKernel) -> Any:
    slip, viscosity = mpmath.mpf(kernel.slip), mpmath.mpf(kernel.viscosity)
    friction = mpmath.mpf("0.75") + mpmath.mpf(kernel.c2) * slip * mpmath.mpf(kernel.diameter) / viscosity
    return mpmath.sqrt(mpmath.pi) / 2 * (slip / friction / mpmath.sqrt(viscosity)) ** 3


@lru_cache(maxsize=4096)  # the same for rates and slips
def _panel_moments(k: int, degree: int, kernel: Kernel, precision: int) -> list[Any]:
    """∫_k^{k+1} K(s) (s−k)^m ds, m = 0 … degree, in the current mpmath precision."""
    if isinstance(kernel, BassetKernel):
        low, high = mpmath.sqrt(k), mpmath.sqrt(k + 1)
        raw = [2 * (high * (k + 1) ** m - low * k**m) / (2 * m + 1) for m in range(degree + 1)]
        return [sum(math.comb(m, i) * (-k) ** (m - i) * raw[i] for i in range(m + 1)) for m in range(degree + 1)]
    points = [mpmath.mpf(k), mpmath.mpf(k + 1)]
    if k == 0 and isinstance(kernel, MeiAdrianKernel):  # follow the bend; the algebraic end is left to tanh-sinh
        turn = _steepness(kernel) ** (-mpmath.mpf(2) / 3) if kernel.slip else mpmath.mpf(1)
        inner = (turn * mpmath.mpf(10) ** e for e in range(-6, 7, 2))
        points = [mpmath.mpf(0), *(x for x in inner if x < 1), mpmath.mpf(1)]
    value = lru_cache(maxsize=None)(lambda s: _value(s, kernel))  # every moment asks for it at the same places
    return [mpmath.quad(lambda s, m=m: value(s) * (s - k) ** m, points) for m in range(degree + 1)]


@lru_cache(maxsize=1024)
def _lagrange(degree: int, first: int, i: int) -> tuple[list[int], int]:
    """Whole coefficients, lowest first, and the divisor of the polynomial that is 1 at `first` + i, 0 at the other nodes of `first` to `first` + degree."""
    polynomial, divisor = [1], 1
    for m in (m for m in range(degree + 1) if m != i):
        shifted = [0, *polynomial]
        polynomial = [shifted[q] - (first + m) * (polynomial[q] if q < len(polynomial) else 0) for q in range(len(shifted))]
        divisor *= i - m
    return polynomial, divisor


def product_weights(n: int, indices: Iterable[int], degree: int, kernel: Kernel = BassetKernel(), input: str = "rate", digits: int = 40) -> list[Any]:
    """Exact weights w[j] of product integration of that degree for a unit step, for j in `indices` (0 to n, newest first): mpmath numbers.

    The definition: on panel [k, k+1] the polynomial of degree p through the samples from lag k − ⌊p/2⌋ on, shifted inwards at both ends,
    integrated against K (for `input` "slip": its derivative in time, and the first sample as a jump). Histories of n < p steps use degree n.
    For a step dt the weights are these times √dt (for slips 1/√dt), with the kernel's time scale in steps. Enough working digits are added to
    survive the cancellation.
    Daitche (2013), J. Comput. Phys. 254, 93; thesis eqs. 5-9 to 5-11.

    >>> [round(float(w), 12) for w in product_weights(1, [0, 1], 1)]  # ∫ s^(-1/2) (1 − s) ds and ∫ s^(1/2) ds
    [1.333333333333, 0.666666666667]
    """
    degree = min(degree, n)
    wanted = {int(j): mpmath.mpf(0) for j in indices}
    with mpmath.workdps(digits + 10 + int((degree + 1) * np.log10(n + 10.0)) * isinstance(kernel, BassetKernel)):
        panels = {k for j in wanted for k in range(max(0, j - 2 * degree), min(n, j + 2 * degree + 1))}
        for k in sorted(panels):
            start = min(max(k - degree // 2, 0), n - degree)
            touched = [i for i in range(degree + 1) if start + i in wanted]
            if not touched:
                continue
            moments = _panel_moments(k, degree, kernel, mpmath.mp.prec)
            for i in touched:
                polynomial, divisor = _lagrange(degree, start - k, i)  # in s − k
                if input == "slip":
                    polynomial = [-m * c for m, c in enumerate(polynomial)][1:]
                wanted[start + i] += sum(c * moment for c, moment in zip(polynomial, moments, strict=False)) / divisor
        if input == "slip" and n in wanted:
            wanted[n] += _value(mpmath.mpf(n), kernel)
        return [+wanted[int(j)] for j in indices]
