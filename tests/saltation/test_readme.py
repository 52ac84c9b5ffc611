"""The Python lines of the README and every command in it and in the guide: run as they stand, long ones shortened by what is said here."""

import contextlib
import os
import re
import shlex
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray
from click.testing import CliRunner
from scene_cases import linear

import basset.cli
import bench.__main__
import saltation.cli
from basset import reference
from saltation.scene import shipped
from saltation.study import campaigns, cases, thesis, turbulence

ROOT = Path(__file__).resolve().parents[2]
TEXT = "".join((ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "reports/guide.md"))
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.S | re.M)
PYTHON = [code for language, code in BLOCKS if language == "python"]
LINES = [line.split("  #")[0].strip() for language, code in BLOCKS if not language for line in code.splitlines()]
INLINE = re.findall(r"`((?:make|saltation|basset|pytest|pip|python -m bench) [^`]+)`", TEXT)


@pytest.mark.parametrize("code", PYTHON)
def test_python_lines_keep_their_promises(code, tmp_path):
    """In a fresh interpreter and an empty folder, as a reader would."""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_ten_lines_are_ten():
    lines = PYTHON[0].split("\n\n", 1)[1].strip().splitlines()
    assert len(lines) == 10
    assert sum("assert" in line for line in lines) >= 3


def test_every_command_is_known_to_these_tests():
    assert {line.split()[0] for line in LINES} == {"make", "basset", "saltation", "dask"}
    assert {line.split()[0] for line in INLINE} <= {"make", "basset", "saltation", "pytest", "pip", "python"}


@pytest.mark.parametrize("line", [line for line in [*LINES, *INLINE] if line.startswith("make ")])
def test_make_knows_its_targets(line):
    done = subprocess.run([*shlex.split(line), "-n"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_inline_commands():
    for line in INLINE:
        words = shlex.split(line)
        if words[0] == "python":
            asked = bench.__main__.main.make_context("bench", words[3:]).params  # read, not run: a suite takes a minute and writes into the clone
            assert asked["names"] and set(asked["names"]) <= set(bench.__main__.FOUND)
        elif words[0] == "pytest":
            assert list((ROOT / words[1]).glob("bench_*.py"))
        elif words[0] == "pip":
            extra = re.fullmatch(r"\.(?:\[(\w+)\])?", words[2]).group(1) or "dev"
            assert f"\n{extra} = [" in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
        elif words[0] in ("basset", "saltation") and len(words) > 1:
            group = {"basset": basset.cli.main, "saltation": saltation.cli.main}[words[0]]
            assert CliRunner().invoke(group, [words[1], "--help"]).exit_code == 0


# Commands, in the order of the README, each using what those before left. What is long is shortened, and said here: the scenes fly
# a few jumps, the thesis's campaigns are a few of their runs, and what runs scenes side by side does so in this process.

SHORT = {"jumps": 5, "discard": 1}
ALONE = ("ablate", "uncertainty", "gravel", "thesis", "turbulence")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder as a reader has it: a scene of his own, and samples."""
    path = tmp_path_factory.mktemp("reader")
    scene = shipped()["sand"].read_text(encoding="utf-8")
    (path / "sand.toml").write_text(scene.replace("jumps = 220", "jumps = 5").replace("discard = 20", "discard = 1"), encoding="utf-8")
    t = 0.05 * np.arange(401)
    np.savetxt(path / "samples.csv", np.column_stack([t, np.cos(t)]), delimiter=",", header="t,rate", comments="")
    drops = np.column_stack([np.repeat([1, 2], 201), np.tile(t[:201], 2), np.ones(402), np.tile(t[:201], 2)])
    np.savetxt(path / "drops.csv", np.delete(drops, 50, axis=0), delimiter=",", header="particle,t,vx,vy", comments="")
    fields = {name: (("trajectory", "obs"), [np.sin(t + k), np.cos(t)]) for k, name in enumerate(("u", "v", "uf", "vf"))}
    xarray.Dataset(fields, {"time": ("obs", t)}).to_netcdf(path / "tracks.nc", engine="scipy")
    sphere = saltation.load("bouncing")
    motion = reference.bouncing(*linear(sphere), height=5.0, restitution=0.7, impacts=2)
    t = np.linspace(0.0, float(motion.end), 40)
    record = np.column_stack([t * sphere.numbers.time, (motion.height(t) + 1e-3 * np.sin(t**3)) * sphere.grain.diameter])
    np.savetxt(path / "record.csv", record, delimiter=",", header="t,gap", comments="")
    return path


@pytest.fixture
def short(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for module, name in ((cases, "PILOT"), (cases, "MOST"), (cases, "TIMED")):
        monkeypatch.setattr(module, name, 4)
    quick = [(labels, scene.changed(run=SHORT)) for labels, scene in thesis.thesis()[:2]]
    brief = [(labels, scene.changed(run={"duration": 0.02 * scene.run.duration})) for labels, scene in thesis.grains()[:2]]
    shaken = [(labels, scene.changed(run=SHORT)) for labels, scene in turbulence.turbulence()[:4:3]]  # plain, and with turbulence
    monkeypatch.setattr(saltation.cli, "SERIES", {"thesis": lambda: quick, "grains": lambda: brief, "turbulence": lambda: shaken})


def test_commands_one_after_the_other(short, monkeypatch):
    for line in LINES:
        words = shlex.split(line)
        if words[0] not in ("basset", "saltation") or "<host>" in line:
            continue
        words += ["--set", "run.jumps=5", "--set", "run.discard=1"] if "gravel" in words else []
        words += ["--set", "run.duration=0.1"] if "sand_cloud" in words else []
        with monkeypatch.context() as here:
            if any(word in words for word in ALONE):
                here.setattr(campaigns, "cores", lambda: 1)
            run(words)
        for name in {"--output", "--animate"} & set(words):
            assert Path(words[words.index(name) + 1]).exists(), line
    assert list(Path().glob("sand*.png"))


def run(words):
    """A command, which has to end well."""
    group = {"basset": basset.cli.main, "saltation": saltation.cli.main}[words[0]]
    found = CliRunner().invoke(group, words[1:], catch_exceptions=False)
    assert found.exit_code == 0, (words, found.output)
    assert found.stdout.strip(), words


def test_several_machines(short):
    """The three lines, with this machine for each of them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    scheduler, worker, campaign = (
        shlex.split(line.replace("<host>:8786", f"127.0.0.1:{port}")) for line in LINES if line.startswith("dask") or "<host>" in line
    )
    found = Path(sys.executable).parent / "dask"
    scheduler = [str(found), *scheduler[1:], "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    worker = [str(found), *worker[1:], "--no-dashboard"]
    installed = {**os.environ, "PYTHONPATH": str(ROOT)}
    with open("several.log", "w", encoding="utf-8") as log:
        processes = [subprocess.Popen(words, env=installed, stdout=log, stderr=log) for words in (scheduler, worker)]
        try:
            wait_for(port, processes[0])
            run(campaign)
        finally:
            for process in reversed(processes):  # a worker waits for its scheduler
                stop(process)
    assert (Path("out") / "table.csv").exists()


def wait_for(port, process):
    """Until the port answers."""
    for _ in range(600):
        assert process.poll() is None, Path("several.log").read_text(encoding="utf-8")
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1.0):
            return
        time.sleep(0.1)
    raise AssertionError(Path("several.log").read_text(encoding="utf-8"))


def stop(process):
    """End a process, by force if it must be."""
    process.terminate()
    try:
        process.wait(20)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
