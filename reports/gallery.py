"""The gallery reports/examples.md: what each file of reports/examples shows, the number that it asserts and its figure, drawn by running it."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib import cycler
from matplotlib.figure import Figure

from basset._look import BLUE, GREEN, LOOK, ORANGE, PINK, RED
from reports.site.page import HERE, Page, save

FILE = "examples.md"
ORDER = (
    "settling_sphere",
    "bouncing_ball",
    "rising_bubble",
    "thousand_particles_in_a_vortex",
    "gridded_flow",
    "ptv_track_with_gaps",
    "fractional_relaxation",
    "stream_in_your_own_loop",
    "new_drag_law",
    "coefficients_for_a_cfd_code",
)  # others follow
FOUND = {path.stem: path for path in sorted((HERE / "examples").glob("*.py"))}
EXAMPLES = [FOUND[name] for name in dict.fromkeys((*ORDER, *FOUND)) if name in FOUND]
OPENING = (
    "Each is a file of 20 to 60 lines that runs as it is, asserts one number against an independent reference, and draws one figure. "
    "Which call suits what you have: [how to choose](how_to_choose.md)."
)
STYLE = LOOK | {"axes.prop_cycle": cycler(color=[BLUE, RED, GREEN, ORANGE, PINK])}


def run(path: Path) -> tuple[Figure, str, str]:
    """An example's figure, the first line of the file and the last that it prints."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # the compiler looks a function's module up
    with contextlib.redirect_stdout(io.StringIO()) as said:
        spec.loader.exec_module(module)
        figure = module.example()
    return figure, str(module.__doc__).split("\n")[0], said.getvalue().strip().split("\n")[-1].replace("e-0", "e-")


def made() -> str:
    """The page, every example run and its figure saved."""
    parts = ["# Examples", OPENING]
    for path in EXAMPLES:
        with mpl.rc_context(STYLE):
            figure, about, number = run(path)
            shown = save(figure, f"example_{path.stem}")
        title = path.stem.replace("_", " ").capitalize().replace("cfd", "CFD").replace("Ptv", "PTV")
        parts += [f"## {title}", about, f"Its number: {number}. The file: [{path.name}](examples/{path.name}).", shown]
    return "\n\n".join(parts)


def cards(text: str) -> list[Page]:
    """The page's parts for index.html, the files with them."""
    found = []
    for part in text.split("\n## ")[1:]:
        title, _, rest = part.partition("\n")
        name = rest.split("](examples/", 1)[1].split(")", 1)[0]
        code = (HERE / "examples" / name).read_text(encoding="utf-8").strip()
        whole = f"# {title}\n{rest.strip()}\n\n<details><summary>{name}</summary>\n\n```python\n{code}\n```\n\n</details>"
        found.append(Page(f"examples-{title.lower().replace(' ', '-')}", lambda data: "", (), whole))
    return found
