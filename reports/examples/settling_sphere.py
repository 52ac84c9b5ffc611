"""A glass sphere's time to terminal speed in water (Mordant & Pinton 2000): a third less without the history force, 0.9 of it with."""

import numpy as np
from matplotlib.figure import Figure

import basset

SPHERE = {"diameter": 0.5e-3, "density_ratio": 2.56, "viscosity": 8.9e-7, "drag": "schiller_naumann"}  # SI units; Re = 41
SPEED, TIME = 0.0741, 0.055  # measured: terminal speed in m/s, and s to 95 per cent of it


def still(t, x):
    """Water at rest."""
    return 0.0, 0.0, 0.0


def example() -> Figure:
    """Speed over terminal speed against time, with two kernels and without history, beside the measurement."""
    t = np.linspace(0.0, 0.3, 1501)
    finite = basset.MeiAdrianKernel(SPEED, SPHERE["diameter"], SPHERE["viscosity"])  # decays faster at long lags, because of the wake
    choices = {"without history": {"history": False}, "Mei and Adrian's kernel": {"kernel": finite}, "Basset's kernel": {}}
    falls = {name: basset.maxey_riley(still, (0.0, 0.3), np.zeros(3), t_eval=t, **choice, **SPHERE) for name, choice in choices.items()}
    last = -float(falls["without history"].velocity[0, -1, 2])  # weight and drag alone decide it
    share = {name: -fall.velocity[0, :, 2].values / last for name, fall in falls.items()}
    times = {name: t[np.argmax(values > 0.95)] if values[-1] > 0.95 else np.inf for name, values in share.items()}
    assert abs(last - SPEED) < 0.07 * SPEED
    without, reached = times["without history"], times["Mei and Adrian's kernel"]
    assert abs(reached - TIME) < 0.11 * TIME and without < 0.67 * TIME

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for (name, values), line in zip(share.items(), ("--", "-", ":"), strict=True):
        axes.plot(1e3 * t, values, line, label=name)
    axes.plot(1e3 * TIME, 0.95, "ko", label="measured: 95 %")
    axes.annotate("55 ms", (1e3 * TIME, 0.95), xytext=(6, -12), textcoords="offset points")
    axes.set(xlabel="time, ms", ylabel="speed / terminal speed", xlim=(0.0, 200.0), ylim=(0.0, 1.05), title="The history force makes a sphere settle later")
    axes.legend(loc="lower right")
    print(f"95 % of the terminal speed after {1e3 * reached:.1f} ms, measured {1e3 * TIME:.0f} ms, without history {1e3 * without:.1f} ms")
    return figure


if __name__ == "__main__":
    example().savefig("settling_sphere.png")
