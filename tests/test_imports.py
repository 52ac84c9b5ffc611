"""The direction of imports, read from the syntax trees: basset <- saltation <- bench <- reports."""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from all_cases import each

import basset

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("basset", "saltation", "bench", "reports")  # each may import itself and those before it
MODULES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Every module that a file imports, at the top or inside a function, relative ones made absolute."""
    return tuple(found(path))


def found(path: Path) -> Iterator[str]:
    parts = path.relative_to(ROOT).with_suffix("").parts
    package = parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) + "." if node.level else ""
            yield (base + (node.module or "")).rstrip(".")
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("importlib.import_module", "import_module", "__import__"):
            yield from (argument.value for argument in node.args[:1] if isinstance(argument, ast.Constant))


def test_the_packages_are_found():
    assert ROOT / "basset" / "__init__.py" in MODULES
    assert {path.relative_to(ROOT).parts[0] for path in MODULES} == set(PACKAGES)


@each("path", MODULES)
def test_imports_run_one_way(path):
    own = path.relative_to(ROOT).parts[0]
    later = PACKAGES[PACKAGES.index(own) + 1 :]
    assert not [name for name in imported(path) if name.split(".")[0] in (*later, "tests")]


@each("path", MODULES)
def test_one_place_knows_the_compiler(path):
    if path.parent == ROOT / "basset" and path.stem in ("_compile", "_places", "_pipeline"):  # the others are parts of the first, loaded when the compiler is
        return
    if path.parent == ROOT / "reports" / "examples":  # what users write
        return
    assert not [name for name in imported(path) if name.split(".")[0] == "numba"]


def test_layers_hold_and_no_circle_is_left():
    """The contracts in pyproject.toml, as in `make lint`."""
    code = "import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_relative_imports_are_seen(tmp_path, monkeypatch):
    """The reader of syntax trees itself: every spelling of an import is found."""
    monkeypatch.setattr("test_imports.ROOT", tmp_path)
    path = tmp_path / "basset" / "quadrature" / "x.py"
    path.parent.mkdir(parents=True)
    path.write_text(
        "import a.b\nfrom c import d\nfrom . import e\nfrom .f import g\nfrom .. import h\ndef i():\n    import j\n    importlib.import_module('k')\n"
    )
    assert list(found(path)) == ["a.b", "c", "basset.quadrature", "basset.quadrature.f", "basset", "j", "k"]


def test_no_module_is_named_like_a_public_function():
    """A late import of basset.x would replace the function basset.x by the module."""
    functions = {name for name in basset.__all__ if inspect.isroutine(getattr(basset, name))}
    assert {"integrate", "cumulate"} <= functions
    modules = {path.stem if path.stem != "__init__" else path.parent.name for path in MODULES if path.relative_to(ROOT).parts[0] == "basset"}
    assert not functions & modules
