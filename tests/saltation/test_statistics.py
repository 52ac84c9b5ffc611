"""Statistics of jumps against exact values: errors of correlated means, areas of polygons, ranks, exponents."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from saltation import statistics as st

NAN = math.nan


def autoregressive(phi, n, seed):
    """A stationary series x_k = φ x_{k−1} + noise of unit variance."""
    noise = np.random.default_rng(seed).standard_normal(n)
    noise[0] /= math.sqrt(1.0 - phi**2)
    return lfilter([1.0], [1.0, -phi], noise)


def exact_error(phi, n):
    """√Var(x̄) of that series: R(k) = φ^k/(1 − φ²)."""
    k = np.arange(1, n)
    return math.sqrt((1.0 + 2.0 * np.sum((1.0 - k / n) * phi**k)) / n / (1.0 - phi**2))


class TestStandardError:
    # measured over 200 series: 1.03, 0.99, 0.95, 0.93, 0.88 at 600 values; 0.97 at 5000
    @pytest.mark.parametrize(
        ("phi", "n", "low", "high"), [(-0.5, 600, 0.98, 1.09), (0.0, 600, 0.96, 1.02), (0.2, 600, 0.9, 0.99), (0.5, 600, 0.88, 0.97), (0.5, 5000, 0.94, 1.0)]
    )
    def test_autoregressive_series(self, phi, n, low, high):
        ratios = [st.standard_error(autoregressive(phi, n, seed), seed) / exact_error(phi, n) for seed in range(60)]
        assert low < np.mean(ratios) < high

    def test_what_forgets_the_correlation_is_far_too_small(self):
        series = autoregressive(0.5, 600, 3)
        assert st.standard_error(series) > 1.4 * series.std(ddof=1) / math.sqrt(600)

    @pytest.mark.parametrize("seed", range(5))
    def test_independent_values(self, seed):
        values = np.random.default_rng(seed).exponential(size=2000)
        assert st.standard_error(values, resamples=4000) == pytest.approx(values.std(ddof=1) / math.sqrt(2000), rel=0.1)

    @pytest.mark.parametrize(("n", "block"), [(60, 1), (60, 4), (61, 4), (50, 7)])
    def test_draws_have_the_variance_of_the_circular_bootstrap(self, n, block):
        """Independent blocks with uniform starts on the circle: their sums' variances add, and each is a finite sum."""
        x = autoregressive(0.6, n, n)
        x -= x.mean()
        circle = np.concatenate([x, x])

        def variance(length):
            return np.mean([circle[start : start + length].sum() ** 2 for start in range(n)])

        exact = (n // block * variance(block) + variance(n % block)) / n**2
        means = st._resampled_means(x, block, 20_000, np.random.default_rng(0))
        assert np.mean(means**2) == pytest.approx(exact, rel=0.05)

    def test_blocks_of_one_value_give_the_textbook_error(self, monkeypatch):
        monkeypatch.setattr(st, "block_length", lambda values: 1)
        values = [1.0, 2.0, 4.0, 8.0, 3.0]
        assert st.standard_error(values, resamples=50_000) == pytest.approx(np.std(values, ddof=1) / math.sqrt(5), rel=0.02)

    def test_draws_in_portions_are_the_same_draws(self, monkeypatch):
        values = autoregressive(0.5, 300, 0)
        whole = st.standard_error(values)
        monkeypatch.setattr(st, "_DRAWS", 100)
        assert st.standard_error(values) == pytest.approx(whole, rel=1e-12)

    def test_deterministic_in_its_seed(self):
        values = autoregressive(0.5, 300, 0)
        assert st.standard_error(values, 7) == st.standard_error(list(values), seed=7)
        assert st.standard_error(values, 7) != st.standard_error(values, 8)

    def test_scales_and_shifts(self):
        values = autoregressive(0.5, 300, 0)
        assert st.standard_error(100.0 - 3.0 * values) == pytest.approx(3.0 * st.standard_error(values), rel=1e-9)

    def test_few_or_equal_values(self):
        assert math.isnan(st.standard_error([]))
        assert math.isnan(st.standard_error([4.0]))
        assert st.standard_error([0.1] * 7) == 0.0
        assert st.standard_error([1.0, 2.0]) > 0.0

    @pytest.mark.parametrize(
        ("values", "error", "sentence"),
        [
            ([1.0, NAN, NAN], ValueError, r"values must be finite, got nan at position 1 \(and 1 more\)"),
            ([1.0, math.inf], ValueError, r"values must be finite, got inf at position 1"),
            ([[1.0, 2.0]], ValueError, r"values must have one dimension, got the shape \(1, 2\)"),
            (["1", "2"], TypeError, r"values must be an array of real numbers, got \['1', '2'\]"),
            ([True, False], TypeError, r"values must be an array of real numbers"),
            ([[1.0], [1.0, 2.0]], TypeError, r"values must be .* with equal rows"),
        ],
    )
    def test_refused(self, values, error, sentence):
        for function in (st.standard_error, st.block_length):
            with pytest.raises(error, match=sentence):
                function(values)

    def test_refused_draws(self):
        with pytest.raises(ValueError, match="resamples must be a whole number, 2 or greater, got 1"):
            st.standard_error([1.0, 2.0], resamples=1)
        with pytest.raises(ValueError, match="seed must be a whole number, 0 or greater, got -1"):
            st.standard_error([1.0, 2.0], seed=-1)


class TestBlockLength:
    def test_grows_with_the_correlation_and_with_the_number(self):
        mean = {(phi, n): np.mean([st.block_length(autoregressive(phi, n, seed)) for seed in range(30)]) for phi in (0.0, 0.5, 0.8) for n in (200, 600, 5000)}
        assert all(mean[0.0, n] < mean[0.5, n] < mean[0.8, n] for n in (200, 600, 5000))
        assert mean[0.5, 200] < mean[0.5, 600] < mean[0.5, 5000]

    def test_of_an_autoregressive_series(self):
        """G = 2 Σ k φ^k/(1 − φ²) and the spectrum at zero are known: b = (3/2 n (G/g)²)^(1/3) with G/g = 2φ/(1 − φ²)."""
        phi, n = 0.5, 50_000
        exact = (1.5 * n * (2.0 * phi / (1.0 - phi**2)) ** 2) ** (1.0 / 3.0)
        assert st.block_length(autoregressive(phi, n, 1)) == pytest.approx(exact, rel=0.1)

    @pytest.mark.parametrize(("values", "length"), [([], 1), ([3.0], 1), ([3.0] * 50, 1), ([1.0, 2.0], 1)])
    def test_few_or_equal_values(self, values, length):
        assert st.block_length(values) == length

    @pytest.mark.parametrize("n", [2, 3, 5, 10, 30, 100, 1000])
    def test_never_beyond_its_bounds(self, n):
        for seed in range(20):
            assert 1 <= st.block_length(autoregressive(0.95, n, seed)) <= max(1, math.ceil(min(3.0 * math.sqrt(n), n / 3.0)))
        assert 1 <= st.block_length((-1.0) ** np.arange(n)) <= max(1, math.ceil(n / 3))


class TestSummary:
    def test_values(self):
        jumps = pd.DataFrame({"height": [1.0, 2.0, 3.0, 6.0], "length": [5, 5, 5, 5], "grain": [0, 0, 0, 0]})
        table = st.summary(jumps)
        assert list(table.index) == ["height", "length"]
        assert table.index.name == "column"
        assert table.loc["height", "mean"] == 3.0
        assert table.loc["height", "standard_deviation"] == pytest.approx(math.sqrt(14.0 / 3.0))
        assert table.loc["height", "standard_error"] == st.standard_error([1.0, 2.0, 3.0, 6.0])
        assert tuple(table.loc["length"]) == (5.0, 0.0, 0.0, 4)
        assert table["count"].dtype.kind == "i"

    def test_grains_one_after_the_other(self):
        series = np.stack([autoregressive(0.8, 200, seed) for seed in (0, 1)])
        mixed = pd.DataFrame({"velocity": series.T.ravel(), "grain": [0, 1] * 200})
        assert st.summary(mixed).loc["velocity", "standard_error"] == st.standard_error(series.ravel())

    def test_no_jumps_and_one(self):
        for count in (0, 1):
            table = st.summary(pd.DataFrame({"height": np.ones(count)}))
            assert table.loc["height", "count"] == count
            assert table.loc["height", ["standard_deviation", "standard_error"]].isna().all()

    def test_refused(self):
        jumps = pd.DataFrame({"height": [1.0, NAN], "name": ["a", "b"]})
        with pytest.raises(ValueError, match="height must be finite, got nan at position 1"):
            st.summary(jumps)
        with pytest.raises(ValueError, match="columns must name columns of jumps, got 'hieght'; did you mean 'height'"):
            st.summary(jumps, ["hieght"])
        with pytest.raises(TypeError, match=r"columns must be a sequence of names, got the single name 'height': write \['height'\]"):
            st.summary(jumps, "height")
        with pytest.raises(TypeError, match="name must be an array of real numbers"):
            st.summary(jumps, ["name"])
        with pytest.raises(TypeError, match="jumps must be a pandas DataFrame, got 3"):
            st.summary(3)


class TestPairedDifference:
    def test_a_constant_difference_is_certain(self):
        first = autoregressive(0.5, 400, 0)
        mean, error, paired = st.paired_difference(first + 0.25, first)
        assert mean == pytest.approx(0.25)
        assert error < 1e-15
        assert paired

    def test_pairs_that_have_nothing_in_common_lose_nothing(self):
        one, two = autoregressive(0.5, 3000, 0), autoregressive(0.5, 3000, 1)
        pair = st.paired_difference(one, two)
        assert pair.paired
        assert pair.standard_error == pytest.approx(math.sqrt(2.0) * exact_error(0.5, 3000), rel=0.2)

    def test_without_pairs_errors_add_in_squares(self):
        one, two = autoregressive(0.5, 300, 0), autoregressive(0.5, 310, 1)
        mean, error, paired = st.paired_difference(one, two, seed=4, resamples=100)
        assert not paired
        assert mean == pytest.approx(one.mean() - two.mean())
        assert error == pytest.approx(math.hypot(st.standard_error(one, 4, 100), st.standard_error(two, 4, 100)))

    def test_too_few(self):
        assert math.isnan(st.paired_difference([], []).mean)
        assert st.paired_difference([2.0], [1.0]).mean == 1.0
        assert math.isnan(st.paired_difference([2.0], [1.0]).standard_error)
        with pytest.raises(ValueError, match="second must be finite, got nan at position 0"):
            st.paired_difference([1.0], [NAN])


HEADER = "variable,T,mean,sd,n,source"


def written(tmp_path, text, **options):
    path = tmp_path / "measured.csv"
    path.write_bytes(text.encode(**options))
    return path


class TestReference:
    def test_read(self, tmp_path):
        text = f'\ufeff{HEADER}\r\nheight, 1.87 ,1.5,0.4,120,own flume\r\n\r\nlength,1.87,12.0,,,"Niño, table 2"\r\n'
        table = st.read_reference(written(tmp_path, text))
        assert list(table.columns) == HEADER.split(",")
        assert list(table["variable"]) == ["height", "length"]
        assert list(table["T"]) == [1.87, 1.87]
        assert list(table["source"]) == ["own flume", "Niño, table 2"]
        assert table["sd"][0] == 0.4
        assert math.isnan(table["sd"][1])
        assert table["n"][0] == 120
        assert table["n"].isna().tolist() == [False, True]

    def test_columns_in_any_order(self, tmp_path):
        table = st.read_reference(written(tmp_path, "source,n,sd,mean,T,variable\nx,3,0.1,5.5,2.5,velocity\n"))
        assert table.loc[0, ["variable", "T", "mean", "sd", "n", "source"]].tolist() == ["velocity", 2.5, 5.5, 0.1, 3, "x"]

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            ("", r"must begin with the line 'variable,T,mean,sd,n,source', got no line at all"),
            (HEADER, r"must hold at least one measured mean, got the line of column names alone"),
            ("variable,T,mean,sd,n\n", r"must have the columns variable, T, mean, sd, n, source, separated by commas, got none called 'source'"),
            ("variable;T;mean;sd;n;source\n", r"separated by commas, got the column 'variable;T;mean;sd;n;source'"),
            ("variable,T,mean,sdev,n,source\n", r"got the column 'sdev'; did you mean 'sd'"),
            (HEADER + ",R_p\n", r"got the column 'R_p'"),
            (HEADER + ",T\n", r"got the column 'T' twice"),
            (HEADER + "\nheight,1.87,1.5,0.4,120\n", r"line 2 must have 6 fields \(variable, T, mean, sd, n, source\), got 5"),
            (HEADER + "\nhieght,1.87,1.5,0.4,120,x\n", r"line 2: variable must be height, length or velocity, got 'hieght'; did you mean 'height'"),
            (HEADER + "\nheight,0,1.5,0.4,120,x\n", r"line 2: T must be a transport stage greater than 0, got '0'"),
            (HEADER + "\n\nheight,two,1.5,0.4,120,x\n", r"line 3: T must be a transport stage greater than 0, got 'two'"),
            (HEADER + "\nheight,1.87,,0.4,120,x\n", r"line 2: mean must be a number greater than 0, got ''"),
            (HEADER + "\nheight,1.87,nan,0.4,120,x\n", r"line 2: mean must be a number greater than 0, got 'nan'"),
            (HEADER + "\nheight,1.87,1.5,-0.4,120,x\n", r"line 2: sd must be a finite number, 0 or greater, or empty, got '-0.4'"),
            (HEADER + "\nheight,1.87,1.5,inf,120,x\n", r"line 2: sd must be a finite number, 0 or greater, or empty, got 'inf'"),
            (HEADER + "\nheight,1.87,1.5,0.4,12.5,x\n", r"line 2: n must be a whole number, 1 or greater, or empty, got '12.5'"),
            (HEADER + "\nheight,1.87,1.5,0.4,0,x\n", r"line 2: n must be a whole number, 1 or greater, or empty, got '0'"),
            (HEADER + "\nheight,1.87,1.5,0.4,120,\n", r"line 2: source must say where the numbers come from, got an empty field"),
            (HEADER + "\nheight,2,1,0.4,9,x\nheight,2.0,1,,9,x\n", r"line 3 must differ from line 2 in variable, T or source, got height, 2, 'x' again"),
            (HEADER + '\nheight,2,1,0.4,9,"x\n', r"must be a CSV file"),
        ],
    )
    def test_refused(self, tmp_path, text, sentence):
        with pytest.raises(ValueError, match=sentence) as caught:
            st.read_reference(written(tmp_path, text))
        assert "measured.csv" in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_other_files(self, tmp_path):
        with pytest.raises(ValueError, match="must be text in UTF-8"):
            st.read_reference(written(tmp_path, f"{HEADER}\nheight,2,1,0.4,9,Niño\n", encoding="latin-1"))
        with pytest.raises(FileNotFoundError):
            st.read_reference(tmp_path / "missing.csv")


def bands(stages, means, sds, variables=st.VARIABLES):
    """The same band for each variable."""
    rows = [(variable, *row) for variable in variables for row in zip(stages, means, sds, strict=True)]
    return pd.DataFrame(rows, columns=["variable", "T", "mean", "sd"])


class TestErrorIndex:
    def test_rmse_in_closed_form(self):
        assert st.rmse([2.0, 4.0], [1.0, 7.0]) == pytest.approx(math.sqrt((1.0 + 9.0) / 2.0) / 4.0)
        assert st.rmse([3.0, 3.0], [3.0, 3.0]) == 0.0
        observed = np.array([1.0, 2.0, 5.0])
        assert st.rmse(1.1 * observed, observed) == pytest.approx(0.1 * math.sqrt(10.0) / (8.0 / 3.0))

    def test_index_is_the_mean_over_variables(self):
        reference = bands([2.0, 3.0], [1.0, 3.0], [NAN, NAN])
        simulated = bands([3.0, 2.0], [3.0, 1.0], [NAN, NAN])
        assert st.error_index(reference, simulated) == 0.0
        simulated.loc[simulated["variable"] == "length", "mean"] += 0.6
        assert st.errors(reference, simulated).to_dict() == pytest.approx({"height": 0.0, "length": 0.3, "velocity": 0.0})
        assert st.error_index(reference, simulated) == pytest.approx(0.1)

    def test_stages_in_between(self):
        reference = bands([2.5], [7.0], [NAN])
        assert st.error_index(reference, bands([2.0, 4.0], [6.0, 10.0], [1.0, 1.0])) == pytest.approx(0.0)

    def test_refused(self):
        with pytest.raises(ValueError, match="predicted and observed must be pairs, at least one, got 1 and 2 values"):
            st.rmse([1.0], [1.0, 2.0])
        with pytest.raises(ValueError, match="at least one, got 0 and 0"):
            st.rmse([], [])
        with pytest.raises(ValueError, match=r"observed must have a mean greater than 0, .* got 0"):
            st.rmse([1.0, 1.0], [-1.0, 1.0])
        reference = bands([2.0, 3.0], [1.0, 3.0], [0.1, 0.1])
        with pytest.raises(ValueError, match=r"simulated must have rows for velocity, got them only for .*height"):
            st.error_index(reference, bands([2.0, 3.0], [1.0, 3.0], [0.1, 0.1], ["height", "length"]))
        with pytest.raises(ValueError, match=r"simulated must reach over the reference's stages of height, T = 2 to 3, got 2 to 2.9"):
            st.error_index(reference, bands([2.0, 2.9], [1.0, 3.0], [0.1, 0.1]))
        with pytest.raises(ValueError, match="reference must give one height per stage, got two at T = 2: keep one source"):
            st.error_index(bands([2.0, 3.0, 2.0], [1.0, 3.0, 1.0], [0.1, 0.1, 0.1]), reference)
        with pytest.raises(ValueError, match="reference must have the columns variable, T and mean, got"):
            st.error_index(reference.drop(columns="mean"), reference)
        with pytest.raises(TypeError, match=r"simulated must be a pandas DataFrame, got 'runs.csv'"):
            st.error_index(reference, "runs.csv")


class TestOverlap:
    reference = bands([1.0, 3.0], [1.0, 1.0], [1.0, 1.0])  # 0 to 2 over two units of T

    @pytest.mark.parametrize(
        ("stages", "means", "sds", "overlap"),
        [
            ([1.0, 3.0], [1.0, 1.0], [1.0, 1.0], 100.0),
            ([1.0, 3.0], [2.0, 2.0], [1.0, 1.0], 50.0),
            ([1.0, 3.0], [3.0, 3.0], [1.0, 1.0], 0.0),
            ([1.0, 3.0], [9.0, 9.0], [1.0, 1.0], 0.0),
            ([1.0, 3.0], [1.0, 1.0], [9.0, 9.0], 100.0),
            ([1.0, 3.0], [1.0, 1.0], [0.25, 0.25], 25.0),
            ([1.0, 3.0], [1.0, 1.0], [0.0, 1.0], 50.0),
            ([1.0, 3.0], [-1.0, 3.0], [1.0, 1.0], 50.0),  # a slanted band: two triangles, corners inside the interval
            ([1.0, 3.0], [-4.0, 6.0], [0.0, 0.0], 0.0),
            ([1.0, 3.0], [-3.0, 5.0], [1.0, 1.0], 25.0),  # through and out again: all four edges cross
            ([1.0, 3.0], [1.0, 1.0], [0.0, 2.0], 75.0),  # a wedge: both of its edges cross halfway
            ([1.0, 2.0, 3.0], [1.0, 3.0, 1.0], [1.0, 1.0, 1.0], 50.0),  # away and back
            ([0.0, 2.0, 5.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0], 100.0),  # reaches further
        ],
    )
    def test_polygons(self, stages, means, sds, overlap):
        areas = st.overlap_areas(self.reference, bands(stages, means, sds))
        assert areas.to_numpy() == pytest.approx([overlap] * 3, abs=1e-12)

    def test_index_is_the_mean_of_the_three(self):
        simulated = bands([1.0, 3.0], [1.0, 1.0], [1.0, 1.0])
        simulated.loc[simulated["variable"] == "length", "mean"] = 2.0
        simulated.loc[simulated["variable"] == "velocity", "mean"] = 9.0
        assert st.overlap_areas(self.reference, simulated).to_dict() == {"height": 100.0, "length": 50.0, "velocity": 0.0}
        assert st.overlap_index(self.reference, simulated) == 50.0

    def test_against_sums_over_strips(self):
        rng = np.random.default_rng(5)
        for _ in range(20):
            stages, own = np.sort(rng.uniform(1.0, 4.0, 5)), np.concatenate([[0.9], np.sort(rng.uniform(1.0, 4.0, 4)), [4.1]])
            means, sds, own_means, own_sds = (rng.uniform(low, 2.0, n) for low, n in ((0.0, 5), (0.1, 5), (0.0, 6), (0.1, 6)))
            t = np.linspace(stages[0], stages[-1], 40_001)
            mean, sd, own_mean, own_sd = (np.interp(t, x, y) for x, y in ((stages, means), (stages, sds), (own, own_means), (own, own_sds)))
            common = np.maximum(np.minimum(mean + sd, own_mean + own_sd) - np.maximum(mean - sd, own_mean - own_sd), 0.0)
            expected = 100.0 * np.trapezoid(common, t) / np.trapezoid(2.0 * sd, t)
            assert st.overlap_index(bands(stages, means, sds), bands(own, own_means, own_sds)) == pytest.approx(expected, rel=1e-6, abs=1e-6)

    def test_stages_added_on_straight_lines_change_nothing(self):
        reference, simulated = bands([1.0, 3.0], [1.0, 2.0], [0.5, 0.9]), bands([1.0, 3.0], [2.0, 0.5], [0.2, 1.4])
        stages = [1.0, 1.3, 2.7, 3.0]
        finer = [bands(stages, *(np.interp(stages, [1.0, 3.0], ends) for ends in both)) for both in (([1.0, 2.0], [0.5, 0.9]), ([2.0, 0.5], [0.2, 1.4]))]
        assert st.overlap_index(*finer) == pytest.approx(st.overlap_index(reference, simulated), rel=1e-12)

    def test_refused(self):
        good = self.reference
        with pytest.raises(ValueError, match=r"reference must give the sd of height at T = 3 for an overlap area, got none: use error_index"):
            st.overlap_index(bands([1.0, 3.0], [1.0, 1.0], [1.0, NAN]), good)
        with pytest.raises(ValueError, match=r"simulated must give an sd of 0 or greater, got -1 for height"):
            st.overlap_index(good, bands([1.0, 3.0], [1.0, 1.0], [1.0, -1.0]))
        for reference, count in ((bands([2.0], [1.0], [1.0]), 1), (bands([1.0, 3.0], [1.0, 1.0], [0.0, 0.0]), 2)):
            with pytest.raises(ValueError, match=rf"two stages or more with sd above 0, got {count} stage"):
                st.overlap_index(reference, good)
        with pytest.raises(ValueError, match="mean of simulated must be finite, got nan"):
            st.overlap_index(good, bands([1.0, 3.0], [1.0, NAN], [1.0, 1.0]))


THESIS = {  # Tables 3-5 and 3-6, Sets 1 to 4: overlap index (R_p 73), error index (R_p 250; for Run A the table repeats 3-5)
    "A": ([53.98, 14.52, 48.72, 53.31], [NAN] * 4),
    "D": ([18.60, 44.63, 76.61, 64.94], [3.92, 1.70, 25.13, 30.89]),
    "E": ([34.83, 62.18, 15.86, 7.68], [3.13, 2.75, 20.59, 23.74]),
    "F": ([29.64, 67.46, 38.38, 23.25], [4.37, 1.96, 5.49, 14.97]),
    "G": ([26.18, 70.82, 49.68, 24.47], [3.73, 1.78, 16.16, 21.24]),
    "H": ([24.57, 62.07, 32.96, 19.26], [3.47, 3.10, 13.49, 17.52]),
}


SCORES = pd.DataFrame({f"{run}{i + 1}": (overlap[i], error[i]) for run, (overlap, error) in THESIS.items() for i in range(4)}, index=["overlap", "error"]).T
ASCENDING = {"overlap": False, "error": True}


class TestRanks:
    def test_the_thesis_models(self):
        """Section 3.4.2: the best of each, D2 the 11th by overlap, and after the mean rank five models with Set 2, D2 the last."""
        ranks = st.rank_models(SCORES, ASCENDING)
        assert ranks["overlap"].idxmin() == "D3"
        assert ranks["error"].idxmin() == "D2"
        assert ranks.loc["G2"].tolist() == [2.0, 2.0]
        assert ranks.loc["D2", "overlap"] == 11.0
        mean = st.mean_rank(SCORES, ASCENDING)
        assert list(mean.index[:5]) == ["G2", "F2", "E2", "H2", "D2"]
        assert list(mean[:5]) == [2.0, 3.0, 4.5, 5.5, 6.0]
        assert set(mean.index[-4:]) == {"A1", "A2", "A3", "A4"}

    def test_ties_directions_and_gaps(self):
        series = pd.Series({"a": 1.0, "b": 1.0, "c": 0.5, "d": NAN})
        ranks = st.rank_models(series, True)["score"]
        assert ranks[["a", "b", "c"]].tolist() == [2.5, 2.5, 1.0]
        assert math.isnan(ranks["d"])
        assert st.rank_models(series, ascending=False)["score"].tolist()[:3] == [1.5, 1.5, 3.0]
        mean = st.mean_rank(pd.DataFrame({"x": series, "y": [1.0, 2.0, 3.0, 4.0]}), True)
        assert list(mean.index[:3]) == ["a", "c", "b"]
        assert mean.index[-1] == "d"
        assert math.isnan(mean["d"])

    def test_refused(self):
        with pytest.raises(ValueError, match=r"ascending must say True or False for each of \['overlap', 'error'\], got \['overlap'\]"):
            st.rank_models(SCORES, {"overlap": False})
        with pytest.raises(TypeError, match=r"ascending must be True .* got 'yes'"):
            st.rank_models(SCORES, "yes")
        with pytest.raises(TypeError, match="scores must be a pandas DataFrame"):
            st.mean_rank([1.0, 2.0], True)
        with pytest.raises(TypeError, match=r"scores must be real numbers, got .* in 'x'"):
            st.rank_models(pd.DataFrame({"x": ["best", "worst"]}), True)


def de_bruijn(n):
    """A cycle of ±1 in which every word of n signs occurs once: the greedy sequence that prefers +1."""
    word, seen, cycle = (-1,) * n, {(-1,) * n}, []
    while True:
        for sign in (1, -1):
            following = (*word[1:], sign)
            if following not in seen:
                break
        else:
            return np.array([*cycle, -1])
        seen.add(following)
        cycle.append(sign)
        word = following


class TestDiffusion:
    def test_one_ballistic_grain(self):
        """x = t²/2 on uneven times, sampled where it was recorded: x(s + τ) − x(s) = s τ + τ²/2, with variance Var(s) τ²."""
        starts, lags = np.array([0.0, 0.3, 0.5, 1.1]), np.array([0.25, 0.5, 1.0, 2.0])
        time = np.unique(np.concatenate([starts, (starts[:, None] + lags).ravel()]))
        moments = st.second_moments(time, np.stack([time**2 / 2.0, 3.0 * time**2, time], axis=1), starts, lags)
        assert moments.shape == (4, 3)
        assert np.allclose(moments[:, 0], np.var(starts) * lags**2, rtol=1e-12)
        assert np.allclose(moments[:, 1], 36.0 * moments[:, 0], rtol=1e-12)
        assert np.allclose(moments[:, 2], 0.0, atol=1e-28)  # a steady speed does not scatter
        gamma, error = st.fit_exponent(lags, moments[:, 0], 0.25, 2.0)
        assert gamma == pytest.approx(1.0, abs=1e-12)
        assert error < 1e-12

    def test_one_brownian_grain(self):
        """Every word of up to nine steps occurs equally often in the walk: the variance at lag k is k exactly."""
        steps = de_bruijn(9)
        assert steps.size == 512
        walk = np.concatenate([[0.0], np.cumsum(np.concatenate([steps, steps[:9]]))])
        lags = np.arange(1.0, 10.0)
        moments = st.second_moments(np.arange(walk.size), walk[:, None], np.arange(512), lags)
        assert np.allclose(moments[:, 0], lags, rtol=1e-12)
        assert st.fit_exponent(lags, moments[:, 0], 1.0, 9.0)[0] == pytest.approx(0.5, abs=1e-12)

    def test_straight_between_samples_and_standing_time(self):
        time, x = [0.0, 1.0, 1.0, 3.0], np.array([[0.0], [2.0], [2.0], [0.0]])
        paths = st.displacements(time, x, [0.0, 0.5, 1.0], [0.0, 0.5, 2.0])
        assert paths.shape == (3, 3, 1)
        assert np.allclose(paths[:, :, 0], [[0.0, 1.0, 1.0], [0.0, 1.0, -0.5], [0.0, -0.5, -2.0]])

    def test_many_ballistic_grains_from_one_point(self):
        rng = np.random.default_rng(0)
        time, speeds, places = np.geomspace(0.1, 50.0, 30) - 0.1, rng.normal(size=(12, 2)), rng.normal(size=(12, 2))
        moments = st.moments_of_grains(time + 7.0, places + time[:, None, None] * speeds)
        assert np.allclose(moments, np.var(speeds, axis=0) * time[:, None] ** 2, rtol=1e-9)
        assert st.fit_exponent(time, moments[:, 1], 0.1, 50.0)[0] == pytest.approx(1.0, abs=1e-9)

    def test_all_walks_of_ten_steps(self):
        walks = np.cumsum(np.array([(0, *signs) for signs in itertools.product((-1.0, 1.0), repeat=10)]).T, axis=0)
        moments = st.moments_of_grains(np.arange(11), walks[:, :, None])
        assert np.allclose(moments[:, 0], np.arange(11), rtol=1e-12)

    @pytest.mark.parametrize("gamma", [0.0, 0.25, 0.47, 1.0])
    def test_fit_of_a_power(self, gamma):
        lags = np.geomspace(0.01, 100.0, 41)
        fitted, error = st.fit_exponent(lags, 3.7 * lags ** (2.0 * gamma), 0.1, 10.0)
        assert fitted == pytest.approx(gamma, abs=1e-12)
        assert error < 1e-12

    def test_standard_error_of_a_line(self):
        """Logarithms −1, 0, 1 with moments bent by b at the middle: residuals b/3·(−1, 2, −1) and slope error √(6 b²/9/2)."""
        lags, bend = np.exp([-1.0, 0.0, 1.0]), 0.3
        gamma, error = st.fit_exponent(lags, np.exp([-1.0, bend, 1.0]), 0.1, 10.0)
        assert gamma == pytest.approx(0.5)
        assert error == pytest.approx(math.sqrt(6.0 * (bend / 3.0) ** 2 / 2.0) / 2.0)

    def test_only_the_range_counts(self):
        lags = np.geomspace(0.1, 100.0, 31)
        moments = np.where(lags < 1.0, lags**2, lags)
        assert st.fit_exponent(lags, moments, 0.1, 0.9)[0] == pytest.approx(1.0)
        assert st.fit_exponent(lags, moments, 1.0, 100.0)[0] == pytest.approx(0.5)

    def test_interval_of_ballistic_members_is_a_point(self):
        lags = np.array([1.0, 2.0, 4.0, 8.0])
        members = np.random.default_rng(0).normal(size=(15, 1)) * lags
        assert st.exponent_interval(lags, members, 1.0, 8.0) == pytest.approx((1.0, 1.0), abs=1e-12)

    def test_interval_covers_the_true_exponent(self):
        """Walks of 40 members: at least 85 % of nominal 95 % intervals hold 1/2 (percentiles of few members are too narrow)."""
        lags = np.array([1, 2, 4, 8, 16, 32, 64])
        hits, widths = 0, []
        for seed in range(100):
            walks = np.cumsum(np.random.default_rng(seed).normal(size=(40, 64)), axis=1)[:, lags - 1]
            low, high = st.exponent_interval(lags, walks, 1.0, 64.0, seed=seed, resamples=100)
            hits += low <= 0.5 <= high
            widths.append(high - low)
        assert 85 <= hits <= 100
        assert 0.02 < np.mean(widths) < 0.3

    def test_members_that_repeat_each_other_need_blocks(self):
        """Each walk four times over in a row: blocks of four see a quarter of the members, and √4 times the width."""
        lags = np.array([1, 2, 4, 8, 16])
        walks = np.repeat(np.cumsum(np.random.default_rng(1).normal(size=(60, 16)), axis=1)[:, lags - 1], 4, axis=0)
        width = [np.subtract(*st.exponent_interval(lags, walks, 1.0, 16.0, block=block, resamples=1000)[::-1]) for block in (1, 4)]
        assert width[1] / width[0] == pytest.approx(2.0, rel=0.25)  # circular blocks cut through the groups of four

    def test_interval_level_and_seed(self):
        lags = np.array([1, 2, 4, 8])
        walks = np.cumsum(np.random.default_rng(2).normal(size=(30, 8)), axis=1)[:, lags - 1]
        wide, narrow = (st.exponent_interval(lags, walks, 1.0, 8.0, level=level) for level in (0.95, 0.5))
        assert wide[0] < narrow[0] < narrow[1] < wide[1]
        assert wide == st.exponent_interval(lags, walks, 1.0, 8.0)
        assert wide != st.exponent_interval(lags, walks, 1.0, 8.0, seed=1)

    def test_refused_paths(self):
        time, x = np.arange(5.0), np.zeros((5, 2))
        for arguments, error, sentence in [
            ((time[::-1], x, [0.0, 1.0], [1.0]), ValueError, "time must hold samples that do not decrease, got"),
            ((time, x[:4], [0.0, 1.0], [1.0]), ValueError, r"positions must have the shape \(samples, k\) with 5 samples as in time, got \(4, 2\)"),
            ((time, x[:, 0], [0.0, 1.0], [1.0]), ValueError, r"positions must have the shape \(samples, k\)"),
            ((time, x, [0.0, 2.0], [2.5]), ValueError, r"starts and starts \+ lags must lie within time, 0 to 4, got 0 to 4.5"),
            ((time, x, [-1.0, 2.0], [1.0]), ValueError, r"must lie within time, 0 to 4, got -1 to 3"),
            ((time, x, [0.0, 1.0], [-1.0]), ValueError, "lags must be 0 or greater, got -1"),
            ((time, x, [0.0, 1.0], []), ValueError, "starts and lags must hold at least one time each, got 2 and 0"),
            ((time, x, [1.0], [1.0]), ValueError, "starts must hold at least two times for a variance, got 1"),
            ((time, x + NAN, [0.0, 1.0], [1.0]), ValueError, r"positions must be finite, got nan at position 0, 0 \(and 9 more\)"),
            ((time, "north", [0.0, 1.0], [1.0]), TypeError, "positions must be an array of real numbers, got 'north'"),
        ]:
            with pytest.raises(error, match=sentence):
                st.second_moments(*arguments)
        for bad in (x, np.zeros((5, 1, 2)), np.zeros((4, 3, 2))):
            with pytest.raises(ValueError, match=r"positions must have the shape \(samples, grains, k\) with 5 samples as in time and two grains or more"):
                st.moments_of_grains(time, bad)

    def test_refused_fits(self):
        lags = np.array([1.0, 2.0, 4.0, 8.0])
        for arguments, error, sentence in [
            ((lags, lags[:3], 1.0, 8.0), ValueError, "lags and moments must have the same length, got 4 and 3"),
            ((lags, lags, 1.0, 3.0), ValueError, "lags must hold three or more between low = 1 and high = 3, got 2"),
            ((lags, lags, 0.0, 8.0), ValueError, "low must be a finite number greater than 0"),
            ((lags, lags, 1.0, "all"), TypeError, "high must be a finite number greater than 0"),
            ((lags, 0.0 * lags, 1.0, 8.0), ValueError, "moments must be greater than 0 .* got 0: without spreading there is no exponent"),
        ]:
            with pytest.raises(error, match=sentence):
                st.fit_exponent(*arguments)
        still = np.zeros((20, 4))
        for members, options, sentence in [
            (still[:, :3], {}, r"members must have the shape \(members, 4\), one column per lag, got \(20, 3\)"),
            (still[:9], {}, "members must be at least 10, ten blocks of 1, got 9"),
            (still, {"block": 3}, "members must be at least 30, ten blocks of 3, got 20"),
            (still, {}, "members must scatter at every lag between 1 and 8 in every draw"),
            (still, {"level": 1.0}, "level must lie between 0 and 1, got 1"),
            (still, {"block": 0}, "block must be a whole number, 1 or greater, got 0"),
        ]:
            with pytest.raises(ValueError, match=sentence):
                st.exponent_interval(lags, members, 1.0, 8.0, **options)
