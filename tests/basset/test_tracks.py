"""History forces along stored tracks: against closed forms, the same in every layout, after a kill, and mistakes in one sentence."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.special
import xarray
from click.testing import CliRunner

import basset
from basset import cli, tracks

SPHERE = {"diameter": 1e-3, "viscosity": 1e-6, "density": 1000.0}
STEADY = SPHERE | {"before": "steady"}
COEFFICIENT = -9.0 / 1e-3 * math.sqrt(1e-6 / math.pi) * 1000.0 * math.pi / 6.0 * 1e-9  # force over H
RTOL = 1e-6


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def one(t, slip, units="s"):
    return xarray.Dataset({"slip": (("obs", "component"), np.reshape(slip, (len(t), -1)))}, {"time": ("obs", t, {"units": units})})


def integral(ds, **settings):
    """H from the force."""
    return tracks.history(ds, **STEADY | settings).history_force.values / COEFFICIENT


def cosine(t):
    """∫ cos τ / √(t − τ) dτ: Fresnel's integrals."""
    s, c = scipy.special.fresnel(np.sqrt(2.0 * t / np.pi))
    return math.sqrt(2.0 * math.pi) * (np.cos(t) * c + np.sin(t) * s)


# closed forms


def test_polynomial_slips_are_met_to_the_promise_at_any_times():
    t = np.sort(np.random.default_rng(3).uniform(0.0, 4.0, 200))
    t[0] = 0.0
    H = integral(one(t, np.stack([t, t**2, 1.0 + t**3], axis=1)))
    exact = np.stack([2.0 * np.sqrt(t), 8.0 / 3.0 * t**1.5, 16.0 / 5.0 * t**2.5], axis=1)
    H[1:3, 2] = exact[1:3, 2]  # two samples have a straight line, three a parabola
    assert (np.abs(H - exact) <= RTOL * exact + 1e-14).all()


@pytest.mark.parametrize("gap", [1e-5, 1e-9])
def test_errors_of_samples_that_nearly_coincide_are_not_magnified(gap):
    """As where two records are merged: an error of 1e-4 of one sample of a pair is a jump and back, whose memory fades."""
    t = np.linspace(0.0, 4.0, 41)
    pair = np.sort(np.append(t, 2.0 + gap))
    slip = np.cos(pair)
    slip[21] += 1e-4
    assert abs(integral(one(pair, slip))[-1, 0] - integral(one(t, np.cos(t)))[-1, 0]) < 1e-4


def test_a_sine_is_met_to_the_promise_and_to_the_order():
    errors = []
    for n, rtol in ((100, 1e-13), (200, 1e-13), (2000, RTOL)):
        t = np.linspace(0.0, 10.0, n + 1)
        off = np.abs(integral(one(t, np.sin(t)), rtol=rtol)[:, 0] - cosine(t))
        errors.append(off[n // 10 :].max())  # the first samples have polynomials of lower degree
    assert errors[0] / errors[1] > 2.0**3.8
    assert errors[2] < RTOL * 2.0 * math.sqrt(10.0)


def test_a_first_slip_is_a_jump_unless_it_was_there_before():
    t = np.linspace(0.0, 2.0, 81)
    ds = one(t, np.stack([0.3 + t, t], axis=1))
    jumped, steady = integral(ds, before="rest"), integral(ds)
    assert jumped[1:, 0] == pytest.approx(2.0 * np.sqrt(t[1:]) + 0.3 / np.sqrt(t[1:]), rel=RTOL)
    assert jumped[0].tolist() == [math.inf, 0.0]
    assert np.abs(steady - 2.0 * np.sqrt(t)[:, None]).max() < RTOL * 2.0 * math.sqrt(2.0)
    found = tracks.history(ds, **SPHERE)
    assert found.history_share[0] == 1.0
    assert found.history_force.units == "N"
    per_mass = tracks.history(ds, diameter=1e-3, viscosity=1e-6, density_ratio=2.5)
    mass = 2500.0 * math.pi / 6.0 * 1e-9
    assert per_mass.history_force.units == "m s-2"
    assert per_mass.history_force.values[1:] * mass == pytest.approx(found.history_force.values[1:], rel=1e-14)


def test_a_track_of_one_sample_and_an_empty_one():
    ds = xarray.Dataset({"slip": (("trajectory", "obs"), [[1.0, np.nan], [np.nan, np.nan]])}, {"time": (("trajectory", "obs"), [[0.0, np.nan]] * 2)})
    found = tracks.history(ds, **SPHERE | {"before": "steady"})
    assert np.array_equal(found.history_force.values[..., 0], [[0.0, np.nan], [np.nan, np.nan]], equal_nan=True)


def test_the_forces_are_those_of_the_particles_equation():
    swirl = basset.maxey_riley(
        lambda t, x: np.array([0.02 * math.sin(30.0 * t), 0.01, 0.0]), (0.0, 0.2), [0.0, 0.0, 0.0], drag="schiller_naumann",
        t_eval=np.linspace(0.0, 0.2, 801), diameter=2e-4, density_ratio=2.65, viscosity=1e-6,
    )  # fmt: skip
    ds = swirl.drop_vars(["force"]).assign(fluid_velocity=swirl.velocity - swirl.slip)
    found = tracks.history(ds.drop_vars("slip"), diameter=2e-4, viscosity=1e-6, density=1000.0, drag="schiller_naumann")
    force = swirl.force.sel(kind="history")
    assert found.history_force.dims == force.dims
    late = slice(80, None)  # the slip that begins at once asks for the finest steps
    assert np.abs(found.history_force - force)[:, late].max() < 1e-4 * np.abs(force).max()
    total = swirl.force.drop_sel(kind="weight").sum("kind")
    share = np.sqrt((force**2).sum("component") / (total**2).sum("component"))
    assert np.abs(found.history_share - share)[:, late].max() < 1e-3


def test_a_way_along_a_parallel_over_the_date_line():
    t = np.arange(0.0, 3600.0, 60.0)
    lon = (179.9 + 1e-4 * t + 180.0) % 360.0 - 180.0
    ds = xarray.Dataset(
        {"lon": ("obs", lon, {"units": "degrees_east"}), "lat": ("obs", np.full(len(t), 60.0), {"units": "degrees_north"})}, {"time": ("obs", t)}
    )
    H = integral(ds, position="lon,lat", fluid="rest", before="rest")[1:]
    speed = 1e-4 * 1852.0 * 60.0 * 0.5
    assert H[:, 0] == pytest.approx(speed / np.sqrt(t[1:]), rel=1e-5)
    assert np.abs(H[:, 1]).max() < 1e-9
    deep = ds.assign(depth=("obs", 0.01 * t, {"units": "m", "positive": "down"}))
    assert integral(deep, position="lon,lat,depth", fluid="rest", before="rest")[1:, :2] == pytest.approx(H, rel=1e-12)
    for names in ("lat,lon", "lon", "lat", "lon,depth", "depth,lat,lon", "lon,lon"):  # a degree of longitude has no length without the latitude
        with pytest.raises(ValueError, match="position in degrees must name longitude, then latitude"):
            tracks.history(deep, position=names, fluid="rest", **STEADY)
    for name in ("lon", "lat"):
        with pytest.raises(ValueError, match=f"'{name}' must be in m, mm, cm, km or degrees, got the unit ''"):
            tracks.history(ds.assign({name: ds[name].drop_attrs()}), position="lon,lat", fluid="rest", **STEADY)


# layouts


STEPS = (0.1, 0.1, 0.05)  # of three tracks of different lengths, the third one at uneven times
LENGTHS = (40, 33, 50)


@pytest.fixture(scope="module")
def many():
    """Times, velocity, fluid of each track, and what each has by itself."""
    rng = np.random.default_rng(8)
    made = []
    for k, (step, n) in enumerate(zip(STEPS, LENGTHS, strict=True)):
        t = step * np.arange(n) + (rng.uniform(0.0, 0.02, n) if k == 2 else 0.0)
        v = np.stack([np.sin(t + k), np.cos(2.0 * t), t], axis=1)
        u = np.stack([0.9 * np.sin(t), 0.5 * t, 0.0 * t], axis=1)
        alone = xarray.Dataset({"v": (("obs", "xyz"), v), "u": (("obs", "xyz"), u)}, {"time": ("obs", t, {"units": "seconds"})})
        made.append((t, v, u, tracks.history(alone, velocity="v", fluid="u", **SPHERE)))
    return made


def rows(many, fill=np.nan):
    """(trajectory, obs), in minutes, filled behind the ends."""
    size = max(LENGTHS)
    names = ("time", "u", "v", "w", "uf", "vf", "wf")
    data = {name: np.full((len(many), size), fill) for name in names}
    for k, (t, v, u, _) in enumerate(many):
        for name, column in zip(names, (t / 60.0, *v.T, *u.T), strict=True):
            data[name][k, : len(t)] = column
    ds = xarray.Dataset({name: (("trajectory", "obs"), column, {"units": "m/s"}) for name, column in data.items() if name != "time"})
    return ds.assign_coords(time=(("trajectory", "obs"), data["time"], {"units": "minutes since 2020-01-01"}), trajectory=[7, 8, 9][: len(many)])


def in_a_row(many):
    """All samples one after the other, in mm/s."""
    times, v, u = (np.concatenate([made[k] for made in many]) for k in range(3))
    fields = {name: ("obs", 1e3 * column, {"units": "mm s-1"}) for name, column in zip(("u", "v", "w", "uf", "vf", "wf"), (*v.T, *u.T), strict=True)}
    return xarray.Dataset(fields, {"time": ("obs", times / 3600.0, {"units": "hours"})})


def assert_same(force, share, many, slack=2.0 * RTOL):
    for k, (t, *_, alone) in enumerate(many):
        mine, own = force[k][1 : len(t)], alone.history_force.values[1:]
        assert np.abs(mine - own).max() < slack * np.abs(own).max()
        assert np.abs(share[k][: len(t)] - alone.history_share.values).max() < slack
        assert np.isnan(force[k][len(t) :]).all()


def test_rows_of_tracks_in_any_order_and_as_dates(many):
    ds = rows(many)
    whole = np.datetime64("2020-01-01", "ns") + np.round(np.nan_to_num(ds.time.values) * 60e9).astype("timedelta64[ns]")
    dates = ds.assign_coords(time=ds.time.copy(data=np.where(np.isnan(ds.time), np.datetime64("NaT", "ns"), whole)))
    dates.time.attrs.clear()
    for given in (ds, ds.transpose("obs", "trajectory"), dates, ds.isel(trajectory=[2, 0, 1]), ds.chunk(trajectory=2)):
        found = tracks.history(given, **SPHERE).sortby("trajectory").transpose("trajectory", "obs", "component")
        assert_same(found.history_force.values, found.history_share.values, many)
        assert found.time.dtype == given.time.dtype


def test_ragged_arrays_and_a_table(many):
    ds = in_a_row(many)
    contiguous = ds.assign(counts=("drop", np.array(LENGTHS), {"sample_dimension": "obs"}))
    mixed = np.argsort(np.random.default_rng(2).random(sum(LENGTHS)))
    mixed = mixed[np.argsort(ds.time.values[mixed], kind="stable")]
    indexed = ds.assign(index=("obs", np.repeat(range(3), LENGTHS), {"instance_dimension": "drop"})).isel(obs=mixed)
    columns = [np.repeat([30, 10, 20], LENGTHS), 3600.0 * 1e3 * ds.time.values, *(ds[name].values for name in ("u", "v", "w", "uf", "vf", "wf"))]
    names = "particle;time (ms);" + ";".join(f"{name} (mm/s)" for name in ("u", "v", "w", "uf", "vf", "wf"))
    np.savetxt("table.csv", np.stack(columns, axis=1), fmt="%.17g", delimiter=";", header=names, comments="")
    with tracks.files.opened(Path("table.csv"))() as table:
        cases = {"contiguous": (contiguous, [0, 1, 2]), "indexed": (indexed, [0, 1, 2]), "table": (table, [2, 0, 1])}
        for name, (given, order) in cases.items():
            found = tracks.history(given, **SPHERE)
            pieces = np.cumsum(found[{"contiguous": "counts"}.get(name, "row_size")].values)[:-1]
            force, share = np.split(found.history_force.values, pieces), np.split(found.history_share.values, pieces)
            assert_same([force[k] for k in order], [share[k] for k in order], many), name


def test_times_rounded_to_single_precision_are_uniform():
    t = 0.01 * np.arange(2000)
    assert np.abs(integral(one(t.astype(np.float32), np.sin(t)))[:, 0] - cosine(t)).max() < 1e-5


def test_gaps(many):
    ds = rows(many[:2])
    ds["v"][1, 10:13] = np.nan
    with pytest.raises(ValueError, match="must have no gaps, got one after sample 9 of track 1"):
        tracks.history(ds, **SPHERE)
    t, v, u, _ = many[1]
    kept = np.r_[0:10, 13 : len(t)]

    def alone(k):
        return tracks.history(xarray.Dataset({"slip": (("obs", "component"), (v - u)[k])}, {"time": ("obs", t[k])}), **SPHERE).history_force.values

    bridged, split = (tracks.history(ds, gaps=gaps, **SPHERE).history_force.values[1] for gaps in ("bridge", "split"))
    size = np.abs(bridged[kept[1:]]).max()
    assert np.isnan(bridged[10:13]).all()
    assert np.abs(bridged[kept[1:]] - alone(kept)[1:]).max() < 2.0 * RTOL * size
    assert np.abs(split[14 : len(t)] - alone(np.arange(13, len(t)))[1:]).max() < 2.0 * RTOL * size
    assert np.isinf(split[13]).all()


# from file to file


def run(*words):
    return CliRunner().invoke(cli.main, ["history", *map(str, words)])


OPTIONS = ("--diameter", 1e-3, "--density", 1000.0)


def test_the_command_gives_what_the_function_gives(many):
    ds = rows(many)
    ds.to_netcdf("rows.nc", engine="scipy")
    in_a_row(many).assign(counts=("drop", np.array(LENGTHS), {"sample_dimension": "obs"})).to_netcdf("ragged.nc", engine="scipy")
    for name, words in (("rows", ()), ("ragged", ()), ("rows", ("--chunk", 1, "--workers", 2))):
        made = run(f"{name}.nc", "--output", "out.nc", "--force", *OPTIONS, *words)
        assert made.exit_code == 0, made.output
        assert "3 of 3 tracks" in made.output
        with xarray.open_dataset("out.nc", engine="scipy", decode_times=False) as found:
            force, share = found.history_force.values, found.history_share.values
            if name == "ragged":
                pieces = np.cumsum(found["counts"].values)[:-1]
                force, share = np.split(force, pieces), np.split(share, pieces)
                assert found.time.units == "hours"
            else:
                assert found.trajectory.values.tolist() == [7, 8, 9]
                assert np.array_equal(found.time, ds.time, equal_nan=True)
            assert_same(force, share, many)
            told = found.attrs
        assert told["basset_version"] == basset.__version__
        assert f"{name}.nc" in told["source"] and "--density 1000.0" in told["command"]
        assert not list(Path().glob("*.partial"))


def test_killed_it_goes_on_to_the_same_bytes(many):
    ds = xarray.concat([rows(many)] * 4, "trajectory")
    ds.to_netcdf("rows.nc", engine="scipy")
    words = ("rows.nc", "--output", "out.nc", *OPTIONS)
    assert run(*words).exit_code == 0
    whole = Path("out.nc").read_bytes()
    Path("out.nc").unlink()
    killed = """
import os
from basset import cli
cli.PAUSE = -1.0
cli.click.echo = lambda said, err: said.startswith("5 ") and os.kill(os.getpid(), 9)
cli.main()
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", killed, "history", *map(str, words), "--chunk", "1"], env=environment, check=False)
    assert ended.returncode == -9
    assert not Path("out.nc").exists()
    there = Path("out.nc.partial")
    there.write_bytes(there.read_bytes()[:-100])  # as if killed within a record
    assert 0.2 * len(whole) < there.stat().st_size < 0.8 * len(whole)
    refused = run(*words, "--rtol", 1e-5)
    assert (refused.exit_code, len(refused.output.splitlines())) == (2, 1)
    assert run(*words, "--workers", 2, "--chunk", 2).exit_code == 0
    assert Path("out.nc").read_bytes() == whole
    assert not there.exists()


def test_mistakes_are_one_sentence(many):
    rows(many).to_netcdf("rows.nc", engine="scipy")
    one(np.array([0.0, 2.0, 1.0]), np.zeros(3)).to_netcdf("back.nc", engine="scipy")
    rows(many)[["time"]].assign(lon=rows(many).u).to_netcdf("places.nc", engine="scipy")
    one(np.arange(3.0), np.zeros(3)).assign(slip=("obs", np.zeros(3), {"units": "knots"})).to_netcdf("knots.nc", engine="scipy")
    one(np.arange(3.0), np.zeros(3), "fortnights").to_netcdf("fortnights.nc", engine="scipy")
    one(np.arange(3.0), np.zeros(3)).drop_vars("time").to_netcdf("timeless.nc", engine="scipy")
    one(np.arange(3.0), np.array([0.0, math.inf, 2.0])).to_netcdf("endless.nc", engine="scipy")
    Path("words.csv").write_text("time,slip\n0.0,much\n1.0,little\n")
    Path("words.nc").write_text("no netCDF")
    Path("four.nc").write_bytes(b"\x89HDF\r\n\x1a\n")
    Path("rows.zarr").mkdir()
    cases = {
        ("none.nc",): "No such file",
        ("rows.txt",): "must end in .nc, .zarr or .csv",
        ("rows.nc", "--velocity", "uu,v,w"): "velocity must be one of",
        ("rows.nc", "--fluid", "uf"): "the same number of components",
        ("rows.nc", "--slip-variable", "u", "--fluid", "uf"): "slip must be given alone",
        ("rows.nc", "--time", "obs"): "time must be one of",
        ("rows.nc", "--gaps", "ignore"): "gaps must be one of",
        ("rows.nc", "--order", 4): "order must be a whole number from 1 to 3",
        ("rows.nc", "--density-ratio", 2.0): "one of density",
        ("rows.nc", "--workers", 0): "workers must be a whole number, 1 or greater",
        ("rows.nc", "--track", "u"): "for .csv files only",
        ("places.nc",): "must have velocities of particle and fluid",
        ("back.nc",): "times must rise along every track, got 1 s after 2 s in track 0",
        ("knots.nc",): "must be in m/s",
        ("endless.nc", "--gaps", "bridge"): "velocities must be finite, or NaN where they are missing, got an infinite one in track 0",
        ("fortnights.nc",): "fortnights",
        ("timeless.nc",): "must have one time variable",
        ("words.csv",): "words.csv",
        ("words.nc",): "must be a netCDF-3 file",
        ("four.nc",): "the package netCDF4 or h5netcdf must be installed",
        ("rows.zarr",): "the package zarr must be installed",
    }
    with pytest.raises(TypeError, match=r"ds must be an xarray\.Dataset, got 3"):
        tracks.history(3, **STEADY)
    with pytest.raises(TypeError, match="slip must name one to three variables, got 3"):
        tracks.history(one(np.arange(3.0), np.zeros(3)), **STEADY, slip=3)
    numbered = one(np.arange(3.0), np.zeros(3)).assign(whose=("obs", [0, 0, 10**9], {"instance_dimension": "track"}))
    with pytest.raises(ValueError, match="'whose' must number tracks along 'track' from 0 to 1, got 1000000000"):
        tracks.history(numbered.assign_coords(track=("track", [5, 6])), **STEADY)
    tracks.history(numbered, **STEADY)  # names of tracks, as the dataset has no dimension of them
    before = Path("rows.nc").read_bytes()
    same = run("rows.nc", "--output", "./rows.nc", "--force", *OPTIONS)
    assert same.exit_code == 2 and "--output must differ from the file that is read" in same.output and Path("rows.nc").read_bytes() == before
    for words, said in cases.items():
        made = run(words[0], "--output", "out.nc", *OPTIONS, *words[1:])
        assert made.exit_code == 2, (words, made.output)
        assert said in made.output and len(made.output.splitlines()) == 1, (words, made.output)
        assert not list(Path().glob("*out.nc*")), words
