"""The folder of a long run: parts that are whole, a checkpoint, and how far it has come."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from saltation._files import DamageError, only_writer, replacing, store, write
from saltation._keys import key_of, text_of
from saltation.results.files import STOPPED, part_in, read_run_json, run_json_of
from saltation.scene import Scene, SceneError, scene_of


@dataclass(frozen=True)
class RunStatus:
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

    def __init__(self, path: str | os.PathLike[str], scene: Scene) -> None:
        self.path, self.scene = Path(path), scene
        self.key = key_of(scene)
        self.checkpoint = self.path / "checkpoint.npz"
        self._held = contextlib.ExitStack()

    def __enter__(self) -> Folder:
        """Lock the folder."""
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
        """Unlock the folder."""
        self._held.close()

    def begun(self) -> bool:
        """Whether a run of this scene is here."""
        return self.read_status() is not None or self.checkpoint.exists()

    def read_status(self) -> dict[str, Any] | None:
        """The fields of run.json; None if there is none, or only a damaged one beside a checkpoint."""
        try:
            told = read_run_json(self.path)
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

    def write_status(self, status: RunStatus, known: dict[str, Any]) -> None:
        """Write run.json."""
        content = {"key": self.key} | asdict(status) | {"provenance": known, "scene": json.loads(text_of(self.scene))}
        write(self.path / "run.json", run_json_of(content))

    def put(self, number: int, dataset: Any, reached: float) -> None:
        """Write a part."""
        dataset.attrs = {"key": self.key, "part": number, "reached": reached}
        store(dataset, self.path / f"part-{number:05d}.nc")

    def save_checkpoint(self, arrays: Mapping[str, Any], status: RunStatus) -> None:
        """Write how far the run has come and all that is needed to go on."""
        content: dict[str, Any] = {**arrays, "key": np.array(self.key), "told": np.array(json.dumps(asdict(status)))}
        with replacing(self.checkpoint) as name, open(name, "wb") as file:
            np.savez(file, **content)

    def load_checkpoint(self, arrays: Mapping[str, Any]) -> RunStatus:
        """Put arrays back to the last checkpoint; without one they stay."""
        if not self.checkpoint.exists():
            return RunStatus(0, 0.0, *STOPPED, [])
        try:
            with open(self.checkpoint, "rb") as file, np.load(file) as kept:  # every array in it has a checksum
                found = {name: kept[name] for name in arrays}
                key, status = str(kept["key"]), RunStatus(**json.loads(str(kept["told"])))
                alike = all((found[name].shape, found[name].dtype) == (array.shape, array.dtype) for name, array in arrays.items())
        except Exception:  # foreign bytes raise anything
            alike = False
        if not alike:
            there = f"; saltation.open({str(self.path)!r}) gives what there is" if self.read_status() is not None else ""
            raise SceneError(f"--output: {str(self.checkpoint)!r} is damaged, or of another version: take a copy, or go on anew with --force{there}")
        self._check(key)
        try:
            for number in range(status.parts):
                part_in(self.path / f"part-{number:05d}.nc", number, self.key)
        except OSError as error:
            raise SceneError(f"--output: {str(error.filename)!r} cannot be read: {error.strerror}; take a copy, or go on anew with --force") from None
        except ValueError as error:
            raise SceneError(f"--output: {error}") from None
        for name, array in arrays.items():
            array[:] = found[name]
        return status


def begun(scene: Scene, output: str | os.PathLike[str] | None) -> Scene | None:
    """What was chosen for a scene that says "auto", or agreed on in one whose stream feels the grains, when the run in this folder began; None without."""
    if output is None:
        return None
    try:
        found = scene_of(read_run_json(Path(output))["scene"])
    except (OSError, ValueError):
        return None
    chosen, settled = found.chosen, found.coupling.settled if found.coupling is not None else None
    return found if key_of(scene) in (chosen and chosen.of, settled and settled.of) else None
