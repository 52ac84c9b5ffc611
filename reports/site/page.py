"""What every page is made of: templates, tables, figures' files, and who measured."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from basset._look import legend
from reports.words import Record, Words

HERE = Path(__file__).resolve().parents[1]  # the committed pages, and what they are made from
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
    """One page: what makes it, from whose data, and its text once it is made."""

    name: str  # of its file without .md, and of its part of index.html
    build: Callable[[dict[str, Record]], str]
    suites: tuple[str, ...]  # whose data it shows
    text: str = ""

    @property
    def file(self) -> str:
        """Its file in reports."""
        return f"{self.name}.md"

    @property
    def title(self) -> str:
        """The text's first line."""
        return self.text.split("\n", 1)[0].removeprefix("# ")

    @property
    def opening(self) -> list[str]:
        """The sentences to take away, a line of the template each."""
        return next(part for part in self.text.split("\n\n")[1:] if not part.startswith("*")).split("\n")

    @property
    def note(self) -> str:
        """What it says of data that was not measured with the rest."""
        return next((part for part in self.text.split("\n\n")[1:2] if part.startswith("*")), "")


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


def template(name: str, part: str = "") -> str:
    """A file of reports/templates: its first part, or the one that follows the line `%% part`."""
    parts = (HERE / "templates" / name).read_text(encoding="utf-8").split("\n%% ")
    found = {head: text for head, _, text in (each.partition("\n") for each in parts[1:])}
    return (found[part] if part else parts[0]).strip()


def fill(name: str, part: str = "", /, **values: Any) -> str:
    """A template with its fields filled: records by their keys, numbers in the forms of `reports.words`."""
    return Words().vformat(template(name, part), (), values)


def write(path: Path, text: str) -> None:
    """Write atomically."""
    partial = path.with_name(path.name + ".part")
    partial.write_text(text.rstrip() + "\n", encoding="utf-8")
    partial.replace(path)


def table(head: Sequence[str], rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """A Markdown table."""
    return "\n".join(indent + "| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def finished(figure: Any, axes: Any, columns: int, title: str) -> Any:
    """The figure with its title, and below it one legend for all panels, that of `axes`."""
    (figure.suptitle if len(figure.axes) > 1 else axes.set_title)(title)
    legend(figure, axes, columns)
    return figure


def _alternative(figure: Any) -> str:
    """A figure's title, or those of its panels, as plain text."""
    titles = [figure.get_suptitle()] if figure.get_suptitle() else [axes.get_title() for axes in figure.axes]
    text = "; ".join(dict.fromkeys(" ".join(title.split()) for title in titles if title))
    return re.sub(r"\\\w+|[$\\{}\[\]]", "", text)


def save(figure: Any, name: str) -> str:
    """Write figures/NAME.svg and .png, without dates; the Markdown that shows the figure, its title as the text for those who do not see it."""
    own = folder() / "figures"
    own.mkdir(parents=True, exist_ok=True)
    figure.savefig(own / f"{name}.svg", metadata={"Date": None})
    figure.savefig(own / f"{name}.png", dpi=150, metadata={"Software": None})
    plt.close(figure)
    return f"![{_alternative(figure) or name.replace('_', ' ')}](figures/{name}.png)\n\n([SVG](figures/{name}.svg))"


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
