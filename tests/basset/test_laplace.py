"""References of equations with memory: against inverse Laplace transforms, defining equations and limits, in double and with digits."""

import itertools
import math

import mpmath
import numpy as np
import pytest
import scipy.integrate
import scipy.special

from basset import reference
from basset.reference import _laplace

EQUAL = math.pi / 4  # λ = πc²/4 with c = 1: both roots −√π/2
CASES = {
    "usual": (1.0, 0.6),
    "slow history": (1.0, 1e-6),
    "fast history": (1.0, 1e4),
    "no history": (2.0, 0.0),
    "no drag": (0.0, 0.6),
    "neither": (0.0, 0.0),
    "equal roots": (EQUAL, 1.0),
    "nearly equal, real": (EQUAL * (1 - 1e-9), 1.0),
    "nearly equal, complex": (EQUAL * (1 + 1e-5), 1.0),
    "stiff": (1e6, 3.0),
}


def apart(value, truth):
    return max(abs(complex(a) - complex(b)) for a, b in zip(value, truth, strict=True)) / (max(abs(complex(b)) for b in truth) or 1.0)


def history(slip, rate_of, t):
    """H at t of a slip with H's own first jump, by tanh-sinh in σ = √(t−τ) and √τ: both ends are algebraic."""
    half = mpmath.mpf(t) / 2
    near = mpmath.quad(lambda s: 2 * rate_of(t - s * s), [0, mpmath.sqrt(half)])
    far = mpmath.quad(lambda s: 2 * s * rate_of(s * s) / mpmath.sqrt(t - s * s), [0, mpmath.sqrt(half)])
    return slip / mpmath.sqrt(t) + near + far


@pytest.mark.parametrize(("rate", "coefficient"), CASES.values(), ids=CASES)
@pytest.mark.parametrize("integrals", [0, 1, 2])
def test_response_in_double_and_with_digits(rate, coefficient, integrals):
    scale = rate or coefficient**2 or 1.0
    times = np.array([0.0, 1e-60, 1e-9, 0.02, 0.9, 1.1, 7.0, 45.0, 300.0, 1e5, 1e12]) / scale
    value = reference.response(times, rate, coefficient, integrals)
    for t, number in zip(times, value, strict=True):
        truth = reference.response(t, rate, coefficient, integrals, digits=20)
        assert abs(number - truth) <= 1e-14 * (abs(truth) if integrals else 1.0)


def test_response_on_random_parameters():
    random = np.random.default_rng(5)
    for _ in range(30):
        rate = 10 ** random.uniform(-4, 4)
        coefficient = 10 ** random.uniform(-3, 3) * math.sqrt(rate)
        near = 4 * rate / math.pi * (1 + random.choice([-1, 1]) * 10 ** random.uniform(-16, -0.5))
        for c in (coefficient, math.sqrt(near)):
            times = 10 ** random.uniform(-4, 4, 2) / rate
            truth = [reference.response(t, rate, c, digits=16) for t in times]
            np.testing.assert_allclose(reference.response(times, rate, c), np.array(truth, dtype=float), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["usual", "no drag", "equal roots", "nearly equal, complex", "fast history"])
@pytest.mark.parametrize("integrals", [0, 1, 2])
def test_response_is_the_inverse_of_its_transform(name, integrals):
    rate, coefficient = CASES[name]
    with mpmath.workdps(30):
        for t in (0.3, 4.0):
            talbot = mpmath.invertlaplace(
                lambda s: 1 / s**integrals / (s + coefficient * mpmath.sqrt(mpmath.pi * s) + rate), mpmath.mpf(t), method="talbot", degree=40
            )
            assert reference.response(t, rate, coefficient, integrals, digits=20) == pytest.approx(talbot, rel=1e-15, abs=1e-17)


def test_digits_are_kept():
    for rate, c in CASES.values():
        with mpmath.workdps(60):
            few, many = reference.response(0.7, rate, c, digits=20), reference.response(0.7, rate, c, digits=50)
            assert abs(few - many) <= 1e-20 * abs(many)


def test_limits():
    t = np.geomspace(1e-6, 30.0, 60)
    np.testing.assert_allclose(reference.relaxing(t, 2.0, 0.0, 3.0), 3 * np.exp(-2 * t), atol=1e-14)
    np.testing.assert_allclose(reference.settling(t, 2.0, 0.0, 9.81), 9.81 / 2 * np.expm1(-2 * t), rtol=1e-14)
    np.testing.assert_allclose(reference.relaxing(t, 0.0, 0.6), scipy.special.erfcx(0.6 * np.sqrt(np.pi * t)), rtol=1e-13)  # e^(πc²t) erfc(c√(πt))
    np.testing.assert_allclose(reference.settling_height(t, 1e-18, 1e-18, 9.81), -9.81 * t**2 / 2, rtol=1e-14)
    np.testing.assert_allclose(reference.relaxing(t, 1.0, 1e-18), np.exp(-t), atol=1e-14)
    late = 1e14
    assert reference.response(late, 2.0, 0.6) == pytest.approx(0.3 / 4 * late**-1.5, rel=1e-6)
    assert reference.settling(late, 2.0, 0.6) == pytest.approx(-0.5, rel=1e-6)


def test_response_takes_scalars_and_shapes_and_names_bad_input():
    assert isinstance(reference.response(1.0, 1.0, 0.6), float)
    assert reference.response(np.ones((2, 3)), 1.0, 0.6).shape == (2, 3)
    assert reference.response(1, 1, 0) == pytest.approx(math.exp(-1))
    assert reference.response([], 1.0, 0.6).shape == (0,)
    with pytest.raises(ValueError, match="coefficient"):
        reference.response(1.0, 1.0, -0.6)
    with pytest.raises(ValueError, match="integrals"):
        reference.response(1.0, 1.0, 0.6, 3)


@pytest.mark.parametrize("name", ["usual", "equal roots"])
def test_relaxing_satisfies_its_equation(name):
    rate, c = CASES[name]
    t = mpmath.mpf(2)
    with mpmath.workdps(25):

        def y(time):
            return _laplace.response_digits(time, rate, c, 0)

        def slope(time):  # y' = −λy − c·H: differentiate instead, the equation is what is tested
            return mpmath.diff(y, time, h=mpmath.mpf(10) ** -10 * time)

        residual = slope(t) + rate * y(t) + c * history(1, slope, t)
    assert abs(residual) < 1e-11


@pytest.mark.parametrize(
    ("rate", "c", "omega", "start"),
    [
        (1.0, 0.6, 1.0, 0.0),
        (1.0, 0.6, 30.0, 0.1),
        (0.0, 0.6, 1.0, 0.0),
        (0.0, 0.0, 1.0, 0.5),
        (EQUAL, 1.0, 2.0, 0.0),
        (1.0, math.sqrt(2 / math.pi), 1.0, 0.0),  # a root of the sphere meets one of the stream
        (1.0, 0.79788, 1.0, 0.0),
        (0.0, 1.0, 1e-8, 0.0),
        (2.0, 1.0, 0.0, 1.0),
        (1.0, 1e-9, 3.0, 0.0),
        (1e6, 10.0, 1.0, 0.0),
        (1.0, 1.0, -1e4, 0.0),
    ],
)
def test_oscillating_stream(rate, c, omega, start):
    times = np.array([0.0, 1e-7, 0.1, 0.9, 2.0, 60.0, 3000.0])
    value = reference.oscillating_stream(times, rate, c, 1.3, omega, start)
    assert apart(value, [reference.oscillating_stream(t, rate, c, 1.3, omega, start, digits=18) for t in times]) < 1e-13
    t = 0.9  # and by the convolution that defines it
    if abs(omega) < 100 and rate < 1e3:
        drive = scipy.integrate.quad(
            lambda x: 2 * x * reference.response(x * x, rate, c) * math.cos(omega * (t - x * x)), 0.0, math.sqrt(t), limit=400, epsabs=1e-13
        )[0]
        assert value[3] == pytest.approx(start * reference.response(t, rate, c) + 1.3 * drive, abs=1e-11)


def test_oscillating_stream_ends_in_the_frequency_response():
    rate, c, omega, t = 1.0, 0.6, 2.0, 1e8
    steady = np.exp(1j * omega * t) / (1j * omega + c * math.sqrt(math.pi) * np.sqrt(1j * omega) + rate)
    assert reference.oscillating_stream(t, rate, c, 1.0, omega) == pytest.approx(steady.real, abs=1e-11)


VORTICES = [  # rate, coefficient, β, ω, position, slip
    (1 / 0.078, math.sqrt(3 / (math.pi * 0.1)) / 0.78, 1 / 0.78, 1.0, 1.0, 0.0),
    (1.0, 0.6, 0.3, 1.0, 1 + 1j, 0.2),
    (1.0, 0.0, 0.5, 2.0, 1.0, 0.1j),
    (0.0, 0.6, 2.5, -1.0, 1.0, 0.0),
    (1.0, 0.6, 1.0, 1.0, 0.0, 0.3),
    (1e3, 30.0, 0.5, 1.0, 1.0, 0.0),
    (1.0, 0.6, 0.5, 0.0, 1.0, 1.0),
]


@pytest.mark.parametrize("case", VORTICES)
def test_solid_body_vortex_in_double_and_with_digits(case):
    times = np.array([0.0, 1e-7, 0.01, 0.4, 1.5, 20.0])
    value = reference.solid_body_vortex(times, *case)
    truth = [reference.solid_body_vortex(t, *case, digits=18) for t in times]
    assert apart(value.position, [v.position for v in truth]) < 1e-13
    assert apart(value.slip, [v.slip for v in truth]) < 1e-13
    assert value.position[0] == pytest.approx(case[4]) and value.slip[0] == pytest.approx(case[5])


def test_solid_body_vortex_satisfies_the_particle_equation():
    rate, c, beta, omega, _, start = case = VORTICES[1]
    t = mpmath.mpf(1)
    with mpmath.workdps(20):
        cached = {}

        def motion(time):
            if time not in cached:
                cached[time] = reference.solid_body_vortex(time, *case, digits=20)
            return cached[time]

        def slip_rate(time):  # smooth in √t
            return mpmath.diff(lambda x: motion(x).slip, time, h=mpmath.mpf(10) ** -7 * time)

        root = mpmath.sqrt(t / 2)
        nodes, weights = np.polynomial.legendre.leggauss(24)
        near = mpmath.fsum(w * root * slip_rate(t - (root * (mpmath.mpf(x) + 1) / 2) ** 2) for x, w in zip(nodes, weights, strict=True))
        far = mpmath.mpf(0)
        for x, w in zip(nodes, weights, strict=True):
            s = root * (mpmath.mpf(x) + 1) / 2
            far += w * root * s * slip_rate(s * s) / mpmath.sqrt(t - s * s)
        memory = start / mpmath.sqrt(t) + near + far
        z, w = motion(t)
        speed = mpmath.diff(lambda x: motion(x).position, t, h=mpmath.mpf(10) ** -7)
        assert abs(speed - w - 1j * omega * z) < 1e-12
        acceleration = slip_rate(t) + 1j * omega * speed  # of v = w + iωz
        assert abs(acceleration - (beta * -(omega**2) * z - rate * w - c * memory)) < 1e-9


def test_solid_body_vortex_without_history_is_an_ordinary_equation():
    rate, _, beta, omega, z, w = 1.0, 0.0, 0.5, 2.0, 1.0 + 0j, 0.1j
    matrix = np.array([[1j * omega, 1.0], [(1 - beta) * omega**2, -(rate + 1j * omega)]])
    values, vectors = np.linalg.eig(matrix)
    exact = vectors @ (np.exp(3.0 * values) * np.linalg.solve(vectors, np.array([z, w])))
    assert apart(reference.solid_body_vortex(3.0, rate, 0.0, beta, omega, z, w), exact) < 1e-13


@pytest.mark.parametrize(
    "case",
    [
        (1, 1, 1, 1),
        (1, 1, 1, 0, 0, 1, 1),
        (1, 0, 4, 1, 0, 0, 0.3),
        (1, 1e-6, 1, 0, 0, 1, 0.3),
        (1, 50, 1, 0, 1, 1, 1),
        (2, 1, 0, 1, 0, 1, 1),
        (1, 1, 1e-8, 1),
        (1, 0.5, 0.5, 8),
    ],
)
def test_bagley_torvik_in_double_and_with_digits(case):
    times = np.array([0.0, 1e-7, 0.01, 0.4, 1.5, 20.0, 200.0])
    value = reference.bagley_torvik(times, *case)
    truth = [reference.bagley_torvik(t, *case, digits=18) for t in times]
    assert apart(value.position, [v.position for v in truth]) < 1e-13
    assert apart(value.velocity, [v.velocity for v in truth]) < 1e-13


def test_bagley_torvik_line_oscillator_and_transform():
    t = np.linspace(0.0, 30.0, 50)
    line = reference.bagley_torvik(t, force=1.0, ramp=1.0, position=1.0, velocity=1.0)
    np.testing.assert_allclose(line.position, 1 + t, rtol=1e-14)
    np.testing.assert_allclose(line.velocity, 1.0, rtol=1e-14)
    free = reference.bagley_torvik(t, 1.0, 0.0, 4.0, position=1.0)
    np.testing.assert_allclose(free.position, np.cos(2 * t), atol=1e-13)
    with mpmath.workdps(30):
        for time in (0.5, 4.0):  # y(0) = 0.3, y'(0) = 0.7, F = 2, Caputo
            talbot = mpmath.invertlaplace(
                lambda s: (2 / s + 3 * (s * 0.3 + 0.7) + 1.5 * (mpmath.sqrt(s) * 0.3 + 0.7 / mpmath.sqrt(s))) / (3 * s**2 + 1.5 * s**1.5 + 0.5),
                mpmath.mpf(time),
                method="talbot",
                degree=40,
            )
            exact = reference.bagley_torvik(time, 3.0, 1.5, 0.5, 2.0, position=0.3, velocity=0.7, digits=20)
            assert exact.position == pytest.approx(talbot, rel=1e-14)


def test_bagley_torvik_is_an_equation_with_memory():
    c = 1 / mpmath.sqrt(mpmath.pi)
    t = mpmath.mpf(2)
    with mpmath.workdps(20):

        def rate(time):
            return mpmath.diff(lambda x: reference.bagley_torvik(x, force=1.0, digits=20).velocity, time, h=mpmath.mpf(10) ** -7 * time)

        nodes, weights = np.polynomial.legendre.leggauss(16)
        memory = 0
        for x, w in zip(nodes, weights, strict=True):
            s = (mpmath.mpf(x) + 1) / 2  # √(t/2) = 1
            memory += w * (rate(t - s * s) + s * rate(s * s) / mpmath.sqrt(t - s * s))
        y = reference.bagley_torvik(t, force=1.0, digits=20).position
        assert abs(rate(t) - (1 - y - c * memory)) < 1e-9


DROPS = [(1.0, 0.6), (0.0, 0.6), (1.0, 0.0), (0.0, 0.0), (EQUAL, 1.0), (1.0, 30.0), (1e4, 1.0), (0.01, 1e-5)]


@pytest.mark.parametrize(("rate", "c"), DROPS)
def test_bouncing(rate, c):
    g, e = 2.0, 0.8
    b = reference.bouncing(rate, c, g, 1.5, e, 8)
    assert len(b.times) == len(b.jumps) == 8 and b.times.dtype == np.float64
    edges = np.array([0.0, *b.times, b.end])
    assert np.all(np.diff(edges) > 0) and np.all(b.jumps > 0)
    assert np.abs(b.height(edges[1:])).max() < 1e-13 * 1.5
    before = b.velocity(b.times) - b.jumps  # velocity(t_j) is the one after impact
    np.testing.assert_allclose(b.jumps, -(1 + e) * before, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(b.velocity(b.times), -e * before, rtol=1e-9, atol=1e-14)
    t = np.sort(np.concatenate([left + (right - left) * np.linspace(0, 1, 200, endpoint=False) for left, right in itertools.pairwise(edges)]))
    height = b.height(t)
    assert height.min() > -1e-13
    assert np.all(g * height + b.velocity(t) ** 2 / 2 <= g * 1.5 * (1 + 1e-13))
    assert np.all(b.velocity(b.times) ** 2 < before**2)


def test_bouncing_without_history_and_drag_is_a_row_of_parabolas():
    b = reference.bouncing(0.0, 0.0, 9.81, 2.0, 0.5, 20)
    first = math.sqrt(2 * 2.0 / 9.81)
    flights = np.diff([0.0, *b.times, b.end])
    np.testing.assert_allclose(flights[0], first, rtol=1e-15)
    np.testing.assert_allclose(flights[1:], 2 * first * 0.5 ** np.arange(1, 21), atol=1e-14)
    small = reference.bouncing(1e-12, 1e-12, 9.81, 2.0, 0.5, 20)
    np.testing.assert_allclose(small.times, b.times, atol=1e-11)


def test_bouncing_ends_at_rest():
    b = reference.bouncing(1.0, 0.6, restitution=0.5, impacts=200)
    assert 20 < len(b.times) < 100 and b.end == b.times[-1]
    assert np.all(np.diff(b.times) >= 0)
    one = reference.bouncing(1.0, 0.6, restitution=0.0)
    assert len(one.times) == 1 and one.velocity(one.end) == pytest.approx(0.0, abs=1e-15)
    none = reference.bouncing(1.0, 0.6, impacts=0)
    assert len(none.times) == 0 and none.height(none.end) == pytest.approx(0.0, abs=1e-15)
    with pytest.raises(ValueError, match=r"restitution must be from 0 to 1, got 1\.5"):
        reference.bouncing(1.0, 0.6, restitution=1.5)


@pytest.mark.parametrize(("rate", "c"), [(1.0, 0.6), (EQUAL, 1.0), (1.0, 0.0)])
def test_bouncing_with_digits(rate, c):
    plain = reference.bouncing(rate, c, impacts=4)
    exact = reference.bouncing(rate, c, impacts=4, digits=25)
    with mpmath.workdps(40):
        assert max(abs(x - y) for x, y in zip([*plain.times, plain.end], [*exact.times, exact.end], strict=True)) < 2e-14
        assert max(abs(x - y) for x, y in zip(plain.jumps, exact.jumps, strict=True)) < 2e-14
        assert abs(exact.height(exact.end)) < 1e-25
        middle = (exact.times[0] + exact.times[1]) / 2
        assert abs(exact.height(middle) - plain.height(float(middle))) < 1e-14
        assert abs(exact.velocity(middle) - plain.velocity(float(middle))) < 1e-14
