"""Studies that sweep a number: which configuration key it is, and which arm has which value."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.data.settings import SEED
from analysis.data.study import Study
from analysis.measures.endpoints import tail_mean
from tlr_exp.config.checks import is_number
from tlr_exp.config.identity import NOT_IDENTITY
from tlr_exp.config.nested import covers, flat
from tlr_exp.config.versions import of_any_version


@dataclass(frozen=True)
class Sweep:
    """Arms along a swept number.

    key: the configuration key, "reward.objective.threshold_share".
    lines: per method with several values, its arms by value, ascending.
    references: the other arms by method, which have one value or none: "fixed" in a sweep of a
        setting of the weight search.
    """

    key: str
    lines: dict[str, dict[float, str]]
    references: dict[str, str]

    @property
    def values(self) -> tuple[float, ...]:
        """All values of the key, ascending."""
        return tuple(sorted({value for line in self.lines.values() for value in line}))


def sweep_of(study: Study) -> Sweep | None:
    """The number that the arms of a study differ in beside the method; None if there is none.

    None as well where methods differ inside in more than this one key: a grid has no one axis.
    """
    configs = {arm: _config(study, arm) for arm in study.arms}
    arms_of: dict[str, list[str]] = {}
    for arm in study.arms:
        method = str(study.runs.loc[study.runs["arm"] == arm, "method"].iloc[0])
        arms_of.setdefault(method, []).append(arm)
    differing = {key for arms in arms_of.values() for key in _differing(configs, arms)}
    if len(differing) != 1:
        return None
    (key,) = differing
    swept = {method: arms for method, arms in arms_of.items() if len(arms) > 1}
    given = {arm: configs[arm].get(key) for arms in swept.values() for arm in arms}
    values = {arm: float(value) for arm, value in given.items() if is_number(value)}
    if len(values) < len(given):
        return None
    return Sweep(
        key=key,
        lines={
            method: {values[arm]: arm for arm in sorted(arms, key=values.__getitem__)}
            for method, arms in swept.items()
        },
        references={method: arms[0] for method, arms in arms_of.items() if len(arms) == 1},
    )


def end_of_training(study: Study, metric: str, arm: str) -> np.ndarray:
    """One number per seed of an arm, [n]: the mean of the metric over the last 20 % of training.

    Raises:
        StudyError: no such arm or metric, or no iteration in which all its runs have it.
    """
    _, iterations, values = study.matrix(metric, arm)
    return tail_mean(values, iterations)


def _config(study: Study, arm: str) -> dict[str, Any]:
    """What the runs of an arm learn with, flat; they agree in it, or the study would not load."""
    text = study.runs.loc[study.runs["arm"] == arm, "config"].iloc[0]
    config, ignored = flat(of_any_version(json.loads(text))), (*NOT_IDENTITY, SEED)
    return {key: value for key, value in config.items() if not covers(ignored, key)}


def _differing(configs: dict[str, dict[str, Any]], arms: list[str]) -> set[str]:
    """Keys whose value is not the same in all these arms."""
    names = {key for arm in arms for key in configs[arm]}
    return {key for key in names if len({repr(configs[arm].get(key)) for arm in arms}) > 1}
