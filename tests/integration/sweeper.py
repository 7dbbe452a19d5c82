"""Whole sweeps in miniature: the real command, its jobs in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO

from tests.patience import HANG_S, end_group, end_processes_of, wait_for
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

LAST = 40
SIZE = (
    "scale.num_envs=32",
    f"scale.iterations={LAST}",
    f"scale.evaluate_every={LAST}",
    "physics.num_threads=1",
)


class Sweeper:
    """Runs ``tlr-train -m`` in the folder of a trainer, in a process group of its own."""

    def __init__(self, trainer) -> None:
        self.trainer = trainer
        self.folder: Path = trainer.folder
        self.environment: Mapping[str, str] = {}
        self.stdout: IO[str] | int = subprocess.PIPE
        self._started: list[subprocess.Popen[str]] = []

    def start(self, *overrides: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "tlr_exp.commands.train", "-m"]
        process = subprocess.Popen(
            [*command, *self.trainer.arguments, *SIZE, *overrides],
            cwd=self.folder,
            env={**os.environ, **self.environment},
            stdin=subprocess.DEVNULL,
            stdout=self.stdout,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._started.append(process)
        return process

    def close(self) -> None:
        """End what a test that failed has left behind: the sweeps, then their jobs."""
        for process in self._started:
            end_group(process)
        end_processes_of(self.folder)

    def end(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        """Exit status and output of a sweep that is left alone from now on."""
        output, _ = process.communicate(timeout=HANG_S)
        return process.returncode, output

    def run(self, *overrides: str) -> tuple[int, str]:
        return self.end(self.start(*overrides))

    @property
    def sweep(self) -> SweepDirectory:
        (found,) = SweepDirectory.find(self.folder)
        return found

    @property
    def runs(self) -> list[RunDirectory]:
        return [RunDirectory.open(path) for path in self.trainer.runs]

    @property
    def statuses(self) -> list[str]:
        """Of the jobs, by number."""
        return [job.status for job in self.sweep.jobs()]

    def lines(self) -> list[int]:
        """How many lines of metrics the runs have; the fewest first."""
        paths = [run.metrics_path for run in self.runs]
        return sorted(path.read_bytes().count(b"\n") for path in paths if path.exists())

    def wait(self, condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
        """Until the condition holds, while the process lives."""
        wait_for(condition, process, every_s=0.02)
