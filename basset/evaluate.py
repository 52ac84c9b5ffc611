"""The history integral of given samples: at the last node, or at every node."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel
from basset.quadrature import Rule, resolve
from basset.quadrature.rule import accept
from basset.streaming import Plan
from basset.weights.table import TABLES, ByteCache, Recipe, filtered_by, step_factor, table

_BASSET = BassetKernel()
PLANS: ByteCache[Plan] = ByteCache(limit=64 << 20)


def integrate(g: ArrayLike, dt: float, rule: Rule | str, kernel: Kernel = _BASSET, initial_slip: ArrayLike = 0.0, input: str = "rate") -> Any:
    """History integral at the last node, H(t_n) = f(t_0) K(t_n − t_0) + ∫ K(t_n − τ) g(τ) dτ.

    Parameters
    ----------
    g : array_like (n+1, ...)
        Samples at t_0, t_0 + dt, …: the rate g = df/dt (unit of f per second), or the slip f itself. Any real dtype and layout;
        computed in float64, never modified. n ≥ 1.
    dt : float, seconds
        Step size.
    rule : Rule or str
        How to integrate; a name in `basset.SCHEMES` stands for that scheme with its default parameters.
    kernel : Kernel
        The memory kernel K.
    initial_slip : array_like, scalar or (...)
        f(t_0), the jump from rest at t_0, in the unit of f. For slip samples f(t_0) is their first row.
    input : {"rate", "slip"}
        What the samples are. With "slip", H = d/dt ∫K f (thesis eq. 5-8).

    Returns
    -------
    float64 (...)
        H at the last node, unit of f × s^(-1/2); a NumPy scalar for samples of shape (n+1,).

    Raises
    ------
    ValueError, TypeError
        One sentence that names the argument: fewer than two samples, NaN or infinity among the samples that are read,
        dt not positive, a window shorter than a step, an initial slip of the wrong shape, an unknown scheme.

    References
    ----------
    Basset (1888), A Treatise on Hydrodynamics, vol. 2; the initial slip and the form for slips: thesis eq. 5-8. The sum that
    stands for the integral: `rule.references`.

    Examples
    --------
    The test integral of the thesis, f' = cos on [0, 50π]:

    >>> import numpy as np, basset
    >>> t = np.linspace(0.0, 50.0 * np.pi, 4097)
    >>> H = basset.integrate(np.cos(t), t[1], basset.Daitche(order=8))
    >>> abs(H - 1.25306020134666323776) < 5e-15
    np.True_
    """
    samples, dt, rule = _checked(g, dt, rule, kernel, input)
    n = len(samples) - 1
    if n < 1:
        raise ValueError(f"g must hold at least two samples (one step) along its first axis, got {len(samples)}")
    jump = _initial_slip(initial_slip, samples, input)
    recipe = _recipe(rule, dt, n, kernel)
    if recipe.tail is not None:
        return _streamed(samples, dt, recipe, kernel, jump)[-1]
    used = recipe.used(n)
    weights = table(recipe.stencil, kernel.scaled(dt), input)
    oldest, body = weights.row(used)
    split = n - used + len(oldest)
    factor = step_factor(dt, input)
    with np.errstate(all="ignore"):
        if samples.ndim == 1:
            result = factor * (np.dot(oldest, samples[n - used : split]) + np.dot(body, samples[split:]))
        else:
            columns = samples.reshape(n + 1, -1)
            result = factor * (oldest @ columns[n - used : split] + body @ columns[split:])
            result = result.reshape(samples.shape[1:])
        if used < n and input == "slip":
            result = result - float(kernel(used * dt)) * samples[n - used]
        if jump is not None and used == n:
            result = result + jump * float(kernel(n * dt))
    if weights.grown:
        weights.grown = False
        TABLES.trim()
    if not np.isfinite(result).all():
        raise _validate.not_finite(samples[n - used :], n - used)
    return result


def cumulate(g: ArrayLike, dt: float, rule: Rule | str, kernel: Kernel = _BASSET, initial_slip: ArrayLike = 0.0, input: str = "rate") -> Floats:
    """History integral at every node, in O(n log n): row k is `integrate(g[:k+1], …)`.

    The convolution is done by FFT without wrap-around, the start-up rows and the oldest samples exactly; its rounding error is
    a few 1e-16 of the largest |H| of the path.

    Parameters
    ----------
    g : array_like (n+1, ...)
        As for `integrate`, in the unit of f per second or of f; one sample is enough.
    dt : float, seconds
        Step size.
    rule : Rule or str
        How to integrate.
    kernel : Kernel
        The memory kernel K.
    initial_slip : array_like, scalar or (...)
        f(t_0), in the unit of f.
    input : {"rate", "slip"}
        What the samples are.

    Returns
    -------
    ndarray of float64, shape of `g`
        H at every node, unit of f × s^(-1/2). Row 0 is K(0) times the initial slip: 0, ±inf, or finite for a bounded kernel.

    Raises
    ------
    ValueError, TypeError
        As `integrate`.

    References
    ----------
    As `integrate`: Basset (1888), A Treatise on Hydrodynamics, vol. 2; thesis eq. 5-8.

    Examples
    --------
    >>> import numpy as np, basset
    >>> H = basset.cumulate(np.ones(5), 0.25, basset.Daitche(order=1))  # f' = 1: H = 2√t
    >>> np.allclose(H, 2.0 * np.sqrt(0.25 * np.arange(5)), rtol=1e-14)
    True
    """
    samples, dt, rule = _checked(g, dt, rule, kernel, input)
    if len(samples) < 1:
        raise ValueError("g must hold at least one sample along its first axis, got 0")
    n = len(samples) - 1
    jump = _initial_slip(initial_slip, samples, input)
    recipe = _recipe(rule, dt, max(1, n), kernel)
    if recipe.tail is not None:
        return _with_start(_streamed(samples, dt, recipe, kernel, jump), jump, kernel)
    used, columns = recipe.used(n), samples.reshape(n + 1, -1)
    weights = table(recipe.stencil, kernel.scaled(dt), input)
    with np.errstate(all="ignore"):
        if used == n:
            result = weights.trajectory(columns)
        else:
            result = np.empty_like(columns)
            result[: used + 1] = weights.trajectory(columns[: used + 1])
            row = np.concatenate(weights.row(used))
            if input == "slip":
                row[0] -= kernel.scaled(dt)._values(np.array([float(used)]))[0]
            result[used + 1 :] = filtered_by(row, columns[1:])
        result *= step_factor(dt, input)
        if jump is not None:
            lags = dt * np.arange(1, used + 1)
            result[1 : used + 1] += kernel._values(lags)[:, None] * jump.ravel()
    TABLES.trim()
    if not np.isfinite(result).all():
        raise _validate.not_finite(samples, 0)
    return _with_start(result, samples[0] if input == "slip" else jump, kernel).reshape(samples.shape)


def _with_start(history: Floats, slip: Floats | None, kernel: Kernel) -> Floats:
    """Row 0: what the initial slip adds there, infinite as a rule."""
    if slip is not None:
        with np.errstate(invalid="ignore"):
            history[0] = np.where(slip == 0.0, 0.0, slip * kernel(0.0)).reshape(history.shape[1:])
    return history


@lru_cache(maxsize=128)
def _recipe(rule: Rule, dt: float, steps: int, kernel: Kernel) -> Recipe:
    return rule.recipe(dt, steps * dt, kernel)


def _streamed(samples: Floats, dt: float, recipe: Recipe, kernel: Kernel, jump: Floats | None) -> Floats:
    """H at every node by streaming: for rules whose far memory is a sum of exponentials."""
    if not np.isfinite(samples).all():
        raise _validate.not_finite(samples, 0)
    steps = max(1, len(samples) - 1)
    plan = PLANS.get((recipe, dt, steps, kernel), lambda: Plan(recipe.within(steps), dt, steps, kernel))
    PLANS.trim()
    columns = samples.reshape(len(samples), -1)
    with np.errstate(all="ignore"):
        history = plan.trajectory(columns)
        if jump is not None:
            history[1:] += plan.kernel_used(len(samples) - 1)[:, None] * jump.ravel()
    history = history.reshape(samples.shape)
    if not np.isfinite(history).all():
        raise _validate.not_finite(samples, 0)
    return history


def _checked(g: ArrayLike, dt: float, rule: Rule | str, kernel: Kernel, input: str) -> tuple[Floats, float, Rule]:
    samples = g if type(g) is np.ndarray and g.dtype == np.float64 else _validate.real_array("g", g)
    if samples.ndim == 0:
        raise ValueError(f"g must be an array of samples along its first axis, got the single number {samples[()]}")
    rule = resolve(rule)
    accept(rule, kernel, input)
    return samples, _validate.positive("dt", dt, "seconds"), rule


def _initial_slip(value: ArrayLike, samples: Floats, input: str) -> Floats | None:
    """The initial slip in the shape of one sample; None for none."""
    if type(value) is float and value == 0.0:
        return None
    slip = _validate.real_array("initial_slip", value)
    if not np.isfinite(slip).all():
        raise ValueError(f"initial_slip must be finite, got {_validate.shown(value)}")
    if slip.ndim and slip.shape != samples.shape[1:]:
        raise ValueError(f"initial_slip must be a number or have the shape {samples.shape[1:]} of one sample, got shape {slip.shape}")
    if not slip.any():
        return None
    if input == "slip":
        raise ValueError(f"initial_slip must be left at 0 with input='slip', where the first sample is the initial slip; got {_validate.shown(value)}")
    return np.broadcast_to(slip, samples.shape[1:])
