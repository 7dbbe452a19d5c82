"""Bringing something into MLflow: what runs and sweeps share of it, each part repeatable."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

from tlr_exp.mlflow_sync.artifacts import ArtifactUpload
from tlr_exp.mlflow_sync.sources import MAX_FILE_MB
from tlr_exp.mlflow_sync.store import (
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
from tlr_exp.records.directory import RecordDirectory
from tlr_exp.records.locks import hold_where_possible

LOCK_WAIT_S = 60.0  # for another process that brings the same folder over
MAX_METRICS, MAX_PARAMETERS = 1000, 100  # of one log_batch call, MLflow's limits


@dataclass(frozen=True, kw_only=True)
class Report:
    """What one push brought over: numbers of new things, and the state in MLflow.

    problems: what MLflow has not got, and why.
    """

    name: str
    mlflow_run_id: str
    created: bool
    files: int
    status: str
    problems: tuple[str, ...] = ()

    def lines(self, where: str) -> list[str]:
        """What was brought over, for a person; `where` names the store."""
        raise NotImplementedError


ReportType = TypeVar("ReportType", bound=Report)


class Upload(ABC, Generic[ReportType]):
    """A run or a sweep on its way into one store; `push` again as it goes on."""

    id_tag: ClassVar[str]  # by which MLflow's run is found; its value is the run_id of the manifest

    def __init__(
        self,
        folder: RecordDirectory,
        tracking_uri: str,
        experiment: str,
        max_file_mb: float = MAX_FILE_MB,
    ) -> None:
        self._folder, self._uri, self._experiment = folder, tracking_uri, experiment
        self._max_file_mb = max_file_mb
        self._opened: MlflowClient | None = None
        self._artifacts = ArtifactUpload()

    def push(self) -> ReportType:
        """Bring what the store lacks into it; a second call adds nothing.

        What the store has already, in whatever experiment, stays there; a new run goes to the
        experiment, which is made if need be.

        Raises:
            TrackingUnavailable: the store cannot be reached or written now.
            TrackingError: MLflow refuses something for good.
            ValueError: the directory is damaged.
        """
        with tracking_errors(self._uri), one_at_a_time(self._folder.path):
            return self._push()

    def is_known(self) -> bool:
        """Whether the store has it.

        Raises:
            TrackingUnavailable: the store cannot be reached now.
            RecordError: the directory is damaged.
        """
        with tracking_errors(self._uri):
            return self._find() is not None

    @abstractmethod
    def mend_others(self) -> None:
        """Bring over what others have left behind.

        Raises as `push`.
        """

    @abstractmethod
    def _push(self) -> ReportType:
        """What `push` does in its turn."""

    @abstractmethod
    def _new_name(self) -> str:
        """What to call it in MLflow."""

    @property
    def _client(self) -> MlflowClient:
        """Opened when it is first needed."""
        if self._opened is None:
            self._opened = open_client(self._uri)
        return self._opened

    def _find(self) -> Run | None:
        return find_by_tag(self._client, self.id_tag, self._folder.manifest["run_id"])

    def _find_or_create(self) -> tuple[Run, bool]:
        """MLflow's run, and whether it was made now."""
        if found := self._find():
            return found, False
        manifest = self._folder.manifest
        run = self._client.create_run(
            experiment_id(self._client, self._experiment, self._uri),
            start_time=milliseconds(manifest["created_at"]),
            tags={self.id_tag: manifest["run_id"]},
            run_name=self._new_name(),
        )
        return run, True


# --- parts of a push -------------------------------------------------------------------------
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


def milliseconds(iso_time: str) -> int:
    """Unix milliseconds, MLflow's unit of time."""
    return int(datetime.fromisoformat(iso_time).timestamp() * 1000)


def one_at_a_time(folder: Path) -> AbstractContextManager[None]:
    """Hold off other processes that bring this folder over: two could both make it in MLflow.

    Raises:
        TrackingUnavailable: another one still does after LOCK_WAIT_S.
    """

    def in_use() -> TrackingUnavailable:
        return TrackingUnavailable(f"another process is copying {folder}")

    return hold_where_possible(folder / "sync.lock", in_use, LOCK_WAIT_S)
