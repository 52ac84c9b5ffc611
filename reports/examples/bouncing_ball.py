"""A steel ball's first bounce in silicone oil as Gondret, Lance & Petit (2002) measured it: with the dry restitution, if the history remembers the impact."""

import numba
import numpy as np
from matplotlib.figure import Figure

import basset

BALL = {"diameter": 3e-3, "density_ratio": 8.342, "viscosity": 1.07e-5, "drag": "schiller_naumann"}  # SI units; Stokes number 152
DRY = 0.97  # restitution in air
MEASURED = np.array([(0.0, 0.0), (38.4, 7.466), (83.5, 0.0), (106.4, 2.234), (130.9, 0.0)])  # ms after the first contact, mm: contacts and apexes


@numba.njit
def still(t, x):
    """Oil at rest."""
    return 0.0, 0.0, 0.0


@numba.njit
def gap(t, x, v):
    """Nothing is left of it at a contact."""
    return x[2]


@numba.njit
def rebound(t, x, v):
    """Velocity after a contact."""
    return v[0], v[1], -DRY * v[2]


def example() -> Figure:
    """The gap under the ball from the first contact on, with history and without."""
    gap.direction, gap.jump = -1, rebound
    t = np.linspace(5.2, 6.2, 4001)  # a fall of three metres, to terminal speed, takes 5.4 s
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    second, apex = {}, {}
    for history, line in ((True, "-"), (False, "--")):
        ball = basset.maxey_riley(still, (0.0, 6.2), [0.0, 0.0, 3.0], t_eval=t, events=gap, history=history, **BALL)
        contacts, height = ball.event_time.values, ball.position[0, :, 2].values
        second[history] = 1e3 * (contacts[1] - contacts[0])
        apex[history] = 1e3 * height[(t > contacts[0]) & (t < contacts[1])].max()
        shown = (t > contacts[0] - 0.005) & (t < contacts[0] + 0.14)
        axes.plot(1e3 * (t - contacts[0])[shown], 1e3 * height[shown], line, label="with the history force" if history else "without")
    assert abs(second[True] - 83.5) < 0.01 * 83.5 and abs(apex[True] - 7.466) < 0.05 * 7.466
    assert second[False] > 1.3 * 83.5 and apex[False] > 1.6 * 7.466

    axes.plot(*MEASURED.T, "ko", label="measured")
    axes.set(xlabel="time after the first contact, ms", ylabel="gap under the ball, mm", title="The first bounce is as measured if its history is remembered")
    axes.legend()
    print(f"back on the wall after {second[True]:.1f} ms, measured 83.5 ms; without the history force {second[False]:.0f} ms")
    return figure


if __name__ == "__main__":
    example().savefig("bouncing_ball.png")
