"""The sweep directory: what a sweep says about itself and its jobs.

It lies at runs_dir/study/sweeps/NAME-ID/; the runs of its jobs lie in runs_dir/study/, because
several sweeps can share a run.

sweep.json    id, status, command, number of jobs (see `begin`)
jobs/NUM.json one per job, written by the job at each change (see `JobRecord`)
sweep.lock    held by the process of the sweep; "running" without it means killed
report/, figures/   what was made of the sweep; copied to its MLflow run
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from tlr_exp.records.directory import (
    RUNNING,
    STATUSES,
    SWEEP,
    RecordDirectory,
    RecordError,
    read_record,
    require_status,
    this_process,
    utc_now,
)
from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import atomic_write, json_bytes, storage_errors, while_unchanged

SWEEPS, JOBS, SWEEP_LOCK = "sweeps", "jobs", "sweep.lock"
REPORT, FIGURES = "report", "figures"

WAITING, CANCELLED = "waiting", "cancelled"  # cancelled: taken out of a cluster's queue
JOB_STATUSES = (WAITING, *STATUSES, CANCELLED)


class SweepDirectoryError(RecordError):
    """A path is no (usable) sweep directory, or is in use; the message says what would be right."""


@dataclass(frozen=True)
class JobRecord:
    """One job of a sweep: `run` names its directory beside the sweeps, `run_id` its manifest's."""

    num: int
    overrides: tuple[str, ...]
    run: str | None
    run_id: str | None
    status: str
    error: str | None
    created_at: str
    updated_at: str
    pid: int
    host: str


class SweepDirectory(RecordDirectory):
    """One sweep on disk. Only the holder of `lock` may call `begin` and `set_status`.

    Each job writes its own record, by `SweepDirectory(path).write_job(...)`.
    """

    noun, manifest_name, lock_name = "sweep", SWEEP, SWEEP_LOCK
    layout = f"{SWEEP} and {JOBS}/"
    required = frozenset({"sweep_id", "run_id", "name", "study", "status", "num_jobs"})
    error = in_use_error = SweepDirectoryError
    when_in_use = "wait for it or stop it"

    @classmethod
    def prepare(cls, study_folder: str | Path, name: str, sweep_id: str) -> SweepDirectory:
        """Make STUDY_FOLDER/sweeps/NAME-ID, or take the one that is there; then `lock`, `begin`.

        Raises:
            SweepDirectoryError: `name` or `sweep_id` cannot be part of a folder name.
            StorageError: the folder cannot be made.
        """
        if not re.fullmatch(r"\w[\w.-]*", name):
            raise SweepDirectoryError(
                f"sweep name {name!r}: must be letters, digits, '_', '.', '-'"
            )
        if not re.fullmatch(r"[0-9a-f]{8}", sweep_id):
            raise SweepDirectoryError(f"sweep id {sweep_id!r}: must be 8 hexadecimal digits")
        path = Path(study_folder).absolute() / SWEEPS / f"{name}-{sweep_id}"
        with storage_errors(f"cannot make the sweep directory {path}", ELSEWHERE):
            (path / JOBS).mkdir(parents=True, exist_ok=True)
        return cls(path)

    # --- the sweep ---------------------------------------------------------------------------
    @property
    def study_folder(self) -> Path:
        """The folder of the jobs' runs: runs_dir/study."""
        return self.path.parents[1]

    @property
    def study(self) -> str:
        """The name of its study."""
        return self.manifest["study"]

    def begin(
        self,
        command: str,
        num_jobs: int,
        description: str = "",
        tags: Mapping[str, str] | None = None,
    ) -> None:
        """Write sweep.json as running in this process; a sweep that is continued keeps its ids.

        `tags` are labels to find the sweep by in MLflow, such as scale.

        Raises:
            SweepDirectoryError: a sweep.json is there and is damaged.
            StorageError: it cannot be written; the old one stays.
        """
        before = self.manifest if self.manifest_path.exists() else {}
        name, _, sweep_id = self.path.name.rpartition("-")
        self._write_manifest(
            {
                "sweep_id": sweep_id,
                "run_id": before.get("run_id") or str(uuid.uuid4()),
                "name": name,
                "study": self.study_folder.name,
                "status": RUNNING,
                "command": command,
                "created_at": before.get("created_at") or utc_now(),
                **this_process(),
                "num_jobs": num_jobs,
                "description": description,
                "tags": dict(tags or {}),
            }
        )

    # --- jobs --------------------------------------------------------------------------------
    def job_path(self, num: int) -> Path:
        """The path of the record of job `num`, whether or not it exists."""
        return self.path / JOBS / f"{num}.json"

    def jobs(self) -> list[JobRecord]:
        """The records that there are so far, by number.

        Raises:
            SweepDirectoryError: one is damaged; names it.
        """
        numbers = sorted(
            int(path.stem) for path in (self.path / JOBS).glob("*.json") if path.stem.isdecimal()
        )
        return [self.job(number) for number in numbers]

    def job(self, num: int) -> JobRecord:
        """The record of job `num`.

        Raises:
            SweepDirectoryError: it is missing or damaged.
        """
        return _read_job(self.job_path(num))

    def runs_of_jobs(self) -> list[Path]:
        """The folders of its jobs' runs, of those that have begun, even if they are gone.

        Raises:
            SweepDirectoryError: the record of a job is damaged.
        """
        return [self.study_folder / job.run for job in self.jobs() if job.run]

    def has_live_runs(self) -> bool:
        """True if a run that a job of the sweep began is still training.

        Raises:
            SweepDirectoryError: the record of a job is damaged.
        """
        running = (job.run for job in self.jobs() if job.status == RUNNING and job.run)
        return any(RunDirectory(self.study_folder / name).is_live() for name in running)

    def write_job(
        self,
        num: int,
        status: str,
        *,
        overrides: Sequence[str] | None = None,
        run: str | None = None,
        run_id: str | None = None,
        error: str | None = None,
    ) -> JobRecord:
        """Write the record of job `num` from the process that runs it; one writer at a time.

        `overrides`, `run` and `run_id` stay as they were where they are None, `error` does not.

        Raises:
            ValueError: not one of JOB_STATUSES.
            SweepDirectoryError: the record that is there is damaged.
            StorageError: it cannot be written; the old one stays.
        """
        require_status(status, JOB_STATUSES)
        path = self.job_path(num)
        before = self.job(num) if path.exists() else None
        now = utc_now()
        job = JobRecord(
            num=num,
            overrides=tuple(overrides if overrides is not None else _of(before, "overrides") or ()),
            run=run or _of(before, "run"),
            run_id=run_id or _of(before, "run_id"),
            status=status,
            error=error,
            created_at=_of(before, "created_at") or now,
            updated_at=now,
            **this_process(),
        )
        atomic_write(path, json_bytes(asdict(job)))
        return job


@while_unchanged
def _read_job(path: Path) -> JobRecord:
    names = {field.name for field in fields(JobRecord)}
    record = read_record(path, names, SweepDirectoryError)
    known = {name: record[name] for name in names}
    return JobRecord(**{**known, "overrides": tuple(record["overrides"])})


def _of(job: JobRecord | None, name: str) -> Any:
    return None if job is None else getattr(job, name)
