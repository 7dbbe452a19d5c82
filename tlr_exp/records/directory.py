"""A folder that says of itself what it is: a manifest, a status, and one process that may write.

A run (run_directory.py) and a sweep (sweep_directory.py) are such folders.
"""

import json
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Iterator, Set
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, Self

from tlr_exp.errors import UserError
from tlr_exp.records.locks import hold, is_held
from tlr_exp.records.storage import atomic_write, json_bytes

MANIFEST, SWEEP = "manifest.json", "sweep.json"  # the manifest of a run, and that of a sweep
ARTIFACTS = "mlartifacts"  # where a local MLflow store beside the runs keeps its copies
TABLE_SUFFIX = ".parquet"  # of an exported study, which has a manifest, too, and is no run

RUNNING, FINISHED, FAILED, INTERRUPTED = "running", "finished", "failed", "interrupted"
STATUSES = (RUNNING, FINISHED, FAILED, INTERRUPTED)


class RecordError(UserError):
    """A folder is no (usable) run or sweep, or is in use; the message says what would be right."""


class RecordDirectory(ABC):
    """A run or a sweep on disk. Only the holder of `lock` may write."""

    noun: ClassVar[str]
    manifest_name: ClassVar[str]
    lock_name: ClassVar[str]
    layout: ClassVar[str]  # what such a folder holds, for messages
    required: ClassVar[Set[str]]  # the entries that every manifest has
    error: ClassVar[type[RecordError]]
    in_use_error: ClassVar[type[RecordError]]
    when_in_use: ClassVar[str]  # what a person can do then

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()

    @classmethod
    def open(cls, path: str | Path) -> Self:
        """The one in `path`.

        Raises:
            RecordError: there is none, or it is damaged; names those that lie below `path`, if any.
        """
        found = cls(path)
        holds = f"A {cls.noun} directory holds {cls.layout}."
        if not found.path.is_dir():
            raise cls.error(f"{found.path} is not a directory. {holds}")
        if not found.manifest_path.is_file():
            below = sorted(each.parent.name for each in found.path.glob(f"*/{cls.manifest_name}"))
            hint = f" It holds these {cls.noun}s: {', '.join(below)}." if below else ""
            raise cls.error(f"{found.path} has no {cls.manifest_name}. {holds}{hint}")
        _ = found.manifest
        return found

    @classmethod
    def find(cls, root: str | Path) -> list[Self]:
        """Those at or below `root`, by path; what lies inside a run or a sweep is passed over."""
        found = []
        for folder, subfolders, files in os.walk(root):
            tables = any(name.endswith(TABLE_SUFFIX) for name in files)
            if SWEEP in files or (MANIFEST in files and not tables):
                if cls.manifest_name in files:
                    found.append(cls(folder))
                subfolders.clear()
            subfolders[:] = [name for name in subfolders if name != ARTIFACTS]
        return sorted(found, key=lambda each: each.path)

    # --- what tells one from the other -------------------------------------------------------
    @property
    @abstractmethod
    def study_folder(self) -> Path:
        """The folder of its study's runs: runs_dir/study."""

    @property
    @abstractmethod
    def study(self) -> str | None:
        """The name of its study, as its manifest has it.

        Raises:
            RecordError: the manifest is missing or damaged.
        """

    def runs_of_jobs(self) -> list[Path]:
        """Where the runs lie that it stands for beside itself: those of a sweep's jobs.

        Raises:
            RecordError: the record of a job is damaged.
        """
        return []

    def has_live_runs(self) -> bool:
        """True if such a run is still training, whatever has become of the process that began it.

        Raises:
            RecordError: the record of a job is damaged.
        """
        return False

    # --- manifest ----------------------------------------------------------------------------
    @property
    def manifest_path(self) -> Path:
        return self.path / self.manifest_name

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest as it is on disk now.

        Raises:
            RecordError: it is missing or is not one of ours.
        """
        return read_record(self.manifest_path, self.required, self.error)

    @property
    def status(self) -> str:
        """running, finished, failed or interrupted; interrupted where it was killed.

        Raises:
            RecordError: the manifest is missing or damaged.
        """
        status = self.manifest["status"]
        return INTERRUPTED if status == RUNNING and not self.is_live() else status

    def set_status(self, status: str, **extra: Any) -> None:
        """Write `status`, this process and `extra` entries into the manifest.

        Raises:
            ValueError: not one of STATUSES.
            StorageError: the manifest cannot be written; the old one stays.
        """
        require_status(status, STATUSES)
        self._write_manifest({**self.manifest, **self._writer(), **extra, "status": status})

    def _write_manifest(self, manifest: dict[str, Any]) -> None:
        atomic_write(self.manifest_path, json_bytes({**manifest, "updated_at": utc_now()}))

    def _writer(self) -> dict[str, Any]:
        """The manifest's entries on the process that wrote its status."""
        return this_process()

    # --- one process at a time ---------------------------------------------------------------
    @contextmanager
    def lock(self, timeout_s: float = 1.0) -> Iterator[None]:
        """Hold it for writing. The lock of a process that died is free at once (flock).

        Raises:
            RecordError: another process holds it, still after `timeout_s` seconds.
            StorageError: the lock file cannot be made.
        """
        with hold(self.path / self.lock_name, self._in_use, timeout_s):
            yield

    def is_live(self) -> bool:
        """True if a process holds `lock` now; it is tried for an instant."""
        return is_held(self.path / self.lock_name)

    def _in_use(self) -> RecordError:
        try:
            manifest = self.manifest
            holder = f"pid {manifest.get('pid')}"
            holder += f" on {manifest['host']}" if "host" in manifest else ""
        except RecordError:
            holder = "it has just begun"
        return self.in_use_error(
            f"{self.path} is in use by another process ({holder}): {self.when_in_use}"
        )


def read_record(path: Path, required: Set[str], error: type[RecordError]) -> dict[str, Any]:
    """The JSON object in `path`, with at least the entries `required`.

    Raises:
        RecordError: of the kind `error`; the file cannot be read or lacks entries.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as reason:
        raise error(f"cannot read {path}: {reason}") from reason
    if not isinstance(record, dict):
        raise error(f"{path} holds a {type(record).__name__}, not a record")
    if missing := required - record.keys():
        raise error(f"{path} lacks {', '.join(sorted(missing))}")
    return record


def require_status(status: str, allowed: tuple[str, ...]) -> None:
    """Refuse a word that is no status.

    Raises:
        ValueError: it is not among `allowed`; names them.
    """
    if status not in allowed:
        raise UserError(f"status {status!r}: must be one of {', '.join(allowed)}")


def this_process() -> dict[str, Any]:
    """The id of this process and the name of its machine, as records hold them."""
    return {"pid": os.getpid(), "host": socket.gethostname()}


def utc_now() -> str:
    """The time of now as the records hold it: ISO 8601, UTC, microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
