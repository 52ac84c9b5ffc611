"""The direction of imports: basset <- saltation <- bench <- reports, layers within each, no circle, one place that knows the compiler."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import basset

ROOT = Path(__file__).resolve().parents[1]


def contracts(root):
    """The contracts in pyproject.toml, as in `make lint`, held against the packages of a folder."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    return subprocess.run([sys.executable, "-c", code], cwd=root, env={**os.environ, "PYTHONPATH": str(root)}, capture_output=True, text=True, check=False)


def test_layers_hold_and_no_circle_is_left():
    done = contracts(ROOT)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("basset/kernels.py", "import saltation.flow", "the packages' imports run down"),
        ("saltation/grain.py", "def late():\n    from bench import records", "the packages' imports run down"),
        ("basset/kernels.py", "from . import advice", "the library's imports run down"),
        ("saltation/flight/loop.py", "def late():\n    from numba.core import types", "one place knows the compiler"),
        ("basset/solvers/events.py", "from .stepper import march", "no circle in any folder"),
    ],
)
def test_an_import_against_them_is_found(tmp_path, file, line, broken):
    for name in ("basset", "saltation", "bench", "reports"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "figures", "data", "*.html"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / file).open("a", encoding="utf-8") as code:
        code.write(f"\n\n{line}\n")
    done = contracts(tmp_path)
    assert done.returncode == 1 and f"{broken} BROKEN" in done.stdout, done.stdout


def test_no_module_is_named_like_a_public_function():
    """A late import of basset.x would replace the function basset.x by the module."""
    functions = {name for name in basset.__all__ if inspect.isroutine(getattr(basset, name))}
    assert {"integrate", "cumulate"} <= functions
    assert not functions & {path.stem if path.stem != "__init__" else path.parent.name for path in (ROOT / "basset").rglob("*.py")}
