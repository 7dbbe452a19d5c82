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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tlr_exp.keys import ITERATION
from tlr_exp.mlflow_sync.artifacts import Artifact, files_below
from tlr_exp.mlflow_sync.names import (
    BEST_CHECKPOINT_TAG,
    FINAL_CHECKPOINT_TAG,
    RUN_ID_TAG,
    flat_parameters,
    mlflow_status,
    plain_name,
    run_tags,
)
from tlr_exp.mlflow_sync.sources import MAX_FILE_MB
from tlr_exp.mlflow_sync.store import Metric, Run
from tlr_exp.mlflow_sync.sweep_links import Parent, link_tags
from tlr_exp.mlflow_sync.upload import (
    MAX_METRICS,
    Report,
    Upload,
    log_changed_metrics,
    log_parameters,
    milliseconds,
    set_status,
    set_tags,
)
from tlr_exp.records.checkpoint_files import (
    CHECKPOINTS,
    best_iteration,
    checkpoint_iterations,
    checkpoint_path,
)
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.final_metrics import final_metrics
from tlr_exp.records.metrics_file import WALL_TIME, last_of_each_iteration, read_metrics
from tlr_exp.records.run_directory import CONFIG, EVALUATIONS, RunDirectory
from tlr_exp.records.storage import file_state, while_unchanged


@dataclass(frozen=True, kw_only=True)
class RunReport(Report):
    """What one push brought over of a run: numbers of iterations, points and files."""

    iterations: int
    points: int
    notes: tuple[str, ...] = ()

    def lines(self, where: str) -> list[str]:
        new = "new run, " if self.created else ""
        what = f"{self.iterations} iterations ({self.points} points), {self.files} files"
        notes = [f"  note: {note}" for note in self.notes]
        return [f"{self.name}: {new}{what}, {self.status} -> {where}", *notes]


class RunUpload(Upload[RunReport]):
    """One run directory on its way into one store; `push` again as the run grows.

    Checkpoints and evaluations larger than `max_file_mb` stay where they are, and are named in the
    notes of the report. `parent` is the sweep that the run belongs to.
    """

    id_tag = RUN_ID_TAG

    def __init__(
        self,
        run: RunDirectory,
        tracking_uri: str,
        experiment: str,
        max_file_mb: float = MAX_FILE_MB,
        parent: Parent | None = None,
    ) -> None:
        super().__init__(run, tracking_uri, experiment, max_file_mb)
        self._run, self._parent = run, parent
        self._read_until = (0, 0)  # inode of metrics.jsonl and the offset brought over
        # YAML is slow to parse.
        self._parameters = while_unchanged(lambda _: flat_parameters(run.config))
        self._pushed: tuple[object, RunReport] | None = None

    def mend_others(self) -> None:
        """Nothing: a run that was killed with its mirror comes over with its sweep."""

    def _push(self) -> RunReport:
        """Nothing is asked of the store while the run has not changed."""
        state = self._state()
        if self._pushed is not None and self._pushed[0] == state:
            return replace(self._pushed[1], created=False, iterations=0, points=0, files=0)
        report = self._push_changes()
        self._pushed = (state, report)
        return report

    def _new_name(self) -> str:
        return self._run.manifest["name"]

    def _state(self) -> object:
        """Differs whenever there may be something to bring over."""
        metrics = self._run.metrics_path
        # Checkpoints come with a new manifest, which says that the run has finished.
        files = [self._run.path / CONFIG, self._run.manifest_path]
        return (
            [file_state(path) for path in files],
            [file.state for file in files_below(self._run.path, EVALUATIONS)],
            file_state(metrics) if metrics.exists() else None,
            self._run.is_live(),
        )

    def _push_changes(self) -> RunReport:
        manifest, status, client = self._run.manifest, self._run.status, self._client
        run, created = self._find_or_create()
        notes = log_parameters(client, run, self._parameters(self._run.path / CONFIG))
        tags = run_tags(manifest, status)
        if status == FINISHED:
            kept = self._kept_checkpoints().items()
            tags |= {tag: f"{CHECKPOINTS}/{path.name}" for tag, path in kept}
        if self._parent is not None:
            tags |= link_tags(client, run, self._parent)
        set_tags(client, run, tags)
        iterations, points = self._log_metrics(run)
        if status == FINISHED:
            points += self._log_final(run)
        files, too_large = self._files(status)
        number = self._artifacts.push(client, run, self._records(), files)
        set_status(client, run, mlflow_status(status), self._ended_ms(manifest))
        return RunReport(
            name=manifest["name"],
            mlflow_run_id=run.info.run_id,
            created=created,
            iterations=iterations,
            points=points,
            files=number,
            status=mlflow_status(status),
            notes=(*notes, *too_large),
        )

    def _log_metrics(self, run: Run) -> tuple[int, int]:
        """Log the lines past the last one in the store; the numbers of lines and of points."""
        inode, offset = self._read_until
        now = _inode(self._run.metrics_path)
        rows, offset = read_metrics(self._run.metrics_path, offset if now == inode else 0)
        last = run.data.metrics.get(ITERATION, -1)
        rows = [row for row in last_of_each_iteration(rows) if row[ITERATION] > last]
        points = 0
        for batch in _batches(rows):
            self._client.log_batch(run.info.run_id, metrics=batch)
            points += len(batch)
        self._read_until = (now, offset)
        return len(rows), points

    def _log_final(self, run: Run) -> int:
        rows = self._run.metrics()
        if not rows:
            return 0
        step, time_ms = rows[-1][ITERATION], int(rows[-1][WALL_TIME] * 1000)
        return log_changed_metrics(self._client, run, final_metrics(rows), step, time_ms)

    def _records(self) -> list[Artifact]:
        return [Artifact(self._run.path / CONFIG), Artifact(self._run.manifest_path)]

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
