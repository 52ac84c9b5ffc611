"""The rules, kernels and inputs that tests run over: a new rule with defaults is found, any other is one line, a kernel is two."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest

import basset
from basset.quadrature import by_default

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

# rules whose far memory is a sum of exponentials: fitted to the horizon, so their weights depend on it; rates only
TAILED: dict[str, Callable[[float], basset.Rule]] = {
    "exponential_1": lambda window: basset.Exponential(order=1, rtol=1e-4),
    "exponential_3": lambda window: basset.Exponential(order=3, rtol=1e-9),
    "exponential_8": lambda window: basset.Exponential(order=8, rtol=1e-12),
    "published_tail": lambda window: basset.Hinsberg(window=window),
}

# schemes that none of these shows yet, as they are by default
SHOWN = {type(make(1.0)) for make in (RULES | TAILED).values()}
FURTHER = {rule.name: rule for rule in by_default() if type(rule) not in SHOWN}
for name, rule in FURTHER.items():
    if rule.whole != rule:
        TAILED[name] = lambda window, rule=rule: rule
    whole = name if rule.whole == rule else f"whole_{name}"
    RULES[whole] = lambda window, rule=rule.whole: rule
    RULES[f"windowed_{name}"] = lambda window, rule=rule.whole: basset.Windowed(rule, window)

GRAIN = {"slip": 0.1, "diameter": 1e-3, "viscosity": 1e-6}  # sand in water, m/s, m, m²/s: Re = 100
KERNELS: dict[str, basset.Kernel] = {
    "basset": basset.BassetKernel(),
    "mei_adrian": basset.MeiAdrianKernel(**GRAIN),
    "dorgan_loth": basset.MeiAdrianKernel.dorgan_loth(**GRAIN),
}
FITTED = (basset.BassetKernel, basset.MeiAdrianKernel)  # those that sums of exponentials are tabulated for


def exact_steepness(kernel: basset.MeiAdrianKernel) -> mpmath.mpf:
    """C of the Mei–Adrian family with many digits."""
    slip, viscosity = mpmath.mpf(kernel.slip), mpmath.mpf(kernel.viscosity)
    friction = mpmath.mpf("0.75") + mpmath.mpf(kernel.c2) * slip * mpmath.mpf(kernel.diameter) / viscosity
    return mpmath.sqrt(mpmath.pi) / 2 * slip**3 / (viscosity ** mpmath.mpf("1.5") * friction**3)


# class -> K(s) with many digits, written down once more: (kernel, s) -> mpmath number
EXACT_VALUES: dict[type[basset.Kernel], Callable[[Any, mpmath.mpf], mpmath.mpf]] = {
    basset.BassetKernel: lambda kernel, s: 1 / mpmath.sqrt(s),
    basset.MeiAdrianKernel: lambda kernel, s: (
        (1 + (exact_steepness(kernel) * s ** mpmath.mpf("1.5")) ** (1 / mpmath.mpf(kernel.c1))) ** -mpmath.mpf(kernel.c1) / mpmath.sqrt(s)
    ),
}


def accepts(rule: basset.Rule, kernel: basset.Kernel) -> bool:
    """Whether the method has a form for that kernel: semi-derivative and published tail have one for the standard kernel only."""
    published = isinstance(rule, basset.Hinsberg) and "slip" not in rule.inputs
    return isinstance(kernel, basset.BassetKernel) or not (published or isinstance(rule.whole, basset.SemiDerivative))


def with_inputs(names: list[str]) -> list[tuple[str, str]]:
    """(rule name, input) for every input that the rule accepts."""
    return [(name, input) for name in names for input in ANY[name](1.0).inputs]


def window_steps(rule: basset.Rule, dt: float) -> int | None:
    """How many steps the rule remembers; None for all."""
    return rule.recipe(dt, dt, basset.BassetKernel()).window


ANY = RULES | TAILED
FULL = [name for name, make in RULES.items() if window_steps(make(1.0), 1.0) is None]
WINDOWED = [name for name in RULES if name not in FULL]

any_rule = pytest.mark.parametrize("make", ANY.values(), ids=ANY)
tailed_rules = pytest.mark.parametrize("make", TAILED.values(), ids=TAILED)
every_rule = pytest.mark.parametrize("make", RULES.values(), ids=RULES)
full_rules = pytest.mark.parametrize("make", [RULES[name] for name in FULL], ids=FULL)
windowed_rules = pytest.mark.parametrize("make", [RULES[name] for name in WINDOWED], ids=WINDOWED)


def _inputs_mark(names: list[str]) -> pytest.MarkDecorator:
    pairs = with_inputs(names)
    return pytest.mark.parametrize(("make", "input"), [(ANY[name], input) for name, input in pairs], ids=["-".join(pair) for pair in pairs])


any_rule_and_input = _inputs_mark(list(ANY))
every_rule_and_input = _inputs_mark(list(RULES))
full_rules_and_inputs = _inputs_mark(FULL)
windowed_rules_and_inputs = _inputs_mark(WINDOWED)


def samples(n: int, *shape: int, seed: int = 1) -> np.ndarray:
    """n+1 rough samples: nothing smooth for an error to hide behind."""
    return np.random.default_rng(seed).standard_normal((n + 1, *shape))


def refused(error: type[Exception], pattern: str, call, *args, **kwargs) -> None:
    """One sentence, of the right kind."""
    with pytest.raises(error, match=pattern) as caught:
        call(*args, **kwargs)
    sentence = str(caught.value)
    assert "\n" not in sentence
    assert len(sentence) < 300
    assert not isinstance(caught.value, (AssertionError, OverflowError, ZeroDivisionError, IndexError, AttributeError))
