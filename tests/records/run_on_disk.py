"""A run's configuration, and what befalls its files: kills and full disks."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

CONFIG = {"seed": 3, "ppo": {"gamma": 0.99, "rate": 1e-5, "hidden": [512, 256]}, "note": None}


def start_python(code: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", textwrap.dedent(code), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def kill(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


def full_disk_at(path: Path) -> None:
    """Every write to `path` fails with the system's own ENOSPC."""
    path.symlink_to("/dev/full")
