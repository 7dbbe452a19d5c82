"""tlr-sync: bring runs and sweeps into MLflow, afterwards or (--follow) while they train."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from tlr_exp.machine import variables
from tlr_exp.machine.terminal import show_any_text
from tlr_exp.mlflow_sync.following import WatchedProcess, follow, has_ended
from tlr_exp.mlflow_sync.mirror import MAX_FILE_MB, STORE
from tlr_exp.mlflow_sync.sources import DEFAULT_EXPERIMENT, Source, find_sources, megabytes
from tlr_exp.records.credentials import hide_password
from tlr_exp.records.run_directory import RUNNING, RunDirectory, RunDirectoryError
from tlr_exp.records.sweep_directory import SweepDirectoryError, find_sweeps

if TYPE_CHECKING:
    from tlr_exp.mlflow_sync.run import SyncReport
    from tlr_exp.mlflow_sync.sweep import SweepReport

NICENESS = 10
DONE, LATER, REFUSED = "done", "later", "refused"  # how bringing one over ends


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: all is in MLflow; 1: some is not, try again; 2: wrong arguments."""
    show_any_text()
    options = _parser().parse_args(arguments)
    try:
        sources, problems = find_sources(
            options.folders, options.tracking_uri, options.experiment, options.max_file_mb
        )
        if options.follow is not None and len(sources) != 1:
            raise ValueError(f"--follow is for one run or one sweep, not for {len(sources)}")
    except ValueError as error:
        print(f"tlr-sync: {error}", file=sys.stderr)
        return 2
    if options.follow is not None:
        return _follow_one(sources[0], options.follow)
    ended = [_sync_one(source) for source in sources]
    done = all(each == DONE for each in ended)
    for problem in problems:
        print(f"not brought over: {problem}", file=sys.stderr)
    if not done:
        when = "Once that is mended" if REFUSED in ended else "Try again later"
        print(
            f"The metrics that are missing wait in the run directories. {when}: the same command "
            "brings over only what is missing.",
            file=sys.stderr,
        )
    return 0 if done and not problems else 1


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-sync",
        description="Bring runs and sweeps into MLflow. Doing it again adds nothing twice.",
    )
    parser.add_argument(
        "folders",
        nargs="+",
        metavar="FOLDER",
        help="a run directory, a sweep directory, or a folder that holds some",
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
        "--max-file-mb",
        type=megabytes,
        default=None,
        metavar="MB",
        help="leave larger checkpoints, videos and evaluations where they are; 0: all of them "
        f"(default: the variable {variables.MAX_FILE_MB}, else {MAX_FILE_MB:g})",
    )
    parser.add_argument(
        "--follow",
        type=int,
        metavar="PID",
        help="keep bringing over one run or sweep until it has ended or the process PID is gone",
    )
    return parser


# --- once ------------------------------------------------------------------------------------
def _sync_one(source: Source) -> str:
    """Bring one run or sweep over and print what was; DONE, LATER or REFUSED."""
    from tlr_exp.mlflow_sync.run import sync_run
    from tlr_exp.mlflow_sync.store import TrackingError, TrackingUnavailable
    from tlr_exp.mlflow_sync.sweep import sync_sweep

    folder, where = source.folder, hide_password(source.uri)
    target = (source.uri, source.experiment, source.max_file_mb)
    try:
        if isinstance(folder, RunDirectory):
            _say_run(sync_run(folder, *target), where)
            return DONE
        report = sync_sweep(folder, *target)
    except (TrackingError, ValueError) as error:
        print(f"{folder.path.name}: {error}", file=sys.stderr)
        return LATER if isinstance(error, TrackingUnavailable) else REFUSED
    _say_sweep(report, where)
    return LATER if report.problems else DONE


def _say_run(report: SyncReport, where: str, indent: str = "") -> None:
    what = f"{report.iterations} iterations ({report.points} points), {report.files} files"
    new = "new run, " if report.created else ""
    print(f"{indent}{report.name}: {new}{what}, {report.status} -> {where}")
    for note in report.notes:
        print(f"{indent}  note: {note}")


def _say_sweep(report: SweepReport, where: str) -> None:
    new = "new sweep, " if report.created else ""
    what = f"{new}{len(report.runs)} runs, {report.files} files"
    print(f"{report.name}: {what}, {report.status} -> {where}")
    for run in report.runs:
        _say_run(run, where, indent="  ")
    for problem in report.problems:
        print(problem, file=sys.stderr)


# --- following what trains -------------------------------------------------------------------
def _follow_one(source: Source, pid: int) -> int:
    """The live mirror of one run or sweep (see tlr_exp.mlflow_sync.mirror)."""
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    process = WatchedProcess(pid)  # before the slow import: a later one is another's
    live = _LiveUpload(source)
    try:
        done = follow(lambda: has_ended(source.folder, process), live.push)
    except (RunDirectoryError, SweepDirectoryError) as error:
        _note(f"stopped: {error}")
        return 1
    return 0 if done and not live.problems else 1


class _LiveUpload:
    """Pushes again and again, and notes what is new about it in the log."""

    def __init__(self, source: Source) -> None:
        from tlr_exp.mlflow_sync.run import RunUpload
        from tlr_exp.mlflow_sync.sweep import SweepUpload

        self._source = source
        self._last_message = ""
        self._mended = isinstance(source.folder, RunDirectory)
        self.problems: tuple[str, ...] = ()
        if isinstance(source.folder, RunDirectory):
            self._upload = RunUpload(
                source.folder, source.uri, source.experiment, max_file_mb=source.max_file_mb
            )
        else:
            self._upload = SweepUpload(
                source.folder, source.uri, source.experiment, source.max_file_mb
            )

    def push(self) -> bool:
        """Whether the store took all that it can take now."""
        from tlr_exp.mlflow_sync.store import TrackingError

        try:
            report = self._upload.push()
            if not self._mended:
                self._mend_others()
        except (TrackingError, ValueError) as error:
            message, worked = str(error), False
        else:
            self.problems = getattr(report, "problems", ())
            parts = [f"mirrored to {hide_password(self._source.uri)}, {report.status}"]
            message, worked = "; ".join([*parts, *self.problems]), True
        if message != self._last_message:  # a server that is away for a day is one line
            _note(message)
            self._last_message = message
        return worked

    def _mend_others(self) -> None:
        """Bring over what became of other sweeps of the study that were killed with their mirror.

        Otherwise MLflow would say that they run until someone calls tlr-sync.
        """
        from tlr_exp.mlflow_sync.sweep import SweepUpload

        source = self._source
        for sweep in find_sweeps(source.folder.path.parent):
            with suppress(ValueError):  # damaged, and not what this mirror is for
                if sweep.path == source.folder.path or sweep.is_live():
                    continue
                upload = SweepUpload(sweep, source.uri, source.experiment, source.max_file_mb)
                if sweep.record["status"] == RUNNING and upload.is_known():
                    upload.push()
        self._mended = True


def _note(message: str) -> None:
    """A line for sync.log. Unbuffered, so that on a full disk it is lost and nothing else fails."""
    with suppress(OSError):
        os.write(1, f"{time.strftime('%F %T')} {message}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
