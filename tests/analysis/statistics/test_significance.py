"""Tests over seeds against hand arithmetic, SciPy and their own exactness."""

from itertools import combinations
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from analysis.statistics.results import DRAWN_LABELINGS
from analysis.statistics.significance import (
    holm,
    mann_whitney,
    paired_t,
    permutation,
    sign_flip,
    smallest_p,
    welch_t,
    wilcoxon,
)

BASELINE = [5.0, 6.0, 7.0, 8.0, 9.0]
TREATMENT = [0.0, 1.0, 2.0, 3.0, 4.0]


def rng() -> np.random.Generator:
    return np.random.default_rng(20)


def test_welch_t_by_hand() -> None:
    # Both variances are 2.5, so the standard error is sqrt(2.5 / 5 + 2.5 / 5) = 1 and t is the
    # difference, -5; Welch's degrees of freedom are 8 for equal variances and sizes.
    result = welch_t(BASELINE, TREATMENT)
    assert result.statistic == pytest.approx(-5.0)
    assert result.p_value == pytest.approx(2 * stats.t.sf(5.0, 8))


def test_paired_t_by_hand() -> None:
    # Differences 1, 2, 3: mean 2, standard error 1 / sqrt(3), so t = 2 sqrt(3).
    result = paired_t([0.0, 0.0, 0.0], [1.0, 2.0, 3.0])
    assert result.statistic == pytest.approx(2 * 3**0.5)
    assert result.p_value == pytest.approx(2 * stats.t.sf(2 * 3**0.5, 2))


def test_the_most_extreme_labeling_has_the_smallest_p_value() -> None:
    for test in (permutation, mann_whitney):
        assert test(BASELINE, TREATMENT, generator=rng()).p_value == pytest.approx(2 / 252)
    assert smallest_p(5, 5) == pytest.approx(2 / comb(10, 5)) == pytest.approx(0.0079, abs=5e-5)
    # Improvements of different sizes, so that Wilcoxon's ranks have no ties.
    treatment = np.array(BASELINE) - [1.0, 2.1, 3.3, 4.6, 5.0]
    for test in (sign_flip, wilcoxon):
        assert test(BASELINE, treatment, generator=rng()).p_value == pytest.approx(2 / 32)
    assert smallest_p(5, 5, paired=True) == 0.0625


def test_permutation_by_hand() -> None:
    # {0, 3} against {1, 2, 5}: the ten pairs of the five numbers sum to 1 2 5 3 4 7(2+5) 6(1+5)
    # 8(3+5) 5(2+3) 3(0+3, the one seen), so four sums are at most 3 (1, 2, 3, 3): p = 2 * 4 / 10.
    result = permutation([0.0, 3.0], [1.0, 2.0, 5.0], generator=rng())
    assert result.name == "exact permutation"
    assert result.statistic == pytest.approx(8 / 3 - 3 / 2)
    assert result.p_value == pytest.approx(0.8)


def test_sign_flip_by_hand() -> None:
    # Differences 1, 2, -3 sum to 0; of the sums ±1 ±2 ±3, five are >= 0 (6, 4, 2, 0, 0): p is 1.
    # Differences 3, 4, -1 sum to 6: of ±3 ±4 ±1 two are >= 6 (8, 6): p = 2 * 2 / 8.
    zeros = np.zeros(3)
    assert sign_flip(zeros, [1.0, 2.0, -3.0], generator=rng()).p_value == 1.0
    assert sign_flip(zeros, [3.0, 4.0, -1.0], generator=rng()).p_value == pytest.approx(0.5)


def test_permutation_is_exact() -> None:
    # Whatever the values are: of all labelings, no more than a share p has a p-value of p or less.
    values = np.random.default_rng(3).lognormal(size=8)
    p_values = []
    for chosen in combinations(range(8), 4):
        rest = [i for i in range(8) if i not in chosen]
        p_values.append(permutation(values[list(chosen)], values[rest], generator=rng()).p_value)
    ordered = np.sort(p_values)
    assert len(ordered) == 70
    assert (ordered >= np.arange(1, 71) / 70 - 1e-12).all()
    assert ordered[0] == pytest.approx(2 / 70)


def test_drawn_labelings_agree_with_welch_for_many_normal_seeds() -> None:
    generator = np.random.default_rng(4)
    first, second = generator.normal(0.0, 1.0, 40), generator.normal(0.5, 1.0, 40)
    result = permutation(first, second, generator=generator)
    assert result.name == "drawn permutation"
    assert result.p_value == pytest.approx(welch_t(first, second).p_value, abs=0.01)
    assert result.p_value >= 1 / (DRAWN_LABELINGS + 1)
    same = permutation(first, second, generator=np.random.default_rng(5))
    assert same == permutation(first, second, generator=np.random.default_rng(5))
    flipped = sign_flip(first, second, generator=generator)
    assert flipped.name == "drawn sign-flip permutation"
    assert flipped.p_value == pytest.approx(paired_t(first, second).p_value, abs=0.01)


def test_mann_whitney_with_ties_by_hand() -> None:
    # {1, 1} against {1, 2}: U is 2 / 2 + 2 = 3. Of the six labelings of 1 1 1 2, three put the 2
    # into treatment (U = 3) and three into baseline (U = 1): p = 2 * 3 / 6.
    result = mann_whitney([1.0, 1.0], [1.0, 2.0], generator=rng())
    assert (result.statistic, result.p_value) == (3.0, 1.0)


def test_rank_tests_follow_scipy_without_ties() -> None:
    generator = np.random.default_rng(6)
    for size in (4, 7, 60):
        first, second = generator.normal(size=(2, size))
        expected = stats.mannwhitneyu(second, first)
        actual = mann_whitney(first, second, generator=generator)
        # SciPy chooses the normal approximation from nine on, this house from 51 on.
        assert actual.p_value == pytest.approx(expected.pvalue)
        assert actual.statistic == expected.statistic
        expected = stats.wilcoxon(second, first)
        assert wilcoxon(first, second, generator=generator).p_value == pytest.approx(
            expected.pvalue
        )


def test_wilcoxon_with_zero_differences_counts_the_others() -> None:
    # Differences 0, 1, 2, 3: of the eight signs of the three, the smallest rank sum has p = 2 / 8.
    result = wilcoxon([1.0, 1.0, 1.0, 1.0], [1.0, 2.0, 3.0, 4.0], generator=rng())
    assert result.p_value == pytest.approx(0.25)


@given(st.integers(0, 2**32 - 1), st.sampled_from([permutation, mann_whitney, sign_flip, wilcoxon]))
@settings(max_examples=20)
def test_swapping_the_arms_changes_no_p_value(seed: int, test) -> None:
    first, second = np.random.default_rng(seed).normal(size=(2, 4))
    forth = test(first, second, generator=rng()).p_value
    assert test(second, first, generator=rng()).p_value == pytest.approx(forth)


def test_holm_by_hand() -> None:
    # Sorted 0.01 0.02 0.03 0.2 times 4 3 2 1: 0.04 0.06 0.06 0.2, and never less than the one
    # before.
    np.testing.assert_allclose(holm([0.03, 0.2, 0.01, 0.02]), [0.06, 0.2, 0.04, 0.06])
    np.testing.assert_allclose(holm([0.6, 0.7]), [1.0, 1.0])
    np.testing.assert_allclose(holm([0.02]), [0.02])


def test_holm_counts_an_undefined_test() -> None:
    np.testing.assert_allclose(holm([np.nan, 0.01, 0.04]), [np.nan, 0.03, 0.08])


def test_holm_keeps_the_family_wise_error() -> None:
    # Five independent true nulls: some adjusted p <= 0.05 with probability 1 - (1 - 0.01)^5 =
    # 0.049.
    p_values = np.random.default_rng(8).uniform(size=(4000, 5))
    rate = np.mean([holm(row).min() <= 0.05 for row in p_values])
    assert rate == pytest.approx(0.049, abs=4 * (0.049 * 0.951 / 4000) ** 0.5)


def test_undefined_tests_say_why() -> None:
    constant = [0.1, 0.1, 0.1]
    result = welch_t(constant, [0.3, 0.3, 0.3])
    assert np.isnan(result.p_value)
    assert "neither arm varies" in result.reason
    result = paired_t([0.1, 0.2, 0.3], [0.2, 0.3, 0.4])
    assert np.isnan(result.p_value)
    assert "do not vary" in result.reason
    for test in (permutation, mann_whitney, sign_flip, wilcoxon):
        result = test([1.0], [2.0], generator=rng())
        assert np.isnan(result.p_value)
        assert "one seed" in result.reason


def test_one_constant_arm_is_enough_spread() -> None:
    # Standard error sqrt(1 / 3) of 1, 2, 3 alone, with its two degrees of freedom.
    result = welch_t([0.1, 0.1, 0.1], [1.0, 2.0, 3.0])
    assert result.statistic == pytest.approx(1.9 * 3**0.5)
    assert result.p_value == pytest.approx(2 * stats.t.sf(1.9 * 3**0.5, 2))


def test_constant_arms_that_agree_are_not_different() -> None:
    same = [0.1, 0.1, 0.1]
    for test in (permutation, mann_whitney, sign_flip, wilcoxon):
        assert test(same, same, generator=rng()).p_value == 1.0


def test_wrong_data_is_refused() -> None:
    with pytest.raises(ValueError, match="1 of 2 values are not"):
        welch_t([1.0, np.nan], [1.0, 2.0])
    with pytest.raises(ValueError, match=r"treatment must be one number per seed.*shape \(0,\)"):
        welch_t([1.0, 2.0], [])
    with pytest.raises(ValueError, match="same seeds in both arms, got 2 of baseline and 3"):
        paired_t([1.0, 2.0], [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="share their seeds"):
        smallest_p(2, 3, paired=True)
    with pytest.raises(ValueError, match="at least one seed"):
        smallest_p(0, 3)
    with pytest.raises(ValueError, match=r"numbers in \[0, 1\]"):
        holm([0.1, 1.2])
