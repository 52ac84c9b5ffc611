"""Rebounds against the thesis's appendices, corrected; the misprints shown to make energy; restitution."""

from __future__ import annotations

import math

import numpy as np
import pytest

import saltation
from basset._compile import compiled, digest_of
from saltation.bed.rebound import REBOUNDS, GarciaNino, Restitution, SlidingOnly, Tsuji, TsujiPrinted, restitution_at, strike
from saltation.effects.history import DECAYS
from saltation.grain import numbers_of

UP = (0.0, 0.0, 1.0)
NUMBER = Restitution(0.95, 0.0, 0.0)
LAWS = [Tsuji(NUMBER, 0.4, 1.0), GarciaNino(NUMBER, 0.89), SlidingOnly(NUMBER, 0.4), TsujiPrinted(NUMBER, 0.4)]


def impacts(count, seed, spin=1.0):
    """Downward velocities and spins: every component a standard normal number, spins times `spin`."""
    rng = np.random.default_rng(seed)
    u, o = rng.standard_normal((2, count, 3))
    u[:, 2] = -np.abs(u[:, 2])
    return list(zip(u.tolist(), (spin * o).tolist(), strict=True))


def energy(u, o):
    return 0.5 * sum(x * x for x in u) + 0.05 * sum(x * x for x in o)


def gains(law, cases):
    """Share of impacts that end with more energy, and the largest ratio of after to before."""
    ratios = []
    for u, o in cases:
        r = law.strike(UP, u, o)
        ratios.append(energy(r[:3], r[3:6]) / energy(u, o))
    return np.mean(np.array(ratios) > 1.0 + 1e-12), max(ratios)


def appendix(u, v, w, ox, oy, oz, e, f, a=0.5):
    """Appendix 3-B for a horizontal plane: the criterion (3B-1) with the contact slip, and the signs of the spin put right."""
    slip = math.hypot(u - a * oy, v + a * ox)
    if w * 7.0 * f * (1.0 + e) < -2.0 * slip:  # sticks
        x, y = 5.0 / 7.0 * (u + 2.0 * a / 5.0 * oy), 5.0 / 7.0 * (v - 2.0 * a / 5.0 * ox)
        return (x, y, -e * w, -y / a, x / a, oz), True
    along, aside = (u - a * oy) / slip, (v + a * ox) / slip
    push = f * (1.0 + e) * w
    return (u + along * push, v + aside * push, -e * w, ox + 2.5 / a * aside * push, oy - 2.5 / a * along * push, oz), False


class TestTsuji:
    def test_the_appendix_with_its_signs_right(self):
        """20 000 impacts with all e in (0, 1) and f in (0, 1); both branches met."""
        rng = np.random.default_rng(1)
        met, worst = [0, 0], 0.0
        for (u, o), e, f in zip(impacts(20000, 2, 2.0), rng.uniform(0.0, 1.0, 20000).tolist(), rng.uniform(0.0, 1.0, 20000).tolist(), strict=True):
            expected, sticks = appendix(*u, *o, e, f)
            met[sticks] += 1
            found = Tsuji(Restitution(e, 0.0, 0.0), f, 1.0).strike(UP, u, o)
            worst = max(worst, *(abs(a - b) for a, b in zip(found[:6], expected, strict=True)))
        assert worst < 1e-12
        assert min(met) > 4000

    def test_no_impact_gains_energy(self):
        for spin in (0.5, 1.0, 8.0):
            assert gains(LAWS[0], impacts(5000, 3, spin))[1] < 1.0 + 1e-14

    def test_the_wrong_sign_of_the_spin_would_show(self):
        """Sticking takes the slip out; with the printed signs it is left in: û − aω̂_y = 0 only in the corrected form."""
        u, o = (1.0, 0.5, -3.0), (0.4, -0.7, 0.2)
        r = Tsuji(NUMBER, 1.0, 1.0).strike(UP, u, o)
        assert (r[0] - 0.5 * r[4], r[1] + 0.5 * r[3]) == pytest.approx((0.0, 0.0), abs=1e-15)
        p = TsujiPrinted(NUMBER, 1.0).strike(UP, u, o)
        assert math.hypot(p[0] - 0.5 * p[4], p[1] + 0.5 * p[3]) > 1.0

    def test_tilted_planes(self):
        """The appendix in the axes of a plane that leans against the stream."""
        for tilt in (0.1, 0.4, -0.3):
            n, t = (-math.sin(tilt), 0.0, math.cos(tilt)), (math.cos(tilt), 0.0, math.sin(tilt))
            for u, o in impacts(200, 4):
                if not sum(a * b for a, b in zip(u, n, strict=True)) < 0.0:
                    continue
                own = [sum(a * b for a, b in zip(x, axis, strict=True)) for x in (u, o) for axis in (t, (0.0, 1.0, 0.0), n)]
                r, _ = appendix(*own, 0.95, 0.4)
                back = [r[k] * t[i] + r[k + 1] * (i == 1) + r[k + 2] * n[i] for k in (0, 3) for i in range(3)]
                assert LAWS[0].strike(n, u, o)[:6] == pytest.approx(back, abs=1e-13)


class TestMisprints:
    def test_without_the_sticking_limit_a_third_of_all_impacts_gain_energy(self):
        """e = 0.95, f = 0.4, velocities and spins (V, V/d) standard normal in every component, horizontal plane."""
        share, most = gains(SlidingOnly(NUMBER, 0.4), impacts(20000, 5))
        assert share == pytest.approx(0.35, abs=0.02)
        assert share > 0.1
        assert most > 1.5

    def test_sliding_only_is_the_law_wherever_the_grain_slides(self):
        agreed = 0
        for u, o in impacts(2000, 6):
            if not appendix(*u, *o, 0.95, 0.4)[1]:
                agreed += 1
                assert LAWS[2].strike(UP, u, o) == pytest.approx(LAWS[0].strike(UP, u, o), abs=1e-13)
        assert agreed > 500

    def test_tilted_planes(self):
        """Both misprints in the axes of the plane: one along the stream, one across, one along the normal."""
        rng = np.random.default_rng(12)
        for u, o in impacts(300, 13):
            n = rng.standard_normal(3)
            n /= np.linalg.norm(n)
            along = np.array([n[2], 0.0, -n[0]]) / math.hypot(n[0], n[2])
            axes = np.array([along, np.cross(n, along), n])
            for law in LAWS[2:]:
                own = np.reshape(law.strike(UP, axes @ u, axes @ o), (3, 3))
                assert np.allclose(np.reshape(law.strike(n, u, o), (3, 3)), own @ axes, atol=1e-12)

    def test_without_slip_there_is_no_friction(self):
        assert LAWS[2].strike(UP, (1.0, 0.0, -1.0), (0.0, 2.0, 0.0)) == pytest.approx((1.0, 0.0, 0.95, 0.0, 2.0, 0.0, 0.0, 0.0, 1.95), abs=1e-15)

    def test_the_printed_appendix_gains_energy(self):
        share, most = gains(TsujiPrinted(NUMBER, 0.4), impacts(20000, 7, 4.0))
        assert share > 0.1
        assert most > 1.1

    def test_the_printed_appendix_word_by_word(self):
        """(3B-1) to (3B-5) on a horizontal plane, as printed: velocity of the centre in the criterion, its own signs."""
        met = [0, 0]
        for u, o in impacts(2000, 8):
            speed, a, e, f = math.sqrt(sum(x * x for x in u)), 0.5, 0.95, 0.4
            sticks = u[2] / speed < -2.0 / (7.0 * f * (e + 1.0))
            met[sticks] += 1
            if sticks:
                x, y = 5.0 / 7.0 * (u[0] - 2.0 * a / 5.0 * o[1]), 5.0 / 7.0 * (u[1] - 2.0 * a / 5.0 * o[0])
                expected = (x, y, -e * u[2], u[1] / a, -u[0] / a, o[2])
            else:
                one, two = (u[0] + a * o[1]) / speed, (u[1] + a * o[0]) / speed
                push = f * (e + 1.0) * u[2]
                expected = (u[0] + one * push, u[1] + two * push, -e * u[2], o[0] - 2.5 / a * two * push, o[1] + 2.5 / a * one * push, o[2])
            assert LAWS[3].strike(UP, u, o)[:6] == pytest.approx(expected, abs=1e-13)
        assert min(met) > 200

    def test_the_printed_appendix_knows_which_way_x_points(self):
        """A quarter turn about the normal turns the rebound of every other law with it."""
        u, o = (1.0, 0.3, -0.4), (0.5, 2.0, 0.1)
        for law in LAWS:
            here, there = law.strike(UP, u, o), law.strike(UP, (-u[1], u[0], u[2]), (-o[1], o[0], o[2]))
            back = (there[1], -there[0], there[2], there[4], -there[3], there[5])
            assert (back == pytest.approx(here[:6], abs=1e-14)) is (type(law) is not TsujiPrinted)

    def test_frictionless(self):
        """No division by f."""
        for law in (Tsuji(NUMBER, 0.0, 1.0), SlidingOnly(NUMBER, 0.0), TsujiPrinted(NUMBER, 0.0)):
            assert law.strike(UP, (2.0, 1.0, -1.0), (1.0, 2.0, 3.0))[:6] == pytest.approx((2.0, 1.0, 0.95, 1.0, 2.0, 3.0), abs=1e-15)


class TestGarciaNino:
    @pytest.mark.parametrize("e", [0.0, 0.65, 1.0])
    def test_the_appendix_in_the_plane(self, e):
        """(3A-2): tan θ_r = (e/f) tan(θ_in + θ_b); (3A-3), (3A-4): the velocity after, in the channel's axes."""
        f = 0.89
        for incidence in np.radians([2.0, 17.0, 45.0, 80.0]):
            for tilt in np.radians([0.0, 5.0, 30.0]):
                if incidence + tilt > math.radians(89.0):
                    continue
                u, w = 3.0 * math.cos(incidence), -3.0 * math.sin(incidence)
                n = (-math.sin(tilt), 0.0, math.cos(tilt))
                r = GarciaNino(Restitution(e, 0.0, 0.0), f).strike(n, (u, 0.0, w), (1.0, 2.0, 3.0))
                rebound = math.atan2(r[2] * math.cos(tilt) - r[0] * math.sin(tilt), r[0] * math.cos(tilt) + r[2] * math.sin(tilt))
                assert math.tan(rebound) == pytest.approx(e / f * math.tan(incidence + tilt), rel=1e-12, abs=1e-14)
                size = f * math.hypot(u, w) * math.cos(incidence + tilt) / math.cos(rebound)
                assert r[0] == pytest.approx(size * math.cos(rebound + tilt), abs=1e-13)
                assert r[2] == pytest.approx(size * math.sin(rebound + tilt), abs=1e-13)
                assert r[1] == 0.0
                assert r[3:6] == (1.0, 2.0, 3.0)

    def test_in_space(self):
        """The normal part times −e, the tangential part times f, whatever the plane; the impulse is the change of momentum."""
        rng = np.random.default_rng(9)
        for u, o in impacts(300, 10):
            n = rng.standard_normal(3)
            n /= np.linalg.norm(n)
            r = LAWS[1].strike(n.tolist(), u, o)
            normal, after = n @ u, np.array(r[:3])
            assert n @ after == pytest.approx(-0.95 * normal, abs=1e-14)
            assert np.allclose(after - (n @ after) * n, 0.89 * (u - normal * n), atol=1e-14)
            assert r[3:6] == tuple(o)
            assert np.allclose(r[6:], after - u, atol=1e-14)

    def test_its_f_is_what_is_kept(self):
        """Retention 1 is a frictionless bed and 0 takes the whole tangential velocity: the reverse of Coulomb's f."""
        u = (3.0, 0.0, -1.0)
        assert GarciaNino(NUMBER, 1.0).strike(UP, u, UP)[0] == 3.0 == Tsuji(NUMBER, 0.0, 1.0).strike(UP, u, UP)[0]
        assert GarciaNino(NUMBER, 0.0).strike(UP, u, UP)[0] == 0.0


class TestRestitution:
    def test_a_number(self):
        assert [Restitution(0.65, 0.0, 5.0).at(speed) for speed in (1e-9, 1.0, 50.0)] == [0.65] * 3
        assert restitution_at(Restitution(0.65, 0.0, 0.0), 2.0) == 0.65

    def test_by_the_collision_stokes_number(self):
        """e = 0.97 exp(−35/St), St = ρ_s d V_n/(9μ): 0.3 at St 30, as good as dry at 2000."""
        numbers = numbers_of(1000.0, 1e-6, 2650.0, 0.69e-3, transport_stage=1.87)
        law = Restitution(0.97, 35.0, numbers.stokes(1.0))
        for speed in (0.3, 2.0, 700.0):
            collision = 2650.0 * 0.69e-3 * speed * numbers.velocity / (9.0 * 1000.0 * 1e-6)
            assert law.at(speed) == pytest.approx(0.97 * math.exp(-35.0 / collision), rel=1e-12)
        assert law.at(30.0 / law.stokes) == pytest.approx(0.97 * math.exp(-35.0 / 30.0), rel=1e-12)
        speeds = np.geomspace(1e-3, 1e6, 200)
        values = [law.at(speed) for speed in speeds]
        assert np.all(np.diff(values) >= 0.0)
        assert values[0] == pytest.approx(0.0, abs=1e-300)
        assert values[-1] == pytest.approx(0.97, rel=1e-4)

    def test_nothing_comes_back_where_nothing_closes(self):
        """A grain that moves off, at any small speed: no division by it, no overflow."""
        law = Restitution(0.97, 35.0, 10.0)
        assert [law.at(speed) for speed in (0.0, -1e-9, -3.0, 1e-300)] == [0.0] * 4
        assert Tsuji(law, 0.4, 1.0).strike(UP, (1.0, 0.0, 1e-9), UP) == (1.0, 0.0, 1e-9, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    def test_a_rebound_uses_the_normal_speed(self):
        law = Restitution(0.97, 35.0, 10.0)
        n = (-0.6, 0.0, 0.8)
        for rebound in (Tsuji(law, 0.4, 1.0), GarciaNino(law, 0.9), SlidingOnly(law, 0.4), TsujiPrinted(law, 0.4)):
            r = rebound.strike(n, (5.0, 2.0, -3.0), (0.0, 0.0, 0.0))
            closing = 0.6 * 5.0 + 0.8 * 3.0
            assert 0.8 * r[2] - 0.6 * r[0] == pytest.approx(law.at(closing) * closing, rel=1e-13)


def test_compiled_and_plain_rebounds_agree():
    sources = digest_of("saltation")

    @compiled()
    def struck(law, n, u, o):
        sources  # part of the cache key
        return strike(law, n, u, o)

    for law in (*LAWS, Tsuji(Restitution(0.97, 35.0, 10.0), 0.4, 1.19)):
        for u, o in impacts(20, 11):
            n = (-0.28, 0.0, 0.96)
            assert struck(law, n, tuple(u), tuple(o)) == pytest.approx(law.strike(n, u, o), abs=1e-14)
            assert strike(law, n, u, o) == law.strike(n, u, o)


def test_the_registry():
    assert list(REBOUNDS) == ["tsuji", "garcia_nino", "tsuji_printed", "sliding_only"]


@pytest.mark.parametrize("decay", [None, 0.0, 35.0])
def test_restitution_by_stokes_number_takes_the_decay_of_the_scene(decay):
    """Impulse over momentum of the first contact of a falling sphere is 1 + e."""
    bed = {"roughness": "flat", "friction": 0.0, "restitution": "stokes"} | ({} if decay is None else {"stokes_decay": decay})
    made = saltation.run(
        saltation.Scene.model_validate(
            {
                "effects": ["weight", "drag", "added_mass", "history"], "grain": {"diameter": 2e-3}, "fluid": {"viscosity": 2e-6}, "bed": bed,
                "start": {"velocity": [0.0, 0.0, 0.0], "height": 0.02}, "run": {"jumps": 2}, "solver": {"rtol": 1e-9},
            }
        )
    )  # fmt: skip
    first = made.jumps.iloc[0]
    e = -first["impulse_z"] / first["impact_z"] - 1.0
    assert first["stokes"] > 20.0
    assert e == pytest.approx(0.97 * math.exp(-(DECAYS["impulse"]["basset"] if decay is None else decay) / first["stokes"]), rel=1e-12)


def test_the_decay_belongs_to_the_treatment_of_the_history_unless_it_is_given():
    base = saltation.load("sand").changed(bed={"restitution": "stokes"})
    for rebound, kernels in DECAYS.items():
        for kernel, k in kernels.items():
            assert base.changed(history={"rebound": rebound, "kernel": kernel}).stokes_decay == k
    assert DECAYS["impulse"]["basset"] < DECAYS["impulse"]["mei_adrian"] < DECAYS["restart"]["basset"] < DECAYS["reset"]["basset"] < 35.0
    assert base.changed(effects=[name for name in base.names if name != "history"]).stokes_decay == 35.0
    assert base.changed(bed={"stokes_decay": 20.0}, history={"rebound": "reset"}).stokes_decay == 20.0
