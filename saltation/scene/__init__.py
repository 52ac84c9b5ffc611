"""What is simulated: a scene in TOML, validated, in SI units."""

from saltation.scene.model import AUTO as AUTO
from saltation.scene.model import LONGEST as LONGEST
from saltation.scene.model import Scene, SceneBase, load, scene_of, shipped
from saltation.scene.model import read as read
from saltation.scene.tables import Bed, Channel, Chosen, Cloud, Coupling, Fluid, Grain, Rests, Run, SceneError, Settled, Solver, Start

__all__ = [
    "Bed", "Channel", "Chosen", "Cloud", "Coupling", "Fluid", "Grain", "Rests", "Run", "Scene", "SceneBase", "SceneError", "Settled", "Solver", "Start", "load",
    "scene_of", "shipped",
]  # fmt: skip
