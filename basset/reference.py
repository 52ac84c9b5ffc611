"""The truth: closed forms of the history integral in double precision, and the same in mpmath to any number of digits.

Every function takes `digits=None`: then t may be an array (...) in seconds and the result is float64 of its shape; with `digits` t is one
number and the result an mpmath number correct to that many digits, from a formula of its own where double precision
needs a special one. `product_weights` gives exact weights of product integration. All for K(s) = s^(-1/2) unless said.

H has the unit of f × s^(-1/2). In the equations of motion λ = `rate` in 1/s, c = `coefficient` in s^(-1/2) and ω = `omega` in 1/s; λ and c are 0 or
greater. Their solutions follow from `response` by superposition or by Laplace transforms (this library), where no paper is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import mpmath
import numpy as np
import scipy.optimize
import scipy.special
from numpy.typing import ArrayLike

from basset import _responses
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
    return (1 + (_bend(kernel) * s ** mpmath.mpf("1.5")) ** (1 / mpmath.mpf(kernel.c1))) ** -kernel.c1 / mpmath.sqrt(s)


def _bend(kernel: MeiAdrianKernel) -> Any:
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
        turn = _bend(kernel) ** (-mpmath.mpf(2) / 3) if kernel.slip else mpmath.mpf(1)
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


def response(t: ArrayLike, rate: float, coefficient: float, integrals: int = 0, digits: int | None = None) -> Any:
    """R(t): what a unit slip at t = 0 has become under y' = −λy − c·H[y]; Laplace transform 1/(s + c√π √s + λ).

    `integrals` 1 and 2 give ∫R (s) and ∫∫R (s²). R falls from 1, at last as c/(2λ²) t^(-3/2). With r the roots of r² + c√π r + λ,
    R = (r1 E1 − r2 E2)/(r1 − r2), E = e^(r²t) erfc(−r√t); equal roots, λ = 0, c = 0, the smallest and the largest times included, to 1e-14 of
    max R (of the value, for the integrals). Laplace transform of s^(-1/2); Abramowitz & Stegun 7.1.
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
    """Velocity y(t) in m/s, upward positive, of y' = −g − λy − c·H[y] from rest, g = `gravity` (reduced) in m/s²: −g ∫R; tends to −g/λ."""
    return -(gravity if digits is None else mpmath.mpmathify(gravity)) * response(t, rate, coefficient, 1, digits)


def settling_height(t: ArrayLike, rate: float, coefficient: float, gravity: float = 1.0, digits: int | None = None) -> Any:
    """Height in m above the start of the sphere of `settling`: −g ∫∫R."""
    return -(gravity if digits is None else mpmath.mpmathify(gravity)) * response(t, rate, coefficient, 2, digits)


@dataclass(frozen=True)
class Bounces:
    """A bouncing sphere: impact times, jumps of the velocity there, and the exact motion up to `end`, by superposition of `response`.

    With `digits` times and jumps are mpmath numbers and height(t), velocity(t) take one time.
    """

    rate: float  # λ, 1/s
    coefficient: float  # c, s^(-1/2)
    gravity: float  # g, m/s²
    start: float  # height at t = 0, m
    times: Any  # of the impacts (impacts,), s
    jumps: Any  # of the velocity there (impacts,), m/s
    end: Any  # the impact after the last, s
    digits: int | None = None  # of the mpmath numbers; None: float64

    def velocity(self, t: Any) -> Any:
        """y(t) = −g∫R + Σ Δ_j R(t − t_j) in m/s, t (...) from 0 to `end`; at an impact the velocity after it."""
        return self._superpose(t, 1)

    def height(self, t: Any) -> Any:
        """z(t) = z(0) − g∫∫R + Σ Δ_j ∫R(t − t_j) in m, t (...) from 0 to `end`; 0 at every impact."""
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
    """A sphere dropped from rest at `height` (m) on a plane at 0: y' = −g − λy − c·H[y], z' = y, y⁺ = −e y⁻ at each impact, e = `restitution`.

    Every jump Δ_j = −(1+e) y⁻ is remembered. Exact through `impacts` impacts; fewer come back (and `end` is the last) once a rebound is
    slower than 1e-13 of the fastest impact, which double precision cannot tell from rest. With `digits` the times are polished by Newton's
    method in mpmath (a few impacts: the cost grows quadratically).

    >>> bouncing(0.0, 0.0, gravity=2.0, height=1.0, restitution=0.5, impacts=2).times.round(12)  # a ball in the void: 1, then half as long each way
    array([1., 2.])
    """
    if not (rate >= 0.0 and gravity > 0.0 and height > 0.0 and 0.0 <= restitution <= 1.0 and impacts >= 0):
        given = f"rate {rate}, gravity {gravity}, height {height}, restitution {restitution}, impacts {impacts}"
        raise ValueError(f"{given}: want ≥ 0, > 0, > 0, between 0 and 1, ≥ 0")
    times: list[Any] = []
    jumps: list[Any] = []
    nodes, weights = np.polynomial.legendre.leggauss(24)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0

    def before(t: Any) -> Any:  # velocity due to everything before the newest impact
        older = np.asarray(t)[..., None] - np.array(times[:-1])
        return response(older, rate, coefficient) @ np.array(jumps[:-1]) - gravity * response(t, rate, coefficient, 1)

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


def oscillating_stream(
    t: ArrayLike, rate: float, coefficient: float, amplitude: float = 1.0, omega: float = 1.0, initial_slip: float = 0.0, digits: int | None = None
) -> Any:
    """Slip y(t) in m/s of y' = A cos ωt − λy − c·H[y], y(0) = `initial_slip` remembered: initial·R + A ∫R(t−τ) cos ωτ dτ, A = `amplitude` in m/s².

    The whole transient, by the forcing's Laplace transform. A stream u = u0 sin ωt past a free sphere gives A = (β−1) ω u0, β = 3/(2ρ_s/ρ + 1). At last
    y = Re A e^(iωt)/(iω + c√π √(iω) + λ).
    """
    if digits is not None:

        def compute() -> Any:
            start, drive, time = mpmath.mpmathify(initial_slip), mpmath.mpmathify(amplitude), mpmath.mpmathify(t)
            if not time:
                return start
            held = _responses.response_digits(time, rate, coefficient, 0)
            if not omega:
                return start * held + drive * _responses.response_digits(time, rate, coefficient, 1)
            driven = _responses.inverse_digits(_responses.oscillation(rate, coefficient, abs(omega)), time)
            return start * held + drive * mpmath.re(driven)

        return _responses.settled(compute, digits)
    if not omega:
        return initial_slip * response(t, rate, coefficient) + amplitude * response(t, rate, coefficient, 1)
    driven = _responses.oscillating(t, float(rate), float(coefficient), abs(float(omega)))
    return initial_slip * response(t, rate, coefficient) + amplitude * driven.real


class VortexMotion(NamedTuple):
    """Particle position x + iy (m) and slip (velocity less the fluid's at the particle, m/s), complex, each (...)."""

    position: Any
    slip: Any


def solid_body_vortex(
    t: ArrayLike,
    rate: float,
    coefficient: float,
    beta: float,
    omega: float = 1.0,
    position: complex = 1.0,
    initial_slip: complex = 0.0,
    digits: int | None = None,
) -> VortexMotion:
    """A particle in the fluid velocity u = iωz, z = x + iy: Maxey–Riley without gravity and Faxén terms, by its transform; ValueError if λ = c = β = 0.

    v' = β Du/Dt − λw − c·H[w] with w = v − u and Du/Dt = −ω²z; as v' = w' + iω(w + iωz),

        z' = w + iωz,   w' = −(λ + iω) w + (1 − β) ω² z − c·H[w],   z(0) = `position`,   w(0) = `initial_slip` remembered.

    β = 3/(2ρ_s/ρ + 1), 0 or greater (heavy particles β < 1 spiral out). In the numbers of Prasath, Vasan & Govindarajan (2019), R = 1/β and S:
    λ = 1/(RS), c = √(3/(πS))/R. Source: Candelier, Angilella & Souhar (2004). The four poles are the roots in √s of
    (s − iω)(s + c√π √s + λ + iω) − (1 − β)ω².

    >>> motion = solid_body_vortex(1.0, 1.0, 0.5, beta=1.0)  # as heavy as the fluid: it goes round with it
    >>> bool(abs(abs(motion.position) - 1.0) < 1e-12), bool(abs(motion.slip) < 1e-12)
    (True, True)
    """
    if not (rate >= 0.0 and coefficient >= 0.0 and beta >= 0.0 and rate + coefficient + beta > 0.0):
        raise ValueError(f"rate {rate}, coefficient {coefficient}, beta {beta}: want ≥ 0 and not all 0 (then the particle flies straight on)")
    if not omega:
        number = complex if digits is None else mpmath.mpmathify
        held, moved = (response(t, rate, coefficient, n, digits) for n in (0, 1))
        return VortexMotion(number(position) + number(initial_slip) * moved, number(initial_slip) * held)

    def transform(of_slip: bool) -> _responses.Rational:
        def rational() -> tuple[list[Any], list[Any], list[Any] | None]:
            decay, b, share = mpmath.mpmathify(rate), mpmath.mpmathify(coefficient) * mpmath.sqrt(mpmath.pi), mpmath.mpmathify(beta)
            z, w, turn = mpmath.mpmathify(position), mpmath.mpmathify(initial_slip), mpmath.mpc(0, mpmath.mpmathify(omega))
            below = [mpmath.mpf(1), b, decay, -turn * b, -turn * decay - share * turn**2]
            return ([w, 0, -turn * w - (1 - share) * turn**2 * z] if of_slip else [z, b * z, (decay + turn) * z + w]), below, None

        return rational

    if digits is not None:
        values = (mpmath.mpmathify(position), mpmath.mpmathify(initial_slip))
        if t:
            values = tuple(_responses.settled(partial(_responses.inverse_digits, transform(which), t), digits) for which in (False, True))
        return VortexMotion(*values)
    return VortexMotion(_responses.inverse(transform(False), t), _responses.inverse(transform(True), t))


class Oscillator(NamedTuple):
    """Position y (...) and velocity y' (...), in the unit of the initial position and that per second."""

    position: Any
    velocity: Any


def bagley_torvik(
    t: ArrayLike,
    inertia: float = 1.0,
    damping: float = 1.0,
    stiffness: float = 1.0,
    force: float = 0.0,
    ramp: float = 0.0,
    position: float = 0.0,
    velocity: float = 0.0,
    digits: int | None = None,
) -> Oscillator:
    """y(t), y'(t) of A y'' + B D^(3/2) y + C y = F + Gt, D^(3/2) Caputo's derivative (Bagley & Torvik 1984).

    A > 0, B ≥ 0, C ≥ 0 are `inertia` (dimensionless), `damping` (s^(-1/2)), `stiffness` (s^(-2)); F = `force`, G = `ramp`, which needs C > 0.
    As an equation with memory: y' = v, v' = (F + Gt − Cy)/A − c·H[v] with c = B/(A√π), memory=[1] and initial_slip=[0]: Caputo's derivative forgets the
    initial velocity's own jump. With F = C y(0), G = C y'(0) the solution is the line y(0) + y'(0) t: the classical A = B = C = 1, y = 1 + t. Else the
    poles are the roots in √s of A s² + B s^(3/2) + C.

    >>> line = bagley_torvik(3.0, force=1.0, ramp=1.0, position=1.0, velocity=1.0)
    >>> abs(float(line.position) - 4.0) < 1e-12, abs(float(line.velocity) - 1.0) < 1e-12
    (True, True)
    """
    if not (inertia > 0.0 and damping >= 0.0 and stiffness >= 0.0):
        raise ValueError(f"inertia {inertia}, damping {damping}, stiffness {stiffness}: want > 0, ≥ 0, ≥ 0")
    if not stiffness and ramp:
        raise ValueError("ramp: a growing force needs stiffness > 0")

    def exact(value: Any) -> Any:
        return mpmath.mpmathify(value)

    def transform(of_velocity: bool) -> _responses.Rational:
        def rational() -> tuple[list[Any], list[Any], list[Any] | None]:
            a, b, c = exact(inertia), exact(damping), exact(stiffness)
            y, v = exact(position) - exact(force) / c, exact(velocity) - exact(ramp) / c
            if of_velocity:
                return [a * v, b * v, -c * y], [a, b, mpmath.mpf(0), mpmath.mpf(0), c], None
            return [a * y, b * y, a * v, b * v], [a, b, mpmath.mpf(0), mpmath.mpf(0), c, mpmath.mpf(0)], None

        return rational

    def moved(of_velocity: bool, at: Any) -> Any:
        a, c, time = exact(inertia), exact(stiffness), exact(at)
        if not time:
            return exact(velocity if of_velocity else position)
        if not stiffness:
            free = exact(force) / a * _responses.response_digits(time, 0, exact(damping) / a / mpmath.sqrt(mpmath.pi), 1 if of_velocity else 2)
            return free + (exact(velocity) if of_velocity else exact(position) + exact(velocity) * time)
        steady = exact(ramp) / c if of_velocity else (exact(force) + exact(ramp) * time) / c
        return steady + mpmath.re(_responses.inverse_digits(transform(of_velocity), time))

    if digits is not None:
        return Oscillator(*(_responses.settled(partial(moved, of_velocity, t), digits) for of_velocity in (False, True)))
    times = np.asarray(t, dtype=np.float64)
    if not stiffness:
        drag = damping / inertia / np.sqrt(np.pi)
        gain = force / inertia
        return Oscillator(position + velocity * times + gain * response(times, 0.0, drag, 2), velocity + gain * response(times, 0.0, drag, 1))
    answer = []
    for of_velocity in (False, True):
        still = np.broadcast_to(ramp / stiffness if of_velocity else (force + ramp * times) / stiffness, times.shape)
        value = np.array(still + _responses.inverse(transform(of_velocity), times).real)
        for i in np.argwhere((200.0 * np.abs(value) < np.abs(still)) & (times > 0.0)):  # near the start, rest and equilibrium cancel
            at = tuple(i)
            value[at] = float(_responses.settled(partial(moved, of_velocity, float(times[at])), 17))
        answer.append(value[()])
    return Oscillator(*answer)
