"""Equations with memory: y' = f(t, y) − c·H[y]."""

from basset.solvers._solve import solve
from basset.solvers.base import Method, Path, Solution
from basset.solvers.collocation import Collocation
from basset.solvers.fixed_step import FixedStep, RungeKutta4

__all__ = ["Collocation", "FixedStep", "Method", "Path", "RungeKutta4", "Solution", "solve"]
