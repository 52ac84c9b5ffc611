"""The pages: what the analysis makes of records."""

from pathlib import Path

from reports import analysis, build

ROOT = Path(build.__file__).resolve().parent.parent


def record(n, seconds, error, scheme="Daitche(2)"):
    return {"scheme": scheme, "n": n, "seconds": seconds, "error_max": error}


def test_a_rule_has_reached_a_tolerance_only_if_it_stays_there():
    records = [record(8, 1.0, 1e-3), record(16, 2.0, 1e-1), record(32, 3.0, 1e-3), record(64, 4.0, 1e-4)]
    assert analysis.reaches(records, 1e-2)["n"] == 32
    assert analysis.reaches(records, 1e-5) is None


def test_the_cheapest_come_with_what_is_as_cheap_fewest_samples_first():
    records = [record(16, 2.0, 1e-3), record(8, 2.1, 1e-3, "Brush"), record(4, 3.0, 1e-3, "Hinsberg"), record(8, 1.0, 1.0, "Euler–Maclaurin")]
    assert [r["scheme"] for r in analysis.cheapest(records, 1e-2)] == ["Brush", "Daitche(2)"]


def test_small_numbers_are_short():
    assert [analysis.short(x) for x in (1e-9, 3.2e-14, 0.1)] == ["1e-9", "3e-14", "1e-1"]
    assert analysis.short(2.54e-10, 1) == "2.5e-10"


def test_pages_need_no_peers_and_time_nothing(tmp_path, monkeypatch):
    data = build.load(ROOT / "reports" / "data")
    data.pop("peers", None)
    monkeypatch.setattr(build, "save", lambda figure, name: build.figures.save(figure, tmp_path, name))
    page = build.quadrature(data)
    assert "make report-full" in page
    assert page.rstrip().splitlines()[-1].startswith("* ")
    assert {path.suffix for path in tmp_path.iterdir()} == {".svg", ".png"}
