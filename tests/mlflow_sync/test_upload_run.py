"""A run directory comes into MLflow once, whatever happens on the way; on a real sqlite store."""

import errno
import json
import math
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import pytest
from stores import log_lines, small_run, sql, steps

from tlr_exp.mlflow_sync import upload_run as tracking
from tlr_exp.mlflow_sync.store import MlflowClient, TrackingUnavailable, open_client
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.extending import extend
from tlr_exp.records.run_directory import RunDirectory

FAR = "tlr_exp_test"


# --- what arrives ----------------------------------------------------------------------------
def test_everything_arrives(run: RunDirectory, uri: str, database: Path) -> None:
    run.log(0, {"train/loss": 1.25, "weight/torque[0]": 0.5, "train/nothing": math.nan})
    run.log(1, {"train/loss": 0.1})
    (run.path / "eval").mkdir()
    (run.path / "eval" / "iteration_1.json").write_text("{}")
    run.set_status("finished")
    report = RunUpload(run, uri, FAR).push()
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
    RunUpload(run, uri, FAR).push()
    assert list((tmp_path / "here").iterdir()) == []


def test_second_sync_adds_nothing(run: RunDirectory, uri: str, database: Path) -> None:
    log_lines(run, range(7))
    run.set_status("finished")
    first = RunUpload(run, uri, FAR).push()
    tables = ("metrics", "params", "tags", "runs", "experiments", "latest_metrics")
    before = {table: sql(database, f"SELECT * FROM {table}") for table in tables}
    second = RunUpload(run, uri, "another experiment").push()
    assert {table: sql(database, f"SELECT * FROM {table}") for table in tables} == before
    assert second.mlflow_run_id == first.mlflow_run_id
    assert (second.created, second.iterations, second.points, second.files) == (False, 0, 0, 0)
    assert steps(database) == list(range(7))


def test_growing_run_is_mirrored_line_by_line(run: RunDirectory, uri: str, database: Path) -> None:
    upload = RunUpload(run, uri, FAR)
    with run.lock():
        for start in (0, 3, 6):
            log_lines(run, range(start, start + 3))
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
    log_lines(run, range(2))
    upload.push()
    monkeypatch.setattr(RunUpload, "_client", property(pytest.fail))
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
    report = RunUpload(run, uri, FAR).push()
    assert report.status == expected
    assert open_client(uri).get_run(report.mlflow_run_id).info.status == expected


def test_killed_run_that_is_resumed_runs_again(run: RunDirectory, uri: str) -> None:
    assert RunUpload(run, uri, FAR).push().status == "KILLED"
    with run.lock():
        run.set_status("running")
        report = RunUpload(run, uri, FAR).push()
        assert (report.status, report.created) == ("RUNNING", False)
        assert open_client(uri).get_run(report.mlflow_run_id).info.status == "RUNNING"


def test_changed_parameter_is_noted_and_kept(run: RunDirectory, uri: str) -> None:
    first = RunUpload(run, uri, FAR).push()
    text = (run.path / "config.yaml").read_text()
    (run.path / "config.yaml").write_text(text.replace("0.99", "0.9"))
    second = RunUpload(run, uri, FAR).push()
    assert second.notes == ("parameter ppo.gamma keeps its first value '0.99'",)
    assert open_client(uri).get_run(first.mlflow_run_id).data.params["ppo.gamma"] == "0.99"


def test_files_are_copied_once_and_again_when_they_change(
    run: RunDirectory, uri: str, database: Path
) -> None:
    video = run.path / "eval" / "videos" / "best.mp4"
    video.parent.mkdir(parents=True)
    video.write_bytes(b"1")
    first = RunUpload(run, uri, FAR).push()
    assert first.files == 3
    video.write_bytes(b"22")
    assert RunUpload(run, uri, FAR).push().files == 1
    copy = f"mlartifacts/{first.mlflow_run_id}/artifacts/eval/videos/best.mp4"
    assert (database.parent / copy).read_bytes() == b"22"
    run.set_status("finished")
    assert RunUpload(run, uri, FAR).push().files == 2  # configuration and manifest go together
    assert RunUpload(run, uri, FAR).push().files == 0


def test_store_in_a_folder_with_odd_characters(tmp_path: Path) -> None:
    folder = tmp_path / "my runs 100% ü#1"
    run = small_run(folder / "a", lines=2)
    uri = f"sqlite:///{folder}/mlflow.db"
    report = RunUpload(run, uri, "name with / and 100%").push()
    assert steps(folder / "mlflow.db") == [0, 1]
    assert (folder / "mlartifacts" / report.mlflow_run_id / "artifacts" / "config.yaml").is_file()
    assert RunUpload(run, uri, "x").push().files == 0


# --- once, whatever happens ------------------------------------------------------------------
def test_killed_between_two_calls_logs_no_step_twice(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log_lines(run, range(20))
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
            RunUpload(run, uri, FAR).push()
    assert steps(database) == list(range(12))
    report = RunUpload(run, uri, FAR).push()
    assert (report.iterations, report.created) == (8, False)
    assert steps(database) == list(range(20))


def test_answer_that_got_lost_logs_no_step_twice(
    run: RunDirectory, uri: str, database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The store has the lines, the client was told of an error, and the same upload goes on."""
    upload = RunUpload(run, uri, FAR)
    upload.push()
    log_lines(run, range(5))
    log_batch = MlflowClient.log_batch

    def lose_the_answer(self: MlflowClient, run_id: str, **rest) -> None:
        log_batch(self, run_id, **rest)
        raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")

    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_batch", lose_the_answer)
        with pytest.raises(TrackingUnavailable, match="Connection reset"):
            upload.push()
    log_lines(run, range(5, 7))
    assert upload.push().iterations == 2
    assert steps(database) == list(range(7))


def test_line_logged_twice_all_the_same_is_one_point(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log_lines(run, range(3))
    report = RunUpload(run, uri, FAR).push()
    rows, _ = tracking.read_metrics(run.metrics_path)
    for batch in tracking._batches(rows):
        open_client(uri).log_batch(report.mlflow_run_id, metrics=batch)
    assert steps(database) == [0, 1, 2]


def test_resume_behind_what_was_mirrored_keeps_one_point_a_step(
    run: RunDirectory, uri: str, database: Path
) -> None:
    upload = RunUpload(run, uri, FAR)
    log_lines(run, range(10))
    upload.push()
    run.truncate_after(4)
    time.sleep(0.01)  # other time stamps than before
    log_lines(run, range(5, 8))
    assert upload.push().iterations == 0  # steps 5 to 7 are there from before
    log_lines(run, range(8, 13))
    assert upload.push().iterations == 3
    assert RunUpload(run, uri, FAR).push().iterations == 0
    for name in ("train/loss", "weight/torque_0_", "iteration"):
        assert steps(database, name) == list(range(13))


def test_a_run_that_is_trained_further_goes_on_in_the_same_place(
    tmp_path: Path, uri: str, database: Path
) -> None:
    config = {"seed": 3, "scale": {"iterations": 4}}
    run = RunDirectory.create(tmp_path / "extended", config, {"method": "gwo"}, "0000aaaa")
    log_lines(run, range(1, 5))
    run.set_status("finished")
    first = RunUpload(run, uri, FAR).push()
    extend(run, 6, done=4, identity="1111bbbb")
    again = RunUpload(run, uri, FAR).push()
    assert (again.created, again.mlflow_run_id) == (False, first.mlflow_run_id)
    client = open_client(uri)
    log_lines(run, range(5, 7))
    run.set_status("finished")
    last = RunUpload(run, uri, FAR).push()
    there = client.get_run(first.mlflow_run_id)
    assert (there.info.status, there.data.params["scale.iterations"]) == ("FINISHED", "4")
    assert there.data.tags["extended_to"] == "6"
    assert there.data.tags["identity"] == "1111bbbb"
    assert last.notes == ("parameter scale.iterations keeps its first value '4'",)
    assert steps(database) == list(range(1, 7))


def test_torn_last_line_waits_until_it_is_whole(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log_lines(run, range(3))
    whole = run.metrics_path.read_bytes()
    run.metrics_path.write_bytes(whole[:-5])
    upload = RunUpload(run, uri, FAR)
    assert upload.push().iterations == 2
    run.metrics_path.write_bytes(whole)
    assert upload.push().iterations == 1
    assert steps(database) == [0, 1, 2]


def test_making_of_a_store_that_was_killed_is_begun_anew(run: RunDirectory) -> None:
    database = run.path.parent / "mlflow.db"
    half = database.with_name(".mlflow.db.new")
    with closing(sqlite3.connect(half)) as connection:
        connection.execute("CREATE TABLE experiments (experiment_id INTEGER)")
    assert RunUpload(run, f"sqlite:///{database}", FAR).push().created
    assert not half.exists()


def test_artifacts_of_the_manifest_are_readable_json(
    run: RunDirectory, uri: str, database: Path
) -> None:
    report = RunUpload(run, uri, FAR).push()
    path = database.parent / f"mlartifacts/{report.mlflow_run_id}/artifacts/manifest.json"
    assert json.loads(path.read_text()) == run.manifest
