"""What each effect and each correction does, in a run and to a single jump."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, RED
from reports.saltation.records import QUANTITIES, modification, number, percent, places, ratio, ticks
from reports.site.page import finished, save, table
from reports.words import Record, of, signed

SCENES = {"sand": "sand, R_p 73, T 1.87", "sand_coarse": "coarse sand, R_p 250, T 3.08", "gravel": "gravel, 30 mm, T 1.72"}
SAME = 1e-6  # differences in H, L and ū by rounding alone


def changed(data: Record, row: Record, quantity: str) -> str:
    """The change of one quantity by a modification."""
    change = row["change"][quantity]
    digits = places(change["se"])
    return f"{QUANTITIES[quantity]} {signed(change['mean'], digits)} ± {change['se']:.{digits}f} ({percent(ratio(data, row['scene'], row['name'], quantity))})"


def changes(data: Record, row: Record) -> str:
    """The changes of H, L and ū by a modification, or how the run ended."""
    if row["status"] != "finished":
        return f"{row['status']} after {row['jumps']} jumps"
    if all(abs(row["change"][quantity]["mean"]) <= SAME for quantity in QUANTITIES):
        return "unchanged"
    return "; ".join(changed(data, row, quantity) for quantity in QUANTITIES)


def effect_table(data: Record, group: str) -> str:
    """Changes of H, L and ū of one group of modifications."""
    names = dict.fromkeys(row["name"] for row in of(data["effects"], group=group))
    rows = [[name, *(changes(data, modification(data, scene, name)) for scene in SCENES)] for name in names]
    bases = [", ".join(f"{symbol} {number(modification(data, scene, 'base'), quantity)}" for quantity, symbol in QUANTITIES.items()) for scene in SCENES]
    return table(["", *(f"{title}<br>({base})" for title, base in zip(SCENES.values(), bases, strict=True))], rows)


FORGOTTEN = "takeoff slip forgotten"  # dashed
SINGLE = {"all effects": BLACK, "no history": RED, FORGOTTEN: RED, "no Magnus": ORANGE, "no lift": GREEN, "no added mass": PINK, "weight and drag alone": BLUE}


def draw_effects(data: Record) -> Any:
    """Every modification as a ratio to the base, H, L and ū."""
    modifications = list(dict.fromkeys((row["group"], row["name"]) for row in data["effects"]))
    titles = {"off": "switched off", "printed": "as printed", "choice": "chosen otherwise"}
    looks = ((BLUE, "o"), (ORANGE, "s"), (GREY, "^"))
    figure, panels = plt.subplots(1, 3, figsize=(13.0, 8.6), sharey=True)
    rows: list[tuple[str, str] | None] = []
    for group in titles:
        rows += [None, *(pair for pair in modifications if pair[0] == group)]
    rows = rows[::-1]
    for axes, (quantity, symbol) in zip(panels, QUANTITIES.items(), strict=True):
        for k, ((scene, title), (colour, marker)) in enumerate(zip(SCENES.items(), looks, strict=True)):
            shown = [(place, pair[1]) for place, pair in enumerate(rows) if pair and modification(data, scene, pair[1])["status"] == "finished"]
            x, y = [ratio(data, scene, name, quantity) for _, name in shown], [place + 0.2 * (1 - k) for place, _ in shown]
            axes.plot(x, y, marker, color=colour, linestyle="none", markersize=6, label=title.replace("R_p", "R$_p$"))
        axes.axvline(1.0, color="#999999", linewidth=0.8)
        axes.set(xlabel=f"{symbol} / {symbol} of the thesis's case")
        axes.set_ylim(-0.7, len(rows) - 0.3)
        ticks(axes, (0.05, 0.1, 0.2, 0.5, 1, 2, 5) if quantity != "velocity" else (0.3, 0.5, 0.7, 1, 1.5))
    names = [f"— {titles[group]} —" for group in titles][::-1]
    labels = [names.pop(0) if pair is None else pair[1] for pair in rows]
    panels[0].set_yticks(range(len(rows)), labels)
    return finished(
        figure, panels[0], 3, "Magnus and what spins the grain, history and contact decide a jump; the form of drag and of added mass hardly matter to sand"
    )


def single_of(data: Record, figure: str, start: int) -> Record:
    """The single jumps of one figure of the thesis: start 0 the thesis's, 1 the mean takeoff."""
    return of(data["single"], figure=figure)[start]


def draw_single(records: Sequence[Record]) -> Any:
    """Single jumps of thesis figs 3-5 and 3-6, effects off one by one."""
    figure, panels = plt.subplots(2, 2, figsize=(11.0, 7.6))
    for axes, found in zip(panels.ravel(), records, strict=True):
        for name, colour in SINGLE.items():
            row = found["paths"][name]
            axes.plot(row["x"], row["z"], "--" if name == FORGOTTEN else "-", color=colour, linewidth=2.2 if name == "all effects" else 1.3, label=name)
        takeoff, grain = found["takeoff"], "sand" if found["figure"] == "3-6" else "gravel"
        text = f"u = {takeoff['u']:.3g}, w = {takeoff['w']:.3g} u*, ω = {takeoff['spin']:.3g} u*/d"
        axes.set_title(
            f"{grain}, d = {1e3 * found['diameter']:.3g} mm, u* = {found['shear_velocity']:.3g} m/s (fig. {found['figure']})\ntakeoff {text}", fontsize=10
        )
        axes.set(xlabel="x (d)", ylabel="rise (d)", xlim=(0.0, None), ylim=(0.0, None))
    return finished(figure, panels[0, 0], 4, "A single jump: what sand does depends on whether its takeoff is remembered; gravel's on the spin it starts with")


def fields(found: Record) -> dict[str, Any]:
    """What the page says of them."""
    return {
        "signs": f"{1.0 / ratio(found, 'sand', 'rebound 3-B letter by letter'):.1f}",
        "magnus": f"{1.0 / ratio(found, 'sand', 'Magnus'):.1f}",
        "magnus_gravel": f"{1.0 / ratio(found, 'gravel', 'Magnus'):.0f}",
        "figure_effects": save(draw_effects(found), "saltation_effects"),
        "off": effect_table(found, "off"),
        "printed": effect_table(found, "printed"),
        "choices": effect_table(found, "choice"),
        "figure_single": save(draw_single(found["single"]), "saltation_single"),
        "gravel": found["grid"]["gravel"],
        "gravel_height": f"{modification(found, 'gravel', 'base')['height']['mean']:.0f}",
        "gravel_bare": f"{modification(found, 'gravel', 'Magnus')['height']['mean']:.1f}",
        "gravel_regression": f"{found['grid']['gravel']['regressions']['sklar_dietrich_2004'][0]:.1f}",
    }
