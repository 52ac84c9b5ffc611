"""A thousand heavy spheres in a vortex in solid rotation spiral out, each to within 1e-6 of the closed form of Candelier, Angilella & Souhar (2004)."""

import math

import numba
import numpy as np
from matplotlib.figure import Figure

import basset
from basset import reference

SPHERES = {"diameter": 0.02, "density_ratio": 2.0, "viscosity": 1e-3}  # a vortex of a metre and a radian per second
END = 2.0 * math.pi


@numba.njit
def vortex(t, x):
    """One turn in 2π seconds."""
    return -x[1], x[0]


def example() -> Figure:
    """Where they are after no turn, half a turn and one, with and without the history force."""
    rng = np.random.default_rng(1)
    radius, angle = np.sqrt(rng.uniform(0.0, 1.0, 1000)), rng.uniform(0.0, END, 1000)
    places = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    t = np.linspace(0.0, END, 3)
    ds = basset.maxey_riley(vortex, (0.0, END), places, t_eval=t, workers=2, **SPHERES)
    without = basset.maxey_riley(vortex, (0.0, END), places, t_eval=t, workers=2, history=False, **SPHERES)

    inertia = 2.0 + 0.5
    rate, coefficient = 18e-3 / 0.02**2 / inertia, 9.0 / 0.02 * math.sqrt(1e-3 / math.pi) / inertia
    outward = reference.solid_body_vortex(t, rate, coefficient, beta=1.5 / inertia).position  # of one that starts at 1: the equation is linear
    found = ds.position.values @ [1.0, 1.0j]
    error = np.abs(found - found[:, :1] * outward).max()
    assert error < 1e-6

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    for axes, k, title in zip(figure.subplots(1, 3, sharex=True, sharey=True), range(3), ("at the start", "after half a turn", "after one turn"), strict=True):
        axes.plot(*without.position[:, k].values.T, ".", markersize=2, color="C1", rasterized=True, label="without history")
        axes.plot(*ds.position[:, k].values.T, ".", markersize=2, color="C0", rasterized=True, label="with history")
        axes.set(title=title, aspect="equal", xlabel="x, m", ylabel="y, m")
        axes.label_outer()
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", markerscale=4)
    figure.suptitle("A thousand heavy spheres spiral out of a vortex, later with the history force")
    print(f"each of a thousand within {error:.0e} m of its exact place")
    return figure


if __name__ == "__main__":
    example().savefig("thousand_particles_in_a_vortex.png")
