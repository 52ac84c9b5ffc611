"""The only file that knows numba: compiled functions that survive on disk until a source file changes.

numba's disk cache keys a function by its own file and misses edits in what it imports. Every compiled function here is
made by a factory that closes over the digest of the sources of its package and of basset: the digest is part of numba's
key, so any edit is a miss and everything else a hit. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python on NumPy arrays.

numba takes a second to import: it is loaded when a compiled function is first called, not when one is defined.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import pickle
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

from basset._files import replacing

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


@lru_cache(maxsize=8)
def digest_of(package: str) -> str:
    """The digest for functions of a package: its own sources and basset's."""
    file = getattr(sys.modules.get(package), "__file__", None)
    if package == "basset":
        return source_digest(Path(__file__).parent)
    return digest_of("basset") + (source_digest(Path(file).parent) if file is not None else "")


LOCK = threading.RLock()
WAITING: list[Callable[[Any], Any]] = []  # what the compiler is told once it is loaded
REPORTS: list[Callable[[str, float], None]] = []  # who wants to know what was compiled, and in how many seconds


def compiler() -> Any:
    """numba, which knows all that it was to be told."""
    import numba

    with LOCK:
        while WAITING:
            WAITING.pop(0)(numba)
    return numba


def when_loaded(tell: Callable[[Any], Any]) -> None:
    """Tell the compiler something before it compiles anything; at once if it is there."""
    with LOCK:
        WAITING.append(tell)
    if "numba" in sys.modules:
        compiler()


def _announce(numba: Any) -> None:
    """Say on a terminal, once, what is being compiled; report it when it is done."""

    class Announcer(numba.core.event.Listener):  # type: ignore[misc]  # the base is numba's
        under_way: list[float] = []  # noqa: RUF012 - what is compiled on the way is not told
        told: set[str] = set()  # noqa: RUF012 - of the process, which has one listener

        def on_start(self, event: Any) -> None:
            kept = _kept(event)
            if kept is not None and not self.under_way and kept.name not in self.told and sys.stderr.isatty():
                self.told.add(kept.name)
                print(f"compiling, once: {kept.name} (usually {kept.usually})", file=sys.stderr, flush=True)
            self.under_way.append(time.perf_counter())

        def on_end(self, event: Any) -> None:
            seconds, kept = time.perf_counter() - self.under_way.pop(), _kept(event)
            if kept is not None and not self.under_way:
                for report in REPORTS:
                    report(kept.name, seconds)

    numba.core.event.register("numba:compile", Announcer())


def _kept(event: Any) -> Keeper | None:
    """The cache of one of our functions that is being compiled; None for somebody else's."""
    cache = event.data["dispatcher"]._cache
    return cache if isinstance(cache, Keeper) else None


when_loaded(_announce)


@contextlib.contextmanager
def reported(report: Callable[[str, float], None]) -> Iterator[None]:
    """Have report(name, seconds) called for every function that is compiled meanwhile, not for those compiled on the way."""
    REPORTS.append(report)
    try:
        yield
    finally:
        REPORTS.remove(report)


class Files:
    """The compiled forms of one function, a file for each: whole or not at all, and checked when read.

    numba's own index of all forms is lost where two processes write it at once, and what it points to is run unseen: here the
    file's name is the key's and the key is in the file.
    """

    def __init__(self, folder: str, base: str) -> None:
        self.folder, self.base = Path(folder), base

    def path(self, key: Any) -> Path:
        """Where a form is kept."""
        numba = compiler()
        return self.folder / f"{self.base}.{hashlib.sha256(repr((numba.__version__, key)).encode()).hexdigest()[:24]}.nbc"

    def load(self, key: Any) -> Any:
        """A form, None if there is none; damage raises."""
        try:
            content = self.path(key).read_bytes()
        except FileNotFoundError:
            return None
        if hashlib.sha256(content[32:]).digest() != content[:32]:
            raise ValueError(f"{self.path(key).name} is damaged")
        found, form = pickle.loads(content[32:])
        return form if found == key else None

    def save(self, key: Any, form: Any) -> None:
        """Keep a form."""
        content = compiler().core.serialize.dumps((key, form))
        with replacing(self.path(key)) as name:
            Path(name).write_bytes(hashlib.sha256(content).digest() + content)

    def flush(self) -> None:
        """Forget all forms."""
        for path in self.folder.glob(f"{self.base}.*.nbc"):
            path.unlink(missing_ok=True)


class Keeper:
    """numba's cache of one function, which nothing on the disk can make an obstacle: what cannot be read is compiled again.

    `name` and `usually` (how long it takes) are for people.
    """

    warned = False  # once in a process: one disk, one cause

    def __init__(self, plain: Any, usually: str) -> None:
        self.name, self.usually, self.cache = f"{plain.__module__}.{plain.__name__}", usually, None
        try:
            self.cache = compiler().core.caching.FunctionCache(plain)
            self.cache._cache_file = Files(self.cache.cache_path, self.cache._impl.filename_base)
        except Exception as error:  # neither beside the package nor in the user's cache, as in containers
            self.warn("kept", error)

    @property
    def cache_path(self) -> Any:
        """The folder of the files; None if nothing is kept."""
        return None if self.cache is None else self.cache.cache_path

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled form from the disk, or None."""
        try:
            return None if self.cache is None else self.cache.load_overload(signature, context)
        except Exception as error:  # unpickling raises anything
            self.warn("read", error)
            return None

    def save_overload(self, signature: Any, form: Any) -> None:
        """Keep the compiled form, if that can be."""
        try:
            if self.cache is not None:
                self.cache.save_overload(signature, form)
        except Exception as error:
            self.warn("kept", error)

    def flush(self) -> None:
        """Forget all forms."""
        if self.cache is not None:
            self.cache.flush()

    def warn(self, verb: str, error: Exception) -> None:
        """One line, once."""
        if not Keeper.warned:
            Keeper.warned = True
            reason = " ".join(str(error).split()) or type(error).__name__
            print(f"warning: compiled code cannot be {verb}, so it is compiled {'again' if verb == 'read' else 'anew each time'}: {reason}", file=sys.stderr)


class Compiled:
    """A function that is compiled when first called or looked into; from then on its module holds the compiled function itself."""

    def __init__(self, make: Callable[[], Any], module: str) -> None:
        self._make, self._module, self._function = make, module, None

    def _made(self) -> Any:
        with LOCK:
            if self._function is None:
                self._function = self._make()
                names = getattr(sys.modules.get(self._module), "__dict__", {})
                for name in [name for name, value in names.items() if value is self]:
                    names[name] = self._function  # whoever calls module.name pays for no detour
            return self._function

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Call it."""
        return self._made()(*arguments, **keywords)

    def __getattr__(self, name: str) -> Any:  # so compiled code takes it for what it stands for: numba asks for its _numba_type_
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._made(), name)


def compiled(factory: Callable[[str], Function], *, reassociate: bool = False, allocates: bool = True, usually: str = "some seconds") -> Function:
    """The compiled form of `factory(digest)`; the function made must mention the digest in its body.

    `reassociate` lets the compiler reorder sums (never the meaning of NaN or infinity): for reductions only. A loop that
    makes no arrays of its own says so with allocates=False and is spared counting references: a third of its time.
    `usually` says how long people have to wait for it.
    """
    return cast(Function, Compiled(partial(_compiled, factory, reassociate, allocates, usually), factory.__module__))


def _compiled(factory: Callable[[str], Any], reassociate: bool, allocates: bool, usually: str) -> Any:
    options: dict[str, Any] = {"nogil": True, "fastmath": {"reassoc", "contract", "nsz"} if reassociate else False, "error_model": "numpy"}
    if not allocates:
        options["_nrt"] = False
    digest = digest_of(factory.__module__.split(".")[0])
    plain: Any = factory(digest)
    # the name is part of the files': those of other sources may hold types that are no more, and cannot be read
    plain.__qualname__ += "." + hashlib.sha256(digest.encode()).hexdigest()[:16]
    function = compiler().njit(**options)(plain)
    if is_compiled(function):
        function._cache = Keeper(plain, usually)
    return function


def is_compiled(function: Any) -> bool:
    """Whether `function` is a compiled function (numba.njit) that compiled code can call."""
    if isinstance(function, Compiled):
        function = function._made()
    return "numba" in sys.modules and isinstance(function, compiler().core.dispatcher.Dispatcher)


def shared(function: Function) -> Function:
    """A function that compiled code inlines and that stays plain Python for everybody else."""
    when_loaded(lambda numba: numba.extending.register_jitable(function))
    return function


def overloads(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator for the form that compiled code uses in place of the plain Python `function`."""

    def decorate(form: Callable[..., Any]) -> Callable[..., Any]:
        when_loaded(lambda numba: numba.extending.overload(function)(form))
        return form

    return decorate


def load(address: int, index: int) -> float:
    """The float64 at `address` + 8·index: reads a table without the reference counts that arrays in tuples cost in loops.

    Whoever makes the address keeps its array alive.
    """
    return ctypes.c_double.from_address(int(address) + 8 * int(index)).value


@when_loaded
def _load_compiled(numba: Any) -> None:
    @numba.extending.intrinsic
    def _load(typingctx, address, index):
        def generate(context, builder, signature, arguments):
            kind = context.get_value_type(numba.types.float64)
            base, offset = arguments
            place = builder.add(base, builder.mul(offset, context.get_constant(numba.types.int64, 8)))
            return builder.load(builder.inttoptr(place, kind.as_pointer()))

        return numba.types.float64(numba.types.int64, numba.types.int64), generate

    @numba.extending.overload(load)
    def form(address, index):
        def compiled_load(address, index):
            return _load(address, index)

        return compiled_load


def method(name: str, arguments: int) -> Callable[..., Any]:
    """A function (self, …) that calls the method `name` of a NamedTuple with 1, 2 or 3 arguments, in compiled code too.

    Types select: in compiled code the method is found when the caller is compiled, so a tuple of NamedTuples is a family of
    interchangeable parts without branches, and new parameter values never recompile.
    """

    def one(self: Any, a: Any) -> Any:
        return getattr(self, name)(a)

    def two(self: Any, a: Any, b: Any) -> Any:
        return getattr(self, name)(a, b)

    def three(self: Any, a: Any, b: Any, c: Any) -> Any:
        return getattr(self, name)(a, b, c)

    def compiled_one(self, a):
        found = compiler().extending.register_jitable(getattr(self.instance_class, name))

        def call(self, a):
            return found(self, a)

        return call

    def compiled_two(self, a, b):
        found = compiler().extending.register_jitable(getattr(self.instance_class, name))

        def call(self, a, b):
            return found(self, a, b)

        return call

    def compiled_three(self, a, b, c):
        found = compiler().extending.register_jitable(getattr(self.instance_class, name))

        def call(self, a, b, c):
            return found(self, a, b, c)

        return call

    plain, form = ((one, compiled_one), (two, compiled_two), (three, compiled_three))[arguments - 1]
    overloads(plain)(form)
    return plain


@lru_cache(maxsize=1)
def _pointer() -> Any:
    """A compiled function (address) -> pointer."""
    numba = compiler()

    @numba.extending.intrinsic
    def pointer(typingctx, address):
        def generate(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(numba.types.voidptr))

        return numba.types.voidptr(numba.types.int64), generate

    return pointer


@contextlib.contextmanager
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
    import numpy as np

    numba = compiler()
    array = numba.carray
    table = np.zeros(len(kinds) + 1, dtype=np.int64)
    given = shared(lambda: ())
    for k, kind in enumerate(kinds):
        given = _appended(given, kind, table.ctypes.data + 8 * k, array, _pointer(), np.int64)

    def call(t, y, rates):
        array(rates, (states,))[:] = function(t, array(y, (states,)), *given())

    pointer = numba.types.CPointer(numba.types.float64)
    return numba.cfunc(numba.types.void(numba.types.float64, pointer, pointer))(call), table


def _appended(given: Any, kind: tuple[Any, ...], place: int, array: Any, pointer: Any, integer: Any) -> Any:
    """`given` and one more value, as a function that compiled code inlines."""
    if kind is _FLOAT:
        return shared(lambda: (*given(), load(place, 0)))
    shape, value = kind
    if shape is None:
        return shared(lambda: (*given(), value))
    return shared(lambda: (*given(), array(pointer(array(pointer(place), (1,), integer)[0]), shape, value)))
