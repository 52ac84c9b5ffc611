"""`python -m reports.house`: the map of the packages for CONTRIBUTING, drawn from the imports as they are: reports/figures/house.png."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import grimp
import matplotlib as mpl
import matplotlib.pyplot as plt

from basset._look import LOOK

FIGURE = Path(__file__).parent / "figures" / "house.png"
Arrows = dict[str, set[str]]  # a part -> the parts that it imports


def parts(package: str) -> Arrows:
    """The files and folders right inside a package, and what each imports of the others, late imports too."""
    graph = grimp.build_graph(package, exclude_type_checking_imports=True)
    children = {name for name in graph.find_children(package) if not name.endswith("__main__")}
    return {part: {other for other in children - {part} if graph.direct_import_exists(importer=part, imported=other, as_packages=True)} for part in children}


def floors(arrows: Arrows) -> dict[str, int]:
    """The floor of each part: 0 if it imports none of the others, else one above the highest that it imports."""
    found: dict[str, int] = {}

    def floor(part: str, above: tuple[str, ...] = ()) -> int:
        if part in above:
            raise ValueError(f"{' -> '.join(above)} -> {part} is a circle of imports")
        if part not in found:
            found[part] = 1 + max((floor(other, (*above, part)) for other in arrows[part]), default=-1)
        return found[part]

    for part in sorted(arrows):
        floor(part)
    return found


def reduced(arrows: Arrows) -> Iterable[tuple[str, str]]:
    """The arrows that no chain of other arrows implies."""

    def below(part: str) -> set[str]:
        return arrows[part].union(*(below(other) for other in arrows[part]))

    for part, others in sorted(arrows.items()):
        yield from ((part, other) for other in sorted(others) if not any(other in below(between) for between in others - {other}))


def draw(package: str, axes: plt.Axes) -> None:
    """A package: its parts by floors, folders bold, arrows downwards; what begins with an underscore serves all floors and is only named."""
    every = parts(package)
    helpers = {part for part in every if part.rpartition(".")[2].startswith("_")}

    def shown(part: str) -> set[str]:
        return {found for other in every[part] for found in (shown(other) if other in helpers else {other})}

    arrows = {part: shown(part) for part in every if part not in helpers}
    rows: dict[int, list[str]] = {}
    for part, floor in sorted(floors(arrows).items()):
        rows.setdefault(floor, []).append(part)
    drawn = list(reduced(arrows))
    place: dict[str, tuple[float, float]] = {}
    for floor, row in sorted(rows.items()):  # each part above the middle of what it imports
        below = {part: [place[other][0] for one, other in drawn if one == part] for part in row}
        row.sort(key=lambda part: sum(below[part]) / len(below[part]) if below[part] else 0.5)
        shift = 0.09 * (floor % 2)  # so that long arrows pass beside the parts between
        place |= {part: ((column + 1.0) / (len(row) + 1.0) + shift, float(floor)) for column, part in enumerate(row)}
    boxes = {}
    for part, (x, y) in place.items():
        folder = (Path(__file__).parents[1] / part.replace(".", "/")).is_dir()
        look = {"boxstyle": "round,pad=0.3", "fc": "#dbe9f6" if folder else "white", "ec": "0.4", "lw": 0.7}
        name = part.rpartition(".")[2] + "/" * folder
        boxes[part] = axes.text(x, y, name, ha="center", va="center", fontsize=12, weight="bold" if folder else "normal", bbox=look, zorder=5).get_bbox_patch()
    for part, other in drawn:
        ends = {"patchA": boxes[part], "patchB": boxes[other], "shrinkA": 0, "shrinkB": 1}
        axes.annotate("", place[other], place[part], arrowprops={"arrowstyle": "-|>", "color": "0.5", "lw": 1.0, **ends}, zorder=4)
    axes.set(xlim=(0.05, 1.0), ylim=(-0.9, max(rows) + 0.4))
    axes.set_title(package, fontsize=14, weight="bold")
    axes.text(0.53, -0.75, "for all: " + ", ".join(sorted(part.rpartition(".")[2] for part in helpers)), ha="center", fontsize=9, color="0.3")
    axes.axis("off")


def main() -> None:
    """Draw both packages."""
    with mpl.rc_context(LOOK):
        figure, both = plt.subplots(1, 2, figsize=(12.5, 7.5), layout="constrained")
        for package, axes in zip(("basset", "saltation"), both, strict=True):
            draw(package, axes)
        figure.suptitle("An arrow is an import that no others imply; folders are bold", fontsize=11)
        figure.canvas.draw()  # arrows end at boxes, which are laid out by then
        figure.savefig(FIGURE, dpi=100)
    print(FIGURE)


if __name__ == "__main__":
    main()
