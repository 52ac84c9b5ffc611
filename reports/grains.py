"""The page on many grains."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from basset._look import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from basset._look import slope as _slope
from reports.site.page import Page, fill, finished, folder, footer, save, table
from reports.words import Record, factor, grouped, listed, of, seconds, signed
from saltation.flight.layout import ENCOUNTER_COLUMNS as COLUMNS
from saltation.plots import cloud as cloud_plots
from saltation.plots import film
from saltation.results.result import Result
from saltation.results.tables import encounter_table, path_dataset
from saltation.scene import scene_of
from saltation.study.grains import RANGES

LOW, HIGH = 0.0013, 0.0233
WITH, WITHOUT = "encounters, history", "no encounters, history"
CHANGED = {  # what an encounter changes, and its unit
    "angle_xz": ("xz", "°"),
    "angle_xy": ("xy", "°"),
    "angle_yz": ("yz", "°"),
    "u": ("u", "u*"),
    "v": ("v", "u*"),
    "w": ("w", "u*"),
    "spin_x": ("ω_x", "u*/d"),
    "spin_y": ("ω_y", "u*/d"),
    "spin_z": ("ω_z", "u*/d"),
}
REGRESSIONS = {"lee_hsu_1994": ("Lee–Hsu 1994", "--"), "sklar_dietrich_2004": ("Sklar–Dietrich 2004", "-."), "van_rijn_1984": ("van Rijn 1984", ":")}


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


def met(data: Record, concentration: float, scatter: bool = False) -> list[Record]:
    """Rows of Table 4-2 at R_p 73 over all seeds."""
    return of(data["study"]["by_seeds"], concentration=concentration, scatter=scatter)


def printed_over(rows: list[Record]) -> list[float]:
    """How many times more often grains meet in the thesis."""
    return [row["pair_frequency_printed"] / row["pair_frequency"] for row in rows]


def span(values: Any, digits: int = 2) -> str:
    """Lowest to highest."""
    low, high = (f"{float(f'{edge:.{digits}g}'):g}" for edge in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def opening(data: dict[str, Record]) -> dict[str, Any]:
    """The numbers of the three sentences to take away."""
    found, chapter = data["grains"], data["chapter4"]
    most, heights = numbers(found)[-1], compared(chapter, HIGH, "height")
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
        "turned": f"{span(compared(chapter, HIGH, 'abs_deviation_angle')['mean_with'])} degrees",
        "gamma_with": gamma_across(chapter, False, True),
        "gamma_without": gamma_across(chapter, False, False),
    }


def beside(row: Record, name: str) -> str:
    """A mean with its interval, and in brackets what is printed."""
    value, interval, printed = row[name], row.get(f"{name}_interval"), row[f"{name}_printed"]
    if value is None:
        return "–"
    within = "" if interval is None else f" ± {float(f'{interval:.2g}'):g}"
    return f"{value:.3g}{within}" + ("" if printed is None else f" ({printed:.3g})")


def pairs_table(data: Record) -> str:
    """Table 4-2: R_p 73 over all seeds, R_p 250 from one."""
    slow = {row["name"]: row["slow"] for row in data["study"]["slow"]}
    coarse = [row for row in data["study"]["runs"] if row["encounters"] and row["particle_reynolds"] == 250.0]
    of_one = {row["name"]: of(data["study"]["table_4_2"], **{key: row[key] for key in ("concentration", "particle_reynolds", "stage")})[0] for row in coarse}
    rows = [*data["study"]["by_seeds"], *(row | {"scatter": False, "slow_frequency": slow[name]} for name, row in of_one.items())]
    cells = [
        [
            f"{100 * row['concentration']:g} %",
            f"{row['particle_reynolds']:g}",
            f"{row['stage']:g}",
            "yes" if row["scatter"] else "no",
            beside(row, "pair_frequency"),
            f"{row['pair_frequency'] - row['slow_frequency']:.2g}",
            *(beside(row, name) for name in ("bed_frequency", "ratio")),
        ]
        for row in rows
    ]
    return table(["C_p", "R_p", "T", "bed scatters", "F_pp", "without slow", "F_pb", "F_pb/F_pp"], cells)


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
    rows: dict[Any, dict[str, Any]] = {}
    for row in data["study"]["changes"]:
        own = rows.setdefault((row["concentration"], row["scatter"], row["stage"]), row)
        own[row["quantity"]] = row["mean_size"]
    cells = [
        [f"{100 * c:g} %", "yes" if scatter else "no", f"{t:g}", grouped(own["count"] / 2), grouped(own["slow"]), *(f"{own[name]:.3g}" for name in CHANGED)]
        for (c, scatter, t), own in sorted(rows.items())
    ]
    head = [f"{name} ({unit})" for name, unit in CHANGED.values()]
    return table(["C_p", "bed scatters", "T", "encounters", "slow, left out", *head], cells)


def trend(rows: list[Record]) -> tuple[float, float]:
    """Slope of mean sizes over T and its standard error, by weighted least squares; both grains of an encounter count once."""
    stage, mean = (np.array([row[key] for row in rows]) for key in ("stage", "mean_size"))
    weight = np.array([row["count"] / 2.0 / row["sd_size"] ** 2 for row in rows])
    away = stage - np.average(stage, weights=weight)
    spread = float(weight @ away**2)
    return float(weight * away @ mean) / spread, spread**-0.5


def trends(data: Record, concentration: float, scatter: bool = False) -> str:
    """Which changes fall with T, which grow: beyond two standard errors of the slope."""
    found = {name: trend(of(data["study"]["changes"], concentration=concentration, scatter=scatter, quantity=name)) for name in CHANGED}

    def told(sign: float) -> str:
        own = [(name, slope, error) for name, (slope, error) in found.items() if sign * slope > 2.0 * error]
        return listed([f"{CHANGED[name][0]} ({signed(slope, 2)} ± {error:.2f})" for name, slope, error in own], "")

    rest = listed([CHANGED[name][0] for name, (slope, error) in found.items() if abs(slope) <= 2.0 * error], "")
    parts = {"falling": told(-1.0), "growing": told(1.0), "neither beyond two standard errors": rest}
    return "; ".join(f"{words} {names}" for words, names in parts.items() if names)


def first_table(data: Record) -> str:
    """Fig. 4-3 as numbers."""
    rows = []
    for row in data["single"]["first"]:
        rows.append([str(row["jumps"]), *(f"{row[name]:.3g} ± {row[f'{name}_se']:.2g} ({row[f'{name}_sd']:.2g})" for name in ("height", "length"))])
    return table(["first jumps", "H: mean ± standard error (single jumps), d", "L"], rows)


def inside(data: Record) -> str:
    """How many means of a single grain lie within the regressions, and on which side the others."""
    words = []
    for name, label in (("height", "H"), ("length", "L")):
        for reynolds in dict.fromkeys(row["particle_reynolds"] for row in data["single"]["validation"]):
            places = []
            for row in of(data["single"]["validation"], particle_reynolds=reynolds):
                published = [values[name] for values in row["regressions"].values()]
                mean = row[name]["mean"]
                places.append("below" if mean < min(published) else "above" if mean > max(published) else "within")
            kinds = [f"{places.count(kind)} {kind}" for kind in ("below", "within", "above") if kind in places]
            words.append(f"{label} at R_p {reynolds:g}: {', '.join(kinds)}")
    return "; ".join(words)


def shares_table(data: Record) -> str:
    """Shares of bed and encounters in the spreading across."""
    rows = []
    for row in data["study"]["across"]["shares"]:
        bed, lower, upper, encounters = (100.0 * row[name] for name in ("bed", "lower", "upper", "encounters"))
        rows.append([f"{row['jumps']:g}", f"{row['lag']:.3g}", f"{bed:.0f} % [{lower:.0f}, {upper:.0f}]", f"{encounters:.0f} %".replace("-", "−")])
    return table(["jumps since the release", "d/u*", "bed [95 %]", "encounters"], rows)


def gamma_across(data: Record, scatter: bool, meeting: bool) -> str:
    """γ_y between 2 and 20 jumps, all seeds."""
    row = of(data["study"]["across"]["gammas"], scatter=scatter, encounters=meeting)[0]
    return f"{row['gamma']:.2f} [{row['lower']:.2f}, {row['upper']:.2f}]"


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
    found, timed = data["chapter4"], data["grains"]
    study, own = found["study"], picture(found)
    film.animate(own, folder() / "figures" / "sand_cloud.gif", frames=60)
    plots = {
        name: save(cloud_plots.CLOUD_PLOTS[name](own), f"grains_{name}")
        for name in ("three_dimensional", "plan", "pair", "snapshots", "grain_history", "profiles")
    }
    scattered, across = met(found, LOW, True), study["across"]
    ends = {(curve["scatter"], curve["encounters"]): curve["moment"][-1] for curve in across["curves"]}
    alone = timed["independent"]
    return fill(
        "grains.md",
        study=study,
        plots=plots,
        timed=timed,
        alone=alone,
        **opening(data),
        table_4_2=pairs_table(found),
        seeds=len(study["seeds"]),
        low_factor=factor(float(np.median(printed_over(met(found, LOW))))),
        scattered_rates=listed([f"{row['pair_frequency']:.2g}" for row in scattered]),
        printed_rates=listed([f"{row['pair_frequency_printed']:.2g}" for row in scattered]),
        dense_factor=span([1.0 / ratio for ratio in printed_over(met(found, HIGH, True))]),
        high_factor=span([1.0 / ratio for ratio in printed_over(met(found, HIGH))]),
        clipped=f"{study['clipped'][0]['pairs']:.2g}",
        scattered=f"{study['clipped'][1]['pairs']:.2g}",
        significant=significant(found),
        figure_compared=save(draw_compared(study["comparison"]), "grains_compared"),
        comparison=comparison_table(found),
        changes=changes_table(found),
        figure_changed=save(draw_changes(study["changes"]), "grains_changes"),
        trends_high=trends(found, HIGH),
        trends_low=trends(found, LOW),
        inclination=listed([f"{row['mean_size']:.1f}" for row in of(study["changes"], concentration=HIGH, scatter=False, quantity="angle_xz")]),
        first=first_table(found),
        figure_first=save(draw_first(found["single"]["first"]), "grains_first_jumps"),
        figure_validation=save(draw_validation(found["single"]["validation"]), "grains_validation"),
        inside=inside(found),
        shares=shares_table(found),
        gammas=listed([f"{gamma_across(found, *key)} {words}" for key, words in SOURCES.items()]),
        relation=f"{across['relation']:.2g}",
        by_neither=f"{ends[False, False]:.2g}",
        by_encounters=f"{ends[False, True]:.3g}",
        by_bed=f"{ends[True, False]:.3g}",
        by_both=f"{ends[True, True]:.3g}",
        figure_changes=save(cloud_plots.CLOUD_PLOTS["encounters"](own), "grains_encounters"),
        local=f"{RANGES['local'][1]:g}",
        intermediate=" to ".join(f"{edge:g}" for edge in RANGES["intermediate"]),
        beyond=f"{RANGES['global'][0]:g}",
        figure_moments=save(draw_moments(study["moments"], across), "grains_moments"),
        exponents=exponents_table(found),
        convergence=convergence_table(found),
        same="with the same bits" if alone["same"] else "with other bits",
        figure_scaling=save(draw_scaling(timed["scaling"]), "grains_scaling"),
        scaling=scaling_table(timed),
        footer=footer({"chapter4": found, "grains": timed}),
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
    return finished(figure, panels[0], 4, "The cost of a grain hardly depends on how many there are")


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


def draw_moments(runs: list[Record], across: Record) -> Any:
    """Second moments from one release: along with encounters and without, across with each of bed and encounters or without."""
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 4.8))
    for run in runs:
        colour, label = (RED, "with encounters") if run["encounters"] else (GREY, "without encounters")
        panels[0].loglog(run["first"]["lag"], run["first"]["x"], color=colour, marker="o", markersize=3, linewidth=1.0, label=label)
    for curve in across["curves"]:
        key = curve["scatter"], curve["encounters"]
        panels[1].loglog(across["lag"], curve["moment"], color=COLOURS[key], marker="o", markersize=3, linewidth=1.0, label=SOURCES[key])
    for axes, axis, name in zip(panels, "xy", ("along the stream", "across the stream"), strict=True):
        axes.axvline(runs[0]["duration"], color="#999999", linestyle=":", linewidth=1.0)
        axes.annotate("a jump", (runs[0]["duration"], 0.02), xycoords=("data", "axes fraction"), xytext=(3, 0), textcoords="offset points", fontsize=8)
        axes.set(title=name, xlabel="time since release (d/u*)", ylabel=f"⟨{axis.upper()}'²⟩ (d²)")
        axes.grid(True, which="major", alpha=0.3)
    both = of(across["curves"], scatter=True, encounters=True)[0]["moment"]
    for axes, lag, values, below in zip(panels, (runs[0]["first"]["lag"], across["lag"]), (runs[0]["first"]["x"], both), (0.2, 0.02), strict=True):
        middle = len(lag) // 2
        _slope(axes, lag[middle], below * values[middle], 6.0 * lag[middle], 1.0, "slope 1\n(γ = ½)", "right")
    for axes in panels:
        axes.legend(loc="upper left", fontsize=9)
    figure.suptitle("Encounters and tilted planes of the bed spread grains across the stream")
    return figure


SOURCES = {(False, False): "with neither", (False, True): "with encounters", (True, False): "with scatter by the bed", (True, True): "with both"}
COLOURS = {(False, False): GREY, (False, True): RED, (True, False): BLUE, (True, True): PURPLE}


def draw_changes(rows: list[Record]) -> Any:
    """Figs 4-13 to 4-15: mean sizes of what an encounter changes against T, bars of one standard deviation of single changes."""
    figure, panels = plt.subplots(3, 3, figsize=(11.0, 8.4), sharex=True)
    series = [(c, scatter) for c in (LOW, HIGH) for scatter in (False, True)]
    for axes, (name, (short, unit)) in zip(panels.ravel(), CHANGED.items(), strict=True):
        for k, (concentration, scatter) in enumerate(series):
            own = of(rows, concentration=concentration, scatter=scatter, quantity=name)
            stage, mean, sd = (np.array([row[key] for row in own]) for key in ("stage", "mean_size", "sd_size"))
            colour, label = BLUE if concentration == LOW else RED, f"{100 * concentration:g} %{', bed scatters' if scatter else ''}"
            look = {"marker": "s" if scatter else "o", "markerfacecolor": "white" if scatter else colour, "linestyle": ":" if scatter else "-"}
            axes.errorbar(stage + 0.03 * (k - 1.5), mean, sd, color=colour, linewidth=1.0, elinewidth=0.7, capsize=2, label=label, **look)
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(f"|Δ {short}| ({unit})" if unit != "°" else f"|Δ angle| in {short} (°)")
    for axes in panels[2]:
        axes.set_xlabel("transport stage T")
    return finished(figure, panels[0, 0], 4, "What an encounter changes, slow ones left out (bars: standard deviation of single changes)")


def draw_first(rows: list[Record]) -> Any:
    """Fig. 4-3: means of the first n jumps of one grain; thin bars 2 standard deviations of single jumps, thick ones 2 standard errors."""
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.0))
    for axes, (name, label) in zip(panels, (("height", "jump height H (d)"), ("length", "jump length L (d)")), strict=True):
        draw_bars(axes, [row["jumps"] for row in rows], [{"mean": row[name], "sd": row[f"{name}_sd"], "se": row[f"{name}_se"]} for row in rows])
        axes.axhline(rows[-1][name], color=GREY, linestyle=":", linewidth=1.0)
        axes.set(xlabel="jumps flown, the first 10 left out", ylabel=label, ylim=(0.0, None))
    figure.suptitle("A hundred jumps of one grain tell the mean (bars: two standard deviations; thick: two standard errors)")
    return figure


def draw_bars(axes: Any, x: Any, rows: list[Record]) -> None:
    """Means with thin bars of two standard deviations and thick ones of two standard errors."""
    mean, sd, se = (np.array([row[key] for row in rows]) for key in ("mean", "sd", "se"))
    axes.errorbar(x, mean, 2.0 * sd, color=BLACK, linestyle="none", elinewidth=0.8, capsize=3)
    axes.errorbar(x, mean, 2.0 * se, color=BLACK, linestyle="none", marker="o", elinewidth=3.0, label="one grain")


def draw_validation(rows: list[Record]) -> Any:
    """Figs 4-4 and 4-5: H and L of one grain against T, beside the published regressions and their envelope."""
    sizes = list(dict.fromkeys(row["particle_reynolds"] for row in rows))
    figure, panels = plt.subplots(2, len(sizes), figsize=(10.0, 7.0), sharex=True)
    for column, reynolds in enumerate(sizes):
        own = of(rows, particle_reynolds=reynolds)
        stages = [row["stage"] for row in own]
        for axes, (name, label) in zip(panels[:, column], (("height", "jump height H (d)"), ("length", "jump length L (d)")), strict=True):
            published = np.array([[row["regressions"][which][name] for row in own] for which in REGRESSIONS])
            axes.fill_between(stages, published.min(axis=0), published.max(axis=0), color="#d9d9d9", label="regressions: envelope")
            for (text, dash), values in zip(REGRESSIONS.values(), published, strict=True):
                axes.plot(stages, values, dash, color="#666666", linewidth=1.0, label=text)
            draw_bars(axes, stages, [row[name] for row in own])
            axes.set(ylabel=label, ylim=(0.0, None))
        panels[0, column].set_title(f"R$_p$ = {reynolds:g}")
        panels[1, column].set_xlabel("transport stage T")
    return finished(figure, panels[0, 0], 5, "A single grain of chapter 4 beside the regressions (bars: two standard deviations; thick: two standard errors)")


PAGE = Page("grains", grains, ("chapter4", "grains"))
