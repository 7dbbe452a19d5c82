"""Reading the runs that lie on disk as training leaves them (docs/architecture.md)."""

from collections.abc import Iterable
from pathlib import Path

from analysis.data.runs import RunRecord, curve_from_rows, run_record
from analysis.data.study import Remedy, StudyError
from tlr_exp.records.directory import RecordError
from tlr_exp.records.metrics_file import WALL_TIME
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory


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
    runs: dict[Path, RunDirectory] = {}
    records, problems = [], []
    remedies: tuple[Remedy, ...] = ()
    for path in map(Path, given):
        if SweepDirectory(path).manifest_path.is_file():
            found, lacking = runs_of_sweep(path)
            if lacking and not allow_unfinished:
                problems += lacking
                remedies = (Remedy.WITHOUT_RUN,)
        else:
            found = RunDirectory.find(path)
        if not found:
            what = "holds no run directory" if path.is_dir() else "there is no such folder"
            problems.append(f"{path}: {what}")
        runs |= {run.path.resolve(): run for run in found}
    for _, run in sorted(runs.items()):
        try:
            records.append(read_run(run))
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
    sweep = SweepDirectory(path)
    if not sweep.manifest_path.is_file():
        return ()
    try:
        arms = sweep.manifest.get("arms") or []
    except RecordError as error:
        raise StudyError(str(error)) from error
    # Groups are written as on the command line, reward/objective, and are keys like others here.
    return tuple(str(key).replace("/", ".") for key in arms)


def runs_of_sweep(path: Path) -> tuple[list[RunDirectory], list[str]]:
    """The runs of a sweep's jobs, and a line for each job that has none.

    Raises:
        StudyError: a record is damaged; names it.
    """
    sweep = SweepDirectory(path.resolve())
    try:
        jobs = {job.num: job for job in sweep.jobs()}
        numbers = sorted({*jobs, *range(sweep.manifest["num_jobs"])})
    except RecordError as error:
        raise StudyError(str(error)) from error
    found, lacking = [], []
    for num in numbers:
        job = jobs.get(num)
        if job is not None and job.run:
            run = RunDirectory(sweep.study_folder / job.run)
            if run.manifest_path.is_file():
                found.append(run)
                continue
        what = " ".join(job.overrides) if job else ""
        reason = (job.error or job.status) if job else "not begun"
        lacking.append(f"{path.name}: job {num} ({what}) has no run: {reason}")
    return found, lacking


def read_run(run: RunDirectory) -> RunRecord:
    """What a run has left so far.

    Raises:
        StudyError: a file is missing or damaged; names it.
    """
    try:
        manifest, config, rows = run.manifest, run.config, run.metrics()
    except (ValueError, OSError) as error:
        raise StudyError(" ".join(str(error).split())) from error
    for row in rows:
        row.pop(WALL_TIME, None)
    try:
        curve = curve_from_rows(rows)
    except ValueError as error:
        raise StudyError(f"{run.metrics_path}: {error}") from error
    return run_record(manifest, config, curve, str(run.path))
