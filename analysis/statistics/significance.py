"""Tests of two arms with the seed as the unit: one number per seed.

All tests are two-sided. ``baseline`` [n] and ``treatment`` [m] are independent seeds; in the paired
versions both are [n], and element i of both belongs to the same seed.
"""

import warnings
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.results import (
    DRAWN_LABELINGS,
    EXACT_LABELINGS,
    Array,
    SignificanceTest,
    checked_samples,
    single_seed_problem,
    spread_problem,
    undefined_test,
)
from tlr_exp.errors import UserError

# SciPy's exact distribution of the rank sums is quick up to here, and the normal one good beyond.
EXACT_RANK_SEEDS = 50


def welch_t(baseline: ArrayLike, treatment: ArrayLike) -> SignificanceTest:
    """Welch's t-test: independent seeds, variances that may differ.

    NaN with a reason for a single seed, or where neither arm varies.
    """
    name = "Welch t"
    first, second = checked_samples(baseline, treatment)
    problem = spread_problem(first, second)
    if problem:
        return undefined_test(name, problem)
    result = scipy_welch(first, second)
    return SignificanceTest(name, float(result.statistic), float(result.pvalue))


def paired_t(baseline: ArrayLike, treatment: ArrayLike) -> SignificanceTest:
    """Paired t-test over shared seeds. NaN with a reason if the differences do not vary."""
    name = "paired t"
    first, second = checked_samples(baseline, treatment, paired=True)
    problem = spread_problem(first, second, paired=True)
    if problem:
        return undefined_test(name, problem)
    result = stats.ttest_rel(second, first)
    return SignificanceTest(name, float(result.statistic), float(result.pvalue))  # pyright: ignore


def permutation(
    baseline: ArrayLike, treatment: ArrayLike, *, generator: np.random.Generator
) -> SignificanceTest:
    """Permutation test of the difference of means, over all C(n + m, n) labelings of the seeds.

    Exact (no distribution assumed beyond exchangeability) up to ``EXACT_LABELINGS`` labelings,
    which is eight seeds against eight; beyond, ``DRAWN_LABELINGS`` labelings are drawn from
    ``generator``. The p-value is twice the smaller one-sided one (SciPy's convention). NaN with a
    reason for a single seed.
    """
    first, second = checked_samples(baseline, treatment)
    exact = comb(first.size + second.size, first.size) <= EXACT_LABELINGS
    return _permutation_test(first, second, "independent", exact, "permutation", generator)


def sign_flip(
    baseline: ArrayLike, treatment: ArrayLike, *, generator: np.random.Generator
) -> SignificanceTest:
    """Permutation test for shared seeds: the arms of each seed are swapped, in all 2^n ways.

    Exact up to 14 seeds; beyond, ``DRAWN_LABELINGS`` swaps are drawn from ``generator``. NaN with a
    reason for a single seed.
    """
    first, second = checked_samples(baseline, treatment, paired=True)
    exact = 2**first.size <= EXACT_LABELINGS
    return _permutation_test(first, second, "samples", exact, "sign-flip permutation", generator)


def mann_whitney(
    baseline: ArrayLike, treatment: ArrayLike, *, generator: np.random.Generator
) -> SignificanceTest:
    """Mann-Whitney test; ``statistic`` is U: pairs in which treatment is larger, ties 1/2.

    Without ties by U's exact distribution (normal approximation above 50 seeds); with ties by
    permutation, since that distribution knows none. NaN with a reason for a single seed.
    """
    name = "Mann-Whitney"
    first, second = checked_samples(baseline, treatment)
    alone = single_seed_problem(first, second)
    if alone:
        return undefined_test(name, alone)
    tied = np.unique(np.concatenate([first, second])).size < first.size + second.size
    many = max(first.size, second.size) > EXACT_RANK_SEEDS
    if tied:
        exact = comb(first.size + second.size, first.size) <= EXACT_LABELINGS
        method = _permutation_method(exact, generator)
    else:
        method = "asymptotic" if many else "exact"
    result = stats.mannwhitneyu(second, first, method=method)  # pyright: ignore[reportArgumentType]
    return SignificanceTest(name, float(result.statistic), float(result.pvalue))


def wilcoxon(
    baseline: ArrayLike, treatment: ArrayLike, *, generator: np.random.Generator
) -> SignificanceTest:
    """Wilcoxon signed-rank test for shared seeds; ``statistic`` is the smaller of both rank sums.

    Without ties or zero differences by the exact distribution (normal approximation above 50
    seeds), otherwise by permutation. Zero differences are left out, as Wilcoxon did. NaN with a
    reason for a single seed.
    """
    name = "Wilcoxon signed-rank"
    first, second = checked_samples(baseline, treatment, paired=True)
    alone = single_seed_problem(first, second)
    if alone:
        return undefined_test(name, alone)
    difference = second - first
    absolute = np.abs(difference)
    if np.unique(absolute).size < absolute.size or not absolute.all():
        method = _permutation_method(2**first.size <= EXACT_LABELINGS, generator)
    else:
        method = "asymptotic" if first.size > EXACT_RANK_SEEDS else "exact"
    result = stats.wilcoxon(difference, method=method)  # pyright: ignore[reportArgumentType]
    statistic, p_value = float(result.statistic), float(result.pvalue)  # pyright: ignore
    return SignificanceTest(name, statistic, p_value)


def smallest_p(num_baseline: int, num_treatment: int, *, paired: bool = False) -> float:
    """The smallest two-sided p-value that an exact permutation test of so many seeds can give.

    2 / C(n + m, n) for independent seeds, 2 / 2^n for n shared ones; whatever the data.

    Raises:
        ValueError: no seed, or unequal numbers of paired seeds.
    """
    if min(num_baseline, num_treatment) < 1:
        raise UserError(f"at least one seed per arm, got {num_baseline} and {num_treatment}")
    if not paired:
        return min(1.0, 2 / comb(num_baseline + num_treatment, num_baseline))
    if num_baseline != num_treatment:
        raise UserError(f"paired arms share their seeds, got {num_baseline} and {num_treatment}")
    return 2.0 ** (1 - num_baseline)


def holm(p_values: ArrayLike) -> Array:
    """Holm's step-down adjustment of p-values [k] (Holm 1979, Scand. J. Statist. 6, 65-70).

    Comparing the adjusted values with alpha keeps the probability of any false rejection among the
    k tests at alpha or less, however they depend on each other. A test that is NaN counts among the
    k, and stays NaN.

    Raises:
        ValueError: not one-dimensional, or outside [0, 1].
    """
    values = np.asarray(p_values, dtype=np.float64)
    if values.ndim != 1 or (values < 0).any() or (values > 1).any():
        raise UserError(f"p-values must be a list of numbers in [0, 1], got {values.tolist()}")
    order = np.argsort(values)  # NaN last: it takes the least demanding place
    factors = values.size - np.arange(values.size)
    adjusted = np.empty_like(values)
    adjusted[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors))
    return adjusted


def scipy_welch(baseline: Array, treatment: Array) -> Any:
    """SciPy's Welch test of samples of which at least one varies."""
    with warnings.catch_warnings():
        # SciPy warns of lost precision where one arm is constant; its variance is 0 and that is
        # right.
        warnings.simplefilter("ignore", RuntimeWarning)
        return stats.ttest_ind(treatment, baseline, equal_var=False)  # pyright: ignore


def mean_difference(baseline: Array, treatment: Array, axis: int) -> Array:
    """Mean of treatment minus that of baseline along ``axis``, as SciPy asks for a statistic."""
    return np.mean(treatment, axis=axis) - np.mean(baseline, axis=axis)


def _permutation_test(
    baseline: Array,
    treatment: Array,
    permutation_type: str,
    exact: bool,
    name: str,
    generator: np.random.Generator,
) -> SignificanceTest:
    kind = "exact" if exact else "drawn"
    alone = single_seed_problem(baseline, treatment)
    if alone:
        return undefined_test(f"{kind} {name}", alone)
    result = stats.permutation_test(
        (baseline, treatment),
        mean_difference,
        permutation_type=permutation_type,  # pyright: ignore[reportArgumentType]
        vectorized=True,
        n_resamples=EXACT_LABELINGS if exact else DRAWN_LABELINGS,
        rng=generator,
    )
    return SignificanceTest(f"{kind} {name}", float(result.statistic), float(result.pvalue))


def _permutation_method(exact: bool, generator: np.random.Generator) -> stats.PermutationMethod:
    resamples = EXACT_LABELINGS if exact else DRAWN_LABELINGS
    return stats.PermutationMethod(n_resamples=resamples, rng=generator)
