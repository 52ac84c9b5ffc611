"""The only file, with `_places` and `_pipeline`, that knows numba: compiled functions that survive on disk until a source file changes.

numba's disk cache keys a function by its own file and misses edits in what it imports. Every compiled function here has the
digest of the sources of its package and of basset in its name, which is part of numba's key: any edit is a miss, everything
else a hit. With NUMBA_DISABLE_JIT=1 the same functions run as plain Python on NumPy arrays.

numba takes a second to import: it is loaded when a compiled function is first called, not when one is defined.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import hashlib
import importlib
import math
import os
import pickle
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple, TypeVar

from basset._files import lock, replacing, unlock

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
    """The digest for functions of a package: its own sources, basset's, and saltation's if it may call them."""
    file = getattr(sys.modules.get(package), "__file__", None)
    if package == "basset":
        return source_digest(Path(__file__).parent)
    below = "saltation" if package != "saltation" and "saltation" in sys.modules else "basset"
    return digest_of(below) + (source_digest(Path(file).parent) if file is not None else "")


LOCK = threading.RLock()
WAITING: list[Callable[[Any], Any]] = []  # hooks that register something with numba, run when it is loaded
REPORTS: list[Callable[[str, float], None]] = []  # called with name and seconds of what was compiled, see `reported`


def compiler() -> Any:
    """numba, after all waiting hooks have run."""
    import numba

    with LOCK:
        while WAITING:
            WAITING.pop(0)(numba)
    return numba


def when_loaded(hook: Callable[[Any], Any]) -> None:
    """Call hook(numba) before numba compiles anything of ours; at once if it is loaded."""
    with LOCK:
        WAITING.append(hook)
    if "numba" in sys.modules:
        compiler()


def _announce(numba: Any) -> None:
    """Name on a terminal, once, what is being compiled; report it when it is done."""

    class Announcer(numba.core.event.Listener):  # type: ignore[misc]  # the base is numba's
        announced: set[str] = set()  # noqa: RUF012 - of the process, which has one listener

        def on_start(self, event: Any) -> None:
            kept = _keeper_of(event)
            if kept is not None and not UNDER_WAY and kept.name not in self.announced and sys.stderr.isatty():
                self.announced.add(kept.name)
                print(f"compiling, once: {kept.name} (usually {kept.usually})", file=sys.stderr, flush=True)
            UNDER_WAY.append((time.perf_counter(), kept is not None))

        def on_end(self, event: Any) -> None:
            seconds, kept = time.perf_counter() - UNDER_WAY.pop()[0], _keeper_of(event)
            if kept is not None and event.is_failed:
                kept.done()
            if kept is not None and not UNDER_WAY:
                for report in REPORTS:
                    report(kept.name, seconds)

    numba.core.event.register("numba:compile", Announcer())


SEPARATE: set[str] = set()  # names of functions that are not inlined, see `separate`
UNDER_WAY: list[tuple[float, bool]] = []  # functions being compiled, outermost first: start time, and whether it is ours
WHOLE: set[str] = set()  # names of functions that are entered from Python
BARE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}  # called by compiled code only


@when_loaded
def _short(numba: Any) -> None:
    """Use the short pipeline for our functions."""
    BARE["pipeline_class"] = importlib.import_module("basset._pipeline").Plain


@when_loaded
def _optimise_once(numba: Any) -> None:
    """Link, optimise and load only functions entered from Python, not also each function that they call."""
    library, context = numba.core.codegen.CPUCodeLibrary, numba.core.cpu.CPUContext

    def callers_first(library: Any) -> list[Any]:  # what nothing refers to yet when its turn comes is not linked
        found: dict[Any, None] = {}

        def visit(part: Any, seen: set[Any]) -> None:
            for called in reversed(part._linking_libraries):
                if called not in seen:
                    seen.add(called)
                    visit(called, seen)
                    found[called] = None

        visit(library, {library})
        return list(reversed(found))

    finish, executable, wrap = library.finalize, context.get_executable, context.create_cfunc_wrapper

    def inner(library: Any) -> bool:
        return bool(UNDER_WAY) and UNDER_WAY[0][1] and library.name not in WHOLE

    def finalize(self: Any) -> None:
        if inner(self):
            if self.name in SEPARATE:
                for function in self._final_module.functions:
                    if not function.is_declaration and f"{len(self.name)}{self.name}" in function.name:
                        function.add_function_attribute("noinline")
            self._finalize_dynamic_globals()
            self._finalized = True
        else:
            self._linking_libraries = callers_first(self)
            finish(self)

    def get_executable(self: Any, library: Any, description: Any, environment: Any) -> Any:
        return [].append if inner(library) else executable(self, library, description, environment)

    def create_cfunc_wrapper(self: Any, library: Any, *arguments: Any) -> None:
        if not inner(library):
            wrap(self, library, *arguments)

    library.finalize, context.get_executable, context.create_cfunc_wrapper = finalize, get_executable, create_cfunc_wrapper


def _keeper_of(event: Any) -> Keeper | None:
    """The cache of one of our functions that is being compiled; None for others."""
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


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Without looking for garbage meanwhile: among all that the compiler keeps, that takes as long as compiling a short function."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class Files:
    """The compiled forms of one function, a file for each: whole or not at all, and checked when read.

    numba's own index of all forms is lost where two processes write it at once, and the files that it points to are run unchecked:
    here the file's name is the hash of its key, and the key is in the file.
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


LONGEST_WAIT = 100.0  # s, for another process's compiler


class Keeper:
    """numba's cache of one function, made safe against damaged and unwritable files: what cannot be read is compiled again.

    `name` and `usually` (how long compiling takes) are for messages.
    """

    warned = False  # once in a process: one disk, one cause

    def __init__(self, plain: Any, usually: str) -> None:
        self.name, self.usually, self.cache, self.turn = f"{plain.__module__}.{plain.__name__}", usually, None, -1
        try:
            self.cache = compiler().core.caching.FunctionCache(plain)
            self.cache._cache_file = Files(self.cache.cache_path, self.cache._impl.filename_base)
        except Exception as error:  # no writable folder, neither beside the package nor in the user's cache, as in containers
            self.warn("kept", error)

    @property
    def cache_path(self) -> Any:
        """The folder of the files; None if nothing is kept."""
        return None if self.cache is None else self.cache.cache_path

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled form from the disk, or None; then other processes wait until it is there, instead of compiling it too."""
        if self.cache is None:
            return None
        try:
            found = self.cache.load_overload(signature, context)
            if found is None and self.turn < 0:
                self._wait()
                found = self.cache.load_overload(signature, context)
                if found is not None:
                    self.done()
            return found
        except Exception as error:  # unpickling raises anything
            self.warn("read", error)
            return None

    def _wait(self) -> None:
        """Until no other process compiles this function: the system frees the lock of one that dies."""
        with contextlib.suppress(OSError):  # no locks on this file system
            file = self._lock()
            file.parent.mkdir(parents=True, exist_ok=True)
            self.turn = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
            until = time.monotonic() + LONGEST_WAIT
            while time.monotonic() < until:  # a process that was stopped while it compiled must not stop others
                try:
                    lock(self.turn)
                    return
                except BlockingIOError:
                    time.sleep(0.1)

    def done(self) -> None:
        """Release the lock."""
        if self.turn >= 0 and self.cache is not None:
            with contextlib.suppress(OSError):
                os.unlink(self._lock())
            with contextlib.suppress(OSError):
                unlock(self.turn)
            os.close(self.turn)
            self.turn = -1

    def _lock(self) -> Path:
        """The file that is locked while this function is being compiled."""
        assert self.cache is not None
        return Path(self.cache.cache_path) / f"{self.cache._impl.filename_base}.lock"

    def save_overload(self, signature: Any, form: Any) -> None:
        """Keep the compiled form, if that can be."""
        try:
            if self.cache is not None:
                self.cache.save_overload(signature, form)
        except Exception as error:
            self.warn("kept", error)
        finally:
            self.done()

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
                    names[name] = self._function  # calls of module.name then take no detour
            return self._function

    def __call__(self, *arguments: Any, **keywords: Any) -> Any:
        """Call it."""
        return self._made()(*arguments, **keywords)

    def __getattr__(self, name: str) -> Any:  # numba asks for _numba_type_: compiled code then sees the compiled function
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._made(), name)


def compiled(*, reassociate: bool = False, allocates: bool = True, usually: str = "some seconds") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator for a function that is compiled when it is first called.

    `reassociate` lets the compiler reorder sums (never the meaning of NaN or infinity): for reductions only. A loop that
    makes no arrays of its own says so with allocates=False and is spared counting references: a third of its time.
    `usually` says how long compiling takes, for messages.
    """
    return lambda plain: Compiled(partial(_made, plain, reassociate, allocates, usually), plain.__module__)


def _made(plain: Any, reassociate: bool, allocates: bool, usually: str) -> Any:
    options: dict[str, Any] = {"nogil": True, "fastmath": {"reassoc", "contract", "nsz"} if reassociate else False, "error_model": "numpy"}
    if not allocates:
        options["_nrt"] = False
    digest = digest_of(plain.__module__.split(".")[0])
    # the name is part of the files': those of other sources may hold types that are no more, and cannot be read
    ending = "." + hashlib.sha256(digest.encode()).hexdigest()[:16]
    plain.__qualname__ = plain.__qualname__.removesuffix(ending) + ending  # once, also if an interrupt had it made again
    WHOLE.add(plain.__qualname__)
    function = compiler().njit(pipeline_class=BARE["pipeline_class"], **options)(plain)
    if is_compiled(function):
        function._cache = Keeper(plain, usually)
    return function


def itself(function: Any) -> Any:
    """The compiled function behind a `Compiled`, which a module holds until its first call; any other as it is."""
    return function._made() if isinstance(function, Compiled) else function


def is_compiled(function: Any) -> bool:
    """Whether `function` is a compiled function (numba.njit) that compiled code can call."""
    return "numba" in sys.modules and isinstance(itself(function), compiler().core.dispatcher.Dispatcher)


def shared(function: Function) -> Function:
    """A function that compiled code inlines and that stays plain Python elsewhere."""
    when_loaded(lambda numba: numba.extending.register_jitable(**BARE)(function))
    return function


def separate(function: Function) -> Function:
    """As `shared`, but not inlined: for long functions that are called from many places."""
    SEPARATE.add(function.__qualname__)
    return shared(function)


def overloads(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator for the form that compiled code uses in place of the plain Python `function`."""

    def decorate(form: Callable[..., Any]) -> Callable[..., Any]:
        when_loaded(lambda numba: numba.extending.overload(function, jit_options=BARE)(form))
        return form

    return decorate


def load(address: int, index: int) -> float:
    """The float64 at `address` + 8·index: reads a table without the reference counts that arrays in tuples cost in loops.

    The caller keeps the array alive.
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


class Entry(NamedTuple):
    """A compiled function as a C function of (t, y, out, own, data), by its address, and the address of its data.

    One type for all: what calls it is compiled once. The caller keeps the data alive.
    """

    address: int
    data: int


def call(entry: Any, t: float, y: Any, i: int, out: Any, k: int, own: Any) -> None:
    """entry(t, y[i], out[k], own): a plain function, or the compiled one behind an `Entry`."""
    invoke(entry, t, y[i], out[k], own)


@when_loaded
def _call_compiled(numba: Any) -> None:
    from llvmlite import ir

    word, number = ir.IntType(64), ir.DoubleType()
    place = number.as_pointer()

    def row(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
        """Pointer to a row of an array in C order."""
        found = context.make_array(kind)(context, builder, array)
        stride = builder.extract_value(found.strides, 0)
        return builder.inttoptr(builder.add(builder.ptrtoint(found.data, word), builder.mul(index, stride)), place)

    @numba.extending.intrinsic
    def _call(typingctx, address, data, t, y, i, out, k, own):
        def generate(context, builder, signature, arguments):
            kinds = signature.args
            address, data, t, y, i, out, k, own = arguments
            form = ir.FunctionType(ir.VoidType(), [number, place, place, place, word])
            function = builder.inttoptr(address, form.as_pointer())
            rows = row(context, builder, kinds[3], y, i), row(context, builder, kinds[5], out, k), row(context, builder, kinds[7], own, word(0))
            builder.call(function, [t, *rows, data])
            return context.get_dummy_value()

        whole, real = numba.types.int64, numba.types.float64
        return numba.types.void(whole, whole, real, y, whole, out, whole, own), generate

    @numba.extending.overload(call)
    def form(entry, t, y, i, out, k, own):
        def compiled_call(entry, t, y, i, out, k, own):
            _call(entry.address, entry.data, t, y, i, out, k, own)

        return compiled_call


def record_type(*fields: Any) -> Any:
    """The type of records whose fields Python and compiled code read and write by name: names of float64 numbers, or (name, type, …)."""
    import numpy as np

    return np.dtype((np.record, np.dtype([(field, "f8") if isinstance(field, str) else field for field in fields], align=True)))


class Placed:
    """NamedTuples of numbers, arrays and further such tuples in memory, for compiled code to read by their fields.

    A function gets one pointer for all of it: with every array by value, as numba passes tuples, each call costs, and
    compiling it takes several times as long.
    """

    def __init__(self, parts: Any) -> None:
        import numpy as np

        words: list[int] = []
        self._given, self.kind = parts, _lay_out(parts, words)  # hashable: by it the compiler's type is found again
        self._words = np.array(words, dtype=np.int64)
        self.address: int = self._words.ctypes.data

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._given, name)


def placed(parts: Any) -> Any:
    """NamedTuples as compiled functions take them; where nothing is compiled, as they are."""
    return Placed(parts) if jit() else parts


when_loaded(lambda numba: importlib.import_module("basset._places"))  # which imports from here


def _lay_out(part: Any, words: list[int]) -> Any:
    """Append what lies in memory for a number, an array, None or a tuple of such; what kind it is."""
    if isinstance(part, Placed):
        words.append(part.address)
        return part.kind, Placed
    if isinstance(part, tuple):
        return (type(part), *[_lay_out(inner, words) for inner in part])
    if isinstance(part, float):
        words.append(int.from_bytes(struct.pack("d", part), sys.byteorder, signed=True))
        return float
    if part is None:
        words.append(0)
        return None
    if isinstance(part, int) and not isinstance(part, bool):
        words.append(part)
        return int
    if getattr(part, "ndim", 0):
        words += (0, 0, part.size, part.itemsize, part.ctypes.data, *part.shape, *part.strides)
        flags = part.flags
        return part.dtype, part.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable
    raise TypeError(f"compiled code reads floats, integers, arrays and tuples of them, got {part!r}")


def _enter(parts):  # its global `stub` is another one for every function, see `entry`
    return stub(parts)  # type: ignore[name-defined]  # noqa: F821 - each copy of the function is given a `stub` of its own


def entry(function: Callable[..., None], usually: str = "a second") -> Callable[..., Any]:
    """Parts -> `function`(parts, t, y, out, own) as something to `call`: plain, or an `Entry`; and what must be kept alive.

    `parts` are NamedTuples of numbers and arrays, which the caller keeps alive too. A new type of them compiles `function`
    and nothing that calls it; nor is it optimised again with what calls it, as numba does with what is called otherwise.
    """

    def stub(parts: Any) -> int:
        raise NotImplementedError  # compiled code alone has a form of it, see `_entry_form`

    def register(numba: Any) -> None:
        numba.extending.overload(stub)(_entry_form(numba, function))

    when_loaded(register)
    name = f"{function.__module__}.{function.__name__}"
    plain = FunctionType(_enter.__code__, {"__name__": function.__module__, "stub": stub}, function.__name__)
    plain.__module__, plain.__qualname__ = function.__module__, f"entry_of_{name}"
    made: list[Any] = []

    def bind(parts: Any) -> tuple[Any, Any]:
        if not jit():
            return partial(function, parts), None
        if not made:
            with LOCK:
                made.append(_made(plain, False, False, usually))
        kept = parts if isinstance(parts, Placed) else Placed(parts)
        return Entry(made[0](kept), kept.address), kept

    return bind


def invoke(entry: Any, t: float, y: Any, out: Any, own: Any) -> None:
    """`call` from Python, of arrays that are one row."""
    if not isinstance(entry, Entry):
        entry(t, y, out, own)
        return
    Callbacks.form(entry.address)(t, y.ctypes.data, out.ctypes.data, own.ctypes.data, entry.data)


def _entry_form(numba: Any, function: Callable[..., None]) -> Callable[..., Any]:
    from llvmlite import ir
    from numba.core import compiler

    real, void = numba.types.CPointer(numba.types.float64), numba.types.void
    found = shared(function)

    def inner(parts, t, y, out, own):
        found(parts, t, y, out, own)  # pointers know neither length nor end, but take an index

    @numba.extending.intrinsic
    def address(typingctx, parts):
        def generate(context, builder, signature, arguments):
            form = void(signature.args[0], numba.types.float64, real, real, real)
            flags: Any = compiler.Flags()
            flags.error_model = "numpy"
            made = context.compile_subroutine(builder, inner, form, flags=flags)
            callee = context.declare_function(builder.module, made.fndesc)
            number, word = ir.DoubleType(), ir.IntType(64)
            pointer = number.as_pointer()
            outer = ir.Function(builder.module, ir.FunctionType(ir.VoidType(), [number, pointer, pointer, pointer, word]), f"{callee.name}.entry")
            inside = ir.IRBuilder(outer.append_basic_block())
            t, y, out, own, data = outer.args
            value = inside.inttoptr(data, context.get_value_type(signature.args[0]))
            context.call_conv.call_function(inside, callee, numba.types.none, form.args, [value, t, y, out, own])
            inside.ret_void()
            return builder.ptrtoint(outer, word)

        return numba.types.int64(parts), generate

    def form(parts):
        def compiled_form(parts):
            return address(parts)

        return compiled_form

    return form


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
        found = compiler().extending.register_jitable(**BARE)(getattr(getattr(self, "kind", self).instance_class, name))

        def call(self, a):
            return found(self, a)

        return call

    def compiled_two(self, a, b):
        found = compiler().extending.register_jitable(**BARE)(getattr(getattr(self, "kind", self).instance_class, name))

        def call(self, a, b):
            return found(self, a, b)

        return call

    def compiled_three(self, a, b, c):
        found = compiler().extending.register_jitable(**BARE)(getattr(getattr(self, "kind", self).instance_class, name))

        def call(self, a, b, c):
            return found(self, a, b, c)

        return call

    plain, form = ((one, compiled_one), (two, compiled_two), (three, compiled_three))[arguments - 1]
    overloads(plain)(form)
    return plain


def c_function(function: Any, args: tuple[Any, ...], table: Any, number: bool = False) -> Entry:
    """A compiled function (t, y, *args) -> rates or states, or one number, as something to `call`.

    Floats and arrays (C order) among `args` are data, read at every call where the table says that they lie: new ones compile
    nothing. What else there is is frozen into the function and must be hashable. `table` (args + states,), in words, has room for the
    states too, which the function may write into. The caller keeps it and the arrays alive.
    """
    kinds = tuple(
        (value.shape, value.dtype) if hasattr(value, "ctypes") else _FLOAT if isinstance(value, float) else (None, value, type(value)) for value in args
    )
    made = _c_function(itself(function), kinds, len(table) - len(args), number)
    tabulate(table, args)
    return Entry(made.address, table.ctypes.data)


def tabulate(table: Any, args: tuple[Any, ...]) -> None:
    """Write the arguments of a function made by `c_function` into its table; the caller keeps arrays alive."""
    for k, value in enumerate(args):
        if hasattr(value, "ctypes"):
            table[k] = value.ctypes.data
        elif isinstance(value, float):
            table.view("float64")[k] = value


_FLOAT = ("a float",)


@lru_cache(maxsize=64)
@uncollected()
def _c_function(function: Any, kinds: tuple[Any, ...], states: int, number: bool) -> Any:
    numba = compiler()
    given = _given(kinds, states, copies=not number)

    def vector(t, y, out, own, data):
        for a in range(states):
            out[a] = math.nan  # what it leaves if it raises
        rates = function(t, *given(y, data))
        for a in range(states):
            out[a] = rates[a]

    def scalar(t, y, out, own, data):
        out[0] = math.nan
        out[0] = function(t, *given(y, data))

    place = numba.types.CPointer(numba.types.float64)
    form = numba.types.void(numba.types.float64, place, place, place, numba.types.int64)
    return numba.cfunc(form, pipeline_class=BARE["pipeline_class"])(scalar if number else vector)


def _given(kinds: tuple[Any, ...], states: int, copies: bool) -> Any:
    """What a function gets besides t, of the state's address and the table's: as one intrinsic, since each function compiled on the way costs 20 ms."""
    import numpy as np
    from llvmlite import ir

    numba = compiler()
    word, shapes = ir.IntType(64), (((states,), np.dtype(np.float64)), *kinds)

    @numba.extending.intrinsic
    def given(typingctx, y, data):
        def type_of(kind):
            if kind is _FLOAT:
                return numba.types.float64
            if kind[0] is None:
                return typingctx.resolve_value_type(kind[1])
            return numba.types.Array(numba.from_dtype(kind[1]), len(kind[0]), "C")

        types = [type_of(kind) for kind in shapes]

        def generate(context, builder, signature, addresses):
            state, table = addresses

            def cell(k, form):
                place = builder.add(table, ir.Constant(word, 8 * k))
                return builder.inttoptr(place, form.as_pointer())

            def array(form, shape, pointer):
                made = context.make_array(form)(context, builder)
                size = context.get_abi_sizeof(context.get_data_type(form.dtype))
                strides = [size * math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
                words = [[ir.Constant(word, number) for number in numbers] for numbers in (shape, strides)]
                numba.np.arrayobj.populate_array(made, pointer, *words, ir.Constant(word, size), None)
                return made._getvalue()

            def value(k, kind, form):
                if kind is _FLOAT:
                    return builder.load(cell(k, ir.DoubleType()))
                if kind[0] is None:
                    return context.get_constant_generic(builder, form, kind[1])
                return array(form, kind[0], builder.load(cell(k, context.get_data_type(form.dtype).as_pointer())))

            if copies:
                copied = cell(len(kinds), ir.DoubleType())
                numba.core.cgutils.raw_memcpy(builder, copied, state, ir.Constant(word, states), 8)
                state = copied
            values = [array(types[0], (states,), state), *(value(k, kind, form) for k, (kind, form) in enumerate(zip(kinds, types[1:], strict=True)))]
            return context.make_tuple(builder, signature.return_type, values)

        return numba.types.Tuple(types)(y, data), generate

    return given


class Callbacks:
    """Python functions (t, y) -> array as something to `call` from compiled code; the first exception is kept in `raised`."""

    form = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)

    def __init__(self) -> None:
        self.raised: BaseException | None = None
        self._kept: list[Any] = []

    def entry(self, function: Callable[[float, Any], Any], states: int, results: int) -> Any:
        """An `Entry`; where nothing is compiled, a plain function."""
        if not jit():
            return partial(filled, function)
        import numpy as np

        seen: dict[tuple[int, int], Any] = {}

        def view(address: int, size: int) -> Any:
            found = seen.get((address, size))
            if found is None:
                found = seen[address, size] = np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))
            return found

        def called(t: float, y: int, out: int, own: int, data: int) -> None:
            try:
                view(out, results)[:] = math.nan if self.raised is not None else function(t, view(y, states))
            except BaseException as error:  # nothing may be raised through compiled code
                self.raised = error
                view(out, results)[:] = math.nan

        made = self.form(called)
        self._kept.append(made)
        return Entry(ctypes.cast(made, ctypes.c_void_p).value or 0, 0)


def filled(function: Callable[[float, Any], Any], t: float, y: Any, out: Any, own: Any) -> None:
    """A function (t, y) -> array as something that `call` can call."""
    out[:] = function(t, y)


def jit() -> bool:
    """Whether functions are compiled: not with NUMBA_DISABLE_JIT=1."""
    return not compiler().config.DISABLE_JIT
