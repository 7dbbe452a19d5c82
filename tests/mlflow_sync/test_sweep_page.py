"""What MLflow shows of a sweep: names, tags, numbers and a description within its limits."""

from dataclasses import replace

import pytest

from tlr_exp.mlflow_sync.sweep_page import (
    JobView,
    progress,
    sweep_name,
    sweep_note,
    sweep_tags,
    swept_values,
)
from tlr_exp.records.sweep_directory import JobRecord

RECORD = {
    "sweep_id": "0011aabb",
    "run_id": "uuid-1",
    "name": "five_seeds",
    "study": "tlr",
    "status": "running",
    "command": "tlr-train -m +sweep=five_seeds scale=demo",
    "num_jobs": 4,
    "description": "Five seeds of two arms.",
    "host": "box",
}


def job(num: int, *overrides: str, status: str = "finished", **manifest: object) -> JobView:
    record = JobRecord(num, overrides, f"run{num}", str(num), status, None, "t", "t", 1, "box")
    return JobView(record, status, manifest or None, f"mlflow{num}")


JOBS = [
    job(0, "optimizer=fixed", "seed=0", "+a=1", tags={"method": "fixed", "scale": "demo"}),
    job(1, "optimizer=gwo", "seed=0", "a=1", tags={"method": "gwo", "scale": "demo"}),
    job(2, "optimizer=gwo", "seed=1", "~b", status="failed"),
]


def test_name_has_the_scale_as_soon_as_it_is_known() -> None:
    assert sweep_name(RECORD, []) == "five_seeds-0011aabb"
    assert sweep_name(RECORD, JOBS) == "five_seeds-demo-0011aabb"
    assert sweep_name({**RECORD, "tags": {"scale": "paper"}}, []) == "five_seeds-paper-0011aabb"
    two = [*JOBS, job(3, tags={"scale": "laptop"})]
    assert sweep_name(RECORD, two) == "five_seeds-demo+laptop-0011aabb"


def test_only_what_differs_is_swept() -> None:
    assert swept_values(JOBS) == {"optimizer": "fixed, gwo", "seed": "0, 1"}
    assert swept_values(JOBS[:1]) == swept_values([]) == {}


def test_numbers_of_jobs() -> None:
    assert progress(RECORD, JOBS) == {"jobs/total": 4, "jobs/finished": 2, "jobs/failed": 1}


def test_tags() -> None:
    jobs = [*JOBS, job(3, git={"commit": "abcdef0123456789", "dirty": False})]
    assert sweep_tags(RECORD, jobs, "running") == {
        "tlr_exp.sweep_run_id": "uuid-1",
        "tlr_exp.status": "running",
        "kind": "sweep",
        "sweep": "five_seeds-0011aabb",
        "swept.optimizer": "fixed, gwo",
        "swept.seed": "0, 1",
        "command": RECORD["command"],
        "host": "box",
        "git_commit": "abcdef012345",
        "mlflow.source.name": "tlr-train",
        "method": "fixed, gwo",
        "scale": "demo",
    }


def test_single_job_is_told_by_all_of_its_overrides() -> None:
    assert "| 0 | `optimizer=fixed seed=0 +a=1` |" in sweep_note(RECORD, JOBS[:1], "7", "/s")


def test_description_says_what_how_often_and_how_to_repeat_it() -> None:
    jobs = [*JOBS]
    failed = replace(JOBS[2].record, error="ValueError: a | b\nTraceback")
    jobs[2] = replace(JOBS[2], record=failed, mlflow_run_id=None)
    note = sweep_note(RECORD, jobs, "7", "/my runs/sweeps/five_seeds-0011aabb")
    assert note.startswith("Five seeds of two arms.\n")
    assert "**4 jobs**: 2 finished, 1 failed, 1 not begun." in note
    assert "\n`tlr-train -m +sweep=five_seeds scale=demo`\n" in note
    assert "\n    cd '/my runs/sweeps/five_seeds-0011aabb'\n    tlr-export . -o results" in note
    rows = [line for line in note.splitlines() if line.startswith("| ")]
    assert rows[1] == (
        "| 0 | `optimizer=fixed seed=0` | finished | "
        "[run0](#/experiments/7/runs/mlflow0?workflowType=machine_learning) |"
    )
    assert rows[3] == ("| 2 | `optimizer=gwo seed=1` | failed: ValueError: a / b | run2 |")


@pytest.mark.parametrize("count", [0, 1, 300])
def test_description_stays_within_the_limit(count: int) -> None:
    jobs = [job(num, "optimizer=gwo", f"seed={num}") for num in range(count)]
    note = sweep_note({**RECORD, "num_jobs": 300}, jobs, "7", "/runs/s")
    assert len(note) <= 5000
    rows = sum(line.startswith("| ") for line in note.splitlines()) - 1
    if count < 2:
        assert rows == count if count else rows == -1
        assert "more." not in note
    else:
        assert 20 < rows < 300
        assert note.endswith(f"… and {300 - rows} more.")
