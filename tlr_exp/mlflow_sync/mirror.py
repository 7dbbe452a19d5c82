"""Starting and ending the live mirror of a run or a sweep in MLflow, without importing MLflow.

Training only appends to its run directory. The mirror is a process of its own
(`python -m tlr_exp.commands.sync FOLDER --follow PID`) at a low priority, so that neither MLflow's
import nor a tracking server that is slow, locked or away can hold training up.

A sweep has one mirror, which brings the runs of all its jobs over: importing MLflow costs seconds
of processor time, so the jobs start none of their own (`Mirror.start` with no URI).
"""

from __future__ import annotations

import logging
import os
import shlex
import subprocess
import sys
from pathlib import Path

from tlr_exp.machine import variables
from tlr_exp.mlflow_sync.tracking_uri import check_tracking_uri
from tlr_exp.records.credentials import has_credentials
from tlr_exp.records.directory import RecordDirectory

LOG = "sync.log"

_log = logging.getLogger(__name__)

# Mirrors that outlive `finish`. Kept, because a Popen object that is collected while its process
# runs emits a ResourceWarning.
_left_behind: list[subprocess.Popen[bytes]] = []


class Mirror:
    """The process that brings a run, or a sweep with its runs, into MLflow while it goes on.

    Starting costs milliseconds.
    """

    def __init__(
        self,
        source: RecordDirectory,
        uri: str | None,
        experiment: str,
        process: subprocess.Popen | None,
        log_start: int = 0,
    ) -> None:
        self._path, self._uri, self._experiment = source.path, uri, experiment
        self._process, self._log_start = process, log_start

    @classmethod
    def start(cls, source: RecordDirectory, tracking_uri: str | None, experiment: str) -> Mirror:
        """Start the mirror of the run or the sweep of this process; `tracking_uri` None means none.

        A sweep must have begun (`SweepDirectory.begin`). The mirror ends after this process has
        given `source` a final status, or is gone; and, of a sweep, no run of it trains any more.
        A mirror that cannot be started is logged and never an error: `finish` then says False.

        Raises:
            UserError: the URI is of no usable kind.
        """
        if tracking_uri is None:
            return cls(source, None, experiment, None)
        uri = check_tracking_uri(tracking_uri)
        process, log_start = None, 0
        try:
            log = source.path / LOG
            log_start = log.stat().st_size if log.exists() else 0
            process = _launch(source.path, uri, experiment)
        except OSError as error:
            _log.warning("%s is not mirrored to MLflow while it trains: %s", source.path, error)
        return cls(source, uri, experiment, process, log_start)

    def finish(self, timeout_s: float = 30.0) -> bool:
        """Wait for the mirror after the final status was written; whether all reached MLflow.

        Past `timeout_s` the mirror is left to go on by itself (it ends within about a minute), and
        the answer is False. With tracking off it is True.
        """
        if self._uri is None:
            return True
        if self._process is None:
            return False
        try:
            return self._process.wait(timeout_s) == 0
        except subprocess.TimeoutExpired:
            _left_behind.append(self._process)
            return False

    @property
    def what_is_missing(self) -> str:
        """For a person, after `finish` said False: why, as far as it is known, and what helps."""
        why = self._last_word()
        return (
            f"not all of it has reached MLflow yet{f': {why}' if why else ''}\n"
            f"copy the rest    {self.sync_command}"
        )

    def _last_word(self) -> str:
        """What the mirror wrote last, without the time."""
        try:
            with open(self._path / LOG, "rb") as log:
                log.seek(self._log_start)
                lines = log.read().decode(errors="replace").strip().splitlines()
        except OSError:
            return ""
        return lines[-1].split(" ", 2)[-1] if lines else ""

    @property
    def sync_command(self) -> str:
        """The command line that brings all over by hand, for the message when it did not."""
        # With credentials it came from the variable, which holds for the command, too.
        named = self._uri is not None and not has_credentials(self._uri)
        store = ["--tracking-uri", str(self._uri)] if named else []
        name = ["--experiment", self._experiment]
        return shlex.join(["tlr-sync", str(self._path), *store, *name])


def _launch(folder: Path, uri: str, experiment: str) -> subprocess.Popen:
    arguments = [str(folder), "--follow", str(os.getpid()), "--experiment", experiment]
    # The URI goes by the environment: it may hold a password, and command lines are public.
    environment = {**os.environ, variables.TRACKING_URI: uri, "OMP_NUM_THREADS": "1"}
    with open(folder / LOG, "ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "tlr_exp.commands.sync", *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,  # Ctrl-C in the terminal is for the training alone
        )
