"""Scene -> Result: fly one grain or many, keep their jumps and paths, and say how the result came about."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable
from concurrent.futures import Executor, as_completed
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from basset.kernels import BassetKernel, Floats
from basset.solvers import stepper
from basset.solvers._tables import step_tables
from saltation._keys import text_of
from saltation.coupling import settle
from saltation.flight import collisions, layout
from saltation.flight.cloud import ROUNDED, Cloud, starts
from saltation.flight.cost import CHUNK, cost_of
from saltation.flight.fixed import FixedGrain
from saltation.flight.setup import Engine, Grain, Start, empty_record
from saltation.flow import velocity_and_shear
from saltation.results.files import STOPPED, open_folder, packed, unpacked
from saltation.results.folder import Folder, RunStatus, begun
from saltation.results.path import path_at, path_of
from saltation.results.result import Result, origin
from saltation.results.tables import encounter_table, fate_table, ordered, path_dataset, table_of, tables_to_dataset
from saltation.scene import LONGEST, Scene, scene_of

ROWS = 4096  # steps between two returns from compiled code
STILL = 5.0  # jumps without flight in a row at the end of a run, or all of them: the grain is at rest
RENEWED = 16  # the same without a bed, where the Jacobian is renewed at each
MOST_KEPT = 2**16  # steps of a path without jumps; of a longer one every second, every fourth, … is kept
WIDER = 1e3  # reach of a longer memory over that of the one before, where nothing jumps any more
GROWTH = 64.0  # largest factor by which a memory that was too short is made longer
SLIDING = 1e-3  # u*: a grain at the bed that is faster creeps, a slower one is at rest
BLOCKS = 128  # most blocks of grains that do not meet
PART = 2**19  # kept positions in a part of a run: 25 MB
SLICE = 4096  # grains × sampling intervals between two reports of progress
STATUS = {  # by code: status and message of a result
    layout.JUMPS: ("finished", "all jumps are done"),
    stepper.END: ("finished", "run.duration is reached"),
    layout.REST: ("at rest", "the grain lies still: impacts follow each other without flight"),
    layout.ALOFT: ("aloft", "flight time exceeded run.longest_flight (grain suspended)"),
    layout.HORIZON: ("horizon", "the run lasts longer than history.horizon: leave that out, so that it grows with the run, or set it longer"),
    stepper.TOO_SMALL: ("failed", "the step size fell below its floor: the accuracy asked for cannot be reached"),
    stepper.NOT_FINITE: ("failed", "a rate was not finite, or the stages did not converge"),
    stepper.TOO_MANY: ("failed", "too many steps"),
    collisions.UNTIL: ("finished", "run.duration is reached"),
    collisions.PILE_UP: ("pile-up", "a grain had more than encounters.pile_up encounters within one d/u*"),
}


def run(
    scene: Scene, progress: Callable[[float], None] | None = None, output: str | os.PathLike[str] | None = None, executor: Executor | None = None
) -> Result:
    """Simulate a scene whose effects are given; as `saltation.run`."""
    if scene.coupling is not None and scene.coupling.form == "two_way" and scene.coupling.settled is None:
        return run_coupled(scene, progress, output, executor)
    return run_uncoupled(scene, progress, output, executor)


def run_uncoupled(
    scene: Scene, progress: Callable[[float], None] | None, output: str | os.PathLike[str] | None = None, executor: Executor | None = None
) -> Result:
    """Run a scene in its profile as it is."""
    if scene.cloud is None:
        return run_one(scene, progress)
    if executor is not None:
        return run_blocks(scene, executor, progress)
    return run_cloud(scene, progress, output)


def run_coupled(scene: Scene, progress: Callable[[float], None] | None, output: str | os.PathLike[str] | None, executor: Executor | None) -> Result:
    """Run a scene whose stream feels the grains until both agree; into a folder once they do."""
    if output is None:
        return settle(scene, lambda made, report: run_uncoupled(made, report, executor=executor), progress)
    found = begun(scene, output)
    if found is None:
        found = settle(scene, run_uncoupled, progress).scene
    return run_uncoupled(found, None, output)


# One grain


def run_one(scene: Scene, progress: Callable[[float], None] | None) -> Result:
    """Simulate one grain, anew with a longer memory where that was too short."""
    seen = 0.0

    def report(share: float) -> None:  # never decreases, also where a run begins anew
        nonlocal seen
        seen = max(seen, share)
        if progress is not None:
            progress(seen)

    engine = Engine(scene)
    while True:
        result = fly(engine, report)
        horizon = wider(engine, result) if result.status == "horizon" else None
        if horizon is None:
            return result
        engine = Engine(scene, horizon)


def wider(engine: Engine, result: Result) -> float | None:
    """The memory (d/V) with which a run that outlasted it can do its jumps, by the flights seen; None if there is none."""
    scene, before = engine.scene, engine.horizon
    given = scene.options("history").horizon
    most = LONGEST if given is None else given
    if not before < most:
        return None
    jumps = len(result.all_jumps)
    wanted = 1.25 * before * (scene.run.jumps or 1) / jumps if jumps else math.inf
    horizon = float(min(most, max(2.0 * before, min(wanted, GROWTH * before))))
    if scene.solver.method != "collocation":
        try:
            scene.steps_of(horizon)
        except ValueError:
            return None
    return horizon


def fly(engine: Engine, report: Callable[[float], None]) -> Result:
    """One grain from its start to the end of the run or of the memory."""
    scene, wanted = engine.scene, engine.scene.run.jumps
    fixed = scene.solver.method != "collocation"
    grain = FixedGrain(engine) if fixed else Grain(engine)
    rows: list[Floats] = []
    kept: RecordedSteps | FixedNodes = FixedNodes(grain) if fixed else RecordedSteps(None if scene.bed is not None else MOST_KEPT)
    longer = [LongerMemory(engine, grain)] if engine.problem.end < engine.end else []
    while longer and longer[-1].engine.problem.end < engine.end:
        longer.append(LongerMemory(longer[-1].engine, grain))
    recording = scene.run.trajectory or scene.bed is None
    aloft = scene.bed is None  # steps grow, and rounding errors of the velocities count in the positions: the Jacobian is renewed often
    table = np.zeros((min(wanted or ROWS, ROWS), len(layout.COLUMNS)))
    record: Any = (
        grain.record if isinstance(grain, FixedGrain) else empty_record(RENEWED if aloft else ROWS if recording else 1, engine.tables.count, engine.states)
    )
    while True:
        if aloft:
            grain.state.control[0].jacobian_known = False
        grain.flight[0].done = 0
        code, done = grain.fly(record, recording, table)
        rows.append(table[: grain.flight[0].done].copy())
        if scene.run.trajectory:
            kept.add(record, done, grain)
        for other in longer:
            other.follow(record, done)
        report(min(1.0, float(grain.flight[0].taken / wanted if wanted else grain.state.control[0].time / engine.end)))
        if code == layout.REST and scene.rests is not None:
            if wanted and grain.flight[0].taken >= wanted:
                code = layout.JUMPS
                break
            grain.rest()
            if grain.state.control[0].time >= engine.end:
                grain.state.control[0].time, code = engine.end, stepper.END
                break
        elif code == stepper.END and longer:
            grain = longer.pop(0).take_over(grain)
        elif code not in (stepper.FULL, layout.CROWDED):
            break
    whole, engine = np.concatenate(rows), grain.engine
    spins = np.vstack([whole[:, -3:], grain.spin[:3]])  # at the end of every flight
    jumps, path = table_of(whole, engine.numbers.stokes(1.0)), partial(kept.path, engine, spins) if scene.run.trajectory else None
    return Result(scene, jumps, *ending(code, grain), origin(scene), float(grain.state.control[0].time), path=path)


def ending(code: int, grain: Grain) -> tuple[str, str]:
    """Status and why, from the code with which a flight ended."""
    short = grain.flight[0].short
    if code == layout.JUMPS and short >= min(STILL, grain.flight[0].taken):
        code = layout.REST
    if STATUS.get(code, ("failed",))[0] == "failed" and float(grain.state.control[0].time) > grain.engine.horizon:
        code = layout.HORIZON  # a step that outlasts its memory cannot be exact
    if code == layout.REST and abs(grain.flight[0].u) > SLIDING:
        return "creeping", "the grain slides along the bed: impacts follow each other without flight"
    diverged = "the steps diverge: take a smaller solver.dt or a lower history.order" if isinstance(grain, FixedGrain) else "the flight stopped"
    return STATUS.get(code, ("failed", diverged))


class LongerMemory:
    """A memory with a longer reach that is advanced beside another one and replaces it where that ends."""

    def __init__(self, before: Engine, grain: Grain) -> None:
        self.engine = Engine(before.scene, min(before.scene.horizon, WIDER * before.horizon))
        self.past = np.repeat(grain.state.jump[:, None], len(self.engine.rates), axis=1)
        self.known: dict[tuple[float, float], tuple[Floats, Floats]] = {}

    def follow(self, record: stepper.Record, done: int) -> None:
        """Advance it by the recorded steps."""
        engine, tables, tail, where = self.engine, self.engine.tables, self.engine.tables.tail, self.engine.problem.where
        assert tail is not None
        for h, kind, share, values in zip(record.size[:done], record.kind[:done], record.share[:done], record.values[:done], strict=True):
            if share < 1.0:
                none = np.zeros(0)
                state = stepper.State(none, none, self.past, np.zeros(len(where)), none, none)
                stepper.truncate_memory(where, tables.nodes, engine.truncation, state, h, share, int(kind), values)
                continue
            if (h, kind) not in self.known:
                _, decays, moments, *_ = step_tables(tables.count, tail, BassetKernel(), [h], bool(kind))
                self.known[h, kind] = decays[0], moments[0]
            decay, gained = self.known[h, kind]
            self.past = decay * self.past + values[:, where].T @ gained

    def take_over(self, grain: Grain) -> Grain:
        """The grain with this memory."""
        other, state = Grain(self.engine), grain.state
        state.jump[:] = 0.0
        other.state = state._replace(past=np.ascontiguousarray(self.past))
        other.spin, other.flight, other.values = grain.spin, grain.flight, grain.values
        return other


class RecordedSteps:
    """The recorded steps, thinned where there are more than `most`."""

    def __init__(self, most: int | None) -> None:
        self.most, self.every, self.seen = most, 1, 0
        self.parts: list[stepper.Record] = []
        self.last: stepper.Record | None = None

    def add(self, record: stepper.Record, done: int, grain: Grain) -> None:
        """Keep what was recorded."""
        if not done:
            return
        first = -self.seen % self.every
        self.parts.append(stepper.Record(*(array[first : done : self.every].copy() for array in record)))
        self.last = stepper.Record(*(array[done - 1 : done].copy() for array in record))
        self.seen += done
        if self.most is not None and self.seen > self.most * self.every:
            self.parts = [stepper.Record(*(array[::2].copy() for array in joined(self.parts)))]
            self.every *= 2

    def whole(self) -> stepper.Record | None:
        """All that is kept, the last step too; None if there is nothing."""
        if self.last is None:
            return None
        left_out = (self.seen - 1) % self.every != 0
        return joined([*self.parts, self.last] if left_out else self.parts)

    def path(self, engine: Engine, spins: Floats) -> xr.Dataset:
        """The path; `spins` at the end of every flight (flight, 3)."""
        return path_of(engine, self.whole(), spins)


class FixedNodes:
    """The nodes of fixed steps, and the takeoffs, where rates are unknown."""

    def __init__(self, grain: Grain) -> None:
        self.kept: list[Floats] = []
        self._take_off(grain)

    def _take_off(self, grain: Grain) -> None:
        y = grain.state.y
        self.kept.append(np.concatenate([[grain.state.control[0].time], y, np.full(len(y), np.nan)])[None])

    def add(self, record: Any, done: int, grain: Grain) -> None:
        """Keep what was recorded, and where the grain took off behind it."""
        self.kept.append(np.column_stack([record.times[:done], record.states[:done], record.rates[:done]]))
        if grain.flight[0].done:
            self._take_off(grain)

    def path(self, engine: Engine, spins: Floats) -> xr.Dataset:
        """The path; `spins` at the end of every flight (flight, 3)."""
        whole, n = np.concatenate(self.kept), engine.states
        which = np.cumsum(np.isnan(whole[:, -1])) - 1  # flight of each point
        return path_at(engine, whole[:, 0], whole[:, 1 : 1 + n], whole[:, 1 + n :], spins[which])


def joined(parts: list[stepper.Record]) -> stepper.Record:
    """Records one after the other."""
    return stepper.Record(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


# Many grains


class Part:
    """One part of a run: its jumps, encounters and kept positions."""

    def __init__(self, engine: Engine, grains: range, first: int, count: int) -> None:
        self.engine, self.grains, self.first = engine, grains, first
        scene = engine.scene
        self.interval = scene.grains.interval
        shape = (count if scene.run.trajectory else 0, len(grains), 2 * engine.dimensions)
        self.samples = collisions.Samples(self.interval, np.array([first]), np.full(shape, np.nan))
        self.owners: list[Floats] = []
        self.jumps: list[Floats] = []
        self.met: list[Floats] = []

    def empty(self, logs: collisions.Logs) -> None:
        """Take what is in the logs."""
        count = logs.count[0]
        self.owners.append(logs.owners[: count.jumps] + np.int32(self.grains.start))
        self.jumps.append(logs.jumps[: count.jumps].copy())
        self.met.append(logs.encounters[: count.encounters].view(np.float64).reshape(-1, len(layout.ENCOUNTER_COLUMNS)).copy())
        count.jumps = count.encounters = 0

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Jumps and collisions."""
        jumps = table_of(np.concatenate(self.jumps), self.engine.numbers.stokes(1.0), np.concatenate(self.owners))
        return jumps, encounter_table(np.concatenate(self.met))

    def path(self, until: float) -> Any:
        """Kept positions up to a time; None if none are kept."""
        if not len(self.samples.values):
            return None
        times = (self.first + np.arange(len(self.samples.values))) * self.interval
        done = times <= until * ROUNDED
        path = path_dataset(self.engine.scene, times[done], self.samples.values[done])
        return path.assign_coords(grain=path["grain"] + np.int32(self.grains.start))

    def dataset(self, until: float) -> Any:
        """All of it."""
        whole, path = tables_to_dataset(self.engine.scene, *self.tables()), self.path(until)
        return whole if path is None else whole.merge(path, combine_attrs="override")


def fly_part(cloud: Cloud, part: Part, begin: float, end: float, fates: list[Any], progress: Callable[[float], None]) -> tuple[int, float, int]:
    """Fly one part; (code, time reached, grain that stopped it)."""
    slices = max(1, math.ceil((end - begin) * len(cloud.state.clock) / (SLICE * part.interval)))
    code, grain, clock = collisions.UNTIL, 0, begin
    for lying in cloud.resting(begin):
        cloud.lie(int(lying), part.samples)
    for k in range(1, slices + 1):
        until = end if k == slices else begin + k * (end - begin) / slices
        for code, grain in cloud.advance(until, part.samples):
            part.empty(cloud.logs)
            if code == layout.REST and cloud.engine.scene.rests is not None:
                cloud.rest(grain, part.samples)
            elif code in (layout.REST, layout.ALOFT):
                slides = abs(cloud.speed_of(grain)) > SLIDING
                fate = "aloft" if code == layout.ALOFT else "creeping" if slides else "at rest"
                fates.append([cloud.grains.start + grain, float(cloud.state.control[grain].time), fate])
        if code != collisions.UNTIL:
            return code, float(cloud.state.clock[grain]) if cloud.domain is not None else clock, grain
        clock = until
        progress(until)
    return code, clock, grain


def note_encounters(cloud: Cloud, known: dict[str, Any]) -> None:
    """Add the pair law, the box and the unresolved steps to the provenance of a run with encounters."""
    if cloud.domain is not None:
        scene = cloud.engine.scene
        known |= {"encounters": scene.options("encounters").model_dump(), "box": scene.box, "unresolved_steps": int(cloud.logs.count[0].unresolved)}


def run_cloud(
    scene: Scene,
    progress: Callable[[float], None] | None = None,
    output: str | os.PathLike[str] | None = None,
    grains: range | None = None,
) -> Result:
    """Simulate many grains, or without encounters some of them; as `saltation.run`."""
    with Folder(output, scene) if output is not None else contextlib.nullcontext() as folder:
        if scene.solver.method != "collocation":
            return fly_apart(scene, progress, folder, grains)
        return fly_cloud(scene, progress, folder, grains)


def fly_apart(scene: Scene, progress: Callable[[float], None] | None, folder: Folder | None, grains: range | None) -> Result:
    """Grains at fixed steps, which do not meet: one after the other, in one part."""
    if folder is not None and folder.read_status() is not None:
        return open_folder(folder.path)
    engine, end, interval, known = Engine(scene), scene.end, scene.grains.interval, origin(scene)
    part = Part(engine, range(scene.grains.number) if grains is None else grains, 0, math.floor(end / interval * ROUNDED) + 1)
    places = list(zip(*starts(engine), strict=True))
    fates: list[Any] = []
    status, message, reached = *STATUS[stepper.END], end
    for i, grain in enumerate(part.grains):
        one = FixedGrain(engine, grain, Start(*(tuple(values) for values in places[grain])))
        code, rows = fly_alone(one, interval, part.samples.values[:, i])
        part.jumps.append(rows)
        part.owners.append(np.full(len(rows), grain, dtype=np.int32))
        time = float(one.state.control[0].time)
        if code in (layout.REST, layout.ALOFT):
            speed = one.state.y[engine.dimensions] + velocity_and_shear(engine.profile, one.state.y[engine.dimensions - 1])[0]
            fates.append([grain, time, "aloft" if code == layout.ALOFT else "creeping" if abs(speed) > SLIDING else "at rest"])
        elif code != stepper.END:
            status, message = ending(code, one)
            message, reached = f"grain {grain}: {message}", time
            break
        if progress is not None:
            progress((i + 1) / len(part.grains))
    part.met.append(np.zeros((0, len(layout.ENCOUNTER_COLUMNS))))
    if folder is not None:
        folder.put(0, part.dataset(reached), reached)
        folder.write_status(RunStatus(1, reached, status, message, fates), known)
        return open_folder(folder.path)
    jumps, met = part.tables()
    return Result(scene, ordered(jumps), status, message, known, reached, met, fate_table(fates), part.path(reached))


def fly_alone(grain: FixedGrain, interval: float, samples: Floats) -> tuple[int, Floats]:
    """Fly a grain of a cloud to the end of its run: (code, rows of jumps); position and velocity every `interval` into `samples` (time, 2·dimensions)."""
    engine, rows, d, code = grain.engine, [np.zeros((0, len(layout.COLUMNS)))], grain.engine.dimensions, stepper.FULL
    table, times = np.zeros((ROWS, len(layout.COLUMNS))), np.arange(len(samples)) * interval
    while code in (stepper.FULL, layout.CROWDED):
        before, state = float(grain.state.control[0].time), grain.state.y.copy()
        grain.flight[0].done = 0
        code, done = grain.fly(grain.record, False, table)
        rows.append(table[: int(grain.flight[0].done)].copy())
        if not done:
            continue
        at, states = np.append(before, grain.record.times[:done]), np.vstack([state, grain.record.states[:done]])
        kept = states[:, : 2 * d].copy()
        kept[:, d] += [velocity_and_shear(engine.profile, z)[0] for z in states[:, d - 1]]
        inside = (times >= before) & (times <= at[-1])
        samples[inside] = np.column_stack([np.interp(times[inside], at, column) for column in kept.T])
    return code, np.concatenate(rows)


def fly_cloud(scene: Scene, progress: Callable[[float], None] | None, folder: Folder | None, grains: range | None) -> Result:
    """Many grains from where they are to the end of the run, part by part."""
    engine = Engine(scene)
    cloud = Cloud(engine, grains)
    end, interval = scene.end, scene.grains.interval
    count = max(1, PART // scene.grains.number)  # samples of a part
    every = math.floor(end / interval * ROUNDED) + 1
    stretch = count * interval
    last = max(1, math.ceil(end / stretch * (1.0 - 1e-12)))
    known = origin(scene)
    now = RunStatus(0, 0.0, *STOPPED, [])
    if folder is not None:
        if (before := folder.read_status()) is not None and before["status"] != STOPPED[0]:
            return open_folder(folder.path)
        now = folder.load_checkpoint(cloud.arrays())
        note_encounters(cloud, known)
        folder.write_status(now, known)  # of a run that was killed between its checkpoint and its status

    def report(time: float) -> None:
        if progress is not None:
            progress(min(1.0, time / end))

    parts: list[Part] = []
    while now.status == STOPPED[0]:
        k = now.parts
        part = Part(engine, cloud.grains, k * count, every - k * count if k + 1 == last else count)  # the end itself belongs to the last one
        code, reached, grain = fly_part(cloud, part, k * stretch, min(end, (k + 1) * stretch), now.fates, report)
        note_encounters(cloud, known)
        status, message = STATUS[code] if code != collisions.UNTIL or k + 1 == last else STOPPED
        now = RunStatus(k + 1, reached, status, message if code == collisions.UNTIL else f"grain {cloud.grains.start + grain}: {message}", now.fates)
        if folder is None:
            parts.append(part)
        else:
            folder.put(k, part.dataset(reached), reached)
            folder.save_checkpoint(cloud.arrays(), now)
            folder.write_status(now, known)
    if folder is not None:
        return open_folder(folder.path)
    tables = [part.tables() for part in parts]
    jumps = ordered(pd.concat([own for own, _ in tables], ignore_index=True))
    met = pd.concat([met for _, met in tables], ignore_index=True)
    paths = [path for part in parts if (path := part.path(now.time)) is not None]
    path = xr.concat(paths, "time", data_vars="all") if paths else None
    return Result(scene, jumps, now.status, now.message, known, now.time, met, fate_table(now.fates), path)


def fly_block(text: str, first: int, last: int) -> bytes:
    """Some grains of a scene in JSON, packed: what a worker is given."""
    return packed(run_cloud(scene_of(json.loads(text)), grains=range(first, last)), "")


def run_blocks(scene: Scene, executor: Executor, progress: Callable[[float], None] | None) -> Result:
    """Simulate many grains over an executor, in blocks if they do not meet; the bits are those of one piece."""
    number, text = scene.grains.number, text_of(scene)
    block = number if "encounters" in scene.names else math.ceil(number / min(BLOCKS, math.ceil(cost_of(scene) / CHUNK)))
    futures = {executor.submit(fly_block, text, first, min(number, first + block)): first for first in range(0, number, block)}
    found: dict[int, Result] = {}
    try:
        for future in as_completed(futures):
            found[futures[future]] = unpacked(future.result())
            if progress is not None:
                progress(len(found) / len(futures))
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    parts = [found[first] for first in sorted(found)]
    if len(parts) == 1:
        return parts[0]
    if any(part.status != "finished" for part in parts):
        return run_cloud(scene, progress)  # the run ends where its first grain fails: in one piece
    jumps = pd.concat([part.all_jumps for part in parts], ignore_index=True)
    fates = [row for part in parts for row in part.fates[["grain", "time", "fate"]].to_numpy().tolist()]
    path = xr.concat([part.trajectory for part in parts], "grain", data_vars="all") if scene.run.trajectory else None
    whole = parts[0]
    return Result(scene, jumps, whole.status, whole.message, whole.provenance, whole.time, whole.encounters, fate_table(fates), path)
