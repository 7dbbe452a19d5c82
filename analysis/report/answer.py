"""Writes what a report says first: the answer in three sentences, the longer list behind it."""

import json
import math
from collections.abc import Iterator, Sequence

import numpy as np

from analysis.data.settings import RECIPE
from analysis.data.study import Study, pretty_arm
from analysis.measures.quantities import COST, COST_OF_ROLL_OUT, quantity
from analysis.measures.rollouts import Rollouts
from analysis.measures.tradeoff import BODIES as ERRORS
from analysis.report.cells import NBSP, interval_text
from analysis.report.evidence import BODIES, Evidence
from analysis.report.judging.claims import Judged
from analysis.report.judging.judges import PAPER_CONTROL_STEPS
from analysis.report.judging.verdicts import CLAIMED, Verdict, moving_text, untracked_text
from analysis.statistics.intervals import relative_improvement_interval
from analysis.statistics.results import Interval
from tlr_exp import keys
from tlr_exp.config.nested import value_at

# Per cent, five seeds, Figure 13.
PAPER_IMPROVEMENT = {keys.TRAIN_UPPER_BODY_ERROR: 4.25, keys.TRAIN_LOWER_BODY_ERROR: 4.98}

# The figures that can carry an answer, the best first.
CARRIERS = ("tradeoff", "figure_13_seed_bands", "forest")


def answer(evidence: Evidence, judged: Judged) -> tuple[str, str, str]:
    """The answer: tracking in training; tracking and lower layer without noise; what it is worth.

    Raises:
        StudyError: the study has no tracking errors.
    """
    return _in_training(evidence, judged), _without_noise(evidence), _worth(evidence, judged)


def _in_training(evidence: Evidence, judged: Judged) -> str:
    intervals = {metric: evidence.relative_improvement(metric) for metric in BODIES}
    baseline, treatment = evidence.labels
    told = ", ".join(
        f"its {quantity(metric).name.lower()} is {change_text(each)}"
        for metric, each in intervals.items()
    )
    theirs = ""
    if judged:
        theirs = " (the paper: " + " and ".join(f"{v} %" for v in PAPER_IMPROVEMENT.values())
        theirs += " smaller)"
    verdict = together([*intervals.values()])
    return f"In training, {treatment} tracks {verdict} {baseline}: {told}{theirs}."


def change_text(improvement: Interval) -> str:
    """A relative improvement of something that is better smaller: "3.1 % smaller [1.2, 5.0]"."""
    if math.isnan(improvement.estimate):
        return "of no known share"
    smaller = improvement.estimate >= 0
    sign = 100.0 if smaller else -100.0
    text = f"{sign * improvement.estimate:.1f}{NBSP}% {'smaller' if smaller else 'larger'}"
    if math.isnan(improvement.low):
        return text
    low, high = sorted((sign * improvement.low, sign * improvement.high))
    return f"{text} [{low:.1f},{NBSP}{high:.1f}]"


def together(intervals: Sequence[Interval]) -> str:
    """In words, what the intervals of several errors say together, before the baseline's name."""
    if any(math.isnan(each.low) for each in intervals):
        return "in a way that so few seeds cannot hold against"
    if all(each.low > 0 for each in intervals):
        return "better than"
    if all(each.high < 0 for each in intervals):
        return "worse than"
    if all(each.low <= 0 <= each.high for each in intervals):
        return "in a way that these seeds do not tell from"
    if any(each.low > 0 for each in intervals):
        harm = any(each.high < 0 for each in intervals)
        return f"better in one body and {'worse' if harm else 'no worse'} in the other than"
    return "worse in one body and no better in the other than"


def _without_noise(evidence: Evidence) -> str:
    found, (baseline, treatment) = evidence.rollouts, evidence.labels
    where = f"Without exploration noise and compared with {baseline}, {treatment}"
    error = cost = None
    if found is not None:
        error, cost = improvements(evidence, found)
    if found is None or error is None:
        return "How the policies move without exploration noise these data do not say."
    told = f"the mean error of both bodies is {change_text(error)}"
    if cost is None:
        return (
            f"{where} {TRACKING[_kind(error)]}: {told} ({found.source}); what the lower layer "
            "costs was not measured in them."
        )
    price = f"the {COST_OF_ROLL_OUT[COST].name.lower()} is {change_text(cost)}"
    return f"{where} {position(error, cost)}: {told}, {price} ({found.source})."


def improvements(evidence: Evidence, found: Rollouts) -> tuple[Interval | None, Interval | None]:
    """Relative improvement of tracking error and of lower-layer cost, over the seeds.

    The error is the mean of both bodies'. None where not every run of both arms has it.
    """
    arms = (evidence.baseline, evidence.treatment)
    whole = [name for name in (*ERRORS, COST) if found.has(evidence.study, name, *arms)]

    def improvement(names: Sequence[str]) -> Interval | None:
        if not set(names) <= set(whole):
            return None
        first, second = (
            np.mean([found.of_arm(evidence.study, name, arm) for name in names], axis=0)
            for arm in arms
        )
        return relative_improvement_interval(first, second, smaller_is_better=True)

    return improvement(ERRORS), improvement([COST])


TRACKING = {
    "better": "tracks better",
    "worse": "tracks worse",
    "equal": f"tracks as well (at most {100 * CLAIMED:.0f} % worse)",
    "unknown": "cannot be told apart in tracking",
}
MOVING = {
    "better": "moves at less cost",
    "worse": "moves at more cost",
    "equal": f"moves at the same cost (at most {100 * CLAIMED:.0f} % more)",
    "unknown": "cannot be told apart in what the lower layer costs",
}


def position(error: Interval, cost: Interval) -> str:
    """In words, where an arm lies in tracking and lower-layer cost, from its improvements.

    "As well" needs an interval that leaves out everything that is more than 5 % worse; not to be
    told apart is not enough.
    """
    return f"{TRACKING[_kind(error)]} and {MOVING[_kind(cost)]}"


def _kind(improvement: Interval) -> str:
    if math.isnan(improvement.low):
        return "unknown"
    if improvement.low > 0:
        return "better"
    if improvement.high < 0:
        return "worse"
    return "equal" if improvement.low > -CLAIMED else "unknown"


def _worth(evidence: Evidence, judged: Judged) -> str:
    study, reason = evidence.study, untracked_text(evidence)
    arms = (evidence.baseline, evidence.treatment)
    seeds = " and ".join(dict.fromkeys(str(len(study.seeds(arm))) for arm in arms))
    size = f"{evidence.control_steps_per_run / 1e6:.3g} million control steps"
    text = f"This rests on {seeds} seeds an arm, {size}"
    if judged:
        text += f" each; of {len(judged)} claims of the paper, {_counts(judged)}"
    else:
        text += " each"
    return f"{text}: {reason}." if reason else f"{text}."


def _counts(judged: Judged) -> str:
    counts = {verdict: sum(f.verdict == verdict for _, f in judged) for verdict in Verdict}
    return ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)


# --- the longer list -------------------------------------------------------------------------
def summary(evidence: Evidence, judged: Judged) -> Iterator[str]:
    """What is behind the answer, a sentence each, and the notes of the study."""
    baseline, treatment = evidence.labels
    which_is_better = (
        f"{treatment} is better.",
        f"{baseline} is better.",
        "These seeds do not tell the arms apart.",
    )
    for metric, claimed in PAPER_IMPROVEMENT.items():
        interval = evidence.relative_improvement(metric)
        text = interval_text(interval, 1, percent=True)
        theirs = f" (the paper: +{claimed} %). {support(interval)}" if judged else ""
        yield (
            f"{quantity(metric).name}, mean over training: relative improvement of "
            f"{treatment} over {baseline} "
            f"{text}{theirs or '. ' + support(interval, which_is_better)}"
        )
    if judged:
        yield f"Of {len(judged)} claims of the paper: {_counts(judged)}."
    share = evidence.control_steps_per_run / PAPER_CONTROL_STEPS
    yield (
        f"Each run took {evidence.control_steps_per_run:.3g} control steps, "
        f"{100 * share:.2g} % of the paper's."
    )
    moving = moving_text(evidence)
    yield f"{moving[0].upper()}{moving[1:]}."
    yield from evidence.study.notes


_SUPPORT = (
    "These data support an improvement.",
    "These data do not support the paper: the two-layered arm is worse.",
    "These data do not support the paper: they do not tell the arms apart.",
)


def support(interval: Interval, words: tuple[str, str, str] = _SUPPORT) -> str:
    """In plain words, whether the seeds show that the second arm is better, worse, or neither."""
    better, worse, untold = words
    if math.isnan(interval.low):
        return f"Nothing can be concluded: {interval.reason}."
    if interval.low > 0:
        return better
    return worse if interval.high < 0 else untold


def subtitle(study: Study) -> str:
    """Motion, scale, recipe, arms and seeds of a study."""
    runs = study.runs
    seeds = " / ".join(str(len(study.seeds(arm))) for arm in study.arms)
    size = f"{runs['num_envs'].iloc[0]} environments, {study.iterations} iterations"
    motion = ", ".join(sorted(runs["motion"].unique()))
    scale = ", ".join(sorted(runs["scale"].unique()))
    recipe = ", ".join(sorted({value_at(json.loads(c), RECIPE) or "paper" for c in runs["config"]}))
    arms = ", ".join(pretty_arm(arm) for arm in study.arms)
    return (
        f"Motion {motion}; scale {scale}: {size}; recipe {recipe}; arms: {arms}; "
        f"seeds per arm: {seeds}."
    )


def banner(study: Study) -> str:
    """What a run of this scale is evidence for, where that is nothing."""
    if "demo" not in set(study.runs["scale"]):
        return ""
    config = json.loads(study.runs["config"].iloc[0])
    evidence = config["scale"].get("evidence", "shows that the machinery works")
    return f"A run of this scale {evidence}."
