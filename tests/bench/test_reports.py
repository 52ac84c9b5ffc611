"""The pages: what the analysis makes of records."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from reports import build, quadrature, words

ROOT = Path(build.__file__).resolve().parent.parent


def record(n, seconds, error, scheme="Daitche(2)"):
    return {"scheme": scheme, "n": n, "seconds": seconds, "error_max": error}


def test_a_rule_has_reached_a_tolerance_only_if_it_stays_there():
    records = [record(8, 1.0, 1e-3), record(16, 2.0, 1e-1), record(32, 3.0, 1e-3), record(64, 4.0, 1e-4)]
    assert words.reaches(records, 1e-2)["n"] == 32
    assert words.reaches(records, 1e-5) is None


def test_the_cheapest_come_with_what_is_as_cheap_fewest_samples_first():
    records = [record(16, 2.0, 1e-3), record(8, 2.1, 1e-3, "Brush"), record(4, 3.0, 1e-3, "Hinsberg"), record(8, 1.0, 1.0, "Euler–Maclaurin")]
    assert [r["scheme"] for r in quadrature.as_cheap(records, 1e-2)] == ["Brush", "Daitche(2)"]


def test_small_numbers_are_short():
    assert [words.short(x) for x in (1e-9, 3.2e-14, 0.1)] == ["1e-9", "3e-14", "1e-1"]
    assert words.short(2.54e-10, 1) == "2.5e-10"


def test_templates_ask_for_numbers_by_form():
    given = {"row": {"n": 65536, "time": 1.204e-4, "error": 3.2e-14, "ratio": 1530.0, "share": 0.0421, "bytes": 888, "name": "Brush"}}
    asked = "{row[name]}: {row[n]:n} in {row[time]:s}, {row[bytes]:B}, {row[error]:e} ({row[error]:e1}), {row[share]:%}, {row[ratio]:x} ×, {row[ratio]:.0f}"
    assert words.Words().vformat(asked, (), given) == "Brush: 65 536 in 120 µs, 888 B, 3e-14 (3.2e-14), 4.2 %, 1 500 ×, 1530"


def test_numbers_are_as_people_write_them():
    assert [words.seconds(x) for x in (None, 2.5, 0.00205, 7.6e-6, 2.4e-8)] == ["–", "2.5 s", "2.05 ms", "7.6 µs", "24 ns"]
    assert [words.storage(x) for x in (888, 7.83e8, 2.5e9)] == ["888 B", "783 MB", "2.5 GB"]
    assert words.span([3.0, -1.0]) == "−1 to 3" and words.span([1.01, 1.02], "{:.1f}") == "1.0"
    assert [words.listed(x) for x in ([], ["a"], ["a", "b", "c"])] == ["nothing", "a", "a, b and c"]


def test_what_needs_peers_does_without():
    data = build.load(ROOT / "reports" / "data")
    del data["peers"]
    assert "make report-full" in quadrature.peers(data)


@pytest.fixture
def two_pages(monkeypatch):
    """The command with one page to measure, one that is too long for that, and one of both; the records of all suites."""
    pages = [page for page in build.PAGES if page.name in ("advice", "choosing")]
    both = replace(pages[0], name="both", suites=("advice", "choosing"), build=lambda data: f"# Both\n\n{len(data['advice']['rows'])} rows.\n\nend")
    monkeypatch.setattr(build, "PAGES", (*pages, both))
    monkeypatch.setattr(build, "WRITTEN", ())  # they link to all others
    monkeypatch.setattr(build, "PICTURES", (build.Picture("advice_ratios", "advice", "Times: over the fastest."),))
    return build.load(ROOT / "reports" / "data")


def test_what_was_measured_here_comes_before_what_is_committed_which_says_when_and_where(tmp_path, two_pages, coarse):
    own = two_pages["advice"] | {"provenance": two_pages["advice"]["provenance"] | {"date": "2031-01-02", "commit": "fedc321", "processor": "Z80"}}
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "advice.json").write_text(json.dumps(own | {"rows": own["rows"][:-12]}), encoding="utf-8")
    committed = {path: path.stat().st_mtime_ns for path in (ROOT / "reports").glob("*.*")}
    result = CliRunner().invoke(build.main, ["--output", str(tmp_path)])
    assert result.exit_code == 0, result.output
    first, last = result.output.splitlines()
    assert [Path(line.split(": ")[1]).resolve() for line in (first, last)] == [(tmp_path / name).resolve() for name in ("advice.md", "index.html")]

    texts = {name: (tmp_path / name).read_text(encoding="utf-8") for name in ("advice.md", "choosing.md", "both.md", "README.md", "index.html")}
    found = two_pages["choosing"]["provenance"]
    note = (
        f"Kept as committed, not measured here: choosing, measured on {found['date']} at commit {found['commit']}, {found['processor']} (`{found['command']}`)."
    )
    assert {name: note in text for name, text in texts.items()} == {name: name not in ("advice.md", "index.html") for name in texts}
    assert {path.name for path in (tmp_path / "examples").iterdir()} == {path.name for path in (ROOT / "reports" / "examples").glob("*.py")}
    assert "commit fedc321, Z80" in texts["advice.md"] and "Kept" not in texts["advice.md"]
    assert f"{len(own['rows']) - 12} rows" in texts["both.md"]
    assert texts["choosing.md"].replace(f"*{note}*\n\n", "") == (ROOT / "reports" / "choosing.md").read_text(encoding="utf-8")
    assert texts["index.html"].count("Kept as committed") == 4  # two pages and their summaries
    for text in texts.values():
        assert [name for name in re.findall(r"\(figures/([^)]+)\)", text) if not (tmp_path / "figures" / name).exists()] == []
    assert committed == {path: path.stat().st_mtime_ns for path in (ROOT / "reports").glob("*.*")}


def test_a_clone_stays_clean():
    if not (shutil.which("make") and shutil.which("git") and (ROOT / ".git").exists()):
        pytest.skip("needs make, git and a clone")
    told = subprocess.run(["make", "-n", "report"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    writers = [line for line in told.splitlines() if re.search(r"-m (bench|reports)", line)]
    assert len(writers) > 1 and all(re.search(r"--output reports/local(/data)?$", line) for line in writers)
    subprocess.run(["git", "check-ignore", "-q", "reports/local/data/fresnel.json"], cwd=ROOT, check=True)
