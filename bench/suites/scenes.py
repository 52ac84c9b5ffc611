"""Which scheme, window, solver and step give mean jumps to a wanted error in the least time?

All fly the same bed angles, so that errors are means of paired differences; their standard error tells scatter from scheme.
"""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import saltation
from basset import SCHEMES
from basset.kernels import Floats
from bench import combinations
from bench.grains import at_fixed_steps, base, changed
from saltation import statistics
from saltation.scene import scene_of
from saltation.study import cases

JUMPS, SHORT, DISCARD = 220, 60, 20  # the shipped run; a short one for slow schemes; left out of the means in both
QUANTITIES = ("height", "length")
REFERENCE = 1e-10  # rtol of the reference
FINEST = {"basset": REFERENCE, "mei_adrian": 1e-8, "dorgan_loth": 1e-7}  # what a kernel allows
COLLOCATION, IMPLICIT, HELD = "collocation", "fixed_step", "runge_kutta_4"
WHOLE, DROPPED, PUBLISHED, FITTED, SUMS = "whole past", "window, no tail", "window, published tail", "window, fitted tail", "exponentials"
COUNTED = "window in jumps"
RTOLS = tuple(10.0**-k for k in range(2, 9))
LADDER = (1e-2, 4e-3, 1e-3, 2.5e-4, 6.25e-5, 2e-5)  # dt in d/u*; every window is a whole number of each
FLOORED = 2.5e-4  # the finest of those whose memory's own error is what is looked for
WINDOWS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # d/u*, of those without a tail
REMEMBERED_JUMPS, THEIR_RTOL = (1, 2, 5, 10, 20, 50), 1e-5  # windows of collocation, in jumps
THESIS = ("semi-derivative", HELD, 1e-3)  # what the thesis flies with
TYPICAL = {"impulse": 1.5, "reset": 3.0}  # d/u*: a jump lasts so long
FOLLOWED = 4.0  # a step with a kernel that follows the slip over one without
PER_STEP, PER_SAMPLE, PER_NODE = 1.2e-6, 1.1e-9, 4e-7  # s: a step, a sample in its sum, a node ahead that an impact corrects; for planning alone
CUT = 2.5  # predicted time of a short run over `patience`, at most
REPEATED = 0.3  # s: quicker runs are repeated, the quickest counts

Content = dict[str, Any]


@dataclass(frozen=True)
class Contender:
    """A history at fixed steps: its name, its family (how the past is treated), its fields of [history], its degree."""

    scheme: str
    family: str
    history: Mapping[str, Any] = field(hash=False)
    degree: int | None = None  # of a product rule: Exponential of this degree has the same weights and the whole past
    finest: float = 0.0  # dt beyond which nothing new is seen

    @property
    def window(self) -> float:
        """The window in d/u*, infinite for the whole past."""
        return float(self.history.get("window", math.inf))


def _contenders() -> tuple[Contender, ...]:
    found = [
        Contender("semi-derivative", WHOLE, {"scheme": "semi_derivative"}),
        Contender("Euler–Maclaurin", WHOLE, {"scheme": "euler_maclaurin"}),
        Contender("Brush", WHOLE, {"scheme": "brush"}),
        *(Contender(f"Daitche({p})", WHOLE, {"scheme": "daitche", "order": p}, p) for p in (1, 2, 3)),
        *(Contender(f"Daitche(2), window {w:g}", DROPPED, {"scheme": "windowed", "rule": "daitche", "order": 2, "window": w}, 2, FLOORED) for w in WINDOWS),
        Contender("Hinsberg, window 1, no tail", DROPPED, {"scheme": "hinsberg", "window": 1.0, "tail": False}, 1, FLOORED),
        *(Contender(f"Hinsberg, window {w:g}", PUBLISHED, {"scheme": "hinsberg", "window": w}, 1) for w in (0.1, 0.5, 2.0)),
    ]
    for tail, family in (("van_hinsberg", PUBLISHED), ("fitted", FITTED)):
        for w in (0.5,) if family == PUBLISHED else (0.1, 1.0):
            name = "van Hinsberg's tail" if family == PUBLISHED else "fitted tail"
            fields = {"scheme": "windowed", "rule": "daitche", "order": 2, "window": w, "tail": tail}
            found.append(Contender(f"Daitche(2), window {w:g}, {name}", family, fields, 2))
    found += [Contender(f"Exponential({p})", SUMS, {"scheme": "exponential", "order": p}, p) for p in (1, 2, 3)]
    rough = (1e-1, 1e-2, 1e-3, 1e-9)
    found += [
        Contender(f"Exponential(3), rtol {rtol:.0e}".replace("e-0", "e-"), SUMS, {"scheme": "exponential", "order": 3, "rtol": rtol}, 3, FLOORED)
        for rtol in rough
    ]
    for n, jumps in ((1, "1 jump"), (2, "2 jumps"), (5, "5 jumps")):
        found.append(Contender(f"semi-derivative, memory of {jumps}", COUNTED, {"scheme": "semi_derivative", "window_jumps": n}))
    named = {contender.history["scheme"] for contender in found}
    return (*found, *(Contender(name, WHOLE, {"scheme": name}) for name in SCHEMES if name not in named))  # schemes added there are flown too


CONTENDERS = _contenders()
FEWER = (  # where no takeoff has slip
    "semi-derivative",
    "Daitche(2)",
    *(f"Daitche(2), window {w:g}" for w in (0.3, 1.0, 3.0)),
    "Hinsberg, window 0.5",
    "Daitche(2), window 0.1, fitted tail",
    "Exponential(1)",
    "Exponential(2)",
    "Exponential(3)",
)
FOLLOWING = (  # with a kernel that follows the slip; whole past and windows cost what a sum costs
    "Euler–Maclaurin",
    "Brush",
    *(f"Daitche({p})" for p in (1, 2, 3)),
    *(f"Daitche(2), window {w:g}" for w in (0.3, 1.0, 3.0)),
    "Hinsberg, window 1, no tail",
    "Daitche(2), window 1, fitted tail",
    *(f"Exponential({p})" for p in (1, 2, 3)),
    "Exponential(3), rtol 1e-2",
)


@dataclass(frozen=True)
class Flight:
    """One contender with its solver and step (collocation: its rtol), how many jumps it is given, and the kernel."""

    contender: Contender
    method: str
    size: float
    jumps: int = JUMPS
    kernel: str = "basset"

    def scene(self, rebound: str, seed: int, jumps: int | None = None) -> Content:
        """The scene as a dictionary; its memory reaches far enough for all of the flight."""
        memory = {"rebound": rebound, "horizon": horizon(self.contender, self.jumps, rebound), "kernel": self.kernel}
        content = changed(base("sand", 1, 0), run={"seed": seed}, history=memory)
        wanted = self.jumps if jumps is None else jumps
        if self.method == COLLOCATION:
            return changed(content, solver={"rtol": self.size}, history=self.contender.history, run={"jumps": wanted})
        return at_fixed_steps(content, self.method, self.size, wanted, self.contender.history)

    def fly(self, rebound: str, seed: int, jumps: int | None = None) -> tuple[float, Floats, str]:
        """(CPU seconds, height and length of every jump, how it ended)."""
        scene = scene_of(self.scene(rebound, seed, jumps))
        gc.disable()
        try:
            start = time.process_time()
            result = saltation.run(scene)
            seconds = time.process_time() - start
        finally:
            gc.enable()
        return seconds, result.all_jumps[list(QUANTITIES)].to_numpy(), result.message if result.status != "finished" else ""


WHOLE_MEMORY = Contender("collocation", COLLOCATION, {})


# Which schemes are flown, and how long


def horizon(contender: Contender, jumps: int, rebound: str) -> float:
    """The longest time that is remembered, d/u*; tight where all of it is corrected at every impact, ample elsewhere."""
    return (1.25 if contender.family in (WHOLE, COUNTED) else 4.0) * TYPICAL[rebound] * jumps


def predicted(contender: Contender, dt: float, jumps: int, rebound: str, kernel: str = "basset") -> float:
    """Seconds that a run takes, roughly: enough to plan by."""
    if contender.family == SUMS or kernel != "basset":
        return TYPICAL[rebound] * jumps / dt * PER_STEP * (FOLLOWED if kernel != "basset" else 1.0)
    steps, window = TYPICAL[rebound] * jumps / dt, contender.window / dt
    ahead = min(window, horizon(contender, jumps, rebound) / dt) if contender.degree else 0.0
    past = 0.5 * (steps / jumps if rebound == "reset" else steps)
    return steps * (PER_STEP + PER_SAMPLE * min(window, past)) + jumps * PER_NODE * ahead


def planned(contender: Contender, method: str, rebound: str, ladder: Sequence[float], patience: float, kernel: str = "basset") -> list[Flight]:
    """The steps that are affordable: in full length, cut short, or not at all. The whole past, slower with every jump, is always cut."""
    flights = []
    for dt in (dt for dt in ladder if dt >= contender.finest):
        always = rebound == "impulse" and (contender.scheme, method, dt) == THESIS
        grows = contender.family == WHOLE and kernel == "basset"
        for jumps, most in ((JUMPS, 0.0 if grows else patience), (SHORT, math.inf if always else CUT * patience)):
            if predicted(contender, dt, jumps, rebound, kernel) <= most:
                flights.append(Flight(contender, method, dt, jumps, kernel))
                break
    return flights


def exact(jumps: int = JUMPS, rtol: float | None = None, kernel: str = "basset") -> Flight:
    """The reference run."""
    return Flight(WHOLE_MEMORY, COLLOCATION, FINEST[kernel] if rtol is None else rtol, jumps, kernel)


def collocations(rebound: str, kernel: str = "basset") -> list[Flight]:
    """Collocation at every tolerance, and with a memory of some jumps."""
    flights = [Flight(WHOLE_MEMORY, COLLOCATION, rtol, kernel=kernel) for rtol in RTOLS if rtol > 1.5 * FINEST[kernel]]
    if rebound == "impulse" and kernel == "basset":
        kept = [Contender(f"collocation, memory of {n} jump{'s' if n > 1 else ''}", COLLOCATION, {"window_jumps": n}) for n in REMEMBERED_JUMPS]
        flights += [Flight(contender, COLLOCATION, THEIR_RTOL) for contender in kept]
    return flights


# Errors


def paired(tables: Sequence[Floats], others: Sequence[Floats], means: Floats) -> dict[str, dict[str, float]]:
    """`cases.paired` by quantity, and the root mean square and the largest difference of single jumps."""
    found = cases.paired(tables, others, means)
    rms, most = np.sqrt((found.single**2).mean(axis=0)), np.abs(found.single).max(axis=0)
    rows = zip(found.mean, found.error, rms, most, strict=True)
    return {name: dict(zip(("bias", "se", "rms", "max"), map(float, row), strict=True)) for name, row in zip(QUANTITIES, rows, strict=True)}


@dataclass
class Log:
    """What a flight has done over the seeds."""

    tables: dict[int, Floats] = field(default_factory=dict)
    seconds: list[float] = field(default_factory=list)
    set_up: float = 0.0  # of one jump, nearly all of it before the first step
    reason: str = ""


def take_turns(flights: Sequence[Flight], rebound: str, seeds: Sequence[int], patience: float) -> dict[Flight, Log]:
    """Every flight over the first seed, and the quick ones over the others too, in turn; seconds per jump without set-up."""
    logs = {flight: Log() for flight in flights}
    for seed in seeds:
        for flight, log in logs.items():
            fixed = flight.method != COLLOCATION
            expected = predicted(flight.contender, flight.size, flight.jumps, rebound, flight.kernel)
            if log.reason or (seed != seeds[0] and fixed and expected > 0.25 * patience):
                continue
            if seed == seeds[0]:
                flight.fly(rebound, seed, 1)  # compiles, and fills the tables
                log.set_up = flight.fly(rebound, seed, 1)[0]
            seconds, table, log.reason = flight.fly(rebound, seed)
            if len(table) < flight.jumps:
                log.reason = log.reason or f"ended after {len(table)} jumps"
                continue
            while_quick = 2 if fixed else 4
            if seconds < REPEATED:
                seconds = min(seconds, *(flight.fly(rebound, seed)[0] for _ in range(while_quick)))
            log.tables[seed] = table[DISCARD:]
            log.seconds.append(max(seconds - log.set_up, 0.0) / (flight.jumps - 1))
    return logs


def record_of(flight: Flight, log: Log, logs: Mapping[Flight, Log], references: Mapping[int, Floats], means: Floats) -> dict[str, Any]:
    """Time and errors of one flight, ready for JSON."""
    contender = flight.contender
    row: dict[str, Any] = {
        "scheme": contender.scheme,
        "family": contender.family,
        "history": dict(contender.history),
        "method": flight.method,
        "size": flight.size,
        "jumps": flight.jumps,
        "seeds": len(log.tables),
        "reason": log.reason,
        "seconds": min(log.seconds, default=None),
    }
    if not log.tables:
        return row | dict.fromkeys((*QUANTITIES, "truncation"))
    tables = list(log.tables.values())
    row |= paired(tables, [references[seed] for seed in log.tables], means)
    twin = next((other for other in logs if is_twin(other, flight)), None)
    row["truncation"] = None
    if twin is not None and all(seed in logs[twin].tables for seed in log.tables):
        row["truncation"] = paired(tables, [logs[twin].tables[seed] for seed in log.tables], means)
    return row


def is_twin(other: Flight, flight: Flight) -> bool:
    """Whether `other` differs from `flight` by remembering the whole past, and by nothing else: the same polynomials, solver and step."""
    mine, its = flight.contender, other.contender
    alike = its.degree is not None and its.degree == mine.degree and (other.method, other.size) == (flight.method, flight.size)
    return alike and its.scheme == f"Exponential({its.degree})" != mine.scheme


def measured(rebound: str, names: Sequence[str], ladder: Sequence[float], seeds: Sequence[int], patience: float, kernel: str = "basset") -> dict[str, Any]:
    """All contenders in the sand scene, with one of its memories of rebounds and a kernel."""
    flights = collocations(rebound, kernel)
    for contender in CONTENDERS:
        if contender.scheme in names:
            for method in (IMPLICIT, HELD):
                flights += planned(contender, method, rebound, ladder, patience, kernel)
    references = {seed: exact(kernel=kernel).fly(rebound, seed)[1][DISCARD:] for seed in seeds}
    others = {seed: exact(rtol=10.0 * FINEST[kernel], kernel=kernel).fly(rebound, seed)[1][DISCARD:] for seed in seeds}
    means = np.mean([table.mean(axis=0) for table in references.values()], axis=0)
    logs = take_turns(flights, rebound, seeds, patience)
    apart = paired(list(others.values()), list(references.values()), means)
    scatter = [[statistics.standard_error(table[:, k]) for table in references.values()] for k in range(len(QUANTITIES))]
    return {
        "rebound": rebound,
        "flown": len(seeds),
        "mean": dict(zip(QUANTITIES, means, strict=True)),
        "unpaired_se": {name: float(np.mean(errors) / means[k]) for k, (name, errors) in enumerate(zip(QUANTITIES, scatter, strict=True))},
        "reference_apart": max(apart[name]["max"] for name in QUANTITIES),
        "duration": float(np.mean([saltation.run(scene_of(exact(kernel=kernel).scene(rebound, seed))).jumps["duration"].mean() for seed in seeds[:1]])),
        "records": [record_of(flight, log, logs, references, means) for flight, log in logs.items()],
    }


def run(full: bool) -> dict[str, Any]:
    """Errors of the mean jump and time of a jump, for every scheme, window and solver."""
    ladder, seeds, patience = (LADDER, (1, 2, 3), 3.0) if full else (LADDER[:3], (1, 2), 0.6)
    return {
        "jumps": JUMPS,
        "short": SHORT,
        "discard": DISCARD,
        "seeds": len(seeds),
        "reference": REFERENCE,
        "thesis": THESIS,
        "impulse": measured("impulse", [contender.scheme for contender in CONTENDERS], ladder, seeds, patience),
        "reset": measured("reset", FEWER, ladder, seeds, patience),
        **{kernel: measured("impulse", FOLLOWING, ladder, seeds, patience, kernel) for kernel in FINEST if kernel != "basset"},
        "combinations": combinations.rows(),
    }
