"""Bringing a run directory into MLflow, once however often it is tried.

What makes it repeatable: the MLflow run is found by the tag
`tlr_exp.run_id`; every line of metrics is logged together with the metric "iteration" in one call,
which the store commits as one transaction, so that the latest "iteration" in the store says which
lines are there; a line that is logged again all the same has the same time stamp and value, and
the store drops it. After a resume the lines past the checkpoint are written anew: the store keeps
those it has, as it cannot take points back.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import filelock

from tlr_exp.keys import ITERATION
from tlr_exp.records.metrics_file import WALL_TIME, last_of_each_iteration, read_metrics
from tlr_exp.records.mlflow_names import (
    FILES_TAG,
    RUN_ID_TAG,
    flat_parameters,
    mlflow_status,
    plain_name,
    run_tags,
)
from tlr_exp.records.mlflow_store import (
    Metric,
    MlflowClient,
    Param,
    Run,
    RunTag,
    TrackingUnavailable,
    experiment_id,
    open_client,
    tracking_errors,
)
from tlr_exp.records.run_directory import (
    CONFIG,
    EVALUATIONS,
    INTERRUPTED,
    MANIFEST,
    RUNNING,
    RunDirectory,
)

LOCK_WAIT_S = 60.0  # for another process that brings the same run over
MAX_METRICS, MAX_PARAMETERS = 1000, 100  # of one log_batch call, MLflow's limits


@dataclass(frozen=True)
class SyncReport:
    """What one call brought over: counts of new things, and the run's state in MLflow."""

    name: str
    mlflow_run_id: str
    created: bool
    iterations: int
    points: int
    files: int
    status: str
    notes: tuple[str, ...] = ()


def sync_run(run: RunDirectory | str | Path, tracking_uri: str, experiment: str) -> SyncReport:
    """Bring what `tracking_uri` lacks of a run into it; a second call adds nothing.

    A run that the store has already, in whatever experiment, stays there; a new one goes to
    `experiment`, which is made if need be.

    Raises:
        TrackingUnavailable: the store cannot be reached or written now.
        TrackingError: MLflow refuses something for good.
        ValueError: not a run directory, or a damaged one.
    """
    run = run if isinstance(run, RunDirectory) else RunDirectory.open(run)
    return RunUpload(run, tracking_uri, experiment).push()


class RunUpload:
    """One run directory on its way into one store; `push` again as the run grows."""

    def __init__(self, run: RunDirectory, tracking_uri: str, experiment: str) -> None:
        self._run, self._uri, self._experiment = run, tracking_uri, experiment
        self._client: MlflowClient | None = None
        self._read_until = (0, 0)  # inode of metrics.jsonl and the offset brought over
        self._uploaded: set[tuple[str, int, int]] | None = None  # name, size, time of files there
        self._parameters: tuple[object, dict[str, str]] | None = None
        self._pushed: tuple[object, SyncReport] | None = None

    def push(self) -> SyncReport:
        """Bring over what is new; nothing is asked of the store while the run has not changed.

        Raises as `sync_run`.
        """
        with tracking_errors(self._uri), _one_at_a_time(self._run.path):
            state = self._state()
            if self._pushed is not None and self._pushed[0] == state:
                return replace(self._pushed[1], created=False, iterations=0, points=0, files=0)
            self._client = self._client or open_client(self._uri)
            report = self._push(self._client)
            self._pushed = (state, report)
        return report

    def _state(self) -> object:
        """Differs whenever there may be something to bring over."""
        metrics = self._run.metrics_path
        return (
            [_file_state(path) for path in self._files()],
            _file_state(metrics) if metrics.exists() else None,
            self._run.is_live(),
        )

    def _push(self, client: MlflowClient) -> SyncReport:
        manifest = self._run.manifest
        dead = manifest["status"] == RUNNING and not self._run.is_live()
        status = INTERRUPTED if dead else manifest["status"]
        run, created = self._find_or_create(client, manifest)
        notes = _log_parameters(client, run, self._flat_config())
        _set_tags(client, run, run_tags(manifest, status))
        iterations, points = self._log_metrics(client, run)
        files = self._upload(client, run)
        word = mlflow_status(status)
        if run.info.status != word:
            _set_status(client, run.info.run_id, word, self._run)
        name, run_id = manifest["name"], run.info.run_id
        return SyncReport(name, run_id, created, iterations, points, files, word, notes)

    def _flat_config(self) -> dict[str, str]:
        state = _file_state(self._run.path / CONFIG)
        if self._parameters is None or self._parameters[0] != state:  # YAML is slow to parse
            self._parameters = (state, flat_parameters(self._run.config))
        return self._parameters[1]

    def _find_or_create(self, client: MlflowClient, manifest: dict[str, Any]) -> tuple[Run, bool]:
        experiments = [found.experiment_id for found in client.search_experiments()]
        query = f"tags.`{RUN_ID_TAG}` = '{manifest['run_id']}'"
        found = client.search_runs(experiments, query, max_results=1) if experiments else []
        if found:
            return found[0], False
        run = client.create_run(
            experiment_id(client, self._experiment, self._uri),
            start_time=_milliseconds(manifest["created_at"]),
            tags={RUN_ID_TAG: manifest["run_id"]},
            run_name=manifest["name"],
        )
        return run, True

    def _log_metrics(self, client: MlflowClient, run: Run) -> tuple[int, int]:
        """Log the lines past the last one in the store; the numbers of lines and of points."""
        inode, offset = self._read_until
        now = _inode(self._run.metrics_path)
        rows, offset = read_metrics(self._run.metrics_path, offset if now == inode else 0)
        last = run.data.metrics.get(ITERATION, -1)
        rows = [row for row in last_of_each_iteration(rows) if row[ITERATION] > last]
        points = 0
        for batch in _batches(rows):
            client.log_batch(run.info.run_id, metrics=batch)
            points += len(batch)
        self._read_until = (now, offset)
        return len(rows), points

    def _upload(self, client: MlflowClient, run: Run) -> int:
        """Copy the files that the store lacks or has otherwise; the number of those."""
        root, run_id, files = self._run.path, run.info.run_id, self._files()
        digest = _digest([root / CONFIG, root / MANIFEST])
        if self._uploaded is None:
            there = _artifact_sizes(client, run_id, EVALUATIONS)
            self._uploaded = {
                _file_state(path)
                for path in files
                if there.get(path.relative_to(root).as_posix()) == path.stat().st_size
            }
            if run.data.tags.get(FILES_TAG) == digest:
                self._uploaded |= {_file_state(root / CONFIG), _file_state(root / MANIFEST)}
        new = [path for path in files if _file_state(path) not in self._uploaded]
        for path in new:
            state = _file_state(path)  # before the copy: a file that grows meanwhile is new again
            folder = path.relative_to(root).parent.as_posix()
            client.log_artifact(run_id, str(path), None if folder == "." else folder)
            self._uploaded.add(state)
        if run.data.tags.get(FILES_TAG) != digest:
            client.set_tag(run_id, FILES_TAG, digest)
        return len(new)

    def _files(self) -> list[Path]:
        """Configuration, manifest and what evaluations wrote."""
        written = (self._run.path / EVALUATIONS).rglob("*")
        evaluations = sorted(path for path in written if path.is_file() and path.name[0] != ".")
        return [self._run.path / CONFIG, self._run.path / MANIFEST, *evaluations]


# --- parts of a push -------------------------------------------------------------------------
def _log_parameters(client: MlflowClient, run: Run, parameters: dict[str, str]) -> tuple[str, ...]:
    """Log the parameters that are missing; names those that differ, which MLflow cannot change."""
    there = run.data.params
    missing = [Param(name, text) for name, text in parameters.items() if name not in there]
    for start in range(0, len(missing), MAX_PARAMETERS):
        client.log_batch(run.info.run_id, params=missing[start : start + MAX_PARAMETERS])
    changed = [name for name, text in parameters.items() if there.get(name, text) != text]
    return tuple(f"parameter {name} keeps its first value {there[name]!r}" for name in changed)


def _set_tags(client: MlflowClient, run: Run, tags: dict[str, str]) -> None:
    new = [RunTag(name, text) for name, text in tags.items() if run.data.tags.get(name) != text]
    for start in range(0, len(new), MAX_PARAMETERS):
        client.log_batch(run.info.run_id, tags=new[start : start + MAX_PARAMETERS])


def _batches(rows: list[dict[str, Any]]) -> Iterator[list[Metric]]:
    """Metrics of whole lines, at most 1000 a batch, each line's marker behind its metrics."""
    batch: list[Metric] = []
    for row in rows:
        step, time_ms = row[ITERATION], int(row[WALL_TIME] * 1000)
        line = [
            Metric(plain_name(name), value, time_ms, step)
            for name, value in row.items()
            if name not in (ITERATION, WALL_TIME)
        ]
        line.append(Metric(ITERATION, step, time_ms, step))
        if batch and len(batch) + len(line) > MAX_METRICS:
            yield batch
            batch = []
        # A line beyond MLflow's limit goes in several calls, its marker in the last.
        while len(line) > MAX_METRICS:
            yield line[:MAX_METRICS]
            line = line[MAX_METRICS:]
        batch += line
    if batch:
        yield batch


def _set_status(client: MlflowClient, run_id: str, status: str, run: RunDirectory) -> None:
    if status == "RUNNING":
        client.update_run(run_id, status=status)
        return
    ended = _milliseconds(run.manifest["updated_at"])
    if run.metrics_path.exists():  # of a killed run the last line is the latest sign of life
        ended = max(ended, int(run.metrics_path.stat().st_mtime * 1000))
    client.set_terminated(run_id, status, end_time=ended)


def _artifact_sizes(client: MlflowClient, run_id: str, folder: str) -> dict[str, int]:
    """Sizes in bytes of the artifacts below `folder`, by path."""
    sizes: dict[str, int] = {}
    for item in client.list_artifacts(run_id, folder):
        if item.is_dir:
            sizes |= _artifact_sizes(client, run_id, item.path)
        else:
            sizes[item.path] = item.file_size or 0
    return sizes


def _file_state(path: Path) -> tuple[str, int, int]:
    status = path.stat()
    return str(path), status.st_size, status.st_mtime_ns


def _inode(path: Path) -> int:
    return path.stat().st_ino if path.exists() else 0


def _digest(paths: list[Path]) -> str:
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in paths)).hexdigest()[:16]


def _milliseconds(iso_time: str) -> int:
    return int(datetime.fromisoformat(iso_time).timestamp() * 1000)


@contextmanager
def _one_at_a_time(run: Path) -> Iterator[None]:
    """Hold off other processes that bring this run over: two could both make it in MLflow."""
    lock = filelock.FileLock(run / "sync.lock")
    try:
        lock.acquire(timeout=LOCK_WAIT_S)
    except filelock.Timeout:
        raise TrackingUnavailable(f"another process is bringing {run} over") from None
    except OSError:  # a run on read-only media; nobody mirrors it live
        yield
        return
    try:
        yield
    finally:
        lock.release()
