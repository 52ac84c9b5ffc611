"""What a command has computed is not lost, whatever its printing meets; runs that came to nothing; hostile command lines."""

import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scene_cases import cloud_scene, flown, merged, scene

import saltation
from saltation import cli, front, simulation
from saltation.plots.run import PLOTS
from saltation.scene import shipped
from saltation.study import campaigns, choices
from saltation.study import effects as advice

SHORT = ["run", "bouncing", "--set", "run.jumps=2"]


def invoke(*arguments):
    """A command in this process, as plain Python."""
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


def environment(**more):
    return {**os.environ, "PYTHONPATH": str(Path(saltation.__file__).parents[1]), "NUMBA_DISABLE_JIT": "1", **more}


# Saved first


PRINT = "import sys, saltation; from saltation import cli; made = saltation.open(sys.argv.pop(1)); saltation.run = lambda *_: made; cli.main()"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a device without space")
@pytest.mark.parametrize("arguments", [["saltation", "schema"], ["basset", "--help"], ["basset", "weights", "daitche", "--steps", "3", "--dt", "0.1"]])
def test_an_output_without_space_is_one_sentence(arguments):
    with open("/dev/full", "w") as full:
        done = subprocess.run([sys.executable, "-m", *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment())
    assert (done.returncode, done.stderr) == (2, "the output cannot be used: No space left on device\n")


def test_a_closed_pipe_is_no_failure(tmp_path):
    """Nobody reads what is printed: the file is there, nothing is said, and the status is that of the run."""
    result = flown(scene("bouncing", run={"jumps": 2}))
    result.save(tmp_path / "in.nc")
    for status, code in (("finished", 0), ("failed", 1)):
        result.status = status
        result.save(tmp_path / "in.nc")
        reader, writer = os.pipe()
        os.close(reader)
        command = [sys.executable, "-c", PRINT, str(tmp_path / "in.nc"), *SHORT, "--output", str(tmp_path / f"{status}.nc")]
        done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, env=environment())
        os.close(writer)
        assert (done.returncode, done.stderr) == (code, "")
        assert len(saltation.open(tmp_path / f"{status}.nc").jumps) == 2


@pytest.mark.parametrize("error", [UnicodeEncodeError("ascii", "τ", 0, 1, "no"), BrokenPipeError(), RuntimeError("no"), KeyboardInterrupt()])
def test_whatever_printing_meets_the_file_is_there(tmp_path, monkeypatch, error):
    def refuse(*_):
        raise error

    monkeypatch.setattr(cli, "print_result", refuse)
    invoke(*SHORT, "--output", tmp_path / "out.nc")
    assert saltation.open(tmp_path / "out.nc").status == "finished"


@pytest.mark.parametrize("name", ["ablate", "uncertainty"])
def test_tables_are_written_before_they_are_printed(tmp_path, monkeypatch, name):
    """And before the many more runs of --combined."""

    def refuse(*_, **__):
        raise RuntimeError("no")

    index = pd.Index(["full"], name="left out")
    table = pd.DataFrame({"choice": ["as given"], "value": ["-"], "status": ["finished"]}, index=index)
    monkeypatch.setattr(choices if name == "uncertainty" else advice, name, lambda *_, **__: table)
    monkeypatch.setattr(choices, "combinations", refuse)
    monkeypatch.setattr(cli, "print_changes", refuse)
    invoke(name, "sand", "--output", tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == table.to_csv()


def test_a_campaign_is_written_before_it_is_printed(tmp_path, monkeypatch):
    def refuse(*_):
        raise RuntimeError("no")

    row = dict.fromkeys(campaigns.COLUMNS, 1.0) | {"status": "finished", "jumps": 200}
    monkeypatch.setattr(front, "campaign", lambda runs, *_, **__: pd.DataFrame([{**labels, **row} for labels, _ in runs]))
    for name in ("print_means", "print_ranking"):
        monkeypatch.setattr(cli, name, refuse)
    (tmp_path / "own").mkdir()
    invoke("campaign", "sand", "--rank", "--output", tmp_path / "own")
    assert sorted(path.name for path in (tmp_path / "own").iterdir()) == ["ranking.csv", "table.csv"]


def test_own_scenes_at_several_stages_need_no_ranking(tmp_path, monkeypatch):
    """Scenes of one name at one stage, and still water: tables, not refusals; asked for by name, one sentence."""
    row = dict.fromkeys(campaigns.COLUMNS, 1.0) | {"status": "finished", "jumps": 200}
    monkeypatch.setattr(front, "campaign", lambda runs, *_, **__: pd.DataFrame([{**labels, **row} for labels, _ in runs]))
    (tmp_path / "sand.toml").write_bytes(shipped()["sand"].read_bytes())
    own = ["campaign", str(tmp_path / "sand.toml"), "--output", str(tmp_path / "c")]
    (tmp_path / "c").mkdir()
    for more in (["--vary", "channel.transport_stage=1.87,2.43"], ["--vary", "run.seed=1,2"], ["--vary", "grain.diameter=5e-4,7e-4"]):
        out = invoke(*own, *more)
        assert out.exit_code == 0 and not (tmp_path / "c" / "ranking.csv").exists(), out.output
    out = invoke("campaign", "bouncing", "--output", tmp_path / "c")
    assert out.exit_code == 0, out.output
    refused = invoke("campaign", "bouncing", "--rank", "--output", tmp_path / "c")
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert "no ranking: every scene needs a [channel]" in refused.stderr and (tmp_path / "c" / "table.csv").exists()


@pytest.mark.parametrize("field", ["channel=", "bed=", "grain=", "bed.rebound=tsuji", "effects="])
def test_the_thesis_s_own_tables_stay(field, tmp_path):
    out = invoke("campaign", "grains" if field == "effects=" else "thesis", "--set", field, "--output", tmp_path / "c")
    assert (out.exit_code, out.stderr.count("\n"), list(tmp_path.iterdir())) == (2, 1, [])


# What came to nothing

THROWN = {"velocity": [0.1, 0.0, -0.3], "height": 1e-3}
HEAVY = {"transport_stage": None, "shear_velocity": 0.03}


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("lighter than water", {"grain": {"density": 900.0}, "start": THROWN, "run": {"jumps": 1}}, "no bed load: shields"),
        ("as heavy as water", {"grain": {"density": 1000.0}, "channel": HEAVY, "start": THROWN, "run": {"jumps": 1}}, "no bed load: shields"),
        ("a bed without friction", {"bed": {"friction": 0.0, "roughness": "flat"}, "effects": ["weight"], "history": None}, "no bed load: friction"),
        ("one jump", {"run": {"jumps": 1}}, ""),
    ],
)
def test_what_has_no_bed_load_is_written_all_the_same(tmp_path, name, changes, words):
    content = saltation.load("sand").model_dump(exclude_none=True)
    short = {"run": {"jumps": 2, "discard": 0, "longest_flight": 3.0}, "solver": {"rtol": 1e-2}, "effects": ["weight", "drag"], "history": None}
    (tmp_path / "own.toml").write_text(toml(merged(merged(content, short), changes)))
    out = invoke("run", tmp_path / "own.toml", "--output", tmp_path / "out.nc")
    assert out.exit_code == 0, (out.output, out.exception)
    assert words in out.stdout and out.stderr == ""
    assert saltation.open(tmp_path / "out.nc").status in out.stdout


def toml(content):
    """Tables of plain values as TOML."""
    lines = [f"{key} = {word(value)}" for key, value in content.items() if not isinstance(value, dict)]
    for key, table in content.items():
        if isinstance(table, dict):
            lines += [f"[{key}]", *(f"{name} = {word(value)}" for name, value in table.items())]
    return "\n".join(lines)


def word(value):
    return str(value).lower() if isinstance(value, bool) else repr(value)


@pytest.mark.parametrize("velocity", [(0.0, 0.0, -1.0), (1.0, 0.0, -0.5), (0.0, 0.0, -1e-3)])
def test_no_step_flown_leaves_the_start(velocity, tmp_path):
    """Below contact and moving down: the one jump has no flight."""
    result = flown(scene("bouncing", velocity=velocity, height=0.45, run={"jumps": 1}))
    path = result.trajectory
    assert path.sizes["time"] == 1 and float(path["z"][0]) == pytest.approx(0.45)
    assert [float(path[name][0]) for name in "uw"] == pytest.approx([velocity[0], velocity[2]])
    result.save(tmp_path / "out.nc")
    found = saltation.open(tmp_path / "out.nc")
    assert found.trajectory.identical(path) and found.all_jumps.equals(result.all_jumps)
    for draw in PLOTS.values():
        try:
            draw(found)
        except ValueError as error:
            assert "\n" not in str(error)


def test_a_failed_first_step_kept_its_path(monkeypatch, tmp_path):
    """It does not say to keep what was kept; what was not kept it does."""
    from saltation.flight.setup import Grain

    monkeypatch.setattr(Grain, "fly", lambda *_: (simulation.stepper.TOO_SMALL, 0))
    for kept in (True, False):
        result = saltation.run(scene("bouncing", run={"trajectory": kept}))
        assert result.status == "failed"
        result.save(tmp_path / "out.nc")
        for one in (result, saltation.open(tmp_path / "out.nc")):
            if kept:
                assert one.trajectory.sizes["time"] == 1
            else:
                with pytest.raises(ValueError, match=r"set run\.trajectory = true"):
                    _ = one.trajectory


# Still water


def test_still_water_has_no_shear_velocity(tmp_path):
    """Tables, files, pictures and what is computed name the scale that there is."""
    out = invoke(*SHORT, "--output", tmp_path / "out.nc")
    assert out.exit_code == 0 and "d/V" in out.stdout
    velocity = saltation.load("bouncing").numbers.velocity
    assert f"V = √(|R| g d) = {velocity:.4g} m/s: still water has no u*" in out.stdout
    assert "u*" not in out.stdout.replace("has no u*", "")
    grains = CliRunner()
    made = cloud_scene(2, 1.0, cloud={"boundary": "open"})
    (tmp_path / "c.toml").write_text(toml(made.model_dump(exclude_none=True)))
    text = grains.invoke(cli.main, ["run", str(tmp_path / "c.toml")]).stdout
    assert "d/V" in text and "u*" not in text
    assert "u*" in invoke("run", "sand", "--set", "run.jumps=2", "--set", "run.discard=0", "--set", "solver.rtol=1e-2").stdout


# Interrupts


@pytest.mark.parametrize(
    "command",
    [["run", "sand"], ["check", "sand"], ["schema"], ["plot", "x.nc"], ["campaign", "sand", "--output", "c"], ["ablate", "sand"], ["uncertainty", "sand"]],
)
def test_an_interrupt_is_one_sentence(command, monkeypatch, tmp_path):
    """Wherever it comes, also before there is anything to stop."""
    monkeypatch.chdir(tmp_path)

    def stop(*_, **__):
        raise KeyboardInterrupt

    for name in ("read", "open_result", "planned"):
        monkeypatch.setattr(cli, name, stop)
    monkeypatch.setattr(cli.json, "dumps", stop)
    out = invoke(*command)
    assert (out.exit_code, out.stdout, out.stderr) == (130, "", "stopped: nothing is kept\n")


def test_a_path_too_long_for_memory_is_one_sentence(monkeypatch):
    def fill(*_):
        raise MemoryError("Unable to allocate 608 GiB")

    monkeypatch.setattr(saltation, "run", fill)
    out = invoke(*SHORT)
    assert (out.exit_code, out.stdout) == (1, "") and out.stderr.startswith("Error: out of memory") and "run.trajectory = false" in out.stderr


# Arguments


def test_names_that_are_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    long = "x" * 300
    for command in (["plot", "."], ["plot", ".."], ["plot", "/"], ["plot", long], ["plot", "a.png"], ["plot", "/dev/null"], ["run", long], ["check", long]):
        refused(invoke(*command))
    for option in (["run", "sand", "--output", long], ["run", "sand_cloud", "--output", long], ["ablate", "sand", "--output", f"{long}.csv"]):
        refused(invoke(*option))
    refused(invoke("campaign", "sand", "--output", long, "--workers", "1"))
    refused(invoke("plot", "x.nc", "--animate", f"{long}.gif"))
    assert list(tmp_path.iterdir()) == []


def refused(out):
    assert out.exit_code == 2, (out.output, out.exception)
    assert out.stderr.count("\n") == 1 and "Traceback" not in out.stderr, out.stderr


@pytest.mark.skipif(sys.platform == "darwin", reason="names are UTF-8 there")
def test_names_that_are_no_utf_8(tmp_path, monkeypatch):
    """As scenes, as outputs and as labels."""
    name = os.fsdecode(b"caf\xe9")
    (tmp_path / f"{name}.toml").write_bytes(shipped()["bouncing"].read_bytes())
    out = invoke("run", tmp_path / f"{name}.toml", "--output", tmp_path / f"{name}.nc")
    assert out.exit_code == 0 and "caf\\xe9.nc" in out.stdout
    out = invoke("plot", tmp_path / f"{name}.nc", "--figure", "jumps")
    assert out.exit_code == 0 and (tmp_path / f"{name}.png").exists()
    row = dict.fromkeys(campaigns.COLUMNS, 1.0) | {"status": "finished", "jumps": 5}
    monkeypatch.setattr(front, "campaign", lambda runs, *_, **__: pd.DataFrame([{**labels, **row} for labels, _ in runs]))
    (tmp_path / f"{name}.folder").mkdir()
    out = invoke("campaign", tmp_path / f"{name}.toml", "--output", tmp_path / f"{name}.folder")
    assert out.exit_code == 0, (out.output, out.exception)
    assert pd.read_csv(tmp_path / f"{name}.folder" / "table.csv")["scene"].tolist() == ["caf\\xe9"]


FIELDS = ["run.jumps", "grain.diameter", "bed.restitution", "effects", "channel", "start.velocity", "cloud.number", "history.scheme", "dimensions", "x.y.z", ""]
VALUES = st.one_of(
    st.sampled_from(["[" * 3000, "{" * 2000, "9" * 5000, "1e999", "-0", "nan", "''", '"', "[[]]", "{}", "{a = 1}", "2020-01-01", "0x1F", "1\n[x]", "τ", "#"]),
    st.text(max_size=20),
    st.floats().map(str),
    st.integers().map(str),
)


@pytest.mark.sweep
@settings(max_examples=3 * settings().max_examples)
@given(changes=st.lists(st.tuples(st.sampled_from(FIELDS) | st.text(max_size=8), VALUES), max_size=3), vary=st.lists(VALUES, max_size=2))
@example(changes=[("run.jumps", "9" * 5000)], vary=[])
@example(changes=[("start.velocity", "[" * 5000)], vary=[])
@example(changes=[("run.jumps", "2020-01-01"), ("run.seed", "1")], vary=[])
@example(changes=[], vary=["[" * 5000, "9" * 5000])
def test_no_command_line_ends_in_a_traceback(changes, vary):
    """A scene that can be had, or one sentence."""
    options = [part for field, value in changes for part in ("--set", f"{field}={value}")]
    for command in (
        ["advise", "bouncing", *options],
        ["campaign", "bouncing", *options, *(part for value in vary for part in ("--vary", f"run.seed={value}"))],
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(front, "campaign", lambda *_, **__: (_ for _ in ()).throw(saltation.SceneError("far enough")))
            patch.setattr(advice, "advise", lambda made: [])
            out = CliRunner().invoke(cli.main, command)
        assert out.exit_code in (0, 2), (out.output, out.exception)
        assert out.exception is None or isinstance(out.exception, SystemExit)
        assert "Traceback" not in out.stderr and (out.exit_code == 0 or out.stderr.count("\n") <= 4)


@pytest.mark.sweep
@given(
    words=st.lists(
        st.sampled_from(["run", "plot", "check", "--set", "--output", "x", "--force", "--figure", "jumps", "sand", "--help", "-"]) | st.text(max_size=6)
    )
)
def test_no_list_of_words_ends_in_a_traceback(words):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(saltation, "run", lambda *_, **__: (_ for _ in ()).throw(saltation.SceneError("far enough")))
        patch.setattr(front, "resolved", lambda made, *_, **__: made)
        for module, name in ((advice, "ablate"), (choices, "uncertainty")):
            patch.setattr(module, name, lambda *_, **__: (_ for _ in ()).throw(saltation.SceneError("far enough")))
        out = CliRunner().invoke(cli.main, words)
    assert out.exit_code in (0, 2), (words, out.output, out.exception)
    assert out.exception is None or isinstance(out.exception, SystemExit)
