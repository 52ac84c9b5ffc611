"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

from saltation.result import Result
from saltation.result import open_result as open  # noqa: A004 - as xarray and io name theirs
from saltation.scene import Scene, SceneError, load
from saltation.simulation import run

__all__ = ["Result", "Scene", "SceneError", "load", "open", "run"]
