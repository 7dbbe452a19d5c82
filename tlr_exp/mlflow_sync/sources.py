"""Finds the runs and sweeps to bring into MLflow, and the store and experiment of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from tlr_exp.errors import UserError
from tlr_exp.machine import variables
from tlr_exp.mlflow_sync.tracking_uri import (
    STORE,
    check_tracking_uri,
    default_tracking_uri,
)
from tlr_exp.records.directory import RecordDirectory, RecordError
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

DEFAULT_EXPERIMENT = "tlr_exp"
MAX_FILE_MB = 64.0  # larger checkpoints and videos stay in the run directory (0: all of them)


@dataclass(frozen=True)
class Source:
    """A run or a sweep to bring over, and where to."""

    folder: RecordDirectory
    uri: str
    experiment: str
    max_file_mb: float


@dataclass(frozen=True)
class Found:
    """What lies at or below some paths.

    folders: sweeps, then runs that belong to none of these, with the folder looked in for each.
    problems: a sentence for each folder that looks like a run or a sweep and cannot be read.
    """

    folders: dict[RecordDirectory, Path]
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
        UserError: a path that holds nothing usable, or a URI or limit that cannot be.
    """
    limit = limit_of_environment() if max_file_mb is None else max_file_mb
    found = found_below(paths)
    sources = []
    for folder, root in found.folders.items():
        name = experiment or folder.study or DEFAULT_EXPERIMENT
        sources.append(Source(folder, store_of(folder, root, tracking_uri), name, limit))
    return sources, found.problems


def megabytes(text: str) -> float:
    """A size that is not negative.

    Raises:
        ValueError: it is, or is no number (argparse's own kind of refusal).
    """
    size = float(text)
    if not size >= 0:
        raise UserError(f"{text}: must be 0 or more")
    return size


def limit_of_environment() -> float:
    """Megabytes of the largest file that is brought over.

    Raises:
        UserError: the variable TLR_SYNC_MAX_FILE_MB is no such number.
    """
    text = variables.max_file_mb() or str(MAX_FILE_MB)
    try:
        return megabytes(text)
    except ValueError as error:
        raise UserError(f"{variables.MAX_FILE_MB}: {error}") from error


def found_below(paths: Sequence[str]) -> Found:
    """The sweeps and runs named or contained in `paths`. Runs of a sweep come with it.

    Raises:
        RecordError: there is nothing usable; the first reason.
    """
    roots: dict[Path, Path] = {}
    folders: dict[Path, RecordDirectory] = {}
    problems: dict[Path, RecordError] = {}
    come_with_sweeps: set[Path] = set()
    usable: set[str] = set()
    for kind, root in product((SweepDirectory, RunDirectory), paths):
        for folder in kind.find(root):
            usable.add(root)
            roots.setdefault(folder.path, Path(root).absolute())
            try:
                folders[folder.path] = kind.open(folder.path)
                come_with_sweeps.update(folder.runs_of_jobs())
            except RecordError as error:
                folders.pop(folder.path, None)
                problems[folder.path] = error
    for path in paths:
        if path not in usable:
            RunDirectory.open(path)  # says what is wrong with it
    if problems and not folders:
        raise next(iter(problems.values()))
    where = {
        folder: path.parent if path == roots[path] else roots[path]
        for path, folder in folders.items()
        if path not in come_with_sweeps
    }
    return Found(where, tuple(str(error) for error in problems.values()))


def store_of(folder: RecordDirectory, root: Path, given: str | None) -> str:
    """The store for `folder`: the one given, the environment's, one beside or above it, or new.

    Raises:
        UserError: a URI of no usable kind.
    """
    if given is not None:
        return check_tracking_uri(given)
    study = folder.study_folder
    if not variables.tracking_uri():
        # RUNS/STUDY/RUN. No higher: a mlflow.db in a project's folder is somebody else's.
        for parent in (study, study.parent):
            if (parent / STORE).is_file():
                return default_tracking_uri(parent)
    # Where training itself would have put it: RUNS, of RUNS/STUDY/RUN.
    return default_tracking_uri(study.parent if study.name == folder.study else root)
