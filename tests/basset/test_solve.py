"""The contract of `solve`: what comes back, events, arguments, invariances, and what it refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from all_cases import each
from rule_cases import refused
from solver_cases import CASES, coupled, smooth

import basset
from basset import reference

NAN, INF = float("nan"), float("inf")
FINE = basset.Collocation(rtol=1e-9)
METHODS = {
    "collocation": FINE,
    "fixed_step": basset.FixedStep(0.02, basset.Daitche(order=3)),
    "fixed_step on slips": basset.FixedStep(0.02, basset.Daitche(order=3), input="slip"),
    "runge_kutta_4": basset.RungeKutta4(0.02),
}
every_method = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
# of cos t over six seconds with dt = 0.02: Daitche(3) on rates h⁴, on slips h^2.4, the held history h
ACCURACY = {"collocation": 1e-8, "fixed_step": 1e-6, "fixed_step on slips": 1e-3, "runge_kutta_4": 0.03}
every_accuracy = pytest.mark.parametrize(("method", "accuracy"), [(METHODS[name], ACCURACY[name]) for name in METHODS], ids=METHODS)


def decay(t, y):
    return -y


def marked(function, **attributes):
    for name, value in attributes.items():
        setattr(function, name, value)
    return function


class TestResults:
    @every_method
    def test_shapes(self, method):
        result = coupled(6.0).solve(method, dense_output=True, events=[lambda t, y: y[0], lambda t, y: y[1] + 9.0])
        n = len(result.t)
        assert result.t.shape == (n,)
        assert result.y.shape == (3, n)
        assert result.t[0] == 0.0
        assert result.t[-1] == 6.0
        assert (np.diff(result.t) > 0.0).all()
        assert result.nsteps == n - 1
        assert result.nfev >= result.nsteps
        assert [times.shape for times in result.t_events] == [(2,), (0,)]
        assert [states.shape for states in result.y_events] == [(2, 3), (0, 3)]
        assert (result.status, result.success) == (0, True)
        assert result.message == "The solver reached the end of the time span."
        assert result.y.dtype == result.t.dtype == np.float64
        np.testing.assert_array_equal(result.y[:, 0], [1.0, 1.0, 0.0])

    @every_method
    def test_dense_output(self, method):
        result = coupled(6.0).solve(method, dense_output=True)
        assert result.sol(1.0).shape == (3,)
        assert result.sol([1.0]).shape == (3, 1)
        assert result.sol(np.ones((2, 5))).shape == (3, 2, 5)
        np.testing.assert_allclose(result.sol(result.t), result.y, rtol=0.0, atol=1e-14)
        np.testing.assert_array_equal(result.sol(np.array([2.0, 1.0]))[:, ::-1], result.sol(np.array([1.0, 2.0])))
        for outside in (-0.1, 6.1, [1.0, 7.0], NAN):
            with pytest.raises(ValueError, match=r"t must lie in the solved span \[0, 6\]"):
                result.sol(outside)
        assert coupled(6.0).solve(method).sol is None

    @every_method
    def test_every_piece_has_the_slopes_of_its_values(self, method):
        """From a start with slip, with a jump that shortens a step; against differences of the eighth order."""
        floor = marked(lambda t, y: y[0] - 0.5, jump=lambda t, y: [y[0], y[1] + 0.3, y[2]], direction=-1.0)
        pieces = coupled(6.0).solve(method, dense_output=True, events=[floor]).sol._pieces
        assert len(pieces) > 1
        far, weights = np.arange(1.0, 5.0), np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])
        for piece in pieces:
            theta, h = np.array([0.3, 0.61, 0.9]), 1e-4
            differences = sum(w * (piece.values(theta + k * h) - piece.values(theta - k * h)) for k, w in zip(far, weights, strict=True))
            slopes = piece.slopes(theta)
            assert np.abs(differences / (h * piece.length) - slopes).max() < 1e-14 / (h * piece.length) + 1e-10 * np.abs(slopes).max()

    @every_accuracy
    def test_dense_output_is_continuous_and_right(self, method, accuracy):
        case = smooth(1.0, 0.6, 6.0)
        result = case.solve(method, dense_output=True)
        inner = result.t[1:-1]
        np.testing.assert_allclose(result.sol(inner - 1e-13), result.sol(inner + 1e-13), rtol=0.0, atol=1e-12)
        t, exact = case.path
        assert np.abs(result.sol(t) - exact).max() <= accuracy

    @every_method
    def test_t_eval(self, method):
        case = coupled(6.0)
        t = np.array([0.0, 0.1, 0.1, math.pi, 6.0])
        result = case.solve(method, t_eval=t, dense_output=True)
        np.testing.assert_array_equal(result.t, t)
        np.testing.assert_array_equal(result.y, result.sol(t))
        assert result.nsteps == case.solve(method).nsteps
        empty = case.solve(method, t_eval=[])
        assert empty.t.shape == (0,)
        assert empty.y.shape == (3, 0)

    def test_at_a_jump_the_solution_is_the_one_after_it(self):
        kick = marked(lambda t, y: t - 1.0, jump=lambda t, y: y + 2.0)
        result = basset.solve(decay, (0.0, 3.0), [1.0], coefficient=0.6, events=kick, method=FINE, dense_output=True)
        at = result.t_events[0][0]
        before = result.y_events[0][0, 0]
        assert before == pytest.approx(float(reference.relaxing(1.0, 1.0, 0.6)), abs=1e-8)
        assert result.sol(at)[0] == pytest.approx(before + 2.0, abs=1e-14)
        assert result.sol(np.nextafter(at, 0.0))[0] == pytest.approx(before, abs=1e-6)
        (twice,) = np.flatnonzero(np.diff(result.t) == 0.0)
        np.testing.assert_allclose(result.y[0, twice : twice + 2], [before, before + 2.0], atol=1e-14)
        evaluated = basset.solve(decay, (0.0, 3.0), [1.0], coefficient=0.6, events=kick, method=FINE, t_eval=[at])
        assert evaluated.y[0, 0] == result.sol(at)[0]

    def test_collocation_of_six_digits_is_the_default(self):
        ours, default = (basset.solve(decay, (0.0, 4.0), [1.0], coefficient=0.6, **options) for options in ({"method": basset.Collocation(rtol=1e-6)}, {}))
        np.testing.assert_array_equal(ours.y, default.y)

    def test_defaults_of_memory_and_coefficient(self):
        result = basset.solve(decay, (0.0, 4.0), [1.0, 1.0], method=FINE)
        assert result.y[0, -1] == pytest.approx(float(reference.relaxing(4.0, 1.0, 1.0)), abs=1e-8)
        assert result.y[1, -1] == pytest.approx(math.exp(-4.0), abs=1e-8)

    @every_method
    def test_nothing_given_is_changed(self, method):
        y0, slip, memory, t = np.array([1.0, 2.0]), np.array([1.0]), [1], np.linspace(0.0, 1.0, 5)
        for array in (y0, slip, t):
            array.flags.writeable = False
        basset.solve(decay, (0.0, 1.0), y0, memory, 0.6, initial_slip=slip, t_eval=t, method=method)
        assert memory == [1]

    @every_method
    @pytest.mark.parametrize(
        "y0", [[1, 2], (1.0, 2.0), np.array([1, 2], dtype=np.int32), np.array([1.0, 2.0], dtype=np.float32), np.array([1.0, 9.0, 2.0])[::2]]
    )
    def test_any_array_of_numbers(self, method, y0):
        options = {"memory": np.array([1]), "coefficient": np.float32(0.5), "method": method}
        np.testing.assert_array_equal(basset.solve(decay, (0, 1), y0, **options).y, basset.solve(decay, (0.0, 1.0), [1.0, 2.0], **options).y)

    def test_one_state_and_one_index_may_be_bare(self):
        np.testing.assert_array_equal(
            basset.solve(decay, (0.0, 1.0), 1.0, memory=0, coefficient=0.6, initial_slip=1.0).y, basset.solve(decay, (0.0, 1.0), [1.0], [0], [0.6]).y
        )

    @every_method
    def test_the_same_again(self, method):
        first, second = (coupled(6.0).solve(method) for _ in range(2))
        np.testing.assert_array_equal(first.y, second.y)

    def test_args_reach_fun_events_and_jumps(self):
        seen = []

        def fun(t, y, rate, label):
            seen.append(("fun", label))
            return -rate * y

        def event(t, y, rate, label):
            seen.append(("event", label))
            return t - rate

        def jump(t, y, rate, label):
            seen.append(("jump", label))
            return y + rate

        event.jump = jump
        result = basset.solve(fun, (0.0, 4.0), [1.0], coefficient=0.6, args=(2.0, "x"), events=event, method=FINE)
        assert set(seen) == {("fun", "x"), ("event", "x"), ("jump", "x")}
        exact = reference.relaxing(4.0, 2.0, 0.6) + 2.0 * reference.relaxing(2.0, 2.0, 0.6)
        assert result.y[0, -1] == pytest.approx(float(exact), abs=1e-8)


class TestInitialSlip:
    @pytest.mark.parametrize("slip", [-2.0, 0.0, 0.5, 1.0])
    def test_only_the_jump_is_remembered(self, slip):
        """With no drag y' = −c·H: a start remembered as `slip` differs from y0 by a constant that nothing feels."""
        result = basset.solve(lambda t, y: 0.0 * y, (0.0, 2.0), [1.0], coefficient=0.6, initial_slip=[slip], method=FINE, dense_output=True)
        t = np.linspace(0.0, 2.0, 101)
        assert np.abs(result.sol(t)[0] - (1.0 - slip + slip * reference.response(t, 0.0, 0.6))).max() <= 1e-8

    def test_one_per_component(self):
        result = basset.solve(lambda t, y: 0.0 * y, (0.0, 2.0), [1.0, 1.0, 1.0], [0, 2], [0.6, 2.0], initial_slip=[0.5, -1.0], method=FINE)
        exact = [0.5 + 0.5 * reference.response(2.0, 0.0, 0.6), 1.0, 2.0 - reference.response(2.0, 0.0, 2.0)]
        np.testing.assert_allclose(result.y[:, -1], exact, atol=1e-8)

    @every_accuracy
    def test_every_method_takes_it(self, method, accuracy):
        case = smooth(1.0, 0.6, 6.0)
        assert np.abs(case.solve(method).y[0, -1] - math.cos(6.0)) <= accuracy


class TestEvents:
    """On y = cos t, the history at work."""

    CASE = smooth(1.0, 0.6, 10.0)

    def times(self, method, **attributes):
        result = self.CASE.solve(method, events=marked(lambda t, y: y[0], **attributes))
        return result, result.t_events[0]

    @every_accuracy
    def test_times_and_states(self, method, accuracy):
        result, times = self.times(method)
        assert len(times) == 3
        slack = accuracy if method is FINE else accuracy + 0.02  # fixed steps: the node after the crossing
        assert np.abs(times - np.pi * np.array([0.5, 1.5, 2.5])).max() <= 2.0 * slack
        assert np.abs(result.y_events[0][:, 0]).max() <= slack

    @every_method
    @pytest.mark.parametrize(("direction", "which"), [(-1, [0, 2]), (1, [1]), (0, [0, 1, 2]), (-3.5, [0, 2])])
    def test_direction(self, method, direction, which):
        _, times = self.times(method, direction=direction)
        assert len(times) == len(which)
        assert np.abs(times - np.pi * np.array([0.5, 1.5, 2.5])[which]).max() <= 0.06

    @every_method
    def test_terminal(self, method):
        result, times = self.times(method, terminal=True, direction=1)
        assert (result.status, result.success, result.message) == (1, True, "A terminal event occurred.")
        assert result.t[-1] == times[0] == pytest.approx(1.5 * math.pi, abs=0.06)
        assert len(times) == 1
        np.testing.assert_array_equal(result.y[:, -1], result.y_events[0][0])

    @every_method
    def test_terminal_with_times_asked_for(self, method):
        t = np.linspace(0.0, 10.0, 101)
        result = self.CASE.solve(method, events=marked(lambda t, y: y[0], terminal=True), t_eval=t, dense_output=True)
        np.testing.assert_array_equal(result.t, t[t <= result.t_events[0][0]])
        assert result.sol.t_max == result.t_events[0][0]

    @every_method
    def test_terminal_with_jump(self, method):
        """The last state is the one after the jump."""
        result = self.CASE.solve(method, events=marked(lambda t, y: y[0], terminal=True, jump=lambda t, y: y + 7.0), dense_output=True)
        assert result.status == 1
        assert result.y[0, -1] == pytest.approx(7.0, abs=0.05)
        np.testing.assert_array_equal(result.sol(result.t[-1]), result.y[:, -1])

    @pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
    def test_several_events_in_one_step(self, rtol):
        """Twenty levels of cos t between 0.05 and 0.95, fewer steps than that: each time found, in the order of the list."""
        levels = np.linspace(0.05, 0.95, 20)
        events = [marked(lambda t, y, level=level: y[0] - level, direction=-1) for level in levels]
        result = smooth(1.0, 0.6, 2.0).solve(basset.Collocation(rtol=rtol), events=events)
        if rtol == 1e-9:
            assert result.nsteps < 20
        for level, times in zip(levels, result.t_events, strict=True):
            assert times == pytest.approx([math.acos(level)], abs=max(100.0 * rtol, 1e-12))

    def test_events_after_the_terminal_one_do_not_happen(self):
        events = [marked(lambda t, y: t - 1.0, terminal=True), lambda t, y: t - 1.0 - 1e-6, lambda t, y: t - 1.0 + 1e-6]
        result = self.CASE.solve(FINE, events=events)
        assert [len(times) for times in result.t_events] == [1, 0, 1]

    def test_events_after_a_jump_see_the_state_after_it(self):
        """The jump lifts cos t above the level that it would have crossed within the same step."""
        events = [marked(lambda t, y: t - 1.0, jump=lambda t, y: y + 100.0), lambda t, y: y[0] - 0.5]
        result = self.CASE.solve(basset.Collocation(rtol=1e-6), events=events)
        assert len(result.t_events[0]) == 1
        after = [time for time in result.t_events[1] if time < 1.5]
        assert after == []  # acos 0.5 = 1.047

    def test_an_event_of_the_rate_or_of_two_components(self):
        result = coupled(6.0).solve(FINE, events=lambda t, y: y[0] - y[2])
        np.testing.assert_allclose(result.t_events[0], [math.pi / 4.0, 5.0 * math.pi / 4.0], atol=1e-8)

    @every_method
    def test_events_that_never_happen_change_nothing(self, method):
        plain, watched = self.CASE.solve(method), self.CASE.solve(method, events=[lambda t, y: y[0] + 5.0, lambda t, y: -1.0])
        np.testing.assert_allclose(watched.y, plain.y, rtol=0.0, atol=1e-12)  # the loop may be another execution: rounding

    def test_recorded_events_do_not_change_the_steps(self):
        plain, watched = self.CASE.solve(FINE), self.CASE.solve(FINE, events=lambda t, y: y[0])
        np.testing.assert_allclose(watched.t, plain.t, rtol=1e-13)
        np.testing.assert_allclose(watched.y, plain.y, rtol=0.0, atol=1e-12)  # the loop may be another execution: rounding


class TestInvariances:
    """To rounding where the arithmetic is the same up to order or scale, to the tolerance where steps may differ."""

    @every_method
    @pytest.mark.parametrize("factor", [2.0**20, 2.0**-20, -1.0])
    def test_linear_equations_scale(self, method, factor):
        def solved(start: float) -> float:
            scaled = basset.Collocation(rtol=1e-8, atol=1e-11 * abs(start)) if method is FINE else method
            return basset.solve(decay, (0.0, 4.0), [start], coefficient=0.6, method=scaled).y[0, -1]

        assert solved(factor) == pytest.approx(factor * solved(1.0), rel=1e-7)

    @every_method
    @pytest.mark.parametrize("shift", [-3.0, 100.0])
    def test_time_has_no_origin(self, method, shift):
        def fun(t, y):
            return np.cos(t - shift) - y

        kick = marked(lambda t, y: t - shift - 1.0, jump=lambda t, y: y - 1.0)
        moved = basset.solve(fun, (shift, shift + 4.0), [1.0], coefficient=0.6, events=kick, method=method)
        if method is FINE:  # cos and the kick, by superposition
            exact = reference.oscillating_stream(4.0, 1.0, 0.6, 1.0, 1.0, 1.0) - reference.response(3.0, 1.0, 0.6)
            assert moved.y[0, -1] == pytest.approx(float(exact), abs=1e-8)
        still = basset.solve(
            lambda t, y: np.cos(t) - y, (0.0, 4.0), [1.0], coefficient=0.6, events=marked(lambda t, y: t - 1.0, jump=lambda t, y: y - 1.0), method=method
        )
        if method is FINE or np.isclose(moved.t_events[0][0] - shift, still.t_events[0][0]):  # rounding may move the snap by a node
            assert moved.y[0, -1] == pytest.approx(still.y[0, -1], abs=1e-8)

    @pytest.mark.parametrize("factor", [1e-6, 1e6])
    def test_time_has_no_unit(self, factor):
        """t → st, λ → λ/s, c → c/√s."""
        one = basset.solve(decay, (0.0, 4.0), [1.0], coefficient=0.6, method=FINE)
        other = basset.solve(lambda t, y: -y / factor, (0.0, 4.0 * factor), [1.0], coefficient=0.6 / math.sqrt(factor), method=FINE)
        assert other.y[0, -1] == pytest.approx(one.y[0, -1], abs=1e-8)
        assert abs(other.nsteps - one.nsteps) <= 2

    @every_method
    def test_the_order_of_components_does_not_matter(self, method):
        case = coupled(4.0)
        order = np.array([2, 0, 1])  # new component k is old component order[k]
        back = np.argsort(order)

        def fun(t, y):
            return np.asarray(case.fun(t, y[back]))[order]

        plain = case.solve(method)
        options = {"coefficient": [2.0, 0.6], "memory": [0, 1], "initial_slip": [0.0, 0.0]}
        other = basset.solve(fun, (0.0, 4.0), np.asarray(case.y0)[order], method=method, **options)
        np.testing.assert_allclose(other.y[:, -1], plain.y[order, -1], rtol=0.0, atol=1e-8)
        swapped = case.solve(method, coefficient=[2.0, 0.6], memory=[2, 0])
        np.testing.assert_allclose(swapped.y[:, -1], plain.y[:, -1], rtol=0.0, atol=1e-8)

    @every_method
    def test_decoupled_components_together_as_alone(self, method):
        rates, c, start = np.array([1.0, 5.0, 0.2]), np.array([0.6, 0.1, 3.0]), np.array([1.0, -2.0, 0.5])
        together = basset.solve(lambda t, y: -rates * y, (0.0, 4.0), start, [0, 1, 2], c, method=method).y[:, -1]
        alone = [basset.solve(lambda t, y, k=k: -rates[k] * y, (0.0, 4.0), start[[k]], [0], c[[k]], method=method).y[0, -1] for k in range(3)]
        np.testing.assert_allclose(together, alone, rtol=0.0, atol=2e-8)

    def test_superposition(self):
        """Three drives and their sum."""
        drives = [np.cos, lambda t: t * (4.0 - t), lambda t: np.exp(-t)]

        def solved(drive, start: float) -> float:
            return basset.solve(lambda t, y: drive(t) - y, (0.0, 4.0), [start], coefficient=0.6, method=FINE).y[0, -1]

        parts = [solved(drive, start) for drive, start in zip(drives, (1.0, -2.0, 0.0), strict=True)]
        assert solved(lambda t: sum(drive(t) for drive in drives), -1.0) == pytest.approx(sum(parts), abs=3e-8)

    def test_stopping_and_asking_in_between_are_the_same(self):
        long = basset.solve(decay, (0.0, 4.0), [1.0], coefficient=0.6, method=FINE, dense_output=True)
        for end in (0.5, 2.0):
            assert basset.solve(decay, (0.0, end), [1.0], coefficient=0.6, method=FINE).y[0, -1] == pytest.approx(long.sol(end)[0], abs=1e-8)


BAD = {
    "fun is no function": ({"fun": 3.0}, TypeError, "fun must be callable"),
    "t_span reversed": ({"t_span": (1.0, 0.0)}, ValueError, r"t_span must rise, got \(1, 0\)"),
    "t_span empty": ({"t_span": (1.0, 1.0)}, ValueError, "t_span must rise"),
    "t_span NaN": ({"t_span": (0.0, NAN)}, ValueError, r"t_span\[1\] must be a finite number, got nan"),
    "t_span infinite": ({"t_span": (0.0, INF)}, ValueError, r"t_span\[1\] must be a finite number, got inf"),
    "t_span of three": ({"t_span": (0.0, 1.0, 2.0)}, (TypeError, ValueError), r"t_span must be a pair .*\(0\.0, 1\.0, 2\.0\)"),
    "t_span a number": ({"t_span": 4.0}, TypeError, "t_span must be a pair"),
    "t_span strings": ({"t_span": ("a", "b")}, TypeError, r"t_span\[0\] must be a finite number"),
    "y0 of three dimensions": ({"y0": [[[1.0, 2.0]]]}, ValueError, r"y0 must be one-dimensional .*got shape \(1, 1, 2\)"),
    "y0 empty": ({"y0": []}, ValueError, "y0 must be one-dimensional with at least one state"),
    "y0 NaN": ({"y0": [1.0, NAN]}, ValueError, "y0 must be finite"),
    "y0 strings": ({"y0": ["a", "b"]}, TypeError, "y0 must be"),
    "y0 complex": ({"y0": [1.0, 2.0j]}, TypeError, "y0 must be"),
    "y0 none": ({"y0": None}, (TypeError, ValueError), "y0 must be"),
    "memory out of range": ({"memory": [2]}, ValueError, "memory must be a whole number from 0 to 1, got 2"),
    "memory negative": ({"memory": [-1]}, ValueError, "memory must be a whole number from 0 to 1, got -1"),
    "memory twice": ({"memory": [1, 1]}, ValueError, r"memory must name each component once, got \[1, 1\]"),
    "memory a float": ({"memory": [0.0]}, (TypeError, ValueError), r"memory must be a whole number .*got 0\.0"),
    "memory a string": ({"memory": "ab"}, TypeError, "memory must be"),
    "memory none": ({"memory": None}, TypeError, "memory must be"),
    "memory a bare float": ({"memory": 1.5}, (TypeError, ValueError), "memory must be"),
    "coefficient negative": ({"coefficient": -0.1}, ValueError, "coefficient must be finite and 0 or greater"),
    "coefficient NaN": ({"coefficient": NAN}, ValueError, "coefficient must be finite"),
    "coefficient infinite": ({"coefficient": INF}, ValueError, "coefficient must be finite"),
    "coefficients too many": ({"coefficient": [1.0, 2.0]}, ValueError, "coefficient must be a number or have one entry per component"),
    "coefficient a string": ({"coefficient": "big"}, TypeError, "coefficient must be"),
    "kernel is no kernel": ({"kernel": "basset"}, TypeError, "kernel must be a kernel such as"),
    "kernel a class": ({"kernel": basset.BassetKernel}, TypeError, "kernel must be a kernel such as"),
    "initial_slip too long": ({"initial_slip": [1.0, 2.0]}, ValueError, "initial_slip must hold 1 finite number"),
    "initial_slip NaN": ({"initial_slip": [NAN]}, ValueError, "initial_slip must hold 1 finite number"),
    "initial_slip a string": ({"initial_slip": "rest"}, TypeError, "initial_slip must"),
    "args a list": ({"args": [1.0]}, TypeError, r"args must be a tuple, got \[1\.0\]"),
    "args a number": ({"args": 1.0}, TypeError, "args must be a tuple"),
    "method a string": ({"method": "collocation"}, TypeError, "method must be a method such as"),
    "method a rule": ({"method": basset.Daitche(order=2)}, TypeError, "method must be a method such as"),
    "method a class": ({"method": basset.Collocation}, TypeError, "method must be a method such as"),
    "t_eval outside": ({"t_eval": [0.0, 5.0]}, ValueError, r"t_eval must be rising times within t_span \(0, 4\)"),
    "t_eval before": ({"t_eval": [-1e-9, 1.0]}, ValueError, "t_eval must be rising times"),
    "t_eval falling": ({"t_eval": [1.0, 0.5]}, ValueError, "t_eval must be rising times"),
    "t_eval NaN": ({"t_eval": [0.0, NAN, 1.0]}, ValueError, "t_eval must be rising times"),
    "t_eval a number": ({"t_eval": 1.0}, ValueError, "t_eval must be rising times"),
    "events a number": ({"events": 1.0}, TypeError, "events must be"),
    "events with a number": ({"events": [lambda t, y: 1.0, 2.0]}, TypeError, r"events must be callables .*got 2\.0"),
    "jump is no function": ({"events": marked(lambda t, y: t - 1.0, jump=0.8)}, TypeError, r"jump of event 0 must be callable .*got 0\.8"),
    "direction a word": ({"events": marked(lambda t, y: t - 1.0, direction="down")}, (TypeError, ValueError), "direction"),
    "max_steps zero": ({"max_steps": 0}, ValueError, "max_steps must be a whole number, 1 or greater, got 0"),
    "max_steps a float": ({"max_steps": 10.0}, (TypeError, ValueError), "max_steps must be a whole number"),
}


class TestBadInput:
    @each("name", BAD)
    def test_refused(self, name):
        changes, error, pattern = BAD[name]
        refused(error, pattern, basset.solve, **({"fun": decay, "t_span": (0.0, 4.0), "y0": [1.0, 1.0]} | changes))

    @every_method
    @each("rates", [[1.0], [1.0, 2.0, 3.0], 1.0, [[1.0, 2.0]], None])
    def test_fun_of_the_wrong_shape(self, method, rates):
        refused((TypeError, ValueError), "fun must return 2 rates", basset.solve, lambda t, y: rates, (0.0, 4.0), [1.0, 1.0], method=method)

    @every_method
    @each("after", [[1.0], 1.0, [[1.0, 2.0]], [1.0, 2.0, 3.0], None])
    def test_a_jump_of_the_wrong_shape(self, method, after):
        kick = marked(lambda t, y: t - 1.0, jump=lambda t, y: after)
        refused((TypeError, ValueError), "jump of event 0 must return 2 states", basset.solve, decay, (0.0, 4.0), [1.0, 1.0], events=kick, method=method)

    @each("after", ["ab", ["a", "b"], [1.0, "b"]])
    def test_fun_and_jump_that_return_words(self, after):
        refused((TypeError, ValueError), "fun must return", basset.solve, lambda t, y: after, (0.0, 4.0), [1.0, 1.0])
        kick = marked(lambda t, y: t - 1.0, jump=lambda t, y: after)
        refused((TypeError, ValueError), "jump of event 0 must return", basset.solve, decay, (0.0, 4.0), [1.0, 1.0], events=kick)

    @each("value", ["high", None, [1.0, 2.0]])
    def test_an_event_that_returns_no_number(self, value):
        refused((TypeError, ValueError), "event 0 must return", basset.solve, decay, (0.0, 4.0), [1.0, 1.0], events=lambda t, y: value)

    def test_errors_of_fun_are_its_own(self):
        def fun(t, y):
            raise KeyError("mine")

        with pytest.raises(KeyError, match="mine"):
            basset.solve(fun, (0.0, 1.0), [1.0])

    @each("value", [0.0, -1e-6, 0.2, 1e-13, NAN, INF, "small", None, True])
    def test_rtol(self, value):
        refused((TypeError, ValueError), "rtol must be", basset.Collocation, rtol=value)

    @each("value", [-1e-9, NAN, INF, "small"])
    def test_atol(self, value):
        refused((TypeError, ValueError), "atol must be", basset.Collocation, atol=value)

    @each("value", [1, 15, 0, -2, 3.0, "five", True])
    def test_stages(self, value):
        refused((TypeError, ValueError), "stages must be a whole number from 2 to 14", basset.Collocation, stages=value)

    @each("value", [0.0, -1.0, NAN, INF, "long"])
    def test_max_step(self, value):
        refused((TypeError, ValueError), "max_step must be", basset.Collocation, max_step=value)

    @each("method", [basset.FixedStep, basset.RungeKutta4])
    @each("value", [0.0, -0.1, NAN, INF, "short", None])
    def test_dt(self, method, value):
        refused((TypeError, ValueError), "dt must be", method, value)

    @each("method", [basset.FixedStep, basset.RungeKutta4])
    @each("word, nearest", [("daitch", "daitche"), ("euler", "euler_maclaurin"), ("Brush", "brush")])
    def test_unknown_rules(self, method, word, nearest):
        refused(ValueError, f"did you mean '{nearest}'", method, 0.1, word)

    @each("method", [basset.FixedStep, basset.RungeKutta4])
    @each("rule", [3, None, basset.Daitche])
    def test_rules_that_are_none(self, method, rule):
        refused(TypeError, "rule", method, 0.1, rule)

    def test_input(self):
        refused(ValueError, "input must be one of 'rate', 'slip', got 'slips'; did you mean 'slip'", basset.FixedStep, 0.1, basset.Daitche(order=2), "slips")
        for rule in (basset.SemiDerivative(), basset.EulerMaclaurin(), basset.Brush()):
            refused(ValueError, "rule must be a product rule", basset.FixedStep, 0.1, rule, "slip")

    @each("rule", [basset.SemiDerivative(), basset.Hinsberg(window=1.0)])
    def test_rules_for_the_basset_kernel_only(self, rule):
        kernel = basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)
        refused((TypeError, ValueError), "kernel", basset.solve, decay, (0.0, 4.0), [1.0], kernel=kernel, method=basset.FixedStep(0.1, rule))

    @each("name", ["relaxing", "coupled"])
    def test_methods_compare_by_value_and_are_frozen(self, name):
        method = basset.Collocation(rtol=1e-4)
        assert method == basset.Collocation(rtol=1e-4)
        with pytest.raises(AttributeError):
            method.rtol = 1.0
        assert CASES[name].error(method) <= 1e-3
