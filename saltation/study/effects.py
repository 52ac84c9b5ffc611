"""Which effects a scene calls for: estimated from its dimensionless numbers, measured by leaving each out, chosen within a tolerance.

A force is judged in a typical jump of the published regressions, by its own formula: what is estimated is what would be
computed. `ablate` measures, `choose` decides by measurement.
"""

from __future__ import annotations

import contextlib
import math
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from saltation._keys import key_of
from saltation.effects import EFFECTS
from saltation.effects.base import Setting
from saltation.effects.turbulence import profiles_of
from saltation.scene import Scene, SceneError
from saltation.scene.conditions import Typical, settling_velocity, situations, typical
from saltation.study import cases
from saltation.study.cases import (
    VARIABLES,
    Progress,
    change_bound,
    compare,
    fly,
    fly_to_error,
    jumps_flown,
    largest_change,
    relative_costs,
    require_bed,
    with_listed_effects,
    without,
)

__all__ = ["Typical", "Verdict", "ablate", "advise", "choose", "thresholds", "typical"]

MATTERS, MINOR = 0.1, 0.02  # of the weight: from here on an effect is called for, below it may be left out
TOLERANCE = 0.05  # of a choice, unless the scene gives one
SHARPNESS = 0.2  # standard error of the mean height in a choice, over its tolerance
SMOOTH = 5.0  # k_s+: up to here a bed is smooth
NEEDED = ("weight",)  # without it nothing comes down


@dataclass(frozen=True)
class Verdict:
    """What an effect does in a typical jump: is it in the scene, its share of the weight (1 for a prescribed spin), a word, why, and whose formula."""

    effect: str
    present: bool
    share: float
    verdict: str
    reason: str
    source: str


def advise(scene: Scene) -> list[Verdict]:
    """Which effects a scene calls for, from its dimensionless numbers alone: one verdict per effect known.

    The share is the force over the submerged weight, root mean square over a typical jump; for history the mean of c·Δ·K over the jump, Δ twice the
    takeoff speed; for added mass its share of the inertia; for rotation what the spin loses in a jump; for encounters their number per jump.

    >>> import saltation
    >>> {row.effect: row.verdict for row in advise(saltation.load("sand"))}["history"]
    'keep'
    """
    jump, numbers = typical(scene), scene.numbers
    setting = scene._setting(scene.profile)
    weight = 1.0 / abs(numbers.shields)
    verdicts = []
    for name, module in EFFECTS.items():
        share, reason = _share(scene, name, module, setting, jump, weight)
        word = "needed" if name in NEEDED else "keep" if share >= MATTERS else "try without" if share >= MINOR else "leave out"
        verdicts.append(Verdict(name, name in scene.names, share, word, reason, module.SOURCE))
    return verdicts


def _share(scene: Scene, name: str, module: Any, setting: Setting, jump: Typical, weight: float) -> tuple[float, str]:
    """(share, reason) of one effect."""
    numbers = setting.numbers
    options = scene.options(name)
    if name == "weight":
        return 1.0, f"τ* = {numbers.shields:.3g}: without weight no grain comes down"
    if name == "history":
        change = 2.0 * jump.rise
        share = numbers.history * change * 2.0 / math.sqrt(jump.duration) / (numbers.alpha * weight)
        text = f"c = {numbers.history:.3g} (9α/√(π Re*), Re* = {numbers.reynolds:.3g})"
        return share, f"{text}: the rebound's slip jump of {change:.2g} V over {jump.duration:.2g} d/V{_told(thresholds(scene))}"
    if name == "added_mass":
        share = options.coefficient / (numbers.density_ratio + options.coefficient)
        return share, f"C_m/(ρ_s/ρ + C_m) with ρ_s/ρ = {numbers.density_ratio:.3g}: share of the inertia"
    if name == "encounters":
        if scene.cloud is None:
            return 0.0, "a single grain has no encounters"
        often = 6.0 / math.pi * scene.cloud.concentration * math.pi * 1.5 * jump.duration
        return often, f"about {often:.2g} encounters per jump at C_p = {scene.cloud.concentration:g} (kinetic theory, relative speed 1.5 V)"
    met = situations(scene, jump)
    if name == "turbulence":
        if scene.channel is None:
            return 0.0, "in still water nothing fluctuates"
        drag = EFFECTS["drag"].build(scene.options("drag"), setting)
        share, least = 0.0, math.inf
        for s in met:
            found = profiles_of(options, setting, s.z)
            pushed = s._replace(slip_x=s.slip_x - found.along, slip_y=s.slip_y - found.across, slip_z=s.slip_z - found.up)
            share += float(np.sum((np.array(drag.force(pushed)) - drag.force(s)) ** 2)) / len(met)
            least = min(least, float(found.time))
        share = math.sqrt(share) / weight
        deep = "" if scene.channel.depth is not None else "; channel.depth is not given and taken as large"
        return share, f"fluctuations change the drag by {_multiple(share)} the submerged weight, with time scales from {least:.2g} d/u* on{deep}"
    built = module.build(options, setting)
    if name == "rotation":
        if built is None:
            return 1.0, "the spin is prescribed"
        loss = max(abs(built.torque(s)[1]) for s in met) * jump.duration / max(jump.spin, 1e-300)
        if loss >= 1.0:
            return 1.0, f"the fluid's torque takes the spin to the stream's within {jump.duration / loss:.2g} d/V, less than a jump of {jump.duration:.2g} d/V"
        return loss, f"in a jump of {jump.duration:.2g} d/V the fluid's torque changes the spin by {loss:.1%}"
    if built is None:
        return 0.0, "no force in this form"
    forces = np.array([built.force(s) for s in met])
    share = float(np.sqrt((forces**2).sum(axis=1).mean())) / weight
    return share, f"{_multiple(share)} the submerged weight in a jump {jump.height:.2g} d high at {jump.speed:.2g} V"


def _multiple(share: float) -> str:
    """A share in words: in per cent as long as these can be read."""
    return f"{share:.0%} of" if share < 10.0 else f"{share:.2g} times"


class Threshold(NamedTuple):
    """Up to where a source takes the history force to matter."""

    source: str
    symbol: str
    value: float  # of the scene
    bound: float

    @property
    def calls(self) -> bool:
        """Whether the scene lies within."""
        return self.value <= self.bound


def thresholds(scene: Scene) -> list[Threshold]:
    """Where three sources draw the line for the history force (thesis section 2.2): in R_p, and in Reynolds numbers of the settling velocity w_s.

    Armenio and Fiorotto find it important for w_s a/ν (a: radius) of order 1 or less. None for a grain that does not settle.
    """
    speed = settling_velocity(scene)
    if speed is None:
        return []
    settling = speed * scene.grain.diameter / scene.fluid.viscosity
    return [
        Threshold("Niño & García 1994", "R_p", scene.numbers.particle_reynolds, 100.0),
        Threshold("Mordant & Pinton 2000", "w_s d/ν", settling, 4000.0),
        Threshold("Armenio & Fiorotto 2001", "w_s a/ν", 0.5 * settling, 1.0),
    ]


def _told(found: list[Threshold]) -> str:
    """The thresholds in half a sentence."""
    if not found:
        return ""
    parts = [f"{own.symbol} = {own.value:.3g} {'≤' if own.calls else '>'} {own.bound:g} ({own.source})" for own in found]
    return f"; {sum(own.calls for own in found)} of {len(found)} published thresholds call for it: {', '.join(parts)}"


# Leaving out


def ablate(scene: Scene, executor: Executor | None = None, *, error: float = 0.01, progress: Progress | None = None) -> pd.DataFrame:
    """Run a scene with each of its effects left out, one at a time, all with the scene's seed; it needs a bed.

    `error`: wanted relative standard error of the mean height, which decides how many jumps are flown (20 000 at most); a scene that runs for a time is flown
    as long as it says. Rows "full" and the effects that can be left out; columns status, jumps, height (d), length (d), velocity (u*), of each its
    relative `_change` against the full scene and the `_error` (one standard error) of that (in the first row of its own mean), and time: seconds per jump
    over those of the full scene (NaN for runs for a time, and for those that do not finish).
    """
    scenes = reduced(scene)
    table = compare(fly_to_error(scenes, error, executor, progress)[0])
    table["time"] = relative_costs({name: scenes[name] for name in table.index})
    return table


def reduced(scene: Scene) -> dict[str, Scene]:
    """The full scene, and without each of its effects that can be left out."""
    require_bed(scene)
    full = with_listed_effects(scene)
    scenes = {"full": full}
    for name in full.names:
        with contextlib.suppress(SceneError):  # what is left makes no scene
            scenes[name] = without(full, [name])
    return scenes


def choose(scene: Scene, tolerance: float | None = None, executor: Executor | None = None, *, progress: Progress | None = None) -> Scene:
    """The scene with fewer effects: enough to keep mean H, L and ū within a relative tolerance (default the scene's, or 0.05) of those with all effects.

    Effects whose removal changes less than the tolerance (95 % bounds, with up to 20 000 jumps where that decides) are left out together; while the sum of
    them changes too much, the one that changes most is put back. What can be left out only then is tried last. The bounds are not corrected for repeated
    and multiple tests: for changes near the tolerance a wrong choice is likelier than 5 %. The same scene always gives the same choice. A scene that does not
    finish with all its effects keeps them. The field `chosen` of the scene returned records the choice.
    """
    if tolerance is None:
        tolerance = scene.tolerance or TOLERANCE
    if not 0.0 < tolerance <= 0.5:
        raise ValueError(f"tolerance must be above 0 and at most 0.5, got {tolerance!r}")
    scenes = reduced(scene)
    full = scenes["full"]
    raw, count, total = fly_to_error(scenes, SHARPNESS * tolerance, executor, progress)
    tried: list[dict[str, Any]] = []

    def settled(raw: pd.DataFrame, scenes: dict[str, Scene]) -> pd.DataFrame:
        """The comparison, what is undecided flown with more and more jumps."""
        nonlocal total
        jumps = count
        while True:
            table = compare(raw)
            undecided = {name: made for name, made in scenes.items() if largest_change(table.loc[name]) <= tolerance < change_bound(table.loc[name])}
            if not undecided or jumps >= cases.MOST or full.run.jumps is None:
                return table
            jumps = min(cases.MOST, 4 * jumps)
            more = fly({"full": full} | undecided, jumps, executor, None)
            total += jumps_flown(more, full)
            raw = pd.concat([more, raw.drop(more.index)]).loc[raw.index]

    table = settled(raw, {name: made for name, made in scenes.items() if name != "full"})
    rows = {str(name): row for name, row in table.iterrows()}

    def fits(names: list[str]) -> bool:
        """Whether the scene can do without all of them."""
        nonlocal total
        if len(names) == 1 and names[0] in rows:
            last = rows[names[0]]
        else:
            try:
                trial = {"chosen": without(full, names)}
            except SceneError:  # what is left makes no scene
                return False
            flight = fly(trial, count, executor, None)
            total += jumps_flown(flight, full)
            last = settled(pd.concat([raw.iloc[:1], flight]), trial).iloc[1]
            tried.append({"left_out": list(names), "bound": bound_or_reason(last)})
        if change_bound(last) <= tolerance:
            rows["chosen"] = last
        return change_bound(last) <= tolerance

    left_out: list[str] = []
    if rows["full"]["status"] == "finished" and rows["full"]["jumps"] > 0:
        bounds = {name: change_bound(row) for name, row in rows.items() if name != "full" and name not in NEEDED}
        left_out = sorted((name for name, value in bounds.items() if value <= tolerance), key=bounds.__getitem__)
        while left_out and not fits(left_out):
            left_out.pop()
        for name in full.names:  # such as what no other effect needs any more
            if left_out and name not in rows and name not in NEEDED and fits([*left_out, name]):
                left_out.append(name)
    chosen = without(full, left_out)
    evidence = {
        "of": key_of(scene),
        "tolerance": tolerance,
        "status": str(rows["full"]["status"]),
        "left_out": left_out,
        "kept": list(chosen.names),
        "full": means(rows["full"]),
        "chosen": means(rows["chosen"] if left_out else rows["full"]),
        "bounds": {str(name): bound_or_reason(row) for name, row in table.iloc[1:].iterrows()},
        "tried": tried,
        "jumps": total,
    }
    return chosen.changed(chosen=evidence)


def means(row: pd.Series) -> dict[str, float]:
    """Mean H, L and ū, as far as there are any."""
    return {name: float(row[name]) for name in VARIABLES if math.isfinite(row[name])}


def bound_or_reason(row: pd.Series) -> float | str:
    """The bound, or why there is none."""
    value = change_bound(row)
    return value if math.isfinite(value) else "no jumps" if row["status"] == "finished" else str(row["status"])
