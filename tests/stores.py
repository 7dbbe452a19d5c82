"""Small runs, MLflow stores on sqlite and servers on loopback, for tests of what arrived."""

import os
import signal
import socket
import sqlite3
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from tests.patience import wait_for
from tlr_exp.records.run_directory import RunDirectory


def small_run(
    path: Path, lines: int = 0, config: dict[str, Any] | None = None, **tags: str
) -> RunDirectory:
    """A run with `lines` iterations, from 0 on."""
    run = RunDirectory.create(path, config or {"seed": 0}, tags, "0011aabb")
    log_lines(run, range(lines))
    return run


def log_lines(run: RunDirectory, iterations: range) -> None:
    for iteration in iterations:
        run.log(iteration, {"train/loss": iteration / 3, "weight/torque[0]": 0.5})


def sql(database: Path, query: str) -> list[tuple]:
    with closing(sqlite3.connect(database, timeout=20)) as connection:
        return connection.execute(query).fetchall()


def steps(database: Path, name: str = "train/loss") -> list[int]:
    """Steps of a metric in the order of steps, as often as they are in the store."""
    rows = sql(database, f"SELECT step FROM metrics WHERE key = '{name}' ORDER BY step")
    return [step for (step,) in rows]


def statuses(database: Path) -> dict[str, str]:
    """Status of every run by its name."""
    return dict(sql(database, "SELECT name, status FROM runs"))


def tag(database: Path, run: str, key: str) -> str | None:
    """The tag of the run with this name."""
    query = (
        "SELECT value FROM tags JOIN runs ON tags.run_uuid = runs.run_uuid "
        f"WHERE runs.name = '{run}' AND tags.key = '{key}'"
    )
    found = sql(database, query)
    return found[0][0] if found else None


def latest(database: Path, run: str) -> dict[str, float]:
    """Latest values of the metrics of the run with this name."""
    query = (
        "SELECT key, value FROM latest_metrics m JOIN runs ON m.run_uuid = runs.run_uuid "
        f"WHERE runs.name = '{run}'"
    )
    return dict(sql(database, query))


def children(database: Path, parent: str) -> set[str]:
    """Names of the runs whose parent is the run called `parent`."""
    query = (
        "SELECT child.name FROM tags JOIN runs child ON tags.run_uuid = child.run_uuid "
        "JOIN runs parent ON tags.value = parent.run_uuid "
        f"WHERE tags.key = 'mlflow.parentRunId' AND parent.name = '{parent}'"
    )
    return {name for (name,) in sql(database, query)}


def artifacts(folder: Path, run_id: str) -> set[str]:
    """Paths of the files of a run in the artifact folder of a store or a server."""
    (root,) = folder.rglob(f"{run_id}/artifacts")
    return {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}


def wait_until(condition: Callable[[], bool]) -> None:
    wait_for(condition)


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@contextmanager
def server(folder: Path, port: int) -> Iterator[str]:
    """A tracking server with its store and its artifacts in `folder`; killed at the end."""
    command = [
        sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--port", str(port),
        "--workers", "1", "--backend-store-uri", f"sqlite:///{folder}/mlflow.db",
        "--artifacts-destination", str(folder / "artifacts"),
    ]  # fmt: skip
    with open(folder / "server.log", "ab") as log_file:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false"},  # 8 processes less
            start_new_session=True,
            stdout=log_file,
            stderr=log_file,
        )
    uri = f"http://127.0.0.1:{port}"
    try:
        wait_until(lambda: answers(f"{uri}/health"))
        yield uri
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=2) as answer:
            return answer.status == 200
    except (urllib.error.URLError, OSError):
        return False
