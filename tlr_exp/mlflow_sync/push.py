"""The parts of bringing something into MLflow that runs and sweeps share; each is repeatable."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import filelock

from tlr_exp.mlflow_sync.names import FILES_TAG
from tlr_exp.mlflow_sync.store import (
    Metric,
    MlflowClient,
    Param,
    Run,
    RunTag,
    TrackingUnavailable,
)

LOCK_WAIT_S = 60.0  # for another process that brings the same folder over
MAX_METRICS, MAX_PARAMETERS = 1000, 100  # of one log_batch call, MLflow's limits


def find_by_tag(client: MlflowClient, tag: str, value: str) -> Run | None:
    """The run, in whatever experiment, whose `tag` is `value`; deleted ones do not count."""
    experiments = [found.experiment_id for found in client.search_experiments()]
    query = f"tags.`{tag}` = '{value}'"
    found = client.search_runs(experiments, query, max_results=1) if experiments else []
    return found[0] if found else None


def log_parameters(
    client: MlflowClient, run: Run, parameters: Mapping[str, str]
) -> tuple[str, ...]:
    """Log the parameters that are missing; names those that differ, which MLflow cannot change."""
    there = run.data.params
    missing = [Param(name, text) for name, text in parameters.items() if name not in there]
    for start in range(0, len(missing), MAX_PARAMETERS):
        client.log_batch(run.info.run_id, params=missing[start : start + MAX_PARAMETERS])
    changed = [name for name, text in parameters.items() if there.get(name, text) != text]
    return tuple(f"parameter {name} keeps its first value {there[name]!r}" for name in changed)


def set_tags(client: MlflowClient, run: Run, tags: Mapping[str, str]) -> None:
    """Set the tags that are missing or differ."""
    new = [RunTag(name, text) for name, text in tags.items() if run.data.tags.get(name) != text]
    for start in range(0, len(new), MAX_PARAMETERS):
        client.log_batch(run.info.run_id, tags=new[start : start + MAX_PARAMETERS])


def log_changed_metrics(
    client: MlflowClient, run: Run, metrics: Mapping[str, float], step: int, time_ms: int
) -> int:
    """Log those whose latest value is another; the number of those."""
    there = run.data.metrics
    new = [
        Metric(name, value, time_ms, step)
        for name, value in metrics.items()
        if there.get(name) != value
    ]
    if new:
        client.log_batch(run.info.run_id, metrics=new)
    return len(new)


def set_status(client: MlflowClient, run: Run, word: str, ended_ms: int) -> None:
    """Give the run MLflow's status `word`, with the time of its end unless it runs."""
    if run.info.status == word:
        return
    if word == "RUNNING":
        client.update_run(run.info.run_id, status=word)
    else:
        client.set_terminated(run.info.run_id, word, end_time=ended_ms)


# --- files -----------------------------------------------------------------------------------
@dataclass(frozen=True)
class Artifact:
    """A file and the folder that it goes to in MLflow ("" for the topmost)."""

    path: Path
    folder: str = ""

    @property
    def name(self) -> str:
        return f"{self.folder}/{self.path.name}" if self.folder else self.path.name

    @property
    def state(self) -> tuple[str, str, int, int]:
        """Differs once the file has changed."""
        return (self.folder, *file_state(self.path))


class ArtifactUpload:
    """The files of one folder on their way to one MLflow run.

    Records are small files that change in place: all go again when the content of one has changed.
    The others go when MLflow has none of that name and size.
    """

    def __init__(self) -> None:
        self._run_id = ""
        self._there: set[object] = set()  # states of files that MLflow has
        self._listed: set[str] = set()  # folders that were compared with MLflow's

    def push(
        self,
        client: MlflowClient,
        run: Run,
        records: Sequence[Artifact],
        others: Sequence[Artifact] = (),
    ) -> int:
        """Copy the files that the store lacks or has otherwise; the number of those."""
        if self._run_id != run.info.run_id:
            self._run_id, self._there, self._listed = run.info.run_id, set(), set()
        digest = _digest(records)
        if run.data.tags.get(FILES_TAG) == digest:
            self._there |= {record.state for record in records}
        self._compare(client, others)
        new = [file for file in (*records, *others) if file.state not in self._there]
        for file in new:
            state = file.state  # before the copy: a file that grows meanwhile is new again
            client.log_artifact(self._run_id, str(file.path), file.folder or None)
            self._there.add(state)
        if run.data.tags.get(FILES_TAG) != digest:
            client.set_tag(self._run_id, FILES_TAG, digest)
        return len(new)

    def _compare(self, client: MlflowClient, files: Sequence[Artifact]) -> None:
        """Note the files that an earlier process has brought over."""
        new = [file for file in files if file.state not in self._there]
        folders = {file.folder.partition("/")[0] for file in new} - self._listed
        sizes: dict[str, int] = {}
        for folder in folders:
            sizes |= _artifact_sizes(client, self._run_id, folder)
        self._listed |= folders
        self._there |= {
            file.state for file in new if sizes.get(file.name) == file.path.stat().st_size
        }


def files_below(root: Path, *folders: str) -> list[Artifact]:
    """The files below folders of `root`, hidden ones (half-written) apart, with their places."""
    return [
        Artifact(path, path.parent.relative_to(root).as_posix())
        for folder in folders
        for path in sorted((root / folder).rglob("*"))
        if path.is_file() and path.name[0] != "."
    ]


def _artifact_sizes(client: MlflowClient, run_id: str, folder: str) -> dict[str, int]:
    """Sizes in bytes of the artifacts below `folder`, by path."""
    sizes: dict[str, int] = {}
    for item in client.list_artifacts(run_id, folder):
        if item.is_dir:
            sizes |= _artifact_sizes(client, run_id, item.path)
        else:
            sizes[item.path] = item.file_size or 0
    return sizes


def _digest(records: Sequence[Artifact]) -> str:
    digest = hashlib.sha256()
    for record in records:
        content = record.path.read_bytes()
        digest.update(f"{record.name}\n{len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]


def file_state(path: Path) -> tuple[str, int, int]:
    """Name, size and time of a file."""
    status = path.stat()
    return str(path), status.st_size, status.st_mtime_ns


# --- time and turns --------------------------------------------------------------------------
def milliseconds(iso_time: str) -> int:
    """Unix milliseconds, MLflow's unit of time."""
    return int(datetime.fromisoformat(iso_time).timestamp() * 1000)


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Hold off other processes that bring this folder over: two could both make it in MLflow.

    Raises:
        TrackingUnavailable: another one still does after LOCK_WAIT_S.
    """
    lock = filelock.FileLock(folder / "sync.lock")
    try:
        lock.acquire(timeout=LOCK_WAIT_S)
    except filelock.Timeout:
        raise TrackingUnavailable(f"another process is bringing {folder} over") from None
    except OSError:  # on read-only media; nobody mirrors it live
        yield
        return
    try:
        yield
    finally:
        lock.release()
