"""Which runs and sweeps are brought into MLflow, into which store and experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tlr_exp.machine import variables
from tlr_exp.mlflow_sync.mirror import (
    MAX_FILE_MB,
    STORE,
    check_tracking_uri,
    default_tracking_uri,
)
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.runs import find_runs
from tlr_exp.records.sweep_directory import SweepDirectory, SweepDirectoryError, find_sweeps

DEFAULT_EXPERIMENT = "tlr_exp"


@dataclass(frozen=True)
class Source:
    """A run or a sweep to bring over, and where to."""

    folder: RunDirectory | SweepDirectory
    uri: str
    experiment: str
    max_file_mb: float


@dataclass(frozen=True)
class Found:
    """What lies at or below some paths.

    folders: sweeps, then runs that belong to none of these, with the folder looked in for each.
    problems: a sentence for each folder that looks like a run or a sweep and cannot be read.
    """

    folders: dict[RunDirectory | SweepDirectory, Path]
    problems: tuple[str, ...]


def find_sources(
    paths: Sequence[str],
    tracking_uri: str | None = None,
    experiment: str | None = None,
    max_file_mb: float | None = None,
) -> tuple[list[Source], tuple[str, ...]]:
    """The sweeps at or below `paths`, then the runs that belong to none of these; each once.

    What is None comes from the environment, from where the folder lies, or from its own records.
    Beside them a sentence for each folder that cannot be read.

    Raises:
        ValueError: a path that holds nothing usable, or a URI or limit that cannot be.
    """
    limit = limit_of_environment() if max_file_mb is None else max_file_mb
    found = found_below(paths)
    sources = []
    for folder, root in found.folders.items():
        name = experiment or _study_of(folder) or DEFAULT_EXPERIMENT
        sources.append(Source(folder, store_of(folder, root, tracking_uri), name, limit))
    return sources, found.problems


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
    text = variables.max_file_mb() or str(MAX_FILE_MB)
    try:
        return megabytes(text)
    except ValueError as error:
        raise ValueError(f"{variables.MAX_FILE_MB}: {error}") from error


def found_below(paths: Sequence[str]) -> Found:
    """The sweeps and runs named or contained in `paths`. Runs of a sweep come with it.

    Raises:
        RunDirectoryError, SweepDirectoryError: there is nothing usable; the first reason.
    """
    roots: dict[Path, Path] = {}
    sweeps: dict[Path, SweepDirectory] = {}
    runs: dict[Path, RunDirectory] = {}
    problems: dict[Path, ValueError] = {}
    for path in paths:
        found_sweeps, found_runs = find_sweeps(path), find_runs(path)
        if not found_sweeps and not found_runs:
            RunDirectory.open(path)  # says what is wrong with it
        for folder in (*found_sweeps, *found_runs):
            roots.setdefault(folder.path, Path(path).absolute())
            try:
                if isinstance(folder, SweepDirectory):
                    sweeps[folder.path] = SweepDirectory.open(folder.path)
                else:
                    runs[folder.path] = RunDirectory.open(folder.path)
            except (RunDirectoryError, SweepDirectoryError) as error:
                problems[folder.path] = error
    for path in _runs_of_sweeps(sweeps, problems):
        runs.pop(path, None)
    folders = {**sweeps, **runs}
    if problems and not folders:
        raise next(iter(problems.values()))
    where = {
        folder: path.parent if path == roots[path] else roots[path]
        for path, folder in folders.items()
    }
    return Found(where, tuple(str(error) for error in problems.values()))


def _runs_of_sweeps(
    sweeps: dict[Path, SweepDirectory], problems: dict[Path, ValueError]
) -> Iterator[Path]:
    """Where the runs of these sweeps lie. A sweep with a damaged record moves to the problems."""
    for path, sweep in list(sweeps.items()):
        try:
            jobs = sweep.jobs()
        except SweepDirectoryError as error:
            problems[path] = error
            del sweeps[path]
            continue
        yield from (sweep.study_folder / job.run for job in jobs if job.run is not None)


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
    if not variables.tracking_uri():
        # RUNS/STUDY/RUN. No higher: a mlflow.db in a project's folder is somebody else's.
        for parent in (study, study.parent):
            if (parent / STORE).is_file():
                return default_tracking_uri(parent)
    # Where training itself would have put it: RUNS, of RUNS/STUDY/RUN.
    return default_tracking_uri(study.parent if study.name == _study_of(folder) else root)
