"""Files that are not what was written, folders with two writers, and files of an earlier version: the right data or one sentence."""

import json
import os
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene_cases import cloud_scene, flown, scene

import saltation
from saltation import _files, simulation
from saltation.flight.layout import COLUMNS as FLOWN
from saltation.flight.layout import ENCOUNTER_COLUMNS as COLUMNS
from saltation.results.files import key_in, packed
from saltation.results.folder import Folder
from saltation.results.result import Result
from saltation.results.tables import encounter_table, fate_table, path_dataset, table_of

MADE = cloud_scene(3, 1.2, cloud={"boundary": "open", "interval": 0.1})
OTHER = cloud_scene(2, 2.0, cloud={"boundary": "open", "interval": 0.1})


def same(one, other):
    """Every number of two clouds, bit for bit, and the kinds of their columns."""
    for name in ("all_jumps", "encounters", "fates"):
        assert getattr(one, name).equals(getattr(other, name))
        assert (getattr(one, name).dtypes == getattr(other, name).dtypes).all()
    assert one.trajectory.identical(other.trajectory)
    assert (one.status, one.message, one.time, one.scene) == (other.status, other.message, other.time, other.scene)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A finished run in several parts, the same stopped after its second, a run of another scene; and what the first holds."""
    place = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "PART", 9)  # three samples of three grains
        whole = saltation.run(MADE)
        saltation.run(MADE, output=place / "finished")
        saltation.run(OTHER, output=place / "other")
        plain, written = Folder.write_status, []

        def stop(self, *arguments):
            plain(self, *arguments)
            written.append(1)
            if len(written) == 3:
                raise KeyboardInterrupt

        patch.setattr(Folder, "write_status", stop)
        with pytest.raises(KeyboardInterrupt):
            saltation.run(MADE, output=place / "stopped")
    assert len(list((place / "finished").glob("part-*.nc"))) > 3
    assert len(list((place / "stopped").glob("part-*.nc"))) == 2
    return place, whole


def again(folder):
    """The same run in the same folder, with the same parts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "PART", 9)
        return saltation.run(MADE, output=folder)


def refused(text, *names):
    """One sentence that names a file."""
    assert "\n" not in text and any(name in text for name in names), text


# Damage


@st.composite
def damage(draw):
    """A function of a file's content and that of the same file of another run."""
    kind = draw(st.sampled_from(["bit", "bits", "cut", "empty", "bytes", "json", "other", "longer", "zeros"]))
    share = draw(st.floats(0.0, 1.0, exclude_max=True))
    bit = draw(st.integers(0, 7))
    raw = draw(st.binary(max_size=80))
    text = draw(st.sampled_from(["[]", "null", "{}", "3", '"run"', "[[[[", "[" * 5000, '{"parts": 1}', '{"key": null, "parts": -1}', "true", "NaN"]))

    def change(content, other):
        at = int(share * len(content))
        flipped = content[:at] + bytes([content[at] ^ 1 << bit]) + content[at + 1 :]
        return {
            "bit": flipped,
            "bits": flipped[: at // 2] + raw + flipped[at // 2 + len(raw) :],
            "cut": content[:at],
            "empty": b"",
            "bytes": raw,
            "json": text.encode(),
            "other": other,
            "longer": content + raw,
            "zeros": content[: at // 2] + bytes(at - at // 2) + content[at:],
        }[kind]

    return change


NAMES = ["part-00000.nc", "part-00001.nc", "checkpoint.npz", "run.json"]


@pytest.mark.sweep
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(NAMES), state=st.sampled_from(["finished", "stopped"]), change=damage())
def test_any_damage_to_a_folder_is_found(folders, tmp_path, name, state, change):
    """Opened and gone on with: what was written, or one sentence with the file's name; never anything else."""
    place, whole = folders
    folder = tmp_path / "run"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place / state, folder)
    file, other = folder / name, place / "other" / name
    before = file.read_bytes()
    file.write_bytes(change(before, other.read_bytes()))
    harmless = file.read_bytes() == before
    try:
        same(saltation.open(folder), saltation.open(place / state))
        assert harmless or name == "checkpoint.npz"
    except ValueError as error:
        refused(str(error), name)
        assert not harmless
    try:
        same(again(folder), whole)
    except ValueError as error:
        refused(str(error), name, "another scene or version")
        assert not harmless
        assert {path.name for path in folder.iterdir()} == {path.name for path in (place / state).iterdir()}


@pytest.mark.sweep
@given(change=damage())
def test_any_damage_to_a_file_is_found(folders, tmp_path_factory, change):
    place, whole = folders
    file = tmp_path_factory.mktemp("file") / "x.nc"
    whole.save(file)
    before = file.read_bytes()
    file.write_bytes(change(before, (place / "other" / "part-00000.nc").read_bytes()))
    try:
        same(saltation.open(file), whole)
        assert file.read_bytes() == before
    except ValueError as error:
        refused(str(error), str(file))


def test_every_bit_of_a_part_counts(folders):
    """The header too: each of its bytes in turn, and some in each variable."""
    place, _ = folders
    content = (place / "finished" / "part-00000.nc").read_bytes()
    for at in [*range(0, 1500, 7), *range(1500, len(content), 97)]:
        flipped = content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :]
        if b"checksum\0\0\0\x02\0\0\0\x40" in flipped:
            with pytest.raises(ValueError, match="checksum"):
                _files.open_dataset(flipped)


def test_what_lies_before_a_damaged_part_can_be_read(folders, tmp_path):
    place, whole = folders
    folder = shutil.copytree(place / "finished", tmp_path / "run")
    part = folder / "part-00002.nc"
    part.write_bytes(part.read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"part-00002.nc' is damaged.*saltation.open\(.*parts=2\)"):
        saltation.open(folder)
    before = saltation.open(folder, parts=2)
    assert before.status == "unfinished" and before.message.startswith("the first 2 of")
    assert 0.0 < before.time < whole.time
    assert before.encounters.equals(whole.encounters[whole.encounters["time"] <= before.time])
    assert before.trajectory.identical(whole.trajectory.isel(time=slice(0, before.trajectory.sizes["time"])))
    assert before.trajectory.sizes["time"] == 6
    assert saltation.open(folder, parts=0).time == 0.0
    for wrong in (-1, 99):
        with pytest.raises(ValueError, match="parts must be a whole number from 0 to"):
            saltation.open(folder, parts=wrong)
    with pytest.raises(ValueError, match="parts is for the folder"):
        saltation.open(part, parts=1)


def test_a_part_of_another_run_or_another_place_is_none_of_this_one(folders, tmp_path):
    place, _ = folders
    folder = shutil.copytree(place / "finished", tmp_path / "run")
    for strange in (place / "other" / "part-00001.nc", place / "finished" / "part-00000.nc"):
        shutil.copy(strange, folder / "part-00001.nc")
        with pytest.raises(ValueError, match=r"part-00001.nc' is no part 1 of this run"):
            saltation.open(folder)
    xr.Dataset({"a": ("b", np.zeros(3))}).to_netcdf(folder / "part-00001.nc", engine="scipy")
    with pytest.raises(ValueError, match=r"part-00001.nc' is no part 1 of this run"):
        saltation.open(folder)


def test_a_lost_or_damaged_account_is_written_again_from_the_checkpoint(folders, tmp_path):
    place, whole = folders
    for state in ("finished", "stopped"):
        for content in (None, b"[]", b"null", b"", b"{"):
            folder = shutil.copytree(place / state, tmp_path / "run", dirs_exist_ok=True)
            (folder / "run.json").unlink() if content is None else (folder / "run.json").write_bytes(content)
            if content is not None:
                with pytest.raises(ValueError, match=r"run.json' is damaged: take a copy"):
                    saltation.open(folder)
            same(again(folder), whole)
            shutil.rmtree(folder)


def test_what_is_said_of_a_lost_account_beside_damage_is_so(folders, tmp_path):
    """Without a run.json nothing can be opened, and nobody is told that it could."""
    place, _ = folders
    folder = shutil.copytree(place / "stopped", tmp_path / "run")
    (folder / "checkpoint.npz").write_bytes(b"PK\5\6" + bytes(18))
    with pytest.raises(saltation.SceneError, match=r"checkpoint.npz' is damaged.*; saltation.open\(.*\) gives what there is"):
        again(folder)
    assert saltation.open(folder).status == "unfinished"
    (folder / "run.json").unlink()
    with pytest.raises(saltation.SceneError, match=r"checkpoint.npz' is damaged.*go on anew with --force$"):
        again(folder)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("link", [False, True])
def test_a_lost_part_is_named(folders, tmp_path, number, link):
    place, _ = folders
    folder = shutil.copytree(place / "stopped", tmp_path / "run")
    part = folder / f"part-0000{number}.nc"
    part.unlink()
    if link:
        part.symlink_to(part.name)
    with pytest.raises(saltation.SceneError, match=rf"^--output: '.*{part.name}' cannot be read: [A-Z][a-z ]+; take a copy"):
        again(folder)


# One writer

HOLD = """import sys, time, pathlib
from saltation._files import only_writer
with only_writer(pathlib.Path(sys.argv[1])):
    print('held', flush=True)
    time.sleep(300)
"""


@pytest.fixture
def holder(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(Path(saltation.__file__).parents[1])}
    with subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_folder_has_one_writer(holder, tmp_path):
    """A second one is told who is there and leaves everything alone; when the first is killed, the next takes over."""
    (tmp_path / ".part-00000.nc.tmp").write_text("half a part")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(saltation.SceneError, match=rf"process {holder.pid} on '.*' writes there"):
        again(tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    holder.kill()
    assert holder.wait() == -signal.SIGKILL
    assert (tmp_path / "lock").exists()
    assert again(tmp_path).status == "finished"
    assert not (tmp_path / "lock").exists() and not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("content", ['{"process": 1, "host": "elsewhere"}', "[]", "{", '{"process": 1}'])
def test_a_lock_of_another_machine_is_left_alone(tmp_path, content):
    (tmp_path / "lock").write_text(content)
    with pytest.raises(saltation.SceneError, match=r"may still write there: if it does not, remove '.*lock'"):
        again(tmp_path)
    assert (tmp_path / "lock").read_text() == content and len(list(tmp_path.iterdir())) == 1


def test_where_the_system_has_no_locks_the_process_counts(tmp_path, monkeypatch):
    monkeypatch.setattr("basset._files.fcntl", None)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    for process, free in ((dead.pid, True), (os.getpid(), False), ("x", False)):
        (tmp_path / "lock").write_text(json.dumps({"process": process, "host": _files.platform.node()}))
        if free:
            with _files.only_writer(tmp_path):
                assert json.loads((tmp_path / "lock").read_text())["process"] == os.getpid()
        else:
            with pytest.raises(saltation.SceneError, match=f"process {process} "), _files.only_writer(tmp_path):
                raise AssertionError
    (tmp_path / "lock").unlink()


def test_one_after_the_other_in_one_process(tmp_path):
    told = f"process {os.getpid()} "
    with _files.only_writer(tmp_path), pytest.raises(saltation.SceneError, match=told), _files.only_writer(tmp_path):
        raise AssertionError
    with _files.only_writer(tmp_path):
        assert [path.name for path in tmp_path.iterdir()] == ["lock"]
    assert list(tmp_path.iterdir()) == []


# There and back

numbers = st.floats(allow_infinity=False, width=64)


@pytest.mark.sweep
@given(data=st.data(), rows=st.integers(0, 4), path=st.booleans())
def test_results_of_one_grain_come_back_as_they_were(tmp_path_factory, data, rows, path):
    """Tables with their kinds of columns, paths and words; saved once more they are the same bytes."""
    file = tmp_path_factory.mktemp("there")
    made = scene("bouncing", run={"trajectory": path})
    values = np.array(data.draw(st.lists(st.lists(numbers, min_size=len(FLOWN), max_size=len(FLOWN)), min_size=rows, max_size=rows)), dtype=float)
    words = data.draw(st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=20))
    with np.errstate(all="ignore"):
        table = table_of(values.reshape(rows, len(FLOWN)), 2.0)
    times = np.sort(np.array(data.draw(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=5))))
    kept = path_dataset(made, times, np.arange(6.0 * len(times)).reshape(len(times), 1, 6)).isel(grain=0, drop=True) if path else None
    result = Result(made, table, "finished", words, {"box": 0.25, "words": words}, 4.0, path=kept)
    there_and_back(result, file, ("all_jumps",))


@pytest.mark.sweep
@given(data=st.data(), jumps=st.integers(0, 3), met=st.integers(0, 3), left=st.integers(0, 3), path=st.booleans())
def test_results_of_many_grains_come_back_as_they_were(tmp_path_factory, data, jumps, met, left, path):
    file = tmp_path_factory.mktemp("there")
    made = cloud_scene(3, 1.0, cloud={"boundary": "open"}, run={"trajectory": path, "discard": 1})
    draw = np.random.default_rng(data.draw(st.integers(0, 2**32))).normal
    with np.errstate(all="ignore"):
        table = table_of(draw(size=(jumps, len(FLOWN))), 2.0, np.arange(jumps))
    rows = [[data.draw(st.integers(0, 2)), data.draw(st.floats(0.0, 1e3)), data.draw(st.sampled_from(["at rest", "creeping", "aloft"]))] for _ in range(left)]
    kept = path_dataset(made, np.arange(4.0), draw(size=(4, 3, 6))) if path else None
    encounters = encounter_table(np.round(draw(size=(met, len(COLUMNS)))))
    result = Result(made, table, "finished", "é†", {"box": [1.0, 2.0]}, 4.0, encounters, fate_table(rows), kept)
    there_and_back(result, file, ("all_jumps", "encounters", "fates"))


def there_and_back(result, folder, tables):
    result.save(folder / "a.nc")
    found = saltation.open(folder / "a.nc")
    for name in tables:
        one, other = getattr(result, name), getattr(found, name)
        assert one.equals(other) and list(one) == list(other) and (one.dtypes == other.dtypes).all()
    assert (found.scene, found.status, found.message) == (result.scene, result.status, result.message)
    assert json.dumps(found.provenance) == json.dumps(result.provenance)
    if result.scene.run.trajectory:
        assert found.trajectory.identical(result.trajectory)
    else:
        with pytest.raises(ValueError, match="not stored"):
            _ = found.trajectory
    found.save(folder / "b.nc")
    assert (folder / "a.nc").read_bytes() == (folder / "b.nc").read_bytes()
    assert packed(found, "key") == packed(result, "key")
    (folder / "c.nc").write_bytes(packed(result, "key"))
    assert key_in(folder / "c.nc") == "key" and key_in(folder / "a.nc") is None


# What others open


@pytest.fixture(scope="module")
def bouncing():
    return flown(scene("bouncing", run={"jumps": 2}))


def test_units_are_those_of_cf(bouncing, folders, tmp_path):
    """A number of diameters is dimensionless and says of what it is a multiple; times miss no value; one dimension at most may grow."""
    for result in (bouncing, folders[1]):
        result.save(tmp_path / "out.nc")
        with xr.open_dataset(tmp_path / "out.nc", engine="scipy", decode_cf=False) as opened:
            assert opened.attrs["Conventions"].startswith("CF-1.")
            assert opened.attrs["velocity_scale"] == "V = √(|R| g d)"
            assert "_FillValue" not in opened["time"].attrs and 0 not in opened.sizes.values()
            for name, variable in opened.variables.items():
                unit = variable.attrs.get("units")
                assert unit in ("1", "degree") or name in ("grain", "fate_fate"), name
                assert (unit == "1" and "scale" in variable.attrs) == ("si_factor" in variable.attrs)
                assert "u*" not in variable.attrs.get("scale", "")  # still water has none
    stream = scene("sand", run={"jumps": 1, "discard": 0})
    with np.errstate(all="ignore"):
        sand = Result(stream, table_of(np.zeros((1, len(FLOWN))), 1.0), "finished", "", {}, 0.0)
    assert sand.dataset()["jump_velocity"].attrs["scale"] == "u*" and sand.dataset().attrs["velocity_scale"] == "u*, the shear velocity"


def test_in_si_units(bouncing):
    """By hand, from the scene's own numbers: d, V, d/V, V/d and V²/d."""
    d, v = bouncing.scene.grain.diameter, bouncing.scene.numbers.velocity
    si, own = bouncing.to_si(), bouncing.dataset()
    units = {"jump_height": ("m", d), "jump_start": ("s", d / v), "jump_velocity": ("m s-1", v), "jump_spin": ("rad s-1", v / d)}
    units |= {"jump_impulse_z": ("m s-1", v), "weight_z": ("m s-2", v * v / d), "z": ("m", d), "w": ("m s-1", v), "time": ("s", d / v)}
    for name, (unit, factor) in units.items():
        assert si[name].attrs["units"] == unit and "scale" not in si[name].attrs
        np.testing.assert_allclose(si[name], factor * own[name].to_numpy(), rtol=1e-14)
    np.testing.assert_array_equal(si["jump_takeoff_angle"], own["jump_takeoff_angle"])
    ratio = bouncing.scene.grain.density / bouncing.scene.fluid.density
    np.testing.assert_allclose(si["weight_z"], -9.81 * (ratio - 1.0) / (ratio + 0.5), rtol=1e-12)  # the weight in water, added mass moved along


# What was written before


@pytest.fixture(scope="module")
def old(tmp_path_factory):
    place = tmp_path_factory.mktemp("old")
    zipfile.ZipFile(Path(__file__).with_name("written_by_94647dd.zip")).extractall(place)
    return place


def test_files_of_an_earlier_version_open(old, tmp_path):
    told = json.loads((old / "values.json").read_text())
    one = saltation.open(old / "campaign" / "runs" / "a.nc")
    assert one.all_jumps.drop(columns="grain").to_dict("list") == told["jumps"] and (one.all_jumps["grain"] == 0).all() and one.status == "finished"
    assert float(one.trajectory["time"][-1]) == told["end"]
    assert one.trajectory["z"].attrs["scale"] == "d" and one.trajectory["w"].attrs["scale"] == "V"
    many, parts = saltation.open(old / "cloud.nc"), saltation.open(old / "run")
    for found in (many, parts):
        assert found.trajectory["z"].to_numpy().tolist() == told["z"] and found.time == told["time"]
        assert found.fates.dtypes.astype(str).to_dict()["grain"] == "int32" and len(found.fates) == 0
        assert found.trajectory["time"].attrs["scale"] == "d/V"
        found.save(tmp_path / "new.nc")
        again = saltation.open(tmp_path / "new.nc")
        assert again.encounters.equals(found.encounters) and again.trajectory.identical(found.trajectory)
    assert len(saltation.study.campaigns.Store(old / "campaign" / "store").path.name) > 0
    with pytest.raises(saltation.SceneError, match="another scene or version"):
        saltation.run(many.scene, output=old / "run")


@pytest.mark.sweep
@given(name=st.sampled_from(["campaign/runs/a.nc", "cloud.nc", "run/part-00001.nc", "run/run.json"]), share=st.floats(0.0, 1.0, exclude_max=True))
def test_files_of_an_earlier_version_that_are_cut_short(old, tmp_path_factory, name, share):
    place = tmp_path_factory.mktemp("cut") / "old"
    shutil.copytree(old, place)
    content = (place / name).read_bytes()
    (place / name).write_bytes(content[: int(share * len(content))])
    with pytest.raises(ValueError) as caught:
        saltation.open(place / ("run" if name.startswith("run") else name))
    refused(str(caught.value), Path(name).name)
