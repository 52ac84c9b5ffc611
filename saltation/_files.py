"""Files that are written whole or not at all, datasets with a checksum, and folders with one writer at a time."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import mmap
import os
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from basset._files import lock, replacing, write

if TYPE_CHECKING:
    import xarray as xr


__all__ = ["DamageError", "content_of", "only_writer", "open_dataset", "replacing", "store", "write"]

BLANK = b"0" * 64  # in place of the checksum while it is computed
MARK = b"checksum\0\0\0\x02\0\0\0\x40"  # what stands before it in a netCDF 3 file: name, type and length of the attribute


class DamageError(ValueError):
    """A file that is not what was written; the message is one sentence that names it."""


def store(dataset: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Write a dataset, whole or not at all: netCDF 3 with a checksum over every byte.

    Empty variables are left out: netCDF 3 takes a dimension of length 0 for its one unlimited dimension.
    """
    with replacing(path) as name:
        ready, encoding = _ready(dataset)
        ready.to_netcdf(name, engine="scipy", encoding=encoding)
        with open(name, "r+b") as file, mmap.mmap(file.fileno(), 0) as content:
            _write_checksum(content)


def content_of(dataset: xr.Dataset) -> bytes:
    """What `store` writes."""
    ready, encoding = _ready(dataset)
    content = bytearray(ready.to_netcdf(engine="scipy", encoding=encoding))
    _write_checksum(content)
    return bytes(content)


def _ready(dataset: xr.Dataset) -> tuple[xr.Dataset, dict[str, Any]]:
    kept = dataset.drop_vars([name for name, variable in dataset.variables.items() if variable.size == 0]).drop_encoding()
    kept.attrs = {"Conventions": "CF-1.11", "checksum": BLANK.decode()} | dataset.attrs
    return kept, {str(name): {"_FillValue": None} for name in kept.coords}  # coordinates miss no value


def _write_checksum(content: Any) -> None:
    at = content.find(MARK) + len(MARK)
    content[at : at + len(BLANK)] = hashlib.sha256(content).hexdigest().encode()


def open_dataset(source: Path | bytes) -> xr.Dataset:
    """The dataset in a file or in what `content_of` gave; OSError if it cannot be read, DamageError for no netCDF 3 or no longer what was written."""
    import xarray as xr

    name = "a packed result" if isinstance(source, bytes) else repr(os.fspath(source))
    if isinstance(source, Path) and source.exists() and not source.is_file():
        raise DamageError(f"{name} is no saltation result: it is no file")
    content = source if isinstance(source, bytes) else source.read_bytes()
    at = content.find(MARK) + len(MARK)
    if at >= len(MARK):
        view = memoryview(content)
        found = hashlib.sha256(view[:at])
        found.update(BLANK)
        found.update(view[at + len(BLANK) :])
        if found.hexdigest().encode() != content[at : at + len(BLANK)]:
            raise DamageError(f"{name} is damaged: its content does not have the checksum that was written with it; take a copy, or run the scene anew")
    try:
        with xr.open_dataset(io.BytesIO(content), engine="scipy") as opened:
            whole: xr.Dataset = opened.load().drop_encoding()
    except Exception:  # foreign bytes can raise anything
        raise DamageError(f"{name} is no saltation result: it is empty, cut short, or no netCDF 3 file") from None
    whole.attrs.pop("checksum", None)
    return whole


@contextlib.contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Keep other processes from writing to a folder; the file `lock` in it names the writer.

    The lock of a dead process is taken over; that of a process on another machine, which may be alive, is not. SceneError if another process writes there.
    """
    from saltation.scene import SceneError

    file, what = folder / "lock", f"--output {os.fspath(folder)!r}"
    while True:
        handle = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            owner = _owner(handle)
            if not _locked(handle, owner):
                raise SceneError(f"{what}: {_who(owner)} writes there: wait until it is done, or give another folder")
            if owner is not None and owner.get("host") != platform.node():
                raise SceneError(f"{what}: {_who(owner)} may still write there: if it does not, remove {os.fspath(file)!r}")
            if not (file.exists() and os.path.samestat(os.fstat(handle), file.stat())):  # its owner has removed it meanwhile
                os.close(handle)
                continue
            os.ftruncate(handle, 0)
            os.pwrite(handle, json.dumps({"process": os.getpid(), "host": platform.node()}).encode() + b"\n", 0)
        except BaseException:
            os.close(handle)
            raise
        break
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
        os.close(handle)


def _owner(handle: int) -> dict[str, Any] | None:
    """The process named in a lock; None in a new one."""
    content = os.pread(handle, 4096, 0)
    try:
        found = json.loads(content)
    except ValueError:
        found = None
    if not content.strip():
        return None
    return found if isinstance(found, dict) else {}


def _who(owner: dict[str, Any] | None) -> str:
    known = owner or {}
    return f"process {known.get('process', 'unknown')} on {str(known.get('host', 'an unknown machine'))!r}"


def _locked(handle: int, owner: dict[str, Any] | None) -> bool:
    """Whether the lock was acquired: the system frees it when its holder ends, in whatever way."""
    try:
        if lock(handle):
            return True
    except BlockingIOError:
        return False
    except OSError:  # no locks on this file system
        pass
    return owner is None or owner.get("host") != platform.node() or not _alive(owner.get("process"))


def _alive(process: Any) -> bool:
    """Whether there is such a process on this machine."""
    if os.name != "posix" or not isinstance(process, int):
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
