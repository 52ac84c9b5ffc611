"""`python -m bench [suite …]`: measure, and write one JSON file per suite."""

from __future__ import annotations

import importlib
import pkgutil
import shlex
import sys
import time
from pathlib import Path
from types import ModuleType

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from basset import _validate, measure
from bench import suites

DATA = Path(__file__).resolve().parent.parent / "reports" / "data"


def discover() -> dict[str, ModuleType]:
    """Every suite by name: each module in bench/suites is one."""
    modules = (importlib.import_module(f"{suites.__name__}.{found.name}") for found in pkgutil.iter_modules(suites.__path__))
    return {module.NAME: module for module in modules}


def question(suite: ModuleType) -> str:
    """The first line of the suite's docstring."""
    return (suite.__doc__ or "").strip().splitlines()[0]


def only_full(suite: ModuleType) -> bool:
    """Whether the suite is left to --full (or to being named)."""
    return getattr(suite, "FULL_ONLY", False)


FOUND = discover()
LISTING = "\b\nSuites:\n" + "\n".join(f"  {name}: {question(suite)}{' (with --full)' if only_full(suite) else ''}" for name, suite in FOUND.items())


@click.command(help=f"Measure what accuracy costs in time; all suites unless some are named.\n\n{LISTING}")
@click.argument("names", nargs=-1, metavar="[SUITE]...")
@click.option("--full", is_flag=True, help="Longer runs, and the peers.")
@click.option("--output", type=click.Path(file_okay=False, path_type=Path), default=DATA, help="Where the JSON goes.  [default: reports/data]")
def main(names: tuple[str, ...], full: bool, output: Path) -> None:
    """Run suites one after the other."""
    for name in names:
        if name not in FOUND:
            hint = _validate.suggestion(name, FOUND)
            click.echo(f"suite must be one of {', '.join(FOUND)}, got {name!r}{hint}", err=True)
            sys.exit(2)
    chosen = list(dict.fromkeys(names)) or [name for name, suite in FOUND.items() if full or not only_full(suite)]
    command = shlex.join(["python", "-m", "bench", *names, *(["--full"] if full else [])])
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} suites"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("bench", total=len(chosen))
        for name in chosen:
            progress.update(task, description=name)
            start = time.perf_counter()
            result = FOUND[name].run(full)
            content = {"suite": name, "question": question(FOUND[name]), "full": full, "provenance": measure.provenance(command), **result}
            measure.write_json(output / f"{name}.json", content)
            progress.advance(task)
            if console.is_terminal:
                progress.console.print(f"{name}: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main(prog_name="python -m bench")
