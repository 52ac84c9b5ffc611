"""The only file that knows numba: compiled functions that survive on disk until a source file changes.

numba's disk cache keys a function by its own file and misses edits in what it imports. Every compiled function here is
made by a factory that closes over the digest of the package's sources: the digest is part of numba's key, so any edit is
a miss and everything else a hit. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python on NumPy arrays.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def source_digest(root: Path) -> str:
    """SHA-256 over the names and contents of all Python files below `root`."""
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


DIGEST = source_digest(Path(__file__).parent)


def compiled(factory: Callable[[str], Function], *, reassociate: bool = False) -> Function:
    """The compiled form of `factory(DIGEST)`; the function made must mention the digest in its body.

    `reassociate` lets the compiler reorder sums (never the meaning of NaN or infinity): for reductions only.
    """
    flags = {"reassoc", "contract", "nsz"} if reassociate else False
    options: dict[str, Any] = {"nogil": True, "fastmath": flags, "error_model": "numpy"}
    function: Any
    try:
        function = numba.njit(cache=True, **options)(factory(DIGEST))
    except RuntimeError:  # nowhere to write: neither beside the package nor in the user's cache
        function = numba.njit(**options)(factory(DIGEST))
    return cast(Function, function)


def is_compiled(function: Any) -> bool:
    """Whether `function` is a compiled function (numba.njit) that compiled code can call."""
    return isinstance(function, numba.core.dispatcher.Dispatcher)


def shared(function: Function) -> Function:
    """A function that compiled code inlines and that stays plain Python for everybody else."""
    result: Function = numba.extending.register_jitable(function)
    return result


def overloads(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator for the form that compiled code uses in place of the plain Python `function`."""
    return cast(Callable[[Callable[..., Any]], Callable[..., Any]], numba.extending.overload(function))


@lru_cache(maxsize=64)
def rate_function(function: Any, args: tuple[Any, ...], states: int) -> Any:
    """A compiled fun(t, y, *args) as a C function of (t, y, rates): one type for all, so its callers compile once.

    `args` are frozen into it; they must be hashable.
    """
    array = numba.carray  # type: ignore[attr-defined]  # numba exports it without saying so

    def call(t, y, rates):
        array(rates, (states,))[:] = function(t, array(y, (states,)), *args)

    pointer = numba.types.CPointer(numba.types.float64)
    return numba.cfunc(numba.types.void(numba.types.float64, pointer, pointer))(call)
