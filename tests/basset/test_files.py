"""Files are written whole or not at all, with the mode, through the links and into the devices that a user means."""

import os
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from basset import _files
from basset._command import Mistake, check_output
from basset._files import replacing, write

pytestmark = pytest.mark.skipif(os.name != "posix", reason="modes, links and devices of POSIX")


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def umask():
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


def mode(path):
    return stat.S_IMODE(os.stat(path).st_mode)


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002, 0o000, 0o027])
def test_a_new_file_has_the_mode_that_the_umask_leaves(umask, mask):
    umask(mask)
    write(Path("a.csv"), "1\n")
    Path("b.csv").write_text("1\n")
    assert mode("a.csv") == mode("b.csv") == 0o666 & ~mask


@pytest.mark.parametrize("was", [0o600, 0o640, 0o664])
def test_a_file_that_is_replaced_keeps_its_mode(was):
    Path("a.csv").write_text("0\n")
    os.chmod("a.csv", was)
    write(Path("a.csv"), "1\n")
    assert mode("a.csv") == was and Path("a.csv").read_text() == "1\n"


@pytest.mark.parametrize("there", [True, False], ids=["a file", "nothing yet"])
@pytest.mark.parametrize("steps", [1, 2])
def test_a_link_is_written_through(there, steps):
    Path("deep").mkdir()
    if there:
        Path("deep/real.csv").write_text("0\n")
    Path("link1.csv").symlink_to("deep/real.csv")
    Path("link2.csv").symlink_to(Path("link1.csv").absolute())
    link = Path(f"link{steps}.csv")
    check_output(link, force=True)
    write(link, "1\n")
    assert link.is_symlink() and Path("deep/real.csv").read_text() == "1\n" and not Path("deep/real.csv").is_symlink()
    assert sorted(os.listdir()) == ["deep", "link1.csv", "link2.csv"] and os.listdir("deep") == ["real.csv"]


def test_a_link_to_a_file_is_not_overwritten_without_force():
    Path("real.csv").write_text("0\n")
    Path("link.csv").symlink_to("real.csv")
    with pytest.raises(Mistake, match=r"'link.csv' exists already; --force overwrites it"):
        check_output(Path("link.csv"), force=False)
    Path("lost.csv").symlink_to("no/real.csv")
    with pytest.raises(Mistake, match=r"the folder '.*no' does not exist"):
        check_output(Path("lost.csv"), force=True)


def test_a_device_stays_a_device():
    for device in ("/dev/null", "to_null"):
        if device == "to_null":
            Path(device).symlink_to("/dev/null")
        before = os.stat(device)
        check_output(Path(device), force=False)
        write(Path(device), "1\n")
        assert stat.S_ISCHR(os.stat(device).st_mode) and os.stat(device).st_rdev == before.st_rdev
    assert os.listdir() == ["to_null"] and Path("to_null").is_symlink()


def test_a_pipe_is_written_to():
    os.mkfifo("pipe.nc")
    found = []
    reader = threading.Thread(target=lambda: found.append(Path("pipe.nc").read_bytes()))
    reader.start()
    check_output(Path("pipe.nc"), force=False)
    with replacing("pipe.nc") as name:
        Path(name).write_bytes(bytes(range(256)) * 1000)
    reader.join(timeout=60)
    assert found == [bytes(range(256)) * 1000] and stat.S_ISFIFO(os.stat("pipe.nc").st_mode)


@pytest.mark.parametrize("name", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
@pytest.mark.parametrize("target", ["a pipe", "a file"])
def test_standard_output_is_written_to(name, target):
    if not os.path.exists(name):
        pytest.skip(f"no {name} here")
    code = f"import pathlib, basset._files as f; print('before', flush=True); f.write(pathlib.Path({name!r}), '1\\n'); print('after')"
    if target == "a pipe":
        text = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment()).stdout
    else:
        with open("out.txt", "ab") as out:  # as after >>: each writes at the end
            subprocess.run([sys.executable, "-c", code], stdout=out, check=True, env=environment())
        text = Path("out.txt").read_text()
        assert os.listdir() == ["out.txt"]
    assert "1\n" in text and text.endswith("after\n")


def environment():
    return {**os.environ, "PYTHONPATH": str(Path(_files.__file__).resolve().parents[1])}


def test_what_fails_leaves_what_was_there():
    Path("a.csv").write_text("0\n")

    def half_written():
        with replacing("a.csv") as name:
            Path(name).write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half_written()
    assert Path("a.csv").read_text() == "0\n" and os.listdir() == ["a.csv"]


def test_a_file_is_on_the_disk_before_it_has_its_name(monkeypatch):
    """And its name before the call returns: file, rename, folder."""
    done = []
    real, renamed = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (done.append(stat.S_IFMT(os.fstat(handle).st_mode)), real(handle)))
    monkeypatch.setattr(os, "replace", lambda *names: (done.append("rename"), renamed(*names)))
    write(Path("a.csv"), "1\n")
    assert done == [stat.S_IFREG, "rename", stat.S_IFDIR]


def test_a_folder_that_cannot_be_synced_is_no_mistake(monkeypatch):
    real = os.fsync

    def fsync(handle):
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError("not here")
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    write(Path("a.csv"), "1\n")
    assert Path("a.csv").read_text() == "1\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_until_a_file_is_written(tmp_path, number):
    """It comes in the midst of the writing: the file is whole, and then the signal does what it does."""
    path, before = tmp_path / "whole.txt", signal.signal(number, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), replacing(path) as name:
            signal.raise_signal(number)
            Path(name).write_text("all of it", encoding="utf-8")
        assert path.read_text(encoding="utf-8") == "all of it" and list(tmp_path.iterdir()) == [path]
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
