"""Weights of the rules: polynomials, recipes, and the cached table of weights."""

from basset.weights.table import Recipe, Stencil

__all__ = ["Recipe", "Stencil"]
