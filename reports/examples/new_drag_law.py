"""Abraham's drag law in one line: nylon spheres settle in oil at the speeds that ten Cate et al. (2002) give for it, at Reynolds numbers from 1.5 to 32."""

import numba
import numpy as np
from matplotlib.figure import Figure

import basset

D, DENSITY = 15e-3, 1120.0  # of the spheres: m, kg/m³
OILS = {"Re 1.5": (970.0, 0.373, 0.03829), "Re 4.1": (965.0, 0.212, 0.05992), "Re 11.6": (962.0, 0.113, 0.09062), "Re 31.9": (960.0, 0.058, 0.12839)}


@numba.njit
def still(t, x):
    """Oil at rest."""
    return 0.0, 0.0, 0.0


@numba.njit
def abraham(re):
    """The factor on Stokes's drag, C_D Re/24 (Abraham 1970, Phys. Fluids 13, 2194)."""
    return (1.0 + np.sqrt(re) / 9.06) ** 2


def example() -> Figure:
    """Speeds in time, and those of the table: kg/m³ and Pa s of the oil, m/s."""
    t = np.linspace(0.0, 8.0, 401)
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    off = []
    for name, (density, viscosity, told) in OILS.items():
        nu = viscosity / density
        sphere = {"diameter": D, "density_ratio": DENSITY / density, "viscosity": nu, "density": density}
        kernel = basset.MeiAdrianKernel(told, D, nu)
        fall = basset.maxey_riley(still, (0.0, 8.0), np.zeros(3), drag=abraham, kernel=kernel, t_eval=t, **sphere)
        speed = -fall.velocity[0, :, 2].values
        off.append(abs(speed[-1] / told - 1.0))
        (line,) = axes.plot(t, 1e3 * speed)
        axes.plot([2.0], [1e3 * told], "<", color=line.get_color(), clip_on=False, zorder=5)
        axes.annotate(f"{name}: {1e3 * told:.1f}", (2.0, 1e3 * told), xytext=(8, 0), textcoords="offset points", va="center", annotation_clip=False)
    assert max(off) < 1e-3
    axes.set(xlabel="time, s", ylabel="speed, mm/s", xlim=(0.0, 2.0), ylim=(0.0, 140.0), title="Nylon spheres settle by Abraham's law; ◂ the published speed")
    print(f"within {100.0 * max(off):.2f} % of the published speeds")
    return figure


if __name__ == "__main__":
    example().savefig("new_drag_law.png")
