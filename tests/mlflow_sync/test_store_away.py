"""Stores that are away, locked, or no stores: noticed in seconds, with a word on what it is."""

import errno
import os
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from stores import log_lines, steps

from tlr_exp.mlflow_sync import store as mlflow_store
from tlr_exp.mlflow_sync.store import TrackingError, TrackingUnavailable, open_client
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory

FAR = "tlr_exp_test"


def test_server_that_is_down_is_noticed_in_seconds(run: RunDirectory) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    start = time.monotonic()
    with pytest.raises(TrackingUnavailable, match=r"http://127\.0\.0\.1:\d+: Connection refused"):
        RunUpload(run, f"http://someone:secret@127.0.0.1:{port}", FAR).push()
    assert time.monotonic() - start < 8


def test_server_that_never_answers_is_given_up(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_TIMEOUT", "1")
    with socket.create_server(("127.0.0.1", 0)) as server:
        start = time.monotonic()
        with pytest.raises(TrackingUnavailable):
            RunUpload(run, f"http://127.0.0.1:{server.getsockname()[1]}", FAR).push()
    assert time.monotonic() - start < 10


@pytest.fixture
def locked(database: Path) -> Iterator[sqlite3.Connection]:
    """The store's database in someone else's exclusive transaction."""
    connection = sqlite3.connect(database, isolation_level=None, check_same_thread=False)
    connection.execute("BEGIN EXCLUSIVE")
    yield connection
    connection.close()


def test_locked_database_only_delays(
    run: RunDirectory, uri: str, database: Path, locked: sqlite3.Connection
) -> None:
    log_lines(run, range(3))
    timer = threading.Timer(1.5, locked.execute, ["ROLLBACK"])
    start = time.monotonic()
    timer.start()
    assert RunUpload(run, uri, FAR).push().iterations == 3
    assert time.monotonic() - start > 1.0
    timer.join()
    assert steps(database) == [0, 1, 2]


def test_database_locked_during_an_upload_only_delays(
    run: RunDirectory, uri: str, database: Path
) -> None:
    upload = RunUpload(run, uri, FAR)
    upload.push()
    log_lines(run, range(3))
    with closing(sqlite3.connect(database, isolation_level=None, check_same_thread=False)) as other:
        other.execute("BEGIN EXCLUSIVE")
        timer = threading.Timer(1.5, other.execute, ["ROLLBACK"])
        timer.start()
        assert upload.push().iterations == 3
        timer.join()
    assert steps(database) == [0, 1, 2]


@pytest.mark.usefixtures("locked")
def test_database_locked_for_long_is_unavailable(
    run: RunDirectory, uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mlflow_store, "SQLITE_WAIT_S", 0.3)
    with pytest.raises(TrackingUnavailable, match=r"mlflow\.db: database is locked"):
        RunUpload(run, uri, FAR).push()


def test_file_that_is_no_database(run: RunDirectory, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("not a database, however long it is" * 100)
    with pytest.raises(TrackingError, match=r"notes\.txt is no MLflow database") as caught:
        RunUpload(run, f"sqlite:///{tmp_path}/notes.txt", FAR).push()
    assert not isinstance(caught.value, TrackingUnavailable)


def test_store_below_a_file(run: RunDirectory, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TrackingUnavailable, match="File exists"):
        RunUpload(run, f"sqlite:///{tmp_path}/file/mlflow.db", FAR).push()


def test_deleted_experiment_says_how_to_bring_it_back(run: RunDirectory, uri: str) -> None:
    client = open_client(uri)
    client.delete_experiment(client.create_experiment("gone"))
    with pytest.raises(TrackingError, match=r"'gone' was deleted: restore it .*--experiment-id"):
        RunUpload(run, uri, "gone").push()


def test_run_on_read_only_media_is_brought_over(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log_lines(run, range(2))
    os_open = os.open

    def read_only(path, flags, *rest, **keywords):
        if Path(path).parent == run.path and flags & (os.O_WRONLY | os.O_RDWR):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return os_open(path, flags, *rest, **keywords)

    monkeypatch.setattr(os, "open", read_only)
    assert RunUpload(run, uri, FAR).push().iterations == 2
    assert steps(database) == [0, 1]


def test_mlflow_is_silent_and_sends_nothing() -> None:
    code = "import tlr_exp.mlflow_sync.store, os; print(os.environ['MLFLOW_DISABLE_TELEMETRY'])"
    ours = ("MLFLOW_", "DO_NOT_TRACK", "GIT_PYTHON")  # set in this process by the import above
    bare = {name: text for name, text in os.environ.items() if not name.startswith(ours)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=bare)
    assert (done.stdout, done.stderr) == ("true\n", "")
