"""Is the scheme that `basset.advise` recommends as accurate as predicted, and how much slower than the fastest that meets the error?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import basset
from basset import BassetKernel, Kernel, MeiAdrianKernel, Rule, advice, measure, reference
from basset.advice import SIZES, Family, Job
from basset.evaluate import PLANS
from basset.kernels import Floats
from basset.problems import PROBLEMS
from basset.weights.table import TABLES
from bench.grains import rounded

ERRORS = (1e-3, 1e-6, 1e-9)
GIVEN = 1.0 / 12.0  # the step where it is given, in time scales
SAMPLED = 1.0 / 8.0  # the step of samples that stand for a problem, in its time scales
STRETCH = 2**14  # such samples at most
SLOWER = 5.0  # candidates that are predicted to take so many times as long as the advised one are left out
MEI, DORGAN = MeiAdrianKernel(0.1, 1e-3, 1e-6), MeiAdrianKernel.dorgan_loth(0.02, 2e-3, 1e-6)
FINE = basset.Daitche(9)  # where there is no closed form: at 1/64 of a time scale and less

Function = Callable[[Floats], Floats]
Rival = tuple[Rule, float, int]  # with its step and the number of steps


@dataclass(frozen=True)
class Case:
    """A rate, and what `advise` is given of it."""

    name: str
    description: str
    rate: Function  # g(t), seconds to (nodes,) or (nodes, columns)
    scale: float  # s, given to `advise`, unless `samples`
    length: float  # s
    exact: Function | None = None  # H(t) from the second node on; None: a finer run of a high order
    kernel: Kernel = BassetKernel()
    particles: int = 1
    components: int = 1
    initial_slip: float = 0.0
    samples: bool = False  # whether `advise` gets a stretch of the rate instead of the scale

    def truth(self, dt: float, steps: int) -> Floats:
        """H at every node but the first."""
        if self.exact is not None:
            return self.exact(dt * np.arange(1, steps + 1))
        parts = max(2, math.ceil(64.0 * dt / self.scale))
        fine = self.rate(dt / parts * np.arange(steps * parts + 1))
        return basset.cumulate(fine, dt / parts, FINE, self.kernel)[parts::parts]

    def told(self) -> dict[str, Any]:
        """The arguments of `advise` that describe the rate."""
        if not self.samples:
            return {"time_scale": self.scale}
        step = SAMPLED * self.scale
        return {"samples": self.rate(step * np.arange(min(STRETCH, int(self.length / step)) + 1)), "sample_step": step}


def cases() -> Iterator[Case]:
    """The problems; none of them is the model of `basset.advice`."""
    for name, scale in (("fresnel", 1.0), ("high_frequency", 1 / 40)):
        problem = PROBLEMS[name]
        assert problem.rate is not None
        yield Case(name, problem.description, problem.rate, scale, problem.end, problem.exact)
    for name, scale in (("growth", 1.0), ("sine_with_slip", 1.0), ("power_10", 0.1)):  # short paths: for many particles
        problem = PROBLEMS[name]
        assert problem.rate is not None
        wide = {"rate": repeated(problem.rate, 300), "exact": repeated(problem.exact, 300), "particles": 100, "components": 3}
        case = Case(name, f"{problem.description}, 100 particles", scale=scale, length=problem.end, initial_slip=problem.initial_slip, **wide)
        yield case
        if name != "sine_with_slip":  # no oscillation: a time scale says less than samples
            yield replace(case, name=f"{name}, sampled", description=f"{case.description}, from samples", samples=True)
    yield waves("long", "cos(t + 1) to t = 3000", {1j: np.exp(1j)}, 1.0, 3000.0)
    yield waves("damped", "e^(−t/10) cos 3t to t = 100", {-0.1 + 3j: 1.0}, 1 / 3, 100.0)
    yield waves("swelling", "e^(t/20) cos(2t + 1) to t = 60", {0.05 + 2j: np.exp(1j)}, 1 / 2, 60.0)
    yield waves("two_decays", "e^(−t/9) − e^(−t/2) to t = 200, 30 particles", {-1 / 9 + 0j: 1.0, -0.5 + 0j: -1.0}, 2.0, 200.0, particles=30, components=3)
    yield waves("two_tones", "cos t + cos(√7 t + 2) to t = 300", {1j: 1.0, 7**0.5 * 1j: np.exp(2j)}, 7**-0.5, 300.0)
    yield waves("ripple", "cos t + cos(10t)/10 to t = 200, from samples", {1j: 1.0, 10j: 0.1}, 0.1, 200.0, samples=True)
    yield waves("mean", "1 + cos(20t)/20 to t = 100, from samples", {0j: 1.0, 20j: 0.05}, 0.05, 100.0, samples=True)
    generator = np.random.default_rng(5)
    modes = {2j * math.pi * f: f ** (-5 / 6) * np.exp(2j * math.pi * generator.random()) for f in np.geomspace(0.05, 1.0, 24)}
    yield waves("turbulent", "24 modes of a spectrum f^(−5/3), 0.05 to 1 Hz, to t = 200, from samples", modes, 0.5 / math.pi, 200.0, samples=True)
    yield Case("pulse", "e^(−(t−6)²/2) to t = 12, from samples", lambda t: np.exp(-0.5 * (t - 6.0) ** 2), 0.5, 12.0, samples=True)
    yield Case("poles", "1/(1 + (t−10)²) to t = 40, from samples", lambda t: 1.0 / (1.0 + (t - 10.0) ** 2), 0.4, 40.0, samples=True)
    yield Case("mei_adrian", "cos 2t, Mei–Adrian at 10 cm/s, 1 mm in water, to t = 100", lambda t: np.cos(2.0 * t), 0.5, 100.0, kernel=MEI)
    yield Case(
        "dorgan_loth", "sin 30t + sin 11t, Dorgan–Loth at 2 cm/s, 2 mm, to t = 20", lambda t: np.sin(30.0 * t) + np.sin(11.0 * t), 1 / 30, 20.0, kernel=DORGAN
    )
    speeds = generator.uniform(0.3, 1.0, 900)
    yield Case(
        "crowd",
        "300 particles × 3, each cos ωt with its own ω up to 1, to t = 60",
        lambda t: np.cos(t[:, None] * speeds),
        1.0,
        60.0,
        lambda t: np.stack([reference.cosine(t, omega) for omega in speeds], axis=1),
        particles=300,
        components=3,
    )


def repeated(function: Function, columns: int) -> Function:
    """The same in so many columns."""
    return lambda t: np.repeat(np.asarray(function(t))[:, None], columns, axis=1)


def waves(name: str, description: str, modes: dict[complex, complex], scale: float, length: float, **more: Any) -> Case:
    """A rate g = Re Σ a e^(st) over modes s with amplitudes a."""

    def rate(t: Floats) -> Floats:
        return np.asarray(sum(np.real(a * np.exp(s * t)) for s, a in modes.items()))

    def exact(t: Floats) -> Floats:
        return np.asarray(sum(np.real(a * reference.exponential(t, s if s else 0.0)) for s, a in modes.items()))

    columns = more.get("particles", 1) * more.get("components", 1)
    wide = (repeated(rate, columns), repeated(exact, columns)) if columns > 1 else (rate, exact)
    return Case(name, description, wide[0], scale, length, wide[1], **more)


class Trial:
    """One case with one error, use and kind of step: advice, true errors, times."""

    def __init__(self, case: Case, error: float, use: str, dt: float | None, truths: dict[float, Floats]) -> None:
        self.case, self.error, self.use, self.dt, self.truths = case, error, use, dt, truths
        self.asked = {"particles": case.particles, "components": case.components, "kernel": case.kernel, "use": use}

    def true_error(self, rule: Rule, dt: float, steps: int, scale: float) -> float:
        """Largest error from one time scale on over the largest |H|."""
        if dt not in self.truths:
            self.truths[dt] = self.case.truth(dt, steps)
        exact = self.truths[dt]
        g = self.case.rate(dt * np.arange(steps + 1))
        found = basset.cumulate(g, dt, rule, self.case.kernel, initial_slip=self.case.initial_slip)[1:]
        settled = min(steps, math.ceil(scale / dt)) - 1
        with np.errstate(invalid="ignore"):
            largest = np.abs(exact[settled if self.case.initial_slip else 0 :]).max()
        return float(np.abs(found - exact)[settled:].max() / largest)

    def call(self, rule: Rule, dt: float, steps: int) -> Callable[[], Any]:
        """The whole path; the scheme is ready."""
        g, kernel, slip = self.case.rate(dt * np.arange(steps + 1)), self.case.kernel, self.case.initial_slip
        if self.use == "path":
            return lambda: basset.cumulate(g, dt, rule, kernel, initial_slip=slip)
        plan, shape = rule.plan(dt, steps * dt, kernel), g.shape[1:]

        def stream() -> None:
            state = plan.start(shape)
            plan.run(state, g[:1])
            if slip:
                plan.jump(state, slip)
            plan.run(state, g[1:])

        return stream

    def advised(self) -> advice.Advice:
        """What is advised."""
        length = {"duration": self.case.length} if self.dt is None else {"dt": self.dt, "duration": self.case.length}
        return basset.advise(self.error, **self.case.told(), **length, **self.asked)

    def row(self, found: advice.Advice, rounds: int) -> dict[str, Any]:
        """How accurate it is, and how much slower than the fastest that meets the error."""
        best = found.best
        error = self.true_error(best.rule, best.dt, best.steps, found.time_scale)
        columns = self.case.particles * self.case.components
        signal = advice.model(found.time_scale, self.case.length)
        job = Job(
            self.error, self.case.length, columns, self.case.kernel, math.inf, self.use, signal, advice.calibrated(), 1.0 / signal.scale, signal.scale**-0.5
        )
        rivals = [rival for family in advice.families(job) if (rival := self.longest(job, family, SLOWER * best.seconds)) is not None]
        TABLES.clear()  # what the search has left behind would slow down every look into the caches
        PLANS.clear()
        calls = {rival: self.call(*rival) for rival in rivals}
        advised = (best.rule, best.dt, best.steps)
        calls[advised] = self.call(*advised)
        seconds = measure.interleaved(calls, rounds=rounds, seconds=0.003)
        fastest = min(seconds, key=lambda rival: seconds[rival])
        last = measure.interleaved({rival: calls[rival] for rival in {fastest, advised}}, rounds=6 * rounds, seconds=0.003)
        taken, least = min(seconds[advised], last[advised]), min(*seconds.values(), *last.values())
        return {
            "case": self.case.name,
            "error": self.error,
            "use": self.use,
            "step": "chosen" if self.dt is None else "given",
            "told": "samples" if self.case.samples else "time scale",
            "time_scale": found.time_scale,
            "scheme": short(best.rule),
            "steps": best.steps,
            "predicted": best.error,
            "measured": error,
            "meets": error <= self.error,
            "seconds": taken,
            "predicted_seconds": best.seconds,
            "ratio": taken / least,
            "fastest": short(fastest[0]),
            "fastest_steps": fastest[2],
            "candidates": len(rivals),
        }

    def longest(self, job: Job, family: Family, most: float) -> Rival | None:
        """The rule at the longest step, or the given one, at which its true error is small enough, in `most` seconds."""
        if self.dt is not None:
            return None if too_slow(job, family, self.dt, most) else self.tried(job, family, self.dt)
        found, low, high = None, 0, len(SIZES) - 1
        while low <= high:
            middle = (low + high) // 2
            dt = float(job.signal.scale * SIZES[middle])
            rival = None
            if (slow := too_slow(job, family, dt, most)) or (rival := self.tried(job, family, dt)) is not None:
                found, high = rival if not slow else found, middle - 1
            else:
                low = middle + 1
        return found

    def tried(self, job: Job, family: Family, dt: float) -> Rival | None:
        """The rule at this step if its true error is small enough."""
        steps = job.steps(dt)
        try:
            rule = family(dt)
            return (rule, dt, steps) if self.true_error(rule, dt, steps, job.signal.scale) <= self.error else None
        except ValueError:
            return None


def too_slow(job: Job, family: Family, dt: float, most: float) -> bool:
    """Whether a rule is predicted to take more than `most` seconds."""
    steps = job.steps(dt)
    try:
        rule = family(dt)
        recipe = rule.recipe(dt, steps * dt, job.kernel)
    except ValueError:
        return False
    return advice.expense(recipe, steps, job.columns, job.use, job.machine)[0] > most


def short(rule: Rule) -> str:
    """A rule as tables name it."""
    text = repr(rule).replace("order=", "").replace("rtol=", "").replace("rule=", "")
    return text if len(text) < 40 else f"Windowed({repr(rule.whole).replace('order=', '')}, fitted tail)"


def run(full: bool) -> dict[str, Any]:
    """Measure."""
    rows, refused = [], []
    for case in cases():
        truths: dict[float, Floats] = {}
        for error in ERRORS:
            for use in advice.USES:
                for dt in (None, GIVEN * case.scale):
                    trial = Trial(case, error, use, dt, truths)
                    found = trial.advised()
                    if any(candidate.meets for candidate in found.candidates):
                        rows.append(trial.row(found, 7 if full else 3))
                    else:
                        refused.append({"case": case.name, "error": error, "use": use, "least": found.candidates[0].error})
    described = {case.name: case.description for case in cases()}
    return {"descriptions": described, "given": GIVEN, "rows": rounded(rows), "refused": rounded(refused)}
