"""The published coefficients: transcribed without a slip, and losing digits as the paper's formulas must."""

import numpy as np
import pytest

import basset
from basset.reference import product_weights
from bench import published


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("n", [7, 8, 11, 40, 200])
def test_every_row_equals_the_library(degree, n):
    ours = basset.Daitche(degree).weights(n, 1.0)
    assert np.abs(published.daitche(degree, n, "quad") / ours - 1.0).max() < 1e-13


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_smallest_rows_equal_the_library_and_shorter_ones_are_refused(degree):
    n = published.SMALLEST[degree]
    assert np.abs(published.daitche(degree, n, "quad") / basset.Daitche(degree).weights(n, 1.0) - 1.0).max() < 1e-13
    with pytest.raises(ValueError, match="n must be at least"):
        published.daitche(degree, n - 1)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_quad_rows_equal_mpmath(degree):
    n = 30
    exact = np.array([float(w) for w in product_weights(n, range(n + 1), degree)])
    assert np.abs(published.daitche(degree, n, "quad") / exact - 1.0).max() < 1e-15


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("arithmetic", ["double", "extended", "quad"])
def test_whole_rows_and_single_lags_are_the_same_formula(degree, arithmetic):
    lags = np.array([5, 9, 50, 90])
    row = published.daitche(degree, 100, arithmetic)
    assert np.abs(published.daitche_interior(degree, lags, arithmetic) / row[lags] - 1.0).max() < 1e-7


@pytest.mark.parametrize("n", [2, 3, 40, 1000])
def test_hinsberg_and_daitche_of_degree_one_are_the_same_weights(n):
    ours = basset.Daitche(1).weights(n, 1.0)
    assert np.abs(published.hinsberg(n) / ours - 1.0).max() < 2e-15
    assert np.abs(published.daitche(1, n, "quad") / ours - 1.0).max() < 2e-15


@pytest.mark.parametrize(
    ("degree", "lag", "loss"),  # relative errors in double precision, to a factor of about ten either way
    [(1, 10**3, 2e-10), (1, 10**4, 3e-8), (1, 10**6, 9e-5), (2, 10**3, 3e-7), (2, 10**4, 3e-4), (3, 10**3, 6e-5), (3, 10**4, 1.0)],
)
def test_double_precision_loses_digits_with_the_lag(degree, lag, loss):
    lags = np.arange(lag, lag + 20)
    exact = published.daitche_interior(degree, lags, "quad")
    error = np.abs(published.daitche_interior(degree, lags, "double") / exact - 1.0).max()
    assert loss / 20.0 < error < loss * 20.0
    ours = basset.Daitche(degree).weights(lag + 100, 1.0)[lags]
    assert np.abs(ours / exact - 1.0).max() < 1e-15


@pytest.mark.parametrize("n", [3, 4, 5, 40, 1001])
def test_the_oldest_rules_equal_the_library(n):
    for build, rule in (
        (published.euler_maclaurin, basset.EulerMaclaurin()),
        (published.brush, basset.Brush()),
        (published.semi_derivative, basset.SemiDerivative()),
    ):
        assert np.allclose(build(n), rule.weights(n, 1.0), rtol=1e-13, atol=0.0)
