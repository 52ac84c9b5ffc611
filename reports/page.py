"""What every page is made of: templates, tables, figures' files, numbers as people write them, and who measured."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

from reports import figures
from reports.analysis import Record, Target

HERE = Path(__file__).resolve().parent  # the committed pages, and what they are made from
_FOLDER: ContextVar[Path] = ContextVar("folder of the pages", default=HERE)


@contextmanager
def into(folder: Path) -> Iterator[None]:
    """Pages and figures are made in that folder."""
    token = _FOLDER.set(folder)
    try:
        yield
    finally:
        _FOLDER.reset(token)


def folder() -> Path:
    """Where pages are being made, their figures in figures/."""
    return _FOLDER.get()


@dataclass(frozen=True)
class Page:
    """One page: how the front page presents it, and what makes it."""

    name: str  # of its file without .md, and of its part of index.html
    title: str
    description: str  # one line of Markdown
    opening: Callable[[dict[str, Record]], str]  # its sentences to take away
    lead: str  # the figure that stands for it, a file in reports/figures
    shows: str  # what that figure shows
    build: Callable[[dict[str, Record]], str]
    suites: tuple[str, ...]  # whose data it shows

    @property
    def file(self) -> str:
        """Its file in reports."""
        return f"{self.name}.md"


@dataclass(frozen=True)
class Picture:
    """One of the pictures that the front page starts with."""

    figure: str  # its file in reports/figures, without ending
    page: str  # the name of the page that it leads to
    line: str  # what it shows, a sentence

    @property
    def alternative(self) -> str:
        """The text for those who do not see it."""
        return self.line.split(":")[0]


def load(data: Path) -> dict[str, Record]:
    """Every suite's JSON by name."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(data.glob("*.json"))}


def template(name: str) -> str:
    """A file of reports/templates."""
    return (HERE / "templates" / name).read_text(encoding="utf-8").rstrip()


def fill(name: str, **values: Any) -> str:
    """A template with its fields filled."""
    return template(name).format(**values)


def write(path: Path, text: str) -> None:
    """Write atomically."""
    partial = path.with_name(path.name + ".part")
    partial.write_text(text.rstrip() + "\n", encoding="utf-8")
    partial.replace(path)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """A Markdown table."""
    return "\n".join(indent + "| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def grouped(number: float) -> str:
    """A whole number in groups of three."""
    return f"{number:,.0f}".replace(",", " ")


def factor(ratio: float) -> str:
    """A ratio with two digits."""
    return f"{ratio:.2g}" if ratio < 100 else grouped(float(f"{ratio:.2g}"))


def asked(targets: Sequence[Target]) -> str:
    """What was asked beside what was measured, as a table."""
    return table(["", "asked", "measured", ""], [[row.what, row.asked, row.measured, "met" if row.met else "**missed**"] for row in targets])


def save(figure: Any, name: str) -> str:
    """The figure's files, and the Markdown that shows it."""
    return figures.save(figure, folder() / "figures", name)


def alike(data: dict[str, Record], form: str) -> dict[str, list[str]]:
    """What `form` makes of the provenance of suites, with the names of those for which it is the same."""
    found: dict[str, list[str]] = {}
    for name, content in data.items():
        found.setdefault(form.format(**content["provenance"]), []).append(name)
    return found


def footer(data: dict[str, Record]) -> str:
    """Who measured: one line per command, commit and machine."""
    lines = alike(data, "`{command}`, {date}, commit {commit}, {processor}, one thread, {versions}")
    measured = "\n".join(f"* {', '.join(names)}: {line}" for line, names in lines.items())
    return f"---\n\nMade by `python -m reports.build` (matplotlib {mpl.__version__}) from [data/](data/), measured by:\n\n{measured}"


def kept(data: dict[str, Record]) -> str:
    """What a page says of suites that were not measured with the others: when, where and on which code they were."""
    lines = alike(data, "measured on {date} at commit {commit}, {processor} (`{command}`)")
    return "Kept as committed, not measured here: " + "; ".join(f"{', '.join(names)}, {line}" for line, names in lines.items()) + "."
