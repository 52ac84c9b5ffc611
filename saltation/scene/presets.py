"""The models of thesis Table 2-1 by author: which forces, how many dimensions, what turns the grain, and what they had that is not computed here."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True)
class Preset:
    """Effects, dimensions and options that differ from the default; of the original also how grains met each other, its stream, its grains and more.

    With a [cloud] grains that met each other have the effect "encounters", too.
    """

    effects: tuple[str, ...]
    dimensions: int
    options: dict[str, dict[str, Any]] = field(default_factory=dict)
    collisions: Literal["", "hard", "soft"] = ""
    stream: str = ""  # where it was more than a mean profile
    diameters: tuple[float, float] | None = None  # mm
    note: str = ""


BASE = ("weight", "drag", "added_mass")
LIFT = ("weight", "drag", "lift")
ALL = (*BASE, "lift", "history", "magnus", "rotation")
PRESCRIBED = {"rotation": {"law": "prescribed"}}
NO_EQUATION = "Table 2-1 has a Magnus force and no equation of rotation for it: its spin is prescribed, unless rotation.law says otherwise"
OF_GRAINS = "its bed was built of single grains: here a sub-model of roughness draws the contact planes"

PRESETS: dict[str, Preset] = {
    "sekine_kikkawa_1992": Preset(BASE, 3, diameters=(0.3, 0.6), note=OF_GRAINS),
    "lee_hsu_1994": Preset((*BASE, "lift", "magnus", "rotation"), 2, diameters=(1.36, 2.47)),
    "nino_garcia_1994": Preset(ALL, 2, PRESCRIBED, diameters=(15.0, 31.0), note=NO_EQUATION),
    "nino_garcia_1998": Preset(ALL, 2, PRESCRIBED, diameters=(0.5, 0.8)),
    "lee_2000": Preset(LIFT, 2, diameters=(6.0, 6.0)),
    "yeganeh_2000": Preset((*BASE, "rotation"), 2, stream="a k–ε model", diameters=(5.0, 5.0)),
    "schmeeckle_nelson_2003": Preset((*BASE, "rotation"), 3, stream="measured, with its fluctuations", diameters=(2.0, 7.0)),
    "shabani_2005": Preset((*BASE, "rotation"), 3, collisions="soft", diameters=(0.05, 0.05)),
    "harada_gotoh_2006": Preset((*BASE, "rotation"), 3, collisions="soft", stream="a logarithmic profile with fluctuations by a Monte Carlo method"),
    "lee_2006": Preset(LIFT, 2, diameters=(0.6, 0.6)),  # Table 3-2; Table 2-1 prints 0.039 to 0.068, which is its u* in m/s
    "lukerchenko_2006": Preset(ALL, 2, diameters=(15.0, 15.0)),
    "lukerchenko_2009": Preset(ALL, 3, diameters=(0.5, 6.0)),
    "yeganeh_2009": Preset((*BASE, "rotation"), 3, collisions="soft", stream="a logarithmic profile with turbulent intensities", diameters=(2.0, 2.0)),
    "bialik_2011": Preset((*BASE, "lift", "history"), 2, collisions="hard", stream="made by a generator of turbulence", diameters=(0.53, 1.36)),
    "bialik_2012": Preset((*BASE, "lift"), 3, stream="made by a generator of turbulence", diameters=(2.0, 2.0)),
}


def differences(preset: Preset, profile: str, many: bool, diameter: float) -> list[str]:
    """What the original had that a scene of that profile ("" in still water), of one or many grains (m), has not: a sentence each."""
    found = [preset.note] if preset.note else []
    if preset.stream:
        found.append(f"its stream was {preset.stream}: here it is {f'the mean profile {profile!r}' if profile else 'still water'}")
    if preset.collisions == "soft" and many:
        found.append("its grains met as soft spheres: here they meet as hard ones")
    if preset.collisions and not many:
        found.append("its grains met each other: for that, add a [cloud] table")
    if preset.diameters is not None:
        low, high = preset.diameters
        if not low * (1.0 - 1e-6) <= 1e3 * diameter <= high * (1.0 + 1e-6):
            theirs = f"{low:g} to {high:g}" if high > low else f"{low:g}"
            found.append(f"its grains measured {theirs} mm: here grain.diameter is {1e3 * diameter:g} mm")
    return found
