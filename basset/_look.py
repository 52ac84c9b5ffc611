"""Style of all figures: colours safe for colour-blind readers (Okabe and Ito), light grid, reference slopes, legends below."""

from __future__ import annotations

from typing import Any

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, RED, PINK = "#000000", "#E69F00", "#56B4E9", "#009E73", "#C9B800", "#0072B2", "#D55E00", "#CC79A7"
GREY, PURPLE, BROWN = "#777777", "#7A4FA3", "#5B3A1E"
LOOK: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.markersize": 5,
    "lines.linewidth": 1.3,
    "svg.hashsalt": "basset",
    "svg.fonttype": "none",
    "figure.constrained_layout.use": True,
}


def slope(axes: Any, x0: float, y0: float, x1: float, order: float, label: str, side: str = "left") -> None:
    """A reference line through (x0, y0) with that slope, labelled at its end x1."""
    y1 = y0 * (x1 / x0) ** order
    axes.plot([x0, x1], [y0, y1], color="#999999", linestyle=":", linewidth=1.2, zorder=1)
    axes.annotate(
        label,
        (x1, y1),
        xytext=(-3 if side == "left" else 3, 0),
        textcoords="offset points",
        ha="right" if side == "left" else "left",
        va="center",
        color="#666666",
        fontsize=9,
    )


def legend(figure: Any, axes: Any, columns: int) -> None:
    """One legend for all panels, below them."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)
