"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

from typing import TYPE_CHECKING

from basset._lazy import face

if TYPE_CHECKING:
    from saltation.campaigns import campaign
    from saltation.result import Result
    from saltation.result import open_result as open
    from saltation.scene import Scene, SceneError, load
    from saltation.simulation import run
else:
    _places = {
        "campaign": "campaigns",
        "Result": "result",
        "open": "result:open_result",
        **dict.fromkeys(("Scene", "SceneError", "load"), "scene"),
        "run": "simulation",
    }
    __getattr__, __dir__ = face(__name__, globals(), _places)

__all__ = ["Result", "Scene", "SceneError", "campaign", "load", "open", "run"]
