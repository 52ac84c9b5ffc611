"""What a measurement depends on: the files that a module imports, the compiled ones among them, and a digest of their code.

Read from the syntax trees, so that nothing is loaded; late imports count. A name that a package only hands on leads to the file that defines it.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from basset._compile import MARKS

ROOT = Path(__file__).resolve().parent.parent
FACE = b"face(__name__"  # a package's list of public names, each of which leads to the file that defines it; it has no code of its own
BY_NAME = ("Later", "import_module")  # calls whose first argument is a module


@cache
def tree(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_bytes())


def file_of(module: str) -> Path | None:
    """The file of a module of the project."""
    place = ROOT.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def origins(module: str, name: str) -> Iterator[str]:
    """The modules that `from module import name` leads to."""
    path = file_of(module)
    if file_of(f"{module}.{name}") is not None:
        yield f"{module}.{name}"
    elif path is not None and path.name == "__init__.py":
        yield module  # it is loaded with what it hands on
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ImportFrom) and node.module and any(name == (alias.asname or alias.name) for alias in node.names):
                yield from origins(node.module, next(alias.name for alias in node.names if name == (alias.asname or alias.name)))
                return
    elif path is not None:
        yield module


@cache
def imports(module: str) -> tuple[str, ...]:
    """The modules of the project that a module uses."""
    return tuple(dict.fromkeys(named(module)))


def named(module: str) -> Iterator[str]:
    """The same, as they come."""
    path = file_of(module)
    if path is None:
        return
    whole: dict[str, str] = {}  # packages under the names that `import` gives them
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            whole |= {(alias.asname or alias.name): alias.name for alias in node.names}
            yield from (alias.name for alias in node.names if "." in alias.name)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                yield from origins(node.module, alias.name)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in BY_NAME:
            yield from (argument.value for argument in node.args[:1] if isinstance(argument, ast.Constant) and isinstance(argument.value, str))
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "pkgutil" and path.name == "__init__.py":  # it finds its own modules
            yield from (f"{module}.{found.stem}" for found in sorted(path.parent.glob("*.py")) if found != path)
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in whole:
            yield from origins(whole[node.value.id], node.attr)


@cache
def sources(module: str) -> tuple[Path, ...]:
    """All files that a module depends on, its own first."""
    found, waiting = dict[Path, None](), [module]
    while waiting:
        path = file_of(here := waiting.pop())
        if path is not None and path not in found and FACE not in path.read_bytes():
            found[path] = None
            waiting += imports(here)
    return tuple(found)


@cache
def code(path: Path) -> str:
    """A file's code without comments, docstrings, imports and blank lines: what can change a result, the same for every version of Python."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            lines[token.start[0] - 1] = lines[token.start[0] - 1][: token.start[1]]
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import | ast.ImportFrom) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            lines[node.lineno - 1 : node.end_lineno] = [""] * ((node.end_lineno or node.lineno) - node.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def digest(module: str, compiled: bool = False) -> str:
    """Sixteen hexadecimal digits of the code that a module depends on, whatever its files are called; of what may be compiled of it only."""
    paths = [path for path in sources(module) if not compiled or any(mark in path.read_bytes() for mark in MARKS)]
    return hashlib.sha256("\n".join(sorted(map(code, paths))).encode()).hexdigest()[:16]


def digests(suite: str) -> dict[str, str]:
    """What a suite's measurement records of the code that made it."""
    module = f"bench.suites.{suite}"
    return {"compiled code": digest(module, compiled=True), "code": digest(module)}


def changed(content: Mapping[str, Any]) -> str:
    """What has changed since a suite's measurement: "compiled code", "code", or nothing."""
    recorded, now = content.get("sources", {}), digests(content["suite"])
    return next((kind for kind in now if recorded.get(kind) != now[kind]), "")
