"""The tables of a result: of jumps, of encounters, of grains that left, kept positions; with their units, from what a run records and in a dataset."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from basset.kernels import Floats
from saltation.flight.layout import COLUMNS, ENCOUNTER_COLUMNS, SHORTEST_FLIGHT
from saltation.scene import Scene

UNITS = {  # of the table of jumps
    "grain": ("1", "number of the grain"),
    "start": ("d/u*", "time of takeoff"),
    "duration": ("d/u*", "from impact to impact"),
    "length": ("d", "along the stream"),
    "drift": ("d", "across the stream"),
    "height": ("d", "rise above the previous impact"),
    "height_above_bed": ("d", "highest point of the centre above the bed level"),
    "velocity": ("u*", "length over duration"),
    "spin": ("u*/d", "mean ω_y of the flight"),
    "takeoff_angle": ("degree", "above the stream's direction, just after the impact"),
    "incidence_angle": ("degree", "below the stream's direction, just before the impact"),
    "deviation_angle": ("degree", "of the jump from the stream's direction, in plan"),
    "takeoff_x": ("u*", "velocity just after the impact, along the stream"),
    "takeoff_y": ("u*", "across"),
    "takeoff_z": ("u*", "up"),
    "impact_x": ("u*", "velocity just before the impact that ends the jump, along the stream"),
    "impact_y": ("u*", "across"),
    "impact_z": ("u*", "up"),
    "stokes": ("1", "collision Stokes number of the impact"),
    "tilt": ("degree", "angle θ_b of the contact plane"),
    "clipped": ("1", "whether θ_b was clipped to 30°"),
    "impulse_x": ("m u*", "impulse of the bed on the grain, along the stream, per grain mass"),
    "impulse_y": ("m u*", "across"),
    "impulse_z": ("m u*", "up"),
    "contacts": ("1", "contacts at the impact before the grain moved up"),
}
SI = {  # of a unit of length d and of velocity V: the SI unit, and how often d and V go into it
    "d": ("m", 1, 0),
    "d/u*": ("s", 1, -1),
    "u*": ("m s-1", 0, 1),
    "u*/d": ("rad s-1", -1, 1),
    "u*2/d": ("m s-2", -1, 2),
    "m u*": ("m s-1", 0, 1),
}
CREEP = 0.1  # d: lower jumps are counted as creeping
WHOLE = ("grain", "first", "second")  # columns that count grains
ENCOUNTER_UNITS = {"time": "d/u*", "first": "1", "second": "1", "restitution": "1", "distance": "d"}  # others by what they are
FATES = {"grain": "number of the grain", "time": "when it left the run", "fate": "at rest, creeping or aloft"}
COUPLED = {  # what two-way coupling comes to
    "velocity_before": "velocity of the stream without grains",
    "velocity": "velocity of the stream with the grains",
    "fluid_stress": "shear stress of the stream over ρu*²",
    "grain_stress": "shear stress that grains carry over ρu*²",
    "moving_grains": "moving grains per area of the bed",
    "bed_stress": "shear stress that grains carry at the bed over ρu*²",
    "bed_load": "bed load q/√((s − 1) g d³)",
    "bed_load_before": "bed load q/√((s − 1) g d³) in the uncoupled stream",
    "bed_load_flux": "bed load, volume of grains per width and time",
}
STREAM = {"moving_grains": "m-2", "bed_stress": "1", "bed_load": "1", "bed_load_flux": "m2 s-1"}  # those without a height: their units
AXES = {"x": "along the stream", "y": "across the stream", "z": "above the bed level"}


def attributes_of(scene: Scene, unit: str, text: str) -> dict[str, Any]:
    """Attributes of a variable by the conventions CF: what is measured in d and u* is dimensionless, and says what it is a multiple of."""
    if unit not in SI:
        return {"units": unit, "long_name": text}
    numbers = scene.numbers
    name, lengths, velocities = SI[unit]
    factor = float(numbers.diameter**lengths * numbers.velocity**velocities)
    return {"units": "1", "long_name": text, "scale": numbers.unit(unit), "si_units": name, "si_factor": factor}


def table_of(rows: Floats, stokes: float, grains: Any = 0) -> pd.DataFrame:
    """The table of jumps from the rows that flights record; `stokes` is the collision Stokes number of unit speed, `grains` whose each is."""
    c = dict(zip(COLUMNS, rows.T, strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity, spin = c["length"] / c["duration"], c["turned"] / c["duration"]
    columns = {
        "grain": np.full(len(rows), grains, dtype=np.int32),
        "start": c["start"],
        "duration": c["duration"],
        "length": c["length"],
        "drift": c["drift"],
        "height": c["rise"],
        "height_above_bed": c["z"] + c["rise"],
        "velocity": velocity,
        "spin": spin,
        "takeoff_angle": np.degrees(np.arctan2(c["w"], c["u"])),
        "incidence_angle": np.degrees(np.arctan2(-c["w_in"], c["u_in"])),
        "deviation_angle": np.degrees(np.arctan2(c["drift"], c["length"])),
        "takeoff_x": c["u"],
        "takeoff_y": c["v"],
        "takeoff_z": c["w"],
        "impact_x": c["u_in"],
        "impact_y": c["v_in"],
        "impact_z": c["w_in"],
        "stokes": stokes * c["normal_speed"],
        "tilt": np.degrees(c["tilt"]),
        "clipped": c["clipped"],
        "impulse_x": c["impulse_x"],
        "impulse_y": c["impulse_y"],
        "impulse_z": c["impulse_z"],
        "contacts": c["contacts"],
    }
    return pd.DataFrame(columns)


def no_jumps() -> pd.DataFrame:
    """A table of jumps without a row."""
    return table_of(np.zeros((0, len(COLUMNS))), 1.0)


def counted_jumps(jumps: pd.DataFrame, number: Any, discard: int) -> pd.DataFrame:
    """The jumps from number `discard` on that are flights.

    A grain that comes to rest, or has just touched the bed and is hit from above, touches it again at once: two impacts with
    no flight between (shorter than `SHORTEST_FLIGHT`), which have neither a velocity nor a spin.
    """
    return jumps[(number >= discard) & (jumps["duration"] > SHORTEST_FLIGHT)].reset_index(drop=True)


def shares(counted: pd.DataFrame) -> dict[str, Any]:
    """Range of St, and shares of the impacts that were clipped or creep."""
    if not len(counted):
        return {"stokes": None, "clipped": math.nan, "creeping": math.nan}
    stokes = counted["stokes"]
    clipped, creeping = float((counted["clipped"] > 0.0).mean()), float((counted["height"] < CREEP).mean())
    return {"stokes": [float(stokes.min()), float(stokes.max())], "clipped": clipped, "creeping": creeping}


def ordered(jumps: pd.DataFrame) -> pd.DataFrame:
    """Jumps by grain and time."""
    return jumps.sort_values(["grain", "start"], kind="stable", ignore_index=True)


def encounter_unit(name: str) -> str:
    """The unit of a column of the table of encounters."""
    if name in ENCOUNTER_UNITS:
        return ENCOUNTER_UNITS[name]
    if name in AXES:
        return "d"
    if name.startswith("n_"):
        return "1"
    if "spin" in name:
        return "u*/d"
    return "m u*" if name.startswith("impulse") else "u*"


def encounter_table(rows: Floats) -> pd.DataFrame:
    """The table of encounters from the rows that a run records."""
    columns: dict[str, Any] = dict(zip(ENCOUNTER_COLUMNS, rows.T, strict=True))
    return pd.DataFrame({name: values.astype(np.int32) if name in WHOLE else values for name, values in columns.items()})


def no_encounters() -> pd.DataFrame:
    """A table of encounters without a row."""
    return encounter_table(np.zeros((0, len(ENCOUNTER_COLUMNS))))


def fate_table(rows: list[list[Any]]) -> pd.DataFrame:
    """The table of fates from what a run notes."""
    rows = sorted(rows, key=lambda row: (row[1], row[0]))
    grains, times, fates = ([row[k] for row in rows] for k in range(3))
    return pd.DataFrame({"grain": np.array(grains, dtype=np.int32), "time": np.array(times, dtype=np.float64), "fate": np.array(fates, dtype=np.str_)})


def tables_to_dataset(scene: Scene, jumps: pd.DataFrame, met: pd.DataFrame) -> xr.Dataset:
    """Tables of jumps and encounters as variables."""
    data: dict[str, Any] = {f"jump_{name}": ("jump", jumps[name].to_numpy(), attributes_of(scene, *UNITS[str(name)])) for name in jumps}
    data |= {f"encounter_{name}": ("encounter", met[name].to_numpy(), attributes_of(scene, encounter_unit(name), name.replace("_", " "))) for name in met}
    return xr.Dataset(data)


def table_in(whole: xr.Dataset, name: str, empty: pd.DataFrame) -> pd.DataFrame:
    """The table whose columns are kept as variables with a prefix; the empty one if none are."""
    found = {str(key).removeprefix(f"{name}_"): whole[key].to_numpy() for key in whole.data_vars if str(key).startswith(f"{name}_")}
    if name == "jump" and found and "grain" not in found:  # of a file from before single grains had a number
        found["grain"] = np.zeros(len(next(iter(found.values()))), dtype=np.int32)
    if found and set(found) != set(empty):
        raise ValueError(f"the table of {name}s has other columns")
    return pd.DataFrame({column: found[column] for column in empty}) if found else empty


def path_dataset(scene: Scene, times: Floats, values: Floats) -> xr.Dataset:
    """Paths from samples (time, grain, 2·dimensions)."""
    names = "xyz" if values.shape[2] == 6 else "xz"
    speeds = {"x": "u", "y": "v", "z": "w"}
    data = {name: (("time", "grain"), values[:, :, k], attributes_of(scene, "d", AXES[name])) for k, name in enumerate(names)}
    for k, name in enumerate(names):
        data[speeds[name]] = ("time", "grain"), values[:, :, len(names) + k], attributes_of(scene, "u*", f"velocity along {name}")
    coordinates = {"time": ("time", times, attributes_of(scene, "d/u*", "time")), "grain": np.arange(values.shape[1], dtype=np.int32)}
    numbers = scene.numbers
    return xr.Dataset(data, coords=coordinates, attrs={"diameter": numbers.diameter, "velocity": numbers.velocity})


def path_in(scene: Scene, whole: xr.Dataset) -> xr.Dataset | None:
    """The path of a dataset; None if none was kept."""
    names = [name for name in whole.data_vars if "time" in whole[name].dims]
    if not names:
        return None
    path = whole[names]
    path.attrs = {key: whole.attrs[key] for key in ("diameter", "velocity")}
    for name in (*names, "time"):
        attrs = path[name].attrs
        if attrs["units"] in SI:  # of a file from before units followed CF
            path[name].attrs = attributes_of(scene, attrs["units"], attrs["long_name"])
    return path
