"""Heavy spheres in Taylor and Green's vortices, given on a grid of 32 × 32 points: paths as in the exact flow to 1e-4 of a vortex."""

import numba
import numpy as np
import xarray
from matplotlib.figure import Figure

import basset

SPHERES = {"diameter": 0.02, "density_ratio": 2.0, "viscosity": 1e-3, "gravity": (0.0, 0.0, 0.0)}  # vortices of π metres, a metre per second
TURN, END = 2.0 * np.pi, 12.0


@numba.njit
def vortices(t, x):
    """The flow that the grid holds samples of."""
    return np.sin(x[0]) * np.cos(x[1]), -np.cos(x[0]) * np.sin(x[1])


def example() -> Figure:
    """Their paths through the grid's flow."""
    along = np.arange(32) * TURN / 32
    x, y = np.meshgrid(along, along, indexing="ij")
    grid = xarray.Dataset({"u": (("x", "y"), np.sin(x) * np.cos(y)), "v": (("x", "y"), -np.cos(x) * np.sin(y))}, {"x": along, "y": along})
    flow = basset.Flow.from_dataset(grid, periodic={"x": TURN, "y": TURN})

    starts = np.stack([np.linspace(0.4, 2.6, 8), np.full(8, 1.2)], axis=1)
    t = np.linspace(0.0, END, 121)
    paths, exact = (basset.maxey_riley(field, (0.0, END), starts, t_eval=t, **SPHERES).position.values for field in (flow, vortices))
    apart = np.linalg.norm(paths - exact, axis=2).max() / np.pi
    assert apart < 1e-4

    figure = Figure(figsize=(5.4, 5.0), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(0.0, np.pi, 41)
    axes.contour(fine, fine, np.outer(np.sin(fine), np.sin(fine)), 4, colors="0.85", linewidths=0.8)
    axes.plot(*paths.transpose(2, 1, 0), color="C0")
    axes.plot(*starts.T, "ko", markersize=4, label="start")
    axes.plot(*exact[:, 20::20].reshape(-1, 2).T, ".", color="C1", label="exact flow, every 2 s")
    low, high = paths.reshape(-1, 2).min(axis=0) - 0.3, paths.reshape(-1, 2).max(axis=0) + 0.3
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_title("Heavy spheres leave a vortex that is given on a grid")
    figure.legend(loc="outside lower center", ncols=2)
    print(f"at most {apart:.0e} of a vortex apart from the paths in the exact flow")
    return figure


if __name__ == "__main__":
    example().savefig("gridded_flow.png")
