"""Whole learning curves of two arms compared, with the seed as the unit.

At every iteration the arms differ by a t statistic. Under the hypothesis that the arms are alike,
the labels of the seeds mean nothing, so the largest |t| over all iterations is compared with the
largest |t| under every other labeling (Westfall and Young 1993; Nichols and Holmes 2002, Human
Brain Mapping 15, 1-25). A whole curve is relabeled at once, so neighbouring iterations may depend
on each other in any way, and looking at many iterations is paid for: the probability of calling any
iteration different, where none is, is at most alpha.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.statistics.results import (
    DRAWN_LABELINGS,
    EXACT_LABELINGS,
    ROUNDING,
    Array,
    checked_curves,
)
from tlr_exp.errors import UserError

# A standard error below this share of that of all seeds together is raised to it, so that a
# labeling under which an iteration happens to have no spread within the arms does not divide by
# zero.
SMALLEST_STANDARD_ERROR = 1e-3
# Numbers in one block of labelings x iterations: 32 MB.
BLOCK = 4_000_000
# Labelings that mirror each other give the same |t| but for rounding.
TIE = 1e-9


@dataclass(frozen=True)
class CurveComparison:
    """Curves of two arms, iteration by iteration; arrays are [num_iterations].

    An iteration differs where its ``p_values`` is at most ``alpha``: where |difference| >
    ``margin``.
    """

    difference: Array  # mean(treatment) - mean(baseline), units of the metric
    statistic: Array  # Welch's t, or paired t
    p_values: Array  # adjusted for looking at all iterations
    p_value: float  # whether the curves differ anywhere: the smallest of p_values
    threshold: float  # |t| that an iteration must exceed
    margin: Array  # the same as a difference, units of the metric
    differs: NDArray[np.bool_]
    alpha: float
    smallest_p: float  # that so many labelings can give; above alpha, nothing can differ
    num_labelings: int
    exact: bool  # all labelings, not some drawn ones
    paired: bool


def compare_curves(
    baseline: ArrayLike,
    treatment: ArrayLike,
    *,
    generator: np.random.Generator,
    paired: bool = False,
    alpha: float = 0.05,
) -> CurveComparison:
    """Compare curves [n, num_iterations] and [m, num_iterations] of the same iterations.

    ``paired``: row i of both belongs to the same seed, and labels are swapped within seeds. Beyond
    20 000 labelings 9999 are drawn from ``generator``, and the one seen is counted among them.

    Raises:
        ValueError: wrong shapes, values that are not finite, fewer than two seeds in an arm,
            unequal numbers of paired seeds, alpha outside (0, 1).
    """
    first, second = _checked(baseline, treatment, paired, alpha)
    blocks, exact = _relabeled(first, second, paired, generator)
    difference, standard_error = (part[0] for part in next(blocks))
    statistic = _ratio(difference, standard_error)
    maxima = np.concatenate([np.abs(_ratio(*block)).max(axis=1) for block in blocks])
    p_values = _exceedance(np.abs(statistic), maxima)
    threshold = _threshold(maxima, alpha)
    # Arms of equal size mirror each other; otherwise only the labeling seen need be as extreme.
    mirrored = 2 if exact and len(first) == len(second) else 1
    return CurveComparison(
        difference=difference,
        statistic=statistic,
        p_values=p_values,
        p_value=float(p_values.min()),
        threshold=threshold,
        margin=threshold * standard_error,
        differs=p_values <= alpha,
        alpha=alpha,
        smallest_p=mirrored / maxima.size,
        num_labelings=maxima.size,
        exact=exact,
        paired=paired,
    )


def _relabeled(
    baseline: Array, treatment: Array, paired: bool, generator: np.random.Generator
) -> tuple[Iterator[tuple[Array, Array]], bool]:
    """Differences and standard errors under the labels seen, then under all; whether all is all."""
    if paired:
        signs, exact = _sign_flips(len(baseline), generator)
        scale = np.maximum(np.abs(baseline).max(axis=0), np.abs(treatment).max(axis=0))
        return _paired_blocks(treatment - baseline, signs, scale), exact
    labels, exact = _labelings(len(baseline), len(treatment), generator)
    return _unpaired_blocks(np.concatenate([baseline, treatment]), labels), exact


def _labelings(
    num_baseline: int, num_treatment: int, generator: np.random.Generator
) -> tuple[Array, bool]:
    """Which seeds are called baseline (1 or 0) [num_labelings, n + m]; first, as they are."""
    total = num_baseline + num_treatment
    exact = comb(total, num_baseline) <= EXACT_LABELINGS
    if exact:
        chosen = np.array(list(combinations(range(total), num_baseline)))
    else:
        order = np.tile(np.arange(total), (DRAWN_LABELINGS + 1, 1))
        order[1:] = generator.permuted(order[1:], axis=1)
        chosen = order[:, :num_baseline]
    labels = np.zeros((len(chosen), total))
    np.put_along_axis(labels, chosen, 1.0, axis=1)
    return labels, exact


def _sign_flips(num_pairs: int, generator: np.random.Generator) -> tuple[Array, bool]:
    """Signs of the differences [num_labelings, num_pairs]; first, as they are."""
    exact = 2**num_pairs <= EXACT_LABELINGS
    if exact:
        return np.array(list(product((1.0, -1.0), repeat=num_pairs))), exact
    signs = generator.choice([1.0, -1.0], size=(DRAWN_LABELINGS + 1, num_pairs))
    signs[0] = 1.0
    return signs, exact


def _unpaired_blocks(pooled: Array, labels: Array) -> Iterator[tuple[Array, Array]]:
    """Difference of means and its standard error (Welch) [labelings of the block, num_iterations].

    The first block holds the labeling seen, alone; the others all labelings.
    """
    num_baseline = labels[0].sum()
    num_treatment = labels.shape[1] - num_baseline
    scale = np.abs(pooled).max(axis=0)
    centred = pooled - pooled.mean(axis=0)
    total_squares = (centred**2).sum(axis=0)
    overall = np.sqrt(total_squares / (len(pooled) - 1) * (1 / num_baseline + 1 / num_treatment))
    for rows in _blocks(labels, pooled.shape[1]):
        sums = rows @ centred
        squares = rows @ centred**2
        mean_b, mean_t = sums / num_baseline, -sums / num_treatment
        var_b = (squares - num_baseline * mean_b**2) / (num_baseline - 1)
        var_t = (total_squares - squares - num_treatment * mean_t**2) / (num_treatment - 1)
        error = np.sqrt(np.maximum(var_b / num_baseline + var_t / num_treatment, 0.0))
        yield _guarded(mean_t - mean_b, error, overall, scale)


def _paired_blocks(differences: Array, signs: Array, scale: Array) -> Iterator[tuple[Array, Array]]:
    """As :func:`_unpaired_blocks`, of the differences of shared seeds under flips of their sign."""
    num_pairs = len(differences)
    squares = (differences**2).sum(axis=0)
    overall = np.sqrt(squares / num_pairs**2)
    for rows in _blocks(signs, differences.shape[1]):
        mean = rows @ differences / num_pairs
        variance = (squares - num_pairs * mean**2) / (num_pairs - 1)
        error = np.sqrt(np.maximum(variance / num_pairs, 0.0))
        yield _guarded(mean, error, overall, scale)


def _blocks(labels: Array, num_iterations: int) -> Iterator[Array]:
    yield labels[:1]
    step = max(1, BLOCK // num_iterations)
    for start in range(0, len(labels), step):
        yield labels[start : start + step]


def _guarded(difference: Array, error: Array, overall: Array, scale: Array) -> tuple[Array, Array]:
    """Standard errors not below a share of that of all seeds; no difference where nothing varies.

    Neither depends on the labels, so the permutation test stays exact.
    """
    error = np.maximum(error, SMALLEST_STANDARD_ERROR * overall)
    constant = overall <= ROUNDING * scale
    return np.where(constant, 0.0, difference), np.where(constant, 0.0, error)


def _ratio(difference: Array, error: Array) -> Array:
    return np.divide(difference, error, out=np.zeros_like(difference), where=error > 0)


def _exceedance(statistics: Array, maxima: Array) -> Array:
    """Share of maxima that reach each statistic, up to rounding."""
    below = np.searchsorted(np.sort(maxima), statistics * (1 - TIE), side="left")
    return (maxima.size - below) / maxima.size


def _threshold(maxima: Array, alpha: float) -> float:
    """What a statistic must exceed for at most a share ``alpha`` of the maxima to reach it."""
    allowed = int(np.floor(alpha * maxima.size * (1 + TIE)))
    return float(np.sort(maxima)[::-1][allowed])


def _checked(
    baseline: ArrayLike, treatment: ArrayLike, paired: bool, alpha: float
) -> tuple[Array, Array]:
    first, second = checked_curves(baseline, "baseline"), checked_curves(treatment, "treatment")
    if first.shape[1] != second.shape[1]:
        raise UserError(
            f"curves must be of the same iterations, got {first.shape[1]} of baseline and "
            f"{second.shape[1]} of treatment"
        )
    if min(len(first), len(second)) < 2:
        raise UserError(
            f"curves are compared from two seeds per arm on, got {len(first)} and {len(second)}"
        )
    if paired and len(first) != len(second):
        raise UserError(f"paired arms share their seeds, got {len(first)} and {len(second)}")
    if not 0 < alpha < 1:
        raise UserError(f"alpha must lie between 0 and 1, got {alpha}")
    return first, second
