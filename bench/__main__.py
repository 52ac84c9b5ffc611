"""`python -m bench [suite …]`: measure, and write one JSON file per suite."""

from __future__ import annotations

import importlib
import inspect
import json
import pkgutil
import shlex
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from basset import _validate, measure
from bench import sources, suites

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "reports" / "data"
FOUND = [found.name for found in pkgutil.iter_modules(suites.__path__)]  # imported when they run: some load all of the simulator


def suite(name: str) -> ModuleType:
    """A suite's module."""
    return importlib.import_module(f"{suites.__name__}.{name}")


def question(name: str) -> str:
    """The first line of the suite's docstring."""
    return (suite(name).__doc__ or "").strip().splitlines()[0]


def takes_records(name: str) -> bool:
    """Whether a suite can read measurements from a folder."""
    return "records" in inspect.signature(suite(name).run).parameters


class Listing(click.Command):
    """A command whose help lists the suites."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """One line per suite."""
        lines = (f"{name}: {question(name)}{f' (with --full: {suites.TOO_LONG[name]})' if name in suites.TOO_LONG else ''}" for name in FOUND)
        formatter.write("\nSuites:\n" + "".join(f"  {line}\n" for line in lines))


def commit() -> str:
    """The commit of the code that measures, marked where files differ from it."""
    try:
        command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def outdated(file: Path, full: bool) -> bool:
    """Whether a suite's measurement is not there, is older than the code, or is a short run where the full one is wanted."""
    if not file.exists():
        return True
    content = json.loads(file.read_text(encoding="utf-8"))
    return bool(sources.changed(content)) or (full and not content["full"])


@click.command(cls=Listing, help="Measure what accuracy costs in time; all suites unless some are named.")
@click.argument("names", nargs=-1, metavar="[SUITE]...")
@click.option("--full", is_flag=True, help="Longer runs, all suites, and the comparison with other packages (peers).")
@click.option("--stale", is_flag=True, help="Only suites whose file in the output is missing or older than the code.")
@click.option("--records", metavar="DIR", type=click.Path(exists=True, file_okay=False, path_type=Path), help="Digitised records, for the suite `measured`.")
@click.option("--output", type=click.Path(file_okay=False, path_type=Path), default=DATA, help="Where the JSON goes.  [default: reports/data]")
def main(names: tuple[str, ...], full: bool, stale: bool, records: Path | None, output: Path) -> None:
    """Run suites one after the other; say which, and how long each took."""
    for name in names:
        if name not in FOUND:
            hint = _validate.suggestion(name, FOUND)
            click.echo(f"suite must be one of {', '.join(FOUND)}, got {name!r}{hint}", err=True)
            sys.exit(2)
    chosen = list(dict.fromkeys(names)) or [name for name in FOUND if full or name not in suites.TOO_LONG]
    if stale:
        chosen = [name for name in chosen if outdated(output / f"{name}.json", full)]
    given = {name: {"records": records} if records and takes_records(name) else {} for name in chosen}
    if records and not any(given.values()):
        click.echo("--records is for the suite `measured`, which is not among those to run", err=True)
        sys.exit(2)
    words = ["python", "-m", "bench", *names, *(["--full"] if full else []), *(["--records", "DIR"] if records else [])]  # without the user's folder
    command, state = shlex.join(words), commit()
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} suites"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("bench", total=len(chosen))
        for place, name in enumerate(chosen, 1):
            progress.update(task, description=name)
            progress.console.print(f"[{place}/{len(chosen)}] {name}: {question(name)}")
            start, code = time.perf_counter(), sources.digests(name)
            result = suite(name).run(full, **given[name])
            provenance = measure.provenance(command) | {"commit": state}
            content = {"suite": name, "question": question(name), "full": full, "provenance": provenance, "sources": code, **result}
            measure.write_json(output / f"{name}.json", content)
            progress.advance(task)
            progress.console.print(f"[{place}/{len(chosen)}] {name}: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(prog_name="python -m bench")
