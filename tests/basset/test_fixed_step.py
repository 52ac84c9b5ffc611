"""Fixed steps: the order of the rule on smooth problems, and what rest, slips and impacts leave of it."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import pytest
from solver_cases import coupled, drop, flat, relaxing, settling, smooth

import basset
from basset import reference
from basset.measure import observed_orders

pytestmark = pytest.mark.analytic

RULES: dict[str, basset.Rule] = {
    "semi_derivative": basset.SemiDerivative(),
    "euler_maclaurin": basset.EulerMaclaurin(),
    "brush": basset.Brush(),
    **{f"daitche_{p}": basset.Daitche(order=p) for p in (1, 2, 3, 4, 5)},
    "hinsberg": basset.Hinsberg(tail=False),
    "windowed": basset.Windowed(basset.Daitche(order=2), 1.0, tail=basset.ExponentialSum.fit(1.0, 6.0, 1e-10)),
    "exponential": basset.Exponential(order=3, rtol=1e-10),
}


def errors(case, make, counts) -> np.ndarray:
    """The largest error at the nodes for each number of steps."""
    found = []
    for n in counts:
        result = case.solve(make(case.end / n))
        assert result.status == 0, result.message
        assert result.nsteps == n
        found.append(np.abs(result.y - case.exact(result.t)).max())
    return np.array(found)


def slopes(case, make, counts=(40, 80, 160, 320)) -> np.ndarray:
    return observed_orders(case.end / np.array(counts), errors(case, make, counts))


class TestSmooth:
    @pytest.mark.parametrize("input", ["rate", "slip"])
    @pytest.mark.parametrize("p", [1, 2, 3, 4, 5])
    @pytest.mark.parametrize("case", [flat(1.0, 0.6, 2.0), flat(0.5, 2.0, 2.0)], ids=["drag", "history"])
    def test_daitche_on_rates_and_on_slips(self, case, p, input):
        """y = t⁶, and its history a t^5.5: as smooth as degree 5 can use. Rates of it are exact for degree 5."""
        counts = (20, 40, 80)
        found = errors(case, lambda dt: basset.FixedStep(dt, basset.Daitche(order=p), input=input), counts)
        if p == 5 and input == "rate":
            assert found.max() <= 1e-12
        else:
            assert (observed_orders(2.0 / np.array(counts), found) >= p + 0.75).all()

    @pytest.mark.parametrize("name", RULES)
    def test_every_rule_has_its_order(self, name):
        rule = RULES[name]
        order = slopes(smooth(1.0, 0.6, 5.0), lambda dt: basset.FixedStep(dt, rule))
        low = 0.4 if rule.error_order == 0.5 else rule.error_order - 0.25
        assert (order >= low).all()
        if name != "brush":  # whose Simpson weights show first
            assert (order <= rule.error_order + 0.25).all()

    @pytest.mark.parametrize("p", [1, 2, 3, 5])
    def test_systems(self, p):
        """Nonlinear, two coefficients, a component without memory between."""
        order = slopes(coupled(4.0), lambda dt: basset.FixedStep(dt, basset.Daitche(order=p)), (40, 80, 160))
        assert (order >= p + 0.75).all()

    def test_published_tails_end_at_their_two_digits(self):
        """van Hinsberg's ten terms: no step makes the error smaller than a few 1e-5."""
        found = errors(smooth(1.0, 0.6, 5.0), lambda dt: basset.FixedStep(dt, basset.Hinsberg(window=1.0)), (40, 320, 640))
        assert found[0] > 4.0 * found[1]
        assert 1e-5 <= found[2] <= 1e-3
        assert found[2] > 0.5 * found[1]

    @pytest.mark.parametrize("name", [name for name in basset.SCHEMES if name != "windowed"])
    def test_every_name_is_a_rule(self, name):
        case = smooth(1.0, 0.6, 5.0)
        named, made = (case.solve(basset.FixedStep(0.05, rule)).y for rule in (name, basset.SCHEMES[name]()))
        np.testing.assert_array_equal(named, made)
        assert np.abs(named[0] - np.cos(np.linspace(0.0, 5.0, 101))).max() <= (
            0.08 if name == "newton_cotes" else 0.05
        )  # 1.59 times the error of Euler–Maclaurin

    def test_windowed_needs_its_parameters_said(self):
        with pytest.raises(TypeError, match="windowed"):
            basset.FixedStep(0.05, "windowed")

    def test_dense_output_is_as_good_as_a_cubic(self):
        case = smooth(1.0, 0.6, 5.0)
        t = np.linspace(0.0, 5.0, 1234)
        found = []
        for n in (40, 80, 160):
            result = case.solve(basset.FixedStep(5.0 / n, basset.Daitche(order=5)), dense_output=True)
            found.append(np.abs(result.sol(t)[0] - np.cos(t)).max())
        assert (observed_orders(5.0 / np.array([40, 80, 160]), np.array(found)) >= 3.75).all()

    def test_the_step_is_the_nearest_that_divides_the_span(self):
        result = smooth(1.0, 0.6, 5.0).solve(basset.FixedStep(0.3))
        assert result.nsteps == 17
        np.testing.assert_allclose(np.diff(result.t), 5.0 / 17, rtol=1e-12)
        assert result.t[-1] == 5.0

    @pytest.mark.parametrize(("p", "stable", "unstable"), [(1, 1e5, None), (2, 5.5, 8.0), (3, 2.7, 4.0)])
    def test_stability_is_that_of_adams_and_moulton(self, p, stable, unstable):
        """Of rate·dt: any for degree 1, up to 6 for degree 2 and 3 for degree 3 (Hairer, Nørsett & Wanner, III.3)."""
        dt, steps = 0.01, 400
        for bound, product in ((True, stable), (False, unstable)):
            if product is not None:
                case = smooth(product / dt, 1e-3, dt * steps)
                error = np.abs(case.solve(basset.FixedStep(dt, basset.Daitche(order=p))).y[0] - np.cos(dt * np.arange(steps + 1))).max()
                assert error < 1e-6 if bound else error > 1.0


class TestRest:
    """Settling from rest starts with √t in the history: degree does not help."""

    @pytest.mark.parametrize("p", [1, 2, 3])
    def test_rates_are_left_with_three_halves(self, p):
        order = slopes(settling(1.0, 0.6, 4.0), lambda dt: basset.FixedStep(dt, basset.Daitche(order=p)))
        assert (np.abs(order - 1.5) <= 0.15).all()

    @pytest.mark.parametrize("p", [1, 2, 3])
    def test_slips_are_left_with_two(self, p):
        order = slopes(settling(1.0, 0.6, 4.0), lambda dt: basset.FixedStep(dt, basset.Daitche(order=p), input="slip"))
        assert (np.abs(order - 2.0) <= 0.15).all()


class TestSlip:
    """After a slip the rate goes as 1/√t: with rates half an order is left, with slips one near the start and 3/2 later."""

    @pytest.mark.parametrize("name", RULES)
    def test_rates_are_left_with_one_half(self, name):
        order = slopes(relaxing(1.0, 0.6, 4.0), lambda dt: basset.FixedStep(dt, RULES[name]))
        assert ((order >= 0.25) & (order <= 0.6)).all()

    @pytest.mark.parametrize("p", [1, 2, 3])
    def test_slips_are_left_with_one_on_the_whole_path(self, p):
        order = slopes(relaxing(1.0, 0.6, 4.0), lambda dt: basset.FixedStep(dt, basset.Daitche(order=p), input="slip"))
        assert (np.abs(order - 1.0) <= 0.15).all()

    @pytest.mark.parametrize("p", [1, 3])
    def test_slips_are_left_with_three_halves_at_the_end(self, p):
        case, counts = relaxing(1.0, 0.6, 4.0), np.array([40, 80, 160, 320])
        found = [abs(case.solve(basset.FixedStep(4.0 / n, basset.Daitche(order=p), input="slip")).y[0, -1] - case.exact(np.array([4.0]))[0, 0]) for n in counts]
        assert (np.abs(observed_orders(4.0 / counts, np.array(found)) - 1.5) <= 0.15).all()

    def test_slip_samples_beat_rate_samples(self):
        case = relaxing(1.0, 0.6, 4.0)
        on_rates, on_slips = (errors(case, lambda dt, i=i: basset.FixedStep(dt, basset.Daitche(order=2), input=i), (320,))[0] for i in ("rate", "slip"))
        assert on_slips < 0.05 * on_rates

    @pytest.mark.parametrize("p", [1, 2, 3])
    def test_without_initial_memory_the_start_is_another(self, p):
        """initial_slip = 0: y' = −λy − c·H with y(0) remembered by drag only. Transform: y = R + c√π ∫R(t−τ) (πτ)^(-1/2) dτ, so y(t) > R(t)."""
        t = np.linspace(0.5, 4.0, 8)
        result = basset.solve(
            lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, initial_slip=[0.0], method=basset.FixedStep(0.01, basset.Daitche(order=p)), t_eval=t
        )
        fine = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, initial_slip=[0.0], method=basset.Collocation(rtol=1e-9), t_eval=t)
        assert np.abs(result.y - fine.y).max() <= 1e-3  # h^(3/2)
        assert (result.y[0] > reference.relaxing(t, 1.0, 0.6)).all()


class TestImpacts:
    """Events snap to the next node."""

    METHODS: ClassVar = {
        "daitche_1": lambda dt: basset.FixedStep(dt, basset.Daitche(order=1)),
        "daitche_3": lambda dt: basset.FixedStep(dt, basset.Daitche(order=3)),
        "daitche_3 on slips": lambda dt: basset.FixedStep(dt, basset.Daitche(order=3), input="slip"),
        "exponential": lambda dt: basset.FixedStep(dt, basset.Exponential(order=3, rtol=1e-8)),
        "runge_kutta_4": basset.RungeKutta4,
    }

    @pytest.mark.parametrize("make", METHODS.values(), ids=METHODS)
    def test_the_first_impact_snaps_to_the_node_after_it(self, make):
        exact = float(reference.bouncing(1.0, 0.6, impacts=1).times[0])
        for n in (200, 500):
            dt = 3.0 / n
            found = drop(1.0, 0.6, 0.8, 3.0, make(dt), lift=True).t_events[0][0]
            assert found / dt == pytest.approx(round(found / dt), abs=1e-9)
            assert -1.5 * dt <= found - exact <= 1.5 * dt

    @staticmethod
    def second_impacts(make) -> tuple[np.ndarray, np.ndarray]:
        """(numbers of steps, errors of the second impact), which feels the history of the first."""
        exact = float(reference.bouncing(1.0, 0.6, impacts=2).times[1])
        counts = np.array([250, 400, 640, 1000, 1600])
        return counts, np.array([abs(drop(1.0, 0.6, 0.8, 3.3, make(3.3 / n), lift=True).t_events[0][1] - exact) for n in counts])

    @pytest.mark.parametrize("name", ["daitche_1", "daitche_3", "runge_kutta_4"])
    def test_an_impact_leaves_half_an_order_to_rates(self, name):
        counts, found = self.second_impacts(self.METHODS[name])
        assert 0.35 <= -np.polyfit(np.log(counts), np.log(found), 1)[0] <= 0.75

    def test_an_impact_leaves_the_first_order_to_slips(self):
        """Two snaps, each of up to a whole dt: a few dt, and not much less at every step size."""
        counts, found = self.second_impacts(self.METHODS["daitche_3 on slips"])
        in_steps = found * counts / 3.3
        assert in_steps.max() <= 3.0
        assert in_steps.max() >= 0.1
        assert found[0] > 2.0 * found[-1]

    def test_collocation_is_a_hundred_times_less_work(self):
        """At 1e-6 on two impacts, in evaluations: of first order, the best fixed steps would take error/1e-6 times theirs."""
        exact = reference.bouncing(1.0, 0.6, impacts=2).times
        fine = drop(1.0, 0.6, 0.8, 2.95, basset.Collocation(rtol=1e-7))
        assert np.abs(fine.t_events[0] - exact).max() <= 1e-6
        coarse = drop(1.0, 0.6, 0.8, 2.95, basset.FixedStep(2.95 / 2000, basset.Daitche(order=3), input="slip"), lift=True)
        assert coarse.nfev * np.abs(coarse.t_events[0] - exact).max() / 1e-6 >= 100.0 * fine.nfev

    @pytest.mark.parametrize("make", METHODS.values(), ids=METHODS)
    @pytest.mark.parametrize("restitution", [0.0, 0.3])
    def test_ends_at_rest_and_does_not_sink(self, make, restitution):
        result = drop(1.0, 0.6, restitution, 8.0, make(0.005), lift=True)
        assert result.status == 2
        assert "rest" in result.message
        assert result.t[-1] < 4.0
        assert result.y[1].min() >= -0.005  # at most one step of the fall below the plane, at a speed under 1

    def test_contacts_recorded_before_and_after(self):
        result = drop(1.0, 0.6, 0.8, 2.6, basset.FixedStep(0.01), lift=True)
        k = int(np.flatnonzero(np.diff(result.t) == 0.0)[0])
        np.testing.assert_array_equal(result.y[:, k], result.y_events[0][0])
        assert result.y[0, k + 1] == -0.8 * result.y[0, k]
        assert result.y[1, k + 1] == 0.0


class TestRungeKutta:
    @pytest.mark.parametrize("rule", [basset.SemiDerivative(), basset.Daitche(order=3)], ids=["semi_derivative", "daitche"])
    def test_first_order_with_history(self, rule):
        order = slopes(smooth(1.0, 0.6, 5.0), lambda dt: basset.RungeKutta4(dt, rule))
        assert (np.abs(order - 1.0) <= 0.1).all()

    def test_fourth_order_without(self):
        order = slopes(smooth(1.0, 0.0, 5.0), basset.RungeKutta4)
        assert (np.abs(order - 4.0) <= 0.15).all()

    def test_without_history_it_is_the_classical_method(self):
        def fun(t, y):
            return np.array([y[1], -math.sin(y[0]) - 0.1 * y[1]])

        result = basset.solve(fun, (0.0, 2.0), [1.0, 0.0], memory=[1], coefficient=0.0, method=basset.RungeKutta4(0.1))
        y, h = np.array([1.0, 0.0]), 0.1
        for k in range(20):
            k1 = fun(0.0, y)
            k2 = fun(0.0, y + h / 2 * k1)
            k3 = fun(0.0, y + h / 2 * k2)
            k4 = fun(0.0, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            np.testing.assert_allclose(result.y[:, k + 1], y, rtol=0.0, atol=1e-14)

    def test_order_one_from_rest_one_half_with_slip(self):
        rest = slopes(settling(1.0, 0.6, 4.0), basset.RungeKutta4)
        assert (np.abs(rest - 1.0) <= 0.1).all()
        slip = slopes(relaxing(1.0, 0.6, 4.0), basset.RungeKutta4)
        assert ((slip >= 0.25) & (slip <= 0.6)).all()

    def test_stiff_drag_needs_small_steps(self):
        """Explicit: beyond rate·dt = 2.8 it leaves the solution, as documented of the classical method."""

        def largest(rate: float) -> float:
            return np.abs(basset.solve(lambda t, y: -rate * y, (0.0, 5.0), [1.0], coefficient=0.0, method=basset.RungeKutta4(0.1)).y).max()

        stable, unstable = largest(27.0), largest(29.0)
        assert stable == 1.0
        assert unstable > 2.0


@pytest.mark.parametrize(("lift", "since", "c", "restitution", "floor"), [(2.0, 2.0, 0.6, 0.2, 0.0), (1.0, 2.8, 1.5, 0.3, 0.0), (2.0, 2.2, 0.6, 0.0, 1.0)])
def test_a_body_at_rest_is_drawn_off_by_slips_as_by_collocation(lift, since, c, restitution, floor):
    """What holds it down is the history of its slip, not the integral that fixed steps keep of it; contacts snap to nodes, at √2 a way of √2 dt."""

    def fun(t, y):
        return [y[1], lift * max(0.0, y[2] - since) - 1.0, 1.0]

    def ground(t, y):
        return y[0] - floor

    ground.jump = lambda t, y: [y[0], -restitution * y[1], y[2]]

    def end(method):
        return basset.solve(fun, (0.0, 4.5), [1.0 + floor, 0.0, 0.0], [1], c, initial_slip=[0.0], method=method, events=ground)

    exact = end(basset.Collocation(rtol=1e-9))
    for dt in (0.02, 0.005):
        found = end(basset.FixedStep(dt, basset.Daitche(2), input="slip"))
        assert exact.status == found.status == 0, found.message
        assert np.abs(found.y[:2, -1] - exact.y[:2, -1]).max() <= math.sqrt(2.0) * dt
