"""Tables of how two arms compare: seeds, tests, whole curves, speed, the lower layer."""

import math
from collections.abc import Sequence
from itertools import count

import numpy as np

from analysis.data.study import StudyError
from analysis.measures.endpoints import iterations_to_reach, tail_mean
from analysis.measures.quantities import TRAINING, quantity
from analysis.measures.tradeoff import tradeoff_of
from analysis.report.cells import (
    MISSING,
    NBSP,
    Table,
    interval_text,
    number,
    p_text,
    p_value_text,
    spread_text,
)
from analysis.report.evidence import SEED, Evidence
from analysis.report.judging.verdicts import ALPHA
from analysis.report.outcomes import EVALUATION, Outcome
from analysis.statistics.comparison import Comparison
from analysis.statistics.curves import compare_curves
from analysis.statistics.intervals import difference_interval
from analysis.statistics.pareto import compare_areas
from analysis.statistics.significance import holm, permutation, smallest_p

SMOOTHING_SHARE = 0.02  # of training, before a curve is held against a level


def seeds_table(evidence: Evidence, found: Sequence[Outcome]) -> Table:
    """What the seeds can say: means, difference, improvement, effect."""
    rows = tuple(_seeds_row(o) for o in found)
    header = (
        *("measure", *evidence.labels, "difference", "improvement"),
        *("Hedges g", "P(better)", "interquartile means"),
    )
    note = (
        "Mean ± standard deviation over seeds. Difference: the second arm less the first, with "
        "Welch's 95 % interval. Improvement: of the mean, Fieller's interval. Hedges g is positive "
        "and P(better), the share of pairs of runs in which the second arm's is the better one, is "
        "above 0.5 where the second arm is better."
    )
    return Table(f"Means: {evidence.versus}", header, rows, note)


def _seeds_row(outcome: Outcome) -> tuple[str, ...]:
    c, digits = outcome.unpaired, outcome.digits
    return (
        *_means(outcome, c),
        interval_text(c.effect_size, 2),
        number(c.probability_of_improvement, 2),
        " / ".join(number(arm.interquartile_mean, digits) for arm in (c.baseline, c.treatment)),
    )


def _means(outcome: Outcome, c: Comparison) -> tuple[str, ...]:
    """Measure, mean of either arm, their difference, and the improvement."""
    digits, unit = outcome.digits, f" ({outcome.shown.unit})" if outcome.shown.unit else ""
    return (
        f"{outcome.name}{unit}",
        *(spread_text(arm.mean.estimate, arm.std, digits) for arm in (c.baseline, c.treatment)),
        interval_text(c.difference, digits),
        interval_text(c.relative_improvement, 1, percent=True),
    )


def tests_table(evidence: Evidence, found: Sequence[Outcome]) -> Table:
    """p-values of all tests, adjusted over the measures, and what so many seeds can give at all."""
    adjusted = (
        holm([o.unpaired.t_test.p_value for o in found]),
        holm([o.unpaired.permutation_test.p_value for o in found]),
    )
    rows = tuple(_tests_row(o, *p) for o, *p in zip(found, *adjusted, strict=True))
    header = (
        *("measure", "Welch t", "Welch t, Holm", "permutation", "permutation, Holm"),
        *("Mann-Whitney", "paired t", "sign flips", "Wilcoxon", "seeds for 80 % power"),
    )
    return Table(f"Tests: {evidence.versus}", header, rows, _tests_note(evidence, found))


def _tests_row(outcome: Outcome, welch: float, permutation: float) -> tuple[str, ...]:
    free, shared = outcome.unpaired, outcome.paired
    needed = free.seeds_needed
    return (
        outcome.name,
        p_text(free.t_test),
        p_value_text(welch),
        p_text(free.permutation_test),
        p_value_text(permutation),
        p_text(free.rank_test),
        *(
            (MISSING,) * 3
            if shared is None
            else (p_text(shared.t_test), p_text(shared.permutation_test), p_text(shared.rank_test))
        ),
        MISSING if needed is None else str(needed),
    )


def _tests_note(evidence: Evidence, found: Sequence[Outcome]) -> str:
    if not found:
        return ""
    free, shared = found[0].unpaired, found[0].paired
    counts = free.baseline.num_seeds, free.treatment.num_seeds
    text = (
        "Two-sided p-values. The columns Holm are adjusted for the number of rows, "
        f"{len(found)}; the others are not. {counts[0]} against {counts[1]} seeds cannot give an "
        f"exact p below {free.smallest_p:.2g}"
    )
    if shared is not None:
        text += f", nor paired below {shared.smallest_p:.2g}"
    if math.isfinite(free.detectable_effect):
        text += (
            f". With 80 % power they find only differences of {free.detectable_effect:.1f} "
            "standard deviations or more"
        )
    said = [text, *_out_of_reach(found), *_reasons(found), *_left_out(evidence)]
    return ". ".join(said) + "."


def _out_of_reach(found: Sequence[Outcome]) -> list[str]:
    """Whether so many rows and so few seeds leave the adjusted exact p any way below 0.05."""
    free = found[0].unpaired
    smallest = min(1.0, len(found) * free.smallest_p)
    if smallest <= ALPHA:
        return []
    enough = next(n for n in count(2) if len(found) * smallest_p(n, n) <= ALPHA)
    text = (
        f"Adjusted for {len(found)} rows an exact p of so many seeds is {smallest:.2g} at the "
        f"least: none can fall below {ALPHA:g}, whatever the data. {enough} seeds per arm are the "
        "fewest that can"
    )
    return [text + ", which is a reason for ten" if enough <= 10 else text]


def _reasons(found: Sequence[Outcome]) -> list[str]:
    """Why some cells are n/a: each reason once, with its measures unless it is all of them."""
    measures: dict[str, list[str]] = {}
    for outcome in found:
        for c in filter(None, (outcome.unpaired, outcome.paired)):
            for part in (c.difference, c.relative_improvement, c.t_test, c.effect_size):
                if part.reason and outcome.name not in measures.setdefault(part.reason, []):
                    measures[part.reason].append(outcome.name)
    return [
        reason[0].upper() + reason[1:] + ("" if len(names) == len(found) else f" ({_list(names)})")
        for reason, names in measures.items()
    ]


def _left_out(evidence: Evidence) -> list[str]:
    absent = [
        quantity(metric).name
        for metric in (*TRAINING, *EVALUATION)
        if metric in evidence.study.metric_names and not evidence.has(metric)
    ]
    return [f"Without an iteration in which all runs have it: {_list(absent)}"] if absent else []


def same_phase_table(evidence: Evidence, found: Sequence[Outcome]) -> Table:
    """Errors of the roll-outs from which both arms stay upright, paired by seed and phase."""
    rows = tuple(_same_phase_row(outcome) for outcome in found)
    header = (
        *("measure", *evidence.labels, "difference", "improvement"),
        *("paired t", "sign flips"),
    )
    note = (
        "Means ± standard deviation over seeds of a seed's mean over those phases from which both "
        "its policies stay upright to the end. Means over all upright roll-outs of each arm would "
        "compare different phases: the hard ones in the arm that falls less."
    )
    title = f"Both upright, same seed and same phase: {evidence.versus}"
    return Table(title, header, rows, note)


def _same_phase_row(outcome: Outcome) -> tuple[str, ...]:
    c = outcome.paired or outcome.unpaired
    return (*_means(outcome, c), p_text(c.t_test), p_text(c.permutation_test))


def area_table(evidence: Evidence) -> Table | None:
    """What each arm dominates in tracking error and lower-layer cost; None where unknown."""
    try:
        points = tradeoff_of(evidence.study).points
    except StudyError:
        return None
    if not {evidence.baseline, evidence.treatment} <= set(points):
        return None
    first, second = points[evidence.baseline], points[evidence.treatment]
    generator = np.random.default_rng(SEED)
    areas = compare_areas(first, second, generator=generator)
    alone = areas.of_runs
    rows = (
        (
            "the front of all seeds of an arm",
            number(areas.baseline, 3),
            number(areas.treatment, 3),
            f"{areas.test.statistic:+.3f}" if np.isfinite(areas.test.statistic) else "n/a",
            p_text(areas.test),
        ),
        (
            "each run alone, mean over seeds",
            *(number(float(each.mean()), 3) for each in alone),
            interval_text(difference_interval(*alone), 3),
            p_text(permutation(*alone, generator=generator)),
        ),
    )
    note = (
        "The area that lies behind the runs in the plane of mean tracking error and lower-layer "
        "cost (hypervolume), as a share of the box from the best of each to a tenth of the range "
        "beyond the worst; larger is better. p: permutation of the seeds between the arms, not "
        "adjusted. Area does not say what is worth more: an arm that tracks better at a higher "
        "cost can gain or lose it; see both axes."
    )
    title = f"Tracking and lower layer together: {evidence.versus}"
    return Table(title, ("area", *evidence.labels, "difference", "p"), rows, note)


def curves_table(evidence: Evidence) -> Table:
    """Whole curves, compared by permuting the labels of the seeds."""
    rows, note = [], ""
    for metric in filter(evidence.has, TRAINING):
        at, first, second = evidence.common(metric)
        if min(len(first), len(second)) < 2:
            continue
        found = compare_curves(first, second, generator=np.random.default_rng(SEED))
        places = at[found.differs]
        where = f"{places.min()} to {places.max()}" if places.size else "nowhere"
        share = f"{100 * found.differs.mean():.0f}{NBSP}%"
        rows.append((quantity(metric).name, p_value_text(found.p_value), share, where))
        note = (
            "The largest t statistic over all iterations against the largest under every other "
            "labeling of the seeds: the chance to call any iteration different where none is, is "
            "at most 5 %, however neighbouring iterations depend on each other."
        )
        if found.smallest_p > found.alpha:
            note += (
                f" So few seeds cannot give a p below {found.smallest_p:.2g}: nothing can differ "
                "here, whatever the curves."
            )
    header = ("curve", "p, anywhere", "iterations that differ", "from the first to the last")
    return Table(f"Whole curves: {evidence.versus}", header, tuple(rows), note)


def speed_table(evidence: Evidence) -> Table:
    """Iterations until an arm is as good as the baseline ends."""
    rows = []
    for metric in filter(evidence.has, TRAINING):
        at, first, second = evidence.common(metric)
        level = float(tail_mean(first, at).mean())
        window = max(1, round(SMOOTHING_SHARE * at.size))
        better = not quantity(metric).larger_is_better
        times = (
            iterations_to_reach(values, at, level, smaller_is_better=better, window=window)
            for values in (first, second)
        )
        rows.append((f"{quantity(metric).name}: {level:.4g}", *(_times_text(t) for t in times)))
    note = (
        "Median over the seeds that got there. The level is the first arm's mean over the last "
        "20 %; a curve reaches it when its mean over 2 % of training is as good."
    )
    title = f"Iterations to reach a level: {evidence.versus}"
    return Table(title, ("level", *evidence.labels), tuple(rows), note)


def _times_text(times: np.ndarray) -> str:
    reached = times[np.isfinite(times)]
    count = f"{reached.size} of {times.size} seeds"
    return f"{np.median(reached):.0f} ({count})" if reached.size else f"never ({count})"


def _list(names: Sequence[str]) -> str:
    return "; ".join(names)
