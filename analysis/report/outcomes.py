"""What two arms are compared in: every metric at its endpoints, over the seeds."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.endpoints import area_under_curve, final_value, tail_mean
from analysis.quantities import TRAINING, quantity
from analysis.report.evidence import Evidence
from analysis.statistics.comparison import Comparison
from tlr_exp import keys

Reduction = Callable[[np.ndarray, np.ndarray], np.ndarray]  # curves [n, T], iterations -> [n]

EVALUATION = tuple(
    keys.EVAL_PREFIX + name for name in ("upper_body_error_m", "lower_body_error_m", "survival")
)
_DIGITS = {"m": 4, "control steps": 1}  # of a value in this unit; other values have three


@dataclass(frozen=True)
class Outcome:
    """One metric at one endpoint, compared over the seeds, unpaired and (if possible) paired."""

    metric: str
    endpoint: str
    unpaired: Comparison
    paired: Comparison | None

    @property
    def name(self) -> str:
        return f"{quantity(self.metric).name}, {self.endpoint}"

    @property
    def digits(self) -> int:
        return digits_of(self.metric)


def digits_of(metric: str) -> int:
    """Decimals of a value of this metric in a table."""
    return _DIGITS.get(quantity(metric).unit, 3)


def outcomes(evidence: Evidence) -> list[Outcome]:
    """Every metric of the study at its endpoints, without those that no iteration has of all."""
    plan = [
        *((metric, "last 20 %", tail_mean) for metric in TRAINING),
        *((metric, "whole training", area_under_curve) for metric in TRAINING),
        *((metric, "last", final_value) for metric in EVALUATION),
    ]
    return [_outcome(evidence, *row) for row in plan if evidence.has(row[0])]


def _outcome(evidence: Evidence, metric: str, endpoint: str, reduce: Reduction) -> Outcome:
    at, first, second = evidence.common(metric)
    values = reduce(first, at), reduce(second, at)
    if reduce is final_value and at[-1] != evidence.study.iterations:
        endpoint = f"{endpoint} that all have, iteration {at[-1]}"
    unpaired = evidence.compare(*values, metric, paired=False)
    paired = evidence.compare(*values, metric, paired=True) if evidence.paired else None
    return Outcome(metric, endpoint, unpaired, paired)
