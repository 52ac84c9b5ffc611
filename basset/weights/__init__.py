"""The weights of the rules: polynomials, the recipe that a rule answers with, and the table of what was built."""

from basset.weights.table import Recipe, Stencil

__all__ = ["Recipe", "Stencil"]
