"""Bringing a run directory into MLflow, once however often it is tried.

What makes it repeatable: the MLflow run is found by the tag
`tlr_exp.run_id`; every line of metrics is logged together with the metric "iteration" in one call,
which the store commits as one transaction, so that the latest "iteration" in the store says which
lines are there; a line that is logged again all the same has the same time stamp and value, and
the store drops it. After a resume the lines past the checkpoint are written anew: the store keeps
those it has, as it cannot take points back.

A finished run gets its final numbers (tlr_exp.records.final_metrics), its best and its last
checkpoint besides. A run that failed or was interrupted can go on, so it gets neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tlr_exp.keys import ITERATION
from tlr_exp.mlflow_sync.mirror import MAX_FILE_MB
from tlr_exp.mlflow_sync.names import (
    BEST_CHECKPOINT_TAG,
    FINAL_CHECKPOINT_TAG,
    RUN_ID_TAG,
    flat_parameters,
    mlflow_status,
    plain_name,
    run_tags,
)
from tlr_exp.mlflow_sync.push import (
    MAX_METRICS,
    Artifact,
    ArtifactUpload,
    file_state,
    files_below,
    find_by_tag,
    log_changed_metrics,
    log_parameters,
    milliseconds,
    one_at_a_time,
    set_status,
    set_tags,
)
from tlr_exp.mlflow_sync.store import (
    Metric,
    MlflowClient,
    Run,
    experiment_id,
    open_client,
    tracking_errors,
)
from tlr_exp.mlflow_sync.sweep_links import Parent, link_tags
from tlr_exp.records.checkpoint_files import (
    CHECKPOINTS,
    best_iteration,
    checkpoint_iterations,
    checkpoint_path,
)
from tlr_exp.records.final_metrics import final_metrics
from tlr_exp.records.metrics_file import WALL_TIME, last_of_each_iteration, read_metrics
from tlr_exp.records.run_directory import (
    CONFIG,
    EVALUATIONS,
    FINISHED,
    INTERRUPTED,
    MANIFEST,
    RUNNING,
    RunDirectory,
)


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


def sync_run(
    run: RunDirectory | str | Path,
    tracking_uri: str,
    experiment: str,
    max_file_mb: float = MAX_FILE_MB,
) -> SyncReport:
    """Bring what `tracking_uri` lacks of a run into it; a second call adds nothing.

    A run that the store has already, in whatever experiment, stays there; a new one goes to
    `experiment`, which is made if need be. Checkpoints and evaluations larger than `max_file_mb`
    stay where they are, and are named in the notes.

    Raises:
        TrackingUnavailable: the store cannot be reached or written now.
        TrackingError: MLflow refuses something for good.
        ValueError: not a run directory, or a damaged one.
    """
    run = run if isinstance(run, RunDirectory) else RunDirectory.open(run)
    return RunUpload(run, tracking_uri, experiment, max_file_mb=max_file_mb).push()


class RunUpload:
    """One run directory on its way into one store; `push` again as the run grows."""

    def __init__(
        self,
        run: RunDirectory,
        tracking_uri: str,
        experiment: str,
        parent: Parent | None = None,
        max_file_mb: float = MAX_FILE_MB,
    ) -> None:
        self._run, self._uri, self._experiment = run, tracking_uri, experiment
        self._parent, self._max_file_mb = parent, max_file_mb
        self._client: MlflowClient | None = None
        self._read_until = (0, 0)  # inode of metrics.jsonl and the offset brought over
        self._artifacts = ArtifactUpload()
        self._parameters: tuple[object, dict[str, str]] | None = None
        self._pushed: tuple[object, SyncReport] | None = None

    def push(self) -> SyncReport:
        """Bring over what is new; nothing is asked of the store while the run has not changed.

        Raises as `sync_run`.
        """
        with tracking_errors(self._uri), one_at_a_time(self._run.path):
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
        # Checkpoints come with a new manifest, which says that the run has finished.
        files = [self._run.path / CONFIG, self._run.path / MANIFEST]
        return (
            [file_state(path) for path in files],
            [file.state for file in files_below(self._run.path, EVALUATIONS)],
            file_state(metrics) if metrics.exists() else None,
            self._run.is_live(),
        )

    def _push(self, client: MlflowClient) -> SyncReport:
        manifest = self._run.manifest
        dead = manifest["status"] == RUNNING and not self._run.is_live()
        status = INTERRUPTED if dead else manifest["status"]
        run, created = self._find_or_create(client, manifest)
        notes = log_parameters(client, run, self._flat_config())
        tags = run_tags(manifest, status)
        if status == FINISHED:
            kept = self._kept_checkpoints().items()
            tags |= {tag: f"{CHECKPOINTS}/{path.name}" for tag, path in kept}
        if self._parent is not None:
            tags |= link_tags(client, run, self._parent)
        set_tags(client, run, tags)
        iterations, points = self._log_metrics(client, run)
        if status == FINISHED:
            points += self._log_final(client, run)
        files, too_large = self._files(status)
        number = self._artifacts.push(client, run, self._records(), files)
        set_status(client, run, mlflow_status(status), self._ended_ms(manifest))
        return SyncReport(
            manifest["name"],
            run.info.run_id,
            created,
            iterations,
            points,
            number,
            mlflow_status(status),
            (*notes, *too_large),
        )

    def _flat_config(self) -> dict[str, str]:
        state = file_state(self._run.path / CONFIG)
        if self._parameters is None or self._parameters[0] != state:  # YAML is slow to parse
            self._parameters = (state, flat_parameters(self._run.config))
        return self._parameters[1]

    def _find_or_create(self, client: MlflowClient, manifest: dict[str, Any]) -> tuple[Run, bool]:
        if found := find_by_tag(client, RUN_ID_TAG, manifest["run_id"]):
            return found, False
        run = client.create_run(
            experiment_id(client, self._experiment, self._uri),
            start_time=milliseconds(manifest["created_at"]),
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

    def _log_final(self, client: MlflowClient, run: Run) -> int:
        rows = self._run.metrics()
        if not rows:
            return 0
        step, time_ms = rows[-1][ITERATION], int(rows[-1][WALL_TIME] * 1000)
        return log_changed_metrics(client, run, final_metrics(rows), step, time_ms)

    def _records(self) -> list[Artifact]:
        return [Artifact(self._run.path / CONFIG), Artifact(self._run.path / MANIFEST)]

    def _files(self, status: str) -> tuple[list[Artifact], list[str]]:
        """Evaluations; of a finished run what evaluates it; and what is said of those too large."""
        files = files_below(self._run.path, EVALUATIONS)
        if status == FINISHED:
            paths = dict.fromkeys(self._kept_checkpoints().values())  # the best is often the last
            files += [Artifact(path, CHECKPOINTS) for path in paths]
            files += [Artifact(path) for path in [self._run.motion_path] if path.exists()]
        limit = self._max_file_mb * 1e6
        notes = [
            f"{file.name} stays in the run directory: {file.path.stat().st_size / 1e6:.1f} MB, "
            f"the limit is {self._max_file_mb:g} MB"
            for file in files
            if file.path.stat().st_size > limit
        ]
        return [file for file in files if file.path.stat().st_size <= limit], notes

    def _kept_checkpoints(self) -> dict[str, Path]:
        """The files of the best and the final checkpoint, by the tags that name them."""
        folder = self._run.path / CHECKPOINTS
        iterations = checkpoint_iterations(folder)
        chosen = {
            BEST_CHECKPOINT_TAG: best_iteration(folder),
            FINAL_CHECKPOINT_TAG: iterations[-1] if iterations else None,
        }
        return {tag: checkpoint_path(folder, at) for tag, at in chosen.items() if at is not None}

    def _ended_ms(self, manifest: dict[str, Any]) -> int:
        ended = milliseconds(manifest["updated_at"])
        if self._run.metrics_path.exists():  # of a killed run the last line is the latest sign
            ended = max(ended, int(self._run.metrics_path.stat().st_mtime * 1000))
        return ended


# --- parts of a push -------------------------------------------------------------------------
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


def _inode(path: Path) -> int:
    return path.stat().st_ino if path.exists() else 0
