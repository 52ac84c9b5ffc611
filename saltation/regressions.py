"""Published regressions of saltation in water, and bed-load formulas: what a run is measured against.

Heights and lengths are in grain diameters d, speeds in shear velocities u*, bed load is the Einstein number
q* = q/√(R g d³). All constants are taken from secondary sources, not from the papers themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset._validate import finite as _reals
from saltation.grain import critical_shields

Floats = NDArray[np.float64]


class Jump(NamedTuple):
    """The mean jump."""

    height: Floats  # d
    length: Floats  # d
    speed: Floats  # u*, along the stream


@dataclass(frozen=True)
class Regression:
    """One published regression of the mean jump: name, paper, and function of R_p and T."""

    name: str
    source: str
    function: Callable[[Floats, Floats], Jump]

    def __call__(self, particle_reynolds: ArrayLike, transport_stage: ArrayLike) -> Jump:
        """The mean jump at R_p = √(R g d³)/ν (thesis 4-13) and T = τ*/τ*c with τ*c of `critical_shields`, elementwise; at and below T = 1 nothing jumps.

        >>> jump = REGRESSIONS["sklar_dietrich_2004"](73.0, 2.0)
        >>> round(float(jump.height), 12), round(float(jump.length), 12)
        (1.44, 8.0)
        """
        rp = _quantity("particle_reynolds", particle_reynolds, above=True)
        stage = _quantity("transport_stage", transport_stage)
        try:
            rp, stage = np.broadcast_arrays(rp, stage)
        except ValueError:
            raise ValueError(f"particle_reynolds and transport_stage must have shapes that broadcast, got {rp.shape} and {stage.shape}") from None
        # below the threshold the formulas have powers of negative numbers, and 0/√τ* without a stream
        moving = stage > 1.0
        jump = self.function(rp, np.where(moving, stage, 2.0))
        return Jump(*(np.where(moving, quantity, 0.0)[()] for quantity in jump))


def _lee_hsu(rp: Any, stage: Any) -> Jump:
    """H = 14.3 x^0.575, L = 196.3 x^0.788, ū = 11.53 x^0.174 with x = τ* − τ*c."""
    excess = (stage - 1.0) * critical_shields(rp)
    return Jump(14.3 * excess**0.575, 196.3 * excess**0.788, 11.53 * excess**0.174)


def _sklar_dietrich(rp: Any, stage: Any) -> Jump:
    """H = 1.44 (T−1)^0.5, L = 8.0 (T−1)^0.88, ū/√(RgD) = 1.56 (T−1)^0.56; u*/√(RgD) = √τ*."""
    excess = stage - 1.0
    return Jump(1.44 * excess**0.5, 8.0 * excess**0.88, 1.56 * excess**0.56 / np.sqrt(stage * critical_shields(rp)))


def _van_rijn(rp: Any, stage: Any) -> Jump:
    """H = 0.3 D*^0.7 (T−1)^0.5, L = 3 D*^0.6 (T−1)^0.9, ū/√(RgD) = 1.5 (T−1)^0.6; D* = R_p^(2/3)."""
    excess, size = stage - 1.0, rp ** (2.0 / 3.0)
    speed = 1.5 * excess**0.6 / np.sqrt(stage * critical_shields(rp))
    return Jump(0.3 * size**0.7 * excess**0.5, 3.0 * size**0.6 * excess**0.9, speed)


REGRESSIONS: dict[str, Regression] = {
    regression.name: regression
    for regression in (
        Regression("lee_hsu_1994", "Lee and Hsu (1994), J. Hydraul. Eng. 120(7), 831–848", _lee_hsu),
        Regression("sklar_dietrich_2004", "Sklar and Dietrich (2004), Water Resour. Res. 40, W06301", _sklar_dietrich),
        Regression("van_rijn_1984", "van Rijn (1984), J. Hydraul. Eng. 110(10), 1431–1456, with the τ*c used here instead of his own", _van_rijn),
    )
}


def envelope(particle_reynolds: ArrayLike, transport_stage: ArrayLike) -> dict[str, tuple[Floats, Floats]]:
    """Lowest and highest of all `REGRESSIONS` in height (d), length (d) and speed (u*): they differ by 1.5–3 in height and 2–5 in length."""
    jumps = [regression(particle_reynolds, transport_stage) for regression in REGRESSIONS.values()]
    return {name: (np.min(values, axis=0), np.max(values, axis=0)) for name, values in zip(Jump._fields, zip(*jumps, strict=True), strict=True)}


def meyer_peter_mueller(shields: ArrayLike) -> Floats:
    """Bed load q/√(R g d³) = 8 (τ* − 0.047)^(3/2), zero below the threshold.

    Meyer-Peter and Müller (1948), 2nd meeting of the IAHSR, Stockholm, 39–64.
    """
    return 8.0 * _above(shields, 0.047) ** 1.5


def wong_parker(shields: ArrayLike) -> Floats:
    """Bed load q/√(R g d³) = 3.97 (τ* − 0.0495)^(3/2), zero below the threshold. Wong and Parker (2006), J. Hydraul. Eng. 132(11), 1159–1168."""
    return 3.97 * _above(shields, 0.0495) ** 1.5


def bed_load(shields: ArrayLike, critical: ArrayLike, speed: ArrayLike, friction: ArrayLike) -> Floats:
    """Bed load q/√(R g d³) = (τ* − τ*c) ū √τ*/μ_d of grains that jump at the mean speed ū (u*), zero below the threshold; μ_d = ΣJ_x/ΣJ_z.

    The grains' drag on the bed, μ_d times their submerged weight, takes up what the stress exceeds its critical value by
    (Bagnold 1956, Philos. Trans. R. Soc. A 249, 235–297); that stress leaves it open how many grains there are.
    """
    tau, critical = _quantity("shields", shields), _quantity("critical", critical, above=True)
    speed, friction = _reals("speed", speed), _quantity("friction", friction, above=True)
    try:
        rate: Floats = np.maximum(tau - critical, 0.0) * speed * np.sqrt(tau) / friction
    except ValueError:
        shapes = ", ".join(str(array.shape) for array in (tau, critical, speed, friction))
        raise ValueError(f"shields, critical, speed and friction must have shapes that broadcast, got {shapes}") from None
    return rate


def _above(shields: ArrayLike, threshold: float) -> Floats:
    excess: Floats = np.maximum(_quantity("shields", shields) - threshold, 0.0)
    return excess


def _quantity(name: str, value: ArrayLike, above: bool = False) -> Floats:
    """`value` as finite float64 of at least (with `above`, greater than) zero."""
    array = _reals(name, value)
    bad = array[array <= 0.0] if above else array[array < 0.0]
    if bad.size:
        raise ValueError(f"{name} must be {'greater than 0' if above else '0 or greater'}, got {bad.flat[0]:g}")
    return array
