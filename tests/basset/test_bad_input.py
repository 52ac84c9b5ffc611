"""Bad input, one by one: the right type of error, and one sentence that names the argument, what came and what would be right."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray
from all_cases import each
from rule_cases import ANY, KERNELS, refused

import basset
from basset.quadrature import full_history

G = np.ones(5)
RULE = basset.Daitche(order=3)
NAN, INF = float("nan"), float("inf")
MEI = basset.MeiAdrianKernel

both = each("function", [basset.integrate, basset.cumulate])


SAMPLES = {
    "string": ("abc", TypeError, r"g must be an array of real numbers, got 'abc'"),
    "strings": (["1", "2"], TypeError, r"g must be an array of real numbers, got \['1', '2'\]"),
    "bytes": (b"123", TypeError, r"g must be an array of real numbers, got b'123'"),
    "strings as objects": (np.array(["1", "2"], dtype=object), TypeError, r"g must be an array of real numbers, got .*'1'"),
    "ragged": ([[1.0, 2.0], [3.0]], TypeError, r"g must be an array of real numbers with equal rows, got \[\[1\.0, 2\.0\], \[3\.0\]\]"),
    "complex": ([1.0, 2.0j], TypeError, r"g must be an array of real numbers, got \[1\.0, 2j\].*complex"),
    "bool": ([True, False, True], TypeError, r"g must be an array of real numbers, got \[True, False, True\].*bool"),
    "bools as objects": (np.array([True, False], dtype=object), TypeError, r"g must be an array of real numbers, got .*True"),
    "dates": (np.array(["2000-01-01", "2000-01-02"], dtype="M8[D]"), TypeError, r"g must be an array of real numbers, got .*datetime64"),
    "records": (np.zeros(3, dtype=[("u", float)]), TypeError, r"g must be an array of real numbers"),
    "none": (None, (TypeError, ValueError), r"g must be an array of .*got None"),
    "mapping": ({"a": 1.0}, TypeError, r"g must be an array of real numbers.*got \{'a': 1\.0\}"),
    "function": (np.cos, TypeError, r"g must be an array of real numbers.*got <ufunc 'cos'>"),
    "one number": (3.5, ValueError, r"g must be an array of samples along its first axis, got the single number 3\.5"),
    "beyond double": ([1.0, 10**400], (TypeError, ValueError), r"g must be .*got"),
    "NaN": ([1.0, NAN, 2.0, NAN], ValueError, r"g must be finite, got nan in sample 1 \(and 1 other"),
    "infinite": ([1.0, 2.0, -INF], ValueError, r"g must be finite, got -inf in sample 2"),
    "NaN in a column": (np.array([[1.0, 2.0], [3.0, NAN], [1.0, 1.0]]), ValueError, r"g must be finite, got nan in sample 1"),
    "None in a list": ([1.0, None, 2.0], (TypeError, ValueError), r"g must be .*got"),
}


class TestSamples:
    @both
    @each("name", SAMPLES)
    def test_refused(self, function, name):
        g, error, pattern = SAMPLES[name]
        refused(error, pattern, function, g, 0.1, RULE)

    @each("g", [[], np.empty(0), np.empty((0, 3)), [1.0], np.ones((1, 3))])
    def test_integrate_needs_a_step(self, g):
        refused(ValueError, rf"g must hold at least two samples \(one step\) along its first axis, got {len(g)}", basset.integrate, g, 0.1, RULE)

    @each("g", [[], np.empty(0), np.empty((0, 3))])
    def test_cumulate_needs_a_sample(self, g):
        refused(ValueError, r"g must hold at least one sample along its first axis, got 0", basset.cumulate, g, 0.1, RULE)

    @both
    @each("name", ANY)
    def test_nan_reaches_no_result(self, function, name):
        g = np.ones(40)
        g[38] = NAN
        refused(ValueError, r"g must be finite, got nan in sample 38", function, g, 0.1, ANY[name](1.0))

    @both
    def test_an_overflowing_sum_is_said_to_be_one(self, function):
        refused(ValueError, r"g must be small enough .* double precision, got samples up to 1e\+308", function, np.full(5, 1e308), 1e5, RULE)


NUMBERS = {
    "zero": (0.0, ValueError, "0"),
    "negative": (-0.1, ValueError, r"-0\.1"),
    "NaN": (NAN, ValueError, "nan"),
    "infinite": (INF, ValueError, "inf"),
    "string": ("0.1", TypeError, r"'0\.1'"),
    "none": (None, TypeError, "None"),
    "bool": (True, TypeError, "True"),
    "complex": (0.1 + 0j, TypeError, r"\(0\.1\+0j\)"),
    "list": ([0.1], TypeError, r"\[0\.1\]"),
}
bad_numbers = each("value, error, shown", NUMBERS.values())


class TestStep:
    @both
    @bad_numbers
    def test_refused(self, function, value, error, shown):
        refused(error, rf"dt must be a finite number greater than 0 \(seconds\), got {shown}", function, G, value, RULE)

    @bad_numbers
    def test_refused_by_weights(self, value, error, shown):
        refused(error, rf"dt must be a finite number greater than 0 \(seconds\), got {shown}", RULE.weights, 5, value)


class TestCounts:
    @each("order, error", [(0, ValueError), (11, ValueError), (-1, ValueError), (2.5, ValueError), (3.0, ValueError), (NAN, ValueError)])
    def test_order_out_of_range(self, order, error):
        refused(error, rf"order must be a whole number from 1 to 10, got {order}", basset.Daitche, order=order)

    @each("order", [True, "3", None, [3], 3 + 0j])
    def test_order_of_the_wrong_type(self, order):
        with pytest.raises(TypeError, match=r"order must be a whole number from 1 to 10, got ") as caught:
            basset.Daitche(order=order)
        assert str(caught.value).endswith(repr(order))

    def test_any_integer_is_an_order(self):
        assert basset.Daitche(order=np.int8(3)) == basset.Daitche(order=3)

    @each("n, error", [(0, ValueError), (-3, ValueError), (2.5, ValueError), (True, TypeError), ("5", TypeError), (None, TypeError)])
    def test_number_of_weights(self, n, error):
        refused(error, rf"n must be a whole number, 1 or greater, got {n!r}", RULE.weights, n, 0.1)


class TestRule:
    @both
    @each("name, near", [("daich", "daitche"), ("Brush", "brush"), ("semiderivative", "semi_derivative"), ("euler", "euler_maclaurin")])
    def test_unknown_name(self, function, name, near):
        refused(ValueError, rf"scheme must be one of .*'daitche'.*, got '{name}'; did you mean '{near}'\?", function, G, 0.1, name)

    def test_unknown_name_in_the_table(self):
        with pytest.raises(basset.UnknownSchemeError, match=r"got 'hinsburg'; did you mean 'hinsberg'\?") as caught:
            basset.SCHEMES["hinsburg"]
        assert isinstance(caught.value, ValueError)
        assert isinstance(caught.value, KeyError)
        assert "hinsburg" not in basset.SCHEMES
        assert basset.SCHEMES.get("hinsburg") is None

    def test_no_suggestion_where_nothing_is_near(self):
        with pytest.raises(ValueError, match=r"got 'xyzzy'$"):
            basset.integrate(G, 0.1, "xyzzy")

    @each("name", [3, None])
    def test_a_name_is_a_string(self, name):
        refused(TypeError, rf"named by a string, got {name}", basset.SCHEMES.__getitem__, name)

    @both
    def test_class_instead_of_instance(self, function):
        refused(
            TypeError, r"rule must be a rule such as basset\.Daitche\(order=3\), got <class .*Brush'>; write Brush\(\.\.\.\)", function, G, 0.1, basset.Brush
        )

    @both
    @each("rule", [None, 3, [1.0, 2.0], basset.BassetKernel()])
    def test_no_rule_at_all(self, function, rule):
        refused(TypeError, r"rule must be a rule such as basset\.Daitche\(order=3\), got ", function, G, 0.1, rule)

    @both
    def test_a_name_whose_scheme_needs_parameters(self, function):
        refused(TypeError, r"rule 'windowed' needs parameters: pass basset\.Windowed\(\.\.\.\) instead", function, G, 0.1, "windowed")


WINDOWED = {"windowed": lambda window: basset.Windowed(RULE, window), "hinsberg": lambda window: basset.Hinsberg(window=window, tail=False)}
both_windows = each("make", WINDOWED.values())


class TestWindow:
    @both_windows
    @bad_numbers
    def test_refused(self, make, value, error, shown):
        if value is None and make is WINDOWED["hinsberg"]:
            assert make(None) == basset.Hinsberg(tail=False)  # the whole history
            return
        refused(error, rf"window must be a finite number greater than 0 \(seconds\), got {shown}", make, value)

    @both
    @both_windows
    @each("window", [0.05, 0.0999])
    def test_shorter_than_a_step(self, function, make, window):
        refused(ValueError, rf"window must be at least one step of dt = 0\.1 seconds, got {window}", function, G, 0.1, make(window))
        refused(ValueError, rf"window must be at least one step of dt = 0\.1 seconds, got {window}", make(window).weights, 5, 0.1)

    @each("rule", [basset.Daitche, "daitche", None, 3, basset.Windowed(RULE, 1.0), basset.Hinsberg(tail=False)])
    def test_of_what_is_no_full_rule(self, rule):
        refused(TypeError, r"rule must be a full-history rule such as basset\.Daitche\(order=2\), got ", basset.Windowed, rule, 1.0)

    @each("name", basset.SCHEMES)
    def test_names_of_full_rules_are_those_that_a_window_takes(self, name):
        if name in full_history():
            assert basset.Windowed(basset.SCHEMES[name](), 1.0).rule.name == name
        elif name != "windowed":
            refused(TypeError, "rule must be a full-history rule", basset.Windowed, basset.SCHEMES[name](), 1.0)


class TestKernelArgument:
    @both
    @each("kernel", [None, "basset", basset.BassetKernel, np.sqrt, 3.0])
    def test_no_kernel(self, function, kernel):
        refused(TypeError, r"kernel must be a kernel such as basset\.BassetKernel\(\), got ", function, G, 0.1, RULE, kernel)
        refused(TypeError, r"kernel must be a kernel such as basset\.BassetKernel\(\), got ", RULE.weights, 5, 0.1, kernel)


class TestInput:
    @both
    def test_unknown(self, function):
        refused(ValueError, r"input must be one of 'rate', 'slip', got 'slipp'; did you mean 'slip'\?", function, G, 0.1, RULE, input="slipp")

    @both
    @each("input", [None, 1, True, ["rate"]])
    def test_no_string(self, function, input):
        refused(TypeError, r"input must be one of 'rate', 'slip', got ", function, G, 0.1, RULE, input=input)

    @both
    @each("rule", [basset.EulerMaclaurin(), basset.Brush(), basset.Windowed(basset.Brush(), 1.0)])
    def test_a_rule_without_that_form(self, function, rule):
        refused(ValueError, r"input must be 'rate' for \w+, got 'slip': .*rate df/dt only", function, G, 0.1, rule, input="slip")


class TestInitialSlip:
    @both
    @each("shape, slip", [((), [1.0]), ((), [1.0, 2.0]), ((3,), [1.0, 2.0]), ((3,), np.ones((1, 3))), ((2, 3), np.ones(3)), ((2, 3), np.ones((3, 2)))])
    def test_wrong_shape(self, function, shape, slip):
        came = str(np.shape(slip)).replace("(", r"\(").replace(")", r"\)")
        refused(
            ValueError,
            rf"initial_slip must be a number or have the shape .* of one sample, got shape {came}",
            function,
            np.ones((5, *shape)),
            0.1,
            RULE,
            initial_slip=slip,
        )

    @both
    @each("slip", [NAN, INF, -INF])
    def test_not_finite(self, function, slip):
        refused(ValueError, rf"initial_slip must be finite, got {slip}", function, G, 0.1, RULE, initial_slip=slip)

    @both
    def test_not_finite_in_a_column(self, function):
        refused(ValueError, r"initial_slip must be finite, got \[1\.0, nan\]", function, np.ones((5, 2)), 0.1, RULE, initial_slip=[1.0, NAN])

    @both
    @each("slip", ["1.0", 1j, True, [[1.0], [2.0, 3.0]]])
    def test_no_numbers(self, function, slip):
        refused(TypeError, r"initial_slip must be an array of real numbers.*, got ", function, G, 0.1, RULE, initial_slip=slip)

    @both
    def test_together_with_slip_samples(self, function):
        refused(
            ValueError,
            r"initial_slip must be left at 0 with input='slip', where the first sample is the initial slip; got 2\.0",
            function,
            G,
            0.1,
            RULE,
            initial_slip=2.0,
            input="slip",
        )


class TestKernelParameters:
    @each("parameter", ["slip", "diameter", "viscosity", "c1", "c2"])
    @each("value", [-1e-3, NAN, INF, -INF])
    def test_negative_or_not_finite(self, parameter, value):
        good = {"slip": 0.1, "diameter": 1e-3, "viscosity": 1e-6}
        shown = str(value) if np.isnan(value) or np.isinf(value) else r"-0\.001"
        refused(ValueError, rf"{parameter} must be a finite number.*, got {shown}", MEI, **{**good, parameter: value})

    @each("parameter", ["diameter", "viscosity", "c1"])
    def test_zero_where_it_is_divided_by(self, parameter):
        good = {"slip": 0.1, "diameter": 1e-3, "viscosity": 1e-6}
        refused(ValueError, rf"{parameter} must be a finite number greater than 0.*, got 0", MEI, **{**good, parameter: 0.0})

    @each("value", ["0.1", None, True, [0.1], 1j])
    def test_no_number(self, value):
        refused(TypeError, r"slip must be a finite number, 0 or greater \(m/s\), got ", MEI, value, 1e-3, 1e-6)
        refused(TypeError, r"viscosity must be a finite number greater than 0 \(m²/s\), got ", MEI.dorgan_loth, 0.1, 1e-3, value)

    def test_exponent_below_range(self):
        refused(ValueError, r"c1 must be 0\.5 or greater .*, got 0\.4", MEI, 0.1, 1e-3, 1e-6, c1=0.4)

    def test_overflowing_steepness(self):
        refused(ValueError, r"slip, diameter and viscosity must give a finite kernel coefficient C, got C = inf from slip 1e\+150", MEI, 1e150, 1e-300, 1e-6)


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
class TestKernelValues:
    @each("s, shown", [(-1.0, "-1"), ([1.0, -2.5], r"-2\.5"), (NAN, "nan"), ([0.0, NAN], "nan"), (-INF, "-inf")])
    def test_negative_or_nan_lag(self, kernel, s, shown):
        refused(ValueError, rf"s must hold lags of 0 or greater \(seconds\), got {shown}", kernel, s)

    @each("s", ["1.0", None, 1j, True, [[1.0], [2.0, 3.0]], ["a"]])
    def test_no_numbers(self, kernel, s):
        refused(TypeError, r"s must be an array of real lags in seconds, got ", kernel, s)

    @each("near, far", [(1.0, 1.0), (2.0, 1.0)])
    def test_empty_interval(self, kernel, near, far):
        refused(ValueError, rf"far must be greater than near = {near:g} \(seconds\), got {far:g}", kernel.moments, near, far, 2)

    def test_bad_interval_ends(self, kernel):
        refused(ValueError, r"near must be a finite number, 0 or greater \(seconds\), got -1", kernel.moments, -1.0, 1.0, 2)
        refused(ValueError, r"far must be a finite number greater than 0 \(seconds\), got inf", kernel.moments, 0.0, INF, 2)

    @each("degree, error", [(-1, ValueError), (16, ValueError), (2.5, ValueError), (True, TypeError), ("2", TypeError)])
    def test_degree_out_of_range(self, kernel, degree, error):
        refused(error, rf"degree must be a whole number from 0 to 15, got {degree!r}", kernel.moments, 0.0, 1.0, degree)


@both
@each("name", ANY)
def test_refusing_leaves_everything_as_it_was(function, name):
    """After bad calls a good call gives the same bits as before."""
    rule, g = ANY[name](2.0), np.random.default_rng(1).standard_normal(60)
    kept = g.copy()
    before = function(g, 0.1, rule)
    for bad in (np.full(60, NAN), ["a"], []):
        with pytest.raises((ValueError, TypeError)):
            function(bad, 0.1, rule)
    assert np.array_equal(function(g, 0.1, rule), before)
    assert np.array_equal(g, kept)


MASKED = np.ma.masked_array([1.0, 2.0, 4.0, 8.0, 1.0], mask=[False, False, True, False, True])
MISSING = {
    "vector": (MASKED, "2 of 5 masked, the first in row 2"),
    "integers": (np.ma.masked_equal([1, 2, 3, 0, 5], 0), "1 of 5 masked, the first in row 3"),
    "a column": (np.ma.masked_greater(np.arange(10.0).reshape(5, 2), 8.5), "1 of 10 masked, the first in row 4"),
    "wholly masked": (np.ma.masked_all(5), "5 of 5 masked, the first in row 0"),
    "a list of rows": ([np.ma.masked_array([1.0, 2.0], mask=[row == 3, False]) for row in range(5)], "1 of 2 masked"),
    "a list with the constant": ([1.0, 2.0, np.ma.masked, 4.0, 5.0], "a masked one"),
    "nested lists": ([[1.0, 2.0], [3.0, np.ma.masked], [5.0, 6.0]], "a masked one"),
    "objects": (np.array([1.0, np.ma.masked, 3.0], dtype=object), "a masked one"),
    "pandas with NA": (pd.DataFrame({"u": pd.array([1.0, None, 3.0], dtype="Float64"), "v": [1, 2, 3]}), "<NA>"),
}


@both
@each("name", MISSING)
def test_missing_samples_are_refused_and_what_to_do_is_said(function, name):
    g, which = MISSING[name]
    refused(ValueError, rf"g must have no missing values, got .*{which}.*: fill the gaps.* or take an interval", function, g, 0.1, RULE)


@both
@each(
    "g",
    [
        pd.Series([1.0, NAN, 2.0, 3.0]),
        pd.Series([1.0, None, 2.0, 3.0], dtype="Float64"),
        xarray.DataArray([1.0, NAN, 2.0, 3.0], dims="t"),
        pd.DataFrame({"u": [1.0, NAN, 2.0], "v": 1.0}),
    ],
)
def test_labelled_samples_with_nan_are_refused(function, g):
    refused(ValueError, r"g must be finite, got nan in sample 1 \(and 0 other samples\): fill the gaps", function, g, 0.1, RULE)


@both
def test_a_mask_that_hides_nothing_is_none(function):
    g = np.cos(np.arange(9.0))
    expected = function(g, 0.1, RULE)
    for given in (np.ma.masked_array(g), np.ma.masked_array(g, mask=np.zeros(9, bool)), list(np.ma.masked_array(g)), pd.Series(g, dtype="Float64")):
        np.testing.assert_array_equal(function(given, 0.1, RULE), expected)


MASKED_NUMBER = np.ma.masked_array(3.0, mask=True)


def test_no_door_takes_what_lies_under_a_mask():
    """Else the history of one masked entry would be that of the number below it."""
    plan = RULE.plan(0.1, 10.0)
    state, pair = plan.start(), plan.start(2)
    plan.push(state, 1.0)
    plan.push(pair, [1.0, 1.0])
    kernel = basset.BassetKernel()
    doors = {
        "initial_slip": lambda: basset.integrate(np.ones((5, 2)), 0.1, RULE, initial_slip=np.ma.masked_array([1.0, 2.0], mask=[True, False])),
        "dt": lambda: basset.integrate(G, np.ma.masked, RULE),
        "G": lambda: plan.run(state, MASKED),
        "g": lambda: plan.push(state, np.ma.masked),
        "delta": lambda: plan.jump(state, np.ma.masked),
        "delta of two": lambda: plan.jump(pair, np.ma.masked_array([1.0, 2.0], mask=[False, True])),
        "age": lambda: plan.jump(state, 1.0, age=MASKED_NUMBER),
        "g after a jump": lambda: plan.jump(state, 1.0, g=MASKED_NUMBER),
        "n": lambda: RULE.weights(np.ma.masked_array(5, mask=True), 0.1),
        "dt of weights": lambda: RULE.weights(5, MASKED_NUMBER),
        "horizon": lambda: RULE.plan(0.1, np.ma.masked),
        "s": lambda: kernel(MASKED),
        "weights": lambda: basset.ExponentialSum(np.ma.masked_less([1.0, 2.0], 1.5), [1.0, 2.0], 0.1, 1.0, kernel),
        "rates": lambda: basset.ExponentialSum([1.0, 2.0], np.ma.masked_less([1.0, 2.0], 1.5), 0.1, 1.0, kernel),
        "samples": lambda: basset.advise(1e-3, samples=np.ma.masked_less(np.cos(np.arange(60.0)), -0.9), sample_step=0.1, duration=1.0),
    }
    before = plan.value(state), plan.tail(state), plan.tail(pair)
    for name, door in doors.items():
        with pytest.raises(ValueError, match=r"must (have no missing values|be a number|be .*), got .*mask.*: fill the gaps") as caught:
            door()
        assert str(caught.value).startswith(name.split()[0]), name
    after = plan.value(state), plan.tail(state), plan.tail(pair)
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


def test_numbers_at_the_ends_of_double_precision():
    """No success without a number, and a solution up to where it left them."""
    for method in (basset.RungeKutta4(0.1), basset.FixedStep(0.1), basset.Collocation()):
        with np.errstate(over="ignore", invalid="ignore"):
            r = basset.solve(lambda t, y: [1e308], (0.0, 4.0), [1.0], coefficient=0.5, method=method)
        assert r.status == -1 and np.isfinite(r.y).all() and len(r.t) == r.y.shape[1]
        with np.errstate(over="ignore", invalid="ignore"):
            assert basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], coefficient=1e308, method=method).status == -1

    def leap(t, y):
        return y[0] - 0.8

    leap.jump = lambda t, y: [np.nan]
    r = basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], coefficient=0.5, events=leap)
    assert r.status == -1 and np.isfinite(r.y).all()
    for span in ((0.0, 5e-324), (0.0, 1e-300), (-1e308, 1e308)):
        refused(ValueError, r"t_span must be 1e-280 s or longer and end - start a finite number", basset.solve, lambda t, y: -y, span, [1.0])
    with pytest.raises(ValueError, match="dt must be 1000 time scales of"):
        _ = basset.advise(1e-3, time_scale=1e-320, dt=0.1, steps=10).best


def test_times_that_overflow_where_they_are_counted():
    g, rule = np.ones(3), basset.Exponential(1, 1e-6)
    for t in ([-1e308, 0.0, 0.5e308], [0.0, 1.0, 1.7e308], [-1.7e308, 0.0, 1.7e308]):
        refused(ValueError, r"t must make a path of 1e\+300 seconds or less, got", basset.cumulate, g, t=t, rule=rule)
    assert basset.integrate(g, t=[0.0, 1.0, 9e299], rule=rule) == pytest.approx(2.0 * 9e299**0.5, rel=1e-6)
    for method in (basset.FixedStep(1e-308), basset.RungeKutta4(1e-10)):
        r = basset.solve(lambda t, y: -y, (0.0, 1e305), [1.0], method=method)
        assert r.status == -1 and "more than max_steps = 1000000 steps" in r.message
    for given, pattern in (
        ({"duration": 1e308}, r"duration must be 1e\+15 time scales of 1 seconds or less, got 1e\+308 seconds"),
        ({"duration": 1e300, "dt": 1e-300}, r"duration must be 1e\+15 steps of 1e-300 seconds or less"),
        ({"steps": 10**400, "dt": 0.1}, r"steps must be a whole number from 1 to 1000000000000000"),
        ({"steps": 10, "dt": 1e5}, r"dt must be 1000 time scales of 1 seconds or less, got 100000"),
    ):
        refused(ValueError, pattern, basset.advise, 1e-3, time_scale=1.0, **given)
    for name in ("particles", "components"):
        refused(ValueError, rf"{name} must be a whole number from 1 to", basset.advise, 1e-3, time_scale=1.0, duration=9.0, **{name: 10**5000})


@each("name", ["y0", "initial_slip", "t_eval", "coefficient"])
def test_solve_takes_nothing_masked(name):
    given = {"y0": [1.0, 2.0], "initial_slip": [1.0, 2.0], "t_eval": [0.5, 0.75], "coefficient": [0.5, 0.5]}
    given[name] = np.ma.masked_array(given[name], mask=[False, True])
    refused(ValueError, rf"{name} must have no missing values, got 1 of 2 masked", basset.solve, lambda t, y: -y, (0.0, 1.0), memory=[0, 1], **given)


def test_a_time_that_is_the_end_but_for_rounding_is_the_end():
    """np.arange(0, 1.1, 0.1) style: beyond the end by an ulp; three ulps at an offset of 1e6."""
    for start, end in ((0.0, 0.3), (1e6, 1e6 + 1.0), (-7.0, -0.7)):
        late = end + 2 * np.spacing(abs(end))
        early = start - np.spacing(abs(start))
        r = basset.solve(lambda t, y: -y, (start, end), [1.0], coefficient=0.5, t_eval=[early, 0.5 * (start + end), late], dense_output=True)
        exact = basset.solve(lambda t, y: -y, (start, end), [1.0], coefficient=0.5, t_eval=[start, 0.5 * (start + end), end])
        np.testing.assert_array_equal(r.t, exact.t)
        np.testing.assert_allclose(r.y, exact.y, rtol=1e-12)
        np.testing.assert_allclose(r.sol(late), exact.y[:, -1], rtol=1e-12)


@each(
    "span, times, shown",
    [
        ((0.0, 1.0), [0.5, 1.0 + 1e-9], r"\(0, 1\), got 1\.000000001"),
        ((0.0, 2.0), [2.00000001], r"\(0, 2\), got 2\.00000001"),
        ((1e-9, 1.0), [0.0, 0.5], r"\(1e-09, 1\), got 0"),
        ((0.1, 0.3), [0.0999999999, 0.2], r"\(0\.1, 0\.3\), got 0\.0999999999"),
    ],
)
def test_what_is_refused_shows_the_digits_that_differ(span, times, shown):
    refused(ValueError, rf"t_eval must be rising times within t_span {shown}$", basset.solve, lambda t, y: -y, span, [1.0], t_eval=times)


def test_two_numbers_of_a_refusal_differ_on_the_page():
    up = np.nextafter(1.0, 2.0)
    refused(ValueError, r"t_span must rise, got \(1\.0000000000000002, 1\)", basset.solve, lambda t, y: -y, (up, 1.0), [1.0])
    refused(ValueError, r"far must be greater than near = 1\.0000000000000002 \(seconds\), got 1$", basset.BassetKernel().moments, up, 1.0, 2)
    refused(ValueError, r"window must be at least one step of dt = 0\.1 seconds, got 0\.099999999$", basset.Windowed(RULE, 0.099999999).weights, 5, 0.1)
    plan = RULE.plan(0.1, 1.0)
    state = plan.start()
    plan.push(state, 1.0)
    refused(ValueError, r"age must not exceed the step dt = 0\.1 seconds where g is given, got 0\.1000000001", plan.jump, state, 1.0, age=0.1000000001, g=1.0)
    refused(ValueError, r"t_span must rise, got \(0\.1, 0\.1\)", basset.solve, lambda t, y: -y, (0.1, 0.1), [1.0])


def test_a_tail_needs_a_window_that_holds_its_polynomials():
    whole = basset.Daitche(3).recipe(0.1, 1.0, basset.BassetKernel())
    sentence = r"window must be at least 2 steps under a tail with polynomials of degree 3, got 1$"
    refused(ValueError, sentence, whole.with_tail, 1, 1e-6, 0.1, 1.0, basset.BassetKernel())
    assert whole.with_tail(2, 1e-6, 0.1, 1.0, basset.BassetKernel()).window == 2
