"""Two arms compared over several motions: each motion is a stratum, the seeds in it are the units.

``baseline`` and ``treatment`` hold one array of seeds for each motion, in the same order of
motions; the numbers of seeds may differ. The motions are those of the study and no sample of
others: the intervals say what other seeds would give, not what other motions would.

Values are made comparable over motions by dividing by the baseline's mean on the same motion, so
that 1 is as good as the baseline (the normalised scores of Agarwal et al. 2021, "Deep
Reinforcement Learning at the Edge of the Statistical Precipice", which normalise by an expert).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.effect_size import share_of_better
from analysis.statistics.results import (
    Array,
    Interval,
    SignificanceTest,
    checked_confidence,
    checked_samples,
    single_seed_problem,
    undefined_interval,
    undefined_test,
)
from tlr_exp.errors import UserError

RESAMPLES = 2_000

Strata = Sequence[ArrayLike]
Pairs = list[tuple[Array, Array]]


@dataclass(frozen=True)
class PooledRatio:
    """What the treatment's mean is of the baseline's, over all motions alike."""

    improvement: Interval  # a share; positive is better
    test: SignificanceTest  # of a ratio of 1


@dataclass(frozen=True)
class Profile:
    """The share of runs at least as good as each threshold, every motion counting alike."""

    thresholds: Array  # [n], in shares of the baseline's mean
    share: Array  # [n]
    low: Array  # [n], of a pointwise bootstrap interval
    high: Array  # [n]


def pooled_ratio(
    baseline: Strata, treatment: Strata, *, smaller_is_better: bool, confidence: float = 0.95
) -> PooledRatio:
    """The improvement by the geometric mean over motions of mean(treatment) / mean(baseline).

    The logarithm of each ratio has the variance s_t²/(n_t m_t²) + s_b²/(n_b m_b²) (delta method);
    their mean is compared with Student's t, with Satterthwaite's degrees of freedom over all
    samples of all motions.

    NaN with a reason where a motion has a single seed in an arm, a mean that is not positive, or
    nothing varies at all.
    """
    name = "t over motions"
    pairs = _checked(baseline, treatment)
    checked_confidence(confidence)
    problem = _ratio_problem(pairs)
    if problem:
        interval = undefined_interval(np.nan, confidence, name, problem)
        return PooledRatio(interval, undefined_test(name, problem))
    mean = float(np.mean([np.log(second.mean() / first.mean()) for first, second in pairs]))
    samples = [sample for pair in pairs for sample in pair]
    parts = [
        each.var(ddof=1) / (each.size * each.mean() ** 2) / len(pairs) ** 2 for each in samples
    ]
    variance = float(np.sum(parts))
    sign = -1.0 if smaller_is_better else 1.0
    estimate = sign * (exp(mean) - 1)
    if variance == 0.0:
        reason = "no motion has an arm that varies from seed to seed"
        interval = undefined_interval(estimate, confidence, name, reason)
        return PooledRatio(interval, undefined_test(name, reason))
    freedom = variance**2 / sum(
        part**2 / (each.size - 1) for part, each in zip(parts, samples, strict=True)
    )
    half = float(stats.t.ppf((1 + confidence) / 2, freedom)) * sqrt(variance)
    low, high = sorted(sign * (exp(limit) - 1) for limit in (mean - half, mean + half))
    statistic = mean / sqrt(variance)
    test = SignificanceTest(name, statistic, 2 * float(stats.t.sf(abs(statistic), freedom)))
    return PooledRatio(Interval(estimate, low, high, confidence, name), test)


def interquartile_means(
    baseline: Strata,
    treatment: Strata,
    *,
    generator: np.random.Generator,
    confidence: float = 0.95,
) -> tuple[float, float, Interval]:
    """Interquartile means of all normalised runs of each arm, and the interval of their difference.

    Single motions or seeds that go wrong do not decide it, other than the mean. The interval is
    that of :func:`_resampled`.
    """

    def means(pairs: Pairs) -> tuple[Array, Array]:
        first, second = (np.concatenate(_scores(pairs, arm), axis=-1) for arm in (0, 1))
        return stats.trim_mean(first, 0.25, axis=-1), stats.trim_mean(second, 0.25, axis=-1)

    pairs = _checked(baseline, treatment)
    checked_confidence(confidence)
    problem = _ratio_problem(pairs)
    if problem:
        return np.nan, np.nan, undefined_interval(np.nan, confidence, _BOOTSTRAP, problem)

    def difference(each: Pairs) -> Array:
        first, second = means(each)
        return second - first

    low, high = _resampled(pairs, difference, generator, confidence)
    first, second = map(float, means(pairs))
    interval = Interval(second - first, float(low), float(high), confidence, _BOOTSTRAP)
    return first, second, interval


def pooled_probability(
    baseline: Strata,
    treatment: Strata,
    *,
    smaller_is_better: bool,
    generator: np.random.Generator,
    confidence: float = 0.95,
) -> Interval:
    """The probability that a run of the treatment is better than one of the baseline on its motion.

    The mean over motions of :func:`effect_size.share_of_better`. Where every run of one
    arm is better, resampling finds nothing else, and the interval has no width.
    """

    def mean(pairs: Pairs) -> Array:
        return np.mean([share_of_better(*pair, smaller_is_better) for pair in pairs], axis=0)

    pairs = _checked(baseline, treatment)
    checked_confidence(confidence)
    estimate = float(mean(pairs))
    problem = _seed_problem(pairs)
    if problem:
        return undefined_interval(estimate, confidence, _BOOTSTRAP, problem)
    low, high = _resampled(pairs, mean, generator, confidence)
    return Interval(estimate, float(low), float(high), confidence, _BOOTSTRAP)


def performance_profiles(
    baseline: Strata,
    treatment: Strata,
    thresholds: ArrayLike,
    *,
    smaller_is_better: bool,
    generator: np.random.Generator,
    confidence: float = 0.95,
) -> tuple[Profile, Profile]:
    """The profiles of both arms over ``thresholds`` [n], shares of the baseline's mean.

    Raises:
        ValueError: a motion on which an arm has one seed, or the baseline a mean that is not
            positive.
    """
    pairs, at = _checked(baseline, treatment), np.asarray(thresholds, dtype=np.float64)
    checked_confidence(confidence)
    problem = _ratio_problem(pairs)
    if problem:
        raise UserError(problem)

    def shares(each: Pairs) -> Array:
        rows = []
        for arm in (0, 1):
            scores = [score[..., None] for score in _scores(each, arm)]
            good = [score <= at if smaller_is_better else score >= at for score in scores]
            rows.append(np.mean([which.mean(axis=-2) for which in good], axis=0))
        return np.concatenate(rows, axis=-1)

    low, high = _resampled(pairs, shares, generator, confidence)
    found, size = shares(pairs), at.size
    first, second = slice(0, size), slice(size, None)
    return (
        Profile(at, found[first], low[first], high[first]),
        Profile(at, found[second], low[second], high[second]),
    )


_BOOTSTRAP = "stratified bootstrap"


def _resampled(
    pairs: Pairs,
    statistic: Callable[[Pairs], Array],
    generator: np.random.Generator,
    confidence: float,
) -> tuple[Array, Array]:
    """Percentile limits of a statistic, with the seeds of each motion and arm drawn anew.

    The statistic takes samples [..., n], of which the leading dimension is that of the resamples.
    Of n seeds n - 1 are drawn, with replacement (Rao and Wu 1988, J. Am. Stat. Assoc. 83, 231-241):
    drawing n would understate the spread by the factor (n - 1) / n, a third with three seeds.
    """
    samples = [sample for pair in pairs for sample in pair]
    counts = [sample.size - 1 for sample in samples]
    sizes = np.repeat([sample.size for sample in samples], counts)
    places = generator.integers(0, sizes, (RESAMPLES, sizes.size))
    parts = np.split(places, np.cumsum(counts)[:-1], axis=1)
    drawn = [sample[part] for sample, part in zip(samples, parts, strict=True)]
    tail = (1 - confidence) / 2
    resampled = statistic([*zip(drawn[::2], drawn[1::2], strict=True)])
    low, high = np.quantile(resampled, [tail, 1 - tail], axis=0)
    return low, high


def _scores(pairs: Pairs, arm: int) -> list[Array]:
    """The samples [..., n] of an arm, 0 or 1, in shares of the baseline's mean."""
    return [pair[arm] / pair[0].mean(axis=-1, keepdims=True) for pair in pairs]


def _checked(baseline: Strata, treatment: Strata) -> Pairs:
    if len(baseline) != len(treatment) or len(baseline) == 0:
        raise UserError(
            f"both arms need the same motions, one at least; got {len(baseline)} of baseline and "
            f"{len(treatment)} of treatment"
        )
    return [checked_samples(*pair) for pair in zip(baseline, treatment, strict=True)]


def _seed_problem(pairs: Pairs) -> str:
    """Why there is no spread from seed to seed on some motion; empty if there is on all."""
    return next(filter(None, (single_seed_problem(*pair) for pair in pairs)), "")


def _ratio_problem(pairs: Pairs) -> str:
    if any(sample.mean() <= 0 for pair in pairs for sample in pair):
        return "a mean is not positive on some motion, so no ratio exists"
    return _seed_problem(pairs)
