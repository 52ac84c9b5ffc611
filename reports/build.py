"""`python -m reports.build`: the pages and figures from the JSON in reports/data. Nothing is timed here.

A page is a script here with a PAGE, and the template of its name, prose with fields that the script computes; a new one is found.
With `--output` pages go to another folder, and what is in its data/ comes before what is committed.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click
import matplotlib as mpl

from basset._look import LOOK
from bench.sources import changed
from reports import gallery
from reports.site.index import index
from reports.site.page import HERE, Page, Picture, folder, into, kept, load, write
from reports.words import Record

ORDER = (  # others follow
    *("quadrature", "memory", "advice", "how_to_choose", "solver", "particles", "stepper", "saltation", "measured", "blind"),
    *("turbulence", "choosing", "flights", "scenes", "grains"),
)
FOUND = sorted(path.stem for path in (HERE / "templates").glob("*.md"))
PAGES: tuple[Page, ...] = tuple(importlib.import_module(f"reports.{name}").PAGE for name in dict.fromkeys((*ORDER, *FOUND)))
WRITTEN = ("guide", "thesis")  # pages without data, written by hand
PICTURES = (  # the front page starts with them: whole flights, and the thesis's two that led there
    Picture("scenes_accuracy", "scenes", "Error of the mean jump against time: the thesis's fig. 5-5 where it matters, in a scene."),
    Picture("error_step", "quadrature", "Error of the history integral against the step: the thesis's fig. 5-4 again."),
    Picture("accuracy_time", "quadrature", "Error of the history integral against time: the thesis's fig. 5-5 again, timed in three ways."),
)
END = "---\n\nMade by `python -m reports.build` from [data/](data/). Every page ends with the commands, the commits and the machine that measured it."


def committed(file: str) -> str:
    """A page as it is committed, its figures copied to where pages are being made."""
    text = (HERE / file).read_text(encoding="utf-8")
    for name in re.findall(r"\(figures/([^)]+)\)", text):
        (folder() / "figures").mkdir(parents=True, exist_ok=True)
        shutil.copyfile(HERE / "figures" / name, folder() / "figures" / name)
    return text


def made(page: Page, data: dict[str, Record], old: dict[str, Record]) -> Page:
    """A page with its text, its figures beside it. One that shows nothing but `old` data is the committed page, if there is one."""
    said = {name: old[name] for name in page.suites if name in old}
    kept_whole = said.keys() == {name for name in page.suites if name in data} and (HERE / page.file).exists()
    text = committed(page.file) if kept_whole else page.build(data)
    return replace(page, text=text.replace("\n\n", f"\n\n*{kept(said)}*\n\n", 1) if said else text)


def front(pages: Sequence[Page]) -> str:
    """The page README.md."""
    parts = ["# Reports", "Everything on one page, to search and to sort: open [index.html](index.html) in a browser; it needs no network."]
    parts += ["\n".join(f"* [{page.title}]({page.file}): {page.opening[0]}" for page in pages)]
    parts += [f"Files to start from, each with its figure: [examples]({gallery.FILE})."]
    parts += [f"![{picture.alternative}](figures/{picture.figure}.png)\n\n{picture.line} [More]({picture.page}.md)." for picture in PICTURES]
    notes = [page.note for page in pages if page.note]
    return "\n\n".join([*parts, *dict.fromkeys(notes), END])


@click.command()
@click.option("--output", type=click.Path(file_okay=False, path_type=Path), default=HERE, help="Where the pages go.  [default: reports]")
@click.option("--check", is_flag=True, help="Build nothing: list the data that is older than the code; exit status 1 if there is any.")
def main(output: Path, check: bool) -> None:
    """Build every page from the JSON in OUTPUT/data, and from that in reports/data what is missing there."""
    output = output.resolve()
    if check:
        old = [(name, what, content) for name, content in load(output / "data").items() if (what := changed(content))]
        for name, what, content in old:
            print(f"{name}: {what} has changed since {content['provenance']['commit']}; python -m bench {name} --full")
        sys.exit(bool(old))
    data = load(output / "data")
    old = {name: content for name, content in load(HERE / "data").items() if name not in data}
    data |= old
    if output != HERE:
        shutil.copytree(HERE / "examples", output / "examples", ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)  # pages lead there
        (output / "data").mkdir(exist_ok=True)  # and there
    with mpl.rc_context(LOOK), into(output):
        pages = [made(page, data, old) for page in PAGES if data.keys() & set(page.suites)]  # one without data is left out
        texts = {page.file: page.text for page in pages}
        written = [Page(name, lambda data: "", (), (HERE / f"{name}.md").read_text(encoding="utf-8")) for name in WRITTEN]
        texts |= {page.file: page.text for page in written}
        shown = gallery.made() if output == HERE else committed(gallery.FILE)
        texts |= {gallery.FILE: shown, "README.md": front([*pages, *written])}
        texts["index.html"] = index([*pages, *written], END, PICTURES, gallery.cards(shown))
    for name, text in texts.items():
        write(output / name, text)
    print(f"{pages[0].title}: {os.path.relpath(output / pages[0].file)}")
    print(f"All pages in one, for a browser: {os.path.relpath(output / 'index.html')}")


if __name__ == "__main__":
    main()
