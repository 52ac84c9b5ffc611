"""What a measurement depends on, and that none on the pages is older than the compiled code."""

import json
import subprocess
import sys

import pytest

from bench import sources

ROOT = sources.ROOT
LOADED = """
import sys
from bench.__main__ import suite
before = set(sys.modules)  # what the command itself needs
suite({name!r}).run(False)
print(*(module.__file__ for name, module in list(sys.modules.items()) if name not in before and getattr(module, "__file__", None)), sep="\\n")
"""


def names(suite):
    return {str(path.relative_to(ROOT)) for path in sources.sources(f"bench.suites.{suite}")}


def test_a_suite_depends_on_what_it_runs_and_not_on_the_rest():
    assert {"bench/suites/grains.py", "saltation/flight/collisions.py", "saltation/effects/magnus.py", "basset/solvers/stepper.py"} <= names("grains")
    assert not {name for name in names("fresnel") if name.startswith("saltation")}
    assert names("kernels") < {"bench/suites/kernels.py", "basset/kernels.py", "basset/_validate.py", "basset/_lazy.py", "basset/spectrum.py"}


@pytest.mark.parametrize("suite", ["kernels", "weights"])
def test_whatever_a_suite_loads_is_among_its_sources(suite):
    loaded = subprocess.run([sys.executable, "-c", LOADED.format(name=suite)], capture_output=True, text=True, check=True, cwd=ROOT).stdout.splitlines()
    own = {file.removeprefix(f"{ROOT}/") for file in loaded if file.startswith(f"{ROOT}/") and "site-packages" not in file}
    handed_on = {name for name in own if name.endswith("__init__.py")}
    assert f"bench/suites/{suite}.py" in own
    assert own - handed_on - names(suite) == set()


def test_only_code_changes_a_digest(tmp_path, monkeypatch):
    def digest(text):
        (tmp_path / "thing.py").write_text(text)
        for kept in (sources.tree, sources.imports, sources.sources, sources.code):
            kept.cache_clear()
        return sources.digest("thing")

    monkeypatch.setattr(sources, "ROOT", tmp_path)
    first = digest('"""One."""\nimport math\n\ndef f(x):\n    """Two."""\n    return x + 1.0  # three\n')
    assert digest("import cmath\n\n\n# four\ndef f(x):\n    return x + 1.0\n") == first
    assert digest("def f(x):\n    return x + 2.0\n") != first
    assert digest("") != first
    for kept in (sources.tree, sources.imports, sources.sources, sources.code):
        kept.cache_clear()


def test_data_without_a_record_of_its_code_is_older_than_it():
    content = {"suite": "kernels"}
    assert sources.changed(content) == "compiled code"
    now = sources.digests("kernels")
    assert sources.changed({**content, "sources": {**now, "code": "0"}}) == "code"
    assert sources.changed({**content, "sources": now}) == ""


DATA = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "reports" / "data").glob("*.json"))}


@pytest.mark.parametrize("name", [name for name, content in DATA.items() if "sources" in content])
def test_no_page_shows_what_older_compiled_code_measured(name):
    """After an edit of compiled code `make report-full` renews what it touches. Data from before the code was recorded is only listed by `--check`."""
    assert sources.changed(DATA[name]) != "compiled code"
