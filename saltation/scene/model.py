"""What is simulated: a scene in TOML, validated, in SI units. Nothing that a scene does not name is computed.

The tables of effects are found in `saltation/effects`: each file brings its own options.
"""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ModelWrapValidatorHandler, ValidationError, create_model, model_validator

from basset import _validate
from basset.quadrature import SCHEMES, Daitche, full_history
from saltation._tables import Table
from saltation.effects import EFFECTS
from saltation.effects.base import Setting
from saltation.effects.history import DECAYS, kernel_of
from saltation.flow import PROFILES, Laden, profile_of, rougher, saltation_layer
from saltation.grain import Numbers, numbers_of
from saltation.scene.memory import barred
from saltation.scene.messages import sentence
from saltation.scene.presets import ALL, PRESETS, Preset
from saltation.scene.tables import Bed, Channel, Chosen, Cloud, Coupling, Fluid, Grain, Rests, Run, SceneError, Solver, Start
from saltation.scene.valid import chosen, families

__all__ = ["Scene", "SceneBase", "load", "scene_of", "shipped"]

AUTO = "auto"  # effects: those that are called for, by measurement
LONGEST = 1e9  # d/u*: longer memories lose accuracy by rounding
PATIENCE = 1000.0  # d/u*: a longer flight is taken to be one that never comes down …
FASTEST = 100.0  # V: … unless a grain that leaves the bed so fast would fly longer without drag …
SUSPENDED = 1e6  # d/u*: … or sinks slowly, but in this time
FEWEST, LATEST = 1e-9, 1e15  # d/u*: of a run's duration
MOST_STEPS = 1e8  # fixed ones
MOST_TIMES = 10**7  # that are kept of a cloud
FINEST = 1e-13  # relative error of sums of exponentials
FINEST_STEPS = {"mei_adrian": 1e-8, "dorgan_loth": 1e-7}  # solver.rtol that flights with these kernels keep
SHALLOWEST = 5.0  # d: a channel whose fluctuations have profiles
NARROWEST = 12.0  # d: in a narrower periodic box a grain could meet itself
COUPLINGS = ("none", "roughness", "two_way")  # words for what grains do to the stream
SENSIBLE = (1e-12, 1e12)  # dimensionless numbers outside of this come from wrong units


def _effects(value: Any) -> Any:
    """A preset's name, "auto", or a list of effects."""
    if isinstance(value, str):
        words = (AUTO, *PRESETS)
        if value not in words:
            raise ValueError(f"must be a list of effects or one of {', '.join(map(repr, words))}, got {value!r}{_validate.suggestion(value, words)}")
        return value
    if not isinstance(value, (list, tuple)) or not value:
        raise ValueError(f"must be a list of at least one of {', '.join(map(repr, EFFECTS))}, got {_validate.shown(value)}")
    for name in value:
        if not isinstance(name, str) or name not in EFFECTS:
            hint = _validate.suggestion(name, EFFECTS) if isinstance(name, str) else ""
            hint = f"; a word for all of them stands alone: effects = {name!r}" if name in (AUTO, *PRESETS) else hint
            raise ValueError(f"must hold only {', '.join(map(repr, EFFECTS))}, got {_validate.shown(name)}{hint}")
        if list(value).count(name) > 1:
            raise ValueError(f"must hold each effect once, got {name!r} twice")
    return list(value)


def _words(schema: dict[str, Any]) -> None:
    """What stands for a table of couplings."""
    schema["anyOf"].insert(0, {"enum": list(COUPLINGS)})


def _coupling(value: Any) -> Any:
    """A word, or a table of one of them with its options."""
    if isinstance(value, str):
        if value not in COUPLINGS:
            raise ValueError(f"must be one of {', '.join(map(repr, COUPLINGS))} or a table, got {value!r}{_validate.suggestion(value, COUPLINGS)}")
        return None if value == "none" else {"form": value}
    return value


class SceneBase(Table):
    """What every scene has; `Scene` adds one table per effect.

    Examples
    --------
    >>> scene = load("sand")
    >>> isinstance(scene, SceneBase), scene.in_plane, scene.turns, scene.horizon
    (True, False, True, 4400.0)
    >>> scene.options("drag").law
    'brown_lawler'
    >>> scene.history_rule()
    Exponential(order=3, rtol=1e-06)
    """

    effects: Annotated[list[str] | str, BeforeValidator(_effects)] = Field(description="list of effects, 'auto', or a published model: " + ", ".join(PRESETS))
    defaults: Literal["thesis", "valid"] = Field(
        "thesis",
        description="laws not given: the thesis's; or 'valid': the most recently measured whose range holds the scene, else the nearest (a result lists them)",
    )
    tolerance: float | None = Field(
        None, gt=0.0, le=0.5, description="for effects = 'auto': allowed relative change of mean height, length and velocity, dimensionless; default 0.05"
    )
    chosen: Chosen | None = Field(None, description="how effects = 'auto' was resolved: written with a result, not to be given")
    dimensions: Literal[2, 3] | None = Field(None, description="2: motion in the vertical plane along the stream; default 3, or the preset's")
    fluid: Fluid = Field(Fluid(), description="a table: density and viscosity; default water")
    grain: Grain = Field(description="a table: density and diameter")
    channel: Channel | None = Field(None, description="a table: the stream; leave it out for still water")
    coupling: Annotated[Coupling | None, BeforeValidator(_coupling)] = Field(
        None,
        description="effect of grains on the stream: 'none', 'roughness', 'two_way', or a table with options",
        json_schema_extra=_words,
    )
    bed: Bed | None = Field(None, description="a table: rebound and roughness; leave it out if there is no bed")
    rests: Rests | None = Field(None, description="a table: grains come to rest and are entrained again")
    start: Start = Field(Start(), description="a table: initial velocity, spin and height")
    solver: Solver = Field(Solver(), description="a table: how flights are integrated")
    run: Run = Field(description="a table: length of the run and seed of its random numbers")
    cloud: Cloud | None = Field(None, description="a table: many grains instead of one")

    @property
    def names(self) -> tuple[str, ...]:
        """The effects, a preset's written out; with effects = "auto" all of them."""
        if not isinstance(self.effects, str):
            return tuple(self.effects)
        meeting = ("encounters",) if self.cloud is not None and self.preset.collisions else ()
        eddies = ("turbulence",) if self.effects == AUTO and self.channel is not None and self.channel.depth is not None else ()
        return (*self.preset.effects, *eddies, *meeting)

    @property
    def stokes_decay(self) -> float:
        """Dimensionless k of e = 0.97 exp(−k/St): as given; or what fits measured bounces with the scene's history and kernel; or Gondret's 35.

        They belong together: an e measured from the slopes of a path at a wall includes the history force at the rebound (reports/measured.md).
        """
        if self.bed is not None and self.bed.stokes_decay is not None:
            return self.bed.stokes_decay
        if "history" not in self.names:
            return 35.0
        options = self.options("history")
        return DECAYS[options.rebound][options.kernel]

    @property
    def preset(self) -> Preset:
        """What a word for the effects stands for."""
        return Preset(ALL, 3, collisions="hard") if self.effects == AUTO else PRESETS[str(self.effects)]

    @property
    def in_plane(self) -> bool:
        """Whether the scene has two dimensions."""
        default = self.preset.dimensions if isinstance(self.effects, str) else 3
        return (self.dimensions or default) == 2

    def options(self, name: str) -> Any:
        """The table of an effect: as given, the preset's, or the default.

        Parameters
        ----------
        name : str
            A key of `saltation.effects.EFFECTS`.

        Returns
        -------
        Options of that effect
        """
        given = getattr(self, name)
        if given is not None:
            return given
        preset = self.preset.options.get(name, {}) if isinstance(self.effects, str) else {}
        return EFFECTS[name].Options(**preset)

    def changed(self, **tables: Any) -> Scene:
        """The scene with other fields: tables are merged, other values replaced; a field set to None is removed.

        Parameters
        ----------
        **tables
            Field -> value, or for a table a dictionary of its fields, in their units.

        Returns
        -------
        Scene, validated anew

        Raises
        ------
        SceneError
            If the changed scene is not valid.

        Examples
        --------
        >>> load("sand").changed(run={"jumps": 40}, bed={"roughness": "R1"}).run.jumps
        40
        """
        content = self.model_dump(exclude_none=True)
        if "effects" in tables:
            content.pop("chosen", None)  # it belongs to the effects that were
        content.get("coupling", {}).pop("settled", None)  # it belongs to the scene that was
        for name, value in tables.items():
            merged = {**content.get(name, {}), **value} if isinstance(value, dict) else value
            content[name] = {key: item for key, item in merged.items() if item is not None} if isinstance(merged, dict) else merged
        return scene_of(content)

    @cached_property
    def numbers(self) -> Numbers:
        """The dimensionless numbers."""
        channel = self.channel
        return numbers_of(
            self.fluid.density,
            self.fluid.viscosity,
            self.grain.density,
            self.grain.diameter,
            shear_velocity=channel.shear_velocity if channel else None,
            transport_stage=channel.transport_stage if channel else None,
            slope=math.atan(channel.slope) if channel else 0.0,
            added_mass=self.options("added_mass").coefficient if "added_mass" in self.names else 0.0,
        )

    @cached_property
    def clear(self) -> Any:
        """The profile of the stream without grains."""
        if self.channel is None:
            return profile_of("none", self.numbers)
        height = self.channel.roughness_height or self.grain.diameter
        return profile_of(self.channel.profile, self.numbers, height / self.grain.diameter, self.channel.von_karman)

    @cached_property
    def profile(self) -> Any:
        """The stream's profile, as grains have made it."""
        clear, coupling = self.clear, self.coupling
        if coupling is None or self.channel is None or self.numbers.stage is None:
            return clear
        if coupling.form == "roughness":
            return rougher(clear, 0.056 * saltation_layer(self.numbers.stage, self.grain.diameter))
        depth = math.inf if self.channel.depth is None else self.channel.depth / self.grain.diameter
        found = coupling.settled
        return clear if found is None or not any(found.stress) else Laden(clear, tuple(found.heights), tuple(found.stress), depth)

    def _setting(self, profile: Any) -> Setting:
        """What effects are built from, of a profile or its table."""
        channel, d = self.channel, self.grain.diameter
        if channel is None:
            return Setting(self.numbers, profile)
        depth, roughness = channel.depth or math.inf, channel.roughness_height or d
        return Setting(self.numbers, profile, depth / d, roughness / d, channel.von_karman, self.run.seed)

    @property
    def turns(self) -> bool:
        """Whether anything needs the grain's spin."""
        rebounds = self.bed is not None and self.bed.rebound != "garcia_nino"
        return "magnus" in self.names or "rotation" in self.names or rebounds

    @model_validator(mode="after")
    def _consistent(self) -> SceneBase:
        names = self.names
        if self.tolerance is not None and self.effects != AUTO:
            raise ValueError(f"tolerance belongs to effects = 'auto', which chooses them; here they are given: {self.effects!r}")
        if self.chosen is not None and (self.effects == AUTO or self.chosen.kept != list(names)):
            raise ValueError("chosen records how effects = 'auto' was resolved and does not fit these effects: leave it out")
        if self.effects == AUTO and self.bed is None:
            raise ValueError("effects = 'auto' needs a [bed]: it compares jumps with each effect and without it")
        if self.run.jumps is not None and self.bed is None:
            raise ValueError("run.jumps needs a bed: add a [bed] table, or give run.duration (s)")
        if "magnus" in names:
            contacts = self.bed is not None and self.bed.rebound != "garcia_nino"
            spun = self.start.spin is not None and any(self.start.spin)
            if not ("rotation" in names or contacts or spun):
                raise ValueError(
                    "effects: 'magnus' needs something that turns the grain: add 'rotation', a rebound with friction ('tsuji'), or start.spin (rad/s)"
                )
        if "rotation" in names and self.options("rotation").law == "prescribed" and self.channel is None:
            raise ValueError("rotation.law = 'prescribed' needs a [channel]: its spin is a function of the transport stage")
        if self.bed is not None and self.bed.restitution == "set1" and self.channel is None:
            raise ValueError("bed.restitution = 'set1' needs a [channel]: it is a function of the transport stage")
        velocity, spin = self.start.velocity, self.start.spin
        if self.in_plane and velocity is not None and velocity[1] != 0.0:
            raise ValueError(f"start.velocity must have no component across the stream in two dimensions, got {velocity}")
        if self.in_plane and spin is not None and (spin[0] != 0.0 or spin[2] != 0.0):
            raise ValueError(f"start.spin must be about the y axis alone in two dimensions, got {spin}")
        self._check_numbers()
        self._check_coupling()
        self._check_rests()
        if "turbulence" in names:
            self._check_turbulence()
        self._check_duration()
        if "history" in names:
            self._check_history()
        if self.solver.method != "collocation":
            self._check_steps()
        if "encounters" in names and self.cloud is None:
            raise ValueError("effects: 'encounters' needs more than one grain: add a [cloud] table with number and concentration")
        if self.cloud is not None:
            self._check_cloud(self.cloud)
        return self

    @model_validator(mode="wrap")  # around the one above: a scene that makes no sense has no numbers to choose by
    @classmethod
    def _written_out(cls, content: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """With defaults = "valid" the laws that are not given are written out, so that a result says what was flown."""
        scene = handler(content)
        if scene.defaults == "thesis" or not isinstance(content, dict):
            return scene
        given = {name: dict(table) if isinstance(table, dict) else table for name, table in content.items()}
        preset = scene.preset.options if isinstance(scene.effects, str) else {}
        for family, (name, _) in chosen(scene).items():
            table, closure = family.partition(".")[0], families(scene)[family][name]
            fields = {field for other in families(scene)[family].values() for field in other.take}
            if table not in preset and not fields & set(given.get(table) or {}):
                given[table] = {**(given.get(table) or {}), **closure.take}
        return handler(given)

    def _check_turbulence(self) -> None:
        """Fluctuations need a stream of some depth, and steps that follow them."""
        if self.channel is None:
            raise ValueError("effects: 'turbulence' needs a [channel] with its depth (m): in still water nothing fluctuates")
        if self.channel.depth is None:
            raise ValueError("channel.depth is missing: 'turbulence' needs the depth of the water in m, with which its fluctuations scale")
        if self.channel.depth < SHALLOWEST * self.grain.diameter:
            least = SHALLOWEST * self.grain.diameter
            raise ValueError(f"channel.depth must be {least:.3g} m ({SHALLOWEST:g} d) or more for 'turbulence', got {self.channel.depth:g}")
        if self.solver.method != "collocation":
            raise ValueError(f"effects: 'turbulence' needs solver.method = 'collocation', got {self.solver.method!r}")

    def _check_cloud(self, cloud: Cloud) -> None:
        """Many grains need a duration, those that meet collocation too, and a box that is wide enough."""
        if self.run.duration is None:
            raise ValueError("cloud: a run of many grains ends at a given time: give run.duration (s) instead of run.jumps")
        fixed = self.solver.method != "collocation"
        if fixed and "encounters" in self.names:
            what = "grains meet within a step, and at its end they would overlap"
            raise ValueError(f"effects: 'encounters' at fixed steps: {what}: take solver.method = 'collocation', not {self.solver.method!r}")
        if not fixed and "history" in self.names and self.options("history").window_jumps is not None:
            raise ValueError("cloud: history.window_jumps is for a single grain, or for fixed steps: leave it out")
        if "encounters" in self.names and cloud.boundary == "periodic" and self.box[0] < NARROWEST:
            raise ValueError(
                f"cloud.number = {cloud.number} at this concentration makes a periodic box {self.box[0]:.3g} d long, "
                f"and it must be {NARROWEST:g} d or longer: more grains, a lower cloud.concentration or a thinner cloud.layer"
            )

    @property
    def grains(self) -> Cloud:
        """The table [cloud] of a scene that has one."""
        assert self.cloud is not None
        return self.cloud

    @property
    def end(self) -> float:
        """When the run is over, in units of d/u*; infinite where it is jumps that are counted."""
        return math.inf if self.run.duration is None else self.run.duration / self.numbers.time

    @property
    def box(self) -> tuple[float, float, float]:
        """Length, width and height in d of the volume from which a cloud sets out; a square in plan, one d wide in two dimensions."""
        cloud = self.grains
        height = 2.0 if cloud.layer is None else cloud.layer / self.grain.diameter
        area = cloud.number * math.pi / 6.0 / (cloud.concentration * height)
        return (area, 1.0, height) if self.in_plane else (math.sqrt(area), math.sqrt(area), height)

    def _check_numbers(self) -> None:
        """Refuse a scene whose dimensionless numbers or profile cannot be computed."""
        low, high = SENSIBLE
        try:
            n = self.numbers
            decisive = {"ρ_s/ρ": n.density_ratio, "the Reynolds number V d/ν": n.reynolds}
            if n.density_ratio != 1.0:
                decisive["the Shields parameter"] = abs(n.shields)
            if self.channel is not None and self.channel.roughness_height is not None:
                decisive["roughness_height over diameter"] = self.channel.roughness_height / self.grain.diameter
            if self.channel is not None and self.channel.depth is not None:
                decisive["depth over diameter"] = self.channel.depth / self.grain.diameter
        except ArithmeticError:
            decisive = {"a dimensionless number": math.nan}
        for name, value in decisive.items():
            if not low <= value <= high:
                raise ValueError(f"fluid, grain and channel must make sense together, got {name} = {value:.3g}: check their units")
        try:
            self.clear  # noqa: B018
        except ValueError as error:
            raise ValueError(f"channel.{error}") from None

    def _check_coupling(self) -> None:
        """A stream that grains change, and what two-way coupling counts them by."""
        coupling = self.coupling
        if coupling is None:
            return
        if self.channel is None or self.channel.profile == "none":
            raise ValueError(f"coupling = {coupling.form!r} needs a [channel] with a profile: still water has no momentum to give")
        try:
            self.profile  # noqa: B018
        except ValueError as error:
            if coupling.form == "two_way":
                raise ValueError(f"coupling.settled: {error}") from None
            known = ", ".join(name for name in PROFILES if name not in ("none", "reichardt"))
            raise ValueError(f"coupling = 'roughness' needs a profile with a roughness length, one of {known}, got {self.channel.profile!r}: {error}") from None
        if coupling.form == "two_way":
            if self.bed is None:
                raise ValueError("coupling = 'two_way' needs a [bed]: grains leave there the momentum that they take from the stream")
            most = self.grain.diameter**-2
            if (coupling.grains or 0.0) > most:
                raise ValueError(f"coupling.grains must be {most:.3g} 1/m2 or less, one for each d² of the bed, got {coupling.grains:g}: check its unit")
            if self.cloud is not None and coupling.grains is not None:
                raise ValueError("coupling.grains is for a single grain: the table [cloud] says how many there are per area")
            if self.cloud is not None and coupling.excess:
                raise ValueError("coupling.excess is for a single grain: the table [cloud] says how many there are per area")

    def _check_rests(self) -> None:
        """A grain at rest lies on a bed, sets out again into flights that begin anew, and none lies on it."""
        if self.rests is None:
            return
        if self.bed is None or self.channel is None:
            raise ValueError(f"rests needs a {'[bed] to lie on' if self.bed is None else '[channel] whose stream picks grains up'}")
        if "weight" not in self.names or self.numbers.density_ratio <= 1.0:
            raise ValueError("rests needs grains that sink: 'weight' among the effects, and grain.density above fluid.density")
        if self.solver.method != "collocation":
            raise ValueError(f"rests needs solver.method = 'collocation', got {self.solver.method!r}")
        if "encounters" in self.names:
            raise ValueError("rests and the effect 'encounters' exclude each other: a grain that is picked up could overlap one that passes over it")

    def _check_duration(self) -> None:
        """The duration has to fit the steps and the kept positions."""
        if self.run.duration is None:
            return
        end, dt = self.run.duration / self.numbers.time, self.solver.dt
        least = f"{FEWEST * self.numbers.time:.3g} s ({FEWEST:g} d/u*)"
        if not FEWEST <= end <= LATEST:
            raise ValueError(f"run.duration must be {least} or longer, and {LATEST * self.numbers.time:.3g} s at most, got {self.run.duration:g}")
        if dt is not None and not end / dt <= MOST_STEPS * (1.0 + 1e-9):
            raise ValueError(f"run.duration must be {MOST_STEPS:g} steps or less, got {end / dt:.3g} of solver.dt = {dt:g} d/u*")
        if self.cloud is not None and self.run.trajectory and not end / self.cloud.interval <= MOST_TIMES:
            raise ValueError(
                f"cloud.interval must give {MOST_TIMES:g} stored positions of a grain or fewer in run.duration, which is {end:.4g} d/u*, "
                f"got {self.cloud.interval:g} d/u*: give a longer one, or run.trajectory = false"
            )

    def _check_steps(self) -> None:
        """Fixed steps have to be stable with the drag of a grain at rest, the least there is, and the history."""
        from basset.solvers.stability import longest_step

        n, names, dt = self.numbers, self.names, float(self.solver.dt or 0.0)
        rule = self.history_rule()
        rate, coefficient = 18.0 * n.alpha / n.reynolds * ("drag" in names), n.history * ("history" in names)
        longest = longest_step(rule, rate, coefficient, self.solver.method == "runge_kutta_4")
        if dt > longest:
            raise ValueError(
                f"solver.dt must be {longest:.3g} d/u* or less for {rule!r}, or the steps diverge, got {dt:g}: a lower history.order allows longer ones"
            )

    def _check_history(self) -> None:
        """Scheme and solver have to fit."""
        options = self.options("history")
        if options.scheme not in SCHEMES:
            known = ", ".join(map(repr, SCHEMES))
            raise ValueError(f"history.scheme must be one of {known}, got {options.scheme!r}{_validate.suggestion(options.scheme, SCHEMES)}")
        if options.rtol is not None and options.rtol < FINEST:
            raise ValueError(f"history.rtol must be {FINEST:g} or greater, got {options.rtol:g}: rounding errors of the sum are as large")
        if self.horizon > LONGEST and not self.widens:
            what = f"history.horizon must be {LONGEST:g} or less" if options.horizon else f"run.duration must be {0.99 * LONGEST:g} or less with history"
            raise ValueError(f"{what}, got {self.horizon / (1.0 if options.horizon else 1.01):g} (units of d/u*)")
        refused = barred(options, self.solver.method)
        if refused is not None:
            raise ValueError(str(refused))
        if options.slip_at is not None and options.kernel == "basset":
            raise ValueError("history.slip_at has no meaning for history.kernel = 'basset', which is the same at every slip: leave it out")
        if self.solver.method == "collocation":
            if options.slip_at == "tau":
                raise ValueError("history.slip_at = 'tau' is for fixed steps: collocation uses the current slip: take history.slip_at = 't'")
            finest = FINEST_STEPS.get(options.kernel, 0.0)
            if self.solver.rtol < finest:
                what = "the polynomials of a step cannot represent it more accurately"
                raise ValueError(f"solver.rtol must be {finest:g} or greater for history.kernel = {options.kernel!r}, got {self.solver.rtol:g}: {what}")
            for name in ("order", "rtol"):
                if getattr(options, name) is not None:
                    raise ValueError(f"history.{name} is for fixed steps: leave it out, with solver.method = 'collocation' solver.rtol sets the accuracy")
            return
        if options.window_jumps is not None and options.window is not None:
            raise ValueError("history.window_jumps and history.window exclude each other: leave out window_jumps, or window and tail")
        self.steps_of(self.horizon)

    def steps_of(self, horizon: float) -> int:
        """How many fixed steps a memory holds; refuses what a run would refuse in scheme, step and memory.

        Parameters
        ----------
        horizon : float, d/u*

        Returns
        -------
        int

        Raises
        ------
        ValueError
            If scheme, step and memory do not fit.

        Examples
        --------
        >>> content = read("settling") | {"solver": {"method": "fixed_step", "dt": 0.01}, "history": {"scheme": "daitche"}}
        >>> scene_of(content).steps_of(20.0)
        2000
        """
        from basset import BassetKernel, VaryingSlipKernel
        from basset.quadrature.rule import reach, slip_recipes
        from basset.streaming.following import remembered

        rule, dt, kernel = self.history_rule(horizon), float(self.solver.dt or 0.0), kernel_of(self.options("history"), self.numbers)
        try:
            if "history" in self.names and isinstance(kernel, VaryingSlipKernel):
                remembered(*slip_recipes(rule, dt, horizon, kernel))
            return reach(rule, dt, horizon, BassetKernel())[0]
        except ValueError as error:
            text = str(error).replace(" seconds", " d/u*").replace(" s ", " d/u* ").replace("basset.Exponential", "scheme = 'exponential'")
            raise ValueError(f"history.{text} (solver.dt = {self.solver.dt:g} d/u*)") from None

    def history_rule(self, horizon: float | None = None) -> Any:
        """The rule of `basset` that a fixed-step scene names.

        Parameters
        ----------
        horizon : float, d/u*, or None
            How far a fitted tail has to reach; None: the scene's own.

        Returns
        -------
        basset.Rule
            Its window in units of d/u*; the trapezoid where nothing is remembered.

        Raises
        ------
        ValueError
            If the words name no rule, or do not belong together.
        """
        if "history" not in self.names:
            return Daitche(1)
        options = self.options("history")
        given: dict[str, Any] = {key: getattr(options, key) for key in ("order", "rtol", "window", "rule", "tail") if getattr(options, key) is not None}
        scheme: Any = SCHEMES[options.scheme]
        known = {"order", "rtol"} if options.scheme == "windowed" else set()
        for word in given:
            if word not in known | {field.name for field in dataclasses.fields(scheme)}:
                raise ValueError(f"history.{word} has no meaning for scheme = {options.scheme!r}")
        try:
            if options.scheme == "windowed":
                self._window(options, given, self.horizon if horizon is None else horizon)
            elif options.scheme == "hinsberg" and given.get("tail", False) is not False:
                raise ValueError(f"tail must be false for scheme = 'hinsberg', or left out for its own, got {_validate.shown(options.tail)}")
            return scheme(**given)
        except (TypeError, ValueError) as error:
            raise ValueError(f"history.{str(error).replace(' seconds', ' d/u*')}") from None

    def _window(self, options: Any, given: dict[str, Any], horizon: float) -> None:
        """Rule and tail of a windowed scheme from their names."""
        if options.window is None:
            raise ValueError("window is missing: scheme = 'windowed' needs one, in units of d/u*")
        name = _validate.choice("rule", given.pop("rule", "daitche"), full_history())
        if "order" in given and name != "daitche":
            raise ValueError(f"order has no meaning for rule = {name!r}")
        given["rule"] = SCHEMES[name](**{"order": given.pop("order")} if "order" in given else {})
        given["tail"] = self._tail(options, given.pop("rtol", 1e-6), horizon)

    def _tail(self, options: Any, rtol: float, horizon: float) -> Any:
        if options.rtol is not None and options.tail != "fitted":
            raise ValueError(f"rtol has no meaning for tail = {_validate.shown(options.tail)}: it is the error of a fitted one")
        if options.tail in (None, False):
            return None
        from basset import ExponentialSum
        from basset.quadrature.windowed import whole_steps

        dt = float(self.solver.dt or 0.0)
        start = whole_steps(options.window, dt) * dt if dt > 0.0 else options.window  # the window in whole steps
        if options.tail == "van_hinsberg":
            return ExponentialSum.van_hinsberg(start)
        casas = re.fullmatch(r"casas(?:_([1-9]|10))?(?:_(I1|I2t))?", str(options.tail))
        if casas is not None:
            return ExponentialSum.casas(start, int(casas[1] or 10), casas[2] or "I2t")
        if options.tail != "fitted":
            known = "'fitted', 'van_hinsberg', 'casas', 'casas_5_I1' (1 to 10 terms in the norm I1 or I2t) or false"
            raise ValueError(f"tail must be {known}, got {_validate.shown(options.tail)}")
        return ExponentialSum.fit(0.5 * options.window, max(horizon + dt, 2.0 * options.window), rtol)

    @property
    def horizon(self) -> float:
        """The longest lag of the history integral, in units of d/u*; unless it is given, a run for jumps that lasts longer extends it."""
        options = self.options("history")
        if options.horizon is not None:
            return float(options.horizon)
        if self.run.duration is not None:
            return 1.01 * self.run.duration / self.numbers.time
        return min(LONGEST, max(1e3, 20.0 * (self.run.jumps or 1)))

    @property
    def widens(self) -> bool:
        """Whether the slip jumps at the start only: a memory that is too short is then replaced by a longer one."""
        return self.bed is None and self.cloud is None and self.solver.method == "collocation" and self.options("history").horizon is None

    @property
    def longest_flight(self) -> float:
        """A grain that flies this long is counted as suspended, in units of d/u*; infinite without a bed.

        By default at least the time of flight of a grain that leaves the bed at 100 V under weight alone, and the time to sink by 20 d in creeping flow.
        """
        if self.bed is None:
            return math.inf
        if self.run.longest_flight is not None:
            return float(self.run.longest_flight)
        n = self.numbers
        if "weight" not in self.names or n.density_ratio <= 1.0:
            return PATIENCE
        sinking = min(SUSPENDED, 20.0 * 18.0 * n.shields / n.reynolds) if "drag" in self.names else 0.0
        return max(PATIENCE, 2.0 * FASTEST * n.shields / n.alpha, sinking)


TABLES: dict[str, Any] = {name: (module.Options | None, Field(None, description=(module.__doc__ or "").splitlines()[0])) for name, module in EFFECTS.items()}
if TYPE_CHECKING:

    class Scene(SceneBase):
        """A scene; the tables of effects are found by `options`."""

else:
    Scene = create_model(
        "Scene",
        __base__=SceneBase,
        __doc__="""A scene; fields as in saltation/scenes/*.toml, units in every field's description. `Scene.model_validate(dict)`.

        Examples
        --------
        >>> Scene.model_validate({"effects": ["weight"], "grain": {"diameter": 1e-3}, "run": {"duration": 0.1}}).names
        ('weight',)
        """,
        **TABLES,
    )


def scene_of(content: Any) -> Scene:
    """A validated scene from a dictionary with tables and fields as in a TOML file; SceneError, with one sentence, if it is wrong."""
    try:
        return Scene.model_validate(content)
    except ValidationError as error:
        text = sentence(error, Scene)
    except ValueError as error:
        text = str(error)
    still = isinstance(content, dict) and content.get("channel") is None
    raise SceneError(text.replace("u*", "V") if still else text)  # still water has no u*


def shipped() -> dict[str, Path]:
    """The scenes that come with the package: name -> path."""
    folder = Path(str(resources.files("saltation") / "scenes"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read(path: str | Path) -> dict[str, Any]:
    """What a TOML file holds, or one of the scenes shipped by name ("sand.toml" or "sand"), not yet validated; SceneError if it is missing or no TOML."""
    file = Path(path)
    known = shipped()
    try:
        there = file.exists()
    except (OSError, ValueError):  # a name that no file can have
        there = False
    if not there:
        name = file.name.removesuffix(".toml")
        if len(file.parts) > 1 or name not in known:
            raise SceneError(f"scene {_validate.shown(str(path))} does not exist; shipped are {', '.join(known)}{_validate.suggestion(name, known)}")
        file = known[name]
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except RecursionError:
        raise SceneError(f"scene {str(path)!r} cannot be read: its tables or lists are nested too deeply") from None
    except ValueError as error:  # no TOML, no UTF-8, or an integer of thousands of digits
        raise SceneError(f"scene {str(path)!r} is not valid TOML: {str(error)[0].lower()}{str(error)[1:]}") from None
    except OSError as error:
        raise SceneError(f"scene {str(path)!r} cannot be read: {error.strerror}") from None


def load(path: str | Path) -> Scene:
    """A scene from a TOML file, or one of those shipped by name ("sand.toml" or "sand").

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        With one sentence, if the file is missing, is no TOML, or the scene is wrong.

    Examples
    --------
    >>> load("sand").grain.diameter
    0.00069
    """
    return scene_of(read(path))
