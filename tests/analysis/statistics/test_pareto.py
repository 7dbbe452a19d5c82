"""Fronts and areas by hand, against an independent count, and the rate of false alarms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.statistics.pareto import MARGIN, compare_areas, hypervolume, on_front

POINTS = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=8)


def test_front_by_hand() -> None:
    """(1, 3), (2, 2) and (3, 1) beat (3, 3) and (2, 4); of two equal points both stay."""
    points = [(1, 3), (2, 2), (3, 1), (3, 3), (2, 4), (2, 2)]
    assert on_front(points).tolist() == [True, True, True, False, False, True]


def test_area_by_hand() -> None:
    """Up to (4, 4): columns of width 1 with heights 1, 2 and 3 are 6; (5, 0) lies beyond."""
    assert hypervolume([(1, 3), (2, 2), (3, 1), (3, 3), (5, 0)], (4, 4)) == 6
    assert hypervolume([(4, 1), (1, 4)], (4, 4)) == 0


@settings(max_examples=60)
@given(points=POINTS)
def test_area_is_the_number_of_unit_squares_that_some_point_dominates(points) -> None:
    counted = sum(any(x <= a and y <= b for x, y in points) for a in range(10) for b in range(10))
    assert hypervolume(points, (10, 10)) == pytest.approx(counted)
    front = np.asarray(points)[on_front(points)]
    assert hypervolume(front, (10, 10)) == pytest.approx(counted)


def test_arms_that_are_far_apart_have_the_smallest_p_there_is() -> None:
    generator = np.random.default_rng(0)
    near, far = generator.random((5, 2)), 5 + generator.random((5, 2))
    areas = compare_areas(far, near, generator=generator)
    assert areas.test.p_value == pytest.approx(2 / 252)
    assert areas.treatment > 0.9 * 1 > areas.baseline
    assert all(each.shape == (5,) for each in areas.of_runs)
    # The best corner of the box has all of it, the worst of each axis a tenth of a range each way.
    corners = compare_areas([[1.0, 1.0], [1.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]], generator=generator)
    assert corners.treatment == pytest.approx(1.0)
    assert corners.baseline == pytest.approx((MARGIN / (1 + MARGIN)) ** 2)


def test_less_cost_alone_gains_area_and_worse_tracking_takes_it_back() -> None:
    """The box is 1.1 x 1.1; half the cost at the worst error gains less than both at once."""
    base = [[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]]
    cheap = compare_areas(base, [[0.0, 1.0]] * 2, generator=np.random.default_rng(0))
    both = compare_areas(base, [[0.0, 0.0]] * 2, generator=np.random.default_rng(0))
    assert cheap.treatment == pytest.approx(1.1 * 0.1 / 1.21)
    assert both.treatment == pytest.approx(1.0)


def test_arms_of_one_kind_are_called_different_no_more_often_than_stated() -> None:
    generator = np.random.default_rng(1)
    p_values = []
    for _ in range(120):
        first, second = generator.standard_normal((2, 4, 2))
        p_values.append(compare_areas(first, second, generator=generator).test.p_value)
    # At 0.2, three binomial standard errors of 120 studies are 0.11.
    assert np.mean(np.asarray(p_values) <= 0.2) <= 0.2 + 0.11


@pytest.mark.parametrize("points", [[], [[1.0]], [[np.nan, 1.0]]])
def test_other_shapes_are_refused(points) -> None:
    with pytest.raises(ValueError, match="points must be"):
        on_front(points)
