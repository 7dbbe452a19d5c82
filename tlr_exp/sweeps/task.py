"""The task that a launcher runs for each job: it starts a fresh process and waits for it.

Launchers run many jobs in one process (Hydra's own) or in workers that they use again (joblib).
Nothing of a job may be left for the next one, so no job trains in them.
"""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from tlr_exp.machine.cores import OPENMP_DEFAULTS
from tlr_exp.mlflow_sync.following import WatchedProcess
from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.storage import StorageError
from tlr_exp.records.sweep_directory import WAITING, SweepDirectory
from tlr_exp.sweeps.parallel import THREAD_VARIABLES
from tlr_exp.sweeps.spec import log_path, read_spec, with_threads
from tlr_exp.sweeps.stopping import KILL, POLL_S, stop_requested

JOB_VARIABLE = "TLR_EXP_JOB"  # the number of the job, by hydra.job.env_set
PATIENCE_S = 1.0
# A job that a cluster starts again can start before the end of the process that was there before.
CLUSTER_PATIENCE_S = 120.0
ELSEWHERE = 75  # exit status of a job whose run another process trains (EX_TEMPFAIL)


class JobTask:
    """The task function of a sweep: callable with Hydra's configuration, which it does not need.

    It never raises, because launchers disagree on what follows: how a job ended stands in its
    record.

    Args:
        sweep: the sweep directory, absolute.
        sweep_pid: the process with which the jobs end; None where they outlive it.
        patience_s: how long a job waits for a process that still holds its run, such as that of an
            earlier start whose node was lost.
    """

    def __init__(self, sweep: str, sweep_pid: int | None, patience_s: float = PATIENCE_S) -> None:
        self.sweep, self.sweep_pid = sweep, sweep_pid
        self.patience_s = patience_s if sweep_pid is not None else CLUSTER_PATIENCE_S
        self.host, self.folder = socket.gethostname(), os.getcwd()
        self.main_process = os.getpid()

    def __call__(self, config: Any) -> None:
        num = int(os.environ[JOB_VARIABLE])
        if os.getpid() != self.main_process:
            _leave_ctrl_c_to_the_sweep()
            if self._is_with_the_sweep():
                _end_with(self.sweep_pid)
        try:
            if stop_requested(Path(self.sweep)) is None:
                self._run(num)
        except Exception as error:
            with suppress(StorageError):
                conclude(SweepDirectory(self.sweep), num, FAILED, one_line(error))

    def _run(self, num: int) -> None:
        sweep = SweepDirectory(self.sweep)
        more = ["--patience", str(self.patience_s)]
        more += ["--with-pid", str(self.sweep_pid)] if self._is_with_the_sweep() else []
        process = start_job(sweep, num, self.folder, more)
        close_record(sweep, num, _wait(process, sweep.path))

    def _is_with_the_sweep(self) -> bool:
        """True if this process can see that of the sweep, and is to end with it."""
        return self.sweep_pid is not None and socket.gethostname() == self.host


def start_job(
    sweep: SweepDirectory, num: int, folder: str, more: Sequence[str], threads: int = 0
) -> subprocess.Popen[bytes]:
    """The process of job ``num``, started in ``folder`` with ``more`` arguments.

    Where its specification leaves the number of ``threads`` open, it is that.

    Raises:
        ValueError: the specification of the job is missing or damaged.
        OSError: it cannot be started.
    """
    spec = with_threads(read_spec(sweep.path, num), threads)
    command = [sys.executable, "-m", "tlr_exp.sweeps.job", str(sweep.path), str(num), *more]
    command += ["--threads", str(threads)] if threads else []
    with open(log_path(sweep.path, num), "ab") as log:
        return subprocess.Popen(
            command,
            cwd=folder,
            env=job_environment(os.environ, spec.threads),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,  # Ctrl-C in the terminal is for the sweep alone
        )


def job_environment(environment: Mapping[str, str], threads: int) -> dict[str, str]:
    """The environment of a job on ``threads`` threads; 0 leaves the number to the libraries."""
    kept = {name: value for name, value in environment.items() if name not in THREAD_VARIABLES}
    kept.pop(JOB_VARIABLE, None)
    limits = {name: str(threads) for name in THREAD_VARIABLES} if threads else {}
    return {**OPENMP_DEFAULTS, **kept, **limits}


def _leave_ctrl_c_to_the_sweep() -> None:
    """A worker that dies of the terminal's Ctrl-C could not see its job through to the end."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@cache
def _end_with(pid: int) -> None:
    """Let this worker end when the sweep is killed: joblib's wait five minutes for more work.

    Its job notices by itself, and ends after its iteration.
    """
    sweep = WatchedProcess(pid)

    def watch() -> None:
        while sweep.alive():
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True, name="end-with-sweep").start()


def _wait(process: subprocess.Popen[bytes], sweep: Path) -> int:
    while True:
        try:
            return process.wait(POLL_S)
        except subprocess.TimeoutExpired:
            if stop_requested(sweep) == KILL:
                process.kill()


def close_record(sweep: SweepDirectory, num: int, returned: int) -> None:
    """Write how the job ended where it could not do so itself."""
    if sweep.job(num).status not in (WAITING, RUNNING) or returned == ELSEWHERE:
        return
    if stop_requested(sweep.path):
        conclude(sweep, num, INTERRUPTED, "stopped before it could save a checkpoint")
        return
    conclude(sweep, num, FAILED, _how_it_died(returned))


def conclude(sweep: SweepDirectory, num: int, status: str, error: str | None = None) -> None:
    """Write how job ``num`` ended, from a process that holds no run (any more).

    While another process trains its run, the record is that one's. And a job whose run is trained
    is trained, whatever ended its process after that.
    """
    record = sweep.job(num)
    run = None if record.run is None else RunDirectory(sweep.study_folder / record.run)
    if run is not None and record.status in (RUNNING, FINISHED):
        if run.is_live():
            return
        with suppress(RunDirectoryError):  # somebody moved it away
            if run.status == FINISHED:
                status, error = FINISHED, None
    sweep.write_job(num, status, error=error)


def _how_it_died(returned: int) -> str:
    if returned == -signal.SIGKILL:
        return "killed by SIGKILL (by the system where memory ran out, or by a person)"
    if returned < 0:
        return f"killed by {signal.Signals(-returned).name}"
    return f"ended with status {returned} without saying why"


def one_line(error: BaseException) -> str:
    """The error for a record: its kind and the last line of its message."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__
