"""Where a grain of a cloud was between the kept positions: through its contacts exactly, smoothly from one to the next.

Paths of a cloud are kept every `cloud.interval`, and straight lines between them would cut off the rebounds. The tables of jumps and
of encounters know place, time and velocities of every contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset.kernels import Floats
from saltation.results.result import Result

__all__ = ["Track", "meeting_places", "track"]

KEPT, BED, MET = range(3)  # kinds of knots
SAME = 1e-9  # d/u*: what lies closer is at one time
AXES, SPEEDS = ("x", "y", "z"), ("u", "v", "w")


@dataclass(frozen=True, eq=False)
class Track:
    """A grain's path: kept positions and contacts in the order of time, not folded back into a periodic box.

    >>> still, fast = np.zeros((2, 3)), np.array([[1.0, 0.0, 0.0]] * 2)
    >>> path = Track(np.array([0.0, 2.0]), np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]]), fast, fast, np.array([KEPT, KEPT]))
    >>> place, velocity = path.at([0.5])
    >>> place, velocity
    (array([[0.5, 0. , 1. ]]), array([[1., 0., 0.]]))
    """

    time: Floats  # (n,) d/u*
    place: Floats  # (n, 3) d
    before: Floats  # (n, 3) u*, velocity before what happens there
    after: Floats  # (n, 3) u*, after: they differ at contacts
    kind: NDArray[np.int64]  # (n,) KEPT position, contact with the BED, or encounter (MET)

    def at(self, times: ArrayLike) -> tuple[Floats, Floats]:
        """Places (m, 3), d, and velocities (m, 3), u*: cubic in each piece, NaN outside of the path; at a contact the velocity is the one after it."""
        t = np.asarray(times, dtype=np.float64)
        k = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        size = (self.time[k + 1] - self.time[k])[:, None]
        share = (t - self.time[k])[:, None] / size
        chord, first, last = self.place[k + 1] - self.place[k], size * self.after[k], size * self.before[k + 1]
        square, cube = 3.0 * chord - 2.0 * first - last, first + last - 2.0 * chord
        place = self.place[k] + share * (first + share * (square + share * cube))
        velocity = (first + share * (2.0 * square + share * 3.0 * cube)) / size
        outside = (t < self.time[0]) | (t > self.time[-1])
        place[outside], velocity[outside] = np.nan, np.nan
        return place, velocity

    def line(self, low: float, high: float, each: int = 6) -> tuple[Floats, Floats]:
        """Times and places (m, 3), d, to draw the path through every knot between two times, d/u*, `each` pieces between two knots."""
        low, high = max(low, self.time[0]), min(high, self.time[-1])
        inside = self.time[(self.time > low) & (self.time < high)]
        knots = np.concatenate([[low], inside, [high]])
        times = np.append((knots[:-1, None] + np.diff(knots)[:, None] * np.arange(each) / each).ravel(), high)
        return times, self.at(times)[0]

    def mean_accelerations(self) -> tuple[Floats, Floats]:
        """Mean accelerations between the knots, without what contacts do in no time: ends (m, 2), d/u*, of the pieces, accelerations (m, 3), u*²/d."""
        size = np.diff(self.time)
        long = size > 0.0
        ends = np.stack([self.time[:-1], self.time[1:]], axis=1)[long]
        return ends, (self.before[1:] - self.after[:-1])[long] / size[long, None]


def columns(table: Any, names: tuple[str, ...]) -> Floats:
    """Columns as (rows, 3); what a scene in the plane has not is 0."""
    n = len(table)
    return np.stack([np.asarray(table[name], dtype=np.float64) if name in table else np.zeros(n) for name in names], axis=1)


def image(result: Result, here: Floats, there: Floats) -> Floats:
    """What to add to `there` so that it is the periodic image nearest to `here`: multiples of the box (…, 3), in d; 0 in an open one."""
    if result.scene.grains.boundary != "periodic":
        return np.zeros(np.broadcast_shapes(np.shape(here), np.shape(there)))
    length, width, _ = result.scene.box
    box = np.array([length, np.inf if result.scene.in_plane else width, np.inf])
    turns = np.round((np.asarray(here) - there) / box)
    return np.where(np.isfinite(box), turns * np.where(np.isfinite(box), box, 0.0), 0.0)


def meeting_places(result: Result) -> tuple[Floats, Floats]:
    """Centres (n, 3), d, of the first and of the second grain of every encounter, each on its own path (not folded back)."""
    met, path = result.encounters, result.trajectory
    if not len(met):
        return np.empty((0, 3)), np.empty((0, 3))
    first = columns(met, AXES)
    second = first + met["distance"].to_numpy()[:, None] * columns(met, ("n_x", "n_y", "n_z"))
    time, grain = path["time"].to_numpy(), met["second"].to_numpy()
    k = np.clip(np.searchsorted(time, met["time"].to_numpy(), side="right") - 1, 0, len(time) - 1)
    late = (met["time"].to_numpy() - time[k])[:, None]
    kept = [np.stack([path[name].to_numpy()[k, grain] if name in path else np.zeros(len(k)) for name in names], axis=1) for names in (AXES, SPEEDS)]
    return first, second + image(result, kept[0] + late * kept[1], second)


def track(result: Result, grain: int) -> Track:
    """The path of a grain. It ends before the last contact with the bed: where that was and what followed is in no table."""
    path = result.trajectory
    if not 0 <= grain < path.sizes["grain"]:
        raise ValueError(f"grain must be from 0 to {path.sizes['grain'] - 1}, got {grain}")
    own = path.isel(grain=grain)
    time = own["time"].to_numpy()
    kept = [np.stack([own[name].to_numpy() if name in own else np.zeros(len(time)) for name in names], axis=1) for names in (AXES, SPEEDS)]
    jumps = result.all_jumps[result.all_jumps["grain"] == grain]
    end = float(jumps["start"].iloc[-1] + jumps["duration"].iloc[-1]) - SAME if len(jumps) else np.inf
    present = np.isfinite(kept[0][:, 2]) & (time < end)
    place, velocity = kept[0][present], kept[1][present]
    knots = [(time[present], place, velocity, velocity, np.full(len(place), KEPT))]
    if len(jumps) > 1:
        rows, following = jumps.iloc[:-1], jumps.iloc[1:]
        hits = np.stack(
            [
                place[0, 0] + np.cumsum(rows["length"].to_numpy()),
                place[0, 1] + np.cumsum(rows["drift"].to_numpy()),
                (following["height_above_bed"] - following["height"]).to_numpy(),
            ],
            axis=1,
        )
        before, after = columns(rows, ("impact_x", "impact_y", "impact_z")), columns(following, ("takeoff_x", "takeoff_y", "takeoff_z"))
        knots.append((following["start"].to_numpy(), hits, before, after, np.full(len(hits), BED)))
    for who, places in zip(("first", "second"), meeting_places(result), strict=True) if len(result.encounters) else ():
        chosen = ((result.encounters[who] == grain) & (result.encounters["time"] < end)).to_numpy()
        rows = result.encounters[chosen]
        before, after = columns(rows, tuple(f"{who}_{name}" for name in SPEEDS)), columns(rows, tuple(f"{who}_{name}_after" for name in SPEEDS))
        knots.append((rows["time"].to_numpy(), places[chosen], before, after, np.full(len(rows), MET)))
    parts = [np.concatenate(values) for values in zip(*knots, strict=True)]
    contacts = np.sort(parts[0][parts[4] != KEPT])
    place_in = np.searchsorted(contacts, parts[0] - SAME)
    doubled = (parts[4] == KEPT) & (np.append(contacts, np.inf)[place_in] <= parts[0] + SAME)  # kept at a contact: which side is not told
    order = np.flatnonzero(~doubled)[np.argsort(parts[0][~doubled], kind="stable")]
    return Track(*(values[order] for values in parts))
