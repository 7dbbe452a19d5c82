"""Verdicts on the paper's claims, from intervals over seeds."""

from enum import StrEnum

import numpy as np

from analysis.report.evidence import prediction_limits
from analysis.statistics.results import Interval

RANDOM_WEIGHT = 0.5  # the mean of weights drawn evenly from [0, 1]


class Verdict(StrEnum):
    """What can be said of a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    CANNOT_SAY = "cannot be said"


def above_zero(interval: Interval, above: str, below: str) -> tuple[Verdict, str]:
    """A verdict on the claim that a quantity is above zero, from its interval.

    `above` and `below` say what it means if the quantity is that.
    """
    if np.isnan(interval.low):
        return Verdict.CANNOT_SAY, interval.reason
    limits = f"the {100 * interval.confidence:.0f} % interval over seeds"
    if interval.low > 0:
        return Verdict.REPRODUCED, f"the {above}: {limits} is above zero"
    if interval.high < 0:
        return Verdict.NOT_REPRODUCED, f"the {below}: {limits} is below zero"
    return Verdict.CANNOT_SAY, f"{limits} contains zero: these seeds do not tell the arms apart"


def agreement(
    low: float, high: float, paper: float, nothing: float, nothing_is: str
) -> tuple[Verdict, str]:
    """A verdict on the paper's number from where one more run is expected, and a remark.

    Runs that scatter so widely that `nothing` is expected as well as the paper's number agree with
    everything, which reproduces nothing.
    """
    if not low <= paper <= high:
        return Verdict.NOT_REPRODUCED, ""
    if low <= nothing <= high:
        return Verdict.CANNOT_SAY, f", which holds the paper's number and {nothing_is} alike"
    return Verdict.REPRODUCED, ""


def around(values: np.ndarray, paper: float, together: int = 1) -> tuple[Verdict, str]:
    """A verdict on the claim that one run gave a weight near `paper`, from one number per seed [n].

    `together`: of so many weights, all at 95 % (Bonferroni).
    """
    if values.size < 2:
        return Verdict.CANNOT_SAY, "a single seed"
    low, high = prediction_limits(values, 1 - 0.05 / together)
    verdict, remark = agreement(low, high, paper, RANDOM_WEIGHT, "weights drawn at random")
    level = "95 %" if together == 1 else f"95 % for all {together}"
    return verdict, f"one more run is expected from {low:.2f} to {high:.2f} ({level}){remark}"
