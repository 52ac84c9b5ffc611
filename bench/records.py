"""Measured motions of single spheres: key figures, which are facts, with their sources; the full digitised records are read from a folder.

A record is a file of two columns without a header, lines that begin with # left out: of a bounce seconds and the gap under the sphere (m),
of a fall t/√(d/g) and v/√(g d).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from basset.kernels import Floats

GONDRET = "Gondret, Lance & Petit (2002), Phys. Fluids 14, 643"
DIGITISED = "PARTIES, testcases/Gondret_Testcase (github.com/m-jalabert/PARTIES-VoF-IBM)"
CONDITIONS = "Biegert, Vowinckel & Meiburg (2017), J. Comput. Phys. 340, 105, table 1"
MARGIN = 2e-3  # s: points so close to the last contact that counts are left out, for a model's contact may come before


@dataclass(frozen=True)
class Bounce:
    """A sphere that falls on a wall in still liquid: SI units, times from the first contact."""

    name: str
    file: str
    ratio: float  # ρ_s/ρ
    viscosity: float  # m²/s
    diameter: float  # m
    speed: float  # m/s at the first contact
    stokes: float
    reynolds: float
    contacts: tuple[float, ...]  # s, behind the first
    apexes: tuple[tuple[float, float], ...]  # s, m
    scale: float  # m, the first apex: misfits are over it
    dry: float = 0.97
    source: str = GONDRET
    digitised: str = DIGITISED

    def key_points(self) -> Floats:
        """The apexes before the last contact that counts and the contacts, at which the gap is 0: (points, 2), s and m."""
        found = [*self.apexes, *((time, 0.0) for time in self.contacts)]
        return np.array(sorted(point for point in found if point[0] <= self.contacts[-1]))

    def points(self, folder: Path | None) -> Floats:
        """All measured points from the first contact to the last that counts; without a folder the key points."""
        if folder is None:
            return self.key_points()
        found = read(folder / self.file)
        return found[(found[:, 0] > 0.0) & (found[:, 0] < self.contacts[-1] - MARGIN)]


ST152 = Bounce(
    "St 152", "gondret_st152.csv", 8.342, 1.070e-5, 3.0e-3, 0.585, 152.0, 164.0,
    (0.0835, 0.1309, 0.153), ((0.0384, 7.466e-3), (0.1064, 2.234e-3), (0.1404, 0.520e-3), (0.1564, 0.096e-3)), 7.466e-3,
)  # fmt: skip
ST27 = Bounce("St 27", "gondret_st27.csv", 8.083, 1.036e-4, 6.0e-3, 0.518, 27.0, 30.0, (0.0426,), ((0.0192, 1.972e-3),), 1.972e-3)
BOUNCES = (ST152, ST27)


@dataclass(frozen=True)
class Fall:
    """A sphere that sets out from rest far from walls: its terminal speed, and the time after which it has 95 % of it."""

    name: str
    ratio: float
    viscosity: float  # m²/s
    diameter: float  # m
    reynolds: float
    speed: float  # m/s
    time: float  # s, to 95 % of the speed


# of the table of the paper, as the runs of a fully resolved simulation give them: speeds, times and √(R g d³)/ν of 49.14, 206.27 and 255.35
MORDANT = "Mordant & Pinton (2000), Eur. Phys. J. B 18, 343"
MORDANT_FROM = "test case sphere-settling-large-domain of a Basilisk sandbox: the paper's speeds and times, V(1 − exp(−3t/t95))"
FALLS = (
    Fall("Re 41", 2.56, 8.9e-7, 0.5e-3, 41.0, 0.0741, 0.055),
    Fall("Re 280", 7.71, 8.9e-7, 0.8e-3, 280.0, 0.316, 0.108),
    Fall("Re 360", 2.56, 8.9e-7, 1.5e-3, 360.0, 0.218, 0.142),
)
RE41_FILE, RE41_RATIO, RE41_GALILEI, RE41_LAST = "mordant_re41.csv", 2.5677, 39.35, 1.064  # √(g d³)/ν; last v/√(g d)
RE41_FROM = "PARTIES, plot_reference_vs_simulation_vs_simplified.svg"


@dataclass(frozen=True)
class Tank:
    """Ten Cate's nylon sphere (15 mm, 1120 kg/m³) that falls by 120 mm to the bottom of a tank of 100 × 100 × 160 mm."""

    name: str
    density: float  # kg/m³, of the liquid
    viscosity: float  # Pa s
    reynolds: float
    share: float  # largest measured speed over that of the endless fall by Abraham's drag
    endless: float  # m/s, that speed


TEN_CATE = "ten Cate, Nieuwstad, Derksen & Van den Akker (2002), Phys. Fluids 14, 4012, tables I and II"
TEN_CATE_FROM = (
    "their numbers as checked against the paper in a data sheet among the peclet project's documents (github.com/computational-chemical-engineering)"
)
TANK_DIAMETER, TANK_DENSITY, TANK_FALL = 15.0e-3, 1120.0, 0.120
TANKS = (
    Tank("Re 1.5", 970.0, 0.373, 1.5, 0.947, 0.03829),
    Tank("Re 4.1", 965.0, 0.212, 4.1, 0.953, 0.05992),
    Tank("Re 11.6", 962.0, 0.113, 11.6, 0.959, 0.09062),
    Tank("Re 31.9", 960.0, 0.058, 31.9, 0.955, 0.12839),
)
ELSEWHERE: Sequence[tuple[str, str, str]] = (  # what, where, why it is not flown here
    (
        "spheres of steel, PTFE and POM that fall on a wall, terminal Re 333 to 4012, St 50 to 2250",
        "Hagemeier, Thévenin & Richter (2020), arXiv:2009.02250; data sets on Mendeley Data",
        "open and the richest found; most are above the range of the kernels (Re 300)",
    ),
    (
        "a sphere that settles in a tank, speed and place against time, Re 1.5",
        "SedFoam, tutorialsDyM/Py/DATA/tenCate2002velocityRe1.5.csv (GitHub); ten Cate et al. (2002)",
        "its greatest speed is among those above; in a tank of 6.7 diameters",
    ),
    (
        "restitution against the Stokes number, many spheres and walls",
        "Joseph et al. (2001), J. Fluid Mech. 433, 329; Gondret et al. (2002)",
        "found in figures only, and e by the slopes at the wall has the history in it",
    ),
    ("a sphere in oscillating oil", "Lambertz (2012), diploma thesis, Göttingen", "in figures only"),
)


def read(path: Path) -> Floats:
    """The two columns of a record; ValueError, with one sentence, if the file is missing or holds no such columns."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ValueError(f"record {path.name} cannot be read from {str(path.parent)!r}: {error.strerror}") from None
    try:
        found = np.array([[float(value) for value in line.split(",")] for line in lines if line.strip() and not line.startswith("#")])
    except ValueError:
        found = np.zeros(0)
    if found.ndim != 2 or found.shape[1] != 2 or not np.isfinite(found).all() or not (np.diff(found[:, 0]) > 0.0).all():
        raise ValueError(f"record {path.name} must hold lines of two finite numbers with a comma between them, the first of them increasing")
    return found
