"""The page on many grains."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from basset._look import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from basset._look import legend as _legend
from basset._look import slope as _slope
from reports.site.page import Page, fill, folder, footer, save, table
from reports.words import Record, factor, grouped, seconds
from saltation.flight.layout import ENCOUNTER_COLUMNS as COLUMNS
from saltation.plots import cloud as cloud_plots
from saltation.plots import film
from saltation.results.result import Result
from saltation.results.tables import encounter_table, path_dataset
from saltation.scene import scene_of
from saltation.study.grains import RANGES

LOW, HIGH = 0.0013, 0.0233
WITH, WITHOUT = "encounters, history", "no encounters, history"


def cost(data: Record, form: str, concentration: float, number: int) -> Record:
    """One measured number of grains."""
    rows = data["scaling"]
    return next(row for row in rows if row["form"] == form and row["concentration"] == concentration and row["number"] == number)


def numbers(data: Record) -> list[int]:
    """The numbers of grains that were measured with encounters, at the lower concentration."""
    return sorted({row["number"] for row in data["scaling"] if row["form"] == WITH and row["concentration"] == LOW})


def growth(data: Record, concentration: float = LOW) -> float:
    """Cost of a grain among the most over that among a thousand."""
    most = numbers(data)[-1]
    return float(cost(data, WITH, concentration, most)["seconds"] / cost(data, WITH, concentration, 1000)["seconds"])


def over(data: Record, concentration: float) -> float:
    """Cost with encounters over that without, a thousand grains."""
    return float(cost(data, WITH, concentration, 1000)["seconds"] / cost(data, WITHOUT, concentration, 1000)["seconds"])


def compared(data: Record, concentration: float, *names: str) -> pd.DataFrame:
    """Comparisons at one concentration of some quantities."""
    frame = pd.DataFrame(data["study"]["comparison"])
    return frame[(frame["concentration"] == concentration) & frame["quantity"].isin(names)]


def exponent(data: Record, axis: str, which: str, meeting: bool, ensemble: str = "first") -> Record:
    """One exponent of the run of figs 4-17 and 4-18."""
    rows = [row for row in data["study"]["exponents"] if row["concentration"] == HIGH and row["particle_reynolds"] == 73.0 and row["stage"] == 2.0]
    return next(row for row in rows if row["axis"] == axis and row["range"] == which and row["encounters"] == meeting and row["ensemble"] == ensemble)


def met(data: Record, concentration: float) -> pd.DataFrame:
    """Rows of Table 4-2 at R_p 73."""
    frame = pd.DataFrame(data["study"]["table_4_2"])
    return frame[(frame["concentration"] == concentration) & np.isclose(frame["particle_reynolds"], 73.0)]


def span(values: Any, digits: int = 2) -> str:
    """Lowest to highest."""
    low, high = (f"{float(f'{edge:.{digits}g}'):g}" for edge in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    found = data["grains"]
    most, heights = numbers(found)[-1], compared(found, HIGH, "height")
    shorter = -heights["difference"] / heights["mean_without"]
    return {
        "number": "1 000",
        "time": seconds(cost(found, WITH, LOW, 1000)["seconds"]),
        "ratio": f"{over(found, LOW):.2f}",
        "ratio_high": f"{over(found, HIGH):.2f}",
        "low": f"{100 * LOW:g}",
        "high": f"{100 * HIGH:g}",
        "many": grouped(most),
        "growth": f"{growth(found):.2f}",
        "shorter_least": f"{shorter.min():.0%}",
        "shorter_most": f"{shorter.max():.0%}",
        "turned": f"{span(compared(found, HIGH, 'abs_deviation_angle')['mean_with'])} degrees",
        "gamma_with": f"{exponent(found, 'y', 'intermediate', True)['gamma']:.2f}",
        "gamma_without": f"{exponent(found, 'y', 'intermediate', False)['gamma']:.2f}",
    }


def pairs_table(data: Record) -> str:
    """Table 4-2."""
    slow = {row["name"]: row["slow"] for row in data["study"]["slow"]}
    names = {(row["concentration"], row["particle_reynolds"], row["stage"]): row["name"] for row in data["study"]["runs"] if row["encounters"]}
    rows = []
    for row in data["study"]["table_4_2"]:
        key = (row["concentration"], row["particle_reynolds"], row["stage"])

        def cell(name: str, row: Record = row) -> str:
            printed = row[f"{name}_printed"]
            own = "–" if row[name] is None else f"{row[name]:.3g}"
            return own if printed is None else f"{own} ({printed:.3g})"

        rows.append(
            [
                f"{100 * key[0]:g} %",
                f"{key[1]:g}",
                f"{key[2]:g}",
                *(cell(name) for name in ("pair_frequency", "bed_frequency", "ratio")),
                f"{slow[names[key]]:.2g}",
            ]
        )
    return table(["C_p", "R_p", "T", "F_pp", "F_pb", "F_pb/F_pp", "slow"], rows)


def probability(p: float) -> str:
    """A probability."""
    return f"{p:.2f}" if p >= 0.01 else "< 0.01" if p >= 1e-3 else "< 0.001"


def comparison_table(data: Record) -> str:
    """Figs 4-10 to 4-12 as numbers."""
    rows = []
    for row in data["study"]["comparison"]:
        if row["quantity"] in ("height", "length", "velocity"):
            means = [f"{row['mean_with']:.3g}", f"{row['mean_without']:.3g}", f"{row['difference']:+.2g} ± {row['standard_error']:.1g}"]
            labels = [f"{100 * row['concentration']:g} %", f"{row['particle_reynolds']:g}", f"{row['stage']:g}", row["quantity"]]
            rows.append([*labels, *means, probability(row["p_bootstrap"]), probability(row["p_wilcoxon"])])
    return table(["C_p", "R_p", "T", "", "with", "without", "difference", "p, blocks", "p, rank sum"], rows)


def changes_table(data: Record) -> str:
    """Figs 4-13 to 4-15 as numbers."""
    wanted = {
        "angle_xz": "xz (°)",
        "angle_xy": "xy (°)",
        "u": "u (u*)",
        "v": "v (u*)",
        "w": "w (u*)",
        "spin_x": "ω_x (u*/d)",
        "spin_y": "ω_y (u*/d)",
        "spin_z": "ω_z (u*/d)",
    }
    rows: dict[tuple[float, float], dict[str, Any]] = {}
    for row in data["study"]["changes"]:
        if np.isclose(row["particle_reynolds"], 73.0) and row["quantity"] in wanted:
            own = rows.setdefault((row["concentration"], row["stage"]), {})
            own[row["quantity"]], own["count"] = row["mean_size"], row["count"]
    cells = [[f"{100 * c:g} %", f"{t:g}", grouped(own["count"] / 2), *(f"{own[name]:.2g}" for name in wanted)] for (c, t), own in rows.items()]
    return table(["C_p", "T", "encounters", *wanted.values()], cells)


def exponents_table(data: Record) -> str:
    """Exponents of all ranges beside the printed ones."""
    rows = []
    for axis in "xy":
        for meeting in (True, False):
            for ensemble in ("first", "all"):
                cells = []
                for which in RANGES:
                    row = exponent(data, axis, which, meeting, ensemble)
                    interval = "" if row["lower"] is None else f" [{row['lower']:.2f}, {row['upper']:.2f}]"
                    printed = "" if row["printed"] is None else f" ({row['printed']:g})"
                    cells.append("–" if row["gamma"] is None else f"{row['gamma']:.2f}{interval}{printed}")
                rows.append([axis, "with" if meeting else "without", ensemble, *cells])
    return table(["", "encounters", "released", *(f"{name} (printed)" for name in RANGES)], rows)


def convergence_table(data: Record) -> str:
    """Fig. 4-3 as numbers."""
    rows = []
    for row in data["study"]["convergence"]:
        if row["concentration"] == HIGH and row["particle_reynolds"] == 73.0 and row["stage"] == 2.0 and not row["encounters"] and row["height"] is not None:
            cells = [f"{row[name]:.3g} ± {row[f'{name}_scatter']:.2g} ({row[f'{name}_sd']:.2g})" for name in ("height", "length")]
            rows.append([str(row["jumps"]), str(row["grains"]), *cells])
    return table(["jumps", "grains", "H: mean ± scatter of means (single jumps), d", "L"], rows)


def scaling_table(data: Record) -> str:
    """Time per grain and d/u*."""
    every = sorted({row["number"] for row in data["scaling"]})
    rows = []
    for concentration in (LOW, HIGH):
        for form in LOOKS:
            own = {row["number"]: row for row in data["scaling"] if row["form"] == form and row["concentration"] == concentration}
            cells = [seconds(own[n]["seconds"]) if n in own else "" for n in every]
            rows.append([f"{100 * concentration:g} %", form, *cells, grouped(own[max(own)]["bytes"])])
    return table(["C_p", "", *(grouped(n) for n in every), "bytes"], rows)


def picture(data: Record) -> Result:
    """The short run whose pictures are drawn."""
    shown = data["shown"]
    path = shown["path"]
    values = np.stack([np.array(path[name], dtype=np.float64) for name in ("x", "y", "z", "u", "v", "w")], axis=2)
    scene = scene_of(shown["scene"])
    kept = path_dataset(scene, np.array(shown["time"]), values)
    met_rows = np.array([shown["encounters"][name] for name in COLUMNS], dtype=np.float64).T
    fates = pd.DataFrame({"grain": [], "time": [], "fate": []})
    return Result(scene, pd.DataFrame(shown["jumps"]), "finished", "", shown["provenance"], shown["end"], encounter_table(met_rows), fates, kept)


def significant(data: Record) -> str:
    """What the tests say, in a sentence."""
    low, high = compared(data, LOW, "height", "length"), compared(data, HIGH, "height", "length")
    worst = high[["p_bootstrap", "p_wilcoxon"]].max().max()
    drop = -high["difference"] / high["mean_without"]
    least = low[["p_bootstrap", "p_wilcoxon"]].min().min()
    return (
        f"At 0.13 % no change of H or L is significant (p ≥ {least:.2f}). At 2.33 % all are (p ≤ {worst:.0e}), by {span(100 * drop)} %, "
        "also at T = 2, where the thesis sees none: more jumps show smaller changes."
    )


def grains(data: dict[str, Record]) -> str:
    """The page reports/grains.md."""
    found = data["grains"]
    study, own = found["study"], picture(found)
    film.animate(own, folder() / "figures" / "sand_cloud.gif", frames=80)
    plots = {
        name: save(cloud_plots.CLOUD_PLOTS[name](own), f"grains_{name}")
        for name in ("three_dimensional", "plan", "pair", "snapshots", "grain_history", "profiles")
    }
    rates = met(found, LOW)
    alone = found["independent"]
    return fill(
        "grains.md",
        study=study,
        plots=plots,
        found=found,
        alone=alone,
        **opening(data),
        table_4_2=pairs_table(found),
        low_factor=factor(float((rates["pair_frequency_printed"] / rates["pair_frequency"]).median())),
        clipped=f"{study['clipped'][0]['pairs']:.2g}",
        scattered=f"{study['clipped'][1]['pairs']:.2g}",
        significant=significant(found),
        figure_compared=save(draw_compared(study["comparison"]), "grains_compared"),
        comparison=comparison_table(found),
        changes=changes_table(found),
        figure_changes=save(cloud_plots.CLOUD_PLOTS["encounters"](own), "grains_encounters"),
        local=f"{RANGES['local'][1]:g}",
        intermediate=" to ".join(f"{edge:g}" for edge in RANGES["intermediate"]),
        beyond=f"{RANGES['global'][0]:g}",
        figure_moments=save(draw_moments(study["moments"]), "grains_moments"),
        exponents=exponents_table(found),
        convergence=convergence_table(found),
        same="with the same bits" if alone["same"] else "with other bits",
        figure_scaling=save(draw_scaling(found["scaling"]), "grains_scaling"),
        scaling=scaling_table(found),
        footer=footer({"grains": found}),
    )


# Figures, from the records alone

LOOKS = {
    "encounters, history": (PURPLE, "o"),
    "encounters, no history": (ORANGE, "s"),
    "no encounters, history": (BLUE, "^"),
    "no encounters, no history": (GREEN, "D"),
}


def draw_scaling(rows: list[Record]) -> Any:
    """Time per grain and unit time against the number of grains."""
    concentrations = sorted({row["concentration"] for row in rows})
    figure, panels = plt.subplots(1, len(concentrations), figsize=(11.0, 4.8), sharey=True)
    for axes, concentration in zip(panels, concentrations, strict=True):
        for form, (colour, marker) in LOOKS.items():
            own = [row for row in rows if row["form"] == form and row["concentration"] == concentration]
            axes.loglog([row["number"] for row in own], [1e6 * row["seconds"] for row in own], color=colour, marker=marker, label=form)
        axes.set(title=f"C_p = {100 * concentration:g} %", xlabel="number of grains")
        axes.grid(True, which="major", alpha=0.3)
    panels[0].set(ylabel="time per grain and d/u*, one core (µs)", ylim=(10.0, 1000.0))
    _legend(figure, panels[0], 4)
    figure.suptitle("The cost of a grain hardly depends on how many there are")
    return figure


def draw_compared(rows: list[Record]) -> Any:
    """H and L with and without encounters against T, one panel per set of runs."""
    sets = list(dict.fromkeys((row["concentration"], row["particle_reynolds"]) for row in rows))
    figure, panels = plt.subplots(2, len(sets), figsize=(12.0, 6.4), sharex=True)
    for column, (concentration, reynolds) in enumerate(sets):
        for line, (name, label) in enumerate((("height", "jump height H (d)"), ("length", "jump length L (d)"))):
            axes = panels[line, column]
            own = [r for r in rows if (r["concentration"], r["particle_reynolds"]) == (concentration, reynolds) and r["quantity"] == name]
            for shift, side, colour, marker in ((-0.02, "without", GREY, "o"), (0.02, "with", RED, "s")):
                stage, mean, sd = ([r[key] for r in own] for key in ("stage", f"mean_{side}", f"sd_{side}"))
                axes.errorbar(
                    np.array(stage) + shift, mean, sd, color=colour, marker=marker, linestyle="-", linewidth=1.0, capsize=3, label=f"{side} encounters"
                )
            axes.set_ylim(bottom=0.0)
            axes.grid(True, alpha=0.3)
            if column == 0:
                axes.set_ylabel(label)
            if line == 0:
                axes.set_title(f"C_p = {100 * concentration:g} %, R_p = {reynolds:g}")
            else:
                axes.set_xlabel("transport stage T")
    panels[0, 0].legend(loc="upper left", fontsize=8)
    figure.suptitle("Encounters shorten jumps at 2.33 % and do nothing at 0.13 % (bars: standard deviation of single jumps)")
    return figure


def draw_moments(runs: list[Record]) -> Any:
    """Second moments along and across from one release, with encounters and without."""
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 4.8))
    for axes, axis, name in zip(panels, "xy", ("along the stream", "across the stream"), strict=True):
        for run in runs:
            colour, label = (RED, "with encounters") if run["encounters"] else (GREY, "without encounters")
            own = run["first"]
            axes.loglog(own["lag"], own[axis], color=colour, marker="o", markersize=3, linewidth=1.0, label=label)
        axes.axvline(runs[0]["duration"], color="#999999", linestyle=":", linewidth=1.0)
        axes.annotate("a jump", (runs[0]["duration"], 0.02), xycoords=("data", "axes fraction"), xytext=(3, 0), textcoords="offset points", fontsize=8)
        axes.set(title=name, xlabel="time since release (d/u*)", ylabel=f"⟨{axis.upper()}'²⟩ (d²)")
        axes.grid(True, which="major", alpha=0.3)
    lag, x, y = (np.array(runs[0]["first"][key]) for key in ("lag", "x", "y"))
    for axes, values in zip(panels, (x, y), strict=True):
        middle = len(lag) // 2
        _slope(axes, lag[middle], 0.2 * values[middle], 6.0 * lag[middle], 1.0, "slope 1\n(γ = ½)", "right")
    panels[1].legend(loc="upper left", fontsize=9)
    figure.suptitle("Encounters alone spread grains across the stream")
    return figure


PAGE = Page("grains", grains, ("grains",))
