"""A grain of quartz settles from rest in water: the history force makes it take ten times as long to come within 5 per cent of its last velocity."""

import numpy as np
from matplotlib.figure import Figure

import basset
from basset import reference

GRAIN = {"diameter": 50e-6, "density_ratio": 2.65, "viscosity": 1e-6}  # SI units; Re = 0.1
LAST = 1.65 * 9.81 * 50e-6**2 / 18e-6  # Stokes's velocity, m/s


def still(t, x):
    """Water at rest."""
    return 0.0, 0.0, 0.0


def example() -> Figure:
    """Velocity in time with the history force and without, beside the closed form."""
    t = np.linspace(0.0, 0.1, 2001)
    runs = {history: basset.maxey_riley(still, (0.0, 0.1), [0.0, 0.0, 0.0], t_eval=t, history=history, **GRAIN) for history in (True, False)}
    speed = {history: -run.velocity.sel(component="z")[0].values / LAST for history, run in runs.items()}
    late = {history: float(t[np.argmax(values > 0.95)]) for history, values in speed.items()}

    inertia = 2.65 + 0.5
    rate, coefficient = 18e-6 / 50e-6**2 / inertia, 9.0 / 50e-6 * np.sqrt(1e-6 / np.pi) / inertia
    exact = -reference.settling(t, rate, coefficient, 1.65 * 9.81 / inertia) / LAST
    assert np.abs(speed[True] - exact).max() < 1e-6
    assert late[True] > 10.0 * late[False]

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(1e3 * t, speed[True], label="with the history force")
    axes.plot(1e3 * t[::100], exact[::100], "k.", label="closed form")
    axes.plot(1e3 * t, speed[False], "--", label="without")
    axes.set(xlabel="time, ms", ylabel="velocity / Stokes's velocity", title="Quartz of 50 µm settles in water")
    axes.legend()
    return figure


if __name__ == "__main__":
    example().savefig("settling_sphere.png")
