"""The only file that knows numba: compiled functions that survive on disk until a source file changes.

numba's disk cache keys a function by its own file and misses edits in what it imports. Every compiled function here is
made by a factory that closes over the digest of the sources of its package and of basset: the digest is part of numba's
key, so any edit is a miss and everything else a hit. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python on NumPy arrays.
"""

from __future__ import annotations

import ctypes
import hashlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])


MARKS = (b"_compile", b"NamedTuple")


def source_digest(root: Path) -> str:
    """SHA-256 over the names and contents of all Python files below `root` that compiled code may come from.

    These import from this file or define the NamedTuples whose methods are compiled; no other edit makes anything stale.
    """
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        content = path.read_bytes()
        if any(mark in content for mark in MARKS):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(content)
    return digest.hexdigest()


DIGEST = source_digest(Path(__file__).parent)


@lru_cache(maxsize=8)
def digest_of(package: str) -> str:
    """The digest for functions of a package: its own sources and basset's."""
    file = getattr(sys.modules.get(package), "__file__", None)
    return DIGEST if package == "basset" or file is None else DIGEST + source_digest(Path(file).parent)


def compiled(factory: Callable[[str], Function], *, reassociate: bool = False, allocates: bool = True) -> Function:
    """The compiled form of `factory(digest)`; the function made must mention the digest in its body.

    `reassociate` lets the compiler reorder sums (never the meaning of NaN or infinity): for reductions only. A loop that
    makes no arrays of its own says so with allocates=False and is spared counting references: a third of its time.
    """
    flags = {"reassoc", "contract", "nsz"} if reassociate else False
    options: dict[str, Any] = {"nogil": True, "fastmath": flags, "error_model": "numpy"}
    if not allocates:
        options["_nrt"] = False
    function: Any
    digest = digest_of(factory.__module__.split(".")[0])
    plain = factory(digest)
    # the name is part of the index's file name: an index of other sources may hold types that are no more, and cannot be read
    plain.__qualname__ += "." + hashlib.sha256(digest.encode()).hexdigest()[:16]
    try:
        function = numba.njit(cache=True, **options)(plain)
    except RuntimeError:  # nowhere to write: neither beside the package nor in the user's cache
        function = numba.njit(**options)(plain)
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


def load(address: int, index: int) -> float:
    """The float64 at `address` + 8·index: reads a table without the reference counts that arrays in tuples cost in loops.

    Whoever makes the address keeps its array alive.
    """
    return ctypes.c_double.from_address(int(address) + 8 * int(index)).value


@numba.extending.intrinsic
def _load(typingctx, address, index):
    def generate(context, builder, signature, arguments):
        kind = context.get_value_type(numba.types.float64)
        base, offset = arguments
        place = builder.add(base, builder.mul(offset, context.get_constant(numba.types.int64, 8)))
        return builder.load(builder.inttoptr(place, kind.as_pointer()))

    return numba.types.float64(numba.types.int64, numba.types.int64), generate


@numba.extending.overload(load)
def _load_compiled(address, index):
    def compiled_load(address, index):
        return _load(address, index)  # type: ignore[call-arg]  # the typing context is numba's

    return compiled_load


def method(name: str, arguments: int) -> Callable[..., Any]:
    """A function (self, …) that calls the method `name` of a NamedTuple with 1 or 3 arguments, in compiled code too.

    Types select: in compiled code the method is found when the caller is compiled, so a tuple of NamedTuples is a family of
    interchangeable parts without branches, and new parameter values never recompile.
    """

    def one(self: Any, a: Any) -> Any:
        return getattr(self, name)(a)

    def three(self: Any, a: Any, b: Any, c: Any) -> Any:
        return getattr(self, name)(a, b, c)

    def compiled_one(self, a):
        found = numba.extending.register_jitable(getattr(self.instance_class, name))

        def call(self, a):
            return found(self, a)

        return call

    def compiled_three(self, a, b, c):
        found = numba.extending.register_jitable(getattr(self.instance_class, name))

        def call(self, a, b, c):
            return found(self, a, b, c)

        return call

    plain, form = (one, compiled_one) if arguments == 1 else (three, compiled_three)
    numba.extending.overload(plain)(form)
    return plain


@numba.extending.intrinsic
def _pointer(typingctx, address):
    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(numba.types.voidptr))

    return numba.types.voidptr(numba.types.int64), generate


@contextmanager
def rate_function(function: Any, args: tuple[Any, ...], states: int) -> Iterator[Any]:
    """A compiled fun(t, y, *args) as a C function of (t, y, rates): one type for all, so its callers compile once.

    Floats and arrays (C order) among `args` are data, read at every call where a table says that they lie: new ones compile
    nothing. What else there is is frozen into the function and must be hashable.
    """
    kinds = tuple((value.shape, value.dtype) if hasattr(value, "ctypes") else _FLOAT if type(value) is float else (None, value) for value in args)
    idle = _idle(function, kinds, states)
    try:
        made, table = idle.pop()  # nobody else's meanwhile: a solve within a solve, or in another thread, makes its own
    except IndexError:
        made, table = _rate_function(function, kinds, states)
    for k, (kind, value) in enumerate(zip(kinds, args, strict=True)):
        if kind is _FLOAT:
            table.view("float64")[k] = value
        elif kind[0] is not None:
            table[k] = value.ctypes.data
    try:
        yield made
    finally:
        idle.append((made, table))


_FLOAT = ("a float",)


@lru_cache(maxsize=64)
def _idle(function: Any, kinds: tuple[Any, ...], states: int) -> list[tuple[Any, Any]]:
    """C functions of one kind and their tables that nobody uses now."""
    return []


def _rate_function(function: Any, kinds: tuple[Any, ...], states: int) -> tuple[Any, Any]:
    array = numba.carray  # type: ignore[attr-defined]  # numba exports it without saying so
    table = np.zeros(len(kinds) + 1, dtype=np.int64)
    given = shared(lambda: ())
    for k, kind in enumerate(kinds):
        given = _appended(given, kind, table.ctypes.data + 8 * k, array)

    def call(t, y, rates):
        array(rates, (states,))[:] = function(t, array(y, (states,)), *given())

    pointer = numba.types.CPointer(numba.types.float64)
    return numba.cfunc(numba.types.void(numba.types.float64, pointer, pointer))(call), table


def _appended(given: Any, kind: tuple[Any, ...], place: int, array: Any) -> Any:
    """`given` and one more value, as a function that compiled code inlines."""
    if kind is _FLOAT:
        return shared(lambda: (*given(), load(place, 0)))
    shape, value = kind
    if shape is None:
        return shared(lambda: (*given(), value))
    integer = np.int64
    return shared(lambda: (*given(), array(_pointer(array(_pointer(place), (1,), integer)[0]), shape, value)))  # type: ignore[call-arg]  # the typing context is numba's
