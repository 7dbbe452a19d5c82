"""Tracking against what the lower layer costs: one point per run, without exploration noise."""

from dataclasses import dataclass

import numpy as np

from analysis.data.study import Study, StudyError
from analysis.measures.quantities import COST
from analysis.measures.rollouts import rollouts

BODIES = ("upper_body_error_m", "lower_body_error_m")


@dataclass(frozen=True, eq=False)
class Tradeoff:
    """Points of every arm [n, 2], one per seed: lower-layer cost, and mean error of both bodies.

    The error (m) is the mean of upper- and lower-body error, by which training chooses its best
    checkpoint. `source` says in words what was measured on. Arms without both are not there.
    """

    points: dict[str, np.ndarray]
    source: str


def tradeoff_of(study: Study) -> Tradeoff:
    """The points of a study.

    Raises:
        StudyError: nothing was measured without noise, or not the terms of the lower layer; the
            message is the reason, for a reader.
    """
    found = rollouts(study, with_terms=True)
    if found is None:
        raise StudyError("no roll-out or evaluation without noise is known of all runs")
    if found.lacking:
        raise StudyError(found.lacking)
    points = {}
    for arm in study.arms:
        if found.has(study, COST, arm) and all(found.has(study, body, arm) for body in BODIES):
            cost = found.of_arm(study, COST, arm)
            error = np.mean([found.of_arm(study, body, arm) for body in BODIES], axis=0)
            points[arm] = np.column_stack([cost, error])
    if not points:
        raise StudyError("no arm has both tracking errors and lower-layer cost in all its runs")
    return Tradeoff(points, found.source)
