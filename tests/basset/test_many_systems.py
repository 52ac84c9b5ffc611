"""Many systems at once: each to the bits of its own solution, whatever the number of threads, whatever happens to the others."""

from __future__ import annotations

import numba
import numpy as np
import pytest

import basset

COUNT = 40
RNG = np.random.default_rng(5)
STATES = np.stack([RNG.uniform(0.5, 2.0, COUNT), RNG.normal(size=COUNT)])
STIFFNESS = RNG.uniform(0.5, 4.0, COUNT)
TURNS = RNG.uniform(-1.0, 1.0, (2, 2, COUNT))
COEFFICIENTS = RNG.uniform(0.0, 0.8, (1, COUNT))
SLIPS = RNG.normal(size=(1, COUNT))
FOLLOWS = basset.VaryingSlipKernel(diameter=1.0, viscosity=0.05, slip_range=(1e-6, 100.0))


@numba.njit
def swings(t, y, stiffness):
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -stiffness * y[0] - 0.3 * y[1]
    return rates


@numba.njit
def turned(t, y, matrix):
    return matrix @ y


@numba.njit
def falls(t, y, weight):
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -weight
    return rates


@numba.njit
def floor(t, y, weight):
    return y[0] - 0.1


@numba.njit
def bounce(t, y, weight):
    after = np.empty(2)
    after[0], after[1] = 0.1, -0.6 * y[1]
    return after


def at_floor(terminal=False):
    event = lambda t, y, weight: y[0] - 0.1  # noqa: E731 - attributes of its own
    event.jump, event.direction, event.terminal = lambda t, y, weight: np.array([0.1, -0.6 * y[1]]), -1, terminal
    return event


def same(many, alone, j):
    assert np.array_equal(many.t[j], alone.t) and np.array_equal(many.y[j], alone.y)
    assert (many.status[j], many.message[j], many.nfev[j], many.nsteps[j]) == (alone.status, alone.message, alone.nfev, alone.nsteps)
    for k, times in enumerate(alone.t_events):
        assert np.array_equal(many.t_events[k][j], times) and np.array_equal(many.y_events[k][j], alone.y_events[k])


CASES = {
    "memory": (swings, STIFFNESS, {"memory": [1], "coefficient": COEFFICIENTS}),
    "matrix": (turned, TURNS, {"memory": [0, 1], "coefficient": 0.4}),
    "slip": (swings, STIFFNESS, {"memory": [1], "coefficient": 0.4, "initial_slip": SLIPS}),
    "none": (swings, STIFFNESS, {"memory": [1], "coefficient": 0.0}),
    "follows": (swings, STIFFNESS, {"memory": [1], "coefficient": COEFFICIENTS, "kernel": FOLLOWS}),
    "fixed": (swings, STIFFNESS, {"memory": [1], "coefficient": COEFFICIENTS, "method": basset.FixedStep(0.05)}),
    "plain": (swings.py_func, STIFFNESS, {"memory": [1], "coefficient": COEFFICIENTS}),
}


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("name", CASES)
def test_each_has_the_bits_of_its_own_solution(name, workers):
    fun, parameters, options = CASES[name]
    many = basset.solve(fun, (0.0, 5.0), STATES, args=(parameters,), workers=workers, **options)
    assert len(many.t) == len(many.y) == COUNT and many.status.shape == many.success.shape == (COUNT,) and many.success.all()
    for j in (0, 1, 17, COUNT - 1):
        own = {key: value[:, j] if np.ndim(value) == 2 else value for key, value in options.items()}
        mine = parameters[..., j] if parameters.ndim > 1 else float(parameters[j])
        same(many, basset.solve(fun, (0.0, 5.0), STATES[:, j], args=(np.ascontiguousarray(mine) if np.ndim(mine) else mine,), **own), j)


@pytest.mark.parametrize("terminal", [False, 2])
@pytest.mark.parametrize("compiled", [True, False])
def test_events_and_jumps(compiled, terminal):
    """Bouncing from the floor, each at its own times; where the second impact ends a run the others go on."""
    event = at_floor(terminal)
    if compiled:
        floor.jump, floor.direction, floor.terminal, event = bounce, -1, terminal, floor
    states = np.stack([STATES[0], np.zeros(COUNT)])
    options = {"memory": [1], "coefficient": 0.2, "events": event}
    fun = falls if compiled else falls.py_func
    many = basset.solve(fun, (0.0, 2.0), states, args=(STIFFNESS,), workers=2, **options)
    assert max(len(times) for times in many.t_events[0]) > 1 and set(many.status.tolist()) == (
        {0, 1} if terminal else {0, 2}
    )  # the weakest stay aloft, the heaviest come to rest
    for j in range(0, COUNT, 3):
        same(many, basset.solve(fun, (0.0, 2.0), states[:, j], args=(float(STIFFNESS[j]),), **options), j)


def test_wanted_times_and_paths():
    times = np.linspace(0.0, 5.0, 7)
    options = {"memory": [1], "coefficient": 0.4, "t_eval": times, "dense_output": True}
    many = basset.solve(swings, (0.0, 5.0), STATES, args=(STIFFNESS,), workers=2, **options)
    assert many.y.shape == (2, 7, COUNT) and np.array_equal(many.t, times)
    for j in (0, 20):
        alone = basset.solve(swings, (0.0, 5.0), STATES[:, j], args=(float(STIFFNESS[j]),), **options)
        assert np.array_equal(many.y[:, :, j], alone.y) and np.array_equal(many.sol[j](times), alone.sol(times))


def test_behind_the_end_of_one_there_is_nothing():
    floor.jump, floor.direction, floor.terminal = None, -1, True
    times = np.linspace(0.0, 2.0, 9)
    many = basset.solve(falls, (0.0, 2.0), np.stack([STATES[0], np.zeros(COUNT)]), memory=[1], args=(STIFFNESS,), events=floor, t_eval=times)
    for j, ends in enumerate(many.t_events[0]):
        behind = times > ends[0] if len(ends) else np.zeros(9, dtype=bool)
        assert np.isnan(many.y[:, behind, j]).all() and np.isfinite(many.y[:, ~behind, j]).all()


@pytest.mark.parametrize(
    "form", [np.asfortranarray, lambda x: np.repeat(x, 2, axis=-1)[..., ::2], lambda x: x.astype(np.float32), lambda x: np.round(x).astype(int)]
)
def test_arrays_of_any_form_are_read_and_left_alone(form):
    """Columns in any order of memory, strided, single precision, whole numbers; read-only, and as they were."""
    given = [form(array) for array in (STATES, STIFFNESS, COEFFICIENTS)]
    for array in given:
        array.flags.writeable = False
    states, stiffness, coefficients = given
    many = basset.solve(swings, (0.0, 2.0), states, memory=[1], coefficient=coefficients, args=(stiffness,))
    for j in (0, 11):
        own = np.array(states[:, j], dtype=float)
        same(many, basset.solve(swings, (0.0, 2.0), own, memory=[1], coefficient=np.array(coefficients[:, j], dtype=float), args=(float(stiffness[j]),)), j)


def test_a_kernel_without_tables_of_its_own_for_any_step():
    """Mei and Adrian's at a fixed slip: one after the other, to the same bits."""
    kernel = basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)
    many = basset.solve(swings, (0.0, 2.0), STATES[:, :5], memory=[1], coefficient=0.4, kernel=kernel, args=(STIFFNESS[:5],), workers=2)
    same(many, basset.solve(swings, (0.0, 2.0), STATES[:, 4], memory=[1], coefficient=0.4, kernel=kernel, args=(float(STIFFNESS[4]),)), 4)


@numba.njit
def breaks_down(t, y, when):
    rates = np.empty(2)
    rates[0], rates[1] = y[1], -y[0] if t < when else np.nan
    return rates


def test_one_that_fails_spoils_no_other():
    """NaN from fun, a jump of fun, a slip that fades at once: each as on its own."""
    when = np.where(np.arange(COUNT) == 7, 2.0, 100.0)
    many = basset.solve(breaks_down, (0.0, 5.0), STATES, memory=[1], coefficient=0.4, args=(when,))
    assert set(np.flatnonzero(many.status < 0)) == {7} and "not finite" in many.message[7]
    strong = np.where(np.arange(COUNT) == 3, 1e4, COEFFICIENTS)
    many = basset.solve(swings, (0.0, 5.0), STATES, memory=[1], coefficient=strong, args=(STIFFNESS,))
    for j in (2, 3, 4):
        same(many, basset.solve(swings, (0.0, 5.0), STATES[:, j], memory=[1], coefficient=strong[:, j], args=(float(STIFFNESS[j]),)), j)


def test_a_run_too_long_for_the_record():
    """More steps than are recorded at once."""
    states = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    parameters = np.array([1.0, 4e5, 2.0])
    many = basset.solve(swings, (0.0, 30.0), states, memory=[1], coefficient=0.01, args=(parameters,), method=basset.Collocation(rtol=1e-6, max_step=5e-3))
    assert many.nsteps.min() > 4096
    same(
        many, basset.solve(swings, (0.0, 30.0), states[:, 2], memory=[1], coefficient=0.01, args=(2.0,), method=basset.Collocation(rtol=1e-6, max_step=5e-3)), 2
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"coefficient": np.ones((1, 3))}, "coefficient must have a row per component and a column for each"),
        ({"initial_slip": np.ones((1, 3))}, "initial_slip must have a row per component and a column for each"),
        ({"coefficient": np.where(np.arange(COUNT) == 5, -1.0, 1.0)[None]}, "coefficient must be finite and 0 or greater in all columns"),
        ({"workers": 0}, "workers must be"),
        ({"y0": np.where(np.arange(COUNT) == 5, np.inf, STATES)}, "y0 must be finite in all columns"),
        ({"y0": np.ones((2, 0))}, "y0 must have a row per component"),
        ({"y0": np.ones((2, 3, 4))}, "y0"),
    ],
)
def test_bad_input(changes, message):
    with pytest.raises(ValueError, match=message):
        basset.solve(**({"fun": swings, "t_span": (0.0, 1.0), "y0": STATES, "memory": [1], "args": (1.0,)} | changes))
