"""Keeps a live mirror going until the process that it follows has ended or is gone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

from tlr_exp.records.directory import RUNNING, RecordDirectory

TICK_S = 0.25  # how often the followed folder is looked at
POLL_S = 2.0  # how often its new lines are brought over
MAX_WAIT_S = 60.0  # longest pause between tries while the store is away
LAST_WAIT_S = 5.0  # the same once all is over
GIVE_UP_S = 60.0  # how long after the end the store may stay away
GIVE_UP_AT_ONCE_S = 3.0  # the same where it was away all along


def follow(is_over: Callable[[], bool], push: Callable[[], bool]) -> bool:
    """Call `push` every POLL_S, more seldom while it fails, until one worked after the end.

    After the end it is tried for GIVE_UP_S more seconds (GIVE_UP_AT_ONCE_S if it never worked).
    Returns whether a push after the end worked.
    """
    wait, next_try, give_up, ever_worked = POLL_S, time.monotonic(), float("inf"), False
    while True:
        # Looked at before the push, so that the last push comes after the last line.
        ended = is_over()
        if ended and give_up == float("inf"):
            next_try = time.monotonic()
            give_up = next_try + (GIVE_UP_S if ever_worked else GIVE_UP_AT_ONCE_S)
        if time.monotonic() >= next_try:
            worked = push()
            ever_worked = ever_worked or worked
            if ended and worked:
                return True
            wait = POLL_S if worked else min(2 * wait, LAST_WAIT_S if ended else MAX_WAIT_S)
            next_try = time.monotonic() + wait
        if time.monotonic() >= give_up:
            return False
        time.sleep(TICK_S)


def has_ended(source: RecordDirectory, process: WatchedProcess) -> bool:
    """Whether `process` is gone, or has itself given the run or the sweep a final status.

    A final status of an earlier process says nothing: this one is about to go on. A sweep whose
    process is gone has not ended while runs of it still train.

    Raises:
        RecordError: the directory is gone.
    """
    if not process.alive():
        return not source.has_live_runs()
    manifest = source.manifest
    return manifest["status"] != RUNNING and manifest.get("pid") == process.pid


class WatchedProcess:
    """A process by its id and start time, so that another one with the same id is not it."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._started = _start_time(pid)

    def alive(self) -> bool:
        """Whether it still runs; one that has ended and was not yet waited for does not."""
        return self._started is not None and _start_time(self.pid) == self._started


def _start_time(pid: int) -> str | None:
    """When process `pid` started, in the system's own words; None if it does not run."""
    try:
        # Fields after the name, which stands in parentheses: state is the 1st, start time the 20th.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return None if fields[0] in "ZX" else fields[19]
    except FileNotFoundError:
        if Path("/proc/self/stat").exists():
            return None
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return None
    except PermissionError:
        pass
    return "running"  # no /proc: the id alone
