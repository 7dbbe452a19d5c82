"""tlr-sync: bring runs and sweeps into MLflow, afterwards or (--follow) while they train."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tlr_exp.errors import UserError
from tlr_exp.machine import variables
from tlr_exp.machine.terminal import EXIT_WRONG, add_version, command
from tlr_exp.mlflow_sync.following import WatchedProcess, follow, has_ended
from tlr_exp.mlflow_sync.sources import (
    DEFAULT_EXPERIMENT,
    MAX_FILE_MB,
    Source,
    find_sources,
    megabytes,
)
from tlr_exp.mlflow_sync.tracking_uri import STORE
from tlr_exp.records.credentials import hide_password
from tlr_exp.records.directory import RecordError
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

if TYPE_CHECKING:
    from tlr_exp.mlflow_sync.upload import Upload

NICENESS = 10
DONE, LATER, REFUSED = "done", "later", "refused"  # how bringing one over ends


@command("tlr-sync", status=EXIT_WRONG)
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: all is in MLflow; 1: some is not, try again; 2: wrong arguments."""
    options = _parser().parse_args(arguments)
    sources, problems = find_sources(
        options.folders, options.tracking_uri, options.experiment, options.max_file_mb
    )
    if options.follow is not None and len(sources) != 1:
        raise UserError(f"--follow is for one run or one sweep, not for {len(sources)}")
    if options.follow is not None:
        return _follow_one(sources[0], options.follow)
    ended = [_sync_one(source) for source in sources]
    done = all(each == DONE for each in ended)
    for problem in problems:
        print(f"not copied: {problem}", file=sys.stderr)
    if not done:
        when = "Once that is fixed" if REFUSED in ended else "Later"
        print(
            f"The missing metrics are still in the run directories. {when}, repeat the command: it "
            "copies only what is missing.",
            file=sys.stderr,
        )
    return 0 if done and not problems else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-sync",
        description="Copy runs and sweeps to MLflow. Repeating it adds nothing twice.",
    )
    add_version(parser)
    parser.add_argument(
        "folders",
        nargs="+",
        metavar="FOLDER",
        help="a run directory, a sweep directory, or a folder that contains some",
    )
    parser.add_argument(
        "--tracking-uri",
        metavar="URI",
        help="http://HOST:PORT or sqlite:///FILE (default: the variable MLFLOW_TRACKING_URI, "
        f"else the {STORE} beside the run or one folder above, created if necessary)",
    )
    parser.add_argument(
        "--experiment",
        metavar="NAME",
        help="the MLflow experiment for runs that the store does not have yet (default: the "
        f"run's own tag, else {DEFAULT_EXPERIMENT})",
    )
    parser.add_argument(
        "--max-file-mb",
        type=megabytes,
        default=None,
        metavar="MB",
        help="do not copy larger checkpoints, videos and evaluations; 0: copy none of them "
        f"(default: the variable {variables.MAX_FILE_MB}, else {MAX_FILE_MB:g})",
    )
    parser.add_argument(
        "--follow",
        type=int,
        metavar="PID",
        help="keep copying one run or sweep until it has ended or the process PID is gone",
    )
    return parser


def _upload_of(source: Source) -> Upload:
    from tlr_exp.mlflow_sync.upload_run import RunUpload
    from tlr_exp.mlflow_sync.upload_sweep import SweepUpload

    kind: Any = {RunDirectory: RunUpload, SweepDirectory: SweepUpload}[type(source.folder)]
    return kind(source.folder, source.uri, source.experiment, source.max_file_mb)


# --- once ------------------------------------------------------------------------------------
def _sync_one(source: Source) -> str:
    """Bring one run or sweep over and print what was; DONE, LATER or REFUSED."""
    from tlr_exp.mlflow_sync.store import TrackingUnavailable

    try:
        report = _upload_of(source).push()
    except ValueError as error:
        print(f"{source.folder.path.name}: {error}", file=sys.stderr)
        return LATER if isinstance(error, TrackingUnavailable) else REFUSED
    print("\n".join(report.lines(hide_password(source.uri))))
    for problem in report.problems:
        print(problem, file=sys.stderr)
    return LATER if report.problems else DONE


# --- following what trains -------------------------------------------------------------------
def _follow_one(source: Source, pid: int) -> int:
    """The live mirror of one run or sweep (see tlr_exp.mlflow_sync.mirror)."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    process = WatchedProcess(pid)  # before the slow import: a later one is another's
    live = _LiveUpload(source)
    try:
        done = follow(lambda: has_ended(source.folder, process), live.push)
    except RecordError as error:
        _note(f"stopped: {error}")
        return 1
    return 0 if done and not live.problems else 1


class _LiveUpload:
    """Pushes again and again, and notes what is new about it in the log."""

    def __init__(self, source: Source) -> None:
        self._upload, self._where = _upload_of(source), hide_password(source.uri)
        self._last_message = ""
        self._has_mended = False
        self.problems: tuple[str, ...] = ()

    def push(self) -> bool:
        """Whether the store took all that it can take now."""
        try:
            report = self._upload.push()
            if not self._has_mended:
                self._upload.mend_others()
                self._has_mended = True
        except ValueError as error:
            message, worked = str(error), False
        else:
            self.problems = report.problems
            parts = [f"mirrored to {self._where}, {report.status}"]
            message, worked = "; ".join([*parts, *self.problems]), True
        if message != self._last_message:  # a server that is away for a day is one line
            _note(message)
            self._last_message = message
        return worked


def _note(message: str) -> None:
    """A line for sync.log. Unbuffered, so that on a full disk it is lost and nothing else fails."""
    with suppress(OSError):
        os.write(1, f"{time.strftime('%F %T')} {message}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
