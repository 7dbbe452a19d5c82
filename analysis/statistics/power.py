"""Power of the t-tests with so many seeds, and the seeds that a difference needs.

Differences are in standard deviations from seed to seed: d = difference / spread, where the spread
of independent arms is sqrt((var_baseline + var_treatment) / 2) and that of shared seeds the
standard deviation of their differences. Powers are exact for normal seeds (equal variances,
Student's test); Welch's test, which does not know that the variances are equal, has a few points
less at five seeds.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats

from analysis.statistics.results import checked_samples, spread_problem
from tlr_exp.errors import UserError

MOST_SEEDS = 1_000_000
# Beyond so many standard deviations the power is 1 at any level in use.
HUGE_EFFECT = 1e4


def power(num_seeds: int, effect: float, *, paired: bool = False, alpha: float = 0.05) -> float:
    """Probability that a two-sided t-test at level alpha finds a true difference of ``effect``.

    ``num_seeds`` per arm, or pairs. The squared t statistic is noncentral F with 1 and df degrees
    of freedom and noncentrality num_seeds * effect^2 (half of it for independent arms), which is
    the noncentral t without its inaccurate far tail.

    Raises:
        ValueError: fewer than two seeds, or alpha outside (0, 1).
    """
    if num_seeds < 2:
        raise UserError(f"a t-test needs at least two seeds, got {num_seeds}")
    if not 0 < alpha < 1:
        raise UserError(f"alpha must lie between 0 and 1, got {alpha}")
    freedom = num_seeds - 1 if paired else 2 * (num_seeds - 1)
    noncentrality = min(abs(effect), HUGE_EFFECT) ** 2 * num_seeds / (1 if paired else 2)
    critical = stats.t.ppf(1 - alpha / 2, freedom) ** 2
    if noncentrality == 0:
        return alpha
    return float(stats.ncf.sf(critical, 1, freedom, noncentrality))


def seeds_for_effect(
    effect: float, *, paired: bool = False, target: float = 0.8, alpha: float = 0.05
) -> int | None:
    """The fewest seeds per arm (or pairs) that find ``effect`` with probability ``target``.

    None if there is no effect, or if it needs more than ``MOST_SEEDS``.

    Raises:
        ValueError: target outside (alpha, 1).
    """
    _check_target(target, alpha)

    def enough(num_seeds: int) -> bool:
        return power(num_seeds, effect, paired=paired, alpha=alpha) >= target

    low, high = 1, 2
    while not enough(high):
        if high == MOST_SEEDS:
            return None
        low, high = high, min(2 * high, MOST_SEEDS)
    while high - low > 1:  # the answer lies in (low, high]
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


@cache  # of one number of seeds it is asked for every measure of a report
def detectable_effect(
    num_seeds: int, *, paired: bool = False, target: float = 0.8, alpha: float = 0.05
) -> float:
    """The smallest effect, in standard deviations, that so many seeds find with probability target.

    Raises:
        ValueError: fewer than two seeds, or target outside (alpha, 1).
    """
    _check_target(target, alpha)

    def missing(effect: float) -> float:
        return power(num_seeds, effect, paired=paired, alpha=alpha) - target

    high = 1.0
    while missing(high) < 0:
        high *= 2
    return float(optimize.brentq(missing, 0.0, high))  # pyright: ignore[reportArgumentType]


def seeds_needed(
    baseline: ArrayLike,
    treatment: ArrayLike,
    *,
    paired: bool = False,
    target: float = 0.8,
    alpha: float = 0.05,
) -> int | None:
    """Seeds per arm that would find the difference seen, were it and the spread seen the true ones.

    A guide for the next study, not a finding of this one: of five seeds, both are uncertain (the
    interval of Hedges' g says how much). None for a single seed, no spread, or no difference.
    """
    first, second = checked_samples(baseline, treatment, paired=paired)
    if spread_problem(first, second, paired=paired):
        return None
    if paired:
        variance = float((second - first).var(ddof=1))
    else:
        variance = float(first.var(ddof=1) + second.var(ddof=1)) / 2
    effect = abs(float(second.mean() - first.mean())) / float(np.sqrt(variance))
    return seeds_for_effect(effect, paired=paired, target=target, alpha=alpha)


def _check_target(target: float, alpha: float) -> None:
    if not alpha < target < 1:
        raise UserError(f"the power aimed at must lie between alpha = {alpha} and 1, got {target}")
