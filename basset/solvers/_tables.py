"""Nodes, bases and history weights of graded collocation, and the tables of each step size that the stepper looks things up in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from basset._compile import placed
from basset.exponentials import ExponentialSum
from basset.kernels import BassetKernel, Floats, Kernel, MeiAdrianKernel, gauss_legendre
from basset.solvers import stepper
from basset.spectrum import Following, slip_table

QUADRATURE = 48
DECAYED = 40.0  # e^(−40) is below rounding
TOGETHER = 8  # step sizes whose tables are made at once: what that takes stays in the cache
LOCAL_LOW, LOCAL_STEP, LOCAL_POINTS = math.log(1e-13), 0.25, 180


def legendre_values(x: Floats, degree: int) -> Floats:
    """Legendre polynomials (…, degree+1) at x; at a single place without NumPy's overhead."""
    if x.size != 1:
        return np.asarray(legendre.legvander(x, degree))
    place = float(x.item())
    found = [1.0, place]
    for k in range(2, degree + 1):
        found.append((found[k - 1] * place * (2 * k - 1) - found[k - 2] * (k - 1)) / k)
    return np.array(found[: degree + 1]).reshape(*x.shape, degree + 1)


class Nodal:
    """Polynomials on [0, 1] by their values at nodes, kept in Legendre coefficients."""

    def __init__(self, nodes: Floats) -> None:
        self.nodes = nodes
        self.degree = len(nodes) - 1
        values = legendre.legvander(2.0 * nodes - 1.0, self.degree)
        inverse = np.linalg.inv(values)
        self.coefficients = inverse + inverse @ (np.eye(len(nodes)) - values @ inverse)  # (degree+1, nodes); what it errs by, all steps err by
        self._slopes = 2.0 * legendre.legder(self.coefficients) if self.degree else np.zeros((1, 1))
        self._integrals = 0.5 * legendre.legint(self.coefficients, lbnd=-1.0)

    def values(self, x: Floats) -> Floats:
        """Basis (…, nodes) at x."""
        return np.asarray(legendre_values(2.0 * x - 1.0, self.degree) @ self.coefficients)

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the basis (…, nodes) at x."""
        return np.asarray(legendre_values(2.0 * x - 1.0, len(self._slopes) - 1) @ self._slopes)

    def integrals(self, x: Floats) -> Floats:
        """Integrals of the basis from 0 to x (…, nodes)."""
        return np.asarray(legendre_values(2.0 * x - 1.0, len(self._integrals) - 1) @ self._integrals)


class Stages:
    """Nodes and bases for S stages."""

    def __init__(self, stages: int) -> None:
        radau = np.eye(stages + 1)[-1] - np.eye(stages + 1)[-2]  # P_S − P_(S−1) vanishes at the nodes of Radau IIA
        inner = np.sort(np.real(legendre.legroots(radau)))[:-1]  # of complex type in some versions of NumPy
        inner -= legendre.legval(inner, radau) / legendre.legval(inner, legendre.legder(radau))
        self.c = np.append((inner + 1.0) / 2.0, 1.0)
        self.regular = Nodal(self.c)
        self.singular = Nodal(np.concatenate([[0.0], np.sqrt(self.c)]))
        self.integral = self.regular.integrals(self.c)  # (stage, node)
        root = np.sqrt(self.c)
        self.slope = self.singular.slopes(root)[:, 1:] / (2.0 * root[:, None])  # d/dθ at the nodes, of y − y_n
        ends = np.concatenate([[0.0], root])  # between the nodes, where the defect of a singular step is looked at
        self.between = 0.5 * (ends[1:] + ends[:-1])
        self.width = np.diff(ends)


@lru_cache(maxsize=32)
def stages_of(count: int) -> Stages:
    """The nodes and bases, made once."""
    return Stages(count)


@lru_cache(maxsize=512)
def local_history(count: int, kernel: Kernel) -> tuple[Floats, Floats]:
    """History at the nodes of what happens inside a unit step: (regular, singular), each (stage, node).

    Regular: ∫_0^c K(c − θ) L_j(θ) dθ. Singular: ∫_0^c K(c − θ) dℓ_j(√θ), split at c/8 from the kernel's singularity.
    """
    stages = stages_of(count)
    regular = np.empty((count, count))
    for i, c in enumerate(stages.c):
        nodes, weights = kernel.rule(0.0, c)
        regular[i] = weights @ stages.regular.values(c * (1.0 - nodes))
    return regular, singular_history(stages, kernel, stages.c)


def singular_history(stages: Stages, kernel: Kernel, places: Floats) -> Floats:
    """∫_0^c K(c − θ) dℓ_j(√θ) at c in `places`: (place, node)."""
    result = np.empty((len(places), stages.singular.degree))
    x, w = gauss_legendre(QUADRATURE)
    for i, c in enumerate(places):
        near = c / 8.0
        nodes, weights = kernel.rule(0.0, near)
        sigma = np.sqrt(c - near * nodes)
        result[i] = weights @ (stages.singular.slopes(sigma) / (2.0 * sigma[:, None]))[:, 1:]
        far = math.sqrt(c - near)
        sigma = far * x
        result[i] += (far * w * kernel._values(c - sigma**2)) @ stages.singular.slopes(sigma)[:, 1:]
    return result


@lru_cache(maxsize=512)
def history_between(count: int, kernel: Kernel) -> Floats:
    """`singular_history` halfway between the nodes."""
    stages = stages_of(count)
    return singular_history(stages, kernel, stages.between**2)


def moments(stages: Stages, rates: Floats, sizes: Floats, singular: bool) -> Floats:
    """∫ e^(−λ(h − s)) dy(s) over [0, h] for each rate λ with its own h, and node: (rate, node), node values of y' or of y − y_n.

    Fast terms see only the end of the interval: its last 40 decay times are integrated there.
    """
    x, w = gauss_legendre(QUADRATURE)
    z = rates * sizes
    share = np.minimum(1.0, DECAYED / z)[:, None]  # of θ
    if singular:  # in σ, from where the decay begins to matter
        low = np.sqrt(np.maximum(0.0, 1.0 - share))
        width = share / (1.0 + low)  # 1 − low without cancellation
        position = 1.0 - width * x
        factor = width * w * np.exp(-z[:, None] * (1.0 - position) * (1.0 + position))
        basis = stages.singular.slopes(position)[..., 1:]
    else:
        factor = share * w * sizes[:, None] * np.exp(-z[:, None] * share * x)
        basis = stages.regular.values(1.0 - share * x)
    return np.asarray(np.einsum("tq,tqj->tj", factor, basis))


def step_tables(count: int, tail: ExponentialSum, kernel: Kernel, sizes: Sequence[float], singular: bool) -> tuple[Floats, ...]:
    """What the loop needs for some step sizes, one row each: past, decay, moments, local; for singular steps also kernel, between_…."""
    stages, scaled = stages_of(count), [kernel.scaled(size) for size in sizes]
    h = np.array(sizes)[:, None]
    root, kind = np.sqrt(h)[..., None], int(singular)
    past = tail.weights * np.exp(-(stages.c * h)[..., None] * tail.rates)
    decay = np.exp(-tail.rates * h)
    gained = moments(stages, np.tile(tail.rates, len(h)), np.repeat(h[:, 0], len(tail)), singular).reshape(len(h), len(tail), count).swapaxes(1, 2)
    local = np.array([local_history(count, one)[kind] for one in scaled])
    if not singular:
        return past, decay, gained, root * local
    places = stages.between**2
    values = kernel._values(stages.c * h), kernel._values(places * h)
    between = tail.weights * np.exp(-(places * h)[..., None] * tail.rates)
    return past, decay, gained, local / root, *values, between, np.array([history_between(count, one) for one in scaled]) / root


@lru_cache(maxsize=32)
def nodes_of(count: int) -> stepper.Nodes:
    """Nodes and bases for compiled code."""
    found = stages_of(count)
    between, regular, singular = found.between, found.regular, found.singular
    bases = (singular.values(between)[:, 1:], singular.slopes(between)[:, 1:], regular.values(np.zeros(1))[0])
    arrays = (found.c, found.slope, found.integral, regular.coefficients, singular.coefficients[:, 1:], between, found.width, *bases, regular._integrals)
    return stepper.Nodes(*(np.ascontiguousarray(array) for array in arrays))


class StepTables:
    """The tables of all step sizes span·2^(−rung/8) down to `floor`, for one sum of exponentials; made as they are asked for or all at once, never changed."""

    def __init__(self, count: int, tail: ExponentialSum | None, kernel: Kernel, floor: float, span: float) -> None:
        self.count, self.tail, self.kernel, self.floor, self.span = count, tail, kernel, floor, span
        self.nodes = nodes_of(count)
        self.tables = self._empty(math.ceil(stepper.LADDER * math.log2(span / floor)) + 1)
        self.unit = stepper.Unit(np.zeros(0), np.zeros((0, count, count)), np.zeros((0, count)))
        if isinstance(kernel, BassetKernel):
            local, between = np.array(local_history(count, kernel)), history_between(count, kernel).copy()
            self.unit = stepper.Unit(np.array(tail.weights) if tail is not None else np.zeros(0), local, between)

    @cached_property
    def placed(self) -> tuple[Any, Any]:
        """Nodes and tables as compiled functions take them."""
        return placed(self.nodes), placed(self.tables)

    def _empty(self, rungs: int, moments: bool = True) -> stepper.Tables:
        count, terms = self.count, len(self.tail) if self.tail else 0
        kept = terms if moments else 0
        shapes: list[tuple[int, ...]] = [(2,), (2, count, terms), (kept,), (2, count, kept), (2, count, count), (count,)]
        shapes += [(count, terms), (count, count), (count,)]
        return stepper.Tables(*(np.zeros((rungs, *shape)) for shape in shapes))

    def odd(self) -> stepper.Tables:
        """Room for one step size that is on no rung: every integration needs its own."""
        return self._empty(1, moments=False)

    def fill(self, odd: stepper.Tables, control: Any) -> None:
        """Make the tables that the stepper asks for; on a rung every thread makes the same."""
        h, rung, kind = float(control.step), int(control.rung), int(control.singular)
        if rung >= 0:
            self._make(self.tables, range(rung, rung + 1), [h], kind)
        else:
            self._make(odd, range(1), [h], kind)
            odd.sizes[0, 1 - kind] = 0.0  # of the other kind there is a part of another size

    def fill_all(self) -> None:
        """Make the tables of all rungs: then any number of threads run without returning for one."""
        rungs = len(self.tables.sizes)
        for low in range(0, rungs if self.tables.sizes.min() == 0.0 else 0, TOGETHER):
            chosen = range(low, min(low + TOGETHER, rungs))
            for kind in range(2):
                self._make(self.tables, chosen, [self.span * 2.0 ** (-rung / stepper.LADDER) for rung in chosen], kind)

    def _make(self, tables: stepper.Tables, rungs: range, sizes: list[float], kind: int) -> None:
        """Make the tables of one kind for these sizes."""
        rows = slice(rungs.start, rungs.stop)
        if self.tail is not None:
            past, decay, gained, local, *singular = step_tables(self.count, self.tail, self.kernel, sizes, bool(kind))
            tables.past[rows, kind], tables.local[rows, kind] = past, local
            if tables is self.tables:
                tables.decay[rows], tables.moments[rows, kind] = decay, gained
            if kind:
                tables.kernel[rows], tables.between_kernel[rows], tables.between_past[rows], tables.between_local[rows] = singular
        tables.sizes[rows, kind] = sizes  # last: it says that the rest is there


@lru_cache(maxsize=16)
def tables_of(count: int, tail: ExponentialSum | None, kernel: Kernel, floor: float, span: float) -> StepTables:
    """Tables, made once for all integrations with the same arguments."""
    return StepTables(count, tail, kernel, floor, span)


@lru_cache(maxsize=16)
def local_shortfall(stages: int, c1: float) -> Floats:
    """What the local history of a unit step of a finite-Reynolds kernel lacks to Basset's: (places, grid, stage, node)."""
    result = np.zeros((3, LOCAL_POINTS, stages, stages))
    basset = (*local_history(stages, BassetKernel()), history_between(stages, BassetKernel()))
    for g, stretch in enumerate(np.exp(LOCAL_LOW + LOCAL_STEP * np.arange(LOCAL_POINTS))):
        slip = 0.75 * (2.0 * stretch**1.5 / math.sqrt(math.pi)) ** (1.0 / 3.0)
        kernel = MeiAdrianKernel(slip, 1.0, 1.0, c1, 0.0)
        result[:, g] = np.array(basset) - np.array((*local_history(stages, kernel), history_between(stages, kernel)))
    return result


def following(
    count: int, tail: ExponentialSum, constants: tuple[float, float], reynolds: float, scale: float, slips: tuple[float, float], horizon: float | None
) -> Following:
    """A kernel of the slip at t for the stepper; `tail` is Basset's, `constants` are c1 and c2, for the rest see `Following`."""
    table, (c1, c2) = slip_table(tail, constants[0], horizon), constants
    values = np.array(table.values)
    local = local_shortfall(count, c1)
    return Following(c1, c2, reynolds, scale, *slips, np.array(table.log_rates), table.low, table.inverse_step, values, local, LOCAL_LOW, 1.0 / LOCAL_STEP)
