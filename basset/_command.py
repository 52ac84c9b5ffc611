"""What the commands of this package and of those above it share: mistakes, tables, progress, files."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn

from basset._files import replacing

WIDTH = 160  # of tables that go to a file or a pipe


class Mistake(click.ClickException):
    """What a user can mend."""

    exit_code = 2

    def show(self, file: IO[Any] | None = None) -> None:
        """The sentence, without the ornaments of a usage error."""
        click.echo(self.format_message(), err=True, file=file)


class Screen(Console):
    """A console that leaves it to the command what a closed pipe means."""

    def on_broken_pipe(self) -> None:
        """Let the error pass."""
        raise BrokenPipeError


def console(error: bool = False) -> Console:
    """Where tables and progress go."""
    made = Screen(stderr=error, markup=False, highlight=False)
    return made if made.is_terminal else Screen(stderr=error, markup=False, highlight=False, width=WIDTH)


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Print as far as somebody reads: a pipe that is closed is no failure."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def named(path: str | os.PathLike[str]) -> str:
    """A file's name as it can be printed and drawn: bytes that are no UTF-8 are written out."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


@contextlib.contextmanager
def progress(name: str, *columns: ProgressColumn, total: float = 1.0) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal, nothing elsewhere; what is yielded takes the share that is done."""
    screen = console(error=True)
    with Progress(TextColumn(name), BarColumn(), *columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(name, total=total)
        yield lambda share: bar.update(task, completed=share * total)


@contextlib.contextmanager
def mistakes_of_files(option: str) -> Iterator[None]:
    """What the file system refuses is a mistake."""
    try:
        yield
    except OSError as error:
        raise Mistake(f"{option}: {str(error.filename or '')!r} cannot be used: {error.strerror or error}") from None


def check_output(path: Path, force: bool) -> None:
    """Refuse before anything is computed."""
    if path.is_dir():
        raise Mistake(f"--output must be a file, got the folder {str(path)!r}")
    if not path.parent.is_dir():
        raise Mistake(f"--output: the folder {str(path.parent)!r} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise Mistake(f"--output: the folder {str(path.parent)!r} cannot be written to")
    if path.exists() and not force:
        raise Mistake(f"--output: {str(path)!r} exists already; --force overwrites it")


def draw(figure: Any, path: Path) -> None:
    """A picture, whole or not at all."""
    with replacing(path) as name:
        figure.savefig(name, format=path.suffix[1:])
