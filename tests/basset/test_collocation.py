"""Graded collocation: the tolerance is kept on every path, through every jump, at a cost that does not depend on slips or on the past."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import ClassVar

import numpy as np
import pytest
from solver_cases import CASES, RTOLS, drop, relaxing, settling, stream, vortex

import basset
from basset import reference
from basset.solvers import _graded

pytestmark = pytest.mark.analytic

# (case, rtol) whose error is more than ten times the tolerance. Keep it empty.
DISHONEST: list[tuple[str, float]] = []

FACTOR = 10.0  # between the tolerance of a step and the error of the path

SPHERES = [(1.0, 0.6), (0.1, 0.1), (0.0, 0.5), (1.0, 2.0 / np.sqrt(np.pi))]  # (drag rate, history coefficient)


class TestTolerance:
    @pytest.mark.parametrize("rtol", RTOLS)
    @pytest.mark.parametrize("name", CASES)
    def test_kept_on_every_path(self, name, rtol):
        error = CASES[name].error(basset.Collocation(rtol=rtol))
        assert (error > FACTOR * rtol) == ((name, rtol) in DISHONEST), f"{error / rtol:.3g} times the tolerance"

    def test_no_estimate_is_dishonest(self):
        assert DISHONEST == []

    @pytest.mark.parametrize("name", CASES)
    def test_a_smaller_tolerance_buys_digits(self, name):
        assert CASES[name].error(basset.Collocation(rtol=1e-10)) < 1e-3 * max(1e-5, CASES[name].error(basset.Collocation(rtol=1e-4)))

    @pytest.mark.parametrize("rtol", [1e-4, 1e-8])
    @pytest.mark.parametrize("seed", range(8))
    def test_drawn_coefficients(self, seed, rtol):
        """λ and c over six decades, slip and drive of either sign."""
        rng = np.random.default_rng(seed)
        rate, c = 10.0 ** rng.uniform(-3.0, 3.0), 10.0 ** rng.uniform(-2.0, 2.0)
        case = stream(rate, c, rng.uniform(0.5, 20.0), rng.uniform(-3.0, 3.0), rng.uniform(0.2, 5.0))
        assert case.error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol

    @pytest.mark.parametrize("stages", range(2, 15))
    @pytest.mark.parametrize("case", [relaxing(1.0, 0.6, 4.0), stream(1.0, 2.0, 6.0, -1.0)], ids=["relaxing", "stream"])
    def test_any_number_of_stages(self, case, stages):
        rtol = 1e-2 if stages == 2 else 1e-5
        assert case.error(basset.Collocation(rtol=rtol, stages=stages)) <= FACTOR * rtol

    @pytest.mark.parametrize(("stages", "steps"), [(2, 60), (3, 60), (4, 30)])
    def test_few_stages_take_many_steps_but_not_thousands(self, stages, steps):
        """Orders 3 and up: two digits of a slip that relaxes."""
        assert relaxing(1.0, 0.6, 4.0).solve(basset.Collocation(rtol=1e-2, stages=stages)).nsteps <= steps

    def test_small_components_keep_their_own_digits(self):
        """Errors are relative to each component: a second slip a million times smaller is solved as well as alone."""
        case = relaxing(1.0, 0.6, 4.0)
        both = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0, 1e-6], [0, 1], 0.6, method=basset.Collocation(rtol=1e-8, atol=0.0), dense_output=True)
        t, exact = case.path
        error = np.abs(both.sol(t) - np.outer([1.0, 1e-6], exact[0])).max(axis=1)
        assert error[0] <= 1e-7
        assert error[1] <= 1e-13

    def test_absolute_tolerance_ends_the_care_for_small_values(self):
        """A slip of 1e-6 under atol 1e-3 needs hardly a step; under the default it needs as many as one of size 1."""
        steps = [
            basset.solve(lambda t, y: -30.0 * y, (0.0, 4.0), [1e-6], coefficient=0.6, method=basset.Collocation(rtol=1e-8, atol=atol)).nsteps
            for atol in (1e-3, 1e-17)
        ]
        assert steps[0] <= 8 < 20 < steps[1]


class TestCost:
    def test_a_slip_of_one_to_nine_digits_in_25_steps(self):
        case = relaxing(1.0, 0.6, 4.0)
        method = basset.Collocation(rtol=1e-9)
        assert case.error(method) <= 1e-9
        assert case.solve(method).nsteps <= 25

    @pytest.mark.parametrize("rtol", RTOLS)
    @pytest.mark.parametrize(
        ("slip", "none"),
        [
            (relaxing(1.0, 0.6, 4.0), settling(1.0, 0.6, 4.0)),
            (stream(1.0, 0.6, 20.0, 1.0), stream(1.0, 0.6, 20.0, 0.0)),
            (vortex(2.0, 0.7, 0.5, 6.0, 0.3 - 0.2j), vortex(2.0, 0.7, 0.5, 6.0)),
        ],
        ids=["relaxing against settling", "stream", "vortex"],
    )
    def test_an_initial_slip_costs_at_most_twice_as_much(self, slip, none, rtol):
        method = basset.Collocation(rtol=rtol)
        with_slip, without = slip.solve(method), none.solve(method)
        assert with_slip.nsteps <= 2 * without.nsteps
        assert with_slip.nfev <= 2 * without.nfev

    def test_steps_grow_with_the_logarithm_of_the_time(self):
        """A relaxing slip forgets its start: a hundred times the time costs at most ten octaves of steps more."""
        steps = [relaxing(1.0, 0.6, end).solve(basset.Collocation(rtol=1e-8)).nsteps for end in (10.0, 1000.0)]
        assert steps[1] <= steps[0] + 40

    def test_evaluations_are_counted(self):
        calls = 0

        def fun(t, y):
            nonlocal calls
            calls += 1
            return -y

        result = basset.solve(fun, (0.0, 4.0), [1.0], coefficient=0.6)
        assert result.nfev == calls
        assert result.nsteps == len(result.t) - 1

    def test_max_step(self):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=basset.Collocation(rtol=1e-6, max_step=0.03))
        assert np.diff(result.t).max() <= 0.03 * (1.0 + 1e-9)
        assert result.nsteps >= 4.0 / 0.03

    def test_memory_does_not_grow_with_the_impacts(self, monkeypatch):
        """The past is one sum of exponentials, of as many terms for seventy jumps as for three."""
        fit = _graded.fitted
        terms = []

        def watched(*args, **kwargs):
            terms.append(len(fit(*args, **kwargs)))
            return fit(*args, **kwargs)

        monkeypatch.setattr(_graded, "fitted", watched)
        results = [drop(1.0, 0.6, e, 8.0, basset.Collocation(rtol=1e-6)) for e in (0.02, 0.8)]
        impacts = [len(result.t_events[0]) for result in results]
        assert impacts[0] <= 10 < 60 <= impacts[1]
        assert len(terms) == 2
        assert terms[0] == terms[1] <= 60  # n ≈ ln(2.7/E) ln(4R)/π² at R = 1e12, E = 1e-7: 50


@cache
def exact(rate: float, c: float, restitution: float, impacts: int) -> reference.Bounces:
    return reference.bouncing(rate, c, 1.0, 1.0, restitution, impacts)


class TestBouncing:
    @pytest.mark.parametrize(("rate", "c"), SPHERES)
    def test_ten_impact_times(self, rate, c):
        bounces = exact(rate, c, 0.8, 10)
        result = drop(rate, c, 0.8, 0.5 * (bounces.times[-1] + bounces.end), basset.Collocation(rtol=1e-9))
        assert result.status == 0
        assert len(result.t_events[0]) == 10
        assert np.abs(result.t_events[0] - bounces.times).max() <= 1e-8

    @pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
    def test_impacts_follow_the_tolerance(self, rtol):
        """An impact time is off by the errors of the height over the velocity there, 0.09 at the tenth and 0.9 at the first."""
        bounces = exact(1.0, 0.6, 0.8, 10)
        result = drop(1.0, 0.6, 0.8, 0.5 * (bounces.times[-1] + bounces.end), basset.Collocation(rtol=rtol))
        assert np.abs(result.t_events[0] - bounces.times).max() <= 10.0 * FACTOR * rtol

    @pytest.mark.parametrize(("rate", "c"), SPHERES)
    def test_the_whole_path(self, rate, c):
        bounces = exact(rate, c, 0.8, 10)
        end = 0.5 * (bounces.times[-1] + bounces.end)
        result = drop(rate, c, 0.8, end, basset.Collocation(rtol=1e-9), dense_output=True)
        t = np.linspace(0.0, end, 1001)
        t = t[np.abs(t[:, None] - bounces.times).min(axis=1) > 1e-7]  # the velocity jumps: not within the error of the time
        velocity, height = result.sol(t)
        assert np.abs(velocity - bounces.velocity(t)).max() <= 1e-7
        assert np.abs(height - bounces.height(t)).max() <= 1e-8

    @pytest.mark.parametrize(("rate", "c"), [*SPHERES, (1.0, 0.0)])
    def test_until_it_rests(self, rate, c):
        result = drop(rate, c, 0.5, 12.0, basset.Collocation(rtol=1e-9))
        assert result.status == 2
        assert "rest" in result.message.lower()
        assert result.success
        assert abs(result.y[0, -1]) <= 1e-8
        assert abs(result.y[1, -1]) <= 1e-10
        bounces = exact(rate, c, 0.5, 8)
        assert np.abs(result.t_events[0][:8] - bounces.times).max() <= 1e-8
        assert 0.0 <= result.t[-1] - bounces.times[-1] <= 0.1  # what is left of the cascade

    def test_without_history_the_cascade_ends_where_it_should(self):
        """No drag, no history: the flights are a geometric series, T = √(2h/g) (1 + e)/(1 − e)."""
        result = drop(0.0, 0.0, 0.5, 12.0, basset.Collocation(rtol=1e-10))
        assert result.status == 2
        assert result.t[-1] == pytest.approx(np.sqrt(2.0) * 3.0, abs=1e-8)

    @pytest.mark.parametrize("restitution", [0.5, 0.8])
    @pytest.mark.parametrize(("rate", "c"), SPHERES)
    def test_physics(self, rate, c, restitution):
        """The bed is never entered, the energy never exceeds that of the drop, history dissipates in sum, every contact loses."""
        result = drop(rate, c, restitution, 6.5, basset.Collocation(rtol=1e-9), dense_output=True)
        ends = np.unique(result.t)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        share, weights = (nodes + 1.0) / 2.0, weights / 2.0
        lowest, most, work, least = np.inf, -np.inf, 0.0, np.inf
        for left, right in pairwise(ends):
            inner = left + (right - left) * share**2 * (1.0 - 1e-15)  # before the jump at the right end
            velocity, height = result.sol(inner)
            (v0, v1), (z0, z1) = result.sol(np.array([left, right]))
            if right in result.t_events[0]:
                v1 = result.y_events[0][result.t_events[0] == right][0, 0]
            lost = rate * (right - left) * np.sum(2.0 * share * weights * velocity**2)
            work += -(z1 - z0) - 0.5 * (v1**2 - v0**2) - lost  # ∫ c·H·v over the step, from y' = −1 − λy − c·H
            lowest, most, least = min(lowest, height.min(), z1), max(most, (0.5 * velocity**2 + height).max()), min(least, work)
        assert lowest >= -1e-10
        assert most <= 1.0 + 1e-9
        assert least >= -1e-9
        assert work > 0.01
        before = result.y_events[0][:, 0]
        after = result.sol(result.t_events[0])[0]
        assert len(before) > 3
        if result.status == 2:
            before, after = before[:-1], after[:-1]
        np.testing.assert_allclose(after, -restitution * before, rtol=1e-6)
        assert (after**2 < before**2).all()

    def test_the_cost_is_linear_in_the_impacts(self):
        """Each flight costs about the same number of steps, the twentieth as the second."""
        result = drop(0.1, 0.1, 0.9, 30.0, basset.Collocation(rtol=1e-8))
        impacts = result.t_events[0][:60]
        assert len(impacts) == 60
        steps = np.searchsorted(np.unique(result.t), impacts)
        slope, _ = np.polyfit(np.arange(60), steps, 1)
        assert 1.0 <= slope <= 12.0
        assert np.diff(steps).max() <= 15
        assert np.diff(steps)[30:].mean() <= 1.2 * np.diff(steps)[:30].mean()


class TestFiniteReynolds:
    """y(t) − y(0) − ∫fun + c∫K(t − τ) y(τ) dτ = 0: the equation integrated once, by quadratures that know nothing of the solver."""

    KERNELS: ClassVar = {
        "basset": basset.BassetKernel(),
        **{f"mei_adrian, slip {slip:g}": basset.MeiAdrianKernel(slip, 1e-3, 1e-6) for slip in (1e-3, 1e-2, 0.1)},
        "dorgan_loth": basset.MeiAdrianKernel.dorgan_loth(1e-2, 1e-3, 1e-6),
    }

    @staticmethod
    def defect(sol, fun, c, kernel, t):
        """Composite Gauss: τ = u² towards the start, where y is a series in √τ; t − τ = s⁴ towards t, where K is singular."""
        nodes, weights = np.polynomial.legendre.leggauss(24)
        edges = np.linspace(0.0, 1.0, 41)
        u = (edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1.0) / 2.0).ravel()
        w = (np.diff(edges)[:, None] * weights / 2.0).ravel()
        half = t / 2.0
        early, late = half * u**2, half * u**4
        jacobian_early, jacobian_late = half * 2.0 * u * w, half * 4.0 * u**3 * w
        start, end = sol(early)[0], sol(t - late)[0]
        memory = jacobian_early @ (kernel(t - early) * start) + jacobian_late @ (kernel(late) * end)
        forces = jacobian_early @ fun(early, start) + jacobian_late @ fun(t - late, end)
        return sol(t)[0] - sol(0.0)[0] - forces + c * memory

    @pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
    @pytest.mark.parametrize("rtol", [1e-5, 1e-8])
    @pytest.mark.parametrize(
        "fun",
        [lambda t, y: -y, lambda t, y: np.cos(3.0 * t) - y - 0.5 * y * np.abs(y)],
        ids=["linear", "driven, quadratic drag"],
    )
    def test_the_integrated_equation_holds(self, kernel, rtol, fun):
        result = basset.solve(fun, (0.0, 2.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.Collocation(rtol=rtol), dense_output=True)
        assert result.status == 0
        for t in (1e-3, 0.1, 0.7, 2.0):
            assert abs(self.defect(result.sol, fun, 0.6, kernel, t)) <= FACTOR * rtol

    @pytest.mark.parametrize("kernel", list(KERNELS.values())[1:], ids=list(KERNELS)[1:])
    @pytest.mark.parametrize("rtol", [1e-9, 1e-10])
    def test_at_fine_tolerances_too(self, kernel, rtol):
        result = basset.solve(lambda t, y: -y, (0.0, 2.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.Collocation(rtol=rtol), dense_output=True)
        assert result.status == 0, result.message
        for t in (1e-3, 0.1, 0.7, 2.0):
            assert abs(self.defect(result.sol, lambda t, y: -y, 0.6, kernel, t)) <= FACTOR * rtol

    @pytest.mark.parametrize("kernel", list(KERNELS.values())[1:], ids=list(KERNELS)[1:])
    @pytest.mark.parametrize("rtol", [1e-11, 1e-12])
    def test_finer_ones_are_refused(self, kernel, rtol):
        result = basset.solve(lambda t, y: -y, (0.0, 2.0), [1.0], coefficient=0.6, kernel=kernel, method=basset.Collocation(rtol=rtol))
        assert result.status == -1
        assert result.message.startswith("rtol must be at least 1e-10 with MeiAdrianKernel(")

    def test_no_slip_is_the_basset_kernel(self):
        case = relaxing(1.0, 0.6, 2.0)
        t, exact = case.path
        result = case.solve(basset.Collocation(rtol=1e-9), kernel=basset.MeiAdrianKernel(0.0, 1e-3, 1e-6), dense_output=True)
        assert np.abs(result.sol(t) - exact).max() <= 1e-8

    @pytest.mark.parametrize("slip", [1e-3, 1e-2, 0.1])
    def test_agrees_with_fine_fixed_steps(self, slip):
        """A drive of t⁵ leaves the start smooth to t^6.5: Daitche(5) is good to h^6."""
        kernel = basset.MeiAdrianKernel(slip, 1e-3, 1e-6)

        def solved(method):
            return basset.solve(lambda t, y: t**5 - y, (0.0, 2.0), [0.0], coefficient=0.6, kernel=kernel, method=method).y[0, -1]

        fixed = [solved(basset.FixedStep(2.0 / n, basset.Daitche(order=5))) for n in (50, 100)]
        assert abs(solved(basset.Collocation(rtol=1e-10)) - fixed[1]) <= 1e-9 + 0.1 * abs(fixed[1] - fixed[0])
        assert abs(fixed[1] - fixed[0]) <= 1e-6

    def test_a_faster_decay_remembers_less(self):
        """The finite-Reynolds kernel lies below the Basset kernel: a relaxing slip is held back less."""
        t = np.linspace(0.1, 2.0, 20)
        basset_kernel, finite = (
            basset.solve(lambda t, y: 0.0 * y, (0.0, 2.0), [1.0], coefficient=0.6, kernel=kernel, t_eval=t).y[0]
            for kernel in (basset.BassetKernel(), basset.MeiAdrianKernel(0.1, 1e-3, 1e-6))
        )
        assert (finite > basset_kernel).all()
