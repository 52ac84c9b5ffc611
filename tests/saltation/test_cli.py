"""The commands: mistakes are one sentence, exit status 2, nothing written; and what each command is for."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from all_cases import each
from click.testing import CliRunner

import saltation
from basset import __version__
from saltation import cli
from saltation.effects import EFFECTS
from saltation.scene import shipped

FIXED = ["solver.method=fixed_step", "solver.dt=1e-3"]
WINDOWED = [*FIXED, "history.scheme=windowed", "history.window=3.0"]
CLOUD = ["run.jumps=", "run.duration=1.0", "cloud.number=45", "cloud.concentration=0.0233"]
MEETING = [*CLOUD, "effects=['weight', 'encounters']"]

# the sand scene with these fields changed ("" takes one out), and the words that the sentence must hold
BAD_SCENES = {
    "diameter missing": (["grain.diameter="], ["grain.diameter", "missing"]),
    "grain missing": (["grain="], ["grain", "missing"]),
    "run missing": (["run="], ["run", "missing"]),
    "effects missing": (["effects="], ["effects", "missing"]),
    "friction missing": (["bed.friction="], ["bed.friction", "missing"]),
    "retention missing": (["bed.rebound=garcia_nino", "bed.friction="], ["bed.tangential_retention", "missing"]),
    "no length": (["run.jumps=", "run.discard="], ["run", "jumps", "duration"]),
    "no velocity": (["channel.transport_stage="], ["channel", "transport_stage", "shear_velocity"]),
    "unknown field": (["grain.densty=2650"], ["grain.densty", "did you mean 'density'?"]),
    "unknown field of an effect": (["drag.coeficient=0.4"], ["drag.coeficient"]),
    "unknown table": (["chanel.slope=0.1"], ["chanel", "did you mean 'channel'?"]),
    "unknown effect": (["effects=['weigth']"], ["effects", "did you mean 'weight'?"]),
    "unknown preset": (["effects=lee_hsu_1995"], ["effects", "did you mean 'lee_hsu_1994'?"]),
    "unknown profile": (["channel.profile=swammee"], ["channel.profile", "did you mean 'swamee'?"]),
    "unknown rebound": (["bed.rebound=tsuij"], ["bed.rebound", "did you mean 'tsuji'?"]),
    "unknown roughness": (["bed.roughness=R9"], ["bed.roughness", "R8"]),
    "unknown reading": (["bed.reading=clipp"], ["bed.reading", "did you mean 'clip'?"]),
    "unknown restitution": (["bed.restitution=set2"], ["bed.restitution", "set1"]),
    "unknown drag law": (["drag.law=stoke"], ["drag.law", "did you mean 'stokes'?"]),
    "unknown scheme": (["history.scheme=daitsche"], ["history.scheme", "did you mean 'daitche'?"]),
    "unknown kernel": (["history.kernel=mei"], ["history.kernel", "mei_adrian"]),
    "unknown rebound memory": (["history.rebound=forget"], ["history.rebound", "impulse"]),
    "unknown solver": (["solver.method=rk4"], ["solver.method", "runge_kutta_4"]),
    "unknown form": (["magnus.form=scalar"], ["magnus.form", "vector"]),
    "negative diameter": (["grain.diameter=-1e-3"], ["grain.diameter", "greater than 0", "(m)"]),
    "zero viscosity": (["fluid.viscosity=0"], ["fluid.viscosity", "greater than 0", "m2/s"]),
    "negative density": (["grain.density=-2650.0"], ["grain.density", "kg/m3"]),
    "negative stage": (["channel.transport_stage=-1.87"], ["channel.transport_stage", "greater than 0"]),
    "negative friction": (["bed.friction=-0.1"], ["bed.friction", "0 or greater"]),
    "negative discard": (["run.discard=-1"], ["run.discard", "0 or greater"]),
    "negative seed": (["run.seed=-1"], ["run.seed", "0 or greater"]),
    "negative dt": (["solver.method=fixed_step", "solver.dt=-1e-3"], ["solver.dt", "greater than 0"]),
    "negative height": (["start.height=-1e-3"], ["start.height", "greater than 0"]),
    "negative added mass": (["added_mass.coefficient=-0.5"], ["added_mass.coefficient", "0 or greater"]),
    "e above 1": (["bed.restitution=1.2"], ["bed.restitution", "from 0 to 1", "1.2"]),
    "e below 0": (["bed.restitution=-0.1"], ["bed.restitution", "from 0 to 1"]),
    "retention above 1": (["bed.rebound=garcia_nino", "bed.friction=", "bed.tangential_retention=1.5"], ["bed.tangential_retention", "1 or less"]),
    "slope above 1": (["channel.slope=2.0"], ["channel.slope", "less than 1"]),
    "rtol too small": (["solver.rtol=1e-20"], ["solver.rtol", "1e-10 or greater"]),
    "no jumps": (["run.jumps=0"], ["run.jumps", "1 or greater"]),
    "everything discarded": (["run.discard=220"], ["run.discard", "smaller than jumps"]),
    "not finite": (["grain.diameter=nan"], ["grain.diameter", "finite"]),
    "infinite": (["run.longest_flight=inf"], ["run.longest_flight", "finite"]),
    "a word for a number": (["grain.diameter=big"], ["grain.diameter", "a number", "'big'"]),
    "true for a number": (["grain.density=true"], ["grain.density", "a number"]),
    "half a jump": (["run.jumps=2.5"], ["run.jumps", "whole number"]),
    "a number for a table": (["channel=3"], ["channel", "a table"]),
    "a number for a word": (["bed.rebound=3"], ["bed.rebound", "tsuji"]),
    "a word for true": (["bed.span_scatter=yes"], ["bed.span_scatter", "true or false"]),
    "four dimensions": (["dimensions=4"], ["dimensions", "2 or 3"]),
    "two components": (["start.velocity=[0.1, 0.1]"], ["start.velocity", "three numbers"]),
    "a list of lists": (["effects=[['weight']]"], ["effects", "['weight']"]),
    "auto in a list": (["effects=['auto']"], ["effects", "stands alone", "effects = 'auto'"]),
    "no effects": (["effects=[]"], ["effects", "at least one"]),
    "an effect twice": (["effects=['weight', 'drag', 'weight']"], ["effects", "'weight' twice"]),
    "both lengths": (["run.duration=1.0"], ["run", "not both"]),
    "both velocities": (["channel.shear_velocity=0.02"], ["channel", "not both"]),
    "both frictions": (["bed.tangential_retention=0.5"], ["bed.tangential_retention", "tsuji"]),
    "Coulomb friction with García–Niño": (["bed.rebound=garcia_nino", "bed.tangential_retention=0.89"], ["friction", "garcia_nino"]),
    "fixed steps without dt": (["solver.method=fixed_step"], ["solver.dt", "missing"]),
    "RK4 without dt": (["solver.method=runge_kutta_4"], ["solver.dt", "missing"]),
    "dt with collocation": (["solver.dt=1e-3"], ["solver.dt", "collocation"]),
    "a sampled scheme with collocation": (["history.scheme=daitche"], ["history", "daitche", "fixed_step"]),
    "a window with collocation": (["history.window=3.0"], ["history", "window", "fixed_step"]),
    "a half derivative with a varying kernel": ([*FIXED, "history.kernel=mei_adrian", "history.scheme=semi_derivative"], ["history.kernel", "'daitche'"]),
    "a slip for Basset's kernel": ([*FIXED, "history.kernel=basset", "history.slip_at=tau"], ["history.slip_at", "basset"]),
    "past slips with collocation": (["history.kernel=mei_adrian", "history.slip_at=tau"], ["history.slip_at", "'t'"]),
    "two windows": ([*WINDOWED, "history.window_jumps=2"], ["history.window_jumps", "history.window"]),
    "eleven of Casas's terms": ([*WINDOWED, "history.kernel=basset", "history.tail=casas_11"], ["history.tail", "1 to 10"]),
    "windowed without a window": ([*FIXED, "history.scheme=windowed"], ["history.window", "missing"]),
    "unknown rule": ([*WINDOWED, "history.rule=daitch"], ["history.rule", "did you mean 'daitche'?"]),
    "a rule that has a tail": ([*WINDOWED, "history.rule=exponential"], ["history.rule must be one of 'brush'", "got 'exponential'"]),
    "unknown tail": ([*WINDOWED, "history.tail=long"], ["history.tail", "fitted"]),
    "an order without meaning": ([*WINDOWED, "history.rule=brush", "history.order=3"], ["history.order", "no meaning"]),
    "a window without meaning": ([*FIXED, "history.scheme=brush", "history.window=3.0"], ["history.window", "no meaning"]),
    "a sum beyond rounding": ([*FIXED, "history.rtol=1e-17"], ["history.rtol", "1e-13"]),
    "a memory beyond digits": (["history.horizon=1e300"], ["history.horizon", "1e+09"]),
    "nothing turns the grain": (
        ["effects=['weight', 'magnus']", "bed.rebound=garcia_nino", "bed.friction=", "bed.tangential_retention=0.89"],
        ["effects", "'magnus'", "turns the grain"],
    ),
    "prescribed spin in still water": (["rotation.law=prescribed", "channel="], ["rotation.law", "[channel]"]),
    "Set 1 in still water": (["bed.restitution=set1", "channel="], ["bed.restitution", "[channel]"]),
    "jumps without a bed": (["bed="], ["run.jumps", "[bed]"]),
    "across in two dimensions": (["dimensions=2", "start.velocity=[0.1, 0.1, 0.1]"], ["start.velocity", "two dimensions"]),
    "a spin out of the plane": (["dimensions=2", "start.spin=[1.0, 0.0, 0.0]"], ["start.spin", "two dimensions"]),
    "no weight in water": (["grain.density=1000.0"], ["density", "1000"]),
    "too smooth for Yalin": (["channel.transport_stage=", "channel.shear_velocity=5e-4", "channel.profile=yalin"], ["channel.profile", "'yalin'"]),
    "wrong units": (["grain.diameter=1e200"], ["grain", "Reynolds number", "units"]),
    "no grains": ([*CLOUD, "cloud.number=0"], ["cloud.number", "1 or greater"]),
    "half a grain": ([*CLOUD, "cloud.number=2.5"], ["cloud.number", "whole number"]),
    "number missing": ([*CLOUD, "cloud.number="], ["cloud.number", "missing"]),
    "concentration missing": ([*CLOUD, "cloud.concentration="], ["cloud.concentration", "missing"]),
    "no concentration": ([*CLOUD, "cloud.concentration=0"], ["cloud.concentration", "greater than 0"]),
    "too concentrated": ([*CLOUD, "cloud.concentration=0.4"], ["cloud.concentration", "0.3 or less"]),
    "no layer": ([*CLOUD, "cloud.layer=0"], ["cloud.layer", "greater than 0", "m"]),
    "no interval": ([*CLOUD, "cloud.interval=0"], ["cloud.interval", "greater than 0"]),
    "negative spread": ([*CLOUD, "cloud.spread=-0.1"], ["cloud.spread", "0 or greater"]),
    "unknown boundary": ([*CLOUD, "cloud.boundary=periodical"], ["cloud.boundary", "did you mean 'periodic'?"]),
    "unknown field of a cloud": ([*CLOUD, "cloud.numbr=3"], ["cloud.numbr", "did you mean 'number'?"]),
    "jumps of a cloud": (["cloud.number=45", "cloud.concentration=0.0233"], ["cloud", "run.duration", "run.jumps"]),
    "fixed steps of grains that meet": ([*MEETING, *FIXED], ["encounters", "collocation", "'fixed_step'"]),
    "jumps of memory of a cloud": ([*CLOUD, "history.window_jumps=2"], ["cloud", "history.window_jumps"]),
    "encounters of one grain": (["effects=['weight', 'encounters']"], ["effects", "'encounters'", "[cloud]"]),
    "a box for few": ([*MEETING, "cloud.number=4"], ["cloud.number", "12 d", "cloud.concentration", "cloud.layer"]),
    "encounters with e above 1": ([*MEETING, "encounters.restitution=1.2"], ["encounters.restitution", "1 or less"]),
    "encounters with negative friction": ([*MEETING, "encounters.friction=-0.1"], ["encounters.friction", "0 or greater"]),
    "encounters slower than rest": ([*MEETING, "encounters.slowest=-0.1"], ["encounters.slowest", "0 or greater"]),
    "encounters without pile-up": ([*MEETING, "encounters.pile_up=0"], ["encounters.pile_up", "1 or greater"]),
    "wrong units of the bed": (["channel.roughness_height=1e300"], ["roughness_height", "units"]),
}


def files(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refuses(folder: Path, *arguments: str) -> str:
    """Run a command that must fail as a user's mistake does; its sentence."""
    before = files(folder)
    result = CliRunner().invoke(cli.main, [str(argument) for argument in arguments])
    assert result.exit_code == 2, (result.output, result.exception)
    assert result.stdout == ""
    return sentence(result.stderr, folder, before)


def sentence(text: str, folder: Path, before: dict[Path, bytes]) -> str:
    assert files(folder) == before
    assert text.endswith("\n")
    assert len(text.splitlines()) == 1, text
    assert "Traceback" not in text
    assert "Error" not in text
    return text.strip()


@pytest.fixture
def scene(tmp_path) -> Path:
    path = tmp_path / "own.toml"
    path.write_bytes(shipped()["sand"].read_bytes())
    return path


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("run") / "out.nc"
    result = CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.jumps=40", "--output", str(path)])
    assert result.exit_code == 0, result.output
    return path


def test_jumps_as_a_table(saved, tmp_path):
    """A CSV file holds the jumps that the netCDF file holds."""
    path = tmp_path / "out.csv"
    result = CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.jumps=40", "--output", str(path)])
    assert result.exit_code == 0, result.output
    pd.testing.assert_frame_equal(pd.read_csv(path), saltation.open(saved).jumps, check_dtype=False)


@each("name", BAD_SCENES)
def test_bad_scenes(scene, tmp_path, name):
    changes, words = BAD_SCENES[name]
    options = [part for change in changes for part in ("--set", change)]
    text = refuses(tmp_path, "run", scene, "--output", tmp_path / "out.nc", *options)
    for word in words:
        assert word in text
    assert refuses(tmp_path, "check", scene, *options) == text
    assert refuses(tmp_path, "campaign", scene, "--output", tmp_path / "campaign", *options) == text


@pytest.mark.parametrize("name", ["diameter missing", "e above 1", "fixed steps without dt", "nothing turns the grain"])
def test_bad_scenes_from_a_shell(scene, tmp_path, name):
    changes, words = BAD_SCENES[name]
    options = [part for change in changes for part in ("--set", change)]
    before = files(tmp_path)
    command = [sys.executable, "-m", "saltation", "run", "own.toml", "--output", "out.nc", *options]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment())
    assert done.returncode == 2
    assert done.stdout == ""
    text = sentence(done.stderr, tmp_path, before)
    for word in words:
        assert word in text


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(saltation.__file__).parents[1])}


BAD_FILES = {
    "no table": (b"effects = [", ["own.toml", "TOML"]),
    "a key twice": (b"[run]\njumps = 1\njumps = 2\n", ["own.toml", "TOML"]),
    "bytes": (b"\xff\xfe\x00", ["own.toml", "TOML"]),
    "empty": (b"", ["effects", "missing"]),
}


@each("name", BAD_FILES)
def test_bad_files(tmp_path, name):
    content, words = BAD_FILES[name]
    (tmp_path / "own.toml").write_bytes(content)
    text = refuses(tmp_path, "run", tmp_path / "own.toml", "--output", tmp_path / "out.nc")
    for word in words:
        assert word in text


def test_scenes_that_are_not_there(tmp_path):
    assert "did you mean 'sand'?" in refuses(tmp_path, "run", "snad")
    assert "does not exist" in refuses(tmp_path, "check", tmp_path / "sand.toml")
    assert "cannot be read" in refuses(tmp_path, "check", tmp_path)


BAD_OPTIONS = {
    "set without a value": (["run", "sand", "--set", "run.jumps"], "--set"),
    "set without a field": (["run", "sand", "--set", "run.=3"], "--set"),
    "set below a field": (["run", "sand", "--set", "run.jumps.few=3"], "run.jumps"),
    "output without a folder": (["run", "sand", "--output", "{}/no/out.nc"], "--output"),
    "a result to the screen": (["run", "sand", "--output", "-"], "--output must be the name of a file or folder, got '-'"),
    "many grains to the screen": (["run", "sand_cloud", "--output", "-"], "--output must be the name of a file or folder, got '-'"),
    "a campaign to the screen": (["campaign", "sand", "--output", "-"], "--output must be the name of a file or folder, got '-'"),
    "a picture to the screen": (["plot", "{}/own.toml", "--output", "-"], "--output must end in .png"),
    "output a folder": (["run", "sand", "--output", "{}"], "--output"),
    "output there already": (["run", "sand", "--output", "{}/own.toml"], "--force"),
    "many grains into a file": (["run", "sand_cloud", "--output", "{}/own.toml"], "must be a folder"),
    "many grains among other files": (["run", "sand_cloud", "--output", "{}"], "holds something else"),
    "many grains without a folder": (["run", "sand_cloud", "--output", "{}/no/out"], "does not exist"),
    "no room for many grains": (["run", "sand_cloud", "--set", "cloud.number=30", "--set", "cloud.concentration=0.3"], "cloud.number"),
    "no workers": (["campaign", "sand", "--workers", "0", "--output", "{}/c"], "--workers"),
    "workers and a cluster": (["campaign", "sand", "--workers", "1", "--scheduler", "tcp://x:1", "--output", "{}/c"], "--scheduler"),
    "a campaign into a file": (["campaign", "sand", "--output", "{}/own.toml"], "--output"),
    "thesis and more": (["campaign", "thesis", "sand", "--output", "{}/c"], "thesis"),
    "thesis with other stages": (["campaign", "thesis", "--vary", "channel.transport_stage=2,3", "--output", "{}/c"], "channel.transport_stage"),
    "thesis with another friction": (["campaign", "thesis", "--set", "bed.friction=0.2", "--output", "{}/c"], "bed.friction"),
    "vary without values": (["campaign", "sand", "--vary", "run.seed=", "--output", "{}/c"], "--vary"),
    "vary one field twice": (["campaign", "sand", "--vary", "run.jumps=1", "--vary", "run.jumps=2", "--output", "{}/c"], "given once"),
    "vary with a bad value": (["campaign", "sand", "--vary", "bed.restitution=0.5,1.5", "--output", "{}/c"], "bed.restitution"),
    "no reference": (["campaign", "sand", "--reference", "{}/no.csv", "--output", "{}/c"], "--reference"),
    "a bad reference": (["campaign", "sand", "--reference", "{}/own.toml", "--output", "{}/c"], "columns"),
    "no result": (["plot", "{}/no.nc"], "RESULT"),
    "a result that is none": (["plot", "{}/own.toml", "--output", "{}/x.png"], "RESULT"),
    "a picture of another kind": (["plot", "{}/own.toml", "--output", "{}/x.bmp"], ".png"),
    "a picture without a folder": (["plot", "{}/own.toml", "--output", "{}/no/x.png"], "--output"),
    "an unknown figure": (["plot", "{}/own.toml", "--figure", "pth"], "--figure"),
}


@each("name", BAD_OPTIONS)
def test_bad_options(scene, tmp_path, name):
    arguments, word = BAD_OPTIONS[name]
    assert word in refuses(tmp_path, *(argument.replace("{}", str(tmp_path)) for argument in arguments))


@pytest.mark.parametrize("charset", ["cp1252", "latin-1", "cp437"])
@pytest.mark.parametrize("words", [("check", "sand"), ("advise", "sand"), ("scenes",), ("run", "--help")], ids=range(4))
def test_what_an_encoding_lacks_is_escaped(words, charset):
    """τ* and ρ_s on a stdout that has no Greek."""
    escaped, plain = (CliRunner(charset=name).invoke(cli.main, words) for name in (charset, "utf-8"))
    assert escaped.exit_code == plain.exit_code == 0 and escaped.exception is None
    first, second = ("".join(text.encode("ascii", "basset.escaped").decode().split()) for text in (escaped.stdout, plain.stdout))
    assert first == second


@pytest.mark.parametrize("charset", ["cp1252", "cp1251", "cp437"])
def test_the_schema_is_the_same_json_in_every_encoding(charset):
    escaped = CliRunner(charset=charset).invoke(cli.main, ["schema"])
    assert escaped.exit_code == 0
    assert json.loads(escaped.stdout_bytes.decode(charset)) == saltation.Scene.model_json_schema()


@pytest.mark.parametrize(
    ("words", "how"),
    [
        ("saltation check sand", {"PYTHONIOENCODING": "cp1252"}),
        ("saltation check sand", {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}),
        ("saltation schema", {"LC_ALL": "POSIX"}),
        ("basset weights --help", {"PYTHONIOENCODING": "cp1252"}),
        ("basset weights --help", {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}),
    ],
    ids=range(5),
)
def test_commands_print_where_python_is_told_another_encoding(words, how):
    """In the C locale an error handler of its own, which knows file names only, stands in the way."""
    environment = {**os.environ, **how, "PYTHONUTF8": "0", "PYTHONPATH": str(Path(cli.__file__).resolve().parents[1])}
    done = subprocess.run([sys.executable, "-m", *words.split()], capture_output=True, check=False, env=environment)
    assert done.returncode == 0 and done.stderr == b""
    assert done.stdout.decode("cp1252" if "PYTHONIOENCODING" in how else "utf-8")


@pytest.mark.parametrize("mark", ["\ufeff", ""])
def test_a_scene_may_begin_with_a_byte_order_mark(tmp_path, mark):
    """As Notepad writes it."""
    for name, path in shipped().items():
        own = tmp_path / f"{name}.toml"
        own.write_text(mark + path.read_text(encoding="utf-8"), encoding="utf-8", newline="\r\n")
        assert saltation.load(own) == saltation.load(name)


def test_unknown_options_are_click_s():
    result = CliRunner().invoke(cli.main, ["run", "sand", "--ouput", "x.nc"])
    assert result.exit_code == 2
    assert "--output" in result.stderr


def test_run_writes_what_open_reads(saved):
    result = saltation.open(saved)
    assert result.status == "finished"
    assert len(result.all_jumps) == 40
    again = saltation.run(result.scene)
    pd.testing.assert_frame_equal(result.all_jumps, again.all_jumps, check_exact=True)
    assert [path.name for path in saved.parent.iterdir()] == [saved.name]


def test_run_prints_means_with_errors_and_what_to_be_wary_of(saved):
    out = CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.jumps=40"])
    assert out.exit_code == 0
    summary = saltation.open(saved).summary()
    for name, row in summary.iterrows():
        (line,) = [line for line in out.stdout.splitlines() if line.split()[:1] == [name]]
        assert line.split()[1:4] == [f"{row[key]:.4g}" for key in ("mean", "standard_error", "standard_deviation")]
    for word in ("finished", "20 jumps counted", "bed load", "clipped"):
        assert word in out.stdout
    assert out.stderr == ""  # no terminal: no progress
    coarse = CliRunner().invoke(cli.main, ["run", "sand_coarse", "--set", "run.jumps=40"])
    assert "warning: history.kernel" in coarse.stdout and "warning" not in out.stdout


def test_run_overwrites_with_force_alone(saved):
    refuses(saved.parent, "run", "sand", "--output", saved)
    out = CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.jumps=30", "--output", str(saved), "--force", "--quiet"])
    assert (out.exit_code, out.output) == (0, "")
    assert len(saltation.open(saved).all_jumps) == 30
    CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.jumps=40", "--output", str(saved), "--force"])


def test_a_run_that_cannot_go_on_says_so_and_keeps_what_it_has(tmp_path):
    path = tmp_path / "short.nc"
    out = CliRunner().invoke(cli.main, ["run", "sand", "--set", "run.discard=0", "--set", "history.horizon=20.0", "--output", str(path)])
    assert out.exit_code == 0
    assert "horizon" in out.stdout.splitlines()[0]
    result = saltation.open(path)
    assert result.status == "horizon"
    assert 0 < len(result.all_jumps) < 220
    quiet = CliRunner().invoke(cli.main, ["run", "sand", "--set", "history.horizon=20.0", "--quiet"])
    assert (quiet.exit_code, quiet.stdout, quiet.stderr.count("\n")) == (0, "", 1)


def test_a_failed_run_has_exit_status_1(saved, monkeypatch):
    made = saltation.open(saved)
    made.status, made.message = "failed", "for the test"
    monkeypatch.setattr(saltation, "run", lambda scene, progress, output: made)
    out = CliRunner().invoke(cli.main, ["run", "sand"])
    assert out.exit_code == 1
    assert "failed: for the test" in out.stdout


def test_check_prints_the_numbers_of_the_field():
    out = CliRunner().invoke(cli.main, ["check", "sand"])
    assert out.exit_code == 0, out.output
    lines = {line.split()[0]: line.split()[1] for line in out.stdout.splitlines() if len(line.split()) > 1}
    numbers = saltation.load("sand").numbers
    expected = {"R_p": numbers.particle_reynolds, "τ*": numbers.shields, "τ*c": numbers.critical_shields, "T": 1.87, "Re*": numbers.reynolds}
    expected |= {"α": numbers.alpha, "c": numbers.history, "St/V_n": numbers.stokes(1.0), "k_s+": numbers.reynolds}
    for name, value in expected.items():
        assert float(lines[name]) == pytest.approx(value, rel=1e-4)
    for word in ("spin_x, spin_y, spin_z", "exponentials", "collocation", "not computed: turbulence (not among the effects), wall (not among the effects)"):
        assert word in out.stdout
    assert "warning: history.kernel" in CliRunner().invoke(cli.main, ["check", "sand_coarse"]).stdout and "warning" not in out.stdout


def test_check_names_ignored_tables_and_what_is_left_out():
    out = CliRunner().invoke(cli.main, ["check", "sand", "--set", "effects=['weight', 'drag']"])
    assert "[history] is ignored" in out.stdout
    assert "magnus (not among the effects)" in out.stdout


def test_the_schema_describes_every_field():
    out = CliRunner().invoke(cli.main, ["schema"])
    schema = json.loads(out.stdout)
    tables = {"scene": schema, **schema["$defs"]}
    assert len(tables) == 13 + len(EFFECTS)
    for name, table in tables.items():
        assert table["type"] == "object"
        assert table["additionalProperties"] is False
        for field, content in table["properties"].items():
            assert content.get("description"), f"{name}.{field}"
    assert set(schema["required"]) == {"effects", "grain", "run"}
    units = {"Fluid": {"density": "kg/m3", "viscosity": "m2/s"}, "Grain": {"density": "kg/m3", "diameter": "m"}, "Start": {"velocity": "m/s", "spin": "rad/s"}}
    for table, fields in units.items():
        for field, unit in fields.items():
            assert unit in tables[table]["properties"][field]["description"]


def test_scenes_lists_what_is_shipped():
    out = CliRunner().invoke(cli.main, ["scenes"])
    assert out.exit_code == 0
    assert [line.split()[0] for line in out.stdout.splitlines()] == list(shipped())
    assert "R_p = 73, T = 1.87" in out.stdout


def test_version():
    assert __version__ in CliRunner().invoke(cli.main, ["--version"]).stdout


def test_a_campaign_of_own_files(tmp_path, scene):
    """A product of values over a file: one row each, ranked among themselves."""
    arguments = ["campaign", str(scene), "--set", "run.jumps=40", "--vary", "bed.restitution=0.65,0.8", "--vary", "channel.transport_stage=1.87,2.67"]
    out = CliRunner().invoke(cli.main, [*arguments, "--output", str(tmp_path / "own")])
    assert out.exit_code == 0, (out.output, out.exception)
    assert sorted(path.name for path in (tmp_path / "own").iterdir()) == ["store", "table.csv"]  # a ranking is for those who ask
    out = CliRunner().invoke(cli.main, [*arguments, "--rank", "--output", str(tmp_path / "own")])
    assert out.exit_code == 0, (out.output, out.exception)
    table = pd.read_csv(tmp_path / "own" / "table.csv")
    assert table["scene"].eq("own").all()
    assert list(zip(table["bed.restitution"], table["stage"], strict=True)) == [(0.65, 1.87), (0.65, 2.67), (0.8, 1.87), (0.8, 2.67)]
    assert table["status"].eq("finished").all()
    ranking = pd.read_csv(tmp_path / "own" / "ranking.csv")
    assert set(ranking["model"]) == {"own, 0.65", "own, 0.8"}
    assert sorted(ranking["rank"]) == [1.0, 2.0]
    for model in ranking["model"]:
        assert model in out.stdout
    assert len(list((tmp_path / "own" / "store").iterdir())) == 4
    exact = saltation.run(saltation.load("sand").changed(bed={"restitution": 0.65}, run={"jumps": 40}))
    assert table["height"][0] == exact.jumps["height"].mean()  # read back from text bit for bit


def test_a_campaign_against_measurements(tmp_path, scene):
    table = pd.DataFrame({"variable": ["height", "length", "velocity"] * 2, "T": [1.9] * 3 + [2.6] * 3})
    table = table.assign(mean=[1.0, 10.0, 6.0, 1.5, 15.0, 6.5], sd=0.3, n=50, source="invented for this test")
    table.to_csv(tmp_path / "measured.csv", index=False)
    arguments = ["campaign", str(scene), "--set", "run.jumps=40", "--vary", "bed.restitution=0.65,0.8", "--vary", "channel.transport_stage=1.87,2.67"]
    out = CliRunner().invoke(cli.main, [*arguments, "--reference", str(tmp_path / "measured.csv"), "--output", str(tmp_path / "own")])
    assert out.exit_code == 0, (out.output, out.exception)
    ranking = pd.read_csv(tmp_path / "own" / "ranking.csv")
    assert ranking["source"].eq("invented for this test").all()
    assert ranking["overlap_index"].between(0.0, 100.0).all()
    assert "overlap" in out.stdout


def test_a_scheduler_that_does_not_answer(tmp_path):
    text = refuses(tmp_path, "campaign", "sand", "--scheduler", "tcp://127.0.0.1:9", "--output", tmp_path / "c")
    assert "--scheduler" in text


def test_plot_draws_what_is_asked_for(saved, tmp_path):
    from saltation.plots.run import PLOTS

    name = next(iter(PLOTS))
    target = tmp_path / "picture.png"
    out = CliRunner().invoke(cli.main, ["plot", str(saved), "--figure", name, "--output", str(target)])
    assert out.exit_code == 0, (out.output, out.exception)
    assert target.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]


def test_plot_leaves_out_what_a_run_cannot_show(saved, tmp_path, monkeypatch):
    """Asked for by name it is a mistake, otherwise it is left out."""
    from matplotlib.figure import Figure

    from saltation.plots import run as plots

    def refused(result):
        raise ValueError("there is nothing to show")

    monkeypatch.setattr(plots, "PLOTS", {"one": lambda result: Figure(), "two": refused})
    path = tmp_path / "b.nc"
    path.write_bytes(saved.read_bytes())
    assert "there is nothing to show" in refuses(tmp_path, "plot", path, "--figure", "two")
    out = CliRunner().invoke(cli.main, ["plot", str(path), "--output", str(tmp_path / "x.svg")])
    assert out.exit_code == 0
    assert out.stderr == "left out: two, there is nothing to show\n"
    assert sorted(found.name for found in tmp_path.iterdir()) == ["b.nc", "x_one.svg"]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("3", 3),
        ("3.5", 3.5),
        ("1e-3", 1e-3),
        ("true", True),
        ("R4", "R4"),
        ("'R4'", "R4"),
        ("[1.0, 2.0]", [1.0, 2.0]),
        ("set1", "set1"),
        ("1\ny = 2", "1\ny = 2"),
    ],
)
def test_values_are_as_in_toml_and_words_need_no_quotes(text, value):
    found = cli.value_of(text)
    assert found == value
    assert type(found) is type(value)


def test_lists_of_values():
    assert cli.values_of("1.5,2") == [1.5, 2]
    assert cli.values_of("R4,R5") == ["R4", "R5"]
    assert cli.values_of("[0.0, 0.0, 1.0],[1.0, 0.0, 0.0]") == [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    assert cli.values_of("set1, 0.65") == ["set1", 0.65]
