"""Which runs and sweeps are brought into MLflow, into which store and experiment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tlr_exp.records.mirror import (
    LIMIT_VARIABLE,
    MAX_FILE_MB,
    STORE,
    URI_VARIABLE,
    check_tracking_uri,
    default_tracking_uri,
)
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import find_runs
from tlr_exp.records.sweep_directory import SweepDirectory, find_sweeps

DEFAULT_EXPERIMENT = "tlr_exp"


@dataclass(frozen=True)
class Source:
    """A run or a sweep to bring over, and where to."""

    folder: RunDirectory | SweepDirectory
    uri: str
    experiment: str
    max_file_mb: float


def find_sources(
    paths: Sequence[str],
    tracking_uri: str | None = None,
    experiment: str | None = None,
    max_file_mb: float | None = None,
) -> list[Source]:
    """The sweeps at or below `paths`, then the runs that belong to none of these; each once.

    What is None comes from the environment, from where the folder lies, or from its own records.

    Raises:
        ValueError: a path that holds neither, or a URI or limit that cannot be.
    """
    limit = limit_of_environment() if max_file_mb is None else max_file_mb
    sources = []
    for folder, root in found_below(paths).items():
        name = experiment or _study_of(folder) or DEFAULT_EXPERIMENT
        sources.append(Source(folder, store_of(folder, root, tracking_uri), name, limit))
    return sources


def megabytes(text: str) -> float:
    """A size that is not negative.

    Raises:
        ValueError: it is, or is no number.
    """
    size = float(text)
    if not size >= 0:
        raise ValueError(f"{text}: must be 0 or more")
    return size


def limit_of_environment() -> float:
    """Megabytes of the largest file that is brought over.

    Raises:
        ValueError: the variable TLR_SYNC_MAX_FILE_MB is no such number.
    """
    text = os.environ.get(LIMIT_VARIABLE) or str(MAX_FILE_MB)
    try:
        return megabytes(text)
    except ValueError as error:
        raise ValueError(f"{LIMIT_VARIABLE}: {error}") from error


def found_below(paths: Sequence[str]) -> dict[RunDirectory | SweepDirectory, Path]:
    """The sweeps and runs named or contained in `paths`, with the folder they were looked for in.

    Runs of one of these sweeps come with it.

    Raises:
        RunDirectoryError, SweepDirectoryError: a path is or holds nothing usable.
    """
    sweeps: dict[Path, tuple[SweepDirectory, Path]] = {}
    runs: dict[Path, tuple[RunDirectory, Path]] = {}
    for path in paths:
        root = Path(path).absolute()
        found_sweeps = find_sweeps(path)
        found_runs = find_runs(path)
        if not found_sweeps and not found_runs:
            RunDirectory.open(path)  # says what is wrong with it
        for sweep in found_sweeps:
            sweeps.setdefault(sweep.path, (SweepDirectory.open(sweep.path), root))
        for run in found_runs:
            runs.setdefault(run.path, (RunDirectory.open(run.path), root))
    for sweep, _ in sweeps.values():
        for job in sweep.jobs():
            if job.run is not None:
                runs.pop(sweep.study_folder / job.run, None)
    found = [*sweeps.values(), *runs.values()]
    return {folder: folder.path.parent if folder.path == root else root for folder, root in found}


def _study_of(folder: RunDirectory | SweepDirectory) -> str | None:
    if isinstance(folder, SweepDirectory):
        return folder.record["study"]
    return folder.manifest.get("tags", {}).get("experiment")


def store_of(folder: RunDirectory | SweepDirectory, root: Path, given: str | None) -> str:
    """The store for `folder`: the one given, the environment's, one beside or above it, or new.

    Raises:
        ValueError: a URI of no usable kind.
    """
    if given is not None:
        return check_tracking_uri(given)
    study = folder.study_folder if isinstance(folder, SweepDirectory) else folder.path.parent
    if not os.environ.get(URI_VARIABLE):
        # RUNS/STUDY/RUN. No higher: a mlflow.db in a project's folder is somebody else's.
        for parent in (study, study.parent):
            if (parent / STORE).is_file():
                return default_tracking_uri(parent)
    # Where training itself would have put it: RUNS, of RUNS/STUDY/RUN.
    return default_tracking_uri(study.parent if study.name == _study_of(folder) else root)
