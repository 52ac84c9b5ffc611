"""Every example runs, asserts its number and draws its figure."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

EXAMPLES = sorted((Path(__file__).resolve().parents[1] / "reports" / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_keeps_its_number(path, monkeypatch):
    assert 20 <= len(path.read_text(encoding="utf-8").splitlines()) <= 60
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, path.stem, module)  # the compiler looks a function's module up
    spec.loader.exec_module(module)
    figure = module.example()
    assert isinstance(figure, Figure) and all(axes.lines or axes.collections or axes.images for axes in figure.axes)
