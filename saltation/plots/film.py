"""An animation of many grains: their periodic box from the side and from above, grains true to scale, coloured by their speed."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from basset._look import BROWN, LOOK, RED
from basset.kernels import Floats
from saltation._files import replacing
from saltation.plots.highlights import jump_time, settled
from saltation.results.result import Result

__all__ = ["animate"]

FRAMES = 100
WIDEST = 30.0  # d: of a wider box a part is shown
WIDTH = 7.2  # inch
DOTS = 80  # per inch
PAUSE = 80  # ms between frames
COLOURS = 256
GLOW = 0.25  # mean durations of a jump that grains stay marked after they met


class Scenery:
    """The figure and the collections of grains that change from frame to frame."""

    def __init__(self, result: Result, speeds: Floats, top: float) -> None:
        """For `speeds` (u*) from the first to the second and heights up to `top` (d)."""
        box = result.scene.box
        self.length, self.width = min(box[0], WIDEST), min(box[1], WIDEST)
        self.flat = result.scene.in_plane
        shapes = [top] if self.flat else [top, self.width]
        height = 1.6 + WIDTH * 0.86 * sum(shapes) / self.length
        self.figure = Figure(figsize=(WIDTH, height), dpi=DOTS)
        self.canvas: Any = FigureCanvasAgg(self.figure)
        panels = self.figure.subplots(len(shapes), 1, sharex=True, squeeze=False, height_ratios=shapes)[:, 0]
        self.grains = []
        for axes, size in zip(panels, shapes, strict=True):
            axes.set(xlim=(0.0, self.length), ylim=(0.0, size), aspect="equal")
            axes.grid(False)
            drawn = EllipseCollection([], [], [], units="xy", offset_transform=axes.transData, cmap="viridis", clim=tuple(speeds), linewidths=0.4)
            axes.add_collection(drawn)
            self.grains.append(drawn)
        panels[0].axhline(0.0, color=BROWN, linewidth=6.0)
        panels[0].set_ylabel("height z (d)")
        where = f", a part of the box of {box[0]:.3g} d" if box[0] > WIDEST else ""
        panels[-1].set_xlabel("along x (d)" + (where if result.scene.grains.boundary == "periodic" else ", about the median grain"))
        if not self.flat:
            panels[1].set_ylabel("across y (d)")
        self.figure.colorbar(self.grains[0], ax=list(panels), location="bottom", aspect=50, pad=0.02, label=f"speed ({result.scene.numbers.unit('u*')})")
        self.title = self.figure.suptitle(" ")

    def show(self, places: Floats, speed: Floats, met: Floats, title: str) -> None:
        """Grains at `places` (n, 3), d, with `speed` (n,), u*; `met` (n,): 1 just met, 0 not. Those outside are left out."""
        seen = (np.abs(places[:, :2] - [0.5 * self.length, 0.5 * self.width]) <= [0.5 * self.length + 0.5, 0.5 * self.width + 0.5]).all(axis=1)
        places, speed, met = places[seen], speed[seen], met[seen]
        order = [np.argsort(-places[:, 1]), np.argsort(places[:, 2])]  # what is nearer comes later
        for drawn, nearer, upright in zip(self.grains, order, (2, 1), strict=False):
            one = np.ones(len(nearer))
            drawn.set(widths=one, heights=one, angles=0.0 * one, offsets=places[nearer][:, [0, upright]], array=speed[nearer])
            drawn.set_edgecolor([RED if marked else "#333333" for marked in met[nearer]])
            drawn.set_linewidth(list(0.4 + 2.2 * met[nearer]))
        self.title.set_text(title)

    def pixels(self) -> Any:
        """The picture (rows, columns, 3), bytes."""
        self.canvas.draw()
        return np.array(self.canvas.buffer_rgba())[:, :, :3]

    def palette(self) -> Image.Image:
        """The colours of all frames: those of the empty picture, which has the scale of speeds, and the red of a rim."""
        sample = Image.fromarray(self.pixels())
        sample.paste(RED, (0, 0, sample.width, 8))
        return sample.quantize(COLOURS)


def folded(places: Floats, box: tuple[float, ...]) -> tuple[Floats, NDArray[np.int64]]:
    """Places in the periodic box (its length, or length and width), those that reach over its edge also at the other one (m, 3); whose they are (m,)."""
    owner = np.arange(len(places))
    for axis, size in enumerate(box):
        inside = places.copy()
        inside[:, axis] %= size
        low, high = inside[:, axis] < 0.5, inside[:, axis] > size - 0.5
        shift = np.zeros(3)
        shift[axis] = size
        places = np.concatenate([inside, inside[low] + shift, inside[high] - shift])
        owner = np.concatenate([owner, owner[low], owner[high]])
    return places, owner


def animate(
    result: Result, path: str | os.PathLike[str], frames: int = FRAMES, start: float | None = None, progress: Callable[[float], None] | None = None
) -> None:
    """Write a GIF of the cloud, whole or not at all: every kept position a frame, from `start` (d/u*; default: half have done `run.discard` jumps).

    The frame stands still: grains that leave the periodic box on one side come back on the other. Of an open cloud it has the size of the first volume and goes
    with the median grain. It is at most 30 d long and wide. Grains that met in the last quarter of a mean jump have a red rim. In either view those
    that are nearer hide the others.
    """
    if Path(path).suffix != ".gif":
        raise ValueError(f"path must end in .gif, got {str(path)!r}")
    if frames < 1:
        raise ValueError(f"frames must be 1 or greater, got {frames}")
    kept, unit = result.trajectory, result.scene.numbers.unit("u*")
    time = kept["time"].to_numpy()
    if start is not None and start > time[-1]:
        raise ValueError(f"start must be {time[-1]:g} d/{unit} or earlier, when the run ended, got {start:g}")
    first = int(np.searchsorted(time, settled(result) if start is None else start))
    if start is None:
        first = max(0, min(first, len(time) - frames))
    chosen = slice(first, first + frames)
    time = time[chosen]
    nothing = np.zeros((len(time), kept.sizes["grain"]))
    places, velocities = (
        np.stack([kept[name].to_numpy()[chosen] if name in kept else nothing for name in names], axis=2) for names in (("x", "y", "z"), ("u", "v", "w"))
    )
    speed = np.linalg.norm(velocities, axis=2)
    present = np.isfinite(speed)
    if not present[0].any():
        raise ValueError(f"animate needs grains that still move, got none at {time[0]:g} d/{unit}")
    with rc_context(LOOK):
        scenery = Scenery(result, np.quantile(speed[present], (0.01, 0.99)), float(np.nanmax(places[:, :, 2])) + 0.6)
    met, glow = result.encounters, GLOW * jump_time(result)
    colours, pictures = scenery.palette(), []
    with replacing(path) as name:
        for k, now in enumerate(time):
            here = places[k][present[k]]
            marked = np.zeros(places.shape[1])
            if len(met):
                recent = met[(met["time"] <= now) & (met["time"] > now - glow)]
                marked[recent[["first", "second"]].to_numpy().ravel()] = 1.0
            shown, owner = here, np.arange(len(here))
            if result.scene.grains.boundary == "periodic":
                shown, owner = folded(here, result.scene.box[: len(scenery.grains)])
            elif len(here):
                shown = here - np.median(here, axis=0) * [1.0, 1.0, 0.0] + [0.5 * scenery.length, 0.5 * scenery.width, 0.0]
            told = f"{present[k].sum()} grains at {now:.1f} d/{unit}, from the side{'' if scenery.flat else ' and from above'}; red rim: just met"
            scenery.show(shown, speed[k][present[k]][owner], marked[present[k]][owner], told)
            pictures.append(Image.fromarray(scenery.pixels()).quantize(palette=colours, dither=Image.Dither.NONE))
            if progress is not None:
                progress((k + 1) / len(time))
        pictures[0].save(name, format="GIF", save_all=True, append_images=pictures[1:], duration=PAUSE, loop=0)
