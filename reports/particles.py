"""The page reports/particles.md: spheres in published flows, their error against time beside marge3d, many at once, and tracks at nonuniform times."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, RED, SKY
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped, of, seconds, short

SUITES = ("particles",)
OURS = "maxey_riley"
PANELS = ("settling from rest", "vortex", "stream", "jet")
TITLES = ("Settling from rest, 3-D", "Solid-body vortex, 2-D", "Stream (1, sin t), R = 7/9, S = 0.1", "Bickley jet with three waves")
TERMS = {"no history": "no history", "stokes": "history", "all": "history, lift, Schiller–Naumann"}


def flows(data: Record, name: str, slip: bool) -> list[Record]:
    """The records of a flow."""
    return of(data["jet"], slip=slip) if name == "jet" else of(data["exact"], flow=name, slip=slip)


def as_good(data: Record, slip: bool, error: float) -> Record | None:
    """The quickest call in the stream with no larger error."""
    return min((r for r in flows(data, "stream", slip) if r["error"] <= error), key=lambda r: r["seconds"], default=None)


def peer(data: Record) -> str:
    """What is to be said of marge3d first."""
    found = data["marge3d"]
    if found["status"] != "measured":
        return f"marge3d was not measured here ({found['reason']}): `make report-full` installs and measures it."
    best = found["best"]
    ours = [r for r in found["records"] if r["solver"] == OURS and r["error"] <= best["error"]]
    one, many = (min(r[key] for r in ours) for key in ("seconds", "each_of_many"))
    return (
        f"marge3d takes {seconds(best['seconds'])} for its best accuracy on its own vortex problem, {short(best['error'], 1)}; "
        f"one call of `maxey_riley` {seconds(one)}, {factor(found['ratio_one'])} times less, "
        f"each of many {seconds(many)}, {factor(found['ratio_many'])} times less."
    )


def marge3d_table(data: Record) -> str:
    """Every run on marge3d's problem, and what is as good."""
    found, rows = data["marge3d"], []
    if found["status"] != "measured":
        return "Not measured here."
    for r in found["records"]:
        own = r["solver"] == OURS
        equal = min((o["seconds"] for o in found["records"] if o["solver"] == OURS and o["error"] <= r["error"]), default=None)
        size = f"rtol {short(r['size'])}" if own else grouped(r["size"])
        ours = "–" if own or equal is None else f"{seconds(equal)} ({factor(r['seconds'] / equal)} × less)"
        rows.append([r["solver"], size, seconds(r["seconds"]), seconds(r.get("each_of_many")), short(r["error"], 1), ours])
    return table(["solver", "steps", "time", "each of 200", "largest distance from the path", f"{OURS}, no larger error"], rows)


def theirs_table(data: Record) -> str:
    """What the research code gave in the stream, and what is as good here."""
    rows = []
    for r in data["stream"]["theirs"]:
        own = as_good(data, r["slip"], r["error"])
        cell = f"{seconds(own['seconds'])}, rtol {short(own['rtol'])}" if own else "–"
        rows.append([r["solver"], "0.1" if r["slip"] else "none", grouped(r["n"]), short(r["error"], 1), seconds(r["seconds"]), cell])
    return table(["their solver", "slip at the start", "nodes", "error", "time", f"{OURS}, no larger error"], rows)


def steepness(rows: list[Record]) -> float:
    """Time at rtol 1e-9 over that at 1e-3."""
    times = {r["rtol"]: r["seconds"] for r in rows}
    return float(times[1e-9] / times[1e-3])


def flows_table(data: Record) -> str:
    """Error and time in every flow."""
    columns = [(title.split(",")[0], name, slip) for name, title in zip(PANELS, TITLES, strict=True) for slip in (False, True) if flows(data, name, slip)]
    found = [{r["rtol"]: r for r in flows(data, name, slip)} for _, name, slip in columns]
    shared = [rtol for rtol in found[0] if all(rtol in each for each in found)]
    rows = [[short(rtol), *(f"{short(each[rtol]['error'], 1)}, {seconds(each[rtol]['seconds'])}" for each in found)] for rtol in shared]
    return table(["rtol", *(f"{title.split(' (')[0].removesuffix(' with three waves')}{', slip' * slip}" for title, _, slip in columns)], rows)


def particles(data: dict[str, Record]) -> str:
    """The page reports/particles.md."""
    found = data["particles"]
    swarm, every = found["swarm"], [*found["exact"], *found["jet"]]
    span = swarm["end"]
    return fill(
        "particles.md",
        peer=peer(found),
        worst=max(r["error"] / r["rtol"] for r in every),
        steep=max(steepness(flows(found, r["flow"], r["slip"])) for r in found["exact"]),
        swarm=swarm,
        each=swarm["per_particle_and_second"],
        bits="the same bits" if swarm["same_bits_over_threads"] and swarm["same_bits_in_parts"] else "other bits",
        figure=save(draw(found), "particles_accuracy"),
        flows=flows_table(found),
        theirs=theirs_table(found),
        marge3d=marge3d_table(found),
        threads=table(
            ["threads", "time", "per particle and unit time", "speed-up"],
            [[count, seconds(t), seconds(t / swarm["particles"] / span), f"{swarm['seconds']['1'] / t:.2f} ×"] for count, t in swarm["seconds"].items()],
        ),
        terms=table(["forces", "per particle and unit time"], [[name, seconds(swarm["terms"][key] / span)] for key, name in TERMS.items()]),
        tracks=table(
            ["samples", "sum to", "largest error / |H|", "time", "per sample"],
            [[grouped(r["n"]), short(r["rtol"]), short(r["error"], 1), seconds(r["seconds"]), seconds(r["seconds"] / r["n"])] for r in found["tracks"]],
        ),
        footer=footer({"particles": found}),
    )


# Figures, from the records alone


def draw(data: Record) -> Any:
    """Error against time, flow by flow."""
    figure, grid = plt.subplots(2, 3, figsize=(12.0, 7.6), sharex=True, sharey=True)
    panels = list(grid.flat)
    for axes, name, title in zip(panels, PANELS, TITLES, strict=False):
        for slip, colour, marker in ((False, BLUE, "o"), (True, RED, "s")):
            rows = flows(data, name, slip)
            axes.loglog([r["seconds"] for r in rows], [r["error"] for r in rows], color=colour, marker=marker)
        axes.set_title(title)
    for r, marker in zip(data["stream"]["theirs"], "D^D^", strict=True):
        colour = RED if r["slip"] else BLUE
        if r["seconds"] is None:
            panels[2].axhline(r["error"], color=colour, linestyle=":")
            panels[2].annotate(f"{r['solver']}, with slip", (1.0, r["error"]), xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8)
        else:
            panels[2].loglog([r["seconds"]], [r["error"]], marker, color=colour, markerfacecolor="none", markersize=8)
            panels[2].annotate(r["solver"], (r["seconds"], r["error"]), xytext=(-8, 0), textcoords="offset points", ha="right", va="center", fontsize=8)
    races = data["marge3d"].get("records", [])
    looks = (
        ("marge3d, order 2", "seconds", ORANGE, "^"), ("marge3d, order 3", "seconds", GREEN, "D"),
        (OURS, "seconds", BLUE, "o"), (OURS, "each_of_many", SKY, "P"),
    )  # fmt: skip
    for solver, key, colour, marker in looks:
        rows = of(races, solver=solver)
        panels[4].loglog([r[key] for r in rows], [r["error"] for r in rows], color=colour, marker=marker)
    panels[4].set_title("marge3d's vortex, 3-D, with weight")
    for axes in (panels[2], panels[3], panels[4]):
        axes.set_xlabel("time of one particle, one core (s)")
        axes.tick_params(labelbottom=True)
    for axes in (panels[0], panels[3]):
        axes.set_ylabel("largest error of the position / its size")
    panels[5].axis("off")
    shown = (
        (BLUE, "o", "-", f"{OURS}, no slip at the start"), (RED, "s", "-", f"{OURS}, slip at the start"), (SKY, "P", "-", f"{OURS}, each of many"),
        (ORANGE, "^", "-", "marge3d, order 2"), (GREEN, "D", "-", "marge3d, order 3"), (GREY, "D", "none", "research code, elsewhere"),
        (BLACK, "", ":", "the same with slip, no time known"),
    )  # fmt: skip
    handles = [
        plt.Line2D([], [], color=colour, marker=marker, linestyle=dash, markerfacecolor="none" if dash == "none" else colour, label=label)
        for colour, marker, dash, label in shown
    ]
    panels[5].legend(handles=handles, loc="center left")
    figure.suptitle("Digits are cheap, slip at the start or not")
    return figure


PAGE = Page("particles", particles, SUITES)
