"""The Basset history force: quadrature, streams and solvers to a chosen accuracy.

H(t) = f(t_0) K(t − t_0) + ∫ K(t − τ) f'(τ) dτ, for kernels K(s) that behave as s^(-1/2) at short lags, or are bounded.
"""

__version__ = "0.1.0"

from typing import TYPE_CHECKING

from basset._lazy import face

if TYPE_CHECKING:
    from basset.advice import Advice, Candidate, advise
    from basset.evaluate import cumulate, integrate
    from basset.exponentials import ExponentialSum
    from basset.formula import BubbleKernel, FormulaKernel, SlipSphereKernel
    from basset.kernels import BassetKernel, Kernel, MeiAdrianKernel, VaryingSlipKernel
    from basset.particles import Flow, maxey_riley
    from basset.quadrature import (
        SCHEMES,
        Brush,
        Daitche,
        EulerMaclaurin,
        Exponential,
        Hinsberg,
        NewtonCotes,
        Rule,
        SemiDerivative,
        UnknownSchemeError,
        Windowed,
    )
    from basset.solvers import Collocation, FixedStep, RungeKutta4, solve
else:
    _places = {
        **dict.fromkeys(("Advice", "Candidate", "advise"), "advice"),
        **dict.fromkeys(("cumulate", "integrate"), "evaluate"),
        "ExponentialSum": "exponentials",
        **dict.fromkeys(("BubbleKernel", "FormulaKernel", "SlipSphereKernel"), "formula"),
        **dict.fromkeys(("BassetKernel", "Kernel", "MeiAdrianKernel", "VaryingSlipKernel"), "kernels"),
        **dict.fromkeys(("Flow", "maxey_riley"), "particles"),
        **dict.fromkeys(("SCHEMES", "Brush", "Daitche", "EulerMaclaurin", "Exponential", "Hinsberg", "NewtonCotes", "Rule"), "quadrature"),
        **dict.fromkeys(("SemiDerivative", "UnknownSchemeError", "Windowed"), "quadrature"),
        **dict.fromkeys(("Collocation", "FixedStep", "RungeKutta4", "solve"), "solvers"),
    }
    __getattr__, __dir__ = face(__name__, globals(), _places)

__all__ = [
    "SCHEMES",
    "Advice",
    "BassetKernel",
    "Brush",
    "BubbleKernel",
    "Candidate",
    "Collocation",
    "Daitche",
    "EulerMaclaurin",
    "Exponential",
    "ExponentialSum",
    "FixedStep",
    "Flow",
    "FormulaKernel",
    "Hinsberg",
    "Kernel",
    "MeiAdrianKernel",
    "NewtonCotes",
    "Rule",
    "RungeKutta4",
    "SemiDerivative",
    "SlipSphereKernel",
    "UnknownSchemeError",
    "VaryingSlipKernel",
    "Windowed",
    "advise",
    "cumulate",
    "integrate",
    "maxey_riley",
    "solve",
]
