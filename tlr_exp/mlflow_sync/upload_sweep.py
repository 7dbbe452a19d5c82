"""Bringing a sweep into MLflow, once however often it is tried: a parent run, its runs as children.

The parent is found by the tag `tlr_exp.sweep_run_id`. Children appear as jobs begin; one whose run
directory is not here is linked if MLflow has it. The parent's status follows the lock of the sweep,
so that it never stays RUNNING: whoever brings it over after a kill sets it to KILLED.
"""

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from tlr_exp.mlflow_sync.artifacts import Artifact, files_below
from tlr_exp.mlflow_sync.names import RUN_ID_TAG, mlflow_status
from tlr_exp.mlflow_sync.sources import MAX_FILE_MB
from tlr_exp.mlflow_sync.store import Run, TrackingUnavailable
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
from tlr_exp.mlflow_sync.upload import (
    Report,
    Upload,
    find_by_tag,
    log_changed_metrics,
    log_parameters,
    milliseconds,
    set_status,
    set_tags,
)
from tlr_exp.mlflow_sync.upload_run import RunReport, RunUpload
from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING, RecordError
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import (
    CANCELLED,
    FIGURES,
    REPORT,
    JobRecord,
    SweepDirectory,
)


@dataclass(frozen=True, kw_only=True)
class SweepReport(Report):
    """What one push brought over of a sweep; `problems` names runs that MLflow has not got."""

    runs: tuple[RunReport, ...] = ()

    def lines(self, where: str) -> list[str]:
        new = "new sweep, " if self.created else ""
        what = f"{new}{len(self.runs)} runs, {self.files} files"
        runs = [f"  {line}" for run in self.runs for line in run.lines(where)]
        return [f"{self.name}: {what}, {self.status} -> {where}", *runs]


class SweepUpload(Upload[SweepReport]):
    """One sweep directory on its way into one store; `push` again as the sweep goes on.

    A run that MLflow refuses, or that is damaged, is among the problems of the report and keeps
    nothing back.
    """

    id_tag = SWEEP_ID_TAG

    def __init__(
        self,
        sweep: SweepDirectory,
        tracking_uri: str,
        experiment: str,
        max_file_mb: float = MAX_FILE_MB,
    ) -> None:
        super().__init__(sweep, tracking_uri, experiment, max_file_mb)
        self._sweep = sweep
        self._parent: Run | None = None
        self._runs: dict[str, RunUpload] = {}  # by run id
        self._elsewhere: dict[str, str] = {}  # run id -> MLflow's id, of runs that are not here
        self._pushed: tuple[object, SweepReport] | None = None

    def _push(self) -> SweepReport:
        created, jobs = False, self._sweep.jobs()
        if self._parent is None:
            self._parent, created = self._find_or_create()
        runs, problems = self._push_runs(jobs)
        known = {run_id: report.mlflow_run_id for run_id, report in runs.items()}
        views = self._views(jobs, {**self._elsewhere, **known})
        state = self._state(views)
        if self._pushed is None or self._pushed[0] != state:
            self._pushed = (state, self._push_parent(self._parent.info.run_id, views))
        report = self._pushed[1]
        self._pushed = (state, replace(report, files=0))
        return replace(report, created=created, runs=tuple(runs.values()), problems=problems)

    def _new_name(self) -> str:
        return sweep_name(self._sweep.manifest, self._views(self._sweep.jobs(), {}))

    def mend_others(self) -> None:
        """Bring over what became of other sweeps of the study that were killed with their mirror.

        Otherwise MLflow would say that they run until someone calls tlr-sync.

        Raises as `push`.
        """
        for sweep in SweepDirectory.find(self._sweep.path.parent):
            with suppress(RecordError):  # damaged, and not what this upload is for
                if sweep.path == self._sweep.path or sweep.is_live():
                    continue
                upload = SweepUpload(sweep, self._uri, self._experiment, self._max_file_mb)
                if sweep.manifest["status"] == RUNNING and upload.is_known():
                    upload.push()

    # --- runs --------------------------------------------------------------------------------
    def _push_runs(self, jobs: list[JobRecord]) -> tuple[dict[str, RunReport], tuple[str, ...]]:
        """What was brought over, by run id; and what could not be."""
        reports: dict[str, RunReport] = {}
        problems = []
        for job in jobs:
            if job.run_id is None:
                continue
            try:
                if upload := self._upload_of(job):
                    reports[job.run_id] = upload.push()
                elif job.run_id not in self._elsewhere:
                    self._link(job.run_id)
            except TrackingUnavailable:
                raise
            except ValueError as error:
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
                run, self._uri, self._experiment, self._max_file_mb, self._link_target()
            )
        return self._runs[job.run_id]

    def _run_of(self, job: JobRecord) -> RunDirectory | None:
        run = RunDirectory(self._sweep.study_folder / (job.run or ""))
        return run if job.run and run.manifest_path.is_file() else None

    def _link(self, run_id: str) -> None:
        """Link a run that MLflow has from elsewhere."""
        if found := find_by_tag(self._client, RUN_ID_TAG, run_id):
            set_tags(self._client, found, link_tags(self._client, found, self._link_target()))
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
                except RecordError:  # is among the problems
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
        return [
            Artifact(self._sweep.manifest_path),
            *files_below(self._sweep.path, REPORT, FIGURES),
        ]

    def _push_parent(self, mlflow_run_id: str, views: list[JobView]) -> SweepReport:
        manifest, status, client = self._sweep.manifest, self._sweep.status, self._client
        run = client.get_run(mlflow_run_id)
        name = sweep_name(manifest, views)
        note = sweep_note(manifest, views, run.info.experiment_id, str(self._sweep.path))
        log_parameters(client, run, sweep_parameters(manifest))
        set_tags(client, run, {**sweep_tags(manifest, views, status), NOTE_TAG: note})
        if run.info.run_name != name:
            client.update_run(mlflow_run_id, name=name)
        metrics = progress(manifest, views)
        ended = sum(view.status in (FINISHED, FAILED) for view in views)
        log_changed_metrics(client, run, metrics, ended, int(time.time() * 1000))
        files = self._artifacts.push(client, run, self._records())
        set_status(client, run, mlflow_status(status), _ended_ms(manifest, views))
        return SweepReport(
            name=name,
            mlflow_run_id=mlflow_run_id,
            created=False,
            files=files,
            status=mlflow_status(status),
        )


def _ended_ms(manifest: Mapping[str, Any], views: list[JobView]) -> int:
    """The latest sign of life in the records, in Unix milliseconds."""
    times = [manifest["updated_at"], *(view.record.updated_at for view in views)]
    return max(milliseconds(text) for text in times)
