"""The page reports/definitions.md: the thesis's sketches (figs 3-1 to 3-4, 4-1, 4-2) drawn by the functions that the flights call, and its drag predictors."""

from __future__ import annotations

import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle

import saltation
from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PINK, PURPLE, RED
from basset._look import legend as _legend
from basset.kernels import Floats
from reports.site.page import Page, fill, footer, save, table
from reports.words import Record, grouped
from saltation.bed.contact import strike_bed, strike_pair
from saltation.bed.roughness import READINGS, ROUGHNESS, angle_of, contact_plane

DEPTH = 0.25  # d, of the bed level below the crests: centres of the bed's grains lie as far below it
E, F = 0.65, 0.1  # Set 2
NAMES = {
    "yen": "Yen 1992",
    "schiller_naumann": "Schiller–Naumann 1933",
    "rubey": "Rubey 1933",
    "engelund_hansen": "Engelund–Hansen 1967",
    "turton_levenspiel": "Turton–Levenspiel 1986",
}
LOOKS = dict(zip(NAMES, ((BLACK, "-"), (BLUE, "--"), (RED, "-"), (ORANGE, "-."), (GREEN, ":")), strict=True))


# Pieces


def scenery(axes: Any, across: str, up: str) -> None:
    """Equal scales, no numbers: a sketch."""
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set(xticks=[], yticks=[], xlabel=across, ylabel=up)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)


def ball(axes: Any, centre: Any, colour: str, name: str, alpha: float = 0.35) -> None:
    """A grain of diameter 1."""
    axes.add_patch(Circle(tuple(centre), 0.5, facecolor=colour, edgecolor=BLACK, alpha=alpha, gid=name))
    axes.plot(*centre, "+", color=BLACK, markersize=6)


def bed(axes: Any, count: int = 1) -> None:
    """Grains of the bed beside each other, and the bed level."""
    for k in range(-count, count + 1):
        ball(axes, (k, -DEPTH), GREY, f"bed {k}")
    axes.axhline(0.0, color=GREY, linestyle=":", linewidth=1.0)
    axes.annotate("bed level", (count + 0.45, 0.0), ha="right", va="bottom", fontsize=8, color=GREY)


def vector(axes: Any, tail: Any, arrow: Any, text: str, colour: str = BLACK, shift: tuple[float, float] = (4, 4), name: str = "") -> None:
    """An arrow with its name at the tip."""
    tip = np.asarray(tail, dtype=np.float64) + np.asarray(arrow, dtype=np.float64)
    axes.annotate("", tuple(tip), xytext=tuple(tail), arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0.0, "shrinkB": 0.0}, gid=name)
    axes.annotate(text, tuple(tip), xytext=shift, textcoords="offset points", color=colour, fontsize=10)


def line(axes: Any, points: Any, name: str, **look: Any) -> None:
    """A line through points (n, 2), by its name."""
    values = np.asarray(points, dtype=np.float64)
    axes.plot(values[:, 0], values[:, 1], gid=name, **({"color": BLACK, "linewidth": 1.0} | look))


def turned(axes: Any, centre: Any, spin: float, text: str, colour: str) -> None:
    """A spin about the axis into the picture: from x up to z it is negative, as the y of a right-handed frame points away."""
    start, stop = (60.0, 200.0) if spin > 0.0 else (-20.0, 120.0)
    axes.add_patch(Arc(tuple(centre), 0.5, 0.5, theta1=start, theta2=stop, color=colour, linewidth=1.4))
    end = math.radians(start if spin > 0.0 else stop)  # clockwise as seen for ω_y > 0
    tip = np.asarray(centre) + 0.25 * np.array([math.cos(end), math.sin(end)])
    along = np.array([math.sin(end), -math.cos(end)]) * (1.0 if spin > 0.0 else -1.0)
    axes.annotate("", tuple(tip + 0.05 * along), xytext=tuple(tip - 0.05 * along), arrowprops={"arrowstyle": "-|>", "color": colour})
    axes.annotate(text, tuple(np.asarray(centre) - [0.0, 0.28]), ha="center", va="top", color=colour, fontsize=9)


def angle(axes: Any, corner: Any, low: float, high: float, size: float, text: str, colour: str = BLACK) -> None:
    """An angle, in degrees from the x-axis, with its name."""
    axes.add_patch(Arc(tuple(corner), size, size, theta1=min(low, high), theta2=max(low, high), color=colour, linewidth=1.0))
    middle = math.radians(0.5 * (low + high))
    place = np.asarray(corner) + 0.62 * size * np.array([math.cos(middle), math.sin(middle)])
    axes.annotate(text, tuple(place), ha="center", va="center", color=colour, fontsize=9)


# Sketches


def particle() -> Any:
    """A grain in the stream (fig. 3-1): axes, velocities of grain and stream, slip, spin; the profile is that of the shipped sand."""
    profile = saltation.load("sand").profile
    figure, axes = plt.subplots(figsize=(7.5, 4.2))
    bed(axes, 2)
    scale = 0.12  # lengths of arrows, d over u*
    heights = np.linspace(0.0, 2.6, 80)
    speeds = np.array([profile.velocity_and_shear(z)[0] for z in heights])
    line(axes, np.column_stack([-2.3 + scale * speeds, heights]), "stream", color=BLUE)
    line(axes, [(-2.3, 0.0), (-2.3, 2.6)], "wall", color=BLUE, linewidth=0.6)
    for z in (0.6, 1.2, 1.8, 2.4):
        vector(axes, (-2.3, z), (scale * profile.velocity_and_shear(z)[0], 0.0), "u$_f$(z)" if z == 2.4 else "", BLUE)
    centre, velocity = np.array([0.4, 1.6]), np.array([6.0, 2.5])
    stream = np.array([profile.velocity_and_shear(float(centre[1]))[0], 0.0])
    ball(axes, centre, ORANGE, "grain")
    vector(axes, centre, scale * velocity, "u$_p$", BLACK, (-20, 5), "u_p")
    vector(axes, centre, scale * stream, "u$_f$", BLUE, (4, -4), "u_f")
    vector(axes, centre + scale * stream, scale * (velocity - stream), "u$_r$ = u$_p$ − u$_f$", RED, (8, 6), "u_r")
    turned(axes, centre, 1.0, "ω$_y$ > 0", PURPLE)
    corner = np.array([2.1, 1.5])
    vector(axes, corner, (0.6, 0.0), "x", GREY, (3, -3))
    vector(axes, corner, (0.0, 0.6), "z", GREY, (-3, 3))
    axes.plot(*corner, "x", color=GREY, markersize=7)
    axes.annotate("y, into the picture", tuple(corner), xytext=(4, -12), textcoords="offset points", color=GREY, fontsize=9)
    axes.set(xlim=(-2.5, 3.4), ylim=(-0.8, 2.8))
    scenery(axes, "along the stream", "up")
    figure.suptitle("A grain in the stream: velocities, slip and spin (thesis fig. 3-1)")
    return figure


def touching(axes: Any, incidence: float, twice: float, names: tuple[str, str, str]) -> tuple[float, Floats]:
    """A grain that touches one of the bed at 2r/d = `twice`, in the plane of that angle: the angle, and the centre."""
    tilt = angle_of(twice, incidence)
    normal = np.array([-math.sin(tilt), math.cos(tilt)])
    middle, tangent = np.array([0.0, -DEPTH]), np.array([math.cos(tilt), math.sin(tilt)])
    centre, contact = middle + normal, middle + 0.5 * normal
    ball(axes, centre, ORANGE, "grain")
    line(axes, [middle, centre], "line of centres", linestyle="--")
    line(axes, [contact - tangent, contact + tangent], "contact plane", color=GREEN)
    path = np.array([math.cos(incidence), -math.sin(incidence)])
    meets = middle + np.array([0.0, 0.5 * twice])  # the path through the contact, at the vertical through the bed's grain
    line(axes, [contact - 1.2 * path, meets], "path through the contact", color=RED, linestyle="-.")
    line(axes, [middle, meets], "offset", color=BLUE, linewidth=2.0)
    axes.annotate(names[2], tuple(0.5 * (middle + meets)), xytext=(4, -4), textcoords="offset points", color=BLUE, fontsize=11)
    vector(axes, centre - 0.95 * path, 0.85 * path, "", RED, name="incidence")
    angle(axes, centre - 0.95 * path, 0.0, -math.degrees(incidence), 1.0, names[0], RED)
    line(axes, [centre - 0.95 * path, centre - 0.95 * path + [0.6, 0.0]], "level", color=GREY, linewidth=0.6)
    angle(axes, contact + 0.55 * tangent, 0.0, math.degrees(tilt), 0.7, names[1], GREEN)
    line(axes, [contact + 0.55 * tangent, contact + 0.55 * tangent + [0.5, 0.0]], "level", color=GREY, linewidth=0.6)
    return tilt, centre


def contact_along() -> Any:
    """A contact in the plane of motion (figs 3-2 and 4-1), by (3-5)."""
    figure, axes = plt.subplots(figsize=(7.0, 4.4))
    bed(axes)
    tilt, _ = touching(axes, math.radians(20.0), 0.7, ("θ$_{in}$", "θ$_b$", "r$_1$"))
    axes.set(xlim=(-2.1, 1.6), ylim=(-0.8, 1.6))
    scenery(axes, "along the stream", "up")
    relation = "r$_1$/d = ½ (cos θ$_b$ − tan θ$_{in}$ sin θ$_b$)"
    figure.suptitle(f"Contact with the bed (thesis figs 3-2 and 4-1)\n{relation}, here θ$_b$ = {math.degrees(tilt):.1f}°")
    return figure


def wall() -> Any:
    """Velocity and spin before and after a contact with a tilted plane (fig. 3-3): `strike_bed` with Set 2."""
    figure, axes = plt.subplots(figsize=(7.0, 4.0))
    tilt, before, spin = math.radians(10.0), np.array([1.2, 0.0, -0.5]), 0.6
    normal = (-math.sin(tilt), 0.0, math.cos(tilt))
    found = strike_bed(*normal, *before, 0.0, spin, 0.0, E, F, 1.0)
    after, turns = np.array(found[:3]), found[4]
    tangent = np.array([math.cos(tilt), math.sin(tilt)])
    line(axes, [-2.0 * tangent, 2.0 * tangent], "wall", color=GREEN, linewidth=2.0)
    centre = 0.5 * np.array([normal[0], normal[2]])
    ball(axes, centre, ORANGE, "grain")
    vector(axes, centre - before[[0, 2]], before[[0, 2]], "", GREY, name="before")
    axes.annotate("u$_p$ before", tuple(centre - before[[0, 2]]), xytext=(8, 2), textcoords="offset points", color=GREY)
    vector(axes, centre, after[[0, 2]], "u$_p$ after", BLACK, name="after")
    vector(axes, (0.0, 0.0), 0.8 * np.array([normal[0], normal[2]]), "n", GREEN, (-12, 4), "normal")
    turned(axes, centre - before[[0, 2]] - [0.45, 0.0], spin, f"ω$_y$ = {spin:.2f}\nbefore", GREY)
    turned(axes, centre + after[[0, 2]] + [0.5, -0.2], turns, f"ω$_y$ = {turns:.2f}\nafter", PURPLE)
    axes.set(xlim=(-2.0, 2.0), ylim=(-0.5, 1.6))
    scenery(axes, "along the stream", "up")
    figure.suptitle(f"Rebound from a plane tilted by 10°, e = {E:g}, f = {F:g} (thesis fig. 3-3)")
    return figure


def contact_across() -> Any:
    """A contact in space (fig. 3-4): its plan, and what is seen along the stream."""
    velocity, draws = (1.0, 0.35, -0.4), (0.75, 0.8, 0.1)
    rough = ROUGHNESS["R5"](READINGS.index("clip"), 0.0, 1.0, 0.5 + DEPTH)
    normal, _, _, _ = contact_plane(rough, *velocity, draws)
    across = math.atan2(-velocity[2], velocity[1])
    twice = math.cos(math.asin(-normal[1])) - math.tan(across) * math.sin(math.asin(-normal[1]))
    figure, (plan, side) = plt.subplots(1, 2, figsize=(10.0, 4.4))
    ball(plan, (0.0, 0.0), GREY, "bed 0")
    ball(plan, normal[:2], ORANGE, "grain")
    line(plan, [(0.0, 0.0), normal[:2]], "line of centres", linestyle="--")
    vector(plan, np.array(normal[:2]) - velocity[:2], velocity[:2], "", RED, name="before")
    plan.annotate("u$_p$ before", tuple(np.array(normal[:2]) - velocity[:2]), xytext=(0, -14), textcoords="offset points", color=RED)
    vector(plan, (0.0, 0.0), 1.4 * np.array(normal[:2]), "n", GREEN, (-14, -4), "normal")
    plan.set(xlim=(-2.0, 1.2), ylim=(-1.3, 1.0), title="seen from above")
    scenery(plan, "along the stream", "across")
    bed(side)
    touching(side, across, twice, ("α$_{in}$", "α$_b$", "r$_2$"))
    side.set(xlim=(-2.1, 1.6), ylim=(-0.8, 1.9), title="seen along the stream")
    scenery(side, "across", "up")
    figure.suptitle("Contact in space: (3-5) holds across the stream with α$_{in}$, α$_b$ and r$_2$ (thesis fig. 3-4)")
    return figure


def pair() -> Any:
    """Two grains before, at and after contact (fig. 4-2): `strike_pair` with Set 2."""
    figure, panels = plt.subplots(1, 3, figsize=(11.0, 3.9))
    slope = math.radians(25.0)
    normal = (math.cos(slope), 0.0, math.sin(slope))
    first, second, spins = (1.0, 0.0, 0.35), (0.35, 0.0, -0.25), (0.8, 0.3)
    found = strike_pair(*normal, first, second, (0.0, spins[0], 0.0), (0.0, spins[1], 0.0), (0.5, 0.5), (1.0, 1.0), E, F)
    moving = (first, second, *found)
    turns = (*spins, found[2][1], found[3][1])
    flat = np.array([normal[0], normal[2]])
    places, scale = np.array([-0.5 * flat, 0.5 * flat]), 0.6  # d over u*
    for axes, title in zip(panels, ("before", "at contact", "after"), strict=True):
        for k, (name, colour) in enumerate((("i", ORANGE), ("j", BLUE))):
            ball(axes, places[k], colour, f"grain {name}")
            if title != "at contact":
                own = k + 2 * (title == "after")
                vector(axes, places[k], scale * np.array(moving[own])[[0, 2]], f"u$_{name}$", BLACK, (3, 3), f"{title} {name}")
                turned(axes, places[k], turns[own], f"ω$_{name}$ = {turns[own]:.2f}", PURPLE)
        axes.set(xlim=(-1.1, 1.6), ylim=(-1.0, 0.9), title=title)
        scenery(axes, "along the stream", "up" if axes is panels[0] else "")
    axes = panels[1]
    slip = np.array(first) - second + 0.5 * (spins[0] + spins[1]) * np.cross((0.0, 1.0, 0.0), normal)
    closing = (np.array(second) - first)[[0, 2]]
    vector(axes, (0.0, 0.0), 0.7 * flat, "n", GREEN, (3, 0), "normal")
    vector(axes, (0.0, 0.0), scale * (slip - slip @ normal * np.array(normal))[[0, 2]], "t", GREEN, (4, -8), "slip")
    vector(axes, (0.0, 0.0), scale * np.array(found[4])[[0, 2]], "J on i", RED, (-44, -4), "impulse")
    vector(axes, (1.3, -0.4), scale * closing, "c = u$_j$ − u$_i$", GREY, (0, -14), "closing")
    figure.suptitle(f"Two grains meet, e = {E:g}, f = {F:g} (thesis fig. 4-2)")
    return figure


SKETCHES = {"particle": particle, "contact_along": contact_along, "wall": wall, "contact_across": contact_across, "pair": pair}


# Drag


def draw_drag(data: Record) -> Any:
    """C_D of every predictor, and over Yen's."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.8))
    reynolds, yen = np.array(data["reynolds"]), np.array(data["laws"]["yen"])
    for name, label in NAMES.items():
        colour, dash = LOOKS[name]
        values = np.array(data["laws"][name])
        left.loglog(reynolds, values, dash, color=colour, label=label)
        right.semilogx(reynolds, 100.0 * (values / yen - 1.0), dash, color=colour)
    right.axhspan(-30.0, 30.0, color=PINK, alpha=0.2, linewidth=0.0)
    right.annotate("± 30 %", (0.12, 31.0), fontsize=9, color=GREY, va="bottom")
    left.set(xlabel="Re", ylabel="C$_D$", title="Drag coefficient")
    right.set(xlabel="Re", ylabel="over Yen's (%)", ylim=(-50.0, 350.0), title="Difference from Yen's")
    _legend(figure, left, 5)
    return figure


def drag_table(data: Record) -> str:
    """C_D at some Re, and the settling velocities, both with the difference from Yen's."""
    head = ["", *NAMES.values()]

    def cells(row: Record, form: str) -> list[str]:
        return [f"{row[name]:{form}}" + ("" if name == "yen" else f" ({100.0 * (row[name] / row['yen'] - 1.0):+.0f} %)".replace("-", "−")) for name in NAMES]

    rows = [[f"C_D at Re {grouped(row['reynolds'])}", *cells(row, ".3f")] for row in data["points"]]
    rows += [[f"w_s d/ν of R_p {row['particle_reynolds']:g}", *cells(row, ".1f")] for row in data["settling"]]
    return table(head, rows)


def definitions(data: dict[str, Record]) -> str:
    """The page."""
    found = data["definitions"]
    points = {row["reynolds"]: row for row in found["points"]}
    over = {name: [100.0 * (points[re][name] / points[re]["yen"] - 1.0) for re in points] for name in NAMES}
    slower = [100.0 * (1.0 - row["rubey"] / row["yen"]) for row in found["settling"]]
    return fill(
        "definitions.md",
        at_10=f"{over['rubey'][0]:.0f}",
        at_100=f"{over['rubey'][2]:.0f}",
        at_1000=f"{over['rubey'][3]:.0f}",
        slower=f"{slower[0]:.0f}",
        slower_coarse=f"{slower[1]:.0f}",
        sketches={name: save(draw(), f"definitions_{name}") for name, draw in SKETCHES.items()},
        figure_drag=save(draw_drag(found), "definitions_drag"),
        drag=drag_table(found),
        footer=footer({"definitions": found}),
    )


PAGE = Page("definitions", definitions, ("definitions",))
