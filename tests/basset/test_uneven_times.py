"""Samples at any times: the uniform rules on uniform times, exact polynomials, declared orders, promises, jumps, gaps, and what is refused."""

from __future__ import annotations

import math

import numpy as np
from all_cases import each
from rule_cases import KERNELS
from stream_cases import history

from basset import Daitche, Exponential, cumulate, integrate

PI = math.pi
ORDERS = (1, 2, 3)
every_order = each("order", ORDERS)
every_input = each("input", ["rate", "slip"])


def jittered(n: int, end: float, seed: int = 0, jitter: float = 0.4) -> np.ndarray:
    """n steps up to `end`, each node moved by up to `jitter` of a step."""
    t = np.arange(n + 1) + np.concatenate([[0.0], np.random.default_rng(seed).uniform(-jitter, jitter, n - 1), [0.0]])
    return t * (end / n)


def scattered(n: int, end: float, seed: int = 0) -> np.ndarray:
    """n + 1 nodes at random: steps of any ratio."""
    return np.sort(np.concatenate([[0.0, end], np.random.default_rng(seed).uniform(0.0, end, n - 1)]))


class TestWeights:
    @every_order
    @every_input
    @each("kernel", KERNELS.values())
    def test_are_the_uniform_ones_on_uniform_times(self, order, input, kernel):
        g, t = np.random.default_rng(order).standard_normal((30, 2)), 0.1 * np.arange(30)
        expected = cumulate(g, 0.1, Daitche(order), kernel, input=input)[1:]
        found = cumulate(g, t=t, rule=Daitche(order), kernel=kernel, input=input)[1:]
        assert np.abs(found - expected).max() < 1e-13 * np.abs(expected).max()

    @every_order
    @each("rule", [Daitche, lambda order: Exponential(order, 1e-13)])
    def test_polynomials_of_the_degree_are_exact(self, order, rule):
        """At every node from that number on, on times at random, whatever their steps; and in one value."""
        t = scattered(60, 3.0, seed=order)
        t[1:4] = 0.05, 0.11, 0.16
        t.sort()
        coefficients = np.array([0.3, -1.0, 0.7, 0.4])[: order + 1]
        g = np.polynomial.polynomial.polyval(t, coefficients)
        exact = history(t, [(0.0, 3.0, coefficients)])
        H = cumulate(g, t=t, rule=rule(order))
        assert np.abs(H - exact)[order:].max() < (1e-13 if rule is Daitche else 2e-12)
        assert abs(integrate(g, t=t, rule=rule(order)) - exact[-1]) < (1e-13 if rule is Daitche else 2e-12)
