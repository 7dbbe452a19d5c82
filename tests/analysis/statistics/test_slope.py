"""Changes at the end of training by hand and against SciPy, and the rate of false alarms."""

import numpy as np
import pytest
from scipy import stats

from analysis.statistics.nulls import ar1_curves
from analysis.statistics.slope import tail_change


def test_lines_by_hand() -> None:
    """From 10 by -0.1 and -0.2 an iteration: over the last 20 of 100 by 2 and 4.

    Means there, of iterations 81 to 100: 10 - 0.1 * 90.5 = 0.95 and 10 - 18.1 below zero; so from
    30: 20.95 and 11.9.
    """
    at = np.arange(1, 101)
    found = tail_change([30 - 0.1 * at, 30 - 0.2 * at], at)
    assert found.by_seed == pytest.approx([-2 / 20.95, -4 / 11.9])
    assert found.mean.estimate == pytest.approx(np.mean([-2 / 20.95, -4 / 11.9]))


def test_slopes_and_test_are_those_of_scipy() -> None:
    at = np.arange(1, 61)
    curves = 5 + np.random.default_rng(0).standard_normal((5, 60)).cumsum(axis=1) / 30
    found = tail_change(curves, at)
    last = at > 48
    slopes = [stats.linregress(at[last], row[last]).slope for row in curves]
    shares = np.array(slopes) * 12 / curves[:, last].mean(axis=1)
    assert found.by_seed == pytest.approx(shares)
    expected = stats.ttest_1samp(shares, 0)
    assert found.test.p_value == pytest.approx(expected.pvalue)
    limits = expected.confidence_interval()
    assert (found.mean.low, found.mean.high) == pytest.approx((limits.low, limits.high))


def test_curves_that_have_settled_are_called_moving_as_often_as_stated() -> None:
    """Dependent iterations change nothing in that: each seed gives one number."""
    generator = np.random.default_rng(2)
    curves = 50 + ar1_curves((600, 5, 60), 0.9, 1.0, generator)
    p_values = [tail_change(each, np.arange(1, 61)).test.p_value for each in curves]
    # Three binomial standard errors of 600 studies at 5 % are 2.7 %.
    assert np.mean(np.asarray(p_values) <= 0.05) == pytest.approx(0.05, abs=0.027)


def test_what_cannot_be_known_has_a_reason() -> None:
    assert tail_change([[1.0, 2, 3, 4, 5, 6, 7, 8, 9, 10]], range(1, 11)).test.reason == (
        "one seed has no spread"
    )
    short = tail_change([[1.0, 2.0], [1.0, 3.0]], [1, 2])
    assert "fewer than two points" in short.mean.reason
    with pytest.raises(ValueError, match="positive at their end"):
        tail_change(-np.ones((2, 10)), range(1, 11))
