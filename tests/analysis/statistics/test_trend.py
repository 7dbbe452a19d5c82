"""Tests of a swept number: by hand, against SciPy, and under a true null."""

from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from analysis.statistics.trend import trend


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_exact_p_values_by_hand():
    """Four runs in order at two values.

    Spearman's p: of 4! = 24 orders 4 give a correlation as large (within a value the order does
    not matter), so 2 * 4 / 24. H: of the C(4, 2) = 6 labelings the ordered one and its mirror image
    are as far apart, so 2 / 6.
    """
    found = trend([1.0, 2.0], [[1.0, 2.0], [3.0, 4.0]], generator=rng())
    assert found.monotone.p_value == pytest.approx(8 / 24)
    assert found.any_difference.p_value == pytest.approx(2 / comb(4, 2))


def test_statistics_are_scipys():
    generator = np.random.default_rng(3)
    values = [0.02, 0.1, 0.5]
    samples = [generator.normal(size=n).round(1) for n in (3, 5, 4)]  # rounded: with ties
    found = trend(values, samples, generator=rng())
    at = np.repeat(values, [3, 5, 4])
    expected = stats.spearmanr(at, np.concatenate(samples)).statistic
    assert found.monotone.statistic == pytest.approx(expected)
    assert found.any_difference.statistic == pytest.approx(stats.kruskal(*samples).statistic)


def test_many_runs_come_near_the_large_sample_p_values():
    generator = np.random.default_rng(5)
    samples = [generator.normal(0.25 * place, 1.0, 30) for place in range(3)]
    found = trend([1.0, 2.0, 3.0], samples, generator=rng())
    at = np.repeat([1.0, 2.0, 3.0], 30)
    expected = stats.spearmanr(at, np.concatenate(samples)).pvalue
    assert found.monotone.p_value == pytest.approx(expected, abs=0.01)
    assert found.any_difference.p_value == pytest.approx(stats.kruskal(*samples).pvalue, abs=0.01)


def test_best_in_the_middle_is_a_difference_but_no_trend():
    generator = np.random.default_rng(1)
    samples = [generator.normal(mean, 0.1, 5) for mean in (1.0, 0.0, 1.0)]
    found = trend([1.0, 2.0, 3.0], samples, generator=rng())
    assert found.any_difference.p_value < 0.01
    assert found.monotone.p_value > 0.1


@pytest.mark.simulation
@pytest.mark.parametrize("test", ["monotone", "any_difference"])
def test_false_alarms_under_a_true_null(test):
    """Of 200 studies without an effect a sound test calls 5 % significant; 10 % would be 3.2 sd."""
    generator = np.random.default_rng(2)
    alarms = 0
    for _ in range(200):
        samples = generator.normal(size=(3, 3))
        alarms += getattr(trend([1, 2, 3], list(samples), generator=rng()), test).p_value <= 0.05
    assert alarms <= 20


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.lists(st.integers(-50, 50), min_size=1, max_size=4), min_size=2, max_size=4),
    st.integers(0, 5),
)
def test_only_the_order_matters(samples, power):
    """A growing function of results and values changes nothing."""
    values = np.arange(1.0, len(samples) + 1)
    first = trend(values, samples, generator=rng())
    bent = [np.array(sample, float) ** 3 for sample in samples]
    second = trend(values ** (power + 1), bent, generator=rng())
    np.testing.assert_equal(first.monotone.p_value, second.monotone.p_value)
    np.testing.assert_equal(first.any_difference.p_value, second.any_difference.p_value)


def test_constant_runs_have_no_test():
    found = trend([1.0, 2.0], [[3.0, 3.0], [3.0]], generator=rng())
    assert np.isnan([found.monotone.p_value, found.any_difference.p_value]).all()
    assert found.monotone.reason == "the runs do not vary"


def test_one_run_per_value_has_a_direction_alone():
    found = trend([1.0, 2.0, 3.0], [[1.0], [2.0], [3.0]], generator=rng())
    assert found.monotone.statistic == pytest.approx(1.0)
    assert found.any_difference.reason == "one run per value shows no spread"


@pytest.mark.parametrize(
    ("values", "samples"),
    [([1.0], [[1.0]]), ([1.0, 1.0], [[1.0], [2.0]]), ([1.0, 2.0], [[1.0]])],
)
def test_what_is_no_sweep_is_refused(values, samples):
    with pytest.raises(ValueError, match="two or more different values"):
        trend(values, samples, generator=rng())
