"""A sphere in a given flow: the equation of Maxey & Riley, with the history force, for one particle or many."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel, VaryingSlipKernel
from basset.particles.flow import Flow
from basset.solvers._solve import _task, _terminal, _wanted
from basset.solvers.base import Event, Method
from basset.solvers.collocation import Collocation

if TYPE_CHECKING:
    import xarray

TIMES = 101  # of the solution of several particles, where none are given
STEPS = 1_000_000  # of one particle, at most
SAFFMAN = 1.615  # 6.46/4, Saffman (1965), corrigendum (1968)
NEAR, SOON = 32.0, 128.0  # differences reach over a diameter, and the time d²/ν, divided by these


def maxey_riley(
    velocity: Callable[..., Any] | Flow,
    t_span: tuple[float, float],
    position: ArrayLike,
    *,
    diameter: float,
    density_ratio: float,
    viscosity: float,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    initial_velocity: ArrayLike | None = None,
    initial_slip: ArrayLike | None = None,
    drag: str | Callable[[float], float] = "stokes",
    added_mass: float = 0.5,
    lift: str | None = None,
    kernel: Kernel | VaryingSlipKernel = BassetKernel(),
    history: bool = True,
    method: Method | None = None,
    gradient: Callable[..., Any] | None = None,
    material_derivative: Callable[..., Any] | None = None,
    t_eval: ArrayLike | None = None,
    events: Callable[..., Any] | Sequence[Callable[..., Any]] | None = None,
    workers: int = 1,
    density: float = 1000.0,
) -> xarray.Dataset:
    """The motion of small spheres in a given flow, with the history force.

    With w = v − u(t, x), s the density ratio, C the added mass and H the history integral of w, dx/dt = v and

        (s + C) dv/dt = (1 + C) Du/Dt + (s − 1) g − (18 ν/d²) f(Re) w + lift − (9/d) √(ν/π) H[w].

    Parameters
    ----------
    velocity : callable or Flow
        velocity(t, x) -> (d,), the undisturbed fluid's velocity in m/s at time t (s) and position x (d,) (m), d = 2 or 3. If it is compiled
        (numba.njit; preferably returning a tuple, not an array), everything runs without Python. Or a field on a grid, `Flow.from_dataset`.
    t_span : (float, float), seconds
        Start and end, rising.
    position : array_like (d,) or (n, d), m
        Where a particle, or each of n, starts.
    diameter : float, m
    density_ratio : float, dimensionless
        Density of the particle over that of the fluid, 0 or greater.
    viscosity : float, m²/s
        Kinematic.
    gravity : array_like (3,) or (d,), m/s²
        In two dimensions a third component is normal to the plane and has no effect; so the default does not act there.
    initial_velocity, initial_slip : array_like (d,) or (n, d), or None; m/s
        Velocity of the particle, or its velocity less the fluid's, at the start; at most one of the two. Neither: no slip. The history remembers the
        slip at the start.
    drag : "stokes", "schiller_naumann" or callable
        f(Re), what Stokes's drag is multiplied by, Re = |w| d/ν; finite at 0. In terms of a drag coefficient f = C_D Re/24.
    added_mass : float, dimensionless
        The coefficient C: mass of fluid that is accelerated with the sphere over the displaced mass; 0 or greater.
    lift : None or "saffman"
        Saffman's lift in a shear flow, 1.615 ρ √ν d² |ω|^(−1/2) ω × w, ω the vorticity.
    kernel : Kernel or VaryingSlipKernel
        The memory kernel; a VaryingSlipKernel is evaluated at the slip of the moment.
    history : bool
        Whether there is a history force.
    method : Method or None
        As in `solve`; None: Collocation(rtol=1e-6). A tolerance `atol` is in units of each particle's own scales: of slip, and of the path.
    gradient : callable or None
        gradient(t, x) -> (d, d), entries ∂u_i/∂x_j in 1/s. None: central differences of fourth order over d/32, with a relative error of about
        (d/32L)⁴/30 + 2e-16 (|x| + L) 32/d for a flow that varies within L. They ask for the velocity as far as d/16 around the particle.
    material_derivative : callable or None
        material_derivative(t, x) -> (d,), Du/Dt in m/s². None: from the gradient and from differences in time over d²/(128 ν), which ask for the velocity up to
        d²/(64 ν) before and after the time span.
    t_eval : array_like (n_times,) or None, seconds
        Times of the result. None: for one particle the ends of the steps (the time of a jump twice, before and after), for several 101 equal times.
    events : callable or list of callables, or None
        event(t, position, velocity) -> float, an event where it changes sign, with the attributes of events of `solve`: `terminal`, `direction`
        and `jump`, jump(t, position, velocity) -> velocity after it, for a wall; the change is remembered.
    workers : int
        Threads; they run side by side where everything is compiled. A particle's path is bitwise the same whatever their number and the other
        particles.
    density : float, kg/m³
        Density of the fluid; only the forces depend on it.

    Returns
    -------
    xarray.Dataset
        `position` (m), `velocity` and `slip` (m/s) over (particle, time, component), NaN after the end of a particle's path; `force` (N) over (kind,
        particle, time, component) with the kinds weight (less buoyancy), drag, added_mass, pressure_gradient (the force of the undisturbed flow,
        ρ V Du/Dt) and, if they act, lift and history: their sum is mass times acceleration, except at the very time of a jump of the slip, where
        the history force is infinite unless the kernel is bounded. `status` (particle): 0 end reached, 1 terminal event, 2 at rest, 3 left the
        grid, −1 failure; `end_time` (s). With events also `event_time`, `event_number`, `event_particle`, `event_position` and
        `event_velocity` (before the jump) over (occurrence). `to_netcdf(path, engine="scipy")` writes it.

    Raises
    ------
    ValueError, TypeError
        One sentence that names the argument. A failure on the way is a status; its message is in the attribute `failures`.

    Notes
    -----
    Faxén's corrections are left out (they are of the order (d/L)²), and so is the effect of walls and of other particles. The added mass feels
    Du/Dt, along the path of the fluid (Auton, Hunt & Prud'homme 1988); the original equation has du/dt along that of the particle.
    Schiller & Naumann's law holds for Re < 1000, Saffman's lift for √(|ω| d²/ν) much greater than Re and much less than 1.

    References
    ----------
    Maxey & Riley (1983), Phys. Fluids 26, 883; Auton, Hunt & Prud'homme (1988), J. Fluid Mech. 197, 241; Schiller & Naumann (1933), Z. Ver. Dtsch.
    Ing. 77, 318; Saffman (1965), J. Fluid Mech. 22, 385, and 31, 624 (1968).

    Examples
    --------
    A grain of sand of 50 µm falls from rest in water; after a tenth of a second it is still 4 per cent slower than Stokes's velocity: history.

    >>> ds = maxey_riley(lambda t, x: np.zeros(3), (0.0, 0.1), [0.0, 0.0, 0.0], diameter=5e-5, density_ratio=2.65, viscosity=1e-6)
    >>> stokes = (2.65 - 1.0) * 9.81 * 5e-5**2 / 18e-6
    >>> round(float(-ds.velocity[0, -1, 2] / stokes), 2)
    0.96
    """
    from basset.particles import _march, _result, _sources  # load the compiler

    places = _validate.real_array("position", position)
    many, d = places.ndim == 2, places.shape[-1] if places.ndim else 0
    if places.ndim not in (1, 2) or d not in (2, 3) or not places.size or not np.isfinite(places).all():
        raise ValueError(f"position must be finite with 2 or 3 components, or a row of them per particle, got {_validate.shown(position)}")
    places = places.reshape(-1, d)
    _check_flow(velocity, gradient, material_derivative, d)
    sphere = _sphere(diameter, density_ratio, viscosity, gravity, added_mass, d)
    fluid, workers = _validate.positive("density", density, "kg/m³"), _validate.integer("workers", workers, 1)
    if isinstance(drag, str) or not callable(drag):
        _validate.choice("drag", drag, ("stokes", "schiller_naumann"))
    if lift is not None:
        _validate.choice("lift", lift, ("saffman",))
    if not isinstance(history, (bool, np.bool_)):
        raise TypeError(f"history must be True or False, got {_validate.shown(history)}")
    method = Collocation() if method is None else method
    sources = _sources.Sources(d, velocity, gradient, material_derivative, drag, lift, sphere)
    coefficient = 9.0 / diameter * math.sqrt(viscosity / math.pi) / (density_ratio + added_mass) if history else 0.0
    task = _task(sources.motion, t_span, np.zeros(2 * d), range(d, 2 * d), coefficient, kernel, None, (), None, STEPS, ())
    _check_memory(method, kernel if history else BassetKernel(), diameter, viscosity)
    wanted = _wanted(t_eval, task)
    if wanted is None and many:
        wanted = np.linspace(task.start, task.end, TIMES)
    if isinstance(velocity, Flow):
        velocity._check(task.start, task.end, places)
    _sources.tried(sources, task.start, places[0])
    now = _sources.fields_at(sources, task.start, places)
    slip = _first_slip(initial_velocity, initial_slip, places, now[:, :d])
    scales = _scales(sphere, now, slip, task.end - task.start)
    if isinstance(kernel, VaryingSlipKernel) and history:
        speed = scales[:, 1] = 2.0 ** round(math.log2(kernel.slip_range[1]))  # one for all: it is in the kernel
        span = kernel.slip_range[0] / speed, kernel.slip_range[1] / speed
        task = replace(task, kernel=replace(kernel, diameter=diameter / speed, viscosity=viscosity / speed**2, slip_range=span))
    listed, leaves = _events(events, sources, task.start, places[0], now[0, :d] + slip[0]), -1
    if sources.leaves is not None:
        leaves = len(listed)
        listed.append(Event(sources.leaves, (), leaves, 1, -1.0))
    slips = slip / scales[:, 1:]
    starts = np.concatenate([places / scales[:, :1], slips], axis=1)
    swarm = _march.Swarm(sources, replace(task, events=listed), method, starts, slips, scales, wanted, leaves)
    about = {
        "diameter": float(diameter), "density_ratio": float(density_ratio), "viscosity": float(viscosity), "gravity": sphere[2 : 2 + d],
        "added_mass": float(added_mass), "density": fluid, "drag": drag if isinstance(drag, str) else getattr(drag, "__name__", "of the user"),
        "lift": lift or "none", "kernel": repr(kernel) if history else "none", "method": repr(method),
    }  # fmt: skip
    return _result.dataset(swarm.paths(workers), swarm, bool(history), fluid * math.pi / 6.0 * diameter**3, about)


def _check_flow(velocity: Any, gradient: Any, material_derivative: Any, d: int) -> None:
    """Refuse what is no velocity field in d dimensions."""
    flow = isinstance(velocity, Flow)
    if not flow and not callable(velocity):
        raise TypeError(f"velocity must be callable as velocity(t, x), or a basset.Flow, got {_validate.shown(velocity)}")
    if flow and velocity.dimensions != d:
        raise ValueError(f"position must have the {velocity.dimensions} components of the flow, got {d}")
    for name, given in (("gradient", gradient), ("material_derivative", material_derivative)):
        if given is not None and not callable(given):
            raise TypeError(f"{name} must be callable as {name}(t, x), got {_validate.shown(given)}")
        if given is not None and flow:
            raise ValueError(f"{name} must not be given with a Flow, which has its own")


def _sphere(diameter: Any, density_ratio: Any, viscosity: Any, gravity: ArrayLike, added_mass: Any, d: int) -> Floats:
    """The numbers of the equation, in the order of `_equation`."""
    size, ratio = _validate.positive("diameter", diameter, "m"), _validate.non_negative("density_ratio", density_ratio)
    nu, added = _validate.positive("viscosity", viscosity, "m²/s"), _validate.non_negative("added_mass", added_mass)
    if ratio + added <= 0.0:
        raise ValueError("density_ratio and added_mass must not both be 0: nothing would have inertia")
    weight = _validate.real_array("gravity", gravity)
    if weight.shape not in ((d,), (3,)) or not np.isfinite(weight).all():
        raise ValueError(f"gravity must be {'2 or ' * (d == 2)}3 finite numbers in m/s², got {_validate.shown(gravity)}")
    lift = 6.0 / math.pi * SAFFMAN * math.sqrt(nu) / size
    return np.array([ratio, added, *np.append(weight, 0.0)[:3], 18.0 * nu / size**2, lift, size / nu, size / NEAR, size**2 / (SOON * nu)])


def _check_memory(method: Any, kernel: Any, diameter: float, viscosity: float) -> None:
    """Refuse methods and kernels that do not fit the sphere."""
    if not isinstance(method, Method):
        raise TypeError(f"method must be a method such as basset.Collocation(rtol=1e-6), got {_validate.shown(method)}")
    for name, wanted in (("diameter", diameter), ("viscosity", viscosity)):
        own = getattr(kernel, name, wanted)
        if not math.isclose(own, wanted, rel_tol=1e-9):
            raise ValueError(f"{name} of the kernel must be that of the particle's equation, {wanted:g}, got {own:g}")
    if isinstance(kernel, VaryingSlipKernel):
        if not method._follows_slip:
            raise ValueError(f"a VaryingSlipKernel needs method=Collocation(...), got {method!r}")
        if kernel.slip_at != "t":
            raise ValueError(f'the VaryingSlipKernel of maxey_riley must have slip_at="t", got "{kernel.slip_at}"')


def _first_slip(velocity: ArrayLike | None, slip: ArrayLike | None, places: Floats, fluid: Floats) -> Floats:
    """The slip of every particle at the start."""
    if velocity is not None and slip is not None:
        raise ValueError("initial_velocity and initial_slip must not both be given")
    if velocity is not None:
        return _rows("initial_velocity", velocity, places) - fluid
    return np.zeros_like(places) if slip is None else _rows("initial_slip", slip, places)


def _rows(name: str, given: ArrayLike, places: Floats) -> Floats:
    """Velocities, one per particle or one for all."""
    array = _validate.real_array(name, given)
    if array.shape not in (places.shape, places.shape[1:]) or not np.isfinite(array).all():
        raise ValueError(
            f"{name} must hold {places.shape[1]} finite components in m/s, for all or for each of {len(places)} particles, got {_validate.shown(given)}"
        )
    return np.broadcast_to(array, places.shape).copy()


def _scales(numbers: Floats, now: Floats, slip: Floats, span: float) -> Floats:
    """Length and speed of each particle, powers of two, in which `atol` is meant; of the particle alone, so that others change no bit."""
    d = slip.shape[1]
    ratio, added, rate = numbers[0], numbers[1], numbers[5]
    drive = np.abs((1.0 - ratio) * (now[:, 12 : 12 + d] - numbers[2 : 2 + d])).max(axis=1)
    fluid, first = np.abs(now[:, :d]).max(axis=1), np.abs(slip).max(axis=1)
    speed = np.maximum(first, drive * min(1.0 / rate, span / (ratio + added)))
    along = np.maximum(fluid, speed) * span
    diameter = numbers[8] * NEAR
    speed = np.maximum(speed, 1e-3 * fluid)
    speed[speed == 0.0] = diameter / span
    return np.asarray(np.exp2(np.round(np.log2(np.stack([np.maximum(along, diameter), speed], axis=1)))))


def _events(given: Any, sources: Any, t: float, x: Floats, v: Floats) -> list[Event]:
    """Events of position and velocity as events of the state."""
    from basset.particles import _sources
    from basset.solvers.base import returned

    if not (given is None or callable(given) or np.iterable(given)):
        raise TypeError(f"events must be a callable event(t, position, velocity) or a list of them, got {_validate.shown(given)}")
    listed = []
    for index, function in enumerate([] if given is None else [given] if callable(given) else list(given)):
        if not callable(function):
            raise TypeError(f"events must be callables event(t, position, velocity), got {_validate.shown(function)}")
        jump = getattr(function, "jump", None)
        if jump is not None:
            if not callable(jump):
                raise TypeError(f"jump of event {index} must be callable as jump(t, position, velocity), got {_validate.shown(jump)}")
            _sources.checked(f"jump of event {index} must return {len(x)} components of the velocity after it", jump(t, x.copy(), v.copy()), x.shape)
        returned(f"event {index} must return a number", np.reshape(function(t, x.copy(), v.copy()), -1), 1)
        direction = _validate.number(f"direction of event {index}", getattr(function, "direction", 0.0))
        value, after = sources.watched(function, jump)
        listed.append(Event(value, (), index, _terminal(index, getattr(function, "terminal", None)), direction, after))
    return listed
