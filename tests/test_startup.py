"""Commands that compute nothing, and the imports of the packages, load only what they need."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

from basset._ahead import TASKS

ROOT = Path(__file__).resolve().parents[1]
HEAVY = (
    "numba", "scipy.fft", "scipy.integrate", "scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.spatial", "scipy.stats",
    "xarray", "pandas", "matplotlib", "mpmath", "PIL", "distributed", "dask",
)  # fmt: skip
COMMANDS = ("scipy", "pydantic", "rich")  # beside those: not for help
PACKAGES = ("numpy", "click")  # beside those: not for an import

# says for every forbidden module that is loaded who asked for it: the nearest frames that are no part of the import machinery
WATCH = """
import runpy, sys
forbidden = sys.argv[1].split(",")
found = {}

class Watch:
    def find_spec(self, name, path=None, target=None):
        for bad in forbidden:
            if (name == bad or name.startswith(bad + ".")) and bad not in found:
                frame, chain = sys._getframe(1), []
                while frame is not None:
                    file = frame.f_code.co_filename
                    if not file.startswith("<frozen importlib") and "importlib" not in file and file != "<string>":
                        chain.append(f"{file}:{frame.f_lineno}")
                    frame = frame.f_back
                found[bad] = " < ".join(chain[:4])
        return None

sys.meta_path.insert(0, Watch())
sys.argv = sys.argv[2:]
try:
    if sys.argv[0] == "-c":
        exec(sys.argv[1])
    else:
        runpy.run_module(sys.argv[0], run_name="__main__")
finally:
    for name, who in found.items():
        print(f"LOADED {name} by {who}", file=sys.stderr)
"""

CASES = {
    "basset --help": (*HEAVY, *COMMANDS, "numpy"),
    "saltation --help": (*HEAVY, *COMMANDS, "numpy"),
    "saltation run --help": (*HEAVY, *COMMANDS, "numpy"),
    "basset compare --help": (*HEAVY, *COMMANDS, "numpy"),
    "saltation check sand": (*HEAVY, "scipy"),
    "saltation check sand_cloud": (*HEAVY, "scipy"),
    "saltation schema": (*HEAVY, "scipy", "rich"),
    "saltation scenes": (*HEAVY, "scipy"),
    "basset weights daitche --steps 9": (*HEAVY, "scipy", "pydantic", "rich"),
    "-c|import basset": (*HEAVY, *COMMANDS, *PACKAGES),
    "-c|import saltation": (*HEAVY, *COMMANDS, *PACKAGES),
    "-c|from basset import *": (*HEAVY, *COMMANDS, "click"),
    "-c|import saltation; saltation.load('sand')": (*HEAVY, "scipy", "rich", "click"),
    "-c|import saltation; saltation.open": ("numba", "matplotlib", "mpmath", "scipy.stats", "scipy.signal", "scipy.optimize"),
    "-c|from saltation import *": ("numba", "matplotlib", "scipy.stats", "scipy.signal", "scipy.optimize"),
}


def loaded(words: str, forbidden: tuple[str, ...], root: Path = ROOT) -> list[str]:
    """What of the forbidden a fresh process loads, and who asks for it."""
    variables = os.environ | {"PYTHONPATH": str(root)}
    command = [sys.executable, "-c", WATCH, ",".join(forbidden), *(words.split("|") if "|" in words else words.split())]
    done = subprocess.run(command, cwd=root, env=variables, capture_output=True, encoding="utf-8", timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return [line for line in done.stderr.splitlines() if line.startswith("LOADED")]


@pytest.mark.parametrize("words", CASES)
def test_nothing_is_loaded_that_is_not_needed(words):
    assert not loaded(words, CASES[words])


@pytest.mark.parametrize(
    ("file", "line", "words"),
    [
        ("saltation/scene/model.py", "import xarray", "saltation check sand"),
        ("basset/__init__.py", "import scipy.signal", "-c|import basset"),
    ],
)
def test_an_import_at_the_top_is_found_and_its_place_named(tmp_path, file, line, words):
    for package in ("basset", "saltation"):
        shutil.copytree(ROOT / package, tmp_path / package)  # with its bytecode
    source = tmp_path / file
    source.write_text(
        source.read_text(encoding="utf-8").replace("\nimport ", f"\n{line}\nimport ", 1).replace("\nfrom typing", f"\n{line}\nfrom typing", 1), encoding="utf-8"
    )
    name = line.split()[1]
    (found,) = loaded(words, (name,), tmp_path)
    assert found.startswith(f"LOADED {name} by {source}:")


def test_the_packages_list_their_names():
    import basset
    import saltation

    for package in (basset, saltation):
        assert set(package.__all__) <= set(dir(package))
        for name in package.__all__:
            assert getattr(package, name) is getattr(package, name)
        with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
            package.nothing
        assert not hasattr(package, "__wrapped__")


COUNT = """
import sys
from basset import _compile
numba = _compile.compiler()
compiled = []

class Count(numba.core.event.Listener):
    def on_start(self, event):
        compiled.append(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, event):
        pass

numba.core.event.register("numba:compile", Count())
if sys.argv[1] == "saltation":
    from saltation.cli import main
else:
    from basset.cli import main
try:
    if sys.argv[1] == "python":
        exec(sys.argv.pop())
    for words in " ".join(sys.argv[2:]).split(" then ") if sys.argv[2:] else ():
        try:
            main(words.split())
        except SystemExit as done:
            if done.code:
                raise
finally:
    print("COMPILED", *compiled, file=sys.stderr)
"""


def command(*words: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Commands of one package, with "then" between them, or lines of Python, in a fresh process."""
    variables = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"} | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", COUNT, *words], cwd=cwd, env=variables, capture_output=True, encoding="utf-8", timeout=600, check=False
    )


def test_a_run_after_a_warmup_compiles_nothing():
    scenes = "bouncing", "settling", "sand_cloud"
    warm = command("saltation", "warmup", *scenes)
    assert warm.returncode == 0, warm.stderr
    for scene in scenes:
        assert f"{scene}: looking" in warm.stdout  # also without a terminal
        assert f"{scene}: ready" in warm.stdout
    runs = command("saltation", "run bouncing then run settling then run sand_cloud --set run.duration=0.03")
    assert (runs.returncode, runs.stderr) == (0, "COMPILED\n")
    assert runs.stdout.count("finished: ") == 3


def test_what_the_readme_shows_compiles_nothing_after_a_warmup(tmp_path):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = [line.split("  #")[0].removeprefix("basset ") for line in re.findall(r"^basset .*", text, re.M)]
    assert {line.split()[0] for line in commands} == {"advise", "compare", "weights", "history", "sum"}
    t = 0.05 * np.arange(401)
    np.savetxt(tmp_path / "samples.csv", np.column_stack([t, np.cos(t)]), delimiter=",", header="t,rate", comments="")
    fields = {name: (("trajectory", "obs"), [np.sin(t + k), np.cos(t)]) for k, name in enumerate(("u", "v", "uf", "vf"))}
    xarray.Dataset(fields, {"time": ("obs", t)}).to_netcdf(tmp_path / "tracks.nc", engine="scipy")
    assert command("basset", "warmup").returncode == 0
    lines = re.search(r"^```python\n(.*?)^```$", text, re.M | re.S)[1]
    for words in (("basset", "compare fresnel then " + " then ".join(commands)), ("python", lines)):
        done = command(*words, cwd=tmp_path)
        assert (done.returncode, done.stderr.splitlines()[-1]) == (0, "COMPILED"), done.stderr
    assert command("basset", "warmup").stdout.count("all was compiled before") == len(TASKS)


def test_particles_after_a_warmup_compile_no_more_than_their_equation(tmp_path):
    assert command("basset", "warmup").returncode == 0
    guide = (ROOT / "reports" / "guide.md").read_text(encoding="utf-8")
    (lines,) = (code for code in re.findall(r"^```python\n(.*?)^```$", guide, re.M | re.S) if "maxey_riley" in code)
    done = command("python", lines, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not {"march", "march_many", "sample"} & set(done.stderr.split())


def test_a_scene_that_is_none_is_a_mistake_before_anything_is_compiled():
    done = command("saltation", "warmup", "sand", "snad")
    assert done.returncode == 2
    assert "did you mean" in done.stderr
    assert not done.stdout


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [(KeyboardInterrupt, 130, "stopped: nothing is kept\n"), (EOFError, 1, "Error: a file ends too early"), (MemoryError, 1, "Error: out of memory")],
)
def test_a_command_that_is_stopped_says_a_sentence(monkeypatch, error, status, sentence):
    from click.testing import CliRunner

    from basset import cli, comparison

    def stop(*arguments):
        raise error

    monkeypatch.setattr(comparison, "of_problem", stop)
    done = CliRunner().invoke(cli.main, ["compare", "fresnel"])
    assert done.exit_code == status
    assert done.stderr.startswith(sentence)
    assert "Aborted" not in done.output


INTERRUPT = """
import os, runpy, signal, sys

class Interrupt:
    def find_spec(self, name, *_):
        if name == sys.argv[2]:
            os.kill(os.getpid(), signal.SIGINT)

signal.signal(signal.SIGINT, signal.default_int_handler)  # shells ignore it in the background
sys.meta_path.insert(0, Interrupt())
runpy.run_module(sys.argv[1], run_name="__main__", alter_sys=True)
"""


@pytest.mark.parametrize(
    ("package", "module"), [("basset", "click"), ("basset", "basset.cli"), ("saltation", "saltation.cli"), ("saltation", "saltation._files")]
)
def test_an_interrupt_while_modules_are_loaded_is_a_sentence(package, module):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPT, package, module], capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "stopped: nothing is kept\n")


def test_an_interrupt_while_words_are_parsed_is_a_sentence(monkeypatch):
    from click import Group
    from click.testing import CliRunner

    from basset import cli

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(Group, "make_context", stop)
    done = CliRunner().invoke(cli.main, ["compare", "fresnel"])
    assert (done.exit_code, done.stdout, done.stderr) == (130, "", "stopped: nothing is kept\n")
