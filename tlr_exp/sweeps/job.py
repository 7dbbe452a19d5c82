"""The process of one job: ``python -m tlr_exp.sweeps.job SWEEP NUM [--with-pid PID]``.

It finds or makes the run of its configuration, trains it, and writes how it ended into its record.
"""

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from tlr_exp.config.load import load_settings
from tlr_exp.machine.terminal import (
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    print_error,
    refuse_without_docstrings,
    show_any_text,
)
from tlr_exp.mlflow_sync.following import WatchedProcess
from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.run_directory import RunDirectory, RunInUseError
from tlr_exp.records.storage import StorageError
from tlr_exp.records.sweep_directory import SweepDirectory
from tlr_exp.sweeps.spec import RUN_LOG, read_spec, with_threads
from tlr_exp.sweeps.stopping import Watch
from tlr_exp.sweeps.task import CLUSTER_PATIENCE_S, ELSEWHERE, conclude, one_line
from tlr_exp.training.run import check_inputs, open_run, train_in


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: trained; 1: failed; 130: interrupted; 75: another process trains it."""
    show_any_text()
    refuse_without_docstrings("a job of a sweep")
    options = _parser().parse_args(arguments)
    # A new process inherits what its parent ignores, and what the thread that started it blocks:
    # a worker of a sweep ignores SIGINT, and Ray's block it. What SLURM's node blocks stays so: it
    # passes SIGTERM on itself (see slurm/node.py).
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # The warning of a cluster before the end of the time; whoever started this passes it on.
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)
    sweep_process = None if options.with_pid is None else WatchedProcess(options.with_pid)
    watch = Watch(options.sweep, lambda: sweep_process is None or sweep_process.alive())
    watch.start()
    sweep = SweepDirectory(options.sweep)
    try:
        status = train_job(sweep, options.num, options.patience, options.threads, options.run)
    except RunInUseError as error:
        print(error)
        return ELSEWHERE
    except KeyboardInterrupt:
        conclude(sweep, options.num, INTERRUPTED)
        return EXIT_INTERRUPTED
    except Exception as error:
        print_error(error)
        with suppress(StorageError):
            conclude(sweep, options.num, FAILED, one_line(error))
        return EXIT_FAILED
    finally:
        watch.finish()
    conclude(sweep, options.num, status)
    return 0 if status == FINISHED else EXIT_INTERRUPTED


def train_job(
    sweep: SweepDirectory, num: int, patience_s: float, threads: int = 0, again: str | None = None
) -> str:
    """Train the run of job ``num``, or find that it is trained; how it ended.

    A process that holds the run is waited for ``patience_s`` seconds; until it lets go, the record
    of the job may be its own and is left alone. Where the specification leaves the number of
    ``threads`` open, it is that. ``again`` names the run that this start of the job goes on with
    although the sweep makes new ones.

    Raises:
        RunInUseError: another process trains it.
        Exception: whatever went wrong in the training.
    """
    spec = with_threads(read_spec(sweep.path, num), threads)
    _name_the_command(sweep.job(num).overrides)
    settings = load_settings(spec.config)
    parts = check_inputs(settings)
    if again is not None and not spec.go_on:
        run = RunDirectory.open(sweep.study_folder / again)
    else:
        run = open_run(settings, spec.config, spec.method, spec.go_on, prefer_finished=True)
    with run.lock(patience_s):
        # Looked at again: whoever held the lock a moment ago may have finished it.
        if run.status == FINISHED:
            _note(sweep, num, run, FINISHED)
            return FINISHED
        _print_into(run.path / RUN_LOG)  # first, so that a running job has its log there
        _note(sweep, num, run, RUNNING)
        try:
            # Into MLflow it comes with the whole sweep, by one process.
            return train_in(run, settings, parts, None).status
        except KeyboardInterrupt:
            # It can come when all is done and written.
            return run.status


def _name_the_command(overrides: Sequence[str]) -> None:
    """Let the manifest keep the command that repeats this run alone, not that of this process."""
    sys.argv[:] = ["tlr-train", *(each for each in overrides if not each.startswith("+sweep="))]


def _note(sweep: SweepDirectory, num: int, run: RunDirectory, status: str) -> None:
    sweep.write_job(num, status, run=run.path.name, run_id=run.manifest["run_id"])


def _print_into(log: Path) -> None:
    """Let all that this process prints from now on, libraries included, go to the file ``log``."""
    sys.stdout.flush()
    sys.stderr.flush()
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(descriptor, stream)
    os.close(descriptor)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m tlr_exp.sweeps.job",
        description="One job of a sweep; started by the sweep, not by people.",
    )
    parser.add_argument("sweep", type=Path, help="the sweep directory")
    parser.add_argument("num", type=int, help="the number of the job")
    parser.add_argument(
        "--with-pid", type=int, metavar="PID", help="end, with a checkpoint, when PID does"
    )
    parser.add_argument(
        "--patience", type=float, default=CLUSTER_PATIENCE_S, help="seconds to wait for its run"
    )
    parser.add_argument("--threads", type=int, default=0, help="what it may use")
    parser.add_argument("--run", metavar="NAME", help="go on with this run of the study")
    return parser


if __name__ == "__main__":
    sys.exit(main())
