"""Coefficients as `basset sum` prints them, in a recursion that any language can repeat: the same history integral as the library's own stream."""

import json
import subprocess
import sys

import numpy as np
from matplotlib.figure import Figure

import basset
from basset import reference

NEAR, FAR, RTOL = 0.1, 50.0, 1e-6  # s, s; the error bound of the sum


def recursion(c: dict, rates: np.ndarray) -> np.ndarray:
    """H at every node: nothing but the printed numbers, memory of the newest samples and of one number per exponential."""
    sample, term, found = np.zeros(c["last"] + 1), np.zeros(c["terms"]), []
    for n, g in enumerate(rates):
        sample = np.append(g, sample[:-1])
        gained = 0.0
        if n >= c["last"]:
            gained = np.dot(c["entry"], sample) if n == c["last"] else np.multiply(c["gain"], sample[-1])
        term = term + gained - np.multiply(c["loss"], term)
        found.append(np.dot(c["start"][n] if n < c["last"] else c["newest"], sample) + term.sum())
    return np.array(found)


def example() -> Figure:
    """H of f' = cos t by the recursion, and its error."""
    command = [sys.executable, "-m", "basset", "sum", "--near", str(NEAR), "--far", str(FAR), "--rtol", str(RTOL), "--order", "3", "--format", "json"]
    printed = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    t = printed["dt"] * np.arange(printed["steps"] + 1)
    found, exact = recursion(printed, np.cos(t)), reference.cosine(t)

    rule = basset.Windowed(basset.Daitche(3), NEAR, basset.ExponentialSum.fit(NEAR, FAR, RTOL))
    plan = rule.plan(printed["dt"], FAR)
    stream = plan.run(plan.start(), np.cos(t))
    off, apart = np.abs(found - exact)[5:], np.abs(found - stream)[5:]  # the first nodes have but a few samples behind them
    assert apart.max() < 1e-12 and off.max() < 1e-6 * np.abs(exact).max()

    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    above.plot(t, found)
    above.set(ylabel="H, m/s^(3/2)", title=f"{printed['terms']} printed exponentials remember {FAR:g} s")
    below.semilogy(t[5::3], off[::3], label="from the exact integral")
    below.semilogy(t[5::3], apart[::3] + 1e-17, label="from the library's stream")
    below.set(xlabel="time, s", ylabel="difference", yticks=(1e-16, 1e-11, 1e-6))
    figure.legend(loc="outside lower center", ncols=2)
    print(f"{apart.max():.0e} from the library's stream, {off.max():.0e} from the exact history integral")
    return figure


if __name__ == "__main__":
    example().savefig("coefficients_for_a_cfd_code.png")
