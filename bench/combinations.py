"""Every scheme of the history with every kernel and solver: what a scene accepts, and why it refuses the rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from basset.quadrature import full_history
from bench.grains import at_fixed_steps, base, changed
from saltation.scene import SceneError, scene_of

RULES = full_history()
KERNELS = ("basset", "mei_adrian", "dorgan_loth")
METHODS = ("collocation", "fixed_step", "runge_kutta_4")
WINDOW, BEFORE_TAIL = 1.0, 0.25  # d/u*: longer than the first jump of sand; well within it
TAILS = {"van_hinsberg": "van Hinsberg's tail", "casas": "Casas's tail", "fitted": "a fitted tail"}
DT, HORIZON = 1e-3, 100.0  # d/u*

Content = dict[str, Any]


class Combination(NamedTuple):
    """A form of the history (a scheme, and what it remembers), a kernel, a solver."""

    form: str
    history: Content
    kernel: str
    method: str

    def scene(self, dt: float = DT, jumps: int = 1, rtol: float = 1e-7) -> Content:
        """The sand scene with it; at fixed steps of `dt` d/u*."""
        content = changed(base("sand", jumps, 0), history={"rebound": "impulse", "horizon": HORIZON})
        history = {**self.history, "kernel": self.kernel}
        if self.method == "collocation":
            return changed(content, history=history, solver={"rtol": rtol})
        return at_fixed_steps(content, self.method, dt, jumps, history)


def forms() -> dict[str, Content]:
    """By what a reader calls them: fields of [history]."""
    found: dict[str, Content] = {}
    for rule in RULES:
        found |= {f"{rule}, whole past": {"scheme": rule}, f"{rule}, a window in time": {"scheme": "windowed", "rule": rule, "window": WINDOW}}
        found[f"{rule}, a window in jumps"] = {"scheme": rule, "window_jumps": 1}
        found |= {f"{rule}, {name}": {"scheme": "windowed", "rule": rule, "window": BEFORE_TAIL, "tail": tail} for tail, name in TAILS.items()}
    found |= {"hinsberg, whole past": {"scheme": "hinsberg"}, "hinsberg, its own tail": {"scheme": "hinsberg", "window": BEFORE_TAIL}}
    found["hinsberg, a window in time"] = {"scheme": "hinsberg", "window": WINDOW, "tail": False}
    return found | {"exponential": {"scheme": "exponential"}, "exponential, a window in jumps": {"scheme": "exponential", "window_jumps": 1}}


def combinations() -> Iterator[Combination]:
    """All of them."""
    for form, history in forms().items():
        for kernel in KERNELS:
            for method in METHODS:
                yield Combination(form, history, kernel, method)


def refusal(one: Combination) -> str:
    """What a scene says to it; nothing where it is accepted."""
    try:
        scene_of(one.scene())
    except SceneError as error:
        return str(error)
    return ""


def rows() -> list[Content]:
    """The table, ready for JSON: form, and what is said for each kernel and method."""
    found: dict[str, Content] = {}
    for one in combinations():
        found.setdefault(one.form, {"form": one.form})[f"{one.kernel}, {one.method}"] = refusal(one)
    return list(found.values())
