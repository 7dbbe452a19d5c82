"""tlr-sync and the live mirror: exit statuses, kills, servers that come and go."""

import itertools
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
from stores import free_port, server, sql, statuses, steps, wait_until

from tlr_exp import sync
from tlr_exp.records import following, mirror
from tlr_exp.records.following import WatchedProcess, follow, has_ended
from tlr_exp.records.mirror import (
    Mirror,
    check_tracking_uri,
    default_tracking_uri,
    hide_password,
    sqlite_path,
)
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.sources import found_below, store_of
from tlr_exp.sync import main

CLOSED_PORT = 9  # "discard": nothing listens there


@pytest.fixture(autouse=True)
def no_environment_uri(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


def make_run(path: Path, lines: int = 3) -> RunDirectory:
    run = RunDirectory.create(path, {"seed": 0}, {"experiment": "from the tag"})
    log(run, range(lines))
    return run


def log(run: RunDirectory, iterations: range) -> None:
    for iteration in iterations:
        run.log(iteration, {"train/loss": iteration / 3})


# --- the command line ------------------------------------------------------------------------
def test_all_runs_below_a_folder_come_over_once(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "sweep/b"):
        make_run(tmp_path / "runs" / name).set_status("finished")
    uri = f"sqlite:///{database}"
    assert main([str(tmp_path / "runs"), "--tracking-uri", uri]) == 0
    printed = capsys.readouterr()
    assert "a: new run, 3 iterations (6 points), 2 files, FINISHED -> sqlite:///" in printed.out
    assert "b: new run" in printed.out
    assert printed.err == ""
    again = [str(tmp_path / "runs"), str(tmp_path / "runs" / "a"), "--tracking-uri", uri]
    assert main(again) == 0
    assert capsys.readouterr().out.count(": 0 iterations (0 points), 0 files, FINISHED") == 2
    assert steps(database) == [0, 0, 1, 1, 2, 2]
    assert sql(database, "SELECT name FROM experiments") == [("Default",), ("from the tag",)]


def test_server_that_is_down_is_status_one_and_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = make_run(tmp_path / "a")
    start = time.monotonic()
    assert main([str(run.path), "--tracking-uri", f"http://127.0.0.1:{CLOSED_PORT}"]) == 1
    assert time.monotonic() - start < 10
    error = capsys.readouterr().err
    assert "a: MLflow at http://127.0.0.1:9: Connection refused" in error
    assert "wait in the run directories. Try again later with the same command" in error


def test_damaged_run_does_not_keep_the_others_back(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, good = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    lines = bad.metrics_path.read_bytes().splitlines(keepends=True)
    bad.metrics_path.write_bytes(lines[0] + b"broken\n" + lines[2])
    uri = f"sqlite:///{database}"
    assert main([str(bad.path), str(good.path), "--tracking-uri", uri]) == 1
    assert f"the line at byte {len(lines[0])} is damaged" in capsys.readouterr().err
    assert steps(database) == [0, 1, 2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{root}/nowhere"], "is not a directory. A run directory holds manifest.json"),
        (["{root}/empty"], "has no manifest.json"),
        (["{root}/a", "--tracking-uri", "mlruns"], "must be http://HOST:PORT, sqlite:///FILE"),
        (["{root}/a", "--tracking-uri", "sqlite://"], "name a file"),
        (["{root}", "--follow", "1"], "--follow is for one run or one sweep, not for 2"),
    ],
)
def test_wrong_arguments_are_status_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    make_run(tmp_path / "a")
    make_run(tmp_path / "b")
    (tmp_path / "empty").mkdir()
    assert main([argument.format(root=tmp_path) for argument in arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["run", "--follow", "me"], ["run", "--no-such"]])
def test_unknown_options_are_status_two(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2


def test_store_is_the_one_given_or_of_the_environment_or_the_nearest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run(tmp_path / "runs" / "study" / "a")
    runs = tmp_path / "runs"
    below, above = f"sqlite:///{runs}/study/mlflow.db", f"sqlite:///{runs}/mlflow.db"
    assert set(found_below([str(run.path)]).values()) == {run.path.parent}
    assert set(found_below([str(runs), str(run.path)]).values()) == {runs}
    (tmp_path / "mlflow.db").write_bytes(b"")  # too far above to be ours
    assert store_of(run, run.path.parent, None) == below
    assert store_of(run, runs, None) == above
    (runs / "mlflow.db").write_bytes(b"")
    assert store_of(run, run.path.parent, None) == above
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert store_of(run, runs, None) == "http://server:5000"
    assert store_of(run, runs, below) == below


# --- URIs ------------------------------------------------------------------------------------
def test_sqlite_uris_become_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert check_tracking_uri("sqlite:///runs/m.db") == f"sqlite:///{tmp_path}/runs/m.db"
    assert check_tracking_uri("sqlite:////a/m.db") == "sqlite:////a/m.db"
    assert default_tracking_uri("runs") == f"sqlite:///{tmp_path}/runs/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///x.db")
    assert default_tracking_uri("runs") == f"sqlite:///{tmp_path}/x.db"


@pytest.mark.parametrize("uri", ["https://h", "postgresql+psycopg2://u:p@h/db", "http://h:5000/x"])
def test_servers_are_taken_as_they_are(uri: str) -> None:
    assert check_tracking_uri(uri) == uri
    assert sqlite_path(uri) is None


@pytest.mark.parametrize("uri", ["./mlruns", "file:///tmp/mlruns", "htp://h", "", "C:\\mlruns"])
def test_other_uris_are_refused(uri: str) -> None:
    with pytest.raises(ValueError, match=r"must be http://HOST:PORT, sqlite:///FILE"):
        check_tracking_uri(uri)


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("http://me:secret@host:5000/path", "http://host:5000/path"),
        ("http://host:5000", "http://host:5000"),
        ("sqlite:////a/b@c.db", "sqlite:////a/b@c.db"),
    ],
)
def test_passwords_are_hidden(uri: str, shown: str) -> None:
    assert hide_password(uri) == shown


# --- when to push ----------------------------------------------------------------------------
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
    run = make_run(tmp_path / "a")
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
        log(run, range(3, 8))
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
    from tlr_exp.records.mirror import Mirror
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
    command = [sys.executable, "-m", "tlr_exp.sync", str(run.path), "--follow", str(os.getpid())]
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
            wait_until(lambda: "mirrored" in (run.path / "sync.log").read_text(), timeout_s=90)
            assert steps(database) == [0, 1, 2]
        log(run, range(3, 6))
        time.sleep(5)
        log(run, range(6, 9))
        run.set_status("finished")
        with server(tmp_path / "server", port):
            assert live.finish(timeout_s=60)
            assert main([str(run.path)]) == 0
    assert steps(database) == list(range(9))
    assert statuses(database) == {"a": "FINISHED"}
    assert len(list((tmp_path / "server" / "artifacts").rglob("result.json"))) == 1
