"""The history integral of given samples: at the last node, or at every node."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset import _validate
from basset.kernels import BassetKernel, Floats, Kernel
from basset.quadrature import Rule, resolve
from basset.quadrature.rule import accept
from basset.streaming import Plan
from basset.streaming.uneven import check_times, trajectory
from basset.weights.table import TABLES, ByteCache, Recipe, filtered_by, step_factor, table
from basset.weights.uneven import HIGHEST, at_node, pieces

_BASSET = BassetKernel()
GAPS = ("raise", "bridge")
LONGEST = 1e300  # s, of a path: the next power of two is still a number
BRIDGE = "; gaps='bridge' leaves them out"
PLANS: ByteCache[Plan] = ByteCache(limit=64 << 20)


def integrate(
    g: ArrayLike, dt: float | None = None, rule: Rule | str = "daitche", kernel: Kernel = _BASSET, initial_slip: ArrayLike = 0.0, input: str = "rate", *,
    t: ArrayLike | None = None, gaps: str = "raise",
) -> Any:  # fmt: skip
    """History integral at the last node, H(t_n) = f(t_0) K(t_n − t_0) + ∫ K(t_n − τ) g(τ) dτ.

    Parameters
    ----------
    g : array_like (n+1, ...)
        Samples at t_0, t_0 + dt, … or at the times `t`: the rate g = df/dt (unit of f per second), or the slip f itself. Any real dtype and
        layout; computed in float64, never modified. n ≥ 1.
    dt : float, seconds
        Step size; None with `t`.
    rule : Rule or str
        The quadrature rule; a name in `basset.SCHEMES` stands for that scheme with its default parameters. With `t`, and across gaps,
        `Daitche(order)` or `Exponential(order, rtol)` of order 1, 2 or 3.
    kernel : Kernel
        The memory kernel K.
    initial_slip : array_like, scalar or (...)
        f(t_0), the jump from rest at t_0, in the unit of f. For slip samples f(t_0) is their first row.
    input : {"rate", "slip"}
        What the samples are. With "slip", H = d/dt ∫K f (thesis eq. 5-8).
    t : array_like (n+1,), seconds
        The times of the samples, if they are not uniform; rising. A time that occurs twice is a jump: its samples are the values before and after;
        for slips their difference is the jump of f, and no polynomial straddles it.
    gaps : {"raise", "bridge"}
        What to do where samples are NaN or masked, in any component. "bridge" leaves them out: a polynomial goes through their neighbours.

    Returns
    -------
    float64 (...)
        H at the last node, unit of f × s^(-1/2); a NumPy scalar for samples of shape (n+1,).

    Raises
    ------
    ValueError, TypeError
        One sentence that names the argument: fewer than two samples, NaN or infinity among the samples that are read,
        dt not positive, times that fall, a window shorter than a step, an initial slip of the wrong shape, an unknown scheme, one that has no form
        for times that are not uniform.

    Notes
    -----
    With times `t` the polynomial of the rule's degree p through neighbouring samples is integrated against K exactly on each panel: error h^(p+1), h
    the longest step. Samples too close to each other are skipped, or the degree is lower there, so that errors of samples are not magnified.

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

    The same with a third of the samples left out at random:

    >>> t = t[np.sort(np.random.default_rng(1).choice(4097, 2800, replace=False))]
    >>> t[[0, -1]] = 0.0, 50.0 * np.pi
    >>> H = basset.integrate(np.cos(t), t=t, rule=basset.Daitche(order=3))
    >>> abs(H - 1.25306020134666323776) < 1e-6
    np.True_
    """
    if t is not None or gaps != "raise":
        found = _at_times(g, dt, t, rule, kernel, initial_slip, input, gaps, last=True)
        if found is not None:
            return found
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
        raise _unfit(samples[n - used :], n - used)
    return result


def cumulate(
    g: ArrayLike, dt: float | None = None, rule: Rule | str = "daitche", kernel: Kernel = _BASSET, initial_slip: ArrayLike = 0.0, input: str = "rate", *,
    t: ArrayLike | None = None, gaps: str = "raise",
) -> Floats:  # fmt: skip
    """History integral at every node, in O(n log n): row k is `integrate(g[:k+1], …)`.

    The convolution is done by FFT without wrap-around, the start-up rows and the oldest samples exactly; its rounding error is
    a few 1e-16 of the largest |H| of the path. With times `t` Daitche's rule takes O(n²), Exponential O(n) times the number of its terms.

    Parameters
    ----------
    g : array_like (n+1, ...)
        As for `integrate`, in the unit of f per second or of f; one sample is enough.
    dt : float, seconds
        Step size; None with `t`.
    rule : Rule or str
        The quadrature rule, as for `integrate`.
    kernel : Kernel
        The memory kernel K.
    initial_slip : array_like, scalar or (...)
        f(t_0), in the unit of f.
    input : {"rate", "slip"}
        What the samples are.
    t : array_like (n+1,), seconds
        The times of the samples, if they are not uniform, as for `integrate`.
    gaps : {"raise", "bridge"}
        What to do where samples are missing, as for `integrate`; times may be missing there too. H is NaN there.

    Returns
    -------
    ndarray of float64, shape of `g`
        H at every node, unit of f × s^(-1/2). Row 0 is K(0) times the initial slip: 0, ±inf, or finite for a bounded kernel; so is the second of two rows
        at one instant where the slip jumps.

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
    >>> t = np.array([0.0, 0.1, 0.5, 0.6, 2.0])  # nonuniform times, a missing sample
    >>> H = basset.cumulate([1.0, 1.0, np.nan, 1.0, 1.0], t=t, rule=basset.Exponential(order=3, rtol=1e-12), gaps="bridge")
    >>> np.allclose(H, [0.0, 2.0 * 0.1**0.5, np.nan, 2.0 * 0.6**0.5, 2.0 * 2.0**0.5], rtol=1e-11, equal_nan=True)
    True
    """
    if t is not None or gaps != "raise":
        found: Floats | None = _at_times(g, dt, t, rule, kernel, initial_slip, input, gaps, last=False)
        if found is not None:
            return found
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
        raise _unfit(samples, 0)
    return _with_start(result, samples[0] if input == "slip" else jump, kernel).reshape(samples.shape)


def _at_times(g: ArrayLike, dt: Any, t: Any, rule: Rule | str, kernel: Kernel, initial_slip: ArrayLike, input: str, gaps: str, last: bool) -> Any:
    """H at every node, or at the last alone, of samples that have times of their own or gaps to be bridged; None where there is no such thing."""
    _validate.choice("gaps", gaps, GAPS)
    if dt is not None and t is not None:
        raise TypeError(f"dt must be left out where t is given, got {_validate.shown(dt)}: the steps are those of t")
    samples, missing = _gaps(g, gaps)
    if t is None and not missing.any():
        return None
    rule = resolve(rule)
    degree, rtol = rule.at_any_times
    if not 1 <= degree <= HIGHEST:
        what = "bridged gaps" if t is None else "samples at nonuniform times"
        raise ValueError(f"rule must be Daitche(order) or Exponential(order, rtol) of order 1, 2 or 3 for {what}, got {_validate.shown(rule)}")
    accept(rule.whole, kernel, input)
    present, kind = samples[~missing], "two samples (one step)" if last else "one sample"
    if len(present) < 1 + last:
        raise ValueError(f"g must hold at least {kind} along its first axis, got {len(present)}")
    if last and missing[-1]:
        raise ValueError(f"the last sample of g must not be missing, the integral is taken there; got a missing one in row {len(samples) - 1}")
    times = _validate.positive("dt", dt, "seconds") * np.flatnonzero(~missing) if t is None else _times(t, missing)
    if not (length := float(times[-1]) - float(times[0])) <= LONGEST:
        raise ValueError(f"{'dt' if t is None else 't'} must make a path of {LONGEST:g} seconds or less, got {length:g}")
    times = times - times[0]
    jump, slip = _initial_slip(initial_slip, present, input), input == "slip"
    columns = np.ascontiguousarray(present).reshape(len(present), -1)
    leaps = np.zeros_like(columns)
    if slip:
        leaps[0] = columns[0]
        leaps[1:][np.diff(times) == 0.0] = np.diff(columns, axis=0)[np.diff(times) == 0.0]
    elif jump is not None:
        leaps[0] = jump.ravel()
    nodes = slice(len(times) - 1, None) if last else slice(None)
    with np.errstate(all="ignore"):
        if rtol:
            history = trajectory(times, columns, degree, rtol, kernel, slip, leaps)[nodes]
        else:
            made = pieces(times, columns, degree, slip, leaps)
            history = np.stack([at_node(made, n, kernel) for n in range(len(times))[nodes]])
        if not np.isfinite(history).all():
            raise _unfit(present, 0)
        history += np.where(leaps[nodes] == 0.0, 0.0, leaps[nodes] * kernel(0.0))
    if last:
        return history.reshape(1, *samples.shape[1:])[0]
    result = np.full(samples.shape, np.nan)
    result[~missing] = history.reshape(present.shape)
    return result


def _gaps(g: ArrayLike, gaps: str) -> tuple[Floats, NDArray[np.bool_]]:
    """Samples, and which of them are missing, wholly or in part: all are refused unless gaps are bridged."""
    samples = _samples(_with_holes(g) if gaps == "bridge" else g)
    missing = np.asarray(np.isnan(samples).any(axis=tuple(range(1, samples.ndim))))
    if (missing.any() and gaps == "raise") or np.isinf(samples).any():
        raise _unfit(samples if gaps == "raise" else np.where(np.isnan(samples), 0.0, samples), 0)
    return samples, missing


def _with_holes(values: ArrayLike) -> ArrayLike:
    """NaN for what is masked."""
    return np.where(np.ma.getmaskarray(values), np.nan, np.asarray(values.data, dtype=np.float64)) if isinstance(values, np.ma.MaskedArray) else values


def _times(t: ArrayLike, missing: NDArray[np.bool_]) -> Floats:
    """The times of the samples that are present."""
    times = _validate.real_array("t", _with_holes(t) if missing.any() else t)
    if times.shape != missing.shape:
        raise ValueError(f"t must have the shape {missing.shape}, one time for each sample of g, got {times.shape}")
    rows = np.flatnonzero(~missing)
    times = times[rows]
    if not np.isfinite(times).all():
        raise _validate.not_finite(times, 0, "t")
    check_times(times, rows)
    return times


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
        raise _unfit(samples, 0)
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
        raise _unfit(samples, 0)
    return history


def _samples(g: ArrayLike) -> Floats:
    try:
        samples = g if type(g) is np.ndarray and g.dtype == np.float64 else _validate.real_array("g", g)
    except _validate.MissingError as error:
        raise _validate.MissingError(f"{error}{BRIDGE}") from None
    if samples.ndim == 0:
        raise ValueError(f"g must be an array of samples along its first axis, got the single number {samples[()]}")
    return samples


def _unfit(samples: Floats, offset: int) -> ValueError:
    """Why the result for these samples is not finite."""
    error = _validate.not_finite(samples, offset)
    return ValueError(f"{error}{BRIDGE}") if str(error).endswith(_validate.FILL) else error


def _checked(g: ArrayLike, dt: float | None, rule: Rule | str, kernel: Kernel, input: str) -> tuple[Floats, float, Rule]:
    samples = _samples(g)
    rule = resolve(rule)
    accept(rule, kernel, input)
    if dt is None:
        raise TypeError("dt must be a finite number greater than 0 (seconds), got None; or t must be given, the times of the samples")
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
