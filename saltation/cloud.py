"""Many grains: where they set out, the loop around `encounters.advance`, and long runs in part files that go on after any stop."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.spatial import cKDTree

from basset._compile import placed
from basset.kernels import Floats
from basset.solvers import stepper
from saltation._files import DamageError, only_writer, replacing, store, write
from saltation._keys import key_of, text_of
from saltation.flight import collisions as encounters
from saltation.flight import loop as flight
from saltation.flight.collisions import PILE_UP, UNTIL, empty_crowd
from saltation.flight.setup import DEFAULT_FIRST, NEVER, Engine, Grain, Start
from saltation.flow import both
from saltation.results.cloud import (
    STOPPED,
    CloudResult,
    encounter_table,
    fate_table,
    open_folder,
    ordered,
    part_in,
    path_dataset,
    tables_to_dataset,
    words_in,
    words_of,
)
from saltation.results.result import origin, packed, table_of, unpacked
from saltation.scene import SceneError, scene_of
from saltation.simulation import SLIDING, STATUS, empty_record
from saltation.study.campaigns import CHUNK, cost_of
from saltation.workers import TURN

SMALLEST_CELL = 2.0  # d
ROUNDS = 2000  # of placing grains that would overlap anew
COARSE = 1e3  # tolerance of a step between contacts that follow each other too closely
ROUNDED = 1.0 + 1e-12  # times this, a time is not before a multiple of the interval that is the same but for rounding
BLOCKS = 128  # of grains that do not meet, at most
BUFFER = 4096  # rows of jumps and of encounters between two visits of the caller


def starts(engine: Engine) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and spins (grain, 3) of a cloud that sets out: random, without overlap, a function of the seed."""
    scene = engine.scene
    cloud, (length, width, height), first = scene.cloud, scene.box, engine.first()
    number = cloud.number
    rng = np.random.Generator(np.random.Philox(scene.run.seed))
    scale = np.array([length, 0.0 if scene.in_plane else width, height])
    lowest = np.array([0.0, 0.0, first.position[2]])
    places = lowest + scale * rng.random((number, 3))
    fold = np.array([length, width, 0.0]) if cloud.boundary == "periodic" and not scene.in_plane else np.array([length, 0.0, 0.0])
    if cloud.boundary == "open":
        fold[:] = 0.0
    for _ in range(ROUNDS):
        pairs = cKDTree(places, boxsize=fold).query_pairs(1.0 + 1e-9, output_type="ndarray")
        if not len(pairs):
            break
        again = np.unique(pairs.max(axis=1))
        places[again] = lowest + scale * rng.random((len(again), 3))
    else:
        raise SceneError(f"cloud.concentration = {cloud.concentration:g} is too high: no room for {number} grains that do not touch")
    velocities = np.array(first.velocity) + cloud.spread * rng.standard_normal((number, 3))
    if scene.in_plane:
        velocities[:, 1] = 0.0
    return places, velocities, np.tile(first.spin, (number, 1))


class Cloud:
    """A cloud under way: all its grains as plain arrays, advanced as far as asked."""

    def __init__(self, engine: Engine, grains: range | None = None) -> None:
        """All grains, or some neighbouring ones: without encounters each flies as it would among all."""
        self.engine = engine
        scene, d, members = engine.scene, engine.dimensions, engine.members
        self.grains = range(scene.cloud.number) if grains is None else grains
        number, stages = len(self.grains), engine.tables.count
        self.crowd = empty_crowd(number, engine.states, members, len(engine.rates), stages)
        crowd = self.crowd
        for i, (position, velocity, spin) in enumerate(zip(*(values[self.grains.start : self.grains.stop] for values in starts(engine)), strict=True)):
            crowd.y[i] = engine.state_of(Start(tuple(position), tuple(velocity), tuple(spin)))
            crowd.spin[i, :3] = spin
            crowd.flight[i, [flight.X, flight.Y, flight.Z]] = position
            crowd.flight[i, flight.TOP] = position[2]
            crowd.flight[i, [flight.U, flight.V, flight.W]] = velocity
        crowd.jump[:] = crowd.y[:, d : d + members]
        crowd.numbers[:] = stepper.start_numbers(0.0, max(DEFAULT_FIRST, 2.0 * engine.problem.floor), members > 0)
        crowd.numbers[:, stepper.REFUSED] = NEVER
        crowd.spin[:, 3] = [flight.layer_of(engine.model, *up) for up in crowd.flight[:, [flight.Z, flight.W]].tolist()]
        self.world = self._world() if "encounters" in scene.names else None
        cells = self.world.along * self.world.across if self.world is not None else 0
        self.heads = np.full(cells, -1, dtype=np.int32)
        rows = max(BUFFER, number // 4)
        jumps, owners = np.zeros((rows, len(flight.COLUMNS))), np.zeros(rows, dtype=np.int32)
        self.logs = encounters.Logs(jumps, owners, np.zeros((BUFFER if self.world is not None else 0, len(encounters.COLUMNS))), np.zeros(4, dtype=np.int64))
        hand = Grain(engine)  # whose state any of them takes in turn
        problem = engine.problem._replace(end=math.inf)
        given = (engine.limits, engine.bed_of(self.grains.start), engine.memory(), hand.state, hand.spin, hand.flight, hand.values)
        self.steps, self.kept = engine.steps(*given, empty_record(0, stages, engine.states), jumps, problem=problem)
        coarse = problem._replace(rtol=COARSE * problem.rtol, atol=COARSE * problem.atol)
        whole = self.steps.flight.parts
        rough, self.kept_too = engine.attempt(whole, coarse)
        self.parts = placed(encounters.Parts(self.steps, rough))
        states, velocities = (whole.room.polynomial, np.zeros_like(whole.room.polynomial)), np.zeros((2, stages, 3))
        self.courses = tuple(placed(encounters.Course(*arrays)) for arrays in zip(states, velocities, strict=True))
        self.given = placed(self.world) if self.world is not None else None, placed(crowd), self.heads

    def _world(self) -> encounters.World:
        scene = self.engine.scene
        options, (length, width, _) = scene.options("encounters"), scene.box
        cell = max(SMALLEST_CELL, math.sqrt(length * width / scene.cloud.number))
        along, across = max(1, int(length / cell)), 1 if scene.in_plane else max(1, int(width / cell))
        periodic = scene.cloud.boundary == "periodic"
        ends = (length if periodic else math.inf, width if periodic and not scene.in_plane else math.inf)
        law = (options.restitution, options.friction, options.slowest, options.pile_up)
        return encounters.World(*ends, length / along, width / across, along, across, *law)

    def advance(self, until: float, samples: encounters.Samples) -> Iterator[tuple[int, Any]]:
        """Fly up to `until`: yields (code, grain) for every grain that leaves the run and (code, rows) when a log is full.

        The last is UNTIL, or what stopped the run. The logs are the caller's to empty.
        """
        tables, numbers, count, world = self.engine.tables, self.crowd.numbers, self.logs.count, self.world
        log, odd, samples = placed(self.logs), self.steps.flight.parts.odd, placed(samples)
        while True:
            code = encounters.advance(self.parts, *self.given, samples, log, self.courses, until)
            grain = int(count[2])
            if code == stepper.TABLE:
                tables.fill(odd, numbers[grain])
                continue
            if code == UNTIL:
                encounters.flush(self.parts, *self.given[:2], samples, until * ROUNDED)
            elif code not in GOES_ON and world is not None:  # nobody is behind the grain that stopped the run
                encounters.flush(self.parts, *self.given[:2], samples, float(self.crowd.clock[grain]) * ROUNDED)
            yield code, grain
            if code not in GOES_ON:
                return

    def tabulate(self) -> None:
        """Make the tables of the steps in hand: in a run that goes on, another process had them."""
        tables = self.engine.tables
        has_a_step = (encounters.STEP_END, encounters.IMPACT, encounters.KINK, encounters.ENCOUNTER, encounters.SEEK)
        for numbers in self.crowd.numbers[np.isin(self.crowd.kind, has_a_step)]:
            if tables.tables.sizes[int(numbers[stepper.SLOT]), int(numbers[stepper.SINGULAR])] != numbers[stepper.STEP]:
                tables.fill(self.steps.flight.parts.odd, numbers)

    def speed_of(self, grain: int) -> float:
        """Speed of a grain along the stream, V."""
        d = self.engine.dimensions
        y = self.crowd.y[grain]
        return float(y[d] + both(self.engine.profile, y[d - 1])[0])


PART = 2**19  # kept positions in a part of a run: 25 MB
GOES_ON = (flight.REST, flight.ALOFT, encounters.JUMPS_FULL, encounters.ENCOUNTERS_FULL)  # after which a run does
SLICE = 4096  # grain times interval between two looks at the clock
MESSAGES = STATUS | {
    UNTIL: ("finished", "the time is over"),
    PILE_UP: ("pile-up", "a grain had more than encounters.pile_up encounters within one d/u*"),
}


class Part:
    """What one stretch of a run leaves."""

    def __init__(self, engine: Engine, grains: range, first: int, count: int) -> None:
        self.engine, self.grains, self.first = engine, grains, first
        scene = engine.scene
        self.interval = scene.cloud.interval
        shape = (count if scene.run.trajectory else 0, len(grains), 2 * engine.dimensions)
        self.samples = encounters.Samples(self.interval, np.array([first]), np.full(shape, np.nan))
        self.owners: list[Floats] = []
        self.jumps: list[Floats] = []
        self.met: list[Floats] = []

    def empty(self, logs: encounters.Logs) -> None:
        """Take what is in the logs."""
        jumps, met = logs.count[:2]
        self.owners.append(logs.owners[:jumps] + np.int32(self.grains.start))
        self.jumps.append(logs.jumps[:jumps].copy())
        self.met.append(logs.encounters[:met].copy())
        logs.count[:2] = 0

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Jumps and encounters."""
        jumps = table_of(np.concatenate(self.jumps), self.engine.numbers.stokes(1.0))
        jumps.insert(0, "grain", np.concatenate(self.owners))
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


@dataclass(frozen=True)
class Told:
    """How far a run has come: parts that are done, the time, the status and why, and which grains have left."""

    parts: int
    time: float
    status: str
    message: str
    fates: list[Any]


class Folder:
    """The folder of a long run: numbered parts, a checkpoint after each, and run.json with how far it has come.

    Every file is renamed into place when it is whole, the checkpoint after its part and run.json last: killed at any time,
    the run goes on from the last checkpoint and writes the same bits. A damaged run.json is made again from the checkpoint.
    """

    def __init__(self, path: str | os.PathLike[str], scene: Any) -> None:
        self.path, self.scene = Path(path), scene
        self.key = key_of(scene)
        self.checkpoint = self.path / "checkpoint.npz"
        self._held = contextlib.ExitStack()

    def __enter__(self) -> Folder:
        """Nobody else writes here from now on."""
        self.path.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as held:
            held.enter_context(only_writer(self.path))
            for name in ("part-*.nc", "checkpoint.npz", "run.json"):
                for stray in self.path.glob(f".{name}.*"):  # of a run that was killed while it wrote
                    stray.unlink(missing_ok=True)
            if not self.begun() and any(file.name != "lock" for file in self.path.iterdir()):
                raise SceneError(f"--output {str(self.path)!r} holds something else: give an empty or a new folder")
            self._held = held.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Let others write."""
        self._held.close()

    def begun(self) -> bool:
        """Whether a run of this scene is here."""
        return self.told() is not None or self.checkpoint.exists()

    def told(self) -> dict[str, Any] | None:
        """What run.json says; None if there is none, or none that is whole beside a checkpoint."""
        try:
            told = words_in(self.path)
        except OSError:
            return None
        except DamageError as error:
            if self.checkpoint.exists():
                return None
            raise SceneError(f"--output: {error}") from None
        self._check(told["key"])
        return told

    def _check(self, key: str) -> None:
        if key != self.key:
            raise SceneError(f"--output {str(self.path)!r} holds the run of another scene or version: give a new folder")

    def tell(self, told: Told, known: dict[str, Any]) -> None:
        """Write run.json."""
        content = {"key": self.key} | asdict(told) | {"provenance": known, "scene": json.loads(text_of(self.scene))}
        write(self.path / "run.json", words_of(content))

    def put(self, number: int, dataset: Any, reached: float) -> None:
        """Write a part."""
        dataset.attrs = {"key": self.key, "part": number, "reached": reached}
        store(dataset, self.path / f"part-{number:05d}.nc")

    def keep(self, cloud: Cloud, told: Told) -> None:
        """Write a checkpoint: how far the run has come and all that is needed to go on."""
        words = {"key": np.array(self.key), "told": np.array(json.dumps(asdict(told)))}
        arrays = cloud.crowd._asdict() | {"heads": cloud.heads, "count": cloud.logs.count} | words
        with replacing(self.checkpoint) as name, open(name, "wb") as file:
            np.savez(file, **arrays)

    def recall(self, cloud: Cloud) -> Told:
        """Put a cloud back to the last checkpoint."""
        if not self.checkpoint.exists():
            return Told(0, 0.0, *STOPPED, [])
        arrays = cloud.crowd._asdict() | {"heads": cloud.heads, "count": cloud.logs.count}
        try:
            with open(self.checkpoint, "rb") as file, np.load(file) as kept:  # every array in it has a checksum
                found = {name: kept[name] for name in arrays}
                key, told = str(kept["key"]), Told(**json.loads(str(kept["told"])))
                alike = all((found[name].shape, found[name].dtype) == (array.shape, array.dtype) for name, array in arrays.items())
        except Exception:  # foreign bytes raise anything
            alike = False
        if not alike:
            told_so_far = f"saltation.open({str(self.path)!r}) gives what there is"
            raise SceneError(f"--output: {str(self.checkpoint)!r} is damaged, or of another version: take a copy, or go on anew with --force; {told_so_far}")
        self._check(key)
        try:
            for number in range(told.parts):
                part_in(self.path / f"part-{number:05d}.nc", number, self.key)
        except (OSError, ValueError) as error:
            raise SceneError(f"--output: {error}") from None
        for name, array in arrays.items():
            array[:] = found[name]
        cloud.tabulate()
        return told


def fly_part(cloud: Cloud, part: Part, begin: float, end: float, fates: list[Any], progress: Callable[[float], None]) -> tuple[int, float, int]:
    """Fly one stretch; (code, time reached, grain that stopped it)."""
    slices = max(1, math.ceil((end - begin) * len(cloud.crowd.clock) / (SLICE * part.interval)))
    code, grain, clock = UNTIL, 0, begin
    for k in range(1, slices + 1):
        until = end if k == slices else begin + k * (end - begin) / slices
        for code, grain in cloud.advance(until, part.samples):
            part.empty(cloud.logs)
            if code in (flight.REST, flight.ALOFT):
                slides = abs(cloud.speed_of(grain)) > SLIDING
                fate = "aloft" if code == flight.ALOFT else "creeping" if slides else "at rest"
                fates.append([cloud.grains.start + grain, float(cloud.crowd.numbers[grain, stepper.TIME]), fate])
        if code != UNTIL:
            return code, float(cloud.crowd.clock[grain]) if cloud.world is not None else clock, grain
        clock = until
        progress(until)
    return code, clock, grain


def note(cloud: Cloud, known: dict[str, Any]) -> None:
    """Add what is special to encounters to the provenance."""
    if cloud.world is not None:
        scene = cloud.engine.scene
        known |= {"encounters": scene.options("encounters").model_dump(), "box": scene.box, "unresolved_steps": int(cloud.logs.count[3])}


def fly_block(text: str, first: int, last: int) -> bytes:
    """Some grains of a scene in JSON, packed: what a worker is given."""
    with TURN:
        return packed(run_cloud(scene_of(json.loads(text)), grains=range(first, last)), "")


def run_blocks(scene: Any, executor: Executor, progress: Callable[[float], None] | None) -> CloudResult:
    """Simulate many grains over an executor, in blocks if they do not meet; the bits are those of one piece."""
    number, text = scene.cloud.number, text_of(scene)
    block = number if "encounters" in scene.names else math.ceil(number / min(BLOCKS, math.ceil(cost_of(scene) / CHUNK)))
    futures = {executor.submit(fly_block, text, first, min(number, first + block)): first for first in range(0, number, block)}
    found: dict[int, CloudResult] = {}
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
    return CloudResult(scene, jumps, whole.encounters, fate_table(fates), whole.status, whole.message, whole.provenance, whole.time, path)


def run_cloud(
    scene: Any,
    progress: Callable[[float], None] | None = None,
    output: str | os.PathLike[str] | None = None,
    grains: range | None = None,
) -> CloudResult:
    """Simulate many grains, or without encounters some of them; as `saltation.run`."""
    with Folder(output, scene) if output is not None else contextlib.nullcontext() as folder:
        return _run(scene, progress, folder, grains)


def _run(scene: Any, progress: Callable[[float], None] | None, folder: Folder | None, grains: range | None) -> CloudResult:
    engine = Engine(scene)
    cloud = Cloud(engine, grains)
    end, interval = scene.run.duration / engine.numbers.time, scene.cloud.interval
    count = max(1, PART // scene.cloud.number)  # samples of a part
    every = math.floor(end / interval * ROUNDED) + 1
    stretch = count * interval
    last = max(1, math.ceil(end / stretch * (1.0 - 1e-12)))
    known = origin(engine)
    told = Told(0, 0.0, *STOPPED, [])
    if folder is not None:
        if (before := folder.told()) is not None and before["status"] != STOPPED[0]:
            return open_folder(folder.path)
        told = folder.recall(cloud)
        note(cloud, known)
        folder.tell(told, known)  # the last words of a run that was killed between its checkpoint and them

    def report(time: float) -> None:
        if progress is not None:
            progress(min(1.0, time / end))

    parts: list[Part] = []
    while told.status == STOPPED[0]:
        k = told.parts
        part = Part(engine, cloud.grains, k * count, every - k * count if k + 1 == last else count)  # the end itself belongs to the last one
        code, reached, grain = fly_part(cloud, part, k * stretch, min(end, (k + 1) * stretch), told.fates, report)
        note(cloud, known)
        status, message = MESSAGES[code] if code != UNTIL or k + 1 == last else STOPPED
        told = Told(k + 1, reached, status, message if code == UNTIL else f"grain {cloud.grains.start + grain}: {message}", told.fates)
        if folder is None:
            parts.append(part)
        else:
            folder.put(k, part.dataset(reached), reached)
            folder.keep(cloud, told)
            folder.tell(told, known)
    if folder is not None:
        return open_folder(folder.path)
    tables = [part.tables() for part in parts]
    jumps = ordered(pd.concat([own for own, _ in tables], ignore_index=True))
    met = pd.concat([met for _, met in tables], ignore_index=True)
    paths = [path for part in parts if (path := part.path(told.time)) is not None]
    path = xr.concat(paths, "time", data_vars="all") if paths else None
    return CloudResult(scene, jumps, met, fate_table(told.fates), told.status, told.message, known, told.time, path)
