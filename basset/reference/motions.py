"""Exact motions with memory, y' = f − c·H[y] where f is linear: by inverse Laplace transforms. For K(s) = s^(-1/2).

Times t are arrays (...) in s, λ = `rate` in 1/s, c = `coefficient` in s^(-1/2) and ω = `omega` in 1/s; λ and c are 0 or greater. With `digits` t is one
number and the result an mpmath number correct to that many digits. The solutions follow from `response` by superposition or by
Laplace transforms (this library), where no paper is named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import mpmath
import numpy as np
import scipy.optimize
from numpy.typing import ArrayLike

from basset import _validate
from basset.reference import _laplace


def response(t: ArrayLike, rate: float, coefficient: float, integrals: int = 0, digits: int | None = None) -> Any:
    """R(t): what a unit slip at t = 0 has become under y' = −λy − c·H[y]; Laplace transform 1/(s + c√π √s + λ).

    `integrals` 1 and 2 give ∫R (s) and ∫∫R (s²). R falls from 1, at last as c/(2λ²) t^(-3/2). With r the roots of r² + c√π r + λ,
    R = (r1 E1 − r2 E2)/(r1 − r2), E = e^(r²t) erfc(−r√t); equal roots, λ = 0, c = 0, the smallest and the largest times included, to 1e-14 of
    max R (of the value, for the integrals). Laplace transform of s^(-1/2); Abramowitz & Stegun 7.1.
    """
    if integrals not in (0, 1, 2):
        raise ValueError(f"integrals must be 0, 1 or 2, got {integrals!r}")
    if digits is not None:
        return _laplace.converged(lambda: _laplace.response_digits(t, rate, coefficient, integrals), digits)
    return _laplace.response(t, rate, coefficient, integrals)


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
                part = _laplace.response_digits
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
    slower than 1e-13 of the fastest impact, which double precision cannot distinguish from rest. With `digits` the times are polished by Newton's
    method in mpmath (a few impacts: the cost grows quadratically).

    >>> bouncing(0.0, 0.0, gravity=2.0, height=1.0, restitution=0.5, impacts=2).times.round(12)  # a ball in vacuum: 1, then half as long each way
    array([1., 2.])
    """
    _validate.non_negative("rate", rate, "1/s")
    _validate.positive("gravity", gravity, "m/s²")
    _validate.positive("height", height, "m")
    _validate.integer("impacts", impacts, 0)
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must be from 0 to 1, got {restitution}")
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
            held = _laplace.response_digits(time, rate, coefficient, 0)
            if not omega:
                return start * held + drive * _laplace.response_digits(time, rate, coefficient, 1)
            driven = _laplace.inverse_digits(_laplace.oscillation(rate, coefficient, abs(omega)), time)
            return start * held + drive * mpmath.re(driven)

        return _laplace.converged(compute, digits)
    if not omega:
        return initial_slip * response(t, rate, coefficient) + amplitude * response(t, rate, coefficient, 1)
    driven = _laplace.oscillating(t, float(rate), float(coefficient), abs(float(omega)))
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
    for name, value in (("rate", rate), ("coefficient", coefficient), ("beta", beta)):
        _validate.non_negative(name, value)
    if not rate + coefficient + beta > 0.0:
        raise ValueError("rate, coefficient and beta must not all be 0: no force would act on the particle")
    if not omega:
        number = complex if digits is None else mpmath.mpmathify
        held, moved = (response(t, rate, coefficient, n, digits) for n in (0, 1))
        return VortexMotion(number(position) + number(initial_slip) * moved, number(initial_slip) * held)

    def transform(of_slip: bool) -> _laplace.Rational:
        def rational() -> tuple[list[Any], list[Any], list[Any] | None]:
            decay, b, share = mpmath.mpmathify(rate), mpmath.mpmathify(coefficient) * mpmath.sqrt(mpmath.pi), mpmath.mpmathify(beta)
            z, w, turn = mpmath.mpmathify(position), mpmath.mpmathify(initial_slip), mpmath.mpc(0, mpmath.mpmathify(omega))
            below = [mpmath.mpf(1), b, decay, -turn * b, -turn * decay - share * turn**2]
            return ([w, 0, -turn * w - (1 - share) * turn**2 * z] if of_slip else [z, b * z, (decay + turn) * z + w]), below, None

        return rational

    if digits is not None:
        values = (mpmath.mpmathify(position), mpmath.mpmathify(initial_slip))
        if t:
            values = tuple(_laplace.converged(partial(_laplace.inverse_digits, transform(which), t), digits) for which in (False, True))
        return VortexMotion(*values)
    return VortexMotion(_laplace.inverse(transform(False), t), _laplace.inverse(transform(True), t))


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
    _validate.positive("inertia", inertia)
    _validate.non_negative("damping", damping, "s^(-1/2)")
    _validate.non_negative("stiffness", stiffness, "s^(-2)")
    if not stiffness and ramp:
        raise ValueError(f"stiffness must be > 0 for a force that grows (ramp = {ramp}), got 0")

    def exact(value: Any) -> Any:
        return mpmath.mpmathify(value)

    def transform(of_velocity: bool) -> _laplace.Rational:
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
            free = exact(force) / a * _laplace.response_digits(time, 0, exact(damping) / a / mpmath.sqrt(mpmath.pi), 1 if of_velocity else 2)
            return free + (exact(velocity) if of_velocity else exact(position) + exact(velocity) * time)
        steady = exact(ramp) / c if of_velocity else (exact(force) + exact(ramp) * time) / c
        return steady + mpmath.re(_laplace.inverse_digits(transform(of_velocity), time))

    if digits is not None:
        return Oscillator(*(_laplace.converged(partial(moved, of_velocity, t), digits) for of_velocity in (False, True)))
    times = np.asarray(t, dtype=np.float64)
    if not stiffness:
        drag = damping / inertia / np.sqrt(np.pi)
        gain = force / inertia
        return Oscillator(position + velocity * times + gain * response(times, 0.0, drag, 2), velocity + gain * response(times, 0.0, drag, 1))
    answer = []
    for of_velocity in (False, True):
        still = np.broadcast_to(ramp / stiffness if of_velocity else (force + ramp * times) / stiffness, times.shape)
        value = np.array(still + _laplace.inverse(transform(of_velocity), times).real)
        for i in np.argwhere((200.0 * np.abs(value) < np.abs(still)) & (times > 0.0)):  # near the start, rest and equilibrium cancel
            at = tuple(i)
            value[at] = float(_laplace.converged(partial(moved, of_velocity, float(times[at])), 17))
        answer.append(value[()])
    return Oscillator(*answer)
