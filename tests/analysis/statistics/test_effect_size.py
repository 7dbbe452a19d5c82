"""Effect sizes against closed forms, and the coverage and bias of simulated ones."""

from math import gamma, sqrt

import numpy as np
import pytest
from scipy import stats

from analysis.statistics import effect_size
from analysis.statistics.effect_size import (
    hedges_g,
    noncentrality_limits,
    probability_of_improvement,
    small_sample_correction,
)


@pytest.mark.parametrize("freedom", [2, 3, 8, 18, 100])
def test_correction_is_the_ratio_of_gamma_functions(freedom: int) -> None:
    exact = gamma(freedom / 2) / (sqrt(freedom / 2) * gamma((freedom - 1) / 2))
    assert small_sample_correction(freedom) == pytest.approx(exact)
    # Hedges' approximation 1 - 3 / (4 df - 1) is good to half a percent from eight on.
    if freedom >= 8:
        assert small_sample_correction(freedom) == pytest.approx(
            1 - 3 / (4 * freedom - 1), abs=5e-3
        )


def test_correction_of_two_degrees_by_hand() -> None:
    # Gamma(1) / Gamma(1 / 2) = 1 / sqrt(pi).
    assert small_sample_correction(2) == pytest.approx(1 / sqrt(np.pi))
    with pytest.raises(ValueError, match="from two degrees of freedom on, got 1"):
        small_sample_correction(1)


def test_g_by_hand() -> None:
    # Means 7 and 2, both variances 2.5: d = 5 / sqrt(2.5). J of 8 degrees of freedom is
    # Gamma(4) / (2 Gamma(3.5)) = 6 / (2 * 3.32335).
    baseline, treatment = [5.0, 6.0, 7.0, 8.0, 9.0], [0.0, 1.0, 2.0, 3.0, 4.0]
    smaller = hedges_g(baseline, treatment, smaller_is_better=True)
    assert smaller.estimate == pytest.approx(6 / (2 * 3.32335) * 5 / 2.5**0.5, rel=1e-5)
    larger = hedges_g(baseline, treatment, smaller_is_better=False)
    assert (larger.estimate, larger.low, larger.high) == pytest.approx(
        (-smaller.estimate, -smaller.high, -smaller.low)
    )


def test_g_of_shared_seeds_by_hand() -> None:
    # Differences -1, -2, -3: mean 2, standard deviation 1, J of 2 degrees of freedom 1 / sqrt(pi).
    result = hedges_g([5.0, 7.0, 9.0], [4.0, 5.0, 6.0], smaller_is_better=True, paired=True)
    assert result.estimate == pytest.approx(2 / sqrt(np.pi))


def test_limits_are_where_the_statistic_is_a_quantile() -> None:
    low, high = noncentrality_limits(2.0, 8, 0.9)
    assert stats.nct.cdf(2.0, 8, low) == pytest.approx(0.95)
    assert stats.nct.cdf(2.0, 8, high) == pytest.approx(0.05)
    # The test of no effect and the interval agree: a p-value of 1 - confidence, a limit at 0.
    p_value = float(2 * stats.t.sf(2.0, 8))
    assert noncentrality_limits(2.0, 8, 1 - p_value)[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("freedom", [2, 8, 30, 200])
def test_both_integrals_of_the_noncentral_t_agree(
    freedom: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    statistic = 29 * sqrt(freedom)
    scipys = noncentrality_limits(statistic, freedom, 0.95)
    monkeypatch.setattr(effect_size, "LARGE_STATISTIC", 1.0)
    assert noncentrality_limits(statistic, freedom, 0.95) == pytest.approx(scipys, rel=1e-8)


@pytest.mark.parametrize("statistic", [0.0, 0.5, -7.0, 99.0, -1e3, 1e5, 1e9])
@pytest.mark.parametrize("freedom", [2, 4, 8, 1000])
def test_limits_exist_however_large_the_effect(statistic: float, freedom: int) -> None:
    low, high = noncentrality_limits(statistic, freedom, 0.95)
    assert low < statistic < high
    assert noncentrality_limits(-statistic, freedom, 0.95) == pytest.approx((-high, -low), abs=1e-6)


@pytest.mark.simulation
@pytest.mark.parametrize(("paired", "effect"), [(False, 0.0), (False, 2.0), (True, 1.0)])
def test_g_is_unbiased_and_its_interval_covers(paired: bool, effect: float) -> None:
    generator = np.random.default_rng(12)
    studies = 800
    results = []
    for _ in range(studies):
        first, second = generator.normal(size=(2, 5))
        if paired:
            second = first + generator.normal(size=5)
        results.append(hedges_g(first, second + effect, smaller_is_better=False, paired=paired))
    estimates = np.array([result.estimate for result in results])
    error = estimates.std() / studies**0.5
    assert estimates.mean() == pytest.approx(effect, abs=4 * error)
    covered = np.mean([result.low <= effect <= result.high for result in results])
    assert covered == pytest.approx(0.95, abs=4 * (0.95 * 0.05 / studies) ** 0.5)


def test_undefined_effect_sizes_say_why() -> None:
    assert "one seed" in hedges_g([1.0], [2.0, 3.0], smaller_is_better=True).reason
    assert "neither arm" in hedges_g([1.0, 1.0], [2.0, 2.0], smaller_is_better=True).reason
    two = hedges_g([1.0, 2.0], [2.0, 4.0], smaller_is_better=True, paired=True)
    assert np.isnan(two.estimate)
    assert "two shared seeds" in two.reason


def test_probability_of_improvement_by_hand() -> None:
    # Pairs of {1, 2} and {2, 3}: 1-2 larger, 1-3 larger, 2-2 tie, 2-3 larger: 3.5 of 4.
    assert probability_of_improvement([1.0, 2.0], [2.0, 3.0], smaller_is_better=False) == 0.875
    assert probability_of_improvement([1.0, 2.0], [2.0, 3.0], smaller_is_better=True) == 0.125
    assert probability_of_improvement([1.0], [1.0], smaller_is_better=True) == 0.5


def test_probability_of_improvement_is_u_over_the_pairs() -> None:
    first, second = np.random.default_rng(13).integers(0, 5, (2, 9)).astype(float)
    u = stats.mannwhitneyu(second, first).statistic
    probability = probability_of_improvement(first, second, smaller_is_better=False)
    assert probability == pytest.approx(u / 81)
