"""The models of thesis Table 2-1 by author: which forces, how many dimensions, what turns the grain."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Preset:
    """Effects, dimensions and options that differ from the default."""

    effects: tuple[str, ...]
    dimensions: int
    options: dict[str, dict[str, Any]] = field(default_factory=dict)


BASE = ("weight", "drag", "added_mass")
LIFT = ("weight", "drag", "lift")
ALL = (*BASE, "lift", "history", "magnus", "rotation")
PRESCRIBED = {"rotation": {"law": "prescribed"}}

PRESETS: dict[str, Preset] = {
    "sekine_kikkawa_1992": Preset(BASE, 3),
    "lee_hsu_1994": Preset((*BASE, "lift", "magnus", "rotation"), 2),
    "nino_garcia_1994": Preset(ALL, 2, PRESCRIBED),
    "nino_garcia_1998": Preset(ALL, 2, PRESCRIBED),
    "lee_2000": Preset(LIFT, 2),
    "yeganeh_2000": Preset((*BASE, "rotation"), 2),
    "schmeeckle_nelson_2003": Preset((*BASE, "rotation"), 3),
    "shabani_2005": Preset((*BASE, "rotation"), 3),
    "harada_gotoh_2006": Preset((*BASE, "rotation"), 3),
    "lee_2006": Preset(LIFT, 2),
    "lukerchenko_2006": Preset(ALL, 2),
    "lukerchenko_2009": Preset(ALL, 3),
    "yeganeh_2009": Preset((*BASE, "rotation"), 3),
    "bialik_2011": Preset((*BASE, "lift", "history"), 2),
    "bialik_2012": Preset((*BASE, "lift"), 3),
}
