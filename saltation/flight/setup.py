"""From a scene to flights: the tables of the collocation, shared by all grains of a scene, and the loop that enters compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from basset._compile import placed
from basset.exponentials import ExponentialSum, _geometric
from basset.kernels import BassetKernel, Floats
from basset.solvers import stepper
from basset.solvers._tables import StepTables, following, stages_of, tables_of
from basset.spectrum import STAYS, Following
from saltation._random import uniforms
from saltation.bed.rebound import GarciaNino, Restitution, SlidingOnly, Tsuji, TsujiPrinted
from saltation.bed.roughness import READINGS, ROUGHNESS, Roughness, faces_downstream
from saltation.effects import EFFECTS, turbulence
from saltation.effects.base import NoTorque
from saltation.effects.history import KERNELS
from saltation.effects.rotation import prescribed_spin
from saltation.flight import contact, equations, layout, loop
from saltation.flow import Still, tabulated
from saltation.scene import Bed, Scene

SPAN = 16.0  # d/V: the longest step of a flight from a bed; longer where flights may last longer or have no end
FLOOR = 1e-5  # d/V: the shortest, unless the horizon asks for longer ones
FLOOR_OF_CLOSE_CONTACTS = 1e-7  # d/V: of grains with each other, and with planes that face downstream
RANGE = 0.999e12  # longest over shortest lag of the tabulated sums
FOLLOWED = 10.0  # of the horizon, for the weights that follow the slip, see basset.spectrum
EASY = 1e7  # d/V: a sum that reaches farther makes the shortest step too long for some takeoffs
BRIEF = 1e5  # d/V: the first sum where nothing jumps but at the start
DEFAULT_FIRST = 0.02
SAFETY = 10.0  # factor by which the local estimate of a regular step exceeds the error: measured, see tests/saltation/test_convergence.py
ATOL = 1.0  # of velocities and spins, in V and V/d
PATIENCE = 50.0  # flights shorter than layout.SHORTEST_FLIGHT in a row that are rest
SINGULAR_FACTOR = 20.0  # factor of a singular step's error: its estimate is no overestimate, as a regular step's is, and its error stays in the memory
QUICK = 10.0  # V: a large slip after a takeoff
LAYER = 0.01  # d: the height over which the shear at the wall changes
LEFT = 0.001  # d above a wall: from here on lubrication tells how long a grain that leaves it flies; at the asperities it tells how fast it leaves them
FELT = 50.0  # a kernel's powers of time over the part of them that a singular step misses
AMONG_EDDIES = 4.0  # what the first step after a jump and the iterations of the others leave is held to so much less: eddies keep it from fading
NEVER = -math.inf  # count of refused steps: the stepper never takes the equation for one with unknown kinks
NOTHING_LOGGED = np.zeros(1)
PATIENCE_IN_STEPS = 62.5  # steps at least in the longest flight, as many as SPAN is in the usual one


@lru_cache(maxsize=16)
def tables_for(
    stages: int, rtol: float, horizon: float | None, floor: float = FLOOR, span: float = SPAN, faint: float = 0.0, follows: bool = False
) -> StepTables:
    """Shared tables; horizon None: no memory. `follows`: the kernel follows the slip.

    `faint`, d/V: of lags up to here only those of a jump count, which no step is below.
    """
    if horizon is None:
        return tables_of(stages, None, BassetKernel(), floor, span)
    first = floor * stages_of(stages).c[0]  # the first stage behind a step of that size
    far = max(FOLLOWED * horizon if follows else horizon, 10.0 * first)
    near = max(first, far / RANGE)
    if near > max(first, min(faint, floor)):
        return tables_of(stages, _geometric(first, horizon, rtol, BassetKernel()), BassetKernel(), floor, span)
    while True:
        try:
            return tables_of(stages, ExponentialSum.fit(near, far, rtol), BassetKernel(), near if near <= faint else floor, span)
        except ValueError:
            if rtol > 1e-4:
                raise
            rtol *= 2.0  # until a tabulated sum is that exact


def first_horizon(scene: Scene) -> float:
    """How far the memory of a run reaches at first, d/V: the scene's horizon, unless that is long and a shorter one may do."""
    if scene.widens:
        return float(min(scene.horizon, BRIEF, 0.1 * RANGE * shortest(scene)))
    needed = 0.0 if scene.run.duration is None else 1.01 * scene.run.duration / scene.numbers.time
    return float(min(scene.horizon, max(min(EASY, 0.1 * RANGE * shortest(scene)), needed)))


def relaxation(scene: Scene) -> float:
    """The shorter of the times in which drag and history slow a grain down, d/V: steps must be able to resolve it."""
    n, names = scene.numbers, scene.names
    drag = n.reynolds / (18.0 * n.alpha) if "drag" in names or "wall" in names else math.inf
    return min(drag, 1.0 / (math.pi * n.history**2)) if "history" in names else drag


class Accuracy(NamedTuple):
    """What `solver.rtol` comes to: stages, relative tolerance of a step, factor of a singular step's error, whether the kernel follows the slip,
    and what iterations may leave of a step's error.
    """

    stages: int
    tolerance: float
    singular_factor: float
    follows: bool
    settled: float


def accuracy(scene: Any) -> Accuracy:
    """Of the steps of a scene."""
    rtol = scene.solver.rtol
    follows = scene.solver.method == "collocation" and "history" in scene.names and scene.options("history").kernel != "basset"
    # after a jump the solution with a kernel that follows the slip has powers of √t that the step's polynomial has not
    factor = 4.0 * SINGULAR_FACTOR if follows else SINGULAR_FACTOR
    eddies = "turbulence" in scene.names and scene.options("turbulence").amplitude > 0.0
    stages, strict = max(4, round(-1.1 * math.log10(rtol) - 0.5)), AMONG_EDDIES if eddies else 1.0
    # estimates of steps of higher order than the splines of the eddies are too small across their knots
    safety = SAFETY / strict if stages > turbulence.SPLINE + 1 else SAFETY
    return Accuracy(stages, min(safety * rtol, 0.03), strict * factor, follows, stepper.SETTLED / strict)


def shortest(scene: Any) -> float:
    """The shortest step, d/V: by it the first one after a jump keeps the tolerance also where flights are short."""
    n, time, (stages, tolerance, singular_factor, follows, _) = scene.numbers, relaxation(scene), accuracy(scene)
    error = tolerance / singular_factor * min(1.0, max(loop.SHORTEST, 0.4 * time))
    step = time * min(0.1, error ** (2.0 / (stages + 1))) if time < math.inf else math.inf
    if follows:  # K/K_Basset is a series in (C^(2/3) t)^(3/(2 c1))
        c1, c2 = KERNELS[scene.options("history").kernel]
        power, stretch = 1.5 / c1, (0.25 * math.pi) ** (1.0 / 3.0) * n.reynolds * (QUICK / (0.75 + c2 * QUICK * n.reynolds)) ** 2
        step = min(step, (FELT * error / (n.history * stretch**power)) ** (1.0 / (0.5 + power)))
    if scene.bed is None and "drag" in scene.names and not isinstance(scene.profile, Still):  # nothing stops a fall before it reaches the wall
        step = min(step, LAYER * 18.0 * abs(n.shields) / n.reynolds)
    if "wall" in scene.names:  # the gap that asperities leave is crossed in steps
        step = min(step, 0.2 * scene.options("wall").roughness)
    close = "encounters" in scene.names or (scene.bed is not None and faces_downstream(roughness_of(scene)))
    return min(FLOOR_OF_CLOSE_CONTACTS if close else FLOOR, 0.1 * step)


def roughness_of(scene: Scene) -> Roughness:
    """How contact planes are drawn, of a scene with a bed."""
    bed = scene.bed
    assert bed is not None
    scatter = 1.0 if bed.span_scatter and not scene.in_plane else 0.0
    found: Roughness = ROUGHNESS[bed.roughness](READINGS.index(bed.reading), 2.0 * bed.smallest_offset, scatter, 0.5 if bed.roughness == "flat" else 0.25)
    return found


class Engine:
    """One scene prepared to fly: everything that does not change, for any number of grains.

    `horizon` (d/V): how far its memory reaches, in place of the scene's.
    """

    def __init__(self, scene: Scene, horizon: float | None = None) -> None:
        numbers, names = scene.numbers, scene.names
        self.scene, self.numbers = scene, numbers
        self._kept: list[Any] = []  # what addresses point to
        self.profile = scene.profile if isinstance(scene.profile, Still) else tabulated(scene.profile)
        setting = scene._setting(self.profile)
        built = {name: EFFECTS[name].build(scene.options(name), setting) for name in names}
        self.force_names = tuple(name for name in names if hasattr(built[name], "force"))
        forces = tuple(built[name] for name in self.force_names)
        self.rotation = built.get("rotation")
        self.eddies = built.get("turbulence")
        floor = -math.inf if isinstance(scene.profile, Still) else scene.profile.floor
        kinks = (floor - 0.5, floor, floor + 0.5) if "lift" in names else (floor, floor, floor)
        self.dimensions = 2 if scene.in_plane else 3
        across, turning = None if scene.in_plane else 1.0, None if self.rotation is None else 1.0
        torque = NoTorque(0.0) if self.rotation is None else self.rotation
        self.equation = equations.Equation(numbers.alpha, self.profile, floor, forces, torque, across, turning, self.eddies)
        self.kinks, self.spins = kinks, 0 if self.rotation is None else 1 if scene.in_plane else 3
        self.states, self.own = 2 * self.dimensions + self.spins, 4
        if self.eddies is not None:
            self.states, self.own = self.states + turbulence.STATES, turbulence.OWN + turbulence.SLOTS * turbulence.SLOT
        self.members = self.dimensions if "history" in names else 0
        self.prescribed = None
        if "rotation" in names and scene.options("rotation").law == "prescribed":
            assert numbers.stage is not None
            self.prescribed = prescribed_spin(numbers.stage)
        rtol = scene.solver.rtol
        stages, tolerance, factor, follows, settled = accuracy(scene)
        horizon = (first_horizon(scene) if horizon is None else horizon) if self.members else None
        end = scene.end
        span = SPAN
        if scene.cloud is None:  # steps grow with what a flight may last
            longest = min(end, scene.longest_flight / PATIENCE_IN_STEPS) if scene.bed is not None else end
            span = SPAN * 2.0 ** max(0, math.ceil(math.log2(longest / SPAN)))
        floor = shortest(scene)
        faint = tolerance / numbers.history**2 if self.members else 0.0
        self.tables = tables_for(stages, min(1e-6, 0.1 * rtol), horizon, floor, span, faint, follows)
        self.end = end
        if scene.widens and horizon is not None:
            end = min(end, horizon)  # then a longer memory takes over
        where = np.arange(self.dimensions, self.dimensions + self.members)
        strength = np.full(self.members, numbers.history)
        self.horizon = horizon if horizon is not None else math.inf
        least, rest = self.tables.floor, {"singular_factor": factor, "settled": settled}
        self.problem = stepper.Problem(end, span, span, least, tolerance, ATOL * tolerance, 10**12, where, strength, **rest)
        points = 16 if rtol >= 1e-6 else 48
        self.rates = np.array(self.tables.tail.rates) if self.tables.tail is not None else np.empty(0)
        self.truncation = stepper.truncation_of(self.rates, points, 16.0 if rtol >= 1e-6 else 40.0, stages)
        shortest_hop, patience = layout.SHORTEST_FLIGHT, PATIENCE
        if scene.rests is not None:  # up to the rise and back by weight alone
            shortest_hop, patience = max(shortest_hop, 2.0 * math.sqrt(2.0 * scene.rests.rise * numbers.shields / numbers.alpha)), 1.0
        self.limits = layout.Limits(
            scene.longest_flight,
            shortest_hop,
            patience,
            float(scene.run.jumps or math.inf),
            int(self.prescribed is not None),
            LEFT * ("wall" in names),
        )

    @cached_property
    def model(self) -> layout.Model:
        """The equation for the loop; the first of its kind is compiled."""
        rates, data = equations.rates_entry(self.equation)
        self._kept.append(data)
        return layout.Model(rates, tabulated(self.scene.profile), self.kinks, self.dimensions, self.spins, self.eddies)

    @cached_property
    def bed(self) -> layout.Bed | None:
        """The bed for the loop; the first rebound of its kind is compiled."""
        if self.scene.bed is None:
            return None
        rebound, data = contact.rebound_entry(self.rebound)
        self._kept.append(data)
        roughness = roughness_of(self.scene)
        return layout.Bed(rebound, roughness, 1.0 - roughness.depth + 1e-9, self.scene.run.seed, 0)

    @cached_property
    def following(self) -> Following:
        """How the kernel follows the slip; its tables are made when something flies."""
        if not accuracy(self.scene).follows:
            return STAYS
        tail = self.tables.tail
        assert tail is not None
        matched = max(self.horizon, 2.0 * tail.near) if tail.far > self.horizon else None  # sums for any range have no slow terms to match
        reynolds = self.numbers.reynolds
        constants = KERNELS[self.scene.options("history").kernel]
        return following(self.tables.count, tail, constants, reynolds, reynolds, (0.0, math.inf), matched)

    def _restitution(self, bed: Bed) -> Restitution:
        stokes = self.numbers.stokes(1.0)
        if bed.restitution == "set1":
            assert self.numbers.stage is not None
            return Restitution(max(0.0, 0.75 - 0.25 * self.numbers.stage), 0.0, stokes)
        if bed.restitution == "stokes":
            return Restitution(0.97, self.scene.stokes_decay, stokes)
        return Restitution(float(bed.restitution), 0.0, stokes)

    @cached_property
    def rebound(self) -> Any:
        """The law of rebounds, of a scene with a bed."""
        bed = self.scene.bed
        assert bed is not None
        restitution, friction, retention = self._restitution(bed), bed.friction or 0.0, bed.tangential_retention or 0.0  # given where they count
        added = 1.0 + self.numbers.added_mass / self.numbers.density_ratio if bed.contact_mass == "immersed" else 1.0
        rebounds: dict[str, Callable[[], Any]] = {
            "tsuji": lambda: Tsuji(restitution, friction, added),
            "garcia_nino": lambda: GarciaNino(restitution, retention),
            "tsuji_printed": lambda: TsujiPrinted(restitution, friction),
            "sliding_only": lambda: SlidingOnly(restitution, friction),
        }
        return rebounds[bed.rebound]()

    def bed_of(self, grain: int) -> layout.Bed:
        """The bed as a grain finds it: its draws are its own."""
        if self.bed is None:  # out of reach
            return layout.Bed(self.model.rates, ROUGHNESS["flat"](READINGS.index("clip"), 0.0, 0.0, 0.5), -math.inf, 0, grain)
        return self.bed._replace(grain=grain)

    def memory(self, jumps: int = 0) -> layout.Memory:
        """Treatment of the history force at contacts; with `jumps` the memory reaches back over so many."""
        before, when = np.zeros((jumps, self.members, len(self.rates))), np.zeros(jumps)
        rebound = ("impulse", "restart", "reset", "none").index(self.scene.options("history").rebound) if self.members else 0
        return layout.Memory(rebound, self.horizon, before, when)

    def first(self) -> Start:
        """The scene's first takeoff."""
        start, numbers = self.scene.start, self.numbers
        height = self.contact_height if start.height is None else start.height / numbers.diameter
        velocity = (2.0, 0.0, 2.0)
        if start.velocity is not None:
            u, v, w = start.velocity
            velocity = u / numbers.velocity, v / numbers.velocity, w / numbers.velocity
        spin = (0.0, 2.0, 0.0) if self.scene.turns and start.velocity is None else (0.0, 0.0, 0.0)
        if start.spin is not None:
            x, y, z = start.spin
            spin = x * numbers.time, y * numbers.time, z * numbers.time
        if self.prescribed is not None:
            spin = (0.0, self.prescribed, 0.0)
        return Start((0.0, 0.0, height), velocity, spin)

    def state_of(self, start: Start, own: Floats, clock: float = turbulence.BEGINS) -> Floats:
        """The states of a grain that starts so, at that time of its eddies."""
        d, (x, across, z), (u, v, w) = self.dimensions, start.position, start.velocity
        stream = equations.stream_at(self.model, z, clock, 0.0, own)
        slip = u - stream[0]
        if self.eddies is not None:
            v, w = v - stream[1], w - stream[2]
        states = [x, z, slip, w] if d == 2 else [x, across, z, slip, v, w]
        if self.rotation is not None:
            states += [start.spin[1]] if d == 2 else list(start.spin)
        if self.eddies is not None:
            states += [clock, 0.0, 0.0]
        return np.array(states, dtype=np.float64)

    def rest(self, grain: int, state: stepper.State, spin: Floats, flight: Any) -> None:
        """Let a grain of that number rest where it has landed, and take off as at the start of the run; the rest is one of its draws."""
        d, control = self.dimensions, state.control
        rests, first = self.scene.rests, self.first()
        assert rests is not None
        draw = uniforms(self.scene.run.seed, grain, int(flight.impacts))[0]
        lasting = -math.log(draw) / (rests.entrainment * self.numbers.time)
        time, y = float(control[0].time) + lasting, state.y
        place = (float(y[0]), 0.0 if d == 2 else float(y[1]), float(y[d - 1]))
        clock = turbulence.BEGINS if self.eddies is None else float(y[-turbulence.STATES]) + lasting * self.eddies_pass(place[2])
        y[:] = self.state_of(Start(place, first.velocity, first.spin), spin, clock)
        state.past[:] = 0.0
        state.jump[:] = y[d : d + self.members]
        control[:] = stepper.start_control(time, max(DEFAULT_FIRST, 2.0 * self.problem.floor), self.members > 0)
        control[0].refusals = NEVER
        spin[:4] = *first.spin, equations.layer_of(self.model, place[2], first.velocity[2])
        contact.take_off(flight, time, *place, *first.velocity)
        flight.impacts += 1
        flight.short = 0

    def eddies_pass(self, z: float) -> float:
        """How many time scales of the eddies at a height pass in d/u*: 1/T_L."""
        options = self.scene.options("turbulence")
        return 1.0 / float(turbulence.profiles_of(options, self.scene._setting(self.profile), z).time)

    def own_of(self, spin: Any, grain: int) -> Floats:
        """What a grain has besides its states: its spin, its layer, and in a turbulent stream which grain it is and room for its eddies."""
        own = np.zeros(self.own)
        own[:3] = spin
        if self.eddies is not None:
            own[turbulence.OWN - 1] = grain
        return own

    @property
    def contact_height(self) -> float:
        """Height of a centre in contact with an untilted bed, d."""
        return 0.5 if self.scene.bed is not None and self.scene.bed.roughness == "flat" else 0.75

    def steps(
        self,
        limits: layout.Limits,
        bed: layout.Bed,
        memory: layout.Memory,
        state: stepper.State,
        own: Floats,
        account: Any,
        values: Floats,
        record: stepper.Record,
        jumps: Floats,
        problem: stepper.Problem,
    ) -> tuple[loop.Steps, Any]:
        """How a grain in that state flies; and what must be kept alive meanwhile."""
        d, tables, model = self.dimensions, self.tables, self.model
        alike = 1 if "wall" in self.scene.names else d  # a wall damps what is normal to it more than the rest
        equation = stepper.Equation(model.rates, own, np.zeros(0, dtype=np.bool_), d, d - 1, alike, turbulence.STATES if self.eddies is not None else 0)
        work = stepper.workspace(tables.count, self.states, diagonal=True)
        parts = placed(stepper.Parts(equation, problem, *tables.placed, tables.odd(), tables.unit, state, values, self.following, self.truncation, work))
        whole = placed(loop.Flight(parts, model, bed, memory, limits, account, np.zeros((2, 9))))
        attempt, kept = self.attempt(parts)
        accept, truncate = (bind(parts)[0] for bind in (stepper.accept_entry, stepper.truncate_entry))
        look, land = (bind(whole)[0] for bind in (loop.look_entry, loop.land_entry))
        return loop.Steps(whole, attempt, accept, truncate, look, land, record, jumps), kept

    def attempt(self, parts: Any, problem: stepper.Problem | None = None) -> tuple[Any, Any]:
        """The search for a step, of another problem if one is given; and what must be kept alive meanwhile."""
        if problem is not None:
            fields: dict[str, Any] = {name: getattr(parts, name) for name in stepper.Parts._fields}
            parts = placed(stepper.Parts(**fields | {"problem": problem}))
        found: tuple[Any, Any] = stepper.attempt_entry(stepper.Attempt(parts, stepper.diagonally_entry(parts)[0]))
        return found


class Start(NamedTuple):
    """The start of a grain: position (d), velocity (V), spin (V/d)."""

    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    spin: tuple[float, float, float]


class Grain:
    """One grain during a run: its state, memory and record of the flight, as plain arrays."""

    def __init__(self, engine: Engine, grain: int = 0, start: Start | None = None) -> None:
        self.engine = engine
        n, members, d, terms = engine.states, engine.members, engine.dimensions, len(engine.rates)
        first = engine.first() if start is None else start
        self.spin = engine.own_of(first.spin, grain)
        y = engine.state_of(first, self.spin)
        control = stepper.start_control(0.0, max(DEFAULT_FIRST, 2.0 * engine.problem.floor), members > 0)
        control[0].refusals = NEVER
        jump = y[d : d + members].copy()
        self.state = stepper.State(y, np.zeros(n), np.zeros((members, terms)), jump, np.zeros((1, n)), control)
        self.spin[3] = equations.layer_of(engine.model, first.position[2], first.velocity[2])
        self.flight = np.zeros(1, dtype=layout.FLIGHT)
        contact.take_off(self.flight[0], 0.0, *first.position, *first.velocity)
        options = engine.scene.options("history") if members else None
        kept = None if options is None else options.window_jumps
        self.memory = engine.memory(kept or 0)
        self.bed = engine.bed_of(grain)
        self.values = np.zeros((engine.tables.count, n))
        self._bound: tuple[tuple[Any, ...], Any] | None = None

    def rest(self) -> None:
        """Lie where it has landed, and take off anew, without a memory."""
        self.engine.rest(self.bed.grain, self.state, self.spin, self.flight[0])
        self.memory.before[:] = 0.0
        self._bound = None

    def fly(self, record: stepper.Record, recording: bool, jumps: Floats) -> tuple[int, int]:
        """Fly until the caller is needed. (code, steps recorded)."""
        engine = self.engine
        given = (engine, engine.problem, engine.limits, self.bed, self.memory, self.state, self.spin, self.flight, self.values, record, jumps)
        if self._bound is None or any(one is not other for one, other in zip(self._bound[0], given, strict=True)):
            engine.tables.fill_all()
            steps, kept = engine.steps(*given[2:], problem=engine.problem)
            if engine.scene.bed is not None and self.state.control[0].steps == 0:
                loop.set_tolerance(steps.flight, math.inf)
            self._bound = given, (steps, loop.fly_entry(steps), placed(record), kept)
        steps, (watch, _), log, _ = self._bound[1]
        code, done = stepper.march(steps.attempt, watch, True, steps.flight.parts, NOTHING_LOGGED, 1, log, recording)
        return code, done


def empty_record(steps: int, stages: int, states: int) -> stepper.Record:
    """Room for so many steps."""
    shapes: tuple[Any, ...] = (steps, steps, steps, steps, (steps, states), (steps, stages, states), steps, (steps, 0), (steps, 0))
    return stepper.Record(*(np.zeros(shape) for shape in shapes))
