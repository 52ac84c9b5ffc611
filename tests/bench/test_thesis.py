"""The table of the thesis names what is there: functions, tests, sections and figures."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

from all_cases import each

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "reports" / "thesis.md").read_text(encoding="utf-8")
ROWS = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.startswith(("| ---", "| item", "| page", "| ["))]
NAMES = sorted(set(re.findall(r"`((?:saltation|basset|bench|reports)(?:\.\w+)*):([\w.]+)`", TEXT)))
TESTS = sorted({(file, name) for file, names in re.findall(r"(tests/[\w/]+\.py)((?:(?:, )?::\w+)*)", TEXT) for name in [*re.findall(r"::(\w+)", names), ""]})


@cache
def defined(file: str) -> set[str]:
    """Every function and class of a file."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef))}


@each("module, name", NAMES)
def test_what_is_named_is_there(module, name):
    thing = importlib.import_module(module)
    first, *rest = name.split(".")
    assert hasattr(thing, first)
    kind = getattr(thing, first)
    for part in rest:  # fields of tables have no attribute on the class
        assert hasattr(kind, part) or part in getattr(kind, "model_fields", {}) or part in getattr(kind, "__annotations__", {})


@each("file, name", TESTS)
def test_tests_are_there(file, name):
    assert not name or name in defined(file)


@each("page, section", sorted(set(re.findall(r'page (\w+), "([^"]+)"', TEXT))))
def test_sections_are_there(page, section):
    assert section in (ROOT / "reports" / f"{page}.md").read_text(encoding="utf-8")


def test_every_row_says_where_by_what_and_why():
    assert len(ROWS) > 150
    for row in ROWS:
        cells = row.strip("| ").split(" | ")
        assert len(cells) == 4 and re.match(r"(same|differs|missing|data)", cells[3]), row


def test_the_opening_counts_the_rows():
    found = {word: sum(row.strip("| ").split(" | ")[3].startswith(word) for row in ROWS) for word in ("same", "differs", "missing", "data")}
    missing = f"{found['missing']} are" if found["missing"] else "none is"
    counts = f"{found['same']} are here as printed, {found['differs']} differ for the reason given, {missing} missing and {found['data']} lack"
    assert f"Of {len(ROWS)} items of the thesis {counts} only measurements" in TEXT
