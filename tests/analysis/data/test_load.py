"""The same runs give the same study from run directories, from MLflow and from tables."""

import math
import shutil
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import make_study, write_run_directories

from analysis.data import load
from analysis.data.check import checked
from analysis.data.load import from_mlflow
from analysis.data.run_directories import from_run_directories
from analysis.data.runs import RunRecord
from analysis.data.study import Study, StudyError
from analysis.data.tables import from_tables, write_tables
from tlr_exp.mlflow_sync.store import Metric, MlflowClient, open_client
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory

EXPERIMENT = "five seeds"
SEEDS, ITERATIONS = 2, 5


@pytest.fixture(scope="module")
def made(made_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """runs/ with four runs, and mlflow.db with the same; made once, because that takes seconds."""
    root = tmp_path_factory.mktemp("made")
    shutil.copy(made_store, root / "mlflow.db")
    study = make_study(np.random.default_rng(0), seeds=range(SEEDS), iterations=ITERATIONS)
    for path in write_run_directories(study, root / "runs"):
        RunUpload(RunDirectory(path), f"sqlite:///{root / 'mlflow.db'}", EXPERIMENT).push()
    return root


@pytest.fixture
def runs(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made / "runs", tmp_path / "runs"))


@pytest.fixture
def uri(made: Path, tmp_path: Path) -> str:
    """A copy of the store that a test may write to; its artifacts are the common ones."""
    return f"sqlite:///{shutil.copy(made / 'mlflow.db', tmp_path / 'mlflow.db')}"


def same(one: Study, other: Study) -> None:
    pd.testing.assert_frame_equal(one.runs, other.runs)
    pd.testing.assert_frame_equal(one.curves, other.curves, check_exact=True)
    assert (one.arms, one.notes) == (other.arms, other.notes)


def same_records(one: list[RunRecord], other: list[RunRecord], created_at: bool = True) -> None:
    assert len(one) == len(other) > 0
    for left, right in zip(one, other, strict=True):
        pd.testing.assert_frame_equal(left.curve, right.curve, check_exact=True)
        for name in ("name", "run_id", "seed", "method", "status", "config", "packages", "commit"):
            assert getattr(left, name) == getattr(right, name)
        for name in ("scale", "motion", "device", "identity", "host", "cpu_model", "command"):
            assert getattr(left, name) == getattr(right, name)
        if created_at:
            assert left.created_at == right.created_at


def error_of(function: object, *arguments: object) -> str:
    with pytest.raises(StudyError) as caught:
        function(*arguments)  # type: ignore[operator]
    return str(caught.value)


def test_the_three_ways_agree(made: Path, tmp_path: Path) -> None:
    from_disk = checked(from_run_directories(made / "runs"))
    write_tables(from_disk, tmp_path / "tables")
    same(from_disk, checked(from_mlflow(f"sqlite:///{made / 'mlflow.db'}", EXPERIMENT)))
    same(from_disk, from_tables(tmp_path / "tables"))
    study = make_study(np.random.default_rng(0), seeds=range(SEEDS), iterations=ITERATIONS)
    for arm in study.arms:
        for metric in ("train/upper_body_error_m", "eval/survival", "time/evaluate_s"):
            np.testing.assert_array_equal(
                from_disk.matrix(metric, arm)[2], study.matrix(metric, arm)[2]
            )


# --- MLflow ----------------------------------------------------------------------------------
def test_sql_and_the_client_agree(uri: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fast = from_mlflow(uri, EXPERIMENT)
    monkeypatch.setattr(load, "_points_by_sql", lambda *_: None)
    same_records(fast, from_mlflow(uri, EXPERIMENT))


def test_the_length_of_an_extended_run_is_the_last_one(
    uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object) -> str:
        raise OSError("no such store of artifacts")

    monkeypatch.setattr(MlflowClient, "download_artifacts", away)
    record = from_mlflow(uri, EXPERIMENT)[0]
    assert record.iterations == ITERATIONS
    client = MlflowClient(tracking_uri=uri)
    (run,) = client.search_runs(
        [client.get_experiment_by_name(EXPERIMENT).experiment_id],
        f"tags.`{load.RUN_ID_TAG}` = '{record.run_id}'",
    )
    client.set_tag(run.info.run_id, "extended_to", str(ITERATIONS + 5))
    assert from_mlflow(uri, EXPERIMENT)[0].iterations == ITERATIONS + 5


def test_without_artifacts_tags_and_parameters_serve(
    uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = from_mlflow(uri, EXPERIMENT)

    def away(*_: object) -> str:
        raise OSError("no such store of artifacts")

    monkeypatch.setattr(MlflowClient, "download_artifacts", away)
    parts = from_mlflow(uri, EXPERIMENT)
    same_records(whole, parts, created_at=False)  # MLflow keeps milliseconds of that
    for one, other in zip(whole, parts, strict=True):
        assert abs(pd.Timestamp(one.created_at) - pd.Timestamp(other.created_at)).value < 1e6


def mlflow_run(client: MlflowClient, name: str) -> str:
    experiment = client.get_experiment_by_name(EXPERIMENT)
    assert experiment is not None
    found = client.search_runs([experiment.experiment_id], f"run_name LIKE '{name}%'")
    assert len(found) == 1
    return found[0].info.run_id


@pytest.mark.parametrize("by_sql", [True, False])
def test_of_a_step_logged_twice_the_later_counts(
    uri: str, by_sql: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not by_sql:
        monkeypatch.setattr(load, "_points_by_sql", lambda *_: None)
    client = open_client(uri)
    run_id = mlflow_run(client, "demo-gwo-seed1")
    late = 10**13
    client.log_batch(
        run_id,
        metrics=[
            Metric("ppo/kl", 0.75, late, 3),
            Metric("ppo/kl", 0.25, 1, 2),  # older than what is there
            Metric("ppo/entropy", math.nan, late, 3),
            Metric("iteration", 3, late, 3),
        ],
    )
    before = {run.name: run for run in from_run_directories_of(uri)}
    for run in from_mlflow(uri, EXPERIMENT):
        curve, old = run.curve, before[run.name].curve
        assert curve["iteration"].tolist() == [1, 2, 3, 4, 5]
        if run.name.startswith("demo-gwo-seed1"):
            assert curve.loc[2, "ppo/kl"] == 0.75
            assert math.isnan(curve.loc[2, "ppo/entropy"])
            assert curve.loc[1, "ppo/kl"] == old.loc[1, "ppo/kl"]
        else:
            pd.testing.assert_frame_equal(curve, old)


def from_run_directories_of(uri: str) -> list[RunRecord]:
    """The runs that the store was made from, which lie beside its artifacts."""
    with closing(sqlite3.connect(uri.removeprefix("sqlite:///"))) as connection:
        (place,) = connection.execute(
            "SELECT artifact_location FROM experiments WHERE name = ?", [EXPERIMENT]
        ).fetchone()
    root = Path(place.removeprefix("file://"))
    while not (root / "runs").is_dir():
        root = root.parent
    return from_run_directories(root / "runs")


def test_an_iteration_that_is_not_whole_does_not_count(uri: str) -> None:
    client = open_client(uri)
    run_id = mlflow_run(client, "demo-gwo-seed1")
    client.log_metric(run_id, "ppo/kl", 0.5, step=6)  # without its marker "iteration"
    lengths = {run.name: len(run.curve) for run in from_mlflow(uri, EXPERIMENT)}
    assert set(lengths.values()) == {ITERATIONS}


def test_what_is_no_training_run_or_no_curve_is_passed_over(uri: str) -> None:
    expected = from_mlflow(uri, EXPERIMENT)
    client = open_client(uri)
    experiment = client.get_experiment_by_name(EXPERIMENT)
    assert experiment is not None
    client.create_run(experiment.experiment_id, run_name="somebody else's")
    tags = {"tlr_exp.run_id": "of a sweep", "kind": "sweep"}
    client.create_run(experiment.experiment_id, run_name="five_seeds", tags=tags)
    child = mlflow_run(client, "demo-gwo-seed1")
    client.log_metric(child, "final/upper_body_error_m", 0.5, step=5)
    same_records(expected, from_mlflow(uri, EXPERIMENT))
    client.delete_run(child)
    assert len(from_mlflow(uri, EXPERIMENT)) == len(expected) - 1


def test_the_runs_of_one_sweep(uri: str) -> None:
    client = open_client(uri)
    for name, sweeps in (("demo-gwo-seed1", "a-1, b-2"), ("demo-gwo-seed0", "b-2")):
        client.set_tag(mlflow_run(client, name), "sweep", sweeps)
    assert [run.seed for run in from_mlflow(uri, EXPERIMENT, "b-2")] == [0, 1]
    assert [run.seed for run in from_mlflow(uri, EXPERIMENT, "a-1")] == [1]
    assert "has no training run of the sweep b" in error_of(from_mlflow, uri, EXPERIMENT, "b")


def test_a_killed_run_is_not_taken_for_one_that_runs(uri: str) -> None:
    client = open_client(uri)
    run_id = mlflow_run(client, "demo-gwo-seed1")
    client.set_tag(run_id, "tlr_exp.status", "interrupted")
    statuses = {run.seed: run.status for run in from_mlflow(uri, EXPERIMENT) if run.method == "gwo"}
    assert statuses == {0: "finished", 1: "interrupted"}


def test_a_store_or_experiment_that_is_not_there(uri: str, tmp_path: Path) -> None:
    missing = tmp_path / "none" / "mlflow.db"
    assert (
        error_of(from_mlflow, f"sqlite:///{missing}", "x") == f"there is no MLflow store {missing}"
    )
    assert not missing.parent.exists()
    message = error_of(from_mlflow, uri, "other")
    assert message.endswith(f"has no experiment 'other'; it has: Default, {EXPERIMENT}")
    open_client(uri).create_experiment("empty")
    assert "'empty' has no training run" in error_of(from_mlflow, uri, "empty")
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(b"this is no database" * 100)
    (line,) = error_of(from_mlflow, f"sqlite:///{damaged}", "x").splitlines()
    assert line.startswith(f"{damaged} is no MLflow database: ")


@contextmanager
def broken_server(status: int) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://ann:secret@127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def test_a_server_that_refuses_is_one_line_without_the_password() -> None:
    with broken_server(403) as uri:
        (line,) = error_of(from_mlflow, uri, EXPERIMENT).splitlines()
    assert line.startswith("MLflow at http://127.0.0.1:")
    assert "secret" not in line
