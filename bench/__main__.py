"""`python -m bench [suite …]`: measure, and write one JSON file per suite."""

from __future__ import annotations

import importlib
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
from bench import suites

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "reports" / "data"


def discover() -> dict[str, ModuleType]:
    """Every suite by name: each module in bench/suites is one."""
    modules = (importlib.import_module(f"{suites.__name__}.{found.name}") for found in pkgutil.iter_modules(suites.__path__))
    return {module.NAME: module for module in modules}


def question(suite: ModuleType) -> str:
    """The first line of the suite's docstring."""
    return (suite.__doc__ or "").strip().splitlines()[0]


def too_long(suite: ModuleType) -> str:
    """Why the suite is left to --full (or to being named); empty if it is not."""
    return str(getattr(suite, "FULL_ONLY", ""))


def commit() -> str:
    """The commit of the code that measures, marked where files differ from it."""
    try:
        command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude=*"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


FOUND = discover()
LISTING = "\b\nSuites:\n" + "\n".join(
    f"  {name}: {question(suite)}{f' (with --full: {too_long(suite)})' if too_long(suite) else ''}" for name, suite in FOUND.items()
)


@click.command(help=f"Measure what accuracy costs in time; all suites unless some are named.\n\n{LISTING}")
@click.argument("names", nargs=-1, metavar="[SUITE]...")
@click.option("--full", is_flag=True, help="Longer runs, all suites, and the peers.")
@click.option("--missing", is_flag=True, help="Only suites that have no file in the output yet.")
@click.option("--output", type=click.Path(file_okay=False, path_type=Path), default=DATA, help="Where the JSON goes.  [default: reports/data]")
def main(names: tuple[str, ...], full: bool, missing: bool, output: Path) -> None:
    """Run suites one after the other; say which, and how long each took."""
    for name in names:
        if name not in FOUND:
            hint = _validate.suggestion(name, FOUND)
            click.echo(f"suite must be one of {', '.join(FOUND)}, got {name!r}{hint}", err=True)
            sys.exit(2)
    chosen = list(dict.fromkeys(names)) or [name for name, suite in FOUND.items() if full or not too_long(suite)]
    chosen = [name for name in chosen if not (missing and (output / f"{name}.json").exists())]
    command, state = shlex.join(["python", "-m", "bench", *names, *(["--full"] if full else [])]), commit()
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} suites"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("bench", total=len(chosen))
        for place, name in enumerate(chosen, 1):
            progress.update(task, description=name)
            progress.console.print(f"[{place}/{len(chosen)}] {name}: {question(FOUND[name])}")
            start = time.perf_counter()
            result = FOUND[name].run(full)
            provenance = measure.provenance(command) | {"commit": state}
            content = {"suite": name, "question": question(FOUND[name]), "full": full, "provenance": provenance, **result}
            measure.write_json(output / f"{name}.json", content)
            progress.advance(task)
            progress.console.print(f"[{place}/{len(chosen)}] {name}: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(prog_name="python -m bench")
