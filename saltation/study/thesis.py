"""The thesis's runs, of one grain and of many, and the ranking of its models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from basset import _validate
from saltation import regressions, statistics
from saltation.grain import GRAVITY
from saltation.scene import Scene, read, scene_of, shipped

__all__ = ["case", "diameter_of", "grains", "judge", "single_grain", "thesis"]

RUNS = {"A": "R1", "B": "R2", "C": "R3", "D": "R4", "E": "R5", "F": "R6", "G": "R7", "H": "R8"}  # Table 3-4: the roughness of each Run
SETS: dict[int, tuple[float | str, float]] = {1: ("set1", 0.89), 2: (0.65, 0.1), 3: (0.8, 0.4), 4: (0.95, 0.3)}  # Table 3-3: e and f
STAGES = {73.0: ("sand", (1.79, 1.87, 2.43, 2.50, 2.67)), 250.0: ("sand_coarse", (2.31, 3.08, 3.85))}  # R_p: shipped scene, T
MODEL = ("run", "set")


def case(name: str) -> dict[str, Any]:
    """What a shipped scene holds, with the thesis's laws (e of its Set 2) in place of those that are chosen by their ranges; not yet a validated scene.

    >>> scene_of(case("sand")).options("drag").law
    'yen'
    """
    content = read(shipped()[name])
    if content.get("defaults") == "valid":
        content |= {"defaults": "thesis", "bed": content["bed"] | {"restitution": SETS[2][0]}}
    return content


def thesis(retention: float | None = None) -> list[tuple[dict[str, Any], Scene]]:
    """The 256 runs of the thesis's section 3.3.2: Runs A–H × Sets 1–4 × T, 220 jumps each, the first 20 left out.

    Run A is the two-dimensional flight with prescribed spin (3-6) and the rebound of García & Niño, whose f is the share of tangential velocity that is
    *kept* (3A-1): each Set's own, or `retention` for all Sets, which then differ by e alone. All others are three-dimensional with the hard-sphere
    contact, whose f is Coulomb's. All have one seed: they meet the same random numbers at the same impact.
    Labels: run, set, particle_reynolds, stage (T), restitution (e), f, f_is ("retention" or "Coulomb").

    >>> len(thesis())
    256
    """
    result = []
    for reynolds, (name, stages) in STAGES.items():
        base = case(name)
        base["grain"]["diameter"] = diameter_of(reynolds, scene_of(base))
        base["run"] |= {"jumps": 220, "discard": 20}
        for letter, roughness in RUNS.items():
            for number, (restitution, own) in SETS.items():
                kept = own if retention is None else retention
                bed = {**base["bed"], "roughness": roughness, "restitution": restitution}
                model: dict[str, Any] = {"bed": {**bed, "friction": own}}
                if letter == "A":
                    del bed["friction"]
                    model = {"bed": {**bed, "rebound": "garcia_nino", "tangential_retention": kept}, "dimensions": 2, "rotation": {"law": "prescribed"}}
                for stage in stages:
                    scene = scene_of({**base, **model, "channel": {**base["channel"], "transport_stage": stage}})
                    labels = {"run": letter, "set": number, "particle_reynolds": reynolds, "stage": stage, "restitution": restitution}
                    f = {"f": kept, "f_is": "retention"} if letter == "A" else {"f": own, "f_is": "Coulomb"}
                    result.append((labels | f, scene))
    return result


CONCENTRATIONS = {0.0013: 15, 0.0233: 45}  # Table 4-1: C_p; the number of grains is not printed and is that of the scene
REYNOLDS = (73.0, 250.0)
STAGES_OF_GRAINS = (2.0, 2.5, 3.0)
LASTING = 500.0  # d/u*


def grains(seeds: Sequence[int] = (1,), scatter: bool = False) -> list[tuple[dict[str, Any], Scene]]:
    """The 24 runs of the thesis's Table 4-1: C_p × R_p × T, with and without encounters, 500 d/u* each, for every seed.

    The bed of its scene does not scatter across the stream, so that encounters alone do. With `scatter` it has the planes of R7, tilted by up to 30°
    to either side. (Those of the contact relation (4-6) follow the grain's own direction: they turn what moves across, and set nothing moving.)
    Runs of one seed set out from the same places and meet the same random numbers at the same impact of the same grain, in units of their box.
    Labels: name, concentration (C_p), particle_reynolds, stage (T), encounters (bool), seed, scatter.

    >>> len(grains())
    24
    """
    result = []
    for concentration, number in CONCENTRATIONS.items():
        for reynolds in REYNOLDS:
            base = case("sand_cloud")
            base["grain"]["diameter"] = diameter_of(reynolds, scene_of(base))
            base["cloud"] |= {"number": number, "concentration": concentration}
            base["bed"] |= {"roughness": "R7", "span_scatter": True} if scatter else {}
            for stage in STAGES_OF_GRAINS:
                base["channel"]["transport_stage"] = stage
                base["run"]["duration"] = LASTING * scene_of(base).numbers.time
                for meeting in (True, False):
                    content = {key: value for key, value in base.items() if meeting or key != "encounters"}
                    content["effects"] = [name for name in base["effects"] if meeting or name != "encounters"]
                    labels = {"concentration": concentration, "particle_reynolds": reynolds, "stage": stage, "encounters": meeting}
                    name = f"C{100.0 * concentration:g}_R{reynolds:g}_T{stage:g}_{'with' if meeting else 'without'}{'_scatter' if scatter else ''}"
                    for seed in seeds:
                        own = {"name": name + (f"_S{seed}" if len(seeds) > 1 else "")} | labels | {"seed": seed, "scatter": scatter}
                        result.append((own, scene_of(content | {"run": base["run"] | {"seed": seed}})))
    return result


def single_grain(particle_reynolds: float, stage: float, jumps: int = 517, discard: int = 0) -> Scene:
    """One grain on the bed of chapter 4, with (4-6) along and across: thesis figs 4-3 to 4-5."""
    base = case("sand_cloud")
    del base["cloud"], base["encounters"]
    base["effects"].remove("encounters")
    base["grain"]["diameter"] = diameter_of(particle_reynolds, scene_of(base))
    base["channel"]["transport_stage"] = stage
    base["bed"]["span_scatter"] = True
    base["run"] = {"jumps": jumps, "discard": discard, "seed": base["run"]["seed"]}
    return scene_of(base)


def diameter_of(particle_reynolds: float, scene: Scene) -> float:
    """Diameter, m, that gives a scene's material and fluid a particle Reynolds number R_p = √(R g d³)/ν, as in thesis (4-13)."""
    excess = abs(scene.grain.density / scene.fluid.density - 1.0)
    return math.cbrt((particle_reynolds * scene.fluid.viscosity) ** 2 / (excess * GRAVITY))


# Judgement


def judge(table: pd.DataFrame, reference: pd.DataFrame | None = None, *, particle_reynolds: float = 73.0, models: Sequence[str] = MODEL) -> pd.DataFrame:
    """Rank the models (the labels `models` make one) of a campaign by their mean jumps H, L and ū (thesis, section 3.4.2 and fig. 3-10).

    Each is compared with the mean of the published regressions, or, at the one R_p (to 2 %) that `reference` (of `statistics.read_reference`) is for, with the
    measurements of each of its sources; stages that the campaign does not reach are left out. The regressions differ by 1.5–3 in height and 2–5 in
    length: close to their mean is no proof, and far outside their envelope is the stronger statement.
    One row per model, R_p and source, the best mean rank first: error_index (RMSE over the mean, averaged over H, L and ū) and overlap_index (per cent; where
    the source gives standard deviations), see `statistics`; against the regressions also inside (share of the means within their envelope) and
    height_place, length_place and velocity_place (0 at the envelope's lower and 1 at its upper edge, mean over T); rank among the models by
    the overlap index, or else by the error index; mean_rank of the model over all R_p and sources. NaN where a model has no mean.
    """
    for name in (*models, "particle_reynolds", "stage"):
        if name not in table:
            raise ValueError(f"table must have the label {name!r}, got {_validate.shown(list(table))}")
    names = ["".join(map(str, values)) if tuple(models) == MODEL else ", ".join(map(str, values)) for values in table[list(models)].itertuples(index=False)]
    table = table.assign(model=names)
    parts = []
    for reynolds, runs in table.groupby("particle_reynolds"):
        measured = reference if reference is not None and math.isclose(reynolds, particle_reynolds, rel_tol=0.02) else None
        for source, observed in _sources(reynolds, runs, measured).items():
            rows = [_scores(model, reynolds, source, observed, own, measured is None) for model, own in runs.groupby("model", sort=False)]
            parts.append(pd.DataFrame(rows))
    if reference is not None and not any(set(part["source"]) & set(reference["source"]) for part in parts):
        raise ValueError(
            f"reference must reach a stage of the campaign at R_p = {particle_reynolds:g}, got stages {_validate.shown(sorted(set(reference['T'])))}"
        )
    for part in parts:
        score = "overlap_index" if part["overlap_index"].notna().any() else "error_index"
        part["rank"] = statistics.rank_models(part[score], score == "error_index").to_numpy()[:, 0]
    result = pd.concat(parts, ignore_index=True)
    result["mean_rank"] = result.groupby("model")["rank"].transform(lambda ranks: ranks.mean(skipna=False))
    return result.sort_values(["mean_rank", "model", "particle_reynolds"], kind="stable", ignore_index=True)


def _sources(reynolds: float, runs: pd.DataFrame, measured: pd.DataFrame | None) -> dict[str, pd.DataFrame]:
    """What runs of one R_p are compared with, by source."""
    stages = np.unique(runs["stage"].to_numpy(dtype=np.float64))
    if measured is not None:
        within = measured[(measured["T"] >= stages[0] * (1.0 - 1e-6)) & (measured["T"] <= stages[-1] * (1.0 + 1e-6))]
        return {str(source): rows for source, rows in within.groupby("source", sort=False)}
    means = np.mean([regression(reynolds, stages) for regression in regressions.REGRESSIONS.values()], axis=0)
    rows = [(variable, stage, mean) for variable, row in zip(statistics.VARIABLES, means, strict=True) for stage, mean in zip(stages, row, strict=True)]
    return {"regressions": pd.DataFrame(rows, columns=["variable", "T", "mean"])}


def _scores(model: Any, reynolds: Any, source: str, observed: pd.DataFrame, runs: pd.DataFrame, published: bool) -> dict[str, Any]:
    """One model against one source."""
    if runs["stage"].duplicated().any():
        raise ValueError(f"table must have one run per model and stage, got two of {model!r} at R_p = {reynolds:g}")
    own = [pd.DataFrame({"variable": name, "T": runs["stage"].astype(float), "mean": runs[name], "sd": runs[f"{name}_sd"]}) for name in statistics.VARIABLES]
    scores: dict[str, Any] = {"model": model, "particle_reynolds": reynolds, "source": source, "error_index": math.nan, "overlap_index": math.nan}
    simulated = pd.concat(own, ignore_index=True)
    if simulated["mean"].notna().all() and (observed["mean"] > 0.0).any():
        variables = [name for name in statistics.VARIABLES if name in set(observed["variable"])]
        scores["error_index"] = float(statistics.errors(observed, simulated, variables).mean())
        banded = "sd" in observed and all(rows["sd"].notna().all() and len(rows) > 1 for _, rows in observed.groupby("variable"))
        if banded and simulated["sd"].notna().all():
            scores["overlap_index"] = float(statistics.overlap_areas(observed, simulated, variables).mean())
    places = dict.fromkeys(statistics.VARIABLES, np.full(1, math.nan))
    for name, edge in zip(statistics.VARIABLES, regressions.Jump._fields, strict=True) if published else ():
        low, high = regressions.envelope(reynolds, runs["stage"].to_numpy(dtype=np.float64))[edge]
        width = np.where(high > low, high - low, np.nan)  # nothing jumps at and below the threshold
        places[name] = (runs[name].to_numpy() - low) / width
    every = np.concatenate(list(places.values()))
    scores["inside"] = float(((every >= 0.0) & (every <= 1.0)).mean()) if np.isfinite(every).all() else math.nan
    return scores | {f"{name}_place": float(place.mean()) for name, place in places.items()}
