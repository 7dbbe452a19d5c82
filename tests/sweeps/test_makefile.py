"""``make reproduce-paper`` with commands that only note how they were called."""

import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
NOTE = 'echo "$(basename "$0") $*" >> "{log}"\n'
ASKED, NEWER = "five_seeds-aaaaaaaa", "five_seeds-bbbbbbbb"


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
def test_the_sweep_that_was_asked_for_is_reported_although_another_is_newer(tmp_path):
    study, log = tmp_path / "paper study", tmp_path / "log"
    for name in (ASKED, NEWER):
        (study / "sweeps" / name).mkdir(parents=True)
    commands = tmp_path / "venv" / "bin"
    commands.mkdir(parents=True)
    for name in ("tlr-train", "tlr-evaluate", "tlr-export", "tlr-report", "tlr-sync", "python"):
        script = NOTE.format(log=log)
        if name == "tlr-train":
            script += f'echo "{study}/sweeps/{ASKED}" > "$TLR_EXP_SWEEP_FILE"\n'
        (commands / name).write_text(f"#!/bin/sh\n{script}")
        (commands / name).chmod(0o755)
    (tmp_path / "venv" / ".installed").touch()  # newer than what would install it again
    subprocess.run(
        ["make", "reproduce-paper", f"VENV={tmp_path}/venv", f"STUDY={study}", "ARGS=seed=0,1"],
        cwd=REPOSITORY,
        check=True,
        capture_output=True,
    )
    train, evaluate, export, report, sync, browser = log.read_text().splitlines()
    assert train.endswith("hydra/launcher=local seed=0,1")
    assert evaluate == f"tlr-evaluate {study} --starts 16 --checkpoint last --force"
    assert NEWER not in log.read_text()
    asked = f"{study}/sweeps/{ASKED}"
    assert export == f"tlr-export {asked} -o {asked}/results --force"
    assert report.startswith(f"tlr-report {asked}/results -o {asked}/report --force")
    assert report.endswith("--repeat make reproduce-paper SCALE=demo ARGS='seed=0,1'")
    assert sync == f"tlr-sync {asked}"
    assert browser.endswith(f"{asked}/report/report.html")
