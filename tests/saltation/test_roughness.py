"""Bed roughness against its geometry: the touching-sphere relation, each reading's range and distribution, spheres against traced paths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from all_cases import each
from scipy import stats

from saltation.bed.roughness import (
    CLIP,
    LITERAL,
    READINGS,
    REJECT,
    ROUGHNESS,
    SPHERES,
    STEEPEST,
    TILT,
    angles,
    contact_plane,
    faces_downstream,
    truncated_normal,
)

TOUCHING = ("R1", "R5", "R6", "R7", "R8")
LIMIT = 1e-12  # radians, rounding
INCIDENCES = np.radians([0.0, 1e-7, 3.0, 11.0, 25.0, 30.0, 44.0, 60.0, 71.0, 89.0])


def bed(name, reading=CLIP, least=0.0, scatter=1.0, depth=0.25):
    return ROUGHNESS[name](reading, least, scatter, depth)


def draws(count, seed):
    return np.random.default_rng(seed).random((count, 4)).tolist()


def thetas(name, reading, incidence, count=4000, seed=1, least=0.0):
    """(θ_b, clipped) of many draws."""
    b = bed(name, reading, least)
    return np.array([angles(b, incidence, 0.5 * math.pi, d)[::2] for d in draws(count, seed)]).T


def velocities(count, seed):
    rng = np.random.default_rng(seed)
    v = rng.standard_normal((count, 3)) * [4.0, 1.0, 1.0]
    v[:, 2] = -np.abs(v[:, 2])
    return v.tolist()


class TestTheRelation:
    @each("name", ["R1", "R5", "R7"])
    def test_the_drawn_angle_satisfies_it(self, name):
        """r/d = ½ (cos θ_b − tan θ_in sin θ_b) for r/d ∈ U(0, ½), thesis (3-5)."""
        for incidence in INCIDENCES[:-1]:
            for d in draws(200, 2):
                theta, _, clipped = angles(bed(name, LITERAL), incidence, 0.5 * math.pi, d)
                offset = 0.5 * (math.cos(theta) - math.tan(incidence) * math.sin(theta))
                assert offset == pytest.approx(0.5 * d[0], abs=1e-14)
                assert -1e-8 < theta <= 0.5 * math.pi - incidence + LIMIT
                assert clipped == 0.0

    def test_across(self):
        """The same with r₂, α_in and α_b; the side is that of r₂."""
        for across in np.radians([5.0, 30.0, 70.0]):
            for d in draws(200, 3):
                alpha = angles(bed("R5", LITERAL), 0.3, across, d)[1]
                assert 0.5 * (math.cos(alpha) - math.tan(across) * math.sin(abs(alpha))) == pytest.approx(0.5 * d[1], abs=1e-14)
                assert (alpha > 0.0) == (d[2] < 0.5)

    def test_the_smallest_offset(self):
        """Chapter 4 draws r/d from 0.1 up: no contact is steeper than that offset allows."""
        for name in ("R1", "R5", "R6", "R7", "R8"):
            for incidence in INCIDENCES[:6]:
                theta, _ = thetas(name, LITERAL, incidence, 500, 4, least=0.2)
                offsets = np.cos(theta) - math.tan(incidence) * np.sin(theta)
                assert offsets.min() > 0.2 - 1e-13
                assert offsets.min() < 0.23

    def test_its_range_is_not_that_of_the_text(self):
        """θ_b reaches 90° − θ_in, far beyond 30°; at an incidence of 15° two thirds of the draws and more."""
        theta, _ = thetas("R1", LITERAL, math.radians(15.0))
        assert math.degrees(theta.max()) > 74.0
        beyond = math.cos(STEEPEST) - math.tan(math.radians(15.0)) * math.sin(STEEPEST)
        assert np.mean(theta > STEEPEST) == pytest.approx(beyond, abs=0.02)
        assert beyond > 2.0 / 3.0


class TestClip:
    @each("name", ["R1", "R5", "R7"])
    def test_never_steeper_than_30_degrees_and_the_flag_says_when(self, name):
        for incidence in INCIDENCES:
            theta, clipped = thetas(name, CLIP, incidence, 500)
            literal, _ = thetas(name, LITERAL, incidence, 500)
            assert np.array_equal(clipped == 1.0, literal > STEEPEST)
            assert np.array_equal(theta, np.minimum(literal, STEEPEST))

    def test_most_impacts_sit_at_the_limit(self):
        """About three quarters at the incidence of saltating sand, 10 to 20°."""
        for degrees in (10.0, 15.0, 20.0):
            assert 0.65 < np.mean(thetas("R1", CLIP, math.radians(degrees))[1]) < 0.82

    def test_across_too(self):
        alphas = np.array([angles(bed("R5", CLIP), 0.3, 0.2, d)[1] for d in draws(2000, 5)])
        assert np.abs(alphas).max() == STEEPEST
        assert np.mean(alphas > 0.0) == pytest.approx(0.5, abs=0.05)


class TestReject:
    @each("name", TOUCHING)
    def test_within_30_degrees(self, name):
        for incidence in INCIDENCES:
            theta, clipped = thetas(name, REJECT, incidence, 500)
            assert theta.max() <= STEEPEST + LIMIT
            assert theta.min() >= -1e-8
            assert not clipped.any()

    @each("degrees", [2.0, 15.0, 40.0, 75.0])
    @each("least", [0.0, 0.2])
    def test_it_is_the_literal_draw_made_again_beyond_30_degrees(self, degrees, least):
        literal, _ = thetas("R1", LITERAL, math.radians(degrees), 20000, 6, least)
        rejected, _ = thetas("R1", REJECT, math.radians(degrees), 4000, 7, least)
        kept = literal[literal <= STEEPEST]
        assert len(kept) > 1000
        assert stats.ks_2samp(kept, rejected).pvalue > 0.02
        assert stats.ks_2samp(kept, rejected**1.1).pvalue < 1e-3  # the test sees a difference

    def test_runs_with_r5_and_r6_are_equal_and_so_with_r7_and_r8(self):
        for one, two in (("R5", "R6"), ("R7", "R8")):
            for v, d in zip(velocities(500, 8), draws(500, 9), strict=True):
                assert contact_plane(bed(one, REJECT), *v, d) == contact_plane(bed(two, REJECT), *v, d)
        different = sum(
            contact_plane(bed("R5", CLIP), *v, d) != contact_plane(bed("R6", CLIP), *v, d) for v, d in zip(velocities(500, 8), draws(500, 9), strict=True)
        )
        assert different > 400

    def test_bounded_and_clipped_is_the_upstream_face(self):
        """r from r(30°) up: R6 and R8 never sit at the limit."""
        for incidence in INCIDENCES:
            assert np.array_equal(thetas("R6", CLIP, incidence, 200), thetas("R1", REJECT, incidence, 200))


class TestPrintedBounds:
    @each("name", ["R6", "R8"])
    def test_as_printed_every_contact_is_steeper_than_30_degrees(self, name):
        """The printed range, r from 0 to r(30°), is the wrong side of the limit."""
        for incidence in INCIDENCES[np.cos(INCIDENCES + STEEPEST) > 1e-9]:
            theta, _ = thetas(name, LITERAL, incidence, 500)
            assert theta.min() >= STEEPEST - LIMIT
            assert theta.max() <= 0.5 * math.pi - incidence + LIMIT
        alphas = [angles(bed("R6", LITERAL), 0.2, 0.4, d)[1] for d in draws(200, 10)]
        assert np.abs(alphas).min() >= STEEPEST - LIMIT

    def test_where_its_range_is_empty_nothing_is_bounded(self):
        """From an incidence of 60° on no contact reaches 30°: as R5."""
        for degrees in (60.5, 75.0, 89.9):
            assert np.array_equal(thetas("R6", LITERAL, math.radians(degrees), 100), thetas("R5", LITERAL, math.radians(degrees), 100))


def traced(incidence, count, seed):
    """θ_b by following straight paths down to a row of touching spheres: centres one diameter apart, contact at one diameter."""
    centres = np.arange(-400.0, 400.0)
    along = np.array([math.cos(incidence), -math.sin(incidence)])
    result = []
    for start in np.random.default_rng(seed).random(count):
        begin = np.array([start, 0.0]) - 4.0 / math.sin(incidence) * along
        delta = np.stack([begin[0] - centres, np.full_like(centres, begin[1])], axis=1)
        b = delta @ along
        root = b * b - ((delta**2).sum(axis=1) - 1.0)
        distance = np.where(root >= 0.0, -b - np.sqrt(np.maximum(root, 0.0)), np.inf)
        first = np.argmin(distance)
        x, z = delta[first] + distance[first] * along
        result.append(math.atan2(-x, z))
    return np.array(result)


class TestSpheres:
    @each("degrees", [2.0, 10.0, 20.0, 29.0, 31.0, 50.0, 80.0])
    def test_the_draw_is_that_of_paths_over_a_row_of_spheres(self, degrees):
        incidence = math.radians(degrees)
        theta, _ = thetas("R1", SPHERES, incidence, 3000, 11)
        paths = traced(incidence, 1500, 12)
        assert stats.ks_2samp(theta, paths).pvalue > 0.02
        assert math.degrees(abs(theta.max() - paths.max())) < 0.3
        assert math.degrees(abs(theta.min() - paths.min())) < 3.0  # few paths graze

    @each("name", TOUCHING)
    def test_within_30_degrees_and_never_beyond_grazing(self, name):
        """In the plane of motion the grain always closes: its velocity along the normal is into the bed."""
        for incidence in INCIDENCES:
            theta, clipped = thetas(name, SPHERES, incidence, 500)
            assert np.abs(theta).max() <= STEEPEST + LIMIT
            assert np.sin(theta + incidence).min() >= -LIMIT
            assert not clipped.any()
            w = -math.sin(incidence)
            for d in draws(100, 13):
                n, *_ = contact_plane(bed("R1", SPHERES), math.cos(incidence), 0.0, w, d)
                assert -(math.cos(incidence) * n[0] + w * n[2]) >= -LIMIT

    def test_across_it_closes_too(self):
        """The draw has both sides already: the sign of r₂ turns no contact to where the path cannot touch."""
        for name in ("R5", "R6"):
            for across in np.radians([3.0, 20.0, 50.0]):
                alpha = np.array([angles(bed(name, SPHERES), 0.3, across, d)[1] for d in draws(500, 14)])
                assert np.sin(alpha + across).min() >= -LIMIT
                assert alpha.min() < 0.0 < alpha.max() <= STEEPEST + LIMIT

    def test_a_flat_path_grazes_the_crests(self):
        theta, _ = thetas("R1", SPHERES, 0.0, 50)
        assert np.abs(theta).max() < 1e-7


class TestPlanesAndUniform:
    @each("name", ["R2", "R3"])
    def test_within_4_degrees_whatever_the_incidence(self, name):
        both = np.array([angles(bed(name), incidence, 0.3, d)[:2] for incidence in INCIDENCES for d in draws(300, 15)])
        assert np.abs(both).max() <= TILT
        assert math.degrees(np.abs(both).max()) > 3.8

    def test_uniform_tilts(self):
        both = np.array([angles(bed("R2"), 0.2, 0.3, d)[:2] for d in draws(4000, 16)])
        for column in both.T:
            assert stats.kstest(column, stats.uniform(-TILT, 2.0 * TILT).cdf).pvalue > 0.02
        assert abs(np.corrcoef(both.T)[0, 1]) < 0.05

    def test_normal_tilts(self):
        """Standard deviation 2°, cut at ±4°: quantile by quantile, to rounding."""
        for share in (1e-9, 0.001, 0.02, 0.3, 0.5, 0.5 + 1e-9, 0.77, 0.99, 1.0 - 1e-9):
            expected = stats.truncnorm.ppf(share, -2.0, 2.0, scale=0.5 * TILT)
            theta, alpha, _ = angles(bed("R3"), 0.2, 0.3, (share, 1.0 - share, 0.5, 0.5))
            assert theta == pytest.approx(expected, abs=1e-13)
            assert alpha == pytest.approx(-expected, abs=1e-13)
        for width, deviation in ((1.0, 4.0), (3.0, 1.0)):
            for share in (0.003, 0.4, 0.9):
                expected = stats.truncnorm.ppf(share, -width / deviation, width / deviation, scale=deviation)
                assert truncated_normal(share, width, deviation) == pytest.approx(expected, abs=1e-12)

    def test_r4(self):
        both = np.array([angles(bed("R4"), 1.0, 0.3, d)[:2] for d in draws(4000, 17)])
        assert stats.kstest(both[:, 0], stats.uniform(0.0, STEEPEST).cdf).pvalue > 0.02
        assert stats.kstest(both[:, 1], stats.uniform(-STEEPEST, 2.0 * STEEPEST).cdf).pvalue > 0.02
        assert both[:, 0].min() >= 0.0

    def test_r1_as_the_discussion_has_it(self):
        """Uniform within ±30° whatever the incidence, thesis section 3.4.2: mean 0, variance (π/6)²/3."""
        level, steep = (np.array([angles(bed("R1_uniform"), incidence, 0.3, d) for d in draws(4000, 29)]) for incidence in (0.0, 1.2))
        assert np.array_equal(level, steep)
        assert stats.kstest(level[:, 0], stats.uniform(-STEEPEST, 2.0 * STEEPEST).cdf).pvalue > 0.02
        assert level[:, 0].mean() == pytest.approx(0.0, abs=3.0 * STEEPEST / math.sqrt(3.0 * 4000))
        assert level[:, 0].var() == pytest.approx((math.pi / 6.0) ** 2 / 3.0, rel=0.05)
        assert not level[:, 1:].any()

    def test_which_planes_face_downstream(self):
        """Those that a draw tilts below the level."""
        for name in ROUGHNESS:
            for reading in range(len(READINGS)):
                b = bed(name, reading)
                least = min(angles(b, 0.3, 0.3, d)[0] for d in draws(200, 30))
                assert faces_downstream(b) == (least < -1e-6), (name, reading)

    @each("name", ["R7", "R8"])
    def test_across_as_r4(self, name):
        for d in draws(100, 18):
            assert angles(bed(name), 0.2, 0.3, d)[1] == angles(bed("R4"), 0.2, 0.3, d)[1]

    def test_flat(self):
        """A smooth wall at the bed level: the grain stands half a diameter above it."""
        for v, d in zip(velocities(20, 19), draws(20, 20), strict=True):
            assert contact_plane(bed("flat", depth=0.5), *v, d) == ((0.0, 0.0, 1.0), 0.5, 0.0, 0.0)


class TestFacing:
    @each("reading", range(len(READINGS)))
    @each("name", ROUGHNESS)
    def test_normals_are_unit_vectors_into_the_water(self, name, reading):
        for v, d in zip(velocities(200, 21), draws(200, 22), strict=True):
            n, height, theta, _ = contact_plane(bed(name, reading), *v, d)
            assert math.hypot(*n) == pytest.approx(1.0, abs=1e-15)
            assert n[2] > 0.0
            assert height == pytest.approx(n[2] - 0.25, abs=1e-15)
            assert abs(n[0]) <= math.sin(abs(theta)) + 1e-15

    def test_the_normal_leans_against_the_stream(self):
        """(−sin θ_b cos α_b, −sin α_b, cos θ_b cos α_b) for a grain that moves along x and to the left."""
        d = (0.7, 0.9, 0.2, 0.5)
        theta, alpha = 0.7 * STEEPEST, 0.8 * STEEPEST
        n, height, tilt, _ = contact_plane(bed("R4"), 3.0, 0.5, -1.0, d)
        assert n == pytest.approx((-math.sin(theta) * math.cos(alpha), -math.sin(alpha), math.cos(theta) * math.cos(alpha)), abs=1e-15)
        assert height == pytest.approx(math.cos(theta) * math.cos(alpha) - 0.25, abs=1e-15)
        assert tilt == pytest.approx(theta, abs=1e-15)

    @each("name", ROUGHNESS)
    def test_mirrored_for_motion_upstream_and_to_the_right(self, name):
        for v, d in zip(velocities(100, 23), draws(100, 24), strict=True):
            u, across, w = abs(v[0]), abs(v[1]), v[2]
            n, *rest = contact_plane(bed(name), u, across, w, d)
            assert contact_plane(bed(name), -u, across, w, d) == ((-n[0], n[1], n[2]), *rest)
            assert contact_plane(bed(name), u, -across, w, d) == ((n[0], -n[1], n[2]), *rest)

    @each("reading", range(len(READINGS)))
    @each("name", ["R1", "R5", "R6"])
    def test_without_motion_across_there_is_no_tilt_across(self, name, reading):
        for d in draws(100, 25):
            n, *_ = contact_plane(bed(name, reading), 4.0, 0.0, -1.0, d)
            assert n[1] == 0.0

    def test_scatter_across_can_be_switched_off(self):
        for name in ROUGHNESS:
            for v, d in zip(velocities(50, 26), draws(50, 27), strict=True):
                n, _, theta, _ = contact_plane(bed(name, scatter=0.0), *v, d)
                assert n[1] == 0.0
                assert theta == contact_plane(bed(name), *v, d)[2]

    @each("reading", range(len(READINGS)))
    @each("name", ROUGHNESS)
    def test_every_incidence_is_finite(self, name, reading):
        """Straight down, nearly so, level, upwards, at rest; draws at the ends of their range."""
        speeds = (0.0, 1e-300, 1e-17, 1e-9, 1.0, -1e-9, -1.0)
        for u in speeds:
            for v in speeds[:5]:
                for w in (-1.0, -1e-9, -1e-300, 0.0, 0.5):
                    for share in (1e-10, 0.5, 1.0 - 1e-10):
                        n, height, theta, clipped = contact_plane(bed(name, reading), u, v, w, (share, share, share, share))
                        assert all(map(math.isfinite, (*n, height, theta, clipped)))
                        assert math.hypot(*n) == pytest.approx(1.0, abs=1e-14)
                        assert abs(theta) <= 0.5 * math.pi

    def test_straight_down_meets_the_crest(self):
        for name in ("R1", "R5", "R6"):
            assert contact_plane(bed(name), 0.0, 0.0, -1.0, (0.3, 0.3, 0.3, 0.3)) == ((0.0, 0.0, 1.0), 0.75, 0.0, 0.0)

    def test_steep_falls_are_never_thrown_beyond_head_on(self):
        """θ_in + θ_b ≤ 90°: the offset r is on the upper side of the path."""
        for degrees in (60.0, 80.0, 89.0, 89.9999, 90.0 - 1e-9):
            for reading in (CLIP, REJECT, LITERAL):
                theta, _ = thetas("R5", reading, math.radians(degrees), 200)
                assert theta.max() <= 0.5 * math.pi - math.radians(degrees) + LIMIT

    def test_heights_of_contact(self):
        """0.75 on a crest and 0.62 at 30°, the bed level a quarter below the crests."""
        crest = contact_plane(bed("R4"), 1.0, 0.0, -1.0, (0.0, 0.5, 0.5, 0.5))
        face = contact_plane(bed("R4"), 1.0, 0.0, -1.0, (1.0, 0.5, 0.5, 0.5))
        assert crest[1] == 0.75
        assert round(face[1], 2) == 0.62
        assert math.degrees(face[2]) == pytest.approx(30.0)

    def test_motion_upwards_counts_as_level(self):
        for d in draws(50, 28):
            assert contact_plane(bed("R5"), 2.0, 1.0, 0.7, d) == contact_plane(bed("R5"), 2.0, 1.0, 0.0, d)
