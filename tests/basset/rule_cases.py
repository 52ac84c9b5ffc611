"""The rules, kernels and inputs that the tests of rules run over: a new rule is tested everywhere by adding one line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import basset

EPS = 2.0**-52
ORDERS = range(1, 11)

# name -> rule for a memory of `window` seconds, which rules with the full history ignore
RULES: dict[str, Callable[[float], basset.Rule]] = {
    "euler_maclaurin": lambda window: basset.EulerMaclaurin(),
    "brush": lambda window: basset.Brush(),
    "semi_derivative": lambda window: basset.SemiDerivative(),
    "hinsberg": lambda window: basset.Hinsberg(tail=False),
    **{f"daitche_{p}": lambda window, p=p: basset.Daitche(order=p) for p in ORDERS},
    "windowed_hinsberg": lambda window: basset.Hinsberg(window=window, tail=False),
    "windowed_euler_maclaurin": lambda window: basset.Windowed(basset.EulerMaclaurin(), window),
    "windowed_brush": lambda window: basset.Windowed(basset.Brush(), window),
    "windowed_semi_derivative": lambda window: basset.Windowed(basset.SemiDerivative(), window),
    "windowed_daitche_2": lambda window: basset.Windowed(basset.Daitche(order=2), window),
    "windowed_daitche_5": lambda window: basset.Windowed(basset.Daitche(order=5), window),
}

GRAIN = {"slip": 0.1, "diameter": 1e-3, "viscosity": 1e-6}  # sand in water, m/s, m, m²/s: Re = 100
KERNELS: dict[str, basset.Kernel] = {
    "basset": basset.BassetKernel(),
    "mei_adrian": basset.MeiAdrianKernel(**GRAIN),
    "dorgan_loth": basset.MeiAdrianKernel.dorgan_loth(**GRAIN),
}


def accepts(rule: basset.Rule, kernel: basset.Kernel) -> bool:
    """Whether the method has a form for that kernel: the semi-derivative has one for the standard kernel only."""
    inner = getattr(rule, "rule", rule)
    return isinstance(kernel, basset.BassetKernel) or not isinstance(inner, basset.SemiDerivative)


def with_inputs(names: list[str]) -> list[tuple[str, str]]:
    """(rule name, input) for every input that the rule accepts."""
    return [(name, input) for name in names for input in RULES[name](1.0).inputs]


FULL = [name for name, make in RULES.items() if make(1.0)._window_steps(1.0) is None]
WINDOWED = [name for name in RULES if name not in FULL]

every_rule = pytest.mark.parametrize("make", RULES.values(), ids=RULES)
full_rules = pytest.mark.parametrize("make", [RULES[name] for name in FULL], ids=FULL)
windowed_rules = pytest.mark.parametrize("make", [RULES[name] for name in WINDOWED], ids=WINDOWED)


def _inputs_mark(names: list[str]) -> pytest.MarkDecorator:
    pairs = with_inputs(names)
    return pytest.mark.parametrize(("make", "input"), [(RULES[name], input) for name, input in pairs], ids=["-".join(pair) for pair in pairs])


every_rule_and_input = _inputs_mark(list(RULES))
full_rules_and_inputs = _inputs_mark(FULL)
windowed_rules_and_inputs = _inputs_mark(WINDOWED)


def samples(n: int, *shape: int, seed: int = 1) -> np.ndarray:
    """n+1 rough samples: nothing smooth for an error to hide behind."""
    return np.random.default_rng(seed).standard_normal((n + 1, *shape))
