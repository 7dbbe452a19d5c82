"""Tests whether a swept number matters, over runs at several values, the run as the unit.

``values`` [k] are the settings, ``samples`` as many arrays [n_i], one number per run. The runs at
different values count as independent, which is on the safe side where they share their seeds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.results import (
    DRAWN_LABELINGS,
    Array,
    SignificanceTest,
    checked_sample,
    is_constant,
    undefined_test,
)
from tlr_exp.errors import UserError


@dataclass(frozen=True)
class Trend:
    """What the runs say of a swept number.

    monotone: Spearman's rank correlation of value and result, by permutation of the runs; its
        statistic is the correlation: +1 where the result grows with the value without exception.
    any_difference: Kruskal and Wallis' H, by permutation of the runs: does the value matter in any
        way at all, such as best in the middle?
    """

    monotone: SignificanceTest
    any_difference: SignificanceTest


def trend(
    values: ArrayLike, samples: Sequence[ArrayLike], *, generator: np.random.Generator
) -> Trend:
    """Both tests; p-values two-sided for the correlation, of larger H for the other.

    Exact up to seven runs, whose 5040 orders are all tried; beyond, ``DRAWN_LABELINGS`` orders are
    drawn from ``generator``. NaN with a reason where the runs do not vary, or (H) where
    no value has two runs.

    Raises:
        ValueError: fewer than two different values, not one sample for each, or numbers that are
            not finite.
    """
    at = checked_sample(values, "values")
    if at.size != len(samples) or np.unique(at).size != at.size or at.size < 2:
        raise UserError(
            f"a trend needs two or more different values with one sample each, got {at.tolist()} "
            f"and {len(samples)} samples"
        )
    groups = [
        checked_sample(sample, f"sample of {v:g}") for v, sample in zip(at, samples, strict=True)
    ]
    results = np.concatenate(groups)
    sizes = np.array([group.size for group in groups])
    return Trend(
        _spearman(np.repeat(at, sizes), results, generator),
        _kruskal(groups, results, generator),
    )


def _spearman(at: Array, results: Array, generator: np.random.Generator) -> SignificanceTest:
    name = "Spearman, permutation"
    if is_constant(results):
        return undefined_test(name, "the runs do not vary")
    scores, of_results = (_standardized_ranks(each) for each in (at, results))

    def correlation(ranks: Array, axis: int) -> Array:
        return np.mean(np.moveaxis(ranks, axis, -1) * scores, axis=-1)

    shuffled = _shuffled(of_results, correlation, "two-sided", generator)
    return SignificanceTest(name, float(shuffled.statistic), float(shuffled.pvalue))


def _standardized_ranks(values: Array) -> Array:
    return np.asarray(stats.zscore(stats.rankdata(values)))


def _kruskal(
    groups: Sequence[Array], results: Array, generator: np.random.Generator
) -> SignificanceTest:
    name = "Kruskal-Wallis, permutation"
    sizes = np.array([group.size for group in groups])
    if is_constant(results):
        return undefined_test(name, "the runs do not vary")
    if sizes.max() < 2:
        return undefined_test(name, "one run per value shows no spread")
    starts = np.cumsum(sizes) - sizes

    def grows_with_h(ranks: Array, axis: int) -> Array:
        # Shuffling the runs changes nothing else in H, its correction for ties included.
        sums = np.add.reduceat(np.moveaxis(ranks, axis, -1), starts, axis=-1)
        return np.sum(sums**2 / sizes, axis=-1)

    shuffled = _shuffled(stats.rankdata(results), grows_with_h, "greater", generator)
    statistic = float(stats.kruskal(*groups).statistic)
    return SignificanceTest(name, statistic, float(shuffled.pvalue))


def _shuffled(
    ranks: Array,
    statistic: Callable[..., Array],
    alternative: Literal["two-sided", "greater"],
    generator: np.random.Generator,
) -> Any:
    """SciPy's result of a statistic of ranks [n] under shuffling of the runs between the values."""
    return stats.permutation_test(
        (ranks,),
        statistic,
        permutation_type="pairings",
        alternative=alternative,
        vectorized=True,
        n_resamples=DRAWN_LABELINGS,
        rng=generator,
    )
