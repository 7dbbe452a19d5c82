"""``make play`` with a command that only notes how it was called."""

import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
GWO = "results/policies/gym_motion-gwo"


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
@pytest.mark.parametrize(
    ("variables", "called"),
    [
        ([], f"{GWO} --web"),
        (["ARGS=--physics mjx"], f"{GWO} --web --physics mjx"),
        (["SHOW=--video", "POLICY=a/b"], "a/b --video"),
    ],
)
def test_a_policy_is_shown_without_training(tmp_path, variables, called):
    commands, log = tmp_path / "venv" / "bin", tmp_path / "log"
    commands.mkdir(parents=True)
    command = commands / "tlr-evaluate"
    command.write_text(f'#!/bin/sh\necho "$*" >> "{log}"\n')
    command.chmod(0o755)
    (tmp_path / "venv" / ".installed").touch()  # newer than what would install it again
    subprocess.run(
        ["make", "play", f"VENV={tmp_path}/venv", *variables],
        cwd=REPOSITORY,
        check=True,
        capture_output=True,
    )
    assert log.read_text() == f"{called}\n"
