"""Files that are written atomically, whole or not at all, and locks of files."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]  # a module or nothing: Windows has no such locks


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[str]:
    """The name of a temporary file beside `path` that takes its place when all went well; else nothing is left behind.

    A link is followed, a file that was there passes its mode on, and a new one's follows the umask; a device or a pipe is written to.
    OSError if the folder does not exist or cannot be written.
    """
    if is_stream(path):
        with tempfile.TemporaryDirectory() as folder:
            name = os.path.join(folder, "written")
            yield name
            with open(name, "rb") as source, open(path, "ab") as sink:
                shutil.copyfileobj(source, sink)
        return
    target = Path(os.path.realpath(path))
    name = str(target.with_name(f".{target.name}.{secrets.token_hex(4)}"))
    with undisturbed():
        os.close(os.open(name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
            yield name
            if target.exists():
                shutil.copymode(target, name)
            _synced(name)
            os.replace(name, target)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
        with contextlib.suppress(OSError):  # not every system can do so with folders
            _synced(target.parent)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Defer SIGINT and SIGTERM to the end: libraries that write files turn an interrupt into other errors, or lose it."""
    waiting: list[int] = []
    signals = [one for one in (signal.SIGINT, signal.SIGTERM) if callable(signal.getsignal(one))]  # others end the process at once, or are ignored
    if threading.current_thread() is not threading.main_thread():
        signals = []
    before = {one: signal.signal(one, lambda number, frame: waiting.append(number)) for one in signals}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    for number in waiting[:1]:
        signal.raise_signal(number)


def is_stream(path: str | os.PathLike[str]) -> bool:
    """Whether `path` is a device, a pipe or an open file (/dev/stdout): nothing that another file can replace."""
    if not os.path.exists(path) or os.path.isdir(path):
        return False
    opened = os.path.islink(path) and os.path.abspath(path).startswith(("/dev/", "/proc/"))
    return opened or not os.path.isfile(path)


def lock(file: Any) -> bool:
    """Take the lock of an open file, which ends with the process; False where the system has none. BlockingIOError if another process has it."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return fcntl is not None


def unlock(file: Any) -> None:
    """Release it, also for processes that were forked meanwhile and hold it too."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_UN)


def write(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with replacing(path) as name:
        Path(name).write_text(text, encoding="utf-8")


def _synced(path: str | os.PathLike[str]) -> None:
    """Fsync of a file or folder: a rename alone does not outlast a power failure."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
