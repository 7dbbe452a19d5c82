"""Bringing a sweep into MLflow, once however often it is tried: a parent run, its runs as children.

The parent is found by the tag `tlr_exp.sweep_run_id`. Children appear as jobs begin; one whose run
directory is not here is linked if MLflow has it. The parent's status follows the lock of the sweep,
so that it never stays RUNNING: whoever brings it over after a kill sets it to KILLED.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

from tlr_exp.mlflow_sync.mirror import MAX_FILE_MB
from tlr_exp.mlflow_sync.names import RUN_ID_TAG, mlflow_status
from tlr_exp.mlflow_sync.push import (
    Artifact,
    ArtifactUpload,
    files_below,
    find_by_tag,
    log_changed_metrics,
    log_parameters,
    milliseconds,
    one_at_a_time,
    set_status,
    set_tags,
)
from tlr_exp.mlflow_sync.run import RunUpload, SyncReport
from tlr_exp.mlflow_sync.store import (
    MlflowClient,
    Run,
    TrackingError,
    TrackingUnavailable,
    experiment_id,
    open_client,
    tracking_errors,
)
from tlr_exp.mlflow_sync.sweep_links import Parent, link_tags
from tlr_exp.mlflow_sync.sweep_page import (
    NOTE_TAG,
    SWEEP_ID_TAG,
    JobView,
    progress,
    sweep_name,
    sweep_note,
    sweep_parameters,
    sweep_tags,
)
from tlr_exp.records.run_directory import (
    FAILED,
    FINISHED,
    INTERRUPTED,
    MANIFEST,
    RunDirectory,
    RunDirectoryError,
)
from tlr_exp.records.sweep_directory import (
    CANCELLED,
    FIGURES,
    REPORT,
    SWEEP,
    JobRecord,
    SweepDirectory,
)


@dataclass(frozen=True)
class SweepReport:
    """What one call brought over of a sweep; `problems` names runs that MLflow has not got."""

    name: str
    mlflow_run_id: str
    created: bool
    status: str
    files: int
    runs: tuple[SyncReport, ...]
    problems: tuple[str, ...]


def sync_sweep(
    sweep: SweepDirectory, tracking_uri: str, experiment: str, max_file_mb: float = MAX_FILE_MB
) -> SweepReport:
    """Bring what `tracking_uri` lacks of a sweep and of its runs into it.

    Raises as `SweepUpload.push`.
    """
    return SweepUpload(sweep, tracking_uri, experiment, max_file_mb).push()


class SweepUpload:
    """One sweep directory on its way into one store; `push` again as the sweep goes on."""

    def __init__(
        self,
        sweep: SweepDirectory,
        tracking_uri: str,
        experiment: str,
        max_file_mb: float = MAX_FILE_MB,
    ) -> None:
        self._sweep, self._uri, self._experiment = sweep, tracking_uri, experiment
        self._max_file_mb = max_file_mb
        self._client: MlflowClient | None = None
        self._parent: Run | None = None
        self._runs: dict[str, RunUpload] = {}  # by run id
        self._elsewhere: dict[str, str] = {}  # run id -> MLflow's id, of runs that are not here
        self._artifacts = ArtifactUpload()
        self._pushed: tuple[object, SweepReport] | None = None

    def push(self) -> SweepReport:
        """Bring over what is new of the sweep and of its runs.

        A run that MLflow refuses, or that is damaged, is among the problems and keeps nothing back.

        Raises:
            TrackingUnavailable: the store cannot be reached or written now.
            TrackingError: MLflow refuses the sweep for good.
            ValueError: the sweep directory is damaged.
        """
        with tracking_errors(self._uri), one_at_a_time(self._sweep.path):
            self._client = self._client or open_client(self._uri)
            jobs = self._sweep.jobs()
            created = self._find_or_create(self._client, jobs)
            runs, problems = self._push_runs(self._client, jobs)
            known = {run_id: report.mlflow_run_id for run_id, report in runs.items()}
            views = self._views(jobs, {**self._elsewhere, **known})
            state = self._state(views)
            if self._pushed is None or self._pushed[0] != state:
                self._pushed = (state, self._push_parent(self._client, views))
            report = self._pushed[1]
            self._pushed = (state, replace(report, files=0))
        return replace(report, created=created, runs=tuple(runs.values()), problems=problems)

    def is_known(self) -> bool:
        """Whether the store has this sweep.

        Raises:
            TrackingUnavailable: the store cannot be reached now.
            ValueError: the sweep directory is damaged.
        """
        with tracking_errors(self._uri):
            self._client = self._client or open_client(self._uri)
            record = self._sweep.record
            return find_by_tag(self._client, SWEEP_ID_TAG, record["run_id"]) is not None

    # --- runs --------------------------------------------------------------------------------
    def _push_runs(
        self, client: MlflowClient, jobs: list[JobRecord]
    ) -> tuple[dict[str, SyncReport], tuple[str, ...]]:
        """What was brought over, by run id; and what could not be."""
        reports: dict[str, SyncReport] = {}
        problems = []
        for job in jobs:
            if job.run_id is None:
                continue
            try:
                if upload := self._upload_of(job):
                    reports[job.run_id] = upload.push()
                elif job.run_id not in self._elsewhere:
                    self._link(client, job.run_id)
            except TrackingUnavailable:
                raise
            except (TrackingError, ValueError) as error:
                problems.append(f"{job.run}: {error}")
        return reports, tuple(problems)

    def _upload_of(self, job: JobRecord) -> RunUpload | None:
        """The upload of a job's run; None where its directory is not here, or is another run's."""
        assert job.run_id is not None
        if job.run_id not in self._runs:
            run = self._run_of(job)
            if run is None or run.manifest["run_id"] != job.run_id:
                return None
            self._runs[job.run_id] = RunUpload(
                run, self._uri, self._experiment, self._link_target(), self._max_file_mb
            )
        return self._runs[job.run_id]

    def _run_of(self, job: JobRecord) -> RunDirectory | None:
        path = self._sweep.study_folder / (job.run or "")
        return RunDirectory(path) if job.run and (path / MANIFEST).is_file() else None

    def _link(self, client: MlflowClient, run_id: str) -> None:
        """Link a run that MLflow has from elsewhere."""
        if found := find_by_tag(client, RUN_ID_TAG, run_id):
            set_tags(client, found, link_tags(client, found, self._link_target()))
            self._elsewhere[run_id] = found.info.run_id

    def _link_target(self) -> Parent:
        assert self._parent is not None
        return Parent(self._parent.info.run_id, self._sweep.path.name)

    def _views(self, jobs: list[JobRecord], mlflow_ids: dict[str, str]) -> list[JobView]:
        live = self._sweep.is_live()
        views = []
        for job in jobs:
            run = self._run_of(job)
            manifest = None
            if run is not None:
                try:
                    manifest = run.manifest
                except RunDirectoryError:  # is among the problems
                    run = None
            alive = live or (run is not None and run.is_live())
            dead = job.status not in (FINISHED, FAILED, CANCELLED) and not alive
            found = mlflow_ids.get(job.run_id or "")
            views.append(JobView(job, INTERRUPTED if dead else job.status, manifest, found))
        return views

    # --- the sweep itself --------------------------------------------------------------------
    def _state(self, views: list[JobView]) -> object:
        """Differs whenever there may be something to bring over of the sweep itself."""
        return (
            [file.state for file in self._records()],
            self._sweep.is_live(),
            [(view.record, view.status, view.mlflow_run_id) for view in views],
        )

    def _records(self) -> list[Artifact]:
        return [Artifact(self._sweep.path / SWEEP), *files_below(self._sweep.path, REPORT, FIGURES)]

    def _find_or_create(self, client: MlflowClient, jobs: list[JobRecord]) -> bool:
        """Find or make the parent, unless this process knows it; whether it was made."""
        if self._parent is not None:
            return False
        record = self._sweep.record
        self._parent = find_by_tag(client, SWEEP_ID_TAG, record["run_id"])
        if self._parent is not None:
            return False
        self._parent = client.create_run(
            experiment_id(client, self._experiment, self._uri),
            start_time=milliseconds(record["created_at"]),
            tags={SWEEP_ID_TAG: record["run_id"]},
            run_name=sweep_name(record, self._views(jobs, {})),
        )
        return True

    def _push_parent(self, client: MlflowClient, views: list[JobView]) -> SweepReport:
        record, status = self._sweep.record, self._sweep.status
        assert self._parent is not None
        run = self._parent = client.get_run(self._parent.info.run_id)
        name = sweep_name(record, views)
        note = sweep_note(record, views, run.info.experiment_id, str(self._sweep.path))
        log_parameters(client, run, sweep_parameters(record))
        set_tags(client, run, {**sweep_tags(record, views, status), NOTE_TAG: note})
        if run.info.run_name != name:
            client.update_run(run.info.run_id, name=name)
        metrics = progress(record, views)
        ended = sum(view.status in (FINISHED, FAILED) for view in views)
        log_changed_metrics(client, run, metrics, ended, int(time.time() * 1000))
        files = self._artifacts.push(client, run, self._records())
        set_status(client, run, mlflow_status(status), _ended_ms(record, views))
        return SweepReport(name, run.info.run_id, False, mlflow_status(status), files, (), ())


def _ended_ms(record: dict[str, Any], views: list[JobView]) -> int:
    """The latest sign of life in the records, in Unix milliseconds."""
    times = [record["updated_at"], *(view.record.updated_at for view in views)]
    return max(milliseconds(text) for text in times)
