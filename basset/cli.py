"""The commands `basset advise|compare|weights|sum|history|warmup`.

A user's mistake is one sentence on stderr and exit status 2; nothing is written then.
"""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import basset
from basset import __version__, _command
from basset._command import INTERRUPTED, Mistake, OutputPath, check_output, compile_ahead, console, draw, mistakes_of_files, progress
from basset._files import write
from basset._lazy import Later

if TYPE_CHECKING:
    from rich.table import Table

    from basset import _validate, advice, comparison, exported, samples, tracks
    from basset.advice import Advice
else:  # the help needs none of them
    Table = Later("rich.table", "Table")
    _validate, advice, comparison, samples = map(Later, ("basset._validate", "basset.advice", "basset.comparison", "basset.samples"))
    exported, tracks = map(Later, ("basset.exported", "basset.tracks"))

KERNELS = {  # what they need beside the viscosity
    "basset": (),
    "mei_adrian": ("slip", "diameter"),
    "dorgan_loth": ("slip", "diameter"),
    "slip_sphere": ("slip_length", "diameter"),
    "bubble": ("diameter",),
}
OF_KERNELS = {"slip": "m/s", "slip_length": "m", "diameter": "m"}
SHOWN = 12  # candidates in a table
PAUSE = 10.0  # s between lines of progress where there is no terminal
PICTURES = (".png", ".pdf", ".svg")
ERRORS = tuple(10.0**-k for k in range(1, 13))

SCENES = "for a scene use `saltation scheme SCENE`: the errors above are for smooth samples; after a takeoff, where the slip starts as √t, they are far larger"
MOST_STEPS = 10_000_000  # weights are good to rounding up to here


class Commands(_command.Commands):
    """The group; errors of the library about its arguments are errors of the user."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except (ValueError, TypeError) as error:
            raise Mistake(str(error)) from None


@click.group(cls=Commands)
@click.version_option(__version__, package_name="basset")
def main() -> None:
    """The Basset history force: choose and compare schemes, print their weights, compute forces along tracks."""


def with_options(*options: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator for commands that share options."""

    def added(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return added


def with_format(default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options that say how numbers are written, and where."""
    return with_options(
        click.option("--format", "form", default=default, show_default=True, help="table, csv, json, c (a C99 header) or fortran (a 2008 module)."),
        click.option("--output", type=OutputPath(text=True), help="A file instead of the screen."),
        click.option("--force", is_flag=True, help="Overwrite the output."),
    )


with_kernel = with_options(
    click.option("--kernel", default="basset", show_default=True, help=f"Memory kernel: {', '.join(KERNELS)}."),
    click.option("--slip", type=float, help="Slip velocity of the finite-Reynolds kernels, m/s."),
    click.option("--slip-length", type=float, help="Slip length of slip_sphere, m."),
    click.option("--diameter", type=float, help="Diameter of the particle, m; needed by `history` and by all kernels but basset."),
    click.option("--viscosity", type=float, default=1e-6, show_default=True, help="Kinematic viscosity, m²/s."),
)
with_samples = with_options(  # how a file of samples is read
    click.option("--input", "kind", default="rate", show_default=True, help="What the samples are: rate (df/dt) or slip (f)."),
    click.option("--sample-step", type=float, help="Step of the samples in seconds.  [default: from the times in the file]"),
    click.option("--variable", help="The variable to read from a netCDF file."),
)


@main.command()
@click.option("--error", type=float, required=True, help="Largest error allowed, relative to the largest |H|.")
@click.option("--time-scale", type=float, help="How fast the rate changes: 1/ω of the fastest oscillation, seconds.")
@click.option("--samples", "file", type=click.Path(path_type=Path), help="Instead of --time-scale, a finely sampled stretch of the path: .csv, .npy or .nc.")
@with_samples
@click.option("--dt", type=float, help="The step in seconds.  [default: the longest that keeps the error]")
@click.option("--steps", type=int, help="Number of steps, with --dt.")
@click.option("--duration", type=float, help="Length of the path in seconds, instead of --steps.")
@click.option("--particles", type=int, default=1, show_default=True, help="Particles that are computed together.")
@click.option("--components", type=int, default=3, show_default=True, help="Components of each particle.")
@click.option("--memory", type=float, default=math.inf, help="Largest memory allowed, in bytes.  [default: no limit]")
@click.option("--use", default="stream", show_default=True, help="stream: one sample at a time; path: all samples are known.")
@click.option("--relaxation", type=float, help="λ of y' = −λy − c·H[y] that the stream is used in, 1/s: diverging steps are left out.  [default: 1/T]")
@click.option("--coefficient", type=float, help="c of that equation, s^(-1/2); set both to 0 where H is not fed back.  [default: 1/√T]")
@with_kernel
def advise(file: Path | None, kind: str, sample_step: float | None, variable: str | None, error: float, **options: Any) -> None:
    """Rank the schemes by predicted error, time and memory. The one to take is printed as Python code."""
    kernel = kernel_of(**{name: options.pop(name) for name in ("kernel", "viscosity", *OF_KERNELS)})
    from basset.weights.table import INPUTS

    _validate.choice("input", kind, INPUTS)
    if file is not None:
        with mistakes_of_files("--samples"):
            g, options["sample_step"] = samples.read(file, sample_step, variable)
        options["samples"] = advice.rates(g, options["sample_step"]) if kind == "slip" else g
    found = basset.advise(error, kernel=kernel, **options)
    best = found.best  # what cannot be met is a mistake: nothing is printed then
    out = console()
    out.print(ranking(found))
    if len(found.candidates) > SHOWN:
        out.print(f"and {len(found.candidates) - SHOWN} more")
    if file is not None:
        out.print(f"\ntime scale of the samples: {found.time_scale:.3g} s")
    out.print(f"\ntake, with dt = {best.dt:.6g} s:\n{best.code}", soft_wrap=True)
    if options["use"] == "stream":
        out.print(f"\n{SCENES}", soft_wrap=True)


def ranking(found: Advice) -> Table:
    """The best candidates."""
    table = Table("scheme", "dt (s)", "steps", "error", "time (s)", "bytes", "", box=None)
    for row in found.candidates[:SHOWN]:
        numbers = (f"{row.dt:.4g}", str(row.steps), f"{row.error:.1e}", f"{row.seconds:.2g}", f"{row.nbytes:.3g}")
        table.add_row(short(row.rule), *numbers, "" if row.meets else "too much memory" if row.error <= found.error else "not accurate enough")
    return table


def short(rule: basset.Rule) -> str:
    """A rule in a table."""
    if isinstance(rule, basset.Windowed) and rule.tail is not None:
        return f"Windowed({rule.rule!r}, {rule.window:.4g}, {len(rule.tail)} terms)"
    return repr(rule)


@main.command()
@click.argument("subject", metavar="FILE|PROBLEM")
@with_samples
@click.option("--initial-slip", type=float, default=0.0, show_default=True, help="f at the first sample, for rates.")
@with_kernel
@click.option("--output", type=click.Path(path_type=Path), help="The work–precision diagram (.png, .pdf, .svg), or the numbers (.csv).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
def compare(
    subject: str, kind: str, sample_step: float | None, variable: str | None, initial_slip: float, output: Path | None, force: bool, **options: Any
) -> None:
    """Compare schemes on a file of samples or on a named problem. Prints error and time at every step that the samples (.csv, .npy, .nc) allow.

    The reference for samples is the highest order on all of them; the difference between two high orders estimates its error.
    """
    from basset.weights.table import INPUTS

    _validate.choice("input", kind, INPUTS)
    if output is not None:
        if output.suffix not in (*PICTURES, ".csv"):
            raise Mistake(f"--output must end in {', '.join((*PICTURES, '.csv'))}, got {str(output)!r}")
        check_output(output, force, subject)
    chosen = subject_of(subject, kind, sample_step, variable, initial_slip, kernel_of(**options))
    records = []
    with progress("measuring") as report:
        for level, rows in enumerate(comparison.measured(chosen), 1):
            records += rows
            report(level / len(chosen.levels))
    if output is not None:
        with mistakes_of_files("--output"):
            if output.suffix == ".csv":
                head = ("scheme", "steps", "dt", "error", "seconds")
                write(output, exported.csv_text(head, [[repr(row.rule), row.steps, row.dt, row.error, row.seconds] for row in records]))
            else:
                draw(comparison.drawn(records, chosen.uncertainty, subject), output)
    out = console()
    table = Table("largest error", "fastest scheme", "steps", "dt (s)", "error", "time (ms)", box=None)
    for error in ERRORS:
        if (best := comparison.cheapest(records, error, chosen.uncertainty)) is not None:
            table.add_row(f"{error:.0e}", repr(best.rule), str(best.steps), f"{best.dt:.4g}", f"{best.error:.1e}", f"{1e3 * best.seconds:.3g}")
    out.print(table if table.row_count else "no scheme is good to 10 %: the samples do not resolve H")
    if chosen.uncertainty:
        out.print(f"\nthe reference H is uncertain by {chosen.uncertainty:.1e} of its largest value")
    if output is not None:
        out.print(f"written: {output}")


def subject_of(name: str, kind: str, step: float | None, variable: str | None, initial_slip: float, kernel: basset.Kernel) -> comparison.Subject:
    """A named problem, or the samples of a file."""
    from basset.problems import PROBLEMS

    if Path(name).suffix.lower() in samples.SUFFIXES:
        with mistakes_of_files("FILE"):
            g, dt = samples.read(Path(name), step, variable)
        return comparison.of_samples(g, dt, kind, initial_slip, kernel)
    if name not in PROBLEMS:
        raise Mistake(
            f"FILE|PROBLEM must be a file that ends in {', '.join(samples.SUFFIXES)}, or one of {', '.join(PROBLEMS)}, "
            f"got {name!r}{_validate.suggestion(name, PROBLEMS)}"
        )
    if not isinstance(kernel, basset.BassetKernel):
        raise Mistake("--kernel must be basset for a named problem: its exact answer is for that one")
    return comparison.of_problem(PROBLEMS[name])


def known(ctx: click.Context, parameter: click.Parameter, scheme: str) -> str:
    """The scheme; an unknown one is refused before missing options are."""
    basset.SCHEMES[scheme]
    return scheme


@main.command()
@click.argument("scheme", is_eager=True, callback=known)
@click.option("--steps", type=int, required=True, help="Number of steps n; there are n + 1 weights.")
@click.option("--dt", type=float, default=1.0, show_default=True, help="Step in seconds.")
@click.option("--order", type=int, help="Degree of the polynomials: daitche, exponential, windowed.")
@click.option("--rtol", type=float, help="Promised error of the sum: exponential; windowed: with a fitted tail.")
@click.option("--window", type=float, help="Memory time in seconds: hinsberg, windowed.")
@click.option("--input", "kind", default="rate", show_default=True, help="What the weights act on: rate or slip.")
@with_kernel
@with_format("csv")
def weights(
    scheme: str,
    steps: int,
    dt: float,
    order: int | None,
    rtol: float | None,
    window: float | None,
    kind: str,
    form: str,
    output: Path | None,
    force: bool,
    **options: Any,
) -> None:
    """Print the weights w of SCHEME, newest first. H(t_n) ≈ Σ w[j] g(t_n − j dt); also as C or Fortran, with a worked example."""
    checked_form(form, output, force)
    kernel = kernel_of(**options)
    given = {name: value for name, value in (("order", order), ("rtol", rtol), ("window", window)) if value is not None}
    rule = rule_of(scheme, given, steps * dt, kernel)
    if not 1 <= steps <= MOST_STEPS:
        raise Mistake(f"--steps must be a whole number between 1 and {MOST_STEPS:,}, got {steps}".replace(",", " ", 2))
    give(exported.weights_text(rule, steps, dt, kernel, kind, form), output)


@main.command("sum")
@click.option("--near", type=float, required=True, help="Shortest lag of the sum, seconds.")
@click.option("--far", type=float, required=True, help="Longest lag, seconds: the length of the history.")
@click.option("--rtol", type=float, required=True, help="Largest relative error of the sum between them.")
@click.option("--order", type=int, default=3, show_default=True, help="Degree p of the recursion's polynomials, 1 to 10; its step is near/(p//2 + 1).")
@with_kernel
@with_format("table")
def exponential_sum(near: float, far: float, rtol: float, order: int, form: str, output: Path | None, force: bool, **options: Any) -> None:
    """Fit the kernel by a sum of exponentials. Prints it with its error bound, the recursion that uses it and a worked example; also as C or Fortran."""
    checked_form(form, output, force)
    give(exported.sum_text(basset.ExponentialSum.fit(near, far, rtol, kernel_of(**options)), order, form), output)


@main.command()
@click.argument("source", metavar="TRACKS", type=click.Path(path_type=Path))
@click.option("--output", type=OutputPath(), required=True, help="The result (netCDF).")
@click.option("--force", is_flag=True, help="Overwrite the output.")
@click.option("--density", type=float, help="Density of the fluid, kg/m³: the force is then in N.")
@click.option("--density-ratio", type=float, help="Instead, density of the particle over that of the fluid: the force is then per mass of the particle, m/s².")
@click.option("--velocity", help="Variables of the particle's velocity: one, or one per component, separated by commas.  [default: usual names]")
@click.option("--fluid", help="Variables of the fluid's velocity at the particle, or `rest` for still fluid.  [default: usual and standard names]")
@click.option("--slip-variable", help="Instead of both, variables of the slip: the particle's velocity minus the fluid's.")
@click.option("--position", help="Instead of --velocity, variables of the position, which is then differentiated in time.")
@click.option("--time", "times", help="The time variable.  [default: by its attributes or name]")
@click.option("--track", help="The column of a .csv that numbers tracks.  [default: particle, trajectory, track, id]")
@click.option("--order", type=int, default=3, show_default=True, help="Degree of the polynomials through the rates, 1 to 3.")
@click.option("--rtol", type=float, default=1e-6, show_default=True, help="Promised error of the sum of exponentials.")
@click.option("--drag", default="stokes", show_default=True, help="Drag law in the total force, for the history's share of it: stokes or schiller_naumann.")
@click.option("--before", default="rest", show_default=True, help="State before a track: rest (its first slip is a jump) or steady (the slip was constant).")
@click.option("--gaps", default="raise", show_default=True, help="Missing samples: raise, bridge (interpolate) or split (start a new track).")
@click.option("--workers", type=int, default=1, show_default=True, help="Number of threads.")
@click.option("--chunk", type=int, help="Tracks that are read at a time.  [default: about 260 000 samples]")
@with_kernel
@click.pass_context
def history(
    ctx: click.Context,
    /,
    source: Path,
    output: Path,
    force: bool,
    workers: int,
    chunk: int | None,
    track: str | None,
    kernel: str,
    **options: Any,
) -> None:
    """Compute history forces along stored TRACKS (.nc, .zarr, .csv). The result has their share of the total too; if stopped, the same command resumes."""
    check_output(output, force, source)
    diameter, viscosity = options["diameter"], options["viscosity"]
    if diameter is None:
        raise Mistake("--diameter (m) must be given")
    needed = KERNELS[_validate.choice("kernel", kernel, KERNELS)]
    made = kernel_of(kernel, viscosity, **{name: options.pop(name) for name in ("slip", "slip_length")}, diameter=diameter if "diameter" in needed else None)
    names = {name: options.pop(name) for name in ("velocity", "fluid", "position")} | {"slip": options.pop("slip_variable"), "time": options.pop("times")}
    given = {name: value for name, value in ctx.params.items() if value is not None and name not in ("source", "output", "force", "workers", "chunk")}
    command = shlex.join(["basset", "history", str(source), *(word for name, value in given.items() for word in (f"--{name.replace('_', '-')}", str(value)))])
    last = time.monotonic()

    with mistakes_of_files("TRACKS"), progress("tracks") as report:

        def tell(done: int, count: int) -> None:
            nonlocal last
            report(done / count)
            if not sys.stderr.isatty() and (time.monotonic() > last + PAUSE or done == count):
                last = time.monotonic()
                click.echo(f"{done} of {count} tracks", err=True)

        try:
            tracks.write(source, output, names, track=track, workers=workers, chunk=chunk, force=force, command=command, progress=tell, kernel=made, **options)
        except KeyboardInterrupt:
            click.echo("stopped: run the same command again to resume", err=True)
            ctx.exit(INTERRUPTED)
    click.echo(f"written: {output}")


@main.command()
def warmup() -> None:
    """Compile ahead of time what streams and solvers need. It is cached: the first use then starts at once."""
    from basset._ahead import TASKS

    for what, task in TASKS.items():
        compile_ahead(what, task)


# What commands share


def checked_form(form: str, output: Path | None, force: bool) -> None:
    """Refuse what cannot be written."""
    _validate.choice("--format", form, exported.FORMATS)
    if output is not None:
        check_output(output, force)


def give(text: str, output: Path | None) -> None:
    """Print a text, or write it."""
    if output is None:
        click.echo(text, nl=False)
        return
    with mistakes_of_files("--output"):
        write(output, text)
    click.echo(f"written: {output}")


def kernel_of(kernel: str, viscosity: float, **given: float | None) -> basset.Kernel:
    """A kernel from its options."""
    needed = KERNELS[_validate.choice("kernel", kernel, KERNELS)]
    for name, value in given.items():
        if value is not None and name not in needed:
            raise Mistake(f"--{name.replace('_', '-')} has no meaning for --kernel {kernel}")
    numbers = [value for name in needed if (value := given[name]) is not None]
    if len(numbers) < len(needed):
        wanted = " and ".join(f"--{name.replace('_', '-')} ({OF_KERNELS[name]})" for name in needed)
        raise Mistake(f"{wanted} must be given for --kernel {kernel}")
    if kernel == "basset":
        return basset.BassetKernel()
    made: dict[str, Callable[..., basset.Kernel]] = {
        "mei_adrian": basset.MeiAdrianKernel,
        "dorgan_loth": basset.MeiAdrianKernel.dorgan_loth,
        "slip_sphere": basset.SlipSphereKernel,
        "bubble": basset.BubbleKernel,
    }
    return made[kernel](*numbers, viscosity)


def rule_of(scheme: str, given: Mapping[str, Any], horizon: float, kernel: basset.Kernel) -> basset.Rule:
    """A rule from its name and parameters; a windowed one is Daitche's, with a fitted tail if rtol is given."""
    make = basset.SCHEMES[scheme]
    names = {"windowed": ("order", "rtol", "window"), "exponential": ("order", "rtol"), "daitche": ("order",), "hinsberg": ("window",)}.get(scheme, ())
    for name in given:
        if name not in names:
            raise Mistake(f"--{name} has no meaning for {scheme!r}")
    if scheme != "windowed":
        return make(**given)
    if "window" not in given:
        raise Mistake("--window (seconds) must be given for 'windowed'")
    window = _validate.positive("window", given["window"], "seconds")
    tail = basset.ExponentialSum.fit(0.5 * window, max(horizon, window) * 1.01, given["rtol"], kernel) if "rtol" in given else None
    return basset.Windowed(basset.Daitche(given.get("order", 3)), window, tail)


__all__ = ["main"]
