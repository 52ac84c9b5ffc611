"""Stream and grains until they agree: grains fly, the stress that they carry changes the profile, they fly in that one with the same random numbers.

τ_p(z) = (ρ_s/ρ)(π/6) n Σ(u_down − u_up)/t over the passages through height z, n grains per d²: what the stream gives to the grains above z.
It is summed as the momentum that grains gain between two kept places, shared over the heights between them: the same where u is straight in z.
Owen (1964), J. Fluid Mech. 20, 225; Wiberg & Smith (1985), J. Geophys. Res. 90(C4), 7341; the form as in the project's notes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from basset.kernels import Floats
from saltation._keys import key_of
from saltation.results.result import Result
from saltation.scene import Scene

LEVELS = 64  # heights
HIGHER = 2.0  # the highest over the highest that a grain has been at
MOST = 40  # runs
DAMPING = 0.7  # of the change of the stress from run to run


class Pieces(NamedTuple):
    """Pieces of flights, each between two places: heights at both ends (d), the velocity along the stream that is gained (u*), durations (d/u*)."""

    low: Floats
    high: Floats
    gained: Floats
    lasting: Floats

    def above(self, heights: Floats, amounts: Floats) -> Floats:
        """Sum of the amounts that fall above each height, those of a piece spread evenly over its heights."""
        total = np.zeros(len(heights))
        order = np.argsort(self.high)  # only pieces that reach above a height matter to it
        low, high, amounts = self.low[order], self.high[order], amounts[order]
        first = np.searchsorted(high, heights, side="right")
        with np.errstate(invalid="ignore", divide="ignore"):
            for k, (start, z) in enumerate(zip(first, heights, strict=True)):
                part = np.minimum(1.0, (high[start:] - z) / (high[start:] - low[start:]))
                total[k] = amounts[start:] @ part
        return total


def pieces_of(result: Result) -> Pieces:
    """The pieces of all jumps that count."""
    if result.scene.cloud is not None:
        return pieces_of_many(result)
    jumps, path = result.jumps, result.trajectory
    time = path["time"].to_numpy()
    z, u = path["z"].to_numpy(), path["u"].to_numpy()
    starts = jumps["start"].to_numpy()
    first = np.searchsorted(time, starts, side="right") - 1  # the takeoff, not the impact at that time
    last = np.searchsorted(time, (jumps["start"] + jumps["duration"]).to_numpy() * (1.0 + 1e-14), side="right") - 1
    flown = np.zeros(len(time) - 1, dtype=bool)
    flown[first[0] : last[-1]] = True
    flown[first[first > 0] - 1] = False  # from an impact to the takeoff after it
    low, high = np.minimum(z[1:], z[:-1])[flown], np.maximum(z[1:], z[:-1])[flown]
    return Pieces(low, high, np.diff(u)[flown], np.diff(time)[flown])


def pieces_of_many(result: Result) -> Pieces:
    """The same from the kept places of many grains, takeoffs, impacts and encounters put between them."""
    jumps, path, met = result.jumps, result.trajectory, result.encounters
    count = path.sizes["time"]
    grain, time = np.repeat(path["grain"].to_numpy(), count), np.tile(path["time"].to_numpy(), path.sizes["grain"])
    kept = np.column_stack([grain, time, np.zeros(len(time)), path["z"].to_numpy().T.ravel(), path["u"].to_numpy().T.ravel()])
    begin, end = jumps["start"].to_numpy(), (jumps["start"] + jumps["duration"]).to_numpy()
    level = (jumps["height_above_bed"] - jumps["height"]).to_numpy()
    own = jumps["grain"].to_numpy()
    follows = np.append(own[1:] == own[:-1], False)  # the flight after an impact says at which height that was
    landing = np.append(level[1:], np.nan)
    takeoffs = np.column_stack([own, begin, np.full(len(own), 2.0), level, jumps["takeoff_x"]])
    impacts = np.column_stack([own, end, np.full(len(own), 1.0), landing, jumps["impact_x"]])[follows]
    knots = [kept, takeoffs, impacts]
    for side, shift in (("first", 0.0), ("second", 1.0)):
        height = met["z"] + shift * met["n_z"] * met["distance"]
        knots.append(np.column_stack([met[side], met["time"], np.full(len(met), 1.0), height, met[f"{side}_u"]]))
        knots.append(np.column_stack([met[side], met["time"], np.full(len(met), 2.0), height, met[f"{side}_u_after"]]))
    table = np.concatenate(knots)
    table = table[np.isfinite(table).all(axis=1)]
    table = table[np.lexsort((table[:, 2], table[:, 1], table[:, 0]))]  # at one instant: a kept place, what comes before a contact, what after
    grain, time, kind, z, u = table.T
    since, until = np.full(result.scene.grains.number, np.inf), np.full(result.scene.grains.number, -np.inf)  # its first takeoff, its last impact that is known
    np.minimum.at(since, own, begin)
    np.maximum.at(until, own[follows], end[follows])
    inside = (time >= since[grain.astype(int)]) & (time <= until[grain.astype(int)])
    flown = (np.diff(grain) == 0) & inside[1:] & inside[:-1] & (kind[1:] != 2.0) & (kind[:-1] != 1.0)
    flown &= (np.diff(z) != 0.0) | (np.diff(u) != 0.0)  # a grain at rest
    return Pieces(np.minimum(z[1:], z[:-1])[flown], np.maximum(z[1:], z[:-1])[flown], np.diff(u)[flown], np.diff(time)[flown])


def momentum(result: Result, heights: Floats) -> Floats:
    """u* per d/u* that a grain takes from the stream above each height (d): its gain, less what its weight gives on a slope."""
    pieces, numbers = pieces_of(result), result.scene.numbers
    flown = pieces.lasting.sum()
    downhill = numbers.alpha * math.sin(numbers.slope) / numbers.shields if "weight" in result.scene.names else 0.0
    gained = pieces.above(heights, pieces.gained)
    if downhill:
        gained = gained - downhill * pieces.above(heights, pieces.lasting)
    found: Floats = gained / flown
    return found


def levels(result: Result) -> Floats:
    """Heights, d: from the lowest to `HIGHER` times the highest of a grain, evenly in their logarithm."""
    pieces = pieces_of(result)
    return np.geomspace(pieces.low.min(), HIGHER * pieces.high.max(), LEVELS)


def moving(result: Result) -> float:
    """How many grains move, on average: all of a cloud that neither lie at rest nor have left; 1 without one."""
    if result.scene.cloud is None:
        return 1.0
    speed = result.trajectory["u"].to_numpy()
    return float((np.isfinite(speed) & (speed != 0.0)).sum() / len(speed))


def number_of(scene: Scene, taken: float, flying: float) -> float:
    """Moving grains per d², if each takes so much momentum (u*²/d) from the whole stream; `flying`: how many of a cloud move, on average."""
    coupling, numbers = scene.coupling, scene.numbers
    assert coupling is not None and numbers.stage is not None
    if scene.cloud is not None:
        length, width, _ = scene.box
        return flying / (length * width)
    if coupling.grains is not None:
        return coupling.grains * numbers.diameter**2
    stress = (1.0 - coupling.excess) * max(0.0, 1.0 - 1.0 / numbers.stage)
    return stress / (numbers.density_ratio * math.pi / 6.0 * taken) if taken > 0.0 else math.inf


def rate_of(result: Result, grains: float) -> float:
    """Bed load q/√((s − 1) g d³) of so many moving grains per d²."""
    jumps = result.jumps
    speed = float(jumps["length"].sum() / jumps["duration"].sum())
    return grains * math.pi / 6.0 * speed * math.sqrt(abs(result.scene.numbers.shields))


def settle(scene: Scene, fly: Callable[[Scene, Callable[[float], None]], Result], progress: Callable[[float], None] | None) -> Result:
    """Fly and change the profile until both agree within coupling.tolerance; the last run, its scene with what was agreed on.

    A run that does not finish is returned as it is; one whose stream and grains do not agree after `MOST` runs is "unsettled".
    """
    coupling, known = scene.coupling, key_of(scene)
    assert coupling is not None
    seeing = scene.changed(run={"trajectory": True})
    heights: Floats = np.zeros(0)
    used, rate_uncoupled = heights, 0.0
    for k in range(MOST):

        def report(share: float, k: int = k) -> None:
            if progress is not None:
                progress(1.0 - 0.5 ** (k + share))

        settled = None
        if k:
            settled = {"of": known, "heights": heights.tolist(), "stress": used.tolist(), "seen": used.tolist(), "grains": 0.0}
            settled |= {"rate": 0.0, "rate_uncoupled": 0.0, "runs": k, "change": 0.0}
        result = fly(seeing.changed(coupling={"settled": settled}), report)
        path = result.path if scene.run.trajectory else None
        if result.status != "finished" or not len(result.jumps):
            return dataclasses.replace(result, scene=scene, path=path)
        if not k:
            heights = levels(result)
            used = np.zeros(len(heights))
        taken = momentum(result, heights)
        grains = number_of(scene, float(taken[0]), moving(result))
        if not math.isfinite(grains):
            why = "coupling: the grains take no momentum from the stream, which sets their number: give coupling.grains"
            return dataclasses.replace(result, scene=scene, path=path, status="unsettled", message=why)
        seen = scene.numbers.density_ratio * math.pi / 6.0 * grains * taken
        change = float(np.abs(seen - used).max())
        rate = rate_of(result, grains)
        if not k:
            rate_uncoupled = rate
        if change <= coupling.tolerance:
            break
        if k + 1 < MOST:
            used = used + (DAMPING if k else 1.0) * (seen - used)
            used[-1] = 0.0
    told: dict[str, Any] = {"of": known, "heights": heights.tolist(), "stress": used.tolist(), "seen": seen.tolist(), "runs": k + 1, "change": change}
    told |= {"grains": grains / scene.numbers.diameter**2, "rate": rate, "rate_uncoupled": rate_uncoupled}
    if progress is not None:
        progress(1.0)
    return dataclasses.replace(result, scene=scene.changed(coupling={"settled": told}), path=path)
