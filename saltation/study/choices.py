"""The effect of modelling choices that measurements leave open: one at a time, and combined."""

from __future__ import annotations

import contextlib
import itertools
from concurrent.futures import Executor
from typing import Any

import numpy as np
import pandas as pd

from saltation.bed.roughness import READINGS
from saltation.effects.history import DECAYS, KERNELS, REJECTED
from saltation.flow import PROFILES
from saltation.scene import Scene, SceneError
from saltation.study.campaigns import campaign
from saltation.study.cases import VARIABLES, Progress, compare, fly_to_error, require_bed, with_jumps, with_listed_effects

__all__ = ["combinations", "extent", "shares", "spreads", "uncertainty", "variants"]

SMOOTH = 5.0  # k_s+: up to here a bed is smooth
COMBINED = 300  # jumps of each combination of choices


def variants(scene: Scene) -> dict[str, dict[str, Scene]]:
    """Choice -> value -> scene: the scenes that differ from this one in one choice; what makes no scene is left out."""
    found: dict[str, dict[str, Scene]] = {}
    for choice, values in _choices(scene).items():
        for value, change in values.items():
            try:
                found.setdefault(choice, {})[value] = scene.changed(**change)
            except SceneError:
                continue
    return found


def _choices(scene: Scene) -> dict[str, dict[str, dict[str, dict[str, Any]]]]:
    """What measurement has not settled: choice -> value -> table -> field -> value; a law for smooth beds only where the bed is."""
    tables: dict[str, dict[str, dict[str, Any]]] = {}
    if scene.channel is not None:
        wall = scene.numbers.reynolds * (scene.channel.roughness_height or scene.grain.diameter) / scene.grain.diameter
        known = [name for name in PROFILES if name != "none" and (name != "reichardt" or wall < SMOOTH)]
        tables["profile"] = {name: {"channel": {"profile": name}} for name in known}
    if scene.bed is not None:
        tables["reading"] = {name: {"bed": {"reading": name}} for name in READINGS}
        given = scene.bed.restitution
        others = [value for value in (0.5, 0.8, "set1", "stokes") if value != given]
        tables["restitution"] = {f"{given}": {}} | {f"{value}": {"bed": {"restitution": value, "stokes_decay": None}} for value in others}
    if "history" in scene.names:
        tables["kernel"] = {name: {"history": {"kernel": name}} for name in ("basset", *KERNELS)}
        own = scene.options("history").rebound
        tables["rebound memory"] = {name: {"history": {"rebound": name}} for name in DECAYS if name not in REJECTED or name == own}
    return tables


def uncertainty(scene: Scene, executor: Executor | None = None, *, error: float = 0.02, progress: Progress | None = None) -> pd.DataFrame:
    """The spread over the choices that measurement has not settled, one at a time, beside the standard error; the scene needs a bed.

    One row per choice and value, the scene itself first ("scene", "as given"): choice, value, status, jumps, height (d), length (d), velocity (u*),
    relative changes and their standard errors as for `ablate`.
    """
    require_bed(scene)
    scene = with_listed_effects(scene)
    cases = {("scene", "as given"): scene} | {(choice, value): made for choice, values in variants(scene).items() for value, made in values.items()}
    names = {" ".join(case): case for case in cases}
    table = compare(fly_to_error({name: cases[case] for name, case in names.items()}, error, executor, progress)[0])
    table.insert(0, "choice", [names[str(name)][0] for name in table.index])
    table.insert(1, "value", [names[str(name)][1] for name in table.index])
    return table.reset_index(drop=True)


def spreads(table: pd.DataFrame) -> pd.DataFrame:
    """Lowest and highest mean of H, L and ū over each choice's values that finish (`_low`, `_high`), over that of the scene itself; from `uncertainty`."""
    base = table.iloc[0]
    finished = table[table["status"] == "finished"]
    rows = []
    for choice, own in finished.iloc[1:].groupby("choice", sort=False):
        row: dict[str, Any] = {"choice": choice}
        for name in VARIABLES:
            row[f"{name}_low"], row[f"{name}_high"] = own[name].min() / base[name], own[name].max() / base[name]
        rows.append(row)
    return pd.DataFrame(rows)


def combinations(scene: Scene, executor: Executor | None = None, *, progress: Progress | None = None) -> pd.DataFrame:
    """Every choice combined with every other, some hundred runs of 300 jumps each; the scene needs a bed.

    One row per combination: a column per choice with its value, status, height (d), length (d), velocity (u*).
    """
    require_bed(scene)
    scene = with_jumps(with_listed_effects(scene), COMBINED)
    choices = _choices(scene)
    labelled = []
    for values in itertools.product(*choices.values()):
        tables: dict[str, dict[str, Any]] = {}
        for choice, value in zip(choices, values, strict=True):
            for table, fields in choices[choice][value].items():
                tables[table] = tables.get(table, {}) | fields
        with contextlib.suppress(SceneError):  # what makes no scene
            labelled.append((dict(zip(choices, values, strict=True)), scene.changed(**tables)))
    return campaign(labelled, executor, progress=progress)[[*choices, "status", *VARIABLES]]


def shares(table: pd.DataFrame) -> pd.DataFrame:
    """How much of the spread of H, L and ū over `combinations` each choice makes by itself; what is missing to 1 is interaction.

    The variance of the means over its values of the logarithm, over the variance of all that finish: a first Sobol index,
    Sobol (1993), Math. Model. Comput. Exp. 1, 407.
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
    """The 5, 50 and 95 % quantiles of H (d), L (d) and ū (u*) over all `combinations` that finish."""
    return table.loc[table["status"] == "finished", list(VARIABLES)].quantile([0.05, 0.5, 0.95])
