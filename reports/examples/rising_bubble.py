"""A clean bubble in oil reaches its terminal speed sooner than a hollow sphere: its kernel is bounded at s = 0, and 4/9 of Basset's at long lags."""

import mpmath
import numba
import numpy as np
from matplotlib.figure import Figure

import basset

D, NU, G = 1e-3, 1e-4, 9.81  # m, m²/s, m/s²: Re < 0.1
RATE, COEFFICIENT = 18.0 * NU / D**2 / 0.5, 9.0 / D * np.sqrt(NU / np.pi) / 0.5  # all inertia is added mass


@numba.njit
def still(t, x):
    """Oil at rest."""
    return 0.0, 0.0, 0.0


@numba.njit
def mobile(re):
    """The surface of a bubble gives way: two thirds of Stokes's drag (Hadamard 1911, Rybczynski 1911)."""
    return 2.0 / 3.0


def exact(t: float, bubble: bool) -> float:
    """The speed from its Laplace transform, p (s) v = 2g/s, which mpmath inverts; K of the bubble is 4√π/9 over √s (√(s τ) + 1)."""
    tau = D**2 / (36.0 * NU)

    def transform(s):
        kernel = mpmath.sqrt(mpmath.pi / s) * (4.0 / 9.0 / (mpmath.sqrt(s * tau) + 1.0) if bubble else 1.0)
        return 2.0 * G / s / (s + RATE * (2.0 / 3.0 if bubble else 1.0) + COEFFICIENT * s * kernel)

    return float(mpmath.invertlaplace(transform, t, method="talbot"))


def example() -> Figure:
    """Speeds over the last ones, beside the exact solution."""
    t = np.append(0.0, np.geomspace(1e-6, 0.1, 121))
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    error = 0.0
    for bubble, name in ((True, "clean bubble"), (False, "hollow sphere")):
        special = {"drag": mobile, "kernel": basset.BubbleKernel(D, NU)} if bubble else {}
        rise = basset.maxey_riley(still, (0.0, 0.1), np.zeros(3), diameter=D, density_ratio=0.0, viscosity=NU, t_eval=t, **special)
        last = 2.0 * G / RATE * (1.5 if bubble else 1.0)
        speed, truth = rise.velocity[0, :, 2].values / last, np.array([exact(time, bubble) for time in t[1::8]]) / last
        (line,) = axes.semilogx(1e3 * t[1:], speed[1:], label=f"{name}, terminal speed {1e3 * last:.1f} mm/s")
        axes.plot(1e3 * t[1::8], truth, ".", color=line.get_color(), markersize=8)
        error = max(error, np.abs(speed[1::8] - truth).max())
    assert error < 1e-6
    axes.plot([], [], "k.", markersize=8, label="exact")
    axes.set(xlabel="time, ms", ylabel="speed / terminal speed", ylim=(0.0, 1.0), title="A bubble of 1 mm reaches its terminal speed before a sphere")
    axes.legend(loc="upper left")
    print(f"within {error:.0e} of the exact speeds")
    return figure


if __name__ == "__main__":
    example().savefig("rising_bubble.png")
