"""Ending a sweep: signals, the file that jobs look for, jobs that nobody waits for."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from tests.patience import HANG_S
from tlr_exp.sweeps.stopping import (
    END,
    KILL,
    Left,
    Stopper,
    clear_stop,
    request_stop,
    stop_requested,
)

# Sleeps until the watch interrupts it.
JOB = """
import signal, sys, time
from pathlib import Path
from tlr_exp.mlflow_sync.following import WatchedProcess
from tlr_exp.sweeps.stopping import Watch
# As the process of a job does: what was started in the background may ignore the signal.
signal.signal(signal.SIGINT, signal.default_int_handler)
with_pid = WatchedProcess(int(sys.argv[2]))
Watch(Path(sys.argv[1]), with_pid.alive).start()
print("ready", flush=True)
try:
    time.sleep(60)
except KeyboardInterrupt:
    Path(sys.argv[1], "saved").touch()
"""


def test_the_file_says_how(tmp_path):
    assert stop_requested(tmp_path) is None
    request_stop(tmp_path, END)
    assert stop_requested(tmp_path) == END
    request_stop(tmp_path, KILL)
    assert stop_requested(tmp_path) == KILL
    (tmp_path / "stop").write_text("")  # by a person's touch
    assert stop_requested(tmp_path) == END
    clear_stop(tmp_path)
    clear_stop(tmp_path)
    assert stop_requested(tmp_path) is None


def test_signals_escalate_and_the_handlers_come_back(tmp_path):
    before = signal.getsignal(signal.SIGINT)
    with Stopper(tmp_path) as stopper:
        assert not stopper.stopping
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        assert stopper.stopping
        assert stop_requested(tmp_path) == END
        signal.raise_signal(signal.SIGINT)
        assert stop_requested(tmp_path) == END
        signal.raise_signal(signal.SIGINT)
        assert stop_requested(tmp_path) == KILL
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_file_that_a_person_made_counts_as_a_signal_does(tmp_path):
    stopper = Stopper(tmp_path)
    assert not stopper.stopping
    (tmp_path / "stop").touch()
    assert stopper.stopping
    assert stopper.interrupts == 0


def test_another_thread_can_end_the_waiting_of_the_main_one(tmp_path):
    with Stopper(tmp_path) as stopper:
        threading.Timer(0.2, stopper.leave).start()
        with pytest.raises(Left):
            time.sleep(30)
        assert not stopper.stopping


@pytest.mark.parametrize("how", ["file", "sweep killed", "parent killed"])
def test_a_job_saves_and_ends_when_asked_or_orphaned(tmp_path, how):
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=pipe) as other:
        # The parent of the job is a shell, so that it can be killed.
        shell = f'"{sys.executable}" -c "$0" "$@"; true'
        command = ["sh", "-c", shell, JOB, str(tmp_path), str(other.pid)]
        with subprocess.Popen(command, stdout=pipe, text=True) as parent:
            assert parent.stdout is not None
            assert parent.stdout.readline() == "ready\n"
            if how == "file":
                request_stop(tmp_path, END)
            elif how == "sweep killed":
                os.kill(other.pid, signal.SIGKILL)
            else:
                parent.kill()
            deadline = time.monotonic() + HANG_S
            while not (tmp_path / "saved").exists():
                assert time.monotonic() < deadline
                time.sleep(0.05)
        if other.poll() is None:
            other.communicate(b"\n")
