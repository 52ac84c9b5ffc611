"""Graded collocation: high order through every jump, the past in a sum of exponentials.

After a jump the solution is a series in √(t − t_j). The first step after a jump (and the first of all) is *singular*: a
polynomial in σ = √θ, θ = (t − t_n)/h. All others are *regular*: y' is a polynomial in θ through the Radau IIA nodes. Steps
grow geometrically away from a jump, so the singularity is resolved at a geometric rate and the number of stages sets the accuracy.
Inside a step the history is integrated exactly; what happened before it is in the exponentials, whose moments over a step
are exact too, and a jump is added to them in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from basset import _validate
from basset.solvers.base import Method, Task, Trace


@dataclass(frozen=True)
class Collocation(Method):
    """Graded Radau collocation whose error control holds through jumps.

    Parameters
    ----------
    rtol, atol : float, dimensionless and in the unit of y; atol None: rtol/1000
        Tolerances of the local error, per component: atol + rtol·|y|. rtol 1e-12 to 0.1.
    stages : int or None
        Radau nodes per step, 2 to 14; None: chosen from rtol.
    max_step : float or None, seconds
        The largest step; None: the time span.

    Raises
    ------
    ValueError, TypeError
        If a parameter is out of range.

    Notes
    -----
    The kernel's sum of exponentials is fitted to a tenth of rtol, for lags from 1e-12 of the time span on (with jumps, or
    when a slip fades within 1e-5 of it) or from 1e-10 on; where that is impossible, to the best tabulated accuracy.
    Memory per component does not grow with time or with the number of jumps. Stages are solved by Newton's method: stiff
    drag is no obstacle. The time loop is compiled once for all equations; `fun`, event functions and jumps that are compiled
    (numba.njit) run without Python from start to end, Python functions are called back.

    References
    ----------
    Brunner (2004), Collocation Methods for Volterra Integral and Related Functional Differential Equations
    (graded meshes); Hairer & Wanner (1996), Solving Ordinary Differential Equations II (Radau IIA).

    Examples
    --------
    >>> import basset
    >>> from basset import reference
    >>> r = basset.solve(lambda t, y: -y, (0.0, 1.0), [1.0], coefficient=0.6, method=Collocation(rtol=1e-6))
    >>> bool(abs(r.y[0, -1] - reference.relaxing(1.0, 1.0, 0.6)) < 1e-6)
    True
    """

    rtol: float = 1e-6
    atol: float | None = None
    stages: int | None = None
    max_step: float | None = None

    _follows_slip: ClassVar[bool] = True
    references: ClassVar[tuple[str, ...]] = (
        "Brunner (2004), Collocation Methods for Volterra Integral and Related Functional Differential Equations",
        "Hairer & Wanner (1996), Solving Ordinary Differential Equations II",
    )

    def __post_init__(self) -> None:
        rtol = _validate.positive("rtol", self.rtol)
        if not 1e-12 <= rtol <= 0.1:
            raise ValueError(f"rtol must be from 1e-12 to 0.1, got {_validate.apart(rtol, 0.1 if rtol > 0.1 else 1e-12)[0]}")
        object.__setattr__(self, "rtol", rtol)
        object.__setattr__(self, "atol", 1e-3 * rtol if self.atol is None else _validate.non_negative("atol", self.atol))
        if self.stages is not None:
            object.__setattr__(self, "stages", _validate.integer("stages", self.stages, 2, 14))
        if self.max_step is not None:
            object.__setattr__(self, "max_step", _validate.positive("max_step", self.max_step, "seconds"))

    def _integrate(self, task: Task, trace: Trace) -> None:
        from basset.solvers._graded import integrate  # loads the compiler

        integrate(self, task, trace)
