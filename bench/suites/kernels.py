"""How do the finite-Reynolds kernels differ from the Basset kernel (thesis figs 5-1 and 5-2)?"""

from __future__ import annotations

from typing import Any

import numpy as np

import basset

SLIP, DIAMETER, VISCOSITY = 0.01, 1.0e-3, 1.0e-6  # m/s, m, m²/s: 2a|u|/ν = 10, as in the thesis
WINDOW = 0.1  # seconds, arbitrary as in the thesis


def run(full: bool) -> dict[str, Any]:
    """K(s) in s^(-1/2) over six decades of lag, and the split into window and tail."""
    lags = np.logspace(-4, 2, 121)
    kernels: dict[str, basset.Kernel] = {
        "Basset": basset.BassetKernel(),
        "Mei–Adrian": basset.MeiAdrianKernel(SLIP, DIAMETER, VISCOSITY),
        "Dorgan–Loth": basset.MeiAdrianKernel.dorgan_loth(SLIP, DIAMETER, VISCOSITY),
    }
    finite = kernels["Mei–Adrian"]
    assert isinstance(finite, basset.MeiAdrianKernel)
    return {
        "slip": SLIP,
        "diameter": DIAMETER,
        "viscosity": VISCOSITY,
        "reynolds": finite.reynolds,
        "window": WINDOW,
        "lags": lags,
        "values": {name: kernel(lags) for name, kernel in kernels.items()},
    }
