"""Forces and torques against exact values, units, geometry and symmetry; each effect apart, then their sum."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from pydantic import ValidationError

from basset._compile import compiled, digest_of
from saltation.effects import EFFECTS, added_mass, drag, history, lift, magnus, rotation, weight
from saltation.effects.base import NoTorque, Setting, Situation, force, torque, total_force
from saltation.effects.turbulence import Eddies
from saltation.flow import profile_of, tabulated, velocity_and_shear
from saltation.grain import GRAVITY, numbers_of

pytestmark = pytest.mark.analytic

WATER, NU, QUARTZ, SIZE = 1000.0, 1e-6, 2650.0, 0.69e-3
N = numbers_of(WATER, NU, QUARTZ, SIZE, transport_stage=1.87, slope=0.02)
SWAMEE = profile_of("swamee", N)
SETTING = Setting(N, SWAMEE)
LAWS = list(drag.LAWS)
TABLE = (  # Yamamoto et al. (2001): below Re_r, C1, C2, C3
    (1.0, 0.0, 16.0 * math.pi, 0.0),
    (10.0, 0.0, 16.0 * math.pi, 0.0418),
    (20.0, 5.32, 37.2, 0.0),
    (50.0, 6.44, 32.2, 0.0),
    (math.inf, 6.45, 32.1, 0.0),
)
JOINTS = (1.0, 10.0, 20.0, 50.0)


def situation(z=1.3, slip=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), profile=SWAMEE):
    return Situation(z, *slip, *velocity_and_shear(profile, z), *spin)


def situations(count, seed):
    rng = np.random.default_rng(seed)
    heights = 0.3 + 4.0 * rng.random(count)
    slips, spins = 3.0 * rng.standard_normal((2, count, 3))
    return [situation(z, s, o) for z, s, o in zip(heights.tolist(), slips.tolist(), spins.tolist(), strict=True)]


def slip_of(s):
    return np.array([s.slip_x, s.slip_y, s.slip_z])


def relative_spin(s):
    """ω − ½ ∇×u_f of a stream (u_f(z), 0, 0), whose vorticity is (0, u_f', 0)."""
    return np.array([s.spin_x, s.spin_y, s.spin_z]) - 0.5 * np.array([0.0, s.shear, 0.0])


def coefficient(law, re):
    """C_D as published."""
    re = mpmath.mpf(re)
    if law == "stokes":
        return 24 / re
    if law == "yen":
        return 24 / re * (1 + mpmath.mpf("0.15") * mpmath.sqrt(re) + mpmath.mpf("0.017") * re) - mpmath.mpf("0.208") / (1 + 10000 / mpmath.sqrt(re))
    if law == "schiller_naumann":
        return max(24 / re * (1 + mpmath.mpf("0.15") * re ** mpmath.mpf("0.687")), mpmath.mpf("0.44"))
    if law == "rubey":
        return 24 / re + 2
    if law == "engelund_hansen":
        return 24 / re + mpmath.mpf("1.5")
    if law == "brown_lawler":
        return 24 / re * (1 + mpmath.mpf("0.15") * re ** mpmath.mpf("0.681")) + mpmath.mpf("0.407") / (1 + 8710 / re)
    tail = mpmath.mpf("0.413") / (1 + 16300 * re ** mpmath.mpf("-1.09"))
    return 24 / re * (1 + mpmath.mpf("0.173") * re ** mpmath.mpf("0.657")) + tail


class TestRegistry:
    def test_every_file_is_an_effect(self):
        assert set(EFFECTS) == {"weight", "drag", "lift", "magnus", "added_mass", "history", "rotation", "encounters", "turbulence", "wall"}
        assert [module.NAME for module in EFFECTS.values()] == list(EFFECTS)
        for module in EFFECTS.values():
            assert module.SOURCE and module.VALID
            built = module.build(module.Options(), SETTING)
            assert built is None or hasattr(built, "force") + hasattr(built, "torque") + isinstance(built, Eddies) == 1

    @pytest.mark.parametrize("module", EFFECTS.values(), ids=EFFECTS)
    def test_unknown_options_are_refused(self, module):
        with pytest.raises(ValidationError, match="nonsense"):
            module.Options(nonsense=1.0)

    @pytest.mark.parametrize(
        ("module", "options"),
        [
            (drag, {"law": "newton"}),
            (lift, {"coefficient": -0.1}),
            (lift, {"coefficient": math.nan}),
            (added_mass, {"coefficient": -0.5}),
            (added_mass, {"form": "maxey"}),
            (magnus, {"form": "scalar"}),
            (rotation, {"law": "free"}),
            (history, {"rebound": "forget"}),
            (history, {"rtol": 0.0}),
            (history, {"order": 11}),
        ],
    )
    def test_wrong_options_are_refused(self, module, options):
        with pytest.raises(ValidationError):
            module.Options(**options)


class TestDragLaws:
    @pytest.mark.parametrize("law", LAWS)
    def test_published_coefficients(self, law):
        for re in (1e-3, 1.0, 50.0, 100.0, 1000.0, 1e5):
            with mpmath.workdps(30):
                expected = float(coefficient(law, re) * re / 24)
            assert drag.factor(drag.LAWS[law], re) == pytest.approx(expected, rel=1e-13)

    def test_values_worked_by_hand(self):
        """C_D at Re = 1, 100, 1000."""
        expected = {
            "stokes": (24.0, 0.24, 0.024),
            "rubey": (26.0, 2.24, 2.024),
            "engelund_hansen": (25.5, 1.74, 1.524),
            "schiller_naumann": (27.6, 1.0917, 0.44),
            "yen": (28.008, 1.0078, 0.5452),
            "turton_levenspiel": (28.152, 1.0994, 0.4547),
            "brown_lawler": (27.60005, 1.0731, 0.4634),
        }
        for law, values in expected.items():
            for re, value in zip((1.0, 100.0, 1000.0), values, strict=True):
                assert drag.factor(drag.LAWS[law], re) * 24.0 / re == pytest.approx(value, rel=2e-4)

    @pytest.mark.parametrize("law", LAWS)
    def test_every_law_is_stokes_s_in_the_end(self, law):
        """Finite and 1 at rest, continuous there, growing with Re."""
        assert drag.factor(drag.LAWS[law], 0.0) == 1.0
        assert drag.factor(drag.LAWS[law], 5e-324) == 1.0
        assert drag.factor(drag.LAWS[law], 1e-8) == pytest.approx(1.0, abs=2e-5)
        values = [drag.factor(drag.LAWS[law], re) for re in np.geomspace(1e-6, 1e5, 400)]
        assert np.all(np.diff(values) >= 0.0)

    def test_yen_against_schiller_and_naumann(self):
        """9 % below at Re 50, 24 % above at 1000."""
        ratios = [drag.LAWS["yen"].factor(re) / drag.LAWS["schiller_naumann"].factor(re) for re in (50.0, 1000.0)]
        assert [round(100.0 * (ratio - 1.0)) for ratio in ratios] == [-9, 24]

    def test_the_two_laws_for_spheres_agree(self):
        """Schiller–Naumann and Turton–Levenspiel fit the same curve: within 12.5 % up to Re 1e5."""
        for re in np.geomspace(0.01, 1e5, 60):
            assert drag.LAWS["turton_levenspiel"].factor(re) / drag.LAWS["schiller_naumann"].factor(re) == pytest.approx(1.0, abs=0.125)


class TestDrag:
    @pytest.mark.parametrize("law", LAWS)
    def test_against_the_slip(self, law):
        """−¾ C_D |u_r| u_r."""
        effect = drag.build(drag.Options(law=law), SETTING)
        for s in situations(30, 1):
            u = slip_of(s)
            speed = np.linalg.norm(u)
            expected = -0.75 * float(coefficient(law, speed * N.reynolds)) * speed * u
            assert np.allclose(effect.force(s), expected, rtol=1e-12)

    @pytest.mark.parametrize("law", LAWS)
    def test_at_rest_and_nearly(self, law):
        effect = drag.build(drag.Options(law=law), SETTING)
        assert effect.force(situation()) == (0.0, 0.0, 0.0)
        tiny = effect.force(situation(slip=(1e-200, 0.0, -1e-200)))
        assert tiny == pytest.approx((-18e-200 / N.reynolds, 0.0, 18e-200 / N.reynolds), rel=1e-12)

    @pytest.mark.parametrize("law", LAWS)
    def test_no_preferred_direction(self, law):
        effect, rng = drag.build(drag.Options(law=law), SETTING), np.random.default_rng(2)
        for s in situations(20, 3):
            q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
            turned = effect.force(s._replace(**dict(zip(("slip_x", "slip_y", "slip_z"), (q @ slip_of(s)).tolist(), strict=True))))
            assert np.allclose(turned, q @ effect.force(s), rtol=1e-12, atol=1e-12)

    def test_settling_velocity_in_metres_per_second(self):
        """Stokes: (ρ_s/ρ − 1) g d²/(18 ν), whatever the added mass."""
        still = numbers_of(WATER, NU, QUARTZ, 5e-5)
        fall = (QUARTZ / WATER - 1.0) * GRAVITY * 5e-5**2 / (18.0 * NU)
        setting = Setting(still, profile_of("none", still))
        effects = (weight.build(weight.Options(), setting), drag.build(drag.Options(law="stokes"), setting))
        assert total_force(effects, situation(slip=(0.0, 0.0, -fall / still.velocity))) == pytest.approx((0.0, 0.0, 0.0), abs=1e-14)


class TestLift:
    EFFECT = lift.build(lift.Options(), SETTING)

    def test_the_difference_of_squares(self):
        """¾ C_L (|u_r|² half a diameter above − |u_r|² half a diameter below), from velocities; normal to the bed only."""
        for s in situations(100, 4):
            slips = [slip_of(s) + np.array([s.stream - velocity_and_shear(SWAMEE, s.z + side)[0], 0.0, 0.0]) for side in (0.5, -0.5)]
            squares = [u @ u for u in slips]
            x, y, z = self.EFFECT.force(s)
            assert (x, y) == (0.0, 0.0)
            assert z == pytest.approx(0.75 * 0.2 * (squares[0] - squares[1]), rel=1e-10, abs=1e-11)

    def test_the_lower_point_below_the_bed(self):
        """No stream there: 2 u u_t − u_t² remains, with its sign."""
        for z in (0.5, 0.45, 0.31):
            top = velocity_and_shear(SWAMEE, z + 0.5)[0]
            s = situation(z, slip=(2.0 - velocity_and_shear(SWAMEE, z)[0], 0.0, 0.0))
            assert self.EFFECT.force(s)[2] == pytest.approx(0.15 * ((2.0 - top) ** 2 - 2.0**2), rel=1e-13)

    def test_a_slow_grain_is_lifted_and_a_fast_one_pressed_down(self):
        assert self.EFFECT.force(situation(slip=(-2.0, 0.0, 0.0)))[2] > 0.0 > self.EFFECT.force(situation(slip=(2.0, 0.0, 0.0)))[2]

    def test_coefficient_and_still_water(self):
        s = situation(slip=(-2.0, 0.5, 1.0))
        assert lift.build(lift.Options(coefficient=0.4), SETTING).force(s)[2] == pytest.approx(2.0 * self.EFFECT.force(s)[2], rel=1e-15)
        still = profile_of("none", N)
        assert lift.build(lift.Options(), Setting(N, still)).force(situation(slip=(-2.0, 0.5, 1.0), profile=still)) == (0.0, 0.0, 0.0)


class TestMagnus:
    VERTICAL, VECTOR = magnus.build(magnus.Options(), SETTING), magnus.build(magnus.Options(form="vector"), SETTING)

    def test_vector(self):
        """¾ ω_r × u_r: across both, and no work."""
        for s in situations(100, 5):
            f = np.array(self.VECTOR.force(s))
            assert np.allclose(f, 0.75 * np.cross(relative_spin(s), slip_of(s)), rtol=1e-13, atol=1e-13)
            assert abs(f @ slip_of(s)) < 1e-12 * np.linalg.norm(f) * np.linalg.norm(slip_of(s))

    def test_vertical_is_its_z_component_in_the_plane(self):
        for s in situations(50, 6):
            plane = s._replace(slip_y=0.0, spin_x=0.0, spin_z=0.0)
            x, y, z = self.VERTICAL.force(plane)
            assert (x, y) == (0.0, 0.0)
            assert z == pytest.approx(self.VECTOR.force(plane)[2], rel=1e-14)
            assert z == pytest.approx(0.75 * (plane.stream - (plane.slip_x + plane.stream)) * (plane.spin_y - 0.5 * plane.shear), rel=1e-12)

    def test_sign(self):
        """A grain slower than the stream that turns forward faster than it rises; turning slower, or faster than the stream, it is pressed down."""
        shear = velocity_and_shear(SWAMEE, 1.3)[1]
        for effect in (self.VERTICAL, self.VECTOR):
            rises = [effect.force(situation(slip=(u, 0.0, 0.0), spin=(0.0, o, 0.0)))[2] for u in (-3.0, 3.0) for o in (shear, 0.0)]
            assert [math.copysign(1.0, z) for z in rises] == [1.0, -1.0, -1.0, 1.0]
            assert effect.force(situation(slip=(-3.0, 0.0, 0.0), spin=(0.0, 0.5 * shear, 0.0)))[2] == 0.0

    def test_in_newtons(self):
        """Rubinow and Keller's π ρ a³ ω × u over the mass of the water displaced times V²/d."""
        a, speed, spin = 0.5 * SIZE, 0.2, 80.0
        newtons = math.pi * WATER * a**3 * speed * spin
        scale = WATER * math.pi / 6.0 * SIZE**3 * N.velocity**2 / SIZE
        still = profile_of("none", N)
        s = situation(slip=(-speed / N.velocity, 0.0, 0.0), spin=(0.0, spin * SIZE / N.velocity, 0.0), profile=still)
        assert self.VERTICAL.force(s)[2] == pytest.approx(newtons / scale, rel=1e-12)


class TestRotation:
    EFFECT = rotation.build(rotation.Options(), SETTING)

    @staticmethod
    def pieces(number):
        return [c1 * math.sqrt(number) + c2 + c3 * number**2 for _, c1, c2, c3 in TABLE]

    def test_the_table_away_from_its_joints(self):
        """C_t Re_r, beyond a quarter from each joint."""
        tried = 0
        for number in np.geomspace(1e-3, 2e3, 300):
            if all(not 0.75 < number / joint < 1.25 for joint in JOINTS):
                c1, c2, c3 = next(row[1:] for row in TABLE if number < row[0])
                friction = (c1 / math.sqrt(number) + c2 / number + c3 * number) * number
                assert rotation.friction_of(number) == pytest.approx(friction, rel=1e-14)
                tried += 1
        assert tried > 200

    def test_between_the_pieces(self):
        """Near a joint the torque lies between the two rows of the table, within 0.8 % of either."""
        for k, joint in enumerate(JOINTS):
            for number in np.linspace(0.75 * joint, 1.25 * joint, 101):
                low, high = sorted(self.pieces(number)[k : k + 2])
                assert low * (1.0 - 1e-14) <= rotation.friction_of(number) <= high * (1.0 + 1e-14)
            one, two = self.pieces(joint)[k : k + 2]
            assert two == pytest.approx(one, rel=0.008)

    def test_smooth_across_the_joints(self):
        """Value, slope and curvature on both sides of where the blending begins and ends."""
        for joint, side in itertools.product(JOINTS, (0.75, 1.25)):
            place, h = side * joint, 1e-4 * joint
            values = [rotation.friction_of(place + k * h) for k in range(-3, 4)]
            assert np.abs(np.diff(values)).max() < 10.0 * h * 5.0
            left, right = (values[3] - values[2]) / h, (values[4] - values[3]) / h
            assert left == pytest.approx(right, abs=1e-3)
            bent = [(values[k + 1] - 2.0 * values[k] + values[k - 1]) / h**2 for k in (2, 4)]
            assert bent[0] == pytest.approx(bent[1], abs=0.02 / joint)

    @pytest.mark.parametrize("ratio", [True, False])
    def test_the_rate(self, ratio):
        """−(15/16π) C_t |ω_r| ω_r over ρ_s/ρ, or as printed without it; along ω_r, against it."""
        effect = rotation.build(rotation.Options(density_ratio=ratio), SETTING)
        for s in situations(60, 7):
            o = relative_spin(s)
            number = np.linalg.norm(o) * N.reynolds / 4.0
            c1, c2, c3 = next(row[1:] for row in TABLE if number < row[0])
            drag_coefficient = c1 / math.sqrt(number) + c2 / number + c3 * number
            expected = -15.0 / (16.0 * math.pi) * drag_coefficient * np.linalg.norm(o) * o / (2.65 if ratio else 1.0)
            assert np.allclose(effect.torque(s), expected, rtol=8e-3)
            assert np.allclose(np.cross(effect.torque(s), o), 0.0, atol=1e-10 * (o @ o))

    def test_spinning_down_slowly_in_seconds(self):
        """8π μ a³ ω on 8/15 π ρ_s a⁵: the rate is 15 μ/(ρ_s a²)."""
        still = profile_of("none", N)
        x, y, z = self.EFFECT.torque(situation(spin=(1e-4, -2e-4, 3e-4), profile=still))
        per_second = 15.0 * NU * WATER / (QUARTZ * (0.5 * SIZE) ** 2)
        assert (x, y, z) == pytest.approx([-per_second * N.time * o for o in (1e-4, -2e-4, 3e-4)], rel=1e-12)

    def test_at_rest_in_the_fluid(self):
        """Half the vorticity is the spin of the fluid: no torque there, and finite beside it."""
        shear = velocity_and_shear(SWAMEE, 1.3)[1]
        assert self.EFFECT.torque(situation(spin=(0.0, 0.5 * shear, 0.0))) == (0.0, 0.0, 0.0)
        assert all(map(math.isfinite, self.EFFECT.torque(situation(spin=(1e-300, 0.5 * shear, 0.0)))))
        assert self.EFFECT.torque(situation())[1] > 0.0  # the stream turns a grain forward

    def test_prescribed(self):
        """ω_y = 5.11 − 1.13 T: 3.0 at T 1.87 and 2.1 at 2.67; no torque."""
        assert [round(rotation.prescribed_spin(stage), 1) for stage in (1.87, 2.67)] == [3.0, 2.1]
        assert rotation.build(rotation.Options(law="prescribed"), SETTING) is None
        assert NoTorque(0.0).torque(situation(spin=(1.0, 2.0, 3.0))) == (0.0, 0.0, 0.0)
        assert torque(NoTorque(0.0), situation()) == (0.0, 0.0, 0.0)

    def test_warnings(self):
        prescribed, coarse = rotation.Options(law="prescribed"), numbers_of(WATER, NU, QUARTZ, 1.57e-3, transport_stage=3.08)
        assert rotation.warnings(prescribed, N) == rotation.warnings(rotation.Options(), coarse) == []
        assert "R_p = 250 and T = 3.08" in rotation.warnings(prescribed, coarse)[0]


class TestWeight:
    def test_on_a_slope(self):
        """Downstream and into the bed: (sin θ, 0, −cos θ)/τ*."""
        x, y, z = weight.build(weight.Options(), SETTING).force(situation())
        assert (x, y, z) == pytest.approx((math.sin(0.02) / N.shields, 0.0, -math.cos(0.02) / N.shields), rel=1e-14)
        assert x > 0.0 > z

    def test_in_metres_per_second_squared(self):
        """α times the force is the fall of a grain with added mass in still water."""
        still = numbers_of(WATER, NU, QUARTZ, 1e-3)
        z = weight.build(weight.Options(), Setting(still, None)).force(situation())[2]
        fall = (QUARTZ - WATER) * GRAVITY / (QUARTZ + 0.5 * WATER)
        assert still.alpha * z * still.velocity**2 / 1e-3 == pytest.approx(-fall, rel=1e-13)

    def test_light_and_neutral_grains(self):
        light = numbers_of(WATER, NU, 500.0, 1e-3)
        assert weight.build(weight.Options(), Setting(light, None)).force(situation())[2] == pytest.approx(1.0, rel=1e-14)
        neutral = numbers_of(WATER, NU, WATER, 1e-3, shear_velocity=0.03, slope=0.1)
        assert weight.build(weight.Options(), Setting(neutral, None)).force(situation()) == (0.0, 0.0, 0.0)


class TestAddedMass:
    def test_remainder(self):
        """C_m w u_f' along the stream, the thesis's form; Auton's has none."""
        effect = added_mass.build(added_mass.Options(coefficient=0.3), SETTING)
        for s in situations(20, 8):
            assert effect.force(s) == (0.3 * s.slip_z * s.shear, 0.0, 0.0)
        assert added_mass.build(added_mass.Options(form="auton"), SETTING) is None


class TestHistory:
    def test_it_is_the_flight_s(self):
        assert history.build(history.Options(), SETTING) is None
        assert history.Options().rebound == "impulse"
        kernels = {"mei_adrian": (2.0, 0.105), "dorgan_loth": (2.5, 0.2)}  # c1, c2 as published
        assert kernels == history.KERNELS

    def test_warnings(self):
        assert [history.warnings(history.Options(rebound=rebound), N) != [] for rebound in ("impulse", "restart", "reset", "none")] == [
            False,
            False,
            True,
            True,
        ]


def all_forces(profile=SWAMEE, form="vector"):
    setting = Setting(N, profile)
    parts = (weight, drag, lift, added_mass)
    return (*(part.build(part.Options(), setting) for part in parts), magnus.build(magnus.Options(form=form), setting))


class TestTotalForce:
    def test_the_sum(self):
        effects = all_forces()
        for s in situations(50, 9):
            parts = np.array([force(effect, s) for effect in effects])
            assert np.allclose(total_force(effects, s), parts.sum(axis=0), rtol=1e-13, atol=1e-12)

    def test_what_is_not_named_is_not_there(self):
        effects = all_forces()
        for s in situations(10, 10):
            assert total_force((), s) == (0.0, 0.0, 0.0)
            for k, effect in enumerate(effects):
                assert total_force((effect,), s) == effect.force(s)
                without = np.array(total_force(effects[:k] + effects[k + 1 :], s)) + effect.force(s)
                assert np.allclose(without, total_force(effects, s), rtol=1e-13, atol=1e-12)

    def test_the_order_changes_rounding_only(self):
        effects = all_forces()
        for s in situations(3, 11):
            results = [total_force(order, s) for order in itertools.permutations(effects)]
            assert np.ptp(results, axis=0).max() < 1e-12

    def test_left_and_right_are_alike(self):
        """Mirrored in y: slips as vectors, spins as pseudovectors."""
        effects = all_forces()
        for s in situations(30, 12):
            x, y, z = total_force(effects, s)
            mirrored = s._replace(slip_y=-s.slip_y, spin_x=-s.spin_x, spin_z=-s.spin_z)
            assert total_force(effects, mirrored) == pytest.approx((x, -y, z), rel=1e-13, abs=1e-13)

    def test_an_effect_of_one_s_own(self):
        """Anything with `force` takes part."""
        own = SimpleNamespace(force=lambda s: (s.z, 0.0, 1.0))
        s = situation()
        x, _, z = total_force(all_forces(), s)
        assert total_force((*all_forces(), own), s)[::2] == pytest.approx((x + s.z, z + 1.0), rel=1e-14)


def test_compiled_and_plain_forces_agree():
    sources = digest_of("saltation")

    @compiled()
    def total(effects, turning, s):
        sources  # part of the cache key
        return total_force(effects, s), torque(turning, s)

    table = tabulated(SWAMEE)
    effects, turning = all_forces(table), TestRotation.EFFECT
    for s in situations(50, 13):
        found = np.array(total(effects, turning, s))
        assert np.abs(found - [total_force(effects, s), turning.torque(s)]).max() <= 4e-16 * np.abs(found).max()
