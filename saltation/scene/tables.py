"""The tables of a scene, in SI units, with what each field means; those of the effects are in `saltation/effects`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from basset import _validate
from saltation._tables import Table
from saltation.bed.rebound import REBOUNDS
from saltation.bed.roughness import READINGS, ROUGHNESS
from saltation.flow import PROFILES, REGIMES, VON_KARMAN

__all__ = ["Bed", "Channel", "Chosen", "Cloud", "Coupling", "Fluid", "Grain", "Rests", "Run", "SceneError", "Settled", "Solver", "Start"]


class SceneError(ValueError):
    """A scene that cannot be simulated; the message is one sentence.

    Examples
    --------
    >>> import saltation
    >>> try:
    ...     saltation.load("sandy.toml")
    ... except SceneError as error:
    ...     print(str(error).partition(";")[0])
    scene 'sandy.toml' does not exist
    """


def _one_of(options: Any) -> BeforeValidator:
    """A string from `options`, with a suggestion."""

    def check(value: Any) -> Any:
        if not isinstance(value, str) or value not in options:
            names = ", ".join(repr(name) for name in options)
            hint = _validate.suggestion(value, options) if isinstance(value, str) else ""
            raise ValueError(f"must be one of {names}, got {_validate.shown(value)}{hint}")
        return value

    return BeforeValidator(check)


def _restitution(value: Any) -> Any:
    if isinstance(value, str):
        if value not in ("set1", "stokes"):
            raise ValueError(f"must be a number from 0 to 1, 'set1' or 'stokes', got {value!r}{_validate.suggestion(value, ('set1', 'stokes'))}")
    elif isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
        raise ValueError(f"must be a number from 0 to 1, 'set1' or 'stokes', got {_validate.shown(value)}")
    return value


Vector = Annotated[list[float], Field(min_length=3, max_length=3)]


class Fluid(Table):
    """The fluid."""

    density: float = Field(1000.0, gt=0.0, description="kg/m3")
    viscosity: float = Field(1.0e-6, gt=0.0, description="kinematic, m2/s")


class Grain(Table):
    """The grain, a sphere."""

    density: float = Field(2650.0, gt=0.0, description="kg/m3")
    diameter: float = Field(gt=0.0, description="m")


class Channel(Table):
    """The stream; leave the table out for still water."""

    transport_stage: float | None = Field(None, gt=0.0, description="τ*/τ*c, dimensionless; or give shear_velocity")
    shear_velocity: float | None = Field(None, gt=0.0, description="u*, m/s; or give transport_stage")
    slope: float = Field(0.0, gt=-1.0, lt=1.0, description="tangent of the bed's angle, dimensionless")
    profile: Annotated[str, _one_of([*PROFILES, *REGIMES])] = Field("swamee", description="velocity profile: " + ", ".join([*PROFILES, *REGIMES]))
    roughness_height: float | None = Field(None, gt=0.0, description="k_s, m; default the grain's diameter")
    von_karman: float = Field(VON_KARMAN, ge=1e-3, lt=1.0, description="κ, dimensionless")
    depth: float | None = Field(None, gt=0.0, description="h, depth of the water above the bed level, m")

    @model_validator(mode="after")
    def _one_velocity(self) -> Channel:
        if (self.transport_stage is None) == (self.shear_velocity is None):
            raise ValueError("needs either transport_stage or shear_velocity (m/s), and not both")
        return self


class Bed(Table):
    """The bed; leave the table out where there is none."""

    rebound: Annotated[str, _one_of(REBOUNDS)] = Field("tsuji", description="rebound law: " + ", ".join(REBOUNDS))
    roughness: Annotated[str, _one_of(ROUGHNESS)] = Field("R7", description="roughness sub-model: " + ", ".join(ROUGHNESS))
    reading: Annotated[str, _one_of(READINGS)] = Field(
        "clip", description="contact angles beyond 30°: clip (set to 30°), reject (drawn again), literal (kept), spheres (what a path can reach, lee side too)"
    )
    smallest_offset: float = Field(0.0, ge=0.0, lt=0.5, description="smallest offset r/d that is drawn, dimensionless (0.1 in the thesis's chapter 4)")
    span_scatter: bool = Field(True, description="whether contact planes tilt across the stream")
    restitution: Annotated[float | Literal["set1", "stokes"], BeforeValidator(_restitution)] = Field(
        0.65, description="e, dimensionless: a number from 0 to 1, 'set1' (0.75 − 0.25 T, at least 0) or 'stokes' (0.97 exp(−k/St))"
    )
    stokes_decay: float | None = Field(
        None, ge=0.0, description="k of restitution = 'stokes', dimensionless; default: fits measured rebounds with the scene's history (35 without)"
    )
    friction: float | None = Field(None, ge=0.0, description="Coulomb's f, dimensionless (tsuji)")
    tangential_retention: float | None = Field(None, ge=0.0, le=1.0, description="share of the tangential velocity that is kept, dimensionless (garcia_nino)")
    contact_mass: Literal["dry", "immersed"] = Field("dry", description="'dry': the grain's own mass; 'immersed': with the added mass")

    @model_validator(mode="after")
    def _right_restitution(self) -> Bed:
        if self.stokes_decay is not None and self.restitution != "stokes":
            raise ValueError(f"stokes_decay belongs to restitution = 'stokes', got restitution = {self.restitution!r}: leave one of them out")
        return self

    @model_validator(mode="after")
    def _right_friction(self) -> Bed:
        if self.rebound == "garcia_nino":
            if self.tangential_retention is None:
                raise ValueError("tangential_retention is missing: rebound = 'garcia_nino' keeps a share from 0 to 1 of the tangential velocity")
            if self.friction is not None:
                raise ValueError("friction is Coulomb's and has no place in rebound = 'garcia_nino': give tangential_retention alone")
        else:
            if self.friction is None:
                raise ValueError(f"friction is missing: rebound = {self.rebound!r} needs Coulomb's coefficient, 0 or greater")
            if self.tangential_retention is not None:
                raise ValueError(f"tangential_retention has no place in rebound = {self.rebound!r}: give friction alone")
        return self


class Rests(Table):
    """Grains that come to rest and are entrained again; leave the table out if they move all the time."""

    entrainment: float = Field(
        gt=0.0, description="entrainment rate of a grain at rest, 1/s: durations of rests are exponentially distributed, with the mean 1/entrainment"
    )
    rise: float = Field(
        0.05,
        ge=0.0,
        le=1.0,
        description="a hop no longer in time than one of this rise under weight alone ends in a rest, d; default: from a pocket to the saddle between grains",
    )


class Start(Table):
    """The first takeoff; default as in the thesis: 2 u* along and up, 2 u*/d of spin, at the height of a crest contact."""

    velocity: Vector | None = Field(None, description="initial velocity (x, y, z), m/s")
    spin: Vector | None = Field(None, description="initial spin (x, y, z), rad/s")
    height: float | None = Field(None, gt=0.0, description="height of the grain's centre above the bed level, m")


class Solver(Table):
    """How flights are integrated."""

    method: Literal["collocation", "fixed_step", "runge_kutta_4"] = Field("collocation", description="graded collocation, or fixed steps")
    rtol: float = Field(
        1.0e-5,
        ge=1e-10,
        le=1e-2,
        description="error that one flight adds to a jump's height, length and duration, relative to the larger of the jump's and the mean (collocation)",
    )
    dt: float | None = Field(None, gt=0.0, description="step in units of d/u* (fixed steps)")

    @model_validator(mode="after")
    def _step(self) -> Solver:
        if self.method == "collocation" and self.dt is not None:
            raise ValueError("dt belongs to method = 'fixed_step' or 'runge_kutta_4': collocation chooses its steps by rtol")
        if self.method != "collocation" and self.dt is None:
            raise ValueError(f"dt is missing: method = {self.method!r} needs a step in units of d/u*, such as 1e-3")
        return self


class Cloud(Table):
    """Many grains instead of one; all start at once from random positions in a layer above the bed."""

    number: int = Field(ge=1, le=10**7, description="number of grains")
    concentration: float = Field(gt=0.0, le=0.3, description="C_p, dimensionless: volume of the grains over that of the layer in which their centres start")
    layer: float | None = Field(None, gt=0.0, description="height of that layer, m; default two diameters")
    boundary: Literal["periodic", "open"] = Field("periodic", description="boundary of the area from which they start, for encounters")
    spread: float = Field(0.1, ge=0.0, description="standard deviation of each component of the initial velocities about start.velocity, in units of u*")
    interval: float = Field(0.1, gt=0.0, description="time between two stored positions, in units of d/u*")


class Run(Table):
    """Length of the run, and its random numbers."""

    jumps: int | None = Field(None, ge=1, le=10**9, description="number of jumps; or give duration")
    duration: float | None = Field(None, gt=0.0, description="s; or give jumps")
    discard: int = Field(0, ge=0, description="number of first jumps of a grain that are left out of the statistics")
    seed: int = Field(1, ge=0, lt=2**63, description="seed of the random numbers")
    longest_flight: float | None = Field(
        None, ge=1e-9, description="a flight longer than this ends the run, in units of d/u*; default 1000, or more where grains fall slowly or in air"
    )
    trajectory: bool = Field(True, description="whether the path is stored in the result")

    @model_validator(mode="after")
    def _length(self) -> Run:
        if (self.jumps is None) == (self.duration is None):
            raise ValueError("needs either jumps or duration (s), and not both")
        if self.jumps is not None and self.discard >= self.jumps:
            raise ValueError(f"discard must be smaller than jumps = {self.jumps}, got {self.discard}")
        return self


class Settled(Table):
    """The state to which two-way coupling has converged."""

    of: str = Field(description="hash of the scene that was coupled")
    heights: list[float] = Field(min_length=4, description="heights of the centre, d")
    stress: list[float] = Field(min_length=4, description="shear stress of grains at these heights, from which the profile is computed, in units of ρu*²")
    seen: list[float] = Field(min_length=4, description="shear stress there of the grains simulated in this profile, in units of ρu*²")
    grains: float = Field(description="moving grains per area of the bed, 1/m2")
    rate: float = Field(description="bed load q/√((s − 1) g d³), dimensionless")
    rate_uncoupled: float = Field(description="the same in the profile without grains, dimensionless")
    runs: int = Field(description="number of runs")
    averaged: int = Field(0, description="number of the runs with random numbers of their own, over which seen is averaged; 0: no averaging")
    change: float = Field(description="largest difference between stress and seen or, where runs are averaged, two standard errors of seen, in units of ρu*²")


class Coupling(Table):
    """Effect of grains on the stream; `coupling = "two_way"` is this table with its defaults."""

    form: Literal["roughness", "two_way"] = Field(
        "two_way", description="'roughness': a layer of jumping grains makes the bed rougher; 'two_way': they take momentum from the stream"
    )
    excess: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="c₁ of the fluid's stress at the bed, τ_c + c₁(τ₀ − τ_c), which sets the number of grains, dimensionless; 0: Owen's hypothesis",
    )
    grains: float | None = Field(
        None, ge=0.0, description="moving grains per area of the bed, 1/m2, for a single grain; default: follows from the stress at the bed"
    )
    tolerance: float = Field(1e-3, ge=1e-6, le=0.1, description="allowed error of the sum of both stresses at every height, in units of ρu*²")
    runs: int = Field(40, ge=2, le=100_000, description="largest number of runs until the stresses agree; sampling errors fall with its square root")
    settled: Settled | None = Field(None, description="the converged state: written with a result, not to be given")

    @model_validator(mode="after")
    def _one_number(self) -> Coupling:
        if self.form == "roughness":
            given = [name for name in ("excess", "grains", "tolerance", "runs", "settled") if getattr(self, name) != type(self).model_fields[name].default]
            if given:
                raise ValueError(f"{given[0]} belongs to form = 'two_way', got form = 'roughness': leave it out")
        if self.grains is not None and self.excess:
            raise ValueError(f"excess and grains exclude each other: the stress at the bed sets the number of grains, or it is given, got {self.grains:g} 1/m2")
        return self


class Chosen(Table):
    """How effects = "auto" came to the effects."""

    of: str = Field(description="hash of the scene with effects = 'auto'")
    tolerance: float = Field(description="allowed relative change of mean height, length and velocity, dimensionless")
    status: str = Field(description="status of the run with all effects: if it did not finish, all are kept")
    kept: list[str] = Field(description="the effects of the scene")
    left_out: list[str] = Field(description="the effects left out")
    full: dict[str, float] = Field(description="mean height (d), length (d), velocity (u*) with all effects")
    chosen: dict[str, float] = Field(description="the same with those that are kept, in d, d and u*")
    bounds: dict[str, float | str] = Field(
        description="upper 95 % bound of the largest relative change of these means without each effect, dimensionless; or why there is none"
    )
    tried: list[dict[str, Any]] = Field(description="combinations of effects left out together, each with its bound (dimensionless)")
    jumps: int = Field(description="number of jumps simulated for the choice")
