"""Waiting for events: with a limit that only a hang reaches, however busy the machine is."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

HANG_S = 1800.0


def wait_for(
    condition: Callable[[], object], *alive: subprocess.Popen, every_s: float = 0.05
) -> None:
    """Until the condition holds, while the processes live."""
    deadline = time.monotonic() + HANG_S
    while not condition():
        for process in alive:
            # A process that ends may just have brought about what is waited for.
            assert process.poll() is None or condition(), said_by(process)
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(every_s)


def said_by(process: subprocess.Popen) -> str:
    """What an ended process printed."""
    said = process.communicate()[0] if process.stdout is not None else None
    return f"ended with {process.returncode}:\n{said}"


def end_group(process: subprocess.Popen) -> None:
    """Kill a process and all of the group that it leads, and see it gone."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


def end_processes_of(folder: Path) -> None:
    """Kill every process whose command line names the folder: a test's own, wherever they went."""
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            own = any(str(folder).encode() in word for word in words)
            if own and int(entry.name) != os.getpid():
                os.kill(int(entry.name), signal.SIGKILL)
