"""The commands `saltation run|check|advise|ablate|uncertainty|scheme|compare|schema|scenes|campaign|plot|warmup`.

A user's mistake is one sentence on stderr and exit status 2; nothing is written then.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import signal
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import saltation
from basset import __version__, _command
from basset._command import INTERRUPTED, Mistake, OutputPath, check_output, compile_ahead, console, draw, mistakes_of_files, named, printing, progress
from basset._lazy import Later
from saltation._files import DamageError, only_writer, write

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console
    from rich.progress import TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.table import Column, Table

    from basset import _validate, measure
    from saltation import front, statistics
    from saltation.plots import choices as advice_plots
    from saltation.plots import records as record_plots
    from saltation.plots import schemes as scheme_plots
    from saltation.results.result import Result
    from saltation.scene import Scene, read, scene_of, shipped
    from saltation.scene.valid import left
    from saltation.study import campaigns, checks, choices, comparison, grains, schemes, thesis, turbulence
    from saltation.study import effects as advice
    from saltation.workers import cores, processes
else:  # the help needs none of them, most commands a few
    pd, _validate, measure = map(Later, ("pandas", "basset._validate", "basset.measure"))
    Column, Table = (Later("rich.table", name) for name in ("Column", "Table"))
    TextColumn, TimeElapsedColumn, TimeRemainingColumn = (Later("rich.progress", f"{name}Column") for name in ("Text", "TimeElapsed", "TimeRemaining"))
    campaigns, checks, choices, schemes = (Later(f"saltation.study.{name}") for name in ("campaigns", "checks", "choices", "schemes"))
    comparison, record_plots = Later("saltation.study.comparison"), Later("saltation.plots.records")
    advice, grains, thesis, turbulence = (Later(f"saltation.study.{name}") for name in ("effects", "grains", "thesis", "turbulence"))
    advice_plots, scheme_plots = (Later(f"saltation.plots.{name}") for name in ("choices", "schemes"))
    front, statistics = (Later(f"saltation.{name}") for name in ("front", "statistics"))
    left = Later("saltation.scene.valid", "left")
    Scene, read, scene_of, shipped = (Later("saltation.scene", name) for name in ("Scene", "read", "scene_of", "shipped"))
    cores, processes = (Later("saltation.workers", name) for name in ("cores", "processes"))

SCHEMES_SHOWN = 12  # candidates in a printed ranking
PICTURES = (".png", ".pdf", ".svg")
SHOWN = 15  # models in a printed ranking, as in the thesis's fig. 3-10
SERIES = {"thesis": Later("saltation.study.thesis", "thesis"), "grains": Later("saltation.study.thesis", "grains")}
SERIES |= {"turbulence": Later("saltation.study.turbulence", "turbulence")}
KEEPING = ("grains", "turbulence")  # series whose tables need all that each run leaves
STREAM = {"dimensions", "grain.diameter", "channel.transport_stage", "channel.shear_velocity"}
OWN = {  # what the runs of a series differ in
    "thesis": STREAM | {"rotation.law"} | {f"bed.{name}" for name in ("rebound", "roughness", "restitution", "friction", "tangential_retention")},
    "grains": STREAM | {"effects", "cloud.number", "cloud.concentration", "run.duration"},
    "turbulence": STREAM | {"effects", "defaults", "coupling.form", "run.seed"},
}


class Commands(_command.Commands):
    """The group; a bad scene is a mistake wherever it is met."""

    sparing = "; longer steps make a shorter path, run.trajectory = false stores no path"

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except DamageError as error:
            raise Mistake(str(error)) from None
        except ValueError as error:
            from saltation.scene import SceneError

            if isinstance(error, SceneError):
                raise Mistake(str(error)) from None
            raise
        except BrokenExecutor as error:
            raise click.ClickException(f"{error}: nothing is kept") from None


@click.group(cls=Commands)
@click.version_option(__version__, package_name="basset")
def main() -> None:
    """Simulate sand grains that hop over a river bed, with the history force."""


# Scenes


def split_field(option: str, text: str) -> tuple[list[str], str]:
    """(names, value) of "table.field=value"."""
    path, equals, value = text.partition("=")
    names = path.strip().split(".")
    if not equals or not all(names):
        raise Mistake(f"{option} must be table.field=value, got {text!r}")
    return names, value.strip()


def value_of(text: str) -> Any:
    """A value as in TOML; words need no quotes."""
    with contextlib.suppress(ValueError, RecursionError):  # no TOML, an integer of thousands of digits, or lists too deep
        found = tomllib.loads(f"value = {text}")
        if set(found) == {"value"}:
            return found["value"]
    return text


def values_of(text: str) -> list[Any]:
    """Values separated by commas."""
    with contextlib.suppress(ValueError, RecursionError):
        found = tomllib.loads(f"values = [{text}]")
        if set(found) == {"values"}:
            return list(found["values"])
    return [value_of(word.strip()) for word in text.split(",")]


def place(option: str, content: dict[str, Any], names: Sequence[str], value: Any) -> None:
    """Put a value into a field of a scene's content; "" takes the field out."""
    table = content
    for depth, name in enumerate(names[:-1], 1):
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise Mistake(f"{option} {'.'.join(names)}: {'.'.join(names[:depth])} is a field, not a table")
    if value == "":
        table.pop(names[-1], None)
    else:
        table[names[-1]] = value


def changed(content: dict[str, Any], changes: Sequence[str]) -> dict[str, Any]:
    """A scene's content with every --set applied."""
    copy = deepcopy(content) if changes else content
    for change in changes:
        names, value = split_field("--set", change)
        place("--set", copy, names, value_of(value) if value else "")
    return copy


SET = click.option("--set", "changes", multiple=True, metavar="TABLE.FIELD=VALUE", help="Change a field of the scene; an empty value removes it.")


def on_scene(command: Callable[..., None]) -> Callable[..., None]:
    """A command with SCENE and --set."""
    return click.argument("scene")(SET(command))


def made_of(scene: str, changes: Sequence[str]) -> Scene:
    """The scene that they say."""
    return scene_of(changed(read(scene), changes))


# Commands


@main.command("run")
@click.argument("scene")
@click.option("--output", type=OutputPath(), help="Result: a netCDF file, or a CSV file of the jumps; for many grains a folder.")
@click.option("--force", is_flag=True, help="Overwrite the output; for many grains: start anew.")
@SET
@click.option("--quiet", is_flag=True, help="Print only errors and why a run ended early.")
def run(scene: str, output: Path | None, force: bool, changes: tuple[str, ...], quiet: bool) -> None:
    """Simulate SCENE. It is a TOML file or the name of a shipped scene.

    A run of many grains (a scene with a [cloud]) is written to --output while it proceeds: if it is stopped, the same
    command goes on from there.
    """
    from saltation.scene import AUTO

    made = made_of(scene, changes)
    folder = output if made.cloud is not None else None
    if folder is not None:
        check_folder(folder)
    elif output is not None:
        check_output(output, force, scene)
    with stoppable(folder), mistakes_of_files("--output"):
        if made.effects == AUTO:
            with shown("choosing effects", quiet) as report:
                made = front.resolved(made, None, None if force else folder, report)
        if force and folder is not None:
            remove_earlier_run(folder)
        with shown("simulating", quiet) as report:
            result = saltation.run(made, report, folder)
    if output is not None and folder is None:
        with stoppable(None), mistakes_of_files("--output"):
            if output.suffix == ".csv":
                write(output, result.jumps.to_csv(index=False))
            else:
                result.save(output)
    with printing():
        if not quiet:
            print_result(result)
            print_written(output)
        elif result.status != "finished":
            click.echo(f"{result.status}: {result.message}", err=True)
    if result.status in ("failed", "unsettled"):
        sys.exit(1)


def print_written(output: Path | None) -> None:
    """Say where the output is; called once it is there."""
    if output is not None:
        click.echo(f"written: {named(output)}")


def shown(what: str, quiet: bool) -> Any:
    """Progress, unless it is not wanted."""
    return contextlib.nullcontext() if quiet else progress(what, TimeElapsedColumn())


@main.command()
@on_scene
def check(scene: str, changes: tuple[str, ...]) -> None:
    """Show what a run of SCENE would compute. Also its dimensionless numbers, what is left out, and warnings."""
    out, made = console(), made_of(scene, changes)
    print_table(out, ("number", "value", "meaning"), ((number.symbol, f"{number.value:.5g}", number.meaning) for number in checks.numbers(made)))
    out.print("\ncomputed")
    print_table(out, (), checks.computed(made).items())
    out.print(f"\nnot computed: {', '.join(checks.left_out(made)) or 'nothing is left out'}")
    for warning in checks.warnings(made):
        out.print(f"\nwarning: {warning}")


@main.command()
@on_scene
def advise(scene: str, changes: tuple[str, ...]) -> None:
    """Estimate which effects matter in SCENE. The estimates are made from dimensionless numbers, each with reason and source."""
    out, made = console(), made_of(scene, changes)
    rows = ((row.effect, "yes" if row.present else "no", f"{row.share:.2g}", row.verdict, row.reason, row.source) for row in advice.advise(made))
    print_table(out, ("effect", "in the scene", "share", "", "why", "source"), rows)
    for text in left(made):
        out.print(f"\n{text}")
    measured = f"; `saltation ablate {scene}` measures, effects = 'auto' chooses by measurement" if made.bed is not None else ""
    out.print(f"\nestimates for a typical jump{measured}")


@main.command()
@on_scene
@click.option("--error", type=float, default=0.01, show_default=True, help="Relative standard error of the mean height to reach.")
@click.option("--output", type=click.Path(path_type=Path), help="The table (CSV) or the figure (PNG, PDF, SVG).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
def ablate(scene: str, changes: tuple[str, ...], error: float, output: Path | None, force: bool) -> None:
    """Measure what each effect of SCENE changes. Each is left out in turn: changes of mean height, length and velocity, and the cost in time."""
    made = prepared(scene, changes, error, output, force)
    with stoppable(None), progress("leaving out", TimeElapsedColumn()) as report:
        table = advice.ablate(made, error=error, progress=report)
    deliver(output, table.to_csv(), partial(advice_plots.ablation, table, scene=named(scene)))
    print_changes(console(), table)
    print_written(output)


@main.command()
@on_scene
@click.option("--error", type=float, default=0.02, show_default=True, help="Relative standard error of the mean height to reach.")
@click.option("--combined", is_flag=True, help="Also all combinations of the choices: some hundred runs more.")
@click.option("--output", type=click.Path(path_type=Path), help="The table (CSV) or the figure (PNG, PDF, SVG).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
def uncertainty(scene: str, changes: tuple[str, ...], error: float, combined: bool, output: Path | None, force: bool) -> None:
    """Vary the open modelling choices of SCENE. Shows the spread of the mean jump over what measurements leave open, beside its standard error.

    One at a time: velocity profile, range of contact angles, restitution, kernel, treatment of the history force at impacts.
    """
    made = prepared(scene, changes, error, output, force)
    with stoppable(None), progress("varying", TimeElapsedColumn()) as report:
        table = choices.uncertainty(made, error=error, progress=report)
    deliver(output, table.to_csv(), partial(advice_plots.spread, table, scene=named(scene)))
    out = console()
    print_changes(out, table.set_index(["choice", "value"]))
    if combined:
        with stoppable(None), progress("combining", TimeElapsedColumn()) as report:
            everything = choices.combinations(made, progress=report)
        print_combinations(out, everything, made)
    print_written(output)


@main.command("scheme")
@on_scene
@click.option("--error", type=float, default=0.01, show_default=True, help="Relative error of mean height, length and velocity to keep.")
@click.option("--dt", type=float, help="Fixed step to use (d/u*); collocation is then left out.")
@click.option("--seconds", type=float, help="CPU time that the run may take (s): choose the most accurate within it.")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The ranking (JSON, with the scene; CSV) or the diagram (PNG, PDF, SVG).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
def choose_scheme(scene: str, changes: tuple[str, ...], error: float, dt: float | None, seconds: float | None, output: Path | None, force: bool) -> None:
    """Find the fastest history scheme for SCENE. SCENE is run with each scheme and solver: which keeps a given error of the mean jump in the least time.

    Prints the lines for the scene file.
    """
    check_table_or_picture(output, force, kinds=(".json", ".csv", *PICTURES))
    made = made_of(scene, changes)
    try:
        with stoppable(None):
            table = schemes.select_scheme(made, error, dt, seconds=seconds, say=lambda text: click.echo(text, err=True))
    except ValueError as mistake:
        raise Mistake(str(mistake)) from None
    if output is not None and output.suffix == ".json":
        with mistakes_of_files("--output"):
            measure.write_json(output, {**table.attrs, "scene": json.loads(table.attrs["scene"]), "rows": table.to_dict("records")})
    else:
        deliver(output, table.to_csv(), partial(scheme_plots.schemes, table, scene=named(scene)))
    print_schemes(console(), table)
    print_written(output)


@main.command()
@click.argument("record", type=click.Path(path_type=Path))
@on_scene
@click.option("--fit", "fields", multiple=True, metavar="FIELD[=LOW,HIGH]", help="Fit a numeric field of the scene (bed.restitution), `time` or `zero`.")
@click.option("--columns", metavar="NAMES", help="Names of the columns of RECORD, in place of its own: 't (ms),gap (mm)'.")
@click.option("--from", "start", type=float, help="The record's time at which the scene starts (s).  [default: its first time]")
@click.option("--contact", type=float, help="Instead of --from: the record's time of the first contact (s).")
@click.option("--until", type=float, help="Leave out later samples (s).")
@click.option(
    "--error", "errors", multiple=True, metavar="[QUANTITY=]SD", help="Standard deviation of the noise (m, m/s).  [default: estimated from the record]"
)
@click.option("--output", type=click.Path(path_type=Path), help="Record and model (CSV) or the figure (PNG, PDF, SVG).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
def compare(
    record: Path,
    scene: str,
    changes: tuple[str, ...],
    fields: tuple[str, ...],
    columns: str | None,
    start: float | None,
    contact: float | None,
    until: float | None,
    errors: tuple[str, ...],
    output: Path | None,
    force: bool,
) -> None:
    """Compare a measured motion with SCENE. RECORD is the motion of one grain; fields of the scene can be fitted to it, with confidence intervals.

    RECORD is a text table or a netCDF-3 file: times, and one or more of x, y, z (of the centre), gap (between bed and grain), u, v, w
    (velocity along the stream, across, up), speed, depth, fall velocity; columns are found by these names, with a unit or in SI. `time` fits
    by how many seconds the record's clock is late, `zero` by how many metres its zero of heights lies below the bed.
    """
    check_table_or_picture(output, force, record)
    if start is not None and contact is not None:
        raise Mistake("--from and --contact exclude each other: each follows from the other by the simulation")
    made, fit = made_of(scene, changes), dict(map(range_of, fields))
    names = [name.strip() for name in columns.split(",")] if columns is not None else []
    try:
        with stoppable(None), mistakes_of_files("RECORD"), progress("fitting" if fit else "simulating", TimeElapsedColumn()) as report:
            found = comparison.compare(record, made, fit, columns=names, start=start, contact=contact, until=until, error=noise_of(errors), progress=report)
    except (TypeError, ValueError) as error:
        raise Mistake(str(error)) from None
    deliver(output, found.points.to_csv(index=False), lambda: record_plots.comparison(found, f"{named(record.name)} and {named(scene)}"))
    print_comparison(console(), found)
    print_written(output)


def range_of(text: str) -> tuple[str, tuple[float, float] | None]:
    """(field, range or None) of a --fit."""
    name, equals, ends = text.partition("=")
    found = values_of(ends)
    if not name.strip() or (equals and (len(found) != 2 or any(isinstance(end, bool) or not isinstance(end, (int, float)) for end in found))):
        raise Mistake(f"--fit must be FIELD or FIELD=LOW,HIGH, got {text!r}")
    return name.strip(), (found[0], found[1]) if equals else None


def noise_of(errors: Sequence[str]) -> float | dict[str, float] | None:
    """What --error says: of all quantities, or of each."""
    found: dict[str, float] = {}
    for text in errors:
        name, _, value = text.rpartition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            raise Mistake(f"--error must be a number or QUANTITY=NUMBER (m or m/s), got {text!r}") from None
    if "" in found and len(errors) > 1:
        raise Mistake("--error must be given once, or for each quantity as QUANTITY=NUMBER")
    return found.get("", found) if found else None


def check_ending(option: str, path: Path, kinds: Sequence[str]) -> None:
    """Refuse a kind of file that is not written."""
    if path.suffix not in kinds:
        raise Mistake(f"{option} must end in {', '.join(kinds[:-1])}{' or ' if len(kinds) > 1 else ''}{kinds[-1]}, got {str(path)!r}")


def check_table_or_picture(output: Path | None, force: bool, source: str | Path | None = None, kinds: Sequence[str] = (".csv", *PICTURES)) -> None:
    """Refuse an output that is neither, or cannot be written."""
    if output is not None:
        check_ending("--output", output, kinds)
        check_output(output, force, source)


def prepared(scene: str, changes: tuple[str, ...], error: float, output: Path | None, force: bool) -> Scene:
    """The scene; mistakes are found before anything is computed."""
    if not 1e-3 <= error <= 0.5:
        raise Mistake(f"--error must lie between 0.001 and 0.5, got {error:g}")
    check_table_or_picture(output, force)
    return made_of(scene, changes)


def deliver(output: Path | None, table: str, picture: Callable[[], Any]) -> None:
    """Write the table, which is CSV, or its picture."""
    if output is None:
        return
    with mistakes_of_files("--output"):
        if output.suffix == ".csv":
            write(output, table)
        else:
            draw(picture(), output)


@main.command()
def schema() -> None:
    """Print the JSON schema of a scene. It has all fields, with units and defaults."""
    click.echo(json.dumps(Scene.model_json_schema(), indent=2, ensure_ascii=False))


@main.command()
def scenes() -> None:
    """List the scenes of the package."""
    print_table(console(), (), ((name, path.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")) for name, path in shipped().items()))


@main.command()
@click.argument("what", nargs=-1, required=True, metavar="thesis|grains|turbulence|SCENE...")
@click.option("--output", type=OutputPath(), default=Path("campaign"), show_default=True, help="Folder for the tables and the finished runs.")
@SET
@click.option(
    "--vary", "varied", multiple=True, metavar="TABLE.FIELD=V1,V2,...", help="Run with each of these values; if given several times, with all combinations."
)
@click.option("--workers", type=int, help="Number of processes.  [default: all cores]")
@click.option("--scheduler", metavar="ADDRESS", help="Run on a dask cluster instead.")
@click.option("--rank", is_flag=True, help="Rank your own models too, against published regressions or --reference.")
@click.option("--reference", type=click.Path(path_type=Path), help="Measured means to rank against (CSV: variable, T, mean, sd, n, source).")
@click.option(
    "--reference-particle-reynolds", "reference_reynolds", type=float, default=73.0, show_default=True, help="R_p of the measurements in --reference."
)
def campaign(
    what: tuple[str, ...],
    output: Path,
    changes: tuple[str, ...],
    varied: tuple[str, ...],
    workers: int | None,
    scheduler: str | None,
    rank: bool,
    reference: Path | None,
    reference_reynolds: float,
) -> None:
    """Run many scenes. They are a series of this package, or your own SCENE files.

    `thesis`: the thesis's 256 runs of one grain, ranked. `grains`: its 24 runs of many grains, compared. `turbulence`: 240 runs with and
    without turbulence and two-way coupling.

    Finished runs are kept in the output folder: if it is stopped, the same command goes on from there. `grains` and
    `turbulence` also keep the full result of each run, in the folder `runs`.
    """
    if workers is not None and workers < 1:
        raise Mistake(f"--workers must be a whole number, 1 or greater, got {workers}")
    if workers is not None and scheduler is not None:
        raise Mistake("--workers and --scheduler exclude each other: a cluster has its own workers")
    if output.exists() and not output.is_dir():
        raise Mistake(f"--output must be a folder, got the file {str(output)!r}")
    measured = read_reference(reference) if reference is not None else None
    runs, models = planned(what, changes, varied)
    workers = workers and min(workers, len(runs), cores())
    with stoppable(output), executor_of(workers, scheduler) as executor, mistakes_of_files("--output"):
        columns = (TextColumn("{task.completed:.0f}/{task.total:.0f} scenes"), TimeElapsedColumn(), TextColumn("remaining"), TimeRemainingColumn())
        with progress("campaign", *columns, total=len(runs)) as report:
            try:
                results = output / "runs" if what[0] in KEEPING else None
                table = front.campaign(runs, executor, progress=report, store=output / "store", results=results)
            except BrokenExecutor as error:
                raise click.ClickException(f"{error}: what is finished is kept in {str(output)!r}, the same command goes on from there") from None
        write(output / "table.csv", table.to_csv(index=False))
        tables = {}
        if what[0] in KEEPING:
            study = grains if what[0] == "grains" else turbulence
            tables = study.analyses(table, lambda name: saltation.open(output / "runs" / f"{name}.nc"))
        elif what[0] == "thesis" or rank or measured is not None:
            try:
                if table["stage"].isna().any():
                    raise ValueError("every scene needs a [channel]")
                ranking = thesis.judge(table, measured, particle_reynolds=reference_reynolds, models=models)
            except ValueError as error:
                raise Mistake(f"written: {named(output / 'table.csv')}; no ranking: {error}") from None
            tables = {"ranking": ranking}
        for name, found in tables.items():
            write(output / f"{name}.csv", found.to_csv(index=False))
    out = console()
    counts = ", ".join(f"{count} {status}" for status, count in table["status"].value_counts().items())
    out.print(f"{len(table)} scenes: {counts}")
    if what[0] not in ("thesis", "turbulence"):
        print_means(out, table)
    if what[0] == "grains":
        print_grains(out, tables)
    elif what[0] == "turbulence":
        print_turbulence(out, tables["changes"])
    elif tables:
        print_ranking(out, tables["ranking"])
    print_written(output)


@main.command()
@click.argument("result", type=click.Path(path_type=Path))
@click.option("--figure", "names", multiple=True, metavar="NAME", help="Figure to draw.  [default: all that the result allows]")
@click.option("--output", type=click.Path(path_type=Path), help="The figure (PNG, PDF, SVG); of several, NAME is added to each file.")
@click.option("--animate", "film", type=click.Path(path_type=Path), help="Write an animation (GIF) of many grains, instead of figures or with those named.")
def plot(result: Path, names: tuple[str, ...], output: Path | None, film: Path | None) -> None:
    """Draw figures of RESULT. It is a file written by `saltation run --output`, or the folder of a run of many grains."""
    from saltation.plots import plots_of

    known = list(plots_of(cloud=False) | plots_of(cloud=True))
    for name in names:
        if name not in known:
            raise Mistake(f"--figure must be one of {', '.join(map(repr, known))}, got {name!r}{_validate.suggestion(name, known)}")
    target = output or picture_of(result)
    check_picture("--output", target, PICTURES)
    if target == result:
        raise Mistake(f"--output must be another file than RESULT, got {str(target)!r}")
    if film is not None:
        check_picture("--animate", film, (".gif",))
    with mistakes_of_files("RESULT"):
        opened = open_result(result)
    cloud = opened.scene.cloud is not None
    own = plots_of(cloud)
    for name in names:
        if name not in own:
            raise Mistake(f"--figure {name}: of {'many grains' if cloud else 'a single grain'} there are {', '.join(map(repr, own))}")
    if film is not None:
        draw_film(opened, film, cloud)
    chosen = list(dict.fromkeys(names)) or (list(own) if film is None else [])
    for name in chosen:
        try:
            figure = own[name](opened)
        except ValueError as error:
            if names:
                raise Mistake(f"--figure {name}: {error}") from None
            click.echo(f"left out: {name}, {error}", err=True)
            continue
        path = target if len(chosen) == 1 else target.with_stem(f"{target.stem}_{name}")
        with mistakes_of_files("--output"):
            draw(figure, path)
        click.echo(f"written: {named(path)}")


@main.command()
@click.argument("names", nargs=-1, metavar="[SCENE]...")
def warmup(names: tuple[str, ...]) -> None:
    """Compile in advance. Runs of each SCENE then start at once; default: the scenes of the package."""
    made = {name: scene_of(read(name)) for name in names or shipped()}  # mistakes first
    with stoppable(None):
        for name, scene in made.items():
            compile_ahead(name, partial(front.warm, scene))


# What commands share


@contextlib.contextmanager
def stoppable(output: Path | None) -> Iterator[None]:
    """SIGTERM and an interrupt end the command with a sentence: what is finished is kept in `output`."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second one would only cut off the sentence
        begun = output is not None and output.is_dir() and any(output.iterdir())
        kept = f"what is finished is kept in {str(output)!r}, the same command goes on from there" if begun else "nothing is kept"
        click.echo(f"stopped: {kept}", err=True)
        sys.exit(INTERRUPTED)
    finally:
        signal.signal(signal.SIGTERM, before)


def check_folder(path: Path) -> None:
    """Refuse before anything is computed."""
    if path.exists() and not path.is_dir():
        raise Mistake(f"--output must be a folder for a scene with a [cloud], got the file {str(path)!r}")
    if not path.parent.is_dir():
        raise Mistake(f"--output: the folder {str(path.parent)!r} does not exist")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise Mistake(f"--output: the folder {str(path)!r} cannot be written to")


def remove_earlier_run(path: Path) -> None:
    """Remove the files of an earlier run, once the next is ready to start."""
    if (path / "run.json").exists() or (path / "checkpoint.npz").exists():
        with only_writer(path):
            for file in (*path.glob("part-*.nc"), path / "checkpoint.npz", path / "run.json"):
                file.unlink(missing_ok=True)


def open_result(path: Path) -> Result:
    """A result from a file or a folder."""
    try:
        return saltation.open(path)
    except DamageError as error:
        raise Mistake(f"RESULT: {error}") from None


def picture_of(result: Path) -> Path:
    """The picture beside a result, called like it."""
    own = result if result.name not in ("", "..") else Path(os.path.abspath(result))
    return own.with_suffix(".png") if own.name else Path("figure.png")


def check_picture(option: str, path: Path, kinds: Sequence[str]) -> None:
    """Refuse before anything is drawn."""
    check_ending(option, path, kinds)
    if not path.parent.is_dir():
        raise Mistake(f"{option}: the folder {str(path.parent)!r} does not exist")


def draw_film(result: Any, path: Path, cloud: bool) -> None:
    """The animation, with a bar on a terminal."""
    if not cloud:
        raise Mistake("--animate needs a run of many grains: a scene with a [cloud]")
    from saltation.plots.film import animate

    with mistakes_of_files("--animate"), progress("drawing", TimeElapsedColumn()) as report:
        try:
            animate(result, path, progress=report)
        except ValueError as error:
            raise Mistake(f"--animate: {error}") from None
    click.echo(f"written: {named(path)}")


def read_reference(path: Path) -> pd.DataFrame:
    """Measured means."""
    try:
        return statistics.read_reference(path)
    except OSError as error:
        raise Mistake(f"--reference: {str(path)!r} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise Mistake(f"--reference: {error}") from None


def planned(what: Sequence[str], changes: Sequence[str], varied: Sequence[str]) -> tuple[list[tuple[dict[str, Any], Any]], list[str]]:
    """(labelled scenes, the labels that make a model)."""
    axes = [axis_of(text) for text in varied]
    fields = [".".join(names) for names, _ in axes]
    for field in fields:
        if fields.count(field) > 1:
            raise Mistake(f"--vary {field} must be given once, with all its values: {field}=v1,v2,…")
    series = what[0] if len(what) == 1 and what[0] in SERIES else None
    if series is not None:
        if series in KEEPING and axes:
            raise Mistake(f"--vary is not for {series}: give --set, and a folder for each value")
        for option, field in [("--set", change.partition("=")[0].strip()) for change in changes] + [("--vary", field) for field in fields]:
            if any(f"{own}.".startswith(f"{field}.") or f"{field}.".startswith(f"{own}.") for own in OWN[series]):
                raise Mistake(f"{option} {field}: the runs of {series!r} differ in it themselves")
        base = [(labels, scene.model_dump(exclude_unset=True)) for labels, scene in SERIES[series]()]
        models = list(thesis.MODEL)
    else:
        stems = [Path(name).stem for name in what]
        base = [({"scene": named(stem if stems.count(stem) == 1 else name)}, read(name)) for stem, name in zip(stems, what, strict=True)]
        models = ["scene"]
    models += [field for field in fields if not field.startswith(("grain.", "fluid.")) and field not in ("channel.transport_stage", "channel.shear_velocity")]
    runs = []
    for labels, content in base:
        for values in itertools.product(*(values for _, values in axes)):
            copy = deepcopy(content)
            for (names, _), value in zip(axes, values, strict=True):
                place("--vary", copy, names, value)
            scene = scene_of(changed(copy, changes))
            own = {**labels, **{field: value if isinstance(value, (int, float, str)) else str(value) for field, value in zip(fields, values, strict=True)}}
            for name, actual in (("particle_reynolds", scene.numbers.particle_reynolds), ("stage", scene.numbers.stage)):
                if name not in own or actual is None or not math.isclose(own[name], actual):
                    own[name] = actual
            runs.append((own, scene))
    return runs, models


def axis_of(text: str) -> tuple[list[str], list[Any]]:
    """(names, values) of a --vary."""
    names, values = split_field("--vary", text)
    found = values_of(values) if values else []
    if not found:
        raise Mistake(f"--vary must be table.field=v1,v2,…, got {text!r}")
    return names, found


@contextlib.contextmanager
def executor_of(workers: int | None, scheduler: str | None) -> Iterator[Executor | None]:
    """None (the default), so many processes, or a cluster's."""
    if scheduler is not None:
        try:
            from distributed import Client
        except ImportError:
            raise Mistake("--scheduler needs dask: pip install 'basset[cluster]'") from None
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise Mistake(f"--scheduler: no cluster answers at {scheduler!r}: {' '.join(str(error).split())}") from None
        with client:
            yield client.get_executor()
    elif workers is not None:
        with processes(workers) as pool:
            yield pool
    else:
        yield None


# What commands print


def print_table(out: Console, heads: Sequence[str | Column], rows: Iterable[Sequence[str]], **look: Any) -> None:
    """A table without lines; without heads, rows alone."""
    table = Table(*heads, box=None, show_header=bool(heads), **look)
    for row in rows:
        table.add_row(*row)
    out.print(table)


def print_result(result: Result) -> None:
    """Summary, bed load or how often grains meet, and what to be wary of."""
    out, known, cloud, unit = console(), result.provenance, result.scene.cloud, result.scene.numbers.unit("d/u*")
    many = f"{cloud.number} grains, {result.time:.4g} {unit}, " if cloud is not None else ""
    out.print(f"{result.status}: {result.message}; {many}{len(result.jumps)} jumps counted")
    if len(result.jumps):
        print_summary(out, result)
    if cloud is not None:
        often = result.frequencies()
        out.print(f"impacts on the bed {often['bed']:.4g} and encounters {often['pairs']:.4g} per {unit}, ratio {often['ratio']:.3g}")
    elif result.scene.numbers.stage is not None and len(result.jumps):
        print_bed_load(out, result)
    print_rests(out, result)
    print_coupling(out, result)
    print_choice(out, result.scene)
    for fate, number in result.fates["fate"].value_counts().items():
        out.print(f"grains ended {fate}: {number}")
    if cloud is None and known["stokes"] is not None:
        low, high = known["stokes"]
        out.print(f"impacts: {known['clipped']:.0%} clipped to 30°, {known['creeping']:.0%} of jumps below 0.1 d, Stokes number {low:.3g} to {high:.3g}")
    for text in known["outside_validity"]:
        out.print(f"warning: {text}")


def print_bed_load(out: Console, result: Result) -> None:
    """The rate, or why there is none."""
    try:
        load = result.bed_load()
    except ValueError as error:
        out.print(f"no bed load: {error}")
        return
    out.print(
        f"bed load q* {load['rate']:.3g} (dynamic friction {load['dynamic_friction']:.3g}); "
        f"Meyer-Peter & Müller {load['meyer_peter_mueller']:.3g}, Wong & Parker {load['wong_parker']:.3g}"
    )


def print_rests(out: Console, result: Result) -> None:
    """How long grains lay still."""
    if result.scene.rests is not None:
        lasted, unit = result.rests["duration"], result.scene.numbers.unit("d/u*")
        told = f" of {lasted.mean():.3g} {unit} on average" if len(lasted) else ""
        share = f", {result.resting():.3g} grains at rest per moving one" if result.path is not None or result.scene.cloud is None else ""
        out.print(f"{len(lasted)} completed rests{told}{share}")


def print_coupling(out: Console, result: Result) -> None:
    """What two-way coupling came to."""
    made = result.scene.coupling and result.scene.coupling.settled
    if not made:
        return
    stream = {str(name): float(value) for name, value in result.coupled().data_vars.items() if not value.dims}
    out.print(
        f"coupling: {made.runs} runs, stresses of stream and grains add up to the total within {made.change:.1g} ρu*²; at the bed grains carry "
        f"{stream['bed_stress']:.3g} ρu*², {stream['moving_grains']:.3g} moving per m²"
    )
    out.print(
        f"coupled bed load q* {stream['bed_load']:.3g}, {stream['bed_load_flux']:.3g} m²/s (q* {stream['bed_load_before']:.3g} in the profile without grains)"
    )


def print_choice(out: Console, scene: Scene) -> None:
    """What effects = "auto" came to."""
    found = scene.chosen
    if found is not None and found.status != "finished":
        out.print(f"effects: all kept, because the run with all of them ended {found.status}")
    elif found is not None:
        gone = ", ".join(f"{name} (changes less than {found.bounds[name]:.1%})" if name in found.bounds else name for name in found.left_out)
        out.print(f"effects: {', '.join(found.kept)}; left out within {found.tolerance:.0%}: {gone or 'nothing'}; {found.jumps} jumps simulated to choose")


def print_summary(out: Console, result: Any) -> None:
    """Mean, standard error and standard deviation, one line per quantity."""
    from saltation.results.tables import STREAM, UNITS

    numbers, keys = result.scene.numbers, ("mean", "standard_error", "standard_deviation")
    told = {str(name): row for name, row in result.summary().iterrows() if name not in STREAM}  # which are said below
    rows = ((name, *(f"{row[key]:.4g}" for key in keys), numbers.unit(UNITS[name][0])) for name, row in told.items())
    print_table(out, ("", *(Column(key.replace("_", " "), justify="right") for key in keys), "unit"), rows)
    if numbers.stage is None:
        out.print(f"{numbers.scale} = {numbers.velocity:.4g} m/s: still water has no u*")


def print_changes(out: Console, table: pd.DataFrame) -> None:
    """Relative changes of H, L and ū against the first row, in per cent with their standard errors."""
    names = [name for name in table.index.names if name is not None] or [""]
    timed = ["time"] if "time" in table and table["time"].notna().any() else []
    rows = []
    for index, row in table.iterrows():
        labels = index if isinstance(index, tuple) else (index,)
        pairs = [(100.0 * row[f"{name}_change"], 100.0 * row[f"{name}_error"]) for name in statistics.VARIABLES]
        cells = [f"{change:+.1f} ± {error:.1g}" if math.isfinite(change) else "–" for change, error in pairs]
        rows.append((*map(str, labels), row["status"], str(row["jumps"]), *cells, *(f"{row[name]:.2f} ×" for name in timed)))
    print_table(out, (*names, "status", "jumps", *(f"{name} (%)" for name in statistics.VARIABLES), *(["time per jump"] if timed else [])), rows)


def print_schemes(out: Console, table: pd.DataFrame) -> None:
    """The best row of each candidate, what was chosen and why, the lines for the scene file."""
    rows = []
    for _, row in table.drop_duplicates(["scheme", "solver"]).head(SCHEMES_SHOWN).iterrows():
        size = [f"{row[name]:g}" if math.isfinite(row[name]) else "" for name in ("dt", "rtol")]
        note = "extrapolated" if row["runs"] == 0 else "" if row["status"] == "finished" else row["status"]
        rows.append((row["scheme"], row["solver"], *size, f"{100.0 * row['error']:.2g}", f"{row['seconds']:.2g}", f"{row['bytes']:.3g}", note))
    print_table(out, ("scheme", "solver", f"dt ({table.attrs['units']['dt']})", "rtol", "error (%)", "time per jump (s)", "bytes", ""), rows)
    out.print(f"\n{schemes.verdict(table)}\n\nin the scene file:\n{table.attrs['toml']}", soft_wrap=True)


def print_comparison(out: Console, found: comparison.Comparison) -> None:
    """The misfit of each quantity, the fitted fields, what was held, what to be wary of."""
    rows = []
    for name, row in found.misfit.iterrows():
        numbers = (f"{row[key]:.3g}" if math.isfinite(row[key]) else "–" for key in ("rms", "largest", "noise"))
        rows.append((str(name), str(row["points"]), *numbers, row["unit"]))
    print_table(out, ("quantity", "points", "rms residual", "largest", "noise", "unit"), rows)
    if len(found.fitted):
        out.print()
        rows = []
        for name, row in found.fitted.iterrows():
            pairs = [f"{_within(row, low)} to {_within(row, high)}" for low, high in (("low", "high"), ("blocks_low", "blocks_high"))]
            rows.append((str(name), _within(row, "value"), *pairs, f"{row['least']:.4g} to {row['most']:.4g}", row["unit"]))
        print_table(out, ("fitted", "value", "95 % interval", "from blocks of residuals", "searched", "unit"), rows)
    out.print(f"\nnot fitted: {', '.join(f'{name} = {value}' for name, value in found.held.items())}")
    for note in found.notes:
        out.print(f"\nnote: {note}")


def _within(row: pd.Series, key: str) -> str:
    """A number with two digits of its standard error."""
    value, error = row[key], row["standard_error"]
    digits = 2 + math.ceil(math.log10(abs(value) / error)) if value and error > 0.0 else 3
    return f"{value:.{min(max(digits, 1), 9)}g}"


def print_combinations(out: Console, table: pd.DataFrame, scene: Scene) -> None:
    """Quantiles over all combinations, and what each choice contributes."""
    finished = table["status"] == "finished"
    out.print(f"\nall {len(table)} combinations, {finished.sum()} of them finish")
    from saltation.results.tables import UNITS

    names = statistics.VARIABLES
    rows = [(f"{quantile:.0%} quantile", *(f"{row[name]:.3g}" for name in names)) for quantile, row in choices.extent(table).iterrows()]
    rows += [(f"share of {choice} in the spread", *(f"{row[name]:.0%}" for name in names)) for choice, row in choices.shares(table).iterrows()]
    print_table(out, ("", *(f"{name} ({scene.numbers.unit(UNITS[name][0])})" for name in names)), rows)


def print_means(out: Console, table: pd.DataFrame) -> None:
    """One line per scene."""
    labels = [name for name in table if name not in (*campaigns.COLUMNS, "name")]
    often = [name for name in ("bed_frequency", "pair_frequency") if table[name].notna().any()]
    rows = []
    for _, row in table.iterrows():
        means = (f"{row[name]:.4g} ± {row[f'{name}_se']:.2g}" for name in statistics.VARIABLES)
        rows.append((*(_short(row[name]) for name in labels), *means, *(_short(row[name]) for name in often), str(row["jumps"]), row["status"]))
    print_table(out, (*labels, "height", "length", "velocity", *(name.replace("_", " ") for name in often), "jumps", "status"), rows)


def print_grains(out: Console, tables: dict[str, pd.DataFrame]) -> None:
    """Table 4-2, what encounters change of the jumps, and the exponents of the run that the thesis draws, printed ones in brackets."""
    head = ["C_p", "R_p", "T"]
    frequencies = ("pair_frequency", "bed_frequency", "ratio")
    rows = [(*_run(row), *(_beside(row[name], row[f"{name}_printed"]) for name in frequencies)) for _, row in tables["table_4_2"].iterrows()]
    print_table(out, (*head, "F_pp", "F_pb", "F_pb/F_pp"), rows, title="encounters and impacts on the bed per d/u* (Table 4-2)", title_justify="left")
    rows = []
    for _, both in tables["comparison"].groupby(grains.RUN, sort=False):
        own = [both[both["quantity"] == name].iloc[0] for name in ("height", "length")]
        found = [(f"{row['difference']:+.2g} ± {row['standard_error']:.2g}", f"{row['p_bootstrap']:.2g}", f"{row['p_wilcoxon']:.2g}") for row in own]
        rows.append((*_run(both.iloc[0]), *found[0], *found[1]))
    title = "difference that encounters make; its p by blocks of jumps within grains and by the rank-sum test (figs 4-10 to 4-12)"
    print_table(out, (*head, "height", "p blocks", "p ranks", "length", "p blocks", "p ranks"), rows, title=title, title_justify="left")
    every = tables["exponents"]
    if every.empty:
        return
    drawn = every[every["printed"].notna().groupby([every[name] for name in grains.RUN]).transform("any")]
    rows = []
    for (axis, meeting, ensemble), each in drawn.groupby(["axis", "encounters", "ensemble"], sort=False):
        cells = [_beside(row["gamma"], row["printed"]) + f" {row['lower']:.2f} to {row['upper']:.2f}" for _, row in each.iterrows()]
        rows.append((axis, "with" if meeting else "without", ensemble, *cells))
    title = "γ of ⟨X'²⟩ and ⟨Y'²⟩, 95 % intervals (figs 4-17 and 4-18)"
    print_table(out, ("axis", "encounters", "ensemble", *grains.RANGES), rows, title=title, title_justify="left")


def print_turbulence(out: Console, table: pd.DataFrame) -> None:
    """What turbulence and coupling change, with 95 % intervals over seeds."""
    lines = []
    for (laws, size, stage, variant), rows in table.groupby([*turbulence.RUN, "variant"], sort=False):
        own = rows.set_index("quantity")
        cells = []
        for name in statistics.VARIABLES:
            row = own.loc[name]
            cells += [f"{row['mean']:.3g}", "" if variant == "plain" else f"{row['change']:+.2g} ± {row['interval']:.1g}"]
        lines.append((laws, _short(size), _short(stage), variant, *cells, own["status"].iloc[0]))
    print_table(out, ("laws", "R_p", "T", "variant", "height", "change", "length", "change", "velocity", "change", "status"), lines)


def _run(row: pd.Series) -> tuple[str, ...]:
    return f"{row['concentration']:.2%}", _short(row["particle_reynolds"]), _short(row["stage"])


def _beside(value: float, printed: float) -> str:
    return f"{value:.3g}" + (f" ({printed:g})" if pd.notna(printed) else "")


def print_ranking(out: Console, ranking: pd.DataFrame) -> None:
    """The best models: mean rank, and per R_p and source rank, error, and overlap or share inside the envelope."""
    against = list(dict.fromkeys(zip(ranking["particle_reynolds"], ranking["source"], strict=True)))
    heads = [f"R_p {reynolds:.4g}, {source}" for reynolds, source in sorted(against)]
    lines = []
    models = list(dict.fromkeys(ranking["model"]))
    for model in models[:SHOWN]:
        rows = ranking[ranking["model"] == model]
        cells = []
        for reynolds, source in sorted(against):
            row = rows[(rows["particle_reynolds"] == reynolds) & (rows["source"] == source)]
            cells.append(_score(row.iloc[0]) if len(row) else "")
        lines.append((model, _short(rows["mean_rank"].iloc[0]), *cells))
    print_table(out, ("model", "mean rank", *heads), lines)
    if len(models) > SHOWN:
        out.print(f"and {len(models) - SHOWN} more")


def _score(row: pd.Series) -> str:
    inside = f", {row['inside']:.0%} inside" if pd.notna(row["inside"]) else ""
    overlap = f", overlap {row['overlap_index']:.0f} %" if pd.notna(row["overlap_index"]) else ""
    return f"{_short(row['rank'])}: error {row['error_index']:.2f}{overlap}{inside}" if pd.notna(row["rank"]) else "no mean"


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
