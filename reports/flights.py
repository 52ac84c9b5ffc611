"""The page reports/flights.md: what a jump costs, how accurate it is, and what starting and the campaign take."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from basset._look import PINK, PURPLE
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports import solver
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, factor, grouped, of, percent, seconds, short, span

SUITES = ("flights",)
OURS, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
STEPPED = {IMPLICIT: "implicit", HELD: "RK4, history held"}
BOUNDS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.003)
QUANTITIES = ("duration", "length", "height")


# What a jump costs


def cost(data: Record, scene: str) -> Record:
    """What a jump of a scene costs."""
    return of(data["costs"]["records"], scene=scene)[0]


def over(data: Record, scene: str, other: str) -> tuple[float, float]:
    """(time per jump, time per unit of flight) of a scene over another."""
    one, two = cost(data, scene), cost(data, other)
    ratio = one["seconds"] / two["seconds"]
    return ratio, ratio * two["duration"] / one["duration"]


def cost_table(data: Record) -> str:
    """Time, steps and rate evaluations per jump."""
    rows = []
    for r in data["costs"]["records"]:
        cells = [short(r["rtol"]), f"**{seconds(r['seconds'])}**", seconds(r["seconds"] / r["duration"]), f"{r['steps']:.1f}", grouped(r["calls"])]
        rows.append([r["scene"], *cells, str(r["stages"]), str(r["states"]), str(r["terms"]) if r["members"] else "–", f"{r['height']:.2f}"])
    head = ["scene", "rtol", "time per jump", "per d/u* of flight", "steps", "rates", "stages", "states", "exponentials", "mean height (d)"]
    return table(head, rows)


def by_hand(data: Record) -> Record:
    """The scene of weight and drag beside the loop written by hand, at the tolerance of the target."""
    return of(data["by_hand"]["records"], rtol=data["rtol"])[0]


def hand_table(data: Record) -> str:
    """Simulator and hand-written loop."""
    rows = []
    for r in data["by_hand"]["records"]:
        apart = "none" if r["apart"] == 0.0 else short(r["apart"], 1)
        rows.append([short(r["rtol"]), seconds(r["simulator"]), seconds(r["hand"]), f"{r['simulator'] / r['hand']:.2f}", apart])
    return table(["rtol", "simulator, per jump", "by hand", "ratio", "largest difference of a jump"], rows)


# Time at equal error


def as_good(records: list[Record], error: float, key: str = "max") -> Record | None:
    """The quickest record within an error."""
    found = [r for r in records if r[key] is not None and r[key] <= error]
    return min(found, key=lambda r: r["seconds"]) if found else None


def own(found: Record) -> list[Record]:
    """The collocation's records."""
    return of(found["records"], method=OURS)


def stepped(found: Record) -> list[Record]:
    """The records at fixed steps."""
    return [r for r in found["records"] if r["method"] != OURS and r["max"] is not None]


def best_fixed(found: Record) -> Record:
    """The most accurate run at fixed steps; of those within 2 % of its error the quickest."""
    least = min(r["max"] for r in stepped(found))
    return min((r for r in stepped(found) if r["max"] <= 1.02 * least), key=lambda r: r["seconds"])


def equal(found: Record, record: Record) -> tuple[Record, float]:
    """(the quickest collocation no less exact than a record, how many times less it takes)."""
    mine = min((r for r in own(found) if r["max"] <= record["max"] and r["rms"] <= record["rms"]), key=lambda r: r["seconds"])
    return mine, record["seconds"] / mine["seconds"]


def thesis_record(data: Record) -> Record:
    """The thesis's own way: its scheme, RK4, its dt."""
    scheme, method, dt = data["thesis"]
    return next(r for r in of(data["remembered"]["records"], scheme=scheme, method=method) if np.isclose(r["size"], dt))


def named(record: Record) -> str:
    """A run at fixed steps in words."""
    return f"{record['scheme']}, {STEPPED[record['method']]}, dt {record['size']:g}"


def equal_table(found: Record) -> str:
    """The quickest run within each error, at fixed steps and by collocation."""
    rows = []
    for bound in BOUNDS:
        theirs, mine = as_good(stepped(found), bound), as_good(own(found), bound)
        if theirs is None or mine is None:
            continue
        cells = [f"{seconds(theirs['seconds'])} ({named(theirs)})", f"{seconds(mine['seconds'])} (rtol {short(mine['size'])})"]
        rows.append([percent(bound), *cells, f"{factor(theirs['seconds'] / mine['seconds'])} ×"])
    theirs = best_fixed(found)
    mine, ratio = equal(found, theirs)
    cells = [f"{seconds(theirs['seconds'])} ({named(theirs)})", f"{seconds(mine['seconds'])} (rtol {short(mine['size'])})", f"{factor(ratio)} ×"]
    rows.append([f"{percent(theirs['max'])}, the least at fixed steps", *cells])
    return table(["largest error of a jump", "quickest fixed steps, per jump", "quickest collocation, per jump", "ratio"], rows)


def kept_table(data: Record) -> str:
    """Error over rtol."""
    rows = []
    for name in dict.fromkeys(r["scene"] for r in data["kept"]):
        for key, text in (("max", "largest"), ("rms", "root mean square")):
            rows.append([f"{name}, {text}", *(f"{r[key] / r['rtol']:.2g}" for r in of(data["kept"], scene=name))])
    return table(["error of a jump / rtol", *(short(rtol) for rtol in dict.fromkeys(r["rtol"] for r in data["kept"]))], rows)


def worst_kept(data: Record, key: str, tightest: float = 0.0) -> Record:
    """Where the error over rtol is largest, for tolerances down to `tightest`."""
    worst: Record = max((r for r in data["kept"] if r["rtol"] >= 0.999 * tightest), key=lambda r: r[key] / r["rtol"])
    return worst


# Convergence


def halving_table(data: Record) -> str:
    """The change of the mean height over rtol, and of single heights."""
    scenes = list(dict.fromkeys(r["scene"] for r in data["halving"]))
    rtols = list(dict.fromkeys(r["rtol"] for r in data["halving"]))
    rows = []
    for name in scenes:
        found = {r["rtol"]: r for r in of(data["halving"], scene=name)}
        rows.append([f"{name}, mean height", *(f"{found[rtol]['ratio']:.2g}" if rtol in found else "–" for rtol in rtols)])
        rows.append([f"{name}, the jump that changes most", *(f"{found[rtol]['worst']:.2g}" if rtol in found else "–" for rtol in rtols)])
    return table(["change / (rtol × mean height)", *(short(rtol) for rtol in rtols)], rows)


def order(rows: list[Record], exact: Record, quantity: str) -> float:
    """Exponent of dt in the error of a quantity, least squares over all steps."""
    h, error = np.log([[r["dt"], abs(r[quantity] - exact[quantity])] for r in rows]).T
    return float(np.polyfit(h, error, 1)[0])


def orders(data: Record, quantity: str) -> list[float]:
    """Measured order of every scheme in both steps."""
    found = data["one_jump"]
    pairs = dict.fromkeys((r["scheme"], r["method"]) for r in found["records"])
    return [order(of(found["records"], scheme=scheme, method=method), found["exact"], quantity) for scheme, method in pairs]


def extrapolated(rows: list[Record], quantity: str) -> float:
    """The limit of a quantity whose error goes as √dt, from its last two steps."""
    one, two = rows[-2:]
    root = (one["dt"] / two["dt"]) ** 0.5
    return float((root * two[quantity] - one[quantity]) / (root - 1.0))


def schemes_table(data: Record) -> str:
    """Height and length of one jump by every scheme, dt falling."""
    found = data["one_jump"]
    exact, rows = found["exact"], []
    steps = list(dict.fromkeys(r["dt"] for r in found["records"]))
    for scheme in dict.fromkeys(r["scheme"] for r in found["records"]):
        for method, step in STEPPED.items():
            runs = of(found["records"], scheme=scheme, method=method)
            limits = [f"{extrapolated(runs, name):.4f}" for name in ("height", "length")]
            measured = " / ".join(f"{order(runs, exact, name):.2f}" for name in ("height", "length"))
            rows.append([f"{scheme}, {step}", *(f"{r['height']:.4f} / {r['length']:.3f}" for r in runs), " / ".join(limits), measured])
    rows.append(["**collocation**", *[""] * len(steps), f"**{exact['height']:.4f} / {exact['length']:.4f}**", ""])
    return table(["height / length (d) at dt =", *(f"{dt:.3g}" for dt in steps), "limit as √dt", "order"], rows)


def limit_error(data: Record, quantity: str) -> float:
    """The largest distance of an extrapolated scheme from the collocation, relative."""
    found, exact = data["one_jump"], data["one_jump"]["exact"][quantity]
    pairs = dict.fromkeys((r["scheme"], r["method"]) for r in found["records"])
    return max(abs(extrapolated(of(found["records"], scheme=scheme, method=method), quantity) / exact - 1.0) for scheme, method in pairs)


def last_error(data: Record, quantity: str) -> float:
    """The largest error of any scheme at the smallest dt, relative."""
    found, exact = data["one_jump"], data["one_jump"]["exact"][quantity]
    least = min(r["dt"] for r in found["records"])
    return max(abs(r[quantity] / exact - 1.0) for r in of(found["records"], dt=least))


# The page


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    found = data["flights"]
    sand, thesis = cost(found, "sand"), thesis_record(found)
    history, hand, best = over(found, "sand", "without history"), by_hand(found), best_fixed(found["remembered"])
    return {
        "sand": sand,
        "thesis": thesis,
        "history": f"{history[0]:.2f}",
        "hand_ratio": f"{hand['simulator'] / hand['hand']:.2f}",
        "ratio": factor(equal(found["remembered"], best)[1]),
        "thesis_ratio": factor(equal(found["remembered"], thesis)[1]),
        "order": span(orders(found, "height"), "{:.2f}"),
        "limit": percent(limit_error(found, "height")),
    }


def start_rows(data: Record) -> list[list[str]]:
    """What starting and the campaign take."""
    start, campaign = data["starting"], data["campaign"]
    rows = [["first start: from `python` to the end of the first jump, nothing compiled", "–" if start["first"] is None else f"{start['first']:.1f} s"]]
    rows.append(["next starts, the same", f"{start['next']:.2f} s"])
    if campaign["status"] == "measured":
        rows.append(
            [f"`saltation campaign thesis --workers {campaign['workers']}`, {campaign['runs']} runs, everything compiled", f"{campaign['seconds']:.1f} s"]
        )
        rows.append(["the same with what had to be compiled at the time", f"{campaign['first']:.1f} s"])
    else:
        rows.append(["the campaign of 256 runs", f"{campaign['status']}: {campaign['reason']}"])
    return rows


def flights(data: dict[str, Record]) -> str:
    """The page reports/flights.md."""
    found = data["flights"]
    costs = found["costs"]
    typical, loose, tight = worst_kept(found, "rms", found["rtol"]), worst_kept(found, "max", found["rtol"]), worst_kept(found, "max")
    drag = cost(found, "weight and drag")
    return fill(
        "flights.md",
        found=found,
        drag=drag,
        **opening(data),
        costs=cost_table(found),
        run=seconds(costs["run"]),
        run_path=seconds(costs["run_path"]),
        finite=f"{over(found, 'Mei–Adrian kernel', 'sand')[0]:.1f}",
        hand=hand_table(found),
        apart=short(max(found["remembered"]["reference_apart"], found["forgotten"]["reference_apart"]), 1),
        figure_accuracy=save(draw_accuracy(found), "flights_accuracy"),
        equal_remembered=equal_table(found["remembered"]),
        equal_forgotten=equal_table(found["forgotten"]),
        kept=kept_table(found),
        typical=f"{typical['rms'] / typical['rtol']:.2g}",
        loose=f"{loose['max'] / loose['rtol']:.2g}",
        tight=f"{tight['max'] / tight['rtol']:.2g}",
        tight_at=f"{tight['scene']}, rtol {short(tight['rtol'])}",
        figure_convergence=save(draw_convergence(found["one_jump"]), "flights_convergence"),
        schemes=schemes_table(found),
        order_height=span(orders(found, "height"), "{:.2f}"),
        order_length=span(orders(found, "length"), "{:.2f}"),
        last=percent(last_error(found, "height")),
        least_dt=short(min(r["dt"] for r in found["one_jump"]["records"])),
        halving=halving_table(found),
        starting=table(["", "wall time"], start_rows(found)),
        footer=footer({name: data[name] for name in SUITES}),
    )


# Figures, from the records alone

LOOKS = solver.LOOKS | {"Windowed, fitted tail": (PINK, "X", "-")}  # colour, marker, dash
DASHES = {"fixed_step": "-", "runge_kutta_4": "--"}
FILLS = {"fixed_step": None, "runge_kutta_4": "none"}


def _line(axes: Any, rows: list[Record], x: str, y: str, scheme: str, method: str) -> None:
    colour, marker, _ = LOOKS[scheme]
    label = scheme if method == "fixed_step" else None
    more = {} if FILLS[method] is None else {"markerfacecolor": FILLS[method]}
    axes.loglog([r[x] for r in rows], [r[y] for r in rows], DASHES[method], color=colour, marker=marker, label=label, linewidth=1.0, **more)


def _keys(axes: Any) -> None:
    """What full and broken lines mean."""
    for method, text in (("fixed_step", "implicit step"), ("runge_kutta_4", "RK4, history held over the step")):
        axes.plot([], [], DASHES[method], color="#666666", label=text)


def draw_accuracy(data: Record) -> Any:
    """Error of a jump against its time, by every scheme."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.4), sharey=True)
    titles = {"remembered": "rebound remembered: every takeoff has slip", "forgotten": "memory wiped at the rebound: no takeoff has slip"}
    for axes, (key, title) in zip(panels, titles.items(), strict=True):
        records = data[key]["records"]
        for scheme in dict.fromkeys(r["scheme"] for r in records if r["method"] != OURS):
            for method in DASHES:
                rows = [r for r in records if r["scheme"] == scheme and r["method"] == method and r["rms"]]
                _line(axes, [dict(r, time=1e6 * r["seconds"]) for r in rows], "time", "rms", scheme, method)
        rows = [r for r in records if r["method"] == OURS]
        axes.loglog(
            [1e6 * r["seconds"] for r in rows], [r["rms"] for r in rows], color=PURPLE, marker="*", markersize=10, linewidth=2.4, label="collocation", zorder=5
        )
        for r in (rows[0], rows[-1]):
            text = f"rtol {short(r['size'])}"
            axes.annotate(text, (1e6 * r["seconds"], r["rms"]), xytext=(-8, -3), textcoords="offset points", ha="right", color=PURPLE, fontsize=9)
        axes.set(title=title, xlabel="time per jump, one core (µs)")
    scheme, method, dt = data["thesis"]
    thesis = next(r for r in data["remembered"]["records"] if r["scheme"] == scheme and r["method"] == method and np.isclose(r["size"], dt))
    text, place, grey = f"the thesis's way: dt {dt:g}", (1e6 * thesis["seconds"], thesis["rms"]), "#444444"
    arrow = {"arrowstyle": "-", "color": grey, "linewidth": 0.8}
    panels[0].annotate(text, place, xytext=(-10, -45), textcoords="offset points", ha="center", color=grey, fontsize=9, arrowprops=arrow)
    for axes in panels:
        low, high = axes.get_xlim()
        axes.set_xlim(low / 4.0, high)
    _slope(panels[0], 8e2, 3e-2, 6e3, -0.5, "t$^{-1/2}$", "right")
    _slope(panels[1], 6e2, 1.2e-3, 6e3, -1, "t$^{-1}$", "right")
    panels[0].set_ylabel(f"error of a jump / mean jump, root mean square over {data['flown']} jumps")
    figure.suptitle("A jump by collocation is both quicker and far more accurate than at fixed steps, whatever their scheme")
    _keys(panels[0])
    _legend(figure, panels[0], 5)
    return figure


def draw_convergence(found: Record) -> Any:
    """Height of one jump against dt, by every scheme."""
    figure, panels = plt.subplots(1, 2, figsize=(12.0, 6.0))
    exact, records = found["exact"]["height"], found["records"]
    for scheme in dict.fromkeys(r["scheme"] for r in records):
        for method in DASHES:
            rows = [dict(r, root=r["dt"] ** 0.5, error=abs(r["height"] / exact - 1.0)) for r in records if r["scheme"] == scheme and r["method"] == method]
            _line(panels[0], rows, "dt", "error", scheme, method)
            _line(panels[1], rows, "root", "height", scheme, method)
    panels[1].set(xscale="linear", yscale="linear")
    panels[1].plot(0.0, exact, "*", color=PURPLE, markersize=13, clip_on=False, zorder=5, label="collocation")
    steps = sorted({r["dt"] for r in records})
    _slope(panels[0], steps[-1], 1.7 * max(abs(r["height"] / exact - 1.0) for r in records), steps[0], 0.5, "dt$^{1/2}$")
    panels[0].set(xlabel="dt (d/u*)", ylabel="error of the height / height by collocation", title="the error", xlim=(steps[0] / 2.0, steps[-1] * 1.5))
    panels[1].set(xlabel="root of dt (d/u*)", ylabel="height of the first jump (d)", title="the height itself")
    panels[1].set_xlim(0.0, None)
    figure.suptitle("Every scheme tends to the collocation's jump, and every one as the root of the step")
    _keys(panels[1])
    _legend(figure, panels[1], 6)
    return figure


PAGE = Page("flights", flights, SUITES)
