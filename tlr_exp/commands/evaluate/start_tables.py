"""The roll-outs of several runs: all of them as a CSV, and their means by arm as a table."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any

from rich.table import Table

from tlr_exp import keys
from tlr_exp.evaluation.measures import MEASURES, SHOWN

# Columns by where they come from. After them come the reward terms.
OF_THE_RUN = ("run", "arm", "seed", "motion", "iteration", "physics")
OF_THE_START = ("start_phase", "duration_s", "ended_by", *MEASURES)


@dataclass(frozen=True)
class MeasuredRun:
    """A run with its roll-outs, each as ``Start.to_dict`` gives it."""

    run: str
    arm: str
    seed: int
    motion: str
    iteration: int
    physics: str
    each: list[dict[str, Any]]


def csv_of(runs: Iterable[MeasuredRun]) -> bytes:
    """A row for each roll-out; a cell is empty where there is no latency, or no such term.

    Records of earlier versions lack measures: their cells are empty, too.
    """
    rows = [_row(run, start) for run in runs for start in run.each]
    columns = dict.fromkeys([*OF_THE_RUN, *OF_THE_START, *(name for row in rows for name in row)])
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def runs_in(content: bytes) -> set[str]:
    """The names of the runs in a CSV of ``csv_of``; none in a file of another kind."""
    reader = csv.DictReader(io.StringIO(content.decode(errors="replace")))
    return {row["run"] for row in reader if row.get("run")}


def _row(run: MeasuredRun, start: dict[str, Any]) -> dict[str, Any]:
    return {
        **{name: getattr(run, name) for name in OF_THE_RUN},
        **{name: start.get(name, "") for name in OF_THE_START},
        **{keys.REWARD_TERM_PREFIX + name: value for name, value in start["terms"].items()},
    }


def arms_table(runs: Sequence[MeasuredRun], starts: int) -> Table:
    """A row for each motion and arm.

    In each cell are mean and sample standard deviation over the runs of a run's mean over its
    roll-outs.
    """
    table = Table(
        title=f"{starts} roll-outs a run: mean ± standard deviation over runs",
        title_justify="left",
        padding=0,  # or a terminal of eighty columns would cut the numbers
    )
    headings = [measure.heading for measure in SHOWN.values()]
    table.add_column("motion, arm", overflow="fold")
    for heading in ("runs", f"succeed\nof {starts}", *headings):
        table.add_column(heading, justify="right")
    for motion, arm in sorted({(run.motion, run.arm) for run in runs}):
        members = [run for run in runs if (run.motion, run.arm) == (motion, arm)]
        succeeded = [float(sum(s["survival"] == 1.0 for s in run.each)) for run in members]
        table.add_row(
            *(f"{motion}\n{arm}", str(len(members)), _spread(succeeded, 1.0, 1)),
            *(
                _spread(_means(members, name), measure.factor, measure.decimals)
                for name, measure in SHOWN.items()
            ),
        )
    return table


def _means(runs: Sequence[MeasuredRun], name: str) -> list[float]:
    """Of each run that has any the mean over those roll-outs that have the measure."""
    known = [[start[name] for start in run.each if start.get(name) is not None] for run in runs]
    return [fmean(values) for values in known if values]


def _spread(values: Sequence[float], factor: float, decimals: int) -> str:
    if not values:
        return "-"
    mean = f"{factor * fmean(values):.{decimals}f}"
    return f"{mean}\n± {factor * stdev(values):.{decimals}f}" if len(values) > 1 else mean
