"""Metrics of a study as figures need them."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from analysis.data.study import RUN, Study
from analysis.figures.drawing import NotDrawnError
from analysis.statistics.paper import Band, seed_band
from tlr_exp import keys


@dataclass(frozen=True)
class Series:
    """One metric of one arm: seeds [n], iterations [T], values [n, T] without NaN."""

    seeds: np.ndarray
    iterations: np.ndarray
    values: np.ndarray

    @property
    def band(self) -> Band:
        """Mean over seeds and one standard deviation (n - 1) to both sides, each [T]."""
        return seed_band(self.values)


def series_of(study: Study, metric: str, arm: str) -> Series:
    """A metric of an arm in the iterations where all its runs have it.

    Raises:
        NotDrawnError: the arm has no value of the metric.
    """
    measured = metric in study.metric_names
    if not measured or study.curves.loc[study.curves["arm"] == arm, metric].isna().all():
        raise NotDrawnError(f"arm {arm!r} has no value of {metric}")
    try:
        return Series(*study.matrix(metric, arm))
    except ValueError as error:
        raise NotDrawnError(str(error)) from error


def all_series(study: Study, metric: str) -> dict[str, Series]:
    """``series_of`` for every arm.

    Raises:
        NotDrawnError: an arm has no value of the metric.
    """
    return {arm: series_of(study, metric, arm) for arm in study.arms}


def pair_of(study: Study, metric: str, arm: str) -> tuple[Series, Series]:
    """The baseline and another arm in the iterations that both have: they can be subtracted.

    Raises:
        NotDrawnError: the metric is missing in one, or they share no iteration.
    """
    pair = [series_of(study, metric, each) for each in (study.baseline, arm)]
    common = np.intersect1d(pair[0].iterations, pair[1].iterations)
    if len(common) == 0:
        raise NotDrawnError(f"{metric}: the two arms share no iteration in which it was measured")
    return _at(pair[0], common), _at(pair[1], common)


def _at(series: Series, iterations: np.ndarray) -> Series:
    columns = np.searchsorted(series.iterations, iterations)
    return Series(series.seeds, iterations, series.values[:, columns])


def shared_seeds(study: Study) -> tuple[int, ...]:
    """Seeds that every arm has, ascending; empty if there is none."""
    return tuple(sorted(set.intersection(*(set(study.seeds(arm)) for arm in study.arms))))


def one_run_of_each_arm(study: Study) -> tuple[Study, int]:
    """The study of one seed alone, the lowest that every arm has, and that seed.

    Raises:
        NotDrawnError: no seed is in every arm.
    """
    shared = shared_seeds(study)
    if not shared:
        raise NotDrawnError("no seed was run in every arm")
    return only_seeds(study, shared[:1]), shared[0]


def only_seeds(study: Study, seeds: tuple[int, ...]) -> Study:
    """The study with these seeds alone."""
    runs = study.runs[study.runs["seed"].isin(seeds)]
    curves = study.curves[study.curves["seed"].isin(seeds)]
    starts = study.starts
    if len(starts):
        starts = pd.DataFrame(starts[starts[RUN].isin(list(runs.index))])
    return replace(study, runs=runs, curves=curves, starts=starts)


def last_iteration(study: Study) -> int:
    """The last iteration that any run has reached."""
    return int(np.max(study.curves[keys.ITERATION]))


def column(study: Study, metric: str) -> np.ndarray:
    """A metric in every row of ``study.curves``, float64, NaN where it was not measured."""
    return np.asarray(study.curves[metric], dtype=np.float64)


def with_metric(study: Study, name: str, values: np.ndarray) -> Study:
    """The study with a metric added or replaced; one value per row of ``study.curves``."""
    return replace(study, curves=study.curves.assign(**{name: values}))
