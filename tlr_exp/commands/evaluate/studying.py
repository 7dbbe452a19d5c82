"""Many runs measured from many start phases: several at a time, and only those not measured yet."""

import dataclasses
import multiprocessing
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from tlr_exp.assembly.environment import undisturbed
from tlr_exp.commands.evaluate.arms import arms_of, motion_name
from tlr_exp.commands.evaluate.start_tables import MeasuredRun, arms_table, csv_of, runs_in
from tlr_exp.config.components import part_of
from tlr_exp.env.disturbances import check_engine
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice, choose, is_folder_of_runs, run_of
from tlr_exp.evaluation.conditions import UNDISTURBED, Condition
from tlr_exp.evaluation.records import (
    content_of,
    evaluation_folder,
    evaluation_name,
    read_starts,
    write_whole,
)
from tlr_exp.machine.cores import available_cores
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.outputs import check_free
from tlr_exp.records.run_directory import EVALUATIONS, RunDirectory


@dataclass(frozen=True)
class Wanted:
    """A run to be measured under a condition, and where its record is or will be."""

    choice: Choice
    record: Path
    condition: Condition


def study(
    runs: Sequence[Path],
    checkpoint: str | None,
    physics: str | None,
    starts: int,
    jobs: int | None,
    output: Path | None,
    force: bool,
    conditions: Sequence[Condition] = (UNDISTURBED,),
) -> int:
    """``tlr-evaluate STUDY_FOLDER --starts N`` and ``tlr-evaluate RUN RUN … --starts N``.

    With several ``conditions`` (``--disturb``) every run is measured under each of them, and a
    figure is drawn beside the CSV.

    Returns:
        The exit status: 1 where a run could not be measured, else 0.

    Raises:
        ValueError: there is no finished run, or nothing can be written there.
        FileExistsError: the CSV holds something else, or the figure's PNG is there without it, and
            --force is not given.
    """
    disturbed = len(conditions) > 1
    table = _output(output, runs, f"{'disturbed' if disturbed else 'starts'}-{starts}.csv")
    wanted, failed = find_wanted(runs, checkpoint, physics, starts, conditions)
    missing = [each for each in wanted if not each.record.exists()]
    _check_output(table, missing, disturbed, force)
    what = "evaluations" if disturbed else "runs"
    print(f"{len(wanted)} {what}, of which {len(wanted) - len(missing)} are already measured")
    for number, (each, problem) in enumerate(measured(missing, starts, jobs), 1):
        failed += problem is not None
        said = f"wrote {each.record}" if problem is None else _failure(each.choice.run, problem)
        print(f"{number} of {len(missing)}: {said}", flush=True)
    found, unread = read_all([each for each in wanted if each.record.exists()], starts, disturbed)
    failed += unread
    if not found:
        return 1

    from rich.console import Console

    Console().print(arms_table(found, starts))
    print(write_whole(table, csv_of(found), force))
    if disturbed:
        _draw(table.with_suffix(".png"), found, starts)
    return 1 if failed else 0


def find_wanted(
    runs: Sequence[Path],
    checkpoint: str | None,
    physics: str | None,
    starts: int,
    conditions: Sequence[Condition],
) -> tuple[list[Wanted], int]:
    """The runs that are meant, each once under each condition; how many cannot be evaluated.

    Raises:
        ValueError: there is none at all.
    """
    wanted: dict[Path, Wanted] = {}
    failed = 0
    paths = [path for given in runs for path in _paths_of(given)]
    for path in paths:
        try:
            choice = choose(path, checkpoint, physics)
            _check_engine(choice, physics, conditions)
        except (ValueError, OSError) as error:
            print(_failure(path, error), file=sys.stderr)
            failed += 1
            continue
        for condition in conditions:
            name = evaluation_name(choice, starts, condition.file_part)
            record = evaluation_folder(choice) / f"{name}.json"
            wanted[record] = Wanted(choice, record, condition)
    if not paths:
        folders = ", ".join(map(str, runs))
        raise UserError(f"there is no finished run in {folders}")
    return list(wanted.values()), failed


def _check_engine(choice: Choice, physics: str | None, conditions: Sequence[Condition]) -> None:
    """Refuse what the engine cannot do, in the words of the command line."""
    changing = [condition for condition in conditions if condition.changes]
    if not changing:
        return
    engine = part_of("physics", choice.settings.physics)
    env = undisturbed(choice.settings.env)
    refused = []
    for condition in changing:
        try:
            check_engine(condition.applied(env).disturbance, engine)
        except UserError:
            refused.append(condition.label)
    if refused:
        given = f"its engine, {choice.physics}," if physics is None else f"--physics {physics}"
        raise UserError(f"{given} cannot do --disturb {' '.join(refused)}; --physics native can")


def _paths_of(given: Path) -> Iterator[Path]:
    if not is_folder_of_runs(given):
        yield given
        return
    for run in RunDirectory.find(given):
        try:
            status = run.status
        except ValueError:  # a manifest that cannot be read, which ``choose`` will explain
            status = FINISHED
        if status == FINISHED:
            yield run.path
        else:
            print(f"skipped: {run.path.name} is {status}")


def measured(
    wanted: Sequence[Wanted], starts: int, jobs: int | None
) -> Iterator[tuple[Wanted, Exception | None]]:
    """Measure each in a process of its own, ``jobs`` at a time; yields each as it ends.

    What is given with it is what went wrong, if anything did. Whoever stops the iteration waits for
    the runs at work only.
    """
    if not wanted:
        return
    pool = ProcessPoolExecutor(
        min(jobs or available_cores(), len(wanted)),
        # Forked processes would share the locks of libraries that have threads.
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin_process,
    )
    try:
        tasks = {pool.submit(measure_run, each, starts): each for each in wanted}
        for task in as_completed(tasks):
            error = task.exception()
            if error is not None and not isinstance(error, Exception):
                raise error
            yield tasks[task], error
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_process() -> None:
    import torch

    torch.set_num_threads(1)
    # Ctrl-C reaches the whole group: this process is to write the run that it is at.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def measure_run(wanted: Wanted, starts: int) -> None:
    """Roll a run's policy out with one thread and write its record.

    Raises:
        ValueError: as ``evaluate_starts``.
        StorageError: the record cannot be written.
    """
    from tlr_exp.evaluation.starts import evaluate_starts, record_of

    settings = wanted.choice.settings
    physics = dict(settings.physics)
    if "num_threads" in physics:
        physics["num_threads"] = 1
    choice = dataclasses.replace(
        wanted.choice, settings=dataclasses.replace(settings, physics=physics)
    )
    record = record_of(*evaluate_starts(choice, starts, wanted.condition))
    if wanted.condition.changes:
        record["disturbance"] = wanted.condition.label
    wanted.record.parent.mkdir(parents=True, exist_ok=True)
    write_whole(wanted.record, content_of(record), force=False)


def read_all(
    wanted: Sequence[Wanted], starts: int, disturbed: bool
) -> tuple[list[MeasuredRun], int]:
    """The roll-outs in the records, and how many records cannot be read (which are named).

    Where they are ``disturbed``, each is told by its condition.
    """
    each, failed = [], 0
    for one in wanted:
        try:
            each.append((one, read_starts(one.record, starts)))
        except (ValueError, OSError) as error:
            print(_failure(one.choice.run, error), file=sys.stderr)
            failed += 1
    arms = arms_of([RunDirectory.open(one.choice.run) for one, _ in each])
    runs = [
        MeasuredRun(
            run=one.choice.run.name,
            arm=arm,
            seed=one.choice.settings.seed,
            motion=motion_name(one.choice.motion),
            iteration=one.choice.iteration,
            physics=one.choice.physics,
            each=starts_of,
            disturbance=one.condition.label if disturbed else "",
        )
        for arm, (one, starts_of) in zip(arms, each, strict=True)
    ]
    return sorted(runs, key=lambda run: (run.motion, run.arm, run.seed, run.run)), failed


def _draw(path: Path, runs: Sequence[MeasuredRun], starts: int) -> None:
    from tlr_exp.pictures.disturbance_plot import DisturbedRun, disturbance_figure
    from tlr_exp.pictures.media import write_figure

    measured_runs = [
        DisturbedRun(
            *(run.motion, run.disturbance, run.arm),
            success=fmean(start["survival"] == 1.0 for start in run.each),
            upper_body_error_m=fmean(start["upper_body_error_m"] for start in run.each),
            lower_body_error_m=fmean(start["lower_body_error_m"] for start in run.each),
        )
        for run in runs
    ]
    title = f"{starts} roll-outs a run under each disturbance"
    print(f"wrote {write_figure(path, disturbance_figure(measured_runs, title))}")


def _output(output: Path | None, runs: Sequence[Path], name: str) -> Path:
    """Where the CSV goes: into the folder of the runs, or for several arguments beside them.

    Of a single run, or a checkpoint of it, it goes to the run's evaluations.
    """
    run = run_of(runs[0])
    only = run if len(runs) == 1 and run.is_dir() else Path()
    if only != Path() and not is_folder_of_runs(only):
        only = only / EVALUATIONS
        only.mkdir(exist_ok=True)
    path = output or only / name
    if path.suffix.lower() != ".csv":
        raise UserError(f"several runs go into one CSV: -o {path} should end in .csv")
    if not path.absolute().parent.is_dir():
        raise UserError(f"-o {path}: there is no folder {path.absolute().parent}")
    return path


def _check_output(path: Path, missing: Sequence[Wanted], disturbed: bool, force: bool) -> None:
    """Refuse at once a file that is certain to come out otherwise, as it lacks a checkpoint.

    A picture is ours only beside its table: alone it is somebody else's.
    """
    if disturbed and not path.exists():
        check_free([path.with_suffix(".png")], force)
    there = runs_in(path.read_bytes()) if path.is_file() else set()
    new = {
        (one.choice.run.name, str(one.choice.iteration), one.condition.label if disturbed else "")
        for one in missing
    }
    if path.is_file() and not new <= there:
        check_free([path], force)


def _failure(run: Path, error: Exception) -> str:
    return f"{run.name} cannot be evaluated: {error}"
