"""benchmarks/accelerator.sh keeps its time and its records; its commands only note how called."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "accelerator.sh"
TOOLS = ("bash", "timeout", "awk")
FAKE_PYTHON = """#!/usr/bin/env bash
echo "$*" >> "$LOG"
case "$*" in
  *"-m pytest"*)
    [[ $TESTS_TAKE = 0 ]] || exec sleep "$TESTS_TAKE"
    echo "7 passed"; exit "$TESTS_END" ;;
  *"-m tlr_exp.commands.train"*)
    trap 'echo stopped >> "$LOG"; exit 130' INT; while :; do sleep 0.1; done ;;
esac
"""

pytestmark = pytest.mark.skipif(
    any(shutil.which(tool) is None for tool in TOOLS), reason=f"needs {', '.join(TOOLS)}"
)


@pytest.fixture
def call(tmp_path):
    """``call(minutes, **variables)``: exit status, seconds, and the calls of this time."""
    commands, log = tmp_path / "bin", tmp_path / "log"
    commands.mkdir()
    for name, text in (("python", FAKE_PYTHON), ("nvidia-smi", "#!/bin/sh\necho a GPU\n")):
        (commands / name).write_text(text)
        (commands / name).chmod(0o755)

    def run(minutes: float, **variables: str) -> tuple[int, float, list[str]]:
        log.write_text("")
        environment = {
            **os.environ,
            "PATH": f"{commands}:{os.environ['PATH']}",
            "PYTHON": str(commands / "python"),
            "LOG": str(log),
            "MINUTES": str(minutes),
            **{"TESTS_TAKE": "0", "TESTS_END": "0", **variables},
        }
        start = time.monotonic()
        done = subprocess.run(["bash", SCRIPT, tmp_path / "out"], env=environment, check=False)
        return done.returncode, time.monotonic() - start, log.read_text().splitlines()

    return run


def test_a_second_call_goes_on_and_does_not_repeat(call, tmp_path):
    status, seconds, (tests, speed, train, end) = call(0.06)
    assert status == 0
    assert seconds < 0.06 * 60 + 2
    assert "-m gpu" in tests
    assert speed.startswith("benchmarks/environment_speed.py --device cuda --num-envs 4096 8192")
    assert f"--output {tmp_path}/out/environment_speed.json" in speed
    assert "--again" not in speed
    assert "scale=paper" in train
    assert "resume=auto" in train
    assert end == "stopped"  # by a signal, for a checkpoint
    assert (tmp_path / "out" / "device.csv").read_text() == "a GPU\n"
    log = tmp_path / "out" / "gpu_tests.log"
    assert log.read_text() == "7 passed\nexit status 0\n"
    status, _, (speed, train, _) = call(0.06, DEVICE="cpu", NUM_ENVS="8", TRAIN="seed=3 a=b")
    assert status == 0
    assert "--device cpu --num-envs 8 " in speed
    assert "device=cpu" in train
    assert train.endswith("seed=3 a=b")
    _, _, (tests, speed, *_) = call(0.06, AGAIN="1")
    assert "-m gpu" in tests
    assert "--again" in speed


def test_tests_that_take_too_long_leave_time_for_the_rest(call, tmp_path):
    status, seconds, calls = call(0.1, TESTS_TAKE="60")
    assert status == 0
    assert seconds < 0.1 * 60 + 2
    assert [line.split()[-1] == "stopped" for line in calls] == [False, False, False, True]
    assert not (tmp_path / "out" / "gpu_tests.log").exists()  # to be made by the next call
    assert (tmp_path / "out" / "gpu_tests.log.part").exists()


def test_tests_that_fail_are_told_by_every_call_until_they_are_repeated(call):
    assert call(0.05, TESTS_END="1")[0] == 1
    status, _, (speed, *_) = call(0.05)
    assert status == 1
    assert "environment_speed" in speed
    assert call(0.05, AGAIN="1")[0] == 0
