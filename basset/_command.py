"""What the command lines of basset, saltation and bench share: user errors, tables, progress, output files."""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click

from basset._files import is_stream, replacing
from basset._lazy import Later

if TYPE_CHECKING:  # loaded where something is shown
    from rich.console import Console
    from rich.progress import ProgressColumn

    from basset import _compile
else:
    _compile = Later("basset._compile")

WIDTH = 160  # of tables that go to a file or a pipe
INTERRUPTED = 130  # exit status, as shells have it


class Mistake(click.ClickException):
    """An error of the user: one sentence, exit status 2."""

    exit_code = 2

    def show(self, file: IO[Any] | None = None) -> None:
        """The sentence, without click's lines on usage."""
        click.echo(self.format_message(), err=True, file=file)


def _escaped(error: UnicodeError) -> tuple[str, int]:
    """A character that an encoding lacks, as the escape of JSON and TOML."""
    assert isinstance(error, UnicodeEncodeError)
    return "".join(f"\\u{ord(letter):04x}" for letter in error.object[error.start : error.end]), error.end


codecs.register_error("basset.escaped", _escaped)


class Commands(click.Group):
    """A group of commands: every failure is one sentence, and characters that the output's encoding lacks are escaped."""

    sparing = ""  # what needs less memory

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Parse and run."""
        sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - None where the caller has closed it (`>&-`); it stays open to the end
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):  # the latter in the C locale
                stream.reconfigure(errors="basset.escaped")
        try:
            return super().main(*args, **kwargs)
        except OSError as error:
            Mistake(f"{repr(named(error.filename)) if error.filename else 'the output'} cannot be used: {error.strerror or error}").show()
            _drop_output()
            sys.exit(Mistake.exit_code)

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """Parse."""
        with stopping():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        try:
            with stopping(), printing():
                return super().invoke(ctx)
        except EOFError as error:  # click would say "Aborted!"
            raise click.ClickException(f"a file ends too early: {error or 'more data was expected'}") from None
        except MemoryError as error:
            raise click.ClickException(f"out of memory: {error or 'an allocation failed'}{self.sparing}") from None


@contextlib.contextmanager
def stopping() -> Iterator[None]:
    """An interrupt ends the command with a sentence, where click would say "Aborted!"."""
    try:
        yield
    except KeyboardInterrupt:
        click.echo("stopped: nothing is kept", err=True)
        sys.exit(INTERRUPTED)


def console(error: bool = False) -> Console:
    """Where tables and progress go."""
    from rich.console import Console

    class Screen(Console):
        """A console that leaves it to the command what a closed pipe means."""

        def on_broken_pipe(self) -> None:
            """Let the error pass."""
            raise BrokenPipeError

    made = Screen(stderr=error, markup=False, highlight=False)
    return made if made.is_terminal else Screen(stderr=error, markup=False, highlight=False, width=WIDTH)


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """A reader that closes the pipe is no failure."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        _drop_output()


def _drop_output() -> None:
    """Let what is still to be printed go nowhere."""
    with contextlib.suppress(OSError, ValueError):  # a stream without a file, as tests have it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def named(path: str | os.PathLike[str]) -> str:
    """A file's name as it can be printed and drawn: bytes that are no UTF-8 are written out."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


@contextlib.contextmanager
def progress(name: str, *columns: ProgressColumn, total: float = 1.0) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal, nothing elsewhere; yields a function of the fraction done."""
    from rich.progress import BarColumn, Progress, TextColumn

    screen = console(error=True)
    with Progress(TextColumn(name), BarColumn(), *columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task(name, total=total)
        yield lambda share: bar.update(task, completed=share * total)


def compile_ahead(what: str, task: Callable[[], Any]) -> None:
    """Run `task` once, which compiles what it needs: a line for each function that had to be compiled."""
    began = time.perf_counter()
    found: list[str] = []

    def report(name: str, seconds: float) -> None:
        found.append(name)
        click.echo(f"{what}: {name} compiled in {seconds:.1f} s")

    click.echo(f"{what}: looking")
    with _compile.reported(report), progress(f"compiling for {what}"):
        task()
    click.echo(f"{what}: ready" + (f", {len(found)} compiled in {time.perf_counter() - began:.1f} s" if found else ", all was compiled before"))


@contextlib.contextmanager
def mistakes_of_files(option: str) -> Iterator[None]:
    """Errors of the file system as errors of the user."""
    try:
        yield
    except OSError as error:
        name = f"{named(error.filename)!r} " if error.filename else ""  # what is written through a pipe has none
        raise Mistake(f"{option}: {name}cannot be used: {error.strerror or error}") from None


class OutputPath(click.Path):
    """Where an output goes; "-" is the screen where text is written (None, as without the option), elsewhere a mistake."""

    def __init__(self, text: bool = False) -> None:
        super().__init__(path_type=Path)
        self.text = text

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path."""
        if value != "-":
            return super().convert(value, param, ctx)
        if self.text:
            return None
        raise Mistake("--output must be the name of a file or folder, got '-': the result is not text that can be printed; './-' is a file of that name")


def check_output(path: Path, force: bool, source: str | Path | None = None) -> None:
    """Refuse an output that cannot be written, or is the source, before anything is computed."""
    if source is not None and os.path.realpath(path) == os.path.realpath(source):
        raise Mistake(f"--output must differ from the file that is read, got {str(path)!r} for both")
    if path.is_dir():
        raise Mistake(f"--output must be a file, got the folder {str(path)!r}")
    if is_stream(path):
        if not os.access(path, os.W_OK):
            raise Mistake(f"--output: {str(path)!r} cannot be written to")
        return
    folder = Path(os.path.realpath(path)).parent if path.is_symlink() else path.parent
    if not folder.is_dir():
        raise Mistake(f"--output: the folder {str(folder)!r} does not exist")
    if not os.access(folder, os.W_OK):
        raise Mistake(f"--output: the folder {str(folder)!r} cannot be written to")
    if path.exists() and not force:
        raise Mistake(f"--output: {str(path)!r} exists already; --force overwrites it")


def draw(figure: Any, path: Path) -> None:
    """A picture, whole or not at all."""
    with replacing(path) as name:
        figure.savefig(name, format=path.suffix[1:])
