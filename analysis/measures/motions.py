"""Measures to compare over several motions: one number per run, motion by motion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.data.study import Study, StudyError
from analysis.measures.endpoints import tail_mean
from analysis.measures.quantities import (
    COST_OF_ROLL_OUT,
    EFFORT_OF_ROLL_OUT,
    TRACKING_OF_ROLL_OUT,
    TRAINING,
    Quantity,
    quantity,
)
from analysis.measures.rollouts import rollouts

LAST_FIFTH = "last 20 % of the training"
WITHOUT_NOISE = "without noise"

ByMotion = dict[str, np.ndarray]


@dataclass(frozen=True)
class OverMotions:
    """A measure of two arms on every motion.

    measure: as in metrics, or in the CSV of roll-outs. endpoint: what of it. baseline, treatment:
    by motion, one number per seed [n].
    """

    measure: str
    shown: Quantity
    endpoint: str
    baseline: ByMotion
    treatment: ByMotion

    @property
    def name(self) -> str:
        """The measure in words and what of it."""
        return f"{self.shown.label}, {self.endpoint}"


def over_motions(studies: Mapping[str, Study], treatment: str) -> list[OverMotions]:
    """Every measure that all runs of both arms have on all motions: without noise, then training.

    studies: by motion, with the same arms.
    """
    moved = {motion: rollouts(study) for motion, study in studies.items()}

    def without_noise(measure: str, motion: str, arm: str) -> np.ndarray | None:
        found, study = moved[motion], studies[motion]
        if found is None or not found.has(study, measure, arm):
            return None
        return found.of_arm(study, measure, arm).to_numpy()

    def at_the_end(metric: str, motion: str, arm: str) -> np.ndarray | None:
        try:
            _, iterations, curves = studies[motion].matrix(metric, arm)
        except StudyError:
            return None
        return tail_mean(curves, iterations)

    rolled = TRACKING_OF_ROLL_OUT | EFFORT_OF_ROLL_OUT | COST_OF_ROLL_OUT
    asked = [
        *((name, shown, WITHOUT_NOISE, without_noise) for name, shown in rolled.items()),
        *((name, quantity(name), LAST_FIFTH, at_the_end) for name in TRAINING),
    ]
    found = []
    for name, shown, endpoint, values in asked:
        arms = _of_both(studies, treatment, partial(values, name))
        if arms is not None:
            found.append(OverMotions(name, shown, endpoint, *arms))
    return found


def _of_both(
    studies: Mapping[str, Study],
    treatment: str,
    values_of: Callable[[str, str], np.ndarray | None],
) -> tuple[ByMotion, ByMotion] | None:
    """The values of the baseline and of the treatment by motion; None where one is missing."""
    arms: tuple[ByMotion, ByMotion] = ({}, {})
    for motion, study in studies.items():
        for by_motion, arm in zip(arms, (study.baseline, treatment), strict=True):
            values = values_of(motion, arm)
            if values is None:
                return None
            by_motion[motion] = values
    return arms
