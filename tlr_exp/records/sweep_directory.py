"""The sweep directory: what a sweep says about itself and its jobs.

It lies at runs_dir/study/sweeps/NAME-ID/; the runs of its jobs lie in runs_dir/study/, because
several sweeps can share a run.

sweep.json    id, status, command, number of jobs (see `begin`)
jobs/NUM.json one per job, written by the job at each change (see `JobRecord`)
sweep.lock    held by the process of the sweep; "running" without it means killed
report/, figures/   what was made of the sweep; copied to its MLflow run
"""

from __future__ import annotations

import json
import os
import re
import socket
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.records.locks import ELSEWHERE, hold, is_held
from tlr_exp.records.run_directory import INTERRUPTED, RUNNING, STATUSES, utc_now
from tlr_exp.records.storage import atomic_write, json_bytes, storage_errors

SWEEPS, SWEEP, JOBS, SWEEP_LOCK = "sweeps", "sweep.json", "jobs", "sweep.lock"
REPORT, FIGURES = "report", "figures"

WAITING, CANCELLED = "waiting", "cancelled"  # cancelled: taken out of a cluster's queue
JOB_STATUSES = (WAITING, *STATUSES, CANCELLED)

_LAYOUT = f"A sweep directory holds {SWEEP} and {JOBS}/"
_REQUIRED = {"sweep_id", "run_id", "name", "study", "status", "num_jobs"}


class SweepDirectoryError(UserError):
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


class SweepDirectory:
    """One sweep on disk. Only the holder of `lock` may call `begin` and `set_status`.

    Each job writes its own record, by `SweepDirectory(path).write_job(...)`.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()

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

    @classmethod
    def open(cls, path: str | Path) -> SweepDirectory:
        """The sweep in `path`.

        Raises:
            SweepDirectoryError: there is none.
        """
        sweep = cls(path)
        if not (sweep.path / SWEEP).is_file():
            raise SweepDirectoryError(f"{sweep.path} has no {SWEEP}. {_LAYOUT}.")
        _ = sweep.record
        return sweep

    # --- the sweep ---------------------------------------------------------------------------
    @property
    def study_folder(self) -> Path:
        """Where the runs of the jobs lie: runs_dir/study."""
        return self.path.parents[1]

    @property
    def record(self) -> dict[str, Any]:
        """sweep.json as it is on disk now.

        Raises:
            SweepDirectoryError: it is missing or is not one of ours.
        """
        record = _read(self.path / SWEEP)
        if missing := _REQUIRED - record.keys():
            raise SweepDirectoryError(f"{self.path / SWEEP} lacks {', '.join(sorted(missing))}")
        return record

    @property
    def status(self) -> str:
        """running, finished, failed or interrupted; interrupted for a sweep that was killed."""
        status = self.record["status"]
        return INTERRUPTED if status == RUNNING and not self.is_live() else status

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
        before = self.record if (self.path / SWEEP).exists() else {}
        name, _, sweep_id = self.path.name.rpartition("-")
        self._write_record(
            {
                "sweep_id": sweep_id,
                "run_id": before.get("run_id") or str(uuid.uuid4()),
                "name": name,
                "study": self.study_folder.name,
                "status": RUNNING,
                "command": command,
                "created_at": before.get("created_at") or utc_now(),
                **_process(),
                "num_jobs": num_jobs,
                "description": description,
                "tags": dict(tags or {}),
            }
        )

    def set_status(self, status: str, **extra: Any) -> None:
        """Write `status`, this process and `extra` entries into sweep.json.

        Raises:
            ValueError: not one of running, finished, failed, interrupted.
            StorageError: it cannot be written; the old one stays.
        """
        _require_status(status, STATUSES)
        self._write_record({**self.record, **_process(), **extra, "status": status})

    def _write_record(self, record: dict[str, Any]) -> None:
        _write(self.path / SWEEP, {**record, "updated_at": utc_now()})

    # --- one process at a time ---------------------------------------------------------------
    @contextmanager
    def lock(self, timeout_s: float = 1.0) -> Iterator[None]:
        """Hold the sweep. The lock of a process that died is free at once.

        Raises:
            SweepDirectoryError: another process holds it, still after `timeout_s` seconds.
            StorageError: the lock file cannot be made.
        """

        def in_use() -> SweepDirectoryError:
            try:
                holder = "pid {pid} on {host}".format_map(self.record)
            except (SweepDirectoryError, KeyError):
                holder = "it has just begun"
            return SweepDirectoryError(
                f"the sweep {self.path} runs already in another process ({holder}): "
                "wait for it or stop it"
            )

        with hold(self.path / SWEEP_LOCK, in_use, timeout_s):
            yield

    def is_live(self) -> bool:
        """Whether a process holds `lock` now, by trying it for an instant."""
        return is_held(self.path / SWEEP_LOCK)

    # --- jobs --------------------------------------------------------------------------------
    def job_path(self, num: int) -> Path:
        """Where the record of job `num` lies or would lie."""
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
        path = self.job_path(num)
        record = _read(path)
        names = {field.name for field in fields(JobRecord)}
        if missing := names - record.keys():
            raise SweepDirectoryError(f"{path} lacks {', '.join(sorted(missing))}")
        known = {name: record[name] for name in names}
        return JobRecord(**{**known, "overrides": tuple(record["overrides"])})

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
        _require_status(status, JOB_STATUSES)
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
            **_process(),
        )
        _write(path, asdict(job))
        return job


def find_sweeps(root: str | Path) -> list[SweepDirectory]:
    """The sweep directories at or below `root`, by path; does not look inside runs or sweeps."""
    found = []
    for folder, subfolders, files in os.walk(root):
        if SWEEP in files:
            found.append(SweepDirectory(folder))
            subfolders.clear()
    return sorted(found, key=lambda sweep: sweep.path)


def _process() -> dict[str, Any]:
    return {"pid": os.getpid(), "host": socket.gethostname()}


def _of(job: JobRecord | None, name: str) -> Any:
    return None if job is None else getattr(job, name)


def _require_status(status: str, allowed: tuple[str, ...]) -> None:
    if status not in allowed:
        raise ValueError(f"status {status!r}: must be one of {', '.join(allowed)}")


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SweepDirectoryError(f"cannot read {path}: {error}") from error
    if not isinstance(record, dict):
        raise SweepDirectoryError(f"{path} holds a {type(record).__name__}, not a record")
    return record


def _write(path: Path, record: Mapping[str, Any]) -> None:
    atomic_write(path, json_bytes(record))
