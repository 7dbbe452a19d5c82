"""The whole comparison of one metric over seeds."""

import math
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from analysis.statistics.comparison import Comparison, compare, summarise

BASELINE = [5.0, 6.0, 7.0, 8.0, 9.0]
TREATMENT = [4.0, 4.5, 6.5, 6.0, 7.0]


def rng() -> np.random.Generator:
    return np.random.default_rng(30)


def reasons(result: Comparison) -> set[str]:
    """Why some of the values are NaN."""
    parts = [getattr(result, field.name) for field in fields(Comparison)]
    return {part.reason for part in parts if getattr(part, "reason", "")}


def test_independent_seeds_against_scipy() -> None:
    result = compare(BASELINE, TREATMENT, smaller_is_better=True, generator=rng())
    welch = stats.ttest_ind(TREATMENT, BASELINE, equal_var=False)
    assert result.t_test.p_value == pytest.approx(welch.pvalue)
    limits = welch.confidence_interval(0.95)
    assert (result.difference.low, result.difference.high) == pytest.approx(limits)
    assert result.rank_test.name == "Mann-Whitney"
    assert result.permutation_test.name == "exact permutation"
    assert result.difference.estimate == pytest.approx(-1.4)
    assert result.relative_improvement.estimate == pytest.approx(0.2)
    # 7 beats 8, 9, ties 7; 6.5 beats 7, 8, 9; 6 beats 7, 8, 9, ties 6; 4.5 and 4 beat all five.
    assert result.probability_of_improvement == (2.5 + 3 + 3.5 + 5 + 5) / 25
    assert result.smallest_p == pytest.approx(2 / 252)
    assert result.baseline.num_seeds == result.treatment.num_seeds == 5
    assert reasons(result) == {result.bootstrap_difference.reason}


def test_shared_seeds_against_scipy() -> None:
    result = compare(BASELINE, TREATMENT, smaller_is_better=True, paired=True, generator=rng())
    assert result.t_test.p_value == pytest.approx(stats.ttest_rel(TREATMENT, BASELINE).pvalue)
    # Differences -1, -1.5, -0.5, -2, -2: all the same sign, so the exact tests are at their limit.
    assert result.permutation_test.p_value == result.smallest_p == 0.0625
    assert result.rank_test.name == "Wilcoxon signed-rank"
    assert result.rank_test.p_value == 0.0625


def test_improvements_change_sign_with_what_is_better() -> None:
    smaller = compare(BASELINE, TREATMENT, smaller_is_better=True, generator=rng())
    larger = compare(BASELINE, TREATMENT, smaller_is_better=False, generator=rng())
    assert larger.difference == smaller.difference
    assert larger.t_test == smaller.t_test
    assert larger.effect_size.estimate == pytest.approx(-smaller.effect_size.estimate)
    assert larger.relative_improvement.estimate == pytest.approx(-0.2)
    assert larger.probability_of_improvement == pytest.approx(
        1 - smaller.probability_of_improvement
    )


def test_arms_of_different_sizes() -> None:
    result = compare(BASELINE, TREATMENT[:3], smaller_is_better=True, generator=rng())
    assert result.smallest_p == pytest.approx(2 / 56)
    assert (result.baseline.num_seeds, result.treatment.num_seeds) == (5, 3)


def test_summary_by_hand() -> None:
    summary = summarise([1.0, 2.0, 3.0, 4.0, 10.0])
    assert summary.mean.estimate == pytest.approx(4.0)
    assert summary.interquartile_mean == pytest.approx(3.0)
    assert summary.std == pytest.approx(12.5**0.5)
    assert (summary.smallest, summary.largest) == (1.0, 10.0)


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize(
    ("baseline", "treatment", "note"),
    [
        ([1.0], [2.0], "one seed"),
        ([0.1, 0.1, 0.1], [0.2, 0.2, 0.2], "var"),
        ([0.0, 0.0], [0.0, 0.0], "var"),
        ([-1.0, -2.0, -3.0], [1.0, 2.5, 3.0], "not positive"),
        ([1.0, 2.0], [1.5, 2.7], "two shared seeds|bootstrap"),
    ],
)
def test_what_the_data_do_not_allow_is_explained(
    baseline: list[float], treatment: list[float], note: str, paired: bool
) -> None:
    result = compare(baseline, treatment, smaller_is_better=True, paired=paired, generator=rng())
    assert any(part in reason for part in note.split("|") for reason in reasons(result))
    # A NaN never comes without its reason.
    for field in fields(Comparison):
        value = getattr(result, field.name)
        if hasattr(value, "reason"):
            numbers = [getattr(value, name, 0.0) for name in ("p_value", "low", "high")]
            assert any(map(math.isnan, numbers)) == bool(value.reason)


# Numbers that make statistics fail: equal, equal but for rounding, and of very different sizes.
awkward = st.sampled_from([0.0, 0.1, 0.1 + 2e-17, 0.1 + 1e-14, 0.1 + 1e-11, 1.0, -1.0, 1e-9, 1e7])


@given(st.lists(st.tuples(awkward, awkward), min_size=1, max_size=6), st.booleans())
def test_no_data_warn_or_hide_a_reason(pairs: list[tuple[float, float]], paired: bool) -> None:
    # Warnings are errors here.
    baseline, treatment = np.array(pairs).T
    result = compare(baseline, treatment, smaller_is_better=True, paired=paired, generator=rng())
    for part in (result.t_test, result.permutation_test, result.rank_test):
        assert math.isnan(part.p_value) == bool(part.reason)
        assert part.reason or 0 <= part.p_value <= 1
    for part in (result.difference, result.relative_improvement, result.effect_size):
        assert math.isnan(part.low) == math.isnan(part.high) == bool(part.reason)
        assert part.reason or part.low <= part.high


@pytest.mark.parametrize("paired", [False, True])
def test_many_seeds_are_drawn_reproducibly(paired: bool) -> None:
    first, second = np.random.default_rng(31).normal(1.0, 0.2, (2, 25))

    def once() -> Comparison:
        return compare(first, second, smaller_is_better=True, paired=paired, generator=rng())

    result = once()
    assert result == once()
    assert not reasons(result)
    assert result.permutation_test.name.startswith("drawn")
    assert result.bootstrap_difference.low < result.difference.estimate


def test_few_seeds_draw_nothing() -> None:
    generator = rng()
    before = generator.bit_generator.state
    compare(BASELINE, TREATMENT, smaller_is_better=True, generator=generator)
    assert generator.bit_generator.state == before


def test_wrong_data_is_refused() -> None:
    with pytest.raises(ValueError, match="treatment must be finite, but 1 of 2"):
        compare([1.0, 2.0], [1.0, np.inf], smaller_is_better=True, generator=rng())
    with pytest.raises(ValueError, match="got 2 of baseline and 1 of treatment"):
        compare([1.0, 2.0], [1.0], smaller_is_better=True, paired=True, generator=rng())
