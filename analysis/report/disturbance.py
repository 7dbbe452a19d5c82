"""How the arms of a study do under disturbances, side by side."""

from collections.abc import Iterator

import pandas as pd

from analysis.data.disturbed import DISTURBANCE
from analysis.data.study import RUN, Study, pretty_arm
from analysis.measures.quantities import SUCCESS, TRACKING_OF_ROLL_OUT
from analysis.report.cells import MISSING, Table, spread_text
from analysis.report.sections import Section

MEASURES = (SUCCESS, "upper_body_error_m", "lower_body_error_m")
TEXT = (
    "The policies of the runs under disturbances that they need not have been trained with. Runs "
    "of one seed meet the same pushes, delays and differences of the robot in every arm. There are "
    "no tests here: the rows are many, and all of the same runs."
)
NOTE = (
    "Mean ± standard deviation over runs of a run's mean over its roll-outs. docs/disturbances.md "
    "explains the disturbances."
)


def disturbance_section(study: Study) -> Iterator[Section]:
    """A table for each measure, with a row for each disturbance, where the study has any."""
    if len(study.disturbed):
        tables = tuple(_table(study, measure) for measure in MEASURES)
        yield Section("disturbances", "Under disturbances", (TEXT,), tables)


def _table(study: Study, measure: str) -> Table:
    shown = TRACKING_OF_ROLL_OUT[measure]
    frame = study.disturbed.assign(
        **{
            SUCCESS: study.disturbed["survival"].eq(1.0).astype(float),
            "arm": study.runs.loc[study.disturbed[RUN], "arm"].to_numpy(),
        }
    )
    by_run = pd.Series(frame.groupby([DISTURBANCE, "arm", RUN], sort=False)[measure].mean())
    digits = 2 if measure == SUCCESS else 4
    rows = tuple(
        (str(name), *(_cell(by_run, str(name), arm, digits) for arm in study.arms))
        for name in dict.fromkeys(frame[DISTURBANCE])
    )
    header = ("disturbance", *map(pretty_arm, study.arms))
    return Table(f"{shown.name} ({shown.unit}) under disturbances", header, rows, NOTE)


def _cell(by_run: pd.Series, disturbance: str, arm: str, digits: int) -> str:
    values = by_run.loc[disturbance, arm].dropna()
    if values.empty:
        return MISSING
    return spread_text(float(values.mean()), float(values.std()), digits)
