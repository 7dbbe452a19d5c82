"""What a finished run gets in MLflow besides its curves: final numbers and checkpoints."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from stores import artifacts, latest, sql, tag

from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory


@pytest.fixture
def finished(run: RunDirectory) -> Callable[..., RunDirectory]:
    """``finished(status)``: a run with checkpoints of 1 MB at 4 and 5, the best at 4."""

    def make(status: str = "finished") -> RunDirectory:
        for iteration in range(1, 6):
            run.log(iteration, {"train/episode_length": iteration})
        run.set_status(status)
        folder = run.path / "checkpoints"
        folder.mkdir()
        for iteration in (3, 4, 5):
            (folder / f"{iteration:06d}.pt").write_bytes(bytes([iteration]) * 1_000_000)
        (folder / "scores.json").write_text(json.dumps({"3": 1.0, "4": 3.0, "5": 2.0}))
        run.motion_path.write_bytes(b"the clip")
        return run

    return make


def test_best_and_final_checkpoint_come_with_the_end(
    finished: Callable[..., RunDirectory], uri: str, database: Path
) -> None:
    run = finished("interrupted")
    report = RunUpload(run, uri, "tlr").push()
    there = database.parent / "mlartifacts"
    assert artifacts(there, report.mlflow_run_id) == {"config.yaml", "manifest.json"}
    assert "final/episode_length" not in latest(database, "gwo-s3")
    run.set_status("finished")
    RunUpload(run, uri, "tlr").push()
    assert artifacts(there, report.mlflow_run_id) == {
        "config.yaml", "manifest.json", "motion.npz",
        "checkpoints/000004.pt", "checkpoints/000005.pt",
    }  # fmt: skip
    assert tag(database, "gwo-s3", "best_checkpoint") == "checkpoints/000004.pt"
    assert tag(database, "gwo-s3", "final_checkpoint") == "checkpoints/000005.pt"
    assert latest(database, "gwo-s3")["final/episode_length"] == 5.0
    (point,) = sql(database, "SELECT step FROM metrics WHERE key = 'final/episode_length'")
    assert point == (5,)
    again = RunUpload(run, uri, "tlr").push()
    assert (again.points, again.files, again.notes) == (0, 0, ())


def test_files_beyond_the_limit_stay_and_are_named(
    finished: Callable[..., RunDirectory], uri: str, database: Path
) -> None:
    run = finished()
    (run.path / "eval").mkdir()
    (run.path / "eval" / "film.mp4").write_bytes(bytes(2_000_000))
    (run.path / "eval" / "numbers.json").write_text("{}")
    report = RunUpload(run, uri, "tlr", max_file_mb=1.5).push()
    assert report.notes == (
        "eval/film.mp4 stays in the run directory: 2.0 MB, the limit is 1.5 MB",
    )
    there = database.parent / "mlartifacts"
    expected = {
        "config.yaml", "manifest.json", "motion.npz", "eval/numbers.json",
        "checkpoints/000004.pt", "checkpoints/000005.pt",
    }  # fmt: skip
    assert artifacts(there, report.mlflow_run_id) == expected
    assert len(RunUpload(run, uri, "tlr", max_file_mb=0).push().notes) == 5
    RunUpload(run, uri, "tlr").push()
    assert artifacts(there, report.mlflow_run_id) == {*expected, "eval/film.mp4"}
