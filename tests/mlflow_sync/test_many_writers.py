"""Many that write into one sqlite store, which may not exist yet, lose nothing."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest
from stores import log_lines, sql, statuses, steps

from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory


def test_two_uploads_of_one_run_at_once_make_one_run(
    run: RunDirectory, uri: str, database: Path
) -> None:
    log_lines(run, range(50))
    threads = [threading.Thread(target=RunUpload(run, uri, "together").push) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sql(database, "SELECT count(*) FROM runs") == [(1,)]
    assert steps(database) == list(range(50))


GROWING = """
import sys
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.mlflow_sync.upload_run import RunUpload
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
