"""A turbulent stream: published statistics come out, tracers stay mixed, and grains feel a smooth stream that is a function of seed, grain and clock."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scene_cases import flown, scene

import saltation
from basset._compile import placed
from saltation.effects import turbulence
from saltation.effects.base import Setting
from saltation.effects.turbulence import BEGINS, OWN, SLOT, SLOTS, Eddies, Options, fluctuation, motion, profiles_of
from saltation.flight import equations, layout
from saltation.flight.layout import Model
from saltation.flight.setup import Engine, Grain, empty_record
from saltation.flow import Still, tabulated
from saltation.grain import numbers_of

SMOOTH = numbers_of(1000.0, 1e-6, 2650.0, 1e-3, shear_velocity=0.01)  # Re* = 10
SETTING = Setting(SMOOTH, None, depth=18.6, roughness=0.01, seed=3)  # Re_τ = 186
# del Álamo & Jiménez (2003), Phys. Fluids 15, L41, as published: z⁺, σ_u, σ_w, σ_v, −⟨u'w'⟩ in u*, Re_τ = 186
DNS = np.array([
    [16.609, 2.6391, 0.50108, 1.00079, 0.60743], [24.964, 2.3930, 0.67492, 1.07305, 0.71722], [42.297, 1.8955, 0.82941, 1.08622, 0.71252],
    [63.477, 1.5560, 0.84304, 1.03059, 0.61997], [93.169, 1.2913, 0.77446, 0.90649, 0.47118], [120.700, 1.1024, 0.69917, 0.78283, 0.33001],
    [149.985, 0.91518, 0.63671, 0.66910, 0.18022], [168.073, 0.82536, 0.61398, 0.62363, 0.09009],
])  # fmt: skip
TURBULENT = {"effects": ["weight", "drag", "turbulence"], "channel": {"depth": 0.069}, "history": None, "run": {"jumps": 2, "discard": 0}}


RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def first_jumps(name, rtol):
    """Rise, length and duration of the first jump of 200 grains, with all effects, in water 100 d deep."""
    depth = 100.0 * scene(name).grain.diameter
    made = scene(name, channel={"depth": depth}, solver={"rtol": rtol}, run={"jumps": 1, "discard": 0, "trajectory": False})
    engine = Engine(made.changed(effects=[*made.names, "turbulence"]))
    record, jumps = empty_record(1, engine.tables.count, engine.states), np.zeros((200, len(layout.COLUMNS)))
    for i in range(len(jumps)):
        assert Grain(engine, i).fly(record, False, jumps[i : i + 1])[0] == layout.JUMPS
    return jumps[:, [layout.COLUMNS.index(column) for column in ("rise", "length", "duration")]]


def own_of(grain=0):
    """Room for the eddies of a grain."""
    own = np.zeros(OWN + SLOTS * SLOT)
    own[3], own[OWN - 1] = 3.0, grain
    return own


def tracer(options=None):
    """Eddies as a particle of the fluid sees them."""
    return turbulence.build(options or Options(), SETTING)._replace(lag=0.0, inertia=1.0)


class TestStatistics:
    def test_intensities_and_stress_of_a_channel(self):
        """Within 25 % of direct simulation from z⁺ = 15 on; at and below the bed level nothing moves, whatever the roughness."""
        found = profiles_of(Options(), SETTING, DNS[:, 0] / 10.0)
        stress = found.correlation * found.along * found.up
        for computed, published in zip((found.along, found.up, found.across, stress), DNS.T[1:], strict=True):
            assert np.abs(computed / published - 1.0).max() < 0.25
        low = 1e-6 * np.arange(1.0, 3.0)
        for roughness in (0.01, 1.0, 30.0):
            near = profiles_of(Options(), SETTING._replace(roughness=roughness), low)
            for rms in near[:3]:
                assert rms[0] < 1e-4 and rms[1] == pytest.approx(2.0 * rms[0], rel=1e-3)
        for z in (0.0, -0.5):
            assert fluctuation(tracer(), z, 5.0, 0.1, own_of()) == (0.0, 0.0, 0.0)

    def test_time_scales(self):
        """By the diffusivity κ z (1 − ζ), Rouse's, above the damped layer; each law as written; none below its floor."""
        deep = SETTING._replace(depth=1e4)
        z = np.array([200.0, 1000.0, 5000.0])
        found = profiles_of(Options(), deep, z)
        assert found.up**2 * found.time == pytest.approx(0.41 * z * (1.0 - z / 1e4), rel=0.02)
        hanna = profiles_of(Options(time_scale="hanna"), deep, z).time
        assert hanna == pytest.approx(0.5 * z / (1.27 * np.exp(-z / 1e4)), rel=1e-3)
        epsilon = 9.8 * (z / 1e4) ** -0.5 * np.exp(-3.0 * z / 1e4) / 1e4
        dissipation = profiles_of(Options(time_scale="dissipation", c0=5.0), deep, z).time
        assert dissipation == pytest.approx(2.0 * (1.27 * np.exp(-z / 1e4)) ** 2 / (5.0 * epsilon), rel=1e-3)
        for law in ("diffusivity", "hanna", "dissipation"):
            assert profiles_of(Options(time_scale=law), SETTING, np.array([1e-6])).time == pytest.approx(1.0, rel=1e-3)  # 10 ν/u*²

    @pytest.mark.parametrize("kappa, most", [(0.41, 0.6), (0.999, 0.97)])
    def test_no_shear_stress_beyond_what_the_intensities_allow(self, kappa, most):
        """|r| stays below 1, over smooth beds and rough ones, from the bed to above the surface, for all options that a scene may have."""
        for reynolds in 10.0 ** np.arange(-1.0, 6.0):
            numbers = numbers_of(1000.0, 1e-6, 2650.0, 1e-3, shear_velocity=1e-3 * reynolds)
            for depth in (5.0, 10.0, 100.0, 1e4):
                for roughness in (0.01, 1.0, 100.0):
                    setting = Setting(numbers, None, depth, roughness, kappa)
                    z = np.geomspace(turbulence.LOWEST, 2.0 * depth, 100)
                    for damping, rough_damping in ((1.0, 0.0), (26.0, 0.1), (30.0, 0.0), (30.0, 0.1), (30.0, 10.0)):
                        r = profiles_of(Options(damping=damping, rough_damping=rough_damping), setting, z).correlation
                        assert np.abs(r).max() < most

    def test_the_table_is_the_profiles(self):
        z = np.array([0.011, 0.3, 1.7, 6.0, 17.0])
        found = profiles_of(Options(), SETTING, z)
        for k, height in enumerate(z):
            here = turbulence.local(tracer(), float(height))
            assert math.hypot(here.tied, here.free) == pytest.approx(found.along[k], rel=1e-6)
            assert (here.across, here.up, here.rate**-0.5) == pytest.approx((found.across[k], found.up[k], found.time[k]), rel=1e-6)
            above, below = profiles_of(Options(), SETTING, height * (1.0 + np.array([1e-5, -1e-5]))).up
            assert here.up_slope == pytest.approx((above - below) / (2e-5 * height), rel=1e-4, abs=1e-6)

    def test_splines(self):
        """Variance 1 and integral scale 1; the oscillator of the drift has its integral and its first moment."""
        x = np.linspace(0.0, 1.0, 4001)
        basis = np.polynomial.polynomial.polyval(x, turbulence.pieces(turbulence.SPLINE))
        assert basis.sum(axis=0) == pytest.approx(1.0, rel=1e-12)
        assert (basis**2).sum(axis=0) / turbulence.VARIANCE == pytest.approx(1.0, rel=0.01)  # how far it is from stationary
        assert np.trapezoid((basis**2).sum(axis=0), x) == pytest.approx(turbulence.VARIANCE, rel=1e-6)
        tau = np.linspace(0.0, 40.0, 400001)
        a = turbulence.DAMPING
        b = math.sqrt(2.0 * a - a * a)
        memory = np.exp(-a * tau) * (np.cos(b * tau) + a / b * np.sin(b * tau))
        assert np.trapezoid(memory, tau) == pytest.approx(1.0, rel=1e-6)
        assert np.trapezoid(tau * memory, tau) == pytest.approx(turbulence.FIRST, rel=1e-5)

    def test_moments_and_autocorrelation(self):
        """Of one grain's eddies over 1e5 of their time scales, at one height: variances, −⟨u'w'⟩, T_L, and how far a tracer of constant w' spreads."""
        z, step, count = 3.0, 0.2, 500_000
        model = Model(None, tabulated(Still(0.0)), (0.0, 0.0, 0.0), 2, 0, tracer())
        states = np.zeros((count, 7))
        states[:, 1], states[:, 4] = z, BEGINS + step * np.arange(count)
        out = np.zeros((count, 9))
        equations.beside(placed(model), states, own_of(), out)
        u, v, w = out[:, :3].T
        found = profiles_of(Options(), SETTING, np.array([z]))
        error = 4.0 * math.sqrt(2.0 / (step * count))  # of a variance, from its integral scale, four standard errors
        for component, rms in zip((u, v, w), found[:3], strict=True):
            assert abs(component.mean()) < 4.0 * rms * math.sqrt(2.0 / (step * count))
            assert component.var() == pytest.approx(rms**2, rel=error)
        assert -(u * w).mean() / (found.correlation * found.along * found.up) == pytest.approx(1.0, abs=2.0 * error)
        lags = np.arange(26)
        correlation = np.array([(w[: count - 26] * w[lag : count - 26 + lag]).mean() for lag in lags]) / w.var()
        assert step * (correlation.sum() - 0.5) == pytest.approx(1.0, abs=0.03)  # T_L
        path = np.cumsum(w) * step  # in T_L
        for lag in (25, 100):  # Taylor's 2σ² T_L [t − T_L (1 − e^(−t/T_L))], the intercept being that of the splines' correlation
            spread = ((path[lag::25] - path[:-lag:25]) ** 2).mean() / found.up[0] ** 2
            assert spread == pytest.approx(2.0 * (lag * step - turbulence.FIRST), rel=0.05)

    def test_tracers_stay_mixed(self):
        """Uniform over the depth after 10 time scales of its middle, at the bed as well; nothing crosses bed or surface."""
        count, depth = 2000, SETTING.depth
        rng = np.random.default_rng(1)
        states = np.zeros((count, 4))
        states[:, 0], states[:, 1] = depth * rng.random(count), BEGINS
        turbulence.tracers(placed(tracer()), states, 30.0, 0.1, np.zeros((6, OWN + SLOTS * SLOT)))
        edges = np.array([0.0, 0.03, 0.06, 0.1, 0.15, *np.linspace(0.2, 1.0, 9)])
        found, expected = np.histogram(states[:, 0] / depth, edges)[0], count * np.diff(edges)
        assert found.sum() >= count - 1 and states[:, 0].min() > 0.0
        assert ((found - expected) ** 2 / expected).sum() < 34.5  # of 12 degrees of freedom: 1 in 2000


class TestMotion:
    def test_rates_along_a_path(self):
        """The rate of the fluctuation along a grain's path is its derivative; along the fluid's where the grain has no slip."""
        eddies, slip, own, h = turbulence.build(Options(), SETTING), (-2.0, 0.3, 0.4), own_of(7), 1e-5
        z, clock, drift, bend = 2.0, 4.3, 0.2, -0.1
        m = motion(eddies, z, clock, drift, bend, slip, 0.0, own)
        rise = slip[2] + m.velocity[2]
        ahead, behind = (fluctuation(eddies, z + t * rise, clock + t * m.clock, drift + t * m.drift, own) for t in (h, -h))
        assert (np.array(ahead) - behind) / (2.0 * h) == pytest.approx(np.array(m.rate), rel=1e-5, abs=1e-5)
        still = motion(eddies._replace(lag=0.0, inertia=1.0), z, clock, drift, bend, (0.0, 0.0, 0.0), 0.7, own)
        assert np.array(still.acceleration) - still.rate == pytest.approx([0.7 * still.velocity[2], 0.0, 0.0], abs=1e-12)

    def test_what_falls_through_eddies_sees_them_shortly(self):
        """Csanady's T_∥ for a slip upwards, T_⊥ across; β = 0 keeps them."""
        eddies, own = tracer(), own_of()
        found = profiles_of(Options(), SETTING, np.array([3.0]))
        scale, ratio = float(found.time[0]), 2.0 / float(found.eddy[0])
        for slip, factor in (((0.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 2.0), 1.0), ((2.0, 0.0, 0.0), 4.0), ((0.0, -2.0, 0.0), 4.0)):
            assert 1.0 / motion(eddies, 3.0, 2.0, 0.0, 0.0, slip, 0.0, own).clock == pytest.approx(scale / math.sqrt(1.0 + factor * ratio**2), rel=1e-6)
        kept = tracer(Options(crossing=0.0))
        assert motion(kept, 3.0, 2.0, 0.0, 0.0, (2.0, 2.0, 2.0), 0.0, own).clock == pytest.approx(1.0 / scale, rel=1e-6)

    def test_a_particle_of_the_fluid_keeps_no_slip(self):
        """As heavy as the fluid, with added mass: nothing accelerates it against a turbulent stream with shear."""
        changes = TURBULENT | {"effects": ["drag", "added_mass", "turbulence"], "bed": None, "run": {"jumps": None, "duration": 1.0}}
        channel = {"shear_velocity": 0.03, "transport_stage": None, "depth": 0.069}
        made = scene("sand", **changes | {"channel": channel, "grain": {"density": 1000.0}})
        engine = Engine(made)
        eddies: Eddies = engine.eddies._replace(lag=0.0)
        y, rates = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.3, 0.1, 0.05]), np.zeros(9)
        equations.rates_of(engine.equation._replace(eddies=eddies), 0.0, y, rates, own_of(2))
        beside = fluctuation(eddies, 2.0, 3.3, 0.1, own_of(2))
        assert rates[:3] == pytest.approx([made.profile.velocity_and_shear(2.0)[0] + beside[0], beside[1], beside[2]], rel=1e-9)
        assert np.abs(rates[3:6]).max() < 1e-9 * np.abs(rates[:3]).max()


class TestFlights:
    def test_no_amplitude_is_no_turbulence(self):
        """The bits of the scene without it."""
        plain, none = scene("sand", run={"jumps": 30, "discard": 0}), scene("sand", run={"jumps": 30, "discard": 0}, channel={"depth": 0.069})
        none = none.changed(effects=[*none.names, "turbulence"], turbulence={"amplitude": 0.0})
        assert flown(plain).jumps.equals(flown(none).jumps)

    @pytest.mark.parametrize("name", ["sand", "sand_coarse", "gravel"])
    def test_the_promise_of_rtol(self, name):
        """No first jump of 200 grains, each in its own eddies, is off by more."""
        exact = first_jumps(name, 1e-9)
        for rtol in RTOLS:
            error = np.abs(first_jumps(name, rtol) - exact) / np.maximum(exact, exact.mean(axis=0))
            assert 0.02 * rtol < error.max() <= rtol, rtol

    def test_the_same_stream_at_every_tolerance(self):
        """The first two jumps converge to those of the same eddies, within a few times the tolerance; the path holds what was seen."""
        results = {rtol: flown(scene("sand", **TURBULENT, solver={"rtol": rtol})) for rtol in (1e-3, 1e-5, 1e-7, 1e-9)}
        exact = results.pop(1e-9).jumps
        for rtol, result in results.items():
            for column in ("length", "duration"):
                assert result.jumps[column].to_numpy() == pytest.approx(exact[column].to_numpy(), rel=30.0 * rtol), (rtol, column)
        path = results[1e-7].trajectory
        time, z, w, eddy = (path[name].to_numpy() for name in ("time", "z", "w", "eddy_z"))
        assert np.abs(eddy).max() > 0.1
        inner = np.flatnonzero((np.diff(time)[1:] > 1e-3) & (np.diff(time)[:-1] > 1e-3) & (np.diff(time)[1:] < 0.05) & (np.diff(time)[:-1] < 0.05)) + 1
        h, k = time[inner] - time[inner - 1], time[inner + 1] - time[inner]
        slope = ((z[inner + 1] - z[inner]) * h / k + (z[inner] - z[inner - 1]) * k / h) / (h + k)
        assert len(inner) > 5 and np.median(np.abs(slope - w[inner])) < 5e-3  # dz/dt, w' among it

    def test_sentences(self):
        for changes, words in (
            ({"channel": {"depth": None}}, ("channel.depth is missing", "depth of the water")),
            ({"channel": {"depth": 1e-3}}, ("channel.depth must be", "5 d")),
            ({"channel": None}, ("[channel]",)),
            ({"turbulence": {"c0": 3.0}}, ("turbulence.c0", "dissipation")),
            ({"turbulence": {"damping": 100.0}}, ("turbulence.damping", "30")),
            ({"turbulence": {"amplitude": -1.0}}, ("turbulence.amplitude", "0 or greater")),
            ({"solver": {"method": "fixed_step", "dt": 1e-3}}, ("'turbulence'", "collocation")),
        ):
            content = saltation.scene.read("sand")
            content["effects"] = [*content["effects"], "turbulence"]
            content["channel"]["depth"] = 0.069
            for name, table in changes.items():
                if table is None:
                    content.pop(name)
                else:
                    content[name] = {**content.get(name, {}), **table}
            content["channel"] = {key: value for key, value in content["channel"].items() if value is not None} if "channel" in content else None
            with pytest.raises(saltation.SceneError) as caught:
                saltation.scene.scene_of({key: value for key, value in content.items() if value is not None})
            assert all(word in str(caught.value) for word in words) and "\n" not in str(caught.value), str(caught.value)
