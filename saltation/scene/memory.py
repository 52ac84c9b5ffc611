"""Which history schemes a solver can use; for the others the reason, and the nearest that works."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from basset import _validate

__all__ = ["REASONS", "Refusal", "barred"]

REASONS = {
    "grid": "its weights are for equal steps, and collocation takes graded ones",
    "window": "collocation needs a sum of exponentials from the shortest lags on, and this one begins behind a window",
    "sum": "collocation fits a sum of exponentials of its own",
    "half": "a derivative of order 1/2 has the kernel s^(-1/2), and kernels of finite Reynolds numbers differ from it",
    "published": "its published coefficients were fitted to s^(-1/2), and kernels of finite Reynolds numbers differ from it",
}
FLOWN: dict[str, Any] = {"solver.method": "fixed_step", "solver.dt": 1e-3}


@dataclass(frozen=True)
class Refusal:
    """Which field is refused, the key of its reason, and alternatives that work, each as field -> value; None: left out."""

    field: str
    reason: str
    instead: list[dict[str, Any]]

    def __str__(self) -> str:
        """One sentence."""
        return f"{self.field}: {REASONS[self.reason]}: take {'; or '.join(map(_written, self.instead))}"


def _written(changes: dict[str, Any]) -> str:
    given = " and ".join(f"{name} = {value!r}" for name, value in changes.items() if value is not None)
    out = " and ".join(name for name, value in changes.items() if value is None)
    return f"{given} without {out}" if out else given


def barred(options: Any, method: str) -> Refusal | None:
    """Why a method cannot use the table [history]; None where it can."""
    rule = options.rule or "daitche" if options.scheme == "windowed" else options.scheme
    varies = options.kernel != "basset"
    half = varies and rule == "semi_derivative"
    own = options.scheme == "hinsberg" and options.window is not None and options.tail is not False
    published = varies and (own or (options.scheme == "windowed" and str(options.tail).startswith(("casas", "van_hinsberg"))))
    given = [name for name in ("rule", "window", "tail") if getattr(options, name) is not None]
    name = f"history.kernel = {options.kernel!r} with " if varies else "history."
    if method == "collocation":
        if options.scheme == "exponential" and not given:
            return None
        beside = [name for name in ("order", "rtol") if getattr(options, name) is not None]  # of fixed steps
        plain: dict[str, Any] = {"history.scheme": "exponential", **{f"history.{word}": None for word in [*given, *beside]}}
        if varies and options.slip_at == "tau":
            plain["history.slip_at"] = "t"
        instead = [plain] if half or published else [plain, FLOWN]
        tail = own or options.tail not in (None, False)
        reason = "grid" if not tail else "sum" if options.tail == "fitted" else "window"
        field = f"history.scheme = {options.scheme!r}" if options.scheme != "exponential" else f"history.{given[0]}"
        return Refusal(field, reason, instead)
    if not (half or published):
        return None
    changes: dict[str, Any] = {}
    if half:
        changes["history.rule" if options.scheme == "windowed" else "history.scheme"] = "daitche"
    if own:
        changes |= {"history.scheme": "windowed", "history.rule": "daitche", "history.order": 1}
    if published:
        changes["history.tail"] = "fitted"
    what = f"scheme = {options.scheme!r}" if options.scheme != "windowed" else f"rule = {rule!r}" if half else f"tail = {_validate.shown(options.tail)}"
    return Refusal(name + what, "half" if half else "published", [changes, {"history.kernel": "basset"}])
