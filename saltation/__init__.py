"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

from typing import TYPE_CHECKING

from basset._lazy import face

if TYPE_CHECKING:
    from saltation.results.result import Result
    from saltation.results.result import open_result as open
    from saltation.scene import Scene, SceneError, load
    from saltation.simulation import run
    from saltation.study.campaigns import campaign
else:
    _places = {
        "campaign": "study.campaigns",
        "Result": "results.result",
        "open": "results.result:open_result",
        **dict.fromkeys(("Scene", "SceneError", "load"), "scene"),
        "run": "simulation",
    }
    __getattr__, __dir__ = face(__name__, globals(), _places)

__all__ = ["Result", "Scene", "SceneError", "campaign", "load", "open", "run"]
