"""The bench command: what it lists, what it refuses, what it leaves behind."""

import json
from types import SimpleNamespace

from click.testing import CliRunner

from bench import __main__ as command


def test_every_suite_asks_a_question_and_is_listed():
    listing = CliRunner().invoke(command.main, ["--help"]).output
    for name, suite in command.FOUND.items():
        assert f"{name}: " in listing
        assert command.question(suite).endswith("?")


def test_unknown_suite_is_one_sentence_and_nothing_is_written(tmp_path):
    result = CliRunner().invoke(command.main, ["fresnle", "--output", str(tmp_path / "data")])
    assert result.exit_code == 2
    assert "did you mean 'fresnel'?" in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "data").exists()


def test_a_suite_writes_one_file_with_its_provenance(tmp_path, monkeypatch):
    monkeypatch.setitem(command.FOUND, "kernels", SimpleNamespace(__doc__="What?", run=lambda full: {"values": [1.0]}))  # the real one takes seconds
    result = CliRunner().invoke(command.main, ["kernels", "--output", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert [path.name for path in tmp_path.iterdir()] == ["kernels.json"]
    content = json.loads((tmp_path / "kernels.json").read_text())
    assert content["provenance"]["command"] == "python -m bench kernels"
    assert set(content["provenance"]) == {"command", "date", "processor", "versions"}
