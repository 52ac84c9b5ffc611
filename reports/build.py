"""`python -m reports.build`: the pages and figures from the JSON in reports/data. Nothing is timed here.

The prose is in reports/templates; every number in it is computed here. A new page is one more entry in PAGES.
With `--output` pages go to another folder, and what is in its data/ comes before what is committed.
"""

from __future__ import annotations

import os
import re
import shutil
import statistics
from collections.abc import Sequence
from pathlib import Path

import click
import matplotlib as mpl

from basset._look import LOOK
from reports import advice, analysis, choosing, figures, flights, grains, memory, saltation, scenes, solver
from reports.analysis import BASELINES, CACHED, COLD, PUBLISHED, TOLERANCES, Record, seconds, select, short
from reports.index import index
from reports.page import HERE, Page, Picture, asked, factor, fill, folder, footer, grouped, into, kept, load, save, table, write

PICTURES = (  # the front page starts with them: whole flights, and the thesis's two that led there
    Picture("scenes_accuracy", "scenes", "Error of the mean jump against time: the thesis's fig. 5-5 where it matters, in a scene."),
    Picture("error_step", "quadrature", "Error of the history integral against the step: the thesis's fig. 5-4 again."),
    Picture("accuracy_time", "quadrature", "Error of the history integral against time: the thesis's fig. 5-5 again, by three clocks."),
)
SUITES = ("costs", "fresnel", "kernels", "peers", "trajectory", "weights")  # of the page on quadrature


def cheapest(records: Sequence[Record], tolerance: float) -> str:
    """The cheapest rules for a tolerance, as a table cell."""
    found = analysis.cheapest(records, tolerance)
    if not found:
        return f"none up to N = {grouped(max(r['n'] for r in records if r['seconds'] is not None))} in the time allowed"
    first, *others = found
    also = f"; as good: {', '.join(r['scheme'] for r in others)}" if others else ""
    return f"**{first['scheme']}**, N = {grouped(first['n'])}, {seconds(first['seconds'])}{also}"


def summary(generic: Sequence[Record]) -> str:
    """Which rule is cheapest for which error, under three clocks."""
    groups: dict[str, Sequence[Record]] = {
        "weights cached": select(generic, clock=CACHED),
        "cold: weights built by basset": select(generic, clock=COLD),
        "cold: weights built as published": select(generic, clock=PUBLISHED),
    }
    rows = [[short(tolerance), *(cheapest(group, tolerance) for group in groups.values())] for tolerance in TOLERANCES]
    return table(["largest error", *groups], rows)


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    generic = select(data["fresnel"]["records"], problem="fresnel_generic")
    cached = select(generic, clock=CACHED)
    best, high = analysis.cheapest(cached, 1e-9)[0], analysis.cheapest(cached, 1e-6)[0]
    low = analysis.reaches(select(cached, scheme="Hinsberg"), 1e-6)
    anew = analysis.cheapest(select(generic, clock=COLD), 1e-9)[0]
    built = next(r for r in data["costs"]["building"] if r["scheme"] == "Daitche(8)")
    return fill(
        "opening.md",
        best=best["scheme"],
        best_n=grouped(best["n"]),
        best_time=seconds(best["seconds"]),
        high=high["scheme"],
        more=factor(low["n"] / high["n"]) if low else "far more than a hundred",
        same=short(data["weights"]["same"]["quad"]),
        anew=anew["scheme"],
        anew_time=seconds(anew["seconds"]),
        worst=short(max(r["error"] for r in data["weights"]["worst"])),
        built_n=grouped(built["n"]),
        built=seconds(built["seconds"]),
    )


def ratio_over(records: Sequence[Record], clock: str, above: str, below: str, smallest: int = 512) -> float:
    """Median over N of the ratio of two schemes' times."""
    pairs: list[float] = []
    for record in select(records, scheme=above, clock=clock):
        other = select(records, scheme=below, clock=clock, n=record["n"])
        if record["n"] >= smallest and other and record["seconds"] and other[0]["seconds"]:
            pairs.append(record["seconds"] / other[0]["seconds"])
    return statistics.median(pairs)


def build_shares(records: Sequence[Record]) -> str:
    """The share of building in the thesis's clock, for each published rule at the largest N that was timed."""
    parts = []
    for name in ("Hinsberg", "Daitche(1)", "Daitche(2)", "Daitche(3)"):
        record = select(records, scheme=name, clock=PUBLISHED)[-1]
        cached = select(records, scheme=name, clock=CACHED, n=record["n"])[0]["seconds"]
        parts.append(f"{name} {1.0 - cached / record['seconds']:.1%} (N = {grouped(record['n'])})")
    return ", ".join(parts)


def published_winners(records: Sequence[Record]) -> str:
    """Who is the cheapest by the thesis's clock, for which error."""
    winners: dict[str, list[str]] = {}
    for tolerance in TOLERANCES:
        ranked = analysis.cheapest(select(records, clock=PUBLISHED), tolerance)
        if ranked:
            winners.setdefault(ranked[0]["scheme"], []).append(short(tolerance))
    return "; ".join(f"{name} for {', '.join(found)}" for name, found in winners.items())


def lost_digits(errors: Sequence[Record]) -> str:
    """From which lag on the published formulas have no digit left."""
    parts = []
    for order in (2, 3):
        lags = [r["lag"] for r in errors if r["builder"] == "double" and r["order"] == order and r["error"] >= 1.0]
        if lags:
            parts.append(f"the formula for error h^{order + 1} has no digit left from j ≈ {grouped(float(f'{min(lags):.0e}'))} on")
    return ", ".join(parts)


def semi_derivative(generic: Sequence[Record]) -> dict[str, str]:
    """The thesis's 20 % re-measured, at equal N and at equal accuracy."""
    rivals = BASELINES[:2]
    largest = max(r["n"] for r in generic if r["seconds"] is not None)

    def shares(clock: str) -> str:
        return " and ".join(f"{ratio_over(generic, clock, 'semi-derivative', name):.2f} × the time of {name}" for name in rivals)

    def cell(name: str, tolerance: float) -> str:
        warm, cold = (analysis.reaches(select(generic, scheme=name, clock=clock), tolerance) for clock in (CACHED, PUBLISHED))
        return f"{grouped(warm['n'])}: {seconds(warm['seconds'])}, {seconds(cold['seconds'])}" if warm and cold else f"more than {grouped(largest)}"

    winners = []
    for tolerance in (1e-1, 1e-2, 1e-3):
        found = {name: analysis.reaches(select(generic, scheme=name, clock=CACHED), tolerance) for name in BASELINES}
        needed = {name: record["n"] for name, record in found.items() if record}
        least = [name for name in needed if needed[name] == min(needed.values())]
        winners.append(f"{' and '.join(least)} for {short(tolerance)}")
    rows = [[short(tolerance), *(cell(name, tolerance) for name in BASELINES)] for tolerance in (1e-1, 3e-2, 1e-2, 3e-3, 1e-3)]
    return {
        "semi_cached": shares(CACHED),
        "semi_cold": shares(PUBLISHED),
        "semi_winners": ", ".join(winners),
        "semi_table": table(["largest error", *BASELINES], rows, "  "),
    }


def differences(data: dict[str, Record], generic: Sequence[Record]) -> dict[str, str]:
    """The numbers of the section on the thesis."""
    same, weights = data["weights"]["same"], data["weights"]
    quad = select(generic, scheme="Daitche(3)", clock=PUBLISHED)[-1]
    ours = select(generic, scheme="Daitche(3)", clock=COLD, n=quad["n"])[0]
    worst = {f"worst_{p}": short(max(r["error"] for r in weights["worst"] if r["order"] == p)) for p in (1, 2, 3)}
    return worst | {
        "same_n": grouped(same["n"]),
        "same_quad": short(same["quad"]),
        "same_double": short(same["double"]),
        "same_cached": f"{ratio_over(generic, CACHED, 'Daitche(1)', 'Hinsberg'):.2f}",
        "same_cold": f"{ratio_over(generic, PUBLISHED, 'Daitche(1)', 'Hinsberg'):.2f}",
        "build_shares": build_shares(generic),
        "published_winners": published_winners(generic),
        "lost": lost_digits(weights["errors"]),
        "largest_lag": grouped(max(r["lag"] for r in weights["errors"])),
        "quad_n": grouped(quad["n"]),
        "quad_ours": seconds(ours["seconds"]),
        "quad_published": seconds(quad["seconds"]),
        "quad_digits": str(weights["quad_digits"]),
        "quad_limit": f"N = {grouped(quad['n'])}",
    }


def orders(records: Sequence[Record]) -> str:
    """Declared and measured orders, floors."""
    rows = []
    for row in analysis.convergence(records):
        floor = short(row.floor) if row.floor else f"not reached ({short(row.best)})"
        rows.append([row.scheme, f"{row.declared:g}", f"{row.slope:.2f}", f"{row.slope_end:.2f}", floor])
    return table(["rule", "declared", "largest error of the second half to 50π + 1", "t = 50π alone", "floor"], rows)


def weights_worst(worst: Sequence[Record]) -> str:
    """The worst weight by degree and region."""
    regions = list(dict.fromkeys(r["region"] for r in worst if not r["region"].startswith("oldest")))
    rows = []
    for order in sorted({r["order"] for r in worst}):
        found = {r["region"]: r["error"] for r in worst if r["order"] == order}
        oldest = next(error for region, error in found.items() if region.startswith("oldest"))
        rows.append([str(order), *(short(found[region], 1) for region in regions), short(oldest, 1)])
    return table(["degree p", *regions, "oldest 2p + 2"], rows)


def path_numbers(trajectory: Record) -> dict[str, str]:
    """The numbers of the section on paths."""
    lengths = sorted({r["n"] for r in trajectory["ratios"]})
    slowest = {n: max(r["cumulate"] / r["fftconvolve"] for r in trajectory["ratios"] if r["n"] == n) for n in lengths}
    early = select(trajectory["records"], scheme="Daitche(8)", method="fft", n=4096)[0]
    return {
        "ratios": ", ".join(f"{ratio:.1f} × at 2^{n.bit_length() - 1}" for n, ratio in slowest.items()),
        "early_n": grouped(early["n"]),
        "early_max": short(early["error_max"]),
        "early_path": short(early["error_path"]),
    }


def remarks(found: Record) -> str:
    """What the peers' own rows show beyond time."""
    parts = []
    single = [r for r in found["records"] if r["peer"].startswith("marge3d") and r["single"]]
    if single:
        best, last = min(single, key=lambda r: r["error"]), single[-1]
        parts.append(
            f"The cancellation of the published formulas is real: marge3d forms its coefficients of fourth error order in double precision, is good to "
            f"{short(best['error'])} at N = {grouped(best['n'])} and wrong by {last['error']:.2g} at N = {grouped(last['n'])}."
        )
    if any(r["peer"] == "differint GL" and r["status"] == "disagrees" for r in found["status"]):
        parts.append("differint's GL multiplies transforms that are not padded: the end of the path leaks into its start, on this problem by more than |H|/2.")
    return " ".join(parts)


def peers(data: dict[str, Record]) -> str:
    """Other packages, if they were measured."""
    if "peers" not in data:
        return "## Other packages\n\nNot measured here: `make report-full` installs and measures them."
    found = data["peers"]
    race = {r["contender"]: r["seconds"] for r in found["races"]["trajectory"]}
    own = {name: value for name, value in race.items() if name.startswith("basset")}
    fastest = min((value for name, value in race.items() if name not in own), default=float("nan"))
    status = [
        [
            r["peer"],
            str(r["steps"]),
            "–" if r["error"] is None else short(r["error"], 1),
            short(r["tolerance"]),
            f"{r['status']}: {r['reason']}" if r["reason"] else r["status"],
        ]
        for r in found["status"]
    ]
    races = [
        [title, r["contender"], grouped(r["n"]), seconds(r["seconds"]), short(r["error"])]
        for title, key in (("every node", "trajectory"), ("one value", "value"))
        for r in sorted(found["races"][key], key=lambda r: r["seconds"])
    ]
    target, ratio = short(found["target"]), factor(fastest / min(own.values()))
    return fill(
        "peers.md",
        nodes=found["nodes"],
        target=target,
        ratio=ratio,
        ratio_anew=factor(fastest / max(own.values())),
        figure=save(figures.peers(found["records"], found["target"], f"{ratio} times"), "peers"),
        races=table(["problem", "contender", "N", f"time to {target}", "error reached"], races),
        status=table(["peer", "steps", "error there", "asked", "outcome"], status),
        remarks=remarks(found),
        versions=", ".join(f"{name} {number}" for name, number in found["peer_versions"].items()),
    )


def quadrature(data: dict[str, Record]) -> str:
    """The page reports/quadrature.md."""
    records, weights, trajectory, kernel = data["fresnel"]["records"], data["weights"], data["trajectory"], data["kernels"]
    generic = select(records, problem="fresnel_generic")
    targets = analysis.targets(data)
    met = sum(row.met for row in targets)
    return fill(
        "quadrature.md",
        opening=opening(data),
        near=analysis.NEAR,
        cheapest=summary(generic),
        **differences(data, generic),
        **semi_derivative(generic),
        **path_numbers(trajectory),
        figure_accuracy=save(figures.accuracy(records), "accuracy_time"),
        figure_clocks=save(figures.clocks(records), "time_step"),
        figure_convergence=save(figures.convergence(records), "error_step"),
        orders=orders(records),
        figure_weight_errors=save(figures.weight_errors(weights["errors"]), "weights_error"),
        weights_worst=weights_worst(weights["worst"]),
        figure_weight_times=save(figures.weight_times(weights["building"]), "weights_time"),
        figure_trajectory=save(figures.trajectory(trajectory["records"], trajectory["ratios"]), "trajectory"),
        figure_kernels=save(figures.kernels(kernel), "kernels"),
        slip=f"{100 * kernel['slip']:g}",
        diameter=f"{1000 * kernel['diameter']:g}",
        viscosity=short(kernel["viscosity"]),
        reynolds=f"{kernel['reynolds']:g}",
        figure_window=save(figures.window(kernel), "window"),
        peers=peers(data),
        targets=asked(targets),
        met=f"{met} of {len(targets)} are met.",
        footer=footer({name: data[name] for name in SUITES if name in data}),
    )


PAGES = (
    Page(
        name="quadrature",
        title="What accuracy costs in time",
        description="every published way to compute the history integral, its error and its price.",
        opening=opening,
        lead="accuracy_time.png",
        shows="error against time",
        build=quadrature,
        suites=SUITES,
    ),
    Page(
        name="memory",
        title="What the memory of the past costs in time, bytes and digits",
        description="windows, tails and sums of exponentials, one sample at a time.",
        opening=memory.opening,
        lead="memory_costs.png",
        shows="time and bytes against the steps remembered",
        build=memory.memory,
        suites=memory.SUITES,
    ),
    Page(
        name="advice",
        title="Which scheme for this accuracy?",
        description="what `basset.advise` takes, beside the fastest that is really as exact.",
        opening=advice.opening,
        lead="advice_ratios.png",
        shows="time over the fastest, per problem and accuracy",
        build=advice.advice,
        suites=("advice",),
    ),
    Page(
        name="solver",
        title="What a digit costs, and what a jump does to each scheme's order",
        description="equations with memory, every scheme and graded collocation.",
        opening=solver.opening,
        lead="solver_orders.png",
        shows="measured orders before and after a jump",
        build=solver.solver,
        suites=solver.SUITES,
    ),
    Page(
        name="saltation",
        title="What each effect, each correction and each reading does to a jump",
        description="a grain over a bed, beside published regressions.",
        opening=saltation.opening,
        lead="saltation_envelope.png",
        shows="height, length and speed among the regressions",
        build=saltation.saltation,
        suites=saltation.SUITES,
    ),
    Page(
        name="choosing",
        title="Which effects a scene calls for, and which choices matter",
        description='`saltation advise`, `ablate`, `uncertainty` and `effects = "auto"`, against every set of effects.',
        opening=choosing.opening,
        lead="choosing_sets.png",
        shows="the change that every set of effects makes",
        build=choosing.choosing,
        suites=("choosing",),
    ),
    Page(
        name="flights",
        title="What a jump costs, and how exact it is",
        description="speed and convergence of flights, collocation beside every scheme at fixed steps.",
        opening=flights.opening,
        lead="flights_accuracy.png",
        shows="error of a jump against its time",
        build=flights.flights,
        suites=flights.SUITES,
    ),
    Page(
        name="scenes",
        title="Which scheme, window and solver for a scene",
        description="error of mean jumps against time, for all of them.",
        opening=scenes.opening,
        lead="scenes_accuracy.png",
        shows="error of the mean jump against time",
        build=scenes.scenes,
        suites=scenes.SUITES,
    ),
    Page(
        name="grains",
        title="What encounters change, and what a grain among many costs",
        description="the 24 runs of Table 4-1, spreading, and runs of up to 100 000 grains.",
        opening=grains.opening,
        lead="sand_cloud.gif",
        shows="a sand cloud",
        build=grains.grains,
        suites=("grains",),
    ),
)


def opened(page: Page, data: dict[str, Record], old: dict[str, Record]) -> str:
    """A page's sentences to take away, and what it says of data that was not measured with the rest."""
    said = {name: old[name] for name in page.suites if name in old}
    return "\n".join([page.opening(data), *([kept(said)] if said else [])])


def made(page: Page, data: dict[str, Record], old: dict[str, Record]) -> str:
    """A page's text, its figures beside it. One that shows nothing but `old` data is the committed page: there is nothing to compute."""
    said = {name: old[name] for name in page.suites if name in old}
    if said.keys() != {name for name in page.suites if name in data}:
        text = page.build(data)
    else:
        text = (HERE / page.file).read_text(encoding="utf-8")
        for name in re.findall(r"\(figures/([^)]+)\)", text):
            (folder() / "figures").mkdir(parents=True, exist_ok=True)
            shutil.copyfile(HERE / "figures" / name, folder() / "figures" / name)
    return text.replace("\n\n", f"\n\n*{kept(said)}*\n\n", 1) if said else text


def front(data: dict[str, Record], openings: Sequence[str]) -> str:
    """The page README.md."""
    parts = ["# Reports", "Everything on one page, with tables that sort: open [index.html](index.html) in a browser; it needs no network."]
    parts += [f"{picture.line} [More]({picture.page}.md).\n\n![{picture.alternative}](figures/{picture.figure}.png)" for picture in PICTURES]
    for page, opening in zip(PAGES, openings, strict=True):
        parts += [f"* [{page.title}]({page.file}): {page.description}", opening]
        parts += [f"![{page.shows}](figures/{page.lead})"] if page.lead.split(".")[0] not in [picture.figure for picture in PICTURES] else []
    return "\n\n".join([*parts, footer(data)])


@click.command()
@click.option("--output", type=click.Path(file_okay=False, path_type=Path), default=HERE, help="Where the pages go.  [default: reports]")
def main(output: Path) -> None:
    """Build every page from the JSON in OUTPUT/data, and from that in reports/data what is missing there."""
    output = output.resolve()
    data = load(output / "data")
    old = {name: content for name, content in load(HERE / "data").items() if name not in data}
    data |= old
    with mpl.rc_context(LOOK), into(output):
        pages = {page.file: made(page, data, old) for page in PAGES}
        openings = [opened(page, data, old) for page in PAGES]
        pages |= {"README.md": front(data, openings), "index.html": index(PAGES, list(pages.values()), openings, footer(data), PICTURES)}
    for name, text in pages.items():
        write(output / name, text)
    print(f"{PAGES[0].title}: {os.path.relpath(output / PAGES[0].file)}")
    print(f"All pages in one, for a browser: {os.path.relpath(output / 'index.html')}")


if __name__ == "__main__":
    main()
