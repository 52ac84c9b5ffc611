"""`solve` with a kernel that follows the slip, against product integration of the history integral itself on a graded mesh."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import basset
from basset.kernels import gauss_legendre

KERNEL = basset.VaryingSlipKernel(diameter=1.0, viscosity=0.02, slip_range=(1e-9, 100.0))
FASTER = basset.VaryingSlipKernel(diameter=1.0, viscosity=0.02, slip_range=(1e-9, 100.0), c1=2.5, c2=0.2)
DRAG, STRENGTH, WEIGHT, END = 1.3, 0.8, 1.0, 3.0


def rate(t, y):
    return -DRAG * y * (1.0 + 0.15 * (abs(y) / 0.02) ** 0.687) + WEIGHT


def unit_integral(c1):
    """x -> ∫_0^x s^(-1/2) (1 + s^(3/(2 c1)))^(-c1) ds, by Gauss's rule in ln s."""
    logs = np.linspace(-40.0, 12.0, 4000)
    nodes, weights = gauss_legendre(16)
    places = np.exp(logs[:-1, None] + np.diff(logs)[:, None] * nodes)
    gained = (np.sqrt(places) * (1.0 + places ** (1.5 / c1)) ** -c1) @ weights * np.diff(logs)
    start = 2.0 * math.exp(0.5 * logs[0])
    spline = CubicSpline(logs, np.log(start + np.append(0.0, np.cumsum(gained))))
    return lambda x: np.exp(spline(np.log(x)))


def direct(kernel, start, cells):
    """Velocity at the end: linear pieces on a mesh graded to the start, backward differences of second order."""
    integral = unit_integral(kernel.c1)
    t = END * (np.arange(cells + 1) / cells) ** 4
    y = np.full(cells + 1, float(start))
    for n in range(1, cells + 1):
        step, before = t[n] - t[n - 1], t[n - 1] - t[n - 2] if n > 1 else math.inf
        slopes = np.diff(y[:n]) / np.diff(t[:n])
        ratio = step / before if n > 1 else 0.0
        factors = np.array([(1.0 + 2.0 * ratio) / (1.0 + ratio), -(1.0 + ratio), ratio**2 / (1.0 + ratio)]) / step
        z = y[n - 1]
        for _ in range(100):
            stretch = kernel.steepness(np.array([max(abs(z), 1e-9)]))[0] ** (2.0 / 3.0)
            known = np.append(integral(stretch * (t[n] - t[:n])), 0.0) / math.sqrt(stretch)
            weights = known[:-1] - known[1:]
            jump = start * t[n] ** -0.5 * (1.0 + (stretch * t[n]) ** (1.5 / kernel.c1)) ** -kernel.c1
            here, below = (
                factors @ np.array([place, y[n - 1], y[n - 2] if n > 1 else 0.0])
                - rate(t[n], place)
                + STRENGTH * (weights[:-1] @ slopes + weights[-1] * (place - y[n - 1]) / step + jump)
                for place in (z + 1e-6, z - 1e-6)
            )
            change = 0.5 * (here + below) * 2e-6 / (here - below)
            z -= change
            if abs(change) < 1e-13:
                break
        y[n] = z
    return y[-1]


@pytest.mark.analytic
@pytest.mark.parametrize("kernel", [KERNEL, FASTER], ids=["mei_adrian", "dorgan_loth"])
@pytest.mark.parametrize("start", [0.0, 1.0])
def test_against_product_integration(kernel, start):
    """The mesh is halved twice; what its order (2, some less where the slip is small) leaves is a few 1e-6."""
    coarse, fine = direct(kernel, start, 150), direct(kernel, start, 300)
    found = basset.solve(rate, (0.0, END), [start], coefficient=STRENGTH, kernel=kernel, method=basset.Collocation(rtol=1e-8))
    assert found.success
    assert abs(found.y[0, -1] - fine) < 0.8 * abs(found.y[0, -1] - coarse) and abs(found.y[0, -1] - fine) < 1e-5
    stays = basset.solve(rate, (0.0, END), [start], coefficient=STRENGTH, method=basset.Collocation(rtol=1e-8))
    assert abs(found.y[0, -1] - stays.y[0, -1]) > 1e-3  # Basset's kernel is far from that


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_the_error_asked_for_is_kept(start):
    times, rtols = np.geomspace(1e-3, END, 30), (1e-10, 1e-3, 1e-5, 1e-7)
    exact, *found = (
        basset.solve(rate, (0.0, END), [start], coefficient=STRENGTH, kernel=KERNEL, method=basset.Collocation(rtol=rtol), t_eval=times).y[0] for rtol in rtols
    )
    for rtol, y in zip(rtols[1:], found, strict=True):
        assert np.abs(y - exact).max() < rtol * np.abs(exact).max()


def test_a_slip_in_two_directions_is_one_slip():
    """Turned by an angle the motion is turned; a component with the coefficient 0 counts for the slip too."""
    force = np.array([0.6, 0.8])

    def turned(t, y):
        return -DRAG * y + force * WEIGHT

    one = basset.solve(lambda t, y: -DRAG * y + WEIGHT, (0.0, END), [0.5], coefficient=STRENGTH, kernel=KERNEL)
    two = basset.solve(turned, (0.0, END), 0.5 * force, memory=[0, 1], coefficient=STRENGTH, kernel=KERNEL)
    assert np.abs(two.y[:, -1] - one.y[0, -1] * force).max() < 2e-6
    still = basset.solve(lambda t, y: [-y[0], 0.0], (0.0, 1.0), [0.1, 5.0], memory=[0, 1], coefficient=[STRENGTH, 0.0], kernel=KERNEL)
    alone = basset.solve(lambda t, y: -y, (0.0, 1.0), [0.1], coefficient=STRENGTH, kernel=KERNEL)
    fixed = basset.solve(lambda t, y: -y, (0.0, 1.0), [0.1], coefficient=STRENGTH, kernel=KERNEL.at(5.0))
    assert abs(still.y[0, -1] - fixed.y[0, -1]) < 1e-4 < 1e-3 < abs(still.y[0, -1] - alone.y[0, -1])


def test_a_slip_that_is_held_in_its_range_has_the_kernel_of_the_nearer_end():
    """A range of one slip is a kernel that stays."""
    narrow = basset.VaryingSlipKernel(1.0, 0.02, (0.1, 0.1 + 1e-12))
    for method in (basset.Collocation(rtol=1e-6), basset.Collocation(rtol=1e-8)):
        found, stays = (basset.solve(rate, (0.0, END), [1.0], coefficient=STRENGTH, kernel=k, method=method).y[0, -1] for k in (narrow, narrow.at(0.1)))
        assert abs(found - stays) < 4.0 * method.rtol


def test_bouncing():
    """Jumps of the slip at impacts, at two tolerances."""

    def floor(t, y):
        return y[0] - 1e-3 * math.pi

    floor.jump = lambda t, y: np.array([1e-3 * math.pi, -0.8 * y[1]])
    floor.direction = -1
    floor.terminal = False

    def fall(t, y):
        return [y[1], -WEIGHT - 0.1 * y[1]]

    loose, tight = (
        basset.solve(fall, (0.0, 6.0), [1.0, 0.0], memory=[1], coefficient=0.3, kernel=KERNEL, events=floor, method=basset.Collocation(rtol=r))
        for r in (1e-5, 1e-9)
    )
    assert len(tight.t_events[0]) > 3
    assert np.abs(loose.t_events[0][:4] - tight.t_events[0][:4]).max() < 5e-5


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"VaryingSlipKernel needs method=Collocation"):
        basset.solve(rate, (0.0, 1.0), [1.0], kernel=KERNEL, method=basset.FixedStep(0.1))
    past = basset.VaryingSlipKernel(1.0, 0.02, (1e-9, 1.0), slip_at="tau")
    with pytest.raises(ValueError, match=r'slip_at="t"'):
        basset.solve(rate, (0.0, 1.0), [1.0], kernel=past)
