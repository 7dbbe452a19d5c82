"""Roll-outs under disturbances, from the CSV of ``tlr-evaluate FOLDER --disturb …``.

Rows are as in `starts.py`, with the disturbance as a further column; "none" is undisturbed.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from analysis.data.starts import parse_starts
from analysis.data.study import RUN, StudyError

DISTURBANCE = "disturbance"


def read_disturbed(path: Path) -> pd.DataFrame:
    """The roll-outs in a CSV: ``run``, ``disturbance``, ``start_phase`` and columns of numbers.

    Disturbances are in the order of the file.

    Raises:
        StudyError: it cannot be read, lacks a column, or has a start of a run twice; names it.
    """
    try:
        table = pd.read_csv(path, dtype={RUN: str, DISTURBANCE: str})
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: is no table ({' '.join(str(error).split())[:120]})") from error
    if DISTURBANCE not in table.columns:
        raise StudyError(
            f"{path}: the column {DISTURBANCE} is missing; it must be a CSV of "
            "tlr-evaluate FOLDER --disturb …"
        )
    parts = []
    for name in dict.fromkeys(table[DISTURBANCE]):
        content = io.StringIO()
        table[table[DISTURBANCE] == name].drop(columns=DISTURBANCE).to_csv(content, index=False)
        part = parse_starts(content.getvalue().encode(), f"{path}, {name}")
        part.insert(1, DISTURBANCE, name)
        parts.append(part)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def disturbed_runs(
    tables: Sequence[pd.DataFrame], runs: Sequence[str]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The roll-outs of ``runs`` under the disturbances that all of them have met; and notes.

    Arms of which some runs are missing cannot be compared: the notes name the disturbances that are
    left out, and the runs that have not met them.
    """
    frame = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    if frame.empty:
        return pd.DataFrame(), ()
    frame = pd.DataFrame(frame[frame[RUN].isin(list(runs))])
    lacking: dict[tuple[str, ...], list[str]] = {}
    for name, rows in frame.groupby(DISTURBANCE, sort=False):
        met = set(rows[RUN])
        lacking.setdefault(tuple(run for run in runs if run not in met), []).append(str(name))
    complete = frame[frame[DISTURBANCE].isin(lacking.pop((), []))]
    notes = (
        f"left out under disturbances: {', '.join(names)}, as these runs have not met them: "
        f"{', '.join(absent)}"
        for absent, names in lacking.items()
    )
    return pd.DataFrame(complete).reset_index(drop=True), tuple(notes)
