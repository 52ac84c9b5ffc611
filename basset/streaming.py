"""The history as a stream: one sample at a time, in constant memory where the rule allows it.

A `Plan` holds everything that depends on rule, step and kernel; a `State` holds what depends on the samples, as plain
arrays that belong to the caller. H at the next node is affine in the next sample: tail + local·g.

Within one smooth stretch of the signal a stream applies, at node n,

* for n < steady: the whole-history row n;
* from then on: fixed weights on the newest L+1 samples and, where there is a sum of exponentials, one number per
  exponential that decays and takes in the sample of lag L.

The second form is exact: a panel that leaves the window adds Σ_q C_q z^q to an exponential (its polynomial, integrated
against e^(−λs)), and Σ_q C_q z^q/(1 − d z) = polynomial(z) + r z^p/(1 − d z), the polynomial being part of the fixed
weights. A jump ends a stretch: no polynomial straddles it. What the finished stretch still adds before all of it is in
the exponentials is computed at the jump and kept in a short ring of future contributions.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from basset import _validate
from basset._states import owned, steps_to
from basset.kernels import Floats, Kernel, gauss_legendre
from basset.quadrature.base import INPUTS, TABLES, FullRule, Rule, table
from basset.quadrature.product import GAUSS, Daitche, lagrange, panel_basis, panel_integrals

if TYPE_CHECKING:
    from basset.exponentials import ExponentialSum

Array = NDArray[np.float64]

LONGEST = 100_000_000  # steps of whole history: some gigabytes
LONG_WINDOW = 256  # from here on a whole path is convolved by FFT


class State(NamedTuple):
    """What a stream remembers: float64 arrays only. Pickle it, copy it, save it with numpy.savez(**state._asdict()).

    >>> import pickle
    >>> import basset
    >>> plan = basset.Exponential().plan(dt=0.1, horizon=10.0)
    >>> state = plan.start()
    >>> _ = plan.run(state, np.ones(50))
    >>> plan.tail(State(*pickle.loads(pickle.dumps(state)))) == plan.tail(state)
    True
    """

    samples: Array  # (components, S), unit of f per second: the newest of the running stretch, a ring written twice, so that it reads contiguously
    terms: Array  # (components, T), unit of H: the exponentials
    future: Array  # (components, R), unit of H: what finished stretches and recent jumps add at the coming nodes, a ring
    history: Array  # shape of one sample: H at the newest node
    counters: Array  # (3,): samples in the running stretch, nodes so far, coming nodes with an entry in `future`


class Plan:
    """A rule made ready to stream with one step size; create it with `rule.plan(dt, horizon, kernel)`.

    Parameters
    ----------
    rule : Rule
        What streams.
    dt : float, seconds
        Step size.
    horizon : float, seconds
        The longest time that will be remembered.
    kernel : Kernel
        What is remembered.

    Attributes
    ----------
    rule, dt, kernel : as given
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
    >>> np.allclose(plan.weights(2), plan.rule.weights(2, 0.25))
    True
    """

    def __init__(self, rule: Rule, dt: float, horizon: float, kernel: Kernel) -> None:
        self.rule, self.dt, self.kernel = rule, _validate.positive("dt", dt, "seconds"), kernel
        steps, self._window, self.tail_sum = self.reach(rule, self.dt, horizon, kernel)
        self._unit = kernel.scaled(self.dt)
        self._base = rule._remembered
        self.steps: int | None = steps
        if self._window is not None and (self.tail_sum is None or math.isinf(self.tail_sum.far)):
            self.steps = None
        self._prepare(steps)
        TABLES.trim()

    @staticmethod
    def reach(rule: Rule, dt: float, horizon: float, kernel: Kernel) -> tuple[int, int | None, ExponentialSum | None]:
        """What a plan remembers, before anything is computed for it.

        Parameters
        ----------
        rule : Rule
        dt, horizon : float, seconds
        kernel : Kernel
            As of the plan.

        Returns
        -------
        steps : int
            Of the horizon.
        window : int or None
            Steps of the window; None where the whole history is kept.
        tail : ExponentialSum or None
            What stands for the kernel beyond the window.

        Raises
        ------
        ValueError, TypeError
            As `Rule.plan`.

        Examples
        --------
        >>> import basset
        >>> Plan.reach(basset.Daitche(order=1), 0.25, 1.0, basset.BassetKernel())
        (4, None, None)
        """
        horizon = _validate.positive("horizon", horizon, "seconds")
        rule._accept(kernel, INPUTS[0])
        steps = steps_to(horizon, dt)
        window, tail = rule._window_steps(dt), None
        if window is not None:
            if window > LONGEST:
                raise ValueError(f"window must be at most {LONGEST:g} steps of dt = {dt:g} seconds in a stream, got {window:g} steps")
            tail = rule._tail(dt, steps * dt, kernel)
            if tail is not None and steps <= Plan._lags(rule._remembered, window):
                window, tail = None, None  # shorter than the window: the whole history
        if window is None and steps > LONGEST:
            raise ValueError(
                f"horizon must be at most {LONGEST:g} steps where the whole history is kept, got {steps:g} steps: take a window or basset.Exponential"
            )
        return steps, window, tail

    @staticmethod
    def _lags(base: FullRule, window: int) -> int:
        """Largest lag that a panel leaving the window touches."""
        degree = base.order if isinstance(base, Daitche) else 1
        return window + (degree + 1) // 2

    def _prepare(self, steps: int) -> None:
        """Fill the arrays that the compiled loops read; all in units of H per unit of sample."""
        base, unit, root = self._base, self._unit, math.sqrt(self.dt)
        weights = table(base, unit, "rate")
        self._rates: Floats = np.empty(0)
        self._gains: Floats = np.empty(0)
        self._loss: Floats = np.empty(0)
        self._tail_weights: Floats = np.empty(0)
        self._fixed_terms: Floats = np.empty((0, 0))
        if self._window is None:
            slots, steady, ring = steps + 1, steps + 1, steps + 1
            fixed: Floats = np.empty(0)
            entry: Floats = np.empty((0, 0))
        elif self.tail_sum is None:
            slots, steady, ring = self._window + 1, self._window, self._window + 1
            fixed, entry = root * np.concatenate(weights.row(self._window)), np.empty((0, 0))
        else:
            slots, ring = self._lags(self._base, self._window) + 1, self._window + 1
            steady, fixed, entry = self._split_tail(slots - 1)
        self._slots, self._steady, self._ring = slots, steady, ring
        first, reach = base._first, base._reach
        rows = min(first, steady)
        short = np.zeros((rows, rows))
        for n in range(1, rows):
            short[n, : n + 1] = root * weights.row(n)[0]
        oldest: Floats = np.empty((0, reach))
        if steady > first:
            near = int(min(steady - 1, base._far - 1))
            oldest = weights.oldest_rows(near)
            if steady - 1 > near:
                oldest = np.concatenate([oldest, base._oldest_sum(near + 1, steady - 1, np.eye(reach), unit, "rate")])
        interior = weights.interior(max(steady - reach, 0))
        arrays = (short, root * oldest, root * interior)
        self._arrays = tuple(np.ascontiguousarray(array, dtype=np.float64) for array in (*arrays, fixed, self._loss, self._gains, entry))

    def _split_tail(self, lags: int) -> tuple[int, Floats, Floats]:
        """(steady, fixed weights oldest first, entry matrix) of a window followed by a sum of exponentials."""
        base, window, tail = self._base, self._window, self.tail_sum
        assert isinstance(base, Daitche) and window is not None and tail is not None
        degree, centre, root = base.order, base.order // 2, math.sqrt(self.dt)
        steady = max(degree + 1, lags - 1)
        self._rates = rates = tail.rates * self.dt
        self._loss = -np.expm1(-rates)
        self._tail_weights = amplitude = tail.weights * root  # of the unit-step kernel
        # a panel's polynomial against e^(−λs), from the panel's near end on: (position in stencil, term, sample)
        x, w = gauss_legendre(64)
        decayed = np.exp(-rates[:, None] * x) * w
        nodes = np.arange(degree + 1.0)
        moments = np.stack([decayed @ lagrange(nodes, o + x)[0] for o in range(degree)])
        leaving = amplitude[:, None] * np.exp(-rates * window)[:, None] * moments[centre]  # (term, sample), newest first
        quotient = leaving.copy()
        for q in range(1, degree + 1):
            quotient[:, q] += np.exp(-rates) * quotient[:, q - 1]
        self._gains = root * quotient[:, degree]
        self._fixed_terms = root * quotient[:, :degree]  # what the fixed weights already hold of each exponential
        local = self.window_weights(base, self._unit, window, lags)
        start = window - centre
        local[start : start + degree] += quotient[:, :degree].sum(axis=0)
        entry = np.zeros((len(rates), steady + 1))  # newest first until the end
        for k in range(window, steady):
            first = min(max(k - centre, 0), steady - degree)
            panel = amplitude[:, None] * np.exp(-rates * k)[:, None] * moments[k - first]
            entry[:, first : first + degree + 1] += panel
        entry[:, start : start + degree] -= quotient[:, :degree]
        newest = min(start, steady - degree)  # the smallest lag that is touched
        return steady, root * local[::-1], root * entry[:, : newest - 1 : -1]

    @staticmethod
    def window_weights(base: Daitche, unit: Kernel, window: int, lags: int) -> Floats:
        """Weights (lags+1,), newest first, of the panels inside the window, none shifted at its old end; unit step.

        Parameters
        ----------
        base : Daitche
            The rule inside the window.
        unit : Kernel
            The kernel, its time scale in steps.
        window, lags : int
            Steps of the window; the largest lag that is touched.

        Returns
        -------
        ndarray (lags+1,), dimensionless

        Examples
        --------
        >>> from basset import BassetKernel
        >>> Plan.window_weights(Daitche(1), BassetKernel(), 1, 1).round(12)  # ∫ s^(-1/2) (1 − s) ds and ∫ s^(1/2) ds
        array([1.33333333, 0.66666667])
        """
        degree, centre = base.order, base.order // 2
        local = np.zeros(max(lags, degree) + 1)
        first = 0
        if window > 4 * degree + 4:  # samples whose panels all lie inside have the whole-history weights
            whole = window - centre
            local[:whole] = table(base, unit, "rate").interior(whole)[::-1]
            first = whole - degree
        integrals = panel_integrals(first, window, degree, unit)
        edge = np.zeros_like(local)
        for k in range(first, window):
            start = max(k - centre, 0)
            edge[start : start + degree + 1] += integrals[k - first, k - start]
        if first:
            local[whole:] = edge[whole:]
            return local
        return edge

    @property
    def nbytes(self) -> int:
        """Bytes that the plan holds, states apart."""
        return sum(array.nbytes for array in self._arrays)

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
        shape = shape if isinstance(shape, tuple) else (shape,)
        components = math.prod(_validate.integer("shape", size, 0) for size in shape)
        width = self._slots if self._window is None else 2 * self._slots
        arrays = (np.zeros((components, width)), np.zeros((components, len(self._rates))), np.zeros((components, self._ring)))
        return State(*arrays, np.zeros(shape), np.zeros(3))

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
        self.run(state, self._sample("g", g, state)[None])

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
        from basset import _stream
        from basset.evaluate import _converted, _diagnose

        self._own(state)
        rates = G if type(G) is np.ndarray and G.dtype == np.float64 else _converted("G", G)
        shape = state.history.shape
        if rates.shape[1:] != shape or rates.ndim == 0:
            raise ValueError(f"G must have the shape (steps, *{shape}), got {rates.shape}")
        count, node, pending = (int(counter) for counter in state.counters)
        steps = len(rates)
        if self.steps is not None and node + steps > self.steps + 1:
            raise ValueError(
                f"horizon must cover the stream: it was planned for {self.steps} steps of {self.dt:g} s after the first sample, got step {node + steps - 1}"
            )
        rates = np.ascontiguousarray(rates).reshape(steps, state.history.size)
        if not np.isfinite(rates).all():
            _diagnose(rates, 0, "G")
        history = np.empty_like(rates)
        arrays = (state.samples, state.terms, state.future, count, node, pending, rates, history, self._slots)
        short, oldest, interior, fixed, loss, gains, entry = self._arrays
        _stream.run(*arrays, short, oldest, interior, self._steady, fixed, loss, gains, entry)
        if steps:
            state.history[...] = history[-1].reshape(shape)
        state.counters[:] = count + steps, node + steps, max(0, pending - steps)
        return history.reshape(steps, *shape)

    def value(self, state: State) -> Any:
        """H at the newest node, shape of one sample; 0 after the first push (an initial jump counts from the next node on).

        Parameters
        ----------
        state : State

        Returns
        -------
        float64, shape of one sample, unit of f × s^(-1/2)
        """
        return state.history.copy() if state.history.ndim else float(state.history)

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
        from basset import _stream

        self._room(state)
        count, node, pending = (int(counter) for counter in state.counters)
        result = np.zeros(state.history.size)
        if count == 0:
            return result.reshape(state.history.shape) if state.history.ndim else 0.0
        arrays = (state.samples, state.terms, state.future, count, node, pending, self._slots)
        short, oldest, interior, fixed, loss, gains, entry = self._arrays
        _stream.peek(*arrays, short, oldest, interior, self._steady, fixed, loss, gains, entry, result)
        return result.reshape(state.history.shape) if state.history.ndim else float(result[0])

    def local(self, state: State) -> float:
        """The factor of the next sample in H at the next node.

        Parameters
        ----------
        state : State

        Returns
        -------
        float, s^(1/2)

        Raises
        ------
        ValueError, TypeError
            As `tail`.
        """
        self._room(state)
        n = int(state.counters[0])
        short, _, interior, fixed, _, _, _ = self._arrays
        if n == 0:
            return 0.0
        if n >= self._steady:
            return float(fixed[-1])
        if n < len(short):
            return float(short[n, n])
        return float(interior[-1])

    def _own(self, state: State) -> None:
        width = self._slots if self._window is None else 2 * self._slots
        owned(state, State, {"samples": width, "terms": len(self._rates), "future": self._ring})

    def _room(self, state: State) -> None:
        self._own(state)
        node = int(state.counters[1])
        if self.steps is not None and node > self.steps:
            raise ValueError(f"horizon must cover the stream: it was planned for {self.steps} steps of {self.dt:g} s after the first sample, got step {node}")

    # ------------------------------------------------------------------------------------------------ jumps

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
            The rate after the jump, at the newest node; None if the rate is continuous. With g the smooth stretch ends at
            the jump: older samples keep their polynomial up to it (extended for age > 0, where the rate after the jump is
            taken as constant up to the node), a new stretch starts with g, and no stencil straddles the jump. Rules of
            first order or less average the two rates at the node instead. Then age must not exceed dt.

        Raises
        ------
        ValueError, TypeError
            If there is no sample yet, a shape is wrong, a number is not finite, age is negative or reaches back more than
            one step before the first sample, or exceeds dt where g is given.
        """
        self._own(state)
        delta = _validate.whole("delta", delta)
        delta = self._sample("delta", np.broadcast_to(np.asarray(delta), state.history.shape) if np.ndim(delta) == 0 else delta, state)
        age = _validate.non_negative("age", age, "seconds")
        node = int(state.counters[1])
        if node == 0:
            raise ValueError("jump needs a first sample: push it before the jump, got an empty state")
        if g is not None:
            g = self._sample("g", g, state)
            if age > self.dt * (1.0 + 1e-12):
                raise ValueError("age must not exceed the step dt = {} seconds where g is given, got {}".format(*_validate.apart(self.dt, age)))
        lag = age / self.dt
        oldest = self._oldest_jump(node)
        if lag > oldest * (1.0 + 1e-12):
            most, came = _validate.apart(oldest * self.dt, age)
            raise ValueError(f"age must be at most {most} seconds here: the memory begins one step before the first sample, got {came}")
        if g is not None and isinstance(self._base, Daitche):
            self._end_stretch(state, min(lag, 1.0), g.ravel())
        elif g is not None and lag == 0.0:
            self._average_newest(state, g.ravel())
        impulse = delta.ravel()[:, None] / math.sqrt(self.dt)
        ahead = self._ahead(state)
        if len(self._rates):
            state.terms[...] += impulse * self._tail_weights * np.exp(-self._rates * lag)
        self._add_future(state, impulse * self._excess(lag + np.arange(1.0, ahead + 1.0)))
        if lag > 0.0:
            excess = float(self._excess(np.array([lag]))[0])
            state.history[...] += (impulse[:, 0] * (excess + float(self._sum(np.array([lag]))[0]))).reshape(state.history.shape)
            state.future[:, (node - 1) % self._ring] += impulse[:, 0] * excess

    def _oldest_jump(self, node: int) -> float:
        """How many steps before the newest node a jump may lie, so that its lag stays within the tail up to the horizon."""
        if self.tail_sum is None or self.steps is None:
            return float(node)
        return node - 1.0 + min(1.0, max(0.0, self.tail_sum.far / self.dt - self.steps))

    def _sample(self, name: str, value: ArrayLike, state: State) -> Floats:
        from basset.evaluate import _converted

        sample = _converted(name, value)
        if sample.shape != state.history.shape:
            raise ValueError(f"{name} must have the shape {state.history.shape} of one sample, got {sample.shape}")
        if not np.isfinite(sample).all():
            raise ValueError(f"{name} must be finite, got {sample[~np.isfinite(sample)][0]}")
        return sample

    def _ahead(self, state: State) -> int:
        """How many coming nodes can have an entry in the ring."""
        if self._window is None:
            return self._slots - int(state.counters[1])
        return self._window

    def _excess(self, lag: Floats) -> Floats:
        """What the ring holds of the unit-step kernel: K beyond the exponentials, up to the window's end."""
        if self._window is None:
            return self._unit._values(lag)
        beyond = self._window * (1.0 + 1e-12 if self.tail_sum is None else 1.0 - 1e-12)
        inside = lag < beyond
        result = np.zeros_like(lag)
        result[inside] = self._unit._values(lag[inside])
        result[inside] -= self._sum(lag[inside])
        return result

    def _sum(self, lag: Floats) -> Floats:
        """The unit-step sum of exponentials."""
        return np.asarray(np.exp(-lag[:, None] * self._rates) @ self._tail_weights)

    def _add_future(self, state: State, values: Floats) -> None:
        """Add values (components, count) to the coming nodes."""
        node, count = int(state.counters[1]), values.shape[1]
        slots = (node + np.arange(count)) % self._ring
        state.future[:, slots] += values
        state.counters[2] = max(state.counters[2], count)

    def _average_newest(self, state: State, g: Floats) -> None:
        position = (int(state.counters[0]) - 1) % self._slots
        mean = 0.5 * (state.samples[:, position] + g)
        state.samples[:, position :: self._slots] = mean[:, None]

    def _end_stretch(self, state: State, lag: float, g: Floats) -> None:
        """Turn the running stretch into future contributions and start a new one with sample `g` at the newest node.

        `lag` (in steps, 0 to 1) is the distance of the jump from the newest node.
        """
        assert isinstance(self._base, Daitche)
        n, node = int(state.counters[0]) - 1, int(state.counters[1])
        held = min(n + 1, self._slots)
        lags = np.arange(held)
        newest_first = state.samples[:, (n - lags) % self._slots]
        root, x_w = math.sqrt(self.dt), gauss_legendre(GAUSS)
        steady = self.tail_sum is not None and n >= self._steady
        if steady:  # from fixed weights and gains back to whole exponentials
            assert self._window is not None
            start, degree = self._window - self._base.order // 2, self._base.order
            state.terms[...] += newest_first[:, start : start + degree] @ self._fixed_terms.T
        shift = 1 if lag > 0.0 and n > 0 else 0  # the newest sample belongs to what comes after the jump
        old = newest_first[:, shift:]
        last = n - shift  # panels of the finished stretch
        panels = min(last, self._window - shift) if self._window is not None and (steady or self.tail_sum is None) else last
        degree = min(self._base.order, last)
        pieces: list[tuple[Floats, Floats]] = []  # lags (q,), weighted rate (components, q)
        if shift and lag < 1.0:
            s = lag + (1.0 - lag) * x_w[0]
            stencil = lagrange(np.arange(degree + 1.0), s - 1.0)[0]
            pieces.append((s, (1.0 - lag) * x_w[1] * (old[:, : degree + 1] @ stencil.T)))
        again = n == 0 and node > 1  # a second jump in this step: so far the first one's rate was taken to last up to the node
        rate = g - state.samples[:, 0] if again else g
        if lag > 0.0:
            pieces.append((lag * x_w[0], lag * x_w[1] * rate[:, None]))
        if panels > 0:
            k = np.arange(panels)
            first = np.clip(k - degree // 2, 0, min(last, old.shape[1] - 1) - degree)
            rates = old[:, first[:, None] + np.arange(degree + 1)]
            weighted = np.einsum("ckj,kqj->ckq", rates, panel_basis(degree)[0][k - first], optimize=True) * x_w[1]
        else:
            weighted = np.zeros((len(old), 0, GAUSS))
        ahead = self._ahead(state)
        future = np.zeros((len(old), ahead))
        for q, x in enumerate(x_w[0]):
            values = self._excess(shift + x + np.arange(ahead + panels + 1.0))
            if panels <= 64 or panels * ahead <= 1 << 12:
                for m in range(panels):
                    future += weighted[:, m, q, None] * values[m + 1 : m + 1 + ahead]
            elif ahead and panels:
                from scipy.signal import fftconvolve  # takes half a second to import

                convolved = fftconvolve(values[None, 1 : panels + ahead], weighted[:, ::-1, q], axes=1)
                future += convolved[:, panels - 1 : panels - 1 + ahead]
        coming = np.arange(1.0, ahead + 1.0)
        for s, piece in pieces:
            for q, distance in enumerate(s):
                future += piece[:, q, None] * self._excess(distance + coming)
        everything = [*pieces, ((shift + np.arange(panels)[:, None] + x_w[0]).ravel(), weighted.reshape(len(old), max(panels, 0) * GAUSS))]
        for s, piece in everything:
            state.terms[...] += root * (piece @ np.exp(-s[:, None] * self._rates)) * self._tail_weights
        if lag > 0.0:  # H at the newest node, without a straddling polynomial
            w = self._unit.rule(0.0, lag)[1]
            s = lag * x_w[0]
            value = rate * (w.sum() - lag * x_w[1] @ self._sum(s))
            if shift and lag < 1.0:  # K may be steep where the finished stretch ends
                x, w = self._unit.rule(lag, 1.0)
                near, piece = pieces[0]
                stencil = lagrange(np.arange(degree + 1.0), lag + (1.0 - lag) * x - 1.0)[0]
                value = value + old[:, : degree + 1] @ (w @ stencil) - piece @ self._sum(near)
            value = value + everything[-1][1] @ self._excess(everything[-1][0])
            newest = (node - 1) % self._ring
            state.future[:, newest] += root * value  # kept for a further jump in this step
            value = state.future[:, newest] + state.terms.sum(axis=1)
            state.history[...] = value.reshape(state.history.shape)
        self._add_future(state, root * future)
        state.samples[:, :] = 0.0
        state.samples[:, 0 :: self._slots] = g[:, None]
        state.counters[0] = 1.0

    # ------------------------------------------------------------------------------------------------ as a whole
    def trajectory(self, rates: Floats) -> Floats:
        """H at every node of one stretch for rates (nodes, components): `run` in O(n log n), by FFT where the window is long.

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
        from basset import _stream
        from basset.quadrature.base import filtered_by

        count = len(rates)
        if self.tail_sum is None or self._steady < LONG_WINDOW or count <= self._steady:
            return self.run(self.start((rates.shape[1],)), rates)
        steady, root = self._steady, math.sqrt(self.dt)  # here steady = lags − 1: only lag `lags` is missing at node steady
        _, _, _, fixed, loss, gains, entry = self._arrays
        result = np.empty_like(rates)
        result[:steady] = root * table(self._base, self._unit, "rate").trajectory(rates[:steady])
        result[steady:] = filtered_by(fixed, np.concatenate([np.zeros((1, rates.shape[1])), rates]))
        terms = np.ascontiguousarray((entry @ rates[: entry.shape[1]]).T)
        result[steady] += terms.sum(axis=1)
        _stream.follow(terms, loss, gains, np.ascontiguousarray(rates[: count - steady - 1]), result[steady + 1 :])
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
        for weight, rate in zip(self._tail_weights, self._rates, strict=True):
            result += weight * np.exp(-rate * lags)
        return np.asarray(result / math.sqrt(self.dt))

    # ------------------------------------------------------------------------------------------------ as weights

    def weights(self, n: int) -> Array:
        """Weights of H at node n of one stretch, newest first: what the stream applies.

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
        short, oldest, interior, fixed, _, gains, entry = self._arrays
        result = np.zeros(n + 1)
        if n < len(short):
            result[:] = short[n, n::-1]
        elif n < self._steady:
            reach = oldest.shape[1]
            result[n + 1 - reach :] = oldest[n - len(short), ::-1]
            result[: n + 1 - reach] = interior[::-1][: n + 1 - reach]
        else:
            lags = self._slots - 1
            held = min(n, lags) + 1
            result[:held] = fixed[::-1][:held]
            first = (np.exp(-self._rates * (n - self._steady)) @ entry)[::-1]  # the oldest samples
            result[n + 1 - len(first) :] += first
            ages = np.arange(n - self._steady)  # what entered since, through the gains
            for low in range(0, len(ages), 4096):
                part = ages[low : low + 4096]
                result[lags + part] += np.exp(-part[:, None] * self._rates) @ gains
        return result
