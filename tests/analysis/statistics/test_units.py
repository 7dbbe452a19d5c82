"""Which pairs would give a published p-value, by hand arithmetic and SciPy."""

import numpy as np
import pytest
from scipy import stats

from analysis.statistics.paper import iteration_t_test
from analysis.statistics.units import needed_effect, over_stretches


def test_two_pairs_by_hand() -> None:
    """With one degree of freedom t = tan(pi (1 - p) / 2): of p = 0.5, t = 1 and d = 1 / sqrt(2)."""
    assert needed_effect(0.5, 2) == pytest.approx(0.5**0.5)


@pytest.mark.parametrize("num_pairs", [5, 50, 2500])
def test_pairs_with_that_effect_have_that_p_value(num_pairs: int) -> None:
    draws = np.random.default_rng(0).standard_normal(num_pairs)
    pairs = (draws - draws.mean()) / draws.std(ddof=1) + needed_effect(1.72e-9, num_pairs)
    assert stats.ttest_1samp(pairs, 0.0).pvalue == pytest.approx(1.72e-9, rel=1e-6)


@pytest.mark.parametrize(("p_value", "num_pairs"), [(0.0, 5), (1.5, 5), (0.05, 1)])
def test_what_no_test_can_give_is_refused(p_value: float, num_pairs: int) -> None:
    with pytest.raises(ValueError, match="two pairs at least"):
        needed_effect(p_value, num_pairs)


def test_stretches_are_means_of_neighbours() -> None:
    """1, 3 | 5, 7 | 9, 11 against zeros: means 2, 6 and 10."""
    (found,) = over_stretches(np.zeros(6), [1.0, 3, 5, 7, 9, 11], [3])
    assert found.count == 3
    assert found.test.p_value == pytest.approx(stats.ttest_1samp([2, 6, 10], 0).pvalue)


def test_as_many_stretches_as_iterations_are_the_test_over_iterations() -> None:
    first, second = np.random.default_rng(1).standard_normal((2, 40))
    found = over_stretches(first, second, [10, 40, 100])
    assert [each.count for each in found] == [10, 40]
    assert found[1].test == iteration_t_test(first, second)
