"""Scenes drawn at random over all that the model admits: a run that is accepted ends as asked, or as `check` says it may."""

from __future__ import annotations

import math
from unittest import mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import saltation
from saltation.bed.rebound import REBOUNDS
from saltation.bed.roughness import READINGS, ROUGHNESS
from saltation.effects import EFFECTS
from saltation.effects.drag import LAWS
from saltation.flight import layout
from saltation.flight import setup as engine
from saltation.flow import PROFILES, REGIMES
from saltation.scene import SceneError, scene_of
from saltation.study import checks

FLUIDS = ({"density": 1000.0, "viscosity": 1e-6}, {"density": 1.2, "viscosity": 1.5e-5}, {"density": 1260.0, "viscosity": 1e-3})
MOST_STEPS = 400  # of a run here: so far it must get without a fault
SINGLE = tuple(name for name in EFFECTS if name not in ("encounters", "turbulence"))


def decades(low, high):
    """Log-uniform."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda x: float(f"{10.0**x:.4g}"))


@st.composite
def contents(draw):
    """What a TOML file of a single grain may hold."""
    one_of = lambda *words: draw(st.sampled_from(words))  # noqa: E731 - one word for a draw that is made some thirty times below
    effects = ["weight", *draw(st.lists(st.sampled_from([name for name in SINGLE if name != "weight"]), unique=True))]
    fluid = dict(one_of(*FLUIDS))
    grain = {"diameter": draw(decades(1e-6, 0.1)), "density": draw(decades(30.0, 2e4))}
    content = {"effects": effects[draw(st.integers(0, 9)) == 0 and len(effects) > 1 :], "fluid": fluid, "grain": grain}
    content["dimensions"] = one_of(2, 3)
    with_bed = draw(st.integers(0, 4)) > 0
    if draw(st.integers(0, 4)) > 0:
        content["channel"] = {"profile": one_of("swamee", *PROFILES, *REGIMES), "transport_stage": draw(decades(0.8, 50.0)), "slope": one_of(0.0, 0.02)}
    if with_bed:
        bed = {"rebound": one_of(*REBOUNDS), "roughness": one_of(*ROUGHNESS), "reading": one_of(*READINGS), "contact_mass": one_of("dry", "immersed")}
        bed["restitution"] = one_of("set1", "stokes", 0.0, 0.3, 0.65, 0.9, 1.0)
        bed["tangential_retention" if bed["rebound"] == "garcia_nino" else "friction"] = one_of(0.0, 0.1, 0.75)
        content["bed"] = bed
    if "history" in effects:
        content["history"] = {"rebound": one_of("impulse", "restart", "reset", "none"), "kernel": one_of("basset", "mei_adrian", "dorgan_loth")}
    if "drag" in effects:
        content["drag"] = {"law": one_of(*LAWS)}
    if "rotation" in effects:
        content["rotation"] = {"law": one_of("yamamoto", "prescribed")}
    content["solver"] = {"rtol": one_of(1e-2, 1e-3, 1e-5, 1e-7)}
    if draw(st.integers(0, 5)) == 0:
        content["solver"] = {"method": one_of("fixed_step", "runge_kutta_4"), "dt": draw(decades(1e-3, 0.05))}
        if "history" in effects:
            content["history"] = {
                **content["history"],
                "scheme": one_of("exponential", "daitche", "semi_derivative", "hinsberg", "windowed"),
            }
            if content["history"]["kernel"] != "basset":
                content["history"]["slip_at"] = one_of("t", "tau")
            if content["history"]["scheme"] not in ("hinsberg", "windowed") and draw(st.booleans()):
                content["history"]["window_jumps"] = draw(st.integers(1, 3))
            if content["history"]["scheme"] in ("hinsberg", "windowed"):
                content["history"]["window"] = draw(decades(1e-3, 3.0))
            if content["history"]["scheme"] == "windowed":
                content["history"] |= {"tail": one_of(False, "fitted", "van_hinsberg", "casas_4"), "rule": one_of("daitche", "brush", "semi_derivative")}
    content["run"] = {"jumps": draw(st.integers(1, 12))} if with_bed else {"duration": draw(decades(1e-6, 1e5))}
    content["run"]["seed"] = draw(st.integers(0, 1000))
    return content


def announced(made, status):
    """Whether `check` says that a run may end so."""
    told, words = checks.computed(made), " ".join(checks.warnings(made))
    if status in ("at rest", "creeping", "aloft"):
        return "ends early" in told
    return status == "horizon" and "history.horizon" in words


def run_briefly(made):
    """A run with a bound on its steps."""
    build = engine.Engine.__init__

    def bounded(self, *args):
        build(self, *args)
        self.problem = self.problem._replace(max_steps=MOST_STEPS)
        if made.solver.dt is not None:
            self.end = min(self.end, MOST_STEPS * made.solver.dt)
            self.problem = self.problem._replace(end=min(self.problem.end, self.end))

    with mock.patch.object(engine.Engine, "__init__", bounded), np.errstate(all="ignore"):
        return saltation.run(made)


def verify(content):
    """Refused in one sentence, or flown to its end; the status, for statistics."""
    try:
        made = scene_of(content)
    except SceneError as error:
        text = str(error)
        assert text and "\n" not in text and "seconds" not in text and "Traceback" not in text, text
        return "refused"
    if made.solver.dt is not None and made.solver.dt > 0.1 * min(engine.relaxation(made), made.numbers.reynolds * made.numbers.density_ratio / 60.0):
        return "stiff"  # fixed steps are stable for such steps alone
    checks.numbers(made), checks.left_out(made)
    result = run_briefly(made)
    path = result.trajectory if result.path is not None else None
    bounded = result.message == "too many steps" or made.solver.dt is not None
    if result.status == "finished":
        if made.run.jumps is not None and not bounded:
            assert len(result.all_jumps) == made.run.jumps
        numbers = result.all_jumps.drop(columns=["velocity", "spin"]).to_numpy()
        assert np.isfinite(numbers).all()
        if path is not None:
            assert np.isfinite(np.stack([path[name] for name in path if name in "xyzuvw"])).all()
            if made.run.duration is not None and not bounded:
                assert float(path["time"][-1]) == pytest.approx(made.run.duration / made.numbers.time, rel=1e-9)
    elif not bounded:
        assert announced(made, result.status), (result.status, result.message)
    return result.status if not bounded else "bounded"


@pytest.mark.sweep
@settings(max_examples=settings().max_examples + settings().max_examples // 2, deadline=None)
@example(  # stopped within 5e-6 d/V by the wall alone
    {
        "effects": ["wall"],
        "grain": {"diameter": 1e-6, "density": 31.62},
        "dimensions": 2,
        "solver": {"rtol": 1e-2},
        "run": {"duration": 1.0},
    }
)
@given(contents())
def test_ends_as_asked(content):
    verify(content)


def test_flights_know_no_bound_without_a_bed():
    """A limit that nothing reads says so."""
    made = scene_of({"effects": ["weight"], "grain": {"diameter": 1e-3}, "run": {"duration": 1.0, "longest_flight": 5.0}})
    assert math.isinf(made.longest_flight) and any("longest_flight is ignored" in text for text in checks.warnings(made))
    assert layout.ALOFT != layout.JUMPS and run_briefly(made).status == "finished"
