"""A measured motion against the flight of a scene: the misfit, and the fields of the scene that fit it best, with their intervals.

The misfit is the sum of squares of what the model is off, over the noise of each quantity; `least_squares` makes it least.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from basset import _validate
from basset.kernels import Floats
from saltation import simulation
from saltation.scene import AUTO, Scene, SceneError
from saltation.scene.messages import _field
from saltation.study.least_squares import Fitted, LeastSquares
from saltation.study.records import QUANTITIES, Record, noise_of, read_record

__all__ = ["Comparison", "compare"]

CLOCK, ZERO = "time", "zero"  # what can be fitted beside fields of a scene: s by which the record's clock is late, m by which its zero of heights is off
RANGES = {"bed.restitution": (0.0, 1.0), "bed.stokes_decay": (0.0, 100.0)}
WIDE = 4.0  # factor of a field's value up and down, where no range is given
LATE = 0.1  # of the record's length: range of the clock
AXES = "xyz"
MOST = 4  # fields
FAINTEST = 1e-6  # noise, of the extent of a quantity: flights are no better
TIED = 1.5  # an interval from blocks that is that much wider than the profile's is told of
FAR = 2.0  # a misfit that many times the noise is told of
TRIES = 3  # of a flight that has to last until after a contact


class Flown(NamedTuple):
    """A flight in SI: times (s), places (m) and velocities (m/s) at the nodes of its steps, times of contacts (s), and a centre's height at the bed (m)."""

    times: Floats
    places: dict[str, Floats]
    velocities: dict[str, Floats]
    contacts: Floats
    floor: float
    rests: bool

    def at(self, t: Floats, quantity: str) -> Floats:
        """A quantity at these times (n,): before the start and after the end the grain is where it is then."""
        if quantity == "gap":
            return self.at(t, "z") - self.floor
        if quantity == "speed":
            return np.asarray(np.sqrt(sum(self.at(t, name) ** 2 for name in self.velocities)))
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = self.times[k + 1] - self.times[k]
        s = np.clip((t - self.times[k]) / np.where(h > 0.0, h, 1.0), 0.0, 1.0)
        axis = AXES["uvw".index(quantity)] if quantity in "uvw" else quantity
        speed = self.velocities["uvw"[AXES.index(axis)]]
        place, before, after = self.places[axis], h * speed[k], h * speed[k + 1]
        rise = place[k + 1] - place[k]
        if axis == quantity:  # Hermite's cubic
            return np.asarray(place[k] + s * (before + s * (3.0 * rise - 2.0 * before - after + s * (before + after - 2.0 * rise))))
        slope = before + s * (2.0 * (3.0 * rise - 2.0 * before - after) + 3.0 * s * (before + after - 2.0 * rise))
        found = np.where(h > 0.0, slope / np.where(h > 0.0, h, 1.0), speed[k + 1])
        return np.where(t > self.times[-1], 0.0 if self.rests else speed[-1], np.where(t < self.times[0], speed[0], found))


def fly(scene: Scene) -> Flown:
    """Fly a scene; SceneError if it does not get to the end of its time, but comes to rest."""
    result = simulation.run(scene)
    if result.status not in ("finished", "at rest"):
        raise SceneError(f"the simulation does not get to the end of the record: it is {result.status}, {result.message}")
    path, n = result.trajectory, scene.numbers
    axes = [axis for axis in AXES if axis in path]
    jumps = result.all_jumps
    return Flown(
        np.maximum.accumulate(path["time"].to_numpy()) * n.time,
        {axis: path[axis].to_numpy() * n.diameter for axis in axes},
        {"uvw"[AXES.index(axis)]: path["uvw"[AXES.index(axis)]].to_numpy() * n.velocity for axis in axes},
        (jumps["start"] + jumps["duration"]).to_numpy() * n.time,
        floor_of(scene),
        result.status == "at rest",
    )


@dataclass(eq=False)
class Comparison:
    """A record against the flight of a scene.

    Attributes
    ----------
    scene : Scene
        As simulated: with the fitted values, if there are any, for the time of the record.
    fitted : DataFrame, one row per field that was fitted, in its unit
        value, standard_error, low and high (95 % interval of the profile), blocks_low and blocks_high (95 % interval from blocks of residuals), least and most
        (the range that was searched), unit.
    misfit : DataFrame, one row per quantity
        points that count, rms and largest residual, noise (what the residuals are weighted with: given, or that of the record), in m or m/s as `unit` says.
    points : DataFrame, one row per time of the record that is compared
        time (s), and per quantity Q in SI: Q of the record, Q_model, Q_residual, and Q_counts: whether it counts (velocities beside a contact do not).
    curve : DataFrame
        The model on a fine grid: time (s) and each quantity in SI.
    held : dict
        Fields of the scene that were not fitted, as the scene gives them, in their units.
    notes : tuple of str
        Warnings, one sentence each.

    Examples
    --------
    >>> import numpy as np
    >>> import saltation
    >>> t = np.linspace(0.0, 0.05, 30)
    >>> found = saltation.compare({"t": t, "w": -0.02 * np.ones(30)}, saltation.load("settling"))
    >>> list(found.misfit.index), list(found.points), len(found.fitted)
    (['w'], ['time', 'w', 'w_model', 'w_residual', 'w_counts'], 0)
    """

    scene: Scene
    fitted: pd.DataFrame
    misfit: pd.DataFrame
    points: pd.DataFrame
    curve: pd.DataFrame
    held: dict[str, Any]
    notes: tuple[str, ...]


def compare(
    record: str | os.PathLike[str] | Mapping[str, Any],
    scene: Scene,
    fit: str | Sequence[str] | Mapping[str, tuple[float, float] | None] = (),
    *,
    columns: Sequence[str] = (),
    start: float | None = None,
    contact: float | None = None,
    until: float | None = None,
    error: float | Mapping[str, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare a measured motion with a simulated one of one grain, in still or flowing water, without a bed or over a flat one, and fit fields of the scene.

    Parameters
    ----------
    record : path, DataFrame or mapping of columns (n,)
        One trajectory: times and at least one of x, y, z (of the centre), gap (from the bed to the grain), u, v, w (along, across, up), speed, depth or fall
        velocity, each under its name, with its unit or in SI: "t (ms)", "gap (mm)". A file is a table of text (.csv, .txt, .dat, .tsv) or netCDF-3 (.nc); what
        is missing is NaN, empty or NA. x, y and depth, without a bed and a channel also z, are compared up to a constant.
    scene : Scene
        From `saltation.load`. Its [run] is not used.
    fit : str, sequence of str, or mapping of str to (low, high) or None
        What to fit: numeric fields of the scene such as "bed.restitution", "grain.density" or "start.velocity.z", in their units; "time", by how many
        seconds the record's clock is late; "zero", how many metres its zero of heights lies below the model's. With the range to search, or None for the usual
        one: what is possible for restitution; of start.velocity.* and start.height what the record's first samples say; else from a quarter to four times the
        scene's value.
    columns : sequence of str
        Names of a file's columns, in place of its own.
    start : float, s
        The record's time at which the scene starts; what is earlier is left out. Default: its first time.
    contact : float, s
        Instead of start: the record's time of the first contact. The scene starts earlier by the time that its grain takes to the contact.
    until : float, s
        Later samples are left out.
    error : float or mapping of quantity to float, m or m/s
        Standard deviation of the record's noise. Default: estimated from deviations of the samples from a smooth curve.
    progress : callable or None
        Called with the share that is done, 0 to 1 (dimensionless).

    Returns
    -------
    Comparison
        In SI units.

    Raises
    ------
    ValueError, TypeError
        With one sentence for a record, field, range or time that cannot be compared; SceneError for a scene that cannot.

    Examples
    --------
    >>> import numpy as np
    >>> import saltation
    >>> scene = saltation.load("settling")  # a grain of 1 mm that starts from rest
    >>> made = saltation.compare({"t": np.linspace(0.0, 0.05, 30), "fall velocity": np.zeros(30)}, scene).points
    >>> record = {"t": made["time"], "w": made["w_model"] + 1e-4 * np.sin(np.arange(30.0) ** 2)}
    >>> found = compare(record, scene, "grain.density", error=1e-4).fitted.loc["grain.density"]
    >>> bool(found["low"] < 2650.0 < found["high"]), bool(found["high"] - found["low"] < 100.0)
    (True, True)
    """
    wanted = {fit: None} if isinstance(fit, str) else dict(fit) if isinstance(fit, Mapping) else dict.fromkeys(fit)
    problem = Problem(read_record(record, columns), scene, wanted, start, contact, until, error)
    search = LeastSquares(problem)
    problem.steps = Steps(progress, problem, search)
    best, found = search.fit() if wanted else (np.empty(0), None)
    return problem.told(best, found)


class Steps:
    """Progress by flights, whose number is only guessed."""

    def __init__(self, progress: Callable[[float], None] | None, problem: Problem, search: LeastSquares) -> None:
        self.progress, self.done = progress, 0
        self.guess = 1 if not problem.names else len(search.grid()) + 40 * max(1, len(problem.flown)) ** 2

    def __call__(self) -> None:
        """One flight more."""
        self.done += 1
        if self.progress is not None:
            self.progress(1.0 - math.exp(-2.0 * self.done / self.guess))


class Problem:
    """A record, a scene and what is fitted: from values of the fields to residuals."""

    def __init__(
        self,
        record: Record,
        scene: Scene,
        fit: Mapping[str, Any],
        start: float | None,
        contact: float | None,
        until: float | None,
        error: float | Mapping[str, float] | None,
    ) -> None:
        check_scene(scene)
        self.record, self.title, self.names = record, record.name, tuple(fit)
        self.late = self.names.index(CLOCK) if CLOCK in self.names else None
        for name, value in (("start", start), ("contact", contact), ("until", until)):
            if value is not None:
                _validate.number(name, value, "a time in seconds")
        if start is not None and contact is not None:
            raise ValueError("give either start or contact: each follows from the other by the simulation")
        if contact is not None and scene.bed is None:
            raise ValueError("contact is the time at which the grain first meets the bed, and the scene has none: give start, or add a [bed]")
        given = start if start is not None else contact
        self.anchor = float(record.times[0]) if given is None else given
        self.by_contact, self.fall = contact is not None, 0.0
        inside = (record.times >= (self.anchor if start is not None else -math.inf)) & (record.times <= (math.inf if until is None else until))
        self.times = record.times[inside]
        self.values = {name: values[inside] for name, values in record.values.items()}
        if len(self.times) < max(2, len(fit) + 2):
            raise ValueError(f"{record.name} must have {max(2, len(fit) + 2)} times or more that are compared, got {len(self.times)} of {len(record.times)}")
        for name, values in self.values.items():
            if not np.isfinite(values).any():
                raise ValueError(f"{record.name} must have samples of {name!r} in the time that is compared, got none")
        self.earlier = int((record.times < self.times[0]).sum())
        self.scene = scene
        self.check_quantities()
        self.floating = [name for name in self.values if self.floats(name)]
        if ZERO in fit and not any(name in ("z", "gap") and name not in self.floating for name in self.values):
            raise ValueError("'zero' is the record's zero of heights, which matters only where z or gap is compared over a bed: leave it out")
        self.noise, self.given = self.noises(error)
        self.flights: dict[tuple[float, ...], Flown] = {}
        self.steps: Callable[[], None] = lambda: None
        self.flown = [k for k, name in enumerate(self.names) if name not in (CLOCK, ZERO)]
        if len(self.names) > MOST:
            raise ValueError(f"fit must be {MOST} fields or fewer, got {len(self.names)}: a record of one grain cannot determine more")
        self.low, self.high = np.array([self.range_of(name, given) for name, given in fit.items()]).reshape(-1, 2).T
        if self.by_contact:
            self.fall = 1.5 * self.first_contact()

    # What is compared

    def check_quantities(self) -> None:
        """Each has to be one that the scene's grain has, and the axes be known."""
        there = self.values.keys()
        for name in "yv":
            if name not in there:
                continue
            up = "z or gap" if name == "y" else "w"
            if self.scene.in_plane:
                raise ValueError(f"{name!r} is across the stream, where a scene in two dimensions has no motion: call what points up {up}, or leave it out")
            if not there & {"z", "gap", "w"}:
                raise ValueError(f"{name!r} is across the stream: call what points up {up}, what points down depth or fall velocity, or give one of them too")
        if "gap" in there and self.scene.bed is None:
            raise ValueError("'gap' is measured from the bed, and the scene has none: add a [bed], or call the column z")

    def floats(self, quantity: str) -> bool:
        """Whether it is compared but for a constant: nothing says where its zero is."""
        free = self.scene.bed is None and self.scene.channel is None
        return quantity in ("x", "y") or quantity in self.record.depths or (quantity == "z" and free)

    def noises(self, error: float | Mapping[str, float] | None) -> tuple[dict[str, float], bool]:
        """Standard deviation of each quantity's noise, and whether it is given."""
        if error is not None:
            given = dict(error) if isinstance(error, Mapping) else dict.fromkeys(self.values, error)
            if not isinstance(error, Mapping) and len({QUANTITIES[name][0] for name in self.values}) > 1:
                raise ValueError(f"error must be given for each of {', '.join(self.values)}, as they have not all the same unit")
            for name in (*given, *self.values):
                if name not in self.values:
                    raise ValueError(f"error is for {', '.join(self.values)}, got one for {name!r}")
                if name not in given:
                    raise ValueError(f"error must be given for each of {', '.join(self.values)}, got none for {name!r}")
            return {name: _validate.positive(f"error of {name}", given[name], QUANTITIES[name][0]) for name in self.values}, True
        found = {}
        for name, values in self.values.items():
            noise = noise_of(self.times, values)
            if noise is None and len(self.values) > 1:
                raise ValueError(f"error must be given, or {name!r} have seven samples or more, from which the noise is estimated")
            found[name] = 1.0 if noise is None else max(noise, FAINTEST * float(np.nanmax(values) - np.nanmin(values)), 1e-12)
        return found, False

    # The fields

    def range_of(self, name: str, given: Any) -> tuple[float, float]:
        """The range of a field that is searched; ValueError, SceneError if it has none, or is no field that can be fitted."""
        if name.partition(".")[0] in ("run", "solver", "cloud", "dimensions", "tolerance"):
            raise ValueError(f"fit must be numeric fields of the scene that a motion depends on, {CLOCK!r} or {ZERO!r}, got {name!r}")
        low, high = self.usual_range(name) if given is None else given
        low, high = _validate.number(f"the range of {name}", low), _validate.number(f"the range of {name}", high)
        if not low < high:
            raise ValueError(f"the range of {name} must be two rising numbers, got {low:g} to {high:g}")
        if name not in (CLOCK, ZERO):
            for value in (low, 0.5 * (low + high), high):
                changed(self.scene, {name: value})
        return low, high

    def usual_range(self, name: str) -> tuple[float, float]:
        """The range where none is given."""
        if name == CLOCK:
            late = LATE * (self.times[-1] - self.times[0])
            return -late, late
        if name == ZERO:
            most = 0.25 * self.scene.grain.diameter
            return -most, most
        if name in RANGES:
            changed(self.scene, {name: 0.5 * sum(RANGES[name])})
            return RANGES[name]
        if (seen := self.seen(name)) is not None:
            return seen
        value = value_of(self.scene, name)
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            changed(self.scene, {name: 1.0})  # says what is wrong with the name
            raise ValueError(f"{name} must have a number in the scene, from which its range follows, or be given one, got {_validate.shown(value)}")
        if value == 0.0:
            raise ValueError(f"{name} is 0 in the scene, from which no range follows: give one, as {name}=LOW,HIGH")
        ends = sorted((value / WIDE, value * WIDE))
        return self.narrowed(name, value, ends[0]), self.narrowed(name, value, ends[1])

    def narrowed(self, name: str, value: float, end: float) -> float:
        """An end of a usual range, nearer to the scene's value where no scene has it."""
        for _ in range(8):
            try:
                changed(self.scene, {name: end})
            except SceneError:
                end = 0.5 * (value + end)
            else:
                return end
        raise ValueError(f"{name} must be given a range, as {name}=LOW,HIGH: about {value:g} there is none")

    def seen(self, name: str) -> tuple[float, float] | None:
        """What the record's first samples say of the start: a parabola through them; None if they say nothing of it."""
        axis = name[-1] if name.startswith("start.velocity.") else "z" if name == "start.height" else ""
        if axis not in tuple(AXES) or self.by_contact:
            return None
        speed = name != "start.height"
        place = next((one for one in ((axis, "gap") if axis == "z" else (axis,)) if one in self.values and (speed or not self.floats(one))), None)
        quick = "uvw"[AXES.index(axis)]
        if speed and quick in self.values:
            place, order = quick, 0
        elif place is None:
            return None
        else:
            order = int(speed)
        there = np.isfinite(self.values[place])
        t, y = (self.times[there] - self.anchor)[:9], self.values[place][there][:9]
        if len(t) < 5:
            return None
        scale = t[-1] - t[0]
        fitted, cover = np.polyfit(t / scale, y, 2, cov=True)
        value, spread = fitted[2 - order] / scale**order, math.sqrt(cover[2 - order, 2 - order]) / scale**order
        if place == "gap" and not speed:
            value += floor_of(self.scene)
        half = max(10.0 * spread, 0.1 * abs(value), 1e-3 * self.scene.numbers.velocity if speed else 1e-3 * self.scene.grain.diameter)
        return (value - half, value + half) if speed else (max(value - half, 0.1 * abs(value)), value + half)

    # Flights

    def made(self, values: Sequence[float]) -> Scene:
        """The scene with these values of what is flown."""
        length = float(self.times[-1]) - self.anchor + self.fall
        if self.late is not None:
            length += max(0.0, -float(self.low[self.late]))
        found = changed(self.scene, dict(zip((self.names[k] for k in self.flown), values, strict=True)))
        if not length > 0.0:
            raise ValueError(f"the scene must start before the record's last time, {self.times[-1]:g} s, got {self.anchor:g} s")
        return for_time(found, length)

    def first_contact(self) -> float:
        """How long the scene flies until it meets the bed, s, for the middle of all ranges."""
        middle = dict(zip((self.names[k] for k in self.flown), (0.5 * (self.low + self.high))[self.flown], strict=True))
        result = simulation.run(changed(self.scene, middle).changed(run={"jumps": 1, "duration": None, "discard": 0, "trajectory": False}))
        if not len(result.all_jumps):
            raise ValueError(f"contact needs a scene whose grain meets the bed, and this one does not: it is {result.status}, {result.message}")
        return float(result.all_jumps["duration"].iloc[0]) * result.scene.numbers.time

    def flight(self, theta: Floats) -> Flown:
        """The flight with these values of the fields, kept."""
        values = tuple(float(theta[k]) for k in self.flown)
        if values not in self.flights:
            for _ in range(TRIES):
                found = fly(self.made(values))
                end = found.times[-1]
                if not self.by_contact or (len(found.contacts) and (found.rests or end - found.contacts[0] >= self.times[-1] - self.anchor)):
                    break
                self.fall = 2.0 * max(self.fall, end)  # until the first contact, and from there on as long as the record
            else:
                raise SceneError("contact needs a scene whose grain meets the bed, and this one does not in a long time")
            self.flights[values] = found
            self.steps()
        return self.flights[values]

    def clock(self, theta: Floats, flight: Flown) -> float:
        """The record's time at which the scene starts."""
        late = float(theta[self.late]) if self.late is not None else 0.0
        return self.anchor + late - (float(flight.contacts[0]) if self.by_contact else 0.0)

    def model(self, theta: Floats, times: Floats) -> dict[str, Floats]:
        """Every quantity at these times of the record."""
        flight = self.flight(theta)
        t = times - self.clock(theta, flight)
        found = {name: flight.at(t, name) for name in self.values}
        if ZERO in self.names:
            for name in ("z", "gap"):
                if name in found:
                    found[name] = found[name] + theta[self.names.index(ZERO)]
        return found

    def counting(self, theta: Floats) -> dict[str, Any]:
        """Which samples count: those that are there, and of velocities, which jump, only those that have no contact between their neighbours."""
        flight = self.flight(theta)
        contacts = flight.contacts + self.clock(theta, flight)
        before, after = np.append(-math.inf, self.times[:-1]), np.append(self.times[1:], math.inf)
        between = np.searchsorted(contacts, after, side="right") > np.searchsorted(contacts, before, side="left")
        return {name: np.isfinite(values) & ~(between & (QUANTITIES[name][0] != "m")) for name, values in self.values.items()}

    def residuals(self, theta: Floats, counts: Mapping[str, Any]) -> Floats:
        """What the model is off, over the noise, where it counts."""
        found = self.model(theta, self.times)
        parts = []
        for name, values in self.values.items():
            off = (found[name] - values)[counts[name]] / self.noise[name]
            parts.append(off - off.mean() if name in self.floating and len(off) else off)
        return np.concatenate(parts)

    # What is told

    def told(self, theta: Floats, found: Fitted | None) -> Comparison:
        """The comparison with these values of the fields."""
        counts = self.counting(theta) if found is None else found.counts
        model = self.model(theta, self.times)
        grid = np.union1d(np.linspace(self.times[0], self.times[-1], 2000), self.times)
        curve = {"time": grid} | self.model(theta, grid)
        points: dict[str, Any] = {"time": self.times}
        rows = []
        for name, values in self.values.items():
            own = counts[name]
            if name in self.floating and own.any():
                shift = float((model[name] - values)[own].mean())
                model[name], curve[name] = model[name] - shift, curve[name] - shift
            off = model[name] - values
            points |= {name: values, f"{name}_model": model[name], f"{name}_residual": off, f"{name}_counts": own}
            rms, most = (math.sqrt(float(np.mean(off[own] ** 2))), float(np.abs(off[own]).max())) if own.any() else (math.nan, math.nan)
            known = self.given or noise_of(self.times, values) is not None
            rows.append((name, int(own.sum()), rms, most, self.noise[name] if known else math.nan, QUANTITIES[name][0]))
        misfit = pd.DataFrame(rows, columns=["quantity", "points", "rms", "largest", "noise", "unit"]).set_index("quantity")
        fitted = self.table(theta, found)
        scene = self.made([float(theta[k]) for k in self.flown])
        held = {
            name: value
            for name, value in flat(self.scene.model_dump(exclude_unset=True))
            if name not in self.names and not name.startswith(("run.", "solver."))
        }
        return Comparison(scene, fitted, misfit, pd.DataFrame(points), pd.DataFrame(curve), held, tuple(self.notes(fitted, misfit, counts)))

    def table(self, theta: Floats, found: Fitted | None) -> pd.DataFrame:
        """The fitted fields."""
        head = ["field", "value", "standard_error", "low", "high", "blocks_low", "blocks_high", "least", "most", "unit"]
        rows = []
        if found is not None:
            for k, name in enumerate(self.names):
                unit = {CLOCK: "s", ZERO: "m"}.get(name) or unit_of(name)
                rows.append((name, theta[k], found.errors[k], *found.profile[k], *found.blocks[k], self.low[k], self.high[k], unit))
        return pd.DataFrame(rows, columns=head).set_index("field")

    def notes(self, fitted: pd.DataFrame, misfit: pd.DataFrame, counts: Mapping[str, Any]) -> Iterator[str]:
        """What to be wary of."""
        if self.record.left_out:
            yield f"left out: {', '.join(map(repr, self.record.left_out))}, which are not quantities that can be compared"
        if self.earlier:
            yield f"{self.earlier} times of the record before the scene's start are left out"
        if self.floating:
            yield f"{', '.join(self.floating)}: compared up to a constant, because their zero is not known"
        for name, values in self.values.items():
            beside = int(np.isfinite(values).sum() - counts[name].sum())
            if beside:
                yield f"{name}: {beside} samples next to a contact, where velocities jump, are not compared"
        for name, row in fitted.iterrows():
            width = row["high"] - row["low"]
            if min(row["value"] - row["least"], row["most"] - row["value"]) <= 1e-6 * (row["most"] - row["least"]):
                yield f"{name} lies at the end of its range, {row['least']:.6g} to {row['most']:.6g}: a wider range may contain a better value"
            if row["blocks_high"] - row["blocks_low"] > TIED * width:
                yield (
                    f"{name}: neighbouring residuals are correlated, so they are not noise alone: the interval from blocks of them is wider, "
                    f"{row['blocks_low']:.6g} to {row['blocks_high']:.6g}"
                )
        for name, row in misfit.iterrows():
            if row["rms"] > FAR * row["noise"]:
                yield f"{name}: the model is off by {row['rms'] / row['noise']:.3g} times the record's noise"


def check_scene(scene: Scene) -> None:
    """Only one grain whose path is no matter of chance can be compared in time."""
    if scene.cloud is not None:
        raise SceneError("cloud: a record is of one grain: leave the table out")
    if scene.effects == AUTO:
        raise SceneError("effects = 'auto' needs the means of many jumps: list the effects that act on the grain of the record")
    if scene.bed is not None and scene.bed.roughness != "flat":
        raise SceneError(f"bed.roughness must be 'flat', got {scene.bed.roughness!r}: over a rough bed contacts are random, and cannot be those of a record")


def floor_of(scene: Scene) -> float:
    """The height of a centre at the bed, m."""
    return 0.5 * scene.grain.diameter if scene.bed is not None else 0.0


def for_time(scene: Scene, length: float) -> Scene:
    """The scene for so many seconds; its memory reaches on, by powers of two, so that its tables serve other scenes too."""
    change: dict[str, Any] = {"run": {"duration": length, "jumps": None, "discard": 0, "trajectory": True}}
    if "history" in scene.names and scene.bed is not None and scene.solver.method == "collocation" and scene.options("history").horizon is None:
        reach = 2.0 ** math.ceil(math.log2(2.0 * length / scene.numbers.time))
        change["history"] = scene.options("history").model_dump(exclude_none=True) | {"horizon": reach}
    return scene.changed(**change)


def changed(scene: Scene, values: Mapping[str, float]) -> Scene:
    """The scene with these values of fields, "start.velocity.z" being the third number of a field."""
    tables: dict[str, Any] = {}
    for name, number in values.items():
        path = name.split(".")
        value: float | list[float] = number
        if len(path) == 3 and path[-1] in tuple(AXES):
            vector = tables.get(path[0], {}).get(path[1]) or value_of(scene, ".".join(path[:2]))
            if not isinstance(vector, list):
                raise ValueError(f"{'.'.join(path[:2])} must have three numbers in the scene where one of them is fitted, got {_validate.shown(vector)}")
            value = [number if axis == path[2] else one for axis, one in zip(AXES, vector, strict=True)]
            path = path[:2]
        if len(path) != 2 or not all(path):
            raise ValueError(f"fit must be fields of the scene, as table.field, {CLOCK!r} or {ZERO!r}, got {name!r}")
        content = scene.model_dump(exclude_none=True)
        if path[0] not in content and hasattr(scene, path[0]) and path[0] in scene.names:
            tables.setdefault(path[0], scene.options(path[0]).model_dump(exclude_none=True))
        tables.setdefault(path[0], {})[path[1]] = value
    return scene.changed(**tables)


def value_of(scene: Scene, name: str) -> Any:
    """What the scene says of a field; None if nothing."""
    path = name.split(".")
    table = scene.options(path[0]) if path[0] in scene.names else getattr(scene, path[0], None)
    found = getattr(table, path[1], None) if len(path) > 1 else None
    if len(path) == 3 and isinstance(found, list) and path[2] in AXES:
        return found[AXES.index(path[2])]
    return found


def unit_of(name: str) -> str:
    """What a scene says of the field."""
    path = name.split(".")
    return _field(Scene, path[:2])[1].partition(":")[0].partition(";")[0]


def flat(content: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Fields of tables within tables."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value
