"""Closures with a range: their limits and printed values, what a scene is told of them, and the rule that chooses among them."""

from __future__ import annotations

import itertools
import math
import typing

import numpy as np
import pytest
from scene_cases import flown, scene

import saltation
from saltation.bed import rebound
from saltation.closures import NUMBERS, Closure, choose, outside
from saltation.effects import EFFECTS, drag, lift, magnus
from saltation.effects.base import Setting, Situation
from saltation.flow import profile_of
from saltation.grain import numbers_of
from saltation.scene import SceneError, read, scene_of, shipped
from saltation.scene.conditions import conditions
from saltation.scene.valid import chosen, families, left
from saltation.study import checks
from saltation.study.thesis import case

N = numbers_of(1000.0, 1e-6, 2650.0, 0.69e-3, transport_stage=1.87)
SETTING = Setting(N, profile_of("swamee", N))
RE = N.reynolds


def moving(slip, spin=(0.0, 0.0, 0.0), shear=0.0):
    return Situation(1.3, *slip, 5.0, shear, *spin)


class TestMagnus:
    @staticmethod
    def coefficient(law, slip, spin):
        """C_L of ½ρ(πd²/4) C_L |u_r| (ω_r × u_r)/|ω_r| at Re_p and Re_r."""
        u, o = slip / RE, spin / RE
        force = magnus.build(magnus.Options(law=law, form="vector"), SETTING).force(moving((u, 0.0, 0.0), (0.0, o, 0.0)))
        return -force[2] / (0.75 * u * u)

    @pytest.mark.parametrize("law", ["oesterle_bui_dinh", "loth"])
    def test_creeping_flow_is_rubinow_and_keller_s(self, law):
        """C_L → Re_r/Re_p."""
        for size in (1e-4, 1e-8, 1e-12):
            assert self.coefficient(law, size, 3.0 * size) == pytest.approx(3.0, rel=size**0.3)
        s = moving((-1e-9, 2e-9, 1e-9), (1e-9, 3e-9, -2e-9))
        creeping = magnus.build(magnus.Options(form="vector"), SETTING).force(s)
        assert magnus.build(magnus.Options(form="vector", law=law), SETTING).force(s) == pytest.approx(creeping, rel=1e-3)

    def test_oesterle_and_bui_dinh_as_printed(self):
        for re_p, re_r in itertools.product((10.0, 50.0, 140.0), (20.0, 200.0, 1000.0)):
            printed = 0.45 + (re_r / re_p - 0.45) * math.exp(-0.05684 * re_r**0.4 * re_p**0.3)
            assert self.coefficient("oesterle_bui_dinh", re_p, re_r) == pytest.approx(printed, rel=1e-13)
        assert self.coefficient("oesterle_bui_dinh", 140.0, 1e7) == pytest.approx(0.45, rel=1e-10)  # fast spins

    def test_loth_as_printed_and_against_tsuji_s_measurements(self):
        """0.4 ± 0.1 times the spin parameter Re_r/(2 Re_p), up to 0.7, at Re_p 550 to 1600."""
        for re_p, ratio in itertools.product((1.0, 50.0, 1500.0), (0.5, 2.0, 10.0)):
            printed = ratio * (1.0 - (0.675 + 0.15 * (1.0 + math.tanh(0.28 * (ratio - 2.0)))) * math.tanh(0.18 * math.sqrt(re_p)))
            assert self.coefficient("loth", re_p, ratio * re_p) == pytest.approx(printed, rel=1e-13)
        for re_p, parameter in itertools.product((550.0, 1000.0, 1600.0), (0.2, 0.45, 0.7)):
            assert self.coefficient("loth", re_p, 2.0 * parameter * re_p) / parameter == pytest.approx(0.4, abs=0.11)

    @pytest.mark.parametrize("form", ["vertical", "vector"])
    @pytest.mark.parametrize("law", ["oesterle_bui_dinh", "loth"])
    def test_without_slip_or_spin(self, law, form):
        """No force, and a finite one beside it that goes to zero without a jump."""
        effect = magnus.build(magnus.Options(law=law, form=form), SETTING)
        for slip, spin in itertools.product((0.0, 5e-324, 1e-300, 1e-12), (0.0, 5e-324, 1e-300, 1e-12)):
            for force in (effect.force(moving((slip, 0.0, 0.0), (0.0, 3.0, 0.0))), effect.force(moving((3.0, 0.0, 0.0), (0.0, spin, 0.0)))):
                assert all(map(math.isfinite, force))
            assert effect.force(moving((slip, 0.0, 0.0), (0.0, spin, 0.0))) == pytest.approx((0.0, 0.0, 0.0), abs=1e-14)
        tiny = [abs(effect.force(moving((3.0, 0.0, 0.0), (0.0, 10.0**-k, 0.0)))[2]) for k in range(1, 40)]
        assert tiny == sorted(tiny, reverse=True) and tiny[-1] < 1e-13

    @pytest.mark.parametrize("law", ["oesterle_bui_dinh", "loth"])
    def test_across_both_and_weaker_than_in_creeping_flow(self, law):
        rng = np.random.default_rng(1)
        for slip, spin in 3.0 * rng.standard_normal((50, 2, 3)):
            force = np.array(magnus.build(magnus.Options(law=law, form="vector"), SETTING).force(moving(slip.tolist(), spin.tolist())))
            creeping = 0.75 * np.cross(spin, slip)
            assert np.allclose(np.cross(force, creeping), 0.0, atol=1e-12 * (creeping @ creeping))
            assert force @ creeping > 0.0
            if law == "loth":
                assert force @ creeping < creeping @ creeping

    def test_a_coefficient_belongs_to_the_linear_law(self):
        with pytest.raises(SceneError, match=r"^magnus\.coefficient belongs to law = 'linear', got 0.15 with law = 'loth': leave one of them out$"):
            scene_of(read("sand") | {"magnus": {"law": "loth", "coefficient": 0.15}})


MCLAUGHLIN = {0.1: -0.004658, 0.2: -0.01247, 0.4: 0.4076, 0.6: 1.0236, 0.8: 1.436, 1.0: 1.686, 1.5: 1.979, 2.0: 2.094, 5.0: 2.227}  # ε: J, table 1


class TestLift:
    LAWS = ("saffman", "mclaughlin", "mei", "loth")

    @staticmethod
    def coefficient(law, re_p, sr):
        """C_L of ½ρ(πd²/4) C_L |u_r|², upwards for a grain that lags behind."""
        slip = re_p / RE
        return lift.build(lift.Options(law=law), SETTING).force(moving((-slip, 0.0, 0.0), shear=sr * slip))[2] / (0.75 * slip * slip)

    def test_saffman_in_newtons(self):
        """1.615 ρ √(ν G) u d², which is 81.2/(8π)·… = 6.46 μ u a² √(G/ν)."""
        rho, nu, d, u, g = 1000.0, 1e-6, 0.69e-3, 2e-4, 3.0
        scale = rho * math.pi / 6.0 * d**3 * N.velocity**2 / d
        force = lift.build(lift.Options(law="saffman"), SETTING).force(moving((-u / N.velocity, 0.0, 0.0), shear=g * N.time))
        assert force[:2] == (0.0, 0.0)
        assert force[2] * scale == pytest.approx(1.615 * rho * math.sqrt(nu * g) * u * d * d, rel=1e-12)
        assert force[2] * scale == pytest.approx(6.46 * rho * nu * u * (d / 2.0) ** 2 * math.sqrt(g / nu), rel=1e-3)

    @pytest.mark.parametrize("law", ["mclaughlin", "mei", "loth"])
    def test_creeping_flow_in_a_strong_shear_is_saffman_s(self, law):
        """ε → ∞ at Re_p → 0."""
        for re_p in (1e-4, 1e-6, 1e-9):
            sr = 1e4 if law != "mei" else 0.4  # Mei's factor has no ε
            assert self.coefficient(law, re_p, sr) / self.coefficient("saffman", re_p, sr) == pytest.approx(1.0, abs=2e-3)

    def test_mclaughlin_s_table(self):
        """J(ε) within 5 % of J(∞), 3 % from ε = 0.8 on."""
        for epsilon, printed in MCLAUGHLIN.items():
            re_p = 0.01
            ratio = self.coefficient("mclaughlin", re_p, epsilon**2 * re_p) / self.coefficient("saffman", re_p, epsilon**2 * re_p)
            assert 2.255 * ratio == pytest.approx(printed, abs=(0.12 if epsilon < 0.8 else 0.07))

    def test_mei_as_printed(self):
        """Away from Re_p = 40; there the pieces are joined."""
        for re_p, alpha in itertools.product((0.1, 1.0, 10.0, 29.0, 51.0, 100.0), (0.005, 0.1, 0.4)):
            root = math.sqrt(alpha)
            printed = (1.0 - 0.3314 * root) * math.exp(-re_p / 10.0) + 0.3314 * root if re_p <= 40.0 else 0.0524 * math.sqrt(alpha * re_p)
            assert self.coefficient("mei", re_p, 2.0 * alpha) / self.coefficient("saffman", re_p, 2.0 * alpha) == pytest.approx(printed, rel=1e-12)

    def test_loth_beyond_fifty_as_printed(self):
        """Upwards at Re_p 60, to the faster side beyond 120."""
        for re_p, sr in itertools.product((63.0, 120.0, 300.0), (0.1, 0.8)):
            printed = -(sr ** (1.0 / 3.0)) * (0.0525 + 0.0575 * math.tanh(5.0 * math.log10(re_p / 120.0)))
            assert self.coefficient("loth", re_p, sr) == pytest.approx(printed, rel=1e-12)
        assert self.coefficient("loth", 300.0, 0.4) < 0.0

    @pytest.mark.parametrize("law", LAWS)
    def test_sign_and_rest(self, law):
        """Odd in slip and in shear; finite and zero without one of them."""
        effect = lift.build(lift.Options(law=law), SETTING)
        for slip, shear in ((0.3, 2.0), (2.0, 0.7)):
            up = effect.force(moving((-slip, 0.1, 0.2), shear=shear))[2]
            assert effect.force(moving((slip, 0.1, 0.2), shear=shear))[2] == -up == effect.force(moving((-slip, 0.1, 0.2), shear=-shear))[2]
        for slip, shear in itertools.product((0.0, 5e-324, 1e-200, 1.0), (0.0, 5e-324, 1e-200, 1.0)):
            force = effect.force(moving((slip, 0.0, 0.0), shear=shear))
            assert all(map(math.isfinite, force))
            assert force[2] == 0.0 or (slip > 0.0 and shear > 0.0)

    @pytest.mark.parametrize(("law", "joint"), [("mei", 40.0), ("loth", 50.0)])
    def test_smooth_where_pieces_meet(self, law, joint):
        """No jump in value or slope at the ends of the joint."""
        for place in (0.75 * joint, 1.25 * joint):
            h = 1e-5 * joint
            values = [self.coefficient(law, place + k * h, 0.3) * (place + k * h) ** 2 for k in (-2, -1, 0, 1, 2)]
            slopes = np.diff(values) / h
            assert np.ptp(slopes) < 1e-3 * np.abs(slopes).max() + 1e-9

    def test_a_coefficient_belongs_to_the_squares(self):
        with pytest.raises(SceneError, match=r"^lift\.coefficient belongs to law = 'squares'"):
            scene_of(read("sand") | {"lift": {"law": "mei", "coefficient": 0.3}})

    def test_zero_shear_leaves_nothing(self):
        still = scene("settling", effects=["weight", "drag", "lift"], history=None, lift={"law": "loth"}, run={"duration": 0.01})
        assert np.all(flown(still).trajectory["lift_z"] == 0.0)


class TestRanges:
    ALL = {name: module.CLOSURES for name, module in EFFECTS.items() if hasattr(module, "CLOSURES")} | {"bed": rebound.CLOSURES}

    def test_every_closure_says_what_takes_it_and_where_it_holds(self):
        for name, closures in self.ALL.items():
            for closure in closures.values():
                assert set(closure.holds) <= set(NUMBERS) and closure.holds
                assert all(low < high for low, high in closure.holds.values())
                assert str(1800 <= closure.year <= 2030) and any(character.isdigit() for character in closure.source)
                if name != "bed":
                    EFFECTS[name].Options(**closure.take)

    @pytest.mark.parametrize(("module", "field"), [(drag, "law"), (magnus, "law"), (lift, "law"), (EFFECTS["history"], "kernel")])
    def test_every_word_of_a_law_has_a_range(self, module, field):
        words = typing.get_args(module.Options.model_fields[field].annotation)
        assert set(words) == {closure.take[field] for closure in module.CLOSURES.values()}

    def test_outside(self):
        closure = Closure({}, 2000, "", {"Re_p": (1.0, 10.0), "T": (1.0, 3.0)})
        assert outside(closure, {"Re_p": 1.0, "T": 3.0}) == {}
        assert outside(closure, {"Re_p": 10.5, "T": 2.0}) == {"Re_p": 10.5}
        assert math.isnan(outside(closure, {"Re_p": 5.0})["T"])

    def test_the_rule(self):
        """The closure whose range holds, of these the one with the most recent measurement behind it; else the nearest."""
        family = {
            "old": Closure({}, 1900, "", {"Re_p": (0.0, 1e3)}),
            "new": Closure({}, 2000, "", {"Re_p": (0.0, 100.0)}),
            "newest": Closure({}, 2010, "", {"Re_p": (10.0, 20.0), "T": (1.0, 3.0)}),
        }
        assert choose(family, {"Re_p": 15.0, "T": 2.0}) == ("newest", True)
        assert choose(family, {"Re_p": 15.0}) == ("new", True)
        assert choose(family, {"Re_p": 500.0, "T": 2.0}) == ("old", True)
        assert choose(family, {"Re_p": 5e3, "T": 2.0}) == ("old", False)
        assert choose({name: family[name] for name in ("new", "newest")}, {"Re_p": 5e3, "T": 2.0}) == ("new", False)

    def test_check_names_what_is_left_and_what_to_take(self):
        made = scene("sand", magnus={"law": "oesterle_bui_dinh"}, drag={"law": "stokes"})
        told = {text.partition(" = ")[0]: text for text in left(made)}
        assert set(told) == {"drag.law", "magnus.law", "lift.law", "history.kernel", "bed.restitution"}
        assert "holds for Re_p up to 0.1, and here Re_p = 80: take drag.law = 'brown_lawler', Brown & Lawler (2003)" in told["drag.law"]
        assert "Re_r/Re_p 2 to 12, and here Re_r/Re_p = 0.52: take magnus.law = 'loth'" in told["magnus.law"]
        assert checks.warnings(made)[-len(told) :] == list(told.values())

    def test_nothing_is_said_within_the_ranges(self):
        assert left(scene("settling")) == ["drag.law = 'stokes'"][:0]
        made = scene("sand", magnus={"law": "loth"}, lift={"law": "loth"}, history={"kernel": "dorgan_loth"}, bed={"restitution": "stokes"})
        assert left(made) == []

    def test_a_number_of_one_s_own_has_no_range(self):
        assert not any(text.startswith("magnus") for text in left(scene("sand", magnus={"coefficient": 0.3})))

    def test_where_none_holds_the_nearest_is_named(self):
        told = [text for text in left(scene("gravel")) if text.startswith("history.kernel")]
        assert len(told) == 1 and "no other law known here holds, the nearest: take history.kernel = 'dorgan_loth'" in told[0]

    @pytest.mark.parametrize("name", shipped())
    def test_the_numbers_of_a_scene(self, name):
        found = conditions(saltation.load(name))
        assert set(found) <= set(NUMBERS) and all(map(math.isfinite, found.values()))

    def test_a_grain_as_heavy_as_the_fluid_has_no_typical_jump(self):
        made = scene("sand", grain={"density": 1000.0}, channel={"transport_stage": None, "shear_velocity": 0.03})
        assert left(made) == []


class TestDefaults:
    def test_what_is_not_given_is_written_out(self):
        made = saltation.load("sand")
        assert {family: name for family, (name, _) in chosen(made).items()} == {
            "drag.law": "brown_lawler", "lift.law": "loth", "history.kernel": "dorgan_loth",
            "magnus.law": "loth", "rotation.law": "yamamoto", "bed.restitution": "gondret",
        }  # fmt: skip
        assert (made.drag.law, made.lift.law, made.magnus.law, made.history.kernel, made.bed.restitution) == (
            "brown_lawler", "loth", "loth", "dorgan_loth", "stokes",
        )  # fmt: skip
        assert left(made) == []
        assert scene_of(made.model_dump(exclude_none=True)) == made == made.changed()

    def test_what_is_given_stays(self):
        content = case("sand")
        content |= {"defaults": "valid", "magnus": {"coefficient": 0.3}, "drag": {"law": "rubey"}, "history": content["history"] | {"kernel": "basset"}}
        made = scene_of(content)
        assert (made.magnus.law, made.magnus.coefficient, made.drag.law) == ("linear", 0.3, "rubey")
        assert (made.bed.restitution, made.history.kernel) == (0.65, "basset")

    def test_a_preset_s_own_laws_stay(self):
        content = {key: value for key, value in read("sand").items() if key not in ("history", "effects")}
        made = scene_of(content | {"effects": "nino_garcia_1998"})
        assert made.options("rotation").law == "prescribed" and made.drag.law == "brown_lawler"

    def test_the_thesis_s_set_is_the_default(self):
        made = scene_of({name: table for name, table in read("sand").items() if name != "defaults"})
        assert made.defaults == "thesis" and made.drag is made.magnus is made.lift is None
        assert (made.options("drag").law, made.options("lift").law, made.options("magnus").law) == ("yen", "squares", "linear")
        assert made == scene_of(case("sand"))

    def test_shipped_scenes_over_a_bed_leave_a_range_only_where_no_law_holds(self):
        beyond = {"sand": set(), "sand_cloud": set(), "sand_coarse": {"history.kernel"}, "gravel": {"lift.law", "history.kernel", "magnus.law", "rotation.law"}}
        for name, families_of in beyond.items():
            made = saltation.load(name)
            assert families_of == {family for family, (_, holds) in chosen(made).items() if not holds}
            assert families_of == {text.partition(" = ")[0] for text in left(made) if text.endswith("no other law known here holds")}
            assert len(left(made)) == len(families_of)

    def test_families_are_those_of_what_is_computed(self):
        assert set(families(scene("settling"))) == {"drag.law", "history.kernel"}
