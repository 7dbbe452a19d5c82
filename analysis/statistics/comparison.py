"""Compares two arms over their seeds: everything about one metric, in one result.

Arms that share their seeds may be compared seed by seed (``paired``). That helps as far as a seed
makes the arms alike. Where it does not, the paired tests are still valid, but find less: they have
half the degrees of freedom, and no exact test of five pairs can be below 0.0625.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.statistics.effect_size import hedges_g, probability_of_improvement
from analysis.statistics.intervals import (
    bootstrap_interval,
    difference_interval,
    interquartile_mean,
    mean_interval,
    relative_improvement_interval,
)
from analysis.statistics.power import detectable_effect, seeds_needed
from analysis.statistics.results import (
    Array,
    Interval,
    SignificanceTest,
    checked_confidence,
    checked_samples,
)
from analysis.statistics.significance import (
    mann_whitney,
    paired_t,
    permutation,
    sign_flip,
    smallest_p,
    welch_t,
    wilcoxon,
)


@dataclass(frozen=True)
class ArmSummary:
    """One arm over its seeds, in units of the metric."""

    num_seeds: int
    mean: Interval  # Student's t
    std: float  # sample standard deviation (n - 1); NaN for a single seed
    interquartile_mean: float
    smallest: float
    largest: float


@dataclass(frozen=True)
class Comparison:
    """Two arms compared with the seed as the unit.

    Differences are treatment - baseline, in units of the metric. Improvements are positive where
    treatment is better. What the data do not allow is NaN, and its ``reason`` says why.
    """

    baseline: ArmSummary
    treatment: ArmSummary
    paired: bool  # the seeds are shared and were compared seed by seed
    smaller_is_better: bool
    difference: Interval  # Welch's t, or paired t
    relative_improvement: Interval  # a share of the baseline's mean, Fieller
    bootstrap_difference: Interval  # percentile; NaN below 20 seeds per arm
    t_test: SignificanceTest  # Welch, or paired
    permutation_test: SignificanceTest  # difference of means over labelings, or over sign flips
    rank_test: SignificanceTest  # Mann-Whitney, or Wilcoxon signed-rank
    effect_size: Interval  # Hedges g, or d_z, in standard deviations; positive is better
    probability_of_improvement: float
    smallest_p: float  # that an exact permutation test of so many seeds can give
    seeds_needed: int | None  # per arm, for 80 % power if the difference and spread seen were true
    detectable_effect: float  # standard deviations found with 80 % power by the smaller arm's seeds


def summarise(values: ArrayLike, *, confidence: float = 0.95) -> ArmSummary:
    """One arm's values [num_seeds] over its seeds.

    Raises:
        ValueError: empty, or not finite.
    """
    mean = mean_interval(values, confidence=confidence)
    sample = np.asarray(values, dtype=np.float64)
    return ArmSummary(
        num_seeds=sample.size,
        mean=mean,
        std=float(sample.std(ddof=1)) if sample.size > 1 else np.nan,
        interquartile_mean=interquartile_mean(sample),
        smallest=float(sample.min()),
        largest=float(sample.max()),
    )


def compare(
    baseline: ArrayLike,
    treatment: ArrayLike,
    *,
    smaller_is_better: bool,
    generator: np.random.Generator,
    paired: bool = False,
    confidence: float = 0.95,
) -> Comparison:
    """Compare one number per seed of two arms, baseline [n] and treatment [m].

    ``paired``: element i of both belongs to the same seed. ``generator`` draws labelings where
    there are too many to enumerate (beyond eight seeds against eight, or 14 pairs) and the
    bootstrap (from 20 seeds per arm on); with fewer seeds, nothing is drawn.

    Raises:
        ValueError: no seeds, values that are not finite, unequal numbers of paired seeds.
    """
    first, second = checked_samples(baseline, treatment, paired=paired)
    better, level = smaller_is_better, checked_confidence(confidence)
    difference, improvement, bootstrap, effect = _intervals(
        first, second, better, paired, level, generator
    )
    t_test, permutation_test, rank_test = _tests(first, second, paired, generator)
    fewest = min(first.size, second.size)
    return Comparison(
        baseline=summarise(first, confidence=level),
        treatment=summarise(second, confidence=level),
        paired=paired,
        smaller_is_better=better,
        difference=difference,
        relative_improvement=improvement,
        bootstrap_difference=bootstrap,
        t_test=t_test,
        permutation_test=permutation_test,
        rank_test=rank_test,
        effect_size=effect,
        probability_of_improvement=probability_of_improvement(
            first, second, smaller_is_better=better
        ),
        smallest_p=smallest_p(first.size, second.size, paired=paired),
        seeds_needed=seeds_needed(first, second, paired=paired),
        detectable_effect=detectable_effect(fewest, paired=paired) if fewest > 1 else np.nan,
    )


def _intervals(
    baseline: Array,
    treatment: Array,
    better: bool,
    paired: bool,
    level: float,
    generator: np.random.Generator,
) -> tuple[Interval, Interval, Interval, Interval]:
    """Difference, relative improvement, bootstrapped difference and effect size."""
    return (
        difference_interval(baseline, treatment, paired=paired, confidence=level),
        relative_improvement_interval(
            baseline, treatment, smaller_is_better=better, paired=paired, confidence=level
        ),
        bootstrap_interval(
            baseline, treatment, generator=generator, paired=paired, confidence=level
        ),
        hedges_g(baseline, treatment, smaller_is_better=better, paired=paired, confidence=level),
    )


def _tests(
    baseline: Array, treatment: Array, paired: bool, generator: np.random.Generator
) -> tuple[SignificanceTest, SignificanceTest, SignificanceTest]:
    if paired:
        return (
            paired_t(baseline, treatment),
            sign_flip(baseline, treatment, generator=generator),
            wilcoxon(baseline, treatment, generator=generator),
        )
    return (
        welch_t(baseline, treatment),
        permutation(baseline, treatment, generator=generator),
        mann_whitney(baseline, treatment, generator=generator),
    )
