"""Verdicts on claims from intervals over seeds, and whether it is too early for one.

A claim about policies that track is judged where policies track. A verdict on two arms stands
unless their curves show that more training would take it back: still moving, at rates that close
the gap within another training as long. Both are asked of these runs, by tests over their seeds.
"""

from enum import StrEnum

import numpy as np

from analysis.measures.endpoints import TAIL_SHARE, tail_mean
from analysis.measures.quantities import SUCCESS, quantity
from analysis.report.cells import NBSP, interval_text, p_text
from analysis.report.evidence import BODIES, Evidence, prediction_limits
from analysis.statistics.intervals import difference_interval
from analysis.statistics.results import Interval
from analysis.statistics.slope import TailChange, tail_change

TRACKS = 0.5  # of the roll-outs, or of the way through the motion, in the better arm at least
ALPHA = 0.05
CLAIMED = 0.05  # the paper's improvements are 4 and 5 %
_LAST = "the last fifth of training"
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


# --- whether the runs have come far enough ----------------------------------------------------
def tracked(evidence: Evidence) -> tuple[str, tuple[float, float]] | None:
    """By which measure the policies track, and its mean in both arms; None if none was measured.

    Success, the share of roll-outs without noise that no failure would have ended, where there are
    several; else survival, the share of the motion before the first failure.
    """
    found, arms = evidence.rollouts, (evidence.baseline, evidence.treatment)
    for measure in (SUCCESS, "survival"):
        if found is not None and found.has(evidence.study, measure, *arms):
            first, second = (found.of_arm(evidence.study, measure, arm).mean() for arm in arms)
            return measure, (float(first), float(second))
    return None


def policies_track(evidence: Evidence) -> bool:
    """Whether the policies of one arm track at least; without a measure, whether curves are flat.

    Flat: no tracking error changes by more than `CLAIMED` over the last fifth of training in a way
    that the seeds show.
    """
    known = tracked(evidence)
    if known is not None:
        return max(known[1]) >= TRACKS
    return not any(_falls(change) for change in changes(evidence).values())


def too_early(evidence: Evidence) -> str:
    """Why nothing can be said of policies that track; empty where some do."""
    if policies_track(evidence):
        return ""
    return "; ".join(filter(None, (untracked_text(evidence), moving_text(evidence))))


def untracked_text(evidence: Evidence) -> str:
    """In words, how far the policies are from tracking; empty where they do, or none was asked."""
    known = tracked(evidence)
    if known is None or policies_track(evidence):
        return ""
    measure, shares = known
    what = {SUCCESS: "of the roll-outs succeed", "survival": "of the motion is survived"}[measure]
    each = " and ".join(
        f"{100 * share:.0f}{NBSP}% ({label})"
        for share, label in zip(shares, evidence.labels, strict=True)
    )
    return f"the policies do not track yet, {each} {what} without noise"


def changes(evidence: Evidence) -> dict[tuple[str, str], TailChange]:
    """By metric and arm label, how much the tracking errors change at the end of training."""
    found = {}
    for metric in filter(evidence.has, BODIES):
        at, *both = evidence.common(metric)
        for label, values in zip(evidence.labels, both, strict=True):
            found[metric, label] = tail_change(values, at)
    return found


def _falls(change: TailChange) -> bool:
    return bool(change.test.p_value < ALPHA and change.mean.estimate < -CLAIMED)


def moving_text(evidence: Evidence) -> str:
    """In words, which errors still change in the last fifth, by how much, and by which p-value."""
    parts = []
    for (metric, label), change in changes(evidence).items():
        if change.test.p_value < ALPHA:
            text = interval_text(change.mean, 1, percent=True)
            parts.append(f"{quantity(metric).name} {label} {text}, p = {p_text(change.test)}")
    if not parts:
        return f"no error changes in {_LAST} in a way that the seeds show"
    return f"the errors still change in {_LAST}: {'; '.join(parts)} (slopes, t over seeds)"


def taken_back(evidence: Evidence, metric: str) -> str:
    """Why more training might turn what the arms differ by in a metric; empty where it stands.

    The slopes of the last fifth, one per seed, are compared between the arms by Welch's t. Where
    they differ such that the gap closes, and would be gone within five more such fifths, the runs
    do not say how it ends.
    """
    at, first, second = evidence.common(metric)
    slopes = [tail_change(values, at).by_seed for values in (first, second)]
    if not all(np.isfinite(each).all() for each in slopes):
        return ""
    closing = difference_interval(*slopes)
    gap = float(np.log(tail_mean(second, at).mean() / tail_mean(first, at).mean()))
    if not np.isfinite(closing.low) or closing.low <= 0.0 <= closing.high:
        return ""
    if gap * closing.estimate >= 0.0 or abs(gap) > abs(closing.estimate) / TAIL_SHARE:
        return ""
    return (
        f"the gap closes: {quantity(metric).name.lower()} of {evidence.labels[1]} changes by "
        f"{interval_text(closing, 1, percent=True)} points more than that of "
        f"{evidence.labels[0]} in {_LAST} (slopes, Welch t over seeds), and another training as "
        "long would take the difference away"
    )
