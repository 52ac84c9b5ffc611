"""Basset history: −c·H of the slip, with the initial slip and the slip jump of every rebound; c = 9α/√(π Re*), thesis (3-1).

The treatment of the history force at an impact changes the height of jumps by a factor of 2 to 3: `impulse` keeps the past and
adds the jump of the slip, `restart` drops the past and adds the whole new slip (the grain leaves its wake), `reset` drops both,
`none` keeps the past and ignores the jump. Measured normal rebounds from a smooth wall support `impulse` and contradict `reset` and `none`
(reports/measured.md); a rough bed has not been measured.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from basset.kernels import AnyKernel, BassetKernel, VaryingSlipKernel
from saltation._tables import Table
from saltation.closures import Closure
from saltation.effects.base import Setting
from saltation.grain import Numbers

__all__ = ["Options"]

NAME = "history"
SOURCE = "Basset (1888); Mei & Adrian (1992), J. Fluid Mech. 237, 323; Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833; thesis (3-1), (5-3)"
VALID = "far from walls; see each kernel's range of Re_p"
CLOSURES = {
    "basset": Closure({"kernel": "basset"}, 1888, "Basset (1888)", {"Re_p": (0.0, 1.0)}),
    "mei_adrian": Closure({"kernel": "mei_adrian"}, 1992, "Mei & Adrian (1992), J. Fluid Mech. 237, 323", {"Re_p": (0.0, 50.0)}),
    "dorgan_loth": Closure({"kernel": "dorgan_loth"}, 2007, "Dorgan & Loth (2007), Int. J. Multiphase Flow 33, 833", {"Re_p": (0.0, 300.0)}),
}
KERNELS = {"mei_adrian": (2.0, 0.105), "dorgan_loth": (2.5, 0.2)}  # c1, c2
BOUNCES = "Gondret, Lance & Petit 2002, Phys. Fluids 14, 643"
DECAYS = {  # k of e = 0.97 exp(−k/St) that fits those bounces (St 27 and 152) best: reports/measured.md
    "impulse": {"basset": 11.4, "mei_adrian": 17.2, "dorgan_loth": 17.2},
    "restart": {"basset": 24.5, "mei_adrian": 26.5, "dorgan_loth": 26.4},
    "reset": {"basset": 31.5, "mei_adrian": 31.0, "dorgan_loth": 30.9},
    "none": {"basset": 32.1, "mei_adrian": 31.4, "dorgan_loth": 31.2},
}
MISSED = {"impulse": 8, "reset": 28, "none": 28}  # % of the first apex: rms at the best k and kernel; without any history it is 20
REJECTED = ("reset", "none")  # worse than that
SLIPS = (1e-3, 1e3)  # V: a slower grain's kernel is Basset's as far as steps see


class Options(Table):
    """Kernel, scheme, and the treatment at an impact."""

    rebound: Literal["impulse", "restart", "reset", "none"] = Field("impulse", description="treatment of the history force at an impact")
    kernel: Literal["basset", "mei_adrian", "dorgan_loth"] = Field("basset", description="Basset's, or a finite-Reynolds kernel of the slip")
    slip_at: Literal["t", "tau"] | None = Field(
        None, description="slip in a finite-Reynolds kernel: the current one, 't' (default), or that at the time of the past rate, 'tau'"
    )
    scheme: str = Field("exponential", description="any key of basset.SCHEMES")
    order: int | None = Field(None, ge=1, le=10, description="degree of the polynomials, of schemes that have one")
    rtol: float | None = Field(None, gt=0.0, lt=1.0, description="bound on the relative error of a fitted sum of exponentials, dimensionless")
    rule: str | None = Field(None, description="the rule inside a window (scheme = 'windowed')")
    window: float | None = Field(None, gt=0.0, description="window in units of d/u*")
    window_jumps: int | None = Field(None, ge=1, le=50, description="history of only this number of last jumps (the thesis's T_back)")
    tail: str | bool | None = Field(None, description="beyond a window: 'fitted', 'van_hinsberg', 'casas', 'casas_5_I1' (terms, norm) or false")
    horizon: float | None = Field(
        None, gt=0.0, description="longest lag of the history integral, in units of d/u*; default: the run's duration, or 20 per jump and 1000 or more"
    )


def kernel_of(options: Options, numbers: Numbers) -> AnyKernel:
    """The kernel at fixed steps, in units of d and V."""
    if options.kernel == "basset":
        return BassetKernel()
    return VaryingSlipKernel(1.0, 1.0 / numbers.reynolds, SLIPS, options.slip_at or "t", *KERNELS[options.kernel])


def build(options: Options, setting: Setting) -> Any:
    """Nothing: the history is part of the equation itself and is integrated by the flight."""
    return None


def warnings(options: Options, numbers: Numbers) -> list[str]:
    """A treatment of impacts that measured rebounds contradict."""
    if options.rebound not in REJECTED:
        return []
    missed = f"{MISSED[options.rebound]} % of the first apex with its best restitution and kernel, 'impulse' {MISSED['impulse']} %"
    return [f"history.rebound = {options.rebound!r}: measured normal rebounds contradict it: its rms error is {missed} ({BOUNCES})"]
