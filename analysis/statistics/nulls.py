"""Counts how often each protocol calls groups of seeds of one method different: should be alpha.

The iteration-wise protocol (``analysis.statistics.paper``) tests the iterations of seed-averaged
curves; the seed-wise ones (Welch's t and the exact permutation test) test one number per seed, the
mean of the last fifth of training.
"""

import warnings
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal, stats

from analysis.measures.endpoints import TAIL_SHARE, tail_mean
from analysis.statistics.results import EXACT_LABELINGS, Array, checked_curves, is_constant
from analysis.statistics.significance import mean_difference
from tlr_exp.errors import UserError

EXTREME_P = 1e-8  # what the paper reports is smaller
# Numbers in the curves simulated at a time: 64 MB.
BLOCK = 8_000_000
MOST_SPLITS = 1_000


@dataclass(frozen=True)
class FalsePositiveRates:
    """Shares of studies without any true difference in which a test is significant at ``alpha``."""

    iteration_t: float  # paired t over iterations of the seed-averaged curves
    iteration_t_extreme: float  # the same, with a p-value below EXTREME_P
    welch: float  # Welch t over seeds
    permutation: float  # exact permutation test over seeds
    alpha: float
    num_studies: int
    num_seeds: tuple[int, int]  # per arm
    num_iterations: int


def false_positive_rates(
    *,
    num_seeds: int,
    num_iterations: int,
    autocorrelation: float,
    between_seed_sd: float,
    generator: np.random.Generator,
    num_studies: int = 1_000,
    alpha: float = 0.05,
) -> FalsePositiveRates:
    """Simulated studies of two arms that are the same, ``num_seeds`` each.

    A seed's curve is a level of its own, normal with standard deviation ``between_seed_sd``, plus
    noise of standard deviation 1 from iteration to iteration, a stationary AR(1) with
    ``autocorrelation`` at lag one.

    Raises:
        ValueError: fewer than two seeds or iterations, an autocorrelation outside (-1, 1), a
            negative standard deviation, no studies.
    """
    if min(num_seeds, num_iterations) < 2 or num_studies < 1:
        raise UserError(
            f"two seeds, two iterations and one study at least, got {num_seeds}, {num_iterations} "
            f"and {num_studies}"
        )
    step = max(1, BLOCK // (2 * num_seeds * num_iterations))
    p_values = []
    for start in range(0, num_studies, step):
        shape = (min(step, num_studies - start), 2 * num_seeds, num_iterations)
        curves = ar1_curves(shape, autocorrelation, between_seed_sd, generator)
        p_values.append(_study_p_values(curves, num_seeds, generator))
    arms = (num_seeds, num_seeds)
    return _rates(np.concatenate(p_values, axis=1), alpha, arms, num_iterations)


def false_positive_rates_of_curves(
    curves: ArrayLike, *, generator: np.random.Generator, alpha: float = 0.05
) -> FalsePositiveRates:
    """The same from real curves [num_seeds, num_iterations], split into two mock arms.

    Of seeds of one arm no split into halves can show a true difference. All splits are taken (of
    five seeds, 2 against 3 in 10 ways), or ``MOST_SPLITS`` drawn ones if there are more. Splits
    share seeds: the rates describe these seeds, and their binomial error is too small. With so few
    seeds the permutation test cannot reach 0.05 at all. The curves of two arms together give what
    the iteration-wise test makes of shuffled labels.

    Raises:
        ValueError: fewer than four seeds or two iterations, or a wrong shape.
    """
    values = checked_curves(curves, "curves")
    total, num_iterations = values.shape
    first = total // 2
    if first < 2 or num_iterations < 2:
        raise UserError(
            f"two mock arms of at least two seeds and two iterations, got {total} seeds and "
            f"{num_iterations} iterations"
        )
    if is_constant(values):
        raise UserError("curves that are all the same constant have nothing to test")
    orders = _splits(total, first, generator)
    step = max(1, BLOCK // values.size)
    p_values = [
        _study_p_values(values[orders[start : start + step]], first, generator)
        for start in range(0, len(orders), step)
    ]
    arms = (first, total - first)
    return _rates(np.concatenate(p_values, axis=1), alpha, arms, num_iterations)


def ar1_curves(
    shape: tuple[int, ...],
    autocorrelation: float,
    between_seed_sd: float,
    generator: np.random.Generator,
) -> Array:
    """Curves [..., num_iterations]: a normal level each plus stationary AR(1) noise of variance 1.

    Raises:
        ValueError: an autocorrelation outside (-1, 1), or a negative standard deviation.
    """
    if not -1 < autocorrelation < 1 or between_seed_sd < 0:
        raise UserError(
            "an autocorrelation within (-1, 1) and a standard deviation of at least 0, got "
            f"{autocorrelation} and {between_seed_sd}"
        )
    noise = generator.standard_normal(shape)
    # The first value has the stationary variance 1 already.
    noise[..., 1:] *= np.sqrt(1 - autocorrelation**2)
    curves = signal.lfilter([1.0], [1.0, -autocorrelation], noise, axis=-1)
    return curves + between_seed_sd * generator.standard_normal((*shape[:-1], 1))


def _study_p_values(curves: Array, num_baseline: int, generator: np.random.Generator) -> Array:
    """p-values [3, num_studies] (iterations, Welch, permutation) of curves [studies, seeds, T]."""
    num_studies, num_seeds, num_iterations = curves.shape
    difference = curves[:, num_baseline:].mean(axis=1) - curves[:, :num_baseline].mean(axis=1)
    flat = curves.reshape(-1, num_iterations)
    endpoint = tail_mean(flat, np.arange(1, num_iterations + 1), share=TAIL_SHARE)
    endpoint = endpoint.reshape(num_studies, num_seeds)
    first, second = endpoint[:, :num_baseline], endpoint[:, num_baseline:]
    with warnings.catch_warnings():
        # SciPy warns of seeds that do not vary; they have no p-value and are not significant.
        warnings.simplefilter("ignore", RuntimeWarning)
        over_iterations = stats.ttest_1samp(difference, 0.0, axis=1).pvalue  # pyright: ignore
        welch = stats.ttest_ind(second, first, axis=1, equal_var=False).pvalue  # pyright: ignore
    permuted = stats.permutation_test(
        (first, second),
        mean_difference,
        vectorized=True,
        axis=1,
        n_resamples=min(EXACT_LABELINGS, comb(num_seeds, num_baseline)),
        batch=1_000,
        rng=generator,
    ).pvalue
    return np.stack([over_iterations, welch, permuted])


def _splits(total: int, num_first: int, generator: np.random.Generator) -> np.ndarray:
    """Orders of the seeds [num_splits, total]: those of the first mock arm, then the others."""
    if comb(total, num_first) > MOST_SPLITS:
        return generator.permuted(np.tile(np.arange(total), (MOST_SPLITS, 1)), axis=1)
    chosen = list(combinations(range(total), num_first))
    if 2 * num_first == total:  # the second half mirrors the first
        chosen = chosen[: len(chosen) // 2]
    return np.array([[*arm, *(set(range(total)) - set(arm))] for arm in chosen])


def _rates(
    p_values: Array, alpha: float, num_seeds: tuple[int, int], num_iterations: int
) -> FalsePositiveRates:
    over_iterations, welch, permuted = p_values
    # Exact p-values are ratios of integers: 0.05 itself counts.
    return FalsePositiveRates(
        iteration_t=float((over_iterations <= alpha).mean()),
        iteration_t_extreme=float((over_iterations < EXTREME_P).mean()),
        welch=float((welch <= alpha).mean()),
        permutation=float((permuted <= alpha).mean()),
        alpha=alpha,
        num_studies=over_iterations.size,
        num_seeds=num_seeds,
        num_iterations=num_iterations,
    )
