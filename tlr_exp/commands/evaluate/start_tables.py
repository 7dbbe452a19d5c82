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
DISTURBANCE = "disturbance"  # where there are any, the column after these
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
    disturbance: str = ""  # of an evaluation under disturbance


def csv_of(runs: Iterable[MeasuredRun]) -> bytes:
    """A row for each roll-out; a cell is empty where there is no latency, or no such term.

    Records of earlier versions lack measures: their cells are empty, too.
    """
    rows = [_row(run, start) for run in runs for start in run.each]
    of_the_run = (
        (*OF_THE_RUN, DISTURBANCE) if any(DISTURBANCE in row for row in rows) else OF_THE_RUN
    )
    columns = dict.fromkeys([*of_the_run, *OF_THE_START, *(name for row in rows for name in row)])
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def runs_in(content: bytes) -> set[tuple[str, str, str]]:
    """Runs, iterations and disturbances in a CSV of ``csv_of``; none in a file of another kind."""
    reader = csv.DictReader(io.StringIO(content.decode(errors="replace")))
    return {
        (row["run"], row.get("iteration") or "", row.get(DISTURBANCE) or "")
        for row in reader
        if row.get("run")
    }


def _row(run: MeasuredRun, start: dict[str, Any]) -> dict[str, Any]:
    return {
        **{name: getattr(run, name) for name in OF_THE_RUN},
        **({DISTURBANCE: run.disturbance} if run.disturbance else {}),
        **{name: start.get(name, "") for name in OF_THE_START},
        **{keys.REWARD_TERM_PREFIX + name: value for name, value in start["terms"].items()},
    }


def arms_table(runs: Sequence[MeasuredRun], starts: int) -> Table:
    """A row for each motion, disturbance and arm, disturbances in the order of the runs.

    In each cell are mean and sample standard deviation over the runs of a run's mean over its
    roll-outs.
    """
    table = Table(
        title=f"{starts} roll-outs a run: mean ± standard deviation over runs",
        title_justify="left",
        padding=0,  # or a terminal of eighty columns would cut the numbers
    )
    headings = [measure.heading for measure in SHOWN.values()]
    disturbances = list(dict.fromkeys(run.disturbance for run in runs))
    what = "motion, arm" if disturbances == [""] else "disturbance,\nmotion, arm"
    table.add_column(what, overflow="fold")
    for heading in ("runs", f"succeed\nof {starts}", *headings):
        table.add_column(heading, justify="right")
    rows = {(run.motion, disturbances.index(run.disturbance), run.arm) for run in runs}
    for motion, number, arm in sorted(rows):
        members = [
            run
            for run in runs
            if (run.motion, run.disturbance, run.arm) == (motion, disturbances[number], arm)
        ]
        succeeded = [float(sum(s["survival"] == 1.0 for s in run.each)) for run in members]
        names = "\n".join(filter(None, (disturbances[number], motion, arm)))
        table.add_row(
            *(names, str(len(members)), _spread(succeeded, 1.0, 1)),
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
