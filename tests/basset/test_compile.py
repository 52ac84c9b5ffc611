"""One source, two executions: compiled and plain NumPy agree; the compiled one survives on disk until a source file changes."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import basset
from basset import _compile
from basset._compile import source_digest

PACKAGE = Path(basset.__file__).parent

# every phase of every kind of plan, with jumps of every kind, in samples that any machine draws alike
PLAY = """
import numpy as np
import basset

def rules(dt):
    tail = basset.ExponentialSum.fit(12 * dt, 200 * dt, 1e-8)
    yield basset.EulerMaclaurin()
    yield basset.Brush()
    for p in (1, 3, 6):
        yield basset.Daitche(p)
        yield basset.Windowed(basset.Daitche(p), 12 * dt)
        yield basset.Windowed(basset.Daitche(p), 12 * dt, tail)
        yield basset.Exponential(p, 1e-7)

def play():
    dt, results = 0.05, []
    g = np.cos(np.arange(120.0 * 2).reshape(120, 2) * 0.7)
    for rule in rules(dt):
        plan = rule.plan(dt, 119 * dt)
        state = plan.start((2,))
        parts = [plan.run(state, g[:7])]
        plan.jump(state, [0.5, -1.0], 0.3 * dt)
        parts.append(plan.run(state, g[7:40]))
        plan.jump(state, 0.2, 0.0, g[3])
        parts += [plan.tail(state)[None], np.full((1, 2), plan.local(state))]
        parts.append(plan.run(state, g[40:75]))
        plan.jump(state, -0.2, 0.6 * dt, g[5])
        parts += [plan.value(state)[None], plan.run(state, g[75:])]
        results.append(np.concatenate(parts))
    return np.array(results)
"""


def python(code: str, *arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run code in a process of its own that imports the package in `cwd`; it has to end well."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")} | {"PYTHONPATH": str(cwd)} | environment
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, *arguments], cwd=cwd, env=variables, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture
def copied_package(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "basset")  # with its bytecode
    return tmp_path


# `least` is called by a branch that is never taken, then, deeper, by one that is
LINKED = """
from typing import Any, NamedTuple
from basset._compile import compiled, shared

class Parts(NamedTuple):
    number: float
    missing: Any

@shared
def least(x):
    return x + 1.0

@shared
def seldom(parts, x):
    if parts.missing is None:
        return x
    return least(x)

@shared
def deeper(x):
    return 2.0 * least(x)

@shared
def deep(x):
    return 1.0 + deeper(x)

@compiled()
def run(parts, x):
    return seldom(parts, x) + deep(x)

assert run(Parts(1.0, None), 3.0) == 12.0
"""


def test_what_is_called_in_a_branch_that_is_never_taken_is_linked_for_others(tmp_path):
    (tmp_path / "linked.py").write_text(LINKED)
    python("import linked", cwd=PACKAGE.parent, PYTHONPATH=os.pathsep.join((str(PACKAGE.parent), str(tmp_path))), NUMBA_CACHE_DIR=str(tmp_path / "kept"))


class TestTwoExecutions:
    def test_compiled_and_plain_numpy_agree(self, tmp_path):
        """Sums may be reordered by the compiler: 1e-13 of the largest |H|."""
        file = tmp_path / "plain.npy"
        code = PLAY + "import sys, numba\nassert numba.config.DISABLE_JIT\nnp.save(sys.argv[1], play())"
        python(code, str(file), cwd=PACKAGE.parent, NUMBA_DISABLE_JIT="1")
        names: dict = {}
        exec(PLAY, names)
        compiled, plain = names["play"](), np.load(file)
        assert compiled.shape == plain.shape
        for one, other in zip(compiled, plain, strict=True):
            np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-13 * np.abs(other).max())

    def test_a_function_that_is_not_loaded_yet_is_made_a_c_function_once(self):
        @_compile.compiled()
        def late(t, y):
            return -y

        first = _compile.c_function(late, (), np.zeros(2, dtype=np.int64))
        again = _compile.c_function(_compile.itself(late), (), np.zeros(2, dtype=np.int64))
        assert first.address == again.address

    def test_not_a_number_keeps_its_meaning(self):
        """Reordering is allowed, assuming that there are no NaN is not: the inner loops pass them on."""
        from basset.streaming import _loops

        weights, rates = np.ones(5), np.array([1.0, 2.0, np.nan, 3.0, 4.0])
        assert np.isnan(_loops.dot(weights, 0, rates, 0, 5))
        assert _loops.dot(weights, 0, rates, 0, 2) == 3.0
        assert np.isinf(_loops.dot(weights, 0, np.array([1.0, np.inf, 2.0, 3.0, 4.0]), 0, 5))


STREAM = """
import numpy as np
import basset
from basset.streaming import _loops
plan = basset.Windowed(basset.Daitche(2), 0.5).plan(0.1, 2.0)
state = plan.start()
H = plan.run(state, np.ones(8))
hits = sum(sum(f.stats.cache_hits.values()) for f in (_loops.run,))
misses = sum(sum(f.stats.cache_misses.values()) for f in (_loops.run,))
print(H[-1].hex(), hits, misses)
"""


class TestTheCacheOnDisk:
    def test_hits_until_a_source_file_changes(self, copied_package, tmp_path):
        """The edited line lies in a callee of the loop that is entered, the case that numba alone misses. A file that was cut is a warning."""
        cache = tmp_path / "cache"

        def play(warning: str = "") -> tuple[float, int, int]:
            done = python(STREAM, cwd=copied_package, NUMBA_CACHE_DIR=str(cache), PYTHONDONTWRITEBYTECODE="1")
            assert done.stderr.startswith(warning) and done.stderr.count("\n") == bool(warning)
            value, hits, misses = done.stdout.split()
            return float.fromhex(value), int(hits), int(misses)

        def files() -> dict[Path, int]:
            return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb*")}

        first, hits, misses = play()
        assert (hits, misses) == (0, 1)
        assert first == pytest.approx(2.0 * np.sqrt(0.5), rel=1e-14)  # f' = 1 over the window
        written = files()
        assert written

        again, hits, misses = play()
        assert again == first
        assert (hits, misses) == (1, 0)
        assert files() == written  # nothing was compiled, nothing written

        for path in written:
            path.write_bytes(path.read_bytes()[:100])
        mended, hits, misses = play("warning: compiled code cannot be read, so it is compiled again: ")
        assert (mended, hits, misses) == (first, 0, 1)

        source = copied_package / "basset" / "streaming" / "_loops.py"
        text = source.read_text()
        assert text.count("total += weights[start + i] * samples[other + i]") == 1
        source.write_text(text.replace("total += weights[start + i]", "total += 3.0 * weights[start + i]"))
        changed, hits, misses = play()
        assert changed == pytest.approx(3.0 * first, rel=1e-14)
        assert (hits, misses) == (0, 1)

    def test_an_edit_changes_the_digest_where_compiled_code_may_come_from(self, copied_package):
        """Every file that imports the compiler's or defines a NamedTuple, and no other: a new page of help compiles nothing anew."""
        root = copied_package / "basset"
        before = source_digest(root)
        assert before == source_digest(PACKAGE)
        digests, sources = {before}, 0
        for path in sorted(root.rglob("*.py")):
            original = path.read_bytes()
            path.write_bytes(original + b"#")
            text = original.decode()
            if "from basset._compile import" in text or "(NamedTuple)" in text or path.name == "_compile.py":
                sources += 1
                digests.add(source_digest(root))
            elif "_compile" not in text and "NamedTuple" not in text:
                assert source_digest(root) == before
            path.write_bytes(original)
        assert sources >= 5
        (root / "new.py").write_text("from basset._compile import compiled")
        digests.add(source_digest(root))
        (root / "new.py").rename(root / "renamed.py")
        digests.add(source_digest(root))
        assert len(digests) == 3 + sources


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
class TestADamagedCache:
    """Nothing on the disk ends a run or changes a number: one line of warning in a process, and the code is compiled."""

    @pytest.fixture
    def folder(self, tmp_path, monkeypatch):
        monkeypatch.setattr(_compile.compiler().config, "CACHE_DIR", str(tmp_path))
        monkeypatch.setattr(_compile.Keeper, "warned", False)
        return tmp_path

    @staticmethod
    def compiles(argument: float = 3.0) -> int:
        """A function as a new process would have it; how often it had to be compiled."""
        names: list = []

        @_compile.compiled()
        def double(x):
            return 2.0 * x

        with _compile.reported(lambda name, seconds: names.append(name)):
            assert double(argument) == 2.0 * argument
        return len(names)

    @staticmethod
    def file(folder: Path) -> Path:
        (found,) = folder.rglob("*.nbc")
        return found

    @pytest.mark.parametrize(
        "damage",
        [
            lambda content: b"",
            lambda content: content[:20],
            lambda content: content[: len(content) // 2],
            lambda content: content[:-1],
            lambda content: b"no such thing" * 100,
            lambda content: content[:200] + bytes([content[200] ^ 1]) + content[201:],
            lambda content: content[:-50] + bytes([content[-50] ^ 128]) + content[-49:],
        ],
        ids=["empty", "head", "half", "but one byte", "another file", "one bit", "one bit of the code"],
    )
    def test_a_damaged_file_is_compiled_again_and_mended(self, folder, capfd, damage):
        assert (self.compiles(), self.compiles()) == (1, 0)
        path = self.file(folder)
        path.write_bytes(damage(path.read_bytes()))
        assert capfd.readouterr().err == ""
        assert (self.compiles(), self.compiles()) == (1, 0)
        assert capfd.readouterr().err.count("\n") == 1

    def test_a_folder_in_its_place(self, folder, capfd):
        self.compiles()
        path = self.file(folder)
        path.unlink()
        path.mkdir()
        assert (self.compiles(), self.compiles()) == (1, 1)
        said = capfd.readouterr().err
        assert said.startswith("warning: compiled code cannot be read")
        assert said.count("\n") == 1
        assert not list(folder.rglob(".*"))  # nothing half-written stays

    @pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT])
    def test_a_disk_that_takes_nothing(self, folder, capfd, monkeypatch, code):
        def refuse(*arguments):
            raise OSError(code, os.strerror(code))

        with monkeypatch.context() as patch:
            patch.setattr(Path, "write_bytes", refuse)
            assert (self.compiles(), self.compiles()) == (1, 1)
        assert capfd.readouterr().err == f"warning: compiled code cannot be kept, so it is compiled anew each time: [Errno {code}] {os.strerror(code)}\n"
        assert not [path for path in folder.rglob("*") if path.is_file()]
        assert (self.compiles(), self.compiles()) == (1, 0)

    def test_what_may_not_be_read(self, folder, capfd, monkeypatch):
        self.compiles()

        def refuse(path):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))

        monkeypatch.setattr(Path, "read_bytes", refuse)
        monkeypatch.setattr(_compile, "digest_of", lambda package: "")
        assert self.compiles() == 1
        assert "Permission denied" in capfd.readouterr().err

    def test_nowhere_to_write(self, folder, capfd, monkeypatch):
        """Neither the package nor the home directory, as in containers."""

        def refuse(plain):
            raise RuntimeError("cannot cache function: no locator available")

        monkeypatch.setattr(_compile.compiler().core.caching, "FunctionCache", refuse)
        assert (self.compiles(), self.compiles()) == (1, 1)
        assert capfd.readouterr().err.count("\n") == 1

    def test_forms_that_two_processes_wrote_at_once_are_not_mixed_up(self, folder):
        """One of them has not seen the other's: each form has a file of its own, and a file says whose it is."""
        assert (self.compiles(3.0), self.compiles(3)) == (1, 1)  # float64, int64
        one, other = sorted(folder.rglob("*.nbc"))
        one.write_bytes(other.read_bytes())
        assert self.compiles(3.0) + self.compiles(3) == 1
        assert (self.compiles(3.0), self.compiles(3)) == (0, 0)

    def test_two_processes_compile_at_once(self, folder):
        code = "import sys; sys.path.insert(0, sys.argv[1]); import test_compile as t; print(t.TestADamagedCache.compiles())"
        command = [sys.executable, "-W", "error", "-c", code, str(Path(__file__).parent)]
        variables = os.environ | {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_CACHE_DIR": str(folder)}
        both = [subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
        for process in both:
            said, complaints = process.communicate(timeout=300)
            assert (process.returncode, complaints) == (0, "")
            assert said in ("0\n", "1\n")
        assert subprocess.run(command, check=True, env=variables, capture_output=True, text=True, timeout=300).stdout == "0\n"

    def test_a_terminal_is_told_once(self, folder, monkeypatch, capsys):
        self.compiles()
        assert capsys.readouterr().err == ""  # no terminal
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        self.compiles()
        assert capsys.readouterr().err == ""  # a hit
        self.file(folder).unlink()
        self.compiles()
        assert capsys.readouterr().err == f"compiling, once: {__name__}.double (usually some seconds)\n"


class TestStartUp:
    def test_numba_is_imported_by_streams_only(self):
        code = """
import sys
import numpy as np
import basset
basset.integrate(np.ones(9), 0.1, basset.Daitche(3))
basset.cumulate(np.ones(9), 0.1, "daitche")
basset.ExponentialSum.fit(1.0, 9.0, 1e-3)
assert "numba" not in sys.modules
plan = basset.Exponential(3).plan(0.1, 5.0)
plan.push(plan.start(), 1.0)
assert "numba" in sys.modules
"""
        python(code, cwd=PACKAGE.parent)

    def test_numba_may_be_imported_before(self):
        python("import numba, basset; basset.FixedStep(0.1)", cwd=PACKAGE.parent)
