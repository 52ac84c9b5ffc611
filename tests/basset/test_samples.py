"""Files of samples: what was written is read, whatever the layout, or refused in a sentence; never other numbers."""

import csv
import io
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from basset import samples

N = 60
T = 0.05 * np.arange(N)
COARSE = 2.0**-17 / (0.01 * (N - 1))  # of a step of 0.01 from float32 at 100
G = np.stack([np.cos(T), np.sin(2.0 * T), np.exp(-T)], axis=1)


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def netcdf(data, **encoding):
    data.to_netcdf("a.nc", engine="scipy", encoding=encoding or None)
    return Path("a.nc")


def text(content, encoding="utf-8"):
    Path("a.csv").write_bytes(content.encode(encoding))
    return Path("a.csv")


def array(values):
    np.save("a.npy", values)
    return Path("a.npy")


def refused(pattern, path, *more):
    with pytest.raises((ValueError, TypeError), match=pattern) as caught:
        samples.read(path, *more)
    sentence = str(caught.value)
    assert "\n" not in sentence and len(sentence) < 300


def is_read(path, values=G, step=0.05, given=None, rtol=1e-12):
    found, dt = samples.read(path, given)
    np.testing.assert_array_equal(found, values)
    assert dt == pytest.approx(step, rel=rtol)


# netCDF: the unit of time


UNITS = {
    "ms": 1e-3,
    "milliseconds": 1e-3,
    "us": 1e-6,
    "s": 1.0,
    "Seconds": 1.0,
    "min": 60.0,
    "minutes": 60.0,
    "h": 3600.0,
    "hours": 3600.0,
    "d": 86400.0,
    "days": 86400.0,
    "minutes since 2001-02-03 04:05:06": 60.0,
    "hours since 1970-01-01": 3600.0,
    "days since 1-1-1": 86400.0,
    "seconds since 2020-01-01T00:00:00Z": 1.0,
    "microseconds since 2000-01-01 00:00": 1e-6,
}


@pytest.mark.parametrize("units", UNITS)
def test_times_are_in_their_unit(units):
    t = xarray.Variable("t", 0.25 * np.arange(N), {"units": units})
    is_read(netcdf(xarray.Dataset({"g": (("t", "x"), G)}, {"t": t})), step=0.25 * UNITS[units])


@pytest.mark.parametrize("units", ["d/u*", "1", "m", "months since 2000-01-01", "year", "fortnights"])
def test_an_unknown_unit_of_time_is_refused(units):
    t = xarray.Variable("time", np.arange(float(N)), {"units": units})
    path = netcdf(xarray.Dataset({"g": (("time", "x"), G)}, {"time": t}))
    refused(r"must have times in .*seconds, minutes, .*got the unit .* for 'time'", path)
    is_read(path, step=0.3, given=0.3)


@pytest.mark.parametrize("step", ["500ms", "1us", "90s", "36h", "7min", "1D"])
@pytest.mark.parametrize("start", ["1850-01-01", "2024-02-28 23:00", None], ids=["1850", "2024", "timedelta"])
def test_dates_and_durations_are_times(step, start):
    t = pd.date_range(start, periods=N, freq=step) if start else pd.timedelta_range("0s", periods=N, freq=step)
    is_read(netcdf(xarray.Dataset({"g": (("time", "x"), G)}, {"time": t})), step=pd.Timedelta(step).total_seconds())


# netCDF: which are the times


def test_the_dimension_of_time_may_stand_anywhere():
    moved = np.moveaxis(G.reshape(N, 3, 1), 0, 1)  # (depth, time, 1)
    for names in (("depth", "time", "one"), ("lev", "t", "x")):
        coordinates = {names[0]: (names[0], [1.0, 2.0, 4.0], {"units": "m"}), names[1]: T}
        is_read(netcdf(xarray.Dataset({"g": (names, moved)}, coordinates)))
        is_read(netcdf(xarray.Dataset({"g": (names, moved)}, coordinates)), step=2.0, given=2.0)


@pytest.mark.parametrize("attributes", [{"axis": "T"}, {"standard_name": "time"}, {"units": "s"}, {"units": "seconds since 2000-01-01"}])
def test_times_are_known_by_their_attributes(attributes):
    plain = xarray.Dataset({"g": (("x", "clock"), G.T)}, {"clock": ("clock", T, attributes), "x": ("x", [0.5, 1.0, 1.5])})
    is_read(netcdf(plain))
    auxiliary = xarray.Dataset({"g": (("x", "obs"), G.T)}, {"clock": ("obs", T, attributes), "obs": np.arange(N), "x": ("x", [0.5, 1.0, 1.5])})
    is_read(netcdf(auxiliary))


def test_times_may_be_a_variable_beside_the_samples():
    is_read(netcdf(xarray.Dataset({"g": (("x", "obs"), G.T), "time": ("obs", 1e3 * T, {"units": "ms"})})))


def test_trajectories_that_share_their_times():
    t = np.tile(T, (3, 1))
    made = xarray.Dataset({"g": (("trajectory", "obs"), G.T)}, {"time": (("trajectory", "obs"), t, {"units": "s"})})
    is_read(netcdf(made))
    t[1] += 0.01
    refused(r"must have the same times in every row of 'time'", netcdf(made.assign_coords(time=(("trajectory", "obs"), t))))
    one = xarray.Dataset({"g": (("trajectory", "obs"), G[:, :1].T)}, {"time": (("trajectory", "obs"), T[None] / 60.0, {"units": "minutes since 2000-01-01"})})
    is_read(netcdf(one), values=G[:, :1])


@pytest.mark.parametrize(
    ("dims", "coordinates"),
    [
        (("trajectory", "obs"), {}),
        (("depth", "x"), {"depth": ("depth", np.arange(float(N)), {"units": "m"})}),
        (("row", "column"), {"row": np.arange(N)}),
        (("t_star", "x"), {"t_star": np.arange(float(N))}),
        (("t", "x"), {"t": ("t", 280.0 + np.arange(N), {"units": "K"})}),
    ],
    ids=["trajectories", "depth", "rows", "another t", "temperature"],
)
def test_what_is_not_known_as_time_is_refused(dims, coordinates):
    path = netcdf(xarray.Dataset({"g": (dims, G)}, coordinates))
    refused(r"must have a coordinate of time along one of its dimensions .*or the step be given", path)
    if dims[0] != "t":
        refused(r"must name its dimension of time t or time, got 'g' with the dimensions", path, 0.1)


def test_two_times_are_refused():
    square = G[:3]
    for first, second in (("t", "time"), ("a", "b")):
        coordinates = {name: (name, [0.0, 1.0, 2.0], {"units": "s"}) for name in (first, second)}
        path = netcdf(xarray.Dataset({"g": ((first, second), square)}, coordinates))
        refused("must have one coordinate of time", path)
    lag = {"lag": ("lag", [0.0, 1.0, 2.0], {"units": "s"})}
    refused("must have one dimension of time, got 'time' and, by 'lag', 'lag'", netcdf(xarray.Dataset({"g": (("time", "lag"), square)}, lag)))


# netCDF: gaps, kinds of numbers


def test_gaps_of_samples_and_of_times_are_refused():
    gappy = G.copy()
    gappy[7, 1] = np.nan
    made = xarray.Dataset({"g": (("x", "t"), gappy.T)}, {"t": T})
    for fill in (None, -999.0, 1e20):
        path = netcdf(made, g={"_FillValue": fill}) if fill else netcdf(made)
        refused(r"must have no missing values in 'g', got 1 of 180, .*: fill the gaps", path)
        refused(r"must have no missing values in 'g'", path, 0.1)
    whole = xarray.Dataset({"g": ("t", np.where(np.arange(N) == 9, -99, 3).astype("i4"))}, {"t": T})
    whole.g.attrs["missing_value"] = np.int32(-99)
    refused(r"must have no missing values in 'g', got 1 of 60, the first in row 9", netcdf(whole))
    times = xarray.Dataset({"g": ("obs", G[:, 0])}, {"time": ("obs", np.where(np.arange(N) == 4, np.nan, T))})
    refused(r"must have no missing values in 'time', got 1 of 60, the first in row 4", netcdf(times, time={"_FillValue": 1e36}))


@pytest.mark.parametrize(("kind", "fill"), [("f8", 9.969209968386869e36), ("f4", 9.969209968386869e36), ("i4", -2147483647), ("i2", -32767)])
def test_what_was_never_written_is_a_gap(kind, fill):
    values = np.arange(N).astype(kind)
    values[5] = fill
    path = netcdf(xarray.Dataset({"g": ("t", values)}, {"t": T}), g={"_FillValue": None})
    refused(r"must have no missing values in 'g', got 1 of 60, the first in row 5", path)


@pytest.mark.parametrize(
    "attributes",
    [{"valid_min": -2.0}, {"valid_range": np.array([-2.0, 2.0])}, {"missing_value": np.array([-999.9, -1.0e9])}, {"missing_value": "-999.9"}],
    ids=["minimum", "range", "two marks", "text"],
)
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_what_its_attributes_call_missing_is_a_gap(attributes, kind):
    """Also where the mark has more digits than what is stored."""
    values = np.where(np.arange(N) == 4, -999.9, G[:, 0]).astype(kind)
    refused("must have no missing values in 'g', got 1 of 60, the first in row 4", netcdf(xarray.Dataset({"g": ("t", values, attributes)}, {"t": T})))


@pytest.mark.parametrize("attributes", [{"axis": "X"}, {"axis": "Z", "units": "m"}, {"standard_name": "depth"}, {"positive": "down"}])
def test_a_coordinate_of_space_is_no_time_whatever_its_name(attributes):
    for name in ("t", "time", "z"):
        path = netcdf(xarray.Dataset({"g": (name, G[:, 0])}, {name: (name, T, attributes)}))
        refused("must have a coordinate of time along", path)
        if name == "z":
            refused("must hold samples in time, got 'g' along 'z'", path, 0.05)


def test_a_wave_period_is_no_time():
    waves = {"standard_name": "sea_surface_wave_period", "units": "s"}
    refused("must have a coordinate of time along", netcdf(xarray.Dataset({"g": ("p", G[:, 0])}, {"p": ("p", T, waves)})))


def test_a_temperature_may_be_the_only_variable():
    is_read(netcdf(xarray.Dataset({"T": ("t", G[:, 0])}, {"t": T})), values=G[:, :1])
    refused("at least two samples, got 'g' without any", netcdf(xarray.Dataset({"g": ("t", G[:0, 0])}, {"t": T[:0]})))


def test_packed_samples_are_unpacked():
    found, dt = samples.read(
        netcdf(xarray.Dataset({"g": ("t", G[:, 0])}, {"t": T}), g={"dtype": "i2", "scale_factor": 1e-4, "add_offset": 0.5, "_FillValue": -32768})
    )
    np.testing.assert_allclose(found[:, 0], G[:, 0], atol=5.1e-5)
    assert dt == pytest.approx(0.05)


def test_times_in_single_precision_are_uniform_to_their_digits():
    """At 100 s a float32 is good to 4e-6 s: more than a ten-thousandth of a step of 0.01 s, less than a hundredth."""
    t = (100.0 + 0.01 * np.arange(N)).astype(np.float32)
    is_read(netcdf(xarray.Dataset({"g": (("t", "x"), G)}, {"t": t})), step=0.01, rtol=COARSE)
    late = (1000.0 + 0.001 * np.arange(N)).astype(np.float32)
    refused(r"uniform, rising times.* rounded by 6\.1e-05 s, too much for a step of 0\.00", netcdf(xarray.Dataset({"g": (("t", "x"), G)}, {"t": late})))
    uneven = np.array([0, 1, 3, 4, 5], dtype=np.float32)
    refused("uniform, rising times", netcdf(xarray.Dataset({"g": ("t", uneven)}, {"t": uneven})))


@pytest.mark.parametrize(
    "content", [b"", b"CDF", b"CDF\x01\x00\x00\x00\x05" + bytes(40), b"\x89HDF\r\n\x1a\n" + bytes(90), b"CDF\x05" + bytes(90), b"a,b\n1,2\n"]
)
def test_what_is_no_netcdf_is_a_sentence(content):
    Path("a.nc").write_bytes(content)
    refused("must be a netCDF-3 file|must hold a variable", Path("a.nc"))


def test_a_cut_netcdf_is_a_sentence():
    whole = netcdf(xarray.Dataset({"g": (("t", "x"), G)}, {"t": T})).read_bytes()
    for size in range(1, len(whole), 37):
        Path("a.nc").write_bytes(whole[:size])
        try:
            found, dt = samples.read(Path("a.nc"))
        except ValueError as error:
            assert "'a.nc'" in str(error)
        else:
            np.testing.assert_array_equal(found, G)
            assert dt == pytest.approx(0.05)


# CSV


FRAME = pd.DataFrame({"t": T, "a": G[:, 0], "b": G[:, 1], "c": G[:, 2]})
WRITTEN = {
    "names": FRAME.to_csv(index=False),
    "pandas' index": FRAME.to_csv(),
    "an index from 1000": FRAME.set_index(np.arange(1000, 1000 + N)).to_csv(),
    "written twice": pd.read_csv(io.StringIO(FRAME.to_csv())).to_csv(),
    "written three times": pd.read_csv(io.StringIO(pd.read_csv(io.StringIO(FRAME.to_csv())).to_csv())).to_csv(),
    "a named index": FRAME.reset_index().to_csv(index=False),
    "frames of a camera": FRAME.rename_axis("Frame").reset_index().to_csv(index=False),
    "times as the index": FRAME.set_index("t").to_csv(),
    "times last": FRAME[["a", "b", "c", "t"]].to_csv(index=False),
    "milliseconds": FRAME.assign(t=1e3 * T).rename(columns={"t": "time (ms)"}).to_csv(index=False),
    "minutes": FRAME.assign(t=T / 60.0).rename(columns={"t": "Time [min]"}).to_csv(index=False),
    "microseconds": FRAME.assign(t=1e6 * T).rename(columns={"t": "t_us"}).to_csv(index=False),
    "seconds": FRAME.rename(columns={"t": "t/s"}).to_csv(index=False),
    "tabs": FRAME.to_csv(sep="\t"),
    "semicolons": FRAME.to_csv(sep=";"),
    "decimal commas": FRAME.to_csv(sep=";", decimal=","),
    "decimal commas and tabs": FRAME.to_csv(sep="\t", decimal=",", index=False),
    "spaces": FRAME.to_csv(sep=" "),
    "quoted": FRAME.to_csv(quoting=csv.QUOTE_ALL),
    "quoted, decimal commas": FRAME.to_csv(quoting=csv.QUOTE_ALL, sep=";", decimal=",", index=False),
    "line ends of Windows": FRAME.to_csv(lineterminator="\r\n"),
    "line ends of old": FRAME.to_csv(lineterminator="\r", index=False),
    "a byte-order mark": "\ufeff" + FRAME.to_csv(index=False),
    "a byte-order mark and an index": "\ufeff" + FRAME.to_csv(sep=";", decimal=","),
    "comments": "# measured\n#\n" + FRAME.to_csv(index=False) + "# the end\n\n",
    "row names of R": FRAME.to_csv(sep=" ").replace('"" t', "t", 1).replace(" t", "t", 1),
    "no names": FRAME.to_csv(index=False, header=False),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_what_was_written_as_text_is_read(name):
    is_read(text(WRITTEN[name]))
    if name != "no names":
        is_read(text(WRITTEN[name]), step=0.125, given=0.125)


@pytest.mark.parametrize(("options", "names"), [({}, ""), ({"delimiter": ","}, "t,a,b,c"), ({"delimiter": "\t"}, "time\ta\tb\tc")])
def test_what_numpy_savetxt_writes_is_read(options, names):
    np.savetxt("a.csv", np.column_stack([T, G]), fmt="%.17g", header=names, **options)
    is_read(Path("a.csv"))
    if names:
        is_read(Path("a.csv"), step=2.0, given=2.0)


def test_names_in_a_comment_say_what_is_time():
    np.savetxt("a.csv", np.column_stack([G, 1e3 * T]), fmt="%.17g", header="a,b,c,time (ms)", delimiter=",")
    is_read(Path("a.csv"))


ODD = {
    "no time by name": ("x,g\n0,1\n1,2\n2,4\n", r"must have one column named t or time, or the step be given, got the columns \['x', 'g'\]"),
    "an index, no time": (",g\n0,1\n1,2\n2,4\n", r"must have one column named t or time"),
    "two times": ("t,time,g\n0,0,1\n1,1,2\n2,2,4\n", r"must have one column named t or time.* \['t', 'time'\]"),
    "an unknown unit": ("time (d/u*),g\n0,1\n1,2\n2,4\n", r"must have times in .*got the unit 'd/u\*'"),
    "times alone": ("t\n0\n1\n2\n", "must hold samples beside times"),
    "an index without name": ("0,0.0,1\n1,0.1,2\n2,0.2,4\n", r"two columns that rise evenly, the first of which counts rows"),
    "too few names": ("t;g\n0;1;2;3\n1;2;3;4\n", r"a name for every column, got 2 names for 4 columns"),
    "words": ("t\tg\n0\t1\n1\ta\n", r"must have 2 numbers in every row, separated by tabs, got '1\\ta' in row 3"),
    "an unknown separator": ("0:1\n1:2\n", r"separated by semicolons, tabs, commas, bars, spaces, got '1:2' in row 2"),
    "both decimal signs": ("t;g\n0,5;1.5\n1,5;2.5\n", r"separated by semicolons and with one decimal sign, got '0,5;1\.5' in row 2"),
    "grouped thousands": ("t;g\n0;1.234,5\n1;2.345,5\n", r"must have 2 numbers in every row"),
    "an empty cell": ("t,g\n0,1\n1,\n2,3\n", r"must have 2 numbers in every row, .*got '1,' in row 3"),
    "not available": ("t,g\n0,1\n1,NA\n2,3\n", r"must have 2 numbers in every row, .*got '1,NA' in row 3"),
    "dates": ("time,g\n2020-01-01 00:00,1\n2020-01-01 00:01,2\n", r"must have 2 numbers in every row"),
    "open quotes": ('t,g\n"0,1\n1,2\n', "must be a table"),
    "underscores": ("t,g\n0,1_0\n1,2_0\n", "must have 2 numbers"),
}


@pytest.mark.parametrize("first", ["1.0,NA", "1.0,", ",1.0", "1.0,\u22121.5", "1.0,2.0x", "1.0,n/a", "--,1.0", "None,<NA>"])
def test_a_first_row_with_a_gap_is_no_row_of_names(first):
    """It would be lost without a word where the step is given."""
    refused(r"must have 2 numbers in every row, .* in row 1", text(f"{first}\n2.0,3.0\n4.0,1.0\n3.0,3.0\n"), 0.05)


def test_numbers_that_pandas_gives_to_columns_are_no_sample():
    frame = pd.DataFrame(G)
    is_read(text(frame.to_csv()), given=0.05)
    for content in (frame.to_csv(index=False), frame[[0, 1]].to_csv(index=False), frame[0].to_csv(index=False)):
        refused("as pandas numbers columns", text(content), 0.05)
    refused("as pandas numbers columns", text(pd.DataFrame(np.column_stack([T + 0.05, G])).to_csv(index=False)))
    is_read(text("0,1\n1,0.5\n2,0.25\n"), values=np.array([[1.0], [0.5], [0.25]]), step=1.0)


@pytest.mark.parametrize("name", ["T", "T (K)", "t_min", "time_s"])
def test_samples_under_a_name_of_times_are_not_dropped(name):
    refused(
        f"must have rising times in the column {re.escape(repr(name))}",
        text(FRAME.rename(columns={"a": name}).to_csv(index=False)),
        0.05,
    )


@pytest.mark.parametrize("name", ["timestamp", "seconds", "elapsed time (s)", "time_utc", "Date", "Clock"])
@pytest.mark.parametrize("place", [1, 3])
def test_times_under_another_name_do_not_become_a_path(name, place):
    frame = FRAME.copy()
    frame.insert(place, name, 1e3 * T)
    refused(f"got the column {re.escape(repr(name))} that rises evenly", text(frame.to_csv(index=False)))
    refused("got the column .* that rises evenly", text(frame.drop(columns="t")[["a", "b", name]].to_csv(index=False)), 0.05)


@pytest.mark.parametrize(
    "content",
    [FRAME.to_csv(index=False).replace("t,a,b,c", "t,a,b"), FRAME[["a", "b"]].to_csv(index=False).replace("a,b", ",b"), "a\n2,00\n1,95\n1,90\n"],
    ids=["one too few", "none for the first", "decimal commas between commas"],
)
def test_a_column_without_a_name_is_no_index_unless_it_counts(content):
    refused("must have a name for every column", text(content), 0.05)


def test_numbers_beyond_all_bounds_are_a_sentence():
    refused("must hold finite times, got inf", text("t,a\n-1e308,1\n0,2\n1e308,3\n"))
    refused("must have 30001 numbers", text("t,a\n" + "0.00," * 30000 + "1\n1,2\n"))


@pytest.mark.parametrize("name", ODD)
def test_odd_text_is_a_sentence(name):
    content, pattern = ODD[name]
    refused(pattern, text(content))


@pytest.mark.parametrize(
    "content", [FRAME.to_csv(index=False, header=False), FRAME.to_csv(header=False), FRAME.rename(columns={"t": "Zeit"}).to_csv(index=False)], ids=range(3)
)
def test_times_that_are_not_known_do_not_become_a_path(content):
    refused("must hold samples alone where the step is given, got a first column.* that rises evenly", text(content), 0.05)


def test_a_ramp_is_no_time_where_the_times_are_known():
    is_read(text(FRAME.assign(a=T).to_csv(index=False)), values=np.column_stack([T, G[:, 1:]]), step=0.05, given=0.05)
    is_read(text("g\n" + "\n".join(map(repr, map(float, T)))), values=T[:, None], step=0.5, given=0.5)


# npy


def test_times_of_an_array_are_its_first_column():
    is_read(array(np.column_stack([T, G])))
    is_read(array(G), step=0.1, given=0.1)
    refused("must hold samples alone where the step is given", array(np.column_stack([1e3 * T, G])), 0.05)
    half = np.column_stack([0.05 * np.arange(20), G[:20, 0]]).astype(np.float16)
    refused("must hold samples alone where the step is given", array(half), 0.05)
    refused("at least two samples", array(np.zeros((5, 0))), 0.05)
    refused("first of which counts rows", array(np.column_stack([np.arange(N), T, G])))
    refused("at most two axes", array(G.reshape(N, 3, 1)))
    single = np.column_stack([100.0 + 0.01 * np.arange(N), G[:, 0]]).astype(np.float32)
    is_read(array(single), values=single[:, 1:].astype(float), step=0.01, rtol=COARSE)


def test_several_arrays_in_one_file_are_refused():
    np.savez("a.npz", a=T)
    Path("a.npz").rename("a.npy")
    refused("must be an array that numpy.save wrote, got several arrays", Path("a.npy"))


# Random files


WORDS = {
    "ns": 1e-9,
    "us": 1e-6,
    "ms": 1e-3,
    "milliseconds": 1e-3,
    "s": 1.0,
    "seconds": 1.0,
    "min": 60.0,
    "minutes": 60.0,
    "h": 3600.0,
    "hours": 3600.0,
    "days": 86400.0,
}
finite = st.floats(-1e30, 1e30, allow_subnormal=False)


@st.composite
def datasets(draw):
    """(dataset, encoding, samples (n, columns), step in seconds, may be refused)."""
    n, columns = draw(st.integers(5, 40)), draw(st.integers(1, 3))
    seed = draw(st.integers(0, 2**32 - 1))
    values = np.random.default_rng(seed).normal(size=(n, columns)) * 10.0 ** draw(st.integers(-8, 8))
    number = draw(st.sampled_from(["f8", "f4", "i4", "i2"]))
    values = (values if number[0] == "f" else np.clip(np.rint(values), -30000, 30000)).astype(number)
    name = draw(st.sampled_from(["t", "time", "times", "Time", "obs", "clock", "depth"]))
    attributes = draw(st.sampled_from([{}, {"axis": "T"}, {"standard_name": "time"}, {"axis": "Z"}, {"long_name": "time of the sample"}]))
    kind = draw(st.sampled_from(["float", "single", "int", "date", "duration", "unit", "since"]))
    unit = 1.0
    if kind in ("date", "duration"):
        step = draw(st.sampled_from([1e-6, 1e-3, 0.04, 0.5, 1.0, 60.0, 3600.0, 86400.0, 129600.0]))
        nanoseconds = np.arange(n) * round(step * 1e9)
        epoch = np.datetime64(draw(st.datetimes(pd.Timestamp("1800-01-01"), pd.Timestamp("2200-01-01"))), "ns")
        t = epoch + nanoseconds.astype("m8[ns]") if kind == "date" else nanoseconds.astype("m8[ns]")
        attributes = {key: value for key, value in attributes.items() if key != "units"}
    else:
        step = draw(st.sampled_from([1.0, 2.0, 5.0])) if kind == "int" else draw(st.floats(1e-6, 1e6))
        start = draw(st.sampled_from([0.0, 1.0, -5.0, 1e3, 2e4]))
        t = (start + step * np.arange(n)).astype({"single": "f4", "int": "i4"}.get(kind, "f8"))
        if kind == "unit" or (kind in ("int", "single") and draw(st.booleans())):
            word = draw(st.sampled_from(sorted(WORDS)))
            unit = WORDS[word]
            attributes = {**attributes, "units": word}
        elif kind == "since":
            word = draw(st.sampled_from([word for word in WORDS if len(word) > 3]))
            unit = WORDS[word]
            date = draw(st.sampled_from(["1970-01-01", "2000-1-1 00:00:00", "1850-06-07T08:09:10Z"]))
            attributes = {**attributes, "units": f"{word} since {date}", "calendar": draw(st.sampled_from(["standard", "gregorian", "proleptic_gregorian"]))}
    dims = [name, "x"] if columns > 1 or draw(st.booleans()) else [name]
    made = xarray.DataArray(values.reshape(n, -1) if len(dims) == 2 else values[:, 0], dims=dims, name="g", coords={name: (name, t, attributes)})
    if len(dims) == 2 and draw(st.booleans()):
        made = made.assign_coords(x=("x", np.linspace(0.0, 1.0, columns), {"units": "m", "axis": "X"}))
    if draw(st.booleans()):
        made = made.assign_coords(height=2.0, label=(name, np.arange(n)))
    order = draw(st.permutations(dims))
    made = made.transpose(*order)
    encoding = {}
    gap = number[0] == "f" and draw(st.integers(0, 5)) == 0
    if gap:
        where = draw(st.integers(0, values.size - 1))
        made = made.copy()
        made.values.flat[where] = np.nan
        if draw(st.booleans()):
            encoding["g"] = {"_FillValue": draw(st.sampled_from([-999.0, 1e20]))}
    dropped = draw(st.integers(0, 9)) == 0
    if dropped:
        made = made.drop_vars(name)
    return made.to_dataset(), encoding, values.astype(np.float64), step * unit, gap or dropped


@pytest.mark.sweep
@settings(max_examples=2 * settings().max_examples)
@given(datasets(), st.sampled_from([None, 0.37]))
def test_random_datasets_are_read_as_written_or_refused(made, dt):
    dataset, encoding, values, step, unread = made
    path = netcdf(dataset, **encoding)
    try:
        found, read = samples.read(path, dt)
    except ValueError as error:
        sentence = str(error)
        assert "'a.nc'" in sentence and "\n" not in sentence and len(sentence) < 320
        return
    assert not np.isnan(dataset.g).any()
    np.testing.assert_array_equal(found, values)
    assert read == pytest.approx(step if dt is None else dt, rel=1.1 * samples.COARSE / (len(values) - 1) if dt is None else 0)
    assert not (unread and dt is None)


def known(name):
    return name.split("_")[0] in ("t", "time")


@st.composite
def dialects(draw):
    """(text, samples, step, whether times are named) of a table in some dialect."""
    n, columns = draw(st.integers(3, 30)), draw(st.integers(1, 3))
    values = np.array(draw(st.lists(st.lists(finite, min_size=columns, max_size=columns), min_size=n, max_size=n)))
    step = draw(st.floats(1e-4, 1e4))
    t = draw(st.sampled_from([0.0, -1.0, 10.0])) + step * np.arange(n)
    unit, word = 1.0, ""
    if draw(st.booleans()):
        word = draw(st.sampled_from(sorted(WORDS)))
        unit = WORDS[word]
    base = draw(st.sampled_from(["t", "time", "Time"]))
    name = draw(st.sampled_from([f"{base} ({word})", f"{base} [{word}]", f"{base}/{word}", f"{base}_{word}"])) if word else base
    header = draw(st.sampled_from(["line", "line", "comment", "none"]))
    place = draw(st.integers(0, columns)) if header != "none" else 0
    if header == "none":
        unit = 1.0
    names = [f"g{k}" for k in range(columns)]
    frame = pd.DataFrame(values, columns=names)
    frame.insert(place, name, t)
    separator = draw(st.sampled_from([",", ";", "\t", "|", " "]))
    decimal = draw(st.sampled_from([".", ","])) if separator != "," else "."
    quoting = draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL, csv.QUOTE_NONNUMERIC]))
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    index = header == "line" and draw(st.booleans())
    if index and draw(st.booleans()):
        frame.index = frame.index + draw(st.integers(0, 100))
    content = frame.to_csv(sep=separator, decimal=decimal, quoting=quoting, index=index, header=header == "line", lineterminator=end)
    if header == "comment":
        assume(separator != " " or " " not in name)
        content = f"# {separator.join(frame.columns)}{end}{content}"
    if draw(st.booleans()):
        content = f"# of a measurement{end}{end}{content}"
    if draw(st.booleans()):
        content += f"{end}# the end{end}"
    return draw(st.sampled_from(["", "\ufeff"])) + content, values, step * unit, header != "none"


@pytest.mark.sweep
@settings(max_examples=2 * settings().max_examples)
@given(dialects(), st.sampled_from([None, 0.37]))
def test_random_tables_are_read_as_written_or_refused(made, dt):
    content, values, step, named = made
    path = text(content)
    try:
        found, read = samples.read(path, dt)
    except ValueError as error:
        sentence = str(error)
        assert "'a.csv'" in sentence and "\n" not in sentence and len(sentence) < 320
        assert not named or "uniform" in sentence, sentence
        return
    np.testing.assert_array_equal(found, values)
    assert read == pytest.approx(step if dt is None else dt, rel=1e-9 if dt is None else 0)
