"""Intervals against SciPy, and how often they hold the true value."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from analysis.statistics import intervals
from analysis.statistics.intervals import (
    bootstrap_interval,
    difference_interval,
    interquartile_mean,
    mean_interval,
    relative_improvement_interval,
)
from analysis.statistics.results import Interval

Pair = tuple[np.ndarray, np.ndarray]


def coverage(interval: Callable[[], Interval], truth: float, studies: int) -> float:
    made = [interval() for _ in range(studies)]
    return float(np.mean([one.low <= truth <= one.high for one in made]))


def tolerance(rate: float, studies: int) -> float:
    """Four binomial standard errors."""
    return 4 * (rate * (1 - rate) / studies) ** 0.5


def test_interquartile_mean_drops_a_quarter_at_each_end() -> None:
    assert interquartile_mean([9.0, 1.0, 2.0, 3.0, -50.0]) == pytest.approx(2.0)
    assert interquartile_mean([1.0, 2.0, 6.0]) == pytest.approx(3.0)
    assert interquartile_mean(np.arange(8.0)) == pytest.approx(3.5)


def test_mean_interval_by_hand() -> None:
    # 1, 2, 3: standard error 1 / sqrt(3); t of 97.5 % with 2 degrees of freedom is 4.30265.
    result = mean_interval([1.0, 2.0, 3.0])
    assert result.high - 2 == pytest.approx(4.30265 / 3**0.5, abs=1e-5)
    assert 2 - result.low == pytest.approx(4.30265 / 3**0.5, abs=1e-5)


@pytest.mark.parametrize("paired", [False, True])
def test_difference_interval_is_that_of_the_test(paired: bool) -> None:
    # An interval of confidence 1 - p ends at zero where the test has the p-value p.
    first, second = np.random.default_rng(1).normal(size=(2, 6))
    test = stats.ttest_rel if paired else lambda a, b: stats.ttest_ind(a, b, equal_var=False)
    p_value = test(second, first).pvalue
    result = difference_interval(first, second, paired=paired, confidence=1 - p_value)
    assert min(abs(result.low), abs(result.high)) == pytest.approx(0.0, abs=1e-9)
    assert result.estimate == pytest.approx(second.mean() - first.mean())


def test_fieller_by_hand() -> None:
    # Means 10 and 8 with variances of the mean 1 and 1, seven pairs without covariance: t = 2.4469
    # with 6 degrees of freedom, t^2 = 5.9874, so (100 - 5.9874) rho^2 - 160 rho + 64 - 5.9874 = 0
    # has the roots rho = (80 -+ sqrt(6400 - 94.0126 * 58.0126)) / 94.0126 = 0.52378 and 1.17812.
    steps = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]) * 1.5**0.5
    even = np.array([5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0]) / 2**0.5  # orthogonal to steps
    result = relative_improvement_interval(
        10 + steps, 8 + even, smaller_is_better=True, paired=True
    )
    assert result.estimate == pytest.approx(0.2)
    assert result.low == pytest.approx(1 - 1.17812, abs=1e-4)
    assert result.high == pytest.approx(1 - 0.52378, abs=1e-4)


def test_fieller_of_one_arm_that_varies_is_closed() -> None:
    # Only the baseline 9, 10, 11 varies, so the degrees of freedom are its two, t = 4.30265, the
    # standard error is 1 / sqrt(3), and rho = 8 / (10 +- t / sqrt(3)).
    result = relative_improvement_interval([9.0, 10.0, 11.0], [8.0] * 5, smaller_is_better=True)
    margin = 4.30265 / 3**0.5
    assert result.low == pytest.approx(1 - 8 / (10 - margin), abs=1e-5)
    assert result.high == pytest.approx(1 - 8 / (10 + margin), abs=1e-5)
    # Only the treatment 7, 8, 9 varies: rho = (8 +- t / sqrt(3)) / 10.
    result = relative_improvement_interval([10.0] * 5, [7.0, 8.0, 9.0], smaller_is_better=True)
    assert (result.low, result.high) == pytest.approx(
        (0.2 - margin / 10, 0.2 + margin / 10), abs=1e-5
    )


def test_fieller_weighs_both_arms_degrees_of_freedom() -> None:
    # Variances of the means 1 / 3 (baseline, 2 degrees of freedom) and 1 (treatment, 2), ratio 2:
    # of the variance of mean_t - 2 mean_b, 1 + 4 / 3, Satterthwaite's (7/3)^2 / (1/2 + (4/3)^2 / 2)
    # = 5.4444 / 1.3889 = 3.92 degrees of freedom.
    steps = np.array([-1.0, 0.0, 1.0])
    baseline, treatment = 10 + steps, 20 + 3**0.5 * steps
    result = relative_improvement_interval(baseline, treatment, smaller_is_better=False)
    squared_t = stats.t.ppf(0.975, 3.92) ** 2
    for ratio in (1 + result.low, 1 + result.high):
        assert (20 - 10 * ratio) ** 2 == pytest.approx(squared_t * (1 + ratio**2 / 3))


@pytest.mark.parametrize("paired", [False, True])
def test_fieller_is_the_set_of_ratios_that_a_t_test_keeps(paired: bool) -> None:
    generator = np.random.default_rng(2)
    first, second = generator.normal(2.0, 0.3, 6), generator.normal(1.5, 0.2, 6)
    result = relative_improvement_interval(first, second, smaller_is_better=True, paired=paired)
    ratios = 1 - np.array([result.low, result.high])
    if paired:
        for ratio in ratios:
            assert stats.ttest_rel(second, ratio * first).pvalue == pytest.approx(0.05)
    else:
        # The degrees of freedom are those at the estimate, which moves the ends a little.
        for ratio in ratios:
            test = stats.ttest_ind(second, ratio * first, equal_var=False)
            assert test.pvalue == pytest.approx(0.05, abs=0.01)


def test_improvement_of_what_should_grow_is_mirrored() -> None:
    first, second = [10.0, 11.0, 12.0, 9.0], [13.0, 12.0, 15.0, 14.0]
    longer = relative_improvement_interval(first, second, smaller_is_better=False)
    shorter = relative_improvement_interval(first, second, smaller_is_better=True)
    assert longer.estimate == pytest.approx(13.5 / 10.5 - 1)
    assert (longer.low, longer.high) == pytest.approx((-shorter.high, -shorter.low))
    assert longer.low < longer.estimate < longer.high


def independent(generator: np.random.Generator, num_seeds: int) -> Pair:
    return generator.normal(1.0, 0.2, num_seeds), generator.normal(0.8, 0.1, num_seeds)


def shared(generator: np.random.Generator, num_seeds: int) -> Pair:
    common = generator.normal(0.0, 0.2, num_seeds)
    first, second = independent(generator, num_seeds)
    return first + common, second + common


@pytest.mark.simulation
@pytest.mark.parametrize(("draw", "paired"), [(independent, False), (shared, True)])
@pytest.mark.parametrize("num_seeds", [3, 5])
def test_t_intervals_cover(draw: Callable, paired: bool, num_seeds: int) -> None:
    generator = np.random.default_rng(5)
    studies = 1500
    difference = coverage(
        lambda: difference_interval(*draw(generator, num_seeds), paired=paired), -0.2, studies
    )
    # Welch's interval is a little too long with three seeds.
    slack = 0.02 if num_seeds == 3 and not paired else 0.0
    assert difference == pytest.approx(0.95, abs=tolerance(0.95, studies) + slack)


@pytest.mark.simulation
@pytest.mark.parametrize(("draw", "paired"), [(independent, False), (shared, True)])
def test_fieller_intervals_cover(draw: Callable, paired: bool) -> None:
    generator = np.random.default_rng(6)
    studies = 3000
    rate = coverage(
        lambda: relative_improvement_interval(
            *draw(generator, 5), smaller_is_better=True, paired=paired
        ),
        0.2,
        studies,
    )
    slack = 0.0 if paired else 0.015  # Satterthwaite's degrees of freedom are careful
    assert rate == pytest.approx(0.95, abs=tolerance(0.95, studies) + slack)


@pytest.mark.simulation
@pytest.mark.parametrize(("num_seeds", "expected"), [(5, 0.882), (20, 0.936)])
def test_bootstrap_covers_from_twenty_seeds_on(
    num_seeds: int, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Resampling has the variance (n - 1) / n of the unbiased one and normal, not t, quantiles, so
    # about P(|t with 2n - 2 degrees of freedom| < 1.96 sqrt((n - 1) / n)) of the intervals cover.
    closed = float(
        1 - 2 * stats.t.sf(1.96 * ((num_seeds - 1) / num_seeds) ** 0.5, 2 * num_seeds - 2)
    )
    assert closed == pytest.approx(expected, abs=5e-4)
    monkeypatch.setattr(intervals, "BOOTSTRAP_SEEDS", 2)
    monkeypatch.setattr(intervals, "BOOTSTRAP_RESAMPLES", 499)
    generator = np.random.default_rng(7)
    studies = 800

    def draw() -> Interval:
        first, second = generator.normal(size=(2, num_seeds))
        return bootstrap_interval(first, second, generator=generator)

    assert coverage(draw, 0.0, studies) == pytest.approx(closed, abs=tolerance(closed, studies))


@pytest.mark.parametrize("paired", [False, True])
def test_bootstrap_of_many_seeds_is_the_t_interval(paired: bool) -> None:
    generator = np.random.default_rng(9)
    first, second = shared(generator, 200)
    drawn = bootstrap_interval(first, second, generator=generator, paired=paired)
    known = difference_interval(first, second, paired=paired)
    width = known.high - known.low
    assert drawn.low == pytest.approx(known.low, abs=0.05 * width)
    assert drawn.high == pytest.approx(known.high, abs=0.05 * width)


def test_bootstrap_refuses_few_seeds() -> None:
    result = bootstrap_interval([1.0] * 19, [2.0] * 30, generator=np.random.default_rng(0))
    assert result.estimate == pytest.approx(1.0)
    assert np.isnan(result.low)
    assert "below 20 seeds per arm" in result.reason
    assert "here are 19" in result.reason


def test_undefined_intervals_say_why() -> None:
    assert "one seed" in mean_interval([1.0]).reason
    assert "do not vary" in mean_interval([0.1, 0.1]).reason
    assert "baseline has one seed" in difference_interval([1.0], [1.0, 2.0]).reason
    assert "neither arm varies" in difference_interval([1.0, 1.0], [2.0, 2.0]).reason

    def improvement(baseline: list[float], treatment: list[float]) -> Interval:
        return relative_improvement_interval(baseline, treatment, smaller_is_better=True)

    assert "not positive" in improvement([-1.0, 0.5], [1.0, 2.0]).reason
    assert "told from zero" in improvement([0.1, 2.0], [1.0, 2.0]).reason
    assert improvement([1.0, 1.0], [0.5, 0.5]).estimate == pytest.approx(0.5)


def test_wrong_confidence_is_refused() -> None:
    with pytest.raises(ValueError, match=r"between 0 and 1 .*got 95"):
        difference_interval([1.0, 2.0], [1.0, 2.0], confidence=95)
