"""Measures how large a difference of two arms is against the spread from seed to seed."""

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, special, stats

from analysis.statistics.results import (
    Array,
    Interval,
    checked_confidence,
    checked_samples,
    spread_problem,
    undefined_interval,
)
from tlr_exp.errors import UserError

# Where a t statistic exceeds this many roots of its degrees of freedom, another integral is used.
LARGE_STATISTIC = 30.0


def small_sample_correction(degrees_of_freedom: float) -> float:
    """J(df) = Gamma(df / 2) / (sqrt(df / 2) Gamma((df - 1) / 2)), which takes the bias from d.

    Hedges 1981, J. Educational Statistics 6, 107-128, equation 6e; about 1 - 3 / (4 df - 1).

    Raises:
        ValueError: one degree of freedom or less, for which d has no mean.
    """
    if degrees_of_freedom <= 1:
        raise UserError(f"d has a mean from two degrees of freedom on, got {degrees_of_freedom}")
    half = degrees_of_freedom / 2
    log_ratio = special.gammaln(half) - special.gammaln(half - 0.5)
    return float(np.exp(log_ratio) / np.sqrt(half))


def hedges_g(
    baseline: ArrayLike,
    treatment: ArrayLike,
    *,
    smaller_is_better: bool,
    paired: bool = False,
    confidence: float = 0.95,
) -> Interval:
    """Hedges' g: the improvement of the mean in standard deviations from seed to seed, unbiased.

    Positive where treatment is better. Independent seeds: over the pooled standard deviation.
    Shared seeds: over the standard deviation of the differences (d_z), so the two are not to be
    compared. The interval is of the population's value, exact for normal seeds of equal variance,
    by inverting the noncentral t distribution (Steiger and Fouladi 1997); it is not scaled by the
    correction.

    NaN with a reason for a single seed, where nothing varies, or for two shared seeds, of which no
    unbiased estimate exists.
    """
    method = "Hedges g (d_z), noncentral t" if paired else "Hedges g, noncentral t"
    first, second = checked_samples(baseline, treatment, paired=paired)
    checked_confidence(confidence)
    problem = spread_problem(first, second, paired=paired)
    if problem:
        return undefined_interval(np.nan, confidence, method, problem)
    if paired and first.size == 2:
        reason = "two shared seeds allow no unbiased effect size"
        return undefined_interval(np.nan, confidence, method, reason)
    if paired:
        freedom, root_size = first.size - 1, sqrt(first.size)
        spread = float((second - first).std(ddof=1))
    else:
        freedom = first.size + second.size - 2
        root_size = sqrt(first.size * second.size / (first.size + second.size))
        squares = first.var() * first.size + second.var() * second.size
        spread = sqrt(float(squares) / freedom)
    d = float(second.mean() - first.mean()) / spread * (-1 if smaller_is_better else 1)
    low, high = noncentrality_limits(d * root_size, freedom, confidence)
    estimate = d * small_sample_correction(freedom)
    return Interval(estimate, low / root_size, high / root_size, confidence, method)


def noncentrality_limits(
    statistic: float, degrees_of_freedom: float, confidence: float
) -> tuple[float, float]:
    """Limits of the noncentrality of a t distribution from which ``statistic`` was drawn.

    Under the lower limit a statistic as large as this has probability (1 - confidence) / 2, under
    the upper one a statistic as small.
    """
    if statistic < 0:
        low, high = noncentrality_limits(-statistic, degrees_of_freedom, confidence)
        return -high, -low
    if statistic > LARGE_STATISTIC * sqrt(degrees_of_freedom):
        probability = _probability_of_large
    else:
        probability = stats.nct.cdf
    tail = (1 - confidence) / 2

    def excess(noncentrality: float, aim: float) -> float:
        return float(probability(statistic, degrees_of_freedom, noncentrality)) - aim

    def limit(direction: int, aim: float) -> float:
        # Outwards in growing steps: SciPy's distribution is NaN far out (scipy/scipy#25470).
        step = 1.0
        while direction * excess(statistic + direction * step, aim) > 0:
            step *= 1.5
        bracket = sorted((statistic, statistic + direction * step))
        return float(optimize.brentq(excess, *bracket, args=(aim,)))  # pyright: ignore

    return limit(-1, 1 - tail), limit(1, tail)


def _probability_of_large(
    statistic: float, degrees_of_freedom: float, noncentrality: float
) -> float:
    """Noncentral t distribution function where SciPy's is NaN: at a large positive statistic.

    T = (Z + noncentrality) / S with Z normal and S chi over the root of its degrees of freedom is
    at most ``statistic`` where S >= (Z + noncentrality) / statistic; the mean over Z by
    Gauss-Hermite quadrature.
    """
    normal, weights = np.polynomial.hermite_e.hermegauss(64)
    least = np.maximum(normal + noncentrality, 0.0) / statistic
    above = stats.chi.sf(least * sqrt(degrees_of_freedom), degrees_of_freedom)
    return float(weights @ above / weights.sum())


def probability_of_improvement(
    baseline: ArrayLike, treatment: ArrayLike, *, smaller_is_better: bool
) -> float:
    """The share of pairs (baseline seed, treatment seed) in which treatment is better; ties 1/2.

    The common-language effect size; U / (n m) of the Mann-Whitney test.
    """
    return float(share_of_better(*checked_samples(baseline, treatment), smaller_is_better))


def share_of_better(first: Array, second: Array, smaller_is_better: bool) -> Array:
    """The share [...] of pairs of one of [..., n] and one of [..., m] in which that is better."""
    one, other = first[..., None, :], second[..., :, None]
    above = (other > one).mean(axis=(-2, -1)) + 0.5 * (other == one).mean(axis=(-2, -1))
    return 1.0 - above if smaller_is_better else above
