"""Tells runs apart: identity of a configuration, names of new runs, finding runs on disk."""

import hashlib
import itertools
import json
import logging
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.locks import ELSEWHERE, hold
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.storage import storage_errors

RUNS_LOCK = ".runs.lock"  # held in a study's folder while a run is looked for and made
CREATE_TIMEOUT_S = 60.0

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
        raise UserError(f"run name {name!r}: must be one folder name, without slashes")
    root = Path(root).absolute()
    with storage_errors(f"cannot make a run directory in {root}", ELSEWHERE):
        root.mkdir(parents=True, exist_ok=True)
        for number in itertools.count(1):
            path = root / (name if number == 1 else f"{name}-{number}")
            with suppress(FileExistsError):
                path.mkdir()
                return path
    raise AssertionError("unreachable: the count has no end")


def latest_runs(root: str | Path, prefer_finished: bool = False) -> dict[str, RunDirectory]:
    """For each identity below `root` its latest run, whatever the status.

    With `prefer_finished` a finished run goes before a later one that is not.
    """
    found: dict[str, tuple[bool, str, str, RunDirectory]] = {}
    for run in RunDirectory.find(root):
        try:
            manifest = run.manifest
        except RunDirectoryError as error:
            _log.warning("passed over while looking for runs: %s", error)
            continue
        preferred = prefer_finished and manifest["status"] == FINISHED
        entry = (preferred, manifest.get("created_at", ""), str(run.path), run)
        identity = manifest.get("identity", "")
        found[identity] = max(found.get(identity, entry), entry, key=lambda item: item[:3])
    return {identity: entry[3] for identity, entry in found.items()}


def find_run(root: str | Path, identity: str, prefer_finished: bool = False) -> RunDirectory | None:
    """The run below `root` with this identity that `latest_runs` chooses; None if none."""
    return latest_runs(root, prefer_finished).get(identity)


def find_or_create_run(
    root: str | Path,
    identity: str,
    create: Callable[[], RunDirectory],
    prefer_finished: bool = False,
) -> RunDirectory:
    """The run below `root` with this identity, made by `create` where there is none.

    Of many processes that ask at once, one makes it and all others find it.

    Raises:
        RunDirectoryError: another process has been looking for a minute.
        StorageError: the folder cannot be written.
    """
    root = Path(root).absolute()
    with storage_errors(f"cannot make a run directory in {root}", ELSEWHERE):
        root.mkdir(parents=True, exist_ok=True)

    def in_use() -> RunDirectoryError:
        return RunDirectoryError(
            f"{root / RUNS_LOCK} has been held for {CREATE_TIMEOUT_S:.0f} s by another process "
            "that makes a run there: try again"
        )

    with hold(root / RUNS_LOCK, in_use, CREATE_TIMEOUT_S):
        return find_run(root, identity, prefer_finished) or create()
