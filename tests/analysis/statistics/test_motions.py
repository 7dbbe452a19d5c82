"""Two arms over several motions: by hand, and by simulated studies with a known truth."""

import numpy as np
import pytest
from scipy import stats

from analysis.statistics.intervals import interquartile_mean
from analysis.statistics.motions import (
    interquartile_means,
    performance_profiles,
    pooled_probability,
    pooled_ratio,
)

EASY, HARD = np.array([1.0, 1.2, 0.8]), np.array([10.0, 11.0, 9.0])


def generator() -> np.random.Generator:
    return np.random.default_rng(0)


def test_halves_on_one_motion_and_doubles_on_another_cancel() -> None:
    pooled = pooled_ratio([EASY, HARD], [EASY / 2, HARD * 2], smaller_is_better=True)
    assert pooled.improvement.estimate == pytest.approx(0.0)
    assert pooled.test.p_value == pytest.approx(1.0)


def test_the_scale_of_a_motion_does_not_matter() -> None:
    small = pooled_ratio([EASY, HARD], [EASY * 0.9, HARD * 0.8], smaller_is_better=True)
    large = pooled_ratio([EASY, HARD * 7], [EASY * 0.9, HARD * 5.6], smaller_is_better=True)
    assert small.improvement.estimate == pytest.approx(1 - np.sqrt(0.9 * 0.8))
    assert large.improvement.low == pytest.approx(small.improvement.low)
    assert large.test.p_value == pytest.approx(small.test.p_value)


def test_where_more_is_better_the_improvement_has_the_other_sign() -> None:
    less = pooled_ratio([EASY], [EASY * 0.8], smaller_is_better=True).improvement
    more = pooled_ratio([EASY], [EASY * 0.8], smaller_is_better=False).improvement
    assert (more.estimate, more.low, more.high) == (-less.estimate, -less.high, -less.low)


def test_one_motion_is_nearly_welch() -> None:
    """With a small spread the logarithm is straight, and the delta method exact."""
    first = 100 + np.array([0.1, -0.2, 0.05, 0.05])
    second = 100.3 + np.array([0.4, -0.1, -0.3])
    pooled = pooled_ratio([first], [second], smaller_is_better=True)
    welch = stats.ttest_ind(first, second, equal_var=False)
    assert pooled.test.p_value == pytest.approx(welch.pvalue, rel=0.02)


@pytest.mark.parametrize(
    ("second", "reason"),
    [([np.array([1.0])], "one seed"), ([np.array([-1.0, 0.5])], "not positive")],
)
def test_what_the_seeds_do_not_allow_is_said(second, reason) -> None:
    pooled = pooled_ratio([EASY], second, smaller_is_better=True)
    assert np.isnan(pooled.improvement.low)
    assert reason in pooled.test.reason
    with pytest.raises(ValueError, match=reason):
        performance_profiles([EASY], second, [1.0], smaller_is_better=True, generator=generator())


def test_arms_without_spread_have_an_estimate_but_no_test() -> None:
    pooled = pooled_ratio([np.ones(3)], [np.full(3, 0.5)], smaller_is_better=True)
    assert pooled.improvement.estimate == pytest.approx(0.5)
    assert "varies" in pooled.test.reason


def test_different_motions_are_refused() -> None:
    with pytest.raises(ValueError, match="the same motions"):
        pooled_ratio([EASY], [EASY, HARD], smaller_is_better=True)


def test_interquartile_means_are_of_the_normalised_runs() -> None:
    # Normalised: 1, 1.2, 0.8 and 1, 1.1, 0.9 of the baseline; one run of the treatment fell.
    second = [np.array([0.9, 0.9, 0.9]), np.array([9.0, 9.0, 90.0])]
    base, treated, interval = interquartile_means([EASY, HARD], second, generator=generator())
    assert base == pytest.approx(interquartile_mean([1, 1.2, 0.8, 1, 1.1, 0.9]))
    assert treated == pytest.approx(0.9)  # the run that fell is cut off
    assert interval.estimate == pytest.approx(treated - base)


def test_the_probability_of_improvement_is_the_mean_over_motions() -> None:
    interval = pooled_probability(
        [EASY, HARD], [EASY / 2, HARD], smaller_is_better=True, generator=generator()
    )
    assert interval.estimate == pytest.approx((1.0 + 0.5) / 2)
    assert interval.low <= interval.estimate <= interval.high


def test_a_profile_by_hand() -> None:
    first, second = performance_profiles(
        [EASY, HARD],
        [EASY / 2, HARD],
        [0.5, 0.85, 1.0],
        smaller_is_better=True,
        generator=generator(),
    )
    # EASY / 2 is 0.4, 0.5, 0.6 of the mean; HARD 0.9, 1.0, 1.1 of its own.
    assert second.share.tolist() == pytest.approx([2 / 3 / 2, 0.5, (1 + 2 / 3) / 2])
    assert first.share.tolist() == pytest.approx([0.0, 1 / 3 / 2, 2 / 3])
    assert (second.low <= second.share).all()
    assert (second.share <= second.high).all()


def studies(motions: int, seeds: int, ratio: float, count: int):
    """Simulated pairs of arms: levels of 1 to 8, 20 % from seed to seed; the true improvement."""
    random = np.random.default_rng(7)
    levels = np.linspace(1.0, 8.0, motions)
    for _ in range(count):
        noise = 1 + 0.2 * random.standard_normal((2, motions, seeds))
        yield list(levels[:, None] * noise[0]), list(ratio * levels[:, None] * noise[1])


@pytest.mark.simulation
@pytest.mark.parametrize(("motions", "seeds"), [(8, 3), (3, 5)])
def test_the_pooled_interval_covers_and_calls_nothing_different_as_often_as_stated(
    motions, seeds
) -> None:
    found = [
        pooled_ratio(*study, smaller_is_better=True) for study in studies(motions, seeds, 0.9, 800)
    ]
    covered = np.mean([each.improvement.low <= 0.1 <= each.improvement.high for each in found])
    null = [
        pooled_ratio(*study, smaller_is_better=True) for study in studies(motions, seeds, 1.0, 800)
    ]
    wrong = np.mean([each.test.p_value < 0.05 for each in null])
    # Three binomial standard errors of 800 studies are 2.3 %.
    assert covered == pytest.approx(0.95, abs=0.023)
    assert wrong == pytest.approx(0.05, abs=0.023)


@pytest.mark.simulation
def test_the_bootstrap_covers_nearly_as_stated_with_three_seeds_on_eight_motions(
    monkeypatch,
) -> None:
    monkeypatch.setattr("analysis.statistics.motions.RESAMPLES", 150)
    covered = []
    for study in studies(8, 3, 0.9, 100):
        interval = interquartile_means(*study, generator=generator())[2]
        covered.append(interval.low <= -0.1 <= interval.high)
    # Three binomial standard errors of 100 studies are 6.5 %.
    assert np.mean(covered) >= 0.95 - 0.065
