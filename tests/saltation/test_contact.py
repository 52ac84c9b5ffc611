"""The contact law against mechanics: momentum, angular momentum, energy, restitution, Coulomb's limit, sticking, symmetry, closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from saltation.bed.contact import cross, impulse, strike_bed, strike_pair

pytestmark = pytest.mark.analytic

UP = (0.0, 0.0, 1.0)


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def rotation(rng):
    """A rotation, evenly among all."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0.0 else -q


def directions(rng, count):
    n = rng.standard_normal((count, 3))
    return (n / np.linalg.norm(n, axis=1)[:, None]).tolist()


def bed_impacts(count, seed):
    """(n, u, ω, e, f, effective over dry mass), all directions, closing or not."""
    rng = np.random.default_rng(seed)
    u, o = rng.standard_normal((2, count, 3))
    e, f, added = rng.uniform(0.0, 1.0, count), rng.uniform(0.0, 2.0, count), rng.uniform(1.0, 1.5, count)
    return zip(directions(rng, count), u.tolist(), (2.0 * o).tolist(), e.tolist(), f.tolist(), added.tolist(), strict=True)


def pair_impacts(count, seed):
    """(n, velocities, spins, radii, masses, e, f): radii over a decade, masses over three and not as radii cubed."""
    rng = np.random.default_rng(seed)
    v, s = rng.standard_normal((2, count, 2, 3))
    radii, masses = 0.5 * 10.0 ** rng.uniform(-0.5, 0.5, (count, 2)), 10.0 ** rng.uniform(-1.5, 1.5, (count, 2))
    e, f = rng.uniform(0.0, 1.0, count), rng.uniform(0.0, 2.0, count)
    parts = (directions(rng, count), v.tolist(), (2.0 * s).tolist(), radii.tolist(), masses.tolist(), e.tolist(), f.tolist())
    return zip(*parts, strict=True)


def bed_slip(n, u, o):
    """Velocity of the grain's surface at the contact, half a diameter below its centre along n."""
    w = cross(*o, -0.5 * n[0], -0.5 * n[1], -0.5 * n[2])
    return [u[i] + w[i] for i in range(3)]


def pair_slip(n, v, s, radii):
    """Velocity of the first surface over the second: their contact points are a_1 n from the one and −a_2 n from the other centre."""
    one = cross(*s[0], *(radii[0] * x for x in n))
    two = cross(*s[1], *(-radii[1] * x for x in n))
    return [v[0][i] + one[i] - v[1][i] - two[i] for i in range(3)]


def energy(mass, inertia, u, o):
    return 0.5 * mass * dot(u, u) + 0.5 * inertia * dot(o, o)


def across(n, v):
    normal = dot(n, v)
    return [v[i] - normal * n[i] for i in range(3)]


class TestConservation:
    def test_the_impulse_on_the_grain_is_what_its_momentum_and_spin_changed_by(self):
        for n, u, o, e, f, added in bed_impacts(5000, 1):
            r = strike_bed(*n, *u, *o, e, f, added)
            arm = [-0.5 * x for x in n]
            turn = cross(*arm, *r[6:])
            for i in range(3):
                assert added * (r[i] - u[i]) == pytest.approx(r[6 + i], abs=1e-14)
                assert 0.1 * (r[3 + i] - o[i]) == pytest.approx(turn[i], abs=1e-14)  # I = m d²/10

    def test_pair_momentum_and_angular_momentum_about_any_point(self):
        places = np.random.default_rng(2).standard_normal((20000, 3)).tolist()
        struck = 0
        for (n, v, s, radii, masses, e, f), at in zip(pair_impacts(20000, 3), places, strict=True):
            first, second, spin, other, j = strike_pair(*n, *v, *s, radii, masses, e, f)
            struck += any(j)
            centres = at, [at[i] + (radii[0] + radii[1]) * n[i] for i in range(3)]
            before, after = [], []
            for total, us, os in ((before, v, s), (after, (first, second), (spin, other))):
                linear = [masses[0] * us[0][i] + masses[1] * us[1][i] for i in range(3)]
                arms = [cross(*centres[k], *(masses[k] * x for x in us[k])) for k in (0, 1)]
                inertia = [0.4 * masses[k] * radii[k] ** 2 for k in (0, 1)]
                total += [*linear, *(arms[0][i] + arms[1][i] + inertia[0] * os[0][i] + inertia[1] * os[1][i] for i in range(3))]
            size = 1.0 + masses[0] + masses[1]
            assert max(abs(a - b) for a, b in zip(before, after, strict=True)) < 2e-13 * size * (radii[0] + radii[1] + 3.0)
            for i in range(3):
                assert masses[0] * (first[i] - v[0][i]) == pytest.approx(j[i], abs=1e-13 * size)
                assert masses[1] * (second[i] - v[1][i]) == pytest.approx(-j[i], abs=1e-13 * size)
        assert 0.3 < struck / 20000 < 0.7

    def test_energy_never_grows_on_the_bed(self):
        """Dry and immersed: the translational energy is that of the effective mass, the spin's that of the dry sphere."""
        worst = 0.0
        for k, (n, u, o, e, f, added) in enumerate(bed_impacts(50000, 4)):
            mass = added if k % 2 else 1.0
            r = strike_bed(*n, *u, *o, e, f, mass)
            before = energy(mass, 0.1, u, o)
            worst = max(worst, energy(mass, 0.1, r[:3], r[3:6]) / before - 1.0)
        assert worst < 2e-15

    def test_the_energy_lost_is_what_normal_and_tangential_impulse_take(self):
        """½ m_e (1 − e²)(V·n)² + J_t |V_t| − J_t²/(2 m_t)."""
        for n, v, s, radii, masses, e, f in pair_impacts(5000, 6):
            first, second, spin, other, j = strike_pair(*n, *v, *s, radii, masses, e, f)
            inertia = [0.4 * masses[k] * radii[k] ** 2 for k in (0, 1)]
            before = energy(masses[0], inertia[0], v[0], s[0]) + energy(masses[1], inertia[1], v[1], s[1])
            after = energy(masses[0], inertia[0], first, spin) + energy(masses[1], inertia[1], second, other)
            slip = pair_slip(n, v, s, radii)
            closing, reduced = max(0.0, dot(slip, n)), 1.0 / (1.0 / masses[0] + 1.0 / masses[1])
            tangent = across(n, j)
            push, sliding = math.sqrt(dot(tangent, tangent)), math.sqrt(dot(across(n, slip), across(n, slip)))
            lost = 0.5 * reduced * (1.0 - e * e) * closing**2 + push * sliding - push**2 / (2.0 * 2.0 / 7.0 * reduced)
            assert before - after == pytest.approx(lost, abs=1e-13 * (before + 1.0))

    def test_elastic_and_frictionless_keeps_the_energy_and_the_spin(self):
        for n, u, o, *_ in bed_impacts(500, 7):
            r = strike_bed(*n, *u, *o, 1.0, 0.0, 1.0)
            assert np.allclose(r[3:6], o, rtol=0.0, atol=1e-14)
            assert dot(r[:3], r[:3]) == pytest.approx(dot(u, u), rel=1e-14)


class TestTheLaw:
    def test_the_normal_slip_comes_back_times_e(self):
        """Between the surfaces' normal velocities: exact, whatever spin and friction do."""
        for n, u, o, e, f, added in bed_impacts(5000, 8):
            closing = -dot(u, n)
            if closing > 0.0:
                assert dot(strike_bed(*n, *u, *o, e, f, added)[:3], n) == pytest.approx(e * closing, abs=2e-15)
        for n, v, s, radii, masses, e, f in pair_impacts(5000, 9):
            closing = dot(v[0], n) - dot(v[1], n)
            if closing > 0.0:
                first, second, *_ = strike_pair(*n, *v, *s, radii, masses, e, f)
                assert dot(second, n) - dot(first, n) == pytest.approx(e * closing, abs=2e-14)

    def test_bed_sticks_or_slides(self):
        """Sticking: no slip is left, and the impulse lies inside the friction cone. Sliding: on the cone, against the slip, less than what would stop it."""
        met = {True: 0, False: 0}
        for n, u, o, e, f, added in bed_impacts(20000, 10):
            if not dot(u, n) < 0.0:
                continue
            r = strike_bed(*n, *u, *o, e, f, added)
            before, after = across(n, bed_slip(n, u, o)), across(n, bed_slip(n, r[:3], r[3:6]))
            push, tangent = dot(r[6:], n), across(n, r[6:])
            drag, sliding = math.hypot(*tangent), math.hypot(*before)
            assert dot(tangent, before) == pytest.approx(-drag * sliding, rel=1e-12, abs=1e-14)
            stuck = math.hypot(*after) < 1e-13
            met[stuck] += 1
            if stuck:
                assert drag <= f * push * (1.0 + 1e-12)
            else:
                assert drag == pytest.approx(f * push, rel=1e-12)
                assert dot(after, before) > 0.0
        assert min(met.values()) > 2000

    def test_pair_sticks_or_slides(self):
        met = {True: 0, False: 0}
        for n, v, s, radii, masses, e, f in pair_impacts(20000, 11):
            slip = pair_slip(n, v, s, radii)
            if not dot(slip, n) > 0.0:
                continue
            first, second, spin, other, j = strike_pair(*n, *v, *s, radii, masses, e, f)
            before, after = across(n, slip), across(n, pair_slip(n, (first, second), (spin, other), radii))
            push, drag = -dot(j, n), math.hypot(*across(n, j))
            stuck = math.hypot(*after) < 1e-12 * (1.0 + math.hypot(*before))
            met[stuck] += 1
            if stuck:
                assert drag <= f * push * (1.0 + 1e-11)
            else:
                assert drag == pytest.approx(f * push, rel=1e-11)
                assert dot(after, before) > 0.0
                assert dot(across(n, j), before) == pytest.approx(-drag * math.hypot(*before), rel=1e-11)
        assert min(met.values()) > 2000

    def test_the_step_from_sticking_to_sliding_is_continuous(self):
        """With w = −1, e = 0.5 and slip S the limit is f = (2/7) S/1.5."""
        limit = 2.0 / 7.0 * 3.0 / 1.5
        below = strike_bed(*UP, 3.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.5, limit * (1.0 - 1e-9), 1.0)
        above = strike_bed(*UP, 3.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.5, limit * (1.0 + 1e-9), 1.0)
        assert np.allclose(below, above, atol=1e-8)
        assert below[0] > above[0] == pytest.approx(15.0 / 7.0, rel=1e-14)
        assert above == strike_bed(*UP, 3.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.5, 2.0, 1.0)

    def test_what_separates_or_only_grazes_is_left_alone(self):
        for n, u, o, e, f, added in bed_impacts(3000, 12):
            if dot(u, n) >= 1e-12:
                assert strike_bed(*n, *u, *o, e, f, added) == (*u, *o, 0.0, 0.0, 0.0)
        for n, v, s, radii, masses, e, f in pair_impacts(3000, 13):
            if dot(v[0], n) <= dot(v[1], n) - 1e-12:
                assert strike_pair(*n, *v, *s, radii, masses, e, f) == (*map(tuple, (*v, *s)), (0.0, 0.0, 0.0))
        assert strike_bed(*UP, 4.0, -1.0, 0.0, 3.0, 2.0, 1.0, 0.7, 0.4, 1.0) == (4.0, -1.0, 0.0, 3.0, 2.0, 1.0, 0.0, 0.0, 0.0)
        assert impulse(*UP, 1.0, 0.0, math.nan, 0.5, 0.5, 1.0, 1.0) == (0.0, 0.0, 0.0)

    def test_nearly_grazing_is_a_small_impulse(self):
        r = strike_bed(*UP, 4.0, -1.0, -1e-9, 3.0, 2.0, 1.0, 0.7, 0.4, 1.0)
        assert math.hypot(*r[6:]) == pytest.approx(1.7e-9 * math.hypot(1.0, 0.4), rel=1e-6)


class TestSymmetry:
    def test_the_bed_has_no_preferred_direction(self):
        rng = np.random.default_rng(14)
        for n, u, o, e, f, added in bed_impacts(2000, 15):
            q = rotation(rng)
            turned = strike_bed(*(q @ n).tolist(), *(q @ u).tolist(), *(q @ o).tolist(), e, f, added)
            here = np.array(strike_bed(*n, *u, *o, e, f, added)).reshape(3, 3)
            assert np.allclose(np.reshape(turned, (3, 3)), here @ q.T, atol=1e-13)

    def test_pairs_have_no_preferred_frame(self):
        """Rotated and carried along by a constant velocity."""
        rng = np.random.default_rng(16)
        for n, v, s, radii, masses, e, f in pair_impacts(2000, 17):
            q, wind = rotation(rng), rng.standard_normal(3)
            moved, spun = (np.array(v) @ q.T + wind).tolist(), (np.array(s) @ q.T).tolist()
            there = strike_pair(*(q @ n).tolist(), *moved, *spun, radii, masses, e, f)
            here = np.array(strike_pair(*n, *v, *s, radii, masses, e, f)) @ q.T
            here[:2] += wind
            assert np.allclose(there, here, rtol=1e-11, atol=1e-12 * (1.0 + np.abs(here).max()))

    def test_mirrored(self):
        """Velocities mirror as vectors, spins as pseudovectors."""
        for n, u, o, e, f, added in bed_impacts(500, 18):
            here = strike_bed(*n, *u, *o, e, f, added)
            there = strike_bed(n[0], -n[1], n[2], u[0], -u[1], u[2], -o[0], o[1], -o[2], e, f, added)
            assert np.allclose(there, np.array(here) * [1, -1, 1, -1, 1, -1, 1, -1, 1], atol=1e-14)

    def test_either_grain_may_be_the_first(self):
        for n, v, s, radii, masses, e, f in pair_impacts(2000, 19):
            first, second, spin, other, j = strike_pair(*n, *v, *s, radii, masses, e, f)
            swapped = strike_pair(*(-x for x in n), v[1], v[0], s[1], s[0], radii[::-1], masses[::-1], e, f)
            scale = 1.0 + abs(np.array([first, second, spin, other])).max()
            assert np.allclose(swapped[:4], (second, first, other, spin), atol=1e-13 * scale)
            assert np.allclose(swapped[4], np.negative(j), atol=1e-13 * (1.0 + max(masses)))

    def test_a_grain_of_infinite_mass_at_rest_is_the_bed(self):
        rest = (0.0, 0.0, 0.0)
        for n, u, o, e, f, _ in bed_impacts(2000, 20):
            bed = strike_bed(*n, *u, *o, e, f, 1.0)
            first, second, spin, other, j = strike_pair(*(-x for x in n), u, rest, o, rest, (0.5, 3.0), (1.0, 1e18), e, f)
            assert np.allclose((*first, *spin, *j), bed, atol=1e-14)
            assert max(map(abs, (*second, *other))) < 1e-16


class TestClosedForms:
    def test_head_on_equal_grains(self):
        """Elastic ones exchange their velocities; with e they part at e times the closing speed, centre of mass as before."""
        still = (0.0, 0.0, 0.0)
        first, second, *_ = strike_pair(1.0, 0.0, 0.0, (3.0, 0.0, 0.0), (-1.0, 0.0, 0.0), still, still, (0.5, 0.5), (1.0, 1.0), 1.0, 0.7)
        assert (first, second) == ((-1.0, 0.0, 0.0), (3.0, 0.0, 0.0))
        first, second, *_ = strike_pair(1.0, 0.0, 0.0, (3.0, 0.0, 0.0), (-1.0, 0.0, 0.0), still, still, (0.5, 0.5), (1.0, 1.0), 0.25, 0.7)
        assert (first[0], second[0]) == (0.5, 1.5)

    def test_head_on_unequal_grains(self):
        """One dimension: u' = (m_1 u_1 + m_2 u_2 − m_2 e (u_1 − u_2))/(m_1 + m_2)."""
        still, e, one, two = (0.0, 0.0, 0.0), 0.6, 1.0, 8.0
        first, second, spin, other, j = strike_pair(0.0, 0.0, -1.0, (0.0, 0.0, -2.0), (0.0, 0.0, 1.0), still, still, (0.5, 1.0), (one, two), e, 0.3)
        common = (one * -2.0 + two * 1.0) / (one + two)
        assert first[2] == pytest.approx(common - two * e * -3.0 / (one + two), rel=1e-15)
        assert second[2] == pytest.approx(common + one * e * -3.0 / (one + two), rel=1e-15)
        assert (spin, other) == (still, still)
        assert j[2] == pytest.approx((1.0 + e) * one * two / (one + two) * 3.0, rel=1e-15)

    def test_oblique_without_friction(self):
        """Snooker: an elastic ball on a resting one leaves at a right angle to it."""
        n = (math.cos(0.7), math.sin(0.7), 0.0)
        still = (0.0, 0.0, 0.0)
        first, second, *_ = strike_pair(*n, (2.0, 0.0, 0.0), still, still, still, (0.5, 0.5), (1.0, 1.0), 1.0, 0.0)
        assert dot(first, second) == pytest.approx(0.0, abs=1e-15)
        assert np.allclose(second, [2.0 * math.cos(0.7) * x for x in n], atol=1e-15)
        assert strike_bed(*UP, 3.0, 1.0, -2.0, 1.0, 2.0, 3.0, 0.5, 0.0, 1.0)[:6] == (3.0, 1.0, 1.0, 1.0, 2.0, 3.0)

    @pytest.mark.parametrize("added", [1.0, 1.0 + 0.5 / 2.65])
    def test_a_spinning_ball_dropped(self, added):
        """Forward spin (ω_y > 0) throws it forward: u = aω/(1 + 5/2 m_e/m), and the spin falls to m_e/m 5/2 of that share."""
        r = strike_bed(*UP, 0.0, 0.0, -1.0, 0.0, 4.0, 0.0, 0.5, 2.0, added)
        share = 1.0 / (1.0 + 2.5 * added)
        assert r[0] == pytest.approx(0.5 * 4.0 * share, rel=1e-14)
        assert r[4] == pytest.approx(4.0 * share, rel=1e-14)  # rolls: u = aω
        assert r[2] == 0.5
        assert r[1] == r[3] == r[5] == 0.0
        slides = strike_bed(*UP, 0.0, 0.0, -1.0, 0.0, 4.0, 0.0, 0.5, 0.1, added)
        assert slides[0] == pytest.approx(0.1 * 1.5, rel=1e-14)
        assert slides[4] == pytest.approx(4.0 - 5.0 * 0.1 * 1.5 * added, rel=1e-14)

    def test_a_spin_about_the_normal_does_nothing(self):
        assert strike_bed(*UP, 0.0, 0.0, -1.0, 0.0, 0.0, 9.0, 0.5, 2.0, 1.0) == (0.0, 0.0, 0.5, 0.0, 0.0, 9.0, 0.0, 0.0, 1.5)

    def test_gears_and_brakes(self):
        """Opposite spins turn like gears and nothing drags; equal ones drag on each other with (2/7) m_e 2aω."""
        u, still = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        left, right = (0.0, 0.0, 6.0), (0.0, 0.0, -6.0)
        first, _, spin, other, j = strike_pair(1.0, 0.0, 0.0, u, still, left, right, (0.5, 0.5), (1.0, 1.0), 0.5, 5.0)
        assert (spin, other, j[1], first[1]) == (left, right, 0.0, 0.0)
        first, second, spin, other, j = strike_pair(1.0, 0.0, 0.0, u, still, left, left, (0.5, 0.5), (1.0, 1.0), 0.5, 5.0)
        drag = 2.0 / 7.0 * 0.5 * 6.0
        assert j[1] == first[1] == -second[1] == pytest.approx(-drag, rel=1e-14)
        assert spin[2] == other[2] == pytest.approx(6.0 - 5.0 * drag, rel=1e-14)

    def test_gears_of_unequal_size(self):
        """Rims of equal speed do not drag: a_1 ω_1 = −a_2 ω_2."""
        still = (0.0, 0.0, 0.0)
        *_, spin, other, j = strike_pair(1.0, 0.0, 0.0, (1.0, 0.0, 0.0), still, (0.0, 0.0, 6.0), (0.0, 0.0, -2.0), (0.5, 1.5), (1.0, 27.0), 0.5, 5.0)
        assert (spin, other) == ((0.0, 0.0, 6.0), (0.0, 0.0, -2.0))
        assert j[1] == pytest.approx(0.0, abs=1e-15)

    def test_the_sticking_factor_of_immersed_quartz(self):
        """J_t/(m_e |V_t|) = 2/7 dry, 0.252 for quartz in water."""
        added = 1.0 + 0.5 / 2.65
        dry = strike_bed(*UP, 3.0, 0.0, -9.0, 0.0, 0.0, 0.0, 0.5, 2.0, 1.0)
        wet = strike_bed(*UP, 3.0, 0.0, -9.0, 0.0, 0.0, 0.0, 0.5, 2.0, added)
        assert -dry[6] / 3.0 == pytest.approx(2.0 / 7.0, rel=1e-14)
        assert round(-wet[6] / (3.0 * added), 3) == 0.252
        assert wet[8] == pytest.approx(1.5 * 9.0 * added, rel=1e-14)
