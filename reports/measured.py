"""The page reports/measured.md: which treatment of the history at an impact, kernel and restitution measured motions support."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from bench import records as facts
from bench.suites.definitions import crossing
from bench.suites.measured import NEAR, PLAIN, TARGET
from reports.site.page import Page, fill, finished, footer, save, table
from reports.words import Record, listed, of, span
from saltation.grain import GRAVITY

KERNELS = {"basset": ("Basset", BLUE), "mei_adrian": ("Mei–Adrian", ORANGE), "dorgan_loth": ("Dorgan–Loth", GREEN)}
FITTED = ("c₂ fitted", BLACK)
NONE = ("no history", GREY)
REBOUNDS = {"impulse": "remembered (impulse)", "restart": "restarted", "reset": "forgotten (reset)", "none": "jump ignored (none)"}
GONDRET = 35.0  # k of a restitution read from the slopes at the wall


def name_of(row: Record) -> str:
    """A choice in words."""
    return f"{row['rebound']}, {KERNELS[row['kernel']][0]}" if row["kernel"] else NONE[0]


def spelt(label: str) -> str:
    """A choice as the suite calls it, in words."""
    rebound, _, kernel = label.partition(", ")
    return f"{rebound}, {KERNELS[kernel][0]}" if kernel else NONE[0]


def percent(share: float) -> str:
    """A share in per cent, two digits, or whole."""
    return (f"{100.0 * share:.2g}" if abs(share) < 0.1 else f"{100.0 * share:.0f}").replace("-", "−")


def between(values: Any, form: str = "{:.3g}") -> str:
    """An interval."""
    low, high = values
    return f"{form.format(low)} … {form.format(high)}"


def last_k(data: Record) -> float:
    """The largest k that was tried."""
    return float(max(row["alone"][name]["k"] for row in data["joint"] for name in row["alone"]))


# Tables


def motions(data: Record) -> str:
    """What was measured."""
    rows = []
    for row in data["motions"]:
        apexes = [f"{1e3 * h:g} mm at {1e3 * t:g} ms" for t, h in row["key"] if h > 0.0]
        contacts = [f"{1e3 * t:g}" for t, h in row["key"] if h == 0.0]
        rows.append([row["name"], f"{row['reynolds']:g}", listed(apexes), f"{listed(contacts)} ms", str(row["points"])])
    return table(["motion", "Re", "apexes", "next contacts", "points fitted"], rows)


def first_flights(data: Record) -> str:
    """One number per motion."""
    names = [row["name"] for row in data["motions"]]
    rows = []
    for one in of(data["first_flights"], motion=names[0]):
        cells = [name_of(one)]
        for name in names:
            row = of(data["first_flights"], motion=name, rebound=one["rebound"], kernel=one["kernel"])[0]
            after = f"{1e3 * row['next']:.1f}" if row["next"] is not None else "–"
            cells += [f"{row['e']:.3f} ({between(row['interval'], '{:.2f}')})", f"{1e3 * row['rms']:.3f}", after]
        rows.append(cells)
    measured = [cell for row in data["motions"] for cell in ("", "", f"{1e3 * min(t for t, h in row['key'] if h == 0.0):.1f}")]
    rows.append(["**measured**", *measured])
    return table(["history at the impact, kernel", *(f"{name}: {what}" for name in names for what in ("e", "rms, mm", "next contact, ms"))], rows)


def joint(data: Record) -> str:
    """One number for all bounces."""
    most, rows = last_k(data), []
    for row in data["joint"]:
        alone = " / ".join(("≥ " if own["k"] >= most else "") + f"{own['k']:.1f} ({percent(own['rms'])} %)" for own in row["alone"].values())
        cells = [name_of(row), f"**{row['k']:.1f}**", between(row["by_points"]), alone, *(percent(row["rms"][name]) for name in row["rms"])]
        rows.append(cells)
    names = list(data["joint"][0]["rms"])
    head = [
        "history at the impact, kernel",
        "k",
        "over the points",
        f"of {' / '.join(names)} alone (rms)",
        *(f"{name}: rms, % of the first apex" for name in names),
    ]
    return table(head, rows)


def changed(data: Record) -> list[Record]:
    """The rankings under what was changed, without the one over noise."""
    return [row for row in data["stability"] if "k" in row]


def stability(data: Record) -> str:
    """The ranking again and again."""
    rows = []
    for row in changed(data):
        wins, loses = (
            listed([KERNELS[kernel][0] for kernel, held in row[key].items() if not held], "every kernel") for key in ("impulse_wins", "forgetting_loses")
        )
        first = "; ".join(spelt(name) for name in row["first"])
        told = ["every kernel" if said == "every kernel" else f"not with {said}" for said in (wins, loses)]
        rows.append([row["change"], *told, first, " / ".join(f"{row['k'][f'impulse, {kernel}']:.1f}" for kernel in KERNELS)])
    return table(
        ["what is changed", "impulse fits best with", "reset and none fit worst with", "best three of all", "k of impulse: Basset / Mei–Adrian / Dorgan–Loth"],
        rows,
    )


def failing(data: Record, key: str) -> str:
    """Under which changes and with which kernels something does not hold."""
    every = [f"{row['change']} with {KERNELS[kernel][0]}'s kernel" for row in changed(data) for kernel, held in row[key].items() if not held]
    return listed(every, "nowhere")


def last_speed(bounce: facts.Bounce, factor: float) -> float:
    """At which a sphere settles by a multiple of the drag law, m/s: C_D Re² is its weight's number."""
    number = 4.0 / 3.0 * (bounce.ratio - 1.0) * GRAVITY * bounce.diameter**3 / bounce.viscosity**2
    return crossing(PLAIN.law, number / factor) * bounce.viscosity / bounce.diameter


def held(data: Record, key: str) -> tuple[int, int]:
    """In how many rankings and kernels something holds, of how many."""
    every = [value for row in changed(data) for value in row[key].values()]
    return sum(every), len(every)


def two_numbers(data: Record) -> str:
    """Laws with two free numbers."""
    rows = []
    for row in data["two_numbers"]:
        worst = max(row["rms"].values())
        first = "dry e" if row["law"].startswith("dry") else "c₂"
        numbers = f"{first} {row['first']:.3g} ({between(row['first_interval'])})", f"{row['k']:.3g} ({between(row['k_interval'])})"
        rows.append([name_of(row), *numbers, *(percent(value) for value in row["rms"].values()), "yes" if worst <= TARGET else "no"])
    names = list(data["two_numbers"][0]["rms"])
    return table(["history at the impact, kernel", "first number", "k", *(f"{name}: rms, %" for name in names), f"both within {percent(TARGET)} %"], rows)


def laws(data: Record) -> dict[str, str]:
    """The names under which falls were computed."""
    return {"no history": NONE[0], **{kernel: words for kernel, (words, _) in KERNELS.items()}, "fitted c2": FITTED[0]}


def times(data: Record) -> str:
    """Times to 95 % of the terminal speed, and greatest speeds in a tank."""
    names = laws(data)
    rows = [
        [row["motion"], f"{1e3 * row['measured']:.0f} ms", *(percent(row[name] / row["measured"] - 1.0) if row[name] else "–" for name in names)]
        for row in data["settling"]["times"]
    ]
    rows += [
        [f"{row['motion']}, in a tank", f"{1e3 * row['measured']:.1f} mm/s", *(percent(row[name] / row["measured"] - 1.0) for name in names)]
        for row in data["settling"]["tanks"]
    ]
    return table(["fall", "measured", *(f"{words}, % off" for words in names.values())], rows)


def re41(data: Record) -> str:
    """Speeds at Re 41 against the record."""
    names = laws(data)
    rows = []
    for row in data["settling"].get("re41", []):
        windows = [percent(value) for value in row["windows"]]
        rows.append([names.get(row["choice"], row["choice"]), row["last"], f"{row['rms']:.3f}", *windows])
    if not rows:
        return "The record of this fall was not available when this was measured."
    return table(["kernel", "speeds", "rms, √(g d)", "largest deviation, %: t < 3 √(d/g)", "3 to 10", "later"], rows)


def defaults(data: Record) -> str:
    """The k that belongs to a treatment and a kernel."""
    rows = []
    for rebound in REBOUNDS:
        cells = [f"`{rebound}`"]
        for kernel in KERNELS:
            row = of(data["joint"], rebound=rebound, kernel=kernel)[0]
            low, high = row["by_motions"]
            cells.append(f"{row['k']:.1f} ({low:.0f} … {'≥ ' if high >= last_k(data) else ''}{high:.0f})")
        rows.append(cells)
    return table(["history at the impact", *(words for words, _ in KERNELS.values())], rows)


# Pictures


def draw_bounces(data: Record) -> Any:
    """Courses of three treatments and the key points."""
    shown = [rebound for rebound in REBOUNDS if rebound != "none"]
    figure, grid = plt.subplots(len(data["motions"]), len(shown), figsize=(11.0, 6.2), sharex="row", sharey="row", squeeze=False)
    for line, motion in zip(grid, data["motions"], strict=True):
        curves = data["curves"][motion["name"]]
        for axes, rebound in zip(line, shown, strict=True):
            axes.plot(curves["time"], curves["no history"], "--", color=GREY, label=NONE[0])
            for kernel, (words, colour) in KERNELS.items():
                axes.plot(curves["time"], curves[f"{rebound}, {kernel}"], color=colour, label=words)
            if rebound == "impulse":
                axes.plot(curves["time"], curves["fitted c2"], ":", color=FITTED[1], label=f"{FITTED[0]} (impulse)")
            axes.plot(
                [1e3 * t for t, _ in motion["key"]], [1e3 * h for _, h in motion["key"]], "o", color=RED, markerfacecolor="white", zorder=5, label="measured"
            )
            axes.set_title(f"{motion['name']}: {REBOUNDS[rebound]}")
            axes.set_xlabel("time from the first contact (ms)")
            axes.set_ylim(bottom=-0.03 * 1e3 * motion["scale"], top=1.5e3 * motion["scale"])
        line[0].set_ylabel("gap under the sphere (mm)")
    return finished(figure, grid[0, 0], 6, "Bounces by one k each, and what was measured (apexes and contacts)")


def draw_misfit(data: Record) -> Any:
    """Misfit of every choice at its k, and by k."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 5.0), width_ratios=(1.0, 1.15))
    rows = sorted(data["joint"], key=lambda row: row["total"])
    for place, row in enumerate(reversed(rows)):
        colour = KERNELS[row["kernel"]][1] if row["kernel"] else GREY
        low, high = row["rms"].values()
        left.plot([100.0 * low, 100.0 * high], [place, place], "-", color=colour, linewidth=0.8)
        left.plot(100.0 * low, place, "o", color=colour)
        left.plot(100.0 * high, place, "o", color=colour, markerfacecolor="white")
    left.axvline(100.0 * TARGET, color="#999999", linestyle=":")
    left.set_yticks(range(len(rows)), [name_of(row) for row in reversed(rows)])
    first, second = rows[0]["rms"]
    left.set(xlabel="rms of the gap over the first apex (%)", title=f"At its own k: filled {first}, open {second}", xlim=(0.0, None))
    curves = data["by_k"]
    shown = [("impulse", "basset", "-"), ("impulse", "mei_adrian", "-"), ("impulse", "dorgan_loth", "-"), ("restart", "basset", "--"), ("reset", "basset", ":")]
    for rebound, kernel, style in shown:
        values = [100.0 * value for value in curves[f"{rebound}, {kernel}"]]
        right.plot(curves["k"], values, style, color=KERNELS[kernel][1], label=f"{rebound}, {KERNELS[kernel][0]}")
    right.plot(curves["k"], [100.0 * value for value in curves["no history"]], "-", color=GREY, label=NONE[0])
    right.axvline(GONDRET, color=BLACK, linestyle=":", linewidth=1.0)
    right.annotate("published\nk = 35 ", (GONDRET, 2.0), ha="right", color=BLACK, fontsize=9)
    right.set(xlabel="k in e = 0.97 exp(−k/St)", ylabel="rms over both motions (%)", title="By k", ylim=(0.0, 100.0))
    right.legend(loc="upper right", fontsize=8, frameon=True, framealpha=1.0, edgecolor="none")
    figure.suptitle("How far each choice is from the measured bounces")
    return figure


def draw_falls(data: Record) -> Any:
    """A fall from rest at Re 41."""
    figure, axes = plt.subplots(figsize=(8.0, 4.6))
    courses, row = data["settling"]["courses"], data["settling"]["times"][0]
    names = laws(data)
    colours = {"no history": GREY, **{kernel: colour for kernel, (_, colour) in KERNELS.items()}, "fitted c2": FITTED[1]}
    time = [1e3 * value for value in courses["time"]]
    for name, words in names.items():
        share = [100.0 * value / row["model_last"] for value in courses[name]]
        axes.plot(time, share, ":" if name == "fitted c2" else "-", color=colours[name], label=words)
    axes.plot(1e3 * row["measured"], 95.0, "o", color=RED, markerfacecolor="white", zorder=5, label="measured")
    axes.axhline(95.0, color="#999999", linewidth=0.8, linestyle=":")
    axes.set(xlabel="time from rest (ms)", ylabel="speed over the terminal speed (%)", xlim=(0.0, 200.0), ylim=(0.0, 103.0))
    axes.legend(loc="lower right")
    figure.suptitle(f"A glass sphere of 0.5 mm that falls from rest in water, {row['motion']}")
    return figure


def build(data: dict[str, Record]) -> str:
    """The page reports/measured.md."""
    own = data["measured"]
    wins, loses = held(own, "impulse_wins"), held(own, "forgetting_loses")
    noise = next(row for row in own["stability"] if "draws" in row)
    by = {(row["rebound"], row["kernel"]): row for row in own["joint"]}
    pair = {row["law"].partition(" ")[0] + (row["kernel"] or ""): row for row in own["two_numbers"]}
    keeping = [row for row in own["two_numbers"] if max(row["rms"].values()) <= TARGET]
    single = {(row["motion"], row["rebound"], row["kernel"]): row for row in own["first_flights"]}
    falls = own["settling"].get("re41", [])
    ruled = [row for row in falls if row["choice"] == "dorgan_loth"]
    exponential = next((row for row in falls if row["choice"].startswith("the authors")), None)
    return fill(
        "measured.md",
        own=own,
        wins=wins,
        loses=loses,
        noise=noise,
        failing=failing(own, "impulse_wins"),
        settles=[f"{last_speed(facts.ST152, factor):.3f}" for factor in (1.0, 1.1)],
        struck=f"{facts.ST152.speed:g}",
        variations=len(changed(own)),
        k_basset=f"{by['impulse', 'basset']['k']:.1f}",
        k_finite=span([by["impulse", kernel]["k"] for kernel in ("mei_adrian", "dorgan_loth")], "{:.1f}"),
        k_forget=span([by[rebound, kernel]["k"] for rebound in ("reset", "none") for kernel in KERNELS]),
        k_none=f"{by[None, None]['k']:.1f}",
        e_high=f"{single['St 152', 'impulse', 'basset']['e']:.2f}",
        points="the full digitised records" if own["from_records"] else "the key figures alone, the records were not available",
        least=percent(min(row["total"] for row in own["joint"])),
        best=name_of(min(own["joint"], key=lambda row: row["total"])),
        target=percent(TARGET),
        near=percent(NEAR),
        keeping=listed(
            [f"{name_of(row)} with {'dry e' if row['law'].startswith('dry') else 'c₂'} = {row['first']:.3g} and k = {row['k']:.3g}" for row in keeping], "none"
        ),
        fitted=pair["kernel's" + "mei_adrian"],
        fitted_rms=listed([f"{percent(value)} %" for value in pair["kernel's" + "mei_adrian"]["rms"].values()]),
        ruled=percent(min((abs(row["largest"]) for row in ruled), default=float("nan"))),
        nearest=percent(min((abs(row["largest"]) for row in falls if row is not exponential), default=float("nan"))),
        exponential=percent(abs(exponential["largest"])) if exponential else "–",
        quick=span([100.0 * (1.0 - row["no history"] / row["measured"]) for row in own["settling"]["times"]]),
        slow=span([row["basset"] / row["measured"] for row in own["settling"]["times"]], "{:.1f}"),
        ruled_times=span([100.0 * (row["dorgan_loth"] / row["measured"] - 1.0) for row in own["settling"]["times"]]),
        motions=motions(own),
        first_flights=first_flights(own),
        joint=joint(own),
        stability=stability(own),
        two_numbers=two_numbers(own),
        times=times(own),
        re41=re41(own),
        defaults=defaults(own),
        elsewhere="\n".join(f"* {what[0].upper()}{what[1:]} ({where}): {why}." for what, where, why in facts.ELSEWHERE),
        sources=f"{facts.GONDRET}, digitised by {facts.DIGITISED}, conditions by {facts.CONDITIONS}",
        falls=f"{facts.MORDANT}, speeds and times from {facts.MORDANT_FROM}; its record at Re 41 from {facts.RE41_FROM}",
        tanks=f"{facts.TEN_CATE}, {facts.TEN_CATE_FROM}",
        pictures={
            "bounces": save(draw_bounces(own), "measured_bounces"),
            "misfit": save(draw_misfit(own), "measured_misfit"),
            "falls": save(draw_falls(own), "measured_falls"),
        },
        footer=footer({"measured": own}),
    )


PAGE = Page("measured", build, ("measured",))
