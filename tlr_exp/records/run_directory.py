"""The run directory: all that a run leaves behind, whether or not a tracking server is there.

manifest.json   run id, status, source revision, versions, machine, seed, command line, file hashes
config.yaml     the resolved configuration
motion.npz      the motion as it is trained on, see tlr_exp.training.kept_motion
metrics.jsonl   one line an iteration, see tlr_exp.records.metrics_file
checkpoints/    see tlr_exp.records.checkpoint
eval/           what evaluations of the run wrote (JSON, videos)
run.lock        held by the process that trains
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import sys
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tlr_exp import __version__
from tlr_exp.errors import UserError
from tlr_exp.records import provenance
from tlr_exp.records.locks import ELSEWHERE, hold, is_held
from tlr_exp.records.metrics_file import (
    append_metrics,
    last_of_each_iteration,
    read_metrics,
    rewrite_until,
)
from tlr_exp.records.storage import (
    StorageError,
    atomic_write,
    json_bytes,
    storage_errors,
    sync_file,
)

MANIFEST, CONFIG, METRICS, LOCK = "manifest.json", "config.yaml", "metrics.jsonl", "run.lock"
MOTION = "motion.npz"
EVALUATIONS = "eval"

RUNNING, FINISHED, FAILED, INTERRUPTED = "running", "finished", "failed", "interrupted"
STATUSES = (RUNNING, FINISHED, FAILED, INTERRUPTED)

_LAYOUT = "A run directory holds manifest.json, config.yaml, metrics.jsonl and checkpoints/"


class RunDirectoryError(UserError):
    """A path is no (usable) run directory, or is in use; the message says what would be right."""


class RunInUseError(RunDirectoryError):
    """Another process holds the run."""


class RunDirectory:
    """One run on disk. Make one with `create` or `open`; only the holder of `lock` may write."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(
        cls,
        path: str | Path,
        config: Mapping[str, Any],
        tags: Mapping[str, Any],
        identity: str = "",
        files: Mapping[str, str] | None = None,
    ) -> RunDirectory:
        """Start a run in `path`, which must be new or empty; parents are made.

        `config` is the resolved configuration of plain values (the seed is read from its key
        "seed"). `tags` are the labels the run is looked up by: method, scale, device, experiment
        and the like. `identity` tells which runs are the same experiment (tlr_exp.records.runs).
        `files` are the hashes of the files that the configuration means, by key
        (tlr_exp.config.input_files).

        Raises:
            RunDirectoryError: `path` holds something already, or `config` is not plain data.
            StorageError: the folder cannot be made or written.
        """
        path = Path(path).absolute()
        text = _config_text(config)
        with storage_errors(f"cannot make the run directory {path}", ELSEWHERE):
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RunDirectoryError(
                    f"{path} is not empty, so no new run is started in it: choose another name, "
                    "or resume the run that is there"
                )
        run = cls(path)
        try:
            atomic_write(path / CONFIG, text.encode())
            # Last, because a folder is a run directory from the moment it has a manifest.
            manifest = _new_manifest(path.name, config, dict(tags), identity)
            run._write_manifest({**manifest, "files": dict(files or {})})
        except StorageError as error:
            with suppress(OSError):
                (path / CONFIG).unlink(missing_ok=True)
                path.rmdir()
            raise StorageError(f"cannot make the run directory {path}", error, ELSEWHERE) from error
        return run

    @classmethod
    def open(cls, path: str | Path) -> RunDirectory:
        """The run in `path`.

        Raises:
            RunDirectoryError: there is none; names the runs that lie below `path`, if any.
        """
        path = Path(path).absolute()
        if not path.is_dir():
            raise RunDirectoryError(f"{path} is not a directory. {_LAYOUT}.")
        if not (path / MANIFEST).is_file():
            below = sorted(found.parent.name for found in path.glob(f"*/{MANIFEST}"))
            hint = f" It holds these runs: {', '.join(below)}." if below else ""
            raise RunDirectoryError(f"{path} has no {MANIFEST}. {_LAYOUT}.{hint}")
        run = cls(path)
        _ = run.manifest
        return run

    # --- manifest and configuration ----------------------------------------------------------
    @property
    def manifest(self) -> dict[str, Any]:
        """manifest.json as it is on disk now.

        Raises:
            RunDirectoryError: it is missing or is not one of ours.
        """
        try:
            manifest = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise RunDirectoryError(f"cannot read {self.path / MANIFEST}: {error}") from error
        if not isinstance(manifest, dict) or not {"run_id", "name", "status"} <= manifest.keys():
            raise RunDirectoryError(f"{self.path / MANIFEST} lacks run_id, name or status")
        return manifest

    @property
    def status(self) -> str:
        """running, finished, failed or interrupted. A killed run still says running: `is_live`."""
        return self.manifest["status"]

    @property
    def config(self) -> dict[str, Any]:
        """The resolved configuration, from config.yaml.

        Raises:
            RunDirectoryError: the file is missing or is not YAML.
        """
        import yaml

        try:
            return yaml.safe_load((self.path / CONFIG).read_text(encoding="utf-8")) or {}
        except (OSError, yaml.YAMLError) as error:
            raise RunDirectoryError(f"cannot read {self.path / CONFIG}: {error}") from error

    def rewrite_config(self, config: Mapping[str, Any]) -> None:
        """Replace config.yaml, for the holder of `lock`.

        Raises:
            RunDirectoryError: `config` is not plain data.
            StorageError: it cannot be written; the old one stays.
        """
        atomic_write(self.path / CONFIG, _config_text(config).encode())

    @property
    def motion_path(self) -> Path:
        """Where the motion lies that is trained on; not there in runs of earlier versions."""
        return self.path / MOTION

    def set_status(self, status: str, **extra: Any) -> None:
        """Write `status`, the pid of this process and `extra` entries into the manifest.

        Raises:
            ValueError: not one of STATUSES.
            StorageError: the manifest cannot be written; the old one stays.
        """
        if status not in STATUSES:
            raise ValueError(f"run status {status!r}: must be one of {', '.join(STATUSES)}")
        process = {"pid": os.getpid(), "command": _command()}
        self._write_manifest({**self.manifest, **process, **extra, "status": status})

    def _write_manifest(self, manifest: dict[str, Any]) -> None:
        atomic_write(self.path / MANIFEST, json_bytes({**manifest, "updated_at": utc_now()}))

    # --- one process at a time ---------------------------------------------------------------
    @contextmanager
    def lock(self, timeout_s: float = 1.0) -> Iterator[None]:
        """Hold the run for writing. The lock of a process that died is free at once (flock).

        Raises:
            RunInUseError: another process holds it, still after `timeout_s` seconds.
            StorageError: the lock file cannot be made.
        """

        def in_use() -> RunInUseError:
            return RunInUseError(
                f"{self.path} is in use by another process (the manifest says pid "
                f"{self.manifest.get('pid')}): wait for it, stop it, or start a new run"
            )

        with hold(self.path / LOCK, in_use, timeout_s):
            yield

    def is_live(self) -> bool:
        """Whether a process holds `lock` now, by trying it for an instant."""
        return is_held(self.path / LOCK)

    # --- metrics -----------------------------------------------------------------------------
    @property
    def metrics_path(self) -> Path:
        return self.path / METRICS

    def log(self, iteration: int, metrics: Mapping[str, float]) -> None:
        """Append the metrics of one iteration as one line, given to the system at once.

        Non-finite values are kept as null (see tlr_exp.records.metrics_file).

        Raises:
            ValueError: a name is reserved, or a value is not a number (names it).
            StorageError: the disk is full, ...; the lines before stay.
        """
        append_metrics(self.metrics_path, iteration, metrics)

    def flush(self) -> None:
        """Force the lines logged so far onto the disk; before a checkpoint that follows on them.

        Raises:
            StorageError: the disk refuses it.
        """
        if self.metrics_path.exists():
            sync_file(self.metrics_path)

    def metrics(self) -> list[dict[str, Any]]:
        """All lines in the order of iterations; of an iteration logged twice, the later line.

        A torn last line (left by a kill) is passed over. null comes back as NaN.

        Raises:
            ValueError: a line before the last is damaged; names it.
        """
        return last_of_each_iteration(read_metrics(self.metrics_path)[0])

    def truncate_after(self, iteration: int) -> None:
        """Drop the lines past `iteration` (all of them for -1), atomically: before a resume.

        Raises:
            ValueError: a line before the last is damaged; names it.
            StorageError: the file cannot be rewritten; the old one stays.
        """
        rewrite_until(self.metrics_path, iteration)


# --- parts of a manifest ---------------------------------------------------------------------


def _new_manifest(
    name: str, config: Mapping[str, Any], tags: dict[str, Any], identity: str
) -> dict[str, Any]:
    return {
        "run_id": str(uuid.uuid4()),
        "name": name,
        "identity": identity,
        "status": RUNNING,
        "created_at": utc_now(),
        "pid": os.getpid(),
        "command": _command(),
        "seed": config.get("seed"),
        "tags": tags,
        "git": provenance.source_revision(),
        "tlr_exp": __version__,
        "packages": provenance.package_versions(),
        "python": platform.python_version(),
        "machine": provenance.machine(tags.get("device")),
    }


def _config_text(config: Mapping[str, Any]) -> str:
    import yaml

    try:
        return yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
    except yaml.YAMLError as error:
        raise RunDirectoryError(f"the configuration is not plain data: {error}") from error


def _command() -> str:
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def utc_now() -> str:
    """The time of now as the records hold it: ISO 8601, UTC, microseconds."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
