"""The process of a job beside another that trains the same run: who writes the record."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tlr_exp.config.load import ConfigError
from tlr_exp.records.run_directory import LOCK
from tlr_exp.sweeps import job as jobs
from tlr_exp.sweeps.spec import write_spec
from tlr_exp.sweeps.task import ELSEWHERE, close_record, conclude

HOLD = "import filelock, sys\nwith filelock.FileLock(sys.argv[1]):\n print(1, flush=True); input()"


@pytest.fixture
def run(sweep, plan, make_run, monkeypatch):
    """The run of job 1, which is going on according to its record; the job finds it at once."""
    found = make_run(1, "running")
    write_spec(sweep.path, plan.jobs[1])
    sweep.write_job(1, "running", run=found.path.name, run_id=found.manifest["run_id"])
    monkeypatch.setattr(jobs, "load_settings", lambda config: None)
    monkeypatch.setattr(jobs, "check_inputs", lambda settings: None)
    monkeypatch.setattr(jobs, "open_run", lambda *arguments, **more: found)
    monkeypatch.setattr(jobs, "CLUSTER_PATIENCE_S", 0.1)
    monkeypatch.setattr(jobs, "_print_into", lambda log: None)
    monkeypatch.setattr(sys, "argv", ["job"])
    return found


@pytest.fixture
def start(sweep) -> Iterator:
    """``start()``: the exit status of the process of job 1, here; the signals come back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield lambda: jobs.main([str(sweep.path), "1"])
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def trained_by_another(run) -> Iterator[None]:
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", HOLD, str(run.path / LOCK)]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "1\n"
        yield
        other.communicate("\n")


def raising(error: BaseException):
    def fail(*arguments, **more):
        raise error

    return fail


@pytest.mark.usefixtures("trained_by_another")
def test_a_job_that_the_queue_holds_twice_leaves_the_record_to_the_one_that_trains(sweep, start):
    before = sweep.job_path(1).read_bytes()
    assert start() == ELSEWHERE
    assert sweep.job_path(1).read_bytes() == before


@pytest.mark.usefixtures("trained_by_another")
@pytest.mark.parametrize("error", [ConfigError("no GPU on this node"), KeyboardInterrupt()])
def test_the_other_one_ends_without_a_trace_however_it_ends(sweep, start, monkeypatch, error):
    before = sweep.job_path(1).read_bytes()
    monkeypatch.setattr(jobs, "check_inputs", raising(error))
    assert start() == (1 if isinstance(error, ConfigError) else 130)
    close_record(sweep, 1, -9)  # nor does its launcher write that it was killed
    assert sweep.job_path(1).read_bytes() == before


def test_a_run_that_nobody_trains_is_answered_for(sweep, run, start, monkeypatch, capsys):
    monkeypatch.setattr(jobs, "check_inputs", raising(ConfigError("no GPU on this node")))
    assert start() == 1
    assert (sweep.job(1).status, sweep.job(1).pid) == ("failed", os.getpid())
    assert "no GPU" in sweep.job(1).error
    assert capsys.readouterr().err == "no GPU on this node\n"


@pytest.fixture
def blocked() -> Iterator[None]:
    """SIGINT blocked in this thread, as in the threads of Ray's workers that start jobs."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    yield
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    while signal.sigtimedwait({signal.SIGINT}, 0):
        pass  # nothing that was sent and not heard reaches another test
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


@pytest.mark.usefixtures("blocked")
def test_a_job_hears_ctrl_c_although_the_thread_that_started_it_blocks_it(run, start, monkeypatch):
    def send(*arguments, **more):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(jobs, "train_in", send)
    assert start() == 130


def test_a_bug_is_told_with_its_traceback(sweep, run, start, monkeypatch, capsys):
    monkeypatch.setattr(jobs, "train_in", raising(ZeroDivisionError("by nothing")))
    assert start() == 1
    assert "in fail" in capsys.readouterr().err  # the function that raised it
    assert sweep.job(1).error == "ZeroDivisionError: by nothing"


def test_a_run_that_is_finished_meanwhile_is_named(sweep, run, start):
    sweep.write_job(1, "waiting", run="what it was before")
    run.set_status("finished")
    assert start() == 0
    record = sweep.job(1)
    expected = ("finished", run.path.name, run.manifest["run_id"])
    assert (record.status, record.run, record.run_id) == expected


@pytest.mark.parametrize("ended", ["interrupted", "failed"])
def test_a_trained_run_is_trained_whatever_ended_its_process_after_that(sweep, run, ended):
    run.set_status("finished")
    conclude(sweep, 1, ended, "ended by a signal")
    assert (sweep.job(1).status, sweep.job(1).error) == ("finished", None)
    # Of a job that waits the record can name the run of an earlier attempt.
    sweep.write_job(1, "waiting")
    conclude(sweep, 1, ended, "no node")
    assert sweep.job(1).status == ended
