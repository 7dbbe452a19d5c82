"""The live mirror of a run: kills, full disks, servers that come and go."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from stores import free_port, log_lines, server, small_run, sql, statuses, steps, wait_until

from tlr_exp.commands import sync
from tlr_exp.commands.sync import main
from tlr_exp.mlflow_sync import mirror
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.tracking_uri import default_tracking_uri
from tlr_exp.records.run_directory import RunDirectory

CLOSED_PORT = 9  # "discard": nothing listens there


@pytest.fixture(autouse=True)
def no_environment_uri(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


def make_run(path: Path, lines: int = 3) -> RunDirectory:
    return small_run(path, lines, experiment="from the tag")


# --- the mirror, for real --------------------------------------------------------------------
def test_mirror_brings_a_run_over_while_it_trains(tmp_path: Path) -> None:
    run, database = make_run(tmp_path / "runs" / "a"), tmp_path / "mlflow.db"
    uri = f"sqlite:///{database}"
    with run.lock():
        start = time.perf_counter()
        live = Mirror.start(run, uri, "live")
        assert time.perf_counter() - start < 1.0
        wait_until(lambda: database.exists() and steps(database) == [0, 1, 2])
        assert statuses(database) == {"a": "RUNNING"}
        log_lines(run, range(3, 8))
        run.set_status("finished")
        assert live.finish(timeout_s=60)
    assert steps(database) == list(range(8))
    assert statuses(database) == {"a": "FINISHED"}
    assert live.sync_command == f"tlr-sync {run.path} --tracking-uri {uri} --experiment live"
    assert {path.name for path in run.path.iterdir()} == {
        "config.yaml", "manifest.json", "metrics.jsonl", "run.lock", "sync.lock", "sync.log",
    }  # fmt: skip
    assert "FINISHED" in (run.path / "sync.log").read_text()


TRAINING = """
    import os, signal, sys, time
    from tlr_exp.mlflow_sync.mirror import Mirror
    from tlr_exp.records.run_directory import RunDirectory
    path, uri, first, last, end = sys.argv[1:]
    run = RunDirectory.open(path)
    with run.lock():
        mirror = Mirror.start(run, uri, "live")
        run.truncate_after(int(first) - 1)
        run.set_status("running")
        for iteration in range(int(first), int(last) + 1):
            run.log(iteration, {"train/loss": iteration / 3})
            time.sleep(0.01)
        if end == "kill":
            print(mirror._process.pid, flush=True)
            time.sleep(60)
        run.set_status(end)
        print(mirror.finish(60), flush=True)
"""


@contextmanager
def training(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    code = textwrap.dedent(TRAINING)
    command = [sys.executable, "-c", code, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process


def test_killed_training_is_marked_and_its_resume_goes_on_in_the_same_run(
    tmp_path: Path, database: Path
) -> None:
    run = make_run(tmp_path / "runs" / "a", lines=0)
    uri = f"sqlite:///{database}"
    with training(run.path, uri, 0, 20, "kill") as process:
        assert process.stdout is not None
        process.stdout.readline()
        wait_until(lambda: statuses(database) == {"a": "RUNNING"})
        process.send_signal(signal.SIGKILL)
    wait_until(lambda: statuses(database) == {"a": "KILLED"})
    assert steps(database) == list(range(21))
    # The last checkpoint was that of iteration 10.
    with training(run.path, uri, 11, 30, "finished") as process:
        assert process.communicate()[0] == "True\n"
    assert statuses(database) == {"a": "FINISHED"}
    assert steps(database) == list(range(31))


@pytest.mark.slow
def test_resume_of_an_interrupted_run_is_mirrored_from_its_start(
    tmp_path: Path, database: Path
) -> None:
    run = make_run(tmp_path / "a", lines=5)
    with training(run.path, f"sqlite:///{database}", 5, 5, "interrupted") as process:
        assert process.communicate()[0] == "True\n"
    assert statuses(database) == {"a": "KILLED"}
    with training(run.path, f"sqlite:///{database}", 5, 6, "finished") as process:
        assert process.communicate()[0] == "True\n"
    assert statuses(database) == {"a": "FINISHED"}
    assert steps(database) == list(range(7))


def test_killed_mirror_is_made_up_for_by_hand(tmp_path: Path, database: Path) -> None:
    run = make_run(tmp_path / "a", lines=0)
    uri = f"sqlite:///{database}"
    for iteration in range(400):
        run.log(iteration, {"train/loss": iteration / 3, **{f"m/{i}": i for i in range(40)}})
    with run.lock():
        live = Mirror.start(run, uri, "live")
        assert live._process is not None
        wait_until(lambda: len(steps(database)) > 0)
        live._process.send_signal(signal.SIGKILL)
        assert not live.finish()
        run.set_status("finished")
    assert 0 < len(steps(database)) < 400  # killed in the middle
    assert main([str(run.path), "--tracking-uri", uri]) == 0
    assert steps(database) == list(range(400))
    assert sql(database, "SELECT count(*) FROM metrics") == [(400 * 42,)]
    assert statuses(database) == {"a": "FINISHED"}


def test_mirror_keeps_to_itself(tmp_path: Path) -> None:
    run = make_run(tmp_path / "a")
    uri = f"http://me:secret@127.0.0.1:{CLOSED_PORT}"
    with run.lock():
        live = Mirror.start(run, uri, "live")
        assert live._process is not None
        pid = live._process.pid
        # In a session of its own, so that Ctrl-C in the terminal does not reach it.
        wait_until(lambda: os.getsid(pid) == pid)
        log_file = run.path / "sync.log"
        wait_until(lambda: "Connection refused" in log_file.read_text())
        assert os.getpriority(os.PRIO_PROCESS, pid) >= sync.NICENESS
        assert "secret" not in Path(f"/proc/{pid}/cmdline").read_text()
        assert "secret" not in log_file.read_text() + live.sync_command
        assert live._process.poll() is None  # it goes on trying
        run.set_status("failed")
        start = time.monotonic()
        assert not live.finish(timeout_s=40)
        assert time.monotonic() - start < 25
    assert log_file.read_text().count("Connection refused") == 1


@pytest.mark.slow
def test_mirror_that_is_left_behind_ends_by_itself(tmp_path: Path, database: Path) -> None:
    run = make_run(tmp_path / "a")
    with run.lock():
        live = Mirror.start(run, f"sqlite:///{database}", "live")
        run.set_status("finished")
        assert not live.finish(timeout_s=0.01)
    assert live._process is not None
    assert live._process.wait(60) == 0
    assert steps(database) == [0, 1, 2]


def test_deleted_run_ends_its_mirror(tmp_path: Path) -> None:
    run = make_run(tmp_path / "a")
    live = Mirror.start(run, f"http://127.0.0.1:{CLOSED_PORT}", "live")
    (run.path / "manifest.json").unlink()
    assert not live.finish(timeout_s=20)
    assert live._process is not None
    assert live._process.poll() in (1, 2)  # before or after it had looked at the run


def test_no_tracking_is_no_mirror(tmp_path: Path) -> None:
    run = make_run(tmp_path / "a")
    live = Mirror.start(run, None, "live")
    assert live._process is None
    assert live.finish()
    with pytest.raises(ValueError, match="tracking URI"):
        Mirror.start(run, "mlruns", "live")


def test_mirror_that_cannot_start_never_stops_training(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = make_run(tmp_path / "a")
    (run.path / mirror.LOG).mkdir()  # the log cannot be opened
    live = Mirror.start(run, f"sqlite:///{tmp_path}/mlflow.db", "live")
    assert not live.finish()
    assert "not mirrored to MLflow" in caplog.text


@pytest.mark.slow
def test_full_disk_does_not_end_the_mirror(tmp_path: Path, database: Path) -> None:
    run = make_run(tmp_path / "a")
    run.set_status("finished")
    command = [
        sys.executable,
        "-m",
        "tlr_exp.commands.sync",
        str(run.path),
        "--follow",
        str(os.getpid()),
    ]
    with open("/dev/full", "wb", buffering=0) as full:
        assert subprocess.run(command, stdout=full, check=False).returncode == 0
    assert steps(database) == [0, 1, 2]


# --- a tracking server -----------------------------------------------------------------------
@pytest.mark.slow
def test_server_that_comes_and_goes_gets_everything_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{port}")
    (tmp_path / "server").mkdir()
    run, database = make_run(tmp_path / "runs" / "a"), tmp_path / "server" / "mlflow.db"
    (run.path / "eval").mkdir()
    (run.path / "eval" / "result.json").write_text("{}")
    with run.lock():
        live = Mirror.start(run, default_tracking_uri(tmp_path), "live")
        wait_until(lambda: "Connection refused" in (run.path / "sync.log").read_text())
        with server(tmp_path / "server", port):
            wait_until(lambda: "mirrored" in (run.path / "sync.log").read_text())
            assert steps(database) == [0, 1, 2]
        log_lines(run, range(3, 6))
        time.sleep(5)
        log_lines(run, range(6, 9))
        run.set_status("finished")
        with server(tmp_path / "server", port):
            assert live.finish(timeout_s=60)
            assert main([str(run.path)]) == 0
    assert steps(database) == list(range(9))
    assert statuses(database) == {"a": "FINISHED"}
    assert len(list((tmp_path / "server" / "artifacts").rglob("result.json"))) == 1
