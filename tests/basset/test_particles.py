"""Spheres in flows: exact motions, forces that add up, grids, walls, many particles, and what is refused."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
import scipy.optimize
import xarray

import basset
from basset import Flow, maxey_riley, reference

GRAIN = {"diameter": 5e-5, "density_ratio": 2.65, "viscosity": 1e-6}
HEAVY = {"diameter": 0.02, "density_ratio": 2.0, "viscosity": 1e-3}  # in a vortex of unit size and rate: λ = 18, β = 0.6


def numbers(diameter, density_ratio, viscosity, gravity=9.81):
    """λ, c, β and the reduced gravity of a sphere with an added mass of one half."""
    inertia = density_ratio + 0.5
    return (
        18.0 * viscosity / diameter**2 / inertia,
        9.0 / diameter * math.sqrt(viscosity / math.pi) / inertia,
        1.5 / inertia,
        (density_ratio - 1.0) * gravity / inertia,
    )


def still(t, x):
    return 0.0, 0.0, 0.0


def rotation(t, x):
    return -x[1], x[0]


fast_still, fast_rotation = numba.njit(still), numba.njit(rotation)


@pytest.mark.analytic
@pytest.mark.parametrize("velocity", [still, fast_still], ids=["python", "compiled"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-9])
def test_a_sphere_settles_from_rest_as_the_closed_form_says(velocity, rtol):
    rate, coefficient, _, gravity = numbers(**GRAIN)
    t = np.linspace(0.0, 0.1, 11)
    ds = maxey_riley(velocity, (0.0, 0.1), [0.0, 0.0, 0.0], t_eval=t, method=basset.Collocation(rtol=rtol), **GRAIN)
    for found, exact in ((ds.velocity, reference.settling), (ds.position, reference.settling_height)):
        assert np.abs(found[0, 1:, 2] / exact(t[1:], rate, coefficient, gravity) - 1.0).max() < rtol
    assert not ds.position[0, :, :2].any() and ds.status == 0


@pytest.mark.analytic
@pytest.mark.parametrize("velocity", [still, fast_still], ids=["python", "compiled"])
@pytest.mark.parametrize("t_eval", [np.linspace(0.0, 0.1, 11), None], ids=["equal times", "ends of steps"])
def test_forces_are_those_of_the_closed_form_and_add_up(velocity, t_eval):
    rate, coefficient, _, gravity = numbers(**GRAIN)
    volume = math.pi / 6.0 * GRAIN["diameter"] ** 3
    ds = maxey_riley(velocity, (0.0, 0.1), [0.0, 0.0, 0.0], t_eval=t_eval, method=basset.Collocation(rtol=1e-9), density=998.0, **GRAIN)
    t = ds.time.values
    force = ds.force.sel(component="z")[:, 0]
    mass, weight = 2.65 * 998.0 * volume, -1.65 * 998.0 * volume * 9.81
    acceleration = -gravity * reference.response(t, rate, coefficient)
    assert list(ds.kind) == ["weight", "drag", "added_mass", "pressure_gradient", "history"]
    assert np.allclose(force.sel(kind="weight"), weight, rtol=1e-14)
    drag = -3.0 * math.pi * 998.0 * 1e-6 * 5e-5 * reference.settling(t, rate, coefficient, gravity)
    assert np.abs(force.sel(kind="drag") - drag).max() < 1e-8 * -weight
    assert np.abs(force.sum("kind") - mass * acceleration).max() < 1e-7 * -weight
    assert np.abs(force.sel(kind="added_mass") + 0.5 * 998.0 * volume * acceleration).max() < 1e-7 * -weight
    assert not force.sel(kind="pressure_gradient").any()


@pytest.mark.analytic
@pytest.mark.parametrize("velocity", [still, fast_still], ids=["python", "compiled"])
def test_the_history_force_right_behind_the_start(velocity):
    """The first terms of H in √t, far within the first step: 2√t dw/dt from rest, the slip times K behind a jump, finite where K is."""
    d, nu, t = 1e-4, 1e-6, np.array([0.0, 1e-9, 1e-8])
    bubble = basset.BubbleKernel(d, nu)
    _, coefficient, _, gravity = numbers(d, 2.65, nu)
    factor = -9.0 / d * math.sqrt(nu / math.pi) * 1000.0 * math.pi / 6.0 * d**3

    def force(slip, kernel):
        start = {"initial_slip": [0.0, 0.0, slip], "density_ratio": 2.65, "diameter": d, "viscosity": nu}
        return (
            maxey_riley(velocity, (0.0, 0.02), [[0.0, 0.0, 0.0]], kernel=kernel, t_eval=t, **start).force.sel(kind="history", component="z")[0].values / factor
        )

    correction = coefficient * np.sqrt(math.pi * t)
    assert (np.abs(force(0.0, basset.BassetKernel()) + 2.0 * gravity * np.sqrt(t)) <= 0.01 * gravity * np.sqrt(t)).all()
    found = force(0.1, basset.BassetKernel())
    assert found[0] == math.inf and (np.abs(found[1:] / (0.1 * basset.BassetKernel()(t[1:])) - 1.0) < 2.0 * correction[1:]).all()
    assert (np.abs(force(0.1, bubble) / (0.1 * bubble(t)) - 1.0) < 1e-4).all()


def breeze(t, x):
    return 0.037, 0.013, 0.0


@pytest.mark.parametrize("velocity", [breeze, numba.njit(breeze)], ids=["python", "compiled"])
def test_the_history_force_where_a_wall_throws_it_back(velocity):
    """Along the wall nothing jumps; across it a bounded kernel adds the jump times K(0)."""
    coefficient = 9.0 / BALL["diameter"] * math.sqrt(BALL["viscosity"] / math.pi) * 1000.0 * math.pi / 6.0 * BALL["diameter"] ** 3
    for kernel in (basset.BassetKernel(), basset.BubbleKernel(BALL["diameter"], BALL["viscosity"])):
        start = {"initial_slip": [0.05, 0.01, -1.0], "kernel": kernel, "events": fast_floor, **BALL}
        ds = maxey_riley(velocity, (0.0, 0.2), [0.0, 0.0, 0.1], **start)
        after = np.flatnonzero(np.diff(ds.time) == 0.0)[0] + 1
        force, slip = ds.force.sel(kind="history")[0].values, ds.slip[0].values
        assert (force[after, :2] == force[after - 1, :2]).all() and np.isfinite(force[after, :2]).all() and force[after, :2].all()
        leap = (slip[after] - slip[after - 1])[2]
        assert np.isclose(force[after, 2], force[after - 1, 2] - coefficient * kernel(0.0) * leap, rtol=1e-12)
        at = maxey_riley(velocity, (0.0, 0.2), [[0.0, 0.0, 0.1]], t_eval=ds.time[after : after + 1], **start).force.sel(kind="history")[0, 0]
        assert np.allclose(at, force[after], rtol=1e-8)


@pytest.mark.analytic
@pytest.mark.parametrize("slip", [(0.0, 0.0), (0.1, -0.2)])
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_a_solid_body_vortex_throws_it_out_as_the_closed_form_says(slip, rtol):
    rate, coefficient, beta, _ = numbers(**HEAVY)
    t = np.linspace(0.0, 2.0 * np.pi, 9)
    exact = reference.solid_body_vortex(t, rate, coefficient, beta, position=1.0, initial_slip=complex(*slip))
    ds = maxey_riley(fast_rotation, (0.0, t[-1]), [[1.0, 0.0]], initial_slip=slip, t_eval=t, method=basset.Collocation(rtol=rtol), **HEAVY)
    assert np.abs(ds.position[0].values @ [1, 1j] - exact.position).max() < rtol
    assert np.abs(ds.slip[0].values @ [1, 1j] - exact.slip).max() < rtol
    own = maxey_riley(rotation, (0.0, t[-1]), [1.0, 0.0], initial_velocity=[slip[0], 1.0 + slip[1]], t_eval=t, method=basset.Collocation(rtol=rtol), **HEAVY)
    assert np.abs(own.position - ds.position).max() < 1e-11


@pytest.mark.analytic
def test_a_stream_that_oscillates():
    rate, coefficient, beta, _ = numbers(**HEAVY)
    t = np.linspace(0.0, 10.0, 11)
    ds = maxey_riley(lambda t, x: np.array([0.3 * np.sin(2.0 * t), 0.0]), (0.0, 10.0), [0.0, 0.0], t_eval=t, method=basset.Collocation(rtol=1e-8), **HEAVY)
    exact = reference.oscillating_stream(t, rate, coefficient, (beta - 1.0) * 2.0 * 0.3, 2.0)
    assert np.abs(ds.slip[0, :, 0] - exact).max() < 1e-8 * 0.3


def test_derivatives_given_are_those_of_differences():
    """A flow with all terms: unsteady, sheared, curved."""

    def velocity(t, x):
        return np.array([np.sin(x[1] + t), np.cos(x[0]) * x[2], np.sin(x[0] * x[1]) - t])

    def gradient(t, x):
        c = np.cos(x[0] * x[1])
        return np.array([[0.0, np.cos(x[1] + t), 0.0], [-np.sin(x[0]) * x[2], 0.0, np.cos(x[0])], [x[1] * c, x[0] * c, 0.0]])

    def material(t, x):
        return np.array([np.cos(x[1] + t), 0.0, -1.0]) + gradient(t, x) @ velocity(t, x)

    options = {"initial_slip": [0.1, 0.0, -0.1], "lift": "saffman", "method": basset.Collocation(rtol=1e-8), "t_eval": [0.5, 1.0], **HEAVY}
    one = maxey_riley(velocity, (0.0, 1.0), [0.3, 0.2, 0.1], **options)
    other = maxey_riley(velocity, (0.0, 1.0), [0.3, 0.2, 0.1], gradient=gradient, material_derivative=material, **options)
    assert np.abs(one.position - other.position).max() < 1e-10
    assert np.abs(one.force / other.force - 1.0).max() < 1e-7


def test_a_particle_has_the_same_bits_among_others_and_over_threads():
    places = np.random.default_rng(1).uniform(-1.0, 1.0, (7, 2))
    options = {"t_eval": [0.5, 1.0], "lift": "saffman", **HEAVY}
    all_of_them = maxey_riley(fast_rotation, (0.0, 1.0), places, **options)
    threads = maxey_riley(fast_rotation, (0.0, 1.0), places, workers=3, **options)
    some = maxey_riley(fast_rotation, (0.0, 1.0), places[2:5], **options)
    assert threads.identical(all_of_them)
    assert all(np.array_equal(some[name], all_of_them[name].isel(particle=slice(2, 5))) for name in ("position", "velocity", "slip"))
    assert np.array_equal(some.force, all_of_them.force.isel(particle=slice(2, 5)))
    alone = maxey_riley(fast_rotation, (0.0, 1.0), places[3], **options)
    assert np.abs(alone.position[0] - all_of_them.position[3]).max() < 1e-14


def test_without_history_it_relaxes_exponentially():
    rate = numbers(**HEAVY)[0]
    ds = maxey_riley(still, (0.0, 0.2), [0.0, 0.0, 0.0], initial_slip=[1.0, 0.0, 0.0], gravity=[0.0, 0.0, 0.0], history=False, t_eval=[0.1, 0.2], **HEAVY)
    assert np.allclose(ds.slip[0, :, 0], np.exp(-rate * ds.time), rtol=1e-6)
    assert "history" not in ds.kind and "lift" not in ds.kind


def test_as_heavy_as_the_fluid_it_goes_with_it():
    ds = maxey_riley(fast_rotation, (0.0, 2.0 * np.pi), [[1.0, 0.0]], t_eval=[2.0 * np.pi], **{**HEAVY, "density_ratio": 1.0})
    assert np.abs(ds.slip).max() < 1e-10 and np.abs(ds.position[0, 0] - [1.0, 0.0]).max() < 1e-6


def test_drag_laws_balance_the_weight():
    big = {"diameter": 1e-3, "density_ratio": 2.65, "viscosity": 1e-6}

    def law(reynolds):
        return 1.0 + 0.15 * reynolds**0.687

    balance = 1.65 * 9.81 * 1e-6 / 18e-6
    speed = scipy.optimize.brentq(lambda v: v * law(v * 1e3) - balance, 0.0, 1.0)
    options = {"history": False, "t_eval": [2.0], **big}
    for drag in ("schiller_naumann", law):
        ds = maxey_riley(still, (0.0, 2.0), [0.0, 0.0, 0.0], drag=drag, **options)
        assert np.isclose(ds.velocity[0, 0, 2], -speed, rtol=1e-6)
        assert abs(ds.force[:, 0, 0, 2].sum() / ds.force[0, 0, 0, 2]) < 1e-5
    compiled = maxey_riley(fast_still, (0.0, 2.0), [[0.0, 0.0, 0.0]], drag=numba.njit(law), **options)
    assert np.isclose(compiled.velocity[0, 0, 2], -speed, rtol=1e-6)


def test_saffmans_lift_drives_what_lags_to_the_faster_side():
    ds = maxey_riley(lambda t, x: np.array([4.0 * x[1], 0.0]), (0.0, 0.01), [0.0, 1.0], initial_slip=[-0.1, 0.0], lift="saffman", t_eval=[0.0], **HEAVY)
    lift = ds.force.sel(kind="lift")[0, 0]
    assert np.isclose(lift[1], 1.615 * 1000.0 * math.sqrt(1e-3) * 0.02**2 * math.sqrt(4.0) * 0.1, rtol=1e-9) and abs(lift[0]) < 1e-9 * lift[1]


@pytest.mark.parametrize(
    ("kernel", "method"),
    [
        (basset.MeiAdrianKernel(0.1, 0.02, 1e-3), basset.Collocation(rtol=1e-7)),
        (basset.VaryingSlipKernel(0.02, 1e-3, (1e-3, 1.0)), basset.Collocation(rtol=1e-7)),
        (basset.BassetKernel(), basset.FixedStep(1.0 / 32.0, basset.Daitche(order=2))),
    ],
    ids=["Mei-Adrian", "varying slip", "fixed steps"],
)
def test_kernels_and_methods_are_those_of_solve(kernel, method):
    rate, coefficient, beta, _ = numbers(**HEAVY)

    def fun(t, y):
        x, v, w, z = y
        return [w - v, z + x, -rate * w + z + (1.0 - beta) * x, -rate * z - w + (1.0 - beta) * v]

    solved = basset.solve(fun, (0.0, 1.0), [1.0, 0.0, 0.1, 0.0], memory=[2, 3], coefficient=coefficient, kernel=kernel, method=method)
    ds = maxey_riley(rotation, (0.0, 1.0), [1.0, 0.0], initial_slip=[0.1, 0.0], kernel=kernel, method=method, t_eval=[1.0], **HEAVY)
    assert np.abs(np.concatenate([ds.position[0, 0], ds.slip[0, 0]]) - solved.y[:, -1]).max() < 1e-6


class Floor:
    """A plane at z = 0 that gives back a share of the speed."""

    direction = -1

    def __init__(self, restitution):
        self.restitution = restitution

    def __call__(self, t, x, v):
        return x[2]

    def jump(self, t, x, v):
        return [v[0], v[1], -self.restitution * v[2]]


@numba.njit
def fast_floor(t, x, v):
    return x[2]


@numba.njit
def fast_bounce(t, x, v):
    return v[0], v[1], -0.8 * v[2]


fast_floor.direction, fast_floor.jump = -1, fast_bounce
BALL = {"diameter": 1e-2, "density_ratio": 8.0, "viscosity": 1e-5}


@pytest.mark.analytic
@pytest.mark.parametrize(("velocity", "floor"), [(still, Floor(0.8)), (fast_still, fast_floor)], ids=["python", "compiled"])
def test_a_wall_throws_it_back_and_the_jump_is_remembered(velocity, floor):
    rate, coefficient, _, gravity = numbers(**BALL)
    exact = reference.bouncing(rate, coefficient, gravity, height=0.5, restitution=0.8, impacts=3)
    t = np.array([0.2, 0.5, 0.8]) * exact.end
    ds = maxey_riley(velocity, (0.0, exact.end), [[0.0, 0.0, 0.5]], events=floor, t_eval=t, method=basset.Collocation(rtol=1e-8), **BALL)
    assert np.abs(ds.position[0, :, 2] - exact.height(t)).max() < 1e-7
    assert np.abs(ds.event_time[:3] - exact.times).max() < 1e-7
    assert np.abs(1.8 * ds.event_velocity[:3, 2] + exact.jumps).max() < 1e-6 and not ds.event_number.any()
    own = maxey_riley(velocity, (0.0, exact.times[1]), [0.0, 0.0, 0.5], events=floor, method=basset.Collocation(rtol=1e-8), **BALL)
    twice = np.flatnonzero(np.diff(own.time) == 0.0)  # a jump is given before and after
    assert np.isclose(own.velocity[0, twice[0] + 1, 2], -0.8 * own.velocity[0, twice[0], 2], rtol=1e-12)
    history = own.force.sel(kind="history", component="z")[0]
    assert np.isinf(history[twice[0] + 1]) and np.isfinite(history[: twice[0] + 1]).all()


def test_a_screen_ends_the_path():
    def screen(t, x, v):
        return x[2] + 1e-4

    screen.terminal = True
    ds = maxey_riley(still, (0.0, 1.0), [[0.0, 0.0, 0.0], [0.0, 0.0, -5e-5]], events=[screen], t_eval=np.linspace(0.0, 1.0, 5), **GRAIN)
    assert list(ds.status) == [1, 1] and np.isnan(ds.position[:, -1]).all() and (ds.end_time[0] > ds.end_time[1])
    assert np.allclose(ds.event_position[:, 2], -1e-4, rtol=1e-9) and np.array_equal(ds.event_time, ds.end_time)


def grid(velocity, times, *axes, order=None):
    """A dataset of a flow on a grid."""
    names = (*(["time"] if times is not None else []), *"xyz"[: len(axes)])
    points = (*([times] if times is not None else []), *axes)
    mesh = np.meshgrid(*points, indexing="ij")
    values = velocity(mesh[0] if times is not None else 0.0, mesh[1 if times is not None else 0 :])
    ds = xarray.Dataset(
        {name: (names, np.broadcast_to(value, mesh[0].shape)) for name, value in zip("uvw", values, strict=False)}, dict(zip(names, points, strict=True))
    )
    return ds if order is None else ds.transpose(*order)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("times", [None, np.array([0.0, 0.5, 0.7, 1.3, 2.0])], ids=["steady", "unsteady"])
def test_a_grid_is_exact_for_cubic_flows_with_all_derivatives(dimensions, times):
    def velocity(t, x):
        z = x[2] if dimensions == 3 else 0.0 * x[0]
        s = 0.0 if times is None else t
        return np.stack([x[0] ** 3 - x[1] * s**2 + z, x[1] ** 2 * x[0] + s**3, z * x[0] - s * x[1] ** 3])[:dimensions]

    axes = [np.array([0.0, 0.2, 0.5, 0.6, 1.0]), np.array([-1.0, -0.1, 0.2, 0.9, 1.1, 2.0]), np.linspace(0.0, 1.0, 4)][:dimensions]
    order = ("y", "x", "z", "time") if dimensions == 3 and times is not None else None
    flow = Flow.from_dataset(grid(velocity, times, *axes, order=order))
    rng = np.random.default_rng(2)
    for _ in range(20):
        t, x = rng.uniform(0.0, 2.0), np.array([rng.uniform(a[0], a[-1]) for a in axes])
        h = 1e-5
        gradient = np.array([(velocity(t, x + h * e) - velocity(t, x - h * e)) / (2.0 * h) for e in np.eye(dimensions)]).T
        material = (velocity(t + h, x) - velocity(t - h, x)) / (2.0 * h) + gradient @ velocity(t, x)
        assert np.allclose(flow(t, x), velocity(t, x), atol=1e-12)
        assert np.allclose(flow.gradient(t, x), gradient, atol=1e-8)
        assert np.allclose(flow.material_derivative(t, x), material, atol=1e-8)
    many = rng.uniform(0.1, 0.9, (5, dimensions))
    assert np.array_equal(flow(1.0, many)[3], flow(1.0, many[3]))


def test_times_may_be_dates():
    times = np.arange(4) * np.timedelta64(30, "m") + np.datetime64("2024-01-01")
    points = np.linspace(0.0, 1.0, 4)
    ds = grid(lambda t, x: [t + 0.0 * x[0], 0.0 * x[0]], np.arange(4) * 1800.0, points, points).assign_coords(time=times)
    assert np.isclose(Flow.from_dataset(ds)(2700.0, [0.5, 0.5])[0], 2700.0)


def waves(t, x):
    """Taylor and Green's vortices."""
    return np.stack([np.sin(x[0]) * np.cos(x[1]), -np.cos(x[0]) * np.sin(x[1])])


def test_units_of_a_grid_are_heeded():
    def velocity(t, x):
        return np.stack([x[1] * t, -x[0] + t])

    axes = np.linspace(0.0, 3.0, 4), np.linspace(0.0, 1.0, 5), np.linspace(-1.0, 1.0, 6)
    plain = grid(velocity, *axes)
    ds = grid(velocity, *axes)
    for name, factor, unit in (("u", 1e3, "mm/s"), ("v", 1e2, "cm s-1"), ("x", 1e3, "mm"), ("y", 1e-3, "km"), ("time", 1.0 / 60.0, "minutes since 2000-01-01")):
        ds[name] = (ds[name] * factor).assign_attrs(units=unit)
    one, other = Flow.from_dataset(plain), Flow.from_dataset(ds)
    assert np.allclose(other(0.7, [0.3, 0.4]), one(0.7, [0.3, 0.4]), rtol=1e-12)
    assert np.allclose(other.gradient(0.7, [0.3, 0.4]), one.gradient(0.7, [0.3, 0.4]), rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("closed", [False, True])
def test_a_periodic_grid_converges_with_the_fourth_power_and_has_no_seam(closed):
    errors = []
    for count in (16, 32):
        points = np.linspace(0.0, 2.0 * np.pi, count + 1)[: count + closed]
        flow = Flow.from_dataset(grid(waves, None, points, points), periodic={"x": 2.0 * np.pi, "y": 2.0 * np.pi})
        x = np.random.default_rng(3).uniform(-10.0, 10.0, (200, 2))
        errors.append([np.abs(flow(0.0, x) - waves(0.0, x.T).T).max(), np.abs(flow.gradient(0.0, x)[:, 0, 0] - np.cos(x[:, 0]) * np.cos(x[:, 1])).max()])
        assert np.abs(flow(0.0, x + np.array([2.0 * np.pi, -4.0 * np.pi])) - flow(0.0, x)).max() < 1e-13
    assert np.log2(errors[0][0] / errors[1][0]) > 3.8 and np.log2(errors[0][1] / errors[1][1]) > 2.8


def test_a_periodic_grid_may_have_unequal_spacings():
    points, x = 2.0 * np.pi * np.linspace(0.0, 1.0, 25)[:-1] ** 1.2, np.array([[0.05, 1.0], [6.2, 2.0]])
    flow = Flow.from_dataset(grid(waves, None, points, points), periodic={"x": 2.0 * np.pi, "y": 2.0 * np.pi})
    assert np.abs(flow(0.0, x + 2.0 * np.pi) - flow(0.0, x)).max() < 1e-13 and np.abs(flow(0.0, x) - waves(0.0, x.T).T).max() < 1e-3


def test_particles_on_a_grid_move_as_in_the_flow_itself():
    points = np.arange(48) * 2.0 * np.pi / 48
    flow = Flow.from_dataset(grid(waves, None, points, points), periodic={"x": 2.0 * np.pi, "y": 2.0 * np.pi})
    places, options = [[0.5, 0.4], [2.0, 9.0]], {"t_eval": [3.0], **HEAVY}
    own = maxey_riley(waves, (0.0, 3.0), places, **options)
    found = maxey_riley(flow, (0.0, 3.0), places, **options)
    assert np.abs(found.position - own.position).max() < 1e-5
    plain = maxey_riley(flow, (0.0, 3.0), places, drag=lambda reynolds: 1.0, **options)  # not compiled: the flow is called from Python
    assert np.abs(found.position - plain.position).max() < 1e-9


@pytest.mark.parametrize("drag", ["stokes", lambda reynolds: 1.0], ids=["compiled", "python"])
def test_what_leaves_the_grid_ends_there(drag):
    flow = Flow.from_dataset(grid(lambda t, x: [1.0 + 0.0 * x[0], 0.0 * x[0]], None, np.linspace(0.0, 2.0, 5), np.linspace(0.0, 1.0, 5)))
    ds = maxey_riley(flow, (0.0, 1.5), [[1.0, 0.5], [0.2, 0.5]], drag=drag, t_eval=[0.5, 1.5], **{**HEAVY, "density_ratio": 1.0})
    assert list(ds.status) == [3, 0] and np.isclose(ds.end_time[0], 1.0, rtol=1e-9)
    assert np.isnan(ds.position[0, 1]).all() and np.allclose(ds.position[1, :, 0], [0.7, 1.7], rtol=1e-9)
    assert "event_time" in ds and not ds.sizes["occurrence"]


def test_what_starts_on_the_edge_goes_in_or_ends_at_once():
    flow = Flow.from_dataset(grid(lambda t, x: [0.3 + 0.0 * x[0], 0.0 * x[0]], None, np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5)))
    ds = maxey_riley(flow, (0.0, 1.0), [[0.0, 0.5], [1.0, 0.5]], t_eval=[0.0, 1.0], **{**HEAVY, "density_ratio": 1.0})
    assert list(ds.status) == [0, 3] and np.isclose(ds.position[0, 1, 0], 0.3) and ds.end_time[1] < 1e-8


@pytest.mark.analytic
@pytest.mark.parametrize("slip", [(0.0, 0.0), (0.1, -0.2)])
def test_a_jet_that_waves_against_a_solution_of_twelve_digits(slip):
    """Bickley's jet and a wave; derivatives by differences here, exact ones there."""

    @numba.njit
    def velocity(t, x):
        level = math.tanh(x[1])
        hill, phase = 1.0 - level * level, x[0] - 0.2 * t
        return hill * (1.0 + 0.6 * level * math.cos(phase)), -0.3 * hill * math.sin(phase)

    @numba.njit
    def gradient(t, x):
        level = math.tanh(x[1])
        hill, phase = 1.0 - level * level, x[0] - 0.2 * t
        shear = -2.0 * hill * level + 0.6 * hill * (1.0 - 3.0 * level * level) * math.cos(phase)
        stretch = -0.6 * hill * level * math.sin(phase)
        return np.array([[stretch, shear], [-0.3 * hill * math.cos(phase), -stretch]])

    @numba.njit
    def acceleration(t, x):
        g, (u, v) = gradient(t, x), velocity(t, x)  # the wave goes with 0.2: ∂u/∂t = −0.2 ∂u/∂x
        return (u - 0.2) * g[0, 0] + v * g[0, 1], (u - 0.2) * g[1, 0] + v * g[1, 1]

    places, options = [[0.0, 0.3], [1.0, -1.0], [3.0, 0.9]], {"initial_slip": slip, "t_eval": [2.0, 6.0], **HEAVY}
    given = {"gradient": gradient, "material_derivative": acceleration, "method": basset.Collocation(rtol=1e-12)}
    truth = maxey_riley(velocity, (0.0, 6.0), places, **given, **options)
    for rtol in (1e-5, 1e-8):
        found = maxey_riley(velocity, (0.0, 6.0), places, method=basset.Collocation(rtol=rtol), **options)
        assert np.abs(found.position - truth.position).max() < rtol * np.abs(truth.position).max()


def test_results_share_no_labels():
    one, other = (maxey_riley(fast_rotation, (0.0, 1.0), [1.0, 0.0], **HEAVY) for _ in range(2))
    one.component.attrs["changed"] = one["kind"].attrs["changed"] = "yes"
    one = one.assign_coords(kind=[name.upper() for name in one.kind.values])
    assert not other.component.attrs and not other.kind.attrs and other.kind[0] == "weight"
    assert other.identical(maxey_riley(fast_rotation, (0.0, 1.0), [1.0, 0.0], **HEAVY))


def test_the_result_has_units_and_becomes_netcdf(tmp_path):
    ds = maxey_riley(still, (0.0, 0.01), [0.0, 0.0, 0.0], events=lambda t, x, v: x[2] + 1e-6, **GRAIN)
    assert ds.position.dims == ("particle", "time", "component") and ds.force.dims == ("kind", "particle", "time", "component")
    for name, unit in {"position": "m", "velocity": "m s-1", "force": "N", "time": "s"}.items():
        assert ds[name].attrs["units"] == unit
    ds.to_netcdf(tmp_path / "path.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "path.nc", engine="scipy") as read:
        assert np.array_equal(read.position, ds.position) and read.attrs["diameter"] == 5e-5 and list(read.kind.values.astype(str)) == list(ds.kind.values)


def test_what_goes_wrong_on_the_way_is_a_status():
    ds = maxey_riley(lambda t, x: [1.0, 0.0] if x[0] < 0.5 else [np.nan, 0.0], (0.0, 1.0), [[0.0, 0.0], [-9.0, 0.0]], t_eval=[0.1, 1.0], **HEAVY)
    assert list(ds.status) == [-1, 0] and "particle 0: fun gave nan" in ds.attrs["failures"] and ds.end_time[0] < 0.51 and np.isfinite(ds.position[1]).all()


FLOWING = grid(lambda t, x: [x[0], x[1]], None, np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"velocity": 3.0}, "velocity must be callable as velocity(t, x), or a basset.Flow, got 3.0"),
        ({"velocity": lambda t, x: [0.0, 0.0]}, "velocity must return 3 components, got shape (2,)"),
        ({"velocity": Flow.from_dataset(FLOWING)}, "position must have the 2 components of the flow, got 3"),
        ({"velocity": Flow.from_dataset(FLOWING), "position": [2.0, 0.0]}, "position must lie within the grid of the flow"),
        ({"position": [1.0]}, "position must be finite with 2 or 3 components"),
        ({"position": [0.0, np.nan, 0.0]}, "position must be finite"),
        ({"diameter": 0.0}, "diameter must be a finite number greater than 0 (m), got 0"),
        ({"density_ratio": -1.0}, "density_ratio must be"),
        ({"density_ratio": 0.0, "added_mass": 0.0}, "must not both be 0"),
        ({"viscosity": "water"}, "viscosity must be"),
        ({"gravity": 9.81}, "gravity must be 3 finite numbers"),
        ({"drag": "stoks"}, "did you mean 'stokes'?"),
        ({"drag": lambda reynolds: 24.0 / reynolds if reynolds else math.inf}, "drag must be finite at Re = 0"),
        ({"lift": "magnus"}, "lift must be one of 'saffman'"),
        ({"initial_slip": [0.0] * 3, "initial_velocity": [0.0] * 3}, "must not both be given"),
        ({"initial_slip": [0.0, 0.0]}, "initial_slip must hold 3 finite components"),
        ({"gradient": lambda t, x: np.zeros(3)}, "gradient must return an array of shape (3, 3), got shape (3,)"),
        ({"kernel": basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)}, "diameter of the kernel must be that of the particle's equation, 5e-05, got 0.001"),
        ({"history": "no"}, "history must be True or False"),
        ({"method": "RK45"}, "method must be a method such as"),
        ({"t_span": (1.0, 0.0)}, "t_span must rise"),
        ({"t_eval": [5.0]}, "t_eval must be rising times within t_span"),
        ({"events": 3}, "events must be a callable event(t, position, velocity)"),
        ({"events": lambda t, x, v: x}, "event 0 must return a number"),
        ({"workers": 0}, "workers must be a whole number"),
    ],
)
def test_bad_input_is_one_sentence(changed, says):
    given = {"velocity": still, "t_span": (0.0, 1.0), "position": [0.0, 0.0, 0.0], **GRAIN} | changed
    with pytest.raises((ValueError, TypeError)) as told:
        maxey_riley(given.pop("velocity"), given.pop("t_span"), given.pop("position"), **given)
    assert says in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("ds", "options", "says"),
    [
        (3, {}, "ds must be an xarray.Dataset"),
        (FLOWING, {"components": ("u", "q")}, "components must be variables of the dataset (u, v), got 'q'"),
        (FLOWING, {"components": ("u",)}, "one for each of the dimensions x, y"),
        (FLOWING.isel(x=slice(3)), {}, "x must have 4 points or more, got 3"),
        (FLOWING.isel(x=[0, 2, 1, 3, 4]), {}, "x must be finite and rise"),
        (FLOWING.where(FLOWING.x > 0.3), {}, "u must have no missing values"),
        (FLOWING.rename(x="lon"), {}, "ds must have the dimensions x and y (and z); rename its dimensions, got lon, y"),
        (FLOWING.expand_dims(level=[0.0]), {}, "u must have the dimensions time, x, y, z alone, got 'level'"),
        (FLOWING, {"periodic": {"z": 1.0}}, "periodic must be one of 'x', 'y'"),
        (FLOWING, {"periodic": {"x": 1.0}}, "values a period apart along x must be equal"),
        (FLOWING, {"periodic": {"x": 0.5}}, "must be the length of the grid"),
        (FLOWING, {"periodic": {"x": 1.00001}}, "must be the length of the grid, 1, or longer by one spacing like the others, got 1.00001"),
        (FLOWING, {"periodic": {"x": 360.0}}, "longer by one spacing like the others, got 360"),
        (FLOWING, {"periodic": ["x"]}, "periodic must be a mapping"),
        (FLOWING, {"components": None}, "components must be names of variables, got None"),
        (FLOWING.where(FLOWING.x > 0.3, 9.96921e36), {}, "u must have no missing values"),
        (FLOWING.assign_coords(x=("x", FLOWING.x.values, {"units": "degrees_east"})), {}, "x must be in m, mm, cm or km, got the unit 'degrees_east'"),
        (FLOWING.assign(u=FLOWING.u.assign_attrs(units="knots")), {}, "u must be in m/s, mm/s, cm/s or km/s, got the unit 'knots'"),
    ],
)
def test_a_grid_that_is_none_is_refused_in_one_sentence(ds, options, says):
    with pytest.raises((ValueError, TypeError)) as told:
        Flow.from_dataset(ds, **options)
    assert says in str(told.value) and "\n" not in str(told.value)
