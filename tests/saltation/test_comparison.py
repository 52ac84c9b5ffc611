"""A measured motion against a scene: what is read, how it is compared, and that fits and their intervals hold, for exact motions with noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scene_cases import flown, linear, merged, scene
from scipy import stats

import saltation
from basset import reference
from saltation import cli
from saltation.plots.records import comparison as drawn
from saltation.study import comparison, records
from saltation.study.comparison import compare
from saltation.study.least_squares import LeastSquares
from saltation.study.records import noise_of, quantity_of, read_record

E = 0.8
TIMES = np.linspace(0.0, 0.15, 61)  # s: four contacts


def bouncer(**changes):
    """A heavy sphere that is dropped on a flat bed."""
    return scene("bouncing", **merged({"solver": {"rtol": 1e-5}, "grain": {"density": 7800.0}}, changes))


def exact(times, restitution=E):
    """Height of the centre and velocity (SI) of that sphere up to 0.16 s, in closed form, and times of its contacts."""
    made = bouncer()
    n, gap = made.numbers, made.start.height - 0.5 * made.grain.diameter
    rate, coefficient, gravity = linear(made)
    motion = reference.bouncing(rate, coefficient, gravity, gap / n.diameter, restitution, impacts=8)
    t = np.asarray(times) / n.time
    return motion.height(t) * n.diameter + 0.5 * made.grain.diameter, motion.velocity(t) * n.velocity, np.array(motion.times) * n.time


@pytest.fixture(autouse=True)
def kept(monkeypatch):
    """Flights of the same scene are flown once for all comparisons of a test."""
    flights: dict = {}
    begin = comparison.Problem.__init__

    def begun(self, record, made, *more):
        begin(self, record, made, *more)
        self.flights = flights.setdefault((made.model_dump_json(), self.names, self.by_contact, self.anchor, self.times[-1], self.fall), {})

    monkeypatch.setattr(comparison.Problem, "__init__", begun)


# Reading


@pytest.mark.parametrize(
    ("heading", "meaning"),
    [
        ("z", ("z", 1.0)),
        ("z (mm)", ("z", 1e-3)),
        ("Height_of_centre [cm]", ("z", 1e-2)),
        ("depth/mm", ("z", -1e-3)),
        ("gap, µm", ("gap", 1e-6)),
        ("gap under sphere (m)", ("gap", 1.0)),
        ("vz (m s-1)", ("w", 1.0)),
        ("w / (mm/s)", ("w", 1e-3)),
        ("vz_cm_s", ("w", 1e-2)),
        ("u_x (m·s⁻¹)", ("u", 1.0)),
        ("fall velocity (mm/ms)", ("w", -1.0)),
        ("speed(ms-1)", ("speed", 1.0)),
        ("frame", None),
        ("z_score", None),
        ("v_terminal", None),
    ],
)
def test_a_heading_is_a_quantity_with_its_unit(heading, meaning):
    found = quantity_of(heading)
    assert found == meaning if meaning is None else (found[0] == meaning[0] and found[1] == pytest.approx(meaning[1], rel=1e-15))


@pytest.mark.parametrize("heading", ["z (inch)", "z (mm/s)", "w (mm)", "w (s-1)", "gap (px)"])
def test_a_unit_of_something_else_is_refused(heading):
    with pytest.raises(ValueError, match=r"must be in m.* got the unit"):
        quantity_of(heading)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t,z\n0.0,0.003\n0.5,\n1.0,0.001\n", ()),
        ("t (ms);z (mm)\n0,0;3,0\n500,0;NA\n1000,0;1,0\n", ()),
        ("# made by hand, t and z\n0.0 0.003\n0.5 nan\n1.0 0.001\n", ("t", "z")),
        ("time [s]\tframe\theight_mm\n0.0\t1\t3\n0.5\t2\t\n1.0\t3\t1\n", ()),
        (",depth,time\n0,-0.003,0.0\n1,,0.5\n2,-0.001,1.0\n", ()),
    ],
)
def test_every_dialect_is_the_same_record(tmp_path, text, names):
    path = tmp_path / "record.csv"
    path.write_text(text, encoding="utf-8")
    found = read_record(path, names)
    np.testing.assert_allclose(found.times, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(found.values["z"], [0.003, np.nan, 0.001], rtol=1e-12)
    assert found.depths == ({"z"} if "depth" in text else set())


def test_a_table_of_pandas_is_a_record():
    """Times as a column or as the index; what is missing is missing."""
    table = pd.DataFrame({"t": [0.0, 0.5, 1.0], "w [cm/s]": [0.0, np.nan, 2.0]})
    for given in (table, table.set_index("t")):
        found = read_record(given)
        np.testing.assert_allclose(found.times, table["t"])
        np.testing.assert_allclose(found.values["w"], [0.0, np.nan, 0.02])


def test_a_result_of_the_simulator_is_a_record(tmp_path):
    """In SI by its attributes; the scene that made it follows it."""
    made = scene("settling", solver={"rtol": 1e-5})
    result = flown(made)
    result.save(tmp_path / "made.nc")
    found = read_record(tmp_path / "made.nc")
    np.testing.assert_allclose(found.times, result.trajectory["time"] * made.numbers.time, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.values["w"], result.trajectory["w"] * made.numbers.velocity, rtol=1e-12)
    assert found.values.keys() == {"x", "z", "u", "w"} and "drag_z (m s-2)" in found.left_out
    misfit = compare(tmp_path / "made.nc", made, error={"x": 1e-6, "z": 1e-6, "u": 1e-6, "w": 1e-6}).misfit
    assert misfit.loc["z", "largest"] < 1e-9 and misfit.loc["w", "largest"] < 1e-3 * np.abs(found.values["w"]).max()


def test_the_noise_of_a_record_is_what_is_not_smooth():
    """Of a bouncing sphere on uneven times, in all digits that so many samples give; none of a cubic."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.uniform(0.0, 0.15, 400))
    assert noise_of(t, exact(t)[0] + 1e-4 * rng.normal(size=400)) == pytest.approx(1e-4, rel=0.15)
    assert noise_of(t, 1.0 - 3.0 * t + 2.0 * t**3) < 1e-12
    assert noise_of(t[:6], t[:6]) is None


# The model


def test_the_model_is_the_exact_motion_between_its_nodes():
    """Height and velocity of the closed form, through four contacts; a velocity beside a contact is told apart."""
    z, w, contacts = exact(TIMES)
    found = compare({"t": TIMES, "z": z, "w": w, "gap": z - 1e-3}, bouncer(), error={"z": 1e-6, "gap": 1e-6, "w": 1e-4})
    points = found.points
    assert points["z_residual"].abs().max() < 1e-6  # of 10 mm
    assert points.loc[points["w_counts"], "w_residual"].abs().max() < 2e-4  # of 0.3 m/s
    np.testing.assert_allclose(points["gap_residual"], points["z_residual"], atol=1e-12)
    beside = [np.searchsorted(TIMES, time) for time in contacts if time < TIMES[-1]]
    assert set(np.flatnonzero(~points["w_counts"])) == {k - 1 for k in beside} | set(beside)
    assert points["z_counts"].all()


def test_a_sphere_without_a_bed_and_its_depth():
    """Settling from rest: the closed form, from any zero of the depth."""
    made = scene("settling", solver={"rtol": 1e-5})
    n, (rate, coefficient, gravity) = made.numbers, linear(made)
    t = np.linspace(0.0, 0.08, 40)
    fallen = -reference.settling_height(t / n.time, rate, coefficient, gravity) * n.diameter
    speed = -reference.settling(t / n.time, rate, coefficient, gravity) * n.velocity
    found = compare(
        {"t (ms)": 1e3 * t, "depth (mm)": 1e3 * fallen + 7.0, "fall velocity": speed, "speed": speed}, made, error={"z": 1e-7, "w": 1e-5, "speed": 1e-5}
    )
    assert found.points["z_residual"].abs().max() < 1e-4 * fallen[-1]
    assert found.misfit.loc["w", "largest"] < 1e-3 * speed[-1] and found.misfit.loc["speed", "largest"] < 1e-3 * speed[-1]
    assert any(note.startswith("z: compared up to a constant") for note in found.notes)


def test_a_grain_that_has_come_to_rest_stays_there():
    made = bouncer(bed={"restitution": 0.1})
    found = compare({"t": [0.0, 0.5, 0.6], "z": [0.011, 0.001, 0.001], "w": [0.0, 0.0, 0.0]}, made, error={"z": 1e-6, "w": 1e-5})
    assert found.points["z_residual"].abs().max() < 1e-8
    np.testing.assert_array_equal(found.points["w_model"][1:], 0.0)


# Fits


def fits(count, seed, fields="bed.restitution", noise=2e-4, clean=None, **options):
    """Rows of `bed.restitution` of so many records of the exact motion with noise."""
    rng = np.random.default_rng(seed)
    z = exact(TIMES)[0] if clean is None else clean
    rows = [compare({"t": TIMES, "z": z + noise * rng.normal(size=len(z))}, bouncer(), fields, **options).fitted.loc["bed.restitution"] for _ in range(count)]
    return pd.DataFrame(rows).astype(float, errors="ignore")


def test_the_restitution_comes_back_within_its_interval():
    """Of an exact motion with noise: hits as a binomial of 95 %, estimates that scatter as their standard errors say (χ²), both to one in a thousand."""
    count = 20
    found = fits(count, 1)
    hits = int(((found["low"] <= E) & (found["high"] >= E)).sum())
    assert hits >= stats.binom.ppf(1e-3, count, 0.95)
    scatter = float((((found["value"] - E) / found["standard_error"]) ** 2).sum())
    assert stats.chi2.ppf(5e-4, count) < scatter < stats.chi2.ppf(1.0 - 5e-4, count)
    widths = (found["high"] - found["low"]) / found["standard_error"]
    assert widths.median() == pytest.approx(2.0 * stats.t.ppf(0.975, len(TIMES) - 1), rel=0.05)
    blocks = (found["blocks_high"] - found["blocks_low"]) / (found["high"] - found["low"])
    assert 0.7 < blocks.median() < 1.3  # they agree where the residuals are noise


def test_a_fit_finds_the_least_of_all_minima():
    """Against a scan eight times as fine as its own, of a record of many contacts."""
    rng = np.random.default_rng(5)
    record = {"t": TIMES, "z": exact(TIMES)[0] + 1e-3 * rng.normal(size=len(TIMES))}
    found = compare(record, bouncer(), "bed.restitution", error=1e-3)
    problem = comparison.Problem(read_record(record), bouncer(), {"bed.restitution": (0.6, 0.9)}, None, None, None, 1e-3)
    least = min(LeastSquares(problem).squares(np.array([u])) for u in np.linspace(0.0, 1.0, 97))
    assert (found.misfit.loc["z", "rms"] / 1e-3) ** 2 <= least * (1.0 + 1e-4)


def test_the_clock_and_the_zero_of_a_record_are_fitted_with_the_restitution():
    rng = np.random.default_rng(7)
    z = exact(TIMES)[0]
    record = {"t (ms)": 1e3 * (TIMES + 0.0021) + 500.0, "gap (mm)": 1e3 * (z - 1e-3 + 4e-4 + 1e-4 * rng.normal(size=len(z)))}
    fitted = compare(record, bouncer(), ["bed.restitution", "time", "zero"], start=0.5).fitted
    for name, true in (("bed.restitution", E), ("time", 0.0021), ("zero", 4e-4)):
        assert abs(fitted.loc[name, "value"] - true) < 4.0 * fitted.loc[name, "standard_error"], name
        assert fitted.loc[name, "standard_error"] < {"time": 2e-4, "zero": 4e-5}.get(name, 5e-3)


def test_what_undoes_each_other_is_refused():
    """In still water only the ratio of the densities matters."""
    with pytest.raises(ValueError, match=r"fluid\.density and grain\.density cannot be fitted together"):
        compare({"t": TIMES, "z": exact(TIMES)[0]}, bouncer(), ["fluid.density", "grain.density"], error=1e-4)


def test_a_record_by_its_first_contact():
    """As records of rebounds come: the first contact at 0, nothing known of the fall."""
    z, _, contacts = exact(TIMES)
    found = compare({"t": TIMES - contacts[0], "gap": z - 1e-3}, bouncer(), "bed.restitution", contact=0.0, error=1e-5)
    assert found.fitted.loc["bed.restitution", "value"] == pytest.approx(E, abs=1e-4)
    assert found.misfit.loc["gap", "largest"] < 2e-6


def test_velocities_alone_give_the_restitution():
    """They jump at contacts: the misfit is no continuous function of the restitution."""
    rng = np.random.default_rng(11)
    record = {"t": TIMES, "w": exact(TIMES)[1] + 5e-3 * rng.normal(size=len(TIMES))}
    row = compare(record, bouncer(), "bed.restitution").fitted.loc["bed.restitution"]
    assert abs(row["value"] - E) < 4.0 * row["standard_error"] < 0.05


def test_the_start_is_seen_in_the_record():
    """From the middle of a flight, the velocity there unknown; a restitution above 1 is never tried."""
    made = bouncer(effects=["weight", "drag", "added_mass"], history=None, start={"height": 6e-3, "velocity": [0.0, 0.0, 0.25]})
    t = np.linspace(0.0, 0.12, 49)
    rng = np.random.default_rng(13)
    z = compare({"t": t, "z": np.zeros(49)}, made).points["z_model"] + 2e-5 * rng.normal(size=49)
    still = made.changed(start={"velocity": [0.0, 0.0, 0.0], "height": 1e-2})
    fitted = compare({"t": t, "z": z}, still, ["start.velocity.z", "start.height"]).fitted
    for name, true in (("start.velocity.z", 0.25), ("start.height", 6e-3)):
        row = fitted.loc[name]
        assert row["least"] < row["value"] < row["most"] and abs(row["value"] - true) < 4.0 * row["standard_error"], name


def test_a_wrong_model_is_told_from_noise():
    """A record without history, fitted with it: neighbouring residuals hang together, and the interval from blocks says so."""
    made = bouncer(effects=["weight", "drag", "added_mass"], history=None)
    z = compare({"t": TIMES, "z": np.zeros(len(TIMES))}, made).points["z_model"]
    rng = np.random.default_rng(17)
    found = compare({"t": TIMES, "z": z + 1e-5 * rng.normal(size=len(z))}, bouncer(), "bed.restitution")
    row = found.fitted.loc["bed.restitution"]
    assert row["blocks_high"] - row["blocks_low"] > 1.5 * (row["high"] - row["low"])
    assert sum("are correlated" in note or "times the record's noise" in note for note in found.notes) == 2


def test_a_bound_is_the_end_of_an_interval_and_told():
    z = exact(TIMES, 1.0)[0]
    found = compare({"t": TIMES, "z": z + 1e-3 * np.cos(np.arange(61.0) ** 2)}, bouncer(), {"bed.restitution": (0.0, 0.95)}, error=1e-3)
    row = found.fitted.loc["bed.restitution"]
    assert row["value"] == row["high"] == 0.95
    assert any("end of its range" in note for note in found.notes)


# The command


def invoke(*arguments):
    return CliRunner().invoke(cli.main, ["compare", *map(str, arguments)])


@pytest.fixture
def fallen(tmp_path):
    """A record of the bouncing sphere before its first contact."""
    path = tmp_path / "fall.csv"
    times = np.linspace(0.0, 0.02, 9)
    path.write_text("t (ms),z (mm),frame\n" + "".join(f"{1e3 * t},{1e3 * z},{k}\n" for k, (t, z) in enumerate(zip(times, exact(times)[0], strict=True))))
    return path


def test_the_command_says_misfit_fit_and_what_was_held(fallen, tmp_path):
    for suffix in ("csv", "png"):
        done = invoke(fallen, "bouncing", "--fit", "start.height", "--error", "1e-6", "--output", tmp_path / f"out.{suffix}")
        assert done.exit_code == 0, done.output
        for words in ("rms residual", "start.height", "95 % interval", "bed.restitution = 0.8", "left out: 'frame'", f"written: {tmp_path}/out.{suffix}"):
            assert words in done.output.replace("\n", " ") or words in done.output
    assert list(pd.read_csv(tmp_path / "out.csv")) == ["time", "z", "z_model", "z_residual", "z_counts"]


def test_the_picture_shows_record_model_and_residuals():
    t = np.linspace(0.0, 0.02, 9)
    z, w, _ = exact(t)
    figure = drawn(compare({"t": t, "z": z, "w": w}, bouncer(), error={"z": 1e-6, "w": 1e-3}), "a title")
    assert len(figure.axes) == 4
    np.testing.assert_allclose(figure.axes[0].lines[1].get_ydata(), 1e3 * z)
    assert [axes.get_ylabel() for axes in figure.axes[:2]] == ["height of the centre z (mm)", "velocity up w (mm/s)"]


MISTAKES = {
    "no such record": (["none.csv", "bouncing"], ["none.csv", "No such file"]),
    "no such scene": (["fall.csv", "bounce"], ["bounce", "does not exist"]),
    "no such field": (["fall.csv", "bouncing", "--fit", "bed.restitusion"], ["bed.restitusion", "did you mean 'restitution'?"]),
    "a word": (["fall.csv", "bouncing", "--fit", "bed.roughness"], ["bed.roughness"]),
    "no field": (["fall.csv", "bouncing", "--fit", "restitution"], ["restitution", "table.field"]),
    "of the run": (["fall.csv", "bouncing", "--fit", "run.seed=1,5"], ["run.seed"]),
    "a bad range": (["fall.csv", "bouncing", "--fit", "bed.restitution=0.9,0.1"], ["bed.restitution", "rising"]),
    "a range beyond": (["fall.csv", "bouncing", "--fit", "bed.restitution=0.5,1.5"], ["bed.restitution", "from 0 to 1"]),
    "half a range": (["fall.csv", "bouncing", "--fit", "bed.restitution=0.5"], ["--fit", "LOW,HIGH"]),
    "what changes nothing": (["fall.csv", "bouncing", "--fit", "bed.restitution"], ["bed.restitution", "nothing that it changes"]),
    "one undoes the other": (["fall.csv", "bouncing", "--fit", "time", "--fit", "zero", "--until", "1e-3"], ["times or more"]),
    "a rough bed": (["fall.csv", "sand"], ["bed.roughness", "flat"]),
    "many grains": (["fall.csv", "sand_cloud"], ["cloud"]),
    "two starts": (["fall.csv", "bouncing", "--from", "0", "--contact", "0"], ["--from", "--contact"]),
    "no contact": (["fall.csv", "settling", "--contact", "0"], ["contact", "bed"]),
    "no name": (["bare.csv", "bouncing"], ["bare.csv", "names"]),
    "too many names": (["fall.csv", "bouncing", "--columns", "t,z"], ["fall.csv", "3 columns"]),
    "no time": (["fall.csv", "bouncing", "--columns", "a,z,b"], ["fall.csv", "time"]),
    "no quantity": (["fall.csv", "bouncing", "--columns", "t,a,b"], ["fall.csv", "gap"]),
    "times that fall": (["fall.csv", "bouncing", "--columns", "z,t,b"], ["rise"]),
    "across": (["fall.csv", "bouncing", "--columns", "t,y,b"], ["'y'", "across"]),
    "a unit": (["fall.csv", "bouncing", "--columns", "t,z (inch),b"], ["inch", "mm"]),
    "gap without a bed": (["fall.csv", "settling", "--columns", "t,gap,b"], ["gap", "bed"]),
    "a bad error": (["fall.csv", "bouncing", "--error", "w=1e-3"], ["error", "'w'"]),
    "an error that is none": (["fall.csv", "bouncing", "--error", "small"], ["--error", "small"]),
    "no error": (["fall.csv", "bouncing", "--error", "0"], ["error", "greater than 0"]),
    "an output of another kind": (["fall.csv", "bouncing", "--output", "a.txt"], ["--output", ".csv"]),
    "an end before the start": (["fall.csv", "bouncing", "--until", "-1"], ["fall.csv", "got 0"]),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_one_sentence_and_writes_nothing(fallen, monkeypatch, case):
    monkeypatch.chdir(fallen.parent)
    Path("bare.csv").write_text("0.0,1.0\n1.0,2.0\n")
    arguments, words = MISTAKES[case]
    done = invoke(*arguments, *(() if "--output" in arguments else ("--output", "out.png")))
    assert done.exit_code == 2, done.output
    assert done.stdout == "" and len(done.stderr.strip().splitlines()) == 1
    assert [word for word in words if word not in done.stderr] == [], done.stderr
    assert sorted(path.name for path in Path().iterdir()) == ["bare.csv", "fall.csv"]


def test_it_is_exported():
    assert saltation.compare is compare
    assert "compare" in saltation.__all__ and records.QUANTITIES["gap"][0] == "m"
