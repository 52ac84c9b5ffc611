"""Weights that were built once: a least-recently-used cache, bounded in bytes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, Protocol, TypeVar


class Sized(Protocol):
    """Anything that tells how many bytes it holds."""

    @property
    def nbytes(self) -> int:
        """Bytes held now; may grow between uses."""
        ...


Entry = TypeVar("Entry", bound=Sized)


class ByteCache(Generic[Entry]):
    """Entries by key, the least recently used dropped first once they hold more than `limit` bytes together.

    An entry that alone exceeds the limit is used and dropped. Safe to share between threads.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._entries: OrderedDict[Hashable, Entry] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def nbytes(self) -> int:
        """Bytes held by all entries."""
        return sum(entry.nbytes for entry in self._entries.values())

    def get(self, key: Hashable, make: Callable[[], Entry]) -> Entry:
        """The entry for `key`, made if it is not there."""
        with self._lock:
            entry = self._entries.get(key)
            if entry is None:
                entry = self._entries[key] = make()
            else:
                self._entries.move_to_end(key)
            return entry

    def trim(self) -> None:
        """Drop the least recently used entries until the limit is kept; called after an entry has grown."""
        with self._lock:
            while self._entries and self.nbytes > self.limit:
                self._entries.popitem(last=False)

    def clear(self) -> None:
        """Forget everything: the next use builds its weights anew."""
        with self._lock:
            self._entries.clear()
