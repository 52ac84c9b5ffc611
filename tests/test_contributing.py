"""The worked examples of CONTRIBUTING.md: each is added to a copy of the packages, and what it says to run passes there."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", TEXT, re.S | re.M))
BLOCK = re.compile(r"`([\w/]+\.py)`(?:, in `(\w+)`)?:\n\n```python\n(.*?)```", re.S)
COMMAND = re.compile(r"^```\n(pytest .+?)\n```", re.M)


FOLDERS = ("basset", "saltation", "bench", "reports", "tests")
WORKED = [name for name, text in SECTIONS.items() if BLOCK.search(text)]


@pytest.mark.parametrize("section", WORKED)
def test_the_worked_example_works(section, tmp_path):
    for name in ("basset", "saltation", "tests", "pyproject.toml"):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy  # bytecode too: what is not edited need not be compiled again
        copy(ROOT / name, tmp_path / name)
    blocks, commands = BLOCK.findall(SECTIONS[section]), COMMAND.findall(SECTIONS[section])
    assert len(commands) == 1
    added = []
    for path, table, code in blocks:
        file = tmp_path / path
        if not table:
            assert not file.exists(), f"{path} is there already: the example needs another"
            file.write_text(code, encoding="utf-8")
            added.append(path)
            assert len(code.splitlines()) <= 60
            continue
        before = file.read_text(encoding="utf-8")
        start = re.search(rf"^{table}\b.*[({{]\n", before, re.M)
        file.write_text(before[: start.end()] + code + before[start.end() :], encoding="utf-8")
    if added:
        for check in (["check"], ["format", "--check"]):
            linted = subprocess.run([sys.executable, "-m", "ruff", *check, *added], cwd=tmp_path, capture_output=True, text=True, check=False)
            assert linted.returncode == 0, linted.stdout + linted.stderr
    words = [*shlex.split(commands[0])[1:], "-p", "no:cacheprovider", "-p", "no:xdist", "-q", "--durations=3"]
    surroundings = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}  # the same source, and nothing to compile
    done = subprocess.run([sys.executable, "-m", "pytest", *words], cwd=tmp_path, env=surroundings, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_kind_of_addition_has_an_example():
    assert {"Add a scheme", "Add an effect", "Add a problem"} == set(WORKED)


def test_every_long_file_has_its_reason():
    lines = {path.relative_to(ROOT).as_posix(): len(path.read_text(encoding="utf-8").splitlines()) for name in FOLDERS for path in (ROOT / name).rglob("*.py")}
    named = re.findall(r"`([\w/]+/\w+\.py)`", SECTIONS["Long files"].split("| --- |")[1])
    assert sorted(named) == sorted(name for name, length in lines.items() if length > 500)
