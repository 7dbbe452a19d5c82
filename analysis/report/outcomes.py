"""Compares two arms in every metric at its endpoints, over the seeds."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from analysis.measures.endpoints import area_under_curve, final_value, tail_mean
from analysis.measures.quantities import (
    AT_EQUAL_AGES,
    COST_OF_ROLL_OUT,
    EFFORT_OF_ROLL_OUT,
    TRACKING_OF_ROLL_OUT,
    TRAINING,
    Quantity,
    quantity,
    quantity_of_roll_out,
)
from analysis.measures.rollouts import Rollouts, lower_layer, same_phase
from analysis.report.evidence import Evidence
from analysis.statistics.comparison import Comparison
from analysis.statistics.results import Array
from tlr_exp import keys

Reduction = Callable[[np.ndarray, np.ndarray], np.ndarray]  # curves [n, T], iterations -> [n]

EVALUATION = tuple(
    keys.EVAL_PREFIX + name for name in ("upper_body_error_m", "lower_body_error_m", "survival")
)
SAME_PHASE = ("upper_body_error_m", "lower_body_error_m", "joint_error_rad")
_DIGITS = {"m": 4, "control steps": 1, "share of roll-out": 3, "share of roll-outs": 3, "ms": 1}
_SIGNIFICANT = 4  # digits of a value in any other unit


@dataclass(frozen=True)
class Outcome:
    """One metric at one endpoint, compared over the seeds, unpaired and (if possible) paired."""

    metric: str
    endpoint: str
    shown: Quantity
    unpaired: Comparison
    paired: Comparison | None

    @property
    def name(self) -> str:
        return f"{self.shown.name}, {self.endpoint}" if self.endpoint else self.shown.name

    @property
    def digits(self) -> int:
        """Decimals of a value in a table: fixed for the usual units, else for four digits."""
        fixed = _DIGITS.get(self.shown.unit)
        size = abs(self.unpaired.baseline.mean.estimate)
        if fixed is not None or size == 0.0:
            return 3 if fixed is None else fixed
        return max(0, _SIGNIFICANT - 1 - math.floor(math.log10(size)))


def digits_of(metric: str) -> int:
    """Decimals of a value of a metric of the training in a table."""
    return _DIGITS.get(quantity(metric).unit, 3)


def outcomes(evidence: Evidence) -> list[Outcome]:
    """Every metric of the study at its endpoints, without those that no iteration has of all."""
    plan = [
        *((metric, "last 20 %", tail_mean) for metric in (*TRAINING, *AT_EQUAL_AGES)),
        *((metric, "whole training", area_under_curve) for metric in TRAINING),
        *((metric, "last", final_value) for metric in EVALUATION),
    ]
    return [_outcome(evidence, *row) for row in plan if evidence.has(row[0])]


def _outcome(evidence: Evidence, metric: str, endpoint: str, reduce: Reduction) -> Outcome:
    at, first, second = evidence.common(metric)
    if reduce is final_value and at[-1] != evidence.study.iterations:
        endpoint = f"{endpoint} that all have, iteration {at[-1]}"
    values = reduce(first, at), reduce(second, at)
    return _compared(evidence, metric, endpoint, quantity(metric), values, evidence.paired)


def _compared(
    evidence: Evidence,
    metric: str,
    endpoint: str,
    shown: Quantity,
    values: tuple[Array, Array],
    shared_seeds: bool,
) -> Outcome:
    unpaired = evidence.compare(*values, shown, paired=False)
    paired = evidence.compare(*values, shown, paired=True) if shared_seeds else None
    return Outcome(metric, endpoint, shown, unpaired, paired)


# --- without noise ---------------------------------------------------------------------------
def tracking_outcomes(evidence: Evidence) -> list[Outcome]:
    """How well the roll-outs from start phases track; empty where the study has no such table."""
    if len(evidence.study.starts) == 0:
        return []
    return _of_rollouts(evidence, evidence.rollouts, TRACKING_OF_ROLL_OUT)


def lower_layer_outcomes(evidence: Evidence) -> list[Outcome]:
    """What the motion costs by the lower layer, together and by term, and what it takes to make."""
    terms = (keys.REWARD_TERM_PREFIX + name for name in lower_layer(evidence.study))
    measures = (*COST_OF_ROLL_OUT, *terms, *EFFORT_OF_ROLL_OUT)
    return _of_rollouts(evidence, evidence.rollouts_with_terms, measures)


def _of_rollouts(
    evidence: Evidence, found: Rollouts | None, measures: Iterable[str]
) -> list[Outcome]:
    """A row for each measure that every run of both arms has."""
    arms = (evidence.baseline, evidence.treatment)
    rows = []
    for measure in measures:
        shown = quantity_of_roll_out(measure)
        if found is None or shown is None or not found.has(evidence.study, measure, *arms):
            continue
        first, second = (found.of_arm(evidence.study, measure, arm).to_numpy() for arm in arms)
        rows.append(_compared(evidence, measure, "", shown, (first, second), evidence.paired))
    return rows


def same_phase_outcomes(evidence: Evidence) -> list[Outcome]:
    """Errors of the roll-outs from which both arms stay upright, seed by seed, phase by phase.

    Only as a paired comparison: each seed's number is a mean over the same phases in both arms.
    """
    rows = []
    for measure in SAME_PHASE:
        found = same_phase(evidence.study, measure, evidence.treatment)
        shown = quantity_of_roll_out(measure)
        if found is None or shown is None:
            continue
        endpoint = f"{found.pairs} of {found.out_of} pairs, {len(found.seeds)} seeds"
        values = found.baseline, found.treatment
        rows.append(_compared(evidence, measure, endpoint, shown, values, True))
    return rows
