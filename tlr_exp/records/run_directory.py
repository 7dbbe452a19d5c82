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

import os
import platform
import shlex
import sys
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tlr_exp import __version__
from tlr_exp.records import provenance
from tlr_exp.records.directory import MANIFEST, RUNNING, RecordDirectory, RecordError, utc_now
from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.metrics_file import (
    append_metrics,
    last_of_each_iteration,
    read_metrics,
    rewrite_until,
)
from tlr_exp.records.storage import StorageError, atomic_write, storage_errors, sync_file

CONFIG, METRICS, LOCK = "config.yaml", "metrics.jsonl", "run.lock"
MOTION = "motion.npz"
EVALUATIONS = "eval"
# The manifest's entry of an exported policy: the run, iteration and evaluation that it comes from.
POLICY = "policy"


class RunDirectoryError(RecordError):
    """A path is no (usable) run directory, or is in use; the message says what would be right."""


class RunInUseError(RunDirectoryError):
    """Another process holds the run."""


class RunDirectory(RecordDirectory):
    """One run on disk. Make one with `create` or `open`; only the holder of `lock` may write."""

    noun, manifest_name, lock_name = "run", MANIFEST, LOCK
    layout = f"{MANIFEST}, {CONFIG}, {METRICS} and checkpoints/"
    required = frozenset({"run_id", "name", "status"})
    error, in_use_error = RunDirectoryError, RunInUseError
    when_in_use = "wait for it, stop it, or start a new run"

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

        `config` is the resolved configuration of plain values, with a key "seed"; `tags` are the
        labels the run is looked up by, such as method and scale. `identity` tells which runs are
        the same experiment; `files` are the hashes of the files of the configuration, by key.

        Raises:
            RunDirectoryError: `path` holds something already, or `config` is not plain data.
            StorageError: the folder cannot be made or written.
        """
        text = _config_text(config)
        run = cls(path)
        path = run.path
        with storage_errors(f"cannot make the run directory {path}", ELSEWHERE):
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise RunDirectoryError(
                    f"{path} is not empty, so no new run is started in it: choose another name, "
                    "or resume the run that is there"
                )
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

    @property
    def study_folder(self) -> Path:
        """Where it lies beside the other runs of its study: runs_dir/study."""
        return self.path.parent

    @property
    def study(self) -> str | None:
        """The name of its study; None where it was made without one."""
        return self.manifest.get("tags", {}).get("experiment")

    def _writer(self) -> dict[str, Any]:
        return {"pid": os.getpid(), "command": command_line()}

    # --- configuration and motion ------------------------------------------------------------
    @property
    def config(self) -> dict[str, Any]:
        """The resolved configuration, from config.yaml.

        Raises:
            RunDirectoryError: the file is missing or is not YAML.
        """
        import yaml

        path = self.path / CONFIG
        try:
            config = _parsed_yaml(path.read_text(encoding="utf-8")) or {}
        except (OSError, ValueError, yaml.YAMLError) as error:
            reason = " ".join(str(error).split())  # YAML's is of many lines
            raise RunDirectoryError(f"cannot read {path}: {reason}") from error
        if not isinstance(config, dict):
            raise RunDirectoryError(f"{path} holds a {type(config).__name__}, not a configuration")
        return config

    def rewrite_config(self, config: Mapping[str, Any]) -> None:
        """Replace config.yaml, for the holder of `lock`.

        Raises:
            RunDirectoryError: `config` is not plain data.
            StorageError: it cannot be written; the old one stays.
        """
        atomic_write(self.path / CONFIG, _config_text(config).encode())

    @property
    def motion_path(self) -> Path:
        """The path of the motion that is trained on; runs of earlier versions lack the file."""
        return self.path / MOTION

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
        "command": command_line(),
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


def _parsed_yaml(text: str) -> Any:
    import yaml

    fast: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # where PyYAML was built with it
    try:
        return yaml.load(text, Loader=fast)
    except yaml.YAMLError:
        return yaml.safe_load(text)  # which takes the surrogates in paths that are no text


def command_line() -> str:
    """The command of this process, its program without the folder."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
