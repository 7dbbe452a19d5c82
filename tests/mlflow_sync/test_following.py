"""How long a mirror goes on, and when it pushes."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from stores import small_run, wait_until

from tlr_exp.mlflow_sync import following
from tlr_exp.mlflow_sync.following import WatchedProcess, follow, has_ended
from tlr_exp.records.run_directory import RunDirectoryError


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("TICK_S", "POLL_S"):
        monkeypatch.setattr(following, name, 0.001)
    monkeypatch.setattr(following, "GIVE_UP_S", 1.0)
    monkeypatch.setattr(following, "GIVE_UP_AT_ONCE_S", 0.05)
    monkeypatch.setattr(following, "LAST_WAIT_S", 0.01)


@pytest.mark.usefixtures("fast")
def test_last_push_sees_what_was_written_before_the_end() -> None:
    written, pushed = [0], [0]

    def is_over() -> bool:
        written[0] += 1
        return written[0] > 20

    def push() -> bool:
        pushed[0] = written[0]
        return True

    assert follow(is_over, push)
    assert pushed[0] == written[0] == 21


@pytest.mark.usefixtures("fast")
def test_store_that_comes_back_after_the_end_gets_everything() -> None:
    start = time.monotonic()
    pushes = iter([True])  # it worked once, then it is away for 0.1 s past the end

    def push() -> bool:
        return next(pushes, time.monotonic() - start > 0.1)

    assert follow(lambda: True if time.monotonic() - start > 0.02 else False, push)  # noqa: SIM210


@pytest.mark.usefixtures("fast")
@pytest.mark.parametrize(("worked_once", "least_s", "most_s"), [(True, 1.0, 9), (False, 0.05, 0.9)])
def test_store_that_stays_away_is_given_up(
    worked_once: bool, least_s: float, most_s: float
) -> None:
    answers = iter([worked_once])
    over = [False]

    def push() -> bool:
        over[0] = True
        return next(answers, False)

    start = time.monotonic()
    assert not follow(lambda: over[0], push)
    assert least_s <= time.monotonic() - start < most_s


def test_pauses_grow_while_the_store_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    tried: list[float] = []
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(time, "sleep", lambda pause: now.__setitem__(0, now[0] + pause))

    def push() -> bool:
        tried.append(now[0])
        return now[0] > 200

    assert follow(lambda: now[0] > 250, push)
    pauses = [after - before for before, after in itertools.pairwise(tried)]
    assert pauses[:6] == [4.0, 8.0, 16.0, 32.0, 60.0, 60.0]
    assert pauses[-2] == 2.0  # back to the usual pause once it works


def test_run_has_ended_when_its_process_says_so_or_is_gone(tmp_path: Path) -> None:
    run = small_run(tmp_path / "a")
    here = WatchedProcess(os.getpid())
    assert not has_ended(run, here)
    run.set_status("finished")
    assert has_ended(run, here)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        resuming = WatchedProcess(other.pid)
        assert not has_ended(run, resuming)  # the status is an earlier process's
        other.send_signal(signal.SIGKILL)
        # Gone, though this process has not waited for it yet.
        wait_until(lambda: has_ended(run, resuming))
    assert has_ended(run, WatchedProcess(other.pid))
    (run.path / "manifest.json").unlink()
    with pytest.raises(RunDirectoryError, match=r"cannot read .*manifest\.json"):
        has_ended(run, here)
