"""The sweep directory: records that are whole, one process at a time, killed sweeps noticed."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tlr_exp.records.storage import StorageError
from tlr_exp.records.sweep_directory import (
    JobRecord,
    SweepDirectory,
    SweepDirectoryError,
)

ID = "0011aabb"


@pytest.fixture
def sweep(tmp_path: Path) -> SweepDirectory:
    return SweepDirectory.prepare(tmp_path / "runs" / "tlr", "five_seeds", ID)


def test_begin_writes_what_the_sweep_is(sweep: SweepDirectory, tmp_path: Path) -> None:
    assert sweep.path == tmp_path / "runs" / "tlr" / "sweeps" / "five_seeds-0011aabb"
    assert sweep.study_folder == tmp_path / "runs" / "tlr"
    with sweep.lock():
        sweep.begin("tlr-train -m +sweep=five_seeds", 10, "five seeds", {"scale": "demo"})
        assert SweepDirectory.open(sweep.path).status == "running"
    record = SweepDirectory.open(sweep.path).manifest
    times = {record.pop("created_at"), record.pop("updated_at")}
    assert len(record.pop("run_id")) == 36
    assert all(time.endswith("+00:00") for time in times)
    assert record == {
        "sweep_id": ID,
        "name": "five_seeds",
        "study": "tlr",
        "status": "running",
        "command": "tlr-train -m +sweep=five_seeds",
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "num_jobs": 10,
        "description": "five seeds",
        "tags": {"scale": "demo"},
    }


def test_continued_sweep_keeps_its_ids_and_its_start(sweep: SweepDirectory) -> None:
    sweep.begin("tlr-train -m", 2)
    sweep.set_status("failed", failed=[1])
    before = sweep.manifest
    assert (before["status"], before["failed"]) == ("failed", [1])
    again = SweepDirectory.prepare(sweep.study_folder, "five_seeds", ID)
    again.begin("tlr-train -m", 3)
    after = again.manifest
    for key in ("run_id", "created_at", "sweep_id"):
        assert after[key] == before[key]
    assert (after["status"], after["num_jobs"]) == ("running", 3)
    assert "failed" not in after  # of the earlier attempt
    assert after["updated_at"] > before["updated_at"]


@pytest.mark.parametrize("status", ["finished", "failed", "interrupted"])
def test_status_that_was_set_holds_without_the_lock(sweep: SweepDirectory, status: str) -> None:
    sweep.begin("x", 1)
    sweep.set_status(status)
    assert sweep.status == status


def test_killed_sweep_is_interrupted_and_free(sweep: SweepDirectory) -> None:
    code = f"""
from tlr_exp.records.sweep_directory import SweepDirectory
sweep = SweepDirectory({str(sweep.path)!r})
with sweep.lock():
    sweep.begin("tlr-train -m", 1)
    print("holds", flush=True)
    input()
"""
    command = [sys.executable, "-c", code]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "holds\n"
        assert sweep.is_live()
        assert sweep.status == "running"
        message = rf"is in use by another process \(pid {process.pid} on "
        with pytest.raises(SweepDirectoryError, match=message), sweep.lock(timeout_s=0.1):
            pass
        process.send_signal(signal.SIGKILL)
    assert not sweep.is_live()
    assert sweep.manifest["status"] == "running"
    assert sweep.status == "interrupted"
    with sweep.lock():
        assert sweep.is_live()


def test_job_goes_through_its_states(sweep: SweepDirectory) -> None:
    overrides = ["optimizer=gwo", "seed=3"]
    first = sweep.write_job(3, "waiting", overrides=overrides)
    sweep.write_job(3, "running", run="demo-gwo-seed3-1", run_id="abc")
    sweep.write_job(3, "failed", error="ValueError: no")
    failed = sweep.job(3)
    sweep.write_job(3, "running")
    running = sweep.job(3)
    assert failed == JobRecord(
        num=3,
        overrides=("optimizer=gwo", "seed=3"),
        run="demo-gwo-seed3-1",
        run_id="abc",
        status="failed",
        error="ValueError: no",
        created_at=first.created_at,
        updated_at=failed.updated_at,
        pid=os.getpid(),
        host=socket.gethostname(),
    )
    assert failed.updated_at > first.updated_at
    assert (running.error, running.run, running.status) == (None, "demo-gwo-seed3-1", "running")
    on_disk = json.loads((sweep.path / "jobs" / "3.json").read_text())
    assert on_disk["overrides"] == overrides


def test_jobs_come_by_number_without_rests_of_kills(sweep: SweepDirectory) -> None:
    assert sweep.jobs() == []
    for num in (10, 2, 0):
        sweep.write_job(num, "waiting", overrides=[f"seed={num}"])
    (sweep.path / "jobs" / ".4.json.tmp").write_text("{")
    assert [job.num for job in sweep.jobs()] == [0, 2, 10]


def test_eight_processes_write_their_records_at_once(sweep: SweepDirectory) -> None:
    code = """
import sys
from tlr_exp.records.sweep_directory import SweepDirectory
sweep, num = SweepDirectory(sys.argv[1]), int(sys.argv[2])
for status in ("waiting", "running", "finished"):
    sweep.write_job(num, status, overrides=[f"seed={num}"], run=f"run{num}", run_id=str(num))
"""
    command = [sys.executable, "-c", code, str(sweep.path)]
    processes = [subprocess.Popen([*command, str(num)]) for num in range(8)]
    assert [process.wait() for process in processes] == [0] * 8
    jobs = [(job.num, job.run_id, job.status, job.overrides) for job in sweep.jobs()]
    assert jobs == [(num, str(num), "finished", (f"seed={num}",)) for num in range(8)]


@pytest.mark.parametrize(
    ("name", "sweep_id", "message"),
    [
        ("../up", ID, r"sweep name '\.\./up': must be letters"),
        ("", ID, "sweep name ''"),
        ("ok", "xyz", "sweep id 'xyz': must be 8 hexadecimal digits"),
    ],
)
def test_names_that_are_no_folder_are_refused(
    tmp_path: Path, name: str, sweep_id: str, message: str
) -> None:
    with pytest.raises(SweepDirectoryError, match=message):
        SweepDirectory.prepare(tmp_path, name, sweep_id)
    assert list(tmp_path.iterdir()) == []


def test_wrong_statuses_are_refused(sweep: SweepDirectory) -> None:
    sweep.begin("x", 1)
    with pytest.raises(ValueError, match="'done': must be one of running, finished"):
        sweep.set_status("done")
    with pytest.raises(ValueError, match="'done': must be one of waiting, running"):
        sweep.write_job(0, "done")
    assert sweep.jobs() == []


def test_what_is_no_sweep_is_explained(tmp_path: Path, sweep: SweepDirectory) -> None:
    with pytest.raises(SweepDirectoryError, match=r"has no sweep\.json\. A sweep directory holds"):
        SweepDirectory.open(tmp_path)
    (sweep.path / "sweep.json").write_text('{"name": "a"}')
    with pytest.raises(SweepDirectoryError, match=r"sweep\.json lacks num_jobs, run_id, status"):
        SweepDirectory.open(sweep.path)
    (sweep.path / "jobs" / "0.json").write_text("[]")
    with pytest.raises(SweepDirectoryError, match=r"0\.json holds a list, not a record"):
        sweep.jobs()
    (sweep.path / "jobs" / "0.json").write_text("{")
    with pytest.raises(SweepDirectoryError, match=r"cannot read .*jobs/0\.json"):
        sweep.write_job(0, "running")


def test_full_disk_keeps_the_record_before(sweep: SweepDirectory) -> None:
    sweep.write_job(0, "running", overrides=["seed=0"])
    (sweep.path / "jobs" / ".0.json.tmp").symlink_to("/dev/full")
    with pytest.raises(StorageError, match="No space left on device"):
        sweep.write_job(0, "finished")
    assert sweep.job(0).status == "running"


def test_sweeps_are_found_below_a_study(sweep: SweepDirectory, tmp_path: Path) -> None:
    sweep.begin("x", 1)
    other = SweepDirectory.prepare(tmp_path / "runs" / "other", "controls", ID)
    other.begin("y", 1)
    SweepDirectory.prepare(tmp_path / "runs" / "tlr", "never_begun", ID)
    assert [found.path for found in SweepDirectory.find(tmp_path)] == [other.path, sweep.path]
    assert [found.path for found in SweepDirectory.find(sweep.path)] == [sweep.path]
