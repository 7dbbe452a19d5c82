"""A study: runs that differ in what is compared (the arm) and in the seed, as two tidy frames."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_float_dtype, is_integer_dtype

from tlr_exp.errors import UserError
from tlr_exp.keys import ITERATION, METHOD_NAMES
from tlr_exp.records.directory import FINISHED, STATUSES

BASELINE_METHOD = "fixed"

# Columns of `Study.runs`, whose index is called RUN.
RUN = "run"
TEXT_COLUMNS = (
    *("run_id", "arm", "method", "status", "scale", "motion", "device", "commit", "created_at"),
    *("identity", "host", "cpu_model", "packages", "command", "config"),
)
NUMBER_COLUMNS = ("seed", "num_envs", "iterations", "control_steps")
# Columns of `Study.curves` before the metrics.
CURVE_KEYS = (RUN, "arm", "seed", ITERATION)


class Remedy(Enum):
    """What can be asked for, so that what is refused is taken all the same."""

    UNFINISHED = auto()  # take runs as far as they have come
    WITHOUT_RUN = auto()  # leave out jobs that have no run
    COMMON_SEEDS = auto()  # leave out what not every arm has finished
    NEWEST = auto()  # of several runs of an arm and seed take the newest
    KEYS = auto()  # compare by a key, or pass over it
    ONE_MOTION = auto()  # take the runs of one motion alone
    REPLACE = auto()  # replace what is there


class StudyError(UserError):
    """The data are no usable study; each line of the message names one problem.

    ``remedies``: what could be asked for all the same.
    """

    def __init__(self, problems: str, *remedies: Remedy) -> None:
        super().__init__(problems)
        self.remedies = remedies


@dataclass(frozen=True, eq=False)
class Study:
    """Checked runs and their curves. Do not write into the frames.

    runs: one row per run, index "run" (its name). Texts: run_id, arm, method (name of the
        optimizer), status, scale, motion, device, commit ("-dirty" behind it: with local changes;
        empty: not known), created_at (ISO 8601), identity, host, cpu_model, packages (JSON),
        command, config (JSON). Integers: seed, num_envs, iterations (configured), control_steps
        (taken, of all environments together).
    curves: one row per run and iteration (1, 2, ... without gaps): run, arm, seed, iteration and a
        float column per metric name of tlr_exp.keys, NaN where it was not measured.
    baseline: the arm that others are compared with; by default that of the static reward,
        "fixed", else the first.
    notes: what a reader must know of the choice of runs, one sentence each.
    starts: roll-outs without exploration noise (`starts.py`): one row per run and start phase,
        run, start_phase and a float column per measure; without rows where none are known.

    Raises:
        StudyError: names everything that is wrong.
    """

    runs: pd.DataFrame
    curves: pd.DataFrame
    baseline: str = ""
    notes: tuple[str, ...] = ()
    starts: pd.DataFrame = field(default_factory=pd.DataFrame)

    def __post_init__(self) -> None:
        from analysis.data.starts import starts_problems  # which needs the errors of this module

        problems = [*_column_problems(self.runs, self.curves)]
        if not problems:
            problems = [
                *_run_problems(self.runs),
                *_curve_problems(self.runs, self.curves),
                *starts_problems(self.starts, self.runs.index),
            ]
        names = () if problems else arm_order(self.runs["arm"])
        if names and self.baseline and self.baseline not in names:
            problems.append(f"baseline {self.baseline!r} is no arm; arms: {_list(names)}")
        if problems:
            raise StudyError("\n".join(problems))
        object.__setattr__(self, "baseline", self.baseline or "".join(names[:1]))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms, baseline first, numbers within their labels in ascending order."""
        rest = [arm for arm in arm_order(self.runs["arm"]) if arm != self.baseline]
        return (self.baseline, *rest)

    @property
    def metric_names(self) -> tuple[str, ...]:
        return tuple(str(name) for name in self.curves.columns if name not in CURVE_KEYS)

    @property
    def iterations(self) -> int:
        """Configured iterations, the same in all runs."""
        return int(self.runs["iterations"].iloc[0])

    @property
    def is_finished(self) -> bool:
        return bool((self.runs["status"] == FINISHED).all())

    def seeds(self, arm: str) -> tuple[int, ...]:
        """Seeds of an arm in ascending order.

        Raises:
            StudyError: there is no such arm; names those there are.
        """
        if arm not in self.arms:
            raise StudyError(f"there is no arm {arm!r}; arms: {_list(self.arms)}")
        return tuple(sorted(int(seed) for seed in self.runs.loc[self.runs["arm"] == arm, "seed"]))

    def matrix(self, metric: str, arm: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Seeds [n] ascending, iterations [T] and the metric's values [n, T] (float64) of an arm.

        Only iterations in which every run of the arm has the metric.

        Raises:
            StudyError: no such arm or metric (names those there are), or no common iteration.
        """
        seeds = self.seeds(arm)
        if metric not in self.metric_names:
            raise StudyError(f"there is no metric {metric!r}; metrics: {_list(self.metric_names)}")
        rows = self.curves[self.curves["arm"] == arm]
        table = rows.pivot(index="seed", columns=ITERATION, values=metric)
        table = table.reindex(index=list(seeds)).sort_index(axis=1).dropna(axis=1)
        if table.shape[1] == 0:
            having = set(rows.loc[rows[metric].notna().to_numpy(), RUN])
            without = sorted(set(rows[RUN]) - having)
            which = f"; never in {_list(without)}" if without else ""
            raise StudyError(
                f"{metric}: no iteration in which all runs of arm {arm!r} have it{which}"
            )
        values = table.to_numpy(dtype=np.float64, copy=True)
        return np.array(seeds), table.columns.to_numpy(dtype=np.int64, copy=True), values


def pretty_arm(arm: str) -> str:
    """The name of an arm for figures and texts: the method's name in words, the rest as it is."""
    method, comma, rest = arm.partition(",")
    return METHOD_NAMES.get(method, method) + comma + rest


def rows_of(frame: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """The rows of a frame by its index, as plain mappings; of a doubled index the last."""
    rows: list[dict[Any, Any]] = pd.DataFrame(frame).to_dict("records")
    return {str(name): row for name, row in zip(frame.index, rows, strict=True)}


def arm_order(arms: Iterable[str]) -> tuple[str, ...]:
    """Each label once: those of the static reward first, then by name, numbers by size."""

    def key(label: str) -> tuple[bool, list[tuple[int, float, str]]]:
        parts = re.split(r"(\d+(?:\.\d+)?(?:e[+-]?\d+)?)", label)
        ranks = [(0, float(p), "") if i % 2 else (1, 0.0, p) for i, p in enumerate(parts)]
        return label.partition(",")[0] != BASELINE_METHOD, ranks

    return tuple(sorted({str(arm) for arm in arms}, key=key))


# --- checks ----------------------------------------------------------------------------------
def _column_problems(runs: pd.DataFrame, curves: pd.DataFrame) -> Iterator[str]:
    """What makes the frames unreadable: columns that are missing or of another type."""
    if runs.index.name != RUN:
        yield f"runs: the index is called {runs.index.name!r}; it must be {RUN!r}, the run's name"
    kinds = (("text", TEXT_COLUMNS), ("an integer", NUMBER_COLUMNS))
    for kind, columns in kinds:
        yield from _typed(runs, "runs", columns, kind)
    yield from _typed(curves, "curves", (RUN, "arm"), "text")
    yield from _typed(curves, "curves", ("seed", ITERATION), "an integer")
    metrics = [name for name in curves.columns if name not in CURVE_KEYS]
    if not metrics:
        yield "curves: there is no metric"
    yield from _typed(curves, "curves", metrics, "a float")
    for name, frame in (("runs", runs), ("curves", curves)):
        for column in sorted({str(each) for each in frame.columns[frame.columns.duplicated()]}):
            yield f"{name}: there are two columns {column}"
    if len(runs) == 0:
        yield "there is no run"


def _typed(frame: pd.DataFrame, name: str, columns: Iterable[str], kind: str) -> Iterator[str]:
    is_kind = {"text": _is_text, "an integer": is_integer_dtype, "a float": is_float_dtype}[kind]
    for column in columns:
        if column not in frame.columns:
            yield f"{name}: the column {column} is missing"
            continue
        values = frame[column]
        if not isinstance(values, pd.Series):
            continue  # two columns of one name, which is said elsewhere
        gaps = np.count_nonzero(pd.isna(values.to_numpy()))
        if gaps and kind != "a float":
            yield f"{name}: the column {column} lacks {gaps} values"
        elif not is_kind(values):
            yield f"{name}: the column {column} is {values.dtype}; it must be {kind}"


def _is_text(column: pd.Series) -> bool:
    return len(column) == 0 or pd.api.types.infer_dtype(column, skipna=False) == "string"


def _run_problems(runs: pd.DataFrame) -> Iterator[str]:
    for name in runs.index[runs.index.duplicated()].unique():
        yield f"{name}: there are {int((runs.index == name).sum())} runs of this name"
    for name, group in runs.groupby(["arm", "seed"]):
        arm, seed = tuple(name)  # type: ignore[arg-type]
        if len(group) > 1:
            yield f"arm {arm!r} has seed {seed} {len(group)} times: {_list(group.index)}"
    for name, status in runs["status"].items():
        if status not in STATUSES:
            yield f"{name}: status {status!r}; it must be one of {_list(STATUSES)}"
    usual = Counter(runs["iterations"].tolist()).most_common(1)[0][0]
    for name, count in zip(runs.index, runs["iterations"].tolist(), strict=True):
        if count != usual:
            yield f"{name}: configured for {count} iterations, other runs for {usual}"


def _curve_problems(runs: pd.DataFrame, curves: pd.DataFrame) -> Iterator[str]:
    for name in sorted(set(curves[RUN]) - set(runs.index)):
        yield f"{name}: has a curve, but is not among the runs"
    curve_of = dict(iter(curves.groupby(RUN, sort=False)))
    for name, run in rows_of(runs).items():
        curve = curve_of.get(name)
        if curve is None:
            yield f"{name}: has no curve"
            continue
        for column in ("arm", "seed"):
            if set(curve[column]) != {run[column]}:
                yield f"{name}: {column} in its curve is not {run[column]!r}, as among the runs"
        found = curve[ITERATION].to_numpy()
        yield from iteration_problems(name, found, run["iterations"], run["status"])
    for metric in (each for each in curves.columns if each not in CURVE_KEYS):
        infinite = curves.loc[np.isinf(curves[metric].to_numpy(dtype=np.float64)), RUN]
        if len(infinite):
            yield f"{infinite.iloc[0]}: {metric} is infinite; allowed: a finite number or NaN"


def iteration_problems(name: str, found: np.ndarray, configured: int, status: str) -> Iterator[str]:
    """What is wrong with the iterations [T] of a run, which must be 1, 2, ... `configured`."""
    expected = np.arange(1, (configured if status == FINISHED else len(found)) + 1)
    missing, (values, counts) = np.setdiff1d(expected, found), np.unique(found, return_counts=True)
    if len(missing):
        what = f"{_list(missing[:5])}{', ...' if len(missing) > 5 else ''}"
        yield f"{name}: {status}, with {len(missing)} of {len(expected)} iterations missing: {what}"
    if (counts > 1).any():
        yield f"{name}: has iteration {values[counts > 1][0]} more than once"
    elif len(found) and (found.min() < 1 or found.max() > configured):
        outside = found[(found < 1) | (found > configured)][0]
        yield f"{name}: has iteration {outside}, outside 1 to {configured}"


def _list(names: Iterable[object]) -> str:
    return ", ".join(map(str, names))
