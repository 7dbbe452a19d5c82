"""Whole curves: the statistic against SciPy, and how often a null is rejected."""

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from analysis.statistics import curves as room
from analysis.statistics.curves import compare_curves
from analysis.statistics.nulls import ar1_curves


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.mark.parametrize("sizes", [(5, 5), (3, 6)])
def test_statistic_is_welchs(sizes: tuple[int, int]) -> None:
    first, second = rng().normal(size=(sizes[0], 7)), rng(1).normal(1.0, 2.0, (sizes[1], 7))
    result = compare_curves(first, second, generator=rng())
    expected = stats.ttest_ind(second, first, axis=0, equal_var=False).statistic
    np.testing.assert_allclose(result.statistic, expected)
    np.testing.assert_allclose(result.difference, second.mean(axis=0) - first.mean(axis=0))


def test_statistic_of_shared_seeds_is_the_paired_t() -> None:
    first, second = rng().normal(size=(2, 6, 7))
    result = compare_curves(first, second, paired=True, generator=rng())
    np.testing.assert_allclose(result.statistic, stats.ttest_rel(second, first, axis=0).statistic)
    assert result.num_labelings == 64


@pytest.mark.parametrize("paired", [False, True])
def test_p_values_against_a_plain_loop(paired: bool) -> None:
    first, second = rng(2).normal(size=(2, 4, 3))
    second[:, 1] += 1.5
    result = compare_curves(first, second, paired=paired, generator=rng())
    maxima = []
    if paired:
        for number in range(16):
            signs = np.array([1 if number >> bit & 1 else -1 for bit in range(4)])[:, None]
            maxima.append(np.abs(stats.ttest_1samp(signs * (second - first), 0).statistic).max())
    else:
        pooled = np.concatenate([first, second])
        for chosen in combinations(range(8), 4):
            rest = [row for row in range(8) if row not in chosen]
            test = stats.ttest_ind(pooled[rest], pooled[list(chosen)], equal_var=False)
            maxima.append(np.abs(test.statistic).max())
    seen = np.abs(result.statistic)
    expected = [np.mean(np.array(maxima) >= one * (1 - 1e-9)) for one in seen]
    np.testing.assert_allclose(result.p_values, expected)
    assert result.p_value == min(expected)
    assert result.exact
    assert result.num_labelings == len(maxima)


def test_one_iteration_is_the_permutation_test_of_it() -> None:
    # Of arms of equal size, |t| orders the labelings as the absolute difference of means does.
    first, second = rng(3).normal(size=(2, 5, 1))
    result = compare_curves(first, second, generator=rng())
    test = stats.permutation_test(
        (first[:, 0], second[:, 0]), lambda a, b: b.mean() - a.mean(), vectorized=False
    )
    assert result.p_value == pytest.approx(test.pvalue)


def test_repeated_iterations_cost_nothing() -> None:
    # A thousand copies of an iteration are one: no correction for what does not vary on its own.
    first, second = rng(4).normal(size=(2, 5, 1))
    once = compare_curves(first, second, generator=rng()).p_value
    copies = compare_curves(np.tile(first, 1000), np.tile(second, 1000), generator=rng())
    assert copies.p_value == pytest.approx(once)


def test_the_test_is_exact() -> None:
    # Whichever labeling is the one seen: no more than a share p of them have a p-value of p or
    # less.
    pooled = ar1_curves((6, 40), 0.9, 1.0, rng(5))
    p_values = []
    for chosen in combinations(range(6), 3):
        rest = [row for row in range(6) if row not in chosen]
        result = compare_curves(pooled[list(chosen)], pooled[rest], generator=rng())
        p_values.append(result.p_value)
    assert (np.sort(p_values) >= np.arange(1, 21) / 20 - 1e-12).all()


@pytest.mark.simulation
def test_family_wise_error_under_a_null() -> None:
    generator = rng(6)
    studies = 300
    curves = ar1_curves((studies, 10, 100), 0.9, 0.5, generator)
    rejected = [
        compare_curves(one[:5], one[5:], generator=generator).differs.any() for one in curves
    ]
    # 12 of the 252 labelings are at most 0.05.
    expected = 12 / 252
    assert np.mean(rejected) == pytest.approx(
        expected, abs=4 * (expected * (1 - expected) / studies) ** 0.5
    )


def test_where_the_curves_differ_is_found() -> None:
    generator = rng(7)
    first, second = ar1_curves((2, 8, 200), 0.9, 0.3, generator)
    second[:, 120:] += 5.0
    result = compare_curves(first, second, generator=generator)
    assert result.differs[120:].mean() > 0.9
    assert not result.differs[:100].any()
    np.testing.assert_array_equal(result.differs, np.abs(result.difference) > result.margin)
    np.testing.assert_array_equal(result.differs, np.abs(result.statistic) > result.threshold)


@pytest.mark.parametrize(("sizes", "paired"), [((5, 5), False), ((3, 6), False), ((6, 6), True)])
def test_the_clearest_difference_has_the_smallest_p(sizes: tuple[int, int], paired: bool) -> None:
    first, second = rng().normal(size=(sizes[0], 4)), rng(1).normal(50.0, 1.0, (sizes[1], 4))
    result = compare_curves(first, second, paired=paired, generator=rng())
    assert result.p_value == pytest.approx(result.smallest_p)


def test_three_seeds_cannot_differ_at_five_percent() -> None:
    first, second = rng().normal(size=(3, 4)), rng(1).normal(50.0, 1.0, (3, 4))
    result = compare_curves(first, second, generator=rng())
    assert result.smallest_p == 0.1
    assert not result.differs.any()
    assert (np.abs(result.statistic) <= result.threshold * (1 + 1e-9)).all()


def test_iterations_that_do_not_vary_are_no_difference() -> None:
    first, second = np.full((2, 4, 3), 0.1)
    second[:, 1] += np.array([1e-17, -1e-17, 1e-17, 0.0])  # rounding
    first[:, 2] = rng().normal(size=4)
    for paired in (False, True):
        result = compare_curves(first, second, paired=paired, generator=rng())
        np.testing.assert_array_equal(result.statistic[:2], 0.0)
        np.testing.assert_array_equal(result.p_values[:2], 1.0)


def test_curves_that_do_not_vary_at_all_are_alike() -> None:
    result = compare_curves(np.ones((4, 3)), np.ones((4, 3)), generator=rng())
    assert result.p_value == 1.0
    assert not result.differs.any()


def test_arms_that_do_not_vary_within_differ_all_the_same() -> None:
    # The guard keeps the statistic finite: the smallest standard error is a share of the overall
    # one.
    result = compare_curves(np.zeros((5, 2)), np.ones((5, 2)), generator=rng())
    assert np.isfinite(result.statistic).all()
    assert result.p_value == pytest.approx(2 / 252)


def test_blocks_do_not_change_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = rng(8).normal(size=(2, 5, 30))
    whole = compare_curves(first, second, generator=rng())
    monkeypatch.setattr(room, "BLOCK", 200)
    parts = compare_curves(first, second, generator=rng())
    np.testing.assert_allclose(parts.p_values, whole.p_values)
    assert parts.threshold == pytest.approx(whole.threshold)


@pytest.mark.parametrize("paired", [False, True])
def test_many_seeds_are_drawn_reproducibly(paired: bool) -> None:
    first, second = rng(9).normal(size=(2, 16, 5))
    second += 0.8
    result = compare_curves(first, second, paired=paired, generator=rng(1))
    again = compare_curves(first, second, paired=paired, generator=rng(1))
    other = compare_curves(first, second, paired=paired, generator=rng(2))
    assert not result.exact
    assert result.num_labelings == 10_000
    np.testing.assert_array_equal(result.p_values, again.p_values)
    np.testing.assert_allclose(result.p_values, other.p_values, atol=0.02)
    assert result.p_value >= 1e-4


def test_offset_does_not_matter() -> None:
    # Sums of squares lose digits where the mean is far larger than the spread, unless centred.
    first, second = rng(10).normal(size=(2, 5, 6))
    near = compare_curves(first, second, generator=rng())
    far = compare_curves(first + 1e6, second + 1e6, generator=rng())
    np.testing.assert_allclose(far.statistic, near.statistic, rtol=1e-6)


def test_wrong_curves_are_refused() -> None:
    good = np.ones((3, 4))
    with pytest.raises(ValueError, match="same iterations, got 4 of baseline and 3"):
        compare_curves(good, np.ones((3, 3)), generator=rng())
    with pytest.raises(ValueError, match="two seeds per arm on, got 3 and 1"):
        compare_curves(good, np.ones((1, 4)), generator=rng())
    with pytest.raises(ValueError, match="share their seeds, got 3 and 2"):
        compare_curves(good, np.ones((2, 4)), paired=True, generator=rng())
    with pytest.raises(ValueError, match="baseline must be one curve per seed"):
        compare_curves([1.0, 2.0], good, generator=rng())
    with pytest.raises(ValueError, match="alpha"):
        compare_curves(good, good, generator=rng(), alpha=5)
