"""Which grains of a cloud a picture shows: some that meet, one undisturbed encounter, one that is deflected often.

All choices follow from the result alone: the same run gives the same picture.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from basset.kernels import Floats
from saltation.plots.tracks import SPEEDS, Track, columns, image, meeting_places, track
from saltation.results.result import Result

__all__ = ["Group", "Pair", "busiest", "group_of", "undisturbed_pair"]

MOST = 6  # grains in a picture
CANDIDATES = 500  # encounters that are tried


def encounters_of(result: Result, what: str) -> pd.DataFrame:
    """The encounters; refused where there is none."""
    if not len(result.encounters):
        raise ValueError(f"{what} needs grains that meet: the run has no encounter")
    return result.encounters


def jump_time(result: Result) -> float:
    """Mean duration of a jump, d/u*; of a run without jumps a tenth of its time."""
    return float(result.all_jumps["duration"].mean()) if len(result.all_jumps) else 0.1 * result.time


def settled(result: Result) -> float:
    """When half of the grains have done their first `run.discard` jumps, d/u*; 0 if they never do."""
    jumps = result.jumps
    return float(jumps.groupby("grain")["start"].min().median()) if len(jumps) else 0.0


def some(rows: int) -> NDArray[np.int64]:
    """At most CANDIDATES row numbers, evenly spread."""
    return np.unique(np.linspace(0, rows - 1, min(rows, CANDIDATES)).astype(np.int64))


class Group(NamedTuple):
    """Grains whose encounters join them, between two times."""

    low: float  # d/u*, from when
    high: float  # d/u*, until when
    offsets: dict[int, Floats]  # grain -> (3,) d: what brings its path into one periodic image with the others

    def of(self, result: Result) -> pd.DataFrame:
        """The encounters of its grains in its time, in the order of time; index as in the run's table."""
        return members(within(result.encounters, self.low, self.high), self.offsets)


def within(met: pd.DataFrame, low: float, high: float) -> pd.DataFrame:
    """Encounters from `low` to `high`."""
    return met[(met["time"] >= low) & (met["time"] <= high)]


def members(met: pd.DataFrame, grains: Any) -> pd.DataFrame:
    """Encounters of which at least one grain is among `grains`."""
    return met[met["first"].isin(list(grains)) | met["second"].isin(list(grains))]


def grow(met: pd.DataFrame, root: int, places: tuple[Floats, Floats], result: Result) -> dict[int, Floats]:
    """From one grain on those whom it meets, whom these meet and so on; with the offsets of their paths."""
    offsets: dict[int, Floats] = {root: np.zeros(3)}
    added = True
    while added and len(offsets) < MOST:
        added = False
        for row, first, second in zip(met.index, met["first"], met["second"], strict=True):
            if (first in offsets) == (second in offsets):
                continue
            known, new, here, there = (first, second, 0, 1) if first in offsets else (second, first, 1, 0)
            shown = places[here][row] + offsets[int(known)]
            offsets[int(new)] = image(result, shown, places[there][row])
            added = True
            if len(offsets) == MOST:
                break
    return offsets


def group_of(result: Result, span: float) -> Group:
    """Where in the run the most encounters lie among at most `MOST` grains within a time `span`, d/u*."""
    met = result.encounters.reset_index(drop=True)
    places = meeting_places(result)
    best, found = (-1, -1), Group(0.0, span, {})
    for row in some(len(met)):
        low = float(max(0.0, min(met["time"][row] - 0.25 * span, result.time - span)))
        inside = within(met, low, low + span)
        offsets = grow(inside, int(met["first"][row]), places, result)
        pairs = {(first, second) for first, second in zip(inside["first"], inside["second"], strict=True) if first in offsets and second in offsets}
        score = (len(offsets), len(pairs))
        if score > best:
            best, found = score, Group(low, low + span, offsets)
    return found


def contact_points(result: Result, group: Group) -> tuple[Floats, NDArray[np.bool_]]:
    """Contact points of the encounters of a group (n, 3) in d, on the path of one of its grains; whether both grains are of the group (n,)."""
    met = group.of(result)
    first, second = (places[met.index.to_numpy()] for places in meeting_places(result))
    half = 0.5 * met["distance"].to_numpy()[:, None] * columns(met, ("n_x", "n_y", "n_z"))
    points = np.empty((len(met), 3))
    for k, (one, other) in enumerate(zip(met["first"], met["second"], strict=True)):
        points[k] = first[k] + half[k] + group.offsets[one] if one in group.offsets else second[k] - half[k] + group.offsets[other]
    return points, (met["first"].isin(list(group.offsets)) & met["second"].isin(list(group.offsets))).to_numpy()


class Pair(NamedTuple):
    """An encounter far from other contacts."""

    row: pd.Series  # of the run's table
    tracks: tuple[Track, Track]  # of the first and the second grain, in one periodic image
    undisturbed: float  # d/u*, time to the nearest other contact

    def relative(self) -> Floats:
        """Velocity of the second grain relative to the first before the contact, u* (3,)."""
        velocity: Floats = np.array([self.row[f"second_{name}"] - self.row[f"first_{name}"] for name in SPEEDS])
        return velocity

    def apart(self, time: float) -> float:
        """Distance of the centres, d, at a time, d/u*."""
        one, other = (path.at([time])[0][0] for path in self.tracks)
        return float(np.linalg.norm(other - one))

    def normal(self) -> Floats:
        """Unit vector from the first to the second grain (3,)."""
        return np.array([self.row[name] for name in ("n_x", "n_y", "n_z")])


def time_to_other_contacts(result: Result) -> Floats:
    """For every encounter the time to the nearest other contact of either of its grains, or to an end of the paths (n,), d/u*."""
    met, jumps = result.encounters, result.all_jumps
    grain = np.concatenate([jumps["grain"], met["first"], met["second"]])
    time = np.concatenate([jumps["start"] + jumps["duration"], met["time"], met["time"]])
    order = np.lexsort((time, grain))
    same = np.diff(grain[order]) == 0
    gap = np.where(same, np.diff(time[order]), np.inf)
    alone = np.empty(len(time))
    alone[order] = np.minimum(np.append(np.inf, gap), np.append(gap, np.inf))
    n, now, ends = len(met), met["time"].to_numpy(), result.trajectory["time"].to_numpy()[[0, -1]]
    gaps: Floats = np.minimum.reduce([alone[len(jumps) : len(jumps) + n], alone[len(jumps) + n :], now - ends[0], ends[1] - now])
    return gaps


def undisturbed_pair(result: Result, what: str) -> Pair:
    """The encounter that shows best: long after and before other contacts, fast along the normal, in the x–z plane; `what` asks, for the message."""
    met = encounters_of(result, what).reset_index(drop=True)
    undisturbed, tau = time_to_other_contacts(result), jump_time(result)
    normal = columns(met, ("n_x", "n_y", "n_z"))
    closing = -np.sum((columns(met, tuple(f"second_{c}" for c in SPEEDS)) - columns(met, tuple(f"first_{c}" for c in SPEEDS))) * normal, axis=1)
    score = np.minimum(undisturbed, 0.3 * tau) * np.minimum(closing, 2.0) * np.sqrt(np.maximum(1.0 - normal[:, 1] ** 2, 0.0)) ** 3
    best = int(np.argmax(score))
    row = met.iloc[best]
    first, second = (track(result, int(row[who])) for who in ("first", "second"))
    places = meeting_places(result)
    offset = image(result, places[0][best], places[1][best])
    return Pair(row, (first, Track(second.time, second.place + offset, second.before, second.after, second.kind)), float(min(undisturbed[best], tau)))


def busiest(result: Result, span: float) -> tuple[int, float]:
    """The grain that encounters turn most across the stream and not in quick succession, and from when on within a `span`, d/u*."""
    met = encounters_of(result, "grain_history").reset_index(drop=True)
    turned = np.abs(met["first_v_after"] - met["first_v"])
    clear = np.minimum(time_to_other_contacts(result) / (0.1 * jump_time(result)), 1.0)
    best, found = -1.0, (0, 0.0)
    for row in some(len(met)):
        low = float(max(0.0, min(met["time"][row] - 0.1 * span, result.time - span)))
        inside = within(met, low, low + span)
        for grain in (int(met["first"][row]), int(met["second"][row])):
            own = members(inside, [grain]).index
            score = min(len(own), 6) + float((np.minimum(turned[own], 2.0) * clear[own]).sum())
            if len(own) <= 8 and score > best:
                best, found = score, (grain, low)
    return found
