"""Kernels by a formula: against closed forms and mpmath in rules, streams and solvers; fitted sums keep what they promise, and what has none is refused."""

import math
import pickle

import mpmath
import numpy as np
import pytest
from scipy.special import wofz

import basset
from basset import BubbleKernel, FormulaKernel, SlipSphereKernel
from basset.formula import slope
from basset.positive_sums import NoSumError, positive_sum

BUBBLE = BubbleKernel(diameter=1e-3, viscosity=1e-6)
SLIP = SlipSphereKernel(slip_length=5e-5, diameter=1e-3, viscosity=1e-6)
SHIPPED = {"bubble": BUBBLE, "slip sphere": SLIP}
MEI = basset.MeiAdrianKernel(0.01, 1e-3, 1e-6)


def mei_adrian(x):
    return (1.0 + x**0.75) ** -2.0 / np.sqrt(x)


def mei_adrian_slope(x):
    return -mei_adrian(x) * (0.5 + 1.5 * x**0.75 / (1.0 + x**0.75)) / x


def tempered(s):
    return np.exp(-s) / np.sqrt(s)


def wavy(amplitude):
    """s^(−1/2) + amplitude·sin(3 ln s')/√s', s' = s + 1e-6: completely monotone up to an amplitude of |Γ(1/2 + 3i)|/Γ(1/2) = 0.0127.

    The spectrum of the wave is λ^(−1/2) e^(−1e-6 λ) Im(λ^(−3i)/Γ(1/2 − 3i)), that of s^(−1/2) is λ^(−1/2)/Γ(1/2).
    """
    return FormulaKernel(lambda s: 1.0 / np.sqrt(s) + amplitude * np.sin(3.0 * np.log(s + 1e-6)) / np.sqrt(s + 1e-6))


LIKE_MEI = FormulaKernel(mei_adrian, time_scale=MEI.bend)


@pytest.fixture(autouse=True)
def digits():
    with mpmath.workdps(30):
        yield


# the formulas


def exact(kernel, s):
    """exp(s/τ) erfc(√(s/τ)) with many digits, as published: 8πμa for the bubble, in units of 6 a² √(πμρ)."""
    a, nu = mpmath.mpf(kernel.diameter) / 2, mpmath.mpf(kernel.viscosity)
    if isinstance(kernel, BubbleKernel):
        root, factor = 3 * mpmath.sqrt(nu) / a, mpmath.mpf(8)
    else:
        share = kernel.slip_length / a
        root, factor = (1 + 3 * share) / share * mpmath.sqrt(nu) / a, 6 * (1 + 2 * share) ** 2 / (share * (1 + 3 * share))
    return factor / 6 * mpmath.sqrt(mpmath.pi * nu) / a * mpmath.exp(root**2 * s) * mpmath.erfc(root * mpmath.sqrt(s))


@pytest.mark.parametrize("share", [0.0, 0.03, 0.4, 1e6])
@pytest.mark.parametrize("x", [0.1, 1.0, 7.0])
def test_the_force_of_a_sphere_with_slip_solves_the_unsteady_stokes_equations(share, x):
    """Drag over 6πμa per velocity e^(pt), x = a√(p/ν): quasi-steady + history + x²/9, against the flow outside a sphere of radius 1."""
    radial = (lambda r: 2 / r**3, lambda r: 2 * (1 + x * r) * mpmath.exp(-x * r) / r**3)  # of cos θ
    angular = (lambda r: 1 / r**3, lambda r: (1 + x * r + x**2 * r**2) * mpmath.exp(-x * r) / r**3)  # of sin θ
    shear = [mpmath.diff(lambda r, f=f: f(r) / r, 1) - g(1) for f, g in zip(angular, radial, strict=True)]
    rows = [[f(1) for f in radial], [f(1) - share * t for f, t in zip(angular, shear, strict=True)]]
    amounts = mpmath.lu_solve(mpmath.matrix(rows), mpmath.matrix([1, -1]))
    normal = [-(x**2) * (1, 0)[i] + 2 * mpmath.diff(radial[i], 1) for i in range(2)]  # −p + 2 du_r/dr; p = ρ∂φ/∂t of the potential part
    force = sum(amount * (mpmath.mpf(2) / 3 * n - mpmath.mpf(4) / 3 * t) for amount, n, t in zip(amounts, normal, shear, strict=True)) / 3
    alpha = ((1 + 2 * share) / (1 + 3 * share)) ** 2
    root_time = share / (1 + 3 * share)  # √τ in units of a/√ν
    history = alpha * x / (1 + root_time * x)  # p times the transform of α √(π/τ) exp erfc, times a/√(πν)
    assert abs(-force / ((1 + 2 * share) / (1 + 3 * share) + history + x**2 / 9) - 1) < 1e-12


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
@pytest.mark.parametrize("s", [1e-12, 1e-4, 0.03, 1.0, 100.0])
def test_values_and_slopes_have_all_digits(kernel, s):
    assert abs(kernel(s) / exact(kernel, mpmath.mpf(s)) - 1) < 2e-15
    slopes = mpmath.diff(lambda t: exact(kernel, t), mpmath.mpf(s))
    assert abs(kernel._derivatives(np.array([s]))[0] / slopes - 1) < 1e-13


def test_the_slope_is_one_function_where_its_forms_meet():
    x = 8.0 * (1.0 + np.array([-1e-12, 1e-12]))
    assert abs(np.diff(slope(x))[0] / slope(x)[0]) < 1e-11


def test_limits():
    s = np.array([1e-3, 1.0, 100.0])
    np.testing.assert_allclose(SlipSphereKernel(1e-15, 1e-3, 1e-6)(s), basset.BassetKernel()(s), rtol=1e-8)  # without slip
    np.testing.assert_allclose(SlipSphereKernel(1e6, 1e-3, 1e-6)(s), BUBBLE(s), rtol=1e-8)  # slips as a bubble
    assert abs(BUBBLE(1e9) * math.sqrt(1e9) - 4.0 / 9.0) < 1e-9 and BUBBLE(0.0) == BUBBLE(1e-300) < math.inf


def test_time_scales_with_the_viscosity():
    for kernel in SHIPPED.values():
        assert abs(kernel(0.3) - kernel.scaled(0.1)(3.0) / math.sqrt(0.1)) < 1e-13
        assert pickle.loads(pickle.dumps(kernel)) == kernel


# moments


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
@pytest.mark.parametrize(("near", "far"), [(0.0, 1e-3), (0.0, 0.1), (0.0, 50.0), (0.2, 0.3)])
def test_moments_have_all_digits(kernel, near, far):
    found = kernel.moments(near, far, 15)
    places = [near + (far - near) * share for share in (0.0, 1e-8, 1e-5, 1e-3, 0.1, 1.0)]
    for m in (0, 1, 7, 15):
        expected = mpmath.quad(lambda s, m=m: exact(kernel, s) * ((s - near) / (mpmath.mpf(far) - near)) ** m, places)
        assert abs(found[m] / expected - 1) < 4e-14


@pytest.mark.parametrize("far", [1e-3, 1.0, 1e4])
def test_the_singular_part_is_exact(far):
    found = FormulaKernel(lambda s: 1.0 / np.sqrt(s)).moments(0.0, far, 15)
    np.testing.assert_allclose(found, math.sqrt(far) / (np.arange(16) + 0.5), rtol=1e-14)


def test_panels_are_halved_where_the_kernel_is_not_smooth():
    fast = FormulaKernel(lambda s: np.cos(200.0 * s) / np.sqrt(s))
    expected = math.sqrt(math.pi / 400.0) * 2.0 * mpmath.fresnelc(20.0 / mpmath.sqrt(mpmath.pi))
    assert abs(fast.moments(0.0, 1.0, 0)[0] - expected) < 1e-13


# every rule, against the same kernel with formulas of its own

RULES = {
    "euler_maclaurin": basset.EulerMaclaurin(), "brush": basset.Brush(), "newton_cotes": basset.NewtonCotes(), "daitche": basset.Daitche(3),
    "daitche 8": basset.Daitche(8), "hinsberg": basset.Hinsberg(),
    "windowed": basset.Windowed(basset.Daitche(2), 3.0), "hinsberg windowed": basset.Hinsberg(3.0, tail=False),
}  # fmt: skip


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("input", ["rate", "slip"])
def test_every_rule_takes_it(rule, input):
    if input not in rule.inputs:
        with pytest.raises(ValueError, match="input must be 'rate'"):
            rule.weights(9, 0.05, LIKE_MEI, input)
        return
    for n in (1, 2, 5, 600):
        expected = rule.weights(n, 0.05, MEI, input)
        np.testing.assert_allclose(rule.weights(n, 0.05, LIKE_MEI, input), expected, rtol=1e-12, atol=2e-13 * np.abs(expected).max())


def test_a_given_derivative_is_used():
    given = FormulaKernel(mei_adrian, derivative=mei_adrian_slope, time_scale=MEI.bend)
    expected = basset.Daitche(3).weights(2000, 0.05, MEI, "slip")
    np.testing.assert_allclose(basset.Daitche(3).weights(2000, 0.05, given, "slip"), expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
def test_the_integral_of_a_constant_and_of_a_wave(kernel):
    """∫K = α√(πτ)(e^T erfc√T − 1 + 2√(T/π)), T = t/τ; the wave by mpmath; at once and at every node, and of slips."""
    dt, n = 0.01, 400
    t, times = dt * n, dt * np.arange(n + 1)
    tau = kernel.time
    scaled = t / mpmath.mpf(tau)
    constant = (
        kernel.strength * mpmath.sqrt(mpmath.pi * tau) * (mpmath.exp(scaled) * mpmath.erfc(mpmath.sqrt(scaled)) - 1 + 2 * mpmath.sqrt(scaled / mpmath.pi))
    )
    wave = mpmath.quad(lambda root: 2 * root * exact(kernel, root**2) * mpmath.cos(t - root**2), mpmath.linspace(0, mpmath.sqrt(t), 9))
    for samples, expected in ((np.ones(n + 1), constant), (np.cos(times), wave)):
        for rule in (basset.Daitche(8), "daitche"):
            tolerance = 1e-10 if rule != "daitche" else 1e-7
            assert abs(basset.integrate(samples, dt, rule, kernel=kernel) / expected - 1) < tolerance
            assert abs(basset.cumulate(samples, dt, rule, kernel=kernel)[-1] / expected - 1) < tolerance
    assert abs(basset.integrate(np.sin(times), dt, basset.Daitche(8), kernel=kernel, input="slip") / wave - 1) < 1e-10


@pytest.mark.parametrize("kernel", [*SHIPPED.values(), LIKE_MEI], ids=[*SHIPPED, "formula"])
def test_streams_of_constant_memory(kernel):
    dt, n = 0.01, 600
    rates = np.cos(dt * np.arange(n + 1))
    expected = basset.cumulate(rates, dt, basset.Daitche(8), kernel=kernel, initial_slip=2.0)[1:]
    tail = basset.ExponentialSum.fit(0.2, 2.0 * dt * n, 1e-12, kernel)
    for rule in (basset.Exponential(8, 1e-12), basset.Windowed(basset.Daitche(8), 0.4, tail)):
        plan = rule.plan(dt, dt * n, kernel)
        state = plan.start()
        plan.push(state, rates[0])
        plan.jump(state, 2.0)
        assert np.abs(plan.run(state, rates[1:]) - expected).max() < 1e-11 * np.abs(expected).max()
    assert len(plan.rates) == len(tail) < 60


@pytest.mark.parametrize("kernel", [*SHIPPED.values(), LIKE_MEI], ids=[*SHIPPED, "formula"])
def test_streams_and_jumps(kernel):
    dt, n = 0.05, 60
    rates = np.cos(dt * np.arange(n + 1))
    plan = basset.Daitche(4).plan(dt, dt * n, kernel)
    state = plan.start()
    for rate in rates:
        plan.push(state, rate)
    assert abs(plan.value(state) - basset.integrate(rates, dt, basset.Daitche(4), kernel=kernel)) < 1e-13
    state = plan.start()
    values = plan.run(state, rates[:20])
    plan.jump(state, 2.0)  # at node 19
    after = plan.run(state, rates[20:])
    plain = basset.cumulate(rates, dt, basset.Daitche(4), kernel=kernel)
    np.testing.assert_allclose(values, plain[:20], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(after, plain[20:] + 2.0 * kernel(dt * np.arange(1.0, n - 18.0)), rtol=1e-12)
    slip = basset.cumulate(rates, dt, basset.Daitche(4), kernel=kernel, initial_slip=3.0)
    np.testing.assert_allclose(slip[1:], plain[1:] + 3.0 * kernel(dt * np.arange(1.0, n + 1.0)), rtol=1e-12)


@pytest.mark.parametrize("rule", [basset.Daitche(3), basset.Windowed(basset.Daitche(2), 0.5), basset.Exponential(3, 1e-12)], ids=["whole", "window", "sum"])
def test_jumps_between_nodes_that_end_a_segment(rule):
    """Against the same kernel with formulas and tables of its own."""
    streams = []
    for kernel in (MEI, LIKE_MEI):
        plan = rule.plan(0.05, 4.0, kernel)
        state = plan.start(2)
        plan.run(state, np.cos(0.05 * np.arange(46.0)).reshape(23, 2))
        plan.jump(state, [1.0, -2.0], age=0.02, g=[0.3, 0.1])
        streams.append(plan.run(state, np.ones((50, 2))))
    np.testing.assert_allclose(streams[1], streams[0], rtol=0.0, atol=3e-11)


# solve


def relaxing(kernel, t, rate, coefficient):
    """y' = −rate·y − c·H with y(0) = 1, jump included. Transform (√p + b)/(p√p + bp + (rate + cA)√p + rate·b), b = τ^(−1/2), A = α√(π/τ)."""
    b, strength = kernel.time**-0.5, kernel.strength * math.sqrt(math.pi / kernel.time)
    polynomial = np.array([1.0, b, rate + coefficient * strength, rate * b])
    roots = np.roots(polynomial)
    roots = roots - np.polyval(polynomial, roots) / np.polyval(np.polyder(polynomial), roots)
    shares = (roots + b) / np.polyval(np.polyder(polynomial), roots)
    z = -np.multiply.outer(np.sqrt(np.asarray(t)), roots)
    return ((shares * roots) * wofz(1j * z)).sum(axis=-1).real


def test_the_closed_form_is_the_transform_s():
    for kernel in SHIPPED.values():
        p, t = 1.3, np.linspace(0.0, 6.0, 400001) ** 2
        b, strength = kernel.time**-0.5, kernel.strength * math.sqrt(math.pi / kernel.time)
        values = relaxing(kernel, t, 1.0, 0.6) * np.exp(-p * t)
        q = math.sqrt(p)
        expected = (q + b) / (p * q + b * p + (1.0 + 0.6 * strength) * q + b)
        assert abs(np.trapezoid(values, t) / expected - 1.0) < 1e-8


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
def test_fixed_steps_converge_to_the_closed_form(kernel):
    errors = []
    for share in (0.2, 0.05):  # of τ
        method = basset.FixedStep(share * kernel.time, basset.Daitche(2))
        r = basset.solve(lambda t, y: -y, (0.0, 40.0 * kernel.time), [1.0], coefficient=0.6, kernel=kernel, method=method)
        errors.append(np.abs(r.y[0] / relaxing(kernel, r.t, 1.0, 0.6) - 1.0).max())
    assert errors[1] < errors[0] / 4.0**1.35 and errors[1] < 2e-3  # 3/2: the jump counts at its own node too


def test_fixed_steps_that_do_not_see_a_bounded_start_take_it_for_a_singular_one():
    """A slip of a nanometre is none: the jump must not count with K(0) at its node."""
    hardly = SlipSphereKernel(1e-9, 1e-3, 1e-6)
    ends = [
        basset.solve(lambda t, y: -y, (0.0, 2.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.FixedStep(0.01, basset.Daitche(2))).y[0, -1]
        for kernel in (hardly, basset.BassetKernel())
    ]
    assert hardly(0.0) > 1e5 and abs(ends[0] / ends[1] - 1.0) < 1e-4


def test_fixed_steps_count_a_jump_at_its_node():
    """y' = −H with K = e^(−s), H = y_0 e^(−t) + …: y'' + 2y' = 0 after y'(0) = −y_0, so y = y_0 (1 + e^(−2t))/2, and a jump adds as much."""

    def half(t, y):
        return t - 1.0

    half.jump = lambda t, y: y + 1.0
    kernel = FormulaKernel(lambda s: np.exp(-s), near="bounded")
    errors = []
    for steps in (100, 200):
        method = basset.FixedStep(2.0 / steps, basset.Daitche(3))
        r = basset.solve(lambda t, y: 0.0 * y, (0.0, 2.0), [1.0], coefficient=1.0, kernel=kernel, method=method, events=half)
        errors.append(abs(r.y[0, -1] - 0.5 * (1.0 + math.exp(-4.0)) - 0.5 * (1.0 + math.exp(-2.0))))
    assert errors[0] < 1e-6 and errors[1] < errors[0] / 8.0


def test_history_begins_with_the_slip_times_a_bounded_kernel():
    found = basset.cumulate(np.zeros(4), 0.1, basset.Daitche(1), kernel=BUBBLE, initial_slip=-2.0)
    np.testing.assert_allclose(found, -2.0 * BUBBLE(0.1 * np.arange(4)), rtol=1e-14)
    slips = basset.cumulate(np.full((4, 2), [3.0, 0.0]), 0.1, basset.Daitche(1), kernel=BUBBLE, input="slip")
    np.testing.assert_allclose(slips, np.outer(BUBBLE(0.1 * np.arange(4)), [3.0, 0.0]), rtol=1e-13)


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
def test_collocation_follows_the_closed_form_to_ten_digits(kernel):
    r = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.Collocation(rtol=1e-11))
    assert r.status == 0 and np.abs(r.y[0] - relaxing(kernel, r.t, 1.0, 0.6)).max() < 2e-11


@pytest.mark.parametrize("kernel", SHIPPED.values(), ids=SHIPPED)
def test_collocation_takes_jumps(kernel):
    """Thrown up by 1.5 at every fall to 1/2: y = R(t) + Σ 1.5 R(t − t_j), R the response."""

    def low(t, y):
        return y[0] - 0.5

    low.direction, low.jump = -1.0, lambda t, y: y + 1.5
    r = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.Collocation(rtol=1e-10), events=low)
    jumps = r.t_events[0]
    after = np.maximum(4.0 - jumps, 0.0)
    assert len(jumps) >= 2
    assert abs(r.y[0, -1] - relaxing(kernel, 4.0, 1.0, 0.6) - 1.5 * relaxing(kernel, after, 1.0, 0.6).sum()) < 1e-9


def test_collocation_with_a_formula_is_that_of_the_kernel():
    ends = [basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, kernel=k, method=basset.Collocation(rtol=1e-9)).y[0, -1] for k in (MEI, LIKE_MEI)]
    assert abs(ends[0] - ends[1]) < 1e-10


def test_what_needs_a_sum_is_refused_without_one():
    gauss = NOT_MONOTONE["Gauss"][0]
    with pytest.raises(ValueError, match=r"kernel must be completely monotone for a sum of exponentials.*FixedStep with these need no sum"):
        basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, kernel=gauss, method=basset.Collocation(rtol=1e-3))
    with pytest.raises(ValueError, match="kernel must be completely monotone"):
        basset.Exponential(3, 1e-6).plan(0.1, 4.0, gauss)
    r = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, kernel=gauss, method=basset.FixedStep(0.05, basset.Daitche(2)))
    assert r.status == 0 and 0.0 < r.y[0, -1] < math.exp(-2.0)


# sums of exponentials

COMPLETELY_MONOTONE = {
    "bubble": (BUBBLE, 1e-6, 10.0), "slip sphere": (SLIP, 1e-6, 10.0), "formula": (LIKE_MEI, 1e-5, 100.0),
    "inverse root": (FormulaKernel(lambda s: 1.0 / np.sqrt(s)), 1e-6, 1.0),
    "fades": (FormulaKernel(tempered), 1e-4, 50.0), "is forgotten": (FormulaKernel(tempered), 1e-3, 1000.0),
    "one exponential": (FormulaKernel(lambda s: np.exp(-s), near="bounded"), 1e-3, 20.0),
    "two": (FormulaKernel(lambda s: np.exp(-s) + 0.1 * np.exp(-30.0 * s), near="bounded"), 1e-3, 8.0), "log-periodic": (wavy(0.012), 1e-4, 1.0),
    "algebraic": (FormulaKernel(lambda s: 1.0 / (1.0 + s), near="bounded"), 1e-3, 1e3),
}  # fmt: skip


@pytest.mark.parametrize(("kernel", "near", "far"), COMPLETELY_MONOTONE.values(), ids=COMPLETELY_MONOTONE)
@pytest.mark.parametrize("rtol", [1e-3, 1e-9])
def test_a_fitted_sum_keeps_its_promise(kernel, near, far, rtol):
    weights, rates = positive_sum(kernel, near, far, rtol)
    made = basset.ExponentialSum(weights, rates, near, far, kernel, rtol)  # refuses what is not positive
    lags = np.geomspace(near, far, 30_000)[1:-1]
    lags = np.concatenate([[near], lags, [far]])
    values = kernel(lags)
    assert (np.abs(made(lags) - values) <= rtol * np.maximum(values, 1e-16 * values[0])).all()
    assert made.max_relative_error() <= rtol
    assert made(0.0) < 40.0 * kernel(near)  # nothing is hidden before near
    assert len(made) <= 2.5 * math.log(2.7 / rtol) * math.log(4.0 * far / near) / math.pi**2 + 4  # 2.5 times what s^(−1/2) needs at least


def test_a_sum_to_eleven_digits_over_ten_decades():
    weights, rates = positive_sum(BUBBLE, 4e-10, 4.0, 1e-11)
    made = basset.ExponentialSum(weights, rates, 4e-10, 4.0, BUBBLE, 1e-11)
    assert made.max_relative_error() <= 1e-11 and len(made) < 90


NOT_MONOTONE = {
    "Gauss": (FormulaKernel(lambda s: np.exp(-(s**2)), near="bounded"), "no sum of positive exponentials comes nearer to it than 0.[1-9]"),
    "Lorentz": (FormulaKernel(lambda s: 1.0 / (1.0 + s**2), near="bounded"), "no sum of positive exponentials comes nearer to it than 0.0"),
    "log-periodic": (wavy(0.02), "no sum of positive exponentials comes nearer to it than [0-9.]+e-0[56] of its value"),
    "rises": (FormulaKernel(lambda s: (1.0 + 0.5 * np.cos(20.0 * s)) / np.sqrt(s)), "it rises before s = 0.1"),
    "negative": (FormulaKernel(lambda s: np.cos(s) / np.sqrt(s)), r"K\(1.5[78]\d*\) = -"),
}


@pytest.mark.parametrize(("kernel", "sentence"), NOT_MONOTONE.values(), ids=NOT_MONOTONE)
def test_what_is_not_completely_monotone_is_refused_and_still_has_whole_past_rules(kernel, sentence):
    with pytest.raises(
        NoSumError, match=f"kernel must be completely monotone for a sum of exponentials, but FormulaKernel.*{sentence}.*rules over the whole past"
    ):
        positive_sum(kernel, 1e-3, 3.0, 1e-6)
    n = 300
    times = 0.01 * np.arange(n + 1)
    expected = mpmath.quad(
        lambda root: 2 * root * float(kernel(float(root) ** 2)) * math.cos(times[-1] - float(root) ** 2), mpmath.linspace(0, math.sqrt(times[-1]), 25)
    )
    assert abs(basset.integrate(np.cos(times), 0.01, basset.Daitche(6), kernel=kernel) - expected) < 1e-9


def test_the_proof_is_one():
    """A bound on what positive sums can do must lie below what one of them does: log-periodic on both sides of the border."""
    inside = wavy(0.012)
    assert positive_sum(inside, 1e-3, 1.0, 1e-8)[0].min() > 0.0
    with pytest.raises(NoSumError) as refused:
        positive_sum(wavy(0.02), 1e-3, 1.0, 1e-8)
    bound = float(str(refused.value).split("nearer to it than ")[1].split()[0])
    weights, rates = positive_sum(wavy(0.02), 1e-3, 1.0, 1e-3)
    lags = np.geomspace(1e-3, 1.0, 5000)
    assert bound < np.abs(np.exp(-np.outer(lags, rates)) @ weights / wavy(0.02)(lags) - 1.0).max()


def test_noise_below_the_promise_is_no_wave():
    noisy = FormulaKernel(lambda s: (1.0 + 1e-9 * np.sin(1e3 * s)) * np.exp(-s), near="bounded")
    weights, rates = positive_sum(noisy, 1e-6, 1.0, 1e-8)
    lags = np.linspace(1e-6, 1.0, 5001)
    assert np.abs(np.exp(-np.outer(lags, rates)) @ weights / noisy(lags) - 1.0).max() <= 1e-8
    with pytest.raises(NoSumError, match=r"rtol must be at least 1\.\d*e-09"):
        positive_sum(noisy, 1e-6, 1.0, 1e-11)


def test_too_much_accuracy_is_refused_with_what_can_be_had():
    with pytest.raises(NoSumError, match=r"rtol must be at least .*e-1[456] for near = 0.1 and far = 1 seconds with BubbleKernel"):
        positive_sum(BUBBLE, 0.1, 1.0, 1e-17)
    with pytest.raises(NoSumError, match="far/near must be at most 1e12"):
        positive_sum(BUBBLE, 1e-13, 1.0, 1e-3)


# what is no kernel

WRONG = {
    "number": ((3.0,), TypeError, "function must be callable as function"),
    "text": ((lambda s: "a",), TypeError, "function must return real numbers, got 'a'"),
    "shape": ((lambda s: 1.0,), TypeError, "function must return an array of the shape of its argument"),
    "near": ((tempered, "bunded"), ValueError, "did you mean 'bounded'"),
    "bounded after all": (
        (lambda s: np.exp(-s),),
        ValueError,
        r"function must begin as near='inverse_sqrt' says, with a finite limit of √s·K as s → 0 that is not 0",
    ),
    "singular after all": ((tempered, "bounded"), ValueError, r"function must begin as near='bounded' says"),
    "another power": ((lambda s: s**-0.3,), ValueError, "near='inverse_sqrt'"),
    "complex": ((lambda s: (1.0 + 1.0j) / np.sqrt(s),), TypeError, "function must return real numbers"),
    "derivative": ((tempered, "inverse_sqrt", 2), TypeError, "derivative must be callable"),
    "time scale": ((tempered, "inverse_sqrt", None, 0.0), ValueError, "time_scale must be a finite number greater than 0"),
}


@pytest.mark.parametrize(("given", "error", "sentence"), WRONG.values(), ids=WRONG)
def test_wrong_functions_are_refused(given, error, sentence):
    with pytest.raises(error, match=sentence):
        FormulaKernel(*given)


def test_functions_that_fail_later_say_where():
    broken = FormulaKernel(lambda s: np.exp(s) * np.where(s < 900.0, np.exp(-s), 0.0) / np.sqrt(s))
    with pytest.raises(ValueError, match=r"function must be finite for all lags greater than 0, got nan at \d"):
        basset.Daitche(3).weights(1000, 1.0, broken)
    with pytest.raises(ValueError, match=r"derivative must be given with FormulaKernel.*the function changes too fast"):
        basset.Daitche(3).weights(200, 1.0, FormulaKernel(lambda s: np.cos(20.0 * s) / np.sqrt(s)), "slip")


def test_functions_may_return_lists_and_work_in_place():
    def root(s):
        return np.divide(1.0, np.sqrt(s, out=s), out=s)

    for function in (root, lambda s: (1.0 / np.sqrt(s)).tolist()):
        for input in ("rate", "slip"):
            found, expected = (basset.Daitche(3).weights(50, 0.1, kernel, input) for kernel in (FormulaKernel(function), basset.BassetKernel()))
            assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_wrong_spheres_are_refused():
    with pytest.raises(ValueError, match="slip_length must be a finite number greater than 0"):
        SlipSphereKernel(0.0, 1e-3, 1e-6)
    for kernel, given in (
        (SlipSphereKernel, (1e-160, 1e-3, 1e-6)),
        (BubbleKernel, (1e-300, 1e-6)),
        (BubbleKernel, (1e300, 1e-6)),
        (BubbleKernel, (1.0, 1e300)),
    ):
        with pytest.raises(ValueError, match=r"diameter, viscosity must give a time τ between 1e-200 s and 1e\+200 s .*, got τ = "):
            kernel(*given)
    with pytest.raises(ValueError, match="viscosity must be"):
        BubbleKernel(1e-3, -1e-6)
    with pytest.raises(ValueError, match="kernel must be BassetKernel"):
        basset.SemiDerivative().weights(4, 0.1, BUBBLE)


def test_kernels_with_one_function_are_equal_and_travel():
    one, other = FormulaKernel(tempered), FormulaKernel(tempered)
    assert one == other and hash(one) == hash(other) and pickle.loads(pickle.dumps(one)) == one
    assert one != FormulaKernel(tempered, time_scale=2.0) and repr(one) == "FormulaKernel(tempered, near='inverse_sqrt')"
    assert one(0.0) == math.inf and FormulaKernel(lambda s: np.exp(-s), near="bounded")(0.0) == 1.0
