"""Power against published sample sizes, the noncentral t distribution and simulation."""

import numpy as np
import pytest
from scipy import stats

from analysis.statistics.power import (
    MOST_SEEDS,
    detectable_effect,
    power,
    seeds_for_effect,
    seeds_needed,
)


@pytest.mark.parametrize(
    ("effect", "paired", "expected"),
    [
        # Cohen 1988, table 2.4.1, and what G*Power gives: two independent groups ...
        (0.2, False, 394),
        (0.5, False, 64),
        (0.8, False, 26),
        (1.0, False, 17),
        # ... and pairs.
        (0.2, True, 199),
        (0.5, True, 34),
        (0.8, True, 15),
    ],
)
def test_seeds_are_those_of_the_tables(effect: float, paired: bool, expected: int) -> None:
    assert seeds_for_effect(effect, paired=paired) == expected
    assert seeds_for_effect(-effect, paired=paired) == expected


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize("effect", [0.3, 1.0, 2.5])
def test_power_is_that_of_the_noncentral_t(paired: bool, effect: float) -> None:
    freedom = 4 if paired else 8
    shift = effect * (5 if paired else 2.5) ** 0.5
    critical = stats.t.ppf(0.975, freedom)
    both_tails = stats.nct.sf(critical, freedom, shift) + stats.nct.cdf(-critical, freedom, shift)
    assert power(5, effect, paired=paired) == pytest.approx(both_tails, rel=1e-6)


@pytest.mark.parametrize(("effect", "known"), [(1.0, 0.2863), (2.0, 0.7905)])
def test_power_of_five_seeds_by_simulation(effect: float, known: float) -> None:
    studies = 20_000
    first, second = np.random.default_rng(14).normal(size=(2, studies, 5))
    found = stats.ttest_ind(second + effect, first, axis=1).pvalue <= 0.05
    error = (known * (1 - known) / studies) ** 0.5
    assert power(5, effect) == pytest.approx(known, abs=5e-5)
    assert found.mean() == pytest.approx(known, abs=4 * error)
    # Welch's test does not know that the variances are equal, and has up to four points less.
    welch = stats.ttest_ind(second + effect, first, axis=1, equal_var=False).pvalue <= 0.05
    assert welch.mean() == pytest.approx(known - 0.02, abs=0.02)


def test_without_an_effect_the_power_is_alpha() -> None:
    assert power(5, 0.0, alpha=0.01) == 0.01
    assert power(5, 1e-6) == pytest.approx(0.05)


def test_a_huge_effect_needs_two_seeds() -> None:
    assert seeds_for_effect(1e12) == 2
    assert seeds_for_effect(1e200, paired=True) == 2


def test_no_effect_and_tiny_effects_need_no_number() -> None:
    assert seeds_for_effect(0.0) is None
    assert seeds_for_effect(1e-3) is None
    # 2 (1.96 + 0.8416)^2 / d^2 seeds for many: 15.7 / d^2, just within the limit.
    assert seeds_for_effect(0.005) == pytest.approx(15.7 / 0.005**2, rel=1e-3)
    assert seeds_for_effect(0.995 * (15.7 / MOST_SEEDS) ** 0.5) is None
    assert seeds_for_effect(1.005 * (15.7 / MOST_SEEDS) ** 0.5) is not None


@pytest.mark.parametrize("paired", [False, True])
def test_the_number_is_the_fewest(paired: bool) -> None:
    for effect in np.linspace(0.3, 4, 12):
        fewest = seeds_for_effect(effect, paired=paired, target=0.9, alpha=0.01)
        assert fewest is not None
        assert power(fewest, effect, paired=paired, alpha=0.01) >= 0.9
        if fewest > 2:
            assert power(fewest - 1, effect, paired=paired, alpha=0.01) < 0.9


def test_detectable_effect_has_the_power() -> None:
    for num_seeds, paired in ((2, False), (2, True), (5, False), (30, True)):
        effect = detectable_effect(num_seeds, paired=paired)
        assert power(num_seeds, effect, paired=paired) == pytest.approx(0.8)
    assert detectable_effect(5) == pytest.approx(2.02, abs=0.01)


def test_seeds_needed_by_hand() -> None:
    # Difference 1 and both variances 1: an effect of 1, which needs 17 per arm.
    assert seeds_needed([1.0, 2.0, 3.0], [2.0, 3.0, 4.0]) == 17
    # Differences 0.5, 0.5, 2, 2 less nothing: mean 1.25, variance 0.75.
    paired = seeds_needed([1.0, 2.0, 3.0, 4.0], [1.5, 2.5, 5.0, 6.0], paired=True)
    assert paired == seeds_for_effect(1.25 / 0.75**0.5, paired=True)
    assert seeds_needed([1.0], [2.0, 3.0]) is None
    assert seeds_needed([1.0, 1.0], [2.0, 2.0]) is None
    assert seeds_needed([1.0, 2.0], [2.0, 1.0]) is None


def test_wrong_questions_are_refused() -> None:
    with pytest.raises(ValueError, match="at least two seeds, got 1"):
        power(1, 1.0)
    with pytest.raises(ValueError, match="alpha must lie between 0 and 1, got 5"):
        power(5, 1.0, alpha=5)
    with pytest.raises(ValueError, match="got 80"):
        seeds_for_effect(1.0, target=80)
