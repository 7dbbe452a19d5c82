"""Reading the runs that lie on disk as training leaves them (docs/architecture.md)."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from analysis.data.runs import RunRecord, curve_from_rows, run_record
from analysis.data.study import Remedy, StudyError
from tlr_exp.keys import ITERATION

MANIFEST, CONFIG, METRICS = "manifest.json", "config.yaml", "metrics.jsonl"
SWEEP, JOBS = "sweep.json", "jobs"
WALL_TIME = "wall_time"  # of a line of metrics; not a metric
_NO_RUNS = ("mlartifacts", "checkpoints")  # folders with copies of manifests, or with no runs


def from_run_directories(
    paths: str | Path | Iterable[str | Path], allow_unfinished: bool = False
) -> list[RunRecord]:
    """The runs that `paths` name, each once, by path. Nothing is written or locked.

    A path is a run directory, a folder with runs somewhere below it, or the directory of a sweep
    (runs_dir/STUDY/sweeps/NAME-ID), which stands for the runs of its jobs. Jobs that have no run
    yet are passed over with `allow_unfinished`.

    Raises:
        StudyError: a path is no run and holds none, a job has no run, or runs cannot be read; one
            line per problem.
    """
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    folders: dict[Path, None] = {}
    records, problems = [], []
    remedies: tuple[Remedy, ...] = ()
    for path in map(Path, given):
        if (path / SWEEP).is_file():
            found, lacking = runs_of_sweep(path)
            if lacking and not allow_unfinished:
                problems += lacking
                remedies = (Remedy.WITHOUT_RUN,)
        else:
            found = find_run_directories(path)
        if not found:
            what = "holds no run directory" if path.is_dir() else "there is no such folder"
            problems.append(f"{path}: {what}")
        folders |= dict.fromkeys(found)
    for folder in sorted(folders):
        try:
            records.append(read_run_directory(folder))
        except StudyError as error:
            problems.append(str(error))
    if problems:
        raise StudyError("\n".join(problems), *remedies)
    return records


def arms_of_sweep(path: Path) -> tuple[str, ...]:
    """Configuration keys in which the arms of a sweep differ; empty for any other folder.

    Raises:
        StudyError: the record of the sweep is damaged.
    """
    if not (path / SWEEP).is_file():
        return ()
    # Groups are written as on the command line, reward/objective, and are keys like others here.
    arms = read_json(path / SWEEP).get("arms") or []
    return tuple(str(key).replace("/", ".") for key in arms)


def runs_of_sweep(path: Path) -> tuple[list[Path], list[str]]:
    """Run directories of a sweep's jobs, and a line for each job that has none.

    Raises:
        StudyError: a record is damaged; names it.
    """
    number = read_json(path / SWEEP).get("num_jobs")
    files = {int(file.stem): file for file in (path / JOBS).glob("*.json") if file.stem.isdecimal()}
    found, lacking = [], []
    for num in sorted({*files, *range(number if isinstance(number, int) else 0)}):
        job = read_json(files[num]) if num in files else {}
        # The runs of a study lie beside its folder of sweeps, as sweeps can share them.
        folder = path.resolve().parents[1] / str(job.get("run") or "")
        if job.get("run") and (folder / MANIFEST).is_file():
            found.append(folder)
        else:
            what = " ".join(map(str, job.get("overrides") or []))
            reason = job.get("error") or job.get("status") or "not begun"
            lacking.append(f"{path.name}: job {num} ({what}) has no run: {reason}")
    return found, lacking


def find_run_directories(root: Path) -> list[Path]:
    """Folders at or below `root` that hold a run's manifest, sorted; does not look inside a run."""
    found = []
    for folder, subfolders, files in os.walk(root):
        if MANIFEST in files and not any(name.endswith(".parquet") for name in files):
            found.append(Path(folder).resolve())
            subfolders.clear()
        subfolders[:] = [name for name in subfolders if name not in _NO_RUNS]
    return sorted(found)


def read_run_directory(folder: Path) -> RunRecord:
    """The run in `folder`, as far as it has come.

    Raises:
        StudyError: a file is missing or damaged; names it.
    """
    manifest, config = read_json(folder / MANIFEST), read_yaml(folder / CONFIG)
    rows = [
        {name: value for name, value in row.items() if name != WALL_TIME}
        for row in read_metrics(folder / METRICS)
    ]
    try:
        curve = curve_from_rows(rows)
    except ValueError as error:
        raise StudyError(f"{folder / METRICS}: {error}") from error
    return run_record(manifest, config, curve, str(folder))


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Lines of metrics in the order of iterations; of an iteration written twice, the later line.

    A torn last line (left by a kill) is passed over; a file that is not there is empty.

    Raises:
        StudyError: a line before the last is damaged; names it.
    """
    try:
        lines = path.read_bytes().split(b"\n")[:-1]
    except FileNotFoundError:
        return []
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror}") from error
    rows: dict[int, dict[str, Any]] = {}
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            iteration = row[ITERATION]
            if not isinstance(iteration, int):
                raise TypeError(iteration)
        except (ValueError, TypeError, KeyError):
            if number < len(lines):
                raise StudyError(f"{path}: line {number} is damaged") from None
        else:
            rows[iteration] = row
    return [rows[iteration] for iteration in sorted(rows)]


def read_json(path: Path) -> dict[str, Any]:
    return _mapping(path, json.loads, ValueError)


def read_yaml(path: Path) -> dict[str, Any]:
    return _mapping(path, lambda text: yaml.load(text, Loader=_LOADER), yaml.YAMLError)


def _mapping(path: Path, parse: Any, damage: type[Exception]) -> dict[str, Any]:
    try:
        content = parse(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror}") from error
    except (damage, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: is damaged ({' '.join(str(error).split())[:120]})") from error
    if not isinstance(content, dict):
        raise StudyError(f"{path}: is damaged (holds {type(content).__name__}, no mapping)")
    return content


# The same in C, where PyYAML was built with it: several times faster.
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
