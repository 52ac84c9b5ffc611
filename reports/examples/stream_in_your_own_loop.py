"""A thousand spheres in an oscillating stream, in your own time loop: semi-implicit because H at the next node is tail + local · (its rate)."""

import numpy as np
from matplotlib.figure import Figure

import basset
from basset import reference

DT, STEPS, OMEGA = 0.01, 2000, 1.0  # s, dimensionless, 1/s
RATE, COEFFICIENT = np.geomspace(0.1, 10.0, 1000), 0.5  # of drag, 1/s, one for each sphere; of history, s^(-1/2)


def example() -> Figure:
    """The slip of three of them in time, beside the exact solution."""
    drive = np.cos(OMEGA * DT * np.arange(STEPS + 1))
    slip = np.zeros((STEPS + 1, len(RATE)))
    plan = basset.Exponential(order=2, rtol=1e-6).plan(dt=DT, horizon=DT * STEPS)
    state = plan.start(shape=RATE.shape)
    rate = np.full(RATE.shape, drive[0])  # they start with the stream: neither drag nor history yet
    plan.push(state, rate)
    for n in range(STEPS):  # trapezoidal rule, implicit in drag and in the newest part of the history
        tail, local = plan.tail(state), plan.local(state)
        known = slip[n] + 0.5 * DT * rate
        rate = (drive[n + 1] - RATE * known - COEFFICIENT * tail) / (1.0 + 0.5 * DT * RATE + COEFFICIENT * local)
        slip[n + 1] = known + 0.5 * DT * rate
        plan.push(state, rate)

    t = DT * np.arange(STEPS + 1)
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    error = 0.0
    for sphere in (0, 500, 999):
        exact = reference.oscillating_stream(t[::40], RATE[sphere], COEFFICIENT, omega=OMEGA)
        error = max(error, np.abs(slip[::40, sphere] - exact).max())
        (line,) = axes.plot(t, slip[:, sphere], label=f"drag {RATE[sphere]:.2g} per second")
        axes.plot(t[::40], exact, ".", color=line.get_color())
    assert error < 2e-4
    axes.plot([], [], "k.", label="exact")
    axes.set(xlabel="time, s", ylabel="slip, m/s", title="Three of a thousand spheres in an oscillating stream")
    figure.legend(loc="outside lower center", ncols=4)
    print(f"within {error:.0e} m/s of the exact slip")
    return figure


if __name__ == "__main__":
    example().savefig("stream_in_your_own_loop.png")
