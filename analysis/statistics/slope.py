"""Measures how much curves still move at the end of training: one slope per seed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.measures.endpoints import TAIL_SHARE
from analysis.statistics.intervals import mean_interval
from analysis.statistics.results import (
    Array,
    Interval,
    SignificanceTest,
    checked_curves,
    is_constant,
    undefined_test,
)
from tlr_exp.errors import UserError


@dataclass(frozen=True)
class TailChange:
    """How much curves change over the last part of training, as a share of their level there.

    by_seed: [n], negative where a curve falls. mean: over seeds, Student's interval. test: t-test
    of the seeds' changes against 0, two-sided; how iterations depend on each other has no part in
    it, because each seed gives one number.
    """

    by_seed: Array
    mean: Interval
    test: SignificanceTest


def tail_change(
    curves: ArrayLike, iterations: ArrayLike, *, share: float = TAIL_SHARE
) -> TailChange:
    """Change of curves [n, T] over the last ``share`` of training, by a straight line per seed.

    The least-squares slope over the iterations after (1 - share) of the last one, times the length
    of that part, divided by the mean there. NaN with a reason for a single seed, or where the seeds
    do not vary; of fewer than two points in that part, nothing is known.

    Raises:
        ValueError: wrong shapes, values that are not finite, a share outside (0, 1], or a curve
            whose mean there is not positive, of which no share exists.
    """
    values = checked_curves(curves, "curves")
    times = np.asarray(iterations, dtype=np.float64)
    if times.shape != values.shape[1:] or not 0 < share <= 1:
        raise UserError(
            f"iterations must be [{values.shape[1]}] and the share lie in (0, 1], got "
            f"{times.shape} and {share}"
        )
    last = times > (1 - share) * times[-1] + 1e-9 * times[-1]
    part, at = values[:, last], times[last]
    if at.size < 2:
        return _unknown(len(values), "fewer than two points at the end of training")
    levels = part.mean(axis=1)
    if (levels <= 0).any():
        raise UserError("a change as a share needs curves that are positive at their end")
    centred = at - at.mean()
    slopes = part @ centred / (centred @ centred)
    by_seed = slopes * share * times[-1] / levels
    return TailChange(by_seed, mean_interval(by_seed), _against_zero(by_seed))


def _against_zero(by_seed: Array) -> SignificanceTest:
    name = "t over seeds"
    if by_seed.size < 2:
        return undefined_test(name, "one seed has no spread")
    if is_constant(by_seed):
        return undefined_test(name, "the seeds do not vary")
    result = stats.ttest_1samp(by_seed, 0.0)
    return SignificanceTest(name, float(result.statistic), float(result.pvalue))  # pyright: ignore


def _unknown(num_seeds: int, reason: str) -> TailChange:
    nothing = Interval(np.nan, np.nan, np.nan, 0.95, "Student t", reason)
    return TailChange(np.full(num_seeds, np.nan), nothing, undefined_test("t over seeds", reason))
