"""tlr-dashboard: what it refuses with which advice, the port it takes, and that it serves."""

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from stores import answers, free_port, wait_until

from tlr_exp.commands import dashboard
from tlr_exp.commands.dashboard import main, pages, what_is_missing
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory


@pytest.fixture(autouse=True)
def no_environment_uri(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


@pytest.fixture
def taken() -> Iterator[int]:
    """A port on loopback that something listens on."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_no_store_yet_says_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path / "runs")]) == 1
    error = capsys.readouterr().err
    assert f"there is no MLflow store {tmp_path}/runs/mlflow.db yet. Train first" in error
    RunDirectory.create(tmp_path / "runs" / "tlr" / "a", {}, {})
    (tmp_path / "runs" / "mlflow.db").touch()
    assert main([str(tmp_path / "runs")]) == 1
    assert f"to it:  tlr-sync {tmp_path}/runs" in capsys.readouterr().err
    assert not (tmp_path / "runs" / "mlflow.db").read_bytes()


def test_server_of_the_environment_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://me:secret@there:5000")
    assert main([str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "http://there:5000" in out
    assert "secret" not in out
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "mlruns")
    assert main([str(tmp_path)]) == 2
    assert "must be http://HOST:PORT" in capsys.readouterr().err
    assert what_is_missing("postgresql://host/db", tmp_path) is None


def test_port_that_is_taken(
    taken: int, database: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(database.parent), "--port", str(taken)]) == 2
    assert f"port {taken} is in use or not allowed" in capsys.readouterr().err
    monkeypatch.setattr(dashboard, "PORT", taken)
    assert taken < dashboard.free_port(None) < taken + dashboard.PORTS_TRIED
    monkeypatch.setattr(dashboard, "PORTS_TRIED", 1)
    with pytest.raises(ValueError, match="all in use; give --port"):
        dashboard.free_port(None)


def test_pages_are_those_of_studies_with_runs(tmp_path: Path, database: Path) -> None:
    uri = f"sqlite:///{database}"
    assert pages(uri, 5000) == ["  http://127.0.0.1:5000"]
    RunUpload(RunDirectory.create(tmp_path / "a", {}, {}), uri, "my study").push()
    runs = "http://127.0.0.1:5000/#/experiments/1/runs"
    assert pages(uri, 5000) == [
        "  my study",
        f"    runs    {runs}?viewStateShareKey=final-numbers&workflowType=machine_learning",
        f"    curves  {runs}?viewStateShareKey=curves-by-method&workflowType=machine_learning"
        "&compareRunsMode=CHART",
    ]
    database.write_bytes(b"not a database")
    assert pages(uri, 5000) == ["  http://127.0.0.1:5000"]


@pytest.mark.slow
def test_it_serves_the_study_on_loopback(tmp_path: Path, database: Path) -> None:
    RunUpload(
        RunDirectory.create(tmp_path / "a", {}, {}), f"sqlite:///{database}", "my study"
    ).push()
    port = free_port()
    command = [
        sys.executable,
        "-m",
        "tlr_exp.commands.dashboard",
        str(tmp_path),
        "--port",
        str(port),
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    ) as process:
        try:
            wait_until(lambda: answers(f"http://127.0.0.1:{port}/health"))
            url = f"http://127.0.0.1:{port}/api/2.0/mlflow/experiments/get?experiment_id=1"
            with urllib.request.urlopen(url, timeout=30) as answer:
                assert b"my study" in answer.read()
            group = subprocess.run(
                ["ps", "-o", "pid=", "-g", str(os.getpgid(process.pid))],
                capture_output=True,
                text=True,
                check=True,
            )
            assert len(group.stdout.split()) <= 3
        finally:
            os.killpg(process.pid, signal.SIGKILL)
