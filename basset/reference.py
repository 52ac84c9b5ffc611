"""The truth: closed forms of the history integral in double precision, and the same in mpmath to any number of digits.

Every function takes `digits=None`: then t may be an array (seconds) and the result is float64; with `digits` t is one
number and the result an mpmath number correct to that many digits, from a formula of its own where double precision
needs a special one. `product_weights` gives exact weights of product integration. All for K(s) = s^(-1/2) unless said.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import mpmath
import numpy as np
import scipy.optimize
import scipy.special
from numpy.typing import ArrayLike

from basset import _responses
from basset.kernels import BassetKernel, Kernel, MeiAdrianKernel


def exponential(t: ArrayLike, rate: complex, digits: int | None = None) -> Any:
    """H(t) for f' = exp(rate·τ), f(0) = 0: √(π/a) e^(at) erf(√(at)) with a = `rate` (1/s), complex allowed.

    Source: Laplace transform of s^(-1/2); Abramowitz & Stegun 7.1. Real for a real rate.
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
    """H(t) for f' = cos(ωτ), f(0) = 0: √(2π/ω) [cos ωt C(z) + sin ωt S(z)], z = √(2ωt/π) (thesis section 5.2.2.2).

    With ω = 1 and t = 50π the thesis's test integral, 1.253060201346663…
    """
    if digits is not None:
        with mpmath.workdps(digits + 10):
            time, w = mpmath.mpmathify(t), mpmath.mpmathify(omega)
            z = mpmath.sqrt(2 * w * time / mpmath.pi)
            value = mpmath.cos(w * time) * mpmath.fresnelc(z) + mpmath.sin(w * time) * mpmath.fresnels(z)
            return mpmath.sqrt(2 * mpmath.pi / w) * value
    return exponential(t, 1j * omega).real


def sine(t: ArrayLike, omega: float = 1.0, digits: int | None = None) -> Any:
    """H(t) for f' = sin(ωτ), f(0) = 0: √(2π/ω) [sin ωt C(z) − cos ωt S(z)], z = √(2ωt/π)."""
    if digits is not None:
        with mpmath.workdps(digits + 10):
            time, w = mpmath.mpmathify(t), mpmath.mpmathify(omega)
            z = mpmath.sqrt(2 * w * time / mpmath.pi)
            value = mpmath.sin(w * time) * mpmath.fresnelc(z) - mpmath.cos(w * time) * mpmath.fresnels(z)
            return mpmath.sqrt(2 * mpmath.pi / w) * value
    return exponential(t, 1j * omega).imag


def power(t: ArrayLike, exponent: float, digits: int | None = None) -> Any:
    """H(t) for f' = τ^k, k > −1, f(0) = 0: B(1/2, k+1) t^(k+1/2)."""
    if digits is not None:
        with mpmath.workdps(digits + 10):
            k = mpmath.mpmathify(exponent)
            return mpmath.beta(mpmath.mpf(1) / 2, k + 1) * mpmath.mpmathify(t) ** (k + mpmath.mpf(1) / 2)
    return scipy.special.beta(0.5, exponent + 1.0) * np.asarray(t, dtype=np.float64) ** (exponent + 0.5)


def power_slip(t: ArrayLike, exponent: float, digits: int | None = None) -> Any:
    """H(t) for the slip f = τ^k, k > 0: k B(1/2, k) t^(k−1/2); π/2 at all times for f = √τ."""
    scale = exponent if digits is None else mpmath.mpmathify(exponent)
    return scale * power(t, exponent - 1.0, digits)


def step(t: ArrayLike, jump: float = 1.0, digits: int | None = None) -> Any:
    """H(t) for a slip that jumps at t = 0 and stays: jump·t^(-1/2); infinite at t = 0."""
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
    return (1 + (_bend(kernel) * s ** mpmath.mpf("1.5")) ** (1 / mpmath.mpf(kernel.c1))) ** -kernel.c1 / mpmath.sqrt(s)


def _bend(kernel: MeiAdrianKernel) -> Any:
    slip, viscosity = mpmath.mpf(kernel.slip), mpmath.mpf(kernel.viscosity)
    friction = mpmath.mpf("0.75") + mpmath.mpf(kernel.c2) * slip * mpmath.mpf(kernel.diameter) / viscosity
    return mpmath.sqrt(mpmath.pi) / 2 * (slip / friction / mpmath.sqrt(viscosity)) ** 3


def _panel_moments(k: int, degree: int, kernel: Kernel) -> list[Any]:
    """∫_k^{k+1} K(s) (s−k)^m ds, m = 0 … degree, in the current mpmath precision."""
    if isinstance(kernel, BassetKernel):
        half = mpmath.mpf(1) / 2
        raw = [((k + 1) ** (m + half) - mpmath.mpf(k) ** (m + half)) / (m + half) for m in range(degree + 1)]
        return [sum(mpmath.binomial(m, i) * (-k) ** (m - i) * raw[i] for i in range(m + 1)) for m in range(degree + 1)]
    points = [mpmath.mpf(k), mpmath.mpf(k + 1)]
    if k == 0 and isinstance(kernel, MeiAdrianKernel):  # follow the bend; the algebraic end is left to tanh-sinh
        turn = _bend(kernel) ** (-mpmath.mpf(2) / 3) if kernel.slip else mpmath.mpf(1)
        inner = (turn * mpmath.mpf(10) ** e for e in range(-6, 7, 2))
        points = [mpmath.mpf(0), *(x for x in inner if x < 1), mpmath.mpf(1)]
    return [mpmath.quad(lambda s, m=m: _value(s, kernel) * (s - k) ** m, points) for m in range(degree + 1)]


def product_weights(n: int, indices: Iterable[int], degree: int, kernel: Kernel = BassetKernel(), input: str = "rate", digits: int = 40) -> list[Any]:
    """Exact weights w[j] of product integration of that degree for a unit step, for j in `indices` (newest first).

    The definition, in mpmath: on panel [k, k+1] the polynomial through the samples from lag k − ⌊p/2⌋ on, shifted
    inwards at both ends, integrated against K (for slips: its derivative in time, and the first sample as a jump).
    Enough working digits are added to survive the cancellation.
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
            moments = _panel_moments(k, degree, kernel)
            for i in touched:
                polynomial = [mpmath.mpf(1)]  # coefficients in s − k of the Lagrange basis, lowest first
                for m in (m for m in range(degree + 1) if m != i):
                    shift, scale = mpmath.mpf(k - start - m), mpmath.mpf(i - m)
                    shifted = [mpmath.mpf(0), *polynomial]
                    polynomial = [((shift * polynomial[q] if q < len(polynomial) else 0) + shifted[q]) / scale for q in range(len(shifted))]
                if input == "slip":
                    polynomial = [-m * c for m, c in enumerate(polynomial)][1:]
                wanted[start + i] += sum(c * moment for c, moment in zip(polynomial, moments, strict=False))
        if input == "slip" and n in wanted:
            wanted[n] += _value(mpmath.mpf(n), kernel)
        return [+wanted[int(j)] for j in indices]


def response(t: ArrayLike, rate: float, coefficient: float, integrals: int = 0, digits: int | None = None) -> Any:
    """R(t): what a unit slip at t = 0 has become under y' = −λy − c·H[y]; Laplace transform 1/(s + c√π √s + λ).

    λ = `rate` (1/s), c = `coefficient` ≥ 0 (s^(-1/2)); `integrals` = 1, 2 for ∫R (s) and ∫∫R (s²). R falls from 1,
    at last as c/(2λ²) t^(-3/2). With r the roots of r² + c√π r + λ, R = (r1 E1 − r2 E2)/(r1 − r2), E = e^(r²t) erfc(−r√t);
    equal roots, λ = 0, c = 0, the smallest and the largest times included, to 1e-14 of max R (of the value, for the integrals).
    """
    if integrals not in (0, 1, 2):
        raise ValueError(f"integrals: {integrals!r} given; 0, 1 or 2 is possible")
    if digits is not None:
        return _responses.settled(lambda: _responses.response_digits(t, rate, coefficient, integrals), digits)
    return _responses.response(t, rate, coefficient, integrals)


def relaxing(t: ArrayLike, rate: float, coefficient: float, initial: float = 1.0, digits: int | None = None) -> Any:
    """y(t) of y' = −λy − c·H[y], y(0) = `initial`, a slip that the history remembers as its first jump: initial·R."""
    return (initial if digits is None else mpmath.mpmathify(initial)) * response(t, rate, coefficient, 0, digits)


def settling(t: ArrayLike, rate: float, coefficient: float, gravity: float = 1.0, digits: int | None = None) -> Any:
    """Velocity y(t), upward positive, of y' = −g − λy − c·H[y] from rest: −g ∫R; tends to −g/λ. g = `gravity` (m/s², reduced)."""
    return -(gravity if digits is None else mpmath.mpmathify(gravity)) * response(t, rate, coefficient, 1, digits)


def settling_height(t: ArrayLike, rate: float, coefficient: float, gravity: float = 1.0, digits: int | None = None) -> Any:
    """Height above the start of the same sphere: −g ∫∫R."""
    return -(gravity if digits is None else mpmath.mpmathify(gravity)) * response(t, rate, coefficient, 2, digits)


@dataclass(frozen=True)
class Bounces:
    """A bouncing sphere: impact times, jumps of the velocity there, and the exact motion up to `end`, the impact after the last.

    With `digits` times and jumps are mpmath numbers and height(t), velocity(t) take one time.
    """

    rate: float
    coefficient: float
    gravity: float
    start: float
    times: Any
    jumps: Any
    end: Any
    digits: int | None = None

    def velocity(self, t: Any) -> Any:
        """y(t) = −g∫R + Σ Δ_j R(t − t_j); at an impact the velocity after it."""
        return self._superpose(t, 1)

    def height(self, t: Any) -> Any:
        """z(t) = z(0) − g∫∫R + Σ Δ_j ∫R(t − t_j); 0 at every impact."""
        return self._superpose(t, 2)

    def _superpose(self, t: Any, integrals: int) -> Any:
        initial = self.start if integrals == 2 else 0.0
        if self.digits is not None:
            with mpmath.workdps(2 * self.digits + 25):
                part = _responses.response_digits
                value = initial - self.gravity * part(t, self.rate, self.coefficient, integrals)
                for at, jump in zip(self.times, self.jumps, strict=True):
                    if t >= at:
                        value += jump * part(t - at, self.rate, self.coefficient, integrals - 1)
                return value
        times = np.asarray(t, dtype=np.float64)
        value = initial - self.gravity * response(times, self.rate, self.coefficient, integrals)
        for at, jump in zip(self.times, self.jumps, strict=True):
            since = response(np.maximum(times - at, 0.0), self.rate, self.coefficient, integrals - 1)
            value = value + np.where(times >= at, jump * since, 0.0)
        return value[()]


def bouncing(
    rate: float, coefficient: float, gravity: float = 1.0, height: float = 1.0, restitution: float = 0.8, impacts: int = 10, digits: int | None = None
) -> Bounces:
    """A sphere dropped from rest at `height` on a plane at 0: y' = −g − λy − c·H[y], z' = y, y⁺ = −e y⁻ at each impact.

    Every jump Δ_j = −(1+e) y⁻ is remembered. Exact through `impacts` impacts; fewer come back (and `end` is the last)
    once a rebound is slower than 1e-13 of the fastest impact, which double precision cannot tell from rest.
    With `digits` the times are polished by Newton's method in mpmath (a few impacts: the cost grows quadratically).
    """
    if not (rate >= 0.0 and gravity > 0.0 and height > 0.0 and 0.0 <= restitution <= 1.0 and impacts >= 0):
        given = f"rate {rate}, gravity {gravity}, height {height}, restitution {restitution}, impacts {impacts}"
        raise ValueError(f"{given}: want ≥ 0, > 0, > 0, between 0 and 1, ≥ 0")
    times: list[Any] = []
    jumps: list[Any] = []
    nodes, weights = np.polynomial.legendre.leggauss(24)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0

    def before(t: Any) -> Any:  # velocity due to everything before the newest impact
        value = -gravity * response(t, rate, coefficient, 1)
        for at, jump in zip(times[:-1], jumps[:-1], strict=True):
            value = value + jump * response(t - at, rate, coefficient)
        return value

    def above(s: Any) -> Any:  # height a time s after the newest impact, without the cancellation between old flights
        s = np.asarray(s, dtype=np.float64)
        if not times:
            return height - gravity * response(s, rate, coefficient, 2)
        return s * (before(times[-1] + s[..., None] * nodes) @ weights) + jumps[-1] * response(s, rate, coefficient, 1)

    end, fastest, up = 0.0, 0.0, 0.0
    for number in range(impacts + 1):
        guess = np.sqrt(2.0 * height / gravity) if number == 0 else 2.0 * up / gravity
        low, high = (0.999 * guess if number == 0 else 1e-4 * guess), guess
        grid = np.geomspace(low, high, 25)
        while not np.any(below := above(grid) < 0.0):
            grid = np.geomspace(grid[-1], 8.0 * grid[-1], 25)
        first = int(np.argmax(below))
        if first == 0 and number:  # a flight that history ends almost at once
            grid, first = np.append(grid[:1] * 1e-12, grid), 1
        left, right = float(grid[max(first - 1, 0)]), float(grid[first])
        if above(left) <= 0.0 or above(right) >= 0.0:  # rounding: the impact is on a node
            flight = left if above(left) <= 0.0 else right
        else:
            flight = float(scipy.optimize.brentq(above, left, right, xtol=1e-300, rtol=1e-15))
        end = (times[-1] if times else 0.0) + flight
        if number == impacts:
            break
        times.append(end)
        jumps.append(0.0)
        down = float(before(end))
        jumps[-1] = -(1.0 + restitution) * down
        fastest, up = max(fastest, -down), -restitution * down
        if up <= 1e-13 * fastest:
            break
    plain = Bounces(rate, coefficient, gravity, height, np.array(times), np.array(jumps), end)
    return plain if digits is None else _polished(plain, restitution, digits)


def _polished(plain: Bounces, restitution: float, digits: int) -> Bounces:
    """The same bounces in mpmath: Newton's method on the height, impact by impact."""
    guesses = [*plain.times, plain.end] if len(plain.times) == 0 or plain.end > plain.times[-1] else list(plain.times)
    times: list[Any] = []
    jumps: list[Any] = []
    with mpmath.workdps(2 * digits + 25):
        for guess in guesses:
            partial = replace(plain, times=tuple(times), jumps=tuple(jumps), digits=digits)
            time = mpmath.mpf(float(guess))
            for _ in range(digits.bit_length() + 4):
                change = partial.height(time) / partial.velocity(time)
                time -= change
                if abs(change) < time * mpmath.mpf(10) ** -(digits + 8):
                    break
            if len(times) < len(plain.times):
                jumps.append(-(1 + mpmath.mpf(restitution)) * partial.velocity(time))
                times.append(time)
        return replace(plain, times=tuple(times), jumps=tuple(jumps), end=time, digits=digits)
