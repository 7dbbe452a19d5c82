"""Roll-outs from many start phases, from the CSV of ``tlr-evaluate FOLDER --starts N``.

One row per run and start phase, numbers as float64, NaN where a roll-out lacks a measure. Which
measures there are is up to the file: every column of numbers is taken.
"""

import io
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.data.study import RUN, StudyError
from tlr_exp.records.sweep_directory import SWEEPS

PHASE, ITERATION = "start_phase", "iteration"
# Columns that say which roll-out it is, not how it went.
NOT_MEASURED = (PHASE, ITERATION, "duration_s", "start_frame")
STARTS = "starts.csv"  # in an exported study
_BESIDE_RUNS = re.compile(r"starts-(\d+)\.csv")


def read_starts(path: Path) -> pd.DataFrame:
    """The roll-outs in a CSV: columns ``run``, ``start_phase`` and every other column of numbers.

    Arm and seed are those of the study.

    Raises:
        StudyError: it cannot be read, lacks a column, or has a start of a run twice; names it.
    """
    try:
        return parse_starts(path.read_bytes(), str(path))
    except FileNotFoundError:
        raise StudyError(f"{path} is missing") from None
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror}") from error


def parse_starts(content: bytes, where: str) -> pd.DataFrame:
    """`read_starts` of the content of a file; ``where`` names it in messages.

    Raises:
        StudyError: as `read_starts`.
    """
    try:
        table = pd.read_csv(io.BytesIO(content), dtype={RUN: str})
    except (ValueError, UnicodeDecodeError) as error:
        raise StudyError(f"{where}: is no table ({' '.join(str(error).split())[:120]})") from error
    lacking = [name for name in (RUN, PHASE) if name not in table.columns]
    if lacking:
        raise StudyError(
            f"{where}: the column {lacking[0]} is missing; it must be a CSV of "
            "tlr-evaluate FOLDER --starts N"
        )
    if not pd.api.types.is_numeric_dtype(table[PHASE]):
        raise StudyError(f"{where}: {PHASE} holds {table[PHASE].iloc[0]}; it must be a number")
    aside = (RUN, "arm", "seed")  # the study knows its runs
    numbers = [str(n) for n in table.columns if n not in aside and _is_number(pd.Series(table[n]))]
    frame = pd.DataFrame(table[[RUN, *numbers]].astype(dict.fromkeys(numbers, np.float64)))
    problems = [*starts_problems(frame)]
    if problems:
        raise StudyError("\n".join(f"{where}: {problem}" for problem in problems))
    return frame


def _is_number(column: pd.Series) -> bool:
    numeric = pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)
    return bool(numeric and column.notna().any())


def starts_problems(starts: pd.DataFrame, runs: Iterable[str] | None = None) -> Iterator[str]:
    """What is wrong with roll-outs, and with their runs if those of the study are given."""
    if starts.empty:
        return
    lacking = [name for name in (RUN, PHASE) if name not in starts.columns]
    if lacking:
        yield f"starts: the column {lacking[0]} is missing"
        return
    if starts[[RUN, PHASE]].isna().to_numpy().any():
        yield "starts: a row lacks its run or its start phase"
    twice = starts[starts.duplicated([RUN, PHASE])]
    if len(twice):
        run, phase = twice[RUN].iloc[0], twice[PHASE].iloc[0]
        yield f"starts: the start phase {phase:g} of {run} is there twice"
    for name in measures_in(starts):
        if np.isinf(starts[name].to_numpy(dtype=np.float64)).any():
            yield f"starts: {name} is infinite; allowed: a finite number or nothing"
    if runs is not None:
        for run in sorted(set(starts[RUN]) - set(runs)):
            yield f"starts: {run} is not among the runs"


def measures_in(starts: pd.DataFrame) -> list[str]:
    """The columns that say how a roll-out went."""
    return [str(name) for name in starts.columns if name not in (RUN, *NOT_MEASURED)]


def starts_beside(folder: Path) -> Path | None:
    """The CSV that lies beside the runs of ``folder``: of several, the one of the most starts.

    Looked at are the folder itself, the folder of a run, and the study of a sweep
    (runs/STUDY/sweeps/NAME-ID).
    """
    resolved = folder.resolve()
    places = [resolved, resolved.parent]
    if resolved.parent.name == SWEEPS:
        places.append(resolved.parents[1])
    for place in places:
        found = {
            int(name.group(1)): path
            for path in sorted(place.glob("starts-*.csv"))
            if (name := _BESIDE_RUNS.fullmatch(path.name))
        }
        if found:
            return found[max(found)]
    return None


def of_runs(
    tables: Sequence[pd.DataFrame], runs: Sequence[str]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The roll-outs of ``runs`` in ``tables``, of a run in several those of the first; and notes.

    The notes name runs without roll-outs, and say where runs were started from different phases.
    """
    kept: list[pd.DataFrame] = []
    known: set[str] = set()
    for table in tables:
        kept.append(pd.DataFrame(table[table[RUN].isin([run for run in runs if run not in known])]))
        known |= set(table[RUN])
    frame = pd.concat(kept, ignore_index=True) if kept else pd.DataFrame()
    if frame.empty:
        return pd.DataFrame(), ()
    order = {run: place for place, run in enumerate(runs)}
    frame = frame.sort_values(
        [RUN, PHASE], key=lambda column: column.map(order) if column.name == RUN else column
    ).reset_index(drop=True)
    return frame, tuple(_notes(frame, runs))


def _notes(starts: pd.DataFrame, runs: Sequence[str]) -> Iterator[str]:
    lacking = [run for run in runs if run not in set(starts[RUN])]
    if lacking:
        yield f"without roll-outs from start phases: {', '.join(lacking)}"
    iterations = sorted(set(starts[ITERATION])) if ITERATION in starts.columns else []
    if len(iterations) > 1:
        listed = ", ".join(f"{each:g}" for each in iterations)
        yield f"the roll-outs are of checkpoints of different iterations: {listed}"
    phases = {run: tuple(rows[PHASE]) for run, rows in starts.groupby(RUN, sort=False)}
    counts = sorted({len(each) for each in phases.values()})
    if len(set(phases.values())) > 1:
        yield (
            "the roll-outs of the runs start from different phases: "
            f"{', '.join(map(str, counts))} a run"
        )


def csv_of_starts(starts: pd.DataFrame, runs: pd.DataFrame) -> bytes:
    """The roll-outs as a CSV with arm and seed of each run, every number to its last digit."""
    table = starts.copy()
    table.insert(1, "arm", runs.loc[table[RUN], "arm"].to_numpy())
    table.insert(2, "seed", runs.loc[table[RUN], "seed"].to_numpy())
    if ITERATION in table.columns and table[ITERATION].notna().to_numpy().all():
        table[ITERATION] = table[ITERATION].astype(np.int64)
    return table.to_csv(index=False, lineterminator="\n").encode()
