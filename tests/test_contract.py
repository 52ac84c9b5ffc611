"""Names that scenes, scripts and other people's code use: they stay."""

from __future__ import annotations

import importlib

from all_cases import each
from click.testing import CliRunner

import basset
import saltation

LIBRARY = (
    "BassetKernel MeiAdrianKernel MeiAdrianKernel.dorgan_loth VaryingSlipKernel EulerMaclaurin Brush SemiDerivative Daitche Windowed "
    "Hinsberg Exponential SCHEMES integrate cumulate ExponentialSum.fit ExponentialSum.van_hinsberg ExponentialSum.casas "
    "ExponentialSum.max_relative_error solve Collocation FixedStep RungeKutta4 maxey_riley Flow.from_dataset advise Rule.weights Rule.plan Rule.error_order "
    "Daitche.references reference.cosine problems.PROBLEMS measure.interleaved kernels.Kernel "
    "streaming.Plan.start streaming.Plan.push streaming.Plan.value streaming.Plan.tail streaming.Plan.local streaming.Plan.jump streaming.Plan.run"
)
SIMULATOR = "load run open campaign Scene.model_validate Result.jumps Result.trajectory Result.save Result.summary Result.to_si select_scheme compare"
SCHEMES = {"semi_derivative", "euler_maclaurin", "brush", "daitche", "hinsberg", "windowed", "exponential"}
COMMANDS = {
    "basset.cli": "advise compare weights sum history warmup",
    "saltation.cli": "run check campaign advise ablate uncertainty scheme compare plot schema scenes warmup",
}


@each("package, name", [*((basset, name) for name in LIBRARY.split()), *((saltation, name) for name in SIMULATOR.split())])
def test_a_name_is_there(package, name):
    first, *parts = name.split(".")
    thing = getattr(package, first, None) or importlib.import_module(f"{package.__name__}.{first}")
    for part in parts:
        thing = getattr(thing, part)
    assert thing is not None


def test_schemes_keep_their_names():
    assert set(basset.SCHEMES) >= SCHEMES


@each("module", COMMANDS)
def test_commands_are_known(module):
    said = CliRunner().invoke(importlib.import_module(module).main, ["--help"]).output
    assert [name for name in COMMANDS[module].split() if f"  {name} " not in said] == []
