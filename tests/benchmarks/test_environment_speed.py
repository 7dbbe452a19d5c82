"""The benchmark of the environment keeps every row as soon as it is measured."""

import json
import subprocess

import pytest

from benchmarks import environment_speed
from benchmarks.environment_speed import main

ENGINES = ["--physics", "native", "--physics", "mjx physics.impl=jax", "--num-envs", "8", "16"]
ORDER = [
    ("physics=native", 8),
    ("physics=mjx physics.impl=jax", 8),
    ("physics=native", 16),
    ("physics=mjx physics.impl=jax", 16),
]


@pytest.fixture
def output(tmp_path):
    return tmp_path / "speed.json"


@pytest.fixture
def measured(monkeypatch):
    """What was measured; the third time ``stop`` is raised, if set."""
    calls: list[tuple[str, int]] = []
    stop: list[BaseException] = []

    def measure_apart(overrides, num_envs, device, seconds):
        if stop and len(calls) == 2:
            raise stop.pop()
        calls.append((overrides, num_envs))
        return {"physics": overrides, "num_envs": num_envs, "steps_per_s": 1.0, "ready_s": 2.0}

    monkeypatch.setattr(environment_speed, "measure_apart", measure_apart)
    return calls, stop


def rows(path) -> list[tuple[str, int]]:
    return [(row["physics"], row["num_envs"]) for row in json.loads(path.read_text())["rows"]]


@pytest.mark.parametrize("cut", [subprocess.TimeoutExpired("python", 1.0), KeyboardInterrupt()])
def test_what_was_measured_before_a_cut_is_kept_and_gone_on_with(measured, output, cut):
    calls, stop = measured
    stop.append(cut)
    command = [*ENGINES, "--output", str(output)]
    if isinstance(cut, KeyboardInterrupt):
        with pytest.raises(KeyboardInterrupt):
            main(command)
    else:
        assert main(command) == 0
    assert rows(output) == ORDER[:2]
    assert main(command) == 0
    assert calls == rows(output) == ORDER
    assert main(command) == 0
    assert len(calls) == 4
    assert main([*command, "--again"]) == 0
    assert calls[4:] == rows(output) == ORDER


def test_a_row_that_failed_is_tried_again(measured, output):
    calls, _ = measured
    assert main([*ENGINES, "--output", str(output)]) == 0
    record = json.loads(output.read_text())
    record["rows"][1]["error"] = "no memory"
    output.write_text(json.dumps(record))
    assert main([*ENGINES, "--output", str(output)]) == 0
    assert calls[4:] == [ORDER[1]]
    assert sorted(rows(output)) == sorted(ORDER)


@pytest.mark.parametrize("change", [{"device": "another"}, {"versions": {}}, {"rows": None}])
def test_measurements_of_another_machine_are_not_mixed_in_or_lost(measured, output, capsys, change):
    assert main([*ENGINES, "--output", str(output)]) == 0
    before = json.dumps({**json.loads(output.read_text()), **change})
    output.write_text(before)
    assert main([*ENGINES, "--output", str(output)]) == 2
    assert "--again replaces it" in capsys.readouterr().err
    assert output.read_text() == before


def test_an_engine_is_measured_and_ended_in_time(output, capsys):
    command = ["--physics", "native", "--num-envs", "16", "--output", str(output)]
    assert main([*command, "--seconds", "0.2"]) == 0
    assert "out of time" in capsys.readouterr().out
    assert not output.exists()
    assert main(command) == 0
    (row,) = json.loads(output.read_text())["rows"]
    assert row["steps_per_s"] > 0
    assert "error" not in row
