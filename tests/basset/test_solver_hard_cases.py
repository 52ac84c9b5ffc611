"""Hard cases of equations with memory, each by its name: stiff, light, huge, resting, jumping twice, and on the node."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.integrate
from solver_cases import RTOLS, drop, relaxing, settling, smooth

import basset
from basset import reference

pytestmark = pytest.mark.analytic

FACTOR = 10.0  # between the tolerance of a step and the error of the path


def sphere(density_ratio: float, reynolds: float = 1.0) -> tuple[float, float]:
    """(drag rate, history coefficient) of a Stokes sphere with added mass: λ = 18α/Re, c = 9α/√(πRe), α = 1/(ρ_s/ρ + 1/2)."""
    alpha = 1.0 / (density_ratio + 0.5)
    return 18.0 * alpha / reynolds, 9.0 * alpha / math.sqrt(math.pi * reynolds)


@pytest.mark.parametrize("rtol", RTOLS)
class TestExtremes:
    @pytest.mark.parametrize("c", [0.0, 0.6, 1e3])
    def test_stiff_drag(self, rtol, c):
        """rate·t_end = 1e6."""
        assert relaxing(1e6, c, 1.0).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol
        assert settling(1e6, c, 1.0, gravity=1e6).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol

    def test_stiff_drag_on_a_slow_solution_costs_nothing(self, rtol):
        case = smooth(1e6, 0.6, 1.0)
        assert case.error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol
        assert case.solve(basset.Collocation(rtol=rtol)).nsteps <= 20

    def test_light_particle(self, rtol):
        rate, c = sphere(1e-3)
        assert relaxing(rate, c, 1.0).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol
        assert settling(rate, c, 1.0).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol

    @pytest.mark.parametrize("c", [1e2, 1e3, 1e4])
    def test_huge_c(self, rtol, c):
        """At c = 1e4 the slip fades within 1/(πc²) = 3e-9 of the time span."""
        assert relaxing(1.0, c, 1.0).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol
        assert settling(1.0, c, 1.0, gravity=c).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol

    def test_tiny_c(self, rtol):
        assert relaxing(1.0, 1e-12, 4.0).error(basset.Collocation(rtol=rtol)) <= FACTOR * rtol


class TestWithoutHistory:
    @staticmethod
    def van_der_pol(t, y):
        return np.array([y[1], 5.0 * (1.0 - y[0] ** 2) * y[1] - y[0]])

    @pytest.mark.parametrize("options", [{"memory": [0, 1], "coefficient": 0.0}, {"memory": [1], "coefficient": [0.0]}, {"memory": []}], ids=str)
    @pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
    def test_c_zero_is_an_ordinary_equation(self, rtol, options):
        t = np.linspace(0.0, 10.0, 401)
        known = scipy.integrate.solve_ivp(self.van_der_pol, (0.0, 10.0), [2.0, 0.0], "DOP853", t, rtol=1e-13, atol=1e-14).y
        found = basset.solve(self.van_der_pol, (0.0, 10.0), [2.0, 0.0], method=basset.Collocation(rtol=rtol), t_eval=t, **options).y
        assert (np.abs(found - known).max(axis=1) / np.abs(known).max(axis=1)).max() <= FACTOR * rtol

    @pytest.mark.parametrize(
        "method",
        [basset.FixedStep(0.01, basset.Daitche(order=3)), basset.FixedStep(0.01, basset.Daitche(order=3), input="slip"), basset.RungeKutta4(0.01)],
        ids=["rate", "slip", "runge_kutta_4"],
    )
    @pytest.mark.parametrize("memory", [[], [1]], ids=str)
    def test_fixed_steps_too(self, method, memory):
        t = np.linspace(0.0, 1.0, 101)
        known = scipy.integrate.solve_ivp(self.van_der_pol, (0.0, 1.0), [2.0, 0.0], "DOP853", t, rtol=1e-13, atol=1e-14).y
        found = basset.solve(self.van_der_pol, (0.0, 1.0), [2.0, 0.0], memory, 0.0, method=method)
        assert np.abs(found.y - known).max() <= 1e-6

    def test_some_components_without(self):
        """c = (0.6, 0): the second slip forgets, the first does not."""
        t, exact = relaxing(1.0, 0.6, 4.0).path
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0, 1.0], [0, 1], [0.6, 0.0], method=basset.Collocation(rtol=1e-9), dense_output=True)
        assert np.abs(result.sol(t) - [exact[0], np.exp(-t)]).max() <= 1e-8


def clock(at: float, jump=None, direction: float = 0.0):
    """An event at a given time."""

    def event(t, y):
        return t - at

    event.direction = direction
    if jump is not None:
        event.jump = jump
    return event


def kicked(t, kicks, rate=1.0, c=0.6):
    """y of y' = −λy − c·H[y] from rest, kicked by (time, size)."""
    return sum(size * np.where(t >= at, reference.response(np.maximum(t - at, 0.0), rate, c), 0.0) for at, size in kicks)


KICKED = {"coefficient": 0.6, "method": basset.Collocation(rtol=1e-9), "dense_output": True}


class TestJumps:
    T = np.linspace(0.0, 4.0, 801)

    def test_two_jumps_at_one_time(self):
        """Two events at t = 1, each with a jump: applied in the order of the list, the sum is remembered."""
        events = [clock(1.0, lambda t, y: y + 1.0), clock(1.0, lambda t, y: 3.0 * y)]
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [0.0], events=events, **KICKED)
        assert [len(times) for times in result.t_events] == [1, 1]
        np.testing.assert_allclose(result.y_events[1], [[1.0]], rtol=1e-9)  # after the first jump
        assert result.sol(1.0)[0] == pytest.approx(3.0, rel=1e-8)
        late = self.T[self.T > 1.0]
        assert np.abs(result.sol(late)[0] - kicked(late, [(1.0, 3.0)])).max() <= 3e-8

    def test_two_jumps_that_cancel(self):
        """Nothing is left of +1 −1 at one time."""
        events = [clock(1.0, lambda t, y: y + 1.0), clock(1.0, lambda t, y: y - 1.0)]
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], events=events, **KICKED)
        t, exact = relaxing(1.0, 0.6, 4.0).path
        assert np.abs(result.sol(t) - exact).max() <= 1e-8

    @pytest.mark.parametrize("apart", [1e-9, 1e-6, 1e-3])
    def test_two_jumps_closer_than_any_step(self, apart):
        events = [clock(1.0, lambda t, y: y + 1.0), clock(1.0 + apart, lambda t, y: y - 2.0)]
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [0.0], events=events, **KICKED)
        assert result.status == 0
        late = self.T[self.T > 1.01]
        assert np.abs(result.sol(late)[0] - kicked(late, [(1.0, 1.0), (1.0 + apart, -2.0)])).max() <= 2e-8

    def test_many_jumps(self):
        """Kicks at twenty times, of both signs."""
        rng = np.random.default_rng(4)
        kicks = [(float(at), float(size)) for at, size in zip(np.sort(rng.uniform(0.1, 3.9, 20)), rng.uniform(-1.0, 1.0, 20), strict=True)]
        events = [clock(at, lambda t, y, size=size: y + size) for at, size in kicks]
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [0.0], events=events, **KICKED)
        assert [times.tolist() for times in result.t_events] == [[pytest.approx(at, abs=1e-12)] for at, _ in kicks]
        assert np.abs(result.sol(self.T)[0] - kicked(self.T, kicks)).max() <= 1e-8

    def test_a_jump_of_another_component_is_not_remembered(self):
        """A kick of the position leaves the slip alone."""
        push = clock(1.0, lambda t, y: [y[0], y[1] + 5.0])
        result = basset.solve(lambda t, y: [-y[0], y[0]], (0.0, 4.0), [1.0, 0.0], memory=[0], events=push, **KICKED)
        t, exact = relaxing(1.0, 0.6, 4.0).path
        assert np.abs(result.sol(t)[0] - exact[0]).max() <= 1e-8
        moved = reference.response(t, 1.0, 0.6, 1) + np.where(t >= 1.0, 5.0, 0.0)
        away = np.abs(t - 1.0) > 1e-9
        assert np.abs(result.sol(t)[1] - moved)[away].max() <= 1e-8

    def test_a_jump_that_changes_nothing(self):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], events=clock(1.0, lambda t, y: y), **KICKED)
        t, exact = relaxing(1.0, 0.6, 4.0).path
        assert np.abs(result.sol(t) - exact).max() <= 1e-8

    def test_a_jump_that_changes_nothing_marks_a_discontinuous_force(self):
        """sign(t − 1), a step of which begins where the sign changes: y = |t − 1| − 1."""
        mark = clock(1.0, lambda t, y: y)
        options = {"coefficient": 0.0, "events": mark, "method": basset.Collocation(rtol=1e-9), "dense_output": True}
        result = basset.solve(lambda t, y: [math.copysign(1.0, t - 1.0)], (0.0, 4.0), [0.0], **options)
        assert np.abs(result.sol(self.T)[0] - (np.abs(self.T - 1.0) - 1.0)).max() <= 1e-8

    def test_a_jump_at_the_very_end(self):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], events=clock(4.0, lambda t, y: y + 1.0), **KICKED)
        assert result.t[-1] == 4.0
        assert result.y[0, -1] - result.y_events[0][0, 0] == pytest.approx(1.0, abs=1e-15)
        assert result.y_events[0][0, 0] == pytest.approx(float(reference.relaxing(4.0, 1.0, 0.6)), abs=1e-8)


METHODS = {
    "collocation": basset.Collocation(rtol=1e-8),
    "fixed_step": basset.FixedStep(0.125, basset.Daitche(order=2)),
    "fixed_step on slips": basset.FixedStep(0.125, basset.Daitche(order=2), input="slip"),
    "runge_kutta_4": basset.RungeKutta4(0.125),
}
every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


class TestEventsOnNodes:
    @every_method
    @pytest.mark.parametrize("jump", [None, lambda t, y: y + 1.0], ids=["no jump", "jump"])
    def test_an_event_on_a_node(self, method, jump):
        """At every node of the run without events: found once, and there."""
        nodes = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method).t
        for node in nodes[1:-1:5]:
            result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method, events=clock(node, jump))
            assert len(result.t_events[0]) == 1, node
            assert abs(result.t_events[0][0] - node) <= 1e-12

    @every_method
    @pytest.mark.parametrize("start", [1.0, 0.1, -0.3, 1e-9, 1e9])
    @pytest.mark.parametrize("jump", [None, lambda t, y: y + 1.0], ids=["no jump", "jump"])
    def test_an_event_at_the_start_does_not_count(self, method, start, jump):
        def event(t, y):
            return y[0] - start

        if jump is not None:
            event.jump = jump
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [start], coefficient=0.6, method=method, events=event)
        assert result.status == 0
        assert len(result.t_events[0]) == 0
        by_time = basset.solve(lambda t, y: -y, (0.0, 4.0), [start], coefficient=0.6, method=method, events=clock(0.0, jump))
        assert len(by_time.t_events[0]) == 0

    @every_method
    def test_an_event_at_the_end(self, method):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method, events=clock(4.0))
        np.testing.assert_allclose(result.t_events[0], [4.0], rtol=1e-15)

    @every_method
    def test_touching_without_crossing_is_no_event(self, method):
        def touch(t, y):
            return (t - 1.3) ** 2 + 1e-9

        assert len(basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method, events=touch).t_events[0]) == 0


class TestRest:
    def test_zeno_cascade(self):
        """e = 0.5: forty impacts at most, each flight shorter, the last below 1e-10 of the span; nothing sinks."""
        result = drop(1.0, 0.6, 0.5, 8.0, basset.Collocation(rtol=1e-8), dense_output=True)
        assert result.status == 2
        flights = np.diff(result.t_events[0])
        assert (flights[1:] < flights[:-1]).all()
        assert flights[-1] < 8e-10 <= flights[-2]
        assert len(flights) <= 40
        assert result.sol(np.linspace(0.0, result.t[-1], 2001))[1].min() >= -1e-10

    @pytest.mark.parametrize("c", [0.0, 0.6, 5.0])
    @pytest.mark.parametrize("restitution", [0.0, 1e-9, 1e-3, 0.02])
    def test_a_jump_that_leaves_no_flight_or_hardly_any(self, restitution, c):
        result = drop(1.0, c, restitution, 12.0, basset.Collocation(rtol=1e-8), dense_output=True)
        assert result.status == 2
        assert "rest" in result.message.lower()
        assert result.sol(np.linspace(0.0, result.t[-1], 2001))[1].min() >= -1e-10
        assert abs(result.y[1, -1]) <= 1e-10
        first = reference.bouncing(1.0, c, impacts=1).times[0]
        assert result.t_events[0][0] == pytest.approx(first, abs=1e-7)
        assert result.t[-1] - first <= 0.1

    def test_a_kick_at_an_interface_is_not_a_contact(self):
        """A jump that lets the sphere pass slows it, and it goes on below."""

        def surface(t, y):
            return y[1]

        surface.direction = -1.0
        surface.jump = lambda t, y: [0.5 * y[0], y[1]]
        result = basset.solve(lambda t, y: [-1.0 - y[0], y[0]], (0.0, 6.0), [0.0, 1.0], coefficient=0.6, events=surface, method=basset.Collocation(rtol=1e-9))
        assert result.status == 0
        bounces = reference.bouncing(1.0, 0.6, restitution=0.5, impacts=1)
        at, before = bounces.times[0], bounces.jumps[0] / -1.5
        assert result.t_events[0] == pytest.approx([at], abs=1e-8)
        after = reference.settling(6.0, 1.0, 0.6) - 0.5 * before * reference.response(6.0 - at, 1.0, 0.6)
        assert result.y[0, -1] == pytest.approx(float(after), abs=1e-8)
        assert result.y[1, -1] < -1.0

    def test_a_sphere_stopped_by_a_ceiling_falls(self):
        """e = 0 upwards, no history: it leaves the ceiling at once, with no speed."""

        def ceiling(t, y):
            return y[1] - 1.0

        ceiling.jump = lambda t, y: [0.0, y[1]]
        ceiling.direction = 1.0
        result = basset.solve(lambda t, y: [-1.0, y[0]], (0.0, 3.0), [2.0, 0.0], coefficient=0.0, events=ceiling, method=basset.Collocation(rtol=1e-9))
        at = 2.0 - math.sqrt(2.0)
        assert result.status == 0
        assert result.t_events[0][0] == pytest.approx(at, abs=1e-9)
        assert result.y[1, -1] == pytest.approx(1.0 - 0.5 * (3.0 - at) ** 2, abs=1e-8)


class TestGivingUp:
    def test_too_many_steps(self):
        result = basset.solve(lambda t, y: np.cos(50.0 * t) - y, (0.0, 100.0), [1.0], coefficient=0.6, max_steps=20)
        assert (result.status, result.success, result.nsteps) == (-1, False, 20)
        assert "max_steps = 20" in result.message
        assert 0.0 < result.t[-1] < 100.0

    @pytest.mark.parametrize("method", [basset.FixedStep(0.01), basset.RungeKutta4(0.01)], ids=["fixed_step", "runge_kutta_4"])
    def test_too_many_fixed_steps_are_known_before(self, method):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], method=method, max_steps=399)
        assert result.status == -1
        assert "max_steps = 399" in result.message
        assert basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], method=method, max_steps=400).status == 0

    def test_blow_up_ends_at_the_step_floor(self):
        """y' = y² from 1 is infinite at t = 1."""
        result = basset.solve(lambda t, y: y**2, (0.0, 2.0), [1.0], coefficient=0.0)
        assert result.status == -1
        assert "step" in result.message or "fun gave" in result.message
        assert 0.99 <= result.t[-1] <= 1.0 + 1e-6
        assert result.y.shape == (1, len(result.t))

    @every_method
    def test_nan_from_fun_says_where(self, method):
        def fun(t, y):
            return [-y[0], math.nan if t > 1.0 else -y[1]]

        result = basset.solve(fun, (0.0, 4.0), [1.0, 1.0], [0, 1], 0.6, method=method)
        assert result.status == -1
        assert "component 1" in result.message
        assert "t = 1" in result.message or "t = 0.9999" in result.message or method is METHODS["collocation"]
        assert np.isfinite(result.y).all()
        assert result.t[-1] <= 1.0 + 1e-6

    @every_method
    def test_infinity_at_the_start(self, method):
        result = basset.solve(lambda t, y: [-math.inf], (0.0, 4.0), [1.0], method=method)
        assert result.status == -1
        assert "fun gave -inf in component 0 at t = 0" in result.message
        assert result.t.tolist() == [0.0]
        assert result.y.tolist() == [[1.0]]

    @every_method
    def test_nan_from_an_event_or_a_jump(self, method):
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method, events=[clock(9.0), lambda t, y: math.nan])
        assert result.status == -1
        assert "event 1 gave nan" in result.message
        result = basset.solve(lambda t, y: -y, (0.0, 4.0), [1.0], coefficient=0.6, method=method, events=clock(2.0, lambda t, y: [math.nan]))
        assert result.status == -1
        assert "jump of event 0 gave nan in component 0 at t = 2" in result.message

    def test_t_eval_of_a_run_that_gave_up(self):
        """What was reached is given."""
        t = np.linspace(0.0, 2.0, 21)
        result = basset.solve(lambda t, y: y**2, (0.0, 2.0), [1.0], coefficient=0.0, t_eval=t)
        np.testing.assert_array_equal(result.t, t[: len(result.t)])
        assert 9 <= len(result.t) <= 11
        np.testing.assert_allclose(result.y[0, :9], 1.0 / (1.0 - t[:9]), rtol=1e-4)
