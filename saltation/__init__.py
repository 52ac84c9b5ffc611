"""Saltation: sand grains hopping over a river bed, with the history force of `basset`."""

from typing import TYPE_CHECKING

from basset._lazy import face

if TYPE_CHECKING:
    from saltation.front import campaign, run
    from saltation.results.files import open_result as open
    from saltation.results.result import Result
    from saltation.scene import Scene, SceneError, load
    from saltation.study.comparison import compare
    from saltation.study.schemes import select_scheme
else:
    _places = {
        **dict.fromkeys(("campaign", "run"), "front"),
        "Result": "results.result",
        "open": "results.files:open_result",
        **dict.fromkeys(("Scene", "SceneError", "load"), "scene"),
        "compare": "study.comparison",
        "select_scheme": "study.schemes",
    }
    __getattr__, __dir__ = face(__name__, globals(), _places)

__all__ = ["Result", "Scene", "SceneError", "campaign", "compare", "load", "open", "run", "select_scheme"]
