"""The numbers a finished run ends with, one per metric, so that runs can be sorted by them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean
from typing import Any

from tlr_exp.keys import (
    EPISODE_LENGTH,
    EVAL_PREFIX,
    FINAL_PREFIX,
    ITERATION,
    REWARD_TERM_PREFIX,
    TRAIN_JOINT_ERROR,
    TRAIN_LOWER_BODY_ERROR,
    TRAIN_UPPER_BODY_ERROR,
)

FINAL_SHARE = 0.2
AVERAGED = (EPISODE_LENGTH, TRAIN_UPPER_BODY_ERROR, TRAIN_LOWER_BODY_ERROR, TRAIN_JOINT_ERROR)


def final_metrics(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Final numbers from the lines of a finished run, in the order of iterations.

    final/NAME: the mean of train/NAME over the iterations past 80 % of the last one, in the unit
    of NAME (iterations without a value count neither way). final/eval_NAME: eval/NAME of the last
    iteration that has it. What was never measured is left out. Rounded to 9 significant digits, so
    that a list of them can be read.
    """
    if not rows:
        return {}
    last = _end_of(rows)
    final = {}
    for name in AVERAGED:
        if values := list(_finite(last, name)):
            final[f"{FINAL_PREFIX}{name.rpartition('/')[2]}"] = fmean(values)
    for row in rows:
        for name in row:
            if name.startswith(EVAL_PREFIX) and (values := list(_finite([row], name))):
                final[f"{FINAL_PREFIX}eval_{name.removeprefix(EVAL_PREFIX)}"] = values[0]
    return {name: float(f"{value:.9g}") for name, value in final.items()}


def final_terms(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Mean raw value of each reward term over the same iterations, by name of the term."""
    if not rows:
        return {}
    last = _end_of(rows)
    recorded = [name for name in rows[-1] if name.startswith(REWARD_TERM_PREFIX)]
    return {
        name.removeprefix(REWARD_TERM_PREFIX): fmean(values)
        for name in recorded
        if (values := list(_finite(last, name)))
    }


def _end_of(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    # Rounded, so that (1 - 0.2) * 15 does not keep iteration 12 in.
    start = round((1.0 - FINAL_SHARE) * rows[-1][ITERATION], 9)
    return [row for row in rows if row[ITERATION] > start]


def _finite(rows: Sequence[Mapping[str, Any]], name: str) -> Iterator[float]:
    for row in rows:
        value = row.get(name, math.nan)
        if math.isfinite(value):
            yield value
