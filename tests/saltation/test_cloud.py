"""Runs of many grains: each as if alone where none meet, the same bits however a run is cut, stopped or kept."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scene_cases import cloud_scene, sand_cloud

import saltation
from basset.solvers import stepper
from basset.solvers._tables import tables_of
from saltation import cli, simulation
from saltation.flight import cloud, layout
from saltation.flight.cloud import starts
from saltation.flight.setup import Engine, Grain, Start, empty_record, tables_for
from saltation.flow import velocity_and_shear
from saltation.results.folder import Folder
from saltation.results.tables import table_of

LENGTH = 40.0  # d/u*
PIECE = 45 * 25  # kept positions in a part: 16 parts of 2.5 d/u*


def same(one, other):
    """Every number of two results, bit for bit."""
    assert one.all_jumps.equals(other.all_jumps)
    assert one.encounters.equals(other.encounters)
    assert one.fates.to_dict("records") == other.fates.to_dict("records")
    assert one.trajectory.equals(other.trajectory)
    assert (one.status, one.message, one.time) == (other.status, other.message, other.time)


@pytest.fixture(scope="module")
def whole():
    """In memory, in one piece, nothing tabulated before."""
    tables_for.cache_clear()
    tables_of.cache_clear()
    result = saltation.run(sand_cloud(LENGTH))
    assert len(result.encounters) > 50
    return result


# Alone and among others


def alone(engine, grain, start, jumps):
    """(jumps, steps) of a grain that flies so many jumps on its own."""
    engine.limits = engine.limits._replace(max_jumps=float(jumps))
    one = Grain(engine, grain, start)
    record, rows = empty_record(20000, engine.tables.count, engine.states), np.zeros((jumps, len(layout.COLUMNS)))
    code, done = one.fly(record, True, rows)
    assert code == layout.JUMPS
    return rows, stepper.Record(*(array[:done] for array in record))


def test_without_encounters_each_flies_as_if_alone():
    """Jumps and paths of all 45, bit for bit: they share steps, tables and draws with a run of one grain."""
    made = sand_cloud(8.0, effects=[name for name in saltation.load("sand_cloud").effects if name != "encounters"])
    result = saltation.run(made)
    engine = Engine(made)
    engine.problem = engine.problem._replace(end=np.inf)  # where a run ends cuts its last step
    nodes = engine.tables.nodes
    polynomial, row = np.zeros((engine.tables.count + 1, engine.states)), np.zeros(engine.states)
    path = result.trajectory
    times = path["time"].to_numpy()
    kept = np.stack([path[name].to_numpy() for name in "xyzuvw"], axis=-1)
    compared = 0
    for i, (position, velocity, spin) in enumerate(zip(*starts(engine), strict=True)):
        expected = result.all_jumps[result.all_jumps["grain"] == i].reset_index(drop=True)
        rows, steps = alone(engine, i, Start(tuple(position), tuple(velocity), tuple(spin)), len(expected))
        assert table_of(rows, made.numbers.stokes(1.0), i).equals(expected)
        end = float(expected["start"].iloc[-1] + expected["duration"].iloc[-1])
        for k, when in enumerate(times[times < end]):
            step = max(0, int(np.searchsorted(steps.start, when)) - 1)
            kind, h = int(steps.kind[step]), steps.size[step]
            stepper.fit_polynomial(nodes, kind, h, steps.values[step], polynomial)
            stepper.all_at(polynomial, steps.y[step], kind, min(1.0, (when - steps.start[step]) / h), row)
            row[3] += velocity_and_shear(engine.profile, row[2])[0]
            assert (row[:6] == kept[k, i]).all()
            compared += 1
    assert compared > 45 * 40


# However it is cut


@pytest.mark.parametrize(
    ("module", "name", "size"),
    [
        (simulation, "SLICE", 45),
        (simulation, "SLICE", 10**9),
        (simulation, "PART", 45),
        (cloud, "BUFFER", 7),
    ],
)
def test_a_run_in_pieces_is_the_same(module, name, size, whole, monkeypatch):
    """Between two looks at the clock, two parts, two visits for a full log."""
    monkeypatch.setattr(module, name, size)
    same(saltation.run(whole.scene), whole)


def test_a_folder_holds_the_same_as_memory(whole, monkeypatch, tmp_path):
    monkeypatch.setattr(simulation, "PART", PIECE)
    seen = []
    result = saltation.run(whole.scene, seen.append, tmp_path / "run")
    same(result, whole)
    same(saltation.open(tmp_path / "run"), whole)
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["checkpoint.npz", *(f"part-{k:05d}.nc" for k in range(16)), "run.json"]
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert result.provenance == whole.provenance | {"box": list(whole.provenance["box"])}
    result.save(tmp_path / "one.nc")
    same(saltation.open(tmp_path / "one.nc"), whole)


@pytest.mark.parametrize("steps", [39, 59])
def test_the_last_position_is_there(steps):
    """0.1·39 is a little more than 3.9 in floating point."""
    result = saltation.run(cloud_scene(1, 0.1 * steps, cloud={"boundary": "open"}))
    assert result.trajectory.sizes["time"] == steps + 1
    assert np.isfinite(result.trajectory.to_array()).all()


# However it is stopped

COMMAND = "import sys, saltation.simulation as c; c.PART = int(sys.argv.pop(1)); from saltation.cli import main; main()"


def words(folder, made):
    changes = ["defaults=thesis", f"run.duration={made.run.duration!r}", "run.discard=0"]
    return ["run", "sand_cloud", "--output", str(folder), *(word for change in changes for word in ("--set", change))]


def start(folder, made):
    """The command line in another process, with small parts."""
    command = [sys.executable, "-c", COMMAND, str(PIECE), *words(folder, made)]
    environment = {**os.environ, "PYTHONPATH": str(Path(saltation.__file__).parents[1])}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def wait_for(folder, parts, process):
    """Until so many parts are written."""
    while len(list(folder.glob("part-*.nc"))) < parts and process.poll() is None:
        time.sleep(0.002)


def test_killed_or_stopped_at_any_time_it_goes_on(whole, monkeypatch, tmp_path):
    """SIGKILL while parts and checkpoints are being written, SIGTERM, with exit status 130 and one sentence, SIGKILL again: the same bits in the end."""
    monkeypatch.setattr(simulation, "PART", PIECE)
    folder, rng, ended = tmp_path / "run", random.Random(61), []
    for parts, how in ((1, signal.SIGKILL), (5, signal.SIGTERM), (9, signal.SIGKILL)):
        process = start(folder, whole.scene)
        wait_for(folder, parts, process)
        time.sleep(rng.uniform(0.0, 0.1) if how == signal.SIGKILL else 0.0)
        process.send_signal(how)
        out, text = process.communicate()
        ended.append(process.returncode)
        if how == signal.SIGTERM:
            assert (process.returncode, out) == (130, "")
            assert text == f"stopped: what is finished is kept in {str(folder)!r}, the same command goes on from there\n"
        if process.returncode:
            opened = saltation.open(folder)
            assert (opened.status, opened.time < whole.time) == ("unfinished", True)
            assert opened.encounters.equals(whole.encounters[: len(opened.encounters)])
    assert ended[0] == -signal.SIGKILL or ended[2] == -signal.SIGKILL
    done = CliRunner().invoke(cli.main, words(folder, whole.scene))
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout.startswith("finished: run.duration is reached")
    same(saltation.open(folder), whole)
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize("word", ["save_checkpoint", "write_status"])
def test_stopped_between_two_files(word, whole, monkeypatch, tmp_path):
    """Before a checkpoint, and before the very last words of a run that has come to its end."""
    monkeypatch.setattr(simulation, "PART", PIECE)
    plain, written = getattr(Folder, word), []

    def stop(self, *arguments):
        written.append(1)
        if len(written) == (9 if word == "save_checkpoint" else 17):
            raise KeyboardInterrupt
        plain(self, *arguments)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Folder, word, stop)
        saltation.run(whole.scene, output=tmp_path / "run")
    assert saltation.open(tmp_path / "run").status == "unfinished"
    tables_for.cache_clear()
    tables_of.cache_clear()  # as in another process
    same(saltation.run(whole.scene, output=tmp_path / "run"), whole)


def test_a_folder_is_of_one_scene(whole, monkeypatch, tmp_path):
    """Another seed is another run; a finished one is not flown again; something else is left alone."""
    made = cloud_scene(2, 1.0, cloud={"boundary": "open"})
    first = saltation.run(made, output=tmp_path / "run")
    before = {path: path.read_bytes() for path in (tmp_path / "run").iterdir()}
    monkeypatch.setattr(simulation, "fly_part", None)
    same(saltation.run(made, output=tmp_path / "run"), first)
    with pytest.raises(saltation.SceneError, match=r"another scene or version: give a new folder$"):
        saltation.run(cloud_scene(2, 2.0, cloud={"boundary": "open"}), output=tmp_path / "run")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(saltation.SceneError, match=r"holds something else: give an empty or a new folder$"):
        saltation.run(made, output=tmp_path / "other")
    assert {path: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["thesis.txt"]


def test_killed_while_it_wrote_its_first_words(tmp_path):
    """What is left of an unfinished file is no hindrance and does not stay."""
    (tmp_path / ".run.json.x1y2").write_text("{")
    made = cloud_scene(1, 1.0, cloud={"boundary": "open"})
    assert saltation.run(made, output=tmp_path).status == "finished"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["checkpoint.npz", "part-00000.nc", "run.json"]


def test_stopped_before_the_first_part(monkeypatch, tmp_path):
    """It can be opened, empty, and goes on."""
    made = cloud_scene(2, 1.0, cloud={"boundary": "open"})
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Folder, "put", lambda *arguments: (_ for _ in ()).throw(KeyboardInterrupt))
        saltation.run(made, output=tmp_path / "run")
    opened = saltation.open(tmp_path / "run")
    assert (opened.status, opened.time, len(opened.all_jumps), len(opened.encounters)) == ("unfinished", 0.0, 0, 0)
    same(saltation.run(made, output=tmp_path / "run"), saltation.run(made))


# At fixed steps


def apart(dt, **changes):
    """Three grains that do not meet."""
    content = {"effects": [name for name in saltation.load("sand_cloud").effects if name != "encounters"], "encounters": None, "cloud": {"number": 3}}
    solver = {"method": "fixed_step", "dt": dt} if dt else {"rtol": 1e-7}
    return sand_cloud(5.0, **content, solver=solver, **changes)


def test_grains_at_fixed_steps_are_those_of_collocation_as_the_step_vanishes():
    exact, coarse, fine = (saltation.run(apart(dt)) for dt in (0.0, 4e-3, 1e-3))
    assert {coarse.status, fine.status, exact.status} == {"finished"}
    for grain in range(3):
        tables = (result.all_jumps for result in (exact, coarse, fine))
        first = [table["height"][table["grain"] == grain].iloc[0] for table in tables]
        assert abs(2.0 * first[2] - first[1] - first[0]) < 5e-3 * first[0] < 0.5 * abs(first[2] - first[0])
    paths = [result.trajectory.isel(time=slice(0, 8)) for result in (exact, fine)]
    assert all(np.abs(paths[1][name] - paths[0][name]).max() < 0.1 for name in "xyzuvw")  # before any lands
    assert paths[0]["time"].equals(paths[1]["time"]) and not fine.trajectory.isel(time=slice(0, -1)).isnull().any().to_array().any()


def test_grains_at_fixed_steps_fly_alike_whoever_else_flies(tmp_path):
    made = apart(4e-3, history={"scheme": "semi_derivative", "window_jumps": 2})
    together = saltation.run(made)
    alone = simulation.run_cloud(made, grains=range(1, 2))
    assert alone.all_jumps.equals(together.all_jumps.query("grain == 1").reset_index(drop=True))
    same(saltation.run(made, output=tmp_path / "kept"), together)
    same(saltation.run(made, output=tmp_path / "kept"), together)  # it is there already


def test_parts_of_which_no_path_is_kept(monkeypatch):
    """The same jumps, and nothing is written where no samples are: the second part begins behind all of them."""
    monkeypatch.setattr(simulation, "PART", 12)
    names = [name for name in saltation.load("sand_cloud").effects if name != "encounters"]
    made = sand_cloud(4.0, effects=names, cloud={"number": 4}, run={"trajectory": True})
    kept, bare = (simulation.run(made.changed(run={"trajectory": keep})).all_jumps for keep in (True, False))
    assert len(kept) > 2 and kept.equals(bare)
