"""Two things wanted at once: who is on the front, and how much it has under it.

Points are [n, 2], one per run, and smaller is better in both: tracking error and what the lower
layer costs. A point dominates another where it is no worse in either and better in one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.results import (
    DRAWN_LABELINGS,
    EXACT_LABELINGS,
    Array,
    SignificanceTest,
    single_seed_problem,
    undefined_test,
)
from tlr_exp.errors import UserError

MARGIN = 0.1  # of the range of all points, from the worst of each axis to the reference


@dataclass(frozen=True)
class Areas:
    """What two arms dominate, as shares of the box between the best and the reference of each axis.

    baseline and treatment: the areas of the two fronts, each of all the runs of its arm.
    of_runs: the area that each run dominates alone, [n] and [m].
    test: permutation of the runs between the arms; statistic: treatment's area less baseline's.
    """

    baseline: float
    treatment: float
    of_runs: tuple[Array, Array]
    test: SignificanceTest


def on_front(points: ArrayLike) -> np.ndarray:
    """Which of points [n, 2] no other one dominates, bool [n]; of equal points all or none.

    Raises:
        ValueError: another shape, or values that are not finite.
    """
    values = _checked(points)
    no_worse = (values[:, None] <= values[None]).all(axis=2)  # [i, j]: i is no worse than j
    better = (values[:, None] < values[None]).any(axis=2)
    return np.logical_not((no_worse & better).any(axis=0))


def hypervolume(points: ArrayLike, reference: ArrayLike) -> float:
    """Area that points [n, 2] dominate up to a reference [2]; points beyond it count nothing.

    Zitzler and Thiele 1998 (PPSN V, 292-301), in two dimensions: the union of the rectangles
    between each point and the reference.

    Raises:
        ValueError: as `on_front`, or a reference of another shape.
    """
    values, corner = _checked(points), np.asarray(reference, dtype=np.float64)
    if corner.shape != (2,):
        raise UserError(f"the reference must be one point, [2], got shape {corner.shape}")
    order = np.lexsort((values[:, 1], values[:, 0]))
    area, height = 0.0, float(corner[1])
    for x, y in values[order]:
        if x < corner[0] and y < height:
            area += (float(corner[0]) - float(x)) * (height - float(y))
            height = float(y)
    return area


def compare_areas(
    baseline: ArrayLike, treatment: ArrayLike, *, generator: np.random.Generator
) -> Areas:
    """Compare what two arms dominate; exact up to eight runs against eight, then drawn.

    Each axis is scaled to the range of all runs of both arms, and the reference lies ``MARGIN`` of
    it beyond the worst: both are the same however the runs are labelled, so the test is exact. An
    axis in which no run differs counts as one in which all are best.

    Raises:
        ValueError: as `on_front`.
    """
    first, second = _checked(baseline), _checked(treatment)
    every = np.concatenate([first, second])
    low, high = every.min(axis=0), every.max(axis=0)
    scaled = (every - low) / np.where(high > low, high - low, 1.0)
    corner, count = np.full(2, 1.0 + MARGIN), len(first)
    box = float(corner.prod())

    def difference(one: Array, other: Array) -> float:
        return (hypervolume(scaled[other], corner) - hypervolume(scaled[one], corner)) / box

    alone = (corner - scaled).prod(axis=1) / box
    return Areas(
        hypervolume(scaled[:count], corner) / box,
        hypervolume(scaled[count:], corner) / box,
        (alone[:count], alone[count:]),
        _permuted(np.arange(count), np.arange(count, len(every)), difference, generator),
    )


def _permuted(
    first: np.ndarray,
    second: np.ndarray,
    difference: Callable[[Array, Array], float],
    generator: np.random.Generator,
) -> SignificanceTest:
    alone = single_seed_problem(first, second)
    if alone:
        return undefined_test("permutation", alone)
    labelings = comb(len(first) + len(second), len(first))
    result = stats.permutation_test(
        (first, second),
        difference,
        permutation_type="independent",
        vectorized=False,
        n_resamples=EXACT_LABELINGS if labelings <= EXACT_LABELINGS else DRAWN_LABELINGS,
        rng=generator,
    )
    return SignificanceTest("permutation", float(result.statistic), float(result.pvalue))


def _checked(points: ArrayLike) -> Array:
    values = np.asarray(points, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 2 or len(values) == 0:
        raise UserError(f"points must be [num_runs, 2], got shape {values.shape}")
    if not np.isfinite(values).all():
        raise UserError("points must be finite")
    return values
