"""A sweep comes into MLflow as a parent with children, once however often; on a real store."""

import shutil
from pathlib import Path

import pytest
from stores import artifacts, children, latest, sql, statuses, steps, tag

from tlr_exp.mlflow_sync import upload as mlflow_upload
from tlr_exp.mlflow_sync import upload_sweep as sweep_tracking
from tlr_exp.mlflow_sync.store import MlflowClient, TrackingUnavailable, open_client
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.mlflow_sync.upload_sweep import SweepUpload
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

ID = "0011aabb"
PARENT = f"two-demo-{ID}"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "tlr"


def begin(study: Path, name: str = "two", sweep_id: str = ID, jobs: int = 2) -> SweepDirectory:
    sweep = SweepDirectory.prepare(study, name, sweep_id)
    sweep.begin("tlr-train -m seed=0,1", jobs, "Two seeds.", {"scale": "demo"})
    return sweep


def add_run(study: Path, name: str, lines: int = 5, status: str = "finished") -> RunDirectory:
    tags = {"method": "gwo", "scale": "demo", "experiment": "tlr"}
    run = RunDirectory.create(study / name, {"seed": 0}, tags)
    for iteration in range(1, lines + 1):
        run.log(iteration, {"train/loss": iteration / 3, "train/episode_length": iteration})
    run.set_status(status)
    return run


def write_job(sweep: SweepDirectory, num: int, run: RunDirectory, status: str = "finished") -> None:
    run_id = run.manifest["run_id"]
    sweep.write_job(num, status, overrides=[f"seed={num}"], run=run.path.name, run_id=run_id)


def test_parent_and_children_with_their_numbers(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study)
    for num in (0, 1):
        write_job(sweep, num, add_run(study, f"run{num}"))
    (sweep.path / "report").mkdir()
    (sweep.path / "report" / "index.html").write_text("<h1>here</h1>")
    (sweep.path / "figures" / "png").mkdir(parents=True)
    (sweep.path / "figures" / "png" / "6.png").write_bytes(b"png")
    sweep.set_status("finished")
    report = SweepUpload(sweep, uri, "tlr").push()
    assert (report.name, report.created, report.status, report.problems) == (
        PARENT, True, "FINISHED", (),
    )  # fmt: skip
    assert [run.created for run in report.runs] == [True, True]
    assert children(database, PARENT) == {"run0", "run1"}
    assert statuses(database) == {PARENT: "FINISHED", "run0": "FINISHED", "run1": "FINISHED"}
    assert latest(database, PARENT) == {"jobs/total": 2, "jobs/finished": 2, "jobs/failed": 0}
    assert latest(database, "run0")["final/episode_length"] == 5.0  # of 5 iterations the last
    assert tag(database, PARENT, "kind") == "sweep"
    assert tag(database, "run0", "kind") == "run"
    assert tag(database, "run0", "sweep") == tag(database, PARENT, "sweep") == f"two-{ID}"
    assert "tlr-train -m seed=0,1" in (tag(database, PARENT, "mlflow.note.content") or "")
    assert artifacts(database.parent / "mlartifacts", report.mlflow_run_id) == {
        "sweep.json", "report/index.html", "figures/png/6.png",
    }  # fmt: skip
    (experiment,) = sql(database, "SELECT DISTINCT experiment_id FROM runs")
    assert sql(database, f"SELECT name FROM experiments WHERE experiment_id = {experiment[0]}") == [
        ("tlr",)
    ]


def test_second_sync_adds_nothing(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study)
    write_job(sweep, 0, add_run(study, "run0"))
    write_job(sweep, 1, add_run(study, "run1", status="failed"), status="failed")
    sweep.set_status("failed")
    SweepUpload(sweep, uri, "tlr").push()
    tables = ("metrics", "params", "tags", "runs", "experiments", "latest_metrics")
    before = {table: sql(database, f"SELECT * FROM {table}") for table in tables}
    again = SweepUpload(sweep, uri, "another").push()
    assert {table: sql(database, f"SELECT * FROM {table}") for table in tables} == before
    assert (again.created, again.files) == (False, 0)
    assert [(run.created, run.points, run.files) for run in again.runs] == [(False, 0, 0)] * 2


def test_children_appear_over_time(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study, jobs=3)
    existing = add_run(study, "run0")
    RunUpload(existing, uri, "tlr").push()  # mirrored before there was a sweep
    upload = SweepUpload(sweep, uri, "tlr")
    with sweep.lock():
        sweep.write_job(0, "waiting", overrides=["seed=0"])
        assert upload.push().status == "RUNNING"
        assert children(database, PARENT) == set()
        write_job(sweep, 0, existing)
        growing = add_run(study, "run1", lines=2, status="running")
        write_job(sweep, 1, growing, status="running")
        with growing.lock():
            upload.push()
            assert children(database, PARENT) == {"run0", "run1"}
            assert statuses(database)["run1"] == "RUNNING"
            growing.log(3, {"train/loss": 1.0})
            upload.push()
            assert steps(database) == [1, 1, 2, 2, 3, 3, 4, 5]
            growing.set_status("finished")
        write_job(sweep, 1, growing)
        write_job(sweep, 2, add_run(study, "run2", status="failed"), status="failed")
        upload.push()
        assert statuses(database)[PARENT] == "RUNNING"
        sweep.set_status("failed")
    assert upload.push().status == "FAILED"
    history = sql(
        database,
        "SELECT key, step, value FROM metrics WHERE key LIKE 'jobs/%' ORDER BY key, timestamp",
    )
    assert history == [
        ("jobs/failed", 0, 0.0), ("jobs/failed", 3, 1.0),
        ("jobs/finished", 0, 0.0), ("jobs/finished", 1, 1.0), ("jobs/finished", 3, 2.0),
        ("jobs/total", 0, 3.0),
    ]  # fmt: skip
    assert len(statuses(database)) == 4


def test_idle_push_asks_nothing_of_the_store(
    study: Path, uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = begin(study)
    write_job(sweep, 0, add_run(study, "run0"))
    upload = SweepUpload(sweep, uri, "tlr")
    first = upload.push()
    for name in ("get_run", "search_runs", "log_batch", "set_tag", "log_artifact", "update_run"):
        monkeypatch.setattr(MlflowClient, name, pytest.fail)
    idle = upload.push()
    assert (idle.mlflow_run_id, idle.created, idle.files) == (first.mlflow_run_id, False, 0)


@pytest.mark.parametrize(
    ("status", "expected"),
    [("finished", "FINISHED"), ("failed", "FAILED"), ("interrupted", "KILLED")],
)
def test_continued_sweep_runs_again_and_ends(
    study: Path, uri: str, database: Path, status: str, expected: str
) -> None:
    sweep = begin(study)
    sweep.set_status("interrupted")
    assert SweepUpload(sweep, uri, "tlr").push().status == "KILLED"
    (ended,) = sql(database, "SELECT end_time FROM runs")[0]
    assert ended >= sql(database, "SELECT start_time FROM runs")[0][0]
    with sweep.lock():
        sweep.begin("tlr-train -m seed=0,1", 2, "Two seeds.", {"scale": "demo"})
        report = SweepUpload(sweep, uri, "tlr").push()
        assert (report.status, report.created) == ("RUNNING", False)
        sweep.set_status(status)
    assert SweepUpload(sweep, uri, "tlr").push().status == expected
    assert statuses(database) == {PARENT: expected}


def test_killed_sweep_is_mended_with_its_children(study: Path, uri: str, database: Path) -> None:
    """Sweep, jobs and mirror were all killed: the store still says RUNNING everywhere."""
    sweep = begin(study)
    run = add_run(study, "run0", status="running")
    write_job(sweep, 0, run, status="running")
    with sweep.lock(), run.lock():
        SweepUpload(sweep, uri, "tlr").push()
        assert set(statuses(database).values()) == {"RUNNING"}
    SweepUpload(sweep, uri, "tlr").push()
    assert statuses(database) == {PARENT: "KILLED", "run0": "KILLED"}
    assert "1 interrupted, 1 not begun" in (tag(database, PARENT, "mlflow.note.content") or "")


def test_runs_that_two_sweeps_share_stay_with_the_first(
    study: Path, uri: str, database: Path
) -> None:
    first, second = begin(study), begin(study, "more", "ffffffff")
    shared = add_run(study, "run0")
    for sweep in (first, second):
        write_job(sweep, 0, shared)
    write_job(second, 1, add_run(study, "run1"))
    for _ in range(2):
        for sweep in (second, first):
            SweepUpload(sweep, uri, "tlr").push()
    assert children(database, "more-demo-ffffffff") == {"run0", "run1"}
    assert children(database, PARENT) == set()
    assert tag(database, "run0", "sweep") == f"more-ffffffff, two-{ID}"
    client = open_client(uri)
    query = f"tags.sweep LIKE '%{ID}%' AND tags.kind = 'run'"
    experiments = [found.experiment_id for found in client.search_experiments()]
    assert [run.info.run_name for run in client.search_runs(experiments, query)] == ["run0"]
    (parent,) = sql(database, "SELECT run_uuid FROM runs WHERE name = 'more-demo-ffffffff'")
    client.delete_run(parent[0])
    SweepUpload(first, uri, "tlr").push()
    assert children(database, PARENT) == {"run0"}


def test_run_whose_directory_is_elsewhere_is_linked(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study)
    far = add_run(study, "run0")
    RunUpload(far, uri, "tlr").push()
    write_job(sweep, 0, far)
    shutil.rmtree(far.path)
    report = SweepUpload(sweep, uri, "tlr").push()
    assert report.runs == report.problems == ()
    assert children(database, PARENT) == {"run0"}
    assert "(#/experiments/" in (tag(database, PARENT, "mlflow.note.content") or "")


def test_damaged_run_keeps_nothing_back(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study)
    bad, good = add_run(study, "bad"), add_run(study, "good")
    write_job(sweep, 0, bad)
    write_job(sweep, 1, good)
    lines = bad.metrics_path.read_bytes().splitlines(keepends=True)
    bad.metrics_path.write_bytes(lines[0] + b"broken\n" + lines[2])
    sweep.set_status("finished")
    report = SweepUpload(sweep, uri, "tlr").push()
    assert report.status == "FINISHED"
    assert len(report.problems) == 1
    assert report.problems[0].startswith("bad: ")
    assert statuses(database)["good"] == "FINISHED"


def test_store_that_is_away_is_not_the_fault_of_a_run(
    study: Path, uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = begin(study)
    write_job(sweep, 0, add_run(study, "run0"))

    def away(*_: object) -> None:
        raise TrackingUnavailable("away")

    monkeypatch.setattr(sweep_tracking.RunUpload, "push", away)
    with pytest.raises(TrackingUnavailable):
        SweepUpload(sweep, uri, "tlr").push()


def test_report_that_is_made_later_and_again(study: Path, uri: str, database: Path) -> None:
    sweep = begin(study)
    sweep.set_status("finished")
    upload = SweepUpload(sweep, uri, "tlr")
    report = upload.push()
    root = database.parent / "mlartifacts" / report.mlflow_run_id / "artifacts"
    page = sweep.path / "report" / "index.html"
    page.parent.mkdir()
    for text in ("one", "two"):  # of one length
        page.write_text(text)
        upload.push()
        assert (root / "report" / "index.html").read_text() == text
    page.write_text("new")
    assert SweepUpload(sweep, uri, "tlr").push().files == 2  # records go together
    assert (root / "report" / "index.html").read_text() == "new"
    assert SweepUpload(sweep, uri, "tlr").push().files == 0


def test_two_processes_do_not_push_at_once(
    study: Path, uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = begin(study)
    monkeypatch.setattr(mlflow_upload, "LOCK_WAIT_S", 0.1)
    with (
        mlflow_upload.one_at_a_time(sweep.path),
        pytest.raises(TrackingUnavailable, match="another"),
    ):
        SweepUpload(sweep, uri, "tlr").push()
