"""The suite on steps: what it looks into is there, and operations are counted as they are."""

import math

import pytest

from bench.suites import stepper as suite


@pytest.mark.parametrize("name", suite.CLOCKED)
def test_what_is_clocked_is_there_and_can_be_given_other_code(name):
    function = suite.clocked_function(name)
    assert function.__name__ == name and not function.__closure__ and not function.__code__.co_kwonlyargcount


def test_what_is_not_there_is_said():
    with pytest.raises(LookupError, match="called 'no_such_name'"):
        suite.clocked_function("no_such_name")


def test_operations_are_counted():
    suite.Counted.done = 0
    x = suite.Counted(3.0)
    found = (2.0 * x + 1.0) / x - math.sqrt(4.0)
    assert suite.Counted.done == 4 and float(found) == pytest.approx(1.0 / 3.0)


def test_rates_of_more_effects_take_more_operations():
    full, bare = (suite.engine_apart(without) for without in ((), ("history", "lift", "magnus", "rotation")))
    assert 0 < suite.operations_of_rates(bare) < suite.operations_of_rates(full) < 1000


@pytest.mark.parametrize("case", [suite.impacts, lambda: suite.systems(20), lambda: suite.threads(20)], ids=["impacts", "systems", "threads"])
def test_both_sides_of_a_case_give_the_same(case):
    case()  # or it says so
