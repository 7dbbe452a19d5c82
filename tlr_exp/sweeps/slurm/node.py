"""On a node: ``python -m tlr_exp.sweeps.slurm.node SWEEP --base N``, what an element runs.

It starts the process of its job, as other launchers do, and stands between that and SLURM: the
warning before the end of the time and SIGTERM (scancel, preemption, requeue) become one Ctrl-C, by
which the training writes a checkpoint. After a warning the element is queued again. Its exit status
is the job's, so that SLURM's accounts say which failed.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType

from tlr_exp.machine.terminal import EXIT_FAILED, EXIT_INTERRUPTED
from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED
from tlr_exp.records.storage import StorageError, atomic_write
from tlr_exp.records.sweep_directory import JOBS, WAITING, SweepDirectory
from tlr_exp.sweeps.parallel import LauncherError
from tlr_exp.sweeps.slurm.commands import requeue
from tlr_exp.sweeps.slurm.settings import RESERVE_S
from tlr_exp.sweeps.stopping import KILL, POLL_S, stop_requested
from tlr_exp.sweeps.task import ELSEWHERE, close_record, conclude, one_line, start_job

WARNING = signal.SIGUSR2


class Attempts:
    """The traces of earlier starts of the element: how many ran out of time, and the job's run.

    Beside the record of the job, jobs/NUM.element.
    """

    def __init__(self, sweep: SweepDirectory, num: int, element: str) -> None:
        self._sweep, self._num = sweep, num
        self._path = sweep.path / JOBS / f"{num}.element"
        before = {}
        with suppress(OSError, ValueError):
            before = json.loads(self._path.read_text())
        if before.get("element") != element:
            before = {"element": element, "timeouts": 0, "not_its_run": sweep.job(num).run}
            atomic_write(self._path, json.dumps(before).encode())
        self._content = before

    @property
    def element(self) -> str:
        return self._content["element"]

    @property
    def timeouts(self) -> int:
        return self._content["timeouts"]

    @property
    def run(self) -> str | None:
        """The run that an earlier start of the element made or went on with, if any."""
        run = self._sweep.job(self._num).run
        return None if run == self._content["not_its_run"] else run

    def note_timeout(self) -> None:
        """One more start ran out of its time.

        Raises:
            StorageError: it cannot be written.
        """
        self._content["timeouts"] += 1
        atomic_write(self._path, json.dumps(self._content).encode())


class Signals:
    """The signals of SLURM that have come: at most one is passed on to the job."""

    def __init__(self) -> None:
        self.warned_at: float | None = None
        self.terminated = False
        for number in (WARNING, signal.SIGTERM):
            signal.signal(number, self._note)
        # The training is told by this process alone, once.
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    def _note(self, number: int, _: FrameType | None) -> None:
        if number == WARNING:
            self.warned_at = self.warned_at or time.monotonic()
        else:
            self.terminated = True

    @property
    def any(self) -> bool:
        return self.terminated or self.warned_at is not None


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: trained, or left to others; 1: failed; 130: ended before it was trained."""
    signals = Signals()
    options = _parser().parse_args(arguments)
    sweep = SweepDirectory(options.sweep)
    num = options.base + int(os.environ["SLURM_ARRAY_TASK_ID"])
    if stop_requested(sweep.path) is not None:
        print("the sweep was stopped while this waited in the queue: nothing is started")
        return 0
    try:
        return _work(sweep, num, options, signals)
    except Exception as error:
        print(one_line(error), file=sys.stderr)
        with suppress(StorageError):
            conclude(sweep, num, FAILED, one_line(error))
        return EXIT_FAILED


def _work(sweep: SweepDirectory, num: int, options: argparse.Namespace, signals: Signals) -> int:
    element = f"{os.environ['SLURM_ARRAY_JOB_ID']}_{os.environ['SLURM_ARRAY_TASK_ID']}"
    attempts = Attempts(sweep, num, element)
    threads = int(os.environ.get("SLURM_CPUS_PER_TASK", "0"))
    again = ["--run", attempts.run] if attempts.run else []
    print(f"job {num} as {element} on {os.uname().nodename}", flush=True)
    # What the process of the job inherits: SLURM can signal it, too, and it is not to hear that.
    hidden = {WARNING, signal.SIGTERM}
    signal.pthread_sigmask(signal.SIG_BLOCK, hidden)
    process = start_job(sweep, num, os.getcwd(), again, threads)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, hidden)
    returned = _wait(process, sweep.path, signals, options.delay - RESERVE_S)
    if returned in (0, ELSEWHERE) or sweep.job(num).status == FINISHED:
        return 0
    if signals.warned_at is not None and not signals.terminated and not stop_requested(sweep.path):
        return _go_on_later(sweep, num, attempts, options, process)
    if signals.any and returned in (EXIT_INTERRUPTED, -signal.SIGINT):
        conclude(
            sweep, num, INTERRUPTED, "ended by SLURM (SIGTERM)" if signals.terminated else None
        )
        return _exit_status(sweep, num)
    close_record(sweep, num, process.wait())
    return _exit_status(sweep, num)


def _exit_status(sweep: SweepDirectory, num: int) -> int:
    """The exit status that tells SLURM's accounts what the job's record says."""
    return {FINISHED: 0, INTERRUPTED: EXIT_INTERRUPTED}.get(sweep.job(num).status, EXIT_FAILED)


def _wait(
    process: subprocess.Popen[bytes], sweep: Path, signals: Signals, patience_s: float
) -> int | None:
    """The exit status of the job; None where it goes on although its time is nearly over."""
    told = False
    while True:
        with suppress(subprocess.TimeoutExpired):
            return process.wait(POLL_S)
        if stop_requested(sweep) == KILL:
            process.kill()
        # A stopped sweep tells its jobs itself, and a second interrupt would cost the checkpoint.
        elif signals.any and not told and stop_requested(sweep) is None:
            told = True
            process.send_signal(signal.SIGINT)
        warned = signals.warned_at
        if warned is not None and time.monotonic() - warned > max(0.0, patience_s):
            return None


def _go_on_later(
    sweep: SweepDirectory,
    num: int,
    attempts: Attempts,
    options: argparse.Namespace,
    process: subprocess.Popen[bytes],
) -> int:
    """Queue the element again, unless that was done often enough."""
    if process.poll() not in (None, EXIT_INTERRUPTED, -signal.SIGINT):
        close_record(sweep, num, process.wait())  # it failed by itself meanwhile
        return EXIT_FAILED
    attempts.note_timeout()
    if attempts.timeouts > options.timeouts:
        words = (
            f"ran out of its time ({options.limit} min) {attempts.timeouts} times; repeat the "
            "command to continue, or allow more with hydra.launcher.timeout_min"
        )
        _end(process)
        conclude(sweep, num, INTERRUPTED, words)
        return EXIT_INTERRUPTED
    print(f"out of time: queued again ({attempts.timeouts} of {options.timeouts})", flush=True)
    if process.poll() is not None:
        sweep.write_job(num, WAITING)
    try:
        requeue(attempts.element)
    except LauncherError as error:
        _end(process)
        conclude(sweep, num, FAILED, f"out of time and not queued again: {one_line(error)}")
        return EXIT_FAILED
    process.wait()  # SLURM ends both; a job without this process would escape it
    return EXIT_INTERRUPTED


def _end(process: subprocess.Popen[bytes]) -> None:
    """What has not ended by now loses its iteration either way."""
    process.kill()
    process.wait()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tlr_exp.sweeps.slurm.node",
        description="One job of a sweep as an element of a SLURM array; started by SLURM.",
    )
    parser.add_argument("sweep", type=Path, help="the sweep directory")
    parser.add_argument("--base", type=int, default=0, help="the job of index 0")
    parser.add_argument("--timeouts", type=int, default=0, help="how often it is queued again")
    parser.add_argument("--delay", type=float, default=0.0, help="seconds from warning to end")
    parser.add_argument("--limit", type=int, default=0, help="minutes that it has")
    return parser


if __name__ == "__main__":
    sys.exit(main())
