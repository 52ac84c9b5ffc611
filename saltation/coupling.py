"""Stream and grains until they agree: grains fly, the stress that they carry changes the profile, they fly in that one with the same random numbers.

τ_p(z) = (ρ_s/ρ)(π/6) n Σ(u_down − u_up)/t over the passages through height z, n grains per d²: what the stream gives to the grains above z.
It is summed as the momentum that grains gain between two kept places, shared over the heights between them: the same where u is straight in z;
a grain that rested has its first velocity from the stream too. Owen (1964), J. Fluid Mech. 20, 225; Wiberg & Smith (1985), J. Geophys. Res. 90(C4), 7341;
the form as in the project's notes.

Among eddies another profile is another path, so that runs differ by chance however near their profiles are. Where the change has risen (without eddies
twice), each run has random numbers of its own, and the profile is that of the sums over all of them: steps 1/k (Robbins & Monro 1951, Ann. Math. Stat. 22,
400) to the stress that runs of any number would come to, known to its standard error by the jackknife (Tukey 1958), ∝ 1/√k.
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
HIGHER = 2.0  # the highest over the highest that a grain has been at, in deep water
DAMPING = 0.7  # of the change of the stress from run to run
RISES = 2  # of the change from run to run, that are chance: without eddies one may be a grain that rests where it did not before
FEWEST = 8  # runs that say how far chance moves them


class Pieces(NamedTuple):
    """Pieces of flights, each between two places: heights at both ends (d), the velocity along the stream that is gained (u*), durations (d/u*)."""

    low: Floats
    high: Floats
    gained: Floats
    lasting: Floats

    def joined(self, other: Pieces) -> Pieces:
        """These and others."""
        return Pieces(*map(np.concatenate, zip(self, other, strict=True)))

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
    found = Pieces(np.minimum(z[1:], z[:-1])[flown], np.maximum(z[1:], z[:-1])[flown], np.diff(u)[flown], np.diff(time)[flown])
    return found.joined(set_out(result, starts[:1], np.array([math.inf])))


def set_out(result: Result, since: Floats, until: Floats) -> Pieces:
    """What grains have at once when they are picked up from a rest, between two times of each grain: only the stream can have given it."""
    rows = result.all_jumps[result.rested]
    own, start = rows["grain"].to_numpy(), rows["start"].to_numpy()
    rows = rows[(start >= since[own]) & (start < until[own])]
    level = (rows["height_above_bed"] - rows["height"]).to_numpy()
    return Pieces(level, level, rows["takeoff_x"].to_numpy(), np.zeros(len(rows)))


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
    found = Pieces(np.minimum(z[1:], z[:-1])[flown], np.maximum(z[1:], z[:-1])[flown], np.diff(u)[flown], np.diff(time)[flown])
    return found.joined(set_out(result, since, until))


def sums_of(result: Result, pieces: Pieces, heights: Floats) -> Floats:
    """What runs add up to: u* that grains take above each height (d), their gain less what their weight gives on a slope; time; moving, length, duration."""
    numbers, jumps = result.scene.numbers, result.jumps
    gained, flown = pieces.above(heights, pieces.gained), pieces.lasting.sum()
    if numbers.slope and "weight" in result.scene.names:
        gained = gained - math.sin(numbers.slope) / (numbers.density_ratio * numbers.shields) * pieces.above(heights, pieces.lasting)
    return np.array([*gained, flown, moving(result) * flown, jumps["length"].sum(), jumps["duration"].sum()])


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


def carried(scene: Scene, sums: Floats) -> tuple[Floats, float, float]:
    """Of the sums of runs: stress at each height (ρu*²), moving grains per d², their bed load q/√((s − 1) g d³)."""
    *_, flown, flying, length, duration = sums.tolist()
    taken, numbers = sums[:-4] / flown, scene.numbers
    grains = number_of(scene, float(taken[0]), flying / flown)
    with np.errstate(invalid="ignore"):
        stress = numbers.density_ratio * math.pi / 6.0 * grains * taken
    return stress, grains, grains * math.pi / 6.0 * length / duration * math.sqrt(abs(numbers.shields))


def standard_error(scene: Scene, runs: Floats) -> Floats:
    """Of the stress at each height of the sums of several runs (run, sum), by the jackknife."""
    without = np.array([carried(scene, runs.sum(axis=0) - one)[0] for one in runs])
    found: Floats = math.sqrt(len(runs) - 1.0) * without.std(axis=0)
    return found


def another(seed: int, k: int) -> int:
    """The seed of a run whose chance is independent of that of others."""
    return int(np.random.SeedSequence([seed, k]).generate_state(1, np.uint64)[0] >> 1)


def settle(scene: Scene, fly: Callable[[Scene, Callable[[float], None]], Result], progress: Callable[[float], None] | None) -> Result:
    """Fly and change the profile until both agree within coupling.tolerance; the last run, its scene with what was agreed on.

    A run that does not finish is returned as it is; one whose stream and grains do not agree after `coupling.runs` runs is "unsettled".
    """
    coupling, known, depth = scene.coupling, key_of(scene), scene._setting(scene.clear).depth
    eddies = "turbulence" in scene.names
    assert coupling is not None
    seeing = scene.changed(run={"trajectory": True})
    heights: Floats = np.zeros(0)
    used, change, rate_uncoupled, rises = heights, math.inf, 0.0, 0
    met = chance = False  # whether the tolerance is met, and whether chance moves the runs
    runs = np.zeros((0, LEVELS + 4))  # what each has added up to since then
    for k in range(coupling.runs + 1):
        agreed = met or k == coupling.runs
        if agreed and not chance:
            break

        def report(share: float, k: int = k) -> None:
            if progress is not None:
                progress((k + share) / (k + share + 4.0))

        settled = None
        if k:
            settled = {"of": known, "heights": heights.tolist(), "stress": used.tolist(), "seen": used.tolist(), "grains": 0.0}
            settled |= {"rate": 0.0, "rate_uncoupled": 0.0, "runs": k, "change": 0.0}
        seed = another(scene.run.seed, k) if chance and not agreed else scene.run.seed
        result = fly(seeing.changed(coupling={"settled": settled}, run={"seed": seed}), report)
        path = result.path if scene.run.trajectory else None
        if result.status != "finished" or not len(result.jumps):
            return dataclasses.replace(result, scene=scene, path=path)
        if agreed:
            break
        pieces = pieces_of(result)
        highest = float(pieces.high.max())
        if not k:
            heights = np.geomspace(pieces.low.min(), min(HIGHER * highest, math.sqrt(highest * depth)), LEVELS)  # below the surface
            used = np.zeros(LEVELS)
        sums = sums_of(result, pieces, heights)
        if chance:
            runs = np.concatenate([runs, sums[None]])
        seen, grains, rate = carried(scene, runs.sum(axis=0) if chance else sums)
        why = ""
        if highest >= depth:
            why = f"grains reach z = {highest:.4g} d, and the stream ends at its depth, {depth:.4g} d: give a greater channel.depth"
        elif not math.isfinite(grains):
            why = "the grains take no momentum from the stream, which sets their number: give coupling.grains"
        if why:
            return dataclasses.replace(result, scene=scene, path=path, status="unsettled", message=f"coupling: {why}")
        rate_uncoupled = rate_uncoupled if k else rate
        if chance:
            used = seen.copy()
            if len(runs) >= FEWEST:
                change = 2.0 * float(standard_error(scene, runs).max())
                met = change <= coupling.tolerance
        else:
            before, change = change, float(np.abs(seen - used).max())
            rises += change >= before
            met = (max(change, before) if eddies else change) <= coupling.tolerance  # among eddies once may be luck
            chance = rises + eddies >= RISES and not met
            if not met and k + 1 < coupling.runs:
                used = used + (DAMPING if k else 1.0) * (seen - used)
        used[-1] = 0.0
    told: dict[str, Any] = {"of": known, "heights": heights.tolist(), "stress": used.tolist(), "seen": seen.tolist(), "runs": k + chance, "averaged": len(runs)}
    told |= {"change": change, "grains": grains / scene.numbers.diameter**2, "rate": rate, "rate_uncoupled": rate_uncoupled}
    if progress is not None:
        progress(1.0)
    return dataclasses.replace(result, scene=scene.changed(coupling={"settled": told}), path=path)
