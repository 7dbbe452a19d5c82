"""The process of a job seen from the launcher: its environment, and how it can die."""

import os
import pickle
import sys
import threading
import time
from pathlib import Path

import pytest

from tlr_exp.sweeps.spec import JobSpec, log_path, write_spec
from tlr_exp.sweeps.stopping import KILL, request_stop
from tlr_exp.sweeps.task import JOB_VARIABLE, JobTask, job_environment, one_line


@pytest.fixture
def task(sweep, plan, monkeypatch):
    write_spec(sweep.path, 1, plan.jobs[1].spec)
    sweep.write_job(1, "waiting", overrides=["seed=1"])
    monkeypatch.setenv(JOB_VARIABLE, "1")
    return JobTask(str(sweep.path), os.getpid())


@pytest.fixture
def instead(tmp_path, monkeypatch):
    """``instead(script)``: what is started in place of Python."""

    def put(script: str) -> None:
        path = tmp_path / "python"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(path))

    return put


def test_threads_are_set_and_nothing_of_the_launcher_is_passed_on():
    given = {"OMP_NUM_THREADS": "7", "PATH": "/bin", JOB_VARIABLE: "3", "GOMP_SPINCOUNT": "9"}
    two = job_environment(given, 2)
    assert two["OMP_NUM_THREADS"] == two["MKL_NUM_THREADS"] == two["OPENBLAS_NUM_THREADS"] == "2"
    assert (two["PATH"], two["GOMP_SPINCOUNT"]) == ("/bin", "9")
    assert JOB_VARIABLE not in two
    assert job_environment({"OMP_NUM_THREADS": "7"}, 0) == {"GOMP_SPINCOUNT": "5000"}


def test_the_job_is_a_fresh_process_with_a_log_and_a_group_of_its_own(task, sweep, instead):
    instead('echo "$@"; echo $OMP_NUM_THREADS; ps -o pgid= -p $$; pwd; exit 75')
    task(None)
    arguments, threads, group, folder = log_path(sweep.path, 1).read_text().splitlines()
    expected = f"-m tlr_exp.sweeps.job {sweep.path} 1 --patience 1.0 "
    expected += f"--with-pid {os.getpid()}"
    assert (arguments, threads, folder) == (expected, "1", os.getcwd())
    assert int(group) != os.getpgrp()
    assert sweep.job(1).status == "waiting"  # 75: another process trains it


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("kill -9 $$", "killed by SIGKILL (by the system where memory ran out"),
        ("kill -11 $$", "killed by SIGSEGV"),
        ("exit 3", "ended with status 3 without saying why"),
    ],
)
def test_a_job_that_dies_without_a_word_has_failed(task, sweep, instead, script, words):
    instead(script)
    task(None)
    assert sweep.job(1).status == "failed"
    assert words in sweep.job(1).error


def test_what_the_job_wrote_itself_stays(task, sweep, instead):
    # As the job does, which writes its record and then ends.
    record = sweep.job_path(1).read_text().replace('"waiting"', '"finished"')
    instead(f"cat > {sweep.job_path(1)} <<'END'\n{record}\nEND")
    task(None)
    assert sweep.job(1).status == "finished"


def test_a_killed_sweep_kills_the_job_that_does_not_listen(task, sweep, instead):
    instead("trap '' INT TERM; sleep 60")
    threading.Timer(0.3, request_stop, (sweep.path, KILL)).start()
    start = time.monotonic()
    task(None)
    assert time.monotonic() - start < 30
    assert sweep.job(1).status == "interrupted"


def test_nothing_starts_once_the_sweep_is_to_stop(task, sweep, instead):
    request_stop(sweep.path, KILL)
    instead("exit 3")
    task(None)
    assert sweep.job(1).status == "waiting"


def test_nothing_is_raised_to_the_launcher(task, sweep, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    task(None)
    assert sweep.job(1).status == "failed"
    assert "FileNotFoundError" in sweep.job(1).error
    (sweep.path / "jobs" / "1.yaml").unlink()
    task(None)
    assert "cannot read the specification of a job" in sweep.job(1).error


def test_workers_get_it_pickled(task):
    assert vars(pickle.loads(pickle.dumps(task))) == vars(task)


def test_errors_become_one_line():
    assert one_line(ValueError("first\nlast\n")) == "ValueError: last"
    assert one_line(KeyboardInterrupt()) == "KeyboardInterrupt"


def test_a_specification_is_read_as_it_was_written(tmp_path):
    (tmp_path / "jobs").mkdir()
    config = {"a": {"b": [1, 2.5, None, "ü"]}, "rate": 1e-5, "path": str(Path("/x y"))}
    spec = JobSpec(config=config, method="gwo", threads=0, go_on=False)
    write_spec(tmp_path, 3, spec)
    from tlr_exp.sweeps.spec import read_spec

    assert read_spec(tmp_path, 3) == spec
