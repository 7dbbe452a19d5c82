"""The paper's analysis by hand arithmetic."""

import numpy as np
import pytest
from scipy import stats

from analysis.statistics.paper import (
    dependence,
    iteration_t_test,
    paper_analysis,
    relative_improvement,
    seed_band,
)


def test_band_by_hand() -> None:
    # First iteration 1, 2, 3: mean 2, sample standard deviation 1. Second 4, 4, 7: 5 and sqrt(3).
    band = seed_band([[1.0, 4.0], [2.0, 4.0], [3.0, 7.0]])
    np.testing.assert_allclose(band.mean, [2.0, 5.0])
    np.testing.assert_allclose(band.std, [1.0, 3**0.5])
    np.testing.assert_allclose(band.low, [1.0, 5 - 3**0.5])
    np.testing.assert_allclose(band.high, [3.0, 5 + 3**0.5])
    assert band.num_seeds == 3


def test_one_run_has_a_mean_but_no_band() -> None:
    band = seed_band([[1.0, 2.0]])
    np.testing.assert_allclose(band.mean, [1.0, 2.0])
    assert np.isnan(band.low).all()


def test_relative_improvement_by_hand() -> None:
    np.testing.assert_allclose(relative_improvement([2.0, 4.0], [1.0, 5.0]), [0.5, -0.25])
    longer = relative_improvement([100.0], [150.0], smaller_is_better=False)
    np.testing.assert_allclose(longer, [0.5])


def test_iteration_test_by_hand() -> None:
    # Differences -1, -2, -3: t = -2 sqrt(3) with two degrees of freedom.
    result = iteration_t_test([2.0, 4.0, 6.0], [1.0, 2.0, 3.0])
    assert result.statistic == pytest.approx(-2 * 3**0.5)
    assert result.p_value == pytest.approx(2 * stats.t.sf(2 * 3**0.5, 2))


def test_iteration_test_sees_averages_only() -> None:
    # Spread between the seeds does not enter: the same averages give the same p-value.
    generator = np.random.default_rng(0)
    baseline, treatment = generator.normal(1.0, 0.1, (2, 5, 50))
    spread = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])[:, None]
    calm = paper_analysis(baseline, treatment).iteration_test.p_value
    wild = paper_analysis(baseline + spread, treatment - spread).iteration_test.p_value
    assert wild == pytest.approx(calm)


def test_whole_analysis_by_hand() -> None:
    baseline = [[1.0, 2.0, 4.0], [3.0, 2.0, 4.0]]  # averages 2, 2, 4
    treatment = [[1.0, 1.0, 3.0], [1.0, 2.0, 3.0]]  # averages 1, 1.5, 3
    result = paper_analysis(baseline, treatment)
    np.testing.assert_allclose(result.relative_improvement, [0.5, 0.25, 0.25])
    assert result.average_improvement == pytest.approx(1 / 3)
    assert result.iteration_test == iteration_t_test([2.0, 2.0, 4.0], [1.0, 1.5, 3.0])
    # Differences -1, -0.5, -1 less their mean: -1/6, 1/3, -1/6. Lag one: -1/9 of 1/6.
    assert result.dependence.lag_one == pytest.approx(-2 / 3)
    assert result.dependence.num_iterations == 3


def test_dependence_of_an_autocorrelated_difference() -> None:
    walk = np.cumsum(np.random.default_rng(1).normal(size=2000))
    result = dependence(walk)
    assert result.lag_one > 0.95
    assert result.effective_sample_size == pytest.approx(2000 / result.integrated_time)
    assert result.effective_sample_size < 50
    assert np.isnan(dependence([1.0, 1.0]).effective_sample_size)


def test_what_is_undefined_says_why() -> None:
    assert "one iteration" in iteration_t_test([1.0], [2.0]).reason
    assert "differ by a constant" in iteration_t_test([0.1, 0.2, 0.3], [0.2, 0.3, 0.4]).reason


def test_wrong_curves_are_refused() -> None:
    with pytest.raises(ValueError, match=r"positive baseline, but its smallest value is 0\.0"):
        relative_improvement([1.0, 0.0], [1.0, 1.0])
    with pytest.raises(ValueError, match="same iterations"):
        paper_analysis([[1.0, 2.0]], [[1.0]])
    with pytest.raises(ValueError, match="curves must be finite"):
        seed_band([[1.0, np.nan]])
    with pytest.raises(ValueError, match="one curve per seed"):
        seed_band([1.0, 2.0])
