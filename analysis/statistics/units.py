"""Finds pairs with which a paired t-test gives a p-value that was published without them.

A paper that prints a p-value and names neither test nor pairs leaves both to be guessed. A paired
t over n pairs gives p where the mean of the differences is so many of their standard deviations
from 0; few pairs need a difference that no experiment has, thousands need next to none. That tells
which units are possible, not which were taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.paper import iteration_t_test
from analysis.statistics.results import Array, SignificanceTest
from tlr_exp.errors import UserError


@dataclass(frozen=True)
class Stretches:
    """Two averaged curves compared by the means of so many equal stretches of training."""

    count: int
    test: SignificanceTest


def needed_effect(p_value: float, num_pairs: int) -> float:
    """Mean of the differences, in their standard deviations, at which a paired t gives ``p_value``.

    t = d sqrt(n), so d = t_{n-1}(1 - p / 2) / sqrt(n), two-sided.

    Raises:
        ValueError: a p-value outside (0, 1], or fewer than two pairs.
    """
    if not 0 < p_value <= 1 or num_pairs < 2:
        raise UserError(
            f"a p-value in (0, 1] and two pairs at least, got {p_value} and {num_pairs}"
        )
    return float(stats.t.isf(p_value / 2, num_pairs - 1)) / num_pairs**0.5


def over_stretches(
    baseline: ArrayLike, treatment: ArrayLike, counts: Sequence[int]
) -> list[Stretches]:
    """Paired t over stretches of two seed-averaged curves [T], for each number of stretches.

    The iterations are cut into so many runs of neighbours, as equal in length as T allows, and each
    is one pair: as many stretches as iterations is the test over iterations. Numbers larger than T
    are left out.

    Raises:
        ValueError: curves of different lengths.
    """
    first, second = np.asarray(baseline, np.float64), np.asarray(treatment, np.float64)
    fitting = [count for count in counts if 2 <= count <= first.size]
    return [
        Stretches(count, iteration_t_test(_means(first, count), _means(second, count)))
        for count in fitting
    ]


def _means(curve: Array, count: int) -> Array:
    return np.array([part.mean() for part in np.array_split(curve, count)])
