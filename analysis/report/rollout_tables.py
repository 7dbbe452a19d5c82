"""Tables of what the runs do without exploration noise: tracking, lower layer, both together."""

from collections.abc import Sequence

import numpy as np

from analysis.data.study import StudyError
from analysis.measures.quantities import quantity_of_roll_out
from analysis.measures.tradeoff import tradeoff_of
from analysis.report.cells import NBSP, Table, interval_text, number, p_text
from analysis.report.evidence import SEED, Evidence
from analysis.report.outcomes import Outcome
from analysis.report.protocol_tables import against
from analysis.statistics.intervals import difference_interval
from analysis.statistics.pareto import compare_areas
from analysis.statistics.significance import permutation


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
    title = f"Both upright, same seed and same phase: {against(evidence)}"
    return Table(title, header, rows, note)


def _same_phase_row(outcome: Outcome) -> tuple[str, ...]:
    c, digits = outcome.paired or outcome.unpaired, outcome.digits
    arms = (c.baseline, c.treatment)
    return (
        f"{outcome.name} ({outcome.shown.unit})",
        *(f"{arm.mean.estimate:.{digits}f}{NBSP}±{NBSP}{number(arm.std, digits)}" for arm in arms),
        interval_text(c.difference, digits),
        interval_text(c.relative_improvement, 1, percent=True),
        p_text(c.t_test),
        p_text(c.permutation_test),
    )


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
    title = f"Tracking and lower layer together: {against(evidence)}"
    return Table(title, ("area", *evidence.labels, "difference", "p"), rows, note)


def cost_note(evidence: Evidence) -> str:
    """What was measured on, and why there is no cost where there is none."""
    found = evidence.rollouts_with_terms
    if found is None:
        return "The study has no roll-out or evaluation without noise that all its runs have."
    if found.lacking:
        return f"Measured on {found.source}. There is no lower-layer cost: {found.lacking}."
    shown = quantity_of_roll_out("lower_layer_cost")
    unit = shown.unit if shown else ""
    return (
        f"Measured on {found.source}. The lower-layer cost ({unit}) is what the baseline's "
        "penalties would take at weights 1, in every arm alike: so an arm that trains without a "
        "penalty is asked what it costs all the same. Terms are means of their raw values."
    )
