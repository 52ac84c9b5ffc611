"""From a file of tracks (netCDF, zarr, CSV) to one of forces, chunk by chunk."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import math
import os
import re
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from basset import _validate, samples
from basset._files import is_stream, lock, replacing
from basset.kernels import Floats
from basset.tracks.forces import Particle
from basset.tracks.layout import IDS, Tracks

if TYPE_CHECKING:
    import xarray

SAMPLES = 1 << 18  # of a chunk, about


def opened(path: Path, track: str | None = None) -> Callable[[], Any]:
    """What opens the tracks in a .nc, .zarr or .csv file, each time anew, so that no memory is kept; `track`: the column of a .csv that numbers tracks.

    ValueError, with one sentence, for what is no such file or needs a package that is not there.
    """
    import xarray

    suffix = path.suffix.lower()
    if suffix not in (".nc", ".zarr", ".csv"):
        raise ValueError(f"the file of tracks must end in .nc, .zarr or .csv, got {str(path)!r}")
    if track is not None and suffix != ".csv":
        raise ValueError(f"the column that numbers tracks must be given for .csv files only, got {track!r} for {str(path)!r}")
    if suffix == ".csv":
        table = _from_csv(path, track)
        return lambda: contextlib.nullcontext(table)
    engines, kind = ["scipy"], "netCDF-3"
    if suffix == ".zarr":
        os.stat(path)
        engines, kind = ["zarr"], "zarr"
    else:
        with path.open("rb") as file:
            if file.read(4) in (b"\x89HDF", b"CDF\x05"):
                engines, kind = ["netCDF4", "h5netcdf"], "netCDF-4"
    there = [engine for engine in engines if importlib.util.find_spec(engine)]
    if not there:
        wanted = " or ".join(engines)
        rest = ", or the file be converted with nccopy -k classic" if kind == "netCDF-4" else ""
        raise ValueError(f"{str(path)!r} is {kind}, for which the package {wanted} must be installed{rest}")
    opener = partial(xarray.open_dataset, path, engine=there[0].lower(), decode_times=False, decode_timedelta=False, cache=False)
    try:
        opener().close()
    except OSError:
        raise
    except Exception:  # whatever foreign bytes lead to
        raise ValueError(f"{str(path)!r} must be a {kind} file") from None
    return opener


def _from_csv(path: Path, track: str | None) -> xarray.Dataset:
    """Tracks in a table: sorted by the column that numbers them."""
    import xarray

    columns: dict[str, tuple[Floats, str]] = {}
    for name, values in samples.columns(path).items():
        units = re.fullmatch(r"(.*?)\s*[\[(]([^\])]*)[\])]", name)
        second = samples.seconds(name)
        if second is not None:
            columns["time" if second != 1.0 or units else name] = values * second, "s"
        else:
            columns[units[1] if units else name] = values, units[2] if units else ""
    if track is not None:
        _validate.choice("track", track, columns)
    number = track or next((name for name in columns if name.lower() in IDS), None)
    size = len(next(iter(columns.values()))[0])
    whose = columns.pop(number)[0] if number is not None else np.zeros(size)
    if np.isnan(whose).any():
        raise ValueError(f"{str(path)!r} must number the track of every row in the column {number!r}, got none in row {int(np.argmax(np.isnan(whose))) + 1}")
    order = np.argsort(whose, kind="stable")
    ids, counts = np.unique(whose, return_counts=True)
    ids = ids.astype(np.int64) if (ids == np.rint(ids)).all() and (np.abs(ids) < 2**53).all() else ids
    fields: dict[Any, Any] = {name: ("obs", values[order], {"units": units}) for name, (values, units) in columns.items()}
    fields["row_size"] = ("trajectory", counts, {"sample_dimension": "obs"})
    return xarray.Dataset(fields, {"trajectory": ("trajectory", ids, {"cf_role": "trajectory_id"})})


def write(
    source: Path,
    output: Path,
    names: dict[str, Any],
    *,
    track: str | None = None,
    workers: int = 1,
    chunk: int | None = None,
    force: bool = False,
    command: str = "",
    progress: Callable[[int, int], None] = lambda done, total: None,
    **settings: Any,
) -> None:
    """`history` of a file of tracks, chunk by chunk, into a netCDF-3 file; `names` and `settings` are those of `history`.

    `progress` is told how many tracks are done, and of how many.

    Finished tracks are in a file named `output` with .partial appended, which is renamed at the end: if stopped at any time, the same call resumes
    and writes the same bits. ValueError, TypeError as `history`; OSError for files that cannot be used.
    """
    workers, particle = _validate.integer("workers", workers, 1), Particle(**settings)
    opener = opened(source, track)
    with opener() as ds:
        tracks = Tracks(ds, names)
        count, mean = len(tracks), ds.sizes[tracks.sample] / (1 if tracks.track is not None else max(len(tracks), 1))
        if not count or not mean:
            raise ValueError(f"{str(source)!r} must hold tracks, got none")
        state = source.stat()
        told = {"source": f"{source} ({state.st_size} bytes, {datetime.fromtimestamp(state.st_mtime, UTC):%Y-%m-%d %H:%M:%S.%f} UTC)", "command": command}
        header, record = _layout(tracks, ds, particle, told)
    size = max(1, int(SAMPLES / mean)) if chunk is None else _validate.integer("chunk", chunk, 1)

    def scanned(start: int) -> tuple[float, float]:
        with opener() as ds:
            return tracks.steps(ds, start, min(start + size, count))

    def done(start: int) -> Any:
        with opener() as ds:
            found = tracks.history(ds, start, min(start + size, count), particle, plan)
        rows = np.empty(found.sizes[tracks.along[0]], dtype=record)
        for name in record.names or ():
            rows[name] = found[name].values
        return rows

    with ThreadPoolExecutor(workers) as pool:
        nears, fars = zip(*pool.map(scanned, range(0, count, size)), strict=True)
    plan = particle.plan(min(nears), max(fars))
    with ThreadPoolExecutor(workers) as pool, _growing(output, header, record.itemsize, tracks.bounds, force) as (file, begin):
        starts, waiting, reached = deque(range(begin, count, size)), deque[Future[Any]](), begin
        progress(reached, count)
        try:
            while starts or waiting:
                while starts and len(waiting) <= workers:
                    waiting.append(pool.submit(done, starts.popleft()))
                file.write(waiting.popleft().result())
                file.flush()
                reached = min(reached + size, count)
                progress(reached, count)
        except BaseException:
            for future in waiting:
                future.cancel()
            raise


def _layout(tracks: Tracks, ds: xarray.Dataset, particle: Particle, told: dict[str, str]) -> tuple[bytes, Any]:
    """The head of the netCDF-3 file of the result, and what follows it for each track (for ragged arrays: each sample), a record."""
    from scipy.io import netcdf_file

    one = ds.isel({tracks.along[0]: slice(0, 1)})
    size = math.prod(one.sizes[dim] for dim in tracks.along)
    blank = np.full((size, len(tracks.columns)), np.nan)
    found = tracks.result(one, 0, 1 if tracks.track is not None else len(tracks), blank, blank[:, 0], particle).assign_attrs(told).drop_encoding()
    long = [name for name, variable in found.variables.items() if variable.dtype.kind in "iu" and variable.dtype != np.int32]
    found = found.assign({name: found[name].astype(np.float64) for name in long})  # netCDF 3 knows them not
    content = bytearray(found.to_netcdf(engine="scipy", unlimited_dims=tracks.along[:1]))
    with netcdf_file(io.BytesIO(content), mmap=False) as read:
        fields = [(name, variable.data.dtype, variable.shape[1:]) for name, variable in read.variables.items() if variable.isrec]
    record = np.dtype(fields)
    content[4:8] = ds.sizes[tracks.along[0]].to_bytes(4, "big")
    return bytes(content[: -record.itemsize]), record


@contextlib.contextmanager
def _growing(output: Path, header: bytes, size: int, bounds: Any, force: bool) -> Iterator[tuple[Any, int]]:
    """The file beside `output` to which records of `size` bytes are added, and the tracks that are in it already; it becomes the output when all went well."""
    if is_stream(output):
        raise ValueError(f"the output must be a file, got the stream {str(output)!r}")
    target = Path(os.path.realpath(output))
    growing = target.with_name(f"{target.name}.partial")
    if growing.exists():
        with growing.open("rb") as file:
            own = file.read(len(header)) == header
        if not (own or force):
            raise ValueError(f"{str(growing)!r} holds a part of another result: remove it, or overwrite it (force)")
        if not own:
            growing.unlink()
    if not growing.exists():
        with replacing(growing) as name:
            Path(name).write_bytes(header)
    with growing.open("r+b") as file:
        try:
            lock(file)
        except BlockingIOError:
            raise ValueError(f"{str(growing)!r} is being written by another process: wait until it is done, or give another output") from None
        records = (growing.stat().st_size - len(header)) // size
        begin = int(np.searchsorted(bounds, records, side="right")) - 1
        file.truncate(len(header) + int(bounds[begin]) * size)
        file.seek(0, os.SEEK_END)
        try:
            yield file, begin
        except (ValueError, TypeError):  # the same call would fail again
            growing.unlink()
            raise
        file.flush()
        os.fsync(file.fileno())
        os.replace(growing, target)
