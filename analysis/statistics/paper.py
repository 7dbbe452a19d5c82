"""The paper's analysis, as far as it can be told (Xu, Zheng and Ren 2025, Figures 7, 8 and 13).

The paper reports means over five seeds with one standard deviation, relative improvements averaged
over iterations, and p-values of 1.72e-9 and 6.00e-13. It names no test. Five seeds cannot give such
a value: the smallest exact two-sided p of five against five is 2 / 252, and a paired t over them
would need a difference of more than a hundred standard deviations. That its pairs were iterations
of the seed-averaged curves is a conjecture: no other unit of which there are many is in the paper.
This module computes that test, to compare like with like, and ``analysis.statistics.units`` which
pairs would give the paper's values.

Such a p-value says nothing about seeds. It answers whether *these* averaged curves differ in the
mean over *these* iterations, which any two curves do, those of two groups of seeds of one and the
same method too. And it takes the iterations to be independent, while each continues the one before:
a thousand iterations may be worth ten. ``analysis.statistics.nulls`` measures how often it calls
nothing something; ``analysis.statistics.comparison`` asks the seeds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from analysis.statistics.autocorrelation import autocorrelation, integrated_time
from analysis.statistics.results import (
    Array,
    SignificanceTest,
    checked_curves,
    is_constant,
    undefined_test,
)
from tlr_exp.errors import UserError


@dataclass(frozen=True)
class Band:
    """Mean over seeds and one standard deviation to both sides, each [num_iterations]."""

    mean: Array
    std: Array  # sample standard deviation (n - 1); NaN for a single seed
    num_seeds: int

    @property
    def low(self) -> Array:
        """Mean less one standard deviation."""
        return self.mean - self.std

    @property
    def high(self) -> Array:
        """Mean plus one standard deviation."""
        return self.mean + self.std


@dataclass(frozen=True)
class Dependence:
    """How far the iterations of a curve are from being independent; NaN for a constant curve."""

    lag_one: float  # autocorrelation of neighbouring iterations
    integrated_time: float  # iterations
    effective_sample_size: float  # independent iterations that would be worth as much
    num_iterations: int


@dataclass(frozen=True)
class PaperAnalysis:
    """What the paper reports of two arms and one metric, and how independent its iterations are."""

    baseline: Band
    treatment: Band
    relative_improvement: Array  # [num_iterations], a share; positive where treatment is better
    average_improvement: float  # its mean over iterations, a share
    iteration_test: SignificanceTest  # says nothing about seeds: see the module
    dependence: (
        Dependence  # of the difference of the averaged curves, the values that the test takes
    )


def seed_band(curves: ArrayLike) -> Band:
    """Mean over seeds ± one sample standard deviation of curves [num_seeds, num_iterations].

    Raises:
        ValueError: not two-dimensional, empty, or not finite.
    """
    values = checked_curves(curves, "curves")
    num_seeds = values.shape[0]
    spread = values.std(axis=0, ddof=1) if num_seeds > 1 else np.full(values.shape[1], np.nan)
    return Band(values.mean(axis=0), spread, num_seeds)


def relative_improvement(
    baseline: ArrayLike, treatment: ArrayLike, *, smaller_is_better: bool = True
) -> Array:
    """(e_baseline - e_treatment) / e_baseline of two averaged curves [num_iterations] (Figure 8).

    Positive where treatment is better; if larger is better, the numerator has the other sign.

    Raises:
        ValueError: different lengths, or a baseline that is not positive, of which no share exists.
    """
    first, second = _checked_means(baseline, treatment)
    if (first <= 0).any():
        raise UserError(
            "a relative improvement needs a positive baseline, but its smallest value is "
            f"{first.min()}"
        )
    change = (first - second) / first
    return change if smaller_is_better else -change


def iteration_t_test(baseline: ArrayLike, treatment: ArrayLike) -> SignificanceTest:
    """Paired t-test over the iterations of two seed-averaged curves [num_iterations].

    It says nothing about seeds, and its p-value is far too small: see the module. NaN with a reason
    for a single iteration, or where the curves differ by a constant.

    Raises:
        ValueError: different lengths.
    """
    name = "paired t over iterations"
    first, second = _checked_means(baseline, treatment)
    if first.size < 2:
        return undefined_test(name, "one iteration has no spread")
    if is_constant(second - first, float(max(np.abs(first).max(), np.abs(second).max()))):
        return undefined_test(name, "the averaged curves differ by a constant")
    result = stats.ttest_rel(second, first)
    return SignificanceTest(name, float(result.statistic), float(result.pvalue))  # pyright: ignore


def dependence(series: ArrayLike) -> Dependence:
    """How far the iterations of a series [num_iterations] are from being independent.

    A trend counts as dependence, as it should: along a trend, neighbours tell the same.
    """
    values = np.asarray(series, dtype=np.float64)
    if values.size < 2 or is_constant(values):
        return Dependence(np.nan, np.nan, np.nan, values.size)
    tau = integrated_time(values)
    return Dependence(float(autocorrelation(values)[1]), tau, values.size / tau, values.size)


def paper_analysis(
    baseline: ArrayLike, treatment: ArrayLike, *, smaller_is_better: bool = True
) -> PaperAnalysis:
    """The paper's analysis of curves [num_seeds, num_iterations] of two arms.

    Also of one run each, as its Figures 6 to 8 show; the bands are NaN then.

    Raises:
        ValueError: wrong shapes, values that are not finite, a baseline that is not positive.
    """
    bands = seed_band(baseline), seed_band(treatment)
    first, second = bands[0].mean, bands[1].mean
    improvement = relative_improvement(first, second, smaller_is_better=smaller_is_better)
    return PaperAnalysis(
        baseline=bands[0],
        treatment=bands[1],
        relative_improvement=improvement,
        average_improvement=float(improvement.mean()),
        iteration_test=iteration_t_test(first, second),
        dependence=dependence(second - first),
    )


def _checked_means(baseline: ArrayLike, treatment: ArrayLike) -> tuple[Array, Array]:
    first = np.asarray(baseline, dtype=np.float64)
    second = np.asarray(treatment, dtype=np.float64)
    if first.ndim != 1 or first.shape != second.shape or first.size == 0:
        raise UserError(
            "averaged curves must be [num_iterations] over the same iterations, got shapes "
            f"{first.shape} and {second.shape}"
        )
    return first, second
