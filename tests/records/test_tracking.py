"""A run directory comes into MLflow once, whatever happens on the way; on a real sqlite store."""

import errno
import json
import math
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
from hypothesis import given
from hypothesis import strategies as st
from stores import sql, statuses, steps

from tlr_exp.records import mlflow_store, tracking
from tlr_exp.records.mlflow_names import flat_parameters, mlflow_status, plain_name, run_tags
from tlr_exp.records.mlflow_store import (
    MlflowClient,
    TrackingError,
    TrackingUnavailable,
    open_client,
)
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.tracking import RunUpload, sync_run

CONFIG = {"seed": 3, "ppo": {"gamma": 0.99, "hidden": [512, 256]}, "note": None, "empty": ""}
TAGS = {"method": "gwo", "scale": "demo", "device": "cpu"}
FAR = "tlr_exp_test"


@pytest.fixture
def uri(database: Path) -> str:
    return f"sqlite:///{database}"


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return make_run(tmp_path / "runs" / "gwo-s3")


def make_run(path: Path, lines: int = 0) -> RunDirectory:
    run = RunDirectory.create(path, CONFIG, TAGS, "0011aabb")
    log(run, range(lines))
    return run


def log(run: RunDirectory, iterations: range, value: float = 0.5) -> None:
    for iteration in iterations:
        run.log(iteration, {"train/loss": value + iteration, "weight/torque[0]": value})


# --- what arrives ----------------------------------------------------------------------------
def test_everything_arrives(run: RunDirectory, uri: str, database: Path) -> None:
    run.log(0, {"train/loss": 1.25, "weight/torque[0]": 0.5, "train/nothing": math.nan})
    run.log(1, {"train/loss": 0.1})
    (run.path / "eval").mkdir()
    (run.path / "eval" / "iteration_1.json").write_text("{}")
    run.set_status("finished")
    report = sync_run(run, uri, FAR)
    assert (report.created, report.iterations, report.status) == (True, 2, "FINISHED")
    client = open_client(uri)
    there = client.get_run(report.mlflow_run_id)
    assert there.info.run_name == "gwo-s3"
    assert there.info.status == "FINISHED"
    assert there.info.end_time is not None
    assert there.info.end_time >= there.info.start_time
    experiment = client.get_experiment(there.info.experiment_id)
    assert experiment.name == FAR
    assert there.data.params == {
        "seed": "3",
        "ppo.gamma": "0.99",
        "ppo.hidden": "[512, 256]",
        "note": "null",
        "empty": "",
    }
    tags = there.data.tags
    assert tags["tlr_exp.run_id"] == run.manifest["run_id"]
    assert (tags["method"], tags["scale"], tags["device"]) == ("gwo", "demo", "cpu")
    assert (tags["seed"], tags["tlr_exp.status"]) == ("3", "finished")
    assert tags["version.torch"] == run.manifest["packages"]["torch"]
    history = client.get_metric_history(report.mlflow_run_id, "train/loss")
    assert [(point.step, point.value) for point in history] == [(0, 1.25), (1, 0.1)]
    assert [p.timestamp for p in history] == [int(r["wall_time"] * 1000) for r in run.metrics()]
    assert steps(database, "weight/torque_0_") == [0]
    (nothing,) = client.get_metric_history(report.mlflow_run_id, "train/nothing")
    assert math.isnan(nothing.value)
    assert report.points == len(sql(database, "SELECT * FROM metrics")) == 6  # with the markers
    folder = database.parent / "mlartifacts" / report.mlflow_run_id / "artifacts"
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {"config.yaml", "manifest.json", "eval/iteration_1.json"}
    assert report.files == 3


def test_nothing_is_written_to_the_current_folder(
    run: RunDirectory, uri: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    sync_run(run, uri, FAR)
    assert list((tmp_path / "here").iterdir()) == []


def test_second_sync_adds_nothing(run: RunDirectory, uri: str, database: Path) -> None:
    log(run, range(7))
    run.set_status("finished")
    first = sync_run(run, uri, FAR)
    tables = ("metrics", "params", "tags", "runs", "experiments", "latest_metrics")
    before = {table: sql(database, f"SELECT * FROM {table}") for table in tables}
    second = sync_run(run, uri, "another experiment")
    assert {table: sql(database, f"SELECT * FROM {table}") for table in tables} == before
    assert second.mlflow_run_id == first.mlflow_run_id
    assert (second.created, second.iterations, second.points, second.files) == (False, 0, 0, 0)
    assert steps(database) == list(range(7))


def test_growing_run_is_mirrored_line_by_line(run: RunDirectory, uri: str, database: Path) -> None:
    upload = RunUpload(run, uri, FAR)
    with run.lock():
        for start in (0, 3, 6):
            log(run, range(start, start + 3))
            report = upload.push()
            assert (report.iterations, report.status) == (3, "RUNNING")
        idle = upload.push()
        assert (idle.iterations, idle.points, idle.files) == (0, 0, 0)
        run.set_status("finished")
    assert upload.push().status == "FINISHED"
    assert steps(database) == list(range(9))


def test_idle_push_asks_nothing_of_the_store(
    run: RunDirectory, uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    upload = RunUpload(run, uri, FAR)
    log(run, range(2))
    upload.push()
    monkeypatch.setattr(upload, "_client", None)
    monkeypatch.setattr(tracking, "open_client", pytest.fail)
    assert upload.push().iterations == 0


@pytest.mark.parametrize(
    ("status", "expected"),
    [
        ("finished", "FINISHED"),
        ("failed", "FAILED"),
        ("interrupted", "KILLED"),
        ("running", "KILLED"),  # without a process that holds the lock
    ],
)
def test_status(run: RunDirectory, uri: str, status: str, expected: str) -> None:
    run.set_status(status)
    report = sync_run(run, uri, FAR)
    assert report.status == expected
    assert open_client(uri).get_run(report.mlflow_run_id).info.status == expected


def test_killed_run_that_is_resumed_runs_again(run: RunDirectory, uri: str) -> None:
    assert sync_run(run, uri, FAR).status == "KILLED"
    with run.lock():
        run.set_status("running")
        report = sync_run(run, uri, FAR)
        assert (report.status, report.created) == ("RUNNING", False)
        assert open_client(uri).get_run(report.mlflow_run_id).info.status == "RUNNING"


def test_changed_parameter_is_noted_and_kept(run: RunDirectory, uri: str) -> None:
    first = sync_run(run, uri, FAR)
    text = (run.path / "config.yaml").read_text()
    (run.path / "config.yaml").write_text(text.replace("0.99", "0.9"))
    second = sync_run(run, uri, FAR)
    assert second.notes == ("parameter ppo.gamma keeps its first value '0.99'",)
    assert open_client(uri).get_run(first.mlflow_run_id).data.params["ppo.gamma"] == "0.99"


def test_files_are_copied_once_and_again_when_they_change(
    run: RunDirectory, uri: str, database: Path
) -> None:
    video = run.path / "eval" / "videos" / "best.mp4"
    video.parent.mkdir(parents=True)
    video.write_bytes(b"1")
    first = sync_run(run, uri, FAR)
    assert first.files == 3
    video.write_bytes(b"22")
    assert sync_run(run, uri, FAR).files == 1
    copy = f"mlartifacts/{first.mlflow_run_id}/artifacts/eval/videos/best.mp4"
    assert (database.parent / copy).read_bytes() == b"22"
    run.set_status("finished")
    assert sync_run(run, uri, FAR).files == 2  # configuration and manifest go together
    assert sync_run(run, uri, FAR).files == 0


def test_store_in_a_folder_with_odd_characters(tmp_path: Path) -> None:
    folder = tmp_path / "my runs 100% ü#1"
    run = make_run(folder / "a", lines=2)
    uri = f"sqlite:///{folder}/mlflow.db"
    report = sync_run(run, uri, "name with / and 100%")
    assert steps(folder / "mlflow.db") == [0, 1]
    assert (folder / "mlartifacts" / report.mlflow_run_id / "artifacts" / "config.yaml").is_file()
    assert sync_run(run, uri, "x").files == 0


# --- once, whatever happens ------------------------------------------------------------------
def test_killed_between_two_calls_logs_no_step_twice(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log(run, range(20))
    monkeypatch.setattr(tracking, "MAX_METRICS", 12)  # four lines of two metrics and a marker
    log_batch = MlflowClient.log_batch
    calls = 0

    def die_in_the_third(self: MlflowClient, run_id: str, metrics=(), **rest) -> None:
        nonlocal calls
        calls += bool(metrics)
        log_batch(self, run_id, metrics=metrics, **rest)
        if calls == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_batch", die_in_the_third)
        with pytest.raises(KeyboardInterrupt):
            sync_run(run, uri, FAR)
    assert steps(database) == list(range(12))
    report = sync_run(run, uri, FAR)
    assert (report.iterations, report.created) == (8, False)
    assert steps(database) == list(range(20))


def test_answer_that_got_lost_logs_no_step_twice(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The store has the lines, the client was told of an error, and the same upload goes on."""
    upload = RunUpload(run, uri, FAR)
    upload.push()
    log(run, range(5))
    log_batch = MlflowClient.log_batch

    def lose_the_answer(self: MlflowClient, run_id: str, **rest) -> None:
        log_batch(self, run_id, **rest)
        raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_batch", lose_the_answer)
        with pytest.raises(TrackingUnavailable, match="Connection reset"):
            upload.push()
    log(run, range(5, 7))
    assert upload.push().iterations == 2
    assert steps(database) == list(range(7))


def test_line_logged_twice_all_the_same_is_one_point(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log(run, range(3))
    report = sync_run(run, uri, FAR)
    rows, _ = tracking.read_metrics(run.metrics_path)
    for batch in tracking._batches(rows):
        open_client(uri).log_batch(report.mlflow_run_id, metrics=batch)
    assert steps(database) == [0, 1, 2]


def test_resume_behind_what_was_mirrored_keeps_one_point_a_step(
    run: RunDirectory, uri: str, database: Path
) -> None:
    upload = RunUpload(run, uri, FAR)
    log(run, range(10))
    upload.push()
    run.truncate_after(4)
    time.sleep(0.01)  # other time stamps than before
    log(run, range(5, 8))
    assert upload.push().iterations == 0  # steps 5 to 7 are there from before
    log(run, range(8, 13))
    assert upload.push().iterations == 3
    assert sync_run(run, uri, FAR).iterations == 0
    for name in ("train/loss", "weight/torque_0_", "iteration"):
        assert steps(database, name) == list(range(13))


def test_torn_last_line_waits_until_it_is_whole(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log(run, range(3))
    whole = run.metrics_path.read_bytes()
    run.metrics_path.write_bytes(whole[:-5])
    upload = RunUpload(run, uri, FAR)
    assert upload.push().iterations == 2
    run.metrics_path.write_bytes(whole)
    assert upload.push().iterations == 1
    assert steps(database) == [0, 1, 2]


def test_two_uploads_of_one_run_at_once_make_one_run(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log(run, range(50))
    threads = [threading.Thread(target=sync_run, args=(run, uri, FAR)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sql(database, "SELECT count(*) FROM runs") == [(1,)]
    assert steps(database) == list(range(50))


GROWING = """
import sys
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.tracking import RunUpload
number, root = int(sys.argv[1]), sys.argv[2]
run = RunDirectory.create(f"{root}/run{number}", {"seed": number}, {"method": "gwo"})
upload = RunUpload(run, f"sqlite:///{root}/mlflow.db", "together")
with run.lock():
    for iteration in range(1, 21):
        run.log(iteration, {f"m/{index}": number + iteration / (index + 1) for index in range(40)})
        upload.push()
    run.set_status("finished")
    upload.push()
"""


@pytest.mark.parametrize("count", [3, pytest.param(8, marks=pytest.mark.slow)])
def test_processes_make_one_store_together_and_lose_nothing(tmp_path: Path, count: int) -> None:
    """Each pushes after each of its 20 iterations of 40 metrics into a store that nobody made."""
    command = [sys.executable, "-c", GROWING]
    processes = [
        subprocess.Popen(
            [*command, str(number), str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        for number in range(count)
    ]
    outputs = [process.communicate(timeout=500)[0] for process in processes]
    assert [process.returncode for process in processes] == [0] * count, outputs
    database = tmp_path / "mlflow.db"
    assert statuses(database) == {f"run{number}": "FINISHED" for number in range(count)}
    query = (
        "SELECT runs.name, key, step, value FROM metrics JOIN runs USING (run_uuid) "
        "WHERE key LIKE 'm/%'"
    )
    points = sorted(sql(database, query))
    assert len(points) == count * 20 * 40
    assert points == sorted(
        (f"run{number}", f"m/{index}", iteration, number + iteration / (index + 1))
        for number in range(count)
        for iteration in range(1, 21)
        for index in range(40)
    )
    assert sql(database, "SELECT count(*) FROM experiments") == [(2,)]  # MLflow's own, and ours
    assert not list(tmp_path.glob(".mlflow*"))


def test_making_of_a_store_that_was_killed_is_begun_anew(run: RunDirectory) -> None:
    database = run.path.parent / "mlflow.db"
    half = database.with_name(".mlflow.db.new")
    with closing(sqlite3.connect(half)) as connection:
        connection.execute("CREATE TABLE experiments (experiment_id INTEGER)")
    assert sync_run(run, f"sqlite:///{database}", FAR).created
    assert not half.exists()


# --- stores that are away --------------------------------------------------------------------
def test_server_that_is_down_is_noticed_in_seconds(run: RunDirectory) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    start = time.monotonic()
    with pytest.raises(TrackingUnavailable, match=r"http://127\.0\.0\.1:\d+: Connection refused"):
        sync_run(run, f"http://someone:secret@127.0.0.1:{port}", FAR)
    assert time.monotonic() - start < 8


def test_server_that_never_answers_is_given_up(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_TIMEOUT", "1")
    with socket.create_server(("127.0.0.1", 0)) as server:
        start = time.monotonic()
        with pytest.raises(TrackingUnavailable):
            sync_run(run, f"http://127.0.0.1:{server.getsockname()[1]}", FAR)
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
    log(run, range(3))
    timer = threading.Timer(1.5, locked.execute, ["ROLLBACK"])
    start = time.monotonic()
    timer.start()
    assert sync_run(run, uri, FAR).iterations == 3
    assert time.monotonic() - start > 1.0
    timer.join()
    assert steps(database) == [0, 1, 2]


def test_database_locked_during_an_upload_only_delays(
    run: RunDirectory, uri: str, database: Path
) -> None:
    upload = RunUpload(run, uri, FAR)
    upload.push()
    log(run, range(3))
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
        sync_run(run, uri, FAR)


def test_file_that_is_no_database(run: RunDirectory, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("not a database, however long it is" * 100)
    with pytest.raises(TrackingError, match=r"notes\.txt is no MLflow database") as caught:
        sync_run(run, f"sqlite:///{tmp_path}/notes.txt", FAR)
    assert not isinstance(caught.value, TrackingUnavailable)


def test_store_below_a_file(run: RunDirectory, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TrackingUnavailable, match="File exists"):
        sync_run(run, f"sqlite:///{tmp_path}/file/mlflow.db", FAR)


def test_deleted_experiment_says_how_to_bring_it_back(run: RunDirectory, uri: str) -> None:
    client = open_client(uri)
    client.delete_experiment(client.create_experiment("gone"))
    with pytest.raises(TrackingError, match=r"'gone' was deleted: restore it .*--experiment-id"):
        sync_run(run, uri, "gone")


def test_run_on_read_only_media_is_brought_over(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log(run, range(2))
    os_open = os.open

    def read_only(path, flags, *rest, **keywords):
        if Path(path).parent == run.path and flags & (os.O_WRONLY | os.O_RDWR):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return os_open(path, flags, *rest, **keywords)

    monkeypatch.setattr(os, "open", read_only)
    assert sync_run(run, uri, FAR).iterations == 2
    assert steps(database) == [0, 1]


# --- names and batches -----------------------------------------------------------------------
rows = st.lists(
    st.dictionaries(
        st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1),
        st.floats(allow_nan=False),
        max_size=30,
    ),
    max_size=12,
)


@given(rows=rows, limit=st.integers(2, 40))
def test_batches_hold_every_point_once_and_end_lines_with_their_marker(
    rows: list[dict[str, float]], limit: int
) -> None:
    lines = [
        {"iteration": step, "wall_time": 1.5 + step, **{f"m/{n}": v for n, v in row.items()}}
        for step, row in enumerate(rows)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking, "MAX_METRICS", limit)
        batches = list(tracking._batches(lines))
    assert all(0 < len(batch) <= limit for batch in batches)
    points = [(point.key, point.step, point.value) for batch in batches for point in batch]
    expected = [
        (name, step, value)
        for step, line in enumerate(lines)
        for name, value in [*list(line.items())[2:], ("iteration", step)]
    ]
    assert points == expected
    for batch in batches:
        assert all(point.timestamp == 1500 + 1000 * point.step for point in batch)
        # Only a line that is too long for one call is cut, and no other line follows the cut.
        assert batch[-1].key == "iteration" or len(lines[batch[-1].step]) - 1 > limit


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("reward_term/ang_vel_xy", "reward_term/ang_vel_xy"),
        ("weight[3]", "weight_3_"),
        ("a%b(c)", "a_b_c_"),
        ("x" * 300, "x" * 250),
    ],
)
def test_names_that_mlflow_takes(name: str, plain: str) -> None:
    assert plain_name(name) == plain


def test_flat_parameters() -> None:
    config = {"a": {"b": {"c": 1.5}, "d": {}}, "e": [1, {"f": None}], "g": True, "h": "x" * 7000}
    flat = flat_parameters(config)
    assert flat.pop("h") == "x" * 6000
    assert flat == {"a.b.c": "1.5", "a.d": "{}", "e": '[1, {"f": null}]', "g": "true"}


def test_tags_of_an_old_or_foreign_manifest() -> None:
    assert run_tags({"run_id": "1"}, "finished") == {
        "tlr_exp.run_id": "1",
        "tlr_exp.status": "finished",
        "kind": "run",
    }
    tags = run_tags({"run_id": "1", "git": {"commit": "abc", "dirty": True}}, "failed")
    assert (tags["git_commit"], tags["git_dirty"]) == ("abc", "true")
    assert mlflow_status("interrupted") == "KILLED"


def test_mlflow_is_silent_and_sends_nothing() -> None:
    code = "import tlr_exp.records.tracking, os; print(os.environ['MLFLOW_DISABLE_TELEMETRY'])"
    ours = ("MLFLOW_", "DO_NOT_TRACK", "GIT_PYTHON")  # set in this process by the import above
    bare = {name: text for name, text in os.environ.items() if not name.startswith(ours)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=bare)
    assert (done.stdout, done.stderr) == ("true\n", "")


def test_artifacts_of_the_manifest_are_readable_json(
    run: RunDirectory, uri: str, database: Path
) -> None:
    report = sync_run(run, uri, FAR)
    path = database.parent / f"mlartifacts/{report.mlflow_run_id}/artifacts/manifest.json"
    assert json.loads(path.read_text()) == run.manifest
