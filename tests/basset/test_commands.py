"""The commands: what each is for; mistakes are one sentence, exit status 2, nothing written."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray
from click.testing import CliRunner

import basset
from basset import __version__, advice, cli, comparison, samples
from basset.problems import PROBLEMS

MACHINE = advice.Machine(2e-5, 3e-5, 5e-9, 2e-8, 8e-11, 6e-11, 6e-9, 1e-8, 2e-9, 2e-8)
T = 0.05 * np.arange(401)
SAMPLES = np.stack([np.cos(T), np.sin(2.0 * T)], axis=1)


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """No calibration, few and short measurements, a folder of our own."""
    monkeypatch.setattr(advice, "calibrated", lambda: MACHINE)
    monkeypatch.setattr(comparison.measure, "interleaved", lambda calls, **_: {name: 1.0 + i for i, name in enumerate(calls)})
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def files():
    np.savetxt("timed.csv", np.column_stack([T, SAMPLES]), delimiter=",", header="t,a,b", comments="")
    np.savetxt("plain.csv", SAMPLES, delimiter=",")
    np.save("timed.npy", np.column_stack([T, SAMPLES]))
    np.save("plain.npy", SAMPLES)
    np.save("slips.npy", np.stack([np.sin(T), 0.5 - 0.5 * np.cos(2.0 * T)], axis=1))
    made = xarray.Dataset({"g": (("t", "x"), SAMPLES), "other": ("t", T)}, coords={"t": T})
    made.to_netcdf("two.nc", engine="scipy")
    made[["g"]].to_netcdf("one.nc", engine="scipy")
    made[["g"]].drop_vars("t").to_netcdf("untimed.nc", engine="scipy")


def run(*words):
    return CliRunner().invoke(cli.main, [str(word) for word in words])


def rows(text):
    return list(csv.DictReader(text.splitlines()))


# advise


ASKED = ("advise", "--error", 1e-6, "--time-scale", 1.0)


def test_advise_ranks_and_says_what_to_take():
    result = run(*ASKED, "--dt", 0.05, "--steps", 10_000, "--particles", 1000)
    best = basset.advise(1e-6, time_scale=1.0, dt=0.05, steps=10_000, particles=1000).best
    assert result.exit_code == 0 and best.code in result.output and "bytes" in result.output


def test_advise_leaves_scenes_to_saltation_scheme():
    """Jumps at takeoffs are not what the error was predicted for: no lines for a scene."""
    output = run(*ASKED, "--duration", 50).stdout
    assert "[history]" not in output and "saltation scheme SCENE" in output and "takeoff" in output


def test_advise_chooses_the_step_and_knows_memory_use_and_kernel():
    result = run(*ASKED, "--duration", 50, "--use", "path", "--memory", 1e7, "--kernel", "mei_adrian", "--slip", 0.1, "--diameter", 1e-3)
    kernel = basset.MeiAdrianKernel(0.1, 1e-3, 1e-6)
    best = basset.advise(1e-6, time_scale=1.0, duration=50, use="path", memory=1e7, kernel=kernel).best
    assert result.exit_code == 0 and f"dt = {best.dt:.6g} s" in result.output and best.code in result.output
    assert "[history]" not in result.output


@pytest.mark.parametrize("more", [("timed.csv",), ("plain.npy", "--sample-step", 0.05), ("slips.npy", "--sample-step", 0.05, "--input", "slip")])
def test_advise_reads_samples(files, more):
    result = run("advise", "--error", 1e-6, "--duration", 100, "--samples", *more)
    assert result.exit_code == 0 and "time scale of the samples: 0.5 s" in result.output


def test_advise_reads_its_samples_by_their_unit(files):
    np.savetxt("minutes.csv", np.column_stack([T / 60.0, SAMPLES]), delimiter=";", header="time (min);a;b", comments="")
    result = run("advise", "--error", 1e-6, "--duration", 100, "--samples", "minutes.csv")
    assert result.exit_code == 0 and "time scale of the samples: 0.5 s" in result.output


# compare


def test_compare_measures_a_problem_and_draws(tmp_path):
    result = run("compare", "growth", "--output", "growth.png")
    assert result.exit_code == 0 and "written: growth.png" in result.output
    assert (tmp_path / "growth.png").read_bytes().startswith(b"\x89PNG") and os.listdir() == ["growth.png"]


@pytest.mark.parametrize(
    "more",
    [
        ("timed.csv",),
        ("plain.csv", "--sample-step", 0.05),
        ("timed.npy",),
        ("plain.npy", "--sample-step", 0.05),
        ("one.nc",),
        ("two.nc", "--variable", "g"),
        ("untimed.nc", "--sample-step", 0.05),
    ],
)
def test_compare_reads_samples_and_finds_the_orders(files, more):
    assert run("compare", *more, "--output", "out.csv").exit_code == 0
    found = rows(Path("out.csv").read_text())
    for order in (1, 2, 3):
        own = {int(row["steps"]): float(row["error"]) for row in found if row["scheme"] == f"Daitche(order={order})"}
        assert sorted(own) == [25, 50, 100, 200, 400]
        assert np.log2(own[100] / own[200]) == pytest.approx(order + 1, abs=0.5)
    assert sorted({float(row["dt"]) for row in found}) == pytest.approx([0.05, 0.1, 0.2, 0.4, 0.8])


def test_slips_are_compared_by_the_schemes_that_take_them(files):
    assert run("compare", "slips.npy", "--sample-step", 0.05, "--input", "slip", "--output", "out.csv").exit_code == 0
    found = rows(Path("out.csv").read_text())
    assert {row["scheme"].split("(")[0] for row in found} == {"SemiDerivative", "Daitche"}
    best = min(float(row["error"]) for row in found)
    rates = comparison.of_samples(SAMPLES, 0.05)
    slips = comparison.of_samples(np.load("slips.npy"), 0.05, "slip")
    np.testing.assert_allclose(slips.exact, rates.exact, atol=1e-8)
    assert best < 1e-6


def test_an_initial_slip_is_in_the_truth(files):
    without, with_slip = comparison.of_samples(SAMPLES, 0.05), comparison.of_samples(SAMPLES, 0.05, initial_slip=2.0)
    t = 0.8 * np.arange(1, 26)
    np.testing.assert_allclose(with_slip.exact - without.exact, np.repeat(2.0 / np.sqrt(t)[:, None], 2, axis=1), rtol=1e-9)


def test_the_truth_of_samples_is_as_good_as_it_says():
    problem = PROBLEMS["growth"]
    t, dt = problem.grid(512)
    subject = comparison.of_samples(problem.rate(t), dt)
    exact = problem.exact(t[1:])[511 // subject.levels[0] :: 512 // subject.levels[0]]
    assert np.abs(subject.exact - exact).max() / np.abs(exact).max() <= subject.uncertainty + 1e-14 < 1e-9


def test_the_cheapest_is_good_enough():
    def record(error, seconds):
        return comparison.Measured(basset.Daitche(1), 10, 0.1, error, seconds)

    records = [record(1e-3, 1.0), record(1e-5, 2.0), record(1e-6, 3.0)]
    assert comparison.cheapest(records, 1e-4) is records[1]
    assert comparison.cheapest(records, 1e-5, uncertainty=1e-6) is records[2]
    assert comparison.cheapest(records, 1e-7) is None


def test_every_problem_can_be_compared():
    for name, problem in PROBLEMS.items():
        subject = comparison.of_problem(problem)
        assert subject.levels[0] == len(subject.exact), name
        assert set(subject.arguments(32)) >= {"g", "dt", "input"}


# weights


@pytest.mark.parametrize(
    "words, rule",
    [
        (("daitche", "--order", 2), basset.Daitche(2)),
        (("brush",), basset.Brush()),
        (("exponential", "--order", 2, "--rtol", 1e-4), basset.Exponential(2, 1e-4)),
        (("hinsberg", "--window", 0.5), basset.Hinsberg(0.5)),
        (("windowed", "--window", 0.5), basset.Windowed(basset.Daitche(3), 0.5)),
    ],
)
def test_weights_are_the_rule_s_with_every_digit(words, rule):
    result = run("weights", *words, "--steps", 12, "--dt", 0.1)
    assert result.exit_code == 0
    found = rows(result.output)
    assert [int(row["j"]) for row in found] == list(range(13))
    assert [float(row["weight"]) for row in found] == list(rule.weights(12, 0.1))


def test_weights_go_to_a_file_and_take_a_tail_and_a_kernel(tmp_path):
    words = ("--kernel", "dorgan_loth", "--slip", 0.1, "--diameter", 1e-3)
    result = run("weights", "windowed", "--order", 2, "--window", 0.5, "--rtol", 1e-5, "--steps", 40, "--dt", 0.1, "--output", "w.csv", *words)
    assert result.exit_code == 0 and os.listdir() == ["w.csv"]
    kernel = basset.MeiAdrianKernel.dorgan_loth(0.1, 1e-3, 1e-6)
    found = [float(row["weight"]) for row in rows((tmp_path / "w.csv").read_text())]
    np.testing.assert_allclose(found, basset.Daitche(2).weights(40, 0.1, kernel), rtol=1e-4)
    assert found != list(basset.Daitche(2).weights(40, 0.1, kernel))


def test_a_dash_is_the_screen(files):
    before = sorted(os.listdir())
    for words in (("weights", "brush", "--steps", 3), ("sum", "--near", 1, "--far", 9, "--rtol", 1e-3, "--format", "c")):
        assert run(*words, "--output", "-").stdout == run(*words).stdout
    assert sorted(os.listdir()) == before
    assert run("weights", "brush", "--steps", 3, "--output", "./-").exit_code == 0 and Path("-").read_text().startswith("j,weight")


# Mistakes


BAD = {
    "netcdf to the screen": (("history", "timed.csv", "--output", "-"), "--output must be the name of a file or folder, got '-'"),
    "picture to the screen": (("compare", "growth", "--output", "-"), "--output must end in .png, .pdf, .svg, .csv, got '-'"),
    "duration": ((*ASKED, "--duration", 1e308), "duration must be 1e+15 time scales of"),
    "dt": ((*ASKED, "--dt", 1e308, "--steps", 3), "dt must be 1000 time scales of"),
    "particles": ((*ASKED, "--duration", 9, "--particles", 10**400), "particles must be a whole number from 1 to"),
    "no error": (("advise", "--time-scale", 1, "--duration", 9), "--error"),
    "error": (("advise", "--error", 0, "--time-scale", 1, "--duration", 9), "error must be"),
    "no scale": (("advise", "--error", 1e-3, "--duration", 9), "either time_scale"),
    "use": ((*ASKED, "--duration", 9, "--use", "pth"), "did you mean 'path'?"),
    "unreachable": ((*ASKED, "--dt", 2.0, "--steps", 9), "take a smaller dt"),
    "memory": ((*ASKED, "--duration", 99, "--memory", 1), "memory must be at least"),
    "kernel": ((*ASKED, "--duration", 9, "--kernel", "bassett"), "did you mean 'basset'?"),
    "kernel without slip": ((*ASKED, "--duration", 9, "--kernel", "mei_adrian"), "--slip (m/s) and --diameter (m) must be given"),
    "slip without kernel": ((*ASKED, "--duration", 9, "--slip", 0.1), "--slip has no meaning"),
    "samples missing": (("advise", "--error", 1e-3, "--samples", "no.csv", "--duration", 9), "--samples: 'no.csv' cannot be used"),
    "input": (("compare", "timed.csv", "--input", "slips"), "did you mean 'slip'?"),
    "problem": (("compare", "fresnell"), "did you mean 'fresnel'?"),
    "problem and kernel": (("compare", "growth", "--kernel", "mei_adrian", "--slip", 1, "--diameter", 1), "--kernel must be basset for a named problem"),
    "output kind": (("compare", "growth", "--output", "a.txt"), "--output must end in .png, .pdf, .svg, .csv"),
    "output folder": (("compare", "growth", "--output", "no/a.png"), "the folder 'no' does not exist"),
    "output read": (
        ("compare", "timed.csv", "--output", "./timed.csv", "--force"),
        "--output must differ from the file that is read, got 'timed.csv' for both",
    ),
    "output there": (("weights", "brush", "--steps", 3, "--output", "timed.csv"), "exists already; --force overwrites it"),
    "file missing": (("compare", "no.npy"), "FILE: 'no.npy' cannot be used"),
    "no times": (("compare", "single.npy"), "must hold times"),
    "variable not named": (("compare", "two.nc"), "must be named: 'g', 'other'"),
    "variable unknown": (("compare", "two.nc", "--variable", "othr"), "did you mean 'other'?"),
    "variable of a csv": (("compare", "timed.csv", "--variable", "a"), "given for .nc files only"),
    "no coordinate": (("compare", "untimed.nc"), "must have a coordinate of time along one of its dimensions 't', 'x'"),
    "no netcdf": (("compare", "wrong.nc"), "must be a netCDF-3 file"),
    "no npy": (("compare", "wrong.npy"), "must be an array that numpy.save wrote"),
    "words in a csv": (("compare", "words.csv"), "must have 2 numbers in every row"),
    "ragged csv": (("compare", "ragged.csv"), "must have 2 numbers in every row"),
    "empty csv": (("compare", "empty.csv"), "must hold samples, got none"),
    "binary csv": (("compare", "binary.csv"), "not UTF-8"),
    "times not uniform": (("compare", "uneven.csv"), "uniform, rising times"),
    "nan": (("compare", "nan.csv"), "must hold finite samples, got nan"),
    "too short": (("compare", "short.csv"), "samples must be at least 33"),
    "zeros": (("compare", "zeros.npy", "--sample-step", 1), "samples must not all be zero"),
    "complex": (("compare", "complex.npy", "--sample-step", 1), "array of real numbers"),
    "step": (("compare", "plain.csv", "--sample-step", -1), "dt must be"),
    "scheme": (("weights", "daitsche", "--steps", 3), "did you mean 'daitche'?"),
    "scheme before what is missing": (("weights", "daitsche"), "did you mean 'daitche'?"),
    "no steps": (("weights", "daitche"), "--steps"),
    "steps": (("weights", "daitche", "--steps", 0), "--steps must be a whole number"),
    "order": (("weights", "daitche", "--steps", 3, "--order", 11), "order must be"),
    "order of brush": (("weights", "brush", "--steps", 3, "--order", 2), "--order has no meaning for 'brush'"),
    "window": (("weights", "windowed", "--steps", 3), "--window (seconds) must be given"),
}


@pytest.mark.parametrize("name", BAD)
def test_mistakes_are_a_sentence_and_write_nothing(files, name):
    np.save("single.npy", T)
    np.save("zeros.npy", np.zeros(100))
    np.save("complex.npy", 1j * T)
    Path("wrong.nc").write_text("no")
    Path("wrong.npy").write_text("no")
    Path("words.csv").write_text("0,1\n1,a\n")
    Path("ragged.csv").write_text("0,1\n1,2,3\n")
    Path("empty.csv").write_text("t,g\n")
    Path("binary.csv").write_bytes(b"\xff\xfe\x00")
    Path("uneven.csv").write_text("0,1\n1,2\n3,3\n")
    Path("nan.csv").write_text("0,1\n1,nan\n2,3\n")
    Path("short.csv").write_text("0,1\n1,1\n2,3\n")
    before = {path: path.read_bytes() for path in Path().iterdir()}
    words, sentence = BAD[name]
    result = run(*words)
    assert result.exit_code == 2 and sentence in result.stderr and "Traceback" not in result.output
    assert result.stdout == "" and {path: path.read_bytes() for path in Path().iterdir()} == before


def test_a_file_whose_times_are_rounded_is_uniform():
    Path("rounded.csv").write_text("\n".join(f"{t:.6f},{t * t}" for t in np.arange(50) / 3.0))
    assert samples.read(Path("rounded.csv"))[1] == pytest.approx(1.0 / 3.0, rel=1e-5)


@pytest.mark.parametrize("charset", ["cp1252", "cp437"])
@pytest.mark.parametrize(
    "words", [("--help",), ("advise", "--help"), ("weights", "--help"), ("compare", "--help"), (*ASKED, "--duration", 9), ("compare", "growth")], ids=range(6)
)
def test_what_an_encoding_lacks_is_escaped(words, charset):
    escaped = CliRunner(charset=charset).invoke(cli.main, [str(word) for word in words])
    assert escaped.exit_code == 0 and escaped.exception is None
    plain = run(*words).stdout

    def letters(text):
        return "".join(text.encode("ascii", "basset.escaped").decode().split())

    assert letters(escaped.stdout) == letters(plain)


def test_the_module_is_a_command():
    result = subprocess.run(
        [sys.executable, "-m", "basset", "--version"], capture_output=True, text=True, check=True, cwd=Path(cli.__file__).resolve().parents[1]
    )
    assert __version__ in result.stdout
