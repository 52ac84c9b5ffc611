"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

from saltation.campaigns import campaign
from saltation.result import Result
from saltation.result import open_result as open
from saltation.scene import Scene, SceneError, load
from saltation.simulation import run

__all__ = ["Result", "Scene", "SceneError", "campaign", "load", "open", "run"]
