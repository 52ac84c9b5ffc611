"""Scenes: the contract, what is shipped, presets, options, numbers, and what a check says of them."""

import math
import tomllib

import pytest

import saltation
from saltation.effects import EFFECTS
from saltation.grain import GRAVITY
from saltation.scene import Scene, SceneError, read, scene_of, shipped
from saltation.scene.presets import PRESETS
from saltation.scene.valid import left
from saltation.study import checks

CONTRACT = """
effects = ["weight", "drag", "added_mass", "lift", "history", "magnus"]

[fluid]
density = 1000.0            # kg/m3
viscosity = 1.0e-6          # m2/s
[grain]
density = 2650.0
diameter = 0.69e-3          # m
[channel]
transport_stage = 1.87      # τ*/τ*c; or shear_velocity in m/s
slope = 0.0
profile = "swamee"
[bed]
rebound = "tsuji"
roughness = "R7"
restitution = 0.65          # a number, "set1" or "stokes"
friction = 0.1              # Coulomb; García–Niño takes tangential_retention instead
contact_mass = "dry"        # or "immersed"
[history]
rebound = "impulse"         # impulse | restart | reset | none: what the memory does at an impact
scheme = "exponential"
kernel = "basset"
[solver]
method = "collocation"      # or "fixed_step", "runge_kutta_4" with dt (in d/u*)
rtol = 1.0e-5
[run]
jumps = 220
discard = 20
seed = 1
"""


def changed(name: str, **tables):
    """A shipped scene with fields of its tables replaced; None takes a table or a field out."""
    content = read(name)
    for table, fields in tables.items():
        if not isinstance(fields, dict):
            content[table] = fields
        else:
            content[table] = {key: value for key, value in {**content.get(table, {}), **fields}.items() if value is not None}
    return scene_of({key: value for key, value in content.items() if value is not None})


def test_the_contract_scene():
    scene = Scene.model_validate(tomllib.loads(CONTRACT))
    assert scene.names == ("weight", "drag", "added_mass", "lift", "history", "magnus")
    assert scene.turns  # by friction
    assert not scene.in_plane
    assert scene.numbers.stage == pytest.approx(1.87, rel=1e-12)
    assert scene.options("lift").coefficient == 0.2  # not given: the default
    assert checks.warnings(scene) == EFFECTS["history"].warnings(scene.options("history"), scene.numbers) + left(scene)


@pytest.mark.parametrize(("given", "is_right"), [("exponential", False), ("windowed", True)])
def test_the_contract_scheme_of_many_parameters(given, is_right):
    """scheme = "windowed", rule = "daitche", order = 2, window = 3.0, tail = "fitted"."""
    content = tomllib.loads(CONTRACT)
    content["history"] |= {"scheme": given, "rule": "daitche", "order": 2, "window": 3.0, "tail": "fitted"}
    content["solver"] = {"method": "fixed_step", "dt": 1e-3}
    if not is_right:
        with pytest.raises(SceneError, match=r"^history\.\w+ has no meaning for scheme = 'exponential'$"):
            scene_of(content)
        return
    rule = scene_of(content).history_rule()
    assert (rule.rule.order, rule.window, rule.tail is None) == (2, 3.0, False)


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenes_validate_and_survive_json(name):
    scene = saltation.load(name)
    assert saltation.load(f"{name}.toml") == scene
    assert Scene.model_validate_json(scene.model_dump_json(exclude_none=True)) == scene
    assert read(name) == tomllib.loads(shipped()[name].read_text())
    assert shipped()[name].read_text().startswith("# ")


@pytest.mark.parametrize(("name", "nominal", "diameter"), [("sand", 73.0, 0.69e-3), ("sand_coarse", 250.0, 1.57e-3)])
def test_shipped_sands_are_the_thesis_s_to_the_rounding_of_their_diameters(name, nominal, diameter):
    scene = saltation.load(name)
    assert scene.grain.diameter == diameter
    assert scene.numbers.particle_reynolds == pytest.approx(nominal, rel=1.5 * 0.005e-3 / diameter)  # R_p ~ d^1.5, d to 0.01 mm
    assert scene.numbers.reynolds == pytest.approx(scene.numbers.shields**0.5 * scene.numbers.particle_reynolds, rel=1e-12)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_scenes(name):
    preset = PRESETS[name]
    scene = changed("sand", effects=name)
    assert scene.names == preset.effects
    assert scene.in_plane == (preset.dimensions == 2)
    for effect, options in preset.options.items():
        assert {key: getattr(scene.options(effect), key) for key in options} == options
    assert changed("sand", effects=name, dimensions=5 - preset.dimensions).in_plane != scene.in_plane


def test_grains_meet_in_a_cloud_as_they_did_in_the_preset():
    """Table 2-1: four models of 15, one with hard spheres, three with soft ones."""
    assert {name: preset.collisions for name, preset in PRESETS.items() if preset.collisions} == {
        "shabani_2005": "soft",
        "harada_gotoh_2006": "soft",
        "yeganeh_2009": "soft",
        "bialik_2011": "hard",
    }
    for name, preset in PRESETS.items():
        scene = changed("sand_cloud", effects=name)
        assert scene.names == (*preset.effects, *(["encounters"] if preset.collisions else []))
        assert changed("sand", effects=name).names == preset.effects
    plane = changed("sand_cloud", effects="bialik_2011")
    assert plane.in_plane and plane.box[0] == pytest.approx(45 * math.pi / 6.0 / (0.0233 * 2.0))


def test_what_a_preset_had_that_is_not_computed_is_said():
    def said(scene):
        return [text.removeprefix(f"{scene.effects}: ") for text in checks.warnings(scene) if text.startswith(f"{scene.effects}: ")]

    inside = {"harada_gotoh_2006": 0.69e-3} | {name: 1e-3 * preset.diameters[0] for name, preset in PRESETS.items() if preset.diameters is not None}
    alone = {name: said(changed("sand", effects=name, grain={"diameter": inside[name]})) for name in PRESETS}
    streams = [name for name, texts in alone.items() if any("here it is the mean profile 'swamee'" in text for text in texts)]
    assert streams == ["yeganeh_2000", "schmeeckle_nelson_2003", "harada_gotoh_2006", "yeganeh_2009", "bialik_2011", "bialik_2012"]
    assert "its stream was a k–ε model: here it is the mean profile 'swamee'" in alone["yeganeh_2000"]
    assert alone["shabani_2005"] == ["its grains met each other: for that, add a [cloud] table"]
    assert [name for name, texts in alone.items() if not texts] == [
        "lee_hsu_1994",
        "nino_garcia_1998",
        "lee_2000",
        "lee_2006",
        "lukerchenko_2006",
        "lukerchenko_2009",
    ]
    assert "no equation of rotation" in alone["nino_garcia_1994"][0] and "built of single grains" in alone["sekine_kikkawa_1992"][0]
    assert said(changed("sand_cloud", effects="shabani_2005", grain={"diameter": 0.05e-3})) == ["its grains met as soft spheres: here they meet as hard ones"]
    assert not any("met" in text for text in said(changed("sand_cloud", effects="bialik_2011")))
    assert said(changed("sand", effects="lee_2000")) == ["its grains measured 6 mm: here grain.diameter is 0.69 mm"]
    assert said(changed("sand", effects="lee_hsu_1994")) == ["its grains measured 1.36 to 2.47 mm: here grain.diameter is 0.69 mm"]


def test_a_table_overrides_a_preset_s_options():
    assert changed("sand", effects="nino_garcia_1994").options("rotation").law == "prescribed"
    assert changed("sand", effects="nino_garcia_1994", rotation={"law": "yamamoto"}).options("rotation").law == "yamamoto"


def test_scenes_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        saltation.load("sand").grain.diameter = 1.0


def test_stage_and_shear_velocity_are_one_thing():
    by_stage = saltation.load("sand")
    by_velocity = changed("sand", channel={"transport_stage": None, "shear_velocity": by_stage.numbers.velocity})
    assert by_velocity.numbers.stage == pytest.approx(1.87, rel=1e-14)


def test_ignored_tables_are_named():
    scene = changed("sand", effects=["weight", "drag"], lift={"coefficient": 0.3})
    assert checks.ignored(scene) == ["history", "lift"]
    assert [text for text in checks.warnings(scene) if "ignored" in text] == [
        "[history] is ignored: 'history' is not among the effects",
        "[lift] is ignored: 'lift' is not among the effects",
    ]


def test_what_is_not_named_is_not_computed():
    scene = changed("settling", effects=["weight", "drag"])
    found = checks.computed(scene)
    assert found["state"] == "4 numbers: x, z, u, w"
    assert found["forces"] == "weight, drag"
    assert not {"memory", "spin", "bed", "stream"} & set(found)
    missing = " ".join(checks.left_out(scene))
    for word in ("history", "magnus", "rotation", "lift", "added_mass", "spin", "across", "stream", "bed"):
        assert word in missing
    assert checks.left_out(saltation.load("sand")) == ["turbulence (not among the effects)", "wall (not among the effects)"]
    for kernel, decay in (("basset", "11.4"), ("dorgan_loth", "17.2")):
        assert f"e = 0.97 exp(−{decay}/St)" in checks.computed(changed("sand", bed={"restitution": "stokes"}, history={"kernel": kernel}))["bed"]


def test_settling_velocity_of_stokes_drag():
    """w_s = (ρ_s/ρ − 1) g d²/(18 ν)."""
    scene = saltation.load("settling")
    assert checks.settling_velocity(scene) == pytest.approx(1.65 * GRAVITY * 1e-6 / (18.0 * 1e-4), rel=1e-12)
    assert checks.settling_velocity(changed("settling", effects=["weight"])) is None
    assert checks.settling_velocity(changed("settling", grain={"density": 900.0})) is None


def test_warnings_of_suspension_and_threshold():
    def about(stage, word):
        return [text for text in checks.warnings(changed("sand", channel={"transport_stage": stage})) if word in text]

    speed = checks.settling_velocity(saltation.load("sand")) / saltation.load("sand").numbers.velocity
    limit = 1.87 * speed**2  # settling velocity = u*
    assert not about(0.99 * limit, "suspension")
    (text,) = about(1.01 * limit, "suspension")
    assert f"T = {limit:.3g}" in text
    assert "van Rijn 1984" in text
    assert about(0.9, "threshold")
    assert not about(1.1, "threshold")


def test_a_grain_that_never_comes_down_is_announced():
    assert any("lighter" in text for text in checks.warnings(changed("sand", grain={"density": 900.0})))
    assert any("weight is not among" in text for text in checks.warnings(changed("sand", effects=["drag"])))


def test_a_path_that_fills_the_memory_is_announced():
    """2000 jumps of sand at steps of 1e-3 came to 1.4e6 nodes and 1.3 GB, 20 000 by collocation to 2.5e6 points and 2.9 GB."""

    def said(**tables):
        return [text for text in checks.warnings(changed("sand", **tables)) if "GB of memory" in text]

    steps = {"method": "fixed_step", "dt": 2e-3}
    assert not said() and not said(run={"jumps": 5000}) and not said(run={"jumps": 100_000, "trajectory": False})
    (text,) = said(run={"jumps": 4400}, solver=steps)
    assert "3.3e+06 points of the path" in text and "longer steps" in text
    (text,) = said(run={"jumps": 20_000})
    assert "2.5e+06 points of the path" in text and "2.5 GB" in text and "longer steps" not in text
    assert said(run={"jumps": 10**9, "trajectory": False}) == ["some 1e+09 jumps are kept, about 1e+03 GB of memory"]
    (text,) = [text for text in checks.warnings(changed("sand_cloud", cloud={"number": 10_000})) if "GB of memory" in text]  # 48 bytes a position, and copies
    assert "unless --output names a folder" in text


def test_check_says_which_treatments_of_the_history_measured_bounces_reject():
    def said(**history):
        return [text for text in checks.warnings(changed("sand", history=history)) if "measured normal rebounds contradict it" in text]

    for rebound in ("reset", "none"):
        (text,) = said(rebound=rebound)
        assert text.startswith(f"history.rebound = '{rebound}'") and "'impulse'" in text and "Gondret" in text and text.count("%") == 2
    assert said() == said(rebound="restart", kernel="mei_adrian") == []
