"""tlr-sync: bring run directories into MLflow, afterwards or (--follow) while they train."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tlr_exp.records.mirror import (
    STORE,
    URI_VARIABLE,
    check_tracking_uri,
    default_tracking_uri,
    hide_password,
)
from tlr_exp.records.run_directory import RUNNING, RunDirectory, RunDirectoryError
from tlr_exp.records.runs import find_runs

if TYPE_CHECKING:
    from tlr_exp.records.tracking import SyncReport

DEFAULT_EXPERIMENT = "tlr_exp"
NICENESS = 10

TICK_S = 0.25  # how often the followed run is looked at
POLL_S = 2.0  # how often its new lines are brought over
MAX_WAIT_S = 60.0  # longest pause between tries while the store is away
LAST_WAIT_S = 5.0  # the same once the run is over
GIVE_UP_S = 60.0  # how long after the run's end the store may stay away
GIVE_UP_AT_ONCE_S = 3.0  # the same where it was away all along


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: all is in MLflow; 1: some is not, try again; 2: wrong arguments."""
    options = _parser().parse_args(arguments)
    try:
        found = _runs(options.runs)
        runs = list(found)
        if options.follow is not None and len(runs) != 1:
            raise ValueError(f"--follow is for one run, not for {len(runs)}")
        stores = [_store_of(run, found[run], options.tracking_uri) for run in runs]
    except ValueError as error:
        print(f"tlr-sync: {error}", file=sys.stderr)
        return 2
    if options.follow is not None:
        return _follow_one(runs[0], stores[0], options)
    done = [_sync_one(run, uri, options.experiment) for run, uri in zip(runs, stores, strict=True)]
    if all(done):
        return 0
    print(
        "The metrics that are missing wait in the run directories. Try again later with the same "
        "command: it brings over only what is missing.",
        file=sys.stderr,
    )
    return 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-sync",
        description="Bring run directories into MLflow. Doing it again adds nothing twice.",
    )
    parser.add_argument(
        "runs", nargs="+", metavar="RUN", help="a run directory, or a folder that holds some"
    )
    parser.add_argument(
        "--tracking-uri",
        metavar="URI",
        help="http://HOST:PORT or sqlite:///FILE; by default the variable MLFLOW_TRACKING_URI, "
        f"else the {STORE} beside the run or one folder above, made if need be",
    )
    parser.add_argument(
        "--experiment",
        metavar="NAME",
        help="the MLflow experiment for runs that the store does not have yet (default: the "
        f"run's own tag, else {DEFAULT_EXPERIMENT})",
    )
    parser.add_argument(
        "--follow",
        type=int,
        metavar="PID",
        help="keep bringing over one run until it has ended or the process PID is gone",
    )
    return parser


def _runs(paths: Sequence[str]) -> dict[RunDirectory, Path]:
    """The runs named or contained in `paths`, each once, with the folder they were looked for in.

    Raises:
        RunDirectoryError: a path is no run and holds none.
    """
    runs: dict[Path, tuple[RunDirectory, Path]] = {}
    for path in paths:
        found = find_runs(path)
        if not found:
            RunDirectory.open(path)  # says what is wrong with it
        for run in found:
            root = Path(path).absolute()
            runs.setdefault(run.path, (RunDirectory.open(run.path), root))
    return {run: run.path.parent if run.path == root else root for run, root in runs.values()}


def _store_of(run: RunDirectory, root: Path, given: str | None) -> str:
    """The store for `run`: the one given, the environment's, one beside or above it, or a new one.

    Raises:
        ValueError: a URI of no usable kind.
    """
    if given is not None:
        return check_tracking_uri(given)
    if not os.environ.get(URI_VARIABLE):
        # RUNS/STUDY/RUN. No higher: a mlflow.db in a project's folder is somebody else's.
        for folder in list(run.path.parents)[:2]:
            if (folder / STORE).is_file():
                return default_tracking_uri(folder)
    # Where training itself would have put it: RUNS, of RUNS/STUDY/RUN.
    study = run.manifest.get("tags", {}).get("experiment")
    return default_tracking_uri(run.path.parents[1] if run.path.parent.name == study else root)


def _experiment_of(run: RunDirectory, given: str | None) -> str:
    return given or run.manifest.get("tags", {}).get("experiment") or DEFAULT_EXPERIMENT


def _sync_one(run: RunDirectory, uri: str, experiment: str | None) -> bool:
    """Bring one run over and print a line on it; whether it worked."""
    from tlr_exp.records.mlflow_store import TrackingError
    from tlr_exp.records.tracking import sync_run

    try:
        report = sync_run(run, uri, _experiment_of(run, experiment))
    except (TrackingError, ValueError) as error:
        print(f"{run.path.name}: {error}", file=sys.stderr)
        return False
    print(f"{_line(report)} -> {hide_password(uri)}")
    for note in report.notes:
        print(f"  note: {note}")
    return True


def _line(report: SyncReport) -> str:
    what = f"{report.iterations} iterations ({report.points} points), {report.files} files"
    return f"{report.name}: {'new run, ' if report.created else ''}{what}, {report.status}"


# --- following a run that trains -------------------------------------------------------------
def _follow_one(run: RunDirectory, uri: str, options: argparse.Namespace) -> int:
    """The live mirror of one run (see tlr_exp.records.mirror)."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    process = WatchedProcess(options.follow)  # before the slow import: a later one is another's
    from tlr_exp.records.mlflow_store import TrackingError
    from tlr_exp.records.tracking import RunUpload

    upload = RunUpload(run, uri, _experiment_of(run, options.experiment))
    last_message = ""

    def push() -> bool:
        nonlocal last_message
        try:
            report = upload.push()
        except (TrackingError, ValueError) as error:
            message, worked = str(error), False
        else:
            message, worked = f"mirrored to {hide_password(uri)}, {report.status}", True
        if message != last_message:  # a server that is away for a day is one line, not thousands
            _note(message)
            last_message = message
        return worked

    try:
        return 0 if follow(lambda: has_ended(run, process), push) else 1
    except RunDirectoryError as error:
        _note(f"stopped: {error}")
        return 1


def _note(message: str) -> None:
    """A line for sync.log. Unbuffered, so that on a full disk it is lost and nothing else fails."""
    with suppress(OSError):
        os.write(1, f"{time.strftime('%F %T')} {message}\n".encode())


def follow(is_over: Callable[[], bool], push: Callable[[], bool]) -> bool:
    """Call `push` every POLL_S, more seldom while it fails, until one worked after the run's end.

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


def has_ended(run: RunDirectory, process: WatchedProcess) -> bool:
    """Whether `process` is gone, or has itself given the run a final status.

    A final status of an earlier process says nothing: this one is about to resume the run.

    Raises:
        RunDirectoryError: the run directory is gone.
    """
    if not process.alive():
        return True
    manifest = run.manifest
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


if __name__ == "__main__":
    sys.exit(main())
