"""Many runs measured from many start phases: several at a time, and only those not measured yet."""

import dataclasses
import multiprocessing
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from tlr_exp.commands.evaluate.arms import arms_of, motion_name
from tlr_exp.commands.evaluate.start_tables import MeasuredRun, arms_table, csv_of, runs_in
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice, choose, is_folder_of_runs
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
from tlr_exp.records.run_directory import RunDirectory


@dataclass(frozen=True)
class Wanted:
    """A run to be measured, and where its record is or will be."""

    choice: Choice
    record: Path


def study(
    runs: Sequence[Path],
    checkpoint: str | None,
    physics: str | None,
    starts: int,
    jobs: int | None,
    output: Path | None,
    force: bool,
) -> int:
    """``tlr-evaluate STUDY_FOLDER --starts N`` and ``tlr-evaluate RUN RUN … --starts N``.

    Returns:
        The exit status: 1 where a run could not be measured, else 0.

    Raises:
        ValueError: there is no finished run, or nothing can be written there.
        FileExistsError: the CSV holds something else, and --force is not given.
    """
    table = _output(output, runs, starts)
    wanted, failed = find_wanted(runs, checkpoint, physics, starts)
    missing = [each for each in wanted if not each.record.exists()]
    _check_output(table, missing, force)
    print(f"{len(wanted)} runs, of which {len(wanted) - len(missing)} are already measured")
    for number, (each, problem) in enumerate(measured(missing, starts, jobs), 1):
        failed += problem is not None
        said = f"wrote {each.record}" if problem is None else _failure(each.choice.run, problem)
        print(f"{number} of {len(missing)}: {said}", flush=True)
    found, unread = read_all([each for each in wanted if each.record.exists()], starts)
    failed += unread
    if not found:
        return 1

    from rich.console import Console

    Console().print(arms_table(found, starts))
    print(write_whole(table, csv_of(found), force))
    return 1 if failed else 0


def find_wanted(
    runs: Sequence[Path], checkpoint: str | None, physics: str | None, starts: int
) -> tuple[list[Wanted], int]:
    """The runs that are meant, by path, each once; and how many of them cannot be evaluated.

    Raises:
        ValueError: there is none at all.
    """
    wanted: dict[Path, Wanted] = {}
    failed = 0
    paths = [path for given in runs for path in _paths_of(given)]
    for path in paths:
        try:
            choice = choose(path, checkpoint, physics)
        except (ValueError, OSError) as error:
            print(_failure(path, error), file=sys.stderr)
            failed += 1
            continue
        name = evaluation_name(choice, starts)
        record = evaluation_folder(choice) / f"{name}.json"
        wanted[record] = Wanted(choice, record)
    if not paths:
        folders = ", ".join(map(str, runs))
        raise UserError(f"there is no finished run in {folders}")
    return list(wanted.values()), failed


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
    record = record_of(*evaluate_starts(choice, starts))
    wanted.record.parent.mkdir(parents=True, exist_ok=True)
    write_whole(wanted.record, content_of(record), force=False)


def read_all(wanted: Sequence[Wanted], starts: int) -> tuple[list[MeasuredRun], int]:
    """The roll-outs in the records, and how many records cannot be read (which are named)."""
    each, failed = [], 0
    for one in wanted:
        try:
            each.append((one.choice, read_starts(one.record, starts)))
        except (ValueError, OSError) as error:
            print(_failure(one.choice.run, error), file=sys.stderr)
            failed += 1
    arms = arms_of([RunDirectory.open(choice.run) for choice, _ in each])
    runs = [
        MeasuredRun(
            run=choice.run.name,
            arm=arm,
            seed=choice.settings.seed,
            motion=motion_name(choice.motion),
            iteration=choice.iteration,
            physics=choice.physics,
            each=starts_of,
        )
        for arm, (choice, starts_of) in zip(arms, each, strict=True)
    ]
    return sorted(runs, key=lambda run: (run.motion, run.arm, run.seed, run.run)), failed


def _output(output: Path | None, runs: Sequence[Path], starts: int) -> Path:
    """Where the CSV goes: into the folder of the runs, or for several arguments beside them."""
    only = runs[0] if len(runs) == 1 else Path()
    path = output or only / f"starts-{starts}.csv"
    if path.suffix.lower() != ".csv":
        raise UserError(f"several runs go into one CSV: -o {path} should end in .csv")
    if not path.absolute().parent.is_dir():
        raise UserError(f"-o {path}: there is no folder {path.absolute().parent}")
    return path


def _check_output(path: Path, missing: Sequence[Wanted], force: bool) -> None:
    """Refuse at once a file that is certain to come out otherwise, as it lacks a run."""
    if path.is_file() and any(
        each.choice.run.name not in runs_in(path.read_bytes()) for each in missing
    ):
        check_free([path], force)


def _failure(run: Path, error: Exception) -> str:
    return f"{run.name} cannot be evaluated: {error}"
