"""Every example runs, asserts its number, tells it and draws its figure; the gallery shows them all."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

REPORTS = Path(__file__).resolve().parents[1] / "reports"
EXAMPLES = sorted((REPORTS / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_keeps_its_number(path, monkeypatch, capsys):
    assert 20 <= len(path.read_text(encoding="utf-8").splitlines()) <= 60
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, path.stem, module)  # the compiler looks a function's module up
    spec.loader.exec_module(module)
    figure = module.example()
    assert re.search(r"\d", capsys.readouterr().out.splitlines()[-1])
    assert isinstance(figure, Figure) and all(axes.lines or axes.collections or axes.images for axes in figure.axes)
    for axes in figure.axes:
        assert axes.get_ylabel() or not axes.get_subplotspec().is_first_col()
        assert axes.get_xlabel() or not axes.get_subplotspec().is_last_row()


def test_the_gallery_shows_every_example():
    text = (REPORTS / "examples.md").read_text(encoding="utf-8")
    assert re.findall(r"\(examples/(\w+)\.py\)", text) == re.findall(r"\(figures/example_(\w+)\.png\)", text)
    assert sorted(re.findall(r"\(examples/(\w+)\.py\)", text)) == [path.stem for path in EXAMPLES]
    for path in EXAMPLES:
        assert path.read_text(encoding="utf-8").split('"""')[1] in text and (REPORTS / "figures" / f"example_{path.stem}.svg").exists()
