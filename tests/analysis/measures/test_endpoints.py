"""Endpoints by hand arithmetic."""

import numpy as np
import pytest

from analysis.measures.endpoints import (
    area_under_curve,
    final_value,
    iterations_to_reach,
    tail_mean,
)


def test_tail_is_the_last_fifth_of_training() -> None:
    iterations = np.arange(1, 11)
    # Of 1 ... 10, the iterations 9 and 10.
    np.testing.assert_allclose(tail_mean([np.arange(10.0), np.ones(10)], iterations), [8.5, 1.0])
    np.testing.assert_allclose(tail_mean([np.arange(10.0)], iterations, share=1.0), [4.5])


@pytest.mark.parametrize(
    ("last", "share", "points"), [(15, 0.2, 3), (10, 0.3, 3), (1000, 0.2, 200)]
)
def test_tail_is_not_lengthened_by_rounding(last: int, share: float, points: int) -> None:
    iterations = np.arange(1, last + 1)
    expected = iterations[-points:].mean()
    assert tail_mean([iterations], iterations, share=share)[0] == pytest.approx(expected)


def test_tail_of_rare_evaluations_is_by_iteration_not_by_point() -> None:
    # After iteration 80 of 100 there are the evaluations at 90 and 100.
    curve = [[9.0, 9.0, 9.0, 2.0, 4.0]]
    assert tail_mean(curve, [1, 40, 80, 90, 100])[0] == pytest.approx(3.0)
    # The last evaluation is always in it.
    assert tail_mean([[5.0, 7.0]], [10, 100])[0] == 7.0


def test_area_by_hand() -> None:
    # Trapezoids: from 1 to 2 (1 + 3) / 2, from 2 to 5 three times (3 + 5) / 2; 14 over the range of
    # 4.
    assert area_under_curve([[1.0, 3.0, 5.0]], [1, 2, 5])[0] == pytest.approx(14 / 4)
    assert area_under_curve([[4.0]], [7])[0] == 4.0
    np.testing.assert_allclose(area_under_curve(np.full((2, 9), 0.3), np.arange(1, 10)), 0.3)


def test_final_value_is_the_last() -> None:
    np.testing.assert_allclose(final_value([[1.0, 2.0], [3.0, 4.0]], [5, 10]), [2.0, 4.0])


def test_iterations_to_reach_by_hand() -> None:
    curves = [[5.0, 1.0, 5.0, 2.0, 1.0], [5.0, 5.0, 5.0, 5.0, 5.0], [1.0, 1.0, 9.0, 9.0, 9.0]]
    iterations = [10, 20, 30, 40, 50]
    reached = iterations_to_reach(curves, iterations, 2.0, smaller_is_better=True)
    np.testing.assert_allclose(reached, [20, np.nan, 10])
    # Means of two: 3 3 3.5 1.5, and 1 5 9 9.
    reached = iterations_to_reach(curves, iterations, 2.0, smaller_is_better=True, window=2)
    np.testing.assert_allclose(reached, [50, np.nan, 20])
    larger = iterations_to_reach(curves, iterations, 9.0, smaller_is_better=False, window=2)
    np.testing.assert_allclose(larger, [np.nan, np.nan, 40])


def test_wrong_curves_are_refused() -> None:
    with pytest.raises(ValueError, match=r"got shapes \(1, 2\) and \(3,\)"):
        tail_mean([[1.0, 2.0]], [1, 2, 3])
    with pytest.raises(ValueError, match="choose iterations at which every seed was measured"):
        final_value([[1.0, np.nan]], [1, 2])
    with pytest.raises(ValueError, match="positive and increasing"):
        area_under_curve([[1.0, 2.0]], [2, 2])
    with pytest.raises(ValueError, match=r"\(0, 1\], got 20"):
        tail_mean([[1.0, 2.0]], [1, 2], share=20)
    with pytest.raises(ValueError, match="between 1 and the 2 points, got 3"):
        iterations_to_reach([[1.0, 2.0]], [1, 2], 1.0, smaller_is_better=True, window=3)
    with pytest.raises(ValueError, match="finite number, got nan"):
        iterations_to_reach([[1.0, 2.0]], [1, 2], np.nan, smaller_is_better=True)
