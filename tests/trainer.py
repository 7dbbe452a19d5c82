"""Whole runs in miniature: the real command in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

from tests.patience import HANG_S, end_processes_of

TINY = (
    "scale.num_envs=16",
    "scale.iterations=6",
    "scale.checkpoint_every=2",
    "scale.evaluate_every=3",
    "ppo.num_steps=8",
    "ppo.hidden_sizes=[32]",
    "num_threads=1",
    "physics.num_threads=2",
)


class Trainer:
    """Runs ``tlr-train`` at a tiny scale in one working directory."""

    def __init__(self, folder: Path, motion: Path) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[str]] = []
        self.arguments = [*TINY, f"env.motion={motion}", "tracking_uri=none"]

    def start(self, *overrides: str) -> subprocess.Popen[str]:
        # Hydra wants its flags before all overrides.
        flags = [argument for argument in overrides if argument.startswith("-")]
        changes = [argument for argument in overrides if argument not in flags]
        process = self.command(self.folder, *flags, *self.arguments, *changes)
        self._started.append(process)
        return process

    def close(self) -> None:
        """End what a test that failed has left behind."""
        for process in self._started:
            if process.poll() is None:
                process.kill()
                process.communicate()
        end_processes_of(self.folder)

    @staticmethod
    def command(folder: Path, *arguments: str) -> subprocess.Popen[str]:
        """``tlr-train`` with these arguments alone, in any folder."""
        return subprocess.Popen(
            [sys.executable, "-m", "tlr_exp.commands.train", *arguments],
            cwd=folder,
            env={**os.environ, "HYDRA_FULL_ERROR": "1"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def run(self, *overrides: str) -> tuple[int, str]:
        """Exit status and output of a run that is left alone."""
        process = self.start(*overrides)
        output, _ = process.communicate(timeout=HANG_S)
        return process.returncode, output

    @classmethod
    def call(cls, folder: Path, *arguments: str) -> tuple[int, str]:
        """Exit status and output of ``command``."""
        process = cls.command(folder, *arguments)
        output, _ = process.communicate(timeout=HANG_S)
        return process.returncode, output

    @property
    def runs(self) -> list[Path]:
        return sorted(manifest.parent for manifest in self.folder.glob("runs/*/*/manifest.json"))
