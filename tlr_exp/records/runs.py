"""Which run is which: identity of a configuration, names of new runs, finding runs on disk."""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.run_directory import MANIFEST, RunDirectory, RunDirectoryError
from tlr_exp.records.storage import storage_errors

ARTIFACTS = "mlartifacts"  # where a local MLflow store beside the runs keeps its files

_log = logging.getLogger(__name__)


def config_hash(config: Mapping[str, Any], ignore: Iterable[str] = ()) -> str:
    """8 hex digits of the SHA-256 of the configuration as canonical JSON: what identifies a run.

    `ignore` lists dotted keys that do not change what is learned, such as "tracking" or "run.name".

    Raises:
        TypeError: the configuration holds something that JSON does not know.
    """
    kept = json.loads(json.dumps(config))
    for key in ignore:
        *parents, last = key.split(".")
        branch = kept
        for parent in parents:
            branch = branch.get(parent) if isinstance(branch, dict) else None
        if isinstance(branch, dict):
            branch.pop(last, None)
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def next_run_path(root: str | Path, name: str) -> Path:
    """Make and return the first free folder of ROOT/name, ROOT/name-2, ROOT/name-3, ...

    Safe against other processes that ask at the same time. The folder is empty, for
    `RunDirectory.create`.

    Raises:
        ValueError: `name` is not a single folder name.
        StorageError: the folder cannot be made.
    """
    if name in ("", ".", "..") or "/" in name or os.sep in name:
        raise ValueError(f"run name {name!r}: must be one folder name, without slashes")
    root = Path(root).absolute()
    with storage_errors(f"cannot make a run directory in {root}", ELSEWHERE):
        root.mkdir(parents=True, exist_ok=True)
        for number in itertools.count(1):
            path = root / (name if number == 1 else f"{name}-{number}")
            with suppress(FileExistsError):
                path.mkdir()
                return path
    raise AssertionError("unreachable: the count has no end")


def find_runs(root: str | Path) -> list[RunDirectory]:
    """The run directories at or below `root`, by path; does not look inside a run."""
    found = []
    for folder, subfolders, files in os.walk(root):
        if MANIFEST in files:
            found.append(RunDirectory(Path(folder).absolute()))
            subfolders.clear()
        # MLflow's copies of manifests are not runs.
        subfolders[:] = [name for name in subfolders if name != ARTIFACTS]
    return sorted(found, key=lambda run: run.path)


def find_run(root: str | Path, identity: str) -> RunDirectory | None:
    """The latest run below `root` with this identity, whatever its status; None if none."""
    runs = []
    for run in find_runs(root):
        try:
            manifest = run.manifest
        except RunDirectoryError as error:
            _log.warning("passed over while looking for runs: %s", error)
            continue
        if manifest.get("identity") == identity:
            runs.append((manifest.get("created_at", ""), str(run.path), run))
    return max(runs)[2] if runs else None
