"""What is simulated: a scene in TOML, validated, in SI units."""

from saltation.scene.model import AUTO as AUTO
from saltation.scene.model import LONGEST as LONGEST
from saltation.scene.model import Bed, Channel, Cloud, Fluid, Grain, Run, Scene, SceneBase, SceneError, Solver, Start, load, scene_of, shipped
from saltation.scene.model import Chosen as Chosen
from saltation.scene.model import read as read

__all__ = ["Bed", "Channel", "Cloud", "Fluid", "Grain", "Run", "Scene", "SceneBase", "SceneError", "Solver", "Start", "load", "scene_of", "shipped"]
