"""The history as a stream: one sample at a time, in constant memory where the rule allows it.

A `Plan` holds everything that depends on rule, step and kernel; a `State` holds what depends on the samples, as plain
arrays that belong to the caller. H at the next node is affine in the next sample: tail + local·g.

Within one smooth segment of the signal a stream applies, at node n,

* for n < steady: the whole-history row n;
* from then on: fixed weights on the newest L+1 samples and, where there is a sum of exponentials, one number per
  exponential that decays and takes in the sample of lag L.

The second form is exact: a panel that leaves the window adds Σ_q C_q z^q to an exponential (its polynomial, integrated
against e^(−λs)), and Σ_q C_q z^q/(1 − d z) = polynomial(z) + r z^p/(1 − d z), the polynomial being part of the fixed
weights. A jump ends a segment: no polynomial straddles it. What the finished segment still adds before all of it is in
the exponentials is computed at the jump and kept in a short ring of future contributions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from basset import _validate
from basset.exponentials import ExponentialSum
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.streaming.jumps import WithJumps
from basset.streaming.state import Array, AtNewest, State, Tables, beyond, block_of, owned, sample_of, shaped
from basset.weights.lagrange import lagrange
from basset.weights.table import TABLES, Recipe, WeightTable, filtered_by, table

LONG_WINDOW = 256  # from here on a whole path is convolved by FFT


class Plan(AtNewest, WithJumps):
    """A rule made ready to stream with one step size; create it with `rule.plan(dt, horizon, kernel)`.

    Parameters
    ----------
    recipe : basset.weights.Recipe
        What the rule does at that step size.
    dt : float, seconds
        Step size.
    steps : int
        Of the longest time that will be remembered.
    kernel : Kernel
        The memory kernel K.

    Attributes
    ----------
    recipe, dt, kernel : as given
    steps : int or None
        How many steps after the first sample are allowed; None without limit.
    tail_sum : ExponentialSum or None
        The sum that stands for the kernel beyond the window.

    Raises
    ------
    ValueError, TypeError
        As `Rule.plan`.

    References
    ----------
    van Hinsberg, ten Thije Boonkkamp & Clercx (2011), J. Comput. Phys. 230, 1465 (recursion); the exact split and the jumps:
    this library.

    Examples
    --------
    >>> import numpy as np, basset
    >>> plan = basset.Daitche(order=1).plan(dt=0.25, horizon=1.0)
    >>> state = plan.start()
    >>> for _ in range(4):
    ...     plan.push(state, 1.0)  # f' = 1: H = 2√t
    >>> round(plan.value(state), 12) == round(2.0 * math.sqrt(0.75), 12)
    True
    >>> round(plan.tail(state) + plan.local(state) * 1.0, 12)  # H at the next node, if its rate is 1
    2.0
    >>> plan.jump(state, 3.0)  # f jumps by 3 at the newest node: 3 K(0.25) = 6 more there
    >>> round(plan.tail(state) + plan.local(state) * 1.0, 12)
    8.0
    >>> np.allclose(plan.weights(2), basset.Daitche(order=1).weights(2, 0.25))
    True
    """

    def __init__(self, recipe: Recipe, dt: float, steps: int, kernel: Kernel) -> None:
        self.recipe, self.dt, self.kernel, self.tail_sum = recipe, dt, kernel, recipe.tail
        self.unit = kernel.scaled(dt)
        endless = recipe.window is not None and (recipe.tail is None or math.isinf(recipe.tail.far))
        self.steps = None if endless else steps
        self.rates = self.tail_weights = np.empty(0)
        self.fixed_terms = np.empty((0, 0))
        weights, root = table(recipe.stencil, self.unit, "rate"), math.sqrt(dt)
        fixed: Floats = np.empty(0)
        entering: list[Floats] = [np.empty(0), np.empty(0), np.empty((0, 0))]  # loss, gains, entry
        if recipe.window is None:
            slots = steady = self.ring = steps + 1
        elif recipe.tail is None:
            slots, steady, self.ring = recipe.window + 1, recipe.window, recipe.window + 1
            fixed = root * np.concatenate(weights.row(recipe.window))
        else:
            slots, self.ring = recipe.lags + 1, recipe.window + 1
            steady, fixed, *entering = self._split_tail(recipe.window, recipe.tail)
        arrays = (*self._rows(weights, steady), fixed, *entering)
        short, oldest, interior, *rest = (np.ascontiguousarray(array, dtype=np.float64) for array in arrays)
        self.tables = Tables(slots, short, oldest, interior, steady, *rest)
        TABLES.trim()

    def _rows(self, weights: WeightTable, steady: int) -> tuple[Floats, Floats, Floats]:
        """(short, oldest, interior) of whole-history rows below node `steady`, for the step."""
        stencil, root = self.recipe.stencil, math.sqrt(self.dt)
        first, reach = stencil.first, stencil.reach
        rows = min(first, steady)
        short = np.zeros((rows, rows))
        for n in range(1, rows):
            short[n, : n + 1] = root * weights.row(n)[0]
        oldest: Floats = np.empty((0, reach))
        if steady > first:
            near = int(min(steady - 1, stencil.far - 1))
            oldest = weights.oldest_rows(near)
            if steady - 1 > near:
                oldest = np.concatenate([oldest, stencil.oldest_sum(near + 1, steady - 1, np.eye(reach), self.unit, "rate")])
        return short, root * oldest, root * weights.interior(max(steady - reach, 0))

    def _split_tail(self, window: int, tail: ExponentialSum) -> tuple[int, Floats, Floats, Floats, Floats]:
        """(steady, fixed weights oldest first, loss, gains, entry matrix) of a window followed by a sum of exponentials."""
        degree, lags, root = max(1, self.recipe.degree), self.recipe.lags, math.sqrt(self.dt)
        centre, steady = degree // 2, max(degree + 1, lags - 1)
        self.rates = rates = tail.rates * self.dt
        self.tail_weights = amplitude = tail.weights * root
        # a panel's polynomial against e^(−λs), from the panel's near end on: (position in stencil, term, sample)
        x, w = gauss_legendre(64)
        decayed = np.exp(-rates[:, None] * x) * w
        nodes = np.arange(degree + 1.0)
        moments = np.stack([decayed @ lagrange(nodes, o + x)[0] for o in range(degree)])
        leaving = amplitude[:, None] * np.exp(-rates * window)[:, None] * moments[centre]  # (term, sample), newest first
        quotient = leaving.copy()
        for q in range(1, degree + 1):
            quotient[:, q] += np.exp(-rates) * quotient[:, q - 1]
        self.fixed_terms = root * quotient[:, :degree]
        local = self.recipe.stencil.inside(window, lags, self.unit)
        start = window - centre
        local[start : start + degree] += quotient[:, :degree].sum(axis=0)
        entry = np.zeros((len(rates), steady + 1))  # newest first until the end
        for k in range(window, steady):
            first = min(max(k - centre, 0), steady - degree)
            panel = amplitude[:, None] * np.exp(-rates * k)[:, None] * moments[k - first]
            entry[:, first : first + degree + 1] += panel
        entry[:, start : start + degree] -= quotient[:, :degree]
        newest = min(start, steady - degree)  # the smallest lag that is touched
        return steady, root * local[::-1], -np.expm1(-rates), root * quotient[:, degree], root * entry[:, : newest - 1 : -1]

    @property
    def nbytes(self) -> int:
        """Bytes that the plan holds, without its states."""
        return sum(array.nbytes for array in self.tables if isinstance(array, np.ndarray))

    # ------------------------------------------------------------------------------------------------ the stream

    def start(self, shape: tuple[int, ...] | int = ()) -> State:
        """An empty state for samples of that shape.

        Parameters
        ----------
        shape : tuple of int or int
            Shape of one sample: () for one number, (n, 3) for n grains in space.

        Returns
        -------
        State

        Raises
        ------
        ValueError, TypeError
            If the shape is not made of whole numbers of 0 or more.
        """
        shape, components = shaped(shape)
        samples, terms, future = (np.zeros((components, width)) for width in self._widths.values())
        return State(samples, terms, future, np.zeros(shape), np.zeros(3))

    def push(self, state: State, g: ArrayLike) -> None:
        """Accept the next sample, in place.

        Parameters
        ----------
        state : State
            Changed in place.
        g : array_like, shape of one sample, unit of f per second
            The rate df/dt at the next node.

        Raises
        ------
        ValueError, TypeError
            If the sample has another shape or is not finite, or the horizon is exceeded; the state is then unchanged.
        """
        self._own(state)
        self.run(state, sample_of("g", g, state.history.shape)[None])

    def run(self, state: State, G: ArrayLike) -> Array:
        """Accept a block of samples, in place, and return H at each of them; one entry into compiled code.

        Parameters
        ----------
        state : State
            Changed in place.
        G : array_like (steps, *shape), unit of f per second
            Rates df/dt at the next nodes.

        Returns
        -------
        ndarray of float64 (steps, *shape), unit of f × s^(-1/2)

        Raises
        ------
        ValueError, TypeError
            As `push`; the state is then unchanged.

        Examples
        --------
        >>> import basset
        >>> plan = basset.Daitche(order=1).plan(dt=0.25, horizon=1.0)
        >>> plan.run(plan.start(2), np.ones((5, 2)))[-1].round(12)  # f' = 1: 2√t
        array([2., 2.])
        """
        from basset.streaming import _loops

        self._own(state)
        shape = state.history.shape
        rates = block_of(G, shape)
        count, node, pending = (int(counter) for counter in state.counters)
        steps = len(rates)
        if self.steps is not None and node + steps > self.steps + 1:
            raise beyond(self.steps, self.dt, node + steps - 1)
        rates = np.ascontiguousarray(rates).reshape(steps, state.history.size)
        if not np.isfinite(rates).all():
            raise _validate.not_finite(rates, 0, "G")
        history = np.empty_like(rates)
        _loops.run(state.samples, state.terms, state.future, count, node, pending, rates, history, *self.tables)
        if steps:
            state.history[...] = history[-1].reshape(shape)
        state.counters[:] = count + steps, node + steps, max(0, pending - steps)
        return history.reshape(steps, *shape)

    def tail(self, state: State) -> Any:
        """The part of H at the next node that does not depend on the next sample, shape of one sample: H = tail + local·g.

        Parameters
        ----------
        state : State

        Returns
        -------
        float64, shape of one sample, unit of f × s^(-1/2)

        Raises
        ------
        ValueError, TypeError
            If the state is another plan's, or the horizon is reached.
        """
        from basset.streaming import _loops

        self._room(state)
        count, node, pending = (int(counter) for counter in state.counters)
        result = np.zeros(state.history.size)
        if count == 0:
            return result.reshape(state.history.shape) if state.history.ndim else 0.0
        _loops.peek(state.samples, state.terms, state.future, count, node, pending, *self.tables, result)
        return result.reshape(state.history.shape) if state.history.ndim else float(result[0])

    def local(self, state: State) -> float:
        """The factor of the next sample in H at the next node; errors as `tail`.

        Parameters
        ----------
        state : State
            Of this plan.

        Returns
        -------
        float, s^(1/2)
        """
        self._room(state)
        n, tables = int(state.counters[0]), self.tables
        if n == 0:
            return 0.0
        if n >= tables.steady:
            return float(tables.fixed[-1])
        if n < len(tables.short):
            return float(tables.short[n, n])
        return float(tables.interior[-1])

    @property
    def _widths(self) -> dict[str, int]:
        """Second dimensions of a state's arrays."""
        samples = self.tables.slots if self.recipe.window is None else 2 * self.tables.slots
        return {"samples": samples, "terms": len(self.rates), "future": self.ring}

    def _own(self, state: State) -> None:
        owned(state, State, self._widths)

    def _room(self, state: State) -> None:
        self._own(state)
        node = int(state.counters[1])
        if self.steps is not None and node > self.steps:
            raise beyond(self.steps, self.dt, node)

    def jump(self, state: State, delta: ArrayLike, age: float = 0.0, g: ArrayLike | None = None) -> None:
        """Remember a jump of f, in place: it adds delta·K from the next node on (from this one on if age > 0).

        Parameters
        ----------
        state : State
            With at least one sample; changed in place.
        delta : array_like, number or shape of one sample, unit of f
            f after minus f before.
        age : float, seconds
            The jump lies this long before the newest node: 0 is at the node, other values need not be whole steps. Jumps
            with g within one step are given in the order of time.
        g : array_like, shape of one sample, or None; unit of f per second
            The rate after the jump, at the newest node; None if the rate is continuous. With g the smooth segment ends at
            the jump: older samples keep their polynomial up to it (extended for age > 0, where the rate after the jump is
            taken as constant up to the node), a new segment starts with g, and no stencil straddles the jump. Rules of
            first order or less average the two rates at the node instead. Then age must not exceed dt.

        Raises
        ------
        ValueError, TypeError
            If there is no sample yet, a shape is wrong, a number is not finite, age is negative or reaches back more than
            one step before the first sample, or exceeds dt where g is given.
        """
        self._own(state)
        self._take_jump(state, delta, age, g)

    def trajectory(self, rates: Floats) -> Floats:
        """H at every node of one segment for rates (nodes, components): `run` in O(n log n), by FFT where the window is long.

        Parameters
        ----------
        rates : ndarray (nodes, components), unit of f per second

        Returns
        -------
        ndarray (nodes, components), unit of f × s^(-1/2)

        Examples
        --------
        >>> import basset
        >>> plan = basset.Exponential().plan(dt=0.01, horizon=10.0)
        >>> plan.trajectory(np.ones((401, 1)))[-1].round(4)  # f' = 1: 2√t
        array([4.])
        """
        from basset.streaming import _loops

        count, steady, root = len(rates), self.tables.steady, math.sqrt(self.dt)
        if self.tail_sum is None or steady < LONG_WINDOW or count <= steady:
            return self.run(self.start((rates.shape[1],)), rates)
        *_, fixed, loss, gains, entry = self.tables  # steady = lags − 1: only lag `lags` is missing at node steady
        result = np.empty_like(rates)
        result[:steady] = root * table(self.recipe.stencil, self.unit, "rate").trajectory(rates[:steady])
        result[steady:] = filtered_by(fixed, np.concatenate([np.zeros((1, rates.shape[1])), rates]))
        terms = np.ascontiguousarray((entry @ rates[: entry.shape[1]]).T)
        result[steady] += terms.sum(axis=1)
        _loops.follow(terms, loss, gains, np.ascontiguousarray(rates[: count - steady - 1]), result[steady + 1 :])
        return result

    def kernel_used(self, count: int) -> Floats:
        """The kernel that the stream applies: with the sum, or 0, beyond the window.

        Parameters
        ----------
        count : int
            How many lags: dt … count·dt.

        Returns
        -------
        ndarray (count,), s^(-1/2)

        Examples
        --------
        >>> import basset
        >>> basset.Windowed(basset.Daitche(1), window=2.0).plan(dt=1.0, horizon=9.0).kernel_used(3).round(4)
        array([1.    , 0.7071, 0.    ])
        """
        lags = np.arange(1.0, count + 1.0)
        result = self._excess(lags)
        for weight, rate in zip(self.tail_weights, self.rates, strict=True):
            result += weight * np.exp(-rate * lags)
        return np.asarray(result / math.sqrt(self.dt))

    # ------------------------------------------------------------------------------------------------ as weights

    def weights(self, n: int) -> Array:
        """Weights of H at node n of one segment, newest first: what the stream applies.

        Parameters
        ----------
        n : int
            1 to the number of steps in the horizon.

        Returns
        -------
        ndarray (n+1,), s^(1/2)

        Raises
        ------
        ValueError, TypeError
            If n is out of range.
        """
        n = _validate.integer("n", n, 1, self.steps)
        slots, short, oldest, interior, steady, fixed, _, gains, entry = self.tables
        result = np.zeros(n + 1)
        if n < len(short):
            result[:] = short[n, n::-1]
        elif n < steady:
            reach = oldest.shape[1]
            result[n + 1 - reach :] = oldest[n - len(short), ::-1]
            result[: n + 1 - reach] = interior[::-1][: n + 1 - reach]
        else:
            lags = slots - 1
            held = min(n, lags) + 1
            result[:held] = fixed[::-1][:held]
            first = (np.exp(-self.rates * (n - steady)) @ entry)[::-1]  # the oldest samples
            result[n + 1 - len(first) :] += first
            ages = np.arange(n - steady)  # what entered since, through the gains
            for low in range(0, len(ages), 4096):
                part = ages[low : low + 4096]
                result[lags + part] += np.exp(-part[:, None] * self.rates) @ gains
        return result
