"""The page reports/flights.md: what a jump costs, how exact it is, and what starting and the campaign take."""

from __future__ import annotations

from typing import Any

import numpy as np

from reports import flights_figures as figures
from reports.analysis import Record, Target, seconds, short
from reports.page import asked, factor, fill, footer, grouped, save, table

SUITES = ("flights",)
OURS, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
STEPPED = {IMPLICIT: "implicit", HELD: "RK4, history held"}
BOUNDS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.003)
QUANTITIES = ("duration", "length", "height")


def percent(share: float) -> str:
    """A share with two digits."""
    return f"{100.0 * share:.2g} %"


def of(records: list[Record], **wanted: Any) -> list[Record]:
    """Records with these values, in the order measured."""
    return [record for record in records if all(record[key] == value for key, value in wanted.items())]


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


def worst_halving(data: Record) -> Record:
    """Where the mean height changes most by its own claim."""
    worst: Record = max(data["halving"], key=lambda r: r["ratio"])
    return worst


def order(rows: list[Record], exact: Record, quantity: str) -> float:
    """Exponent of dt in the error of a quantity, least squares over all steps."""
    h, error = np.log([[r["dt"], abs(r[quantity] - exact[quantity])] for r in rows]).T
    return float(np.polyfit(h, error, 1)[0])


def orders(data: Record, quantity: str) -> list[float]:
    """Measured order of every scheme in both steps."""
    found = data["one_jump"]
    pairs = dict.fromkeys((r["scheme"], r["method"]) for r in found["records"])
    return [order(of(found["records"], scheme=scheme, method=method), found["exact"], quantity) for scheme, method in pairs]


def span(values: list[float]) -> str:
    """The smallest and the largest, once if they are the same."""
    return " to ".join(dict.fromkeys(f"{value:.2f}" for value in (min(values), max(values))))


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


def opening(data: dict[str, Record]) -> str:
    """The three sentences to take away."""
    found = data["flights"]
    sand, thesis = cost(found, "sand"), thesis_record(found)
    history, hand, best = over(found, "sand", "without history"), by_hand(found), best_fixed(found["remembered"])
    halved = worst_halving(found)
    return fill(
        "flights_opening.md",
        time=seconds(sand["seconds"]),
        rtol=short(found["rtol"]),
        steps=f"{sand['steps']:.0f}",
        history=f"{history[0]:.2f}",
        history_time=f"{history[1]:.2f}",
        hand=f"{hand['simulator'] / hand['hand']:.2f}",
        thesis_time=seconds(thesis["seconds"]),
        thesis_dt=f"{thesis['size']:g}",
        thesis_rms=percent(thesis["rms"]),
        thesis_max=percent(thesis["max"]),
        best=percent(best["max"]),
        ratio=factor(equal(found["remembered"], best)[1]),
        thesis_ratio=factor(equal(found["remembered"], thesis)[1]),
        order=span(orders(found, "height")),
        limit=percent(limit_error(found, "height")),
        halved=f"{halved['ratio']:.2g}",
    )


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


def targets(data: Record) -> list[Target]:
    """The figures asked of flights, beside what was measured."""
    rows: list[Target] = []
    sand, hand, start, campaign = cost(data, "sand"), by_hand(data), data["starting"], data["campaign"]
    rows.append(Target(f"sand scene, rtol {short(data['rtol'])}, one core, per jump", "≤ 120 µs", seconds(sand["seconds"]), sand["seconds"] <= 120e-6))
    ratio, per_time = over(data, "sand", "without history")
    rows.append(Target("with history over without, same number of jumps", "≤ 2 ×", f"{ratio:.2f} × ({per_time:.2f} × per time of flight)", ratio <= 2.0))
    states = data["by_hand"]
    measured = f"{states['states']} states, {states['members']} with memory"
    rows.append(Target("weight and drag in the plane: what the state holds", "4 states, no memory", measured, states["states"] == 4 and states["members"] == 0))
    ratio = hand["simulator"] / hand["hand"]
    rows.append(Target("weight and drag over a loop written by hand, minimum of 60", "≤ 1.3 ×", f"{ratio:.2f} ×", ratio <= 1.3))
    apart = max(r["apart"] for r in states["records"])
    rows.append(Target("… whose jumps are the same", "to 1e-12", "bit for bit" if apart == 0.0 else short(apart, 1), apart <= 1e-12))
    best = best_fixed(data["remembered"])
    ratio = equal(data["remembered"], best)[1]
    rows.append(Target(f"fixed steps at their best ({named(best)}: {percent(best['max'])}) over collocation", "≥ 10 ×", f"{factor(ratio)} ×", ratio >= 10.0))
    thesis = thesis_record(data)
    ratio = equal(data["remembered"], thesis)[1]
    rows.append(Target(f"the thesis's way ({named(thesis)}: {percent(thesis['max'])}) over collocation", "≥ 10 ×", f"{factor(ratio)} ×", ratio >= 10.0))
    best = best_fixed(data["forgotten"])
    ratio = equal(data["forgotten"], best)[1]
    rows.append(Target(f"the same where no takeoff has slip ({named(best)}: {percent(best['max'])})", "≥ 10 ×", f"{factor(ratio)} ×", ratio >= 10.0))
    halved = worst_halving(data)
    what = "half the tolerance: change of the mean height, sand, sand_coarse, gravel"
    rows.append(Target(what, "< rtol × mean height", f"{halved['ratio']:.2g} × at worst ({halved['scene']}, {short(halved['rtol'])})", halved["ratio"] < 1.0))
    limit = limit_error(data, "height")
    what = "every scheme tends to the same jump: height at dt → 0, extrapolated as √dt"
    rows.append(Target(what, "the collocation's", f"within {percent(limit)}", limit <= 0.01))
    if start["first"] is not None:
        rows.append(Target("first start, to the first jump", "≤ 15 s", f"{start['first']:.1f} s", start["first"] <= 15.0))
    rows.append(Target("next starts, to the first jump", "≤ 3 s", f"{start['next']:.2f} s", start["next"] <= 3.0))
    if campaign["status"] == "measured":
        rows.append(Target("the thesis's 256 runs on two cores, start-up included", "≤ 60 s", f"{campaign['seconds']:.1f} s", campaign["seconds"] <= 60.0))
    return rows


def flights(data: dict[str, Record]) -> str:
    """The page reports/flights.md."""
    found = data["flights"]
    rows, thesis, costs = targets(found), thesis_record(found), found["costs"]
    typical, loose, tight = worst_kept(found, "rms", found["rtol"]), worst_kept(found, "max", found["rtol"]), worst_kept(found, "max")
    drag = cost(found, "weight and drag")
    return fill(
        "flights.md",
        opening=opening(data),
        jumps=found["jumps"],
        costs=cost_table(found),
        run=seconds(costs["run"]),
        run_path=seconds(costs["run_path"]),
        finite=f"{over(found, 'Mei–Adrian kernel', 'sand')[0]:.1f}",
        hand=hand_table(found),
        hand_steps=f"{drag['steps']:.0f}",
        flown=found["flown"],
        reference=short(found["reference"]),
        apart=short(max(found["remembered"]["reference_apart"], found["forgotten"]["reference_apart"]), 1),
        figure_accuracy=save(figures.accuracy(found), "flights_accuracy"),
        thesis_dt=f"{thesis['size']:g}",
        thesis_max=percent(thesis["max"]),
        thesis_rms=percent(thesis["rms"]),
        equal_remembered=equal_table(found["remembered"]),
        equal_forgotten=equal_table(found["forgotten"]),
        kept=kept_table(found),
        rtol=short(found["rtol"]),
        typical=f"{typical['rms'] / typical['rtol']:.2g}",
        loose=f"{loose['max'] / loose['rtol']:.2g}",
        tight=f"{tight['max'] / tight['rtol']:.2g}",
        tight_at=f"{tight['scene']}, rtol {short(tight['rtol'])}",
        figure_convergence=save(figures.convergence(found["one_jump"]), "flights_convergence"),
        schemes=schemes_table(found),
        order_height=span(orders(found, "height")),
        order_length=span(orders(found, "length")),
        last=percent(last_error(found, "height")),
        least_dt=short(min(r["dt"] for r in found["one_jump"]["records"])),
        counted=found["counted"],
        halving=halving_table(found),
        starting=table(["", "wall time"], start_rows(found)),
        numba=found["starting"]["numba"],
        targets=asked(rows),
        met=f"{sum(row.met for row in rows)} of {len(rows)} are met.",
        footer=footer({name: data[name] for name in SUITES}),
    )
