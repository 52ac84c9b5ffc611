"""A relaxation of order one half, y' = −D^½ y: its power-law tail over eight decades of time, to 1e-7 of Mittag-Leffler's function."""

import numba
import numpy as np
from matplotlib.figure import Figure
from scipy.special import erfcx

import basset


@numba.njit
def nothing(t, y):
    """No rate but that of the memory."""
    return 0.0 * y


def example() -> Figure:
    """The solution, Mittag-Leffler's E_½(−√t) = exp(t) erfc(√t), and an exponential for comparison."""
    t = np.geomspace(1e-4, 1e4, 161)
    # Riemann and Liouville's derivative D^½ is the history integral over √π
    run = basset.solve(nothing, (0.0, 1e4), [1.0], coefficient=1.0 / np.sqrt(np.pi), method=basset.Collocation(rtol=1e-8), t_eval=t)
    exact = erfcx(np.sqrt(t))
    error = np.abs(run.y[0] / exact - 1.0).max()
    assert error < 1e-7

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.loglog(t, run.y[0], label=r"$y' = -D^{1/2}\, y$, solved")
    axes.loglog(t[::8], exact[::8], "k.", markersize=8, label=r"$e^t\, \mathrm{erfc}\,\sqrt{t}$")
    axes.loglog(t, np.exp(-t), "--", label=r"$y' = -y$")
    axes.annotate(r"$1/\sqrt{\pi t}$", (1e3, 1.3 / np.sqrt(np.pi * 1e3)), xytext=(0, 8), textcoords="offset points")
    axes.set(xlabel="time (dimensionless)", ylabel="y", ylim=(1e-3, 2.0), title=f"Half-order relaxation: {run.nsteps} steps for eight decades")
    axes.legend(loc="lower left")
    print(f"relative error {error:.0e} over eight decades of time, in {run.nsteps} steps")
    return figure


if __name__ == "__main__":
    example().savefig("fractional_relaxation.png")
