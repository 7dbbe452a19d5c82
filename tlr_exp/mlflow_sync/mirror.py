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
from urllib.parse import urlsplit

from tlr_exp.machine import variables
from tlr_exp.records.credentials import has_credentials, hide_password
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

LOG = "sync.log"
STORE = "mlflow.db"
MAX_FILE_MB = 64.0  # larger checkpoints and videos stay in the run directory (0: all of them)

_SQLITE = "sqlite:///"
_SCHEMES = ("http", "https", "sqlite", "postgresql", "mysql", "mssql")

_log = logging.getLogger(__name__)

# Mirrors that outlive `finish`. Kept, because a Popen object that is collected while its process
# runs emits a ResourceWarning.
_left_behind: list[subprocess.Popen[bytes]] = []


def default_tracking_uri(root: str | Path) -> str:
    """MLFLOW_TRACKING_URI where it is set, else the sqlite store mlflow.db in `root`.

    Raises:
        ValueError: the variable holds something that cannot be used (see `check_tracking_uri`).
    """
    from_environment = variables.tracking_uri()
    if from_environment:
        return check_tracking_uri(from_environment)
    return f"{_SQLITE}{Path(root).absolute() / STORE}"


def check_tracking_uri(uri: str) -> str:
    """`uri` with a sqlite path made absolute, because the mirror runs in another folder.

    Raises:
        ValueError: not a kind of store that MLflow 3 can write to; names the kinds.
    """
    scheme = urlsplit(uri).scheme.partition("+")[0]
    if scheme not in _SCHEMES:
        raise ValueError(
            f"tracking URI {hide_password(uri)!r}: must be http://HOST:PORT, sqlite:///FILE or "
            f"another of {', '.join(_SCHEMES)} (MLflow no longer writes to plain folders)"
        )
    if scheme != "sqlite":
        return uri
    path = sqlite_path(uri)
    if path is None:
        raise ValueError(f"tracking URI {uri!r}: name a file, as in sqlite:///runs/mlflow.db")
    return f"{_SQLITE}{path.absolute()}"


def sqlite_path(uri: str) -> Path | None:
    """The database file of a sqlite URI, None for every other URI and for one in memory."""
    if not uri.startswith(_SQLITE):
        return None
    name = uri.removeprefix(_SQLITE).partition("?")[0]
    return Path(name) if name and name != ":memory:" else None


def how_to_open(uri: str, runs_dir: Path) -> str:
    """For messages: the address of a server, or the command that opens a store."""
    if uri.startswith("http"):
        return hide_password(uri)
    if sqlite_path(uri) == runs_dir / STORE:
        return f"tlr-dashboard {runs_dir}"
    return f"mlflow server --backend-store-uri {hide_password(uri)}"


class Mirror:
    """The process that brings a run, or a sweep with its runs, into MLflow while it goes on.

    Starting costs milliseconds.
    """

    def __init__(
        self,
        source: RunDirectory | SweepDirectory,
        uri: str | None,
        experiment: str,
        process: subprocess.Popen | None,
        log_start: int = 0,
    ) -> None:
        self._path, self._uri, self._experiment = source.path, uri, experiment
        self._process, self._log_start = process, log_start

    @classmethod
    def start(
        cls, source: RunDirectory | SweepDirectory, tracking_uri: str | None, experiment: str
    ) -> Mirror:
        """Start the mirror of the run or the sweep of this process; `tracking_uri` None means none.

        A sweep must have begun (`SweepDirectory.begin`). The mirror ends after this process has
        given `source` a final status, or is gone; and, of a sweep, no run of it trains any more.
        A mirror that cannot be started is logged and never an error: `finish` then says False.

        Raises:
            ValueError: the URI is of no usable kind.
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
            f"bring it there   {self.sync_command}"
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
