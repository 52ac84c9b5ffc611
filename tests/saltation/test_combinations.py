"""Interchangeable means interchangeable: every scheme × kernel × solver is flown, or refused with a mathematical reason and a hint that works."""

import ast
import re

import numpy as np
import pytest
from all_cases import each
from scene_cases import flown, scene

import saltation
from basset import SCHEMES
from bench.combinations import KERNELS, METHODS, RULES, Combination, combinations, forms, refusal
from bench.grains import changed
from saltation.scene import scene_of
from saltation.scene.memory import REASONS

ALL = list(combinations())


def graded(one):
    """Weights of samples at equal steps, and sums that begin behind a window, have no meaning at graded steps; collocation has its own sum."""
    return one.method == "collocation" and one.history["scheme"] != "exponential"


def half(one):
    """A derivative of order 1/2 is an integral against s^(-1/2) alone."""
    return one.kernel != "basset" and "semi_derivative" in (one.history["scheme"], one.history.get("rule"))


def published(one):
    """So are the published sums."""
    own = one.history["scheme"] == "hinsberg" and "window" in one.history and "tail" not in one.history
    return one.kernel != "basset" and (own or one.history.get("tail") in ("van_hinsberg", "casas"))


def barred(one):
    return graded(one) or half(one) or published(one)


ACCEPTED = [one for one in ALL if not barred(one)]
REFUSED = [one for one in ALL if barred(one)]


def name_of(one):
    return f"{one.form}, {one.kernel}, {one.method}"


def test_the_table_has_every_scheme_kernel_and_solver():
    assert {name for name in SCHEMES if name != "windowed"} == {one.history["scheme"] for one in ALL} - {"windowed"}
    assert len(ALL) == (6 * len(RULES) + 5) * len(KERNELS) * len(METHODS) == len(set(map(name_of, ALL)))
    listed = [one for one in ALL if "newton_cotes" not in one.form]  # the list of the issue is older than this rule
    assert (len(listed), sum(one in ACCEPTED for one in listed)) == (261, 128)


@each("one", ACCEPTED)
def test_what_no_mathematics_bars_is_accepted(one):
    assert refusal(one) == ""


def hints(sentence):
    """The alternatives of a refusal, field by field; None: left out."""
    for alternative in sentence.split(": take ")[1].split("; or "):
        given, _, out = alternative.partition(" without ")
        changes = {name: ast.literal_eval(value) for name, value in re.findall(r"(\S+) = ('[^']*'|[\d.]+)", given)}
        yield changes | dict.fromkeys(re.findall(r"[\w.]+\.[\w]+", out))


@each("one", REFUSED)
def test_a_refusal_says_why_and_what_flies_instead(one):
    sentence = refusal(one)
    assert sum(reason in sentence for reason in REASONS.values()) == 1
    wanted = ("grid", "window", "sum") if graded(one) else ("half",) if half(one) else ("published",)
    assert any(REASONS[key] in sentence for key in wanted)
    found = list(hints(sentence))
    assert found and all(found)
    for changes in found:
        content = one.scene()
        for path, value in changes.items():
            table, field = path.split(".")
            content = changed(content, **{table: {field: value}})
        tables = {table: {field: value for field, value in content[table].items() if value is not None} for table in ("history", "solver")}
        scene_of(content | tables)


@pytest.mark.parametrize(("method", "history"), [
    ("collocation", {"scheme": "daitche", "order": 3}),
    ("collocation", {"scheme": "windowed", "window": 2.0, "tail": "fitted", "rtol": 1e-8}),
    ("collocation", {"scheme": "windowed", "window": 2.0, "order": 2, "kernel": "mei_adrian", "slip_at": "tau"}),
    ("collocation", {"scheme": "semi_derivative", "kernel": "dorgan_loth", "slip_at": "tau"}),
    ("fixed_step", {"scheme": "windowed", "window": 2.0, "order": 2, "tail": "casas_3_I1", "kernel": "mei_adrian"}),
    ("runge_kutta_4", {"scheme": "windowed", "window": 2.0, "rule": "semi_derivative", "tail": "van_hinsberg", "kernel": "dorgan_loth"}),
])  # fmt: skip
def test_what_a_refusal_names_flies_with_all_else_that_was_given(method, history):
    """Following a sentence leads to no next one: parameters of what it replaces are left out with it."""
    content = scene("settling").model_dump(exclude_none=True)
    content |= {"history": history, "solver": {"method": method} | ({"dt": 1e-2} if method != "collocation" else {})}
    with pytest.raises(saltation.SceneError) as caught:
        scene_of(content)
    for changes in hints(str(caught.value)):
        tables = {"history": dict(content["history"]), "solver": dict(content["solver"])}
        for path, value in changes.items():
            table, field = path.split(".")
            tables[table][field] = value
        scene_of(content | {name: {field: value for field, value in table.items() if value is not None} for name, table in tables.items()})


@pytest.mark.parametrize(("history", "words"), [
    ({"scheme": "daitche", "tail": "casas"}, "history.tail has no meaning for scheme = 'daitche'"),
    ({"scheme": "exponential", "tail": "van_hinsberg"}, "history.tail has no meaning for scheme = 'exponential'"),
    ({"scheme": "windowed", "window": 2.0, "tail": "fited"}, "history.tail must be 'fitted'"),
    ({"scheme": "windowed", "window": 2.0, "tail": True}, "history.tail must be 'fitted'"),
])  # fmt: skip
def test_a_tail_that_is_none_is_no_published_one(history, words):
    """With a kernel of finite Reynolds numbers too, where a published tail would be refused for its numbers."""
    content = scene("settling").model_dump(exclude_none=True) | {"solver": {"method": "fixed_step", "dt": 1e-2}}
    for kernel in ("basset", "mei_adrian", "dorgan_loth"):
        with pytest.raises(saltation.SceneError) as caught:
            scene_of(content | {"history": history | {"kernel": kernel}})
        assert str(caught.value).startswith(words)


def jump(one, dt=0.0, count=1):
    """Height and length of the last of so many jumps."""
    found = saltation.run(scene_of(one.scene(dt, count))).all_jumps[["height", "length"]].to_numpy()
    assert len(found) == count
    return found[-1]


def exact(one, count):
    history = {"scheme": "exponential"} | ({"window_jumps": 1} if "window_jumps" in one.history else {})
    key = one.kernel, len(history), count
    if key not in EXACT:
        EXACT[key] = jump(Combination("exponential", history, one.kernel, "collocation"), count=count)
    return EXACT[key]


EXACT: dict = {}
PUBLISHED = 0.01  # what a published sum is off by in a jump, at most; and what is left of √dt after three


@pytest.mark.parametrize("one", [one for one in ACCEPTED if one.method != "collocation"], ids=name_of)
def test_it_tends_to_the_jump_of_collocation(one):
    """As √dt: a takeoff with slip. Windows are seen by the third jump, which the first is no part of."""
    count = 3 if "window_jumps" in one.history else 1
    coarse, fine = (jump(one, dt, count) for dt in (4e-3, 1e-3))
    apart = np.abs(2.0 * fine - coarse - exact(one, count)) / exact(one, count)
    own = one.history["scheme"] == "hinsberg" and "window" in one.history and "tail" not in one.history
    assert apart.max() < (PUBLISHED if own or count > 1 or one.history.get("tail") in ("van_hinsberg", "casas") else 5e-3), apart


@pytest.mark.parametrize("slip_at", ["t", "tau"])
@pytest.mark.parametrize("method", METHODS[1:])
def test_whose_slip_the_kernel_takes(method, slip_at):
    """The two readings differ in height by more than the steps do."""
    one = Combination("exponential", {"scheme": "exponential", "slip_at": slip_at}, "mei_adrian", method)
    found = 2.0 * jump(one, 1e-3) - jump(one, 4e-3)
    other = exact(one, 1)
    assert (abs(found[0] / other[0] - 1.0) < 2e-3) == (slip_at == "t")


def test_a_memory_of_more_jumps_than_there_are_changes_nothing():
    for form in ("semi_derivative", "daitche", "exponential"):
        for kernel in ("basset",) if form == "semi_derivative" else ("basset", "mei_adrian"):
            flown = [jump(Combination(form, {"scheme": form} | window, kernel, "fixed_step"), 4e-3, 3) for window in ({}, {"window_jumps": 5})]
            assert np.array_equal(*flown)


@pytest.mark.parametrize(("rebound", "order"), [("impulse", 0.5), ("none", 1.0)])
def test_a_window_of_one_jump_at_fixed_steps(rebound, order):
    """The thesis's own pair, semi-derivative with T_back in jumps: the third bounce tends to collocation's (see TestWindowOfJumps for its closed form)."""

    def third(method, dt=None):
        history = {"rebound": rebound, "window_jumps": 1, "scheme": "exponential" if dt is None else "semi_derivative"}
        solver = {"method": method, "rtol": 1e-8} | ({} if dt is None else {"dt": dt})
        made = scene("bouncing", history=history, solver=solver, run={"jumps": 3}, height=5.5)
        return float(flown(made).jumps["height"][2])

    exact = third("collocation")
    for method in METHODS[1:]:
        errors = [third(method, dt) - exact for dt in (4e-3, 1e-3)]
        factor = 4.0**order
        assert abs((factor * errors[1] - errors[0]) / (factor - 1.0)) < 0.01 * exact
        assert 0.0 < abs(errors[1]) < abs(errors[0])


def test_forms_are_what_their_names_say():
    assert all(("window_jumps" in history) == ("jumps" in form) and ("tail" in form) == (history.get("tail", form.count("own")) not in (False, 0))
               for form, history in forms().items())  # fmt: skip


@pytest.mark.parametrize("method", METHODS[1:])
@pytest.mark.parametrize("history", [{}, {"window_jumps": 2}, {"kernel": "dorgan_loth"}])
def test_simpson_s_alternating_weights_are_no_divergence(method, history):
    made = scene("sand", history={"scheme": "brush", "rebound": "none"} | history, solver={"method": method, "dt": 3e-3}, run={"jumps": 6, "discard": 0})
    assert flown(made).status == "finished"
