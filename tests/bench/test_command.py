"""The bench command: what it lists, what it refuses, what it says, what it leaves behind."""

import json
import re

from click.testing import CliRunner

from bench import __main__ as command
from bench import suites


def test_every_suite_asks_a_question_and_is_listed():
    listing = CliRunner().invoke(command.main, ["--help"]).output
    for name in command.FOUND:
        assert f"{name}: {command.question(name)}" in listing
        assert command.question(name).endswith("?")
    assert set(suites.TOO_LONG) < set(command.FOUND)


def test_unknown_suite_is_one_sentence_and_nothing_is_written(tmp_path):
    result = CliRunner().invoke(command.main, ["fresnle", "--output", str(tmp_path / "data")])
    assert result.exit_code == 2
    assert "did you mean 'fresnel'?" in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "data").exists()


def test_a_suite_writes_one_file_with_its_provenance_and_says_so(tmp_path):
    result = CliRunner().invoke(command.main, ["kernels", "--output", str(tmp_path)])
    assert result.exit_code == 0, result.output
    begun, done = result.output.splitlines()  # no terminal: two lines, no bar
    assert begun == f"[1/1] kernels: {command.question('kernels')}"
    assert re.fullmatch(r"\[1/1\] kernels: \d+\.\d s", done)
    assert [path.name for path in tmp_path.iterdir()] == ["kernels.json"]
    content = json.loads((tmp_path / "kernels.json").read_text())
    assert content["provenance"]["command"] == "python -m bench kernels"
    assert set(content["provenance"]) == {"command", "commit", "date", "processor", "versions"}
    assert set(content["sources"]) == {"compiled code", "code"}
    again = CliRunner().invoke(command.main, ["kernels", "--stale", "--output", str(tmp_path)])
    assert (again.exit_code, again.output) == (0, "")


def test_the_commit_is_that_of_the_code(tmp_path, monkeypatch):
    assert re.fullmatch(r"[0-9a-f]{7,40}(-dirty)?|unknown", command.commit())
    monkeypatch.setattr(command, "ROOT", tmp_path)
    assert command.commit() == "unknown"
