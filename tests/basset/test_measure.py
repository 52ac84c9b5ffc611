"""Measuring: contenders in turn, exact slopes, files whole or untouched."""

from __future__ import annotations

import json

import numpy as np
import pytest

from basset import measure


class TestInterleaved:
    def test_contenders_take_turns_after_a_warm_up(self):
        calls: list[str] = []
        times = measure.interleaved({name: lambda name=name: calls.append(name) for name in "ab"}, rounds=3, seconds=0.0)
        assert list(times) == ["a", "b"]
        assert all(seconds > 0.0 for seconds in times.values())
        assert "".join(calls) == "aabb" + "ab" * 3

    def test_short_calls_are_repeated(self):
        calls: list[int] = []
        measure.interleaved({"a": lambda: calls.append(1)}, rounds=1, seconds=1e-3)
        assert len(calls) > 3

    def test_keeps_the_minimum(self):
        """A clock that runs by hand: 0.7 s for the first call, 0.6 for the one after, rounds of 0.5, 0.2 and 0.9."""
        clock, durations = [0.0], iter([0.7, 0.6, 0.5, 0.2, 0.9])

        def call() -> None:
            clock[0] += next(durations)

        assert measure.interleaved({"a": call}, rounds=3, seconds=0.0, clock=lambda: clock[0]) == {"a": pytest.approx(0.2, rel=1e-12)}

    def test_a_failing_contender_is_a_row_without_a_time(self):
        times = measure.interleaved({"bad": lambda: 1 // 0, "good": lambda: sum(range(100))}, rounds=2, seconds=0.0)
        assert list(times) == ["bad", "good"]
        assert np.isnan(times["bad"])
        assert times["good"] > 0.0


@pytest.mark.parametrize("order", [0.5, 1.0, 2.0, 4.25])
def test_observed_orders_of_a_power_law(order):
    steps = np.array([1.0, 0.5, 0.3, 0.01])
    orders = measure.observed_orders(steps, 3.0 * steps**order)
    assert orders.shape == (3,)
    np.testing.assert_allclose(orders, order, rtol=1e-14)


class TestWriteJson:
    def test_round_trip(self, tmp_path):
        path = tmp_path / "new" / "records.json"
        content = {"ν": 1e-6, "rows": [1, 2.5, None, "n/a"], "tiny": 5e-324, "third": 1.0 / 3.0}
        measure.write_json(path, content)
        assert json.loads(path.read_text(encoding="utf-8")) == content
        assert "ν" in path.read_text(encoding="utf-8")
        assert [file.name for file in path.parent.iterdir()] == ["records.json"]

    def test_overwrites_as_a_whole(self, tmp_path):
        path = tmp_path / "records.json"
        measure.write_json(path, {"rows": list(range(1000))})
        measure.write_json(path, {"rows": [1]})
        assert json.loads(path.read_text()) == {"rows": [1]}

    def test_a_failing_dump_leaves_the_old_file(self, tmp_path):
        path = tmp_path / "records.json"
        measure.write_json(path, {"rows": [1]})
        before = path.read_bytes()
        with pytest.raises(TypeError):
            measure.write_json(path, {"rows": [1, 2], "function": len})
        assert path.read_bytes() == before
        assert [file.name for file in tmp_path.iterdir()] == ["records.json"]

    def test_an_interrupted_write_leaves_the_old_file(self, tmp_path, monkeypatch):
        path = tmp_path / "records.json"
        measure.write_json(path, {"rows": [1]})

        def full(self, *args, **kwargs):
            with self.open("w") as file:
                file.write("{")
            raise OSError("no space left on device")

        monkeypatch.setattr(type(path), "write_text", full)
        with pytest.raises(OSError, match="no space left"):
            measure.write_json(path, {"rows": [1, 2]})
        assert json.loads(path.read_text()) == {"rows": [1]}


def test_provenance_names_command_machine_and_versions():
    record = measure.provenance("python -m bench", packages=("numpy", "surely-not-a-package"))
    assert record["command"] == "python -m bench"
    assert np.__version__ in record["versions"]
    assert "surely-not-a-package not installed" in record["versions"]
    assert record["processor"].endswith("cores")
    assert len(record["date"]) == len("2000-01-31")
