"""Which effects a scene calls for: told from its dimensionless numbers, measured by leaving each out, chosen within a tolerance.

A force is judged in a typical jump of the published regressions, by its own formula: what is estimated is what would be
computed. `ablate` measures, `choose` decides by measurement, `uncertainty` shows what the other choices of a scene do.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from basset import measure
from saltation import regressions, statistics
from saltation.bed.roughness import READINGS
from saltation.campaigns import campaign
from saltation.effects import EFFECTS
from saltation.effects.base import Setting, Situation
from saltation.effects.history import KERNELS
from saltation.effects.rotation import prescribed_spin
from saltation.flow import PROFILES, both
from saltation.scene import AUTO, SceneError, scene_of
from saltation.simulation import run

__all__ = ["Typical", "Verdict", "ablate", "advise", "choose", "combinations", "extent", "shares", "spreads", "typical", "uncertainty", "variants"]

VARIABLES = statistics.VARIABLES
MATTERS, MINOR = 0.1, 0.02  # of the weight: from here on an effect is called for, below it may be left out
PILOT, MOST, TIMED = 400, 20000, 100  # jumps: of a first look, of any run, of a timed one
BOUND = 1.96  # standard errors
TOLERANCE = 0.05  # of a choice, unless the scene gives one
SHARPNESS = 0.2  # standard error of the mean height in a choice, over its tolerance
Progress = Callable[[float], None]
SMOOTH = 5.0  # k_s+: up to here a bed is smooth
COMBINED = 300  # jumps of each combination of choices
NEEDED = ("weight",)  # without it nothing comes down
PHASES = ((0.0, 0.25), (0.5, 1.0), (1.0, 0.25))  # of a jump: share of its time, share of its height


class Verdict(NamedTuple):
    """What an effect does in a typical jump.

    Attributes
    ----------
    effect : str
        Its name in a scene.
    present : bool
        Whether the scene has it.
    share : float, dimensionless
        Of the weight, see `advise`; NaN where that means nothing.
    verdict, reason, source : str
        A word, why, and whose formula.

    Examples
    --------
    >>> import saltation
    >>> next(row for row in advise(saltation.load("sand")) if row.effect == "weight").verdict
    'needed'
    """

    effect: str
    present: bool
    share: float
    verdict: str
    reason: str
    source: str


class Typical(NamedTuple):
    """A typical jump.

    Attributes
    ----------
    height : float, d
    duration : float, d/V
    rise, speed : float, V
        Takeoff speed up and mean speed along.
    spin : float, V/d

    Examples
    --------
    >>> import saltation
    >>> jump = typical(saltation.load("sand"))
    >>> jump.height > 1.0, jump.duration > 0.0
    (True, True)
    """

    height: float
    duration: float
    rise: float
    speed: float
    spin: float


def typical(scene: Any) -> Typical:
    """The jump that the published regressions give at the scene's R_p and T (at least T = 1.2); in still water one diameter high.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Typical

    References
    ----------
    The regressions of `saltation.regressions`, their means; the takeoff and the spin: this library.

    Examples
    --------
    >>> import saltation
    >>> typical(saltation.load("settling")).height
    1.0
    """
    numbers = scene.numbers
    height, speed, spin = 1.0, 0.0, 0.0
    if numbers.stage is not None:
        stage = max(numbers.stage, 1.2)
        found = [regression(numbers.particle_reynolds, stage) for regression in regressions.REGRESSIONS.values()]
        height, speed = (float(np.mean([getattr(jump, name) for jump in found])) for name in ("height", "speed"))
        spin = max(1.0, prescribed_spin(stage))
    fall = numbers.alpha / abs(numbers.shields)
    rise = math.sqrt(2.0 * fall * height)
    return Typical(height, 2.0 * rise / fall, rise, speed, spin)


def advise(scene: Any) -> list[Verdict]:
    """Which effects a scene calls for, from its dimensionless numbers alone.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of Verdict, one per effect known
        The share is the force over the submerged weight, root mean square over a typical jump; for history the mean of c·Δ·K over
        the jump, Δ twice the takeoff speed; for added mass its share of the inertia; for rotation what the spin loses in a jump;
        for encounters their number per jump.

    References
    ----------
    The forces: each effect's `source`; the estimate: this library.

    Examples
    --------
    >>> import saltation
    >>> {row.effect: row.verdict for row in advise(saltation.load("sand"))}["history"]
    'keep'
    """
    jump, numbers = typical(scene), scene.numbers
    setting = Setting(numbers, scene.profile)
    weight = 1.0 / abs(numbers.shields)
    verdicts = []
    for name, module in EFFECTS.items():
        share, reason = _share(scene, name, module, setting, jump, weight)
        word = "needed" if name in NEEDED else "keep" if share >= MATTERS else "try without" if share >= MINOR else "leave out"
        verdicts.append(Verdict(name, name in scene.names, share, word, reason, module.SOURCE))
    return verdicts


def _share(scene: Any, name: str, module: Any, setting: Setting, jump: Typical, weight: float) -> tuple[float, str]:
    """(share, reason) of one effect."""
    numbers = setting.numbers
    options = scene.options(name)
    if name == "weight":
        return 1.0, f"τ* = {numbers.shields:.3g}: without weight nothing comes down"
    if name == "history":
        change = 2.0 * jump.rise
        share = numbers.history * change * 2.0 / math.sqrt(jump.duration) / (numbers.alpha * weight)
        text = f"c = {numbers.history:.3g} (9α/√(π Re*), Re* = {numbers.reynolds:.3g})"
        return share, f"{text}: the rebound's slip jump of {change:.2g} V over {jump.duration:.2g} d/V"
    if name == "added_mass":
        share = options.coefficient / (numbers.density_ratio + options.coefficient)
        return share, f"C_m/(ρ_s/ρ + C_m) with ρ_s/ρ = {numbers.density_ratio:.3g}: share of the inertia"
    if name == "encounters":
        if scene.cloud is None:
            return 0.0, "a single grain meets nobody"
        often = 6.0 / math.pi * scene.cloud.concentration * math.pi * 1.5 * jump.duration
        return often, f"about {often:.2g} encounters per jump at C_p = {scene.cloud.concentration:g} (kinetic theory, relative speed 1.5 V)"
    built = module.build(options, setting)
    situations = [_situation(scene, jump, *phase) for phase in PHASES]
    if name == "rotation":
        if built is None:
            return 1.0, "the spin is prescribed"
        loss = max(abs(built.torque(s)[1]) for s in situations) * jump.duration / max(jump.spin, 1e-300)
        return loss, f"in a jump of {jump.duration:.2g} d/V friction changes the spin by {loss:.1%}"
    if built is None:
        return 0.0, "no force in this form"
    forces = np.array([built.force(s) for s in situations])
    share = float(np.sqrt((forces**2).sum(axis=1).mean())) / weight
    return share, f"{share:.0%} of the submerged weight in a jump {jump.height:.2g} d high at {jump.speed:.2g} V"


def _situation(scene: Any, jump: Typical, when: float, where: float) -> Situation:
    """The grain in its typical jump."""
    z = 0.75 + where * jump.height
    stream, shear = both(scene.profile, z)
    return Situation(z, jump.speed - stream, 0.0, jump.rise * (1.0 - 2.0 * when), stream, shear, 0.0, jump.spin, 0.0)


# Leaving out


def changed(scene: Any, **tables: Any) -> Any:
    """The scene with other fields: tables are merged, the rest is replaced; what None replaces is taken out.

    Raises
    ------
    SceneError
        If there is no such scene.
    """
    content = scene.model_dump(exclude_none=True)
    for name, value in tables.items():
        merged = {**content.get(name, {}), **value} if isinstance(value, dict) else value
        content[name] = {key: item for key, item in merged.items() if item is not None} if isinstance(merged, dict) else merged
    return scene_of(content)


def without(scene: Any, left_out: Iterable[str]) -> Any:
    """The scene without some effects."""
    gone = set(left_out)
    return changed(scene, effects=[name for name in scene.names if name not in gone])


def long(scene: Any, jumps: int) -> Any:
    """The scene with so many jumps that count; a run for a time stays as long as it is."""
    return scene if scene.run.jumps is None else changed(scene, run={"jumps": jumps + scene.run.discard})


def enough(scenes: dict[str, Any], error: float, executor: Executor | None, progress: Progress | None) -> pd.DataFrame:
    """The campaign over scenes, with as many jumps as the mean height of the first needs for a relative standard error."""
    share = (lambda low, high: None) if progress is None else (lambda low, high: lambda done: progress(low + (high - low) * done))
    labelled = [({"case": name}, long(scene, PILOT)) for name, scene in scenes.items()]
    table = campaign(labelled, executor, progress=share(0.0, 0.5)).set_index("case")
    first = table.iloc[0]
    wanted = PILOT * (first["height_se"] / (error * first["height"])) ** 2 if first["height"] > 0.0 else 0.0
    if wanted > PILOT and scenes[str(table.index[0])].run.jumps is not None:
        count = min(MOST, math.ceil(wanted / 100.0) * 100)
        labelled = [({"case": name}, long(scene, count)) for name, scene in scenes.items()]
        table = campaign(labelled, executor, progress=share(0.5, 1.0)).set_index("case")
    return table


def compare(table: pd.DataFrame) -> pd.DataFrame:
    """Relative changes of H, L and ū of every row against the first, with their standard errors."""
    full, found = table.iloc[0], table[["status", "jumps"]].copy()
    for name in VARIABLES:
        found[name] = table[name]
        found[f"{name}_change"] = table[name] / full[name] - 1.0
        found[f"{name}_error"] = np.hypot(table[f"{name}_se"], full[f"{name}_se"]) / abs(full[name])
    return found


def ablate(scene: Any, executor: Executor | None = None, *, error: float = 0.01, progress: Progress | None = None) -> pd.DataFrame:
    """Run a scene with each of its effects left out, one at a time, all with the scene's seed.

    Parameters
    ----------
    scene : Scene
        With a bed: it is jumps that are compared.
    executor : concurrent.futures.Executor, optional
        As for `saltation.campaign`.
    error : float, dimensionless
        Wanted relative standard error of the mean height; decides how many jumps are flown (20 000 at most). A scene that
        runs for a time is flown as long as it says.
    progress : callable or None
        Called with the share that is done, 0 to 1 (dimensionless).

    Returns
    -------
    DataFrame
        Index: "full" and the effects that can be left out; columns status, jumps, height (d), length (d), velocity (u*), of each its
        relative `_change` against the full scene and the `_error` (one standard error) of that, and time: seconds per jump over
        those of the full scene (NaN for runs for a time).

    Raises
    ------
    SceneError
        If the scene has no bed.

    Examples
    --------
    >>> import saltation
    >>> try:
    ...     ablate(saltation.load("settling"))
    ... except SceneError as error:
    ...     print(str(error).partition(":")[0])
    bed is missing
    """
    cases = reduced(scene)
    table = compare(enough(cases, error, executor, progress))
    table["time"] = costs({name: cases[name] for name in table.index})
    return table


def reduced(scene: Any) -> dict[str, Any]:
    """The full scene, and without each of its effects that can be left out."""
    require_bed(scene)
    cases = {"full": changed(scene, effects=list(scene.names), tolerance=None)}
    for name in scene.names:
        try:
            cases[name] = without(scene, [name])
        except SceneError:  # what is left makes no scene
            continue
    return cases


def require_bed(scene: Any) -> None:
    """Only jumps can be compared."""
    if scene.bed is None:
        raise SceneError("bed is missing: it is jumps that are compared, and without a bed there are none")


def costs(scenes: dict[str, Any]) -> pd.Series:
    """Seconds per jump of each scene over those of the first, taking turns."""
    if any(scene.run.jumps is None for scene in scenes.values()):
        return pd.Series(math.nan, index=list(scenes))
    timed = {name: changed(scene, run={"jumps": TIMED, "discard": 0, "trajectory": False}) for name, scene in scenes.items()}
    seconds = pd.Series(measure.interleaved({name: partial(run, scene) for name, scene in timed.items()}, rounds=5, patience=60.0))
    return seconds / seconds.iloc[0]


def bound(row: pd.Series) -> float:
    """Largest relative change of H, L or ū that a row does not rule out (95 %); infinite where it jumps no more."""
    bounds = [abs(row[f"{name}_change"]) + BOUND * row[f"{name}_error"] for name in VARIABLES]
    return float(max(bounds)) if row["status"] == "finished" and np.isfinite(bounds).all() else math.inf


def choose(scene: Any, tolerance: float = TOLERANCE, executor: Executor | None = None, *, progress: Progress | None = None) -> Any:
    """The scene with as few effects as keep its mean H, L and ū within a tolerance of those with all of them.

    Effects that the ablation finds within the tolerance (95 % bounds) are left out together; while that is too much, the one
    that changes most is put back. The same scene always comes to the same choice.

    Parameters
    ----------
    scene : Scene
        With a bed and all effects that are considered.
    tolerance : float, dimensionless
        Relative.
    executor, progress
        As for `ablate`, the share dimensionless.

    Returns
    -------
    Scene
        Its field `chosen` holds the evidence: tolerance, left_out, kept, means of the full scene and of the chosen one, for each
        effect the 95 % `bounds` of the largest relative change of H, L and ū without it (or the status of a run that did not
        finish), what was tried together, and the number of jumps flown to find out.

    Raises
    ------
    SceneError
        If the scene has no bed, or does not finish its run with all its effects.

    Examples
    --------
    >>> import saltation
    >>> try:
    ...     choose(saltation.load("settling"))
    ... except SceneError as error:
    ...     print(str(error).partition(":")[0])
    bed is missing
    """
    cases = reduced(scene)
    full = cases["full"]
    error = SHARPNESS * tolerance
    table = compare(enough(cases, error, executor, progress))
    first = table.iloc[0]
    if first["status"] != "finished":
        raise SceneError(f"effects can only be chosen for a scene that finishes with all of them, got {first['status']!r}")
    bounds = {str(name): bound(row) for name, row in table.iloc[1:].iterrows()}
    left_out = sorted((name for name, value in bounds.items() if value <= tolerance and name not in NEEDED), key=bounds.__getitem__)
    tried, last, flown = [], first, int(table["jumps"].sum())
    while left_out:
        try:
            trial = without(full, left_out)
        except SceneError:  # what is left makes no scene
            left_out.pop()
            continue
        pair = compare(enough({"full": full, "chosen": trial}, error, executor, None))
        flown += int(pair["jumps"].sum())
        tried.append({"left_out": list(left_out), "bound": shown(pair.iloc[1])})
        if bound(pair.iloc[1]) <= tolerance:
            last = pair.iloc[1]
            break
        left_out.pop()
    chosen = without(full, left_out)
    evidence = {
        "tolerance": tolerance,
        "left_out": left_out,
        "kept": list(chosen.names),
        "full": {name: float(first[name]) for name in VARIABLES},
        "chosen": {name: float((last if left_out else first)[name]) for name in VARIABLES},
        "bounds": {str(name): shown(row) for name, row in table.iloc[1:].iterrows()},
        "tried": tried,
        "jumps": flown,
    }
    return changed(chosen, chosen=evidence)


def resolved(scene: Any, executor: Executor | None = None, *, progress: Progress | None = None) -> Any:
    """The scene itself, or with effects = "auto" what `choose` makes of it."""
    return choose(scene, scene.tolerance or TOLERANCE, executor, progress=progress) if scene.effects == AUTO else scene


def shown(row: pd.Series) -> float | str:
    """The bound, or why there is none."""
    value = bound(row)
    return value if math.isfinite(value) else str(row["status"])


# Other choices


def variants(scene: Any) -> dict[str, dict[str, Any]]:
    """Scenes that differ from this one in one choice; what makes no scene is left out.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict of dict of Scene
        Choice -> value -> scene.

    Examples
    --------
    >>> import saltation
    >>> found = variants(saltation.load("sand"))
    >>> all(isinstance(scene, saltation.scene.Basis) for values in found.values() for scene in values.values())
    True
    """
    found: dict[str, dict[str, Any]] = {}
    for choice, values in _choices(scene).items():
        for value, change in values.items():
            try:
                found.setdefault(choice, {})[value] = changed(scene, **change)
            except SceneError:
                continue
    return found


def _choices(scene: Any) -> dict[str, dict[str, dict[str, dict[str, Any]]]]:
    """What measurement has not settled: choice -> value -> table -> field -> value; a law for smooth beds only where the bed is."""
    tables: dict[str, dict[str, dict[str, Any]]] = {}
    if scene.channel is not None:
        wall = scene.numbers.reynolds * (scene.channel.roughness_height or scene.grain.diameter) / scene.grain.diameter
        known = [name for name in PROFILES if name != "none" and (name != "reichardt" or wall < SMOOTH)]
        tables["profile"] = {name: {"channel": {"profile": name}} for name in known}
    if scene.bed is not None:
        tables["reading"] = {name: {"bed": {"reading": name}} for name in READINGS}
        given = scene.bed.restitution
        tables["restitution"] = {f"{value}": {"bed": {"restitution": value}} for value in dict.fromkeys((given, 0.5, 0.8, "set1", "stokes"))}
    if "history" in scene.names:
        tables["kernel"] = {name: {"history": {"kernel": name}} for name in ("basset", *KERNELS)}
        tables["rebound memory"] = {name: {"history": {"rebound": name}} for name in ("impulse", "restart", "reset", "none")}
    return tables


def uncertainty(scene: Any, executor: Executor | None = None, *, error: float = 0.02, progress: Progress | None = None) -> pd.DataFrame:
    """The spread over the choices that measurement has not settled, one at a time, beside the standard error.

    Parameters
    ----------
    scene : Scene
        With a bed.
    executor, progress
        As for `ablate`, the share dimensionless.
    error : float, dimensionless
        Wanted relative standard error of the mean height.

    Returns
    -------
    DataFrame
        One row per choice and value, the scene itself first ("scene", "as given"): choice, value, status, jumps, height (d), length (d),
        velocity (u*), relative changes and their standard errors as for `ablate`.

    Raises
    ------
    SceneError
        If the scene has no bed.

    Examples
    --------
    >>> import saltation
    >>> try:
    ...     uncertainty(saltation.load("settling"))
    ... except SceneError as error:
    ...     print(str(error).partition(":")[0])
    bed is missing
    """
    require_bed(scene)
    scene = changed(scene, effects=list(scene.names), tolerance=None)
    cases = {("scene", "as given"): scene} | {(choice, value): made for choice, values in variants(scene).items() for value, made in values.items()}
    names = {" ".join(case): case for case in cases}
    table = compare(enough({name: cases[case] for name, case in names.items()}, error, executor, progress))
    table.insert(0, "choice", [names[str(name)][0] for name in table.index])
    table.insert(1, "value", [names[str(name)][1] for name in table.index])
    return table.reset_index(drop=True)


def spreads(table: pd.DataFrame) -> pd.DataFrame:
    """Lowest and highest mean of H, L and ū over each choice's values that finish, over that of the scene itself.

    Parameters
    ----------
    table : DataFrame
        From `uncertainty`, units as there.

    Returns
    -------
    DataFrame, one row per choice, dimensionless
        choice; of height, length and velocity `_low` and `_high`.

    Examples
    --------
    >>> row = {"choice": "scene", "status": "finished", "height": 2.0, "length": 10.0, "velocity": 5.0}
    >>> rows = [row, row | {"choice": "drag", "height": 3.0}, row | {"choice": "drag", "height": 1.0}]
    >>> spreads(pd.DataFrame(rows))[["height_low", "height_high"]].values.tolist()
    [[0.5, 1.5]]
    """
    base = table.iloc[0]
    finished = table[table["status"] == "finished"]
    rows = []
    for choice, own in finished.iloc[1:].groupby("choice", sort=False):
        row: dict[str, Any] = {"choice": choice}
        for name in VARIABLES:
            row[f"{name}_low"], row[f"{name}_high"] = own[name].min() / base[name], own[name].max() / base[name]
        rows.append(row)
    return pd.DataFrame(rows)


def combinations(scene: Any, executor: Executor | None = None, *, progress: Progress | None = None) -> pd.DataFrame:
    """Every choice combined with every other, some hundred runs of 300 jumps each.

    Parameters
    ----------
    scene : Scene
        With a bed.
    executor, progress
        As for `ablate`, the share dimensionless.

    Returns
    -------
    DataFrame
        One row per combination: a column per choice with its value, status, height (d), length (d), velocity (u*).

    Raises
    ------
    SceneError
        If the scene has no bed.

    Examples
    --------
    >>> import saltation
    >>> try:
    ...     combinations(saltation.load("settling"))
    ... except SceneError as error:
    ...     print(str(error).partition(":")[0])
    bed is missing
    """
    require_bed(scene)
    scene = long(changed(scene, effects=list(scene.names), tolerance=None), COMBINED)
    choices = _choices(scene)
    labelled = []
    for values in itertools.product(*choices.values()):
        tables: dict[str, dict[str, Any]] = {}
        for choice, value in zip(choices, values, strict=True):
            for table, fields in choices[choice][value].items():
                tables[table] = tables.get(table, {}) | fields
        with contextlib.suppress(SceneError):  # what makes no scene
            labelled.append((dict(zip(choices, values, strict=True)), changed(scene, **tables)))
    return campaign(labelled, executor, progress=progress)[[*choices, "status", *VARIABLES]]


def shares(table: pd.DataFrame) -> pd.DataFrame:
    """How much of the spread each choice makes by itself.

    Parameters
    ----------
    table : DataFrame
        From `combinations`, units as there.

    Returns
    -------
    DataFrame, one row per choice, dimensionless
        For H, L and ū the variance of the means over its values of the logarithm, over the variance of all that finish. What is
        missing to 1 is interplay.

    References
    ----------
    A first Sobol index: Sobol (1993), Math. Model. Comput. Exp. 1, 407.

    Examples
    --------
    >>> rows = [(law, stream, "finished", height, 9.0 * height, height) for law, height in (("yen", 1.0), ("rubey", 2.0)) for stream in "ab"]
    >>> table = pd.DataFrame(rows, columns=["drag", "profile", "status", "height", "length", "velocity"])
    >>> shares(table)["height"].round(12).tolist()  # the law of drag does it all
    [1.0, 0.0]
    """
    finished = table[(table["status"] == "finished") & (table["height"] > 0.0)]
    logarithms = np.log(finished[list(VARIABLES)].astype(float))
    choices = [str(name) for name in table if name not in ("status", *VARIABLES)]
    rows = {}
    for choice in choices:
        means = logarithms.groupby(finished[choice]).transform("mean")
        rows[choice] = means.var(ddof=0) / logarithms.var(ddof=0)
    return pd.DataFrame(rows).T


def extent(table: pd.DataFrame) -> pd.DataFrame:
    """The 5, 50 and 95 % quantiles of H, L and ū over all combinations that finish.

    Parameters
    ----------
    table : DataFrame
        From `combinations`, units as there.

    Returns
    -------
    DataFrame, three rows
        height and length (d) and velocity (u*) by quantile.

    Examples
    --------
    >>> table = pd.DataFrame({"status": ["finished", "finished", "aloft"], "height": [1.0, 3.0, 99.0], "length": 9.0, "velocity": 5.0})
    >>> extent(table).loc[0.5, "height"]
    np.float64(2.0)
    """
    return table.loc[table["status"] == "finished", list(VARIABLES)].quantile([0.05, 0.5, 0.95])
